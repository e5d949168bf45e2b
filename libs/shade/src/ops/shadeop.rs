//! Calls external functions. Registers hold component after component over all points. Functions receive and return
//! values point after point.

use super::lookup::is_given;
use crate::program::Op;
use crate::run::machine::Machine;
use crate::run::store::View;
use crate::run::strings::StringId;
use crate::services::OptionTable;
use crate::{
    Batch, EnvironmentQuery, Lane, Lane3, Lanes3, LookupResult, OptionValue, RayKind, ShadeopArg,
    ShadeopContext, ShadeopData, ShadowQuery, Spot, TextureQuery,
};
use granita_base::{Param, Vec3};
use granita_gsl::ShadeopCall;
use granita_gsl::ir::{Global, SourcePos, SymbolId, SymbolKind, ValueType};
use std::sync::Arc;

/// A run of a function within a run of a shader.
struct Machinery<'c, 'm> {
    machine: &'c mut Machine<'m>,
    args: Vec<ShadeopArg>,
    at: SourcePos,
    name: &'c str,
    /// The number of lookups so far. Each belongs to the next active point, whose random numbers it uses.
    lookups: usize,
    result: LookupResult,
}

/// Runs a shadeop.
pub(super) fn run(m: &mut Machine<'_>, op: &Op) {
    let text = m.string(op.args[0]);
    let Some(call) = ShadeopCall::parse(&text) else { return };
    let function = match m.services.shadeop(&text) {
        Ok(function) => function,
        Err(why) => {
            m.complain(op.at, &why);
            return super::zero(m, op);
        }
    };
    let varying = m.varies(&op.args);
    let symbols: Vec<(SymbolId, bool)> = op
        .dst
        .map(|dst| (dst, true))
        .into_iter()
        .chain(op.args[1..].iter().copied().zip(call.outputs.iter().copied()))
        .collect();
    let mut args = Vec::with_capacity(symbols.len());
    for &(symbol, output) in &symbols {
        let mut arg = taken(m, symbol);
        arg.output = output;
        if output && varying {
            arg.spread(m.n);
        }
        args.push(arg);
    }
    let result = std::mem::take(&mut m.st.lookup);
    let mut machinery = Machinery { machine: m, args, at: op.at, name: call.name, lookups: 0, result };
    if let Err(why) = function.run(&mut machinery) {
        machinery.complain(&why);
    }
    let Machinery { machine: m, args, result, .. } = machinery;
    m.st.lookup = result;
    for ((symbol, _), arg) in symbols.into_iter().zip(args).filter(|(_, arg)| arg.output) {
        put(m, symbol, &arg);
    }
}

/// Returns the values of a symbol, point after point.
fn taken(m: &Machine<'_>, symbol: SymbolId) -> ShadeopArg {
    let place = m.place(symbol);
    of_view(m, m.view(symbol), place.value, place.array.then_some(place.elements))
}

fn of_view(m: &Machine<'_>, view: View<'_>, value: ValueType, array: Option<u32>) -> ShadeopArg {
    let width = view.components * view.elements;
    let points = if view.varying { m.n } else { 1 };
    let lanes: Vec<Lane<'_>> = (0..width).map(|k| view.flat(k)).collect();
    let all = (0..points).flat_map(|i| lanes.iter().map(move |lane| lane.get(i)));
    let data = if value == ValueType::String {
        ShadeopData::Strings(all.map(|held| m.text(StringId::from_register(held)).clone()).collect())
    } else {
        ShadeopData::Floats(all.collect())
    };
    ShadeopArg { value, array, varying: view.varying, output: false, data }
}

