//! Frames, which are the messages between a renderer and programs in other processes.
//!
//! A frame is one byte kind, four bytes length, and the payload. Numbers are little endian. Texts are preceded by their
//! length.

use crate::value::{Seq, Value};
use granita_base::{Param, ParamData};
use std::io::{self, Read, Write};
use std::sync::Arc;

/// Writes a frame whose payload consists of these parts.
///
/// # Errors
/// Returns the errors of `to`, and an error for a payload of 4 GiB or more.
pub fn send(to: &mut dyn Write, kind: u8, parts: &[&[u8]]) -> io::Result<()> {
    let length = length(parts)?;
    to.write_all(&[kind])?;
    to.write_all(&length.to_le_bytes())?;
    parts.iter().try_for_each(|p| to.write_all(p))?;
    to.flush()
}

/// Returns a frame whose payload consists of these parts. A stream that several threads write to receives it as one
/// piece.
///
/// # Errors
/// Returns an error for a payload of 4 GiB or more.
pub fn framed(kind: u8, parts: &[&[u8]]) -> io::Result<Vec<u8>> {
    let length = length(parts)?;
    let mut frame = Vec::with_capacity(length as usize + 5);
    frame.push(kind);
    frame.extend(length.to_le_bytes());
    parts.iter().for_each(|part| frame.extend_from_slice(part));
    Ok(frame)
}

/// Returns the length of a payload.
fn length(parts: &[&[u8]]) -> io::Result<u32> {
    let length: usize = parts.iter().map(|p| p.len()).sum();
    u32::try_from(length).map_err(|_| io::Error::other("a frame is too long"))
}

/// Reads a frame. Returns its kind and its payload.
///
/// # Errors
/// Returns the errors of `from`. An end inside of a frame or before it is `UnexpectedEof`.
pub fn receive(from: &mut dyn Read) -> io::Result<(u8, Vec<u8>)> {
    let mut head = [0; 5];
    from.read_exact(&mut head)?;
    let length = u32::from_le_bytes([head[1], head[2], head[3], head[4]]) as usize;
    let mut payload = Vec::with_capacity(length.min(1 << 20));
    from.take(length as u64).read_to_end(&mut payload)?;
    if payload.len() < length {
        return Err(io::ErrorKind::UnexpectedEof.into());
    }
    Ok((head[0], payload))
}

/// Appends the length of a text and the text.
pub fn put_text(text: &str, out: &mut Vec<u8>) {
    out.extend((text.len() as u32).to_le_bytes());
    out.extend(text.as_bytes());
}

/// Appends numbers and their count, which has 32 bits.
pub fn put_floats(numbers: &[f32], out: &mut Vec<u8>) {
    out.extend((numbers.len() as u32).to_le_bytes());
    out.extend(numbers.iter().flat_map(|f| f.to_le_bytes()));
}

/// Appends the values of a parameter, or the mark for no values.
pub fn put_value(value: Option<&Param>, out: &mut Vec<u8>) {
    let Some(param) = value else { return out.push(b'N') };
    // One value of a simple type is written alone. Everything else is written as a sequence.
    let single = param.data.len() == 1 && param.ty.array.is_none();
    match &param.data {
        ParamData::Int(v) if single => {
            out.push(b'i');
            out.extend(i64::from(v[0]).to_le_bytes());
        }
        ParamData::Float(v) if single => {
            out.push(b'f');
            out.extend(f64::from(v[0]).to_le_bytes());
        }
        ParamData::String(v) if single => {
            out.push(b's');
            put_text(&v[0], out);
        }
        ParamData::Int(v) => {
            out.push(b'I');
            out.extend((v.len() as u32).to_le_bytes());
            v.iter().for_each(|i| out.extend(i.to_le_bytes()));
        }
        ParamData::Float(v) => {
            out.push(b'F');
            put_floats(v, out);
        }
        ParamData::String(v) => {
            out.push(b'S');
            out.extend((v.len() as u32).to_le_bytes());
            v.iter().for_each(|s| put_text(s, out));
        }
    }
}

/// A payload. Its functions take values from the front, and return `None` when it is too short.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a>(pub &'a [u8]);

