//! The decoder forwards and backwards, generic over the lanes. Hidden units lie along the lanes.

use super::{Activations, Decoder, Gradient, Shape};
use crate::geometry::matmul::{Left, multiply};
use crate::geometry::simd::{Kernel, LINE, Lanes};

pub(super) struct Forward<'a> {
    pub(super) decoder: &'a Decoder,
    pub(super) features: &'a [f32],
    pub(super) contexts: &'a [f32],
    pub(super) activations: &'a mut Activations,
    pub(super) out: &'a mut [f32],
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

pub(super) struct Backward<'a> {
    pub(super) decoder: &'a Decoder,
    pub(super) features: &'a [f32],
    pub(super) contexts: &'a [f32],
    pub(super) by_out: &'a [f32],
    pub(super) activations: &'a mut Activations,
    pub(super) gradient: Gradient<'a>,
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
