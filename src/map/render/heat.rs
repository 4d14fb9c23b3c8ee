//! How well a text fits what an image shows (paper eq:relevancy), pixel by pixel.

use glam::Vec3;
use rayon::ThreadPool;
use rayon::prelude::*;

use super::{Job, Rendering};
use crate::map::language::Scorer;
use crate::octree::Lookup;

/// Pixels between two looks at whether to stop.
const CHUNK: usize = 4096;
/// How much of a place's own brightness is left under the heat.
const SHADE: f32 = 0.75;
/// The best place of an image is drawn hottest, unless it fits no better than this above what is
/// cold.
const LEAST_RANGE: f32 = 0.1;
/// Heat from cold to hot, sRGB.
const HEAT: [Vec3; 4] = [
    Vec3::new(0.32, 0.10, 0.43),
    Vec3::new(0.78, 0.22, 0.31),
    Vec3::new(0.98, 0.55, 0.05),
    Vec3::new(0.99, 0.95, 0.50),
];

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
                *score = text.score(&code, code.iter().map(|x| x * x).sum());
            }
        }
        Some(())
    };
    pool.install(|| scores.par_chunks_mut(CHUNK).enumerate().map(score).collect::<Option<()>>())?;
    Some(scores)
}

impl Rendering {
    /// The heat over the colours in grey, sRGB; scores of `cold` and below are left grey. Needs the
    /// channels of colour and heat.
    pub fn heat_picture(&self, cold: f32) -> Vec<Vec3> {
        let best = self.heat.iter().copied().filter(|x| x.is_finite()).fold(cold, f32::max);
        let range = (best - cold).max(LEAST_RANGE);
        let paint = |(color, score): (&Vec3, &f32)| {
            let grey = Vec3::splat(color.dot(Vec3::new(0.299, 0.587, 0.114)) * SHADE);
            let heat = ((score - cold) / range).clamp(0.0, 1.0);
            if score.is_nan() || heat == 0.0 {
                return grey;
            }
            let at = heat * (HEAT.len() - 1) as f32;
            let low = (at as usize).min(HEAT.len() - 2);
            let hue = HEAT[low].lerp(HEAT[low + 1], at - low as f32);
            // A little of the picture stays, so that one sees what is hot.
            grey.lerp(hue * (0.6 + 0.4 * grey / SHADE), 0.25 + 0.7 * heat)
        };
        self.color.iter().zip(&self.heat).map(paint).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heat_is_where_the_score_is() {
        let rendering = Rendering {
            width: 4,
            height: 1,
            color: vec![Vec3::splat(0.8); 4],
            heat: vec![0.2, 0.5, 0.9, f32::NAN],
            ..Rendering::default()
        };
        let picture = rendering.heat_picture(0.5);
        let grey = |color: Vec3| color.max_element() - color.min_element() < 1e-6;
        assert!(grey(picture[0]) && grey(picture[1]) && grey(picture[3]), "{picture:?}");
        assert!(picture[2].x > 0.85 && picture[2].z < 0.6, "{picture:?}");
        let faint = Rendering { heat: vec![0.51; 4], ..rendering };
        assert!(faint.heat_picture(0.5)[0].x < 0.7, "nothing fits, so nothing glows");
    }
}
