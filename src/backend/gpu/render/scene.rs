//! A map on the GPU as it is drawn: a copy of what a view holds, kept up by deltas, and the list of
//! its cubes.

use bytemuck::Zeroable;

use super::super::device::Gpu;
use super::super::layout::{NONE, Step};
use super::super::pool::Pool;
use super::layout;
use crate::error::Result;
use crate::modality::Row;
use crate::modality::radiance::{Harmonic, Texel};
use crate::octree::{BandScale, Cell, ChildLink, Root, Uppers};

/// What a view has, and how it divides space.
#[derive(Debug, Clone, Copy)]
pub struct Extent {
    pub root: Option<Root>,
    /// Edge length of a lattice unit, m.
    pub unit_m: f32,
    /// log2 of the largest voxels that take light, lattice units.
    pub surface_log2: u8,
    /// Edge length of an evidence cell, m.
    pub cell_m: f32,
    pub band: BandScale,
    /// Harmonics of a vertex of colour; none where colours do not depend on the direction.
    pub harmonics: usize,
    /// Slots of nodes, rows, bricks of evidence and blocks of colour.
    pub nodes: usize,
    pub rows: usize,
    pub bricks: usize,
    pub blocks: usize,
}

/// A node as a view has it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NodeRecord {
    pub link: ChildLink,
    pub corners: [u32; 8],
    /// Low corner, lattice units.
    pub low: Cell,
    /// `None` for a slot without a node.
    pub log2_size: Option<u8>,
    /// Brick of evidence and block of colour; `u32::MAX` where there is none.
    pub brick: u32,
    pub block: u32,
}

/// A block of colour as a view has it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BlockRecord<'a> {
    /// Itself and its upper neighbours.
    pub uppers: &'a Uppers,
    pub texels: &'a [Texel],
    /// Vertex by vertex; none where colours do not depend on the direction.
    pub harmonics: &'a [Harmonic],
}

/// A map's buffers. What they hold is what was written through [`super::GpuRenderer`].
#[derive(Debug)]
pub struct GpuScene {
    pub(super) links: Pool,
    pub(super) corners: Pool,
    pub(super) nodes: Pool,
    /// (d, g) by row, the features, and (f, g) with what they add.
    pub(super) rows: Pool,
    pub(super) features: Pool,
    pub(super) vertices: Pool,
    pub(super) bricks: Pool,
    pub(super) blocks: Pool,
    pub(super) texels: Pool,
    /// Vertex by vertex, all of one before the next.
    pub(super) harmonics: Pool,
    pub(super) weights: Pool,
    /// Near surfaces, and what is drawn of them.
    pub(super) leaves: Pool,
    pub(super) leaf_corners: Pool,
    pub(super) cubes: Pool,
    pub(super) cell_corners: Pool,
    /// How many leaves and cubes the lists have, on the GPU.
    pub(super) listed_leaves: wgpu::Buffer,
    pub(super) listed: wgpu::Buffer,
    pub(super) numbers: wgpu::Buffer,
    pub(super) step: wgpu::Buffer,
    pub(super) extent: Option<Extent>,
    /// The sharpness that cubes were listed for, and their number.
    pub(super) list: Option<(f32, u32)>,
}

impl GpuScene {
    pub(super) fn new(gpu: &Gpu) -> Result<Self> {
        Ok(Self {
            links: Pool::new(gpu, "drawn links", 4)?,
            corners: Pool::new(gpu, "drawn corners", 32)?,
            nodes: Pool::new(gpu, "drawn nodes", size_of::<layout::Node>() as u64)?,
            rows: Pool::new(gpu, "drawn rows", 16)?,
            features: Pool::new(gpu, "drawn features", 32)?,
            vertices: Pool::new(gpu, "drawn vertices", 16)?,
            bricks: Pool::new(gpu, "drawn bricks", 64)?,
            blocks: Pool::new(gpu, "drawn blocks", 32)?,
            texels: Pool::new(gpu, "drawn texels", 8)?,
            harmonics: Pool::new(gpu, "drawn harmonics", 8)?,
            weights: Pool::new(gpu, "drawn decoder", 16)?,
            leaves: Pool::new(gpu, "leaves", size_of::<layout::Cube>() as u64)?,
            leaf_corners: Pool::new(gpu, "corners of leaves", 128)?,
            cubes: Pool::new(gpu, "cubes", size_of::<layout::Cube>() as u64)?,
            cell_corners: Pool::new(gpu, "corners of cells", 32)?,
            listed_leaves: gpu.buffer("listed leaves", 4)?,
            listed: gpu.buffer("listed cubes", 4)?,
            numbers: gpu.buffer("scene", size_of::<layout::Scene>() as u64)?,
            step: gpu.buffer("lattice", size_of::<Step>() as u64)?,
            extent: None,
            list: None,
        })
    }

