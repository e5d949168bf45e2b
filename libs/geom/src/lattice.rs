//! Lattices that are diced already. They are linear patches whose control vertices are the points of the grid
//! (reference 4.3.7).

use crate::GeomError;
use crate::dice::Dice;
use crate::key::ShapeKey;
use crate::surface::{Piece, SplitDirection, Surface};
use crate::vars::{Control, Counts, Vars, control, emit, take_normals, vertex_count};
use granita_base::{Bound, Severity, Vec3};
use std::ops::Range;
use std::sync::Arc;

/// The data that the pieces of a lattice share.
struct Whole {
    times: Vec<f32>,
    /// The numbers of control vertices along u and v.
    counts: [usize; 2],
    control: Control,
    vars: Vars,
}

/// Some rows and columns of a lattice.
struct Part {
    whole: Arc<Whole>,
    /// The indices of vertices along u and v, including the last ones.
    range: [Range<usize>; 2],
    bounds: Vec<Bound>,
}

/// Builds a linear patch of `nu x nv` control vertices that is used as a grid without changes. Its piece dices into
/// exactly these points ([`Surface::lattice`]) and splits between them. Vertices that are not finite stay so.
///
/// `keys` and `report` are those of [`crate::build`]. There is no trimming.
///
/// # Errors
/// [`GeomError::Malformed`] when there are fewer vertices than `nu x nv`, or fewer than 2 along u or v.
pub fn build_lattice(
    [nu, nv]: [usize; 2],
    keys: &[ShapeKey<'_>],
    report: &mut dyn FnMut(Severity, String),
) -> Result<Vec<Piece>, GeomError> {
    const CALL: &str = "Patch";
    let fail = |what: String| GeomError::Malformed { call: CALL, what };
    let Some(first) = keys.first() else { return Err(fail("there are no motion keys".into())) };
    if keys.windows(2).any(|w| w[0].time >= w[1].time) {
        return Err(fail("the times of the motion keys do not increase".into()));
    }
    let have = vertex_count(CALL, keys, report)?;
    let n = nu.checked_mul(nv).filter(|n| nu >= 2 && nv >= 2 && *n <= have);
    let n = n.ok_or_else(|| fail(format!("{have} control vertices instead of {nu} x {nv}")))?;
    let counts = Counts { vertex: Some(n), linear: Some(4), perpiece: None };
    let vars = Vars::collect(CALL, first.params, counts, report);
    let control = control(CALL, keys, n, &vars, report)?.divided();
    let whole = Whole { times: keys.iter().map(|k| k.time).collect(), counts: [nu, nv], control, vars };
    Ok(vec![Part::piece(&Arc::new(whole), [0..nu, 0..nv])])
}

impl Part {
    fn piece(whole: &Arc<Whole>, range: [Range<usize>; 2]) -> Piece {
        let mut part = Self { whole: whole.clone(), range, bounds: Vec::new() };
        let bound = |key: usize| {
            let points = part.vertices().map(|i| whole.control.position(i, key));
            points.filter(|p| p.is_finite()).fold(Bound::EMPTY, Bound::with)
        };
        part.bounds = (0..whole.times.len()).map(bound).collect();
        Box::new(part)
    }

    /// Returns the indices of its vertices, u fastest.
    fn vertices(&self) -> impl Iterator<Item = usize> + '_ {
        let nu = self.whole.counts[0];
        self.range[1].clone().flat_map(move |j| self.range[0].clone().map(move |i| j * nu + i))
    }

    /// Returns the parameters of its vertices along an axis.
    fn parameters(&self, axis: usize) -> Vec<f32> {
        let last = (self.whole.counts[axis] - 1) as f32;
        self.range[axis].clone().map(|i| i as f32 / last).collect()
    }
}

impl Surface for Part {
    fn key_times(&self) -> &[f32] {
        &self.whole.times
    }

    fn bound(&self, key: usize) -> Bound {
        self.bounds[key.min(self.bounds.len() - 1)]
    }

    /// Returns the nearest vertices.
    fn positions(&self, key: usize, nu: usize, nv: usize, out: &mut Vec<Vec3>) {
        let key = key.min(self.bounds.len() - 1);
        let pick = |range: &Range<usize>, k: usize, n: usize| {
            range.start + (k * (range.len() - 1) + (n - 1) / 2) / (n - 1).max(1)
        };
        out.clear();
        for j in 0..nv.max(2) {
            for i in 0..nu.max(2) {
                let (i, j) = (pick(&self.range[0], i, nu.max(2)), pick(&self.range[1], j, nv.max(2)));
                out.push(self.whole.control.position(j * self.whole.counts[0] + i, key));
            }
        }
    }

    fn domain(&self) -> [f32; 4] {
        let end = |axis: usize, i: usize| i as f32 / (self.whole.counts[axis] - 1) as f32;
        let [u, v] = &self.range;
        [end(0, u.start), end(0, u.end - 1), end(1, v.start), end(1, v.end - 1)]
    }

    fn is_splittable(&self) -> bool {
        self.range.iter().any(|r| r.len() > 2)
    }

    /// Splits along the requested direction, or along the one with more points if the requested direction has no
    /// inner points.
    fn split(&self, direction: SplitDirection) -> Vec<Piece> {
        let mut axis = usize::from(direction == SplitDirection::V);
        if self.range[axis].len() <= 2 {
            axis = 1 - axis;
        }
        if self.range[axis].len() <= 2 {
            return Vec::new();
        }
        let Range { start, end } = self.range[axis];
        let middle = start + (end - start) / 2;
        let with = |part: Range<usize>| {
            let mut range = self.range.clone();
            range[axis] = part;
            Self::piece(&self.whole, range)
        };
        vec![with(start..middle + 1), with(middle..end)]
    }

