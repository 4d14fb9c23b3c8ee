//! The relief of surfaces: signed distances at the vertices of the band of colour, averaged over the
//! frames that measured them and truncated (Curless and Levoy 1996), finer than the leaves that hold
//! the map's own. Images are drawn from it where it is known.
//!
//! Edges and thin things are narrower than surfels and voxels of level 0: a disc reaches past the edge
//! that it stands at. A frame that sees past an edge says of each vertex beside it how far it is from
//! the edge ([`Edges`]); a mere "nothing within the truncation" would wear edges away.

use glam::{Mat3, Vec3};
use rayon::prelude::*;
use rustc_hash::FxHashMap;

use super::edges::Edges;
use crate::frame::Frame;
use crate::geometry::floor;
use crate::octree::{Band, BandScale, Cell, pack};

/// Bands with a wider spacing have no relief, m: the map's own distances say more.
const WIDEST_M: f32 = 0.03;
/// Distances are told up to so many spacings from a surface.
const TRUNCATION: f32 = 2.0;
/// A vertex so many truncations behind a return along its ray says nothing.
const BEHIND: f32 = 2.0;
/// A return so many truncations behind a vertex has no part in its distance, whatever its slope.
const BEFORE: f32 = 4.0;
/// The weight of the past is bounded by this many frames: what has changed shows within seconds.
const MAX_WEIGHT: f32 = 64.0;
/// Where a pixel has no plane its distance along the ray counts so much.
const NO_PLANE_WEIGHT: f32 = 0.25;
/// A distance that is nearly truncated behind a surface counts so much at least.
const LEAST_WEIGHT: f32 = 0.05;
/// A step of a stored weight.
const WEIGHT_STEP: f32 = 1.0 / 256.0;
/// A step of a stored distance, m.
pub const DISTANCE_STEP_M: f32 = 4e-6;
/// Who reads the relief is told of a distance that moved by so much, m.
const TOLD_M: f32 = 2e-4;

/// What frames say of the distance at a vertex.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct SeenDistance {
    /// In [`DISTANCE_STEP_M`].
    distance: i16,
    /// In 1/256 frames; 0 where no frame said anything.
    weight: u16,
}

impl SeenDistance {
    /// The distance in [`DISTANCE_STEP_M`], where it is known.
    pub fn distance(self) -> Option<i16> {
        (self.weight > 0).then_some(self.distance)
    }

    /// Takes a measurement in; whether that is worth telling.
    fn take(&mut self, distance_m: f32, weight: f32) -> bool {
        let past = f32::from(self.weight) * WEIGHT_STEP;
        let total = past + weight;
        let old = f32::from(self.distance) * DISTANCE_STEP_M;
        let by = (distance_m - old) * (weight / total);
        self.distance = ((old + by) / DISTANCE_STEP_M).round() as i16;
        self.weight = (total.min(MAX_WEIGHT) / WEIGHT_STEP).round().max(1.0) as u16;
        past == 0.0 || by.abs() > TOLD_M
    }
}

/// The relief of a band.
#[derive(Debug)]
pub(super) struct Relief {
    /// log2 of the cells along an edge of a brick of evidence.
    log2_brick: u32,
    seen: Vec<SeenDistance>,
    /// The blocks of each brick of cells, by the brick's key; of the first `indexed` blocks.
    bricks: FxHashMap<u64, Vec<u32>>,
    indexed: usize,
    /// Of the frame in hand.
    edges: Edges,
}

impl Relief {
    /// Nothing seen yet.
    pub(super) fn new(log2_brick: u32) -> Self {
        Self {
            log2_brick,
            seen: Vec::new(),
            bricks: FxHashMap::default(),
            indexed: 0,
            edges: Edges::default(),
        }
    }

    /// What a block of `scale` takes, bytes: its vertices, and its place in the index.
    pub(super) fn block_bytes(scale: BandScale) -> usize {
        scale.vertices() * size_of::<SeenDistance>() + 8
    }

    /// Whether a band of this spacing has a relief.
    pub(super) fn suits(scale: BandScale) -> bool {
        scale.spacing_m() <= WIDEST_M
    }

    /// How far from a surface distances are told, m.
    pub(super) fn truncation_m(scale: BandScale) -> f32 {
        TRUNCATION * scale.spacing_m()
    }

