//! Points on the objects of a geometry set, for lights that have an area.
//!
//! A light whose shader has a string parameter "geometry" that names a geometry set shines from the
//! surfaces in it. Its shader runs once per sample ("light:nsamples"), with `Pl` and `Nl` on the surface;
//! the light is the mean of the samples. Points are uniform in area over the tessellation for rays.

use crate::rays::GridShader;
use crate::rays::scene::RayScene;
use granita_base::{hash, sample};
use granita_shade::Lanes3;

/// Most samples of one light.
const MOST_SAMPLES: i32 = 4096;

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
    thread: &mut dyn GridShader<'_>,
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
