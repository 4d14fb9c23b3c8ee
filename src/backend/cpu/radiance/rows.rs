//! What was learned of colours, by vertex of the band, with Adam's memory.

use super::super::adam::{self, Corrections};
use super::super::radix::sort_by_key;
use crate::backend::ColorRows;

/// The learned colours, and which blocks changed.
pub(super) struct Rows {
    pub state: ColorRows,
    changed: Vec<bool>,
    /// (row, gradient) sorted by row.
    order: Vec<(u32, u32)>,
    scratch: Vec<(u32, u32)>,
    corrections: Corrections,
}

impl Rows {
    pub(super) fn new() -> Self {
        Self {
            state: ColorRows::default(),
            changed: Vec::new(),
            order: Vec::new(),
            scratch: Vec::new(),
            corrections: Corrections::new(),
        }
    }

    /// Grows; new rows are zero.
    pub(super) fn resize(&mut self, rows: usize) {
        let state = &mut self.state;
        state.learned.resize(rows, [0.0; 3]);
        state.first.resize(rows, [0.0; 3]);
        state.second.resize(rows, [0.0; 3]);
        state.steps.resize(rows, 0);
    }

    pub(super) fn replace(&mut self, state: ColorRows, vertices: usize) {
        self.changed = vec![true; state.steps.len() / vertices];
        self.state = state;
    }

    /// One Adam step of every row that has a gradient; gradients of a row are summed in order.
    pub(super) fn step(&mut self, gradients: &[(u32, [f32; 3])], vertices: usize, rate: f32) {
        self.order.clear();
        self.order.extend(gradients.iter().enumerate().map(|(i, (row, _))| (*row, i as u32)));
        sort_by_key(&mut self.order, &mut self.scratch);
        self.changed.resize(self.state.steps.len() / vertices, false);
        for group in self.order.chunk_by(|a, b| a.0 == b.0) {
            let mut sum = [0.0; 3];
            for (_, i) in group {
                let by = &gradients[*i as usize].1;
                sum.iter_mut().zip(by).for_each(|(sum, by)| *sum += by);
            }
            let row = group[0].0 as usize;
            let state = &mut self.state;
            state.steps[row] = state.steps[row].saturating_add(1);
            let corrections = self.corrections.at(state.steps[row]);
            let memory = (&mut state.first[row][..], &mut state.second[row][..]);
            adam::step(&mut state.learned[row], memory, &sum, corrections, rate);
            self.changed[row / vertices] = true;
        }
    }

    /// Visits the blocks that changed since the last call.
    pub(super) fn read_changed(
        &mut self,
        vertices: usize,
        visit: &mut dyn FnMut(u32, &[[f32; 3]]),
    ) {
        for (block, changed) in self.changed.iter_mut().enumerate() {
            if std::mem::take(changed) {
                visit(block as u32, &self.state.learned[block * vertices..][..vertices]);
            }
        }
    }
}
