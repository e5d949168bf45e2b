// tidy: long: kernels that share one set of sums, and the tests that compare them
//! Rows of texels under a Gaussian, eight at a time.
//!
//! The result does not depend on how texels are split into runs, to the bit. The command `cargo run -p granita-benches
//! --bin peers -- --lookups` measures the gain of vectors.

use crate::gaussian::{Exponents, Gaussian};
use granita_image::Pixels;
use granita_machine::simd::{Kernel, Portable, Simd, Vectors, WIDE, half};
use half::f16;

/// The number of texels that are processed at once.
pub(crate) const LANES: usize = WIDE;

/// The amount that is subtracted from a weight, so that a Gaussian cut off at three deviations ends at 0: `exp (-9/2)`.
pub(crate) const FLOOR: f32 = 0.011_109;

/// A stored value.
pub(crate) trait Texel: Copy {
    /// Returns the value as a number, in its own units.
    fn raw(self) -> f32;

    /// Returns the values of pixels of this type, and `None` for those of another type.
    fn of(pixels: &Pixels) -> Option<&[Self]>;

    /// Returns eight values as numbers.
    #[inline(always)]
    fn eight<S: Simd>(simd: S, values: &[Self; LANES]) -> S::F8 {
        simd.load8(&values.map(Self::raw))
    }
}

impl Texel for u8 {
    #[inline(always)]
    fn of(pixels: &Pixels) -> Option<&[Self]> {
        if let Pixels::U8(v) = pixels { Some(v) } else { None }
    }

    #[inline(always)]
    fn raw(self) -> f32 {
        f32::from(self)
    }

    #[inline(always)]
    fn eight<S: Simd>(simd: S, values: &[Self; LANES]) -> S::F8 {
        simd.bytes8(values)
    }
}

impl Texel for u16 {
    #[inline(always)]
    fn of(pixels: &Pixels) -> Option<&[Self]> {
        if let Pixels::U16(v) = pixels { Some(v) } else { None }
    }

    #[inline(always)]
    fn raw(self) -> f32 {
        f32::from(self)
    }

    #[inline(always)]
    fn eight<S: Simd>(simd: S, values: &[Self; LANES]) -> S::F8 {
        simd.words8(values)
    }
}

impl Texel for u32 {
    #[inline(always)]
    fn of(pixels: &Pixels) -> Option<&[Self]> {
        if let Pixels::U32(v) = pixels { Some(v) } else { None }
    }

    #[inline(always)]
    fn raw(self) -> f32 {
        self as f32
    }
}

impl Texel for f32 {
    #[inline(always)]
    fn of(pixels: &Pixels) -> Option<&[Self]> {
        if let Pixels::Float(v) = pixels { Some(v) } else { None }
    }

    #[inline(always)]
    fn raw(self) -> f32 {
        self
    }

    #[inline(always)]
    fn eight<S: Simd>(simd: S, values: &[Self; LANES]) -> S::F8 {
        simd.load8(values)
    }
}

impl Texel for f16 {
    #[inline(always)]
    fn of(pixels: &Pixels) -> Option<&[Self]> {
        if let Pixels::Half(v) = pixels { Some(v) } else { None }
    }

    /// Returns the number, which is exact for finite values.
    #[inline(always)]
    fn raw(self) -> f32 {
        half(self.to_bits())
    }

    #[inline(always)]
    fn eight<S: Simd>(simd: S, values: &[Self; LANES]) -> S::F8 {
        simd.halves8(&values.map(f16::to_bits))
    }
}

/// Returns `2^x` with a relative error of 1e-6 for `x` in [-120, 120]. Other numbers are clamped to that range.
#[inline(always)]
fn exp2<S: Simd>(simd: S, x: S::F8) -> S::F8 {
    exp2_chains(simd, [x])[0]
}

/// Returns [`exp2`] of several vectors.
#[inline(always)]
fn exp2_chains<S: Simd, const K: usize>(simd: S, mut x: [S::F8; K]) -> [S::F8; K] {
    // Adding 1.5 * 2^23 rounds to integers, which are then in the lowest bits of the sum.
    let round = simd.splat8(12_582_912.0);
    let mut rounded = x;
    let mut p = x;
    for k in 0..K {
        x[k] = simd.min8(simd.max8(x[k], simd.splat8(-120.0)), simd.splat8(120.0));
        rounded[k] = simd.add8(x[k], round);
        x[k] = simd.sub8(x[k], simd.sub8(rounded[k], round));
        // The polynomial approximates 2^f for f in [-0.5, 0.5], by least squares at Chebyshev's points.
        p[k] = simd.splat8(1.321_87e-3);
    }
    for c in [9.671_7e-3, 5.550_893e-2, 0.240_222_38, 0.693_146_9, 1.0] {
        for k in 0..K {
            p[k] = simd.add8(simd.mul8(p[k], x[k]), simd.splat8(c));
        }
    }
    for k in 0..K {
        p[k] = simd.mul8(p[k], simd.power8(rounded[k]));
    }
    p
}

