//! Points to be shaded together, as structure-of-arrays lanes.

use granita_base::{ParamType, Vec3};
use granita_gsl::ir::ShaderKind;
use std::sync::Arc;

/// Three arrays: x, y and z (or r, g and b) of every point.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Lanes3 {
    /// The arrays, all of the grid's length.
    pub xyz: [Vec<f32>; 3],
}

impl Lanes3 {
    /// `n` zeros.
    pub fn zeros(n: usize) -> Self {
        Self { xyz: std::array::from_fn(|_| vec![0.0; n]) }
    }

    /// `n` copies.
    pub fn splat(v: Vec3, n: usize) -> Self {
        Self { xyz: std::array::from_fn(|c| vec![v[c]; n]) }
    }

    /// From points.
    pub fn from_points(points: &[Vec3]) -> Self {
        Self { xyz: std::array::from_fn(|c| points.iter().map(|p| p[c]).collect()) }
    }

    /// Some lanes.
    pub fn part(&self, lanes: std::ops::Range<usize>) -> Self {
        Self { xyz: self.xyz.each_ref().map(|c| c[lanes.clone()].to_vec()) }
    }

    /// Value of lane `i`.
    pub fn get(&self, i: usize) -> Vec3 {
        Vec3::new(self.xyz[0][i], self.xyz[1][i], self.xyz[2][i])
    }

    /// Sets lane `i`.
    pub fn set(&mut self, i: usize, v: Vec3) {
        for c in 0..3 {
            self.xyz[c][i] = v[c];
        }
    }

    /// Number of lanes.
    pub fn len(&self) -> usize {
        self.xyz[0].len()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.xyz[0].is_empty()
    }
}

/// A rectangle of points of a grid, u fastest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rect {
    /// Lane of its first point.
    pub first: usize,
    /// Points along u.
    pub nu: usize,
    /// Points along v.
    pub nv: usize,
}

impl Rect {
    /// Its lanes.
    pub fn lanes(&self) -> std::ops::Range<usize> {
        self.first..self.first + self.nu * self.nv
    }
}

/// How the points of a grid neighbour each other; derivatives follow from it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Topology {
    /// `nu x nv` points, u fastest.
    Rect {
        /// Points along u.
        nu: usize,
        /// Points along v.
        nv: usize,
    },
    /// Rectangles that have nothing to do with each other, one after the other.
    Rects(Arc<[Rect]>),
    /// `3 n` points: `n` centres, then their `n` neighbours along u, then along v. Ray hits.
    Triplets {
        /// Number of centres.
        n: usize,
    },
    /// Unrelated points; derivatives are 0.
    Scattered {
        /// Number of points.
        n: usize,
    },
}

impl Topology {
    /// Number of points (lanes).
    pub fn points(&self) -> usize {
        match self {
            Self::Rect { nu, nv } => nu * nv,
            Self::Rects(list) => list.last().map_or(0, |rect| rect.lanes().end),
            Self::Triplets { n } => 3 * n,
            Self::Scattered { n } => *n,
        }
    }

    /// Its rectangles, in order; none where points have no place in one.
    pub fn rects(&self) -> impl Iterator<Item = Rect> + '_ {
        let (one, list) = match self {
            Self::Rect { nu, nv } => (Some(Rect { first: 0, nu: *nu, nv: *nv }), &[][..]),
            Self::Rects(list) => (None, &list[..]),
            Self::Triplets { .. } | Self::Scattered { .. } => (None, &[][..]),
        };
        one.into_iter().chain(list.iter().copied())
    }

    /// The rectangle that a lane lies in.
    pub fn rect_of(&self, lane: usize) -> Option<Rect> {
        match self {
            Self::Rects(list) => {
                let after = list.partition_point(|rect| rect.first <= lane);
                list.get(after.checked_sub(1)?).copied()
            }
            _ => self.rects().next(),
        }
    }
}

/// A point of a rectangular grid whose neighbours are not where an even grid would have them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Uneven {
    /// Its lane.
    pub lane: u32,
    /// Differences as an even grid would have them, of those between neighbours: towards the next point along u
    /// `of[0][0] * along_u + of[0][1] * along_v`, along v likewise with `of[1]`.
    pub of: [[f32; 2]; 2],
}

/// Numbers or strings of a primitive variable over a grid.
#[derive(Clone, Debug, PartialEq)]
pub enum PrimvarData {
    /// Component by component (array elements included): value `c` of lane `i` at `c * n + i`, or at `c` when
    /// uniform.
    Floats {
        /// The values.
        values: Vec<f32>,
        /// Whether there is one value per lane.
        varying: bool,
    },
    /// Uniform strings.
    Strings(Vec<Arc<str>>),
}

