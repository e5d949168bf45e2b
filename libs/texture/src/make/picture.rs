//! One image with its windows and channels, as a whole in memory.

use super::options::BrokenValues;
use crate::image::Image;
use rayon::prelude::*;

/// A rectangle of pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Window {
    pub(crate) x: i64,
    pub(crate) y: i64,
    pub(crate) width: usize,
    pub(crate) height: usize,
}

impl Window {
    /// Returns the smallest window that contains both.
    pub(crate) fn union(self, other: Self) -> Self {
        let (x, y) = (self.x.min(other.x), self.y.min(other.y));
        let right = (self.x + self.width as i64).max(other.x + other.width as i64);
        let bottom = (self.y + self.height as i64).max(other.y + other.height as i64);
        Self { x, y, width: (right - x) as usize, height: (bottom - y) as usize }
    }
}

/// An image, its data window and its display window.
#[derive(Clone, Debug)]
pub(crate) struct Picture {
    /// The pixels of the data window.
    pub(crate) image: Image,
    pub(crate) data: Window,
    pub(crate) full: Window,
    pub(crate) channels: Vec<String>,
}

/// The statistics of one channel, of its finite values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct ChannelStatistics {
    pub(crate) low: f32,
    pub(crate) high: f32,
    pub(crate) mean: f32,
}

/// The statistics of the channels of one row: the lowest and the highest value, the sum and the number of values.
/// Values that are not finite do not count.
pub(crate) struct RowStatistics(Vec<(f32, f32, f64, u64)>);

/// The statistics of no value.
const NOTHING: (f32, f32, f64, u64) = (f32::INFINITY, f32::NEG_INFINITY, 0.0, 0);

/// Adds a value to the statistics of its channel.
#[inline(always)]
fn add(one: &mut (f32, f32, f64, u64), v: f32) {
    let is_finite = v.is_finite();
    let (low, high, term) = if is_finite { (v, v, f64::from(v)) } else { (NOTHING.0, NOTHING.1, 0.0) };
    *one = (one.0.min(low), one.1.max(high), one.2 + term, one.3 + u64::from(is_finite));
}

impl RowStatistics {
    fn none(n: usize) -> Self {
        Self(vec![NOTHING; n])
    }

    /// Returns the statistics of a row of `n` channels.
    pub(crate) fn of(row: &[f32], n: usize) -> Self {
        match n {
            1 => Self::of_texels(row.as_chunks::<1>().0),
            3 => Self::of_texels(row.as_chunks::<3>().0),
            4 => Self::of_texels(row.as_chunks::<4>().0),
            6 => Self::of_texels(row.as_chunks::<6>().0),
            _ => {
                let mut all = Self::none(n);
                for texel in row.chunks_exact(n) {
                    all.0.iter_mut().zip(texel).for_each(|(one, v)| add(one, *v));
                }
                all
            }
        }
    }

    /// Does the same for a constant number of channels, whose statistics stay in registers.
    fn of_texels<const N: usize>(texels: &[[f32; N]]) -> Self {
        let mut all = [NOTHING; N];
        for texel in texels {
            all.iter_mut().zip(texel).for_each(|(one, v)| add(one, *v));
        }
        Self(all.to_vec())
    }

    /// Returns the smallest number of finite values of a channel.
    pub(crate) fn finite(&self) -> u64 {
        self.0.iter().map(|channel| channel.3).min().unwrap_or(0)
    }

    /// Returns the statistics of all rows. Sums are added in the order of the rows.
    pub(crate) fn total(rows: &[Self], n: usize) -> Vec<ChannelStatistics> {
        let mut total = Self::none(n);
        for row in rows {
            for (all, one) in total.0.iter_mut().zip(&row.0) {
                *all = (all.0.min(one.0), all.1.max(one.1), all.2 + one.2, all.3 + one.3);
            }
        }
        let finish = |(low, high, sum, count): (f32, f32, f64, u64)| match count {
            0 => ChannelStatistics { low: 0.0, high: 0.0, mean: 0.0 },
            _ => ChannelStatistics { low, high, mean: (sum / count as f64) as f32 },
        };
        total.0.into_iter().map(finish).collect()
    }
}

/// True when the channel of this name is alpha.
pub(crate) fn is_alpha(name: &str) -> bool {
    let name = name.rsplit('.').next().unwrap_or_default();
    name == "A" || name.eq_ignore_ascii_case("alpha")
}

impl Picture {
    /// Returns the index of the alpha channel.
    pub(crate) fn alpha(&self) -> Option<usize> {
        self.channels.iter().position(|name| is_alpha(name))
    }

    /// Returns the statistics of each channel.
    pub(crate) fn statistics(&self) -> Vec<ChannelStatistics> {
        let n = self.image.channels;
        let row = self.image.width * n;
        let rows: Vec<_> =
            self.image.data.par_chunks(row.max(1)).map(|row| RowStatistics::of(row, n)).collect();
        RowStatistics::total(&rows, n)
    }

