//! SIMD lanes: one generic kernel body, compiled for the instruction sets that exist and chosen at
//! run time, so that one binary runs on any x86-64 or aarch64 machine.
//!
//! A [`Kernel`] body is `#[inline(always)]` all the way down, so that it is compiled inside the
//! `#[target_feature]` entry point that [`InstructionSet::run`] picks. Invariant: the AVX lane
//! types are named only by those entry points, which are reached only after the run-time check.

#[cfg(target_arch = "x86_64")]
mod x86;

use std::ops::{Add, Deref, DerefMut, Mul, Sub};

/// Numbers in one 64-byte cache line, the widest vector of any instruction set here.
pub const LINE: usize = 16;

/// One cache line of numbers.
#[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C, align(64))]
pub struct Line(pub [f32; LINE]);

impl Line {
    pub const ZERO: Self = Self([0.0; LINE]);
}

/// A growable block of numbers that starts on a cache line; its length is a multiple of [`LINE`].
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Lines(Vec<Line>);

impl Lines {
    /// Zeros for at least `len` numbers.
    pub fn zeros(len: usize) -> Self {
        Self(vec![Line::ZERO; len.div_ceil(LINE)])
    }
}

impl Deref for Lines {
    type Target = [f32];

    fn deref(&self) -> &[f32] {
        bytemuck::cast_slice(&self.0)
    }
}

impl DerefMut for Lines {
    fn deref_mut(&mut self) -> &mut [f32] {
        bytemuck::cast_slice_mut(&mut self.0)
    }
}

/// The upper half of an `f32`: its sign, its exponent and 7 bits of its fraction, so that a number is
/// off by at most 0.4 %. For numbers that are read far more often than written.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(transparent)]
pub struct Half(pub u16);

impl Half {
    /// The nearest half of a finite number; of two that are equally near, the even one.
    #[inline]
    pub fn nearest(x: f32) -> Self {
        let bits = x.to_bits();
        Self((bits.saturating_add(0x7fff + (bits >> 16 & 1)) >> 16) as u16)
    }

    /// The number, exactly.
    #[inline(always)]
    pub fn widen(self) -> f32 {
        f32::from_bits(u32::from(self.0) << 16)
    }
}

/// A vector of `N` numbers; `N` divides [`LINE`].
pub(crate) trait Lanes:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self>
{
    const N: usize;

    fn splat(x: f32) -> Self;
    /// # Safety
    /// `N` numbers must be readable at `from`.
    unsafe fn read(from: *const f32) -> Self;
    /// # Safety
    /// `N` halves must be readable at `from`.
    unsafe fn read_halves(from: *const Half) -> Self;
    /// # Safety
    /// `N` numbers must be writable at `to`.
    unsafe fn write(self, to: *mut f32);
    /// `self * b + c`, fused where the instruction set fuses.
    fn mul_add(self, b: Self, c: Self) -> Self;
    /// `max(self, 0)`.
    fn relu(self) -> Self;
    /// `self` where `gate > 0`, else 0.
    fn where_positive(self, gate: Self) -> Self;
    /// `self` where `gate >= 0`, else 0.
    fn where_not_negative(self, gate: Self) -> Self;
    /// The sum over the lanes.
    fn sum(self) -> f32;
    /// `self / b`.
    fn divide(self, b: Self) -> Self;
    /// The smaller of two that are numbers.
    fn min(self, b: Self) -> Self;
    /// The larger of two that are numbers.
    fn max(self, b: Self) -> Self;
    /// `a` where `self > 0`, else `b`.
    fn choose(self, a: Self, b: Self) -> Self;
    /// Whether any lane is > 0.
    fn any_positive(self) -> bool;

    /// e^x for |x| up to 40, off by at most one part in 10⁵.
    #[inline(always)]
    fn exp(self) -> Self {
        // The Taylor series of e^(x / 64), squared six times.
        let x = self * Self::splat(1.0 / 64.0);
        let mut sum = Self::splat(1.0 / 40_320.0);
        for factor in [1.0 / 5040.0, 1.0 / 720.0, 1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0, 1.0]
        {
            sum = sum.mul_add(x, Self::splat(factor));
        }
        for _ in 0..6 {
            sum = sum * sum;
        }
        sum
    }

    /// Eight rows of four numbers as four columns of eight.
    #[inline(always)]
    fn columns(rows: [&[f32; 4]; 8]) -> [[f32; 8]; 4] {
        let mut columns = [[0.0; 8]; 4];
        for (k, row) in rows.iter().enumerate() {
            for (column, value) in columns.iter_mut().zip(*row) {
                column[k] = *value;
            }
        }
        columns
    }

    /// The `N` numbers from `at`.
    #[inline(always)]
    fn load(from: &[f32], at: usize) -> Self {
        let lanes = &from[at..at + Self::N];
        // SAFETY: the slice holds N numbers.
        unsafe { Self::read(lanes.as_ptr()) }
    }

