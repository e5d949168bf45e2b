//! Powers and logarithms that have the same bits on every machine. They are computed in double precision by basic
//! operations alone, without branches, so that the compiler makes loops over them into vector code.

/// Returns the logarithm to the base 2 of a positive number; negative infinity for 0, infinity for infinity, and NaN
/// for NaN and negative numbers. The error is below 2e-11 of the result.
#[inline(always)]
pub fn log2(x: f32) -> f64 {
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
    // The polynomial of least relative error, 1.7e-11, that is 1 at 0.
    let series = 1.0
        + t2 * (0.333_333_332_772_485_45
            + t2 * (0.200_000_609_199_041_3
                + t2 * (0.142_754_104_079_093_06 + t2 * 0.116_652_336_094_949_96)));
    // Special cases are added as a float, which costs less than to choose among doubles. Others add 0.
    let whole = (exponent - if small { 24 } else { 0 }) as f32;
    let special = if x == 0.0 { f32::NEG_INFINITY } else { 0.0 };
    let special = if x == f32::INFINITY { f32::INFINITY } else { special };
    let special = if x >= 0.0 { special } else { f32::NAN };
    t * series * (2.0 * std::f64::consts::LOG2_E) + f64::from(whole + special)
}

/// Returns 2 to the power `x`, for results that a float can hold. Larger results are infinite as floats. The relative
/// error is below 2e-10.
#[inline(always)]
pub fn exp2(x: f64) -> f64 {
    // Adding 1.5 * 2^52 rounds to an integer, which is then in the low bits.
    const ROUND: f64 = 6_755_399_441_055_744.0;
    let bounded = if x < -1000.0 { -1000.0 } else { x };
    let bounded = if bounded > 1000.0 { 1000.0 } else { bounded };
    let rounded = bounded + ROUND;
    let power = f64::from_bits((rounded.to_bits().wrapping_add(1023)) << 52);
    let f = bounded - (rounded - ROUND);
    // The polynomial of least relative error, 1.1e-10, that is 1 at 0.
    let series = 1.0
        + f * (std::f64::consts::LN_2
            + f * (0.240_226_509_222_888_32
                + f * (0.055_504_108_839_094_055
                    + f * (0.009_618_056_678_514_34
                        + f * (0.001_333_350_238_627_386
                            + f * (0.000_154_614_447_015_618_77 + f * 0.000_015_297_323_757_738_564))))));
    series * power
}

/// Returns `x` to the power `y`, for `x >= 0` and `y > 0`.
#[inline(always)]
pub fn pow(x: f32, y: f64) -> f32 {
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
