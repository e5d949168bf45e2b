//! Texture filtering by brute force, for tests and benches.
#![allow(dead_code, unreachable_pub, clippy::unwrap_used, reason = "each user takes its part; a test")]

use granita_base::hash;
use granita_texture::{Lookup, TextureCache};

/// The largest level of a texture that repeats, in memory.
pub struct Brute {
    width: usize,
    height: usize,
    channels: usize,
    texels: Vec<[f32; 3]>,
}

/// Returns a hashed number in [0, 1).
fn unit(i: u32, k: u32) -> f32 {
    hash::unit(hash::words(&[i, k]))
}

/// Returns footprint number `i` of an image of this size, and its ratio. Widths are from 1 texel to half of the image,
/// and ratios from 1 to 64, in all directions.
pub fn footprint(i: u32, size: (u32, u32)) -> (f32, Lookup) {
    let r = |k| unit(i, k);
    let most = size.0.min(size.1) as f32 * 0.5;
    let ratio = 64.0_f32.powf(r(0)).min(most);
    let b = (most / ratio).powf(r(1));
    let (a, angle, turn) = (b * ratio, r(2) * std::f32::consts::TAU, r(3) * std::f32::consts::TAU);
    let (x, y) = ([a * angle.cos(), a * angle.sin()], [-b * angle.sin(), b * angle.cos()]);
    // Any two conjugate diameters define the same ellipse.
    let dx = [0, 1].map(|c| x[c] * turn.cos() + y[c] * turn.sin());
    let dy = [0, 1].map(|c| y[c] * turn.cos() - x[c] * turn.sin());
    let (w, h) = (size.0 as f32, size.1 as f32);
    let lookup = Lookup {
        s: r(4),
        t: r(5),
        dsdx: dx[0] / w,
        dtdx: dx[1] / h,
        dsdy: dy[0] / w,
        dtdy: dy[1] / h,
        ..Lookup::default()
    };
    (ratio, lookup)
}

impl Brute {
    pub fn read(cache: &TextureCache, name: &str) -> Self {
        let id = cache.find(name).unwrap();
        let floats = |what| cache.info(name, what).unwrap().data.to_floats().unwrap();
        let (size, channels) = (floats("resolution"), floats("channels")[0] as usize);
        let (width, height) = (size[0] as usize, size[1] as usize);
        let texel = |i: usize| {
            let (s, t) = ((i % width) as f32 + 0.5, (i / width) as f32 + 0.5);
            let at = Lookup { s: s / width as f32, t: t / height as f32, ..Lookup::default() };
            let mut value = [0.0; 3];
            cache.texture(id, &at, &mut value);
            value
        };
        Self { width, height, channels: channels.min(3), texels: (0..width * height).map(texel).collect() }
    }

    pub fn size(&self) -> (u32, u32) {
        (self.width as u32, self.height as u32)
    }

    pub fn channels(&self) -> usize {
        self.channels
    }

    /// Returns the value of the bilinear image, which repeats, at a position in texels.
    fn bilinear(&self, x: f64, y: f64) -> [f32; 3] {
        let (x, y) = (x - 0.5, y - 0.5);
        let (fx, fy) = ((x - x.floor()) as f32, (y - y.floor()) as f32);
        let column = |x: f64| (x as i64).rem_euclid(self.width as i64) as usize;
        let row = |y: f64| (y as i64).rem_euclid(self.height as i64) as usize * self.width;
        let (x0, x1) = (column(x.floor()), column(x.floor() + 1.0));
        let (y0, y1) = (row(y.floor()), row(y.floor() + 1.0));
        std::array::from_fn(|c| {
            let at = |i: usize| self.texels[i][c];
            let top = at(y0 + x0) * (1.0 - fx) + at(y0 + x1) * fx;
            let bottom = at(y1 + x0) * (1.0 - fx) + at(y1 + x1) * fx;
            top * (1.0 - fy) + bottom * fy
        })
    }

    /// Returns the mean of the bilinear image under the Gaussian of a footprint, by 4096 stratified samples. Its
    /// deviation along each axis is half the width, after a texel's own share (a width of one) is subtracted.
    pub fn mean(&self, q: &Lookup) -> [f32; 3] {
        let (w, h) = (self.width as f64, self.height as f64);
        let (dx, dy) =
            ([f64::from(q.dsdx) * w, f64::from(q.dtdx) * h], [f64::from(q.dsdy) * w, f64::from(q.dtdy) * h]);
        let (xx, xy, yy) =
            (dx[0] * dx[0] + dy[0] * dy[0], dx[0] * dx[1] + dy[0] * dy[1], dx[1] * dx[1] + dy[1] * dy[1]);
        let angle = 0.5 * (2.0 * xy).atan2(xx - yy);
        let (mean, root) = (0.5 * (xx + yy), (0.5 * (xx - yy)).hypot(xy));
        let deviation = |squared: f64| (0.25 * (squared - 1.0)).max(0.0).sqrt();
        let (a, b) = (deviation(mean + root), deviation(mean - root));
        let (sin, cos) = angle.sin_cos();
        let mut sum = [0.0_f64; 3];
        // A lattice of two irrational steps (Roberts, 2018: the plastic number's) has less noise than random positions.
        {
            for k in 0..4096_u32 {
                let u = (0.5 + f64::from(k) * 0.754_877_666_246_693).fract();
                let v = (0.5 + f64::from(k) * 0.569_840_290_998_053_3).fract();
                let radius = (-2.0 * (1.0 - u).ln()).sqrt();
                let (y, x) = (v * std::f64::consts::TAU).sin_cos();
                let (x, y) = (x * radius * a, y * radius * b);
                let at = self
                    .bilinear(f64::from(q.s) * w + x * cos - y * sin, f64::from(q.t) * h + x * sin + y * cos);
                for (s, v) in sum.iter_mut().zip(at) {
                    *s += f64::from(v);
                }
            }
        }
        sum.map(|s| (s / 4096.0) as f32)
    }
}
