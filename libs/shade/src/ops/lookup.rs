//! Textures, environments, shadows and probes (reference 5.8.10, 5.8.11): operands and options go to the
//! services, results come back under the mask.

use super::derive;
use super::{result_type, widen};
use crate::link::Layer;
use crate::run::machine::{Machine, State, view};
use crate::run::store::{Mask, Out, View};
use crate::{
    Batch, EnvironmentQuery, Group, Lane, Lanes3, LookupOptions, ShadowQuery, TextureQuery, TraceQuery,
};
use granita_gsl::Func;
use granita_gsl::ir::{Global, Op, SymbolId, ValueType};
use std::sync::Arc;

/// The parts of a machine that operands are read from, apart from the services.
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

    /// The values of a symbol.
    pub(super) fn view(&self, sym: SymbolId) -> View<'v> {
        view(self.layer, self.group, &self.state.slots, self.n, sym)
    }

    /// The first active lane.
    pub(super) fn first(&self) -> usize {
        self.mask.active.first().map_or(0, |&i| i as usize)
    }

    /// Whether a symbol is a string.
    pub(super) fn is_text(&self, sym: SymbolId) -> bool {
        self.layer.places[sym.0 as usize].value == ValueType::String
    }

    /// The string of a symbol in the first active lane.
    pub(super) fn text(&self, sym: SymbolId) -> &'v str {
        let i = self.first();
        self.state.strings.text(&self.group.strings, self.view(sym).get(i))
    }
}

/// Options of a call.
#[derive(Default)]
pub(crate) struct Parsed<'v> {
    pub(crate) options: LookupOptions<'v>,
    pub(crate) distribution: Option<&'v str>,
    /// Variables for results: alpha, hitdist, Phit, Nhit, direction.
    results: [Option<SymbolId>; 5],
    /// Names that nobody knows.
    unknown: Vec<&'v str>,
}

/// Sorts names and values. Strings, as file names, are those of the first active lane.
pub(crate) fn options<'v>(parts: &Parts<'v>, pairs: &[(SymbolId, SymbolId)]) -> Parsed<'v> {
    let mut parsed = Parsed::default();
    for &(name, value) in pairs {
        match parts.text(name) {
            "distribution" => {
                parsed.distribution = Some(parts.text(value)).filter(|t| !t.is_empty() && *t != "default");
            }
            "alpha" => parsed.results[0] = Some(value),
            "hitdist" => parsed.results[1] = Some(value),
            "Phit" => parsed.results[2] = Some(value),
            "Nhit" => parsed.results[3] = Some(value),
            "direction" => parsed.results[4] = Some(value),
            name => {
                let text = parts.is_text(value).then(|| parts.text(value));
                if !parsed.options.set(name, Some(parts.view(value).lane(0)), text) {
                    parsed.unknown.push(name);
                }
            }
        }
    }
    parsed
}

/// Splits operands into those before the first option and the pairs from it on.
pub(super) fn split(
    m: &Machine<'_>,
    args: &[SymbolId],
    from: usize,
) -> (Vec<SymbolId>, Vec<(SymbolId, SymbolId)>) {
    let options = (from..args.len()).find(|&k| m.type_of(args[k]) == ValueType::String).unwrap_or(args.len());
    let pairs = args[options..].chunks_exact(2).map(|p| (p[0], p[1])).collect();
    (args[..options].to_vec(), pairs)
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
        let id = m.view(name).get(first as usize);
        let mut mask = std::mem::take(&mut m.mask);
        mask.copy_from(&rest);
        mask.retain(|i| m.view(name).get(i) == id);
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
    let from = match func {
        Func::Texture => 3,
        _ => 2,
    };
    let (operands, pairs) = split(m, &op.args, from);
    for_each_name(m, op.args[0], |m, name| match func {
        Func::Texture => texture(m, op, name, &operands, &pairs),
        Func::Texture3d => texture3d(m, op, name, &operands, &pairs),
        Func::Environment => environment(m, op, name, &operands, &pairs),
        _ => shadow(m, op, name, &operands, &pairs),
    });
}

/// One or three channels, by the result.
fn channels(m: &Machine<'_>, op: &Op) -> usize {
    result_type(m, op).map_or(1, |t| if t.is_triple() { 3 } else { 1 })
}

