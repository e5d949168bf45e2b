//! Functions of one value, applied to many.

use crate::aces;
use crate::table::{Interpolation, Lut1d, LutInverse};
use crate::transform::{Cdl, ExposureContrast, LogParams, Named, Negatives, Scale};
use granita_base::math::{exp2, log2, pow};
use granita_machine::widest;
use std::sync::Arc;

/// Replaces all values by an expression of them. It is a macro because functions that are passed may be called instead
/// of inlined, and are then not compiled for the vectors of the caller.
macro_rules! each {
    ($values:expr, |$v:ident| $result:expr) => {
        for value in $values {
            let $v = *value;
            *value = $result;
        }
    };
}

/// Does the same for the magnitudes of values, with the sign kept, when `$mirror` is true.
macro_rules! mirrored {
    ($values:expr, $mirror:expr, |$v:ident| $result:expr) => {
        each!($values, |stored| {
            let $v = if $mirror { stored.abs() } else { stored };
            let found = $result;
            if $mirror { found.copysign(stored) } else { found }
        })
    };
}

/// A line near black, and the value up to which it is used. Negative infinity where there is no line.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Line {
    end: f32,
    slope: f64,
    offset: f64,
}

impl Line {
    const NONE: Self = Self { end: f32::NEG_INFINITY, slope: 1.0, offset: 0.0 };
}

/// A function of one value.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Curve {
    /// Nothing changes.
    Same,
    /// A power.
    Power(f64, Negatives),
    /// A power with a line: `(x * scale + offset) ^ gamma`.
    Moncurve { scale: f64, offset: f64, gamma: f64, line: Line, mirror: bool },
    /// Its inverse: `x ^ gamma * scale - offset`.
    MoncurveInverse { scale: f64, offset: f64, gamma: f64, line: Line, mirror: bool },
    /// `a * log2 (s * x + o) + b`.
    Log { a: f64, b: f64, s: f64, o: f64, line: Line },
    /// Its inverse.
    LogInverse { a: f64, b: f64, s: f64, o: f64, line: Line },
    /// `scale * x + offset`, limited.
    Range { scale: f64, offset: f64, low: f32, high: f32 },
    /// `(x * scale) ^ power * factor`, of values that are not negative.
    Contrast { scale: f64, power: f64, factor: f64 },
    /// A function with a definition of its own. True for its inverse.
    Named(Named, bool),
    /// A channel of a table.
    Table(Arc<Lut1d>, usize),
    /// The inverse of a channel of a table.
    TableInverse(Arc<LutInverse>),
}

impl Curve {
    /// Returns the power of a channel. `None` when the inverse does not exist.
    pub(crate) fn power(value: f64, negatives: Negatives, inverse: bool) -> Option<Self> {
        let y = if inverse { 1.0 / value } else { value };
        match y {
            1.0 => Some(Self::Same),
            y if y.is_finite() && y > 0.0 => Some(Self::Power(y, negatives)),
            _ => None,
        }
    }

    /// Returns the power with a line, as OpenColorIO computes its parameters.
    pub(crate) fn moncurve(gamma: f64, offset: f64, mirror: bool, inverse: bool) -> Self {
        // An exact 1 and 0 are within rounding of what they mean.
        if gamma == 1.0 && offset == 0.0 {
            return Self::Same;
        }
        let (gamma, offset) = (gamma.max(1.000_001), offset.max(1e-6));
        let ratio = offset * gamma / ((gamma - 1.0) * (1.0 + offset));
        if inverse {
            let slope =
                libm::pow((gamma - 1.0) / offset, gamma - 1.0) * libm::pow((1.0 + offset) / gamma, gamma);
            let line = Line { end: libm::pow(ratio, gamma) as f32, slope, offset: 0.0 };
            return Self::MoncurveInverse { scale: 1.0 + offset, offset, gamma: 1.0 / gamma, line, mirror };
        }
        let slope = (gamma - 1.0) / offset * libm::pow(ratio, gamma);
        let line = Line { end: (offset / (gamma - 1.0)) as f32, slope, offset: 0.0 };
        Self::Moncurve { scale: 1.0 / (1.0 + offset), offset: offset / (1.0 + offset), gamma, line, mirror }
    }

