//! Filtered lookups of `environment ()`. Footprints of more than a texel are means under an ellipse on the sphere
//! (`solid`). Narrower ones are probes between texels, which are here.

use crate::cube;
use crate::file::TextureFile;
use crate::footprint::{Ellipse, Mean, Spread, mix};
use crate::level::Level;
use crate::lookup::{EnvLookup, Up};
use crate::plain::by_channels;
use crate::reader::TextureReader;
use crate::sampler::{Sampler, levels};
use crate::solid::Lobe;
use crate::wrap::cell;
use crate::{TextureId, TextureKind};
use granita_base::Vec3;
use std::f32::consts::{FRAC_PI_2, PI, TAU};

/// The widest cone that is filtered, in radians.
const WIDEST: f32 = PI;

/// The widest footprint of a quick lookup, in radians. The texels of smaller levels differ too much in solid angle
/// to represent their light.
const WIDEST_QUICK: f32 = 0.2;

/// Footprints of this width (in texels of the largest level, across) are probes. Those of [`WIDE`] are means of all
/// texels under a Gaussian. In between the two are blended.
const NARROW: f64 = 1.0;
const WIDE: f64 = 1.5;

/// The largest ratio of the widths of a footprint that is filtered unchanged. Beyond it the footprint is made
/// wider.
const MAX_RATIO: f64 = 64.0;

/// The largest number of texels of one row that a probe near a pole averages.
const MAX_ROW: u32 = 32;

/// Returns a unit direction in the frame of a latitude-longitude map: x to its centre, y to the right of it, z to
/// its upper edge.
pub(crate) fn to_map(r: Vec3, up: Up) -> Vec3 {
    up.to_map(r)
}

impl TextureReader<'_> {
    /// Implements [`TextureCache::environment`](crate::TextureCache::environment).
    pub fn environment(&mut self, id: TextureId, lookup: &EnvLookup, out: &mut [f32]) {
        let file = self.look_up(id);
        environment(self, file, lookup, out);
    }
}

fn environment(reader: &mut TextureReader<'_>, file: &TextureFile, q: &EnvLookup, out: &mut [f32]) {
    if file.is_broken() {
        return by_channels(file, q.first_channel, q.fill, out, |_, _| [0.0; 4]);
    }
    let cube = file.kind == TextureKind::CubeFaceEnvironment;
    // A panorama is looked up in its own frame.
    let up = if cube { Up::Z } else { q.up.unwrap_or(file.up) };
    let length = q.r.length();
    let usable = length.is_finite() && length > 0.0;
    let r = if usable { to_map(q.r, up) / length } else { Vec3::Z };
    let axis = if cube { Vec3::Y } else { Vec3::Z };
    // "s" goes around the axis, "t" towards the poles. At a pole any two orthogonal directions are used.
    let east = axis.cross(r).try_normalize().unwrap_or_else(|| r.any_orthonormal_vector());
    let north = r.cross(east);
    let mut spread = Spread::default();
    for d in [q.drdx, q.drdy] {
        let d = to_map(d, up) / length;
        spread.add(d.dot(east) * q.swidth, d.dot(north) * q.twidth);
    }
    match q.angle {
        Some(angle) => {
            spread.add(2.0 * angle, 0.0);
            spread.add(0.0, 2.0 * angle);
        }
        None => {
            spread.add(q.sblur * FRAC_PI_2, 0.0);
            spread.add(0.0, q.tblur * FRAC_PI_2);
        }
    }
    let mut ellipse = spread.ellipse();
    // The footprint of a ray may be reduced, but not a requested blur.
    let quick = q.quick && (q.angle.is_some() || q.sblur.max(q.tblur) * FRAC_PI_2 <= WIDEST_QUICK);
    let widest = f64::from(if quick { WIDEST_QUICK } else { WIDEST });
    ellipse.a = ellipse.a.min(widest);
    ellipse.b = ellipse.b.min(widest);
    let probes = ellipse.probes(f64::from(texel_angle(file, cube)));
    let long = east * ellipse.axis[0] + north * ellipse.axis[1];
    let texel = texel_at(file, cube, r, ellipse.a);
    let across = ellipse.b.max(ellipse.a / MAX_RATIO) / texel;
    let wide = if quick { 0.0 } else { ((across - NARROW) / (WIDE - NARROW)).clamp(0.0, 1.0) as f32 };
    let filter = (wide > 0.0).then(|| smooth(file, cube, (r, east, north), &ellipse, texel));
    let mut count = 0;
    by_channels(file, q.first_channel, q.fill, out, |first, n| {
        if !usable {
            return [0.0; 4];
        }
        let mut sampler = reader.sampler(file, first, n);
        let round = filter.as_ref().and_then(|(level, lobe)| {
            count += 1;
            if cube { sampler.cube_mean(*level, lobe) } else { sampler.latlong_mean(*level, lobe) }
        });
        if let (Some(value), true) = (round, wide == 1.0) {
            return value;
        }
        let mut mean = Mean::default();
        for (x, weight) in probes.iter() {
            let d = r * libm::cosf(x) + long * libm::sinf(x);
            let value = if cube {
                cube_probe(&mut sampler, d, probes.exact, quick)
            } else {
                latlong_probe(&mut sampler, d, (probes.width, probes.exact), quick)
            };
            mean.add(value, weight);
        }
        count += u64::from(probes.count);
        round.map_or(mean.value(), |round| mix(mean.value(), round, wide))
    });
    reader.probes += count;
}

