//! Finds output variables that no shader of the scene computes.

use crate::ShaderLibrary;
use granita_base::{BaseType, Location, ParamType, Reporter, Severity, suggestion};
use granita_gsl::ir::{Global, Module};
use granita_scene::{Scene, ShaderGroup};
use granita_shading::DEFAULT_SURFACE;
use std::collections::BTreeSet;
use std::sync::Arc;

/// Warns about outputs of variables that are neither globals nor output parameters of a surface or volume shader of
/// the scene, nor variables of its primitives ("primitive:NAME"). Their images will be black. The message names the
/// most similar name, or the type of a parameter of that name.
///
/// Loads the shaders of the scene, as rendering will, but only when an output shows a variable.
pub(crate) fn report(scene: &Scene, library: &dyn ShaderLibrary, reporter: &Reporter) {
    let mut asked = Vec::new();
    for output in &scene.outputs {
        for data in output.layers().filter(|_| &*output.format != "null") {
            if let Ok((ty, name)) = ParamType::parse(data)
                && !matches!(data, "rgb" | "rgba" | "error" | "z" | "avgz" | "volz")
            {
                asked.push((output, data, ty, name));
            }
        }
    }
    asked.retain(|(_, _, ty, name)| !is_global(*ty, name));
    if asked.is_empty() || scene.primitives.is_empty() {
        return;
    }
    asked.retain(|(output, data, ty, name)| {
        let Some(own) = name.strip_prefix("primitive:") else { return true };
        if !is_of_primitives(scene, *ty, own) {
            let name = &output.name;
            let text = format!(
                "output \"{name}\": data \"{data}\": no primitive has the variable \"{ty} {own}\"; the image is black"
            );
            reporter.once(&text, Severity::Warning, &Location::default(), text.clone());
        }
        false
    });
    if asked.is_empty() {
        return;
    }
    let given = given(scene, library);
    for (output, data, ty, name) in asked {
        if given.iter().any(|g| g.name == *name && g.output && g.fits(ty)) {
            continue;
        }
        let of_name = given.iter().find(|g| g.name == *name);
        let why = match of_name {
            Some(g) if !g.output => {
                format!("\"{name}\" is a parameter of \"{}\", but not an output parameter", g.shader)
            }
            Some(g) => format!("\"{name}\" of \"{}\" is a {}", g.shader, g.ty),
            None => {
                let globals = Global::ALL.iter().map(|g| g.word());
                let names = given.iter().filter(|g| g.output).map(|g| g.name.as_str()).chain(globals);
                match suggestion(&name, names) {
                    Some(likely) => {
                        format!("no surface or volume shader computes it; did you mean \"{likely}\"?")
                    }
                    None => "no surface or volume shader computes it".to_owned(),
                }
            }
        };
        let text = format!("output \"{}\": data \"{data}\": {why}; the image is black", output.name);
        reporter.once(&text, Severity::Warning, &Location::default(), text.clone());
    }
}

/// True when a primitive has a variable of this name with numbers of this type, or when all have one.
fn is_of_primitives(scene: &Scene, ty: ParamType, name: &str) -> bool {
    let width = ty.width();
    if matches!((name, width), ("C" | "opacity", 3) | ("s" | "t", 1)) {
        return true;
    }
    let params = scene.primitives.iter().filter_map(|primitive| primitive.keys.first()?.params.get(name));
    params.into_iter().any(|param| param.ty.base != BaseType::String && param.ty.width() == width)
}

/// A parameter of a shader.
#[derive(Debug, PartialEq, Eq, PartialOrd, Ord)]
struct Given {
    name: String,
    /// The declared type, spelled as `color[2]`.
    ty: String,
    output: bool,
    shader: String,
}

impl Given {
    /// True when it can be shown as data of this type. Arrays of variable length match any length.
    fn fits(&self, ty: ParamType) -> bool {
        let wanted = ParamType { array: ty.array, ..ParamType::of(ty.base) }.to_string();
        let base = |text: &str| text.split('[').next().unwrap_or("").to_owned();
        self.ty == wanted || self.ty.ends_with("[]") && ty.array.is_some() && base(&self.ty) == base(&wanted)
    }
}

fn is_global(ty: ParamType, name: &str) -> bool {
    let components = match ty.base {
        BaseType::Float => 1,
        BaseType::Color | BaseType::Point | BaseType::Vector | BaseType::Normal => 3,
        _ => return false,
    };
    ty.array.is_none()
        && Global::ALL.iter().any(|g| g.word() == name && g.value_type().components() == components)
}

/// Returns the parameters of all surface and volume shaders of a scene.
fn given(scene: &Scene, library: &dyn ShaderLibrary) -> BTreeSet<Given> {
    let mut seen: BTreeSet<*const ShaderGroup> = BTreeSet::new();
    let mut names: BTreeSet<Arc<str>> = BTreeSet::new();
    for primitive in &scene.primitives {
        let set = &primitive.attributes;
        for group in [&set.surface, &set.volume].into_iter().flatten() {
            if seen.insert(Arc::as_ptr(group)) {
                names.extend(group.layers.iter().map(|layer| layer.shader.clone()));
            }
        }
        if set.surface.is_none() {
            names.insert(DEFAULT_SURFACE.into());
        }
    }
    let mut given = BTreeSet::new();
    for module in names.iter().filter_map(|name| library.load(name).ok()) {
        given.extend(parameters(&module));
    }
    given
}

fn parameters(module: &Module) -> impl Iterator<Item = Given> + '_ {
    module.params.iter().map(|param| {
        let symbol = module.symbol(param.symbol);
        let word = symbol.ty.value.word();
        let ty = match symbol.ty.array {
            None => word.to_owned(),
            Some(_) if symbol.ty.open => format!("{word}[]"),
            Some(n) => format!("{word}[{n}]"),
        };
        Given { name: symbol.name.to_string(), ty, output: param.output, shader: module.name.to_string() }
    })
}
