//! Reads calls from a program that started the renderer, such as the Python package.

use crate::frames::{self, framed, put_value};
use crate::python::{Event, event};
use crate::reader::pass_on;
use crate::{PygError, PygOptions, PygSource, read};
use granita_base::{Location, Reporter};
use granita_scene::{SceneSink, Stop};
use std::io::{self, Read, Write};
use std::sync::Arc;

/// Requests of a program that are not calls, such as a request for the pixels of an image.
pub trait Requests {
    /// Executes a request and returns the payload of the answer, which is a frame of the same kind. `None` stands for
    /// an unknown kind and for an invalid payload. `file` is the file that the request comes from.
    ///
    /// # Errors
    /// Returns the errors of `sink`.
    fn answer(
        &mut self,
        kind: u8,
        payload: &[u8],
        file: &Arc<str>,
        sink: &mut dyn SceneSink,
    ) -> Result<Option<Vec<u8>>, Stop>;
}

/// No requests. Every kind is unknown.
struct NoRequests;

impl Requests for NoRequests {
    fn answer(
        &mut self,
        _: u8,
        _: &[u8],
        _: &Arc<str>,
        _: &mut dyn SceneSink,
    ) -> Result<Option<Vec<u8>>, Stop> {
        Ok(None)
    }
}

/// Passes the calls of a stream on until it ends, and answers its queries on `output`. Each answer is one write.
///
/// Frames in both directions are those of [`crate::frames`]. `C` is a call, `F` the file that calls come from, and `T`
/// calls as flat Pyg. `A` queries an attribute, and `G` answers with its value. `W` waits, and `W` answers with the
/// number of errors so far. [`Requests`] may answer further kinds. `bindings/python/gelato/_stream.py` is the other
/// side.
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
    serve_with(input, output, sink, reporter, &mut NoRequests)
}

/// Does the same as [`serve`], and passes frames of other kinds to `requests`.
///
/// # Errors
/// Returns the errors of [`serve`].
pub fn serve_with(
    input: &mut dyn Read,
    output: &mut dyn Write,
    sink: &mut dyn SceneSink,
    reporter: &Reporter,
    requests: &mut dyn Requests,
) -> Result<(), PygError> {
    let mut file: Arc<str> = "<stream>".into();
    let failed = |source: io::Error| PygError::Io { path: "<stream>".to_owned(), source };
    let malformed = |what: &str, file: &Arc<str>| PygError::Malformed {
        what: what.to_owned(),
        at: Location { file: file.clone(), ..Location::default() },
    };
    let mut answer = |kind: u8, payload: &[u8]| {
        let frame = framed(kind, &[payload])?;
        output.write_all(&frame)?;
        output.flush()
    };
    let mut input = io::BufReader::with_capacity(1 << 18, input);
    loop {
        // A stream may only end between frames.
        if io::BufRead::fill_buf(&mut input).map_err(failed)?.is_empty() {
            return Ok(());
        }
        let (kind, payload) = match frames::receive(&mut input) {
            Ok(frame) => frame,
            Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => {
                return Err(malformed("the stream of calls ends in the middle of one", &file));
            }
            Err(error) => return Err(failed(error)),
        };
        match event(kind, &payload) {
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
                answer(b'G', &value).map_err(failed)?;
            }
            Some(Event::Wait) => {
                let errors = u32::try_from(reporter.errors()).unwrap_or(u32::MAX);
                answer(b'W', &errors.to_le_bytes()).map_err(failed)?;
            }
            _ => match requests.answer(kind, &payload, &file, sink)? {
                Some(payload) => answer(kind, &payload).map_err(failed)?,
                None => return Err(malformed("the stream of calls is malformed", &file)),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_base::Param;
    use granita_scene::Call;

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
        framed(kind, &[payload]).expect("a short frame")
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

    /// Answers `V` with the reversed payload, and refuses an empty one.
    struct Reverse;

    impl Requests for Reverse {
        fn answer(
            &mut self,
            kind: u8,
            payload: &[u8],
            file: &Arc<str>,
            _: &mut dyn SceneSink,
        ) -> Result<Option<Vec<u8>>, Stop> {
            assert_eq!(&**file, "a.py");
            let known = kind == b'V' && !payload.is_empty();
            Ok(known.then(|| payload.iter().rev().copied().collect()))
        }
    }

    #[test]
    fn requests_are_answered_in_their_order() {
        let reporter = Reporter::silent();
        let serve = |input: &[u8]| {
            let mut output = Vec::new();
            let mut sink = Recorder::default();
            let result = serve_with(&mut &input[..], &mut output, &mut sink, &reporter, &mut Reverse);
            (result, output)
        };
        let head = frame(b'F', b"a.py");
        let (result, output) = serve(&[head.clone(), frame(b'V', b"abc"), frame(b'A', b"float y")].concat());
        assert!(result.is_ok());
        assert_eq!(output, [frame(b'V', b"cba"), frame(b'G', b"N")].concat());
        for unknown in [frame(b'V', b""), frame(b'I', b"abc")] {
            let (result, output) = serve(&[head.clone(), unknown].concat());
            assert!(result.is_err() && output.is_empty());
        }
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
