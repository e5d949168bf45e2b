//! The hemisphere (or a cone) over a point in strata: directions, means and derivatives.
//!
//! The derivatives are those of strata of constant radiance. The borders of the strata stay fixed in space at the
//! distance of the nearer side, which occludes the other. When the receiver moves, an element `dl` of a border at
//! `a` sweeps light of the difference `L`: `L / pi (a . n) (a x dl) / |a|^4` per unit of distance. The second
//! derivative is the change of that with `|a|`. Walls of constant radiance therefore have no derivatives, however
//! near they are. Gradients follow Ward and Heckbert, Irradiance Gradients (Eurographics Workshop on Rendering,
//! 1992). Second derivatives with occlusion follow the idea of Schwarzhaupt, Jensen and Jarosz, Practical
//! Hessian-Based Error Control for Irradiance Caching (SIGGRAPH Asia 2012).

use super::{Kind, Record};
use granita_base::sample::Sequence;
use granita_base::{Color, Vec3};
use granita_rays::sampling::{ConeCells, basis};
use granita_shade::approx;
use std::f32::consts::{PI, TAU};

/// The smallest number of samples with meaningful derivatives.
const LEAST_FOR_DERIVATIVES: u32 = 8;

/// A division of the cone into cells of equal weight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Strata {
    cells: ConeCells,
}

/// Narrower cones have no derivatives. The borders of their cells are as short as their rounding.
const LEAST_SIN: f32 = 1e-4;

/// The result of one ray.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seen {
    /// A unit vector in world space.
    pub(crate) dir: Vec3,
    /// The colour; for occlusion the blocked share, in all channels.
    pub(crate) value: Color,
    /// The distance of the hit; infinite when nothing was hit.
    pub(crate) distance: f32,
}

impl Strata {
    /// Divides a cone as [`ConeCells::new`].
    pub(crate) fn new(samples: u32, half_angle: f32, cosine: bool) -> Self {
        Self { cells: ConeCells::new(samples, half_angle, cosine) }
    }

    /// Returns the number of cells.
    pub(crate) fn len(&self) -> u32 {
        self.cells.count()
    }

    /// Passes a direction in each cell to `tell`, as [`ConeCells::directions`].
    pub(crate) fn directions(&self, axis: Vec3, sequence: Sequence, tell: &mut dyn FnMut(u32, Vec3)) {
        self.cells.directions(axis, sequence, tell);
    }

    /// Returns the record of all cells. `seen` holds one result per cell. Derivatives are computed only on request.
    pub(crate) fn record(&self, kind: Kind, axis: Vec3, seen: &[Seen], derivatives: bool) -> Record {
        let mut record = Record::default();
        let mut sum = Color::ZERO;
        let mut open = Vec3::ZERO;
        for s in seen {
            sum += s.value;
            open += s.dir * (1.0 - s.value.x);
        }
        let n = kind.channels();
        let mean = sum / seen.len().max(1) as f32;
        record.value[..n].copy_from_slice(&mean.to_array()[..n]);
        if kind == Kind::Occlusion {
            record.open = open.normalize_or_zero();
        }
        if derivatives
            && self.cells.uniform.is_none()
            && seen.len() as u32 == self.len()
            && self.len() >= LEAST_FOR_DERIVATIVES
            && self.cells.sin > LEAST_SIN
        {
            self.derive(kind, axis, seen, &mut record);
        }
        record
    }

    /// Sets the derivatives of a record.
    fn derive(&self, kind: Kind, axis: Vec3, seen: &[Seen], record: &mut Record) {
        let (u, v) = basis(axis);
        let mut sums = self.border_sums(kind, seen);
        sums.shrink();
        // The cone's share of the hemisphere counts as one.
        let scale = 1.0 / (PI * self.cells.sin * self.cells.sin);
        for (c, change) in record.translational.iter_mut().enumerate().take(kind.channels()) {
            *change = (u * sums.places[0][c] + v * sums.places[1][c]) * scale;
        }
        let [xx, yy, xy] = sums.second.map(|x| x * scale);
        let product = |a: Vec3, b: Vec3| {
            let mixed = |i: usize, j: usize| 0.5 * (a[i] * b[j] + a[j] * b[i]);
            [mixed(0, 0), mixed(1, 1), mixed(2, 2), mixed(0, 1), mixed(0, 2), mixed(1, 2)]
        };
        let (uu, vv, uv) = (product(u, u), product(v, v), product(u, v));
        for (k, sum) in record.second.iter_mut().enumerate() {
            *sum = xx * uu[k] + yy * vv[k] + 2.0 * xy * uv[k];
        }
        // Turning the normal changes the cosines. The boundary of a hemisphere has cosine zero, but that of a cone
        // would turn along, so a cone has no rotational gradient.
        if self.cells.sin < 0.9999 {
            return;
        }
        self.derive_rotational(kind, axis, seen, record);
    }

