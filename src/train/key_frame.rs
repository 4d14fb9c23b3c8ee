//! Key frames: a bounded memory of past views, and which of them a frame trains on.
//!
//! Insertion follows algorithms.md §4 (IoU of level-0 voxels with the last key frame). Selection
//! is the same greedy cover, over coarse blocks and only among key frames that share blocks with
//! the current view, so that its cost follows the view and not the map.

use bytemuck::{Pod, Zeroable};
use glam::{Mat3, Vec3};
use rustc_hash::FxHashMap;
use serde::{Deserialize, Serialize};

use crate::config::MapConfig;
use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::octree::{cell_of, pack};

/// Edge length of the blocks that selection counts, m.
const BLOCK_M: f32 = 0.4;
/// At most this many key frames are remembered for a block; older ones give way.
const PER_BLOCK: usize = 32;
/// At most this many key frames compete for a window.
const CANDIDATES: usize = 32;

/// One sampled pixel.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
pub struct Pixel {
    pub u: u16,
    pub v: u16,
    /// z-depth, m.
    pub z: f32,
}

/// What training keeps of a frame.
#[derive(Debug, Clone)]
pub struct KeyFrame {
    /// Camera centre, world metres.
    pub origin: Vec3,
    world_from_camera: Mat3,
    /// 1/fx, 1/fy, cx, cy.
    camera: [f32; 4],
    pub pixels: Vec<Pixel>,
    /// Blocks that hold a pixel's end, sorted.
    blocks: Vec<u64>,
    /// Level-0 voxels that hold a pixel's end, sorted; kept for the newest key frame alone.
    voxels: Vec<u64>,
}

impl KeyFrame {
    /// Samples a frame on a regular grid of at most `max_pixels` pixels.
    pub fn new(frame: &Frame, max_pixels: usize, r0_m: f32) -> Self {
        let k = &frame.intrinsics;
        let mut stride = 1usize;
        while (k.width as usize).div_ceil(stride) * (k.height as usize).div_ceil(stride)
            > max_pixels
        {
            stride += 1;
        }
        let mut key_frame = Self {
            origin: frame.world_from_camera.position_f32(),
            world_from_camera: frame.world_from_camera.rotation_f32(),
            camera: [1.0 / k.fx as f32, 1.0 / k.fy as f32, k.cx as f32, k.cy as f32],
            pixels: Vec::with_capacity(max_pixels),
            blocks: Vec::new(),
            voxels: Vec::new(),
        };
        for v in (stride / 2..k.height as usize).step_by(stride) {
            for u in (stride / 2..k.width as usize).step_by(stride) {
                let z = frame.depth.at(u as u32, v as u32);
                if z > 0.0 {
                    key_frame.pixels.push(Pixel { u: u as u16, v: v as u16, z });
                }
            }
        }
        key_frame.blocks = key_frame.cells(BLOCK_M);
        key_frame.voxels = key_frame.cells(r0_m);
        key_frame
    }

    /// World direction of a pixel, with z = 1 in camera axes.
    #[inline]
    pub fn direction(&self, pixel: Pixel) -> Vec3 {
        let [ifx, ify, cx, cy] = self.camera;
        let (u, v) = (f32::from(pixel.u), f32::from(pixel.v));
        self.world_from_camera * Vec3::new((u - cx) * ifx, (v - cy) * ify, 1.0)
    }

    fn cells(&self, size_m: f32) -> Vec<u64> {
        let end = |&p: &Pixel| pack(cell_of(self.origin + self.direction(p) * p.z, 1.0 / size_m));
        let mut cells: Vec<u64> = self.pixels.iter().map(end).collect();
        cells.sort_unstable();
        cells.dedup();
        cells
    }

    fn bytes(&self) -> usize {
        self.pixels.len() * size_of::<Pixel>() + (self.blocks.len() + self.voxels.len()) * 8
    }
}

/// All key frames of a map.
#[derive(Debug)]
pub struct KeyFrames {
    window: usize,
    iou: f32,
    budget_bytes: usize,
    bytes: usize,
    /// By id; `None` once it gave way.
    frames: Vec<Option<KeyFrame>>,
    /// On how many blocks' lists each stands.
    listings: Vec<u32>,
    newest: Option<u32>,
    /// Ids by block, oldest first.
    by_block: Vec<(u64, BlockFrames)>,
    /// Where the next idle window starts.
    idle_cursor: u32,
    /// Windows selected so far: the clock by which blocks wait.
    selections: u32,
    index: FxHashMap<u64, u32>,
}

