// tidy: long: one set of traits is implemented here, with a short method for each request of a shader
//! Answers the requests of running shaders: the renderer's side of [`Services`](granita_shade::Services).
//!
//! A [`Run`] serves one run of one shader group over one grid. The requests for rays are in `services/rays.rs`,
//! shadows in `services/shadow.rs`, indirect light and occlusion in `services/light.rs`, and maps in
//! `services/maps.rs`. `services/albedo.rs` has those of shaders that show their albedo. This file has the others.
//! Answers that are kept for re-renders are found in `services/recall.rs`.

mod albedo;
mod database;
mod grids;
mod light;
pub(crate) mod maps;
mod origins;
mod rays;
pub(crate) mod recall;
mod seeds;
mod shadow;
mod sky;
mod tiles;

use crate::lighting::area::{self, AreaLight};
use crate::lighting::lights::{LightMemory, LightState, mend};
use crate::memo::{Answer, Dependencies, Dependency};
use crate::object::RayScene;
use crate::object::{LinkedShaders, ObjectState, usage_word};
use crate::texts;
use crate::{ShaderThread, ShadingContext};
use granita_base::sample::Draw;
use granita_base::{
    BaseType, Location, NoiseSource, Param, ParamData, ParamType, Severity, Transform, Vec3, hash, suggestion,
};
use granita_dicing::finite;
use granita_gsl::Func;
use granita_scene::{AttributeSet, LightId, ShaderUsage, attr};
use granita_shade::{
    Batch, DatabaseQuery, DatabaseSave, Databases, EnvironmentQuery, GatherQuery, Grid, Host,
    IlluminateQuery, Lane, Lane3, Lanes3, LightInfo, LightResult, Lights, LookupResult, Messages,
    NativeCompiler, RayKind, RayPath, Rays, Shadeop, ShadowQuery, Spaces, SubsurfaceQuery, Texture3dQuery,
    TextureQuery, Textures, Topology, TraceQuery, TraceResult,
};
use granita_texture::Wrap;
use grids::{coincident, rims, seen_by_lights};
use recall::{Asked, Question};
use seeds::{LaneSeeds, LightSeeds};
use std::cell::OnceCell;
use std::sync::Arc;

/// Hashed with lane seeds for places on area lights.
const AREA: u32 = 0xa9ea;
/// Hashed with lane seeds for directions sampled from maps.
const SKY: u32 = 0x5c1e;

/// A run of a light that runs several times, to draw more directions from a map than its shader requests.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Repeat {
    /// The number of this run.
    run: u32,
    /// The number of runs.
    of: u32,
}

impl Repeat {
    /// A light that runs once.
    const ONCE: Self = Self { run: 0, of: 1 };
    /// The largest number of runs.
    const MOST: u32 = 1024;

    /// Returns the number of its first call, so that runs draw different random numbers.
    fn first_call(self) -> u32 {
        self.run << 16
    }
}

/// The offset from flat faces to the smooth surface that their normals describe.
struct Lift {
    p: Lanes3,
    n: Lanes3,
    by: Arc<[Lanes3; 2]>,
}

impl Lift {
    /// Returns the point of the smooth surface over a point of the grid, on the side of a direction. Returns the
    /// point itself when it is not of the grid.
    fn above(&self, lane: usize, p: Vec3, toward: Vec3) -> Vec3 {
        let bits = |v: Vec3| v.to_array().map(f32::to_bits);
        if bits(self.p.get(lane)) != bits(p) {
            return p;
        }
        let below = toward.dot(self.n.get(lane)) < 0.0;
        p + self.by[usize::from(below)].get(lane)
    }
}

/// The surface at the points of a grid, for the rays that leave it.
struct SurfaceLanes {
    /// Vectors from the viewing position.
    i: Lanes3,
    /// Geometric normals.
    ng: Lanes3,
    /// The id of the primitive of each rectangle.
    primitives: Vec<u32>,
}

impl SurfaceLanes {
    /// Returns the points of a grid. `None` when no ray is traced.
    fn of(grid: &Grid, frame: &ShadingContext) -> Option<Arc<Self>> {
        let traces = !grid.ray.shadow && frame.rays.has_sets();
        traces.then(|| {
            let (i, ng) = (grid.i.clone(), grid.ng.clone());
            Arc::new(Self { i, ng, primitives: grid.primitives.clone() })
        })
    }
}

