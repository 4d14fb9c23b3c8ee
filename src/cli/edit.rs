//! `orenx edit`: a server's map changed by hand, from the command line.

use std::fs::File;
use std::path::PathBuf;

use clap::{ArgGroup, Args, Subcommand};
use glam::{DVec3, Vec3};
use tokio::runtime::Runtime;

use super::credentials::CredentialArgs;
use super::numbers::{numbers, parse_box};
use super::open::asking_runtime;
use crate::client::Client;
use crate::error::{Error, Result};
use crate::geometry::{Aabb, Mesh, Pose, Region, Solid};
use crate::map::{Clear, Edited, STAMP_ROBOT, Stamp, TriangleMesh};
use crate::service::DEFAULT_MAP;
use crate::surface::Stamping;

/// Change a server's map by hand: forget what was seen, put known geometry in
#[derive(Debug, Args)]
pub struct EditArgs {
    /// The server, over gRPC, as in http://127.0.0.1:7610
    pub url: String,
    #[command(subcommand)]
    verb: Verb,
    /// The map
    #[arg(long, global = true, default_value = DEFAULT_MAP)]
    pub map: String,
}

#[derive(Debug, Subcommand)]
enum Verb {
    Clear(ClearArgs),
    Stamp(StampArgs),
}

/// Forget what all of the conditions that are given say
#[derive(Debug, Args)]
#[command(group(ArgGroup::new("what").required(true).multiple(true)
    .args(["box", "sphere", "robot", "older_than"])))]
struct ClearArgs {
    /// Within a box, by two opposite corners, world metres
    #[arg(long, value_name = "X,Y,Z,X,Y,Z", allow_hyphen_values = true, value_parser = parse_box,
        conflicts_with = "sphere")]
    r#box: Option<Aabb>,
    /// Within a ball: its middle and radius, world metres
    #[arg(long, value_name = "X,Y,Z,R", allow_hyphen_values = true, value_parser = parse_ball)]
    sphere: Option<Ball>,
    /// What only this robot saw
    #[arg(long, value_name = "NAME")]
    robot: Option<String>,
    /// What was last seen so many seconds before the map's newest frame, or earlier
    #[arg(long, value_name = "S", value_parser = parse_seconds)]
    older_than: Option<f64>,
    #[command(flatten)]
    credentials: CredentialArgs,
}

/// Put known geometry in: its surface is there, and what is inside is occupied
#[derive(Debug, Args)]
#[command(group(ArgGroup::new("geometry").required(true).args(["box", "sphere", "mesh"])))]
struct StampArgs {
    /// An upright box, by two opposite corners, world metres
    #[arg(long, value_name = "X,Y,Z,X,Y,Z", allow_hyphen_values = true, value_parser = parse_box)]
    r#box: Option<Aabb>,
    /// A ball: its middle and radius, world metres
    #[arg(long, value_name = "X,Y,Z,R", allow_hyphen_values = true, value_parser = parse_ball)]
    sphere: Option<Ball>,
    /// A PLY file of triangles, world metres, counterclockwise as seen from outside
    #[arg(long, value_name = "FILE.ply")]
    mesh: Option<PathBuf>,
    /// What is inside is free, and there is no surface
    #[arg(long)]
    free: bool,
    /// The surface's color, sRGB, each within 0..1
    #[arg(long, value_name = "R,G,B", value_parser = parse_color, conflicts_with = "free")]
    color: Option<Vec3>,
    /// Under whose name it is in the map, to be cleared by
    #[arg(long, value_name = "NAME", default_value = STAMP_ROBOT)]
    robot: String,
    #[command(flatten)]
    credentials: CredentialArgs,
}

#[derive(Debug, Clone, Copy)]
struct Ball {
    center: Vec3,
    radius_m: f32,
}

