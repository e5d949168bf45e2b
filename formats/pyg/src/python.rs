//! Scripts: a child interpreter executes them and sends their calls back.
//!
//! The child is `python3` with a small program of ours (`shim.py`). Frames go over its standard input and
//! output: one byte kind, four bytes length (little endian), payload. The child answers nothing but what it is
//! asked, so the two never wait for each other.

use crate::value::{Seq, Value};
use granita_base::{Param, ParamData};
use std::io::{self, BufReader, BufWriter, Read, Write};
use std::path::Path;
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};
use std::sync::Arc;

/// The frames, which the Python package has too, and what runs in the child.
const SHIM: &str =
    concat!(include_str!("../../../bindings/python/gelato/_stream.py"), "\n", include_str!("shim.py"));

/// What the child tells.
#[derive(Debug)]
pub(crate) enum Event {
    /// The script called something.
    Call { line: u32, name: String, args: Vec<Value> },
    /// `GetAttribute`: to be answered.
    Get(String),
    /// Calls come from this file from now on.
    File(String),
    /// To be answered when everything before is done.
    Wait,
    /// The script printed.
    Printed(String),
    /// The piece is executed; whether the script gave one of the calls' names another meaning.
    Done { rebound: bool },
    /// A statement ended with an exception; the piece goes on with the next one.
    Raised(Exception),
    /// The piece is no Python: nothing of it was executed.
    Unread(Exception),
    /// The script was interrupted.
    Ended(Exception),
    /// The script left by `sys.exit`.
    Exit { line: u32, code: i32, text: String },
}

/// What Python complains about.
#[derive(Debug)]
pub(crate) struct Exception {
    /// The innermost line of the scene file that it went through.
    pub(crate) line: u32,
    /// Its type.
    pub(crate) kind: String,
    pub(crate) text: String,
    /// The name that is missing, of a `NameError`.
    pub(crate) name: String,
}

/// A running interpreter.
pub(crate) struct Python {
    child: Child,
    to: BufWriter<ChildStdin>,
    from: BufReader<ChildStdout>,
}

impl Python {
    /// Starts `program` for the script `file`, with extra environment variables.
    pub(crate) fn start<'a>(
        program: &Path,
        file: &str,
        variables: impl Iterator<Item = (&'a str, &'a str)>,
    ) -> io::Result<Self> {
        let mut child = Command::new(program)
            .arg("-c")
            .arg(SHIM)
            .envs(variables)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()?;
        let (Some(to), Some(from)) = (child.stdin.take(), child.stdout.take()) else {
            return Err(io::Error::other("the interpreter has no pipes"));
        };
        let mut python =
            Self { child, to: BufWriter::new(to), from: BufReader::with_capacity(1 << 18, from) };
        // Line ends would end the name.
        let file = file.replace('\n', " ");
        let names = crate::names::CALLS[..35].join(" ");
        // A program that is no interpreter shows now, not when something is lost.
        let greeted = match python.send(b'I', &[file.as_bytes(), b"\n", names.as_bytes()]) {
            Ok(()) => python.event()?,
            Err(error) => return Err(python.died(error)),
        };
        match greeted {
            Event::Wait => Ok(python),
            _ => Err(io::Error::other("it is no interpreter")),
        }
    }

    /// Begins to execute a piece of the script that begins at `line`; events follow until it is done.
    pub(crate) fn execute(&mut self, line: u32, code: &[u8]) -> io::Result<()> {
        self.send(b'X', &[&line.to_le_bytes(), code]).map_err(|error| self.died(error))
    }

    /// Answers [`Event::Get`].
    pub(crate) fn answer(&mut self, value: Option<&Param>) -> io::Result<()> {
        let mut out = Vec::new();
        encode(value, &mut out);
        self.send(b'G', &[&out]).map_err(|error| self.died(error))
    }

    fn send(&mut self, kind: u8, parts: &[&[u8]]) -> io::Result<()> {
        send(&mut self.to, kind, parts)
    }

    /// Waits for what the child tells next.
    pub(crate) fn event(&mut self) -> io::Result<Event> {
        match receive(&mut self.from) {
            Ok(event) => event.ok_or_else(|| io::Error::other("the interpreter sent something unreadable")),
            Err(error) => Err(self.died(error)),
        }
    }

    /// Why there is nothing more to read.
    fn died(&mut self, error: io::Error) -> io::Error {
        if !matches!(error.kind(), io::ErrorKind::UnexpectedEof | io::ErrorKind::BrokenPipe) {
            return error;
        }
        match self.child.wait() {
            Ok(status) => io::Error::other(format!("the interpreter ended early ({status})")),
            Err(error) => error,
        }
    }
}

