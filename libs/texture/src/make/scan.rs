//! The content of an image: a hash of its pixels, their mean, and whether all are equal.

use granita_image::{PixelType, Pixels};
use sha1::{Digest, Sha1};
use std::fmt::Write;

/// The number of rows whose hash is one part of the hash of an image, by the conventions of OpenImageIO.
pub(crate) const HASHED_ROWS: usize = 256;

/// The content of level 0, which is scanned before it is written.
pub(crate) struct Scan {
    hash: Option<Sha1>,
    sums: Vec<f64>,
    pixels: u64,
    first: Option<Pixels>,
    /// True when no pixel differs from the first.
    pub(crate) constant: bool,
}

impl Scan {
    /// Returns the scan of an image of this size and type, with or without hash and mean.
    pub(crate) fn new(size: (usize, usize), channels: usize, pixel_type: PixelType, hash: bool) -> Self {
        let hash = hash.then(|| {
            let mut sha1 = Sha1::new();
            sha1.update(format!("{} x {} x {channels} {pixel_type:?}\n", size.0, size.1));
            sha1
        });
        Self { hash, sums: vec![0.0; channels], pixels: 0, first: None, constant: true }
    }

    /// Adds whole rows, from the top. Returns true when further rows can change the result.
    pub(crate) fn push(&mut self, pixels: &Pixels) -> bool {
        let n = self.sums.len();
        if self.constant && pixels.len() >= n {
            let first = self.first.get_or_insert_with(|| {
                let mut first = Pixels::zeros(pixels.pixel_type(), n);
                first.copy_from(0, pixels, 0, n);
                first
            });
            self.constant = repeats(pixels, first, n);
        }
        if let Some(sha1) = &mut self.hash {
            let mut bytes = Vec::new();
            pixels.append_le_bytes(&mut bytes);
            sha1.update(&bytes);
            self.pixels += (pixels.len() / n) as u64;
            for texel in pixels.to_floats().chunks_exact(n) {
                for (sum, v) in self.sums.iter_mut().zip(texel) {
                    *sum += f64::from(*v);
                }
            }
        }
        self.constant || self.hash.is_some()
    }

    /// Returns the hash in hexadecimal digits and the mean of every channel; `None` unless they were requested.
    pub(crate) fn content(&self) -> Option<(String, Vec<f32>)> {
        let hash = hexadecimal(self.hash.clone()?);
        let mean = self.sums.iter().map(|s| (s / self.pixels.max(1) as f64) as f32).collect();
        Some((hash, mean))
    }
}

/// Adds the bytes of values to a hash.
pub(crate) fn update(sha1: &mut Sha1, values: &[f32]) {
    let mut bytes = [0; 4 * 1024];
    for values in values.chunks(1024) {
        let places = bytes.as_chunks_mut::<4>().0;
        places.iter_mut().zip(values).for_each(|(place, v)| *place = v.to_le_bytes());
        sha1.update(&bytes[..4 * values.len()]);
    }
}

/// Returns the hash in hexadecimal digits.
pub(crate) fn hexadecimal(sha1: Sha1) -> String {
    sha1.finalize().iter().fold(String::new(), |mut text, byte| {
        // Writing to a string does not fail.
        let _ = write!(text, "{byte:02X}");
        text
    })
}

/// True when all pixels equal `first`.
fn repeats(pixels: &Pixels, first: &Pixels, n: usize) -> bool {
    fn same<T: PartialEq>(all: &[T], first: &[T], n: usize) -> bool {
        all.chunks_exact(n).all(|p| p == first)
    }
    match (pixels, first) {
        (Pixels::U8(v), Pixels::U8(f)) => same(v, f, n),
        (Pixels::U16(v), Pixels::U16(f)) => same(v, f, n),
        (Pixels::U32(v), Pixels::U32(f)) => same(v, f, n),
        (Pixels::Half(v), Pixels::Half(f)) => same(v, f, n),
        (Pixels::Float(v), Pixels::Float(f)) => same(v, f, n),
        _ => false,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scans_find_constants_hashes_and_means() {
        let mut a = Scan::new((2, 2), 2, PixelType::U8, true);
        assert!(a.push(&Pixels::U8(vec![51, 255, 51, 255])));
        assert!(a.constant);
        let mut b = Scan::new((2, 2), 2, PixelType::U8, true);
        b.push(&Pixels::U8(vec![51, 255, 51, 255, 51, 255, 51, 255]));
        a.push(&Pixels::U8(vec![51, 255, 51, 255]));
        assert_eq!(a.content(), b.content());
        let (hash, mean) = a.content().unwrap();
        assert_eq!((hash.len(), mean), (40, vec![0.2, 1.0]));
        let mut c = Scan::new((2, 2), 2, PixelType::U8, false);
        assert!(!c.push(&Pixels::U8(vec![1, 2, 1, 3])));
        assert!(!c.constant && c.content().is_none());
    }
}
