//! Shaded grids as a camera sees them.

use granita_base::{Bound, Color, DVec3, Vec2, Vec3};
use granita_dicing::{CameraView, Lens, PixelRect, Projection};
use granita_scene::Holdout;
use std::sync::Arc;

/// An empty raster box.
pub const NOWHERE: [f32; 4] = [f32::INFINITY, f32::INFINITY, f32::NEG_INFINITY, f32::NEG_INFINITY];

/// Projects camera space boxes to the raster.
#[derive(Clone, Copy, Debug)]
pub struct Projector {
    scale: Vec2,
    center: Vec2,
    perspective: bool,
    near: f32,
    far: f32,
    lens: Option<Lens>,
}

impl Projector {
    /// Returns the projector of a camera. `defocus` is true when its lens has an effect.
    pub fn new(camera: &CameraView, defocus: bool) -> Self {
        let [near, far] = camera.clip();
        Self {
            scale: camera.raster_scale(1.0),
            center: camera.raster_center(),
            perspective: matches!(camera.projection, Projection::Perspective { .. }),
            near,
            far,
            lens: camera.lens.filter(|_| defocus),
        }
    }

    /// True when the camera space points all lie beyond one side of the view of `within` (raster pixels, grown by
    /// `room_px`), seen from any point of the lens, by more than `pad` camera space units. Their convex hull then
    /// lies beyond that side too.
    pub fn is_beyond(
        &self,
        points: impl Iterator<Item = DVec3> + Clone,
        pad: f64,
        within: &PixelRect,
        room_px: f64,
    ) -> bool {
        let (near, far) = (f64::from(self.near), f64::from(self.far));
        if points.clone().all(|p| p.z + pad < near) || points.clone().all(|p| p.z - pad > far) {
            return true;
        }
        let lens = self.lens.map_or([0.0; 2], |lens| [lens.radius, -lens.radius]).map(f64::from);
        let focus = self.lens.map_or(1.0, |lens| f64::from(lens.focal_distance));
        let edges = [
            (0, -1.0, f64::from(within.x0) - room_px),
            (0, 1.0, f64::from(within.x1) + room_px),
            (1, -1.0, f64::from(within.y0) - room_px),
            (1, 1.0, f64::from(within.y1) + room_px),
        ];
        edges.into_iter().any(|(axis, sign, edge)| {
            let (scale, from_center) = (f64::from(self.scale[axis]), edge - f64::from(self.center[axis]));
            // In a perspective the sides are planes through the lens point. They are linear in the lens point too.
            let slope = if self.perspective { from_center } else { 0.0 };
            let constant = if self.perspective { 0.0 } else { from_center };
            let pad = pad * (scale.abs() + slope.abs());
            points.clone().all(|p| {
                lens.iter().all(|l| {
                    let x = p[axis] - l + l * p.z / focus;
                    sign * (x * scale - slope * p.z - constant) > pad
                })
            })
        })
    }

    /// Returns the raster box of the part of a camera space box between the clipping planes, seen from the whole
    /// lens.
    pub fn raster_box(&self, hull: &Bound) -> [f32; 4] {
        let (z0, z1) = (hull.min.z.max(self.near), hull.max.z.min(self.far));
        if hull.is_empty() || z0 > z1 {
            return NOWHERE;
        }
        let mut bound = NOWHERE;
        for z in [z0, z1] {
            let scale = if self.perspective { self.scale / z } else { self.scale };
            let blur = self.lens.map_or(Vec2::ZERO, |lens| {
                let at_focus = (self.scale / lens.focal_distance).abs();
                at_focus * (lens.radius * (1.0 - lens.focal_distance / z).abs())
            });
            for x in [hull.min.x, hull.max.x].map(|x| self.center.x + x * scale.x) {
                (bound[0], bound[2]) = (bound[0].min(x - blur.x), bound[2].max(x + blur.x));
            }
            for y in [hull.min.y, hull.max.y].map(|y| self.center.y + y * scale.y) {
                (bound[1], bound[3]) = (bound[1].min(y - blur.y), bound[3].max(y + blur.y));
            }
        }
        bound
    }
}

