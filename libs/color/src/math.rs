//! Powers and logarithms that have the same bits on every machine. They are computed in double precision by basic
//! operations alone, without branches, so that the compiler makes loops over them into vector code.

/// Returns the logarithm to the base 2 of a positive number; negative infinity for 0, infinity for infinity, and NaN
/// for NaN and negative numbers. The relative error is below 1e-12.
#[inline(always)]
pub(crate) fn log2(x: f32) -> f64 {
    // Denormal numbers become normal ones.
    let small = x < f32::MIN_POSITIVE;
    let scaled = if small { x * 16_777_216.0 } else { x };
    let bits = scaled.to_bits();
    // The mantissa lies in [sqrt(1/2), sqrt(2)).
    let shifted = bits.wrapping_sub(0x3f35_04f3);
    let exponent = (shifted as i32) >> 23;
    let m = f64::from(f32::from_bits((shifted & 0x007f_ffff).wrapping_add(0x3f35_04f3)));
    // ln m = 2 atanh t with t = (m - 1) / (m + 1), and |t| < 0.1716.
    let t = (m - 1.0) / (m + 1.0);
    let t2 = t * t;
    let series = 1.0
        + t2 * (1.0 / 3.0
            + t2 * (1.0 / 5.0 + t2 * (1.0 / 7.0 + t2 * (1.0 / 9.0 + t2 * (1.0 / 11.0 + t2 * (1.0 / 13.0))))));
    let found =
        t * series * (2.0 * std::f64::consts::LOG2_E) + f64::from(exponent - if small { 24 } else { 0 });
    let found = if x == 0.0 { f64::NEG_INFINITY } else { found };
    let found = if x == f32::INFINITY { f64::INFINITY } else { found };
    if x >= 0.0 { found } else { f64::NAN }
}

/// Returns 2 to the power `x`, for results that a float can hold. Larger results are infinite as floats. The relative
/// error is below 1e-11.
#[inline(always)]
pub(crate) fn exp2(x: f64) -> f64 {
    // Adding 1.5 * 2^52 rounds to an integer, which is then in the low bits.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    let bounded = if x < -1000.0 { -1000.0 } else { x };
    let bounded = if bounded > 1000.0 { 1000.0 } else { bounded };
    let rounded = bounded + ROUND;
    let power = f64::from_bits((rounded.to_bits().wrapping_add(1023)) << 52);
    let f = (bounded - (rounded - ROUND)) * std::f64::consts::LN_2;
    let series = 1.0
        + f * (1.0
            + f * (1.0 / 2.0
                + f * (1.0 / 6.0
                    + f * (1.0 / 24.0
                        + f * (1.0 / 120.0
                            + f * (1.0 / 720.0
                                + f * (1.0 / 5040.0 + f * (1.0 / 40_320.0 + f * (1.0 / 362_880.0)))))))));
    series * power
}

/// Returns `x` to the power `y`, for `x >= 0` and `y > 0`.
#[inline(always)]
pub(crate) fn pow(x: f32, y: f64) -> f32 {
    exp2(log2(x) * y) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn special_values_have_their_limits() {
        assert_eq!(log2(0.0), f64::NEG_INFINITY);
        assert_eq!(log2(f32::INFINITY), f64::INFINITY);
        assert!(log2(-1.0).is_nan() && log2(f32::NAN).is_nan());
        assert_eq!((log2(1.0), log2(8.0), log2(0.25)), (0.0, 3.0, -2.0));
        assert_eq!((exp2(0.0), exp2(3.0), exp2(-2.0)), (1.0, 8.0, 0.25));
        assert_eq!((pow(0.0, 2.2), pow(1.0, 2.2)), (0.0, 1.0));
        assert_eq!(pow(f32::INFINITY, 0.5), f32::INFINITY);
        assert!(pow(f32::NAN, 0.5).is_nan());
        assert_eq!(exp2(5000.0) as f32, f32::INFINITY);
        assert_eq!(exp2(-5000.0) as f32, 0.0);
        let least = f32::from_bits(1);
        assert_eq!(log2(least), -149.0);
    }

    proptest! {
        #[test]
        fn powers_agree_with_those_of_the_system(bits in 1_u32..0x7f80_0000, y in 0.1_f64..6.0) {
            let x = f32::from_bits(bits);
            let expected = f64::from(x).log2();
            prop_assert!((log2(x) - expected).abs() <= 1e-11 * expected.abs().max(1e-3), "{x}");
            let expected = f64::from(x).powf(y) as f32;
            let got = pow(x, y);
            prop_assert!(got == expected || (got - expected).abs() <= 3e-7 * expected.abs(), "{x} {y}: {got} {expected}");
        }
    }
}
