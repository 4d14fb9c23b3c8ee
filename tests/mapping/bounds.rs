//! The root grows, the cost of a frame does not, and memory has a limit.

use glam::{DVec3, Vec3};

use orenx::dataset::Dataset;
use orenx::dataset::synthetic::Synthetic;
use orenx::dataset::synthetic::truth::{Region, TruthPoint, points};
use orenx::map::{Fields, Mapper, State};
use orenx::octree::Topology;
use orenx::surface::{Lattice, Surface};

use super::{integrate, lite, state};

fn corridor(length_m: f32, step_m: f64) -> Synthetic {
    Synthetic::corridor(length_m, step_m).with_width(160).with_range(5.0)
}

#[test]
fn a_robot_drives_out_of_the_first_root_and_keeps_what_it_has() {
    let data = corridor(40.0, 0.25);
    let mut mapper = Mapper::new(lite(0)).unwrap();
    let out = 32; // 8.8 m along, all of it within ±12.8 m but for the view ahead
    integrate(&mut mapper, &data, 0..out);
    mapper.publish();
    let early = mapper.state().unwrap();
    let (root, rows) = (early.topology.root.unwrap(), early.topology.vertices.len());
    let vertices = early.topology.vertices.to_vec();
    let values = early.surface.prior.values.to_vec();
    integrate(&mut mapper, &data, out..data.len());
    let view = mapper.publish();
    let late = mapper.state().unwrap();
    assert!(late.topology.root.unwrap().log2_size > root.log2_size, "the root grew");
    assert_eq!(late.topology.vertices[..rows], vertices[..], "rows are never renumbered");
    // The camera sees ahead only: what lies well behind it is as it was, bit for bit.
    let kept = (0..rows).filter(|&row| (vertices[row][0] as f32) * 0.1 < 4.0);
    let kept: Vec<usize> = kept.collect();
    assert!(kept.len() > 1000);
    for row in kept {
        assert_eq!(late.surface.prior.values[row], values[row], "row {row}");
    }
    let frames: Vec<usize> = (0..data.len()).collect();
    let truth = points(&data, &frames, Region::Far { clear_m: 0.1 }, 1000, 4);
    let at: Vec<Vec3> = truth.iter().map(|t| t.point).collect();
    let answers = view.query(&at, Fields::ALL);
    let free = answers.state.iter().filter(|&&s| s == State::Free as u8).count();
    assert!(free > 970, "{free} of 1000 points are free");
    assert!(truth.iter().any(|t| t.point.x > 30.0));
    let error = |(t, d): (&TruthPoint, &f32)| (d - t.distance).abs();
    let known = truth.iter().zip(&answers.distance).filter(|(_, d)| d.is_finite());
    let mean = known.map(error).sum::<f32>() / free as f32;
    assert!(mean < 0.06, "{mean} m");
}

#[test]
fn kilometres_away_is_part_of_the_same_map() {
    let data = Synthetic::room(60).with_width(160);
    let mut mapper = Mapper::new(lite(1)).unwrap();
    let shift = DVec3::new(-3000.0, 2000.0, 50.0);
    for index in 0..3 {
        let mut frame = data.load(index, false).unwrap();
        mapper.integrate(&frame).unwrap();
        frame.world_from_camera.translation += shift;
        mapper.integrate(&frame).unwrap();
    }
    let view = mapper.publish();
    assert_eq!(mapper.stats().voxels_refused, 0);
    let eye = data.pose(0).position_f32();
    let ahead = data.pose(0).rotation_f32() * Vec3::Z * 0.5;
    for shift in [Vec3::ZERO, shift.as_vec3()] {
        assert_eq!(state(&view, eye + ahead + shift), State::Free);
        assert_eq!(state(&view, eye - 3.0 * ahead + shift), State::Unknown, "behind the camera");
    }
    assert_eq!(state(&view, 0.5 * shift.as_vec3()), State::Unknown, "between the two");
}

