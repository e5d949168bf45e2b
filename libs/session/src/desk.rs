//! A desk for lighting: the lights of a scene are edited while its image is shown.
//!
//! [`Session::begin_desk`] comes before the scene is read, and [`Session::run_desk`] after its `Render`. The desk holds
//! the lights as data ([`Rig`]). For each image it returns to the scene as it was read ([`Checkpoint`]), makes the calls
//! that lead from the scene's lights to the edited ones, and renders. So an image does not depend on the way of edits
//! that led to its lights, undo is an earlier [`Rig`], and the patch that is saved consists of the same calls.
//!
//! The image and the panel go to a viewer through the image format "iv" ([`Screen`]), and edits come back from it. An
//! edit during a frame stops it, except that coarse frames of a drag are completed for some time: a drag that stops each
//! of them would show none.
//!
//! What is not here: the kept parts of a frame, which the renderer reuses by itself.

mod calls;
mod edit;
mod geometry;
mod history;
mod interface;
mod panel;
pub(crate) mod patch;
mod rig;
mod screen;
#[cfg(test)]
mod tests;

use crate::outputs::Requested;
use crate::{Session, SessionError};
use edit::{Change, Edit};
use geometry::Eye;
use granita_base::{BaseType, MotionTransform, Param, ParamType, Params, SearchPath, Vec3};
use granita_image::PixelRect;
use granita_scene::{Call, Checkpoint, attr};
use history::History;
use interface::{Emission, Interfaces};
use parking_lot::Mutex;
use rig::{Lamp, Layer, Rig, Rule};
use screen::{Plane, Screen};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// The longest wait for an edit.
const IDLE: Duration = Duration::from_millis(200);
/// The time for which the coarse frame of a drag is not stopped by further edits of the drag.
const COARSE: Duration = Duration::from_secs(2);
/// The time without an edit after which a drag counts as ended, because its page was closed.
const LOST_DRAG: Duration = Duration::from_secs(20);

/// How a frame of the desk differs from one of the scene.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct DeskFrame {
    /// True for one sample per pixel.
    pub(crate) coarse: bool,
    /// The crop window of the camera; `None` for that of the scene.
    pub(crate) crop: Option<[f32; 4]>,
}

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
    Coarse,
    Final,
}

impl Status {
    fn word(self) -> &'static str {
        match self {
            Self::Idle => "idle",
            Self::Coarse => "coarse",
            Self::Final => "final",
        }
    }
}

/// What the thread that receives edits must know of the current frame.
#[derive(Debug, Default)]
struct Running {
    /// The time at which the coarse frame of a drag began; `None` for any other frame.
    coarse: Option<Instant>,
}

/// The image that was rendered last.
struct Shown {
    rig: Rig,
    coarse: bool,
    complete: bool,
}

/// A desk. It belongs to a session.
pub(crate) struct Desk {
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
    /// The pixels of the last complete image.
    last: Option<Plane>,
    has_before: bool,
    /// The lights that were saved, and the name of the file.
    saved: Option<(Rig, String)>,
    ends: bool,
}

impl Session {
    /// Prepares a desk, before the scene is read: the scene is rendered in re-rendering mode, and its image is also
    /// shown in the viewer.
    ///
    /// # Errors
    /// Returns [`SessionError::Exit`] or [`SessionError::Failed`].
    pub fn begin_desk(&mut self, options: &DeskOptions) -> Result<(), SessionError> {
        self.call(Call::Attribute(attr::RERENDER.param(true)))?;
        let running = Arc::new(Mutex::new(Running::default()));
        let known = running.clone();
        let interrupts = move |text: &str| interrupts(text, &known.lock());
        let screen = Screen::new(self.registry(), &options.name, &options.address, self.stop(), interrupts);
        let images = screen.clone();
        self.plugins().set_program_images(Arc::new(move |number| images.format(number)));
        let data = match options.data.as_str() {
            "first" | "all" | "" => "rgba",
            data => data,
        };
        *self.requested().lock() = Requested { camera: None, data: vec![data.into(), "z".into()] };
        let said = Arc::new(Mutex::new(Vec::new()));
        self.listen(&said);
        self.desk = Some(Box::new(Desk {
            screen,
            running,
            file: options.file.clone(),
            checkpoint: None,
            base: Rig::default(),
            rig: Rig::default(),
            history: History::default(),
            interfaces: Interfaces::new(SearchPath::default(), self.plugins().clone()),
            shaders: Vec::new(),
            eye: None,
            status: Status::Idle,
            message: None,
            said,
            dragging: None,
            visible: None,
            shown: None,
            last: None,
            has_before: false,
            saved: None,
            ends: false,
        }));
        Ok(())
    }

