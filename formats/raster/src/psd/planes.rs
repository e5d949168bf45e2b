//! Planes of one channel, and their compression.

use super::cursor::Cursor;
use granita_image::{FileSource, Limits, Result};
use std::io::Read;
use std::sync::OnceLock;

/// The largest number of bytes that deflate packs into one.
const DEFLATE: u64 = 1032;

/// One channel of an image.
pub(super) struct Plane {
    size: Size,
    data: Data,
}

/// The size of a plane.
#[derive(Clone, Copy, Debug)]
pub(super) struct Size {
    pub(super) width: u32,
    pub(super) height: u32,
    /// The number of bits of a value: 1, 8, 16 or 32.
    pub(super) depth: u16,
}

impl Size {
    /// The number of bytes of a row.
    fn row(self) -> u64 {
        (u64::from(self.width) * u64::from(self.depth)).div_ceil(8)
    }

    /// The number of bytes of all rows.
    pub(super) fn bytes(self) -> u64 {
        self.row().saturating_mul(u64::from(self.height))
    }
}

enum Data {
    /// Rows follow each other from this offset on.
    Raw(u64),
    /// Rows are run-length encoded, each at its offset. The last offset is the end.
    Runs(Vec<u64>),
    /// All rows together are compressed with deflate.
    Zip {
        at: u64,
        len: u64,
        /// True when values are differences from the value to the left.
        differences: bool,
        unpacked: OnceLock<Vec<u8>>,
    },
}

impl Plane {
    /// Returns `count` planes that share one compression, as those of the merged image do.
    pub(super) fn merged(cursor: &mut Cursor<'_>, size: Size, count: usize, wide: bool) -> Result<Vec<Self>> {
        let (planes, bytes) = (count as u64, size.bytes());
        match cursor.u16()? {
            0 => Ok((0..planes)
                .map(|i| Self { size, data: Data::Raw(cursor.at.saturating_add(bytes.saturating_mul(i))) })
                .collect()),
            1 => {
                let offsets = row_offsets(cursor, u64::from(size.height) * planes, wide)?;
                let rows = size.height as usize;
                let runs = |i: usize| Data::Runs(offsets[i * rows..=(i + 1) * rows].to_vec());
                Ok((0..count).map(|i| Self { size, data: runs(i) }).collect())
            }
            n => Err(cursor
                .source
                .unsupported(format!("PSD with compression {n} of the merged image is not supported"))),
        }
    }

    /// Returns the plane of a layer, whose compression and data are the whole of `cursor`.
    pub(super) fn of_layer(mut cursor: Cursor<'_>, size: Size, wide: bool) -> Result<Self> {
        let data = match cursor.u16()? {
            0 => Data::Raw(cursor.at),
            1 => Data::Runs(row_offsets(&mut cursor, u64::from(size.height), wide)?),
            kind @ (2 | 3) => {
                let (at, len, unpacked) = (cursor.at, cursor.left(), OnceLock::new());
                Data::Zip { at, len, differences: kind == 3, unpacked }
            }
            n => {
                return Err(cursor
                    .source
                    .unsupported(format!("PSD with compression {n} of a layer is not supported")));
            }
        };
        Ok(Self { size, data })
    }

    /// Returns the bytes of row `y`.
    pub(super) fn row(&self, source: &FileSource, limits: &Limits, y: u32) -> Result<Vec<u8>> {
        let len = self.size.row();
        match &self.data {
            Data::Raw(at) => source.read_vec(at.saturating_add(u64::from(y) * len), len, "a row"),
            Data::Runs(offsets) => {
                let (from, to) = (offsets[y as usize], offsets[y as usize + 1]);
                // The longest encoding of a row has a count for every value.
                let packed = source.read_vec(from, (to - from).min(2 * len + 2), "a row")?;
                unpack(&packed, len as usize).ok_or_else(|| {
                    source.malformed(format!("row {y}, at byte {from}, is not {len} bytes of runs"))
                })
            }
            Data::Zip { at, len: packed, differences, unpacked } => {
                let all = match unpacked.get() {
                    Some(all) => all,
                    None => {
                        let mut all = self.inflate(source, limits, *at, *packed)?;
                        if *differences {
                            for row in all.chunks_exact_mut(len as usize) {
                                add_differences(row, self.size);
                            }
                        }
                        unpacked.get_or_init(|| all)
                    }
                };
                Ok(all[y as usize * len as usize..][..len as usize].to_vec())
            }
        }
    }

