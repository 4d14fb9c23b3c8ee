//! The learned columns of all vertex rows, Adam's memory of them, and what changed.

use rayon::prelude::*;

use super::adam::{self, Corrections};
use super::chunk::Output;
use super::radix::sort_by_key;
use crate::backend::{LearnedRow, RowMoments, StepParameters};
use crate::geometry::simd::{LINE, prefetch};
use crate::modality::{OCCUPANCY_FEATURES, SDF_FEATURES};

/// Groups of touched rows that are summed and stepped in parallel; rows are independent, so the
/// number does not show in any result.
const GROUPS: usize = 64;
/// Bits of a slot's index within its chunk.
const SLOT_BITS: u32 = 16;

/// Partial gradients that are asked for ahead of their use.
const AHEAD: usize = 8;

/// Ranges of [`RowMoments`] columns.
const OCCUPANCY: std::ops::Range<usize> = SDF_FEATURES..SDF_FEATURES + OCCUPANCY_FEATURES;
const EXPLICIT: std::ops::Range<usize> = OCCUPANCY.end..RowMoments::COLUMNS;

pub(super) struct Rows {
    pub learned: Vec<LearnedRow>,
    pub moments: Vec<RowMoments>,
    changed: Vec<bool>,
    changed_rows: Vec<u32>,
    /// (row, chunk and index within it) of every partial gradient, sorted by row.
    slots: Vec<(u32, u32)>,
    scratch: Vec<(u32, u32)>,
    corrections: Corrections,
}

impl Rows {
    pub(super) fn new() -> Self {
        Self {
            learned: Vec::new(),
            moments: Vec::new(),
            changed: Vec::new(),
            changed_rows: Vec::new(),
            slots: Vec::new(),
            scratch: Vec::new(),
            corrections: Corrections::new(),
        }
    }

    pub(super) fn len(&self) -> usize {
        self.learned.len()
    }

    /// Grows; capacities double, so growth costs little for each row.
    pub(super) fn resize(&mut self, rows: usize) {
        if rows > self.len() {
            self.learned.resize(rows, LearnedRow::default());
            self.moments.resize(rows, RowMoments::ZERO);
            self.changed.resize(rows, false);
        }
    }

    pub(super) fn reset(&mut self, rows: &[u32]) {
        for row in rows {
            let at = *row as usize;
            if at < self.len() {
                self.learned[at] = LearnedRow::default();
                self.moments[at] = RowMoments::ZERO;
                self.mark_changed(*row);
            }
        }
    }

    pub(super) fn replace(&mut self, learned: Vec<LearnedRow>, moments: Vec<RowMoments>) {
        self.changed = vec![true; learned.len()];
        self.changed_rows = (0..learned.len() as u32).collect();
        self.learned = learned;
        self.moments = moments;
    }

    pub(super) fn read_changed(&mut self, visit: &mut dyn FnMut(u32, &LearnedRow)) {
        self.changed_rows.sort_unstable();
        for row in self.changed_rows.drain(..) {
            self.changed[row as usize] = false;
            visit(row, &self.learned[row as usize]);
        }
    }

    fn mark_changed(&mut self, row: u32) {
        if !std::mem::replace(&mut self.changed[row as usize], true) {
            self.changed_rows.push(row);
        }
    }

    /// Sorts the chunks' partial gradients by row; equal rows stay in chunk order.
    pub(super) fn collect(&mut self, outputs: &[Output]) {
        self.slots.clear();
        for (chunk, output) in outputs.iter().enumerate() {
            let slots = output.rows.iter().enumerate();
            self.slots.extend(slots.map(|(i, row)| (*row, (chunk as u32) << SLOT_BITS | i as u32)));
        }
        sort_by_key(&mut self.slots, &mut self.scratch);
    }

