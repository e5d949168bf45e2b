//! What dicing gives.

use crate::trim::TrimMask;
use granita_base::{ParamType, Vec3};
use std::sync::Arc;

/// A diced piece: a lattice of `nu x nv` points, u fastest, in object space.
#[derive(Clone, Debug, Default)]
pub struct Dice {
    /// Points along u.
    pub nu: usize,
    /// Points along v.
    pub nv: usize,
    /// Positions for each motion key.
    pub p: Vec<Vec<Vec3>>,
    /// The user's normals "N" at the first key, interpolated and not normalized; none if not given. A curve's "N"
    /// is here, too: its ribbon is already perpendicular to it.
    pub n: Option<Vec<Vec3>>,
    /// dP/du at the first key, u being the parameter in [`Dice::u`]. Where the surface degenerates (the pole of a
    /// sphere, a collapsed edge of a patch) a short vector in the limit direction, so that `dpdu x dpdv` still
    /// points along the normal.
    pub dpdu: Vec<Vec3>,
    /// dP/dv at the first key, likewise.
    pub dpdv: Vec<Vec3>,
    /// Surface parameter u of each point.
    pub u: Vec<f32>,
    /// Surface parameter v of each point.
    pub v: Vec<f32>,
    /// Where points on the sides were moved ([`crate::Surface::dice_between`]): the places of all points along u and along v,
    /// counted in steps of the even lattice.
    pub places: Option<[Vec<f32>; 2]>,
    /// All other primitive variables, at the first key.
    pub primvars: Vec<DicePrimvar>,
    /// Which face of the mesh, curve or particle; 0 for others.
    pub face: u32,
    /// With trim curves: what of the micropolygons is outside of them.
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

/// Values of a primitive variable over a lattice.
#[derive(Clone, Debug, PartialEq)]
pub enum DiceData {
    /// Component by component (array elements included).
    Floats {
        /// Component `c` of point `i` at `c * nu * nv + i` when varying, at `c` otherwise.
        values: Vec<f32>,
        /// Whether there is one value for each point.
        varying: bool,
    },
    /// Strings, the same for all points.
    Strings(Vec<Arc<str>>),
}

/// Where a viewer is, seen from a point in object space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// From the point towards the viewer; any length.
    pub toward: Vec3,
    /// Size of a pixel at the point, in object space.
    pub pixel: f32,
}

/// How a lattice of a point or curve faces the viewer: each point is `centre + width / 2 * (offset[0] * side +
/// offset[1] * up)`. For a curve, `side` is perpendicular to the curve and to the view, and there is no `up`; for a
/// particle, `side` and `up` span the plane perpendicular to the view.
#[derive(Clone, Debug)]
pub struct Facing {
    /// Centre of each point of the lattice, for each motion key.
    pub centre: Vec<Vec<Vec3>>,
    /// Derivative of the centre along the curve (dP/dv) at each point for each motion key; empty for particles.
    pub tangent: Vec<Vec<Vec3>>,
    /// Width (diameter) at each point for each motion key.
    pub width: Vec<Vec<f32>>,
    /// Whether the widths are in pixels.
    pub raster: bool,
    /// Place in the cross section, each in [-1, 1] (a little more for the corners of a particle diced as a square).
    pub offset: Vec<[f32; 2]>,
}

impl Dice {
    /// Turns points and curves towards the viewer: recomputes `p`, `dpdu` and `dpdv`. `view` gets the motion key and
    /// a position at it. Nothing happens to other primitives.
    pub fn turn(&mut self, view: &dyn Fn(usize, Vec3) -> View) {
        self.turn_by(&|key, _, p| view(key, p));
    }

    /// As [`Dice::turn`]; `view` also gets the index of the point in the lattice.
    pub(crate) fn turn_by(&mut self, view: &dyn Fn(usize, usize, Vec3) -> View) {
        let Some(facing) = &self.facing else { return };
        let n = facing.offset.len();
        self.p.clear();
        self.dpdu = vec![Vec3::ZERO; n];
        self.dpdv = vec![Vec3::ZERO; n];
        // The frames of the first key steer those of the others, so that nothing spins in between.
        let mut first: Vec<Vec3> = Vec::new();
        for (key, centres) in facing.centre.iter().enumerate() {
            let mut positions = Vec::with_capacity(n);
            for (i, &centre) in centres.iter().enumerate() {
                let view = view(key, i, centre);
                let width = facing.width[key][i] * if facing.raster { view.pixel } else { 1.0 };
                let toward = view.toward.try_normalize().unwrap_or(Vec3::Z);
                let [x, y] = facing.offset[i];
                let (side, up, along) = match facing.tangent.get(key) {
                    Some(tangents) => {
                        let side = ribbon_side(tangents[i], toward);
                        (side, Vec3::ZERO, tangents[i])
                    }
                    None => {
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
                positions.push(centre + (side * x + up * y) * (width * 0.5));
            }
            self.p.push(positions);
        }
    }
}

/// Across a curve and perpendicular to the view, so that side x tangent looks towards the viewer.
fn ribbon_side(tangent: Vec3, toward: Vec3) -> Vec3 {
    let along = tangent.try_normalize().unwrap_or_else(|| toward.any_orthonormal_vector());
    let side = along.cross(toward);
    // Seen end on, any side will do.
    let end_on = side.length_squared() < 1e-12;
    let side = if end_on { None } else { side.try_normalize() };
    side.unwrap_or_else(|| along.any_orthonormal_vector())
}
