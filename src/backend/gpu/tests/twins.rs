//! Kernels and their twins on the same inputs.

use super::*;
use crate::backend::gpu::layout::{self, Site};
use crate::modality::losses::Stencil;
use crate::octree::Found;

const VARIANTS: [(Profile, Stencil); 2] =
    [(Profile::Lite, Stencil::Forward), (Profile::Full, Stencil::Central)];

/// A voxel in one word, as shaders have it.
fn packed(found: Found) -> u32 {
    if found.is_some() { found.node << 5 | u32::from(found.log2_size) } else { layout::NONE }
}

/// The lanes' gradients of a decoder's weights, summed.
fn weight_gradients(gpu: &GpuBackend, decoder: &GpuDecoder, weights: usize) -> Vec<f32> {
    let lanes = gpu.gpu.read::<f32>(&decoder.partials, decoder.partials.size() as usize / 4);
    let lanes = lanes.expect("partial sums");
    let mut sum = vec![0.0; weights];
    for lane in lanes.chunks_exact(weights + layout::LOSSES) {
        for (sum, by) in sum.iter_mut().zip(lane) {
            *sum += by;
        }
    }
    sum
}

/// Fails unless every number is near its twin, measured by the largest of them.
fn assert_near(name: &str, found: &[f32], expected: &[f32], tolerance: f32) {
    assert_eq!(found.len(), expected.len(), "{name}");
    let largest = expected.iter().fold(0.0f32, |m, x| m.max(x.abs()));
    assert!(largest > 0.0, "{name} has nothing to compare");
    for (i, (found, expected)) in found.iter().zip(expected).enumerate() {
        let error = (found - expected).abs();
        assert!(error <= tolerance * largest, "{name} {i}: {found}, not {expected} of {largest}");
    }
}

#[test]
fn comparing_can_fail() {
    assert_near("same", &[1.0, 2.0], &[1.0, 2.0001], 1e-3);
    let fails = |found: Vec<f32>| {
        std::panic::catch_unwind(move || assert_near("other", &found, &[1.0, 2.0], 1e-3)).is_err()
    };
    assert!(fails(vec![1.0, 2.1]) && fails(vec![f32::NAN, 2.0]) && fails(vec![1.0]));
}

#[test]
fn samples_are_found_where_the_twin_finds_them() {
    for (profile, stencil) in VARIANTS {
        let tree = twin::mixed_tree(twin::rough_prior);
        let mut batch = twin::rough_batch(500);
        batch.points[7].x = f32::NAN;
        batch.points[8].x = 1e9;
        batch.distances[9] = f32::INFINITY;
        let p = twin::parameters(stencil);
        let mut cpu = twin::rough_backend(profile, 1, tree.rows.len());
        let mut gpu = like(&cpu, profile, &tree);
        gpu.training.reserve(&gpu.gpu, 500).expect("room");
        gpu.gpu.write(&gpu.training.sites.buffer, &vec![0x5a5a_5a5au32; 500 * 8]); // poison
        run(&mut gpu, &tree, &batch, &p, false);
        let expected = twin::found(&mut cpu, &tree, &batch, &p);
        let sites = gpu.gpu.read::<Site>(&gpu.training.sites.buffer, 500).expect("sites");
        let points = stencil.offsets().len();
        for (i, (site, (centre, around))) in sites.iter().zip(&expected.sites).enumerate() {
            assert_eq!(site.centre, packed(*centre), "sample {i}");
            match around {
                None => assert_eq!(site.around[0], layout::NONE, "sample {i}"),
                Some(around) => {
                    let around = around.map(packed);
                    assert_eq!(site.around[..points], around[..points], "sample {i}");
                }
            }
        }
        let counted: u32 =
            gpu.gpu.read::<u32>(&gpu.training.counts, 3).expect("counts").iter().sum();
        assert_eq!(counted as usize, expected.report.samples);
    }
}

