//! The colour of surfaces in closed form: every vertex of a fine band holds an estimate that each
//! frame brings closer to what it saw around the vertex.
//!
//! A vertex begins with the running average of the pixels around it, each with its trilinear weight
//! (algorithms.md §14). Once it has had about one pixel, it takes the same steps of 1/n towards what
//! would make the interpolated colour at the pixel right: recursive least squares with a diagonal
//! gain, at the cost of the average. An average is a blurred image, this is not: novel views of an
//! office with known geometry 36.1 → 38.6 dB, of a real kitchen 21.45 → 21.60 dB.
//!
//! Cameras change their exposure. The map takes colours as they come: multiplied by the gains that
//! fit a frame to the map, novel views of the kitchen were worse (21.4, 21.1 and 19.0 dB with a
//! quarter, half and nine tenths of the gain), since exposure goes with the place. Training, which
//! compares single pixels with the map, takes the gains.

mod edges;
mod harmonics;
mod relief;
mod stored;

use glam::Vec3;

use super::forget::Lost;
use crate::config::MapConfig;
use crate::frame::{ColorImage, Frame};
use crate::geometry::Aabb;
use crate::geometry::harmonics::Harmonics;
use crate::octree::{Band, BandPlace, BandScale, Cell, NO_BLOCK, NO_VERTEX, sum_of_observed};

use harmonics::{Around, ByDirection};
use relief::Relief;
pub use relief::{DISTANCE_STEP_M, SeenDistance};
pub use stored::ColorState;

/// The weight of the past is bounded by this many pixels that hit a vertex: enough to average noise
/// away (of an average, 64 instead of 256 gave 0.1 dB less), and few enough for a changed surface to
/// show within seconds.
const MAX_WEIGHT: f32 = 128.0;
/// From this weight on a vertex is corrected instead of averaged, where corners of as much of the
/// trilinear weight say what the map shows.
const CORRECTED_WEIGHT: f32 = 1.0;
const SHOWN_SHARE: f32 = 0.3;
/// A colour that is given counts as so many pixels.
const PAINTED_WEIGHT: f32 = 8.0;
/// Bound of an exposure gain.
const GAIN_LIMIT: f32 = 1.5;
/// Pixels without which no gain is estimated, and the colours, within 0..1, that take part: neither
/// clipped nor all noise.
const GAIN_PIXELS: usize = 256;
const GAIN_RANGE: std::ops::RangeInclusive<f32> = 0.1..=0.9;

/// What frames say of a vertex.
#[derive(Debug, Clone, Copy, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct SeenColor {
    /// sRGB; corrections can leave 0..1 a little.
    pub color: [f32; 3],
    /// Trilinear weights of the pixels in it; 0 where no frame saw the vertex.
    pub weight: f32,
}

impl SeenColor {
    /// Takes a pixel of some trilinear weight in, which would have the vertex change by `by`.
    fn step(&mut self, by: Vec3, weight: f32) {
        self.weight = (self.weight + weight).min(MAX_WEIGHT);
        self.color = (Vec3::from(self.color) + by * (weight / self.weight)).to_array();
    }
}

/// A pixel on its way into the map.
#[derive(Debug)]
struct Splat {
    place: BandPlace,
    block: u32,
    color: Vec3,
}

/// The averages of a map, by vertex of its band.
#[derive(Debug)]
pub struct ColorField {
    pub band: Band,
    /// Every n-th pixel in u and v takes part.
    stride: u32,
    seen: Vec<SeenColor>,
    /// Where the band is fine enough for one.
    relief: Option<Relief>,
    /// Where colours depend on the direction.
    by_direction: Option<ByDirection>,
    /// The frame that changed a block last.
    touched: Vec<u32>,
    /// Blocks that changed since [`ColorField::take_changed`].
    changed: Vec<u32>,
    splats: Vec<Splat>,
}

impl ColorField {
    /// What a block of `scale` takes with harmonics of degrees 1 to `degree`, bytes.
    pub fn block_bytes(scale: BandScale, degree: u8) -> usize {
        Band::BLOCK_BYTES
            + scale.vertices() * size_of::<SeenColor>()
            + Relief::block_bytes(scale)
            + ByDirection::block_bytes(scale, degree)
            + 4
    }

