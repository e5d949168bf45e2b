//! A desk for lighting: the lights of a scene are edited while its image is shown.
//!
//! [`Desk::prepare`] comes before the scene is read, and [`Desk::run`] after its `Render`. The desk holds the lights as
//! data ([`Rig`]). For each image it returns to the scene as it was read ([`Checkpoint`]), makes the calls that lead
//! from the scene's lights to the edited ones, and renders. So an image does not depend on the edits that led to its
//! lights, undo is an earlier [`Rig`], and the patch that is saved consists of the same calls.
//!
//! The image and the panel go to a viewer through the image format "iv" ([`Screen`]), and edits come back from it.
//! An edit during a frame stops it, except that coarse frames of a drag are completed for some time. A drag that stops
//! each of them would show none.
//!
//! What is not here: the kept parts of a frame, which the renderer reuses by itself.

mod calls;
mod changes;
pub(crate) mod coarse;
mod edit;
mod geometry;
mod history;
mod interface;
mod panel;
mod patch;
mod rig;
mod screen;
#[cfg(test)]
mod tests;

use crate::outputs::{DeskFrame, Requested};
use crate::{Session, SessionError};
use coarse::Coarse;
use edit::{Edit, Received};
use geometry::Eye;
use granita_base::SearchPath;
use granita_image::PixelRect;
use granita_scene::{Call, Checkpoint, attr};
use history::History;
use interface::Interfaces;
use parking_lot::Mutex;
use rig::Rig;
use screen::{Plane, Screen};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// The longest wait for an edit.
const IDLE: Duration = Duration::from_millis(200);
/// The time for which the coarse frame of a drag is not stopped by further edits of the drag.
const COARSE: Duration = Duration::from_secs(2);
/// The same for the first coarse frame, which also finds what the samples see. A frame that is stopped keeps nothing of
/// that, so that no later frame of the drag would be faster.
const FIRST_COARSE: Duration = Duration::from_secs(20);
/// The time without an edit after which a drag counts as ended, because its page was closed.
const LOST_DRAG: Duration = Duration::from_secs(20);

/// The options of a desk.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DeskOptions {
    /// The name of the image in the viewer.
    pub name: String,
    /// The address of the viewer.
    pub address: String,
    /// The data of the image, as in `Output`.
    pub data: String,
    /// The name of the patch, unless the user chooses another one.
    pub file: String,
}

/// What the desk is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Status {
    Idle,
    /// The first coarse frame is rendered, without being shown.
    Preparing,
    Coarse,
    Final,
}

impl Status {
    fn word(self) -> &'static str {
        match self {
            Self::Idle => "idle",
            Self::Preparing => "preparing",
            Self::Coarse => "coarse",
            Self::Final => "final",
        }
    }
}

/// What the thread that receives edits must know of the current frame.
#[derive(Debug, Default)]
struct Running {
    /// The time until which the coarse frame of a drag is not stopped by edits of the drag; `None` for any other frame.
    coarse_until: Option<Instant>,
}

/// The image that was rendered last.
struct Shown {
    rig: Rig,
    coarse: bool,
    complete: bool,
}

/// A complete image, as the panel describes it.
#[derive(Clone, Copy, Debug, Default)]
struct CompleteImage {
    /// The number of the last edit that it shows.
    number: Option<u64>,
    coarse: bool,
}

