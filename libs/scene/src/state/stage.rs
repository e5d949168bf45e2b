//! Objects that no frame shows: those of a file without `World`, or without `Render`. A program may give them a frame.
//!
//! Primitives before `World` are kept apart. At `World`, and at the end, they are reported and dropped. Until then
//! [`State::begin_stage`] may begin a frame around them, and [`State::adopt`] makes them objects of its world.

use super::current::{Current, Edit, flips_normals};
use super::{Phase, State};
use crate::{AttributeSet, Primitive, Stop, attr};
use granita_base::{Location, MotionTransform, ShapeDesc, Transform, Vec3};
use std::collections::BTreeMap;
use std::sync::Arc;

/// The numbers of points along and around a sphere of which [`State::waiting_points`] consists.
const SPHERE_POINTS: [usize; 2] = [12, 24];

impl State {
    /// Returns the reason to give the objects a frame: there are some, and the scene does not describe a frame itself.
    /// A scene describes one with `Render`; with `World` after a camera, an output or a transformation; and a file of
    /// objects alone describes none.
    pub fn lacks_frame(&self) -> bool {
        match self.phase {
            Phase::Options => !self.early.is_empty(),
            Phase::World => {
                let [camera] = &self.cameras[..] else { return false };
                let placed = camera.world_to_camera != MotionTransform::default();
                self.implicit_camera && !placed && self.outputs.is_empty() && self.primitive_count() > 0
            }
            Phase::Rerender | Phase::Done => false,
        }
    }

    /// The number of lights that the scene declared.
    pub fn light_count(&self) -> usize {
        self.lights.iter().filter(|light| !light.group.layers.is_empty()).count()
    }

    /// Returns the names of the cameras that the scene declared.
    pub fn camera_names(&self) -> Vec<Arc<str>> {
        let own = self.cameras.iter().filter(|_| !self.implicit_camera);
        own.map(|camera| camera.name.clone()).collect()
    }

    /// True when the scene declared an image.
    pub fn has_outputs(&self) -> bool {
        !self.outputs.is_empty()
    }

    /// True when the scene set this attribute of cameras, or this scene-wide one.
    pub fn is_given(&self, name: &str) -> bool {
        self.camera_values.contains_key(name) || self.globals.contains_key(name)
    }

    /// Ends the files of objects that lack a frame. The calls of a frame for them may follow: cameras, outputs,
    /// `World`, lights, [`State::adopt`] and `Render`. All attributes of objects have their defaults, the current
    /// transformation is the identity, and the lights that are on stay on.
    ///
    /// # Errors
    /// [`Stop`] when no further call has an effect.
    pub fn begin_stage(&mut self) -> Result<(), Stop> {
        self.finish_motion(&Location::default());
        self.leave_modify();
        self.group = None;
        self.read_needed(true)?;
        self.staged = std::mem::take(&mut self.early);
        if self.phase == Phase::World {
            // The frame began at the identity, so that world space stays where it is.
            self.staged = std::mem::take(&mut self.primitives);
            self.cameras.clear();
            self.implicit_camera = false;
            self.world = None;
        }
        self.phase = Phase::Options;
        self.stack.clear();
        let lights = self.current.set.lights.clone();
        self.current = Current::default();
        self.current.edit().lights = lights;
        for camera in self.camera_names() {
            self.add_to_sets(&camera);
        }
        Ok(())
    }

    /// Makes the primitives that [`State::begin_stage`] found objects of the world, before those that it has already.
    /// They take from the current state the lights, the geometry sets, the surface shader when they have none, and the
    /// attributes that are not set.
    pub fn adopt(&mut self) {
        let camera = self.shading_camera();
        let current = self.current.set.clone();
        let mut new: BTreeMap<usize, (Arc<AttributeSet>, Arc<AttributeSet>)> = BTreeMap::new();
        let mut objects = std::mem::take(&mut self.staged);
        for primitive in &mut objects {
            let old = primitive.attributes.clone();
            let (_, set) = new.entry(Arc::as_ptr(&old) as usize).or_insert_with(|| {
                let mut set = adopted(&old, &current);
                set.flip_normals = flips_normals(&set, camera.as_ref());
                (old, Arc::new(set))
            });
            Arc::make_mut(primitive).attributes = set.clone();
        }
        objects.append(&mut self.primitives);
        self.primitives = objects;
    }

