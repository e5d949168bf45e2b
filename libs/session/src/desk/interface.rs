//! The parameters of light shaders, as controls: their types, defaults and ranges.

use super::rig::Layer;
use crate::shaders::Shaders;
use granita_base::{BaseType, Param, ParamData, ParamType, Reporter, SearchPath, Vec3};
use granita_gsl::ir::{ConstValue, EmitForm, Metadatum, Stmt, SymbolType, ValueType};
use granita_gsl::{Arg, GsoArgs};
use granita_plugin::Plugins;
use granita_render::{NoShader, ShaderLibrary};
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::sync::Arc;

/// How a light shader emits light.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Emission {
    /// Everywhere alike.
    Ambient,
    /// From the objects of a geometry set, which stay where they are.
    Geometry,
    /// From a position.
    Position {
        /// True when the direction matters.
        turns: bool,
    },
    /// Along a direction.
    Direction,
}

impl Emission {
    /// Returns the word for it in a panel.
    pub(crate) fn word(self) -> &'static str {
        match self {
            Self::Ambient => "ambient",
            Self::Geometry => "geometry",
            Self::Position { .. } => "position",
            Self::Direction => "direction",
        }
    }

    /// True when the direction matters.
    pub(crate) fn turns(self) -> bool {
        matches!(self, Self::Direction | Self::Position { turns: true })
    }
}

/// The interface of a light shader.
#[derive(Debug)]
pub(crate) struct Interface {
    pub(crate) args: GsoArgs,
    pub(crate) emission: Emission,
}

/// The interfaces of shaders that were needed so far.
pub(crate) struct Interfaces {
    path: SearchPath,
    plugins: Plugins,
    known: BTreeMap<Arc<str>, Result<Arc<Interface>, String>>,
}

impl Interfaces {
    /// Returns those in the folders of `path`.
    pub(crate) fn new(path: SearchPath, plugins: Plugins) -> Self {
        Self { path, plugins, known: BTreeMap::new() }
    }

    /// Returns the interface of a light shader.
    ///
    /// # Errors
    /// Returns a message when there is no such shader, when it does not compile, or when it is not a light.
    pub(crate) fn get(&mut self, shader: &str) -> Result<Arc<Interface>, String> {
        if let Some(known) = self.known.get(shader) {
            return known.clone();
        }
        let found = self.load(shader);
        // A shader that is missing or wrong may be corrected in the meantime.
        if found.is_ok() {
            self.known.insert(shader.into(), found.clone());
        }
        found
    }

    fn load(&self, shader: &str) -> Result<Arc<Interface>, String> {
        let (reporter, said) = Reporter::collecting();
        let shaders = Shaders::new(self.path.clone(), self.plugins.clone(), reporter);
        let module = shaders.load(shader).map_err(|error| match error {
            NoShader::Missing(where_) => format!("there is no shader \"{shader}\": {where_}"),
            NoShader::Broken => {
                let said: Vec<String> = said.lock().iter().map(ToString::to_string).collect();
                format!("shader \"{shader}\" cannot be used: {}", said.join("; "))
            }
        })?;
        let args = GsoArgs::from_module(&module);
        if args.shadertype() != "light" {
            return Err(format!("\"{shader}\" is a {} shader, not a light", args.shadertype()));
        }
        let emission = emission(&module.body).unwrap_or(Emission::Ambient);
        Ok(Arc::new(Interface { emission, args }))
    }
}

/// Returns how the code emits light; `None` without `emit`.
fn emission(code: &[Stmt]) -> Option<Emission> {
    code.iter().find_map(|statement| match statement {
        Stmt::Emit { form: EmitForm::Point(_), .. } => Some(Emission::Position { turns: false }),
        Stmt::Emit { form: EmitForm::Cone { .. }, .. } => Some(Emission::Position { turns: true }),
        Stmt::Emit { .. } => Some(Emission::Direction),
        Stmt::If { then, otherwise, .. } => emission(then).or_else(|| emission(otherwise)),
        Stmt::Loop { body, .. } | Stmt::Scope { body, .. } => emission(body),
        _ => None,
    })
}

