//! The prior as a checkpoint holds it.

use std::borrow::Cow;

use super::{END, PriorField};
use crate::error::{Error, Result};
use crate::octree::Explicit;
use crate::surface::surfel::NO_SURFEL;

/// A stored prior.
#[derive(Debug)]
pub struct PriorState<'a> {
    pub nearest: Cow<'a, [u32]>,
    pub reach: Cow<'a, [f32]>,
    pub values: Cow<'a, [Explicit]>,
    pub seen_free: Cow<'a, [u32]>,
    pub free_by: Cow<'a, [u16]>,
    pub next: Cow<'a, [u32]>,
    pub previous: Cow<'a, [u32]>,
    pub heads: Cow<'a, [u32]>,
}

impl PriorField {
    /// Everything that [`PriorField::with_state`] needs to go on as if it had not stopped.
    pub fn state(&self) -> PriorState<'_> {
        PriorState {
            nearest: Cow::Borrowed(&self.nearest),
            reach: Cow::Borrowed(&self.reach),
            values: Cow::Borrowed(&self.values),
            seen_free: Cow::Borrowed(&self.seen_free),
            free_by: Cow::Borrowed(&self.free_by),
            next: Cow::Borrowed(&self.next),
            previous: Cow::Borrowed(&self.previous),
            heads: Cow::Borrowed(&self.heads),
        }
    }

    /// Takes up a stored state of `rows` rows and at most `surfels` surfel slots.
    pub fn with_state(
        mut self,
        state: PriorState<'_>,
        rows: usize,
        surfels: usize,
    ) -> Result<Self> {
        let lengths = [
            state.nearest.len(),
            state.reach.len(),
            state.values.len(),
            state.seen_free.len(),
            state.free_by.len(),
            state.next.len(),
            state.previous.len(),
        ];
        let row_exists = |&r: &u32| r == END || (r as usize) < rows;
        let surfel_exists = |&s: &u32| s == NO_SURFEL || (s as usize) < state.heads.len();
        if lengths.iter().any(|&l| l != rows)
            || state.heads.len() > surfels
            || !state.nearest.iter().all(surfel_exists)
            || !state.next.iter().chain(&*state.previous).chain(&*state.heads).all(row_exists)
        {
            return Err(Error::corrupt("prior", "columns do not fit together"));
        }
        if !has_lists(&state) {
            return Err(Error::corrupt("prior", "lists of vertices do not fit their surfels"));
        }
        self.nearest = state.nearest.into_owned();
        self.reach = state.reach.into_owned();
        self.values = state.values.into_owned();
        self.seen_free = state.seen_free.into_owned();
        self.free_by = state.free_by.into_owned();
        self.next = state.next.into_owned();
        self.previous = state.previous.into_owned();
        self.heads = state.heads.into_owned();
        self.work.queued = vec![false; rows];
        self.work.is_changed = vec![false; rows];
        Ok(self)
    }
}

/// Whether every vertex with a surfel is in the list of that surfel, once, and no other is in any. A list
/// that came back to itself would have a vertex with two before it.
fn has_lists(state: &PriorState<'_>) -> bool {
    let mut listed = 0;
    for (surfel, &head) in state.heads.iter().enumerate() {
        let (mut row, mut before) = (head, END);
        while row != END {
            let at = row as usize;
            if state.nearest[at] != surfel as u32 || state.previous[at] != before {
                return false;
            }
            (before, row) = (row, state.next[at]);
            listed += 1;
        }
    }
    listed == state.nearest.iter().filter(|surfel| **surfel != NO_SURFEL).count()
}
