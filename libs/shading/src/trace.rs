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
mod tests;
