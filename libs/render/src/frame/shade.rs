//! Dicing, displacement and shading of the grids of a primitive.

use super::cells::{Cells, finer, kept};
use super::job::{Job, LeafSlot, Sighting};
use super::kept::{Batch, BatchState, GridId, MadeGrid, Member};
use super::precise::Precise;
use super::{Eye, Frame, FrameShader, Holdout};
use crate::output::griddump::is_identity;
use crate::preshaded::GridTraits;
use crate::statistics::{add, add_time};
use granita_base::{Color, Severity, Vec3};
use granita_dicing::{GridView, Leaf, Projection, Rates, Viewer, Viewpoint, finite, key_at, make_grid};
use granita_geom::{Dice, Surface};
use granita_hider::{Shade, ShadedGrid, ViewedGrid};
use granita_scene::{Primitive, attr};
use granita_shade::{Grid, Lanes3, RayKind};
use granita_shading::Memo;
use parking_lot::Mutex;
use std::ops::Range;
use std::sync::Arc;
use std::time::Instant;

/// The largest distance in pixels of two grids at their common border. Their points there are the same, but normals
/// that differ in their last bits, or texture filters, may displace them differently.
const RIM_PX: f32 = 0.02;

/// A diced leaf, and the place of its points in the grid that is shaded.
struct Diced<'a> {
    /// The index of the leaf.
    index: usize,
    slot: &'a LeafSlot,
    leaf: &'a Leaf,
    dice: Dice,
    key_times: &'a [f32],
    /// The lanes of its points in the shaded grid.
    lanes: Range<usize>,
    /// The micropolygons that exist; `None` when all do.
    kept: Option<Cells>,
    /// Its points in double precision, when the rounding to single precision is visible.
    precise: Option<Precise>,
}

/// A grid after shading.
struct Shaded<'a> {
    /// The grid, which holds the points of all leaves of the batch.
    grid: &'a Grid,
    /// Its points before displacement; `None` without a displacement.
    before: Option<&'a Lanes3>,
    /// The requested variables, component by component, and the number of components of each; `None` when the grid was
    /// not shaded.
    variables: Option<Vec<Variable>>,
}

/// A requested variable, component by component, and the number of its components. The shader may not have it.
pub(super) type Variable = (Option<Vec<f32>>, usize);

/// The shading of a leaf at later times.
#[derive(Default)]
struct Later {
    shades: Vec<Shade>,
    /// The points before shading, and the answers of the shaders.
    kept: Vec<(f32, Grid, Memo)>,
}

