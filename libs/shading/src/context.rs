//! The state of a frame that shaders read.

use crate::files_used::FilesUsed;
use crate::lighting::cache::IrradianceCache;
use crate::lighting::directions::EnvironmentSampler;
use crate::lighting::lights::LightState;
use crate::memo::Changes;
use crate::object::{LinkedShaders, Linker, ObjectState, StateShaders};
use crate::services::maps;
use crate::spaces::{Spaces, Units};
use crate::texts::Texts;
use crate::{ShaderLibrary, ShadingEnvironment, ShadingStatistics, preshaded};
use granita_base::sample::Sequence;
use granita_base::{
    Files, Location, NoiseSource, NoiseSources, OnceMap, PassNumbers, Reporter, SearchPath, Severity, Vec3,
    hash,
};
use granita_dicing::{CameraView, finite};
use granita_rays::{RayFrame, RayWorld};

use granita_scene::attribute::{Key, scope};
use granita_scene::{AttributeSet, LightId, Primitive, Scene, ShaderGroup, ShaderUsage, attr};
use granita_sdb::{Attributes, Clusters, Databases, Mode, Packed};
use granita_shade::{Grid, Group};
use granita_texture::{CacheOptions, TextureCache, TextureId, Up, Use};
use parking_lot::RwLock;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};

/// The dimension of the seeds of passes.
const PASS: u32 = 0x7061_7373;
/// The dimension of the seeds of a noise source that is varied.
const VARIED: u32 = 0x7661_7279;

/// Depth maps that are rendered on demand while shaders read them (reference 10.1.5).
pub trait DepthMaps: Send + Sync {
    /// Returns the depths of a tile (column and row) of a map, row by row from the top. The result is always the
    /// same to the bit, because a tile may be requested again.
    fn tile(&self, frame: &ShadingContext, map: TextureId, tile: [u32; 2]) -> Vec<f32>;
}

/// The state of a frame that shading needs. Its threads share it.
pub struct ShadingContext {
    /// The scene.
    pub scene: Arc<Scene>,
    /// The camera that dices and shades, which is the first one.
    pub camera: CameraView,
    /// The camera's position in world space.
    pub(crate) eye_world: Vec3,
    /// Receives messages.
    pub reporter: Reporter,
    /// Set when the frame must end. Results after that may be incomplete.
    pub(crate) stop: Arc<AtomicBool>,
    /// The named spaces.
    pub(crate) spaces: Spaces,
    /// The units of "common" space.
    pub(crate) units: Units,
    /// The texture files.
    pub textures: TextureCache,
    /// The shadow maps without files.
    pub dynamic: Option<Box<dyn DepthMaps>>,
    /// The spatial databases.
    pub databases: Arc<Databases>,
    database_attributes: Attributes,
    pub(crate) texture_path: SearchPath,
    /// Samplers of the light of environment maps, by map name and upper direction.
    pub(crate) directions: OnceMap<MapFrame, Option<Arc<EnvironmentSampler>>>,
    /// The databases that `subsurface ()` queries.
    pub(crate) clustered: OnceMap<(String, Mode), Option<Clustered>>,
    /// The lights by [`LightId`]; `None` for lights that stay dark.
    pub(crate) lights: Vec<Option<LightState>>,
    /// The geometry that rays intersect.
    pub(crate) rays: RayWorld<ObjectState>,
    /// The texts that `fprintf` writes.
    pub(crate) texts: Texts,
    /// Opens the files of `fprintf`.
    pub(crate) files: Files,
    /// The indirect light and occlusion of points that grids share.
    pub(crate) light_cache: IrradianceCache,
    pub(crate) library: Arc<dyn ShaderLibrary>,
    pub(crate) states: States,
    /// The files that shaders asked for.
    pub(crate) files_used: FilesUsed,
    /// The number of object states.
    objects: AtomicU32,
    /// The number of saves to databases before the frame that the context was made for.
    pub(crate) saves_before: u64,
    /// True when the scene may be rendered again.
    pub keeps: bool,
    /// What changed before each frame, from the second one on.
    pub(crate) history: Vec<Changes>,
    /// The set of random numbers of the pass that is rendered, and its round.
    set: AtomicU32,
    round: AtomicU32,
    /// A bit for each noise source that has other random numbers than the pass.
    varied: AtomicU32,
    /// A bit for each noise source that drew random numbers.
    drawn: AtomicU32,
    /// The factor of "maxerror" of records, as the bits of a float.
    tolerance: AtomicU32,
    /// The bits of the factor of all numbers of samples.
    samples: AtomicU32,
    /// True when every record traces all its rays, whatever "adaptive" is.
    all_rays: AtomicBool,
}

