//! Converts a name and its arguments to a call of the scene interface (reference 3.3).

use crate::value::{Seq, Value};
use granita_base::shape::KnotSpan;
use granita_base::{BaseType, CurveBasis, Param, ParamData, ParamType, Params, ShapeDesc, TrimDesc};
use granita_scene::{Call, Matrix, TransformTarget};
use std::sync::Arc;

/// An error in the arguments of a call.
pub(crate) type Mistake = String;

/// The arguments of a call, which are taken from the front.
struct Args<'a> {
    call: &'a str,
    rest: std::vec::IntoIter<Value>,
}

impl Args<'_> {
    fn left(&self) -> usize {
        self.rest.len()
    }

    fn peek(&self) -> Option<&Value> {
        self.rest.as_slice().first()
    }

    fn next(&mut self, what: &str) -> Result<Value, Mistake> {
        self.rest.next().ok_or_else(|| format!("{} is called without {what}", self.call))
    }

    fn wants<T>(&self, what: &str, kind: &str) -> Result<T, Mistake> {
        Err(format!("{} wants {kind} for {what}", self.call))
    }

    fn string(&mut self, what: &str) -> Result<Arc<str>, Mistake> {
        match self.next(what)? {
            Value::Str(s) => Ok(s),
            // A tuple with one string results from a comma too many.
            Value::Seq(Seq::Strings(v)) if v.len() == 1 => Ok(v[0].clone()),
            _ => self.wants(what, "a string"),
        }
    }

    fn float(&mut self, what: &str) -> Result<f32, Mistake> {
        match self.next(what)? {
            Value::Int(i) => Ok(i as f32),
            Value::Float(f) => Ok(f as f32),
            _ => self.wants(what, "a number"),
        }
    }

    /// Takes a number of things, which is an integer and not negative.
    fn count(&mut self, what: &str) -> Result<usize, Mistake> {
        match self.next(what)? {
            Value::Int(i) if (0..=i64::from(i32::MAX)).contains(&i) => Ok(i as usize),
            Value::Float(f) if f >= 0.0 && f <= f64::from(i32::MAX) && f.fract() == 0.0 => Ok(f as usize),
            Value::Int(i) => Err(format!("{} wants a count for {what}, not {i}", self.call)),
            _ => self.wants(what, "an integer"),
        }
    }

    fn floats(&mut self, what: &str) -> Result<Vec<f32>, Mistake> {
        match self.next(what)? {
            Value::Seq(Seq::Floats(v)) => Ok(v),
            Value::Seq(Seq::Ints(v)) => Ok(v.iter().map(|&i| i as f32).collect()),
            Value::Int(i) => Ok(vec![i as f32]),
            Value::Float(f) => Ok(vec![f as f32]),
            _ => self.wants(what, "a sequence of numbers"),
        }
    }

    fn ints(&mut self, what: &str) -> Result<Vec<i32>, Mistake> {
        let whole = |f: f64| f.fract() == 0.0 && f.abs() < 2_147_483_648.0;
        match self.next(what)? {
            Value::Seq(Seq::Ints(v)) => Ok(v),
            Value::Seq(Seq::Floats(v)) if v.iter().all(|f| whole(f64::from(*f))) => {
                Ok(v.iter().map(|f| *f as i32).collect())
            }
            Value::Int(i) if i32::try_from(i).is_ok() => Ok(vec![i as i32]),
            Value::Float(f) if whole(f) => Ok(vec![f as i32]),
            _ => self.wants(what, "a sequence of integers"),
        }
    }

    /// Takes the remaining arguments as one list of numbers. They are separate numbers or sequences.
    fn numbers(&mut self, n: Option<usize>, what: &str) -> Result<Vec<f32>, Mistake> {
        let mut all = Vec::new();
        while self.left() > 0 {
            all.extend(self.floats(what)?);
        }
        match n {
            Some(n) if n != all.len() => {
                Err(format!("{} wants {n} numbers for {what}, not {}", self.call, all.len()))
            }
            _ => Ok(all),
        }
    }

    fn triple(&mut self, what: &str) -> Result<[f32; 3], Mistake> {
        let v = self.numbers(Some(3), what)?;
        Ok([v[0], v[1], v[2]])
    }

    fn matrix(&mut self) -> Result<Box<Matrix>, Mistake> {
        let v = self.numbers(Some(16), "the matrix")?;
        let mut m = [0.0; 16];
        m.copy_from_slice(&v);
        Ok(Box::new(m))
    }

    /// Takes all remaining arguments as alternating declarations and values.
    fn params(&mut self) -> Result<Params, Mistake> {
        let mut params = Params::new();
        while self.left() > 0 {
            let declaration = match self.next("a parameter")? {
                Value::Str(s) => s,
                _ => return Err(format!("{} wants the name of a parameter where a value stands", self.call)),
            };
            let Some(value) = self.rest.next() else {
                return Err(format!("{}: parameter \"{declaration}\" has no value", self.call));
            };
            let param = self.param(&declaration, value)?;
            // The later one of two parameters with one name is used. Lists are short.
            params.set(param);
        }
        Ok(params)
    }

    fn param(&self, declaration: &str, value: Value) -> Result<Param, Mistake> {
        let (ty, name) = ParamType::parse(declaration).map_err(|e| format!("{}: {e}", self.call))?;
        let data = data(value, ty).ok_or_else(|| format!("{}: \"{declaration}\" has no value", self.call))?;
        Ok(Param { name: name.into(), ty, data })
    }

    fn end(&self) -> Result<(), Mistake> {
        match self.left() {
            0 => Ok(()),
            n => Err(format!("{} has {n} arguments too many", self.call)),
        }
    }
}