    /// By vertex of the band; vertices of blocks that are new in a frame may be beyond the end.
    pub(super) fn seen(&self) -> &[SeenDistance] {
        &self.seen
    }

    /// Looks at a frame that [`Self::integrate`] takes in next.
    pub(super) fn look(&mut self, frame: &Frame) {
        self.edges.find(&frame.depth);
    }

    /// Takes in what a frame measured at the vertices of the cells in these bricks of
    /// evidence; returns the blocks that changed.
    pub(super) fn integrate(
        &mut self,
        frame: &Frame,
        band: &Band,
        bricks: impl Iterator<Item = Cell>,
        pool: &rayon::ThreadPool,
    ) -> Vec<u32> {
        self.grow(band);
        for (block, cell) in band.cells().iter().enumerate().skip(self.indexed) {
            self.bricks
                .entry(pack(cell.map(|c| c >> self.log2_brick)))
                .or_default()
                .push(block as u32);
        }
        self.indexed = band.blocks();
        let of_brick = |brick| self.bricks.get(&pack(brick)).into_iter().flatten().copied();
        let mut blocks: Vec<u32> = bricks.flat_map(of_brick).collect();
        blocks.sort_unstable();
        blocks.dedup();
        let lens = Lens::new(frame, &self.edges, band.scale);
        let vertices = band.scale.vertices();
        let (mut rest, mut next) = (&mut self.seen[..], 0);
        let mut parts = Vec::with_capacity(blocks.len());
        for block in blocks {
            let skipped = (block as usize - next) * vertices;
            let (part, after) = std::mem::take(&mut rest)[skipped..].split_at_mut(vertices);
            parts.push((block, part));
            (rest, next) = (after, block as usize + 1);
        }
        let measure = |(block, part): (u32, &mut [SeenDistance])| {
            lens.measure_block(band.cells()[block as usize], part).then_some(block)
        };
        pool.install(|| parts.into_par_iter().with_min_len(16).filter_map(measure).collect())
    }

    /// Makes room for the blocks that are new.
    pub(super) fn grow(&mut self, band: &Band) {
        self.seen.resize(band.rows(), SeenDistance::default());
    }

    /// Forgets a block.
    pub(super) fn forget(&mut self, band: &Band, block: u32) {
        let rows = band.block_rows(block);
        if let Some(seen) = self.seen.get_mut(rows.start as usize..rows.end as usize) {
            seen.fill(SeenDistance::default());
        }
    }

    /// Takes up stored distances, none or one for each vertex of a band; false if there are others.
    pub(super) fn fill(&mut self, seen: Vec<SeenDistance>, band: &Band) -> bool {
        let fits = seen.is_empty() || seen.len() == band.rows();
        self.seen = seen;
        fits
    }
}

/// What a frame measures at places.
struct Lens<'a> {
    frame: &'a Frame,
    edges: &'a Edges,
    scale: BandScale,
    truncation_m: f32,
    camera_from_world: Mat3,
    offset: Vec3,
}

impl<'a> Lens<'a> {
    fn new(frame: &'a Frame, edges: &'a Edges, scale: BandScale) -> Self {
        let inverse = frame.world_from_camera.inverse();
        Self {
            frame,
            edges,
            scale,
            truncation_m: Relief::truncation_m(scale),
            camera_from_world: inverse.rotation_f32(),
            offset: inverse.position_f32(),
        }
    }

    /// Measures the vertices of a block; whether anything is worth telling.
    fn measure_block(&self, cell: Cell, seen: &mut [SeenDistance]) -> bool {
        let low = Vec3::from(cell.map(|c| c as f32)) * self.scale.cell_m;
        let first = self.camera_from_world * low + self.offset;
        let axes = self.camera_from_world * self.scale.spacing_m();
        if !self.sees(first + (axes * Vec3::splat(0.5 * self.scale.side() as f32))) {
            return false;
        }
        let (log2, mask) = (self.scale.log2_side, self.scale.side() - 1);
        let mut is_worth = false;
        for (i, seen) in seen.iter_mut().enumerate() {
            let at = [i & mask, i >> log2 & mask, i >> (2 * log2)].map(|c| c as f32);
            let place = first + axes * Vec3::from(at);
            if let Some((distance, weight)) = self.measure(place) {
                is_worth |= seen.take(distance, weight);
            }
        }
        is_worth
    }

