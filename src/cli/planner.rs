//! `orenx planner`: what planners ask, of a map file or a server; arrays in, an archive out.

mod arrays;

use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::{Args, Subcommand};
use tokio::runtime::Runtime;

use self::arrays::{PathColumns, rows, shape_of, write};
use super::credentials::CredentialArgs;
use super::numbers::parse_box;
use super::open::{MapName, asking_runtime, is_url, open_view};
use crate::client::Client;
use crate::error::{Error, Result};
use crate::geometry::Aabb;
use crate::map::{Fields, MapView, Waypoint, query_pool};
use crate::service::{
    Grid, GridQuestion, Local, NearestQuestion, NumberFormat, RaysQuestion, SpheresQuestion, Terms,
    TrajectoriesQuestion, points_of, spheres_of, vectors_of, waypoints_of,
};

/// Ask what planners ask: spheres, trajectories, rays, nearest surfaces, grids
#[derive(Debug, Args)]
pub struct PlannerArgs {
    #[command(subcommand)]
    verb: Verb,
}

#[derive(Debug, Subcommand)]
enum Verb {
    Spheres(SpheresArgs),
    Trajectories(TrajectoriesArgs),
    Rays(RaysArgs),
    Nearest(NearestArgs),
    Grid(GridArgs),
}

/// Who is asked, and where the answers go.
#[derive(Debug, Args)]
struct Asked {
    /// Map file, or the URL of a server's gRPC, as in grpc://127.0.0.1:7610
    map: String,
    /// Where the answers go
    #[arg(long, value_name = "FILE.npz")]
    out: PathBuf,
    #[command(flatten)]
    name: MapName,
    #[command(flatten)]
    credentials: CredentialArgs,
}

impl Asked {
    /// Which map is asked, and under which terms.
    fn terms(&self) -> Result<Terms> {
        Ok(Terms { map_id: self.name.of(&self.map)?, ..Terms::default() })
    }
}

/// Clearance of spheres: arrays clearance, gradient, state
#[derive(Debug, Args)]
struct SpheresArgs {
    #[command(flatten)]
    common: Asked,
    /// An .npy file of spheres, (N, 4): x y z r, world metres
    #[arg(long, value_name = "FILE.npy")]
    spheres: PathBuf,
}

/// Whether a robot gets along trajectories: arrays min_clearance, min_pose, min_fraction, min_sphere,
/// hit_pose, hit_fraction, hit_sphere, unknown_hits
#[derive(Debug, Args)]
struct TrajectoriesArgs {
    #[command(flatten)]
    common: Asked,
    /// An .npy file of poses, (trajectories, poses, 7) or (poses, 7): x y z and the quaternion x y z w
    #[arg(long, value_name = "FILE.npy")]
    poses: PathBuf,
    /// An .npy file of the robot's spheres, (N, 4): x y z r, in its own frame
    #[arg(long, value_name = "FILE.npy")]
    spheres: PathBuf,
    /// Look between poses too
    #[arg(long)]
    swept: bool,
    /// A clearance below this is a hit, m
    #[arg(long, value_name = "M", default_value_t = 0.0, allow_hyphen_values = true)]
    margin: f32,
}

/// What rays meet: arrays distance, normal, unknown_at, state
#[derive(Debug, Args)]
struct RaysArgs {
    #[command(flatten)]
    common: Asked,
    /// An .npy file of rays, (N, 6): origin and direction
    #[arg(long, value_name = "FILE.npy")]
    rays: PathBuf,
    /// Where rays end, m
    #[arg(long, value_name = "M", default_value_t = 10.0)]
    range: f32,
}

/// Nearest surfaces: arrays surface, distance, state and, with --unknown, unknown_distance
#[derive(Debug, Args)]
struct NearestArgs {
    #[command(flatten)]
    common: Asked,
    /// An .npy file of points, (N, 3), world metres
    #[arg(long, value_name = "FILE.npy")]
    points: PathBuf,
    /// How far to look for what nobody has seen, m, at most 2
    #[arg(long, value_name = "M", default_value_t = 0.0)]
    unknown: f32,
}

