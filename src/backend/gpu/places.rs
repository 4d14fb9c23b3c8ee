//! Places by which kernels find bricks and blocks, in open addressing.

use crate::octree::Cell;

/// Slots of the first table.
const LEAST_SLOTS: usize = 64;

/// Things by their places: x, y, z and id + 1, or 0. Never fuller than a half.
#[derive(Debug, Default)]
pub(super) struct PlaceTable {
    slots: Vec<[i32; 4]>,
    /// Things that it holds: ids below this.
    count: u32,
    /// Slots that were filled by the last call.
    fresh: Vec<u32>,
}

impl PlaceTable {
    /// Takes up the things that are new, of `count`.
    pub(super) fn take_up(&mut self, count: usize, place: impl Fn(u32) -> Cell) {
        self.fresh.clear();
        if 2 * count > self.slots.len() {
            let slots = (4 * count).next_power_of_two().max(LEAST_SLOTS);
            self.slots.clear();
            self.slots.resize(slots, [0; 4]);
            self.count = 0;
        }
        for id in self.count..count as u32 {
            let place = place(id);
            let mask = self.slots.len() - 1;
            let mut slot = first_slot(place) as usize & mask;
            while self.slots[slot][3] != 0 {
                slot = (slot + 1) & mask;
            }
            self.slots[slot] = [place[0], place[1], place[2], (id + 1) as i32];
            self.fresh.push(slot as u32);
        }
        self.count = count as u32;
    }

    /// Its size. A table of another size shares no slot with it.
    pub(super) fn slots(&self) -> u64 {
        self.slots.len() as u64
    }

    /// The slots that the last call filled, and what is in them.
    pub(super) fn fresh(&self) -> impl Iterator<Item = (u32, [u32; 4])> {
        let entry = |slot: u32| self.slots[slot as usize].map(|word| word as u32);
        self.fresh.iter().map(move |&slot| (slot, entry(slot)))
    }
}

/// The slot where the search for a place starts, before it is cut to the table's size; the twin of
/// `place_slot` in shaders/lib/places.wgsl.
fn first_slot(place: Cell) -> u32 {
    let [x, y, z] = place.map(|c| c as u32);
    let h = x
        .wrapping_mul(0x9e37_79b1)
        .wrapping_add(y.wrapping_mul(0x85eb_ca77))
        .wrapping_add(z.wrapping_mul(0xc2b2_ae3d));
    h ^ (h >> 15)
}
