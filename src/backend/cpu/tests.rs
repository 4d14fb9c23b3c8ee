//! The trainer against central differences, a hand-written Adam, itself on other threads and
//! instruction sets, and a scene that the prior cannot hold.

use std::sync::Arc;

use glam::Vec3;
use rayon::ThreadPoolBuilder;

use super::*;
use crate::config::{MapConfig, MapSettings, Profile};
use crate::geometry::random::{pcg4d, unit};
use crate::modality::losses::{LossWeights, Stencil};
use crate::modality::read::{Answers, evaluate};
use crate::modality::test_tree::Tree;
use crate::train::SampleKind;

fn config(profile: Profile) -> MapConfig {
    let settings = MapSettings { profile, seed: 3, ..MapSettings::default() };
    MapConfig::from_settings(&settings).expect("valid settings")
}

fn backend(profile: Profile, threads: usize) -> CpuBackend {
    let pool = ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    CpuBackend::new(&config(profile), Arc::new(pool)).expect("a valid configuration")
}

fn parameters(stencil: Stencil) -> StepParameters {
    StepParameters {
        rate: 1e-3,
        occupancy_rate: 1e-2,
        decoder_rate: 1e-3,
        stencil,
        weights: LossWeights::default(),
    }
}

/// 0.8 m around the origin in 0.1 m voxels, but one octant stays 0.4 m, so that stencils cross
/// between sizes.
fn mixed_tree(field: impl Fn(Vec3) -> [f32; 4]) -> Tree {
    Tree::new(3, 0.1, |min, size| size > 0.4 || min.min_element() < 0.0, field)
}

fn random(stream: u32, i: usize) -> [f32; 4] {
    pcg4d([77, stream, 0, i as u32]).map(|w| 2.0 * unit(w) - 1.0)
}

/// Samples off every kink: labels far from the field, gradients far from unit length.
fn rough_batch(samples: usize) -> Batch {
    let mut batch = Batch::default();
    for i in 0..samples {
        let r = random(1, i);
        batch.points.push(Vec3::new(r[0], r[1], r[2]) * 0.42);
        batch.kinds.push([SampleKind::Free, SampleKind::Perturbed, SampleKind::Surface][i % 3]);
        batch.distances.push(if i % 2 == 0 { 1.5 } else { -1.5 });
        batch.occupancies.push([0.0, 0.75, 1.0][i % 3]);
        batch.eikonal.push(i % 4 != 3);
    }
    batch
}

/// A backend whose rows and decoders are far from zero.
fn rough_backend(profile: Profile, threads: usize, rows: usize) -> CpuBackend {
    let mut backend = backend(profile, threads);
    backend.rows.resize(rows);
    for (i, row) in backend.rows.learned.iter_mut().enumerate() {
        let value = |j: usize| random(2, i * 32 + j)[0];
        row.sdf_feature = std::array::from_fn(value);
        row.occupancy_feature = std::array::from_fn(|j| value(16 + j));
        row.explicit = std::array::from_fn(|j| 0.2 * value(24 + j));
    }
    backend
}

fn rough_prior(at: Vec3) -> [f32; 4] {
    let g = Vec3::new(1.5, -1.2, 0.9);
    [0.02 + 0.3 * g.dot(at), g.x, g.y, g.z]
}

/// (f(+h) − f(−h)) / 2h, or nothing where a relu flipped in between: the two halves, or the same
/// with half the step, say otherwise.
fn difference(mut f: impl FnMut(f32) -> f64, h: f32) -> Option<f64> {
    let (low, middle, high) = (f(-h), f(0.0), f(h));
    let (below, above) = (middle - low, high - middle);
    let slope = (high - low) / (2.0 * f64::from(h));
    let narrow = (f(0.5 * h) - f(-0.5 * h)) / f64::from(h);
    let kink = (above - below).abs() > 0.02 * (above.abs() + below.abs()) + 3e-5
        || (slope - narrow).abs() > 0.01 + 0.01 * slope.abs();
    (!kink).then_some(slope)
}

