//! The fast path: what is near a surface and in sight is drawn cube by cube, front to back, on tiles
//! of pixels (algorithms.md §6 has the idea; the order is the octree's own).
//!
//! Within a cube the distance is the gradient-augmented interpolation of its corners, as in queries,
//! but the decoder is asked at corners alone.

mod bins;
mod cubes;
pub(super) mod lens;
pub(super) mod raster;
pub(super) mod shade;

use rayon::ThreadPool;

use self::bins::Bins;
use super::patch::{self, Patch};
use super::{Job, Rendering};
use crate::geometry::simd::InstructionSet;

/// Draws a view.
pub(super) fn draw(
    job: &Job<'_>,
    pool: &ThreadPool,
    interrupted: &(dyn Fn() -> bool + Sync),
) -> Option<Rendering> {
    let set = InstructionSet::detect();
    let cubes = cubes::visible(job, pool);
    let bins = Bins::new(&cubes.cubes, job.rays.intrinsics.width, job.rays.intrinsics.height);
    patch::assemble(job, pool, interrupted, &|area| {
        let cast = raster::cast(set, job, area, &cubes, bins.of(area));
        let mut patch = Patch::new(area.pixels(), job.channels);
        shade::fill(job, area, &cubes, &cast, &mut patch);
        patch
    })
}