fn texture(m: &mut Machine<'_>, op: &Op, name: &str, operands: &[SymbolId], pairs: &[(SymbolId, SymbolId)]) {
    let (s, t) = (operands[1], operands[2]);
    // Differentials along u, then along v; of s, then of t.
    let d: [Out; 4] = if operands.len() >= 7 {
        [operands[3], operands[4], operands[5], operands[6]].map(|k| m.captured(k))
    } else {
        let ([su, sv], [tu, tv]) = (derive::differences(m, s, 1), derive::differences(m, t, 1));
        [su, tu, sv, tv]
    };
    let channels = channels(m, op);
    let mut result = std::mem::take(&mut m.st.lookup);
    let (results, unknown) = {
        let parts = Parts::of(m.group, m.layer, m.st, m.n, &m.mask);
        let parsed = options(&parts, pairs);
        let query = TextureQuery {
            batch: Batch { lanes: m.n, active: &m.mask.active, layer: m.layer },
            name,
            s: parts.view(s).lane(0),
            t: parts.view(t).lane(0),
            dsdx: d[0].lane(0),
            dtdx: d[1].lane(0),
            dsdy: d[2].lane(0),
            dtdy: d[3].lane(0),
            channels,
            options: parsed.options,
        };
        m.services.texture(&query, &mut result);
        (parsed.results, unknown_text(&parsed))
    };
    finish(m, op, &result.value, unknown);
    store_float(m, results[0], &result.alpha);
    m.st.lookup = result;
    d.into_iter().for_each(|out| m.discard(out));
}

fn texture3d(
    m: &mut Machine<'_>,
    op: &Op,
    name: &str,
    operands: &[SymbolId],
    pairs: &[(SymbolId, SymbolId)],
) {
    let p = operands[1];
    let [du, dv] = derive::differences(m, p, 3);
    let channels = channels(m, op);
    let mut result = std::mem::take(&mut m.st.lookup);
    let (results, unknown) = {
        let parts = Parts::of(m.group, m.layer, m.st, m.n, &m.mask);
        let parsed = options(&parts, pairs);
        let p = parts.view(p).triple();
        let query = TextureQuery {
            batch: Batch { lanes: m.n, active: &m.mask.active, layer: m.layer },
            name,
            s: p.xyz[0],
            t: p.xyz[1],
            dsdx: du.lane(0),
            dtdx: du.lane(1),
            dsdy: dv.lane(0),
            dtdy: dv.lane(1),
            channels,
            options: parsed.options,
        };
        let differences = [&du, &dv].map(|d| crate::Lane3 { xyz: std::array::from_fn(|c| d.lane(c)) });
        m.services.texture3d(&query, p, differences, &mut result);
        (parsed.results, unknown_text(&parsed))
    };
    finish(m, op, &result.value, unknown);
    store_float(m, results[0], &result.alpha);
    m.st.lookup = result;
    m.discard(du);
    m.discard(dv);
}

