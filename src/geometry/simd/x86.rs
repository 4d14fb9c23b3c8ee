//! The lanes of x86-64 beyond its baseline.
#![allow(
    clippy::undocumented_unsafe_blocks,
    reason = "one proof for all: these types are named only behind the run-time check of \
              `InstructionSet`, so the intrinsics exist; pointers are the caller's promise"
)]

use std::arch::x86_64::*;
use std::ops::{Add, Mul, Sub};

use super::{Half, Kernel, Lanes};

#[target_feature(enable = "avx2,fma")]
pub(super) fn run_avx2<K: Kernel>(kernel: K) -> K::Output {
    kernel.run::<Eight>()
}

#[target_feature(enable = "avx2,fma,avx512f")]
pub(super) fn run_avx512<K: Kernel>(kernel: K) -> K::Output {
    kernel.run::<Sixteen>()
}

/// Eight lanes of AVX2.
#[derive(Clone, Copy)]
pub(super) struct Eight(__m256);

/// Sixteen lanes of AVX-512.
#[derive(Clone, Copy)]
pub(super) struct Sixteen(__m512);

/// An operator of a lane type as one intrinsic.
macro_rules! operator {
    ($lanes:ident, $trait:ident, $method:ident, $intrinsic:ident) => {
        impl $trait for $lanes {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Self(unsafe { $intrinsic(self.0, other.0) })
            }
        }
    };
}

operator!(Eight, Add, add, _mm256_add_ps);
operator!(Eight, Sub, sub, _mm256_sub_ps);
operator!(Eight, Mul, mul, _mm256_mul_ps);
operator!(Sixteen, Add, add, _mm512_add_ps);
operator!(Sixteen, Sub, sub, _mm512_sub_ps);
operator!(Sixteen, Mul, mul, _mm512_mul_ps);

impl Lanes for Eight {
    const N: usize = 8;

    #[inline(always)]
    fn splat(x: f32) -> Self {
        Self(unsafe { _mm256_set1_ps(x) })
    }

    #[inline(always)]
    unsafe fn read(from: *const f32) -> Self {
        Self(unsafe { _mm256_loadu_ps(from) })
    }

    #[inline(always)]
    unsafe fn read_halves(from: *const Half) -> Self {
        Self(unsafe {
            let wide = _mm256_cvtepu16_epi32(_mm_loadu_si128(from.cast()));
            _mm256_castsi256_ps(_mm256_slli_epi32::<16>(wide))
        })
    }

    #[inline(always)]
    unsafe fn write(self, to: *mut f32) {
        unsafe { _mm256_storeu_ps(to, self.0) }
    }

    #[inline(always)]
    fn columns(rows: [&[f32; 4]; 8]) -> [[f32; 8]; 4] {
        unsafe {
            // Rows k and k + 4 share a register, so that its halves are transposed alike.
            let mut pairs = [_mm256_setzero_ps(); 4];
            for (k, pair) in pairs.iter_mut().enumerate() {
                let low = _mm256_castps128_ps256(_mm_loadu_ps(rows[k].as_ptr()));
                *pair = _mm256_insertf128_ps::<1>(low, _mm_loadu_ps(rows[k + 4].as_ptr()));
            }
            let [a, b, c, d] = pairs;
            let (ab, cd) = (_mm256_unpacklo_ps(a, b), _mm256_unpacklo_ps(c, d));
            let (ef, gh) = (_mm256_unpackhi_ps(a, b), _mm256_unpackhi_ps(c, d));
            let columns = [
                _mm256_shuffle_ps::<0x44>(ab, cd),
                _mm256_shuffle_ps::<0xee>(ab, cd),
                _mm256_shuffle_ps::<0x44>(ef, gh),
                _mm256_shuffle_ps::<0xee>(ef, gh),
            ];
            std::mem::transmute(columns)
        }
    }

    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        Self(unsafe { _mm256_fmadd_ps(self.0, b.0, c.0) })
    }

    #[inline(always)]
    fn relu(self) -> Self {
        Self(unsafe { _mm256_max_ps(self.0, _mm256_setzero_ps()) })
    }

    #[inline(always)]
    fn where_positive(self, gate: Self) -> Self {
        Self(unsafe {
            _mm256_and_ps(self.0, _mm256_cmp_ps::<_CMP_GT_OQ>(gate.0, _mm256_setzero_ps()))
        })
    }

    #[inline(always)]
    fn where_not_negative(self, gate: Self) -> Self {
        Self(unsafe {
            _mm256_and_ps(self.0, _mm256_cmp_ps::<_CMP_GE_OQ>(gate.0, _mm256_setzero_ps()))
        })
    }

    #[inline(always)]
    fn sum(self) -> f32 {
        unsafe {
            let four =
                _mm_add_ps(_mm256_castps256_ps128(self.0), _mm256_extractf128_ps::<1>(self.0));
            let two = _mm_add_ps(four, _mm_movehl_ps(four, four));
            _mm_cvtss_f32(_mm_add_ss(two, _mm_shuffle_ps::<1>(two, two)))
        }
    }

    #[inline(always)]
    fn divide(self, b: Self) -> Self {
        Self(unsafe { _mm256_div_ps(self.0, b.0) })
    }

    #[inline(always)]
    fn min(self, b: Self) -> Self {
        Self(unsafe { _mm256_min_ps(self.0, b.0) })
    }

    #[inline(always)]
    fn max(self, b: Self) -> Self {
        Self(unsafe { _mm256_max_ps(self.0, b.0) })
    }

    #[inline(always)]
    fn choose(self, a: Self, b: Self) -> Self {
        Self(unsafe {
            let gate = _mm256_cmp_ps::<_CMP_GT_OQ>(self.0, _mm256_setzero_ps());
            _mm256_blendv_ps(b.0, a.0, gate)
        })
    }

    #[inline(always)]
    fn any_positive(self) -> bool {
        unsafe {
            let gate = _mm256_cmp_ps::<_CMP_GT_OQ>(self.0, _mm256_setzero_ps());
            _mm256_movemask_ps(gate) != 0
        }
    }
}