/// Returns `2^x` of one number.
#[inline]
pub(crate) fn exp2_of(x: f32) -> f32 {
    exp2(Portable, [x; LANES])[0]
}

/// One row of texels, from its first one on. Texel `i` belongs to lane `i % 8`, independent of the tiles.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Row {
    exponents: Exponents,
    /// The distance of the first texel from the centre, in texels.
    dx: f32,
    /// The lane of the next texel among the current eight.
    lane: usize,
    weight: [f32; LANES],
    /// The factors to the weights of the next eight.
    step: [f32; LANES],
    state: State,
}

/// The values of a row that have been computed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum State {
    /// No weight has been computed.
    New,
    /// The weights of the current eight, which are the first.
    First,
    /// The weights of the eight before the current ones, which are the first.
    FirstDue,
    /// The weights of the current eight, and the factors to the next.
    Later,
    /// The weights of the eight before the current ones, and the factors.
    LaterDue,
}

impl Row {
    /// Returns a row whose first texel is at the distance `dx` from the centre.
    #[inline]
    pub(crate) fn new(exponents: Exponents, dx: f32) -> Self {
        Self { exponents, dx, lane: 0, weight: [0.0; LANES], step: [0.0; LANES], state: State::New }
    }
}

/// Returns the distances of eight texels from the centre. The first is at `dx`.
#[inline(always)]
fn distances<S: Simd>(simd: S, dx: f32) -> S::F8 {
    simd.add8(simd.splat8(dx), simd.load8(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0]))
}

/// Returns the weights of the first eight texels of a row.
#[inline(always)]
fn first_weights<S: Simd>(simd: S, e: Exponents, dx: f32) -> S::F8 {
    let dx = distances(simd, dx);
    let sum = simd.add8(simd.mul8(simd.splat8(e.a), dx), simd.splat8(e.b));
    exp2(simd, simd.add8(simd.mul8(sum, dx), simd.splat8(e.c)))
}

/// Returns the factors from the weights of the first eight texels to those of the next.
#[inline(always)]
fn first_steps<S: Simd>(simd: S, e: Exponents, dx: f32) -> S::F8 {
    exp2(simd, step_exponents(simd, e, dx))
}

/// Returns the exponents of [`first_steps`].
#[inline(always)]
fn step_exponents<S: Simd>(simd: S, e: Exponents, dx: f32) -> S::F8 {
    const N: f32 = LANES as f32;
    let dx = distances(simd, dx);
    let both = simd.add8(simd.mul8(simd.splat8(2.0 * N), dx), simd.splat8(N * N));
    simd.add8(simd.mul8(simd.splat8(e.a), both), simd.splat8(e.b * N))
}

/// The state of a row in vectors.
struct Weights<S: Simd> {
    simd: S,
    exponents: Exponents,
    dx: f32,
    bend: S::F8,
    weight: S::F8,
    step: S::F8,
    state: State,
}

impl<S: Simd> Weights<S> {
    #[inline(always)]
    fn of(simd: S, row: &Row, bend: f32) -> Self {
        let (weight, step) = (simd.load8(&row.weight), simd.load8(&row.step));
        let (exponents, dx, state) = (row.exponents, row.dx, row.state);
        Self { simd, exponents, dx, bend: simd.splat8(bend), weight, step, state }
    }

    /// Computes the weights of the current eight.
    #[inline(always)]
    fn prepare(&mut self) {
        let simd = self.simd;
        match self.state {
            State::First | State::Later => {}
            State::New => {
                self.weight = first_weights(simd, self.exponents, self.dx);
                self.state = State::First;
            }
            State::FirstDue | State::LaterDue => {
                if self.state == State::FirstDue {
                    self.step = first_steps(simd, self.exponents, self.dx);
                }
                self.weight = simd.mul8(self.weight, self.step);
                self.step = simd.mul8(self.step, self.bend);
                self.state = State::Later;
            }
        }
    }

    /// Advances to the next eight.
    #[inline(always)]
    fn next(&mut self) {
        self.state = if self.state == State::First { State::FirstDue } else { State::LaterDue };
    }

    /// Returns the weights as they are applied.
    #[inline(always)]
    fn lowered(&self) -> S::F8 {
        lowered(self.simd, self.weight)
    }
}

/// Returns weights as they are applied, which end at 0.
#[inline(always)]
fn lowered<S: Simd>(simd: S, weight: S::F8) -> S::F8 {
    simd.max8(simd.sub8(weight, simd.splat8(FLOOR)), simd.splat8(0.0))
}

/// The weighted sums of up to four channels, by lane, relative to the first value. The mean of values that are all
/// equal is exactly that value.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sums {
    base: [f32; 4],
    above: [[f32; LANES]; 4],
    weight: [f32; LANES],
    begun: bool,
    /// The factor from the steps of eight texels to those of the next: `2^(128 a)`.
    bend: f32,
    vectors: Vectors,
}

