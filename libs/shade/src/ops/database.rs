//! Spatial databases and subsurface scattering (reference 5.8.11, 5.8.13): operands and options go to the services,
//! results come back under the mask.

use super::lookup::{Parts, for_each_name, split};
use crate::run::machine::Machine;
use crate::run::store::Out;
use crate::{Batch, DatabaseKey, DatabaseQuery, DatabaseSave, Lane, Lane3, Lanes3, Rect, SubsurfaceQuery};
use granita_gsl::Func;
use granita_gsl::ir::{Op, SymbolId, ValueType};

/// Where a record lies: operands that are read.
#[derive(Clone, Copy)]
enum Key {
    Surface(SymbolId, SymbolId),
    Point(SymbolId),
    Oriented(SymbolId, SymbolId),
}

impl Key {
    /// From the operands between name and data.
    fn of(m: &Machine<'_>, operands: &[SymbolId]) -> Option<Self> {
        match *operands {
            [s, t] if m.type_of(s) == ValueType::Float => Some(Self::Surface(s, t)),
            [p] => Some(Self::Point(p)),
            [p, n] => Some(Self::Oriented(p, n)),
            _ => None,
        }
    }

    fn symbols(self) -> Vec<SymbolId> {
        match self {
            Self::Surface(s, t) => vec![s, t],
            Self::Point(p) => vec![p],
            Self::Oriented(p, n) => vec![p, n],
        }
    }

    /// From the values of [`Key::symbols`].
    fn seen<'v>(self, values: &[Lane3<'v>]) -> DatabaseKey<'v> {
        match self {
            Self::Surface(..) => DatabaseKey::Surface { s: values[0].xyz[0], t: values[1].xyz[0] },
            Self::Point(_) => DatabaseKey::Point { p: values[0] },
            Self::Oriented(..) => DatabaseKey::Oriented { p: values[0], n: values[1] },
        }
    }
}

/// `spatialdbsave`, `spatialdbquery`, `subsurface`.
pub(super) fn run(m: &mut Machine<'_>, func: Func, op: &Op) {
    let (operands, pairs) = split(m, &op.args, 3);
    let Some((&data, key)) = operands[1..].split_last() else { return };
    for_each_name(m, op.args[0], |m, name| match (func, Key::of(m, key)) {
        (Func::Subsurface, _) => subsurface(m, op, name, [operands[1], operands[2]], &pairs),
        (Func::SpatialDbSave, Some(key)) => save(m, op, name, key, data, &pairs),
        (_, Some(key)) => query(m, op, name, key, data, &pairs),
        _ => {}
    });
}

/// The numbers that options of a call have, as they are in the first active lane; `None` for strings.
struct Numbers<'v> {
    name: &'v str,
    lanes: Option<Lane3<'v>>,
    text: &'v str,
    pair: [f32; 2],
}

fn each_option<'v>(parts: &Parts<'v>, pairs: &[(SymbolId, SymbolId)]) -> Vec<Numbers<'v>> {
    let list = pairs.iter().map(|&(name, value)| {
        let view = parts.view(value);
        let is_text = parts.is_text(value);
        let i = parts.first();
        Numbers {
            name: parts.text(name),
            lanes: (!is_text).then(|| view.triple()),
            text: if is_text { parts.text(value) } else { "" },
            pair: if view.elements > 1 {
                [0, 1].map(|e| view.lane_at(e, 0).get(i))
            } else {
                [view.get(i); 2]
            },
        }
    });
    list.collect()
}

fn complain(m: &mut Machine<'_>, op: &Op, unknown: &[String]) {
    if let (false, granita_gsl::ir::OpCode::Call(func)) = (unknown.is_empty(), op.code) {
        m.complain(op.at, &format!("{} has no option \"{}\"", func.word(), unknown.join("\", \"")));
    }
}

