//! Read-out: distance, gradient and occupancy at points, on the calling thread.

use glam::Vec3;

use super::decoder::{Activations, Gradient, POINTS_MULTIPLE};
use super::interpolation::{Place, by_column};
use super::{Decoders, OCCUPANCY_FEATURES, RowSource, SDF_FEATURES, occupancy, sdf};
use crate::geometry::simd::{InstructionSet, Kernel, LINE, Lanes, Lines};
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
    let Answers { distance, gradient, occupancy } = answers;
    distance.fill(f32::NAN);
    gradient.fill(Vec3::NAN);
    occupancy.fill(f32::NAN);
    let Some(lookup) = Lookup::new(source) else { return };
    let mut reader = Reader {
        set,
        source,
        lookup,
        decoders,
        want_distance: !distance.is_empty(),
        want_gradient: !gradient.is_empty(),
        want_occupancy: !occupancy.is_empty(),
        tile: Tile::new(points.len().min(TILE)),
    };
    for (i, points) in points.chunks(TILE).enumerate() {
        reader.run(points);
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
        }
    }
}

struct Reader<'a, S> {
    set: InstructionSet,
    source: &'a S,
    lookup: Lookup<'a, S>,
    decoders: &'a Decoders,
    want_distance: bool,
    want_gradient: bool,
    want_occupancy: bool,
    tile: Tile,
}

