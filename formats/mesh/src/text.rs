//! Lines and words of text formats. Neither are copied.

use granita_base::scan_number;
use std::io::{self, Read};
use std::ops::Range;

const CHUNK: usize = 256 * 1024;
/// The largest number of bytes of a line. It is far above the lines of real files. Without it, a file of zeros would be
/// read as a whole.
const LINE_LIMIT: usize = 1 << 28;

/// The lines of a stream, in chunks.
pub(crate) struct Lines<R> {
    stream: R,
    buf: Vec<u8>,
    /// The start of the next line in `buf`.
    pos: usize,
    eof: bool,
    line: u32,
    next: u32,
    /// True when a backslash at the end of a line continues it.
    continued: bool,
}

impl<R: Read> Lines<R> {
    pub(crate) fn new(stream: R, continued: bool) -> Self {
        Self { stream, buf: Vec::new(), pos: 0, eof: false, line: 0, next: 1, continued }
    }

    /// Returns the next line without its end, and its number, counted from 1. The end of a continued line is replaced
    /// by blanks, and its number is that of its first line. Returns `None` at the end of the source.
    pub(crate) fn next_line(&mut self) -> io::Result<Option<(u32, &[u8])>> {
        Ok(self.next_range()?.map(|range| (self.line, &self.buf[range])))
    }

    /// Returns the number of the last returned line, counted from 1.
    pub(crate) fn line(&self) -> u32 {
        self.line
    }

    /// Returns the text of the range that [`Lines::next_range`] returned last.
    pub(crate) fn text(&self, range: Range<usize>) -> &[u8] {
        &self.buf[range]
    }

    /// Returns the data that was read after the last line, and the rest of the stream.
    pub(crate) fn into_rest(self) -> (Vec<u8>, R) {
        let mut ahead = self.buf;
        ahead.drain(..self.pos);
        (ahead, self.stream)
    }

    /// Returns the next line like [`Lines::next_line`], as a range of the window. It is valid until the next call.
    pub(crate) fn next_range(&mut self) -> io::Result<Option<Range<usize>>> {
        self.line = self.next;
        // The length of the part of the line that was searched already.
        let mut searched = 0;
        loop {
            let from = self.pos + searched;
            if let Some(at) = memchr::memchr(b'\n', &self.buf[from..]) {
                let end = from + at;
                self.next = self.next.saturating_add(1);
                let text_end = if end > self.pos && self.buf[end - 1] == b'\r' { end - 1 } else { end };
                if self.continued && text_end > self.pos && self.buf[text_end - 1] == b'\\' {
                    self.buf[text_end - 1..=end].fill(b' ');
                    searched = end + 1 - self.pos;
                    continue;
                }
                let start = std::mem::replace(&mut self.pos, end + 1);
                return Ok(Some(start..text_end));
            }
            searched = self.buf.len() - self.pos;
            if self.eof {
                if searched == 0 {
                    return Ok(None);
                }
                let start = std::mem::replace(&mut self.pos, self.buf.len());
                let returns = self.buf[start..].iter().rev().take_while(|c| **c == b'\r').count();
                return Ok(Some(start..self.buf.len() - returns));
            }
            self.more()?;
        }
    }

    fn more(&mut self) -> io::Result<()> {
        self.buf.drain(..self.pos);
        self.pos = 0;
        let old = self.buf.len();
        if old >= LINE_LIMIT {
            let text = format!("line {} is longer than {LINE_LIMIT} bytes", self.line);
            return Err(io::Error::new(io::ErrorKind::InvalidData, text));
        }
        // Long lines are read in larger and larger pieces, so that they are not copied too often.
        self.buf.resize(old + CHUNK.max(old), 0);
        let got = read_some(&mut self.stream, &mut self.buf[old..]);
        self.buf.truncate(old + *got.as_ref().unwrap_or(&0));
        self.eof = got? == 0;
        Ok(())
    }
}

