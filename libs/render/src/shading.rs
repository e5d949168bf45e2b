//! A frame as shaders see it, and the threads that run them.
//!
//! [`ShadingContext`] is made once per frame and shared: lights are linked at once, object states when they
//! are first asked for, structures for rays when the first ray needs them. A [`ShaderThread`] holds what
//! one thread writes to while it shades.

use crate::directions::Directions;
use crate::dynamic::DynamicMaps;
use crate::lightcache::LightCache;
use crate::lights::LightState;
use crate::object::{Holdout, LinkedShaders, Linker, ObjectState, StateShaders};
use crate::raytrace::RayWorld;
use crate::services::{Run, maps};
use crate::spaces::{Spaces, Units};
use crate::texts::Texts;
use crate::{CameraView, RenderEnvironment, ShaderLibrary, ShadingStatistics, finite, preshaded};
use granita_base::{Color, Files, Location, OnceMap, ParamData, Reporter, SearchPath, Severity, Vec3};
use granita_gsl::ir::{Global, ValueType};
use granita_scene::attribute::{Key, scope};
use granita_scene::{LightId, Primitive, Scene, ShaderGroup, ShaderUsage, attr};
use granita_sdb::{Attributes, Clusters, Databases, Mode, Packed};
use granita_shade::{Executor, Grid, Group, Lanes3, Primvar, PrimvarData, Rect, Services};
use granita_texture::{CacheOptions, TextureCache, TextureReader, Up, Use};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

/// What shading needs of a frame. Shared by its threads.
pub(crate) struct ShadingContext {
    /// The scene.
    pub(crate) scene: Arc<Scene>,
    /// The camera that dices and shades: the first one.
    pub(crate) camera: CameraView,
    /// Its place in the world.
    pub(crate) eye_world: Vec3,
    /// Receives messages.
    pub(crate) reporter: Reporter,
    /// The frame is to end: what is not done need not be right.
    stop: Arc<AtomicBool>,
    /// Named spaces.
    pub(crate) spaces: Spaces,
    /// Units of "common" space.
    pub(crate) units: Units,
    /// Texture files.
    pub(crate) textures: TextureCache,
    /// Shadow maps without files.
    pub(crate) dynamic: DynamicMaps,
    /// Spatial databases.
    pub(crate) databases: Arc<Databases>,
    database_attributes: Attributes,
    texture_path: SearchPath,
    /// Chances of directions by the light of environment maps, by name and upper direction.
    directions: OnceMap<MapFrame, Option<Arc<Directions>>>,
    /// Databases that `subsurface ()` asks.
    clustered: OnceMap<(String, Mode), Option<Clustered>>,
    /// By [`LightId`]; `None` for lights that stay dark.
    pub(crate) lights: Vec<Option<LightState>>,
    /// What rays meet.
    pub(crate) rays: RayWorld,
    /// What `fprintf` writes.
    pub(crate) texts: Texts,
    /// Opens the files of `fprintf`.
    pub(crate) files: Files,
    /// Indirect light and occlusion of points that grids have in common.
    pub(crate) light_cache: LightCache,
    pub(crate) library: Arc<dyn ShaderLibrary>,
    states: States,
}

/// Name of an environment map, and the upper direction that a shader gives it.
type MapFrame = (String, String);

/// Records, and far ones taken together.
pub(crate) type Clustered = (Arc<Packed>, Arc<Clusters>);

/// The attributes "spatialdb:read" and so on (reference 4.3.9): lists that grow with every call.
fn database_attributes(scene: &Scene) -> Attributes {
    let names = |attribute: &str| match scene.globals.get(attribute).map(|param| &param.data) {
        Some(ParamData::String(list)) => list.iter().map(|name| name.to_string()).collect(),
        _ => Vec::new(),
    };
    Attributes {
        read: names("spatialdb:read"),
        write: names("spatialdb:write"),
        readonly: names("spatialdb:readonly"),
        writeonly: names("spatialdb:writeonly"),
    }
}

