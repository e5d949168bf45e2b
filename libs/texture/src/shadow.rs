//! Filtered lookups of `shadow ()`: percentage-closer filtering of depth maps (Reeves, Salesin and Cook, Rendering
//! Antialiased Shadows with Depth Maps, SIGGRAPH 1987), of cubes of depth maps, and of volume shadow maps.

use crate::TextureId;
use crate::file::TextureFile;
use crate::lookup::ShadowLookup;
use crate::opacity::{opacity_around, opacity_at};
use crate::reader::TextureReader;
use crate::sampler::Sampler;
use crate::wrap::cell;
use granita_base::sample::Draw;
use granita_base::{Transform, Vec3};

/// The smallest and largest number of samples of one lookup.
const SAMPLES: (u32, u32) = (16, 4096);

/// Returns the sample positions. Each is two stratified points in [-1/2, 1/2] squared, one inside the footprint and one
/// inside the blur.
fn pattern(q: &ShadowLookup) -> impl Iterator<Item = ([f32; 2], [f32; 2])> + use<> {
    let still = |v: Vec3| v == Vec3::ZERO;
    let sharp = still(q.dpdx) && still(q.dpdy) && q.sblur == 0.0 && q.tblur == 0.0;
    // Without any extent all samples would be equal.
    let count = if sharp { 1 } else { q.samples.clamp(SAMPLES.0, SAMPLES.1) };
    let blurred = q.sblur != 0.0 || q.tblur != 0.0;
    let draws = [0, 1].map(|which| Draw { sequence: q.draw.sequence.dimension(which), ..q.draw });
    (0..count).map(move |i| {
        let centred = |which: usize| {
            let (u, v) = draws[which].square(i, count);
            [u - 0.5, v - 0.5]
        };
        (if sharp { [0.0; 2] } else { centred(0) }, if blurred { centred(1) } else { [0.0; 2] })
    })
}

/// Replaces derivatives that are not finite by zero.
fn sane(q: &ShadowLookup) -> Option<ShadowLookup> {
    let vector = |v: Vec3| if v.is_finite() { v } else { Vec3::ZERO };
    let number = |v: f32| if v.is_finite() { v } else { 0.0 };
    q.p.is_finite().then(|| ShadowLookup {
        dpdx: vector(q.dpdx),
        dpdy: vector(q.dpdy),
        sblur: number(q.sblur).clamp(-1e6, 1e6),
        tblur: number(q.tblur).clamp(-1e6, 1e6),
        swidth: number(q.swidth),
        twidth: number(q.twidth),
        bias: number(q.bias),
        ..*q
    })
}

impl TextureReader<'_> {
    /// Implements [`TextureCache::shadow`](crate::TextureCache::shadow).
    pub fn shadow(&mut self, id: TextureId, lookup: &ShadowLookup) -> f32 {
        let file = self.look_up(id);
        shadow(self, file, lookup)
    }
}

fn shadow(reader: &mut TextureReader<'_>, file: &TextureFile, q: &ShadowLookup) -> f32 {
    let (Some(camera), Some(screen), true) =
        (&file.world_to_camera, &file.world_to_screen, file.kind.is_shadow())
    else {
        reader.shared().warn_once(file, "is not a shadow map with its matrices: it casts no shadow");
        return 0.0;
    };
    let Some(q) = sane(q) else { return 0.0 };
    match file.kind {
        kind if kind.is_cube() => cube_shadow(reader, file, camera, &q),
        _ => flat_shadow(reader, file, camera, screen, &q),
    }
}

/// Returns the position in the map and the depth of a point; `None` behind the light.
fn place(camera: &Transform, screen: &Transform, p: Vec3) -> Option<(f32, f32, f32)> {
    let h = screen.hpoint(p.extend(1.0));
    let z = camera.point(p).z;
    let (s, t) = (0.5 + 0.5 * h.x / h.w, 0.5 - 0.5 * h.y / h.w);
    (h.w > 0.0 && s.is_finite() && t.is_finite() && z.is_finite()).then_some((s, t, z))
}

fn flat_shadow(
    reader: &mut TextureReader<'_>,
    file: &TextureFile,
    camera: &Transform,
    screen: &Transform,
    q: &ShadowLookup,
) -> f32 {
    let Some((s0, t0, z0)) = place(camera, screen, q.p) else { return 0.0 };
    let volume = file.kind.is_volume_shadow();
    let mut sampler = reader.sampler(file, 0, if volume { 0 } else { 1 });
    let (mut sum, mut n) = (0.0_f32, 0_u32);
    let lod = if volume { volume_lod(file, camera, screen, q, (s0, t0)) } else { 0.0 };
    for (in_footprint, in_blur) in pattern(q) {
        n += 1;
        let [u, v] = in_footprint;
        let Some((s, t, z)) = place(camera, screen, q.p + q.dpdx * u + q.dpdy * v) else { continue };
        let s = s0 + (s - s0) * q.swidth + in_blur[0] * q.sblur;
        let t = t0 + (t - t0) * q.twidth + in_blur[1] * q.tblur;
        let z = z0 + (z - z0) * 0.5 * (q.swidth.abs() + q.twidth.abs());
        sum += if volume {
            opacity_at(&mut sampler, lod, s, t, z - q.bias)
        } else {
            occluded(&mut sampler, s, t, z - q.bias)
        };
    }
    reader.probes += u64::from(n);
    sum / n as f32
}