/// Counts comparisons; steps that crossed a kink are allowed by number, not by tolerance.
#[derive(Default)]
struct Comparison {
    compared: usize,
    not_small: usize,
    kinks: usize,
}

impl Comparison {
    fn check(&mut self, name: &str, found: f32, expected: Option<f64>) {
        let Some(expected) = expected else {
            self.kinks += 1;
            return;
        };
        self.compared += 1;
        self.not_small += usize::from(expected.abs() > 0.1);
        let error = (f64::from(found) - expected).abs();
        assert!(error < 0.02 + 0.02 * expected.abs(), "{name}: {found} but {expected}");
    }

    fn finish(&self) {
        assert!(self.not_small > 20, "only {} gradients were not small", self.not_small);
        assert!(self.kinks * 5 < self.compared, "{} kinks in {}", self.kinks, self.compared);
    }
}

fn loss(backend: &mut CpuBackend, tree: &Tree, batch: &Batch, p: &StepParameters) -> f64 {
    let host = Host { nodes: tree, prior: &tree.explicit };
    backend.accumulate(&host, batch, p).expect("a valid batch").losses.total
}

#[test]
fn row_gradients_are_central_differences() {
    for (profile, stencil) in [(Profile::Lite, Stencil::Forward), (Profile::Full, Stencil::Central)]
    {
        let tree = mixed_tree(rough_prior);
        let batch = rough_batch(48);
        let p = parameters(stencil);
        let mut backend = rough_backend(profile, 1, tree.rows());
        loss(&mut backend, &tree, &batch, &p);
        let gradients = backend.rows.gradients(&backend.outputs);
        let mut comparison = Comparison::default();
        for (row, gradient) in gradients.iter().step_by(17) {
            let at = *row as usize;
            for column in 0..RowMoments::COLUMNS {
                // Occupancy reads d_ga as a constant, so the explicit columns are compared below,
                // with occupancy off.
                if column >= 24 {
                    continue;
                }
                let mut f = |by: f32| {
                    let learned = &mut backend.rows.learned[at];
                    let value = if column < 16 {
                        &mut learned.sdf_feature[column]
                    } else {
                        &mut learned.occupancy_feature[column - 16]
                    };
                    let before = *value;
                    *value += by;
                    let total = loss(&mut backend, &tree, &batch, &p);
                    let learned = &mut backend.rows.learned[at];
                    if column < 16 {
                        learned.sdf_feature[column] = before;
                    } else {
                        learned.occupancy_feature[column - 16] = before;
                    }
                    total
                };
                let expected = difference(&mut f, 2e-3);
                let found = gradient.columns[column];
                comparison.check(&format!("row {row} column {column}"), found, expected);
            }
        }
        comparison.finish();
    }
}

#[test]
fn explicit_gradients_are_central_differences() {
    for (profile, stencil) in [(Profile::Lite, Stencil::Central), (Profile::Full, Stencil::Forward)]
    {
        let tree = mixed_tree(rough_prior);
        let batch = rough_batch(48);
        let p = parameters(stencil);
        let mut backend = rough_backend(profile, 1, tree.rows());
        backend.train_occupancy = false;
        loss(&mut backend, &tree, &batch, &p);
        let gradients = backend.rows.gradients(&backend.outputs);
        let mut comparison = Comparison::default();
        for (row, gradient) in gradients.iter().step_by(5) {
            for column in 0..4 {
                let f = |by: f32| {
                    let before = backend.rows.learned[*row as usize];
                    backend.rows.learned[*row as usize].explicit[column] += by;
                    let total = loss(&mut backend, &tree, &batch, &p);
                    backend.rows.learned[*row as usize] = before;
                    total
                };
                let expected = difference(f, 1e-3);
                let found = gradient.columns[24 + column];
                comparison.check(&format!("row {row} explicit {column}"), found, expected);
            }
        }
        comparison.finish();
    }
}

