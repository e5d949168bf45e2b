//! One bucket: collect, hide, filter; and the making of its grids.

use super::cells::{finer, kept};
use super::job::{Job, LeafSlot, Sighting};
use super::{Eye, Frame, FrameShader, Holdout, Jobs};
use crate::dicing::{GridView, Leaf, Viewer, Viewpoint, key_at, make_grid};
use crate::film;
use crate::griddump::{Described, is_identity};
use crate::hider::{SampleGrid, ShadedGrid, Surfaces, ViewedGrid};
use crate::preshaded::GridTraits;
use crate::statistics::{add, add_time};
use crate::{PixelRect, Projection};
use granita_base::{Color, Severity, Vec3};
use granita_geom::Dice;
use granita_shade::{Grid, Lanes3, RayKind};
use std::cmp::{Ordering, Reverse};
use std::collections::BinaryHeap;
use std::time::Instant;

/// How far (pixels) two grids may be apart at their common border. Their points there are the same, but normals that
/// differ in their last bits, or texture filters, may displace them differently.
const RIM_PX: f32 = 0.02;

/// What a bucket looks at next: a primitive, or a grid of it.
#[derive(Clone, Copy, Debug)]
struct Turn {
    /// Nothing of it is nearer.
    z: f32,
    job: usize,
    leaf: Option<u32>,
}

impl Ord for Turn {
    fn cmp(&self, other: &Self) -> Ordering {
        self.z.total_cmp(&other.z).then(self.job.cmp(&other.job)).then(self.leaf.cmp(&other.leaf))
    }
}

impl PartialOrd for Turn {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Turn {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other).is_eq()
    }
}

impl Eq for Turn {}