fn environment(
    m: &mut Machine<'_>,
    op: &Op,
    name: &str,
    operands: &[SymbolId],
    pairs: &[(SymbolId, SymbolId)],
) {
    // (R), (P, R), (R, dRdx, dRdy) or (P, R, dRdx, dRdy).
    let (p, r, d) = match *operands {
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
    let wants = !has_option(m, pairs, "sample") || m.services.wants_footprint(name, Func::Environment);
    let [dpdx, dpdy] = if wants { differences_of(m, &p) } else { nothing(m) };
    let [drdx, drdy] = match d {
        Some((x, y)) => [m.captured(x), m.captured(y)],
        None if wants => derive::differences(m, r, 3),
        None => nothing(m),
    };
    let channels = channels(m, op);
    m.tell_rays(name);
    let mut result = std::mem::take(&mut m.st.lookup);
    let (results, unknown) = {
        let parts = Parts::of(m.group, m.layer, m.st, m.n, &m.mask);
        let parsed = options(&parts, pairs);
        let query = EnvironmentQuery {
            batch: Batch { lanes: m.n, active: &m.mask.active, layer: m.layer },
            name,
            p: p.triple(),
            r: parts.view(r).triple(),
            drdx: drdx.triple(),
            drdy: drdy.triple(),
            dpdx: dpdx.triple(),
            dpdy: dpdy.triple(),
            channels,
            options: parsed.options,
        };
        result.hitdist.clear();
        result.p_hit = Lanes3::default();
        result.n_hit = Lanes3::default();
        result.direction = Lanes3::default();
        m.services.environment(&query, &mut result);
        (parsed.results, unknown_text(&parsed))
    };
    finish(m, op, &result.value, unknown);
    store_float(m, results[0], &result.alpha);
    if let Some(dst) = results[1] {
        if result.hitdist.is_empty() {
            let mut far = m.out(false, 1);
            far.set(0, 0, 1e38);
            m.commit(dst, far);
        } else {
            store_float(m, Some(dst), &result.hitdist);
        }
    }
    store_triple(m, results[2], &result.p_hit);
    store_triple(m, results[3], &result.n_hit);
    store_triple(m, results[4], &result.direction);
    m.st.lookup = result;
    for out in [p, dpdx, dpdy, drdx, drdy] {
        m.discard(out);
    }
}

/// Whether an option of this name is among the pairs.
fn has_option(m: &Machine<'_>, pairs: &[(SymbolId, SymbolId)], name: &str) -> bool {
    pairs.iter().any(|(option, _)| m.view(*option).varying || *m.string(*option) == *name)
}

/// Two differences that nobody looks at.
fn nothing(m: &mut Machine<'_>) -> [Out; 2] {
    [(); 2].map(|()| {
        let mut out = m.out(false, 3);
        out.data.fill(0.0);
        out
    })
}

/// Differences of values that are no symbol's.
fn differences_of(m: &mut Machine<'_>, p: &Out) -> [Out; 2] {
    [derive::Direction::U, derive::Direction::V].map(|direction| {
        let mut out = m.out(p.varying, 3);
        for c in 0..3 {
            derive::difference(m, p.lane(c), direction, out.part(c));
        }
        out
    })
}

fn shadow(m: &mut Machine<'_>, op: &Op, name: &str, operands: &[SymbolId], pairs: &[(SymbolId, SymbolId)]) {
    let p = operands[1];
    let [dpdx, dpdy] = if operands.len() >= 4 {
        [m.captured(operands[2]), m.captured(operands[3])]
    } else if has_option(m, pairs, "samples") || m.services.wants_footprint(name, Func::Shadow) {
        derive::differences(m, p, 3)
    } else {
        nothing(m)
    };
    // From p to the light: along L of an infinite light, else to where the light is.
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
    // Half of it, as of other cones.
    let spread = [0.5 * emission.spread];
    let mut occluded = Lanes3::zeros(m.n);
    m.tell_rays(name);
    let unknown = {
        let parts = Parts::of(m.group, m.layer, m.st, m.n, &m.mask);
        let mut parsed = options(&parts, pairs);
        let o = &mut parsed.options;
        // A broad distant light blurs its ray-traced shadows by itself.
        if emission.spread > 0.0 && o.angle.is_none() && o.sblur.is_none() {
            o.angle = Some(Lane { values: &spread, stride: 0 });
        }
        let query = ShadowQuery {
            batch: Batch { lanes: m.n, active: &m.mask.active, layer: m.layer },
            name,
            p: parts.view(p).triple(),
            dpdx: dpdx.triple(),
            dpdy: dpdy.triple(),
            to_light: to_light.triple(),
            light_infinite: emission.infinite,
            options: parsed.options,
        };
        m.services.shadow(&query, &mut occluded);
        unknown_text(&parsed)
    };
    finish(m, op, &occluded.xyz, unknown);
    for out in [dpdx, dpdy, to_light] {
        m.discard(out);
    }
}

/// `indirect` and `occlusion`.
pub(super) fn probe(m: &mut Machine<'_>, func: Func, op: &Op) {
    let first_option = if func == Func::Occlusion { 4 } else { 3 };
    let (operands, pairs) = split(m, &op.args, first_option);
    for_each_name(m, op.args[0], |m, set| {
        const HEMISPHERE: &[f32] = &[std::f32::consts::FRAC_PI_2];
        const ONE: &[f32] = &[1.0];
        let mut color = Lanes3::zeros(m.n);
        let mut blocked = vec![0.0; m.n];
        m.tell_rays(set);
        let unknown = {
            let parts = Parts::of(m.group, m.layer, m.st, m.n, &m.mask);
            let parsed = options(&parts, &pairs);
            let angle = match (func, operands.get(3)) {
                (Func::Occlusion, Some(&angle)) => parts.view(angle).lane(0),
                _ => Lane { values: HEMISPHERE, stride: 0 },
            };
            let query = TraceQuery {
                batch: Batch { lanes: m.n, active: &m.mask.active, layer: m.layer },
                set,
                p: parts.view(operands[1]).triple(),
                axis: parts.view(operands[2]).triple(),
                angle,
                samples: parsed.options.samples.unwrap_or(Lane { values: ONE, stride: 0 }),
                sample: 0,
                distribution: parsed.distribution.unwrap_or("cosine"),
                options: parsed.options,
                wanted: &[],
            };
            if func == Func::Occlusion {
                m.services.occlusion(&query, &mut blocked, &mut color);
            } else {
                m.services.indirect(&query, &mut color);
            }
            unknown_text(&parsed)
        };
        if func == Func::Occlusion {
            finish(m, op, std::slice::from_ref(&blocked), unknown);
            store_triple(m, operands.get(4).copied(), &color);
        } else {
            finish(m, op, &color.xyz, unknown);
        }
    });
}

/// Names of unknown options, for a message.
fn unknown_text(parsed: &Parsed<'_>) -> Option<String> {
    (!parsed.unknown.is_empty()).then(|| parsed.unknown.join("\", \""))
}

/// Stores a looked-up value: as many channels as the result has components.
fn finish(m: &mut Machine<'_>, op: &Op, value: &[Vec<f32>], unknown: Option<String>) {
    if let (Some(names), granita_gsl::ir::OpCode::Call(func)) = (unknown, op.code) {
        m.complain(op.at, &format!("{} has no option \"{names}\"", func.word()));
    }
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

/// Stores a triple result into an option's variable; nothing when there is none.
fn store_triple(m: &mut Machine<'_>, dst: Option<SymbolId>, values: &Lanes3) {
    let (Some(dst), true) = (dst, values.len() == m.n) else { return };
    let mut out = m.out(true, 3);
    for c in 0..3 {
        out.part(c).copy_from_slice(&values.xyz[c]);
    }
    widen(m, dst, &mut out, 3);
    m.commit(dst, out);
}
