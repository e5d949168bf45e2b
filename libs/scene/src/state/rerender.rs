//! The rules of re-rendering (reference 2.11 and 11.1): what later frames of a scene may change.
//!
//! The attributes that may change have the mark `Rerender` in the attribute table. A change that is not allowed has no
//! effect. It is reported once per frame, as a warning that names the rule. Values that are written again as they were
//! are no change. What a call leaves out keeps its value, except the attributes that may change: they have their
//! defaults again, because the call replaces the camera or the output.

use super::State;
use super::transforms::hint;
use crate::attribute::{AttributeRow, Scope, TABLE, attr};
use crate::{Camera, Output};
use granita_base::{Location, MotionTransform, Param, ParamData, Severity, Transform, suggestion};
use std::collections::BTreeSet;
use std::sync::Arc;

/// The largest difference of two numbers that count as the same, relative to the larger one. It covers numbers that
/// were written as text with six digits.
const SAME: f32 = 1e-5;
/// The largest difference of two positions that count as the same, relative to a unit of camera space.
const SAME_PLACE: f32 = 1e-6;

/// The data of re-rendering.
#[derive(Debug, Default)]
pub(super) struct Rerender {
    /// The number of frames that were rendered in re-rendering mode.
    pub(super) frames: usize,
    /// The lights that were not added to the current frame because of errors, which are reported.
    pub(super) refused_lights: BTreeSet<Arc<str>>,
}

impl State {
    /// True after the first `Render` in re-rendering mode.
    pub(super) fn in_rerender(&self) -> bool {
        self.rerender.frames > 0
    }

    /// Reports a change that the rules of re-rendering do not allow.
    pub(super) fn refuse(&self, at: &Location, text: impl Into<String>) {
        self.report(Severity::Warning, at, "rerender", text);
    }

    /// Reports a call that would add or change objects, and returns true, after the first frame. `what` begins the
    /// rule, as in "geometry cannot be added".
    pub(super) fn refuses(&self, call: &str, what: &str, at: &Location) -> bool {
        if self.in_rerender() {
            self.refuse(at, format!("{call}: {what} in a re-render; the call is ignored"));
        }
        self.in_rerender()
    }

    /// True when a scene-wide attribute may have this value: in the first frame, when it may change, or when it is the
    /// current value. Reports the others.
    pub(super) fn may_be_global(&self, row: &AttributeRow, value: &Param, at: &Location) -> bool {
        let old = crate::attribute::lookup(self.globals.get(row.name), row.name);
        if !self.in_rerender() || row.rerender || old.is_some_and(|old| is_same(&old.data, &value.data)) {
            return true;
        }
        let text = format!(
            "attribute \"{}\" cannot change in a re-render (only memory limits, search paths and statistics may); the value stays",
            row.name
        );
        self.refuse(at, text);
        false
    }

    /// Sets an attribute of the cameras that follow. The camera of a scene without `Camera` gets it at once.
    pub(super) fn rerender_camera_attribute(&mut self, row: &AttributeRow, value: Param, at: &Location) {
        if row.rerender {
            if self.implicit_camera {
                self.cameras.iter_mut().for_each(|camera| camera.params.set(value.clone()));
            }
            self.camera_values.insert(value.name.clone(), value);
            return;
        }
        let next = crate::attribute::lookup(self.camera_values.get(row.name), row.name);
        let mut known = self.cameras.iter().filter_map(|camera| value_of(camera, row)).chain(next);
        if !known.any(|old| is_same(&old.data, &value.data)) {
            let text = format!(
                "attribute \"{}\" cannot change in a re-render (of cameras only {} may); the value stays",
                row.name,
                changeable(Scope::Camera)
            );
            self.refuse(at, text);
        }
    }