#[test]
fn decoder_gradients_are_central_differences() {
    for (profile, stencil) in [(Profile::Lite, Stencil::Forward), (Profile::Full, Stencil::Central)]
    {
        let tree = mixed_tree(rough_prior);
        let batch = rough_batch(48);
        let p = parameters(stencil);
        let mut backend = rough_backend(profile, 1, tree.rows());
        loss(&mut backend, &tree, &batch, &p);
        for sdf in [true, false] {
            let memory = if sdf { &backend.sdf_memory } else { &backend.occupancy_memory };
            let gradient = memory.gradient.clone();
            let mut comparison = Comparison::default();
            for at in (0..gradient.len()).step_by(if profile == Profile::Full { 61 } else { 7 }) {
                let f = |by: f32| {
                    let before = backend.decoders.clone();
                    let decoders = Arc::make_mut(&mut backend.decoders);
                    let decoder = if sdf { &mut decoders.sdf } else { &mut decoders.occupancy };
                    decoder.update(|weights| weights[at] += by);
                    let total = loss(&mut backend, &tree, &batch, &p);
                    backend.decoders = before;
                    total
                };
                let expected = difference(f, 2e-3);
                comparison.check(&format!("sdf {sdf} weight {at}"), gradient[at], expected);
            }
            if sdf {
                comparison.finish();
            }
        }
    }
}

#[test]
fn confident_occupancy_teaches_the_sign_and_only_when_it_is_switched_on() {
    let tree = mixed_tree(|_| [0.05, 0.0, 0.0, 0.0]);
    let mut batch = rough_batch(12);
    batch.eikonal.fill(false);
    let mut backend = backend(Profile::Lite, 1);
    backend.rows.resize(tree.rows());
    // A positive distance under a logit that says occupied with confidence.
    let feature = {
        let decoder = &backend.decoders.occupancy;
        let candidates = (0..64).map(|i| std::array::from_fn(|j| 20.0 * random(9, i * 8 + j)[0]));
        let logit = |feature: &[f32; 8]| {
            let mut row = [0.0; 8 * 16];
            row[..8].copy_from_slice(feature);
            let mut out = [0.0; 8];
            let mut activations = crate::modality::decoder::Activations::default();
            let contexts = [0.05; 8];
            decoder.forward(backend.set, &row, &contexts, &mut activations, &mut out);
            out[0]
        };
        candidates.max_by(|a, b| logit(a).total_cmp(&logit(b))).expect("candidates")
    };
    for row in &mut backend.rows.learned {
        row.occupancy_feature = feature;
    }
    let mut p = parameters(Stencil::Forward);
    let host = Host { nodes: &tree, prior: &tree.explicit };
    let on = backend.accumulate(&host, &batch, &p).expect("a valid batch").losses;
    p.weights.consistency = 0.0;
    let off = backend.accumulate(&host, &batch, &p).expect("a valid batch").losses;
    assert!(on.consistency > 0.04, "{on:?}");
    assert!((on.total - off.total - 100.0 * on.consistency).abs() < 1e-3);
}

