//! Links layers and connections to groups.

use super::analyse::{Analysis, analyse};
use super::calls;
use super::connections::{Connection, Endpoint, Named, Whole, compatible, refuse, resolve};
use super::given::given;
use super::group::Group;
use super::layer::{Code, Layer, OptimisedCode, ParamPlan};
use super::optimize::{Known, is_inert, occurrences, optimize, slice};
use super::parts::{Parts, divide};
use super::relink::Relink;
use super::source::{ConnectionSource, LayerSource, LinkOptions};
use crate::program::{At, Block, Place, Program};
use crate::run::strings::Strings;
use crate::tape::fuse;
use crate::{Grid, ShadeError};
use granita_base::Severity;
use granita_gsl::ir::{ConstValue, Global, Module, ShaderKind, Symbol, SymbolKind, ValueType};
use parking_lot::Mutex;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// The largest number of floats per point. A shader with more would exhaust memory.
const MAX_NUMBERS: usize = 1 << 20;

/// The id of the next group.
static NEXT_ID: AtomicU64 = AtomicU64::new(1);

/// The data that linking a layer takes from the group.
struct Linking<'a> {
    connections: &'a [Resolved],
    options: LinkOptions,
    /// The lengths of variable-length parameters, by layer and index.
    fixed: &'a BTreeMap<(usize, usize), u32>,
}

/// A layer that is being linked.
struct Entry<'a> {
    index: usize,
    source: &'a LayerSource<'a>,
    program: Program,
}