    /// Whether a cell around a place in camera axes may be in sight.
    fn sees(&self, centre: Vec3) -> bool {
        let reach = 0.87 * self.scale.cell_m;
        let k = &self.frame.intrinsics;
        let near = (centre.z + reach).max(0.0);
        let beside = |x: f32, f: f64, low: f64, high: f64| {
            // The planes through the eye and the image's borders.
            let slack = 1.5 * reach;
            (x + slack) * f as f32 >= -low as f32 * near
                && (x - slack) * f as f32 <= high as f32 * near
        };
        near > 0.0
            && beside(centre.x, k.fx, k.cx + 1.0, f64::from(k.width) - k.cx)
            && beside(centre.y, k.fy, k.cy + 1.0, f64::from(k.height) - k.cy)
    }

    /// The distance at a place in camera axes, m, and how much it counts; `None` where the frame says
    /// nothing.
    fn measure(&self, place: Vec3) -> Option<(f32, f32)> {
        let (frame, truncation) = (self.frame, self.truncation_m);
        let k = &frame.intrinsics;
        let (u, v) = k.project(place)?;
        let (u, v) = (floor(u + 0.5), floor(v + 0.5));
        if u < 1 || v < 1 || u > k.width as i32 - 2 || v > k.height as i32 - 2 {
            return None;
        }
        let (u, v) = (u as u32, v as u32);
        let z = frame.depth.at(u, v);
        let ahead = z - place.z;
        if z <= 0.0 || ahead < -BEHIND * truncation {
            return None;
        }
        let (mut distance, mut weight) = if ahead >= BEFORE * truncation {
            (truncation, 1.0)
        } else if let Some(normal) = self.normal(u, v) {
            (normal.dot(place - k.direction(u as f32, v as f32) * z), 1.0)
        } else {
            (ahead, NO_PLANE_WEIGHT)
        };
        if let Some((pixels, beyond)) = self.edges.at(u, v) {
            let beside = pixels * place.z / k.fx as f32;
            if beyond > z && distance < 0.0 {
                // Within something, near its edge.
                (distance, weight) = (distance.max(-beside), 1.0);
            } else if beyond < z && distance > 0.0 && place.z < beyond + BEHIND * truncation {
                // Beside something that is nearer to the camera.
                let before = (beyond - place.z).max(0.0);
                (distance, weight) = (distance.min(beside.hypot(before)), 1.0);
            }
        }
        if distance <= -truncation {
            return None;
        }
        let behind = (truncation + distance) / (truncation - self.scale.spacing_m());
        Some((distance.min(truncation), weight * behind.clamp(LEAST_WEIGHT, 1.0)))
    }

    /// Of the plane through a pixel and its neighbours, towards the camera, in its axes; `None` at a
    /// jump of the depth.
    fn normal(&self, u: u32, v: u32) -> Option<Vec3> {
        let (depth, k) = (&self.frame.depth, &self.frame.intrinsics);
        if depth.is_edge(u, v) {
            return None;
        }
        let point = |u: u32, v: u32| {
            let z = depth.at(u, v);
            (z > 0.0).then(|| k.direction(u as f32, v as f32) * z)
        };
        let along_u = point(u + 1, v)? - point(u - 1, v)?;
        let along_v = point(u, v + 1)? - point(u, v - 1)?;
        let normal = along_v.cross(along_u).try_normalize()?;
        let is_away = normal.dot(k.direction(u as f32, v as f32)) > 0.0;
        Some(if is_away { -normal } else { normal })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::test_frame::frame;

    const SCALE: BandScale = BandScale { cell_m: 0.1, log2_side: 2 };
    const POST_M: f32 = 1.5;
    const WALL_M: f32 = 2.5;
    const HALF_M: f32 = 0.06;

    /// A post, 12 cm wide, before a wall; the camera stands at (1, 2, 3) and looks along x.
    fn post() -> Frame {
        let focal = 400.0;
        let is_post = |u: u32| ((u as f32 - 79.5) / focal as f32 * POST_M).abs() < HALF_M;
        frame(focal, |u, _| if is_post(u) { POST_M } else { WALL_M })
    }

    /// Blocks around the post.
    fn band() -> Band {
        let mut band = Band::new(SCALE);
        band.limit(1000);
        for x in 23..28 {
            for y in 16..24 {
                (28..32).for_each(|z| assert!(band.insert([x, y, z]).is_some()));
            }
        }
        band
    }

    fn see(relief: &mut Relief, band: &Band, frame: &Frame) -> Vec<u32> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build().expect("threads");
        let bricks = [[2, 2, 3], [3, 2, 3], [2, 1, 3], [3, 1, 3], [2, 2, 4], [3, 2, 4]];
        relief.look(frame);
        relief.integrate(frame, band, bricks.into_iter(), &pool)
    }