/// The points of a grid as seen by a camera.
#[derive(Clone, Debug)]
pub struct ViewedGrid {
    /// The times of the keys, increasing; one for a grid that does not move.
    pub times: Vec<f32>,
    /// The camera space positions at each key.
    pub p_cam: Vec<Vec<Vec3>>,
    /// Raster x and y, and 1/z (perspective) or z (orthographic). Empty unless fast sampling is possible, which
    /// requires no motion, no lens, and nothing at or before the near plane.
    pub raster: Vec<Vec3>,
    /// The number of pixels per camera space unit at z = 1.
    pub scale: Vec2,
    /// The raster position of the z axis of camera space.
    pub center: Vec2,
    /// True for a perspective projection, false for an orthographic one.
    pub perspective: bool,
    /// The near clipping plane, in camera space units.
    pub near: f32,
    /// The far clipping plane, in camera space units.
    pub far: f32,
    /// The depth in focus; 0 without a lens.
    pub focus: f32,
    /// The radius of the lens, in camera space units; 0 without a lens.
    pub lens_radius: f32,
    /// The pixels that the bound of the surface allows. Parts that displacement moves beyond it are cut off, in every
    /// bucket.
    pub rect: PixelRect,
    /// The least camera space depth that the bound allows. Nearer parts are cut off.
    pub z_min: f32,
    /// The raster boxes (x0, y0, x1, y1) of the micropolygons, u fastest; empty where `raster` is empty.
    pub boxes: Vec<[f32; 4]>,
    /// The least camera space depths of the micropolygons of `boxes` at any time.
    pub depths: Vec<f32>,
    /// The raster boxes of the rows of micropolygons along u; empty where `raster` is empty.
    pub rows: Vec<[f32; 4]>,
    /// The raster box of all micropolygons.
    pub extent: [f32; 4],
    /// The distance in raster pixels beside the grid within which a sample searches for another grid on its other
    /// side.
    pub rim_px: f32,
    /// The times between which the grid exists; `None` for the whole shutter.
    pub existence: Option<[f32; 2]>,
}

impl ViewedGrid {
    /// Returns a view of a lattice of camera space positions, `nu` points along u, at each of `times`. Only parts
    /// before the near plane are cut off, and the boundary edge is not widened. `defocus` is true when the lens has
    /// an effect.
    pub fn new(
        camera: &CameraView,
        nu: usize,
        times: Vec<f32>,
        p_cam: Vec<Vec<Vec3>>,
        defocus: bool,
    ) -> Self {
        let perspective = matches!(camera.projection, Projection::Perspective { .. });
        let lens = camera.lens.filter(|_| defocus);
        let [near, far] = camera.clip();
        let mut grid = Self {
            times,
            p_cam,
            raster: Vec::new(),
            scale: camera.raster_scale(1.0),
            center: camera.raster_center(),
            perspective,
            near,
            far,
            focus: lens.map_or(0.0, |l| l.focal_distance),
            lens_radius: lens.map_or(0.0, |l| l.radius),
            rect: PixelRect::EVERYWHERE,
            z_min: f32::NEG_INFINITY,
            boxes: Vec::new(),
            depths: Vec::new(),
            rows: Vec::new(),
            extent: NOWHERE,
            rim_px: 0.0,
            existence: None,
        };
        let simple = grid.times.len() == 1 && lens.is_none();
        if simple && (!perspective || grid.p_cam[0].iter().all(|p| p.z >= near)) {
            let project = |p: &Vec3| {
                let q = grid.project(*p);
                Vec3::new(q.x, q.y, if perspective { 1.0 / p.z } else { p.z })
            };
            grid.raster = grid.p_cam[0].iter().map(project).collect();
            let of_points = |row: &[Vec3]| row.iter().fold(NOWHERE, |b, q| union(b, [q.x, q.y, q.x, q.y]));
            let lines: Vec<[f32; 4]> = grid.raster.chunks_exact(nu.max(1)).map(of_points).collect();
            grid.rows = lines.windows(2).map(|pair| union(pair[0], pair[1])).collect();
            grid.extent = grid.rows.iter().copied().fold(NOWHERE, union);
        } else if let Some(nv) = grid.p_cam[0].len().checked_div(nu) {
            (grid.boxes, grid.depths) = grid.find_boxes(nu, nv);
            grid.extent = grid.boxes.iter().copied().fold(NOWHERE, union);
        }
        grid
    }

