//! Wrap modes of textures outside [0, 1].

/// The behaviour of a texture outside its image, per direction (reference 9.1.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum Wrap {
    /// The result is 0 in all channels, alpha included.
    #[default]
    Black,
    /// The nearest texel of the border is used.
    Clamp,
    /// The image repeats.
    Periodic,
    /// The image repeats, every second copy reversed.
    Mirror,
}

impl Wrap {
    /// All wrap modes.
    pub const ALL: [Self; 4] = [Self::Black, Self::Clamp, Self::Periodic, Self::Mirror];

    /// Returns the word in files, shaders and options.
    pub fn word(self) -> &'static str {
        match self {
            Self::Black => "black",
            Self::Clamp => "clamp",
            Self::Periodic => "periodic",
            Self::Mirror => "mirror",
        }
    }

    /// Returns the mode of a name. "mirrow" (a spelling found in files) is read as "mirror". Returns `None` for
    /// anything else, "default" included.
    pub fn from_word(word: &str) -> Option<Self> {
        match word.trim() {
            "mirrow" => Some(Self::Mirror),
            word => Self::ALL.into_iter().find(|w| w.word() == word),
        }
    }

    /// Reads the `wrapmodes` attribute of a file: "s,t", or one word for both.
    pub fn parse_pair(text: &str) -> Option<(Self, Self)> {
        match text.split_once(',') {
            Some((s, t)) => Some((Self::from_word(s)?, Self::from_word(t)?)),
            None => Self::from_word(text).map(|w| (w, w)),
        }
    }

    /// Returns the texel at index `i` of a row of `n` (at least 1); `None` where it is black outside.
    pub(crate) fn index(self, i: i32, n: i32) -> Option<i32> {
        if (0..n).contains(&i) {
            return Some(i);
        }
        match self {
            Self::Black => None,
            Self::Clamp => Some(i.clamp(0, n - 1)),
            Self::Periodic => Some(i.rem_euclid(n)),
            Self::Mirror => {
                let (i, n) = (i64::from(i), i64::from(n));
                let i = i.rem_euclid(2 * n);
                Some(if i < n { i } else { 2 * n - 1 - i } as i32)
            }
        }
    }

    /// Moves a coordinate near [0, 1] without changing the result, so that texel indices stay small and exact. `x`
    /// is finite.
    pub(crate) fn reduce(self, x: f32) -> f32 {
        match self {
            Self::Black | Self::Clamp => x.clamp(-64.0, 65.0),
            Self::Periodic if (0.0..=1.0).contains(&x) => x,
            Self::Periodic => x - floor(x),
            Self::Mirror => x - 2.0 * floor(x * 0.5),
        }
    }
}

/// Returns the largest whole number that is not above `x`. The instruction for it does not exist on all machines, and a
/// call of the library's function takes longer than a bilinear lookup should.
#[inline]
fn floor(x: f32) -> f32 {
    if x.abs() < 1e9 {
        let whole = x as i32 as f32;
        if x < whole { whole - 1.0 } else { whole }
    } else {
        x.floor()
    }
}

/// Returns the texel to the left of (above) a coordinate in a row of `n`, and the distance of the coordinate from
/// that texel's centre towards the next.
#[inline]
pub(crate) fn cell(s: f32, n: u32) -> (i32, f32) {
    let x = s * n as f32 - 0.5;
    let whole = floor(x);
    (whole as i32, x - whole)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wrapped_indices_follow_their_mode() {
        let row = |w: Wrap| (-4..8).map(|i| w.index(i, 3).map_or(-1, |x| x)).collect::<Vec<_>>();
        assert_eq!(row(Wrap::Black), [-1, -1, -1, -1, 0, 1, 2, -1, -1, -1, -1, -1]);
        assert_eq!(row(Wrap::Clamp), [0, 0, 0, 0, 0, 1, 2, 2, 2, 2, 2, 2]);
        assert_eq!(row(Wrap::Periodic), [2, 0, 1, 2, 0, 1, 2, 0, 1, 2, 0, 1]);
        assert_eq!(row(Wrap::Mirror), [2, 2, 1, 0, 0, 1, 2, 2, 1, 0, 0, 1]);
        for w in Wrap::ALL {
            for i in [i32::MIN, i32::MAX] {
                assert!(w.index(i, 1).is_none_or(|x| x == 0));
                assert!(w.index(i, i32::MAX).is_none_or(|x| (0..i32::MAX).contains(&x)));
            }
        }
    }

    #[test]
    fn wrap_modes_are_read_from_words() {
        for w in Wrap::ALL {
            assert_eq!(Wrap::from_word(w.word()), Some(w));
        }
        assert_eq!(Wrap::from_word("mirrow"), Some(Wrap::Mirror));
        assert_eq!(Wrap::from_word("default"), None);
        assert_eq!(Wrap::parse_pair("periodic,clamp"), Some((Wrap::Periodic, Wrap::Clamp)));
        assert_eq!(Wrap::parse_pair("mirror"), Some((Wrap::Mirror, Wrap::Mirror)));
        assert_eq!(Wrap::parse_pair("a,b"), None);
    }

    #[test]
    fn numbers_are_rounded_down_as_the_library_does() {
        for x in [0.0, 0.5, -0.5, 1.0, -1.0, 0.999_999_9, -1e-30, 123.75, -8_388_607.5, 1e9, -3e9, 1e30] {
            assert_eq!(floor(x), x.floor(), "{x}");
        }
        assert!(floor(f32::NAN).is_nan());
    }
}
