//! Files `.3dl` of Autodesk's Flame and Lustre: a curve of integers, then a table of three dimensions of integers,
//! whose blue varies fastest.

use super::lines::Lines;
use crate::error::ColorError;
use crate::table::{Interpolation, Lut1d, Lut3d, MAX_EDGE};
use crate::transform::{Directed, Transform};
use std::path::Path;
use std::sync::Arc;

pub(super) fn read(text: &str, path: &Path) -> Result<Vec<Directed>, ColorError> {
    let mut lines = Lines::new(text, path);
    let mut curve = Vec::new();
    let mut rows: Vec<[f32; 3]> = Vec::new();
    while let Some(line) = lines.next() {
        if line.starts_with("3DMESH") || !line.starts_with(|c: char| c.is_ascii_digit() || c == '-') {
            continue;
        }
        let values = lines.all_numbers(line)?;
        if values.iter().any(|v| v.fract() != 0.0 || *v < 0.0) {
            return Err(lines.malformed("entries are integers that are not negative"));
        }
        if values.len() > 3 && curve.is_empty() && rows.is_empty() {
            curve = values;
        } else if let [r, g, b] = values[..]
            && rows.len() < MAX_EDGE.pow(3)
        {
            rows.push([r, g, b]);
        } else {
            return Err(lines.malformed(format!("{} numbers, and 3 are needed", values.len())));
        }
    }
    let edge = (2..=MAX_EDGE).find(|n| n.pow(3) == rows.len());
    let Some(edge) = edge else {
        return Err(lines.malformed(format!("{} rows, which is not the cube of a number", rows.len())));
    };
    let mut found = Vec::new();
    if !curve.is_empty() {
        let last = full_scale(curve.iter().copied());
        let n = curve.len() - 1;
        // A curve within a code value or two of the identity is one.
        let is_same = curve.iter().enumerate().all(|(i, v)| (v - i as f32 / n as f32 * last).abs() < 2.0);
        if !is_same {
            let table = curve.iter().map(|v| [v / last; 3]).collect();
            let lut = Lut1d { table, interpolation: Interpolation::Linear };
            found.push(Directed::forward(Transform::Lut1d(Arc::new(lut))));
        }
    }
    let last = full_scale(rows.iter().flatten().copied());
    let table = rows.into_iter().map(|row| row.map(|v| v / last)).collect();
    let lut = Lut3d { edge, table, interpolation: Interpolation::Linear };
    found.push(Directed::forward(Transform::Lut3d(Arc::new(lut))));
    Ok(found)
}

/// Returns the integer that means 1. Files do not name it. It is that of the least number of bits, 8, 10, 12, 14 or 16,
/// whose double is not exceeded, because some programs exceed the scale.
fn full_scale(values: impl Iterator<Item = f32>) -> f32 {
    let largest = values.fold(0.0, f32::max);
    let bits = (8..16).step_by(2).find(|bits| largest <= ((1 << (bits + 1)) - 1) as f32).unwrap_or(16);
    ((1_u32 << bits) - 1) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_are_read() {
        let mut text = "3DMESH\nMesh 1 12\n0 512 4095\n".replace("0 512 4095", "0 256 600 1023");
        for i in 0..8 {
            text.push_str(&format!("{} {} {}\n", i / 4 * 4095, i / 2 % 2 * 4095, i % 2 * 4095));
        }
        let got = read(&text, Path::new("a")).unwrap();
        assert_eq!(got.len(), 2);
        let Transform::Lut3d(lut) = &got[1].transform else { panic!() };
        let white = lut.lookup([0.0, 0.0, 1.0], Interpolation::Linear);
        assert!(white[0] == 0.0 && white[2] > 0.9, "{white:?}");
    }

    #[test]
    fn errors_name_the_line() {
        for (text, expected) in [
            ("", "a:0: 0 rows, which is not the cube of a number"),
            ("0 0 0\n1 1\n", "a:2: 2 numbers, and 3 are needed"),
            ("0 0 0.5\n", "a:1: entries are integers that are not negative"),
        ] {
            assert_eq!(read(text, Path::new("a")).unwrap_err().to_string(), expected);
        }
    }
}
