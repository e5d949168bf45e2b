//! Runs the shaders of objects on grids.

use crate::context::ShadingContext;
use crate::memo::{Dependencies, Dependency, Memo};
use crate::object::{LinkedShaders, ObjectState};
use crate::services::Run;
use crate::thread::ShaderThread;
use granita_base::{Color, Vec3};
use granita_gsl::ir::{Global, ValueType};
use granita_rays::{GridShader, GridShaders, RayFrame};
use granita_scene::{Holdout, Primitive};
use granita_shade::{Executor, Grid, Group, Lanes3, Primvar, PrimvarData, Rect, Services};
use std::sync::Arc;

/// The bytes of stack that one shader may use until the next one within it begins.
const STACK_FOR_ONE: usize = 1 << 20;
/// The bytes of stack that are added when less than [`STACK_FOR_ONE`] is left. Only touched pages use memory.
const MORE_STACK: usize = 8 << 20;

/// A function that runs a group: [`Executor::run`], [`Executor::run_asked`] or [`Executor::run_opacity`].
type RunOf =
    fn(&mut Executor, &Group, &mut Grid, &mut dyn Services, &[(&str, ValueType)]) -> Vec<Option<Vec<f32>>>;

impl ShaderThread<'_> {
    /// Runs the displacement shaders, if any. They move `p` and `n`; `ng`, `dpdu`, `dpdv` and `i` follow.
    pub fn displace(&mut self, object: &ObjectState, grid: &mut Grid) {
        let Some(shaders) = &object.displacement else { return };
        let moves = shaders.group.writes(Global::P);
        let before = moves.then(|| grid.p.clone());
        self.run(object, shaders, grid, &[]);
        if let Some(before) = before {
            follow_displacement(grid, &before);
        }
    }

    /// Runs the displacement shaders as [`ShaderThread::displace`] does, but points stay in place. Only `n`
    /// changes.
    pub(crate) fn bump(&mut self, object: &ObjectState, grid: &mut Grid) {
        let Some(shaders) = &object.displacement else { return };
        let p = grid.p.clone();
        self.run(object, shaders, grid, &[]);
        grid.p = p;
    }

    /// Runs the surface shaders, then the volume shaders, which set `c` and `opacity`. Returns the requested
    /// variables, component by component; `None` for those that no shader has.
    ///
    /// A holdout matte becomes black and transparent without running a shader.
    pub fn shade(
        &mut self,
        object: &ObjectState,
        grid: &mut Grid,
        wanted: &[(Arc<str>, ValueType)],
    ) -> Vec<Option<Vec<f32>>> {
        // Of what shadow rays hit, only the opacity counts. A volume shader may make it of the colour.
        let only_opacity = grid.ray.shadow && wanted.is_empty() && object.volume.is_none();
        let how = if only_opacity { Executor::run_opacity } else { Executor::run };
        self.shade_as(object, grid, wanted, how)
    }

    /// Does the same as [`ShaderThread::shade`] for a grid that a camera sees. The answers of its shaders' requests are
    /// taken from `memo` where it has them, and kept there.
    pub fn shade_keeping(
        &mut self,
        object: &ObjectState,
        grid: &mut Grid,
        wanted: &[(Arc<str>, ValueType)],
        memo: &mut Memo,
    ) -> Vec<Option<Vec<f32>>> {
        memo.begin();
        self.memo = Some(std::mem::take(memo));
        self.notes = Some(Dependencies::from_iter([Dependency::Object(object.number)]));
        let found = self.shade(object, grid, wanted);
        let mut depends = self.notes.take().unwrap_or_default();
        depends.shrink();
        *memo = self.memo.take().unwrap_or_default();
        memo.end(depends);
        found
    }

    /// Does the same as [`ShaderThread::shade`] for a ray whose shader requests variables. Messages have precedence
    /// over parameters of any kind, and those over globals.
    pub(crate) fn shade_asked(
        &mut self,
        object: &ObjectState,
        grid: &mut Grid,
        wanted: &[(Arc<str>, ValueType)],
    ) -> Vec<Option<Vec<f32>>> {
        if wanted.is_empty() {
            return self.shade(object, grid, wanted);
        }
        let mut found = self.shade_as(object, grid, wanted, Executor::run_asked);
        for (have, (name, ty)) in found.iter_mut().zip(wanted) {
            let sent = grid.messages.iter().rev().map(|m| &m.value).find(|v| v.name == *name);
            let of_type = |v: &&Primvar| v.ty.array.is_none() && Some(v.ty.base) == ty.base_type();
            if let Some(Primvar { data: PrimvarData::Floats { values, varying }, .. }) = sent.filter(of_type)
            {
                let n = grid.len();
                *have = Some(match varying {
                    true => values.clone(),
                    false => values.iter().flat_map(|v| std::iter::repeat_n(*v, n)).collect(),
                });
            }
        }
        found
    }

    fn shade_as(
        &mut self,
        object: &ObjectState,
        grid: &mut Grid,
        wanted: &[(Arc<str>, ValueType)],
        how: RunOf,
    ) -> Vec<Option<Vec<f32>>> {
        if object.holdout == Holdout::Matte {
            grid.c = Lanes3::splat(Color::ZERO, grid.len());
            grid.opacity = Lanes3::splat(Color::ZERO, grid.len());
            return vec![None; wanted.len()];
        }
        let names: Vec<(&str, ValueType)> = wanted.iter().map(|(name, ty)| (&**name, *ty)).collect();
        let given: Vec<_> = names.iter().map(|(name, ty)| of_primitive(grid, name, *ty)).collect();
        let mut found = self.run_as(object, &object.surface, grid, &names, how);
        if object.preshaded {
            for (have, (name, ty)) in found.iter_mut().zip(&names) {
                let own = grid.primvars.iter().find(|v| &*v.name == *name);
                if let Some(PrimvarData::Floats { values, varying: true }) = own.map(|v| &v.data)
                    && values.len() == ty.components() * grid.len()
                {
                    *have = Some(values.clone());
                }
            }
        }
        if let Some(volume) = object.volume.as_ref().filter(|_| !self.shows_albedo) {
            let more = self.run_as(object, volume, grid, &names, how);
            for (have, new) in found.iter_mut().zip(more) {
                // The volume shader runs last, so its values of C and opacity are the final ones.
                if have.is_none() || new.is_some() {
                    *have = new;
                }
            }
        }
        for (have, given) in found.iter_mut().zip(given) {
            *have = given.or_else(|| have.take());
        }
        found
    }

    fn run(
        &mut self,
        object: &ObjectState,
        shaders: &LinkedShaders,
        grid: &mut Grid,
        wanted: &[(&str, ValueType)],
    ) -> Vec<Option<Vec<f32>>> {
        self.run_as(object, shaders, grid, wanted, Executor::run)
    }

    fn run_as(
        &mut self,
        object: &ObjectState,
        shaders: &LinkedShaders,
        grid: &mut Grid,
        wanted: &[(&str, ValueType)],
        how: RunOf,
    ) -> Vec<Option<Vec<f32>>> {
        let mut executor = self.take_executor(shaders.usage);
        self.nested += 1;
        let thread = &mut *self;
        let found = stacker::maybe_grow(STACK_FOR_ONE, MORE_STACK, || {
            let mut services = Run::for_object(thread, object, shaders, grid);
            how(&mut executor, &shaders.group, grid, &mut services, wanted)
        });
        self.nested -= 1;
        self.put_executor(executor);
        found
    }
}

