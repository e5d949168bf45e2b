//! Patches, whose control vertices form a rectangle (reference 2.8.1), uniform or with knots.

use crate::GeomError;
use crate::key::ShapeKey;
use crate::net::{Net, pieces};
use crate::range::Place;
use crate::spline::Spline;
use crate::surface::Piece;
use crate::trim::{Trim, Trimming};
use crate::vars::{Control, Counts, Report, Vars, control};
use granita_base::{Bound, Severity};

/// The data of a patch.
struct Patch {
    times: Vec<f32>,
    splines: [Spline; 2],
    /// The number of control vertices along u.
    nu: usize,
    control: Control,
    vars: Vars,
    trim: Option<Trim>,
}

/// Builds a patch from its two directions.
pub(crate) fn build(
    keys: &[ShapeKey<'_>],
    splines: [Spline; 2],
    counts: [usize; 2],
    trim: Option<Trimming<'_>>,
    report: Report<'_>,
) -> Result<Vec<Piece>, GeomError> {
    const CALL: &str = "Patch";
    let [nu, nv] = counts;
    let fail = |what: String| GeomError::Malformed { call: CALL, what };
    let n = nu.checked_mul(nv).ok_or_else(|| fail(format!("{nu} x {nv} control vertices")))?;
    crate::vars::vertex_count(CALL, keys, report)?;
    let wanted = Counts { vertex: Some(n), linear: Some(4), perpiece: None };
    let vars = Vars::collect(CALL, keys[0].params, wanted, report);
    let control = control(CALL, keys, n, &vars, report)?;
    if let Some(bad) = control.values.iter().position(|x| !x.is_finite()) {
        return Err(fail(format!("control vertex {} is not finite", bad / control.channels)));
    }
    if control.dim == 4 && control.values.chunks_exact(control.channels).any(|v| v[3] <= 0.0) {
        report(Severity::Warning, format!("{CALL}: some weights of the control vertices are not positive"));
    }
    let trim = match trim.map(Trim::new) {
        Some(Err(what)) => {
            report(Severity::Error, format!("TrimCurve: {what}; the patch is not trimmed"));
            None
        }
        Some(Ok(trim)) => Some(trim),
        None => None,
    };
    let times = keys.iter().map(|k| k.time).collect();
    Ok(pieces(Box::new(Patch { times, splines, nu, control, vars, trim }), 1))
}

impl Net for Patch {
    fn times(&self) -> &[f32] {
        &self.times
    }
    fn dim(&self) -> usize {
        self.control.dim
    }
    fn channels(&self) -> usize {
        self.control.channels
    }
    fn vars(&self) -> &Vars {
        &self.vars
    }
    fn degrees(&self) -> [usize; 2] {
        [self.splines[0].degree, self.splines[1].degree]
    }
    fn segments(&self, _part: usize) -> [u32; 2] {
        [self.splines[0].count(), self.splines[1].count()]
    }
    fn parameter(&self, _part: usize, axis: usize, place: Place) -> (f64, f64) {
        let spline = &self.splines[axis];
        let segment = &spline.segments[place.segment as usize];
        (spline.parameter(place.segment, place.a, place.b), segment.t1 - segment.t0)
    }
    fn extent(&self, _part: usize, axis: usize) -> (f64, f64) {
        self.splines[axis].extent()
    }
    fn gather(&self, _part: usize, segment: [u32; 2], out: &mut Vec<f64>) {
        let c = self.control.channels;
        let [su, sv] = [0, 1].map(|axis| &self.splines[axis].segments[segment[axis] as usize]);
        let [mu, mv] = self.degrees().map(|d| d + 1);
        out.clear();
        out.resize(mu * mv * c, 0.0);
        let vertex = |i: usize, j: usize| self.control.vertex((sv.first + j) * self.nu + su.first + i);
        // The matrices are always applied along v first. Pieces to the left and right of an edge then share its
        // Bezier vertices.
        for i in 0..mu {
            for j in 0..mv {
                let at = &mut out[(j * mu + i) * c..][..c];
                match &sv.matrix {
                    None => at.copy_from_slice(vertex(i, j)),
                    Some(m) => combine(&m[j * mv..][..mv], |k| vertex(i, k), at),
                }
            }
        }
        if let Some(m) = &su.matrix {
            let mut row = vec![0.0; mu * c];
            for j in 0..mv {
                let old = &mut out[j * mu * c..][..mu * c];
                row.copy_from_slice(old);
                for i in 0..mu {
                    combine(&m[i * mu..][..mu], |k| &row[k * c..][..c], &mut old[i * c..][..c]);
                }
            }
        }
    }
    fn corners(&self, _part: usize, out: &mut Vec<f64>) {
        out.clear();
        (0..4).for_each(|corner| self.vars.push_linear(corner, out));
    }
    fn face(&self, _part: usize) -> u32 {
        0
    }
    fn part_bound(&self, _part: usize, _key: usize) -> Option<Bound> {
        None
    }
    fn trim(&self) -> Option<&Trim> {
        self.trim.as_ref()
    }
    fn dices_over(&self) -> bool {
        false
    }
}

/// Computes the weighted sum of rows of channels, in order. Weights of zero are left out, so that the sum does not
/// depend on the rows that they multiply.
fn combine<'a>(weights: &[f64], row: impl Fn(usize) -> &'a [f64], out: &mut [f64]) {
    out.fill(0.0);
    for (k, &w) in weights.iter().enumerate() {
        if w != 0.0 {
            for (o, x) in out.iter_mut().zip(row(k)) {
                *o += w * x;
            }
        }
    }
}