    /// How the band divides level-0 voxels, if a map has radiance.
    pub fn scale(config: &MapConfig) -> Option<BandScale> {
        let scale = BandScale { cell_m: config.r0_m, log2_side: config.radiance.log2_side };
        config.has("radiance").then_some(scale)
    }

    /// Nothing seen yet; every `stride`-th pixel in u and v will take part. Where the band is fine
    /// enough surfaces have a relief, if bricks of evidence have 2ⁿ cells of the band a side.
    pub fn new(scale: BandScale, stride: u32, log2_brick: Option<u32>) -> Self {
        Self {
            band: Band::new(scale),
            stride,
            seen: Vec::new(),
            relief: log2_brick.filter(|_| Relief::suits(scale)).map(Relief::new),
            by_direction: None,
            touched: Vec::new(),
            changed: Vec::new(),
            splats: Vec::new(),
        }
    }

    /// The same, with colours that depend on the direction by harmonics of degrees 1 to `degree`; 0: they
    /// do not.
    pub fn with_degree(self, degree: u8) -> Self {
        Self { by_direction: (degree > 0).then(|| ByDirection::new(degree)), ..self }
    }

    /// The averages, by vertex of the band.
    pub fn seen(&self) -> &[SeenColor] {
        &self.seen
    }

    /// The distances, by vertex of the band; empty where there is no relief.
    pub fn relief(&self) -> &[SeenDistance] {
        self.relief.as_ref().map_or(&[], Relief::seen)
    }

    /// The harmonics of a vertex: what they add to its colour, sRGB, along the mean of all directions, and
    /// the coefficients of degree 1 and more; `None` where there are none.
    pub fn harmonics(&self, row: u32) -> Option<(Vec3, &[[f32; 3]])> {
        let (coefficients, mean) = self.by_direction.as_ref()?.of(row)?;
        let terms = coefficients.iter().zip(mean.values());
        Some((-terms.map(|(s, mean)| Vec3::from(*s) * *mean).sum::<Vec3>(), coefficients))
    }

    /// The harmonics along a direction, world axes, where colours depend on it.
    pub fn harmonics_along(&self, direction: Vec3) -> Option<Harmonics> {
        self.by_direction.as_ref().map(|by| by.along(direction))
    }

    /// What they add to the colour of a vertex.
    pub fn added_along(&self, row: u32, harmonics: &Harmonics) -> Vec3 {
        self.by_direction.as_ref().map_or(Vec3::ZERO, |by| by.added(row, harmonics))
    }

    /// Takes the distances of the frame in that [`ColorField::integrate`] saw last, at the vertices in
    /// these bricks of evidence.
    pub fn carve(
        &mut self,
        frame: &Frame,
        bricks: impl Iterator<Item = Cell>,
        pool: &rayon::ThreadPool,
    ) {
        let Some(relief) = &mut self.relief else { return };
        self.changed.extend(relief.integrate(frame, &self.band, bricks, pool));
    }

    /// Bytes held.
    pub fn bytes(&self) -> u64 {
        let degree = self.by_direction.as_ref().map_or(0, ByDirection::degree);
        (self.band.blocks() * Self::block_bytes(self.band.scale, degree)) as u64
    }

    /// Blocks of which vertices or neighbours changed since the last call, sorted.
    pub fn take_changed(&mut self) -> Vec<u32> {
        let mut changed = std::mem::take(&mut self.changed);
        changed.extend(self.band.take_linked());
        changed.sort_unstable();
        changed.dedup();
        changed
    }

    /// Takes the colours of a frame in; `number` counts the frames from 1. Returns the gains that
    /// bring the frame's colours to what the map showed before.
    pub fn integrate(&mut self, frame: &Frame, number: u32) -> Vec3 {
        if let Some(relief) = &mut self.relief {
            relief.look(frame);
        }
        let Some(image) = &frame.color else { return Vec3::ONE };
        self.place(frame, image);
        let gain = self.gain();
        self.grow();
        if let Some(by) = &mut self.by_direction {
            by.look(frame);
        }
        let splats = std::mem::take(&mut self.splats);
        for splat in &splats {
            self.take(splat);
            for block in *self.band.uppers(splat.block) {
                if block != NO_BLOCK
                    && std::mem::replace(&mut self.touched[block as usize], number) != number
                {
                    self.changed.push(block);
                }
            }
        }
        self.splats = splats;
        self.splats.clear();
        gain
    }