fn save(m: &mut Machine<'_>, op: &Op, name: &str, key: Key, data: SymbolId, pairs: &[(SymbolId, SymbolId)]) {
    let components = m.type_of(data).components();
    let value_type = m.type_of(data);
    let mut unknown = Vec::new();
    // "interpolate": one record in the middle of each facet instead of one at each point.
    let interpolate = {
        let parts = Parts::of(m.group, m.layer, m.st, m.n, &m.mask);
        let i = parts.first();
        each_option(&parts, pairs)
            .iter()
            .any(|o| o.name == "interpolate" && o.lanes.is_some_and(|l| l.xyz[0].get(i) != 0.0))
    };
    let facets = if interpolate { facets(m) } else { None };
    let mut symbols = key.symbols();
    symbols.push(data);
    let means: Option<Vec<Lanes3>> =
        facets.as_ref().map(|facets| symbols.iter().map(|&s| means(m, s, facets)).collect());
    {
        let parts = Parts::of(m.group, m.layer, m.st, m.n, &m.mask);
        let values: Vec<Lane3<'_>> = match &means {
            Some(means) => means.iter().map(Lane3::over).collect(),
            None => symbols.iter().map(|&s| parts.view(s).triple()).collect(),
        };
        let all: Vec<u32>;
        let batch = match &facets {
            Some(facets) => {
                all = (0..facets.len() as u32).collect();
                Batch { lanes: facets.len(), active: &all, layer: m.layer }
            }
            None => Batch { lanes: m.n, active: &m.mask.active, layer: m.layer },
        };
        let (last, keys) = values.split_last().expect("invariant: data follows the key");
        let mut query = DatabaseSave {
            batch,
            name,
            key: key.seen(keys),
            data: &last.xyz[..components.min(3)],
            value_type,
            filemode: "",
            resolution: None,
            filedataformat: "",
            writefilterwidth: 2.0,
        };
        for option in each_option(&parts, pairs) {
            match option.name {
                "interpolate" => {}
                "filemode" => query.filemode = option.text,
                "resolution" => query.resolution = Some(option.pair),
                "filedataformat" => query.filedataformat = option.text,
                "writefilterwidth" => query.writefilterwidth = option.pair[0],
                other => unknown.push(other.to_owned()),
            }
        }
        m.services.spatialdb_save(&query);
    }
    complain(m, op, &unknown);
}

/// The corners of all facets whose four corners are active; `None` where points have no neighbours.
fn facets(m: &Machine<'_>) -> Option<Vec<[usize; 4]>> {
    let mut all = Vec::new();
    for Rect { first, nu, nv } in m.grid.topology.rects() {
        if nu < 2 || nv < 2 {
            return None;
        }
        let corners = |k: usize| {
            let at = first + k / (nu - 1) * nu + k % (nu - 1);
            [at, at + 1, at + nu, at + nu + 1]
        };
        let facets = (0..(nu - 1) * (nv - 1)).map(corners);
        all.extend(facets.filter(|c| c.iter().all(|&i| m.mask.on[i])));
    }
    m.grid.topology.rects().next().map(|_| all)
}

/// Means of a symbol's components over facets.
fn means(m: &Machine<'_>, symbol: SymbolId, facets: &[[usize; 4]]) -> Lanes3 {
    let values = m.view(symbol).triple();
    let mean = |lane: Lane<'_>| {
        facets.iter().map(|corners| 0.25 * corners.iter().map(|&i| lane.get(i)).sum::<f32>()).collect()
    };
    Lanes3 { xyz: values.xyz.map(mean) }
}

