//! Groups of linked layers, and their properties.

use super::analyse::{Analysis, Saves};
use super::connections::{Connection, element_of};
use super::layer::Layer;
use super::relink::Relink;
use crate::ShadeError;
use crate::run::strings::{StringId, Strings};
use granita_gsl::ir::{ConstValue, Global, Module, ShaderKind, SymbolKind, ValueType};
use parking_lot::Mutex;
use std::collections::HashSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Shaders that run one after the other on the same points, ready to run. A group is immutable and shared by all
/// threads.
///
/// Globals are common to all layers. Every layer has its own parameters and variables. All layers run, whether they
/// are connected or not.
#[derive(Debug)]
pub struct Group {
    pub(crate) layers: Vec<Layer>,
    /// The number of floats per register. The first registers are the globals, in the order of [`Global::ALL`].
    pub(crate) slots: Vec<u32>,
    /// By register, true when its values before the first write do not matter.
    pub(crate) scratch: Vec<bool>,
    /// The unique id of the group; never 0.
    pub(crate) id: u64,
    pub(crate) constants: Vec<Arc<[f32]>>,
    pub(crate) strings: Strings,
    /// The globals that the code reads or writes.
    pub(crate) used: [bool; Global::ALL.len()],
    pub(super) keeps: AtomicBool,
    pub(super) usage: ShaderKind,
    pub(super) facts: Vec<Analysis>,
    pub(super) writes: [bool; Global::ALL.len()],
    pub(super) outputs: Vec<Arc<str>>,
    pub(super) said: Mutex<HashSet<String>>,
    /// The data to link it again, for groups with parameters of variable length only.
    pub(super) again: Option<Box<Relink<Self>>>,
}

impl Group {
    /// Checks that every layer may be used as `usage` (reference 5.1.2, table 5.4) and makes that the group's
    /// usage. Generic shaders need it; others may have it.
    ///
    /// # Errors
    /// Returns [`ShadeError::Misuse`] with the shader and what it does.
    pub fn attach(&mut self, usage: ShaderKind) -> Result<(), ShadeError> {
        if self.usage != ShaderKind::Generic && self.usage != usage {
            return Err(ShadeError::Misuse {
                what: format!("a {} shader cannot be used as {}", self.usage.word(), usage.word()),
            });
        }
        for (layer, facts) in self.layers.iter().zip(&self.facts) {
            if layer.module.kind == ShaderKind::Generic {
                check_usage(&layer.module, facts, usage)?;
            }
        }
        self.usage = usage;
        Ok(())
    }

    /// Returns the usage of the group: the type of its shaders, or the usage set by [`Group::attach`].
    pub fn usage(&self) -> ShaderKind {
        self.usage
    }

    /// True when some layer reads neighbouring points.
    pub fn needs_derivatives(&self) -> bool {
        self.layers.iter().any(|l| l.module.needs_derivatives) || self.facts.iter().any(|f| f.derivatives)
    }

    /// True when some layer reads a grid as a whole (`gridmax`, `randomgrid`, shadeops) or reports something once
    /// for it. Grids must not be [batched](crate::Grid::batched) for it.
    pub fn is_gridwise(&self) -> bool {
        self.facts.iter().any(|f| f.gridwise)
    }

    /// True when a run may save data for later ones, by `spatialdbsave` or by options of `indirect` and
    /// `occlusion`. Attributes are not considered here.
    pub fn may_save(&self) -> bool {
        self.layers.iter().zip(&self.facts).any(|(layer, facts)| {
            facts.saves.iter().any(|saves| match saves {
                Saves::Any => true,
                Saves::Param(k) => !self.is_empty_text(layer, *k as usize),
            })
        })
    }

    /// True when a string parameter is known to be empty.
    fn is_empty_text(&self, layer: &Layer, k: usize) -> bool {
        let Some(plan) = layer.params.get(k).filter(|plan| plan.connections.is_empty()) else { return false };
        match (&plan.given, &layer.module.params[k].default) {
            (Some(given), _) => given.iter().all(|held| self.given_text(*held).is_empty()),
            (None, granita_gsl::ir::DefaultValue::Known { value: ConstValue::Strings(list), .. }) => {
                list.iter().all(|s| s.is_empty())
            }
            _ => false,
        }
    }

