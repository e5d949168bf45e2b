//! Scripts, which a child interpreter executes. It sends their calls back.
//!
//! The child is `python3` with a small program of the suite (`shim.py`). Frames go over its standard input and output:
//! one byte kind, four bytes length (little endian), payload. The child only answers requests, so the two never wait
//! for each other.

use crate::frames::{self, Frame, put_value, send};
use crate::value::Value;
use granita_base::process::Process;
use granita_base::{Environment, Param, Supervisor};
use std::io::{self, BufReader, BufWriter, Read};
use std::path::Path;
use std::process::{ChildStdin, ChildStdout, Command, Stdio};
use std::time::Duration;

/// The program of the child. Its code for frames is also part of the Python package.
const SHIM: &str = concat!(
    include_str!("../../../bindings/python/gelato/_errors.py"),
    "\n",
    include_str!("../../../bindings/python/gelato/_stream.py"),
    "\n_RENDERER = r'''",
    // This part is executed when a script makes a renderer of its own.
    include_str!("../../../bindings/python/gelato/_calls.py"),
    "\n",
    include_str!("../../../bindings/python/gelato/_images.py"),
    "\n",
    include_str!("../../../bindings/python/gelato/_process.py"),
    "\n",
    include_str!("../../../bindings/python/gelato/_renderer.py"),
    "'''\n",
    include_str!("shim.py")
);

/// The time in which an interpreter without output must end.
const ENDING: Duration = Duration::from_secs(1);

/// A message of the child.
#[derive(Debug)]
pub(crate) enum Event {
    /// The script made a call.
    Call { line: u32, name: String, args: Vec<Value> },
    /// Calls as Pyg text.
    Text(Vec<u8>),
    /// The script called `GetAttribute` and waits for the answer.
    Get(String),
    /// The following calls come from this file.
    File(String),
    /// The sender waits for an answer, which is sent when everything before has been processed.
    Wait,
    /// The script printed this text.
    Printed(String),
    /// The script opened these files for reading.
    Opened(Vec<String>),
    /// The piece has been executed. `rebound` is true when the script gave the name of a call another meaning.
    Done { rebound: bool },
    /// A statement ended with an exception. The piece continues with the next statement.
    Raised(Exception),
    /// The piece is not valid Python. Nothing of it was executed.
    Unread(Exception),
    /// The script was interrupted.
    Ended(Exception),
    /// The script ended itself by `sys.exit`.
    Exit { line: u32, code: i32, text: String },
}

/// An exception of Python.
#[derive(Debug)]
pub(crate) struct Exception {
    /// The innermost line of the scene file that the exception passed through.
    pub(crate) line: u32,
    /// The type of the exception.
    pub(crate) kind: String,
    pub(crate) text: String,
    /// The missing name of a `NameError`.
    pub(crate) name: String,
}

/// A running interpreter. It ends when it is dropped.
pub(crate) struct Python {
    child: Process,
    to: BufWriter<ChildStdin>,
    from: BufReader<ChildStdout>,
}

impl Python {
    /// Starts `program` for the script `file`, with these variables in addition to those of this process.
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
        // A line end would be the end of the name.
        let file = file.replace('\n', " ");
        let names = crate::names::calls().collect::<Vec<_>>().join(" ");
        // A program that is not an interpreter is detected here, before any data is lost.
        let greeted = match python.send(b'I', &[file.as_bytes(), b"\n", names.as_bytes()]) {
            Ok(()) => python.event()?,
            Err(error) => return Err(python.died(error)),
        };
        match greeted {
            Event::Wait => Ok(python),
            _ => Err(io::Error::other("it is not an interpreter")),
        }
    }

    /// Begins to execute a piece of the script that begins at `line`. Events follow until it is done.
    pub(crate) fn execute(&mut self, line: u32, code: &[u8]) -> io::Result<()> {
        self.send(b'X', &[&line.to_le_bytes(), code]).map_err(|error| self.died(error))
    }

    /// Continues with another file. The definitions of the files before stay. Returns true when names of calls have
    /// another meaning.
    pub(crate) fn go_on(&mut self, file: &str) -> io::Result<bool> {
        let file = file.replace('\n', " ");
        self.send(b'N', &[file.as_bytes()]).map_err(|error| self.died(error))?;
        match self.event()? {
            Event::Done { rebound } => Ok(rebound),
            _ => Err(io::Error::other("the interpreter does not accept another file")),
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
            Ok(event) => {
                event.ok_or_else(|| io::Error::other("the interpreter sent data that cannot be read"))
            }
            Err(error) => Err(self.died(error)),
        }
    }

    /// Returns the reason why there is nothing more to read.
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

/// Reads a frame. Returns `None` when its content is invalid. An end inside of a frame or before it is an error.
pub(crate) fn receive(from: &mut dyn Read) -> io::Result<Option<Event>> {
    let (kind, payload) = frames::receive(from)?;
    Ok(event(kind, &payload))
}

/// Decodes the content of a frame.
pub(crate) fn event(kind: u8, payload: &[u8]) -> Option<Event> {
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
        b'U' => {
            let n = frame.word()?;
            Event::Opened((0..n).map(|_| frame.text()).collect::<Option<Vec<_>>>()?)
        }
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
