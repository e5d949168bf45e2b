//! A part of a file that is read from its beginning to its end.

use granita_image::{FileSource, Result};

/// A place in a part of a file. All numbers are big-endian.
pub(super) struct Cursor<'a> {
    pub(super) source: &'a FileSource,
    pub(super) at: u64,
    end: u64,
    /// The name of the part in errors.
    what: &'static str,
}

impl<'a> Cursor<'a> {
    /// Returns the whole file.
    pub(super) fn new(source: &'a FileSource, what: &'static str) -> Self {
        Self { source, at: 0, end: source.len(), what }
    }

    /// The number of bytes up to the end.
    pub(super) fn left(&self) -> u64 {
        self.end.saturating_sub(self.at)
    }

    /// Returns the next `len` bytes as a part of their own, and continues behind them.
    pub(super) fn part(&mut self, len: u64, what: &'static str) -> Result<Self> {
        let at = self.at;
        self.skip(len)?;
        Ok(Self { source: self.source, at, end: self.at, what })
    }

    /// Continues `len` bytes later.
    pub(super) fn skip(&mut self, len: u64) -> Result<()> {
        if len > self.left() {
            let (what, at, end) = (self.what, self.at, self.end);
            return Err(self
                .source
                .malformed(format!("{len} bytes at byte {at}, but {what} ends at byte {end}")));
        }
        self.at += len;
        Ok(())
    }

    /// Returns the next `len` bytes.
    pub(super) fn bytes(&mut self, len: u64) -> Result<Vec<u8>> {
        let at = self.at;
        self.skip(len)?;
        self.source.read_vec(at, len, self.what)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N]> {
        let at = self.at;
        self.skip(N as u64)?;
        let mut out = [0; N];
        self.source.read_at(at, &mut out, self.what)?;
        Ok(out)
    }

    pub(super) fn u8(&mut self) -> Result<u8> {
        Ok(self.array::<1>()?[0])
    }

    pub(super) fn u16(&mut self) -> Result<u16> {
        Ok(u16::from_be_bytes(self.array()?))
    }

    pub(super) fn i16(&mut self) -> Result<i16> {
        Ok(i16::from_be_bytes(self.array()?))
    }

    pub(super) fn u32(&mut self) -> Result<u32> {
        Ok(u32::from_be_bytes(self.array()?))
    }

    pub(super) fn i32(&mut self) -> Result<i32> {
        Ok(i32::from_be_bytes(self.array()?))
    }

    pub(super) fn key(&mut self) -> Result<[u8; 4]> {
        self.array()
    }

    /// Returns a length of 8 bytes when `wide`, and else of 4.
    pub(super) fn length(&mut self, wide: bool) -> Result<u64> {
        Ok(if wide { u64::from_be_bytes(self.array()?) } else { u64::from(self.u32()?) })
    }

    /// Returns a text with its length in one byte. Both together are padded to a multiple of `unit` bytes.
    pub(super) fn pascal(&mut self, unit: u64) -> Result<String> {
        let len = u64::from(self.u8()?);
        let text = self.bytes(len)?;
        self.skip(((len + 1).next_multiple_of(unit) - len - 1).min(self.left()))?;
        Ok(String::from_utf8_lossy(&text).into_owned())
    }
}