/// A primitive variable, evaluated on the points of a grid, spatial values in "common" space.
#[derive(Clone, Debug, PartialEq)]
pub struct Primvar {
    /// Its name.
    pub name: Arc<str>,
    /// Its type; the interpolation no longer matters.
    pub ty: ParamType,
    /// Its values.
    pub data: PrimvarData,
}

/// What a shader left on a grid for `getmessage` of the object's later shaders.
#[derive(Clone, Debug, PartialEq)]
pub struct Message {
    /// Usage of the shader that left it.
    pub from: ShaderKind,
    /// Name and value; its type's interpolation does not matter.
    pub value: Primvar,
}

/// Why a grid is shaded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RayKind {
    /// 0 for the camera, 1 for a one-bounce ray and so on.
    pub level: u32,
    /// Only opacity is wanted, for a shadow ray.
    pub shadow: bool,
    /// For indirect illumination.
    pub indirect: bool,
}

/// Points to be shaded together; spatial values in "common" space.
///
/// Displacement changes `p` and `n`; surface and volume shaders change `c` and `opacity`.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// Neighbourhood; gives the number of lanes.
    pub topology: Topology,
    /// Points whose neighbours are not evenly spread; empty for most grids.
    pub uneven: Vec<Uneven>,
    /// Positions.
    pub p: Lanes3,
    /// Shading normals, any length.
    pub n: Lanes3,
    /// Geometric normals, any length, not zero where the surface has one.
    pub ng: Lanes3,
    /// From the viewing position to `p`.
    pub i: Lanes3,
    /// Change of `p` per unit of `u`.
    pub dpdu: Lanes3,
    /// Change of `p` per unit of `v`.
    pub dpdv: Lanes3,
    /// Change of `p` per unit of time.
    pub dpdtime: Lanes3,
    /// Of each rectangle, on which sides the surface goes on smoothly although its parameters end there (a face of a smooth
    /// mesh): along u and v, first and last. Nowhere on those that are not listed.
    pub seams: Vec<[bool; 4]>,
    /// Of flat faces under the normals of a smooth surface: from each point to about where that surface lies, on the side that the normals
    /// point to and on the other one; zero where it lies on the wrong side of the face. None for other surfaces.
    pub lift: Option<Arc<[Lanes3; 2]>>,
    /// Surface parameters.
    pub u: Vec<f32>,
    /// Surface parameters.
    pub v: Vec<f32>,
    /// Shutter time.
    pub time: f32,
    /// Length of the shutter interval that this shading stands for.
    pub dtime: f32,
    /// Colour; before shading, the surface colour.
    pub c: Lanes3,
    /// Opacity; before shading, the object's.
    pub opacity: Lanes3,
    /// Primitive variables.
    pub primvars: Vec<Primvar>,
    /// Whether the geometric normal is `-cross (dPdu, dPdv)` (see `scene::AttributeSet::flip_normals`).
    pub flip_normals: bool,
    /// Seeds `random ()`; depends on nothing but the primitive and the place on it.
    pub seed: u32,
    /// Of points that others of the grid must not show at: what each is named for random numbers, in place of the seed and its
    /// lane. Empty otherwise.
    pub names: Vec<u32>,
    /// Why it is shaded.
    pub ray: RayKind,
    /// Name of the object, for messages.
    pub object: Arc<str>,
    /// Left by the shaders that ran on this grid before.
    pub messages: Vec<Message>,
    /// Of hits: messages and parameters of the shader that spawned the rays, for `getmessage ("parent", ...)`,
    /// for each point those of its ray. Of one name the first of the right type counts.
    pub parent: Vec<Primvar>,
}

impl Grid {
    /// A grid with everything zero, C and opacity one.
    pub fn new(topology: Topology) -> Self {
        let n = topology.points();
        Self {
            topology,
            uneven: Vec::new(),
            p: Lanes3::zeros(n),
            n: Lanes3::zeros(n),
            ng: Lanes3::zeros(n),
            i: Lanes3::zeros(n),
            dpdu: Lanes3::zeros(n),
            dpdv: Lanes3::zeros(n),
            dpdtime: Lanes3::zeros(n),
            seams: Vec::new(),
            lift: None,
            u: vec![0.0; n],
            v: vec![0.0; n],
            time: 0.0,
            dtime: 0.0,
            c: Lanes3::splat(Vec3::ONE, n),
            opacity: Lanes3::splat(Vec3::ONE, n),
            primvars: Vec::new(),
            flip_normals: false,
            seed: 0,
            names: Vec::new(),
            ray: RayKind::default(),
            object: Arc::from(""),
            messages: Vec::new(),
            parent: Vec::new(),
        }
    }

    /// Number of lanes.
    pub fn len(&self) -> usize {
        self.topology.points()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}
