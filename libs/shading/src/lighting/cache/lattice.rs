//! Places records on a grid, and interpolates them at its points.
//!
//! First the sides of the grid are processed separately. Records are placed at the ends, and halfway where these do
//! not suffice. The placement on a side follows from the points of that side alone, so that two grids with a shared
//! edge place the same records and show no crack. Then the inside is divided into cells with records at their
//! corners. A cell is halved while they do not suffice. At the end, lines between records get cubics with the
//! values and gradients of the records, and the cells between the lines are filled from all four sides (Coons,
//! Surfaces for Computer-Aided Design of Space Forms, MIT, 1967). The result is continuous, also where one large
//! cell borders several small ones.

use super::{Kind, Record};
use granita_base::Vec3;
use granita_shade::Rect;
use std::sync::Arc;

/// The conditions under which records suffice.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Tolerance {
    /// "maxerror". Its square bounds the deviation of the light from a straight line between two records, relative
    /// to its value, as estimated by their second derivatives. (Cubics come much nearer.) A normal turns by at most
    /// about this angle in radians.
    pub(crate) maxerror: f32,
    /// "maxpixeldist", in raster pixels.
    pub(crate) maxpixeldist: f32,
    /// The smallest number of records on each grid, or all points inside of it when it has fewer.
    pub(crate) minsamples: usize,
}

/// The points of a grid, u fastest. Points that are not active may be anywhere.
#[derive(Debug)]
pub(crate) struct Points {
    /// The rectangles. Each is a lattice of its own, and the records of all of them are made together.
    pub(crate) rects: Vec<Rect>,
    pub(crate) p: Vec<Vec3>,
    /// Unit vectors.
    pub(crate) n: Vec<Vec3>,
    pub(crate) active: Vec<bool>,
    /// Raster pixels per world unit.
    pub(crate) scale: Vec<f32>,
}

/// A lane of the grid that needs a record.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Wanted {
    /// The lane's index.
    pub(crate) lane: u32,
    /// True when it lies on a side, where other grids may need the same record.
    pub(crate) shared: bool,
}

/// Makes records for points of the grid, in their order.
pub(crate) type Source<'s> = dyn FnMut(&[Wanted]) -> Vec<Arc<Record>> + 's;

/// The smallest occlusion that errors are relative to.
const FLOOR: f32 = 0.25;
/// The largest deviation by second derivatives over a distance, relative to the value, at "maxerror" 1.
const BEND: f32 = 4.0;

/// The records of a grid while they are placed.
pub(crate) struct Lattice<'a> {
    kind: Kind,
    points: &'a Points,
    tolerance: Tolerance,
    /// The known record of each point: computed ones, and interpolated ones along sides.
    known: Vec<Option<Arc<Record>>>,
    /// The number of records so far of each rectangle.
    records: Vec<usize>,
}

/// Some points of a rectangle, corners included.
#[derive(Clone, Copy, Debug)]
struct Cell {
    /// The index of the rectangle.
    rect: usize,
    lo: [usize; 2],
    hi: [usize; 2],
}

impl Cell {
    /// Returns the lane of a point of its rectangle.
    fn lane(&self, lattice: &Lattice<'_>, at: [usize; 2]) -> u32 {
        let rect = &lattice.points.rects[self.rect];
        (rect.first + at[1] * rect.nu + at[0]) as u32
    }
}

/// A part of a side between two of its points, as positions in a list of them.
#[derive(Clone, Copy, Debug)]
struct Part {
    side: usize,
    from: usize,
    to: usize,
}

impl<'a> Lattice<'a> {
    /// Returns the value of every active point, from records that `source` makes; `None` for points that are not
    /// active.
    pub(crate) fn fill(
        kind: Kind,
        points: &'a Points,
        tolerance: Tolerance,
        source: &mut Source<'_>,
    ) -> (Vec<Option<Arc<Record>>>, usize) {
        let (known, records) = (vec![None; points.p.len()], vec![0; points.rects.len()]);
        let mut lattice = Self { kind, points, tolerance, known, records };
        lattice.sides(source);
        let cells = lattice.cells(source);
        lattice.between(&cells);
        (lattice.known, lattice.records.iter().sum())
    }

    /// Makes records for points that have none.
    fn make(&mut self, mut lanes: Vec<u32>, shared: bool, source: &mut Source<'_>) {
        lanes.retain(|l| self.points.active[*l as usize] && self.known[*l as usize].is_none());
        lanes.sort_unstable();
        lanes.dedup();
        let wanted: Vec<Wanted> = lanes.iter().map(|&lane| Wanted { lane, shared }).collect();
        if wanted.is_empty() {
            return;
        }
        let mut rect = 0;
        for w in &wanted {
            while self.points.rects[rect].lanes().end <= w.lane as usize {
                rect += 1;
            }
            self.records[rect] += 1;
        }
        for (w, record) in wanted.iter().zip(source(&wanted)) {
            self.known[w.lane as usize] = Some(record);
        }
    }