impl Sums {
    /// Returns empty sums. `a` is that of [`Exponents`]. When `long` is false, no row is longer than eight texels, and
    /// some work is omitted.
    pub(crate) fn new(a: f32, long: bool) -> Self {
        Self {
            base: [0.0; 4],
            above: [[0.0; LANES]; 4],
            weight: [0.0; LANES],
            begun: false,
            bend: if long { exp2_of(2.0 * (LANES * LANES) as f32 * a) } else { 1.0 },
            vectors: Vectors::widest(),
        }
    }

    /// Uses a value as the base when there is none.
    #[inline]
    pub(crate) fn begin(&mut self, value: impl FnOnce() -> [f32; 4]) {
        if !self.begun {
            self.base = value();
            self.begun = true;
        }
    }

    /// Adds the next texel of a row.
    pub(crate) fn add(&mut self, row: &mut Row, value: [f32; 4]) {
        self.begin(|| value);
        let mut weights = Weights::of(Portable, row, self.bend);
        weights.prepare();
        let weight = weights.lowered()[row.lane];
        for ((above, value), base) in self.above.iter_mut().zip(value).zip(self.base) {
            above[row.lane] += weight * (value - base);
        }
        self.weight[row.lane] += weight;
        row.lane += 1;
        if row.lane == LANES {
            row.lane = 0;
            weights.next();
        }
        (row.weight, row.step, row.state) = (weights.weight, weights.step, weights.state);
    }

    /// Adds the next `count` texels of a row, the first `N` of four channels. The value of channel c in the current
    /// lane is `values[at + c * plane]`. The sums must have a base.
    #[inline]
    pub(crate) fn run<T: Texel, const N: usize>(&mut self, row: &mut Row, run: Run<'_, T>) {
        self.vectors.run(AddRun::<T, N> { sums: self, row, run });
    }

    /// Adds rows of an ellipse. `LONG` is false where no row is longer than eight texels.
    #[inline]
    pub(crate) fn rows<T: Texel, const N: usize, const LONG: bool>(
        &mut self,
        g: &Gaussian,
        rows: Rows<'_, T>,
    ) {
        self.vectors.run(AddRows::<T, N, LONG> { sums: self, g, rows });
    }

    /// Returns the weights of eight directions under a lobe.
    #[inline]
    pub(crate) fn weights(&self, dome: &Dome, line: &Line<'_>) -> [f32; LANES] {
        self.vectors.run(DomeWeights { dome, line })
    }

    /// Adds adjacent texels, in the lanes `from .. to` of eight, with these weights. The value of channel c in lane
    /// `from` is `values[at + c * plane]`, and `N` channels count. The sums must have a base.
    #[inline]
    pub(crate) fn weighted<T: Texel, const N: usize>(
        &mut self,
        weights: &[f32; LANES],
        (from, to): (usize, usize),
        (values, at, plane): (&[T], usize, usize),
    ) {
        let texels = Run { values, at, plane, count: to - from };
        self.vectors.run(AddWeighted::<T, N> { sums: self, weights, from, texels });
    }

    /// Returns the mean; `None` when the total weight is 0.
    pub(crate) fn mean(&self) -> Option<[f32; 4]> {
        let total = |v: &[f32; LANES]| ((v[0] + v[4]) + (v[1] + v[5])) + ((v[2] + v[6]) + (v[3] + v[7]));
        let weight = total(&self.weight);
        (weight > 0.0).then(|| std::array::from_fn(|c| self.base[c] + total(&self.above[c]) / weight))
    }
}

/// A Gaussian on the sphere, as the factors to the squares of Lambert's coordinates along its two axes, for the
/// exponent of 2.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Dome {
    pub(crate) scale: [f32; 2],
}

/// Eight directions on a line of a map of all directions, in the frame of a lobe. Component q (0 along the lobe's
/// centre, 1 and 2 along its axes) of direction k is `at[q] + x[k] across[0][q] + y[k] across[1][q]`. Their squared
/// lengths are `squared + x[k]^2`, or 1 when `squared` is `None`. Weights are multiplied by `factor` and the solid
/// angle of the texel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Line<'a> {
    pub(crate) at: [f32; 3],
    pub(crate) across: [[f32; 3]; 2],
    pub(crate) x: &'a [f32; LANES],
    pub(crate) y: &'a [f32; LANES],
    pub(crate) squared: Option<f32>,
    pub(crate) factor: f32,
}

/// The kernel of [`Sums::weights`].
struct DomeWeights<'a> {
    dome: &'a Dome,
    line: &'a Line<'a>,
}

