//! The variables of primitives. Classes of the RenderMan interface become those of the scene interface.

use crate::declare::{Class, Given};
use granita_base::{BaseType, Interp, Param, ParamData, ParamType, Params};
use std::sync::Arc;

/// The class in the scene interface of each class of the RenderMan interface, for a kind of primitives.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Classes {
    pub(crate) uniform: Interp,
    pub(crate) varying: Interp,
    pub(crate) facevarying: Interp,
}

/// The classes on patches, spheres and similar primitives.
pub(crate) const PATCH: Classes =
    Classes { uniform: Interp::Constant, varying: Interp::Linear, facevarying: Interp::Linear };
/// The classes on polygons.
pub(crate) const POLYGONS: Classes =
    Classes { uniform: Interp::PerPiece, varying: Interp::Vertex, facevarying: Interp::Linear };
/// The classes on points.
pub(crate) const POINTS: Classes =
    Classes { uniform: Interp::Constant, varying: Interp::Vertex, facevarying: Interp::Vertex };
/// The classes on curves.
pub(crate) const CURVES: Classes =
    Classes { uniform: Interp::PerPiece, varying: Interp::Linear, facevarying: Interp::Linear };

impl Classes {
    pub(crate) fn interp(self, class: Class) -> Interp {
        match class {
            Class::Constant => Interp::Constant,
            Class::Uniform => self.uniform,
            Class::Varying => self.varying,
            Class::Vertex => Interp::Vertex,
            Class::FaceVarying => self.facevarying,
        }
    }
}

/// A variable with its name, type, class and values.
#[derive(Clone, Debug)]
pub(crate) struct Variable {
    pub(crate) name: Arc<str>,
    pub(crate) base: BaseType,
    pub(crate) array: Option<u32>,
    pub(crate) interp: Interp,
    pub(crate) data: ParamData,
}

impl Variable {
    /// Returns the number of values of one item.
    pub(crate) fn width(&self) -> usize {
        ParamType { base: self.base, array: self.array, interp: self.interp }.width().max(1)
    }

    /// Returns the number of items.
    pub(crate) fn items(&self) -> usize {
        self.data.len() / self.width()
    }

    /// Converts the variable to a parameter. A constant keeps its first item.
    pub(crate) fn param(self) -> Param {
        let n = self.width();
        let data = match (self.interp, &self.data) {
            (Interp::Constant, ParamData::Float(v)) if v.len() > n => ParamData::Float(v[..n].into()),
            (Interp::Constant, ParamData::Int(v)) if v.len() > n => ParamData::Int(v[..n].into()),
            (Interp::Constant, ParamData::String(v)) if v.len() > n => ParamData::String(v[..n].into()),
            (_, data) => data.clone(),
        };
        let ty = ParamType { base: self.base, array: self.array, interp: self.interp };
        Param { name: self.name, ty, data }
    }

    /// Returns the items at these indices, which are in range.
    pub(crate) fn picked(&self, places: impl Iterator<Item = usize>) -> ParamData {
        let n = self.width();
        fn pick<T: Clone>(values: &[T], n: usize, places: impl Iterator<Item = usize>) -> Arc<[T]> {
            places.flat_map(|i| values.get(i * n..(i + 1) * n).unwrap_or_default().iter().cloned()).collect()
        }
        match &self.data {
            ParamData::Float(v) => ParamData::Float(pick(v, n, places)),
            ParamData::Int(v) => ParamData::Int(pick(v, n, places)),
            ParamData::String(v) => ParamData::String(pick(v, n, places)),
        }
    }
}

/// Returns the variables of a primitive, with their names in the scene interface.
pub(crate) fn variables(given: &[Given], classes: Classes) -> Vec<Variable> {
    let mut all: Vec<Variable> = Vec::with_capacity(given.len() + 1);
    for g in given {
        let mut variable = Variable {
            name: g.name.clone(),
            base: g.declared.base,
            array: g.declared.array,
            interp: classes.interp(g.declared.class),
            data: g.data.clone(),
        };
        match &*g.name {
            "Cs" => variable.name = "C".into(),
            "Os" => variable.name = "opacity".into(),
            "constantwidth" => variable.name = "width".into(),
            "Np" => variable.name = "N".into(),
            "st" if variable.width() == 2 => {
                let both = g.floats();
                for (name, at) in [("s", 0), ("t", 1)] {
                    let data: Arc<[f32]> = both.iter().skip(at).step_by(2).copied().collect();
                    all.push(Variable {
                        name: name.into(),
                        base: BaseType::Float,
                        array: None,
                        data: ParamData::Float(data),
                        ..variable.clone()
                    });
                }
                continue;
            }
            _ => (),
        }
        all.push(variable);
    }
    all
}

/// Converts all variables to parameters.
pub(crate) fn params(variables: Vec<Variable>) -> Params {
    variables.into_iter().map(Variable::param).collect()
}
