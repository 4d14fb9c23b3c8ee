//! The trainer against central differences, a hand-written Adam, itself on other threads and
//! instruction sets, and a scene that the prior cannot hold.

mod fitting;
mod gradients;
mod stepping;

use std::sync::Arc;

use glam::Vec3;
use rayon::ThreadPoolBuilder;

use super::*;

use crate::config::{MapConfig, MapSettings, Profile};
use crate::geometry::random::{pcg4d, unit};
use crate::modality::losses::{LossWeights, Stencil};
use crate::modality::test_tree::Tree;
use crate::train::SampleKind;

pub(in crate::backend) fn config(profile: Profile) -> MapConfig {
    let settings = MapSettings { profile, seed: 3, ..MapSettings::default() };
    MapConfig::from_settings(&settings).expect("valid settings")
}

pub(in crate::backend) fn backend(profile: Profile, threads: usize) -> CpuBackend {
    let pool = ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
    CpuBackend::new(&config(profile), Arc::new(pool)).expect("a valid configuration")
}

pub(in crate::backend) fn parameters(stencil: Stencil) -> StepParameters {
    StepParameters {
        rate: 1e-3,
        occupancy_rate: 1e-2,
        decoder_rate: 1e-3,
        stencil,
        radiance: None,
        weights: LossWeights::default(),
    }
}

/// 0.8 m around the origin in 0.1 m voxels, but one octant stays 0.4 m, so that stencils cross
/// between sizes.
pub(in crate::backend) fn mixed_tree(field: impl Fn(Vec3) -> [f32; 4]) -> Tree {
    Tree::new(3, 0.1, |min, size| size > 0.4 || min.min_element() < 0.0, field)
}

pub(in crate::backend) fn random(stream: u32, i: usize) -> [f32; 4] {
    pcg4d([77, stream, 0, i as u32]).map(|w| 2.0 * unit(w) - 1.0)
}

/// Samples off every kink: labels far from the field, gradients far from unit length.
pub(in crate::backend) fn rough_batch(samples: usize) -> Batch {
    let mut batch = Batch::default();
    for i in 0..samples {
        let r = random(1, i);
        batch.points.push(Vec3::new(r[0], r[1], r[2]) * 0.42);
        batch.kinds.push([SampleKind::Free, SampleKind::Perturbed, SampleKind::Surface][i % 3]);
        batch.distances.push(if i % 2 == 0 { 1.5 } else { -1.5 });
        batch.occupancies.push([0.0, 0.75, 1.0][i % 3]);
        batch.eikonal.push(i % 4 != 3);
    }
    batch
}

/// A backend whose rows and decoders are far from zero.
pub(in crate::backend) fn rough_backend(
    profile: Profile,
    threads: usize,
    rows: usize,
) -> CpuBackend {
    let mut backend = backend(profile, threads);
    backend.rows.resize(rows);
    for (i, row) in backend.rows.learned.iter_mut().enumerate() {
        let value = |j: usize| random(2, i * 32 + j)[0];
        row.sdf_feature = std::array::from_fn(value);
        row.occupancy_feature = std::array::from_fn(|j| value(16 + j));
        row.explicit = std::array::from_fn(|j| 0.2 * value(24 + j));
    }
    backend
}

pub(in crate::backend) fn rough_prior(at: Vec3) -> [f32; 4] {
    let g = Vec3::new(1.5, -1.2, 0.9);
    [0.02 + 0.3 * g.dot(at), g.x, g.y, g.z]
}

/// What the passes of a step find before anything is stepped, for whoever must find the same.
pub(in crate::backend) struct Found {
    /// Voxels of each sample of the batch and of its stencil.
    pub(in crate::backend) sites: Vec<Site>,
    /// Row, gradient, and whether a sample gathered its occupancy feature; rows ascending.
    pub(in crate::backend) rows: Vec<(u32, [f32; RowMoments::COLUMNS], bool)>,
    pub(in crate::backend) by_sdf_weights: Vec<f32>,
    pub(in crate::backend) by_occupancy_weights: Vec<f32>,
    pub(in crate::backend) report: StepReport,
}

/// The voxels of a sample, and of its stencil where it pays the Eikonal loss.
pub(in crate::backend) type Site = (crate::octree::Found, Option<[crate::octree::Found; 6]>);

pub(in crate::backend) fn found(
    backend: &mut CpuBackend,
    tree: &Tree,
    batch: &Batch,
    p: &StepParameters,
) -> Found {
    let host = Host { nodes: tree, prior: &tree.prior };
    let report = backend.accumulate(&host, batch, p).expect("a valid batch");
    let rows = backend.rows.gradients(&backend.outputs);
    let site = |site: &plan::Site| (site.centre, site.eikonal.then_some(site.around));
    Found {
        sites: backend.plan.sites.iter().map(site).collect(),
        rows: rows.into_iter().map(|(row, g)| (row, g.columns, g.occupied)).collect(),
        by_sdf_weights: backend.sdf_memory.gradient.clone(),
        by_occupancy_weights: backend.occupancy_memory.gradient.clone(),
        report,
    }
}

/// One step, on a tree instead of a scene.
pub(in crate::backend) fn step(
    backend: &mut CpuBackend,
    tree: &Tree,
    batch: &Batch,
    p: &StepParameters,
) -> StepReport {
    let host = Host { nodes: tree, prior: &tree.prior };
    backend.step(&host, batch, p).expect("a valid batch")
}

fn loss(backend: &mut CpuBackend, tree: &Tree, batch: &Batch, p: &StepParameters) -> f64 {
    let host = Host { nodes: tree, prior: &tree.prior };
    backend.accumulate(&host, batch, p).expect("a valid batch").losses.total
}

/// Samples of a field around its surface, labelled by it.
fn samples_of(field: impl Fn(Vec3) -> f32, count: usize, round: u32) -> Batch {
    let mut batch = Batch::default();
    let mut i = 0;
    while batch.points.len() < count {
        let words = pcg4d([5, 6, round, i]);
        let more = pcg4d([5, 7, round, i]);
        i += 1;
        let point = Vec3::new(unit(words[0]), unit(words[1]), unit(words[2])) * 0.76 - 0.38;
        let distance = field(point);
        let kind = match words[3] % 4 {
            0 => SampleKind::Free,
            3 => SampleKind::Surface,
            _ => SampleKind::Perturbed,
        };
        let reach = if kind == SampleKind::Free { 0.3 } else { 0.06 };
        if distance.abs() > reach || (kind == SampleKind::Free && distance < 0.0) {
            continue;
        }
        batch.points.push(point);
        batch.kinds.push(kind);
        batch.distances.push(distance);
        batch.occupancies.push(if distance > 0.01 {
            0.0
        } else if distance < -0.01 {
            1.0
        } else {
            0.75
        });
        batch.eikonal.push(unit(more[0]) < 0.25);
    }
    batch
}

/// Signed distance of a box of 0.23 m half width, whose edges fall between the vertices.
fn box_distance(at: Vec3) -> f32 {
    let q = at.abs() - Vec3::splat(0.23);
    q.max(Vec3::ZERO).length() + q.max_element().min(0.0)
}

fn box_prior(at: Vec3) -> [f32; 4] {
    let step = 1e-3;
    let g = [Vec3::X, Vec3::Y, Vec3::Z]
        .map(|e| (box_distance(at + e * step) - box_distance(at - e * step)) / (2.0 * step));
    [box_distance(at), g[0], g[1], g[2]]
}
