//! Read-out: distance, gradient and occupancy at points, on the calling thread.

mod gather;
mod grid;
#[cfg(test)]
mod tests;

use glam::Vec3;

use self::gather::{Chain, Gather, NOTHING};
use super::decoder::{Activations, Gradient, POINTS_MULTIPLE};
use super::interpolation::{Corners, Place};
use super::{Decoders, Row, RowSource, occupancy};
use crate::geometry::simd::{InstructionSet, LINE, Lines, prefetch};
use crate::octree::{Found, Lookup, NodeSource};

pub use grid::evaluate_grid;

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
    let mut answers = answers;
    answers.clear();
    let Some(lookup) = Lookup::new(source) else { return };
    let mut reader = Reader::new(set, source, decoders, &answers, points.len());
    for (i, points) in points.chunks(TILE).enumerate() {
        reader.locate(&lookup, points, i * TILE);
        reader.run();
        reader.tile.hand_over(&mut answers);
    }
}

impl Answers<'_> {
    /// Nothing is known yet.
    fn clear(&mut self) {
        self.distance.fill(f32::NAN);
        self.gradient.fill(Vec3::NAN);
        self.occupancy.fill(f32::NAN);
        self.voxels.fill(Found::NONE);
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
    let answers = Answers { distance, gradient, ..Answers::default() };
    let set = InstructionSet::detect();
    let mut reader = Reader::new(set, source, decoders, &answers, samples.len());
    let Answers { distance, gradient, .. } = answers;
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

/// Working space of one tile. Columns from `places` to `occupancies` have one entry a found point.
struct Tile<'a> {
    /// The points that lie in a voxel with rows, by their places among all.
    found: Vec<u32>,
    voxels: Vec<Found>,
    groups: Vec<Group<'a>>,
    places: Vec<Place>,
    weights: Vec<Corners>,
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

/// Points of a tile, one behind the other, that lie in the same voxel.
#[derive(Clone, Copy)]
struct Group<'a> {
    /// Of the corners; asked for when they are entered.
    rows: [&'a Row; 8],
    points: u8,
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
        self.found.clear();
        self.voxels.clear();
        self.groups.clear();
        self.places.clear();
    }

    /// Begins a group, and asks for the rows around it.
    fn begin<S: NodeSource + RowSource>(&mut self, source: &'a S, node: u32) {
        let mut rows = [&NOTHING; 8];
        for (row, number) in rows.iter_mut().zip(source.corners(node)) {
            *row = source.row(*number);
            prefetch(*row);
        }
        self.groups.push(Group { rows, points: 0 });
    }

    /// Adds a point to the last group.
    #[inline]
    fn push(&mut self, place: Place) {
        if let Some(group) = self.groups.last_mut() {
            group.points += 1;
            self.places.push(place);
        }
    }

    /// Answers go to their points.
    fn hand_over(&self, answers: &mut Answers<'_>) {
        fn scatter<T: Copy>(found: &[u32], values: &[T], out: &mut [T]) {
            if !out.is_empty() {
                for (point, value) in found.iter().zip(values) {
                    out[*point as usize] = *value;
                }
            }
        }
        scatter(&self.found, &self.distances, answers.distance);
        scatter(&self.found, &self.gradients, answers.gradient);
        scatter(&self.found, &self.occupancies, answers.occupancy);
        scatter(&self.found, &self.voxels, answers.voxels);
    }

    fn new(points: usize) -> Self {
        Self {
            found: Vec::with_capacity(points),
            voxels: Vec::with_capacity(points),
            groups: Vec::with_capacity(points),
            places: Vec::with_capacity(points),
            weights: Vec::with_capacity(points),
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

impl<'a, S: NodeSource + RowSource> Reader<'a, S> {
    /// Of what `answers` have room for.
    fn new(
        set: InstructionSet,
        source: &'a S,
        decoders: &'a Decoders,
        answers: &Answers<'_>,
        points: usize,
    ) -> Self {
        Self {
            set,
            source,
            decoders,
            want_distance: !answers.distance.is_empty(),
            want_gradient: !answers.gradient.is_empty(),
            want_occupancy: !answers.occupancy.is_empty(),
            tile: Tile::new(points.min(TILE)),
        }
    }

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

    /// Takes points in, of which the first has the place `first` among all.
    fn locate(&mut self, lookup: &Lookup<'_, S>, points: &[Vec3], first: usize) {
        let mut cells = [Found::NONE; TILE];
        let cells = &mut cells[..points.len()];
        lookup.find_many(points, cells);
        self.tile.clear_places();
        let mut last = Found::NONE;
        for (i, (cell, point)) in cells.iter().zip(points).enumerate() {
            if cell.is_some() {
                let voxel = lookup.located(*cell, *point);
                self.tile.found.push((first + i) as u32);
                self.tile.voxels.push(*cell);
                if *cell != last {
                    self.tile.begin(self.source, cell.node);
                    last = *cell;
                }
                let offset_m = (*point - voxel.min_m).to_array();
                self.tile.push(Place { offset_m, size_m: voxel.size_m });
            }
        }
    }

    fn take(&mut self, samples: &[Sample]) {
        self.tile.clear_places();
        for sample in samples {
            self.tile.begin(self.source, sample.node);
            self.tile.push(sample.place);
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
