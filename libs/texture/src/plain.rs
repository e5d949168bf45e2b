//! Filtered lookups of `texture ()` in a plain image.

use crate::file::TextureFile;
use crate::footprint::{Mean, Spread, mix};
use crate::gaussian::Gaussian;
use crate::lookup::Lookup;
use crate::reader::TextureReader;

/// Runs `each` for groups of up to four channels that the file has, and stores the results in their places. The
/// others get `fill`.
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

/// The largest ratio of the widths of a footprint that is filtered unchanged. Beyond it the footprint is made
/// wider.
const MAX_RATIO: f64 = 64.0;

/// Footprints of this width (in texels of the largest level, across) are bilinear probes. Those of [`WIDE`] are
/// means of all texels under a Gaussian. In between the two are blended.
const NARROW: f64 = 1.0;
const WIDE: f64 = 1.5;

/// The widest footprint that is filtered in the smallest level, in its texels.
const MOST: f64 = 32.0;

/// Returns the squared widths of the footprint of a lookup in texels of the largest level of a file.
fn spread(file: &TextureFile, q: &Lookup) -> Spread {
    let base = &file.levels[0];
    let mut spread = Spread::default();
    spread.add(q.dsdx * q.swidth, q.dtdx * q.twidth);
    spread.add(q.dsdy * q.swidth, q.dtdy * q.twidth);
    spread.add(q.sblur, 0.0);
    spread.add(0.0, q.tblur);
    spread.scaled(f64::from(base.width), f64::from(base.height))
}

/// Returns distances, as fractions of the width and the height, within which a lookup uses texels. They are not too
/// small, and may be larger than needed.
pub(crate) fn reach(file: &TextureFile, q: &Lookup) -> (f32, f32) {
    /// The cut of the Gaussian, three deviations of half a width, with the correction for the variance that it loses.
    const CUT: f64 = 1.6;
    let base = &file.levels[0];
    let spread = spread(file, q);
    let (a, b) = spread.squares();
    let (a, b) = (a.sqrt(), b.sqrt());
    // The width across is at least a texel and a part of the length. Texels of a level are smaller than the width
    // across, and interpolation needs their neighbours.
    let more = 3.0 * b.max(a / MAX_RATIO).max(1.0);
    let reach = |squared: f64, n: u32| ((CUT * squared.sqrt() + more) / f64::from(n)) as f32;
    (reach(spread.xx, base.width), reach(spread.yy, base.height))
}

/// Looks up one point in one file.
pub(crate) fn texture(reader: &mut TextureReader<'_>, file: &TextureFile, q: &Lookup, out: &mut [f32]) {
    if file.is_broken() {
        return by_channels(file, q.first_channel, q.fill, out, |_, _| [0.0; 4]);
    }
    let wrap = (q.swrap.unwrap_or(file.swrap), q.twrap.unwrap_or(file.twrap));
    let base = &file.levels[0];
    let size = [f64::from(base.width), f64::from(base.height)];
    let spread = spread(file, q);
    let (a, b) = spread.squares();
    if a <= 1.0 {
        // The footprint would be widened to one texel, which is one probe of weight 1.
        let mut count = 0;
        by_channels(file, q.first_channel, q.fill, out, |first, n| {
            if !q.s.is_finite() || !q.t.is_finite() {
                return [0.0; 4];
            }
            count += 1;
            positive_zero(reader.sampler(file, first, n).bilinear(0, q.s, q.t, wrap))
        });
        reader.probes += count;
        return;
    }
    let footprint = if b >= 1.0 && a <= MAX_RATIO * MAX_RATIO * b {
        Footprint { spread, b }
    } else {
        let ellipse = spread.ellipse().at_least(1.0, MAX_RATIO);
        Footprint { spread: ellipse.spread(), b: ellipse.b * ellipse.b }
    };
    let wide = if footprint.b >= WIDE * WIDE {
        1.0
    } else {
        ((footprint.b.sqrt() - NARROW) / (WIDE - NARROW)).clamp(0.0, 1.0) as f32
    };
    let filter = (wide > 0.0).then(|| smooth(file, &footprint));
    let narrow = (wide < 1.0).then(|| {
        let ellipse = footprint.spread.ellipse();
        // `step` is one step along the long axis by one texel of level 0.
        let step = (ellipse.axis[0] / size[0] as f32, ellipse.axis[1] / size[1] as f32);
        (ellipse.probes(1.0), step)
    });
    let mut count = 0;
    by_channels(file, q.first_channel, q.fill, out, |first, n| {
        if !q.s.is_finite() || !q.t.is_finite() {
            return [0.0; 4];
        }
        let mut sampler = reader.sampler(file, first, n);
        let round = filter.as_ref().map(|(level, gaussian)| {
            count += 1;
            sampler.gaussian(*level, q.s, q.t, gaussian, wrap)
        });
        let Some((probes, (ds, dt))) = &narrow else { return round.unwrap_or_default() };
        count += u64::from(probes.count);
        let mean = if probes.count == 1 {
            positive_zero(sampler.bilinear(0, q.s, q.t, wrap))
        } else {
            let mut mean = Mean::default();
            for (x, weight) in probes.iter() {
                mean.add(sampler.bilinear(0, q.s + x * ds, q.t + x * dt, wrap), weight);
            }
            mean.value()
        };
        round.map_or(mean, |round| mix(mean, round, wide))
    });
    reader.probes += count;
}

/// Returns the mean of one value as [`Mean`] computes it: a negative zero becomes positive.
#[inline]
fn positive_zero(value: [f32; 4]) -> [f32; 4] {
    value.map(|v| v + 0.0)
}

/// An ellipse, with the square of its width across, in texels of the largest level.
struct Footprint {
    spread: Spread,
    b: f64,
}

/// Returns the level in which the ellipse, whose widths are in texels of the largest one, is at least [`WIDE`]
/// across, and its filter there.
fn smooth(file: &TextureFile, footprint: &Footprint) -> (usize, Gaussian) {
    let last = file.levels.len() - 1;
    let ratio = footprint.b * (1.0 / (WIDE * WIDE));
    // The exponent of a number of at least 1, halved, is the integer part of half its logarithm.
    let level = if ratio >= 1.0 { ((ratio.to_bits() >> 52) as usize - 1023) / 2 } else { 0 };
    let level = level.min(last);
    let (base, l) = (&file.levels[0], &file.levels[level]);
    let (x, y) = (f64::from(l.width) / f64::from(base.width), f64::from(l.height) / f64::from(base.height));
    let mut spread = footprint.spread;
    if level == last {
        let mut ellipse = spread.ellipse();
        ellipse.a = ellipse.a.min(MOST / x.max(y));
        ellipse.b = ellipse.b.min(ellipse.a);
        spread = ellipse.spread();
    }
    let spread = spread.scaled(x, y);
    // Levels of very long images are no longer halved in one direction.
    let spread = if spread.squares().1 < 1.0 { spread.at_least(1.0) } else { spread };
    (level, Gaussian::new(spread))
}