/// Stored key frames, their pixels and cells one behind the other.
#[derive(Debug, Default)]
pub struct KeyFramesState {
    pub newest: Option<u32>,
    pub idle_cursor: u32,
    pub selections: u32,
    pub frames: Vec<Option<FrameRecord>>,
    pub pixels: Vec<Pixel>,
    /// Blocks and then voxels of each frame.
    pub cells: Vec<u64>,
    pub blocks: Vec<u64>,
    pub block_trained: Vec<u32>,
    pub block_counts: Vec<u32>,
    pub block_ids: Vec<u32>,
}

/// One stored key frame.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct FrameRecord {
    origin: Vec3,
    world_from_camera: Mat3,
    camera: [f32; 4],
    lengths: [u32; 3],
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
            frames: Vec::new(),
            listings: Vec::new(),
            newest: None,
            by_block: Vec::new(),
            idle_cursor: 0,
            selections: 0,
            index: FxHashMap::default(),
        }
    }

    /// Everything that [`KeyFrames::with_state`] needs to go on as if it had not stopped.
    pub fn state(&self) -> KeyFramesState {
        let mut state = KeyFramesState {
            newest: self.newest,
            idle_cursor: self.idle_cursor,
            selections: self.selections,
            ..KeyFramesState::default()
        };
        for frame in &self.frames {
            state.frames.push(frame.as_ref().map(|f| FrameRecord {
                origin: f.origin,
                world_from_camera: f.world_from_camera,
                camera: f.camera,
                lengths: [f.pixels.len(), f.blocks.len(), f.voxels.len()].map(|l| l as u32),
            }));
            if let Some(f) = frame {
                state.pixels.extend(&f.pixels);
                state.cells.extend(f.blocks.iter().chain(&f.voxels));
            }
        }
        for (block, seen) in &self.by_block {
            state.blocks.push(*block);
            state.block_trained.push(seen.trained);
            state.block_counts.push(seen.ids.len() as u32);
            state.block_ids.extend(&seen.ids);
        }
        state
    }

    /// Takes up a stored state.
    pub fn with_state(mut self, state: KeyFramesState) -> Result<Self> {
        let damaged = || Error::corrupt("key frames", "columns do not fit together");
        let (mut pixels, mut cells) = (&state.pixels[..], &state.cells[..]);
        for record in state.frames {
            let Some(record) = record else {
                self.frames.push(None);
                continue;
            };
            let [p, b, v] = record.lengths.map(|l| l as usize);
            let frame = KeyFrame {
                origin: record.origin,
                world_from_camera: record.world_from_camera,
                camera: record.camera,
                pixels: pixels.split_off(..p).ok_or_else(damaged)?.to_vec(),
                blocks: cells.split_off(..b).ok_or_else(damaged)?.to_vec(),
                voxels: cells.split_off(..v).ok_or_else(damaged)?.to_vec(),
            };
            self.bytes += frame.bytes();
            self.frames.push(Some(frame));
        }
        if state.newest.is_some_and(|id| self.get(id).is_none())
            || state.block_trained.len() != state.blocks.len()
            || state.block_counts.len() != state.blocks.len()
            || state.block_ids.iter().any(|&id| self.get(id).is_none())
        {
            return Err(damaged());
        }
        self.listings = vec![0; self.frames.len()];
        for &id in &state.block_ids {
            self.listings[id as usize] += 1;
        }
        let mut ids = &state.block_ids[..];
        for (i, &block) in state.blocks.iter().enumerate() {
            let count = state.block_counts[i] as usize;
            let ids = ids.split_off(..count).ok_or_else(damaged)?.to_vec();
            self.index.insert(block, i as u32);
            self.by_block.push((block, BlockFrames { ids, trained: state.block_trained[i] }));
        }
        self.newest = state.newest;
        self.idle_cursor = state.idle_cursor;
        self.selections = state.selections;
        Ok(self)
    }

    /// The number of key frames held.
    pub fn len(&self) -> usize {
        self.frames.iter().flatten().count()
    }

    /// Whether none is held.
    pub fn is_empty(&self) -> bool {
        self.newest.is_none()
    }

    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        self.bytes as u64
    }

    /// The key frame with an id, unless it gave way.
    pub fn get(&self, id: u32) -> Option<&KeyFrame> {
        self.frames.get(id as usize)?.as_ref()
    }

    /// Keeps the frame if it sees something that the newest key frame does not.
    pub fn offer(&mut self, frame: &KeyFrame) {
        if frame.pixels.is_empty() {
            return;
        }
        if let Some(newest) = self.newest.and_then(|id| self.frames[id as usize].as_mut()) {
            if intersection_over_union(&newest.voxels, &frame.voxels) >= self.iou {
                return;
            }
            self.bytes -= newest.voxels.len() * 8;
            newest.voxels = Vec::new();
        }
        let id = self.frames.len() as u32;
        self.newest = Some(id);
        self.bytes += frame.bytes();
        self.frames.push(Some(frame.clone()));
        self.listings.push(0);
        for &block in &frame.blocks {
            let entry = self.block(block);
            let ids = &mut self.by_block[entry].1.ids;
            if ids.len() == PER_BLOCK {
                let old = ids.remove(0);
                self.leave_block(old);
            }
            self.by_block[entry].1.ids.push(id);
            self.listings[id as usize] += 1;
        }
        while self.bytes > self.budget_bytes && self.drop_redundant(frame, id) {}
    }

    /// Takes a key frame off one block's list. One that is on no list can never be chosen again, and
    /// is given up: a robot that stays in a room holds what the room needs.
    fn leave_block(&mut self, id: u32) {
        let listings = &mut self.listings[id as usize];
        *listings = listings.saturating_sub(1);
        if *listings == 0
            && self.newest != Some(id)
            && let Some(frame) = self.frames[id as usize].take()
        {
            self.bytes -= frame.bytes();
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
        for _ in 0..self.frames.len() {
            let id = self.idle_cursor as usize % self.frames.len();
            self.idle_cursor = (id + 1) as u32;
            if let Some(frame) = &self.frames[id] {
                let blocks = frame.blocks.clone();
                let candidates = self.candidates(&blocks);
                return self.cover(&candidates);
            }
        }
        Vec::new()
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
                _ if self.frames[id as usize].is_some() => shared.push((id, 1)),
                _ => {}
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
                let frame = self.frames[id as usize].as_ref();
                let blocks = frame.map_or(&[][..], |f| &f.blocks);
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
            let frame = self.frames[id as usize].as_ref();
            let blocks = frame.map_or(&[][..], |f| &f.blocks);
            let seen_by = blocks.iter().filter_map(|b| self.index.get(b));
            seen_by.map(|&b| self.by_block[b as usize].1.ids.len()).min().unwrap_or(0)
        };
        let mut victims: Vec<u32> = candidates.into_iter().filter(|&id| id != newest).collect();
        if victims.is_empty() {
            // Nothing around: the oldest goes.
            let oldest = (0..newest).find(|&id| self.frames[id as usize].is_some());
            victims.extend(oldest);
        }
        let Some(victim) = victims.iter().copied().max_by_key(redundancy) else { return false };
        let Some(frame) = self.frames[victim as usize].take() else { return false };
        self.bytes -= frame.bytes();
        for block in &frame.blocks {
            if let Some(&entry) = self.index.get(block) {
                self.by_block[entry as usize].1.ids.retain(|&id| id != victim);
            }
        }
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

/// |A ∩ B| / |A ∪ B| of two sorted sets.
fn intersection_over_union(a: &[u64], b: &[u64]) -> f32 {
    let (mut i, mut j, mut both) = (0, 0, 0usize);
    while i < a.len() && j < b.len() {
        match a[i].cmp(&b[j]) {
            std::cmp::Ordering::Less => i += 1,
            std::cmp::Ordering::Greater => j += 1,
            std::cmp::Ordering::Equal => {
                both += 1;
                i += 1;
                j += 1;
            }
        }
    }
    both as f32 / (a.len() + b.len() - both).max(1) as f32
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
            .map(|i| KeyFrame::new(&room.load(i, false).expect("a frame"), 4096, config.r0_m))
            .collect();
        let mut held = KeyFrames::new(&config);
        let lap = |held: &mut KeyFrames| {
            frames.iter().for_each(|frame| held.offer(frame));
            (held.len(), held.bytes())
        };
        let after: Vec<(usize, u64)> = (0..80).map(|_| lap(&mut held)).collect();
        assert!(after[0].0 > 10, "a lap gives many: {}", after[0].0);
        assert_eq!(after[40], after[79], "later laps replace");
        let resumed = KeyFrames::new(&config).with_state(held.state()).expect("whole");
        assert_eq!((resumed.listings, resumed.bytes), (held.listings, held.bytes));
        let bytes: usize = held.frames.iter().flatten().map(KeyFrame::bytes).sum();
        assert_eq!(held.bytes, bytes);
    }
}
