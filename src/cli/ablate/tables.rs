//! The measurements, a table each.

use std::io::Write;

use rayon::ThreadPool;

use super::page::{Better, Column, Row, Table};
use crate::cli::bench::recording::Recording;
use crate::cli::eval::judge;
use crate::config::{MapSettings, Prior, Profile, name_of};
use crate::dataset::Noise;
use crate::error::Result;
use crate::eval::{FieldErrors, ImageErrors, Lpips, Truth, image_errors};
use crate::geometry::harmonics::MAX_DEGREE;
use crate::map::{MapView, RenderSettings, Renderer, SamplePosition, query_pool};

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
    color_degree: u8,
}

impl Variant {
    /// Every modality, from the closed form, trained: the default.
    const USUAL: Self =
        Self { prior: Prior::Closed, modalities: &[], trains: true, color_degree: 0 };
}

/// A map that was made and judged.
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
    steps: Option<u32>,
    lpips: Option<Lpips>,
    pool: ThreadPool,
    /// The map of [`Variant::USUAL`], once somebody has asked for it.
    usual: Option<std::sync::Arc<MapView>>,
}

impl<'a> Study<'a> {
    pub(super) fn new(
        recording: &'a Recording,
        truth: &'a Truth,
        profile: Profile,
        steps: Option<u32>,
        lpips: Option<Lpips>,
    ) -> Result<Self> {
        let pool = query_pool(0)?;
        Ok(Self { recording, truth, profile, steps, lpips, pool, usual: None })
    }

    fn make(&self, what: &str, variant: Variant, noise: Option<Noise>) -> Result<Made> {
        let settings = MapSettings {
            profile: self.profile,
            prior: variant.prior,
            modalities: variant.modalities.iter().map(|name| (*name).to_owned()).collect(),
            steps: if variant.trains { self.steps } else { Some(0) },
            color_degree: variant.color_degree,
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
            let made = self.make(name, Variant { modalities, ..Variant::USUAL }, None)?;
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
                   end to end, decoding included. The paper's tab:profiling, and the clean column of \
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
                (format!("{start}, {name}"), Variant { prior, modalities, ..Variant::USUAL })
            }));
        }
        let mut rows = Vec::new();
        for (name, variant) in variants {
            let mut values = Vec::new();
            for noise in [None].into_iter().chain(levels.iter().copied().map(Some)) {
                let field = self.make(&name, variant, noise)?.field;
                values.push(field.map_or(f64::NAN, |f| f.sdf_mae_m.near_observed * 1e3));
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
                   gaussian:S is S metres, axial:S is S times the depth. The paper's \
                   tab:noise_robustness, which starts from zero.",
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
        let settings = [SamplePosition::ZeroCrossing, SamplePosition::Midpoint].map(|sample| {
            let settings =
                RenderSettings { sample, renderer: Renderer::Ray, ..RenderSettings::default() };
            (name_of(sample), settings)
        });
        self.images(
            ("sample", "Where a ray takes its colour"),
            "Means over the unseen views, drawn by rays. The paper's tab:surface_qstar.",
            &settings,
        )
    }

    /// Nothing without unseen views.
    pub(super) fn renderer(&mut self) -> Result<Option<Table>> {
        let settings = [Renderer::Ray, Renderer::Tile].map(|renderer| {
            (name_of(renderer), RenderSettings { renderer, ..RenderSettings::default() })
        });
        self.images(
            ("renderer", "What draws the images"),
            "Means over the unseen views of one map. The paper's tab:renderer_choice, as far as it \
             is about evaluation.",
            &settings,
        )
    }

    fn images(
        &mut self,
        (file, title): (&'static str, &'static str),
        note: &'static str,
        variants: &[(String, RenderSettings)],
    ) -> Result<Option<Table>> {
        let Some(novel) = &self.truth.novel else { return Ok(None) };
        let view = match self.usual.take() {
            Some(view) => view,
            None => self.make("every modality", Variant::USUAL, None)?.view,
        };
        let mut rows = Vec::new();
        for (name, settings) in variants {
            let errors = image_errors(&view, novel, settings, self.lpips.as_ref(), &self.pool)?;
            let Some(errors) = errors else { return Ok(None) };
            say(&format!("  {name}: {:.1} images/s", errors.images_per_second));
            rows.push(Row::new(name, image_values(&errors)));
        }
        self.usual = Some(view);
        let columns = vec![
            Column::new("PSNR, dB", Better::Higher, 2),
            Column::new("SSIM", Better::Higher, 4),
            Column::new("LPIPS", Better::Lower, 4),
            Column::new("depth L1, mm", Better::Lower, 2),
            Column::new("coverage, %", Better::Higher, 2),
            Column::new("images/s", Better::Higher, 1),
        ];
        Ok(Some(Table { file, title, note, columns, rows, charted: 0..1 }))
    }
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
