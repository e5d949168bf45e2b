//! The shader compiler. It compiles `name.gsl` to `name.gso` (reference 8.2). With `-run` it also runs a shader, and
//! with `-functions` it prints the reference of the functions.

#![forbid(unsafe_code)]

mod functions;
mod run;
mod surroundings;

use clap::Parser;
use granita_base::files::is_same_file;
use granita_base::report::printable;
use granita_base::{Environment, Reporter, SearchPath, Severity};
use granita_cli::{Status, before_signals, parse};
use granita_gsl::{CompileOptions, Diagnostic, ValidModule, compile, gso};
use granita_image::AtomicFile;
use granita_plugin::{PluginRules, Plugins};
use std::ffi::OsString;
use std::fs::File;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

/// Compiles a shader.
///
/// The compiled shader is written to SHADERNAME.gso in the current folder. With -run the shader runs over a flat grid
/// instead, and its result is written as an image.
#[derive(Parser, Debug)]
#[command(name = "gslc")]
struct Options {
    /// Source file; "-" reads standard input
    #[arg(value_name = "SOURCE", required_unless_present = "functions")]
    source: Option<String>,

    /// A folder of included files; may be repeated
    #[arg(short = 'I', value_name = "PATH")]
    include: Vec<String>,

    /// Define a macro; its default value is 1
    #[arg(short = 'D', value_name = "SYMBOL[=VALUE]")]
    define: Vec<String>,

    /// Do not define a predefined macro
    #[arg(short = 'U', value_name = "SYMBOL")]
    undefine: Vec<String>,

    /// Name of the compiled shader instead of SHADERNAME.gso; with -run, of the image ("null": none)
    #[arg(short = 'o', value_name = "NAME")]
    output: Option<String>,

    /// 0: errors only; 1: also warnings; 2: also progress
    #[arg(long, value_name = "LEVEL", default_value_t = 1)]
    verbosity: u8,

    /// A folder of libraries with functions in C++, or such a library; may be repeated. Relative folders of -I are not
    /// searched
    #[arg(long, value_name = "PATH")]
    plugins: Vec<PathBuf>,

    /// Print every library that is tried for functions in C++
    #[arg(long)]
    debugdso: bool,

    /// Encrypt the compiled shader; its parameters stay readable
    #[arg(short = 'x')]
    encrypt: bool,

    /// Print the arguments, results, options and an example of a function of the language, or a list of all
    #[arg(long, value_name = "NAME", num_args = 0..=1, default_missing_value = "", conflicts_with = "source")]
    functions: Option<String>,

    /// Run SOURCE (a source file, a compiled one, or the name of a bundled shader) over a unit square
    #[arg(long)]
    run: bool,

    /// With -run: the number of points of the square, one per pixel
    #[arg(long, value_name = "WIDTHxHEIGHT", default_value = "512x512")]
    grid: String,

    /// With -run: a parameter, as "float Kd 0.5"; may be repeated
    #[arg(long, value_name = "PARAMETER", allow_hyphen_values = true)]
    param: Vec<String>,

    /// With -run: a light, by file or name, with its defaults; by default a white light at the viewer
    #[arg(long, value_name = "SHADER")]
    light: Vec<String>,

    /// With -run: the data of the image: an output parameter or a global; by default C, for displacements P, for lights
    /// Cl
    #[arg(long, value_name = "NAME")]
    data: Option<String>,

    /// With -run: the number of times that every grid is shaded; verbosity 2 prints the time per point
    #[arg(long, value_name = "TIMES", default_value_t = 1)]
    repeat: u32,

    /// With -run: the number of threads; 0: one per core
    #[arg(long, value_name = "N", default_value_t = 0)]
    threads: usize,

    /// With -run: 0 runs the compiled code, 1 optimises it for its parameters first
    #[arg(short = 'O', value_name = "LEVEL", default_value_t = 1)]
    optimize: u8,
}

impl Options {
    /// Returns the name of the source, which is empty only without one.
    fn source(&self) -> &str {
        self.source.as_deref().unwrap_or_default()
    }
}

/// Returns the table of the options.
pub fn command() -> clap::Command {
    granita_cli::command::<Options>()
}

/// Runs the tool. `args` begins with the name by which it was called.
pub fn main(args: Vec<OsString>) -> Status {
    let options = parse::<Options>(args);
    if let Some(name) = &options.functions {
        return functions::show(name);
    }
    if let Err(error) = before_signals(|| ()) {
        say(&format!("gslc: warning: signals cannot be handled: {error}"));
    }
    if options.run { run::run(&options) } else { compile_file(&options) }
}

