//! C++ functions that a table of their library declares (reference 14.1.3).

use crate::diagnostic::Diagnostics;
use crate::ir::{ConstValue, Module, SymbolId, SymbolKind, SymbolType, ValueType};
use crate::source::Pos;
use std::sync::Arc;

/// One overload of such a function, as its library declares it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ShadeopForm {
    /// The name of the library's file, without folder and extension.
    pub library: Arc<str>,
    /// The declaration, such as "color cube3 (color)". It has the result, the function in the library, and the
    /// arguments.
    pub declaration: String,
}

/// Returns the overloads of a function that the source does not define; none when no library has it.
pub type ShadeopFinder<'a> = &'a dyn Fn(&str) -> Vec<ShadeopForm>;

/// The function that an operation of `Func::Shadeop` calls, from the text of its first operand.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ShadeopCall<'a> {
    /// For each further operand, true when it is written.
    pub outputs: Vec<bool>,
    /// The name of the library's file, without folder and extension.
    pub library: &'a str,
    /// The name in the language.
    pub name: &'a str,
    /// The function in the library.
    pub function: &'a str,
}

impl<'a> ShadeopCall<'a> {
    /// Parses the text; `None` when it is not valid.
    pub fn parse(text: &'a str) -> Option<Self> {
        let mut words = text.split(' ');
        let (flags, library, name, function) = (words.next()?, words.next()?, words.next()?, words.next()?);
        let outputs = flags.strip_prefix('-')?.chars().map(|c| c == 'o').collect();
        words.next().is_none().then_some(Self { outputs, library, name, function })
    }

    /// Parses the first operand of an operation in a module.
    pub fn of(module: &'a Module, operand: Option<&SymbolId>) -> Option<Self> {
        match &module.symbols.get(operand?.0 as usize)?.kind {
            SymbolKind::Const(ConstValue::Strings(text)) => Self::parse(text.first()?),
            _ => None,
        }
    }
}

/// A parsed declaration.
pub(crate) struct Declared {
    pub(crate) ret: ValueType,
    pub(crate) formals: Vec<(SymbolType, bool)>,
    /// The text of the first operand, which [`ShadeopCall`] parses.
    pub(crate) text: Arc<str>,
}

/// Parses a declaration. Errors go to `diags`.
pub(crate) fn declared(
    name: &str,
    form: &ShadeopForm,
    pos: Pos,
    diags: &mut Diagnostics,
) -> Option<Declared> {
    let found = read(name, form);
    if found.is_none() {
        let what = format!(
            "`{name}` of the library {}: its declaration \"{}\" cannot be read",
            form.library, form.declaration
        );
        diags.error(pos, what);
    }
    found
}

fn read(name: &str, form: &ShadeopForm) -> Option<Declared> {
    let (head, rest) = form.declaration.trim().split_once('(')?;
    let list = rest.trim().strip_suffix(')')?;
    let mut words = head.split_whitespace();
    let (ret, function) = (value_type(words.next()?)?, words.next()?);
    let word = |s: &str| !s.is_empty() && s.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
    if words.next().is_some() || !word(function) {
        return None;
    }
    let mut formals = Vec::new();
    for item in list.split(',').map(str::trim).filter(|item| !item.is_empty() && *item != "void") {
        let (output, item) = match item.split_once(char::is_whitespace) {
            Some(("output", rest)) => (true, rest.trim()),
            _ => (false, item),
        };
        // A name may follow the type.
        let (base, length) = match item.split_once('[') {
            Some((base, rest)) => (base.trim(), Some(rest.split(']').next()?.trim().parse::<u32>().ok()?)),
            None => (item.split_whitespace().next()?, None),
        };
        let value = value_type(base).filter(|ty| *ty != ValueType::Void)?;
        formals.push((SymbolType { value, array: length, open: false }, output));
    }
    let flags: String = formals.iter().map(|(_, output)| if *output { 'o' } else { 'i' }).collect();
    let library: String = form.library.split_whitespace().collect();
    let text = format!("-{flags} {library} {name} {function}").into();
    Some(Declared { ret, formals, text })
}

fn value_type(word: &str) -> Option<ValueType> {
    use ValueType::{Color, Float, Matrix, Normal, Point, String, Vector, Void};
    [Void, Float, Color, Point, Vector, Normal, Matrix, String].into_iter().find(|ty| ty.word() == word)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn form(declaration: &str) -> ShadeopForm {
        ShadeopForm { library: "lib".into(), declaration: declaration.to_owned() }
    }

    #[test]
    fn shadeop_declarations_of_the_reference_are_read() {
        for (text, ret, flags) in [
            ("float foo (float)", ValueType::Float, "-i"),
            ("vector bar (float, point, string)", ValueType::Vector, "-iii"),
            ("void procedure (float, output float)", ValueType::Void, "-io"),
            ("  color   c3( output  float[3] list ,color c )", ValueType::Color, "-oi"),
            ("float none ()", ValueType::Float, "-"),
        ] {
            let found = read("op", &form(text)).unwrap_or_else(|| panic!("{text}"));
            assert_eq!(found.ret, ret);
            assert!(found.text.starts_with(&format!("{flags} lib op ")), "{}", found.text);
            let call = ShadeopCall::parse(&found.text).unwrap();
            assert_eq!((call.library, call.name, call.outputs.len()), ("lib", "op", found.formals.len()));
        }
        for bad in [
            "",
            "float foo",
            "foo (float)",
            "float foo bar (float)",
            "quux foo ()",
            "float foo (void*)",
            "float foo (float[x])",
        ] {
            assert!(read("op", &form(bad)).is_none(), "{bad}");
        }
        for bad in ["", "-i lib op", "i lib op f", "-i lib op f g"] {
            assert!(ShadeopCall::parse(bad).is_none(), "{bad}");
        }
    }
}
