//! The transforms that have names: those of the Academy's system, of cameras and of displays.

use crate::primaries::{ACES_WHITE, Adaptation, D65, Matrix3, Primaries, adaptation, inverse, multiply};
use crate::transform::{Directed, Fixed, LogParams, Named, Negatives, Transform};

/// Returns the transforms of a style; `None` for a name that is not known.
pub(crate) fn style(name: &str) -> Option<Vec<Directed>> {
    let found = STYLES.iter().find(|(style, _)| style.eq_ignore_ascii_case(name))?;
    (found.1)()
}

type Make = fn() -> Option<Vec<Directed>>;

/// Returns the transform of a matrix of three rows.
pub(crate) fn matrix(m: &Matrix3) -> Directed {
    let mut found = [0.0; 16];
    for (i, row) in m.iter().enumerate() {
        found[4 * i..4 * i + 3].copy_from_slice(row);
    }
    found[15] = 1.0;
    Directed::forward(Transform::Matrix(found, [0.0; 4]))
}

fn scale(v: f64, offset: f64) -> Directed {
    let mut found = [0.0; 16];
    (found[0], found[5], found[10], found[15]) = (v, v, v, 1.0);
    Directed::forward(Transform::Matrix(found, [offset, offset, offset, 0.0]))
}

fn range(low: Option<f64>, high: Option<f64>) -> Directed {
    Directed::forward(Transform::Range([low, high, low, high], true))
}

/// Returns the matrix from primaries to ACES2065-1.
fn to_ap0(from: &Primaries, kind: Adaptation) -> Option<Directed> {
    let adapted = multiply(&adaptation(from.white, ACES_WHITE, kind), &from.to_xyz()?);
    Some(matrix(&multiply(&inverse(&Primaries::AP0.to_xyz()?)?, &adapted)))
}

/// Returns the matrix from primaries to CIE XYZ under D65.
fn to_xyz_d65(from: &Primaries) -> Option<Directed> {
    Some(matrix(&multiply(&adaptation(from.white, D65, Adaptation::Bradford), &from.to_xyz()?)))
}

/// Returns the transforms from CIE XYZ under D65 to a display.
fn display(to: &Primaries, curve: Directed) -> Option<Vec<Directed>> {
    let there = multiply(&adaptation(to.white, D65, Adaptation::Bradford), &to.to_xyz()?);
    Some(vec![matrix(&inverse(&there)?), curve])
}

fn gamma(value: f64, negatives: Negatives) -> Directed {
    Directed::backward(Transform::Exponent([value, value, value, 1.0], negatives))
}

fn srgb(negatives: Negatives) -> Directed {
    let (gamma, offset) = ([2.4, 2.4, 2.4, 1.0], [0.055, 0.055, 0.055, 0.0]);
    Directed::backward(Transform::ExponentWithLinear(gamma, offset, negatives))
}

fn named(name: Named) -> Directed {
    Directed::forward(Transform::Named(name))
}

fn decode(name: Named) -> Directed {
    Directed::backward(Transform::Named(name))
}

/// Returns the logarithm of a camera, from the signal to linear light.
fn camera(base: f64, log: [f64; 2], lin: [f64; 2], lin_break: Option<f64>, slope: Option<f64>) -> Directed {
    Directed::backward(Transform::Log(LogParams {
        base,
        log_slope: [log[0]; 3],
        log_offset: [log[1]; 3],
        lin_slope: [lin[0]; 3],
        lin_offset: [lin[1]; 3],
        lin_break: lin_break.map(|v| [v; 3]),
        linear_slope: slope.map(|v| [v; 3]),
    }))
}

/// The curve of ACEScct (AMPAS S-2016-001).
fn acescct() -> Directed {
    camera(2.0, [1.0 / 17.52, 9.72 / 17.52], [1.0, 0.0], Some(0.007_812_5), None)
}

/// The curve of S-Log3 (Sony, Technical Summary for S-Gamut3.Cine/S-Log3).
fn slog3() -> Directed {
    let lin_break: f64 = 0.011_25;
    let linear_slope = (171.210_294_694_929 - 95.0) / 1023.0 / lin_break;
    let scale = 1.0 / (0.18 + 0.01);
    camera(10.0, [261.5 / 1023.0, 420.0 / 1023.0], [scale, 0.01 * scale], Some(lin_break), Some(linear_slope))
}