    /// Returns the distinct points of each side, from the same end whatever the grid, and the coincident lanes of
    /// the side with the lane that they coincide with.
    fn side_points(&self) -> Vec<Side> {
        let mut lists = Vec::with_capacity(4 * self.points.rects.len());
        for Rect { first, nu, nv } in self.points.rects.iter().copied().filter(|r| !r.lanes().is_empty()) {
            let at = |i: usize, j: usize| (first + j * nu + i) as u32;
            let along_u = |j: usize| (0..nu).map(|i| at(i, j)).collect::<Vec<u32>>();
            let along_v = |i: usize| (0..nv).map(|j| at(i, j)).collect::<Vec<u32>>();
            lists.push(along_u(0));
            if nv > 1 {
                lists.push(along_u(nv - 1));
                lists.push(along_v(0));
                if nu > 1 {
                    lists.push(along_v(nu - 1));
                }
            }
        }
        lists.into_iter().map(|list| self.side(list)).collect()
    }

    fn side(&self, mut all: Vec<u32>) -> Side {
        let place = |lane: u32| self.points.p[lane as usize];
        let bits = |lane: &u32| place(*lane).to_array().map(f32::to_bits);
        // Where both ends are one point, its neighbours decide the direction.
        if all.iter().map(bits).gt(all.iter().rev().map(bits)) {
            all.reverse();
        }
        let active = |lane: u32| self.points.active[lane as usize];
        let mut distinct: Vec<u32> = Vec::with_capacity(all.len());
        let mut coincident = Vec::new();
        for lane in all {
            match distinct.last() {
                Some(&last) if active(last) && active(lane) && place(last) == place(lane) => {
                    coincident.push((lane, last));
                }
                _ => distinct.push(lane),
            }
        }
        Side { distinct, coincident }
    }

    /// Places the records of the sides and interpolates between them.
    fn sides(&mut self, source: &mut Source<'_>) {
        let sides = self.side_points();
        let mut parts: Vec<Part> = sides
            .iter()
            .enumerate()
            .map(|(side, s)| Part { side, from: 0, to: s.distinct.len() - 1 })
            .collect();
        let ends = sides.iter().flat_map(|s| [s.distinct[0], s.distinct[s.distinct.len() - 1]]).collect();
        self.make(ends, true, source);
        let mut done = Vec::new();
        while !parts.is_empty() {
            let mut next = Vec::new();
            let mut wanted = Vec::new();
            for part in parts {
                let list = &sides[part.side].distinct[part.from..=part.to];
                if part.to - part.from < 2 || self.suffices(list) {
                    done.push(part);
                    continue;
                }
                let middle = (part.from + part.to) / 2;
                wanted.push(sides[part.side].distinct[middle]);
                next.push(Part { to: middle, ..part });
                next.push(Part { from: middle, ..part });
            }
            // A corner of one side may coincide with a lane of another side.
            self.spread_twins(&sides);
            self.make(wanted, true, source);
            parts = next;
        }
        self.spread_twins(&sides);
        for part in done {
            self.fill_line(&sides[part.side].distinct[part.from..=part.to]);
        }
        self.spread_twins(&sides);
    }

    /// Copies the known record among coincident lanes.
    fn spread_twins(&mut self, sides: &[Side]) {
        for &(lane, of) in sides.iter().flat_map(|s| &s.coincident) {
            let same_normal = self.points.n[lane as usize] == self.points.n[of as usize];
            if self.known[lane as usize].is_none() && same_normal {
                self.known[lane as usize] = self.known[of as usize].clone();
            }
        }
    }

    /// True when the records at both ends of a line suffice for the points between.
    fn suffices(&self, line: &[u32]) -> bool {
        let all_active = line.iter().all(|l| self.points.active[*l as usize]);
        let (Some(&first), Some(&last)) = (line.first(), line.last()) else { return true };
        if !all_active || !self.joins(first, last, self.length(line)) {
            return false;
        }
        // The normals in between may differ from linear interpolation by the bound at most.
        let places = self.fractions(line);
        let (na, nb) = (self.points.n[first as usize], self.points.n[last as usize]);
        let most = 2.0 * self.turn();
        line.iter()
            .zip(places)
            .all(|(l, t)| (self.points.n[*l as usize] - na.lerp(nb, t)).length_squared() <= most)
    }

