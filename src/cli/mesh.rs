//! `orenx mesh`: the surface as a triangle mesh.

use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Args;

use super::open::open_view;
use crate::error::Error;
use crate::map::{
    Fields, MeshFormat, default_resolution_m, extract_mesh, query_parallel, query_pool,
    vertex_colors,
};
use crate::storage::write_file;

/// What no camera saw close enough, sRGB.
const UNSEEN: [u8; 3] = [128; 3];

/// Write the surface of a map as a triangle mesh with its colors (PLY or GLB, metres)
#[derive(Debug, Args)]
pub struct MeshArgs {
    /// Map file
    pub map: PathBuf,
    /// A name with .glb makes it glTF (y up), every other a PLY (z up)
    #[arg(long, value_name = "FILE")]
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
        let mesh = extract_mesh(&*view, &view.surface_leaves(), resolution_m, &pool)?;
        if mesh.triangles.is_empty() {
            let map = self.map.display();
            return Err(Error::FailedPrecondition(format!("{map} holds no surface")).into());
        }
        let query = |points: &[_], fields| view.query(points, fields);
        let ask = |points: &[_], fields: Fields| query_parallel(&query, points, fields, &pool);
        let colors = vertex_colors(&ask, &mesh.vertices);
        let colors: Vec<_> = colors.into_iter().map(|color| color.unwrap_or(UNSEEN)).collect();
        write_file(&self.out, |out| mesh.write(format_of(&self.out), &colors, out))?;
        let (vertices, triangles) = (mesh.vertices.len(), mesh.triangles.len());
        let out = self.out.display();
        writeln!(std::io::stdout(), "{out}: {vertices} vertices, {triangles} triangles")?;
        Ok(())
    }
}

fn format_of(path: &Path) -> MeshFormat {
    match path.extension() {
        Some(ending) if ending.eq_ignore_ascii_case("glb") => MeshFormat::Glb,
        _ => MeshFormat::Ply,
    }
}