    /// Returns the sums over all borders between cells, in the plane of the receiver.
    #[inline(always)]
    fn border_sums(&self, kind: Kind, seen: &[Seen]) -> BorderSums {
        let mut sums =
            BorderSums { kind, places: [[0.0; 3]; 2], second: [0.0; 3], noise: [0.0; 3], second_noise: 0.0 };
        let sine = |ring: u32| self.cells.sin * (ring as f32 / self.cells.rings as f32).sqrt();
        let step = TAU / self.cells.sectors as f32;
        for ring in 0..self.cells.rings {
            let (inner, outer) = (sine(ring), sine(ring + 1));
            for sector in 0..self.cells.sectors {
                let here = self.cell(seen, ring, sector);
                // The border to the next sector.
                let (s, c) = sin_cos(step * (sector + 1) as f32);
                let long = outer - inner;
                let middle = 0.5 * (outer + inner);
                let next = self.cell(seen, ring, sector + 1);
                sums.add(here, next, [s * long, -c * long], [c, s], middle);
                // The border to the next ring.
                if ring + 1 < self.cells.rings {
                    let (s, c) = sin_cos(step * (sector as f32 + 0.5));
                    let arc = -(1.0 - outer * outer) * outer * 2.0 * approx::sin_near(0.5 * step);
                    let next = self.cell(seen, ring + 1, sector);
                    sums.add(here, next, [c * arc, s * arc], [c, s], outer);
                }
            }
        }
        sums
    }

    /// Sets the rotational gradient of a record of a whole hemisphere.
    #[inline(always)]
    fn derive_rotational(&self, kind: Kind, axis: Vec3, seen: &[Seen], record: &mut Record) {
        for ring in 0..self.cells.rings {
            // The mean of the tangent over the ring, by the square of the sine.
            let area = |x: f32| approx::asin_inside(x.sqrt()) - (x * (1.0 - x)).max(0.0).sqrt();
            let (inner, outer) =
                (ring as f32 / self.cells.rings as f32, (ring + 1) as f32 / self.cells.rings as f32);
            let tan = (area(outer) - area(inner)) * self.cells.rings as f32;
            for sector in 0..self.cells.sectors {
                let s = self.cell(seen, ring, sector);
                let side = (s.dir - axis * s.dir.dot(axis)).normalize_or_zero();
                for c in 0..kind.channels() {
                    record.rotational[c] += side * (tan * s.value[c] / seen.len() as f32);
                }
            }
        }
    }

    /// Returns the result of a cell. After the last sector of a ring comes the first one.
    #[inline(always)]
    fn cell<'s>(&self, seen: &'s [Seen], ring: u32, sector: u32) -> &'s Seen {
        &seen[(ring * self.cells.sectors + sector % self.cells.sectors) as usize]
    }
}

/// The sums of the derivatives over the borders between cells, in the plane of the receiver.
struct BorderSums {
    kind: Kind,
    /// The change of each channel per unit of distance along both axes of the plane.
    places: [[f32; 3]; 2],
    /// The second derivatives xx, yy and xy of the mean of the channels.
    second: [f32; 3],
    /// The sums of squares, which estimate the part of the derivatives that is noise.
    noise: [f32; 3],
    second_noise: f32,
}