/// The curve of LogC4 (ARRI LogC4 Specification, 2022).
fn logc4() -> Directed {
    let a = (2_f64.powi(18) - 16.0) / 117.45;
    let b = (1023.0 - 95.0) / 1023.0;
    let c = 95.0 / 1023.0;
    let lin_break = (libm::pow(2_f64, 14.0 * (-c / b) + 6.0) - 64.0) / a;
    camera(2.0, [b / 14.0, -6.0 * b / 14.0 + c], [a, 64.0], Some(lin_break), None)
}

/// The curve of LogC3 at the exposure index 800 (ARRI, ALEXA LogC Curve, 2012).
fn logc3() -> Directed {
    let log = [0.247_189_638_3, 0.385_536_998_7];
    camera(10.0, log, [1.0 / 0.18, 0.052_272_275], Some(0.010_590_990_5), None)
}

const AWG3: Primaries =
    Primaries { red: [0.684, 0.313], green: [0.221, 0.848], blue: [0.0861, -0.102], white: D65 };
const AWG4: Primaries =
    Primaries { red: [0.7347, 0.2653], green: [0.1424, 0.8576], blue: [0.0991, -0.0308], white: D65 };
const V_GAMUT: Primaries =
    Primaries { red: [0.73, 0.28], green: [0.165, 0.84], blue: [0.1, -0.03], white: D65 };
const RED_WIDE: Primaries = Primaries {
    red: [0.780_308, 0.304_253],
    green: [0.121_595, 1.493_994],
    blue: [0.095_612, -0.084_589],
    white: D65,
};
const S_GAMUT3: Primaries =
    Primaries { red: [0.73, 0.28], green: [0.14, 0.855], blue: [0.1, -0.05], white: D65 };
const S_GAMUT3_CINE: Primaries =
    Primaries { red: [0.766, 0.275], green: [0.225, 0.8], blue: [0.089, -0.087], white: D65 };
const CINEMA_GAMUT: Primaries =
    Primaries { red: [0.74, 0.27], green: [0.17, 1.14], blue: [0.08, -0.1], white: D65 };
const APPLE_WIDE: Primaries =
    Primaries { red: [0.725, 0.301], green: [0.221, 0.814], blue: [0.068, -0.076], white: D65 };

/// The matrices of Sony for the camera Venice, which are published as numbers.
const VENICE_S_GAMUT3: Matrix3 = [
    [0.793_329_741_1, 0.089_078_625_6, 0.117_591_633_3],
    [0.015_581_058_5, 1.032_712_306_9, -0.048_293_365_4],
    [-0.018_864_747_8, 0.012_769_412_1, 1.006_095_335_8],
];
const VENICE_S_GAMUT3_CINE: Matrix3 = [
    [0.674_257_092_1, 0.220_571_735_9, 0.105_171_172],
    [-0.009_313_606_1, 1.105_958_861_4, -0.096_645_255_3],
    [-0.038_209_067_3, -0.017_938_376_6, 1.056_147_443_9],
];

/// The matrix of the fix for artefacts of blue light (AMPAS, LMT.Academy.BlueLightArtifactFix).
const BLUE_FIX: Matrix3 = [
    [0.940_437_268_3, -0.018_306_878_7, 0.077_869_610_4],
    [0.008_378_696_9, 0.828_659_993_9, 0.162_961_309_2],
    [0.000_547_126_1, -0.000_883_374_6, 1.000_336_248_6],
];

/// The limits, thresholds and the power of AMPAS S-2020-001.
const COMPRESSION: [f64; 7] = [1.147, 1.264, 1.312, 0.815, 0.803, 0.88, 1.2];

/// Returns the transforms of ADX with a scale of codes (SMPTE ST 2065-3).
fn adx(codes: f64) -> Option<Vec<Directed>> {
    let channels = [[0.75573, 0.22197, 0.0223], [0.05901, 0.96928, -0.02829], [0.16134, 0.07406, 0.7646]];
    let exposure = [[0.72286, 0.1263, 0.15084], [0.11923, 0.76418, 0.11659], [0.01427, 0.08213, 0.9036]];
    Some(vec![
        scale(codes, -0.19),
        matrix(&channels),
        named(Named::DensityToExposure),
        Directed::backward(Transform::Log(LogParams::pure(10.0))),
        matrix(&exposure),
    ])
}

