//! Modify mode (reference 2.1.4, 2.4), which changes attribute states that objects already use.

use super::current::{Edit, flips_normals};
use super::transforms::hint;
use super::{Saved1, State, pattern};
use crate::{AttributeSet, LightId, ShaderGroup, ShaderInstance, attr, attribute_row};
use granita_base::{Location, MotionTransform, Severity, suggestion};
use regex::Regex;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// The states that are being changed.
#[derive(Debug)]
pub(super) struct ModifyMode {
    pattern: Regex,
    /// The height of the attribute stack at `Modify`. Popping below it ends the mode.
    depth: usize,
    /// Each matching state, in its old and its new form.
    targets: Vec<(Arc<AttributeSet>, AttributeSet)>,
    /// The shaders that were declared in matching states, and their new "shader" spaces. The spaces are the only part
    /// of those states that shaders keep.
    shaders: Vec<(Arc<ShaderInstance>, MotionTransform)>,
    /// The names of saved states that are changed.
    saved: Vec<Arc<str>>,
    /// The pattern as it was given.
    given: Arc<str>,
    /// True in a re-render, when a state of an object or of one of its shaders matches, and not only those of lights.
    has_objects: bool,
    /// The changes that a re-render does not allow, and their locations. A `Light` that follows takes them.
    refused: Vec<(String, Location)>,
}

/// The sections of the reference with the attributes that lights do not have: those of surfaces, dicing, displacement,
/// shading and trim curves.
const NOT_OF_LIGHTS: [&str; 5] = ["4.4.4", "4.4.5", "4.4.6", "4.4.7", "4.4.8"];

impl State {
    /// Handles `Modify`.
    pub(super) fn enter_modify(&mut self, pattern: &str, at: &Location) {
        self.leave_modify();
        let Some(regex) = self.read_pattern(pattern, at) else {
            let text = format!("Modify: cannot read the regular expression \"{pattern}\"");
            return self.report(Severity::Error, at, "modify", text);
        };
        let mut targets: BTreeMap<usize, Arc<AttributeSet>> = BTreeMap::new();
        let sets =
            self.primitives.iter().map(|p| &p.attributes).chain(self.lights.iter().map(|l| &l.attributes));
        for set in sets.filter(|s| regex.is_match(&s.name())) {
            targets.insert(Arc::as_ptr(set) as usize, set.clone());
        }
        let saved: Vec<Arc<str>> = self
            .saved
            .iter()
            .filter(|(_, s)| regex.is_match(&s.set.name()))
            .map(|(n, _)| n.clone())
            .collect();
        let targets: Vec<_> = targets.into_values().map(|s| (s.clone(), (*s).clone())).collect();
        let shaders = self.shaders_of_states(&regex);
        let has_objects = self.in_rerender() && self.matches_objects(&targets, &shaders);
        self.reporter.say(
            Severity::Info,
            at,
            format!("Modify \"{pattern}\" changes {} attribute states", targets.len() + saved.len()),
        );
        self.modify = Some(ModifyMode {
            pattern: regex,
            depth: self.stack.len(),
            targets,
            shaders,
            saved,
            given: pattern.into(),
            has_objects,
            refused: Vec::new(),
        });
    }

    /// Returns the regular expression of a pattern, which is a basic one. One that matches no name is read as an
    /// extended one if that matches a name, as an example of reference 11.2.1 needs.
    fn read_pattern(&self, given: &str, at: &Location) -> Option<Regex> {
        let basic = pattern::basic(given);
        let matches = |regex: &Regex| {
            self.state_names().any(|name| regex.is_match(&name)) || !self.shaders_of_states(regex).is_empty()
        };
        if basic.as_ref().is_some_and(&matches) {
            return basic;
        }
        let found = pattern::extended(given).filter(matches);
        if found.is_none() && basic.is_some() && self.in_rerender() {
            let names: BTreeSet<Arc<str>> = self.state_names().collect();
            let hint = hint(suggestion(given, names.iter().map(|name| &**name)));
            let text = format!("Modify \"{given}\": no object or light has a name that matches{hint}");
            self.report(Severity::Warning, at, "modify", text);
        }
        found.or(basic)
    }

