//! The parameter query (reference chapter 15).

use crate::ir::{ConstValue, DefaultValue, Metadatum, Module, ShaderKind, SymbolType, ValueType};
use crate::{GslError, gso};
use std::sync::Arc;

/// One parameter, for programs outside of the renderer.
#[derive(Clone, Debug, PartialEq)]
pub struct Arg {
    /// Its name.
    pub name: Arc<str>,
    /// Its type. The length of an open array is that of its default.
    pub ty: SymbolType,
    /// True when it is declared `output`.
    pub is_output: bool,
    /// The default value; `None` when it is computed when the shader starts.
    pub default: Option<ArgDefault>,
    /// The metadata of the parameter.
    pub metadata: Vec<Metadatum>,
}

/// A default value.
#[derive(Clone, Debug, PartialEq)]
pub struct ArgDefault {
    /// The numbers or strings of all elements, one after the other.
    pub value: ConstValue,
    /// The spaces of the numbers, one for each element. It is the one in the source, else "rgb" or "common". Empty for
    /// floats and strings.
    pub spaces: Vec<Arc<str>>,
}

/// The interface of a compiled shader, available without running it.
#[derive(Clone, Debug, PartialEq)]
pub struct GsoArgs {
    kind: ShaderKind,
    name: Arc<str>,
    metadata: Vec<Metadatum>,
    args: Vec<Arg>,
}

impl GsoArgs {
    /// Reads the bytes of a `.gso` file without decoding its code. `file` names it in messages.
    ///
    /// # Errors
    /// Returns the errors of [`gso::read`].
    pub fn from_bytes(bytes: &[u8], file: &str) -> Result<Self, GslError> {
        Ok(Self::from_module(&gso::read_interface(bytes, file)?))
    }

    /// Returns the interface of a compiled module.
    pub fn from_module(module: &Module) -> Self {
        let args = module.params.iter().map(|param| {
            let symbol = module.symbol(param.symbol);
            let default = match &param.default {
                DefaultValue::Unknown => None,
                DefaultValue::Known { spaces, value } => {
                    let implied = match symbol.ty.value {
                        ValueType::Color => Some("rgb"),
                        ValueType::Point | ValueType::Vector | ValueType::Normal | ValueType::Matrix => {
                            Some("common")
                        }
                        _ => None,
                    };
                    let of = |k: usize| {
                        let written = if spaces.len() == 1 { spaces.first() } else { spaces.get(k) };
                        written.filter(|s| !s.is_empty()).cloned().or(implied.map(Arc::from))
                    };
                    let spaces = (0..symbol.ty.elements()).filter_map(of).collect();
                    Some(ArgDefault { value: value.clone(), spaces })
                }
            };
            Arg {
                name: symbol.name.clone(),
                ty: symbol.ty,
                is_output: param.output,
                default,
                metadata: param.metadata.clone(),
            }
        });
        Self {
            kind: module.kind,
            name: module.name.clone(),
            metadata: module.metadata.clone(),
            args: args.collect(),
        }
    }

    /// Returns "surface", "displacement", "volume", "light" or "shader".
    pub fn shadertype(&self) -> &'static str {
        self.kind.word()
    }

    /// Returns the name in the source.
    pub fn shadername(&self) -> &str {
        &self.name
    }

    /// Returns the parameters in the order of their declaration.
    pub fn args(&self) -> &[Arg] {
        &self.args
    }

    /// Returns the parameter called `name`.
    pub fn arg(&self, name: &str) -> Option<&Arg> {
        self.args.iter().find(|a| *a.name == *name)
    }

    /// Returns the metadata of the shader as a whole.
    pub fn metadata(&self) -> &[Metadatum] {
        &self.metadata
    }
}

// The text of `gsoinfo` (reference 8.3, listing 15.1) has a fixed form, because programs read it and split it at
// blanks. Words are separated by single blanks. Strings are in double quotes. Several numbers are in brackets with
// blanks inside of them. As in the listing, a blank follows the name of the shader, "nodefault" and strings.

