//! A frame as shaders see it.

use crate::dynamic::DynamicMaps;
use crate::lighting::cache::LightCache;
use crate::lighting::directions::Directions;
use crate::lighting::lights::LightState;
use crate::object::{LinkedShaders, Linker, ObjectState, StateShaders};
use crate::rays::Seen;
use crate::rays::world::RayWorld;
use crate::services::maps;
use crate::spaces::{Spaces, Units};
use crate::texts::Texts;
use crate::{CameraView, RenderEnvironment, ShaderLibrary, ShadingStatistics, finite, preshaded};
use granita_base::{Files, Location, OnceMap, Reporter, SearchPath, Severity, Vec3};

use granita_scene::attribute::{Key, scope};
use granita_scene::{LightId, Primitive, Scene, ShaderGroup, ShaderUsage, attr};
use granita_sdb::{Attributes, Clusters, Databases, Mode, Packed};
use granita_shade::Group;
use granita_texture::{CacheOptions, TextureCache, Up, Use};
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

    /// What rays need of it.
    pub(crate) fn seen(&self) -> Seen<'_> {
        Seen {
            scene: &self.scene,
            camera: &self.camera,
            eye: self.eye_world,
            reporter: &self.reporter,
            cache: &self.rays.cache,
        }
    }

    /// Size of a pixel of the camera at the distance of a place.
    pub(crate) fn pixel_world(&self, p: Vec3) -> f32 {
        self.seen().pixel(p)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn textures_leave_files_for_outputs() {
        assert_eq!(texture_files(1000, None), 1000);
        assert_eq!(texture_files(1000, Some(64)), 48);
        assert_eq!(texture_files(10, Some(64)), 10);
        assert_eq!(texture_files(-5, Some(2)), 1);
    }
}
