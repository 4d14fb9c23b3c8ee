//! How colours depend on where they are seen from: coefficients of spherical harmonics at the vertices
//! of the band, in closed form as the colours are.
//!
//! A pixel shows Σ w (c + Σ s (Y(d) − Y(m))) along its ray d, over the vertices around it, with their
//! colours c, coefficients s, and the mean m of the directions that they were seen along. Colours are
//! what they are without harmonics, the mean of what was seen; what a pixel differs by from all of it
//! steps the coefficients by their shares φ = w (Y(d) − Y(m)) in it, divided by Σ φ² so far
//! (normalised least mean squares, with the steps of an average). [`RIDGE`] holds back what few
//! directions speak for, and where a surface was seen from one side alone, φ is nearly 0: of the other
//! sides nothing is said that nobody saw. Without the means, constant parts of harmonics follow every
//! change of the exposure as colours do, so many times as fast as there are terms: novel views of a real
//! kitchen 20.4 → 19.4 to 20.1 dB, and with them 21.2 to 21.5 dB.

use glam::Vec3;

use crate::frame::Frame;
use crate::geometry::harmonics::{self, Harmonics};
use crate::octree::{Band, BandScale};

/// So much of Σ φ² says that colours do not depend on the direction.
const RIDGE: f32 = 4.0;
/// The weight of the past is bounded by so much of Σ φ².
const MAX_EVIDENCE: f32 = 64.0;
/// The mean of a squared harmonic over all directions is 1 by this.
const SPHERE: f32 = 4.0 * std::f32::consts::PI;
/// Numbers of a vertex before its coefficients: the mean direction and Σ φ².
const HEAD: usize = 4;

/// The coefficients of a band.
#[derive(Debug)]
pub(super) struct ByDirection {
    degree: u8,
    /// Vertex by vertex the mean of the unit vectors from cameras to it, by their weights, Σ φ², and
    /// the coefficients, sRGB, by term. The direction is 0 where no frame saw the vertex.
    seen: Vec<f32>,
    /// Where the frame in hand was taken from, world metres.
    eye: Vec3,
}

/// A vertex around a pixel: its row, trilinear weight, and the pixels that it has had, which it is
/// stepped by only if there are enough.
pub(super) struct Around {
    pub row: u32,
    pub weight: f32,
    pub past: f32,
    pub steps: bool,
}

impl ByDirection {
    /// Of degrees 1 to `degree`; nothing seen yet.
    pub(super) fn new(degree: u8) -> Self {
        Self { degree, seen: Vec::new(), eye: Vec3::ZERO }
    }

    pub(super) fn degree(&self) -> u8 {
        self.degree
    }

    /// Numbers of a vertex.
    const fn width(degree: u8) -> usize {
        HEAD + 3 * harmonics::terms(degree)
    }

    /// What a block of `scale` takes, bytes; nothing with degree 0.
    pub(super) fn block_bytes(scale: BandScale, degree: u8) -> usize {
        let width = if degree == 0 { 0 } else { Self::width(degree) };
        scale.vertices() * width * size_of::<f32>()
    }

    /// Looks at a frame of which pixels come next.
    pub(super) fn look(&mut self, frame: &Frame) {
        self.eye = frame.world_from_camera.position_f32();
    }

    /// Makes room for the blocks that are new.
    pub(super) fn grow(&mut self, band: &Band) {
        self.seen.resize(band.rows() * Self::width(self.degree), 0.0);
    }

    /// All numbers, vertex by vertex of the band.
    pub(super) fn seen(&self) -> &[f32] {
        &self.seen
    }

    fn range(&self, row: u32) -> std::ops::Range<usize> {
        let width = Self::width(self.degree);
        row as usize * width..(row as usize + 1) * width
    }

    /// The harmonics along a direction, world axes.
    pub(super) fn along(&self, direction: Vec3) -> Harmonics {
        Harmonics::along(direction.normalize_or_zero(), self.degree)
    }

    /// A vertex's coefficients, and its harmonics along the mean direction; `None` where nobody saw it.
    pub(super) fn of(&self, row: u32) -> Option<(&[[f32; 3]], Harmonics)> {
        let (head, coefficients) = self.seen.get(self.range(row))?.split_at(HEAD);
        let mean = Vec3::from_slice(head);
        (mean != Vec3::ZERO).then(|| (coefficients.as_chunks().0, self.along(mean)))
    }

