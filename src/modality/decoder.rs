//! The zero-anchored decoder: a small MLP that is exactly nothing where nothing was learned.
//!
//! With a feature row f (16 numbers, of which the first `inputs` count) and a context c:
//!
//! ```text
//! z  = w_c·c + b                      what the first layer says without a feature
//! Δ  = relu(W1·f + z) − relu(z)       what the feature changes; 0 for f = 0
//! D  = s · w·Δ                        one hidden layer
//! D  = s · w·relu(W2·Δ)               two hidden layers, no bias
//! ```
//!
//! This deviates from the paper's D(d_ga, f): anchored at f = 0 in one pass, it leaves a vertex
//! that was never trained at its closed-form prior. The derivative of the second relu at exactly
//! 0 counts as 1, so that f = 0 is not a dead start.

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
use crate::geometry::matmul::{Left, multiply};
use crate::geometry::random::{normal, pcg4d, unit};
use crate::geometry::simd::{InstructionSet, Kernel, LINE, Lanes, Lines};

/// Widest hidden layer.
pub const MAX_HIDDEN: usize = 128;
/// Points per call are padded to a multiple of this (rows of a register tile).
pub(crate) const POINTS_MULTIPLE: usize = 8;

/// Sizes of a decoder.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct Shape {
    /// How many numbers of a feature row count, at most 16.
    pub inputs: usize,
    /// Width of the first hidden layer.
    pub first: usize,
    /// Width of the second hidden layer; 0 without one.
    pub second: usize,
}

impl Shape {
    /// Checks what a configuration says: one or two layers, each a multiple of 16 up to 128.
    pub fn new(inputs: usize, hidden: &[u32]) -> Result<Self> {
        let fits =
            |width: &u32| *width as usize <= MAX_HIDDEN && *width > 0 && width.is_multiple_of(16);
        if !(1..=2).contains(&hidden.len()) || !hidden.iter().all(fits) {
            return Err(Error::invalid(
                "hidden",
                format!("{hidden:?} must be one or two widths, multiples of 16 up to {MAX_HIDDEN}"),
            ));
        }
        let second = hidden.get(1).map_or(0, |w| *w as usize);
        Ok(Self { inputs: inputs.min(LINE), first: hidden[0] as usize, second })
    }

    /// Number of weights: W1 (input-major), w_c, b, W2 (first-major), w.
    pub fn weights(&self) -> usize {
        self.output_at() + self.last()
    }

    fn last(&self) -> usize {
        if self.second == 0 { self.first } else { self.second }
    }

    fn context_at(&self) -> usize {
        self.inputs * self.first
    }

    fn bias_at(&self) -> usize {
        self.context_at() + self.first
    }

    fn second_at(&self) -> usize {
        self.bias_at() + self.first
    }

    fn output_at(&self) -> usize {
        self.second_at() + self.first * self.second
    }
}

/// Weights of one decoder, with the transposes that its gradients need.
#[derive(Debug, Clone, PartialEq)]
pub struct Decoder {
    shape: Shape,
    /// The factor s.
    scale: f32,
    weights: Lines,
    /// W1 transposed, rows padded to [`LINE`] with zeros.
    first_transposed: Lines,
    second_transposed: Lines,
}

impl Decoder {
    /// Kaiming weights, a pure function of (seed, stream). The last layer needs no smaller start:
    /// the anchor already makes it silent.
    pub fn new(shape: Shape, scale: f32, seed: u32, stream: u32) -> Self {
        let mut weights = vec![0.0; shape.weights()];
        let gaussian = |layer: u32, i: usize, variance: f32| {
            let w = pcg4d([seed, stream, layer, i as u32]);
            normal(w[0], w[1]) * variance.sqrt()
        };
        let fan_in = shape.inputs as f32;
        for (i, weight) in weights.iter_mut().enumerate() {
            *weight = if i < shape.bias_at() {
                gaussian(0, i, 2.0 / fan_in)
            } else if i < shape.second_at() {
                // Uniform within ±1/√inputs, so that half of the units are open at any context.
                (2.0 * unit(pcg4d([seed, stream, 1, i as u32])[0]) - 1.0) / fan_in.sqrt()
            } else if i < shape.output_at() {
                gaussian(2, i, 2.0 / shape.first as f32)
            } else {
                gaussian(3, i, 2.0 / shape.last() as f32)
            };
        }
        Self::from_weights(shape, scale, &weights)
    }

    /// A decoder with given weights, of which there are [`Shape::weights`].
    pub fn from_weights(shape: Shape, scale: f32, weights: &[f32]) -> Self {
        let mut decoder = Self {
            shape,
            scale,
            weights: Lines::zeros(shape.weights()),
            first_transposed: Lines::zeros(shape.first * LINE),
            second_transposed: Lines::zeros(shape.first * shape.second),
        };
        decoder.weights[..weights.len()].copy_from_slice(weights);
        decoder.transpose();
        decoder
    }

    /// The sizes.
    pub fn shape(&self) -> Shape {
        self.shape
    }

