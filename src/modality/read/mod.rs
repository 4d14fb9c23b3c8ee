//! Read-out: distance, gradient and occupancy at points, on the calling thread.

mod gather;
#[cfg(test)]
mod tests;

use glam::Vec3;

use self::gather::{Chain, Gather, NOTHING};
use super::decoder::{Activations, Gradient, POINTS_MULTIPLE};
use super::interpolation::Place;
use super::{Decoders, Row, RowSource, occupancy};
use crate::geometry::simd::{InstructionSet, LINE, Lines, prefetch};
use crate::octree::{Found, Lookup, NodeSource};

/// Points that are located, gathered and decoded together.
const TILE: usize = 64;

/// Where the answers go, each as long as the points, or empty where it is not wanted. Points that
/// lie in no voxel with rows get NaN.
#[derive(Default)]
pub struct Answers<'a> {
    /// Signed distance f, m.
    pub distance: &'a mut [f32],
    /// ∇f in world axes: the analytic derivative of what `distance` says, not normalised.
    pub gradient: &'a mut [Vec3],
    /// Probability that the point is occupied.
    pub occupancy: &'a mut [f32],
    /// The voxel that the answer comes from.
    pub voxels: &'a mut [Found],
}

/// Evaluates the fields at `points` (world metres).
pub fn evaluate<S: NodeSource + RowSource>(
    source: &S,
    decoders: &Decoders,
    points: &[Vec3],
    answers: Answers<'_>,
) {
    evaluate_with(InstructionSet::detect(), source, decoders, points, answers);
}

/// [`evaluate`] with a given instruction set, one of those that the machine runs.
pub(crate) fn evaluate_with<S: NodeSource + RowSource>(
    set: InstructionSet,
    source: &S,
    decoders: &Decoders,
    points: &[Vec3],
    answers: Answers<'_>,
) {
    let Answers { distance, gradient, occupancy, voxels } = answers;
    distance.fill(f32::NAN);
    gradient.fill(Vec3::NAN);
    occupancy.fill(f32::NAN);
    voxels.fill(Found::NONE);
    let Some(lookup) = Lookup::new(source) else { return };
    let mut reader = Reader {
        set,
        source,
        decoders,
        want_distance: !distance.is_empty(),
        want_gradient: !gradient.is_empty(),
        want_occupancy: !occupancy.is_empty(),
        tile: Tile::new(points.len().min(TILE)),
    };
    for (i, points) in points.chunks(TILE).enumerate() {
        reader.locate(&lookup, points);
        reader.run();
        let at = i * TILE;
        let tile = &reader.tile;
        for (slot, point) in tile.found.iter().enumerate() {
            let point = at + *point as usize;
            if reader.want_distance {
                distance[point] = tile.distances[slot];
            }
            if reader.want_gradient {
                gradient[point] = tile.gradients[slot];
            }
            if reader.want_occupancy {
                occupancy[point] = tile.occupancies[slot];
            }
            if !voxels.is_empty() {
                voxels[point] = tile.voxels[slot];
            }
        }
    }
}

/// A point whose voxel is known already.
#[derive(Debug, Clone, Copy)]
pub struct Sample {
    /// A voxel with rows.
    pub node: u32,
    pub place: Place,
}

/// The signed distance, m, and its gradient at samples; each slice is as long as `samples`, or empty
/// where it is not wanted.
pub fn evaluate_samples<S: NodeSource + RowSource>(
    source: &S,
    decoders: &Decoders,
    samples: &[Sample],
    distance: &mut [f32],
    gradient: &mut [Vec3],
) {
    let mut reader = Reader {
        set: InstructionSet::detect(),
        source,
        decoders,
        want_distance: !distance.is_empty(),
        want_gradient: !gradient.is_empty(),
        want_occupancy: false,
        tile: Tile::new(samples.len().min(TILE)),
    };
    for (i, samples) in samples.chunks(TILE).enumerate() {
        reader.take(samples);
        reader.run();
        let range = i * TILE..i * TILE + samples.len();
        if reader.want_distance {
            distance[range.clone()].copy_from_slice(&reader.tile.distances);
        }
        if reader.want_gradient {
            gradient[range].copy_from_slice(&reader.tile.gradients);
        }
    }
}

struct Reader<'a, S: RowSource> {
    set: InstructionSet,
    source: &'a S,
    decoders: &'a Decoders,
    want_distance: bool,
    want_gradient: bool,
    want_occupancy: bool,
    tile: Tile<'a>,
}

/// Working space of one tile. Columns up to `occupancies` have one entry a found point.
struct Tile<'a> {
    /// The points that lie in a voxel with rows, as indices into the tile's points.
    found: Vec<u8>,
    voxels: Vec<Found>,
    /// Of the corners; asked for when they are entered.
    rows: Vec<[&'a Row; 8]>,
    places: Vec<Place>,
    /// d_ga, then f.
    distances: Vec<f32>,
    /// ∇d_ga, then ∇f.
    gradients: Vec<Vec3>,
    occupancies: Vec<f32>,
    sdf: Packed,
    occupancy: Packed,
    /// ∂f/∂x, ∂f/∂y, ∂f/∂z of the residual feature, three lines a packed point.
    slopes: Lines,
    activations: Activations,
}

