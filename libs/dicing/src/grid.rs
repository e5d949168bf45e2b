//! Conversion of a diced piece into a shading grid in "common" (= world) space.

use super::Placement;
use super::motion::points_at;
use crate::finite;
use granita_base::{BaseType, ShapeDesc, Transform, Vec3, Vec4, hash};
use granita_geom::{Dice, DiceData, DicePrimvar};
use granita_scene::{AttributeSet, Primitive, attr};
use granita_shade::{Grid, Lanes3, Primvar, PrimvarData, RayKind, Topology};

/// The point or direction from which a grid is viewed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Viewpoint {
    /// A point in world space.
    From(Vec3),
    /// All points along this direction in world space, for an orthographic camera.
    Along(Vec3),
}

/// The view and the times with which a grid is shaded.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridView {
    /// The viewpoint, from which `I` is computed.
    pub viewpoint: Viewpoint,
    /// The shutter time of the shading.
    pub time: f32,
    /// The length of the shutter interval.
    pub dtime: f32,
    /// The kind of ray for which the grid is shaded.
    pub ray: RayKind,
}

/// Given normals equal geometric ones when the cosine between them differs from 1 by less than this.
const FLAT: f32 = 1e-6;

/// Makes the grid of a diced piece at `view.time`. `key_times` are the key times of the piece.
///
/// Degenerate points (poles) take the geometric normal of the nearest point that has one.
pub fn make_grid(
    dice: &Dice,
    key_times: &[f32],
    primitive: &Primitive,
    placement: &Placement,
    view: &GridView,
) -> Grid {
    let attributes = &*primitive.attributes;
    let (nu, nv) = (dice.nu, dice.nv);
    let n = nu * nv;
    let to_world = placement.to_world.at(view.time);
    let to_normal = to_world.normal_matrix();
    let p = points_at(&dice.p, key_times, view.time, &to_world);
    let vectors =
        |list: &[Vec3]| Lanes3::from_points(&list.iter().map(|v| to_world.vector(*v)).collect::<Vec<_>>());
    let mut grid = Grid {
        topology: Topology::Rect { nu, nv },
        p: Lanes3::from_points(&p),
        dpdu: vectors(&dice.dpdu[..n]),
        dpdv: vectors(&dice.dpdv[..n]),
        dpdtime: Lanes3::zeros(n),
        u: dice.u[..n].to_vec(),
        v: dice.v[..n].to_vec(),
        // The other variables are still empty.
        ..Grid::new(Topology::Scattered { n: 0 })
    };
    if let Some(places) = &dice.places {
        grid.find_uneven(places);
    }
    if let [first, .., last] = placement.times() {
        // The velocity is the mean over the whole interval, because the mean is what blurs.
        let at = |t: f32| points_at(&dice.p, key_times, t, &placement.to_world.at(t));
        let rate = 1.0 / (last - first);
        for (i, (a, b)) in at(*first).into_iter().zip(at(*last)).enumerate() {
            grid.dpdtime.set(i, (b - a) * rate);
        }
    }
    grid.ng = geometric_normals(&grid, &p, attributes.flip_normals);
    let moves = primitive.keys.len() > 1;
    let times: Vec<f32> = primitive.keys.iter().filter(|_| moves).map(|key| key.time).collect();
    let (normals, variables) = dice.variables_at(&times, view.time);
    grid.n = match &normals {
        Some(normals) => {
            let world: Vec<Vec3> = normals.iter().map(|n| to_normal.vector(*n)).collect();
            Lanes3::from_points(&world)
        }
        None => grid.ng.clone(),
    };
    grid.flip_normals = attributes.flip_normals;
    // Some files have faces that are wound against their own normals. The given normals then determine the front
    // side.
    if dice.n.is_some() && (0..n).all(|i| grid.n.get(i).dot(grid.ng.get(i)) < 0.0) {
        grid.ng = negated(&grid.ng);
        grid.flip_normals = !grid.flip_normals;
    }
    let seams = seams(&grid, primitive, dice.n.is_some());
    let flat = matches!(primitive.shape, ShapeDesc::Mesh { subdivide: false, .. });
    if flat && seams.contains(&true) {
        grid.lift = super::lift::of_face(&grid);
    }
    grid.seams = vec![seams];
    look(&mut grid, attributes, view);
    grid.time = view.time;
    grid.dtime = view.dtime;
    grid.ray = view.ray;
    grid.object = attributes.name();
    grid.primitives = vec![primitive.id];
    grid.seed = hash::words(&[
        primitive.id,
        dice.face,
        dice.u.first().map_or(0, |u| u.to_bits()),
        dice.v.first().map_or(0, |v| v.to_bits()),
        dice.u.last().map_or(0, |u| u.to_bits()),
        dice.v.last().map_or(0, |v| v.to_bits()),
    ]);
    grid.primvars = variables.iter().map(|v| to_common(v, n, &to_world, &to_normal)).collect();
    set_colors(&mut grid, attributes);
    grid
}