    /// The weights in the order of [`Shape::weights`].
    pub fn weights(&self) -> &[f32] {
        &self.weights[..self.shape.weights()]
    }

    /// Changes the weights.
    pub fn update(&mut self, change: impl FnOnce(&mut [f32])) {
        change(&mut self.weights[..self.shape.weights()]);
        self.transpose();
    }

    fn transpose(&mut self) {
        let Shape { inputs, first, second } = self.shape;
        for unit in 0..first {
            for input in 0..inputs {
                self.first_transposed[unit * LINE + input] = self.weights[input * first + unit];
            }
            for next in 0..second {
                self.second_transposed[next * first + unit] =
                    self.weights[self.shape.second_at() + unit * second + next];
            }
        }
    }

    /// D at `out.len()` points: feature rows of [`LINE`] numbers (zeros behind `inputs`) and one
    /// context each. The number of points is a multiple of [`POINTS_MULTIPLE`]; pad with zeros.
    pub(crate) fn forward(
        &self,
        set: InstructionSet,
        features: &[f32],
        contexts: &[f32],
        activations: &mut Activations,
        out: &mut [f32],
    ) {
        activations.reserve(self.shape, out.len());
        set.run(Forward { decoder: self, features, contexts, activations, out });
    }

    /// After [`Self::forward`] at the same points: from ∂L/∂D, the derivatives by feature rows and
    /// contexts (overwritten), and by the weights (added) unless `weights` is empty.
    pub(crate) fn backward(
        &self,
        set: InstructionSet,
        inputs: (&[f32], &[f32]),
        by_out: &[f32],
        activations: &mut Activations,
        gradient: Gradient<'_>,
    ) {
        let (features, contexts) = inputs;
        set.run(Backward { decoder: self, features, contexts, by_out, activations, gradient });
    }
}

/// Where [`Decoder::backward`] writes.
pub(crate) struct Gradient<'a> {
    pub features: &'a mut [f32],
    pub contexts: &'a mut [f32],
    pub weights: &'a mut [f32],
}

/// What a forward pass leaves for its backward pass; reused from call to call.
#[derive(Default)]
pub(crate) struct Activations {
    /// W1·f + z.
    first: Lines,
    /// Δ.
    change: Lines,
    /// W2·Δ.
    second: Lines,
    by_first: Lines,
    by_second: Lines,
    /// Partial sums of ∂L/∂c, one line a point.
    by_context: Lines,
}

impl Activations {
    fn reserve(&mut self, shape: Shape, points: usize) {
        let grow = |lines: &mut Lines, len: usize| {
            if lines.len() < len {
                *lines = Lines::zeros(len);
            }
        };
        grow(&mut self.first, points * shape.first);
        grow(&mut self.change, points * shape.first);
        grow(&mut self.by_first, points * shape.first);
        grow(&mut self.second, points * shape.second);
        grow(&mut self.by_second, points * shape.second);
        grow(&mut self.by_context, points * LINE);
    }
}

struct Forward<'a> {
    decoder: &'a Decoder,
    features: &'a [f32],
    contexts: &'a [f32],
    activations: &'a mut Activations,
    out: &'a mut [f32],
}

impl Kernel for Forward<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self { decoder, features, contexts, activations, out } = self;
        let Shape { inputs, first, second } = decoder.shape;
        let (shape, weights) = (decoder.shape, &decoder.weights[..]);
        let points = out.len();
        assert!(contexts.len() >= points);
        let left = Left { values: features, row_stride: LINE, column_stride: 1 };
        multiply::<L>((points, inputs, first), left, weights, &mut activations.first, false);
        let output = &weights[shape.output_at()..];
        for (point, out) in out.iter_mut().enumerate() {
            let context = L::splat(contexts[point]);
            let mut sum = L::splat(0.0);
            for unit in (0..first).step_by(L::N) {
                let at = point * first + unit;
                let z = context.mul_add(
                    L::load(weights, shape.context_at() + unit),
                    L::load(weights, shape.bias_at() + unit),
                );
                let open = L::load(&activations.first, at) + z;
                let change = open.relu() - z.relu();
                open.store(&mut activations.first, at);
                change.store(&mut activations.change, at);
                if second == 0 {
                    sum = change.mul_add(L::load(output, unit), sum);
                }
            }
            if second == 0 {
                *out = decoder.scale * sum.sum();
            }
        }
        if second == 0 {
            return;
        }
        let left = Left { values: &activations.change, row_stride: first, column_stride: 1 };
        let right = &weights[shape.second_at()..];
        multiply::<L>((points, first, second), left, right, &mut activations.second, false);
        for (point, out) in out.iter_mut().enumerate() {
            let mut sum = L::splat(0.0);
            for unit in (0..second).step_by(L::N) {
                let open = L::load(&activations.second, point * second + unit);
                sum = open.relu().mul_add(L::load(output, unit), sum);
            }
            *out = decoder.scale * sum.sum();
        }
    }
}

struct Backward<'a> {
    decoder: &'a Decoder,
    features: &'a [f32],
    contexts: &'a [f32],
    by_out: &'a [f32],
    activations: &'a mut Activations,
    gradient: Gradient<'a>,
}

