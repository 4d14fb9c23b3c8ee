//! Every gradient against central differences of the loss.

use super::*;

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

#[test]
fn row_gradients_are_central_differences() {
    for (profile, stencil) in [(Profile::Lite, Stencil::Forward), (Profile::Full, Stencil::Central)]
    {
        let tree = mixed_tree(rough_prior);
        let batch = rough_batch(48);
        let p = parameters(stencil);
        let mut backend = rough_backend(profile, 1, tree.rows.len());
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
        let mut backend = rough_backend(profile, 1, tree.rows.len());
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
        let mut backend = rough_backend(profile, 1, tree.rows.len());
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
    backend.rows.resize(tree.rows.len());
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
    let host = Host { nodes: &tree, prior: &tree.prior };
    let on = backend.accumulate(&host, &batch, &p).expect("a valid batch").losses;
    p.weights.consistency = 0.0;
    let off = backend.accumulate(&host, &batch, &p).expect("a valid batch").losses;
    assert!(on.consistency > 0.04, "{on:?}");
    assert!((on.total - off.total - 100.0 * on.consistency).abs() < 1e-3);
}
