//! The encoding of the colours of one image, as its file describes it: primaries and a transfer function.

use crate::curve::Curve;
use crate::error::ColorError;
use crate::icc;
use crate::primaries::{Adaptation, D65, Matrix3, Primaries, adaptation, inverse, multiply};
use crate::processor::Processor;
use crate::table::Lut1d;
use crate::transform::{Fixed, Named, Negatives, Transform};
use std::sync::Arc;

/// The luminance in cd/m2 of the white of images whose files give luminances, which becomes the value 1 (ITU-R
/// BT.2408).
pub const HDR_WHITE: f64 = 203.0;

/// A transfer function, from stored values to linear light.
#[derive(Clone, Debug, PartialEq)]
pub enum Transfer {
    /// Values are linear.
    Linear,
    /// That of sRGB (IEC 61966-2-1).
    Srgb,
    /// The inverse of the one of cameras (ITU-R BT.709).
    Rec709,
    /// A power.
    Gamma(f64),
    /// That of SMPTE ST 2084. The luminance [`HDR_WHITE`] becomes 1.
    Pq,
    /// That of hybrid log-gamma for a screen of 1000 cd/m2 (ITU-R BT.2100). The luminance [`HDR_WHITE`] becomes 1.
    Hlg,
    /// The printing density of film in files of Cineon and DPX: code 685 of 1023 is white, 95 black, 0.002 of density a
    /// code, and 0.6 the gamma of the negative.
    Film,
    /// A table for each channel.
    Table(Arc<Lut1d>),
}

/// The encoding of the colours of an image.
#[derive(Clone, Debug, PartialEq)]
pub struct Encoding {
    /// The matrix from linear colours to CIE XYZ under D65.
    to_xyz: Matrix3,
    transfer: Transfer,
    /// The source and the encoding in words, such as `sRGB (PNG chunk sRGB)`.
    pub text: String,
}

impl Encoding {
    /// Returns an encoding. `None` for primaries that lie on a line.
    pub fn new(primaries: &Primaries, transfer: Transfer, text: impl Into<String>) -> Option<Self> {
        let adapt = adaptation(primaries.white, D65, Adaptation::Bradford);
        let to_xyz = multiply(&adapt, &primaries.to_xyz()?);
        inverse(&to_xyz)?;
        Some(Self { to_xyz, transfer, text: text.into() })
    }

    /// Returns the encoding of numbers of ITU-T H.273: primaries, transfer function, matrix and range. `None` for
    /// numbers that are not known, and for images that are not red, green and blue.
    pub fn cicp(numbers: [i32; 4], source: &str) -> Option<Self> {
        let (primaries, gamut) = match numbers[0] {
            1 => (Primaries::REC709, "Rec. 709"),
            5 => (
                Primaries { red: [0.64, 0.33], green: [0.29, 0.6], blue: [0.15, 0.06], white: D65 },
                "BT.470 BG",
            ),
            6 | 7 => (
                Primaries { red: [0.63, 0.34], green: [0.31, 0.595], blue: [0.155, 0.07], white: D65 },
                "SMPTE 170M",
            ),
            9 => (Primaries::REC2020, "Rec. 2020"),
            11 => (Primaries::P3_DCI, "P3 (DCI)"),
            12 => (Primaries::P3_D65, "P3 (D65)"),
            _ => return None,
        };
        let (transfer, curve) = match numbers[1] {
            1 | 6 | 14 | 15 => (Transfer::Rec709, "the curve of BT.709"),
            4 => (Transfer::Gamma(2.2), "gamma 2.2"),
            5 => (Transfer::Gamma(2.8), "gamma 2.8"),
            8 => (Transfer::Linear, "linear"),
            13 => (Transfer::Srgb, "the curve of sRGB"),
            16 => (Transfer::Pq, "PQ"),
            18 => (Transfer::Hlg, "HLG"),
            _ => return None,
        };
        let light = match transfer {
            Transfer::Pq | Transfer::Hlg => ", 203 cd/m2 shown as 1",
            _ => "",
        };
        if numbers[2] != 0 {
            return None;
        }
        Self::new(&primaries, transfer, format!("{gamut}, {curve}{light} ({source})"))
    }

