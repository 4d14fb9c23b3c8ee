//! An immutable view of the map at one epoch.

use std::sync::Arc;

use glam::Vec3;

use super::codes::ViewCodes;
use super::language::Viewpoint;
use super::pages::PageTable;
use crate::config::MapConfig;
use crate::geometry::{Aabb, floor};
use crate::modality::radiance::{self, ColorCell, Harmonic, Texel, TexelSource};
use crate::modality::{Decoders, Row, RowSource};
use crate::octree::{
    Band, BandScale, Cell, ChildLink, NO_BLOCK, NO_NODE, NO_ROW, NodeSource, Root, Uppers,
};
use crate::surface::{BRICK_CELLS, ColorField, Known, Lattice};

pub(super) const NODES: usize = 256;
pub(super) const ROWS: usize = 128;
pub(super) const BRICKS: usize = 64;
/// Blocks of colour of a page.
pub(super) const BLOCKS: usize = 8;

/// Nodes of a page. Links are apart from the rest, because a descent reads those of eight siblings
/// and the rest of one node alone.
#[derive(Clone)]
pub(super) struct NodePage {
    pub children: [ChildLink; NODES],
    pub nodes: [Node; NODES],
}

/// What a descent finds, in one cache line.
#[derive(Clone, Copy)]
#[repr(align(64))]
pub(super) struct Node {
    pub corners: [u32; 8],
    /// The evidence brick that holds the node's cells; [`NO_NODE`] where nothing was observed.
    pub brick: u32,
    /// The block of colour of the level-0 voxel that the node is or lies in; [`NO_BLOCK`] where no
    /// surface was seen.
    pub block: u32,
    /// The block of codes around; [`NO_BLOCK`] where no features were seen.
    pub code_block: u32,
    /// Low corner, lattice units.
    pub low: [i32; 3],
    /// `u8::MAX` for a hole.
    pub log2_size: u8,
}

impl Default for NodePage {
    fn default() -> Self {
        let hole = Node {
            corners: [NO_ROW; 8],
            brick: NO_NODE,
            block: NO_BLOCK,
            code_block: NO_BLOCK,
            low: [0; 3],
            log2_size: u8::MAX,
        };
        Self { children: [0; NODES], nodes: [hole; NODES] }
    }
}

/// Vertex rows of a page.
#[derive(Clone)]
pub(super) struct RowPage {
    pub rows: [Row; ROWS],
}

impl Default for RowPage {
    fn default() -> Self {
        Self { rows: [Row::default(); ROWS] }
    }
}

/// Known masks of evidence bricks.
#[derive(Clone)]
pub(super) struct BrickPage {
    pub known: [Known; BRICKS],
}

impl Default for BrickPage {
    fn default() -> Self {
        Self { known: [[0; 8]; BRICKS] }
    }
}

/// Blocks of colour of a page.
#[derive(Clone)]
pub(super) struct ColorPage {
    pub cells: [Cell; BLOCKS],
    pub uppers: [Uppers; BLOCKS],
    /// The vertices of block after block; empty until the page is written.
    pub texels: Vec<Texel>,
    /// Their harmonics; empty too where the map's colours have none.
    pub harmonics: Vec<Harmonic>,
}

impl Default for ColorPage {
    fn default() -> Self {
        Self {
            cells: [[0; 3]; BLOCKS],
            uppers: [[NO_BLOCK; 8]; BLOCKS],
            texels: Vec::new(),
            harmonics: Vec::new(),
        }
    }
}

/// The shared part of a map: what the mapper writes and a view reads.
#[derive(Clone)]
pub(super) struct Store {
    pub root: Option<Root>,
    pub unit_m: f32,
    pub cell_m: f32,
    pub bounds: Option<Aabb>,
    pub node_slots: usize,
    pub nodes: PageTable<NodePage>,
    pub rows: PageTable<RowPage>,
    pub bricks: PageTable<BrickPage>,
    /// Bricks that the nodes in them know of.
    pub placed_bricks: usize,
    /// How the band of colour divides level-0 voxels.
    pub band: BandScale,
    /// Of the harmonics of colours.
    pub color_degree: u8,
    pub color_blocks: usize,
    pub colors: PageTable<ColorPage>,
    pub codes: ViewCodes,
}

impl NodeSource for Store {
    fn root(&self) -> Option<Root> {
        self.root
    }

    fn unit_m(&self) -> f32 {
        self.unit_m
    }

    #[inline]
    fn children(&self, node: u32) -> ChildLink {
        self.nodes.page(node as usize / NODES).children[node as usize % NODES]
    }

