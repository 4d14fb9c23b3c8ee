//! Numbers of 16 bits for codes at rest.

/// An IEEE half: 11 bits of fraction, so that a coefficient of a code, which is never larger than
/// 1, is off by at most one part in 2048, or by 3 · 10⁻⁸. The halves of
/// [`crate::geometry::simd`] are eight times as coarse: too much where all features share most of
/// their direction, so that scores of different texts are close.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(transparent)]
pub(super) struct F16(pub(super) u16);

/// 2¹¹², from the exponents of a half to those of an `f32`.
const LIFT: f32 = f32::from_bits((127 + 112) << 23);
/// The largest finite half.
const MAX: f32 = 65_504.0;

impl F16 {
    /// The nearest half of a finite number, of two that are equally near the even one; what is too
    /// large becomes the largest.
    #[inline(always)]
    pub(super) fn nearest(x: f32) -> Self {
        let magnitude = x.abs().min(MAX);
        let sign = (x.to_bits() >> 16) as u16 & 0x8000;
        // Below 2⁻¹⁴ a half's steps are all 2⁻²⁴; the sum with 0.5 rounds to them.
        let bits = if magnitude < f32::from_bits((127 - 14) << 23) {
            (magnitude + 0.5).to_bits() - 0.5f32.to_bits()
        } else {
            let bits = magnitude.to_bits() - (112 << 23);
            (bits + 0xfff + (bits >> 13 & 1)) >> 13
        };
        Self(sign | bits as u16)
    }

    /// The number, exactly.
    #[inline(always)]
    pub(super) fn widen(self) -> f32 {
        let bits = u32::from(self.0);
        let magnitude = f32::from_bits((bits & 0x7fff) << 13) * LIFT;
        f32::from_bits(magnitude.to_bits() | (bits & 0x8000) << 16)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_half_comes_back_and_every_number_gets_the_nearest() {
        for bits in (0..0x7c00).chain(0x8000..0xfc00) {
            assert_eq!(F16::nearest(F16(bits).widen()), F16(bits), "{bits:x}");
        }
        assert_eq!(F16(0x3c00).widen(), 1.0);
        assert_eq!(F16(0x0001).widen(), 2f32.powi(-24));
        assert_eq!(F16(0xfbff).widen(), -MAX);
        for bits in 0..0x7bff {
            let [low, high] = [bits, bits + 1].map(|bits| F16(bits).widen());
            let middle = 0.5 * (low + high);
            assert_eq!(F16::nearest(middle), F16(bits + (bits & 1)), "even of two: {middle}");
            assert_eq!(F16::nearest(low + 0.49 * (high - low)), F16(bits));
            assert_eq!(F16::nearest(-(low + 0.51 * (high - low))), F16(0x8001 + bits));
        }
        assert_eq!(F16::nearest(1e30).widen(), MAX);
    }
}