/// Voxels of a box: arrays distance, gradient, occupancy, state, color, z first and x last, with
/// origin and voxel
#[derive(Debug, Args)]
struct GridArgs {
    #[command(flatten)]
    common: Asked,
    /// Corners of the box, world metres; left out: all that was observed
    #[arg(long, value_name = "X,Y,Z,X,Y,Z", allow_hyphen_values = true, value_parser = parse_box)]
    r#box: Option<Aabb>,
    /// Edge of a voxel, m
    #[arg(long, value_name = "M", default_value_t = 0.05)]
    voxel: f32,
}

impl PlannerArgs {
    pub fn run(self) -> anyhow::Result<()> {
        match self.verb {
            Verb::Spheres(arguments) => arguments.run(),
            Verb::Trajectories(arguments) => arguments.run(),
            Verb::Rays(arguments) => arguments.run(),
            Verb::Nearest(arguments) => arguments.run(),
            Verb::Grid(arguments) => arguments.run(),
        }?;
        Ok(())
    }
}

/// Who answers.
enum Source {
    View(Local),
    Server(Client, Runtime),
}

impl Source {
    fn open(Asked { map, credentials, .. }: &Asked) -> Result<Self> {
        if !is_url(map) {
            return Self::of(open_view(Path::new(map))?);
        }
        if map.starts_with("zenoh+") {
            let problem = "planners' questions are asked over gRPC, as in grpc://127.0.0.1:7610";
            return Err(Error::invalid("map", problem));
        }
        let runtime = asking_runtime()?;
        let client = runtime.block_on(Client::connect_with(map, &credentials.read()?))?;
        Ok(Self::Server(client, runtime))
    }

    fn of(view: Arc<MapView>) -> Result<Self> {
        Ok(Self::View(Local::new(view, Arc::new(query_pool(0)?))))
    }

    fn bounds(&self, map_id: &str) -> Result<Aabb> {
        match self {
            Self::View(local) => Ok(local.view().bounds()),
            Self::Server(client, runtime) => runtime.block_on(client.bounds(map_id)),
        }
    }
}

impl SpheresArgs {
    fn run(self) -> Result<()> {
        let question = SpheresQuestion {
            terms: self.common.terms()?,
            spheres: spheres_of(&rows(&self.spheres, 4)?)?,
            fields: Fields { gradient: true, state: true, ..Fields::DISTANCE },
        };
        let answers = match Source::open(&self.common)? {
            Source::View(local) => local.query_spheres(question)?,
            Source::Server(client, runtime) => {
                runtime.block_on(client.query_spheres(&question))?.answer
            }
        };
        let n = answers.state.len();
        write(&self.common.out, |archive| {
            archive.add("clearance", &[n], &answers.distance)?;
            archive.add("gradient", &[n, 3], bytemuck::cast_slice::<_, f32>(&answers.gradient))?;
            archive.add("state", &[n], &answers.state)
        })
    }
}

impl TrajectoriesArgs {
    fn run(self) -> Result<()> {
        let (trajectories, poses) = match shape_of(&self.poses)?[..] {
            [trajectories, poses, 7] => (trajectories, poses),
            [poses, 7] => (1, poses),
            ref other => {
                let problem = format!("has shape {other:?}, but (N, P, 7) or (P, 7) is needed");
                return Err(Error::invalid("poses", problem));
            }
        };
        let numbers: Vec<Waypoint> = waypoints_of(&rows(&self.poses, 7)?)?;
        let length = u32::try_from(poses).map_err(|_| Error::invalid("poses", "are too many"))?;
        let question = TrajectoriesQuestion {
            body: spheres_of(&rows(&self.spheres, 4)?)?,
            poses: numbers,
            lengths: vec![length; trajectories],
            margin_m: self.margin,
            swept: self.swept,
            terms: self.common.terms()?,
        };
        let verdicts = match Source::open(&self.common)? {
            Source::View(local) => local.check_trajectories(question)?,
            Source::Server(client, runtime) => {
                runtime.block_on(client.check_trajectories(&question))?.answer
            }
        };
        let columns = PathColumns::of(&verdicts);
        println!("{} of {} trajectories meet nothing", columns.safe, verdicts.len());
        write(&self.common.out, |archive| columns.write(archive))
    }
}

