//! Textures, environments, shadows and probes (reference 5.8.10, 5.8.11). Operands and options are passed to the
//! services, and results are stored under the mask.

use super::derive;
use super::{result_type, widen};
use crate::call::{Call, Options, Resolved};
use crate::link::Layer;
use crate::program::Op;
use crate::run::machine::{Machine, State, view};
use crate::run::store::{Mask, Out, View};
use crate::{
    Batch, EnvironmentQuery, GatherQuery, Group, Lane, Lanes3, ShadowQuery, Texture3dQuery, TextureQuery,
};
use granita_gsl::Func;
use granita_gsl::ir::{Global, SymbolId, ValueType};
use std::borrow::Cow;
use std::sync::Arc;

/// The parts of a machine that operands are read from, separate from the services.
pub(crate) struct Parts<'v> {
    group: &'v Group,
    layer: &'v Layer,
    state: &'v State,
    n: usize,
    mask: &'v Mask,
}

impl<'v> Parts<'v> {
    pub(crate) fn of(group: &'v Group, layer: usize, state: &'v State, n: usize, mask: &'v Mask) -> Self {
        Self { group, layer: &group.layers[layer], state, n, mask }
    }

    /// Returns the values of a symbol.
    pub(super) fn view(&self, sym: SymbolId) -> View<'v> {
        view(self.layer, self.group, &self.state.slots, self.n, sym)
    }

    /// Returns the numbers of an option.
    pub(crate) fn number(&self, sym: SymbolId) -> Lane<'v> {
        self.view(sym).lane(0)
    }

    /// Returns the first active lane.
    pub(super) fn first(&self) -> usize {
        self.mask.active.first().map_or(0, |&i| i as usize)
    }

    /// True when a symbol is a string.
    fn is_text(&self, sym: SymbolId) -> bool {
        self.layer.places[sym.0 as usize].value == ValueType::String
    }

    /// Returns the string of a symbol in the first active lane.
    pub(super) fn text(&self, sym: SymbolId) -> &'v str {
        let i = self.first();
        self.state.strings.text(&self.group.strings, self.view(sym).string(i))
    }

    /// Returns the text of an option of a lookup; `None` when it counts as not set.
    pub(crate) fn option_text(&self, sym: SymbolId) -> Option<&'v str> {
        Some(self.text(sym)).filter(|text| is_given(text))
    }
}

/// True when the text of an option of a lookup is neither empty nor "default".
pub(super) fn is_given(text: &str) -> bool {
    !text.is_empty() && text != "default"
}

impl<'a> Machine<'a> {
    /// Returns the operands and options of an operation that has options.
    pub(crate) fn call(&self, op: &Op) -> Option<&'a Call> {
        self.code().calls.get(op.call?.0 as usize)
    }

    /// Returns the options of a call, resolved at link time or by the current names.
    pub(crate) fn resolved<'c>(&self, call: &'c Call) -> Cow<'c, Resolved> {
        match call.resolved() {
            Some(resolved) => Cow::Borrowed(resolved),
            None => {
                let parts = Parts::of(self.group, self.layer, self.st, self.n, &self.mask);
                Cow::Owned(call.resolve(&|name| parts.text(name), &|value| parts.is_text(value)))
            }
        }
    }

    /// True when an option may be set. `is_given` holds for the names in the first active lane.
    fn may_be_given(&self, call: &Call, is_given: bool) -> bool {
        is_given || call.resolved().is_none() && call.names().any(|name| self.view(name).varying)
    }

    /// Reports the names of options that a call does not support.
    pub(super) fn complain_of_options(&mut self, op: &Op, unknown: &[String]) {
        if let (false, Some(func)) = (unknown.is_empty(), op.func()) {
            self.complain(op.at, &format!("{} has no option \"{}\"", func.word(), unknown.join("\", \"")));
        }
    }
}