    /// What a vertex adds to its colour, sRGB.
    pub(super) fn added(&self, row: u32, harmonics: &Harmonics) -> Vec3 {
        let Some((coefficients, mean)) = self.of(row) else { return Vec3::ZERO };
        let by = harmonics.values().iter().zip(mean.values()).map(|(y, mean)| y - mean);
        coefficients.iter().zip(by).map(|(s, by)| Vec3::from(*s) * by).sum()
    }

    /// Takes in a pixel at a point, which differs by `correction` from what colours show there.
    pub(super) fn take(
        &mut self,
        point: Vec3,
        correction: Option<Vec3>,
        around: impl Iterator<Item = Around> + Clone,
    ) {
        let direction = (point - self.eye).normalize_or_zero();
        let harmonics = self.along(direction);
        let (mut added, mut total) = (Vec3::ZERO, 0.0);
        for Around { row, weight, .. } in around.clone().filter(|vertex| vertex.past > 0.0) {
            added += self.added(row, &harmonics) * weight;
            total += weight;
        }
        let left = correction.map(|correction| correction - added / total);
        for vertex in around {
            if let Some(left) = left.filter(|_| vertex.steps) {
                self.step(vertex.row, left, vertex.weight, &harmonics);
            }
            let range = self.range(vertex.row);
            let seen = &mut self.seen[range];
            let mean = Vec3::from_slice(seen);
            let share = vertex.weight / (vertex.past + vertex.weight);
            let share = if mean == Vec3::ZERO { 1.0 } else { share };
            seen[..3].copy_from_slice(&(mean + (direction - mean) * share).to_array());
        }
    }

    /// Steps the coefficients of a vertex.
    fn step(&mut self, row: u32, left: Vec3, weight: f32, harmonics: &Harmonics) {
        let Some((_, mean)) = self.of(row) else { return };
        let range = self.range(row);
        let (head, coefficients) = self.seen[range].split_at_mut(HEAD);
        let shares =
            || harmonics.values().iter().zip(mean.values()).map(|(y, mean)| weight * (y - mean));
        let squares = SPHERE * shares().map(|share| share * share).sum::<f32>();
        head[3] = (head[3] + squares).min(MAX_EVIDENCE);
        let gain = SPHERE / (RIDGE + head[3]);
        for (s, share) in coefficients.as_chunks_mut().0.iter_mut().zip(shares()) {
            *s = (Vec3::from(*s) + left * (gain * share)).to_array();
        }
    }

    /// Forgets a vertex.
    pub(super) fn forget(&mut self, row: u32) {
        let range = self.range(row);
        // Vertices of blocks that no frame has finished are beyond the end.
        if let Some(seen) = self.seen.get_mut(range) {
            seen.fill(0.0);
        }
    }

