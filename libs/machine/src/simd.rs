//! Vectors of numbers, for every machine and for machines with AVX2, selected when the program runs.
//!
//! Code is written once over the trait [`Simd`], as a [`Kernel`], and compiled for each kind of vectors. [`dispatch`]
//! runs the widest kind that the machine has. Loops that compilers vectorise by themselves do not need the trait. For
//! these [`widest!`](crate::widest) evaluates an expression that is compiled for the widest kind. All kinds do the same
//! operations in the same order, without fused multiply-add, so that results are the same to the bit. `cargo run -p
//! granita-benches --bin rays`, `--bin peers -- --lookups` and `benches/shading` measure the speed.

#![allow(unsafe_code, reason = "prefetching takes a pointer")]

/// The number of lanes of a wide vector.
pub const WIDE: usize = 8;
/// The number of lanes of a narrow vector.
pub const NARROW: usize = 4;

/// 2^112, from the difference of the exponent biases of a half and a float.
const HALF_BIAS: f32 = f32::from_bits((127 + 112) << 23);

/// For each mask of [`Simd::pack8`]: the lanes that its result takes.
const PACKED: [[u8; WIDE]; 1 << WIDE] = {
    let mut packed = [[0; WIDE]; 1 << WIDE];
    let mut mask = 0;
    while mask < packed.len() {
        let (mut lane, mut next) = (0, 0);
        while lane < WIDE {
            if mask >> lane & 1 == 1 {
                packed[mask][next] = lane as u8;
                next += 1;
            }
            lane += 1;
        }
        mask += 1;
    }
    packed
};

/// Operations on vectors. The `8` or `4` at the end of a name is the number of lanes. Comparisons with NaN are false.
pub trait Simd: Copy {
    /// A vector of eight numbers.
    type F8: Copy;
    /// A vector of four numbers.
    type F4: Copy;

    /// Returns a vector with `x` in all lanes.
    fn splat8(self, x: f32) -> Self::F8;
    /// Loads an array.
    fn load8(self, x: &[f32; WIDE]) -> Self::F8;
    /// Loads numbers from their bits.
    fn bits8(self, x: &[u32; WIDE]) -> Self::F8;
    /// Converts bytes to numbers from 0 to 255.
    fn bytes8(self, x: &[u8; WIDE]) -> Self::F8;
    /// Converts 16-bit integers to numbers from 0 to 65535.
    fn words8(self, x: &[u16; WIDE]) -> Self::F8;
    /// Converts the bits of finite half floats, exactly.
    fn halves8(self, x: &[u16; WIDE]) -> Self::F8;
    /// Stores the lanes in an array.
    fn store8(self, x: Self::F8) -> [f32; WIDE];
    /// `a + b`.
    fn add8(self, a: Self::F8, b: Self::F8) -> Self::F8;
    /// `a - b`.
    fn sub8(self, a: Self::F8, b: Self::F8) -> Self::F8;
    /// `a * b`.
    fn mul8(self, a: Self::F8, b: Self::F8) -> Self::F8;
    /// `a / b`.
    fn div8(self, a: Self::F8, b: Self::F8) -> Self::F8;
    /// `-x`.
    fn neg8(self, x: Self::F8) -> Self::F8;
    /// The square root.
    fn sqrt8(self, x: Self::F8) -> Self::F8;
    /// `a < b ? a : b`, which is `b` when one is NaN.
    fn min8(self, a: Self::F8, b: Self::F8) -> Self::F8;
    /// `a > b ? a : b`, which is `b` when one is NaN.
    fn max8(self, a: Self::F8, b: Self::F8) -> Self::F8;
    /// `x >= 0 ? a : b`.
    fn choose8(self, x: Self::F8, a: Self::F8, b: Self::F8) -> Self::F8;
    /// The largest whole numbers that are not above those of `x`, whose magnitudes are below 2^31. For others, and for
    /// NaN, the results are any numbers.
    fn floor8(self, x: Self::F8) -> [i32; WIDE];
    /// Bit `i` of the result is `a[i] < b[i]`.
    fn lt8(self, a: Self::F8, b: Self::F8) -> u32;
    /// Bit `i` of the result is `a[i] <= b[i]`.
    fn le8(self, a: Self::F8, b: Self::F8) -> u32;
    /// 2 to the power of the integer in the lowest bits of each lane.
    fn power8(self, x: Self::F8) -> Self::F8;
    /// Moves the lanes whose bits are set in `mask` (below 256) to the front, in order. The other lanes have any
    /// values.
    fn pack8(self, x: Self::F8, mask: u32) -> Self::F8;
    /// Returns `x` with 0 in the lanes outside of `from .. to`.
    fn only8(self, x: Self::F8, from: usize, to: usize) -> Self::F8;

