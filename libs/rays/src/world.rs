//! The geometry sets of a frame, and the limits that terminate rays.
//!
//! A geometry set is a name. Sets with the same members share one structure, a [`RayScene`]. The first ray that needs
//! the structure builds it. A set that no ray is traced against is never built.

use super::cache::{CACHE_BYTES, TessellationCache};
use super::scene::{RayBuild, RayScene};
use super::{GridShaders, RayObject};
use granita_base::Color;
use granita_scene::{Scene, attr};
use granita_trace::Accelerator;
use std::collections::BTreeMap;
use std::sync::atomic::AtomicU64;
use std::sync::{Arc, OnceLock};

/// The largest number of transparent surfaces that a ray passes.
const MAX_LAYERS: usize = 256;

/// All geometry sets of a frame that rays can hit.
pub struct RayWorld<O> {
    /// The index into `scenes` of each geometry set by name, except the sets of cameras.
    sets: BTreeMap<Arc<str>, usize>,
    /// One entry for each different membership.
    scenes: Vec<RaySet<O>>,
    /// How sets are built.
    pub build: RayBuild,
    /// The limits that terminate a ray.
    pub limits: RayLimits,
    /// The numbers of rays traced so far.
    pub counts: RayCounts,
    /// The tessellations of all sets.
    pub cache: TessellationCache,
}

/// The limits that terminate a ray (reference 4.3.4, 4.3.5).
#[derive(Clone, Copy, Debug)]
pub struct RayLimits {
    /// The attribute "limits:opacitythreshold".
    pub opacity_threshold: Color,
    /// The number of surfaces that a ray may hit: "limits:transparentlayers" and one more.
    pub layers: usize,
    /// The attribute "ray:maxdepth".
    pub max_depth: u32,
    /// The attribute "ray:maxdepthcolor".
    pub max_depth_color: Color,
    /// The attribute "ray:deepsamples", at least 0.
    pub deep_samples: f32,
    /// The attribute "ray:minweight", at least 0.
    pub min_weight: f32,
    /// The attribute "render:samples", at least 0.
    pub samples: f32,
    /// The attribute "indirect:maxdepth".
    pub indirect_depth: u32,
}

impl RayLimits {
    fn new(scene: &Scene) -> Self {
        let layers = usize::try_from(scene.get(attr::LIMITS_TRANSPARENTLAYERS));
        Self {
            opacity_threshold: scene.get(attr::LIMITS_OPACITYTHRESHOLD),
            layers: layers.map_or(MAX_LAYERS, |n| n.saturating_add(1).min(MAX_LAYERS)),
            max_depth: u32::try_from(scene.get(attr::RAY_MAXDEPTH)).unwrap_or(0),
            max_depth_color: scene.get(attr::RAY_MAXDEPTHCOLOR),
            deep_samples: scene.get(attr::RAY_DEEPSAMPLES).max(0.0),
            min_weight: scene.get(attr::RAY_MINWEIGHT).max(0.0),
            samples: scene.get(attr::RENDER_SAMPLES).max(0.0),
            indirect_depth: u32::try_from(scene.get(attr::INDIRECT_MAXDEPTH)).unwrap_or(0),
        }
    }
}

/// Numbers of rays, for the statistics.
#[derive(Debug, Default)]
pub struct RayCounts {
    /// The number of rays that return a colour, or only what they hit.
    pub rays: AtomicU64,
    /// The number of shadow rays.
    pub shadow_rays: AtomicU64,
    /// The number of hits that were shaded.
    pub shaded: AtomicU64,
}

struct RaySet<O> {
    /// The indices of the primitives, increasing.
    members: Vec<u32>,
    built: OnceLock<RayScene<O>>,
}

