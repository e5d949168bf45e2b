//! Helpers of the tests of surfaces.
#![allow(dead_code, reason = "each test binary takes what it needs")]

use granita_base::{Param, Params, ShapeDesc, TrimDesc, Vec3};
use granita_geom::{Dice, GeomError, Piece, ShapeKey, SplitDirection, Trimming};

/// Returns parameters from declarations and floats.
pub(crate) fn params(list: &[(&str, &[f32])]) -> Params {
    list.iter().map(|(name, data)| Param::declared(name, *data).expect("a declaration")).collect()
}

/// Builds a shape and collects the messages.
pub(crate) fn try_build(
    shape: &ShapeDesc,
    keys: &[&Params],
    trim: Option<&TrimDesc>,
) -> (Result<Vec<Piece>, GeomError>, Vec<String>) {
    let mut said = Vec::new();
    let keys: Vec<ShapeKey<'_>> =
        keys.iter().enumerate().map(|(i, p)| ShapeKey { time: i as f32, params: p }).collect();
    let pieces = granita_geom::build(shape, &keys, trim.map(Trimming::new), &mut |_, text| said.push(text));
    (pieces, said)
}

/// Builds a shape and expects no messages.
pub(crate) fn build(shape: &ShapeDesc, params: &Params) -> Vec<Piece> {
    let (pieces, said) = try_build(shape, &[params], None);
    assert!(said.is_empty(), "{said:?}");
    pieces.expect("a good primitive")
}

/// Splits everything that must be split.
pub(crate) fn diceable(pieces: Vec<Piece>) -> Vec<Piece> {
    let mut done = Vec::new();
    for piece in pieces {
        if piece.must_split() {
            done.extend(diceable(piece.split(SplitDirection::U)));
        } else {
            done.push(piece);
        }
    }
    done
}

/// Checks that a bound contains all positions of a lattice at each key.
pub(crate) fn check_bounds(piece: &Piece, dice: &Dice) {
    for (key, p) in dice.p.iter().enumerate() {
        let b = piece.bound(key);
        for p in p {
            assert!(p.cmpge(b.min).all() && p.cmple(b.max).all(), "{p} not in {b:?}");
        }
    }
}

/// Returns the four borders of a lattice: v = 0, v = 1, u = 0, u = 1.
pub(crate) fn borders(dice: &Dice) -> [Vec<Vec3>; 4] {
    let at = |i: usize, j: usize| dice.p[0][j * dice.nu + i];
    [
        (0..dice.nu).map(|i| at(i, 0)).collect(),
        (0..dice.nu).map(|i| at(i, dice.nv - 1)).collect(),
        (0..dice.nv).map(|j| at(0, j)).collect(),
        (0..dice.nv).map(|j| at(dice.nu - 1, j)).collect(),
    ]
}

/// Returns bit patterns, so that 0 and -0 differ and NaN equals itself.
pub(crate) fn bits(points: &[Vec3]) -> Vec<[u32; 3]> {
    points.iter().map(|p| p.to_array().map(f32::to_bits)).collect()
}

/// Returns the number of pairs of borders that have the same two ends, and the number of these that agree at all
/// points, in one direction or the other.
pub(crate) fn shared_borders(pieces: &[Piece], n: usize) -> (usize, usize) {
    let all: Vec<Vec<[u32; 3]>> =
        pieces.iter().flat_map(|p| borders(&p.dice(n, n)).map(|b| bits(&b))).collect();
    let (mut pairs, mut agree) = (0, 0);
    for (i, a) in all.iter().enumerate() {
        for b in &all[i + 1..] {
            let mut c = b.clone();
            if a[0] == a[n - 1] {
                continue;
            }
            if a[0] != c[0] {
                c.reverse();
            }
            if a[0] == c[0] && a[n - 1] == c[n - 1] {
                pairs += 1;
                agree += usize::from(*a == c);
            }
        }
    }
    (pairs, agree)
}