impl Kernel for DomeWeights<'_> {
    type Output = [f32; LANES];

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) -> [f32; LANES] {
        let Self { dome, line } = self;
        let one = simd.splat8(1.0);
        let (x, y) = (simd.load8(line.x), simd.load8(line.y));
        let component = |q: usize| {
            let sum = simd.add8(simd.splat8(line.at[q]), simd.mul8(x, simd.splat8(line.across[0][q])));
            simd.add8(sum, simd.mul8(y, simd.splat8(line.across[1][q])))
        };
        let mut q = [component(0), component(1), component(2)];
        let mut factor = simd.splat8(line.factor);
        if let Some(squared) = line.squared {
            let length = simd.sqrt8(simd.add8(simd.splat8(squared), simd.mul8(x, x)));
            let inverse = simd.div8(one, length);
            q = q.map(|q| simd.mul8(q, inverse));
            factor = simd.mul8(factor, simd.mul8(inverse, simd.mul8(inverse, inverse)));
        }
        let square = |q: S::F8, scale: f32| simd.mul8(simd.mul8(q, q), simd.splat8(scale));
        let sum = simd.add8(square(q[1], dome.scale[0]), square(q[2], dome.scale[1]));
        let below = simd.max8(simd.add8(one, q[0]), simd.splat8(1e-6));
        let exponent = simd.div8(simd.mul8(sum, simd.splat8(2.0)), below);
        let weight = simd.max8(simd.sub8(exp2(simd, exponent), simd.splat8(FLOOR)), simd.splat8(0.0));
        simd.store8(simd.mul8(weight, factor))
    }
}

/// The kernel of [`Sums::weighted`].
struct AddWeighted<'a, T, const N: usize> {
    sums: &'a mut Sums,
    weights: &'a [f32; LANES],
    /// The lane of the first texel.
    from: usize,
    texels: Run<'a, T>,
}

impl<T: Texel, const N: usize> Kernel for AddWeighted<'_, T, N> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let Self { sums, weights, from, texels: Run { values, at, plane, count } } = self;
        let to = from + count;
        let mut taken = Taken::<S, N>::of(simd, sums);
        let weight = simd.only8(simd.load8(weights), from, to);
        taken.total = simd.add8(taken.total, weight);
        for c in 0..N {
            let first = (at + c * plane) as isize - from as isize;
            let above = simd.sub8(eight(simd, values, first, from, to), taken.base[c]);
            taken.above[c] = simd.add8(taken.above[c], simd.mul8(weight, above));
        }
        taken.put(sums);
    }
}

/// Adjacent texels of a row, for [`Sums::run`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Run<'a, T> {
    pub(crate) values: &'a [T],
    pub(crate) at: usize,
    pub(crate) plane: usize,
    pub(crate) count: usize,
}

/// Rows of an image that lie under an ellipse and in one row of tiles, for [`Sums::rows`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Rows<'a, T> {
    /// The tiles from left to right. They hold all columns of the ellipse.
    pub(crate) pieces: &'a [Piece<'a, T>],
    /// The centre of the ellipse, in texels of the image.
    pub(crate) centre: (f32, f32),
    /// The rows `y.0 .. y.1` of the image.
    pub(crate) y: (i32, i32),
}

/// One of the tiles of [`Rows`]. The value of channel c at column x and row y of the image is
/// `values[at + x + y * stride + c * plane]`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Piece<'a, T> {
    pub(crate) values: &'a [T],
    pub(crate) at: isize,
    pub(crate) stride: usize,
    pub(crate) plane: usize,
    /// The first column that belongs to the next tile.
    pub(crate) to: i32,
}

impl<T> Piece<'_, T> {
    /// Returns the index of the first channel at a column and row.
    #[inline(always)]
    fn index(&self, x: i32, y: i32) -> isize {
        self.at + x as isize + y as isize * self.stride as isize
    }
}

/// The kernel of [`Sums::run`].
struct AddRun<'a, T, const N: usize> {
    sums: &'a mut Sums,
    row: &'a mut Row,
    run: Run<'a, T>,
}

impl<T: Texel, const N: usize> Kernel for AddRun<'_, T, N> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let Self { sums, row, run } = self;
        let mut taken = Taken::<S, N>::of(simd, sums);
        let mut weights = Weights::of(simd, row, sums.bend);
        row.lane = taken.chunks(&mut weights, row.lane, run);
        (row.weight, row.step, row.state) =
            (simd.store8(weights.weight), simd.store8(weights.step), weights.state);
        taken.put(sums);
    }
}

/// The number of rows whose weights are computed at once. Each exponential is a long chain of operations, and several
/// chains together keep the processor busy.
const CHAINS: usize = 4;

/// The covered texels of eight rows.
struct Spans {
    /// The first column of each row. For a row without texels it is any column of the first tile.
    x: [i32; LANES],
    /// The number of texels of each row.
    count: [usize; LANES],
    /// The exponents of each row, with the same `a`.
    dx: [f32; LANES],
    b: [f32; LANES],
    c: [f32; LANES],
}

