//! Reads calls from a program that started the renderer, such as the Python package.

use crate::frames::{put_value, send};
use crate::python::{Event, receive};
use crate::reader::pass_on;
use crate::{PygError, PygOptions, PygSource, read};
use granita_base::{Location, Reporter};
use granita_scene::SceneSink;
use std::io::{self, Read, Write};
use std::sync::Arc;

/// Passes the calls of a stream on until it ends, and answers its queries on `output`.
///
/// Frames in both directions are those of [`crate::frames`]. `C` is a call, `F` the file that calls come from, and `T`
/// calls as flat Pyg. `A` queries an attribute, and `G` answers with its value. `W` waits, and `W` answers with the
/// number of errors so far. `bindings/python/gelato/_stream.py` is the other side.
///
/// # Errors
/// Returns [`PygError::Malformed`] for frames that are invalid or cut short, [`PygError::Io`] when the streams fail,
/// and [`PygError::Stopped`] when the sink stops. Errors of single calls are reported, and reading continues.
pub fn serve(
    input: &mut dyn Read,
    output: &mut dyn Write,
    sink: &mut dyn SceneSink,
    reporter: &Reporter,
) -> Result<(), PygError> {
    let mut file: Arc<str> = "<stream>".into();
    let failed = |source: io::Error| PygError::Io { path: "<stream>".to_owned(), source };
    let malformed = |what: &str, file: &Arc<str>| PygError::Malformed {
        what: what.to_owned(),
        at: Location { file: file.clone(), ..Location::default() },
    };
    // The buffer makes each answer one write.
    let output = &mut io::BufWriter::new(output);
    let mut input = io::BufReader::with_capacity(1 << 18, input);
    loop {
        // A stream may only end between frames.
        if io::BufRead::fill_buf(&mut input).map_err(failed)?.is_empty() {
            return Ok(());
        }
        let event = match receive(&mut input) {
            Ok(event) => event,
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => {
                return Err(malformed("the stream of calls ends in the middle of one", &file));
            }
            Err(error) => return Err(failed(error)),
        };
        match event {
            Some(Event::Call { line, name, args }) => {
                pass_on(&name, args, &Location::line(&file, line), sink, reporter)?;
            }
            Some(Event::File(name)) => file = name.into(),
            Some(Event::Text(bytes)) => {
                // The text does not have a file name.
                let source = PygSource::Bytes { name: "".into(), bytes };
                let flat = PygOptions { always_pyglet: true, ..PygOptions::default() };
                read(source, sink, &flat, reporter)?;
            }
            Some(Event::Get(name)) => {
                let mut value = Vec::new();
                put_value(sink.attribute(&name).as_ref(), &mut value);
                send(output, b'G', &[&value]).map_err(failed)?;
            }
            Some(Event::Wait) => {
                let errors = u32::try_from(reporter.errors()).unwrap_or(u32::MAX);
                send(output, b'W', &[&errors.to_le_bytes()]).map_err(failed)?;
            }
            _ => return Err(malformed("the stream of calls is malformed", &file)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_base::Param;
    use granita_scene::{Call, Stop};

    #[derive(Default)]
    struct Recorder(Vec<(String, &'static str)>);

    impl SceneSink for Recorder {
        fn call(&mut self, call: Call, at: &Location) -> Result<(), Stop> {
            self.0.push((at.to_string(), call.name()));
            Ok(())
        }

        fn attribute(&self, declaration: &str) -> Option<Param> {
            (declaration == "float x").then(|| Param::declared("float x", 2.5).expect("a declaration"))
        }
    }

    fn frame(kind: u8, payload: &[u8]) -> Vec<u8> {
        let mut out = Vec::new();
        send(&mut out, kind, &[payload]).expect("memory");
        out
    }

    fn call(line: u32, name: &str) -> Vec<u8> {
        let length = (name.len() as u32).to_le_bytes();
        frame(b'C', &[&line.to_le_bytes()[..], &length, name.as_bytes(), &0u32.to_le_bytes()].concat())
    }

    fn served(input: &[u8]) -> (Result<(), PygError>, Vec<u8>, Recorder, usize) {
        let (mut recorder, mut output) = (Recorder::default(), Vec::new());
        let (reporter, _) = Reporter::collecting();
        let result = serve(&mut &input[..], &mut output, &mut recorder, &reporter);
        (result, output, recorder, reporter.errors())
    }

    #[test]
    fn calls_and_attribute_queries_are_answered_and_errors_counted() {
        let input = [
            frame(b'F', b"a.py"),
            call(3, "World"),
            frame(b'A', b"float x"),
            call(4, "Wolrd"),
            frame(b'A', b"float y"),
            frame(b'W', b""),
        ];
        let (result, output, recorder, errors) = served(&input.concat());
        assert!(result.is_ok() && errors == 1);
        assert_eq!(recorder.0, [("a.py:3".to_owned(), "World")]);
        let value = [&b"f"[..], &2.5f64.to_le_bytes()].concat();
        assert_eq!(output, [frame(b'G', &value), frame(b'G', b"N"), frame(b'W', &[1, 0, 0, 0])].concat());
    }

    #[test]
    fn damaged_streams_end_with_a_message() {
        let good = [frame(b'F', b"a.py"), call(3, "World")].concat();
        for n in 0..good.len() {
            let (result, ..) = served(&good[..n]);
            let whole = n == 0 || n == frame(b'F', b"a.py").len();
            assert_eq!(result.is_ok(), whole, "{n}");
        }
        for bad in
            [frame(b'?', b""), frame(b'C', b"123"), frame(b'D', b"\0"), vec![b'C', 255, 255, 255, 255, 0]]
        {
            let text = served(&bad).0.expect_err("an error").to_string();
            assert!(text.contains("the stream of calls"), "{text}");
        }
    }
}
