//! The program's side of the connection.

use super::images::Arriving;
use super::{GREETING, message};
use crate::commands::PriorityRequest;
use crate::patient::{Patience, Patient};
use granita_base::process::Process;
use granita_base::{Location, Param, ParamData, ParamType, Params, Reporter, Severity};
use granita_image::FormatFinder;
use granita_plugin::{Meanwhile, Plugins};
use granita_pyg::frames::{Frame, receive, send};
use granita_pyg::{Writer, WriterOptions};
use granita_scene::{Call, SceneSink, Stop, attr};
use parking_lot::{Condvar, Mutex};
use std::io::{self, Read, Write};
use std::sync::Arc;
use std::thread::{JoinHandle, ThreadId};
use std::time::{Duration, Instant};

/// The number of bytes of calls that are sent at once.
const PIECE: usize = 1 << 16;

/// The time in which a renderer without a connection must end.
const ENDING: Duration = Duration::from_secs(5);

/// The connection to a renderer.
pub struct RemoteEnds {
    /// The stream from the renderer.
    pub from: Box<dyn Read + Send>,
    /// The stream to the renderer.
    pub to: Box<dyn Write + Send>,
    /// The process of the renderer, which is ended when it is silent.
    pub process: Process,
    /// The longest silence in seconds, at least 2.
    pub patience: f32,
}

impl std::fmt::Debug for RemoteEnds {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("RemoteEnds")
    }
}

/// A renderer in another process that works in parallel to its program, which sends it calls. While it renders, it
/// accepts only queries for "render:progress" and the commands "return", "wait" and "bucketpriority".
pub struct Remote {
    link: Arc<Link>,
    writer: Mutex<Writer<Pieces>>,
    reporter: Reporter,
    thread: Option<JoinHandle<()>>,
}

impl std::fmt::Debug for Remote {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Remote")
    }
}

struct Link {
    to: Mutex<Box<dyn Write + Send>>,
    known: Mutex<Known>,
    changed: Condvar,
}

#[derive(Default)]
struct Known {
    /// The thread that receives. It cannot wait for answers.
    listener: Option<ThreadId>,
    rendering: bool,
    progress: f32,
    /// The answer to the last query; `None` before it arrives.
    value: Option<Option<ParamData>>,
    /// The numbers of wait requests that were sent and answered.
    asked: u64,
    answered: u64,
    /// True when the program ended the connection.
    leaving: bool,
    /// True when sending failed before that. The process has ended, which is reported even if the program ends the
    /// connection at the same time.
    lost: bool,
    /// True when there will be no more answers.
    over: bool,
}

/// Collects calls, and sends them when it is flushed.
struct Pieces {
    link: Arc<Link>,
    text: Vec<u8>,
}

impl Write for Pieces {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.text.extend(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        if self.text.is_empty() {
            return Ok(());
        }
        let sent = self.link.send(b'T', &self.text);
        self.text.clear();
        if sent { Ok(()) } else { Err(io::ErrorKind::BrokenPipe.into()) }
    }
}

impl Link {
    /// Sends a frame. Returns `false` when the connection has ended.
    fn send(&self, kind: u8, payload: &[u8]) -> bool {
        let sent = send(&mut **self.to.lock(), kind, &[payload]).is_ok();
        let mut known = self.known.lock();
        known.lost |= !sent && !known.leaving;
        sent
    }

    /// Waits for an answer. Returns `None` when there will be none.
    fn wait<T>(&self, answer: impl FnMut(&mut Known) -> Option<T>) -> Option<T> {
        self.wait_until(None, answer)
    }

    /// Waits for an answer until a moment. Returns `None` when there is none until then, or when there will be none.
    fn wait_until<T>(
        &self,
        until: Option<Instant>,
        mut answer: impl FnMut(&mut Known) -> Option<T>,
    ) -> Option<T> {
        let mut known = self.known.lock();
        if known.listener == Some(std::thread::current().id()) {
            return None;
        }
        loop {
            if let Some(answer) = answer(&mut known) {
                return Some(answer);
            }
            if known.over {
                return None;
            }
            let Some(until) = until else {
                self.changed.wait(&mut known);
                continue;
            };
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return None;
            }
            self.changed.wait_for(&mut known, left);
        }
    }

    /// Receives the frames of the renderer until the connection ends. Returns the error when the renderer was silent
    /// for too long.
    fn listen(&self, mut from: Patient, reporter: &Reporter, plugins: &Plugins) -> Option<String> {
        let mut arriving = Arriving::default();
        self.known.lock().listener = Some(std::thread::current().id());
        loop {
            let (kind, payload) = match receive(&mut from) {
                Ok(frame) => frame,
                Err(error) if error.kind() == io::ErrorKind::TimedOut => return Some(error.to_string()),
                Err(_) => return None,
            };
            match kind {
                b'B' => continue,
                b'M' => {
                    if let Some(message) = message(&payload) {
                        reporter.say(message.severity, &message.at, message.text);
                    }
                    continue;
                }
                b'O' | b'S' | b'L' => {
                    if let Err(what) = arriving.take(kind, &payload, |address| plugins.named(address)) {
                        reporter.error(what);
                    }
                    continue;
                }
                _ => {}
            }
            let mut known = self.known.lock();
            match kind {
                b'R' => known.progress = Frame(&payload).array().map_or(0.0, f32::from_le_bytes),
                b'D' => (known.rendering, known.progress) = (false, 1.0),
                b'G' => known.value = Some(Frame(&payload).data().flatten()),
                b'W' => known.answered += 1,
                _ => {}
            }
            drop(known);
            self.changed.notify_all();
        }
    }
}

