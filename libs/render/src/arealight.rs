//! Points on the objects of a geometry set, for lights that have an area.
//!
//! A light whose shader has a string parameter "geometry" that names a geometry set shines from the
//! surfaces in it. Its shader runs once per sample ("light:nsamples"), with `Pl` and `Nl` on the surface;
//! the light is the mean of the samples. Points are uniform in area over the tessellation for rays.

use crate::rayset::RayScene;
use crate::shading::ShaderThread;
use granita_base::{Vec3, hash, sample};
use granita_shade::Lanes3;

/// Most samples of one light.
const MOST_SAMPLES: i32 = 4096;

/// Triangles of a set with their areas summed up.
#[derive(Debug, Default)]
pub(crate) struct AreaTable {
    /// Sum of the areas up to and with each triangle; increasing.
    sums: Vec<f64>,
    /// Part of the set and triangle.
    places: Vec<(u32, u32)>,
}

impl AreaTable {
    /// Adds a triangle of a part; one without an area is left out.
    pub(crate) fn push(&mut self, part: u32, triangle: u32, area: f32) {
        if area.is_finite() && area > 0.0 {
            self.sums.push(self.sums.last().unwrap_or(&0.0) + f64::from(area));
            self.places.push((part, triangle));
        }
    }

    /// The triangle at a fraction (0 to 1) of the whole area; `None` without any.
    pub(crate) fn at(&self, fraction: f32) -> Option<(u32, u32)> {
        let whole = *self.sums.last()?;
        let wanted = f64::from(fraction) * whole;
        let k = self.sums.partition_point(|s| *s <= wanted).min(self.places.len() - 1);
        Some(self.places[k])
    }
}

/// What makes a light an area light.
#[derive(Clone, Debug)]
pub(crate) struct AreaLight {
    /// Name of the geometry set.
    pub(crate) set: std::sync::Arc<str>,
    /// Points that it is sampled by.
    pub(crate) samples: u32,
}

impl AreaLight {
    /// From the shader's "geometry" and the attribute "light:nsamples" of the light.
    pub(crate) fn new(set: std::sync::Arc<str>, nsamples: i32) -> Self {
        Self { set, samples: samples(nsamples) }
    }
}

/// Samples of a light by its attribute "light:nsamples".
pub(crate) fn samples(nsamples: i32) -> u32 {
    nsamples.clamp(1, MOST_SAMPLES) as u32
}

/// Sample `index` of a light: a point and its normal for each active lane. `seed` names lanes. `false` when
/// the set has no surface.
pub(crate) fn points(
    scene: &RayScene,
    thread: &mut ShaderThread<'_>,
    index: u32,
    active: &[u32],
    seed: &dyn Fn(u32) -> u32,
    [pl, nl]: [&mut Lanes3; 2],
) -> bool {
    let place = |lane: &u32| {
        let seed = seed(*lane);
        let fraction = sample::line(index, hash::words(&[seed, 0]));
        let (x, y) = sample::square(index, hash::words(&[seed, 1]));
        // The square folded into the triangle, uniform in area.
        let root = x.sqrt();
        (fraction, root * (1.0 - y), root * y)
    };
    let places: Vec<_> = active.iter().map(place).collect();
    let Some(found) = scene.area_points(thread, &places) else { return false };
    for (lane, (p, n)) in active.iter().zip(found) {
        pl.set(*lane as usize, p);
        nl.set(*lane as usize, n);
    }
    true
}

/// Area of a triangle.
pub(crate) fn area(a: Vec3, b: Vec3, c: Vec3) -> f32 {
    0.5 * (b - a).cross(c - a).length()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangles_are_chosen_by_area() {
        let mut table = AreaTable::default();
        for (part, triangle, area) in [(0, 0, 1.0), (0, 1, 0.0), (1, 0, 3.0), (2, 5, f32::NAN)] {
            table.push(part, triangle, area);
        }
        assert_eq!(table.at(0.0), Some((0, 0)));
        assert_eq!(table.at(0.24), Some((0, 0)));
        assert_eq!(table.at(0.26), Some((1, 0)));
        assert_eq!(table.at(1.0), Some((1, 0)));
        assert_eq!(AreaTable::default().at(0.5), None);
        assert_eq!(area(Vec3::ZERO, Vec3::X * 2.0, Vec3::Y), 1.0);
    }
}
