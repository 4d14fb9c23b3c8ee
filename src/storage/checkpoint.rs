//! A map in sections: a *checkpoint* resumes mapping as if it had not stopped; a *compact* map
//! only answers.

mod geometry;
mod language;
mod learned;
mod tags;

use std::path::Path;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use self::geometry::{is_new, put_surface, put_topology, take_surface, take_topology};
use self::language::{put_language, put_view_codes, take_language, take_view_codes};
use self::learned::{COLUMNS, columns, take_backend, take_colors};
use self::tags::*;
use super::sections::Sections;
use crate::config::MapConfig;
use crate::error::{Error, Result};
use crate::map::{MapView, Mapper, MapperState, Progress, Robots, Timeline, ViewState};
use crate::modality::radiance::Texel;
use crate::train::{FrameRecord, KeyFramesState, NO_ROBOT};

/// What a map file holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
enum Kind {
    Checkpoint,
    Compact,
}

#[derive(Serialize, Deserialize)]
struct KeyRecord {
    next: u32,
    idle_cursor: u32,
    selections: u32,
    frames: Vec<FrameRecord>,
}

/// How far into its journal a map has come: frames up to `position` of the journal with this number are
/// in it, or it was made not to have them. Zeros: no journal.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Mark {
    pub journal: u64,
    pub position: u64,
}

/// Saves a map: all of it, or with `compact` only what answers.
pub fn save(mapper: &mut Mapper, path: &Path, compact: bool) -> Result<()> {
    if compact {
        save_compact(&*mapper.publish_all()?, path)
    } else {
        save_marked(mapper, Mark::default(), path)
    }
}

/// Saves all of a map, and how far into its journal it has come.
pub fn save_marked(mapper: &Mapper, mark: Mark, path: &Path) -> Result<()> {
    with_sections(mapper, mark, |sections| sections.write(path))
}

/// A map's whole state in memory, on its way to a file.
#[derive(Debug)]
pub struct Checkpoint(Sections<'static>);

impl Checkpoint {
    /// Copies the state, so that the map can go on while it is written.
    pub fn of(mapper: &Mapper, mark: Mark) -> Result<Self> {
        with_sections(mapper, mark, |sections| Ok(Self(sections.into_owned())))
    }

    /// Its size, without the heads of its sections.
    pub fn bytes(&self) -> usize {
        self.0.bytes()
    }

    /// Writes it, whole or not at all.
    pub fn write(&self, path: &Path) -> Result<()> {
        self.0.write(path)
    }
}

/// What a checkpoint's file says about itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Summary {
    pub epoch: u64,
    pub frames: u64,
    pub newest_stamp_ns: i64,
}

impl Summary {
    /// Reads the few bytes that it takes, and checks no others.
    pub fn peek(path: &Path) -> Result<Self> {
        Self::of(&Sections::peek(path, PROGRESS)?.take_record(PROGRESS)?)
    }

    /// Reads a file from end to end in little memory: every byte is as it was written, and it is a
    /// checkpoint.
    pub fn verify(path: &Path) -> Result<Self> {
        let mut sections = Sections::examine(path, &ALL, &[KIND, CONFIG, PROGRESS])?;
        check_kind(sections.take_record(KIND)?, path)?;
        sections.take_record::<MapConfig>(CONFIG)?;
        Self::of(&sections.take_record(PROGRESS)?)
    }

