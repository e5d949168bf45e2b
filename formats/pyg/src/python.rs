//! Scripts: a child interpreter executes them and sends their calls back.
//!
//! The child is `python3` with a small program of the suite (`shim.py`). Frames go over its standard input and
//! output: one byte kind, four bytes length (little endian), payload. The child only answers requests, so the two
//! never wait for each other.

use crate::frames::{self, Frame, put_value, send};
use crate::value::Value;
use granita_base::process::Process;
use granita_base::{Environment, Param, Supervisor};
use std::io::{self, BufReader, BufWriter, Read};
use std::path::Path;
use std::process::{ChildStdin, ChildStdout, Command, Stdio};
use std::time::Duration;

/// The frames, which the Python package has too, and what runs in the child.
const SHIM: &str = concat!(
    include_str!("../../../bindings/python/gelato/_stream.py"),
    "\n_RENDERER = r'''",
    // Executed when a script makes a renderer of its own.
    include_str!("../../../bindings/python/gelato/_renderer.py"),
    "'''\n",
    include_str!("shim.py")
);

/// The time for an interpreter without output to end.
const ENDING: Duration = Duration::from_secs(1);

/// A message of the child.
#[derive(Debug)]
pub(crate) enum Event {
    /// The script called something.
    Call { line: u32, name: String, args: Vec<Value> },
    /// Calls, as Pyg.
    Text(Vec<u8>),
    /// `GetAttribute`: to be answered.
    Get(String),
    /// Following calls come from this file.
    File(String),
    /// To be answered when everything before is done.
    Wait,
    /// The script printed.
    Printed(String),
    /// The piece is executed; whether the script gave one of the calls' names another meaning.
    Done { rebound: bool },
    /// A statement ended with an exception; the piece continues with the next one.
    Raised(Exception),
    /// The piece is not valid Python: nothing of it was executed.
    Unread(Exception),
    /// The script was interrupted.
    Ended(Exception),
    /// The script left by `sys.exit`.
    Exit { line: u32, code: i32, text: String },
}

/// The error message of Python.
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

/// A running interpreter. Dropped, it ends.
pub(crate) struct Python {
    child: Process,
    to: BufWriter<ChildStdin>,
    from: BufReader<ChildStdout>,
}

impl Python {
    /// Starts `program` for the script `file`, with these variables beside those of this process.
    pub(crate) fn start(
        program: &Path,
        file: &str,
        environment: &Environment,
        supervisor: &Supervisor,
    ) -> io::Result<Self> {
        let mut command = Command::new(program);
        command.arg("-c").arg(SHIM).envs(environment.iter());
        command.stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut child = supervisor.spawn(&mut command, format!("running the script {file}"))?;
        let (Some(to), Some(from)) = (child.take_stdin(), child.take_stdout()) else {
            return Err(io::Error::other("the interpreter has no pipes"));
        };
        let mut python =
            Self { child, to: BufWriter::new(to), from: BufReader::with_capacity(1 << 18, from) };
        // Line ends would end the name.
        let file = file.replace('\n', " ");
        let names = crate::names::CALLS[..35].join(" ");
        // A program that is not an interpreter is detected here, before anything is lost.
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

    /// Goes on with another file; what those before defined stays. Returns whether names of calls mean something else.
    pub(crate) fn go_on(&mut self, file: &str) -> io::Result<bool> {
        let file = file.replace('\n', " ");
        self.send(b'N', &[file.as_bytes()]).map_err(|error| self.died(error))?;
        match self.event()? {
            Event::Done { rebound } => Ok(rebound),
            _ => Err(io::Error::other("the interpreter does not take another file")),
        }
    }

    /// Answers [`Event::Get`].
    pub(crate) fn answer(&mut self, value: Option<&Param>) -> io::Result<()> {
        let mut out = Vec::new();
        put_value(value, &mut out);
        self.send(b'G', &[&out]).map_err(|error| self.died(error))
    }

    fn send(&mut self, kind: u8, parts: &[&[u8]]) -> io::Result<()> {
        send(&mut self.to, kind, parts)
    }

    /// Waits for the next message of the child.
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
        match self.child.wait_for_end(ENDING) {
            Ok(status) => io::Error::other(format!("the interpreter ended early ({status})")),
            Err(error) => error,
        }
    }
}

/// Reads a frame; `None` when it makes no sense. An end inside of one or before it is an error.
pub(crate) fn receive(from: &mut dyn Read) -> io::Result<Option<Event>> {
    let (kind, payload) = frames::receive(from)?;
    Ok(event(kind, &payload))
}

/// The content of a frame.
fn event(kind: u8, payload: &[u8]) -> Option<Event> {
    let mut frame = Frame(payload);
    Some(match kind {
        b'C' => {
            let line = frame.word()?;
            let name = frame.text()?;
            let n = frame.word()?;
            let args = (0..n).map(|_| frame.value()).collect::<Option<Vec<_>>>()?;
            Event::Call { line, name, args }
        }
        b'T' => Event::Text(payload.to_vec()),
        b'A' => Event::Get(frame.rest()),
        b'F' => Event::File(frame.rest()),
        b'W' => Event::Wait,
        b'P' => Event::Printed(frame.rest()),
        b'D' => Event::Done { rebound: frame.array::<1>()? != [0] },
        b'R' => Event::Raised(exception(&mut frame)?),
        b'Y' => Event::Unread(exception(&mut frame)?),
        b'E' => Event::Ended(exception(&mut frame)?),
        b'Q' => Event::Exit {
            line: frame.word()?,
            code: frame.array().map(i32::from_le_bytes)?,
            text: frame.text()?,
        },
        _ => return None,
    })
}

fn exception(frame: &mut Frame<'_>) -> Option<Exception> {
    Some(Exception { line: frame.word()?, kind: frame.text()?, text: frame.text()?, name: frame.text()? })
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
        assert!(matches!(event(b'C', &whole), Some(Event::Call { line: 3, .. })));
        for n in 0..whole.len() {
            assert!(event(b'C', &whole[..n]).is_none(), "{n}");
        }
        assert!(event(b'?', &[]).is_none());
    }
}
