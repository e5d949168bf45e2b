//! Spatial databases and subsurface scattering (reference 5.8.11, 5.8.13). Operands and options are passed to the
//! services, and results are stored under the mask.

use super::lookup::{Parts, for_each_name};
use crate::call::Options;
use crate::program::Op;
use crate::run::machine::Machine;
use crate::run::store::Out;
use crate::services::{QueryOptions, SaveOptions, SubsurfaceOptions};
use crate::{Batch, DatabaseKey, DatabaseQuery, DatabaseSave, Lane, Lane3, Lanes3, Rect, SubsurfaceQuery};
use granita_gsl::ir::{SymbolId, ValueType};

/// The operands that give the place of a record.
#[derive(Clone, Copy)]
enum Key {
    Surface(SymbolId, SymbolId),
    Point(SymbolId),
    Oriented(SymbolId, SymbolId),
}

impl Key {
    /// Reads the key from the operands between name and data.
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

    /// Makes the key from the values of [`Key::symbols`].
    fn seen<'v>(self, values: &[Lane3<'v>]) -> DatabaseKey<'v> {
        match self {
            Self::Surface(..) => DatabaseKey::Surface { s: values[0].xyz[0], t: values[1].xyz[0] },
            Self::Point(_) => DatabaseKey::Point { p: values[0] },
            Self::Oriented(..) => DatabaseKey::Oriented { p: values[0], n: values[1] },
        }
    }
}

/// `spatialdbsave`, `spatialdbquery`, `subsurface`.
pub(super) fn run(m: &mut Machine<'_>, op: &Op) {
    let Some(call) = m.call(op) else { return };
    let operands = &call.operands[1..];
    let Some((&data, key)) = operands.split_last() else { return };
    for_each_name(m, op.args[0], |m, name| {
        let resolved = m.resolved(call);
        match (&resolved.options, Key::of(m, key)) {
            (Options::Subsurface(options), _) => {
                let [p, n] = [operands[0], operands[1]];
                subsurface(m, op, name, [p, n], options);
            }
            (Options::Save(options), Some(key)) => save(m, name, key, data, options),
            (Options::Query(options), Some(key)) => query(m, op, name, Ask { key, data, options }),
            _ => {}
        }
        m.complain_of_options(op, &resolved.unknown);
    });
}

fn save(
    m: &mut Machine<'_>,
    name: &str,
    key: Key,
    data: SymbolId,
    options: &SaveOptions<SymbolId, SymbolId>,
) {
    let components = m.type_of(data).components();
    let value_type = m.type_of(data);
    // "interpolate" saves one record in the centre of each facet instead of one at each point.
    let interpolate = options.interpolate.is_some_and(|s| m.view(s).get(m.first()) != 0.0);
    let facets = if interpolate { facets(m) } else { None };
    let mut symbols = key.symbols();
    symbols.push(data);
    let means: Option<Vec<Lanes3>> =
        facets.as_ref().map(|facets| symbols.iter().map(|&s| means(m, s, facets)).collect());
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
    let text = |option: Option<SymbolId>| option.map_or("", |s| parts.text(s));
    // Numbers are read from the first active lane.
    let first = parts.first();
    let pair = |s: SymbolId| [0, 1].map(|e| parts.view(s).lane_at(e, 0).get(first));
    let query = DatabaseSave {
        batch,
        name,
        key: key.seen(keys),
        data: &last.xyz[..components.min(3)],
        value_type,
        filemode: text(options.filemode),
        resolution: options.resolution.map(pair),
        filedataformat: text(options.filedataformat),
        writefilterwidth: options.writefilterwidth.map_or(2.0, |s| parts.view(s).get(first)),
    };
    m.services.spatialdb_save(&query);
}

/// Returns the corners of all facets whose four corners are active; `None` where points have no neighbours.
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