/// One run of one shader group over one grid.
pub(crate) struct Run<'r, 'f> {
    thread: &'r mut ShaderThread<'f>,
    frame: &'f ShadingContext,
    /// The shaders that run.
    shaders: &'r LinkedShaders,
    /// The attributes that the shader sees: the object's, or those of the light.
    attributes: &'r AttributeSet,
    /// The attributes of the object.
    object_attributes: &'r AttributeSet,
    /// The object.
    object: &'r ObjectState,
    /// The points of the grid, and the offset from them to the smooth surface ([`Grid::lift`]).
    lift: Option<Arc<Lift>>,
    /// The neighbour relation of the points of the grid.
    topology: Topology,
    /// For each rectangle of the grid, which sides are boundary edges of its surface: first and last along u, first
    /// and last along v.
    rims: Arc<[[bool; 4]]>,
    /// Coincident lanes with the earlier lane at the same point. They lie on sides of rectangles that are single
    /// points.
    coincident: Arc<[(u32, u32)]>,
    /// The name of the object or the light, for messages.
    owner: Arc<str>,
    shadow_bias: f32,
    /// True when rays see motion.
    ray_motion: bool,
    /// The lights that may be queried. There are none inside a light, and none for a ray that needs opacity only.
    lights: Arc<[LightId]>,
    /// The grid that the lights read.
    lit: Option<Grid>,
    memory: LightMemory,
    time: f32,
    dtime: f32,
    ray: RayKind,
    seed: u32,
    seeds: LaneSeeds<'r>,
    /// For ray hits, the path to each lane ([`Grid::paths`]).
    paths: Arc<[RayPath]>,
    /// The surface, where rays may be traced.
    surface: Option<Arc<SurfaceLanes>>,
    /// The number of hits, when the grid consists of hits and their neighbours.
    centres: Option<u32>,
    /// The number of calls that drew random numbers so far. Two calls of one shader draw different ones.
    calls: u32,
    /// The same for each light, by its index.
    light_calls: Vec<u32>,
    /// The same for each lane with its own seed, so that other lanes of its grid have no influence.
    lane_calls: Vec<u32>,
    /// True for a light whose contribution counts only from directions in front of the points.
    gathers_in_front: bool,
    /// Batches of directions sampled from maps. The last one is the one used last.
    sky: Vec<sky::SampleBatch>,
    /// Which of several runs of a light it serves.
    repeat: Repeat,
    /// Its operations on spatial databases.
    databases: Vec<database::OwnDatabase>,
    /// The number of texts that `fprintf` wrote so far.
    appended: u32,
    /// True for a light whose answers are not kept for re-renders.
    is_anew: bool,
    /// The key of a grid of ray hits.
    hits: Option<[u64; 2]>,
    /// What the run depended on before the part of a shader that runs.
    part: Option<Dependencies>,
    /// True when a shader shows its albedo ([`ShaderThread::shows_albedo`]).
    shows_albedo: bool,
}

impl<'r, 'f> Run<'r, 'f> {
    /// Serves surface, displacement and volume shaders of an object.
    pub(crate) fn for_object(
        thread: &'r mut ShaderThread<'f>,
        object: &'r ObjectState,
        shaders: &'r LinkedShaders,
        grid: &Grid,
    ) -> Self {
        let shows_albedo = thread.shows_albedo && shaders.usage != ShaderUsage::Displacement;
        let gathers = shaders.usage != ShaderUsage::Displacement && !grid.ray.shadow && !thread.is_unlit;
        let lights = if gathers && !shows_albedo { object.lights() } else { Arc::default() };
        let frame = thread.frame();
        let thread_keeps = thread.memo.is_some();
        Self {
            frame,
            thread,
            shaders,
            attributes: &object.attributes,
            object_attributes: &object.attributes,
            object,
            lift: grid.lift.clone().map(|by| Arc::new(Lift { p: grid.p.clone(), n: grid.n.clone(), by })),
            topology: grid.topology.clone(),
            rims: rims(grid),
            coincident: coincident(grid),
            owner: object.name.clone(),
            shadow_bias: object.shadow_bias,
            ray_motion: object.ray_motion,
            lit: (!lights.is_empty()).then(|| seen_by_lights(grid, frame, &lights)),
            lights,
            hits: if thread_keeps { recall::key_of_hits(grid, object.number) } else { None },
            is_anew: false,
            memory: LightMemory::default(),
            time: grid.time,
            dtime: grid.dtime,
            ray: grid.ray,
            seed: grid.seed,
            seeds: LaneSeeds::of_grid(grid),
            paths: grid.paths.clone(),
            surface: SurfaceLanes::of(grid, frame),
            centres: match grid.topology {
                Topology::Triplets { n } => Some(n as u32).filter(|n| *n > 0),
                _ => None,
            },
            calls: 0,
            light_calls: Vec::new(),
            lane_calls: vec![0; grid.names.len()],
            gathers_in_front: false,
            sky: Vec::new(),
            repeat: Repeat::ONCE,
            databases: Vec::new(),
            appended: 0,
            part: None,
            shows_albedo,
        }
    }