    /// Returns the text of a string that an instance sets.
    pub(super) fn given_text(&self, held: f32) -> Arc<str> {
        self.strings.text(StringId::from_register(held)).cloned().unwrap_or_default()
    }

    /// True when code that opacity does not depend on may be left out: no other shader may read its messages, and it
    /// saves nothing.
    pub(crate) fn may_run_opacity(&self) -> bool {
        !self.keeps() && !self.listens_to(self.usage) && !self.may_save()
    }

    /// True when some layer or connection writes a global.
    pub fn writes(&self, global: Global) -> bool {
        self.writes[global as usize]
    }

    /// True when some layer writes a value other than 1 to `opacity`. If not, the object is at least as opaque as
    /// its attribute.
    pub fn sets_opacity(&self) -> bool {
        let to_opacity = |connection: &Connection| connection.target.slot == Global::opacity as u32;
        self.facts.iter().any(|f| f.clears) || self.layers.iter().any(|l| l.globals.iter().any(to_opacity))
    }

    /// True when some layer has an `emit` statement. A light without one is ambient.
    pub fn has_emit(&self) -> bool {
        self.facts.iter().any(|f| f.emits)
    }

    /// True when some layer reads the lights.
    pub fn gathers_light(&self) -> bool {
        self.facts.iter().any(|f| f.gathers)
    }

    /// Returns the names of the output parameters of all layers, each once, in order of declaration.
    pub fn output_names(&self) -> &[Arc<str>] {
        &self.outputs
    }

    /// Returns the type of the output parameter `name` of the last layer that has one; `None` without it, or for an
    /// array.
    pub fn output_type(&self, name: &str) -> Option<ValueType> {
        self.layers.iter().rev().find_map(|layer| {
            let k = layer.params.iter().position(|p| *p.name == *name)?;
            let place = &layer.places[layer.params[k].symbol.0 as usize];
            (layer.module.params[k].output && !place.array).then_some(place.value)
        })
    }

    /// Returns the value of a string parameter as far as it is known without running: set by the instance, or a
    /// constant default. Among several layers the last counts.
    pub fn param_string(&self, name: &str) -> Option<Arc<str>> {
        self.layers.iter().rev().find_map(|layer| {
            let k = layer.params.iter().position(|p| *p.name == *name)?;
            let plan = &layer.params[k];
            if layer.places[plan.symbol.0 as usize].value != ValueType::String {
                return None;
            }
            if let Some(given) = &plan.given {
                return Some(self.given_text(given[0]));
            }
            match &layer.module.params[k].default {
                granita_gsl::ir::DefaultValue::Known { value: ConstValue::Strings(list), .. } => {
                    list.first().cloned()
                }
                _ => None,
            }
        })
    }

    /// True when some `getmessage` may query the object's shader of this usage.
    pub fn listens_to(&self, usage: ShaderKind) -> bool {
        self.facts.iter().any(|f| f.listens.contains(&usage))
    }

    /// True when some `getmessage` may query the shader that spawned the ray that sees the point. It finds the
    /// values in [`Grid::parent`](crate::Grid::parent).
    pub fn queries_parent(&self) -> bool {
        self.facts.iter().any(|f| f.queries_parent)
    }

    /// Keeps all parameters on the grid after a run, for a later shader of the object that
    /// [listens](Group::listens_to).
    pub fn keep_parameters(&self) {
        self.keeps.store(true, Ordering::Relaxed);
    }

    /// True when parameters stay on the grid after a run.
    pub(crate) fn keeps(&self) -> bool {
        self.keeps.load(Ordering::Relaxed)
    }

    /// True when some `getmessage` may query the light that a `lights` loop examines.
    pub fn asks_light(&self) -> bool {
        self.facts.iter().any(|f| f.asks_light)
    }

    /// True when some `getmessage` may query a variable of the primitive.
    pub fn asks_primitive(&self) -> bool {
        self.facts.iter().any(|f| f.asks_primitive)
    }

