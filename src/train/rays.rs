//! Rays of the window's frames into labelled samples (algorithms.md §3).

use glam::Vec3;
use rayon::prelude::*;

use super::batch::{Batch, SampleKind};
use super::key_frame::KeyFrame;
use crate::geometry::random::{normal, pcg4d, unit};
use crate::octree::Topology;
use crate::surface::Surface;

/// Stratified samples lie between this depth and the surface less [`FREE_END_M`], z in m.
pub const FREE_START_M: f32 = 0.07;
pub const FREE_END_M: f32 = 0.08;
/// Perturbed samples: standard deviation and clamp around the surface, z in m.
pub const PERTURBED_M: f32 = 0.06;
pub const PERTURBED_LIMIT_M: f32 = 0.12;
/// Rays a task; fixed, so that the batch does not depend on the threads.
const CHUNK: u32 = 256;
/// A ray whose end lies farther than this from every surfel is stale or a flying pixel, m; at least,
/// and at least two surfels.
const STALE_M: f32 = 0.06;
/// Most samples of a ray.
pub const RAY_SAMPLES: u32 = 4;

/// Which rays a step draws.
#[derive(Debug, Clone, Copy)]
pub struct RayPlan {
    pub rays: u32,
    pub seed: u32,
    /// Counts the steps of the map.
    pub step: u32,
    /// Share of the samples that pay the Eikonal loss.
    pub eikonal_share: f32,
}

/// Draws `plan.rays` rays, split equally over `frames`, and labels one stratified, two perturbed
/// and one surface sample of each. Labels come from the surfels by point-to-plane distance. Rays
/// whose surface is no longer there are skipped, so that moved objects stay gone.
pub fn sample(
    plan: &RayPlan,
    frames: &[&KeyFrame],
    topology: &Topology,
    surface: &Surface,
    pool: &rayon::ThreadPool,
) -> Batch {
    let frames: Vec<&KeyFrame> = frames.iter().copied().filter(|f| !f.pixels.is_empty()).collect();
    if frames.is_empty() {
        return Batch::default();
    }
    let chunks: Vec<u32> = (0..plan.rays.div_ceil(CHUNK)).collect();
    let draw = |&chunk: &u32| {
        let mut batch = Batch::default();
        for ray in chunk * CHUNK..((chunk + 1) * CHUNK).min(plan.rays) {
            let frame =
                frames[(u64::from(ray) * frames.len() as u64 / u64::from(plan.rays)) as usize];
            sample_ray(plan, ray, frame, topology, surface, &mut batch);
        }
        batch
    };
    let parts: Vec<Batch> = pool.install(|| chunks.par_iter().map(draw).collect());
    let mut whole = Batch::default();
    for part in parts {
        whole.append(part);
    }
    whole
}

/// How far from every surfel a ray's end may lie, m.
pub fn stale_m(surface: &Surface) -> f32 {
    STALE_M.max(2.0 * surface.surfels.size_m())
}

fn sample_ray(
    plan: &RayPlan,
    ray: u32,
    frame: &KeyFrame,
    topology: &Topology,
    surface: &Surface,
    batch: &mut Batch,
) {
    let words = pcg4d([plan.seed, plan.step, ray, 0]);
    let more = pcg4d([plan.seed, plan.step, ray, 1]);
    let last = pcg4d([plan.seed, plan.step, ray, 2]);
    let index = ((u64::from(words[0]) * frame.pixels.len() as u64) >> 32) as usize;
    let pixel = frame.pixels[index];
    let direction = frame.direction(pixel);
    let at = |z: f32| frame.origin + direction * z;
    let stale = stale_m(surface);
    let end = at(pixel.z);
    let Some(on_surface) = label(topology, surface, end).filter(|d| d.abs() <= stale) else {
        return;
    };
    let mut push = |point: Vec3, kind, distance: f32, coin: u32| {
        batch.points.push(point);
        batch.kinds.push(kind);
        batch.distances.push(distance);
        batch.occupancies.push(match kind {
            SampleKind::Free => 0.0,
            SampleKind::Surface => 0.75,
            SampleKind::Perturbed | SampleKind::Ray => f32::from(distance < 0.0),
        });
        batch.eikonal.push(unit(coin) < plan.eikonal_share);
    };
    push(end, SampleKind::Surface, on_surface, more[3]);
    let top = (pixel.z - FREE_END_M).max(FREE_START_M + FREE_END_M);
    let free = at(FREE_START_M + unit(words[1]) * (top - FREE_START_M));
    // What was measured free is free, whatever a neighbouring surfel's plane says.
    if let Some(distance) = label(topology, surface, free).filter(|&d| d >= 0.0) {
        push(free, SampleKind::Free, distance, last[0]);
    }
    for (offset, coin) in
        [(normal(words[2], words[3]), last[1]), (normal(more[0], more[1]), last[2])]
    {
        let z = pixel.z + (offset * PERTURBED_M).clamp(-PERTURBED_LIMIT_M, PERTURBED_LIMIT_M);
        if let Some(distance) = label(topology, surface, at(z)) {
            push(at(z), SampleKind::Perturbed, distance, coin);
        }
    }
}

fn label(topology: &Topology, surface: &Surface, point: Vec3) -> Option<f32> {
    surface.label(topology, point).map(|(distance, _)| distance)
}