/// What was already made, by the address of what it was made of: the scene keeps all of that alive, so an
/// address names one thing for the whole frame.
#[derive(Default)]
struct States {
    /// By attribute set, whether the primitive has an "opacity" of its own, and whether it is a grid with colours.
    objects: OnceMap<(usize, bool, bool), Arc<ObjectState>>,
    groups: OnceMap<(usize, ShaderUsage), Option<Arc<LinkedShaders>>>,
    default_surface: OnceLock<Arc<LinkedShaders>>,
}

/// The most texture files open at once: what "limits:texturefiles" says, and no more than three quarters of the files that
/// the process may have open. The others are for images that are written, shaders, databases and sockets.
fn texture_files(attribute: i32, open_files: Option<usize>) -> usize {
    let most = open_files.map_or(usize::MAX, |limit| limit / 4 * 3);
    usize::try_from(attribute).unwrap_or(0).min(most).max(1)
}

impl ShadingContext {
    /// Links the lights and gets ready for the rest. Loads no surface, opens no texture, builds nothing for
    /// rays.
    pub(crate) fn new(scene: &Arc<Scene>, camera: &CameraView, environment: &RenderEnvironment) -> Self {
        let reporter = environment.reporter.clone();
        let linker = Linker { library: &*environment.shaders, reporter: &reporter };
        let lights = scene.lights.iter().map(|light| LightState::new(light, linker)).collect();
        let named =
            |key: Key<scope::Global, Arc<str>>| Some(scene.get(key).to_string()).filter(|s| !s.is_empty());
        let options = CacheOptions {
            memory_bytes: u64::try_from(scene.get(attr::LIMITS_TEXTUREMEMORY)).map_or(0, |kb| kb * 1024),
            max_files: texture_files(scene.get(attr::LIMITS_TEXTUREFILES), environment.open_files),
            automipmap: scene.get(attr::TEXTURE_AUTOMIPMAP),
            substitute_texture: named(attr::TEXTURE_SUBSTTEXTURE),
            substitute_environment: named(attr::TEXTURE_SUBSTENV),
            common_origin: camera.common_origin,
        };
        let textures = TextureCache::new(
            environment.registry.clone(),
            environment.texture_path.clone(),
            options,
            reporter.clone(),
        );
        let threads = match environment.threads {
            0 => usize::try_from(scene.get(attr::LIMITS_THREADS)).unwrap_or(1).max(1),
            n => n,
        };
        Self {
            spaces: Spaces::new(scene, camera),
            units: Units::new(scene),
            rays: RayWorld::new(scene, threads),
            texts: Texts::default(),
            files: environment.registry.files().clone(),
            light_cache: LightCache::default(),
            scene: scene.clone(),
            camera: camera.clone(),
            eye_world: camera.position_world(),
            textures,
            dynamic: DynamicMaps::default(),
            lights,
            library: environment.shaders.clone(),
            databases: environment.databases.clone(),
            database_attributes: database_attributes(scene),
            texture_path: environment.texture_path.clone(),
            directions: OnceMap::default(),
            clustered: OnceMap::default(),
            states: States::default(),
            stop: environment.stop.clone(),
            reporter,
        }
    }

    /// Whether the frame is to end, so that shaders should.
    pub(crate) fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// What may be done with a database, by an option "filemode" and the attributes of the scene.
    pub(crate) fn database_mode(&self, name: &str, word: &str) -> Mode {
        self.databases.mode(&self.database_attributes, name, word)
    }

    /// The records that queries of a database see.
    pub(crate) fn database(&self, name: &str, mode: Mode) -> Option<Arc<Packed>> {
        self.databases.records(name, mode, &self.texture_path)
    }

    /// Chances of directions by the light of a map; `None` when there is no such map.
    pub(crate) fn directions(&self, name: &str, up: Option<&str>) -> Option<Arc<Directions>> {
        self.directions.get_or_make((name.to_owned(), up.unwrap_or("").to_owned()), || {
            let id = self.textures.find_for(name, Use::Environment)?;
            let up = up.and_then(Up::from_word);
            Some(Arc::new(maps::directions(&self.textures, id, up, self.rays.threads)))
        })
    }

