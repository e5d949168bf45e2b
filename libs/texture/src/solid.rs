//! The weighted mean of all texels of a map of all directions under an ellipse on the sphere. Each texel is weighted by
//! its solid angle.
//!
//! Weights are a Gaussian in the coordinates of Lambert's azimuthal projection around the direction, which keeps areas
//! and reaches over the whole sphere. For a round footprint that is the distribution of von Mises and Fisher. As for
//! images (see `gaussian`), it ends at [`CUT`] deviations and is made narrower by the spread of a texel. Texels are
//! found by direction, so that it reaches over edges and corners of cubes, and over the seam and the poles of a
//! latitude-longitude map.

use crate::cube::CubeLayout;
use crate::footprint::Spread;
use crate::gaussian::{CUT, KEPT};
use crate::sampler::Sampler;
use crate::simd::{Dome, LANES, Line, Sums};
use granita_base::Vec3;
use std::f64::consts::{FRAC_PI_2, PI, TAU};
use std::ops::RangeInclusive;

/// The angle from the centre, in radians, beyond which the outline of a footprint on a face is not solved for. All
/// texels are then checked.
const NARROW_CONE: f64 = 1.2;

/// Half the angle that a face covers along its diagonal, in radians.
const CORNER: f64 = 0.955_317;

/// A Gaussian around a direction.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Lobe {
    /// The unit vectors of the centre and of the axes of the ellipse.
    centre: Vec3,
    axes: [Vec3; 2],
    dome: Dome,
    /// The centre and the two axes in double precision.
    frame: [[f64; 3]; 3],
    /// The angles in radians from the centre at which it ends, along the axes.
    ends: [f64; 2],
    /// The squared full widths in radians along the directions east and north of the centre.
    spread: Spread,
}

/// Returns the interval on which `a x^2 + 2 b x + c` is not negative, when that is an interval. Returns `whole`
/// otherwise, and `None` where it is negative everywhere.
fn interval(a: f64, b: f64, c: f64, whole: (f64, f64)) -> Option<(f64, f64)> {
    if a >= 0.0 {
        return Some(whole);
    }
    let root = b * b - a * c;
    if root < 0.0 {
        return None;
    }
    let root = root.sqrt();
    let (from, to) = ((-b + root) / a, (-b - root) / a);
    let (from, to) = (from.max(whole.0), to.min(whole.1));
    (from <= to).then_some((from, to))
}

/// Returns the indices of those of `n` cells in [-1, 1] whose centres lie between `from` and `to`.
fn cells((from, to): (f64, f64), n: u32) -> RangeInclusive<i32> {
    let at = |v: f64| (v + 1.0) * 0.5 * f64::from(n) - 0.5;
    at(from).ceil().max(0.0) as i32..=at(to).floor().min(f64::from(n) - 1.0) as i32
}

impl Lobe {
    /// Returns the lobe around `centre`, a unit vector, with these squared full widths along the unit vectors `east`
    /// and `north`, in radians. Texels cover `texel` radians along these.
    pub(crate) fn new(centre: Vec3, (east, north): (Vec3, Vec3), spread: Spread, texel: (f64, f64)) -> Self {
        let own = |squared: f64, texel: f64| (squared - texel * texel / 3.0) / KEPT;
        let inner = Spread { xx: own(spread.xx, texel.0), xy: spread.xy / KEPT, yy: own(spread.yy, texel.1) };
        let e = inner.ellipse();
        let axis = e.axis;
        let long = east * axis[0] + north * axis[1];
        let deviations = [0.5 * e.a, 0.5 * e.b.max(0.1 * texel.0.min(texel.1))];
        let end = |deviation: f64| 2.0 * libm::asin((0.5 * f64::from(CUT) * deviation).min(1.0));
        let scale = |deviation: f64| (-0.5 * std::f64::consts::LOG2_E / (deviation * deviation)) as f32;
        let axes = [long, centre.cross(long)];
        let frame = [centre, axes[0], axes[1]].map(|v| [f64::from(v.x), f64::from(v.y), f64::from(v.z)]);
        Self {
            centre,
            axes,
            frame,
            dome: Dome { scale: deviations.map(scale) },
            ends: deviations.map(end),
            spread: inner,
        }
    }

