//! `orenx bench render`: images of a mapped room, how fast and how true.

mod on_gpu;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Context;
use clap::Args;
use glam::Vec3;
use image::RgbImage;
use rayon::ThreadPool;

use self::on_gpu::OnGpu;
use super::clock::{Clock, Elapsed};
use super::figure::{Figure, Target, Unit, median};
use super::printer::Printer;
use super::recording::Recording;
use crate::cli::render::Size;
use crate::config::{BackendChoice, MapSettings, Profile, Renderer, name_of};
use crate::dataset::synthetic::{self, Synthetic};
use crate::dataset::{self, Dataset, Format};
use crate::frame::{ColorImage, DepthImage};
use crate::map::{Camera, Channels, MapView, RenderSettings, Rendering, query_pool, render};

/// Images of the synthetic room: time by tiles, on a GPU too, and by rays; error against the truth
#[derive(Debug, Args)]
pub(super) struct RenderBenchArgs {
    /// Map this recording, and draw the views of its folder `novel`, instead of the synthetic room
    #[arg(long, value_name = "DIR")]
    data: Option<PathBuf>,
    /// Profile of the map
    #[arg(long, default_value = "lite")]
    profile: Profile,
    /// Edge length of its voxels of level 0, m
    #[arg(long, value_name = "M", default_value_t = 0.1)]
    r0: f32,
    /// Frames of the synthetic room that is mapped
    #[arg(long, value_name = "N", default_value_t = 150)]
    frames: usize,
    /// Width of its images, pixels
    #[arg(long, value_name = "PIXELS", default_value_t = 640, value_parser = clap::value_parser!(u32).range(8..=4096))]
    width: u32,
    /// Views that are drawn, from between the frames
    #[arg(long, value_name = "N", default_value_t = 6, value_parser = clap::value_parser!(u32).range(1..=1000))]
    views: u32,
    /// Sizes of the images, separated by commas
    #[arg(long, value_name = "WxH,WxH", value_delimiter = ',', default_value = "640x480,1200x680")]
    size: Vec<Size>,
    /// Threads that draw
    #[arg(long, value_name = "N", default_value_t = 2)]
    threads: usize,
    /// Whether a GPU draws too: auto, where there is a hardware one; gpu, also one in software; cpu,
    /// none
    #[arg(long, value_enum, default_value = "auto")]
    backend: BackendChoice,
    /// How often each view is drawn, in turn
    #[arg(long, value_name = "N", default_value_t = 3, value_parser = clap::value_parser!(u32).range(1..=1000))]
    rounds: u32,
    /// Write the images of the first size to this folder, the truth beside them
    #[arg(long, value_name = "DIR")]
    pictures: Option<PathBuf>,
}

const RENDERERS: [Renderer; 2] = [Renderer::Tile, Renderer::Ray];
/// The size that the targets are about.
const JUDGED: Size = Size { width: 640, height: 480 };
const TIME: Target = Target::at_most(150.0);
const ALIKE: Target = Target::at_least(35.0);
const DEPTH: Target = Target::at_most(0.006).aiming_at(0.0035);
/// What is timed.
const TIMED: [Channels; 2] =
    [Channels { color: true, depth: true, ..Channels::NONE }, Channels::ALL];

/// A view of the room as it is.
struct Truth {
    camera: Camera,
    depth: DepthImage,
    color: ColorImage,
}

/// What one renderer did at one size.
struct Case {
    renderer: Renderer,
    images: Vec<Rendering>,
    /// One a round and view, for each of [`TIMED`].
    took: [Vec<Elapsed>; 2],
}

