//! Filtered lookups of `texture3d ()` in volume textures (reference 5.8.10).
//!
//! The images of a file are its slices, from front to back, all of one size and with the same channels. An image
//! file with one image has one slice. All of it is held in memory with its MIP levels, each half as large in the
//! three directions. A footprint is an ellipse in space. Its width across selects the level, and probes along it
//! interpolate between eight texels of the two levels around (as for narrow footprints in images, see `footprint`).

use crate::TextureId;
use crate::block::Block;
use crate::file::TextureFile;
use crate::footprint::{Ellipse, MAX_ANISOTROPY, Mean, Spread, mix};
use crate::lookup::Lookup3d;
use crate::plain::by_channels;
use crate::reader::TextureReader;
use crate::sampler::levels;
use crate::shared::Shared;
use granita_base::Vec3;
use granita_image::ImageInput;

/// The largest ratio of the blurs in two directions. Beyond it the smaller one is increased.
const MAX_BLUR_RATIO: f32 = 8.0;
/// The largest number of bytes of the largest level.
const MAX_BYTES: u64 = 1 << 32;

/// Reads the slices of a file and makes the smaller levels.
///
/// # Errors
/// Returns a description of the error in the file.
fn read(input: &dyn ImageInput, channels: usize) -> Result<Vec<Block>, String> {
    let first = input.spec(0, 0).ok_or("it has no image")?;
    let (width, height, count) = (first.width as usize, first.height as usize, input.images());
    let bytes = [width, height, count, channels, 4].iter().try_fold(1_u64, |a, &b| a.checked_mul(b as u64));
    if bytes.is_none_or(|b| b > MAX_BYTES) {
        return Err(format!(
            "{count} slices of {width} x {height} pixels with {channels} channels are more than {MAX_BYTES} bytes"
        ));
    }
    let mut data = Vec::new();
    for image in 0..count {
        let spec = input.spec(image, 0).ok_or("an image is missing")?;
        if (spec.width, spec.height, spec.nchannels()) != (first.width, first.height, channels) {
            return Err(format!(
                "slice {image} has {} x {} pixels with {} channels, the first {width} x {height} with {channels}",
                spec.width,
                spec.height,
                spec.nchannels()
            ));
        }
        let pixels = input.read_level(image, 0).map_err(|e| e.to_string())?.to_floats();
        data.extend(pixels.iter().map(|v| if v.is_nan() { 0.0 } else { v.clamp(-1e30, 1e30) }));
    }
    let mut blocks = vec![Block { size: [width, height, count], channels, data }];
    while let Some(last) = blocks.last().filter(|b| b.size.iter().any(|n| *n > 1)) {
        let next = last.halved();
        blocks.push(next);
    }
    Ok(blocks)
}

/// Probes along an axis: the distance of each from the centre, and its weight. They are as many as an ellipse has at
/// most.
struct Line {
    probes: [(f32, f32); 2 * MAX_ANISOTROPY as usize],
    count: usize,
}

impl Line {
    fn of(probes: impl Iterator<Item = (f32, f32)>) -> Self {
        let mut line = Self { probes: [(0.0, 0.0); 2 * MAX_ANISOTROPY as usize], count: 0 };
        for (place, probe) in line.probes.iter_mut().zip(probes) {
            *place = probe;
            line.count += 1;
        }
        line
    }

    fn probes(&self) -> &[(f32, f32)] {
        &self.probes[..self.count]
    }
}

impl Shared {
    /// Returns the levels of a file's slices, which are read on first use. They are empty when they cannot be read.
    fn slices<'f>(&self, file: &'f TextureFile) -> &'f [Block] {
        file.slices.get_or_init(|| {
            let read = self.open_whole(file).and_then(|input| read(&*input, file.channels));
            read.unwrap_or_else(|what| {
                self.warn_once(file, &format!("cannot be looked up in three dimensions: {what}"));
                Vec::new()
            })
        })
    }
}