/// The name of an environment map, and the upper direction that a shader gives it.
pub(crate) type MapFrame = (String, String);

/// Records, and clusters of the far ones.
pub(crate) type Clustered = (Arc<Packed>, Arc<Clusters>);

/// The attributes "spatialdb:read" and so on (reference 4.3.9), which are lists that grow with every call.
fn database_attributes(scene: &Scene) -> Attributes {
    let names = |key: Key<scope::Global, Option<Arc<[Arc<str>]>>>| -> Vec<String> {
        let list = scene.get(key).unwrap_or_default();
        list.iter().map(ToString::to_string).collect()
    };
    Attributes {
        read: names(attr::SPATIALDB_READ),
        write: names(attr::SPATIALDB_WRITE),
        readonly: names(attr::SPATIALDB_READONLY),
        writeonly: names(attr::SPATIALDB_WRITEONLY),
    }
}

/// The key of an object state: the address of the attribute set, whether the primitive has its own "opacity", and
/// whether it is a grid with colours.
pub(crate) type ObjectKey = (usize, bool, bool);

/// Cached states by the address of their source. The scene keeps all sources alive, so an address identifies one of
/// them for the whole frame.
#[derive(Default)]
pub(crate) struct States {
    /// The states of objects.
    pub(crate) objects: OnceMap<ObjectKey, Arc<ObjectState>>,
    pub(crate) groups: OnceMap<(usize, ShaderUsage), Option<Arc<LinkedShaders>>>,
    pub(crate) default_surface: OnceLock<Arc<LinkedShaders>>,
}

/// Returns the largest number of texture files open at once: "limits:texturefiles", and no more than three quarters
/// of the files that the process may have open. The others are for images that are written, shaders, databases and
/// sockets.
fn texture_files(attribute: i32, open_files: Option<usize>) -> usize {
    let most = open_files.map_or(usize::MAX, |limit| limit / 4 * 3);
    usize::try_from(attribute).unwrap_or(0).min(most).max(1)
}

/// Returns an empty cache of the texture files of a scene.
pub(crate) fn texture_cache(
    scene: &Scene,
    camera: &CameraView,
    environment: &ShadingEnvironment,
) -> TextureCache {
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
    TextureCache::new(
        environment.registry.clone(),
        environment.texture_path.clone(),
        options,
        environment.reporter.clone(),
    )
}

/// Makes parameters stay on the grid for later shaders of the object and for lights that query them. Returns true when
/// those of the displacement shaders do.
pub(crate) fn keep_parameters(state: &ObjectState, groups: &[&Group]) -> bool {
    let mut displacement_says = false;
    for shaders in [state.displacement.as_ref(), Some(&state.surface)].into_iter().flatten() {
        let kind = crate::object::kind(shaders.usage);
        if groups.iter().any(|group| group.usage() != kind && group.listens_to(kind)) {
            shaders.group.keep_parameters();
            displacement_says |= shaders.usage == ShaderUsage::Displacement;
        }
    }
    displacement_says
}

