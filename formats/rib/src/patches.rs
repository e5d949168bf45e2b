//! Patches and NURBS.

use crate::basis::{Basis, linear_as_bezier};
use crate::declare::{Class, Declared, Given};
use crate::geometry::{int, ints};
use crate::options::string;
use crate::primvars::{PATCH, Variable, params, variables};
use crate::reader::{Done, Fault, Reader};
use crate::request::{Arg, Request};
use granita_base::shape::KnotSpan;
use granita_base::{BaseType, CurveBasis, Interp, ParamData, ShapeDesc, TrimDesc};
use granita_scene::Call;
use std::sync::Arc;

/// One direction of a patch mesh, or a curve.
#[derive(Clone, Copy)]
pub(crate) struct Side {
    pub(crate) basis: Basis,
    /// The number of vertices.
    pub(crate) n: usize,
    pub(crate) periodic: bool,
    pub(crate) segments: usize,
}

impl Side {
    /// Returns the number of values of a varying variable along this side.
    pub(crate) fn varying(&self) -> usize {
        if self.periodic { self.segments } else { self.segments + 1 }
    }

    /// Returns the number of control values after conversion.
    pub(crate) fn converted(&self) -> usize {
        3 * self.segments + 1
    }

    /// Converts items of `width` numbers at the ends of segments to Bezier control items.
    pub(crate) fn spread(&self, values: &[f32], width: usize) -> Vec<f32> {
        let mut values = values.to_vec();
        if self.periodic {
            values.extend_from_within(..width);
        }
        linear_as_bezier(&values, width)
    }
}

/// Applies `f` to every row of `row` numbers.
pub(crate) fn by_rows(values: &[f32], row: usize, f: impl Fn(&[f32]) -> Vec<f32>) -> Vec<f32> {
    values.chunks_exact(row.max(1)).flat_map(f).collect()
}

