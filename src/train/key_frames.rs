//! Key frames: a bounded memory of past views, and which of them a frame trains on.
//!
//! Insertion follows algorithms.md §4 (IoU of level-0 voxels with the last key frame). Selection
//! is the same greedy cover, over coarse blocks and only among key frames that share blocks with
//! the current view, so that its cost follows the view and not the map.

mod stored;

use std::collections::BTreeMap;

use rustc_hash::FxHashMap;

pub use self::stored::{FrameRecord, KeyFramesState, NO_ROBOT};
use super::key_frame::{KeyFrame, Standpoint};
use crate::config::MapConfig;

/// At most this many key frames are remembered for a block; older ones give way.
const PER_BLOCK: usize = 32;
/// At most this many key frames compete for a window.
const CANDIDATES: usize = 32;

/// All key frames of a map.
#[derive(Debug)]
pub struct KeyFrames {
    window: usize,
    iou: f32,
    budget_bytes: usize,
    bytes: usize,
    /// By id; ids grow with age.
    frames: BTreeMap<u32, Kept>,
    /// The next id.
    next: u32,
    by_standpoint: FxHashMap<Standpoint, u32>,
    /// Ids by block, oldest first.
    by_block: Vec<(u64, BlockFrames)>,
    /// Where the next idle window starts.
    idle_cursor: u32,
    /// Windows selected so far: the clock by which blocks wait.
    selections: u32,
    index: FxHashMap<u64, u32>,
    /// Whether there are others than at [`KeyFrames::take_changed`].
    changed: bool,
}

#[derive(Debug)]
struct Kept {
    frame: KeyFrame,
    /// On how many blocks' lists it stands.
    listings: u32,
}

#[derive(Debug, Clone, Default)]
struct BlockFrames {
    ids: Vec<u32>,
    /// The selection that last trained the block.
    trained: u32,
}

impl KeyFrames {
    /// None yet.
    pub fn new(config: &MapConfig) -> Self {
        Self {
            window: config.window as usize,
            iou: config.key_frame_iou,
            budget_bytes: (config.key_frame_mib as usize) << 20,
            bytes: 0,
            frames: BTreeMap::new(),
            next: 0,
            by_standpoint: FxHashMap::default(),
            by_block: Vec::new(),
            idle_cursor: 0,
            selections: 0,
            index: FxHashMap::default(),
            changed: false,
        }
    }

    /// The number of key frames held.
    pub fn len(&self) -> usize {
        self.frames.len()
    }

    /// Whether none is held.
    pub fn is_empty(&self) -> bool {
        self.frames.is_empty()
    }

    /// All of them, oldest first.
    pub fn iter(&self) -> impl Iterator<Item = &KeyFrame> {
        self.frames.values().map(|kept| &kept.frame)
    }