    /// The `N` halves from `at`.
    #[inline(always)]
    fn load_halves(from: &[Half], at: usize) -> Self {
        let lanes = &from[at..at + Self::N];
        // SAFETY: the slice holds N halves.
        unsafe { Self::read_halves(lanes.as_ptr()) }
    }

    /// Writes the `N` numbers from `at`.
    #[inline(always)]
    fn store(self, to: &mut [f32], at: usize) {
        let lanes = &mut to[at..at + Self::N];
        // SAFETY: the slice holds N numbers.
        unsafe { self.write(lanes.as_mut_ptr()) }
    }
}

/// A computation whose body is generic over the lanes.
pub(crate) trait Kernel {
    type Output;

    /// The body; must be `#[inline(always)]`, and so must all it calls with `L`.
    fn run<L: Lanes>(self) -> Self::Output;
}

/// The instruction sets that a kernel is compiled for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InstructionSet {
    /// Plain code in groups of four, which every compiler target turns into its 128-bit vectors.
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl InstructionSet {
    /// The best that this machine runs.
    pub fn detect() -> Self {
        Self::available().last().copied().unwrap_or(Self::Portable)
    }

    /// All that this machine runs, from the narrowest.
    pub fn available() -> Vec<Self> {
        let mut sets = vec![Self::Portable];
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
                sets.push(Self::Avx2);
                if is_x86_feature_detected!("avx512f") {
                    sets.push(Self::Avx512);
                }
            }
        }
        sets
    }

    /// Runs a kernel with this instruction set, which must be one of [`Self::available`].
    #[inline]
    pub(crate) fn run<K: Kernel>(self, kernel: K) -> K::Output {
        match self {
            Self::Portable => kernel.run::<Four>(),
            // SAFETY: sets come from `available`, which asked the processor.
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => unsafe { x86::run_avx2(kernel) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => unsafe { x86::run_avx512(kernel) },
        }
    }
}

/// Four lanes of plain code.
#[derive(Clone, Copy)]
pub(crate) struct Four([f32; 4]);

impl Four {
    #[inline(always)]
    fn zip(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        Self(std::array::from_fn(|i| f(self.0[i], other.0[i])))
    }
}

impl Add for Four {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.zip(other, |a, b| a + b)
    }
}

impl Sub for Four {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.zip(other, |a, b| a - b)
    }
}

impl Mul for Four {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.zip(other, |a, b| a * b)
    }
}

impl Lanes for Four {
    const N: usize = 4;

    #[inline(always)]
    fn splat(x: f32) -> Self {
        Self([x; 4])
    }

    #[inline(always)]
    unsafe fn read(from: *const f32) -> Self {
        // SAFETY: the caller's promise.
        Self(unsafe { from.cast::<[f32; 4]>().read_unaligned() })
    }

    #[inline(always)]
    unsafe fn read_halves(from: *const Half) -> Self {
        // SAFETY: the caller's promise.
        Self(unsafe { from.cast::<[Half; 4]>().read_unaligned() }.map(Half::widen))
    }

    #[inline(always)]
    unsafe fn write(self, to: *mut f32) {
        // SAFETY: the caller's promise.
        unsafe { to.cast::<[f32; 4]>().write_unaligned(self.0) }
    }

    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        // Fused is one instruction on aarch64 and a library call on plain x86-64.
        if cfg!(target_arch = "aarch64") {
            Self(std::array::from_fn(|i| self.0[i].mul_add(b.0[i], c.0[i])))
        } else {
            self * b + c
        }
    }

    #[inline(always)]
    fn relu(self) -> Self {
        Self(self.0.map(|x| if x > 0.0 { x } else { 0.0 }))
    }

    #[inline(always)]
    fn where_positive(self, gate: Self) -> Self {
        self.zip(gate, |x, g| if g > 0.0 { x } else { 0.0 })
    }

    #[inline(always)]
    fn where_not_negative(self, gate: Self) -> Self {
        self.zip(gate, |x, g| if g >= 0.0 { x } else { 0.0 })
    }

    #[inline(always)]
    fn sum(self) -> f32 {
        (self.0[0] + self.0[2]) + (self.0[1] + self.0[3])
    }

    #[inline(always)]
    fn divide(self, b: Self) -> Self {
        self.zip(b, |x, y| x / y)
    }

    #[inline(always)]
    fn min(self, b: Self) -> Self {
        self.zip(b, |x, y| if x < y { x } else { y })
    }

    #[inline(always)]
    fn max(self, b: Self) -> Self {
        self.zip(b, |x, y| if x > y { x } else { y })
    }

    #[inline(always)]
    fn choose(self, a: Self, b: Self) -> Self {
        Self(std::array::from_fn(|i| if self.0[i] > 0.0 { a.0[i] } else { b.0[i] }))
    }

    #[inline(always)]
    fn any_positive(self) -> bool {
        (self.0[0] > 0.0) | (self.0[1] > 0.0) | (self.0[2] > 0.0) | (self.0[3] > 0.0)
    }
}

