//! The result of dicing.

use crate::trim::TrimMask;
use granita_base::{ParamType, Vec3};
use std::sync::Arc;

/// A diced piece: a lattice of `nu x nv` points, u fastest, in object space.
#[derive(Clone, Debug, Default)]
pub struct Dice {
    /// The number of points along u.
    pub nu: usize,
    /// The number of points along v.
    pub nv: usize,
    /// The positions for each motion key.
    pub p: Vec<Vec<Vec3>>,
    /// The user's normals "N" at the first key, interpolated and not normalized; `None` if they are not given. The
    /// "N" of a curve is included, although its ribbon is already perpendicular to it.
    pub n: Option<Vec<Vec3>>,
    /// dP/du at the first key, where u is the parameter in [`Dice::u`]. Where the surface degenerates (the pole of a
    /// sphere, a collapsed edge of a patch) it is a short vector in the limit direction, so that `dpdu x dpdv` still
    /// points along the normal.
    pub dpdu: Vec<Vec3>,
    /// dP/dv at the first key, with the same properties.
    pub dpdv: Vec<Vec3>,
    /// The surface parameter u of each point.
    pub u: Vec<f32>,
    /// The surface parameter v of each point.
    pub v: Vec<f32>,
    /// When points on the sides were moved ([`crate::Surface::dice_between`]): the places of all points along u and
    /// along v, counted in steps of the even lattice.
    pub places: Option<[Vec<f32>; 2]>,
    /// All other primitive variables, at the first key.
    pub primvars: Vec<DicePrimvar>,
    /// The index of the face of the mesh, curve or particle; 0 for others.
    pub face: u32,
    /// The parts of the micropolygons that are outside of the trim curves, if there are any.
    pub mask: Option<TrimMask>,
    /// For points and curves without "N": how the lattice turns towards the viewer. Until [`Dice::turn`] is called
    /// `p`, `dpdu` and `dpdv` face along object space z.
    pub facing: Option<Facing>,
}

/// A primitive variable at the points of a lattice.
#[derive(Clone, Debug, PartialEq)]
pub struct DicePrimvar {
    /// Its name.
    pub name: Arc<str>,
    /// Its declared type.
    pub ty: ParamType,
    /// Its values.
    pub data: DiceData,
}

/// The values of a primitive variable over a lattice.
#[derive(Clone, Debug, PartialEq)]
pub enum DiceData {
    /// Numbers, component by component (array elements included).
    Floats {
        /// Component `c` of point `i` is at `c * nu * nv + i` when varying, and at `c` otherwise.
        values: Vec<f32>,
        /// True when there is one value for each point.
        varying: bool,
    },
    /// Strings, the same for all points.
    Strings(Vec<Arc<str>>),
}

/// The direction and pixel size of a viewer at a point in object space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// The vector from the point towards the viewer, of any length.
    pub toward: Vec3,
    /// The size of a pixel at the point, in object space units.
    pub pixel: f32,
}

impl View {
    /// A view along object space z.
    pub(crate) const ALONG_Z: Self = Self { toward: Vec3::Z, pixel: 1.0 };

    /// Returns the unit vector towards the viewer; z at the viewer itself.
    pub(crate) fn direction(&self) -> Vec3 {
        self.toward.try_normalize().unwrap_or(Vec3::Z)
    }
}

/// The orientation of the lattice of a point or curve towards the viewer. Each point is
/// `centre + width / 2 * (offset[0] * side + offset[1] * up)`. For a curve, `side` is perpendicular to the curve and
/// to the view, and there is no `up`. For a particle, `side` and `up` span the plane perpendicular to the view.
#[derive(Clone, Debug)]
pub struct Facing {
    /// The centre of each point of the lattice, for each motion key.
    pub centre: Vec<Vec<Vec3>>,
    /// The derivative of the centre along the curve (dP/dv) at each point, for each motion key; empty for particles.
    pub tangent: Vec<Vec<Vec3>>,
    /// The width (diameter) at each point, for each motion key.
    pub width: Vec<Vec<f32>>,
    /// True when the widths are in pixels.
    pub raster: bool,
    /// The place in the cross section, each in [-1, 1] (slightly more for the corners of a particle diced as a
    /// square).
    pub offset: Vec<[f32; 2]>,
}