/// Working space of one tile. Columns up to `occupancies` have one entry a found point.
struct Tile {
    /// The points that lie in a voxel with rows, as indices into the tile's points.
    found: Vec<u8>,
    rows: Vec<[u32; 8]>,
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

impl Tile {
    fn new(points: usize) -> Self {
        Self {
            found: Vec::with_capacity(points),
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
    fn run(&mut self, points: &[Vec3]) {
        self.locate(points);
        let tile = &mut self.tile;
        tile.distances.clear();
        tile.gradients.clear();
        tile.occupancies.clear();
        tile.sdf.slots.clear();
        tile.occupancy.slots.clear();
        self.set.run(Gather {
            source: self.source,
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

    fn locate(&mut self, points: &[Vec3]) {
        let mut cells = [Found::NONE; TILE];
        let cells = &mut cells[..points.len()];
        self.lookup.find_many(points, cells);
        let tile = &mut self.tile;
        tile.found.clear();
        tile.rows.clear();
        tile.places.clear();
        for (i, (cell, point)) in cells.iter().zip(points).enumerate() {
            if cell.is_some() {
                let voxel = self.lookup.located(*cell, *point);
                tile.found.push(i as u8);
                tile.rows.push(*self.source.corners(cell.node));
                tile.places.push(Place {
                    offset_m: (*point - voxel.min_m).to_array(),
                    size_m: voxel.size_m,
                });
            }
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

/// Interpolates the explicit part and packs the features that are not zero.
struct Gather<'a, S> {
    source: &'a S,
    want_gradient: bool,
    want_residual: bool,
    want_occupancy: bool,
    tile: &'a mut Tile,
}

impl<S: RowSource> Kernel for Gather<'_, S> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        let Self { source, tile, .. } = self;
        for (slot, (rows, place)) in tile.rows.iter().zip(&tile.places).enumerate() {
            let explicit = by_column(rows.map(|row| *source.explicit(row)));
            let weights = place.weights();
            let distance = if self.want_gradient {
                let (distance, gradient) = place.distance_and_gradient(&explicit);
                tile.gradients.push(Vec3::from(gradient));
                distance
            } else {
                place.distance(&weights, &explicit)
            };
            tile.distances.push(distance);
            let context = sdf::context(distance);
            if self.want_residual {
                let features = rows.map(|row| source.sdf_feature(row));
                if any(&features) {
                    let at = tile.sdf.slots.len();
                    tile.sdf.slots.push(slot as u8);
                    tile.sdf.contexts[at] = context;
                    interpolate::<L>(&features, &weights, &mut tile.sdf.features, at);
                    if self.want_gradient {
                        differentiate::<L>(&features, place, &mut tile.slopes, at);
                    }
                }
            }
            if self.want_occupancy {
                let features = rows.map(|row| source.occupancy_feature(row));
                if any(&features) {
                    let at = tile.occupancy.slots.len();
                    tile.occupancy.slots.push(slot as u8);
                    tile.occupancy.contexts[at] = context;
                    let line = &mut tile.occupancy.features[at * LINE..][..OCCUPANCY_FEATURES];
                    for (i, out) in line.iter_mut().enumerate() {
                        let terms = features.iter().zip(&weights);
                        *out = terms.map(|(feature, weight)| weight * feature[i]).sum();
                    }
                }
            }
        }
    }
}

/// Whether any number has a bit set.
#[inline(always)]
fn any<const N: usize>(features: &[&[f32; N]; 8]) -> bool {
    let mut bits = [0u32; N];
    for feature in features {
        for (bits, x) in bits.iter_mut().zip(*feature) {
            *bits |= x.to_bits();
        }
    }
    bits.iter().fold(0, |all, bits| all | bits) != 0
}

/// Line `at` of `out` becomes Σ w_k f_k.
#[inline(always)]
fn interpolate<L: Lanes>(
    features: &[&[f32; SDF_FEATURES]; 8],
    weights: &[f32; 8],
    out: &mut [f32],
    at: usize,
) {
    for lane in (0..SDF_FEATURES).step_by(L::N) {
        let mut sum = L::splat(0.0);
        for (feature, weight) in features.iter().zip(weights) {
            sum = L::splat(*weight).mul_add(L::load(*feature, lane), sum);
        }
        sum.store(out, at * LINE + lane);
    }
}

/// Lines `3 at`, `3 at + 1`, `3 at + 2` of `out` become the derivatives of Σ w_k f_k by x, y, z.
#[inline(always)]
fn differentiate<L: Lanes>(
    features: &[&[f32; SDF_FEATURES]; 8],
    place: &Place,
    out: &mut [f32],
    at: usize,
) {
    let scale = 1.0 / place.size_m;
    let t = place.offset_m.map(|offset| L::splat(offset * scale));
    let scale = L::splat(scale);
    let mix = |low: L, high: L, t: L| t.mul_add(high - low, low);
    for lane in (0..SDF_FEATURES).step_by(L::N) {
        let f = features.map(|feature| L::load(feature, lane));
        // Along x on the four edges, then along y on the two sides, then along z.
        let dx = [f[1] - f[0], f[3] - f[2], f[5] - f[4], f[7] - f[6]];
        let x = [0, 1, 2, 3].map(|edge| t[0].mul_add(dx[edge], f[2 * edge]));
        let dy = [x[1] - x[0], x[3] - x[2]];
        let y = [t[1].mul_add(dy[0], x[0]), t[1].mul_add(dy[1], x[2])];
        let by_x = mix(mix(dx[0], dx[1], t[1]), mix(dx[2], dx[3], t[1]), t[2]);
        let by_y = mix(dy[0], dy[1], t[2]);
        let line = 3 * at * LINE + lane;
        (by_x * scale).store(out, line);
        (by_y * scale).store(out, line + LINE);
        ((y[1] - y[0]) * scale).store(out, line + 2 * LINE);
    }
}

/// ∇f = ∇d_ga (1 + ∂D/∂c ∂c/∂d_ga) + ∂D/∂f · ∂f/∂x, from ∇d_ga in place.
struct Chain<'a> {
    packed: &'a Packed,
    slopes: &'a [f32],
    distances: &'a [f32],
    gradients: &'a mut [Vec3],
}

impl Kernel for Chain<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes>(self) {
        for (i, slot) in self.packed.slots.iter().enumerate() {
            let slot = *slot as usize;
            let mut sums = [L::splat(0.0); 3];
            for lane in (0..LINE).step_by(L::N) {
                let by = L::load(&self.packed.by_features, i * LINE + lane);
                for (axis, sum) in sums.iter_mut().enumerate() {
                    let slope = L::load(self.slopes, (3 * i + axis) * LINE + lane);
                    *sum = by.mul_add(slope, *sum);
                }
            }
            let by_context = self.packed.by_contexts[i] * sdf::context_slope(self.distances[slot]);
            let through_features = Vec3::new(sums[0].sum(), sums[1].sum(), sums[2].sum());
            self.gradients[slot] += self.gradients[slot] * by_context + through_features;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::random::{pcg4d, unit};
    use crate::modality::test_tree::Tree;

    fn random(stream: u32, i: usize) -> f32 {
        2.0 * unit(pcg4d([21, stream, 0, i as u32])[0]) - 1.0
    }

    fn decoders(hidden: &[u32]) -> Decoders {
        Decoders {
            sdf: sdf::decoder(hidden, 4).expect("valid widths"),
            occupancy: occupancy::decoder(4).expect("valid widths"),
        }
    }

    /// 0.8 m in 0.1 m voxels, one octant coarser; a curved prior, features on every second row.
    fn tree(features: bool) -> Tree {
        let sphere = |at: Vec3| {
            let g = at.normalize_or(Vec3::X);
            [at.length() - 0.3, g.x, g.y, g.z]
        };
        let split = |min: Vec3, size: f32| size > 0.4 || min.min_element() < 0.0;
        let mut tree = Tree::new(3, 0.1, split, sphere);
        if features {
            for row in (0..tree.rows()).step_by(2) {
                tree.sdf_features[row].0 = std::array::from_fn(|j| 0.3 * random(1, row * 16 + j));
                tree.occupancy_features[row] = std::array::from_fn(|j| random(2, row * 8 + j));
            }
        }
        tree
    }

    fn points(count: usize) -> Vec<Vec3> {
        (0..count).map(|i| Vec3::new(random(5, i), random(6, i), random(7, i)) * 0.39).collect()
    }

    type Columns = (Vec<f32>, Vec<Vec3>, Vec<f32>);

    fn read(set: InstructionSet, tree: &Tree, decoders: &Decoders, points: &[Vec3]) -> Columns {
        let n = points.len();
        let mut columns = (vec![0.0; n], vec![Vec3::ZERO; n], vec![0.0; n]);
        let answers = Answers {
            distance: &mut columns.0,
            gradient: &mut columns.1,
            occupancy: &mut columns.2,
        };
        evaluate_with(set, tree, decoders, points, answers);
        columns
    }

    #[test]
    fn without_features_the_answer_is_exactly_the_prior() {
        let (tree, points) = (tree(false), points(300));
        for set in InstructionSet::available() {
            let (distance, gradient, occupancy) = read(set, &tree, &decoders(&[32]), &points);
            let lookup = Lookup::new(&tree).expect("a tree");
            for (i, point) in points.iter().enumerate() {
                let cell = lookup.find(*point);
                let voxel = lookup.located(cell, *point);
                let offset_m = (*point - voxel.min_m).to_array();
                let place = Place { offset_m, size_m: voxel.size_m };
                let rows = tree.corners(cell.node).map(|row| tree.explicit[row as usize]);
                let (d, g) = place.distance_and_gradient(&by_column(rows));
                assert!((distance[i] - d).abs() < 1e-6);
                assert!((gradient[i] - Vec3::from(g)).length() < 1e-5);
                let p = occupancy::probability(occupancy::prior_logit(d));
                assert!((occupancy[i] - p).abs() < 1e-5);
            }
        }
    }

    #[test]
    fn the_gradient_is_the_central_difference_of_the_distance() {
        let tree = tree(true);
        for hidden in [&[32][..], &[64, 64]] {
            let decoders = decoders(hidden);
            for set in InstructionSet::available() {
                let points = points(200);
                let (distance, gradient, _) = read(set, &tree, &decoders, &points);
                let step = 5e-4;
                let mut kinks = 0;
                let mut outliers = 0;
                for axis in Vec3::AXES {
                    let moved =
                        |by: f32| -> Vec<Vec3> { points.iter().map(|p| *p + axis * by).collect() };
                    let low = read(set, &tree, &decoders, &moved(-step)).0;
                    let high = read(set, &tree, &decoders, &moved(step)).0;
                    for i in 0..points.len() {
                        let (below, above) = (distance[i] - low[i], high[i] - distance[i]);
                        // A relu flips, or a voxel ends, between the two points.
                        if (above - below).abs() > 1e-6 + 4e-3 * above.abs() {
                            kinks += 1;
                            continue;
                        }
                        let expected = (high[i] - low[i]) / (2.0 * step);
                        let error = (gradient[i].dot(axis) - expected).abs();
                        assert!(error < 0.05, "{set:?}: off by {error}");
                        // Two relus that flip on both sides hide from the halves.
                        outliers += usize::from(error > 4e-3);
                    }
                }
                assert!(kinks < 200, "{kinks} of 600 steps crossed a kink");
                assert!(outliers < 6, "{outliers} of 600 gradients are off");
            }
        }
    }

    #[test]
    fn instruction_sets_and_batch_sizes_agree() {
        let (tree, points) = (tree(true), points(777));
        let decoders = decoders(&[64, 64]);
        let expected = read(InstructionSet::Portable, &tree, &decoders, &points);
        for set in InstructionSet::available() {
            let found = read(set, &tree, &decoders, &points);
            for i in 0..points.len() {
                assert!((found.0[i] - expected.0[i]).abs() < 1e-5);
                assert!((found.2[i] - expected.2[i]).abs() < 1e-4);
            }
            let flips = (0..points.len())
                .filter(|i| (found.1[*i] - expected.1[*i]).length() > 1e-3)
                .count();
            assert!(flips <= 2, "{flips} gradients differ");
            for (i, point) in points.iter().enumerate().step_by(50) {
                let one = read(set, &tree, &decoders, &[*point]);
                assert_eq!((one.0[0], one.1[0], one.2[0]), (found.0[i], found.1[i], found.2[i]));
            }
        }
    }

    #[test]
    fn points_outside_are_nan_and_columns_may_be_absent() {
        let tree = tree(true);
        let points = [Vec3::splat(5.0), Vec3::ZERO, Vec3::NAN, Vec3::new(0.0, f32::INFINITY, 0.0)];
        let set = InstructionSet::detect();
        let (distance, gradient, occupancy) = read(set, &tree, &decoders(&[32]), &points);
        for i in [0, 2, 3] {
            assert!(distance[i].is_nan() && gradient[i].is_nan() && occupancy[i].is_nan());
        }
        assert!(distance[1].is_finite() && gradient[1].is_finite() && occupancy[1].is_finite());
        let mut alone = [0.0; 4];
        let answers = Answers { occupancy: &mut alone, ..Answers::default() };
        evaluate(&tree, &decoders(&[32]), &points, answers);
        assert_eq!(alone[1], occupancy[1], "the same without the other columns");
    }
}