    /// Returns the raster boxes and the least depths of the micropolygons; see [`ViewedGrid::bound`].
    fn find_boxes(&self, nu: usize, nv: usize) -> (Vec<[f32; 4]>, Vec<f32>) {
        let projector = self.projector();
        let all_finite = self.p_cam.iter().flatten().all(|p| p.is_finite());
        let count = nu.saturating_sub(1) * nv.saturating_sub(1);
        let (mut boxes, mut depths) = (Vec::with_capacity(count), Vec::with_capacity(count));
        for j in 1..nv {
            for i in 1..nu {
                let at = (j - 1) * nu + i - 1;
                let corners = [at, at + 1, at + nu, at + nu + 1];
                let (bound, depth) = match all_finite {
                    true => {
                        let hull = self.p_cam.iter().fold(Bound::EMPTY, |hull, p| {
                            corners.iter().fold(hull, |hull, corner| hull.with(p[*corner]))
                        });
                        (projector.raster_box(&hull), hull.min.z)
                    }
                    false => self.bound(corners.into_iter()),
                };
                boxes.push(bound);
                depths.push(depth);
            }
        }
        (boxes, depths)
    }

    /// Returns a point between two keys; see [`granita_dicing::key_at`].
    pub fn between(&self, key: usize, next: usize, alpha: f32, i: usize) -> Vec3 {
        let a = self.p_cam[key][i];
        if alpha == 0.0 { a } else { a.lerp(self.p_cam[next][i], alpha) }
    }

    /// Returns the raster position of a point. In a perspective it is defined for positive depths only.
    pub fn project(&self, p: Vec3) -> Vec2 {
        let scale = if self.perspective { self.scale / p.z } else { self.scale };
        self.center + Vec2::new(p.x, p.y) * scale
    }

    /// Returns the raster box (x0, y0, x1, y1) of some points over the whole shutter and lens, and their least depth.
    /// The box is empty when all of the points lie before the near plane, or when one has no position.
    pub fn bound(&self, indices: impl Iterator<Item = usize> + Clone) -> ([f32; 4], f32) {
        if self.raster.is_empty() {
            let points = self.p_cam.iter().flat_map(|key| indices.clone().map(|i| key[i]));
            let mut hull = Bound::EMPTY;
            for p in points {
                if !p.is_finite() {
                    return (NOWHERE, f32::INFINITY);
                }
                hull = hull.with(p);
            }
            return (self.projector().raster_box(&hull), hull.min.z);
        }
        let mut bound = NOWHERE;
        let mut z_min = f32::INFINITY;
        for i in indices {
            let q = self.raster[i];
            z_min = z_min.min(self.p_cam[0][i].z);
            bound = [bound[0].min(q.x), bound[1].min(q.y), bound[2].max(q.x), bound[3].max(q.y)];
        }
        (bound, z_min)
    }

    /// Returns the projector of its camera.
    fn projector(&self) -> Projector {
        let lens = Lens { radius: self.lens_radius, focal_distance: self.focus };
        Projector {
            scale: self.scale,
            center: self.center,
            perspective: self.perspective,
            near: self.near,
            far: self.far,
            lens: (self.lens_radius > 0.0).then_some(lens),
        }
    }
}

/// Returns the box around two raster boxes. A side that is NaN is left out.
fn union(a: [f32; 4], b: [f32; 4]) -> [f32; 4] {
    [a[0].min(b[0]), a[1].min(b[1]), a[2].max(b[2]), a[3].max(b[3])]
}

/// Returns the pixels that a raster box touches, clipped to `within`. A box with NaN touches no pixel.
#[inline(always)]
pub fn pixels_of(bound: [f32; 4], within: &PixelRect) -> PixelRect {
    // Casts saturate, so that infinite boxes are clipped correctly.
    let rect = PixelRect {
        x0: bound[0].floor() as i32,
        y0: bound[1].floor() as i32,
        x1: (bound[2].floor() as i32).saturating_add(1),
        y1: (bound[3].floor() as i32).saturating_add(1),
    };
    if bound.iter().any(|b| b.is_nan()) || bound[0] > bound[2] || bound[1] > bound[3] {
        return PixelRect { x0: 0, y0: 0, x1: 0, y1: 0 };
    }
    rect.intersection(within)
}

