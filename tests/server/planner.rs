//! Planners' questions to a server that has seen a room, and what it says while the map changes.

use std::time::Duration;

use glam::{Quat, UVec3, Vec3};
use orenx::dataset::Dataset;
use orenx::dataset::synthetic::Synthetic;
use orenx::engine::QueuePolicy;
use orenx::geometry::Aabb;
use orenx::map::{Costs, Fields, GridShape, RayState, Sphere, State, Waypoint};
use orenx::service::{
    DEFAULT_MAP, GridQuestion, NearestQuestion, NumberFormat, RaysQuestion, RegionQuestion,
    SliceQuestion, SpheresQuestion, Terms, TrajectoriesQuestion, Unknown, UnknownPolicy,
    WatchedTrajectories,
};
use orenx::wire::{frame_to_wire, v1};
use tonic::Code;

use super::{Running, open_stream, start, verdict};

pub(crate) const FRAMES: usize = 60;

fn room() -> Synthetic {
    Synthetic::room(FRAMES).with_width(160)
}

/// Sends frames of the room; the epoch that holds them.
pub(crate) async fn send(server: &Running, indices: impl IntoIterator<Item = usize>) -> u64 {
    let (frames, mut acks) = open_stream(&server.channel).await;
    let room = room();
    let mut epoch = 0;
    for index in indices {
        let frame = room.load(index, false).unwrap();
        frames.send(frame_to_wire(DEFAULT_MAP, &frame, QueuePolicy::Block)).await.unwrap();
        epoch = verdict(&mut acks).await.epoch;
    }
    epoch
}

/// A server that knows the room.
pub(crate) async fn planned() -> (Running, u64) {
    let server = start(|_| {}).await;
    let epoch = send(&server, 0..FRAMES).await;
    (server, epoch)
}

fn terms(min_epoch: u64) -> Terms {
    Terms { min_epoch, ..Terms::default() }
}

fn sphere(center: Vec3, radius_m: f32) -> Sphere {
    Sphere { center, radius_m }
}

