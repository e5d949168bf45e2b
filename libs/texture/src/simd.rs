//! Rows of texels under a Gaussian, eight at a time: for every machine, and for those with AVX2, chosen as the program
//! runs.
//!
//! Both do the same operations in the same order (nothing is contracted), so that the results are the same to the
//! bit; a test compares them. `cargo run -p granita-benches --bin peers -- --lookups` measures what it brings.
//!
//! The only unsafe code of the crate: intrinsics that need what was found to be there, and calls of functions compiled
//! for it.

#![allow(unsafe_code, reason = "AVX2; measured by the bench of peers")]

use crate::gaussian::{Exponents, Gaussian};
use half::f16;

/// Texels that are taken at once.
pub(crate) const LANES: usize = 8;

/// What a weight loses, so that a Gaussian cut off at three deviations ends at 0: `exp (-9/2)`.
pub(crate) const FLOOR: f32 = 0.011_109;

/// 2^112: the difference of the biases of the exponents of a half and a float.
const HALF_BIAS: f32 = f32::from_bits((127 + 112) << 23);

/// A stored value.
pub(crate) trait Texel: Copy {
    /// As a number, in units of its own.
    fn raw(self) -> f32;

    /// Eight of them.
    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    fn eight(simd: Avx2, values: &[Self; LANES]) -> <Avx2 as Simd>::F {
        simd.load(&Portable.texels(values))
    }
}

impl Texel for u8 {
    #[inline(always)]
    fn raw(self) -> f32 {
        f32::from(self)
    }

    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    fn eight(_: Avx2, values: &[Self; LANES]) -> <Avx2 as Simd>::F {
        use std::arch::x86_64::{_mm_cvtsi64_si128, _mm256_cvtepi32_ps, _mm256_cvtepu8_epi32};
        // SAFETY: an `Avx2` is made where the machine has AVX2.
        unsafe { _mm256_cvtepi32_ps(_mm256_cvtepu8_epi32(_mm_cvtsi64_si128(i64::from_le_bytes(*values)))) }
    }
}

impl Texel for u16 {
    #[inline(always)]
    fn raw(self) -> f32 {
        f32::from(self)
    }

    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    fn eight(_: Avx2, values: &[Self; LANES]) -> <Avx2 as Simd>::F {
        use std::arch::x86_64::{_mm_loadu_si128, _mm256_cvtepi32_ps, _mm256_cvtepu16_epi32};
        // SAFETY: an `Avx2` is made where the machine has AVX2; the eight values are the 16 bytes that are read.
        unsafe { _mm256_cvtepi32_ps(_mm256_cvtepu16_epi32(_mm_loadu_si128(values.as_ptr().cast()))) }
    }
}

impl Texel for u32 {
    #[inline(always)]
    fn raw(self) -> f32 {
        self as f32
    }
}

impl Texel for f32 {
    #[inline(always)]
    fn raw(self) -> f32 {
        self
    }

    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    fn eight(simd: Avx2, values: &[Self; LANES]) -> <Avx2 as Simd>::F {
        simd.load(values)
    }
}

impl Texel for f16 {
    /// Exact for finite numbers; without a branch, which conversions of the library have.
    #[inline(always)]
    fn raw(self) -> f32 {
        let bits = u32::from(self.to_bits());
        let magnitude = f32::from_bits((bits & 0x7fff) << 13) * HALF_BIAS;
        f32::from_bits(magnitude.to_bits() | (bits & 0x8000) << 16)
    }

    #[cfg(target_arch = "x86_64")]
    #[inline(always)]
    fn eight(_: Avx2, values: &[Self; LANES]) -> <Avx2 as Simd>::F {
        use std::arch::x86_64 as x;
        // SAFETY: an `Avx2` is made where the machine has AVX2; the eight values are the 16 bytes that are read.
        unsafe {
            let bits = x::_mm256_cvtepu16_epi32(x::_mm_loadu_si128(values.as_ptr().cast()));
            let magnitude =
                x::_mm256_slli_epi32::<13>(x::_mm256_and_si256(bits, x::_mm256_set1_epi32(0x7fff)));
            let magnitude = x::_mm256_mul_ps(x::_mm256_castsi256_ps(magnitude), x::_mm256_set1_ps(HALF_BIAS));
            let sign = x::_mm256_slli_epi32::<16>(x::_mm256_and_si256(bits, x::_mm256_set1_epi32(0x8000)));
            x::_mm256_or_ps(magnitude, x::_mm256_castsi256_ps(sign))
        }
    }
}

