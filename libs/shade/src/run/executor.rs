//! The entry point that runs linked groups.

use crate::link::element_of;
use crate::program::At;
use crate::run::machine::{Emission, Machine, State};
use crate::run::store::Mask;
use crate::{Grid, Group, IlluminateQuery, LightResult, Message, Services};
use granita_gsl::ir::{Global, ValueType};
use std::sync::Arc;

/// Runs shaders and keeps the memory of registers and masks from run to run. After the first grids, only returned
/// data (results, light samples) and short operand lists are allocated. Each thread needs one. A light that is
/// requested inside of a run needs another one.
///
/// Results depend on the arguments only, to the bit. They do not depend on earlier runs of an executor.
#[derive(Debug, Default)]
pub struct Executor {
    state: State,
}

impl Executor {
    /// Returns an executor without any memory yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Turns the search for NaN in every result on or off (`debug:shadernan`). An operation that makes a NaN of
    /// numbers is reported with shader, line, operands and result, once per place. The code then runs as it was
    /// compiled, because folded operations are not searched. The search takes time.
    pub fn look_for_nan(&mut self, on: bool) {
        self.state.nan_check = on;
    }

    /// Sets a seed of `random ()` and `randomgrid ()` that is combined with that of each grid; 0, the default, has
    /// no effect.
    pub fn seed_random(&mut self, seed: u32) {
        self.state.seed = seed;
    }

    /// Runs a surface, displacement or volume group over a grid.
    ///
    /// The values that the group writes to `P`, `N`, `C` and `opacity` are written back into the grid, and its
    /// messages are appended to it. Returns the values of `wanted` after the run, in their order: output parameters
    /// (of the last layer that has one of that name and type), elements of output arrays (`name[2]`) or globals,
    /// component after component over all lanes; `None` where there is none.
    pub fn run(
        &mut self,
        group: &Group,
        grid: &mut Grid,
        services: &mut dyn Services,
        wanted: &[(&str, ValueType)],
    ) -> Vec<Option<Vec<f32>>> {
        self.run_for(group, grid, services, wanted, Purpose::Outputs)
    }

    /// Does the same as [`Executor::run`], but finds all `wanted` parameters, not only output parameters.
    pub fn run_asked(
        &mut self,
        group: &Group,
        grid: &mut Grid,
        services: &mut dyn Services,
        wanted: &[(&str, ValueType)],
    ) -> Vec<Option<Vec<f32>>> {
        self.run_for(group, grid, services, wanted, Purpose::Parameters)
    }

    /// Does the same as [`Executor::run`] for a caller that uses `opacity` alone, as that of surfaces which shadow rays
    /// hit. Code that only makes colours does not run, except where it has other effects. `C` is undefined afterwards.
    pub fn run_opacity(
        &mut self,
        group: &Group,
        grid: &mut Grid,
        services: &mut dyn Services,
        wanted: &[(&str, ValueType)],
    ) -> Vec<Option<Vec<f32>>> {
        let purpose = if group.may_run_opacity() { Purpose::Opacity } else { Purpose::Outputs };
        self.run_for(group, grid, services, wanted, purpose)
    }

    fn run_for(
        &mut self,
        group: &Group,
        grid: &mut Grid,
        services: &mut dyn Services,
        wanted: &[(&str, ValueType)],
        purpose: Purpose,
    ) -> Vec<Option<Vec<f32>>> {
        let n = grid.len();
        if n == 0 {
            return vec![None; wanted.len()];
        }
        let keeps = group.keeps();
        let fitting = group.for_grid(grid);
        let group = fitting.as_deref().unwrap_or(group);
        if keeps {
            group.keep_parameters();
        }
        let mut machine = machine(group, grid, services, &mut self.state);
        machine.mask.fill(n);
        machine.base = n;
        machine.prepare(None);
        machine.layers(true, Some(wanted), purpose);
        let outputs = purpose != Purpose::Parameters;
        let results = wanted.iter().map(|(name, ty)| machine.output(name, *ty, outputs)).collect();
        let messages = machine.messages(keeps);
        machine.finish();
        self.write_back(group, grid);
        grid.messages.extend(messages);
        results
    }

