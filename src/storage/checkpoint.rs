//! A map in sections: a *checkpoint* resumes mapping as if it had not stopped; a *compact* map
//! only answers.

use std::borrow::Cow;
use std::path::Path;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::sections::{Sections, Tag};
use crate::backend::{BackendState, ColorRows, DecoderState, LearnedRow, RowMoments};
use crate::config::MapConfig;
use crate::error::{Error, Result};
use crate::map::{MapView, Mapper, MapperState, Progress, Robots, ViewState};
use crate::octree::{Root, TopologyState};
use crate::surface::{ColorState, EvidenceState, PriorState, SurfaceState, SurfelState};
use crate::train::{FrameRecord, KeyFramesState};

const KIND: Tag = Tag(*b"KIND");
const CONFIG: Tag = Tag(*b"CONF");
const PROGRESS: Tag = Tag(*b"PROG");
const TREE: Tag = Tag(*b"TREE");
const NODE_CHILDREN: Tag = Tag(*b"NCHI");
const NODE_CORNERS: Tag = Tag(*b"NCOR");
const NODE_LOWS: Tag = Tag(*b"NLOW");
const NODE_SIZES: Tag = Tag(*b"NSIZ");
const NODE_BRICKS: Tag = Tag(*b"NBRK");
const VERTICES: Tag = Tag(*b"VERT");
const SURFELS: Tag = Tag(*b"SURF");
const SURFEL_LINKS: Tag = Tag(*b"SLNK");
const SURFEL_FREE: Tag = Tag(*b"SFRE");
const BRICKS: Tag = Tag(*b"EBRK");
const BRICK_KNOWN: Tag = Tag(*b"EKNO");
const CELL_ODDS: Tag = Tag(*b"EODD");
const CELL_CROSSED: Tag = Tag(*b"ECRO");
const CELL_HIT: Tag = Tag(*b"EHIT");
const CELL_SURFELS: Tag = Tag(*b"ESUR");
const PRIOR_NEAREST: Tag = Tag(*b"PNEA");
const PRIOR_REACH: Tag = Tag(*b"PREA");
const PRIOR_VALUES: Tag = Tag(*b"PVAL");
const PRIOR_SEEN: Tag = Tag(*b"PSEE");
const PRIOR_NEXT: Tag = Tag(*b"PNXT");
const PRIOR_PREVIOUS: Tag = Tag(*b"PPRV");
const PRIOR_HEADS: Tag = Tag(*b"PHEA");
const RINGED: Tag = Tag(*b"RING");
/// Passed over by who only wants distances, and absent in files from before there were several.
const ROBOTS: Tag = Tag(*b"robo");
const KEY_FRAMES: Tag = Tag(*b"KREC");
const KEY_PIXELS: Tag = Tag(*b"KPIX");
const KEY_CELLS: Tag = Tag(*b"KCEL");
const KEY_BLOCKS: Tag = Tag(*b"KBLK");
const KEY_TRAINED: Tag = Tag(*b"KTRA");
const KEY_COUNTS: Tag = Tag(*b"KCNT");
const KEY_IDS: Tag = Tag(*b"KIDS");
const ROWS: Tag = Tag(*b"BROW");
const ROW_MOMENTS: Tag = Tag(*b"BMOM");
const ROW_STEPS: Tag = Tag(*b"BSTP");
const DECODERS: Tag = Tag(*b"BDEC");
const RADIANCE: Tag = Tag(*b"RCON");
const COLOR_CELLS: Tag = Tag(*b"CCEL");
const COLOR_SEEN: Tag = Tag(*b"CSEE");
const COLOR_LEARNED: Tag = Tag(*b"CLRN");
const COLOR_MOMENTS: Tag = Tag(*b"CMOM");
const COLOR_STEPS: Tag = Tag(*b"CSTP");
const KEY_COLORS: Tag = Tag(*b"KCOL");
const KEY_GAINS: Tag = Tag(*b"KGAI");
const VIEW_TEXELS: Tag = Tag(*b"VTEX");
const VIEW: Tag = Tag(*b"VIEW");
const VIEW_ROWS: Tag = Tag(*b"VROW");

