//! Undo and redo.

use super::rig::Rig;

/// The largest number of steps.
const STEPS: usize = 1000;

/// A step: its name, and the lights on the other side of it.
#[derive(Clone, Debug)]
struct Step {
    label: String,
    rig: Rig,
}

/// The steps that can be undone and done again.
#[derive(Debug, Default)]
pub(crate) struct History {
    undo: Vec<Step>,
    redo: Vec<Step>,
    /// True while edits belong to one step; the second value is true when that step exists.
    open: Option<bool>,
}

impl History {
    /// Makes the edits until [`History::end_step`] one step.
    pub(crate) fn begin_step(&mut self) {
        self.open = Some(false);
    }

    /// Ends a step of several edits.
    pub(crate) fn end_step(&mut self) {
        self.open = None;
    }

    /// Adds an edit of the lights `before`. Returns true when it begins a step.
    pub(crate) fn add(&mut self, label: &str, before: &Rig) -> bool {
        self.redo.clear();
        if self.open == Some(true) {
            return false;
        }
        self.open = self.open.map(|_| true);
        if self.undo.len() == STEPS {
            self.undo.remove(0);
        }
        self.undo.push(Step { label: label.to_owned(), rig: before.clone() });
        true
    }

    /// Returns the lights before the last step of the lights `now`.
    pub(crate) fn undo(&mut self, now: &Rig) -> Option<Rig> {
        self.open = None;
        let step = self.undo.pop()?;
        self.redo.push(Step { label: step.label, rig: now.clone() });
        Some(step.rig)
    }

    /// Returns the lights after the step that was last undone.
    pub(crate) fn redo(&mut self, now: &Rig) -> Option<Rig> {
        self.open = None;
        let step = self.redo.pop()?;
        self.undo.push(Step { label: step.label, rig: now.clone() });
        Some(step.rig)
    }

    /// Returns the name of the step that would be undone.
    pub(crate) fn undo_label(&self) -> Option<&str> {
        self.undo.last().map(|step| &*step.label)
    }

    /// Returns the name of the step that would be done again.
    pub(crate) fn redo_label(&self) -> Option<&str> {
        self.redo.last().map(|step| &*step.label)
    }
}
