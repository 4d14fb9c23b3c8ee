//! The losses of one sample and their derivatives (algorithms.md §2 and §8).

use super::occupancy::probability;

/// Offset of the finite-difference stencil, m.
pub const STENCIL_M: f32 = 0.03;
/// |ℓ̂| from which occupancy is confident enough to teach the distance its sign. It exceeds the
/// surface label's ln 3, or every surface point would count.
pub const CONFIDENT_LOGIT: f32 = 2.0;
/// Keeps the norm of a zero gradient differentiable.
pub const SAFE_NORM: f32 = 1e-12;

/// How the Eikonal term takes ∇f.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Stencil {
    /// Central differences: six points.
    Central,
    /// Forward differences from the sample itself: three points.
    Forward,
}

impl Stencil {
    /// Most points of a stencil.
    pub const MAX: usize = 6;

    /// The offsets from the sample, in units of [`STENCIL_M`]: x, y, z, then −x, −y, −z.
    pub fn offsets(self) -> &'static [[f32; 3]] {
        const ALL: [[f32; 3]; Stencil::MAX] = [
            [1.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, 0.0, 1.0],
            [-1.0, 0.0, 0.0],
            [0.0, -1.0, 0.0],
            [0.0, 0.0, -1.0],
        ];
        match self {
            Self::Central => &ALL,
            Self::Forward => &ALL[..3],
        }
    }

    /// | ‖∇f‖ − 1 | from f at the sample and at the stencil's points; and its derivatives.
    #[inline]
    pub fn eikonal(self, centre: f32, around: &[f32]) -> (f32, f32, [f32; Self::MAX]) {
        let central = self == Self::Central;
        let step = if central { 2.0 * STENCIL_M } else { STENCIL_M };
        let low = |axis: usize| if central { around[axis + 3] } else { centre };
        let g: [f32; 3] = std::array::from_fn(|axis| (around[axis] - low(axis)) / step);
        let norm = (g[0] * g[0] + g[1] * g[1] + g[2] * g[2] + SAFE_NORM).sqrt();
        let by: [f32; 3] = std::array::from_fn(|axis| sign(norm - 1.0) * g[axis] / (norm * step));
        let by_around = [by[0], by[1], by[2], -by[0], -by[1], -by[2]];
        let by_centre = if central { 0.0 } else { -(by[0] + by[1] + by[2]) };
        ((norm - 1.0).abs(), by_centre, by_around)
    }
}

/// Weights of the loss terms.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LossWeights {
    /// |f − y| on surface samples; with y = 0 it is the paper's |f|.
    pub boundary: f32,
    /// |f − y| on perturbed samples.
    pub perturbation: f32,
    /// |f − y| on free-space samples.
    pub projection: f32,
    /// Eikonal on surface and perturbed samples.
    pub eikonal_surface: f32,
    /// Eikonal on free-space samples.
    pub eikonal_space: f32,
    /// Binary cross-entropy; no other loss touches its parameters, so the scale hardly matters.
    pub occupancy: f32,
    /// Sign consistency on free-space and perturbed samples; 0 switches it off.
    pub consistency: f32,
}

impl Default for LossWeights {
    /// algorithms.md §2 and §8.
    fn default() -> Self {
        Self {
            boundary: 1000.0,
            perturbation: 200.0,
            projection: 100.0,
            eikonal_surface: 3.0,
            eikonal_space: 10.0,
            occupancy: 1.0,
            consistency: 100.0,
        }
    }
}

/// −1, 0 or 1.
#[inline(always)]
pub fn sign(x: f32) -> f32 {
    if x > 0.0 {
        1.0
    } else if x < 0.0 {
        -1.0
    } else {
        0.0
    }
}

/// |f − y| and ∂/∂f.
#[inline(always)]
pub fn absolute(found: f32, label: f32) -> (f32, f32) {
    let error = found - label;
    (error.abs(), sign(error))
}

/// Binary cross-entropy of a logit against a label in 0..=1, and ∂/∂ℓ.
#[inline]
pub fn cross_entropy(logit: f32, label: f32) -> (f32, f32) {
    // softplus(ℓ) − yℓ, in the form that never overflows.
    let loss = logit.max(0.0) + (-logit.abs()).exp().ln_1p() - label * logit;
    (loss, probability(logit) - label)
}

/// max(0, f · sign ℓ̂) where ℓ̂ (a constant) is confident, and ∂/∂f: positive distance is free,
/// positive logit occupied, so the product is positive exactly where the two disagree.
#[inline]
pub fn consistency(found: f32, logit: f32) -> (f32, f32) {
    let product = found * sign(logit);
    if logit.abs() > CONFIDENT_LOGIT && product > 0.0 { (product, sign(logit)) } else { (0.0, 0.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn difference(f: impl Fn(f32) -> f32, at: f32) -> f32 {
        (f(at + 1e-3) - f(at - 1e-3)) / 2e-3
    }

    #[test]
    fn derivatives_are_central_differences() {
        for (x, y) in [(0.3, 0.1), (-0.4, 0.2), (2.5, 0.75), (-3.0, 1.0)] {
            let expected = difference(|x| absolute(x, y).0, x);
            assert!((absolute(x, y).1 - expected).abs() < 1e-3);
            let expected = difference(|x| cross_entropy(x, y).0, x);
            assert!((cross_entropy(x, y).1 - expected).abs() < 1e-3, "{x} {y}");
            for logit in [2.5, -2.5, 1.0] {
                let expected = difference(|x| consistency(x, logit).0, x);
                assert!((consistency(x, logit).1 - expected).abs() < 1e-3, "{x} {logit}");
            }
        }
        assert_eq!(consistency(0.2, 2.5), (0.2, 1.0), "free by distance, occupied by logit");
        assert_eq!(consistency(0.2, 1.1), (0.0, 0.0), "a surface label teaches nothing");
    }

    #[test]
    fn eikonal_derivatives_are_central_differences() {
        let around = [0.02, -0.03, 0.05, -0.01, 0.015, -0.02];
        for stencil in [Stencil::Central, Stencil::Forward] {
            let (_, by_centre, by_around) = stencil.eikonal(0.001, &around);
            let step = 1e-4;
            let f = |by| stencil.eikonal(0.001 + by, &around).0;
            let expected = (f(step) - f(-step)) / (2.0 * step);
            assert!((by_centre - expected).abs() < 0.05, "{by_centre} {expected}");
            for i in 0..stencil.offsets().len() {
                let f = |by: f32| {
                    let mut around = around;
                    around[i] += by;
                    stencil.eikonal(0.001, &around).0
                };
                let expected = (f(step) - f(-step)) / (2.0 * step);
                assert!((by_around[i] - expected).abs() < 0.05, "{} {expected}", by_around[i]);
            }
        }
    }

    #[test]
    fn a_flat_field_has_a_finite_derivative() {
        let (loss, _, by_around) = Stencil::Central.eikonal(0.5, &[0.5; 6]);
        assert!((loss - 1.0).abs() < 1e-5 && by_around.iter().all(|b| b.is_finite()));
    }
}
