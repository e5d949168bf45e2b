//! The context of a frame, prepared for the next render of the same scene (reference 11.1).
//!
//! Between two renders of a scene in re-rendering mode, lights and the lights of objects change, and files on disk. The
//! geometry, its tessellations for rays, the linked shaders of objects, the tiles of textures and the records of
//! indirect light stay as far as they do not depend on what changed.

use crate::ShadingEnvironment;
use crate::context::{ObjectKey, ShadingContext, States, keep_parameters, texture_cache};
use crate::lighting::lights::LightState;
use crate::memo::{Changes, Dependency, Memo};
use crate::object::{Linker, ObjectState};
use crate::texts::Texts;
use granita_base::OnceMap;
use granita_scene::{AttributeSet, Light, LightId, Scene, attr};
use std::collections::HashMap;
use std::sync::Arc;
use std::sync::atomic::Ordering;

impl ShadingContext {
    /// Prepares the context for a scene with the same geometry and cameras, whose lights differ. Returns false when the
    /// context cannot be used for that scene.
    pub fn renew(&mut self, scene: &Arc<Scene>, environment: &ShadingEnvironment) -> bool {
        if scene.primitives.len() != self.scene.primitives.len()
            || scene.coordinate_systems != self.scene.coordinate_systems
        {
            return false;
        }
        if self.databases.saves() != self.saves_before {
            // Frames read what those before them saved.
            return false;
        }
        let before = self.scene.clone();
        let follows = |scene: &Scene| scene.get(attr::RERENDER_RESHADERAYS);
        if follows(scene) && !follows(&before) {
            // Nobody noted what rays hit.
            return false;
        }
        (self.library, self.reporter) = (environment.shaders.clone(), environment.reporter.clone());
        let mut changes = Changes::default();
        self.renew_lights(&before, scene, &mut changes);
        self.scene = scene.clone();
        if !self.renew_objects(&before, scene, &mut changes) {
            return false;
        }
        if !self.renew_files(&before, environment, &mut changes) {
            return false;
        }
        self.light_cache.forget(&changes);
        self.texts = Texts::default();
        self.reset_counts();
        self.history.push(changes);
        true
    }

    /// Returns the number of the frame that the context was prepared for, from 0.
    pub fn frame(&self) -> u64 {
        self.history.len() as u64
    }

    /// Returns what changed before the present frame.
    pub fn changes(&self) -> Option<&Changes> {
        self.history.last()
    }

    /// Returns what changed after a frame.
    fn changes_since(&self, frame: u64) -> &[Changes] {
        self.history.get(frame as usize..).unwrap_or_default()
    }

    /// True when something changed after the frame `since` that the results of a memo depend on.
    pub fn is_stale(&self, memo: &Memo, since: u64) -> bool {
        self.changes_since(since).iter().any(|changes| memo.is_stale(changes))
    }

    /// Drops the answers of a memo that depend on something that changed after the frame `since`.
    pub fn forget(&self, memo: &mut Memo, since: u64) {
        self.changes_since(since).iter().for_each(|changes| memo.forget(changes));
    }

    /// Returns how many tessellations and geometry sets were built so far.
    pub fn built_for_rays(&self) -> (u64, u64) {
        (self.rays.cache.counts().made, self.rays.built().0 as u64)
    }

    /// Links the lights that changed.
    fn renew_lights(&mut self, before: &Scene, scene: &Scene, changes: &mut Changes) {
        let library = self.library.clone();
        let linker = Linker { library: &*library, reporter: &self.reporter, complains: None };
        self.lights.truncate(scene.lights.len());
        for (index, light) in scene.lights.iter().enumerate() {
            let id = LightId(index as u32);
            let old = before.lights.get(index);
            let is_same = old.is_some_and(|old| Arc::ptr_eq(old, light) || shines_alike(old, light));
            if !light.attributes.get(attr::RERENDER_CACHELIGHTS) {
                changes.add(Dependency::Light(id));
            }
            if is_same && index < self.lights.len() {
                continue;
            }
            changes.add(Dependency::Light(id));
            let state = LightState::new(light, linker);
            let info = |state: &Option<LightState>| state.as_ref().map(|state| state.info.clone());
            if self.lights.get(index).map(info) != Some(info(&state)) {
                changes.add(Dependency::Kind(id));
            }
            match self.lights.get_mut(index) {
                Some(place) => *place = state,
                None => self.lights.push(state),
            }
        }
    }