    /// Serves a light that shines on the grid of `surface` for the sample `index` of a query.
    fn for_light(
        surface: &'r mut Run<'_, 'f>,
        light: &'r LightState,
        query: &IlluminateQuery<'r>,
        (index, repeat): (u32, Repeat),
    ) -> Self {
        Self {
            frame: surface.frame,
            thread: surface.thread,
            shaders: &light.shaders,
            attributes: &light.attributes,
            object_attributes: surface.object_attributes,
            object: surface.object,
            lift: surface.lift.clone(),
            topology: surface.topology.clone(),
            rims: surface.rims.clone(),
            coincident: surface.coincident.clone(),
            owner: light.name.clone(),
            // The points are the object's, so its attributes and those around it have precedence over those of the
            // light.
            shadow_bias: match surface.object_attributes.is_set(attr::SHADOW_BIAS) {
                true => surface.object.shadow_bias,
                false => light.shadow_bias,
            },
            ray_motion: surface.ray_motion,
            lights: Arc::default(),
            lit: None,
            hits: surface.hits,
            is_anew: light.is_anew,
            memory: LightMemory::default(),
            time: surface.time,
            dtime: surface.dtime,
            ray: surface.ray,
            seed: hash::words(&[surface.seed, light.seed, surface.calls]),
            lane_calls: vec![repeat.first_call(); surface.lane_calls.len()],
            seeds: LaneSeeds {
                own: OnceCell::new(),
                of_light: surface.seeds.list().map(|base| LightSeeds::new(base, light.seed, query, index)),
            },
            paths: surface.paths.clone(),
            surface: surface.surface.clone(),
            centres: surface.centres,
            calls: repeat.first_call(),
            light_calls: Vec::new(),
            gathers_in_front: query.in_front,
            sky: Vec::new(),
            repeat,
            databases: Vec::new(),
            appended: 0,
            part: None,
            shows_albedo: false,
        }
    }

    /// Runs a light once. `index` is the number of the sample.
    fn run_light(
        &mut self,
        light: &LightState,
        grid: &Grid,
        query: &IlluminateQuery<'_>,
        index: u32,
    ) -> LightResult {
        self.repeat_light(light, grid, query, (index, Repeat::ONCE)).0
    }

    /// Returns the mean of several runs of a light, with as many more directions as "render:samples" requests, when it
    /// draws any from a map. Any other light runs once.
    fn drawing_light(&mut self, light: &LightState, grid: &Grid, query: &IlluminateQuery<'_>) -> LightResult {
        let of = (self.frame.samples().ceil() as u32).clamp(1, Repeat::MOST);
        let (first, draws) = self.repeat_light(light, grid, query, (0, Repeat { run: 0, of }));
        if of == 1 || !draws {
            return first;
        }
        let mut sum = LightResult::default();
        let share = 1.0 / of as f32;
        add_share(&mut sum, first, share);
        for run in 1..of {
            let (one, _) = self.repeat_light(light, grid, query, (0, Repeat { run, of }));
            add_share(&mut sum, one, share);
        }
        sum
    }

    /// Runs a light (see [`Run::for_light`]). Returns true when it drew directions from a map.
    fn repeat_light(
        &mut self,
        light: &LightState,
        grid: &Grid,
        query: &IlluminateQuery<'_>,
        which: (u32, Repeat),
    ) -> (LightResult, bool) {
        let mut executor = self.thread.take_executor(light.shaders.usage);
        let (mut result, draws) = {
            let mut services = Run::for_light(self, light, query, which);
            let result = executor.run_light(&light.shaders.group, grid, query, &mut services);
            (result, !services.sky.is_empty())
        };
        self.thread.put_executor(executor);
        if mend(&mut result, query.batch.active) {
            self.frame.reporter.once(
                &format!("not finite light {}", light.name),
                Severity::Warning,
                &Location::default(),
                format!(
                    "light \"{}\": its shader gave {}",
                    light.name,
                    finite::reason("colour or direction")
                ),
            );
        }
        (result, draws)
    }

    /// Returns the mean of several runs of a light, each with a point on the light's surface for every lane.
    fn area_light(
        &mut self,
        light: &LightState,
        area: &AreaLight,
        grid: &Grid,
        query: &IlluminateQuery<'_>,
    ) -> LightResult {
        let mut sum = LightResult::default();
        if self.thread.builds_rays {
            return sum;
        }
        let Some(scene) = self.frame.rays.scene(&area.set, self.frame) else {
            rays::unknown_set(self, &area.set);
            return sum;
        };
        let (call, names) = (self.calls, self.seeds_for(light.seed, query));
        let (mut pl, mut nl) = (Lanes3::zeros(grid.len()), Lanes3::zeros(grid.len()));
        let count = samples(area.samples, self.frame.samples());
        let share = 1.0 / count as f32;
        let active = query.batch.active;
        let draws: Vec<Draw> =
            (0..query.batch.lanes).map(|lane| self.draw_of_light(light, &names, call, lane)).collect();
        self.frame.draws(NoiseSource::Lights);
        for index in 0..count {
            let draw = |lane: u32| draws[lane as usize];
            if !area::points(scene, self.thread, [index, count], active, &draw, [&mut pl, &mut nl]) {
                return sum;
            }
            let query = IlluminateQuery { pl: Some(Lane3::over(&pl)), nl: Some(Lane3::over(&nl)), ..*query };
            let one = self.run_light(light, grid, &query, index);
            add_share(&mut sum, one, share);
            // The next run draws other numbers. Lanes with their own seeds differ by their index.
            self.calls += 1;
        }
        sum
    }

