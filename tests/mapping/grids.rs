//! Regular points are answered faster than others, and the same.

use glam::Vec3;

use orenx::dataset::synthetic::Synthetic;
use orenx::map::{Fields, GridShape, Mapper, PointAnswers};
use orenx::octree::PointGrid;

use super::{integrate, lite};

/// Numbers by their bits: what is not a number is like itself.
fn bits(answers: &PointAnswers) -> Vec<Vec<u32>> {
    let bits = |numbers: &[f32]| numbers.iter().map(|x| x.to_bits()).collect();
    vec![
        bits(&answers.distance),
        bits(bytemuck::cast_slice(&answers.gradient)),
        bits(&answers.occupancy),
        bits(bytemuck::cast_slice(&answers.color)),
        answers.state.iter().map(|s| u32::from(*s)).collect(),
    ]
}

#[test]
fn a_grid_says_what_its_points_say_to_the_bit() {
    let data = Synthetic::room(60).with_width(96);
    let mut mapper = Mapper::new(lite(4)).unwrap();
    integrate(&mut mapper, &data, (0..60).step_by(6));
    let view = mapper.publish_all().unwrap();
    let bounds = view.bounds();
    // Finer and coarser than voxels, and beyond the map.
    for voxel_m in [0.037, 0.21, 0.9] {
        let mut region = bounds;
        region.min = bounds.min - 0.5;
        region.max = if voxel_m < 0.1 { region.min + 2.0 } else { bounds.max + 0.5 };
        let shape = GridShape::covering(&region, voxel_m);
        let axes = [0, 1, 2].map(|axis| shape.centers_along(axis, 0..shape.size[axis]));
        let grid = PointGrid { axes: axes.each_ref().map(Vec::as_slice) };
        let points: Vec<Vec3> =
            (0..shape.voxels() as usize).map(|index| shape.center_at(index)).collect();
        for fields in [Fields::ALL, Fields::DISTANCE, Fields { state: true, ..Fields::NONE }] {
            let expected = view.query(&points, fields);
            assert_eq!(bits(&view.query_grid(&grid, fields)), bits(&expected), "{voxel_m} m");
            if fields.state {
                assert!(expected.state.contains(&0) && expected.state.contains(&1));
            }
        }
    }
}
