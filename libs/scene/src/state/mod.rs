//! The graphics state machine, which receives calls, keeps the attribute state and freezes the scene.
//!
//! Before `World` transformations lead to the space in which the frame began ("base" space), and after it to world
//! space. Without a `Camera` call base space is the camera's, and `World` rebases everything that was declared
//! before. With one, base space is world space (reference 7.1.1).

mod attributes;
mod checkpoint;
mod current;
mod faces;
mod frame;
mod inputs;
mod lights;
mod modify;
mod motion;
mod pattern;
mod rerender;
mod save;
mod shaders;
mod shapes;
mod stage;
mod transforms;

pub use attributes::{attribute_from_text, version_attribute};
pub use checkpoint::Checkpoint;
pub use pattern::check_pattern;
pub use shapes::predeclared;

use crate::{Call, Camera, FrameRenderer, Light, LightId, Output, Primitive, SceneSink, Stop, attr};
use current::Current;
use granita_base::{Location, Param, Params, Reporter, Severity};
use inputs::Inputs;
use modify::ModifyMode;
use motion::MotionBlock;
use rerender::Rerender;
use save::Saved;
use shaders::GroupBlock;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// The phase of the frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    /// Before `World`.
    Options,
    /// Between `World` and `Render`.
    World,
    /// After a `Render` in re-rendering mode, before the next `World`.
    Rerender,
    /// After the only `Render`.
    Done,
}

/// An entry of the stack.
#[derive(Clone, Debug)]
enum Saved1 {
    Attributes(Box<Current>),
    Transform(granita_base::MotionTransform),
}

/// An entry of the stack, and the location of its call.
#[derive(Clone, Debug)]
struct Push {
    what: Saved1,
    at: Location,
}

/// The state right after `World`.
#[derive(Clone, Debug)]
struct World {
    current: Current,
    stack: Vec<Push>,
    /// The height of the stack at the last `World`. Entries below belong to the frame, not to the world.
    depth: usize,
}

/// The graphics state machine (reference 2.1.3), a [`SceneSink`] that builds a [`crate::Scene`] and passes it to a
/// [`FrameRenderer`] at `Render`.
///
/// Errors of the scene are sent to the reporter, once per cause, with location and object name. The call is then
/// ignored, or applied as far as possible. No sequence of calls panics.
pub struct State {
    reporter: Reporter,
    renderer: Box<dyn FrameRenderer>,
    phase: Phase,
    current: Current,
    stack: Vec<Push>,
    /// The state right after the first `World`.
    world: Option<World>,
    pending: Params,
    globals: BTreeMap<Arc<str>, Param>,
    /// The camera attributes set by `Attribute`, for the next camera.
    camera_values: BTreeMap<Arc<str>, Param>,
    /// The scene-writing attributes (4.3.12), kept for `GetAttribute` only.
    writer_values: BTreeMap<Arc<str>, Param>,
    cameras: Vec<Camera>,
    /// True when the only camera is that of a frame without a `Camera` call.
    implicit_camera: bool,
    outputs: Vec<Output>,
    primitives: Vec<Arc<Primitive>>,
    /// The primitives before `World`.
    early: Vec<Arc<Primitive>>,
    /// The primitives that a frame was begun for.
    staged: Vec<Arc<Primitive>>,
    lights: Vec<Arc<Light>>,
    /// Shared with the deferred inputs too.
    light_ids: Arc<BTreeMap<Arc<str>, LightId>>,
    /// Shared with the deferred inputs.
    saved: Arc<BTreeMap<Arc<str>, Saved>>,
    motion: Option<MotionBlock>,
    group: Option<GroupBlock>,
    modify: Option<ModifyMode>,
    inputs: Inputs,
    rendered: bool,
    rerender: Rerender,
    /// The cameras whose geometry sets a "geometryset" removed from the list: the first such value, and its location.
    lost_sets: BTreeMap<Arc<str>, (String, Location)>,
    /// The number of unmatched ends and beginnings of blocks.
    imbalances: usize,
    /// The names of the attributes that calls do not change.
    fixed: BTreeSet<Arc<str>>,
}