    /// Returns the mean of several runs of a broad light, each with a direction within its spread for every lane.
    /// Any other light runs once.
    fn broad_light(&mut self, light: &LightState, grid: &Grid, query: &IlluminateQuery<'_>) -> LightResult {
        let (call, names) = (self.calls, self.seeds_for(light.seed, query));
        let count = samples(light.samples, self.frame.samples());
        let share = 1.0 / count as f32;
        let mut sum = LightResult::default();
        let mut places = [vec![0.0; query.batch.lanes], vec![0.0; query.batch.lanes]];
        for index in 0..count {
            for &lane in query.batch.active {
                let (x, y) = self.draw_of_light(light, &names, call, lane as usize).square(index, count);
                (places[0][lane as usize], places[1][lane as usize]) = (x, y);
            }
            let cone = places.each_ref().map(|values| Lane { values, stride: 1 });
            let query = IlluminateQuery { cone: Some(cone), ..*query };
            let one = self.run_light(light, grid, &query, index);
            if index == 0 && !one.broad {
                return one;
            }
            self.frame.draws(NoiseSource::Lights);
            add_share(&mut sum, one, share);
            self.calls += 1;
        }
        sum
    }

    /// Returns what a lane draws for the samples of a light. `names` are the seeds of the lanes for the light.
    fn draw_of_light(&self, light: &LightState, names: &[u32], call: u32, lane: usize) -> Draw {
        let (first, part) = self.part_of(lane);
        let seed = match names.get(first) {
            Some(name) => hash::words(&[*name, light.seed, AREA]),
            None => hash::words(&[self.seed, call, light.seed, first as u32]),
        };
        Draw { sequence: self.frame.sequence(self.frame.varied_seed(NoiseSource::Lights, seed)), part }
    }

    /// Returns the seed of a lane for the next random call, which draws for `source`.
    fn lane_seed(&self, source: NoiseSource, call: u32, lane: u32) -> u32 {
        self.frame.seed_of(source, self.call_seed(call, lane))
    }

    /// Returns the seed of a lane for the next call, when the call itself draws nothing and only passes it on.
    fn call_seed(&self, call: u32, lane: u32) -> u32 {
        match self.seeds.of(lane as usize) {
            Some(seed) => hash::words(&[seed, self.lane_calls[lane as usize]]),
            None => hash::words(&[self.seed, call, lane]),
        }
    }

    /// Counts a call that draws random numbers.
    fn next_call(&mut self, active: &[u32]) -> u32 {
        self.calls += 1;
        if !self.lane_calls.is_empty() {
            active.iter().for_each(|lane| self.lane_calls[*lane as usize] += 1);
        }
        self.calls
    }

    /// Returns the lane seeds of a light for a query; none for lanes without seeds.
    fn seeds_for(&self, light: u32, query: &IlluminateQuery<'_>) -> Vec<u32> {
        self.seeds.list().map_or_else(Vec::new, |base| LightSeeds::new(base, light, query, 0).list())
    }

    /// Returns a bias option; the attribute when it is below 0 or absent.
    fn bias(&self, option: Option<Lane<'_>>, lane: usize) -> f32 {
        match option.map(|b| b.get(lane)) {
            Some(b) if b >= 0.0 => b,
            _ => self.shadow_bias,
        }
    }

    /// Returns the layer name of the running shader, for messages.
    fn layer_name(&self, layer: usize) -> &str {
        self.shaders.names.get(layer).or(self.shaders.names.first()).map_or("", |n| n)
    }

    fn camera_attribute(&self, name: &str) -> Option<Param> {
        let camera = self.frame.scene.cameras.iter().find(|c| c.name == self.frame.camera.name)?;
        camera.params.get(name).cloned()
    }
}

/// Adds one of several samples of a light.
fn add_share(sum: &mut LightResult, one: LightResult, share: f32) {
    let scale = |lanes: &mut Lanes3| lanes.xyz.iter_mut().flatten().for_each(|v| *v *= share);
    sum.samples.extend(one.samples.into_iter().map(|mut sample| {
        scale(&mut sample.cl);
        sample
    }));
    if let Some(mut ambient) = one.ambient {
        scale(&mut ambient);
        match &mut sum.ambient {
            None => sum.ambient = Some(ambient),
            Some(total) => {
                for (t, a) in total.xyz.iter_mut().flatten().zip(ambient.xyz.iter().flatten()) {
                    *t += a;
                }
            }
        }
    }
    (sum.nondiffuse, sum.nonspecular, sum.messages) = (one.nondiffuse, one.nonspecular, one.messages);
}