/// Returns the data of a value. Integers become floats where floats are declared.
fn data(value: Value, ty: ParamType) -> Option<ParamData> {
    let floats = !matches!(ty.base, BaseType::Int | BaseType::String | BaseType::Unknown);
    Some(match value {
        Value::None => return None,
        Value::Int(i) if floats => ParamData::from(i as f32),
        Value::Int(i) => match i32::try_from(i) {
            Ok(i) => ParamData::from(i),
            Err(_) => ParamData::from(i as f32),
        },
        Value::Float(f) => ParamData::from(f as f32),
        Value::Str(s) => ParamData::String([s].into()),
        Value::Seq(Seq::Ints(v)) if floats => ParamData::Float(v.iter().map(|&i| i as f32).collect()),
        Value::Seq(Seq::Ints(v)) => ParamData::Int(v.into()),
        Value::Seq(Seq::Floats(v)) => ParamData::Float(v.into()),
        Value::Seq(Seq::Strings(v)) => ParamData::String(v.into()),
    })
}

/// Returns the call `name (args)`; `None` when no such call exists.
pub(crate) fn call(name: &str, args: Vec<Value>) -> Option<Result<Call, Mistake>> {
    if !crate::names::is_call(name) || name == "GetAttribute" {
        return None;
    }
    let mut args = Args { call: name, rest: args.into_iter() };
    Some(build(name, &mut args).and_then(|call| args.end().map(|()| call)))
}

