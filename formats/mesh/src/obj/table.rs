//! The numbered items that the faces of an OBJ file refer to.

use crate::text::Words;

/// Marks a missing index.
pub(super) const NONE: u32 = u32::MAX;

/// A corner of a face, as indices into the tables; [`NONE`] where an index is not given.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Corner {
    pub(super) v: u32,
    pub(super) t: u32,
    pub(super) n: u32,
}

/// The vertices, texture coordinates and normals of the whole file.
#[derive(Debug, Default)]
pub(super) struct Table {
    pub(super) positions: Vec<[f32; 3]>,
    /// The colours of the vertices up to the last one that has a colour. Empty without colours.
    pub(super) colors: Vec<[f32; 3]>,
    pub(super) texcoords: Vec<[f32; 2]>,
    pub(super) normals: Vec<[f32; 3]>,
}

impl Table {
    /// True when vertex `v` exists and has a finite position.
    pub(super) fn has_position(&self, v: u32) -> bool {
        self.positions.get(v as usize).is_some_and(|p| p.iter().all(|x| x.is_finite()))
    }

    /// Returns the colour of a vertex, which is white where none is given.
    pub(super) fn color(&self, v: u32) -> [f32; 3] {
        self.colors.get(v as usize).copied().unwrap_or([1.0; 3])
    }

    /// Reads `v x y z`, with a weight (which only free-form geometry uses), a colour, or both. Returns false when
    /// numbers are missing or invalid. The vertex is numbered nevertheless.
    pub(super) fn vertex(&mut self, mut words: Words<'_>) -> bool {
        let mut all = [0.0; 7];
        let mut n = 0;
        while n < 7
            && let Some(x) = words.float()
        {
            all[n] = x;
            n += 1;
        }
        let good = n >= 3 && all[..3].iter().all(|x| x.is_finite());
        self.positions.push(if good { [all[0], all[1], all[2]] } else { [f32::NAN; 3] });
        let color = match n {
            6 => &all[3..6],
            7 => &all[4..7],
            _ => return good,
        };
        if color.iter().all(|x| x.is_finite()) {
            self.colors.resize(self.positions.len() - 1, [1.0; 3]);
            self.colors.push([color[0], color[1], color[2]]);
        }
        good
    }

    /// Reads `vt u [v [w]]`. Returns false when numbers are missing or invalid.
    pub(super) fn texcoord(&mut self, mut words: Words<'_>) -> bool {
        let u = words.float();
        let v = words.float().unwrap_or(0.0);
        self.texcoords.push([u.unwrap_or(0.0), v]);
        u.is_some_and(f32::is_finite) && v.is_finite()
    }

    /// Reads `vn x y z`. Returns false when numbers are missing or invalid.
    pub(super) fn normal(&mut self, mut words: Words<'_>) -> bool {
        let n = std::array::from_fn(|_| words.float().unwrap_or(f32::NAN));
        self.normals.push(n);
        n.iter().all(|x| x.is_finite())
    }

    /// Parses `v`, `v/t`, `v//n` or `v/t/n`.
    pub(super) fn corner(&self, word: &[u8]) -> Result<Corner, Wrong> {
        let (v, rest) = index(word)?;
        let v = resolve(v.ok_or(Wrong::Syntax)?, self.positions.len())?;
        let mut corner = Corner { v, t: NONE, n: NONE };
        let [b'/', rest @ ..] = rest else {
            return if rest.is_empty() { Ok(corner) } else { Err(Wrong::Syntax) };
        };
        let (t, rest) = index(rest)?;
        if let Some(t) = t {
            corner.t = resolve(t, self.texcoords.len())?;
        }
        let [b'/', rest @ ..] = rest else {
            return if rest.is_empty() { Ok(corner) } else { Err(Wrong::Syntax) };
        };
        let (n, rest) = index(rest)?;
        if let Some(n) = n {
            corner.n = resolve(n, self.normals.len())?;
        }
        if rest.is_empty() { Ok(corner) } else { Err(Wrong::Syntax) }
    }
}