/// Operations on eight numbers, none of which is NaN.
pub(crate) trait Simd: Copy {
    /// Eight numbers.
    type F: Copy;

    fn splat(self, x: f32) -> Self::F;
    fn load(self, x: &[f32; LANES]) -> Self::F;
    fn store(self, x: Self::F) -> [f32; LANES];
    fn texels<T: Texel>(self, x: &[T; LANES]) -> Self::F;
    fn add(self, a: Self::F, b: Self::F) -> Self::F;
    fn sub(self, a: Self::F, b: Self::F) -> Self::F;
    fn mul(self, a: Self::F, b: Self::F) -> Self::F;
    fn div(self, a: Self::F, b: Self::F) -> Self::F;
    fn sqrt(self, x: Self::F) -> Self::F;
    fn min(self, a: Self::F, b: Self::F) -> Self::F;
    fn max(self, a: Self::F, b: Self::F) -> Self::F;
    /// 2 to the power of the whole number that stands in the lowest bits of each.
    fn power(self, x: Self::F) -> Self::F;
    /// 0 in lanes outside `from .. to`.
    fn only(self, x: Self::F, from: usize, to: usize) -> Self::F;
}

/// What every machine can do.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Portable;

#[inline(always)]
fn each(a: [f32; LANES], b: [f32; LANES], f: impl Fn(f32, f32) -> f32) -> [f32; LANES] {
    let mut out = [0.0; LANES];
    for i in 0..LANES {
        out[i] = f(a[i], b[i]);
    }
    out
}

impl Simd for Portable {
    type F = [f32; LANES];

