//! A view put together from what changed.

use std::sync::Arc;

use bytemuck::Pod;

use super::slots::{BLOCK_BYTES, BlockSlot, NodeSlot};
use super::{Head, Part, Table};
use crate::error::{Error, Result};
use crate::map::language::Viewpoint;
use crate::map::view::{BLOCKS, BRICKS, ColorPage, MapView, NODES, Node, ROWS, Store};
use crate::modality::radiance::{self, Harmonic, Texel};
use crate::modality::{Decoders, Row, occupancy, sdf};
use crate::octree::{Cell, LIMIT, NO_BLOCK, NO_NODE, NO_ROW};
use crate::surface::Known;

/// Slots of a table at most: as many as a map of hundreds of gigabytes has.
const MAX_SLOTS: u32 = 1 << 28;
/// Viewpoints at most, which take their memory as soon as they are counted: more than there are key frames.
const MAX_VIEWPOINTS: usize = 1 << 20;

/// A later view in the making. What was told wrongly is refused, and the view before stays as it is.
pub struct Copying {
    head: Head,
    store: Store,
    decoders: Decoders,
    viewpoints: Vec<Viewpoint>,
    atoms: Vec<f32>,
}

impl Copying {
    /// Goes on from `old`, of the epoch that the head names; from nothing if it names none.
    pub fn start(head: Head, old: Option<&MapView>) -> Result<Self> {
        let old = match (head.from_epoch, old) {
            (None, _) => None,
            (Some(from), Some(old)) if old.epoch == from => Some(old),
            (Some(from), old) => {
                let ours = old.map_or("nothing".into(), |old| format!("epoch {}", old.epoch));
                let problem = format!("goes on from epoch {from}, but {ours} is here");
                return Err(Error::FailedPrecondition(problem));
            }
        };
        let config = &head.config;
        let (store, decoders, viewpoints) = match old {
            Some(old) => (old.store.clone(), (*old.decoders).clone(), old.viewpoints.to_vec()),
            None => {
                let decoders = Decoders {
                    sdf: sdf::decoder(&config.hidden, config.seed)?,
                    occupancy: occupancy::decoder(config.seed)?,
                };
                (Store::new(config), decoders, Vec::new())
            }
        };
        let learned = store.codes.learned();
        let atoms = learned.map_or_else(Vec::new, |(_, atoms)| atoms.state().atoms);
        let mut copying = Self { head, store, decoders, viewpoints, atoms };
        copying.make_room()?;
        Ok(copying)
    }

    fn make_room(&mut self) -> Result<()> {
        let count = |table| self.head.count(table);
        let root = self.head.root;
        if root.is_some_and(|r| r.node as usize >= count(Table::Nodes) || r.log2_size > 30) {
            return Err(damaged("its root is none of its nodes"));
        }
        let dimension = match &self.head.contract {
            Some(contract) => {
                contract.check("contract")?;
                contract.dimension
            }
            None if count(Table::Codes) + count(Table::Atoms) > 0 => {
                return Err(damaged("codes come without their encoder"));
            }
            None => 0,
        };
        if self.head.slots.iter().any(|count| *count > MAX_SLOTS)
            || count(Table::Viewpoints) > MAX_VIEWPOINTS
        {
            return Err(damaged("it has more slots than a map may have"));
        }
        if self.head.bounds.is_some_and(|bounds| !bounds.is_within_reach()) {
            return Err(damaged("its bounds are none of a map"));
        }
        let (nodes, rows) = (count(Table::Nodes), count(Table::Rows));
        let (bricks, colors) = (count(Table::Bricks), count(Table::Colors));
        let (codes, atoms) = (count(Table::Codes), count(Table::Atoms));
        if atoms > dimension || (colors > 0 && !self.head.config.has("radiance")) {
            return Err(damaged("its sizes do not fit its settings"));
        }
        let store = &mut self.store;
        store.root = root;
        store.bounds = self.head.bounds;
        store.node_slots = nodes;
        store.color_blocks = colors;
        store.nodes.grow(nodes.div_ceil(NODES));
        store.rows.grow(rows.div_ceil(ROWS));
        store.bricks.grow(bricks.div_ceil(BRICKS));
        store.colors.grow(colors.div_ceil(BLOCKS));
        store.codes.make_room(codes);
        self.atoms.resize(atoms * dimension, 0.0);
        self.viewpoints.resize(count(Table::Viewpoints), bytemuck::Zeroable::zeroed());
        Ok(())
    }

    /// Takes a part up.
    pub fn take(&mut self, part: &Part) -> Result<()> {
        let (slots, count) = (part.slots.len(), self.head.count(part.table));
        if slots == 0 || part.bytes.is_empty() || !part.bytes.len().is_multiple_of(slots) {
            return Err(damaged("a part has no whole slots"));
        }
        if part.slots.iter().any(|slot| *slot as usize >= count) {
            return Err(damaged("a slot is not there"));
        }
        let bytes = part.bytes.chunks_exact(part.bytes.len() / slots);
        for (slot, bytes) in part.slots.iter().map(|slot| *slot as usize).zip(bytes) {
            match part.table {
                Table::Nodes => self.node(slot, bytes)?,
                Table::Rows => {
                    let row: Row = whole(bytes)?;
                    self.store.rows.write(slot / ROWS).rows[slot % ROWS] = row;
                }
                Table::Bricks => {
                    let known: Known = whole(bytes)?;
                    self.store.bricks.write(slot / BRICKS).known[slot % BRICKS] = known;
                }
                Table::Colors => self.color(slot, bytes)?,
                Table::Codes => self.code(slot, bytes)?,
                Table::Atoms => {
                    let dimension = self.head.contract.as_ref().map_or(0, |c| c.dimension);
                    fill(&mut self.atoms[slot * dimension..(slot + 1) * dimension], bytes)?;
                }
                Table::Decoders => {
                    let Decoders { sdf, occupancy } = &mut self.decoders;
                    let decoder = if slot == 0 { sdf } else { occupancy };
                    let mut outcome = Ok(());
                    decoder.update(|own| outcome = fill(own, bytes));
                    outcome?;
                }
                Table::Viewpoints => {
                    let viewpoint: Viewpoint = whole(bytes)?;
                    if !viewpoint.is_finite() {
                        return Err(damaged("a camera is nowhere"));
                    }
                    self.viewpoints[slot] = viewpoint;
                }
            }
        }
        Ok(())
    }

