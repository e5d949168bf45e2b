//! ICC profiles that consist of a matrix and curves (ICC.1:2022, 8.3), or of a curve of grey.

use crate::error::ColorError;
use crate::primaries::{Adaptation, D65, IDENTITY, Matrix3, Primaries, adaptation, inverse, multiply};
use crate::table::{Interpolation, Lut1d};
use granita_base::math::{exp2, log2};
use moxcms::{ColorProfile, DataColorSpace, ToneReprCurve};

/// What a profile says of colours.
pub(crate) struct Icc {
    /// The matrix from linear colours to CIE XYZ under D65.
    pub(crate) to_xyz: Matrix3,
    /// The curves to linear light.
    pub(crate) curves: Lut1d,
    /// The numbers of ITU-T H.273, where the profile has them.
    pub(crate) cicp: Option<[i32; 4]>,
}

/// The white of the profile connection space, D50.
const D50: [f64; 2] = [0.345_702_914_918_791, 0.358_538_596_679_933];

/// The number of entries of the tables of curves.
const ENTRIES: usize = 4097;

/// Reads a profile.
pub(crate) fn read(bytes: &[u8]) -> Result<Icc, ColorError> {
    let malformed = |what: String| ColorError::Malformed { place: "ICC profile".to_owned(), what };
    let profile = ColorProfile::new_from_slice(bytes).map_err(|error| malformed(error.to_string()))?;
    let unsupported =
        |what: &str| ColorError::Unsupported { place: "ICC profile".to_owned(), what: what.to_owned() };
    let curves = match profile.color_space {
        DataColorSpace::Rgb => [&profile.red_trc, &profile.green_trc, &profile.blue_trc],
        DataColorSpace::Gray => [&profile.gray_trc; 3],
        _ => return Err(unsupported("a profile of other colours than red, green and blue")),
    };
    let [Some(red), Some(green), Some(blue)] = curves else {
        return Err(unsupported("a profile of tables, without a matrix and curves"));
    };
    let mut table = vec![[0.0; 3]; ENTRIES];
    for (c, curve) in [red, green, blue].into_iter().enumerate() {
        for (i, row) in table.iter_mut().enumerate() {
            let v = evaluate(curve, i as f64 / (ENTRIES - 1) as f64);
            row[c] = v
                .filter(|v| v.is_finite())
                .ok_or_else(|| malformed("a curve has no values".to_owned()))? as f32;
        }
    }
    let to_xyz = match profile.color_space {
        DataColorSpace::Gray => Primaries::REC709.to_xyz().unwrap_or(IDENTITY),
        _ => {
            let c = [profile.red_colorant, profile.green_colorant, profile.blue_colorant];
            let own = [c.map(|v| v.x), c.map(|v| v.y), c.map(|v| v.z)];
            multiply(&adaptation(D50, D65, Adaptation::Bradford), &own)
        }
    };
    if inverse(&to_xyz).is_none() {
        return Err(malformed("the colours of its primaries lie in a plane".to_owned()));
    }
    let cicp = profile.cicp.map(|cicp| {
        [
            cicp.color_primaries as i32,
            cicp.transfer_characteristics as i32,
            // Profiles are of red, green and blue, whatever the video that they are from.
            0,
            i32::from(cicp.full_range),
        ]
    });
    Ok(Icc { to_xyz, curves: Lut1d { table, interpolation: Interpolation::Linear }, cicp })
}

/// Returns the value of a curve at `x` from 0 to 1; `None` for a curve that is not defined.
fn evaluate(curve: &ToneReprCurve, x: f64) -> Option<f64> {
    let pow = |x: f64, y: f64| if x > 0.0 { exp2(log2(x as f32) * y) } else { 0.0 };
    match curve {
        ToneReprCurve::Lut(table) => match table[..] {
            [] => Some(x),
            [gamma] => Some(pow(x, f64::from(gamma) / 256.0)),
            _ => {
                let at = x * (table.len() - 1) as f64;
                let i = (at as usize).min(table.len() - 2);
                let (a, b) = (f64::from(table[i]), f64::from(table[i + 1]));
                Some((a + (b - a) * (at - i as f64)) / 65535.0)
            }
        },
        ToneReprCurve::Parametric(values) => {
            let p: Vec<f64> = values.iter().map(|v| f64::from(*v)).collect();
            Some(match p[..] {
                [g] => pow(x, g),
                [g, a, b] => {
                    if a * x + b >= 0.0 {
                        pow(a * x + b, g)
                    } else {
                        0.0
                    }
                }
                [g, a, b, c] => {
                    if a * x + b >= 0.0 {
                        pow(a * x + b, g) + c
                    } else {
                        c
                    }
                }
                [g, a, b, c, d] => {
                    if x >= d {
                        pow(a * x + b, g)
                    } else {
                        c * x
                    }
                }
                [g, a, b, c, d, e, f] => {
                    if x >= d {
                        pow(a * x + b, g) + e
                    } else {
                        c * x + f
                    }
                }
                _ => return None,
            })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_are_those_of_the_definition() {
        let parametric = |p: &[f32]| ToneReprCurve::Parametric(p.to_vec());
        assert_eq!(evaluate(&ToneReprCurve::Lut(vec![]), 0.3), Some(0.3));
        assert!((evaluate(&ToneReprCurve::Lut(vec![512]), 0.5).unwrap() - 0.25).abs() < 1e-9);
        assert_eq!(evaluate(&ToneReprCurve::Lut(vec![0, 65535]), 0.25), Some(0.25));
        assert!((evaluate(&parametric(&[2.0, 0.5, 0.5]), 0.0).unwrap() - 0.25).abs() < 1e-9);
        assert!((evaluate(&parametric(&[2.0, 1.0, 0.0, 0.1]), 0.5).unwrap() - 0.35).abs() < 1e-6);
        assert!((evaluate(&parametric(&[2.0, 1.0, 0.0, 0.5, 0.5]), 0.4).unwrap() - 0.2).abs() < 1e-6);
        assert_eq!(evaluate(&parametric(&[]), 0.5), None);
    }

    #[test]
    fn damaged_profiles_and_those_of_inks_are_refused() {
        assert!(read(b"").is_err() && read(&[0; 200]).is_err());
        let mut bytes = ColorProfile::new_srgb().encode().unwrap();
        bytes[16..20].copy_from_slice(b"CMYK");
        assert!(read(&bytes).is_err());
        bytes.truncate(150);
        assert!(read(&bytes).is_err());
    }
}
