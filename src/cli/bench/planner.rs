//! `orenx bench planner`: the loads of real planners, while a camera streams.
//!
//! The server is a process of its own, as in `orenx bench serve`, and maps a synthetic room all the time;
//! a mirror of its map answers the same loads in this process, on the same busy cores.

use std::hint::black_box;
use std::sync::Arc;
use std::time::{Duration, Instant};

use clap::Args;
use glam::{Quat, Vec3};
use rayon::ThreadPool;

use super::figure::{Figure, Target, Unit, percentile};
use super::printer::Printer;
use super::serve::load::{Robot, known_points, load};
use super::serve::process::ServerProcess;
use crate::client::{Client, Mirror};
use crate::dataset::Dataset;
use crate::dataset::synthetic::Synthetic;
use crate::error::Result;
use crate::geometry::Aabb;
use crate::geometry::random::{pcg4d, unit};
use crate::map::{
    Fields, GridShape, LevelShape, MapView, PathPart, PathSettings, Pieces, Sphere, Waypoint,
    check_paths, query_parallel, query_pool,
};
use crate::octree::PointGrid;
use crate::service::{
    DEFAULT_MAP, GridQuestion, NumberFormat, SliceQuestion, SpheresQuestion, Terms,
    TrajectoriesQuestion,
};

/// Spheres, trajectories, a slice and a grid while a room is mapped, over gRPC and in a mirror
#[derive(Debug, Args)]
pub(super) struct PlannerBenchArgs {
    /// Questions of each kind
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u32).range(1..=100_000))]
    rounds: u32,
    /// Time between two questions, ms
    #[arg(long, value_name = "MS", default_value_t = 50, value_parser = clap::value_parser!(u64).range(1..=10_000))]
    cycle_ms: u64,
    /// Frames of a walk through the room
    #[arg(long, value_name = "N", default_value_t = 300, value_parser = clap::value_parser!(u32).range(1..=10_000))]
    frames: u32,
    /// Width of the room's images, pixels
    #[arg(long, value_name = "PIXELS", default_value_t = 320, value_parser = clap::value_parser!(u32).range(8..=4096))]
    width: u32,
}

const RATE_HZ: f64 = 30.0;
/// An arm: spheres of a pose, steps of a trajectory, candidates of a question.
const SPHERES: usize = 61;
const STEPS: usize = 64;
const CANDIDATES: usize = 16;
/// A base: trajectories of a cycle, and poses of each.
const TRAJECTORIES: usize = 1000;
const POSES: usize = 56;
/// Cells along the sides of a slice, and voxels along those of a grid.
const CELLS: u32 = 200;
const VOXELS: u32 = 40;
const VOXEL_M: f32 = 0.05;
/// Points of a slice or a grid that a thread takes at a time.
const PIECE: usize = 4096;
const FIELDS: Fields = Fields { gradient: true, state: true, ..Fields::DISTANCE };

/// The questions of the kinds, and what half of their answers must not take longer than, ms.
const KINDS: [(&str, Option<f64>, Option<f64>); 4] = [
    ("62 k spheres with gradients", Some(60.0), Some(25.0)),
    ("1000 trajectories of 56 poses", None, None),
    ("slice of 200 x 200", Some(5.0), Some(5.0)),
    ("grid of 64 k voxels", Some(50.0), Some(50.0)),
];

/// What is asked.
struct Loads {
    spheres: SpheresQuestion,
    trajectories: TrajectoriesQuestion,
    slice: SliceQuestion,
    grid: GridQuestion,
}