    /// Returns the encoding of an ICC profile with a matrix and curves, or with one curve of grey.
    ///
    /// # Errors
    /// Returns an error for a profile that is damaged, and for one that has neither.
    pub fn icc(profile: &[u8], name: &str) -> Result<Self, ColorError> {
        let found = icc::read(profile)?;
        if let Some(numbers) = found.cicp
            && let Some(encoding) = Self::cicp(numbers, &format!("ICC profile \"{name}\""))
        {
            return Ok(encoding);
        }
        let transfer = Transfer::Table(Arc::new(found.curves));
        Ok(Self { to_xyz: found.to_xyz, transfer, text: format!("ICC profile \"{name}\"") })
    }

    /// Returns the processor from stored values to linear light in other primaries. Negative values keep their sign, as
    /// far as the transfer function has values for them.
    pub fn to_linear(&self, to: &Primaries) -> Processor {
        let mut processor = Processor::identity();
        let mut curve = |curve: Curve| processor.push_curves([curve.clone(), curve.clone(), curve]);
        let scale =
            |scale: f64| Curve::Range { scale, offset: 0.0, low: f32::NEG_INFINITY, high: f32::INFINITY };
        match &self.transfer {
            Transfer::Linear => {}
            Transfer::Srgb => curve(Curve::moncurve(2.4, 0.055, true, false)),
            Transfer::Rec709 => curve(Curve::moncurve(1.0 / 0.45, 0.099, true, false)),
            Transfer::Gamma(gamma) => {
                curve(Curve::power(*gamma, Negatives::Mirror, false).unwrap_or(Curve::Same));
            }
            Transfer::Pq => {
                curve(Curve::Named(Named::LinearToPq, true));
                curve(scale(100.0 / HDR_WHITE));
            }
            Transfer::Hlg => {
                curve(Curve::Named(Named::LinearToHlg, true));
                curve(scale(1.0 / 3.0));
                processor.push_fixed(Fixed::Surround(1.2));
                let scale = scale(1000.0 / HDR_WHITE);
                processor.push_curves([scale.clone(), scale.clone(), scale]);
            }
            Transfer::Film => {
                let black = libm::pow(10_f64, (95.0 - 685.0) * 0.002 / 0.6);
                let code = 1023.0 * 0.002 / 0.6;
                let log = crate::transform::LogParams {
                    log_slope: [1.0 / code; 3],
                    log_offset: [685.0 / 1023.0; 3],
                    lin_slope: [1.0 - black; 3],
                    lin_offset: [black; 3],
                    ..crate::transform::LogParams::pure(10.0)
                };
                curve(Curve::log(&log, 0, true).unwrap_or(Curve::Same));
            }
            Transfer::Table(table) => {
                // A table holds finite numbers, and has a step for every transform.
                let pushed = processor.push(&Transform::Lut1d(table.clone()), false);
                debug_assert!(pushed.is_ok());
            }
        }
        if let Some(from_xyz) = to.to_xyz().as_ref().and_then(inverse) {
            let white = adaptation(D65, to.white, Adaptation::Bradford);
            let matrix = multiply(&from_xyz, &multiply(&white, &self.to_xyz));
            processor = processor.then(&Processor::matrix(matrix));
        }
        processor
    }