    /// Returns the components of a vector along the centre and the axes.
    #[inline]
    fn in_frame(&self, x: f64, y: f64, z: f64) -> [f32; 3] {
        let [a, b, c] = &self.frame;
        let dot = |q: &[f64; 3]| (q[0] * x + q[1] * y + q[2] * z) as f32;
        [dot(a), dot(b), dot(c)]
    }
}

/// An angle by its cosine and sine.
#[derive(Clone, Copy)]
struct Turn {
    cos: f64,
    sin: f64,
}

impl Turn {
    fn by(angle: f64) -> Self {
        let (sin, cos) = libm::sincos(angle);
        Self { cos, sin }
    }

    #[inline]
    fn then(self, other: Self) -> Self {
        Self {
            cos: self.cos * other.cos - self.sin * other.sin,
            sin: self.sin * other.cos + self.cos * other.sin,
        }
    }
}

/// True when any weight is not 0. Nearly all texels outside the footprint have no weight.
fn any(weights: &[f32; LANES]) -> bool {
    weights.iter().any(|w| *w > 0.0)
}

impl Sampler<'_> {
    /// Returns the mean of a level of a cube; `None` when no texel's centre has weight.
    pub(crate) fn cube_mean(&mut self, level: usize, lobe: &Lobe) -> Option<[f32; 4]> {
        let layout: CubeLayout = self.file.layout;
        let n = self.level(level).face_width;
        let per_column = 1.0 / f64::from(n);
        let mut sums = Sums::new(0.0, false);
        for (face, f) in layout.faces().iter().enumerate() {
            let in_face = |v: Vec3| [v.dot(f.forward), v.dot(f.right), v.dot(f.up)].map(f64::from);
            let r = in_face(lobe.centre);
            if libm::acos(r[0].clamp(-1.0, 1.0)) > lobe.ends[0] + CORNER {
                continue;
            }
            // The footprint lies in the cone (d.r)^2 >= (d.e0 / tan end_0)^2 + (d.e1 / tan end_1)^2. On the face, where
            // d = (1, x, y), that is a quadratic form. Its largest extent gives the rows, and each row gives its
            // columns.
            let narrow = lobe.ends[0] < NARROW_CONE;
            let mut m = [[0.0_f64; 3]; 3];
            if narrow {
                let e = lobe.axes.map(in_face);
                let inverse = lobe.ends.map(|end| (1.03 * libm::tan(end)).powi(-2));
                for (i, row) in m.iter_mut().enumerate() {
                    for (j, v) in row.iter_mut().enumerate() {
                        *v = r[i] * r[j] - e[0][i] * e[0][j] * inverse[0] - e[1][i] * e[1][j] * inverse[1];
                    }
                }
            }
            let all = (-1.0, 1.0);
            let extent = if m[1][1] < 0.0 {
                let a = m[1][2] * m[1][2] - m[1][1] * m[2][2];
                let b = m[0][1] * m[1][2] - m[1][1] * m[0][2];
                interval(a, b, m[0][1] * m[0][1] - m[1][1] * m[0][0], all)
            } else {
                Some(all)
            };
            let Some((low, high)) = extent else { continue };
            // Rows run downward.
            for j in cells((-high, -low), n) {
                let y = 1.0 - (2.0 * f64::from(j) + 1.0) / f64::from(n);
                let (b, c) = (m[0][1] + m[1][2] * y, m[0][0] + (2.0 * m[0][2] + m[2][2] * y) * y);
                let Some(columns) = interval(if narrow { m[1][1] } else { 1.0 }, b, c, all) else { continue };
                let columns = cells(columns, n);
                let (left, top) = self.file.face_origin(self.level(level), face);
                let at = {
                    let d = f.forward.as_dvec3() + f.up.as_dvec3() * y;
                    lobe.in_frame(d.x, d.y, d.z)
                };
                let right = {
                    let d = f.right.as_dvec3();
                    lobe.in_frame(d.x, d.y, d.z)
                };
                for i in columns.clone().step_by(LANES) {
                    let twice = |k: usize| 2.0 * f64::from(i + k as i32) + 1.0;
                    // Where the quotient is a product, to the bit, the product is faster.
                    let x = if n.is_power_of_two() {
                        std::array::from_fn(|k| (twice(k) * per_column - 1.0) as f32)
                    } else {
                        std::array::from_fn(|k| (twice(k) / f64::from(n) - 1.0) as f32)
                    };
                    let line = Line {
                        at,
                        across: [right, [0.0; 3]],
                        x: &x,
                        y: &[0.0; LANES],
                        squared: Some((1.0 + y * y) as f32),
                        factor: 1.0,
                    };
                    let weights = sums.weights(&lobe.dome, &line);
                    if any(&weights) {
                        let lanes = (0, LANES.min((columns.end() + 1 - i) as usize));
                        self.add_weighted(
                            level,
                            (left + i as u32, top + j as u32),
                            &weights,
                            lanes,
                            &mut sums,
                        );
                    }
                }
            }
        }
        self.mean_of(&sums)
    }

    /// Returns the mean of a level of a latitude-longitude map; `None` when no texel's centre has weight. The lobe is
    /// in the frame of the map (x to the centre of the image, y to the right of it, z to its upper edge).
    pub(crate) fn latlong_mean(&mut self, level: usize, lobe: &Lobe) -> Option<[f32; 4]> {
        let (width, height) = (self.level(level).width, self.level(level).height);
        let r = lobe.centre.as_dvec3();
        let around = libm::hypot(r.x, r.y);
        let (polar, azimuth) = (libm::atan2(around, r.z), libm::atan2(r.y, r.x));
        let end = lobe.ends[0];
        let per_row = PI / f64::from(height);
        let per_column = TAU / f64::from(width);
        let outline = Outline::new(lobe, polar);
        let row_of = |angle: f64| angle / per_row - 0.5;
        let (first, last) =
            (row_of(polar - end).ceil().max(0.0), row_of(polar + end).floor().min(f64::from(height) - 1.0));
        // The directions of the columns to the right of a column are its direction, rotated.
        let (next_row, next_column) = (Turn::by(per_row), Turn::by(per_column));
        let (mut x, mut y, mut eight) = ([0.0; LANES], [0.0; LANES], Turn::by(0.0));
        for k in 0..LANES {
            (x[k], y[k]) = (eight.cos as f32, eight.sin as f32);
            eight = eight.then(next_column);
        }
        let mut row = Turn::by((first + 0.5) * per_row);
        let mut sums = Sums::new(0.0, false);
        for j in first as i32..=last as i32 {
            let angle = (f64::from(j) + 0.5) * per_row;
            let Turn { cos, sin } = row;
            row = row.then(next_row);
            let Some((from, to)) = outline.columns(polar - angle, (sin, cos), (around, r.z)) else {
                continue;
            };
            // The middle of column i is at azimuth (i + 1/2) per_column - pi.
            let column = |v: f64| (v + azimuth + PI) / per_column - 0.5;
            let (begin, end) = (column(from).ceil(), column(to).floor());
            let count = ((end - begin) as i64 + 1).clamp(0, i64::from(width)) as usize;
            let mut direction = Turn::by((begin + 0.5) * per_column - PI);
            let at = lobe.in_frame(0.0, 0.0, cos);
            for k in (0..count).step_by(LANES) {
                let (east, north) = (direction.cos * sin, direction.sin * sin);
                direction = direction.then(eight);
                let across = [lobe.in_frame(east, north, 0.0), lobe.in_frame(-north, east, 0.0)];
                let line = Line { at, across, x: &x, y: &y, squared: None, factor: sin as f32 };
                let weights = sums.weights(&lobe.dome, &line);
                if !any(&weights) {
                    continue;
                }
                // At the seam the row continues at its start.
                let (mut lane, lanes) = (0, LANES.min(count - k));
                while lane < lanes {
                    let column = (begin as i64 + (k + lane) as i64).rem_euclid(i64::from(width)) as u32;
                    let end = lanes.min(lane + (width - column) as usize);
                    self.add_weighted(level, (column, j as u32), &weights, (lane, end), &mut sums);
                    lane = end;
                }
            }
        }
        self.mean_of(&sums)
    }
}

