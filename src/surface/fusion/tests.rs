//! What frames make of flat things.

use crate::config::{MapConfig, MapSettings};
use crate::frame::Frame;
use crate::octree::Topology;
use crate::surface::test_frame::frame;
use crate::surface::{Lattice, Surface};

/// What frames make of the world.
fn integrated(frames: &[Frame]) -> (Surface, Topology) {
    let config = MapConfig::from_settings(&MapSettings::default()).expect("good");
    let lattice = Lattice::new(&config);
    let mut topology = Topology::new(lattice.unit_m, lattice.brick);
    let mut surface = Surface::new(&config);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    for (frame, epoch) in frames.iter().zip(1..) {
        surface.integrate(frame, None, epoch, &mut topology, &pool);
    }
    (surface, topology)
}

/// The greatest error of distances at the vertices in front of a wall, m.
fn worst_in_front_of(wall_m: f32) -> f32 {
    let (surface, topology) = integrated(&[frame(150.0, |_, _| wall_m)]);
    // The camera is at (1, 2, 3) and looks along x; around its axis the wall is the nearest thing.
    let ahead = |at: &glam::Vec3| {
        (at.y - 2.0).abs() < 0.21
            && (at.z - 3.0).abs() < 0.21
            && (1.3..1.0 + wall_m).contains(&at.x)
    };
    let values = topology.positions().iter().zip(surface.prior.values());
    let errors =
        values.filter(|(at, _)| ahead(at)).map(|(at, d)| (d[0] - (1.0 + wall_m - at.x)).abs());
    let (count, worst) = errors.fold((0, 0.0f32), |(n, worst), error| (n + 1, worst.max(error)));
    assert!(count > 50, "{count} vertices in front of {wall_m}");
    worst
}

/// The voxels around a surface fill the voxels above them, or a half of them, as it stands.
#[test]
fn distances_reach_the_camera_wherever_the_wall_stands() {
    for step in 0..20 {
        let wall_m = 1.2 + 0.03 * step as f32;
        let worst = worst_in_front_of(wall_m);
        assert!(worst < 0.02, "{worst} m off before a wall at {wall_m} m");
    }
}

/// A post, 12 cm wide, that stands where frames saw through before: the planes of its surfels go on
/// beside it, and no frame has looked there since.
#[test]
fn beside_a_new_thing_is_free_and_behind_it_is_not() {
    let (wall_m, post_m, half_m) = (2.5, 1.5, 0.06);
    let is_post = |u: u32| ((u as f32 - 79.5) / 150.0 * post_m).abs() < half_m;
    let frames =
        [frame(150.0, |_, _| wall_m), frame(150.0, |u, _| if is_post(u) { post_m } else { 0.0 })];
    let (surface, topology) = integrated(&frames);
    let (mut beside, mut behind) = (0, 0);
    for (at, value) in topology.positions().iter().zip(surface.prior.values()) {
        let (depth, off) = (at.x - 1.0 - post_m, (at.y - 2.0).abs());
        if (at.z - 3.0).abs() > 0.21 || !(0.09..0.16).contains(&depth) {
            continue;
        }
        if off < half_m - 0.01 {
            assert!(value[0] < 0.0, "{at} is behind the post: {}", value[0]);
            behind += 1;
        } else if (0.15..0.25).contains(&off) {
            assert!(value[0] > 0.0, "{at} is beside the post: {}", value[0]);
            beside += 1;
        }
    }
    assert!(beside > 5 && behind > 2, "{beside} beside, {behind} behind");
}
