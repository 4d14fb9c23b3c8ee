//! Radiance: colour c(x) = σ(Σ w_k p_k / Σ w_k) over the band's vertices around x that were
//! observed, with trilinear weights w_k and p_k three logits a vertex (paper, radiance:
//! sigmoid activation).
//!
//! A vertex starts with the logits of the average that frames saw there (algorithms.md §14), and
//! what rays teach is added to them. Colours are sRGB within 0..1: what cameras deliver and screens
//! take.

use glam::{Vec3, Vec4};

use super::interpolation::trilinear;
use crate::geometry::harmonics::{Harmonics, terms};
use crate::octree::{BandPlace, BandScale, NO_VERTEX, Uppers};
use crate::surface::DISTANCE_STEP_M;

/// Bound of a stored logit, so that it fits a [`Texel`].
const LIMIT: f32 = 7.99;
/// Colours are kept this far from 0 and 1, where logits have no end: half of an 8-bit step.
pub const MARGIN: f32 = 1.0 / 512.0;
/// Steps of a [`Texel`] in one unit of a logit.
const SCALE: f32 = 4096.0;

/// A vertex as a view holds it: logits in steps of 2⁻¹², and the distance to the surface in steps of
/// [`DISTANCE_STEP_M`]. All logits are 0 where no colour was observed, and the distance is 0 where none
/// was; a value that would be 0 is one step off.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub struct Texel {
    logits: [i16; 3],
    distance: i16,
}

impl Texel {
    /// A vertex of which a colour, a distance in steps, both or nothing was observed.
    pub fn new(logits: Option<Vec3>, distance: Option<i16>) -> Self {
        let step = |x: f32| (x.clamp(-LIMIT, LIMIT) * SCALE).round() as i16;
        match logits {
            Some(logits) => Self::of_steps(logits.to_array().map(step), distance),
            None => Self { logits: [0; 3], distance: other_than_0(distance) },
        }
    }

    /// An observed vertex with logits in steps of 2⁻¹².
    pub fn of_steps(logits: [i16; 3], distance: Option<i16>) -> Self {
        let logits = if logits == [0; 3] { [1, 0, 0] } else { logits };
        Self { logits, distance: other_than_0(distance) }
    }

    /// Whether a frame saw the colour of the vertex.
    #[inline]
    pub fn is_observed(self) -> bool {
        self.logits != [0; 3]
    }

    /// The logits; of no meaning where the vertex was not observed.
    #[inline]
    pub fn logits(self) -> Vec3 {
        Vec3::from(self.logits.map(f32::from)) * (1.0 / SCALE)
    }

    /// The distance to the surface, m, where frames measured it.
    #[inline]
    pub fn distance_m(self) -> Option<f32> {
        (self.distance != 0).then(|| f32::from(self.distance) * DISTANCE_STEP_M)
    }
}

/// A coefficient of a vertex as a view holds it, sRGB in steps of 2⁻¹³: what it adds to the colour along
/// the mean of all directions comes first, and then harmonics of degree 1 and more.
pub type Harmonic = [i16; 3];

/// Steps of a [`Harmonic`] in one unit.
pub const HARMONIC_SCALE: f32 = 8192.0;

/// How many a vertex has with harmonics of degrees 1 to `degree`; none with degree 0.
pub const fn harmonics(degree: u8) -> usize {
    if degree == 0 { 0 } else { 1 + terms(degree) }
}

/// Writes a vertex: the constant, and as many coefficients; zeros where it has none.
pub fn write_harmonics(seen: Option<(Vec3, &[[f32; 3]])>, out: &mut [Harmonic]) {
    let step = |x: f32| (x * HARMONIC_SCALE).round() as i16;
    out.fill([0; 3]);
    if let Some((constant, coefficients)) = seen {
        let all = [constant.to_array()].into_iter().chain(coefficients.iter().copied());
        out.iter_mut().zip(all).for_each(|(out, of)| *out = of.map(step));
    }
}

fn other_than_0(distance: Option<i16>) -> i16 {
    distance.map_or(0, |steps| if steps == 0 { 1 } else { steps })
}

/// Read access to a band of colour.
pub trait TexelSource {
    /// How the band divides cells.
    fn band(&self) -> BandScale;
    /// A block and its neighbours.
    fn uppers(&self, block: u32) -> &Uppers;
    /// The vertex with a row that exists.
    fn texel(&self, row: u32) -> Texel;
    /// The degree of the harmonics of vertices; 0: colours do not depend on the direction.
    fn degree(&self) -> u8;
    /// The harmonics of the vertex with a row that exists, [`harmonics`] of them.
    fn harmonics(&self, row: u32) -> &[Harmonic];
}

