//! Traces rays and shades their hits.
//!
//! Rays come in the batches that a shading grid makes. Their hits are gathered by object, made into grids and
//! shaded by the same executor as everything else. The result of a ray depends on the ray alone. The random numbers
//! at its hits follow from its seed, so that neither threads, buckets nor batches show.

use crate::memo::{Answer, Dependencies, Dependency, Entry};
use crate::object::RayScene;
use crate::services::recall;
use crate::{ShaderThread, ShadingContext};
use granita_base::{Color, Location, Severity, Vec3, hash};
use granita_dicing::finite;
use granita_gsl::ir::ValueType;
use granita_rays::mesh::FLATNESS_PX;
use granita_rays::{HitShading, Located, MeshHit, RayMesh, RayObject, RayRequest, SetHit, grid_of, mesh_hit};

use granita_shade::{HitValues, Primvar, PrimvarData, RayKind};

use std::sync::Arc;
use std::sync::atomic::Ordering;

/// The largest number of hits shaded as one grid.
const GRID_HITS: usize = 128;
/// The largest number of hits whose tessellations are held at once.
const LOCATED_HITS: usize = 1024;
/// The smallest step from one hit to the next, relative to the distance.
const STEP: f32 = 1.0e-6;

/// The purpose of a batch of rays.
#[derive(Clone, Copy, Debug)]
pub(crate) struct RayPurpose {
    /// The ray kind of the shader that traces.
    pub(crate) parent: RayKind,
    /// True when hits are for indirect illumination.
    pub(crate) indirect: bool,
    /// The number of bounces of indirect light up to the hits.
    pub(crate) bounces: u32,
    /// True when hits are shaded. Otherwise only their places are found.
    pub(crate) shade: bool,
    /// The length of time that the shading stands for.
    pub(crate) dtime: f32,
}

impl RayPurpose {
    fn hits(&self, ray: RayKind) -> HitShading {
        HitShading { ray, time: 0.0, dtime: self.dtime, seed: 0, derivatives: false }
    }
}

/// The result of a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Radiance {
    /// The light of all surfaces along the ray, composited from the nearest to the farthest.
    pub(crate) color: Color,
    /// Their composited opacity.
    pub(crate) opacity: Color,
    /// The distance to the nearest hit; infinite when nothing was hit.
    pub(crate) distance: f32,
    /// The position of the nearest hit.
    pub(crate) p: Vec3,
    /// The unit shading normal of the nearest hit.
    pub(crate) n: Vec3,
}

impl Radiance {
    /// The result of a ray that hits nothing.
    pub(crate) const NOTHING: Self = Self {
        color: Color::ZERO,
        opacity: Color::ZERO,
        distance: f32::INFINITY,
        p: Vec3::ZERO,
        n: Vec3::ZERO,
    };
}

/// A hit that is not shaded yet.
#[derive(Clone, Copy)]
struct Pending {
    ray: u32,
    hit: SetHit,
}

