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

mod passes;
#[cfg(test)]
mod tests;

use serde::{Deserialize, Serialize};

use self::passes::{Backward, Forward};
use crate::error::{Error, Result};
use crate::geometry::random::{normal, pcg4d, unit};
use crate::geometry::simd::{InstructionSet, LINE, Lines};

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

    /// The factor s.
    pub fn scale(&self) -> f32 {
        self.scale
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
