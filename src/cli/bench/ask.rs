//! `orenx bench ask`: what language costs, in frames and in questions.

mod words;

use std::sync::Arc;

use clap::Args;
use glam::Vec3;

use super::clock::Clock;
use super::figure::{Figure, Target, Unit, median, percentile};
use super::printer::Printer;
use crate::cli::encoder::EncoderArgs;
use crate::config::{MapConfig, MapSettings};
use crate::dataset::Dataset;
use crate::dataset::synthetic::Synthetic;
use crate::frame::{Contract, FeatureImage, Frame, LabelImage};
use crate::geometry::random::{normal, pcg4d};
use crate::map::{
    Camera, Channels, Fields, FindSettings, MapView, Mapper, RenderSettings, Scorer, query_pool,
    render_with,
};
use crate::modality::language::NEGATIVES;

/// Frames a second with features and without, and milliseconds of questions about texts (a synthetic
/// house whose patches have noisy features of their classes)
#[derive(Debug, Args)]
pub(super) struct AskBenchArgs {
    /// Frames of the walk through the house
    #[arg(long, value_name = "N", default_value_t = 120, value_parser = clap::value_parser!(u32).range(2..=10_000))]
    frames: u32,
    /// Width of the images, pixels
    #[arg(long, value_name = "PIXELS", default_value_t = 640, value_parser = clap::value_parser!(u32).range(64..=4096))]
    width: u32,
    /// Numbers of a feature
    #[arg(long, value_name = "N", default_value_t = 512, value_parser = clap::value_parser!(u32).range(16..=4096))]
    dimension: u32,
    /// Patches along the width of an image
    #[arg(long, value_name = "N", default_value_t = 40, value_parser = clap::value_parser!(u32).range(2..=128))]
    patches: u32,
    /// Distance between vertices that hold codes, metres
    #[arg(long, value_name = "M", default_value_t = 0.1)]
    code_spacing: f32,
    /// Ask each question so many times
    #[arg(long, value_name = "N", default_value_t = 30, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    repeat: u32,
    /// Ask the house in free words, too, with its classes' names embedded by this
    #[command(flatten)]
    encoder: EncoderArgs,
    /// Threads that draw
    #[arg(long, value_name = "N", default_value_t = 2)]
    threads: usize,
}

/// On two cores, with the default settings and all four modalities.
const FRAMES_PER_SECOND: Target = Target::at_least(8.0);
/// A question about the whole map.
const FIND_MS: Target = Target::at_most(30.0);
/// Points of a question about points.
const POINTS: usize = 10_000;
/// How far a feature strays from the direction of its class, as a share of its length.
const NOISE: f32 = 0.6;

impl AskBenchArgs {
    pub(super) fn run(&self, out: &mut Printer) -> anyhow::Result<()> {
        let data = Synthetic::house(self.frames as usize).with_width(self.width);
        let frames =
            (0..data.len()).map(|i| self.frame(&data, i)).collect::<Result<Vec<_>, _>>()?;
        let size = format!("{}×{}", data.intrinsics().width, data.intrinsics().height);
        let name = format!("house, {} frames of {size}, {} numbers", frames.len(), self.dimension);
        let (_, without) = self.map(&frames, &["sdf", "occupancy", "radiance"])?;
        let (view, with) = self.map(&frames, &[])?;
        out.figures([
            Figure::new(&name, "frames_per_second_without", without, Unit::FramesPerSecond),
            Figure::new(&name, "frames_per_second", with, Unit::FramesPerSecond)
                .against(Some(FRAMES_PER_SECOND)),
            Figure::new(&name, "cost_of_language", without / with, Unit::Times),
        ])?;
        let Some(counts) = view.language() else { anyhow::bail!("no frame had features") };
        out.figures([
            Figure::new(&name, "atoms", counts.atoms as f64, Unit::Count),
            Figure::new(&name, "vertices", counts.vertices as f64, Unit::Count),
            Figure::new(&name, "codes", counts.bytes as f64, Unit::Bytes),
        ])?;
        let name = format!("{} vertices, {} atoms", counts.vertices, counts.atoms);
        self.ask(&view, &frames, &name, out)?;
        match self.encoder.open()? {
            Some(encoder) => words::run(&data, &encoder, &self.settings(&[]), out),
            None => Ok(()),
        }
    }