    /// Returns the names of the states of objects and lights, and of saved ones, most of them once.
    fn state_names(&self) -> impl Iterator<Item = Arc<str>> {
        // Neighbours often share their state.
        let mut last = std::ptr::null();
        let objects = self.primitives.iter().map(|p| &p.attributes);
        let objects = objects.filter(move |set| {
            let this = Arc::as_ptr(set);
            !std::ptr::eq(std::mem::replace(&mut last, this), this)
        });
        let lights = self.lights.iter().filter(|light| !light.group.layers.is_empty());
        let sets = objects.chain(lights.map(|light| &light.attributes));
        sets.map(|set| set.name()).chain(self.saved.values().map(|saved| saved.set.name()))
    }

    /// True when a state of an object is among these states, or one of its shaders among these shaders.
    fn matches_objects(
        &self,
        targets: &[(Arc<AttributeSet>, AttributeSet)],
        shaders: &[(Arc<ShaderInstance>, MotionTransform)],
    ) -> bool {
        let targets: BTreeSet<usize> = targets.iter().map(|(set, _)| Arc::as_ptr(set) as usize).collect();
        let of_lights: BTreeSet<usize> = self
            .lights
            .iter()
            .flat_map(|light| &light.group.layers)
            .map(|layer| Arc::as_ptr(layer) as usize)
            .collect();
        self.primitives.iter().any(|p| targets.contains(&(Arc::as_ptr(&p.attributes) as usize)))
            || shaders.iter().any(|(shader, _)| !of_lights.contains(&(Arc::as_ptr(shader) as usize)))
    }

    /// Applies a change to the current state and, in modify mode, to the states that are being modified.
    ///
    /// After the first frame objects take only changes that re-rendering allows (reference 11.1). All others apply to
    /// the current state alone, for a light that follows.
    pub(super) fn edit_sets(&mut self, edit: Edit<'_>, change: impl Fn(&mut AttributeSet)) {
        if self.refuses_edit(edit) {
            return change(self.current.edit());
        }
        let Some(mode) = &mut self.modify else {
            return change(self.current.edit());
        };
        if mode.pattern.is_match(&self.current.set.name()) {
            change(self.current.edit());
        }
        mode.targets.iter_mut().for_each(|(_, set)| change(set));
        for (_, to_world) in &mut mode.shaders {
            let mut state = AttributeSet { to_world: std::mem::take(to_world), ..AttributeSet::default() };
            change(&mut state);
            *to_world = state.to_world;
        }
        for name in &mode.saved {
            if let Some(saved) = Arc::make_mut(&mut self.saved).get_mut(name) {
                change(&mut saved.set);
            }
        }
    }

    /// Removes a light from the lists of all objects, also of those that are being modified.
    pub(super) fn drop_light(&mut self, light: LightId) {
        let mut new: BTreeMap<usize, (Arc<AttributeSet>, Arc<AttributeSet>)> = BTreeMap::new();
        for primitive in self.primitives.iter_mut().filter(|p| p.attributes.lights.contains(light)) {
            let old = primitive.attributes.clone();
            let (_, set) = new.entry(Arc::as_ptr(&old) as usize).or_insert_with(|| {
                let mut set = AttributeSet::clone(&old);
                set.lights.switch(light, false);
                (old, Arc::new(set))
            });
            Arc::make_mut(primitive).attributes = set.clone();
        }
        for (old, set) in self.modify.iter_mut().flat_map(|mode| &mut mode.targets) {
            set.lights.switch(light, false);
            if let Some((_, other)) = new.get(&(Arc::as_ptr(old) as usize)) {
                *old = other.clone();
            }
        }
        self.current.edit().lights.switch(light, false);
    }

    /// Takes the changes that objects refuse as those of a light that follows them.
    pub(super) fn spend_refused(&mut self) {
        self.modify.iter_mut().for_each(|mode| mode.refused.clear());
    }