fn query(m: &mut Machine<'_>, op: &Op, name: &str, key: Key, data: SymbolId, pairs: &[(SymbolId, SymbolId)]) {
    const ERROR: &[f32] = &[0.25];
    const DISTANCE: &[f32] = &[1.0];
    const SAMPLES: &[f32] = &[3.0];
    let uniform = |values| Lane { values, stride: 0 };
    let value_type = m.type_of(data);
    let components = value_type.components().min(3);
    let mut found = vec![false; m.n];
    let mut values = vec![vec![0.0; m.n]; components];
    let mut unknown = Vec::new();
    {
        let parts = Parts::of(m.group, m.layer, m.st, m.n, &m.mask);
        let keys: Vec<Lane3<'_>> = key.symbols().iter().map(|&s| parts.view(s).triple()).collect();
        let mut query = DatabaseQuery {
            batch: Batch { lanes: m.n, active: &m.mask.active, layer: m.layer },
            name,
            key: key.seen(&keys),
            value_type,
            maxerror: uniform(ERROR),
            maxdist: uniform(DISTANCE),
            minsamples: uniform(SAMPLES),
            filter: "value",
            filemode: "",
        };
        for option in each_option(&parts, pairs) {
            let lane = option.lanes.map(|l| l.xyz[0]);
            match (option.name, lane) {
                ("maxerror", Some(lane)) => query.maxerror = lane,
                ("maxdist", Some(lane)) => query.maxdist = lane,
                ("minsamples", Some(lane)) => query.minsamples = lane,
                ("filter", None) if !option.text.is_empty() => query.filter = option.text,
                ("filter", None) => {}
                ("filemode", None) => query.filemode = option.text,
                (other, _) => unknown.push(other.to_owned()),
            }
        }
        m.services.spatialdb_query(&query, &mut values, &mut found);
    }
    complain(m, op, &unknown);
    // Where nothing was found the variable stays as it is.
    let mut out = m.out(true, components);
    {
        let old = m.view(data);
        for (c, values) in values.iter().enumerate() {
            for i in 0..m.n {
                out.set(c, i, if found[i] { values[i] } else { old.lane(c).get(i) });
            }
        }
    }
    m.commit(data, out);
    if let Some(dst) = op.dst {
        let mut out: Out = m.out(true, 1);
        for (i, found) in found.iter().enumerate() {
            out.set(0, i, f32::from(*found));
        }
        super::widen(m, dst, &mut out, 1);
        m.commit(dst, out);
    }
}

fn subsurface(
    m: &mut Machine<'_>,
    op: &Op,
    name: &str,
    [p, n]: [SymbolId; 2],
    pairs: &[(SymbolId, SymbolId)],
) {
    // Marble, per millimetre (reference 5.8.11).
    const SCATTERING: [&[f32]; 3] = [&[2.19], &[2.62], &[3.0]];
    const ABSORPTION: [&[f32]; 3] = [&[0.0021], &[0.0041], &[0.0071]];
    const ETA: &[f32] = &[1.5];
    const ANGLE: &[f32] = &[1.0];
    let uniform = |values| Lane { values, stride: 0 };
    let mut color = Lanes3::zeros(m.n);
    let mut unknown = Vec::new();
    {
        let parts = Parts::of(m.group, m.layer, m.st, m.n, &m.mask);
        let mut query = SubsurfaceQuery {
            batch: Batch { lanes: m.n, active: &m.mask.active, layer: m.layer },
            name,
            p: parts.view(p).triple(),
            n: parts.view(n).triple(),
            scattering: Lane3 { xyz: SCATTERING.map(uniform) },
            absorption: Lane3 { xyz: ABSORPTION.map(uniform) },
            eta: uniform(ETA),
            maxsolidangle: uniform(ANGLE),
            model: "",
        };
        for option in each_option(&parts, pairs) {
            match (option.name, option.lanes) {
                ("scattering", Some(lanes)) => query.scattering = lanes,
                ("absorption", Some(lanes)) => query.absorption = lanes,
                ("eta", Some(lanes)) => query.eta = lanes.xyz[0],
                ("maxsolidangle", Some(lanes)) => query.maxsolidangle = lanes.xyz[0],
                ("model", None) => query.model = option.text,
                (other, _) => unknown.push(other.to_owned()),
            }
        }
        m.services.subsurface(&query, &mut color);
    }
    complain(m, op, &unknown);
    let Some(dst) = op.dst else { return };
    let mut out = m.out(true, 3);
    for c in 0..3 {
        out.part(c).copy_from_slice(&color.xyz[c]);
    }
    super::widen(m, dst, &mut out, 3);
    m.commit(dst, out);
}