/// A desk. It is prepared before the scene is read, and runs after its `Render`.
pub struct Desk {
    screen: Screen,
    running: Arc<Mutex<Running>>,
    file: String,
    checkpoint: Option<Checkpoint>,
    base: Rig,
    rig: Rig,
    history: History,
    interfaces: Interfaces,
    shaders: Vec<&'static str>,
    eye: Option<Eye>,
    status: Status,
    /// The last message, and true when it is an error.
    message: Option<(String, bool)>,
    /// The messages of the session since they were last shown.
    said: Arc<Mutex<Vec<String>>>,
    dragging: Option<Instant>,
    visible: Option<PixelRect>,
    shown: Option<Shown>,
    /// The number of the last edit that has one.
    number: Option<u64>,
    /// The last complete image.
    complete: CompleteImage,
    /// The pixels of the last complete image.
    last: Option<Plane>,
    /// The pixels before the last edit, until they are shown in an image of their own.
    before: Option<Plane>,
    has_before: bool,
    /// The lights that were saved, and the name of the file.
    saved: Option<(Rig, String)>,
    /// The crop window of the last complete coarse frame, whose visible surfaces the renderer has kept.
    prepared: Option<Option<[f32; 4]>>,
    ends: bool,
}

impl std::fmt::Debug for Desk {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Desk").field("file", &self.file).finish_non_exhaustive()
    }
}

impl Desk {
    /// Prepares a desk, before the scene is read: the scene is rendered in re-rendering mode, and its image is also
    /// shown in the viewer.
    ///
    /// # Errors
    /// Returns [`SessionError::Exit`] or [`SessionError::Failed`].
    pub fn prepare(session: &mut Session, options: &DeskOptions) -> Result<Self, SessionError> {
        session.call(Call::Attribute(attr::RERENDER.param(true)))?;
        let running = Arc::new(Mutex::new(Running::default()));
        let known = running.clone();
        let interrupts = move |text: &str| interrupts(text, &known.lock());
        let screen =
            Screen::new(session.registry(), &options.name, &options.address, session.stop(), interrupts);
        let images = screen.clone();
        session.plugins().set_program_images(Arc::new(move |number| images.format(number)));
        let data = match options.data.as_str() {
            "first" | "all" | "" => "rgba",
            data => data,
        };
        *session.requested().lock() = Requested { camera: None, data: vec![data.into(), "z".into()] };
        let said = Arc::new(Mutex::new(Vec::new()));
        listen(session, &said);
        Ok(Self {
            screen,
            running,
            file: options.file.clone(),
            checkpoint: None,
            base: Rig::default(),
            rig: Rig::default(),
            history: History::default(),
            interfaces: Interfaces::new(SearchPath::default(), session.plugins().clone()),
            shaders: Vec::new(),
            eye: None,
            status: Status::Idle,
            message: None,
            said,
            dragging: None,
            visible: None,
            shown: None,
            number: None,
            complete: CompleteImage::default(),
            last: None,
            before: None,
            has_before: false,
            saved: None,
            prepared: None,
            ends: false,
        })
    }

    /// Runs the desk until the user ends it, the viewer is gone, or the run ends.
    ///
    /// # Errors
    /// Returns [`SessionError::Exit`], or [`SessionError::Failed`] when there is nothing to relight.
    pub fn run(mut self, session: &mut Session) -> Result<(), SessionError> {
        let result = self.work(session);
        self.screen.end();
        result
    }
}

/// Collects the errors and warnings of the session, which are reported as before too.
fn listen(session: &Session, said: &Arc<Mutex<Vec<String>>>) {
    let reporter = session.reporter();
    let before = Arc::new(Mutex::new(None::<granita_base::report::Sink>));
    let (place, said) = (before.clone(), said.clone());
    let own = reporter.set_sink(Box::new(move |message| {
        if let Some(sink) = &mut *place.lock() {
            sink(message);
        }
        let mut said = said.lock();
        if message.severity >= granita_base::Severity::Warning && said.len() < 100 {
            said.push(message.to_string());
        }
    }));
    *before.lock() = Some(own);
}

/// True when an edit stops the current frame.
fn interrupts(text: &str, running: &Running) -> bool {
    let Ok(Received { edit, .. }) = Received::parse(text) else { return false };
    match edit {
        Edit::See | Edit::Begin => false,
        Edit::Light(..) => running.coarse_until.is_none_or(|until| Instant::now() > until),
        _ => true,
    }
}

