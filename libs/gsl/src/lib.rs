//! The compiler of the shading language, from source text to checked IR and `.gso`, and the parameter query.
//!
//! [`compile`] has five stages. The preprocessor works on tokens and not on text, so that every token has its source
//! position. The parser makes the syntax tree (`ast`). It leaves out what it cannot parse, so that the rest is checked
//! as well. The checker resolves names and chooses overloads from the table of `builtins` (`hir`). Lowering inlines
//! functions and makes structured statements over typed symbols ([`ir`]). Validation makes a [`ValidModule`], the type
//! that linking takes. [`gso`] stores a module, and [`GsoArgs`] returns its parameters without the rest.
//!
//! This crate does not read files or the environment. Included files come from a loader of the caller. Every input is
//! bounded. Macros, nesting and the size of the result have limits, and exceeding one is an error with a position.
//! Optimisation is deliberately absent except for constants, because the executor processes whole grids.
//!
//! ```
//! use granita_gsl::{CompileOptions, compile};
//! let source = "surface red (float Kd = 0.5) { C = Kd * color (1, 0, 0); }";
//! let compiled = compile(source, "red.gsl", &CompileOptions::default()).unwrap();
//! assert_eq!(&*compiled.module.name, "red");
//! let mistake = compile("surface red () { C = colr; }", "red.gsl", &CompileOptions::default()).unwrap_err();
//! assert_eq!(mistake[0].at.to_string(), "red.gsl:1:22");
//! ```

#![forbid(unsafe_code)]

mod access;
mod args;
mod ast;
mod builtins;
mod check;
mod check_expr;
mod codec;
mod condition;
mod diagnostic;
mod error;
mod fold;
mod func;
pub mod gso;
pub mod help;
mod hir;
pub mod ir;
mod listing;
mod lost;
mod lower;
mod overload;
mod parse;
mod preprocess;
mod shadeop;
mod source;
mod token;
mod user_call;
mod valid;
mod validate;

pub use args::{Arg, ArgDefault, GsoArgs};
pub use builtins::{CONVERSIONS, Overload, overloads};
pub use diagnostic::Diagnostic;
pub use error::GslError;
pub use func::Func;
pub use ir::Module;
pub use shadeop::{ShadeopCall, ShadeopFinder, ShadeopForm};
pub use valid::ValidModule;

use std::io;

/// Returns the text of an included file; `None` when the file does not exist.
pub type Loader<'a> = &'a dyn Fn(&str) -> io::Result<Option<String>>;

/// The options of compilation.
#[derive(Clone, Copy, Default)]
pub struct CompileOptions<'a> {
    /// The folders that `#include` searches, in order.
    pub include_paths: &'a [String],
    /// Macros with name and value. The default value is 1.
    pub defines: &'a [(String, Option<String>)],
    /// Macros that are undefined after all definitions. `GELATO` is always defined before.
    pub undefines: &'a [String],
    /// Reads included files. Without it `#include` is an error.
    pub loader: Option<Loader<'a>>,
    /// Finds C++ functions. Without it there are none.
    pub shadeops: Option<ShadeopFinder<'a>>,
}

impl std::fmt::Debug for CompileOptions<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("CompileOptions")
            .field("include_paths", &self.include_paths)
            .field("defines", &self.defines)
            .field("undefines", &self.undefines)
            .field("loader", &self.loader.is_some())
            .field("shadeops", &self.shadeops.is_some())
            .finish()
    }
}

/// A shader without errors.
#[derive(Clone, Debug, PartialEq)]
pub struct Compiled {
    /// The shader.
    pub module: ValidModule,
    /// The warnings, in the order of the source.
    pub warnings: Vec<Diagnostic>,
}

/// Returns the forms of functions that are called and are neither built in nor words of the language.
fn called(
    tokens: &[token::Token],
    find: ShadeopFinder<'_>,
) -> Vec<(std::sync::Arc<str>, source::Pos, Vec<ShadeopForm>)> {
    let mut seen = std::collections::BTreeSet::new();
    let mut found = Vec::new();
    for pair in tokens.windows(2) {
        if let (token::TokenKind::Word(name), token::TokenKind::Mark("(")) = (&pair[0].kind, &pair[1].kind)
            && builtins::named(name).next().is_none()
            && !token::is_keyword(name)
            && seen.insert(name.clone())
        {
            let forms = find(name);
            if !forms.is_empty() {
                found.push((name.clone(), pair[0].pos, forms));
            }
        }
    }
    found
}

/// Compiles the shader in `source`.
///
/// `file` names it in messages, and included files are searched beside it. A file contains one shader and the
/// functions before it.
///
/// # Errors
/// Returns all errors and warnings, in the order of the source. At least one is an error.
pub fn compile(source: &str, file: &str, options: &CompileOptions<'_>) -> Result<Compiled, Vec<Diagnostic>> {
    let mut diags = diagnostic::Diagnostics::default();
    let Some(tokens) = preprocess::preprocess(source, file, options, &mut diags) else {
        return Err(diags.finish());
    };
    let file_tree = parse::parse(&tokens, &mut diags);
    let shadeops = options.shadeops.map(|find| called(&tokens, find)).unwrap_or_default();
    // What is permitted in a shader depends on what is around it.
    let is_placed = file_tree.shader.is_some() && !file_tree.lost.has_lost_braces();
    let shader = check::check(file_tree, &shadeops, &mut diags);
    if !is_placed {
        return Err(diags.finish());
    }
    let module = lower::lower(&shader, &mut diags);
    if diags.has_errors() {
        return Err(diags.finish());
    }
    match ValidModule::check(module, file) {
        Ok(module) => Ok(Compiled { module, warnings: diags.finish() }),
        Err(error) => {
            diags.error(source::Pos::default(), format!("{error}; this is a defect of the compiler"));
            Err(diags.finish())
        }
    }
}
