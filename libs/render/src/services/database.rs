//! Spatial databases and subsurface scattering (reference 5.8.11, 5.8.13), for running shaders.

use super::Run;
use crate::subsurface::Profiles;
use granita_base::Severity;
use granita_gsl::ir::ValueType;
use granita_sdb::{Between, Density, Key, Mode, Packed, PictureOptions, Probe, Schema, Value};
use granita_shade::{DatabaseKey, DatabaseQuery, DatabaseSave, Lanes3, SubsurfaceQuery};

/// What records of these keys and values are; `None` for values that databases do not hold.
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

/// Where a lane's record lies; normals of unit length.
fn probe_of(key: &DatabaseKey<'_>, lane: usize) -> Probe {
    match key {
        DatabaseKey::Surface { s, t } => Probe { p: [s.get(lane), t.get(lane), 0.0], n: None },
        DatabaseKey::Point { p } => Probe { p: p.get(lane).to_array(), n: None },
        DatabaseKey::Oriented { p, n } => {
            Probe { p: p.get(lane).to_array(), n: Some(n.get(lane).normalize_or_zero().to_array()) }
        }
    }
}

/// See [`granita_shade::Services::spatialdb_save`].
pub(super) fn save(run: &Run<'_, '_>, query: &DatabaseSave<'_>) {
    // Shapes that are made for rays are shaded again where they are seen.
    let Some(schema) = schema_of(&query.key, query.value_type).filter(|_| run.thread.keeps_saved()) else {
        return;
    };
    let mode = run.frame.database_mode(query.name, query.filemode);
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
        records.extend_from_slice(&probe.p[..schema.key.dimensions()]);
        records.extend(probe.n.into_iter().flatten());
        records.extend(query.data.iter().map(|lanes| lanes.get(lane as usize)));
    }
    let size = |x: f32| if x >= 1.0 { x.min(65536.0) as u32 } else { 1 };
    let picture = query.resolution.map(|resolution| PictureOptions {
        resolution: resolution.map(size),
        data_format: query.filedataformat.to_owned(),
        filter_width: query.writefilterwidth,
    });
    run.frame.databases.save(query.name, schema, mode, picture.as_ref(), &records);
}

/// See [`granita_shade::Services::spatialdb_query`].
pub(super) fn query(
    run: &mut Run<'_, '_>,
    query: &DatabaseQuery<'_>,
    values: &mut [Vec<f32>],
    found: &mut [bool],
) {
    let Some(schema) = schema_of(&query.key, query.value_type) else { return };
    let mode = run.frame.database_mode(query.name, query.filemode);
    let Some(records) = run.frame.database(query.name, mode) else { return };
    if !fits(run, query.name, &records, schema) {
        return;
    }
    let dense = match query.filter {
        "areadensity" => true,
        "value" | "" => false,
        other => {
            let text =
                format!("spatialdbquery has no filter \"{other}\" (value, areadensity); \"value\" is taken");
            granita_shade::Services::say(run, Severity::Warning, &text);
            false
        }
    };
    for &lane in query.batch.active {
        let i = lane as usize;
        let probe = probe_of(&query.key, i);
        let minsamples = query.minsamples.get(i);
        let minsamples = if minsamples >= 1.0 { minsamples as usize } else { 1 };
        let (maxdist, maxerror) = (query.maxdist.get(i), query.maxerror.get(i));
        let value = if dense {
            records.density(&probe, &Density { minsamples, maxdist, maxerror })
        } else {
            records.between(&probe, &Between { minsamples, maxdist, maxerror, always: mode.readonly })
        };
        if let Some(value) = value {
            found[i] = true;
            for (values, v) in values.iter_mut().zip(value) {
                values[i] = v;
            }
        }
    }
}

/// Whether a database can be asked this way; what is wrong is said once.
fn fits(run: &mut Run<'_, '_>, name: &str, records: &Packed, wanted: Schema) -> bool {
    let there = records.schema();
    // A database of points and normals also knows where points are.
    let key = there.key == wanted.key || (there.key, wanted.key) == (Key::Oriented, Key::Point);
    let value = there.value.components() == wanted.value.components();
    if !key || !value {
        let text = format!(
            "spatial database \"{name}\" holds {}: nothing is found for {}",
            there.words(),
            wanted.words()
        );
        granita_shade::Services::say(run, Severity::Warning, &text);
    }
    key && value
}

/// See [`granita_shade::Services::subsurface`].
pub(super) fn subsurface(run: &mut Run<'_, '_>, query: &SubsurfaceQuery<'_>, out: &mut Lanes3) {
    let mode = Mode { read: true, ..run.frame.database_mode(query.name, "") };
    let Some((records, clusters)) = run.frame.clustered(query.name, mode) else { return };
    let (there, wanted) = (records.schema(), Schema { key: Key::Point, value: Value::Color });
    if there.key == Key::Surface || there.value.components() != 3 {
        fits(run, query.name, &records, wanted);
        return;
    }
    if !["", "dipole", "beam"].contains(&query.model) {
        let text = format!("subsurface has no model \"{}\" (dipole, beam); \"dipole\" is taken", query.model);
        granita_shade::Services::say(run, Severity::Warning, &text);
    }
    let mut profiles = Profiles::default();
    for &lane in query.batch.active {
        let i = lane as usize;
        let (scattering, absorption) = (query.scattering.get(i), query.absorption.get(i));
        let profile = profiles.get(query.model, scattering, absorption, query.eta.get(i));
        let p = query.p.get(i);
        if p.is_finite() {
            out.set(i, profile.gather(&records, &clusters, p, query.maxsolidangle.get(i)));
        }
    }
}