const ALL: [Tag; 50] = [
    KIND,
    CONFIG,
    PROGRESS,
    TREE,
    NODE_CHILDREN,
    NODE_CORNERS,
    NODE_LOWS,
    NODE_SIZES,
    NODE_BRICKS,
    VERTICES,
    SURFELS,
    SURFEL_LINKS,
    SURFEL_FREE,
    BRICKS,
    BRICK_KNOWN,
    CELL_ODDS,
    CELL_CROSSED,
    CELL_HIT,
    CELL_SURFELS,
    PRIOR_NEAREST,
    PRIOR_REACH,
    PRIOR_VALUES,
    PRIOR_SEEN,
    PRIOR_NEXT,
    PRIOR_PREVIOUS,
    PRIOR_HEADS,
    RINGED,
    ROBOTS,
    KEY_FRAMES,
    KEY_PIXELS,
    KEY_CELLS,
    KEY_BLOCKS,
    KEY_TRAINED,
    KEY_COUNTS,
    KEY_IDS,
    ROWS,
    ROW_MOMENTS,
    ROW_STEPS,
    DECODERS,
    RADIANCE,
    COLOR_CELLS,
    COLOR_SEEN,
    COLOR_LEARNED,
    COLOR_MOMENTS,
    COLOR_STEPS,
    KEY_COLORS,
    KEY_GAINS,
    VIEW_TEXELS,
    VIEW,
    VIEW_ROWS,
];

/// What a map file holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
enum Kind {
    Checkpoint,
    Compact,
}

#[derive(Serialize, Deserialize)]
struct Tree {
    root: Option<Root>,
    voxels: u64,
    refused: u64,
}

#[derive(Serialize, Deserialize)]
struct KeyRecord {
    next: u32,
    idle_cursor: u32,
    selections: u32,
    frames: Vec<FrameRecord>,
}

/// Columns of a learned row on disk.
const COLUMNS: usize = RowMoments::COLUMNS;

/// Saves a map: all of it, or with `compact` only what answers.
pub fn save(mapper: &mut Mapper, path: &Path, compact: bool) -> Result<()> {
    if compact {
        save_compact(&*mapper.publish_all()?, path)
    } else {
        save_checkpoint(mapper, path)
    }
}

/// Loads a checkpoint, to go on mapping with the settings that it was made with.
pub fn load(path: &Path) -> Result<Mapper> {
    load_with(path, Ok)
}

/// Loads a checkpoint, to go on mapping with what `settle` makes of its settings
/// ([`MapConfig::resumed`]).
pub fn load_with(
    path: &Path,
    settle: impl FnOnce(MapConfig) -> Result<MapConfig>,
) -> Result<Mapper> {
    let mut sections = Sections::read(path, &ALL)?;
    match sections.take_record(KIND)? {
        Kind::Checkpoint => {
            let config = settle(take_config(&mut sections)?)?;
            take_mapper(config, &mut sections)
        }
        Kind::Compact => Err(Error::FailedPrecondition(format!(
            "{}: saved with --compact, which answers but cannot go on mapping",
            path.display()
        ))),
    }
}

/// Loads either kind, to answer.
pub fn load_view(path: &Path) -> Result<Arc<MapView>> {
    let mut sections = Sections::read(path, &ALL)?;
    match sections.take_record(KIND)? {
        Kind::Checkpoint => {
            let config = take_config(&mut sections)?;
            Ok(take_mapper(config, &mut sections)?.publish())
        }
        Kind::Compact => take_view(&mut sections).map(Arc::new),
    }
}

