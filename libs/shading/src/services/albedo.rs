//! Answers for shaders that show their albedo: the colour of a surface without what lights and other surfaces add.
//!
//! One white light shines along the normal that a shader asks for, and makes no highlight. Nothing is in shadow, and
//! what is reflected, gathered or scattered is white. So a matte surface has the colour that it multiplies light by,
//! with its textures, and a mirror has the colour of its reflections. No ray is traced.

use super::maps::{fit, prepare};
use super::rays::NO_HIT;
use granita_base::Vec3;
use granita_shade::{
    Batch, EnvironmentQuery, GatherQuery, IlluminateQuery, Lanes3, LightResult, LightSample, LookupResult,
};

/// Answers `environment ()`. `is_set` is true when the name is that of a geometry set.
pub(super) fn environment(query: &EnvironmentQuery<'_>, is_set: bool, out: &mut LookupResult) {
    prepare(query.batch, query.channels, out);
    if is_set {
        let lanes = query.batch.lanes;
        out.hitdist = vec![NO_HIT; lanes];
        (out.p_hit, out.n_hit) = (Lanes3::zeros(lanes), Lanes3::zeros(lanes));
    }
    for &lane in query.batch.active {
        out.value.iter_mut().for_each(|channel| channel[lane as usize] = 1.0);
        out.alpha[lane as usize] = 1.0;
    }
}

/// Sets a colour of the active lanes to the same value.
pub(super) fn fill(batch: Batch<'_>, value: Vec3, out: &mut Lanes3) {
    fit(out, batch.lanes);
    batch.active.iter().for_each(|lane| out.set(*lane as usize, value));
}

/// Returns the light that shines along the normals of a query.
pub(super) fn light(query: &IlluminateQuery<'_>) -> LightResult {
    let n = query.batch.lanes;
    let mut sample = LightSample {
        l: Lanes3::zeros(n),
        cl: Lanes3::splat(Vec3::ONE, n),
        pl: Lanes3::zeros(n),
        nl: Lanes3::zeros(n),
        lit: vec![false; n],
    };
    for &lane in query.batch.active {
        let i = lane as usize;
        let Some(axis) = query.ns.get(i).try_normalize() else { continue };
        sample.l.set(i, axis);
        sample.pl.set(i, query.ps.get(i) + axis);
        sample.nl.set(i, -axis);
        sample.lit[i] = true;
    }
    LightResult { samples: vec![sample], nonspecular: vec![1.0; n], ..LightResult::default() }
}

/// Answers `occlusion ()`: nothing is blocked.
pub(super) fn occlusion(query: &GatherQuery<'_>, out: &mut [f32], unoccluded: &mut Lanes3) {
    fit(unoccluded, query.batch.lanes);
    for &lane in query.batch.active {
        let i = lane as usize;
        out[i] = 0.0;
        unoccluded.set(i, query.axis.get(i).normalize_or_zero());
    }
}