impl<S: FrameShader> Frame<'_, S> {
    /// Renders a bucket; returns the pixels of every image.
    pub(super) fn bucket(
        &self,
        jobs: &Jobs<S::Object>,
        index: usize,
        thread: &mut S::Thread<'_>,
    ) -> Vec<Vec<f32>> {
        let rect = self.buckets.order[index];
        let blurred = self.blurred(jobs, index);
        let samples = SampleGrid::new(rect.grown(self.margin), &self.pattern, self.options.camera, &blurred);
        let see = |eye| self.seen_by(eye, (jobs, index), &samples, thread);
        let pixels = (0..self.eyes.len()).flat_map(see).collect();
        add(&self.counters.samples, self.eyes.len() * samples.within(&rect));
        pixels
    }

    /// Where in a bucket blurred grids may be seen. What may blur is split for that; nothing else is.
    fn blurred(&self, jobs: &Jobs<S::Object>, index: usize) -> Vec<PixelRect> {
        let bucket = u32::try_from(index).unwrap_or(u32::MAX);
        let mut blurred = Vec::new();
        for eye in 0..self.eyes.len() {
            for &job in &jobs.of_bucket[index] {
                let job = &jobs.list[job];
                if job.seen[eye].blurs {
                    let split = self.split(job);
                    let seen =
                        split.leaves_of(eye, bucket).map(|leaf| &split.leaves[leaf as usize].seen[eye]);
                    blurred.extend(seen.filter(|seen| seen.blurs).map(|seen| seen.rect));
                }
            }
        }
        blurred
    }

    /// What an eye sees in a bucket; the pixels of every image.
    fn seen_by(
        &self,
        eye: usize,
        (jobs, index): (&Jobs<S::Object>, usize),
        samples: &SampleGrid,
        thread: &mut S::Thread<'_>,
    ) -> Vec<Vec<f32>> {
        let mut surfaces = Surfaces::new(samples, self.composite);
        let bucket = u32::try_from(index).unwrap_or(u32::MAX);
        // Front to back, so that what is hidden is found hidden before it is split and shaded. The order among any two
        // grids is the same in every bucket: a primitive comes before its grids, which have its depth at least.
        let mut order: BinaryHeap<Reverse<Turn>> = BinaryHeap::new();
        let turn = |z: f32, job: usize, leaf: Option<u32>| Reverse(Turn { z, job, leaf });
        let here = |job: &Job<S::Object>| !job.seen[eye].rect.intersection(&samples.rect).is_empty();
        let near = jobs.of_bucket[index].iter().filter(|j| here(&jobs.list[**j]));
        order.extend(near.map(|&j| turn(jobs.list[j].seen[eye].z_min, j, None)));
        let mut hiding = std::time::Duration::ZERO;
        while let Some(Reverse(Turn { z, job: j, leaf })) = order.pop() {
            let job = &jobs.list[j];
            // What lies behind the first surface counts for "avgz".
            let may_cull = job.culls_hidden && !self.outputs.needs_second_surface;
            let Some(slot_number) = leaf else {
                if may_cull && surfaces.hides(&job.seen[eye].rect, z) {
                    add(&self.counters.primitives_hidden, 1);
                    self.pass(job, eye, bucket);
                } else {
                    let split = self.split(job);
                    let z_of = |leaf: u32| split.leaves[leaf as usize].seen[eye].z_min.max(z);
                    order.extend(split.leaves_of(eye, bucket).map(|leaf| turn(z_of(leaf), j, Some(leaf))));
                }
                continue;
            };
            let slot = &self.split(job).leaves[slot_number as usize];
            if may_cull && surfaces.hides(&slot.seen[eye].rect, z) {
                add(&self.counters.grids_hidden, 1);
            } else if let Some(grid) = slot.grid(|leaf| {
                let grid = self.shade(job, slot, leaf, thread)?;
                self.dump(&grid, job, (j, slot_number));
                Some(grid)
            }) {
                let begin = Instant::now();
                surfaces.add(&grid, eye);
                hiding += begin.elapsed();
            }
            slot.release();
        }
        let begin = Instant::now();
        let values = surfaces.resolve(&self.outputs.wanted);
        add_time(&self.counters.hide_nanos, hiding + begin.elapsed());
        let begin = Instant::now();
        let (images, rect) = (&self.outputs.images, &self.buckets.order[index]);
        let mut pixels: Vec<Vec<f32>> = Vec::with_capacity(images.len());
        for (k, (image, filter)) in images.iter().zip(&self.filters).enumerate() {
            // What goes to a file and to a viewer is filtered once.
            let same = images[..k].iter().position(|other| other.is_filtered_like(image));
            pixels.push(match (same, image.opaque_width) {
                (Some(same), _) => pixels[same].clone(),
                (None, Some(width)) => surfaces.volumes(rect, image.channels.len(), width),
                (None, None) => film::filter(filter, samples, &values, &image.channels, rect),
            });
        }
        add_time(&self.counters.filter_nanos, begin.elapsed());
        pixels
    }

    /// Hands a grid that was shaded to "griddump:filename".
    fn dump(&self, grid: &ShadedGrid, job: &Job<S::Object>, order: (usize, u32)) {
        let Some(dump) = self.options.dump else { return };
        let described = Described {
            order,
            name: job.primitive.attributes.name(),
            variables: &self.outputs.variables,
            eye: self.eyes[0].camera,
        };
        dump.add(grid, &described);
    }

    /// Dices, displaces and shades a grid; `None` when nothing of it can be seen.
    fn shade(
        &self,
        job: &Job<S::Object>,
        slot: &LeafSlot,
        leaf: &Leaf,
        thread: &mut S::Thread<'_>,
    ) -> Option<ShadedGrid> {
        let begin = Instant::now();
        let (primitive, placement) = (&*job.primitive, &job.placement);
        let dicing_camera = self.options.dicing_camera;
        let key_times = leaf.piece.key_times();
        let dice = leaf.dice(&Viewer::new(dicing_camera, placement, key_times));
        if dice.nu < 2 || dice.nv < 2 || dice.p.is_empty() {
            return None;
        }
        let view = GridView {
            viewpoint: match dicing_camera.projection {
                Projection::Perspective { .. } => Viewpoint::From(dicing_camera.position_world()),
                Projection::Orthographic => Viewpoint::Along(dicing_camera.direction_world()),
            },
            time: dicing_camera.shading_time(),
            dtime: self.options.camera.shutter[1] - self.options.camera.shutter[0],
            ray: RayKind::default(),
        };
        let mut grid = make_grid(&dice, key_times, primitive, placement, &view);
        add_time(&self.counters.dice_nanos, begin.elapsed());
        let begin = Instant::now();
        let before = job.traits.displaces.then(|| grid.p.clone());
        if job.traits.displaces {
            self.shader.displace(thread, &job.object, &mut grid);
        }
        let kept = kept(&dice, job, &grid);
        if kept.as_ref().is_some_and(|cells| !cells.kept.contains(&true)) {
            return None;
        }
        let matte = job.traits.holdout == Holdout::Matte;
        let wants_colors = self.outputs.needs_shading || self.options.dump.is_some();
        let must_shade = !matte && (wants_colors || !job.traits.opaque);
        let n = grid.len();
        let mut variables = Vec::new();
        if must_shade {
            let wanted = &self.outputs.variables;
            let found = self.shader.shade(thread, &job.object, &mut grid, wanted);
            for (k, (_, ty)) in wanted.iter().enumerate() {
                let size = ty.components() * n;
                match found.get(k) {
                    Some(Some(values)) if values.len() == size => variables.extend_from_slice(values),
                    // A shader without the variable shows 0 (reference 7.3.6).
                    _ => variables.resize(variables.len() + size, 0.0),
                }
            }
            add(&self.counters.grids_shaded, 1);
            add(&self.counters.points_shaded, n);
        } else {
            add(&self.counters.grids_unshaded, 1);
        }
        add_time(&self.counters.shade_nanos, begin.elapsed());
        let (mut color, mut opacity) = (Vec::new(), Vec::new());
        if must_shade {
            color = self.colors(&grid.c, job, "colour");
            opacity = self.colors(&grid.opacity, job, "opacity");
        }
        let opaque = opacity.iter().all(|o| o.cmpge(Color::ONE).all());
        if opaque {
            opacity = Vec::new();
        }
        // A grid that comes shaded may bring along what the hider knew of it.
        let given = leaf.piece.lattice().map(|_| GridTraits::new(&primitive.keys[0].params, leaf));
        let per_side = kept.as_ref().map_or(1, |cells| cells.per_side);
        let before = before.as_ref();
        let rim_px = given.as_ref().and_then(|g| g.rim_px);
        let diced = Diced { dice: &dice, key_times, grid: &grid, before, per_side, rim_px };
        let views = self.views(job, slot, &diced);
        if per_side > 1 {
            for colors in [&mut color, &mut opacity].into_iter().filter(|c| !c.is_empty()) {
                *colors = finer(colors, dice.nu, per_side);
            }
            variables =
                variables.chunks_exact(n).flat_map(|values| finer(values, dice.nu, per_side)).collect();
        }
        let shaded = ShadedGrid {
            nu: (dice.nu - 1) * per_side + 1,
            nv: (dice.nv - 1) * per_side + 1,
            primitive: given.as_ref().and_then(|g| g.primitive).unwrap_or(primitive.id),
            views,
            color,
            opacity,
            opaque,
            holdout: job.traits.holdout,
            variables,
            kept: kept.map_or_else(Vec::new, |cells| cells.kept),
            sides: given.as_ref().map_or([true; 4], |g| g.sides),
        };
        if before.is_some() {
            self.check_displacement(&shaded, job);
        }
        Some(shaded)
    }

    /// A grid as each eye sees it.
    fn views(&self, job: &Job<S::Object>, slot: &LeafSlot, diced: &Diced<'_>) -> Box<[ViewedGrid]> {
        let nu = diced.dice.nu;
        let times = job.placement.times();
        let p_world = positions(job, diced);
        let view = |(eye, seen): (&Eye<'_>, &Sighting)| {
            let mut p_cam: Vec<Vec<Vec3>> = Vec::with_capacity(times.len());
            for (time, points) in times.iter().zip(&p_world) {
                let to_camera = eye.camera.world_to_camera.at(*time);
                let to_world = job.placement.to_world.at(*time);
                p_cam.push(
                    match job.traits.preshaded && is_identity(&to_world.then(&to_camera), &to_camera) {
                        true => diced.object_points(*time),
                        false => points.iter().map(|p| to_camera.point(*p)).collect(),
                    },
                );
            }
            let rim_px = diced.rim_px.unwrap_or(RIM_PX);
            if diced.per_side > 1 {
                p_cam.iter_mut().for_each(|p| *p = finer(p, nu, diced.per_side));
            }
            // What does not blur is where it is when the shutter opens.
            let keys = if seen.blurs { times.len() } else { 1 };
            p_cam.truncate(keys);
            let defocus = self.pattern.defocus && seen.blurs;
            let nu = (nu - 1) * diced.per_side + 1;
            let grid = ViewedGrid::new(eye.camera, nu, times[..keys].to_vec(), p_cam, defocus);
            ViewedGrid { rect: seen.rect, z_min: seen.z_min, rim_px, ..grid }
        };
        self.eyes.iter().zip(&slot.seen).map(view).collect()
    }

    /// Colours of a grid; what is no number becomes black, with one message per object.
    fn colors(&self, lanes: &Lanes3, job: &Job<S::Object>, what: &str) -> Vec<Color> {
        let mut bad = false;
        let colors = (0..lanes.len())
            .map(|i| {
                let c = lanes.get(i);
                if c.is_finite() {
                    return c;
                }
                bad = true;
                Color::from_array(c.to_array().map(|v| if v.is_finite() { v } else { 0.0 }))
            })
            .collect();
        if bad {
            let name = job.primitive.attributes.name();
            self.options.reporter.once(
                &format!("not finite {what} {name}"),
                Severity::Warning,
                &job.primitive.at,
                format!("object \"{name}\": its shader gave a {what} that is no finite number; 0 is used"),
            );
        }
        colors
    }

    /// Warns about points that a displacement moved out of the bound it declared.
    fn check_displacement(&self, grid: &ShadedGrid, job: &Job<S::Object>) {
        let region = self.region;
        let outside = |view: &ViewedGrid| {
            let ([x0, y0, x1, y1], z) = view.bound(0..grid.nu * grid.nv);
            let rect = view.rect;
            // Where nothing is seen nothing is missed.
            !rect.is_empty()
                && ((x0 < rect.x0 as f32 && rect.x0 > region.x0)
                    || (y0 < rect.y0 as f32 && rect.y0 > region.y0)
                    || (x1 > rect.x1 as f32 && rect.x1 < region.x1)
                    || (y1 > rect.y1 as f32 && rect.y1 < region.y1)
                    || z < view.z_min)
        };
        if grid.views.iter().any(outside) {
            let attributes = &job.primitive.attributes;
            let (name, radius) = (attributes.name(), attributes.float("displace:maxradius"));
            self.options.reporter.once(
                &format!("displacement bound {name}"),
                Severity::Warning,
                &job.primitive.at,
                format!(
                    "object \"{name}\": displaced farther than \"displace:maxradius\" {radius}; it is cut off"
                ),
            );
        }
    }
}