#[test]
fn losses_and_gradients_are_those_of_the_twin() {
    for (profile, stencil) in VARIANTS {
        let tree = twin::mixed_tree(twin::rough_prior);
        let batch = twin::rough_batch(500);
        let p = twin::parameters(stencil);
        let mut cpu = twin::rough_backend(profile, 1, tree.rows.len());
        let mut gpu = like(&cpu, profile, &tree);
        run(&mut gpu, &tree, &batch, &p, false);
        let expected = twin::found(&mut cpu, &tree, &batch, &p);
        let rows = tree.rows.len();
        let sums = gpu.gpu.read::<[i32; 28]>(&gpu.rows.gradients.buffer, rows).expect("gradients");
        let flags = gpu.gpu.read::<u32>(&gpu.rows.flags.buffer, rows).expect("flags");
        let scale = 512.0;
        let mut touched = vec![0u32; rows];
        let (mut found_columns, mut expected_columns) =
            ([(); 28].map(|()| vec![]), [(); 28].map(|()| vec![]));
        for (row, columns, occupied) in &expected.rows {
            touched[*row as usize] = if *occupied { 3 } else { 1 };
            for c in 0..28 {
                let units = match c {
                    0..16 => 2048.0,
                    16..24 => 524_288.0,
                    24 => 256.0,
                    _ => 2048.0,
                };
                found_columns[c].push(sums[*row as usize][c] as f32 / (units * scale));
                expected_columns[c].push(columns[c]);
            }
        }
        let flags: Vec<u32> = flags.iter().map(|f| f & 3).collect();
        assert_eq!(flags, touched, "rows that the step touched");
        for c in 0..28 {
            assert_near(&format!("column {c}"), &found_columns[c], &expected_columns[c], 2e-3);
        }
        let expected_weights = &expected.by_sdf_weights;
        let found = weight_gradients(&gpu, &gpu.sdf, expected_weights.len());
        assert_near("sdf decoder", &found, expected_weights, 1e-4);
        let expected_weights = &expected.by_occupancy_weights;
        let occupancy = gpu.occupancy.as_ref().expect("occupancy");
        let found = weight_gradients(&gpu, occupancy, expected_weights.len());
        assert_near("occupancy decoder", &found, expected_weights, 1e-4);
    }
}

#[test]
fn steps_are_those_of_the_twin() {
    for (profile, stencil) in VARIANTS {
        let tree = twin::mixed_tree(twin::rough_prior);
        let batch = twin::rough_batch(500);
        let p = twin::parameters(stencil);
        let mut cpu = twin::rough_backend(profile, 1, tree.rows.len());
        let mut gpu = like(&cpu, profile, &tree);
        for _ in 0..3 {
            run(&mut gpu, &tree, &batch, &p, true);
            let expected = twin::step(&mut cpu, &tree, &batch, &p);
            let found = gpu.report().expect("a report").step;
            assert_eq!((found.samples, found.rows), (expected.samples, expected.rows));
            let expected = expected.losses.named();
            for ((name, found), (_, expected)) in found.losses.named().iter().zip(expected) {
                let error = (found - expected).abs();
                assert!(error <= 1e-4 * (expected.abs() + 1.0), "{name}: {found}, not {expected}");
            }
        }
        assert_eq!(gpu.heard.saturated, 0, "no sum came near the end of its range");
        let (found, expected) = (gpu.export().expect("a state"), cpu.export().expect("a state"));
        // Adam divides a gradient by its own size: where it is a few units of fixed point, rounding
        // shows in the step. Such columns are few, and no step exceeds its rate.
        let columns = |state: &BackendState| -> Vec<f32> {
            state.learned.iter().flat_map(layout::columns).collect()
        };
        let (found_columns, expected_columns) = (columns(&found), columns(&expected));
        let errors = found_columns.iter().zip(&expected_columns).map(|(f, e)| (f - e).abs());
        let errors: Vec<f32> = errors.collect();
        let rounded = errors.iter().filter(|&&e| e > 2e-5).count();
        assert!(rounded * 100 < errors.len(), "{rounded} of {} columns", errors.len());
        assert!(errors.iter().all(|&e| e < 3.0 * p.occupancy_rate), "a step beyond its rate");
        let steps = |state: &BackendState| -> Vec<(u32, u32)> {
            state.moments.iter().map(|m| (m.sdf_steps, m.occupancy_steps)).collect()
        };
        assert_eq!(steps(&found), steps(&expected));
        assert_near("sdf decoder", &found.sdf.weights, &expected.sdf.weights, 1e-3);
        let (o, e) = (&found.occupancy.weights, &expected.occupancy.weights);
        assert_near("occupancy decoder", o, e, 1e-3);
        assert_eq!((found.sdf.steps, found.occupancy.steps), (3, 3));
        // What came back is what is there.
        let mut heard = vec![LearnedRow::default(); tree.rows.len()];
        gpu.read_changed(&mut |row, learned| heard[row as usize] = *learned);
        assert!(heard == found.learned);
        assert_eq!(gpu.decoders().sdf.weights(), &found.sdf.weights[..]);
    }
}