    /// Returns the logarithm of channel `c`. `None` when parameters have no inverse or no logarithm.
    pub(crate) fn log(p: &LogParams, c: usize, inverse: bool) -> Option<Self> {
        let base = libm::log2(p.base);
        if p.base <= 0.0 || base == 0.0 || !base.is_finite() || p.log_slope[c] == 0.0 || p.lin_slope[c] == 0.0
        {
            return None;
        }
        let (a, b) = (p.log_slope[c] / base, p.log_offset[c]);
        let (s, o) = (p.lin_slope[c], p.lin_offset[c]);
        let line = match p.lin_break {
            None => Line::NONE,
            Some(at) => {
                let at = at[c];
                let inner = s * at + o;
                let end = a * libm::log2(inner) + b;
                let slope = match p.linear_slope {
                    Some(slope) => slope[c],
                    None => a * s / (inner * std::f64::consts::LN_2),
                };
                let offset = end - slope * at;
                if !(slope.is_finite() && offset.is_finite()) || slope == 0.0 {
                    return None;
                }
                Line { end: if inverse { end } else { at } as f32, slope, offset }
            }
        };
        Some(if inverse { Self::LogInverse { a, b, s, o, line } } else { Self::Log { a, b, s, o, line } })
    }

    /// Returns a range: lower input, upper input, lower output and upper output. `None` when it has no slope.
    pub(crate) fn range(values: [Option<f64>; 4], clamp: bool, inverse: bool) -> Option<Self> {
        let [low_in, high_in, low_out, high_out] =
            if inverse { [values[2], values[3], values[0], values[1]] } else { values };
        let (scale, offset) = match (low_in, high_in, low_out, high_out) {
            (Some(a), Some(b), Some(c), Some(d)) if a != b => {
                let scale = (d - c) / (b - a);
                (scale, c - scale * a)
            }
            (Some(_), Some(_), Some(_), Some(_)) => return None,
            (Some(a), None, Some(c), None) => (1.0, c - a),
            (None, Some(b), None, Some(d)) => (1.0, d - b),
            _ => return None,
        };
        if scale == 0.0 && inverse {
            return None;
        }
        let limit = |v: Option<f64>, open: f32| v.filter(|_| clamp).map_or(open, |v| v as f32);
        let (low, high) = (limit(low_out, f32::NEG_INFINITY), limit(high_out, f32::INFINITY));
        Some(Self::Range { scale, offset, low, high })
    }

    /// Returns an exposure and a contrast.
    pub(crate) fn exposure_contrast(p: &ExposureContrast, inverse: bool) -> Self {
        const VIDEO: f64 = 0.546_448_087_431_693_9;
        let contrast = (p.contrast * p.gamma).max(0.001);
        if p.scale == Scale::Log {
            let pivot = libm::log2(p.pivot.max(0.001) / 0.18) * p.log_step + p.log_mid_grey;
            let pivot = pivot.max(0.0);
            let (scale, offset) = (contrast, (p.exposure * p.log_step - pivot) * contrast + pivot);
            let (scale, offset) = if inverse { (1.0 / scale, -offset / scale) } else { (scale, offset) };
            return Self::Range { scale, offset, low: f32::NEG_INFINITY, high: f32::INFINITY };
        }
        let power = if p.scale == Scale::Video { VIDEO } else { 1.0 };
        let (pivot, exposure) =
            (libm::pow(p.pivot.max(0.001), power), libm::pow(libm::pow(2_f64, p.exposure), power));
        if contrast == 1.0 {
            let scale = if inverse { 1.0 / exposure } else { exposure };
            return Self::Range { scale, offset: 0.0, low: f32::NEG_INFINITY, high: f32::INFINITY };
        }
        if inverse {
            return Self::Contrast { scale: 1.0 / pivot, power: 1.0 / contrast, factor: pivot / exposure };
        }
        Self::Contrast { scale: exposure / pivot, power: contrast, factor: pivot }
    }