    /// The same with far records taken together; made when first asked for.
    pub(crate) fn clustered(&self, name: &str, mode: Mode) -> Option<Clustered> {
        self.clustered.get_or_make((name.to_owned(), mode), || {
            let records = self.database(name, mode)?;
            let clusters = Arc::new(Clusters::new(&records));
            Some((records, clusters))
        })
    }

    /// The state of a primitive's object; made on first use, the same for all primitives that share an
    /// attribute set.
    pub(crate) fn object(&self, primitive: &Primitive) -> Arc<ObjectState> {
        let own_opacity = primitive.keys.first().is_some_and(|key| key.params.get("opacity").is_some());
        let grid = preshaded::lattice(primitive).is_some();
        let key = (Arc::as_ptr(&primitive.attributes) as usize, own_opacity, grid);
        self.states.objects.get_or_make(key, || Arc::new(self.new_object(primitive, own_opacity, grid)))
    }

    fn new_object(&self, primitive: &Primitive, own_opacity: bool, grid: bool) -> ObjectState {
        let attributes = &primitive.attributes;
        let name = attributes.name();
        let (given, opacity) = (finite::given_opacity(attributes), finite::opacity(attributes));
        if given != opacity {
            self.reporter.once(
                &format!("opacity {name}"),
                Severity::Warning,
                &primitive.at,
                format!(
                    "object \"{name}\": \"opacity\" ({} {} {}) counts as ({} {} {}): it is from 0 to 1",
                    given.x, given.y, given.z, opacity.x, opacity.y, opacity.z
                ),
            );
        }
        let group = |shaders: &Option<Arc<ShaderGroup>>, usage| self.group(shaders.as_ref()?, usage, &name);
        let surface = group(&attributes.surface, ShaderUsage::Surface);
        let displacement = group(&attributes.displacement, ShaderUsage::Displacement);
        let volume = group(&attributes.volume, ShaderUsage::Volume);
        let surface = surface.unwrap_or_else(|| self.default_surface());
        let preshaded = grid && preshaded::asked_by(&surface, displacement.as_ref());
        // What lies between it and the camera was shaded with it.
        let volume = volume.filter(|_| !preshaded);
        let shaders = StateShaders { surface, displacement, volume };
        let mut state = ObjectState::new(attributes, shaders, own_opacity, &self.spaces);
        state.preshaded = preshaded;
        let shines = |id: &LightId| self.light(*id).is_some();
        state.lights = attributes.lights.iter().filter(shines).collect();
        let groups = self.groups(&state);
        // Parameters stay on the grid for later shaders of the object and for lights that ask for them.
        for shaders in [state.displacement.as_ref(), Some(&state.surface)].into_iter().flatten() {
            let kind = crate::object::kind(shaders.usage);
            if groups.iter().any(|group| group.usage() != kind && group.listens_to(kind)) {
                shaders.group.keep_parameters();
            }
        }
        let saves = |key: Key<scope::Object, Arc<str>>| self.database_mode(&attributes.get(key), "").write;
        let joins = !state.preshaded && groups.iter().all(|group| !group.is_gridwise());
        let saves = saves(attr::INDIRECT_SPATIALDB)
            || saves(attr::OCCLUSION_SPATIALDB)
            || groups.iter().any(|group| group.may_save());
        (state.joins, state.saves) = (joins, saves);
        state
    }

    /// All that runs when the object is shaded.
    fn groups<'s>(&'s self, state: &'s ObjectState) -> Vec<&'s Group> {
        let own = [Some(&state.surface), state.displacement.as_ref(), state.volume.as_ref()];
        let own = own.into_iter().flatten().map(|shaders| &shaders.group);
        let lights = state.lights.iter().filter_map(|id| self.light(*id)).map(|light| &light.shaders.group);
        own.chain(lights).collect()
    }

    /// A light that shines.
    pub(crate) fn light(&self, id: LightId) -> Option<&LightState> {
        self.lights.get(id.0 as usize)?.as_ref()
    }

    fn group(
        &self,
        shaders: &Arc<ShaderGroup>,
        usage: ShaderUsage,
        owner: &str,
    ) -> Option<Arc<LinkedShaders>> {
        let key = (Arc::as_ptr(shaders) as usize, usage);
        let linker = Linker { library: &*self.library, reporter: &self.reporter };
        self.states.groups.get_or_make(key, || linker.link(shaders, usage, owner).map(Arc::new))
    }

