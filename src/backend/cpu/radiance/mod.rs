//! Colours compared along rays: forward through the distance field, composited, and back to the
//! colours of vertices and, if asked, to the distances (paper eq:volrender; algorithms.md §7).

mod march;
mod rows;
#[cfg(test)]
pub(in crate::backend) mod tests;

use glam::Vec3;
use rayon::prelude::*;

pub(in crate::backend) use self::march::{BEFORE_M, BEHIND_M, HALF_DIAGONAL, PIECE};
use self::march::{Field, March};
use self::rows::Rows;
use super::chunk::{self, CHUNK, Output};
use super::plan::Plan;
use super::workspace::Workspace;
use super::{CpuBackend, Host, Inputs};
use crate::backend::{ColorRows, RadianceParameters, StepParameters};
use crate::modality::composite::{Shade, Share, backward, divide, mix};
use crate::modality::losses::sign;
use crate::modality::radiance::{logits, sigmoid};
use crate::octree::{Lookup, NodeSource, sum_of_observed};
use crate::surface::ColorField;
use crate::train::{Batch, ColorRay, SampleKind};

/// Rays a task; fixed, so that sums do not depend on the threads.
const RAYS: usize = 64;
/// A ray that loses less light than this has no colour.
pub(in crate::backend) const LEAST_TAKEN: f32 = 0.5;
/// Distances beyond this learn nothing from colours, m: a surface is not moved from afar
/// (algorithms.md §7).
pub(in crate::backend) const NEAR_M: f32 = 0.1;

/// What training colours keeps from step to step.
pub(in crate::backend) struct Radiance {
    rows: Rows,
    plan: Plan,
    outputs: Vec<Output>,
    distances: Vec<f32>,
}

/// What some rays left behind.
#[derive(Default)]
struct Compared {
    /// Derivatives of the sum of |Ĉ − C| over rays and channels, by logits of vertices ...
    by_rows: Vec<(u32, [f32; 3])>,
    /// ... and by the distance at ends (0, 1) of pieces.
    by_ends: Vec<((u32, u8), f32)>,
    /// Sum of |Ĉ − C|, mean over channels, and of how many rays.
    loss: f64,
    rays: u32,
}

/// The vertices that a colour comes from.
struct Source {
    rows: [u32; 8],
    /// Shares of the logits; 0 where a vertex was not observed.
    shares: [f32; 8],
    /// The colour of the logits alone, and by channel 1, or 0 where what harmonics add to it leaves
    /// 0..1, so that the logits have no say.
    base: Vec3,
    open: Vec3,
}

impl Radiance {
    pub(super) fn new() -> Self {
        Self {
            rows: Rows::new(),
            plan: Plan::default(),
            outputs: Vec::new(),
            distances: Vec::new(),
        }
    }

    pub(super) fn export(&self) -> ColorRows {
        self.rows.state.clone()
    }

    pub(super) fn import(&mut self, state: ColorRows, vertices: usize) {
        self.rows.replace(state, vertices);
    }

    pub(super) fn bytes(&self) -> u64 {
        (self.rows.state.steps.len() * ColorRows::ROW_BYTES) as u64
    }

    pub(super) fn read_changed(
        &mut self,
        vertices: usize,
        visit: &mut dyn FnMut(u32, &[[f32; 3]]),
    ) {
        self.rows.read_changed(vertices, visit);
    }
}

impl CpuBackend {
    /// Compares the colours of rays with the map's: steps the colours and, where `sharpens`, adds
    /// what the distances should do about it to the batch. Returns the mean |Ĉ − C|.
    pub(super) fn compare_colors<N: NodeSource + Sync>(
        &mut self,
        host: &Host<'_, N>,
        field: &ColorField,
        rays: &[ColorRay],
        parameters: &StepParameters,
        radiance: &RadianceParameters,
        batch: &mut Batch,
    ) -> f64 {
        self.radiance.rows.resize(field.band.rows());
        let (march, mut all) = self.compared(host, field, rays, parameters, radiance);
        // The loss is a mean over the rays that have a colour, and over channels.
        let factor = radiance.weight / (3 * all.rays.max(1)) as f32;
        for (_, by) in &mut all.by_rows {
            *by = by.map(|by| by * factor);
        }
        let vertices = field.band.scale.vertices();
        self.radiance.rows.step(&all.by_rows, vertices, radiance.rate);
        if radiance.sharpens {
            let mut by_points = vec![0.0; march.points.len()];
            for (end, by) in all.by_ends {
                march.scatter(end, by, &mut by_points);
            }
            let moved = march.points.into_iter().zip(by_points).filter(|(_, by)| *by != 0.0);
            for (point, by) in moved {
                batch.points.push(point);
                batch.kinds.push(SampleKind::Ray);
                batch.distances.push(by * factor);
                batch.occupancies.push(0.0);
                batch.eikonal.push(false);
            }
        }
        all.loss / f64::from(all.rays.max(1))
    }