impl TextureReader<'_> {
    /// Implements [`TextureCache::texture3d`](crate::TextureCache::texture3d).
    pub fn texture3d(&mut self, id: TextureId, lookup: &Lookup3d, out: &mut [f32]) {
        let file = self.look_up(id);
        texture3d(self, file, lookup, out);
    }
}

fn texture3d(reader: &mut TextureReader<'_>, file: &TextureFile, q: &Lookup3d, out: &mut [f32]) {
    let blocks = reader.shared().slices(file);
    let Some(base) = blocks.first() else {
        out.fill(q.fill);
        if let Some(alpha) = out.last_mut() {
            *alpha = 0.0;
        }
        return;
    };
    let (swrap, twrap) = (q.swrap.unwrap_or(file.swrap), q.twrap.unwrap_or(file.twrap));
    let size = Vec3::from_array(base.size.map(|n| n as f32));
    let width = Vec3::new(q.swidth, q.twidth, q.twidth);
    let sane = |v: Vec3| {
        Vec3::from_array(v.to_array().map(|v| if v.is_finite() { v.clamp(-1e6, 1e6) } else { 0.0 }))
    };
    let [x, y] = [q.dpdx, q.dpdy].map(|d| sane(d * width) * size);
    // The ellipse that the two vectors span, in the plane of both.
    let along = if x.length_squared() >= y.length_squared() { x } else { y };
    let first = along.normalize_or(Vec3::X);
    let second = (x + y - first * (x + y).dot(first)).normalize_or(Vec3::ZERO);
    let mut spread = Spread::default();
    for d in [x, y] {
        spread.add(d.dot(first), d.dot(second));
    }
    let mut ellipse = spread.ellipse();
    // The ellipse contains the blur that is common to all directions. The additional blur of each direction is applied
    // separately.
    let blur = (sane(Vec3::new(q.sblur, q.tblur, q.tblur)) * size).abs();
    let all = f64::from(blur.min_element().max(blur.max_element() / MAX_BLUR_RATIO));
    if all > 0.0 {
        (ellipse.a, ellipse.b) = (libm::hypot(ellipse.a, all), libm::hypot(ellipse.b, all));
    }
    let probes = ellipse.probes(1.0);
    let step = (first * ellipse.axis[0] + second * ellipse.axis[1]) / size;
    let (level, share) = levels(libm::log2f(probes.width), blocks.len() - 1);
    let width = f64::from(probes.width);
    // The probes of the additional blur along each axis.
    let more: [Line; 3] = std::array::from_fn(|k| {
        let more = (f64::from(blur[k]).powi(2) - all * all).max(0.0).sqrt();
        if more > 0.0 {
            let line = Ellipse { axis: [1.0, 0.0], a: libm::hypot(width, more), b: width };
            Line::of(line.probes(1.0).iter().map(|(x, weight)| (x / size[k], weight)))
        } else {
            Line::of(std::iter::once((0.0, 1.0)))
        }
    });
    let [across, down, back] = &more;
    let wrap = [swrap, twrap, twrap];
    let mut count = 0;
    by_channels(file, q.first_channel, q.fill, out, |first, n| {
        if !q.p.is_finite() {
            return [0.0; 4];
        }
        let mut mean = Mean::default();
        for (along, weight) in probes.iter() {
            let on_axis = q.p + step * along;
            for &(z, z_weight) in back.probes() {
                for &(y, y_weight) in down.probes() {
                    for &(x, x_weight) in across.probes() {
                        let (p, weight) =
                            (on_axis + Vec3::new(x, y, z), weight * (x_weight * y_weight * z_weight));
                        let mut value = blocks[level].at(p, wrap, first, n);
                        if share > 0.0 {
                            value = mix(value, blocks[level + 1].at(p, wrap, first, n), share);
                        }
                        mean.add(value, weight);
                    }
                }
            }
        }
        count += u64::from(probes.count) * more.iter().map(|line| line.count as u64).product::<u64>();
        mean.value()
    });
    reader.probes += count;
}