    /// Returns the curves of the slopes, offsets and powers of a decision list, in the order of their application. The
    /// saturation is not among them.
    pub(crate) fn cdl(cdl: &Cdl, c: usize, inverse: bool) -> Option<Vec<Self>> {
        let (low, high) = if cdl.clamp { (0.0, 1.0) } else { (f32::NEG_INFINITY, f32::INFINITY) };
        let negatives = if cdl.clamp { Negatives::Clamp } else { Negatives::Pass };
        let power = Self::power(cdl.power[c], negatives, inverse)?;
        let (slope, offset) = (cdl.slope[c], cdl.offset[c]);
        if inverse {
            if slope == 0.0 {
                return None;
            }
            let range = Self::Range { scale: 1.0 / slope, offset: -offset / slope, low, high };
            return Some(vec![power, range]);
        }
        Some(vec![Self::Range { scale: slope, offset, low, high }, power])
    }

    /// True when nothing changes.
    pub(crate) fn is_same(&self) -> bool {
        match self {
            Self::Same => true,
            Self::Range { scale, offset, low, high } => {
                (*scale, *offset, *low, *high) == (1.0, 0.0, f32::NEG_INFINITY, f32::INFINITY)
            }
            _ => false,
        }
    }

    /// Returns the scale and the offset of a curve that is a line without limits.
    pub(crate) fn as_line(&self) -> Option<(f64, f64)> {
        match self {
            Self::Same => Some((1.0, 0.0)),
            Self::Range { scale, offset, low: f32::NEG_INFINITY, high: f32::INFINITY } => {
                Some((*scale, *offset))
            }
            _ => None,
        }
    }

    /// Applies the function to all values.
    pub(crate) fn apply(&self, values: &mut [f32]) {
        widest!(self.run(values));
    }

    /// Does the same, compiled for the vectors of the caller.
    #[inline(always)]
    fn run(&self, values: &mut [f32]) {
        match *self {
            Self::Same => {}
            Self::Power(y, Negatives::Clamp) => {
                each!(values, |v| if v > 0.0 { pow(v, y) } else { zero_or_nan(v) })
            }
            Self::Power(y, Negatives::Mirror) => each!(values, |v| pow(v.abs(), y).copysign(v)),
            Self::Power(y, Negatives::Pass) => each!(values, |v| {
                let raised = pow(v, y);
                if v > 0.0 { raised } else { v }
            }),
            Self::Moncurve { scale, offset, gamma, line, mirror } => {
                mirrored!(values, mirror, |v| {
                    let x = f64::from(v);
                    let raised = pow((x * scale + offset) as f32, gamma);
                    if v <= line.end { (x * line.slope) as f32 } else { raised }
                });
            }
            Self::MoncurveInverse { scale, offset, gamma, line, mirror } => {
                mirrored!(values, mirror, |v| {
                    let raised = (exp2(log2(v) * gamma) * scale - offset) as f32;
                    if v <= line.end { (f64::from(v) * line.slope) as f32 } else { raised }
                });
            }
            Self::Log { a, b, s, o, line } => each!(values, |v| {
                let x = f64::from(v);
                let inner = (x * s + o) as f32;
                // NaN remains NaN.
                let inner = if inner < f32::MIN_POSITIVE { f32::MIN_POSITIVE } else { inner };
                let found = (a * log2(inner) + b) as f32;
                if v <= line.end { (x * line.slope + line.offset) as f32 } else { found }
            }),
            Self::LogInverse { a, b, s, o, line } => each!(values, |v| {
                let x = f64::from(v);
                let found = ((exp2((x - b) / a) - o) / s) as f32;
                if v <= line.end { ((x - line.offset) / line.slope) as f32 } else { found }
            }),
            Self::Range { scale, offset, low, high } => each!(values, |v| {
                let moved = (f64::from(v) * scale + offset) as f32;
                let moved = if moved < low { low } else { moved };
                if moved > high { high } else { moved }
            }),
            Self::Contrast { scale, power, factor } => each!(values, |v| {
                let x = (f64::from(v) * scale) as f32;
                let x = if x > 0.0 { x } else { 0.0 };
                (exp2(log2(x) * power) * factor) as f32
            }),
            Self::Named(name, inverse) => named(name, inverse, values),
            Self::Table(ref table, channel) => {
                let nearest = table.interpolation == Interpolation::Nearest;
                values.iter_mut().for_each(|v| *v = table.lookup(*v, channel, nearest));
            }
            Self::TableInverse(ref table) => values.iter_mut().for_each(|v| *v = table.lookup(*v)),
        }
    }
}