    /// True when a change must not apply to the objects that are being modified, because a re-render does not allow
    /// it. It is reported at once when lights do not have the attribute, and otherwise when no light follows.
    fn refuses_edit(&mut self, edit: Edit<'_>) -> bool {
        let in_rerender = self.in_rerender();
        let Some(mode) = self.modify.as_mut().filter(|mode| in_rerender && mode.has_objects) else {
            return false;
        };
        let (what, at, suits_lights) = match edit {
            Edit::Allowed => return false,
            Edit::Attribute(name, at) => {
                let section = attribute_row(name).map(|row| row.section);
                let suits_lights = section.is_none_or(|section| !NOT_OF_LIGHTS.contains(&section));
                (format!("Attribute \"{name}\""), at, suits_lights)
            }
            Edit::Call(name, at) => (name.to_owned(), at, true),
        };
        if suits_lights {
            if mode.refused.iter().all(|(other, _)| *other != what) {
                mode.refused.push((what, at.clone()));
            }
            return true;
        }
        let given = mode.given.clone();
        self.refuse_edit(&what, &given, at);
        true
    }

    fn refuse_edit(&self, what: &str, pattern: &str, at: &Location) {
        let text = format!(
            "{what} cannot change the objects of Modify \"{pattern}\" in a re-render (only LightSwitch and Attribute \"{}\" may)",
            attr::RERENDER_LOCKED.name()
        );
        self.refuse(at, text);
    }

    /// Adds an object that was declared in modify mode to the modified states if its name matches (reference 2.4).
    pub(super) fn modify_also(&mut self, set: &Arc<AttributeSet>) {
        let Some(mode) = &mut self.modify else { return };
        let known = mode.targets.iter().any(|(old, _)| Arc::ptr_eq(old, set));
        if !known && mode.pattern.is_match(&set.name()) {
            mode.targets.push((set.clone(), (**set).clone()));
        }
    }

    /// Adds a shader that was declared in modify mode if the name of its state matches.
    pub(super) fn modify_shader_also(&mut self, shader: &Arc<ShaderInstance>) {
        let Some(mode) = &mut self.modify else { return };
        if mode.pattern.is_match(&shader.state) {
            mode.shaders.push((shader.clone(), shader.to_world.clone()));
        }
    }

    /// Returns the shaders of objects, lights and states that were declared in states with matching names.
    fn shaders_of_states(&self, pattern: &Regex) -> Vec<(Arc<ShaderInstance>, MotionTransform)> {
        let mut found: BTreeMap<usize, Arc<ShaderInstance>> = BTreeMap::new();
        let mut take = |group: &ShaderGroup| {
            for layer in group.layers.iter().filter(|layer| pattern.is_match(&layer.state)) {
                found.insert(Arc::as_ptr(layer) as usize, layer.clone());
            }
        };
        let mut take_set = |set: &AttributeSet| {
            [&set.surface, &set.displacement, &set.volume].into_iter().flatten().for_each(|g| take(g));
        };
        let mut last = std::ptr::null();
        for primitive in &self.primitives {
            if !std::ptr::eq(last, Arc::as_ptr(&primitive.attributes)) {
                last = Arc::as_ptr(&primitive.attributes);
                take_set(&primitive.attributes);
            }
        }
        self.saved.values().for_each(|saved| take_set(&saved.set));
        take_set(&self.current.set);
        let world = self.world.iter().map(|world| &world.current.set);
        let pushed = self.stack.iter().filter_map(|push| match &push.what {
            Saved1::Attributes(current) => Some(&current.set),
            Saved1::Transform(_) => None,
        });
        world.chain(pushed).for_each(&mut take_set);
        self.lights.iter().for_each(|light| take(&light.group));
        found.into_values().map(|shader| (shader.clone(), shader.to_world.clone())).collect()
    }

    /// Leaves modify mode if it was entered above this height of the stack.
    pub(super) fn leave_modify_above(&mut self, height: usize) {
        if self.modify.as_ref().is_some_and(|m| m.depth > height) {
            self.leave_modify();
        }
    }

