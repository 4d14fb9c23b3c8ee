//! `orenx eval`: a map judged against a truth folder.

use std::io::Write;
use std::path::PathBuf;

use clap::Args;

use super::encoder::EncoderArgs;
use super::open::open_view;
use crate::config::Renderer;
use crate::error::Result;
use crate::eval::{Lpips, Report, Truth, evaluate, image_errors, language_scores};
use crate::map::{
    MapView, RenderSettings, SamplePosition, default_resolution_m, extract_mesh, query_pool,
};
use crate::storage::write_file;

/// Judge a map against a folder with known truth and print the geometry table
#[derive(Debug, Args)]
pub struct EvalArgs {
    /// Map file
    pub map: PathBuf,
    /// Folder with gt_sdf.npz, or gt_surface.npz and mesh.ply, or unseen views in novel/, or labels.json
    #[arg(long, value_name = "DIR")]
    pub truth: PathBuf,
    /// What draws the images that are compared with the views in novel/
    #[arg(long, value_enum, default_value = "tile")]
    pub renderer: Renderer,
    /// Where on its way through a voxel a ray takes its colour
    #[arg(long, value_enum, default_value = "zero-crossing")]
    pub sample: SamplePosition,
    /// A network for LPIPS, as ONNX: two images 1x3xHxW within -1..1, one number
    #[arg(long, value_name = "FILE.onnx")]
    pub lpips: Option<PathBuf>,
    #[command(flatten)]
    encoder: EncoderArgs,
    /// Also write the report as JSON
    #[arg(long, value_name = "FILE.json")]
    pub report: Option<PathBuf>,
}

impl EvalArgs {
    pub fn run(self) -> anyhow::Result<()> {
        let view = open_view(&self.map)?;
        let lpips = self.lpips.as_deref().map(Lpips::load).transpose()?;
        let settings = RenderSettings {
            renderer: self.renderer,
            sample: self.sample,
            ..RenderSettings::default()
        };
        let encoder = self.encoder.open()?;
        let truth = Truth::load(&self.truth)?;
        let mut report = judge(&view, &truth)?;
        let pool = query_pool(0)?;
        if let Some(encoder) = &encoder {
            report.language = language_scores(&view, &truth, encoder, &settings, &pool)?;
        } else if view.contract().is_some() && !truth.labelled.is_empty() {
            eprintln!("without --encoder, classes are not judged");
        }
        if let Some(novel) = &truth.novel {
            report.images = image_errors(&view, novel, &settings, lpips.as_ref(), &pool)?;
        }
        write!(std::io::stdout(), "{report}")?;
        if let Some(path) = &self.report {
            write_file(path, |out| Ok(serde_json::to_writer_pretty(out, &report)?))?;
        }
        Ok(())
    }
}

/// Judges the field of a view, and the mesh that it gives at the default resolution.
pub fn judge(view: &MapView, truth: &Truth) -> Result<Report> {
    let pool = query_pool(0)?;
    let query = |points: &[_], fields| view.query(points, fields);
    let resolution_m = default_resolution_m(view.config().r0_m);
    let mesh = || extract_mesh(view, &view.surface_leaves(), resolution_m, &pool);
    evaluate(truth, &query, mesh, &pool)
}
