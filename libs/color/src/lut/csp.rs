//! Files `.csp` of cineSpace: a curve for each channel, then a table of one or of three dimensions.

use super::cube::red_first;
use super::lines::Lines;
use crate::error::ColorError;
use crate::table::{Interpolation, Lut1d, MAX_EDGE, MAX_ENTRIES};
use crate::transform::{Directed, Transform};
use std::path::Path;
use std::sync::Arc;

/// The number of entries of the table that replaces curves of more than two points.
const CURVE: usize = 65_536;

pub(super) fn read(text: &str, path: &Path) -> Result<Vec<Directed>, ColorError> {
    let mut lines = Lines::new(text, path);
    if !lines.need("its first line")?.starts_with("CSPLUTV100") {
        return Err(lines.malformed("the first line is not \"CSPLUTV100\""));
    }
    let kind = lines.need("the kind of the table")?;
    let three = match kind {
        "3D" => true,
        "1D" => false,
        _ => return Err(lines.malformed(format!("\"{kind}\" is neither 1D nor 3D"))),
    };
    let mut line = lines.need("the table")?;
    if line.starts_with("BEGIN METADATA") {
        while !line.starts_with("END METADATA") {
            line = lines.need("the end of the metadata")?;
        }
        line = lines.need("the table")?;
    }
    let mut curves: Vec<(Vec<f32>, Vec<f32>)> = Vec::new();
    for c in 0..3 {
        if c > 0 {
            line = lines.need("a curve")?;
        }
        let n = lines.count(line, "the points of a curve", 4096)?;
        let mut sides = [Vec::new(), Vec::new()];
        for side in &mut sides {
            let line = lines.need("a curve")?;
            *side = lines.all_numbers(line)?;
            if side.len() != n {
                return Err(lines.malformed(format!("{} points, and {n} are needed", side.len())));
            }
        }
        let [x, y] = sides;
        if x.windows(2).any(|pair| pair[1] <= pair[0]) {
            return Err(lines.malformed("the points of a curve do not ascend"));
        }
        curves.push((x, y));
    }
    let mut found = shaper(&curves);
    if three {
        let line = lines.need("the size of the table")?;
        let words: Vec<&str> = line.split_whitespace().collect();
        let edge =
            lines.count(words.first().unwrap_or(&""), "the edge of a table of three dimensions", MAX_EDGE)?;
        if words.len() != 3 || words.iter().any(|word| *word != words[0]) {
            return Err(lines.malformed("three equal sizes are needed"));
        }
        let rows = rows(&mut lines, edge.pow(3))?;
        found.push(Directed::forward(Transform::Lut3d(Arc::new(red_first(edge, &rows)))));
    } else {
        let line = lines.need("the size of the table")?;
        let n = lines.count(line, "the entries of a table of one dimension", MAX_ENTRIES)?;
        let lut = Lut1d { table: rows(&mut lines, n)?, interpolation: Interpolation::Linear };
        found.push(Directed::forward(Transform::Lut1d(Arc::new(lut))));
    }
    Ok(found)
}

fn rows(lines: &mut Lines<'_>, n: usize) -> Result<Vec<[f32; 3]>, ColorError> {
    let mut rows = Vec::new();
    for _ in 0..n {
        let line = lines.need("the last row of the table")?;
        rows.push(lines.numbers(line)?);
    }
    Ok(rows)
}

/// Returns the transforms of the curves. Between points they are lines, and values beyond the ends are clamped.
fn shaper(curves: &[(Vec<f32>, Vec<f32>)]) -> Vec<Directed> {
    let is_same = |(x, y): &(Vec<f32>, Vec<f32>)| x.len() == 2 && *x == [0.0, 1.0] && *y == [0.0, 1.0];
    if curves.iter().all(is_same) {
        return Vec::new();
    }
    let (mut matrix, mut offset) = ([0.0; 16], [0.0; 4]);
    matrix[15] = 1.0;
    for (c, (x, _)) in curves.iter().enumerate() {
        let (low, high) = (f64::from(x[0]), f64::from(x[x.len() - 1]));
        matrix[5 * c] = 1.0 / (high - low);
        offset[c] = -low / (high - low);
    }
    let entries = if curves.iter().all(|(x, _)| x.len() == 2) { 2 } else { CURVE };
    let mut table = vec![[0.0; 3]; entries];
    for (c, (x, y)) in curves.iter().enumerate() {
        let (low, high) = (f64::from(x[0]), f64::from(x[x.len() - 1]));
        let mut segment = 0;
        for (i, row) in table.iter_mut().enumerate() {
            let at = low + (high - low) * i as f64 / (entries - 1) as f64;
            while segment + 2 < x.len() && at > f64::from(x[segment + 1]) {
                segment += 1;
            }
            let (a, b) = (f64::from(x[segment]), f64::from(x[segment + 1]));
            let (p, q) = (f64::from(y[segment]), f64::from(y[segment + 1]));
            row[c] = (p + (q - p) * ((at - a) / (b - a)).clamp(0.0, 1.0)) as f32;
        }
    }
    let lut = Lut1d { table, interpolation: Interpolation::Linear };
    vec![
        Directed::forward(Transform::Matrix(matrix, offset)),
        Directed::forward(Transform::Lut1d(Arc::new(lut))),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    const ONE: &str = "CSPLUTV100\n1D\n\nBEGIN METADATA\nx\nEND METADATA\n\n2\n0 2\n0 1\n2\n0 2\n0 1\n2\n0 2\n0 1\n\n2\n0 0 0\n1 2 3\n";

    #[test]
    fn tables_are_read() {
        let got = read(ONE, Path::new("a.csp")).unwrap();
        assert_eq!(got.len(), 3);
        assert!(matches!(got[0].transform, Transform::Matrix(m, _) if m[0] == 0.5));
        assert!(matches!(&got[2].transform, Transform::Lut1d(t) if t.table[1] == [1.0, 2.0, 3.0]));
        let three = ONE.replace("1D", "3D").replace("2\n0 0 0\n1 2 3\n", "2 2 2\n") + &"0 0 1\n".repeat(8);
        assert!(
            matches!(&read(&three, Path::new("a")).unwrap()[2].transform, Transform::Lut3d(t) if t.edge == 2)
        );
        let same = ONE.replace("0 2\n", "0 1\n");
        assert_eq!(read(&same, Path::new("a")).unwrap().len(), 1);
    }

    #[test]
    fn errors_name_the_line() {
        for (text, expected) in [
            ("x", "a:1: the first line is not \"CSPLUTV100\"".to_owned()),
            ("CSPLUTV100\n2D", "a:2: \"2D\" is neither 1D nor 3D".to_owned()),
            (
                &ONE.replace("0 2\n0 1\n2", "2 0\n0 1\n2"),
                "a:10: the points of a curve do not ascend".to_owned(),
            ),
            (&ONE.replace("1 2 3\n", ""), "a:19: the file ends before the last row of the table".to_owned()),
        ] {
            assert_eq!(read(text, Path::new("a")).unwrap_err().to_string(), expected);
        }
    }
}
