//! The surface as a checkpoint holds it.

use std::borrow::Cow;

use super::Surface;
use crate::error::{Error, Result};
use crate::surface::color::{ColorField, ColorState};
use crate::surface::evidence::EvidenceState;
use crate::surface::prior::PriorState;
use crate::surface::surfel::SurfelState;

/// A stored surface.
#[derive(Debug)]
pub struct SurfaceState<'a> {
    pub surfels: SurfelState<'a>,
    pub evidence: EvidenceState<'a>,
    pub prior: PriorState<'a>,
    pub ringed: Cow<'a, [u8]>,
    pub color: Option<ColorState<'a>>,
}

impl Surface {
    /// Everything that [`Surface::with_state`] needs to go on as if it had not stopped.
    pub fn state(&self) -> SurfaceState<'_> {
        SurfaceState {
            surfels: self.surfels.state(),
            evidence: self.evidence.state(),
            prior: self.prior.state(),
            ringed: Cow::Borrowed(&self.ringed),
            color: self.color.as_ref().map(ColorField::state),
        }
    }

    /// Takes up a stored state beside a topology of `rows` rows.
    pub fn with_state(mut self, state: SurfaceState<'_>, rows: usize) -> Result<Self> {
        self.surfels = self.surfels.with_state(state.surfels)?;
        if !self.surfels.has_lists(&state.evidence.surfels) {
            return Err(Error::corrupt("surfels", "lists of cells do not end"));
        }
        let slots = self.surfels.slots();
        let free_by = &state.prior.free_by;
        self.evidence = self.evidence.with_state(state.evidence, free_by)?;
        self.prior = self.prior.with_state(state.prior, rows, slots)?;
        self.ringed = state.ringed.into_owned();
        self.color = match (self.color, state.color) {
            (Some(color), Some(state)) => Some(color.with_state(state)?),
            (color, _) => color,
        };
        self.bricks_planted = self.evidence.bricks() as u32;
        Ok(self)
    }
}
