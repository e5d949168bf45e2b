//! Lists the parameters of shaders (reference 8.3) and the content of spatial databases, as text or as JSON.

#![forbid(unsafe_code)]

mod database;
mod json;

use clap::Parser;
use granita_base::report::printable;
use granita_base::{Environment, SearchPath};
use granita_cli::{Status, environment, parse, print};
use granita_gsl::{CompileOptions, GsoArgs, compile};
use std::ffi::OsString;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Lists the parameters of shaders and their default values.
///
/// A shader is a file or a name. A name is searched as NAME.gso and as source text NAME.gsl on the search path, then
/// among the bundled shaders.
///
/// For a spatial database (FILE.sdb) it prints the kind, the number and the bounds of the records, and the sum and the
/// range of their values; with -v also the records, one per line: position, normal, values.
#[derive(Parser, Debug)]
#[command(name = "gsoinfo")]
struct Options {
    /// Shaders or spatial databases
    #[arg(value_name = "SHADER", required = true)]
    shaders: Vec<String>,

    /// Verbose: also metadata and the spaces of values; records of databases
    #[arg(short = 'v')]
    verbose: bool,

    /// Search path: folders, separated by colons; by default ".:$GELATOHOME/shaders"
    #[arg(short = 'p', value_name = "PATH")]
    path: Option<String>,

    /// Print all data of all shaders as one JSON array
    #[arg(long)]
    json: bool,
}

/// Returns the table of the options.
pub fn command() -> clap::Command {
    granita_cli::command::<Options>()
}

/// Runs the tool. `args` begins with the name by which it was called.
pub fn main(args: Vec<OsString>) -> Status {
    let options = parse::<Options>(args);
    let path = search_path(options.path.as_deref(), &environment());
    let mut failed = 0;
    let mut list = Vec::new();
    for name in &options.shaders {
        if Path::new(name).extension().is_some_and(|e| e == "sdb") {
            match granita_sdb::read(Path::new(name)) {
                Ok(records) if options.json => list.push(database::json(name, &records)),
                Ok(records) => database::show(name, &records, options.verbose),
                Err(what) => {
                    // When standard error is closed, the failure cannot be reported.
                    let _ =
                        writeln!(io::stderr().lock(), "ERROR opening spatial database \"{name}\" ({what})");
                    failed += 1;
                }
            }
            continue;
        }
        match query(name, &path) {
            Ok(args) if options.json => list.push(json::describe(&args)),
            Ok(args) => print(&printable(&args.describe(options.verbose))),
            Err(what) => {
                // When standard error is closed, the failure cannot be reported.
                let _ = writeln!(io::stderr().lock(), "ERROR opening shader \"{name}\" ({what})");
                failed += 1;
            }
        }
    }
    if options.json {
        print(&format!("{:#}\n", serde_json::Value::Array(list)));
    }
    match failed {
        0 => Status::Done,
        n if n < options.shaders.len() => Status::WithErrors,
        _ => Status::Failed,
    }
}

fn search_path(given: Option<&str>, environment: &Environment) -> SearchPath {
    let default = SearchPath::parse(".:$GELATOHOME/shaders", &SearchPath::default(), environment);
    match given {
        Some(path) => SearchPath::parse(&path.replace(';', ":"), &default, environment),
        None => default,
    }
}

/// Finds a shader and reads its parameters.
fn query(name: &str, path: &SearchPath) -> Result<GsoArgs, String> {
    let given = Path::new(name);
    let file = if given.extension().is_some_and(|e| e == "gso" || e == "gsl") {
        given.is_file().then(|| given.to_owned()).or_else(|| path.find(name))
    } else {
        let beside = |extension: &str| path.find(&format!("{name}.{extension}"));
        beside("gso").or_else(|| beside("gsl"))
    };
    if let Some(file) = file {
        return query_file(&file);
    }
    let base = given.file_stem().and_then(|s| s.to_str()).filter(|_| given.components().count() == 1);
    match base.and_then(granita_bundled::shader) {
        Some(source) => from_source(source, &format!("{name}.gsl"), None),
        None => Err("it cannot be found".to_owned()),
    }
}

fn query_file(file: &PathBuf) -> Result<GsoArgs, String> {
    let bytes = std::fs::read(file).map_err(|e| format!("{}: {e}", file.display()))?;
    let name = file.to_string_lossy();
    if file.extension().is_some_and(|e| e == "gsl") {
        return from_source(&String::from_utf8_lossy(&bytes), &name, file.parent());
    }
    GsoArgs::from_bytes(&bytes, &name).map_err(|e| e.to_string())
}

fn from_source(source: &str, name: &str, folder: Option<&Path>) -> Result<GsoArgs, String> {
    let folders: Vec<String> = folder.iter().map(|f| f.to_string_lossy().into_owned()).collect();
    let load = |path: &str| match std::fs::read(path) {
        Ok(bytes) => Ok(Some(String::from_utf8_lossy(&bytes).into_owned())),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
        Err(error) => Err(error),
    };
    let options =
        CompileOptions { include_paths: &folders, loader: Some(&load), ..CompileOptions::default() };
    match compile(source, name, &options) {
        Ok(compiled) => Ok(GsoArgs::from_module(&compiled.module)),
        Err(list) => Err(list.first().map_or_else(String::new, |d| format!("{}: {}", d.at, d.message))),
    }
}