impl Loads {
    /// Around places that the map knows, and within its bounds.
    fn new(places: &[Vec3], bounds: Aabb) -> Self {
        let offset = |i: usize, reach_m: f32| {
            let [x, y, z, _] = pcg4d([i as u32, 0, 0, 7]);
            (Vec3::new(unit(x), unit(y), unit(z)) - 0.5) * reach_m
        };
        let place = |pose: usize| places[pose % places.len()];
        let sphere = |i: usize| Sphere {
            // The spheres of an arm lie within a metre.
            center: place(i / SPHERES) + offset(i, 0.8),
            radius_m: 0.05,
        };
        let start = |trajectory: usize| place(trajectory * POSES);
        let pose = |i: usize| {
            let (trajectory, step) = (i / POSES, i % POSES);
            let way = offset(trajectory, 2.0) * (step as f32 / POSES as f32);
            Waypoint {
                rotation: Quat::from_rotation_z(step as f32 * 0.02).to_array(),
                ..Waypoint::at(start(trajectory) + way)
            }
        };
        let middle = 0.5 * (bounds.min + bounds.max);
        let half = Vec3::splat(0.5 * VOXELS as f32 * VOXEL_M);
        Self {
            spheres: SpheresQuestion {
                terms: Terms::default(),
                spheres: (0..CANDIDATES * STEPS * SPHERES).map(sphere).collect(),
                fields: FIELDS,
            },
            trajectories: TrajectoriesQuestion {
                body: vec![Sphere { center: Vec3::ZERO, radius_m: 0.2 }],
                poses: (0..TRAJECTORIES * POSES).map(pose).collect(),
                lengths: vec![POSES as u32; TRAJECTORIES],
                ..TrajectoriesQuestion::default()
            },
            slice: SliceQuestion {
                z_m: middle.z,
                resolution_m: bounds.size().truncate().max_element() / CELLS as f32,
                region: Some(Aabb {
                    min: bounds.min,
                    max: bounds.min + Vec3::splat(bounds.size().truncate().max_element()),
                }),
                ..SliceQuestion::default()
            },
            grid: GridQuestion {
                terms: Terms::default(),
                region: Aabb { min: middle - half, max: middle + half },
                voxel_m: VOXEL_M,
                fields: Fields { state: true, ..Fields::DISTANCE },
                format: NumberFormat::F32,
            },
        }
    }

    /// One question of a kind to a server.
    async fn ask(&self, client: &Client, kind: usize) -> Result<()> {
        match kind {
            0 => drop(client.query_spheres(&self.spheres).await?),
            1 => drop(client.check_trajectories(&self.trajectories).await?),
            2 => drop(client.get_slice(&self.slice).await?),
            _ => drop(client.get_grid(&self.grid).await?),
        }
        Ok(())
    }

    /// The same question to a view.
    fn answer(&self, view: &MapView, kind: usize, pool: &ThreadPool) {
        let query = |points: &[Vec3], fields: Fields| view.query(points, fields);
        match kind {
            0 => {
                let centers: Vec<Vec3> = self.spheres.spheres.iter().map(|s| s.center).collect();
                let mut answers = query_parallel(&query, &centers, FIELDS, pool);
                for (distance, sphere) in answers.distance.iter_mut().zip(&self.spheres.spheres) {
                    *distance -= sphere.radius_m;
                }
                black_box(answers);
            }
            1 => {
                let TrajectoriesQuestion { body, poses, margin_m, swept, .. } = &self.trajectories;
                let settings = PathSettings { margin_m: *margin_m, swept: *swept, unknown_m: None };
                let parts: Vec<PathPart<'_>> = poses
                    .chunks(POSES)
                    .map(|poses| PathPart { poses, from: 0, to: poses.len() })
                    .collect();
                pool.scope(|scope| {
                    for parts in parts.chunks(TRAJECTORIES / 16) {
                        scope.spawn(|_| {
                            black_box(check_paths(&query, body, parts, &settings, &|| false));
                        });
                    }
                });
            }
            2 => {
                let region = self.slice.region.unwrap_or(Aabb::EMPTY);
                let shape = LevelShape {
                    origin: region.min.truncate(),
                    resolution_m: self.slice.resolution_m,
                    width: CELLS,
                    height: CELLS,
                    heights: vec![self.slice.z_m],
                };
                let regular = |grid: &PointGrid<'_>, fields: Fields| view.query_grid(grid, fields);
                let pieces = shape.pieces(PIECE);
                pool.scope(|scope| {
                    for piece in 0..pieces.count() {
                        let (shape, regular) = (&shape, &regular);
                        scope.spawn(move |_| {
                            black_box(shape.distances(regular, pieces.voxels(piece), None));
                        });
                    }
                });
            }
            _ => {
                let shape = GridShape::covering(&self.grid.region, VOXEL_M);
                let pieces = Pieces::new(shape.size, PIECE as u32);
                pool.scope(|scope| {
                    for piece in 0..pieces.count() {
                        scope.spawn(move |_| {
                            let [x, y, z] = pieces.voxels(piece);
                            let axes = [(0, x), (1, y), (2, z)];
                            let axes = axes.map(|(axis, of)| shape.centers_along(axis, of));
                            let grid = PointGrid { axes: axes.each_ref().map(Vec::as_slice) };
                            black_box(view.query_grid(&grid, self.grid.fields));
                        });
                    }
                });
            }
        }
    }
}

