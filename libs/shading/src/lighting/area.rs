//! Points on the objects of a geometry set, for lights that have an area.
//!
//! A light whose shader has a string parameter "geometry" that names a geometry set shines from the surfaces in it.
//! Its shader runs once per sample ("light:nsamples"), with `Pl` and `Nl` on the surface. The light is the mean of
//! the samples. Points are uniform in area over the tessellation for rays.

use crate::object::{ObjectState, RayScene};
use granita_base::sample::Draw;
use granita_rays::GridShader;
use granita_shade::Lanes3;

/// The largest number of samples of one light.
const MOST_SAMPLES: i32 = 4096;

/// The properties of an area light.
#[derive(Clone, Debug)]
pub(crate) struct AreaLight {
    /// The name of the geometry set.
    pub(crate) set: std::sync::Arc<str>,
    /// The number of points that sample it.
    pub(crate) samples: u32,
}

impl AreaLight {
    /// Makes it from the shader's "geometry" and the attribute "light:nsamples" of the light.
    pub(crate) fn new(set: std::sync::Arc<str>, nsamples: i32) -> Self {
        Self { set, samples: samples(nsamples) }
    }
}

/// Returns the number of samples of a light from its attribute "light:nsamples".
pub(crate) fn samples(nsamples: i32) -> u32 {
    nsamples.clamp(1, MOST_SAMPLES) as u32
}

/// Returns sample `index` of the `of` samples of a light: a point and its normal for each active lane. `draw` returns
/// the random numbers of lanes. Returns `false` when the set has no surface.
pub(crate) fn points(
    scene: &RayScene,
    thread: &mut dyn GridShader<'_, ObjectState>,
    [index, of]: [u32; 2],
    active: &[u32],
    draw: &dyn Fn(u32) -> Draw,
    [pl, nl]: [&mut Lanes3; 2],
) -> bool {
    let place = |lane: &u32| draw(*lane).square(index, of).into();
    let places: Vec<_> = active.iter().map(place).collect();
    let Some(found) = scene.area_points(thread, &places) else { return false };
    for (lane, (p, n)) in active.iter().zip(found) {
        pl.set(*lane as usize, p);
        nl.set(*lane as usize, n);
    }
    true
}