/// A grid after shading, with what it was diced from.
struct Diced<'a> {
    dice: &'a Dice,
    key_times: &'a [f32],
    grid: &'a Grid,
    /// Where its points were before they were displaced.
    before: Option<&'a Lanes3>,
    /// Cells along each side of a micropolygon.
    per_side: usize,
    /// By how much its rim is to be widened, where that is known.
    rim_px: Option<f32>,
}

impl Diced<'_> {
    /// Its points in object space before they were displaced.
    fn object_points(&self, time: f32) -> Vec<Vec3> {
        let (a, b, alpha) = key_at(self.key_times, time);
        let (first, second) = (&self.dice.p[a], &self.dice.p[b]);
        if alpha == 0.0 {
            return first.clone();
        }
        first.iter().zip(second).map(|(p, q)| p.lerp(*q, alpha)).collect()
    }
}

/// World space positions at all times of the placement.
///
/// A displacement is computed once, when the shutter opens, and moves with the surface.
fn positions<O>(job: &Job<O>, diced: &Diced<'_>) -> Vec<Vec<Vec3>> {
    let Diced { grid, before, .. } = *diced;
    let placement = &job.placement;
    let back = placement.to_world.at(grid.time).inverse();
    let offset = |i: usize| match before {
        Some(before) => back.vector(grid.p.get(i) - before.get(i)),
        None => Vec3::ZERO,
    };
    let at = |time: f32| {
        if time == grid.time {
            // The very points that were shaded.
            return (0..grid.len()).map(|i| grid.p.get(i)).collect();
        }
        let to_world = placement.to_world.at(time);
        let points = diced.object_points(time).into_iter().enumerate();
        points.map(|(i, p)| to_world.point(p + offset(i))).collect()
    };
    placement.times().iter().map(|time| at(*time)).collect()
}