impl State {
    /// Returns a new frame that will be rendered by `renderer`.
    pub fn new(renderer: Box<dyn FrameRenderer>, reporter: Reporter) -> Self {
        Self {
            reporter,
            renderer,
            phase: Phase::Options,
            current: Current::default(),
            stack: Vec::new(),
            world: None,
            pending: Params::new(),
            globals: BTreeMap::new(),
            camera_values: BTreeMap::new(),
            writer_values: BTreeMap::new(),
            cameras: Vec::new(),
            implicit_camera: false,
            outputs: Vec::new(),
            primitives: Vec::new(),
            early: Vec::new(),
            staged: Vec::new(),
            lights: Vec::new(),
            light_ids: Arc::default(),
            saved: Arc::default(),
            motion: None,
            group: None,
            modify: None,
            inputs: Inputs::default(),
            rendered: false,
            rerender: Rerender::default(),
            lost_sets: BTreeMap::new(),
            imbalances: 0,
            fixed: BTreeSet::new(),
        }
    }

    /// Returns the renderer.
    pub fn renderer(&mut self) -> &mut dyn FrameRenderer {
        &mut *self.renderer
    }

    /// True when `Render` was called.
    pub fn has_rendered(&self) -> bool {
        self.rendered
    }

    /// The number of primitives and deferred inputs that are to be rendered.
    pub fn primitive_count(&self) -> usize {
        self.primitives.len() + self.inputs.waiting()
    }

    /// Reports blocks that are still open. It is called after the last call.
    pub fn end(&mut self) {
        self.finish_motion(&Location::default());
        self.leave_modify();
        self.drop_early();
        if let Some(group) = self.group.take() {
            self.report(
                Severity::Error,
                &group.at,
                "ShaderGroupBegin",
                "ShaderGroupBegin without ShaderGroupEnd",
            );
        }
        let bottom = self.world.as_ref().map_or(0, |world| world.depth).min(self.stack.len());
        for push in self.stack.split_off(bottom) {
            let (name, end) = push.what.names();
            self.report_imbalance(Severity::Warning, &push.at, format!("{name} without {end}"));
        }
        if !self.pending.is_empty() {
            let names: Vec<String> = self.pending.iter().map(|p| format!("\"{}\"", p.name)).collect();
            let text = format!("no call took the parameters {}", names.join(", "));
            self.report(Severity::Warning, &Location::default(), "pending", text);
        }
    }

    /// Reports a message about a call, once per cause and text, and again in later frames of re-rendering mode.
    fn report(&self, severity: Severity, at: &Location, cause: &str, text: impl Into<String>) {
        let text = text.into();
        let frame = self.rerender.frames;
        self.reporter.counted(&format!("scene {frame} {cause} {text}"), severity, at, text);
    }

    /// Reports a message about the scene itself, once in all frames.
    fn report_scene(&self, severity: Severity, at: &Location, cause: &str, text: String) {
        self.reporter.counted(&format!("scene {cause} {text}"), severity, at, text);
    }

    /// Does the same as [`State::report`], with the object's name if it has one.
    fn report_object(&self, severity: Severity, at: &Location, cause: &str, text: impl Into<String>) {
        let name = self.current.set.name();
        let text = text.into();
        let text = if name.is_empty() { text } else { format!("{text} (object \"{name}\")") };
        self.report(severity, at, cause, text);
    }

    /// Reports a block without its end, or an end without its block. Each is a separate error, but only a limited
    /// number is listed.
    fn report_imbalance(&mut self, severity: Severity, at: &Location, text: String) {
        const LISTED: usize = 20;
        self.imbalances += 1;
        let place = if self.imbalances <= LISTED { at.to_string() } else { String::new() };
        self.reporter.counted(&format!("scene balance {text} {place}"), severity, at, text);
    }

    /// Reports an error about a call in the wrong place.
    fn out_of_place(&self, at: &Location, call: &str, why: &str) {
        self.reporter.counted(
            &format!("scene {} place {call} {why}", self.rerender.frames),
            Severity::Error,
            at,
            format!("{call} {why}: the call is ignored"),
        );
    }

    /// Returns the pending parameters followed by those of the call itself.
    fn take_params(&mut self, inline: Params) -> Params {
        let mut all = std::mem::take(&mut self.pending);
        if all.is_empty() && !has_duplicates(&inline) {
            return inline;
        }
        inline.0.into_iter().for_each(|p| all.set(p));
        all
    }

    /// True when several calls of `Render` are legal.
    fn is_rerenderable(&self) -> bool {
        attr::RERENDER.of(self.globals.get(attr::RERENDER.name()))
    }
}

