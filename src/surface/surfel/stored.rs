//! Surfels as a checkpoint holds them.

use std::borrow::Cow;

use super::{Link, NO_SURFEL, Surfel, SurfelMap};
use crate::error::{Error, Result};

/// Stored surfels.
#[derive(Debug)]
pub struct SurfelState<'a> {
    pub surfels: Cow<'a, [Surfel]>,
    pub links: Cow<'a, [Link]>,
    pub free: Cow<'a, [u32]>,
}

impl SurfelMap {
    /// Everything that [`SurfelMap::with_state`] needs to go on as if it had not stopped.
    pub fn state(&self) -> SurfelState<'_> {
        SurfelState {
            surfels: Cow::Borrowed(&self.surfels),
            links: Cow::Borrowed(&self.links),
            free: Cow::Borrowed(&self.free),
        }
    }

    /// Takes up a stored state.
    pub fn with_state(mut self, state: SurfelState<'_>) -> Result<Self> {
        let slots = state.surfels.len();
        let exists = |&id: &u32| id == NO_SURFEL || (id as usize) < slots;
        if state.links.len() != slots
            || !state.free.iter().all(exists)
            || !state.links.iter().all(|l| exists(&l.next_in_cell))
        {
            return Err(Error::corrupt("surfels", "lists refer to what is not there"));
        }
        self.surfels = state.surfels.into_owned();
        self.links = state.links.into_owned();
        self.free = state.free.into_owned();
        let alive = self.surfels.iter().enumerate().filter(|(_, s)| s.alive());
        self.by_key = alive.map(|(id, s)| (s.key, id as u32)).collect();
        self.alive = self.by_key.len();
        Ok(self)
    }
}
