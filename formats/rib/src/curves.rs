//! Curves.

use crate::basis::Basis;
use crate::declare::{Class, Given};
use crate::geometry::{ints, same, width};
use crate::options::string;
use crate::patches::{Side, by_rows};
use crate::primvars::{CURVES, Variable, params, variables};
use crate::reader::{Done, Fault, Reader};
use crate::request::Request;
use granita_base::{CurveBasis, Interp, ParamData, ShapeDesc};

/// Adjacent curves with the same number of vertices, which become one call.
struct Run {
    /// The basis of the request; `None` for linear curves.
    basis: Option<Basis>,
    /// The same basis in the scene interface; `None` for linear curves and for cubic curves that become Bezier curves.
    native: Option<CurveBasis>,
    /// The vertices and segments of each curve.
    side: Side,
    /// The number of curves.
    count: usize,
    first: First,
}

/// The indices of the first items of a run of curves.
#[derive(Clone, Copy, Default)]
struct First {
    curve: usize,
    vertex: usize,
    /// The index of the first value of a varying variable.
    varying: usize,
}

impl Run {
    /// Returns the number of vertices of each curve in the scene interface.
    fn nverts(&self) -> usize {
        match (self.basis, self.native) {
            (None, _) => self.side.n + usize::from(self.side.periodic),
            (Some(_), Some(_)) => self.side.n,
            (Some(_), None) => self.side.converted(),
        }
    }

    /// Returns the basis in the scene interface.
    fn shape_basis(&self) -> CurveBasis {
        match (self.basis, self.native) {
            (None, _) => CurveBasis::Linear,
            (_, Some(native)) => native,
            _ => CurveBasis::Bezier,
        }
    }

    /// Returns the part of a variable that belongs to these curves, as the scene interface takes it.
    fn part_of(&self, v: &Variable) -> Variable {
        let (side, count) = (self.side, self.count);
        let mut out = v.clone();
        let (first, each) = match v.interp {
            Interp::Vertex => (self.first.vertex, side.n),
            Interp::Linear => (self.first.varying, side.varying()),
            Interp::PerPiece => (self.first.curve, 1),
            Interp::Constant => return out,
        };
        out.data = v.picked(first..first + each * count);
        if v.interp == Interp::PerPiece {
            return out;
        }
        if self.basis.is_none() {
            // Linear curves interpolate both classes in the same way.
            let n_out = self.nverts();
            let places = (0..count).flat_map(|k| (0..n_out).map(move |i| k * each + i % each));
            let data = out.picked(places);
            return Variable { interp: Interp::Vertex, data, ..out };
        }
        if self.native.is_some() {
            return out;
        }
        let Some(values) = out.data.to_floats() else { return out };
        let width = v.width();
        let new = if v.interp == Interp::Vertex {
            by_rows(&values, each * width, |row| side.basis.converted(row, width, side.n, side.periodic))
        } else {
            by_rows(&values, each * width, |row| side.spread(row, width))
        };
        Variable { interp: Interp::Vertex, data: ParamData::Float(new.into()), ..out }
    }
}

impl Reader<'_> {
    pub(crate) fn curves(&mut self, request: &Request) -> Done {
        let kind = string(request, 0)?;
        let nverts = ints(request, 1)?;
        let periodic = &*string(request, 2)? == "periodic";
        let given = self.given(request, 3);
        let mut all = variables(&given, CURVES);
        if !all.iter().any(|v| &*v.name == "width") {
            all.push(width(1.0));
        }
        let basis = match &*kind {
            "linear" => None,
            "cubic" => Some(self.local.vbasis),
            other => return Err(Fault::Mistake(format!("there are no curves \"{other}\""))),
        };
        let sides = sides(&nverts, basis, periodic)?;
        check_items(&all, &sides)?;
        let varies = all.iter().any(|v| is_varying(v, &given));
        let mut first = First::default();
        while first.curve < sides.len() {
            let side = sides[first.curve];
            let count = sides[first.curve..].iter().take_while(|s| s.n == side.n).count();
            let bends = side.segments > 1 && varies;
            let native = basis.and_then(|b| b.native).filter(|_| !periodic && !bends);
            let run = Run { basis, native, side, count, first };
            let parts: Vec<Variable> = all.iter().map(|v| run.part_of(v)).collect();
            let shape = ShapeDesc::Curves { basis: run.shape_basis(), ncurves: count, nverts: run.nverts() };
            self.shape(shape, params(parts))?;
            first.vertex += side.n * count;
            first.varying += side.varying() * count;
            first.curve += count;
        }
        Ok(())
    }
}

/// Returns the vertices and segments of each curve. `basis` is `None` for linear curves.
fn sides(nverts: &[i32], basis: Option<Basis>, periodic: bool) -> Result<Vec<Side>, Fault> {
    let mut sides = Vec::with_capacity(nverts.len());
    for n in nverts {
        let n = usize::try_from(*n).unwrap_or(0);
        let segments = match basis {
            Some(basis) => basis.segments(n, periodic),
            None if n < 2 => None,
            None => Some(if periodic { n } else { n - 1 }),
        };
        let Some(segments) = segments else {
            return Err(Fault::Mistake(format!("{n} vertices make no whole curve")));
        };
        sides.push(Side { basis: basis.unwrap_or(Basis::BEZIER), n, periodic, segments });
    }
    Ok(sides)
}

/// Returns an error when a variable does not have as many items as the curves need.
fn check_items(all: &[Variable], sides: &[Side]) -> Done {
    let vertices: usize = sides.iter().map(|s| s.n).sum();
    let ends: usize = sides.iter().map(Side::varying).sum();
    for v in all {
        let want = match v.interp {
            Interp::Vertex => vertices,
            Interp::Linear => ends,
            Interp::PerPiece => sides.len(),
            Interp::Constant => continue,
        };
        if v.items() != want {
            let n = v.items();
            return Err(Fault::Mistake(format!("\"{}\" has {n} values where {want} are needed", v.name)));
        }
    }
    Ok(())
}

/// True when a variable of curves was declared to be varying.
fn is_varying(variable: &Variable, given: &[Given]) -> bool {
    given.iter().any(|g| {
        same(&g.name, &variable.name) && matches!(g.declared.class, Class::Varying | Class::FaceVarying)
    })
}