impl Saved1 {
    /// Returns the calls that push and pop the entry.
    fn names(&self) -> (&'static str, &'static str) {
        match self {
            Self::Attributes(_) => ("PushAttributes", "PopAttributes"),
            Self::Transform(_) => ("PushTransform", "PopTransform"),
        }
    }
}

fn has_duplicates(params: &Params) -> bool {
    params.0.iter().enumerate().any(|(i, p)| params.0[..i].iter().any(|q| q.name == p.name))
}

impl std::fmt::Debug for State {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("State")
            .field("phase", &self.phase)
            .field("primitives", &self.primitives.len())
            .field("lights", &self.lights.len())
            .finish_non_exhaustive()
    }
}

impl SceneSink for State {
    fn call(&mut self, call: Call, at: &Location) -> Result<(), Stop> {
        if self.phase == Phase::Done && !matches!(call, Call::Command { .. } | Call::Comment(_)) {
            self.out_of_place(at, call.name(), "after Render, and \"rerender\" is not set");
            return Ok(());
        }
        // A motion block accepts only transformations or primitives, and parameters in between.
        let fits = matches!(
            call,
            Call::Parameter(_)
                | Call::Comment(_)
                | Call::Shape { .. }
                | Call::Translate(_)
                | Call::Rotate { .. }
                | Call::Scale(_)
                | Call::AppendTransform(_)
                | Call::SetTransform(_)
        );
        if self.motion.is_some() && !fits {
            self.finish_motion(at);
        }
        match call {
            Call::Parameter(p) => self.pending.set(p),
            Call::Attribute(p) => self.set_attribute(p, at),
            Call::PushAttributes => {
                let what = Saved1::Attributes(Box::new(self.current.clone()));
                self.stack.push(Push { what, at: at.clone() });
            }
            Call::PopAttributes => self.pop_attributes(at),
            Call::SaveAttributes { name, attributes } => self.save(name, attributes.as_deref(), at),
            Call::RestoreAttributes { name, attributes } => self.restore(&name, attributes.as_deref(), at),
            Call::Modify { pattern } => {
                self.read_needed(true)?;
                self.enter_modify(&pattern, at);
            }
            Call::PushTransform => {
                let what = Saved1::Transform(self.current.set.to_world.clone());
                self.stack.push(Push { what, at: at.clone() });
            }
            Call::PopTransform => self.pop_transform(at),
            Call::SetTransform(_)
            | Call::AppendTransform(_)
            | Call::Translate(_)
            | Call::Rotate { .. }
            | Call::Scale(_) => self.transform(call, at),
            Call::Motion(times) => self.begin_motion(&times, at),
            Call::Camera { name, params } => self.camera(name, params, at),
            Call::Output { name, format, data, camera, params } => {
                let params = self.take_params(params);
                self.output(Output { name, format, data, camera, params }, at);
            }
            Call::World => self.begin_world(at),
            Call::Render { camera } => return self.render(camera.as_deref(), at),
            Call::Command { name, params } => return self.command(&name, params, at),
            Call::Comment(_) => {}
            Call::Shader { usage, name, layer, params } => self.shader(&usage, name, layer, params, at),
            Call::ShaderGroupBegin => self.begin_group(at),
            Call::ShaderGroupEnd => self.end_group(at),
            Call::ConnectShaders { source_layer, source, target_layer, target } => {
                self.connect(crate::Connection { source_layer, source, target_layer, target }, at);
            }
            Call::Light { id, shader, layer, params } => self.light(id, shader, layer, params, at),
            Call::LightSwitch { id, on } => self.light_switch(&id, on, at),
            Call::Shape { shape, params } => self.shape(*shape, params, at),
            Call::TrimCurve(_) if self.refuses("TrimCurve", "trim curves cannot change", at) => {}
            Call::TrimCurve(trim) => self.trim_curve(trim, at),
            Call::Input { .. } if self.refuses("Input", "objects cannot be added", at) => {}
            Call::Input { command, bound } => return self.input(command, bound, at),
        }
        Ok(())
    }

    fn new_frame(&mut self) -> bool {
        if self.phase != Phase::Done || self.inputs.reads_late() {
            return false;
        }
        self.begin_frame();
        true
    }

    fn in_world(&self) -> bool {
        self.phase != Phase::Options
    }

    fn attribute(&self, declaration: &str) -> Option<Param> {
        self.get_attribute(declaration)
    }
}
