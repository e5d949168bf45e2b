//! Transcendental functions without branches, so that loops over them vectorise.
//!
//! Polynomials and reductions follow the Cephes library (Moshier, single precision). Arguments outside of their
//! range go to `libm`, which is written in Rust. No result depends on the machine's own library. A lane's result is
//! the same in a vector loop and alone. Errors are listed in `docs/language.md` and checked by a test against double
//! precision. Other crates use them where they must have the results of shaders.

use std::f32::consts::{FRAC_2_PI, FRAC_PI_2, FRAC_PI_4, LOG2_E};

/// The largest magnitude in radians for which the three-part reduction by pi/2 is accurate.
const MOST_TURNS: f32 = 8192.0;

/// Selects one of two values without branches.
#[inline(always)]
fn pick(condition: bool, a: f32, b: f32) -> f32 {
    if condition { a } else { b }
}

/// Returns the nearest whole number as a float and as an integer, for magnitudes below 2^22. For others, both are any
/// numbers.
#[inline(always)]
fn nearest(x: f32) -> (f32, i32) {
    // Adding 1.5 * 2^23 leaves no fractional bits, and the integer in the lowest ones. A cast, which saturates, would
    // take longer.
    const BIG: f32 = 12_582_912.0;
    let shifted = x + BIG;
    (shifted - BIG, shifted.to_bits().wrapping_sub(BIG.to_bits()) as i32)
}

/// Returns the nearest whole number as [`nearest`] does, for magnitudes below 2^31.
#[inline(always)]
fn nearest_double(x: f64) -> (f64, i32) {
    const BIG: f64 = 6_755_399_441_055_744.0;
    let shifted = x + BIG;
    (shifted - BIG, shifted.to_bits() as u32 as i32)
}

/// Returns the largest whole number that is not larger, as `f32::floor`, in a form that vectorises everywhere.
#[inline(always)]
pub fn floor(x: f32) -> f32 {
    let whole = x as i32 as f32;
    let down = whole - pick(whole > x, 1.0, 0.0);
    // Beyond 2^23 all numbers are whole. The sign of zero is kept.
    pick(x.abs() < 8_388_608.0, down.abs().copysign(pick(down == 0.0, x, down)), x)
}

/// Returns the number of quarter turns and the remainder within [-pi/4, pi/4].
#[inline(always)]
fn quarters(x: f32) -> (i32, f32) {
    let (k, turns) = nearest(x * FRAC_2_PI);
    let r = ((x - k * 1.570_312_5) - k * 4.837_513e-4) - k * 7.549_79e-8;
    (turns, r)
}

#[inline(always)]
fn sin_poly(x: f32) -> f32 {
    let z = x * x;
    ((-1.951_529_6e-4 * z + 8.332_161e-3) * z - 1.666_665_5e-1) * z * x + x
}

#[inline(always)]
fn cos_poly(x: f32) -> f32 {
    let z = x * x;
    ((2.443_315_7e-5 * z - 1.388_731_6e-3) * z + 4.166_664_6e-2) * z * z - 0.5 * z + 1.0
}

/// True when [`sin_near`] and similar functions support the argument.
#[inline(always)]
pub fn turns_are_few(x: f32) -> bool {
    x.abs() <= MOST_TURNS
}

/// Returns the sine of an angle in radians that [`turns_are_few`] accepts.
#[inline(always)]
pub fn sin_near(x: f32) -> f32 {
    let (k, r) = quarters(x);
    let v = pick(k & 1 == 0, sin_poly(r), cos_poly(r));
    // Small arguments keep their sign, also that of zero.
    pick(x == 0.0, x, pick(k & 2 == 0, v, -v))
}

/// Returns the cosine of an angle in radians that [`turns_are_few`] accepts.
#[inline(always)]
pub fn cos_near(x: f32) -> f32 {
    let (k, r) = quarters(x);
    let v = pick(k & 1 == 0, cos_poly(r), sin_poly(r));
    pick(k.wrapping_add(1) & 2 == 0, v, -v)
}