    #[inline(always)]
    fn splat(self, x: f32) -> Self::F {
        [x; LANES]
    }
    #[inline(always)]
    fn load(self, x: &[f32; LANES]) -> Self::F {
        *x
    }
    #[inline(always)]
    fn store(self, x: Self::F) -> [f32; LANES] {
        x
    }
    #[inline(always)]
    fn texels<T: Texel>(self, x: &[T; LANES]) -> Self::F {
        x.map(T::raw)
    }
    #[inline(always)]
    fn add(self, a: Self::F, b: Self::F) -> Self::F {
        each(a, b, |a, b| a + b)
    }
    #[inline(always)]
    fn sub(self, a: Self::F, b: Self::F) -> Self::F {
        each(a, b, |a, b| a - b)
    }
    #[inline(always)]
    fn mul(self, a: Self::F, b: Self::F) -> Self::F {
        each(a, b, |a, b| a * b)
    }
    #[inline(always)]
    fn div(self, a: Self::F, b: Self::F) -> Self::F {
        each(a, b, |a, b| a / b)
    }
    #[inline(always)]
    fn sqrt(self, x: Self::F) -> Self::F {
        x.map(f32::sqrt)
    }
    #[inline(always)]
    fn min(self, a: Self::F, b: Self::F) -> Self::F {
        each(a, b, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn max(self, a: Self::F, b: Self::F) -> Self::F {
        each(a, b, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn power(self, x: Self::F) -> Self::F {
        x.map(|x| f32::from_bits((x.to_bits() << 23).wrapping_add(127 << 23)))
    }
    #[inline(always)]
    fn only(self, x: Self::F, from: usize, to: usize) -> Self::F {
        let mut out = [0.0; LANES];
        out[from..to].copy_from_slice(&x[from..to]);
        out
    }
}

/// Machines with AVX2; made by [`Avx2::here`] only.
#[cfg(target_arch = "x86_64")]
#[derive(Clone, Copy, Debug)]
pub(crate) struct Avx2(());

#[cfg(target_arch = "x86_64")]
impl Avx2 {
    /// Where the machine has it.
    fn here() -> Option<Self> {
        std::arch::is_x86_feature_detected!("avx2").then_some(Self(()))
    }
}

/// One safe operation for each.
#[cfg(target_arch = "x86_64")]
macro_rules! avx2 {
    ($($name:ident ($($arg:ident : $ty:ty),*) -> $out:ty { $body:expr })*) => {$(
        #[inline(always)]
        fn $name(self $(, $arg: $ty)*) -> $out {
            use std::arch::x86_64::*;
            // SAFETY: an `Avx2` is made where the machine has AVX2; what is read and written is eight floats.
            unsafe { $body }
        }
    )*};
}

#[cfg(target_arch = "x86_64")]
impl Simd for Avx2 {
    type F = std::arch::x86_64::__m256;

    avx2! {
        splat(x: f32) -> Self::F { _mm256_set1_ps(x) }
        load(x: &[f32; LANES]) -> Self::F { _mm256_loadu_ps(x.as_ptr()) }
        add(a: Self::F, b: Self::F) -> Self::F { _mm256_add_ps(a, b) }
        sub(a: Self::F, b: Self::F) -> Self::F { _mm256_sub_ps(a, b) }
        mul(a: Self::F, b: Self::F) -> Self::F { _mm256_mul_ps(a, b) }
        div(a: Self::F, b: Self::F) -> Self::F { _mm256_div_ps(a, b) }
        sqrt(x: Self::F) -> Self::F { _mm256_sqrt_ps(x) }
        min(a: Self::F, b: Self::F) -> Self::F { _mm256_min_ps(a, b) }
        max(a: Self::F, b: Self::F) -> Self::F { _mm256_max_ps(a, b) }
        power(x: Self::F) -> Self::F {
            _mm256_castsi256_ps(_mm256_add_epi32(
                _mm256_slli_epi32::<23>(_mm256_castps_si256(x)),
                _mm256_set1_epi32(127 << 23),
            ))
        }
        only(x: Self::F, from: usize, to: usize) -> Self::F {{
            let lane = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
            let below = _mm256_cmpgt_epi32(_mm256_set1_epi32(from as i32), lane);
            let within = _mm256_cmpgt_epi32(_mm256_set1_epi32(to as i32), lane);
            _mm256_and_ps(x, _mm256_castsi256_ps(_mm256_andnot_si256(below, within)))
        }}
    }

    #[inline(always)]
    fn store(self, x: Self::F) -> [f32; LANES] {
        let mut out = [0.0; LANES];
        // SAFETY: as above.
        unsafe { std::arch::x86_64::_mm256_storeu_ps(out.as_mut_ptr(), x) };
        out
    }

    #[inline(always)]
    fn texels<T: Texel>(self, x: &[T; LANES]) -> Self::F {
        T::eight(self, x)
    }
}

/// `2^x` within 1e-6 of itself, for `x` in [-120, 120]; other numbers are taken to these.
#[inline(always)]
fn exp2<S: Simd>(simd: S, x: S::F) -> S::F {
    // 1.5 * 2^23: adding it rounds to whole numbers, which stand in the lowest bits of the sum.
    let round = simd.splat(12_582_912.0);
    let x = simd.min(simd.max(x, simd.splat(-120.0)), simd.splat(120.0));
    let rounded = simd.add(x, round);
    let f = simd.sub(x, simd.sub(rounded, round));
    // 2^f in [-0.5, 0.5], by least squares at Chebyshev's points.
    let mut p = simd.splat(1.321_87e-3);
    for c in [9.671_7e-3, 5.550_893e-2, 0.240_222_38, 0.693_146_9, 1.0] {
        p = simd.add(simd.mul(p, f), simd.splat(c));
    }
    simd.mul(p, simd.power(rounded))
}

/// `2^x` of one number.
#[inline]
pub(crate) fn exp2_of(x: f32) -> f32 {
    exp2(Portable, [x; LANES])[0]
}

/// One row, from its first texel on. Texel `i` of it belongs to lane `i % 8`, wherever tiles begin.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Row {
    exponents: Exponents,
    /// Of the first texel.
    dx: f32,
    /// Which of the eight at hand is next.
    lane: usize,
    weight: [f32; LANES],
    /// Factor to the weights of the next eight.
    step: [f32; LANES],
    state: State,
}

/// What is known of a row.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// No weight.
    New,
    /// The weights of the eight at hand.
    First,
    /// The weights of the eight before, which are the first.
    FirstDue,
    /// Those of the eight at hand, and the factors to the next.
    Later,
    /// Those of the eight before, and the factors.
    LaterDue,
}

impl Row {
    /// A row whose first texel is at `dx`.
    #[inline]
    pub(crate) fn new(exponents: Exponents, dx: f32) -> Self {
        Self { exponents, dx, lane: 0, weight: [0.0; LANES], step: [0.0; LANES], state: State::New }
    }
}

/// Distances of eight texels from the centre, the first at `dx`.
#[inline(always)]
fn distances<S: Simd>(simd: S, dx: f32) -> S::F {
    simd.add(simd.splat(dx), simd.load(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]))
}

/// Weights of the first eight texels of a row.
#[inline(always)]
fn first_weights<S: Simd>(simd: S, e: Exponents, dx: f32) -> S::F {
    let dx = distances(simd, dx);
    let sum = simd.add(simd.mul(simd.splat(e.a), dx), simd.splat(e.b));
    exp2(simd, simd.add(simd.mul(sum, dx), simd.splat(e.c)))
}

/// Factors from these to the next eight.
#[inline(always)]
fn first_steps<S: Simd>(simd: S, e: Exponents, dx: f32) -> S::F {
    const N: f32 = LANES as f32;
    let dx = distances(simd, dx);
    let both = simd.add(simd.mul(simd.splat(2.0 * N), dx), simd.splat(N * N));
    exp2(simd, simd.add(simd.mul(simd.splat(e.a), both), simd.splat(e.b * N)))
}

/// A row at work.
struct Weights<S: Simd> {
    simd: S,
    exponents: Exponents,
    dx: f32,
    bend: S::F,
    weight: S::F,
    step: S::F,
    state: State,
}

impl<S: Simd> Weights<S> {
    #[inline(always)]
    fn of(simd: S, row: &Row, bend: f32) -> Self {
        let (weight, step) = (simd.load(&row.weight), simd.load(&row.step));
        let (exponents, dx, state) = (row.exponents, row.dx, row.state);
        Self { simd, exponents, dx, bend: simd.splat(bend), weight, step, state }
    }

