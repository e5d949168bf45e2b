//! Converts a name and its arguments to a call of the scene interface (reference 3.3), by the table of calls.

use crate::value::{Seq, Value};
use granita_base::shape::KnotSpan;
use granita_base::{BaseType, CurveBasis, Param, ParamData, ParamType, Params, ShapeDesc, TrimDesc};
use granita_scene::interface::{Arg, CallRow, Kind, call_row};
use granita_scene::{Call, Matrix, TransformTarget};
use std::sync::Arc;

/// An error in the arguments of a call.
pub(crate) type Mistake = String;

/// The arguments of a call, which are taken from the front. Their names and types are those of the call's row in
/// [`granita_scene::interface`].
struct Args {
    call: &'static str,
    form: std::slice::Iter<'static, Arg>,
    rest: std::vec::IntoIter<Value>,
}

impl Args {
    fn new(row: &'static CallRow, args: Vec<Value>) -> Self {
        let text = matches!(args.first(), Some(Value::Str(_)));
        Self { call: row.name, form: row.form(text).args.iter(), rest: args.into_iter() }
    }

    fn left(&self) -> usize {
        self.rest.len()
    }

    fn peek(&self) -> Option<&Value> {
        self.rest.as_slice().first()
    }

    /// Returns the next argument of the form, which the caller takes as a value of type `kind`.
    fn arg(&mut self, kind: Kind) -> &'static Arg {
        let arg = self.form.next();
        debug_assert_eq!(arg.map(|arg| arg.kind), Some(kind), "the table of calls, {}", self.call);
        arg.unwrap_or(&UNNAMED)
    }

    fn next(&mut self, what: &str) -> Result<Value, Mistake> {
        self.rest.next().ok_or_else(|| format!("{} is called without {what}", self.call))
    }

    fn wants<T>(&self, what: &str, kind: &str) -> Result<T, Mistake> {
        Err(format!("{} wants {kind} for {what}", self.call))
    }

    fn string(&mut self) -> Result<Arc<str>, Mistake> {
        let what = self.arg(Kind::Text).name;
        self.text(what)
    }

    /// Takes a string and returns it with the argument, whose words it may be.
    fn word(&mut self) -> Result<(Arc<str>, &'static Arg), Mistake> {
        let arg = self.arg(Kind::Text);
        Ok((self.text(arg.name)?, arg))
    }

    fn text(&mut self, what: &str) -> Result<Arc<str>, Mistake> {
        match self.next(what)? {
            Value::Str(s) => Ok(s),
            // A tuple with one string results from a comma too many.
            Value::Seq(Seq::Strings(v)) if v.len() == 1 => Ok(v[0].clone()),
            _ => self.wants(what, "a string"),
        }
    }

    /// Takes a string; `None` for the value `None` and at the end of the arguments.
    fn optional(&mut self) -> Result<Option<Arc<str>>, Mistake> {
        let what = self.arg(Kind::OptionalText).name;
        self.optional_text(what)
    }

    fn optional_text(&mut self, what: &str) -> Result<Option<Arc<str>>, Mistake> {
        match self.peek() {
            None => Ok(None),
            Some(Value::None) => {
                self.rest.next();
                Ok(None)
            }
            Some(_) => self.text(what).map(Some),
        }
    }

    /// Takes the name of a layer. It is before the parameters when the number of remaining arguments is odd.
    fn layer(&mut self) -> Result<Option<Arc<str>>, Mistake> {
        let what = self.arg(Kind::Layer).name;
        if self.left().is_multiple_of(2) {
            return Ok(None);
        }
        let layer = self.optional_text(what)?;
        // A type before a name belongs to a parameter.
        let typed = |l: &str| ParamType::parse(l).is_ok_and(|(ty, _)| ty.base != BaseType::Unknown);
        let declared = |l: &&Arc<str>| l.contains(' ') && typed(l);
        match layer.as_ref().filter(declared) {
            Some(parameter) => Err(format!("{}: \"{parameter}\" is given no value", self.call)),
            None => Ok(layer),
        }
    }

    fn float(&mut self) -> Result<f32, Mistake> {
        let what = self.arg(Kind::Number).name;
        self.number(what)
    }

    fn switch(&mut self) -> Result<bool, Mistake> {
        let what = self.arg(Kind::Switch).name;
        Ok(self.number(what)? != 0.0)
    }

    fn number(&mut self, what: &str) -> Result<f32, Mistake> {
        match self.next(what)? {
            Value::Int(i) => Ok(i as f32),
            Value::Float(f) => Ok(f as f32),
            _ => self.wants(what, "a number"),
        }
    }

    /// Takes a number of things, which is an integer and not negative.
    fn count(&mut self) -> Result<usize, Mistake> {
        let what = self.arg(Kind::Count).name;
        match self.next(what)? {
            Value::Int(i) if (0..=i64::from(i32::MAX)).contains(&i) => Ok(i as usize),
            Value::Float(f) if f >= 0.0 && f <= f64::from(i32::MAX) && f.fract() == 0.0 => Ok(f as usize),
            Value::Int(i) => Err(format!("{} wants a count for {what}, not {i}", self.call)),
            _ => self.wants(what, "an integer"),
        }
    }

    fn floats(&mut self) -> Result<Vec<f32>, Mistake> {
        let what = self.arg(Kind::Numbers).name;
        self.sequence(what)
    }

    fn sequence(&mut self, what: &str) -> Result<Vec<f32>, Mistake> {
        match self.next(what)? {
            Value::Seq(Seq::Floats(v)) => Ok(v),
            Value::Seq(Seq::Ints(v)) => Ok(v.iter().map(|&i| i as f32).collect()),
            Value::Int(i) => Ok(vec![i as f32]),
            Value::Float(f) => Ok(vec![f as f32]),
            _ => self.wants(what, "a sequence of numbers"),
        }
    }

    fn ints(&mut self) -> Result<Vec<i32>, Mistake> {
        let what = self.arg(Kind::Integers).name;
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
    fn numbers(&mut self, what: &str) -> Result<Vec<f32>, Mistake> {
        let mut all = Vec::new();
        while self.left() > 0 {
            all.extend(self.sequence(what)?);
        }
        Ok(all)
    }

    /// Takes the remaining arguments as `N` numbers. They are separate numbers or sequences.
    fn row<const N: usize>(&mut self, what: &str) -> Result<[f32; N], Mistake> {
        let all = self.numbers(what)?;
        let given = all.len();
        all.try_into().map_err(|_| format!("{} wants {N} numbers for {what}, not {given}", self.call))
    }

    fn triple(&mut self) -> Result<[f32; 3], Mistake> {
        let what = self.arg(Kind::Row(3)).name;
        self.row(what)
    }

    fn matrix(&mut self) -> Result<Box<Matrix>, Mistake> {
        let what = self.arg(Kind::Row(16)).name;
        self.row(what).map(Box::new)
    }

    /// Takes the six numbers of the bound of an `Input` call, if there is one.
    fn bound(&mut self) -> Result<Option<[f32; 6]>, Mistake> {
        let what = self.arg(Kind::OptionalRow(6)).name;
        match self.peek() {
            None => Ok(None),
            Some(Value::None) => Ok(self.rest.next().and(None)),
            Some(_) => self.row(what).map(Some),
        }
    }

    /// Takes a declaration and its value.
    fn single(&mut self) -> Result<Param, Mistake> {
        let name = self.arg(Kind::Declaration).name;
        let declaration = self.text(name)?;
        let what = self.arg(Kind::Value).name;
        // Several adjacent numbers form a sequence.
        let value = if self.left() > 1 && !matches!(self.peek(), Some(Value::Str(_))) {
            Value::Seq(Seq::Floats(self.numbers(what)?))
        } else {
            self.next(what)?
        };
        self.param(&declaration, value)
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

/// The argument that the table lacks. Tests find that before anyone reads its name.
const UNNAMED: Arg =
    Arg { name: "an argument", kind: Kind::Value, shape: "", default: "", range: "", words: &[], help: "" };

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
    let row = call_row(name).filter(|row| !row.is_query())?;
    let mut args = Args::new(row, args);
    Some(build(&mut args).and_then(|call| args.end().map(|()| call)))
}

fn build(a: &mut Args) -> Result<Call, Mistake> {
    Ok(match a.call {
        "Parameter" => Call::Parameter(a.single()?),
        "Attribute" => Call::Attribute(a.single()?),
        "PushAttributes" => Call::PushAttributes,
        "PopAttributes" => Call::PopAttributes,
        "SaveAttributes" => Call::SaveAttributes { name: a.string()?, attributes: a.optional()? },
        "RestoreAttributes" => Call::RestoreAttributes { name: a.string()?, attributes: a.optional()? },
        "Modify" => Call::Modify { pattern: a.optional()?.unwrap_or_else(|| "".into()) },
        "PushTransform" => Call::PushTransform,
        "PopTransform" => Call::PopTransform,
        "SetTransform" => Call::SetTransform(match a.peek() {
            Some(Value::Str(_)) => TransformTarget::Named(a.string()?),
            _ => TransformTarget::Matrix(a.matrix()?),
        }),
        "AppendTransform" => Call::AppendTransform(a.matrix()?),
        "Translate" => Call::Translate(a.triple()?),
        "Rotate" => Call::Rotate { angle_deg: a.float()?, axis: a.triple()? },
        "Scale" => Call::Scale(a.triple()?),
        "Motion" => {
            let what = a.arg(Kind::Rest).name;
            Call::Motion(a.numbers(what)?.into())
        }
        "Camera" => Call::Camera { name: a.string()?, params: a.params()? },
        "Output" => {
            let name = a.string()?;
            // The format `None` removes an output.
            let format = a.optional()?.unwrap_or_else(|| "null".into());
            Call::Output { name, format, data: a.string()?, camera: a.string()?, params: a.params()? }
        }
        "World" => Call::World,
        "Render" => Call::Render { camera: a.optional()? },
        "Command" => Call::Command { name: a.string()?, params: a.params()? },
        "Comment" => Call::Comment(a.string()?),
        "Shader" => {
            let (usage, name, layer) = (a.string()?, a.optional()?, a.layer()?);
            Call::Shader { usage, name, layer, params: a.params()? }
        }
        "ShaderGroupBegin" => Call::ShaderGroupBegin,
        "ShaderGroupEnd" => Call::ShaderGroupEnd,
        "ConnectShaders" => Call::ConnectShaders {
            source_layer: a.string()?,
            source: a.string()?,
            target_layer: a.string()?,
            target: a.string()?,
        },
        "Light" => {
            let id = a.string()?;
            let shader = a.optional()?.filter(|s| &**s != "null");
            let layer = a.layer()?;
            Call::Light { id, shader, layer, params: a.params()? }
        }
        "LightSwitch" => Call::LightSwitch { id: a.string()?, on: a.switch()? },
        "TrimCurve" => trim(a)?,
        "Input" => Call::Input { command: a.string()?, bound: a.bound()? },
        _ => {
            let shape = Box::new(shape(a)?);
            Call::Shape { shape, params: a.params()? }
        }
    })
}

/// Returns the error of a word that the argument does not accept.
fn unknown_word(a: &Args, arg: &Arg, word: &str) -> Mistake {
    let hint = crate::hint(granita_base::suggestion(word, arg.words.iter().copied()));
    format!("{}: unknown interpolation \"{word}\"{hint}", a.call)
}

/// Takes the rest of a direction of NURBS with `n` vertices.
fn span(a: &mut Args, n: usize) -> Result<KnotSpan, Mistake> {
    let order = a.count()?;
    let knots: Arc<[f32]> = a.floats()?.into();
    if knots.len() != n + order {
        return Err(format!("{} has {} knots where {n} + {order} are needed", a.call, knots.len()));
    }
    Ok(KnotSpan { n, order, knots, min: a.float()?, max: a.float()? })
}

fn shape(a: &mut Args) -> Result<ShapeDesc, Mistake> {
    let is_text = matches!(a.peek(), Some(Value::Str(_)));
    Ok(match a.call {
        "Patch" if is_text => {
            let (interp, arg) = a.word()?;
            let (u, v) = CurveBasis::pair_from_words(&interp).map_err(|word| unknown_word(a, arg, word))?;
            ShapeDesc::Patch { u, v, nu: a.count()?, nv: a.count()? }
        }
        "Patch" => {
            let nu = a.count()?;
            let u = span(a, nu)?;
            let nv = a.count()?;
            ShapeDesc::Nurbs { u, v: span(a, nv)? }
        }
        "Mesh" => {
            let (interp, arg) = a.word()?;
            let subdivide = match &*interp {
                "linear" => false,
                "catmull-clark" => true,
                _ => return Err(unknown_word(a, arg, &interp)),
            };
            let nverts: Arc<[i32]> = a.ints()?.into();
            let verts: Arc<[i32]> = a.ints()?.into();
            let sum: i64 = nverts.iter().map(|n| i64::from(*n)).sum();
            if nverts.iter().any(|n| *n < 0) || sum != verts.len() as i64 {
                return Err(format!("Mesh has {} vertex indices where its faces have {sum}", verts.len()));
            }
            ShapeDesc::Mesh { subdivide, nverts, verts }
        }
        "Points" => ShapeDesc::Points { n: a.count()? },
        "Curves" if is_text => {
            let (interp, arg) = a.word()?;
            let basis = CurveBasis::from_word(interp.trim()).ok_or_else(|| unknown_word(a, arg, &interp))?;
            ShapeDesc::Curves { basis, ncurves: a.count()?, nverts: a.count()? }
        }
        "Curves" => {
            let ncurves = a.count()?;
            let n = a.count()?;
            ShapeDesc::NurbsCurves { ncurves, span: span(a, n)? }
        }
        "Sphere" => ShapeDesc::Sphere {
            radius: a.float()?,
            zmin: a.float()?,
            zmax: a.float()?,
            thetamax_deg: a.float()?,
        },
        name => return Err(format!("there is no primitive {name}")),
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
        ncurves: a.ints()?.into(),
        n: a.ints()?.into(),
        order: a.ints()?.into(),
        knots: a.floats()?.into(),
        min: a.floats()?.into(),
        max: a.floats()?.into(),
        uvw: a.floats()?.into(),
    }))))
}