/// Asks for the cache line at `at`, which will be read soon; only a hint.
#[inline(always)]
pub(crate) fn prefetch<T>(at: &T) {
    // SAFETY: a prefetch has no effect that a program can observe, at any address.
    #[cfg(target_arch = "x86_64")]
    unsafe {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        _mm_prefetch::<_MM_HINT_T0>(std::ptr::from_ref(at).cast());
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = at;
}

#[cfg(test)]
mod tests {
    use super::*;

    struct EveryOperation;

    impl Kernel for EveryOperation {
        type Output = Vec<f32>;

        #[inline(always)]
        fn run<L: Lanes>(self) -> Vec<f32> {
            let a: Vec<f32> = (0..16).map(|i| i as f32 - 7.0).collect();
            let b: Vec<f32> = (0..16).map(|i| ((i * 5) % 16) as f32 - 8.0).collect();
            let halves: Vec<Half> = b.iter().map(|b| Half::nearest(0.3 * b)).collect();
            let mut out = vec![f32::NAN; 16 * 12];
            let mut sum = 0.0;
            let (mut any, mut none) = (false, false);
            for at in (0..16).step_by(L::N) {
                let (x, y) = (L::load(&a, at), L::load(&b, at));
                (x + y).store(&mut out, at);
                (x - y).store(&mut out, 16 + at);
                (x * y).store(&mut out, 32 + at);
                x.mul_add(y, L::splat(0.5)).store(&mut out, 48 + at);
                x.relu().store(&mut out, 64 + at);
                y.where_positive(x).store(&mut out, 80 + at);
                y.where_not_negative(x).store(&mut out, 96 + at);
                L::load_halves(&halves, at).store(&mut out, 112 + at);
                x.divide(y + L::splat(0.5)).store(&mut out, 128 + at);
                x.min(y).store(&mut out, 144 + at);
                x.max(y).store(&mut out, 160 + at);
                x.choose(y, L::splat(0.25)).store(&mut out, 176 + at);
                // Of all lanes the last alone, and none.
                any |= (x - L::splat(7.5)).any_positive();
                none |= (x - L::splat(8.0)).any_positive();
                sum += (x * y).sum();
            }
            out.push(sum);
            out.extend([any, none].map(|any| f32::from(u8::from(any))));
            let rows: [[f32; 4]; 8] = std::array::from_fn(|k| [a[k], b[k], a[k + 8], b[k + 8]]);
            out.extend(L::columns(rows.each_ref()).as_flattened());
            out
        }
    }

    #[test]
    fn halves_are_the_nearest() {
        for i in 0..200_000u32 {
            let x = f32::from_bits(i.wrapping_mul(0x9e37_79b9));
            // The largest numbers are infinite as halves.
            if !x.is_normal() || x.abs() > 1e38 {
                continue;
            }
            let half = Half::nearest(x);
            let error = (half.widen() - x).abs();
            for other in [half.0.wrapping_sub(1), half.0.wrapping_add(1)] {
                let other = (Half(other).widen() - x).abs();
                assert!(other.is_nan() || other >= error, "{x}");
            }
        }
        assert_eq!(Half::nearest(0.0), Half(0));
        assert_eq!(Half::nearest(-1.5).widen(), -1.5);
        assert_eq!(Half::nearest(1.0 + 1.0 / 256.0).widen(), 1.0, "the even one of two");
    }

    struct Exponentials(Vec<f32>);

    impl Kernel for Exponentials {
        type Output = Vec<f32>;

        #[inline(always)]
        fn run<L: Lanes>(mut self) -> Vec<f32> {
            for at in (0..self.0.len()).step_by(L::N) {
                L::load(&self.0, at).exp().store(&mut self.0, at);
            }
            self.0
        }
    }

    #[test]
    fn exponentials_are_close() {
        let xs: Vec<f32> = (-400..400).map(|i| 0.1 * i as f32).collect();
        for set in InstructionSet::available() {
            for (x, found) in xs.iter().zip(set.run(Exponentials(xs.clone()))) {
                let expected = f64::from(*x).exp();
                let error = f64::from(found) / expected - 1.0;
                assert!(error.abs() < 1e-5, "{set:?}, {x}: {error}");
            }
        }
    }

    #[test]
    fn every_set_computes_the_same() {
        let expected = InstructionSet::Portable.run(EveryOperation);
        assert!(expected.iter().all(|x| x.is_finite()));
        assert_eq!(expected[16 * 12 + 3 + 8 * 3 + 2], -6.0, "b[10]");
        assert_eq!(expected[16 * 12 + 1..][..2], [1.0, 0.0], "any, and none: 0 is not positive");
        assert_eq!(expected[80 + 7], 0.0, "a gate of exactly 0 is not positive");
        assert_ne!(expected[96 + 7], 0.0, "a gate of exactly 0 is not negative");
        for set in InstructionSet::available() {
            assert_eq!(set.run(EveryOperation), expected, "{set:?}");
        }
    }
}
