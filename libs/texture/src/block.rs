//! Slices of an image as one block.

use crate::Wrap;
use crate::footprint::mix;
use crate::image::{half, taps};
use crate::wrap::cell;
use granita_base::{Filter, Vec3};

/// One level, with interleaved channels, columns fastest, slices slowest.
#[derive(Debug)]
pub(crate) struct Block {
    pub(crate) size: [usize; 3],
    pub(crate) channels: usize,
    pub(crate) data: Vec<f32>,
}

impl Block {
    /// Returns the block at half the size in every direction. Each texel is the mean of those that it covers.
    pub(crate) fn halved(&self) -> Self {
        let mut block = Self { size: self.size, channels: self.channels, data: self.data.clone() };
        for axis in 0..3 {
            block = block.halved_along(axis);
        }
        block
    }

    fn halved_along(self, axis: usize) -> Self {
        let (from, to) = (self.size[axis], half(self.size[axis]));
        if from == to {
            return self;
        }
        let taps = taps(from, to, Filter::Box, Wrap::Clamp);
        let mut size = self.size;
        size[axis] = to;
        // `step` is the number of values between neighbours along the axis. `outer` is the number of blocks of `from *
        // step` values each.
        let step: usize = self.channels * self.size[..axis].iter().product::<usize>();
        let outer: usize = self.size[axis + 1..].iter().product();
        let mut data = Vec::with_capacity(outer * to * step);
        for block in 0..outer {
            for t in &taps {
                data.extend((0..step).map(|k| t.apply(|i| self.data[(block * from + i) * step + k])));
            }
        }
        Self { size, channels: self.channels, data }
    }

    /// Returns the trilinear value of channels `first .. first + n` at a position in fractions of the block.
    pub(crate) fn at(&self, p: Vec3, wrap: [Wrap; 3], first: usize, n: usize) -> [f32; 4] {
        let size = self.size.map(|n| n as u32);
        let place: [(i32, f32); 3] = std::array::from_fn(|a| cell(wrap[a].reduce(p[a]), size[a]));
        let [xs, ys, zs]: [[Option<i32>; 2]; 3] =
            std::array::from_fn(|a| [0, 1].map(|more| wrap[a].index(place[a].0 + more, size[a] as i32)));
        let texel = |x: Option<i32>, y: Option<i32>, z: Option<i32>| match (x, y, z) {
            (Some(x), Some(y), Some(z)) => {
                let row = z as usize * self.size[1] + y as usize;
                self.texel((row * self.size[0] + x as usize) * self.channels + first, n)
            }
            _ => [0.0; 4],
        };
        let [fx, fy, fz] = place.map(|(_, f)| f);
        let row = |y, z| mix(texel(xs[0], y, z), texel(xs[1], y, z), fx);
        let slice = |z| mix(row(ys[0], z), row(ys[1], z), fy);
        mix(slice(zs[0]), slice(zs[1]), fz)
    }

    /// Returns the first `n` of four numbers from `at` on.
    #[inline]
    fn texel(&self, at: usize, n: usize) -> [f32; 4] {
        let d = &self.data[at..at + n];
        // A copy of a length that is known only here is a call.
        match *d {
            [a] => [a, 0.0, 0.0, 0.0],
            [a, b] => [a, b, 0.0, 0.0],
            [a, b, c] => [a, b, c, 0.0],
            [a, b, c, d] => [a, b, c, d],
            _ => unreachable!("one to four channels are requested"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halving_keeps_the_mean() {
        let size = [5, 4, 3];
        let data: Vec<f32> =
            (0..2 * 60).map(|i| granita_base::hash::unit(granita_base::hash::words(&[i]))).collect();
        let block = Block { size, channels: 2, data };
        let mean = |b: &Block, c: usize| {
            let values = b.data.iter().skip(c).step_by(2);
            values.clone().sum::<f32>() / values.count() as f32
        };
        let (small, half) = (block.halved().halved(), block.halved());
        assert_eq!((half.size, small.size), ([2, 2, 1], [1, 1, 1]));
        for c in 0..2 {
            assert!((mean(&half, c) - mean(&block, c)).abs() < 1e-6);
            assert!((mean(&small, c) - mean(&block, c)).abs() < 1e-6);
        }
    }

    /// The value between texels is that of eight texels, fetched one by one.
    #[test]
    fn values_between_texels_are_those_of_eight() {
        let size = [5, 4, 3];
        let noise = |i: u32| granita_base::hash::unit(granita_base::hash::words(&[i]));
        let block = Block { size, channels: 5, data: (0..5 * 60).map(noise).collect() };
        for i in 0..500 {
            let p = Vec3::new(noise(i), noise(i + 1000), noise(i + 2000)) * 4.0 - Vec3::splat(1.5);
            let wrap = [0, 1, 2].map(|a| Wrap::ALL[(i as usize >> (2 * a)) % 4]);
            let (first, n) = (i as usize % 2, 1 + i as usize % 4);
            let texel = |x: i32, y: i32, z: i32, c: usize| {
                let at = [x, y, z];
                let inside = [0, 1, 2].map(|a| wrap[a].index(at[a], size[a] as i32));
                let [Some(x), Some(y), Some(z)] = inside else { return 0.0 };
                block.data[((z as usize * 4 + y as usize) * 5 + x as usize) * 5 + c]
            };
            let [(x, fx), (y, fy), (z, fz)] = [0, 1, 2].map(|a| cell(wrap[a].reduce(p[a]), size[a] as u32));
            let between = |a: f32, b: f32, f: f32| a + (b - a) * f;
            let got = block.at(p, wrap, first, n);
            for (c, got) in got.iter().enumerate() {
                let row = |y, z| between(texel(x, y, z, first + c), texel(x + 1, y, z, first + c), fx);
                let slice = |z| between(row(y, z), row(y + 1, z), fy);
                let expected = if c < n { between(slice(z), slice(z + 1), fz) } else { 0.0 };
                assert_eq!(got.to_bits(), expected.to_bits(), "{p} {wrap:?} {c}");
            }
        }
    }
}