impl Interface {
    /// Returns how a layer with this shader emits light.
    pub(crate) fn emission(&self, layer: &Layer) -> Emission {
        let has_geometry = || {
            let given = layer.params.string("geometry").is_some_and(|set| !set.is_empty());
            given && self.args.arg("geometry").is_some()
        };
        match self.emission {
            Emission::Position { .. } if has_geometry() => Emission::Geometry,
            // A light that shines from a point may still be shaped around an axis. Only the bundled one is not.
            Emission::Position { turns: false } if self.args.shadername() != "pointlight" => {
                Emission::Position { turns: true }
            }
            other => other,
        }
    }

    /// Returns the position of a light in "shader" space, and the direction in which it shines.
    pub(crate) fn frame(&self, layer: &Layer) -> (Vec3, Vec3) {
        let from = self.point(layer, "from").unwrap_or(Vec3::ZERO);
        let axis = self.point(layer, "to").map_or(Vec3::Z, |to| to - from);
        (from, axis)
    }

    fn point(&self, layer: &Layer, name: &str) -> Option<Vec3> {
        let arg = self.args.arg(name).filter(|arg| arg.ty == SymbolType::of(ValueType::Point))?;
        if let Some(values) = layer.params.floats(name) {
            return values.first_chunk::<3>().map(|v| Vec3::from(*v));
        }
        let default = arg.default.as_ref()?;
        let ConstValue::Floats(values) = &default.value else { return None };
        let p = values.first_chunk::<3>().map(|v| Vec3::from(*v))?;
        match default.spaces.first().map(|space| &**space) {
            Some("shader" | "object") | None => Some(p),
            _ => Some(layer.to_world.first().try_inverse()?.point(p)),
        }
    }

    /// Returns a typed parameter of the shader.
    ///
    /// # Errors
    /// Returns a message when the shader has no such parameter, or when the value does not have its type.
    pub(crate) fn param(&self, name: &str, value: &Value) -> Result<Param, String> {
        let names = self.args.args().iter().map(|arg| &*arg.name);
        let arg = self.args.arg(name).ok_or_else(|| {
            let hint = granita_base::suggestion(name, names);
            let hint = hint.map(|hint| format!("; did you mean \"{hint}\"?")).unwrap_or_default();
            format!("shader \"{}\" has no parameter \"{name}\"{hint}", self.args.shadername())
        })?;
        let data = data(&arg.ty, value)
            .ok_or_else(|| format!("\"{name}\" is a {}, and {value} is not", spelled(&arg.ty)))?;
        let limit = |name: &str| metadatum(arg, name).and_then(|v| v.as_f64()).map(|v| v as f32);
        if let (ParamData::Float(values), ValueType::Float) = (&data, arg.ty.value) {
            let (low, high) = (limit("UImin"), limit("UImax"));
            if let Some(low) = low.filter(|low| values.iter().any(|v| v < low)) {
                return Err(format!("\"{name}\" is at least {low}, and {value} is not"));
            }
            if let Some(high) = high.filter(|high| values.iter().any(|v| v > high)) {
                return Err(format!("\"{name}\" is at most {high}, and {value} is not"));
            }
        }
        let base = base(arg.ty.value).ok_or_else(|| format!("\"{name}\" has no value"))?;
        let count = data.len() / arg.ty.value.components().max(1);
        let ty = match arg.ty.array {
            Some(_) => ParamType::array(base, u32::try_from(count).unwrap_or(u32::MAX)),
            None => ParamType::of(base),
        };
        Ok(Param { name: arg.name.clone(), ty, data })
    }

    /// Returns the parameters of a layer as controls.
    pub(crate) fn controls(&self, layer: &Layer) -> Vec<Value> {
        let shown = self.args.args().iter().filter(|arg| !arg.is_output);
        shown.map(|arg| control(arg, layer.params.get(&arg.name))).collect()
    }
}

fn base(value: ValueType) -> Option<BaseType> {
    BaseType::from_word(value.word())
}

