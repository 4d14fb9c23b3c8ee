//! Real spherical harmonics of degrees 1 to 3, orthonormal over the sphere, in the order and with the
//! signs of PlenOctrees and 3D Gaussian splatting. The constant of degree 0 is left out: it is what a
//! function of the direction is in the mean.

use glam::Vec3;

/// The highest degree.
pub const MAX_DEGREE: u8 = 3;

/// √(3 / 4π).
const FIRST: f32 = 0.488_602_5;
/// √(15 / 4π), √(5 / 16π) and √(15 / 16π).
const SECOND: [f32; 3] = [1.092_548_4, 0.315_391_57, 0.546_274_2];
/// √(35 / 32π), √(105 / 4π), √(21 / 32π), √(7 / 16π) and √(105 / 16π).
const THIRD: [f32; 5] = [0.590_043_6, 2.890_611_4, 0.457_045_8, 0.373_176_34, 1.445_305_7];

/// The number of harmonics of degrees 1 to `degree`.
pub const fn terms(degree: u8) -> usize {
    let side = degree as usize + 1;
    side * side - 1
}

/// The harmonics along one direction.
#[derive(Debug, Clone, Copy)]
pub struct Harmonics {
    values: [f32; terms(MAX_DEGREE)],
    terms: usize,
}

impl Harmonics {
    /// Those of degrees 1 to `degree`, at most [`MAX_DEGREE`], along a unit vector.
    pub fn along(direction: Vec3, degree: u8) -> Self {
        let (x, y, z) = (direction.x, direction.y, direction.z);
        let (xx, yy, zz) = (x * x, y * y, z * z);
        let [a, b, c] = SECOND;
        let [d, e, f, g, h] = THIRD;
        let values = [
            -FIRST * y,
            FIRST * z,
            -FIRST * x,
            a * x * y,
            -a * y * z,
            b * (2.0 * zz - xx - yy),
            -a * x * z,
            c * (xx - yy),
            -d * y * (3.0 * xx - yy),
            e * x * y * z,
            -f * y * (4.0 * zz - xx - yy),
            g * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
            -f * x * (4.0 * zz - xx - yy),
            h * z * (xx - yy),
            -d * x * (xx - 3.0 * yy),
        ];
        Self { values, terms: terms(degree.min(MAX_DEGREE)) }
    }

    /// Degree by degree.
    pub fn values(&self) -> &[f32] {
        &self.values[..self.terms]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Over the sphere, exact for polynomials of degree 6: Gauss-Legendre along z, a circle around.
    fn mean(of: impl Fn(Vec3) -> f64) -> f64 {
        let nodes = [
            (0.0, 0.417_959_183_673_469_4),
            (0.405_845_151_377_397_2, 0.381_830_050_505_118_9),
            (0.741_531_185_599_394_4, 0.279_705_391_489_276_7),
            (0.949_107_912_342_758_5, 0.129_484_966_168_869_7),
        ];
        let mut sum = 0.0;
        for (node, weight) in nodes {
            for sign in [-1.0, 1.0] {
                // The node in the middle has no twin.
                let share = if node == 0.0 { 0.5 } else { 1.0 };
                let z: f64 = sign * node;
                for step in 0..16 {
                    let (sin, cos) = (std::f64::consts::TAU * f64::from(step) / 16.0).sin_cos();
                    let ring = (1.0 - z * z).sqrt();
                    let at = glam::DVec3::new(ring * cos, ring * sin, z).as_vec3();
                    sum += share * weight * of(at) / 32.0;
                }
            }
        }
        sum
    }

    #[test]
    fn harmonics_are_orthonormal_and_vanish_in_the_mean() {
        let value = |at, i: usize| f64::from(Harmonics::along(at, MAX_DEGREE).values()[i]);
        assert!((mean(|at| f64::from(at.z * at.z)) - 1.0 / 3.0).abs() < 1e-7, "of the quadrature");
        for i in 0..terms(MAX_DEGREE) {
            assert!(mean(|at| value(at, i)).abs() < 1e-6, "{i}");
            for j in 0..terms(MAX_DEGREE) {
                let product = 4.0 * std::f64::consts::PI * mean(|at| value(at, i) * value(at, j));
                let expected = f64::from(u8::from(i == j));
                assert!((product - expected).abs() < 1e-5, "{i} {j}: {product}");
            }
        }
    }

    /// Each degree by its own: a function of degree l changes its sign with the direction iff l is odd.
    #[test]
    fn degrees_have_their_terms_and_their_parity() {
        let direction = Vec3::new(0.48, -0.6, 0.64);
        let all = Harmonics::along(direction, MAX_DEGREE);
        let back = Harmonics::along(-direction, MAX_DEGREE);
        for degree in 0..=MAX_DEGREE {
            let some = Harmonics::along(direction, degree);
            assert_eq!(some.values(), &all.values()[..terms(degree)]);
        }
        for degree in 1..=MAX_DEGREE {
            let sign = if degree % 2 == 1 { -1.0 } else { 1.0 };
            for i in terms(degree - 1)..terms(degree) {
                assert!((back.values()[i] - sign * all.values()[i]).abs() < 1e-6, "{i}");
            }
        }
    }
}