    /// Makes room for the blocks that are new.
    fn grow(&mut self) {
        self.seen.resize(self.band.rows(), SeenColor::default());
        self.touched.resize(self.band.blocks(), 0);
        if let Some(by) = &mut self.by_direction {
            by.grow(&self.band);
        }
    }

    /// Forgets the colours of surfaces that are gone.
    pub(super) fn forget(&mut self, lost: &Lost) {
        for (block, rows) in lost.rows(&self.band) {
            rows.into_iter().for_each(|row| self.forget_vertex(row));
            if let Some(relief) = &mut self.relief {
                relief.forget(&self.band, block);
            }
            self.changed.push(block);
        }
    }

    fn forget_vertex(&mut self, row: u32) {
        if let Some(by) = &mut self.by_direction {
            by.forget(row);
        }
        // Vertices of blocks that no frame has finished are beyond the end.
        if let Some(seen) = self.seen.get_mut(row as usize) {
            *seen = SeenColor::default();
        }
    }

    /// Forgets the relief in a part of the world, of which something else was told than frames saw.
    pub(super) fn flatten(&mut self, bounds: &Aabb) {
        let Some(relief) = &mut self.relief else { return };
        let (size, reach) = (self.band.scale.cell_m, Relief::truncation_m(self.band.scale));
        let bounds = Aabb { min: bounds.min - reach, max: bounds.max + reach };
        for (block, cell) in self.band.cells().iter().enumerate() {
            let min = Vec3::from(cell.map(|c| c as f32)) * size;
            if min.cmple(bounds.max).all() && (min + size).cmpge(bounds.min).all() {
                relief.forget(&self.band, block as u32);
                self.changed.push(block as u32);
            }
        }
    }

    /// Gives a surface a colour at one of its points.
    pub(super) fn paint(&mut self, point: Vec3, color: Vec3) {
        let place = self.band.scale.place(point);
        let Some(block) = self.band.hold(&place) else { return };
        self.grow();
        if let Some(relief) = &mut self.relief {
            relief.grow(&self.band);
        }
        let uppers = self.band.uppers(block);
        for row in self.band.scale.vertices_around(&place, uppers) {
            if row != NO_VERTEX {
                self.seen[row as usize] =
                    SeenColor { color: color.to_array(), weight: PAINTED_WEIGHT };
                if let Some(by) = &mut self.by_direction {
                    by.forget(row);
                }
            }
        }
        self.changed.extend(uppers.iter().filter(|block| **block != NO_BLOCK));
    }

    /// Brings the vertices around a pixel closer to it.
    fn take(&mut self, splat: &Splat) {
        let rows = self.band.scale.vertices_around(&splat.place, self.band.uppers(splat.block));
        let weights = splat.place.weights();
        let (sum, total) = sum_of_observed(&self.observed(&rows), &weights);
        let correction = (total > SHOWN_SHARE).then(|| splat.color - sum / total);
        if let Some(by) = &mut self.by_direction {
            let around =
                rows.into_iter().zip(weights).filter(|(row, w)| *row != NO_VERTEX && *w > 0.0);
            let around = around.map(|(row, weight)| {
                let past = self.seen[row as usize].weight;
                Around { row, weight, past, steps: past > CORRECTED_WEIGHT }
            });
            by.take(self.band.scale.point(&splat.place), correction, around);
        }
        for (row, weight) in rows.into_iter().zip(weights).filter(|(row, _)| *row != NO_VERTEX) {
            let seen = &mut self.seen[row as usize];
            let average = splat.color - Vec3::from(seen.color);
            let by = correction.filter(|_| seen.weight > CORRECTED_WEIGHT).unwrap_or(average);
            if weight > 0.0 {
                seen.step(by, weight);
            }
        }
    }

    /// The colours of those vertices that frames saw.
    fn observed(&self, rows: &[u32; 8]) -> [Option<Vec3>; 8] {
        rows.map(|row| {
            // Vertices of blocks that are new, or not there, are beyond the end.
            let seen = self.seen.get(row as usize).filter(|seen| seen.weight > 0.0);
            seen.map(|seen| Vec3::from(seen.color))
        })
    }