/// The errors of a reference.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Wrong {
    /// The word is not a reference.
    Syntax,
    /// The number is beyond the ends of the table.
    Index(i64),
}

/// Returns the integer that the word begins with, if any, and the rest of the word.
fn index(word: &[u8]) -> Result<(Option<i64>, &[u8]), Wrong> {
    let (negative, digits) = match word {
        [b'-', rest @ ..] => (true, rest),
        [b'+', rest @ ..] => (false, rest),
        _ => (false, word),
    };
    let n = digits.iter().take_while(|c| c.is_ascii_digit()).count();
    if n == 0 {
        return if digits.len() == word.len() { Ok((None, word)) } else { Err(Wrong::Syntax) };
    }
    let value =
        digits[..n].iter().fold(0i64, |v, c| v.saturating_mul(10).saturating_add(i64::from(c - b'0')));
    Ok((Some(if negative { -value } else { value }), &digits[n..]))
}

/// Converts an index to a position in a table. Indices count from 1 on, or from -1 backwards. Positions beyond the
/// table may be defined later.
fn resolve(index: i64, count: usize) -> Result<u32, Wrong> {
    let position = if index > 0 { index - 1 } else { index.saturating_add(count as i64) };
    match u32::try_from(position) {
        Ok(p) if p != NONE && index != 0 => Ok(p),
        _ => Err(Wrong::Index(index)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn references() {
        let mut table = Table::default();
        for _ in 0..4 {
            assert!(table.vertex(Words(b"1 2 3")));
        }
        table.texcoord(Words(b"0.5 0.25"));
        table.normal(Words(b"0 0 1"));
        let c = |v, t, n| Ok(Corner { v, t, n });
        assert_eq!(table.corner(b"3"), c(2, NONE, NONE));
        assert_eq!(table.corner(b"-1"), c(3, NONE, NONE));
        assert_eq!(table.corner(b"2/1"), c(1, 0, NONE));
        assert_eq!(table.corner(b"2//-1"), c(1, NONE, 0));
        assert_eq!(table.corner(b"2/-1/1"), c(1, 0, 0));
        assert_eq!(table.corner(b"2/"), c(1, NONE, NONE));
        assert_eq!(table.corner(b"9"), c(8, NONE, NONE));
        for bad in ["", "/", "x", "1x", "1/x", "1/1/1/1", "-", "1/-"] {
            assert_eq!(table.corner(bad.as_bytes()), Err(Wrong::Syntax), "{bad}");
        }
        for (bad, index) in [("0", 0), ("-5", -5), ("4294967296", 1 << 32), ("1/0", 0), ("1//-2", -2)] {
            assert_eq!(table.corner(bad.as_bytes()), Err(Wrong::Index(index)), "{bad}");
        }
        assert!(matches!(table.corner(b"99999999999999999999"), Err(Wrong::Index(_))));
    }

    #[test]
    fn vertices_with_weight_and_colour() {
        let mut table = Table::default();
        assert!(table.vertex(Words(b"1 2 3 0.5")));
        assert!(table.colors.is_empty());
        assert!(table.vertex(Words(b"1 2 3 0.1 0.2 0.3")));
        assert!(table.vertex(Words(b"1 2 3 1 0.4 0.5 0.6")));
        assert!(table.vertex(Words(b"1 2 3")));
        assert!(!table.vertex(Words(b"1 2")));
        assert!(!table.vertex(Words(b"1 2 nan")));
        assert_eq!((table.positions.len(), table.has_position(3), table.has_position(4)), (6, true, false));
        assert_eq!(table.colors, [[1.0; 3], [0.1, 0.2, 0.3], [0.4, 0.5, 0.6]]);
        assert_eq!(table.color(5), [1.0; 3]);
    }
}