    fn inflate(&self, source: &FileSource, limits: &Limits, at: u64, packed: u64) -> Result<Vec<u8>> {
        let bytes = self.size.bytes();
        limits.within(source.path(), "bytes of a channel of a layer", bytes, limits.bytes)?;
        limits.check_ratio(source.path(), "PSD", (bytes, packed), DEFLATE)?;
        Limits::check_memory(source.path(), bytes)?;
        let packed = source.read_vec(at, packed, "a channel of a layer")?;
        let mut all = Vec::new();
        let read = flate2::read::ZlibDecoder::new(&packed[..]).take(bytes).read_to_end(&mut all);
        match read {
            Ok(_) if all.len() as u64 == bytes => Ok(all),
            Ok(n) => {
                Err(source.malformed(format!("a channel at byte {at} has {n} bytes instead of {bytes}")))
            }
            Err(error) => Err(source.malformed(format!("a channel at byte {at}: {error}"))),
        }
    }
}

/// Returns the offsets of `count` rows, whose lengths are a table before them, and the end of the last one.
fn row_offsets(cursor: &mut Cursor<'_>, count: u64, wide: bool) -> Result<Vec<u64>> {
    let unit = if wide { 4 } else { 2 };
    let table = cursor.bytes(count.saturating_mul(unit))?;
    let mut at = cursor.at;
    let lengths = table.chunks_exact(unit as usize).map(|b| b.iter().fold(0, |n, b| n << 8 | u64::from(*b)));
    let ends = lengths.map(|len| {
        // A sum of lengths of 32 bits in a table that fits memory does not overflow.
        at += len;
        at
    });
    Ok(std::iter::once(cursor.at).chain(ends).collect())
}

/// Decodes runs (PackBits, Apple's technical note TN1023) to `len` bytes. `None` when there are fewer or more.
fn unpack(mut packed: &[u8], len: usize) -> Option<Vec<u8>> {
    let mut out = Vec::with_capacity(len);
    while out.len() < len {
        let (count, rest) = packed.split_first()?;
        packed = match *count {
            count @ 0..=127 => {
                let (values, rest) = rest.split_at_checked(usize::from(count) + 1)?;
                out.extend_from_slice(values);
                rest
            }
            128 => rest,
            count => {
                let (value, rest) = rest.split_first()?;
                out.resize(out.len() + 257 - usize::from(count), *value);
                rest
            }
        };
    }
    (out.len() == len).then_some(out)
}

/// Adds to each value of a row the one to its left. The bytes of 32-bit values are sorted by their significance, and
/// each byte is a difference from the byte before it.
fn add_differences(row: &mut [u8], size: Size) {
    match size.depth {
        16 => {
            let mut before = 0_u16;
            for value in row.as_chunks_mut::<2>().0 {
                before = before.wrapping_add(u16::from_be_bytes(*value));
                *value = before.to_be_bytes();
            }
        }
        depth => {
            let mut before = 0_u8;
            for value in row.iter_mut() {
                before = before.wrapping_add(*value);
                *value = before;
            }
            if depth == 32 {
                let width = size.width as usize;
                let sorted = row.to_vec();
                for (i, value) in row.iter_mut().enumerate() {
                    *value = sorted[i % 4 * width + i / 4];
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_unpacked_to_exactly_one_row() {
        let packed = [254, 7, 128, 2, 1, 2, 3];
        assert_eq!(unpack(&packed, 6), Some(vec![7, 7, 7, 1, 2, 3]));
        for (bad, len) in [(&packed[..], 7), (&packed, 5), (&packed[..5], 6), (&[200], 3), (&[], 1)] {
            assert_eq!(unpack(bad, len), None, "{bad:?}");
        }
    }

    #[test]
    fn differences_are_added_by_the_size_of_values() {
        let of = |depth: u16, row: &[u8]| {
            let mut row = row.to_vec();
            add_differences(&mut row, Size { width: 2, height: 1, depth });
            row
        };
        assert_eq!(of(8, &[250, 10]), [250, 4]);
        assert_eq!(of(16, &[0, 255, 0, 2]), [0, 255, 1, 1]);
        // Two values 0x01020304 and 0x05060708: 1 5, 2 6, 3 7, 4 8, as differences.
        assert_eq!(of(32, &[1, 4, 253, 4, 253, 4, 253, 4]), [1, 2, 3, 4, 5, 6, 7, 8]);
    }
}