impl GsoArgs {
    /// Returns the interface as text. With `verbose`, it also contains metadata and spaces.
    pub fn describe(&self, verbose: bool) -> String {
        let mut out = String::new();
        if verbose {
            out += &format!("{} \"{}\" \n", self.shadertype(), self.name);
            self.metadata.iter().for_each(|m| out += &metadatum(m));
        } else {
            out += &format!("{} {} \n", self.shadertype(), self.name);
        }
        for arg in &self.args {
            let output = if arg.is_output { "output " } else { "" };
            let ty = spell_type(&arg.ty);
            if !verbose {
                let values = match &arg.default {
                    Some(default) if arg.ty.value == ValueType::String => {
                        elements(arg.ty.value, &default.value).iter().map(|s| format!("{s} ")).collect()
                    }
                    Some(default) => elements(arg.ty.value, &default.value).join(" "),
                    None => "nodefault ".to_owned(),
                };
                out += &format!("{output}{ty} {} {values}\n", arg.name);
                continue;
            }
            out += &format!("  \"{}\" \"{output}{ty}\"\n", arg.name);
            match &arg.default {
                None => out += "      Unknown default value\n",
                Some(default) => {
                    for (k, value) in elements(arg.ty.value, &default.value).into_iter().enumerate() {
                        let space = default.spaces.get(k).map_or(String::new(), |s| quote(s) + " ");
                        out += &format!("      Default value: {space}{value}\n");
                    }
                }
            }
            arg.metadata.iter().for_each(|m| out += &metadatum(m));
        }
        out
    }
}

fn spell_type(ty: &SymbolType) -> String {
    match ty.array {
        Some(n) => format!("{}[{n}]", ty.value.word()),
        None => ty.value.word().to_owned(),
    }
}

fn metadatum(m: &Metadatum) -> String {
    let mut line = format!("      metadata: {} {} =", m.ty.word(), m.name);
    match &m.value {
        ConstValue::Floats(v) => v.iter().for_each(|x| line += &format!(" {}", number(*x))),
        ConstValue::Strings(v) => v.iter().for_each(|s| line += &format!(" {}", quote(s))),
    }
    line + "\n"
}

/// Returns one text per element.
fn elements(ty: ValueType, value: &ConstValue) -> Vec<String> {
    match value {
        ConstValue::Strings(v) => v.iter().map(|s| quote(s)).collect(),
        ConstValue::Floats(v) => v
            .chunks(ty.components().max(1))
            .map(|element| {
                let words: Vec<String> = element.iter().map(|x| number(*x)).collect();
                if words.len() > 1 { format!("[ {} ]", words.join(" ")) } else { words.join(" ") }
            })
            .collect(),
    }
}

fn quote(text: &str) -> String {
    let mut out = String::from("\"");
    for c in text.chars() {
        match c {
            '\n' => out += "\\n",
            '\r' => out += "\\r",
            '\t' => out += "\\t",
            '\\' => out += "\\\\",
            '"' => out += "\\\"",
            other => out.push(other),
        }
    }
    out.push('"');
    out
}