/// The colour at a point (world metres) whose cell of level 0 has this block, in the mean over the
/// directions that it was seen along; `None` where no vertex around was observed.
#[inline]
pub fn color(source: &(impl TexelSource + ?Sized), block: u32, point: Vec3) -> Option<Vec3> {
    let scale = source.band();
    let place: BandPlace = scale.place(point);
    let rows = scale.vertices_around(&place, source.uppers(block));
    let (mut sum, mut total) = (Vec3::ZERO, 0.0);
    for (row, weight) in rows.into_iter().zip(place.weights()) {
        if row == NO_VERTEX {
            continue;
        }
        let texel = source.texel(row);
        if texel.is_observed() {
            sum += texel.logits() * weight;
            total += weight;
        }
    }
    (total > 0.0).then(|| sigmoid(sum / total))
}

/// A cell between eight vertices of a band, for who asks for many of its colours: says what [`color`]
/// says.
#[derive(Debug, Clone, Copy)]
pub struct ColorCell {
    /// Coefficients ([`trilinear`]) of Σ w p and, as w, of Σ w.
    sums: [Vec4; 8],
}

impl ColorCell {
    /// Less trilinear weight than this is rounding.
    const LEAST: f32 = 1e-5;

    /// The cell around a point (world metres) whose cell of level 0 has this block.
    pub fn at(source: &(impl TexelSource + ?Sized), block: u32, point: Vec3) -> Self {
        let scale = source.band();
        let rows = scale.vertices_around(&scale.place(point), source.uppers(block));
        let observed = rows.map(|row| {
            let texel = if row == NO_VERTEX { Texel::default() } else { source.texel(row) };
            if texel.is_observed() { texel.logits().extend(1.0) } else { Vec4::ZERO }
        });
        Self { sums: trilinear(observed) }
    }

    /// The colour at a place, with x from 0 to 1 across the cell; `None` where no vertex around was
    /// observed.
    #[inline]
    pub fn color(&self, x: Vec3) -> Option<Vec3> {
        let c = &self.sums;
        let low = (c[0] + c[1] * x.x) + (c[2] + c[3] * x.x) * x.y;
        let high = (c[4] + c[5] * x.x) + (c[6] + c[7] * x.x) * x.y;
        let sum = low + high * x.z;
        (sum.w > Self::LEAST).then(|| sigmoid(sum.truncate() / sum.w))
    }
}

/// The same, as it is seen along a direction (world axes, away from the eye).
#[inline]
pub fn color_along(
    source: &(impl TexelSource + ?Sized),
    block: u32,
    point: Vec3,
    direction: Vec3,
) -> Option<Vec3> {
    let color = color(source, block, point)?;
    if source.degree() == 0 {
        return Some(color);
    }
    Some((color + added(source, block, point, direction)).clamp(Vec3::ZERO, Vec3::ONE))
}

/// What the harmonics at a point with a colour add along a direction.
fn added(source: &(impl TexelSource + ?Sized), block: u32, point: Vec3, direction: Vec3) -> Vec3 {
    let harmonics = Harmonics::along(direction.normalize_or_zero(), source.degree());
    let scale = source.band();
    let place = scale.place(point);
    let rows = scale.vertices_around(&place, source.uppers(block));
    let (mut sum, mut total) = (Vec3::ZERO, 0.0);
    for (row, weight) in rows.into_iter().zip(place.weights()) {
        if row != NO_VERTEX && source.texel(row).is_observed() {
            let values = [1.0].iter().chain(harmonics.values());
            for (term, value) in source.harmonics(row).iter().zip(values) {
                sum += Vec3::from(term.map(f32::from)) * (weight * value);
            }
            total += weight;
        }
    }
    sum / (total * HARMONIC_SCALE)
}

/// Logits of a colour within 0..1.
#[inline]
pub fn logits(color: Vec3) -> Vec3 {
    let c = color.clamp(Vec3::splat(MARGIN), Vec3::splat(1.0 - MARGIN));
    let logit = |x: f32| (x / (1.0 - x)).ln();
    Vec3::new(logit(c.x), logit(c.y), logit(c.z))
}

