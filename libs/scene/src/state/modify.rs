//! Modify mode (reference 2.1.4, 2.4), which changes attribute states that objects already use.

use super::current::flips_normals;
use super::{Saved1, State};
use crate::{AttributeSet, ShaderGroup, ShaderInstance};
use granita_base::{Location, MotionTransform, Severity};
use regex::Regex;
use std::collections::BTreeMap;
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
}

impl State {
    /// Handles `Modify`.
    pub(super) fn enter_modify(&mut self, pattern: &str, at: &Location) {
        self.leave_modify();
        let regex = match Regex::new(&from_basic(pattern)) {
            Ok(regex) => regex,
            Err(_) => {
                let text = format!("Modify: cannot read the regular expression \"{pattern}\"");
                return self.report(Severity::Error, at, "modify", text);
            }
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
        self.reporter.say(
            Severity::Info,
            at,
            format!("Modify \"{pattern}\" changes {} attribute states", targets.len() + saved.len()),
        );
        self.modify = Some(ModifyMode { pattern: regex, depth: self.stack.len(), targets, shaders, saved });
    }

    /// Applies a change to the current state and, in modify mode, to the states that are being modified.
    pub(super) fn edit_sets(&mut self, change: impl Fn(&mut AttributeSet)) {
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
        let world = self.world.iter().map(|(current, _)| &current.set);
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
        if let Some((current, _)) = &mut self.world {
            moved.set(current.edit());
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

/// Checks a pattern of `Modify`.
///
/// # Errors
/// Returns a message when it cannot be read.
pub fn check_pattern(pattern: &str) -> Result<(), String> {
    let read = Regex::new(&from_basic(pattern));
    read.map(drop).map_err(|_| format!("cannot read the regular expression \"{pattern}\""))
}

/// Converts a POSIX basic regular expression to the syntax of the `regex` crate.
///
/// In a basic expression `( ) { } + ? |` are ordinary characters and become special after a backslash, `*` is
/// ordinary at the beginning, and `^` and `$` are special at the ends only.
fn from_basic(pattern: &str) -> String {
    let mut out = String::with_capacity(pattern.len() + 8);
    let chars: Vec<char> = pattern.chars().collect();
    let mut start = true;
    let mut i = 0;
    while i < chars.len() {
        let c = chars[i];
        let mut begins = false;
        match c {
            '\\' => {
                i += 1;
                match chars.get(i) {
                    Some(&n @ ('(' | '{' | '}' | ')' | '+' | '?' | '|')) => {
                        begins = matches!(n, '(' | '|');
                        out.push(n);
                    }
                    // A back reference is passed on. The `regex` crate does not support it and reports an error.
                    Some(&n @ '1'..='9') => {
                        out.push('\\');
                        out.push(n);
                    }
                    Some(&n) => {
                        out.push_str(&regex::escape(&n.to_string()));
                    }
                    None => out.push_str("\\\\"),
                }
            }
            '(' | ')' | '{' | '}' | '+' | '?' | '|' => {
                out.push('\\');
                out.push(c);
            }
            '*' if start => out.push_str("\\*"),
            '^' if !start => out.push_str("\\^"),
            '^' => {
                out.push('^');
                begins = true;
            }
            '$' if i + 1 < chars.len()
                && !(chars[i + 1] == '\\' && matches!(chars.get(i + 2), Some(')' | '|'))) =>
            {
                out.push_str("\\$");
            }
            '[' => {
                // The set ends at the closing bracket, which may also be the first character. Backslashes are
                // ordinary inside.
                let mut end = i + 1;
                if chars.get(end) == Some(&'^') {
                    end += 1;
                }
                if chars.get(end) == Some(&']') {
                    end += 1;
                }
                while end < chars.len() && chars[end] != ']' {
                    // Classes such as [:alpha:] contain a bracket.
                    if chars[end] == '[' && chars.get(end + 1) == Some(&':') {
                        end = (end + 2..chars.len()).find(|&k| chars[k] == ']').unwrap_or(chars.len());
                    }
                    end += 1;
                }
                let inside: Vec<char> = chars[i + 1..end.min(chars.len())].to_vec();
                out.push('[');
                for (k, &c) in inside.iter().enumerate() {
                    let class = c == '[' && inside.get(k + 1) == Some(&':');
                    let in_class = c == ']' && k > 0 && inside[k - 1] == ':';
                    if (c == '\\' || c == '&' || c == '~' || c == '[' || c == ']') && !class && !in_class {
                        out.push('\\');
                    }
                    out.push(c);
                }
                out.push(']');
                i = end;
            }
            _ => out.push(c),
        }
        start = begins;
        i += 1;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn back_references_are_refused() {
        assert!(Regex::new(&from_basic("\\(a\\)\\1")).is_err());
    }

    #[test]
    fn basic_regular_expressions_are_converted() {
        let cases = [
            ("obj2", "an obj2 here", true),
            ("^obj2$", "obj21", false),
            ("a+b", "a+b", true),
            ("a+b", "aab", false),
            ("a\\+b", "aab", true),
            ("(x)", "(x)", true),
            ("\\(x\\)", "x", true),
            ("*a", "*a", true),
            ("a*$", "baaa", true),
            ("a\\{2\\}", "aa", true),
            ("a{2}", "aa", false),
            ("[]x]", "]", true),
            ("[^a-c]", "b", false),
            ("[[:digit:]]", "7", true),
            ("a.c", "abc", true),
            ("a\\.c", "abc", false),
            ("a\\|b", "b", true),
            ("", "anything", true),
            ("^*", "*", true),
        ];
        for (pattern, text, matches) in cases {
            let regex = Regex::new(&from_basic(pattern)).unwrap();
            assert_eq!(regex.is_match(text), matches, "{pattern:?} on {text:?}");
        }
    }
}