/// Returns the linear light of a value of sRGB (IEC 61966-2-1). The function is odd around 0.
pub fn srgb_decode(v: f32) -> f32 {
    let a = v.abs();
    let linear = if a <= 0.040_45 { a / 12.92 } else { pow((a + 0.055) / 1.055, 2.4) };
    linear.min(1e30).copysign(v)
}

/// Returns the value of sRGB of linear light, which is the inverse of [`srgb_decode`].
pub fn srgb_encode(v: f32) -> f32 {
    let a = v.abs();
    let stored = if a <= 0.003_130_8 { a * 12.92 } else { 1.055 * pow(a, 1.0 / 2.4) - 0.055 };
    stored.copysign(v)
}

#[inline(always)]
fn zero_or_nan(v: f32) -> f32 {
    if v.is_nan() { v } else { 0.0 }
}

/// The constants of SMPTE ST 2084.
mod pq {
    pub(super) const M1: f64 = 2610.0 / 16384.0;
    pub(super) const M2: f64 = 2523.0 / 32.0;
    pub(super) const C1: f64 = 3424.0 / 4096.0;
    pub(super) const C2: f64 = 2413.0 / 128.0;
    pub(super) const C3: f64 = 2392.0 / 128.0;
}

/// The constants of the Apple Log Profile White Paper (2023).
mod apple {
    pub(super) const R0: f64 = -0.056_410_88;
    pub(super) const RT: f64 = 0.01;
    pub(super) const C: f64 = 47.287_112_36;
    pub(super) const BETA: f64 = 0.009_640_52;
    pub(super) const GAMMA: f64 = 0.085_504_79;
    pub(super) const DELTA: f64 = 0.693_369_45;
}

/// The densities and the logarithms of exposure of SMPTE ST 2065-3 that lie below its line.
const ADX: [(f64, f64); 11] = [
    (-0.19, -6.0),
    (0.01, -2.721_718_645),
    (0.028, -2.521_718_645),
    (0.054, -2.321_718_645),
    (0.095, -2.121_718_645),
    (0.145, -1.921_718_645),
    (0.22, -1.721_718_645),
    (0.3, -1.521_718_645),
    (0.4, -1.321_718_645),
    (0.5, -1.121_718_645),
    (0.6, -0.926_545_676_714_876),
];

