//! How much light a surface takes: NeuS in segments (algorithms.md §7).
//!
//! With Φ(f) = 1 / (1 + e^(−s f)) a segment from f_in to f_out lets the share
//! min(1, Φ(f_out) / Φ(f_in)) pass. That is e^(−σδ) with σδ = max(0, softplus(−s f_out) −
//! softplus(−s f_in)): it does not depend on the segment's length, and segments multiply to what
//! one over all of them lets pass.

/// A ray ends where less than this passes.
pub const LEAST_LIGHT: f32 = 1e-4;

/// Beyond this many 1/s, Φ is 0 or 1 for what an image can show, and its quotients stay finite.
pub const REACH: f32 = 40.0;

/// Beyond this many 1/s in front of it, a surface takes less than 0.3 % of the light.
pub const FAR: f32 = 6.0;

/// Φ.
#[inline(always)]
pub fn lit(f_m: f32, sharpness: f32) -> f32 {
    1.0 / (1.0 + (-(sharpness * f_m).clamp(-REACH, REACH)).exp())
}

/// The share of light that passes a segment.
#[inline(always)]
pub fn passes(f_in: f32, f_out: f32, sharpness: f32) -> f32 {
    (lit(f_out, sharpness) / lit(f_in, sharpness)).min(1.0)
}

/// Where in a segment, 0..=1, the light has fallen to the share `passed`, if f is linear in it.
pub fn place_of(passed: f32, f_in: f32, f_out: f32, sharpness: f32) -> f32 {
    let lit = passed * lit(f_in, sharpness);
    let f = (lit / (1.0 - lit).max(f32::MIN_POSITIVE)).ln() / sharpness;
    ((f_in - f) / (f_in - f_out)).clamp(0.0, 1.0)
}

/// Where in a segment, 0..=1, half of what it takes is taken, if f is linear in it. For a surface
/// that is crossed well inside the segment this is its zero crossing.
pub fn middle(f_in: f32, f_out: f32, sharpness: f32) -> f32 {
    place_of(0.5 + 0.5 * passes(f_in, f_out, sharpness), f_in, f_out, sharpness)
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: f32 = 200.0;

    #[test]
    fn a_surface_takes_all_light_and_a_segment_cut_in_two_takes_the_same() {
        assert!(passes(0.2, -0.2, S) < 1e-6);
        assert!(passes(0.2, 0.1, S) > 1.0 - 1e-6);
        assert_eq!(passes(-0.02, 0.05, S), 1.0, "from behind it takes none");
        let whole = passes(0.03, -0.01, S);
        let halves = passes(0.03, 0.002, S) * passes(0.002, -0.01, S);
        assert!((whole - halves).abs() < 1e-6, "{whole} {halves}");
        assert!((passes(0.2, 0.0, S) - 0.5).abs() < 1e-6, "half is taken before the surface");
        assert!(passes(-10.0, 10.0, 2000.0).is_finite() && passes(10.0, -10.0, 2000.0) < 1e-6);
    }

    #[test]
    fn it_is_the_softplus_form() {
        let softplus = |x: f64| x.max(0.0) + (-x.abs()).exp().ln_1p();
        for (a, b) in [(0.04, 0.01), (0.01, -0.01), (-0.01, -0.03), (0.0, 0.02)] {
            let s = f64::from(S);
            let depth = (softplus(-s * b) - softplus(-s * a)).max(0.0);
            let error = f64::from(passes(a as f32, b as f32, S)) - (-depth).exp();
            assert!(error.abs() < 1e-6, "{a} {b}: {error}");
        }
    }

    #[test]
    fn the_middle_halves_what_is_taken() {
        for (a, b) in [(0.04, -0.06), (0.03, 0.001), (-0.002, -0.03)] {
            let f = a + (b - a) * middle(a, b, S);
            let (first, whole) = (1.0 - passes(a, f, S), 1.0 - passes(a, b, S));
            assert!((first - 0.5 * whole).abs() < 1e-3, "{a} {b}: {first} {whole}");
        }
        assert!((middle(0.05, -0.05, S) - 0.5).abs() < 1e-4, "the zero crossing");
    }
}