    /// Returns a vector with `x` in all lanes.
    fn splat4(self, x: f32) -> Self::F4;
    /// Loads an array.
    fn load4(self, x: &[f32; NARROW]) -> Self::F4;
    /// `a - b`.
    fn sub4(self, a: Self::F4, b: Self::F4) -> Self::F4;
    /// `a * b`.
    fn mul4(self, a: Self::F4, b: Self::F4) -> Self::F4;
    /// The four-lane version of [`Simd::min8`].
    fn min4(self, a: Self::F4, b: Self::F4) -> Self::F4;
    /// The four-lane version of [`Simd::max8`].
    fn max4(self, a: Self::F4, b: Self::F4) -> Self::F4;
    /// The four-lane version of [`Simd::le8`].
    fn le4(self, a: Self::F4, b: Self::F4) -> u32;

    /// Prefetches the value at `at` into the processor's cache.
    fn prefetch<T>(self, at: &T);
}

/// Code that is written once and compiled for each kind of vectors.
pub trait Kernel {
    /// The type of the result.
    type Output;

    /// Runs the kernel. Implementations are `#[inline(always)]`, so that they are compiled for the machine of `s`.
    fn run<S: Simd>(self, s: S) -> Self::Output;
}

/// The kind of vectors that a program uses.
#[derive(Clone, Copy, Debug)]
pub struct Vectors {
    #[cfg(target_arch = "x86_64")]
    wide: Option<pulp::x86::V3>,
}

impl Vectors {
    /// The vectors of every machine.
    pub const PORTABLE: Self = Self {
        #[cfg(target_arch = "x86_64")]
        wide: None,
    };

    /// Returns the widest vectors of the machine.
    ///
    /// Builds with debug assertions use the portable vectors when the variable `GRANITA_PORTABLE` is set, so that
    /// tests run the code of machines of other architectures.
    #[inline]
    pub fn widest() -> Self {
        Self {
            // The library caches the result of this test.
            #[cfg(target_arch = "x86_64")]
            wide: pulp::x86::V3::try_new().filter(|_| !is_portable()),
        }
    }

    /// Runs a kernel.
    #[inline]
    pub fn run<K: Kernel>(self, kernel: K) -> K::Output {
        #[cfg(target_arch = "x86_64")]
        if let Some(simd) = self.wide {
            return simd.vectorize(OnWide { simd, kernel });
        }
        kernel.run(Portable)
    }
}

/// True when the portable vectors are requested.
#[cfg(all(target_arch = "x86_64", debug_assertions))]
fn is_portable() -> bool {
    static ANSWER: std::sync::OnceLock<bool> = std::sync::OnceLock::new();
    *ANSWER.get_or_init(|| std::env::var_os("GRANITA_PORTABLE").is_some())
}

/// Returns false, because release builds have no such choice.
#[cfg(all(target_arch = "x86_64", not(debug_assertions)))]
const fn is_portable() -> bool {
    false
}

/// Runs a kernel with the widest vectors of the machine.
#[inline]
pub fn dispatch<K: Kernel>(kernel: K) -> K::Output {
    Vectors::widest().run(kernel)
}

/// Evaluates an expression, compiled for the widest vectors of the machine. Functions that the expression calls are
/// compiled for them when they are inlined. It takes what it uses as a closure does.
#[macro_export]
macro_rules! widest {
    ($work:expr) => {
        $crate::simd::run_widest(
            // Compiled on its own, the closure would be code for every machine.
            #[inline(always)]
            || $work,
        )
    };
}

/// Runs the closure of [`widest!`].
#[doc(hidden)]
#[inline]
pub fn run_widest<R>(work: impl FnOnce() -> R) -> R {
    struct Plain<F>(F);

    impl<R, F: FnOnce() -> R> Kernel for Plain<F> {
        type Output = R;

        #[inline(always)]
        fn run<S: Simd>(self, _: S) -> R {
            (self.0)()
        }
    }

    dispatch(Plain(work))
}

/// A kernel with the vectors that it is compiled for.
#[cfg(target_arch = "x86_64")]
struct OnWide<K> {
    simd: pulp::x86::V3,
    kernel: K,
}