impl PlannerBenchArgs {
    pub(super) fn run(&self, out: &mut Printer) -> anyhow::Result<()> {
        let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
        runtime.block_on(async {
            let server = ServerProcess::start().await?;
            let (camera, client) =
                (Client::connect(server.grpc()).await?, Client::connect(server.grpc()).await?);
            let room = Synthetic::room(self.frames as usize).with_width(self.width);
            let frames = load(&room, &(0..room.len()).collect::<Vec<_>>())?;
            Robot::start(&camera, frames.clone(), RATE_HZ, Some(1)).arrive().await?;
            let places = known_points(&client, CANDIDATES * STEPS).await?;
            let url = server.grpc().to_owned();
            let mirror = tokio::task::spawn_blocking(move || Mirror::open(&url, DEFAULT_MAP));
            let mirror = Arc::new(mirror.await??);
            let loads = Arc::new(Loads::new(&places, mirror.view().bounds()));

            let robot = Robot::start(&camera, frames, RATE_HZ, None);
            let remote = self.remote(&client, &loads).await?;
            let pool = query_pool(2)?;
            let local = self.local(&mirror, loads, pool).await?;
            robot.finish().await?;
            tokio::task::spawn_blocking(move || drop(mirror)).await?;
            for (kind, (name, remote_ms, local_ms)) in KINDS.iter().enumerate() {
                let grpc = format!("{name}, gRPC, while mapping");
                out.figures(figures(&grpc, &remote[kind], *remote_ms))?;
                let process = format!("{name}, in a mirror on 2 threads, while mapping");
                out.figures(figures(&process, &local[kind], *local_ms))?;
            }
            Ok(server.stop().await?)
        })
    }

    /// How long each answer of a server took, ms, by kind, in turns.
    async fn remote(&self, client: &Client, loads: &Loads) -> Result<Vec<Vec<f64>>> {
        let mut times = vec![Vec::new(); KINDS.len()];
        let mut cycle = self.cycle();
        for round in 0..=self.rounds {
            for (kind, times) in times.iter_mut().enumerate() {
                cycle.tick().await;
                let start = Instant::now();
                loads.ask(client, kind).await?;
                // The first round warms up.
                if round > 0 {
                    times.push(start.elapsed().as_secs_f64() * 1e3);
                }
            }
        }
        Ok(times)
    }

    /// The same of a mirror's newest views, off the threads of the robot.
    async fn local(
        &self,
        mirror: &Arc<Mirror>,
        loads: Arc<Loads>,
        pool: ThreadPool,
    ) -> anyhow::Result<Vec<Vec<f64>>> {
        let pool = Arc::new(pool);
        let mut times = vec![Vec::new(); KINDS.len()];
        let mut cycle = self.cycle();
        for round in 0..=self.rounds {
            for (kind, times) in times.iter_mut().enumerate() {
                cycle.tick().await;
                let (mirror, loads, pool) = (mirror.clone(), loads.clone(), pool.clone());
                let timed = tokio::task::spawn_blocking(move || {
                    let start = Instant::now();
                    loads.answer(&mirror.view(), kind, &pool);
                    start.elapsed().as_secs_f64() * 1e3
                });
                let ms = timed.await?;
                if round > 0 {
                    times.push(ms);
                }
            }
        }
        Ok(times)
    }

    fn cycle(&self) -> tokio::time::Interval {
        let mut cycle = tokio::time::interval(Duration::from_millis(self.cycle_ms));
        cycle.set_missed_tick_behavior(tokio::time::MissedTickBehavior::Delay);
        cycle
    }
}

fn figures(case: &str, ms: &[f64], limit: Option<f64>) -> [Figure; 2] {
    let median = Figure::new(case, "median", percentile(ms, 0.5), Unit::Milliseconds);
    [
        median.against(limit.map(Target::at_most)),
        Figure::new(case, "p95", percentile(ms, 0.95), Unit::Milliseconds),
    ]
}
