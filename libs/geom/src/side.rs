//! The sides of pieces, which neighbours share.
//!
//! Neighbours that dice their common edge at different points leave cracks. The points on a side are therefore a
//! function of the edge alone. The dicing rate of an edge is measured on the edge itself ([`SidePart`]), which is
//! halved where it is long, and each of its parts gets equal steps. A side that need not be halved is *settled* when
//! its piece is split. The parts of the piece keep the steps of the whole side, and have their corners at these
//! steps. The border of a lattice is then moved along the side to these points. Where the lattice is finer, several
//! of its points are moved to the same one ([`Lattice`]).
//!
//! Sides are numbered: 0 at the start of v and 1 at its end (both run along u), 2 at the start of u and 3 at its end.

use crate::range::{Place, Range};

/// A side of a piece, or a part of a side, to be measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SidePart {
    pub(crate) side: usize,
    pub(crate) range: Range,
    /// The side is halved while it has more segments than this.
    pub(crate) most: u32,
}

impl SidePart {
    /// True when it must be halved, however short it is, because a neighbour may have a corner in its middle.
    pub fn must_part(&self) -> bool {
        self.range.count() > self.most
    }

    /// Returns both halves, in order; `None` when it is too small.
    pub fn halves(&self) -> Option<[Self; 2]> {
        self.range.halves().map(|(a, b)| [Self { range: a, ..*self }, Self { range: b, ..*self }])
    }
}

/// The places of the points on one side of a lattice.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum SidePoints {
    /// Spread evenly over the side, one for each point of the lattice. On a settled side: at its settled steps.
    #[default]
    Even,
    /// At the ends of this many equal steps. The lattice has at least as many.
    Steps(u32),
    /// The parts of the side, in order, each with a number of equal steps.
    Parts(Box<[(SidePart, u32)]>),
}

/// Equal steps over a range that contains a side.
#[derive(Clone, Copy, Debug)]
struct Run {
    range: Range,
    steps: u32,
}

impl Run {
    /// Returns the ends of the first and the last step on a side, which are those nearest to its ends.
    fn ends(&self, own: &Range) -> [usize; 2] {
        let (r0, r1) = self.range.span();
        let (x0, x1) = own.span();
        [x0, x1].map(|x| ((x - r0) * f64::from(self.steps) / (r1 - r0) + 0.5).floor().max(0.0) as usize)
    }

    fn place(&self, i: usize) -> Place {
        self.range.place(i, self.steps as usize + 1)
    }
}

/// The settled sides of a piece.
#[derive(Clone, Debug, Default)]
pub(crate) struct Settled(Option<Box<[Option<Run>; 4]>>);

impl Settled {
    fn get(&self, side: usize) -> Option<&Run> {
        self.0.as_ref().and_then(|runs| runs[side].as_ref())
    }

    /// True when a side is settled.
    pub(crate) fn is_settled(&self, side: usize) -> bool {
        self.get(side).is_some()
    }

    /// Returns the number of steps on a settled side of a piece.
    pub(crate) fn steps(&self, side: usize, range: &[Range; 2]) -> Option<usize> {
        self.get(side).map(|run| run.ends(&range[side / 2])).map(|[first, last]| last - first)
    }

    /// Returns the settled sides of the halves of a piece that is split along an axis. `steps` are those of the sides
    /// that become settled.
    pub(crate) fn halves(&self, range: &[Range; 2], axis: usize, steps: [Option<u32>; 4]) -> [Self; 2] {
        let mut runs: [Option<Run>; 4] = std::array::from_fn(|side| self.get(side).copied());
        for side in [2 * axis, 2 * axis + 1] {
            runs[side] = runs[side].or(steps[side].map(|steps| Run { range: range[axis], steps }));
        }
        // The halves share a new line.
        let across = 2 * (1 - axis);
        [across + 1, across].map(|new| {
            let mut runs = runs;
            runs[new] = None;
            Self(runs.iter().any(Option::is_some).then(|| Box::new(runs)))
        })
    }

    /// Returns the corners that lie outside of the piece.
    pub(crate) fn outside(&self, range: &[Range; 2]) -> Vec<[Place; 2]> {
        let mut list = Vec::new();
        for side in 0..4 {
            let Some(run) = self.get(side) else { continue };
            let (axis, (x0, x1)) = (side / 2, range[side / 2].span());
            let across = range[1 - axis].place(side % 2, 2);
            for i in run.ends(&range[axis]) {
                let place = run.place(i);
                if place.coordinate() < x0 || place.coordinate() > x1 {
                    list.push(if axis == 0 { [place, across] } else { [across, place] });
                }
            }
        }
        list
    }
}

/// The places of a lattice: every u with every v, except on sides that have their own points.
pub(crate) struct Lattice {
    /// The places along u and v.
    pub(crate) places: [Vec<Place>; 2],
    /// The places along the sides, one for each point, for sides with their own points.
    sides: [Option<Vec<Place>>; 4],
    /// Points that coincide with a corner that another side has moved, as indices of corner and point.
    pub(crate) copies: Vec<[usize; 2]>,
}