/// The colour of logits.
#[inline]
pub fn sigmoid(logits: Vec3) -> Vec3 {
    let probability = |x: f32| 1.0 / (1.0 + (-x).exp());
    Vec3::new(probability(logits.x), probability(logits.y), probability(logits.z))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::octree::Band;

    /// A block, its vertices, the degree of their harmonics, and these.
    struct Source(Band, Vec<Texel>, u8, Vec<Harmonic>);

    impl TexelSource for Source {
        fn band(&self) -> BandScale {
            self.0.scale
        }

        fn uppers(&self, block: u32) -> &Uppers {
            self.0.uppers(block)
        }

        fn texel(&self, row: u32) -> Texel {
            self.1[row as usize]
        }

        fn degree(&self) -> u8 {
            self.2
        }

        fn harmonics(&self, row: u32) -> &[Harmonic] {
            let width = harmonics(self.2);
            &self.3[row as usize * width..(row as usize + 1) * width]
        }
    }

    #[test]
    fn logits_and_colours_invert_each_other_within_half_a_step_of_eight_bits() {
        for level in 0..=255 {
            let color = Vec3::splat(level as f32 / 255.0);
            let back = sigmoid(Texel::new(Some(logits(color)), None).logits());
            assert!((back - color).abs().max_element() <= 1.0 / 510.0, "{level}: {back}");
        }
    }

    #[test]
    fn a_cell_says_what_its_points_say() {
        let scale = BandScale { cell_m: 0.1, log2_side: 1 };
        let mut band = Band::new(scale);
        band.limit(1);
        let block = band.insert([0; 3]).expect("room");
        // Some of the eight vertices were seen, each in another colour.
        let texel = |k: u8| {
            let [x, y, z] = [0, 1, 2].map(|axis| f32::from(k >> axis & 1));
            let color = Vec3::new(0.2 + 0.5 * x, 0.8 - 0.4 * y, 0.3 + 0.2 * z * x);
            Texel::new((k % 3 != 1).then(|| logits(color)), None)
        };
        let source = Source(band, (0..8).map(texel).collect(), 0, Vec::new());
        let cell = ColorCell::at(&source, block, Vec3::splat(0.025));
        for x in [Vec3::splat(0.5), Vec3::new(0.1, 0.7, 0.3), Vec3::new(0.9, 0.2, 0.8)] {
            let expected = color(&source, block, x * scale.spacing_m()).expect("observed");
            let found = cell.color(x).expect("observed");
            assert!((found - expected).abs().max_element() < 1e-5, "{x}: {found}");
        }
        assert_eq!(cell.color(Vec3::X), None, "nobody saw that corner");
    }

    #[test]
    fn vertices_that_nobody_saw_have_no_say() {
        let scale = BandScale { cell_m: 0.1, log2_side: 1 };
        let mut band = Band::new(scale);
        band.limit(1);
        let block = band.insert([0; 3]).expect("room");
        let mut source = Source(band, vec![Texel::default(); 8], 0, Vec::new());
        let point = Vec3::splat(0.02);
        assert_eq!(color(&source, block, point), None);
        let (red, blue) = (Vec3::new(0.9, 0.1, 0.1), Vec3::new(0.1, 0.1, 0.9));
        source.1[0] = Texel::new(Some(logits(red)), None);
        let found = color(&source, block, point).expect("observed");
        assert!((found - red).abs().max_element() < 1e-3, "{found}");
        source.1[1] = Texel::new(Some(logits(blue)), None);
        // Halfway along x between both, in logits: both mix alike, whatever the other axes say.
        let found = color(&source, block, Vec3::new(0.025, 0.02, 0.02)).expect("observed");
        assert!((found - Vec3::new(0.5, 0.1, 0.5)).abs().max_element() < 1e-3, "{found}");
    }

    #[test]
    fn harmonics_are_added_along_the_direction_and_no_colour_leaves_its_range() {
        let scale = BandScale { cell_m: 0.1, log2_side: 1 };
        let mut band = Band::new(scale);
        band.limit(1);
        let block = band.insert([0; 3]).expect("room");
        let grey = Texel::new(Some(logits(Vec3::splat(0.5))), None);
        let mut all = vec![[0; 3]; 8 * harmonics(1)];
        // Two vertices along x, and a third that nobody saw: a slope along z, twice as steep.
        for (row, slope) in [(0, 0.2), (1, 0.4), (2, 4.0)] {
            let coefficients = [[0.0; 3], [slope, -slope, 9.0], [0.0; 3]];
            let constant = Vec3::new(0.1, 0.0, 0.0);
            let out = &mut all[row * harmonics(1)..(row + 1) * harmonics(1)];
            write_harmonics(Some((constant, &coefficients)), out);
        }
        let mut texels = vec![Texel::default(); 8];
        texels[..2].fill(grey);
        let source = Source(band, texels, 1, all);
        let at = Vec3::new(0.025, 0.02, 0.02);
        let plain = color(&source, block, at).expect("observed");
        assert!((plain - 0.5).abs().max_element() < 1e-3, "{plain}");
        for (direction, by) in [(Vec3::Z, 1.0), (Vec3::new(0.0, 3.0, -4.0), -0.8)] {
            let found = color_along(&source, block, at, direction).expect("observed");
            let slope = 0.3 * by * 0.488_602_5;
            let blue = if by > 0.0 { 1.0 } else { 0.0 };
            let expected = Vec3::new(0.6 + slope, 0.5 - slope, blue);
            assert!((found - expected).abs().max_element() < 1e-3, "{direction}: {found}");
        }
        assert_eq!(harmonics(0), 0, "nothing is held where colours do not depend on it");
    }
}
