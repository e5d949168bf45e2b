//! Colour maps for single values.

/// A scale of colours.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ColorMap {
    /// Turns through the colours while it grows lighter throughout, so that it can also be read without colours. It is
    /// the "cubehelix" of D. A. Green, A colour scheme for the display of astronomical intensity data, Bulletin of the
    /// Astronomical Society of India 39 (2011), with start 0.5, -1.5 rotations, hue 1.2 and gamma 1.
    #[default]
    Helix,
    /// Blue, cyan, green, yellow, red. Neighbouring values are easily distinguished.
    Spectrum,
    /// Black, red, yellow, white.
    Heat,
    /// Blue below the middle, white at it and red above it, for values of either sign.
    Signed,
    /// Black, purple, orange, light yellow, in even steps of lightness. It is the "magma" of S. van der Walt and N.
    /// Smith, in which maps of FLIP are shown.
    Magma,
    /// Black to white.
    Grey,
}

/// The colours of [`ColorMap::Magma`] at every eighth of its range.
const MAGMA: [[u8; 3]; 9] = [
    [0, 0, 4],
    [28, 16, 68],
    [79, 18, 123],
    [129, 37, 129],
    [181, 54, 122],
    [229, 80, 100],
    [251, 135, 97],
    [254, 194, 135],
    [252, 253, 191],
];

impl ColorMap {
    /// All maps.
    pub const ALL: [Self; 6] =
        [Self::Helix, Self::Spectrum, Self::Heat, Self::Signed, Self::Magma, Self::Grey];

    /// Returns its name.
    pub fn word(self) -> &'static str {
        match self {
            Self::Helix => "helix",
            Self::Spectrum => "spectrum",
            Self::Heat => "heat",
            Self::Signed => "signed",
            Self::Magma => "magma",
            Self::Grey => "grey",
        }
    }

    /// Returns the map with this name.
    pub fn from_word(word: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|m| m.word().eq_ignore_ascii_case(word))
    }

    /// Returns the colour at `t`, from 0 to 1, for a screen.
    pub fn at(self, t: f32) -> [u8; 3] {
        let ramp = |t: f32| (t.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
        match self {
            Self::Helix => {
                let angle = std::f32::consts::TAU * (0.5 / 3.0 + 1.0 - 1.5 * t);
                let (sin, cos) = angle.sin_cos();
                let reach = 1.2 * t * (1.0 - t) / 2.0;
                let one = |c: f32, s: f32| ramp(t + reach * (c * cos + s * sin));
                [one(-0.148_61, 1.782_77), one(-0.292_27, -0.906_49), one(1.972_94, 0.0)]
            }
            Self::Spectrum => {
                // The channels are triangles around the positions of the pure colours.
                let near = |place: f32| ramp(1.5 - (4.0 * (t - place)).abs());
                [near(0.75), near(0.5), near(0.25)]
            }
            Self::Heat => [ramp(3.0 * t), ramp(3.0 * t - 1.0), ramp(3.0 * t - 2.0)],
            Self::Signed => {
                let u = 2.0 * t - 1.0;
                [ramp(1.0 + u.min(0.0)), ramp(1.0 - u.abs()), ramp(1.0 - u.max(0.0))]
            }
            Self::Magma => {
                let at = t.clamp(0.0, 1.0) * (MAGMA.len() - 1) as f32;
                let (i, f) = (at as usize, at.fract());
                let (a, b) = (MAGMA[i], MAGMA[(i + 1).min(MAGMA.len() - 1)]);
                std::array::from_fn(|c| {
                    (f32::from(a[c]) + (f32::from(b[c]) - f32::from(a[c])) * f + 0.5) as u8
                })
            }
            Self::Grey => [ramp(t); 3],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colour_maps_have_their_ends_and_increase() {
        assert_eq!(ColorMap::Helix.at(0.0), [0, 0, 0]);
        assert_eq!(ColorMap::Helix.at(1.0), [255, 255, 255]);
        assert_eq!(ColorMap::Heat.at(1.0), [255, 255, 255]);
        assert_eq!(ColorMap::Signed.at(0.5), [255, 255, 255]);
        for map in ColorMap::ALL {
            assert_eq!(ColorMap::from_word(map.word()), Some(map));
            assert_eq!(map.at(7.0), map.at(7.0), "no number breaks it");
        }
        let light = |map: ColorMap, t: f32| {
            let [r, g, b] = map.at(t).map(f32::from);
            0.3 * r + 0.59 * g + 0.11 * b
        };
        for map in [ColorMap::Helix, ColorMap::Magma] {
            let at = |i: usize| light(map, i as f32 / 100.0);
            assert!((0..100).all(|i| at(i) <= at(i + 1) + 1.0), "{}", map.word());
        }
        assert_eq!((ColorMap::Magma.at(0.0), ColorMap::Magma.at(1.0)), ([0, 0, 4], [252, 253, 191]));
    }
}