/// Calls `f` for each name among the active lanes, with the mask narrowed to its lanes.
pub(super) fn for_each_name(
    m: &mut Machine<'_>,
    name: SymbolId,
    mut f: impl FnMut(&mut Machine<'_>, &Arc<str>),
) {
    if !m.view(name).varying {
        let text = m.string(name);
        return f(m, &text);
    }
    let mut all = m.borrow_mask();
    all.copy_from(&m.mask);
    let mut rest = m.borrow_mask();
    rest.copy_from(&m.mask);
    while let Some(&first) = rest.active.first() {
        let id = m.view(name).string(first as usize);
        let mut mask = std::mem::take(&mut m.mask);
        mask.copy_from(&rest);
        mask.retain(|i| m.view(name).string(i) == id);
        rest.retain(|i| !mask.on[i]);
        m.mask = mask;
        let text = m.text(id).clone();
        f(m, &text);
    }
    m.mask.copy_from(&all);
    m.return_mask(all);
    m.return_mask(rest);
}

/// `texture`, `texture3d`, `environment`, `shadow`.
pub(super) fn run(m: &mut Machine<'_>, func: Func, op: &Op) {
    let Some(call) = m.call(op) else { return };
    for_each_name(m, op.args[0], |m, name| {
        let resolved = m.resolved(call);
        let look = Look { call, name, resolved: &resolved };
        match func {
            Func::Texture => texture(m, op, &look),
            Func::Texture3d => texture3d(m, op, &look),
            Func::Environment => environment(m, op, &look),
            _ => shadow(m, op, &look),
        }
        m.complain_of_options(op, &resolved.unknown);
    });
}

/// One lookup of a call, in the lanes with the same name.
struct Look<'l> {
    call: &'l Call,
    name: &'l str,
    resolved: &'l Resolved,
}

/// Returns one or three channels, by the type of the result.
fn channels(m: &Machine<'_>, op: &Op) -> usize {
    result_type(m, op).map_or(1, |t| if t.is_triple() { 3 } else { 1 })
}

fn texture(m: &mut Machine<'_>, op: &Op, look: &Look<'_>) {
    let (Options::Texture(options), operands) = (&look.resolved.options, &look.call.operands) else { return };
    let (s, t) = (operands[1], operands[2]);
    // Differentials along u, then along v, or of s, then of t.
    let d: [Out; 4] = if operands.len() >= 7 {
        [operands[3], operands[4], operands[5], operands[6]].map(|k| m.captured(k))
    } else {
        let ([su, sv], [tu, tv]) = (derive::differences(m, s, 1), derive::differences(m, t, 1));
        [su, tu, sv, tv]
    };
    let channels = channels(m, op);
    let mut result = std::mem::take(&mut m.st.lookup);
    {
        let parts = Parts::of(m.group, m.layer, m.st, m.n, &m.mask);
        let query = TextureQuery {
            batch: Batch { lanes: m.n, active: &m.mask.active, layer: m.layer },
            name: look.name,
            handle: look.call.handle.as_ref(),
            s: parts.view(s).lane(0),
            t: parts.view(t).lane(0),
            dsdx: d[0].lane(0),
            dtdx: d[1].lane(0),
            dsdy: d[2].lane(0),
            dtdy: d[3].lane(0),
            channels,
            options: options.map(|s| parts.number(s), |s| parts.option_text(s)),
        };
        m.services.texture(&query, &mut result);
    }
    finish(m, op, &result.value);
    store_float(m, look.resolved.results.alpha, &result.alpha);
    m.st.lookup = result;
    d.into_iter().for_each(|out| m.discard(out));
}

fn texture3d(m: &mut Machine<'_>, op: &Op, look: &Look<'_>) {
    let (Options::Texture(options), operands) = (&look.resolved.options, &look.call.operands) else { return };
    let p = operands[1];
    let [du, dv] = derive::differences(m, p, 3);
    let channels = channels(m, op);
    let mut result = std::mem::take(&mut m.st.lookup);
    {
        let parts = Parts::of(m.group, m.layer, m.st, m.n, &m.mask);
        let query = Texture3dQuery {
            batch: Batch { lanes: m.n, active: &m.mask.active, layer: m.layer },
            name: look.name,
            handle: look.call.handle.as_ref(),
            p: parts.view(p).triple(),
            dpdx: du.triple(),
            dpdy: dv.triple(),
            channels,
            options: options.map(|s| parts.number(s), |s| parts.option_text(s)),
        };
        m.services.texture3d(&query, &mut result);
    }
    finish(m, op, &result.value);
    store_float(m, look.resolved.results.alpha, &result.alpha);
    m.st.lookup = result;
    m.discard(du);
    m.discard(dv);
}

