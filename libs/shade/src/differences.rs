//! Computes differences along the rows and columns of a grid.
//!
//! They are central inside and one-sided of second order at the borders, so that a quadratic is continuous between
//! grids.

use crate::{Grid, Rect, Topology, Uneven};

/// Returns the differences along u and v at one point, equal to those of a whole line.
pub(crate) fn both_differences(v: &[f32], Rect { first, nu, nv }: Rect, lane: usize) -> [f32; 2] {
    let along = |i: usize, count: usize, stride: usize| {
        let at = |k: usize| v[lane - i * stride + k * stride];
        match (i, count) {
            (_, 0 | 1) => 0.0,
            (_, 2) => minus(at(1), at(0)),
            (0, _) => forward(at(0), at(1), at(2)),
            (i, n) if i + 1 == n => backward(at(i), at(i - 1), at(i - 2)),
            _ => 0.5 * minus(at(i + 1), at(i - 1)),
        }
    };
    let at = lane - first;
    [along(at % nu, nu, 1), along(at / nu, nv, nu)]
}

impl Grid {
    /// Finds the points of a rectangular grid that are [`Uneven`]. `places` holds the positions of all points along
    /// u and along v, in steps of an even grid.
    pub fn find_uneven(&mut self, places: &[Vec<f32>; 2]) {
        self.uneven = uneven(&self.topology, places);
    }
}

/// Finds the uneven points for [`Grid::find_uneven`], with the inverse of the change of the positions along the
/// lines of the grid. A point where that has no inverse stays unchanged.
fn uneven(topology: &Topology, places: &[Vec<f32>; 2]) -> Vec<Uneven> {
    const LEAST: f32 = 0.2;
    let Some(rect) = topology.rects().next() else { return Vec::new() };
    let mut list = Vec::new();
    for lane in rect.lanes() {
        let [[uu, uv], [vu, vv]] = places.each_ref().map(|x| both_differences(x, rect, lane));
        let even = [uu - 1.0, uv, vu, vv - 1.0].iter().all(|x| x.abs() < 1e-3);
        let det = uu * vv - uv * vu;
        if !even && det.abs() >= LEAST {
            let of = [[vv / det, -vu / det], [-uv / det, uu / det]];
            list.push(Uneven { lane: lane as u32, of });
        }
    }
    list
}

/// Returns `a - b`, but 0 for values with the same bits, and for two NaN, whose bits machines and compilers choose. An
/// infinity does not change along the grid, and a uniform value is the same in every lane.
#[inline]
pub(crate) fn minus(a: f32, b: f32) -> f32 {
    if (a.to_bits() == b.to_bits()) | (a.is_nan() & b.is_nan()) { 0.0 } else { a - b }
}

/// Returns the slope at `a` of the parabola through three equidistant values.
pub(crate) fn forward(a: f32, b: f32, c: f32) -> f32 {
    // The form by differences gives exactly 0 for constants.
    2.0 * minus(b, a) - 0.5 * minus(c, a)
}

/// Returns the slope at the other end. It is not `-forward`, whose zero would be negative.
pub(crate) fn backward(a: f32, b: f32, c: f32) -> f32 {
    2.0 * minus(a, b) - 0.5 * minus(a, c)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_do_not_depend_on_the_bits_of_a_nan() {
        let [plus, minus_nan] = [0x7fc0_0000, 0xffc0_0001].map(f32::from_bits);
        assert_eq!(
            [minus(plus, minus_nan), minus(plus, plus), minus(f32::INFINITY, f32::INFINITY)],
            [0.0; 3]
        );
        assert!(minus(plus, 1.0).is_nan() && minus(1.0, plus).is_nan());
        assert_eq!(backward(plus, minus_nan, plus), 0.0);
    }

    #[test]
    fn derivatives_do_not_depend_on_the_spacing_of_points() {
        // A plane over a grid whose border points were moved, some of them onto each other.
        let (nu, nv) = (5, 4);
        let even = |place: fn(usize, usize) -> usize| (0..20).map(|lane| place(lane, nu) as f32).collect();
        let mut places: [Vec<f32>; 2] = [even(|lane, nu| lane % nu), even(|lane, nu| lane / nu)];
        places[0][1] = 1.33;
        places[0][2] = 2.67;
        places[0][3] = 2.67;
        places[1][9] = 1.5;
        places[1][14] = 1.5;
        let plane: Vec<f32> = (0..20).map(|i| 3.0 * places[0][i] - 2.0 * places[1][i] + 1.0).collect();
        let list = uneven(&Topology::Rect { nu, nv }, &places);
        for lane in 0..20 {
            let [du, dv] = both_differences(&plane, Rect { first: 0, nu, nv }, lane);
            let one = [[1.0, 0.0], [0.0, 1.0]];
            let of = list.iter().find(|u| u.lane as usize == lane).map_or(one, |u| u.of);
            let even = of.map(|of| of[0] * du + of[1] * dv);
            assert!((even[0] - 3.0).abs() < 1e-4 && (even[1] + 2.0).abs() < 1e-4, "{lane}: {even:?}");
        }
        // Points that are not beside one of them are left unchanged.
        assert!(list.iter().all(|u| u.lane != 6 + nu as u32 && u.lane != 15));
    }
}