impl BorderSums {
    /// Adds the border between two cells. `sweep` is the normal of the border towards `one` times its length, and `by`
    /// is its direction. Both are weighted by the cosine. `sine` is that of the angle between the axis and the border.
    #[inline(always)]
    fn add(&mut self, one: &Seen, other: &Seen, sweep: [f32; 2], by: [f32; 2], sine: f32) {
        let step = one.value - other.value;
        let distance = one.distance.min(other.distance);
        if step == Color::ZERO || !distance.is_finite() || distance <= 0.0 {
            return;
        }
        let near = 1.0 / distance;
        for (sums, sweep) in self.places.iter_mut().zip(sweep) {
            for (c, sum) in sums.iter_mut().enumerate() {
                *sum += step[c] * sweep * near;
            }
        }
        let mean = match self.kind {
            Kind::Irradiance => (step.x + step.y + step.z) / 3.0,
            Kind::Occlusion => step.x,
        };
        let hessian = 4.0 * sine * mean * near * near;
        let terms = [sweep[0] * by[0], sweep[1] * by[1], 0.5 * (sweep[0] * by[1] + sweep[1] * by[0])];
        for (sum, term) in self.second.iter_mut().zip(terms) {
            *sum += hessian * term;
        }
        self.second_noise += hessian * hessian * size(terms);
        for (c, sum) in self.noise.iter_mut().enumerate() {
            *sum += (step[c] * near).powi(2) * (sweep[0] * sweep[0] + sweep[1] * sweep[1]);
        }
    }

    /// Shrinks the estimates by their noise, as means of normal distributions are (James and Stein, Estimation with
    /// Quadratic Loss, 1961).
    #[inline(always)]
    fn shrink(&mut self) {
        let signal = |square: f32, noise: f32| if square > noise { 1.0 - noise / square } else { 0.0 };
        let significant = signal(size(self.second), self.second_noise);
        self.second.iter_mut().for_each(|x| *x *= significant);
        let places = &mut self.places;
        for c in 0..3 {
            let square = places[0][c] * places[0][c] + places[1][c] * places[1][c];
            let significant = signal(square, self.noise[c]);
            places.iter_mut().for_each(|p| p[c] *= significant);
        }
    }
}

/// Returns the squared size of a symmetric matrix from its xx, yy and xy.
fn size([xx, yy, xy]: [f32; 3]) -> f32 {
    xx * xx + yy * yy + 2.0 * xy * xy
}