impl Dice {
    /// Turns points and curves towards the viewer, and recomputes `p`, `dpdu` and `dpdv`. `view` receives the motion
    /// key and a position at that key. Other primitives are not changed.
    pub fn turn(&mut self, view: &dyn Fn(usize, Vec3) -> View) {
        self.turn_by(&|key, _, p| view(key, p));
    }

    /// Does the same as [`Dice::turn`]. `view` also receives the index of the point in the lattice.
    pub(crate) fn turn_by(&mut self, view: &dyn Fn(usize, usize, Vec3) -> View) {
        let Some(facing) = &self.facing else { return };
        let n = facing.offset.len();
        self.p.clear();
        self.dpdu = vec![Vec3::ZERO; n];
        self.dpdv = vec![Vec3::ZERO; n];
        // The frames of the first key determine those of the others, so that the frames do not spin in between.
        let mut first: Vec<Vec3> = Vec::new();
        for (key, centres) in facing.centre.iter().enumerate() {
            let mut positions = Vec::with_capacity(n);
            // The points across a curve have the same side.
            let mut last: Option<([Vec3; 2], Vec3)> = None;
            for (i, &centre) in centres.iter().enumerate() {
                let view = view(key, i, centre);
                let width = facing.width[key][i] * if facing.raster { view.pixel } else { 1.0 };
                let [x, y] = facing.offset[i];
                let (side, up, along) = match facing.tangent.get(key) {
                    Some(tangents) => {
                        let place = [tangents[i], view.toward];
                        let (_, side) = *match &mut last {
                            Some(last) if same_bits(&last.0, &place) => last,
                            last => last.insert((place, ribbon_side(tangents[i], view.direction()))),
                        };
                        (side, Vec3::ZERO, tangents[i])
                    }
                    None => {
                        let toward = view.direction();
                        let wanted = first.get(i).copied().unwrap_or_else(|| toward.any_orthonormal_vector());
                        let side = (wanted - toward * wanted.dot(toward))
                            .try_normalize()
                            .unwrap_or_else(|| toward.any_orthonormal_vector());
                        let up = toward.cross(side);
                        (side, up, up * width)
                    }
                };
                if key == 0 {
                    first.push(side);
                    self.dpdu[i] = side * width;
                    self.dpdv[i] = along;
                }
                positions.push(placed(centre, [side, up], [x, y], width));
            }
            self.p.push(positions);
        }
    }
}

/// True when vectors are the same to the bit.
fn same_bits(a: &[Vec3; 2], b: &[Vec3; 2]) -> bool {
    let bits = |v: &[Vec3; 2]| v.map(|v| v.to_array().map(f32::to_bits));
    bits(a) == bits(b)
}

/// Returns the point at an offset in the cross section around a centre.
fn placed(centre: Vec3, [side, up]: [Vec3; 2], [x, y]: [f32; 2], width: f32) -> Vec3 {
    centre + (side * x + up * y) * (width * 0.5)
}

/// Returns the point of a ribbon at an offset from its centre; see [`Facing::offset`].
pub(crate) fn on_ribbon(centre: Vec3, side: Vec3, x: f32, width: f32) -> Vec3 {
    placed(centre, [side, Vec3::ZERO], [x, 0.0], width)
}

/// Returns the direction across a curve and perpendicular to the view. The cross product of side and tangent points
/// towards the viewer.
pub(crate) fn ribbon_side(tangent: Vec3, toward: Vec3) -> Vec3 {
    let along = tangent.try_normalize().unwrap_or_else(|| toward.any_orthonormal_vector());
    let side = along.cross(toward);
    // For a curve that is seen end on, any side is valid.
    let end_on = side.length_squared() < 1e-12;
    let side = if end_on { None } else { side.try_normalize() };
    side.unwrap_or_else(|| along.any_orthonormal_vector())
}