/// Returns a float option of a lane, or its default.
fn option(value: Option<Lane<'_>>, lane: usize, default: f32) -> f32 {
    value.map_or(default, |v| v.get(lane))
}

/// Returns a number of samples of which the mean is taken, times the attribute "render:samples". A single sample stays
/// one, because a hard shadow or a mirror needs no more.
fn samples(asked: u32, factor: f32) -> u32 {
    if asked <= 1 || factor == 1.0 {
        return asked;
    }
    (asked as f32 * factor).round().clamp(1.0, 65536.0) as u32
}

/// Returns a count option of a lane, from 1 to 65536.
fn count(value: Option<Lane<'_>>, lane: usize) -> u32 {
    let n = option(value, lane, 1.0);
    if n >= 1.0 { n.min(65536.0) as u32 } else { 1 }
}

impl Spaces for Run<'_, '_> {
    fn to_common(&mut self, space: &str, layer: usize) -> Option<Transform> {
        match space {
            "object" => Some(self.object.attributes.object_to_world(self.time)),
            "shader" => Some(self.shaders.to_world.get(layer)?.at(self.time)),
            _ => self.frame.spaces.to_common(space, self.time),
        }
    }

    fn unit_scale(&mut self, from: &str, to: &str) -> Option<f32> {
        let units = &self.frame.units;
        units.scale(from, to).or_else(|| {
            let (factor, what) = units.assumed(from, to)?;
            self.frame.reporter.once(what, Severity::Warning, &Location::default(), what);
            Some(factor)
        })
    }
}

impl Run<'_, '_> {
    /// Reports unknown words for wrap modes in a lookup in `file`, each word once.
    fn report_wraps<'o>(&self, file: &str, words: impl Iterator<Item = &'o str>) {
        for word in words {
            let object =
                if self.owner.is_empty() { String::new() } else { format!("object \"{}\": ", self.owner) };
            let near = suggestion(word, Wrap::ALL.iter().map(|wrap| wrap.word()));
            let near = near.map_or(String::new(), |near| format!("; did you mean \"{near}\"?"));
            self.frame.reporter.once(
                &format!("wrap {word}"),
                Severity::Warning,
                &Location::default(),
                format!(
                    "{object}texture \"{file}\": unknown wrap mode \"{word}\": that of the file is used{near}"
                ),
            );
        }
    }
}

impl Textures for Run<'_, '_> {
    fn texture(&mut self, query: &TextureQuery<'_>, out: &mut LookupResult) {
        let asked = self.ask(Question::Texture, |_, key| recall::texture(key, query));
        if let Asked::Known(Answer::Lookup(known)) = asked {
            return *out = *known;
        }
        self.note_file(query.name);
        self.report_wraps(query.name, maps::unknown_wraps(&query.options));
        maps::texture(self.thread.textures(), query, out);
        self.keep(asked, || Answer::Lookup(Box::new(out.clone())));
    }

    fn texture3d(&mut self, query: &Texture3dQuery<'_>, out: &mut LookupResult) {
        let asked = self.ask(Question::Texture3d, |_, key| recall::texture3d(key, query));
        if let Asked::Known(Answer::Lookup(known)) = asked {
            return *out = *known;
        }
        self.note_file(query.name);
        self.report_wraps(query.name, maps::unknown_wraps(&query.options));
        maps::texture3d(self.thread.textures(), query, out);
        self.keep(asked, || Answer::Lookup(Box::new(out.clone())));
    }

    fn environment(&mut self, query: &EnvironmentQuery<'_>, out: &mut LookupResult) {
        let is_set = self.frame.rays.is_set(query.name);
        if self.shows_albedo {
            return albedo::environment(query, is_set, out);
        }
        let space = match is_set {
            true => None,
            false => query.options.space.and_then(|s| self.to_common(s, query.batch.layer)),
        };
        // Samples that are drawn from a map depend on those before them.
        let asked = match query.options.sample {
            Some(_) if !is_set => Asked::Unkept,
            _ => self.ask(Question::Environment, |_, key| {
                recall::environment(key, query);
                key.numbers(&space.map_or([0.0; 16], |space| space.to_rows()));
            }),
        };
        if let Asked::Known(Answer::Lookup(known)) = asked {
            return *out = *known;
        }
        self.look_around(query, space, out);
        self.keep(asked, || Answer::Lookup(Box::new(out.clone())));
    }

    fn wants_footprint(&mut self, name: &str, func: Func) -> bool {
        let is_set = self.frame.rays.is_set(name);
        if self.shows_albedo {
            return false;
        }
        match func {
            Func::Environment => is_set,
            // The width of the ray matters only to objects that are shaded or tessellated for it.
            _ if is_set && self.may_trace() => {
                let plain = |scene: &RayScene| scene.opaque_to_shadows && scene.is_settled();
                !self.frame.rays.scene(name, self.frame).is_some_and(plain)
            }
            _ => true,
        }
    }