/// Returns the tangent of an angle in radians that [`turns_are_few`] accepts.
#[inline(always)]
pub fn tan_near(x: f32) -> f32 {
    let (k, r) = quarters(x);
    let z = r * r;
    let p = (((((9.385_402e-3 * z + 3.119_922_3e-3) * z + 2.443_013_5e-2) * z + 5.341_128e-2) * z
        + 1.333_879_9e-1)
        * z
        + 3.333_315_7e-1)
        * z
        * r
        + r;
    pick(x == 0.0, x, pick(k & 1 == 0, p, -1.0 / p))
}

/// Returns the arcsine within [-1, 1], NaN outside.
#[inline(always)]
pub fn asin_inside(x: f32) -> f32 {
    let a = x.abs();
    let far = a > 0.5;
    let z = pick(far, 0.5 * (1.0 - a), a * a);
    let s = pick(far, z.sqrt(), a);
    let p = ((((4.216_32e-2 * z + 2.418_131e-2) * z + 4.547_002_6e-2) * z + 7.495_300_3e-2) * z
        + 1.666_675_2e-1)
        * z
        * s
        + s;
    pick(far, FRAC_PI_2 - 2.0 * p, p).copysign(x)
}

/// Returns the arccosine within [-1, 1], NaN outside.
#[inline(always)]
pub fn acos_inside(x: f32) -> f32 {
    let a = x.abs();
    let far = a > 0.5;
    let z = pick(far, 0.5 * (1.0 - a), a * a);
    let s = pick(far, z.sqrt(), a);
    let p = ((((4.216_32e-2 * z + 2.418_131e-2) * z + 4.547_002_6e-2) * z + 7.495_300_3e-2) * z
        + 1.666_675_2e-1)
        * z
        * s
        + s;
    // Near 1 the root keeps all digits.
    let near = FRAC_PI_2 - p.copysign(x);
    pick(far, pick(x < 0.0, std::f32::consts::PI - 2.0 * p, 2.0 * p), near)
}

/// Returns the arctangent of any argument, in radians.
#[inline(always)]
pub fn atan(x: f32) -> f32 {
    let a = x.abs();
    let (far, mid) = (a > 2.414_213_6, a > 0.414_213_57);
    let base = pick(far, FRAC_PI_2, pick(mid, FRAC_PI_4, 0.0));
    let r = pick(far, -1.0 / a, pick(mid, (a - 1.0) / (a + 1.0), a));
    let z = r * r;
    let p = (((8.053_744_5e-2 * z - 1.387_768_6e-1) * z + 1.997_771_1e-1) * z - 3.333_295e-1) * z * r + r;
    (base + p).copysign(x)
}

/// True when [`atan2_plain`] supports the arguments.
#[inline(always)]
pub fn is_plain(y: f32, x: f32) -> bool {
    let (a, b) = (y.abs(), x.abs());
    a > 1e-18 && a < 1e18 && b > 1e-18 && b < 1e18
}

/// Returns the angle of the point (x, y) in radians, where [`is_plain`] accepts the arguments.
#[inline(always)]
pub fn atan2_plain(y: f32, x: f32) -> f32 {
    let a = atan(y.abs() / x.abs());
    pick(x < 0.0, std::f32::consts::PI - a, a).copysign(y)
}

/// True when [`exp_near`] supports the argument: the result neither overflows nor is tiny.
#[inline(always)]
pub fn exp_is_near(x: f32) -> bool {
    x.abs() < 87.0
}

/// Returns `e^x` where [`exp_is_near`] accepts the argument.
#[inline(always)]
pub fn exp_near(x: f32) -> f32 {
    let (k, power) = nearest(x * LOG2_E);
    let r = (x - k * 0.693_359_4) + k * 2.121_944_4e-4;
    let p = ((((1.987_569_1e-4 * r + 1.398_199_9e-3) * r + 8.333_452e-3) * r + 4.166_579_6e-2) * r
        + 1.666_666_5e-1)
        * r
        + 5.0e-1;
    let y = p * r * r + r + 1.0;
    y * f32::from_bits((power.wrapping_add(127) as u32) << 23)
}

/// Returns `e^x` of any argument.
#[inline]
pub fn exp(x: f32) -> f32 {
    if exp_is_near(x) { exp_near(x) } else { libm::expf(x) }
}

