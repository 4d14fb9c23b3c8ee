//! Surfels as a checkpoint holds them.

use std::borrow::Cow;

use bytemuck::{Pod, Zeroable};

use super::{Link, NO_SURFEL, Surfel, SurfelMap};
use crate::error::{Error, Result};
use crate::geometry::MAX_COORDINATE_M;
use crate::surface::witnesses::{WitnessSets, Witnesses};

/// Stored surfels.
#[derive(Debug)]
pub struct SurfelState<'a> {
    pub surfels: Cow<'a, [Surfel]>,
    pub links: Cow<'a, [Link]>,
    pub free: Cow<'a, [u32]>,
    pub witnesses: WitnessSets,
}

/// A surfel as files held it before they said who saw it: they held the robot that saw it first.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub struct FirstSurfel {
    /// Place, normal and weight, place and normal as told.
    measured: [f32; 13],
    contrary: u32,
    source: u32,
    born: u32,
    key: [u32; 2],
}

impl Surfel {
    /// Whether its numbers are those of a surface within reach.
    fn is_somewhere(&self) -> bool {
        let reach = 2.0 * MAX_COORDINATE_M as f32;
        self.position.abs().max_element() <= reach
            && self.position.is_finite()
            && self.normal.is_finite()
            && self.weight.is_finite()
    }
}

impl FirstSurfel {
    /// The surfel, seen by `seen_by`. When it was seen last is not known: not before it was made.
    pub fn seen_by(self, seen_by: u16) -> Surfel {
        let contrary = self.contrary.min(u32::from(u16::MAX)) as u16;
        let words = [u32::from(contrary) | u32::from(seen_by) << 16, self.born, self.born];
        let mut all = [0; 18];
        all[..13].copy_from_slice(&self.measured.map(f32::to_bits));
        all[13..16].copy_from_slice(&words);
        all[16..].copy_from_slice(&self.key);
        bytemuck::pod_read_unaligned(bytemuck::cast_slice(&all))
    }
}

impl SurfelMap {
    /// Everything that [`SurfelMap::with_state`] needs to go on as if it had not stopped.
    pub fn state(&self) -> SurfelState<'_> {
        SurfelState {
            surfels: Cow::Borrowed(&self.surfels),
            links: Cow::Borrowed(&self.links),
            free: Cow::Borrowed(&self.free),
            witnesses: self.witnesses.state(),
        }
    }

    /// Takes up a stored state. Whether lists of cells end is seen with their heads:
    /// [`SurfelMap::has_lists`].
    pub fn with_state(mut self, state: SurfelState<'_>) -> Result<Self> {
        let slots = state.surfels.len();
        let exists = |&id: &u32| id == NO_SURFEL || (id as usize) < slots;
        if state.links.len() != slots
            || !state.free.iter().all(|id| (*id as usize) < slots)
            || !state.links.iter().all(|l| exists(&l.next_in_cell))
            || !state.surfels.iter().filter(|s| s.alive()).all(Surfel::is_somewhere)
        {
            return Err(Error::corrupt("surfels", "lists refer to what is not there"));
        }
        let columns = state.surfels.iter().map(|s| s.seen_by);
        self.witnesses = Witnesses::with_state(state.witnesses, columns)?;
        self.surfels = state.surfels.into_owned();
        self.links = state.links.into_owned();
        self.free = state.free.into_owned();
        let alive = self.surfels.iter().enumerate().filter(|(_, s)| s.alive());
        self.by_key = alive.map(|(id, s)| (s.key, id as u32)).collect();
        self.alive = self.by_key.len();
        if self.alive != self.surfels.iter().filter(|s| s.alive()).count() {
            return Err(Error::corrupt("surfels", "two are of one cell and side"));
        }
        Ok(self)
    }

    /// Whether each surfel is in the list of one cell at most, of those with these `heads`, and none
    /// that can be taken for a new one is in any or alive.
    pub(in crate::surface) fn has_lists(&self, heads: &[u32]) -> bool {
        let mut is_taken = vec![false; self.surfels.len()];
        for &head in heads {
            let mut id = head;
            while id != NO_SURFEL {
                let is_new =
                    is_taken.get_mut(id as usize).is_some_and(|t| !std::mem::replace(t, true));
                if !is_new {
                    return false;
                }
                id = self.links[id as usize].next_in_cell;
            }
        }
        let is_free = |id: &u32| {
            !self.surfels[*id as usize].alive()
                && !std::mem::replace(&mut is_taken[*id as usize], true)
        };
        self.free.iter().all(is_free)
    }
}