    /// The default surface is nobody's own: its "shader" space is the world.
    fn default_surface(&self) -> Arc<LinkedShaders> {
        let linker = Linker { library: &*self.library, reporter: &self.reporter };
        self.states.default_surface.get_or_init(|| Arc::new(linker.default_surface())).clone()
    }

    /// What was and what was not built and looked up while the frame was shaded.
    pub(crate) fn statistics(&self) -> ShadingStatistics {
        let (built, sets) = self.rays.built();
        let (triangles, bytes) = self.rays.size();
        let tessellations = self.rays.cache.counts();
        let count = |n: &AtomicU64| n.load(Ordering::Relaxed);
        let rays = &self.rays.counts;
        let t = self.textures.statistics();
        ShadingStatistics {
            rays: count(&rays.rays),
            shadow_rays: count(&rays.shadow_rays),
            ray_hits_shaded: count(&rays.shaded),
            ray_structures: sets as u64,
            ray_structures_built: built as u64,
            ray_triangles: triangles,
            ray_bytes: bytes,
            ray_tessellations: tessellations.made,
            ray_tessellations_given_up: tessellations.given_up,
            ray_tessellation_bytes_peak: tessellations.peak_bytes,
            light_records: count(&self.light_cache.records),
            light_rays: count(&self.light_cache.rays),
            light_points: count(&self.light_cache.points),
            texture_files: t.files,
            texture_automipmaps: t.automipmaps,
            texture_lookups: t.lookups,
            texture_tile_requests: t.tile_requests,
            texture_tiles_read: t.tiles_read,
            texture_bytes_read: t.tile_bytes,
            texture_bytes_peak: t.peak_bytes,
        }
    }

    /// A warning that is said once per name of a feature.
    pub(crate) fn unsupported(&self, feature: &str) {
        self.reporter.once(
            &format!("unsupported {feature}"),
            Severity::Warning,
            &Location::default(),
            format!("{feature} is not supported yet"),
        );
    }
}

/// Levels of rays at most, whatever "ray:maxdepth" says.
///
/// A shader runs at each, and what it takes (some 20 KB of stack, registers, a grid of hits and their rays) is there until
/// the last of them returns. So this bounds what a thread takes.
pub(crate) const MAX_RAY_LEVELS: u32 = 1000;
/// Shaders that run within those, at most: for shadow rays, which have the level of the shader that traces them.
pub(crate) const MORE_NESTED: u32 = 16;
/// Executors that are kept for later.
const MAX_IDLE: usize = 64;
/// Bytes of stack that one shader may take until the next one within it begins.
const STACK_FOR_ONE: usize = 1 << 20;
/// Bytes of stack that are added when less than that is left; only what is touched takes memory.
const MORE_STACK: usize = 8 << 20;

/// A way to run a group: [`Executor::run`] or [`Executor::run_asked`].
type RunOf =
    fn(&mut Executor, &Group, &mut Grid, &mut dyn Services, &[(&str, ValueType)]) -> Vec<Option<Vec<f32>>>;

/// Runs shaders on one thread; its memory is kept from grid to grid.
pub(crate) struct ShaderThread<'f> {
    frame: &'f ShadingContext,
    /// Executors that are not running: one is in use for each nested shader (surface, its light, the surface
    /// that a ray of the light hits, ...).
    idle: Vec<Executor>,
    /// Reads texture files, and keeps the tiles that it used last.
    textures: TextureReader<'f>,
    /// Shaders that run on this thread, within each other.
    pub(crate) nested: u32,
    /// Structures for rays are being built by this thread: its shaders see no rays.
    pub(crate) builds_rays: bool,
    /// Depths are being rendered by this thread: its shaders see no lights, and nothing of dynamic shadow maps.
    pub(crate) is_unlit: bool,
    /// Shaders print and save nothing: their grids are shaded again.
    pub(crate) is_mute: bool,
}