impl Spans {
    /// Returns the spans of the rows `y.0 .. y.1`, at most eight, with the numbers of [`Gaussian::row`] and
    /// [`Gaussian::exponents`].
    #[inline(always)]
    fn of<S: Simd>(simd: S, g: &Gaussian, (cx, cy): (f32, f32), y: (i32, i32), some_column: i32) -> Self {
        let mut rows = [0.0; LANES];
        for (k, row) in rows.iter_mut().enumerate() {
            *row = (y.0 + k as i32) as f32;
        }
        let dy = simd.sub8(simd.load8(&rows), simd.splat8(cy));
        let row = g.row_shape();
        let decrease = simd.mul8(simd.mul8(simd.splat8(row.half.1), dy), dy);
        let squared = simd.sub8(simd.splat8(row.half.0), decrease);
        let covered = simd.le8(simd.splat8(0.0), squared);
        let middle = simd.add8(simd.splat8(cx), simd.mul8(simd.splat8(row.slant), dy));
        let half = simd.sqrt8(squared);
        let (from, to) = (simd.floor8(simd.sub8(middle, half)), simd.floor8(simd.add8(middle, half)));
        let (mut x, mut count, mut dx) = ([0; LANES], [0; LANES], [0.0; LANES]);
        for k in 0..LANES {
            let is_covered = covered >> k & 1 == 1 && from[k] < to[k] && y.0 + (k as i32) < y.1;
            x[k] = if is_covered { from[k] + 1 } else { some_column };
            count[k] = if is_covered { (to[k] - from[k]) as usize } else { 0 };
            dx[k] = x[k] as f32 - cx;
        }
        let b = simd.store8(simd.mul8(simd.splat8(row.b), dy));
        let c = simd.store8(simd.mul8(simd.mul8(simd.splat8(row.c), dy), dy));
        Self { x, count, dx, b, c }
    }
}

/// The kernel of [`Sums::rows`].
struct AddRows<'a, T, const N: usize, const LONG: bool> {
    sums: &'a mut Sums,
    g: &'a Gaussian,
    rows: Rows<'a, T>,
}

impl<T: Texel, const N: usize, const LONG: bool> Kernel for AddRows<'_, T, N, LONG> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, simd: S) {
        let Self { sums, g, rows } = self;
        let Rows { pieces, centre, y: (mut y, end) } = rows;
        let zero = simd.splat8(0.0);
        let mut taken = if sums.begun { Taken::<S, N>::of(simd, sums) } else { Taken::empty(simd) };
        let bend = simd.splat8(sums.bend);
        while y < end {
            let spans = Spans::of(simd, g, centre, (y, end), pieces[0].to - 1);
            if !sums.begun {
                let Some(k) = spans.count.iter().position(|count| *count > 0) else {
                    y += LANES as i32;
                    continue;
                };
                sums.begun = true;
                let (x, row) = (spans.x[k], y + k as i32);
                let piece = pieces.iter().find(|piece| x < piece.to).unwrap_or(&pieces[0]);
                let at = piece.index(x, row) as usize;
                for c in 0..N {
                    sums.base[c] = piece.values[at + c * piece.plane].raw();
                    taken.base[c] = simd.splat8(sums.base[c]);
                }
            }
            let mut group = 0;
            while group < LANES && y + (group as i32) < end {
                let mut weights = [zero; CHAINS];
                for (k, weight) in weights.iter_mut().enumerate() {
                    let k = group + k;
                    let dx = distances(simd, spans.dx[k]);
                    let sum = simd.add8(simd.mul8(simd.splat8(g.xx), dx), simd.splat8(spans.b[k]));
                    *weight = simd.add8(simd.mul8(sum, dx), simd.splat8(spans.c[k]));
                }
                weights = exp2_chains(simd, weights);
                let counts = &spans.count[group..group + CHAINS];
                let mut steps = [zero; CHAINS];
                if LONG && counts.iter().any(|count| *count > LANES) {
                    for (k, step) in steps.iter_mut().enumerate() {
                        let k = group + k;
                        let exponents = Exponents { a: g.xx, b: spans.b[k], c: spans.c[k] };
                        *step = step_exponents(simd, exponents, spans.dx[k]);
                    }
                    steps = exp2_chains(simd, steps);
                }
                for k in 0..CHAINS {
                    let (count, x) = (spans.count[group + k], spans.x[group + k]);
                    if !LONG && let [piece] = pieces {
                        // Rows without texels add 0. Without a branch they cost less.
                        let row = (y + (group + k) as i32).min(end - 1);
                        let weight = simd.only8(lowered(simd, weights[k]), 0, count);
                        taken.total = simd.add8(taken.total, weight);
                        taken.add(weight, piece, piece.index(x, row), (0, count));
                    } else if count > 0 {
                        let row = y + (group + k) as i32;
                        taken.add_row((weights[k], steps[k], bend), pieces, (x, row), count);
                    }
                }
                group += CHAINS;
            }
            y += LANES as i32;
        }
        taken.put(sums);
    }
}