impl Desk {
    fn work(&mut self, session: &mut Session) -> Result<(), SessionError> {
        self.start(session)?;
        while !self.ends && !session.options().run.supervisor.has_ended() && self.screen.gone().is_none() {
            self.turn(session)?;
        }
        self.save_unsaved(session);
        Ok(())
    }

    /// Takes the lights of the scene, whose first image is rendered.
    fn start(&mut self, session: &Session) -> Result<(), SessionError> {
        if let Some(what) = self.screen.gone() {
            return Err(SessionError::Failed(format!("the image cannot be shown: {what}")));
        }
        let Some(checkpoint) = session.state_ref().checkpoint().filter(|_| self.window().is_some()) else {
            let what = "there is nothing to relight: the scene rendered no image";
            return Err(SessionError::Failed(what.to_owned()));
        };
        let state = session.state_ref();
        self.base = Rig::of(state);
        self.rig = self.base.clone();
        self.eye = state.first_camera().map(Eye::new);
        let path = SearchPath::parse(
            &attr::PATH_SHADER.ask(state),
            &SearchPath::default(),
            &session.options().run.environment,
        );
        self.interfaces = Interfaces::new(path, session.plugins().clone());
        self.checkpoint = Some(checkpoint);
        let complete = self.screen.is_complete();
        self.shown = Some(Shown { rig: self.rig.clone(), coarse: false, complete });
        self.last = complete.then(|| self.screen.color());
        self.hear();
        self.show_objects(session);
        self.show_panel(session);
        Ok(())
    }

    /// Applies the edits that wait, or else renders the next frame, or else waits for an edit.
    fn turn(&mut self, session: &mut Session) -> Result<(), SessionError> {
        if self.dragging.is_some_and(|last| last.elapsed() > LOST_DRAG) {
            self.dragging = None;
            self.history.end_step();
        }
        let next = self.next_frame();
        let edits = self.screen.edits(if next.is_some() { Duration::ZERO } else { IDLE });
        if !edits.is_empty() {
            edits.iter().for_each(|edit| self.receive(edit, session));
        } else if let Some(frame) = next {
            self.render(frame, session)?;
        } else if !self.show_before() {
            return self.prepare_drags(session);
        }
        self.show_panel(session);
        Ok(())
    }

    /// Returns the window of the image within the full image.
    fn window(&self) -> Option<PixelRect> {
        self.screen.window()
    }

    /// Returns the next frame; `None` when the image shows the current lights as well as it should.
    fn next_frame(&self) -> Option<DeskFrame> {
        let coarse = self.dragging.is_some();
        let suffices = |shown: &Shown| shown.rig == self.rig && shown.complete && (coarse || !shown.coarse);
        if self.shown.as_ref().is_some_and(suffices) {
            return None;
        }
        let crop = self.seen().filter(|_| coarse).and_then(|seen| self.crop(seen));
        Some(DeskFrame { coarse, crop })
    }

    /// Returns the visible part of the window, if that is not all of it.
    fn seen(&self) -> Option<PixelRect> {
        let window = self.window()?;
        let all = PixelRect::at(0, 0, window.width() as u32, window.height() as u32);
        let seen = self.visible?.intersection(&all);
        (!seen.is_empty() && seen != all).then_some(seen)
    }

    /// Returns the coarse image, and the pixels of the window in which it is shown.
    fn coarse(&self) -> Option<(Coarse, PixelRect)> {
        let window = self.window()?;
        let all = PixelRect::at(0, 0, window.width() as u32, window.height() as u32);
        let resolution = self.eye.as_ref()?.resolution().map(|n| n as i32);
        Some((Coarse::new(resolution), self.seen().unwrap_or(all)))
    }

    /// Returns the crop window of a camera that renders a part of the window.
    fn crop(&self, part: PixelRect) -> Option<[f32; 4]> {
        let window = self.window()?;
        let [width, height] = self.eye.as_ref()?.resolution().map(f64::from);
        let part = part.moved(window.x0, window.y0);
        let edge = |at: i32, of: f64| (f64::from(at) / of) as f32;
        Some([edge(part.x0, width), edge(part.x1, width), edge(part.y0, height), edge(part.y1, height)])
    }

