//! The textures of a set, one for each unit square ([`UdimName`](crate::UdimName)).

use crate::udim::Square;
use parking_lot::Mutex;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::OnceLock;

/// Points that are less than this beyond the edge of a set belong to it, because coordinates are rounded. It is less
/// than half a texel of 4096.
const EDGE: f32 = 1e-4;

/// The textures of a set.
#[derive(Debug)]
pub(crate) struct Squares {
    /// The name of the set, for messages.
    name: String,
    members: BTreeMap<Square, Member>,
    /// The columns and rows that lookups needed and that have no texture.
    missing: Mutex<BTreeSet<(i64, i64)>>,
}

/// One texture of a set.
#[derive(Debug)]
struct Member {
    name: String,
    /// The index of the file, which is found when it is first needed; `None` when it cannot be used.
    index: OnceLock<Option<u32>>,
}

/// A place in a set: a column and a row, and coordinates in that square.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Place {
    column: i64,
    row: i64,
    pub(crate) s: f32,
    pub(crate) t: f32,
}

impl Place {
    /// Returns the same point as seen from the square that is `columns` to the right and `down` below.
    pub(crate) fn from(self, columns: i64, down: i64) -> Self {
        Self {
            column: self.column + columns,
            row: self.row - down,
            s: self.s - columns as f32,
            t: self.t - down as f32,
        }
    }
}

impl Squares {
    /// Makes a set of the names of its files, of which the first is the file with the index `first`.
    pub(crate) fn new(name: &str, names: BTreeMap<Square, String>, first: u32) -> Self {
        let mut indices = std::iter::once(OnceLock::from(Some(first)));
        let mut member = |name| Member { name, index: indices.next().unwrap_or_default() };
        Self {
            name: name.to_owned(),
            members: names.into_iter().map(|(square, name)| (square, member(name))).collect(),
            missing: Mutex::default(),
        }
    }

    /// Returns the squares that have a texture, in order.
    pub(crate) fn squares(&self) -> impl Iterator<Item = Square> {
        self.members.keys().copied()
    }

    /// Returns the names of the textures, in the order of their squares.
    pub(crate) fn names(&self) -> impl Iterator<Item = &str> {
        self.members.values().map(|member| &*member.name)
    }

    fn member(&self, place: Place) -> Option<&Member> {
        let square = Square { row: place.row.try_into().ok()?, column: place.column.try_into().ok()? };
        self.members.get(&square)
    }

    /// Returns the index of the file of a place, which `find` finds by its name when it is first needed; `None` when
    /// there is none or when it cannot be used.
    pub(crate) fn index(&self, place: Place, find: impl FnOnce(&str) -> Option<u32>) -> Option<u32> {
        let member = self.member(place)?;
        *member.index.get_or_init(|| find(&member.name))
    }

    /// Returns the square of a point. Within [`EDGE`] of an edge it is a square that has a texture, if there is one.
    pub(crate) fn home(&self, s: f32, t: f32) -> Option<Place> {
        if !s.is_finite() || !t.is_finite() {
            return None;
        }
        let (column, down) = (s.floor(), t.floor());
        let whole = |x: f32| x.clamp(-1e9, 1e9) as i64;
        let at = Place { column: whole(column), row: -whole(down), s: s - column, t: t - down };
        let [beside, above] = [at.s, at.t].map(|x| match x {
            _ if x <= EDGE => &[0, -1][..],
            _ if x >= 1.0 - EDGE => &[0, 1],
            _ => &[0],
        });
        let near = above.iter().flat_map(|down| beside.iter().map(|columns| at.from(*columns, *down)));
        near.into_iter().find(|place| self.member(*place).is_some()).or(Some(at))
    }

    /// Returns the message about a place without a texture, the first time that it is needed.
    pub(crate) fn complaint(&self, place: Place) -> Option<String> {
        let (column, row) = (place.column, place.row);
        if self.member(place).is_some() || !self.missing.lock().insert((column, row)) {
            return None;
        }
        Some(format!(
            "texture \"{}\" has no file for column {column}, row {row} (s from {column} to {}, t from {} to {}): it is black there",
            self.name,
            column + 1,
            -row,
            1 - row
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn squares(places: &[(u32, u32)]) -> Squares {
        let names = places.iter().map(|&(column, row)| (Square { row, column }, String::new())).collect();
        Squares::new("set", names, 0)
    }

    #[test]
    fn points_belong_to_squares_with_rows_upward() {
        let set = squares(&[(0, 0), (1, 0), (1, 2)]);
        let at = |s, t| set.home(s, t).map(|place| (place.column, place.row, place.s, place.t));
        assert_eq!(at(0.25, 0.75), Some((0, 0, 0.25, 0.75)));
        assert_eq!(at(1.25, 0.75), Some((1, 0, 0.25, 0.75)));
        assert_eq!(at(1.25, -1.25), Some((1, 2, 0.25, 0.75)));
        // The edges of the set belong to it.
        assert_eq!(at(2.0, 1.0), Some((1, 0, 1.0, 1.0)));
        assert_eq!(at(1.0, 0.0), Some((1, 0, 0.0, 0.0)));
        assert_eq!(at(2.0, -1.0), Some((1, 2, 1.0, 1.0)));
        assert_eq!(at(-1e-9, 0.5), Some((0, 0, 0.0, 0.5)), "rounded");
        let beyond = at(2.00005, 1.00005).unwrap();
        assert!(beyond.0 == 1 && beyond.1 == 0 && beyond.2 > 1.0 && beyond.3 > 1.0, "{beyond:?}");
        assert_eq!(at(2.001, 0.5).map(|place| place.0), Some(2));
        assert_eq!(at(0.5, -0.5), Some((0, 1, 0.5, 0.5)), "without a texture");
        assert_eq!(at(f32::NAN, 0.0), None);
        assert_eq!(at(0.0, f32::INFINITY), None);
        assert!(at(1e30, -1e30).is_some());
    }
}