/// Sets the direction of view at each point, of which baking makes the normal (reference 4.4.7).
fn look(grid: &mut Grid, attributes: &AttributeSet, view: &GridView) {
    grid.i = match view.viewpoint {
        Viewpoint::From(eye) => {
            Lanes3::from_points(&(0..grid.p.len()).map(|i| grid.p.get(i) - eye).collect::<Vec<Vec3>>())
        }
        Viewpoint::Along(direction) => Lanes3::splat(direction, grid.p.len()),
    };
    if view.ray.level == 0 {
        match &*attributes.get(attr::SHADING_VIEW) {
            "outside" => grid.i = negated(&grid.ng),
            "inside" => grid.i = grid.ng.clone(),
            _ => (),
        }
    }
}

/// Sets colour and opacity: those of the attributes, or those of primitive variables.
fn set_colors(grid: &mut Grid, attributes: &AttributeSet) {
    let n = grid.len();
    let constants = [
        ("C", &mut grid.c, attributes.get(attr::COLOR)),
        ("opacity", &mut grid.opacity, finite::opacity(attributes)),
    ];
    for (name, lanes, constant) in constants {
        *lanes = Lanes3::splat(constant, n);
        if let Some(variable) = grid.primvars.iter().find(|v| &*v.name == name) {
            override_color(lanes, variable, n);
            if name == "opacity" {
                finite::clamp_opacity(lanes);
            }
        }
    }
}

/// Returns the sides on which a face of a mesh continues smoothly in the next face. These are all sides of a limit
/// surface of subdivision, and else the sides where the given normals differ from the face's own.
fn seams(grid: &Grid, primitive: &Primitive, given: bool) -> [bool; 4] {
    let (ShapeDesc::Mesh { subdivide, nverts, .. }, &Topology::Rect { nu, nv }) =
        (&primitive.shape, &grid.topology)
    else {
        return [false; 4];
    };
    if nverts.len() < 2 || *subdivide || !given {
        return [nverts.len() > 1 && *subdivide; 4];
    }
    let bent = |i: usize| {
        let (n, own) = (grid.n.get(i).normalize_or_zero(), grid.ng.get(i).normalize_or_zero());
        n.dot(own).abs() < 1.0 - FLAT
    };
    [
        (0..nv).any(|k| bent(k * nu)),
        (0..nv).any(|k| bent(k * nu + nu - 1)),
        (0..nu).any(bent),
        (0..nu).any(|k| bent((nv - 1) * nu + k)),
    ]
}