    /// True when all channels of each pixel are equal.
    pub(crate) fn is_grey(&self) -> bool {
        self.image
            .data
            .par_chunks_exact(self.image.channels)
            .all(|texel| texel.iter().all(|v| *v == texel[0]))
    }

    /// Keeps the first `count` channels, or adds channels of 0.
    pub(crate) fn set_channels(&mut self, count: usize) {
        let n = self.image.channels;
        let mut out = Image::new(self.image.width, self.image.height, count);
        let kept = n.min(count);
        out.data.par_chunks_exact_mut(count).zip(self.image.data.par_chunks_exact(n)).for_each(
            |(to, from)| {
                to[..kept].copy_from_slice(&from[..kept]);
            },
        );
        self.image = out;
        self.channels.truncate(count);
        let names = granita_image::ImageSpec::default_channels(count);
        self.channels.extend(names.into_iter().skip(n));
    }

    /// Extends the data window by black pixels until it contains this window.
    pub(crate) fn pad(&mut self, window: Window) {
        let window = window.union(self.data);
        if window != self.data {
            let mut out = Image::new(window.width, window.height, self.image.channels);
            let (x, y) = ((self.data.x - window.x) as usize, (self.data.y - window.y) as usize);
            out.paste(&self.image, x, y);
            (self.image, self.data) = (out, window);
        }
    }

    /// Treats values that are not finite. Returns the number of pixels that hold one.
    pub(crate) fn repair(&mut self, broken: BrokenValues) -> usize {
        let (w, h, n) = (self.image.width, self.image.height, self.image.channels);
        let is_broken = |texel: &[f32]| texel.iter().any(|v| !v.is_finite());
        let found: Vec<usize> = (self.image.data.par_chunks_exact(n).enumerate())
            .filter(|(_, texel)| is_broken(texel))
            .map(|(i, _)| i)
            .collect();
        for &i in &found {
            let (x, y) = (i % w, i / w);
            for c in 0..n {
                let v = self.image.data[i * n + c];
                if v.is_finite() {
                    continue;
                }
                self.image.data[i * n + c] = match broken {
                    BrokenValues::Keep | BrokenValues::Refuse => v,
                    BrokenValues::Replace if v.is_nan() => 0.0,
                    BrokenValues::Replace => v.clamp(-1e30, 1e30),
                    BrokenValues::Black => 0.0,
                    BrokenValues::Fix => {
                        let (mut sum, mut count) = (0.0_f32, 0_u8);
                        for y in y.saturating_sub(1)..(y + 2).min(h) {
                            for x in x.saturating_sub(1)..(x + 2).min(w) {
                                let v = self.image.data[(y * w + x) * n + c];
                                if v.is_finite() {
                                    (sum, count) = (sum + v, count + 1);
                                }
                            }
                        }
                        if count > 0 { sum / f32::from(count) } else { 0.0 }
                    }
                };
            }
        }
        found.len()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(width: usize, height: usize, channels: usize, data: Vec<f32>) -> Picture {
        let window = Window { x: 0, y: 0, width, height };
        Picture {
            image: Image { width, height, channels, data },
            data: window,
            full: window,
            channels: granita_image::ImageSpec::default_channels(channels),
        }
    }

    #[test]
    fn broken_values_are_repaired_and_counted() {
        let odd = picture(3, 1, 1, vec![1.0, f32::NAN, 3.0]);
        for (broken, expected) in
            [(BrokenValues::Black, 0.0), (BrokenValues::Fix, 2.0), (BrokenValues::Replace, 0.0)]
        {
            let mut p = odd.clone();
            assert_eq!((p.repair(broken), p.image.data[1]), (1, expected));
        }
        let statistics = odd.statistics()[0];
        assert_eq!((statistics.low, statistics.high, statistics.mean), (1.0, 3.0, 2.0));
    }

    #[test]
    fn channels_are_added_and_left_out() {
        let mut p = picture(1, 1, 4, vec![0.5, 0.5, 0.5, 1.0]);
        assert_eq!(p.alpha(), Some(3));
        p.set_channels(3);
        assert!(p.is_grey() && p.alpha().is_none());
        p.set_channels(5);
        assert_eq!(
            (p.image.data.as_slice(), &*p.channels[4]),
            ([0.5, 0.5, 0.5, 0.0, 0.0].as_slice(), "channel4")
        );
        p.channels[3] = "X".to_owned();
        p.channels[4] = "light.A".to_owned();
        assert_eq!(p.alpha(), Some(4));
    }

    #[test]
    fn windows_are_padded_with_black() {
        let mut p = picture(1, 1, 1, vec![2.0]);
        p.pad(Window { x: -1, y: 0, width: 3, height: 2 });
        assert_eq!(p.image.data, [0.0, 2.0, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!(p.data, Window { x: -1, y: 0, width: 3, height: 2 });
    }
}
