//! Rays whose colour is compared with a camera's.

use glam::Vec3;
use rayon::prelude::*;

use super::key_frame::KeyFrame;
use super::rays::{RayPlan, stale_m};
use crate::geometry::random::pcg4d;
use crate::octree::Topology;
use crate::surface::Surface;

/// Rays a task; fixed, so that their order does not depend on the threads.
const CHUNK: u32 = 256;
/// The stream of random numbers, beside those of depth rays.
const STREAM: u32 = 3;

/// A ray through a pixel of known depth and colour.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColorRay {
    /// World metres.
    pub origin: Vec3,
    /// With z = 1 in camera axes, so that lengths are depths.
    pub direction: Vec3,
    /// z-depth of the return, m.
    pub z: f32,
    /// sRGB, with the gain of its frame; can leave 0..1.
    pub color: Vec3,
}

/// The one of `frames` with colours that a step sees, as an image, where it draws by tiles; none where
/// none has any.
pub fn frame_of_step<'a>(plan: &RayPlan, frames: &[&'a KeyFrame]) -> Option<&'a KeyFrame> {
    let colored = || frames.iter().filter(|frame| !frame.colors.is_empty());
    let [word, ..] = pcg4d([plan.seed, plan.step, u32::MAX, STREAM]);
    let at = (u64::from(word) * colored().count() as u64) >> 32;
    colored().nth(at as usize).copied()
}

/// Draws `rays` rays, split equally over those of `frames` that have colours. Rays whose surface is
/// no longer there are skipped.
pub fn draw_colors(
    plan: &RayPlan,
    rays: u32,
    frames: &[&KeyFrame],
    topology: &Topology,
    surface: &Surface,
    pool: &rayon::ThreadPool,
) -> Vec<ColorRay> {
    let frames: Vec<&KeyFrame> = frames.iter().copied().filter(|f| !f.colors.is_empty()).collect();
    if frames.is_empty() {
        return Vec::new();
    }
    let stale = stale_m(surface);
    let draw = |ray: u32| {
        let frame = frames[(u64::from(ray) * frames.len() as u64 / u64::from(rays)) as usize];
        let words = pcg4d([plan.seed, plan.step, ray, STREAM]);
        let index = ((u64::from(words[0]) * frame.pixels.len() as u64) >> 32) as usize;
        let pixel = frame.pixels[index];
        let (origin, direction) = (frame.origin, frame.direction(pixel));
        let (distance, _) = surface.label(topology, origin + direction * pixel.z)?;
        let color = Vec3::from(frame.colors[index].map(f32::from)) * (1.0 / 255.0) * frame.gain;
        (distance.abs() <= stale).then_some(ColorRay { origin, direction, z: pixel.z, color })
    };
    let chunks: Vec<u32> = (0..rays.div_ceil(CHUNK)).collect();
    let chunk = |&chunk: &u32| -> Vec<ColorRay> {
        (chunk * CHUNK..((chunk + 1) * CHUNK).min(rays)).filter_map(draw).collect()
    };
    let parts: Vec<Vec<ColorRay>> = pool.install(|| chunks.par_iter().map(chunk).collect());
    parts.concat()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::*;
    use crate::dataset::Dataset;
    use crate::dataset::synthetic::Synthetic;

    #[test]
    fn a_step_by_tiles_sees_one_frame_that_has_colours_and_all_get_their_turn() {
        let frame = Synthetic::room(60).with_width(32).load(0, false).expect("a frame");
        let blind = KeyFrame::new(&frame, None, 4096, 0.1, None);
        let colored = [0u8, 1, 2].map(|shade| {
            let colors = Arc::from(vec![[shade; 3]; blind.pixels.len()]);
            KeyFrame { colors, ..blind.clone() }
        });
        let frames = [&colored[0], &blind, &colored[1], &colored[2]];
        let mut turns = [0; 3];
        for step in 0..300 {
            let plan = RayPlan { rays: 0, seed: 5, step, eikonal_share: 0.0 };
            let frame = frame_of_step(&plan, &frames).expect("three have colours");
            turns[usize::from(frame.colors[0][0])] += 1;
        }
        assert!(turns.iter().all(|turns| *turns > 60), "{turns:?}");
        let plan = RayPlan { rays: 0, seed: 5, step: 0, eikonal_share: 0.0 };
        assert!(frame_of_step(&plan, &[&blind]).is_none());
    }
}
