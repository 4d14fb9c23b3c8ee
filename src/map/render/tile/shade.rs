//! From what the rays of a tile met to what they show.

use glam::Vec3;

use super::super::Job;
use super::super::patch::{Area, Paint, Patch, SIDE, Spot};
use super::super::unknown::Outlook;
use super::cubes::Cubes;
use super::raster::Cast;
use crate::octree::Traversal;

/// Side of a block of pixels for which one ray looks out for unobserved space.
pub(in crate::map::render) const BLOCK: u32 = 4;

/// Writes the columns that are wanted.
pub(super) fn fill(job: &Job<'_>, area: Area, cubes: &Cubes, cast: &Cast, patch: &mut Patch) {
    let direction = |pixel: u8| -> Vec3 {
        std::array::from_fn(|axis| cast.directions[axis].0[usize::from(pixel)]).into()
    };
    // A patch's rows are as long as the patch is wide, a tile's always alike.
    let place =
        |pixel: u8| (u32::from(pixel) / SIDE * area.width + u32::from(pixel) % SIDE) as usize;
    let light = |i: usize| {
        let (column, row) = (i as u32 % area.width, i as u32 / area.width);
        cast.light.0[(row * SIDE + column) as usize]
    };
    for (i, opacity) in patch.opacity.iter_mut().enumerate() {
        *opacity = 1.0 - light(i);
    }
    // Beyond every surface where there is none.
    let mut hits = vec![f32::INFINITY; patch.unknown.len()];
    for share in cast.shares.iter().filter(|share| share.is_surface) {
        let (i, direction) = (place(share.pixel), direction(share.pixel));
        if let Some(depth) = patch.depth_m.get_mut(i) {
            *depth = share.t;
        }
        if let Some(normal) = patch.normal.get_mut(i) {
            let cube = &cubes.cubes[share.cube as usize];
            let unit = cubes.gradient(cube, direction * share.t).normalize_or_zero();
            *normal = if unit.dot(direction) <= 0.0 { unit } else { -unit };
        }
        if !patch.unknown.is_empty() {
            hits[i] = share.t;
        }
    }
    if !patch.unknown.is_empty() {
        look_out(job, area, &hits, &mut patch.unknown);
    }
    if patch.color.is_empty() {
        return;
    }
    let mut paints = vec![Paint::default(); area.pixels()];
    let (store, eye) = (&job.view.store, job.rays.eye);
    // Shares come cube by cube. A cell of the relief is one of the band of colour.
    for shares in cast.shares.chunk_by(|a, b| a.cube == b.cube) {
        let cube = &cubes.cubes[shares[0].cube as usize];
        let node = cubes.leaves[cube.leaf as usize].node;
        let (low, size_m) = cubes.host(cube);
        let middle = eye + 0.5 * (cube.low + cube.high);
        let cell = cube.cell.and_then(|_| store.color_cell(node, middle));
        for share in shares {
            let (paint, direction) = (&mut paints[place(share.pixel)], direction(share.pixel));
            let at = direction * share.t;
            if let Some(cell) = &cell {
                let x = ((at - low) / size_m).clamp(Vec3::ZERO, Vec3::ONE);
                paint.take(store, (eye + at, direction), cell.color(x), share.weight);
            } else {
                let spot = Spot { direction, t: share.t, node, low_m: eye + low, size_m };
                paint.add(store, eye, &spot, share.weight);
            }
        }
    }
    for (i, (color, paint)) in patch.color.iter_mut().zip(paints).enumerate() {
        *color = paint.color(1.0 - light(i));
    }
}

/// Sets `unknown` of what lies at `hits` beyond unobserved space. One ray looks out for a block of
/// pixels: cells of evidence are larger than that in all but the farthest of an image.
fn look_out(job: &Job<'_>, area: Area, hits: &[f32], unknown: &mut [u8]) {
    let block = |side: u32| (0..side).step_by(BLOCK as usize);
    for (top, left) in block(area.height).flat_map(|top| block(area.width).map(move |l| (top, l))) {
        let (right, bottom) = ((left + BLOCK).min(area.width), (top + BLOCK).min(area.height));
        let pixels = || {
            (top..bottom).flat_map(|v| (left..right).map(move |u| (v * area.width + u) as usize))
        };
        let farthest = pixels().map(|i| hits[i]).filter(|t| t.is_finite()).fold(0.0, f32::max);
        let (u, v) = (area.left + (left + right) / 2, area.top + (top + bottom) / 2);
        let end = leaves_observed_space(job, job.rays.direction(u, v), farthest);
        for i in pixels() {
            unknown[i] = u8::from(hits[i] > end);
        }
    }
}

/// Where a ray has left observed space, if that is before `t`; else farther than any surface.
fn leaves_observed_space(job: &Job<'_>, direction: Vec3, t: f32) -> f32 {
    let (store, eye) = (&job.view.store, job.rays.eye);
    let mut outlook = Outlook::default();
    let mut last = 0.0;
    for segment in Traversal::new(store, eye, direction, 0.0..t) {
        outlook.go((segment.t_in - last) * direction.length(), false);
        outlook.pass(store, &segment, eye, direction);
        last = segment.t_out;
        if outlook.left {
            return last;
        }
    }
    f32::MAX
}