fn build(name: &str, a: &mut Args) -> Result<Call, Mistake> {
    Ok(match name {
        "Parameter" => Call::Parameter(single(a)?),
        "Attribute" => Call::Attribute(single(a)?),
        "PushAttributes" => Call::PushAttributes,
        "PopAttributes" => Call::PopAttributes,
        "SaveAttributes" => {
            let name = a.string("the name")?;
            Call::SaveAttributes { name, attributes: optional(a)? }
        }
        "RestoreAttributes" => {
            let name = a.string("the name")?;
            Call::RestoreAttributes { name, attributes: optional(a)? }
        }
        "Modify" => Call::Modify { pattern: optional(a)?.unwrap_or_else(|| "".into()) },
        "PushTransform" => Call::PushTransform,
        "PopTransform" => Call::PopTransform,
        "SetTransform" => Call::SetTransform(match a.peek() {
            Some(Value::Str(_)) => TransformTarget::Named(a.string("the space")?),
            _ => TransformTarget::Matrix(a.matrix()?),
        }),
        "AppendTransform" => Call::AppendTransform(a.matrix()?),
        "Translate" => Call::Translate(a.triple("the translation")?),
        "Rotate" => Call::Rotate { angle_deg: a.float("the angle")?, axis: a.triple("the axis")? },
        "Scale" => Call::Scale(a.triple("the scale")?),
        "Motion" => Call::Motion(a.numbers(None, "the times")?.into()),
        "Camera" => Call::Camera { name: a.string("the name")?, params: a.params()? },
        "Output" => {
            let name = a.string("the file name")?;
            // The format `None` removes an output.
            let format = optional(a)?.unwrap_or_else(|| "null".into());
            let data = a.string("the data")?;
            let camera = a.string("the camera")?;
            Call::Output { name, format, data, camera, params: a.params()? }
        }
        "World" => Call::World,
        "Render" => Call::Render { camera: optional(a)? },
        "Command" => Call::Command { name: a.string("the command")?, params: a.params()? },
        "Comment" => Call::Comment(a.string("the text")?),
        "Shader" => {
            let usage = a.string("the usage")?;
            let name = optional(a)?;
            let layer = layer(a)?;
            Call::Shader { usage, name, layer, params: a.params()? }
        }
        "ShaderGroupBegin" => Call::ShaderGroupBegin,
        "ShaderGroupEnd" => Call::ShaderGroupEnd,
        "ConnectShaders" => Call::ConnectShaders {
            source_layer: a.string("the source layer")?,
            source: a.string("the source parameter")?,
            target_layer: a.string("the target layer")?,
            target: a.string("the target parameter")?,
        },
        "Light" => {
            let id = a.string("the light's id")?;
            let shader = optional(a)?.filter(|s| &**s != "null");
            let layer = layer(a)?;
            Call::Light { id, shader, layer, params: a.params()? }
        }
        "LightSwitch" => {
            let id = a.string("the light's id")?;
            Call::LightSwitch { id, on: a.float("on or off")? != 0.0 }
        }
        "TrimCurve" => trim(a)?,
        "Input" => {
            let command = a.string("the name")?;
            Call::Input { command, bound: bound(a)? }
        }
        _ => {
            let shape = Box::new(shape(name, a)?);
            Call::Shape { shape, params: a.params()? }
        }
    })
}

/// Takes a declaration and its value.
fn single(a: &mut Args) -> Result<Param, Mistake> {
    let declaration = a.string("the name")?;
    // Several adjacent numbers form a sequence.
    let value = if a.left() > 1 && !matches!(a.peek(), Some(Value::Str(_))) {
        Value::Seq(Seq::Floats(a.numbers(None, "the value")?))
    } else {
        a.next("a value")?
    };
    a.param(&declaration, value)
}

/// Takes the six numbers of the bound of an `Input` call, if there is one.
fn bound(a: &mut Args) -> Result<Option<[f32; 6]>, Mistake> {
    match a.peek() {
        None => Ok(None),
        Some(Value::None) => Ok(a.rest.next().and(None)),
        Some(_) => {
            let v = a.numbers(Some(6), "the bound")?;
            Ok(Some([v[0], v[1], v[2], v[3], v[4], v[5]]))
        }
    }
}

/// Takes a string; `None` for the value `None` and at the end of the arguments.
fn optional(a: &mut Args) -> Result<Option<Arc<str>>, Mistake> {
    match a.peek() {
        None => Ok(None),
        Some(Value::None) => {
            a.rest.next();
            Ok(None)
        }
        Some(_) => a.string("the argument").map(Some),
    }
}

/// Takes the name of a layer. It is before the parameters when the number of remaining arguments is odd.
fn layer(a: &mut Args) -> Result<Option<Arc<str>>, Mistake> {
    if a.left().is_multiple_of(2) {
        return Ok(None);
    }
    let layer = optional(a)?;
    // A type before a name belongs to a parameter.
    let typed = |l: &str| ParamType::parse(l).is_ok_and(|(ty, _)| ty.base != BaseType::Unknown);
    let declared = |l: &&Arc<str>| l.contains(' ') && typed(l);
    match layer.as_ref().filter(declared) {
        Some(parameter) => Err(format!("{}: \"{parameter}\" is given no value", a.call)),
        None => Ok(layer),
    }
}

fn basis(a: &Args, word: &str) -> Result<CurveBasis, Mistake> {
    CurveBasis::from_word(word.trim()).ok_or_else(|| unknown_basis(a, word))
}