    /// Makes the weights of the eight at hand.
    #[inline(always)]
    fn prepare(&mut self) {
        let simd = self.simd;
        match self.state {
            State::First | State::Later => {}
            State::New => {
                self.weight = first_weights(simd, self.exponents, self.dx);
                self.state = State::First;
            }
            State::FirstDue | State::LaterDue => {
                if self.state == State::FirstDue {
                    self.step = first_steps(simd, self.exponents, self.dx);
                }
                self.weight = simd.mul(self.weight, self.step);
                self.step = simd.mul(self.step, self.bend);
                self.state = State::Later;
            }
        }
    }

    /// To the next eight.
    #[inline(always)]
    fn next(&mut self) {
        self.state = if self.state == State::First { State::FirstDue } else { State::LaterDue };
    }

    /// Weights as they count.
    #[inline(always)]
    fn lowered(&self) -> S::F {
        let simd = self.simd;
        simd.max(simd.sub(self.weight, simd.splat(FLOOR)), simd.splat(0.0))
    }
}

/// Weighted sums of up to four channels, by lane, taken relative to the first value: the mean of values that are all
/// alike is that value, exactly.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sums {
    base: [f32; 4],
    above: [[f32; LANES]; 4],
    weight: [f32; LANES],
    begun: bool,
    /// Factor from the steps of eight texels to those of the next: `2^(128 a)`.
    bend: f32,
    #[cfg(target_arch = "x86_64")]
    avx2: Option<Avx2>,
}

impl Sums {
    /// Nothing yet; `a` as in [`Exponents`]. Where no row is `long`er than eight texels, some of the work is not due.
    pub(crate) fn new(a: f32, long: bool) -> Self {
        Self {
            base: [0.0; 4],
            above: [[0.0; LANES]; 4],
            weight: [0.0; LANES],
            begun: false,
            bend: if long { exp2_of(2.0 * (LANES * LANES) as f32 * a) } else { 1.0 },
            #[cfg(target_arch = "x86_64")]
            avx2: Avx2::here(),
        }
    }

    /// Takes a value as the base when there is none.
    #[inline]
    pub(crate) fn begin(&mut self, value: impl FnOnce() -> [f32; 4]) {
        if !self.begun {
            self.base = value();
            self.begun = true;
        }
    }

    /// Adds the next texel of a row.
    pub(crate) fn add(&mut self, row: &mut Row, value: [f32; 4]) {
        self.begin(|| value);
        let mut weights = Weights::of(Portable, row, self.bend);
        weights.prepare();
        let weight = weights.lowered()[row.lane];
        for ((above, value), base) in self.above.iter_mut().zip(value).zip(self.base) {
            above[row.lane] += weight * (value - base);
        }
        self.weight[row.lane] += weight;
        row.lane += 1;
        if row.lane == LANES {
            row.lane = 0;
            weights.next();
        }
        (row.weight, row.step, row.state) = (weights.weight, weights.step, weights.state);
    }

