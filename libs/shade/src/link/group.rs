//! Layers of shaders, linked.

use super::analyse::{Facts, Saves, analyse};
use super::given::given;
use super::layer::{BetterCode, Code, Layer, ParamPlan};
use super::optimize::{Known, is_inert, optimize};
use super::relink::Relink;
use super::source::{ConnectionSource, LayerSource, LinkOptions};
use super::wires::{End, Named, Tap, Wire, compatible, element_of, refuse, resolve};
use crate::program::{At, Place};
use crate::run::strings::Strings;
use crate::tape::fuse;
use crate::{Grid, ShadeError};
use granita_base::Severity;
use granita_gsl::ir::{Block, ConstValue, Global, Module, ShaderKind, SymbolKind, ValueType};
use std::collections::{BTreeMap, HashSet};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// More numbers than this per point are no shader but an attack on memory.
const MAX_NUMBERS: usize = 1 << 20;

/// The next group's number.
static NEXT_ID: AtomicU64 = AtomicU64::new(1);

/// What linking a layer takes from the group.
struct Linking<'a> {
    wires: &'a [Resolved],
    options: LinkOptions,
    /// Lengths of variable-length parameters, by layer and number.
    fixed: &'a BTreeMap<(usize, usize), u32>,
}

/// Shaders that run one after the other on the same points, ready to run. Immutable and shared by all
/// threads.
///
/// Globals are common to all layers; every layer has its own parameters and variables. All layers run,
/// whether anything is connected to them or not.
#[derive(Debug)]
pub struct Group {
    pub(crate) layers: Vec<Layer>,
    /// Floats per register; the first are the globals, in the order of [`Global::ALL`].
    pub(crate) slots: Vec<u32>,
    /// By register: its values before the first write do not matter.
    pub(crate) scratch: Vec<bool>,
    /// Tells groups apart; never 0.
    pub(crate) id: u64,
    pub(crate) constants: Vec<Arc<[f32]>>,
    pub(crate) strings: Strings,
    /// Globals that the code reads or writes.
    pub(crate) used: [bool; Global::ALL.len()],
    keeps: AtomicBool,
    usage: ShaderKind,
    facts: Vec<Facts>,
    writes: [bool; Global::ALL.len()],
    outputs: Vec<Arc<str>>,
    said: Mutex<HashSet<String>>,
    /// How to link it again; where it has parameters of variable length only.
    again: Option<Box<Relink<Self>>>,
}

