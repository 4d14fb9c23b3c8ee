//! How well a text fits what an image shows (paper eq:relevancy), pixel by pixel.

use rayon::ThreadPool;
use rayon::prelude::*;

use super::Job;
use crate::map::language::Scorer;
use crate::octree::Lookup;

/// Pixels between two looks at whether to stop.
const CHUNK: usize = 4096;
/// The score of the text at the surface that each pixel shows; NaN where there is none, or none that
/// was seen with features. `None` if interrupted.
pub(super) fn scores(
    job: &Job<'_>,
    depth_m: &[f32],
    text: &Scorer,
    pool: &ThreadPool,
    interrupted: &(dyn Fn() -> bool + Sync),
) -> Option<Vec<f32>> {
    let (store, width) = (&job.view.store, job.rays.intrinsics.width);
    let mut scores = vec![f32::NAN; depth_m.len()];
    let Some(lookup) = Lookup::new(store) else { return Some(scores) };
    let atoms = job.view.atoms();
    let score = |(chunk, scores): (usize, &mut [f32])| {
        if interrupted() {
            return None;
        }
        let mut code = vec![0.0; atoms];
        for (i, score) in scores.iter_mut().enumerate() {
            let pixel = chunk * CHUNK + i;
            let (u, v) = (pixel as u32 % width, pixel as u32 / width);
            if depth_m[pixel] <= 0.0 {
                continue;
            }
            let point = job.rays.eye + job.rays.direction(u, v) * depth_m[pixel];
            let voxel = lookup.find(point);
            if voxel.is_some() && store.code(voxel.node, point, &mut code) {
                *score = text.score(&code);
            }
        }
        Some(())
    };
    pool.install(|| scores.par_chunks_mut(CHUNK).enumerate().map(score).collect::<Option<()>>())?;
    Some(scores)
}
