//! The measurements, a table each.

use std::io::Write;
use std::path::Path;

use rayon::ThreadPool;

use super::page::{Better, Column, Row, Table};
use crate::cli::bench::recording::Recording;
use crate::cli::eval::judge;
use crate::config::{MapSettings, Prior, Profile, Renderer, name_of};
use crate::dataset::Noise;
use crate::error::Result;
use crate::eval::{FieldErrors, ImageErrors, Lpips, Truth, image_errors};
use crate::geometry::harmonics::MAX_DEGREE;
use crate::map::{MapView, RenderSettings, SamplePosition, query_pool};

/// The paper's levels (tab:noise_robustness), m and m per m.
const NOISE: [Noise; 6] = [
    Noise::Gaussian(0.01),
    Noise::Gaussian(0.02),
    Noise::Gaussian(0.05),
    Noise::Axial(0.0011),
    Noise::Axial(0.0023),
    Noise::Axial(0.0057),
];

/// The paper's columns (tab:profiling, tab:noise_robustness).
const MODALITIES: [(&str, &[&str]); 4] = [
    ("SDF", &["sdf"]),
    ("SDF+OCC", &["sdf", "occupancy"]),
    ("SDF+Rad", &["sdf", "radiance"]),
    ("SDF+OCC+Rad", &["sdf", "occupancy", "radiance"]),
];

/// How a map is made.
#[derive(Debug, Clone, Copy)]
struct Variant {
    prior: Prior,
    modalities: &'static [&'static str],
    trains: bool,
    /// What draws colours that training compares; `None`: it compares none.
    compares: Option<Renderer>,
    color_degree: u8,
}

impl Variant {
    /// Every modality, from the closed form, trained: the default.
    const USUAL: Self = Self {
        prior: Prior::Closed,
        modalities: &[],
        trains: true,
        compares: None,
        color_degree: 0,
    };

    /// With these fields; colours are compared by rays where there are any, as in the paper.
    fn with(self, modalities: &'static [&'static str]) -> Self {
        let compares = modalities.contains(&"radiance").then_some(Renderer::Ray);
        Self { modalities, compares, ..self }
    }
}

/// A map that was made and judged.
#[derive(Clone)]
struct Made {
    view: std::sync::Arc<MapView>,
    field: Option<FieldErrors>,
    frames_per_second: f64,
    map_bytes: u64,
}

/// One recording, and what it is judged by.
pub(super) struct Study<'a> {
    recording: &'a Recording,
    truth: &'a Truth,
    profile: Profile,
    /// Steps a frame, where a map trains; `None` follows the profile.
    steps: Option<u32>,
    /// Rays of a step whose colours are compared, where a map compares any.
    color_rays: u32,
    lpips: Option<Lpips>,
    pool: ThreadPool,
    /// The map of [`Variant::USUAL`], once somebody has asked for it.
    usual: Option<Made>,
}

impl<'a> Study<'a> {
    pub(super) fn new(
        recording: &'a Recording,
        truth: &'a Truth,
        profile: Profile,
        (steps, color_rays): (Option<u32>, u32),
        lpips: Option<Lpips>,
    ) -> Result<Self> {
        let pool = query_pool(0)?;
        Ok(Self { recording, truth, profile, steps, color_rays, lpips, pool, usual: None })
    }

    fn make(&self, what: &str, variant: Variant, noise: Option<Noise>) -> Result<Made> {
        let settings = MapSettings {
            profile: self.profile,
            prior: variant.prior,
            modalities: variant.modalities.iter().map(|name| (*name).to_owned()).collect(),
            steps: if variant.trains { self.steps } else { Some(0) },
            color_degree: variant.color_degree,
            color_rays: variant.compares.map_or(0, |_| self.color_rays),
            color_renderer: variant.compares.unwrap_or(Renderer::Ray),
            ..MapSettings::default()
        };
        let (mut mapper, tally) = self.recording.map(&settings, noise)?;
        let view = mapper.publish_all()?;
        let field = match &self.truth.sdf {
            Some(_) => judge(&view, self.truth)?.geometry.and_then(|g| g.field),
            None => None,
        };
        let frames_per_second = tally.frames as f64 / tally.seconds;
        let noise = noise.map_or_else(|| "no noise".to_owned(), |noise| noise.to_string());
        say(&format!("  {what}, {noise}: {:.1} s", tally.seconds));
        Ok(Made { view, field, frames_per_second, map_bytes: mapper.stats().map_bytes })
    }