impl ShaderThread<'_> {
    /// Returns the colour and opacity along each ray. Hits are shaded front to back until the result is opaque.
    /// `said` holds the messages and parameters of the shader that traces, for the shaders that query them.
    pub(crate) fn radiance(
        &mut self,
        scene: &RayScene,
        rays: &[RayRequest],
        why: RayPurpose,
        said: &[Primvar],
    ) -> Vec<Radiance> {
        self.radiance_and(scene, rays, why, said, &[]).0
    }

    /// Does the same as [`ShaderThread::radiance`], and also returns the `wanted` variables of the shaders of the
    /// nearest hits: for each ray its components, or nothing.
    pub(crate) fn radiance_and(
        &mut self,
        scene: &RayScene,
        rays: &[RayRequest],
        why: RayPurpose,
        said: &[Primvar],
        wanted: &[(Arc<str>, ValueType)],
    ) -> (Vec<Radiance>, Vec<HitValues>) {
        let none = |ty: ValueType| vec![0.0; ty.components() * rays.len()];
        let mut values: Vec<HitValues> = wanted
            .iter()
            .map(|(_, ty)| HitValues { there: vec![false; rays.len()], values: none(*ty) })
            .collect();
        let mut out = vec![Radiance::NOTHING; rays.len()];
        let hits = self.nearest(scene, rays, why);
        let mut waiting: Vec<Pending> = Vec::with_capacity(rays.len());
        for (k, hit) in hits.iter().enumerate().filter(|(_, h)| h.is_hit()) {
            out[k].distance = hit.t;
            out[k].p = rays[k].ray.origin + rays[k].ray.dir * hit.t;
            waiting.push(Pending { ray: k as u32, hit: *hit });
        }
        if !why.shade {
            self.for_located(scene, &waiting, &mut |_, located, group| {
                for (at, k) in group.iter().enumerate() {
                    let w = waiting[*k];
                    let found = &mut out[w.ray as usize];
                    found.opacity = Color::ONE;
                    if let Some((mesh, triangle)) = located.get(at) {
                        found.n = mesh.normal(&mesh_hit(&rays[w.ray as usize], &w.hit, triangle));
                    }
                }
            });
            return (out, values);
        }
        let rays_of_frame = &self.frame().rays;
        rays_of_frame.counts.rays.fetch_add(rays.len() as u64, Ordering::Relaxed);
        let limits = rays_of_frame.limits;
        let kind = RayKind {
            level: why.parent.level + 1,
            shadow: false,
            indirect: why.indirect,
            bounces: why.bounces,
        };
        let mut layer = 0;
        while !waiting.is_empty() {
            let how = why.hits(kind);
            // Only the nearest hits are queried.
            let wanted = if layer == 0 { wanted } else { &[] };
            let talk = Talk { said, wanted, values: &mut values };
            let shaded = self.shade_hits(scene, rays, &waiting, how, talk);
            layer += 1;
            let mut behind = Vec::new();
            for (w, Shaded { color, opacity, n }) in waiting.iter().zip(shaded) {
                let sum = &mut out[w.ray as usize];
                if layer == 1 {
                    sum.n = n;
                }
                let through = Color::ONE - sum.opacity;
                sum.color += through * color;
                sum.opacity += through * opacity;
                let blocks = sum.opacity.cmpge(limits.opacity_threshold).all();
                let holdout = scene.object(&w.hit).holdout != granita_scene::Holdout::None;
                if !blocks && !holdout && (layer as usize) < limits.layers {
                    let next = self.next_behind(scene, &rays[w.ray as usize], w.hit.t);
                    if next.is_hit() {
                        behind.push(Pending { ray: w.ray, hit: next });
                    }
                }
            }
            waiting = behind;
        }
        (out, values)
    }

    /// Returns the nearest hits of rays. They are kept for re-renders, in which geometry stays. Those of the many rays
    /// for records of indirect light are not kept.
    fn nearest(&mut self, scene: &RayScene, rays: &[RayRequest], why: RayPurpose) -> Arc<[SetHit]> {
        let keeps = !why.parent.shadow && !why.indirect && !self.builds_rays;
        if self.memo.is_none() || !keeps || rays.is_empty() {
            return scene.closest(self, rays).into();
        }
        let key = recall::nearest(scene, rays);
        if let Some(Answer::Hits(hits)) =
            self.memo.as_mut().and_then(|memo| memo.find(key)).map(|entry| &entry.answer)
        {
            return hits.clone();
        }
        let hits: Arc<[SetHit]> = scene.closest(self, rays).into();
        if let Some(memo) = &mut self.memo {
            memo.open();
            let answer = Answer::Hits(hits.clone());
            memo.close(key, Some(Entry::new(answer, Dependencies::default(), 0, Vec::new())));
        }
        hits
    }

    /// Returns the share of the light that passes along each ray, 1 where nothing blocks it.
    ///
    /// Objects that are opaque to shadows block without being shaded. The opacity of the others comes from their
    /// shaders, which run only when no opaque object blocks the ray. Where all objects are opaque,
    /// [`RayScene::any`] is faster.
    pub(crate) fn transmission(
        &mut self,
        scene: &RayScene,
        rays: &[RayRequest],
        why: RayPurpose,
        said: &[Primvar],
    ) -> Vec<Color> {
        self.frame().rays.counts.shadow_rays.fetch_add(rays.len() as u64, Ordering::Relaxed);
        let mut out = vec![Color::ONE; rays.len()];
        let mut waiting: Vec<Pending> = Vec::new();
        for (k, ray) in rays.iter().enumerate() {
            let first = waiting.len();
            let wall = scene.closest_where(self, ray, &mut |hit| {
                let object = scene.object(hit);
                if ray.leaving.hides(&**object, hit.t) {
                    return false;
                }
                let opaque = object.opaque_to_shadows;
                if !opaque {
                    waiting.push(Pending { ray: k as u32, hit: *hit });
                }
                opaque
            });
            if wall.is_hit() {
                out[k] = Color::ZERO;
                waiting.truncate(first);
                continue;
            }
            // The order does not depend on the structure, and each triangle counts once.
            waiting[first..]
                .sort_by(|a, b| a.hit.t.total_cmp(&b.hit.t).then(a.hit.order().cmp(&b.hit.order())));
            // Both triangles at an edge may report the same intersection.
            let mut kept = first;
            for at in first..waiting.len() {
                let again = kept > first
                    && scene.primitive(&waiting[kept - 1].hit) == scene.primitive(&waiting[at].hit)
                    && waiting[at].hit.t - waiting[kept - 1].hit.t <= STEP * waiting[at].hit.t;
                if !again {
                    waiting[kept] = waiting[at];
                    kept += 1;
                }
            }
            waiting.truncate(kept);
        }
        let kind = RayKind { shadow: true, ..why.parent };
        let talk = Talk { said, wanted: &[], values: &mut [] };
        let shaded = self.shade_hits(scene, rays, &waiting, why.hits(kind), talk);
        for (w, Shaded { opacity, .. }) in waiting.iter().zip(shaded) {
            out[w.ray as usize] *= Color::ONE - opacity;
        }
        out
    }

    /// Returns the next hit beyond distance `t`.
    fn next_behind(&mut self, scene: &RayScene, request: &RayRequest, t: f32) -> SetHit {
        let past = t + STEP * t.abs();
        scene.closest_where(self, request, &mut |hit| hit.t > past && scene.counts(request, hit))
    }

    /// Finds the meshes of hits, some hits at a time. `visit` receives them with the range of their hits.
    fn for_located(
        &mut self,
        scene: &RayScene,
        pending: &[Pending],
        visit: &mut dyn FnMut(&mut Self, &Located<'_>, &[usize]),
    ) {
        let mut order: Vec<usize> = (0..pending.len()).collect();
        order.sort_by_key(|k| (scene.primitive(&pending[*k].hit).0, pending[*k].hit.order().0, *k));
        for group in order.chunks(LOCATED_HITS) {
            let hits: Vec<SetHit> = group.iter().map(|k| pending[*k].hit).collect();
            let located = scene.locate(self, &hits);
            visit(self, &located, group);
        }
    }

    /// Shades hits and returns their appearance in their order. This function sets the time and derivatives of
    /// `how`.
    fn shade_hits(
        &mut self,
        scene: &RayScene,
        rays: &[RayRequest],
        pending: &[Pending],
        how: HitShading,
        talk: Talk<'_>,
    ) -> Vec<Shaded> {
        let Talk { said, wanted, values } = talk;
        let outer = self.notes_of_rays();
        let mut out = vec![Shaded { color: Color::ZERO, opacity: Color::ONE, n: Vec3::ZERO }; pending.len()];
        self.frame().rays.counts.shaded.fetch_add(pending.len() as u64, Ordering::Relaxed);
        self.for_located(scene, pending, &mut |thread, located, group| {
            // Hits share a grid when primitive, strings and time are the same.
            let mut order: Vec<((u32, u64, u32), usize, usize)> = Vec::with_capacity(group.len());
            for (at, &k) in group.iter().enumerate() {
                let Some((mesh, triangle)) = located.get(at) else { continue };
                let time = rays[pending[k].ray as usize].ray.time.to_bits();
                let (primitive, _) = scene.primitive(&pending[k].hit);
                order.push(((primitive, mesh.strings_of(triangle), time), k, at));
            }
            order.sort_unstable();
            for run in order.chunk_by(|a, b| a.0 == b.0) {
                let ((_, _, time), first, _) = run[0];
                let object = scene.object(&pending[first].hit).clone();
                if how.ray.shadow && object.opaque_to_shadows {
                    continue;
                }
                if !how.ray.shadow {
                    thread.note(Dependency::Object(object.number));
                }
                let (_, id) = scene.primitive(&pending[first].hit);
                let derivatives = thread.frame().wants_derivatives(&object, how.ray);
                for part in run.chunks(GRID_HITS) {
                    let place = |&(_, k, at): &(_, usize, usize)| {
                        let (mesh, triangle) = located.get(at)?;
                        Some((mesh, mesh_hit(&rays[pending[k].ray as usize], &pending[k].hit, triangle)))
                    };
                    let hits: Vec<(&RayMesh, MeshHit)> = part.iter().filter_map(place).collect();
                    let time = f32::from_bits(time);
                    let how = HitShading { time, seed: id, derivatives, ..how };
                    let mut grid = grid_of(&hits, &*object, how);
                    grid.names = names(part.iter().map(|o| &pending[o.1]), rays, id, grid.len());
                    let paths = part.iter().map(|o| rays[pending[o.1].ray as usize].path);
                    grid.paths = paths.cycle().take(grid.len()).collect();
                    for (lane, (_, k, _)) in part.iter().enumerate() {
                        out[*k].n = grid.n.get(lane).normalize_or_zero();
                    }
                    if !said.is_empty() && object.queries_parent() {
                        let lanes: Vec<u32> =
                            part.iter().map(|o| rays[pending[o.1].ray as usize].lane).collect();
                        grid.parent = said.iter().filter_map(|v| of_rays(v, &lanes, grid.len())).collect();
                    }
                    if object.displacement.is_some() && !object.displaces_rays() {
                        thread.bump(&object, &mut grid);
                    }
                    let found = thread.shade_asked(&object, &mut grid, wanted);
                    for (found, values) in found.iter().zip(values.iter_mut()) {
                        let Some(found) = found else { continue };
                        for (lane, (_, k, _)) in part.iter().enumerate() {
                            let ray = pending[*k].ray as usize;
                            values.there[ray] = true;
                            for (c, component) in found.chunks_exact(grid.len()).enumerate() {
                                values.values[c * rays.len() + ray] = component[lane];
                            }
                        }
                    }
                    let mended = |color: Color, what: &str| {
                        finite::mended(color).map_or(color, |mended| {
                            thread.frame().report_unusable(&object, what);
                            mended
                        })
                    };
                    for (lane, (_, k, _)) in part.iter().enumerate() {
                        out[*k].color = mended(grid.c.get(lane), "colour");
                        let opacity = mended(grid.opacity.get(lane), "opacity");
                        out[*k].opacity = opacity.clamp(Color::ZERO, Color::ONE);
                    }
                }
            }
        });
        self.join_notes(outer);
        out
    }
}

