//! What a mapper and a view give to storage and take back.

use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::codes::ViewCodesState;
use super::language::Viewpoint;
use super::mapper::{MapStats, Mapper};
use super::robots::Robots;
use super::timeline::Timeline;
use super::view::{BRICKS, MapView, NODES, Node, ROWS, Store};
use crate::backend::{Backend, BackendState, CpuBackend};
use crate::config::MapConfig;
use crate::error::{Error, Result};
use crate::geometry::Aabb;
use crate::modality::language::{LanguageField, LanguageState};
use crate::modality::radiance::Texel;
use crate::modality::{Decoders, Row, occupancy, sdf};
use crate::octree::{Band, Cell, ChildLink, NO_BLOCK, NO_NODE, NO_ROW, Root, TopologyState};
use crate::surface::{Known, Lattice, SurfaceState};
use crate::train::KeyFramesState;

/// How far a map has come.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct Progress {
    pub stats: MapStats,
    pub newest_stamp_ns: i64,
    pub idle_steps: u32,
    /// Whether the map has changed since its newest epoch.
    pub changed: bool,
}

/// A mapper from which another goes on, bit for bit under `fixed`.
#[derive(Debug)]
pub struct MapperState<'a> {
    pub progress: Progress,
    pub topology: TopologyState<'a>,
    pub surface: SurfaceState<'a>,
    pub robots: Robots,
    pub timeline: Timeline,
    pub key_frames: KeyFramesState,
    pub backend: BackendState,
    /// Where the map has language.
    pub language: Option<LanguageState<'a>>,
}

impl Mapper {
    /// The whole state, borrowed where it is large.
    pub fn state(&self) -> Result<MapperState<'_>> {
        Ok(MapperState {
            progress: Progress {
                stats: self.stats.clone(),
                newest_stamp_ns: self.newest_stamp_ns,
                idle_steps: self.idle_steps,
                changed: self.changed,
            },
            topology: self.topology.state(),
            surface: self.surface.state(),
            robots: self.robots.clone(),
            timeline: self.timeline.clone(),
            key_frames: self.key_frames.state(),
            backend: self.backend.export()?,
            language: self.language.as_ref().map(LanguageField::state),
        })
    }

    /// A mapper with the state of another. The settings are that one's too, except for those that
    /// [`MapConfig::resumed`] takes from the machine.
    pub fn from_state(config: MapConfig, state: MapperState<'_>) -> Result<Self> {
        let mut mapper = Self::without_given(config, 0)?;
        mapper.stats = state.progress.stats;
        mapper.newest_stamp_ns = state.progress.newest_stamp_ns;
        mapper.idle_steps = state.progress.idle_steps;
        mapper.changed = state.progress.changed;
        mapper.topology = mapper.topology.with_state(state.topology)?;
        let rows = mapper.topology.rows();
        mapper.surface = mapper.surface.with_state(state.surface, rows)?;
        mapper.language = match (mapper.language, state.language) {
            (Some(language), Some(state)) => Some(language.with_state(state)?.with_given()?),
            (None, None) => None,
            _ => return Err(Error::corrupt("language", "does not fit the settings")),
        };
        mapper.robots = state.robots.checked()?;
        mapper.timeline = state.timeline.checked()?;
        mapper.key_frames = mapper.key_frames.with_state(state.key_frames)?;
        if state.backend.learned.len() != rows {
            return Err(Error::corrupt("learned rows", "differ in number from the octree's"));
        }
        mapper.no_prior.resize(rows, [0.0; 4]);
        mapper.changed_rows = (0..rows as u32).collect();
        mapper.changed_nodes = mapper.topology.take_changed_nodes();
        let mut backend = CpuBackend::new(&mapper.config, mapper.trainers.clone())?;
        mapper.introduce(&mut backend)?;
        backend.import(state.backend)?;
        mapper.backend = Box::new(backend);
        let blocks = mapper.surface.color.as_ref().map_or(0, |color| color.band.blocks());
        mapper.changed_colors = (0..blocks as u32).collect();
        let blocks = mapper.language.as_ref().map_or(0, |language| language.band.blocks());
        mapper.changed_codes = (0..blocks as u32).collect();
        mapper.changed_bricks = (0..mapper.surface.evidence.bricks() as u32).collect();
        Ok(mapper)
    }
}

/// The small part of a stored view.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub struct ViewRecord {
    epoch: u64,
    newest_stamp_ns: i64,
    root: Option<Root>,
    bounds: Option<Aabb>,
    sdf_weights: Vec<f32>,
    occupancy_weights: Vec<f32>,
}

/// A stored view: what answers, and nothing else.
#[derive(Debug)]
pub struct ViewState {
    pub record: ViewRecord,
    pub children: Vec<ChildLink>,
    pub corners: Vec<[u32; 8]>,
    pub low_corners: Vec<Cell>,
    pub log2_sizes: Vec<u8>,
    pub node_bricks: Vec<u32>,
    pub rows: Vec<Row>,
    pub known: Vec<Known>,
    /// The cells of the blocks of colour, which say which nodes they belong to.
    pub color_cells: Vec<Cell>,
    pub texels: Vec<Texel>,
    pub codes: ViewCodesState,
    /// Where the map was seen from.
    pub viewpoints: Vec<Viewpoint>,
}

