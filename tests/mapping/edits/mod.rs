//! A map changed by hand: what was seen is forgotten, known geometry is put in.

mod clear;
mod stamp;

use std::time::Duration;

use glam::{DVec3, Vec3};

use orenx::dataset::Dataset;
use orenx::dataset::synthetic::Synthetic;
use orenx::frame::Frame;
use orenx::geometry::{Aabb, Mesh, Pose, Region, Solid};
use orenx::map::{Clear, Edit, Fields, MapView, Mapper, STAMP_ROBOT, Stamp};
use orenx::storage;
use orenx::surface::Stamping;

use super::lite;

const FRAMES: usize = 60;

fn frame(data: &Synthetic, index: usize, robot: &str) -> Frame {
    let mut frame = data.load(index, true).unwrap();
    frame.robot_id = robot.into();
    frame
}

fn room() -> Synthetic {
    Synthetic::room(FRAMES).with_width(160)
}

/// A map of the frames of some robots, in their order.
fn map_of(frames: impl IntoIterator<Item = (usize, &'static str)>, steps: u32) -> Mapper {
    let (mut mapper, data) = (Mapper::new(lite(steps)).unwrap(), room());
    for (index, robot) in frames {
        mapper.integrate(&frame(&data, index, robot)).unwrap();
    }
    mapper
}

fn aabb(min: [f32; 3], max: [f32; 3]) -> Aabb {
    Aabb { min: min.into(), max: max.into() }
}

fn clear(clear: Clear) -> Edit {
    Edit::Clear(clear)
}

fn clear_robot(robot: &str) -> Edit {
    clear(Clear { robot_id: Some(robot.into()), ..Clear::default() })
}

fn clear_region(region: Region) -> Edit {
    clear(Clear { region: Some(region), ..Clear::default() })
}

fn stamp(solid: Solid, stamping: Stamping) -> Edit {
    Edit::Stamp(Stamp { solid, stamping, color: None, robot_id: STAMP_ROBOT.into() })
}

fn upright(center: DVec3, size_m: Vec3) -> Solid {
    let world_from_box = Pose { translation: center, ..Pose::IDENTITY };
    Solid::Box { world_from_box, size_m }
}

/// Points on a grid of `step` within a box.
fn grid(within: &Aabb, step: f32) -> Vec<Vec3> {
    let count = (within.size() / step).floor().as_ivec3() + 1;
    let mut points = Vec::new();
    for z in 0..count.z {
        for y in 0..count.y {
            let row =
                (0..count.x).map(|x| within.min + Vec3::new(x as f32, y as f32, z as f32) * step);
            points.extend(row);
        }
    }
    points
}

fn refine(mapper: &mut Mapper) {
    while mapper.refine(Duration::from_millis(20)).unwrap() {}
    mapper.finish().unwrap();
}

/// Where two views disagree: shares of the points whose state differs, and of those that both know
/// with distances that differ by more than `limit`; and how many both know.
fn differ(a: &MapView, b: &MapView, points: &[Vec3], limit: f32) -> (f32, f32, usize) {
    let (a, b) = (a.query(points, Fields::ALL), b.query(points, Fields::ALL));
    let states = a.state.iter().zip(&b.state).filter(|(a, b)| a != b).count();
    let both = |(a, b): &(&f32, &f32)| a.is_finite() && b.is_finite();
    let known: Vec<_> = a.distance.iter().zip(&b.distance).filter(both).collect();
    let off = known.iter().filter(|(a, b)| (**a - **b).abs() > limit).count();
    let share = |n: usize, of: usize| n as f32 / of.max(1) as f32;
    (share(states, points.len()), share(off, known.len()), known.len())
}

#[test]
fn edits_go_on_from_a_file_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    let data = room();
    let edits = [
        stamp(upright(DVec3::new(0.0, 0.0, 1.6), Vec3::splat(0.3)), Stamping::Add),
        clear_region(Region::Sphere { center: Vec3::new(0.5, 0.5, 0.5), radius_m: 0.8 }),
        clear_robot("b"),
    ];
    let run = |stops: bool, name: &str| {
        let mut mapper = map_of((0..12).map(|i| (i, ["a", "b"][i % 2])), 1);
        for (i, edit) in edits.iter().enumerate() {
            mapper.edit(edit).unwrap();
            if stops {
                let path = folder.path().join("between.orenx");
                storage::save(&mut mapper, &path, false).unwrap();
                mapper = storage::load(&path).unwrap();
            }
            mapper.integrate(&frame(&data, 20 + i, ["b", "c", "a"][i])).unwrap();
        }
        mapper.publish_all().unwrap();
        let path = folder.path().join(name);
        storage::save(&mut mapper, &path, false).unwrap();
        std::fs::read(path).unwrap()
    };
    assert!(run(false, "a") == run(true, "b"));
}

