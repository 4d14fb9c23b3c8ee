//! A small hash table from u32 keys to dense indices, emptied in the time of its use.

/// Maps keys to 0, 1, 2, … in the order of their first appearance.
pub(super) struct IndexTable {
    /// Open addressing; [`EMPTY`] where free.
    slots: Vec<(u32, u32)>,
    /// Slots in use, in order of their index.
    used: Vec<u32>,
}

/// No row or node has this id.
const EMPTY: u32 = u32::MAX;

impl IndexTable {
    pub(super) fn new() -> Self {
        Self { slots: vec![(EMPTY, 0); 1024], used: Vec::new() }
    }

    pub(super) fn clear(&mut self) {
        for slot in self.used.drain(..) {
            self.slots[slot as usize] = (EMPTY, 0);
        }
    }

    /// The key's index, and whether it is new.
    #[inline]
    pub(super) fn index(&mut self, key: u32) -> (usize, bool) {
        if self.used.len() * 2 >= self.slots.len() {
            self.grow();
        }
        let slot = Self::slot(&self.slots, key);
        if self.slots[slot].0 == key {
            return (self.slots[slot].1 as usize, false);
        }
        let index = self.used.len();
        self.slots[slot] = (key, index as u32);
        self.used.push(slot as u32);
        (index, true)
    }

    /// The slot that holds the key or where it belongs.
    #[inline]
    fn slot(slots: &[(u32, u32)], key: u32) -> usize {
        let mask = slots.len() - 1;
        // Fibonacci hashing; the table's length is a power of two.
        let mut at = (key.wrapping_mul(0x9e37_79b9) >> 7) as usize & mask;
        while slots[at].0 != key && slots[at].0 != EMPTY {
            at = (at + 1) & mask;
        }
        at
    }

    #[cold]
    fn grow(&mut self) {
        let mut slots = vec![(EMPTY, 0); self.slots.len() * 2];
        for used in &mut self.used {
            let entry = self.slots[*used as usize];
            let slot = Self::slot(&slots, entry.0);
            slots[slot] = entry;
            *used = slot as u32;
        }
        self.slots = slots;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_get_dense_indices_through_growth_and_clearing() {
        let mut table = IndexTable::new();
        for round in 0..2 {
            for i in 0..3000u32 {
                assert_eq!(table.index(i * 8 + round), (i as usize, true));
            }
            for i in (0..3000u32).rev() {
                assert_eq!(table.index(i * 8 + round), (i as usize, false));
            }
            table.clear();
        }
    }
}
