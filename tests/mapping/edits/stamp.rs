//! What is stamped is answered like what was mapped.

use glam::{DQuat, DVec3, Vec3};

use orenx::geometry::{Aabb, Mesh, Pose, Solid};
use orenx::map::{Edit, Fields, Mapper, STAMP_ROBOT, State};
use orenx::storage;
use orenx::surface::Stamping;

use super::{FRAMES, aabb, clear_robot, differ, frame, grid, map_of, refine, room, stamp, upright};
use crate::mapping::{lite, state};

/// Stamped distances against analytic ones within `reach` of the surface; the mean error.
fn check_stamped(mapper: &mut Mapper, around: &Aabb, truth: impl Fn(Vec3) -> f32, reach: f32) {
    let view = mapper.publish_all().unwrap();
    let points: Vec<Vec3> = grid(around, 0.043);
    let answers = view.query(&points, Fields::ALL);
    let (mut sum, mut near, mut signs) = (0.0, 0, 0);
    for (i, point) in points.iter().enumerate() {
        let expected = truth(*point);
        if expected < -0.03 {
            assert_eq!(answers.state[i], State::Occupied as u8, "{point}: {expected}");
        } else if (0.03..0.08).contains(&expected) {
            assert_eq!(answers.state[i], State::Free as u8, "{point}: {expected}");
        }
        if expected.abs() < reach && answers.distance[i].is_finite() {
            near += 1;
            sum += (answers.distance[i] - expected).abs();
            signs += usize::from((answers.distance[i] < 0.0) == (expected < 0.0));
        }
    }
    let mean = sum / near as f32;
    assert!(near > 200 && mean < 0.008, "{mean} m off at {near} points");
    assert!(signs * 100 >= near * 95, "{signs} of {near} signs");
}

fn sdf_box(point: Vec3, half: Vec3) -> f32 {
    let q = point.abs() - half;
    q.max(Vec3::ZERO).length() + q.max_element().min(0.0)
}

#[test]
fn stamped_solids_are_answered_like_mapped_ones_and_survive_a_file() {
    let folder = tempfile::tempdir().unwrap();
    let turned = DQuat::from_rotation_z(0.4);
    let pose = Pose { rotation: turned, translation: DVec3::new(0.3, -0.2, 1.0) };
    let size = Vec3::new(0.8, 0.5, 0.6);
    let local =
        move |p: Vec3| (pose.rotation.inverse() * (p.as_dvec3() - pose.translation)).as_vec3();
    let ball = (Vec3::new(0.1, 0.2, 0.3), 0.45);
    type Truth = Box<dyn Fn(Vec3) -> f32>;
    let cases: [(Solid, Truth); 3] = [
        (
            Solid::Box { world_from_box: pose, size_m: size },
            Box::new(move |p| sdf_box(local(p), 0.5 * size)),
        ),
        (
            Solid::Sphere { center: ball.0, radius_m: ball.1 },
            Box::new(move |p| p.distance(ball.0) - ball.1),
        ),
        (
            Solid::Mesh(box_mesh(Vec3::new(0.2, 0.1, -0.3), size)),
            Box::new(move |p| sdf_box(p - Vec3::new(0.2, 0.1, -0.3), 0.5 * size)),
        ),
    ];
    for (number, (solid, truth)) in cases.into_iter().enumerate() {
        let mut mapper = Mapper::new(lite(1)).unwrap();
        let bounds = solid.bounds();
        let around = Aabb { min: bounds.min - 0.2, max: bounds.max + 0.2 };
        let edited = mapper.edit(&stamp(solid, Stamping::Add)).unwrap();
        assert!(edited.surfels_added > 200 && edited.cells_told > 100, "{edited:?}");
        check_stamped(&mut mapper, &around, &truth, 0.1);
        let path = folder.path().join(format!("{number}.orenx"));
        storage::save(&mut mapper, &path, false).unwrap();
        let mut again = storage::load(&path).unwrap();
        check_stamped(&mut again, &around, &truth, 0.1);
        let gone = again.edit(&clear_robot(STAMP_ROBOT)).unwrap();
        assert_eq!((gone.surfels_removed, again.stats().surfels), (edited.surfels_added, 0));
        let points = grid(&around, 0.07);
        let states = again.publish_all().unwrap().query(&points, Fields::ALL).state;
        assert!(states.iter().all(|s| *s == State::Unknown as u8));
    }
}