/// The state of sums in vectors.
struct Taken<S: Simd, const N: usize> {
    simd: S,
    base: [S::F8; N],
    above: [S::F8; N],
    total: S::F8,
}

impl<S: Simd, const N: usize> Taken<S, N> {
    /// Returns empty sums without a base.
    #[inline(always)]
    fn empty(simd: S) -> Self {
        let zero = simd.splat8(0.0);
        Self { simd, base: [zero; N], above: [zero; N], total: zero }
    }

    #[inline(always)]
    fn of(simd: S, sums: &Sums) -> Self {
        Self {
            simd,
            base: std::array::from_fn(|c| simd.splat8(sums.base[c])),
            above: std::array::from_fn(|c| simd.load8(&sums.above[c])),
            total: simd.load8(&sums.weight),
        }
    }

    #[inline(always)]
    fn put(&self, sums: &mut Sums) {
        for c in 0..N {
            sums.above[c] = self.simd.store8(self.above[c]);
        }
        sums.weight = self.simd.store8(self.total);
    }

    /// Adds the texels of the lanes `from .. to` of a tile. `at` is the index of the first channel in lane 0.
    #[inline(always)]
    fn add<T: Texel>(&mut self, weight: S::F8, piece: &Piece<'_, T>, at: isize, (from, to): (usize, usize)) {
        let simd = self.simd;
        for c in 0..N {
            let first = at + (c * piece.plane) as isize;
            let above = simd.sub8(eight(simd, piece.values, first, from, to), self.base[c]);
            self.above[c] = simd.add8(self.above[c], simd.mul8(weight, above));
        }
    }

