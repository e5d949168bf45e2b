//! Matrices between colour spaces of given primaries, computed from their chromaticities.

/// A matrix of 3 x 3 numbers. It acts on column vectors: a row holds the weights of one result.
pub type Matrix3 = [[f64; 3]; 3];

/// The chromaticities x and y of three primaries and of white (CIE 1931).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Primaries {
    /// Red.
    pub red: [f64; 2],
    /// Green.
    pub green: [f64; 2],
    /// Blue.
    pub blue: [f64; 2],
    /// White.
    pub white: [f64; 2],
}

/// The white D65 (CIE 15).
pub const D65: [f64; 2] = [0.3127, 0.3290];
/// The white of ACES, close to D60 (SMPTE ST 2065-1).
pub const ACES_WHITE: [f64; 2] = [0.32168, 0.33767];
/// The white of the projectors of digital cinema (SMPTE RP 431-2).
pub const DCI_WHITE: [f64; 2] = [0.314, 0.351];

impl Primaries {
    /// The primaries AP0 of ACES2065-1 (SMPTE ST 2065-1).
    pub const AP0: Self =
        Self { red: [0.7347, 0.2653], green: [0.0, 1.0], blue: [0.0001, -0.077], white: ACES_WHITE };
    /// The primaries AP1 of ACEScg, ACEScc and ACEScct (AMPAS S-2014-004).
    pub const AP1: Self =
        Self { red: [0.713, 0.293], green: [0.165, 0.83], blue: [0.128, 0.044], white: ACES_WHITE };
    /// The primaries of Rec. 709 and sRGB (ITU-R BT.709).
    pub const REC709: Self = Self { red: [0.64, 0.33], green: [0.3, 0.6], blue: [0.15, 0.06], white: D65 };
    /// The primaries of Rec. 2020 and Rec. 2100 (ITU-R BT.2020).
    pub const REC2020: Self =
        Self { red: [0.708, 0.292], green: [0.17, 0.797], blue: [0.131, 0.046], white: D65 };
    /// The primaries of digital cinema with the white D65, which are those of Display P3 (SMPTE RP 431-2, EG 432-1).
    pub const P3_D65: Self = Self { red: [0.68, 0.32], green: [0.265, 0.69], blue: [0.15, 0.06], white: D65 };
    /// The primaries of digital cinema with the white of ACES.
    pub const P3_D60: Self = Self { white: ACES_WHITE, ..Self::P3_D65 };
    /// The primaries of digital cinema with the white of its projectors (SMPTE RP 431-2).
    pub const P3_DCI: Self = Self { white: DCI_WHITE, ..Self::P3_D65 };
    /// The primaries of Adobe RGB (1998).
    pub const ADOBE_RGB: Self =
        Self { red: [0.64, 0.33], green: [0.21, 0.71], blue: [0.15, 0.06], white: D65 };

    /// Returns the matrix from linear red, green and blue to CIE XYZ, in which white has Y = 1 (SMPTE RP 177). `None`
    /// for primaries that lie on a line.
    pub fn to_xyz(&self) -> Option<Matrix3> {
        let columns = [self.red, self.green, self.blue].map(xyz);
        let m = transpose(&columns);
        let weights = apply(&inverse(&m)?, xyz(self.white));
        let scaled = m.map(|row| [row[0] * weights[0], row[1] * weights[1], row[2] * weights[2]]);
        scaled.iter().flatten().all(|v| v.is_finite()).then_some(scaled)
    }

    /// Returns the matrix from linear colours of these primaries to linear colours of `to`. Where the whites differ,
    /// colours are adapted by Bradford's matrix. `None` for primaries that lie on a line.
    pub fn matrix_to(&self, to: &Self) -> Option<Matrix3> {
        let adapted = multiply(&adaptation(self.white, to.white, Adaptation::Bradford), &self.to_xyz()?);
        Some(multiply(&inverse(&to.to_xyz()?)?, &adapted))
    }

    /// True when all chromaticities are within `tolerance` of those of another.
    pub fn is_near(&self, other: &Self, tolerance: f64) -> bool {
        let all = |p: &Self| [p.red, p.green, p.blue, p.white];
        all(self).iter().flatten().zip(all(other).iter().flatten()).all(|(a, b)| (a - b).abs() <= tolerance)
    }
}

/// A matrix in whose coordinates whites are scaled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Adaptation {
    /// Bradford's (Lam 1985).
    Bradford,
    /// That of CIECAM02 (CIE 159:2004).
    Cat02,
}