    /// Renders the current lights.
    fn render(&mut self, frame: DeskFrame, session: &mut Session) -> Result<(), SessionError> {
        self.screen.begin_frame(self.seen().filter(|_| !frame.coarse));
        self.render_as(if frame.coarse { Status::Coarse } else { Status::Final }, frame, session)?;
        let stopped = session.stop().load(Ordering::Relaxed);
        // A frame that failed is not tried again before the next edit.
        let complete = self.screen.is_complete();
        self.shown =
            Some(Shown { rig: self.rig.clone(), coarse: frame.coarse, complete: complete || !stopped });
        if complete {
            self.complete = CompleteImage { number: self.number, coarse: frame.coarse };
        }
        if complete && frame.coarse {
            self.prepared = Some(frame.crop);
        }
        if complete && !frame.coarse {
            self.last = Some(self.screen.color());
        }
        if !stopped {
            self.hear();
        }
        self.status = Status::Idle;
        if complete {
            self.show_panel(session);
            self.show_before();
        }
        self.show_objects(session);
        Ok(())
    }

    /// Renders the coarse frame of the current lights once, without showing it, while nothing else is to be done. The
    /// renderer keeps what the samples of coarse frames see, so that the first frame of a drag takes no longer than the
    /// others. An edit stops it, except those of a drag, whose first frame it is.
    fn prepare_drags(&mut self, session: &mut Session) -> Result<(), SessionError> {
        if self.prepared.is_some() || self.dragging.is_some() {
            return Ok(());
        }
        self.screen.hide(true);
        let result = self.render_as(Status::Preparing, DeskFrame { coarse: true, crop: None }, session);
        self.screen.hide(false);
        self.prepared = (!session.stop().load(Ordering::Relaxed)).then_some(None);
        // The frames that are shown report the same.
        self.said.lock().clear();
        self.status = Status::Idle;
        self.show_panel(session);
        result
    }

    /// Renders a frame of the current lights, while the panel shows a status.
    fn render_as(
        &mut self,
        status: Status,
        frame: DeskFrame,
        session: &mut Session,
    ) -> Result<(), SessionError> {
        let longest = if self.prepared == Some(frame.crop) { COARSE } else { FIRST_COARSE };
        self.running.lock().coarse_until = frame.coarse.then(|| Instant::now() + longest);
        self.status = status;
        self.show_panel(session);
        self.said.lock().clear();
        let Some(checkpoint) = &self.checkpoint else { return Ok(()) };
        session.state().return_to(checkpoint);
        for call in calls::calls(&self.base, &self.rig, checkpoint.world_values()) {
            session.call(call)?;
        }
        self.screen.be_coarse(self.coarse().filter(|_| frame.coarse));
        session.render_for_desk(Some(frame));
        let result = session.call(Call::Render { camera: None });
        session.render_for_desk(None);
        *self.running.lock() = Running::default();
        result
    }

    /// Shows the messages of the session in the panel.
    fn hear(&mut self) {
        let said = std::mem::take(&mut *self.said.lock());
        if let Some(first) = said.first() {
            self.message = Some((first.clone(), true));
        }
    }