/// Returns the sine and the cosine of an angle of at most a turn.
#[inline(always)]
fn sin_cos(angle: f32) -> (f32, f32) {
    (approx::sin_near(angle), approx::cos_near(angle))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f32::consts::FRAC_PI_2;

    fn directions(strata: &Strata, axis: Vec3, seed: u32) -> Vec<Vec3> {
        let mut out = Vec::new();
        strata.directions(axis, Sequence::new(seed), &mut |index, dir| {
            assert_eq!(index as usize, out.len());
            out.push(dir);
        });
        assert_eq!(out.len() as u32, strata.len());
        out
    }

    /// Returns the record of a wall x = 1 from z = 0 to `height`, endless along y, seen from (x, 0, 0) with a
    /// normal in the x-z plane.
    fn wall(samples: u32, x: f32, turn: f32, height: f32, seed: u32) -> Record {
        let axis = Vec3::new(turn.sin(), 0.0, turn.cos());
        let strata = Strata::new(samples, FRAC_PI_2, true);
        let seen: Vec<Seen> = directions(&strata, axis, seed)
            .into_iter()
            .map(|dir| {
                let t = (1.0 - x) / dir.x;
                let hit = t > 0.0 && t * dir.z < height && t * dir.z > -1e-6;
                Seen {
                    dir,
                    value: Color::splat(f32::from(u8::from(hit))),
                    distance: if hit { t } else { f32::INFINITY },
                }
            })
            .collect();
        strata.record(Kind::Occlusion, axis, &seen, true)
    }

    /// Returns the share of the wall (a long strip seen from the floor): (1 - cos of its elevation) / 2.
    fn exact(x: f32, height: f32) -> f32 {
        let d = 1.0 - x;
        0.5 * (1.0 - d / (d * d + height * height).sqrt())
    }

    #[test]
    fn cones_of_any_width_have_finite_derivatives() {
        for half_angle in [0.0, f32::MIN_POSITIVE, 1e-20, 1e-7, 1e-3, FRAC_PI_2] {
            let strata = Strata::new(64, half_angle, true);
            let seen: Vec<Seen> = (0..strata.len())
                .map(|k| Seen { dir: Vec3::Z, value: Color::splat((k % 3) as f32), distance: 1.0 + k as f32 })
                .collect();
            let record = strata.record(Kind::Irradiance, Vec3::Z, &seen, true);
            let changes = record.translational.iter().all(|v| v.is_finite());
            assert!(changes && record.second.iter().all(|v| v.is_finite()), "{half_angle}: {record:?}");
        }
    }

    #[test]
    fn irradiance_of_a_strip_equals_the_closed_form() {
        for height in [0.5, 1.0, 2.0] {
            let n = 20;
            let mean = |f: &dyn Fn(&Record) -> f32| {
                (0..n).map(|seed| f(&wall(4096, 0.0, 0.0, height, seed))).sum::<f32>() / n as f32
            };
            let value = mean(&|r| r.value[0]);
            assert!((value - exact(0.0, height)).abs() < 2e-3, "{height}: {value}");
            let h = 0.01;
            let slope = (exact(h, height) - exact(-h, height)) / (2.0 * h);
            let found = mean(&|r| r.translational[0].x);
            // The nearer sides of strata are slightly nearer than the border itself.
            assert!((found - slope).abs() < 0.06 * slope.abs() + 0.005, "{height}: {found} for {slope}");
            let hessian = (exact(h, height) + exact(-h, height) - 2.0 * exact(0.0, height)) / (h * h);
            let found = mean(&|r| r.hessian(Vec3::X));
            assert!((found - hessian).abs() < 0.2 * hessian.abs() + 0.1, "{height}: {found} for {hessian}");
            // Nothing changes along the wall.
            assert!(mean(&|r| r.translational[0].y).abs() < 0.02);
            assert!(mean(&|r| r.hessian(Vec3::Y)).abs() < 0.15, "{}", mean(&|r| r.hessian(Vec3::Y)));
        }
    }

    #[test]
    fn the_rotational_gradient_predicts_tilted_normals() {
        // The wall alone is seen, from slightly turned normals: what is below the floor does not count here.
        let n = 60;
        let mean = |turn: f32, f: &dyn Fn(&Record) -> f32| {
            (0..n).map(|seed| f(&wall(1024, 0.0, turn, 1.0, seed))).sum::<f32>() / n as f32
        };
        let h = 0.05;
        let slope = (mean(h, &|r| r.value[0]) - mean(-h, &|r| r.value[0])) / (2.0 * h);
        let found = mean(0.0, &|r| r.rotational[0].x);
        assert!((found - slope).abs() < 0.1 * slope.abs(), "{found} for {slope}");
    }

    #[test]
    fn uniform_light_has_zero_gradients() {
        let strata = Strata::new(64, FRAC_PI_2, true);
        let seen: Vec<Seen> = directions(&strata, Vec3::Z, 3)
            .into_iter()
            .map(|dir| Seen { dir, value: Color::ONE, distance: 0.5 + dir.x.abs() })
            .collect();
        let record = strata.record(Kind::Irradiance, Vec3::Z, &seen, true);
        assert_eq!(
            (record.value, record.translational, record.second),
            ([1.0; 3], [Vec3::ZERO; 3], [0.0; 6])
        );
        assert!(record.rotational[0].length() < 0.05, "{:?}", record.rotational[0]);
    }

    #[test]
    fn strata_cover_their_cone() {
        for (samples, angle) in [(1, 0.3_f32), (7, 1.0), (64, FRAC_PI_2), (250, 0.2), (3, 0.0), (9, f32::NAN)]
        {
            let strata = Strata::new(samples, angle, true);
            assert!(strata.len() >= 1 && strata.len() <= samples);
            for d in directions(&strata, Vec3::Y, 5) {
                assert!((d.length() - 1.0).abs() < 1e-5);
                assert!(angle.is_nan() || d.y > angle.cos() - 1e-3, "{d}");
            }
        }
        let strata = Strata::new(1024, FRAC_PI_2, true);
        let mean = directions(&strata, Vec3::Y, 5).iter().map(|d| d.y).sum::<f32>() / strata.len() as f32;
        assert!((mean - 2.0 / 3.0).abs() < 2e-3, "{mean}");
    }
}