/// Reads once. An interrupted read is repeated.
pub(crate) fn read_some(stream: &mut impl Read, buf: &mut [u8]) -> io::Result<usize> {
    loop {
        match stream.read(buf) {
            Err(e) if e.kind() == io::ErrorKind::Interrupted => {}
            other => return other,
        }
    }
}

/// The words of a line, separated by blanks and tabs.
#[derive(Clone, Copy)]
pub(crate) struct Words<'a>(pub(crate) &'a [u8]);

impl<'a> Words<'a> {
    fn skip_blanks(&mut self) {
        let blanks = self.0.iter().take_while(|c| is_blank(**c)).count();
        self.0 = &self.0[blanks..];
    }

    /// Returns the next word.
    pub(crate) fn word(&mut self) -> Option<&'a [u8]> {
        self.skip_blanks();
        let len = self.0.iter().position(|c| is_blank(*c)).unwrap_or(self.0.len());
        let (word, rest) = self.0.split_at(len);
        self.0 = rest;
        (len > 0).then_some(word)
    }

    /// Returns the rest of the line as text, without the blanks around it.
    pub(crate) fn rest(&self) -> String {
        String::from_utf8_lossy(self.0.trim_ascii()).into_owned()
    }

    /// Returns the next word as a number; `None` at the end. A word that is not a number counts as NaN.
    #[inline]
    pub(crate) fn double(&mut self) -> Option<f64> {
        self.skip_blanks();
        if let Some((number, len)) = scan_number(self.0)
            && self.0.get(len).is_none_or(|c| is_blank(*c))
        {
            self.0 = &self.0[len..];
            return Some(number.to_f64());
        }
        Some(unusual_number(self.word()?))
    }

    /// Returns the next word like [`Words::double`], in single precision.
    #[inline]
    pub(crate) fn float(&mut self) -> Option<f32> {
        self.double().map(|x| x as f32)
    }
}

/// Parses a number with a plus, `nan`, `inf` and similar words. Anything else is NaN.
fn unusual_number(word: &[u8]) -> f64 {
    std::str::from_utf8(word).ok().and_then(|w| w.parse().ok()).unwrap_or(f64::NAN)
}

#[inline]
fn is_blank(c: u8) -> bool {
    matches!(c, b' ' | b'\t')
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(text: &str) -> Vec<(u32, String)> {
        let mut lines = Lines::new(text.as_bytes(), true);
        let mut all = Vec::new();
        while let Some((line, text)) = lines.next_line().unwrap() {
            all.push((line, String::from_utf8(text.to_vec()).unwrap()));
        }
        all
    }

    #[test]
    fn lines_and_continuations() {
        let got = lines("a b\r\nc \\\r\n d\\\ne\n\nlast");
        let want = [(1, "a b"), (2, "c     d  e"), (5, ""), (6, "last")];
        assert_eq!(got, want.map(|(n, s)| (n, s.to_owned())));
        assert!(lines("").is_empty());
        assert_eq!(lines("x\\\n"), [(1, "x  ".to_owned())]);
        assert_eq!(lines("x\\"), [(1, "x\\".to_owned())]);
    }

    #[test]
    fn lines_longer_than_a_chunk() {
        let long = "1".repeat(3 * CHUNK);
        let got = lines(&format!("a\n{long}\nb"));
        assert_eq!((got[1].1.len(), got[2].clone()), (3 * CHUNK, (3, "b".to_owned())));
    }

    #[test]
    fn words_and_numbers() {
        let mut w = Words(b"  1.5\t+2 -3e1 nan x 0.1y");
        assert_eq!([w.float(), w.float(), w.float()], [Some(1.5), Some(2.0), Some(-30.0)]);
        assert!([w.float(), w.float(), w.float()].iter().all(|f| f.unwrap().is_nan()));
        assert_eq!(w.float(), None);
        let mut w = Words(b"a  b c ");
        assert_eq!(w.word(), Some(&b"a"[..]));
        assert_eq!(w.rest(), "b c");
    }
}