impl ShadingContext {
    /// Links the lights and prepares the rest. It loads no surface, opens no texture and builds no ray structures.
    pub fn new(scene: &Arc<Scene>, camera: &CameraView, environment: &ShadingEnvironment) -> Self {
        let reporter = environment.reporter.clone();
        let linker = Linker { library: &*environment.shaders, reporter: &reporter, complains: None };
        let lights = scene.lights.iter().map(|light| LightState::new(light, linker)).collect();
        let textures = texture_cache(scene, camera, environment);
        let threads = match environment.threads {
            0 => usize::try_from(scene.get(attr::LIMITS_THREADS)).unwrap_or(1).max(1),
            n => n,
        };
        Self {
            spaces: Spaces::new(scene, camera),
            units: Units::new(scene),
            rays: RayWorld::new(scene, threads).with_accelerator(environment.shaders.accelerator()),
            texts: Texts::default(),
            files: environment.registry.files().clone(),
            light_cache: IrradianceCache::default(),
            scene: scene.clone(),
            camera: camera.clone(),
            eye_world: camera.position_world(),
            textures,
            dynamic: None,
            lights,
            library: environment.shaders.clone(),
            databases: environment.databases.clone(),
            database_attributes: database_attributes(scene),
            texture_path: environment.texture_path.clone(),
            directions: OnceMap::default(),
            clustered: OnceMap::default(),
            states: States::default(),
            stop: environment.stop.clone(),
            files_used: FilesUsed::new(environment.texture_path.clone()),
            objects: AtomicU32::new(0),
            saves_before: environment.databases.saves(),
            keeps: false,
            history: Vec::new(),
            set: AtomicU32::new(0),
            round: AtomicU32::new(0),
            varied: AtomicU32::new(0),
            drawn: AtomicU32::new(0),
            tolerance: AtomicU32::new(1.0_f32.to_bits()),
            samples: AtomicU32::new(1.0_f32.to_bits()),
            all_rays: AtomicBool::new(false),
            reporter,
        }
    }

    /// Begins a pass of an image that is the sum of passes. It must not be called while a thread shades.
    pub fn begin_pass(&self, numbers: PassNumbers) {
        let replaced = |place: &AtomicU32, new: u32| place.swap(new, Ordering::Relaxed) != new;
        let changed = [
            replaced(&self.set, numbers.set),
            replaced(&self.round, numbers.round),
            replaced(&self.varied, numbers.varied.bits()),
        ];
        if changed.contains(&true) {
            self.light_cache.clear();
        }
    }

    /// Returns the sequence of a seed in the round of the present pass. All numbers that seeds are used for come from
    /// sequences: the same seed occurs in each round.
    pub(crate) fn sequence(&self, seed: u32) -> Sequence {
        Sequence { seed, round: self.round.load(Ordering::Relaxed) }
    }

    /// Returns the seed of `random ()`, which is combined with those of grids; 0 has no effect. Where it `varies`,
    /// `random ()` draws other numbers in each round.
    pub(crate) fn random_seed(&self, varies: bool) -> u32 {
        let seed = self.scene.get(attr::RANDOM_SEED) as u32;
        match self.round.load(Ordering::Relaxed) {
            round if varies && round > 0 => hash::words(&[seed, round]),
            _ => seed,
        }
    }

    /// Sets the factor of "maxerror" of all records of indirect light and occlusion, above 0; 1 is what the scene says.
    /// It must not be called while a thread shades.
    pub fn set_tolerance(&self, factor: f32) {
        if self.tolerance.swap(factor.to_bits(), Ordering::Relaxed) != factor.to_bits() {
            self.light_cache.clear();
        }
    }

    /// Returns the factor of "maxerror".
    pub(crate) fn tolerance(&self) -> f32 {
        f32::from_bits(self.tolerance.load(Ordering::Relaxed))
    }

    /// Sets a factor of all numbers of samples beside "render:samples", above 0. It must not be called while a thread
    /// shades.
    pub fn set_samples(&self, factor: f32) {
        if self.samples.swap(factor.to_bits(), Ordering::Relaxed) != factor.to_bits() {
            self.light_cache.clear();
        }
    }

    /// Sets whether "adaptive" of `occlusion` and `indirect` has no effect. Points whose first rays agree then trace
    /// all the others as well: to stop there is biased, because it favours those that agree by chance. It must not be
    /// called while a thread shades.
    pub fn set_all_rays(&self, all: bool) {
        if self.all_rays.swap(all, Ordering::Relaxed) != all {
            self.light_cache.clear();
        }
    }

    pub(crate) fn traces_all_rays(&self) -> bool {
        self.all_rays.load(Ordering::Relaxed)
    }

    /// Returns the factor of all numbers of samples.
    pub(crate) fn samples(&self) -> f32 {
        self.rays.limits.samples * f32::from_bits(self.samples.load(Ordering::Relaxed))
    }

    /// Returns the noise sources of shading that drew random numbers so far.
    pub fn noise_sources(&self) -> Vec<NoiseSource> {
        let drawn = NoiseSources::from_bits(self.drawn.load(Ordering::Relaxed));
        NoiseSource::ALL.into_iter().filter(|source| drawn.contains(*source)).collect()
    }

