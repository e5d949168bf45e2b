//! Geometric primitives and trim curves (reference 2.8).

use super::attributes::typed;
use super::current::Edit;
use super::{Phase, State};
use crate::interface::VARIABLES;
use crate::{AttributeSet, Primitive, ShapeKey};
use granita_base::{
    BaseType, Interp, Location, Param, ParamData, ParamType, Params, Severity, ShapeDesc, TrimDesc,
};
use std::sync::Arc;

/// Returns the type of an undeclared parameter of a primitive (reference 2.1.5, 2.8). Arrays of length 0 are as long
/// as their data.
pub fn predeclared(name: &str) -> Option<ParamType> {
    VARIABLES.iter().find(|row| row.name == name).map(|row| row.ty)
}

/// True for the parameters of a shape that are integers whatever type they are declared with. On other shapes,
/// variables may have the same names.
fn is_read_as_integers(shape: &ShapeDesc, name: &str) -> bool {
    let ShapeDesc::Mesh { subdivide, .. } = shape else { return false };
    (*subdivide || name == "holes") && predeclared(name).is_some_and(|ty| ty.base == BaseType::Int)
}

/// The largest coordinate of a vertex, in object space units. Squares of larger ones overflow.
const FARTHEST: f32 = 1e20;

impl State {
    /// Adds a geometric primitive, alone or in a motion block.
    pub(super) fn shape(&mut self, shape: ShapeDesc, params: Params, at: &Location) {
        let params = self.take_params(params);
        if self.refuses(shape.call_name(), "geometry cannot be added", at) {
            return self.drop_motion(at);
        }
        if self.group.is_some() {
            return self.out_of_place(at, shape.call_name(), "inside a shader group");
        }
        let places = |params: &Params| params.get("P").or(params.get("Pw")).is_some();
        let placed = places(&params);
        let params = self.shape_params(&shape, params, at);
        if placed && !places(&params) {
            // The error is reported with its positions.
            return;
        }
        if self.motion.is_some() {
            // A primitive that does not fit the block is added by itself.
            if let Some((shape, params)) = self.motion_shape(shape, params, at) {
                self.add_primitive(shape, vec![ShapeKey { time: 0.0, params }], at);
            }
            return;
        }
        self.add_primitive(shape, vec![ShapeKey { time: 0.0, params }], at);
    }

    /// Stores the primitive, unless its positions are unusable.
    pub(super) fn add_primitive(&mut self, shape: ShapeDesc, keys: Vec<ShapeKey>, at: &Location) {
        let call = shape.call_name();
        if !matches!(shape, ShapeDesc::Sphere { .. }) {
            let has = |k: &ShapeKey, name: &str| k.params.get(name).is_some();
            if keys.iter().any(|k| !has(k, "P") && !has(k, "Pw")) {
                let text = format!("{call} without \"P\" or \"Pw\"");
                return self.report_object(Severity::Error, at, "no P", text);
            }
        }
        for key in &keys {
            for name in ["P", "Pw"] {
                let Some(param) = key.params.get(name) else { continue };
                let ParamData::Float(values) = &param.data else { continue };
                if let Some(bad) = values.iter().position(|x| x.is_nan() || x.abs() > FARTHEST) {
                    let width = param.ty.width().max(1);
                    let why = if values[bad].is_finite() { ", farther than 1e20" } else { "" };
                    let text =
                        format!("{call}: \"{name}\" of vertex {} is {:?}{why}", bad / width, values[bad]);
                    return self.report_object(Severity::Error, at, "NaN", text);
                }
            }
        }
        if let Some(parts) = self.face_parts(&shape, &keys, at) {
            for part in parts {
                self.push_primitive(shape.clone(), part.keys, part.attributes, at);
            }
            return;
        }
        let camera = self.shading_camera();
        let attributes = self.current.freeze(camera.as_ref());
        self.modify_also(&attributes);
        self.push_primitive(shape, keys, attributes, at);
    }

    fn push_primitive(
        &mut self,
        shape: ShapeDesc,
        keys: Vec<ShapeKey>,
        attributes: Arc<AttributeSet>,
        at: &Location,
    ) {
        let id = identity(&shape, &keys, &attributes);
        let primitive = Arc::new(Primitive { id, shape, keys, attributes, at: at.clone() });
        match self.phase {
            Phase::Options => self.early.push(primitive),
            _ => self.primitives.push(primitive),
        }
    }