    #[inline]
    fn corners(&self, node: u32) -> &[u32; 8] {
        &self.node(node).corners
    }
}

impl RowSource for Store {
    #[inline]
    fn row(&self, row: u32) -> &Row {
        &self.rows.page(row as usize / ROWS).rows[row as usize % ROWS]
    }
}

impl TexelSource for Store {
    fn band(&self) -> BandScale {
        self.band
    }

    #[inline]
    fn uppers(&self, block: u32) -> &Uppers {
        &self.colors.page(block as usize / BLOCKS).uppers[block as usize % BLOCKS]
    }

    #[inline]
    fn texel(&self, row: u32) -> Texel {
        let (page, at) = self.color_place(row);
        page.texels[at]
    }

    fn degree(&self) -> u8 {
        self.color_degree
    }

    #[inline]
    fn harmonics(&self, row: u32) -> &[Harmonic] {
        let ((page, at), width) = (self.color_place(row), radiance::harmonics(self.color_degree));
        &page.harmonics[at * width..(at + 1) * width]
    }
}

impl Store {
    /// Nothing mapped yet.
    pub(super) fn new(config: &MapConfig) -> Self {
        let lattice = Lattice::new(config);
        Self {
            root: None,
            unit_m: lattice.unit_m,
            cell_m: lattice.size_m(lattice.cell),
            bounds: None,
            node_slots: 0,
            nodes: PageTable::default(),
            rows: PageTable::default(),
            bricks: PageTable::default(),
            placed_bricks: 0,
            band: ColorField::scale(config)
                .unwrap_or(BandScale { cell_m: config.r0_m, log2_side: 0 }),
            color_degree: config.radiance.degree,
            color_blocks: 0,
            colors: PageTable::default(),
            codes: ViewCodes::new(config),
        }
    }

    /// Where a vertex of colour is.
    #[inline]
    fn color_place(&self, row: u32) -> (&ColorPage, usize) {
        // Divided by shifting: the compiler cannot know that a page is a power of two of texels.
        let log2_page = BLOCKS.ilog2() + 3 * u32::from(self.band.log2_side);
        let (page, at) = (row >> log2_page, row & ((1 << log2_page) - 1));
        (self.colors.page(page as usize), at as usize)
    }

    /// What a block of colour takes in pages, bytes.
    pub(super) fn block_bytes(band: BandScale, degree: u8) -> usize {
        let vertex = size_of::<Texel>() + radiance::harmonics(degree) * size_of::<Harmonic>();
        size_of::<Cell>() + size_of::<Uppers>() + band.vertices() * vertex
    }

    /// Writes blocks of colour; `fill` sets the vertices of one.
    pub(super) fn write_colors(
        &mut self,
        band: &Band,
        blocks: impl IntoIterator<Item = u32>,
        mut fill: impl FnMut(u32, &mut [Texel], &mut [Harmonic]),
    ) {
        let vertices = band.scale.vertices();
        let width = radiance::harmonics(self.color_degree) * vertices;
        self.color_blocks = band.blocks();
        self.colors.grow(self.color_blocks.div_ceil(BLOCKS));
        for block in blocks {
            let page = self.colors.write(block as usize / BLOCKS);
            page.texels.resize(BLOCKS * vertices, Texel::default());
            page.harmonics.resize(BLOCKS * width, Harmonic::default());
            let slot = block as usize % BLOCKS;
            page.cells[slot] = band.cells()[block as usize];
            page.uppers[slot] = *band.uppers(block);
            let texels = &mut page.texels[slot * vertices..][..vertices];
            fill(block, texels, &mut page.harmonics[slot * width..][..width]);
        }
    }

    /// The colour at a point of a node.
    #[inline]
    pub(super) fn color(&self, node: u32, point: Vec3) -> Option<Vec3> {
        let block = self.node(node).block;
        if block == NO_BLOCK { None } else { radiance::color(self, block, point) }
    }

    /// The cell of the band around a point of a node, if it has a colour that is alike from everywhere.
    pub(super) fn color_cell(&self, node: u32, point: Vec3) -> Option<ColorCell> {
        let block = self.node(node).block;
        (block != NO_BLOCK && self.degree() == 0).then(|| ColorCell::at(self, block, point))
    }

    /// The colour at a point of a node as it is seen along a direction, world axes.
    #[inline]
    pub(super) fn color_along(&self, node: u32, point: Vec3, direction: Vec3) -> Option<Vec3> {
        let block = self.node(node).block;
        let is_there = block != NO_BLOCK;
        is_there.then(|| radiance::color_along(self, block, point, direction)).flatten()
    }

