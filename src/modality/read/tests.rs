//! The read-out against the prior, central differences and itself.

use super::*;
use crate::geometry::random::{pcg4d, unit};
use crate::modality::interpolation::by_column;
use crate::modality::test_tree::Tree;
use crate::modality::{Features, sdf};
use crate::octree::PointGrid;

fn random(stream: u32, i: usize) -> f32 {
    2.0 * unit(pcg4d([21, stream, 0, i as u32])[0]) - 1.0
}

fn decoders(hidden: &[u32]) -> Decoders {
    Decoders {
        sdf: sdf::decoder(hidden, 4).expect("valid widths"),
        occupancy: occupancy::decoder(4).expect("valid widths"),
    }
}

/// 0.8 m in 0.1 m voxels, one octant coarser; a curved prior, features on every second row.
fn tree(features: bool) -> Tree {
    let sphere = |at: Vec3| {
        let g = at.normalize_or(Vec3::X);
        [at.length() - 0.3, g.x, g.y, g.z]
    };
    let split = |min: Vec3, size: f32| size > 0.4 || min.min_element() < 0.0;
    let mut tree = Tree::new(3, 0.1, split, sphere);
    if features {
        for row in (0..tree.rows.len()).step_by(2) {
            let sdf = std::array::from_fn(|j| 0.3 * random(1, row * 16 + j));
            let occupancy = std::array::from_fn(|j| random(2, row * 8 + j));
            tree.rows[row].features = Features::nearest(&sdf, &occupancy);
        }
    }
    tree
}

fn points(count: usize) -> Vec<Vec3> {
    (0..count).map(|i| Vec3::new(random(5, i), random(6, i), random(7, i)) * 0.39).collect()
}

type Columns = (Vec<f32>, Vec<Vec3>, Vec<f32>);

fn read(set: InstructionSet, tree: &Tree, decoders: &Decoders, points: &[Vec3]) -> Columns {
    let n = points.len();
    let mut columns = (vec![0.0; n], vec![Vec3::ZERO; n], vec![0.0; n]);
    let answers = Answers {
        distance: &mut columns.0,
        gradient: &mut columns.1,
        occupancy: &mut columns.2,
        ..Answers::default()
    };
    evaluate_with(set, tree, decoders, points, answers);
    columns
}

#[test]
fn without_features_the_answer_is_exactly_the_prior() {
    let (tree, points) = (tree(false), points(300));
    for set in InstructionSet::available() {
        let (distance, gradient, occupancy) = read(set, &tree, &decoders(&[32]), &points);
        let lookup = Lookup::new(&tree).expect("a tree");
        for (i, point) in points.iter().enumerate() {
            let cell = lookup.find(*point);
            let voxel = lookup.located(cell, *point);
            let offset_m = (*point - voxel.min_m).to_array();
            let place = Place { offset_m, size_m: voxel.size_m };
            let rows = tree.corners(cell.node).map(|row| tree.prior[row as usize]);
            let explicit = by_column(rows.each_ref());
            let (d, g) = place.distance_and_gradient(&place.weights(), &explicit);
            assert!((distance[i] - d).abs() < 1e-6);
            assert!((gradient[i] - Vec3::from(g)).length() < 1e-5);
            let p = occupancy::probability(occupancy::prior_logit(d));
            assert!((occupancy[i] - p).abs() < 1e-5);
        }
    }
}

#[test]
fn the_gradient_is_the_central_difference_of_the_distance() {
    let tree = tree(true);
    for hidden in [&[32][..], &[64, 64]] {
        let decoders = decoders(hidden);
        for set in InstructionSet::available() {
            let points = points(200);
            let (distance, gradient, _) = read(set, &tree, &decoders, &points);
            let step = 5e-4;
            let mut kinks = 0;
            let mut outliers = 0;
            for axis in Vec3::AXES {
                let moved =
                    |by: f32| -> Vec<Vec3> { points.iter().map(|p| *p + axis * by).collect() };
                let low = read(set, &tree, &decoders, &moved(-step)).0;
                let high = read(set, &tree, &decoders, &moved(step)).0;
                for i in 0..points.len() {
                    let (below, above) = (distance[i] - low[i], high[i] - distance[i]);
                    // A relu flips, or a voxel ends, between the two points.
                    if (above - below).abs() > 1e-6 + 4e-3 * above.abs() {
                        kinks += 1;
                        continue;
                    }
                    let expected = (high[i] - low[i]) / (2.0 * step);
                    let error = (gradient[i].dot(axis) - expected).abs();
                    assert!(error < 0.05, "{set:?}: off by {error}");
                    // Two relus that flip on both sides hide from the halves.
                    outliers += usize::from(error > 4e-3);
                }
            }
            assert!(kinks < 200, "{kinks} of 600 steps crossed a kink");
            assert!(outliers < 6, "{outliers} of 600 gradients are off");
        }
    }
}

