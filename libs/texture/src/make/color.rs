//! Gamma and the common colour spaces. Colours become linear light before MIP levels are made, and are encoded after.

/// A colour space of `-colorconvert`. All except ACEScg have Rec. 709 primaries.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ColorSpace {
    /// Linear light.
    Linear,
    /// The transfer function of IEC 61966-2-1.
    Srgb,
    /// The transfer function of ITU-R BT.709.
    Rec709,
    /// The power 1.8.
    Gamma18,
    /// The power 2.2.
    Gamma22,
    /// Linear light in the primaries AP1 with the white of ACES (S-2014-004).
    AcesCg,
}

/// The matrix from linear Rec. 709 to ACEScg, with Bradford adaptation from D65.
const TO_ACESCG: [[f32; 3]; 3] = [
    [0.613_097_4, 0.339_523_1, 0.047_379_5],
    [0.070_193_7, 0.916_353_9, 0.013_452_4],
    [0.020_615_6, 0.109_569_8, 0.869_814_6],
];

/// The inverse of [`TO_ACESCG`].
const FROM_ACESCG: [[f32; 3]; 3] = [
    [1.705_051, -0.621_792_1, -0.083_258_9],
    [-0.130_256_4, 1.140_804_7, -0.010_548_3],
    [-0.024_003_4, -0.128_969, 1.152_972_3],
];

impl ColorSpace {
    /// All colour spaces.
    pub const ALL: [Self; 6] =
        [Self::Linear, Self::Srgb, Self::Rec709, Self::Gamma18, Self::Gamma22, Self::AcesCg];

    /// Returns the name on the command line.
    pub fn word(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Srgb => "srgb",
            Self::Rec709 => "rec709",
            Self::Gamma18 => "g18",
            Self::Gamma22 => "g22",
            Self::AcesCg => "acescg",
        }
    }

    /// Returns the colour space of a name. Upper and lower case do not matter. The names of other tools for the same
    /// spaces are accepted too.
    pub fn from_word(word: &str) -> Option<Self> {
        let word = word.to_ascii_lowercase();
        Some(match &*word {
            "lin_srgb" | "lin_rec709" | "lin_rec709_scene" | "scene_linear" => Self::Linear,
            "srgb_texture" | "srgb_rec709_scene" => Self::Srgb,
            "lin_ap1" | "lin_ap1_scene" => Self::AcesCg,
            "g22_rec709" | "gamma2.2" => Self::Gamma22,
            "gamma1.8" => Self::Gamma18,
            word => return Self::ALL.into_iter().find(|s| s.word() == word),
        })
    }

    /// Returns the linear light of a stored value. The function is odd around 0, so that negative values keep their
    /// sign.
    pub fn decode(self, v: f32) -> f32 {
        let a = v.abs();
        let linear = match self {
            Self::Linear | Self::AcesCg => return v,
            Self::Srgb if a <= 0.040_45 => a / 12.92,
            Self::Srgb => ((a + 0.055) / 1.055).powf(2.4),
            Self::Rec709 if a < 0.081 => a / 4.5,
            Self::Rec709 => ((a + 0.099) / 1.099).powf(1.0 / 0.45),
            Self::Gamma18 => a.powf(1.8),
            Self::Gamma22 => a.powf(2.2),
        };
        linear.min(1e30).copysign(v)
    }

    /// Returns the stored value of linear light, which is the inverse of [`ColorSpace::decode`].
    pub fn encode(self, v: f32) -> f32 {
        let a = v.abs();
        let stored = match self {
            Self::Linear | Self::AcesCg => return v,
            Self::Srgb if a <= 0.003_130_8 => a * 12.92,
            Self::Srgb => 1.055 * a.powf(1.0 / 2.4) - 0.055,
            Self::Rec709 if a < 0.018 => a * 4.5,
            Self::Rec709 => 1.099 * a.powf(0.45) - 0.099,
            Self::Gamma18 => a.powf(1.0 / 1.8),
            Self::Gamma22 => a.powf(1.0 / 2.2),
        };
        stored.copysign(v)
    }

    /// Returns the matrix from the linear light of one space to that of another; `None` where their primaries are the
    /// same.
    fn matrix(from: Self, to: Self) -> Option<&'static [[f32; 3]; 3]> {
        match (from == Self::AcesCg, to == Self::AcesCg) {
            (false, true) => Some(&TO_ACESCG),
            (true, false) => Some(&FROM_ACESCG),
            _ => None,
        }
    }
}

/// Raises the magnitude to a power, and keeps the sign.
fn power(v: f32, g: f32) -> f32 {
    if g == 1.0 { v } else { v.abs().powf(g).min(1e30).copysign(v) }
}

/// The conversion of the colours of the inputs, and of those of the texture.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Conversion {
    pub(super) ingamma: f32,
    pub(super) outgamma: f32,
    pub(super) spaces: (ColorSpace, ColorSpace),
    /// The index of the alpha channel, which is not converted.
    pub(super) alpha: Option<usize>,
    /// True when colours have to be multiplied by alpha.
    pub(super) multiply: bool,
}

impl Conversion {
    /// True when inputs stay as they are.
    pub(crate) fn keeps_inputs(&self) -> bool {
        let (from, to) = self.spaces;
        self.ingamma == 1.0
            && !self.multiply
            && matches!(from, ColorSpace::Linear | ColorSpace::AcesCg)
            && ColorSpace::matrix(from, to).is_none()
    }

    /// True when the texture stores the values in which MIP levels are computed.
    pub(crate) fn keeps_outputs(&self) -> bool {
        self.outgamma == 1.0 && matches!(self.spaces.1, ColorSpace::Linear | ColorSpace::AcesCg)
    }

