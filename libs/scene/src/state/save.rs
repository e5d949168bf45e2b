//! `SaveAttributes` and `RestoreAttributes` (reference 2.4).

use super::State;
use super::current::Edit;
use super::transforms::hint;
use crate::AttributeSet;
use crate::attribute::{Scope, attribute_row};
use granita_base::{Location, MotionTransform, Severity, suggestion};
use std::sync::Arc;

/// A named state, or a part of one.
#[derive(Clone, Debug)]
pub(super) struct Saved {
    pub(super) set: AttributeSet,
    /// The parts that were requested to be saved; `None` is everything.
    items: Option<Vec<Arc<str>>>,
}

impl Saved {
    /// Returns the saved transformation, if it was saved.
    pub(super) fn transform(&self) -> Option<&MotionTransform> {
        self.holds("transform").then_some(&self.set.to_world)
    }

    /// Copies everything that was saved into `target`.
    pub(super) fn apply(&self, target: &mut AttributeSet) {
        match &self.items {
            None => *target = self.set.clone(),
            Some(items) => items.iter().for_each(|item| copy_item(target, self, item)),
        }
    }

    fn holds(&self, item: &str) -> bool {
        let usage = matches!(item, "surface" | "displacement" | "volume");
        self.items.as_ref().is_none_or(|items| {
            items.iter().any(|i| {
                &**i == item || (usage && &**i == "shaders") || (item == "user" && i.starts_with("user:"))
            })
        })
    }
}

/// The names of parts of the state that are not attributes of the table.
const PARTS: [&str; 8] =
    ["transform", "shaders", "surface", "displacement", "volume", "lights", "trimcurve", "user"];

impl State {
    /// Handles `SaveAttributes`.
    pub(super) fn save(&mut self, name: Arc<str>, items: Option<&str>, at: &Location) {
        let items = items.map(|list| self.items(list, "SaveAttributes", at));
        Arc::make_mut(&mut self.saved).insert(name, Saved { set: self.current.set.clone(), items });
    }

    /// Handles `RestoreAttributes`.
    pub(super) fn restore(&mut self, name: &str, items: Option<&str>, at: &Location) {
        let Some(saved) = self.saved.get(name).cloned() else {
            let hint = hint(suggestion(name, self.saved.keys().map(|k| &**k)));
            let text = format!("RestoreAttributes: nothing was saved as \"{name}\"{hint}");
            return self.report(Severity::Error, at, "restore", text);
        };
        let asked = items.map(|list| self.items(list, "RestoreAttributes", at));
        let items: Vec<Arc<str>> = match (asked, &saved.items) {
            (None, None) => {
                let set = saved.set;
                return self.edit_sets(Edit::Call("RestoreAttributes", at), |target| *target = set.clone());
            }
            (None, Some(all)) => all.clone(),
            (Some(asked), _) => asked,
        };
        for item in &items {
            let held = match &**item {
                "shaders" => ["surface", "displacement", "volume"].iter().any(|u| saved.holds(u)),
                user if user.starts_with("user:") => saved.holds("user") || saved.holds(user),
                other => saved.holds(other),
            };
            if !held {
                let text = format!("RestoreAttributes: \"{item}\" was not saved as part of \"{name}\"");
                self.report(Severity::Error, at, "restore item", text);
            }
        }
        self.edit_sets(Edit::Call("RestoreAttributes", at), |target| {
            for item in &items {
                copy_item(target, &saved, item);
            }
        });
    }

    /// Parses a comma-separated list of attributes and parts. Unknown ones are reported and left out.
    fn items(&self, list: &str, call: &str, at: &Location) -> Vec<Arc<str>> {
        let mut items = Vec::new();
        for item in list.split(',').map(str::trim).filter(|i| !i.is_empty()) {
            let row = attribute_row(item).filter(|r| r.scope == Scope::Object);
            if let Some(row) = row {
                items.push(Arc::from(row.name));
            } else if PARTS.contains(&item) || item.starts_with("user:") {
                items.push(Arc::from(item));
            } else {
                let known = super::attributes::attribute_names(&[Scope::Object]).chain(PARTS);
                let text =
                    format!("{call}: no attribute of objects \"{item}\"{}", hint(suggestion(item, known)));
                self.report(Severity::Warning, at, "save item", text);
            }
        }
        items
    }
}

/// Replaces one part of `target` by that of `saved`, if it was saved.
fn copy_item(target: &mut AttributeSet, saved: &Saved, item: &str) {
    let from = &saved.set;
    let holds = |what: &str| saved.holds(what);
    match item {
        "transform" if holds(item) => target.to_world = from.to_world.clone(),
        "surface" if holds(item) => target.surface = from.surface.clone(),
        "displacement" if holds(item) => target.displacement = from.displacement.clone(),
        "volume" if holds(item) => target.volume = from.volume.clone(),
        "shaders" => ["surface", "displacement", "volume"].iter().for_each(|u| copy_item(target, saved, u)),
        "lights" if holds(item) => target.lights = from.lights.clone(),
        "trimcurve" if holds(item) => target.trim = from.trim.clone(),
        "user" => {
            let values = Arc::make_mut(&mut target.values);
            values.retain(|k| !k.starts_with("user:"));
            let users = from.values.iter().filter(|(k, _)| k.starts_with("user:"));
            let all = saved.items.as_ref().is_none_or(|i| i.iter().any(|i| &**i == "user"));
            values.extend(users.filter(|(k, _)| all || holds(k)).map(|(k, v)| (k.clone(), v.clone())));
        }
        "geometryset" if holds(item) => {
            target.geometry_sets = from.geometry_sets.clone();
            copy_value(target, from, item);
        }
        name if holds(name) || (name.starts_with("user:") && holds("user")) => copy_value(target, from, name),
        _ => {}
    }
}

fn copy_value(target: &mut AttributeSet, from: &AttributeSet, name: &str) {
    let values = Arc::make_mut(&mut target.values);
    match from.values.get_key_value(name) {
        Some((key, value)) => {
            values.insert(key.clone(), value.clone());
        }
        None => {
            values.remove(name);
        }
    }
}