    fn of(progress: &Progress) -> Result<Self> {
        let Progress { stats, newest_stamp_ns, .. } = progress;
        Ok(Self { epoch: stats.epoch, frames: stats.frames, newest_stamp_ns: *newest_stamp_ns })
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
    load_marked(path, settle).map(|(mapper, _)| mapper)
}

/// The same, and how far into its journal the map had come.
pub fn load_marked(
    path: &Path,
    settle: impl FnOnce(MapConfig) -> Result<MapConfig>,
) -> Result<(Mapper, Mark)> {
    let mut sections = Sections::read(path, &ALL)?;
    check_kind(sections.take_record(KIND)?, path)?;
    let config = settle(take_config(&mut sections)?)?;
    let is_marked = sections.tags().any(|tag| tag == MARK);
    let mark = if is_marked { sections.take_record(MARK)? } else { Mark::default() };
    Ok((take_mapper(config, &mut sections)?, mark))
}

fn check_kind(kind: Kind, path: &Path) -> Result<()> {
    match kind {
        Kind::Checkpoint => Ok(()),
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

/// Lends out the sections of a checkpoint.
fn with_sections<T>(
    mapper: &Mapper,
    mark: Mark,
    act: impl FnOnce(Sections<'_>) -> Result<T>,
) -> Result<T> {
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
    out.put_record(TIMELINE, &state.timeline)?;
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
    out.put_array(KEY_ROBOTS, &keys.robots)?;
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
    if let Some(language) = &state.language {
        put_language(&mut out, language)?;
    }
    if mark != Mark::default() {
        out.put_record(MARK, &mark)?;
    }
    act(out)
}

/// Radiance and language have records of their own, which maps from before there were any do not
/// have.
fn put_config(out: &mut Sections<'_>, config: &MapConfig) -> Result<()> {
    out.put_record(CONFIG, config)?;
    if config.has("radiance") {
        out.put_record(RADIANCE, &config.radiance)?;
        if config.radiance.degree > 0 {
            out.put_record(COLOR_DEGREE, &config.radiance.degree)?;
        }
    }
    if config.has("language") {
        out.put_record(LANGUAGE, &config.language)?;
    }
    Ok(())
}

fn take_config(from: &mut Sections<'_>) -> Result<MapConfig> {
    let mut config: MapConfig = from.take_record(CONFIG)?;
    if config.has("radiance") {
        config.radiance = from.take_record(RADIANCE)?;
        if from.tags().any(|tag| tag == COLOR_DEGREE) {
            config.radiance.degree = from.take_record(COLOR_DEGREE)?;
        }
    }
    if config.has("language") {
        config.language = from.take_record(LANGUAGE)?;
    }
    config.checked()
}

fn take_mapper(config: MapConfig, from: &mut Sections<'_>) -> Result<Mapper> {
    let progress: Progress = from.take_record(PROGRESS)?;
    let topology = take_topology(from)?;
    let has_robots = from.tags().any(|tag| tag == ROBOTS);
    let robots = if has_robots { from.take_record(ROBOTS)? } else { Robots::default() };
    let has_one_robot = robots.len() == 1;
    let is_new = is_new(from);
    let surface = take_surface(&config, from, has_one_robot)?;
    let timeline = if is_new {
        from.take_record(TIMELINE)?
    } else {
        Timeline::of_old_file(progress.stats.frames, progress.newest_stamp_ns)
    };
    // Of one robot are all that there are.
    let robot = if has_one_robot { 0 } else { NO_ROBOT };
    let key_frames = take_key_frames(&config, from, |frames| vec![robot; frames])?;
    let mut backend = take_backend(from)?;
    if config.has("radiance") {
        backend.colors = take_colors(from)?;
    }
    let language = config.has("language").then(|| take_language(from)).transpose()?;
    let state = MapperState {
        progress,
        topology,
        surface,
        robots,
        timeline,
        key_frames,
        backend,
        language,
    };
    Mapper::from_state(config, state)
}

/// `robots`: of so many key frames, for files from before it was known who took them.
fn take_key_frames(
    config: &MapConfig,
    from: &mut Sections<'_>,
    robots: impl Fn(usize) -> Vec<u16>,
) -> Result<KeyFramesState> {
    let has_color = config.has("radiance");
    let has_robots = from.tags().any(|tag| tag == KEY_ROBOTS);
    let record: KeyRecord = from.take_record(KEY_FRAMES)?;
    let frames = record.frames.len();
    Ok(KeyFramesState {
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
        robots: if has_robots { from.take_array(KEY_ROBOTS)? } else { robots(frames) },
    })
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
        if view.config().radiance.degree > 0 {
            out.put_array(VIEW_HARMONICS, &state.harmonics)?;
        }
    }
    if view.config().has("language") {
        put_view_codes(&mut out, &state.codes)?;
    }
    out.put_array(VIEWPOINTS, &state.viewpoints)?;
    out.write(path)
}

/// In files from before surfaces had a relief, a texel ends with whether its colour was observed.
fn take_texels(from: &mut Sections<'_>) -> Result<Vec<Texel>> {
    if from.tags().any(|tag| tag == VIEW_TEXELS) {
        return from.take_array(VIEW_TEXELS);
    }
    let colors: Vec<[i16; 4]> = from.take_array(VIEW_COLORS)?;
    let texel = |[r, g, b, is_observed]: [i16; 4]| match is_observed {
        0 => Texel::default(),
        _ => Texel::of_steps([r, g, b], None),
    };
    Ok(colors.into_iter().map(texel).collect())
}

fn take_view(from: &mut Sections<'_>) -> Result<MapView> {
    let config = take_config(from)?;
    let has_color = config.has("radiance");
    let has_harmonics = has_color && config.radiance.degree > 0;
    let has_viewpoints = from.tags().any(|tag| tag == VIEWPOINTS);
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
        texels: if has_color { take_texels(from)? } else { Vec::new() },
        harmonics: if has_harmonics { from.take_array(VIEW_HARMONICS)? } else { Vec::new() },
        viewpoints: if has_viewpoints { from.take_array(VIEWPOINTS)? } else { Vec::new() },
        codes: if config.has("language") { take_view_codes(from)? } else { Default::default() },
    };
    MapView::from_state(config, state)
}
