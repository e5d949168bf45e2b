//! What a geometric primitive was declared as, before anybody builds it.
//!
//! Scene readers make these, the scene stores them, writers echo them and `geom` builds surfaces
//! from them; control vertices and primitive variables travel beside them as [`crate::Params`].

use crate::Interp;
use std::sync::Arc;

/// How control vertices of one direction of a patch, or of a curve, are interpolated.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CurveBasis {
    /// Piecewise linear.
    Linear,
    /// Piecewise cubic Bezier, `4 + 3i` vertices.
    Bezier,
    /// Uniform cubic B-spline.
    BSpline,
    /// Cubic Catmull-Rom.
    CatmullRom,
}

impl CurveBasis {
    /// The name used in scene files.
    pub fn word(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Bezier => "bezier",
            Self::BSpline => "bspline",
            Self::CatmullRom => "catmull-rom",
        }
    }

    /// By name.
    pub fn from_word(word: &str) -> Option<Self> {
        [Self::Linear, Self::Bezier, Self::BSpline, Self::CatmullRom].into_iter().find(|b| b.word() == word)
    }

    /// The bases along u and v of a patch: two names with a comma between them, or one for both (reference 2.8.1).
    ///
    /// # Errors
    /// The name that is of no basis.
    pub fn pair_from_words(words: &str) -> Result<(Self, Self), &str> {
        let (u, v) = words.split_once(',').unwrap_or((words, words));
        let basis = |word: &'_ str| Self::from_word(word.trim());
        match (basis(u), basis(v)) {
            (Some(u), Some(v)) => Ok((u, v)),
            (None, _) => Err(u.trim()),
            (_, None) => Err(v.trim()),
        }
    }

    /// Whether `n` control vertices suit this basis.
    pub fn accepts(self, n: usize) -> bool {
        match self {
            Self::Linear => n >= 2,
            Self::Bezier => n >= 4 && (n - 4).is_multiple_of(3),
            Self::BSpline | Self::CatmullRom => n >= 4,
        }
    }
}

/// One direction of a NURBS patch or a NURBS curve.
#[derive(Clone, Debug, PartialEq)]
pub struct KnotSpan {
    /// Number of control vertices.
    pub n: usize,
    /// Degree plus one.
    pub order: usize,
    /// `n + order` knots, not decreasing.
    pub knots: Arc<[f32]>,
    /// Lower end of the parametric range.
    pub min: f32,
    /// Upper end of the parametric range.
    pub max: f32,
}

/// A geometric primitive as declared (reference 2.8), without its parameters.
#[derive(Clone, Debug, PartialEq)]
pub enum ShapeDesc {
    /// `Patch (interp, nu, nv)`: `nu x nv` control vertices, u fastest.
    Patch {
        /// Basis along u.
        u: CurveBasis,
        /// Basis along v.
        v: CurveBasis,
        /// Vertices along u.
        nu: usize,
        /// Vertices along v.
        nv: usize,
    },
    /// `Patch (nu, uorder, uknot, ...)`: a NURBS surface, control vertices u fastest.
    Nurbs {
        /// Along u.
        u: KnotSpan,
        /// Along v.
        v: KnotSpan,
    },
    /// `Mesh (interp, nverts, verts)`.
    Mesh {
        /// Catmull-Clark subdivision instead of flat faces.
        subdivide: bool,
        /// Vertices of each face.
        nverts: Arc<[i32]>,
        /// Vertex indices of all faces in order; its length is the sum of `nverts`.
        verts: Arc<[i32]>,
    },
    /// `Points (n)`.
    Points {
        /// Number of particles.
        n: usize,
    },
    /// `Curves (interp, ncurves, vertspercurve)`.
    Curves {
        /// Interpolation along each curve.
        basis: CurveBasis,
        /// Number of curves.
        ncurves: usize,
        /// Vertices of each curve.
        nverts: usize,
    },
    /// `Curves (ncurves, vertspercurve, order, knot, vmin, vmax)`: NURBS curves sharing one knot vector.
    NurbsCurves {
        /// Number of curves.
        ncurves: usize,
        /// Along each curve; `span.n` vertices a curve.
        span: KnotSpan,
    },
    /// `Sphere (radius, zmin, zmax, thetamax)`.
    Sphere {
        /// Radius in object space.
        radius: f32,
        /// Lower cut.
        zmin: f32,
        /// Upper cut.
        zmax: f32,
        /// Sweep in degrees.
        thetamax_deg: f32,
    },
}

impl ShapeDesc {
    /// The name of the call that declares it.
    pub fn call_name(&self) -> &'static str {
        match self {
            Self::Patch { .. } | Self::Nurbs { .. } => "Patch",
            Self::Mesh { .. } => "Mesh",
            Self::Points { .. } => "Points",
            Self::Curves { .. } | Self::NurbsCurves { .. } => "Curves",
            Self::Sphere { .. } => "Sphere",
        }
    }

    /// How many items a parameter of this interpolation has; 0 where the primitive takes none. A mesh has as many
    /// vertices as its faces use.
    pub fn items(&self, interp: Interp) -> usize {
        let (vertex, linear, perpiece) = match self {
            Self::Patch { nu, nv, .. } => (nu.saturating_mul(*nv), 4, 0),
            Self::Nurbs { u, v } => (u.n.saturating_mul(v.n), 4, 0),
            Self::Mesh { nverts, verts, .. } => {
                let last = verts.iter().copied().max().unwrap_or(-1);
                (usize::try_from(i64::from(last) + 1).unwrap_or(0), verts.len(), nverts.len())
            }
            Self::Points { n } => (*n, *n, *n),
            Self::Curves { ncurves, nverts, .. } => {
                (ncurves.saturating_mul(*nverts), ncurves.saturating_mul(2), *ncurves)
            }
            Self::NurbsCurves { ncurves, span } => {
                (ncurves.saturating_mul(span.n), ncurves.saturating_mul(2), *ncurves)
            }
            Self::Sphere { .. } => (0, 4, 0),
        };
        match interp {
            Interp::Constant => 1,
            Interp::PerPiece => perpiece,
            Interp::Linear => linear,
            Interp::Vertex => vertex,
        }
    }
}

/// The argument of `TrimCurve` (reference 2.8.1): closed loops of rational curves in the (u, v) of a patch.
#[derive(Clone, Debug, PartialEq)]
pub struct TrimDesc {
    /// Curves in each loop.
    pub ncurves: Arc<[i32]>,
    /// Control points of each curve.
    pub n: Arc<[i32]>,
    /// Order of each curve.
    pub order: Arc<[i32]>,
    /// Knots of all curves, `n + order` each.
    pub knots: Arc<[f32]>,
    /// Lower parameter of each curve.
    pub min: Arc<[f32]>,
    /// Upper parameter of each curve.
    pub max: Arc<[f32]>,
    /// Control points `(u, v, w)` of all curves, three numbers each.
    pub uvw: Arc<[f32]>,
}