/// Returns the transforms of a camera with a curve and primaries.
fn film(curve: Directed, primaries: &Primaries, kind: Adaptation) -> Option<Vec<Directed>> {
    Some(vec![curve, to_ap0(primaries, kind)?])
}

/// Returns the matrix that scales the difference of colours in AP1 from their luminance.
fn saturation(scale: f64) -> Option<Directed> {
    let weights = Primaries::AP1.to_xyz()?[1];
    let mut m = [[0.0; 3]; 3];
    for (i, row) in m.iter_mut().enumerate() {
        for (j, v) in row.iter_mut().enumerate() {
            *v = (1.0 - scale) * weights[j] + if i == j { scale } else { 0.0 };
        }
    }
    Some(matrix(&m))
}

/// Returns the output transform of ACES 1 for standard range, to CIE XYZ under D65. `dim` is for surroundings that are
/// not dark, and `limit` are the primaries that the colours must not leave.
fn output(dim: bool, limit: Option<&Primaries>) -> Option<Vec<Directed>> {
    let fixed = |fixed| Directed::forward(Transform::Fixed(fixed));
    let mut found = vec![
        fixed(Fixed::Glow(0.05, 0.08)),
        fixed(Fixed::RedModifier),
        range(Some(0.0), None),
        matrix(&Primaries::AP0.matrix_to(&Primaries::AP1)?),
        range(Some(0.0), None),
        saturation(0.96)?,
        named(Named::AcesTone),
    ];
    if dim {
        found.extend([fixed(Fixed::DarkToDim), saturation(0.93)?]);
    }
    match limit {
        None => found.push(to_xyz_d65(&Primaries::AP1)?),
        Some(limit) => {
            found.push(matrix(&Primaries::AP1.matrix_to(limit)?));
            found.push(range(Some(0.0), Some(1.0)));
            found.push(to_xyz_d65(limit)?);
        }
    }
    Some(found)
}