    /// Runs a light for the points of a query, over the grid of the surface that makes the query.
    ///
    /// Lanes that are not active in the query have undefined values.
    pub fn run_light(
        &mut self,
        group: &Group,
        surface_grid: &Grid,
        query: &IlluminateQuery<'_>,
        services: &mut dyn Services,
    ) -> LightResult {
        let n = surface_grid.len();
        if n == 0 || query.batch.active.is_empty() {
            return LightResult::default();
        }
        let mut machine = machine(group, surface_grid, services, &mut self.state);
        machine.mask.set_active(n, query.batch.active);
        machine.base = machine.mask.count();
        machine.emitted = Some(LightResult::default());
        machine.cone = query.cone.map(|cone| cone.map(|lanes| (0..n).map(|i| lanes.get(i)).collect()));
        machine.prepare(Some(query));
        machine.layers(false, None, Purpose::Outputs);
        let mut result = machine.emitted.take().unwrap_or_default();
        if !group.has_emit() {
            result.ambient = Some(machine.lanes3_of(Global::Cl as usize));
        }
        result.nondiffuse = machine.param_lanes("__nondiffuse");
        result.nonspecular = machine.param_lanes("__nonspecular");
        if query.asks {
            result.messages = machine.messages(true).into_iter().map(|m| m.value).collect();
        }
        machine.finish();
        result
    }

    /// Copies the values that a group writes into the grid.
    fn write_back(&mut self, group: &Group, grid: &mut Grid) {
        let n = grid.len();
        for (g, lanes) in [
            (Global::P, &mut grid.p),
            (Global::N, &mut grid.n),
            (Global::C, &mut grid.c),
            (Global::opacity, &mut grid.opacity),
        ] {
            if !group.writes(g) {
                continue;
            }
            let slot = &self.state.slots[g as usize];
            for c in 0..3 {
                lanes.xyz[c].resize(n, 0.0);
                if slot.varying {
                    lanes.xyz[c].copy_from_slice(&slot.data[c * n..(c + 1) * n]);
                } else {
                    lanes.xyz[c].fill(slot.data[c]);
                }
            }
        }
    }
}

/// What a run is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Purpose {
    /// All results, and requested output parameters.
    Outputs,
    /// All results, and requested parameters of any kind.
    Parameters,
    /// Opacity alone.
    Opacity,
}

/// Returns a machine that has not started.
fn machine<'a>(
    group: &'a Group,
    grid: &'a Grid,
    services: &'a mut dyn Services,
    state: &'a mut State,
) -> Machine<'a> {
    let mask = state.masks.pop().unwrap_or_default();
    let (loops, scopes) = (std::mem::take(&mut state.loops), std::mem::take(&mut state.scopes));
    Machine {
        group,
        grid,
        services,
        st: state,
        n: grid.len(),
        layer: 0,
        tapes: &[],
        mask,
        base: 0,
        loops,
        scopes,
        draws: 0,
        lane_draws: Vec::new(),
        emission: Emission::default(),
        cone: None,
        emitted: None,
        light: None,
        ray: None,
    }
}

