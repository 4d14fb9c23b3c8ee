//! What the trainer keeps of a decoder beside its weights.

use super::adam::{self, Corrections};
use crate::backend::DecoderState;
use crate::modality::decoder::Decoder;

/// Adam's memory of a decoder, and its summed gradient.
pub(super) struct DecoderMemory {
    first: Vec<f32>,
    second: Vec<f32>,
    steps: u32,
    pub(super) gradient: Vec<f32>,
}

impl DecoderMemory {
    pub(super) fn new(decoder: &Decoder) -> Self {
        let zeros = vec![0.0; decoder.weights().len()];
        Self { first: zeros.clone(), second: zeros.clone(), steps: 0, gradient: zeros }
    }

    /// Adds the chunks' gradients in chunk order.
    pub(super) fn collect<'a>(&mut self, chunks: impl Iterator<Item = &'a [f32]>) {
        self.gradient.fill(0.0);
        for by_weights in chunks {
            for (sum, by) in self.gradient.iter_mut().zip(by_weights) {
                *sum += by;
            }
        }
    }

    pub(super) fn step(&mut self, decoder: &mut Decoder, rate: f32) {
        self.steps = self.steps.saturating_add(1);
        let corrections = Corrections::compute(self.steps);
        decoder.update(|weights| {
            let memory = (&mut self.first[..], &mut self.second[..]);
            adam::step(weights, memory, &self.gradient, corrections, rate);
        });
    }

    pub(super) fn export(&self, decoder: &Decoder) -> DecoderState {
        DecoderState {
            weights: decoder.weights().to_vec(),
            first: self.first.clone(),
            second: self.second.clone(),
            steps: self.steps,
        }
    }

    pub(super) fn import(state: DecoderState) -> Self {
        let gradient = vec![0.0; state.weights.len()];
        Self { first: state.first, second: state.second, steps: state.steps, gradient }
    }
}
