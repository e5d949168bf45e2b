//! The shader compiler: `name.gsl` to `name.gso` (reference 8.2).

#![forbid(unsafe_code)]

use clap::Parser;
use granita_base::Severity;
use granita_cli::{Status, parse};
use granita_gsl::{CompileOptions, Diagnostic, compile, gso};
use std::ffi::OsString;
use std::io::{self, Write};
use std::path::Path;

/// Compiles a shader.
///
/// The compiled shader goes to SHADERNAME.gso in the current folder.
#[derive(Parser, Debug)]
#[command(name = "gslc")]
struct Options {
    /// Source file; "-" reads standard input
    #[arg(value_name = "SOURCE")]
    source: String,

    /// Look for included files in this folder too; may be given several times
    #[arg(short = 'I', value_name = "PATH")]
    include: Vec<String>,

    /// Define a macro; without a value it is 1
    #[arg(short = 'D', value_name = "SYMBOL[=VALUE]")]
    define: Vec<String>,

    /// Do not define a macro that would be defined
    #[arg(short = 'U', value_name = "SYMBOL")]
    undefine: Vec<String>,

    /// Name of the compiled shader, instead of SHADERNAME.gso
    #[arg(short = 'o', value_name = "NAME")]
    output: Option<String>,

    /// 0: errors only; 1: also warnings; 2: also what is done
    #[arg(long, value_name = "LEVEL", default_value_t = 1)]
    verbosity: u8,

    /// Tell about every library that is loaded (none are: C++ shadeops are not supported yet)
    #[arg(long)]
    debugdso: bool,

    /// Encrypt the compiled shader; its parameters stay readable
    #[arg(short = 'x')]
    encrypt: bool,
}

/// Runs the tool; `args` begins with the name it was called by.
pub fn main(args: Vec<OsString>) -> Status {
    run(&parse::<Options>(args))
}

fn run(options: &Options) -> Status {
    if options.debugdso && options.verbosity >= 1 {
        say("gslc: warning: C++ shadeops are not supported yet; no libraries are loaded");
    }
    let (source, file) = match read_source(&options.source) {
        Ok(found) => found,
        Err(error) => {
            say(&format!("gslc: error: {}: {error}", options.source));
            return Status::Failed;
        }
    };
    let defines: Vec<(String, Option<String>)> = options
        .define
        .iter()
        .map(|d| match d.split_once('=') {
            Some((name, value)) => (name.to_owned(), Some(value.to_owned())),
            None => (d.clone(), None),
        })
        .collect();
    let load = |path: &str| {
        if options.verbosity >= 2 && Path::new(path).is_file() {
            say(&format!("gslc: including {path}"));
        }
        load(path)
    };
    let compiled = compile(
        &source,
        &file,
        &CompileOptions {
            include_paths: &options.include,
            defines: &defines,
            undefines: &options.undefine,
            loader: Some(&load),
        },
    );
    let compiled = match compiled {
        Ok(compiled) => compiled,
        Err(list) => {
            show(&list, options.verbosity);
            return Status::WithErrors;
        }
    };
    show(&compiled.warnings, options.verbosity);
    let module = &compiled.module;
    let output = options.output.clone().unwrap_or_else(|| format!("{}.gso", module.name));
    if let Err(error) = write_whole(Path::new(&output), &gso::write(module, options.encrypt)) {
        say(&format!("gslc: error: {output}: {error}"));
        return Status::Failed;
    }
    if options.verbosity >= 2 {
        let (kind, name) = (module.kind.word(), &module.name);
        let (params, symbols) = (module.params.len(), module.symbols.len());
        say(&format!("gslc: {kind} \"{name}\" ({params} parameters, {symbols} symbols) written to {output}"));
    }
    Status::Done
}

/// The text, and the name that messages give it. What is no UTF-8 (old comments) is replaced.
fn read_source(name: &str) -> io::Result<(String, String)> {
    let (bytes, name) = match name {
        "-" => (io::read_to_string(io::stdin())?.into_bytes(), "<stdin>"),
        file => (std::fs::read(file)?, file),
    };
    Ok((String::from_utf8_lossy(&bytes).into_owned(), name.to_owned()))
}

/// Reads an included file.
fn load(path: &str) -> io::Result<Option<String>> {
    if Path::new(path).is_dir() {
        return Ok(None);
    }
    match std::fs::read(path) {
        Ok(bytes) => Ok(Some(String::from_utf8_lossy(&bytes).into_owned())),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error),
    }
}

fn show(list: &[Diagnostic], verbosity: u8) {
    let shown = list.iter().filter(|d| verbosity >= 1 || d.severity >= Severity::Error);
    shown.for_each(|d| say(&d.to_string()));
}

/// A line on standard error; nobody is left to tell when it is closed.
fn say(text: &str) {
    let _ = writeln!(io::stderr().lock(), "{text}");
}

/// Writes a file that appears whole or not at all.
fn write_whole(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let name = path.file_name().ok_or_else(|| io::Error::other("not a file name"))?;
    let beside = path.with_file_name(format!(".{}.{}", name.to_string_lossy(), std::process::id()));
    let written = (|| {
        let mut file = std::fs::File::create(&beside)?;
        file.write_all(bytes)?;
        file.sync_all()?;
        std::fs::rename(&beside, path)
    })();
    if written.is_err() {
        // The first error is the one to tell.
        let _ = std::fs::remove_file(&beside);
    }
    written
}
