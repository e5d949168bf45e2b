//! Subsurface scattering by the dipole diffusion model (Jensen, Marschner, Levoy and Hanrahan, A Practical Model
//! for Subsurface Light Transport, SIGGRAPH 2001), gathered hierarchically (Jensen and Buhler, A Rapid Hierarchical
//! Rendering Technique for Translucent Materials, SIGGRAPH 2002).

mod beam;

use beam::{Beam, Beams};
use granita_base::{Color, Vec3};
use granita_machine::widest;
use granita_sdb::{Cluster, Clusters, Lanes, Packed};
use granita_shade::approx;
use std::f32::consts::PI;
use std::sync::Arc;

/// The largest number of points whose light is gathered together.
pub(crate) const TOGETHER: usize = 16;

/// A number for each of the points that are gathered together.
type Each = [f32; TOGETHER];

/// The diffusion profile of a material: how light that enters at one place leaves at others.
#[derive(Debug)]
pub(crate) enum Profile {
    /// The dipole model of the reference.
    Dipole(Dipole),
    /// The model of a beam that is scattered along its whole path.
    Beam(Beam),
}

/// A point from which light leaves.
#[derive(Clone, Debug)]
pub(crate) struct Point {
    /// Its position in the space of the database, finite.
    pub(crate) p: Vec3,
    /// Boxes that subtend at most this solid angle (steradians) count as one place.
    pub(crate) max_solid_angle: f32,
    /// Its material.
    pub(crate) profile: Arc<Profile>,
}

/// Returns the light that leaves at up to [`TOGETHER`] points, whose profiles are of one kind. Each has the same light
/// as without the others. The database holds light times area at the places where it enters.
pub(crate) fn gather(records: &Packed, clusters: &Clusters, points: &[Point]) -> [Color; TOGETHER] {
    let mut dipoles = Dipoles::default();
    let mut beams = Vec::new();
    for (k, point) in points.iter().enumerate() {
        match &*point.profile {
            Profile::Dipole(dipole) => dipoles.set(k, dipole),
            Profile::Beam(beam) => beams.push(beam),
        }
    }
    // Vector code gives the same results.
    if beams.is_empty() {
        widest!(sums(records, clusters, points, &dipoles))
    } else {
        let beams = Beams::new(&beams);
        widest!(sums(records, clusters, points, &beams))
    }
}

#[inline(always)]
fn sums<P: Profiled>(
    records: &Packed,
    clusters: &Clusters,
    points: &[Point],
    profiles: &P,
) -> [Color; TOGETHER] {
    let mut leaving =
        Leaving { p: [[0.0; TOGETHER]; 3], angle: [0.0; TOGETHER], profiles, sums: [[0.0; TOGETHER]; 3] };
    for (k, point) in points.iter().enumerate() {
        (0..3).for_each(|c| leaving.p[c][k] = point.p[c]);
        leaving.angle[k] = point.max_solid_angle.max(0.0);
    }
    clusters.gather(records, (1 << points.len()) - 1, &mut leaving);
    std::array::from_fn(|k| Vec3::from_array(leaving.sums.map(|channel| channel[k])))
}

/// The profiles of points that are gathered together.
trait Profiled {
    /// Returns the light of a channel that leaves per area, relative to the light that enters at distances whose
    /// squares are given.
    fn channel(&self, c: usize, squared: &Each) -> Each;
}

/// The light that leaves at points, so far.
struct Leaving<'p, P> {
    p: [Each; 3],
    angle: Each,
    profiles: &'p P,
    sums: [Each; 3],
}

