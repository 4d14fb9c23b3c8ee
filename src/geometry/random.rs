//! Counter-based random numbers: a pure function of (seed, epoch, stream, index), so that both
//! backends draw the same samples in any order and on any number of threads.

/// Four hashed words. Jarzynski and Olano, "Hash Functions for GPU Rendering" (JCGT 2020), pcg4d;
/// 32-bit operations only, so that WGSL computes the same.
#[inline]
pub fn pcg4d(mut v: [u32; 4]) -> [u32; 4] {
    for x in &mut v {
        *x = x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
    }
    mix(&mut v);
    for x in &mut v {
        *x ^= *x >> 16;
    }
    mix(&mut v);
    v
}

#[inline]
fn mix(v: &mut [u32; 4]) {
    v[0] = v[0].wrapping_add(v[1].wrapping_mul(v[3]));
    v[1] = v[1].wrapping_add(v[2].wrapping_mul(v[0]));
    v[2] = v[2].wrapping_add(v[0].wrapping_mul(v[1]));
    v[3] = v[3].wrapping_add(v[1].wrapping_mul(v[2]));
}

/// A uniform number in [0, 1) from the upper 24 bits of a word.
#[inline]
pub fn unit(word: u32) -> f32 {
    (word >> 8) as f32 * (1.0 / (1u32 << 24) as f32)
}

/// A standard normal number from two words (Box–Muller).
#[inline]
pub fn normal(a: u32, b: u32) -> f32 {
    let radius = (-2.0 * (1.0 - unit(a)).ln()).sqrt();
    radius * (std::f32::consts::TAU * unit(b)).cos()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn uniform_and_normal_have_the_right_moments() {
        let n = 40_000u32;
        let (mut mean, mut normal_mean, mut normal_square) = (0.0f64, 0.0f64, 0.0f64);
        for i in 0..n {
            let w = pcg4d([7, 1, 0, i]);
            mean += f64::from(unit(w[0]));
            let z = f64::from(normal(w[1], w[2]));
            normal_mean += z;
            normal_square += z * z;
        }
        let n = f64::from(n);
        assert!((mean / n - 0.5).abs() < 0.01);
        assert!((normal_mean / n).abs() < 0.02);
        assert!((normal_square / n - 1.0).abs() < 0.03);
    }
}
