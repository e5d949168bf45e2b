//! Points that are shaded together, as structure-of-arrays lanes.

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
    /// Returns `n` zeros.
    pub fn zeros(n: usize) -> Self {
        Self { xyz: std::array::from_fn(|_| vec![0.0; n]) }
    }

    /// Returns `n` copies of `v`.
    pub fn splat(v: Vec3, n: usize) -> Self {
        Self { xyz: std::array::from_fn(|c| vec![v[c]; n]) }
    }

    /// Converts points to lanes.
    pub fn from_points(points: &[Vec3]) -> Self {
        Self { xyz: std::array::from_fn(|c| points.iter().map(|p| p[c]).collect()) }
    }

    /// Returns a copy of some lanes.
    pub fn part(&self, lanes: std::ops::Range<usize>) -> Self {
        Self { xyz: self.xyz.each_ref().map(|c| c[lanes.clone()].to_vec()) }
    }

    /// Returns the value of lane `i`.
    pub fn get(&self, i: usize) -> Vec3 {
        Vec3::new(self.xyz[0][i], self.xyz[1][i], self.xyz[2][i])
    }

    /// Sets lane `i`.
    pub fn set(&mut self, i: usize, v: Vec3) {
        for c in 0..3 {
            self.xyz[c][i] = v[c];
        }
    }

    /// Returns the number of lanes.
    pub fn len(&self) -> usize {
        self.xyz[0].len()
    }

    /// True when there are no lanes.
    pub fn is_empty(&self) -> bool {
        self.xyz[0].is_empty()
    }
}

/// A rectangle of points of a grid, u fastest.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rect {
    /// The lane of its first point.
    pub first: usize,
    /// The number of points along u.
    pub nu: usize,
    /// The number of points along v.
    pub nv: usize,
}

impl Rect {
    /// Returns its lanes.
    pub fn lanes(&self) -> std::ops::Range<usize> {
        self.first..self.first + self.nu * self.nv
    }
}

/// The neighbour relation of the points of a grid, which derivatives follow.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Topology {
    /// `nu x nv` points, u fastest.
    Rect {
        /// The number of points along u.
        nu: usize,
        /// The number of points along v.
        nv: usize,
    },
    /// Independent rectangles, one after the other.
    Rects(Arc<[Rect]>),
    /// Ray hits as `3 n` points: `n` centres, then their `n` neighbours along u, then along v.
    Triplets {
        /// Number of centres.
        n: usize,
    },
    /// Unrelated points, whose derivatives are 0.
    Scattered {
        /// The number of points.
        n: usize,
    },
}

impl Topology {
    /// Returns the number of points (lanes).
    pub fn points(&self) -> usize {
        match self {
            Self::Rect { nu, nv } => nu * nv,
            Self::Rects(list) => list.last().map_or(0, |rect| rect.lanes().end),
            Self::Triplets { n } => 3 * n,
            Self::Scattered { n } => *n,
        }
    }

    /// Returns its rectangles in order; none for topologies without rectangles.
    pub fn rects(&self) -> impl Iterator<Item = Rect> + '_ {
        let (one, list) = match self {
            Self::Rect { nu, nv } => (Some(Rect { first: 0, nu: *nu, nv: *nv }), &[][..]),
            Self::Rects(list) => (None, &list[..]),
            Self::Triplets { .. } | Self::Scattered { .. } => (None, &[][..]),
        };
        one.into_iter().chain(list.iter().copied())
    }

    /// Returns the rectangle that contains a lane.
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

/// A point of a rectangular grid whose neighbours are not at the positions of an even grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Uneven {
    /// Its lane.
    pub lane: u32,
    /// The coefficients that convert differences between neighbours to those of an even grid: towards the next
    /// point along u `of[0][0] * along_u + of[0][1] * along_v`, along v likewise with `of[1]`.
    pub of: [[f32; 2]; 2],
}

/// The numbers or strings of a primitive variable over a grid.
#[derive(Clone, Debug, PartialEq)]
pub enum PrimvarData {
    /// Numbers component by component (array elements included). The value `c` of lane `i` is at `c * n + i`, or at
    /// `c` when uniform.
    Floats {
        /// The values.
        values: Vec<f32>,
        /// True when there is one value per lane.
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
    /// Its type. The interpolation is not used.
    pub ty: ParamType,
    /// Its values.
    pub data: PrimvarData,
}

/// A message that a shader left on a grid for `getmessage` of later shaders of the object.
#[derive(Clone, Debug, PartialEq)]
pub struct Message {
    /// The usage of the shader that left it.
    pub from: ShaderKind,
    /// Its name and value. The interpolation of the type is not used.
    pub value: Primvar,
}

/// The ray that a grid is shaded for.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct RayKind {
    /// The ray level: 0 for the camera, 1 for a one-bounce ray and so on.
    pub level: u32,
    /// True for a shadow ray, which needs only opacity.
    pub shadow: bool,
    /// True for indirect illumination.
    pub indirect: bool,
    /// The number of bounces of indirect light so far. Rays of reflections keep it.
    pub bounces: u32,
}