impl Kernel for Backward<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(mut self) {
        let Shape { inputs, first, second } = self.decoder.shape;
        let shape = self.decoder.shape;
        let points = self.by_out.len();
        let train = !self.gradient.weights.is_empty();
        assert!(self.contexts.len() >= points && self.gradient.contexts.len() >= points);
        if second > 0 {
            self.through_output::<L>(train);
            let by_second = &self.activations.by_second[..];
            if train {
                let change = &self.activations.change[..];
                let left = Left { values: change, row_stride: 1, column_stride: first };
                let out = &mut self.gradient.weights[shape.second_at()..];
                multiply::<L>((first, points, second), left, by_second, out, true);
            }
            let left = Left { values: by_second, row_stride: second, column_stride: 1 };
            let right = &self.decoder.second_transposed[..];
            let out = &mut self.activations.by_first[..];
            multiply::<L>((points, second, first), left, right, out, false);
        }
        self.through_change::<L>(train);
        let by_first = &self.activations.by_first[..];
        if train {
            let left = Left { values: self.features, row_stride: 1, column_stride: LINE };
            let out = &mut *self.gradient.weights;
            multiply::<L>((inputs, points, first), left, by_first, out, true);
        }
        let left = Left { values: by_first, row_stride: first, column_stride: 1 };
        let right = &self.decoder.first_transposed[..];
        multiply::<L>((points, first, LINE), left, right, self.gradient.features, false);
    }
}

impl Backward<'_> {
    /// ∂L/∂D to ∂L/∂(W2·Δ), through the last layer and the second relu.
    #[inline(always)]
    fn through_output<L: Lanes>(&mut self, train: bool) {
        let (shape, scale) = (self.decoder.shape, self.decoder.scale);
        let output = &self.decoder.weights[shape.output_at()..];
        for unit in (0..shape.second).step_by(L::N) {
            let weight = L::load(output, unit);
            let mut by_weight = L::splat(0.0);
            for (point, by_out) in self.by_out.iter().enumerate() {
                let at = point * shape.second + unit;
                let by_out = L::splat(scale * by_out);
                let open = L::load(&self.activations.second, at);
                (by_out * weight)
                    .where_not_negative(open)
                    .store(&mut self.activations.by_second, at);
                by_weight = by_out.mul_add(open.relu(), by_weight);
            }
            if train {
                add_to::<L>(self.gradient.weights, shape.output_at() + unit, by_weight);
            }
        }
    }

    /// ∂L/∂Δ (from `by_first`, or straight from ∂L/∂D with one layer) to ∂L/∂(W1·f), in place,
    /// to the context and to the weights of z.
    #[inline(always)]
    fn through_change<L: Lanes>(&mut self, train: bool) {
        let (shape, scale) = (self.decoder.shape, self.decoder.scale);
        let weights = &self.decoder.weights[..];
        let Activations { first: opens, change, by_first, by_context, .. } = self.activations;
        for unit in (0..shape.first).step_by(L::N) {
            let by_z_of_context = L::load(weights, shape.context_at() + unit);
            let bias = L::load(weights, shape.bias_at() + unit);
            let output = if shape.second == 0 {
                L::load(weights, shape.output_at() + unit)
            } else {
                L::splat(0.0)
            };
            let zero = L::splat(0.0);
            let (mut by_output, mut by_bias, mut by_context_weight) = (zero, zero, zero);
            for (point, by_out) in self.by_out.iter().enumerate() {
                let at = point * shape.first + unit;
                let by_change = if shape.second == 0 {
                    let by_out = L::splat(scale * by_out);
                    by_output = by_out.mul_add(L::load(change, at), by_output);
                    by_out * output
                } else {
                    L::load(by_first, at)
                };
                let context = L::splat(self.contexts[point]);
                let z = context.mul_add(by_z_of_context, bias);
                let by_open = by_change.where_positive(L::load(opens, at));
                by_open.store(by_first, at);
                let by_z = by_open - by_change.where_positive(z);
                by_bias = by_bias + by_z;
                by_context_weight = context.mul_add(by_z, by_context_weight);
                let before = if unit == 0 { zero } else { L::load(by_context, point * LINE) };
                by_z.mul_add(by_z_of_context, before).store(by_context, point * LINE);
            }
            if train {
                add_to::<L>(self.gradient.weights, shape.bias_at() + unit, by_bias);
                add_to::<L>(self.gradient.weights, shape.context_at() + unit, by_context_weight);
                if shape.second == 0 {
                    add_to::<L>(self.gradient.weights, shape.output_at() + unit, by_output);
                }
            }
        }
        for (point, by) in self.gradient.contexts[..self.by_out.len()].iter_mut().enumerate() {
            *by = L::load(by_context, point * LINE).sum();
        }
    }
}

/// `to[at..] += lanes`.
#[inline(always)]
fn add_to<L: Lanes>(to: &mut [f32], at: usize, lanes: L) {
    (L::load(to, at) + lanes).store(to, at);
}

#[cfg(test)]
mod tests {
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
}