    /// True when the colours differ from those of sRGB by less than two steps of 8 bits. Profiles round their
    /// primaries.
    pub fn is_srgb(&self) -> bool {
        let own = self.to_linear(&Primaries::REC709);
        let Some(srgb) = Self::new(&Primaries::REC709, Transfer::Srgb, "") else { return false };
        let srgb = srgb.to_linear(&Primaries::REC709);
        let encode = Curve::moncurve(2.4, 0.055, true, true);
        let samples = (0..=16).flat_map(|i| {
            let v = i as f32 / 16.0;
            [[v, v, v], [v, 0.0, 0.0], [0.0, v, 0.0], [0.0, 0.0, v]]
        });
        samples.into_iter().all(|rgb| {
            let (mut a, mut b) = (own.map(rgb), srgb.map(rgb));
            encode.apply(&mut a);
            encode.apply(&mut b);
            a.iter().zip(b).all(|(a, b)| (a - b).abs() < 2.0 / 255.0)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use moxcms::ColorProfile;

    fn linear(encoding: &Encoding, rgb: [f32; 3]) -> [f32; 3] {
        encoding.to_linear(&Primaries::REC709).map(rgb)
    }

    fn near(a: [f32; 3], b: [f32; 3]) -> bool {
        a.iter().zip(b).all(|(a, b)| (a - b).abs() < 2e-4 * b.abs().max(1.0))
    }

    #[test]
    fn numbers_name_primaries_and_curves() {
        let of = |p, t| Encoding::cicp([p, t, 0, 1], "test");
        assert!(of(1, 13).unwrap().is_srgb());
        assert!(!of(12, 13).unwrap().is_srgb() && !of(1, 8).unwrap().is_srgb());
        assert!(near(linear(&of(1, 8).unwrap(), [0.2, 0.4, 0.6]), [0.2, 0.4, 0.6]));
        // The white of every gamut is white. 203 cd/m2 has the signal 0.5806888 of PQ, and 0.75 of HLG.
        for p in [1, 5, 6, 9, 11, 12] {
            assert!(near(linear(&of(p, 13).unwrap(), [1.0; 3]), [1.0; 3]), "{p}");
        }
        assert!(near(linear(&of(9, 16).unwrap(), [0.580_688_9; 3]), [1.0; 3]));
        let hlg = linear(&of(9, 18).unwrap(), [0.75; 3]);
        assert!((hlg[1] - 1.0).abs() < 0.02, "{hlg:?}");
        // Green of Rec. 2020 lies outside of Rec. 709.
        assert!(linear(&of(9, 8).unwrap(), [0.0, 1.0, 0.0])[0] < -0.5);
        assert!(of(2, 13).is_none() && of(1, 99).is_none() && Encoding::cicp([1, 13, 1, 1], "").is_none());
        assert!(of(9, 16).unwrap().text.contains("Rec. 2020, PQ, 203 cd/m2 shown as 1 (test)"));
    }

    #[test]
    fn profiles_of_well_known_spaces_have_their_colours() {
        let bytes = ColorProfile::new_srgb().encode().unwrap();
        assert!(Encoding::icc(&bytes, "sRGB").unwrap().is_srgb());
        let mut p3 = ColorProfile::new_display_p3();
        p3.cicp = None;
        let p3 = Encoding::icc(&p3.encode().unwrap(), "P3").unwrap();
        assert!(!p3.is_srgb() && p3.text == "ICC profile \"P3\"");
        let expected = Encoding::cicp([12, 13, 0, 1], "").unwrap();
        for rgb in [[1.0, 0.0, 0.0], [0.2, 0.8, 0.4], [1.0, 1.0, 1.0]] {
            let (a, b) = (p3.to_linear(&Primaries::REC709), expected.to_linear(&Primaries::REC709));
            let (a, b) = (a.map(rgb), b.map(rgb));
            assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-3), "{rgb:?} {a:?} {b:?}");
        }
        let pq = ColorProfile::new_bt2020_pq().encode().unwrap();
        assert!(Encoding::icc(&pq, "HDR").unwrap().text.contains("PQ"));
    }

    #[test]
    fn film_has_its_white_and_black() {
        let film = Encoding::new(&Primaries::REC709, Transfer::Film, "film").unwrap();
        assert!(near(linear(&film, [685.0 / 1023.0; 3]), [1.0; 3]));
        assert!(near(linear(&film, [95.0 / 1023.0; 3]), [0.0; 3]));
    }

    #[test]
    fn primaries_on_a_line_are_refused() {
        let line = Primaries { red: [0.3, 0.3], green: [0.3, 0.3], blue: [0.3, 0.3], white: D65 };
        assert!(Encoding::new(&line, Transfer::Linear, "").is_none());
    }
}