impl Group {
    /// Links layers, the first of which runs first.
    ///
    /// Errors (unknown parameters, connections that cannot be made) go to `report`, and the rest is linked without
    /// them.
    ///
    /// # Errors
    /// Returns [`ShadeError::Misuse`] for no layer or layers of different types, and [`ShadeError::Limit`] for
    /// excessive array sizes.
    pub fn link(
        layers: &[LayerSource<'_>],
        connections: &[ConnectionSource<'_>],
        report: &mut dyn FnMut(Severity, String),
    ) -> Result<Self, ShadeError> {
        Self::link_with(layers, connections, LinkOptions::default(), report)
    }

    /// Links layers as [`Group::link`] does, with options.
    ///
    /// # Errors
    /// The errors are those of [`Group::link`].
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

    /// Links layers as [`Group::link_with`] does. `fixed` holds lengths of variable-length parameters, by layer and
    /// index.
    fn link_lengths(
        layers: &[LayerSource<'_>],
        connections: &[ConnectionSource<'_>],
        options: LinkOptions,
        fixed: &BTreeMap<(usize, usize), u32>,
        report: &mut dyn FnMut(Severity, String),
    ) -> Result<Self, ShadeError> {
        let usage = common_kind(layers)?;
        let programs: Vec<Program> = layers.iter().map(|l| Program::of(&l.module)).collect();
        let facts = programs.iter().map(analyse).collect();
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
        let connections = resolve_all(layers, connections, report);
        let mut better = Vec::new();
        for (k, (source, program)) in layers.iter().zip(programs).enumerate() {
            let entry = Entry { index: k, source, program };
            better.extend(group.add_layer(
                entry,
                &Linking { connections: &connections, options, fixed },
                report,
            )?);
        }
        let sets_opacity = !matches!(usage, ShaderKind::Light | ShaderKind::Displacement);
        if sets_opacity && better.len() == layers.len() {
            group.add_opacity(&better, &connections);
        }
        for connection in &connections {
            group.add_wire(connection);
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

    /// Returns the group with its variable-length parameters as long as the primitive variables of a grid that
    /// replace them (reference 5.3.2); `None` when they already are.
    pub(crate) fn for_grid(&self, grid: &Grid) -> Option<Arc<Self>> {
        let relink = self.again.as_ref()?;
        relink.variant(grid, |layers, connections, lengths| {
            // Errors were reported when the group was linked first.
            let mut group =
                Self::link_lengths(layers, connections, relink.options, lengths, &mut |_, _| {}).ok()?;
            group.attach(self.usage).ok()?;
            if self.keeps() {
                group.keep_parameters();
            }
            Some(group)
        })
    }

    /// Adds a layer: reads the values of its instance, optimises its code, and lays out its symbols. Returns the
    /// optimised program, if there is one.
    fn add_layer(
        &mut self,
        Entry { index, source, program }: Entry<'_>,
        how: &Linking<'_>,
        report: &mut dyn FnMut(Severity, String),
    ) -> Result<Option<Program>, ShadeError> {
        let Linking { connections, options, .. } = *how;
        let module = &source.module;
        let (params, mut lengths) = self.take_params(index, source, how, report);
        let better = options.optimize.then(|| {
            let known: Vec<Known> = params
                .iter()
                .enumerate()
                .map(|(k, p)| self.known(index, k, p, module, connections))
                .collect();
            optimize(module, &program, &known)
        });
        let facts = better.as_ref().map(|better| analyse(&better.program));
        let symbols = better.as_ref().map_or(&program.symbols, |better| &better.program.symbols);
        lengths.resize(symbols.len(), 1);
        // Either code may run.
        let plain = &self.facts[index].scratch;
        let may_forget =
            |k: usize| plain.get(k).is_none_or(|s| *s) && facts.as_ref().is_none_or(|facts| facts.scratch[k]);
        let scratch: Vec<bool> = (0..symbols.len()).map(may_forget).collect();
        let places = self.lay_out(symbols, &lengths, &scratch)?;
        let mut calls = Vec::new();
        let mut inits = program.inits.clone();
        inits.iter_mut().for_each(|init| calls::resolve(init, symbols, &mut calls));
        let mut code = |mut body: Block, facts: &Analysis| {
            calls::resolve(&mut body, symbols, &mut calls);
            let tapes = if options.optimize {
                fuse(&mut body, &program.inits, symbols, &places, &self.constants)
            } else {
                Vec::new()
            };
            let parts = divide(&body, &tapes, symbols, &places, facts);
            Code { body, tapes, parts }
        };
        let plain = code(program.body.clone(), &self.facts[index]);
        let optimised = better.as_ref().zip(facts.as_ref()).map(|(b, facts)| OptimisedCode {
            code: code(b.program.body.clone(), facts),
            assumed: b.assumed.clone(),
        });
        let inert = options.optimize
            && program.inits.iter().chain([&program.body]).all(|block| is_inert(block, &program.symbols));
        self.layers.push(Layer {
            module: module.clone(),
            places,
            params,
            inits,
            calls,
            globals: Vec::new(),
            kept: Vec::new(),
            plain,
            better: optimised,
            opacity: None,
            inert,
            feeds: connections.iter().filter(|w| w.source_layer == index).map(|w| w.target_layer).collect(),
        });
        Ok(better.map(|better| better.program))
    }

    /// Adds the code of all layers that determines opacity, where that can run alone. It proceeds from the last layer
    /// to the first. `programs` holds the optimised ones.
    fn add_opacity(&mut self, programs: &[Program], connections: &[Resolved]) {
        let mut globals = Global::ALL.map(|g| g == Global::opacity);
        let mut params: Vec<BTreeSet<usize>> = vec![BTreeSet::new(); programs.len()];
        let mut bodies = Vec::new();
        for (k, program) in programs.iter().enumerate().rev() {
            let symbols = &program.symbols;
            let mut needed: Vec<bool> = symbols
                .iter()
                .map(|symbol| matches!(symbol.kind, SymbolKind::Global(g) if globals[g as usize]))
                .collect();
            let layer = &self.layers[k];
            params[k].iter().for_each(|p| needed[layer.params[*p].symbol.0 as usize] = true);
            let Some(body) = slice(&program.body, symbols, &mut needed) else { return };
            // All defaults are computed.
            for init in &program.inits {
                occurrences(init, symbols, &mut |s| needed[s.0 as usize] = true);
            }
            bodies.push(body);
            for (symbol, needed) in symbols.iter().zip(&needed) {
                if let SymbolKind::Global(g) = symbol.kind {
                    globals[g as usize] |= needed;
                }
            }
            for wire in connections.iter().filter(|wire| wire.target_layer == k) {
                let is_needed = match wire.target.end {
                    Whole::Param(p) => needed[layer.params[p].symbol.0 as usize],
                    Whole::Global(g) => globals[g as usize],
                };
                if is_needed {
                    match wire.source.end {
                        Whole::Param(p) => drop(params[wire.source_layer].insert(p)),
                        Whole::Global(g) => globals[g as usize] = true,
                    }
                }
            }
        }
        for ((layer, program), mut body) in self.layers.iter_mut().zip(programs).zip(bodies.into_iter().rev())
        {
            calls::resolve(&mut body, &program.symbols, &mut layer.calls);
            let tapes = fuse(&mut body, &program.inits, &program.symbols, &layer.places, &self.constants);
            layer.opacity = Some(Code { body, tapes, parts: Parts::default() });
        }
    }

    /// Determines the sources of the parameters of a layer, and the lengths of all symbols of its module.
    fn take_params(
        &mut self,
        index: usize,
        source: &LayerSource<'_>,
        how: &Linking<'_>,
        report: &mut dyn FnMut(Severity, String),
    ) -> (Vec<ParamPlan>, Vec<u32>) {
        let module = &source.module;
        for param in source.params {
            if module.param(&param.name).is_none() {
                let text = format!("shader \"{}\" has no parameter \"{}\"", module.name, param.name);
                report(Severity::Warning, text);
            }
        }
        let mut params = Vec::with_capacity(module.params.len());
        let mut lengths: Vec<u32> = module.symbols.iter().map(|s| s.ty.elements() as u32).collect();
        for (k, decl) in module.params.iter().enumerate() {
            let symbol = module.symbol(decl.symbol);
            let given = source.params.get(&symbol.name).and_then(|p| {
                given(symbol, p, &mut self.strings, &mut |s, text| {
                    report(s, format!("shader \"{}\": {text}", module.name));
                })
            });
            if symbol.ty.open && symbol.ty.array.is_some() {
                lengths[decl.symbol.0 as usize] = {
                    let size = symbol.ty.value.components();
                    let own = given.as_ref().map_or(symbol.ty.elements(), |g| g.len() / size);
                    let linked = || self.open_length(index, k, own as u32, how.connections);
                    how.fixed.get(&(index, k)).copied().unwrap_or_else(linked)
                };
            }
            let name = symbol.name.clone();
            params.push(ParamPlan { symbol: decl.symbol, name, given, connections: Vec::new() });
        }
        (params, lengths)
    }

    /// Assigns a place to each symbol: a register of its length, a global's register, or a constant of the group.
    fn lay_out(
        &mut self,
        symbols: &[Symbol],
        lengths: &[u32],
        scratch: &[bool],
    ) -> Result<Vec<Place>, ShadeError> {
        let mut places = Vec::with_capacity(symbols.len());
        for ((symbol, &length), &scratch) in symbols.iter().zip(lengths).zip(scratch) {
            let at = match &symbol.kind {
                SymbolKind::Global(g) => At::Slot(*g as u32),
                SymbolKind::Const(value) => At::Const(self.constant(value)),
                _ => {
                    let floats = (length as usize).saturating_mul(symbol.ty.value.components());
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
            let (value, array) = (symbol.ty.value, symbol.ty.array.is_some());
            places.push(Place { at, value, elements: length.max(1), array, scratch });
        }
        Ok(places)
    }

    /// Returns the known value of a parameter before a layer runs, as long as no primitive variable replaces it.
    fn known(
        &self,
        layer: usize,
        k: usize,
        plan: &ParamPlan,
        module: &Module,
        connections: &[Resolved],
    ) -> Known {
        if connections.iter().any(|w| w.target_layer == layer && w.target.end == Whole::Param(k)) {
            return Known::Unknown;
        }
        let Some(values) = &plan.given else { return Known::Default };
        match module.symbol(plan.symbol).ty.value {
            ValueType::Float | ValueType::Color => Known::Given(ConstValue::Floats(values.clone())),
            ValueType::String => {
                Known::Given(ConstValue::Strings(values.iter().map(|held| self.given_text(*held)).collect()))
            }
            // The value is in "shader" space, which is not known here.
            _ => Known::Unknown,
        }
    }

    /// Returns the length of a variable-length parameter (reference 5.3.2), which is `own` without connections.
    fn open_length(&self, layer: usize, param: usize, own: u32, connections: &[Resolved]) -> u32 {
        let into =
            connections.iter().filter(|w| w.target_layer == layer && w.target.end == Whole::Param(param));
        let (mut whole, mut reach) = (None, 0);
        for connection in into {
            match (connection.target.element, connection.source.end) {
                (Some(e), _) => reach = reach.max(e.saturating_add(1)),
                // The source may be of variable length itself. Its layer is linked already.
                (None, Whole::Param(p)) => {
                    let source = &self.layers[connection.source_layer];
                    whole = Some(source.places[source.params[p].symbol.0 as usize].elements);
                }
                (None, Whole::Global(_)) => {}
            }
        }
        whole.unwrap_or(own).max(reach).max(1)
    }

    /// Returns the constant's index.
    fn constant(&mut self, value: &ConstValue) -> u32 {
        let floats: Arc<[f32]> = match value {
            ConstValue::Floats(v) => v.clone(),
            ConstValue::Strings(v) => v.iter().map(|s| self.strings.intern(s).to_register()).collect(),
        };
        self.constants.push(floats);
        self.constants.len() as u32 - 1
    }

    /// Makes a connection with checked ends.
    fn add_wire(&mut self, connection: &Resolved) {
        let source = match connection.source.end {
            Whole::Param(p) => self.param_endpoint(connection.source_layer, p, &connection.source),
            Whole::Global(g) => {
                // Later layers may change the global, so its value after the source layer is kept.
                let known =
                    self.layers[connection.source_layer].kept.iter().find(|(k, _)| *k == g).map(|k| k.1);
                let slot = known.unwrap_or_else(|| {
                    self.slots.push(g.value_type().components() as u32);
                    let slot = self.slots.len() as u32 - 1;
                    self.layers[connection.source_layer].kept.push((g, slot));
                    slot
                });
                self.used[g as usize] = true;
                global_endpoint(slot, &connection.source)
            }
        };
        match connection.target.end {
            Whole::Param(p) => {
                let target = self.param_endpoint(connection.target_layer, p, &connection.target);
                self.layers[connection.target_layer].params[p]
                    .connections
                    .push(Connection { source, target });
            }
            Whole::Global(g) => {
                self.used[g as usize] = true;
                self.writes[g as usize] = true;
                let target = global_endpoint(g as u32, &connection.target);
                self.layers[connection.target_layer].globals.push(Connection { source, target });
            }
        }
    }

    /// Returns the end of a connection at a parameter.
    fn param_endpoint(&self, layer: usize, param: usize, named: &Named) -> Endpoint {
        let layer = &self.layers[layer];
        let place = &layer.places[layer.params[param].symbol.0 as usize];
        let At::Slot(slot) = place.at else { unreachable!("parameters have registers") };
        Endpoint {
            slot,
            value: place.value,
            elements: place.elements,
            element: named.element,
            component: named.component,
        }
    }
}

/// Returns the end of a connection at a global.
fn global_endpoint(slot: u32, named: &Named) -> Endpoint {
    Endpoint { slot, value: named.value, elements: 1, element: None, component: named.component }
}

/// A connection with resolved layers and names.
struct Resolved {
    source_layer: usize,
    source: Named,
    target_layer: usize,
    target: Named,
}

/// Resolves all connections. Those that cannot be made are reported and dropped. Among several into one end, the
/// last counts.
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
            Ok(connection) => {
                list.retain(|w| {
                    w.target_layer != connection.target_layer
                        || w.target.end != connection.target.end
                        || w.target.element != connection.target.element
                        || w.target.component != connection.target.component
                });
                list.push(connection);
            }
        }
    }
    list
}

/// Returns the type of the layers. Generic ones are compatible with any.
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