/// Waits for the end of a process without a connection. Returns its status as text.
fn ended(process: &mut Process) -> String {
    process.wait_for_end(ENDING).map_or_else(|e| e.to_string(), |status| status.to_string())
}

impl Meanwhile for Link {
    fn command(&self, name: &str) -> bool {
        matches!(name, "return" | "exit") && self.send(b'X', &[])
    }

    fn attribute(&self, name: &str) -> Option<Param> {
        let known = self.known.lock();
        let done = if known.rendering { known.progress.min(0.999_999) } else { known.progress };
        attr::RENDER_PROGRESS.is_named(name).then(|| attr::RENDER_PROGRESS.param(done))
    }
}

impl Remote {
    /// Waits for the greeting of a renderer that was started. Its messages go to `reporter`. `plugins` contains the
    /// images of the program that the renderer may write to. Also returns the object that answers while a call is being
    /// executed.
    ///
    /// # Errors
    /// Returns the reason why there is no renderer.
    pub fn new(
        mut ends: RemoteEnds,
        reporter: &Reporter,
        plugins: Plugins,
    ) -> Result<(Self, Arc<dyn Meanwhile>), String> {
        let mut from =
            Patient::new(ends.from, Patience::new(ends.patience)).map_err(|error| error.to_string())?;
        match receive(&mut from) {
            Ok((b'H', greeting)) if greeting == GREETING.as_bytes() => {}
            Ok((_, greeting)) => {
                let start: String = String::from_utf8_lossy(&greeting).chars().take(80).collect();
                return Err(format!(
                    "the renderer that was found is \"{start}\", and this is \"{GREETING}\""
                ));
            }
            Err(error) if error.kind() == io::ErrorKind::TimedOut => {
                return Err(format!("the renderer did not start: {error}"));
            }
            Err(_) => return Err(format!("the renderer did not start ({})", ended(&mut ends.process))),
        }
        let link =
            Arc::new(Link { to: Mutex::new(ends.to), known: Mutex::default(), changed: Condvar::new() });
        let (listener, mut process) = (link.clone(), ends.process);
        let (says, reporter) = (reporter.clone(), reporter.clone());
        let thread = std::thread::Builder::new().name("gelato".to_owned()).spawn(move || {
            // A silent renderer is ended, so that blocked writes to it return.
            let how = match listener.listen(from, &says, &plugins) {
                Some(silence) => {
                    drop(process);
                    silence
                }
                None => ended(&mut process),
            };
            let mut known = listener.known.lock();
            (known.over, known.rendering) = (true, false);
            let leaving = known.leaving && !known.lost;
            drop(known);
            if !leaving {
                says.error(format!("the renderer's process has ended ({how}): nothing more is rendered"));
            }
            listener.changed.notify_all();
        });
        let thread = Some(thread.map_err(|e| e.to_string())?);
        let options = WriterOptions { binary: true, ..WriterOptions::default() };
        let writer = Writer::with_options(Pieces { link: link.clone(), text: Vec::new() }, options);
        let remote = Self { link: link.clone(), writer: Mutex::new(writer), reporter, thread };
        Ok((remote, link))
    }

    /// Sends the collected calls.
    fn flush(&self) -> Result<(), Stop> {
        self.writer.lock().flush().map_err(|_| Stop::Exit)
    }

    /// Waits until all sent calls are executed, or until "float time" (seconds) has passed.
    fn wait(&self, params: &Params) -> Result<(), Stop> {
        // A longer time counts as unlimited.
        const LONGEST: f32 = 1e9;
        let seconds = params.float("time").filter(|t| *t < LONGEST && !t.is_nan());
        let until = seconds.map(|t| Instant::now() + Duration::from_secs_f32(t.max(0.0)));
        self.flush()?;
        let mut known = self.link.known.lock();
        known.asked += 1;
        let mine = known.asked;
        drop(known);
        if self.link.send(b'W', &[]) {
            self.link.wait_until(until, |known| (known.answered >= mine).then_some(()));
        }
        if self.link.known.lock().over { Err(Stop::Exit) } else { Ok(()) }
    }
}

