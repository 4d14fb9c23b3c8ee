//! The colour of surfaces as a checkpoint holds it.

use std::borrow::Cow;

use super::{ByDirection, ColorField, SeenColor, SeenDistance};
use crate::error::{Error, Result};
use crate::octree::{Band, Cell};

/// Stored averages.
#[derive(Debug)]
pub struct ColorState<'a> {
    /// The cells of the blocks.
    pub cells: Cow<'a, [Cell]>,
    pub seen: Cow<'a, [SeenColor]>,
    /// Empty where the band has none.
    pub relief: Cow<'a, [SeenDistance]>,
    /// What is known of the dependence on the direction; empty where there is none.
    pub by_direction: Cow<'a, [f32]>,
}

impl ColorField {
    /// Everything that [`ColorField::with_state`] needs to go on as if it had not stopped.
    pub fn state(&self) -> ColorState<'_> {
        ColorState {
            cells: Cow::Borrowed(self.band.cells()),
            seen: Cow::Borrowed(&self.seen),
            relief: Cow::Borrowed(self.relief()),
            by_direction: Cow::Borrowed(self.by_direction.as_ref().map_or(&[], ByDirection::seen)),
        }
    }

    /// Takes up a stored state; every block counts as changed. `self` brings the settings.
    pub fn with_state(mut self, state: ColorState<'_>) -> Result<Self> {
        let damaged = || Error::corrupt("colours", "blocks and averages do not fit together");
        self.band = Band::with_cells(self.band.scale, &state.cells).ok_or_else(damaged)?;
        if state.seen.len() != self.band.rows() {
            return Err(damaged());
        }
        if let Some(relief) = &mut self.relief
            && !relief.fill(state.relief.into_owned(), &self.band)
        {
            return Err(damaged());
        }
        if let Some(by) = &mut self.by_direction
            && !by.fill(state.by_direction.into_owned(), &self.band)
        {
            return Err(damaged());
        }
        self.seen = state.seen.into_owned();
        self.touched = vec![0; self.band.blocks()];
        Ok(self)
    }
}