impl RenderBenchArgs {
    pub(super) fn run(&self, out: &mut Printer) -> anyhow::Result<()> {
        let (recording, sets) = match &self.data {
            Some(folder) => (self.recording(folder)?, vec![novel(folder, self.views)?]),
            None => {
                let data = Box::new(Synthetic::room(self.frames).with_width(self.width));
                let indices = (0..data.len()).collect();
                let sets = self.size.iter().map(|size| self.truths(*size)).collect();
                (Recording { data, indices }, sets)
            }
        };
        let [view, next] = self.views(&recording)?;
        let pool = query_pool(self.threads)?;
        let mut gpu = OnGpu::open(self.backend, &view)?;
        for (i, truths) in sets.iter().enumerate() {
            let Some(first) = truths.first() else { continue };
            let cases = self.measure(&view, truths, &pool);
            let k = &first.camera.intrinsics;
            let judged = Size { width: k.width, height: k.height } == JUDGED;
            let name = format!("{}x{}, {} threads", k.width, k.height, self.threads);
            let mut sets: Vec<(String, &[Rendering])> =
                cases.iter().map(|case| (name_of(case.renderer), &case.images[..])).collect();
            for case in &cases {
                out.figures(case.figures(&name, truths, judged))?;
            }
            let [tile, ray] = &cases;
            let on_gpu = match &mut gpu {
                Some(gpu) => {
                    let drawn = (&truths[..], &tile.images[..]);
                    let (images, figures) = gpu.figures(&name, self, &view, drawn, &pool)?;
                    out.figures(figures)?;
                    images
                }
                None => Vec::new(),
            };
            if !on_gpu.is_empty() {
                sets.push(("gpu".into(), &on_gpu));
            }
            if let Some(folder) = self.pictures.as_ref().filter(|_| i == 0) {
                paint(folder, truths, &sets)?;
            }
            let alike =
                |(tile, ray): (&Rendering, &Rendering)| psnr(&tile.color, |i| Some(ray.color[i]));
            let alike: Vec<f64> = tile.images.iter().zip(&ray.images).map(alike).collect();
            let name = format!("{name}, {}", name_of(Renderer::Tile));
            let figure = Figure::new(&name, "psnr_against_ray", mean(&alike), Unit::Decibels);
            out.figures([figure.against(judged.then_some(ALIKE))])?;
        }
        match &mut gpu {
            Some(gpu) => Ok(out.figures(gpu.uploads(&next)?)?),
            None => Ok(()),
        }
    }

    /// Draws all views with both renderers, in turn.
    fn measure(&self, view: &MapView, truths: &[Truth], pool: &ThreadPool) -> [Case; 2] {
        let mut cases = RENDERERS.map(|renderer| Case {
            renderer,
            images: truths.iter().map(|t| draw(view, t, renderer, Channels::ALL, pool)).collect(),
            took: [Vec::new(), Vec::new()],
        });
        for truth in (0..self.rounds).flat_map(|_| truths) {
            for case in &mut cases {
                for (channels, took) in TIMED.iter().zip(&mut case.took) {
                    let clock = Clock::start();
                    std::hint::black_box(draw(view, truth, case.renderer, *channels, pool));
                    took.push(clock.elapsed());
                }
            }
        }
        cases
    }

    fn recording(&self, folder: &Path) -> anyhow::Result<Recording> {
        let data = dataset::open(folder, Format::Auto)?;
        let indices = (0..data.len()).collect();
        Ok(Recording { data, indices })
    }

    /// The map of a recording, and the same after one more frame.
    fn views(&self, recording: &Recording) -> anyhow::Result<[Arc<MapView>; 2]> {
        let (profile, r0_m) = (self.profile, self.r0);
        let settings = MapSettings { profile, r0_m, ..MapSettings::default() };
        let (mut mapper, _) = recording.map(&settings, None)?;
        let view = mapper.publish_all()?;
        let last = recording.indices.last().context("no frames")?;
        mapper.integrate(&recording.data.load(*last, true)?)?;
        Ok([view, mapper.publish_all()?])
    }

    /// Views from halfway between two frames.
    fn truths(&self, size: Size) -> Vec<Truth> {
        let walk = Synthetic::room(2 * self.frames).with_width(size.width).with_height(size.height);
        let renderer = synthetic::Renderer::default();
        let views = self.views as usize;
        let truth = |view: usize| {
            let frame = 2 * (view * self.frames / views) + 1;
            let (intrinsics, pose) = (walk.intrinsics(), walk.pose(frame));
            let scene = walk.scene(frame);
            let (depth, color) =
                renderer.depth_and_color(scene, &intrinsics, &pose, walk.range_m());
            Truth { camera: Camera { world_from_camera: pose, intrinsics }, depth, color }
        };
        (0..views).map(truth).collect()
    }
}

/// Views that the recording was not made from, with what was seen there.
fn novel(folder: &Path, views: u32) -> anyhow::Result<Vec<Truth>> {
    let data = dataset::open(&folder.join("novel"), Format::Auto)?;
    let step = data.len().div_ceil(views as usize).max(1);
    let truth = |index| -> anyhow::Result<Truth> {
        let frame = data.load(index, true)?;
        let camera =
            Camera { world_from_camera: frame.world_from_camera, intrinsics: frame.intrinsics };
        camera.check()?;
        let color = frame.color.context("novel views without colour")?;
        Ok(Truth { camera, depth: frame.depth, color })
    };
    (0..data.len()).step_by(step).map(truth).collect()
}