    /// What each modality costs, and gives the geometry.
    pub(super) fn modalities(&mut self) -> Result<Option<Table>> {
        let mut rows = Vec::new();
        for (name, modalities) in MODALITIES {
            let made = self.make(name, Variant::USUAL.with(modalities), None)?;
            let near = |of: &dyn Fn(&FieldErrors) -> f64| made.field.as_ref().map_or(f64::NAN, of);
            rows.push(Row::new(
                name,
                vec![
                    near(&|f| f.sdf_mae_m.near_observed * 1e3),
                    near(&|f| f.sdf_mae_m.far_observed * 1e3),
                    near(&|f| f.sign_accuracy_near * 1e2),
                    made.frames_per_second,
                    made.map_bytes as f64 * 1e-6,
                ],
            ));
        }
        Ok(Some(Table {
            file: "modalities",
            title: "Modalities",
            note: "Errors are means over known points whose nearest surface was seen; frames/s are \
                   end to end, decoding included. Colours (Rad) are compared by rays, and distances \
                   learn from it. The paper's tab:profiling, and the clean column of \
                   tab:noise_robustness.",
            columns: vec![
                Column::new("near, mm", Better::Lower, 2),
                Column::new("far, mm", Better::Lower, 2),
                Column::new("sign near, %", Better::Higher, 2),
                Column::new("frames/s", Better::Higher, 1),
                Column::new("map, MB", Better::Lower, 1),
            ],
            rows,
            charted: 0..1,
        }))
    }

    /// Errors near surfaces, by start, modalities and noise. Nothing without exact distances.
    pub(super) fn noise(&mut self, only: &[Noise]) -> Result<Option<Table>> {
        if self.truth.sdf.is_none() {
            return Ok(None);
        }
        let levels = if only.is_empty() { &NOISE[..] } else { only };
        let alone = Variant { trains: false, modalities: &["sdf"], ..Variant::USUAL };
        let mut variants = vec![("closed form alone".to_owned(), alone)];
        for (start, prior) in [("closed form", Prior::Closed), ("from zero", Prior::Learned)] {
            variants.extend(MODALITIES.map(|(name, modalities)| {
                let variant = Variant { prior, ..Variant::USUAL }.with(modalities);
                (format!("{start}, {name}"), variant)
            }));
        }
        let mut rows = Vec::new();
        for (name, variant) in variants {
            let mut values = Vec::new();
            for noise in [None].into_iter().chain(levels.iter().copied().map(Some)) {
                let field = self.make(&name, variant, noise)?.field;
                values.push(field.as_ref().map_or(f64::NAN, near_mm));
            }
            rows.push(Row::new(&name, values));
        }
        let named = levels.iter().map(|noise| Column::new(&noise.to_string(), Better::Lower, 2));
        let columns: Vec<Column> =
            [Column::new("none", Better::Lower, 2)].into_iter().chain(named).collect();
        Ok(Some(Table {
            file: "noise",
            title: "Depth noise",
            note: "Mean error of the distance near surfaces, mm, by the noise that was added to depth: \
                   gaussian:S is S metres, axial:S is S times the depth. Colours (Rad) are compared by \
                   rays, and distances learn from it. The paper's tab:noise_robustness, which starts \
                   from zero.",
            charted: 0..columns.len(),
            columns,
            rows,
        }))
    }

    /// What colours that depend on the direction cost, and show. Nothing without unseen views.
    pub(super) fn color(&mut self) -> Result<Option<Table>> {
        let Some(novel) = &self.truth.novel else { return Ok(None) };
        let mut rows = Vec::new();
        for color_degree in 0..=MAX_DEGREE {
            let name = match color_degree {
                0 => "RGB".to_owned(),
                degree => format!("SH{degree}"),
            };
            let made = self.make(&name, Variant { color_degree, ..Variant::USUAL }, None)?;
            let (settings, lpips) = (RenderSettings::default(), self.lpips.as_ref());
            let errors = image_errors(&made.view, novel, &settings, lpips, &self.pool)?;
            let Some(errors) = errors else { return Ok(None) };
            rows.push(Row::new(
                &name,
                vec![
                    errors.psnr_covered,
                    errors.ssim,
                    errors.lpips.unwrap_or(f64::NAN),
                    made.map_bytes as f64 * 1e-6,
                    made.frames_per_second,
                ],
            ));
        }
        Ok(Some(Table {
            file: "color",
            title: "Colours from all sides",
            note: "RGB is the same from all sides, SHn has spherical harmonics of degree 1 to n \
                   (color_degree). Means over the unseen views; the map's memory, and frames/s end to \
                   end, decoding included. The paper's table of RGB and SH.",
            columns: vec![
                Column::new("PSNR, dB", Better::Higher, 2),
                Column::new("SSIM", Better::Higher, 4),
                Column::new("LPIPS", Better::Lower, 4),
                Column::new("map, MB", Better::Lower, 1),
                Column::new("frames/s", Better::Higher, 1),
            ],
            rows,
            charted: 0..1,
        }))
    }