impl MapView {
    /// All that the view holds, page by page.
    pub fn state(&self) -> ViewState {
        let store = &self.store;
        let mut state = ViewState {
            record: ViewRecord {
                epoch: self.epoch,
                newest_stamp_ns: self.newest_stamp_ns,
                root: store.root,
                bounds: store.bounds,
                sdf_weights: self.decoders.sdf.weights().to_vec(),
                occupancy_weights: self.decoders.occupancy.weights().to_vec(),
            },
            children: Vec::new(),
            corners: Vec::new(),
            low_corners: Vec::new(),
            log2_sizes: Vec::new(),
            node_bricks: Vec::new(),
            rows: Vec::new(),
            known: Vec::new(),
            color_cells: Vec::new(),
            texels: Vec::new(),
            codes: store.codes.state(),
            viewpoints: self.viewpoints.to_vec(),
        };
        for page in store.nodes.pages() {
            state.children.extend(page.children);
            state.corners.extend(page.nodes.iter().map(|n| n.corners));
            state.low_corners.extend(page.nodes.iter().map(|n| n.low));
            state.log2_sizes.extend(page.nodes.iter().map(|n| n.log2_size));
            state.node_bricks.extend(page.nodes.iter().map(|n| n.brick));
        }
        for page in store.rows.pages() {
            state.rows.extend(page.rows);
        }
        state.known.extend(store.bricks.pages().flat_map(|page| page.known));
        for page in store.colors.pages() {
            state.color_cells.extend(page.cells);
            state.texels.extend_from_slice(&page.texels);
        }
        state.color_cells.truncate(store.color_blocks);
        state.texels.truncate(store.color_blocks * store.band.vertices());
        state
    }

    /// A view from a stored state.
    pub fn from_state(config: MapConfig, state: ViewState) -> Result<Self> {
        check(&state)?;
        let lattice = Lattice::new(&config);
        let record = state.record;
        let mut store = Store {
            root: record.root,
            bounds: record.bounds,
            node_slots: state.children.len(),
            ..Store::new(&config)
        };
        let band = Band::with_cells(store.band, &state.color_cells)
            .filter(|band| band.rows() == state.texels.len())
            .ok_or_else(|| Error::corrupt("view", "blocks of colour do not fit together"))?;
        store.write_colors(&band, 0..band.blocks() as u32, |block, texels| {
            let rows = block as usize * texels.len();
            texels.copy_from_slice(&state.texels[rows..rows + texels.len()]);
        });
        let coded = store
            .codes
            .with_state(state.codes)
            .ok_or_else(|| Error::corrupt("view", "blocks of codes do not fit together"))?;
        let code_cell = lattice.code_cell(&config);
        store.nodes.grow(state.children.len().div_ceil(NODES));
        for node in 0..state.children.len() {
            let (page, i) = (store.nodes.write(node / NODES), node % NODES);
            page.children[i] = state.children[node];
            let (cell, log2_size) = (state.low_corners[node], state.log2_sizes[node]);
            let painted = log2_size <= lattice.r0 && state.corners[node][0] != NO_ROW;
            let block = painted.then(|| band.find(cell.map(|c| c >> lattice.r0))).flatten();
            let code_block = painted.then(|| coded.find(cell.map(|c| c >> code_cell))).flatten();
            page.nodes[i] = Node {
                corners: state.corners[node],
                brick: state.node_bricks[node],
                block: block.unwrap_or(NO_BLOCK),
                code_block: code_block.unwrap_or(NO_BLOCK),
                low: cell,
                log2_size,
            };
        }
        store.rows.grow(state.rows.len().div_ceil(ROWS));
        for (row, values) in state.rows.iter().enumerate() {
            store.rows.write(row / ROWS).rows[row % ROWS] = *values;
        }
        store.bricks.grow(state.known.len().div_ceil(BRICKS));
        for (brick, known) in state.known.iter().enumerate() {
            store.bricks.write(brick / BRICKS).known[brick % BRICKS] = *known;
        }
        let mut decoders = Decoders {
            sdf: sdf::decoder(&config.hidden, config.seed)?,
            occupancy: occupancy::decoder(config.seed)?,
        };
        for (decoder, weights) in [
            (&mut decoders.sdf, &record.sdf_weights),
            (&mut decoders.occupancy, &record.occupancy_weights),
        ] {
            if decoder.weights().len() != weights.len() {
                return Err(Error::corrupt("decoder", "its weights do not fit the settings"));
            }
            decoder.update(|own| own.copy_from_slice(weights));
        }
        Ok(Self {
            epoch: record.epoch,
            newest_stamp_ns: record.newest_stamp_ns,
            config: Arc::new(config),
            decoders: Arc::new(decoders),
            store,
            viewpoints: state.viewpoints.into(),
        })
    }
}

/// Every index in a stored view refers to something that is there.
fn check(state: &ViewState) -> Result<()> {
    let (slots, rows, bricks) = (state.children.len(), state.rows.len(), state.known.len());
    let nodes = [
        state.corners.len(),
        state.low_corners.len(),
        state.log2_sizes.len(),
        state.node_bricks.len(),
    ];
    let row_exists = |r: &u32| *r == NO_ROW || (*r as usize) < rows;
    let child_exists = |l: &ChildLink| l & 0xff == 0 || (*l >> 8) as usize * 8 + 7 < slots;
    let brick_exists = |b: &u32| *b == NO_NODE || (*b as usize) < bricks;
    let fits = nodes.iter().all(|&n| n == slots)
        && state.corners.iter().flatten().all(row_exists)
        && state.children.iter().all(child_exists)
        && state.node_bricks.iter().all(brick_exists)
        && state.viewpoints.iter().all(Viewpoint::is_finite)
        && state.log2_sizes.iter().all(|&s| s == u8::MAX || s <= 30)
        && state.record.root.is_none_or(|r| (r.node as usize) < slots && r.log2_size <= 30);
    if fits { Ok(()) } else { Err(Error::corrupt("view", "columns do not fit together")) }
}