    /// Adds `count` texels from (x, y) to the right. The weights are those of the first eight, the factors to those of
    /// the next, and the factor from these factors to the next.
    #[inline(always)]
    fn add_row<T: Texel>(
        &mut self,
        (mut weight, mut step, bend): (S::F8, S::F8, S::F8),
        pieces: &[Piece<'_, T>],
        (mut x, y): (i32, i32),
        count: usize,
    ) {
        let simd = self.simd;
        let end = x + count as i32;
        let mut lane = 0;
        for piece in pieces {
            let stop = end.min(piece.to);
            while x < stop {
                let to = (lane + (stop - x) as usize).min(LANES);
                let mut part = lowered(simd, weight);
                if to - lane < LANES {
                    part = simd.only8(part, lane, to);
                }
                self.total = simd.add8(self.total, part);
                self.add(part, piece, piece.index(x - lane as i32, y), (lane, to));
                x += (to - lane) as i32;
                lane = to;
                if lane == LANES {
                    lane = 0;
                    weight = simd.mul8(weight, step);
                    step = simd.mul8(step, bend);
                }
            }
        }
    }

    /// Adds a run that begins at `lane`. Returns the lane of the next texel.
    #[inline(always)]
    fn chunks<T: Texel>(&mut self, weights: &mut Weights<S>, mut lane: usize, run: Run<'_, T>) -> usize {
        let simd = self.simd;
        let Run { values, at, plane, mut count } = run;
        // The index of the value in lane 0, for the first channel. It may be negative.
        let mut at = at as isize - lane as isize;
        while count > 0 {
            let (from, to) = (lane, (lane + count).min(LANES));
            weights.prepare();
            let mut weight = weights.lowered();
            if to - from < LANES {
                weight = simd.only8(weight, from, to);
            }
            self.total = simd.add8(self.total, weight);
            for c in 0..N {
                let first = at + (c * plane) as isize;
                let above = simd.sub8(eight(simd, values, first, from, to), self.base[c]);
                self.above[c] = simd.add8(self.above[c], simd.mul8(weight, above));
            }
            count -= to - from;
            lane = to;
            if to == LANES {
                lane = 0;
                at += LANES as isize;
                weights.next();
            }
        }
        lane
    }
}

/// Returns the eight values from `first` on. Lanes outside `from .. to` may hold any value.
#[inline(always)]
fn eight<S: Simd, T: Texel>(simd: S, values: &[T], first: isize, from: usize, to: usize) -> S::F8 {
    // A negative index becomes a number far behind the end.
    let at = first as usize;
    match values.get(at..at.wrapping_add(LANES)).and_then(|v| v.first_chunk::<LANES>()) {
        Some(eight) => T::eight(simd, eight),
        None => simd.load8(&few(values, first, from, to)),
    }
}

/// Implements [`eight`] at the ends of a tile.
#[cold]
#[inline(never)]
fn few<T: Texel>(values: &[T], first: isize, from: usize, to: usize) -> [f32; LANES] {
    let mut out = [0.0; LANES];
    for (i, out) in out.iter_mut().enumerate().take(to).skip(from) {
        *out = values[(first + i as isize) as usize].raw();
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::footprint::Spread;

    fn noise(i: u32) -> f32 {
        granita_base::hash::unit(granita_base::hash::words(&[i]))
    }

    #[test]
    fn exp2_is_accurate() {
        for i in -2400..=2400 {
            let x = i as f32 * 0.05;
            let (got, exact) = (exp2_of(x), f64::from(x).exp2());
            assert!((f64::from(got) / exact - 1.0).abs() < 1e-6, "{x}: {got}");
        }
        assert!(exp2_of(f32::NEG_INFINITY) < 1e-35);
    }

    #[test]
    fn halves_convert_like_the_library() {
        for bits in 0..=u16::MAX {
            let half = f16::from_bits(bits);
            if half.is_finite() {
                assert_eq!(half.raw().to_bits(), half.to_f32().to_bits(), "{bits}");
            }
        }
    }

    #[test]
    fn texels_are_the_same_on_wide_and_portable_vectors() {
        fn same<T: Texel + std::fmt::Debug>(values: [T; LANES]) {
            struct Stored<T>([T; LANES]);

            impl<T: Texel> Kernel for Stored<T> {
                type Output = [u32; LANES];

                #[inline(always)]
                fn run<S: Simd>(self, simd: S) -> [u32; LANES] {
                    simd.store8(T::eight(simd, &self.0)).map(f32::to_bits)
                }
            }

            let raw = values.map(|v| v.raw().to_bits());
            assert_eq!(Vectors::widest().run(Stored(values)), raw, "{values:?}");
            assert_eq!(Vectors::PORTABLE.run(Stored(values)), raw, "{values:?}");
        }
        same([0_u8, 1, 2, 127, 128, 200, 254, 255]);
        same([0_u16, 1, 255, 256, 32767, 32768, 65534, 65535]);
        same([0_u32, 1, 1 << 24, (1 << 24) + 1, u32::MAX, 5, 6, 7]);
        same([0.0_f32, -0.0, 1e30, -1e30, 1e-40, 0.1, 0.2, 0.3]);
        same([0_u16, 1, 0x3ff, 0x400, 0x3c00, 0x7bff, 0xfbff, 0x8001].map(f16::from_bits));
    }

    #[test]
    fn lobes_are_the_same_on_wide_and_portable_vectors() {
        let sums = Sums::new(0.0, false);
        let portable = Sums { vectors: Vectors::PORTABLE, ..sums };
        for i in 0..200 {
            let r = |k: u32| 2.0 * noise(i * 64 + k) - 1.0;
            let line = Line {
                at: [r(0), r(1), r(2)],
                across: [[r(3), r(4), r(5)], [r(6), r(7), r(8)]],
                x: &std::array::from_fn(|k| r(10 + k as u32)),
                y: &std::array::from_fn(|k| r(20 + k as u32)),
                squared: (i % 2 == 0).then_some(1.0 + r(9) * r(9)),
                factor: 0.5,
            };
            let dome = Dome { scale: [-10.0 * noise(i), -3.0] };
            let got = sums.weights(&dome, &line);
            assert_eq!(got.map(f32::to_bits), portable.weights(&dome, &line).map(f32::to_bits));
            // The expected value follows the formula, with Lambert's coordinates of the direction.
            let k = (i % 8) as usize;
            let q =
                [0, 1, 2].map(|q| line.at[q] + line.x[k] * line.across[0][q] + line.y[k] * line.across[1][q]);
            let length = line.squared.map_or(1.0, |squared| (squared + line.x[k] * line.x[k]).sqrt());
            let q = q.map(|q| q / length);
            let exponent =
                2.0 * (dome.scale[0] * q[1] * q[1] + dome.scale[1] * q[2] * q[2]) / (1.0 + q[0]).max(1e-6);
            let expected = (exponent.exp2() - FLOOR).max(0.0) * 0.5 / length.powi(3);
            assert!((got[k] - expected).abs() < 1e-5, "{line:?}: {} {expected}", got[k]);
        }
    }

    /// The sums are the same to the bit for all splits into runs, and on all machines.
    #[test]
    fn sums_do_not_depend_on_runs_or_the_machine() {
        let values: Vec<f32> = (0..3 * 100).map(noise).collect();
        let exponents = Exponents { a: -0.003, b: 0.01, c: -0.2 };
        let sum = |cuts: &[usize], portable: bool| {
            let mut sums = Sums::new(exponents.a, true);
            if portable {
                sums.vectors = Vectors::PORTABLE;
            }
            sums.begin(|| [0.5, 0.25, 0.125, 0.0]);
            let mut row = Row::new(exponents, -30.0);
            let mut x = 0;
            for &count in cuts {
                sums.run::<f32, 3>(&mut row, Run { values: &values, at: x, plane: 100, count });
                x += count;
            }
            sums.mean().unwrap().map(f32::to_bits)
        };
        let whole = sum(&[77], true);
        for cuts in [&[77][..], &[3, 74], &[8, 69], &[1, 1, 1, 20, 9, 45], &[76, 1]] {
            assert_eq!(sum(cuts, false), whole, "{cuts:?}");
            assert_eq!(sum(cuts, true), whole, "{cuts:?}");
        }
        // The texels are added one by one.
        let mut sums = Sums::new(exponents.a, true);
        sums.begin(|| [0.5, 0.25, 0.125, 0.0]);
        let mut row = Row::new(exponents, -30.0);
        for x in 0..77 {
            sums.add(&mut row, [values[x], values[100 + x], values[200 + x], 0.0]);
        }
        assert_eq!(sums.mean().unwrap().map(f32::to_bits), whole);
    }

    /// Rows of an ellipse give the sums of single texels, to the bit, for all tiles and on all machines.
    #[test]
    fn rows_are_the_same_as_texels_one_by_one() {
        const WIDTH: usize = 400;
        const HEIGHT: usize = 230;

        fn same<T: Texel>(values: &[T], i: u32) {
            let r = |k: u32| f64::from(noise(i * 16 + k));
            // Half of the ellipses are short enough for eight texels.
            let (long, short) = if i.is_multiple_of(2) { (2.0, 1.2) } else { (60.0, 1.2 + 10.0 * r(0)) };
            let (a, b) = ((long * r(1)).max(short), short);
            let (sin, cos) = (6.3 * r(2)).sin_cos();
            let (aa, bb) = (a * a, b * b);
            let g = Gaussian::new(Spread {
                xx: aa * cos * cos + bb * sin * sin,
                xy: (aa - bb) * sin * cos,
                yy: aa * sin * sin + bb * cos * cos,
            });
            let centre = (180.0 + 40.0 * noise(i * 16 + 3), 110.0 + 9.0 * noise(i * 16 + 4));
            let y = (
                crate::gaussian::floor(centre.1 - g.reach.1) + 1,
                crate::gaussian::floor(centre.1 + g.reach.1) + 1,
            );
            assert!(0 <= y.0 && y.1 <= HEIGHT as i32, "the image is large enough");
            let mut plain = Sums::new(g.xx, true);
            for y in y.0..y.1 {
                let dy = y as f32 - centre.1;
                let Some((from, to)) = g.row(centre.0, dy) else { continue };
                let mut row = Row::new(g.exponents(dy), from as f32 - centre.0);
                for x in from..to {
                    let at = y as usize * 3 * WIDTH + x as usize;
                    let value = |c: usize| values[at + c * WIDTH].raw();
                    plain.add(&mut row, [value(0), value(1), value(2), 0.0]);
                }
            }
            let expected = plain.mean().map(|mean| mean.map(f32::to_bits));
            for cuts in [&[WIDTH as i32][..], &[190, WIDTH as i32], &[100, 181, 185, 200, 210, WIDTH as i32]]
            {
                // Each tile holds a copy of its columns.
                let starts: Vec<i32> = std::iter::once(0).chain(cuts.iter().copied()).collect();
                let tiles: Vec<(Vec<T>, i32, i32)> = starts
                    .windows(2)
                    .map(|cut| {
                        let rows = values.chunks(WIDTH);
                        let tile = rows.flat_map(|row| &row[cut[0] as usize..cut[1] as usize]).copied();
                        (tile.collect(), cut[0], cut[1])
                    })
                    .collect();
                let pieces: Vec<Piece<'_, T>> = tiles
                    .iter()
                    .map(|(values, from, to)| {
                        let plane = (to - from) as usize;
                        Piece { values, at: -*from as isize, stride: 3 * plane, plane, to: *to }
                    })
                    .collect();
                // The rows are added in two parts.
                let middle = y.0 + (y.1 - y.0) * (i as i32 % 5) / 5;
                for vectors in [Vectors::widest(), Vectors::PORTABLE] {
                    let mut sums = Sums { vectors, ..Sums::new(g.xx, g.is_long()) };
                    for y in [(y.0, middle), (middle, y.1)] {
                        let rows = Rows { pieces: &pieces, centre, y };
                        if g.is_long() {
                            sums.rows::<T, 3, true>(&g, rows);
                        } else {
                            sums.rows::<T, 3, false>(&g, rows);
                        }
                    }
                    assert_eq!(sums.mean().map(|mean| mean.map(f32::to_bits)), expected, "{i} {cuts:?}");
                }
            }
        }

        let noises: Vec<f32> = (0..(3 * WIDTH * HEIGHT) as u32).map(noise).collect();
        let bytes: Vec<u8> = noises.iter().map(|v| (v * 255.0) as u8).collect();
        let halves: Vec<f16> = noises.iter().map(|v| f16::from_f32(v * 1000.0 - 500.0)).collect();
        for i in 0..120 {
            same(&bytes, i);
            same(&halves, i);
            same(&noises, i);
        }
    }
}
