//! Files of Sony Pictures Imageworks: `.spi1d`, `.spi3d` and `.spimtx`.

use super::cube::domain;
use super::lines::Lines;
use crate::error::ColorError;
use crate::table::{Interpolation, Lut1d, Lut3d, MAX_EDGE, MAX_ENTRIES};
use crate::transform::{Directed, Transform};
use std::path::Path;
use std::sync::Arc;

pub(super) fn read_1d(text: &str, path: &Path) -> Result<Vec<Directed>, ColorError> {
    let mut lines = Lines::new(text, path);
    let (mut range, mut length, mut components) = ([0.0, 1.0], None, None);
    loop {
        let line = lines.need("the table")?;
        if line.starts_with('{') {
            break;
        }
        let (word, rest) = line.split_once(char::is_whitespace).unwrap_or((line, ""));
        match word {
            "Version" if rest.trim() == "1" => {}
            "Version" => return Err(lines.malformed(format!("version {}, and only 1 is known", rest.trim()))),
            "From" => range = lines.numbers(rest)?,
            "Length" => {
                length = Some(lines.count(rest, "the entries of a table of one dimension", MAX_ENTRIES)?);
            }
            "Components" => {
                components = match rest.trim() {
                    "1" => Some(1),
                    "2" => Some(2),
                    "3" => Some(3),
                    other => {
                        return Err(lines.malformed(format!("{other} components, and 1 to 3 are possible")));
                    }
                };
            }
            _ => return Err(lines.malformed(format!("unknown keyword \"{word}\""))),
        }
    }
    let (Some(length), Some(components)) = (length, components) else {
        return Err(lines.malformed("Length and Components are needed before the table"));
    };
    let mut table = Vec::with_capacity(length);
    loop {
        let line = lines.need("the end of the table")?;
        if line.starts_with('}') {
            break;
        }
        if table.len() == length {
            return Err(lines.malformed(format!("more than the {length} rows of Length")));
        }
        table.push(match components {
            1 => [lines.numbers::<1>(line)?[0]; 3],
            2 => {
                let [a, b] = lines.numbers(line)?;
                [a, b, 0.0]
            }
            _ => lines.numbers(line)?,
        });
    }
    if table.len() != length {
        return Err(lines.malformed(format!("{} rows, and Length is {length}", table.len())));
    }
    let mut found: Vec<Directed> = domain(&lines, [range[0]; 3], [range[1]; 3])?.into_iter().collect();
    let lut = Lut1d { table, interpolation: Interpolation::Linear };
    found.push(Directed::forward(Transform::Lut1d(Arc::new(lut))));
    Ok(found)
}

pub(super) fn read_3d(text: &str, path: &Path) -> Result<Vec<Directed>, ColorError> {
    let mut lines = Lines::new(text, path);
    if !lines.need("its first line")?.starts_with("SPILUT") {
        return Err(lines.malformed("the first line is not \"SPILUT 1.0\""));
    }
    let channels: [f32; 2] = {
        let line = lines.need("its second line")?;
        lines.numbers(line)?
    };
    if channels != [3.0, 3.0] {
        return Err(lines.malformed("only tables from three to three channels are known"));
    }
    let line = lines.need("the size of the table")?;
    let mut edges = [0; 3];
    let words: Vec<&str> = line.split_whitespace().collect();
    let [r, g, b] = words[..] else { return Err(lines.malformed("three sizes are needed")) };
    for (edge, word) in edges.iter_mut().zip([r, g, b]) {
        *edge = lines.count(word, "the edge of a table of three dimensions", MAX_EDGE)?;
    }
    let edge = edges[0];
    if edges != [edge; 3] {
        return Err(lines.malformed("tables with different edges are not known"));
    }
    // The shortest row has twelve characters.
    if text.len() / 12 < edge.pow(3) {
        return Err(lines.malformed(format!("the file is too short for {} entries", edge.pow(3))));
    }
    let mut table = vec![[f32::NAN; 3]; edge.pow(3)];
    let mut filled = 0;
    while let Some(line) = lines.next() {
        let [i, j, k, r, g, b] = lines.numbers(line)?;
        let index = |v: f32| {
            let index = v as usize;
            (v >= 0.0 && v.fract() == 0.0 && index < edge).then_some(index)
        };
        let (Some(i), Some(j), Some(k)) = (index(i), index(j), index(k)) else {
            return Err(lines.malformed(format!("indices are from 0 to {}", edge - 1)));
        };
        let place = &mut table[(i * edge + j) * edge + k];
        if place[0].is_nan() {
            filled += 1;
        }
        *place = [r, g, b];
    }
    if filled != table.len() {
        return Err(lines.malformed(format!("{filled} entries, and the size names {}", table.len())));
    }
    let lut = Lut3d { edge, table, interpolation: Interpolation::Linear };
    Ok(vec![Directed::forward(Transform::Lut3d(Arc::new(lut)))])
}

