//! The worker's side of the connection.

use super::connection::of_task;
use super::{
    ALIVE, BEGUN, BUCKET, COMMANDS, DROP, DROPPED, END, FRAME, GREETING, NO_PIXELS, PIXELS, Progress, word,
};
use crate::patient::PULSE;
use granita_base::Reporter;
use granita_pyg::frames::{Frame, put_floats, receive, send};
use granita_render::{BucketPixels, Coordinator, Task};
use parking_lot::{Condvar, Mutex};
use std::collections::VecDeque;
use std::io::{self, BufReader, BufWriter, Read, Write};
use std::sync::Arc;

/// The stream to the coordinator, which several threads write to.
type Output = Mutex<BufWriter<Box<dyn Write + Send>>>;

/// The connection of a worker to its coordinator.
pub(crate) struct WorkerCoordinator {
    shared: Arc<Shared>,
    output: Arc<Output>,
    /// The number of commands and frames that the worker reached.
    here: Mutex<Progress>,
}

/// The state that the coordinator sent.
#[derive(Default)]
struct Shared {
    said: Mutex<Said>,
    changed: Condvar,
    /// Is called when the connection ends.
    ended: Mutex<Option<Ended>>,
}

/// What is done when the connection ends, with the last words of the coordinator.
type Ended = Box<dyn FnOnce(Option<String>) + Send>;

#[derive(Default)]
struct Said {
    progress: Progress,
    /// The frame of each task, and the task.
    waiting: VecDeque<(usize, Task)>,
    /// The tasks that are being rendered.
    rendering: Vec<(usize, Task)>,
    /// True when the connection has ended.
    over: bool,
}

impl WorkerCoordinator {
    /// Connects and sends the greeting. `ended` is called when the connection ends, with the last words of the
    /// coordinator: empty at the end of the work, and `None` when there are none.
    pub(crate) fn new(
        input: Box<dyn Read + Send>,
        output: Box<dyn Write + Send>,
        threads: usize,
        reporter: &Reporter,
        ended: Ended,
    ) -> Self {
        let mut output = BufWriter::new(output);
        if let Err(error) = writeln!(output, "{GREETING} {threads}").and_then(|()| output.flush()) {
            reporter.error(format!("-worker: {error}"));
        }
        let shared = Arc::new(Shared { ended: Mutex::new(Some(ended)), ..Shared::default() });
        let output = Arc::new(Mutex::new(output));
        let (theirs, to) = (shared.clone(), output.clone());
        std::thread::spawn(move || {
            let words = theirs.listen(input, &to);
            theirs.hang_up(words);
        });
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

impl WorkerCoordinator {
    /// Waits for the end of the connection, after the last frame of the scene, so that the last words of the
    /// coordinator arrive. Returns at once when the coordinator requests tasks of a frame that the scene does not have.
    pub(crate) fn rest(&self) {
        let mut said = self.shared.said.lock();
        while !said.over && said.waiting.is_empty() {
            self.shared.changed.wait(&mut said);
        }
    }
}

impl Shared {
    /// Receives messages until the connection ends. Returns the last words of the coordinator.
    fn listen(&self, input: Box<dyn Read + Send>, output: &Output) -> Option<String> {
        let mut input = BufReader::new(input);
        while let Ok((kind, payload)) = receive(&mut input) {
            if kind == END {
                return Some(String::from_utf8_lossy(&payload).into_owned());
            }
            let mut numbers = Frame(&payload);
            let mut number = || numbers.word().map(|n| n as usize);
            let (first, task) = (number(), number().zip(number()));
            let task =
                task.map(|(bucket, part)| Task { bucket, part: u32::try_from(part).unwrap_or(u32::MAX) });
            let mut said = self.said.lock();
            let mut given_back = None;
            match (kind, first, task) {
                (COMMANDS, Some(number), _) => said.progress.commands = number,
                (FRAME, Some(number), _) => {
                    said.progress.frame = number;
                    said.waiting.retain(|(frame, _)| *frame >= number);
                }
                (BUCKET, Some(frame), Some(task)) => said.waiting.push_back((frame, task)),
                (DROP, Some(frame), Some(task)) => {
                    let at = said.waiting.iter().position(|waiting| *waiting == (frame, task));
                    given_back = at.and_then(|at| said.waiting.remove(at));
                }
                _ => (),
            }
            drop(said);
            self.changed.notify_all();
            if let Some((frame, task)) = given_back {
                // The next read notices a connection that has ended.
                let _ = write(output, &of_task(DROPPED, task, frame));
            }
        }
        None
    }

    /// Sends signs of life as long as this process has buckets to render, also before it reaches their frame.
    fn beat(&self, output: &Output) {
        loop {
            std::thread::sleep(PULSE);
            let said = self.said.lock();
            let (over, works) = (said.over, !said.rendering.is_empty() || !said.waiting.is_empty());
            drop(said);
            if over {
                return;
            }
            let mut output = output.lock();
            if works && send(&mut *output, ALIVE, &[]).is_err() {
                return self.hang_up(None);
            }
        }
    }

    /// Ends the connection. A process that ends with it has ended before its scene goes on.
    fn hang_up(&self, words: Option<String>) {
        let ended = self.ended.lock().take();
        if let Some(ended) = ended {
            ended(words);
        }
        self.said.lock().over = true;
        self.changed.notify_all();
    }
}

impl Coordinator for WorkerCoordinator {
    fn begin(&self) {
        self.here.lock().frame += 1;
    }

    fn next(&self) -> Option<Task> {
        // Frames before this index are over when this one is.
        let frame = self.here.lock().frame;
        let mut said = self.shared.said.lock();
        loop {
            if said.progress.frame >= frame || said.over {
                return None;
            }
            if let Some((frame, task)) = said.waiting.pop_front() {
                said.rendering.push((frame, task));
                drop(said);
                if write(&self.output, &of_task(BEGUN, task, frame)).is_err() {
                    self.shared.hang_up(None);
                }
                return Some(task);
            }
            self.shared.changed.wait(&mut said);
        }
    }

    fn done(&self, task: Task, pixels: Result<&BucketPixels, &str>) {
        let mut said = self.shared.said.lock();
        let at = said.rendering.iter().position(|(_, rendering)| *rendering == task);
        let frame = at.map_or(0, |at| said.rendering.swap_remove(at).0);
        drop(said);
        let mut bytes = [word(frame), word(task.bucket), word(task.part as usize)].concat();
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
            self.shared.hang_up(None);
        }
    }
}

/// Sends a whole message.
fn write(output: &Output, message: &[u8]) -> io::Result<()> {
    let mut output = output.lock();
    output.write_all(message)?;
    output.flush()
}