    /// Handles `Camera` after the first frame, which replaces a camera. `given` has the parameters of the call by
    /// their rows, without a value when they are in error.
    pub(super) fn rerender_camera(
        &mut self,
        name: &Arc<str>,
        given: &[(&'static AttributeRow, Option<Param>)],
        at: &Location,
    ) {
        let Some(index) = self.cameras.iter().position(|camera| camera.name == *name) else {
            let hint = hint(suggestion(name, self.cameras.iter().map(|camera| &*camera.name)));
            let text = format!(
                "Camera \"{name}\": a camera cannot be added in a re-render; the call is ignored{hint}"
            );
            return self.refuse(at, text);
        };
        let old = &self.cameras[index];
        if !is_same_place(&old.world_to_camera.inverse(), &self.current.set.to_world) {
            let text =
                format!("Camera \"{name}\": a camera cannot move in a re-render; it stays where it was");
            self.refuse(at, text);
        }
        let mut params = old.params.clone();
        for row in rows(Scope::Camera).filter(|row| row.rerender) {
            match given.iter().find(|(other, _)| other.name == row.name) {
                Some((_, Some(value))) => params.set(value.clone()),
                Some((_, None)) => {}
                None => {
                    let usual = self.camera_values.get(row.name).cloned().or_else(|| row.default_param());
                    usual.into_iter().for_each(|value| params.set(value));
                }
            }
        }
        for (row, value) in given.iter().filter(|(row, _)| !row.rerender) {
            let Some(value) = value else { continue };
            if value_of(old, row).is_none_or(|old| !is_same(&old.data, &value.data)) {
                let text = format!(
                    "Camera \"{name}\": \"{}\" cannot change in a re-render (only {} may); the old value stays",
                    row.name,
                    changeable(Scope::Camera)
                );
                self.refuse(at, text);
            }
        }
        self.cameras[index].params = params;
    }

    /// Handles `Output` with the name of an output that exists, after the first frame. `wrong` has the names of
    /// parameters in error, which are not in the output.
    pub(super) fn rerender_output(&mut self, new: &Output, wrong: &[Arc<str>], at: &Location) {
        let Some(index) = self.outputs.iter().position(|output| output.is_replaced_by(new)) else { return };
        let old = &self.outputs[index];
        let of_first = |camera: &Arc<str>| match self.cameras.first() {
            Some(first) if camera.is_empty() => first.name.clone(),
            _ => camera.clone(),
        };
        let words = [
            ("format", new.format == old.format, &old.format),
            ("data", new.data == old.data, &old.data),
            ("camera", of_first(&new.camera) == of_first(&old.camera), &old.camera),
        ];
        let mut refused: Vec<String> = Vec::new();
        for (what, is_same, word) in words {
            if !is_same {
                refused.push(format!("the {what} cannot change in a re-render; \"{word}\" stays"));
            }
        }
        let mut params = old.params.clone();
        for row in rows(Scope::Output).filter(|row| row.rerender) {
            if !wrong.iter().any(|name| **name == *row.name) {
                params.0.retain(|param| *param.name != *row.name);
            }
        }
        for value in &new.params {
            let row = crate::attribute_row(&value.name).filter(|row| row.scope == Scope::Output);
            if row.is_some_and(|row| row.rerender) {
                params.set(value.clone());
                continue;
            }
            let usual = || row.and_then(AttributeRow::default_param);
            let before = old.params.get(&value.name).cloned().or_else(usual);
            if before.is_none_or(|before| !is_same(&before.data, &value.data)) {
                refused.push(format!(
                    "\"{}\" cannot change in a re-render (only {} may); the old value stays",
                    value.name,
                    changeable(Scope::Output)
                ));
            }
        }
        refused.iter().for_each(|text| self.refuse(at, format!("Output \"{}\": {text}", new.name)));
        self.outputs[index].params = params;
    }
}

/// Returns the rows of a scope.
fn rows(scope: Scope) -> impl Iterator<Item = &'static AttributeRow> {
    TABLE.iter().filter(move |row| row.scope == scope)
}

/// Returns the names of the attributes of a scope that may change, for messages.
fn changeable(scope: Scope) -> String {
    let names: Vec<String> =
        rows(scope).filter(|row| row.rerender).map(|row| format!("\"{}\"", row.name)).collect();
    match names.split_last() {
        Some((last, others)) if !others.is_empty() => format!("{} and {last}", others.join(", ")),
        _ => names.concat(),
    }
}

/// Returns the value of an attribute of a camera, also of a "screen" that follows from the resolution.
fn value_of(camera: &Camera, row: &AttributeRow) -> Option<Param> {
    let screen =
        || (row.name == attr::SCREEN.name()).then(|| attr::SCREEN.param(Some(camera.screen_window())));
    camera.params.get(row.name).cloned().or_else(screen)
}

/// True when two values are the same, except for rounding.
fn is_same(a: &ParamData, b: &ParamData) -> bool {
    match (a, b) {
        (ParamData::Float(a), ParamData::Float(b)) => {
            let near = |(a, b): (&f32, &f32)| a == b || (a - b).abs() <= SAME * a.abs().max(b.abs());
            a.len() == b.len() && a.iter().zip(b.iter()).all(near)
        }
        _ => a == b,
    }
}

/// True when two transformations from camera space to world are the same, except for rounding.
fn is_same_place(a: &MotionTransform, b: &MotionTransform) -> bool {
    let near = |a: &Transform, b: &Transform| {
        let (a, b) = (a.to_rows(), b.to_rows());
        let largest = |range: std::ops::Range<usize>| {
            range.fold(0.0f32, |most, i| most.max(a[i].abs()).max(b[i].abs()))
        };
        let (axes, origin) = (largest(0..12), largest(12..15));
        (0..16).all(|i| {
            let most = if i < 12 { SAME * axes } else { SAME * origin + SAME_PLACE * axes };
            (a[i] - b[i]).abs() <= most
        })
    };
    let (a, b) = (a.keys(), b.keys());
    // The time of a single key has no effect.
    let is_still = a.len() == 1;
    a.len() == b.len() && a.iter().zip(b).all(|((s, a), (t, b))| (is_still || s == t) && near(a, b))
}