impl<'a> Frame<'a> {
    fn bytes(&mut self, n: usize) -> Option<&'a [u8]> {
        let (head, rest) = self.0.split_at_checked(n)?;
        self.0 = rest;
        Some(head)
    }

    /// Takes `N` bytes.
    pub fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.bytes(N)?.try_into().ok()
    }

    /// Takes a number of 32 bits.
    pub fn word(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    /// Takes a text that is preceded by its length.
    pub fn text(&mut self) -> Option<String> {
        let n = self.word()? as usize;
        self.bytes(n).map(|b| String::from_utf8_lossy(b).into_owned())
    }

    /// Takes numbers that are preceded by their count.
    pub fn floats(&mut self) -> Option<Vec<f32>> {
        let n = self.word()? as usize;
        let words = self.bytes(n.checked_mul(4)?)?.as_chunks().0;
        Some(words.iter().map(|b| f32::from_le_bytes(*b)).collect())
    }

    /// Returns the rest as text.
    pub fn rest(&mut self) -> String {
        String::from_utf8_lossy(self.0).into_owned()
    }

    /// Takes the output of [`put_value`]. `Some (None)` stands for no values.
    pub fn data(&mut self) -> Option<Option<ParamData>> {
        Some(match self.value()? {
            Value::None => None,
            Value::Int(i) => Some(i32::try_from(i).ok()?.into()),
            Value::Float(f) => Some((f as f32).into()),
            Value::Str(s) => Some(ParamData::String([s].into())),
            Value::Seq(Seq::Ints(v)) => Some(ParamData::Int(v.into())),
            Value::Seq(Seq::Floats(v)) => Some(ParamData::Float(v.into())),
            Value::Seq(Seq::Strings(v)) => Some(ParamData::String(v.into())),
        })
    }

    pub(crate) fn value(&mut self) -> Option<Value> {
        Some(match self.array::<1>()?[0] {
            b'N' => Value::None,
            b'i' => Value::Int(i64::from_le_bytes(self.array()?)),
            b'f' => Value::Float(f64::from_le_bytes(self.array()?)),
            b's' => Value::Str(self.text()?.into()),
            b'I' => {
                let n = self.word()? as usize;
                let words = self.bytes(n.checked_mul(4)?)?.as_chunks().0;
                Value::Seq(Seq::Ints(words.iter().map(|b| i32::from_le_bytes(*b)).collect()))
            }
            b'F' => Value::Seq(Seq::Floats(self.floats()?)),
            b'S' => {
                let n = self.word()?;
                let words = (0..n).map(|_| self.text().map(Arc::from)).collect::<Option<Vec<Arc<str>>>>()?;
                Value::Seq(Seq::Strings(words))
            }
            _ => return None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_survive_encoding_in_frames() {
        for (declaration, data) in [
            ("int n", ParamData::from(-3)),
            ("float f", ParamData::from(0.1)),
            ("string s", ParamData::from("é")),
            ("int[2] n", ParamData::from(&[1, 2][..])),
            ("color c", ParamData::from(&[1.0, 0.5, 0.0][..])),
            ("string[2] s", ParamData::String(["a".into(), "".into()].into())),
        ] {
            let param = Param::declared(declaration, data.clone()).unwrap();
            let mut bytes = Vec::new();
            put_value(Some(&param), &mut bytes);
            assert_eq!(Frame(&bytes).data(), Some(Some(data)), "{declaration}");
            for n in 0..bytes.len() {
                assert_eq!(Frame(&bytes[..n]).data(), None, "{declaration} {n}");
            }
        }
        assert_eq!(Frame(b"N").data(), Some(None));
    }

    #[test]
    fn frames_survive_send_and_receive_and_truncated_ones_are_errors() {
        let mut bytes = Vec::new();
        send(&mut bytes, b'x', &[b"ab", b"", b"c"]).unwrap();
        assert_eq!(receive(&mut &bytes[..]).unwrap(), (b'x', b"abc".to_vec()));
        assert_eq!(framed(b'x', &[b"a", b"bc"]).unwrap(), bytes);
        for n in 0..bytes.len() {
            let error = receive(&mut &bytes[..n]).unwrap_err();
            assert_eq!(error.kind(), io::ErrorKind::UnexpectedEof, "{n}");
        }
    }
}