#[inline(always)]
fn named(name: Named, inverse: bool, values: &mut [f32]) {
    let ln10 = std::f64::consts::LOG2_10;
    match (name, inverse) {
        (Named::LinearToPq, false) => each!(values, |v| {
            let y = exp2(log2((f64::from(v.abs()) * 0.01) as f32) * pq::M1);
            let ratio = (pq::C1 + pq::C2 * y) / (1.0 + pq::C3 * y);
            pow(ratio as f32, pq::M2).copysign(v)
        }),
        (Named::LinearToPq, true) => each!(values, |v| {
            let x = exp2(log2(v.abs()) / pq::M2);
            let above = if x > pq::C1 { x - pq::C1 } else { 0.0 };
            let below = pq::C2 - pq::C3 * x;
            let light = exp2(log2((above / below) as f32) / pq::M1);
            // Signals far beyond 1 have no light. They get the largest half, as tables of halves have.
            let light = if below > 0.0 && light < 655.04 { light } else { 655.04 };
            let light = if x.is_nan() { x } else { light };
            ((light * 100.0) as f32).copysign(v)
        }),
        (Named::LinearToHlg, false) => each!(values, |v| {
            const A: f64 = 0.178_832_77;
            let c = 0.5 - A * libm::log(4.0 * A);
            let x = f64::from(v.abs());
            let high = A * std::f64::consts::LN_2 * log2((4.0 * x - (1.0 - 4.0 * A)) as f32) + c;
            (if x <= 0.25 { x.sqrt() as f32 } else { high as f32 }).copysign(v)
        }),
        (Named::LinearToHlg, true) => each!(values, |v| {
            const A: f64 = 0.178_832_77;
            let c = 0.5 - A * libm::log(4.0 * A);
            let x = f64::from(v.abs());
            let high = (exp2((x - c) / A * std::f64::consts::LOG2_E) + (1.0 - 4.0 * A)) / 4.0;
            (if x <= 0.5 { x * x } else { high } as f32).copysign(v)
        }),
        (Named::LinearToAppleLog, false) => each!(values, |v| {
            let x = f64::from(v);
            let high = apple::GAMMA * log2((x + apple::BETA) as f32) + apple::DELTA;
            let low = apple::C * (x - apple::R0) * (x - apple::R0);
            let found = if x >= apple::RT { high } else { low };
            if x < apple::R0 { 0.0 } else { found as f32 }
        }),
        (Named::LinearToAppleLog, true) => each!(values, |v| {
            let p = f64::from(v);
            let end = apple::C * (apple::RT - apple::R0) * (apple::RT - apple::R0);
            let high = exp2((p - apple::DELTA) / apple::GAMMA) - apple::BETA;
            let low = (p / apple::C).sqrt() + apple::R0;
            let found = if p >= end { high } else { low };
            if p < 0.0 { apple::R0 as f32 } else { found as f32 }
        }),
        // The functions of Canon's logarithms are defined from the signal to linear light (Canon, 2018), which
        // OpenColorIO scales by 0.9.
        (Named::LinearToCanonLog2, true) => each!(values, |v| {
            let x = f64::from(v.clamp(0.0, 1.0));
            let t = (x - 0.092_864_125) / 0.241_360_77;
            let magnitude = (exp2(t.abs() * ln10) - 1.0) / 87.099_375 * 0.9;
            magnitude.copysign(t) as f32
        }),
        (Named::LinearToCanonLog2, false) => each!(values, |v| {
            let x = f64::from(v) / 0.9;
            let t = log2((x.abs() * 87.099_375 + 1.0) as f32) / ln10 * 0.241_360_77;
            ((t.copysign(x) + 0.092_864_125) as f32).clamp(0.0, 1.0)
        }),
        (Named::LinearToCanonLog3, true) => each!(values, |v| {
            let x = f64::from(v.clamp(0.0, 1.0));
            let low = -(exp2((0.127_839_01 - x) / 0.367_268_45 * ln10) - 1.0) / 14.983_25;
            let mid = (x - 0.125_122_19) / 1.975_479_8;
            let high = (exp2((x - 0.122_405_37) / 0.367_268_45 * ln10) - 1.0) / 14.983_25;
            let found = if x < 0.097_465_473 { low } else { mid };
            ((if x > 0.152_778_91 { high } else { found }) * 0.9) as f32
        }),
        (Named::LinearToCanonLog3, false) => each!(values, |v| {
            let x = f64::from(v) / 0.9;
            let low = 0.127_839_01 - 0.367_268_45 * log2((1.0 - 14.983_25 * x) as f32) / ln10;
            let mid = x * 1.975_479_8 + 0.125_122_19;
            let high = 0.122_405_37 + 0.367_268_45 * log2((14.983_25 * x + 1.0) as f32) / ln10;
            let found = if x < -0.014 { low } else { mid };
            ((if x > 0.014 { high } else { found }) as f32).clamp(0.0, 1.0)
        }),
        (Named::LinearToAcesCc, false) => each!(values, |v| {
            let x = f64::from(v);
            let least = 1.0 / 65_536.0;
            let below = if x > 0.0 { least + x * 0.5 } else { least };
            let inner = if x < 1.0 / 32_768.0 { below } else { x };
            let found = ((log2(inner as f32) + 9.72) / 17.52) as f32;
            if v.is_nan() { v } else { found }
        }),
        (Named::LinearToAcesCc, true) => each!(values, |v| {
            let x = f64::from(v);
            let found = exp2(x * 17.52 - 9.72);
            let found = if x <= (9.72 - 15.0) / 17.52 { (found - 1.0 / 65_536.0) * 2.0 } else { found };
            let found = if found > 65_504.0 { 65_504.0 } else { found };
            found as f32
        }),
        (Named::AcesTone, false) => each!(values, |v| aces::tone(v)),
        (Named::AcesTone, true) => each!(values, |v| aces::tone_inverse(v)),
        (Named::DensityToExposure, false) => each!(values, |v| density_to_exposure(f64::from(v)) as f32),
        (Named::DensityToExposure, true) => each!(values, |v| exposure_to_density(f64::from(v)) as f32),
    }
}

