//! What one frame makes of a flat wall, wherever it stands in the lattice.

use crate::config::{MapConfig, MapSettings};
use crate::octree::Topology;
use crate::surface::test_frame::frame;
use crate::surface::{Lattice, Surface};

/// The greatest error of distances at the vertices in front of a wall, m.
fn worst_in_front_of(wall_m: f32) -> f32 {
    let config = MapConfig::from_settings(&MapSettings::default()).expect("good");
    let lattice = Lattice::new(&config);
    let mut topology = Topology::new(lattice.unit_m, lattice.brick);
    let mut surface = Surface::new(&config);
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
    surface.integrate(&frame(150.0, |_, _| wall_m), None, 1, &mut topology, &pool);
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