/// Returns the level of detail of a volume map whose texels are about as far apart as the samples.
fn volume_lod(
    file: &TextureFile,
    camera: &Transform,
    screen: &Transform,
    q: &ShadowLookup,
    (s0, t0): (f32, f32),
) -> f32 {
    let (w, h) = (file.levels[0].width as f32, file.levels[0].height as f32);
    let side = |d: Vec3| {
        place(camera, screen, q.p + d)
            .map_or(0.0, |(s, t, _)| libm::hypotf((s - s0) * q.swidth * w, (t - t0) * q.twidth * h))
    };
    lod_of(q, side(q.dpdx), side(q.dpdy), (w, h))
}

/// Returns the same for a footprint of `dx` by `dy` texels in a map, or a face, of `w` by `h` texels.
fn lod_of(q: &ShadowLookup, dx: f32, dy: f32, (w, h): (f32, f32)) -> f32 {
    let width = (dx * dy).sqrt() + (q.sblur * w).abs().max((q.tblur * h).abs());
    let samples = q.samples.clamp(SAMPLES.0, SAMPLES.1) as f32;
    libm::log2f((width / samples.sqrt()).max(1.0))
}

/// Returns the bilinearly weighted share of the four texels around (s, t) that are nearer than `z`. Outside the map
/// it is 0.
fn occluded(sampler: &mut Sampler<'_>, s: f32, t: f32, z: f32) -> f32 {
    let (width, height) = (sampler.level(0).width, sampler.level(0).height);
    if !(-1.0..=2.0).contains(&s) || !(-1.0..=2.0).contains(&t) {
        return 0.0;
    }
    let ((x, fx), (y, fy)) = (cell(s, width), cell(t, height));
    let inside = |x: i32, y: i32| (0..width as i32).contains(&x) && (0..height as i32).contains(&y);
    let together = if inside(x, y) && inside(x + 1, y + 1) {
        sampler.four(0, x as u32, y as u32).map(|four| four.map(|texel| f32::from(z > texel[0])))
    } else {
        None
    };
    let [a, b, c, d] = together.unwrap_or_else(|| {
        [(x, y), (x + 1, y), (x, y + 1), (x + 1, y + 1)]
            .map(|(x, y)| f32::from(inside(x, y) && z > sampler.texel(0, x as u32, y as u32)[0]))
    });
    let (top, bottom) = (a * (1.0 - fx) + b * fx, c * (1.0 - fx) + d * fx);
    top * (1.0 - fy) + bottom * fy
}

fn cube_shadow(
    reader: &mut TextureReader<'_>,
    file: &TextureFile,
    camera: &Transform,
    q: &ShadowLookup,
) -> f32 {
    let centre = camera.point(q.p);
    if !centre.is_finite() || centre == Vec3::ZERO {
        return 0.0;
    }
    // The directions around the vertical axis and towards the poles are the same on all faces, so that no edge is
    // visible.
    let east = Vec3::Y.cross(centre).try_normalize().unwrap_or(Vec3::X);
    let north = centre.cross(east).normalize_or(Vec3::Z);
    let side = 2.0 * centre.length();
    let (right, up) = (east * (side * q.sblur), north * (side * q.tblur));
    let (dx, dy) = (camera.vector(q.dpdx), camera.vector(q.dpdy));
    let volume = file.kind.is_volume_shadow();
    let mut sampler = reader.sampler(file, 0, if volume { 0 } else { 1 });
    let lod = if volume {
        // A face spans two units at the distance 1.
        let texels = file.levels[0].face_width as f32;
        let wide = |d: Vec3| libm::hypotf(d.dot(east) * q.swidth, d.dot(north) * q.twidth) * texels / side;
        lod_of(q, wide(dx), wide(dy), (texels, texels))
    } else {
        0.0
    };
    let (mut sum, mut n) = (0.0_f32, 0_u32);
    for ([u, v], in_blur) in pattern(q) {
        n += 1;
        // Widths scale the footprint along the same axes.
        let d = dx * u + dy * v;
        let d = d + east * (d.dot(east) * (q.swidth - 1.0)) + north * (d.dot(north) * (q.twidth - 1.0));
        let place = centre + d;
        let direction = place + right * in_blur[0] + up * in_blur[1];
        if direction == Vec3::ZERO || !direction.is_finite() {
            continue;
        }
        // Blur changes the direction only. The depth of the point stays the same, as in a map of one view.
        let depth = place.abs().max_element();
        let z = depth - q.bias;
        sum += if volume {
            opacity_around(&mut sampler, lod, direction, z)
        } else {
            sampler.around(0, direction, |texel| f32::from(z > texel[0]))
        };
    }
    reader.probes += u64::from(n);
    sum / n as f32
}