impl<S: FrameShader> Frame<'_, S> {
    /// Dices, displaces and shades a batch of leaves, with the results of shading each alone. Returns `None` for leaves
    /// that are not visible. A batch has several leaves only when the object
    /// [may batch](super::ObjectTraits::may_batch).
    pub(super) fn shade(
        &self,
        job: &Job<S::Object>,
        leaves: &[(&LeafSlot, &Leaf)],
        thread: &mut S::Thread<'_>,
    ) -> Vec<Option<MadeGrid>> {
        let begin = Instant::now();
        let mut out: Vec<Option<MadeGrid>> = leaves.iter().map(|_| None).collect();
        let all = self.dice(job, leaves);
        add_time(&self.counters.dice_nanos, begin.elapsed());
        let begin = Instant::now();
        // A single small grid is batched, too, so that results do not depend on the number of grids.
        let small =
            |(_, leaf): &(&LeafSlot, &Leaf)| leaf.rates.nu * leaf.rates.nv <= super::bucket::SMALL_POINTS;
        let batched = job.traits.may_batch && leaves.iter().all(small);
        // Faces that are wound against their normals are a batch of their own.
        let (one, other): (Vec<_>, Vec<_>) = all.into_iter().partition(|(_, grid)| grid.flip_normals);
        for some in [one, other] {
            self.shade_batch(job, some, batched, &mut out, thread);
        }
        add_time(&self.counters.shade_nanos, begin.elapsed());
        out
    }

    /// Displaces and shades diced leaves and stores the results in `out`. Several leaves must be `batched`.
    fn shade_batch(
        &self,
        job: &Job<S::Object>,
        all: Vec<(Diced<'_>, Grid)>,
        batched: bool,
        out: &mut [Option<MadeGrid>],
        thread: &mut S::Thread<'_>,
    ) {
        let (mut diced, grids): (Vec<Diced<'_>>, Vec<Grid>) = all.into_iter().unzip();
        debug_assert!(grids.len() < 2 || batched && grids.iter().all(|grid| grids[0].may_batch(grid)));
        let mut end = 0;
        for (diced, grid) in diced.iter_mut().zip(&grids) {
            diced.lanes = end..end + grid.len();
            end += grid.len();
        }
        let batch = (batched && !grids.is_empty()).then(|| Grid::batched(&grids));
        let Some(mut grid) = batch.or_else(|| grids.into_iter().next()) else { return };
        let before = job.traits.displaces.then(|| grid.p.clone());
        if job.traits.displaces {
            self.shader.displace(thread, &job.object, &mut grid);
            diced.retain_mut(|diced| diced.keep(job, &grid, diced.lanes.start));
            if diced.is_empty() {
                return;
            }
        }
        let matte = job.traits.holdout == Holdout::Matte;
        let wants_colors = self.outputs.needs_shading || self.options.dump.is_some();
        let must_shade = !matte && (wants_colors || !job.traits.opaque_in_depth);
        let kept = self.kept.filter(|_| !job.traits.saves);
        let inputs = kept.filter(|_| must_shade).map(|_| grid.clone());
        let mut memo = kept.map(|_| Memo::default());
        let variables = must_shade.then(|| self.run_surface(&job.object, &mut grid, thread, memo.as_mut()));
        if must_shade {
            add(&self.counters.grids_shaded, diced.len());
            add(&self.counters.points_shaded, diced.iter().map(|diced| diced.lanes.len()).sum());
        } else {
            add(&self.counters.grids_unshaded, diced.len());
        }
        let shaded = Shaded { grid: &grid, before: before.as_ref(), variables };
        let mut members = Vec::with_capacity(diced.len());
        let mut of_later = Vec::new();
        for diced in diced {
            let (index, leaf, lanes) = (diced.index, (job.number, diced.slot.path), diced.lanes.clone());
            let per_side = diced.per_side();
            let later = if must_shade { self.later_shades(job, &diced, thread) } else { Later::default() };
            of_later.extend(later.kept);
            let grid = Arc::new(self.finished(job, diced, &shaded, later.shades));
            if kept.is_some() {
                members.push((
                    index,
                    Member { leaf, grid: grid.clone(), lanes, per_side, changed: self.shader.frame() },
                ));
            }
            out[index] = Some(MadeGrid { grid, kept: None });
        }
        if let (Some(kept), Some(memo)) = (kept, memo)
            && !self.is_stopped()
        {
            let (indices, members): (Vec<usize>, Vec<Member>) = members.into_iter().unzip();
            let mut state = BatchState::new(self.shader.frame(), inputs, memo, members);
            state.later = of_later;
            let batch = Batch {
                number: job.number,
                primitive: job.primitive.clone(),
                object: job.object.clone(),
                state: Mutex::new(state),
            };
            let Some(number) = kept.add(batch) else { return };
            for (member, index) in (0..).zip(indices) {
                if let Some(made) = &mut out[index] {
                    made.kept = Some(GridId::new(number, member));
                }
            }
        }
    }

    /// Runs the surface shaders on a grid. Returns the requested variables. The answers that the shaders get are kept
    /// in `memo`.
    pub(super) fn run_surface(
        &self,
        object: &S::Object,
        grid: &mut Grid,
        thread: &mut S::Thread<'_>,
        memo: Option<&mut Memo>,
    ) -> Vec<Variable> {
        let wanted = &self.outputs.variables;
        let found = match memo {
            Some(memo) => self.shader.shade_keeping(thread, object, grid, wanted, memo),
            None => self.shader.shade(thread, object, grid, wanted),
        };
        let mut found = found.into_iter();
        let n = grid.len();
        let one = |ty: usize| (found.next().flatten().filter(|v| v.len() == ty * n), ty);
        wanted.iter().map(|(_, ty)| ty.components()).map(one).collect()
    }

    /// Shades a leaf at the later times of its primitive, with the variables and the positions of these times. Its
    /// shaders do not print and save again.
    fn later_shades(&self, job: &Job<S::Object>, diced: &Diced<'_>, thread: &mut S::Thread<'_>) -> Later {
        let (piece, rates) = (&*diced.leaf.piece, &*diced.leaf.rates);
        self.shader.mute(thread, true);
        let mut later = Later::default();
        for &time in &job.later {
            let Some((_, mut grid, _)) = self.grid(job, &diced.slot.seen, (piece, rates), time) else {
                break;
            };
            if job.traits.displaces {
                self.shader.displace(thread, &job.object, &mut grid);
            }
            let mut memo = self.kept.map(|_| Memo::default());
            let inputs = self.kept.map(|_| grid.clone());
            let variables = self.run_surface(&job.object, &mut grid, thread, memo.as_mut());
            let lanes = 0..grid.len();
            let shade = self.shade_of(&job.primitive, (&grid, Some(&variables)), &lanes);
            later.shades.push(Shade { time, ..shade });
            later.kept.extend(inputs.zip(memo).map(|(grid, memo)| (time, grid, memo)));
        }
        self.shader.mute(thread, false);
        later
    }

    /// Returns the colours, opacities and variables of some points of a shaded grid.
    pub(super) fn shade_of(
        &self,
        primitive: &Primitive,
        (grid, variables): (&Grid, Option<&[Variable]>),
        lanes: &Range<usize>,
    ) -> Shade {
        let mut shade = Shade::default();
        let Some(found) = variables else { return shade };
        let n = grid.len();
        shade.color = self.colors(&grid.c, lanes, primitive, "colour");
        shade.opacity = self.colors(&grid.opacity, lanes, primitive, "opacity");
        // Opacities outside of [0, 1] have no meaning.
        shade.opacity.iter_mut().for_each(|o| *o = o.clamp(Color::ZERO, Color::ONE));
        let variables = &mut shade.variables;
        for (values, components) in found {
            match values {
                Some(values) => {
                    values.chunks_exact(n).for_each(|c| variables.extend_from_slice(&c[lanes.clone()]));
                    let own = variables.len() - components * lanes.len();
                    if !finite::all_usable(&variables[own..]) {
                        self.report_unusable("variable", primitive);
                        let unusable = |v: &&mut f32| !finite::all_usable(&[**v]);
                        variables[own..].iter_mut().filter(unusable).for_each(|v| *v = 0.0);
                    }
                }
                // A variable that the shader does not have is 0 (reference 7.3.6).
                None => variables.resize(variables.len() + components * lanes.len(), 0.0),
            }
        }
        shade
    }

    /// Dices leaves. Leaves that are not visible are left out.
    fn dice<'l>(&self, job: &Job<S::Object>, leaves: &[(&'l LeafSlot, &'l Leaf)]) -> Vec<(Diced<'l>, Grid)> {
        let mut all = Vec::with_capacity(leaves.len());
        for (index, &(slot, leaf)) in leaves.iter().enumerate() {
            let Some((dice, grid, precise)) =
                self.grid(job, &slot.seen, (&*leaf.piece, &leaf.rates), job.time)
            else {
                continue;
            };
            let key_times = leaf.piece.key_times();
            let mut one =
                Diced { index, slot, leaf, dice, key_times, lanes: 0..grid.len(), kept: None, precise };
            // Displaced points are tested after the displacement.
            if job.traits.displaces || one.keep(job, &grid, 0) {
                all.push((one, grid));
            }
        }
        all
    }

    /// Returns the grid of a piece at a time before displacement, with its bounds `seen` by each eye. Returns `None`
    /// when the piece has no area.
    pub(super) fn grid(
        &self,
        job: &Job<S::Object>,
        seen: &[Sighting],
        (piece, rates): (&dyn Surface, &Rates),
        time: f32,
    ) -> Option<(Dice, Grid, Option<Precise>)> {
        let (primitive, placement) = (&*job.primitive, &job.placement);
        let dicing_camera = self.options.dicing_camera;
        let view = GridView {
            viewpoint: match dicing_camera.projection {
                Projection::Perspective { .. } => Viewpoint::From(dicing_camera.position_world()),
                Projection::Orthographic => Viewpoint::Along(dicing_camera.direction_world()),
            },
            time,
            dtime: self.options.camera.shutter[1] - self.options.camera.shutter[0],
            ray: RayKind::default(),
        };
        let key_times = piece.key_times();
        let dice = rates.dice(piece, &Viewer::new(dicing_camera, placement, key_times));
        if dice.nu < 2 || dice.nv < 2 || dice.p.is_empty() {
            return None;
        }
        let mut grid = make_grid(&dice, key_times, primitive, placement, &view);
        let precise = self.precise(job, seen, piece, rates);
        if let Some(precise) = &precise {
            precise.place(&mut grid, job, &view, dicing_camera);
        }
        Some((dice, grid, precise))
    }

    /// Prepares a shaded leaf for the hider.
    fn finished(
        &self,
        job: &Job<S::Object>,
        diced: Diced<'_>,
        shaded: &Shaded<'_>,
        later: Vec<Shade>,
    ) -> ShadedGrid {
        let primitive = &job.primitive;
        // A preshaded grid may carry the properties that the hider needs.
        let given = match diced.leaf.piece.lattice() {
            Some(_) => GridTraits::new(&primitive.keys[0].params, diced.leaf),
            None if diced.leaf.piece.is_curve() => GridTraits::of_curve(diced.leaf),
            None => GridTraits::NOTHING,
        };
        let rim_px = given.rim_px.unwrap_or(RIM_PX);
        let views = self.views(job, &diced, shaded, rim_px);
        let (nu, nv, per_side) = (diced.dice.nu, diced.dice.nv, diced.per_side());
        let variables = shaded.variables.as_deref();
        let (shades, opaque) =
            self.shades(primitive, (shaded.grid, variables), (&diced.lanes, nu, per_side), later);
        let grid = ShadedGrid {
            nu: (nu - 1) * per_side + 1,
            nv: (nv - 1) * per_side + 1,
            primitive: given.primitive.unwrap_or(primitive.id),
            number: job.number,
            views,
            shades,
            opaque,
            holdout: job.traits.holdout,
            kept: diced.kept.map_or_else(Vec::new, |cells| cells.kept),
            sides: given.sides,
        };
        if shaded.before.is_some() {
            self.check_displacement(&grid, job);
        }
        grid
    }

    /// Returns the colours of a grid with `nu` points along u, at its own time and at later ones, and whether it is
    /// opaque everywhere. Each micropolygon gets `per_side` cells along each side.
    pub(super) fn shades(
        &self,
        primitive: &Primitive,
        shaded: (&Grid, Option<&[Variable]>),
        (lanes, nu, per_side): (&Range<usize>, usize, usize),
        later: Vec<Shade>,
    ) -> (Vec<Shade>, bool) {
        let mut shades = vec![Shade { time: shaded.0.time, ..self.shade_of(primitive, shaded, lanes) }];
        shades.extend(later);
        let opaque = shades.iter().flat_map(|shade| &shade.opacity).all(|o| o.cmpge(Color::ONE).all());
        if per_side > 1 {
            for shade in &mut shades {
                let (color, opacity, variables) =
                    (&mut shade.color, &mut shade.opacity, &mut shade.variables);
                for colors in [color, opacity].into_iter().filter(|c| !c.is_empty()) {
                    *colors = finer(colors, nu, per_side);
                }
                *variables = variables
                    .chunks_exact(lanes.len())
                    .flat_map(|values| finer(values, nu, per_side))
                    .collect();
            }
        }
        if opaque {
            shades.iter_mut().for_each(|shade| shade.opacity = Vec::new());
        }
        (shades, opaque)
    }

    /// Returns the view of each eye of a grid.
    fn views(
        &self,
        job: &Job<S::Object>,
        diced: &Diced<'_>,
        shaded: &Shaded<'_>,
        rim_px: f32,
    ) -> Arc<[ViewedGrid]> {
        let (nu, per_side) = (diced.dice.nu, diced.per_side());
        let times = job.placement.times();
        let p_world = if diced.precise.is_some() { Vec::new() } else { diced.positions(job, shaded) };
        let view = |(eye, seen): (&Eye<'_>, &Sighting)| {
            let mut p_cam: Vec<Vec<Vec3>> = Vec::with_capacity(times.len());
            if let Some(precise) = &diced.precise {
                let offsets = diced.offsets(job, shaded);
                p_cam.extend(times.iter().map(|t| precise.p_cam(&job.placement, eye.camera, *t, &offsets)));
            }
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
            if per_side > 1 {
                p_cam.iter_mut().for_each(|p| *p = finer(p, nu, per_side));
            }
            // A grid that does not blur stays where it is when the shutter opens.
            let keys = if seen.blurs { times.len() } else { 1 };
            p_cam.truncate(keys);
            let defocus = self.pattern.defocus && seen.blurs;
            let nu = (nu - 1) * per_side + 1;
            let grid = ViewedGrid::new(eye.camera, nu, times[..keys].to_vec(), p_cam, defocus);
            ViewedGrid { rect: seen.rect, z_min: seen.z_min, rim_px, existence: job.existence, ..grid }
        };
        self.eyes.iter().zip(&diced.slot.seen).map(view).collect()
    }

    /// Returns the colours of some points of a grid. Colours that are not finite become black, with one message per
    /// object.
    fn colors(&self, values: &Lanes3, lanes: &Range<usize>, primitive: &Primitive, what: &str) -> Vec<Color> {
        let [r, g, b] = values.xyz.each_ref().map(|c| &c[lanes.clone()]);
        let colors = r.iter().zip(g).zip(b).map(|((r, g), b)| Color::new(*r, *g, *b));
        if [r, g, b].into_iter().all(finite::all_usable) {
            return colors.collect();
        }
        let mut bad = false;
        let colors = colors.map(|c| finite::mended(c).inspect(|_| bad = true).unwrap_or(c)).collect();
        if bad {
            self.report_unusable(what, primitive);
        }
        colors
    }

    fn report_unusable(&self, what: &str, primitive: &Primitive) {
        let name = primitive.attributes.name();
        self.options.reporter.once(
            &format!("not finite {what} {name}"),
            Severity::Warning,
            &primitive.at,
            format!("object \"{name}\": its shader gave {}", finite::reason(what)),
        );
    }

    /// Warns about points that a displacement moved out of its declared bound.
    fn check_displacement(&self, grid: &ShadedGrid, job: &Job<S::Object>) {
        let region = self.region;
        let outside = |view: &ViewedGrid| {
            let ([x0, y0, x1, y1], z) = view.bound(0..grid.nu * grid.nv);
            let rect = view.rect;
            // A grid that is not visible needs no message.
            !rect.is_empty()
                && ((x0 < rect.x0 as f32 && rect.x0 > region.x0)
                    || (y0 < rect.y0 as f32 && rect.y0 > region.y0)
                    || (x1 > rect.x1 as f32 && rect.x1 < region.x1)
                    || (y1 > rect.y1 as f32 && rect.y1 < region.y1)
                    || z < view.z_min)
        };
        if grid.views.iter().any(outside) {
            let attributes = &job.primitive.attributes;
            let (name, radius) = (attributes.name(), attributes.get(attr::DISPLACE_MAXRADIUS));
            self.options.reporter.once(
                &format!("displacement bound {name}"),
                Severity::Warning,
                &job.primitive.at,
                match job.traits.measures {
                    true => format!(
                        "object \"{name}\": displaced into the image from beyond its border; it is cut off there without \"displace:maxradius\""
                    ),
                    false => format!(
                        "object \"{name}\": displaced farther than \"displace:maxradius\" {radius}; it is cut off"
                    ),
                },
            );
        }
    }
}

