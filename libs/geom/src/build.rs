//! Builds pieces from the descriptions of primitives.

use crate::key::ShapeKey;
use crate::spline::Spline;
use crate::trim::Trimming;
use crate::vars::vertex_count;
use crate::{GeomError, Piece, curves, mesh, moving, patch, points, sphere, subdiv};
use granita_base::{Severity, ShapeDesc};

/// Builds the pieces of a primitive.
///
/// `keys` are the motion keys, times increasing, all with the same parameters. Pieces move with the positions of all
/// keys, including widths of points and curves and the arguments of a sphere. Primitive variables of later keys are
/// returned by [`crate::Dice::variables_at`]. `trim` applies to patches. Errors that leave something to draw (an
/// index out of range, a primitive variable of a wrong size, `"vertex normal P"`) are passed to `report` as warnings.
/// A primitive with nothing to draw (no faces, no area) has no pieces.
///
/// # Errors
/// [`GeomError`] when the primitive cannot be built.
pub fn build(
    shape: &ShapeDesc,
    keys: &[ShapeKey<'_>],
    trim: Option<Trimming<'_>>,
    report: &mut dyn FnMut(Severity, String),
) -> Result<Vec<Piece>, GeomError> {
    let call = shape.call_name();
    let fail = |what: &str| GeomError::Malformed { call, what: what.into() };
    if keys.is_empty() {
        return Err(fail("there are no motion keys"));
    }
    if !keys.iter().all(|k| k.time.is_finite()) || keys.windows(2).any(|w| w[0].time >= w[1].time) {
        return Err(fail("the times of the motion keys do not increase"));
    }
    let merged = moving::with_later(keys);
    let mut keys = keys.to_vec();
    if let Some(params) = &merged {
        keys[0].params = params;
    }
    let keys = &keys[..];
    match shape {
        ShapeDesc::Patch { u, v, nu, nv } => {
            check_counts(call, keys, [*nu, *nv])?;
            let splines =
                [Spline::uniform(call, "along u", *u, *nu)?, Spline::uniform(call, "along v", *v, *nv)?];
            patch::build(keys, splines, [*nu, *nv], trim, report)
        }
        ShapeDesc::Nurbs { u, v } => {
            let splines = [Spline::nurbs(call, "along u", u)?, Spline::nurbs(call, "along v", v)?];
            patch::build(keys, splines, [u.n, v.n], trim, report)
        }
        ShapeDesc::Mesh { subdivide: false, nverts, verts } => mesh::build(keys, nverts, verts, report),
        ShapeDesc::Mesh { subdivide: true, nverts, verts } => subdiv::build(keys, nverts, verts, report),
        ShapeDesc::Sphere { radius, zmin, zmax, thetamax_deg } => {
            sphere::build(keys, [*radius, *zmin, *zmax, *thetamax_deg], report)
        }
        ShapeDesc::Points { n } => points::build(keys, *n, report),
        ShapeDesc::Curves { ncurves: 0, .. } | ShapeDesc::NurbsCurves { ncurves: 0, .. } => Ok(Vec::new()),
        ShapeDesc::Curves { basis, ncurves, nverts } => {
            check_counts(call, keys, [*ncurves, *nverts])?;
            let spline = Spline::uniform(call, "along each curve", *basis, *nverts)?;
            curves::build(keys, spline, *ncurves, *nverts, report)
        }
        ShapeDesc::NurbsCurves { ncurves, span } => {
            let spline = Spline::nurbs(call, "along each curve", span)?;
            curves::build(keys, spline, *ncurves, span.n, report)
        }
    }
}

/// Checks that there are as many control vertices as two counts multiply to, before anything of their size is
/// allocated.
fn check_counts(call: &'static str, keys: &[ShapeKey<'_>], [a, b]: [usize; 2]) -> Result<(), GeomError> {
    // Other errors of the vertices are reported later.
    let have = vertex_count(call, keys, &mut |_, _| {})?;
    if a.max(1).checked_mul(b.max(1)).is_none_or(|n| n > have) {
        let what = format!("{have} control vertices instead of {a} x {b}");
        return Err(GeomError::Malformed { call, what });
    }
    Ok(())
}