fn save_checkpoint(mapper: &Mapper, path: &Path) -> Result<()> {
    let state = mapper.state()?;
    let (surface, keys) = (&state.surface, &state.key_frames);
    let learned: Vec<[f32; COLUMNS]> = state.backend.learned.iter().map(columns).collect();
    let moments: Vec<[[f32; COLUMNS]; 2]> =
        state.backend.moments.iter().map(|m| [m.first, m.second]).collect();
    let steps: Vec<[u32; 2]> =
        state.backend.moments.iter().map(|m| [m.sdf_steps, m.occupancy_steps]).collect();
    let mut out = Sections::new();
    out.put_record(KIND, &Kind::Checkpoint)?;
    put_config(&mut out, mapper.config())?;
    out.put_record(PROGRESS, &state.progress)?;
    put_topology(&mut out, &state.topology)?;
    put_surface(&mut out, surface)?;
    out.put_record(ROBOTS, &state.robots)?;
    let record = KeyRecord {
        next: keys.next,
        idle_cursor: keys.idle_cursor,
        selections: keys.selections,
        frames: keys.frames.clone(),
    };
    out.put_record(KEY_FRAMES, &record)?;
    out.put_array(KEY_PIXELS, &keys.pixels)?;
    out.put_array(KEY_CELLS, &keys.cells)?;
    out.put_array(KEY_BLOCKS, &keys.blocks)?;
    out.put_array(KEY_TRAINED, &keys.block_trained)?;
    out.put_array(KEY_COUNTS, &keys.block_counts)?;
    out.put_array(KEY_IDS, &keys.block_ids)?;
    out.put_array(ROWS, learned.as_flattened())?;
    out.put_array(ROW_MOMENTS, moments.as_flattened().as_flattened())?;
    out.put_array(ROW_STEPS, &steps)?;
    out.put_record(DECODERS, &(&state.backend.sdf, &state.backend.occupancy))?;
    let colors = &state.backend.colors;
    let color_moments = [&colors.first[..], &colors.second[..]].concat();
    if mapper.config().has("radiance") {
        out.put_array(COLOR_LEARNED, &colors.learned)?;
        out.put_array(COLOR_MOMENTS, &color_moments)?;
        out.put_array(COLOR_STEPS, &colors.steps)?;
        out.put_array(KEY_COLORS, &keys.colors)?;
        out.put_array(KEY_GAINS, &keys.gains)?;
    }
    out.write(path)
}

/// Radiance has a record of its own, which maps from before there were colours do not have.
fn put_config(out: &mut Sections<'_>, config: &MapConfig) -> Result<()> {
    out.put_record(CONFIG, config)?;
    if config.has("radiance") {
        out.put_record(RADIANCE, &config.radiance)?;
    }
    Ok(())
}

fn take_config(from: &mut Sections<'_>) -> Result<MapConfig> {
    let mut config: MapConfig = from.take_record(CONFIG)?;
    if config.has("radiance") {
        config.radiance = from.take_record(RADIANCE)?;
    }
    config.checked()
}

fn put_topology<'a>(out: &mut Sections<'a>, state: &'a TopologyState<'_>) -> Result<()> {
    let tree = Tree { root: state.root, voxels: state.voxels, refused: state.refused };
    out.put_record(TREE, &tree)?;
    out.put_array(NODE_CHILDREN, &state.children)?;
    out.put_array(NODE_CORNERS, &state.corners)?;
    out.put_array(NODE_LOWS, &state.low_corners)?;
    out.put_array(NODE_SIZES, &state.log2_sizes)?;
    out.put_array(VERTICES, &state.vertices)
}

fn put_surface<'a>(out: &mut Sections<'a>, state: &'a SurfaceState<'_>) -> Result<()> {
    out.put_array(SURFELS, &state.surfels.surfels)?;
    out.put_array(SURFEL_LINKS, &state.surfels.links)?;
    out.put_array(SURFEL_FREE, &state.surfels.free)?;
    out.put_array(BRICKS, &state.evidence.bricks)?;
    out.put_array(BRICK_KNOWN, &state.evidence.known)?;
    out.put_array(CELL_ODDS, &state.evidence.log_odds)?;
    out.put_array(CELL_CROSSED, &state.evidence.crossed)?;
    out.put_array(CELL_HIT, &state.evidence.hit)?;
    out.put_array(CELL_SURFELS, &state.evidence.surfels)?;
    out.put_array(PRIOR_NEAREST, &state.prior.nearest)?;
    out.put_array(PRIOR_REACH, &state.prior.reach)?;
    out.put_array(PRIOR_VALUES, &state.prior.values)?;
    out.put_array(PRIOR_SEEN, &state.prior.seen_free)?;
    out.put_array(PRIOR_NEXT, &state.prior.next)?;
    out.put_array(PRIOR_PREVIOUS, &state.prior.previous)?;
    out.put_array(PRIOR_HEADS, &state.prior.heads)?;
    out.put_array(RINGED, &state.ringed)?;
    if let Some(color) = &state.color {
        out.put_array(COLOR_CELLS, &color.cells)?;
        out.put_array(COLOR_SEEN, &color.seen)?;
    }
    Ok(())
}