/// One side of a lattice that has its own points.
pub(crate) struct Border {
    /// The places along u and v: all along the side, and one across.
    pub(crate) places: [Vec<Place>; 2],
    /// The index of each in the lattice; `None` for a point that is not moved.
    pub(crate) at: Vec<Option<usize>>,
}

impl Lattice {
    /// Returns a lattice that is spread evenly over ranges of u and v.
    pub(crate) fn even(range: &[Range; 2], [nu, nv]: [usize; 2]) -> Self {
        let along = |axis: usize, n: usize| (0..n).map(|i| range[axis].place(i, n)).collect();
        Self { places: [along(0, nu), along(1, nv)], sides: [const { None }; 4], copies: Vec::new() }
    }

    /// Returns a lattice that is even inside and has these points on its sides.
    pub(crate) fn between(
        range: &[Range; 2],
        size: [usize; 2],
        settled: &Settled,
        sides: &[SidePoints; 4],
    ) -> Self {
        let mut lattice = Self::even(range, size);
        for (side, points) in sides.iter().enumerate() {
            let own = &range[side / 2];
            let ends: Vec<Place> = match (settled.get(side), points) {
                (Some(run), _) => {
                    let [first, last] = run.ends(own);
                    (first..=last).map(|i| run.place(i)).collect()
                }
                (None, SidePoints::Even) => continue,
                // The steps are those of the even lattice.
                (None, SidePoints::Steps(steps)) if *steps as usize + 1 == size[side / 2] => continue,
                (None, SidePoints::Steps(steps)) => {
                    let n = *steps as usize + 1;
                    (0..n).map(|i| own.place(i, n)).collect()
                }
                (None, SidePoints::Parts(parts)) => {
                    let mut ends = vec![own.place(0, 2)];
                    for (part, steps) in parts {
                        let n = *steps as usize + 1;
                        ends.extend((1..n).map(|i| part.range.place(i, n)));
                    }
                    ends
                }
            };
            let places = spread(own, &ends, size[side / 2]);
            let even = &lattice.places[side / 2];
            let moved = |(a, b): (&Place, &Place)| a.coordinate() != b.coordinate();
            lattice.sides[side] = places.iter().zip(even).any(moved).then_some(places);
        }
        lattice.copies = lattice.find_copies();
        lattice
    }

    /// Finds the points that follow a moved corner. A corner lies on two sides, of which at most one moves it. The
    /// points of the other side that are at the corner move along.
    fn find_copies(&self) -> Vec<[usize; 2]> {
        let mut copies = Vec::new();
        for (side, own) in self.sides.iter().enumerate() {
            let Some(own) = own else { continue };
            let axis = side / 2;
            for end in 0..2 {
                let last = |list: &[Place], end: usize| if end == 0 { 0 } else { list.len() - 1 };
                let (across, corner) = (2 * (1 - axis) + end, last(own, end));
                let other = &self.places[1 - axis];
                let at = last(other, side % 2);
                let is_moved =
                    self.sides[across].as_ref().is_some_and(|p| p[at].coordinate() != other[at].coordinate());
                if is_moved {
                    let same = |k: &usize| *k != corner && own[*k].coordinate() == own[corner].coordinate();
                    let list = (0..own.len()).filter(same);
                    copies.extend(list.map(|k| [self.index(axis, corner, at), self.index(axis, k, at)]));
                }
            }
        }
        copies
    }

    /// Returns the indices and places of the points on a side.
    pub(crate) fn side(&self, side: usize) -> Vec<(usize, [Place; 2])> {
        let axis = side / 2;
        let [even, across] = [&self.places[axis], &self.places[1 - axis]];
        let at = if side.is_multiple_of(2) { 0 } else { across.len() - 1 };
        let own = self.sides[side].as_ref().unwrap_or(even);
        let place = |k: usize| if axis == 0 { [own[k], across[at]] } else { [across[at], own[k]] };
        (0..own.len()).map(|k| (self.index(axis, k, at), place(k))).collect()
    }

    /// Returns the index of a point from its numbers along an axis and across it.
    fn index(&self, axis: usize, along: usize, across: usize) -> usize {
        let [i, j] = if axis == 0 { [along, across] } else { [across, along] };
        j * self.places[0].len() + i
    }

