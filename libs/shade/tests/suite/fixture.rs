//! A renderer for tests, with spaces, units, lights and textures whose results are known.

use granita_base::{Param, ParamData, ParamType, Params, Severity, Transform, Vec3};
use granita_gsl::ir::ValueType;
use granita_gsl::{CompileOptions, ValidModule, compile};
use granita_shade::*;
use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

/// Services whose results are known.
#[derive(Default)]
pub(crate) struct Double {
    pub(crate) said: Vec<(Severity, String)>,
    pub(crate) files: Vec<(String, String)>,
    pub(crate) lights: Vec<(Group, LightInfo)>,
    pub(crate) executor: Executor,
    /// The grid that is being shaded, for lights.
    pub(crate) grid: Option<Grid>,
    pub(crate) shadow_queries: Vec<(Vec3, bool, Option<f32>)>,
    /// True, for each query of a light, when only light from in front counts.
    pub(crate) in_front: Vec<bool>,
    pub(crate) asked: usize,
    /// The number of texture names that were looked up and kept.
    pub(crate) found: usize,
    /// The records of spatial databases: name, key, data.
    pub(crate) records: Vec<(String, Vec<f32>, Vec<f32>)>,
    /// The options of the last database call, as text.
    pub(crate) options: String,
    /// The set or map, and the names of the messages, of each query that may trace rays.
    pub(crate) told: Vec<(String, Vec<String>)>,
    /// True when the frame must end.
    pub(crate) is_stopped: bool,
    /// The value of the texture "level".
    pub(crate) level: f32,
    /// What is kept of runs, where it is kept.
    pub(crate) kept: Option<KeptParts>,
}

/// The parts of a shader that are kept, with what each depends on.
#[derive(Clone, Default)]
pub(crate) struct KeptParts {
    pub(crate) values: BTreeMap<u32, (Arc<PartValues>, BTreeSet<&'static str>)>,
    /// What was asked since the last part began.
    pub(crate) asked: BTreeSet<&'static str>,
    /// The parts that ran.
    pub(crate) ran: Vec<u32>,
}

/// Returns all numbers of a key.
fn numbers(key: DatabaseKey<'_>, i: usize) -> Vec<f32> {
    match key {
        DatabaseKey::Surface { s, t } => vec![s.get(i), t.get(i)],
        DatabaseKey::Point { p } => p.get(i).to_array().to_vec(),
        DatabaseKey::Oriented { p, n } => [p.get(i).to_array(), n.get(i).to_array()].concat(),
    }
}

impl Double {
    /// Notes that a part asked something.
    fn ask(&mut self, what: &'static str) {
        if let Some(kept) = &mut self.kept {
            kept.asked.insert(what);
        }
    }

    /// Records the messages of a query.
    fn note(&mut self, name: &str, messages: &[Primvar]) {
        self.told.push((name.to_owned(), messages.iter().map(|m| m.name.to_string()).collect()));
    }

    pub(crate) fn with_lights(sources: &[&str]) -> Self {
        let mut double = Self::default();
        for source in sources {
            let group = link(&[(source, Params::new())], &[]);
            let info = LightInfo {
                ambient: !group.has_emit(),
                category: group.param_string("__category").unwrap_or_default(),
            };
            double.lights.push((group, info));
        }
        double
    }

    pub(crate) fn errors(&self) -> Vec<&str> {
        self.said.iter().filter(|(s, _)| *s >= Severity::Warning).map(|(_, t)| t.as_str()).collect()
    }

    pub(crate) fn printed(&self) -> Vec<&str> {
        self.said.iter().filter(|(s, _)| *s == Severity::Message).map(|(_, t)| t.as_str()).collect()
    }
}

impl Spaces for Double {
    fn to_common(&mut self, space: &str, layer: usize) -> Option<Transform> {
        Some(match space {
            // Each layer has its own space, which is moved along x by its number plus ten.
            "shader" => Transform::translate(Vec3::X * (10.0 + layer as f32)),
            "world" | "object" | "camera" | "screen" | "raster" | "NDC" => Transform::IDENTITY,
            "double" => Transform::scale(Vec3::splat(2.0)),
            "turned" => Transform::rotate(std::f32::consts::FRAC_PI_2, Vec3::Z),
            "flat" => Transform::scale(Vec3::new(1.0, 1.0, 0.0)),
            "stretched" => Transform::scale(Vec3::new(1.0, 4.0, 2.0)),
            _ => return None,
        })
    }