    /// Sums each collected row's gradient and takes one Adam step; returns the number of rows.
    pub(super) fn step(&mut self, outputs: &[Output], parameters: &StepParameters) -> usize {
        let corrections = &self.corrections;
        let mut tasks = Vec::with_capacity(GROUPS + 1);
        let (mut learned, mut moments) = (&mut self.learned[..], &mut self.moments[..]);
        let (mut slots, mut base) = (&self.slots[..], 0);
        let share = slots.len().div_ceil(GROUPS).max(1);
        while !slots.is_empty() {
            let last = slots[share.min(slots.len()) - 1].0;
            let (now, later) = slots.split_at(slots.partition_point(|(row, _)| *row <= last));
            let until = last as usize + 1 - base;
            let (now_learned, later_learned) = learned.split_at_mut(until);
            let (now_moments, later_moments) = moments.split_at_mut(until);
            tasks.push((base, now, now_learned, now_moments));
            (slots, learned, moments, base) = (later, later_learned, later_moments, base + until);
        }
        tasks.into_par_iter().for_each(|(base, slots, learned, moments)| {
            let mut ahead = slots.iter().skip(AHEAD);
            for slots in slots.chunk_by(|a, b| a.0 == b.0) {
                for (_, slot) in ahead.by_ref().take(slots.len()) {
                    ask_for(*slot, outputs);
                }
                let row = slots[0].0 as usize - base;
                let gradient = RowGradient::sum(slots, outputs);
                gradient.apply(&mut learned[row], &mut moments[row], corrections, parameters);
            }
        });
        let slots = std::mem::take(&mut self.slots);
        let mut rows = 0;
        for slots in slots.chunk_by(|a, b| a.0 == b.0) {
            self.mark_changed(slots[0].0);
            rows += 1;
        }
        self.slots = slots;
        rows
    }

    /// The summed gradients, for tests.
    #[cfg(test)]
    pub(super) fn gradients(&self, outputs: &[Output]) -> Vec<(u32, RowGradient)> {
        let by_row = self.slots.chunk_by(|a, b| a.0 == b.0);
        by_row.map(|slots| (slots[0].0, RowGradient::sum(slots, outputs))).collect()
    }
}

/// A partial gradient: its chunk's output and its index there.
fn slot_of(slot: u32, outputs: &[Output]) -> (&Output, usize) {
    (&outputs[(slot >> SLOT_BITS) as usize], (slot & ((1 << SLOT_BITS) - 1)) as usize)
}

/// Asks for a partial gradient that will be summed soon.
fn ask_for(slot: u32, outputs: &[Output]) {
    let (output, i) = slot_of(slot, outputs);
    let values = &output.by_values[i];
    prefetch(&values[0]);
    prefetch(&values[LINE]);
    prefetch(&output.by_explicit[i]);
}

/// The gradient of one row, columns in the order of [`RowMoments`].
pub(super) struct RowGradient {
    pub columns: [f32; RowMoments::COLUMNS],
    /// Whether a sample gathered the occupancy feature.
    pub occupied: bool,
}

impl RowGradient {
    fn sum(slots: &[(u32, u32)], outputs: &[Output]) -> Self {
        let mut sum = Self { columns: [0.0; RowMoments::COLUMNS], occupied: false };
        for (_, slot) in slots {
            let (output, i) = slot_of(*slot, outputs);
            // Sdf and occupancy features stand side by side in both orders.
            const { assert!(SDF_FEATURES == LINE) }
            let (values, explicit) = (&output.by_values[i], &output.by_explicit[i]);
            for (column, sum) in sum.columns[..EXPLICIT.start].iter_mut().enumerate() {
                *sum += values[column];
            }
            for (column, sum) in sum.columns[EXPLICIT].iter_mut().enumerate() {
                *sum += explicit[column];
            }
            sum.occupied |= output.occupied[i];
        }
        sum
    }

    fn apply(
        &self,
        learned: &mut LearnedRow,
        moments: &mut RowMoments,
        corrections: &Corrections,
        parameters: &StepParameters,
    ) {
        let RowMoments { first, second, sdf_steps, occupancy_steps } = moments;
        let mut step = |columns: std::ops::Range<usize>, values: &mut [f32], t: u32, rate: f32| {
            let memory = (&mut first[columns.clone()], &mut second[columns.clone()]);
            adam::step(values, memory, &self.columns[columns], corrections.at(t), rate);
        };
        *sdf_steps = sdf_steps.saturating_add(1);
        step(0..SDF_FEATURES, &mut learned.sdf_feature, *sdf_steps, parameters.rate);
        step(EXPLICIT, &mut learned.explicit, *sdf_steps, parameters.rate);
        if self.occupied {
            *occupancy_steps = occupancy_steps.saturating_add(1);
            let rate = parameters.occupancy_rate;
            step(OCCUPANCY, &mut learned.occupancy_feature, *occupancy_steps, rate);
        }
    }
}
