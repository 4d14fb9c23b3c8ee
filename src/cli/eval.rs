//! `orenx eval`: a map judged against a truth folder.

use std::io::Write;
use std::path::PathBuf;

use clap::Args;

use super::open::open_view;
use crate::error::Result;
use crate::eval::{Report, Truth, evaluate};
use crate::map::{MapView, default_resolution_m, extract_mesh, query_pool};
use crate::storage::write_file;

/// Judge a map against a folder with known truth and print the geometry table
#[derive(Debug, Args)]
pub struct EvalArgs {
    /// Map file
    pub map: PathBuf,
    /// Folder with gt_sdf.npz, or gt_surface.npz and mesh.ply
    #[arg(long, value_name = "DIR")]
    pub truth: PathBuf,
    /// Also write the report as JSON
    #[arg(long, value_name = "FILE.json")]
    pub report: Option<PathBuf>,
}

impl EvalArgs {
    pub fn run(self) -> anyhow::Result<()> {
        let view = open_view(&self.map)?;
        let report = judge(&view, &Truth::load(&self.truth)?)?;
        write!(std::io::stdout(), "{report}")?;
        if let Some(path) = &self.report {
            write_file(path, |out| Ok(serde_json::to_writer_pretty(out, &report)?))?;
        }
        Ok(())
    }
}

/// Judges a view, and the mesh that it gives at the default resolution.
pub fn judge(view: &MapView, truth: &Truth) -> Result<Report> {
    let pool = query_pool(0)?;
    let query = |points: &[_], fields| view.query(points, fields);
    let resolution_m = default_resolution_m(view.config().r0_m);
    let mesh = || extract_mesh(&query, &view.surface_leaves(), resolution_m, &pool);
    evaluate(truth, &query, mesh, &pool)
}