/// Compiles the source and writes the compiled shader.
fn compile_file(options: &Options) -> Status {
    let (source, file) = match read_source(options.source()) {
        Ok(found) => found,
        Err(error) => {
            say(&format!("gslc: error: {}: {error}", options.source()));
            return Status::Failed;
        }
    };
    let Some(module) = compiled(&source, &file, options) else { return Status::WithErrors };
    let output = options.output.clone().unwrap_or_else(|| format!("{}.gso", module.name));
    if is_same_file(Path::new(options.source()), Path::new(&output)) {
        say(&format!("gslc: error: {output} is the source itself, and is not overwritten"));
        return Status::Failed;
    }
    if let Err(error) = write_whole(Path::new(&output), &gso::write(&module, options.encrypt)) {
        say(&format!("gslc: error: {error}"));
        return Status::Failed;
    }
    if options.verbosity >= 2 {
        let (kind, name) = (module.kind.word(), &module.name);
        let (params, symbols) = (module.params.len(), module.symbols.len());
        say(&format!("gslc: {kind} \"{name}\" ({params} parameters, {symbols} symbols) written to {output}"));
    }
    Status::Done
}

/// Compiles a source and prints the messages; `None` when it has errors.
fn compiled(source: &str, file: &str, options: &Options) -> Option<ValidModule> {
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
    let (plugins, folders) = (plugins(options), shadeop_path(options));
    let compiled = compile(
        source,
        file,
        &CompileOptions {
            include_paths: &options.include,
            defines: &defines,
            undefines: &options.undefine,
            loader: Some(&load),
            shadeops: Some(&|name: &str| plugins.shadeop_forms(name, &folders)),
        },
    );
    match compiled {
        Ok(compiled) => {
            show(&compiled.warnings, options.verbosity);
            Some(compiled.module)
        }
        Err(list) => {
            show(&list, options.verbosity);
            None
        }
    }
}

/// Returns the finder of functions in C++.
fn plugins(options: &Options) -> Plugins {
    let reporter = Reporter::new(Box::new(|message| say(format!("gslc: {message}").trim_end())));
    reporter.set_verbosity(options.verbosity);
    let plugins =
        Plugins::new(reporter, PluginRules { named: options.plugins.clone(), ..PluginRules::default() });
    plugins.set_debug(options.debugdso);
    plugins
}

/// Returns the folders for functions in C++ besides `-plugins`, which are the absolute folders of `-I`. The folder of
/// the source is not among them, because it may be untrusted.
fn shadeop_path(options: &Options) -> SearchPath {
    SearchPath::parse(&options.include.join(":"), &SearchPath::default(), &Environment::empty())
}

/// Returns the text of a source and its name in messages. Bytes of a file that are not UTF-8 (in old comments) are
/// replaced.
fn read_source(name: &str) -> io::Result<(String, String)> {
    let (text, name) = match name {
        "-" => (text_of(io::stdin().lock())?, "<stdin>"),
        file => (text_of(File::open(file)?)?, file),
    };
    Ok((text, name.to_owned()))
}

fn text_of(mut file: impl Read) -> io::Result<String> {
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes)?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

/// Reads an included file. Returns `None` when there is no such file.
fn load(path: &str) -> io::Result<Option<String>> {
    if Path::new(path).is_dir() {
        return Ok(None);
    }
    match File::open(path).and_then(text_of) {
        Ok(text) => Ok(Some(text)),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error),
    }
}

fn show(list: &[Diagnostic], verbosity: u8) {
    let shown = list.iter().filter(|d| verbosity >= 1 || d.severity >= Severity::Error);
    shown.for_each(|d| say(&d.to_string()));
}

/// Prints a line on standard error. A failure cannot be reported.
fn say(text: &str) {
    let _ = writeln!(io::stderr().lock(), "{}", printable(text));
}

/// Writes a file. It appears complete or not at all.
fn write_whole(path: &Path, bytes: &[u8]) -> Result<(), String> {
    let mut file = AtomicFile::create(path).map_err(|e| e.to_string())?;
    file.write_all(bytes).map_err(|e| format!("{}: {e}", path.display()))?;
    file.commit().map_err(|e| e.to_string())
}

#[cfg(test)]
mod tests {
    #[test]
    fn bytes_that_are_not_utf8_are_replaced() {
        assert_eq!(super::text_of(&b"/* 90\xb0 */"[..]).unwrap_or_default(), "/* 90\u{fffd} */");
    }
}
