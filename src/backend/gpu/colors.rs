//! What a map has learned of colours: on the GPU where they are trained on; the rest is kept as it
//! came.

use super::device::Gpu;
use super::radiance::{BlockColors, Radiance};
use crate::backend::ColorRows;
use crate::error::{Error, Result};

/// Learned colours.
pub(super) struct Colors {
    /// Vertices of a block.
    vertices: usize,
    /// Where they are trained on.
    pub(super) radiance: Option<Radiance>,
    /// Rows that are not on the GPU, behind those that are.
    kept: ColorRows,
    /// What has come back and was not asked for yet.
    pub(super) heard: Vec<BlockColors>,
}

impl Colors {
    pub(super) fn new(vertices: usize, radiance: Option<Radiance>) -> Self {
        Self { vertices, radiance, kept: ColorRows::default(), heard: Vec::new() }
    }

    /// Visits the blocks that changed, ascending; of a block that came more than once the newest.
    pub(super) fn read_changed(&mut self, visit: &mut dyn FnMut(u32, &[[f32; 3]])) {
        let mut blocks = std::mem::take(&mut self.heard);
        blocks.sort_by_key(|(block, _)| *block);
        for same in blocks.chunk_by(|a, b| a.0 == b.0) {
            if let Some((block, learned)) = same.last() {
                visit(*block, learned);
            }
        }
    }

    /// Reads everything; waits for the device.
    pub(super) fn export(&self, gpu: &Gpu) -> Result<ColorRows> {
        let Some(radiance) = &self.radiance else { return Ok(self.kept.clone()) };
        let rows = radiance.used_blocks as usize * self.vertices;
        let mut all = radiance.rows.export(gpu, rows)?;
        all.learned.extend_from_slice(&self.kept.learned);
        all.first.extend_from_slice(&self.kept.first);
        all.second.extend_from_slice(&self.kept.second);
        all.steps.extend_from_slice(&self.kept.steps);
        Ok(all)
    }

    /// Checks a state that is to be imported.
    pub(super) fn check(&self, state: &ColorRows) -> Result<()> {
        state.check()?;
        if !state.steps.len().is_multiple_of(self.vertices) {
            return Err(Error::corrupt("learned colours", "they end within a block"));
        }
        Ok(())
    }

    /// Takes over a checked state. On an error nothing has changed.
    pub(super) fn import(&mut self, gpu: &Gpu, state: ColorRows) -> Result<()> {
        let there = match &mut self.radiance {
            Some(radiance) => radiance.import(gpu, &state)?,
            None => 0,
        };
        let blocks = state.learned.chunks_exact(self.vertices).map(<[_]>::to_vec);
        self.heard = (0..).zip(blocks).collect();
        self.kept = ColorRows {
            learned: state.learned[there..].to_vec(),
            first: state.first[there..].to_vec(),
            second: state.second[there..].to_vec(),
            steps: state.steps[there..].to_vec(),
        };
        Ok(())
    }
}
