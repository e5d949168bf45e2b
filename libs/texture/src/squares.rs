//! Lookups in a set of textures, one for each unit square ([`UdimName`](crate::UdimName)).
//!
//! A footprint that leaves its square is continued in the neighbours. Each texture is looked up as if black surrounded
//! it, and the results are added. Since the weights of a footprint sum to 1, so do those of the parts. Where a set has
//! no neighbour, the texels of the border continue.

use crate::file::TextureFile;
use crate::lookup::Lookup;
use crate::plain::{by_channels, reach, texture};
use crate::reader::TextureReader;
use crate::shared::Shared;
use crate::udim::Square;
use crate::wrap::Wrap;
use parking_lot::Mutex;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::OnceLock;

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
struct Place {
    column: i64,
    row: i64,
    s: f32,
    t: f32,
}

impl Place {
    /// Returns the same point as seen from the square that is `columns` to the right and `down` below.
    fn from(self, columns: i64, down: i64) -> Self {
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

    fn member(&self, place: Place) -> Option<&Member> {
        let square = Square { row: place.row.try_into().ok()?, column: place.column.try_into().ok()? };
        self.members.get(&square)
    }

    /// Returns the file of a square; `None` when there is none or when it cannot be used.
    fn file<'a>(&self, place: Place, shared: &'a Shared) -> Option<&'a TextureFile> {
        let member = self.member(place)?;
        let index = member.index.get_or_init(|| shared.find(&member.name));
        shared.files.get((*index)?)
    }

    /// Returns the square of a point. On the edge of two squares it is one that has a texture, if there is one.
    fn home(&self, s: f32, t: f32) -> Option<Place> {
        if !s.is_finite() || !t.is_finite() {
            return None;
        }
        let (column, down) = (s.floor(), t.floor());
        let whole = |x: f32| x.clamp(-1e9, 1e9) as i64;
        let at = Place { column: whole(column), row: -whole(down), s: s - column, t: t - down };
        let beside = if s == column { &[0, -1][..] } else { &[0] };
        let above = if t == down { &[0, -1][..] } else { &[0] };
        let near = above.iter().flat_map(|down| beside.iter().map(|columns| at.from(*columns, *down)));
        near.into_iter().find(|place| self.member(*place).is_some()).or(Some(at))
    }

    /// Reports, once for each square, that a lookup needed a texture that does not exist.
    fn warn(&self, place: Place, shared: &Shared) {
        let (column, row) = (place.column, place.row);
        if self.missing.lock().insert((column, row)) {
            let what = format!(
                "texture \"{}\" has no file for column {column}, row {row} (s from {column} to {}, t from {} to {}): it is black there",
                self.name,
                column + 1,
                -row,
                1 - row
            );
            shared.warn(what);
        }
    }
}

/// Returns -1 or 1 when a footprint that reaches this far leaves its square on this side, and 0 when it does not leave it or
/// when it leaves it on both sides.
fn side(x: f32, reach: f32) -> i64 {
    match (x < reach, x > 1.0 - reach) {
        (true, false) => -1,
        (false, true) => 1,
        _ => 0,
    }
}

/// Looks up a point in a set. `first` is the file of the first square.
pub(crate) fn texture_of_set(
    reader: &mut TextureReader<'_>,
    first: &TextureFile,
    squares: &Squares,
    q: &Lookup,
    out: &mut [f32],
) {
    let shared = reader.shared();
    let home = squares.home(q.s, q.t);
    let Some((home, file)) = home.and_then(|home| Some((home, squares.file(home, shared)?))) else {
        if let Some(home) = home.filter(|home| squares.member(*home).is_none()) {
            squares.warn(home, shared);
        }
        return by_channels(first, q.first_channel, q.fill, out, |_, _| [0.0; 4]);
    };
    let (across, down) = reach(file, q);
    let (across, down) = (side(home.s, across), side(home.t, down));
    let neighbour = |columns, rows| {
        let place = home.from(columns, rows);
        squares.file(place, shared).map(|file| (place, file))
    };
    let beside = |down: i64| (across != 0).then(|| neighbour(across, down)).flatten();
    let next = (down != 0).then(|| neighbour(0, down)).flatten();
    let twrap = if next.is_some() { Wrap::Black } else { Wrap::Clamp };
    let mut is_first = true;
    for (place, file, down) in
        [Some((home, file, 0)), next.map(|(place, file)| (place, file, down))].into_iter().flatten()
    {
        let beside = beside(down);
        let swrap = if beside.is_some() { Wrap::Black } else { Wrap::Clamp };
        for (place, file) in [Some((place, file)), beside].into_iter().flatten() {
            let here = Lookup { s: place.s, t: place.t, swrap: Some(swrap), twrap: Some(twrap), ..*q };
            if std::mem::take(&mut is_first) {
                texture(reader, file, &here, out);
            } else {
                add(reader, file, &here, out);
            }
        }
    }
}

/// Looks up a point and adds its value. Channels that the file does not have stay as they are.
fn add(reader: &mut TextureReader<'_>, file: &TextureFile, q: &Lookup, out: &mut [f32]) {
    let mut first_channel = q.first_channel;
    for run in out.chunks_mut(4) {
        let mut part = [0.0; 4];
        texture(reader, file, &Lookup { first_channel, fill: 0.0, ..*q }, &mut part[..run.len()]);
        run.iter_mut().zip(part).for_each(|(sum, part)| *sum += part);
        first_channel = first_channel.saturating_add(4);
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
        assert_eq!(at(0.5, -0.5), Some((0, 1, 0.5, 0.5)), "without a texture");
        assert_eq!(at(f32::NAN, 0.0), None);
        assert_eq!(at(0.0, f32::INFINITY), None);
        assert!(at(1e30, -1e30).is_some());
    }
}