impl<O: RayObject> RayWorld<O> {
    /// Collects the members of each set. It builds no structure.
    pub fn new(scene: &Scene, threads: usize) -> Self {
        let mut members: BTreeMap<Arc<str>, Vec<u32>> = BTreeMap::new();
        let mut motion = false;
        let mut last = std::ptr::null();
        for (index, primitive) in scene.primitives.iter().enumerate() {
            let attributes = &primitive.attributes;
            if Arc::as_ptr(attributes) != last {
                motion = motion || attributes.get(attr::RAY_MOTION);
                last = Arc::as_ptr(attributes);
            }
            for set in attributes.geometry_sets.iter() {
                // Primitives that are members of a camera's set alone are not raytraceable (reference 4.4.3).
                if &**set == "camera" || scene.cameras.iter().any(|c| c.name == *set) {
                    continue;
                }
                match members.get_mut(set) {
                    Some(list) => list.push(index as u32),
                    None => _ = members.insert(set.clone(), vec![index as u32]),
                }
            }
        }
        let mut scenes: Vec<RaySet<O>> = Vec::new();
        let mut sets = BTreeMap::new();
        for (name, members) in members {
            let known = scenes.iter().position(|s| s.members == members);
            let index = known.unwrap_or_else(|| {
                scenes.push(RaySet { members, built: OnceLock::new() });
                scenes.len() - 1
            });
            sets.insert(name, index);
        }
        let (limits, counts) = (RayLimits::new(scene), RayCounts::default());
        let build = RayBuild { threads, motion, accelerator: None };
        Self { sets, scenes, build, limits, counts, cache: TessellationCache::new(CACHE_BYTES) }
    }

    /// Sets the processor that traces large batches of rays, before the first set is built.
    pub fn with_accelerator(mut self, accelerator: Option<Arc<dyn Accelerator>>) -> Self {
        self.build.accelerator = accelerator;
        self
    }

    /// True when there is any geometry set.
    pub fn has_sets(&self) -> bool {
        !self.sets.is_empty()
    }

    /// True when rays can be traced against the geometry set of this name.
    pub fn is_set(&self, name: &str) -> bool {
        self.sets.contains_key(name)
    }

    /// Returns the set of this name, and builds it first if necessary. `None` for other names.
    pub fn scene(&self, name: &str, shaders: &dyn GridShaders<O>) -> Option<&RayScene<O>> {
        let index = *self.sets.get(name)?;
        let set = &self.scenes[index];
        // This does not run on the pool that renders buckets. A waiting pool thread could take a bucket whose shader
        // requests this same set.
        let build = || RayScene::build(index as u32, &set.members, shaders, &self.build);
        Some(set.built.get_or_init(build))
    }

    /// Returns the number of sets of different membership that have been built, and the number of all of them.
    pub fn built(&self) -> (usize, usize) {
        (self.scenes.iter().filter(|s| s.built.get().is_some()).count(), self.scenes.len())
    }

    /// Returns the number of triangles that exist for rays now, and the bytes that all structures occupy.
    pub fn size(&self) -> (u64, u64) {
        let built = self.scenes.iter().filter_map(|s| s.built.get()).map(RayScene::size);
        let kept = self.cache.counts();
        built.fold((kept.triangles, kept.bytes), |sum, size| (sum.0 + size.0, sum.1 + size.1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::Object;
    use granita_fixture::Fixture;

    #[test]
    fn sets_of_equal_members_share_a_scene_and_camera_sets_have_none() {
        let mut f = Fixture::new(&[]);
        for sets in [&["camera", "a", "b"][..], &["cam", "a", "b", "c"][..]] {
            let attributes = f.attributes("", sets, &[]);
            f.rectangle([-1.0; 2], [1.0; 2], 0.0, attributes);
        }
        let world = RayWorld::<Object>::new(&f.view().0, 1);
        assert_eq!(world.sets.keys().map(|k| &**k).collect::<Vec<_>>(), ["a", "b", "c"]);
        assert_eq!(world.sets["a"], world.sets["b"]);
        assert_ne!(world.sets["a"], world.sets["c"]);
        assert_eq!(world.built(), (0, 2));
    }
}