impl Group {
    /// Links layers, the first of which runs first.
    ///
    /// What does not fit (unknown parameters, connections that cannot be made) goes to `report`, and the
    /// rest is linked without it.
    ///
    /// Errors: no layer, or layers of different types ([`ShadeError::Misuse`]); a module that does not
    /// hold together ([`ShadeError::Malformed`]); absurd array sizes ([`ShadeError::Limit`]).
    pub fn link(
        layers: &[LayerSource<'_>],
        connections: &[ConnectionSource<'_>],
        report: &mut dyn FnMut(Severity, String),
    ) -> Result<Self, ShadeError> {
        Self::link_with(layers, connections, LinkOptions::default(), report)
    }

    /// As [`Group::link`], with options.
    ///
    /// Errors: as there.
    pub fn link_with(
        layers: &[LayerSource<'_>],
        connections: &[ConnectionSource<'_>],
        options: LinkOptions,
        report: &mut dyn FnMut(Severity, String),
    ) -> Result<Self, ShadeError> {
        let mut group = Self::link_lengths(layers, connections, options, &BTreeMap::new(), report)?;
        group.again = Relink::of(&group.layers, layers, connections, options).map(Box::new);
        Ok(group)
    }

    /// As [`Group::link_with`]; `fixed` are lengths of variable-length parameters, by layer and number.
    fn link_lengths(
        layers: &[LayerSource<'_>],
        connections: &[ConnectionSource<'_>],
        options: LinkOptions,
        fixed: &BTreeMap<(usize, usize), u32>,
        report: &mut dyn FnMut(Severity, String),
    ) -> Result<Self, ShadeError> {
        let usage = common_kind(layers)?;
        let facts = layers.iter().map(|l| analyse(&l.module)).collect::<Result<Vec<_>, _>>()?;
        let mut group = Self {
            layers: Vec::new(),
            slots: Global::ALL.iter().map(|g| g.value_type().components() as u32).collect(),
            scratch: Vec::new(),
            id: NEXT_ID.fetch_add(1, Ordering::Relaxed),
            constants: Vec::new(),
            strings: Strings::default(),
            used: [false; Global::ALL.len()],
            keeps: AtomicBool::new(false),
            usage,
            facts,
            writes: [false; Global::ALL.len()],
            outputs: Vec::new(),
            said: Mutex::default(),
            again: None,
        };
        let wires = resolve_all(layers, connections, report);
        for (k, source) in layers.iter().enumerate() {
            group.add_layer(k, source, &Linking { wires: &wires, options, fixed }, report)?;
        }
        for wire in &wires {
            group.add_wire(wire);
        }
        group.scratch = vec![false; group.slots.len()];
        for place in group.layers.iter().flat_map(|l| &l.places) {
            if let At::Slot(slot) = place.at {
                group.scratch[slot as usize] = place.scratch;
            }
        }
        let numbers: usize = group.slots.iter().map(|&s| s as usize).sum();
        if numbers > MAX_NUMBERS {
            return Err(ShadeError::Limit { what: "numbers per point", asked: numbers, max: MAX_NUMBERS });
        }
        group.summarise();
        Ok(group)
    }

    /// Checks that every layer may be used as `usage` (reference 5.1.2, table 5.4) and makes that the
    /// group's usage. Needed for generic shaders, harmless for others.
    ///
    /// Errors: [`ShadeError::Misuse`] naming the shader and what it does.
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

    /// The group with its variable-length parameters as long as the primitive variables of a grid that replace
    /// them (reference 5.3.2); `None` when they are already.
    pub(crate) fn for_grid(&self, grid: &Grid) -> Option<Arc<Self>> {
        let relink = self.again.as_ref()?;
        relink.variant(grid, |layers, connections, lengths| {
            // What is wrong was said when the group was linked first.
            let mut group =
                Self::link_lengths(layers, connections, relink.options, lengths, &mut |_, _| {}).ok()?;
            group.attach(self.usage).ok()?;
            if self.keeps() {
                group.keep_parameters();
            }
            Some(group)
        })
    }

    /// What the group is used as: the type of its shaders, or what [`Group::attach`] made it.
    pub fn usage(&self) -> ShaderKind {
        self.usage
    }

    /// Whether some layer looks at neighbouring points.
    pub fn needs_derivatives(&self) -> bool {
        self.layers.iter().any(|l| l.module.needs_derivatives) || self.facts.iter().any(|f| f.derivatives)
    }

    /// Whether some layer sees a grid as a whole (`gridmax`, `randomgrid`, shadeops) or says something once for it: grids must
    /// not be [joined](Grid::joined) for it.
    pub fn is_gridwise(&self) -> bool {
        self.facts.iter().any(|f| f.gridwise)
    }

    /// Whether a run may save something for later ones: by `spatialdbsave`, or what `indirect` and `occlusion` found, where options
    /// say so. (What attributes say is not known here.)
    pub fn may_save(&self) -> bool {
        self.layers.iter().zip(&self.facts).any(|(layer, facts)| {
            facts.saves.iter().any(|saves| match saves {
                Saves::Any => true,
                Saves::Param(k) => !self.is_empty_text(layer, *k as usize),
            })
        })
    }

    /// Whether a string parameter is known to be empty.
    fn is_empty_text(&self, layer: &Layer, k: usize) -> bool {
        let Some(plan) = layer.params.get(k).filter(|plan| plan.wires.is_empty()) else { return false };
        match (&plan.given, &layer.module.params[k].default) {
            (Some(given), _) => given.iter().all(|id| self.strings.text(*id).is_some_and(|s| s.is_empty())),
            (None, granita_gsl::ir::DefaultValue::Known { value: ConstValue::Strings(list), .. }) => {
                list.iter().all(|s| s.is_empty())
            }
            _ => false,
        }
    }

    /// Whether some layer or connection writes a global.
    pub fn writes(&self, global: Global) -> bool {
        self.writes[global as usize]
    }

    /// Whether some layer writes anything but 1 to `opacity`: if not, the object is at least as opaque as its attribute
    /// says.
    pub fn sets_opacity(&self) -> bool {
        let to_opacity = |wire: &Wire| wire.target.slot == Global::opacity as u32;
        self.facts.iter().any(|f| f.clears) || self.layers.iter().any(|l| l.globals.iter().any(to_opacity))
    }

    /// Whether some layer has an `emit` statement; a light without is ambient.
    pub fn has_emit(&self) -> bool {
        self.facts.iter().any(|f| f.emits)
    }

    /// Whether some layer looks at the lights.
    pub fn gathers_light(&self) -> bool {
        self.facts.iter().any(|f| f.gathers)
    }

    /// Names of the output parameters of all layers, each once, in order of declaration.
    pub fn output_names(&self) -> &[Arc<str>] {
        &self.outputs
    }

    /// Type of the output parameter `name` of the last layer that has one; `None` without it, or of an array.
    pub fn output_type(&self, name: &str) -> Option<ValueType> {
        self.layers.iter().rev().find_map(|layer| {
            let k = layer.params.iter().position(|p| *p.name == *name)?;
            let place = &layer.places[layer.params[k].symbol.0 as usize];
            (layer.module.params[k].output && !place.array).then_some(place.value)
        })
    }

    /// Value of a string parameter as far as it can be told without running: given with the instance, or
    /// a constant default. Of several layers the last counts.
    pub fn param_string(&self, name: &str) -> Option<Arc<str>> {
        self.layers.iter().rev().find_map(|layer| {
            let k = layer.params.iter().position(|p| *p.name == *name)?;
            let plan = &layer.params[k];
            if layer.places[plan.symbol.0 as usize].value != ValueType::String {
                return None;
            }
            if let Some(given) = &plan.given {
                return self.strings.text(given[0]).cloned();
            }
            match &layer.module.params[k].default {
                granita_gsl::ir::DefaultValue::Known { value: ConstValue::Strings(list), .. } => {
                    list.first().cloned()
                }
                _ => None,
            }
        })
    }

    /// True when some `getmessage` may ask the object's shader of this usage.
    pub fn listens_to(&self, usage: ShaderKind) -> bool {
        self.facts.iter().any(|f| f.listens.contains(&usage))
    }

    /// Whether some `getmessage` may ask the shader that spawned the ray that sees the point; it finds what
    /// it asks for in [`Grid::parent`].
    pub fn asks_parent(&self) -> bool {
        self.facts.iter().any(|f| f.asks_parent)
    }

    /// Leaves all parameters on the grid after a run, for a later shader of the object that
    /// [listens](Group::listens_to).
    pub fn keep_parameters(&self) {
        self.keeps.store(true, Ordering::Relaxed);
    }

    /// True when parameters stay on the grid after a run.
    pub(crate) fn keeps(&self) -> bool {
        self.keeps.load(Ordering::Relaxed)
    }

    /// True when some `getmessage` may ask the light that a `lights` loop examines.
    pub fn asks_light(&self) -> bool {
        self.facts.iter().any(|f| f.asks_light)
    }

    /// True when some `getmessage` may ask for a variable of the primitive.
    pub fn asks_primitive(&self) -> bool {
        self.facts.iter().any(|f| f.asks_primitive)
    }

    /// Whether each layer need not run: it only computes parameters, and nobody takes one of them. From the last layer to the
    /// first, so that each is looked at once however many ways lead to those that it feeds.
    pub(crate) fn find_idle(&self, wanted: &[(&str, ValueType)], idle: &mut Vec<bool>) {
        idle.clear();
        idle.resize(self.layers.len(), false);
        // What other layers or other shaders ask for by name may be any parameter.
        if self.keeps() || self.listens_to(self.usage) {
            return;
        }
        for (layer, l) in self.layers.iter().enumerate().rev() {
            idle[layer] = l.inert
                && !l.params.iter().zip(&l.module.params).any(|(p, decl)| {
                    // A symbol of this name may be asked for.
                    decl.output && wanted.iter().any(|(name, _)| element_of(name).0 == &*p.name)
                })
                && l.kept.is_empty()
                && l.feeds.iter().all(|&target| idle[target]);
        }
    }

    /// Layers, by number, that a run with these wanted results leaves out.
    pub fn idle_layers(&self, wanted: &[(&str, ValueType)]) -> Vec<usize> {
        let mut idle = Vec::new();
        self.find_idle(wanted, &mut idle);
        (0..self.layers.len()).filter(|&k| idle[k]).collect()
    }

    /// How many operations the code of all layers has, each counted once however often it runs.
    pub fn operations(&self) -> usize {
        self.layers
            .iter()
            .map(|l| {
                super::optimize::operations(l.better.as_ref().map_or(&l.plain, |b| &b.code).body.as_ref())
            })
            .sum()
    }

    /// Whether this is the first call with this cause: for messages said once.
    pub(crate) fn first_time(&self, cause: String) -> bool {
        self.said.lock().unwrap_or_else(PoisonError::into_inner).insert(cause)
    }

    /// Lays out a layer's symbols and takes the values of its instance.
    fn add_layer(
        &mut self,
        index: usize,
        source: &LayerSource<'_>,
        how: &Linking<'_>,
        report: &mut dyn FnMut(Severity, String),
    ) -> Result<(), ShadeError> {
        let Linking { wires, options, fixed } = *how;
        let module = &source.module;
        for param in source.params {
            if module.param(&param.name).is_none() {
                report(
                    Severity::Warning,
                    format!("shader \"{}\" has no parameter \"{}\"", module.name, param.name),
                );
            }
        }
        let mut params = Vec::with_capacity(module.params.len());
        let mut lengths: Vec<u32> = module.symbols.iter().map(|s| s.ty.elements() as u32).collect();
        for (k, decl) in module.params.iter().enumerate() {
            let symbol = module.symbol(decl.symbol);
            let given = source.params.get(&symbol.name).and_then(|p| {
                let name = module.name.clone();
                given(symbol, p, &mut self.strings, &mut |s, text| {
                    report(s, format!("shader \"{name}\": {text}"));
                })
            });
            if symbol.ty.open && symbol.ty.array.is_some() {
                lengths[decl.symbol.0 as usize] = {
                    let size = symbol.ty.value.components();
                    let own = given.as_ref().map_or(symbol.ty.elements(), |g| g.len() / size);
                    let linked = || self.open_length(index, k, own as u32, wires);
                    fixed.get(&(index, k)).copied().unwrap_or_else(linked)
                };
            }
            params.push(ParamPlan {
                symbol: decl.symbol,
                name: symbol.name.clone(),
                given,
                wires: Vec::new(),
            });
        }
        let better = if options.optimize {
            let known: Vec<Known> =
                params.iter().enumerate().map(|(k, p)| self.known(index, k, p, module, wires)).collect();
            let better = optimize(module, &known);
            let facts = analyse(&better.module)?;
            Some((better, facts))
        } else {
            None
        };
        let symbols = better.as_ref().map_or(&module.symbols, |(b, _)| &b.module.symbols);
        lengths.resize(symbols.len(), 1);
        let mut places = Vec::with_capacity(symbols.len());
        for (k, symbol) in symbols.iter().enumerate() {
            let at = match &symbol.kind {
                SymbolKind::Global(g) => At::Slot(*g as u32),
                SymbolKind::Const(value) => At::Const(self.constant(value)),
                _ => {
                    let floats = (lengths[k] as usize).saturating_mul(symbol.ty.value.components());
                    if floats > MAX_NUMBERS {
                        return Err(ShadeError::Limit {
                            what: "array elements",
                            asked: floats,
                            max: MAX_NUMBERS,
                        });
                    }
                    self.slots.push(floats as u32);
                    At::Slot(self.slots.len() as u32 - 1)
                }
            };
            places.push(Place {
                at,
                value: symbol.ty.value,
                elements: lengths[k].max(1),
                array: symbol.ty.array.is_some(),
                // Either code may run.
                scratch: self.facts[index].scratch.get(k).is_none_or(|s| *s)
                    && better.as_ref().is_none_or(|(_, facts)| facts.scratch[k]),
            });
        }
        let inits: Vec<&Block> = module.params.iter().map(|p| &p.init).collect();
        let code = |mut body: Block| {
            let tapes = if options.optimize {
                fuse(&mut body, &inits, symbols, &places, &self.constants)
            } else {
                Vec::new()
            };
            Code { body, tapes }
        };
        let plain = code(module.body.clone());
        let better = better
            .as_ref()
            .map(|(b, _)| BetterCode { code: code(b.module.body.clone()), assumed: b.assumed.clone() });
        let inert = options.optimize
            && is_inert(&module.body, &module.symbols)
            && module.params.iter().all(|p| is_inert(&p.init, &module.symbols));
        self.layers.push(Layer {
            module: module.clone(),
            places,
            params,
            globals: Vec::new(),
            kept: Vec::new(),
            plain,
            better,
            inert,
            feeds: wires.iter().filter(|w| w.source_layer == index).map(|w| w.target_layer).collect(),
        });
        Ok(())
    }

    /// What is known of a parameter before a layer runs, as long as no primitive variable replaces it.
    fn known(&self, layer: usize, k: usize, plan: &ParamPlan, module: &Module, wires: &[Resolved]) -> Known {
        if wires.iter().any(|w| w.target_layer == layer && w.target.end == End::Param(k)) {
            return Known::Unknown;
        }
        let Some(values) = &plan.given else { return Known::Default };
        match module.symbol(plan.symbol).ty.value {
            ValueType::Float | ValueType::Color => Known::Given(ConstValue::Floats(values.clone())),
            ValueType::String => {
                let text = |id: &f32| self.strings.text(*id).cloned().unwrap_or_default();
                Known::Given(ConstValue::Strings(values.iter().map(text).collect()))
            }
            // Given in "shader" space, wherever that will be.
            _ => Known::Unknown,
        }
    }

    /// True length of a variable-length parameter (reference 5.3.2), `own` without connections.
    fn open_length(&self, layer: usize, param: usize, own: u32, wires: &[Resolved]) -> u32 {
        let into = wires.iter().filter(|w| w.target_layer == layer && w.target.end == End::Param(param));
        let (mut whole, mut reach) = (None, 0);
        for wire in into {
            match (wire.target.element, wire.source.end) {
                (Some(e), _) => reach = reach.max(e.saturating_add(1)),
                // The source may be of variable length itself; its layer is linked already.
                (None, End::Param(p)) => {
                    let source = &self.layers[wire.source_layer];
                    whole = Some(source.places[source.params[p].symbol.0 as usize].elements);
                }
                (None, End::Global(_)) => {}
            }
        }
        whole.unwrap_or(own).max(reach).max(1)
    }

    /// The constant's index.
    fn constant(&mut self, value: &ConstValue) -> u32 {
        let floats: Arc<[f32]> = match value {
            ConstValue::Floats(v) => v.clone(),
            ConstValue::Strings(v) => v.iter().map(|s| self.strings.intern(s)).collect(),
        };
        self.constants.push(floats);
        self.constants.len() as u32 - 1
    }

    /// Makes a connection whose ends are checked.
    fn add_wire(&mut self, wire: &Resolved) {
        let source = match wire.source.end {
            End::Param(p) => self.param_tap(wire.source_layer, p, &wire.source),
            End::Global(g) => {
                // Later layers may change the global: keep it as the source layer leaves it.
                let known = self.layers[wire.source_layer].kept.iter().find(|(k, _)| *k == g).map(|k| k.1);
                let slot = known.unwrap_or_else(|| {
                    self.slots.push(g.value_type().components() as u32);
                    let slot = self.slots.len() as u32 - 1;
                    self.layers[wire.source_layer].kept.push((g, slot));
                    slot
                });
                self.used[g as usize] = true;
                global_tap(slot, &wire.source)
            }
        };
        match wire.target.end {
            End::Param(p) => {
                let target = self.param_tap(wire.target_layer, p, &wire.target);
                self.layers[wire.target_layer].params[p].wires.push(Wire { source, target });
            }
            End::Global(g) => {
                self.used[g as usize] = true;
                self.writes[g as usize] = true;
                let target = global_tap(g as u32, &wire.target);
                self.layers[wire.target_layer].globals.push(Wire { source, target });
            }
        }
    }

    /// The end of a connection at a parameter.
    fn param_tap(&self, layer: usize, param: usize, named: &Named) -> Tap {
        let layer = &self.layers[layer];
        let place = &layer.places[layer.params[param].symbol.0 as usize];
        let At::Slot(slot) = place.at else { unreachable!("parameters have registers") };
        Tap {
            slot,
            value: place.value,
            elements: place.elements,
            element: named.element,
            component: named.component,
        }
    }

    /// Gathers what is known of all layers.
    fn summarise(&mut self) {
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
        // Functions and statements of light use some without naming them.
        for facts in &self.facts {
            for g in Global::ALL {
                self.used[g as usize] |= facts.implied[g as usize];
            }
        }
    }
}

/// The end of a connection at a global.
fn global_tap(slot: u32, named: &Named) -> Tap {
    Tap { slot, value: named.value, elements: 1, element: None, component: named.component }
}

/// A connection whose layers and names are known.
struct Resolved {
    source_layer: usize,
    source: Named,
    target_layer: usize,
    target: Named,
}

/// Resolves all connections; those that cannot be made are reported and dropped. Of several into one
/// end, the last counts.
fn resolve_all(
    layers: &[LayerSource<'_>],
    connections: &[ConnectionSource<'_>],
    report: &mut dyn FnMut(Severity, String),
) -> Vec<Resolved> {
    let mut list: Vec<Resolved> = Vec::new();
    for c in connections {
        let made = (|| {
            let find = |name: &str| {
                layers
                    .iter()
                    .rposition(|l| l.name == Some(name))
                    .ok_or_else(|| format!("there is no layer \"{name}\""))
            };
            let (source_layer, target_layer) = (find(c.source_layer)?, find(c.target_layer)?);
            if source_layer >= target_layer {
                return Err("the source must be an earlier layer".to_owned());
            }
            let source = resolve(&layers[source_layer].module, c.source)?;
            let target = resolve(&layers[target_layer].module, c.target)?;
            compatible(&source, &target)?;
            Ok(Resolved { source_layer, source, target_layer, target })
        })();
        match made {
            Err(why) => refuse(c, &why, report),
            Ok(wire) => {
                list.retain(|w| {
                    w.target_layer != wire.target_layer
                        || w.target.end != wire.target.end
                        || w.target.element != wire.target.element
                        || w.target.component != wire.target.component
                });
                list.push(wire);
            }
        }
    }
    list
}

/// The type of the layers; generic ones join any.
fn common_kind(layers: &[LayerSource<'_>]) -> Result<ShaderKind, ShadeError> {
    if layers.is_empty() {
        return Err(ShadeError::Misuse { what: "a shader group without layers".to_owned() });
    }
    let mut kind = ShaderKind::Generic;
    for layer in layers {
        let own = layer.module.kind;
        if own == ShaderKind::Generic || own == kind {
            continue;
        }
        if kind != ShaderKind::Generic {
            return Err(ShadeError::Misuse {
                what: format!(
                    "a {} shader (\"{}\") in a group of {} shaders",
                    own.word(),
                    layer.module.name,
                    kind.word()
                ),
            });
        }
        kind = own;
    }
    Ok(kind)
}

/// Whether a generic shader keeps the rules of a usage.
fn check_usage(module: &Module, facts: &Facts, usage: ShaderKind) -> Result<(), ShadeError> {
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
        // `emit` sets L and Cl itself; it is refused below by its own name.
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