impl Lanes for Sixteen {
    const N: usize = 16;

    #[inline(always)]
    fn splat(x: f32) -> Self {
        Self(unsafe { _mm512_set1_ps(x) })
    }

    #[inline(always)]
    unsafe fn read(from: *const f32) -> Self {
        Self(unsafe { _mm512_loadu_ps(from) })
    }

    #[inline(always)]
    unsafe fn read_halves(from: *const Half) -> Self {
        Self(unsafe {
            let wide = _mm512_cvtepu16_epi32(_mm256_loadu_si256(from.cast()));
            _mm512_castsi512_ps(_mm512_slli_epi32::<16>(wide))
        })
    }

    #[inline(always)]
    unsafe fn write(self, to: *mut f32) {
        unsafe { _mm512_storeu_ps(to, self.0) }
    }

    #[inline(always)]
    fn columns(rows: [&[f32; 4]; 8]) -> [[f32; 8]; 4] {
        Eight::columns(rows)
    }

    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        Self(unsafe { _mm512_fmadd_ps(self.0, b.0, c.0) })
    }

    #[inline(always)]
    fn relu(self) -> Self {
        Self(unsafe { _mm512_max_ps(self.0, _mm512_setzero_ps()) })
    }

    #[inline(always)]
    fn where_positive(self, gate: Self) -> Self {
        Self(unsafe {
            let mask = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(gate.0, _mm512_setzero_ps());
            _mm512_maskz_mov_ps(mask, self.0)
        })
    }

    #[inline(always)]
    fn where_not_negative(self, gate: Self) -> Self {
        Self(unsafe {
            let mask = _mm512_cmp_ps_mask::<_CMP_GE_OQ>(gate.0, _mm512_setzero_ps());
            _mm512_maskz_mov_ps(mask, self.0)
        })
    }

    #[inline(always)]
    fn sum(self) -> f32 {
        Eight(unsafe {
            _mm256_add_ps(
                _mm512_castps512_ps256(self.0),
                _mm256_castpd_ps(_mm512_extractf64x4_pd::<1>(_mm512_castps_pd(self.0))),
            )
        })
        .sum()
    }

    #[inline(always)]
    fn divide(self, b: Self) -> Self {
        Self(unsafe { _mm512_div_ps(self.0, b.0) })
    }

    #[inline(always)]
    fn min(self, b: Self) -> Self {
        Self(unsafe { _mm512_min_ps(self.0, b.0) })
    }

    #[inline(always)]
    fn max(self, b: Self) -> Self {
        Self(unsafe { _mm512_max_ps(self.0, b.0) })
    }

    #[inline(always)]
    fn choose(self, a: Self, b: Self) -> Self {
        Self(unsafe {
            let gate = _mm512_cmp_ps_mask::<_CMP_GT_OQ>(self.0, _mm512_setzero_ps());
            _mm512_mask_blend_ps(gate, b.0, a.0)
        })
    }

    #[inline(always)]
    fn any_positive(self) -> bool {
        unsafe { _mm512_cmp_ps_mask::<_CMP_GT_OQ>(self.0, _mm512_setzero_ps()) != 0 }
    }
}