    fn shadow(&mut self, query: &ShadowQuery<'_>, out: &mut Lanes3) {
        if self.shows_albedo {
            return albedo::fill(query.batch, Vec3::ZERO, out);
        }
        let asked = self.ask(Question::Shadow, |_, key| recall::shadow(key, query));
        if let Asked::Known(Answer::Lanes3(known)) = &asked {
            return recall::copy3(known, out, query.batch);
        }
        self.blocked(query, out);
        self.keep(asked, || Answer::Lanes3(out.clone()));
    }

    fn texture_info(&mut self, texture: &str, name: &str) -> Option<Param> {
        self.note_file(texture);
        self.frame.textures.info(texture, name)
    }
}

impl Run<'_, '_> {
    /// Exchanges the count of calls with that of a light. Each light has a count of its own, so that its random numbers
    /// do not depend on other lights.
    fn count_of_light(&mut self, index: usize) {
        if self.light_calls.len() <= index {
            self.light_calls.resize(self.lights.len(), 0);
        }
        if let Some(calls) = self.light_calls.get_mut(index) {
            std::mem::swap(calls, &mut self.calls);
        }
    }

    /// Runs a light for a query.
    fn light_of(&mut self, light: &LightState, query: &IlluminateQuery<'_>) -> Arc<LightResult> {
        // The grid is moved to the light while it runs. Nothing else uses it in that time.
        let Some(mut grid) = self.lit.take() else { return Arc::default() };
        // The messages of this surface shader follow those of earlier shaders.
        let earlier = grid.messages.len();
        grid.messages.extend_from_slice(query.messages);
        self.calls += 1;
        let result = match &light.area {
            Some(area) => self.area_light(light, area, &grid, query),
            None if light.samples > 1 => self.broad_light(light, &grid, query),
            None => self.drawing_light(light, &grid, query),
        };
        grid.messages.truncate(earlier);
        self.lit = Some(grid);
        Arc::new(result)
    }

    /// Answers `environment ()`. `space` leads from the space of a map to "common".
    fn look_around(
        &mut self,
        query: &EnvironmentQuery<'_>,
        space: Option<Transform>,
        out: &mut LookupResult,
    ) {
        if self.frame.rays.is_set(query.name) {
            let lanes = rays::TracingLanes::new(self, query.batch.active);
            let batch = Batch { active: &lanes.traced, ..query.batch };
            rays::environment(self, &EnvironmentQuery { batch, ..*query }, out);
            out.value.iter_mut().for_each(|channel| lanes.copy(channel));
            lanes.copy(&mut out.alpha);
            lanes.copy(&mut out.hitdist);
            lanes.copy3(&mut out.p_hit);
            lanes.copy3(&mut out.n_hit);
            return;
        }
        self.note_file(query.name);
        if query.options.sample.is_some() && self.drawn(query, space, out) {
            return;
        }
        // The results of indirect rays are averaged, so an approximate lookup suffices.
        let quick = self.ray.indirect;
        maps::environment(self.thread.textures(), query, space, quick, out);
    }

    /// Answers `shadow ()`.
    fn blocked(&mut self, query: &ShadowQuery<'_>, out: &mut Lanes3) {
        if self.frame.rays.is_set(query.name) {
            let single = query.options.samples.is_none() && query.options.angle.is_none();
            let bits = |v: Vec3| v.to_array().map(f32::to_bits);
            let asked = |i: usize| (bits(query.p.get(i)), bits(query.to_light.get(i)));
            let lanes = rays::TracingLanes::new(self, query.batch.active)
                .without_coincident(&self.coincident, &|a, b| single && asked(a) == asked(b));
            let batch = Batch { active: &lanes.traced, ..query.batch };
            shadow::shadow(self, &ShadowQuery { batch, ..*query }, out);
            lanes.copy3(out);
            return;
        }
        self.note_file(query.name);
        let call = self.next_call(query.batch.active);
        let draw = |lane: u32| self.draw(NoiseSource::Lights, call, lane);
        // A thread that builds structures for others or renders a map must not wait for maps.
        let may_wait = !self.thread.builds_rays && !self.thread.is_unlit;
        let maps = self.frame.dynamic.as_deref().filter(|_| may_wait);
        let maker = maps.map(|maps| tiles::Maker { frame: self.frame, maps });
        let textures = &self.frame.textures;
        let mut reader =
            maker.as_ref().map_or_else(|| textures.reader(), |maker| textures.reader_with(maker));
        let bias = |lane| self.bias(query.options.bias, lane);
        maps::shadow(&mut reader, query, self.frame.samples(), &draw, &bias, out);
    }
}

impl Lights for Run<'_, '_> {
    fn light_count(&mut self) -> usize {
        if self.shows_albedo { 1 } else { self.lights.len() }
    }

