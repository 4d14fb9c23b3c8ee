//! Where the samples of a step lie: located, counted, and sorted by voxel.
//!
//! The order depends on the batch and the tree alone, so that all later sums, which follow it in
//! fixed chunks, have the same bits on any number of threads.

use glam::Vec3;
use rayon::prelude::*;

use super::radix::sort_by_key;
use crate::backend::StepParameters;
use crate::modality::losses::{STENCIL_M, Stencil};
use crate::octree::{Found, Lookup, NodeSource};
use crate::train::{Batch, SampleKind};

/// Samples located by one task.
const LOCATE_CHUNK: usize = 512;

/// The voxels of one sample and of its stencil.
#[derive(Clone, Copy)]
pub(super) struct Site {
    pub centre: Found,
    /// Whether it pays the Eikonal loss: it is asked to, and its whole stencil lies in the tree.
    pub eikonal: bool,
    /// Voxels of the stencil's points, where `eikonal`.
    pub around: [Found; Stencil::MAX],
}

impl Site {
    const NONE: Self =
        Self { centre: Found::NONE, eikonal: false, around: [Found::NONE; Stencil::MAX] };
}

/// How many samples pay each loss.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(super) struct Counts {
    /// By sample kind.
    pub kinds: [usize; 4],
    /// Of them, with Eikonal.
    pub eikonal: [usize; 4],
}

impl Counts {
    /// Samples that pay losses of their own.
    pub(super) fn samples(&self) -> usize {
        self.kinds[..SampleKind::Ray as usize].iter().sum()
    }
}

/// Working space, reused from step to step.
#[derive(Default)]
pub(super) struct Plan {
    pub sites: Vec<Site>,
    /// Samples that take part, those with Eikonal first, each group by voxel.
    pub order: Vec<u32>,
    pub counts: Counts,
    keys: Vec<(u32, u32)>,
    scratch: Vec<(u32, u32)>,
}

impl Plan {
    /// Locates and sorts a batch. Voxels that name a row at or beyond `rows` count as not there.
    pub(super) fn make<N: NodeSource + Sync>(
        &mut self,
        nodes: &N,
        rows: usize,
        batch: &Batch,
        parameters: &StepParameters,
    ) {
        self.order.clear();
        self.counts = Counts::default();
        self.sites.clear();
        let Some(lookup) = Lookup::new(nodes) else { return };
        self.sites.resize(batch.points.len(), Site::NONE);
        self.sites.par_chunks_mut(LOCATE_CHUNK).enumerate().for_each(|(chunk, sites)| {
            let locate = Locate { lookup: &lookup, nodes, rows, stencil: parameters.stencil };
            locate.chunk(batch, chunk * LOCATE_CHUNK, sites);
        });
        for eikonal in [true, false] {
            self.keys.clear();
            for (i, site) in self.sites.iter().enumerate() {
                if site.centre.is_some() && site.eikonal == eikonal {
                    let kind = batch.kinds[i] as usize;
                    self.counts.kinds[kind] += 1;
                    self.counts.eikonal[kind] += usize::from(eikonal);
                    self.keys.push((site.centre.node, i as u32));
                }
            }
            sort_by_key(&mut self.keys, &mut self.scratch);
            self.order.extend(self.keys.iter().map(|(_, sample)| sample));
        }
    }
}

struct Locate<'a, N> {
    lookup: &'a Lookup<'a, N>,
    nodes: &'a N,
    rows: usize,
    stencil: Stencil,
}

impl<N: NodeSource> Locate<'_, N> {
    fn chunk(&self, batch: &Batch, start: usize, sites: &mut [Site]) {
        let points = &batch.points[start..start + sites.len()];
        let mut cells = [Found::NONE; LOCATE_CHUNK];
        self.lookup.find_many(points, &mut cells[..points.len()]);
        for (i, site) in sites.iter_mut().enumerate() {
            let sample = start + i;
            let labelled =
                batch.distances[sample].is_finite() && batch.occupancies[sample].is_finite();
            *site = Site::NONE;
            if labelled && self.usable(cells[i]) {
                site.centre = cells[i];
                if batch.eikonal[sample] {
                    self.stencil(points[i], site);
                }
            }
        }
    }

    /// Voxels of the stencil: the sample's own, and a descent only for points that leave it.
    fn stencil(&self, point: Vec3, site: &mut Site) {
        let home = self.lookup.located(site.centre, point);
        let high = home.min_m + Vec3::splat(home.size_m);
        let offsets = self.stencil.offsets();
        let mut away = [Vec3::ZERO; Stencil::MAX];
        let mut which = [0; Stencil::MAX];
        let mut count = 0;
        for (i, offset) in offsets.iter().enumerate() {
            let at = point + Vec3::from(*offset) * STENCIL_M;
            site.around[i] = site.centre;
            if !(at.cmpge(home.min_m).all() && at.cmplt(high).all()) {
                away[count] = at;
                which[count] = i;
                count += 1;
            }
        }
        let mut cells = [Found::NONE; Stencil::MAX];
        self.lookup.find_many(&away[..count], &mut cells[..count]);
        for (cell, i) in cells[..count].iter().zip(which) {
            site.around[i] = *cell;
        }
        site.eikonal = cells[..count].iter().all(|cell| self.usable(*cell));
    }

    fn usable(&self, cell: Found) -> bool {
        cell.is_some()
            && self.nodes.corners(cell.node).iter().all(|row| (*row as usize) < self.rows)
    }
}