fn draw(
    view: &MapView,
    truth: &Truth,
    renderer: Renderer,
    channels: Channels,
    pool: &ThreadPool,
) -> Rendering {
    let settings = RenderSettings { renderer, ..RenderSettings::default() };
    render(view, &truth.camera, channels, &settings, pool, &|| false).unwrap_or_default()
}

impl Case {
    fn figures(&self, name: &str, truths: &[Truth], judged: bool) -> Vec<Figure> {
        let case = format!("{name}, {}", name_of(self.renderer));
        let figure = |measure, value, unit| Figure::new(&case, measure, value, unit);
        let time = |channels: usize, of: fn(&Elapsed) -> f64| {
            let times: Vec<f64> = self.took[channels].iter().map(|took| of(took) * 1e3).collect();
            median(&times)
        };
        let (mut depth, mut color, mut covered) = (Vec::new(), Vec::new(), Vec::new());
        for (image, truth) in self.images.iter().zip(truths) {
            let hit = |i: &usize| image.depth_m[*i] > 0.0 && truth.depth.metres[*i] > 0.0;
            let hits: Vec<usize> = (0..image.depth_m.len()).filter(hit).collect();
            let error = |i: &usize| f64::from((image.depth_m[*i] - truth.depth.metres[*i]).abs());
            depth.push(mean(&hits.iter().map(error).collect::<Vec<_>>()));
            covered.push(hits.len() as f64 / image.depth_m.len() as f64);
            color.push(psnr(&image.color, |i| {
                (image.depth_m[i] > 0.0).then(|| true_color(truth, i))
            }));
        }
        let is_tile = judged && self.renderer == Renderer::Tile;
        vec![
            figure("image_time", time(0, |t| t.wall_s), Unit::Milliseconds)
                .against(is_tile.then_some(TIME)),
            figure("image_processor_time", time(0, |t| t.processor_s), Unit::Milliseconds),
            figure("all_channels_processor_time", time(1, |t| t.processor_s), Unit::Milliseconds),
            figure("depth_l1", mean(&depth), Unit::Metres).against(judged.then_some(DEPTH)),
            figure("psnr_of_covered", mean(&color), Unit::Decibels),
            figure("covered", mean(&covered), Unit::Share),
        ]
    }
}

fn true_color(truth: &Truth, pixel: usize) -> Vec3 {
    let rgb = &truth.color.rgb[3 * pixel..3 * pixel + 3];
    Vec3::new(f32::from(rgb[0]), f32::from(rgb[1]), f32::from(rgb[2])) / 255.0
}

/// Peak signal-to-noise ratio over the pixels that `other` has, of colours within 0..=1.
fn psnr(image: &[Vec3], other: impl Fn(usize) -> Option<Vec3>) -> f64 {
    let errors: Vec<f64> = (0..image.len())
        .filter_map(|i| other(i).map(|other| f64::from((image[i] - other).length_squared()) / 3.0))
        .collect();
    -10.0 * mean(&errors).log10()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// Writes the truth and each renderer's colour, depth, normals and mask, a file each.
fn paint(folder: &Path, truths: &[Truth], sets: &[(String, &[Rendering])]) -> anyhow::Result<()> {
    std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    let save = |name: String, size: (u32, u32), pixel: &dyn Fn(usize) -> Vec3| {
        let byte = |x: f32| (x.clamp(0.0, 1.0) * 255.0).round() as u8;
        let image = RgbImage::from_fn(size.0, size.1, |u, v| {
            image::Rgb(pixel((v * size.0 + u) as usize).to_array().map(byte))
        });
        let path = folder.join(name);
        image.save(&path).with_context(|| path.display().to_string())
    };
    for (i, truth) in truths.iter().enumerate() {
        let size = (truth.color.width, truth.color.height);
        save(format!("{i}-true-color.png"), size, &|p| true_color(truth, p))?;
        for (name, images) in sets {
            let image = &images[i];
            save(format!("{i}-{name}-color.png"), size, &|p| image.color[p])?;
            save(format!("{i}-{name}-normal.png"), size, &|p| image.normal[p] * 0.5 + 0.5)?;
            // Error of the depth, white at 2 cm; blue where the map knows nothing.
            save(format!("{i}-{name}-depth-error.png"), size, &|p| {
                let unknown = f32::from(image.unknown[p]);
                let error = (image.depth_m[p] - truth.depth.metres[p]).abs() / 0.02;
                Vec3::new(error, error, error.max(unknown))
            })?;
        }
    }
    Ok(())
}