/// Returns the sine of any angle in radians.
#[inline]
pub fn sin(x: f32) -> f32 {
    if turns_are_few(x) { sin_near(x) } else { libm::sinf(x) }
}

/// Returns the cosine of any angle in radians.
#[inline]
pub fn cos(x: f32) -> f32 {
    if turns_are_few(x) { cos_near(x) } else { libm::cosf(x) }
}

/// Returns the natural logarithm of any number.
#[inline]
pub fn ln(x: f32) -> f32 {
    if is_ordinary(x) { ln_ordinary(x) } else { libm::logf(x) }
}

/// Returns `x^y` of any arguments.
#[inline]
pub fn pow(x: f32, y: f32) -> f32 {
    if pow_is_ordinary(x, y) { pow_ordinary(x, y) } else { libm::powf(x, y) }
}

/// Returns the hyperbolic tangent of any argument: a polynomial near 0, `1 - 2 / (e^2x + 1)` beyond.
#[inline(always)]
pub fn tanh(x: f32) -> f32 {
    let a = x.abs();
    let z = x * x;
    let p = ((((-5.704_988_7e-3 * z + 2.063_909e-2) * z - 5.373_971_6e-2) * z + 1.333_144_2e-1) * z
        - 3.333_328e-1)
        * z
        * x
        + x;
    // From 9.1 on the nearest float is 1. NaN stays NaN.
    let far = 1.0 - 2.0 / (exp_near(pick(a > 9.5, 19.0, a + a)) + 1.0);
    pick(a < 0.625, p, far.copysign(x))
}

/// Returns the hyperbolic sine where [`exp_near`] supports the argument.
#[inline(always)]
pub fn sinh_near(x: f32) -> f32 {
    let z = x * x;
    let p = ((2.037_219_1e-4 * z + 8.330_284e-3) * z + 1.666_671_6e-1) * z * x + x;
    let e = exp_near(x.abs());
    pick(x.abs() <= 1.0, p, (0.5 * e - 0.5 / e).copysign(x))
}

/// Returns the hyperbolic cosine where [`exp_near`] supports the argument.
#[inline(always)]
pub fn cosh_near(x: f32) -> f32 {
    let e = exp_near(x.abs());
    0.5 * e + 0.5 / e
}

/// Returns `e^-x^2 P (1 / (1 + x / 2)) / (1 + x / 2)` in double precision, for `x` from 0. The polynomial is a
/// Chebyshev fit over 0 to 10.4, beyond which the result is less than the smallest float.
#[inline(always)]
fn erfc_positive(x: f64) -> f64 {
    const P: [f64; 13] = [
        -0.005_421_137_600_800_485,
        0.007_124_948_478_718_964,
        0.110_986_260_243_748_5,
        -0.511_887_639_943_664_2,
        0.992_476_599_350_474_2,
        -0.987_132_185_097_889_8,
        0.499_952_050_919_802_8,
        -0.229_191_354_822_359_7,
        0.146_191_083_757_696_7,
        0.164_542_298_060_953_94,
        0.248_268_341_391_452_2,
        0.281_992_740_538_562_6,
        0.282_097_994_658_324_5,
    ];
    let x = if x > 10.4 { 10.4 } else { x };
    let t = 1.0 / (1.0 + 0.5 * x);
    let p = P.iter().fold(0.0, |sum, c| sum * t + c);
    t * p * exp_double(-(x * x))
}

/// Returns the exponential function for -500 to 500 within 1e-8.
#[inline(always)]
fn exp_double(x: f64) -> f64 {
    let (k, whole) = nearest_double(x * std::f64::consts::LOG2_E);
    let r = x - k * std::f64::consts::LN_2;
    let p = 1.0
        + r * (1.0
            + r * (0.5
                + r * (1.0 / 6.0
                    + r * (1.0 / 24.0 + r * (1.0 / 120.0 + r * (1.0 / 720.0 + r * (1.0 / 5040.0)))))));
    // The power of two is split into two halves, so that each is a float.
    let half = whole >> 1;
    let power = |k: i32| f64::from(f32::from_bits((k.wrapping_add(127) as u32) << 23));
    p * power(half) * power(whole.wrapping_sub(half))
}