#[test]
fn every_row_follows_adam_with_its_own_step_count() {
    let tree = mixed_tree(rough_prior);
    let p = parameters(Stencil::Forward);
    let mut backend = rough_backend(Profile::Lite, 2, tree.rows());
    let host = Host { nodes: &tree, prior: &tree.explicit };
    type Reference = ([f64; 28], [f64; 28], [u32; 2]);
    let mut reference: Vec<Reference> = vec![([0.0; 28], [0.0; 28], [0; 2]); tree.rows()];
    for round in 0..4 {
        // Every round sees another part of the tree.
        let mut batch = rough_batch(24);
        for point in &mut batch.points {
            *point = *point * 0.3 + Vec3::new(0.1 * round as f32 - 0.2, -0.1, -0.1);
        }
        let before = backend.rows.learned.clone();
        backend.accumulate(&host, &batch, &p).expect("a valid batch");
        let gradients = backend.rows.gradients(&backend.outputs);
        let report = backend.step(&host, &batch, &p).expect("a valid batch");
        assert_eq!(report.rows, gradients.len());
        let mut touched = vec![false; tree.rows()];
        for (row, gradient) in &gradients {
            let row = *row as usize;
            touched[row] = true;
            let (m, v, t) = &mut reference[row];
            t[0] += 1;
            t[1] += u32::from(gradient.occupied);
            for column in 0..28 {
                let occupancy = (16..24).contains(&column);
                if occupancy && !gradient.occupied {
                    continue;
                }
                let (t, rate) = if occupancy { (t[1], 1e-2) } else { (t[0], 1e-3) };
                let g = f64::from(gradient.columns[column]);
                m[column] = 0.9 * m[column] + 0.1 * g;
                v[column] = 0.999 * v[column] + 0.001 * g * g;
                let m_hat = m[column] / (1.0 - 0.9f64.powi(t as i32));
                let v_hat = v[column] / (1.0 - 0.999f64.powi(t as i32));
                let by = rate * m_hat / (v_hat.sqrt() + 1e-8);
                let value = |row: &LearnedRow| match column {
                    0..16 => row.sdf_feature[column],
                    16..24 => row.occupancy_feature[column - 16],
                    _ => row.explicit[column - 24],
                };
                let found = value(&backend.rows.learned[row]) - value(&before[row]);
                assert!(
                    (f64::from(found) + by).abs() < 1e-6 + 1e-3 * rate,
                    "round {round} row {row} column {column}: {found} but {}",
                    -by
                );
            }
            assert_eq!(backend.rows.moments[row].sdf_steps, t[0]);
            assert_eq!(backend.rows.moments[row].occupancy_steps, t[1]);
        }
        for row in (0..tree.rows()).filter(|row| !touched[*row]) {
            assert_eq!(backend.rows.learned[row], before[row], "an untouched row moved");
        }
    }
    let counts: Vec<u32> = reference.iter().map(|r| r.2[0]).collect();
    assert!(counts.contains(&1) && counts.contains(&4), "the rounds overlap in part");
}

/// Samples of a field around its surface, labelled by it.
fn samples_of(field: impl Fn(Vec3) -> f32, count: usize, round: u32) -> Batch {
    let mut batch = Batch::default();
    let mut i = 0;
    while batch.points.len() < count {
        let words = pcg4d([5, 6, round, i]);
        let more = pcg4d([5, 7, round, i]);
        i += 1;
        let point = Vec3::new(unit(words[0]), unit(words[1]), unit(words[2])) * 0.76 - 0.38;
        let distance = field(point);
        let kind = match words[3] % 4 {
            0 => SampleKind::Free,
            3 => SampleKind::Surface,
            _ => SampleKind::Perturbed,
        };
        let reach = if kind == SampleKind::Free { 0.3 } else { 0.06 };
        if distance.abs() > reach || (kind == SampleKind::Free && distance < 0.0) {
            continue;
        }
        batch.points.push(point);
        batch.kinds.push(kind);
        batch.distances.push(distance);
        batch.occupancies.push(if distance > 0.01 {
            0.0
        } else if distance < -0.01 {
            1.0
        } else {
            0.75
        });
        batch.eikonal.push(unit(more[0]) < 0.25);
    }
    batch
}

/// Signed distance of a box of 0.23 m half width, whose edges fall between the vertices.
fn box_distance(at: Vec3) -> f32 {
    let q = at.abs() - Vec3::splat(0.23);
    q.max(Vec3::ZERO).length() + q.max_element().min(0.0)
}

fn box_prior(at: Vec3) -> [f32; 4] {
    let step = 1e-3;
    let g = [Vec3::X, Vec3::Y, Vec3::Z]
        .map(|e| (box_distance(at + e * step) - box_distance(at - e * step)) / (2.0 * step));
    [box_distance(at), g[0], g[1], g[2]]
}

