//! What key frames give to storage and take back.

use glam::{Mat3, Vec3};
use serde::{Deserialize, Serialize};

use super::{BlockFrames, Kept, KeyFrames};
use crate::error::{Error, Result};
use crate::train::key_frame::{KeyFrame, Pixel};

/// Stored key frames, their pixels and cells one behind the other.
#[derive(Debug, Default)]
pub struct KeyFramesState {
    pub next: u32,
    pub idle_cursor: u32,
    pub selections: u32,
    pub frames: Vec<FrameRecord>,
    pub pixels: Vec<Pixel>,
    /// sRGB of the pixels of those frames that have colours.
    pub colors: Vec<[u8; 3]>,
    /// The gain of each frame's colours; zeros where it has none.
    pub gains: Vec<[f32; 3]>,
    /// Blocks and then voxels of each frame.
    pub cells: Vec<u64>,
    pub blocks: Vec<u64>,
    pub block_trained: Vec<u32>,
    pub block_counts: Vec<u32>,
    pub block_ids: Vec<u32>,
    /// The robot of each frame; [`NO_ROBOT`] for one that is not told apart. May be empty: then nobody
    /// knows.
    pub robots: Vec<u16>,
}

/// No robot that is told apart.
pub const NO_ROBOT: u16 = u16::MAX;

/// One stored key frame.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct FrameRecord {
    id: u32,
    origin: Vec3,
    world_from_camera: Mat3,
    camera: [f32; 4],
    pixels: u32,
    /// Of blocks and voxels.
    lengths: [u32; 2],
}

impl KeyFrames {
    /// Everything that [`KeyFrames::with_state`] needs to go on as if it had not stopped.
    pub fn state(&self) -> KeyFramesState {
        let mut state = KeyFramesState {
            next: self.next,
            idle_cursor: self.idle_cursor,
            selections: self.selections,
            ..KeyFramesState::default()
        };
        for (&id, Kept { frame, .. }) in &self.frames {
            state.frames.push(FrameRecord {
                id,
                origin: frame.origin,
                world_from_camera: frame.world_from_camera,
                camera: frame.camera,
                lengths: [&frame.blocks, &frame.voxels].map(|cells| cells.len() as u32),
                pixels: frame.pixels.len() as u32,
            });
            state.robots.push(frame.robot.unwrap_or(NO_ROBOT));
            state.pixels.extend_from_slice(&frame.pixels);
            state.colors.extend_from_slice(&frame.colors);
            let has_colors = !frame.colors.is_empty();
            state.gains.push(if has_colors { frame.gain.to_array() } else { [0.0; 3] });
            state.cells.extend(frame.blocks.iter().chain(&frame.voxels));
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
        let mut colors = &state.colors[..];
        for (i, record) in state.frames.into_iter().enumerate() {
            // Maps from before there were colours have no gains.
            let gain = state.gains.get(i).copied().filter(|gain| gain[0] > 0.0);
            let painted = gain.map_or(0, |_| record.pixels as usize);
            let [blocks, voxels] = record.lengths.map(|length| length as usize);
            let robot = state.robots.get(i).copied().filter(|robot| *robot != NO_ROBOT);
            let frame = KeyFrame {
                robot,
                origin: record.origin,
                world_from_camera: record.world_from_camera,
                camera: record.camera,
                pixels: pixels.split_off(..record.pixels as usize).ok_or_else(damaged)?.into(),
                colors: colors.split_off(..painted).ok_or_else(damaged)?.into(),
                gain: gain.map_or(Vec3::ONE, Vec3::from),
                blocks: cells.split_off(..blocks).ok_or_else(damaged)?.to_vec(),
                voxels: cells.split_off(..voxels).ok_or_else(damaged)?.to_vec(),
            };
            self.bytes += frame.bytes();
            self.by_standpoint.insert(frame.standpoint(), record.id);
            self.frames.insert(record.id, Kept { frame, listings: 0 });
        }
        self.changed = true;
        let is_number = |kept: &Kept| kept.frame.is_finite();
        if self.frames.last_key_value().is_some_and(|(&id, _)| id >= state.next)
            || state.block_trained.len() != state.blocks.len()
            || state.block_counts.len() != state.blocks.len()
            || !self.frames.values().all(is_number)
        {
            return Err(damaged());
        }
        for id in &state.block_ids {
            self.frames.get_mut(id).ok_or_else(damaged)?.listings += 1;
        }
        let mut ids = &state.block_ids[..];
        for (i, &block) in state.blocks.iter().enumerate() {
            let count = state.block_counts[i] as usize;
            let ids = ids.split_off(..count).ok_or_else(damaged)?.to_vec();
            self.index.insert(block, i as u32);
            self.by_block.push((block, BlockFrames { ids, trained: state.block_trained[i] }));
        }
        self.next = state.next;
        self.idle_cursor = state.idle_cursor;
        self.selections = state.selections;
        Ok(self)
    }
}