/// The result of shading a grid at one time.
#[derive(Clone, Debug, Default)]
pub struct Shade {
    /// The time of the primitive variables.
    pub time: f32,
    /// The colour of each point; empty for black (a matte).
    pub color: Vec<Color>,
    /// The opacity of each point; empty when it is opaque everywhere.
    pub opacity: Vec<Color>,
    /// The requested variables, one after the other, component by component. Component `c` of point `i` of a variable
    /// that begins at `offset` is at `(offset + c) * nu * nv + i`.
    pub variables: Vec<f32>,
}

/// A grid after displacement and shading, prepared for sampling.
#[derive(Clone, Debug)]
pub struct ShadedGrid {
    /// The number of points along u.
    pub nu: usize,
    /// The number of points along v.
    pub nv: usize,
    /// The index of the primitive that the grid belongs to.
    pub primitive: u32,
    /// The number of the primitive in the scene.
    pub number: u32,
    /// The grid as seen by each eye of the camera. Copies of the grid with other colours share it.
    pub views: Arc<[ViewedGrid]>,
    /// The results of shading, times increasing. There are several only when primitive variables change over the
    /// shutter.
    pub shades: Vec<Shade>,
    /// True when every point hides what is behind it.
    pub opaque: bool,
    /// The effect of the grid on surfaces behind it.
    pub holdout: Holdout,
    /// For each micropolygon (u fastest): whether it exists. Empty when all exist.
    pub kept: Vec<bool>,
    /// For the sides v = 0, u = 1, v = 1 and u = 0: whether the side is a boundary edge that may be widened.
    pub sides: [bool; 4],
}

impl ShadedGrid {
    /// Returns a transparent black grid of `nu` by `nv` points, seen by one eye.
    pub fn new(nu: usize, nv: usize, view: ViewedGrid) -> Self {
        Self {
            nu,
            nv,
            primitive: 0,
            number: 0,
            views: [view].into(),
            shades: Vec::new(),
            opaque: false,
            holdout: Holdout::None,
            kept: Vec::new(),
            sides: [true; 4],
        }
    }

    /// The bytes of its arrays on the heap.
    pub fn bytes(&self) -> usize {
        let views = self.views.iter().map(|view| {
            let points = view.p_cam.iter().map(Vec::len).sum::<usize>() + view.raster.len();
            size_of::<ViewedGrid>()
                + size_of::<Vec3>() * points
                + size_of_val(&view.boxes[..])
                + size_of_val(&view.depths[..])
                + size_of_val(&view.rows[..])
        });
        let shades = self.shades.iter().map(|shade| {
            size_of_val(&shade.color[..])
                + size_of_val(&shade.opacity[..])
                + size_of_val(&shade.variables[..])
        });
        size_of::<Self>() + views.sum::<usize>() + shades.sum::<usize>() + self.kept.len()
    }

    /// Returns the weights of the corners `at`, `at + 1`, `at + nu`, `at + nu + 1` for a place in a micropolygon.
    ///
    /// Micropolygons are pairs of triangles that share the diagonal from (0, 0) to (1, 1).
    pub fn weights(u: f32, v: f32) -> [f32; 4] {
        if u >= v { [1.0 - u, u - v, 0.0, v] } else { [1.0 - v, 0.0, v - u, u] }
    }

    /// Returns the opacity at a place and a time.
    pub fn opacity_at(&self, at: u32, [u, v]: [f32; 2], time: f32) -> Color {
        let of = |shade: &Shade| Self::blend(&shade.opacity, self.nu, at as usize, u, v, Color::ONE);
        self.over_time(time, of, |a, b, alpha| a.lerp(b, alpha))
    }

    /// Returns the colour at a place and a time.
    pub fn color_at(&self, at: u32, [u, v]: [f32; 2], time: f32) -> Color {
        let of = |shade: &Shade| Self::blend(&shade.color, self.nu, at as usize, u, v, Color::ZERO);
        self.over_time(time, of, |a, b, alpha| a.lerp(b, alpha))
    }