impl Drop for Python {
    fn drop(&mut self) {
        // Whatever it does, nobody listens any more. It may have ended by itself: then both fail.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Writes a frame.
pub(crate) fn send(to: &mut dyn Write, kind: u8, parts: &[&[u8]]) -> io::Result<()> {
    let length: usize = parts.iter().map(|p| p.len()).sum();
    let length = u32::try_from(length).map_err(|_| io::Error::other("a frame is too long"))?;
    to.write_all(&[kind])?;
    to.write_all(&length.to_le_bytes())?;
    parts.iter().try_for_each(|p| to.write_all(p))?;
    to.flush()
}

/// Reads a frame; `None` when it makes no sense. An end inside of one or before it is an error.
pub(crate) fn receive(from: &mut dyn Read) -> io::Result<Option<Event>> {
    let mut head = [0; 5];
    from.read_exact(&mut head)?;
    let length = u32::from_le_bytes([head[1], head[2], head[3], head[4]]) as usize;
    let mut payload = Vec::with_capacity(length.min(1 << 20));
    from.take(length as u64).read_to_end(&mut payload)?;
    if payload.len() < length {
        return Err(io::ErrorKind::UnexpectedEof.into());
    }
    Ok(Frame(&payload).event(head[0]))
}

/// The bytes of a value.
pub(crate) fn encode(value: Option<&Param>, out: &mut Vec<u8>) {
    let Some(param) = value else { return out.push(b'N') };
    let text = |s: &str, out: &mut Vec<u8>| {
        out.extend((s.len() as u32).to_le_bytes());
        out.extend(s.as_bytes());
    };
    // One value of a simple type is itself, everything else a sequence.
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
            text(&v[0], out);
        }
        ParamData::Int(v) => {
            out.push(b'I');
            out.extend((v.len() as u32).to_le_bytes());
            v.iter().for_each(|i| out.extend(i.to_le_bytes()));
        }
        ParamData::Float(v) => {
            out.push(b'F');
            out.extend((v.len() as u32).to_le_bytes());
            v.iter().for_each(|f| out.extend(f.to_le_bytes()));
        }
        ParamData::String(v) => {
            out.push(b'S');
            out.extend((v.len() as u32).to_le_bytes());
            v.iter().for_each(|s| text(s, out));
        }
    }
}

/// Takes values from the front of a payload; `None` when it is too short.
struct Frame<'a>(&'a [u8]);

impl Frame<'_> {
    fn bytes(&mut self, n: usize) -> Option<&[u8]> {
        let (head, rest) = self.0.split_at_checked(n)?;
        self.0 = rest;
        Some(head)
    }

    fn array<const N: usize>(&mut self) -> Option<[u8; N]> {
        self.bytes(N)?.try_into().ok()
    }

    fn word(&mut self) -> Option<u32> {
        self.array().map(u32::from_le_bytes)
    }

    fn text(&mut self) -> Option<String> {
        let n = self.word()? as usize;
        self.bytes(n).map(|b| String::from_utf8_lossy(b).into_owned())
    }

    fn rest(&mut self) -> String {
        String::from_utf8_lossy(self.0).into_owned()
    }

    fn event(&mut self, kind: u8) -> Option<Event> {
        Some(match kind {
            b'C' => {
                let line = self.word()?;
                let name = self.text()?;
                let n = self.word()?;
                let args = (0..n).map(|_| self.value()).collect::<Option<Vec<_>>>()?;
                Event::Call { line, name, args }
            }
            b'A' => Event::Get(self.rest()),
            b'F' => Event::File(self.rest()),
            b'W' => Event::Wait,
            b'P' => Event::Printed(self.rest()),
            b'D' => Event::Done { rebound: self.array::<1>()? != [0] },
            b'R' => Event::Raised(self.exception()?),
            b'Y' => Event::Unread(self.exception()?),
            b'E' => Event::Ended(self.exception()?),
            b'Q' => Event::Exit {
                line: self.word()?,
                code: self.array().map(i32::from_le_bytes)?,
                text: self.text()?,
            },
            _ => return None,
        })
    }

    fn exception(&mut self) -> Option<Exception> {
        Some(Exception { line: self.word()?, kind: self.text()?, text: self.text()?, name: self.text()? })
    }

    fn value(&mut self) -> Option<Value> {
        Some(match self.array::<1>()?[0] {
            b'N' => Value::None,
            b'i' => Value::Int(i64::from_le_bytes(self.array()?)),
            b'f' => Value::Float(f64::from_le_bytes(self.array()?)),
            b's' => Value::Str(self.text()?.into()),
            code @ (b'I' | b'F') => {
                let n = self.word()? as usize;
                let data = self.bytes(n.checked_mul(4)?)?;
                let words = data.chunks_exact(4).map(|b| [b[0], b[1], b[2], b[3]]);
                Value::Seq(if code == b'I' {
                    Seq::Ints(words.map(i32::from_le_bytes).collect())
                } else {
                    Seq::Floats(words.map(f32::from_le_bytes).collect())
                })
            }
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
    fn short_frames_are_refused() {
        let whole = [
            &3u32.to_le_bytes()[..],
            &5u32.to_le_bytes(),
            b"Scale",
            &1u32.to_le_bytes(),
            b"F",
            &1u32.to_le_bytes(),
            &2f32.to_le_bytes(),
        ]
        .concat();
        assert!(matches!(Frame(&whole).event(b'C'), Some(Event::Call { line: 3, .. })));
        for n in 0..whole.len() {
            assert!(Frame(&whole[..n]).event(b'C').is_none(), "{n}");
        }
        assert!(Frame(&[]).event(b'?').is_none());
    }
}