    /// Adds the next `count` texels of a row, the first `N` of four channels: that of the current lane of channel c is
    /// `values[at + c * plane]`. The sums have begun.
    #[inline]
    pub(crate) fn run<T: Texel, const N: usize>(&mut self, row: &mut Row, run: Run<'_, T>) {
        #[cfg(target_arch = "x86_64")]
        if let Some(simd) = self.avx2 {
            // SAFETY: an `Avx2` is made where the machine has AVX2.
            return unsafe { run_avx2::<T, N>(simd, self, row, run) };
        }
        run_any::<_, T, N>(Portable, self, row, run);
    }

    /// All rows of an ellipse that lies inside of one tile, a texel from its border at least; nothing was added before.
    #[inline]
    pub(crate) fn rows<T: Texel, const N: usize>(&mut self, g: &Gaussian, rows: Rows<'_, T>) {
        #[cfg(target_arch = "x86_64")]
        if let Some(simd) = self.avx2 {
            // SAFETY: an `Avx2` is made where the machine has AVX2.
            return unsafe { rows_avx2::<T, N>(simd, self, g, rows) };
        }
        rows_any::<_, T, N>(Portable, self, g, rows);
    }

    /// Weights of eight directions under a lobe.
    #[inline]
    pub(crate) fn weights(&self, dome: &Dome, line: &Line<'_>) -> [f32; LANES] {
        #[cfg(target_arch = "x86_64")]
        if let Some(simd) = self.avx2 {
            // SAFETY: an `Avx2` is made where the machine has AVX2.
            return unsafe { dome_avx2(simd, dome, line) };
        }
        dome_any(Portable, dome, line)
    }

    /// Adds texels side by side, those of lanes `from .. to` of eight with these weights: that of lane `from`, channel c,
    /// is `values[at + c * plane]`, and `N` channels count. The sums have begun.
    #[inline]
    pub(crate) fn weighted<T: Texel, const N: usize>(
        &mut self,
        weights: &[f32; LANES],
        (from, to): (usize, usize),
        (values, at, plane): (&[T], usize, usize),
    ) {
        #[cfg(target_arch = "x86_64")]
        if let Some(simd) = self.avx2 {
            // SAFETY: an `Avx2` is made where the machine has AVX2.
            return unsafe { weighted_avx2::<T, N>(simd, self, weights, (from, to), (values, at, plane)) };
        }
        weighted_any::<_, T, N>(Portable, self, weights, (from, to), (values, at, plane));
    }

    /// The mean; `None` where no weight was.
    pub(crate) fn mean(&self) -> Option<[f32; 4]> {
        let total = |v: &[f32; LANES]| ((v[0] + v[4]) + (v[1] + v[5])) + ((v[2] + v[6]) + (v[3] + v[7]));
        let weight = total(&self.weight);
        (weight > 0.0).then(|| std::array::from_fn(|c| self.base[c] + total(&self.above[c]) / weight))
    }
}

/// A Gaussian on the sphere: factors to the squares of Lambert's coordinates along its two axes, for the exponent of 2.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Dome {
    pub(crate) scale: [f32; 2],
}

/// Eight directions on a line of a map of all directions, in the frame of a lobe: component q (0 along the lobe's centre, 1
/// and 2 along its axes) of direction k is `at[q] + x[k] across[0][q] + y[k] across[1][q]`. Their squared lengths are
/// `squared + x[k]^2` if these are given, else 1; weights count `factor` times, by the solid angle of the texel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Line<'a> {
    pub(crate) at: [f32; 3],
    pub(crate) across: [[f32; 3]; 2],
    pub(crate) x: &'a [f32; LANES],
    pub(crate) y: &'a [f32; LANES],
    pub(crate) squared: Option<f32>,
    pub(crate) factor: f32,
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn dome_avx2(simd: Avx2, dome: &Dome, line: &Line<'_>) -> [f32; LANES] {
    dome_any(simd, dome, line)
}