impl EditArgs {
    pub fn run(self) -> anyhow::Result<()> {
        let runtime = asking_runtime()?;
        let (url, map) = (self.url.as_str(), self.map.as_str());
        let connect = |credentials: &CredentialArgs| {
            let credentials = credentials.read()?;
            runtime.block_on(Client::connect_with(url, &credentials))
        };
        let edited = match self.verb {
            Verb::Clear(arguments) => {
                let client = connect(&arguments.credentials)?;
                let clear = arguments.clear(&client, &runtime, map)?;
                runtime.block_on(client.clear_region(map, &clear))?
            }
            Verb::Stamp(arguments) => {
                let stamp = arguments.stamp()?;
                let client = connect(&arguments.credentials)?;
                runtime.block_on(client.stamp_geometry(map, &stamp))?
            }
        };
        println!("{}", describe(map, &edited));
        Ok(())
    }
}

impl ClearArgs {
    fn clear(&self, client: &Client, runtime: &Runtime, map: &str) -> Result<Clear> {
        // Told by the clock of the frames: ours may be another one.
        let older_than_ns = match self.older_than {
            Some(seconds) => {
                let newest = runtime.block_on(client.map_stats(map))?.summary.newest_stamp_ns;
                Some(newest.saturating_sub((seconds * 1e9) as i64))
            }
            None => None,
        };
        let ball = |Ball { center, radius_m }| Region::Sphere { center, radius_m };
        let region = self.r#box.map(Region::Box).or(self.sphere.map(ball));
        Ok(Clear { region, robot_id: self.robot.clone(), older_than_ns })
    }
}

impl StampArgs {
    fn stamp(&self) -> Result<Stamp> {
        let solid = match (self.r#box, self.sphere, &self.mesh) {
            (Some(Aabb { min, max }), _, _) => {
                let translation: DVec3 = 0.5 * (min.as_dvec3() + max.as_dvec3());
                let world_from_box = Pose { translation, ..Pose::IDENTITY };
                Solid::Box { world_from_box, size_m: max - min }
            }
            (_, Some(Ball { center, radius_m }), _) => Solid::Sphere { center, radius_m },
            (_, _, Some(path)) => {
                let file = File::open(path).map_err(|e| Error::io(path, e))?;
                let name = path.display().to_string();
                let TriangleMesh { vertices, triangles, .. } = TriangleMesh::read_ply(file, &name)?;
                Solid::Mesh(Mesh::new(vertices, triangles)?)
            }
            (None, None, None) => {
                return Err(Error::invalid("geometry", "needs --box, --sphere or --mesh"));
            }
        };
        let stamping = if self.free { Stamping::Free } else { Stamping::Add };
        Ok(Stamp { solid, stamping, color: self.color, robot_id: self.robot.clone() })
    }
}

/// What changed, in one line.
fn describe(map: &str, edited: &Edited) -> String {
    let Edited { epoch, key_frames_dropped, .. } = edited;
    let mut line = format!(
        "map '{map}' from epoch {epoch} on: {} surfels removed, {} added; {} cells forgotten, {} told",
        edited.surfels_removed, edited.surfels_added, edited.cells_forgotten, edited.cells_told
    );
    if *key_frames_dropped > 0 {
        line += &format!("; {key_frames_dropped} key frames dropped");
    }
    line
}

fn parse_ball(text: &str) -> std::result::Result<Ball, String> {
    let [x, y, z, radius_m] = numbers(text, "x,y,z,r")?;
    Ok(Ball { center: Vec3::new(x, y, z), radius_m })
}

fn parse_color(text: &str) -> std::result::Result<Vec3, String> {
    numbers(text, "r,g,b").map(Vec3::from_array)
}

fn parse_seconds(text: &str) -> std::result::Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if (0.0..=1e9).contains(&seconds) => Ok(seconds),
        _ => Err("must be a number within 0..=1e9".into()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_tells_what_changed() {
        let edited = Edited {
            epoch: 7,
            surfels_removed: 1,
            surfels_added: 2,
            cells_forgotten: 3,
            cells_told: 4,
            key_frames_dropped: 0,
        };
        let line = "map 'm' from epoch 7 on: 1 surfels removed, 2 added; 3 cells forgotten, 4 told";
        assert_eq!(describe("m", &edited), line);
        let dropped = Edited { key_frames_dropped: 5, ..edited };
        assert_eq!(describe("m", &dropped), format!("{line}; 5 key frames dropped"));
    }
}