/// Files from before it was known who saw what open, and one robot's part can be taken back.
#[test]
fn a_file_from_before_there_were_witnesses_opens() {
    let path = std::path::Path::new("tests/data/maps/before-witnesses.bin");
    let mut mapper = storage::load(path).unwrap();
    let point = Vec3::new(0.5, 0.4, 0.4);
    let answers = mapper.publish().query(&[point], Fields::ALL);
    assert!((answers.distance[0] - 0.2002).abs() < 1e-4, "{}", answers.distance[0]);
    let surfels = mapper.stats().surfels;
    let folder = tempfile::tempdir().unwrap();
    let again = folder.path().join("again.orenx");
    storage::save(&mut mapper, &again, false).unwrap();
    assert_eq!(storage::load(&again).unwrap().stats().surfels, surfels);
    let newest = mapper.publish().newest_stamp_ns();
    let old = clear(Clear { older_than_ns: Some(newest), ..Clear::default() });
    assert_eq!(mapper.edit(&old).unwrap().surfels_removed, 0, "it does not say when");
    let edited = mapper.edit(&clear_robot("recording")).unwrap();
    assert!(surfels > 50 && edited.surfels_removed == surfels, "{edited:?} of {surfels}");
}

#[test]
fn what_no_map_could_do_is_refused_by_name() {
    let mut mapper = Mapper::new(lite(0)).unwrap();
    let sphere = |radius_m| Region::Sphere { center: Vec3::ZERO, radius_m };
    let open = Mesh::new(vec![Vec3::ZERO, Vec3::X, Vec3::Y], vec![[0, 1, 2]]).unwrap();
    let mut colored = stamp(upright(DVec3::ZERO, Vec3::ONE), Stamping::Add);
    if let Edit::Stamp(stamp) = &mut colored {
        stamp.color = Some(Vec3::new(0.0, 2.0, 0.0));
    }
    for (edit, field) in [
        (clear(Clear::default()), "clear: one of box, sphere, robot_id"),
        (clear_region(Region::Box(aabb([0.0; 3], [1.0, -1.0, 1.0]))), "box.max: "),
        (clear_region(Region::Box(aabb([f32::NAN; 3], [1.0; 3]))), "box.min: "),
        (clear_region(sphere(0.0)), "sphere.radius_m: "),
        (clear_robot(""), "robot_id: "),
        (clear_robot("nobody"), "robot_id: robot 'nobody'"),
        (stamp(upright(DVec3::ZERO, Vec3::new(1.0, 0.0, 1.0)), Stamping::Add), "box.size_m: "),
        (stamp(upright(DVec3::splat(1e6), Vec3::ONE), Stamping::Add), "box.world_from_box."),
        (stamp(upright(DVec3::ZERO, Vec3::splat(300.0)), Stamping::Add), "geometry: "),
        (stamp(Solid::Mesh(open), Stamping::Free), "mesh.triangles: must be closed"),
        (colored, "color: "),
    ] {
        let error = mapper.edit(&edit).expect_err(field).to_string();
        assert!(error.starts_with(field), "{error}");
    }
    assert_eq!(
        mapper.edit(&stamp(upright(DVec3::ZERO, Vec3::ONE), Stamping::Add)).unwrap().epoch,
        1
    );
}