    /// Gives the states of objects their new lights. Returns false when grids must be prepared in another way.
    fn renew_objects(&mut self, before: &Scene, scene: &Scene, changes: &mut Changes) -> bool {
        // An attribute set is replaced by one set for all primitives that share it.
        let mut new_sets: HashMap<usize, Arc<AttributeSet>> = HashMap::new();
        let mut last = std::ptr::null();
        for (old, new) in before.primitives.iter().zip(&scene.primitives) {
            if Arc::as_ptr(&old.attributes) != last {
                last = Arc::as_ptr(&old.attributes);
                new_sets.insert(last as usize, new.attributes.clone());
            }
        }
        let mut renewed: Vec<(ObjectKey, Arc<ObjectState>)> = Vec::new();
        for ((address, opacity, grid), state) in self.states.objects.made() {
            let Some(attributes) = new_sets.get(&address) else { continue };
            let lights = self.shining(attributes);
            let were = state.lights();
            if *were != *lights {
                changes.add(Dependency::Object(state.number));
            }
            if !self.is_prepared_alike(&state, &lights) {
                return false;
            }
            *state.lights.write() = lights;
            renewed.push(((Arc::as_ptr(attributes) as usize, opacity, grid), state));
        }
        // Groups are found by the address of their source. The states keep what they use of them.
        let States { default_surface, .. } = std::mem::take(&mut self.states);
        let groups = OnceMap::default();
        self.states = States { objects: renewed.into_iter().collect(), groups, default_surface };
        true
    }

    /// True when the grids of an object are prepared under some lights as they were before.
    fn is_prepared_alike(&self, state: &ObjectState, lights: &[LightId]) -> bool {
        let groups = self.groups(state, lights);
        let may_batch = !state.preshaded && groups.iter().all(|group| !group.is_gridwise());
        let saves = self.saves(&state.attributes, &groups);
        // What a displacement shader said is not on the grids unless somebody asked for it.
        let says = keep_parameters(state, &groups);
        (may_batch, saves) == (state.may_batch, state.saves) && (state.displacement_says || !says)
    }

    /// Looks for files that changed. Returns false when the context cannot read them again.
    fn renew_files(
        &mut self,
        before: &Scene,
        environment: &ShadingEnvironment,
        changes: &mut Changes,
    ) -> bool {
        let pattern = self.scene.get(attr::RERENDER_FILEPATTERN);
        let changed = self.files_used.changed(&pattern, self.rays.build.threads, &self.reporter);
        let limits =
            |scene: &Scene| (scene.get(attr::LIMITS_TEXTUREMEMORY), scene.get(attr::LIMITS_TEXTUREFILES));
        let moved = before.get(attr::PATH_TEXTURE) != self.scene.get(attr::PATH_TEXTURE);
        if moved {
            self.texture_path = environment.texture_path.clone();
            self.files_used.set_path(environment.texture_path.clone());
            self.files_used.all().for_each(|number| changes.add(Dependency::File(number)));
        }
        let used: Vec<u32> = if moved { self.files_used.all().collect() } else { changed.clone() };
        if self.files_used.changes_shapes(&used) {
            return false;
        }
        if !changed.is_empty() || moved || limits(before) != limits(&self.scene) {
            // Maps that are made on demand belong to their cache.
            if self.dynamic.is_some() {
                return false;
            }
            self.textures = texture_cache(&self.scene, &self.camera, environment);
        }
        if !changed.is_empty() || moved {
            self.directions = OnceMap::default();
            self.clustered = OnceMap::default();
        }
        changed.into_iter().for_each(|number| changes.add(Dependency::File(number)));
        true
    }

    /// Sets the counts of the statistics to 0.
    fn reset_counts(&self) {
        let counts = &self.rays.counts;
        let cache = &self.light_cache;
        for count in
            [&counts.rays, &counts.shadow_rays, &counts.shaded, &cache.records, &cache.rays, &cache.points]
        {
            count.store(0, Ordering::Relaxed);
        }
    }
}

/// True when two lights are the same but for the places of their declarations.
fn shines_alike(a: &Light, b: &Light) -> bool {
    let layers = || a.group.layers.iter().zip(&b.group.layers);
    let (of_a, of_b) = (&a.attributes, &b.attributes);
    a.name == b.name
        && (&of_a.values, &of_a.to_world, &of_a.geometry_sets)
            == (&of_b.values, &of_b.to_world, &of_b.geometry_sets)
        && a.group.connections == b.group.connections
        && a.group.layers.len() == b.group.layers.len()
        && layers().all(|(a, b)| {
            (&a.shader, &a.layer, &a.params, &a.to_world) == (&b.shader, &b.layer, &b.params, &b.to_world)
        })
}