impl<'f> GridShader<'f, ObjectState> for ShaderThread<'f> {
    fn ray_frame(&self) -> RayFrame<'f> {
        self.frame().ray_frame()
    }

    fn displace_for_rays(&mut self, object: &ObjectState, grid: &mut Grid) {
        let was = std::mem::replace(&mut self.builds_rays, true);
        self.displace(object, grid);
        self.builds_rays = was;
    }
}

impl GridShaders<ObjectState> for ShadingContext {
    fn ray_frame(&self) -> RayFrame<'_> {
        ShadingContext::ray_frame(self)
    }

    fn thread(&self) -> Box<dyn GridShader<'_, ObjectState> + '_> {
        Box::new(ShaderThread::new(self))
    }

    fn object(&self, primitive: &Primitive) -> Arc<ObjectState> {
        ShadingContext::object(self, primitive)
    }
}

/// Returns the value for an output of `primitive:NAME`: a variable of the primitive before shading, component by
/// component. "C" and "opacity" are those of the object where the primitive has none, and "s" and "t" are u and v.
/// Returns `None` for other names.
fn of_primitive(grid: &Grid, name: &str, ty: ValueType) -> Option<Vec<f32>> {
    let name = name.strip_prefix("primitive:")?;
    let n = grid.len();
    let own = grid.primvars.iter().find(|v| &*v.name == name && v.ty.width() == ty.components());
    match own.map(|v| &v.data) {
        Some(PrimvarData::Floats { values, varying: true }) => return Some(values.clone()),
        Some(PrimvarData::Floats { values, varying: false }) => {
            return Some(values.iter().flat_map(|v| std::iter::repeat_n(*v, n)).collect());
        }
        _ => {}
    }
    match (name, ty) {
        ("C", ValueType::Color) => Some(grid.c.xyz.concat()),
        ("opacity", ValueType::Color) => Some(grid.opacity.xyz.concat()),
        ("s", ValueType::Float) => Some(grid.u.clone()),
        ("t", ValueType::Float) => Some(grid.v.clone()),
        _ => None,
    }
}

