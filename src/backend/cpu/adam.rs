//! Adam, with the step count of whatever is stepped (paper eq:onlineadam).

pub(in crate::backend) const BETA1: f32 = 0.9;
pub(in crate::backend) const BETA2: f32 = 0.999;
pub(in crate::backend) const EPSILON: f32 = 1e-8;
/// Step counts whose corrections are tabulated.
const TABLE: u32 = 4096;

/// 1 / (1 − β₁ᵗ) and 1 / (1 − β₂ᵗ).
pub(super) struct Corrections(Vec<[f32; 2]>);

impl Corrections {
    pub(super) fn new() -> Self {
        Self((0..=TABLE).map(|t| Self::compute(t.max(1))).collect())
    }

    /// The corrections of the t-th step, t ≥ 1.
    #[inline]
    pub(super) fn at(&self, t: u32) -> [f32; 2] {
        self.0.get(t as usize).copied().unwrap_or_else(|| Self::compute(t))
    }

    pub(super) fn compute(t: u32) -> [f32; 2] {
        [BETA1, BETA2].map(|beta| (1.0 / (1.0 - f64::from(beta).powf(f64::from(t)))) as f32)
    }
}

/// One step of some parameters that share a step count.
#[inline]
pub(super) fn step(
    values: &mut [f32],
    (first, second): (&mut [f32], &mut [f32]),
    gradient: &[f32],
    corrections: [f32; 2],
    rate: f32,
) {
    for (((value, m), v), g) in values.iter_mut().zip(first).zip(second).zip(gradient) {
        *m = BETA1 * *m + (1.0 - BETA1) * g;
        *v = BETA2 * *v + (1.0 - BETA2) * g * g;
        *value -= rate * (*m * corrections[0]) / ((*v * corrections[1]).sqrt() + EPSILON);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn follows_the_textbook_with_its_own_step_count() {
        let corrections = Corrections::new();
        let (mut x, mut m, mut v) = ([0.5f32], [0.0f32], [0.0f32]);
        let (mut xr, mut mr, mut vr) = (0.5f64, 0.0f64, 0.0f64);
        for t in 1..=50u32 {
            let g = (f64::from(t) * 0.7).sin() + 0.2;
            step(&mut x, (&mut m, &mut v), &[g as f32], corrections.at(t), 0.01);
            mr = 0.9 * mr + 0.1 * g;
            vr = 0.999 * vr + 0.001 * g * g;
            let (mh, vh) =
                (mr / (1.0 - 0.9f64.powi(t as i32)), vr / (1.0 - 0.999f64.powi(t as i32)));
            xr -= 0.01 * mh / (vh.sqrt() + 1e-8);
            assert!((f64::from(x[0]) - xr).abs() < 1e-5, "step {t}: {} {xr}", x[0]);
        }
    }

    #[test]
    fn the_first_step_moves_by_the_rate() {
        let (mut x, mut m, mut v) = ([0.0f32], [0.0f32], [0.0f32]);
        step(&mut x, (&mut m, &mut v), &[-3.0], Corrections::new().at(1), 1e-3);
        assert!((x[0] - 1e-3).abs() < 1e-7);
    }

    #[test]
    fn corrections_go_on_behind_the_table() {
        let corrections = Corrections::new();
        let [a, b] = [corrections.at(TABLE), corrections.at(TABLE + 1)];
        assert!(a[1] > b[1] && a[1] - b[1] < 1e-4);
        assert_eq!(corrections.at(u32::MAX), [1.0, 1.0]);
    }
}
