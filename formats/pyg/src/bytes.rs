//! A window onto the source. It holds the bytes from the beginning of the current statement to what has been read.

use std::io::{self, Read};

const CHUNK: usize = 256 * 1024;
/// The number of bytes of a statement after which its beginning may be dropped. A shorter statement can still be passed
/// to Python.
pub(crate) const KEPT: usize = 16 << 20;

/// Reads ahead in chunks and drops the data before the current statement.
pub(crate) struct Bytes {
    source: Box<dyn Read>,
    buf: Vec<u8>,
    pos: usize,
    eof: bool,
    line: u32,
    /// The largest number of bytes of one statement.
    limit: usize,
    /// True when the beginning of a long statement may be dropped.
    may_drop: bool,
    /// True when the beginning of the statement was dropped.
    dropped: bool,
}

impl Bytes {
    pub(crate) fn new(source: Box<dyn Read>, limit: usize) -> Self {
        Self { source, buf: Vec::new(), pos: 0, eof: false, line: 1, limit, may_drop: false, dropped: false }
    }

    /// Returns the line of the current position. The first line is 1.
    pub(crate) fn line(&self) -> u32 {
        self.line
    }

    /// Returns the position inside the window, for [`Bytes::back_to`].
    pub(crate) fn mark(&self) -> (usize, u32) {
        (self.pos, self.line)
    }

    pub(crate) fn back_to(&mut self, mark: (usize, u32)) {
        (self.pos, self.line) = mark;
    }

    /// Allows the data before the current position to be dropped once it is long. [`Bytes::back_to`] is then
    /// impossible while [`Bytes::has_dropped`] is true.
    pub(crate) fn let_drop(&mut self, may_drop: bool) {
        self.may_drop = may_drop;
    }

    /// True when the beginning of the statement was dropped.
    pub(crate) fn has_dropped(&self) -> bool {
        self.dropped
    }

    /// Marks the start of a statement. The data before it is no longer needed.
    pub(crate) fn forget(&mut self) {
        self.dropped = false;
        if self.pos >= CHUNK {
            self.buf.drain(..self.pos);
            self.pos = 0;
        }
    }

    /// Returns the next byte without taking it; `None` at the end.
    #[inline]
    pub(crate) fn peek(&mut self) -> io::Result<Option<u8>> {
        if self.pos < self.buf.len() {
            return Ok(Some(self.buf[self.pos]));
        }
        self.more()?;
        Ok(self.buf.get(self.pos).copied())
    }

    /// Returns the byte `n` after the next one.
    pub(crate) fn peek_at(&mut self, n: usize) -> io::Result<Option<u8>> {
        while self.pos + n >= self.buf.len() && !self.eof {
            self.more()?;
        }
        Ok(self.buf.get(self.pos + n).copied())
    }

    /// Takes a byte that [`Bytes::peek`] has returned.
    #[inline]
    pub(crate) fn advance(&mut self) {
        if self.buf.get(self.pos) == Some(&b'\n') {
            self.line += 1;
        }
        self.pos += 1;
    }

    /// Takes the next `n` bytes as data, whose line ends are not counted. Returns `None` when there are fewer.
    pub(crate) fn data(&mut self, n: usize) -> io::Result<Option<&[u8]>> {
        while self.buf.len() - self.pos < n && !self.eof {
            self.more()?;
        }
        let Some(end) = self.pos.checked_add(n).filter(|end| *end <= self.buf.len()) else { return Ok(None) };
        let start = std::mem::replace(&mut self.pos, end);
        Ok(Some(&self.buf[start..end]))
    }

    /// Returns the bytes of the window from the current position on. There are at least `n` of them unless the source
    /// ends before.
    #[inline]
    pub(crate) fn ahead(&mut self, n: usize) -> io::Result<&[u8]> {
        while self.buf.len() - self.pos < n && !self.eof {
            self.more()?;
        }
        Ok(&self.buf[self.pos..])
    }

    /// Takes `n` bytes of [`Bytes::ahead`] that do not contain a line end.
    #[inline]
    pub(crate) fn skip(&mut self, n: usize) {
        self.pos += n;
    }

    fn more(&mut self) -> io::Result<()> {
        if self.eof {
            return Ok(());
        }
        if self.may_drop && self.pos >= KEPT {
            self.buf.drain(..self.pos);
            self.pos = 0;
            self.dropped = true;
        }
        if self.buf.len() >= self.limit {
            let text = format!("a statement longer than {} bytes", self.limit);
            return Err(io::Error::new(io::ErrorKind::InvalidData, text));
        }
        // Long statements are read in ever larger pieces, so that the buffer is not copied too often.
        let want = CHUNK.max(self.buf.len() / 2).min(self.limit);
        let old = self.buf.len();
        self.buf.resize(old + want, 0);
        let got = loop {
            match self.source.read(&mut self.buf[old..]) {
                Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
                other => break other,
            }
        };
        self.buf.truncate(old + *got.as_ref().unwrap_or(&0));
        self.eof = got? == 0;
        Ok(())
    }
}