impl SceneSink for Remote {
    fn call(&mut self, call: Call, at: &Location) -> Result<(), Stop> {
        let command = match &call {
            Call::Command { name, params } if name.trim() == "wait" => return self.wait(params),
            Call::Command { name, .. } => Some(name.clone()),
            _ => None,
        };
        let mut known = self.link.known.lock();
        if known.over {
            // The end of the renderer was reported when it happened.
            return Err(Stop::Exit);
        }
        if known.rendering {
            drop(known);
            if let Call::Command { name, params } = &call
                && name.trim() == "bucketpriority"
            {
                match PriorityRequest::of(params) {
                    Ok(request) => _ = self.link.send(b'P', &request.to_bytes()),
                    Err(what) => self.reporter.say(Severity::Error, at, what),
                }
                return Ok(());
            }
            if !command.is_some_and(|name| self.link.command(&name)) {
                let text = format!("{} is ignored while a frame is rendered", call.name());
                self.reporter.say(Severity::Error, at, text);
            }
            return Ok(());
        }
        let renders = matches!(call, Call::Render { .. });
        let leaves = command.as_deref() == Some("exit");
        (known.rendering, known.leaving) = (renders, known.leaving || leaves);
        if renders {
            known.progress = 0.0;
        }
        drop(known);
        // Calls with effects that others may see, and calls that may take long, are sent at once.
        let goes = matches!(
            call,
            Call::Render { .. }
                | Call::Command { .. }
                | Call::World
                | Call::Output { .. }
                | Call::Input { .. }
        );
        let mut writer = self.writer.lock();
        match writer.call(call, at) {
            Ok(()) => {}
            Err(Stop::Io(error)) => return Err(Stop::Failed(error.to_string())),
            Err(other) => return Err(other),
        }
        if goes || writer.get_ref().text.len() >= PIECE {
            // The listening thread reports the reason of the failure.
            writer.flush().map_err(|_| Stop::Exit)?;
        }
        if leaves { Err(Stop::Exit) } else { Ok(()) }
    }

    fn attribute(&self, declaration: &str) -> Option<Param> {
        let name = declaration.split_whitespace().next_back()?;
        let known = self.link.known.lock();
        // A renderer that is done with its frame and has ended is still done.
        if known.rendering || (known.over && known.progress >= 1.0) {
            drop(known);
            return self.link.attribute(name);
        }
        drop(known);
        self.flush().ok()?;
        self.link.known.lock().value = None;
        if !self.link.send(b'A', declaration.as_bytes()) {
            return None;
        }
        let data = self.link.wait(|known| known.value.take())??;
        Some(Param { name: name.into(), ty: ParamType::default(), data })
    }
}

impl Drop for Remote {
    fn drop(&mut self) {
        self.link.known.lock().leaving = true;
        // A frame that is being rendered is finished. A program that does not need it calls Command ("return") before.
        let _ = self.writer.lock().flush();
        self.link.send(b'Z', &[]);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
#[cfg(unix)]
mod tests {
    use super::*;
    use granita_base::Supervisor;
    use std::process::{Command, Stdio};

    fn refused(script: &str) -> String {
        let mut command = Command::new("sh");
        command.args(["-c", script]).stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut process = Supervisor::default().spawn(&mut command, "").unwrap();
        let (to, from) = (process.take_stdin().unwrap(), process.take_stdout().unwrap());
        let ends = RemoteEnds { from: Box::new(from), to: Box::new(to), process, patience: 2.0 };
        let begin = Instant::now();
        let plugins = Plugins::new(Reporter::silent(), granita_plugin::PluginRules::default());
        let error = Remote::new(ends, &Reporter::silent(), plugins).map(|_| ()).unwrap_err();
        assert!(begin.elapsed() < Duration::from_secs(10));
        error
    }

    #[test]
    fn renderers_that_do_not_greet_are_refused() {
        std::thread::scope(|scope| {
            for (script, error) in [
                ("exec sleep 1000", "the renderer did not start: it has been silent for 2 s"),
                // This script announces a greeting of 4 GiB.
                (
                    "printf 'H\\377\\377\\377\\377'; exec sleep 1000",
                    "did not start: it has been silent for 2 s",
                ),
                ("exit 3", "the renderer did not start (exit status: 3)"),
                (
                    "printf 'H\\003\\000\\000\\000old'; exec sleep 1000",
                    "the renderer that was found is \"old\", and this is \"granita-remote ",
                ),
            ] {
                scope.spawn(move || {
                    let said = refused(script);
                    assert!(said.contains(error), "{script}: {said}");
                });
            }
        });
    }
}