#[test]
fn a_frame_costs_the_same_however_large_the_map_is() {
    let data = corridor(80.0, 0.25);
    let config = lite(0);
    let lattice = Lattice::new(&config);
    let mut topology = Topology::new(lattice.unit_m, lattice.brick);
    let mut surface = Surface::new(&config);
    let pool = query_pool();
    // Sums of voxels made, rows and bricks changed: over the beginning, and over the end.
    let window = 60;
    let (mut first, mut last) = ([0usize; 3], [0usize; 3]);
    for index in 0..data.len() {
        let frame = data.load(index, false).unwrap();
        let voxels = topology.voxels();
        let change = surface.integrate(&frame, Some(0), index as u32 + 1, &mut topology, &pool);
        let cost = [
            (topology.voxels() - voxels) as usize,
            change.prior.rows.len(),
            change.changed_bricks.len(),
        ];
        let sums = if (20..20 + window).contains(&index) {
            &mut first
        } else if index + window + 8 >= data.len() && index + 8 < data.len() {
            &mut last
        } else {
            continue;
        };
        for (sum, cost) in sums.iter_mut().zip(cost) {
            *sum += cost;
        }
    }
    for (early, late) in first.into_iter().zip(last) {
        let ratio = late as f64 / early as f64;
        assert!((0.7..1.3).contains(&ratio), "{first:?} at first, {last:?} at last");
    }
}

fn query_pool() -> rayon::ThreadPool {
    orenx::map::query_pool(2).unwrap()
}

#[test]
fn at_the_memory_bound_new_voxels_are_refused_and_the_rest_goes_on() {
    const MIB: u32 = 192;
    let data = corridor(50.0, 0.25);
    let mut config = lite(0);
    (config.memory_mib, config.key_frame_mib) = (MIB, 2);
    let mut mapper = Mapper::new(config).unwrap();
    integrate(&mut mapper, &data, 0..12);
    let seen = points(&data, &[0, 1, 2], Region::Far { clear_m: 0.1 }, 400, 4);
    let probes: Vec<Vec3> = seen.iter().map(|t| t.point).filter(|p| p.x < 2.0).collect();
    assert!(probes.len() > 30, "{} probes", probes.len());
    assert_eq!(mapper.stats().voxels_refused, 0);
    let before = mapper.publish().query(&probes, Fields::ALL);
    let mut rows = 0;
    for index in 12..data.len() {
        integrate(&mut mapper, &data, [index]);
        mapper.publish();
        let stats = mapper.stats();
        assert!(stats.map_bytes <= u64::from(MIB) << 20, "{} bytes", stats.map_bytes);
        assert!(stats.rows >= rows, "what was mapped stays");
        rows = stats.rows;
    }
    let stats = mapper.stats();
    assert!(stats.voxels_refused > 100, "{}", stats.voxels_refused);
    assert_eq!(stats.frames, data.len() as u64, "every frame was taken");
    let view = mapper.publish();
    let after = view.query(&probes, Fields::ALL);
    for (i, point) in probes.iter().enumerate() {
        if before.state[i] != State::Unknown as u8 {
            assert_eq!(after.state[i], before.state[i], "{point}");
            let moved = (after.distance[i] - before.distance[i]).abs();
            assert!(moved < 0.1, "{point} moved by {moved} m");
        }
    }
    assert_eq!(state(&view, Vec3::new(45.0, 0.0, 1.2)), State::Unknown, "there was no room");
}

#[test]
fn a_full_map_still_trains_and_is_saved() {
    let data = Synthetic::room(30).with_width(160);
    let mut config = lite(1);
    (config.memory_mib, config.key_frame_mib) = (6, 1);
    config.rays_per_step = 512;
    let mut mapper = Mapper::new(config).unwrap();
    integrate(&mut mapper, &data, 0..30);
    let stats = mapper.stats();
    assert!(stats.voxels_refused > 0 && stats.steps == 30, "{stats:?}");
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map");
    orenx::storage::save(&mut mapper, &path, false).unwrap();
    let mut again = orenx::storage::load(&path).unwrap();
    assert_eq!(again.stats().voxels_refused, stats.voxels_refused);
    integrate(&mut again, &data, 0..2);
}