    /// Returns the largest `1 - cos` of the angle between normals.
    fn turn(&self) -> f32 {
        (self.tolerance.maxerror * self.tolerance.maxerror).min(0.5)
    }

    fn length(&self, line: &[u32]) -> f32 {
        let p = |l: u32| self.points.p[l as usize];
        line.windows(2).map(|w| p(w[0]).distance(p(w[1]))).sum()
    }

    /// Returns the position of each point along a line, from 0 to 1.
    fn fractions(&self, line: &[u32]) -> Vec<f32> {
        let p = |l: u32| self.points.p[l as usize];
        let mut sum = 0.0;
        let mut out = vec![0.0];
        for w in line.windows(2) {
            sum += p(w[0]).distance(p(w[1]));
            out.push(sum);
        }
        let last = (line.len().max(2) - 1) as f32;
        for (k, x) in out.iter_mut().enumerate() {
            *x = if sum > 0.0 { *x / sum } else { k as f32 / last };
        }
        out
    }

    /// True when the known records of two points at a distance of `length` suffice for the points between.
    fn joins(&self, a: u32, b: u32, length: f32) -> bool {
        let (Some(ra), Some(rb)) = (&self.known[a as usize], &self.known[b as usize]) else { return false };
        let points = self.points;
        let (a, b) = (a as usize, b as usize);
        let Tolerance { maxerror, maxpixeldist, .. } = self.tolerance;
        let pixels = length * points.scale[a].max(points.scale[b]);
        // The condition is also false for NaN.
        if !(pixels <= maxpixeldist && 1.0 - points.n[a].dot(points.n[b]) <= self.turn()) {
            return false;
        }
        let (ma, mb) = (ra.mean(self.kind), rb.mean(self.kind));
        let largest = ma.abs().max(mb.abs());
        let value = if self.kind == Kind::Occlusion { largest.max(FLOOR) } else { largest };
        let d = points.p[b] - points.p[a];
        let most = BEND * maxerror * maxerror * value;
        if 0.5 * (ra.hessian(d).abs() + rb.hessian(d).abs()) > most {
            return false;
        }
        // The value that each record predicts for the other.
        let dn = points.n[b] - points.n[a];
        let n = self.kind.channels();
        let slope = |r: &Record| {
            (0..n).map(|c| r.translational[c].dot(d) + r.rotational[c].dot(dn)).sum::<f32>() / n as f32
        };
        [ra, rb].iter().all(|r| (mb - ma - slope(r)).abs() <= maxerror * value)
    }

    /// Places records inside. Returns the cells whose corners suffice.
    fn cells(&mut self, source: &mut Source<'_>) -> Vec<Cell> {
        let rects = self.points.rects.iter().enumerate().filter(|(_, r)| !r.lanes().is_empty());
        let whole = |(rect, r): (usize, &Rect)| Cell { rect, lo: [0, 0], hi: [r.nu - 1, r.nv - 1] };
        let mut cells: Vec<Cell> = rects.map(whole).collect();
        let mut done = Vec::new();
        while !cells.is_empty() {
            let (mut next, mut wanted) = (Vec::new(), Vec::new());
            for cell in cells {
                let steps = [cell.hi[0] - cell.lo[0], cell.hi[1] - cell.lo[1]];
                if steps[0] <= 1 && steps[1] <= 1 || self.cell_suffices(&cell) {
                    done.push(cell);
                    continue;
                }
                let along = self.longer(&cell);
                let middle = (cell.lo[along] + cell.hi[along]) / 2;
                let (mut one, mut other) = (cell, cell);
                (one.hi[along], other.lo[along]) = (middle, middle);
                wanted.extend([one.lane(self, one.hi), other.lane(self, other.lo)]);
                next.extend([one, other]);
            }
            self.make(wanted, false, source);
            cells = next;
        }
        done
    }

    /// Returns the corners: lowest, along u, along v, highest.
    fn corners(&self, cell: &Cell) -> [u32; 4] {
        let Cell { lo, hi, .. } = *cell;
        [lo, [hi[0], lo[1]], [lo[0], hi[1]], hi].map(|at| cell.lane(self, at))
    }