impl<P: Profiled> Lanes for Leaving<'_, P> {
    /// The square of the diagonal is twice the area of a flat square. The distance is measured to the nearest side, so
    /// that boxes beside a point are opened where the profile is steep.
    #[inline(always)]
    fn open(&self, cluster: &Cluster) -> u32 {
        let (lo, hi) = cluster.corners();
        let mut squared = [0.0; TOGETHER];
        for (c, p) in self.p.iter().enumerate() {
            for (squared, p) in squared.iter_mut().zip(p) {
                let beside = (lo[c] - p).max(p - hi[c]).max(0.0);
                *squared += beside * beside;
            }
        }
        let mut open = 0;
        for (k, (angle, squared)) in self.angle.iter().zip(&squared).enumerate() {
            open |= u32::from(cluster.diagonal_squared > angle * squared) << k;
        }
        open
    }

    #[inline(always)]
    fn take(&mut self, at: [f32; 3], light: [f32; 3], lanes: u32) {
        let mut squared = [0.0; TOGETHER];
        for (p, at) in self.p.iter().zip(at) {
            for (squared, p) in squared.iter_mut().zip(p) {
                *squared += (p - at) * (p - at);
            }
        }
        for (c, sums) in self.sums.iter_mut().enumerate() {
            let channel = self.profiles.channel(c, &squared);
            for (k, (sum, leaving)) in sums.iter_mut().zip(channel).enumerate() {
                *sum += if lanes >> k & 1 == 1 { leaving * light[c] } else { 0.0 };
            }
        }
    }
}

/// The dipoles of points that are gathered together, channel by channel.
#[derive(Default)]
struct Dipoles {
    transport: [Each; 3],
    real: [Each; 3],
    mirrored: [Each; 3],
    /// The albedo over 4 pi.
    scale: [Each; 3],
}

impl Dipoles {
    fn set(&mut self, k: usize, dipole: &Dipole) {
        for c in 0..3 {
            self.transport[c][k] = dipole.transport[c];
            self.real[c][k] = dipole.real[c];
            self.mirrored[c][k] = dipole.mirrored[c];
            self.scale[c][k] = dipole.albedo[c] / (4.0 * PI);
        }
    }
}

impl Profiled for Dipoles {
    #[inline(always)]
    fn channel(&self, c: usize, squared: &Each) -> Each {
        let (transport, real) = (&self.transport[c], &self.real[c]);
        let (mirrored, scale) = (&self.mirrored[c], &self.scale[c]);
        let mut out = [0.0; TOGETHER];
        for k in 0..TOGETHER {
            let pole = |depth: f32| {
                // The lower bound keeps the square from underflowing.
                let way = (depth * depth + squared[k]).sqrt().max(1e-15);
                let optical = transport[k] * way;
                // Beyond, nothing is left.
                let fall = if optical < 87.0 { approx::exp_near(-optical) } else { 0.0 };
                depth / way * (1.0 + optical) * fall / (way * way)
            };
            out[k] = (pole(real[k]) + pole(mirrored[k])) * scale[k];
        }
        out
    }
}

/// The profiles of a call. Neighbouring points are mostly of one material.
#[derive(Debug, Default)]
pub(crate) struct Profiles {
    last: Option<([u32; 7], Arc<Profile>)>,
}

impl Profiles {
    /// Returns a profile by the word of the option "model": the beam model for "beam", otherwise the dipole.
    pub(crate) fn get(
        &mut self,
        model: &str,
        scattering: Color,
        absorption: Color,
        eta: f32,
    ) -> Arc<Profile> {
        let [a, b, c] = scattering.to_array();
        let [d, e, f] = absorption.to_array();
        let key = [a, b, c, d, e, f, eta].map(f32::to_bits);
        let known = self.last.take().filter(|(k, _)| *k == key);
        let made = known.unwrap_or_else(|| {
            let profile = match model {
                "beam" => Profile::Beam(Beam::new(scattering, absorption, eta)),
                _ => Profile::Dipole(Dipole::new(scattering, absorption, eta)),
            };
            (key, Arc::new(profile))
        });
        self.last.insert(made).1.clone()
    }
}

/// The dipole profile of a material, per channel.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Dipole {
    /// The share of light that is scattered, not absorbed.
    albedo: Vec3,
    /// The effective transport coefficient, per unit of length.
    transport: Vec3,
    /// The depth of the real pole.
    real: Vec3,
    /// The height of the virtual pole.
    mirrored: Vec3,
}