    fn distance_m(relief: &Relief, row: u32) -> Option<f32> {
        relief.seen()[row as usize].distance().map(|steps| f32::from(steps) * DISTANCE_STEP_M)
    }

    /// The distance to the post, as if it reached back to the wall.
    fn truth(at: Vec3) -> f32 {
        let (beside, before) = ((at.y - 2.0).abs() - HALF_M, 1.0 + POST_M - at.x);
        beside.max(0.0).hypot(before.max(0.0)) + beside.max(before).min(0.0)
    }

    /// Half a voxel wide, and a vertex beside it is as far away as it is.
    #[test]
    fn a_post_is_as_wide_as_it_is_seen() {
        let (mut relief, band) = (Relief::new(3), band());
        let changed = see(&mut relief, &band, &post());
        assert!(changed.len() > 30, "{} blocks", changed.len());
        let (mut beside, mut inside) = (0, 0);
        for row in 0..band.rows() as u32 {
            let at = band.place_of(row);
            let Some(found) = distance_m(&relief, row).filter(|_| at.x < 1.0 + POST_M + 0.08)
            else {
                continue;
            };
            let expected = truth(at).clamp(-0.05, 0.05);
            assert!((found - expected).abs() < 6e-3, "{at}: {found} for {expected}");
            beside += u32::from(expected > 0.0 && expected < 0.04 && at.x > 1.0 + POST_M);
            inside += u32::from(expected < 0.0);
        }
        assert!(beside > 20 && inside > 20, "{beside} beside it, {inside} inside");
        let behind = (0..band.rows() as u32).filter(|row| {
            let at = band.place_of(*row);
            at.x > 1.0 + POST_M + 0.11 && (at.y - 2.0).abs() < HALF_M - 0.02
        });
        for row in behind {
            assert_eq!(distance_m(&relief, row), None, "nobody saw {}", band.place_of(row));
        }
    }

    #[test]
    fn a_post_that_is_gone_is_forgotten_in_time_or_at_once() {
        let (mut relief, band) = (Relief::new(3), band());
        let at_post = (0..band.rows() as u32)
            .find(|row| band.place_of(*row).abs_diff_eq(Vec3::new(2.525, 2.0, 3.0), 1e-4))
            .expect("a vertex just inside");
        for _ in 0..5 {
            see(&mut relief, &band, &post());
        }
        assert!(distance_m(&relief, at_post).is_some_and(|d| d < -0.02));
        let again = see(&mut relief, &band, &post());
        assert!(again.is_empty(), "what has not moved is not told: {again:?}");
        for _ in 0..20 {
            see(&mut relief, &band, &frame(400.0, |_, _| WALL_M));
        }
        assert!(distance_m(&relief, at_post).is_some_and(|d| d > 0.02));
        relief.forget(&band, at_post >> (3 * SCALE.log2_side));
        assert_eq!(distance_m(&relief, at_post), None);
    }

    #[test]
    fn an_average_keeps_small_changes_and_its_bounds() {
        let mut seen = SeenDistance::default();
        assert!(seen.take(0.05, 1.0));
        for _ in 0..1000 {
            seen.take(-0.05, 1.0);
        }
        let found = seen.distance().map(f32::from).expect("seen") * DISTANCE_STEP_M;
        assert!((found + 0.05).abs() < 1e-3, "{found}");
        seen = SeenDistance::default();
        seen.take(0.01, 1e-6);
        assert!(seen.distance().is_some(), "what was said is known, however little it counts");
    }
}