    fn unit_scale(&mut self, from: &str, to: &str) -> Option<f32> {
        if [from, to].contains(&"s") {
            return matches!((from, to), ("s", "s" | "common") | ("common", "s")).then_some(1.0);
        }
        // One "common" unit is half a centimetre.
        let mm = |unit: &str| {
            Some(match unit {
                "mm" => 1.0,
                "cm" => 10.0,
                "m" => 1000.0,
                "common" => 5.0,
                _ => return None,
            })
        };
        Some(mm(from)? / mm(to)?)
    }
}

impl Textures for Double {
    fn texture(&mut self, q: &TextureQuery<'_>, out: &mut LookupResult) {
        self.asked += 1;
        self.ask("texture");
        if let Some(handle) = q.handle {
            let found = &mut self.found;
            let kept = handle.get_or_find(|| {
                *found += 1;
                Some(q.name.to_owned())
            });
            assert_eq!(kept.map(String::as_str), Some(q.name));
        }
        out.value.resize(q.channels, Vec::new());
        for (c, channel) in out.value.iter_mut().enumerate() {
            channel.resize(q.batch.lanes, f32::NAN);
            for &i in q.batch.active {
                let i = i as usize;
                channel[i] = match q.name {
                    "st" => [q.s.get(i), q.t.get(i), c as f32][c],
                    "level" => self.level + q.s.get(i),
                    "d" => [q.dsdx.get(i), q.dtdy.get(i), q.dtdx.get(i)][c],
                    "blur" => q.options.sblur.map_or(-1.0, |b| b.get(i)),
                    "wrap" => f32::from(q.options.swrap == Some("black") && q.options.twrap.is_some()),
                    _ => q.options.fill.map_or(0.0, |f| f.get(i)),
                };
            }
        }
        out.alpha.clear();
        out.alpha.resize(q.batch.lanes, 0.75);
    }

    fn environment(&mut self, q: &EnvironmentQuery<'_>, out: &mut LookupResult) {
        self.note(q.name, q.messages);
        out.value = (0..q.channels)
            .map(|c| (0..q.batch.lanes).map(|i| q.r.get(i)[c] + q.p.get(i)[c] * 100.0).collect())
            .collect();
        out.alpha = vec![0.5; q.batch.lanes];
        if q.name == "set" {
            out.hitdist = vec![3.0; q.batch.lanes];
            out.p_hit = Lanes3::splat(Vec3::X, q.batch.lanes);
        }
    }

    fn shadow(&mut self, q: &ShadowQuery<'_>, out: &mut Lanes3) {
        self.note(q.name, q.messages);
        let i = q.batch.active[0] as usize;
        self.shadow_queries.push((q.to_light.get(i), q.light_infinite, q.options.angle.map(|a| a.get(i))));
        for &i in q.batch.active {
            out.set(i as usize, Vec3::splat(0.25));
        }
    }

    fn texture_info(&mut self, texture: &str, name: &str) -> Option<Param> {
        (texture == "wood.tx" && name == "resolution").then(|| {
            Param::declared("float[2] x", ParamData::from(&[640.0, 480.0][..])).expect("a declaration")
        })
    }
}

impl Lights for Double {
    fn light_count(&mut self) -> usize {
        self.lights.len()
    }

    fn light_info(&mut self, index: usize) -> LightInfo {
        self.lights[index].1.clone()
    }

    fn light_asks(&mut self, index: usize) -> bool {
        self.lights[index].0.listens_to(granita_gsl::ir::ShaderKind::Surface)
    }

    fn illuminate(&mut self, index: usize, query: &IlluminateQuery<'_>) -> Arc<LightResult> {
        self.in_front.push(query.in_front);
        self.ask(if self.lights[index].1.ambient { "ambient" } else { "light" });
        let mut grid = self.grid.clone().expect("a grid for lights");
        grid.messages.extend_from_slice(query.messages);
        let mut executor = std::mem::take(&mut self.executor);
        let lights = std::mem::take(&mut self.lights);
        let result = executor.run_light(&lights[index].0, &grid, query, self);
        self.lights = lights;
        self.executor = executor;
        Arc::new(result)
    }
}

impl Rays for Double {
    fn queries_parent(&mut self, set: &str) -> bool {
        set == "curious"
    }