    /// Follows rays, and finds what their colours say before anything is stepped.
    fn compared<N: NodeSource + Sync>(
        &mut self,
        host: &Host<'_, N>,
        field: &ColorField,
        rays: &[ColorRay],
        parameters: &StepParameters,
        radiance: &RadianceParameters,
    ) -> (March, Compared) {
        let mut march = self.pool.install(|| self.march(host, radiance, rays));
        self.distances_at(host, &march, parameters);
        march.measure(&self.radiance.distances);
        let compare = Compare {
            march: &march,
            field,
            learned: &self.radiance.rows.state.learned,
            sharpness: radiance.sharpness,
        };
        let parts: Vec<Compared> = self.pool.install(|| {
            let starts = (0..rays.len()).step_by(RAYS).collect::<Vec<_>>();
            let part = |&start: &usize| compare.run(rays, start..(start + RAYS).min(rays.len()));
            starts.par_iter().map(part).collect()
        });
        let mut all = Compared::default();
        for part in parts {
            all.by_rows.extend(part.by_rows);
            all.by_ends.extend(part.by_ends);
            all.loss += part.loss;
            all.rays += part.rays;
        }
        (march, all)
    }

    fn march<N: NodeSource + Sync>(
        &self,
        host: &Host<'_, N>,
        radiance: &RadianceParameters,
        rays: &[ColorRay],
    ) -> March {
        let field = Field {
            host,
            learned: &self.rows.learned,
            surface_log2: self.surface_log2,
            sharpness: radiance.sharpness,
            renderer: radiance.renderer,
        };
        let follow = |rays: &[ColorRay]| field.follow(rays);
        let parts: Vec<March> = rays.par_chunks(RAYS).map(follow).collect();
        let mut march = March::default();
        parts.into_iter().for_each(|part| march.append(part));
        march.ask_corners(host.prior.len());
        march
    }

    /// Finds the distances at the points of a march; not a number outside of the tree.
    fn distances_at<N: NodeSource + Sync>(
        &mut self,
        host: &Host<'_, N>,
        march: &March,
        parameters: &StepParameters,
    ) {
        let points = march.points.len();
        let batch = Batch {
            points: march.points.clone(),
            kinds: vec![SampleKind::Ray; points],
            distances: vec![0.0; points],
            occupancies: vec![0.0; points],
            eikonal: vec![false; points],
        };
        let Radiance { plan, outputs, distances, .. } = &mut self.radiance;
        distances.clear();
        distances.resize(points, f32::NAN);
        let Some(lookup) = Lookup::new(host.nodes) else { return };
        self.pool.install(|| {
            plan.make(host.nodes, self.rows.len(), &batch, parameters);
            let inputs = Inputs {
                host,
                lookup,
                batch: &batch,
                plan,
                learned: &self.rows.learned,
                decoders: &self.decoders,
                parameters,
                train_occupancy: false,
                set: self.set,
            };
            let mut found = vec![0.0; inputs.plan.order.len()];
            outputs.resize_with(found.len().div_ceil(CHUNK), Output::default);
            let workspaces = &self.workspaces;
            let chunks = found.par_chunks_mut(CHUNK).zip(&mut outputs[..]).enumerate();
            chunks.for_each(|(i, (found, output))| {
                super::with_workspace(workspaces, |workspace: &mut Workspace| {
                    chunk::evaluate(&inputs, i * CHUNK, workspace, output, found);
                });
            });
            for (point, f) in inputs.plan.order.iter().zip(found) {
                distances[*point as usize] = f;
            }
        });
    }
}

/// What the comparison of a ray reads.
struct Compare<'a> {
    march: &'a March,
    field: &'a ColorField,
    learned: &'a [[f32; 3]],
    sharpness: f32,
}

