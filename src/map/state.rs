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
use crate::modality::radiance::{self, Harmonic, Texel};
use crate::modality::{Decoders, Row, occupancy, sdf};
use crate::octree::{
    Band, Cell, ChildLink, NO_BLOCK, NO_NODE, NO_ROW, Root, StoredNodes, TopologyState,
};
use crate::surface::{Known, Lattice, SurfaceState};
use crate::train::KeyFramesState;

/// More than any map counts of anything: that many nanoseconds are 36 years.
const MAX_COUNT: u64 = 1 << 60;

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
        let MapStats { epoch, frames, frames_empty, steps, .. } = mapper.stats;
        if [epoch, frames, frames_empty, steps].iter().any(|count| *count > MAX_COUNT) {
            return Err(Error::corrupt("progress", "counts are larger than any that was written"));
        }
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
    /// Their harmonics, vertex by vertex.
    pub harmonics: Vec<Harmonic>,
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
            harmonics: Vec::new(),
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
            state.harmonics.extend_from_slice(&page.harmonics);
        }
        state.color_cells.truncate(store.color_blocks);
        let vertices = store.color_blocks * store.band.vertices();
        state.texels.truncate(vertices);
        state.harmonics.truncate(vertices * radiance::harmonics(store.color_degree));
        state
    }

    /// A view from a stored state.
    pub fn from_state(config: MapConfig, state: ViewState) -> Result<Self> {
        let lattice = Lattice::new(&config);
        check(&state, lattice.brick)?;
        let record = state.record;
        let mut store = Store {
            root: record.root,
            bounds: record.bounds,
            node_slots: state.children.len(),
            ..Store::new(&config)
        };
        let harmonics = state.harmonics.len();
        let band = colored(&store, &state.color_cells, (state.texels.len(), harmonics))?;
        store.write_colors(&band, 0..band.blocks() as u32, |block, texels, harmonics| {
            copy_block(block, &state.texels, texels);
            copy_block(block, &state.harmonics, harmonics);
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

/// The blocks of colour of a stored view with so many texels and harmonics.
fn colored(store: &Store, cells: &[Cell], lengths: (usize, usize)) -> Result<Band> {
    let width = radiance::harmonics(store.color_degree);
    let fits = |band: &Band| (band.rows(), band.rows() * width) == lengths;
    Band::with_cells(store.band, cells)
        .filter(fits)
        .ok_or_else(|| Error::corrupt("view", "blocks of colour do not fit together"))
}

/// What a block has of a column of all.
fn copy_block<T: Copy>(block: u32, all: &[T], to: &mut [T]) {
    let from = block as usize * to.len();
    to.copy_from_slice(&all[from..from + to.len()]);
}

/// Every index in a stored view refers to something that is there.
fn check(state: &ViewState, coarsest_log2: u8) -> Result<()> {
    let (rows, bricks) = (state.rows.len(), state.known.len());
    let nodes = StoredNodes {
        root: state.record.root,
        children: &state.children,
        corners: &state.corners,
        low_corners: &state.low_corners,
        log2_sizes: &state.log2_sizes,
    };
    let brick_exists = |b: &u32| *b == NO_NODE || (*b as usize) < bricks;
    let fits = nodes.count(coarsest_log2, |row, _| (row as usize) < rows).is_some()
        && state.node_bricks.len() == state.children.len()
        && state.node_bricks.iter().all(brick_exists)
        && state.record.bounds.is_none_or(|bounds| bounds.is_within_reach())
        && state.viewpoints.iter().all(Viewpoint::is_finite);
    if fits { Ok(()) } else { Err(Error::corrupt("view", "columns do not fit together")) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::MapSettings;
    use crate::dataset::Dataset;
    use crate::dataset::synthetic::Synthetic;
    use crate::octree::LIMIT;

    fn mapper() -> Mapper {
        let settings =
            MapSettings { r0_m: 0.4, steps: Some(0), color_degree: 1, ..MapSettings::default() };
        let config = MapConfig::from_settings(&settings).expect("valid settings");
        let mut mapper = Mapper::new(config).expect("an empty map");
        let room = Synthetic::room(100).with_width(16);
        for index in [0, 50] {
            mapper.integrate(&room.load(index, true).expect("a frame")).expect("taken");
        }
        mapper
    }

    /// A node that has children, and one that has none.
    fn parent_and_leaf(children: &[ChildLink], log2_sizes: &[u8]) -> (usize, usize) {
        let parent = (1..children.len()).find(|node| children[*node] != 0).expect("a parent");
        let is_leaf = |node: &usize| children[*node] == 0 && log2_sizes[*node] != u8::MAX;
        (parent, (0..children.len()).find(is_leaf).expect("a leaf"))
    }

    #[test]
    fn a_map_that_could_be_walked_for_ever_is_refused_by_name() {
        type Spoil = fn(&mut MapperState<'_>);
        let cases: [(&str, Spoil); 18] = [
            ("octree", |s| {
                let (parent, leaf) = parent_and_leaf(&s.topology.children, &s.topology.log2_sizes);
                s.topology.children.to_mut()[leaf] = s.topology.children[parent];
            }),
            ("octree", |s| s.topology.children.to_mut()[0] |= 0xff << 24),
            ("octree", |s| s.topology.log2_sizes.to_mut()[0] += 1),
            ("octree", |s| {
                let (parent, _) = parent_and_leaf(&s.topology.children, &s.topology.log2_sizes);
                s.topology.low_corners.to_mut()[parent][1] += 1;
            }),
            ("octree", |s| s.topology.vertices.to_mut()[3][0] += 1),
            ("octree", |s| s.topology.voxels += 1),
            ("surfels", |s| {
                let link = &mut s.surface.surfels.links.to_mut()[0];
                link.next_in_cell = 0;
            }),
            ("surfels", |s| s.surface.surfels.free.to_mut().push(u32::MAX)),
            ("surfels", |s| s.surface.surfels.free.to_mut().push(0)),
            ("surfels", |s| s.surface.surfels.surfels.to_mut()[0].position.y = f32::NAN),
            ("surfels", |s| {
                let twin = s.surface.surfels.surfels[1];
                s.surface.surfels.surfels.to_mut()[0] = twin;
            }),
            ("evidence", |s| s.surface.evidence.bricks.to_mut()[0][2] = LIMIT),
            ("evidence", |s| s.surface.evidence.log_odds.to_mut()[0] = i8::MAX),
            ("prior", |s| {
                let row = s.surface.prior.nearest.iter().position(|id| *id != u32::MAX);
                let row = row.expect("a row near a surface");
                s.surface.prior.next.to_mut()[row] = row as u32;
            }),
            ("colours", |s| {
                let color = s.surface.color.as_mut().expect("colours");
                color.by_direction.to_mut().pop();
            }),
            ("colours", |s| {
                let color = s.surface.color.as_mut().expect("colours");
                color.by_direction.to_mut()[0] = f32::NAN;
            }),
            ("key frames", |s| s.key_frames.pixels[0].z = f32::NAN),
            ("progress", |s| s.progress.stats.epoch = u64::MAX),
        ];
        let mapper = mapper();
        let again = |state| Mapper::from_state(mapper.config().clone(), state);
        again(mapper.state().expect("a state")).expect("whole");
        for (number, (part, spoil)) in cases.into_iter().enumerate() {
            let mut state = mapper.state().expect("a state");
            spoil(&mut state);
            let error = again(state).err().unwrap_or_else(|| panic!("{number}: {part}"));
            assert!(error.to_string().starts_with(part), "{number}: {error}");
        }
    }

    #[test]
    fn a_view_whose_parts_do_not_fit_together_is_refused() {
        let view = mapper().publish_all().expect("a view");
        let again = |state| MapView::from_state(view.config().clone(), state);
        again(view.state()).expect("whole");
        type Spoil = fn(&mut ViewState);
        let cases: [Spoil; 5] = [
            |s| {
                let (parent, leaf) = parent_and_leaf(&s.children, &s.log2_sizes);
                s.children[leaf] = s.children[parent];
            },
            |s| {
                let at = s.corners.iter().position(|rows| rows[0] != NO_ROW).expect("rows");
                s.corners[at][7] = NO_ROW;
            },
            |s| s.children.push(0),
            |s| s.harmonics.truncate(s.harmonics.len() - 1),
            |s| s.record.root = None,
        ];
        for (number, spoil) in cases.into_iter().enumerate() {
            let mut state = view.state();
            spoil(&mut state);
            let error = again(state).err().unwrap_or_else(|| panic!("{number}"));
            assert!(error.to_string().starts_with("view"), "{number}: {error}");
        }
    }
}
