//! Modify mode (reference 2.1.4, 2.4): changes reach attribute states that objects already refer to.

use super::State;
use super::current::flips_normals;
use crate::AttributeSet;
use granita_base::{Location, Severity};
use regex::Regex;
use std::collections::BTreeMap;
use std::sync::Arc;

/// The states being changed.
#[derive(Debug)]
pub(super) struct ModifyMode {
    pattern: Regex,
    /// Height of the attribute stack at `Modify`; popping below it ends the mode.
    depth: usize,
    /// Each state found, as it was and as it is to become.
    targets: Vec<(Arc<AttributeSet>, AttributeSet)>,
    /// Names of saved states that are changed.
    saved: Vec<Arc<str>>,
}

impl State {
    /// `Modify`.
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
        self.reporter.say(
            Severity::Info,
            at,
            format!("Modify \"{pattern}\" changes {} attribute states", targets.len() + saved.len()),
        );
        self.modify = Some(ModifyMode { pattern: regex, depth: self.stack.len(), targets, saved });
    }

    /// Applies a change to the current state and, in modify mode, to the states being modified.
    pub(super) fn edit_sets(&mut self, change: impl Fn(&mut AttributeSet)) {
        let Some(mode) = &mut self.modify else {
            return change(self.current.edit());
        };
        if mode.pattern.is_match(&self.current.set.name()) {
            change(self.current.edit());
        }
        mode.targets.iter_mut().for_each(|(_, set)| change(set));
        for name in &mode.saved {
            if let Some(saved) = Arc::make_mut(&mut self.saved).get_mut(name) {
                change(&mut saved.set);
            }
        }
    }

    /// An object declared in modify mode goes on being modified if its name matches (reference 2.4).
    pub(super) fn modify_also(&mut self, set: &Arc<AttributeSet>) {
        let Some(mode) = &mut self.modify else { return };
        let known = mode.targets.iter().any(|(old, _)| Arc::ptr_eq(old, set));
        if !known && mode.pattern.is_match(&set.name()) {
            mode.targets.push((set.clone(), (**set).clone()));
        }
    }

    /// Leaves modify mode if it was entered above this height of the stack.
    pub(super) fn leave_modify_above(&mut self, height: usize) {
        if self.modify.as_ref().is_some_and(|m| m.depth > height) {
            self.leave_modify();
        }
    }

    /// Gives every object its changed state.
    pub(super) fn leave_modify(&mut self) {
        let Some(mode) = self.modify.take() else { return };
        let camera = self.shading_camera();
        let new: BTreeMap<usize, Arc<AttributeSet>> = mode
            .targets
            .iter()
            .filter(|(old, new)| **old != *new)
            .map(|(old, new)| {
                let mut new = new.clone();
                new.flip_normals = flips_normals(&new, camera.as_ref());
                (Arc::as_ptr(old) as usize, Arc::new(new))
            })
            .collect();
        if new.is_empty() {
            return;
        }
        for primitive in &mut self.primitives {
            if let Some(set) = new.get(&(Arc::as_ptr(&primitive.attributes) as usize)) {
                Arc::make_mut(primitive).attributes = set.clone();
            }
        }
        for light in &mut self.lights {
            if let Some(set) = new.get(&(Arc::as_ptr(&light.attributes) as usize)) {
                Arc::make_mut(light).attributes = set.clone();
            }
        }
    }
}

/// A POSIX basic regular expression in the syntax of the `regex` crate.
///
/// In a basic expression `( ) { } + ? |` are ordinary and become special behind a backslash, `*` is ordinary
/// at the beginning, `^` and `$` are special at the ends only.
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
                    // What a group matched before: no automaton can do that, and the message says so.
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
                // Up to the closing bracket, which may stand first; backslashes are ordinary inside.
                let mut end = i + 1;
                if chars.get(end) == Some(&'^') {
                    end += 1;
                }
                if chars.get(end) == Some(&']') {
                    end += 1;
                }
                while end < chars.len() && chars[end] != ']' {
                    // Classes as [:alpha:] contain a bracket of their own.
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
    fn basic_regular_expressions() {
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