impl<'f> ShaderThread<'f> {
    /// With no memory yet.
    pub(crate) fn new(frame: &'f ShadingContext) -> Self {
        let textures = frame.textures.reader();
        Self {
            frame,
            idle: Vec::new(),
            textures,
            nested: 0,
            builds_rays: false,
            is_unlit: false,
            is_mute: false,
        }
    }

    /// The frame.
    pub(crate) fn frame(&self) -> &'f ShadingContext {
        self.frame
    }

    /// Whether what shaders save is kept: not of grids that are shaded again where they are seen.
    pub(crate) fn keeps_saved(&self) -> bool {
        !self.builds_rays && !self.is_mute
    }

    /// Reads texture files, but maps without files.
    pub(crate) fn textures(&mut self) -> &mut TextureReader<'f> {
        &mut self.textures
    }

    /// An executor that nobody uses; give it back with [`ShaderThread::put_executor`].
    pub(crate) fn take_executor(&mut self) -> Executor {
        self.idle.pop().unwrap_or_else(|| {
            let mut executor = Executor::new();
            executor.look_for_nan(self.frame.scene.get(attr::DEBUG_SHADERNAN));
            executor.seed_random(self.frame.scene.get(attr::RANDOM_SEED) as u32);
            executor
        })
    }

    /// Gives an executor back.
    pub(crate) fn put_executor(&mut self, executor: Executor) {
        // What very deep rays needed is given back.
        if self.idle.len() < MAX_IDLE {
            self.idle.push(executor);
        }
    }

    /// Runs the displacement shaders, if any: moves `p`, `n`, and with them `ng`, `dpdu`, `dpdv` and `i`.
    pub(crate) fn displace(&mut self, object: &ObjectState, grid: &mut Grid) {
        let Some(shaders) = &object.displacement else { return };
        let moves = shaders.group.writes(Global::P);
        let before = moves.then(|| grid.p.clone());
        self.run(object, shaders, grid, &[]);
        if let Some(before) = before {
            follow_displacement(grid, &before);
        }
    }

    /// As [`ShaderThread::displace`], but points stay in place: only `n` changes.
    pub(crate) fn bump(&mut self, object: &ObjectState, grid: &mut Grid) {
        let Some(shaders) = &object.displacement else { return };
        let p = grid.p.clone();
        self.run(object, shaders, grid, &[]);
        grid.p = p;
    }

    /// Runs the surface shaders, then the volume shaders: sets `c` and `opacity`. Returns the wanted
    /// variables, component by component; `None` for those that no shader has.
    ///
    /// A holdout matte becomes black and clear without a shader being run.
    pub(crate) fn shade(
        &mut self,
        object: &ObjectState,
        grid: &mut Grid,
        wanted: &[(Arc<str>, ValueType)],
    ) -> Vec<Option<Vec<f32>>> {
        self.shade_as(object, grid, wanted, Executor::run)
    }

    /// As [`ShaderThread::shade`], for a ray whose shader asks for variables: messages come first, then parameters of
    /// any kind, then globals.
    pub(crate) fn shade_asked(
        &mut self,
        object: &ObjectState,
        grid: &mut Grid,
        wanted: &[(Arc<str>, ValueType)],
    ) -> Vec<Option<Vec<f32>>> {
        if wanted.is_empty() {
            return self.shade(object, grid, wanted);
        }
        let mut found = self.shade_as(object, grid, wanted, Executor::run_asked);
        for (have, (name, ty)) in found.iter_mut().zip(wanted) {
            let sent = grid.messages.iter().rev().map(|m| &m.value).find(|v| v.name == *name);
            let of_type = |v: &&Primvar| v.ty.array.is_none() && Some(v.ty.base) == ty.base_type();
            if let Some(Primvar { data: PrimvarData::Floats { values, varying }, .. }) = sent.filter(of_type)
            {
                let n = grid.len();
                *have = Some(match varying {
                    true => values.clone(),
                    false => values.iter().flat_map(|v| std::iter::repeat_n(*v, n)).collect(),
                });
            }
        }
        found
    }

    fn shade_as(
        &mut self,
        object: &ObjectState,
        grid: &mut Grid,
        wanted: &[(Arc<str>, ValueType)],
        how: RunOf,
    ) -> Vec<Option<Vec<f32>>> {
        if object.holdout == Holdout::Matte {
            grid.c = Lanes3::splat(Color::ZERO, grid.len());
            grid.opacity = Lanes3::splat(Color::ZERO, grid.len());
            return vec![None; wanted.len()];
        }
        let names: Vec<(&str, ValueType)> = wanted.iter().map(|(name, ty)| (&**name, *ty)).collect();
        let given: Vec<_> = names.iter().map(|(name, ty)| of_primitive(grid, name, *ty)).collect();
        let mut found = self.run_as(object, &object.surface, grid, &names, how);
        if object.preshaded {
            for (have, (name, ty)) in found.iter_mut().zip(&names) {
                let own = grid.primvars.iter().find(|v| &*v.name == *name);
                if let Some(PrimvarData::Floats { values, varying: true }) = own.map(|v| &v.data)
                    && values.len() == ty.components() * grid.len()
                {
                    *have = Some(values.clone());
                }
            }
        }
        if let Some(volume) = &object.volume {
            let more = self.run_as(object, volume, grid, &names, how);
            for (have, new) in found.iter_mut().zip(more) {
                // The volume shader runs last; C and opacity are what it left.
                if have.is_none() || new.is_some() {
                    *have = new;
                }
            }
        }
        for (have, given) in found.iter_mut().zip(given) {
            *have = given.or_else(|| have.take());
        }
        found
    }

    fn run(
        &mut self,
        object: &ObjectState,
        shaders: &LinkedShaders,
        grid: &mut Grid,
        wanted: &[(&str, ValueType)],
    ) -> Vec<Option<Vec<f32>>> {
        self.run_as(object, shaders, grid, wanted, Executor::run)
    }

    fn run_as(
        &mut self,
        object: &ObjectState,
        shaders: &LinkedShaders,
        grid: &mut Grid,
        wanted: &[(&str, ValueType)],
        how: RunOf,
    ) -> Vec<Option<Vec<f32>>> {
        let mut executor = self.take_executor();
        self.nested += 1;
        let thread = &mut *self;
        let found = stacker::maybe_grow(STACK_FOR_ONE, MORE_STACK, || {
            let mut services = Run::for_object(thread, object, shaders, grid);
            how(&mut executor, &shaders.group, grid, &mut services, wanted)
        });
        self.nested -= 1;
        self.put_executor(executor);
        found
    }
}