impl Adaptation {
    fn matrix(self) -> Matrix3 {
        match self {
            Self::Bradford => {
                [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
            }
            Self::Cat02 => [[0.7328, 0.4296, -0.1624], [-0.7036, 1.6975, 0.0061], [0.0030, 0.0136, 0.9834]],
        }
    }
}

/// Returns CIE XYZ of a chromaticity with Y = 1.
pub fn xyz([x, y]: [f64; 2]) -> [f64; 3] {
    [x / y, 1.0, (1.0 - x - y) / y]
}

/// Returns the matrix in CIE XYZ that adapts colours under one white to those under another.
pub fn adaptation(from: [f64; 2], to: [f64; 2], kind: Adaptation) -> Matrix3 {
    if from == to {
        return IDENTITY;
    }
    let cone = kind.matrix();
    let (a, b) = (apply(&cone, xyz(from)), apply(&cone, xyz(to)));
    let scaled = [0, 1, 2].map(|i| cone[i].map(|v| v * b[i] / a[i]));
    // The matrices of cones can be inverted.
    multiply(&inverse(&cone).unwrap_or(IDENTITY), &scaled)
}

/// The matrix that changes nothing.
pub const IDENTITY: Matrix3 = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

fn transpose(m: &Matrix3) -> Matrix3 {
    [0, 1, 2].map(|i| [m[0][i], m[1][i], m[2][i]])
}

/// Returns the product, which applies `b` first.
pub fn multiply(a: &Matrix3, b: &Matrix3) -> Matrix3 {
    [0, 1, 2].map(|i| [0, 1, 2].map(|j| a[i][0] * b[0][j] + a[i][1] * b[1][j] + a[i][2] * b[2][j]))
}

/// Returns the product of a matrix and a vector.
pub fn apply(m: &Matrix3, v: [f64; 3]) -> [f64; 3] {
    m.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

/// Returns the inverse; `None` for a singular matrix, or one with values that are not finite.
pub fn inverse(m: &Matrix3) -> Option<Matrix3> {
    let minor = |i: usize, j: usize| {
        let (a, b, c, d) = ((i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3);
        m[a][c] * m[b][d] - m[a][d] * m[b][c]
    };
    let determinant = (0..3).map(|j| m[0][j] * minor(0, j)).sum::<f64>();
    // Rounding makes the determinant of a singular matrix a little more than 0.
    let largest = m.iter().flatten().fold(0.0, |a: f64, v| a.max(v.abs()));
    if !determinant.is_finite() || determinant.abs() <= 1e-14 * largest.powi(3) {
        return None;
    }
    Some([0, 1, 2].map(|i| [0, 1, 2].map(|j| minor(j, i) / determinant)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_near(a: &Matrix3, b: &Matrix3, tolerance: f64) {
        for (a, b) in a.iter().flatten().zip(b.iter().flatten()) {
            assert!((a - b).abs() < tolerance, "{a} {b}");
        }
    }

    #[test]
    fn matrices_are_those_of_the_standards() {
        // SMPTE ST 2065-1:2012, 4.1.2.
        let ap0 = [
            [0.952_552_395_9, 0.0, 0.000_093_678_6],
            [0.343_966_449_8, 0.728_166_096_6, -0.072_132_546_4],
            [0.0, 0.0, 1.008_825_184_4],
        ];
        assert_near(&Primaries::AP0.to_xyz().unwrap(), &ap0, 1e-9);
        // AMPAS S-2014-004, 4.4: ACEScg to ACES2065-1, to ten digits.
        let ap1 = [
            [0.695_452_241_4, 0.140_678_696_5, 0.163_869_062_2],
            [0.044_794_563_4, 0.859_671_118_5, 0.095_534_318_2],
            [-0.005_525_882_6, 0.004_025_210_3, 1.001_500_672_3],
        ];
        assert_near(&Primaries::AP1.matrix_to(&Primaries::AP0).unwrap(), &ap1, 1e-9);
        // IEC 61966-2-1, to four digits.
        let srgb = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]];
        assert_near(&Primaries::REC709.to_xyz().unwrap(), &srgb, 6e-5);
        // ITU-R BT.2087: Rec. 709 to Rec. 2020, to four digits.
        let wide = [[0.6274, 0.3293, 0.0433], [0.0691, 0.9195, 0.0114], [0.0164, 0.0880, 0.8956]];
        assert_near(&Primaries::REC709.matrix_to(&Primaries::REC2020).unwrap(), &wide, 6e-5);
    }

    #[test]
    fn white_stays_white_and_the_way_back_is_the_inverse() {
        for (a, b) in [(Primaries::AP0, Primaries::REC709), (Primaries::P3_DCI, Primaries::ADOBE_RGB)] {
            let there = a.matrix_to(&b).unwrap();
            for v in apply(&there, [1.0; 3]) {
                assert!((v - 1.0).abs() < 1e-9, "{v}");
            }
            assert_near(&multiply(&there, &b.matrix_to(&a).unwrap()), &IDENTITY, 1e-9);
        }
    }

    #[test]
    fn primaries_on_a_line_have_no_matrix() {
        let line = Primaries { green: [0.3, 0.3], red: [0.2, 0.2], blue: [0.1, 0.1], white: D65 };
        assert!(line.to_xyz().is_none() && line.matrix_to(&Primaries::AP0).is_none());
        let zero = Primaries { red: [0.0, 0.0], ..Primaries::REC709 };
        assert!(zero.to_xyz().is_none());
        assert!(inverse(&[[0.0; 3]; 3]).is_none() && inverse(&[[f64::NAN; 3]; 3]).is_none());
    }

    #[test]
    fn adaptations_map_white_to_white() {
        for kind in [Adaptation::Bradford, Adaptation::Cat02] {
            let mapped = apply(&adaptation(D65, ACES_WHITE, kind), xyz(D65));
            for (a, b) in mapped.iter().zip(xyz(ACES_WHITE)) {
                assert!((a - b).abs() < 1e-12);
            }
        }
    }
}
