//! The reference of the functions: signatures from the table of functions, with sentences, options and examples.
//!
//! The sentences and examples are in `help/*.txt`, in Markdown. A section begins with `# TITLE`, an entry with
//! `## NAME, NAME`. Lines `form: NAME NAME` give the names of the arguments of each overload, in the order of the
//! table. After the text comes one example, the body of a surface shader or a whole shader, between lines of three
//! backticks.

use crate::ast::Binary;
use crate::builtins::{self, Arg, Choice, NUMBERS, Rest, Ret, Signature, TypeSet};
use crate::ir::{Global, ShaderKind, ValueType};
use crate::overload::{arithmetic_type, casts, conversion};
use crate::{Func, access};

/// The texts, in the order of the manual, each with the name of its page.
const TEXTS: [(&str, &str); 2] =
    [("functions", include_str!("help/functions.txt")), ("functions-scene", include_str!("help/scene.txt"))];

/// The functions of a kind.
#[derive(Clone, Debug)]
pub struct Section {
    /// The page of the manual, without the extension of its file.
    pub page: &'static str,
    /// The title.
    pub title: &'static str,
    /// The paragraphs before the functions, in Markdown.
    pub intro: &'static str,
    /// The entries.
    pub entries: Vec<Entry>,
}

/// One or more functions (or statements) with the same arguments.
#[derive(Clone, Debug)]
pub struct Entry {
    /// The names.
    pub names: Vec<&'static str>,
    /// The declarations of all forms of all names, each with a note after it, which may be empty.
    pub forms: Vec<Form>,
    /// The description in Markdown.
    pub text: &'static str,
    /// The optional arguments.
    pub options: Vec<OptionalArgument>,
    /// The body of a surface shader, or a whole shader.
    pub example: &'static str,
    /// The lines of argument names that no form took. They are an error in the text.
    pub unused_forms: usize,
}

/// The declaration of one form.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Form {
    /// The declaration, such as `float atan (float y, float x)`.
    pub declaration: String,
    /// The implicit inputs, such as `reads P`.
    pub note: String,
}

/// An optional argument.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OptionalArgument {
    /// The name.
    pub name: &'static str,
    /// The type of the value.
    pub value: ValueType,
    /// The length of the value, when it is an array.
    pub array: Option<u32>,
    /// True when the function writes the value, which must be a variable.
    pub output: bool,
    /// The default value as text; empty when there is none.
    pub default: &'static str,
    /// The effect, in Markdown.
    pub help: &'static str,
}

impl From<&Choice> for OptionalArgument {
    fn from(c: &Choice) -> Self {
        let Choice { name, ty, array, output, default, help } = *c;
        Self { name, value: ty, array, output, default, help }
    }
}

impl OptionalArgument {
    /// Returns the type as it is declared, such as `output float` or `float[2]`.
    pub fn declaration(&self) -> String {
        let length = self.array.map_or_else(String::new, |n| format!("[{n}]"));
        format!("{}{}{length}", if self.output { "output " } else { "" }, self.value.word())
    }
}

/// Returns all sections in the order of the manual.
pub fn sections() -> Vec<Section> {
    TEXTS.iter().flat_map(|(page, text)| sections_of(page, text)).collect()
}

/// Returns the entry of a function or statement.
pub fn entry(name: &str) -> Option<Entry> {
    sections().into_iter().flat_map(|s| s.entries).find(|e| e.names.contains(&name))
}

/// Returns the name of the function or statement that is nearest to a word.
pub fn nearest(word: &str) -> Option<&'static str> {
    granita_base::suggestion(word, Func::ALL.iter().map(|f| f.word()).chain(STATEMENTS))
}

/// Returns the optional arguments of a function; none for functions without them.
pub fn options_of(func: Func) -> Vec<OptionalArgument> {
    let list = builtins::TABLE.iter().filter(|row| row.func == func).find_map(|row| match row.rest {
        Rest::Options(list) => Some(list),
        _ => None,
    });
    list.unwrap_or_default().iter().map(OptionalArgument::from).collect()
}

/// Returns the optional arguments of `trace`.
pub fn trace_options() -> Vec<OptionalArgument> {
    builtins::TRACE.iter().map(OptionalArgument::from).collect()
}

