//! The geometry sets of a frame, and what ends rays.
//!
//! Geometry sets are names; sets with the same members share one structure, a [`RayScene`]. It is built by the first ray
//! that needs it; no ray, no structure.

use super::GridShaders;
use super::cache::{CACHE_BYTES, TessellationCache};
use super::scene::RayScene;
use granita_base::Color;
use granita_scene::{Scene, attr};
use std::collections::BTreeMap;
use std::sync::atomic::AtomicU64;
use std::sync::{Arc, OnceLock};

/// Layers of transparent surfaces that a ray passes, at most.
const MAX_LAYERS: usize = 256;

/// Everything that rays can meet in a frame.
pub(crate) struct RayWorld {
    /// Geometry sets by name, except those of cameras: index into `scenes`.
    sets: BTreeMap<Arc<str>, usize>,
    /// One for each different membership.
    scenes: Vec<RaySet>,
    /// Threads that may build.
    pub(crate) threads: usize,
    /// Whether some object's rays see motion.
    motion: bool,
    /// What ends a ray.
    pub(crate) limits: RayLimits,
    /// What has been traced so far.
    pub(crate) counts: RayCounts,
    /// Tessellations of all sets.
    pub(crate) cache: TessellationCache,
}

/// What ends a ray (reference 4.3.4, 4.3.5).
#[derive(Clone, Copy, Debug)]
pub(crate) struct RayLimits {
    /// "limits:opacitythreshold".
    pub(super) opacity_threshold: Color,
    /// Surfaces that a ray may meet: "limits:transparentlayers" and one more.
    pub(super) layers: usize,
    /// "ray:maxdepth".
    pub(crate) max_depth: u32,
    /// "ray:maxdepthcolor".
    pub(crate) max_depth_color: Color,
}

impl RayLimits {
    fn new(scene: &Scene) -> Self {
        let layers = usize::try_from(scene.get(attr::LIMITS_TRANSPARENTLAYERS));
        Self {
            opacity_threshold: scene.get(attr::LIMITS_OPACITYTHRESHOLD),
            layers: layers.map_or(MAX_LAYERS, |n| n.saturating_add(1).min(MAX_LAYERS)),
            max_depth: u32::try_from(scene.get(attr::RAY_MAXDEPTH)).unwrap_or(0),
            max_depth_color: scene.get(attr::RAY_MAXDEPTHCOLOR),
        }
    }
}

/// Numbers of rays, for statistics.
#[derive(Debug, Default)]
pub(crate) struct RayCounts {
    /// Rays that bring back colour, or only what they hit.
    pub(crate) rays: AtomicU64,
    /// Shadow rays.
    pub(crate) shadow_rays: AtomicU64,
    /// Hits that were shaded.
    pub(crate) shaded: AtomicU64,
}

struct RaySet {
    /// Indices of primitives, increasing.
    members: Vec<u32>,
    built: OnceLock<RayScene>,
}

impl RayWorld {
    /// Learns which primitives are in which sets; builds nothing.
    pub(crate) fn new(scene: &Scene, threads: usize) -> Self {
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
                // Members of a camera's set alone are not raytraceable (reference 4.4.3).
                if &**set == "camera" || scene.cameras.iter().any(|c| c.name == *set) {
                    continue;
                }
                match members.get_mut(set) {
                    Some(list) => list.push(index as u32),
                    None => _ = members.insert(set.clone(), vec![index as u32]),
                }
            }
        }
        let mut scenes: Vec<RaySet> = Vec::new();
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
        Self { sets, scenes, threads, motion, limits, counts, cache: TessellationCache::new(CACHE_BYTES) }
    }

    /// Whether the name is that of a geometry set that rays can be traced against.
    pub(crate) fn is_set(&self, name: &str) -> bool {
        self.sets.contains_key(name)
    }

    /// The set of this name, built if it is not yet. `None` for other names.
    pub(crate) fn scene(&self, name: &str, shaders: &dyn GridShaders) -> Option<&RayScene> {
        let index = *self.sets.get(name)?;
        let set = &self.scenes[index];
        // Not on the pool that renders buckets: a waiting pool thread could pick up a bucket whose shader
        // asks for this very set.
        let build = || RayScene::build(index as u32, &set.members, shaders, self.threads, self.motion);
        Some(set.built.get_or_init(build))
    }

    /// How many sets of different membership have been built, and how many there are.
    pub(crate) fn built(&self) -> (usize, usize) {
        (self.scenes.iter().filter(|s| s.built.get().is_some()).count(), self.scenes.len())
    }

    /// Triangles that there are for rays at the moment, and the bytes that everything takes.
    pub(crate) fn size(&self) -> (u64, u64) {
        let built = self.scenes.iter().filter_map(|s| s.built.get()).map(RayScene::size);
        let kept = self.cache.counts();
        built.fold((kept.triangles, kept.bytes), |sum, size| (sum.0 + size.0, sum.1 + size.1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::Fixture;

    #[test]
    fn sets_of_equal_members_share_and_cameras_have_none() {
        let mut f = Fixture::new(&[]);
        for sets in [&["camera", "a", "b"][..], &["cam", "a", "b", "c"][..]] {
            let attributes = f.attributes("", sets, &[]);
            f.rectangle([-1.0; 2], [1.0; 2], 0.0, attributes);
        }
        let (scene, _, _) = f.finish();
        let world = RayWorld::new(&scene, 1);
        assert_eq!(world.sets.keys().map(|k| &**k).collect::<Vec<_>>(), ["a", "b", "c"]);
        assert_eq!(world.sets["a"], world.sets["b"]);
        assert_ne!(world.sets["a"], world.sets["c"]);
        assert_eq!(world.built(), (0, 2));
    }
}