    /// Nothing without unseen views.
    pub(super) fn sample(&mut self) -> Result<Option<Table>> {
        let Some(novel) = &self.truth.novel else { return Ok(None) };
        let made = self.usual()?;
        let mut rows = Vec::new();
        for sample in [SamplePosition::ZeroCrossing, SamplePosition::Midpoint] {
            let settings =
                RenderSettings { sample, renderer: Renderer::Ray, ..RenderSettings::default() };
            let name = name_of(sample);
            let Some(values) = self.images(novel, &name, &made, settings)? else { return Ok(None) };
            rows.push(Row::new(&name, values));
        }
        Ok(Some(Table {
            file: "sample",
            title: "Where a ray takes its colour",
            note: "Means over the unseen views, drawn by rays. The paper's tab:surface_qstar.",
            columns: image_columns(),
            rows,
            charted: 0..1,
        }))
    }

    /// What compares colours in training, and what draws the images. Nothing without unseen views.
    pub(super) fn renderer(&mut self) -> Result<Option<Table>> {
        let Some(novel) = &self.truth.novel else { return Ok(None) };
        let mut rows = Vec::new();
        for compares in [None, Some(Renderer::Ray), Some(Renderer::Tile)] {
            let trained = compares.map_or_else(|| "none".to_owned(), name_of);
            let made = match compares {
                None => self.usual()?,
                Some(_) => {
                    let what = format!("trained by {trained}");
                    self.make(&what, Variant { compares, ..Variant::USUAL }, None)?
                }
            };
            for renderer in [Renderer::Ray, Renderer::Tile] {
                let name = format!("{trained}/{}", name_of(renderer));
                let settings = RenderSettings { renderer, ..RenderSettings::default() };
                let images = self.images(novel, &name, &made, settings)?;
                let Some(mut values) = images else { return Ok(None) };
                let near = made.field.as_ref().map_or(f64::NAN, near_mm);
                values.extend([near, made.frames_per_second]);
                rows.push(Row::new(&name, values));
            }
        }
        let mut columns = image_columns();
        columns.extend([
            Column::new("near, mm", Better::Lower, 2),
            Column::new("frames/s", Better::Higher, 1),
        ]);
        Ok(Some(Table {
            file: "renderer",
            title: "What draws the colours that training compares, and the images",
            note: "Training/images. Where training compares none, colours are those of the closed form. \
                   Means over the unseen views; near is the mean error of the distance near surfaces; \
                   frames/s are those of mapping, decoding included. The paper's tab:renderer_choice.",
            columns,
            rows,
            charted: 0..1,
        }))
    }

    /// The map of [`Variant::USUAL`], made once.
    fn usual(&mut self) -> Result<Made> {
        let made = match &self.usual {
            Some(made) => made.clone(),
            None => self.make("every modality", Variant::USUAL, None)?,
        };
        Ok(self.usual.insert(made).clone())
    }

    /// Errors of the unseen views; nothing where there is no view to judge.
    fn images(
        &self,
        novel: &Path,
        name: &str,
        made: &Made,
        settings: RenderSettings,
    ) -> Result<Option<Vec<f64>>> {
        let errors = image_errors(&made.view, novel, &settings, self.lpips.as_ref(), &self.pool)?;
        if let Some(errors) = &errors {
            say(&format!("  {name}: {:.1} images/s", errors.images_per_second));
        }
        Ok(errors.as_ref().map(image_values))
    }
}

fn near_mm(errors: &FieldErrors) -> f64 {
    errors.sdf_mae_m.near_observed * 1e3
}

/// Of [`image_values`].
fn image_columns() -> Vec<Column> {
    vec![
        Column::new("PSNR, dB", Better::Higher, 2),
        Column::new("SSIM", Better::Higher, 4),
        Column::new("LPIPS", Better::Lower, 4),
        Column::new("depth L1, mm", Better::Lower, 2),
        Column::new("coverage, %", Better::Higher, 2),
        Column::new("images/s", Better::Higher, 1),
    ]
}

fn image_values(errors: &ImageErrors) -> Vec<f64> {
    vec![
        errors.psnr_covered,
        errors.ssim,
        errors.lpips.unwrap_or(f64::NAN),
        errors.depth_l1_m * 1e3,
        errors.coverage * 1e2,
        errors.images_per_second,
    ]
}

/// A line of progress: maps take a while.
fn say(line: &str) {
    println!("{line}");
    // A terminal that is gone does not stop the study.
    let _ = std::io::stdout().flush();
}
