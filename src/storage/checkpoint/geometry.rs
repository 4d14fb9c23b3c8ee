//! Octree and surfaces in sections.

use std::borrow::Cow;

use serde::{Deserialize, Serialize};

use super::tags::*;
use crate::config::MapConfig;
use crate::error::Result;
use crate::octree::{Root, TopologyState};
use crate::storage::sections::{Sections, Tag};
use crate::surface::{ColorState, EvidenceState, PriorState, SurfaceState, SurfelState};

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

pub(super) fn take_surface(
    config: &MapConfig,
    from: &mut Sections<'_>,
) -> Result<SurfaceState<'static>> {
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

fn owned<T: bytemuck::Pod>(from: &mut Sections<'_>, tag: Tag) -> Result<Cow<'static, [T]>> {
    from.take_array(tag).map(Cow::Owned)
}