    /// Writes the code at a point of a node to `out`; false where no features were seen.
    #[inline]
    pub(super) fn code(&self, node: u32, point: Vec3, out: &mut [f32]) -> bool {
        let block = self.node(node).code_block;
        block != NO_BLOCK && self.codes.code_at(block, point, out)
    }

    /// What a row, a node slot and a brick take in pages, bytes.
    pub(super) const ROW_BYTES: usize = size_of::<RowPage>() / ROWS;
    pub(super) const NODE_BYTES: usize = size_of::<NodePage>() / NODES;
    pub(super) const BRICK_BYTES: usize = size_of::<BrickPage>() / BRICKS;

    /// Bytes of all pages.
    pub(super) fn bytes(&self) -> u64 {
        (self.rows.len() * size_of::<RowPage>()
            + self.nodes.len() * size_of::<NodePage>()
            + self.bricks.len() * size_of::<BrickPage>()
            + self.color_blocks * Self::block_bytes(self.band, self.color_degree)) as u64
            + self.codes.bytes()
    }

    #[inline]
    pub(super) fn node(&self, node: u32) -> &Node {
        &self.nodes.page(node as usize / NODES).nodes[node as usize % NODES]
    }

    /// Which evidence cells around a voxel were crossed or hit; `None` where nothing was observed.
    #[inline]
    pub(super) fn known(&self, node: u32) -> Option<&Known> {
        let brick = self.node(node).brick as usize;
        (brick != NO_NODE as usize).then(|| &self.bricks.page(brick / BRICKS).known[brick % BRICKS])
    }

    /// Whether `known`, of the voxel around a point, holds the cell of the point.
    #[inline]
    pub(super) fn holds(&self, known: &Known, point: Vec3) -> bool {
        holds_cell(known, point.to_array().map(|x| self.cell_along(x)))
    }

    /// The evidence cell of a coordinate, from the low end of its brick.
    #[inline]
    pub(super) fn cell_along(&self, x: f32) -> usize {
        (floor(x / self.cell_m) & (BRICK_CELLS - 1)) as usize
    }
}

/// Whether a cell of a brick is known.
#[inline]
pub(super) fn holds_cell(known: &Known, [x, y, z]: [usize; 3]) -> bool {
    let index = x | y << 3 | z << 6;
    known[index >> 6] >> (index & 63) & 1 == 1
}

/// The map at one epoch. Cheap to share (`Arc`); never changes.
pub struct MapView {
    pub(super) epoch: u64,
    pub(super) newest_stamp_ns: i64,
    pub(super) config: Arc<MapConfig>,
    pub(super) decoders: Arc<Decoders>,
    pub(super) store: Store,
    /// Where the map was seen from.
    pub(super) viewpoints: Arc<[Viewpoint]>,
}

impl MapView {
    /// The number of this view among those that were published: it grows with every update, be it
    /// of frames or of refinement while none came. Frames are counted apart (`MapStats::frames`).
    pub fn epoch(&self) -> u64 {
        self.epoch
    }

    /// Capture time of the newest frame in the view, Unix ns; 0 before the first.
    pub fn newest_stamp_ns(&self) -> i64 {
        self.newest_stamp_ns
    }

    /// The settings that the map was made with.
    pub fn config(&self) -> &MapConfig {
        &self.config
    }

    /// The box around everything observed, world metres; empty for an empty map.
    pub fn bounds(&self) -> Aabb {
        self.store.bounds.unwrap_or(Aabb::EMPTY)
    }

    /// Boxes (world metres) of the finest leaves that may hold a part of the surface: some corner
    /// lies nearer to it than the leaf's diagonal.
    pub fn surface_leaves(&self) -> Vec<Aabb> {
        let store = &self.store;
        let mut boxes = Vec::new();
        for node in 0..store.node_slots {
            let page = store.nodes.page(node / NODES);
            let i = node % NODES;
            let Node { corners, low, log2_size, .. } = &page.nodes[i];
            if *log2_size == u8::MAX
                || corners[0] == NO_ROW
                || page.children[i] & 0xff == 0xff
                || (1u64 << log2_size) as f32 * store.unit_m > 1.01 * self.config.r0_m
            {
                continue;
            }
            let size = (1u64 << log2_size) as f32 * store.unit_m;
            let near = |&row: &u32| store.row(row).explicit[0].abs() < 1.7321 * size;
            if corners.iter().any(near) {
                let low = Vec3::from(low.map(|c| c as f32)) * store.unit_m;
                boxes.push(Aabb { min: low, max: low + size });
            }
        }
        boxes
    }
}