/// The styles, and what makes their transforms.
const STYLES: &[(&str, Make)] = &[
    ("IDENTITY", || Some(Vec::new())),
    ("UTILITY - ACES-AP0_to_CIE-XYZ-D65_BFD", || Some(vec![to_xyz_d65(&Primaries::AP0)?])),
    ("UTILITY - ACES-AP1_to_CIE-XYZ-D65_BFD", || Some(vec![to_xyz_d65(&Primaries::AP1)?])),
    ("UTILITY - ACES-AP1_to_LINEAR-REC709_BFD", || {
        Some(vec![matrix(&Primaries::AP1.matrix_to(&Primaries::REC709)?)])
    }),
    ("CURVE - ACEScct-LOG_to_LINEAR", || Some(vec![acescct()])),
    ("ACEScct_to_ACES2065-1", || film(acescct(), &Primaries::AP1, Adaptation::Bradford)),
    ("ACEScc_to_ACES2065-1", || {
        let ap0 = to_ap0(&Primaries::AP1, Adaptation::Bradford)?;
        Some(vec![range(Some(-0.36), Some(1.5)), decode(Named::LinearToAcesCc), ap0, range(Some(0.0), None)])
    }),
    ("ACEScg_to_ACES2065-1", || Some(vec![to_ap0(&Primaries::AP1, Adaptation::Bradford)?])),
    ("ACESproxy10i_to_ACES2065-1", || {
        let values = [Some(64.0 / 1023.0), Some(940.0 / 1023.0), Some(-9.72), Some(7.8)];
        Some(vec![
            Directed::forward(Transform::Range(values, true)),
            Directed::backward(Transform::Log(LogParams::pure(2.0))),
            to_ap0(&Primaries::AP1, Adaptation::Bradford)?,
        ])
    }),
    ("ADX10_to_ACES2065-1", || adx(1023.0 / 500.0)),
    ("ADX16_to_ACES2065-1", || adx(65535.0 / 8000.0)),
    ("ACES-LMT - BLUE_LIGHT_ARTIFACT_FIX", || Some(vec![matrix(&BLUE_FIX)])),
    ("ACES-LMT - ACES 1.3 Reference Gamut Compression", || {
        Some(vec![
            matrix(&Primaries::AP0.matrix_to(&Primaries::AP1)?),
            Directed::forward(Transform::Fixed(Fixed::GamutCompression(COMPRESSION))),
            matrix(&Primaries::AP1.matrix_to(&Primaries::AP0)?),
        ])
    }),
    ("ACES-OUTPUT - ACES2065-1_to_CIE-XYZ-D65 - SDR-CINEMA_1.0", || output(false, None)),
    ("ACES-OUTPUT - ACES2065-1_to_CIE-XYZ-D65 - SDR-VIDEO_1.0", || output(true, None)),
    ("ACES-OUTPUT - ACES2065-1_to_CIE-XYZ-D65 - SDR-CINEMA-REC709lim_1.1", || {
        output(false, Some(&Primaries::REC709))
    }),
    ("ACES-OUTPUT - ACES2065-1_to_CIE-XYZ-D65 - SDR-VIDEO-REC709lim_1.1", || {
        output(true, Some(&Primaries::REC709))
    }),
    ("ACES-OUTPUT - ACES2065-1_to_CIE-XYZ-D65 - SDR-VIDEO-P3lim_1.1", || {
        output(true, Some(&Primaries::P3_D65))
    }),
    ("APPLE_LOG_to_ACES2065-1", || {
        film(decode(Named::LinearToAppleLog), &Primaries::REC2020, Adaptation::Bradford)
    }),
    ("APPLE_LOG-APPLEWG_to_ACES2065-1", || {
        film(decode(Named::LinearToAppleLog), &APPLE_WIDE, Adaptation::Bradford)
    }),
    ("CURVE - APPLE_LOG_to_LINEAR", || Some(vec![decode(Named::LinearToAppleLog)])),
    ("ARRI_ALEXA-LOGC-EI800-AWG_to_ACES2065-1", || film(logc3(), &AWG3, Adaptation::Cat02)),
    ("ARRI_LOGC4_to_ACES2065-1", || film(logc4(), &AWG4, Adaptation::Cat02)),
    ("CANON_CLOG2-CGAMUT_to_ACES2065-1", || {
        film(decode(Named::LinearToCanonLog2), &CINEMA_GAMUT, Adaptation::Cat02)
    }),
    ("CURVE - CANON_CLOG2_to_LINEAR", || Some(vec![decode(Named::LinearToCanonLog2)])),
    ("CANON_CLOG3-CGAMUT_to_ACES2065-1", || {
        film(decode(Named::LinearToCanonLog3), &CINEMA_GAMUT, Adaptation::Cat02)
    }),
    ("CURVE - CANON_CLOG3_to_LINEAR", || Some(vec![decode(Named::LinearToCanonLog3)])),
    ("PANASONIC_VLOG-VGAMUT_to_ACES2065-1", || {
        let curve = camera(10.0, [0.241_514, 0.598_206], [1.0, 0.00873], Some(0.01), None);
        film(curve, &V_GAMUT, Adaptation::Bradford)
    }),
    ("RED_REDLOGFILM-RWG_to_ACES2065-1", || {
        let black = libm::pow(10_f64, (95.0 - 685.0) / 300.0);
        let gain = 1.0 - black;
        let curve = camera(10.0, [300.0 / 1023.0, 685.0 / 1023.0], [gain, black], None, None);
        film(curve, &RED_WIDE, Adaptation::Bradford)
    }),
    ("RED_LOG3G10-RWG_to_ACES2065-1", || {
        let curve =
            camera(10.0, [0.224_282, 0.0], [155.975_327, 0.01 * 155.975_327 + 1.0], Some(-0.01), None);
        film(curve, &RED_WIDE, Adaptation::Bradford)
    }),
    ("SONY_SLOG3-SGAMUT3_to_ACES2065-1", || film(slog3(), &S_GAMUT3, Adaptation::Cat02)),
    ("SONY_SLOG3-SGAMUT3.CINE_to_ACES2065-1", || film(slog3(), &S_GAMUT3_CINE, Adaptation::Cat02)),
    ("SONY_SLOG3-SGAMUT3-VENICE_to_ACES2065-1", || Some(vec![slog3(), matrix(&VENICE_S_GAMUT3)])),
    ("SONY_SLOG3-SGAMUT3.CINE-VENICE_to_ACES2065-1", || Some(vec![slog3(), matrix(&VENICE_S_GAMUT3_CINE)])),
    ("DISPLAY - CIE-XYZ-D65_to_REC.1886-REC.709", || {
        display(&Primaries::REC709, gamma(2.4, Negatives::Clamp))
    }),
    ("DISPLAY - CIE-XYZ-D65_to_REC.1886-REC.709 - MIRROR NEGS", || {
        display(&Primaries::REC709, gamma(2.4, Negatives::Mirror))
    }),
    ("DISPLAY - CIE-XYZ-D65_to_REC.1886-REC.2020", || {
        display(&Primaries::REC2020, gamma(2.4, Negatives::Clamp))
    }),
    ("DISPLAY - CIE-XYZ-D65_to_REC.1886-REC.2020 - MIRROR NEGS", || {
        display(&Primaries::REC2020, gamma(2.4, Negatives::Mirror))
    }),
    ("DISPLAY - CIE-XYZ-D65_to_G2.2-REC.709", || display(&Primaries::REC709, gamma(2.2, Negatives::Clamp))),
    ("DISPLAY - CIE-XYZ-D65_to_G2.2-REC.709 - MIRROR NEGS", || {
        display(&Primaries::REC709, gamma(2.2, Negatives::Mirror))
    }),
    ("DISPLAY - CIE-XYZ-D65_to_sRGB", || display(&Primaries::REC709, srgb(Negatives::Clamp))),
    ("DISPLAY - CIE-XYZ-D65_to_sRGB - MIRROR NEGS", || display(&Primaries::REC709, srgb(Negatives::Mirror))),
    ("DISPLAY - CIE-XYZ-D65_to_G2.6-P3-DCI-BFD", || {
        display(&Primaries::P3_DCI, gamma(2.6, Negatives::Clamp))
    }),
    ("DISPLAY - CIE-XYZ-D65_to_G2.6-P3-D65", || display(&Primaries::P3_D65, gamma(2.6, Negatives::Clamp))),
    ("DISPLAY - CIE-XYZ-D65_to_G2.6-P3-D65 - MIRROR NEGS", || {
        display(&Primaries::P3_D65, gamma(2.6, Negatives::Mirror))
    }),
    ("DISPLAY - CIE-XYZ-D65_to_G2.6-P3-D60-BFD", || {
        display(&Primaries::P3_D60, gamma(2.6, Negatives::Clamp))
    }),
    ("DISPLAY - CIE-XYZ-D65_to_DCDM-D65", || {
        Some(vec![scale(48.0 / 52.37, 0.0), gamma(2.6, Negatives::Clamp)])
    }),
    ("DISPLAY - CIE-XYZ-D65_to_DisplayP3", || display(&Primaries::P3_D65, srgb(Negatives::Mirror))),
    ("DISPLAY - CIE-XYZ-D65_to_DisplayP3-HDR", || display(&Primaries::P3_D65, srgb(Negatives::Mirror))),
    ("CURVE - ST-2084_to_LINEAR", || Some(vec![decode(Named::LinearToPq)])),
    ("CURVE - LINEAR_to_ST-2084", || Some(vec![named(Named::LinearToPq)])),
    ("DISPLAY - CIE-XYZ-D65_to_REC.2100-PQ", || display(&Primaries::REC2020, named(Named::LinearToPq))),
    ("DISPLAY - CIE-XYZ-D65_to_ST2084-P3-D65", || display(&Primaries::P3_D65, named(Named::LinearToPq))),
    ("DISPLAY - CIE-XYZ-D65_to_ST2084-DCDM-D65", || Some(vec![named(Named::LinearToPq)])),
    ("CURVE - HLG-OETF-INVERSE", || Some(vec![decode(Named::LinearToHlg)])),
    ("CURVE - HLG-OETF", || Some(vec![named(Named::LinearToHlg)])),
    ("DISPLAY - CIE-XYZ-D65_to_REC.2100-HLG-1000nit", || {
        // ITU-R BT.2100, inverse OOTF with the gamma 1.2: 1000 cd/m2 becomes the largest value, 3.
        let mut found = display(&Primaries::REC2020, scale(100.0 * libm::pow(3_f64, 1.2) / 1000.0, 0.0))?;
        found.push(Directed::forward(Transform::Fixed(Fixed::Surround(1.0 / 1.2))));
        found.push(named(Named::LinearToHlg));
        Some(found)
    }),
];