    /// Whether there are others than at the last call.
    pub fn take_changed(&mut self) -> bool {
        std::mem::take(&mut self.changed)
    }

    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        self.bytes as u64
    }

    /// The key frame with an id, unless it gave way.
    pub fn get(&self, id: u32) -> Option<&KeyFrame> {
        Some(&self.frames.get(&id)?.frame)
    }

    /// Keeps the frame if it sees something that the newest key frame does not. An older one from
    /// the same standpoint gives way: what it saw has been seen again, and a robot that stays in a room
    /// holds what the room needs.
    pub fn offer(&mut self, frame: &KeyFrame) {
        if frame.pixels.is_empty() {
            return;
        }
        if let Some(mut newest) = self.frames.last_entry() {
            let newest = &mut newest.get_mut().frame;
            if newest.overlap(frame) >= self.iou {
                return;
            }
            self.bytes -= newest.voxels.len() * 8;
            newest.voxels = Vec::new();
        }
        let id = self.next;
        self.next += 1;
        if let Some(older) = self.by_standpoint.insert(frame.standpoint(), id) {
            self.remove(older);
        }
        self.bytes += frame.bytes();
        let listings = frame.blocks.len() as u32;
        self.frames.insert(id, Kept { frame: frame.clone(), listings });
        self.changed = true;
        for &block in &frame.blocks {
            let entry = self.block(block);
            let ids = &mut self.by_block[entry].1.ids;
            ids.push(id);
            if ids.len() > PER_BLOCK {
                let oldest = ids.remove(0);
                self.leave_block(oldest);
            }
        }
        while self.bytes > self.budget_bytes && self.drop_redundant(frame, id) {}
    }

    /// Takes a key frame off one block's list. One that is on no list can never be chosen again, and
    /// is given up.
    fn leave_block(&mut self, id: u32) {
        if let Some(kept) = self.frames.get_mut(&id) {
            kept.listings -= 1;
            if kept.listings == 0 {
                self.remove(id);
            }
        }
    }

    /// Gives up the key frames of a robot; returns how many there were.
    pub fn forget_robot(&mut self, robot: u16) -> u64 {
        let is_its = |kept: &Kept| kept.frame.robot == Some(robot);
        let ids: Vec<u32> =
            self.frames.iter().filter(|(_, kept)| is_its(kept)).map(|(id, _)| *id).collect();
        ids.iter().for_each(|id| self.remove(*id));
        ids.len() as u64
    }

    fn remove(&mut self, id: u32) {
        let Some(Kept { frame, .. }) = self.frames.remove(&id) else { return };
        self.changed = true;
        self.bytes -= frame.bytes();
        let standpoint = frame.standpoint();
        if self.by_standpoint.get(&standpoint) == Some(&id) {
            self.by_standpoint.remove(&standpoint);
        }
        for block in &frame.blocks {
            if let Some(&entry) = self.index.get(block) {
                self.by_block[entry as usize].1.ids.retain(|&other| other != id);
            }
        }
    }

    /// The key frames to train on beside the current view, by greedy cover: first the one whose
    /// blocks have waited longest, and so on. Persistent, so that consecutive windows take turns.
    pub fn select(&mut self, view: &KeyFrame) -> Vec<u32> {
        let candidates = self.candidates(&view.blocks);
        self.cover(&candidates)
    }

    /// A window for idle refinement: neighbours of the key frame whose turn it is.
    pub fn select_idle(&mut self) -> Vec<u32> {
        let after = self.frames.range(self.idle_cursor..).next();
        let Some((&id, kept)) = after.or_else(|| self.frames.first_key_value()) else {
            return Vec::new();
        };
        self.idle_cursor = id + 1;
        let candidates = self.candidates(&kept.frame.blocks);
        self.cover(&candidates)
    }

    /// Key frames that share most blocks with a view, ids ascending.
    fn candidates(&self, blocks: &[u64]) -> Vec<u32> {
        let mut ids: Vec<u32> = Vec::new();
        for block in blocks {
            if let Some(&entry) = self.index.get(block) {
                ids.extend(&self.by_block[entry as usize].1.ids);
            }
        }
        ids.sort_unstable();
        let mut shared: Vec<(u32, u32)> = Vec::new();
        for id in ids {
            match shared.last_mut() {
                Some((last, count)) if *last == id => *count += 1,
                _ => shared.push((id, 1)),
            }
        }
        shared.sort_unstable_by_key(|&(id, count)| (std::cmp::Reverse(count), id));
        shared.truncate(CANDIDATES);
        let mut ids: Vec<u32> = shared.into_iter().map(|(id, _)| id).collect();
        ids.sort_unstable();
        ids
    }

    fn cover(&mut self, candidates: &[u32]) -> Vec<u32> {
        self.selections = self.selections.saturating_add(1);
        let selection = self.selections;
        let blocks: Vec<Vec<u32>> = candidates
            .iter()
            .map(|&id| {
                let blocks = self.get(id).map_or(&[][..], |f| &f.blocks);
                blocks.iter().filter_map(|b| self.index.get(b).copied()).collect()
            })
            .collect();
        let mut left: Vec<usize> = (0..candidates.len()).collect();
        let mut chosen = Vec::new();
        while chosen.len() < self.window && !left.is_empty() {
            let waited = |&c: &usize| -> u64 {
                let waits = blocks[c].iter().map(|&b| {
                    u64::from(selection.saturating_sub(self.by_block[b as usize].1.trained))
                });
                waits.sum()
            };
            let scores: Vec<u64> = left.iter().map(waited).collect();
            let Some(best) = (0..left.len()).max_by_key(|&i| (scores[i], std::cmp::Reverse(i)))
            else {
                break;
            };
            let candidate = left.swap_remove(best);
            left.sort_unstable();
            for &block in &blocks[candidate] {
                self.by_block[block as usize].1.trained = selection;
            }
            chosen.push(candidates[candidate]);
        }
        chosen.sort_unstable();
        chosen
    }

    /// Gives up the key frame whose blocks others see most, among those around the newest.
    fn drop_redundant(&mut self, around: &KeyFrame, newest: u32) -> bool {
        let candidates = self.candidates(&around.blocks);
        let redundancy = |&id: &u32| -> usize {
            let blocks = self.get(id).map_or(&[][..], |f| &f.blocks);
            let seen_by = blocks.iter().filter_map(|b| self.index.get(b));
            seen_by.map(|&b| self.by_block[b as usize].1.ids.len()).min().unwrap_or(0)
        };
        let mut victims: Vec<u32> = candidates.into_iter().filter(|&id| id != newest).collect();
        if victims.is_empty() {
            // Nothing around: the oldest goes.
            victims.extend(self.frames.keys().next().filter(|&&id| id != newest));
        }
        let Some(victim) = victims.iter().copied().max_by_key(redundancy) else { return false };
        self.remove(victim);
        true
    }

    fn block(&mut self, block: u64) -> usize {
        let next = self.by_block.len() as u32;
        let entry = *self.index.entry(block).or_insert(next);
        if entry == next {
            self.by_block.push((block, BlockFrames::default()));
        }
        entry as usize
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::MapSettings;
    use crate::dataset::Dataset;
    use crate::dataset::synthetic::Synthetic;

    /// A robot that goes round in one room must not gather key frames for ever.
    #[test]
    fn laps_of_one_room_hold_a_bounded_number() {
        let config = MapConfig::from_settings(&MapSettings::default()).expect("defaults");
        let room = Synthetic::room(60).with_width(32);
        let frames: Vec<KeyFrame> = (0..room.len())
            .map(|i| {
                let frame = room.load(i, false).expect("a frame");
                KeyFrame::new(&frame, Some(0), 4096, config.r0_m, None)
            })
            .collect();
        let mut held = KeyFrames::new(&config);
        let lap = |held: &mut KeyFrames| {
            frames.iter().for_each(|frame| held.offer(frame));
            (held.len(), held.bytes())
        };
        let after: Vec<(usize, u64)> = (0..4).map(|_| lap(&mut held)).collect();
        assert!(after[0].0 > 10, "a lap gives many: {}", after[0].0);
        assert_eq!(after[1], after[3], "later laps replace");
        let resumed = KeyFrames::new(&config).with_state(held.state()).expect("whole");
        let listings = |held: &KeyFrames| -> Vec<(u32, u32)> {
            held.frames.iter().map(|(id, kept)| (*id, kept.listings)).collect()
        };
        assert_eq!((listings(&resumed), resumed.bytes), (listings(&held), held.bytes));
        let bytes: usize = held.frames.values().map(|kept| kept.frame.bytes()).sum();
        assert_eq!(held.bytes, bytes);
    }
}
