//! The declaration of a geometric primitive.
//!
//! Scene readers make these values, the scene stores them, writers write them, and `geom` builds surfaces from them.
//! Control vertices and primitive variables are passed separately as [`crate::Params`].

use crate::Interp;
use std::sync::Arc;

/// The interpolation of the control vertices along one direction of a patch, or along a curve.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum CurveBasis {
    /// Piecewise linear.
    Linear,
    /// Piecewise cubic Bezier, with `4 + 3i` vertices.
    Bezier,
    /// Uniform cubic B-spline.
    BSpline,
    /// Cubic Catmull-Rom.
    CatmullRom,
}

impl CurveBasis {
    /// Returns the name used in scene files.
    pub fn word(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Bezier => "bezier",
            Self::BSpline => "bspline",
            Self::CatmullRom => "catmull-rom",
        }
    }

    /// Returns the basis of a name.
    pub fn from_word(word: &str) -> Option<Self> {
        [Self::Linear, Self::Bezier, Self::BSpline, Self::CatmullRom].into_iter().find(|b| b.word() == word)
    }

    /// Returns the bases along u and v of a patch: two names with a comma between them, or one for both
    /// (reference 2.8.1).
    ///
    /// # Errors
    /// Returns the name that is not a basis.
    pub fn pair_from_words(words: &str) -> Result<(Self, Self), &str> {
        let (u, v) = words.split_once(',').unwrap_or((words, words));
        let basis = |word: &'_ str| Self::from_word(word.trim());
        match (basis(u), basis(v)) {
            (Some(u), Some(v)) => Ok((u, v)),
            (None, _) => Err(u.trim()),
            (_, None) => Err(v.trim()),
        }
    }

    /// True when `n` control vertices are valid for this basis.
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
    /// The number of control vertices.
    pub n: usize,
    /// The degree plus one.
    pub order: usize,
    /// The `n + order` knots, not decreasing.
    pub knots: Arc<[f32]>,
    /// The lower end of the parametric range.
    pub min: f32,
    /// The upper end of the parametric range.
    pub max: f32,
}

/// A geometric primitive as declared (reference 2.8), without its parameters.
#[derive(Clone, Debug, PartialEq)]
pub enum ShapeDesc {
    /// `Patch (interp, nu, nv)`: `nu x nv` control vertices, u fastest.
    Patch {
        /// The basis along u.
        u: CurveBasis,
        /// The basis along v.
        v: CurveBasis,
        /// The number of vertices along u.
        nu: usize,
        /// The number of vertices along v.
        nv: usize,
    },
    /// `Patch (nu, uorder, uknot, ...)`: a NURBS surface, control vertices u fastest.
    Nurbs {
        /// The knots along u.
        u: KnotSpan,
        /// The knots along v.
        v: KnotSpan,
    },
    /// `Mesh (interp, nverts, verts)`.
    Mesh {
        /// True for Catmull-Clark subdivision, false for flat faces.
        subdivide: bool,
        /// The number of vertices of each face.
        nverts: Arc<[i32]>,
        /// The vertex indices of all faces in order. Its length is the sum of `nverts`.
        verts: Arc<[i32]>,
    },
    /// `Points (n)`.
    Points {
        /// The number of particles.
        n: usize,
    },
    /// `Curves (interp, ncurves, vertspercurve)`.
    Curves {
        /// The interpolation along each curve.
        basis: CurveBasis,
        /// The number of curves.
        ncurves: usize,
        /// The number of vertices of each curve.
        nverts: usize,
    },
    /// `Curves (ncurves, vertspercurve, order, knot, vmin, vmax)`: NURBS curves sharing one knot vector.
    NurbsCurves {
        /// The number of curves.
        ncurves: usize,
        /// The knots along each curve, with `span.n` vertices per curve.
        span: KnotSpan,
    },
    /// `Sphere (radius, zmin, zmax, thetamax)`.
    Sphere {
        /// The radius in object space.
        radius: f32,
        /// The lower cut, z in object space.
        zmin: f32,
        /// The upper cut, z in object space.
        zmax: f32,
        /// The sweep angle in degrees.
        thetamax_deg: f32,
    },
}

impl ShapeDesc {
    /// Returns the name of the call that declares it.
    pub fn call_name(&self) -> &'static str {
        match self {
            Self::Patch { .. } | Self::Nurbs { .. } => "Patch",
            Self::Mesh { .. } => "Mesh",
            Self::Points { .. } => "Points",
            Self::Curves { .. } | Self::NurbsCurves { .. } => "Curves",
            Self::Sphere { .. } => "Sphere",
        }
    }

    /// Returns the number of items of a parameter of this interpolation; 0 where the primitive accepts none. A mesh
    /// has as many vertices as its faces use.
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
    /// The number of curves in each loop.
    pub ncurves: Arc<[i32]>,
    /// The number of control points of each curve.
    pub n: Arc<[i32]>,
    /// The order of each curve.
    pub order: Arc<[i32]>,
    /// The knots of all curves, `n + order` each.
    pub knots: Arc<[f32]>,
    /// The lower parameter of each curve.
    pub min: Arc<[f32]>,
    /// The upper parameter of each curve.
    pub max: Arc<[f32]>,
    /// The control points `(u, v, w)` of all curves, three numbers each.
    pub uvw: Arc<[f32]>,
}