/// The types of values, in the order of the manual.
pub const TYPES: [ValueType; 7] = [
    ValueType::Float,
    ValueType::Color,
    ValueType::Point,
    ValueType::Vector,
    ValueType::Normal,
    ValueType::Matrix,
    ValueType::String,
];

/// Returns the type of `a + b` and similar operators (`+`, `-`, `*`, `/`); `None` where there is none.
pub fn result_of(operator: char, a: ValueType, b: ValueType) -> Option<ValueType> {
    let operator = match operator {
        '+' => Binary::Add,
        '-' => Binary::Sub,
        '*' => Binary::Mul,
        '/' => Binary::Div,
        _ => return None,
    };
    arithmetic_type(operator, a, b)
}

/// A conversion from one type to another.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Conversion {
    /// It needs no cast.
    Implicit,
    /// It needs a cast.
    Cast,
    /// There is none.
    Impossible,
}

/// Returns how a value of a type becomes one of another type.
pub fn conversion_of(from: ValueType, to: ValueType) -> Conversion {
    if conversion(from, to).is_some() {
        Conversion::Implicit
    } else if casts(from, to) {
        Conversion::Cast
    } else {
        Conversion::Impossible
    }
}

/// Returns the names of the mathematical constants with their values.
pub fn constants() -> impl Iterator<Item = (&'static str, f32)> {
    builtins::CONSTANTS.iter().copied()
}

/// Returns what a kind of shader may do with a global: "r", "rw", "loop" (it is read in `lights` only), or nothing.
pub fn access_of(kind: ShaderKind, global: Global) -> &'static str {
    let may_read = |in_lights| access::read(kind, global, in_lights).is_none();
    match (may_read(false), access::write(kind, global).is_none()) {
        (true, true) => "rw",
        (true, false) => "r",
        (false, _) if may_read(true) => "loop",
        _ => "",
    }
}

/// Returns the meaning of a global, in Markdown.
pub fn meaning_of(global: Global) -> &'static str {
    match global {
        Global::P => "The position of the point.",
        Global::I => {
            "The vector from the viewer, or the origin of the ray, to `P`; a fixed direction for a parallel view."
        }
        Global::N => "The normal for shading, as the primitive gives it. It may have any length.",
        Global::Ng => "The geometric normal of the surface.",
        Global::dPdu => "The derivative of `P` along `u`.",
        Global::dPdv => "The derivative of `P` along `v`.",
        Global::u => "The first parameter of the surface, usually from 0 to 1.",
        Global::v => "The second parameter of the surface, usually from 0 to 1.",
        Global::L => "The vector from the lit position to the light, of any length.",
        Global::Cl => "The colour of the light that arrives.",
        Global::Ps => "The position where light is gathered.",
        Global::Ns => "The axis about which light is gathered; the normal of the surface without one.",
        Global::Pl => "The position on the light.",
        Global::Nl => "The normal on the light, for lights with an area or an axis; otherwise 0.",
        Global::C => "The colour. It begins as that of the object and becomes the light towards the viewer.",
        Global::opacity => {
            "How much the surface hides in each channel, from 0 to 1. It begins as that of the object."
        }
        Global::time => "The time of the shaded grid, within the shutter.",
        Global::dtime => "The length of the shutter's interval; 0 for a still.",
        Global::dPdtime => "The change of `P` in one unit of time.",
    }
}

/// The statements that have an entry.
const STATEMENTS: [&str; 4] = ["lights", "emit", "trace", "exit"];

fn sections_of(page: &'static str, text: &'static str) -> Vec<Section> {
    let sections = text.trim_start_matches("# ").split("\n# ");
    sections
        .map(|section| {
            let (title, rest) = section.split_once('\n').unwrap_or((section, ""));
            let mut parts = rest.split("\n## ");
            let intro = parts.next().unwrap_or_default().trim();
            Section { page, title: title.trim(), intro, entries: parts.map(Entry::read).collect() }
        })
        .collect()
}