    fn light_info(&mut self, index: usize) -> LightInfo {
        let Some(&id) = self.lights.get(index) else { return LightInfo::default() };
        self.note(Dependency::Kind(id));
        self.frame.light(id).map(|l| l.info.clone()).unwrap_or_default()
    }

    fn illuminate(&mut self, index: usize, query: &IlluminateQuery<'_>) -> Arc<LightResult> {
        if self.shows_albedo {
            return Arc::new(albedo::light(query));
        }
        if let Some(known) = self.memory.find(index, query) {
            return known;
        }
        let dark = Arc::new(LightResult::default());
        let Some(&id) = self.lights.get(index) else { return dark };
        self.note(Dependency::Light(id));
        let Some(light) = self.frame.light(id) else { return dark };
        self.count_of_light(index);
        let asked = match light.is_anew || !self.keeps_answers() {
            true => Asked::Unkept,
            false => {
                let shared = self.memory.key(query);
                self.ask(Question::Light, |run, key| {
                    key.word(id.0);
                    // A volume shader runs after the surface shader, which sets the colours.
                    let of_volume = run.lit.as_ref().filter(|_| run.shaders.usage == ShaderUsage::Volume);
                    recall::light(key, shared, query.messages, of_volume.map(|lit| [&lit.c, &lit.opacity]));
                })
            }
        };
        let result = match asked {
            Asked::Known(Answer::Light(known)) => known,
            asked => {
                self.note(Dependency::Light(id));
                let result = self.light_of(light, query);
                self.keep(asked, || Answer::Light(result.clone()));
                result
            }
        };
        self.count_of_light(index);
        // The messages of the surface may differ next time.
        if !light.listens {
            self.memory.keep(index, query, &result);
        }
        result
    }

    fn light_asks(&mut self, index: usize) -> bool {
        let light = self.lights.get(index).and_then(|id| self.frame.light(*id));
        light.is_some_and(|light| light.listens)
    }
}

impl Rays for Run<'_, '_> {
    fn trace(&mut self, query: &TraceQuery<'_>, out: &mut TraceResult) {
        if self.shows_albedo {
            return rays::no_hits(query, out);
        }
        let asked = self.ask(Question::Trace, |_, key| recall::trace(key, query));
        if let Asked::Known(Answer::Trace(known)) = asked {
            return *out = *known;
        }
        self.trace_anew(query, out);
        self.keep(asked, || Answer::Trace(Box::new(out.clone())));
    }

    fn occlusion(&mut self, query: &GatherQuery<'_>, out: &mut [f32], unoccluded: &mut Lanes3) {
        if self.shows_albedo {
            return albedo::occlusion(query, out, unoccluded);
        }
        let asked = self.ask(Question::Occlusion, |_, key| recall::gather(key, query));
        if let Asked::Known(Answer::Occlusion(blocked, open)) = &asked {
            query.batch.active.iter().for_each(|i| out[*i as usize] = blocked[*i as usize]);
            return recall::copy3(open, unoccluded, query.batch);
        }
        self.occluded(query, out, unoccluded);
        self.keep(asked, || Answer::Occlusion(out.to_vec(), unoccluded.clone()));
    }

    fn indirect(&mut self, query: &GatherQuery<'_>, out: &mut Lanes3) {
        if self.shows_albedo {
            return albedo::fill(query.batch, Vec3::ONE, out);
        }
        let asked = self.ask(Question::Indirect, |_, key| recall::gather(key, query));
        if let Asked::Known(Answer::Lanes3(known)) = &asked {
            return recall::copy3(known, out, query.batch);
        }
        self.gathered(query, out);
        self.keep(asked, || Answer::Lanes3(out.clone()));
    }

    fn queries_parent(&mut self, set: &str) -> bool {
        !self.thread.builds_rays
            && !self.shows_albedo
            && self.frame.rays.is_set(set)
            && self.frame.rays.scene(set, self.frame).is_some_and(|scene| scene.queries_parents)
    }
}

impl Run<'_, '_> {
    /// Answers `trace`.
    fn trace_anew(&mut self, query: &TraceQuery<'_>, out: &mut TraceResult) {
        let lanes = rays::TracingLanes::new(self, query.batch.active);
        let batch = Batch { active: &lanes.traced, ..query.batch };
        rays::trace(self, &TraceQuery { batch, ..*query }, out);
        lanes.copy(&mut out.hit);
        lanes.copy(&mut out.hitdist);
        for found in [&mut out.l, &mut out.ps, &mut out.cl, &mut out.ol, &mut out.p] {
            lanes.copy3(found);
        }
        for found in &mut out.others {
            lanes.copy(&mut found.there);
            let n = query.batch.lanes.max(1);
            found.values.chunks_exact_mut(n).for_each(|component| lanes.copy(component));
        }
    }