    fn node(&mut self, slot: usize, bytes: &[u8]) -> Result<()> {
        let node: NodeSlot = whole(bytes)?;
        let count = |table| self.head.count(table);
        let is_in = |index: u32, none: u32, table| index == none || (index as usize) < count(table);
        let children = (node.children >> 8) as usize * 8 + 7;
        // Rows at all corners, or at none.
        let has_rows = node.corners.iter().all(|row| (*row as usize) < count(Table::Rows));
        let fits = (has_rows || node.corners == [NO_ROW; 8])
            && (node.children & 0xff == 0 || children < count(Table::Nodes))
            && is_in(node.brick, NO_NODE, Table::Bricks)
            && is_in(node.block, NO_BLOCK, Table::Colors)
            && is_in(node.code_block, NO_BLOCK, Table::Codes)
            && (node.log2_size <= 30 || node.log2_size == u32::from(u8::MAX));
        if !fits {
            return Err(damaged("a node refers to what is not there"));
        }
        let page = self.store.nodes.write(slot / NODES);
        page.children[slot % NODES] = node.children;
        page.nodes[slot % NODES] = Node {
            corners: node.corners,
            brick: node.brick,
            block: node.block,
            code_block: node.code_block,
            low: node.low,
            log2_size: node.log2_size as u8,
        };
        Ok(())
    }

    fn color(&mut self, slot: usize, bytes: &[u8]) -> Result<()> {
        let (vertices, degree) = (self.store.band.vertices(), self.store.color_degree);
        let width = vertices * radiance::harmonics(degree);
        let (head, values) = block(bytes, self.head.count(Table::Colors))?;
        let (texels, harmonics) = values
            .split_at_checked(vertices * size_of::<Texel>())
            .ok_or_else(|| damaged("a slot has the wrong length"))?;
        let page = self.store.colors.write(slot / BLOCKS);
        page.texels.resize(BLOCKS * vertices, Texel::default());
        page.harmonics.resize(BLOCKS * width, Harmonic::default());
        let i = slot % BLOCKS;
        (page.cells[i], page.uppers[i]) = (head.cell, head.uppers);
        fill(&mut page.texels[i * vertices..(i + 1) * vertices], texels)?;
        fill(&mut page.harmonics[i * width..(i + 1) * width], harmonics)
    }

    fn code(&mut self, slot: usize, bytes: &[u8]) -> Result<()> {
        let (head, values) = block(bytes, self.head.count(Table::Codes))?;
        let width = self.head.count(Table::Atoms);
        let fits = self.store.codes.set_block(slot, (head.cell, head.uppers), width, values);
        fits.ok_or_else(|| damaged("a block of codes has the wrong length"))
    }

    /// The later view.
    pub fn finish(mut self) -> Result<MapView> {
        let store = &self.store;
        let is_written = |page: &ColorPage| !page.texels.is_empty();
        if !store.colors.pages().all(is_written) || !store.codes.is_written() {
            return Err(damaged("a block was not told"));
        }
        if let Some(contract) = self.head.contract {
            self.store.codes.learn(contract, &self.atoms)?;
        }
        Ok(MapView {
            epoch: self.head.epoch,
            newest_stamp_ns: self.head.newest_stamp_ns,
            config: self.head.config,
            decoders: Arc::new(self.decoders),
            store: self.store,
            viewpoints: self.viewpoints.into(),
        })
    }
}

/// Where a block is and what it holds; `count` blocks are there.
fn block(bytes: &[u8], count: usize) -> Result<(BlockSlot, &[u8])> {
    let (head, values) =
        bytes.split_at_checked(BLOCK_BYTES).ok_or_else(|| damaged("a block is cut short"))?;
    let head: BlockSlot = whole(head)?;
    let is_there = |block: &u32| *block == NO_BLOCK || (*block as usize) < count;
    let is_on_lattice = |cell: Cell| cell.iter().all(|c| (-LIMIT..LIMIT).contains(c));
    if head.uppers.iter().all(is_there) && is_on_lattice(head.cell) {
        Ok((head, values))
    } else {
        Err(damaged("a block refers to what is not there"))
    }
}

fn whole<T: Pod>(bytes: &[u8]) -> Result<T> {
    bytemuck::try_pod_read_unaligned(bytes).map_err(|_| damaged("a slot has the wrong length"))
}

fn fill<T: Pod>(to: &mut [T], bytes: &[u8]) -> Result<()> {
    let to: &mut [u8] = bytemuck::cast_slice_mut(to);
    if to.len() != bytes.len() {
        return Err(damaged("a slot has the wrong length"));
    }
    to.copy_from_slice(bytes);
    Ok(())
}

fn damaged(problem: &str) -> Error {
    Error::corrupt("mirror", problem)
}
