//! Evidence as a checkpoint holds it.

use std::borrow::Cow;

use super::{CELLS, Evidence, FLIP, Known};
use crate::error::{Error, Result};
use crate::octree::{Cell, LIMIT, pack};
use crate::surface::witnesses::{WitnessSets, Witnesses};

/// A stored grid.
#[derive(Debug)]
pub struct EvidenceState<'a> {
    pub bricks: Cow<'a, [Cell]>,
    pub known: Cow<'a, [Known]>,
    pub log_odds: Cow<'a, [i8]>,
    pub crossed: Cow<'a, [u32]>,
    pub hit: Cow<'a, [u32]>,
    pub surfels: Cow<'a, [u32]>,
    pub seen_by: Cow<'a, [u16]>,
    /// Of cells, and of vertices that were seen free.
    pub witnesses: WitnessSets,
}

impl Evidence {
    /// Everything that [`Evidence::with_state`] needs to go on as if it had not stopped.
    pub fn state(&self) -> EvidenceState<'_> {
        EvidenceState {
            bricks: Cow::Borrowed(&self.bricks),
            known: Cow::Borrowed(&self.known),
            log_odds: Cow::Borrowed(&self.log_odds),
            crossed: Cow::Borrowed(&self.crossed),
            hit: Cow::Borrowed(&self.hit),
            surfels: Cow::Borrowed(&self.surfels),
            seen_by: Cow::Borrowed(&self.seen_by),
            witnesses: self.witnesses.state(),
        }
    }

    /// Takes up a stored state, whose lists of surfels have been looked at; `free_by` is who saw vertices
    /// free.
    pub fn with_state(mut self, state: EvidenceState<'_>, free_by: &[u16]) -> Result<Self> {
        let bricks = state.bricks.len();
        let cells = [
            state.log_odds.len(),
            state.crossed.len(),
            state.hit.len(),
            state.surfels.len(),
            state.seen_by.len(),
        ];
        if state.known.len() != bricks
            || cells.iter().any(|&c| c != bricks * CELLS)
            || state.bricks.iter().flatten().any(|c| !(-LIMIT..LIMIT).contains(c))
            || state.log_odds.iter().any(|odds| !(-FLIP..=FLIP).contains(odds))
        {
            return Err(Error::corrupt("evidence", "columns do not fit together"));
        }
        let columns = state.seen_by.iter().chain(free_by).copied();
        self.witnesses = Witnesses::with_state(state.witnesses, columns)?;
        self.seen_by = state.seen_by.into_owned();
        self.bricks = state.bricks.into_owned();
        self.known = state.known.into_owned();
        self.log_odds = state.log_odds.into_owned();
        self.crossed = state.crossed.into_owned();
        self.hit = state.hit.into_owned();
        self.surfels = state.surfels.into_owned();
        self.visited = vec![0; bricks];
        let places = self.bricks.iter().enumerate();
        self.index = places.map(|(i, &b)| (pack(b), i as u32)).collect();
        if self.index.len() != bricks {
            return Err(Error::corrupt("evidence", "two bricks are at one place"));
        }
        Ok(self)
    }
}