/// The part of the rows of a latitude-longitude map that a footprint may cover. It is the cap around all of it or,
/// where that is smaller, the ellipse as it would lie on a plane, widened by the curvature of the rows.
struct Outline {
    cos_end: f64,
    /// The widened squared half widths, east and north, in squared radians.
    xx: f64,
    xy: f64,
    yy: f64,
}

impl Outline {
    fn new(lobe: &Lobe, polar: f64) -> Self {
        let end = lobe.ends[0];
        let least = libm::sin((polar - end).min(PI - polar - end).max(0.0)).max(1e-9);
        // The distance to the north differs by this much, in radians, from the difference of polar angles.
        let bent = libm::cos(polar).abs() * end * end / (2.0 * least) + end * end * end;
        let half = 0.5 * f64::from(CUT) * 1.03;
        let s = lobe.spread;
        let short = s.ellipse().b * half;
        let more = (short + bent).powi(2) - short * short;
        let squared = half * half;
        let cos_end = if end >= 2.0 * FRAC_PI_2 { -1.0 } else { libm::cos(end) };
        Self { cos_end, xx: s.xx * squared + more, xy: s.xy * squared, yy: s.yy * squared + more }
    }

    /// Returns the interval of azimuths from the centre, in radians, that a row `north` of it covers; `None` for a row
    /// beyond the cap. The row and the centre are given by the sine and the cosine of their polar angle.
    fn columns(&self, north: f64, (sin, cos): (f64, f64), centre: (f64, f64)) -> Option<(f64, f64)> {
        let (rest, most) = (self.cos_end - cos * centre.1, sin * centre.0);
        if rest > most {
            return None;
        }
        let (middle, squared) = (
            self.xy / self.yy * north,
            (self.xx - self.xy * self.xy / self.yy) * (1.0 - north * north / self.yy),
        );
        let reach = squared.max(0.0).sqrt();
        let extent = reach + middle.abs();
        if extent.is_finite() && extent <= 0.8 * sin {
            // An arc is longer than its chord.
            let longer = |v: f64| v / sin * (1.0 + 0.5 * v * v / (sin * sin));
            return Some((longer(middle - reach), longer(middle + reach)));
        }
        let half = if rest <= -most { PI } else { libm::acos(rest / most) };
        Some((-half, half))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ray_intervals_are_clipped() {
        assert_eq!(interval(-1.0, 0.0, 0.25, (-1.0, 1.0)), Some((-0.5, 0.5)));
        assert_eq!(interval(-1.0, 0.0, -0.25, (-1.0, 1.0)), None);
        assert_eq!(interval(-1.0, 2.0, 0.0, (-1.0, 1.0)), Some((0.0, 1.0)));
        assert_eq!(interval(-1.0, 5.0, -20.0, (-1.0, 1.0)), None);
        assert_eq!(interval(1.0, 0.0, 0.0, (-1.0, 1.0)), Some((-1.0, 1.0)));
        assert_eq!(cells((-1.0, 1.0), 4), 0..=3);
        assert_eq!(cells((-0.3, 0.3), 4), 1..=2);
        assert!(cells((0.3, 0.7), 4).is_empty());
    }
}