fn environment(m: &mut Machine<'_>, op: &Op, look: &Look<'_>) {
    let (Options::Environment(options), operands) = (&look.resolved.options, &look.call.operands) else {
        return;
    };
    // (R), (P, R), (R, dRdx, dRdy) or (P, R, dRdx, dRdy).
    let (p, r, d) = match *operands.as_slice() {
        [_, r] => (None, r, None),
        [_, p, r] => (Some(p), r, None),
        [_, r, x, y] => (None, r, Some((x, y))),
        [_, p, r, x, y, ..] => (Some(p), r, Some((x, y))),
        _ => return,
    };
    let p = match p {
        Some(p) => m.captured(p),
        None => m.captured_global(Global::P),
    };
    let wants = !m.may_be_given(look.call, options.sample.is_some())
        || m.services.wants_footprint(look.name, Func::Environment);
    let [dpdx, dpdy] = if wants { differences_of(m, &p) } else { nothing(m) };
    let [drdx, drdy] = match d {
        Some((x, y)) => [m.captured(x), m.captured(y)],
        None if wants => derive::differences(m, r, 3),
        None => nothing(m),
    };
    let channels = channels(m, op);
    let messages = m.ray_messages(look.name);
    let mut result = std::mem::take(&mut m.st.lookup);
    {
        let parts = Parts::of(m.group, m.layer, m.st, m.n, &m.mask);
        let query = EnvironmentQuery {
            batch: Batch { lanes: m.n, active: &m.mask.active, layer: m.layer },
            name: look.name,
            handle: look.call.handle.as_ref(),
            p: p.triple(),
            r: parts.view(r).triple(),
            drdx: drdx.triple(),
            drdy: drdy.triple(),
            dpdx: dpdx.triple(),
            dpdy: dpdy.triple(),
            channels,
            options: options.map(|s| parts.number(s), |s| parts.option_text(s)),
            messages: &messages,
        };
        result.hitdist.clear();
        result.p_hit = Lanes3::default();
        result.n_hit = Lanes3::default();
        result.direction = Lanes3::default();
        m.services.environment(&query, &mut result);
    }
    finish(m, op, &result.value);
    store_float(m, look.resolved.results.alpha, &result.alpha);
    if let Some(dst) = look.resolved.results.hitdist {
        if result.hitdist.is_empty() {
            let mut far = m.out(false, 1);
            far.set(0, 0, 1e38);
            m.commit(dst, far);
        } else {
            store_float(m, Some(dst), &result.hitdist);
        }
    }
    store_triple(m, look.resolved.results.p_hit, &result.p_hit);
    store_triple(m, look.resolved.results.n_hit, &result.n_hit);
    store_triple(m, look.resolved.results.direction, &result.direction);
    m.st.lookup = result;
    for out in [p, dpdx, dpdy, drdx, drdy] {
        m.discard(out);
    }
}

/// Returns two differences of zero, which are not read.
fn nothing(m: &mut Machine<'_>) -> [Out; 2] {
    [(); 2].map(|()| {
        let mut out = m.out(false, 3);
        out.data.fill(0.0);
        out
    })
}

/// Returns the differences of values that are not of a symbol.
fn differences_of(m: &mut Machine<'_>, p: &Out) -> [Out; 2] {
    [derive::Direction::U, derive::Direction::V].map(|direction| {
        let mut out = m.out(p.varying, 3);
        for c in 0..3 {
            derive::difference(m, p.lane(c), direction, out.part(c));
        }
        out
    })
}

fn shadow(m: &mut Machine<'_>, op: &Op, look: &Look<'_>) {
    let (Options::Shadow(options), operands) = (&look.resolved.options, &look.call.operands) else { return };
    let p = operands[1];
    let [dpdx, dpdy] = if operands.len() >= 4 {
        [m.captured(operands[2]), m.captured(operands[3])]
    } else if m.may_be_given(look.call, options.samples.is_some())
        || m.services.wants_footprint(look.name, Func::Shadow)
    {
        derive::differences(m, p, 3)
    } else {
        nothing(m)
    };
    // The vector from p to the light: along L for an infinite light, else to the light's position.
    let emission = m.emission;
    let mut to_light = m.out(emission.inside, 3);
    to_light.data.fill(0.0);
    if emission.inside {
        let (l, pl, p) = (m.global(Global::L).triple(), m.global(Global::Pl).triple(), m.view(p).triple());
        m.work(true).each(|i| {
            let d = if emission.infinite { l.get(i) } else { pl.get(i) - p.get(i) };
            to_light.set3(i, d);
        });
    }
    // The half angle, as for other cones.
    let spread = [0.5 * emission.spread];
    let mut occluded = Lanes3::zeros(m.n);
    let messages = m.ray_messages(look.name);
    {
        let parts = Parts::of(m.group, m.layer, m.st, m.n, &m.mask);
        let mut options = options.map(|s| parts.number(s), |s: SymbolId| parts.option_text(s));
        // A broad distant light blurs its ray-traced shadows by default.
        if emission.spread > 0.0 && options.angle.is_none() && options.sblur.is_none() {
            options.angle = Some(Lane { values: &spread, stride: 0 });
        }
        let query = ShadowQuery {
            batch: Batch { lanes: m.n, active: &m.mask.active, layer: m.layer },
            name: look.name,
            handle: look.call.handle.as_ref(),
            p: parts.view(p).triple(),
            dpdx: dpdx.triple(),
            dpdy: dpdy.triple(),
            to_light: to_light.triple(),
            light_infinite: emission.infinite,
            options,
            messages: &messages,
        };
        m.services.shadow(&query, &mut occluded);
    }
    finish(m, op, &occluded.xyz);
    for out in [dpdx, dpdy, to_light] {
        m.discard(out);
    }
}