/// Returns the angle in radians of one texel of the largest level where the map is coarsest.
fn texel_angle(file: &TextureFile, cube: bool) -> f32 {
    let level = &file.levels[0];
    if cube { 2.0 / level.face_width as f32 } else { PI / level.height as f32 }
}

/// Returns the angle in radians of the largest texel of the largest level under a footprint of this width around
/// `r`.
fn texel_at(file: &TextureFile, cube: bool, r: Vec3, width: f64) -> f64 {
    let most = f64::from(texel_angle(file, cube));
    if !cube {
        return most;
    }
    // The area of texels shrinks with the third power of the cosine of this angle.
    let angle = libm::acos(f64::from(1.0 / cube::project(file.layout, r).stretch).clamp(-1.0, 1.0));
    most * libm::pow(libm::cos((angle - 1.5 * width).clamp(0.0, 1.0)), 1.5)
}

/// Returns the level in which the ellipse is at least [`WIDE`] texels across, and its filter there.
fn smooth(
    file: &TextureFile,
    cube: bool,
    (r, east, north): (Vec3, Vec3, Vec3),
    ellipse: &Ellipse,
    texel: f64,
) -> (usize, Lobe) {
    let ellipse = ellipse.at_least(texel, MAX_RATIO);
    let size = |level: &Level| if cube { level.face_width } else { level.height };
    // The smallest levels have too little angular detail.
    let enough = |level: &Level| size(level) >= if cube { 8 } else { 16 };
    let last = file.levels.iter().rposition(enough).unwrap_or(0);
    let level = (libm::log2(ellipse.b / texel / WIDE).max(0.0) as usize).min(last);
    let (base, l) = (&file.levels[0], &file.levels[level]);
    let texel = texel * f64::from(size(base)) / f64::from(size(l));
    let around = if cube {
        texel
    } else {
        f64::from(libm::hypotf(r.x, r.y)) * std::f64::consts::TAU / f64::from(l.width)
    };
    (level, Lobe::new(r, (east, north), ellipse.at_least(texel, MAX_RATIO).spread(), (around, texel)))
}

/// Returns a round probe of a cube in a direction `d` of length about 1, with the full width in radians. It covers
/// at least one texel anywhere on the face. A quick probe reads only the nearer level.
fn cube_probe(sampler: &mut Sampler<'_>, d: Vec3, width: f32, quick: bool) -> [f32; 4] {
    let p = cube::project(sampler.file.layout, d);
    // In the plane of the face, lengths grow by stretch^2 outward and by stretch across. The factor is their geometric
    // mean.
    let texels = width * 0.5 * sampler.level(0).face_width as f32 * p.stretch * p.stretch.sqrt();
    let texels = texels.max(1.0);
    let lod = libm::log2f(texels);
    let (level, share) = levels(if quick { lod.round() } else { lod }, sampler.last());
    let (s, t) = (p.s.clamp(0.0, 1.0), p.t.clamp(0.0, 1.0));
    let value = sampler.cube_bilinear(level, p.face, s, t);
    if share > 0.0 { mix(value, sampler.cube_bilinear(level + 1, p.face, s, t), share) } else { value }
}