    /// Returns the direction in which a cell is halved, which is the longer one.
    fn longer(&self, cell: &Cell) -> usize {
        let steps = [cell.hi[0] - cell.lo[0], cell.hi[1] - cell.lo[1]];
        if steps[0] <= 1 || steps[1] <= 1 {
            return usize::from(steps[1] > steps[0]);
        }
        let corners = self.corners(cell);
        if corners.iter().any(|l| !self.points.active[*l as usize]) {
            return usize::from(steps[1] > steps[0]);
        }
        let p = corners.map(|l| self.points.p[l as usize]);
        let u = p[0].distance(p[1]).max(p[2].distance(p[3]));
        let v = p[0].distance(p[2]).max(p[1].distance(p[3]));
        usize::from(v > u)
    }

    fn cell_suffices(&self, cell: &Cell) -> bool {
        let points = self.points;
        let rows = || (cell.lo[1]..=cell.hi[1]).flat_map(|j| (cell.lo[0]..=cell.hi[0]).map(move |i| [i, j]));
        if rows().any(|at| !points.active[cell.lane(self, at) as usize])
            || self.records[cell.rect] < self.tolerance.minsamples.min(points.rects[cell.rect].lanes().len())
        {
            return false;
        }
        let [a, b, c, d] = self.corners(cell);
        let chord = |a: u32, b: u32| points.p[a as usize].distance(points.p[b as usize]);
        if [(a, b), (c, d), (a, c), (b, d), (a, d), (b, c)]
            .iter()
            .any(|(x, y)| !self.joins(*x, *y, chord(*x, *y)))
        {
            return false;
        }
        let n = [a, b, c, d].map(|l| points.n[l as usize]);
        let most = 2.0 * self.turn();
        let fraction =
            |x: usize, lo: usize, hi: usize| if hi > lo { (x - lo) as f32 / (hi - lo) as f32 } else { 0.0 };
        rows().all(|at| {
            let s = fraction(at[0], cell.lo[0], cell.hi[0]);
            let t = fraction(at[1], cell.lo[1], cell.hi[1]);
            let mean = n[0].lerp(n[1], s).lerp(n[2].lerp(n[3], s), t);
            (points.n[cell.lane(self, at) as usize] - mean).length_squared() <= most
        })
    }

    /// Fills the active points between the known ends of a line.
    fn fill_line(&mut self, line: &[u32]) {
        let (Some(&first), Some(&last)) = (line.first(), line.last()) else { return };
        let (Some(a), Some(b)) = (self.known[first as usize].clone(), self.known[last as usize].clone())
        else {
            return;
        };
        if line.len() < 3 {
            return;
        }
        let ends = Ends::new(self, (first, &a), (last, &b));
        let inside = line.iter().zip(self.fractions(line)).filter(|(lane, _)| {
            let i = **lane as usize;
            self.known[i].is_none() && self.points.active[i]
        });
        let made: Vec<(usize, Record)> = inside
            .map(|(lane, t)| (*lane as usize, t))
            .map(|(i, t)| (i, ends.at(t, self.points.p[i], self.points.n[i])))
            .collect();
        for (i, record) in made {
            self.known[i] = Some(Arc::new(record));
        }
    }

    /// Interpolates between the records inside.
    fn between(&mut self, cells: &[Cell]) {
        // Lines run between neighbours that are known at this point, whatever cell they belong to.
        let node: Vec<bool> = self.known.iter().map(Option::is_some).collect();
        for cell in cells {
            for along in 0..2 {
                for across in [cell.lo[1 - along], cell.hi[1 - along]] {
                    let at = |k: usize| if along == 0 { [k, across] } else { [across, k] };
                    let line: Vec<u32> =
                        (cell.lo[along]..=cell.hi[along]).map(|k| cell.lane(self, at(k))).collect();
                    let mut from = 0;
                    for to in 1..line.len() {
                        if node[line[to] as usize] {
                            self.fill_line(&line[from..=to]);
                            from = to;
                        }
                    }
                }
            }
        }
        for cell in cells {
            self.fill_cell(cell);
        }
    }