    /// Questions of one prompt against as many negatives as there are by default.
    fn ask(
        &self,
        view: &MapView,
        frames: &[Frame],
        name: &str,
        out: &mut Printer,
    ) -> anyhow::Result<()> {
        let embedding = |class: usize| direction(class as u32, self.dimension as usize);
        let negatives: Vec<Vec<f32>> = (0..NEGATIVES.len()).map(|i| embedding(1000 + i)).collect();
        let scorer = |prompt: usize| view.scorer(&[embedding(prompt)], &negatives);
        let settings = FindSettings { region: None, min_score: 0.5, top_k: 5, places: false };
        let find = |scorer: &Scorer| view.find(scorer, &settings, &|| false);
        let points = surface_points(frames);
        let score = Fields { text_score: true, distance: true, ..Fields::NONE };
        let pool = query_pool(self.threads)?;
        let camera = Camera {
            world_from_camera: frames[0].world_from_camera,
            intrinsics: frames[0].intrinsics,
        };
        let draw = |heat: bool, scorer: &Scorer| {
            let channels = Channels { color: true, heat, ..Channels::NONE };
            let settings = RenderSettings::default();
            render_with(view, &camera, channels, &settings, Some(scorer), &pool, &|| false)
        };
        let texts: Vec<Scorer> =
            (0..self.repeat).map(|i| scorer(i as usize % 20)).collect::<Result<_, _>>()?;
        let timed = |work: &dyn Fn(&Scorer)| {
            let once = |text: &Scorer| {
                let clock = Clock::start();
                work(text);
                clock.elapsed().wall_s * 1e3
            };
            texts.iter().map(once).collect::<Vec<f64>>()
        };
        type Work<'a> = Box<dyn Fn(&Scorer) + 'a>;
        let cases: [(&str, Option<Target>, Work<'_>); 5] = [
            ("find", Some(FIND_MS), Box::new(|text| drop(std::hint::black_box(find(text))))),
            (
                "points_10k",
                None,
                Box::new(|text| {
                    drop(std::hint::black_box(view.query_with(&points, score, Some(text))));
                }),
            ),
            (
                "points_10k_distance_alone",
                None,
                Box::new(|_| drop(std::hint::black_box(view.query(&points, Fields::DISTANCE)))),
            ),
            ("image_heat", None, Box::new(|text| drop(std::hint::black_box(draw(true, text))))),
            ("image_color", None, Box::new(|text| drop(std::hint::black_box(draw(false, text))))),
        ];
        for (measure, target, work) in cases {
            let took = timed(&*work);
            let p95 = percentile(&took, 0.95);
            out.figures([
                Figure::new(name, measure, median(&took), Unit::Milliseconds),
                Figure::new(name, format!("{measure}_p95"), p95, Unit::Milliseconds)
                    .against(target),
            ])?;
        }
        Ok(())
    }

    /// The map of all frames and how many of them it took in a second, publishing included.
    fn map(&self, frames: &[Frame], modalities: &[&str]) -> anyhow::Result<(Arc<MapView>, f64)> {
        let mut mapper = Mapper::new(MapConfig::from_settings(&self.settings(modalities))?)?;
        let clock = Clock::start();
        let mut view = mapper.publish();
        for frame in frames {
            mapper.integrate(frame)?;
            view = mapper.publish();
        }
        Ok((view, frames.len() as f64 / clock.elapsed().wall_s))
    }

    fn settings(&self, modalities: &[&str]) -> MapSettings {
        MapSettings {
            modalities: modalities.iter().map(|name| (*name).to_owned()).collect(),
            code_spacing_m: self.code_spacing,
            ..MapSettings::default()
        }
    }

    /// A frame with a grid of patches, each with a noisy feature of the class in its middle.
    fn frame(&self, data: &Synthetic, index: usize) -> anyhow::Result<Frame> {
        let mut frame = data.load(index, true)?;
        let labels = data.labels(index)?;
        frame.features = labels.map(|labels| self.features(&labels, index as u32));
        Ok(frame)
    }

    fn features(&self, labels: &LabelImage, index: u32) -> FeatureImage {
        let (width, dimension) = (self.patches, self.dimension as usize);
        let height = (width * labels.height / labels.width).max(1);
        let places = labels.places();
        let mut features = Vec::with_capacity((width * height) as usize * dimension);
        for patch in 0..width * height {
            let u = (2 * (patch % width) + 1) * labels.width / (2 * width);
            let v = (2 * (patch / width) + 1) * labels.height / (2 * height);
            let class = places[(v * labels.width + u) as usize];
            let noise = directions(patch | index << 16, 2, dimension);
            let class = direction(u32::from(class), dimension);
            features.extend(class.iter().zip(noise).map(|(x, noise)| x + NOISE * noise));
        }
        FeatureImage {
            contract: Contract { encoder_id: "classes".into(), dimension },
            width,
            height,
            index: None,
            features,
        }
    }
}

/// What stands for a class, of length 1.
fn direction(class: u32, dimension: usize) -> Vec<f32> {
    directions(class, 1, dimension).collect()
}

/// A vector of about length 1 in a random direction.
fn directions(seed: u32, stream: u32, dimension: usize) -> impl Iterator<Item = f32> {
    let scale = 1.0 / (dimension as f32).sqrt();
    (0..dimension as u32).map(move |i| {
        let [a, b, ..] = pcg4d([seed, stream, i, 31]);
        scale * normal(a, b)
    })
}

/// Points of surfaces that frames saw.
fn surface_points(frames: &[Frame]) -> Vec<Vec3> {
    let pixels: usize = frames.iter().map(|frame| frame.intrinsics.pixels()).sum();
    let step = (pixels / POINTS).max(1);
    let of = |frame: &Frame| -> Vec<Vec3> {
        let k = frame.intrinsics;
        let places = (0..k.pixels() as u32).step_by(step).map(|i| (i % k.width, i / k.width));
        let returns = places.filter(|(u, v)| frame.depth.at(*u, *v) > 0.0);
        returns.map(|(u, v)| frame.world_point(u, v, frame.depth.at(u, v))).collect()
    };
    frames.iter().flat_map(of).take(POINTS).collect()
}
