//! Answers requests for spatial databases and subsurface scattering (reference 5.8.11, 5.8.13).

use super::Run;
use crate::lighting::subsurface::{self, Point, Profiles};
use granita_base::Severity;
use granita_gsl::ir::ValueType;
use granita_sdb::{Between, Density, ImageOptions, Key, Mode, Packed, Probe, Schema, Value, along_curve};
use granita_shade::{DatabaseKey, DatabaseQuery, DatabaseSave, Lanes3, SubsurfaceQuery};
use std::sync::Arc;

/// Returns the schema of records with these keys and values; `None` for values that databases do not hold.
fn schema_of(key: &DatabaseKey<'_>, value: ValueType) -> Option<Schema> {
    let key = match key {
        DatabaseKey::Surface { .. } => Key::Surface,
        DatabaseKey::Point { .. } => Key::Point,
        DatabaseKey::Oriented { .. } => Key::Oriented,
    };
    let value = match value {
        ValueType::Float => Value::Float,
        ValueType::Color => Value::Color,
        ValueType::Point => Value::Point,
        ValueType::Vector => Value::Vector,
        ValueType::Normal => Value::Normal,
        _ => return None,
    };
    Some(Schema { key, value })
}

/// Returns the place of a lane's record, with a unit normal.
fn probe_of(key: &DatabaseKey<'_>, lane: usize) -> Probe {
    match key {
        DatabaseKey::Surface { s, t } => Probe { p: [s.get(lane), t.get(lane), 0.0], n: None },
        DatabaseKey::Point { p } => Probe { p: p.get(lane).to_array(), n: None },
        DatabaseKey::Oriented { p, n } => {
            Probe { p: p.get(lane).to_array(), n: Some(n.get(lane).normalize_or_zero().to_array()) }
        }
    }
}

/// The operations of one run of a shader over one grid on a database so far. Later calls of the run read them,
/// whatever other runs do.
#[derive(Default)]
pub(super) struct OwnDatabase {
    name: String,
    /// The last mode that a call set.
    mode: Option<Mode>,
    /// The records saved at the points of each rectangle of the grid, by the rectangle's index, and their schema.
    saved: Vec<(usize, Vec<f32>)>,
    schema: Option<Schema>,
    /// The same records in searchable form.
    packed: Vec<(usize, Arc<Packed>)>,
}

impl OwnDatabase {
    /// Returns the entry of a name, which is made on first use.
    fn of<'d>(list: &'d mut Vec<Self>, name: &str) -> &'d mut Self {
        let at = list.iter().position(|own| own.name == name).unwrap_or_else(|| {
            list.push(Self { name: name.to_owned(), ..Self::default() });
            list.len() - 1
        });
        &mut list[at]
    }

    /// Keeps a record that was saved at a point of a rectangle.
    fn keep(&mut self, rect: usize, schema: Schema, record: &[f32]) {
        if *self.schema.get_or_insert(schema) != schema {
            return;
        }
        self.packed.clear();
        match self.saved.iter_mut().find(|saved| saved.0 == rect) {
            Some(saved) => saved.1.extend_from_slice(record),
            None => self.saved.push((rect, record.to_vec())),
        }
    }

    /// Returns the records saved at the points of a rectangle.
    fn records(&mut self, rect: usize) -> Option<Arc<Packed>> {
        if let Some(known) = self.packed.iter().find(|packed| packed.0 == rect) {
            return Some(known.1.clone());
        }
        let saved = self.saved.iter().find(|saved| saved.0 == rect)?;
        let packed = Arc::new(Packed::new(self.schema?, &saved.1));
        self.packed.push((rect, packed.clone()));
        Some(packed)
    }
}

/// Returns the mode of a call: that of its option, else the one that an earlier call of the run set, else that of
/// the attributes.
fn mode_of(run: &mut Run<'_, '_>, name: &str, word: &str) -> Mode {
    let mode = run.frame.database_mode(name, word);
    if Mode::from_word(word).is_some_and(|given| given != Mode::default()) {
        OwnDatabase::of(&mut run.databases, name).mode = Some(mode);
        return mode;
    }
    run.databases.iter().find(|own| own.name == name).and_then(|own| own.mode).unwrap_or(mode)
}

/// Returns the index of the rectangle that contains a point, for queries of all points of the grid.
fn rect_number(run: &Run<'_, '_>, lanes: usize, lane: usize) -> Option<usize> {
    (lanes == run.topology.points())
        .then(|| run.topology.rects().position(|rect| rect.lanes().contains(&lane)))?
}

/// Implements [`granita_shade::Databases::spatialdb_save`].
pub(super) fn save(run: &mut Run<'_, '_>, query: &DatabaseSave<'_>) {
    // Geometry that is made for rays is shaded again where the camera sees it.
    let Some(schema) = schema_of(&query.key, query.value_type).filter(|_| run.thread.keeps_saved()) else {
        return;
    };
    let mode = mode_of(run, query.name, query.filemode);
    if mode.readonly {
        return;
    }
    let mut records = Vec::with_capacity(query.batch.active.len() * schema.numbers());
    for &lane in query.batch.active {
        // The neighbours of a hit exist for derivatives only.
        if run.centres.is_some_and(|n| lane >= n) {
            continue;
        }
        let probe = probe_of(&query.key, lane as usize);
        let first = records.len();
        records.extend_from_slice(&probe.p[..schema.key.dimensions()]);
        records.extend(probe.n.into_iter().flatten());
        records.extend(query.data.iter().map(|lanes| lanes.get(lane as usize)));
        let rect = rect_number(run, query.batch.lanes, lane as usize).filter(|_| !mode.writeonly);
        if let Some(rect) = rect.filter(|_| records[first..].iter().all(|x| x.is_finite())) {
            OwnDatabase::of(&mut run.databases, query.name).keep(rect, schema, &records[first..]);
        }
    }
    let size = |x: f32| if x >= 1.0 { x.min(65536.0) as u32 } else { 1 };
    let image = query.resolution.map(|resolution| ImageOptions {
        resolution: resolution.map(size),
        data_format: query.filedataformat.to_owned(),
        filter_width: query.writefilterwidth,
    });
    run.frame.databases.save(query.name, schema, mode, image.as_ref(), &records);
}

