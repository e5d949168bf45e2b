//! The values after the header, element by element.

use super::header::Scalar;
use crate::text::{Lines, Words, read_some};
use std::io::{self, Read};

/// The reason why the values of an element cannot be read.
#[derive(Debug)]
pub(super) enum Fault {
    /// The file has ended.
    End,
    /// The line of the element has ended.
    Short,
    /// The position of the next value is unknown. The error was reported already.
    Lost,
    /// The file cannot be read.
    Io(io::Error),
}

impl From<io::Error> for Fault {
    fn from(error: io::Error) -> Self {
        Self::Io(error)
    }
}

/// A sequence of elements.
pub(super) trait Values {
    /// Moves to the next element.
    fn begin(&mut self) -> Result<(), Fault>;
    /// Returns the next value of the element.
    fn value(&mut self, ty: Scalar) -> Result<f64, Fault>;
    /// Returns the line of the element; 0 where there are no lines.
    fn line(&self) -> u32;
}

/// Numbers in text, with one element per line.
pub(super) struct Ascii<R> {
    lines: Lines<R>,
    line: std::ops::Range<usize>,
}

impl<R: Read> Ascii<R> {
    pub(super) fn new(lines: Lines<R>) -> Self {
        Self { lines, line: 0..0 }
    }
}

impl<R: Read> Values for Ascii<R> {
    fn begin(&mut self) -> Result<(), Fault> {
        loop {
            let Some(range) = self.lines.next_range()? else { return Err(Fault::End) };
            if !self.lines.text(range.clone()).trim_ascii().is_empty() {
                self.line = range;
                return Ok(());
            }
        }
    }

    #[inline]
    fn value(&mut self, _: Scalar) -> Result<f64, Fault> {
        let mut words = Words(self.lines.text(self.line.clone()));
        let value = words.double().ok_or(Fault::Short)?;
        self.line.start = self.line.end - words.0.len();
        Ok(value)
    }

    fn line(&self) -> u32 {
        self.lines.line()
    }
}

const CHUNK: usize = 256 * 1024;

/// Binary numbers, which are big endian if `BIG`.
pub(super) struct Binary<R, const BIG: bool> {
    stream: R,
    buf: Vec<u8>,
    pos: usize,
}

impl<R: Read, const BIG: bool> Binary<R, BIG> {
    /// Returns a reader of the bytes `ahead` and then of `stream`.
    pub(super) fn new(ahead: Vec<u8>, stream: R) -> Self {
        Self { stream, buf: ahead, pos: 0 }
    }

    #[inline]
    fn take<const N: usize>(&mut self) -> Result<[u8; N], Fault> {
        while self.buf.len() - self.pos < N {
            self.more()?;
        }
        let mut bytes = [0; N];
        bytes.copy_from_slice(&self.buf[self.pos..self.pos + N]);
        self.pos += N;
        if BIG {
            bytes.reverse();
        }
        Ok(bytes)
    }

    #[cold]
    fn more(&mut self) -> Result<(), Fault> {
        self.buf.drain(..self.pos);
        self.pos = 0;
        let old = self.buf.len();
        self.buf.resize(old + CHUNK, 0);
        let got = read_some(&mut self.stream, &mut self.buf[old..]);
        self.buf.truncate(old + *got.as_ref().unwrap_or(&0));
        if got? == 0 { Err(Fault::End) } else { Ok(()) }
    }
}

impl<R: Read, const BIG: bool> Values for Binary<R, BIG> {
    fn begin(&mut self) -> Result<(), Fault> {
        Ok(())
    }

    #[inline]
    fn value(&mut self, ty: Scalar) -> Result<f64, Fault> {
        Ok(match ty {
            Scalar::I8 => f64::from(i8::from_le_bytes(self.take()?)),
            Scalar::U8 => f64::from(u8::from_le_bytes(self.take()?)),
            Scalar::I16 => f64::from(i16::from_le_bytes(self.take()?)),
            Scalar::U16 => f64::from(u16::from_le_bytes(self.take()?)),
            Scalar::I32 => f64::from(i32::from_le_bytes(self.take()?)),
            Scalar::U32 => f64::from(u32::from_le_bytes(self.take()?)),
            Scalar::F32 => f64::from(f32::from_le_bytes(self.take()?)),
            Scalar::F64 => f64::from_le_bytes(self.take()?),
        })
    }

    fn line(&self) -> u32 {
        0
    }
}