#[cfg(test)]
mod tests {
    use super::*;

    fn matrix_of(name: &str) -> [f64; 16] {
        let found = style(name).unwrap();
        found
            .iter()
            .find_map(|directed| match directed.transform {
                Transform::Matrix(matrix, _) => Some(matrix),
                _ => None,
            })
            .unwrap()
    }

    #[test]
    fn matrices_have_published_values() {
        // The first row, as the configurations of the Academy and OpenColorIO print it.
        for (name, expected) in [
            ("UTILITY - ACES-AP0_to_CIE-XYZ-D65_BFD", [0.938_279_849_3, -0.004_451_445_8, 0.016_627_523_6]),
            ("UTILITY - ACES-AP1_to_LINEAR-REC709_BFD", [1.705_050_992_7, -0.621_792_120_7, -0.083_258_872]),
            ("ACEScg_to_ACES2065-1", [0.695_452_241_4, 0.140_678_696_5, 0.163_869_062_2]),
            ("DISPLAY - CIE-XYZ-D65_to_sRGB", [3.240_969_941_9, -1.537_383_177_6, -0.498_610_760_3]),
            (
                "DISPLAY - CIE-XYZ-D65_to_G2.6-P3-DCI-BFD",
                [2.690_225_911_6, -1.094_001_937_4, -0.425_082_347_7],
            ),
            (
                "DISPLAY - CIE-XYZ-D65_to_G2.6-P3-D60-BFD",
                [2.428_254_486_7, -0.882_984_536_6, -0.390_212_853_6],
            ),
            ("DISPLAY - CIE-XYZ-D65_to_REC.2100-PQ", [1.716_651_188, -0.355_670_783_8, -0.253_366_281_4]),
            ("ARRI_ALEXA-LOGC-EI800-AWG_to_ACES2065-1", [0.680_205_505_1, 0.236_136_601_6, 0.083_657_893_3]),
            ("ARRI_LOGC4_to_ACES2065-1", [0.750_957_362_8, 0.144_422_786_7, 0.104_619_850_5]),
            ("CANON_CLOG2-CGAMUT_to_ACES2065-1", [0.763_064_454_8, 0.149_021_161_1, 0.087_914_384_1]),
            ("PANASONIC_VLOG-VGAMUT_to_ACES2065-1", [0.724_616_704_1, 0.166_915_288_2, 0.108_468_007_7]),
            ("RED_LOG3G10-RWG_to_ACES2065-1", [0.785_058_804_1, 0.083_858_756_5, 0.131_082_439_4]),
            ("SONY_SLOG3-SGAMUT3_to_ACES2065-1", [0.752_982_595_4, 0.143_370_216_2, 0.103_647_188_4]),
            ("SONY_SLOG3-SGAMUT3.CINE_to_ACES2065-1", [0.638_788_667_2, 0.272_351_433_7, 0.088_859_899_1]),
            ("APPLE_LOG_to_ACES2065-1", [0.679_085_634_7, 0.157_700_914_6, 0.163_213_450_6]),
            ("APPLE_LOG-APPLEWG_to_ACES2065-1", [0.694_961_049_3, 0.241_405_268_8, 0.063_633_681_9]),
        ] {
            for (got, expected) in matrix_of(name).iter().zip(expected) {
                assert!((got - expected).abs() < 2e-9, "{name}: {got} {expected}");
            }
        }
    }

    #[test]
    fn names_are_unique_and_all_can_be_made() {
        for (i, (name, make)) in STYLES.iter().enumerate() {
            assert!(make().is_some(), "{name}");
            assert!(STYLES[..i].iter().all(|(other, _)| other != name), "{name}");
        }
        assert!(style("acescg_to_aces2065-1").is_some() && style("ACES").is_none());
    }
}