impl Entry {
    /// Reads an entry from the line with its names on.
    fn read(text: &'static str) -> Self {
        let (names, mut rest) = text.split_once('\n').unwrap_or((text, ""));
        let names: Vec<&str> = names.split(',').map(str::trim).collect();
        let mut arguments = Vec::new();
        while let Some(line) = rest.strip_prefix("form:") {
            let (line, after) = line.split_once('\n').unwrap_or((line, ""));
            arguments.push(line.split_whitespace().collect::<Vec<_>>());
            rest = after;
        }
        let (text, after) = rest.split_once("```\n").unwrap_or((rest, ""));
        let example = after.split_once("```").map_or(after, |(example, _)| example).trim_end();
        let mut forms = Vec::new();
        let mut unused_forms = 0;
        for name in &names {
            let declared = forms_of(name, &arguments);
            unused_forms += arguments.len().abs_diff(declared.len());
            forms.extend(declared);
        }
        let func = Func::ALL.iter().copied().find(|f| names.contains(&f.word()));
        let options = match func {
            Some(func) => options_of(func),
            None if names.contains(&"trace") => trace_options(),
            None => Vec::new(),
        };
        Self { names, forms, text: text.trim(), options, example, unused_forms }
    }

    /// Returns the first sentence of the description, in one line.
    pub fn summary(&self) -> String {
        let paragraph = self.text.split("\n\n").next().unwrap_or_default().replace('\n', " ");
        let end = paragraph.find(". ").map_or(paragraph.len(), |end| end + 1);
        paragraph[..end].to_owned()
    }

    /// Returns the sentence about the word `type` in the declarations; `None` when it does not occur.
    pub fn type_note(&self) -> Option<String> {
        let rows = self.names.iter().flat_map(|name| builtins::named(name));
        let mut note = None;
        for row in rows {
            if let Ret::Wanted(set) = row.ret {
                let words = listed(set);
                return Some(format!("`type` is the type that the context expects: {words}."));
            }
            let set = row.args.iter().find_map(|arg| match arg {
                Arg::Same(set) | Arg::SameArray(set) | Arg::Any(set) | Arg::OutAny(set) => {
                    (*set != builtins::ANY_VALUE).then_some(*set)
                }
                _ => None,
            });
            let set = set.or(matches!(row.rest, Rest::Same(_)).then_some(NUMBERS));
            note = note.or_else(|| set.map(|set| format!("`type` is {}.", listed(set))));
        }
        note
    }
}

/// Returns words as in "float, color or point".
fn listed(set: TypeSet) -> String {
    let words: Vec<&str> = set.iter().map(ValueType::word).collect();
    match words.split_last() {
        Some((last, rest)) if !rest.is_empty() => format!("{} or {last}", rest.join(", ")),
        _ => words.concat(),
    }
}

/// Returns the declarations of a function or statement with these names of arguments.
fn forms_of(name: &str, arguments: &[Vec<&str>]) -> Vec<Form> {
    let named = |k: usize| arguments.get(k).map_or(&[][..], Vec::as_slice);
    let statement = |forms: &[&[ValueType]], more: &str| {
        let form = |(k, types): (usize, &&[ValueType])| {
            let list: Vec<String> = types
                .iter()
                .zip(filled(named(k)))
                .map(|(ty, name)| format!("{} {name}", ty.word()))
                .collect();
            let declaration = format!("{name} ({}{more}) {{ ... }}", list.join(", "));
            Form { declaration, note: String::new() }
        };
        forms.iter().enumerate().map(form).collect()
    };
    match name {
        "lights" => statement(builtins::LIGHTS, ""),
        "emit" => statement(builtins::EMIT, ""),
        "trace" => statement(builtins::TRACES, ", ..."),
        "exit" => vec![Form { declaration: "void exit ()".to_owned(), note: String::new() }],
        _ => builtins::named(name).enumerate().map(|(k, row)| row.declared(named(k))).collect(),
    }
}