/// Stores an argument after the call.
fn put(m: &mut Machine<'_>, symbol: SymbolId, arg: &ShadeopArg) {
    let width = arg.width();
    let mut out = m.out(arg.varying, width);
    let points = out.width;
    match &arg.data {
        ShadeopData::Floats(v) if v.len() >= width * points => {
            for (i, point) in v.chunks_exact(width.max(1)).take(points).enumerate() {
                point.iter().enumerate().for_each(|(k, v)| out.set(k, i, *v));
            }
        }
        ShadeopData::Strings(v) if v.len() >= width * points => {
            // Most neighbouring values are equal.
            let mut last: Option<(Arc<str>, StringId)> = None;
            for (at, text) in v.iter().take(width * points).enumerate() {
                let id = match &last {
                    Some((known, id)) if Arc::ptr_eq(known, text) => *id,
                    _ => m.intern(text),
                };
                last = Some((text.clone(), id));
                out.set_string(at % width, at / width, id);
            }
        }
        _ => return m.discard(out),
    }
    m.commit(symbol, out);
}

fn ones(v: Vec3) -> [[f32; 1]; 3] {
    [[v.x], [v.y], [v.z]]
}

fn numbers(options: &[(&str, OptionValue<'_>)]) -> Vec<[f32; 1]> {
    let number = |(_, value): &(&str, OptionValue<'_>)| match value {
        OptionValue::Number(v) => [*v],
        OptionValue::Text(_) => [0.0],
    };
    options.iter().map(number).collect()
}

impl Machinery<'_, '_> {
    /// Returns the point of the next lookup.
    fn turn(&mut self) -> [u32; 1] {
        let active = &self.machine.mask.active;
        let point = active.get(self.lookups % active.len().max(1)).copied().unwrap_or(0);
        self.lookups += 1;
        [point]
    }
}

impl ShadeopContext for Machinery<'_, '_> {
    fn points(&self) -> usize {
        self.machine.n
    }

    fn active(&self) -> &[u32] {
        &self.machine.mask.active
    }

    fn ray(&self) -> RayKind {
        self.machine.grid.ray
    }

    fn args(&mut self) -> &mut Vec<ShadeopArg> {
        &mut self.args
    }

    fn attribute(&mut self, name: &str) -> Option<Param> {
        self.machine.services.attribute(name)
    }

    fn texture_info(&mut self, texture: &str, name: &str) -> Option<Param> {
        self.machine.services.texture_info(texture, name)
    }

    fn complain(&mut self, what: &str) {
        let what = format!("shadeop `{}`: {what}", self.name);
        self.machine.complain(self.at, &what);
    }

    fn symbol(&mut self, name: &str) -> Option<usize> {
        let m = &*self.machine;
        let symbols = &m.code().module.symbols;
        let found = symbols
            .iter()
            .position(|s| matches!(s.kind, SymbolKind::Global(_) | SymbolKind::Param(_)) && *s.name == *name);
        let arg = match found {
            Some(k) => taken(m, SymbolId(k as u32)),
            None => {
                // Functions and statements of light read some globals implicitly.
                let global = Global::ALL.into_iter().find(|g| g.word() == name)?;
                let named = symbols.iter().any(|s| s.kind == SymbolKind::Global(global));
                if !named {
                    return None;
                }
                of_view(m, m.global(global), global.value_type(), None)
            }
        };
        self.args.push(arg);
        Some(self.args.len() - 1)
    }

    fn texture(&mut self, name: &str, at: [f32; 6], options: &[(&str, OptionValue<'_>)], out: &mut [f32]) {
        let active = self.turn();
        let (at, numbers) = (at.map(|v| [v]), numbers(options));
        let lane = |k: usize| Lane { values: &at[k][..], stride: 0 };
        let m = &mut *self.machine;
        let query = TextureQuery {
            batch: Batch { lanes: m.n, active: &active, layer: m.layer },
            name,
            handle: None,
            s: lane(0),
            t: lane(1),
            dsdx: lane(2),
            dtdx: lane(3),
            dsdy: lane(4),
            dtdy: lane(5),
            channels: channels(out),
            options: lookup_options(options, &numbers),
        };
        m.services.texture(&query, &mut self.result);
        give(&self.result.value, &self.result.alpha, active[0], out);
    }

    fn environment(&mut self, name: &str, at: Spot, options: &[(&str, OptionValue<'_>)], out: &mut [f32]) {
        let active = self.turn();
        let numbers = numbers(options);
        let (r, dx, dy) = (ones(at.at), ones(at.dx), ones(at.dy));
        let still = ones(Vec3::ZERO);
        let m = &mut *self.machine;
        let p = m.captured_global(Global::P);
        let query = EnvironmentQuery {
            batch: Batch { lanes: m.n, active: &active, layer: m.layer },
            name,
            handle: None,
            p: p.triple(),
            r: everywhere(&r),
            drdx: everywhere(&dx),
            drdy: everywhere(&dy),
            dpdx: everywhere(&still),
            dpdy: everywhere(&still),
            channels: channels(out),
            options: lookup_options(options, &numbers),
            messages: &[],
        };
        m.services.environment(&query, &mut self.result);
        m.discard(p);
        give(&self.result.value, &self.result.alpha, active[0], out);
    }

    fn shadow(&mut self, name: &str, at: Spot, options: &[(&str, OptionValue<'_>)], out: &mut [f32]) {
        let active = self.turn();
        let numbers = numbers(options);
        let (p, dx, dy) = (ones(at.at), ones(at.dx), ones(at.dy));
        let m = &mut *self.machine;
        // Inside `emit`, the vector from the point to the light.
        let mut to_light = Vec3::ZERO;
        if m.emission.inside {
            let i = active[0] as usize;
            let (l, pl) = (m.global(Global::L).triple(), m.global(Global::Pl).triple());
            to_light = if m.emission.infinite { l.get(i) } else { pl.get(i) - at.at };
        }
        let to_light = ones(to_light);
        let mut blocked = Lanes3::zeros(m.n);
        let query = ShadowQuery {
            batch: Batch { lanes: m.n, active: &active, layer: m.layer },
            name,
            handle: None,
            p: everywhere(&p),
            dpdx: everywhere(&dx),
            dpdy: everywhere(&dy),
            to_light: everywhere(&to_light),
            light_infinite: m.emission.infinite,
            options: lookup_options(options, &numbers),
            messages: &[],
        };
        m.services.shadow(&query, &mut blocked);
        let value = blocked.get(active[0] as usize);
        for (c, out) in out.iter_mut().enumerate() {
            *out = value[c.min(2)];
        }
    }
}

/// Returns the number of channels of a lookup, one or three.
fn channels(out: &[f32]) -> usize {
    if out.len() == 1 { 1 } else { 3 }
}

/// Copies the results of one point. A fourth value is alpha.
fn give(value: &[Vec<f32>], alpha: &[f32], point: u32, out: &mut [f32]) {
    for (c, out) in out.iter_mut().enumerate() {
        let channel = value.get(c).map_or(alpha, |channel| &channel[..]);
        *out = channel.get(point as usize).copied().unwrap_or(0.0);
    }
}

/// Sets options by name. Values stay in `numbers`. Unknown names are ignored.
fn lookup_options<'a, O: OptionTable<Lane<'a>, &'a str>>(
    options: &'a [(&'a str, OptionValue<'a>)],
    numbers: &'a [[f32; 1]],
) -> O {
    let mut o = O::default();
    for ((name, value), number) in options.iter().zip(numbers) {
        let text = match value {
            OptionValue::Text(text) => Some(*text).filter(|text| is_given(text)),
            OptionValue::Number(_) => None,
        };
        o.set(name, Some(Lane { values: &number[..], stride: 0 }), text);
    }
    o
}

/// Returns one value for all points.
fn everywhere(v: &[[f32; 1]; 3]) -> Lane3<'_> {
    Lane3 { xyz: std::array::from_fn(|c| Lane { values: &v[c][..], stride: 0 }) }
}