    /// Returns the colour and the opacity at a place and a time, as [`Self::color_at`] and [`Self::opacity_at`].
    #[inline(always)]
    pub(crate) fn shade_at(&self, at: u32, [u, v]: [f32; 2], time: f32) -> (Color, Color) {
        match &self.shades[..] {
            [shade] => {
                let of = |values: &[Color], default| Self::blend(values, self.nu, at as usize, u, v, default);
                (of(&shade.color, Color::ZERO), of(&shade.opacity, Color::ONE))
            }
            _ => (self.color_at(at, [u, v], time), self.opacity_at(at, [u, v], time)),
        }
    }

    /// Returns the colour at a place of a grid that is opaque and was shaded once; `None` for other grids.
    #[inline(always)]
    pub(crate) fn only_color_at(&self, at: u32, [u, v]: [f32; 2]) -> Option<Color> {
        match &self.shades[..] {
            [shade] if self.opaque && self.holdout == Holdout::None => {
                Some(Self::blend(&shade.color, self.nu, at as usize, u, v, Color::ZERO))
            }
            _ => None,
        }
    }

    /// False when the grid certainly hides nothing that is behind it, because it was shaded once and a component of
    /// its opacity is below 1 everywhere.
    pub(crate) fn may_hide(&self) -> bool {
        // Interpolation may round up.
        const BELOW_ONE: Color = Color::splat(0.999);
        match &self.shades[..] {
            [Shade { opacity, .. }]
                if !self.opaque && self.holdout == Holdout::None && !opacity.is_empty() =>
            {
                // The order of the arguments skips NaN.
                let greatest = opacity.iter().fold(Color::NEG_INFINITY, |most, o| o.max(most));
                !greatest.cmplt(BELOW_ONE).any()
            }
            _ => true,
        }
    }

    /// True when the grid was shaded at several times.
    pub fn varies_over_time(&self) -> bool {
        self.shades.len() > 1
    }

    /// Returns a value interpolated between the two shades around a time.
    fn over_time<T>(&self, time: f32, of: impl Fn(&Shade) -> T, blend: impl Fn(T, T, f32) -> T) -> T {
        let after = match self.varies_over_time() {
            true => self.shades.partition_point(|shade| shade.time <= time),
            false => 0,
        };
        if after == 0 || after == self.shades.len() {
            return of(&self.shades[after.saturating_sub(1)]);
        }
        let (a, b) = (&self.shades[after - 1], &self.shades[after]);
        blend(of(a), of(b), (time - a.time) / (b.time - a.time))
    }

    #[inline(always)]
    fn blend(values: &[Color], nu: usize, at: usize, u: f32, v: f32, default: Color) -> Color {
        if values.is_empty() {
            return default;
        }
        let (a, b, c, d) = (values[at], values[at + 1], values[at + nu], values[at + nu + 1]);
        // A value that all corners share is returned exactly.
        if a == b && a == c && a == d {
            return a;
        }
        let w = Self::weights(u, v);
        a * w[0] + b * w[1] + c * w[2] + d * w[3]
    }

    /// Returns a component of a variable at a place and a time.
    pub fn variable_at(&self, component: usize, at: u32, place: [f32; 2], time: f32) -> f32 {
        let of = |shade: &Shade| self.variable_of(shade, component, at, place);
        self.over_time(time, of, |a, b, alpha| a * (1.0 - alpha) + b * alpha)
    }

    fn variable_of(&self, shade: &Shade, component: usize, at: u32, [u, v]: [f32; 2]) -> f32 {
        let n = self.nu * self.nv;
        let Some(values) = shade.variables.get(component * n..(component + 1) * n) else { return 0.0 };
        let at = at as usize;
        let w = Self::weights(u, v);
        let corners = [values[at], values[at + 1], values[at + self.nu], values[at + self.nu + 1]];
        if corners[1..].iter().all(|c| *c == corners[0]) {
            return corners[0];
        }
        corners[0] * w[0] + corners[1] * w[1] + corners[2] * w[2] + corners[3] * w[3]
    }
}
