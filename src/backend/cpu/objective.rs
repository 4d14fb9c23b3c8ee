//! What a step lowers: the losses of a tile's samples, and their derivatives.

use super::chunk::Inputs;
use super::plan::Plan;
use super::workspace::{Tile, TileSample};
use crate::backend::{Losses, StepParameters};
use crate::modality::losses::{Stencil, absolute, consistency, cross_entropy};
use crate::modality::occupancy;
use crate::octree::NodeSource;
use crate::train::SampleKind;

/// The factor of each term: its weight over the number of samples that pay it.
pub(super) struct Factors {
    distance: [f32; 3],
    eikonal: [f32; 3],
    occupancy: f32,
    consistency: f32,
}

impl Factors {
    pub(super) fn new(plan: &Plan, parameters: &StepParameters) -> Self {
        let (w, counts) = (&parameters.weights, &plan.counts);
        let per = |weight: f32, count: usize| weight / count.max(1) as f32;
        let [free, perturbed, surface, _] = counts.kinds;
        let near = counts.eikonal[1] + counts.eikonal[2];
        Self {
            distance: [
                per(w.projection, free),
                per(w.perturbation, perturbed),
                per(w.boundary, surface),
            ],
            eikonal: [
                per(w.eikonal_space, counts.eikonal[0]),
                per(w.eikonal_surface, near),
                per(w.eikonal_surface, near),
            ],
            occupancy: per(w.occupancy, counts.samples()),
            consistency: per(w.consistency, free + perturbed),
        }
    }
}

/// The losses of a tile's samples: sums into `losses`, derivatives into the tile.
pub(super) fn lose<N: NodeSource>(
    inputs: &Inputs<'_, N>,
    factors: &Factors,
    tile: &mut Tile,
    losses: &mut Losses,
) {
    let stencil = inputs.parameters.stencil;
    let points = stencil.offsets().len();
    tile.by_distances.fill(0.0);
    tile.by_logits.fill(0.0);
    for (i, TileSample { sample, stencil: at }) in tile.samples.iter().enumerate() {
        let sample = *sample as usize;
        let kind = inputs.batch.kinds[sample];
        if kind == SampleKind::Ray {
            tile.by_distances[i] = inputs.batch.distances[sample];
            continue;
        }
        let found = tile.distances[i] + tile.residuals[i];
        let (loss, slope) = absolute(found, inputs.batch.distances[sample]);
        let factor = factors.distance[kind as usize];
        let mut total = f64::from(factor) * f64::from(loss);
        let mut by_found = factor * slope;
        *match kind {
            SampleKind::Free => &mut losses.projection,
            SampleKind::Perturbed => &mut losses.perturbation,
            SampleKind::Surface | SampleKind::Ray => &mut losses.boundary,
        } += f64::from(loss);

        if *at > 0 {
            let mut around = [0.0; Stencil::MAX];
            for (j, f) in around[..points].iter_mut().enumerate() {
                *f = tile.distances[at + j] + tile.residuals[at + j];
            }
            let (loss, by_centre, by_around) = stencil.eikonal(found, &around);
            let factor = factors.eikonal[kind as usize];
            total += f64::from(factor) * f64::from(loss);
            by_found += factor * by_centre;
            for (j, by) in by_around[..points].iter().enumerate() {
                tile.by_distances[at + j] = factor * by;
            }
            *if kind != SampleKind::Free {
                &mut losses.eikonal_surface
            } else {
                &mut losses.eikonal_space
            } += f64::from(loss);
        }

        if inputs.train_occupancy {
            let logit = occupancy::prior_logit(tile.distances[i]) + tile.logits[i];
            let (loss, slope) = cross_entropy(logit, inputs.batch.occupancies[sample]);
            total += f64::from(factors.occupancy) * f64::from(loss);
            losses.occupancy += f64::from(loss);
            tile.by_logits[i] = factors.occupancy * slope;
            if kind != SampleKind::Surface {
                let (loss, slope) = consistency(found, logit);
                total += f64::from(factors.consistency) * f64::from(loss);
                losses.consistency += f64::from(loss);
                by_found += factors.consistency * slope;
            }
        }
        tile.by_distances[i] = by_found;
        losses.total += total;
    }
}