    /// Returns the sides that have their own points.
    pub(crate) fn borders(&self) -> impl Iterator<Item = Border> + '_ {
        self.sides.iter().enumerate().filter_map(move |(side, own)| {
            let own = own.as_ref()?;
            let axis = side / 2;
            let across = if side % 2 == 0 { 0 } else { self.places[1 - axis].len() - 1 };
            let even = &self.places[axis];
            let moved = |k: usize| own[k].coordinate() != even[k].coordinate();
            let at = (0..own.len()).map(|k| moved(k).then(|| self.index(axis, k, across)));
            let fixed = vec![self.places[1 - axis][across]];
            let places = if axis == 0 { [own.clone(), fixed] } else { [fixed, own.clone()] };
            Some(Border { places, at: at.collect() })
        })
    }

    /// Returns a value along u (axis 0) or v (axis 1) for each point.
    pub(crate) fn along<T: Copy>(&self, axis: usize, value: impl Fn(&Place) -> T) -> Vec<T> {
        let [us, vs] = &self.places;
        let of_line: Vec<T> = self.places[axis].iter().map(&value).collect();
        let pick = |i: usize, j: usize| of_line[if axis == 0 { i } else { j }];
        let mut all: Vec<T> =
            (0..vs.len()).flat_map(|j| (0..us.len()).map(move |i| (i, j))).map(|(i, j)| pick(i, j)).collect();
        for border in self.borders() {
            let places = &border.places[axis];
            for (k, at) in border.at.iter().enumerate().filter(|_| places.len() > 1) {
                if let Some(at) = *at {
                    all[at] = value(&places[k]);
                }
            }
        }
        self.copies.iter().for_each(|[corner, point]| all[*point] = all[*corner]);
        all
    }

    /// Returns the places of the points, counted in steps of the even lattice; `None` when it is even.
    pub(crate) fn in_steps(&self) -> Option<[Vec<f32>; 2]> {
        (!self.is_even()).then(|| {
            [0, 1].map(|axis| {
                let even = &self.places[axis];
                let (first, last) = (even[0].coordinate(), even[even.len() - 1].coordinate());
                let scale = (even.len() - 1) as f64 / (last - first);
                self.along(axis, |p| ((p.coordinate() - first) * scale) as f32)
            })
        })
    }

    /// True when no side has its own points.
    pub(crate) fn is_even(&self) -> bool {
        self.sides.iter().all(Option::is_none)
    }
}

/// Returns the nearest of the ends of steps for each of `n` points that are spread evenly over a side. Every end is
/// used for at least one point.
fn spread(own: &Range, ends: &[Place], n: usize) -> Vec<Place> {
    let (last, steps) = (ends.len() - 1, n - 1);
    if steps < last {
        // There are too few points, which happens only for pieces that cannot be split.
        return (0..n).map(|i| ends[i * last / steps]).collect();
    }
    let (x0, x1) = own.span();
    let mut k = 0;
    let nearest = |i: usize| {
        let x = x0 + (x1 - x0) * (i as f64 / steps as f64);
        let off = |k: usize| (ends[k].coordinate() - x).abs();
        let must = k + steps - i < last;
        if i > 0 && (must || (k < last && off(k + 1) <= off(k))) {
            k += 1;
        }
        ends[k]
    };
    (0..n).map(nearest).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn coordinates(places: &[Place]) -> Vec<f64> {
        places.iter().map(Place::coordinate).collect()
    }

    #[test]
    fn spread_coordinates_contain_every_end_in_order() {
        let own = Range::whole(1);
        for steps in 1..12_usize {
            let ends: Vec<Place> = (0..=steps).map(|i| own.place(i, steps + 1)).collect();
            for n in steps + 1..40 {
                let list = coordinates(&spread(&own, &ends, n));
                assert!(list.is_sorted() && list[0] == 0.0 && list[n - 1] == 1.0);
                let mut distinct = list.clone();
                distinct.dedup();
                assert_eq!(distinct.len(), steps + 1);
            }
        }
    }

    #[test]
    fn halves_of_an_edge_with_fixed_rate_share_a_corner() {
        let whole = [Range::whole(1); 2];
        for steps in 1..9_u32 {
            let [left, right] = Settled::default().halves(&whole, 0, [Some(steps), None, None, None]);
            let (a, b) = whole[0].halves().unwrap();
            let (a, b) = ([a, whole[1]], [b, whole[1]]);
            let ends = |settled: &Settled, range: &[Range; 2]| {
                let points = std::array::from_fn(|_| SidePoints::Even);
                let lattice = Lattice::between(range, [20, 3], settled, &points);
                let u = lattice.along(0, Place::coordinate);
                [u[0], u[19]]
            };
            let ([l0, l1], [r0, r1]) = (ends(&left, &a), ends(&right, &b));
            assert_eq!((l0, l1, r1), (0.0, r0, 1.0), "{steps} steps");
            assert_eq!(l1, (f64::from(steps) / 2.0 + 0.5).floor() / f64::from(steps));
            let count = |settled: &Settled, range| settled.steps(0, range).unwrap();
            assert_eq!(count(&left, &a) + count(&right, &b), steps as usize);
            // The other sides and the new line are not settled.
            assert!((1..4).all(|side| !left.is_settled(side) && !right.is_settled(side)));
        }
    }
}