/// Returns `cross (dPdu, dPdv)`, negated when `flip`. Where it vanishes, it is computed from the neighbouring points,
/// or else taken from the nearest lane that has one.
fn geometric_normals(grid: &Grid, p: &[Vec3], flip: bool) -> Lanes3 {
    let Topology::Rect { nu, nv } = grid.topology else { return grid.ng.clone() };
    let sign = if flip { -1.0 } else { 1.0 };
    let mut normals: Vec<Vec3> = (0..nu * nv).map(|i| grid.dpdu.get(i).cross(grid.dpdv.get(i))).collect();
    // Relative to the others, so that the size of the surface does not matter.
    let lengths = normals.iter().filter(|v| v.is_finite()).map(|v| v.length_squared());
    let least = 1e-30 * lengths.filter(|length| length.is_finite()).fold(0.0, f32::max);
    let usable = |v: Vec3| v.is_finite() && v.length_squared() > least;
    let mut missing: Vec<usize> = Vec::new();
    for j in 0..nv {
        for i in 0..nu {
            let at = j * nu + i;
            if usable(normals[at]) {
                continue;
            }
            let (i0, i1) = (i.saturating_sub(1), (i + 1).min(nu - 1));
            let (j0, j1) = (j.saturating_sub(1), (j + 1).min(nv - 1));
            let du = p[j * nu + i1] - p[j * nu + i0];
            let dv = p[j1 * nu + i] - p[j0 * nu + i];
            normals[at] = du.cross(dv);
            if !usable(normals[at]) {
                missing.push(at);
            }
        }
    }
    let known = if missing.is_empty() { Vec::new() } else { normals.clone() };
    for at in missing {
        let (i, j) = ((at % nu) as isize, (at / nu) as isize);
        let distance = |k: usize| ((k % nu) as isize - i).pow(2) + ((k / nu) as isize - j).pow(2);
        let nearest = (0..known.len()).filter(|k| usable(known[*k])).min_by_key(|k| distance(*k));
        normals[at] = nearest.map_or(Vec3::ZERO, |k| known[k]);
    }
    for n in &mut normals {
        *n *= sign;
    }
    Lanes3::from_points(&normals)
}

fn negated(lanes: &Lanes3) -> Lanes3 {
    Lanes3 { xyz: lanes.xyz.each_ref().map(|c| c.iter().map(|v| -v).collect()) }
}

/// Replaces a colour by the primitive variable of that name, if the variable is a colour.
fn override_color(lanes: &mut Lanes3, variable: &Primvar, n: usize) {
    let PrimvarData::Floats { values, varying } = &variable.data else { return };
    if variable.ty.width() != 3 {
        return;
    }
    for i in 0..n {
        let at = |c: usize| if *varying { values[c * n + i] } else { values[c] };
        lanes.set(i, Vec3::new(at(0), at(1), at(2)));
    }
}

/// Returns a primitive variable in "common" space.
fn to_common(variable: &DicePrimvar, n: usize, to_world: &Transform, to_normal: &Transform) -> Primvar {
    let data = match &variable.data {
        DiceData::Strings(s) => PrimvarData::Strings(s.clone()),
        DiceData::Floats { values, varying } => {
            let mut values = values.clone();
            let (lanes, stride) = if *varying { (n, n) } else { (1, 1) };
            let width = variable.ty.base.components();
            let spatial = matches!(
                variable.ty.base,
                BaseType::Point | BaseType::Vector | BaseType::Normal | BaseType::HPoint
            );
            if spatial && *to_world != Transform::IDENTITY {
                for element in 0..variable.ty.width() / width {
                    for i in 0..lanes {
                        let at = |c: usize| (element * width + c) * stride + i;
                        let v = Vec3::new(values[at(0)], values[at(1)], values[at(2)]);
                        let moved: Vec4 = match variable.ty.base {
                            BaseType::Point => to_world.point(v).extend(0.0),
                            BaseType::Vector => to_world.vector(v).extend(0.0),
                            BaseType::Normal => to_normal.vector(v).extend(0.0),
                            _ => to_world.hpoint(v.extend(values[at(3)])),
                        };
                        for c in 0..width {
                            values[at(c)] = moved[c];
                        }
                    }
                }
            }
            PrimvarData::Floats { values, varying: *varying }
        }
    };
    Primvar { name: variable.name.clone(), ty: variable.ty, data }
}