    /// Takes up stored numbers; false if they do not fit a band, or are none.
    pub(super) fn fill(&mut self, seen: Vec<f32>, band: &Band) -> bool {
        let fits = seen.len() == band.rows() * Self::width(self.degree)
            && seen.iter().all(|x| x.is_finite());
        self.seen = seen;
        fits
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frame::ColorImage;
    use crate::geometry::Pose;
    use crate::octree::NO_VERTEX;
    use crate::surface::ColorField;
    use crate::surface::test_frame::frame;

    const SCALE: BandScale = BandScale { cell_m: 0.1, log2_side: 2 };
    const WALL_M: f32 = 3.0;

    /// A wall at x = 3 m that shines: what it shows along a direction.
    fn shine(direction: Vec3) -> Vec3 {
        let d = direction.normalize();
        Vec3::new(0.5 + 0.5 * d.y, 0.5 - 0.4 * d.z, 0.4 + 0.3 * (d.y + d.z))
    }

    /// The wall from 2 m before it.
    fn seen(y: f64, z: f64) -> Frame {
        let eye = glam::DVec3::new(f64::from(WALL_M) - 2.0, y, z);
        let mut frame = frame(110.0, |_, _| 2.0);
        frame.world_from_camera = Pose::looking_at(eye, eye + glam::DVec3::X, glam::DVec3::Z);
        let k = frame.intrinsics;
        let pixels = (0..k.height).flat_map(|v| (0..k.width).map(move |u| (u, v)));
        let shown = |(u, v)| shine(frame.world_point(u, v, 2.0) - eye.as_vec3());
        let rgb = pixels.map(shown).flat_map(|color| color.to_array().map(|c| (c * 255.0) as u8));
        frame.color = Some(ColorImage { width: k.width, height: k.height, rgb: rgb.collect() });
        frame
    }

    fn field(degree: u8) -> ColorField {
        let mut field = ColorField::new(SCALE, 2, None).with_degree(degree);
        field.band.limit(100_000);
        field
    }

    /// What the map shows at a point along a direction.
    fn shown(field: &ColorField, point: Vec3, direction: Vec3) -> Vec3 {
        let place = SCALE.place(point);
        let block = field.band.find(place.cell).expect("a block");
        let rows = SCALE.vertices_around(&place, field.band.uppers(block));
        let harmonics = field.harmonics_along(direction);
        let (mut sum, mut total) = (Vec3::ZERO, 0.0);
        for (row, weight) in rows.into_iter().zip(place.weights()) {
            let seen = if row == NO_VERTEX { continue } else { field.seen()[row as usize] };
            let added = harmonics.map_or(Vec3::ZERO, |h| field.added_along(row, &h));
            if seen.weight > 0.0 {
                sum += (Vec3::from(seen.color) + added) * weight;
                total += weight;
            }
        }
        sum / total
    }

    /// The mean error of what is shown of the wall's middle from an eye beside it.
    fn error(field: &ColorField, eye: Vec3) -> f32 {
        let points = (0..400).map(|i| [(i % 20) as f32, (i / 20) as f32].map(|c| 0.04 * c - 0.4));
        let errors = points.map(|[y, z]| {
            let point = Vec3::new(WALL_M + 1e-3, 2.0 + y, 3.0 + z);
            let expected = shine(point - eye);
            (shown(field, point, point - eye) - expected).abs().element_sum() / 3.0
        });
        errors.sum::<f32>() / 400.0
    }

    #[test]
    fn a_wall_that_shines_is_shown_from_where_nobody_stood() {
        let eyes = [(1.2, 2.6), (1.6, 3.3), (2.1, 2.8), (2.5, 3.4), (2.8, 2.7), (1.9, 3.1)];
        let mut fields = [0, 1, 2, 3].map(field);
        for round in 0..12 {
            for (i, (y, z)) in eyes.into_iter().enumerate() {
                let frame = seen(y, z);
                for field in &mut fields {
                    field.integrate(&frame, 6 * round + i as u32 + 1);
                }
            }
        }
        let colors = fields[0].seen();
        assert!(fields.iter().all(|field| field.seen() == colors), "the mean is what it was");
        let eye = Vec3::new(1.0, 2.65, 3.2);
        let errors = fields.each_ref().map(|field| error(field, eye));
        assert!(errors[0] > 0.05, "{errors:?}");
        // The first degree has most of it to learn from few harmonics, and the ridge holds it back.
        assert!(errors[1] < 0.5 * errors[0] && errors[2] < 0.2 * errors[0], "{errors:?}");
        assert!(errors[3] < 0.2 * errors[0], "{errors:?}");
    }

    /// Nothing is made up of sides that nobody saw, however the exposure changes.
    #[test]
    fn what_was_seen_along_one_direction_stays_the_same_along_others() {
        let mut field = field(3);
        let frame = seen(2.0, 3.0);
        for number in 1..40 {
            let mut frame = frame.clone();
            let exposure = if number % 2 == 0 { 1.0 } else { 0.7 };
            let image = frame.color.as_mut().expect("colours");
            image.rgb.iter_mut().for_each(|c| *c = (f32::from(*c) * exposure) as u8);
            field.integrate(&frame, number);
        }
        let point = Vec3::new(WALL_M + 1e-3, 2.0, 3.0);
        let colors = [Vec3::X, Vec3::new(1.0, 2.0, 0.0), Vec3::new(1.0, 0.0, -2.0), Vec3::NEG_X]
            .map(|direction| shown(&field, point, direction));
        let spread = colors.map(|color| (color - colors[0]).abs().max_element());
        assert!(spread.iter().all(|by| *by < 0.02), "{spread:?}");
    }
}