    /// Applies an edit of a viewer.
    fn receive(&mut self, text: &str, session: &Session) {
        let edit = match Received::parse(text) {
            Ok(Received { edit, visible, number }) => {
                self.visible = visible.or(self.visible);
                self.number = number.or(self.number);
                edit
            }
            Err(what) => return self.message = Some((what, true)),
        };
        if self.dragging.is_some() {
            self.dragging = Some(Instant::now());
        }
        let done = match edit {
            Edit::See => return,
            Edit::Quit => {
                self.ends = true;
                return;
            }
            Edit::Begin => {
                self.dragging = Some(Instant::now());
                self.history.begin_step();
                return;
            }
            Edit::End => {
                self.dragging = None;
                self.history.end_step();
                return;
            }
            Edit::Undo => self.step(History::undo, "nothing to undo"),
            Edit::Redo => self.step(History::redo, "nothing to redo"),
            Edit::Save(file) => self.save(&file, session),
            Edit::Add { shader, id } => self.edit("add", |desk, rig| desk.add(rig, &shader, id.as_deref())),
            Edit::Light(id, change) => {
                let label = format!("{id}: {}", change.label());
                self.edit(&label, |desk, rig| desk.change(rig, &id, change))
            }
        };
        self.message = match done {
            Ok(None) => None,
            Ok(Some(text)) => Some((text, false)),
            Err(text) => Some((text, true)),
        };
    }

    /// Makes an edit, which is a step for undo unless it belongs to a drag that is one already. After an error the
    /// lights stay as they are.
    fn edit(
        &mut self,
        label: &str,
        change: impl FnOnce(&mut Self, &mut Rig) -> Result<(), String>,
    ) -> Result<Option<String>, String> {
        let mut rig = self.rig.clone();
        change(self, &mut rig)?;
        if rig != self.rig {
            if self.history.add(label, &self.rig) {
                self.keep_before();
            }
            self.rig = rig;
        }
        Ok(None)
    }

    /// Undoes or redoes a step.
    fn step(
        &mut self,
        step: impl FnOnce(&mut History, &Rig) -> Option<Rig>,
        none: &str,
    ) -> Result<Option<String>, String> {
        self.dragging = None;
        let rig = step(&mut self.history, &self.rig).ok_or_else(|| none.to_owned())?;
        self.keep_before();
        self.rig = rig;
        Ok(None)
    }

    /// Keeps the last complete image as the one before the edit.
    fn keep_before(&mut self) {
        self.before = self.last.take().or(self.before.take());
    }

    /// Shows the image before the edit. Returns false when the viewer has it already. It is sent after the first image
    /// with the edit, which a user waits for.
    fn show_before(&mut self) -> bool {
        let Some(before) = self.before.take() else { return false };
        self.screen.show_before(&before);
        self.has_before = true;
        true
    }

    /// Writes the patch, into the current folder.
    fn save(&mut self, file: &str, session: &Session) -> Result<Option<String>, String> {
        let file = if file.is_empty() { self.file.clone() } else { file.to_owned() };
        let is_name = Path::new(&file).file_name().is_some_and(|name| name == file.as_str());
        if !is_name || file.contains(['/', '\\', ':']) || !file.ends_with(".pyg") || file.starts_with('.') {
            return Err(format!("\"{file}\" is not a name that ends in .pyg, without a folder"));
        }
        self.write(&file, session)?;
        self.saved = Some((self.rig.clone(), file.clone()));
        let scenes = session.options().scene_files.join(" ");
        Ok(Some(format!("saved: gelato {scenes} {file}")))
    }

    fn write(&self, file: &str, session: &Session) -> Result<(), String> {
        let Some(checkpoint) = &self.checkpoint else { return Err("there is no image yet".to_owned()) };
        let scenes = &session.options().scene_files;
        let text = patch::text(&self.base, &self.rig, checkpoint.world_values(), scenes)
            .map_err(|error| error.to_string())?;
        patch::write(session.files(), Path::new(file), &text)
    }

    /// Keeps edits that the user did not save.
    fn save_unsaved(&mut self, session: &Session) {
        let saved = self.saved.as_ref().map_or(&self.base, |(rig, _)| rig);
        if *saved == self.rig {
            return;
        }
        let file = format!("{}.unsaved.pyg", self.file.strip_suffix(".pyg").unwrap_or(&self.file));
        match self.write(&file, session) {
            Ok(()) => session.reporter().warning(format!("the edits that were not saved are in {file}")),
            Err(what) => session.reporter().error(format!("the edits are lost: {what}")),
        }
    }
}
