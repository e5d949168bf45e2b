//! Vectors of numbers, for every machine and for those with AVX2, chosen as the program runs.
//!
//! Both do the same operations in the same order and contract nothing (no fused multiply-add), so that the
//! results are the same to the bit; tests compare them. `cargo run -p granita-benches --bin rays` measures what
//! it brings.
//!
//! The only unsafe code of the crate: intrinsics that need what was found to be there, calls of functions
//! compiled for it, and a word to the system about large memory.

#![allow(unsafe_code, reason = "AVX2; measured by the bench of rays")]

/// Numbers that nodes are tested with.
pub(crate) const WIDE: usize = 8;
/// Numbers that triangles are tested with.
pub(crate) const NARROW: usize = 4;

/// Operations on vectors. Comparisons with NaN are false.
pub(crate) trait Simd: Copy {
    /// Eight numbers.
    type F8: Copy;
    /// Four numbers.
    type F4: Copy;

    fn splat8(self, x: f32) -> Self::F8;
    /// Of the bits of the numbers.
    fn load8(self, x: &[u32; WIDE]) -> Self::F8;
    fn store8(self, x: Self::F8) -> [f32; WIDE];
    fn add8(self, a: Self::F8, b: Self::F8) -> Self::F8;
    fn sub8(self, a: Self::F8, b: Self::F8) -> Self::F8;
    fn mul8(self, a: Self::F8, b: Self::F8) -> Self::F8;
    /// `a < b ? a : b`: the second when one is NaN.
    fn min8(self, a: Self::F8, b: Self::F8) -> Self::F8;
    /// `a > b ? a : b`: the second when one is NaN.
    fn max8(self, a: Self::F8, b: Self::F8) -> Self::F8;
    /// Bit `i` says `a[i] <= b[i]`.
    fn le8(self, a: Self::F8, b: Self::F8) -> u32;

    fn splat4(self, x: f32) -> Self::F4;
    fn load4(self, x: &[f32; NARROW]) -> Self::F4;
    fn sub4(self, a: Self::F4, b: Self::F4) -> Self::F4;
    fn mul4(self, a: Self::F4, b: Self::F4) -> Self::F4;
    /// As [`Simd::min8`].
    fn min4(self, a: Self::F4, b: Self::F4) -> Self::F4;
    /// As [`Simd::max8`].
    fn max4(self, a: Self::F4, b: Self::F4) -> Self::F4;
    /// As [`Simd::le8`].
    fn le4(self, a: Self::F4, b: Self::F4) -> u32;

    /// Asks for what lies there to be brought near.
    fn prefetch<T>(self, at: &T);
}

/// Code that is written once and compiled for each kind of vectors.
pub(crate) trait Kernel {
    /// Runs it. Implementations are `#[inline(always)]`, so that they are compiled for the machine that `s` stands for.
    fn run<S: Simd>(self, s: S);
}

/// What every machine can do; compilers make SSE or NEON of it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Portable;

#[inline(always)]
fn each<const N: usize>(a: [f32; N], b: [f32; N], f: impl Fn(f32, f32) -> f32) -> [f32; N] {
    let mut out = [0.0; N];
    for i in 0..N {
        out[i] = f(a[i], b[i]);
    }
    out
}

#[inline(always)]
fn le<const N: usize>(a: [f32; N], b: [f32; N]) -> u32 {
    let mut mask = 0;
    for i in 0..N {
        mask |= u32::from(a[i] <= b[i]) << i;
    }
    mask
}