#[test]
fn a_step_has_the_same_bits_on_any_number_of_threads() {
    for (profile, stencil) in [(Profile::Lite, Stencil::Forward), (Profile::Full, Stencil::Central)]
    {
        let tree = mixed_tree(box_prior);
        let run = |threads: usize| {
            let mut backend = backend(profile, threads);
            backend.rows.resize(tree.rows());
            let host = Host { nodes: &tree, prior: &tree.explicit };
            let mut losses = Vec::new();
            for round in 0..4 {
                let batch = samples_of(box_distance, 1500, round);
                let report = backend.step(&host, &batch, &parameters(stencil)).expect("valid");
                losses.push(report.losses);
            }
            (losses, Backend::<Tree>::export(&backend))
        };
        let one = run(1);
        assert!(one.1.learned.iter().any(|row| row.sdf_feature[0] != 0.0));
        assert!(one == run(2), "{profile:?}: 2 threads differ");
        assert!(one == run(3), "{profile:?}: 3 threads differ");
    }
}

#[test]
fn instruction_sets_agree_by_value() {
    let tree = mixed_tree(rough_prior);
    for profile in [Profile::Lite, Profile::Full] {
        let batch = rough_batch(700);
        let p = parameters(Stencil::Central);
        let mut results = Vec::new();
        for set in InstructionSet::available() {
            let mut backend = rough_backend(profile, 1, tree.rows());
            backend.set = set;
            let total = loss(&mut backend, &tree, &batch, &p);
            results.push((total, backend.rows.gradients(&backend.outputs)));
        }
        let (total, rows) = &results[0];
        for (other_total, other_rows) in &results[1..] {
            assert!((total - other_total).abs() < 1e-4 * total);
            assert_eq!(rows.len(), other_rows.len());
            // A relu at its kink may flip between two correct sets: few rows, by number.
            let differ = |a: &[f32], b: &[f32]| {
                a.iter().zip(b).any(|(a, b)| (a - b).abs() > 1e-3 + 1e-3 * a.abs())
            };
            let pairs = rows.iter().zip(other_rows);
            let flipped =
                pairs.filter(|(a, b)| a.0 != b.0 || differ(&a.1.columns, &b.1.columns)).count();
            assert!(flipped <= rows.len() / 50, "{flipped} of {} rows differ", rows.len());
        }
    }
}

#[test]
fn a_state_resumes_bit_for_bit() {
    let tree = mixed_tree(box_prior);
    let host = Host { nodes: &tree, prior: &tree.explicit };
    let p = parameters(Stencil::Forward);
    let batch = |round| samples_of(box_distance, 600, round);
    let mut first = backend(Profile::Lite, 2);
    first.rows.resize(tree.rows());
    for round in 0..3 {
        first.step(&host, &batch(round), &p).expect("a valid batch");
    }
    let state = Backend::<Tree>::export(&first);
    let mut second = backend(Profile::Lite, 1);
    Backend::<Tree>::import(&mut second, state.clone()).expect("a state of this shape");
    for round in 3..6 {
        let a = first.step(&host, &batch(round), &p).expect("a valid batch");
        let b = second.step(&host, &batch(round), &p).expect("a valid batch");
        assert_eq!(a, b);
    }
    assert!(Backend::<Tree>::export(&first) == Backend::<Tree>::export(&second));

    let mut full = backend(Profile::Full, 1);
    let refused = Backend::<Tree>::import(&mut full, state);
    assert!(refused.is_err(), "weights of another shape");
}