    /// Returns the parameters with resolved types and converted data. Unusable ones are reported and left out.
    fn shape_params(&self, shape: &ShapeDesc, params: Params, at: &Location) -> Params {
        let call = shape.call_name();
        let vertices = params.get("P").map(|p| p.data.len() / 3);
        let vertices = vertices.or_else(|| params.get("Pw").map(|p| p.data.len() / 4)).unwrap_or(0);
        let mut good = Vec::with_capacity(params.0.len());
        for mut param in params.0 {
            if param.ty.base == BaseType::Unknown {
                let Some(ty) = predeclared(&param.name) else {
                    let text =
                        format!("{call}: parameter \"{0}\" needs a type, as in \"float {0}\"", param.name);
                    self.report_object(Severity::Error, at, "shape parameter", text);
                    continue;
                };
                let interp = if param.ty.interp == Interp::Constant { ty.interp } else { param.ty.interp };
                param.ty = ty.with_interp(interp);
                spread(&mut param, vertices);
            } else if matches!(&*param.name, "P" | "Pw") && param.ty.interp != Interp::Vertex {
                param.ty.interp = Interp::Vertex;
            }
            if param.ty.base == BaseType::Float && is_read_as_integers(shape, &param.name) {
                param.ty.base = BaseType::Int;
            }
            match typed(&param) {
                Ok(param) => good.push(param),
                Err(text) => {
                    let rest = if matches!(&*param.name, "P" | "Pw") { ": the call is ignored" } else { "" };
                    let text = format!("{call}: {text}{rest}");
                    self.report_object(Severity::Error, at, "shape parameter", text);
                }
            }
        }
        Params(good)
    }

    /// Handles `TrimCurve`.
    pub(super) fn trim_curve(&mut self, trim: Option<Box<TrimDesc>>, at: &Location) {
        if let Some(trim) = &trim
            && let Some(why) = trim_mistake(trim)
        {
            return self.report_object(Severity::Error, at, "TrimCurve", format!("TrimCurve: {why}"));
        }
        let trim = trim.filter(|t| !t.ncurves.is_empty()).map(|t| Arc::new(*t));
        self.edit_sets(Edit::Call("TrimCurve", at), |set| set.trim.clone_from(&trim));
    }
}

/// Returns a number that depends only on the kind, the place and (the beginning of) the positions of a primitive.
fn identity(shape: &ShapeDesc, keys: &[ShapeKey], attributes: &AttributeSet) -> u32 {
    /// The largest number of words that are hashed. Primitives that agree in all of them may have the same number.
    const MOST: usize = 256;
    let mut words: Vec<u32> = Vec::with_capacity(64);
    words.extend(shape.call_name().bytes().map(u32::from));
    if let ShapeDesc::Sphere { radius, zmin, zmax, thetamax_deg } = shape {
        words.extend([radius, zmin, zmax, thetamax_deg].map(|x| x.to_bits()));
    }
    words.extend(attributes.to_world.first().to_rows().map(f32::to_bits));
    for name in ["P", "Pw"] {
        let Some(ParamData::Float(values)) = keys.first().and_then(|k| Some(&k.params.get(name)?.data))
        else {
            continue;
        };
        words.push(values.len() as u32);
        words.extend(values.iter().take(MOST).map(|x| x.to_bits()));
    }
    granita_base::hash::words(&words)
}

/// Determines the interpolation (or array length) of a pre-declared parameter from its number of values.
fn spread(param: &mut Param, vertices: usize) {
    if param.ty.array == Some(0) {
        param.ty.array = Some(param.data.len() as u32);
        return;
    }
    let width = param.ty.width().max(1);
    if param.ty.interp == Interp::Constant && param.data.len() > width {
        let items = param.data.len() / width;
        param.ty.interp = if items == vertices { Interp::Vertex } else { Interp::Linear };
    }
}

/// Returns the error in the counts of a trim curve, if there is one.
fn trim_mistake(trim: &TrimDesc) -> Option<String> {
    if trim.ncurves.is_empty() {
        return None;
    }
    if let Some(n) = trim.ncurves.iter().find(|n| **n < 1) {
        return Some(format!("a loop of {n} curves"));
    }
    let curves: i64 = trim.ncurves.iter().map(|n| i64::from(*n)).sum();
    let lengths =
        [("n", trim.n.len()), ("order", trim.order.len()), ("min", trim.min.len()), ("max", trim.max.len())];
    if let Some((name, len)) = lengths.into_iter().find(|(_, len)| *len as i64 != curves) {
        return Some(format!("{curves} curves, but {len} values of {name}"));
    }
    if let Some((n, order)) = trim.n.iter().zip(trim.order.iter()).find(|(n, o)| **o < 2 || **n < **o) {
        return Some(format!("a curve with {n} points of order {order}"));
    }
    let points: i64 = trim.n.iter().map(|n| i64::from(*n)).sum();
    let orders: i64 = trim.order.iter().map(|n| i64::from(*n)).sum();
    if trim.knots.len() as i64 != points + orders {
        return Some(format!("{} knots where {} are needed", trim.knots.len(), points + orders));
    }
    if trim.uvw.len() as i64 != points * 3 {
        return Some(format!("{} numbers of uvw where {} are needed", trim.uvw.len(), points * 3));
    }
    let finite =
        [&trim.knots, &trim.min, &trim.max, &trim.uvw].iter().all(|v| v.iter().all(|x| x.is_finite()));
    (!finite).then(|| "numbers that are not finite".to_owned())
}