/// What an output of `primitive:NAME` shows: a variable of the primitive as it is before shading, component by component.
/// "C" and "opacity" are those of the object where the primitive has none, "s" and "t" are u and v. `None` for other names.
fn of_primitive(grid: &Grid, name: &str, ty: ValueType) -> Option<Vec<f32>> {
    let name = name.strip_prefix("primitive:")?;
    let n = grid.len();
    let own = grid.primvars.iter().find(|v| &*v.name == name && v.ty.width() == ty.components());
    match own.map(|v| &v.data) {
        Some(PrimvarData::Floats { values, varying: true }) => return Some(values.clone()),
        Some(PrimvarData::Floats { values, varying: false }) => {
            return Some(values.iter().flat_map(|v| std::iter::repeat_n(*v, n)).collect());
        }
        _ => {}
    }
    match (name, ty) {
        ("C", ValueType::Color) => Some(grid.c.xyz.concat()),
        ("opacity", ValueType::Color) => Some(grid.opacity.xyz.concat()),
        ("s", ValueType::Float) => Some(grid.u.clone()),
        ("t", ValueType::Float) => Some(grid.v.clone()),
        _ => None,
    }
}

/// Makes the rest of a grid follow points that a displacement shader moved from `before`.
///
/// Tangents gain the change of the displacement across the grid, the geometric normal is their cross
/// product, and the view direction moves along. Where tangents vanish, the old normal stays.
fn follow_displacement(grid: &mut Grid, before: &Lanes3) {
    let rects: Vec<Rect> = grid.topology.rects().collect();
    if rects.is_empty() {
        return;
    }
    let offset = |g: &Grid, i: usize| g.p.get(i) - before.get(i);
    let sign = if grid.flip_normals { -1.0 } else { 1.0 };
    for Rect { first, nu, nv } in rects {
        for j in 0..nv {
            for i in 0..nu {
                let at = |i: usize, j: usize| first + j * nu + i;
                let slope = |g: &Grid, a: usize, b: usize, parameter: &[f32]| {
                    let step = parameter[b] - parameter[a];
                    if step == 0.0 { Vec3::ZERO } else { (offset(g, b) - offset(g, a)) / step }
                };
                let (i0, i1) = (i.saturating_sub(1), (i + 1).min(nu - 1));
                let (j0, j1) = (j.saturating_sub(1), (j + 1).min(nv - 1));
                let here = at(i, j);
                let du = grid.dpdu.get(here) + slope(grid, at(i0, j), at(i1, j), &grid.u);
                let dv = grid.dpdv.get(here) + slope(grid, at(i, j0), at(i, j1), &grid.v);
                let ng = du.cross(dv) * sign;
                grid.dpdu.set(here, du);
                grid.dpdv.set(here, dv);
                if ng.is_finite() && ng.length_squared() > 1e-30 {
                    grid.ng.set(here, ng);
                }
            }
        }
    }
    if grid.ray.level == 0 {
        for i in 0..grid.len() {
            grid.i.set(i, grid.i.get(i) + offset(grid, i));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_shade::Topology;

    #[test]
    fn textures_leave_files_for_outputs() {
        assert_eq!(texture_files(1000, None), 1000);
        assert_eq!(texture_files(1000, Some(64)), 48);
        assert_eq!(texture_files(10, Some(64)), 10);
        assert_eq!(texture_files(-5, Some(2)), 1);
    }

    #[test]
    fn variables_of_the_primitive_are_those_before_shading() {
        let mut grid = Grid::new(Topology::Rect { nu: 2, nv: 1 });
        grid.u = vec![0.25, 0.75];
        grid.c = Lanes3::splat(Vec3::new(1.0, 0.5, 0.25), 2);
        let ty = |base| granita_base::ParamType::of(base);
        let weights = PrimvarData::Floats { values: vec![7.0, 8.0], varying: true };
        grid.primvars.push(Primvar {
            name: "w".into(),
            ty: ty(granita_base::BaseType::Float),
            data: weights,
        });
        let of = |name: &str, ty| of_primitive(&grid, name, ty);
        assert_eq!(of("primitive:s", ValueType::Float), Some(vec![0.25, 0.75]));
        assert_eq!(of("primitive:C", ValueType::Color), Some(vec![1.0, 1.0, 0.5, 0.5, 0.25, 0.25]));
        assert_eq!(of("primitive:w", ValueType::Float), Some(vec![7.0, 8.0]));
        assert_eq!(of("primitive:w", ValueType::Color), None);
        assert_eq!((of("s", ValueType::Float), of("primitive:x", ValueType::Float)), (None, None));
    }

    #[test]
    fn normals_follow_a_tilted_displacement() {
        // The square z = 0 becomes the plane z = u.
        let mut grid = Grid::new(Topology::Rect { nu: 3, nv: 3 });
        for at in 0..9 {
            let (u, v) = ((at % 3) as f32 * 0.5, (at / 3) as f32 * 0.5);
            (grid.u[at], grid.v[at]) = (u, v);
            grid.p.set(at, Vec3::new(u, v, 0.0));
        }
        grid.dpdu = Lanes3::splat(Vec3::X, 9);
        grid.dpdv = Lanes3::splat(Vec3::Y, 9);
        grid.ng = Lanes3::splat(Vec3::Z, 9);
        let before = grid.p.clone();
        for at in 0..9 {
            grid.p.xyz[2][at] = grid.u[at];
        }
        follow_displacement(&mut grid, &before);
        for at in 0..9 {
            assert!((grid.ng.get(at) - Vec3::new(-1.0, 0.0, 1.0)).length() < 1e-6);
            assert!((grid.dpdu.get(at) - Vec3::new(1.0, 0.0, 1.0)).length() < 1e-6);
        }
        assert_eq!(grid.i.get(2), Vec3::new(0.0, 0.0, 1.0));
    }
}