#[test]
fn changed_rows_are_read_once_and_reset_rows_are_zero() {
    let tree = mixed_tree(box_prior);
    let host = Host { nodes: &tree, prior: &tree.explicit };
    let mut backend = backend(Profile::Lite, 1);
    backend.rows.resize(tree.rows());
    let batch = samples_of(box_distance, 300, 0);
    let report = backend.step(&host, &batch, &parameters(Stencil::Forward)).expect("valid");
    let read = |backend: &mut CpuBackend| {
        let mut rows = Vec::new();
        Backend::<Tree>::read_changed(backend, &mut |row, values| rows.push((row, *values)));
        rows
    };
    let rows = read(&mut backend);
    assert_eq!(rows.len(), report.rows);
    assert!(rows.is_sorted_by_key(|(row, _)| *row));
    assert!(read(&mut backend).is_empty());
    let some: Vec<u32> = rows.iter().take(5).map(|(row, _)| *row).collect();
    Backend::<Tree>::reset(&mut backend, &some);
    // Growth keeps what is there.
    Backend::<Tree>::resize(&mut backend, tree.rows() * 2);
    let after = read(&mut backend);
    assert_eq!(after.iter().map(|(row, _)| *row).collect::<Vec<_>>(), some);
    assert!(after.iter().all(|(_, values)| *values == LearnedRow::default()));
    assert!(some.iter().all(|row| backend.rows.moments[*row as usize] == RowMoments::ZERO));
    let kept = rows[5];
    assert_eq!(backend.rows.learned[kept.0 as usize], kept.1);
}

#[test]
fn samples_outside_or_without_a_label_are_left_out() {
    let tree = mixed_tree(box_prior);
    let host = Host { nodes: &tree, prior: &tree.explicit };
    let mut backend = backend(Profile::Lite, 1);
    let mut batch = samples_of(box_distance, 10, 0);
    // The first sample's stencil leaves the tree; the others lack something altogether.
    batch.points[0] = Vec3::new(0.39, 0.0, 0.0);
    batch.eikonal.fill(true);
    batch.points[1] = Vec3::splat(9.0);
    batch.points[2] = Vec3::NAN;
    batch.distances[3] = f32::NAN;
    batch.occupancies[4] = f32::INFINITY;
    let p = parameters(Stencil::Central);
    // Without rows nothing can be located.
    assert_eq!(backend.step(&host, &batch, &p).expect("valid").samples, 0);
    backend.rows.resize(tree.rows());
    assert_eq!(backend.step(&host, &batch, &p).expect("valid").samples, 6);
    assert!(!backend.plan.sites[0].eikonal && backend.plan.sites[0].centre.is_some());
    assert!(backend.rows.learned.iter().all(|row| row.explicit.iter().all(|x| x.is_finite())));

    batch.kinds.pop();
    assert!(backend.step(&host, &batch, &p).is_err(), "columns of different lengths");
    batch.kinds.push(SampleKind::Free);
    let short = Host { nodes: &tree, prior: &tree.explicit[1..] };
    assert!(backend.step(&short, &batch, &p).is_err(), "fewer priors than rows");
}

/// Mean |f − truth| of the trained field near the box, m.
fn error_of(tree: &mut Tree, prior: &[[f32; 4]], backend: &mut CpuBackend) -> f64 {
    Backend::<Tree>::read_changed(backend, &mut |row, values| {
        let row = row as usize;
        tree.explicit[row] = std::array::from_fn(|c| prior[row][c] + values.explicit[c]);
        tree.sdf_features[row].0 = values.sdf_feature;
        tree.occupancy_features[row] = values.occupancy_feature;
    });
    let test = samples_of(box_distance, 4000, 999);
    let mut found = vec![0.0; test.points.len()];
    let decoders = Backend::<Tree>::decoders(backend);
    let answers = Answers { distance: &mut found, ..Answers::default() };
    evaluate(tree, &decoders, &test.points, answers);
    let errors = found.iter().zip(&test.distances).map(|(f, y)| f64::from((f - y).abs()));
    errors.sum::<f64>() / found.len() as f64
}

