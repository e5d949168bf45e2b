//! `Input` (reference 2.9), which is read at once, or deferred until a camera or a ray may need its contents.

use super::current::Current;
use super::save::Saved;
use super::{Phase, State};
use crate::attr;
use crate::{DeferredInput, InputCounts, InputPaths, InputReader, LightId, Stop};
use granita_base::{Location, MotionTransform, Params, Severity};
use std::collections::BTreeMap;
use std::sync::Arc;

/// The largest nesting of inputs. Deeper inputs are not read.
const MAX_INPUT_DEPTH: usize = 64;

/// An input that is being read.
#[derive(Clone)]
struct Link {
    identity: Arc<str>,
    command: Arc<str>,
}

/// A deferred input, with all of the state that its calls may use.
struct Waiting {
    reader: InputReader,
    bound: [f32; 6],
    at: Location,
    /// The number of primitives before it.
    position: usize,
    current: Current,
    saved: Arc<BTreeMap<Arc<str>, Saved>>,
    light_ids: Arc<BTreeMap<Arc<str>, LightId>>,
    /// The inputs that were being read, including itself.
    chain: Vec<Link>,
}

/// The inputs of a frame.
#[derive(Default)]
pub(super) struct Inputs {
    /// The inputs that are being read, outermost first.
    chain: Vec<Link>,
    /// The deferred inputs, in the order of their places in the scene.
    waiting: Vec<Waiting>,
    /// The number of lights before an input with a bound, while that input is read.
    late: Option<usize>,
    /// The spaces named by inputs with a bound.
    spaces: BTreeMap<Arc<str>, MotionTransform>,
    counts: InputCounts,
}

impl Inputs {
    /// True when an input with a bound is being read.
    pub(super) fn reads_late(&self) -> bool {
        self.late.is_some()
    }

    /// True when a light belongs to the scene around the input with a bound that is being read.
    pub(super) fn is_outside(&self, light: LightId) -> bool {
        self.late.is_some_and(|before| (light.0 as usize) < before)
    }

    /// Returns the spaces that inputs with a bound named, as transforms to world. Shaders may use them.
    pub(super) fn late_spaces(&self) -> &BTreeMap<Arc<str>, MotionTransform> {
        &self.spaces
    }

    /// Returns the numbers of inputs that were read late or not at all.
    pub(super) fn counts(&self) -> InputCounts {
        InputCounts { unread: self.waiting.len(), ..self.counts }
    }

    /// Clears the inputs for another frame.
    pub(super) fn clear(&mut self) {
        self.waiting.clear();
        self.spaces.clear();
    }

    /// The number of deferred inputs.
    pub(super) fn waiting(&self) -> usize {
        self.waiting.len()
    }

    /// Returns the reason why this input must not be read now, if there is one.
    fn endless(&self, link: &Link) -> Option<String> {
        let command = &link.command;
        if let Some(first) = self.chain.iter().position(|l| l.identity == link.identity) {
            let chain: Vec<&str> = self.chain[first..].iter().chain([link]).map(|l| &*l.command).collect();
            return Some(format!("Input \"{command}\" would read itself: {}", chain.join(" -> ")));
        }
        (self.chain.len() >= MAX_INPUT_DEPTH).then(|| {
            let outermost: Vec<&str> = self.chain.iter().take(3).map(|l| &*l.command).collect();
            format!(
                "Input \"{command}\" is nested deeper than {MAX_INPUT_DEPTH}: {} -> ...",
                outermost.join(" -> ")
            )
        })
    }
}

impl State {
    /// Reads a source that is not an `Input` of the scene but the scene itself, by `reader`. `identity` identifies
    /// it, as [`crate::FoundInput::identity`] does, so that a scene that contains itself is detected.
    pub fn read<R>(&mut self, identity: &str, name: &str, reader: impl FnOnce(&mut Self) -> R) -> R {
        self.inputs.chain.push(Link { identity: identity.into(), command: name.into() });
        let result = reader(self);
        self.inputs.chain.pop();
        result
    }

    /// Handles `Input`.
    pub(super) fn input(
        &mut self,
        command: Arc<str>,
        bound: Option<[f32; 6]>,
        at: &Location,
    ) -> Result<(), Stop> {
        let [input, generator] =
            [attr::PATH_INPUT, attr::PATH_GENERATOR].map(|key| key.of(self.globals.get(key.name())));
        let paths = InputPaths { input: &input, generator: &generator };
        let Some(found) = self.renderer.input(&command, paths, at)? else { return Ok(()) };
        let link = Link { identity: found.identity, command };
        if let Some(text) = self.inputs.endless(&link) {
            self.report(Severity::Error, at, "input depth", text);
            return Ok(());
        }
        let Some(bound) = bound.or(found.bound) else {
            let (identity, command) = (link.identity, link.command);
            return self.read(&identity, &command, |state| (found.reader)(state));
        };
        let mut chain = self.inputs.chain.clone();
        chain.push(link);
        let waiting = Waiting {
            reader: found.reader,
            bound,
            at: at.clone(),
            position: self.primitives.len(),
            current: self.current.clone(),
            saved: self.saved.clone(),
            light_ids: self.light_ids.clone(),
            chain,
        };
        let usable = self.is_usable(&bound, at);
        if usable && self.phase == Phase::World && self.group.is_none() && self.modify.is_none() {
            self.inputs.waiting.push(waiting);
            return Ok(());
        }
        self.read_apart(waiting)
    }