#[test]
fn instruction_sets_and_batch_sizes_agree() {
    let (tree, points) = (tree(true), points(777));
    let decoders = decoders(&[64, 64]);
    let expected = read(InstructionSet::Portable, &tree, &decoders, &points);
    for set in InstructionSet::available() {
        let found = read(set, &tree, &decoders, &points);
        for i in 0..points.len() {
            assert!((found.0[i] - expected.0[i]).abs() < 1e-5);
            assert!((found.2[i] - expected.2[i]).abs() < 1e-4);
        }
        let flips =
            (0..points.len()).filter(|i| (found.1[*i] - expected.1[*i]).length() > 1e-3).count();
        assert!(flips <= 2, "{flips} gradients differ");
        for (i, point) in points.iter().enumerate().step_by(50) {
            let one = read(set, &tree, &decoders, &[*point]);
            assert_eq!((one.0[0], one.1[0], one.2[0]), (found.0[i], found.1[i], found.2[i]));
        }
    }
}

#[test]
fn points_outside_are_nan_and_columns_may_be_absent() {
    let tree = tree(true);
    let points = [Vec3::splat(5.0), Vec3::ZERO, Vec3::NAN, Vec3::new(0.0, f32::INFINITY, 0.0)];
    let set = InstructionSet::detect();
    let (distance, gradient, occupancy) = read(set, &tree, &decoders(&[32]), &points);
    for i in [0, 2, 3] {
        assert!(distance[i].is_nan() && gradient[i].is_nan() && occupancy[i].is_nan());
    }
    assert!(distance[1].is_finite() && gradient[1].is_finite() && occupancy[1].is_finite());
    let mut alone = [0.0; 4];
    let answers = Answers { occupancy: &mut alone, ..Answers::default() };
    evaluate(&tree, &decoders(&[32]), &points, answers);
    assert_eq!(alone[1], occupancy[1], "the same without the other columns");
}

#[test]
fn regular_points_are_answered_to_the_bit() {
    let tree = tree(true);
    let axis = |stream, count: usize| {
        let mut axis: Vec<f32> = (0..count).map(|i| random(stream, i) * 0.45).collect();
        axis.sort_unstable_by(f32::total_cmp);
        axis
    };
    // Blocks of one point, of some, and of more than a tile holds; some points lie outside.
    for (x, y, z) in [(40, 30, 1), (1, 1, 7), (90, 11, 9)] {
        let axes = [axis(8, x), axis(9, y), axis(10, z)];
        let grid = PointGrid { axes: axes.each_ref().map(Vec::as_slice) };
        let mut points = Vec::new();
        for z in 0..z {
            for y in 0..y {
                points.extend((0..x).map(|x| grid.point([x, y, z])));
            }
        }
        for hidden in [&[32][..], &[64, 64]] {
            let decoders = decoders(hidden);
            for set in InstructionSet::available() {
                let expected = read(set, &tree, &decoders, &points);
                let n = points.len();
                let mut found = (vec![0.0; n], vec![Vec3::ZERO; n], vec![0.0; n]);
                let answers = Answers {
                    distance: &mut found.0,
                    gradient: &mut found.1,
                    occupancy: &mut found.2,
                    ..Answers::default()
                };
                grid::evaluate_grid_with(set, &tree, &decoders, &grid, answers);
                let bits = |of: &Columns| -> Vec<u32> {
                    let gradient = bytemuck::cast_slice(&of.1);
                    of.0.iter().chain(gradient).chain(&of.2).map(|x: &f32| x.to_bits()).collect()
                };
                assert_eq!(bits(&found), bits(&expected), "{set:?}");
            }
        }
    }
}