/// Returns the error function of any argument.
#[inline(always)]
pub fn erf(x: f32) -> f32 {
    const T: [f64; 8] = [
        -9.667_044_571_486_997e-6,
        0.000_112_659_590_256_066_09,
        -0.000_848_408_040_553_510_6,
        0.005_221_031_807_858_023,
        -0.026_865_430_727_670_243,
        0.112_837_824_952_368_45,
        -0.376_126_384_680_287_1,
        1.128_379_167_061_543_4,
    ];
    let y = f64::from(x.abs());
    let z = y * y;
    let [t7, t6, t5, t4, t3, t2, t1, t0] = T;
    let near = y * (((((((t7 * z + t6) * z + t5) * z + t4) * z + t3) * z + t2) * z + t1) * z + t0);
    let far = 1.0 - erfc_positive(y);
    // NaN takes the far branch.
    ((if y < 1.0 { near } else { far }) as f32).copysign(x)
}

/// Returns the complementary error function, also where it is tiny.
#[inline(always)]
pub fn erfc(x: f32) -> f32 {
    let tail = erfc_positive(f64::from(x.abs()));
    (if x < 0.0 { 2.0 - tail } else { tail }) as f32
}

/// True when a number is positive, normal and finite, as logarithms need it.
#[inline(always)]
pub fn is_ordinary(x: f32) -> bool {
    (f32::MIN_POSITIVE..=f32::MAX).contains(&x)
}

/// Returns the exponent and a mantissa from sqrt 1/2 to sqrt 2.
#[inline(always)]
fn parts(x: f32) -> (f32, f32) {
    let bits = x.to_bits() as i32;
    let e = ((bits >> 23) & 0xff) - 126;
    let m = f32::from_bits((bits as u32 & 0x007f_ffff) | 0x3f00_0000);
    let small = m < std::f32::consts::FRAC_1_SQRT_2;
    (e as f32 - pick(small, 1.0, 0.0), pick(small, m + m, m))
}

/// Returns the natural logarithm where [`is_ordinary`] accepts the argument.
#[inline(always)]
pub fn ln_ordinary(x: f32) -> f32 {
    let (e, m) = parts(x);
    let r = m - 1.0;
    let z = r * r;
    let p = ((((((((7.037_683_6e-2 * r - 1.151_461e-1) * r + 1.167_699_9e-1) * r - 1.242_014_1e-1) * r
        + 1.424_932_3e-1)
        * r
        - 1.666_805_8e-1)
        * r
        + 2.000_071_5e-1)
        * r
        - 2.499_999_4e-1)
        * r
        + 3.333_333e-1)
        * r
        * z;
    (p + e * -2.121_944_4e-4 - 0.5 * z) + r + e * 0.693_359_4
}

/// Returns the logarithm to base 2 where [`is_ordinary`] accepts the argument.
#[inline(always)]
pub fn log2_ordinary(x: f32) -> f32 {
    let (e, m) = parts(x);
    // Whole exponents stay exact.
    e + (log2_of_mantissa(m) as f32)
}

/// Returns the logarithm to base 10 where [`is_ordinary`] accepts the argument.
#[inline(always)]
pub fn log10_ordinary(x: f32) -> f32 {
    let (e, m) = parts(x);
    ((f64::from(e) + log2_of_mantissa(m)) * std::f64::consts::LOG10_2) as f32
}

/// Returns the logarithm in double precision, for arguments from sqrt 1/2 to sqrt 2, as twice the inverse
/// hyperbolic tangent.
#[inline(always)]
fn log2_of_mantissa(m: f32) -> f64 {
    let m = f64::from(m);
    let s = (m - 1.0) / (m + 1.0);
    let z = s * s;
    let p = ((((z / 13.0 + 1.0 / 11.0) * z + 1.0 / 9.0) * z + 1.0 / 7.0) * z + 1.0 / 5.0) * z + 1.0 / 3.0;
    2.0 * std::f64::consts::LOG2_E * (s + s * z * p)
}