fn take_mapper(config: MapConfig, from: &mut Sections<'_>) -> Result<Mapper> {
    let progress: Progress = from.take_record(PROGRESS)?;
    let topology = take_topology(from)?;
    let surface = take_surface(&config, from)?;
    let has_robots = from.tags().any(|tag| tag == ROBOTS);
    let robots = if has_robots { from.take_record(ROBOTS)? } else { Robots::default() };
    let has_color = config.has("radiance");
    let record: KeyRecord = from.take_record(KEY_FRAMES)?;
    let key_frames = KeyFramesState {
        next: record.next,
        idle_cursor: record.idle_cursor,
        selections: record.selections,
        frames: record.frames,
        pixels: from.take_array(KEY_PIXELS)?,
        cells: from.take_array(KEY_CELLS)?,
        blocks: from.take_array(KEY_BLOCKS)?,
        block_trained: from.take_array(KEY_TRAINED)?,
        block_counts: from.take_array(KEY_COUNTS)?,
        block_ids: from.take_array(KEY_IDS)?,
        colors: if has_color { from.take_array(KEY_COLORS)? } else { Vec::new() },
        gains: if has_color { from.take_array(KEY_GAINS)? } else { Vec::new() },
    };
    let mut backend = take_backend(from)?;
    if has_color {
        backend.colors = take_colors(from)?;
    }
    let state = MapperState { progress, topology, surface, robots, key_frames, backend };
    Mapper::from_state(config, state)
}

