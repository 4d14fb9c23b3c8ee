//! `orenx mesh`: the surface as a triangle mesh.

use std::io::Write;
use std::path::PathBuf;

use clap::Args;

use super::open::open_view;
use crate::error::Error;
use crate::map::{default_resolution_m, extract_mesh, query_pool};
use crate::storage::write_file;

/// Write the surface of a map as a triangle mesh (PLY, metres)
#[derive(Debug, Args)]
pub struct MeshArgs {
    /// Map file
    pub map: PathBuf,
    #[arg(long, value_name = "FILE.ply")]
    pub out: PathBuf,
    /// Distance between vertices, m; by default a fifth of the map's r0, 0.01 to 0.05
    #[arg(long, value_name = "M")]
    pub resolution: Option<f32>,
}

impl MeshArgs {
    pub fn run(self) -> anyhow::Result<()> {
        let view = open_view(&self.map)?;
        let pool = query_pool(0)?;
        let resolution_m =
            self.resolution.unwrap_or_else(|| default_resolution_m(view.config().r0_m));
        let query = |points: &[_], fields| view.query(points, fields);
        let mesh = extract_mesh(&query, &view.surface_leaves(), resolution_m, &pool)?;
        if mesh.triangles.is_empty() {
            let map = self.map.display();
            return Err(Error::FailedPrecondition(format!("{map} holds no surface")).into());
        }
        write_file(&self.out, |out| mesh.write_ply(out))?;
        let (vertices, triangles) = (mesh.vertices.len(), mesh.triangles.len());
        let out = self.out.display();
        writeln!(std::io::stdout(), "{out}: {vertices} vertices, {triangles} triangles")?;
        Ok(())
    }
}