/// The rays that lead from a point that a camera sees to a hit.
///
/// The point may have several rays that were reflected as often as this one. They share a sequence of random numbers,
/// so that the rays that leave their hits are spread as evenly as those of one hit.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayPath {
    /// The number of rays of the point: the product of the numbers of samples along the path.
    pub rays: f32,
    /// The index of this ray among them.
    pub index: u32,
    /// The seed that they share.
    pub seed: u32,
    /// The product of the "Kr" of all calls of `environment ()` along the path.
    pub weight: f32,
}

impl Default for RayPath {
    fn default() -> Self {
        Self { rays: 1.0, index: 0, seed: 0, weight: 1.0 }
    }
}

impl RayPath {
    /// Returns words that tell paths apart.
    pub fn words(&self) -> [u32; 4] {
        [self.rays.to_bits(), self.index, self.seed, self.weight.to_bits()]
    }
}

/// Points that are shaded together. Spatial values are in "common" space.
///
/// Displacement shaders change `p` and `n`. Surface and volume shaders change `c` and `opacity`.
#[derive(Clone, Debug, PartialEq)]
pub struct Grid {
    /// The neighbour relation, which also gives the number of lanes.
    pub topology: Topology,
    /// Points whose neighbours are not evenly spaced; empty for most grids.
    pub uneven: Vec<Uneven>,
    /// Positions.
    pub p: Lanes3,
    /// Shading normals of any length.
    pub n: Lanes3,
    /// Geometric normals of any length, not zero where the surface has one.
    pub ng: Lanes3,
    /// Vectors from the viewing position to `p`.
    pub i: Lanes3,
    /// The derivative of `p` over `u`.
    pub dpdu: Lanes3,
    /// The derivative of `p` over `v`.
    pub dpdv: Lanes3,
    /// The derivative of `p` over time.
    pub dpdtime: Lanes3,
    /// For each rectangle, the sides where the surface continues smoothly although its parameters end there (a face
    /// of a smooth mesh): along u and v, first and last. Rectangles that are not listed have none.
    pub seams: Vec<[bool; 4]>,
    /// For flat faces with the normals of a smooth surface, the approximate offset from each point to that surface,
    /// on the side that the normals point to and on the other one. It is zero where the smooth surface lies on the
    /// wrong side of the face. `None` for other surfaces.
    pub lift: Option<Arc<[Lanes3; 2]>>,
    /// Surface parameters.
    pub u: Vec<f32>,
    /// Surface parameters.
    pub v: Vec<f32>,
    /// The shutter time.
    pub time: f32,
    /// The length of the shutter interval that this shading represents.
    pub dtime: f32,
    /// The colour. Before shading it is the surface colour.
    pub c: Lanes3,
    /// The opacity. Before shading it is the object's.
    pub opacity: Lanes3,
    /// Primitive variables.
    pub primvars: Vec<Primvar>,
    /// True when the geometric normal is `-cross (dPdu, dPdv)` (see `scene::AttributeSet::flip_normals`).
    pub flip_normals: bool,
    /// The seed of `random ()`. It depends only on the primitive and the position on it.
    pub seed: u32,
    /// The seed of each point, for grids whose points must not depend on each other. It replaces the seed and the
    /// lane. Empty otherwise.
    pub names: Vec<u32>,
    /// The id of the primitive of each rectangle, or of all points that are not in rectangles. Empty when it is not
    /// known.
    pub primitives: Vec<u32>,
    /// The ray that it is shaded for.
    pub ray: RayKind,
    /// For ray hits, the path to each point. Empty otherwise.
    pub paths: Arc<[RayPath]>,
    /// The name of the object, for messages.
    pub object: Arc<str>,
    /// Messages left by the shaders that ran on this grid before.
    pub messages: Vec<Message>,
    /// For ray hits, the messages and parameters of the shader that spawned the rays, for `getmessage ("parent",
    /// ...)`. Each point has those of its ray. Among entries of one name the first of the right type counts.
    pub parent: Vec<Primvar>,
}

impl Grid {
    /// Returns a grid with C and opacity one and all other values zero.
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
            primitives: Vec::new(),
            ray: RayKind::default(),
            paths: Arc::default(),
            object: Arc::from(""),
            messages: Vec::new(),
            parent: Vec::new(),
        }
    }

    /// Returns the number of lanes.
    pub fn len(&self) -> usize {
        self.topology.points()
    }

    /// The bytes of its arrays on the heap.
    pub fn bytes(&self) -> usize {
        let Self { p, n, ng, i, dpdu, dpdv, dpdtime, c, opacity, .. } = self;
        let lanes = [p, n, ng, i, dpdu, dpdv, dpdtime, c, opacity]
            .into_iter()
            .chain(self.lift.iter().flat_map(|l| &**l));
        let lanes: usize = lanes.flat_map(|lanes| &lanes.xyz).map(Vec::len).sum();
        let of = |value: &Primvar| match &value.data {
            PrimvarData::Floats { values, .. } => values.len(),
            PrimvarData::Strings(list) => 8 * list.len(),
        };
        let values = self.primvars.iter().chain(&self.parent).chain(self.messages.iter().map(|m| &m.value));
        let numbers = lanes + self.u.len() + self.v.len() + self.names.len() + values.map(of).sum::<usize>();
        let lists =
            size_of_val(&self.uneven[..]) + size_of_val(&*self.paths) + size_of_val(&self.primitives[..]);
        size_of::<f32>() * numbers + lists + size_of::<Self>()
    }

    /// True when there are no lanes.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}