    /// Leaves modify mode and assigns the changed states to all objects.
    pub(super) fn leave_modify(&mut self) {
        let Some(mode) = self.modify.take() else { return };
        for (what, at) in &mode.refused {
            self.refuse_edit(what, &mode.given, at);
        }
        let camera = self.shading_camera();
        let mut moved = Moved::new(&mode.shaders);
        let targets: BTreeMap<usize, &AttributeSet> =
            mode.targets.iter().map(|(old, new)| (Arc::as_ptr(old) as usize, new)).collect();
        // Each state is replaced once, so that objects continue to share it.
        let mut known: BTreeMap<usize, Option<Arc<AttributeSet>>> = BTreeMap::new();
        let mut renewed = |old: &Arc<AttributeSet>| -> Option<Arc<AttributeSet>> {
            let at = Arc::as_ptr(old) as usize;
            let new = known.entry(at).or_insert_with(|| {
                let mut new = AttributeSet::clone(targets.get(&at).copied().unwrap_or(old));
                let moved = moved.set(&mut new);
                if !moved && new == **old {
                    return None;
                }
                new.flip_normals = flips_normals(&new, camera.as_ref());
                Some(Arc::new(new))
            });
            new.clone()
        };
        for primitive in &mut self.primitives {
            if let Some(set) = renewed(&primitive.attributes) {
                Arc::make_mut(primitive).attributes = set;
            }
        }
        for light in &mut self.lights {
            if let Some(set) = renewed(&light.attributes) {
                Arc::make_mut(light).attributes = set;
            }
        }
        if moved.is_empty() {
            return;
        }
        for light in &mut self.lights {
            if let Some(group) = moved.group(&light.group) {
                Arc::make_mut(light).group = group;
            }
        }
        let saved = Arc::make_mut(&mut self.saved).values_mut();
        saved.for_each(|saved| _ = moved.set(&mut saved.set));
        moved.set(self.current.edit());
        if let Some(world) = &mut self.world {
            moved.set(world.current.edit());
        }
        for push in &mut self.stack {
            if let Saved1::Attributes(current) = &mut push.what {
                moved.set(current.edit());
            }
        }
    }
}

/// Shaders with new "shader" spaces.
struct Moved {
    /// The new shaders by the address of the old one.
    shaders: BTreeMap<usize, Arc<ShaderInstance>>,
    /// The new groups by the address of the old group. The old group is kept, so that its address stays unique.
    groups: BTreeMap<usize, (Arc<ShaderGroup>, Option<Arc<ShaderGroup>>)>,
}

impl Moved {
    fn new(shaders: &[(Arc<ShaderInstance>, MotionTransform)]) -> Self {
        let changed = shaders.iter().filter(|(old, to_world)| old.to_world != *to_world);
        let renew = |(old, to_world): &(Arc<ShaderInstance>, MotionTransform)| {
            let new = ShaderInstance { to_world: to_world.clone(), ..(**old).clone() };
            (Arc::as_ptr(old) as usize, Arc::new(new))
        };
        Self { shaders: changed.map(renew).collect(), groups: BTreeMap::new() }
    }

    fn is_empty(&self) -> bool {
        self.shaders.is_empty()
    }

    /// Returns a group with the moved shaders; `None` when it has none of them.
    fn group(&self, old: &ShaderGroup) -> Option<ShaderGroup> {
        let new = |layer: &Arc<ShaderInstance>| self.shaders.get(&(Arc::as_ptr(layer) as usize)).cloned();
        old.layers.iter().any(|layer| new(layer).is_some()).then(|| {
            let layers = old.layers.iter().map(|layer| new(layer).unwrap_or_else(|| layer.clone()));
            ShaderGroup { layers: layers.collect(), connections: old.connections.clone() }
        })
    }

    /// Replaces the moved shaders in a state. Returns whether there are any.
    fn set(&mut self, set: &mut AttributeSet) -> bool {
        let mut any = false;
        if self.is_empty() {
            return any;
        }
        for slot in [&mut set.surface, &mut set.displacement, &mut set.volume].into_iter().flatten() {
            let at = Arc::as_ptr(slot) as usize;
            if !self.groups.contains_key(&at) {
                let new = self.group(slot).map(Arc::new);
                self.groups.insert(at, (slot.clone(), new));
            }
            if let Some((_, Some(new))) = self.groups.get(&at) {
                *slot = new.clone();
                any = true;
            }
        }
        any
    }
}