#[inline(always)]
fn dome_any<S: Simd>(simd: S, dome: &Dome, line: &Line<'_>) -> [f32; LANES] {
    let one = simd.splat(1.0);
    let (x, y) = (simd.load(line.x), simd.load(line.y));
    let component = |q: usize| {
        let sum = simd.add(simd.splat(line.at[q]), simd.mul(x, simd.splat(line.across[0][q])));
        simd.add(sum, simd.mul(y, simd.splat(line.across[1][q])))
    };
    let mut q = [component(0), component(1), component(2)];
    let mut factor = simd.splat(line.factor);
    if let Some(squared) = line.squared {
        let length = simd.sqrt(simd.add(simd.splat(squared), simd.mul(x, x)));
        let inverse = simd.div(one, length);
        q = q.map(|q| simd.mul(q, inverse));
        factor = simd.mul(factor, simd.mul(inverse, simd.mul(inverse, inverse)));
    }
    let square = |q: S::F, scale: f32| simd.mul(simd.mul(q, q), simd.splat(scale));
    let sum = simd.add(square(q[1], dome.scale[0]), square(q[2], dome.scale[1]));
    let below = simd.max(simd.add(one, q[0]), simd.splat(1e-6));
    let exponent = simd.div(simd.mul(sum, simd.splat(2.0)), below);
    let weight = simd.max(simd.sub(exp2(simd, exponent), simd.splat(FLOOR)), simd.splat(0.0));
    simd.store(simd.mul(weight, factor))
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn weighted_avx2<T: Texel, const N: usize>(
    simd: Avx2,
    sums: &mut Sums,
    weights: &[f32; LANES],
    lanes: (usize, usize),
    texels: (&[T], usize, usize),
) {
    weighted_any::<_, T, N>(simd, sums, weights, lanes, texels);
}

#[inline(always)]
fn weighted_any<S: Simd, T: Texel, const N: usize>(
    simd: S,
    sums: &mut Sums,
    weights: &[f32; LANES],
    (from, to): (usize, usize),
    (values, at, plane): (&[T], usize, usize),
) {
    let mut taken = Taken::<S, N>::of(simd, sums);
    let weight = simd.only(simd.load(weights), from, to);
    taken.total = simd.add(taken.total, weight);
    for c in 0..N {
        let first = (at + c * plane) as isize - from as isize;
        let above = simd.sub(eight(simd, values, first, from, to), taken.base[c]);
        taken.above[c] = simd.add(taken.above[c], simd.mul(weight, above));
    }
    taken.put(sums);
}

/// Texels of a row that lie side by side, see [`Sums::run`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Run<'a, T> {
    pub(crate) values: &'a [T],
    pub(crate) at: usize,
    pub(crate) plane: usize,
    pub(crate) count: usize,
}

/// Rows of one tile that lie under an ellipse as a whole, see [`Sums::rows`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rows<'a, T> {
    pub(crate) values: &'a [T],
    /// Distance between the channels of a texel, and between rows.
    pub(crate) plane: usize,
    pub(crate) stride: usize,
    /// Channel `first` is the first.
    pub(crate) first: usize,
    /// Centre of the ellipse.
    pub(crate) centre: (f32, f32),
    /// What (0, 0) of the tile is in the picture; of that, rows `y.0 ..= y.1` are looked at.
    pub(crate) corner: (i32, i32),
    pub(crate) y: (i32, i32),
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn run_avx2<T: Texel, const N: usize>(simd: Avx2, sums: &mut Sums, row: &mut Row, run: Run<'_, T>) {
    run_any::<_, T, N>(simd, sums, row, run);
}