    /// Returns the seed of random numbers that `source` draws.
    pub(crate) fn seed_of(&self, source: NoiseSource, seed: u32) -> u32 {
        self.draws(source);
        self.varied_seed(source, seed)
    }

    /// Records that `source` draws random numbers.
    pub(crate) fn draws(&self, source: NoiseSource) {
        if !NoiseSources::from_bits(self.drawn.load(Ordering::Relaxed)).contains(source) {
            self.drawn.fetch_or(NoiseSources::of(source).bits(), Ordering::Relaxed);
        }
    }

    /// Returns the same seed as [`Self::seed_of`], for numbers of which it is not known yet whether they count.
    pub(crate) fn varied_seed(&self, source: NoiseSource, seed: u32) -> u32 {
        match NoiseSources::from_bits(self.varied.load(Ordering::Relaxed)).contains(source) {
            true => hash::words(&[seed, VARIED]),
            false => seed,
        }
    }

    /// Returns a seed of the frame for the set of random numbers of the present pass.
    pub(crate) fn seed_in_pass(&self, seed: u32) -> u32 {
        match self.set.load(Ordering::Relaxed) {
            0 => seed,
            set => hash::words(&[seed, set, PASS]),
        }
    }

    /// Gives the seeds of a grid that the camera sees to the present pass.
    pub fn seed_grid(&self, grid: &mut Grid) {
        if self.set.load(Ordering::Relaxed) != 0 {
            grid.seed = self.seed_in_pass(grid.seed);
            grid.names.iter_mut().for_each(|name| *name = self.seed_in_pass(*name));
        }
    }