fn box_mesh(center: Vec3, size: Vec3) -> Mesh {
    let corner = |i: u32| {
        let side = |axis: u32| (i >> axis & 1) as f32 - 0.5;
        center + Vec3::new(side(0), side(1), side(2)) * size
    };
    let quads =
        [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let triangles = quads.iter().flat_map(|[a, b, c, d]| [[*a, *b, *c], [*a, *c, *d]]).collect();
    Mesh::new((0..8).map(corner).collect(), triangles).unwrap()
}

#[test]
fn a_stamp_stands_among_what_was_seen_and_leaves_it_as_it_was() {
    let mut mapper = map_of((0..FRAMES).map(|i| (i, "a")), 1);
    let before = mapper.publish_all().unwrap();
    let bounds = before.bounds();
    // Free space, high enough above everything.
    let center = Vec3::new(0.0, 0.0, 1.6);
    let size = Vec3::splat(0.4);
    assert_eq!(state(&before, center), State::Free);
    let mut edit = stamp(upright(center.as_dvec3(), size), Stamping::Add);
    if let Edit::Stamp(stamp) = &mut edit {
        stamp.color = Some(Vec3::new(1.0, 0.2, 0.1));
    }
    mapper.edit(&edit).unwrap();
    let around = Aabb { min: center - 0.35, max: center + 0.35 };
    let truth = |p: Vec3| sdf_box(p - center, 0.5 * size);
    check_stamped(&mut mapper, &around, truth, 0.1);
    let stamped = mapper.publish_all().unwrap();
    let top = center + Vec3::new(0.0, 0.0, 0.2);
    let color = stamped.query(&[top], Fields::ALL).color[0];
    assert!(color.distance(Vec3::new(1.0, 0.2, 0.1)) < 0.02, "{color}");
    mapper.edit(&clear_robot(STAMP_ROBOT)).unwrap();
    let after = mapper.publish_all().unwrap();
    let (states, off, known) = differ(&before, &after, &grid(&bounds, 0.093), 0.02);
    assert!(states < 0.002 && off < 0.002, "{states} {off} of {known}");
    assert_eq!(state(&after, center), State::Free, "the robot saw it free");
    mapper.edit(&edit).unwrap();
    refine(&mut mapper);
    check_stamped(&mut mapper, &around, truth, 0.1);
}

#[test]
fn freed_space_is_known_and_free_and_frames_overrule_it() {
    let mut mapper = Mapper::new(lite(0)).unwrap();
    let wall = upright(DVec3::new(1.05, 0.0, 1.0), Vec3::new(0.1, 2.0, 2.0));
    mapper.edit(&stamp(wall, Stamping::Add)).unwrap();
    let inside = upright(DVec3::new(0.0, 0.0, 1.0), Vec3::new(2.0, 2.0, 2.0));
    let freed = mapper.edit(&stamp(inside, Stamping::Free)).unwrap();
    assert_eq!(freed.surfels_removed, 0, "the wall is beside it: {freed:?}");
    assert_eq!(freed.cells_told, 8000);
    let points = grid(&aabb([-0.95, -0.95, 0.05], [0.95, 0.95, 1.95]), 0.1);
    let answers = mapper.publish().query(&points, Fields::ALL);
    for (i, point) in points.iter().enumerate() {
        assert_eq!(answers.state[i], State::Free as u8, "{point}");
        let expected = (1.0 - point.x).min(2.0);
        assert!((answers.distance[i] - expected).abs() < 0.02, "{point}: {}", answers.distance[i]);
    }
    let hole = upright(DVec3::new(1.0, 0.0, 1.0), Vec3::new(0.6, 0.6, 0.6));
    assert!(mapper.edit(&stamp(hole, Stamping::Free)).unwrap().surfels_removed > 50);
    assert_eq!(state(&mapper.publish(), Vec3::new(1.05, 0.0, 1.0)), State::Free);

    // A robot sees that there is more than nothing.
    let data = room();
    let (mut mapper, whole) =
        (Mapper::new(lite(0)).unwrap(), map_of((0..30).map(|i| (i, "a")), 0).publish());
    let everything = whole.bounds();
    let center = (0.5 * (everything.min + everything.max)).as_dvec3();
    mapper.edit(&stamp(upright(center, everything.size() + 0.4), Stamping::Free)).unwrap();
    (0..30).for_each(|i| {
        mapper.integrate(&frame(&data, i, "a")).unwrap();
    });
    let points: Vec<Vec3> = grid(&everything, 0.12);
    let (seen, told) =
        (whole.query(&points, Fields::ALL), mapper.publish().query(&points, Fields::ALL));
    let near = |i: &usize| seen.distance[*i].abs() < 0.05;
    let (mut all, mut same) = (0, 0);
    for i in (0..points.len()).filter(near) {
        all += 1;
        same += usize::from(told.state[i] == seen.state[i]);
    }
    assert!(all > 500 && same * 100 > all * 97, "{same} of {all}");
}