    /// Answers `occlusion ()`.
    fn occluded(&mut self, query: &GatherQuery<'_>, out: &mut [f32], unoccluded: &mut Lanes3) {
        let lanes = rays::TracingLanes::new(self, query.batch.active);
        let batch = Batch { active: &lanes.traced, ..query.batch };
        light::occlusion(self, &GatherQuery { batch, ..*query }, out, unoccluded);
        lanes.copy(out);
        lanes.copy3(unoccluded);
    }

    /// Answers `indirect ()`.
    fn gathered(&mut self, query: &GatherQuery<'_>, out: &mut Lanes3) {
        let lanes = rays::TracingLanes::new(self, query.batch.active);
        let batch = Batch { active: &lanes.traced, ..query.batch };
        light::indirect(self, &GatherQuery { batch, ..*query }, out);
        lanes.copy3(out);
    }
}

impl Databases for Run<'_, '_> {
    fn spatialdb_save(&mut self, query: &DatabaseSave<'_>) {
        self.note_file(query.name);
        database::save(self, query);
    }

    fn spatialdb_query(&mut self, query: &DatabaseQuery<'_>, values: &mut [Vec<f32>], found: &mut [bool]) {
        self.note_file(query.name);
        database::query(self, query, values, found);
    }

    fn subsurface(&mut self, query: &SubsurfaceQuery<'_>, out: &mut Lanes3) {
        if self.shows_albedo {
            return albedo::fill(query.batch, Vec3::ONE, out);
        }
        self.note_file(query.name);
        database::subsurface(self, query, out);
    }
}

impl Messages for Run<'_, '_> {
    fn append(&mut self, file: &str, text: &str) {
        let frame = self.frame;
        let (owner, index) = (self.owner.clone(), self.appended);
        self.appended += 1;
        let key = texts::Key { owner, level: self.ray.level, seed: self.seed, index };
        frame.texts.add(file, key, text, &frame.files, &frame.reporter);
    }

    fn say(&mut self, severity: Severity, text: &str) {
        let reporter = &self.frame.reporter;
        if severity == Severity::Message {
            if self.thread.is_mute {
                return;
            }
            reporter.say(severity, &Location::default(), text);
            return;
        }
        let shader = self.layer_name(self.shaders.names.len().saturating_sub(1)).to_owned();
        self.say_of(severity, &shader, &Location::default(), text);
    }

    fn say_of(&mut self, severity: Severity, shader: &str, at: &Location, text: &str) {
        let usage = usage_word(self.shaders.usage);
        let owner = match (self.shaders.usage, &*self.owner) {
            (ShaderUsage::Light, name) => format!("light \"{name}\": "),
            (_, "") => String::new(),
            (_, name) => format!("object \"{name}\": "),
        };
        // The message is reported once per shader and text, because other grids repeat it.
        let cause = format!("{at} {usage} {shader}: {text}");
        let text = format!("{owner}{usage} shader \"{shader}\": {text}");
        self.frame.reporter.once(&cause, severity, at, text);
    }

    fn unsupported(&mut self, feature: &str) {
        self.frame.unsupported(feature);
    }
}

impl Host for Run<'_, '_> {
    fn shadeop(&mut self, text: &str) -> Result<Arc<dyn Shadeop>, String> {
        self.frame.library.shadeop(text)
    }

    fn native(&mut self) -> Option<&dyn NativeCompiler> {
        self.frame.library.native()
    }

    fn attribute(&mut self, name: &str) -> Option<Param> {
        let value = |ty: ParamType, data: ParamData| Some(Param { name: name.into(), ty, data });
        match name {
            "transform" => {
                let camera = &self.frame.camera;
                let matrix = self.object.attributes.object_to_world(camera.shading_time());
                let matrix = camera.world_to_common().map_or(matrix, |m| matrix.then(&m.inverse()));
                return value(ParamType::of(BaseType::Matrix), matrix.to_rows()[..].into());
            }
            "geometryset" => {
                let names: Vec<&str> = self.attributes.geometry_sets.iter().map(|s| &**s).collect();
                return value(ParamType::of(BaseType::String), (&*names.join(",")).into());
            }
            // Without these camera attributes there is no depth of field.
            "focallength" | "focaldistance" if self.camera_attribute(name).is_none() => {
                return value(ParamType::of(BaseType::Float), 0.0_f32.into());
            }
            "screen" if self.camera_attribute(name).is_none() => {
                let scene = &self.frame.scene;
                let camera = scene.cameras.iter().find(|c| c.name == self.frame.camera.name)?;
                return value(ParamType::array(BaseType::Float, 4), camera.screen_window()[..].into());
            }
            _ => (),
        }
        if let Some(version) = granita_scene::version_attribute(name) {
            return Some(version);
        }
        if let Some(own) = self.attributes.values.get(name).or_else(|| self.frame.scene.globals.get(name)) {
            return Some(own.clone());
        }
        if name.starts_with("user:") {
            return None;
        }
        self.camera_attribute(name).or_else(|| granita_scene::attribute_default(name))
    }

    fn is_stopped(&mut self) -> bool {
        self.frame.is_stopped()
    }
}