fn spelled(ty: &SymbolType) -> String {
    match ty.array {
        Some(n) => format!("{}[{n}]", ty.value.word()),
        None => ty.value.word().to_owned(),
    }
}

/// Reads a value of JSON: a number, a text, or a list of them. A single number is a grey colour.
fn data(ty: &SymbolType, value: &Value) -> Option<ParamData> {
    let elements = ty.array.unwrap_or(1) as usize;
    let fits = |count: usize, of_one: usize| {
        if ty.open { count.is_multiple_of(of_one) } else { count == elements * of_one }
    };
    if ty.value == ValueType::String {
        let texts: Vec<Arc<str>> = match value {
            Value::String(text) => vec![text.as_str().into()],
            Value::Array(list) => list.iter().map(|v| v.as_str().map(Arc::from)).collect::<Option<_>>()?,
            _ => return None,
        };
        let clean = texts.iter().all(|text| !text.contains('\0'));
        return (clean && fits(texts.len(), 1)).then(|| ParamData::String(texts.into()));
    }
    let number = |v: &Value| v.as_f64().map(|v| v as f32).filter(|v| v.is_finite());
    let numbers: Vec<f32> = match value {
        Value::Array(list) => list.iter().map(number).collect::<Option<_>>()?,
        Value::Bool(on) => vec![f32::from(u8::from(*on))],
        one => vec![number(one)?; if ty.value == ValueType::Color { 3 } else { 1 }],
    };
    fits(numbers.len(), ty.value.components()).then(|| ParamData::Float(numbers.into()))
}

/// Returns numbers or texts as JSON: one, or a list.
fn plain(data: &ParamData, single: bool) -> Value {
    let mut list: Vec<Value> = match data {
        ParamData::Float(v) => v.iter().map(|v| json!(v)).collect(),
        ParamData::Int(v) => v.iter().map(|v| json!(v)).collect(),
        ParamData::String(v) => v.iter().map(|v| json!(&**v)).collect(),
    };
    if single && list.len() == 1 { list.remove(0) } else { Value::Array(list) }
}

/// Returns one parameter as a control.
fn control(arg: &Arg, given: Option<&Param>) -> Value {
    let single = arg.ty.array.is_none() && arg.ty.value.components() == 1;
    let default = arg.default.as_ref().map(|default| match &default.value {
        ConstValue::Floats(v) => plain(&ParamData::Float(v.iter().copied().collect()), single),
        ConstValue::Strings(v) => plain(&ParamData::String(v.iter().cloned().collect()), single),
    });
    let value = given.map(|param| plain(&param.data, single)).or_else(|| default.clone());
    let mut control = json!({
        "name": &*arg.name, "type": spelled(&arg.ty), "value": value, "default": default,
        "set": given.is_some(),
    });
    for (word, name) in METADATA {
        if let Some(found) = metadatum(arg, name) {
            control[word] = found;
        }
    }
    control
}

/// The metadata of controls (reference 8.4.2): the word in a panel, and the name in shaders.
const METADATA: [(&str, &str); 13] = [
    ("min", "UImin"),
    ("max", "UImax"),
    ("softmin", "UIsoftmin"),
    ("softmax", "UIsoftmax"),
    ("step", "UIstep"),
    ("label", "UIlabel"),
    ("help", "description"),
    ("units", "units"),
    ("widget", "UItype"),
    ("enabler", "UIenabler"),
    ("separator", "UIseparator"),
    ("group", "UIgroupbegin"),
    ("groupend", "UIgroupend"),
];

/// Returns a metadatum of a parameter. The reference spells "UImin" also "Uimin".
fn metadatum(arg: &Arg, name: &str) -> Option<Value> {
    let found: &Metadatum = arg.metadata.iter().find(|m| m.name.eq_ignore_ascii_case(name))?;
    match &found.value {
        ConstValue::Floats(v) => v.first().map(|v| json!(v)),
        ConstValue::Strings(v) => v.first().map(|v| json!(&**v)),
    }
}