/// Returns a number with six significant digits, as C's `%g` prints it.
fn number(x: f32) -> String {
    if x.is_nan() {
        return "nan".to_owned();
    }
    if x.is_infinite() {
        return if x > 0.0 { "inf" } else { "-inf" }.to_owned();
    }
    if x == 0.0 {
        return if x.is_sign_negative() { "-0" } else { "0" }.to_owned();
    }
    let trim = |s: &str| match s.contains('.') {
        true => s.trim_end_matches('0').trim_end_matches('.').to_owned(),
        false => s.to_owned(),
    };
    let scientific = format!("{:.5e}", f64::from(x));
    let (digits, exponent) = scientific.split_once('e').unwrap_or((&scientific, "0"));
    let exponent: i32 = exponent.parse().unwrap_or(0);
    if !(-4..6).contains(&exponent) {
        let sign = if exponent < 0 { '-' } else { '+' };
        return format!("{}e{sign}{:02}", trim(digits), exponent.abs());
    }
    let decimals = (5 - exponent).max(0) as usize;
    trim(&format!("{:.decimals$}", f64::from(x)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{CompileOptions, compile};

    #[test]
    fn numbers_are_printed_like_c_does() {
        for (x, text) in [
            (1.0, "1"),
            (0.5, "0.5"),
            (-0.1, "-0.1"),
            (1.0e6, "1e+06"),
            (123_456.0, "123456"),
            (1_234_567.0, "1.23457e+06"),
            (0.0001, "0.0001"),
            (0.000_012_3, "1.23e-05"),
            (1.0 / 3.0, "0.333333"),
            (100.0, "100"),
            (0.0, "0"),
            (1e30, "1e+30"),
            (999_999.9, "1e+06"),
        ] {
            assert_eq!(number(x), text);
        }
    }

    const SOURCE: &str = r#"
        surface test [[ string description = "a \"test\"", float layer = 1 ]] (
            float a = 0.25 [[ float UImin = 0, color c = color (1, .5, 0) ]],
            color c = 1,
            point p = point ("shader", 1, 2, 3),
            vector w = vector (1, 0, -1),
            color h = color ("hsv", 0.5),
            string name = "x\ny",
            float list[] = { 1, 2, 3 },
            color two[2] = { 0, color (1, 2, 3) },
            matrix m = matrix ("world", 1),
            float s = u,
            float d = a / 2,
            float r = radians (30),
            output normal n = 0,
            float half = -1/2,
            point mixed[3] = { point ("world", 1, 2, 3), 0, point ("shader", 4) }
        ) { C = c; n = N; }"#;

    #[test]
    fn the_short_description_lists_parameters_and_defaults() {
        let args =
            GsoArgs::from_module(&compile(SOURCE, "t.gsl", &CompileOptions::default()).unwrap().module);
        assert_eq!(
            args.describe(false),
            "surface test \n\
             float a 0.25\n\
             color c [ 1 1 1 ]\n\
             point p [ 1 2 3 ]\n\
             vector w [ 1 0 -1 ]\n\
             color h [ 0.5 0.5 0.5 ]\n\
             string name \"x\\ny\" \n\
             float[3] list 1 2 3\n\
             color[2] two [ 0 0 0 ] [ 1 2 3 ]\n\
             matrix m [ 1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1 ]\n\
             float s nodefault \n\
             float d nodefault \n\
             float r nodefault \n\
             output normal n [ 0 0 0 ]\n\
             float half -0.5\n\
             point[3] mixed [ 1 2 3 ] [ 0 0 0 ] [ 4 4 4 ]\n"
        );
        assert_eq!((args.shadertype(), args.shadername(), args.args().len()), ("surface", "test", 15));
        assert!(args.arg("list").is_some_and(|a| a.ty.open && a.ty.array == Some(3)));
        assert!(args.arg("s").is_some_and(|a| a.default.is_none()));
        assert!(args.arg("no such").is_none());
    }

    #[test]
    fn the_verbose_description_lists_metadata() {
        let args =
            GsoArgs::from_module(&compile(SOURCE, "t.gsl", &CompileOptions::default()).unwrap().module);
        let text = args.describe(true);
        let start = "surface \"test\" \n\
            \x20     metadata: string description = \"a \\\"test\\\"\"\n\
            \x20     metadata: float layer = 1\n\
            \x20 \"a\" \"float\"\n\
            \x20     Default value: 0.25\n\
            \x20     metadata: float UImin = 0\n\
            \x20     metadata: color c = 1 0.5 0\n\
            \x20 \"c\" \"color\"\n\
            \x20     Default value: \"rgb\" [ 1 1 1 ]\n\
            \x20 \"p\" \"point\"\n\
            \x20     Default value: \"shader\" [ 1 2 3 ]\n\
            \x20 \"w\" \"vector\"\n\
            \x20     Default value: \"common\" [ 1 0 -1 ]\n\
            \x20 \"h\" \"color\"\n\
            \x20     Default value: \"hsv\" [ 0.5 0.5 0.5 ]\n\
            \x20 \"name\" \"string\"\n\
            \x20     Default value: \"x\\ny\"\n\
            \x20 \"list\" \"float[3]\"\n\
            \x20     Default value: 1\n\
            \x20     Default value: 2\n\
            \x20     Default value: 3\n";
        assert!(text.starts_with(start), "{text}");
        assert!(text.contains("  \"s\" \"float\"\n      Unknown default value\n"), "{text}");
        assert!(
            text.ends_with(
                "  \"mixed\" \"point[3]\"\n      Default value: \"world\" [ 1 2 3 ]\n      Default value: \"common\" [ 0 0 0 ]\n\
                 \x20     Default value: \"shader\" [ 4 4 4 ]\n"
            ),
            "{text}"
        );
        assert!(
            text.contains("  \"n\" \"output normal\"\n      Default value: \"common\" [ 0 0 0 ]\n"),
            "{text}"
        );
    }

    #[test]
    fn plastic_is_described_as_in_the_reference() {
        let source = granita_bundled::shader("plastic").unwrap();
        let args =
            GsoArgs::from_module(&compile(source, "plastic.gsl", &CompileOptions::default()).unwrap().module);
        assert_eq!(
            args.describe(false),
            "surface plastic \nfloat Ka 1\nfloat Kd 0.5\nfloat Ks 0.5\nfloat roughness 0.1\n\
             color specularcolor [ 1 1 1 ]\n"
        );
    }
}