/// Returns names, followed by question marks for names that the text lacks.
fn filled<'n>(names: &'n [&'n str]) -> impl Iterator<Item = &'n str> {
    names.iter().copied().chain(std::iter::repeat("?"))
}

impl Signature {
    /// Returns its declaration with these names of the arguments.
    fn declared(&self, names: &[&str]) -> Form {
        let mut names = filled(names);
        let mut list: Vec<String> = Vec::new();
        for arg in self.args {
            let name = names.next().unwrap_or_default();
            list.push(match *arg {
                Arg::Is(ty) => format!("{} {name}", ty.word()),
                Arg::Any(set) if set == builtins::ANY_VALUE => format!("any {name}"),
                Arg::Same(_) | Arg::Any(_) => format!("type {name}"),
                Arg::Data => format!("any {name}"),
                Arg::Array => format!("any {name}[]"),
                Arg::SameArray(_) => format!("type {name}[]"),
                Arg::Out(ty) => format!("output {} {name}", ty.word()),
                Arg::OutAny(_) => format!("output type {name}"),
                Arg::OutData => format!("output any {name}"),
            });
        }
        match self.rest {
            Rest::Nothing => {}
            Rest::Same(n) => {
                let name = names.next().unwrap_or_default();
                list.extend((0..n).map(|k| format!("type {name}{k}")));
                list.push("...".to_owned());
            }
            Rest::Strings | Rest::Values | Rest::Options(_) => list.push("...".to_owned()),
        }
        let result = match self.ret {
            Ret::Is(ty) => ty.word(),
            Ret::Same | Ret::Wanted(_) => "type",
        };
        let declaration = format!("{result} {} ({})", self.func.word(), list.join(", "));
        Form { declaration, note: self.note() }
    }

    /// Returns its implicit inputs and effects.
    fn note(&self) -> String {
        let mut parts = Vec::new();
        if self.runs_lights {
            parts.push("runs the lights".to_owned());
        }
        if self.derivatives {
            parts.push("compares neighbouring points".to_owned());
        }
        for (verb, globals) in [("reads", self.reads), ("writes", self.writes)] {
            let words: Vec<&str> = globals.iter().map(|g| g.word()).collect();
            if !words.is_empty() {
                parts.push(format!("{verb} {}", words.join(" and ")));
            }
        }
        parts.join(", ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_function_has_one_entry_and_every_entry_its_functions() {
        let sections = sections();
        let names: Vec<&str> =
            sections.iter().flat_map(|s| &s.entries).flat_map(|e| e.names.iter().copied()).collect();
        let functions = Func::ALL.iter().filter(|f| **f != Func::Shadeop).map(|f| f.word());
        for name in functions.chain(STATEMENTS) {
            assert_eq!(names.iter().filter(|n| **n == name).count(), 1, "{name}");
        }
        assert_eq!(names.len(), Func::ALL.len() - 1 + STATEMENTS.len(), "{names:?}");
    }

    #[test]
    fn every_entry_is_complete() {
        for section in sections() {
            assert!(!section.title.is_empty() && !section.entries.is_empty(), "{}", section.title);
            for entry in section.entries {
                let Entry { names, forms, text, options, example, unused_forms } = &entry;
                assert!(text.ends_with(['.', '|']) && !example.is_empty(), "{names:?}: {text}");
                assert_eq!(*unused_forms, 0, "{names:?} has other forms");
                for form in forms {
                    assert!(!form.declaration.contains('?'), "{}", form.declaration);
                }
                for option in options {
                    assert!(option.help.ends_with('.'), "{names:?} \"{}\": {}", option.name, option.help);
                }
                assert!(entry.summary().ends_with('.'), "{names:?}: {}", entry.summary());
            }
        }
    }

    #[test]
    fn declarations_are_those_of_the_table() {
        let declared = |name: &str| -> Vec<String> {
            let entry = entry(name).unwrap();
            entry.forms.iter().map(|f| format!("{} [{}]", f.declaration, f.note)).collect()
        };
        assert_eq!(declared("atan"), ["float atan (float y, float x) []", "float atan (float slope) []"]);
        assert_eq!(
            declared("spline")[1],
            "type spline (string basis, float x, type y0, type y1, type y2, type y3, ...) []"
        );
        assert_eq!(declared("deltau")[1], "vector deltau (point x) [compares neighbouring points]");
        assert_eq!(
            declared("environment")[0],
            "type environment (string name, vector r, ...) [compares neighbouring points, reads P]"
        );
        assert_eq!(
            declared("getmessage"),
            ["float getmessage (string source, string name, output any value) []"]
        );
        assert_eq!(
            declared("trace"),
            ["trace (string set, point p, vector axis, float angle, float samples, ...) { ... } []"]
        );
        assert_eq!(
            entry("mix").unwrap().type_note().unwrap(),
            "`type` is float, color, point, vector, normal or matrix."
        );
        assert_eq!(
            entry("texture").unwrap().type_note().unwrap(),
            "`type` is the type that the context expects: float or color."
        );
        assert_eq!(entry("gridany").unwrap().type_note(), None);
        assert_eq!(nearest("smoothsetp"), Some("smoothstep"));
    }
}