impl Compare<'_> {
    fn run(&self, rays: &[ColorRay], range: std::ops::Range<usize>) -> Compared {
        let mut out = Compared::default();
        let (mut shares, mut shades, mut sources) = (Vec::new(), Vec::new(), Vec::new());
        let (mut by_colors, mut by_f) = (Vec::new(), Vec::new());
        for i in range {
            let begin = i.checked_sub(1).map_or(0, |before| self.march.ends[before] as usize);
            let pieces = &self.march.pieces[begin..self.march.ends[i] as usize];
            shares.clear();
            if pieces.iter().any(|piece| piece.f.iter().any(|f| f.is_nan())) {
                continue;
            }
            divide(pieces, self.sharpness, &mut shares);
            self.shade(&rays[i], &mut shares, &mut shades, &mut sources);
            let (mixed, taken) = mix(&shares, &shades);
            if taken < LEAST_TAKEN {
                continue;
            }
            let error = mixed - rays[i].color;
            out.loss += f64::from(error.abs().element_sum()) / 3.0;
            out.rays += 1;
            let by_mixed = Vec3::new(sign(error.x), sign(error.y), sign(error.z));
            by_f.clear();
            by_f.resize(pieces.len(), [0.0; 2]);
            let found = (&shares[..], &shades[..]);
            backward(self.sharpness, pieces, found, by_mixed, &mut by_colors, &mut by_f);
            for (by, source) in by_colors.iter().zip(&sources) {
                source.scatter(*by, &mut out.by_rows);
            }
            for (piece, by) in by_f.iter().enumerate() {
                for (end, &by) in by.iter().enumerate() {
                    let near = pieces[piece].f[end].abs() < NEAR_M;
                    if near && by != 0.0 {
                        out.by_ends.push((((begin + piece) as u32, end as u8), by));
                    }
                }
            }
        }
        out
    }

    /// Looks up the colours of shares; those without one are left out.
    fn shade(
        &self,
        ray: &ColorRay,
        shares: &mut Vec<Share>,
        shades: &mut Vec<Shade>,
        sources: &mut Vec<Source>,
    ) {
        shades.clear();
        sources.clear();
        shares.retain(|share| match self.color(ray, share.t) {
            Some((shade, source)) => {
                shades.push(shade);
                sources.push(source);
                true
            }
            None => false,
        });
    }

    /// The colour at a place on a ray: that of [`crate::modality::radiance::color_along`].
    fn color(&self, ray: &ColorRay, t: f32) -> Option<(Shade, Source)> {
        let scale = self.field.band.scale;
        let place = scale.place(ray.origin + ray.direction * t);
        let block = self.field.band.find(place.cell)?;
        let rows = scale.vertices_around(&place, self.field.band.uppers(block));
        let observed = rows.map(|row| {
            let seen = self.field.seen().get(row as usize).filter(|seen| seen.weight > 0.0)?;
            Some(logits(Vec3::from(seen.color)) + Vec3::from(self.learned[row as usize]))
        });
        let weights = place.weights();
        let slopes = place.slopes(ray.direction * (1.0 / scale.spacing_m()));
        let Blend { value, along, total } = Blend::of(&observed, &weights, &slopes)?;
        let base = sigmoid(value);
        let mut shade = Shade { color: base, along: along * base * (1.0 - base) };
        let mut open = Vec3::ONE;
        if let Some(harmonics) = self.field.harmonics_along(ray.direction) {
            let added: [_; 8] = std::array::from_fn(|k| {
                observed[k].map(|_| self.field.added_along(rows[k], &harmonics))
            });
            let Blend { value, along, .. } = Blend::of(&added, &weights, &slopes)?;
            let color = base + value;
            let is_open = color.cmpge(Vec3::ZERO) & color.cmple(Vec3::ONE);
            open = Vec3::select(is_open, Vec3::ONE, Vec3::ZERO);
            let along = (shade.along + along) * open;
            shade = Shade { color: color.clamp(Vec3::ZERO, Vec3::ONE), along };
        }
        let share = |k: usize| observed[k].map_or(0.0, |_| weights[k] / total);
        Some((shade, Source { rows, shares: std::array::from_fn(share), base, open }))
    }
}

/// What vertices give at a place of a ray.
struct Blend {
    value: Vec3,
    /// ∂/∂t.
    along: Vec3,
    /// The weights of those that were observed.
    total: f32,
}

impl Blend {
    /// Of values with these weights, which change along the ray with these slopes; `None` where no
    /// vertex has one.
    fn of(values: &[Option<Vec3>; 8], weights: &[f32; 8], slopes: &[f32; 8]) -> Option<Self> {
        let (sum, total) = sum_of_observed(values, weights);
        let (sum_along, total_along) = sum_of_observed(values, slopes);
        if total <= 0.0 {
            return None;
        }
        let value = sum / total;
        Some(Self { value, along: (sum_along - value * total_along) / total, total })
    }
}

impl Source {
    /// Adds the derivatives by logits, from those by the colour.
    fn scatter(&self, by_color: Vec3, by_rows: &mut Vec<(u32, [f32; 3])>) {
        let by_logits = by_color * self.open * self.base * (1.0 - self.base);
        for (row, share) in self.rows.iter().zip(self.shares) {
            if share > 0.0 {
                by_rows.push((*row, (by_logits * share).to_array()));
            }
        }
    }
}