    /// Collects the errors and warnings of the session, which are reported as before too.
    fn listen(&self, said: &Arc<Mutex<Vec<String>>>) {
        let reporter = self.reporter();
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

    /// Runs the desk until the user ends it, the viewer is gone, or the run ends.
    ///
    /// # Errors
    /// Returns [`SessionError::Exit`], or [`SessionError::Failed`] when there is nothing to relight.
    pub fn run_desk(&mut self) -> Result<(), SessionError> {
        let Some(mut desk) = self.desk.take() else { return Ok(()) };
        let result = desk.run(self);
        desk.screen.end();
        result
    }
}

/// True when an edit stops the current frame.
fn interrupts(text: &str, running: &Running) -> bool {
    match Edit::parse(text) {
        Err(_) | Ok((Edit::See | Edit::Begin, _)) => false,
        Ok((Edit::Light(..), _)) => running.coarse.is_none_or(|begin| begin.elapsed() > COARSE),
        Ok(_) => true,
    }
}

impl Desk {
    fn run(&mut self, session: &mut Session) -> Result<(), SessionError> {
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
        } else {
            return Ok(());
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
        self.status = if frame.coarse { Status::Coarse } else { Status::Final };
        self.show_panel(session);
        self.said.lock().clear();
        let Some(checkpoint) = &self.checkpoint else { return Ok(()) };
        session.state().return_to(checkpoint);
        for call in calls::calls(&self.base, &self.rig, checkpoint.world_values()) {
            session.call(call)?;
        }
        self.screen.begin_frame(self.seen().filter(|_| !frame.coarse));
        self.running.lock().coarse = frame.coarse.then(Instant::now);
        session.render_for_desk(Some(frame));
        let result = session.call(Call::Render { camera: None });
        session.render_for_desk(None);
        *self.running.lock() = Running::default();
        result?;
        let stopped = session.stop().load(Ordering::Relaxed);
        // A frame that failed is not tried again before the next edit.
        let complete = self.screen.is_complete();
        self.shown =
            Some(Shown { rig: self.rig.clone(), coarse: frame.coarse, complete: complete || !stopped });
        if complete && !frame.coarse {
            self.last = Some(self.screen.color());
        }
        if !stopped {
            self.hear();
        }
        self.show_objects(session);
        self.status = Status::Idle;
        Ok(())
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
        let edit = match Edit::parse(text) {
            Ok((edit, visible)) => {
                self.visible = visible.or(self.visible);
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

    /// Shows the last complete image as the one before the edit.
    fn keep_before(&mut self) {
        if let Some(last) = self.last.take() {
            self.screen.show_before(&last);
            self.has_before = true;
        }
    }

    /// Returns how a light emits, its position, and the direction in which it shines, in world space.
    fn frame(&mut self, lamp: &Lamp) -> Option<(Emission, Vec3, Vec3)> {
        // Of several layers, the last one that emits counts.
        let found = lamp.layers.iter().rev().find_map(|layer| {
            let interface = self.interfaces.get(&layer.shader).ok()?;
            let emission = interface.emission(layer);
            (emission != Emission::Ambient).then_some((interface, emission, layer))
        });
        let Some((interface, emission, layer)) = found else {
            let layer = lamp.layers.last()?;
            self.interfaces.get(&layer.shader).ok()?;
            return Some((Emission::Ambient, layer.to_world.first().point(Vec3::ZERO), Vec3::Z));
        };
        let (from, axis) = interface.frame(layer);
        let to_world = layer.to_world.first();
        Some((emission, to_world.point(from), to_world.vector(axis)))
    }

    /// Returns the pixel coordinates of the camera for those of the image.
    fn raster(&self, [x, y]: [f32; 2]) -> Option<[f32; 2]> {
        let window = self.window()?;
        Some([x + window.x0 as f32, y + window.y0 as f32])
    }

    /// Returns the point of the first surface in a pixel of the image, in world space.
    fn surface(&self, [x, y]: [f32; 2]) -> Option<Vec3> {
        let pixel = [x, y].map(|v| v.floor() as i32);
        let depth = self.screen.depth(pixel)?;
        let centre = self.raster(pixel.map(|v| v as f32 + 0.5))?;
        Some(self.eye.as_ref()?.point(centre, depth))
    }

    /// Changes a light.
    fn change(&mut self, rig: &mut Rig, id: &str, change: Change) -> Result<(), String> {
        if rig.lamp(id).is_none() && !matches!(change, Change::Restore) {
            return Err(self.no_light(id));
        }
        match change {
            Change::Delete => {
                rig.lamps.retain(|lamp| &*lamp.id != id);
                return Ok(());
            }
            Change::Copy => {
                let Some(lamp) = rig.lamp(id) else { return Err(self.no_light(id)) };
                let new = Lamp { id: rig.free_id(id, &self.base), solo: false, ..(**lamp).clone() };
                rig.lamps.push(Arc::new(new));
                return Ok(());
            }
            Change::Restore => {
                let Some(base) = self.base.lamp(id).cloned() else {
                    return Err(format!("light \"{id}\" is not from the scene"));
                };
                match rig.lamps.iter_mut().find(|lamp| &*lamp.id == id) {
                    Some(lamp) => *lamp = base,
                    None => rig.lamps.push(base),
                }
                return Ok(());
            }
            _ => (),
        }
        let Some(lamp) = rig.lamp_mut(id) else { return Err(self.no_light(id)) };
        match change {
            Change::Set(layer, name, value) => {
                let layer = layer_of(lamp, layer)?;
                let param = self.interfaces.get(&layer.shader)?.param(&name, &value)?;
                layer.params.set(param);
            }
            Change::Reset(index, name) => {
                let base = self.base.lamp(id).and_then(|base| base.layers.get(index));
                let old = base.and_then(|base| base.params.get(&name)).cloned();
                let layer = layer_of(lamp, index)?;
                match old {
                    Some(old) => layer.params.set(old),
                    None => layer.params.0.retain(|param| *param.name != *name),
                }
            }
            Change::Shader(index, name) => {
                let interface = self.interfaces.get(&name)?;
                let layer = layer_of(lamp, index)?;
                layer.shader = name.as_str().into();
                // The other shader has its own parameters.
                layer.params.0.retain(|param| interface.args.arg(&param.name).is_some());
            }
            Change::On(on) => lamp.off = !on,
            Change::Solo(solo) => lamp.solo = solo,
            Change::Link(pattern, on) => {
                granita_scene::check_pattern(&pattern)?;
                lamp.rules.push(Rule { pattern: pattern.as_str().into(), on });
            }
            Change::Unlink(index) if index < lamp.rules.len() => _ = lamp.rules.remove(index),
            Change::Unlink(index) => return Err(format!("light \"{id}\" has no rule {index}")),
            moves => {
                let by = self.motion(lamp, &moves)?;
                if let Some(by) = by {
                    lamp.transform(&by);
                }
            }
        }
        Ok(())
    }

    /// Returns the transformation of world space by which a change moves or turns a light.
    fn motion(&mut self, lamp: &Lamp, change: &Change) -> Result<Option<MotionTransform>, String> {
        let Some((emission, position, axis)) = self.frame(lamp) else {
            return Err(format!("the shader of light \"{}\" cannot be used", lamp.id));
        };
        if emission == Emission::Ambient {
            return Err(format!("light \"{}\" is ambient: it has no position", lamp.id));
        }
        if emission == Emission::Geometry {
            return Err(format!("light \"{}\" shines from objects, which stay where they are", lamp.id));
        }
        let Some(eye) = self.eye.clone() else { return Err("there is no camera".to_owned()) };
        let missing = || "there is no image yet".to_owned();
        Ok(match change {
            Change::Place(at) => {
                // A light behind the camera comes to where the objects are.
                let depth = eye.project(position).map(|[.., depth]| depth);
                let depth = depth.or_else(|| self.screen.usual_depth()).unwrap_or(1.0);
                let to = eye.point(self.raster(*at).ok_or_else(missing)?, depth);
                Some(geometry::moved(to - position))
            }
            Change::Distance(by) => {
                let Some([x, y, depth]) = eye.project(position) else {
                    return Err(format!("light \"{}\" is not before the camera", lamp.id));
                };
                Some(geometry::moved(eye.point([x, y], depth * by) - position))
            }
            Change::Position(to) => Some(geometry::moved(Vec3::from(*to) - position)),
            Change::Direction(angles) => geometry::turned(position, axis, geometry::direction(*angles)),
            Change::Aim(at) => {
                let target = self.surface(*at).ok_or("there is no surface to aim at")?;
                // A light without a position shines from where the camera is.
                let from = if emission == Emission::Direction { eye.position() } else { position };
                geometry::turned(position, axis, target - from)
            }
            _ => None,
        })
    }

    /// Adds a light. It shines from above and beside the camera at the middle of what is visible.
    fn add(&mut self, rig: &mut Rig, shader: &str, id: Option<&str>) -> Result<(), String> {
        let interface = self.interfaces.get(shader)?;
        if let Some(id) = id.filter(|id| rig.lamp(id).is_some() || self.base.lamp(id).is_some()) {
            return Err(format!("there is a light \"{id}\" already"));
        }
        let id = id.map_or_else(|| rig.free_id(shader, &self.base), Into::into);
        let window = self.window().ok_or("there is no image yet")?;
        let seen = self.seen().unwrap_or(PixelRect::at(0, 0, window.width() as u32, window.height() as u32));
        let middle = [seen.x0.midpoint(seen.x1) as f32, seen.y0.midpoint(seen.y1) as f32];
        let eye = self.eye.clone().ok_or("there is no camera")?;
        let depth = self.screen.usual_depth().unwrap_or(5.0);
        let target = self
            .surface(middle)
            .unwrap_or_else(|| self.raster(middle).map_or(Vec3::ZERO, |middle| eye.point(middle, depth)));
        let quarter =
            [seen.x0 as f32 * 0.6 + seen.x1 as f32 * 0.4, seen.y0 as f32 * 0.7 + seen.y1 as f32 * 0.3];
        let near = self.raster(quarter).map_or(target, |at| eye.point(at, 0.6 * depth));
        let mut params = Params::new();
        // The light arrives with about the intensity 1.
        let falls = interface.args.arg("falloff").is_some();
        let is_placed = matches!(interface.emission, Emission::Position { .. });
        if falls && is_placed && interface.args.arg("intensity").is_some() {
            let intensity = (target - near).length_squared();
            let ty = ParamType::of(BaseType::Float);
            params.set(Param { name: "intensity".into(), ty, data: round(intensity).into() });
        }
        let mut lamp = Lamp {
            id,
            layers: vec![Layer {
                shader: shader.into(),
                layer: None,
                params,
                to_world: MotionTransform::default(),
                state: "".into(),
            }],
            connections: Vec::new(),
            values: Arc::default(),
            state: "".into(),
            rules: Vec::new(),
            off: false,
            solo: false,
        };
        if let Some((_, position, axis)) = self.frame(&lamp) {
            lamp.transform(&geometry::moved(near - position));
            if let Some(turn) = geometry::turned(near, axis, target - near) {
                lamp.transform(&turn);
            }
        }
        rig.lamps.push(Arc::new(lamp));
        Ok(())
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

/// Returns a layer of a light for a change.
fn layer_of(lamp: &mut Lamp, index: usize) -> Result<&mut Layer, String> {
    let what = format!("light \"{}\" has no layer {index}", lamp.id);
    lamp.layers.get_mut(index).ok_or(what)
}

/// Returns a number with two significant digits.
fn round(value: f32) -> f32 {
    if value <= 0.0 || !value.is_finite() {
        return 1.0;
    }
    let unit = 10.0_f32.powf(value.log10().floor() - 1.0);
    (value / unit).round() * unit
}
