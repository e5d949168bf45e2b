//! `texture ()`: filtered lookup in a plain picture.

use crate::file::TextureFile;
use crate::footprint::{Mean, Spread, mix};
use crate::lookup::Lookup;
use crate::sampler::{Sampler, levels};
use crate::shared::Shared;

/// Runs `each` for runs of up to four channels that the file has, and puts the results in their places;
/// the others get `fill`.
pub(crate) fn by_channels(
    file: &TextureFile,
    first: u32,
    fill: f32,
    out: &mut [f32],
    mut each: impl FnMut(usize, usize) -> [f32; 4],
) {
    let first = first as usize;
    let there = file.channels.saturating_sub(first).min(out.len());
    let (have, missing) = out.split_at_mut(there);
    missing.fill(fill);
    for (i, run) in have.chunks_mut(4).enumerate() {
        let value = each(first + 4 * i, run.len());
        run.copy_from_slice(&value[..run.len()]);
    }
}

/// See [`crate::TextureCache::texture`].
pub(crate) fn texture(shared: &Shared, file: &TextureFile, q: &Lookup, out: &mut [f32]) {
    let wrap = (q.swrap.unwrap_or(file.swrap), q.twrap.unwrap_or(file.twrap));
    let base = &file.levels[0];
    let (width, height) = (base.width as f32, base.height as f32);
    let mut spread = Spread::default();
    spread.add(q.dsdx * q.swidth, q.dtdx * q.twidth);
    spread.add(q.dsdy * q.swidth, q.dtdy * q.twidth);
    spread.add(q.sblur, 0.0);
    spread.add(0.0, q.tblur);
    let ellipse = spread.scaled(f64::from(width), f64::from(height)).ellipse();
    let probes = ellipse.probes(1.0);
    let (level, share) = levels(probes.width.log2(), file.levels.len() - 1);
    // One step along the long axis by one texel of level 0.
    let (ds, dt) = (ellipse.axis[0] / width, ellipse.axis[1] / height);
    let mut count = 0;
    by_channels(file, q.first_channel, q.fill, out, |first, n| {
        if !q.s.is_finite() || !q.t.is_finite() {
            return [0.0; 4];
        }
        let mut sampler = Sampler::new(shared, file, first, n);
        let mut mean = Mean::default();
        for (x, weight) in probes.iter() {
            let (s, t) = (q.s + x * ds, q.t + x * dt);
            let mut value = sampler.bilinear(level, s, t, wrap);
            if share > 0.0 {
                value = mix(value, sampler.bilinear(level + 1, s, t, wrap), share);
            }
            mean.add(value, weight);
        }
        count += u64::from(probes.count);
        mean.value()
    });
    shared.count_probes(count);
}