pub(super) fn read_matrix(text: &str, path: &Path) -> Result<Vec<Directed>, ColorError> {
    let mut lines = Lines::new(text, path);
    let mut values = Vec::new();
    while let Some(line) = lines.next() {
        values.extend(lines.all_numbers(line)?);
        if values.len() > 12 {
            return Err(lines.malformed("more than 12 numbers"));
        }
    }
    if values.len() != 12 {
        return Err(lines.malformed(format!("{} numbers, and 12 are needed", values.len())));
    }
    let (mut matrix, mut offset) = ([0.0; 16], [0.0; 4]);
    matrix[15] = 1.0;
    for (row, four) in values.chunks_exact(4).enumerate() {
        for column in 0..3 {
            matrix[4 * row + column] = f64::from(four[column]);
        }
        // Offsets are those of 16-bit codes.
        offset[row] = f64::from(four[3]) / 65535.0;
    }
    Ok(vec![Directed::forward(Transform::Matrix(matrix, offset))])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_read() {
        let path = Path::new("a");
        let got = read_1d("Version 1\nFrom -1 3\nLength 2\nComponents 1\n{\n 0\n 1\n}\n", path).unwrap();
        assert!(matches!(got[0].transform, Transform::Matrix(m, o) if (m[0], o[0]) == (0.25, 0.25)));
        assert!(matches!(&got[1].transform, Transform::Lut1d(t) if t.table == [[0.0; 3], [1.0; 3]]));
        let mut text = "SPILUT 1.0\n3 3\n2 2 2\n".to_owned();
        for i in 0..8 {
            text.push_str(&format!("{0} {1} {2} {0} {1} {2}\n", i / 4, i / 2 % 2, i % 2));
        }
        let got = read_3d(&text, path).unwrap();
        let Transform::Lut3d(lut) = &got[0].transform else { panic!() };
        assert_eq!(lut.lookup([1.0, 0.5, 0.0], Interpolation::Linear), [1.0, 0.5, 0.0]);
        let got = read_matrix("1 0 0 65535\n0 2 0 0\n0 0 3 0\n", path).unwrap();
        assert!(
            matches!(got[0].transform, Transform::Matrix(m, o) if (m[5], m[10], o[0]) == (2.0, 3.0, 1.0))
        );
    }

    #[test]
    fn errors_name_the_line() {
        let path = Path::new("a");
        for (got, expected) in [
            (read_1d("Version 2\n", path), "a:1: version 2, and only 1 is known"),
            (read_1d("Version 1\n{\n", path), "a:2: Length and Components are needed before the table"),
            (read_1d("Length 2\nComponents 1\n{\n0\n}\n", path), "a:5: 1 rows, and Length is 2"),
            (
                read_1d("Length 2\nComponents 1\n{\n0\n", path),
                "a:4: the file ends before the end of the table",
            ),
            (
                read_3d("SPILUT 1.0\n3 3\n2 2 2\n0 0 0 0 0 0\n", path),
                "a:3: the file is too short for 8 entries",
            ),
            (
                read_3d(&format!("SPILUT 1.0\n3 3\n2 2 2\n{}", "0 0 0 0 0 0\n".repeat(8)), path),
                "a:11: 1 entries, and the size names 8",
            ),
            (
                read_3d(&format!("SPILUT 1.0\n3 3\n2 2 2\n{}", "0 0 9 0 0 0\n".repeat(8)), path),
                "a:4: indices are from 0 to 1",
            ),
            (read_3d("x\n", path), "a:1: the first line is not \"SPILUT 1.0\""),
            (read_matrix("1 2 3\n", path), "a:1: 3 numbers, and 12 are needed"),
        ] {
            assert_eq!(got.unwrap_err().to_string(), expected);
        }
    }
}