#[test]
fn training_beats_the_closed_form_at_a_box_edge() {
    for (profile, stencil) in [(Profile::Lite, Stencil::Forward), (Profile::Full, Stencil::Central)]
    {
        let mut tree = Tree::new(3, 0.1, |_, _| true, box_prior);
        let prior = tree.explicit.clone();
        let mut backend = backend(profile, 2);
        backend.rows.resize(tree.rows());
        let before = error_of(&mut tree, &prior, &mut backend);
        let mut errors = Vec::new();
        for round in 0..60 {
            let host = Host { nodes: &tree, prior: &prior };
            let batch = samples_of(box_distance, 2000, round);
            backend.step(&host, &batch, &parameters(stencil)).expect("a valid batch");
            if round % 20 == 19 {
                errors.push(error_of(&mut tree, &prior, &mut backend));
            }
        }
        println!("{profile:?}: {before:.5} -> {errors:.5?} m");
        assert!(errors[0] < 0.9 * before && errors[2] < 0.7 * before, "{before} {errors:?}");
    }
}

#[test]
fn the_paper_start_learns_a_sphere_from_zero() {
    let sphere = |at: Vec3| at.length() - 0.25;
    let mut tree = Tree::new(3, 0.1, |_, _| true, |_| [0.0; 4]);
    let prior = tree.explicit.clone();
    let mut backend = backend(Profile::Lite, 2);
    backend.rows.resize(tree.rows());
    let p = StepParameters { rate: 5e-3, ..parameters(Stencil::Central) };
    for round in 0..150 {
        let host = Host { nodes: &tree, prior: &prior };
        let report = backend.step(&host, &samples_of(sphere, 2000, round), &p).expect("valid");
        assert!(report.losses.total.is_finite());
    }
    Backend::<Tree>::read_changed(&mut backend, &mut |row, values| {
        tree.explicit[row as usize] = values.explicit;
        tree.sdf_features[row as usize].0 = values.sdf_feature;
        tree.occupancy_features[row as usize] = values.occupancy_feature;
    });
    let test = samples_of(sphere, 2000, 999);
    let count = test.points.len();
    let (mut distance, mut occupancy) = (vec![0.0; count], vec![0.0; count]);
    let decoders = Backend::<Tree>::decoders(&backend);
    let answers =
        Answers { distance: &mut distance, occupancy: &mut occupancy, ..Answers::default() };
    evaluate(&tree, &decoders, &test.points, answers);
    let error: f32 = distance.iter().zip(&test.distances).map(|(f, y)| (f - y).abs()).sum();
    assert!(error / (count as f32) < 0.008, "mean error {} m", error / count as f32);
    let far = |i: &usize| test.distances[*i].abs() > 0.02;
    let right =
        (0..count).filter(far).filter(|i| (occupancy[*i] > 0.5) == (test.distances[*i] < 0.0));
    let share = right.count() as f32 / (0..count).filter(far).count() as f32;
    assert!(share > 0.9, "occupancy is right at {share}");
}

#[test]
fn the_trainer_and_the_read_out_evaluate_the_same_field() {
    let mut tree = mixed_tree(rough_prior);
    for profile in [Profile::Lite, Profile::Full] {
        let mut backend = rough_backend(profile, 1, tree.rows());
        let prior: Vec<[f32; 4]> = tree.positions.iter().map(|at| rough_prior(*at)).collect();
        for (row, learned) in backend.rows.learned.iter().enumerate() {
            tree.explicit[row] = std::array::from_fn(|c| prior[row][c] + learned.explicit[c]);
            tree.sdf_features[row].0 = learned.sdf_feature;
        }
        let mut batch = rough_batch(100);
        let decoders = Backend::<Tree>::decoders(&backend);
        let answers = Answers { distance: &mut batch.distances, ..Answers::default() };
        evaluate(&tree, &decoders, &batch.points, answers);
        let host = Host { nodes: &tree, prior: &prior };
        let losses = backend
            .accumulate(&host, &batch, &parameters(Stencil::Forward))
            .expect("a valid batch")
            .losses;
        for loss in [losses.projection, losses.perturbation, losses.boundary] {
            assert!(loss < 1e-6, "{losses:?}");
        }
    }
}