/// The data that shaders exchange along rays.
struct Talk<'a> {
    /// Messages and parameters of the shader that traces.
    said: &'a [Primvar],
    /// The variables that it requests from the shaders of the hits.
    wanted: &'a [(Arc<str>, ValueType)],
    /// Their values, by ray.
    values: &'a mut [HitValues],
}

/// The appearance of a hit.
#[derive(Clone, Copy, Debug)]
struct Shaded {
    color: Color,
    opacity: Color,
    /// The unit shading normal before bumps.
    n: Vec3,
}

impl ShadingContext {
    /// Reports that a ray computed values that are not finite on an object, with the same message as for camera
    /// samples.
    fn report_unusable(&self, object: &crate::object::ObjectState, what: &str) {
        let name = &object.name;
        self.reporter.once(
            &format!("not finite {what} {name}"),
            Severity::Warning,
            &Location::default(),
            format!("object \"{name}\": its shader gave {}", finite::reason(what)),
        );
    }

    /// Returns the largest distance in world units between a ray tessellation and its surface at `p`, with a
    /// margin. Nearer hits of the object that a ray leaves belong to the same surface.
    pub(crate) fn ray_margin(&self, p: Vec3) -> f32 {
        3.0 * FLATNESS_PX * self.pixel_world(p)
    }

