//! Conversions of colours that are not stored as red, green and blue, and the names of profiles, which several formats
//! share.

use granita_base::math;

/// Returns red, green and blue of four inks from 0 (no ink) to 1, without a profile.
pub fn cmyk_to_rgb([c, m, y, k]: [f32; 4]) -> [f32; 3] {
    [c, m, y].map(|ink| (1.0 - ink) * (1.0 - k))
}

/// Converts a CIE L*a*b* colour to sRGB from 0 to 1. Colours outside the gamut are clamped. By convention the colours
/// are relative to the illuminant D50. They are adapted to D65, that of sRGB, by Bradford's matrix, so that white
/// remains white.
pub fn lab_to_srgb([l, a, b]: [f32; 3]) -> [f32; 3] {
    // The formula is that of CIE 15:2004, 8.2.1.
    let linear = |f: f32| if f > 6.0 / 29.0 { f * f * f } else { (f - 4.0 / 29.0) * (108.0 / 841.0) };
    let f = (l + 16.0) / 116.0;
    let [x, y, z] = [0.96422 * linear(f + a / 500.0), linear(f), 0.82521 * linear(f - b / 200.0)];
    // The matrix converts XYZ of D50 to linear sRGB. It is the product of Bradford's matrix and that of IEC 61966-2-1.
    [
        3.133_856 * x - 1.616_867 * y - 0.490_615 * z,
        -0.978_768 * x + 1.916_142 * y + 0.033_454 * z,
        0.071_945 * x - 0.228_991 * y + 1.405_243 * z,
    ]
    .map(|v| {
        let v = v.clamp(0.0, 1.0);
        if v <= 0.003_130_8 { v * 12.92 } else { 1.055 * math::pow(v, 1.0 / 2.4) - 0.055 }
    })
}

/// Returns the description of an ICC profile (ICC.1:2010, 9.2.41), or its length.
pub fn profile(bytes: &[u8]) -> String {
    described(bytes).unwrap_or_else(|| format!("{} bytes", bytes.len()))
}

fn described(bytes: &[u8]) -> Option<String> {
    let long =
        |at: usize| bytes.get(at..at + 4).map(|b| u32::from_be_bytes([b[0], b[1], b[2], b[3]]) as usize);
    let count = long(128)?.min(100);
    let entry = (0..count).map(|i| 132 + 12 * i).find(|at| bytes.get(*at..at + 4) == Some(b"desc"))?;
    let (at, len) = (long(entry + 4)?, long(entry + 8)?);
    let tag = bytes.get(at..at.checked_add(len)?)?;
    let long = |at: usize| tag.get(at..at + 4).map(|b| u32::from_be_bytes([b[0], b[1], b[2], b[3]]) as usize);
    let text = match tag.get(..4)? {
        // The profile has version 2, and a text of Latin characters.
        b"desc" => String::from_utf8_lossy(tag.get(12..12_usize.checked_add(long(8)?)?)?).into_owned(),
        // The profile has version 4, and texts of 16-bit characters in several languages, of which the first is taken.
        b"mluc" => {
            let (len, at) = (long(20)?, long(24)?);
            let units = tag.get(at..at.checked_add(len)?)?.as_chunks::<2>().0;
            char::decode_utf16(units.iter().map(|u| u16::from_be_bytes(*u))).filter_map(Result::ok).collect()
        }
        _ => return None,
    };
    let text: String = text.trim_end_matches('\0').trim().chars().take(200).collect();
    (!text.is_empty()).then_some(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The well-known L*a*b* (D50) of the primaries of sRGB, to a tenth of a thousandth.
    const PRIMARIES: [([f32; 3], [u8; 3]); 5] = [
        ([100.0, 0.0, 0.0], [255; 3]),
        ([54.2905, 80.8049, 69.8910], [255, 0, 0]),
        ([87.8185, -79.2711, 80.9946], [0, 255, 0]),
        ([29.5683, 68.2874, -112.0297], [0, 0, 255]),
        ([53.3890, 0.0, 0.0], [127; 3]),
    ];

    #[test]
    fn lab_primaries_become_rgb_primaries() {
        for (lab, rgb) in PRIMARIES {
            let got = lab_to_srgb(lab).map(|v| (v * 255.0).round() as i32);
            assert!(got.iter().zip(rgb).all(|(a, b)| (a - i32::from(b)).abs() <= 1), "{lab:?}: {got:?}");
        }
    }

    #[test]
    fn inks_darken() {
        assert_eq!(cmyk_to_rgb([0.0; 4]), [1.0; 3]);
        assert_eq!(cmyk_to_rgb([1.0, 0.0, 0.5, 0.5]), [0.0, 0.5, 0.25]);
    }

    #[test]
    fn profiles_have_their_description_or_their_length() {
        let profile_of = |tag: &[u8]| {
            let mut file = vec![0; 128];
            file.extend(1_u32.to_be_bytes());
            file.extend(b"desc");
            file.extend(144_u32.to_be_bytes());
            file.extend((tag.len() as u32).to_be_bytes());
            file.extend(tag);
            profile(&file)
        };
        assert_eq!(profile_of(b"desc\0\0\0\0\0\0\0\x05sRGB\0"), "sRGB");
        let name: Vec<u8> = "Gr\u{fc}n".encode_utf16().flat_map(u16::to_be_bytes).collect();
        let several = [b"mluc\0\0\0\0\0\0\0\x01\0\0\0\x0cenUS\0\0\0\x08\0\0\0\x1c" as &[u8], &name].concat();
        assert_eq!(profile_of(&several), "Gr\u{fc}n");
        assert_eq!(profile_of(b"desc\0\0\0\0\xff\xff\xff\xffsRGB\0"), "161 bytes");
        assert_eq!(profile_of(b"text"), "148 bytes");
        assert_eq!(profile(&[]), "0 bytes");
    }
}