impl Machine<'_> {
    /// Runs all layers in order. `primvars` is true when parameters take primitive variables. `wanted` holds the
    /// requested results; layers that they do not need are skipped (none without it).
    fn layers(&mut self, primvars: bool, wanted: Option<&[(&str, ValueType)]>, purpose: Purpose) {
        let mut all = self.borrow_mask();
        all.copy_from(&self.mask);
        let mut idle = std::mem::take(&mut self.st.idle);
        match wanted {
            Some(wanted) => self.group.find_idle(wanted, &mut idle),
            None => idle.clear(),
        }
        let active = |layer: &usize| idle.get(*layer) != Some(&true);
        let in_parts = primvars
            && purpose == Purpose::Outputs
            && !self.st.nan_check
            && !self.group.keeps()
            && (0..self.group.layers.len()).filter(active).count() == 1
            && self.services.keeps_parts();
        for layer in 0..self.group.layers.len() {
            if !active(&layer) {
                continue;
            }
            self.layer = layer;
            self.bind_params(primvars);
            // An initialiser cannot leave the shader, but a damaged one must not stop it.
            self.readmit(&all);
            let code = self.code();
            let body = match &code.better {
                // The search for NaN runs the unfolded code, so that the operation that makes one is reported.
                _ if self.st.nan_check => &code.plain,
                Some(better) if !primvars || !self.replaces(&better.assumed) => {
                    code.opacity.as_ref().filter(|_| purpose == Purpose::Opacity).unwrap_or(&better.code)
                }
                _ => &code.plain,
            };
            self.tapes = &body.tapes;
            match in_parts && !body.parts.list.is_empty() {
                true => self.parts(body),
                false => self.block(&body.body),
            }
            self.keep_globals();
            self.readmit(&all);
        }
        self.st.idle = idle;
        self.return_mask(all);
    }

    /// Makes lanes that left active again. `all` holds the active ones and these.
    fn readmit(&mut self, all: &Mask) {
        if self.mask.count() != all.count() {
            self.mask.copy_from(all);
        }
    }

    /// True when a primitive variable has the name of one of the layer's parameters with these indices.
    fn replaces(&self, params: &[usize]) -> bool {
        let code = self.code();
        self.grid.primvars.iter().any(|v| params.iter().any(|&k| code.params[k].name == v.name))
    }

    /// Returns memory to the state.
    fn finish(self) {
        let Self { st, mask, loops, scopes, .. } = self;
        st.masks.push(mask);
        (st.loops, st.scopes) = (loops, scopes);
    }

    /// Returns the register of a parameter, searched from the last layer. The type must match if there is one.
    pub(crate) fn find_param(&self, name: &str, ty: Option<ValueType>, outputs: bool) -> Option<usize> {
        self.find_element(name, None, ty, outputs)
    }

    /// Does the same as [`Machine::find_param`]. With an element, the parameter must be an array that has this
    /// element.
    fn find_element(
        &self,
        name: &str,
        element: Option<u32>,
        ty: Option<ValueType>,
        outputs: bool,
    ) -> Option<usize> {
        self.group.layers.iter().rev().find_map(|layer| {
            let k = layer.params.iter().position(|p| *p.name == *name)?;
            let place = &layer.places[layer.params[k].symbol.0 as usize];
            let fits = ty.is_none_or(|t| t == place.value) && (!outputs || layer.module.params[k].output);
            match place.at {
                At::Slot(slot) if fits && place.array == element.is_some() => {
                    element.is_none_or(|k| k < place.elements).then_some(slot as usize)
                }
                _ => None,
            }
        })
    }

    /// Returns a requested result.
    fn output(&mut self, name: &str, ty: ValueType, outputs: bool) -> Option<Vec<f32>> {
        if ty == ValueType::String {
            return None;
        }
        let (base, element) = element_of(name);
        if let Some(slot) = self.find_element(base, element, Some(ty), outputs) {
            let lanes = self.lanes_of(slot);
            let Some(k) = element else { return Some(lanes) };
            let size = ty.components() * self.n;
            return lanes.get(k as usize * size..(k as usize + 1) * size).map(<[f32]>::to_vec);
        }
        let global = Global::ALL.into_iter().find(|g| g.word() == name)?;
        if global.value_type().components() != ty.components() {
            return None;
        }
        if !self.group.used[global as usize] {
            self.load_global(global, None);
        }
        Some(self.lanes_of(global as usize))
    }

    /// Returns the messages of the run for `getmessage`: all parameters or none, followed by messages, which have
    /// precedence.
    pub(crate) fn messages(&self, parameters: bool) -> Vec<Message> {
        let from = self.group.usage();
        let mut list = Vec::new();
        if parameters {
            list.extend(self.parameters().into_iter().map(|value| Message { from, value }));
        }
        for sent in &self.st.messages {
            let name: Arc<str> = self.text(sent.name).clone();
            let array = (sent.elements > 1).then_some(sent.elements);
            list.push(Message { from, value: self.as_primvar(&name, sent.value, array, &sent.slot) });
        }
        list
    }

    /// Returns a float parameter per lane; empty without it.
    fn param_lanes(&self, name: &str) -> Vec<f32> {
        self.find_param(name, Some(ValueType::Float), false).map_or(Vec::new(), |slot| self.lanes_of(slot))
    }
}

impl std::fmt::Debug for Machine<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Machine({} lanes, layer {}, {:?} active)", self.n, self.layer, Mask::count(&self.mask))
    }
}