    /// Returns points around the primitives that [`State::begin_stage`] found and that cameras see, in world space,
    /// each with the radius of a ball around it. Everything lies within the convex hull of these balls, except
    /// displacements.
    pub fn staged_points(&self) -> Vec<(Vec3, f32)> {
        let mut points = Vec::new();
        let seen = |p: &&Arc<Primitive>| {
            let sets = &p.attributes.geometry_sets;
            sets.iter().any(|set| &**set == "camera" || self.cameras.iter().any(|c| c.name == *set))
        };
        for primitive in self.staged.iter().filter(seen) {
            for (_, to_world) in primitive.attributes.to_world.keys() {
                hull(primitive, to_world, &mut points);
            }
        }
        points.retain(|(p, radius)| p.is_finite() && radius.is_finite());
        points
    }

    /// Reports the primitives before `World`, and drops them.
    pub(super) fn drop_early(&mut self) {
        for primitive in std::mem::take(&mut self.early) {
            self.out_of_place(&primitive.at, primitive.shape.call_name(), "before World");
        }
    }

    /// Adds a geometry set to the list of the current state.
    pub(super) fn add_to_sets(&mut self, name: &Arc<str>) {
        self.edit_sets(Edit::Allowed, |set| {
            if !set.geometry_sets.contains(name) {
                let mut sets = set.geometry_sets.to_vec();
                sets.push(name.clone());
                sets.sort();
                let value = attr::GEOMETRYSET.param(sets.join(",").into());
                set.geometry_sets = sets.into();
                Arc::make_mut(&mut set.values).insert(value.name.clone(), value);
            }
        });
    }
}

/// Returns the attributes of an object that takes from `current` what it lacks.
fn adopted(old: &AttributeSet, current: &AttributeSet) -> AttributeSet {
    let mut set = old.clone();
    current.lights.iter().for_each(|light| set.lights.switch(light, true));
    if set.surface.is_none() {
        set.surface.clone_from(&current.surface);
    }
    let mut sets: Vec<Arc<str>> =
        set.geometry_sets.iter().chain(current.geometry_sets.iter()).cloned().collect();
    sets.sort();
    sets.dedup();
    let values = Arc::make_mut(&mut set.values);
    for (name, value) in current.values.iter().filter(|(name, _)| old.values.get(name).is_none()) {
        values.insert(name.clone(), value.clone());
    }
    let list = attr::GEOMETRYSET.param(sets.join(",").into());
    values.insert(list.name.clone(), list);
    set.geometry_sets = sets.into();
    set
}

/// Adds points whose convex hull contains a primitive, each with the radius of a ball around it.
fn hull(primitive: &Primitive, to_world: &Transform, points: &mut Vec<(Vec3, f32)>) {
    if let ShapeDesc::Sphere { radius, zmin, zmax, thetamax_deg } = primitive.shape {
        let [rows, columns] = SPHERE_POINTS;
        for i in 0..=rows {
            let z = zmin + (zmax - zmin) * i as f32 / rows as f32;
            let ring = (radius * radius - z * z).max(0.0).sqrt();
            for k in 0..=columns {
                let (sin, cos) = libm::sincosf(thetamax_deg.to_radians() * k as f32 / columns as f32);
                points.push((to_world.point(Vec3::new(ring * cos, ring * sin, z)), 0.0));
            }
        }
    }
    let scale = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| to_world.vector(axis).length());
    let scale = scale.into_iter().fold(0.0, f32::max);
    for key in &primitive.keys {
        let widths = key.params.floats("width").unwrap_or_default();
        let radius = 0.5 * scale * widths.iter().copied().fold(0.0, f32::max);
        let plain = key.params.floats("P").unwrap_or_default();
        points.extend(plain.as_chunks::<3>().0.iter().map(|p| (to_world.point(Vec3::from(*p)), radius)));
        let rational = key.params.floats("Pw").unwrap_or_default();
        let divided = rational.as_chunks::<4>().0.iter().map(|[x, y, z, w]| Vec3::new(*x, *y, *z) / *w);
        points.extend(divided.map(|p| (to_world.point(p), radius)));
    }
}