/// Returns the means of a symbol's components over facets.
fn means(m: &Machine<'_>, symbol: SymbolId, facets: &[[usize; 4]]) -> Lanes3 {
    let values = m.view(symbol).triple();
    let mean = |lane: Lane<'_>| {
        facets.iter().map(|corners| 0.25 * corners.iter().map(|&i| lane.get(i)).sum::<f32>()).collect()
    };
    Lanes3 { xyz: values.xyz.map(mean) }
}

/// The parameters of a database query.
struct Ask<'o> {
    key: Key,
    data: SymbolId,
    options: &'o QueryOptions<SymbolId, SymbolId>,
}

fn query(m: &mut Machine<'_>, op: &Op, name: &str, Ask { key, data, options }: Ask<'_>) {
    const ERROR: &[f32] = &[0.25];
    const DISTANCE: &[f32] = &[1.0];
    const SAMPLES: &[f32] = &[3.0];
    let uniform = |values| Lane { values, stride: 0 };
    let value_type = m.type_of(data);
    let components = value_type.components().min(3);
    let mut found = vec![false; m.n];
    let mut values = vec![vec![0.0; m.n]; components];
    {
        let parts = Parts::of(m.group, m.layer, m.st, m.n, &m.mask);
        let keys: Vec<Lane3<'_>> = key.symbols().iter().map(|&s| parts.view(s).triple()).collect();
        let options = options.map(|s| parts.number(s), |s| Some(parts.text(s)));
        let query = DatabaseQuery {
            batch: Batch { lanes: m.n, active: &m.mask.active, layer: m.layer },
            name,
            key: key.seen(&keys),
            value_type,
            maxerror: options.maxerror.unwrap_or(uniform(ERROR)),
            maxdist: options.maxdist.unwrap_or(uniform(DISTANCE)),
            minsamples: options.minsamples.unwrap_or(uniform(SAMPLES)),
            filter: options.filter.filter(|text| !text.is_empty()).unwrap_or("value"),
            filemode: options.filemode.unwrap_or(""),
        };
        m.services.spatialdb_query(&query, &mut values, &mut found);
    }
    // The variable stays unchanged where nothing was found.
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
    options: &SubsurfaceOptions<SymbolId, SymbolId>,
) {
    // Marble, per millimetre (reference 5.8.11).
    const SCATTERING: [&[f32]; 3] = [&[2.19], &[2.62], &[3.0]];
    const ABSORPTION: [&[f32]; 3] = [&[0.0021], &[0.0041], &[0.0071]];
    const ETA: &[f32] = &[1.5];
    const ANGLE: &[f32] = &[1.0];
    let uniform = |values| Lane { values, stride: 0 };
    let mut color = Lanes3::zeros(m.n);
    {
        let parts = Parts::of(m.group, m.layer, m.st, m.n, &m.mask);
        let triple = |option: Option<SymbolId>, marble: [&'static [f32]; 3]| match option {
            Some(s) => parts.view(s).triple(),
            None => Lane3 { xyz: marble.map(uniform) },
        };
        let number = |option: Option<SymbolId>, usual| option.map_or(uniform(usual), |s| parts.number(s));
        let query = SubsurfaceQuery {
            batch: Batch { lanes: m.n, active: &m.mask.active, layer: m.layer },
            name,
            p: parts.view(p).triple(),
            n: parts.view(n).triple(),
            scattering: triple(options.scattering, SCATTERING),
            absorption: triple(options.absorption, ABSORPTION),
            eta: number(options.eta, ETA),
            maxsolidangle: number(options.maxsolidangle, ANGLE),
            model: options.model.map_or("", |s| parts.text(s)),
        };
        m.services.subsurface(&query, &mut color);
    }
    let Some(dst) = op.dst else { return };
    let mut out = m.out(true, 3);
    for c in 0..3 {
        out.part(c).copy_from_slice(&color.xyz[c]);
    }
    super::widen(m, dst, &mut out, 3);
    m.commit(dst, out);
}