impl Reader<'_> {
    pub(crate) fn patch(&mut self, request: &Request) -> Done {
        let kind = string(request, 0)?;
        let n = if &*kind == "bilinear" { 2 } else { 4 };
        let given = self.patch_given(request, 1, &kind, [(n, false), (n, false)])?;
        let mut all = variables(&given, PATCH);
        self.corners(&mut all);
        match &*kind {
            "bilinear" => {
                let linear = CurveBasis::Linear;
                self.shape(ShapeDesc::Patch { u: linear, v: linear, nu: 2, nv: 2 }, params(all))
            }
            "bicubic" => {
                let side = |basis: Basis| Side { basis, n: 4, periodic: false, segments: 1 };
                self.bicubic(side(self.local.ubasis), side(self.local.vbasis), all)
            }
            other => Err(Fault::Mistake(format!("there is no patch \"{other}\""))),
        }
    }

    pub(crate) fn patch_mesh(&mut self, request: &Request) -> Done {
        let kind = string(request, 0)?;
        let (nu, uwrap) = (int(request, 1)?, string(request, 2)?);
        let (nv, vwrap) = (int(request, 3)?, string(request, 4)?);
        let (up, vp) = (&*uwrap == "periodic", &*vwrap == "periodic");
        let given = self.patch_given(request, 5, &kind, [(nu, up), (nv, vp)])?;
        let mut all = variables(&given, PATCH);
        self.corners(&mut all);
        check_counts(&all, nu, nv)?;
        match &*kind {
            "bilinear" => {
                // Varying values with one item per vertex are interpolated like the vertices.
                for variable in &mut all {
                    if variable.interp == Interp::Linear && variable.items() == nu * nv && nu * nv != 4 {
                        variable.interp = Interp::Vertex;
                    }
                    if variable.interp == Interp::Vertex && (up || vp) && variable.items() == nu * nv {
                        let (mu, mv) = (nu + usize::from(up), nv + usize::from(vp));
                        let places = (0..mu * mv).map(|k| (k / mu % nv) * nu + k % mu % nu);
                        variable.data = variable.picked(places);
                    }
                }
                let linear = CurveBasis::Linear;
                let (nu, nv) = (nu + usize::from(up), nv + usize::from(vp));
                self.shape(ShapeDesc::Patch { u: linear, v: linear, nu, nv }, params(all))
            }
            "bicubic" => {
                let side = |basis: Basis, n: usize, periodic: bool| {
                    let segments = basis.segments(n, periodic);
                    let segments = segments.ok_or_else(|| format!("{n} vertices make no whole patches"))?;
                    Ok::<_, String>(Side { basis, n, periodic, segments })
                };
                let u = side(self.local.ubasis, nu, up)?;
                let v = side(self.local.vbasis, nv, vp)?;
                self.bicubic(u, v, all)
            }
            other => Err(Fault::Mistake(format!("there is no patch mesh \"{other}\""))),
        }
    }

    /// Returns the parameter list of a patch. `sides` holds the number of vertices of each side, and true when the side
    /// is periodic. "Pz" becomes a height field, whose x and y are the surface's u and v.
    fn patch_given(
        &mut self,
        request: &Request,
        from: usize,
        kind: &str,
        sides: [(usize, bool); 2],
    ) -> Result<Vec<Given>, Fault> {
        let mut given = self.params(request, from);
        let Some(at) = given.iter().position(|g| &*g.name == "Pz") else { return Ok(given) };
        let heights = given[at].floats();
        let [(nu, _), (nv, _)] = sides;
        if nu.checked_mul(nv) != Some(heights.len()) {
            return Err(Fault::Mistake(format!("{} heights where {nu} x {nv} are needed", heights.len())));
        }
        let bases = [self.local.ubasis, self.local.vbasis];
        let along = |k: usize| -> Result<Vec<f64>, Fault> {
            let (n, periodic) = sides[k];
            if kind == "bilinear" {
                let segments = if periodic { n } else { n.saturating_sub(1) };
                return Ok((0..n).map(|i| i as f64 / segments.max(1) as f64).collect());
            }
            bases[k].segments(n, periodic).ok_or_else(|| format!("{n} vertices make no whole patches"))?;
            let values = bases[k].parameter(n, periodic);
            values.ok_or_else(|| Fault::Mistake("\"Pz\" in a basis that has no straight lines".to_owned()))
        };
        let (x, y) = (along(0)?, along(1)?);
        let points: Arc<[f32]> =
            heights.iter().enumerate().flat_map(|(i, z)| [x[i % nu] as f32, y[i / nu] as f32, *z]).collect();
        let declared = Declared { class: Class::Vertex, base: BaseType::Point, array: None };
        given[at] = Given { name: "P".into(), declared, data: ParamData::Float(points) };
        Ok(given)
    }

    /// Makes a cubic patch mesh. It keeps its bases where the scene interface supports them, and becomes Bezier patches
    /// otherwise.
    fn bicubic(&mut self, u: Side, v: Side, mut all: Vec<Variable>) -> Done {
        check_counts(&all, u.n, v.n)?;
        let many = u.segments * v.segments > 1;
        let spreads = |x: &Variable| many && x.interp == Interp::Linear && x.items() != 4;
        let periodic = u.periodic || v.periodic;
        if let (Some(ub), Some(vb), false) =
            (u.basis.native, v.basis.native, periodic || all.iter().any(spreads))
        {
            return self.shape(ShapeDesc::Patch { u: ub, v: vb, nu: u.n, nv: v.n }, params(all));
        }
        let (mu, mv) = (u.converted(), v.converted());
        for variable in &mut all {
            let width = variable.width();
            let Some(values) = variable.data.to_floats().filter(|_| variable.interp != Interp::Constant)
            else {
                variable.interp = Interp::Constant;
                continue;
            };
            let vertex = variable.interp == Interp::Vertex;
            let items = variable.items();
            let new = if vertex && items == u.n * v.n {
                let rows =
                    by_rows(&values, u.n * width, |row| u.basis.converted(row, width, u.n, u.periodic));
                v.basis.converted(&rows, mu * width, v.n, v.periodic)
            } else if !vertex && items == u.varying() * v.varying() && (many || periodic) {
                let rows = by_rows(&values, u.varying() * width, |row| u.spread(row, width));
                v.spread(&rows, mu * width)
            } else {
                continue;
            };
            variable.interp = Interp::Vertex;
            variable.data = ParamData::Float(new.into());
        }
        let bezier = CurveBasis::Bezier;
        self.shape(ShapeDesc::Patch { u: bezier, v: bezier, nu: mu, nv: mv }, params(all))
    }

    pub(crate) fn nu_patch(&mut self, request: &Request) -> Done {
        let span = |at: usize| -> Result<KnotSpan, Fault> {
            let (n, order) = (int(request, at)?, int(request, at + 1)?);
            let knots = request.args.get(at + 2).and_then(Arg::floats).unwrap_or_default();
            let end = |k: usize| request.args.get(at + k).and_then(|a| a.floats()?.first().copied());
            let (Some(min), Some(max)) = (end(3), end(4)) else {
                return Err(Fault::Mistake("needs n, order, knots, min and max twice".to_owned()));
            };
            if order < 1 || n < order || Some(knots.len()) != n.checked_add(order) {
                return Err(Fault::Mistake(format!(
                    "{n} vertices of order {order} with {} knots",
                    knots.len()
                )));
            }
            Ok(KnotSpan { n, order, knots, min, max })
        };
        let (u, v) = (span(0)?, span(5)?);
        let given = self.given(request, 10);
        let mut all = variables(&given, PATCH);
        self.corners(&mut all);
        // `su` and `sv` are the numbers of segment ends in u and v. The scene interface has values at the four corners.
        let (su, sv) = (u.n + 2 - u.order, v.n + 2 - v.order);
        for variable in &mut all {
            if variable.interp == Interp::Linear && variable.items() != 4 {
                if variable.items() == su * sv {
                    variable.data = variable.picked([0, su - 1, su * (sv - 1), su * sv - 1].into_iter());
                    self.once("NuPatch: of varying values only those at the corners are used".to_owned());
                } else if variable.items() == u.n * v.n {
                    variable.interp = Interp::Vertex;
                }
            }
        }
        self.shape(ShapeDesc::Nurbs { u, v }, params(all))
    }

    pub(crate) fn trim_curve(&mut self, request: &Request) -> Done {
        let floats = |at: usize| {
            let found = request.args.get(at).and_then(Arg::floats);
            found.ok_or_else(|| Fault::Mistake("needs ncurves, order, knot, min, max, n, u, v, w".to_owned()))
        };
        let (ncurves, order, n) = (ints(request, 0)?, ints(request, 1)?, ints(request, 5)?);
        let (knots, min, max) = (floats(2)?, floats(3)?, floats(4)?);
        let (u, v, w) = (floats(6)?, floats(7)?, floats(8)?);
        if u.len() != v.len() || u.len() != w.len() {
            return Err(Fault::Mistake(format!(
                "{}, {} and {} numbers of u, v and w",
                u.len(),
                v.len(),
                w.len()
            )));
        }
        let uvw: Arc<[f32]> =
            u.iter().zip(v.iter()).zip(w.iter()).flat_map(|((u, v), w)| [*u, *v, *w]).collect();
        let trim = TrimDesc { ncurves, n, order, knots, min, max, uvw };
        let none = trim.ncurves.is_empty();
        self.emit(Call::TrimCurve((!none).then(|| Box::new(trim))))
    }
}

/// Returns an error when the number of positions is not that of the request.
fn check_counts(all: &[Variable], nu: usize, nv: usize) -> Result<(), Fault> {
    let want = nu.checked_mul(nv).filter(|n| *n < 1 << 28).ok_or_else(|| format!("{nu} x {nv} vertices"))?;
    match all.iter().find(|v| matches!(&*v.name, "P" | "Pw")) {
        Some(p) if p.items() == want => Ok(()),
        Some(p) => Err(Fault::Mistake(format!("{} points where {nu} x {nv} are needed", p.items()))),
        None => Err(Fault::Mistake("no \"P\" or \"Pw\"".to_owned())),
    }
}
