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
        let index = |a: usize, more: i32| wrap[a].index(place[a].0 + more, size[a] as i32);
        let texel = |x: Option<i32>, y: Option<i32>, z: Option<i32>| {
            let mut out = [0.0; 4];
            if let (Some(x), Some(y), Some(z)) = (x, y, z) {
                let row = z as usize * self.size[1] + y as usize;
                let at = (row * self.size[0] + x as usize) * self.channels + first;
                out[..n].copy_from_slice(&self.data[at..at + n]);
            }
            out
        };
        let [fx, fy, fz] = place.map(|(_, f)| f);
        let row = |y, z| mix(texel(index(0, 0), y, z), texel(index(0, 1), y, z), fx);
        let slice = |z| mix(row(index(1, 0), z), row(index(1, 1), z), fy);
        mix(slice(index(2, 0)), slice(index(2, 1)), fz)
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
}