fn take_topology(from: &mut Sections<'_>) -> Result<TopologyState<'static>> {
    let tree: Tree = from.take_record(TREE)?;
    Ok(TopologyState {
        root: tree.root,
        voxels: tree.voxels,
        refused: tree.refused,
        children: owned(from, NODE_CHILDREN)?,
        corners: owned(from, NODE_CORNERS)?,
        low_corners: owned(from, NODE_LOWS)?,
        log2_sizes: owned(from, NODE_SIZES)?,
        vertices: owned(from, VERTICES)?,
    })
}

fn take_surface(config: &MapConfig, from: &mut Sections<'_>) -> Result<SurfaceState<'static>> {
    let color = if config.has("radiance") {
        Some(ColorState { cells: owned(from, COLOR_CELLS)?, seen: owned(from, COLOR_SEEN)? })
    } else {
        None
    };
    Ok(SurfaceState {
        surfels: SurfelState {
            surfels: owned(from, SURFELS)?,
            links: owned(from, SURFEL_LINKS)?,
            free: owned(from, SURFEL_FREE)?,
        },
        evidence: EvidenceState {
            bricks: owned(from, BRICKS)?,
            known: owned(from, BRICK_KNOWN)?,
            log_odds: owned(from, CELL_ODDS)?,
            crossed: owned(from, CELL_CROSSED)?,
            hit: owned(from, CELL_HIT)?,
            surfels: owned(from, CELL_SURFELS)?,
        },
        prior: PriorState {
            nearest: owned(from, PRIOR_NEAREST)?,
            reach: owned(from, PRIOR_REACH)?,
            values: owned(from, PRIOR_VALUES)?,
            seen_free: owned(from, PRIOR_SEEN)?,
            next: owned(from, PRIOR_NEXT)?,
            previous: owned(from, PRIOR_PREVIOUS)?,
            heads: owned(from, PRIOR_HEADS)?,
        },
        ringed: owned(from, RINGED)?,
        color,
    })
}

fn take_backend(from: &mut Sections<'_>) -> Result<BackendState> {
    let learned: Vec<[f32; COLUMNS]> = from.take_array(ROWS)?;
    let moments: Vec<[f32; COLUMNS]> = from.take_array(ROW_MOMENTS)?;
    let steps: Vec<[u32; 2]> = from.take_array(ROW_STEPS)?;
    let (sdf, occupancy): (DecoderState, DecoderState) = from.take_record(DECODERS)?;
    let (pairs, rest) = moments.as_chunks::<2>();
    if pairs.len() != steps.len() || !rest.is_empty() {
        return Err(Error::corrupt("optimiser", "moments and step counts differ in number"));
    }
    let moments = pairs.iter().zip(&steps).map(|(&[first, second], &[sdf, occupancy])| {
        RowMoments { first, second, sdf_steps: sdf, occupancy_steps: occupancy }
    });
    Ok(BackendState {
        learned: learned.iter().map(learned_row).collect(),
        moments: moments.collect(),
        sdf,
        occupancy,
        colors: ColorRows::default(),
    })
}

fn take_colors(from: &mut Sections<'_>) -> Result<ColorRows> {
    let mut first: Vec<[f32; 3]> = from.take_array(COLOR_MOMENTS)?;
    let second = first.split_off(first.len() / 2);
    let (learned, steps) = (from.take_array(COLOR_LEARNED)?, from.take_array(COLOR_STEPS)?);
    let colors = ColorRows { learned, first, second, steps };
    colors.check()?;
    Ok(colors)
}

fn owned<T: bytemuck::Pod>(from: &mut Sections<'_>, tag: Tag) -> Result<Cow<'static, [T]>> {
    from.take_array(tag).map(Cow::Owned)
}

/// The numbers of a row in the order of its columns: feature, occupancy feature, explicit.
fn numbers(row: &mut LearnedRow) -> impl Iterator<Item = &mut f32> {
    row.sdf_feature.iter_mut().chain(&mut row.occupancy_feature).chain(&mut row.explicit)
}

fn columns(row: &LearnedRow) -> [f32; COLUMNS] {
    let (mut row, mut columns) = (*row, [0.0; COLUMNS]);
    numbers(&mut row).zip(&mut columns).for_each(|(number, column)| *column = *number);
    columns
}

fn learned_row(columns: &[f32; COLUMNS]) -> LearnedRow {
    let mut row = LearnedRow::default();
    numbers(&mut row).zip(columns).for_each(|(number, column)| *number = *column);
    row
}

fn save_compact(view: &MapView, path: &Path) -> Result<()> {
    let state = view.state();
    let mut out = Sections::new();
    out.put_record(KIND, &Kind::Compact)?;
    put_config(&mut out, view.config())?;
    out.put_record(VIEW, &state.record)?;
    out.put_array(NODE_CHILDREN, &state.children)?;
    out.put_array(NODE_CORNERS, &state.corners)?;
    out.put_array(NODE_LOWS, &state.low_corners)?;
    out.put_array(NODE_SIZES, &state.log2_sizes)?;
    out.put_array(NODE_BRICKS, &state.node_bricks)?;
    out.put_array(VIEW_ROWS, &state.rows)?;
    out.put_array(BRICK_KNOWN, &state.known)?;
    if view.config().has("radiance") {
        out.put_array(COLOR_CELLS, &state.color_cells)?;
        out.put_array(VIEW_TEXELS, &state.texels)?;
    }
    out.write(path)
}

fn take_view(from: &mut Sections<'_>) -> Result<MapView> {
    let config = take_config(from)?;
    let has_color = config.has("radiance");
    let state = ViewState {
        record: from.take_record(VIEW)?,
        children: from.take_array(NODE_CHILDREN)?,
        corners: from.take_array(NODE_CORNERS)?,
        low_corners: from.take_array(NODE_LOWS)?,
        log2_sizes: from.take_array(NODE_SIZES)?,
        node_bricks: from.take_array(NODE_BRICKS)?,
        rows: from.take_array(VIEW_ROWS)?,
        known: from.take_array(BRICK_KNOWN)?,
        color_cells: if has_color { from.take_array(COLOR_CELLS)? } else { Vec::new() },
        texels: if has_color { from.take_array(VIEW_TEXELS)? } else { Vec::new() },
    };
    MapView::from_state(config, state)
}