/// `indirect` and `occlusion`.
pub(super) fn probe(m: &mut Machine<'_>, func: Func, op: &Op) {
    let Some(call) = m.call(op) else { return };
    let operands = &call.operands;
    for_each_name(m, op.args[0], |m, set| {
        const HEMISPHERE: &[f32] = &[std::f32::consts::FRAC_PI_2];
        const ONE: &[f32] = &[1.0];
        let resolved = m.resolved(call);
        let Options::Gather(options) = &resolved.options else { return };
        let mut color = Lanes3::zeros(m.n);
        let mut blocked = vec![0.0; m.n];
        let messages = m.ray_messages(set);
        {
            let parts = Parts::of(m.group, m.layer, m.st, m.n, &m.mask);
            let options = options.map(|s| parts.number(s), |s| parts.option_text(s));
            let angle = match (func, operands.get(3)) {
                (Func::Occlusion, Some(&angle)) => parts.number(angle),
                _ => Lane { values: HEMISPHERE, stride: 0 },
            };
            let query = GatherQuery {
                batch: Batch { lanes: m.n, active: &m.mask.active, layer: m.layer },
                set,
                p: parts.view(operands[1]).triple(),
                axis: parts.view(operands[2]).triple(),
                angle,
                samples: options.samples.unwrap_or(Lane { values: ONE, stride: 0 }),
                options,
                messages: &messages,
            };
            if func == Func::Occlusion {
                m.services.occlusion(&query, &mut blocked, &mut color);
            } else {
                m.services.indirect(&query, &mut color);
            }
        }
        if func == Func::Occlusion {
            finish(m, op, std::slice::from_ref(&blocked));
            store_triple(m, operands.get(4).copied(), &color);
        } else {
            finish(m, op, &color.xyz);
        }
        m.complain_of_options(op, &resolved.unknown);
    });
}

/// Stores the value of a lookup, with as many channels as the result has components.
fn finish(m: &mut Machine<'_>, op: &Op, value: &[Vec<f32>]) {
    let Some(dst) = op.dst else { return };
    let components = m.type_of(dst).components().min(3);
    let mut out = m.out(true, components);
    for c in 0..components {
        match value.get(c.min(value.len().saturating_sub(1))).and_then(|v| v.get(..m.n)) {
            Some(values) => out.part(c).copy_from_slice(values),
            None => out.part(c).fill(0.0),
        }
    }
    widen(m, dst, &mut out, components);
    m.commit(dst, out);
}

/// Stores a float result into an option's variable.
fn store_float(m: &mut Machine<'_>, dst: Option<SymbolId>, values: &[f32]) {
    let Some(dst) = dst else { return };
    let mut out = m.out(true, 1);
    match values.get(..m.n) {
        Some(values) => out.part(0).copy_from_slice(values),
        None => out.part(0).fill(0.0),
    }
    widen(m, dst, &mut out, 1);
    m.commit(dst, out);
}

/// Stores a triple result into an option's variable, if there is one.
fn store_triple(m: &mut Machine<'_>, dst: Option<SymbolId>, values: &Lanes3) {
    let (Some(dst), true) = (dst, values.len() == m.n) else { return };
    let mut out = m.out(true, 3);
    for c in 0..3 {
        out.part(c).copy_from_slice(&values.xyz[c]);
    }
    widen(m, dst, &mut out, 3);
    m.commit(dst, out);
}