    fn is_usable(&self, bound: &[f32; 6], at: &Location) -> bool {
        let ordered = bound.chunks_exact(2).all(|b| b[0] <= b[1]);
        if !ordered || bound.iter().any(|x| !x.is_finite()) {
            let numbers = bound.map(|x| x.to_string()).join(", ");
            let text = format!("the bound ({numbers}) is empty: the Input is read at once");
            self.report(Severity::Warning, at, "input bound", text);
            return false;
        }
        true
    }

    /// Reads a deferred input with the state of its call, and leaves the current state unchanged.
    fn read_apart(&mut self, input: Waiting) -> Result<(), Stop> {
        let current = std::mem::replace(&mut self.current, input.current);
        let saved = std::mem::replace(&mut self.saved, input.saved.clone());
        let light_ids = std::mem::replace(&mut self.light_ids, input.light_ids);
        let chain = std::mem::replace(&mut self.inputs.chain, input.chain);
        let stack = std::mem::take(&mut self.stack);
        let pending = std::mem::replace(&mut self.pending, Params::new());
        let late = self.inputs.late.replace(self.lights.len());
        let result = (input.reader)(self);
        self.finish_motion(&input.at);
        self.leave_modify();
        if let Some(group) = self.group.take() {
            self.out_of_place(&group.at, "ShaderGroupBegin", "without ShaderGroupEnd");
        }
        for push in std::mem::replace(&mut self.stack, stack) {
            let (name, end) = push.what.names();
            self.report_imbalance(Severity::Warning, &push.at, format!("{name} without {end}"));
        }
        if !Arc::ptr_eq(&self.saved, &input.saved) {
            let own = self.saved.iter().filter(|(name, _)| !input.saved.contains_key(*name));
            let spaces = own.filter_map(|(name, s)| Some((name.clone(), s.transform()?.clone())));
            self.inputs.spaces.extend(spaces);
        }
        self.current = current;
        self.saved = saved;
        self.light_ids = light_ids;
        self.inputs.chain = chain;
        self.pending = pending;
        self.inputs.late = late;
        result
    }

    /// Reads the inputs with a bound that the frame may need, or `all` of them.
    pub(super) fn read_needed(&mut self, all: bool) -> Result<(), Stop> {
        // The inputs that are read may contain others, or shaders that use a larger part of the scene.
        while !self.inputs.waiting.is_empty() {
            let camera = self.shading_camera();
            let unread = self.inputs.waiting.iter_mut();
            let unread: Vec<DeferredInput> = unread
                .map(|w| DeferredInput { bound: w.bound, attributes: w.current.freeze(camera.as_ref()) })
                .collect();
            let needed = if all {
                vec![true; unread.len()]
            } else {
                let scene = Arc::new(self.freeze(true));
                self.renderer.needed(&scene, &unread)
            };
            if !needed.contains(&true) {
                break;
            }
            self.read_those(&needed)?;
        }
        Ok(())
    }

    /// Inserts the primitives of inputs at the places of their calls.
    fn read_those(&mut self, needed: &[bool]) -> Result<(), Stop> {
        let waiting = std::mem::take(&mut self.inputs.waiting);
        let mut before = std::mem::take(&mut self.primitives).into_iter();
        let (mut primitives, mut still) = (Vec::new(), Vec::new());
        let mut taken = 0;
        let mut result = Ok(());
        for (k, mut input) in waiting.into_iter().enumerate() {
            primitives.extend(before.by_ref().take(input.position.saturating_sub(taken)));
            taken = input.position;
            if result.is_err() || !needed.get(k).copied().unwrap_or(true) {
                input.position = primitives.len();
                still.push(input);
                continue;
            }
            result = self.read_apart(input);
            self.inputs.counts.read += 1;
            let base = primitives.len();
            for mut nested in self.inputs.waiting.drain(..) {
                nested.position += base;
                still.push(nested);
            }
            primitives.append(&mut self.primitives);
        }
        primitives.extend(before);
        self.primitives = primitives;
        self.inputs.waiting = still;
        result
    }

    /// Drops the inputs that the finished frame did not need.
    pub(super) fn forget_inputs(&mut self) {
        self.inputs.waiting.clear();
        self.inputs.counts = InputCounts::default();
    }
}
