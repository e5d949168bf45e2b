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
use crate::{CameraView, PixelRect, Projection};
use granita_base::{Color, Severity, Vec2, Vec3};
use granita_geom::Dice;
use granita_shade::{Grid, Lanes3, RayKind};
use std::time::Instant;

/// No rim is wider than this, in pixels.
const MOST_RIM_PX: f32 = 4.0;

impl<S: FrameShader> Frame<'_, S> {
    /// Renders a bucket; returns the pixels of every image.
    pub(super) fn bucket(
        &self,
        jobs: &Jobs<S::Object>,
        index: usize,
        thread: &mut S::Thread<'_>,
    ) -> Vec<Vec<f32>> {
        let rect = self.buckets.order[index];
        let mut blurred = Vec::new();
        let orders: Vec<Vec<Visit>> =
            (0..self.eyes.len()).map(|eye| self.visits(eye, jobs, index, &mut blurred)).collect();
        let samples = SampleGrid::new(rect.grown(self.margin), &self.pattern, self.options.camera, &blurred);
        let see = |(eye, order)| self.seen_by(eye, order, (jobs, index), &samples, thread);
        let pixels = orders.into_iter().enumerate().flat_map(see).collect();
        add(&self.counters.samples, self.eyes.len() * samples.within(&rect));
        pixels
    }

    /// The grids that an eye may see in a bucket, front to back, so that what is hidden is found hidden before it is
    /// shaded. The order among any two grids is the same in every bucket. Adds to `blurred` where blurred ones may be.
    fn visits(
        &self,
        eye: usize,
        jobs: &Jobs<S::Object>,
        index: usize,
        blurred: &mut Vec<PixelRect>,
    ) -> Vec<Visit> {
        let bucket = u32::try_from(index).unwrap_or(u32::MAX);
        let mut order = Vec::new();
        for &job in &jobs.of_bucket[index] {
            let split = self.split(&jobs.list[job]);
            for leaf in split.leaves_of(eye, bucket) {
                let seen = &split.leaves[leaf as usize].seen[eye];
                order.push(Visit { z_min: seen.z_min, job, leaf });
                if seen.blurs {
                    blurred.push(seen.rect);
                }
            }
        }
        order.sort_by(|a, b| a.z_min.total_cmp(&b.z_min).then(a.job.cmp(&b.job)).then(a.leaf.cmp(&b.leaf)));
        order
    }

    /// What an eye sees in a bucket; the pixels of every image.
    fn seen_by(
        &self,
        eye: usize,
        order: Vec<Visit>,
        (jobs, index): (&Jobs<S::Object>, usize),
        samples: &SampleGrid,
        thread: &mut S::Thread<'_>,
    ) -> Vec<Vec<f32>> {
        let mut surfaces = Surfaces::new(samples, self.composite);
        let mut hiding = std::time::Duration::ZERO;
        for Visit { z_min, job: j, leaf: slot_number } in order {
            let job = &jobs.list[j];
            let slot = &self.split(job).leaves[slot_number as usize];
            // What lies behind the first surface counts for "avgz".
            let may_cull = job.culls_hidden && !self.outputs.needs_second_surface;
            if may_cull && surfaces.hides(&slot.seen[eye].rect, z_min) {
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
        let pixels = images
            .iter()
            .zip(&self.filters)
            .map(|(image, filter)| match image.opaque_width {
                Some(width) => surfaces.volumes(rect, image.channels.len(), width),
                None => film::filter(filter, samples, &values, &image.channels, rect),
            })
            .collect();
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
            ragged: before.is_some() || given.as_ref().is_some_and(|g| g.ragged),
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
            let mut rim_px = (0.02 / job.settings.quality).clamp(0.02, 0.25);
            if let Some(given) = diced.rim_px {
                rim_px = given;
            }
            if diced.before.is_some() {
                rim_px = roughness_px(eye.camera, &p_cam, nu, diced.dice.nv).clamp(rim_px, MOST_RIM_PX);
            }
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

/// A look at a grid.
struct Visit {
    z_min: f32,
    /// Index in [`Jobs::list`].
    job: usize,
    leaf: u32,
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

/// How far (pixels) a neighbour that is diced differently may be off the borders of a displaced grid.
///
/// Undisplaced surfaces are diced so finely that their edges stay together; what a displacement does between two
/// points nobody knows, but between three it shows in how far the middle one is off the other two.
fn roughness_px(camera: &CameraView, p_cam: &[Vec<Vec3>], nu: usize, nv: usize) -> f32 {
    let mut worst = 0.0_f32;
    let perspective = matches!(camera.projection, Projection::Perspective { .. });
    let (down, across) = ((nv - 1) * nu, nu - 1);
    for p in p_cam {
        let mut off = |at: usize, step: usize| {
            let [a, b, c] = [at - step, at, at + step].map(|i| p[i]);
            let depth = b.z.max(camera.near);
            let scale = camera.raster_scale(depth).abs();
            let second = (a + c) * 0.5 - b;
            // Seen along the view nothing opens.
            let along = if perspective { b.truncate() * (second.z / depth) } else { Vec2::ZERO };
            let aside = second.truncate() - along;
            worst = worst.max((aside * scale).length() * 1.5);
        };
        for i in 1..nu.saturating_sub(1) {
            [i, down + i].into_iter().for_each(|at| off(at, 1));
        }
        for j in 1..nv.saturating_sub(1) {
            [j * nu, j * nu + across].into_iter().for_each(|at| off(at, nu));
        }
    }
    if worst.is_finite() { worst } else { 0.0 }
}
