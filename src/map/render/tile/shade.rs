//! From what the rays of a tile met to what they show.

use glam::Vec3;

use super::super::Job;
use super::super::patch::{Area, Paint, Patch, SIDE};
use super::super::unknown::Outlook;
use super::cubes::Cube;
use super::raster::Cast;
use crate::octree::Traversal;

/// Writes the columns that are wanted.
pub(super) fn fill(job: &Job<'_>, area: Area, cubes: &[Cube], cast: &Cast, patch: &mut Patch) {
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
    for share in cast.shares.iter().filter(|share| share.is_surface) {
        let (i, direction) = (place(share.pixel), direction(share.pixel));
        if let Some(depth) = patch.depth_m.get_mut(i) {
            *depth = share.t;
        }
        if let Some(normal) = patch.normal.get_mut(i) {
            let cube = &cubes[share.cube as usize];
            let (_, gradient) = cube.distance_and_gradient(direction * share.t);
            let unit = gradient.normalize_or_zero();
            *normal = if unit.dot(direction) <= 0.0 { unit } else { -unit };
        }
        if let Some(unknown) = patch.unknown.get_mut(i) {
            *unknown = u8::from(leaves_observed_space(job, direction, share.t));
        }
    }
    if patch.color.is_empty() {
        return;
    }
    let mut paints = vec![Paint::default(); area.pixels()];
    for share in &cast.shares {
        let cube = &cubes[share.cube as usize];
        let at = job.rays.eye + direction(share.pixel) * share.t;
        let voxel = (job.rays.eye + cube.host_low, cube.host_size);
        paints[place(share.pixel)].add(&job.view.store, cube.node, voxel, at, share.weight);
    }
    for (i, (color, paint)) in patch.color.iter_mut().zip(paints).enumerate() {
        *color = paint.color(1.0 - light(i));
    }
}

/// Whether a ray leaves observed space before it meets a surface at `t`.
fn leaves_observed_space(job: &Job<'_>, direction: Vec3, t: f32) -> bool {
    let (store, eye) = (&job.view.store, job.rays.eye);
    let mut outlook = Outlook::default();
    let mut last = 0.0;
    for segment in Traversal::new(store, eye, direction, 0.0..t) {
        outlook.go((segment.t_in - last) * direction.length(), false);
        outlook.pass(store, &segment, eye, direction);
        last = segment.t_out;
        if outlook.left {
            return true;
        }
    }
    false
}
