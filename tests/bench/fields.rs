//! What training and reading the fields cost on the CPU, on one thread and on two.
#![allow(clippy::print_stdout, reason = "a benchmark prints what it measures")]
#![allow(clippy::expect_used, reason = "a benchmark reports by panicking")]

use std::hint::black_box;
use std::sync::Arc;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use glam::Vec3;
use orenx::backend::{Backend, CpuBackend, Host, StepParameters};
use orenx::config::{MapConfig, MapSettings, Profile};
use orenx::geometry::random::{normal, pcg4d, unit};
use orenx::modality::Features;
use orenx::modality::losses::{LossWeights, Stencil};
use orenx::modality::read::{Answers, evaluate};
use orenx::octree::Explicit;
use orenx::train::{Batch, SampleKind};
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

#[path = "../support/tree.rs"]
mod tree;

use tree::Tree;

/// Half sizes of the room, m.
const ROOM: Vec3 = Vec3::new(3.9, 2.4, 1.4);
/// Points of one query.
const QUERY: usize = 10_000;

/// Signed distance to the walls, positive inside the room.
fn distance(at: Vec3) -> f32 {
    (ROOM - at.abs()).min_element()
}

fn prior(at: Vec3) -> Explicit {
    let gap = ROOM - at.abs();
    let axis = if gap.x <= gap.y.min(gap.z) {
        Vec3::X
    } else if gap.y <= gap.z {
        Vec3::Y
    } else {
        Vec3::Z
    };
    let g = -axis * at.signum();
    [distance(at), g.x, g.y, g.z]
}

/// 0.1 m near the walls, 0.2 m elsewhere in the room: the leaves of a mapped room.
fn room() -> Tree {
    let split = |min: Vec3, size: f32| {
        let centre = min + Vec3::splat(0.5 * size);
        let reach = 0.87 * size + 0.1;
        size > 0.25 && distance(centre) > -reach || distance(centre).abs() < reach
    };
    Tree::new(7, 0.1, split, prior)
}

fn config(profile: Profile) -> MapConfig {
    let settings = MapSettings { profile, ..MapSettings::default() };
    MapConfig::from_settings(&settings).expect("valid settings")
}

fn pool(threads: usize) -> Arc<ThreadPool> {
    Arc::new(ThreadPoolBuilder::new().num_threads(threads).build().expect("threads"))
}

/// Rays from the middle of the room: one free, two perturbed, one surface sample each.
fn batch(config: &MapConfig, seed: u32) -> Batch {
    let mut batch = Batch::default();
    for ray in 0..config.rays_per_step {
        let w = pcg4d([seed, 1, 0, ray]);
        let z = 2.0 * unit(w[0]) - 1.0;
        let (sin, cos) = (std::f32::consts::TAU * unit(w[1])).sin_cos();
        let direction = Vec3::new(cos, sin, 0.0) * (1.0 - z * z).sqrt() + Vec3::Z * z;
        let depth = (ROOM / direction.abs().max(Vec3::splat(1e-6))).min_element();
        let more = pcg4d([seed, 2, 0, ray]);
        let noise = |a, b| (0.06 * normal(a, b)).clamp(-0.12, 0.12);
        let samples = [
            (depth * unit(w[2]), SampleKind::Free),
            (depth + noise(more[0], more[1]), SampleKind::Perturbed),
            (depth + noise(more[2], more[3]), SampleKind::Perturbed),
            (depth, SampleKind::Surface),
        ];
        for (i, (t, kind)) in samples.into_iter().enumerate() {
            let point = direction * t;
            batch.points.push(point);
            batch.kinds.push(kind);
            batch.distances.push(distance(point));
            batch.occupancies.push(if t < depth {
                0.0
            } else if t > depth {
                1.0
            } else {
                0.75
            });
            let draw = pcg4d([seed, 3 + i as u32, 0, ray]);
            batch.eikonal.push(unit(draw[0]) < config.eikonal_share);
        }
    }
    batch
}

fn parameters(profile: Profile) -> StepParameters {
    StepParameters {
        rate: 1e-3,
        occupancy_rate: 1e-2,
        decoder_rate: 1e-3,
        stencil: if profile == Profile::Full { Stencil::Central } else { Stencil::Forward },
        radiance: None,
        weights: LossWeights::default(),
    }
}