/// The points whose feature is not all zero; the others need no decoder.
struct Packed {
    /// Indices into the found points.
    slots: Vec<u8>,
    features: Lines,
    contexts: Lines,
    out: Lines,
    by_out: Lines,
    by_features: Lines,
    by_contexts: Lines,
}

impl Packed {
    fn new(points: usize) -> Self {
        let points = points.next_multiple_of(POINTS_MULTIPLE);
        Self {
            slots: Vec::with_capacity(points),
            features: Lines::zeros(points * LINE),
            contexts: Lines::zeros(points),
            out: Lines::zeros(points),
            by_out: Lines::zeros(points),
            by_features: Lines::zeros(points * LINE),
            by_contexts: Lines::zeros(points),
        }
    }

    /// Clears the padding; returns the padded number of points.
    fn pad(&mut self) -> usize {
        let (used, padded) = (self.slots.len(), self.slots.len().next_multiple_of(POINTS_MULTIPLE));
        self.features[used * LINE..padded * LINE].fill(0.0);
        self.contexts[used..padded].fill(0.0);
        padded
    }
}

impl<'a> Tile<'a> {
    fn clear_places(&mut self) {
        self.rows.clear();
        self.places.clear();
    }

    /// Adds a point, and asks for the rows around it.
    fn push<S: NodeSource + RowSource>(&mut self, source: &'a S, node: u32, place: Place) {
        let mut rows = [&NOTHING; 8];
        for (row, number) in rows.iter_mut().zip(source.corners(node)) {
            *row = source.row(*number);
            prefetch(*row);
        }
        self.rows.push(rows);
        self.places.push(place);
    }

    fn new(points: usize) -> Self {
        Self {
            found: Vec::with_capacity(points),
            voxels: Vec::with_capacity(points),
            rows: Vec::with_capacity(points),
            places: Vec::with_capacity(points),
            distances: Vec::with_capacity(points),
            gradients: Vec::with_capacity(points),
            occupancies: Vec::with_capacity(points),
            sdf: Packed::new(points),
            occupancy: Packed::new(points),
            slopes: Lines::zeros(3 * points * LINE),
            activations: Activations::default(),
        }
    }
}

impl<S: NodeSource + RowSource> Reader<'_, S> {
    /// Evaluates what [`Self::locate`] or [`Self::take`] left in the tile.
    fn run(&mut self) {
        let tile = &mut self.tile;
        tile.distances.clear();
        tile.gradients.clear();
        tile.occupancies.clear();
        tile.sdf.slots.clear();
        tile.occupancy.slots.clear();
        self.set.run(Gather {
            want_gradient: self.want_gradient,
            want_residual: self.want_distance || self.want_gradient,
            want_occupancy: self.want_occupancy,
            tile,
        });
        // The occupancy prior reads d_ga, which the residual then turns into f.
        if self.want_occupancy {
            self.add_occupancy();
        }
        if !self.tile.sdf.slots.is_empty() {
            self.add_residual();
        }
    }

    fn locate(&mut self, lookup: &Lookup<'_, S>, points: &[Vec3]) {
        let mut cells = [Found::NONE; TILE];
        let cells = &mut cells[..points.len()];
        lookup.find_many(points, cells);
        self.tile.found.clear();
        self.tile.voxels.clear();
        self.tile.clear_places();
        for (i, (cell, point)) in cells.iter().zip(points).enumerate() {
            if cell.is_some() {
                let voxel = lookup.located(*cell, *point);
                self.tile.found.push(i as u8);
                self.tile.voxels.push(*cell);
                let offset_m = (*point - voxel.min_m).to_array();
                self.tile.push(self.source, cell.node, Place { offset_m, size_m: voxel.size_m });
            }
        }
    }

    fn take(&mut self, samples: &[Sample]) {
        self.tile.clear_places();
        for sample in samples {
            self.tile.push(self.source, sample.node, sample.place);
        }
    }

    fn add_residual(&mut self) {
        let Tile { sdf: packed, slopes, distances, gradients, activations, .. } = &mut self.tile;
        let padded = packed.pad();
        let decoder = &self.decoders.sdf;
        let out = &mut packed.out[..padded];
        decoder.forward(self.set, &packed.features, &packed.contexts, activations, out);
        if self.want_gradient {
            packed.by_out[..padded].fill(1.0);
            let gradient = Gradient {
                features: &mut packed.by_features,
                contexts: &mut packed.by_contexts,
                weights: &mut [],
            };
            let inputs = (&packed.features[..], &packed.contexts[..]);
            let by_out = &packed.by_out[..padded];
            decoder.backward(self.set, inputs, by_out, activations, gradient);
            self.set.run(Chain { packed, slopes, distances, gradients });
        }
        for (i, slot) in packed.slots.iter().enumerate() {
            distances[*slot as usize] += packed.out[i];
        }
    }

    fn add_occupancy(&mut self) {
        let Tile { occupancy: packed, distances, occupancies, activations, .. } = &mut self.tile;
        let padded = packed.pad();
        let out = &mut packed.out[..padded];
        let decoder = &self.decoders.occupancy;
        decoder.forward(self.set, &packed.features, &packed.contexts, activations, out);
        occupancies.extend(distances.iter().map(|d| occupancy::prior_logit(*d)));
        for (i, slot) in packed.slots.iter().enumerate() {
            occupancies[*slot as usize] += packed.out[i];
        }
        for value in occupancies.iter_mut() {
            *value = occupancy::probability(*value);
        }
    }
}
