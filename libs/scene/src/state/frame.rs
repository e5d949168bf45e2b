//! Cameras, outputs, `World`, `Render` and commands (reference 2.3).

use super::attributes::{attribute_names, convert, typed};
use super::transforms::hint;
use super::{Phase, Saved1, State, World};
use crate::attribute::{AttributeRow, Scope, TABLE, attr, attribute_row};
use crate::interface::COMMANDS;
use crate::{AttributeSet, Camera, Output, Scene, Stop};
use granita_base::{Location, MotionTransform, Param, Params, Severity, suggestion};
use std::collections::BTreeMap;
use std::sync::Arc;

/// The parameters of a `Camera` by their rows, without a value when they are in error.
type GivenParameters = Vec<(&'static AttributeRow, Option<Param>)>;

impl State {
    /// Handles `Camera`. The camera is at the current transformation and looks along +z.
    pub(super) fn camera(&mut self, name: Arc<str>, params: Params, at: &Location) {
        let params = self.take_params(params);
        if self.phase == Phase::World {
            return self.out_of_place(at, "Camera", "after World");
        }
        let given = self.given_parameters(&name, &params, at);
        if self.in_rerender() {
            return self.rerender_camera(&name, &given, at);
        }
        self.implicit_camera = false;
        let to_world = &self.current.set.to_world;
        if to_world.keys().iter().any(|(_, m)| m.try_inverse().is_none()) {
            let text = format!("the space of camera \"{name}\" cannot be inverted");
            self.report(Severity::Error, at, "camera", text);
        }
        let world_to_camera = to_world.inverse();
        let params = self.camera_params(given);
        let camera = Camera { name: name.clone(), world_to_camera, params };
        match self.cameras.iter_mut().find(|c| c.name == name) {
            Some(old) => *old = camera,
            None => self.cameras.push(camera),
        }
        self.add_to_sets(&name);
    }

    /// Returns the defaults, overridden by `Attribute`s, overridden by the parameters of the call.
    fn camera_params(&self, given: GivenParameters) -> Params {
        let rows = TABLE.iter().filter(|r| r.scope == Scope::Camera);
        let mut all: Params = rows.filter_map(|r| r.default_param()).collect();
        for value in self.camera_values.values() {
            all.set(value.clone());
        }
        given.into_iter().filter_map(|(_, value)| value).for_each(|value| all.set(value));
        all
    }

    /// Returns the parameters of a `Camera`, converted. Those in error are reported.
    fn given_parameters(&self, camera: &str, params: &Params, at: &Location) -> GivenParameters {
        let mut given = Vec::new();
        for param in params {
            let Some(row) = attribute_row(&param.name).filter(|r| r.scope == Scope::Camera) else {
                let hint = hint(suggestion(&param.name, attribute_names(&[Scope::Camera])));
                let text = format!("Camera \"{camera}\": unknown parameter \"{}\"{hint}", param.name);
                self.report(Severity::Warning, at, "camera parameter", text);
                continue;
            };
            if self.fixed.contains(row.name) {
                continue;
            }
            let value = convert(param, row);
            if let Err(text) = &value {
                let text = format!("Camera \"{camera}\": {text}");
                self.report(Severity::Error, at, "camera parameter", text);
            }
            given.push((row, value.ok()));
        }
        given
    }

    /// Handles `Output` and takes the pending parameters.
    pub(super) fn output(&mut self, output: Output, at: &Location) {
        if self.phase == Phase::World {
            return self.out_of_place(at, "Output", "after World");
        }
        let mut params = Params::new();
        let mut wrong = Vec::new();
        for param in &output.params {
            let row = attribute_row(&param.name).filter(|r| r.scope == Scope::Output);
            let checked = match row {
                Some(row) => convert(param, row),
                // Other parameters are for the image format.
                None => typed(param),
            };
            match checked {
                Ok(param) => {
                    params.set(param);
                }
                Err(text) => {
                    let text = format!("Output \"{}\": {text}", output.name);
                    self.report(Severity::Error, at, "output parameter", text);
                    wrong.push(param.name.clone());
                }
            }
        }
        let output = Output { params, ..output };
        if &*output.format == "null" || output.format.is_empty() {
            // Without "part" all parts of the file are removed.
            let is_all = output.part().is_empty();
            let is_meant =
                |o: &Output| if is_all { o.name == output.name } else { o.is_replaced_by(&output) };
            if self.in_rerender() && !self.outputs.iter().any(is_meant) {
                let hint = hint(suggestion(&output.name, self.outputs.iter().map(|o| &*o.name)));
                let text =
                    format!("Output: cannot remove \"{}\", there is no such output{hint}", output.name);
                self.report(Severity::Warning, at, "output", text);
            }
            self.outputs.retain(|o| !is_meant(o));
            return;
        }
        if self.in_rerender() && self.outputs.iter().any(|o| o.is_replaced_by(&output)) {
            return self.rerender_output(&output, &wrong, at);
        }
        match self.outputs.iter_mut().find(|o| o.is_replaced_by(&output)) {
            Some(old) => *old = output,
            None => self.outputs.push(output),
        }
    }

    /// Handles `World`.
    pub(super) fn begin_world(&mut self, at: &Location) {
        self.leave_modify();
        if let Some(group) = self.group.take() {
            self.out_of_place(&group.at, "ShaderGroupBegin", "without ShaderGroupEnd");
        }
        if self.inputs.reads_late() {
            return self.out_of_place(at, "World", "inside an Input with a bound");
        }
        match self.phase {
            Phase::World => return self.out_of_place(at, "World", "after World"),
            Phase::Rerender => {
                self.current.edit().to_world = MotionTransform::default();
                self.phase = Phase::World;
                if let Some(world) = &mut self.world {
                    world.depth = self.stack.len();
                }
                return;
            }
            _ => {}
        }
        self.drop_early();
        if self.cameras.is_empty() {
            self.implicit_camera(at);
        }
        self.current.edit().to_world = MotionTransform::default();
        self.phase = Phase::World;
        self.world =
            Some(World { current: self.current.clone(), stack: self.stack.clone(), depth: self.stack.len() });
    }

    /// Declares a camera when there was no `Camera` call. The frame then began in camera space, and the current
    /// transformation places the world.
    fn implicit_camera(&mut self, at: &Location) {
        let world_to_camera = self.current.set.to_world.clone();
        if world_to_camera.keys().iter().any(|(_, m)| m.try_inverse().is_none()) {
            self.report(Severity::Error, at, "World", "the transformation at World cannot be inverted");
        }
        // Outputs may already use its name. Objects are visible to it as members of "camera".
        let named = self.outputs.iter().map(|o| &o.camera).find(|c| !c.is_empty());
        let name: Arc<str> = named.cloned().unwrap_or_else(|| "camera".into());
        let params = self.camera_params(Vec::new());
        let rebase = world_to_camera.inverse();
        self.cameras.push(Camera { name, world_to_camera, params });
        self.implicit_camera = true;
        // Everything declared before was placed relative to the camera.
        let still = rebase == MotionTransform::default();
        if still {
            return;
        }
        self.current.edit().rebase(&rebase);
        for push in &mut self.stack {
            match &mut push.what {
                Saved1::Attributes(set) => set.edit().rebase(&rebase),
                Saved1::Transform(m) => *m = m.then(&rebase),
            }
        }
        Arc::make_mut(&mut self.saved).values_mut().for_each(|s| s.set.rebase(&rebase));
        for light in &mut self.lights {
            let light = Arc::make_mut(light);
            light.group = light.group.rebased(&rebase);
            let mut attributes: AttributeSet = (*light.attributes).clone();
            attributes.rebase(&rebase);
            light.attributes = Arc::new(attributes);
        }
    }

    /// Handles `Render`: freezes the scene and passes it to the renderer.
    pub(super) fn render(&mut self, camera: Option<&str>, at: &Location) -> Result<(), Stop> {
        self.leave_modify();
        if self.phase == Phase::Options {
            self.drop_early();
            self.out_of_place(at, "Render", "before World");
            return Ok(());
        }
        if self.inputs.reads_late() {
            self.out_of_place(at, "Render", "inside an Input with a bound");
            return Ok(());
        }
        let bottom = self.world.as_ref().map_or(0, |world| world.depth);
        if self.stack.len() > bottom {
            for push in self.stack.split_off(bottom) {
                let (name, end) = push.what.names();
                self.report_imbalance(Severity::Warning, &push.at, format!("{name} without {end}"));
            }
        }
        let camera = camera.filter(|c| !c.is_empty());
        let wanted = match camera {
            Some(name) if !self.cameras.iter().any(|c| &*c.name == name) => {
                let hint = hint(suggestion(name, self.cameras.iter().map(|c| &*c.name)));
                let text = format!("Render: no camera \"{name}\"{hint}; all cameras are rendered");
                self.report(Severity::Warning, at, "render camera", text);
                None
            }
            other => other,
        };
        let rerender = self.is_rerenderable();
        self.read_needed(rerender)?;
        let scene = Arc::new(self.freeze(rerender));
        self.check_sets(&scene);
        self.forget_inputs();
        let result = self.renderer.render(scene, wanted);
        self.rendered = true;
        self.phase = if rerender { Phase::Rerender } else { Phase::Done };
        if rerender {
            self.rerender.frames += 1;
            self.rerender.refused_lights.clear();
        }
        if let Some(world) = &mut self.world {
            self.current = world.current.clone();
            self.stack.clone_from(&world.stack);
            world.depth = world.stack.len();
        }
        result
    }

    /// Removes the frame that was rendered. Scene-wide and camera attributes are kept.
    pub(super) fn begin_frame(&mut self) {
        self.phase = Phase::Options;
        self.current = super::current::Current::default();
        self.stack.clear();
        self.world = None;
        self.cameras.clear();
        self.implicit_camera = false;
        self.outputs.clear();
        self.primitives.clear();
        self.early.clear();
        self.staged.clear();
        self.lights.clear();
        self.light_ids = Arc::default();
        self.saved = Arc::default();
        self.inputs.clear();
        self.lost_sets.clear();
    }

    /// Warns about cameras with images that show no object since "geometryset" removed them from the list
    /// (reference 4.4.3).
    fn check_sets(&self, scene: &Scene) {
        if scene.primitives.is_empty() || scene.inputs.unread > 0 {
            return;
        }
        let dynamic = |o: &Output| o.get(attr::DYNAMIC);
        for (camera, (change, at)) in &self.lost_sets {
            let shows = |set: &Arc<str>| set == camera || &**set == "camera";
            if !scene.outputs.iter().any(|o| o.camera == *camera && !dynamic(o))
                || scene.primitives.iter().any(|p| p.attributes.geometry_sets.iter().any(shows))
            {
                continue;
            }
            let added: Vec<String> = change.split(',').map(|set| format!("+{}", set.trim())).collect();
            let text = format!(
                "camera \"{camera}\" shows nothing: Attribute (\"geometryset\", \"{change}\") removes \"{camera}\" from the list; \"{}\" keeps it",
                added.join(",")
            );
            self.report_scene(Severity::Warning, at, "geometryset", text);
        }
    }

    /// Returns the finished scene. Unless `keep` is true, the primitives are moved into it.
    pub(super) fn freeze(&mut self, keep: bool) -> Scene {
        self.drop_removed_lights();
        let mut outputs = self.outputs.clone();
        if let Some(first) = self.cameras.first() {
            for output in outputs.iter_mut().filter(|o| o.camera.is_empty()) {
                output.camera = first.name.clone();
            }
            if outputs.is_empty() {
                let name = format!("{}.tif", first.name);
                outputs.push(Output {
                    name: name.into(),
                    format: "tiff".into(),
                    data: "rgba".into(),
                    camera: first.name.clone(),
                    params: Params::new(),
                });
            }
        }
        for output in &outputs {
            if !self.cameras.iter().any(|c| c.name == output.camera) {
                let hint = hint(suggestion(&output.camera, self.cameras.iter().map(|c| &*c.name)));
                let text = format!("Output \"{}\": no camera \"{}\"{hint}", output.name, output.camera);
                self.report_scene(Severity::Error, &Location::default(), "output camera", text);
            }
        }
        let late = self.inputs.late_spaces().iter().map(|(n, m)| (n.clone(), m.clone()));
        let spaces = self.saved.iter().filter_map(|(n, s)| Some((n.clone(), s.transform()?.clone())));
        let spaces: BTreeMap<_, _> = late.chain(spaces).collect();
        let primitives = if keep { self.primitives.clone() } else { std::mem::take(&mut self.primitives) };
        Scene {
            globals: self.globals.clone(),
            cameras: self.cameras.clone(),
            outputs,
            primitives,
            lights: self.lights.clone(),
            coordinate_systems: spaces,
            inputs: self.inputs.counts(),
        }
    }

    /// Removes the removed lights from the lists of all objects.
    fn drop_removed_lights(&mut self) {
        let removed = |id: crate::LightId| self.lights[id.0 as usize].group.layers.is_empty();
        if !self.lights.iter().any(|l| l.group.layers.is_empty()) {
            return;
        }
        let mut new: BTreeMap<usize, Arc<AttributeSet>> = BTreeMap::new();
        for primitive in &mut self.primitives {
            let old = primitive.attributes.clone();
            if !old.lights.iter().any(removed) {
                continue;
            }
            let set = new.entry(Arc::as_ptr(&old) as usize).or_insert_with(|| {
                let lights = old.lights.iter().filter(|l| !removed(*l)).collect();
                Arc::new(AttributeSet { lights, ..(*old).clone() })
            });
            Arc::make_mut(primitive).attributes = set.clone();
        }
    }

    /// Handles `Command`.
    pub(super) fn command(&mut self, name: &str, params: Params, at: &Location) -> Result<(), Stop> {
        let params = self.take_params(params);
        let word = name.split_whitespace().next().unwrap_or("");
        if word == "exit" {
            return Err(Stop::Exit);
        }
        if !self.renderer.command(name, &params, at)? {
            let text = if COMMANDS.iter().any(|row| row.name == word) {
                format!("Command \"{word}\" is not supported yet")
            } else {
                format!(
                    "unknown command \"{word}\"{}",
                    hint(suggestion(word, COMMANDS.iter().map(|row| row.name)))
                )
            };
            self.report(Severity::Warning, at, "command", text);
        }
        Ok(())
    }
}
