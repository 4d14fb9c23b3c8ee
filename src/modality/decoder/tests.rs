//! The decoder against its formulas in double precision.

use super::*;

const POINTS: usize = 16;

/// The decoder written down in double precision, straight from the module's formulas.
fn reference(decoder: &Decoder, weights: &[f32], feature: &[f32], context: f32) -> f64 {
    let shape = decoder.shape;
    let w = |i: usize| f64::from(weights[i]);
    let relu = |x: f64| x.max(0.0);
    let change: Vec<f64> = (0..shape.first)
        .map(|u| {
            let z = w(shape.context_at() + u) * f64::from(context) + w(shape.bias_at() + u);
            let a: f64 =
                (0..shape.inputs).map(|i| w(i * shape.first + u) * f64::from(feature[i])).sum();
            relu(a + z) - relu(z)
        })
        .collect();
    let last: Vec<f64> = if shape.second == 0 {
        change
    } else {
        (0..shape.second)
            .map(|n| {
                let at = shape.second_at() + n;
                relu((0..shape.first).map(|u| w(at + u * shape.second) * change[u]).sum())
            })
            .collect()
    };
    let sum: f64 = last.iter().enumerate().map(|(u, x)| w(shape.output_at() + u) * x).sum();
    f64::from(decoder.scale) * sum
}

fn random(stream: u32, len: usize) -> Vec<f32> {
    (0..len).map(|i| 2.0 * unit(pcg4d([11, stream, 0, i as u32])[0]) - 1.0).collect()
}

fn decoders() -> Vec<Decoder> {
    [(16, vec![32]), (8, vec![32]), (16, vec![64, 64]), (16, vec![16, 48])]
        .iter()
        .map(|(inputs, hidden)| {
            let shape = Shape::new(*inputs, hidden).expect("a valid shape");
            Decoder::new(shape, 0.1, 5, 1)
        })
        .collect()
}

fn inputs(shape: Shape) -> (Vec<f32>, Vec<f32>) {
    let mut features = random(1, POINTS * LINE);
    for row in features.chunks_mut(LINE) {
        row[shape.inputs..].fill(0.0);
    }
    (features, random(2, POINTS))
}

#[test]
fn forward_agrees_with_the_formulas_on_every_set() {
    for decoder in decoders() {
        let (features, contexts) = inputs(decoder.shape);
        for set in InstructionSet::available() {
            let mut out = vec![f32::NAN; POINTS];
            let mut activations = Activations::default();
            decoder.forward(set, &features, &contexts, &mut activations, &mut out);
            for (p, found) in out.iter().enumerate() {
                let feature = &features[p * LINE..];
                let expected = reference(&decoder, decoder.weights(), feature, contexts[p]);
                assert!((f64::from(*found) - expected).abs() < 1e-6, "{set:?} {found}");
            }
        }
    }
}

#[test]
fn no_feature_means_exactly_nothing() {
    for decoder in decoders() {
        let contexts = random(2, POINTS);
        for set in InstructionSet::available() {
            let mut out = vec![f32::NAN; POINTS];
            let features = vec![0.0; POINTS * LINE];
            let mut activations = Activations::default();
            decoder.forward(set, &features, &contexts, &mut activations, &mut out);
            assert_eq!(out, vec![0.0; POINTS]);
            let mut by_features = vec![0.0; POINTS * LINE];
            let gradient = Gradient {
                features: &mut by_features,
                contexts: &mut [0.0; POINTS],
                weights: &mut [],
            };
            let by_out = [1.0; POINTS];
            decoder.backward(set, (&features, &contexts), &by_out, &mut activations, gradient);
            assert!(by_features.iter().any(|g| *g != 0.0), "a dead start");
        }
    }
}

/// A central difference whose two halves agree, in the sense that no relu flipped between.
fn difference(f: impl Fn(f32) -> f64, step: f32) -> Option<f64> {
    let (low, middle, high) = (f(-step), f(0.0), f(step));
    let (below, above) = (middle - low, high - middle);
    let kink = (above - below).abs() > 1e-3 * (above.abs() + below.abs()) + 1e-12;
    (!kink).then(|| (high - low) / (2.0 * f64::from(step)))
}

#[test]
fn backward_is_the_central_difference_of_the_formulas() {
    for decoder in decoders() {
        let shape = decoder.shape;
        let (features, contexts) = inputs(shape);
        let by_out = random(3, POINTS);
        let loss = |weights: &[f32], features: &[f32], contexts: &[f32]| -> f64 {
            (0..POINTS)
                .map(|p| {
                    let feature = &features[p * LINE..];
                    f64::from(by_out[p]) * reference(&decoder, weights, feature, contexts[p])
                })
                .sum()
        };
        for set in InstructionSet::available() {
            let (mut activations, mut out) = (Activations::default(), [0.0; POINTS]);
            decoder.forward(set, &features, &contexts, &mut activations, &mut out);
            let mut by_features = vec![f32::NAN; POINTS * LINE];
            let mut by_contexts = vec![f32::NAN; POINTS];
            let mut by_weights = vec![0.0; shape.weights()];
            let gradient = Gradient {
                features: &mut by_features,
                contexts: &mut by_contexts,
                weights: &mut by_weights,
            };
            let inputs = (&features[..], &contexts[..]);
            decoder.backward(set, inputs, &by_out, &mut activations, gradient);

            let step = 1e-4;
            let bumped = |values: &[f32], at: usize, by: f32| {
                let mut values = values.to_vec();
                values[at] += by;
                values
            };
            let mut kinks = 0;
            let mut check = |name: &str, at: usize, found: f32, expected: Option<f64>| {
                let Some(expected) = expected else {
                    kinks += 1;
                    return;
                };
                let error = (f64::from(found) - expected).abs();
                assert!(
                    error < 1e-5 + 5e-3 * expected.abs(),
                    "{set:?} {shape:?} {name}[{at}]: {found} but {expected}"
                );
            };
            for (at, found) in by_weights.iter().enumerate() {
                let f = |by| loss(&bumped(decoder.weights(), at, by), &features, &contexts);
                check("weights", at, *found, difference(f, step));
            }
            for (at, found) in by_features.iter().enumerate() {
                if at % LINE >= shape.inputs {
                    assert_eq!(*found, 0.0, "padding has no gradient");
                    continue;
                }
                let f = |by| loss(decoder.weights(), &bumped(&features, at, by), &contexts);
                check("features", at, *found, difference(f, step));
            }
            for (at, found) in by_contexts.iter().enumerate() {
                let f = |by| loss(decoder.weights(), &features, &bumped(&contexts, at, by));
                check("contexts", at, *found, difference(f, step));
            }
            assert!(kinks < shape.weights() / 20, "{kinks} steps crossed a kink");
        }
    }
}

#[test]
fn odd_widths_are_refused() {
    for hidden in [vec![], vec![20], vec![0], vec![64, 64, 64], vec![256]] {
        assert!(Shape::new(16, &hidden).is_err(), "{hidden:?}");
    }
}