#[inline(always)]
fn run_any<S: Simd, T: Texel, const N: usize>(simd: S, sums: &mut Sums, row: &mut Row, run: Run<'_, T>) {
    let mut taken = Taken::<S, N>::of(simd, sums);
    let mut weights = Weights::of(simd, row, sums.bend);
    row.lane = taken.chunks(&mut weights, row.lane, run);
    (row.weight, row.step, row.state) = (simd.store(weights.weight), simd.store(weights.step), weights.state);
    taken.put(sums);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn rows_avx2<T: Texel, const N: usize>(simd: Avx2, sums: &mut Sums, g: &Gaussian, rows: Rows<'_, T>) {
    rows_any::<_, T, N>(simd, sums, g, rows);
}

#[inline(always)]
fn rows_any<S: Simd, T: Texel, const N: usize>(simd: S, sums: &mut Sums, g: &Gaussian, rows: Rows<'_, T>) {
    let zero = simd.splat(0.0);
    let mut taken = Taken::<S, N>::of(simd, sums);
    for y in rows.y.0..=rows.y.1 {
        let dy = y as f32 - rows.centre.1;
        let Some((x, end)) = g.row(rows.centre.0, dy) else { continue };
        if x >= end {
            continue;
        }
        let at = (y - rows.corner.1) as usize * rows.stride
            + rows.first * rows.plane
            + (x - rows.corner.0) as usize;
        if !sums.begun {
            sums.begun = true;
            for c in 0..N {
                sums.base[c] = rows.values[at + c * rows.plane].raw();
            }
            taken = Taken::of(simd, sums);
        }
        let mut weights = Weights {
            simd,
            exponents: g.exponents(dy),
            dx: x as f32 - rows.centre.0,
            bend: simd.splat(sums.bend),
            weight: zero,
            step: zero,
            state: State::New,
        };
        let run = Run { values: rows.values, at, plane: rows.plane, count: (end - x) as usize };
        taken.chunks(&mut weights, 0, run);
    }
    taken.put(sums);
}

/// Sums at work.
struct Taken<S: Simd, const N: usize> {
    simd: S,
    base: [S::F; N],
    above: [S::F; N],
    total: S::F,
}

impl<S: Simd, const N: usize> Taken<S, N> {
    #[inline(always)]
    fn of(simd: S, sums: &Sums) -> Self {
        Self {
            simd,
            base: std::array::from_fn(|c| simd.splat(sums.base[c])),
            above: std::array::from_fn(|c| simd.load(&sums.above[c])),
            total: simd.load(&sums.weight),
        }
    }

    #[inline(always)]
    fn put(&self, sums: &mut Sums) {
        for c in 0..N {
            sums.above[c] = self.simd.store(self.above[c]);
        }
        sums.weight = self.simd.store(self.total);
    }

    /// Adds a run that begins at `lane`; the lane of what follows.
    #[inline(always)]
    fn chunks<T: Texel>(&mut self, weights: &mut Weights<S>, mut lane: usize, run: Run<'_, T>) -> usize {
        let simd = self.simd;
        let Run { values, at, plane, mut count } = run;
        // Where lane 0 of the eight stands, of each channel; it may lie before the beginning.
        let mut at = at as isize - lane as isize;
        while count > 0 {
            let (from, to) = (lane, (lane + count).min(LANES));
            weights.prepare();
            let mut weight = weights.lowered();
            if to - from < LANES {
                weight = simd.only(weight, from, to);
            }
            self.total = simd.add(self.total, weight);
            for c in 0..N {
                let first = at + (c * plane) as isize;
                let above = simd.sub(eight(simd, values, first, from, to), self.base[c]);
                self.above[c] = simd.add(self.above[c], simd.mul(weight, above));
            }
            count -= to - from;
            lane = to;
            if to == LANES {
                lane = 0;
                at += LANES as isize;
                weights.next();
            }
        }
        lane
    }
}

/// The eight values from `first` on; of lanes outside `from .. to` any.
#[inline(always)]
fn eight<S: Simd, T: Texel>(simd: S, values: &[T], first: isize, from: usize, to: usize) -> S::F {
    // A place before the beginning is as a number far behind the end.
    let at = first as usize;
    match values.get(at..at.wrapping_add(LANES)).and_then(|v| v.first_chunk::<LANES>()) {
        Some(eight) => simd.texels(eight),
        None => {
            // At the ends of a tile.
            let mut out = [0.0; LANES];
            for (i, out) in out.iter_mut().enumerate().take(to).skip(from) {
                *out = values[(first + i as isize) as usize].raw();
            }
            simd.load(&out)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(i: u32) -> f32 {
        granita_base::hash::unit(granita_base::hash::words(&[i]))
    }

    #[test]
    fn powers_of_two() {
        for i in -2400..=2400 {
            let x = i as f32 * 0.05;
            let (got, exact) = (exp2_of(x), f64::from(x).exp2());
            assert!((f64::from(got) / exact - 1.0).abs() < 1e-6, "{x}: {got}");
        }
        assert!(exp2_of(f32::NEG_INFINITY) < 1e-35);
    }

    #[test]
    fn halves_are_what_the_library_says() {
        for bits in 0..=u16::MAX {
            let half = f16::from_bits(bits);
            if half.is_finite() {
                assert_eq!(half.raw().to_bits(), half.to_f32().to_bits(), "{bits}");
            }
        }
    }

    #[test]
    fn texels_are_the_same_on_all_machines() {
        fn same<T: Texel + std::fmt::Debug>(values: [T; LANES]) {
            #[cfg(target_arch = "x86_64")]
            if let Some(simd) = Avx2::here() {
                let got = simd.store(simd.texels(&values)).map(f32::to_bits);
                assert_eq!(got, Portable.texels(&values).map(f32::to_bits), "{values:?}");
            }
            assert_eq!(Portable.texels(&values), values.map(T::raw));
        }
        same([0_u8, 1, 2, 127, 128, 200, 254, 255]);
        same([0_u16, 1, 255, 256, 32767, 32768, 65534, 65535]);
        same([0_u32, 1, 1 << 24, (1 << 24) + 1, u32::MAX, 5, 6, 7]);
        same([0.0_f32, -0.0, 1e30, -1e30, 1e-40, 0.1, 0.2, 0.3]);
        same([0_u16, 1, 0x3ff, 0x400, 0x3c00, 0x7bff, 0xfbff, 0x8001].map(f16::from_bits));
    }

    #[test]
    fn lobes_are_the_same_on_all_machines() {
        let sums = Sums::new(0.0, false);
        #[cfg(target_arch = "x86_64")]
        let portable = Sums { avx2: None, ..sums };
        #[cfg(not(target_arch = "x86_64"))]
        let portable = sums;
        for i in 0..200 {
            let r = |k: u32| 2.0 * noise(i * 64 + k) - 1.0;
            let line = Line {
                at: [r(0), r(1), r(2)],
                across: [[r(3), r(4), r(5)], [r(6), r(7), r(8)]],
                x: &std::array::from_fn(|k| r(10 + k as u32)),
                y: &std::array::from_fn(|k| r(20 + k as u32)),
                squared: (i % 2 == 0).then_some(1.0 + r(9) * r(9)),
                factor: 0.5,
            };
            let dome = Dome { scale: [-10.0 * noise(i), -3.0] };
            let got = sums.weights(&dome, &line);
            assert_eq!(got.map(f32::to_bits), portable.weights(&dome, &line).map(f32::to_bits));
            // By the formula: Lambert's coordinates of the direction.
            let k = (i % 8) as usize;
            let q =
                [0, 1, 2].map(|q| line.at[q] + line.x[k] * line.across[0][q] + line.y[k] * line.across[1][q]);
            let length = line.squared.map_or(1.0, |squared| (squared + line.x[k] * line.x[k]).sqrt());
            let q = q.map(|q| q / length);
            let exponent =
                2.0 * (dome.scale[0] * q[1] * q[1] + dome.scale[1] * q[2] * q[2]) / (1.0 + q[0]).max(1e-6);
            let expected = (exponent.exp2() - FLOOR).max(0.0) * 0.5 / length.powi(3);
            assert!((got[k] - expected).abs() < 1e-5, "{line:?}: {} {expected}", got[k]);
        }
    }

    /// However a row is cut into runs, and whatever the machine has, the sums are the same to the bit.
    #[test]
    fn runs_and_machines_change_nothing() {
        let values: Vec<f32> = (0..3 * 100).map(noise).collect();
        let exponents = Exponents { a: -0.003, b: 0.01, c: -0.2 };
        let sum = |cuts: &[usize], portable: bool| {
            let mut sums = Sums::new(exponents.a, true);
            #[cfg(target_arch = "x86_64")]
            if portable {
                sums.avx2 = None;
            }
            let _ = portable;
            sums.begin(|| [0.5, 0.25, 0.125, 0.0]);
            let mut row = Row::new(exponents, -30.0);
            let mut x = 0;
            for &count in cuts {
                sums.run::<f32, 3>(&mut row, Run { values: &values, at: x, plane: 100, count });
                x += count;
            }
            sums.mean().unwrap().map(f32::to_bits)
        };
        let whole = sum(&[77], true);
        for cuts in [&[77][..], &[3, 74], &[8, 69], &[1, 1, 1, 20, 9, 45], &[76, 1]] {
            assert_eq!(sum(cuts, false), whole, "{cuts:?}");
            assert_eq!(sum(cuts, true), whole, "{cuts:?}");
        }
        // One by one.
        let mut sums = Sums::new(exponents.a, true);
        sums.begin(|| [0.5, 0.25, 0.125, 0.0]);
        let mut row = Row::new(exponents, -30.0);
        for x in 0..77 {
            sums.add(&mut row, [values[x], values[100 + x], values[200 + x], 0.0]);
        }
        assert_eq!(sums.mean().unwrap().map(f32::to_bits), whole);
    }
}
