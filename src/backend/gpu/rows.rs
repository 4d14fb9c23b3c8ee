//! The learned columns of all vertex rows, Adam's memory of them, and what changed.

use super::device::Gpu;
use super::kernel::Kernel;
use super::layout::{self, ROW_QUADS, RowColumns};
use super::passes::Passes;
use super::pool::Pool;
use crate::backend::{LearnedRow, RowMoments};
use crate::error::Result;

const QUAD_BYTES: u64 = 16;
const COLUMNS_BYTES: u64 = ROW_QUADS as u64 * QUAD_BYTES;

/// Everything that a row has on the GPU beside its prior.
#[derive(Debug)]
pub(super) struct Rows {
    pub(super) learned: Pool,
    pub(super) first_moments: Pool,
    pub(super) second_moments: Pool,
    pub(super) steps: Pool,
    /// Fixed-point sums of the step in hand; zero between steps.
    pub(super) gradients: Pool,
    pub(super) flags: Pool,
    /// Rows of the step in hand, and rows that changed since the host read them: a number of
    /// entries, then the entries.
    pub(super) touched: Pool,
    pub(super) changed: Pool,
    /// Sums that came near the end of their range, since the beginning.
    pub(super) saturated: wgpu::Buffer,
    clear: Kernel,
}

impl Rows {
    /// What a row takes, bytes, its prior and its anchor included.
    pub(super) const ROW_BYTES: u64 = 4 * COLUMNS_BYTES + 8 + 3 * 4 + 16 + 8;

    /// Rows that a budget has room for, and the largest pool of them in one binding.
    pub(super) fn most(gpu: &Gpu, budget_bytes: u64) -> u64 {
        (budget_bytes / Self::ROW_BYTES).min((gpu.most_bytes() / COLUMNS_BYTES).saturating_sub(1))
    }

    pub(super) fn new(gpu: &Gpu) -> Result<Self> {
        Ok(Self {
            learned: Pool::new(gpu, "learned rows", COLUMNS_BYTES)?,
            first_moments: Pool::new(gpu, "first moments", COLUMNS_BYTES)?,
            second_moments: Pool::new(gpu, "second moments", COLUMNS_BYTES)?,
            steps: Pool::new(gpu, "row steps", 8)?,
            gradients: Pool::new(gpu, "gradients", COLUMNS_BYTES)?,
            flags: Pool::new(gpu, "row flags", 4)?,
            touched: Pool::new(gpu, "touched rows", 4)?,
            changed: Pool::new(gpu, "changed rows", 4)?,
            saturated: gpu.buffer("saturated", 4)?,
            clear: Kernel::new(gpu, "mirror/clear", &[])?,
        })
    }

    /// Rows that there is room for.
    pub(super) fn capacity(&self) -> u64 {
        // Growth may have failed half-way; the lists hold one word more than rows.
        self.pools().iter().map(|pool| pool.capacity()).min().unwrap_or(0).saturating_sub(1)
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> u64 {
        self.pools().iter().map(|pool| pool.bytes()).sum()
    }

    fn pools(&self) -> [&Pool; 8] {
        [
            &self.learned,
            &self.first_moments,
            &self.second_moments,
            &self.steps,
            &self.gradients,
            &self.flags,
            &self.touched,
            &self.changed,
        ]
    }

    /// Makes room for `rows`; new ones are zero.
    pub(super) fn reserve(&mut self, gpu: &Gpu, rows: u64) -> Result<()> {
        for pool in [
            &mut self.learned,
            &mut self.first_moments,
            &mut self.second_moments,
            &mut self.steps,
            &mut self.gradients,
            &mut self.flags,
            &mut self.touched,
            &mut self.changed,
        ] {
            pool.grow(gpu, rows + 1)?;
        }
        Ok(())
    }

    /// Records that rows start anew.
    pub(super) fn clear(&self, gpu: &Gpu, passes: &mut Passes, rows: &[u32]) -> Result<()> {
        let Some(rows) = gpu.upload("rows", rows)? else { return Ok(()) };
        let buffers = [
            ("rows", rows.as_entire_binding()),
            ("learned", self.learned.binding()),
            ("first_moments", self.first_moments.binding()),
            ("second_moments", self.second_moments.binding()),
            ("row_steps", self.steps.binding()),
        ];
        self.clear.bind(gpu, &buffers)?.dispatch(passes, 64);
        Ok(())
    }

    /// Reads rows and Adam's memory of them; waits for the device.
    pub(super) fn export(
        &self,
        gpu: &Gpu,
        rows: usize,
    ) -> Result<(Vec<LearnedRow>, Vec<RowMoments>)> {
        let columns = |pool: &Pool| gpu.read::<RowColumns>(&pool.buffer, rows);
        let learned = columns(&self.learned)?.iter().map(layout::learned_row).collect();
        let (first, second) = (columns(&self.first_moments)?, columns(&self.second_moments)?);
        let steps = gpu.read::<[u32; 2]>(&self.steps.buffer, rows)?;
        let moments = (0..rows).map(|row| RowMoments {
            first: first[row],
            second: second[row],
            sdf_steps: steps[row][0],
            occupancy_steps: steps[row][1],
        });
        Ok((learned, moments.collect()))
    }

    /// Writes rows and Adam's memory of them, for which there is room.
    pub(super) fn import(&self, gpu: &Gpu, learned: &[LearnedRow], moments: &[RowMoments]) {
        let columns: Vec<RowColumns> = learned.iter().map(layout::columns).collect();
        gpu.write(&self.learned.buffer, &columns);
        let first: Vec<RowColumns> = moments.iter().map(|m| m.first).collect();
        gpu.write(&self.first_moments.buffer, &first);
        let second: Vec<RowColumns> = moments.iter().map(|m| m.second).collect();
        gpu.write(&self.second_moments.buffer, &second);
        let steps: Vec<[u32; 2]> =
            moments.iter().map(|m| [m.sdf_steps, m.occupancy_steps]).collect();
        gpu.write(&self.steps.buffer, &steps);
    }
}