/// True when [`pow_ordinary`] supports the arguments.
#[inline(always)]
pub fn pow_is_ordinary(x: f32, y: f32) -> bool {
    // The product of exponents must stay within those of floats. The error of the logarithm is multiplied, too.
    is_ordinary(x) && y.abs() < 1e6 && f64::from(y).abs() * (approximate_log2(x).abs() + LOG2_ERROR) < 125.0
}

/// The largest error of [`approximate_log2`].
const LOG2_ERROR: f64 = 0.051;

/// Returns the logarithm to base 2 within [`LOG2_ERROR`], from the bits of the float.
#[inline(always)]
fn approximate_log2(x: f32) -> f64 {
    f64::from(x.to_bits() as i32) * (1.0 / 8_388_608.0) - 126.95
}

/// Returns `x^y`, computed in double precision.
#[inline(always)]
pub fn pow_ordinary(x: f32, y: f32) -> f32 {
    let (e, m) = parts(x);
    let t = (f64::from(e) + log2_of_mantissa(m)) * f64::from(y);
    let (k, power) = nearest_double(t);
    let r = (t - k) * std::f64::consts::LN_2;
    let p = 1.0
        + r * (1.0
            + r * (0.5
                + r * (1.0 / 6.0
                    + r * (1.0 / 24.0 + r * (1.0 / 120.0 + r * (1.0 / 720.0 + r * (1.0 / 5040.0)))))));
    (p as f32) * f32::from_bits((power.wrapping_add(127) as u32) << 23)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn functions_of_any_argument_continue_those_of_ordinary_ones() {
        for x in [-1e30_f32, -9000.0, -100.0, -1.0, 0.0, 1e-40, 0.5, 1.0, 86.0, 88.0, 100.0, 8193.0, 1e30] {
            let wide = f64::from(x);
            let pairs = [(exp(x), wide.exp()), (sin(x), wide.sin()), (cos(x), wide.cos())];
            for (got, due) in pairs.into_iter().chain((x > 0.0).then(|| (ln(x), wide.ln()))) {
                let due = due as f32;
                assert!(got == due || (got - due).abs() <= 4e-7 * due.abs().max(1e-3), "{x}: {got} {due}");
            }
        }
        assert_eq!([pow(0.0, 2.0), pow(2.0, 10.0), pow(1e30, 3.0)], [0.0, 1024.0, f32::INFINITY]);
        assert!(ln(-1.0).is_nan() && pow(-1.0, 0.5).is_nan() && exp(f32::NAN).is_nan());
    }

    /// Distance in units in the last place of the true value.
    fn ulps(got: f32, wanted: f64) -> f64 {
        let nearest = wanted as f32;
        if nearest == got {
            return 0.0;
        }
        let unit = f64::from(f32::from_bits(nearest.abs().to_bits() + 1)) - f64::from(nearest.abs());
        (f64::from(got) - wanted).abs() / unit
    }

    /// Largest error over a range, geometrically spaced in both signs where asked.
    fn worst(range: (f32, f32), signs: &[f32], f: impl Fn(f32) -> f32, exact: impl Fn(f64) -> f64) -> f64 {
        let n = 200_000;
        let mut most = 0.0_f64;
        for k in 0..=n {
            let t = k as f32 / n as f32;
            let x = if range.0 > 0.0 {
                range.0 * (range.1 / range.0).powf(t)
            } else {
                range.0 + (range.1 - range.0) * t
            };
            for s in signs {
                most = most.max(ulps(f(x * s), exact(f64::from(x * s))));
            }
        }
        most
    }

    #[test]
    fn errors_of_approximations_are_as_documented() {
        let both = [1.0, -1.0];
        let table = [
            ("sin, to 100", worst((1e-6, 100.0), &both, sin_near, f64::sin), 2.0e3),
            ("exp", worst((1e-6, 86.9), &both, exp_near, f64::exp), 2.0),
            ("log", worst((1e-37, 1e38), &[1.0], ln_ordinary, f64::ln), 2.0),
            ("log2", worst((1e-37, 1e38), &[1.0], log2_ordinary, f64::log2), 1.5),
            ("log10", worst((1e-37, 1e38), &[1.0], log10_ordinary, f64::log10), 1.5),
            ("asin", worst((1e-6, 1.0), &both, asin_inside, f64::asin), 3.0),
            ("acos", worst((1e-6, 1.0), &both, acos_inside, f64::acos), 3.0),
            ("atan", worst((1e-6, 1e6), &both, atan, f64::atan), 3.0),
            ("tan, to pi/4", worst((1e-6, 0.785), &both, tan_near, f64::tan), 3.0),
            ("tanh", worst((1e-6, 12.0), &both, tanh, f64::tanh), 2.0),
            ("sinh", worst((1e-6, 86.9), &both, sinh_near, f64::sinh), 2.0),
            ("cosh", worst((1e-6, 86.9), &both, cosh_near, f64::cosh), 2.0),
            ("erf", worst((1e-6, 6.0), &both, erf, libm::erf), 1.0),
            ("erfc", worst((1e-6, 9.0), &both, erfc, libm::erfc), 1.0),
            ("sin, to pi/4", worst((1e-6, 0.785), &both, sin_near, f64::sin), 2.0),
            ("cos, to pi/4", worst((1e-6, 0.785), &both, cos_near, f64::cos), 2.0),
        ];
        for (name, error, allowed) in table {
            assert!(error <= allowed, "{name}: {error} ulp, {allowed} allowed");
        }
        // Far from zero the error of a sine is absolute: the reduction's.
        for k in 0..100_000 {
            let x = k as f32 * 0.0819;
            assert!((f64::from(sin_near(x)) - f64::from(x).sin()).abs() < 1.2e-7, "{x}");
            assert!((f64::from(cos_near(x)) - f64::from(x).cos()).abs() < 1.2e-7, "{x}");
        }
    }

    #[test]
    fn powers_are_exact_to_one_ulp() {
        let mut most = 0.0_f64;
        for i in 1..600 {
            for j in -60..60 {
                let (x, y) = (i as f32 * 0.037, j as f32 * 0.31);
                if pow_is_ordinary(x, y) {
                    most = most.max(ulps(pow_ordinary(x, y), f64::from(x).powf(f64::from(y))));
                }
            }
        }
        assert!(most <= 1.0, "{most} ulp");
        assert!(pow_is_ordinary(0.5, 20.0) && !pow_is_ordinary(-1.0, 2.0) && !pow_is_ordinary(10.0, 50.0));
        assert_eq!(
            (pow_ordinary(2.0, 10.0), pow_ordinary(1.0, 1e5), pow_ordinary(4.0, 0.5)),
            (1024.0, 1.0, 2.0)
        );
    }

    /// Highlights have large exponents (8 / roughness), and their powers end within the range of `pow_ordinary`.
    #[test]
    fn powers_with_large_exponents_stay_in_range() {
        for i in 1..=4000 {
            let x = i as f32 / 4000.0;
            for y in [-800.0, -80.0, 80.0, 133.33, 800.0, 9e5] {
                if pow_is_ordinary(x, y) {
                    let exact = f64::from(x).powf(f64::from(y));
                    assert!(ulps(pow_ordinary(x, y), exact) <= 1.0, "{x} to {y}: {}", pow_ordinary(x, y));
                }
            }
        }
    }

    #[test]
    fn floors_equal_the_library() {
        for x in [
            0.0,
            -0.0,
            0.5,
            -0.5,
            1.0,
            -1.0,
            1e9,
            -1e9,
            8_388_607.5,
            -8_388_607.5,
            f32::INFINITY,
            1e-30,
            -1e-30,
        ] {
            assert_eq!(floor(x).to_bits(), x.floor().to_bits(), "{x}");
        }
        assert!(floor(f32::NAN).is_nan());
    }

    #[test]
    fn atan2_is_correct_in_all_quadrants() {
        for (y, x) in [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0), (0.1, -7.0), (3.0, 0.001)] {
            let got = atan2_plain(y, x);
            assert!((got - libm::atan2f(y, x)).abs() < 3e-7, "{y} {x}: {got}");
        }
        assert!(!is_plain(0.0, 1.0) && !is_plain(1.0, f32::INFINITY) && !is_plain(f32::NAN, 1.0));
    }
}
