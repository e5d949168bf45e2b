//! Colour spaces (reference 5.2.2, 5.8.4).
//!
//! "rgb" is linear and has the primaries of ITU-R BT.709 and white D65. "xyz" and `luminance` follow from them.
//! "YIQ" is the NTSC matrix of FCC 1953. Hue is from 0 to 1.

use super::compute;
use crate::program::Op;
use crate::run::lanes::LUMINANCE;
use crate::run::machine::Machine;
use granita_base::{Color, Vec3};
use granita_gsl::Func;
use granita_gsl::ir::{SourcePos, SymbolId};

/// A named colour space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum ColorSpace {
    Rgb,
    Hsv,
    Hsl,
    Yiq,
    Xyz,
}

impl ColorSpace {
    /// Returns the space of a name. Upper and lower case do not matter.
    fn from_word(word: &str) -> Option<Self> {
        Some(match word.to_ascii_lowercase().as_str() {
            "rgb" => Self::Rgb,
            "hsv" => Self::Hsv,
            "hsl" => Self::Hsl,
            "yiq" => Self::Yiq,
            "xyz" => Self::Xyz,
            _ => return None,
        })
    }
}

/// Returns the space that a symbol names. An unknown name is an error and stands for "rgb".
pub(super) fn named(m: &mut Machine<'_>, name: SymbolId, at: SourcePos) -> Option<ColorSpace> {
    let word = m.string(name);
    Some(ColorSpace::from_word(&word).unwrap_or_else(|| {
        m.complain(at, &format!("there is no color space \"{word}\""));
        ColorSpace::Rgb
    }))
}

/// `luminance` and `transformc`.
pub(super) fn run(m: &mut Machine<'_>, func: Func, op: &Op) {
    if func == Func::Luminance {
        return compute(m, op, 1, |m, out, work| {
            let c = m.view(op.args[0]).triple();
            work.each(|i| out.set(0, i, luminance(c.get(i))));
        });
    }
    let (value, names) = op.args.split_last().expect("invariant: linking checked the operands");
    let from = if names.len() > 1 { named(m, names[0], op.at) } else { Some(ColorSpace::Rgb) };
    let to = names.last().and_then(|&name| named(m, name, op.at));
    let (Some(from), Some(to)) = (from, to) else { return };
    compute(m, op, 3, |m, out, work| {
        let c = m.view(*value).triple();
        work.each(|i| {
            let v = c.get(i);
            out.set3(i, if from == to { v } else { from_rgb(to, to_rgb(from, v)) });
        });
    });
}

/// Returns Y of the colour, its perceived brightness.
pub(crate) fn luminance(c: Color) -> f32 {
    let [r, g, b] = LUMINANCE;
    r * c.x + g * c.y + b * c.z
}

/// Converts to "rgb".
pub(crate) fn to_rgb(space: ColorSpace, c: Color) -> Color {
    match space {
        ColorSpace::Rgb => c,
        ColorSpace::Hsv => hsv_to_rgb(c),
        ColorSpace::Hsl => hsl_to_rgb(c),
        ColorSpace::Yiq => rows(
            c,
            [1.0, 0.956_295_7, 0.621_024_4],
            [1.0, -0.272_122_1, -0.647_380_6],
            [1.0, -1.106_989, 1.704_615],
        ),
        ColorSpace::Xyz => rows(
            c,
            [3.240_97, -1.537_383_2, -0.498_610_76],
            [-0.969_243_6, 1.875_967_5, 0.041_555_06],
            [0.055_630_08, -0.203_976_96, 1.056_971_5],
        ),
    }
}

/// Converts from "rgb".
pub(crate) fn from_rgb(space: ColorSpace, c: Color) -> Color {
    match space {
        ColorSpace::Rgb => c,
        ColorSpace::Hsv => rgb_to_hsv(c),
        ColorSpace::Hsl => rgb_to_hsl(c),
        ColorSpace::Yiq => rows(
            c,
            [0.299, 0.587, 0.114],
            [0.595_716, -0.274_453, -0.321_263],
            [0.211_456, -0.522_591, 0.311_135],
        ),
        ColorSpace::Xyz => rows(
            c,
            [0.412_390_8, 0.357_584_34, 0.180_480_8],
            LUMINANCE,
            [0.019_330_82, 0.119_194_78, 0.950_532_15],
        ),
    }
}

