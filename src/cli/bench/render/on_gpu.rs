//! The same images by tiles on a GPU: what bringing a map there takes, what drawing takes, what
//! bringing an image back takes, and how far the images lie from the CPU's.

use std::sync::Arc;
use std::time::Instant;

use anyhow::Context;
use rayon::ThreadPool;

use super::{RenderBenchArgs, TIMED, Truth, mean, psnr};
use crate::cli::bench::figure::{Figure, Target, Unit, median};
use crate::cli::render::Size;
use crate::config::BackendChoice;
use crate::map::{Channels, MapView, Painter, RenderSettings, Rendering, Subject};

/// Images that are drawn in a row to time one.
const IN_A_ROW: u32 = 20;
/// The size that the target is about, and the target: images that a hardware GPU draws by itself.
const JUDGED: Size = Size { width: 1200, height: 680 };
const SPEED: Target = Target::at_least(1500.0);

const SETTINGS: RenderSettings = RenderSettings::USUAL;

/// A GPU that is measured.
pub(super) struct OnGpu {
    painter: Painter,
    /// Whether it is hardware, of which alone a speed is demanded.
    is_hardware: bool,
    /// Time that the whole map took to the GPU, ms.
    upload_ms: f64,
}

impl OnGpu {
    /// The GPU that was asked for, if there is one, with the map brought there.
    pub(super) fn open(choice: BackendChoice, view: &Arc<MapView>) -> anyhow::Result<Option<Self>> {
        let Some(mut painter) = Painter::open(choice)? else { return Ok(None) };
        let start = Instant::now();
        painter.follow(view, &SETTINGS)?;
        let upload_ms = milliseconds(start);
        let is_hardware = crate::backend::adapters()
            .iter()
            .any(|adapter| adapter.is_hardware && adapter.name == painter.adapter());
        Ok(Some(Self { painter, is_hardware, upload_ms }))
    }

    /// The name of its cases.
    pub(super) fn name(&self) -> String {
        format!("tile on {}", self.painter.adapter())
    }

    /// What the whole map took, and what a later view takes after it.
    pub(super) fn uploads(&mut self, next: &Arc<MapView>) -> anyhow::Result<Vec<Figure>> {
        let start = Instant::now();
        self.painter.follow(next, &SETTINGS)?;
        let name = self.name();
        let figure = |measure, ms| Figure::new(&name, measure, ms, Unit::Milliseconds);
        Ok(vec![figure("map_upload", self.upload_ms), figure("epoch_upload", milliseconds(start))])
    }

    /// All views, beside those of the CPU.
    pub(super) fn figures(
        &mut self,
        name: &str,
        arguments: &RenderBenchArgs,
        view: &Arc<MapView>,
        (truths, cpu): (&[Truth], &[Rendering]),
        pool: &ThreadPool,
    ) -> anyhow::Result<(Vec<Rendering>, Vec<Figure>)> {
        let mut images = Vec::new();
        let mut passes: Vec<(&'static str, Vec<f64>)> = Vec::new();
        for truth in truths {
            let (image, times) =
                self.painter.render(&subject(view, truth, TIMED[1]), pool, &|| false)?;
            images.push(image.context("nobody asked to stop")?);
            for (pass, ms) in times {
                match passes.iter_mut().find(|(name, _)| *name == pass) {
                    Some((_, all)) => all.push(ms.into()),
                    None => passes.push((pass, vec![ms.into()])),
                }
            }
        }
        let (mut draw_ms, mut image_ms) = ([Vec::new(), Vec::new()], Vec::new());
        for truth in (0..arguments.rounds).flat_map(|_| truths) {
            for (channels, draw_ms) in TIMED.into_iter().zip(&mut draw_ms) {
                let start = Instant::now();
                self.painter.draw_only(&subject(view, truth, channels), IN_A_ROW)?;
                draw_ms.push(milliseconds(start) / f64::from(IN_A_ROW));
            }
            let start = Instant::now();
            let drawn = self.painter.render(&subject(view, truth, TIMED[0]), pool, &|| false)?;
            std::hint::black_box(drawn);
            image_ms.push(milliseconds(start));
        }
        let case = format!("{name}, {}", self.name());
        let figure = |measure: &str, value, unit| Figure::new(&case, measure, value, unit);
        let ms = |measure: &str, value| figure(measure, value, Unit::Milliseconds);
        let (draw, image) = (median(&draw_ms[0]), median(&image_ms));
        let k = &truths[0].camera.intrinsics;
        let judged = self.is_hardware && (k.width, k.height) == (JUDGED.width, JUDGED.height);
        let mut figures = vec![
            figure("images_per_second", 1e3 / draw, Unit::FramesPerSecond)
                .against(judged.then_some(SPEED)),
            ms("draw_time", draw),
            ms("all_channels_draw_time", median(&draw_ms[1])),
            ms("image_time", image),
            ms("readback_time", image - draw),
        ];
        figures.extend(passes.iter().map(|(pass, all)| ms(&pass.replace('/', "_"), median(all))));
        figures.extend(differences(&case, &images, cpu));
        Ok((images, figures))
    }
}

/// How far the images lie from those of the CPU.
fn differences(case: &str, images: &[Rendering], cpu: &[Rendering]) -> Vec<Figure> {
    let (mut alike, mut depth, mut different) = (Vec::new(), Vec::new(), Vec::new());
    for (image, cpu) in images.iter().zip(cpu) {
        alike.push(psnr(&image.color, |i| Some(cpu.color[i])));
        let errors: Vec<f64> = (image.depth_m.iter().zip(&cpu.depth_m))
            .filter(|(a, b)| **a > 0.0 && **b > 0.0)
            .map(|(a, b)| f64::from((a - b).abs()))
            .collect();
        depth.push(mean(&errors));
        let bits = image.unknown.iter().zip(&cpu.unknown).filter(|(a, b)| a != b).count();
        different.push(bits as f64 / image.unknown.len() as f64);
    }
    let figure = |measure, values: &[f64], unit| Figure::new(case, measure, mean(values), unit);
    vec![
        figure("psnr_against_cpu", &alike, Unit::Decibels),
        figure("depth_l1_against_cpu", &depth, Unit::Metres),
        figure("unknown_against_cpu", &different, Unit::Share),
    ]
}

fn subject<'a>(view: &'a Arc<MapView>, truth: &'a Truth, channels: Channels) -> Subject<'a> {
    Subject { view, camera: &truth.camera, channels, settings: &SETTINGS, text: None }
}

fn milliseconds(start: Instant) -> f64 {
    start.elapsed().as_secs_f64() * 1e3
}