fn unknown_basis(a: &Args, word: &str) -> Mistake {
    let words = ["linear", "bezier", "bspline", "catmull-rom"];
    let hint = crate::hint(granita_base::suggestion(word, words));
    format!("{}: unknown interpolation \"{word}\"{hint}", a.call)
}

fn span(a: &mut Args, n: usize) -> Result<KnotSpan, Mistake> {
    let order = a.count("the order")?;
    let knots: Arc<[f32]> = a.floats("the knots")?.into();
    if knots.len() != n + order {
        return Err(format!("{} has {} knots where {n} + {order} are needed", a.call, knots.len()));
    }
    Ok(KnotSpan { n, order, knots, min: a.float("the lower limit")?, max: a.float("the upper limit")? })
}

fn shape(name: &str, a: &mut Args) -> Result<ShapeDesc, Mistake> {
    Ok(match name {
        "Patch" => {
            if let Some(Value::Str(_)) = a.peek() {
                let interp = a.string("the interpolation")?;
                let (u, v) = CurveBasis::pair_from_words(&interp).map_err(|word| unknown_basis(a, word))?;
                ShapeDesc::Patch { u, v, nu: a.count("nu")?, nv: a.count("nv")? }
            } else {
                let nu = a.count("nu")?;
                let u = span(a, nu)?;
                let nv = a.count("nv")?;
                ShapeDesc::Nurbs { u, v: span(a, nv)? }
            }
        }
        "Mesh" => {
            let interp = a.string("the interpolation")?;
            let subdivide = match &*interp {
                "linear" => false,
                "catmull-clark" => true,
                _ => {
                    let hint = crate::hint(granita_base::suggestion(&interp, ["linear", "catmull-clark"]));
                    return Err(format!("Mesh: unknown interpolation \"{interp}\"{hint}"));
                }
            };
            let nverts: Arc<[i32]> = a.ints("nverts")?.into();
            let verts: Arc<[i32]> = a.ints("verts")?.into();
            let sum: i64 = nverts.iter().map(|n| i64::from(*n)).sum();
            if nverts.iter().any(|n| *n < 0) || sum != verts.len() as i64 {
                return Err(format!("Mesh has {} vertex indices where its faces have {sum}", verts.len()));
            }
            ShapeDesc::Mesh { subdivide, nverts, verts }
        }
        "Points" => ShapeDesc::Points { n: a.count("the number of points")? },
        "Curves" => {
            if let Some(Value::Str(_)) = a.peek() {
                let interp = a.string("the interpolation")?;
                let basis = basis(a, &interp)?;
                ShapeDesc::Curves { basis, ncurves: a.count("ncurves")?, nverts: a.count("nvertspercurve")? }
            } else {
                let ncurves = a.count("ncurves")?;
                let n = a.count("nvertspercurve")?;
                ShapeDesc::NurbsCurves { ncurves, span: span(a, n)? }
            }
        }
        "Sphere" => ShapeDesc::Sphere {
            radius: a.float("the radius")?,
            zmin: a.float("zmin")?,
            zmax: a.float("zmax")?,
            thetamax_deg: a.float("thetamax")?,
        },
        _ => return Err(format!("there is no primitive {name}")),
    })
}

/// Returns a `TrimCurve` call. Without loops (no arguments, or 0 or an empty sequence first), it turns trimming off.
fn trim(a: &mut Args) -> Result<Call, Mistake> {
    let off = match a.peek() {
        None | Some(Value::None | Value::Int(0)) => true,
        Some(Value::Seq(s)) => s.len() == 0,
        Some(_) => false,
    };
    if off {
        a.rest.by_ref().for_each(drop);
        return Ok(Call::TrimCurve(None));
    }
    Ok(Call::TrimCurve(Some(Box::new(TrimDesc {
        ncurves: a.ints("ncurves")?.into(),
        n: a.ints("n")?.into(),
        order: a.ints("order")?.into(),
        knots: a.floats("knot")?.into(),
        min: a.floats("min")?.into(),
        max: a.floats("max")?.into(),
        uvw: a.floats("uvw")?.into(),
    }))))
}