impl Dipole {
    /// Makes a profile from the reduced scattering and absorption coefficients per unit of length, and the index of
    /// refraction. Negative coefficients count as 0, an index below 1 as 1.
    pub(crate) fn new(scattering: Color, absorption: Color, eta: f32) -> Self {
        let (scattering, absorption) = (scattering.max(Vec3::ZERO), absorption.max(Vec3::ZERO));
        let extinction = (scattering + absorption).max(Vec3::splat(1e-12));
        let eta = eta.max(1.0);
        // The mean reflection at the inside of the surface (Egan and Hilgeman's fit, as cited there).
        let inside = -1.440 / (eta * eta) + 0.710 / eta + 0.668 + 0.0636 * eta;
        let mismatch = (1.0 + inside) / (1.0 - inside);
        let real = extinction.recip();
        Self {
            albedo: scattering / extinction,
            // The roots are taken one by one, because the product may overflow.
            transport: (3.0 * absorption).map(f32::sqrt) * extinction.map(f32::sqrt),
            real,
            mirrored: real * (1.0 + 4.0 / 3.0 * mismatch),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_base::hash;
    use granita_sdb::{Key, Schema, Value};

    impl Profile {
        /// Returns the light that leaves at a distance whose square is given.
        fn reflectance(&self, squared: f32) -> Color {
            match self {
                Self::Dipole(dipole) => dipole.reflectance(squared),
                Self::Beam(beam) => beam.reflectance(squared),
            }
        }
    }

    impl Dipole {
        fn reflectance(&self, squared: f32) -> Color {
            let mut dipoles = Dipoles::default();
            dipoles.set(TOGETHER - 1, self);
            let channel = |c| dipoles.channel(c, &[squared; TOGETHER])[TOGETHER - 1];
            Vec3::from_array([0, 1, 2].map(channel))
        }
    }

    impl Beam {
        fn reflectance(&self, squared: f32) -> Color {
            let beams = Beams::new(&[self]);
            Vec3::from_array([0, 1, 2].map(|c| beams.channel(c, &[squared; TOGETHER])[0]))
        }
    }

    /// Returns the total light that leaves in closed form (the paper's section 4.1 gives it for the diffuse
    /// albedo).
    fn total(scattering: f64, absorption: f64, eta: f64) -> f64 {
        let albedo = scattering / (scattering + absorption);
        let inside = -1.440 / (eta * eta) + 0.710 / eta + 0.668 + 0.0636 * eta;
        let mismatch = (1.0 + inside) / (1.0 - inside);
        let root = (3.0 * (1.0 - albedo)).sqrt();
        0.5 * albedo * (1.0 + (-4.0 / 3.0 * mismatch * root).exp()) * (-root).exp()
    }

    #[test]
    fn the_profile_integrates_to_the_closed_form() {
        for (scattering, absorption) in [(2.19, 0.0021), (1.0, 1.0), (0.7, 6.3), (0.999, 0.001), (10.0, 0.5)]
        {
            for eta in [1.0, 1.3, 1.5] {
                let dipole =
                    Dipole::new(Vec3::splat(scattering as f32), Vec3::splat(absorption as f32), eta as f32);
                // Rings of a geometric series of radii.
                let (mut sum, mut inner) = (0.0_f64, 0.0_f64);
                let mut radius = 1e-4_f64;
                while radius < 3e3 {
                    let middle = 0.5 * (inner + radius);
                    let value = f64::from(dipole.reflectance((middle * middle) as f32).x);
                    sum += value * std::f64::consts::PI * (radius * radius - inner * inner);
                    inner = radius;
                    radius *= 1.005;
                }
                let due = total(scattering, absorption, eta);
                assert!((sum / due - 1.0).abs() < 5e-3, "{scattering} {absorption} {eta}: {sum} {due}");
                assert!(sum <= 1.0);
            }
        }
    }

    /// An evenly lit plane in a database gathers to the closed form, more exactly for smaller angles.
    #[test]
    fn an_evenly_lit_plane_reflects_its_albedo() {
        let schema = Schema { key: Key::Oriented, value: Value::Color };
        let (step, half) = (0.1_f32, 120);
        let record = |i: i32, j: i32| {
            let (x, y, area) = (i as f32 * step, j as f32 * step, step * step);
            [x, y, 0.0, 0.0, 0.0, 1.0, area, area, 0.5 * area]
        };
        let records: Vec<f32> =
            (-half..=half).flat_map(|i| (-half..=half).flat_map(move |j| record(i, j))).collect();
        let packed = Packed::new(schema, &records);
        let clusters = Clusters::new(&packed);
        let profile = Arc::new(Profile::Dipole(Dipole::new(Vec3::splat(2.0), Vec3::splat(0.5), 1.3)));
        let due = total(2.0, 0.5, 1.3) as f32;
        let p = Vec3::new(0.03, 0.04, 0.0);
        for (angle, within) in [(0.01, 0.005), (0.1, 0.01), (1.0, 0.06)] {
            let point = Point { p, max_solid_angle: angle, profile: profile.clone() };
            let got = gather(&packed, &clusters, &[point])[0];
            assert!((got.x / due - 1.0).abs() < within, "{angle}: {got} {due}");
            assert!((got.z / got.x - 0.5).abs() < 1e-4);
        }
    }

    #[test]
    fn points_have_the_same_light_together_and_alone() {
        let schema = Schema { key: Key::Point, value: Value::Color };
        let number = |i: u32, salt: u32| hash::unit(hash::words(&[i, salt]));
        let records: Vec<f32> =
            (0..6 * 3000).map(|i| number(i, 1) * [3.0, 0.01][(i % 6 / 3) as usize]).collect();
        let packed = Packed::new(schema, &records);
        let clusters = Clusters::new(&packed);
        for model in ["dipole", "beam"] {
            // Points of several materials and tolerances.
            let mut profiles = Profiles::default();
            let points: Vec<Point> = (0..TOGETHER as u32)
                .map(|i| Point {
                    p: Vec3::new(number(i, 2), number(i, 3), number(i, 4)) * 3.5,
                    max_solid_angle: number(i, 5),
                    profile: profiles.get(model, Vec3::splat(1.0 + (i / 3) as f32), Vec3::splat(0.1), 1.3),
                })
                .collect();
            let together = gather(&packed, &clusters, &points);
            for count in [1, 5, TOGETHER] {
                for (some, due) in points.chunks(count).zip(together.chunks(count)) {
                    assert_eq!(&gather(&packed, &clusters, some)[..some.len()], due, "{model} {count}");
                }
            }
            assert!(together.iter().all(|light| light.min_element() > 0.0), "{model} {together:?}");
            assert_ne!(together[0], together[1], "{model}");
        }
    }

    #[test]
    fn the_total_reflectance_grows_with_albedo_and_stays_below_one() {
        let mut before = 0.0;
        for albedo in [0.1, 0.3, 0.5, 0.7, 0.9, 0.95, 0.99, 0.999] {
            let dipole = Dipole::new(Vec3::splat(albedo), Vec3::splat(1.0 - albedo), 1.3);
            let (mut sum, mut inner, mut radius) = (0.0_f64, 0.0_f64, 1e-4_f64);
            while radius < 1e4 {
                let middle = 0.5 * (inner + radius);
                sum += f64::from(dipole.reflectance((middle * middle) as f32).x)
                    * std::f64::consts::PI
                    * (radius * radius - inner * inner);
                inner = radius;
                radius *= 1.005;
            }
            assert!((sum / total(f64::from(albedo), 1.0 - f64::from(albedo), 1.3) - 1.0).abs() < 5e-3);
            assert!(sum > before && sum <= 1.0, "{albedo}: {sum}");
            before = sum;
        }
    }

    #[test]
    fn profiles_are_reused_for_the_same_material() {
        let mut profiles = Profiles::default();
        let one = profiles.get("beam", Vec3::ONE, Vec3::splat(0.1), 1.3).reflectance(0.5);
        assert_eq!(profiles.get("beam", Vec3::ONE, Vec3::splat(0.1), 1.3).reflectance(0.5), one);
        assert_ne!(profiles.get("beam", Vec3::ONE, Vec3::splat(0.2), 1.3).reflectance(0.5), one);
    }

    #[test]
    fn invalid_materials_give_finite_profiles() {
        for scattering in [-1.0, 0.0, 1e-20, 1e20] {
            for absorption in [-1.0, 0.0, 1e-20, 1e20] {
                for eta in [0.0, 1.0, 3.0] {
                    let dipole = Dipole::new(Vec3::splat(scattering), Vec3::splat(absorption), eta);
                    let beam = Beam::new(Vec3::splat(scattering), Vec3::splat(absorption), eta);
                    for squared in [0.0, 1e-10, 1.0, 1e10] {
                        let r = dipole.reflectance(squared);
                        assert!(r.x >= 0.0, "{scattering} {absorption} {eta} {squared}: {r}");
                        let r = beam.reflectance(squared);
                        assert!(r.x >= 0.0, "beam {scattering} {absorption} {eta} {squared}: {r}");
                    }
                }
            }
        }
    }
}
