//! The renderer's side of the connection.

use super::told::Told;
use crate::commands::PriorityRequest;
use crate::forwarded::Forwarded;
use crate::{Outcome, Session};
use granita_base::{Location, Param};
use granita_pyg::frames::{receive, send};
use granita_scene::{Call, SceneSink, State, Stop};
use std::io::Read;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

/// The largest number of frames of calls that wait.
const QUEUE: usize = 16;

/// The frames of calls, in the order of arrival.
struct Queue {
    frames: Receiver<Vec<u8>>,
    frame: Vec<u8>,
    read: usize,
    gone: Arc<AtomicBool>,
}

impl Read for Queue {
    fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
        while self.read == self.frame.len() {
            match self.frames.recv() {
                Ok(frame) if !self.gone.load(Ordering::Acquire) => (self.frame, self.read) = (frame, 0),
                _ => return Ok(0),
            }
        }
        let n = into.len().min(self.frame.len() - self.read);
        into[..n].copy_from_slice(&self.frame[self.read..self.read + n]);
        self.read += n;
        Ok(n)
    }
}

/// Separates frames that cannot wait from the others.
fn sort(mut input: Box<dyn Read + Send>, frames: &SyncSender<Vec<u8>>, told: &Told, gone: &AtomicBool) {
    loop {
        match receive(&mut *input) {
            Ok((b'X', _)) => told.end_frame(),
            Ok((b'P', payload)) => {
                if let Some(request) = PriorityRequest::from_bytes(&payload) {
                    told.set_priority(request);
                }
            }
            Ok((b'Z', _)) => return,
            Ok((kind, payload)) => {
                let mut frame = Vec::with_capacity(payload.len() + 5);
                // Writing to a vector does not fail.
                let _ = send(&mut frame, kind, &[&payload]);
                if frames.send(frame).is_err() {
                    return;
                }
            }
            Err(_) => {
                gone.store(true, Ordering::Release);
                return told.end_frame();
            }
        }
    }
}

/// The session's state, whose progress is reported.
struct Watched<'a> {
    state: &'a mut State,
    told: &'a Told,
}

impl SceneSink for Watched<'_> {
    fn call(&mut self, call: Call, at: &Location) -> Result<(), Stop> {
        let renders = matches!(call, Call::Render { .. });
        let done = self.state.call(call, at);
        if renders {
            self.told.forget_requests();
            self.told.say(b'D', &[]);
        }
        done
    }

    fn new_frame(&mut self) -> bool {
        self.state.new_frame()
    }

    fn in_world(&self) -> bool {
        self.state.in_world()
    }

    fn attribute(&self, declaration: &str) -> Option<Param> {
        self.state.attribute(declaration)
    }
}

impl Session {
    /// Executes calls from the program at the other end of a connection until the connection ends. The session's
    /// reporter and progress are those of `told`.
    pub fn obey(mut self, input: Box<dyn Read + Send>, told: &Told) -> Outcome {
        told.set_stop(self.stop());
        told.set_frame_priority(self.priority());
        let images = told.connection().clone();
        self.plugins()
            .set_program_images(Arc::new(move |address| Arc::new(Forwarded::new(&images, address))));
        let (sender, frames) = sync_channel(QUEUE);
        let gone = Arc::new(AtomicBool::new(false));
        let (sorter, flag) = (told.clone(), gone.clone());
        let started = std::thread::Builder::new()
            .name("remote".to_owned())
            .spawn(move || sort(input, &sender, &sorter, &flag));
        let reporter = self.reporter();
        if let Err(error) = started {
            reporter.error(format!("no thread can be started: {error}"));
            return self.finish();
        }
        let mut queue = Queue { frames, frame: Vec::new(), read: 0, gone };
        let mut watched = Watched { state: self.state(), told };
        match granita_pyg::serve(&mut queue, &mut told.clone(), &mut watched, &reporter) {
            Ok(()) | Err(granita_pyg::PygError::Stopped(Stop::Exit)) => {}
            Err(error) => reporter.error(error.to_string()),
        }
        self.finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_render::{Priority, Progress};

    #[test]
    fn a_request_counts_for_the_frame_that_was_asked_for() {
        let told = Told::new(Box::new(std::io::sink()));
        let priority = Arc::new(Priority::default());
        told.set_frame_priority(priority.clone());
        let (sender, frames) = sync_channel(QUEUE);
        let mut input = Vec::new();
        for request in [PriorityRequest::Center([7, 9]), PriorityRequest::Rectangle([1, 2, 3, 4])] {
            send(&mut input, b'P', &[&request.to_bytes()]).unwrap();
        }
        send(&mut input, b'P', &[b"123"]).unwrap();
        send(&mut input, b'W', &[]).unwrap();
        send(&mut input, b'Z', &[]).unwrap();
        sort(Box::new(std::io::Cursor::new(input)), &sender, &told, &AtomicBool::new(false));
        // The request does not wait behind calls.
        assert_eq!(frames.try_iter().count(), 1);
        let rectangle = granita_render::PixelRect { x0: 1, y0: 2, x1: 4, y1: 5 };
        assert_eq!(priority.current(), (Some([7, 9]), Some(rectangle)));
        // A frame that begins drops earlier requests, but not those for itself.
        let forgotten = Arc::new(Priority::default());
        told.set_frame_priority(forgotten.clone());
        told.begin(std::path::Path::new(""), 10);
        assert_eq!(forgotten.current(), (None, Some(rectangle)));
    }
}
