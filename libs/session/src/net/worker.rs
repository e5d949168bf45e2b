//! The worker's side of the connection.

use super::{ALIVE, BUCKET, COMMANDS, FRAME, GREETING, NO_PIXELS, PIXELS, Progress, word};
use crate::patient::PULSE;
use granita_base::Reporter;
use granita_pyg::frames::{Frame, put_floats, receive, send};
use granita_render::{BucketPixels, Coordinator};
use parking_lot::{Condvar, Mutex};
use std::collections::VecDeque;
use std::io::{BufReader, BufWriter, Read, Write};
use std::sync::Arc;

/// The connection of a worker to its coordinator.
pub(crate) struct WorkerCoordinator {
    shared: Arc<Shared>,
    output: Arc<Mutex<BufWriter<Box<dyn Write + Send>>>>,
    /// The number of commands and frames that the worker reached.
    here: Mutex<Progress>,
}

/// The state that the coordinator sent.
#[derive(Default)]
struct Shared {
    said: Mutex<Said>,
    changed: Condvar,
}

#[derive(Default)]
struct Said {
    progress: Progress,
    /// The frame and the index of each bucket to render.
    buckets: VecDeque<(usize, usize)>,
    /// The buckets that are being rendered.
    rendering: Vec<(usize, usize)>,
    /// True when the connection has ended.
    over: bool,
}

impl WorkerCoordinator {
    /// Connects and sends the greeting.
    pub(crate) fn new(
        input: Box<dyn Read + Send>,
        output: Box<dyn Write + Send>,
        threads: usize,
        reporter: &Reporter,
    ) -> Self {
        let mut output = BufWriter::new(output);
        if let Err(error) = writeln!(output, "{GREETING} {threads}").and_then(|()| output.flush()) {
            reporter.error(format!("-worker: {error}"));
        }
        let shared = Arc::new(Shared::default());
        let theirs = shared.clone();
        std::thread::spawn(move || theirs.listen(input));
        let output = Arc::new(Mutex::new(output));
        let (theirs, to) = (shared.clone(), output.clone());
        std::thread::spawn(move || theirs.beat(&to));
        Self { shared, output, here: Mutex::default() }
    }

    /// Waits until the coordinator has run the command that the worker reached. Returns false when the connection
    /// has ended.
    pub(crate) fn command(&self) -> bool {
        let number = {
            let mut here = self.here.lock();
            here.commands += 1;
            here.commands
        };
        let mut said = self.shared.said.lock();
        while said.progress.commands < number && !said.over {
            self.shared.changed.wait(&mut said);
        }
        said.progress.commands >= number
    }
}

impl Shared {
    fn listen(&self, input: Box<dyn Read + Send>) {
        let mut input = BufReader::new(input);
        while let Ok((kind, payload)) = receive(&mut input) {
            let mut numbers = Frame(&payload);
            let mut number = || numbers.word().map(|n| n as usize);
            let mut said = self.said.lock();
            match (kind, number(), number()) {
                (COMMANDS, Some(number), _) => said.progress.commands = number,
                (FRAME, Some(number), _) => {
                    said.progress.frame = number;
                    said.buckets.retain(|(frame, _)| *frame >= number);
                }
                (BUCKET, Some(frame), Some(number)) => said.buckets.push_back((frame, number)),
                _ => (),
            }
            drop(said);
            self.changed.notify_all();
        }
        self.hang_up();
    }

    /// Sends signs of life as long as this process has buckets to render, also before it reaches their frame.
    fn beat(&self, output: &Mutex<BufWriter<Box<dyn Write + Send>>>) {
        loop {
            std::thread::sleep(PULSE);
            let said = self.said.lock();
            let (over, works) = (said.over, !said.rendering.is_empty() || !said.buckets.is_empty());
            drop(said);
            if over {
                return;
            }
            let mut output = output.lock();
            if works && send(&mut *output, ALIVE, &[]).is_err() {
                return self.hang_up();
            }
        }
    }

    fn hang_up(&self) {
        self.said.lock().over = true;
        self.changed.notify_all();
    }
}

impl Coordinator for WorkerCoordinator {
    fn begin(&self) {
        self.here.lock().frame += 1;
    }

    fn next(&self) -> Option<usize> {
        // Frames before this index are over when this one is.
        let frame = self.here.lock().frame;
        let mut said = self.shared.said.lock();
        loop {
            if said.progress.frame >= frame {
                return None;
            }
            if said.over {
                return None;
            }
            if let Some(bucket) = said.buckets.pop_front() {
                said.rendering.push(bucket);
                return Some(bucket.1);
            }
            self.shared.changed.wait(&mut said);
        }
    }

    fn done(&self, index: usize, pixels: Result<&BucketPixels, &str>) {
        let mut said = self.shared.said.lock();
        let at = said.rendering.iter().position(|(_, number)| *number == index);
        let frame = at.map_or(0, |at| said.rendering.swap_remove(at).0);
        drop(said);
        let mut bytes = [word(index), word(frame)].concat();
        let kind = match pixels {
            Ok(images) => {
                bytes.extend(word(images.len()));
                images.iter().for_each(|values| put_floats(values, &mut bytes));
                PIXELS
            }
            Err(text) => {
                bytes.extend(text.bytes());
                NO_PIXELS
            }
        };
        if send(&mut *self.output.lock(), kind, &[&bytes]).is_err() {
            // The connection has ended.
            self.shared.hang_up();
        }
    }
}