/// Updates the other variables of a grid after a displacement shader moved its points from `before`.
///
/// The change of the displacement across the grid is added to the tangents. The geometric normal is their cross
/// product, and the view direction moves with the points. Where tangents vanish, the old normal stays.
fn follow_displacement(grid: &mut Grid, before: &Lanes3) {
    let rects: Vec<Rect> = grid.topology.rects().collect();
    if rects.is_empty() {
        return;
    }
    let offset = |g: &Grid, i: usize| g.p.get(i) - before.get(i);
    let sign = if grid.flip_normals { -1.0 } else { 1.0 };
    for Rect { first, nu, nv } in rects {
        // Relative to the normals before, so that the size of the surface does not matter.
        let lengths = (first..first + nu * nv).map(|i| grid.ng.get(i).length_squared());
        let least = 1e-30 * lengths.filter(|length| length.is_finite()).fold(0.0, f32::max);
        for j in 0..nv {
            for i in 0..nu {
                let at = |i: usize, j: usize| first + j * nu + i;
                let slope = |g: &Grid, a: usize, b: usize, parameter: &[f32]| {
                    let step = parameter[b] - parameter[a];
                    if step == 0.0 { Vec3::ZERO } else { (offset(g, b) - offset(g, a)) / step }
                };
                let (i0, i1) = (i.saturating_sub(1), (i + 1).min(nu - 1));
                let (j0, j1) = (j.saturating_sub(1), (j + 1).min(nv - 1));
                let here = at(i, j);
                let du = grid.dpdu.get(here) + slope(grid, at(i0, j), at(i1, j), &grid.u);
                let dv = grid.dpdv.get(here) + slope(grid, at(i, j0), at(i, j1), &grid.v);
                let ng = du.cross(dv) * sign;
                grid.dpdu.set(here, du);
                grid.dpdv.set(here, dv);
                if ng.is_finite() && ng.length_squared() > least {
                    grid.ng.set(here, ng);
                }
            }
        }
    }
    if grid.ray.level == 0 {
        for i in 0..grid.len() {
            grid.i.set(i, grid.i.get(i) + offset(grid, i));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_shade::Topology;

    #[test]
    fn shading_does_not_change_primitive_variables() {
        let mut grid = Grid::new(Topology::Rect { nu: 2, nv: 1 });
        grid.u = vec![0.25, 0.75];
        grid.c = Lanes3::splat(Vec3::new(1.0, 0.5, 0.25), 2);
        let ty = |base| granita_base::ParamType::of(base);
        let weights = PrimvarData::Floats { values: vec![7.0, 8.0], varying: true };
        grid.primvars.push(Primvar {
            name: "w".into(),
            ty: ty(granita_base::BaseType::Float),
            data: weights,
        });
        let of = |name: &str, ty| of_primitive(&grid, name, ty);
        assert_eq!(of("primitive:s", ValueType::Float), Some(vec![0.25, 0.75]));
        assert_eq!(of("primitive:C", ValueType::Color), Some(vec![1.0, 1.0, 0.5, 0.5, 0.25, 0.25]));
        assert_eq!(of("primitive:w", ValueType::Float), Some(vec![7.0, 8.0]));
        assert_eq!(of("primitive:w", ValueType::Color), None);
        assert_eq!((of("s", ValueType::Float), of("primitive:x", ValueType::Float)), (None, None));
    }

    #[test]
    fn normals_follow_a_tilted_displacement() {
        // The square z = 0 becomes the plane z = u.
        let mut grid = Grid::new(Topology::Rect { nu: 3, nv: 3 });
        for at in 0..9 {
            let (u, v) = ((at % 3) as f32 * 0.5, (at / 3) as f32 * 0.5);
            (grid.u[at], grid.v[at]) = (u, v);
            grid.p.set(at, Vec3::new(u, v, 0.0));
        }
        grid.dpdu = Lanes3::splat(Vec3::X, 9);
        grid.dpdv = Lanes3::splat(Vec3::Y, 9);
        grid.ng = Lanes3::splat(Vec3::Z, 9);
        let before = grid.p.clone();
        for at in 0..9 {
            grid.p.xyz[2][at] = grid.u[at];
        }
        follow_displacement(&mut grid, &before);
        for at in 0..9 {
            assert!((grid.ng.get(at) - Vec3::new(-1.0, 0.0, 1.0)).length() < 1e-6);
            assert!((grid.dpdu.get(at) - Vec3::new(1.0, 0.0, 1.0)).length() < 1e-6);
        }
        assert_eq!(grid.i.get(2), Vec3::new(0.0, 0.0, 1.0));
    }
}