    fn indirect(&mut self, q: &GatherQuery<'_>, _: &mut Lanes3) {
        self.note(q.set, q.messages);
    }

    fn trace(&mut self, q: &TraceQuery<'_>, out: &mut TraceResult) {
        self.note(q.set, q.messages);
        let n = q.batch.lanes;
        out.hit = vec![q.sample.is_multiple_of(2); n];
        out.hitdist = vec![q.sample as f32 + 1.0; n];
        out.l = Lanes3::splat(Vec3::Z, n);
        out.ps = Lanes3::splat(Vec3::ZERO, n);
        out.cl = Lanes3::splat(Vec3::new(1.0, 0.5, 0.25), n);
        out.ol = Lanes3::splat(Vec3::ONE, n);
        out.p = Lanes3::splat(Vec3::Y, n);
    }
}

impl Databases for Double {
    fn spatialdb_save(&mut self, q: &DatabaseSave<'_>) {
        if q.name == "missing" {
            return self.unsupported("spatialdbsave");
        }
        self.options =
            format!("{} {:?} {} {}", q.filemode, q.resolution, q.filedataformat, q.writefilterwidth);
        for i in q.batch.active.iter().map(|&i| i as usize) {
            let data = q.data.iter().map(|lane| lane.get(i)).collect();
            self.records.push((q.name.to_owned(), numbers(q.key, i), data));
        }
    }

    fn spatialdb_query(&mut self, q: &DatabaseQuery<'_>, values: &mut [Vec<f32>], found: &mut [bool]) {
        if q.name == "missing" {
            return self.unsupported("spatialdbquery");
        }
        let first = q.batch.active[0] as usize;
        let tolerances = [q.maxerror, q.maxdist, q.minsamples].map(|lane| lane.get(first));
        self.options = format!("{} {} {tolerances:?}", q.filter, q.filemode);
        for i in q.batch.active.iter().map(|&i| i as usize) {
            let key = numbers(q.key, i);
            let here = |(name, k, data): &&(String, Vec<f32>, Vec<f32>)| {
                name == q.name && *k == key && data.len() == values.len()
            };
            if let Some((.., data)) = self.records.iter().find(here) {
                found[i] = true;
                values.iter_mut().zip(data).for_each(|(values, x)| values[i] = *x);
            }
        }
    }

    fn subsurface(&mut self, q: &SubsurfaceQuery<'_>, out: &mut Lanes3) {
        if q.name == "missing" {
            return self.unsupported("subsurface");
        }
        for i in q.batch.active.iter().map(|&i| i as usize) {
            let (s, a) = (q.scattering.get(i), q.absorption.get(i));
            let model = if q.model == "beam" { 10.0 } else { 0.0 };
            let last = q.eta.get(i) + q.maxsolidangle.get(i) + model;
            out.set(i, Vec3::new(s.x, a.y, last) + q.p.get(i) - q.n.get(i));
        }
    }
}

impl Messages for Double {
    fn append(&mut self, file: &str, text: &str) {
        self.files.push((file.to_owned(), text.to_owned()));
    }

    fn say(&mut self, severity: Severity, text: &str) {
        self.said.push((severity, text.to_owned()));
    }
}

impl Recall for Double {
    fn keeps_parts(&mut self) -> bool {
        self.kept.is_some()
    }

    fn is_part_kept(&mut self, part: u32) -> bool {
        self.kept.as_ref().is_some_and(|kept| kept.values.contains_key(&part))
    }

    fn recall_part(&mut self, part: u32) -> Option<Arc<PartValues>> {
        self.kept.as_ref()?.values.get(&part).map(|(values, _)| values.clone())
    }

    fn begin_part(&mut self, _: bool) {
        self.kept.iter_mut().for_each(|kept| kept.asked.clear());
    }

    fn end_part(&mut self, part: u32, reads: &[u32], values: &Arc<PartValues>) {
        let Some(kept) = &mut self.kept else { return };
        let mut depends = std::mem::take(&mut kept.asked);
        depends
            .extend(reads.iter().filter_map(|part| kept.values.get(part)).flat_map(|(_, depends)| depends));
        kept.values.insert(part, (values.clone(), depends));
        kept.ran.push(part);
    }
}

impl Host for Double {
    fn is_stopped(&mut self) -> bool {
        self.is_stopped
    }