#[cfg(target_arch = "x86_64")]
impl<K: Kernel> pulp::NullaryFnOnce for OnWide<K> {
    type Output = K::Output;

    #[inline(always)]
    fn call(self) -> K::Output {
        self.kernel.run(self.simd)
    }
}

/// Vectors of every machine, which compilers turn into SSE or NEON instructions.
#[derive(Clone, Copy, Debug)]
pub struct Portable;

#[inline(always)]
fn each<const N: usize>(a: [f32; N], b: [f32; N], f: impl Fn(f32, f32) -> f32) -> [f32; N] {
    let mut out = [0.0; N];
    for i in 0..N {
        out[i] = f(a[i], b[i]);
    }
    out
}

#[inline(always)]
fn compare<const N: usize>(a: [f32; N], b: [f32; N], f: impl Fn(f32, f32) -> bool) -> u32 {
    let mut mask = 0;
    for i in 0..N {
        mask |= u32::from(f(a[i], b[i])) << i;
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

/// Converts a finite half float to a float, exactly. It has no branch, unlike the conversions of libraries.
#[inline(always)]
pub fn half(bits: u16) -> f32 {
    let bits = u32::from(bits);
    let magnitude = f32::from_bits((bits & 0x7fff) << 13) * HALF_BIAS;
    f32::from_bits(magnitude.to_bits() | (bits & 0x8000) << 16)
}

#[rustfmt::skip]
impl Simd for Portable {
    type F8 = [f32; WIDE];
    type F4 = [f32; NARROW];

    #[inline(always)] fn splat8(self, x: f32) -> Self::F8 { [x; WIDE] }
    #[inline(always)] fn load8(self, x: &[f32; WIDE]) -> Self::F8 { *x }
    #[inline(always)] fn bits8(self, x: &[u32; WIDE]) -> Self::F8 { x.map(f32::from_bits) }
    #[inline(always)] fn bytes8(self, x: &[u8; WIDE]) -> Self::F8 { x.map(f32::from) }
    #[inline(always)] fn words8(self, x: &[u16; WIDE]) -> Self::F8 { x.map(f32::from) }
    #[inline(always)] fn halves8(self, x: &[u16; WIDE]) -> Self::F8 { x.map(half) }
    #[inline(always)] fn store8(self, x: Self::F8) -> [f32; WIDE] { x }
    #[inline(always)] fn add8(self, a: Self::F8, b: Self::F8) -> Self::F8 { each(a, b, |a, b| a + b) }
    #[inline(always)] fn sub8(self, a: Self::F8, b: Self::F8) -> Self::F8 { each(a, b, |a, b| a - b) }
    #[inline(always)] fn mul8(self, a: Self::F8, b: Self::F8) -> Self::F8 { each(a, b, |a, b| a * b) }
    #[inline(always)] fn div8(self, a: Self::F8, b: Self::F8) -> Self::F8 { each(a, b, |a, b| a / b) }
    #[inline(always)] fn neg8(self, x: Self::F8) -> Self::F8 { x.map(|x| -x) }
    #[inline(always)] fn sqrt8(self, x: Self::F8) -> Self::F8 { x.map(f32::sqrt) }
    #[inline(always)] fn min8(self, a: Self::F8, b: Self::F8) -> Self::F8 { each(a, b, lesser) }
    #[inline(always)] fn max8(self, a: Self::F8, b: Self::F8) -> Self::F8 { each(a, b, greater) }
    #[inline(always)] fn choose8(self, x: Self::F8, a: Self::F8, b: Self::F8) -> Self::F8 {
        std::array::from_fn(|i| if x[i] >= 0.0 { a[i] } else { b[i] })
    }
    #[inline(always)] fn floor8(self, x: Self::F8) -> [i32; WIDE] {
        // The instruction that rounds down does not exist on all machines, and the library's function is slow.
        x.map(|x| {
            let whole = x as i32;
            whole.wrapping_sub(i32::from(x < whole as f32))
        })
    }
    #[inline(always)] fn lt8(self, a: Self::F8, b: Self::F8) -> u32 { compare(a, b, |a, b| a < b) }
    #[inline(always)] fn le8(self, a: Self::F8, b: Self::F8) -> u32 { compare(a, b, |a, b| a <= b) }
    #[inline(always)] fn power8(self, x: Self::F8) -> Self::F8 {
        x.map(|x| f32::from_bits((x.to_bits() << 23).wrapping_add(127 << 23)))
    }
    #[inline(always)] fn pack8(self, x: Self::F8, mask: u32) -> Self::F8 {
        PACKED[mask as usize].map(|lane| x[lane as usize % WIDE])
    }
    #[inline(always)] fn only8(self, x: Self::F8, from: usize, to: usize) -> Self::F8 {
        let mut out = [0.0; WIDE];
        out[from..to].copy_from_slice(&x[from..to]);
        out
    }
    #[inline(always)] fn splat4(self, x: f32) -> Self::F4 { [x; NARROW] }
    #[inline(always)] fn load4(self, x: &[f32; NARROW]) -> Self::F4 { *x }
    #[inline(always)] fn sub4(self, a: Self::F4, b: Self::F4) -> Self::F4 { each(a, b, |a, b| a - b) }
    #[inline(always)] fn mul4(self, a: Self::F4, b: Self::F4) -> Self::F4 { each(a, b, |a, b| a * b) }
    #[inline(always)] fn min4(self, a: Self::F4, b: Self::F4) -> Self::F4 { each(a, b, lesser) }
    #[inline(always)] fn max4(self, a: Self::F4, b: Self::F4) -> Self::F4 { each(a, b, greater) }
    #[inline(always)] fn le4(self, a: Self::F4, b: Self::F4) -> u32 { compare(a, b, |a, b| a <= b) }
    #[inline(always)] fn prefetch<T>(self, _: &T) {}
}

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use super::{HALF_BIAS, NARROW, PACKED, Simd, WIDE};
    use pulp::cast;
    use std::arch::x86_64::*;

    #[rustfmt::skip]
    impl Simd for pulp::x86::V3 {
        type F8 = __m256;
        type F4 = __m128;

        #[inline(always)] fn splat8(self, x: f32) -> __m256 { self.avx._mm256_set1_ps(x) }
        #[inline(always)] fn load8(self, x: &[f32; WIDE]) -> __m256 { cast(*x) }
        #[inline(always)] fn bits8(self, x: &[u32; WIDE]) -> __m256 { cast(*x) }
        #[inline(always)] fn bytes8(self, x: &[u8; WIDE]) -> __m256 {
            let bytes = self.sse2._mm_set_epi64x(0, i64::from_le_bytes(*x));
            self.avx._mm256_cvtepi32_ps(self.avx2._mm256_cvtepu8_epi32(bytes))
        }
        #[inline(always)] fn words8(self, x: &[u16; WIDE]) -> __m256 {
            self.avx._mm256_cvtepi32_ps(self.avx2._mm256_cvtepu16_epi32(cast(*x)))
        }
        #[inline(always)] fn halves8(self, x: &[u16; WIDE]) -> __m256 {
            let (avx, avx2) = (self.avx, self.avx2);
            // Extended by its sign, a half needs one mask. The product keeps the sign.
            let bits = avx2._mm256_slli_epi32::<13>(avx2._mm256_cvtepi16_epi32(cast(*x)));
            let bits = avx2._mm256_and_si256(bits, avx._mm256_set1_epi32(0x8fff_e000_u32.cast_signed()));
            avx._mm256_mul_ps(avx._mm256_castsi256_ps(bits), avx._mm256_set1_ps(HALF_BIAS))
        }
        #[inline(always)] fn store8(self, x: __m256) -> [f32; WIDE] { cast(x) }
        #[inline(always)] fn add8(self, a: __m256, b: __m256) -> __m256 { self.avx._mm256_add_ps(a, b) }
        #[inline(always)] fn sub8(self, a: __m256, b: __m256) -> __m256 { self.avx._mm256_sub_ps(a, b) }
        #[inline(always)] fn mul8(self, a: __m256, b: __m256) -> __m256 { self.avx._mm256_mul_ps(a, b) }
        #[inline(always)] fn div8(self, a: __m256, b: __m256) -> __m256 { self.avx._mm256_div_ps(a, b) }
        #[inline(always)] fn neg8(self, x: __m256) -> __m256 {
            self.avx._mm256_xor_ps(x, self.avx._mm256_set1_ps(-0.0))
        }
        #[inline(always)] fn sqrt8(self, x: __m256) -> __m256 { self.avx._mm256_sqrt_ps(x) }
        #[inline(always)] fn min8(self, a: __m256, b: __m256) -> __m256 { self.avx._mm256_min_ps(a, b) }
        #[inline(always)] fn max8(self, a: __m256, b: __m256) -> __m256 { self.avx._mm256_max_ps(a, b) }
        #[inline(always)] fn choose8(self, x: __m256, a: __m256, b: __m256) -> __m256 {
            let above = self.avx._mm256_cmp_ps::<_CMP_GE_OQ>(x, self.avx._mm256_setzero_ps());
            self.avx._mm256_blendv_ps(b, a, above)
        }
        #[inline(always)] fn floor8(self, x: __m256) -> [i32; WIDE] {
            cast(self.avx._mm256_cvttps_epi32(self.avx._mm256_floor_ps(x)))
        }
        #[inline(always)] fn lt8(self, a: __m256, b: __m256) -> u32 {
            self.avx._mm256_movemask_ps(self.avx._mm256_cmp_ps::<_CMP_LT_OQ>(a, b)).cast_unsigned()
        }
        #[inline(always)] fn le8(self, a: __m256, b: __m256) -> u32 {
            self.avx._mm256_movemask_ps(self.avx._mm256_cmp_ps::<_CMP_LE_OQ>(a, b)).cast_unsigned()
        }
        #[inline(always)] fn power8(self, x: __m256) -> __m256 {
            let (avx, avx2) = (self.avx, self.avx2);
            let exponent = avx2._mm256_slli_epi32::<23>(avx._mm256_castps_si256(x));
            avx._mm256_castsi256_ps(avx2._mm256_add_epi32(exponent, avx._mm256_set1_epi32(127 << 23)))
        }
        #[inline(always)] fn pack8(self, x: __m256, mask: u32) -> __m256 {
            let lanes = self.sse2._mm_set_epi64x(0, i64::from_le_bytes(PACKED[mask as usize]));
            self.avx2._mm256_permutevar8x32_ps(x, self.avx2._mm256_cvtepu8_epi32(lanes))
        }
        #[inline(always)] fn only8(self, x: __m256, from: usize, to: usize) -> __m256 {
            let (avx, avx2) = (self.avx, self.avx2);
            let lane = avx._mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
            let below = avx2._mm256_cmpgt_epi32(avx._mm256_set1_epi32(from as i32), lane);
            let within = avx2._mm256_cmpgt_epi32(avx._mm256_set1_epi32(to as i32), lane);
            avx._mm256_and_ps(x, avx._mm256_castsi256_ps(avx2._mm256_andnot_si256(below, within)))
        }
        #[inline(always)] fn splat4(self, x: f32) -> __m128 { self.sse._mm_set1_ps(x) }
        #[inline(always)] fn load4(self, x: &[f32; NARROW]) -> __m128 { cast(*x) }
        #[inline(always)] fn sub4(self, a: __m128, b: __m128) -> __m128 { self.sse._mm_sub_ps(a, b) }
        #[inline(always)] fn mul4(self, a: __m128, b: __m128) -> __m128 { self.sse._mm_mul_ps(a, b) }
        #[inline(always)] fn min4(self, a: __m128, b: __m128) -> __m128 { self.sse._mm_min_ps(a, b) }
        #[inline(always)] fn max4(self, a: __m128, b: __m128) -> __m128 { self.sse._mm_max_ps(a, b) }
        #[inline(always)] fn le4(self, a: __m128, b: __m128) -> u32 {
            self.sse._mm_movemask_ps(self.sse._mm_cmple_ps(a, b)).cast_unsigned()
        }
        #[inline(always)] fn prefetch<T>(self, at: &T) {
            let lines = std::ptr::from_ref(at).cast::<i8>();
            // These are addresses only. Prefetching behind the last whole line is harmless.
            for line in 0..size_of::<T>().div_ceil(64) {
                // SAFETY: prefetching reads nothing, wherever the address leads.
                unsafe { _mm_prefetch::<_MM_HINT_T0>(lines.wrapping_add(line * 64)) };
            }
            if align_of::<T>() < 32 {
                // SAFETY: as above.
                unsafe { _mm_prefetch::<_MM_HINT_T0>(lines.wrapping_add(size_of::<T>() - 1)) };
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A kernel of all operations on a few numbers. Its result is bits.
    struct All([f32; WIDE], [f32; WIDE]);

    impl Kernel for All {
        type Output = Vec<u32>;

        #[inline(always)]
        fn run<S: Simd>(self, s: S) -> Vec<u32> {
            let (a, b) = (s.load8(&self.0), s.load8(&self.1));
            let mut out = vec![s.lt8(a, b), s.le8(a, b)];
            let made = [
                s.add8(a, b),
                s.sub8(a, b),
                s.mul8(a, b),
                s.div8(a, b),
                s.neg8(a),
                s.sqrt8(a),
                s.choose8(a, b, a),
                s.min8(a, b),
                s.max8(a, b),
                s.only8(a, 2, 5),
                s.pack8(a, 0b1010_0110),
                s.pack8(a, 0),
                s.pack8(b, 0xff),
                s.power8(s.bits8(&[0, 1, 2, 3, 120, u32::MAX, u32::MAX - 1, 7])),
                s.bytes8(&[0, 1, 2, 127, 128, 200, 254, 255]),
                s.words8(&[0, 1, 255, 256, 32767, 32768, 65534, 65535]),
                s.halves8(&[0, 1, 0x3ff, 0x400, 0x3c00, 0x7bff, 0xfbff, 0x8001]),
            ];
            let bits = |x: f32| if x.is_nan() { u32::MAX } else { x.to_bits() };
            out.extend(made.iter().flat_map(|v| s.store8(*v).map(bits)));
            let four = |x: &[f32; WIDE]| s.load4(&[x[0], x[1], x[2], x[3]]);
            let (a, b) = (four(&self.0), four(&self.1));
            let all = [s.sub4(a, b), s.mul4(a, b), s.min4(a, b), s.max4(a, b)];
            out.extend(all.iter().map(|v| s.le4(*v, s.splat4(0.5))));
            s.prefetch(&self.0);
            out
        }
    }

    #[test]
    fn wide_and_portable_vectors_agree_to_the_bit() {
        let a = [0.0, -0.0, 1.5, f32::NAN, f32::INFINITY, -2.5, 1e-40, 3.4e38];
        let b = [-0.0, 0.0, f32::NAN, 1.0, -1.0, 0.3, 1e-40, 3.4e38];
        for (a, b) in [(a, b), (b, a), (a, a)] {
            assert_eq!(dispatch(All(a, b)), Vectors::PORTABLE.run(All(a, b)));
        }
        assert_eq!(crate::widest!(a.iter().filter(|x| x.is_finite()).count()), 6);
    }

    #[test]
    #[cfg(target_arch = "x86_64")]
    fn the_variable_selects_the_portable_vectors() {
        let asked = cfg!(debug_assertions) && std::env::var_os("GRANITA_PORTABLE").is_some();
        let wide = pulp::x86::V3::try_new().is_some() && !asked;
        assert_eq!(Vectors::widest().wide.is_some(), wide);
    }

    #[test]
    fn packed_lanes_are_those_of_the_mask_in_order() {
        let lanes: [f32; WIDE] = std::array::from_fn(|i| i as f32);
        for mask in 0..1 << WIDE {
            let packed = Portable.pack8(lanes, mask);
            let expected: Vec<f32> = (0..8).filter(|i| mask >> i & 1 == 1).map(|i| i as f32).collect();
            assert_eq!(packed[..expected.len()], expected, "{mask:b}");
        }
    }

    #[test]
    fn numbers_are_rounded_down_on_all_machines() {
        struct Floor([f32; WIDE]);

        impl Kernel for Floor {
            type Output = [i32; WIDE];

            #[inline(always)]
            fn run<S: Simd>(self, s: S) -> [i32; WIDE] {
                s.floor8(s.load8(&self.0))
            }
        }

        let x = [0.0, -0.0, 0.999, -0.001, 7.0, -7.0, -2e9, 2e9];
        let expected = [0, 0, 0, -1, 7, -7, -2_000_000_000, 2_000_000_000];
        assert_eq!(dispatch(Floor(x)), expected);
        assert_eq!(Vectors::PORTABLE.run(Floor(x)), expected);
    }

    #[test]
    fn halves_convert_to_their_ieee_values() {
        struct Halves([u16; WIDE]);

        impl Kernel for Halves {
            type Output = [u32; WIDE];

            #[inline(always)]
            fn run<S: Simd>(self, s: S) -> [u32; WIDE] {
                s.store8(s.halves8(&self.0)).map(f32::to_bits)
            }
        }

        assert_eq!([0x3c00, 0xc000, 0x0001, 0x7bff].map(half), [1.0, -2.0, 5.960_464_5e-8, 65504.0]);
        let finite: Vec<u16> = (0..=u16::MAX).filter(|bits| bits & 0x7c00 != 0x7c00).collect();
        for bits in finite.as_chunks::<WIDE>().0 {
            assert_eq!(dispatch(Halves(*bits)), bits.map(|bits| half(bits).to_bits()));
        }
    }
}