    /// True when channel `c` is a colour, which is one of the first three and not alpha.
    fn is_color(&self, c: usize) -> bool {
        c < 3 && self.alpha != Some(c)
    }

    /// Returns a value of an input as linear light, before matrices and alpha.
    fn decode(&self, v: f32) -> f32 {
        self.spaces.0.decode(power(v, self.ingamma))
    }

    /// Converts whole pixels of `n` channels of an input to linear light.
    pub(crate) fn to_linear(self, values: &mut [f32], n: usize) {
        if self.keeps_inputs() {
            return;
        }
        if self.ingamma != 1.0 || !matches!(self.spaces.0, ColorSpace::Linear | ColorSpace::AcesCg) {
            self.each(values, n, |v| self.decode(v));
        }
        self.finish_linear(values, n);
    }

    /// Does the same for 8-bit pixels, whose colours are looked up in a table.
    pub(crate) fn bytes_to_linear(self, bytes: &[u8], n: usize, out: &mut [f32]) {
        let plain: [f32; 256] = std::array::from_fn(|i| i as f32 / 255.0);
        let table = plain.map(|v| self.decode(v));
        for (texel, bytes) in out.chunks_exact_mut(n).zip(bytes.chunks_exact(n)) {
            for (c, (v, byte)) in texel.iter_mut().zip(bytes).enumerate() {
                *v = if self.is_color(c) { table[usize::from(*byte)] } else { plain[usize::from(*byte)] };
            }
        }
        self.finish_linear(out, n);
    }

    /// Converts the primaries, and multiplies colours by alpha where needed.
    fn finish_linear(self, values: &mut [f32], n: usize) {
        if let Some(m) = ColorSpace::matrix(self.spaces.0, self.spaces.1).filter(|_| n >= 3) {
            for texel in values.chunks_exact_mut(n) {
                let [r, g, b] = [texel[0], texel[1], texel[2]];
                for (c, row) in m.iter().enumerate() {
                    texel[c] = row[0] * r + row[1] * g + row[2] * b;
                }
            }
        }
        if let Some(alpha) = self.alpha.filter(|_| self.multiply) {
            for texel in values.chunks_exact_mut(n) {
                let a = texel[alpha];
                for (c, v) in texel.iter_mut().enumerate() {
                    if self.is_color(c) {
                        *v *= a;
                    }
                }
            }
        }
    }

    /// Converts whole pixels of linear light to the values that the texture stores.
    pub(crate) fn to_stored(self, values: &mut [f32], n: usize) {
        if !self.keeps_outputs() {
            self.each(values, n, |v| power(self.spaces.1.encode(v), 1.0 / self.outgamma));
        }
    }

    fn each(&self, values: &mut [f32], n: usize, change: impl Fn(f32) -> f32) {
        for texel in values.chunks_exact_mut(n) {
            for (c, v) in texel.iter_mut().enumerate() {
                if self.is_color(c) {
                    *v = change(*v);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::MakeOptions;
    use super::*;

    #[test]
    fn color_spaces_survive_encoding_and_decoding() {
        for space in ColorSpace::ALL {
            assert_eq!(ColorSpace::from_word(&space.word().to_uppercase()), Some(space));
            for i in -20..=40 {
                let v = i as f32 / 20.0;
                assert!((space.encode(space.decode(v)) - v).abs() < 2e-6, "{space:?} {v}");
            }
            assert!((space.decode(1.0) - 1.0).abs() < 1e-6);
        }
        assert!((ColorSpace::Srgb.decode(0.5) - 0.214_041).abs() < 1e-6);
        assert_eq!(ColorSpace::from_word("prophoto"), None);
    }

    #[test]
    fn white_stays_white_in_acescg() {
        for m in [TO_ACESCG, FROM_ACESCG] {
            for row in m {
                assert!((row.iter().sum::<f32>() - 1.0).abs() < 1e-6);
            }
        }
        for (i, row) in TO_ACESCG.iter().enumerate() {
            for j in [0, 1, 2] {
                let product: f32 = row.iter().zip(FROM_ACESCG).map(|(a, b)| a * b[j]).sum();
                assert!((product - f32::from(u8::from(i == j))).abs() < 2e-6, "{i} {j} {product}");
            }
        }
    }

    #[test]
    fn conversion_keeps_alpha_and_signs() {
        let options = MakeOptions { ingamma: 2.0, outgamma: 2.0, ..MakeOptions::default() };
        let c = options.conversion(Some(3), false);
        let mut v = [0.5, -0.5, 1.0, 0.5];
        c.to_linear(&mut v, 4);
        assert_eq!(v, [0.25, -0.25, 1.0, 0.5]);
        c.to_stored(&mut v, 4);
        assert_eq!(v, [0.5, -0.5, 1.0, 0.5]);
        // Grey with alpha has a second channel that is not a colour.
        let mut v = [0.5, 0.5];
        options.conversion(Some(1), true).to_linear(&mut v, 2);
        assert_eq!(v, [0.125, 0.5]);
    }

    #[test]
    fn conversions_of_bytes_and_floats_agree() {
        let options = MakeOptions {
            color_convert: Some((ColorSpace::Srgb, ColorSpace::AcesCg)),
            ..MakeOptions::default()
        };
        let c = options.conversion(Some(3), true);
        let bytes: Vec<u8> = (0..=255).collect();
        let mut a = vec![0.0; 256];
        c.bytes_to_linear(&bytes, 4, &mut a);
        let mut b: Vec<f32> = bytes.iter().map(|v| f32::from(*v) / 255.0).collect();
        c.to_linear(&mut b, 4);
        assert_eq!(a, b);
    }
}