    /// Finds the layers that need not run, because they only compute parameters that are not used. It proceeds from
    /// the last layer to the first, so that each is examined once, however many connections lead to the layers that
    /// it feeds.
    pub(crate) fn find_idle(&self, wanted: &[(&str, ValueType)], idle: &mut Vec<bool>) {
        idle.clear();
        idle.resize(self.layers.len(), false);
        // Other layers or other shaders may query any parameter by name.
        if self.keeps() || self.listens_to(self.usage) {
            return;
        }
        for (layer, l) in self.layers.iter().enumerate().rev() {
            idle[layer] = l.inert
                && !l.params.iter().zip(&l.module.params).any(|(p, decl)| {
                    // A symbol of this name may be requested.
                    decl.output && wanted.iter().any(|(name, _)| element_of(name).0 == &*p.name)
                })
                && l.kept.is_empty()
                && l.feeds.iter().all(|&target| idle[target]);
        }
    }

    /// Returns the indices of the layers that a run with these requested results skips.
    pub fn idle_layers(&self, wanted: &[(&str, ValueType)]) -> Vec<usize> {
        let mut idle = Vec::new();
        self.find_idle(wanted, &mut idle);
        (0..self.layers.len()).filter(|&k| idle[k]).collect()
    }

    /// Returns the number of operations in the code of all layers, each counted once however often it runs.
    pub fn operations(&self) -> usize {
        self.layers
            .iter()
            .map(|l| {
                super::optimize::operations(l.better.as_ref().map_or(&l.plain, |b| &b.code).body.as_ref())
            })
            .sum()
    }

    /// True for the first call with this cause, for messages that are reported once.
    pub(crate) fn first_time(&self, cause: String) -> bool {
        self.said.lock().insert(cause)
    }

    /// Computes the properties of the group from those of its layers.
    pub(super) fn summarise(&mut self) {
        for (layer, facts) in self.layers.iter().zip(&self.facts) {
            for g in Global::ALL {
                let written = facts.writes[g as usize] || layer.module.writes.contains(&g);
                self.writes[g as usize] |= written;
                self.used[g as usize] |= written || layer.module.reads.contains(&g);
            }
            for symbol in &layer.module.symbols {
                if let SymbolKind::Global(g) = symbol.kind {
                    self.used[g as usize] = true;
                }
            }
            for decl in layer.module.params.iter().filter(|p| p.output) {
                let name = &layer.module.symbol(decl.symbol).name;
                if !self.outputs.contains(name) {
                    self.outputs.push(name.clone());
                }
            }
        }
        // Functions and statements of light use some globals implicitly.
        for facts in &self.facts {
            for g in Global::ALL {
                self.used[g as usize] |= facts.implied[g as usize];
            }
        }
    }
}

/// Checks that a generic shader follows the rules of a usage.
fn check_usage(module: &Module, facts: &Analysis, usage: ShaderKind) -> Result<(), ShadeError> {
    let refuse = |does: &str| {
        Err(ShadeError::Misuse {
            what: format!("shader \"{}\" {does}, which a {} shader may not", module.name, usage.word()),
        })
    };
    let allowed: &[Global] = match usage {
        ShaderKind::Surface => &[Global::N, Global::C, Global::opacity],
        ShaderKind::Displacement => &[Global::P, Global::N],
        ShaderKind::Volume => &[Global::C, Global::opacity],
        ShaderKind::Light => &[Global::L, Global::Cl],
        ShaderKind::Generic => &Global::ALL,
    };
    for g in Global::ALL {
        let written = facts.writes[g as usize] || module.writes.contains(&g);
        // `emit` sets L and Cl itself. It is refused below by its own name.
        let implied = facts.emits && matches!(g, Global::L | Global::Cl);
        if written && !implied && !allowed.contains(&g) {
            return refuse(&format!("writes {}", g.word()));
        }
    }
    match usage {
        ShaderKind::Displacement if module.reads.contains(&Global::I) => refuse("reads I"),
        ShaderKind::Surface | ShaderKind::Volume if facts.emits => refuse("emits light"),
        ShaderKind::Displacement if facts.emits => refuse("emits light"),
        ShaderKind::Displacement | ShaderKind::Light if facts.gathers => refuse("gathers light"),
        _ => Ok(()),
    }
}