/// Implements [`granita_shade::Databases::spatialdb_query`].
pub(super) fn query(
    run: &mut Run<'_, '_>,
    query: &DatabaseQuery<'_>,
    values: &mut [Vec<f32>],
    found: &mut [bool],
) {
    let Some(schema) = schema_of(&query.key, query.value_type) else { return };
    let mode = mode_of(run, query.name, query.filemode);
    let before = run.frame.database(query.name, mode);
    let before = before.filter(|records| fits(run, query.name, records, schema));
    let has_own = run.databases.iter().any(|own| own.name == query.name && !own.saved.is_empty());
    if before.is_none() && !has_own {
        return;
    }
    let dense = match query.filter {
        "areadensity" => true,
        "value" | "" => false,
        other => {
            let text =
                format!("spatialdbquery has no filter \"{other}\" (value, areadensity); \"value\" is used");
            granita_shade::Messages::say(run, Severity::Warning, &text);
            false
        }
    };
    for &lane in query.batch.active {
        let i = lane as usize;
        let probe = probe_of(&query.key, i);
        let minsamples = query.minsamples.get(i);
        let minsamples = if minsamples >= 1.0 { minsamples as usize } else { 1 };
        let (maxdist, maxerror) = (query.maxdist.get(i), query.maxerror.get(i));
        let look = |records: &Packed| match dense {
            true => records.density(&probe, &Density { minsamples, maxdist, maxerror }),
            false => {
                records.between(&probe, &Between { minsamples, maxdist, maxerror, always: mode.readonly })
            }
        };
        let mut value = before.as_deref().and_then(look);
        if value.is_none()
            && has_own
            && let Some(rect) = rect_number(run, query.batch.lanes, i)
        {
            let own = OwnDatabase::of(&mut run.databases, query.name).records(rect);
            value = own.filter(|own| fits(run, query.name, own, schema)).as_deref().and_then(look);
        }
        if let Some(value) = value {
            found[i] = true;
            for (values, v) in values.iter_mut().zip(value) {
                values[i] = v;
            }
        }
    }
}

/// True when a database supports a query of this schema. Otherwise an error is reported once.
fn fits(run: &mut Run<'_, '_>, name: &str, records: &Packed, wanted: Schema) -> bool {
    let there = records.schema();
    // A database of points and normals also answers queries by point.
    let key = there.key == wanted.key || (there.key, wanted.key) == (Key::Oriented, Key::Point);
    let value = there.value.components() == wanted.value.components();
    if !key || !value {
        let text = format!(
            "spatial database \"{name}\" holds {}: nothing is found for {}",
            there.words(),
            wanted.words()
        );
        granita_shade::Messages::say(run, Severity::Warning, &text);
    }
    key && value
}

/// Implements [`granita_shade::Databases::subsurface`].
pub(super) fn subsurface(run: &mut Run<'_, '_>, query: &SubsurfaceQuery<'_>, out: &mut Lanes3) {
    let mode = Mode { read: true, ..run.frame.database_mode(query.name, "") };
    let Some((records, clusters)) = run.frame.clustered(query.name, mode) else { return };
    let (there, wanted) = (records.schema(), Schema { key: Key::Point, value: Value::Color });
    if there.key == Key::Surface || there.value.components() != 3 {
        fits(run, query.name, &records, wanted);
        return;
    }
    if !["", "dipole", "beam"].contains(&query.model) {
        let text = format!("subsurface has no model \"{}\" (dipole, beam); \"dipole\" is used", query.model);
        granita_shade::Messages::say(run, Severity::Warning, &text);
    }
    let mut profiles = Profiles::default();
    let active = query.batch.active.iter().map(|lane| *lane as usize);
    let all: Vec<usize> = active.filter(|i| query.p.get(*i).is_finite()).collect();
    // Neighbours take nearly the same records.
    let places: Vec<[f32; 3]> = all.iter().map(|i| query.p.get(*i).to_array()).collect();
    let all: Vec<usize> = along_curve(&places).into_iter().map(|k| all[k]).collect();
    for together in all.chunks(subsurface::TOGETHER) {
        let point = |&i: &usize| {
            let (scattering, absorption) = (query.scattering.get(i), query.absorption.get(i));
            let profile = profiles.get(query.model, scattering, absorption, query.eta.get(i));
            Point { p: query.p.get(i), max_solid_angle: query.maxsolidangle.get(i), profile }
        };
        let points: Vec<Point> = together.iter().map(point).collect();
        let light = subsurface::gather(&records, &clusters, &points);
        together.iter().zip(light).for_each(|(i, light)| out.set(*i, light));
    }
}