fn steps(criterion: &mut Criterion) {
    let tree = room();
    for (name, profile) in [("lite", Profile::Lite), ("full", Profile::Full)] {
        let config = config(profile);
        let batches: Vec<Batch> = (0..8).map(|seed| batch(&config, seed)).collect();
        for threads in [1, 2] {
            let mut backend = CpuBackend::new(&config, pool(threads)).expect("valid");
            backend.resize(tree.rows.len());
            let host = Host { nodes: &tree, prior: &tree.prior };
            let parameters = parameters(profile);
            let mut next = 0;
            let mut group = criterion.benchmark_group("step");
            group.throughput(Throughput::Elements(u64::from(config.rays_per_step)));
            group.bench_function(format!("{name}/{threads} threads"), |bencher| {
                bencher.iter(|| {
                    next += 1;
                    let batch = &batches[next % batches.len()];
                    black_box(backend.step(&host, batch, &parameters).expect("valid"))
                });
            });
        }
    }
}

/// Points of a planner: half of them within 0.2 m of a wall, half anywhere in the room.
fn query_points() -> Vec<Vec3> {
    (0..QUERY as u32)
        .map(|i| {
            let w = pcg4d([9, 9, 0, i]);
            let mut point = (Vec3::new(unit(w[0]), unit(w[1]), unit(w[2])) * 2.0 - 1.0) * ROOM;
            if i % 2 == 0 {
                let near = unit(pcg4d([9, 8, 0, i])[0]) * 0.3 - 0.1;
                point.z = (ROOM.z - near) * point.z.signum();
            }
            point
        })
        .collect()
}

fn evaluations(criterion: &mut Criterion) {
    let mut tree = room();
    for (name, profile) in [("lite", Profile::Lite), ("full", Profile::Full)] {
        let config = config(profile);
        let mut backend = CpuBackend::new(&config, pool(2)).expect("valid");
        backend.resize(tree.rows.len());
        // Every row near a wall has learned something.
        for row in 0..tree.rows.len() {
            let learned = if tree.prior[row][0].abs() < 0.25 { 0.01 } else { 0.0 };
            tree.rows[row].features = Features::nearest(&[learned; 16], &[learned; 8]);
        }
        let decoders = backend.decoders();
        let points = query_points();
        let mut distance = vec![0.0; QUERY];
        let mut gradient = vec![Vec3::ZERO; QUERY];
        let mut occupancy = vec![0.0; QUERY];
        for threads in [1, 2] {
            let pool = pool(threads);
            let mut group = criterion.benchmark_group("evaluate");
            group.throughput(Throughput::Elements(QUERY as u64));
            group.bench_function(format!("{name}/distance and gradient/{threads} threads"), |b| {
                b.iter(|| {
                    pool.install(|| {
                        points
                            .par_chunks(1000)
                            .zip(distance.par_chunks_mut(1000))
                            .zip(gradient.par_chunks_mut(1000))
                            .for_each(|((points, distance), gradient)| {
                                let answers = Answers { distance, gradient, ..Answers::default() };
                                evaluate(&tree, &decoders, points, answers);
                            });
                    });
                });
            });
        }
        let mut group = criterion.benchmark_group("evaluate");
        group.throughput(Throughput::Elements(QUERY as u64));
        group.bench_function(format!("{name}/distance alone/1 thread"), |bencher| {
            bencher.iter(|| {
                let answers = Answers { distance: &mut distance, ..Answers::default() };
                evaluate(&tree, &decoders, &points, answers);
            });
        });
        group.bench_function(format!("{name}/everything/1 thread"), |bencher| {
            bencher.iter(|| {
                let answers = Answers {
                    distance: &mut distance,
                    gradient: &mut gradient,
                    occupancy: &mut occupancy,
                    ..Answers::default()
                };
                evaluate(&tree, &decoders, &points, answers);
            });
        });
    }
}

fn configured() -> Criterion {
    Criterion::default()
        .sample_size(20)
        .warm_up_time(std::time::Duration::from_millis(500))
        .measurement_time(std::time::Duration::from_secs(3))
}

criterion_group! { name = fields; config = configured(); targets = steps, evaluations }
criterion_main!(fields);