    /// True when a shader that runs where this object is hit reads neighbouring points.
    fn wants_derivatives(&self, object: &crate::object::ObjectState, kind: RayKind) -> bool {
        object.at_ray_hits().any(|s| s.group.needs_derivatives())
            || !kind.shadow
                && object
                    .lights()
                    .iter()
                    .filter_map(|l| self.light(*l))
                    .any(|l| l.shaders.group.needs_derivatives())
    }
}

/// Returns the seeds of the points of a grid of hits. They depend on each hit alone, so that results do not show
/// which hits were batched. Neighbours have the seeds of their hits.
fn names<'p>(
    hits: impl Iterator<Item = &'p Pending>,
    rays: &[RayRequest],
    id: u32,
    points: usize,
) -> Vec<u32> {
    let name = |w: &Pending| hash::words(&[rays[w.ray as usize].name, id, w.hit.t.to_bits()]);
    let centres: Vec<u32> = hits.map(name).collect();
    centres.iter().cycle().take(points).copied().collect()
}

/// Returns a value of the shader that traces for each of `points` points: those of the hits' rays, then again those
/// of their neighbours.
fn of_rays(value: &Primvar, lanes: &[u32], points: usize) -> Option<Primvar> {
    let data = match &value.data {
        PrimvarData::Floats { values, varying: true } => {
            let size = value.ty.width().max(1);
            let width = values.len() / size;
            let at = |c: usize, i: usize| values.get(c * width + lanes[i % lanes.len()] as usize).copied();
            let all: Option<Vec<f32>> =
                (0..size).flat_map(|c| (0..points).map(move |i| (c, i))).map(|(c, i)| at(c, i)).collect();
            PrimvarData::Floats { values: all?, varying: true }
        }
        same => same.clone(),
    };
    Some(Primvar { data, ..value.clone() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::{Finish as _, Fixture, param};
    use granita_base::{MotionTransform, Transform};
    use granita_rays::Leaving;
    use granita_rays::sampling::{Distribution, in_cone};
    use granita_scene::AttributeSet;
    use granita_trace::Ray;

    fn request(origin: Vec3, dir: Vec3, time: f32) -> RayRequest {
        let ray = Ray { origin, tmin: 0.0, dir, tmax: f32::INFINITY, time };
        RayRequest::new(ray)
    }

    #[test]
    fn primitive_variables_follow_their_rays() {
        let ty = granita_base::ParamType::of(granita_base::BaseType::Color);
        let value = |values: &[f32], varying| Primvar {
            name: "x".into(),
            ty,
            data: PrimvarData::Floats { values: values.into(), varying },
        };
        let of = |v: &Primvar, lanes: &[u32], points| of_rays(v, lanes, points).map(|v| v.data);
        let v = value(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], true);
        // Two lanes; hits of rays of the second, the first and the second.
        let wanted = [2.0, 1.0, 2.0, 4.0, 3.0, 4.0, 6.0, 5.0, 6.0];
        assert_eq!(of(&v, &[1, 0, 1], 3), Some(value(&wanted, true).data));
        let wanted = [2.0, 2.0, 2.0, 4.0, 4.0, 4.0, 6.0, 6.0, 6.0];
        assert_eq!(of(&v, &[1], 3), Some(value(&wanted, true).data));
        assert_eq!(of(&v, &[7], 1), None);
        let same = value(&[1.0, 2.0, 3.0], false);
        assert_eq!(of(&same, &[7], 9), Some(same.data.clone()));
    }

    const UNSHADED: RayPurpose = RayPurpose {
        parent: RayKind { level: 0, shadow: false, indirect: false, bounces: 0 },
        indirect: false,
        bounces: 0,
        shade: false,
        dtime: 0.0,
    };

    #[test]
    fn hits_of_a_sphere_lie_on_the_sphere() {
        let mut f = Fixture::new(&[]);
        let center = Vec3::new(0.0, 1.0, 0.0);
        let ball = f.attributes("", &["set"], &[]);
        f.sphere(center, 1.0, ball);
        let (scene, camera, environment) = f.finish();
        let frame = ShadingContext::new(&scene, &camera, &environment);
        let rays: Vec<RayRequest> = (0..500)
            .map(|i| request(Vec3::Z * 5.0, in_cone(-Vec3::Z, 0.6, Distribution::Uniform, i, 3), 0.0))
            .collect();
        let set = frame.rays.scene("set", &frame).unwrap();
        let found = ShaderThread::new(&frame).radiance(set, &rays, UNSHADED, &[]);
        let mut hits = 0;
        for (r, found) in rays.iter().zip(found) {
            let to = center - r.ray.origin;
            let b = to.dot(r.ray.dir);
            let discriminant = b * b - (to.length_squared() - 1.0);
            // At the silhouette a fraction of a pixel decides.
            if discriminant.abs() < 0.05 {
                continue;
            }
            assert_eq!(discriminant > 0.0, found.distance.is_finite());
            if discriminant > 0.0 {
                hits += 1;
                // The distance from the sphere is at most that of the tessellation: a pixel is 0.042 units at
                // distance 10.
                let off = 1.0 - found.p.distance(center);
                assert!((-1e-5..2.0 * 0.042 * FLATNESS_PX).contains(&off), "{off}");
                assert!((found.p - (r.ray.origin + r.ray.dir * found.distance)).length() < 1e-5);
                assert!((found.n - (found.p - center).normalize()).length() < 0.02);
                assert_eq!(found.opacity, Color::ONE);
            }
        }
        assert!(hits > 50, "{hits}");
    }

    #[test]
    fn rays_see_motion_only_with_the_attribute() {
        for motion in [0, 1] {
            let mut f = Fixture::new(&[]);
            let shutter = param("float[2] shutter", &[0.0_f32, 1.0][..]);
            f.scene.cameras[0].params.set(shutter);
            let moving = f.attributes("", &["set"], &[param("int ray:motion", motion)]);
            let keys = vec![(0.0, Transform::IDENTITY), (1.0, Transform::translate(Vec3::X * 10.0))];
            let to_world = MotionTransform::from_keys(keys).unwrap();
            f.rectangle([-1.0; 2], [1.0; 2], 0.0, AttributeSet { to_world, ..moving });
            let (scene, camera, environment) = f.finish();
            let frame = ShadingContext::new(&scene, &camera, &environment);
            let set = frame.rays.scene("set", &frame).unwrap();
            let rays = [
                request(Vec3::new(0.0, 0.0, 5.0), -Vec3::Z, 0.0),
                request(Vec3::new(0.0, 0.0, 5.0), -Vec3::Z, 0.5),
                request(Vec3::new(5.0, 0.0, 5.0), -Vec3::Z, 0.5),
            ];
            let rays = rays.map(|r| r.ray);
            let hit = set.any(&mut ShaderThread::new(&frame), &rays, &|_| [0.0; 2], &|_| Leaving::default());
            assert_eq!(hit, if motion == 1 { [true, false, true] } else { [true, true, false] });
        }
    }

    #[test]
    fn rays_hit_primitives_only_while_they_exist() {
        // Times of the motion keys; whether rays at 0.25 and 0.75 hit, without "ray:motion" and with it.
        let cases = [
            ([0.5, 1.0], [false, false], [false, true]),
            ([-1.0, 0.5], [true, true], [true, false]),
            ([0.0, 1.0], [true, true], [true, true]),
            ([2.0, 3.0], [false, false], [false, false]),
        ];
        for (times, still, moving) in cases {
            for (motion, wanted) in [(0, still), (1, moving)] {
                let mut f = Fixture::new(&[]);
                f.scene.cameras[0].params.set(param("float[2] shutter", &[0.0_f32, 1.0][..]));
                let here = f.attributes("", &["set"], &[param("int ray:motion", motion)]);
                let primitive = f.rectangle([-1.0; 2], [1.0; 2], 0.0, here);
                let key = |time| granita_scene::ShapeKey { time, ..primitive.keys[0].clone() };
                Arc::make_mut(&mut f.scene.primitives[0]).keys = times.map(key).to_vec();
                let (scene, camera, environment) = f.finish();
                let frame = ShadingContext::new(&scene, &camera, &environment);
                let set = frame.rays.scene("set", &frame).unwrap();
                let down = |time| request(Vec3::new(0.1, 0.2, 5.0), -Vec3::Z, time).ray;
                let hit = set.any(
                    &mut ShaderThread::new(&frame),
                    &[down(0.25), down(0.75)],
                    &|_| [0.0; 2],
                    &|_| Leaving::default(),
                );
                assert_eq!(hit, wanted, "{times:?} {motion}");
            }
        }
    }

    #[test]
    fn triangles_take_less_than_120_bytes() {
        let mut f = Fixture::new(&[]);
        // The sphere is so near that its flatness needs many triangles.
        let ball = f.attributes("", &["set"], &[]);
        f.sphere(Vec3::ZERO, 500.0, ball);
        let (scene, camera, environment) = f.finish();
        let frame = ShadingContext::new(&scene, &camera, &environment);
        let set = frame.rays.scene("set", &frame).unwrap();
        assert_eq!(frame.rays.size().0, 0);
        // The rays start from its centre in all directions.
        let rays: Vec<RayRequest> = (0..5000)
            .map(|i| request(Vec3::ZERO, in_cone(Vec3::Z, 3.2, Distribution::Uniform, i, 3), 0.0))
            .collect();
        let rays: Vec<Ray> = rays.iter().map(|r| r.ray).collect();
        let blocked = set.any(&mut ShaderThread::new(&frame), &rays, &|_| [0.0; 2], &|_| Leaving::default());
        assert!(blocked.iter().all(|b| *b));
        let (triangles, bytes) = frame.rays.size();
        assert!(triangles > 10_000, "{triangles}");
        assert!(bytes < 120 * triangles, "{} bytes each", bytes as f64 / triangles as f64);
    }
}
