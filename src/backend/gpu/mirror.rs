//! The GPU's copy of what the host owns: nodes and the prior of rows, kept up to date by deltas.

use super::device::Gpu;
use super::kernel::Kernel;
use super::passes::Passes;
use super::pool::Pool;
use super::shader::Constant;
use crate::backend::Changes;
use crate::error::Result;
use crate::octree::{Explicit, NodeSource};

/// Workgroups of a kernel that loops over what it is given.
const GROUPS: u32 = 64;

/// Nodes and priors on the GPU.
#[derive(Debug)]
pub(super) struct Mirror {
    /// Child link by node.
    pub(super) links: Pool,
    /// Rows of the corners by node.
    pub(super) corners: Pool,
    /// Prior (d, g) by row.
    pub(super) prior: Pool,
    write_word: Kernel,
    write_prior: Kernel,
    write_corners: Kernel,
}

impl Mirror {
    pub(super) fn new(gpu: &Gpu) -> Result<Self> {
        let write =
            |words: u32| Kernel::new(gpu, "mirror/write", &[("WORDS", Constant::U32(words))]);
        Ok(Self {
            links: Pool::new(gpu, "links", 4)?,
            corners: Pool::new(gpu, "corners", 32)?,
            prior: Pool::new(gpu, "prior", 16)?,
            write_word: write(1)?,
            write_prior: write(4)?,
            write_corners: write(8)?,
        })
    }

    /// Makes room for as many nodes as a scene has, and some more.
    pub(super) fn reserve_nodes(&mut self, gpu: &Gpu, nodes: u64) -> Result<()> {
        if nodes > self.links.capacity().min(self.corners.capacity()) {
            let room = nodes + nodes / 2;
            self.links.grow(gpu, room)?;
            self.corners.grow(gpu, room)?;
        }
        Ok(())
    }

    /// Records what brings the copy up to date.
    pub(super) fn follow(
        &self,
        gpu: &Gpu,
        passes: &mut Passes,
        (nodes, prior): (&impl NodeSource, &[Explicit]),
        changes: &Changes<'_>,
    ) -> Result<()> {
        let links = changes.nodes.iter().flat_map(|&n| [n, nodes.children(n)]);
        write(gpu, passes, &self.write_word, &self.links, links.collect())?;
        let corners = changes.nodes.iter().flat_map(|&node| {
            let mut record = [node; 9];
            record[1..].copy_from_slice(nodes.corners(node));
            record
        });
        write(gpu, passes, &self.write_corners, &self.corners, corners.collect())?;
        let priors = changes.rows.iter().flat_map(|&row| {
            let [d, x, y, z] = prior[row as usize].map(f32::to_bits);
            [row, d, x, y, z]
        });
        write(gpu, passes, &self.write_prior, &self.prior, priors.collect())
    }
}

/// Records that `records` (index and words each) are written to their places in a pool.
fn write(
    gpu: &Gpu,
    passes: &mut Passes,
    kernel: &Kernel,
    pool: &Pool,
    records: Vec<u32>,
) -> Result<()> {
    let Some(records) = gpu.upload("records", &records)? else { return Ok(()) };
    let buffers = [("records", records.as_entire_binding()), ("pool", pool.binding())];
    kernel.bind(gpu, &buffers)?.dispatch(passes, GROUPS);
    Ok(())
}
