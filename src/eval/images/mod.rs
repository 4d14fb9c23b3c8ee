//! Rendered images beside true ones: views of a truth folder's `novel/`, which no frame was mapped
//! from.

mod lpips;
mod pixels;
mod ssim;

use std::path::Path;
use std::time::{Duration, Instant};

use rayon::ThreadPool;

use super::report::ImageErrors;
use crate::config::name_of;
use crate::dataset::{self, Dataset, Format};
use crate::error::{Error, Result};
use crate::map::{Camera, Channels, MapView, RenderSettings, render};

pub use lpips::Lpips;
use pixels::{Pair, PairErrors};

/// Renders every view of the folder `novel` as the map shows it and compares. `None` for a map without
/// radiance: it has no colours to judge.
pub fn image_errors(
    view: &MapView,
    novel: &Path,
    settings: &RenderSettings,
    lpips: Option<&Lpips>,
    pool: &ThreadPool,
) -> Result<Option<ImageErrors>> {
    if !view.config().has("radiance") {
        return Ok(None);
    }
    let data = dataset::open(novel, Format::SevenScenes)?;
    let (mut errors, mut drawing) = (Vec::with_capacity(data.len()), Duration::ZERO);
    for index in 0..data.len() {
        let (pair, spent) = pair_errors(view, data.as_ref(), index, settings, lpips, pool)?;
        errors.push(pair);
        drawing += spent;
    }
    let images_per_second = errors.len() as f64 / drawing.as_secs_f64();
    Ok(Some(ImageErrors { images_per_second, ..mean(&errors, name_of(settings.renderer)) }))
}

/// What one view scores, and how long it was drawn.
fn pair_errors(
    view: &MapView,
    data: &dyn Dataset,
    index: usize,
    settings: &RenderSettings,
    lpips: Option<&Lpips>,
    pool: &ThreadPool,
) -> Result<(PairErrors, Duration)> {
    let truth = data.load(index, true)?;
    let missing =
        || Error::invalid("truth", format!("view {index} of {} has no colour", data.name()));
    let colour = truth.color.as_ref().ok_or_else(missing)?;
    let camera =
        Camera { world_from_camera: truth.world_from_camera, intrinsics: truth.intrinsics };
    camera.check()?;
    let channels = Channels { color: true, depth: true, ..Channels::default() };
    let started = Instant::now();
    let rendering = render(view, &camera, channels, settings, pool, &|| false)
        .ok_or_else(|| Error::Internal("a rendering was left, though nobody asked".into()))?;
    let spent = started.elapsed();
    let ours: Vec<[u8; 3]> =
        rendering.color.iter().map(|c| c.to_array().map(pixels::to_byte)).collect();
    let pair = Pair {
        width: rendering.width as usize,
        height: rendering.height as usize,
        ours: bytemuck::cast_slice(&ours),
        depth_m: &rendering.depth_m,
        truth: &colour.rgb,
        truth_depth_m: &truth.depth.metres,
    };
    let mut errors = pool.install(|| pair.errors());
    errors.lpips = lpips.map(|lpips| lpips.distance(&pair)).transpose()?;
    Ok((errors, spent))
}

/// The mean of each figure over the images that have it.
fn mean(errors: &[PairErrors], renderer: String) -> ImageErrors {
    let over = |of: &dyn Fn(&PairErrors) -> f64| {
        let (mut sum, mut count) = (0.0, 0);
        for value in errors.iter().map(of).filter(|value| value.is_finite()) {
            sum += value;
            count += 1;
        }
        sum / f64::from(count)
    };
    ImageErrors {
        psnr_covered: over(&|e| e.psnr_covered),
        psnr_full: over(&|e| e.psnr_full),
        ssim: over(&|e| e.ssim),
        depth_l1_m: over(&|e| e.depth_l1_m),
        depth_median_m: over(&|e| e.depth_median_m),
        coverage: over(&|e| e.coverage),
        renderer,
        lpips: errors
            .iter()
            .any(|e| e.lpips.is_some())
            .then(|| over(&|e| e.lpips.unwrap_or(f64::NAN))),
        images_per_second: f64::NAN,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_leave_out_what_an_image_does_not_have() {
        let one = PairErrors {
            psnr_covered: 30.0,
            psnr_full: 20.0,
            ssim: 0.9,
            depth_l1_m: 0.004,
            depth_median_m: 0.002,
            coverage: 1.0,
            lpips: None,
        };
        let empty = PairErrors {
            psnr_covered: f64::NAN,
            psnr_full: 10.0,
            depth_l1_m: f64::NAN,
            depth_median_m: f64::NAN,
            coverage: 0.0,
            ..one
        };
        let both = mean(&[one, empty], "ray".into());
        assert_eq!((both.psnr_covered, both.psnr_full, both.coverage), (30.0, 15.0, 0.5));
        assert_eq!((both.depth_l1_m, both.lpips, both.renderer.as_str()), (0.004, None, "ray"));
        assert!(mean(&[empty], String::new()).depth_l1_m.is_nan(), "a mean over nothing");
        let judged = PairErrors { lpips: Some(0.25), ..one };
        assert_eq!(mean(&[judged, one], String::new()).lpips, Some(0.25));
    }
}