impl Diced<'_> {
    /// Finds the micropolygons that exist. `first` is the lane of the first point in the grid. Returns true when any
    /// exists.
    fn keep<O>(&mut self, job: &Job<O>, grid: &Grid, first: usize) -> bool {
        self.kept = kept(&self.dice, job, grid, first);
        self.kept.as_ref().is_none_or(|cells| cells.kept.contains(&true))
    }

    /// Returns the number of cells along each side of a micropolygon.
    fn per_side(&self) -> usize {
        self.kept.as_ref().map_or(1, |cells| cells.per_side)
    }

    /// Returns its points at a time in object space, before displacement.
    fn object_points(&self, time: f32) -> Vec<Vec3> {
        let (a, b, alpha) = key_at(self.key_times, time);
        let (first, second) = (&self.dice.p[a], &self.dice.p[b]);
        if alpha == 0.0 {
            return first.clone();
        }
        first.iter().zip(second).map(|(p, q)| p.lerp(*q, alpha)).collect()
    }

    /// Returns the displacement of its points in object space at the time of shading; empty without a displacement.
    fn offsets<O>(&self, job: &Job<O>, shaded: &Shaded<'_>) -> Vec<Vec3> {
        let Some(before) = shaded.before else { return Vec::new() };
        let back = job.placement.to_world.at(shaded.grid.time).inverse();
        let moved = |lane: usize| shaded.grid.p.get(lane) - before.get(lane);
        self.lanes.clone().map(|lane| back.vector(moved(lane))).collect()
    }

    /// Returns the world space positions of its points at all times of the placement.
    ///
    /// The displacement is computed once, when the shutter opens, and moves with the surface.
    fn positions<O>(&self, job: &Job<O>, shaded: &Shaded<'_>) -> Vec<Vec<Vec3>> {
        let (placement, grid) = (&job.placement, shaded.grid);
        let offsets = self.offsets(job, shaded);
        let at = |time: f32| {
            if time == grid.time {
                // These points were shaded.
                return self.lanes.clone().map(|lane| grid.p.get(lane)).collect();
            }
            let to_world = placement.to_world.at(time);
            let points = self.object_points(time).into_iter().enumerate();
            let offset = |i: usize| offsets.get(i).copied().unwrap_or(Vec3::ZERO);
            points.map(|(i, p)| to_world.point(p + offset(i))).collect()
        };
        placement.times().iter().map(|time| at(*time)).collect()
    }
}