/// Returns a round probe of a latitude-longitude map in a direction in the map's frame. `width` selects the level,
/// and `exact` is the width along the rows. A quick probe reads only the nearer level.
fn latlong_probe(sampler: &mut Sampler<'_>, d: Vec3, (width, exact): (f32, f32), quick: bool) -> [f32; 4] {
    let around = libm::hypotf(d.x, d.y);
    let s = libm::atan2f(d.y, d.x) / TAU + 0.5;
    let t = libm::atan2f(around, d.z) / PI;
    let lod = libm::log2f(width * sampler.level(0).height as f32 / PI);
    let (level, share) = levels(if quick { lod.round() } else { lod }, sampler.last());
    let span = (exact / (TAU * around.max(1e-6))).min(1.0);
    let value = latlong_level(sampler, level, s, t, span);
    if share > 0.0 { mix(value, latlong_level(sampler, level + 1, s, t, span), share) } else { value }
}

/// Returns a round probe into one level. `span` is the part of a row that it covers. Near the poles it covers more
/// texels, and rows are averaged over it, up to [`MAX_ROW`] texels. Above the centre of the first row (below that of
/// the last) the value is blended into one value at the pole itself.
fn latlong_level(sampler: &mut Sampler<'_>, level: usize, s: f32, t: f32, span: f32) -> [f32; 4] {
    let (width, height) = (sampler.level(level).width, sampler.level(level).height);
    // One texel is covered by interpolation itself.
    let reach = ((span * width as f32).powi(2) - 1.0).max(0.0).sqrt().min(MAX_ROW as f32);
    let (y, fy) = cell(t.clamp(0.0, 1.0), height);
    let last = height as i32 - 1;
    if y < 0 {
        // The blend goes from the pole (fy = 0.5) to the middle of the first row (fy = 1).
        let value = row(sampler, level, 0, s, reach);
        mix(pole(sampler, level, 0), value, (2.0 * fy - 1.0).clamp(0.0, 1.0))
    } else if y >= last {
        let value = row(sampler, level, last as u32, s, reach);
        mix(value, pole(sampler, level, last as u32), (2.0 * fy).clamp(0.0, 1.0))
    } else {
        let upper = row(sampler, level, y as u32, s, reach);
        mix(upper, row(sampler, level, y as u32 + 1, s, reach), fy)
    }
}

/// Returns the mean of the linearly interpolated texels of a row, over `reach` texels around `s`. It is integrated
/// exactly, because a sum over points would be discontinuous in their number.
fn row(sampler: &mut Sampler<'_>, level: usize, y: u32, s: f32, reach: f32) -> [f32; 4] {
    let width = sampler.level(level).width;
    let column = |x: i32| x.rem_euclid(width as i32) as u32;
    let (x, fx) = cell(s - s.floor(), width);
    if reach < 0.01 {
        let left = sampler.texel(level, column(x), y);
        return mix(left, sampler.texel(level, column(x + 1), y), fx);
    }
    // The integral of the tent of height 1 around 0, from minus infinity to v.
    let tent = |v: f32| match v.clamp(-1.0, 1.0) {
        v if v < 0.0 => 0.5 * (v + 1.0) * (v + 1.0),
        v => 1.0 - 0.5 * (1.0 - v) * (1.0 - v),
    };
    let half = 0.5 * reach;
    let (first, end) = ((fx - half - 1.0).ceil() as i32, (fx + half + 1.0).floor() as i32);
    let mut mean = Mean::default();
    for i in first..=end {
        let offset = i as f32 - fx;
        let weight = tent(offset + half) - tent(offset - half);
        if weight > 0.0 {
            mean.add(sampler.texel(level, column(x + i), y), weight);
        }
    }
    mean.value()
}

/// Returns the value at a pole, which is the mean of the row next to it.
fn pole(sampler: &mut Sampler<'_>, level: usize, row: u32) -> [f32; 4] {
    let width = sampler.level(level).width;
    let count = width.min(MAX_ROW);
    let mut mean = Mean::default();
    for i in 0..count {
        let x = (u64::from(i) * u64::from(width) / u64::from(count)) as u32;
        mean.add(sampler.texel(level, x, row), 1.0);
    }
    mean.value()
}