#[inline(always)]
fn lesser(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

#[inline(always)]
fn greater(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[rustfmt::skip]
impl Simd for Portable {
    type F8 = [f32; WIDE];
    type F4 = [f32; NARROW];

    #[inline(always)] fn splat8(self, x: f32) -> Self::F8 { [x; WIDE] }
    #[inline(always)] fn load8(self, x: &[u32; WIDE]) -> Self::F8 { x.map(f32::from_bits) }
    #[inline(always)] fn store8(self, x: Self::F8) -> [f32; WIDE] { x }
    #[inline(always)] fn add8(self, a: Self::F8, b: Self::F8) -> Self::F8 { each(a, b, |a, b| a + b) }
    #[inline(always)] fn sub8(self, a: Self::F8, b: Self::F8) -> Self::F8 { each(a, b, |a, b| a - b) }
    #[inline(always)] fn mul8(self, a: Self::F8, b: Self::F8) -> Self::F8 { each(a, b, |a, b| a * b) }
    #[inline(always)] fn min8(self, a: Self::F8, b: Self::F8) -> Self::F8 { each(a, b, lesser) }
    #[inline(always)] fn max8(self, a: Self::F8, b: Self::F8) -> Self::F8 { each(a, b, greater) }
    #[inline(always)] fn le8(self, a: Self::F8, b: Self::F8) -> u32 { le(a, b) }
    #[inline(always)] fn splat4(self, x: f32) -> Self::F4 { [x; NARROW] }
    #[inline(always)] fn load4(self, x: &[f32; NARROW]) -> Self::F4 { *x }
    #[inline(always)] fn sub4(self, a: Self::F4, b: Self::F4) -> Self::F4 { each(a, b, |a, b| a - b) }
    #[inline(always)] fn mul4(self, a: Self::F4, b: Self::F4) -> Self::F4 { each(a, b, |a, b| a * b) }
    #[inline(always)] fn min4(self, a: Self::F4, b: Self::F4) -> Self::F4 { each(a, b, lesser) }
    #[inline(always)] fn max4(self, a: Self::F4, b: Self::F4) -> Self::F4 { each(a, b, greater) }
    #[inline(always)] fn le4(self, a: Self::F4, b: Self::F4) -> u32 { le(a, b) }
    #[inline(always)] fn prefetch<T>(self, _: &T) {}
}

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use super::{Kernel, NARROW, Simd, WIDE};
    use std::arch::x86_64::*;

    /// The right to use AVX2: exists only where the machine has it.
    #[derive(Clone, Copy, Debug)]
    pub(crate) struct Avx2(());

    impl Avx2 {
        /// `None` on machines without AVX2.
        pub(crate) fn new() -> Option<Self> {
            // The standard library remembers the answer.
            std::arch::is_x86_feature_detected!("avx2").then_some(Self(()))
        }
    }

    // SAFETY of all blocks: `self` exists, so the machine has AVX2; loads and stores are unaligned, through
    // references to arrays of the right size.
    #[rustfmt::skip]
    #[allow(clippy::undocumented_unsafe_blocks, reason = "one reason for all of them, above")]
    impl Simd for Avx2 {
        type F8 = __m256;
        type F4 = __m128;

        #[inline(always)] fn splat8(self, x: f32) -> __m256 { unsafe { _mm256_set1_ps(x) } }
        #[inline(always)] fn load8(self, x: &[u32; WIDE]) -> __m256 { unsafe { _mm256_loadu_ps(x.as_ptr().cast()) } }
        #[inline(always)] fn store8(self, x: __m256) -> [f32; WIDE] {
            let mut out = [0.0; WIDE];
            unsafe { _mm256_storeu_ps(out.as_mut_ptr(), x) };
            out
        }
        #[inline(always)] fn add8(self, a: __m256, b: __m256) -> __m256 { unsafe { _mm256_add_ps(a, b) } }
        #[inline(always)] fn sub8(self, a: __m256, b: __m256) -> __m256 { unsafe { _mm256_sub_ps(a, b) } }
        #[inline(always)] fn mul8(self, a: __m256, b: __m256) -> __m256 { unsafe { _mm256_mul_ps(a, b) } }
        #[inline(always)] fn min8(self, a: __m256, b: __m256) -> __m256 { unsafe { _mm256_min_ps(a, b) } }
        #[inline(always)] fn max8(self, a: __m256, b: __m256) -> __m256 { unsafe { _mm256_max_ps(a, b) } }
        #[inline(always)] fn le8(self, a: __m256, b: __m256) -> u32 {
            unsafe { _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LE_OQ>(a, b)) as u32 }
        }
        #[inline(always)] fn splat4(self, x: f32) -> __m128 { unsafe { _mm_set1_ps(x) } }
        #[inline(always)] fn load4(self, x: &[f32; NARROW]) -> __m128 { unsafe { _mm_loadu_ps(x.as_ptr()) } }
        #[inline(always)] fn sub4(self, a: __m128, b: __m128) -> __m128 { unsafe { _mm_sub_ps(a, b) } }
        #[inline(always)] fn mul4(self, a: __m128, b: __m128) -> __m128 { unsafe { _mm_mul_ps(a, b) } }
        #[inline(always)] fn min4(self, a: __m128, b: __m128) -> __m128 { unsafe { _mm_min_ps(a, b) } }
        #[inline(always)] fn max4(self, a: __m128, b: __m128) -> __m128 { unsafe { _mm_max_ps(a, b) } }
        #[inline(always)] fn le4(self, a: __m128, b: __m128) -> u32 {
            unsafe { _mm_movemask_ps(_mm_cmple_ps(a, b)) as u32 }
        }
        #[inline(always)] fn prefetch<T>(self, at: &T) {
            let lines = std::ptr::from_ref(at).cast::<i8>();
            // Addresses only; what is behind the last whole line may be asked for as well.
            for line in 0..size_of::<T>().div_ceil(64) {
                unsafe { _mm_prefetch::<_MM_HINT_T0>(lines.wrapping_add(line * 64)) };
            }
            if align_of::<T>() < 32 {
                unsafe { _mm_prefetch::<_MM_HINT_T0>(lines.wrapping_add(size_of::<T>() - 1)) };
            }
        }
    }

    /// [`Kernel::run`], compiled for AVX2.
    #[target_feature(enable = "avx2")]
    pub(super) fn run(token: Avx2, kernel: impl Kernel) {
        kernel.run(token);
    }
}

#[cfg(target_arch = "x86_64")]
use avx2::Avx2;

/// An empty list with room for `n`, in large pages where the system has them for who asks: rays look here and there in
/// it, and what the processor knows of small pages would not suffice (a third more incoherent rays a second).
pub(crate) fn with_large_pages<T>(n: usize) -> Vec<T> {
    let list: Vec<T> = Vec::with_capacity(n);
    #[cfg(target_os = "linux")]
    {
        const PAGE: usize = 4096;
        let bytes = n * size_of::<T>();
        let first = list.as_ptr().cast::<u8>();
        let skip = first.align_offset(PAGE);
        let start = first.wrapping_add(skip);
        if let Some(length) = bytes.checked_sub(skip).map(|b| b / PAGE * PAGE).filter(|b| *b >= LARGE) {
            // SAFETY: the whole pages of memory that the list owns; the advice changes nothing of what is there, and
            // whether it is taken does not matter.
            unsafe { libc::madvise(start.cast_mut().cast(), length, libc::MADV_HUGEPAGE) };
        }
    }
    list
}

/// Bytes for which large pages are asked.
#[cfg(target_os = "linux")]
const LARGE: usize = 4 << 20;

/// Runs a kernel with the widest vectors that the machine has.
#[inline]
pub(crate) fn dispatch(kernel: impl Kernel) {
    #[cfg(target_arch = "x86_64")]
    if let Some(token) = Avx2::new() {
        // SAFETY: the machine has AVX2, which is all that the function asks for.
        return unsafe { avx2::run(token, kernel) };
    }
    kernel.run(Portable);
}