    /// Returns the properties of the frame that rays need.
    pub(crate) fn ray_frame(&self) -> RayFrame<'_> {
        RayFrame {
            scene: &self.scene,
            camera: &self.camera,
            eye: self.eye_world,
            reporter: &self.reporter,
            cache: &self.rays.cache,
        }
    }

    /// Returns the size in world units of a pixel of the camera at the distance of a place.
    pub(crate) fn pixel_world(&self, p: Vec3) -> f32 {
        self.ray_frame().pixel(p)
    }

    /// True when the frame must end, so that shaders must stop.
    pub(crate) fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    /// Returns the permitted use of a database, from the option "filemode" and the attributes of the scene.
    pub(crate) fn database_mode(&self, name: &str, word: &str) -> Mode {
        self.databases.mode(&self.database_attributes, name, word)
    }

    /// Returns the records that queries of a database read.
    pub(crate) fn database(&self, name: &str, mode: Mode) -> Option<Arc<Packed>> {
        self.databases.records(name, mode, &self.texture_path)
    }

    /// Returns the sampler of the light of a map; `None` when the map does not exist.
    pub(crate) fn directions(&self, name: &str, up: Option<&str>) -> Option<Arc<EnvironmentSampler>> {
        self.directions.get_or_make((name.to_owned(), up.unwrap_or("").to_owned()), || {
            let id = self.textures.find_for(name, Use::Environment)?;
            let up = up.and_then(Up::from_word);
            Some(Arc::new(maps::directions(&self.textures, id, up, self.rays.build.threads)))
        })
    }

    /// Returns the records of a database with clusters of the far ones, which are made on first use.
    pub(crate) fn clustered(&self, name: &str, mode: Mode) -> Option<Clustered> {
        self.clustered.get_or_make((name.to_owned(), mode), || {
            let records = self.database(name, mode)?;
            let clusters = Arc::new(Clusters::new(&records));
            Some((records, clusters))
        })
    }

    /// Returns the state of a primitive's object. It is made on first use, and all primitives with the same
    /// attribute set share it.
    pub fn object(&self, primitive: &Primitive) -> Arc<ObjectState> {
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
                    "object \"{name}\": \"opacity\" ({} {} {}) is clamped to ({} {} {}): it must be from 0 to 1",
                    given.x, given.y, given.z, opacity.x, opacity.y, opacity.z
                ),
            );
        }
        let group = |shaders: &Option<Arc<ShaderGroup>>, usage| self.group(shaders.as_ref()?, usage, &name);
        let surface = group(&attributes.surface, ShaderUsage::Surface);
        let displacement = group(&attributes.displacement, ShaderUsage::Displacement);
        let volume = group(&attributes.volume, ShaderUsage::Volume);
        let surface = surface.unwrap_or_else(|| self.default_surface());
        let preshaded = grid && preshaded::is_requested_by(&surface, displacement.as_ref());
        // The volume between it and the camera was included when it was shaded.
        let volume = volume.filter(|_| !preshaded);
        let shaders = StateShaders { surface, displacement, volume };
        let mut state = ObjectState::new(attributes, shaders, own_opacity, &self.spaces);
        state.preshaded = preshaded;
        state.number = self.objects.fetch_add(1, Ordering::Relaxed);
        state.lights = RwLock::new(self.shining(attributes));
        let lights = state.lights();
        let groups = self.groups(&state, &lights);
        let displacement_says = keep_parameters(&state, &groups);
        let may_batch = !state.preshaded && groups.iter().all(|group| !group.is_gridwise());
        let saves = self.saves(attributes, &groups);
        (state.may_batch, state.saves, state.displacement_says) = (may_batch, saves, displacement_says);
        state
    }

    /// True when shaders of an object may save data.
    pub(crate) fn saves(&self, attributes: &AttributeSet, groups: &[&Group]) -> bool {
        let writes = |key: Key<scope::Object, Arc<str>>| self.database_mode(&attributes.get(key), "").write;
        writes(attr::INDIRECT_SPATIALDB)
            || writes(attr::OCCLUSION_SPATIALDB)
            || groups.iter().any(|group| group.may_save())
    }

    /// Returns the lights of an attribute set that are not dark.
    pub(crate) fn shining(&self, attributes: &AttributeSet) -> Arc<[LightId]> {
        attributes.lights.iter().filter(|id| self.light(*id).is_some()).collect()
    }

    /// Returns all groups that run when the object is shaded under some lights.
    pub(crate) fn groups<'s>(&'s self, state: &'s ObjectState, lights: &[LightId]) -> Vec<&'s Group> {
        let own = [Some(&state.surface), state.displacement.as_ref(), state.volume.as_ref()];
        let own = own.into_iter().flatten().map(|shaders| &shaders.group);
        let lights = lights.iter().filter_map(|id| self.light(*id)).map(|light| &light.shaders.group);
        own.chain(lights).collect()
    }

    /// Returns a light that is not dark.
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
        let linker = Linker { library: &*self.library, reporter: &self.reporter, complains: None };
        self.states.groups.get_or_make(key, || linker.link(shaders, usage, owner).map(Arc::new))
    }

    /// Returns the default surface, which belongs to no object. Its "shader" space is the world.
    fn default_surface(&self) -> Arc<LinkedShaders> {
        let linker = Linker { library: &*self.library, reporter: &self.reporter, complains: None };
        self.states.default_surface.get_or_init(|| Arc::new(linker.default_surface())).clone()
    }

    /// Limits the bytes of ray tessellations from now on.
    pub fn limit_tessellations(&self, bytes: u64) {
        self.rays.cache.set_limit(bytes);
    }

    /// Writes the texts of `fprintf`. Returns false when one could not be written, which is reported.
    pub fn finish_texts(&self) -> bool {
        self.texts.finish(&self.files, &self.reporter)
    }

    /// Returns the counts of the work that shading the frame did and avoided.
    pub fn statistics(&self) -> ShadingStatistics {
        let (built, sets) = self.rays.built();
        let (triangles, bytes) = self.rays.size();
        let tessellations = self.rays.cache.counts();
        let count = |n: &AtomicU64| n.load(Ordering::Relaxed);
        let rays = &self.rays.counts;
        let t = self.textures.statistics();
        ShadingStatistics {
            rays: count(&rays.rays) + count(&rays.shadow_rays),
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

    /// Reports a warning once per name of a feature.
    pub(crate) fn unsupported(&self, feature: &str) {
        self.reporter.once(
            &format!("unsupported {feature}"),
            Severity::Warning,
            &Location::default(),
            format!("{feature} is not supported yet"),
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_texture_cache_leaves_open_files_for_outputs() {
        assert_eq!(texture_files(1000, None), 1000);
        assert_eq!(texture_files(1000, Some(64)), 48);
        assert_eq!(texture_files(10, Some(64)), 10);
        assert_eq!(texture_files(-5, Some(2)), 1);
    }
}