    /// Finds room for the pixels of a frame.
    fn place(&mut self, frame: &Frame, image: &ColorImage) {
        let k = &frame.intrinsics;
        let (rotation, origin) =
            (frame.world_from_camera.rotation_f32(), frame.world_from_camera.position_f32());
        for v in (self.stride / 2..k.height).step_by(self.stride as usize) {
            for u in (self.stride / 2..k.width).step_by(self.stride as usize) {
                let z = frame.depth.at(u, v);
                if z <= 0.0 || frame.depth.is_edge(u, v) {
                    continue;
                }
                let point = rotation * (k.direction(u as f32, v as f32) * z) + origin;
                let place = self.band.scale.place(point);
                let Some(block) = self.band.hold(&place) else { continue };
                if self.relief.is_some() {
                    self.band.hold_around(point, self.band.scale.spacing_m());
                }
                self.splats.push(Splat {
                    place,
                    block,
                    color: image.beside(u, v, k.width, k.height),
                });
            }
        }
    }

    /// What the frame's colours must be multiplied by, channel by channel, to show what the map
    /// shows: the median ratio.
    fn gain(&self) -> Vec3 {
        let mut ratios: [Vec<f32>; 3] = Default::default();
        for splat in &self.splats {
            let Some(shown) = self.shown(splat) else { continue };
            for (axis, ratios) in ratios.iter_mut().enumerate() {
                if GAIN_RANGE.contains(&splat.color[axis]) && GAIN_RANGE.contains(&shown[axis]) {
                    ratios.push(shown[axis] / splat.color[axis]);
                }
            }
        }
        Vec3::from(ratios.map(|mut ratios| {
            if ratios.len() < GAIN_PIXELS {
                return 1.0;
            }
            let middle = ratios.len() / 2;
            let (_, median, _) = ratios.select_nth_unstable_by(middle, f32::total_cmp);
            median.clamp(1.0 / GAIN_LIMIT, GAIN_LIMIT)
        }))
    }