    /// Makes room for what a view has, and some more.
    pub(super) fn reserve(&mut self, gpu: &Gpu, extent: &Extent) -> Result<()> {
        let (nodes, rows) = (extent.nodes as u64, extent.rows as u64);
        for pool in [&mut self.links, &mut self.corners, &mut self.nodes] {
            pool.grow_ahead(gpu, nodes)?;
        }
        for pool in [&mut self.rows, &mut self.features, &mut self.vertices] {
            pool.grow_ahead(gpu, rows)?;
        }
        self.bricks.grow_ahead(gpu, extent.bricks as u64)?;
        self.blocks.grow_ahead(gpu, extent.blocks as u64)?;
        let vertices = (extent.blocks * extent.band.vertices()) as u64;
        self.texels.grow_ahead(gpu, vertices)?;
        self.harmonics.grow_ahead(gpu, vertices * extent.harmonics as u64)
    }

    /// Makes room for listed leaves.
    pub(super) fn reserve_leaves(&mut self, gpu: &Gpu, leaves: u64) -> Result<()> {
        self.leaves.grow_ahead(gpu, leaves)?;
        self.leaf_corners.grow_ahead(gpu, leaves)
    }

    /// Makes room for listed cubes.
    pub(super) fn reserve_cubes(&mut self, gpu: &Gpu, cubes: u64) -> Result<()> {
        self.cubes.grow_ahead(gpu, cubes)?;
        self.cell_corners.grow_ahead(gpu, cubes)
    }

    /// The octree's part of the numbers that its kernels share with those of training.
    pub(super) fn lattice(extent: &Extent) -> Step {
        let root = extent.root.unwrap_or(Root { node: NONE, min: [0; 3], log2_size: 0 });
        Step {
            root_min: root.min,
            root_node: root.node,
            unit_m: extent.unit_m,
            root_log2: root.log2_size.into(),
            rows: extent.rows as u32,
            ..Step::zeroed()
        }
    }

    /// What kernels bind, by the names that shaders have for it.
    pub(super) fn buffers(&self) -> Vec<(&'static str, wgpu::BindingResource<'_>)> {
        vec![
            ("scene", self.numbers.as_entire_binding()),
            ("step", self.step.as_entire_binding()),
            ("links", self.links.binding()),
            ("corners", self.corners.binding()),
            ("nodes", self.nodes.binding()),
            ("rows", self.rows.binding()),
            ("features", self.features.binding()),
            ("vertices", self.vertices.binding()),
            ("bricks", self.bricks.binding()),
            ("blocks", self.blocks.binding()),
            ("texels", self.texels.binding()),
            ("harmonics", self.harmonics.binding()),
            ("weights", self.weights.binding()),
            ("leaves", self.leaves.binding()),
            ("leaf_corners", self.leaf_corners.binding()),
            ("listed_leaves", self.listed_leaves.as_entire_binding()),
            ("cubes", self.cubes.binding()),
            ("cell_corners", self.cell_corners.binding()),
            ("listed", self.listed.as_entire_binding()),
        ]
    }
}

impl Extent {
    /// How much finer than the octree's the lattice of cubes is, as a log2, and log2 of the cells of
    /// the relief in its units.
    pub(super) fn cube_lattice(&self) -> (u32, u32) {
        let r0_log2 = (self.band.cell_m / self.unit_m).log2().round() as i32;
        let cell_log2 = r0_log2 - i32::from(self.band.log2_side);
        ((-cell_log2).max(0) as u32, cell_log2.max(0) as u32)
    }
}

impl NodeRecord {
    pub(super) fn words(&self) -> [u32; 8] {
        let [x, y, z] = self.low.map(|c| c as u32);
        let size = self.log2_size.map_or(0, |log2| u32::from(log2) + 1);
        [x, y, z, size, self.brick, self.block, 0, 0]
    }
}

/// A row's features as words.
pub(super) fn feature_words(row: &Row) -> [u32; 8] {
    bytemuck::cast(row.features.sdf)
}