    /// Fills the points inside of a cell from those on its sides.
    fn fill_cell(&mut self, cell: &Cell) {
        let Cell { lo, hi, .. } = *cell;
        if hi[0] - lo[0] < 2 || hi[1] - lo[1] < 2 {
            return;
        }
        let line = |along: usize, across: usize| -> Vec<u32> {
            let at = |k: usize| if along == 0 { [k, across] } else { [across, k] };
            (lo[along]..=hi[along]).map(|k| cell.lane(self, at(k))).collect()
        };
        let lines = [line(0, lo[1]), line(0, hi[1]), line(1, lo[0]), line(1, hi[0])];
        let fractions = lines.each_ref().map(|l| self.fractions(l));
        let corners = self.corners(cell);
        for j in 1..hi[1] - lo[1] {
            for i in 1..hi[0] - lo[0] {
                let s = 0.5 * (fractions[0][i] + fractions[1][i]);
                let t = 0.5 * (fractions[2][j] + fractions[3][j]);
                let parts = [
                    (lines[0][i], 1.0 - t),
                    (lines[1][i], t),
                    (lines[2][j], 1.0 - s),
                    (lines[3][j], s),
                    (corners[0], -(1.0 - s) * (1.0 - t)),
                    (corners[1], -s * (1.0 - t)),
                    (corners[2], -(1.0 - s) * t),
                    (corners[3], -s * t),
                ];
                let mut sum = Record::default();
                let (mut p, mut n, mut whole) = (Vec3::ZERO, Vec3::ZERO, true);
                for (lane, w) in parts {
                    match &self.known[lane as usize] {
                        Some(r) => add(&mut sum, r, w, 1.0),
                        None => whole = false,
                    }
                    p += self.points.p[lane as usize] * w;
                    n += self.points.n[lane as usize] * w;
                }
                let lane = cell.lane(self, [lo[0] + i, lo[1] + j]) as usize;
                if whole && self.points.active[lane] && self.known[lane].is_none() {
                    self.correct(&mut sum, self.points.p[lane] - p, self.points.n[lane] - n);
                    self.known[lane] = Some(Arc::new(sum));
                }
            }
        }
    }

    /// Corrects a record for the difference in position and normal from the point that it was interpolated for.
    fn correct(&self, record: &mut Record, dp: Vec3, dn: Vec3) {
        for c in 0..self.kind.channels() {
            record.value[c] += record.translational[c].dot(dp) + record.rotational[c].dot(dn);
        }
    }
}

/// The points of a side.
struct Side {
    /// The lanes at distinct points, in order.
    distinct: Vec<u32>,
    /// Coincident lanes, each with the lane in `distinct` that it coincides with.
    coincident: Vec<(u32, u32)>,
}

/// Adds a weighted part of all values of a record.
fn add(sum: &mut Record, r: &Record, w: f32, value: f32) {
    for c in 0..3 {
        sum.value[c] += r.value[c] * w * value;
        sum.translational[c] += r.translational[c] * w;
        sum.rotational[c] += r.rotational[c] * w;
    }
    sum.open += r.open * w;
    for (s, x) in sum.second.iter_mut().zip(r.second) {
        *s += x * w;
    }
}

/// Two records and the interpolation between them.
struct Ends<'a> {
    lattice: &'a Lattice<'a>,
    a: &'a Record,
    b: &'a Record,
    p: [Vec3; 2],
    n: [Vec3; 2],
    /// The slopes of each value at both ends, over the whole distance.
    slopes: [[f32; 3]; 2],
}

impl<'a> Ends<'a> {
    fn new(lattice: &'a Lattice<'a>, (la, a): (u32, &'a Record), (lb, b): (u32, &'a Record)) -> Self {
        let points = lattice.points;
        let p = [points.p[la as usize], points.p[lb as usize]];
        let n = [points.n[la as usize], points.n[lb as usize]];
        let (d, dn) = (p[1] - p[0], n[1] - n[0]);
        let mut slopes = [[0.0; 3]; 2];
        for (r, slopes) in [a, b].into_iter().zip(&mut slopes) {
            for (c, out) in slopes.iter_mut().enumerate().take(lattice.kind.channels()) {
                let straight = b.value[c] - a.value[c];
                // The effect of noise is bounded.
                let most = 0.5 * a.value[c].abs().max(b.value[c].abs());
                let slope = r.translational[c].dot(d) + r.rotational[c].dot(dn);
                *out = straight + (slope - straight).clamp(-most, most);
            }
        }
        Self { lattice, a, b, p, n, slopes }
    }

    /// Returns the record at a fraction of the distance, for the position and the normal of the point there.
    fn at(&self, t: f32, p: Vec3, n: Vec3) -> Record {
        let mut out = Record::default();
        add(&mut out, self.a, 1.0 - t, 0.0);
        add(&mut out, self.b, t, 0.0);
        let (t2, t3) = (t * t, t * t * t);
        for c in 0..self.lattice.kind.channels() {
            out.value[c] = self.a.value[c] * (2.0 * t3 - 3.0 * t2 + 1.0)
                + self.b.value[c] * (3.0 * t2 - 2.0 * t3)
                + self.slopes[0][c] * (t3 - 2.0 * t2 + t)
                + self.slopes[1][c] * (t3 - t2);
        }
        self.lattice.correct(&mut out, p - self.p[0].lerp(self.p[1], t), n - self.n[0].lerp(self.n[1], t));
        out
    }
}

#[cfg(test)]
mod tests;
