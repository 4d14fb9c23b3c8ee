//! The GPU's copy of the host's octree: nodes and the prior of rows, kept up to date by deltas.

use super::device::Gpu;
use super::pool::Pool;
use super::writes::Writes;
use crate::backend::Changes;
use crate::error::Result;
use crate::octree::{Explicit, NodeSource};

/// Nodes and priors on the GPU.
#[derive(Debug)]
pub(super) struct Mirror {
    /// Child link by node.
    pub(super) links: Pool,
    /// Rows of the corners by node.
    pub(super) corners: Pool,
    /// Prior (d, g) by row.
    pub(super) prior: Pool,
}

impl Mirror {
    pub(super) fn new(gpu: &Gpu) -> Result<Self> {
        Ok(Self {
            links: Pool::new(gpu, "links", 4)?,
            corners: Pool::new(gpu, "corners", 32)?,
            prior: Pool::new(gpu, "prior", 16)?,
        })
    }

    /// Makes room for as many nodes as a scene has, and some more.
    pub(super) fn reserve_nodes(&mut self, gpu: &Gpu, nodes: u64) -> Result<()> {
        self.links.grow_ahead(gpu, nodes)?;
        self.corners.grow_ahead(gpu, nodes)
    }

    /// Adds what brings the copy up to date.
    pub(super) fn follow<'a>(
        &'a self,
        writes: &mut Writes<'a>,
        (nodes, prior): (&impl NodeSource, &[Explicit]),
        changes: &Changes<'_>,
    ) {
        let changed = || changes.nodes.iter().copied();
        writes.add(&self.links, changed().map(|node| (node, [nodes.children(node)])));
        writes.add(&self.corners, changed().map(|node| (node, *nodes.corners(node))));
        let rows = changes.rows.iter().copied();
        writes.add(&self.prior, rows.map(|row| (row, prior[row as usize].map(f32::to_bits))));
    }
}