/// The offset of the line of SMPTE ST 2065-3.
fn adx_line() -> f64 {
    (7120.0 - 1520.0) / 8000.0 * (100.0 / 55.0) - -0.744_727_494_896_693_9
}

fn density_to_exposure(x: f64) -> f64 {
    if x < ADX[0].0 {
        return -10.0;
    }
    for pair in ADX.windows(2) {
        if x <= pair[1].0 {
            let t = (x - pair[0].0) / (pair[1].0 - pair[0].0);
            return pair[0].1 + t * (pair[1].1 - pair[0].1);
        }
    }
    x * (100.0 / 55.0) - adx_line()
}

fn exposure_to_density(y: f64) -> f64 {
    if y <= ADX[0].1 {
        return ADX[0].0;
    }
    for pair in ADX.windows(2) {
        if y <= pair[1].1 {
            let t = (y - pair[0].1) / (pair[1].1 - pair[0].1);
            return pair[0].0 + t * (pair[1].0 - pair[0].0);
        }
    }
    (y + adx_line()) * (55.0 / 100.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one(curve: &Curve, v: f32) -> f32 {
        let mut values = [v];
        curve.apply(&mut values);
        values[0]
    }

    #[test]
    fn srgb_is_odd_and_inverse() {
        for i in -20..=40 {
            let v = i as f32 / 20.0;
            assert!((srgb_encode(srgb_decode(v)) - v).abs() < 2e-6, "{v}");
        }
        assert!((srgb_decode(0.5) - 0.214_041).abs() < 1e-6);
    }

    #[test]
    fn srgb_is_that_of_the_standard() {
        let decode = Curve::moncurve(2.4, 0.055, false, false);
        let encode = Curve::moncurve(2.4, 0.055, false, true);
        for (stored, linear) in
            [(0.0, 0.0), (0.5, 0.214_041), (0.04, 0.003_095_98), (1.0, 1.0), (-0.04, -0.003_095_98)]
        {
            assert!((one(&decode, stored) - linear).abs() < 2e-6, "{stored}");
            assert!((one(&encode, linear) - stored).abs() < 2e-5, "{linear}");
        }
        assert_eq!(one(&Curve::moncurve(2.4, 0.055, true, false), -0.5), -one(&decode, 0.5));
    }

    #[test]
    fn curves_of_films_and_screens_have_published_values() {
        // ITU-R BT.2100: 100 cd/m2 has the signal 0.508 of PQ, and 10 000 the signal 1. Half of HLG is a quarter of a
        // third of its range.
        let pq = Curve::Named(Named::LinearToPq, false);
        assert!((one(&pq, 1.0) - 0.508_078).abs() < 1e-6 && (one(&pq, 100.0) - 1.0).abs() < 1e-6);
        let hlg = Curve::Named(Named::LinearToHlg, false);
        assert!((one(&hlg, 0.25) - 0.5).abs() < 1e-6 && (one(&hlg, 3.0) - 1.0).abs() < 1e-6);
        // AMPAS S-2014-003: 0.18 is 0.4135884, and 0 is -0.3584475.
        let cc = Curve::Named(Named::LinearToAcesCc, false);
        assert!((one(&cc, 0.18) - 0.413_588_4).abs() < 1e-6 && (one(&cc, 0.0) + 0.358_447_5).abs() < 1e-6);
        // The same for ACEScct (S-2016-001), and 0 is 0.0729055.
        let cct = LogParams {
            log_slope: [1.0 / 17.52; 3],
            log_offset: [9.72 / 17.52; 3],
            lin_break: Some([0.007_812_5; 3]),
            ..LogParams::pure(2.0)
        };
        let cct = Curve::log(&cct, 0, false).unwrap();
        assert!((one(&cct, 0.18) - 0.413_588_4).abs() < 1e-6 && (one(&cct, 0.0) - 0.072_905_5).abs() < 1e-6);
        // Apple: mid grey has 0.4882725. Canon: 0.18 of full scale has 0.3982547 and 0.3433894.
        assert!((one(&Curve::Named(Named::LinearToAppleLog, false), 0.18) - 0.488_272_5).abs() < 1e-6);
        assert!((one(&Curve::Named(Named::LinearToCanonLog2, false), 0.18) - 0.398_254_7).abs() < 1e-6);
        assert!((one(&Curve::Named(Named::LinearToCanonLog3, false), 0.18) - 0.343_389_4).abs() < 1e-6);
        // SMPTE ST 2065-3: mid grey of ACES is the logarithm of 0.18 at the density 0.7.
        assert!((one(&Curve::Named(Named::DensityToExposure, false), 0.7) + 0.744_727_5).abs() < 1e-6);
    }

    #[test]
    fn inverses_lead_back() {
        let names = [
            Named::LinearToPq,
            Named::LinearToHlg,
            Named::LinearToAppleLog,
            Named::LinearToCanonLog2,
            Named::LinearToCanonLog3,
            Named::LinearToAcesCc,
        ];
        for name in names {
            for i in 0..=40 {
                let v = i as f32 / 20.0;
                let back = one(&Curve::Named(name, true), one(&Curve::Named(name, false), v));
                assert!((back - v).abs() < 4e-5 * v.max(0.1), "{name:?} {v} {back}");
            }
        }
        for i in -4..20 {
            let v = i as f32 / 4.0;
            let back = one(
                &Curve::Named(Named::DensityToExposure, false),
                one(&Curve::Named(Named::DensityToExposure, true), v),
            );
            assert!((back - v).abs() < 1e-5, "{v} {back}");
        }
    }

    #[test]
    fn values_that_are_not_finite_pass_without_a_panic() {
        let curves = [
            Curve::Power(2.2, Negatives::Clamp),
            Curve::Power(2.2, Negatives::Mirror),
            Curve::Power(2.2, Negatives::Pass),
            Curve::moncurve(2.4, 0.055, false, true),
            Curve::log(&LogParams::pure(10.0), 0, false).unwrap(),
            Curve::log(&LogParams::pure(10.0), 0, true).unwrap(),
            Curve::Named(Named::LinearToPq, false),
        ];
        for curve in &curves {
            assert!(one(curve, f32::NAN).is_nan(), "{curve:?}");
            assert!(one(curve, f32::INFINITY) > 1.0, "{curve:?}");
        }
        assert_eq!(one(&curves[0], -1.0), 0.0);
        assert_eq!(one(&curves[2], -1.0), -1.0);
        assert!(one(&curves[4], 0.0).is_finite());
    }

    #[test]
    fn parameters_without_an_inverse_are_refused() {
        assert!(Curve::power(0.0, Negatives::Clamp, true).is_none());
        assert!(Curve::power(-1.0, Negatives::Clamp, false).is_none());
        assert!(Curve::log(&LogParams::pure(1.0), 0, false).is_none());
        assert!(Curve::log(&LogParams { lin_slope: [0.0; 3], ..LogParams::pure(2.0) }, 0, true).is_none());
        assert!(Curve::range([Some(1.0), Some(1.0), Some(0.0), Some(1.0)], true, false).is_none());
        assert!(Curve::range([None; 4], true, false).is_none());
        assert!(Curve::cdl(&Cdl { slope: [0.0; 3], ..Cdl::default() }, 0, true).is_none());
    }

    #[test]
    fn ranges_scale_and_clamp() {
        let range = Curve::range([Some(0.0), Some(2.0), Some(1.0), Some(3.0)], true, false).unwrap();
        assert_eq!([-1.0, 0.0, 1.0, 2.0, 9.0].map(|v| one(&range, v)), [1.0, 1.0, 2.0, 3.0, 3.0]);
        let open = Curve::range([Some(0.0), Some(2.0), Some(1.0), Some(3.0)], false, true).unwrap();
        assert_eq!(one(&open, 9.0), 8.0);
        let low = Curve::range([Some(0.0), None, Some(0.0), None], true, false).unwrap();
        assert_eq!([-1.0, 9.0].map(|v| one(&low, v)), [0.0, 9.0]);
    }
}