fn rows(c: Vec3, x: [f32; 3], y: [f32; 3], z: [f32; 3]) -> Vec3 {
    Vec3::new(Vec3::from(x).dot(c), Vec3::from(y).dot(c), Vec3::from(z).dot(c))
}

/// Returns the hue of a colour with its largest and smallest component; 0 for greys.
fn hue(c: Color, max: f32, min: f32) -> f32 {
    let d = max - min;
    if d.is_nan() || d <= 0.0 {
        return 0.0;
    }
    let sixth = if c.x == max {
        (c.y - c.z) / d
    } else if c.y == max {
        2.0 + (c.z - c.x) / d
    } else {
        4.0 + (c.x - c.y) / d
    };
    let h = sixth / 6.0;
    h - h.floor()
}

fn rgb_to_hsv(c: Color) -> Vec3 {
    let (max, min) = (c.max_element(), c.min_element());
    let s = if max > 0.0 { (max - min) / max } else { 0.0 };
    Vec3::new(hue(c, max, min), s, max)
}

fn rgb_to_hsl(c: Color) -> Vec3 {
    let (max, min) = (c.max_element(), c.min_element());
    let l = 0.5 * (max + min);
    let span = if l <= 0.5 { max + min } else { 2.0 - max - min };
    let s = if max > min && span != 0.0 { (max - min) / span } else { 0.0 };
    Vec3::new(hue(c, max, min), s, l)
}

/// Returns the red, green and blue weights of a hue, from 0 to 1.
fn pure(h: f32) -> Vec3 {
    let h = (h - h.floor()) * 6.0;
    Vec3::new((h - 3.0).abs() - 1.0, 2.0 - (h - 2.0).abs(), 2.0 - (h - 4.0).abs())
        .clamp(Vec3::ZERO, Vec3::ONE)
}

fn hsv_to_rgb(c: Vec3) -> Color {
    c.z * (Vec3::ONE - c.y * (Vec3::ONE - pure(c.x)))
}

fn hsl_to_rgb(c: Vec3) -> Color {
    let chroma = (1.0 - (2.0 * c.z - 1.0).abs()) * c.y;
    Vec3::splat(c.z) + chroma * (pure(c.x) - Vec3::splat(0.5))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn color_conversions_give_known_values() {
        let table = [
            (ColorSpace::Hsv, [1.0, 0.0, 0.0], [0.0, 1.0, 1.0]),
            (ColorSpace::Hsv, [0.0, 0.5, 0.0], [1.0 / 3.0, 1.0, 0.5]),
            (ColorSpace::Hsv, [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
            (ColorSpace::Hsv, [0.25, 0.25, 0.25], [0.0, 0.0, 0.25]),
            (ColorSpace::Hsl, [0.0, 0.0, 1.0], [2.0 / 3.0, 1.0, 0.5]),
            (ColorSpace::Hsl, [1.0, 0.5, 1.0], [5.0 / 6.0, 1.0, 0.75]),
            (ColorSpace::Yiq, [1.0, 1.0, 1.0], [1.0, 0.0, 0.0]),
            (ColorSpace::Xyz, [1.0, 1.0, 1.0], [0.950_456, 1.0, 1.089_058]),
            (ColorSpace::Xyz, [1.0, 0.0, 0.0], [0.412_391, 0.212_639, 0.019_331]),
        ];
        for (space, rgb, other) in table {
            let (rgb, other) = (Vec3::from(rgb), Vec3::from(other));
            assert!((from_rgb(space, rgb) - other).length() < 1e-4, "{space:?} {}", from_rgb(space, rgb));
            assert!((to_rgb(space, other) - rgb).length() < 1e-4, "{space:?} {}", to_rgb(space, other));
        }
        assert!((luminance(Vec3::ONE) - 1.0).abs() < 1e-6);
    }

    #[test]
    fn colors_survive_conversion_and_back() {
        for space in [ColorSpace::Hsv, ColorSpace::Hsl, ColorSpace::Yiq, ColorSpace::Xyz] {
            for k in 0..125 {
                let c = Vec3::new((k % 5) as f32, (k / 5 % 5) as f32, (k / 25) as f32) * 0.25;
                let back = to_rgb(space, from_rgb(space, c));
                assert!((back - c).length() < 2e-5, "{space:?} {c} {back}");
            }
        }
    }
}