impl RaysArgs {
    fn run(self) -> Result<()> {
        let numbers = rows(&self.rays, 6)?;
        let half = |from: usize| -> Vec<f32> {
            numbers.chunks_exact(6).flat_map(|ray| ray[from..from + 3].to_vec()).collect()
        };
        let question = RaysQuestion {
            terms: self.common.terms()?,
            origins: vectors_of("origins_m", &half(0))?,
            directions: vectors_of("directions", &half(3))?,
            max_range_m: self.range,
        };
        let answers = match Source::open(&self.common)? {
            Source::View(local) => local.cast_rays(&question)?,
            Source::Server(client, runtime) => {
                runtime.block_on(client.cast_rays(&question))?.answer
            }
        };
        let n = answers.state.len();
        write(&self.common.out, |archive| {
            archive.add("distance", &[n], &answers.distance_m)?;
            archive.add("normal", &[n, 3], bytemuck::cast_slice::<_, f32>(&answers.normal))?;
            archive.add("unknown_at", &[n], &answers.unknown_at_m)?;
            archive.add("state", &[n], &answers.state)
        })
    }
}

impl NearestArgs {
    fn run(self) -> Result<()> {
        let question = NearestQuestion {
            terms: self.common.terms()?,
            points: points_of(&rows(&self.points, 3)?)?,
            max_unknown_m: self.unknown,
        };
        let answers = match Source::open(&self.common)? {
            Source::View(local) => local.find_nearest(question)?,
            Source::Server(client, runtime) => {
                runtime.block_on(client.find_nearest(&question))?.answer
            }
        };
        let n = answers.state.len();
        write(&self.common.out, |archive| {
            archive.add("surface", &[n, 3], bytemuck::cast_slice::<_, f32>(&answers.surface))?;
            archive.add("distance", &[n], &answers.distance_m)?;
            archive.add("state", &[n], &answers.state)?;
            if !answers.unknown_distance_m.is_empty() {
                archive.add("unknown_distance", &[n], &answers.unknown_distance_m)?;
            }
            Ok(())
        })
    }
}

impl GridArgs {
    fn run(self) -> Result<()> {
        let (source, terms) = (Source::open(&self.common)?, self.common.terms()?);
        let region = match self.r#box {
            Some(region) => region,
            None => source.bounds(&terms.map_id)?,
        };
        let question = GridQuestion {
            terms,
            region,
            voxel_m: self.voxel,
            fields: Fields::ALL,
            format: NumberFormat::F32,
        };
        let Grid { shape, columns, .. } = match source {
            Source::View(local) => local.get_grid(&question)?,
            Source::Server(client, runtime) => runtime.block_on(client.get_grid(&question))?.answer,
        };
        let [x, y, z] = shape.size.to_array().map(|n| n as usize);
        println!("{x} x {y} x {z} voxels");
        write(&self.common.out, |archive| {
            let numbers = |bytes: &[u8]| bytemuck::pod_collect_to_vec::<u8, f32>(bytes);
            for (name, width, bytes) in [
                ("distance", 1, &columns.distance),
                ("gradient", 3, &columns.gradient),
                ("occupancy", 1, &columns.occupancy),
                ("color", 3, &columns.color),
            ] {
                let shape = [z, y, x, width];
                if !bytes.is_empty() {
                    let shape = if width == 1 { &shape[..3] } else { &shape[..] };
                    archive.add(name, shape, &numbers(bytes))?;
                }
            }
            archive.add("state", &[z, y, x], &columns.state)?;
            archive.add("origin", &[3], &shape.origin.to_array())?;
            archive.add("voxel", &[1], &[shape.voxel_m])
        })
    }
}