/// A robot of three spheres, and ways all over the room.
fn ways(min_epoch: u64) -> TrajectoriesQuestion {
    let pose = |i: usize| {
        let t = i as f32 * 0.37;
        let at = Vec3::new(2.6 * (t * 1.3).sin(), 1.9 * (t * 0.7).cos(), 1.1 + 0.5 * t.sin());
        Waypoint { rotation: Quat::from_rotation_z(t).to_array(), ..Waypoint::at(at) }
    };
    TrajectoriesQuestion {
        terms: terms(min_epoch),
        body: vec![
            sphere(Vec3::ZERO, 0.1),
            sphere(Vec3::new(0.3, 0.0, 0.0), 0.05),
            sphere(Vec3::new(0.0, -0.2, 0.1), 0.08),
        ],
        poses: (0..40).map(pose).collect(),
        lengths: vec![4, 1, 5, 6, 4, 5, 7, 8],
        margin_m: 0.02,
        swept: true,
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn no_collision_between_two_poses_is_missed() {
    let (server, epoch) = planned().await;
    let question = ways(epoch);
    let swept = server.client.check_trajectories(&question).await.unwrap();
    let at_poses = TrajectoriesQuestion { swept: false, ..question.clone() };
    let at_poses = server.client.check_trajectories(&at_poses).await.unwrap();
    assert_eq!((swept.epoch, swept.answer.len()), (epoch, 8));
    // The same by brute force: a thousand places on each way.
    const STEPS: usize = 1000;
    let (mut first, mut hits) = (0, 0);
    for (trajectory, &length) in question.lengths.iter().enumerate() {
        let poses = &question.poses[first..first + length as usize];
        first += length as usize;
        let (mut centers, mut radii) = (Vec::new(), Vec::new());
        for way in poses.windows(2) {
            let [from, to] = [&way[0], &way[1]];
            let turn = |w: &Waypoint| Quat::from_array(w.rotation);
            for step in 0..STEPS {
                let share = step as f32 / STEPS as f32;
                let rotation = turn(from).slerp(turn(to), share);
                let at = Vec3::from(from.translation).lerp(Vec3::from(to.translation), share);
                centers.extend(question.body.iter().map(|s| rotation * s.center + at));
                radii.extend(question.body.iter().map(|s| s.radius_m));
            }
        }
        let dense = server
            .client
            .query_points(DEFAULT_MAP, &centers, Fields::DISTANCE, epoch)
            .await
            .unwrap();
        let clearances: Vec<f32> =
            dense.answers.distance.iter().zip(&radii).map(|(d, r)| d - r).collect();
        let least = clearances.iter().copied().fold(f32::NAN, f32::min);
        let hit = clearances.iter().position(|c| *c < question.margin_m);
        let found = &swept.answer[trajectory];
        if let Some(hit) = hit {
            hits += 1;
            let place = found.first_hit.expect("a collision was missed");
            let expected = hit / (STEPS * question.body.len());
            assert_eq!(place.pose as usize, expected, "trajectory {trajectory}");
            let share = (hit / question.body.len() % STEPS) as f32 / STEPS as f32;
            assert!((place.fraction - share).abs() < 0.02, "{} {share}", place.fraction);
        }
        // How deep it would be inside of things is not the point.
        if !clearances.is_empty() {
            let least = least.max(question.margin_m);
            assert!(found.min_clearance_m < least + 0.012, "{} {least}", found.min_clearance_m);
        }
        let coarse = &at_poses.answer[trajectory];
        let coarsely = coarse.min_clearance_m;
        assert!(found.min_clearance_m <= coarsely || coarsely.is_nan());
        assert!(found.unknown_hits >= coarse.unknown_hits);
    }
    assert!(hits >= 1, "the room is full of things");
    server.stop().await.0.unwrap();
}

#[tokio::test(flavor = "multi_thread")]
async fn unknown_space_counts_as_the_question_says() {
    let (server, epoch) = planned().await;
    let ask = async |policy| {
        let mut question = ways(epoch);
        question.terms.unknown = Unknown { policy, distance_m: None };
        // Out of the room, where nobody was.
        question.poses =
            vec![Waypoint::at(Vec3::new(0.0, 0.9, 1.3)), Waypoint::at(Vec3::splat(30.0))];
        question.lengths = Vec::new();
        question.swept = false;
        server.client.check_trajectories(&question).await.unwrap().answer[0]
    };
    let reported = ask(UnknownPolicy::Report).await;
    assert_eq!((reported.unknown_hits, reported.first_hit), (3, None), "{reported:?}");
    let free = ask(UnknownPolicy::Free).await;
    assert_eq!((free.first_hit, free.min_clearance_m), (None, reported.min_clearance_m));
    let occupied = ask(UnknownPolicy::Occupied).await;
    assert_eq!(occupied.first_hit.map(|hit| (hit.pose, hit.sphere)), Some((1, 0)));
    assert!((occupied.min_clearance_m + 2.1).abs() < 1e-5, "{occupied:?}");
    server.stop().await.0.unwrap();
}

const FIELDS: Fields = Fields { gradient: true, state: true, ..Fields::DISTANCE };

#[tokio::test(flavor = "multi_thread")]
async fn spheres_rays_slices_grids_and_surfaces_say_what_points_say() {
    let (server, epoch) = planned().await;
    spheres_and_surfaces(&server, epoch).await;
    rays(&server, epoch).await;
    grids_and_slices(&server, epoch).await;
    server.stop().await.0.unwrap();
}

async fn spheres_and_surfaces(server: &Running, epoch: u64) {
    let room = room();
    let scene = room.scene(FRAMES - 1);
    let points: Vec<Vec3> = (0..4000u16)
        .map(|i| {
            let t = f32::from(i);
            Vec3::new(2.9 * (t * 0.1).sin(), 2.1 * (t * 0.37).cos(), 1.3 + 1.2 * (t * 0.73).sin())
        })
        .collect();
    let direct =
        server.client.query_points(DEFAULT_MAP, &points, Fields::ALL, epoch).await.unwrap();
    let direct = direct.answers;
    let bits = |values: &[f32]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();

    let spheres = points.iter().map(|p| sphere(*p, 0.25)).collect();
    let question = SpheresQuestion { terms: terms(epoch), spheres, fields: FIELDS };
    let clear = server.client.query_spheres(&question).await.unwrap().answer;
    let expected: Vec<f32> = direct.distance.iter().map(|d| d - 0.25).collect();
    assert_eq!((bits(&clear.distance), &clear.state), (bits(&expected), &direct.state));

    let question =
        NearestQuestion { terms: terms(epoch), points: points.clone(), max_unknown_m: 0.5 };
    let near = server.client.find_nearest(&question).await.unwrap().answer;
    assert_eq!(near.state, direct.state);
    let (mut found, mut off) = (0, 0.0f32);
    for ((point, surface), state) in points.iter().zip(&near.surface).zip(&near.state) {
        if *state == State::Free as u8 && surface.is_finite() {
            found += 1;
            off += scene.distance(*surface).abs();
            assert!(point.distance(*surface) < 3.0);
        }
    }
    assert!(found > 1000 && off / (found as f32) < 0.02, "{found}: {} m", off / found as f32);
    for (state, unknown) in near.state.iter().zip(&near.unknown_distance_m) {
        assert!(*unknown <= 0.5 || unknown.is_infinite());
        // What is known may lie in a cell that no ray crossed, near a surface; all else does not.
        assert!(*state != State::Unknown as u8 || *unknown < 1e-3, "{unknown}");
    }
}

async fn rays(server: &Running, epoch: u64) {
    let room = room();
    let scene = room.scene(FRAMES - 1);
    let eye = Vec3::new(0.9, 0.4, 1.4);
    let directions: Vec<Vec3> = (0..200u16)
        .map(|i| {
            let t = f32::from(i) * 0.21;
            Vec3::new(t.cos(), t.sin(), 0.5 * (t * 0.31).sin())
        })
        .collect();
    let question = RaysQuestion {
        terms: terms(epoch),
        origins: vec![eye; directions.len()],
        directions: directions.clone(),
        max_range_m: 8.0,
    };
    let rays = server.client.cast_rays(&question).await.unwrap().answer;
    let mut errors = Vec::new();
    for ((direction, state), distance) in directions.iter().zip(&rays.state).zip(&rays.distance_m) {
        assert_ne!(*state, RayState::Free as u8, "the room is closed");
        if *state == RayState::Hit as u8 {
            let truth = scene.cast(eye, direction.normalize()).expect("walls").t;
            errors.push((distance - truth).abs());
        }
    }
    errors.sort_by(f32::total_cmp);
    assert!(errors.len() > 100, "{} hits", errors.len());
    assert!(errors[errors.len() / 2] < 0.015, "{} m", errors[errors.len() / 2]);
}

async fn grids_and_slices(server: &Running, epoch: u64) {
    let region = Aabb { min: Vec3::new(-1.0, -1.0, 0.8), max: Vec3::new(1.0, 0.6, 1.2) };
    let mut question = GridQuestion {
        terms: terms(epoch),
        region,
        voxel_m: 0.1,
        fields: FIELDS,
        format: NumberFormat::F32,
    };
    let grid = server.client.get_grid(&question).await.unwrap().answer;
    assert_eq!(grid.shape.size.to_array(), [20, 16, 4]);
    let centers: Vec<Vec3> = (0..1280).map(|index| grid.shape.center_at(index)).collect();
    let same = server.client.query_points(DEFAULT_MAP, &centers, FIELDS, epoch).await.unwrap();
    let bytes = |values: &[f32]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    assert_eq!(grid.columns.distance, bytes(&same.answers.distance));
    assert_eq!(grid.columns.state, same.answers.state);
    assert_eq!(grid.columns.gradient.len(), 1280 * 12);
    question.format = NumberFormat::F16;
    let halves = server.client.get_grid(&question).await.unwrap().answer;
    assert_eq!(halves.columns.distance.len(), 1280 * 2);

    let question = SliceQuestion {
        terms: terms(epoch),
        z_m: 0.85,
        z_max_m: Some(1.15),
        resolution_m: 0.1,
        region: Some(region),
        ..SliceQuestion::default()
    };
    let slice = server.client.get_slice(&question).await.unwrap().answer;
    assert_eq!((slice.shape.width, slice.shape.height), (20, 16));
    let layers: Vec<&[f32]> = same.answers.distance.chunks(320).collect();
    for (cell, d) in slice.distance_m.iter().enumerate() {
        let least = layers.iter().map(|layer| layer[cell]).fold(f32::NAN, f32::min);
        assert!((d - least).abs() < 1e-4 || (d.is_nan() && least.is_nan()), "{d} {least}");
    }
    let costs = Costs { robot_radius_m: 0.3, inflation_m: 0.8 };
    let costly = SliceQuestion { costs: Some(costs), ..question };
    let costly = server.client.get_slice(&costly).await.unwrap().answer;
    let expected: Vec<i8> = slice.distance_m.iter().map(|d| costs.of(*d)).collect();
    assert_eq!((costly.cost, costly.distance_m.len()), (expected, 0));
}

/// Writes the states of a brick where the voxels of the region are.
fn put(brick: &v1::RegionBrick, shape: &GridShape, state: &mut [u8]) {
    assert_eq!((brick.distance_m.len(), brick.state.len()), (512, 512));
    for (voxel, value) in (0..).zip(&brick.state) {
        let in_brick = UVec3::new(voxel % 8, voxel / 8 % 8, voxel / 64);
        let at = UVec3::new(brick.x, brick.y, brick.z) * 8 + in_brick;
        if at.cmplt(shape.size).all() {
            state[at.dot(shape.stride()) as usize] = *value;
        } else {
            assert_eq!(*value, 0, "beyond the region");
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_watched_region_tells_what_changes_and_a_watched_way_when_it_is_unsafe() {
    let server = start(|_| {}).await;
    let region = Aabb { min: Vec3::new(-3.0, -2.4, 0.2), max: Vec3::new(3.0, 2.4, 2.2) };
    let question = RegionQuestion {
        terms: Terms::default(),
        region,
        voxel_m: 0.1,
        min_interval: Duration::from_millis(1),
        tolerance_m: 0.01,
    };
    let mut news = server.client.watch_region(&question).await.unwrap();
    let first = news.next().await.unwrap().expect("what there is");
    assert_eq!((first.epoch, first.bricks.len(), &first.size[..]), (0, 0, &[60, 48, 20][..]));
    let mut seq = first.seq;
    assert_eq!(seq, 1);
    // Through a wall that nobody has seen yet.
    let mut check = ways(0);
    check.poses = [0.0f32, 4.0].map(|x| Waypoint::at(Vec3::new(x, 0.9, 1.3))).to_vec();
    check.lengths = Vec::new();
    let watched = WatchedTrajectories { check, drop_m: 0.0 };
    let mut events = server.client.watch_trajectories(&watched).await.unwrap();
    let event = events.next().await.unwrap().expect("what there is");
    assert_eq!((event.epoch, event.answer[0].first_hit), (0, None));

    let epoch = send(&server, 0..FRAMES).await;
    let event = events.next().await.unwrap().expect("the wall");
    assert!(event.epoch <= epoch && event.answer[0].first_hit.is_some(), "{event:?}");
    // What is told adds up to what there is.
    let grid = GridQuestion {
        terms: terms(epoch),
        region,
        voxel_m: 0.1,
        fields: Fields { state: true, ..Fields::DISTANCE },
        format: NumberFormat::F32,
    };
    let grid = server.client.get_grid(&grid).await.unwrap().answer;
    let mut state = vec![0u8; grid.columns.state.len()];
    loop {
        let change = news.next().await.unwrap().expect("more");
        change.bricks.iter().for_each(|brick| put(brick, &grid.shape, &mut state));
        seq += 1;
        assert_eq!(change.seq, seq, "none is missing");
        if change.epoch >= epoch {
            break;
        }
    }
    assert!(state.contains(&1) && state == grid.columns.state);

    server.client.reset_map(DEFAULT_MAP).await.unwrap();
    loop {
        let event = events.next().await.unwrap().expect("the wall is forgotten");
        if event.epoch > epoch {
            assert!(event.answer[0].first_hit.is_none());
            break;
        }
    }
    drop(news);
    server.stop().await.0.unwrap();
    assert!(events.next().await.is_err(), "it ends with the server");
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_wrong_is_refused_by_name() {
    let server = start(|settings| settings.server.max_points = 100).await;
    let mut planner = v1::planner_client::PlannerClient::new(server.channel.clone());
    let map_id = || DEFAULT_MAP.to_owned();
    let spheres = v1::QuerySpheresRequest {
        map_id: map_id(),
        spheres_m: vec![0.0, 0.0, f32::NAN, 0.1],
        ..Default::default()
    };
    let told = planner.query_spheres(spheres.clone()).await.expect_err("NaN");
    assert!(told.message().starts_with("spheres_m[0].z: NaN"), "{told}");
    let text = v1::QuerySpheresRequest { fields: vec![6], spheres_m: vec![], ..spheres.clone() };
    let told = planner.query_spheres(text).await.expect_err("no text");
    assert!(told.message().starts_with("fields: TEXT_SCORE"), "{told}");
    let elsewhere = v1::QuerySpheresRequest { map_id: "attic".into(), ..spheres };
    let told = planner.query_spheres(elsewhere).await.expect_err("no such map");
    assert_eq!(told.code(), Code::NotFound);
    let poses = v1::CheckTrajectoriesRequest {
        map_id: map_id(),
        poses: vec![0.0; 8],
        ..Default::default()
    };
    let told = planner.check_trajectories(poses).await.expect_err("not whole");
    assert!(told.message().starts_with("poses: 8 numbers"), "{told}");
    let grid = v1::GetGridRequest { map_id: map_id(), voxel_m: 0.1, ..Default::default() };
    let told = planner.get_grid(grid).await.expect_err("no region");
    assert!(told.message().starts_with("region: is required"), "{told}");
    let slice = v1::GetSliceRequest { map_id: map_id(), resolution_m: 0.1, ..Default::default() };
    let told = planner.get_slice(slice).await.expect_err("nothing mapped");
    assert_eq!(told.code(), Code::FailedPrecondition, "{told}");
    let nearest =
        v1::FindNearestRequest { map_id: map_id(), points_m: vec![0.0; 39], ..Default::default() };
    let told = planner.find_nearest(nearest).await.expect_err("too many");
    assert!(told.message().starts_with("points_m: 13 points; the limit is 12"), "{told}");
    let watch = v1::WatchTrajectoryRequest::default();
    let told = planner.watch_trajectory(watch).await.expect_err("nothing to watch");
    assert!(told.message().starts_with("check: is required"), "{told}");
    let region = v1::WatchRegionRequest { map_id: map_id(), ..Default::default() };
    let told = planner.watch_region(region).await.expect_err("nothing to watch");
    assert!(told.message().starts_with("region: is required"), "{told}");
    server.stop().await.0.unwrap();
}
