//! `orenx ablate`: what each part of the method is worth on one recording, as one report.
//!
//! It varies what the paper's ablation tables vary, as far as there is a setting for it: which
//! modalities train together, noise of depth, whether colours depend on the direction, where a ray takes
//! its colour, what draws the images and the colours that training compares; and where distances start,
//! which the paper has no choice of.

mod chart;
mod page;
mod tables;

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};

use self::page::Page;
use self::tables::Study;
use super::bench::recording::RecordingArgs;
use super::map::processor;
use crate::config::{Profile, name_of};
use crate::dataset::Noise;
use crate::error::{Error, Result};
use crate::eval::{Lpips, Truth};
use crate::storage::write_file;

/// What is varied.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Topic {
    /// Which fields a map holds
    Modalities,
    /// Noise of depth, by the start of distances and by modalities
    Noise,
    /// Whether colours depend on where they are seen from
    Color,
    /// Where a ray takes its colour
    Sample,
    /// What draws the colours that training compares, and the images
    Renderer,
}

/// Measure what each part of the method is worth and write a report with plots (office)
#[derive(Debug, Args)]
pub struct AblateArgs {
    #[command(flatten)]
    recording: RecordingArgs,
    /// Only these, separated by commas
    #[arg(long, value_enum, value_delimiter = ',', value_name = "A,B")]
    topics: Vec<Topic>,
    #[arg(long, value_enum, default_value = "lite")]
    profile: Profile,
    /// Training steps a frame of trained maps; the profile decides by default
    #[arg(long, value_name = "N")]
    steps: Option<u32>,
    /// Rays of a step whose colours are compared, where a map compares any; 0: distances learn
    /// nothing from colours
    #[arg(long, value_name = "N", default_value_t = 2048)]
    color_rays: u32,
    /// Only this noise, beside clean depth; may be repeated
    #[arg(long, value_name = "MODEL:S")]
    noise: Vec<Noise>,
    /// A network for LPIPS, as for orenx eval
    #[arg(long, value_name = "FILE.onnx")]
    lpips: Option<PathBuf>,
    /// A folder for report.md, report.html and the plots
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

impl AblateArgs {
    pub fn run(self) -> anyhow::Result<()> {
        let folder = self.recording.folder("office")?;
        let recording = self.recording.open(&folder)?;
        // Meshes are not compared, and take longer than the rest.
        let truth = Truth { surface: None, ..Truth::load(&folder)? };
        if truth.sdf.is_none() && truth.novel.is_none() {
            let problem = format!("{} has neither gt_sdf.npz nor novel/", folder.display());
            return Err(Error::invalid("data", problem).into());
        }
        std::fs::create_dir_all(&self.out).map_err(|e| Error::io(&self.out, e))?;
        let mut page = Page::new(self.about(recording.data.name(), recording.indices.len()));
        let lpips = self.lpips.as_deref().map(Lpips::load).transpose()?;
        let budget = (self.steps, self.color_rays);
        let mut study = Study::new(&recording, &truth, self.profile, budget, lpips)?;
        for topic in Topic::value_variants() {
            if !self.topics.is_empty() && !self.topics.contains(topic) {
                continue;
            }
            println!("{}:", name_of(*topic));
            let table = match topic {
                Topic::Modalities => study.modalities(),
                Topic::Noise => study.noise(&self.noise),
                Topic::Color => study.color(),
                Topic::Sample => study.sample(),
                Topic::Renderer => study.renderer(),
            }?;
            if let Some(table) = table {
                page.push(table);
            }
        }
        self.write(&page)?;
        println!("{}", self.out.join("report.md").display());
        Ok(())
    }

    fn about(&self, recording: &str, frames: usize) -> String {
        let steps = match self.steps {
            Some(steps) => format!("{steps} steps a frame where a map trains"),
            None => "the profile's steps where a map trains".to_owned(),
        };
        let (profile, rays) = (name_of(self.profile), self.color_rays);
        format!(
            "{recording}, {frames} frames, {profile}, {steps}, {rays} rays a step where colours are \
             compared; {}.",
            processor()
        )
    }

    fn write(&self, page: &Page) -> Result<()> {
        let put = |name: &str, text: &str| {
            let path: &Path = &self.out.join(name);
            write_file(path, |file| file.write_all(text.as_bytes()))
        };
        for (name, chart) in page.charts() {
            put(&name, &chart)?;
        }
        put("report.md", &page.markdown())?;
        put("report.html", &page.html())
    }
}
