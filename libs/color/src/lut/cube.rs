//! Files `.cube`: those of Iridas (Cube LUT Specification 1.0, Adobe, 2013) and those of Resolve, which may hold a
//! table of one dimension before one of three.

use super::lines::Lines;
use crate::error::ColorError;
use crate::table::{Interpolation, Lut1d, Lut3d, MAX_EDGE, MAX_ENTRIES};
use crate::transform::{Directed, Transform};
use std::path::Path;
use std::sync::Arc;

pub(super) fn read(text: &str, path: &Path) -> Result<Vec<Directed>, ColorError> {
    let mut lines = Lines::new(text, path);
    let (mut size_1d, mut size_3d) = (None, None);
    let (mut low, mut high) = ([0.0_f32; 3], [1.0_f32; 3]);
    let (mut range_1d, mut range_3d) = (None, None);
    let mut rows: Vec<[f32; 3]> = Vec::new();
    while let Some(line) = lines.next() {
        let (word, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        match &*word.to_ascii_uppercase() {
            "TITLE" => {}
            "LUT_1D_SIZE" => {
                size_1d = Some(lines.count(rest, "the entries of a table of one dimension", MAX_ENTRIES)?);
            }
            "LUT_3D_SIZE" => {
                size_3d = Some(lines.count(rest, "the edge of a table of three dimensions", MAX_EDGE)?);
            }
            "DOMAIN_MIN" => low = lines.numbers(rest)?,
            "DOMAIN_MAX" => high = lines.numbers(rest)?,
            "LUT_1D_INPUT_RANGE" => range_1d = Some(lines.numbers::<2>(rest)?),
            "LUT_3D_INPUT_RANGE" => range_3d = Some(lines.numbers::<2>(rest)?),
            _ if word.starts_with(|c: char| c.is_ascii_digit() || "+-.".contains(c)) => {
                let needed = size_1d.unwrap_or(0) + size_3d.map_or(0, |n: usize| n.pow(3));
                if rows.len() == needed {
                    return Err(lines.malformed(format!("more than the {needed} rows that the sizes name")));
                }
                rows.push(lines.numbers(line)?);
            }
            _ => return Err(lines.malformed(format!("unknown keyword \"{word}\""))),
        }
    }
    let needed = size_1d.unwrap_or(0) + size_3d.map_or(0, |n| n.pow(3));
    if needed == 0 {
        return Err(lines.malformed("neither LUT_1D_SIZE nor LUT_3D_SIZE is given"));
    }
    if rows.len() < needed {
        return Err(lines.malformed(format!("{} rows, and the sizes name {needed}", rows.len())));
    }
    let mut found = Vec::new();
    if let Some(n) = size_1d {
        let (low, high) = range_1d.map_or((low, high), |[a, b]| ([a; 3], [b; 3]));
        found.extend(domain(&lines, low, high)?);
        let table: Vec<_> = rows.drain(..n).collect();
        let lut = Lut1d { table, interpolation: Interpolation::Linear };
        found.push(Directed::forward(Transform::Lut1d(Arc::new(lut))));
    }
    if let Some(edge) = size_3d {
        let both = size_1d.is_some() && range_3d.is_none();
        let (low, high) = match range_3d {
            Some([a, b]) => ([a; 3], [b; 3]),
            None if both => ([0.0; 3], [1.0; 3]),
            None => (low, high),
        };
        found.extend(domain(&lines, low, high)?);
        found.push(Directed::forward(Transform::Lut3d(Arc::new(red_first(edge, &rows)))));
    }
    Ok(found)
}

/// Returns the table of rows whose red varies fastest.
pub(super) fn red_first(edge: usize, rows: &[[f32; 3]]) -> Lut3d {
    let n = edge;
    let table = (0..n * n * n).map(|i| rows[(i % n * n + i / n % n) * n + i / (n * n)]).collect();
    Lut3d { edge, table, interpolation: Interpolation::Linear }
}

/// Returns the transform that maps a domain to [0, 1].
pub(super) fn domain(
    lines: &Lines<'_>,
    low: [f32; 3],
    high: [f32; 3],
) -> Result<Option<Directed>, ColorError> {
    if low == [0.0; 3] && high == [1.0; 3] {
        return Ok(None);
    }
    let (mut matrix, mut offset) = ([0.0; 16], [0.0; 4]);
    matrix[15] = 1.0;
    for c in 0..3 {
        let (low, high) = (f64::from(low[c]), f64::from(high[c]));
        if high <= low {
            return Err(lines.malformed(format!("the domain from {low} to {high} is empty")));
        }
        matrix[5 * c] = 1.0 / (high - low);
        offset[c] = -low / (high - low);
    }
    Ok(Some(Directed::forward(Transform::Matrix(matrix, offset))))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(text: &str) -> Result<Vec<Directed>, String> {
        read(text, Path::new("a.cube")).map_err(|e| e.to_string())
    }

    #[test]
    fn tables_of_both_kinds_are_read() {
        let got =
            of("TITLE \"x\"\n# c\nLUT_1D_SIZE 2\nDOMAIN_MIN 0 0 0\nDOMAIN_MAX 2 2 2\n0 0 0\n1 .5 1e0\n")
                .unwrap();
        assert!(matches!(got[0].transform, Transform::Matrix(m, _) if m[0] == 0.5));
        assert!(matches!(&got[1].transform, Transform::Lut1d(t) if t.table[1] == [1.0, 0.5, 1.0]));
        let mut text = "LUT_3D_SIZE 2\n".to_owned();
        for i in 0..8 {
            text.push_str(&format!("{} {} {}\n", i % 2, i / 2 % 2, i / 4));
        }
        let got = of(&text).unwrap();
        let Transform::Lut3d(lut) = &got[0].transform else { panic!() };
        assert_eq!(lut.lookup([1.0, 0.0, 0.0], Interpolation::Linear), [1.0, 0.0, 0.0]);
        assert_eq!(lut.lookup([0.0, 0.25, 1.0], Interpolation::Tetrahedral), [0.0, 0.25, 1.0]);
        let both = of(&format!(
            "LUT_1D_SIZE 2\nLUT_1D_INPUT_RANGE 0 4\n{}",
            text.replace("2\n0 0", "2\n0 0 0\n1 1 1\n0 0")
        ));
        assert_eq!(both.unwrap().len(), 3);
    }

    #[test]
    fn errors_name_the_line() {
        for (text, expected) in [
            ("", "a.cube:0: neither LUT_1D_SIZE nor LUT_3D_SIZE is given"),
            ("LUT_1D_SIZE 2\n0 0 0\n", "a.cube:2: 1 rows, and the sizes name 2"),
            ("LUT_1D_SIZE 2\n0 0\n", "a.cube:2: 3 numbers are needed"),
            (
                "LUT_1D_SIZE 1\n",
                "a.cube:1: the entries of a table of one dimension: 1, and at least 2 are needed",
            ),
            (
                "LUT_3D_SIZE 1000\n",
                "a.cube:1: the edge of a table of three dimensions: 1000, and the limit is 256",
            ),
            ("LUT_1D_SIZE 2\n0 0 x\n", "a.cube:2: \"x\" is not a number"),
            ("LUT_1D_SIZE 2\n0 0 nan\n", "a.cube:2: \"nan\" is not a number"),
            ("LUT_2D_SIZE 2\n", "a.cube:1: unknown keyword \"LUT_2D_SIZE\""),
            ("0 0 0\n", "a.cube:1: more than the 0 rows that the sizes name"),
            ("LUT_1D_SIZE 2\nDOMAIN_MAX 0 0 0\n0 0 0\n1 1 1\n", "a.cube:4: the domain from 0 to 0 is empty"),
        ] {
            assert_eq!(of(text).unwrap_err(), expected, "{text}");
        }
    }
}