    fn lattice(&self) -> Option<[usize; 2]> {
        Some([self.range[0].len(), self.range[1].len()])
    }

    /// Returns its own points and ignores the requested numbers.
    fn dice(&self, _: usize, _: usize) -> Dice {
        let Whole { times, control, vars, .. } = &*self.whole;
        let [nu, nv] = self.range.each_ref().map(Range::len);
        let n = nu * nv;
        let p: Vec<Vec<Vec3>> =
            (0..times.len()).map(|key| self.vertices().map(|i| control.position(i, key)).collect()).collect();
        let [us, vs] = [0, 1].map(|axis| self.parameters(axis));
        let slope =
            |a: usize, b: usize, da: f32| if da > 0.0 { (p[0][b] - p[0][a]) / da } else { Vec3::ZERO };
        let (mut dpdu, mut dpdv) = (Vec::with_capacity(n), Vec::with_capacity(n));
        for j in 0..nv {
            let (j0, j1) = (j.saturating_sub(1), (j + 1).min(nv - 1));
            for i in 0..nu {
                let (i0, i1) = (i.saturating_sub(1), (i + 1).min(nu - 1));
                dpdu.push(slope(j * nu + i0, j * nu + i1, us[i1] - us[i0]));
                dpdv.push(slope(j0 * nu + i, j1 * nu + i, vs[j1] - vs[j0]));
            }
        }
        let mut primvars = vars.uniform(0);
        let values: Vec<f64> = self.vertices().flat_map(|i| control.vertex(i)).copied().collect();
        emit(&vars.vertex, &values, n, control.channels, control.vars_offset(), &mut primvars);
        if !vars.linear.is_empty() {
            let mut corners = Vec::new();
            (0..4).for_each(|corner| vars.push_linear(corner, &mut corners));
            let s: Vec<f64> = (0..n).map(|i| f64::from(us[i % nu])).collect();
            let t: Vec<f64> = (0..n).map(|i| f64::from(vs[i / nu])).collect();
            vars.emit_linear(&corners, &s, &t, &mut primvars);
        }
        let normals = take_normals(n, &mut primvars);
        Dice {
            places: None,
            nu,
            nv,
            p,
            n: normals,
            dpdu,
            dpdv,
            u: (0..n).map(|i| us[i % nu]).collect(),
            v: (0..n).map(|i| vs[i / nu]).collect(),
            primvars,
            face: 0,
            mask: None,
            facing: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::DiceData;
    use granita_base::{Param, Params};

    fn grid(nu: usize, nv: usize) -> Params {
        let points: Vec<f32> = (0..nu * nv)
            .flat_map(|i| [(i % nu) as f32 + 0.1, (i / nu) as f32 + 0.3, 0.7 * i as f32])
            .collect();
        let colors: Vec<f32> = points.iter().map(|x| x * 0.3).collect();
        Params(vec![
            Param::declared("vertex point P", &points[..]).unwrap(),
            Param::declared("vertex color C", &colors[..]).unwrap(),
            Param::declared("linear float s", &[0.0_f32, 1.0, 0.0, 1.0][..]).unwrap(),
        ])
    }

    fn built(nu: usize, nv: usize) -> Vec<Piece> {
        let params = grid(nu, nv);
        let keys = [ShapeKey { time: 0.0, params: &params }];
        build_lattice([nu, nv], &keys, &mut |_, text| panic!("{text}")).unwrap()
    }

    #[test]
    fn dicing_a_lattice_gives_its_points_and_values() {
        let piece = &built(5, 4)[0];
        assert_eq!(piece.lattice(), Some([5, 4]));
        let dice = piece.dice(100, 2);
        assert_eq!((dice.nu, dice.nv), (5, 4));
        let params = grid(5, 4);
        let points = params.floats("P").unwrap();
        assert!(dice.p[0].iter().zip(points.chunks(3)).all(|(p, q)| p.to_array() == q));
        let DiceData::Floats { values, varying: true } = &dice.primvars[0].data else { panic!() };
        let colors = params.floats("C").unwrap();
        assert!((0..20).all(|i| (0..3).all(|c| values[c * 20 + i] == colors[i * 3 + c])));
        assert_eq!(dice.dpdu[0], (dice.p[0][1] - dice.p[0][0]) * 4.0);
    }

    #[test]
    fn parts_of_a_lattice_share_their_border_points() {
        let mut stack = built(7, 6);
        let mut cells = 0;
        while let Some(piece) = stack.pop() {
            let dice = piece.dice(0, 0);
            let bound = piece.bound(0);
            assert!(dice.p[0].iter().all(|p| bound.with(*p) == bound));
            if piece.is_splittable() {
                stack.extend(piece.split(SplitDirection::U));
            } else {
                cells += 1;
                assert_eq!(dice.p[0].len(), 4);
            }
        }
        assert_eq!(cells, 6 * 5);
    }

    #[test]
    fn invalid_lattices_are_refused_and_infinite_points_kept() {
        let params = grid(3, 3);
        let keys = [ShapeKey { time: 0.0, params: &params }];
        for counts in [[3, 4], [1, 9], [0, 0], [usize::MAX, 2]] {
            assert!(build_lattice(counts, &keys, &mut |_, _| {}).is_err(), "{counts:?}");
        }
        let mut points = params.floats("P").unwrap().to_vec();
        points[4] = f32::NAN;
        let params = Params(vec![Param::declared("vertex point P", &points[..]).unwrap()]);
        let keys = [ShapeKey { time: 0.0, params: &params }];
        let piece = &build_lattice([3, 3], &keys, &mut |_, _| {}).unwrap()[0];
        assert!(piece.bound(0).is_finite() && piece.dice(3, 3).p[0][1].is_nan());
    }
}