    /// The colour at a pixel's place, if frames saw nearly all of its vertices.
    fn shown(&self, splat: &Splat) -> Option<Vec3> {
        let rows = self.band.scale.vertices_around(&splat.place, self.band.uppers(splat.block));
        let (sum, total) = sum_of_observed(&self.observed(&rows), &splat.place.weights());
        (total > 0.99).then(|| sum / total)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::test_frame::frame;

    const SCALE: BandScale = BandScale { cell_m: 0.1, log2_side: 2 };

    /// A wall 2 m in front of the camera, left half and right half of their own colours, times
    /// `exposure`.
    fn wall(colors: [[f32; 3]; 2], exposure: f32) -> Frame {
        let mut frame = frame(150.0, |_, _| 2.0);
        let k = frame.intrinsics;
        let pixels = (0..k.pixels() as u32).flat_map(|i| {
            let half = usize::from(i % k.width >= k.width / 2);
            colors[half].map(|c| (c * exposure * 255.0).round() as u8)
        });
        frame.color = Some(ColorImage { width: k.width, height: k.height, rgb: pixels.collect() });
        frame
    }

    fn field() -> ColorField {
        let mut field = ColorField::new(SCALE, 1, Some(3));
        field.band.limit(100_000);
        field
    }

    /// The average at a pixel of the wall.
    fn at(field: &ColorField, frame: &Frame, u: u32) -> Vec3 {
        let place = SCALE.place(frame.world_point(u, 60, 2.0));
        let block = field.band.find(place.cell).expect("a block");
        field.shown(&Splat { place, block, color: Vec3::ZERO }).expect("seen")
    }

    const COLORS: [[f32; 3]; 2] = [[0.8, 0.2, 0.4], [0.3, 0.6, 0.5]];

    #[test]
    fn a_frame_shows_where_it_was_taken() {
        let (mut field, frame) = (field(), wall(COLORS, 1.0));
        assert_eq!(field.integrate(&frame, 1), Vec3::ONE, "there is nothing to compare with");
        for (u, expected) in [(40, COLORS[0]), (120, COLORS[1])] {
            let found = at(&field, &frame, u);
            assert!((found - Vec3::from(expected)).abs().max_element() < 4e-3, "{u}: {found}");
        }
        let blocks = field.take_changed();
        assert_eq!(blocks.len(), field.band.blocks());
        assert!(field.take_changed().is_empty());
    }

    #[test]
    fn a_gain_undoes_an_exposure() {
        let mut field = field();
        field.integrate(&wall(COLORS, 1.0), 1);
        let gain = field.integrate(&wall(COLORS, 0.8), 2);
        assert!((gain - 1.25).abs().max_element() < 0.02, "{gain}");
    }

    /// An average of a pattern as fine as the vertices is grey; this is not.
    #[test]
    fn detail_as_fine_as_the_vertices_is_kept() {
        let mut field = field();
        let mut fine = wall(COLORS, 1.0);
        let period_px = 4.0 * SCALE.spacing_m() / 2.0 * fine.intrinsics.fx as f32;
        let shade = |u: u32| 0.5 + 0.3 * (std::f32::consts::TAU * u as f32 / period_px).sin();
        let image = fine.color.as_mut().expect("a colour image");
        for (i, byte) in image.rgb.iter_mut().enumerate() {
            *byte = (shade(i as u32 / 3 % image.width) * 255.0).round() as u8;
        }
        for number in 1..30 {
            field.integrate(&fine, number);
        }
        let contrast = |of: &dyn Fn(u32) -> f32| {
            (60..100).map(|u| (of(u) - 0.5) * (shade(u) - 0.5)).sum::<f32>()
        };
        let kept = contrast(&|u| at(&field, &fine, u).x) / contrast(&shade);
        // The running average keeps 0.65 of it, and no interpolation between these vertices all.
        assert!(kept > 0.85, "{kept}");
    }

    #[test]
    fn a_changed_surface_shows_in_time() {
        let (mut field, now) = (field(), wall([COLORS[1], COLORS[0]], 1.0));
        for number in 1..40 {
            field.integrate(&wall(COLORS, 1.0), number);
        }
        for number in 40..140 {
            field.integrate(&now, number);
        }
        let found = at(&field, &now, 40);
        assert!((found - Vec3::from(COLORS[1])).abs().max_element() < 0.05, "{found}");
    }

    #[test]
    fn what_was_painted_since_the_last_frame_is_stored_too() {
        let (mut field, frame) = (field(), wall(COLORS, 1.0));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().expect("a thread");
        field.integrate(&frame, 1);
        field.carve(&frame, [[0, 0, 0]].into_iter(), &pool);
        field.paint(Vec3::splat(9.0), Vec3::from(COLORS[0]));
        let stored = field.state();
        assert_eq!(
            (stored.seen.len(), stored.relief.len()),
            (field.band.rows(), field.band.rows())
        );
        let again = ColorField::new(SCALE, 1, Some(3)).with_state(stored).expect("fits together");
        assert_eq!(again.relief(), field.relief());
    }

    #[test]
    fn what_is_forgotten_or_painted_keeps_nothing_that_depends_on_the_direction() {
        let (mut field, frame) = (field().with_degree(2), wall(COLORS, 1.0));
        field.integrate(&frame, 1);
        let place = SCALE.place(frame.world_point(30, 60, 2.0));
        let block = field.band.find(place.cell).expect("a block");
        let rows = SCALE.vertices_around(&place, field.band.uppers(block));
        let by_direction = vec![0.1; field.state().by_direction.len()];
        let state = ColorState { by_direction: by_direction.into(), ..field.state() };
        let mut field = ColorField::new(SCALE, 1, Some(3)).with_degree(2);
        field = field.with_state(state).expect("fits together");
        let shines = |field: &ColorField| rows.map(|row| field.harmonics(row).is_some());
        assert_eq!(shines(&field), [true; 8]);
        field.forget_vertex(rows[0]);
        assert_eq!(shines(&field)[..2], [false, true]);
        field.paint(SCALE.point(&place), Vec3::from(COLORS[1]));
        assert_eq!(shines(&field), [false; 8]);
    }

    #[test]
    fn edges_and_frames_without_colour_leave_nothing() {
        let mut field = field();
        let mut step = wall(COLORS, 1.0);
        step.depth.metres.iter_mut().skip(1).step_by(2).for_each(|z| *z = 3.0);
        field.integrate(&step, 1);
        assert_eq!(field.band.blocks(), 0);
        step.color = None;
        assert_eq!(field.integrate(&step, 2), Vec3::ONE);
    }

    #[test]
    fn at_the_bound_colours_are_refused_and_counted() {
        let mut field = ColorField::new(SCALE, 1, Some(3));
        field.band.limit(3);
        field.integrate(&wall(COLORS, 1.0), 1);
        assert_eq!(field.band.blocks(), 3);
        assert!(field.band.take_refused() > 0);
    }
}