    fn attribute(&mut self, name: &str) -> Option<Param> {
        let param = |ty: &str, data: ParamData| Param::declared(ty, data).ok();
        match name {
            "limits:eye" => param("int x", 7.into()),
            "user:name" => param("string x", "fred".into()),
            "user:tint" => param("color x", ParamData::from(&[1.0, 2.0, 3.0][..])),
            _ => None,
        }
    }
}

/// Compiles a source. An error fails the test with its messages.
pub(crate) fn module(source: &str) -> ValidModule {
    match compile(source, "test.gsl", &CompileOptions::default()) {
        Ok(compiled) => compiled.module,
        Err(list) => panic!("{source}\n{list:#?}"),
    }
}

/// Links layers named "a", "b" ... with connections "a.out -> b.in".
pub(crate) fn link(layers: &[(&str, Params)], connections: &[[&str; 4]]) -> Group {
    let (group, said) = link_saying(layers, connections);
    assert_eq!(said, Vec::<String>::new());
    group
}

/// Does the same as [`link`], and returns the messages that were reported.
pub(crate) fn link_saying(layers: &[(&str, Params)], connections: &[[&str; 4]]) -> (Group, Vec<String>) {
    const NAMES: [&str; 4] = ["a", "b", "c", "d"];
    let sources: Vec<LayerSource<'_>> = layers
        .iter()
        .zip(NAMES)
        .map(|((source, params), name)| LayerSource { module: module(source), params, name: Some(name) })
        .collect();
    let connections: Vec<ConnectionSource<'_>> = connections
        .iter()
        .map(|c| ConnectionSource { source_layer: c[0], source: c[1], target_layer: c[2], target: c[3] })
        .collect();
    let mut said = Vec::new();
    let group = Group::link(&sources, &connections, &mut |_, text| said.push(text)).expect("a group");
    (group, said)
}

/// Returns a unit square in z = 0 that faces the viewer at z = -infinity, with normals along -z.
pub(crate) fn square(nu: usize, nv: usize) -> Grid {
    let mut grid = Grid::new(Topology::Rect { nu, nv });
    for j in 0..nv {
        for i in 0..nu {
            let k = j * nu + i;
            let (u, v) = (i as f32 / (nu.max(2) - 1) as f32, j as f32 / (nv.max(2) - 1) as f32);
            grid.u[k] = u;
            grid.v[k] = v;
            grid.p.set(k, Vec3::new(u, v, 0.0));
        }
    }
    let n = nu * nv;
    grid.n = Lanes3::splat(-Vec3::Z, n);
    grid.ng = Lanes3::splat(-Vec3::Z, n);
    grid.i = Lanes3::splat(Vec3::Z, n);
    grid.dpdu = Lanes3::splat(Vec3::X, n);
    grid.dpdv = Lanes3::splat(Vec3::Y, n);
    grid.flip_normals = true;
    grid
}

/// Runs a group and returns one output, component after component.
pub(crate) fn output(
    group: &Group,
    grid: &mut Grid,
    services: &mut Double,
    name: &str,
    ty: ValueType,
) -> Vec<f32> {
    services.grid = Some(grid.clone());
    let mut results = Executor::new().run(group, grid, services, &[(name, ty)]);
    results.pop().flatten().unwrap_or_else(|| panic!("no output {name}"))
}

/// Runs a body `r = ...;` over a 3 x 2 square and returns `output float r`.
pub(crate) fn floats(body: &str) -> Vec<f32> {
    floats_with(body, &mut Double::default())
}

/// Does the same as [`floats`] with these services.
pub(crate) fn floats_with(body: &str, services: &mut Double) -> Vec<f32> {
    let source = format!("surface t (output float r = -1) {{ {body} }}");
    let group = link(&[(&source, Params::new())], &[]);
    output(&group, &mut square(3, 2), services, "r", ValueType::Float)
}

/// Returns a float value for a parameter.
pub(crate) fn param(name: &str, value: f32) -> Param {
    Param { name: name.into(), ty: ParamType::of(granita_base::BaseType::Float), data: value.into() }
}
