//! Octree and surfaces in sections.

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

use super::tags::*;
use crate::config::MapConfig;
use crate::error::Result;
use crate::octree::{Root, TopologyState};
use crate::storage::sections::{Sections, Tag};
use crate::surface::{
    ColorState, EvidenceState, FirstSurfel, PriorState, SurfaceState, SurfelState, WitnessSets,
};

#[derive(Serialize, Deserialize)]
struct Tree {
    root: Option<Root>,
    voxels: u64,
    refused: u64,
}

pub(super) fn put_topology<'a>(out: &mut Sections<'a>, state: &'a TopologyState<'_>) -> Result<()> {
    let tree = Tree { root: state.root, voxels: state.voxels, refused: state.refused };
    out.put_record(TREE, &tree)?;
    out.put_array(NODE_CHILDREN, &state.children)?;
    out.put_array(NODE_CORNERS, &state.corners)?;
    out.put_array(NODE_LOWS, &state.low_corners)?;
    out.put_array(NODE_SIZES, &state.log2_sizes)?;
    out.put_array(VERTICES, &state.vertices)
}

pub(super) fn put_surface<'a>(out: &mut Sections<'a>, state: &'a SurfaceState<'_>) -> Result<()> {
    out.put_array(SURFELS, &state.surfels.surfels)?;
    out.put_record(SURFEL_WITNESSES, &state.surfels.witnesses)?;
    out.put_record(WITNESSES, &state.evidence.witnesses)?;
    out.put_array(CELL_SEEN_BY, &state.evidence.seen_by)?;
    out.put_array(PRIOR_FREE_BY, &state.prior.free_by)?;
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
        out.put_array(RELIEF, &color.relief)?;
        if !color.by_direction.is_empty() {
            out.put_array(COLOR_HARMONICS, &color.by_direction)?;
        }
    }
    Ok(())
}

pub(super) fn take_topology(from: &mut Sections<'_>) -> Result<TopologyState<'static>> {
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

/// `has_one_robot`: for files from before it was known who saw what.
pub(super) fn take_surface(
    config: &MapConfig,
    from: &mut Sections<'_>,
    has_one_robot: bool,
) -> Result<SurfaceState<'static>> {
    let color = if config.has("radiance") {
        let has = |tag: Tag| from.tags().any(|own| own == tag);
        let (has_relief, has_harmonics) = (has(RELIEF), has(COLOR_HARMONICS));
        Some(ColorState {
            cells: owned(from, COLOR_CELLS)?,
            seen: owned(from, COLOR_SEEN)?,
            relief: if has_relief { owned(from, RELIEF)? } else { Cow::default() },
            by_direction: if has_harmonics {
                owned(from, COLOR_HARMONICS)?
            } else {
                Cow::default()
            },
        })
    } else {
        None
    };
    let surfels = take_surfels(from, has_one_robot)?;
    let log_odds: Cow<'static, [i8]> = owned(from, CELL_ODDS)?;
    let seen_free: Cow<'static, [u32]> = owned(from, PRIOR_SEEN)?;
    let seen = take_seen(from, (log_odds.len(), seen_free.len()), has_one_robot)?;
    Ok(SurfaceState {
        surfels,
        evidence: EvidenceState {
            bricks: owned(from, BRICKS)?,
            known: owned(from, BRICK_KNOWN)?,
            log_odds,
            crossed: owned(from, CELL_CROSSED)?,
            hit: owned(from, CELL_HIT)?,
            surfels: owned(from, CELL_SURFELS)?,
            seen_by: seen.cells,
            witnesses: seen.witnesses,
        },
        prior: PriorState {
            nearest: owned(from, PRIOR_NEAREST)?,
            reach: owned(from, PRIOR_REACH)?,
            values: owned(from, PRIOR_VALUES)?,
            seen_free,
            free_by: seen.rows,
            next: owned(from, PRIOR_NEXT)?,
            previous: owned(from, PRIOR_PREVIOUS)?,
            heads: owned(from, PRIOR_HEADS)?,
        },
        ringed: owned(from, RINGED)?,
        color,
    })
}

fn take_surfels(from: &mut Sections<'_>, has_one_robot: bool) -> Result<SurfelState<'static>> {
    let (surfels, witnesses) = if is_new(from) {
        (owned(from, SURFELS)?, from.take_record(SURFEL_WITNESSES)?)
    } else {
        let first: Vec<FirstSurfel> = from.take_array(FIRST_SURFELS)?;
        let (witnesses, set) = WitnessSets::of_old_file(has_one_robot);
        (first.into_iter().map(|surfel| surfel.seen_by(set)).collect(), witnesses)
    };
    let (links, free) = (owned(from, SURFEL_LINKS)?, owned(from, SURFEL_FREE)?);
    Ok(SurfelState { surfels, links, free, witnesses })
}

/// Who saw cells of evidence, and vertices free.
struct Seen {
    cells: Cow<'static, [u16]>,
    rows: Cow<'static, [u16]>,
    witnesses: WitnessSets,
}

fn take_seen(
    from: &mut Sections<'_>,
    (cells, rows): (usize, usize),
    has_one_robot: bool,
) -> Result<Seen> {
    if is_new(from) {
        return Ok(Seen {
            cells: owned(from, CELL_SEEN_BY)?,
            rows: owned(from, PRIOR_FREE_BY)?,
            witnesses: from.take_record(WITNESSES)?,
        });
    }
    let (witnesses, set) = WitnessSets::of_old_file(has_one_robot);
    Ok(Seen { cells: vec![set; cells].into(), rows: vec![set; rows].into(), witnesses })
}

/// Whether the file says who saw what.
pub(super) fn is_new(from: &Sections<'_>) -> bool {
    from.tags().any(|tag| tag == WITNESSES)
}

fn owned<T: bytemuck::Pod>(from: &mut Sections<'_>, tag: Tag) -> Result<Cow<'static, [T]>> {
    from.take_array(tag).map(Cow::Owned)
}
