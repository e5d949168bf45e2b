//! `maketx` turns images into textures, environment maps and shadow maps (reference 9.1).
//!
//! The textures are made by [`granita_texture::make`]. Here options become values, several inputs become several
//! textures, and results become messages.

#![forbid(unsafe_code)]

mod args;
mod jobs;
mod memory;

use args::Args;
use granita_base::files::is_same_file;
use granita_base::{Files, Location, Reporter, SearchPath, Severity};
use granita_cli::{Bar, Status, before_signals, console_reporter, environment, fence, parse};
use granita_image::{FormatRegistry, Limits};
use granita_plugin::PluginRules;
use granita_texture::make::{Costs, Made, MakeOptions, make_measured};
use jobs::Job;
use parking_lot::Mutex;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

impl Args {
    /// Returns the files that -safe lets the tool read. They lie beneath the folders of the inputs and of the search
    /// path.
    fn readable(&self) -> Files {
        let files = Files::reading(self.inputs.iter().map(Path::new));
        let path =
            SearchPath::parse(self.path.as_deref().unwrap_or(""), &SearchPath::default(), &environment());
        path.folders().iter().for_each(|folder| files.add_root(folder));
        files
    }

    /// Finds the inputs along the search path. Returns `None`, after an error for each, when some are missing.
    fn find_inputs(&self, reporter: &Reporter) -> Option<Vec<PathBuf>> {
        let Some(text) = &self.path else { return Some(self.inputs.iter().map(PathBuf::from).collect()) };
        let path = SearchPath::parse(text, &SearchPath::default(), &environment());
        let find = |name: &String| {
            if name == "-" {
                return Some(PathBuf::from(name));
            }
            let found = path.find(name);
            if found.is_none() {
                reporter.error(format!("{name}: not found along {text}"));
            }
            found
        };
        let found: Vec<Option<PathBuf>> = self.inputs.iter().map(find).collect();
        found.into_iter().collect()
    }
}

/// Prints the image formats, for `-debugdso`.
fn say_formats(registry: &FormatRegistry, reporter: &Reporter) {
    for name in registry.names() {
        let Some(format) = registry.by_name(name) else { continue };
        let able: Vec<&str> = ["write", "tiles", "levels", "half", "float", "u16"]
            .into_iter()
            .filter(|feature| format.supports(feature))
            .collect();
        let text = format!(
            "image format \"{name}\": built in, extensions {}, {}\n",
            format.extensions().join(" "),
            if able.is_empty() { "reads only".to_owned() } else { able.join(" ") }
        );
        reporter.say(Severity::Message, &Location::default(), text);
    }
}

/// Prints the time and the memory that one texture took, for `-stats`.
fn say_costs(job: &Job, costs: &Costs, wall: Duration, reporter: &Reporter) {
    let size = |path: &PathBuf| std::fs::metadata(path).map_or(0, |m| m.len());
    let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
    let input: u64 = job.inputs.iter().map(size).sum();
    let seconds = |d: Duration| d.as_secs_f64();
    let mut text = format!(
        "{}: {:.2} s; {:.1} MiB in, {:.1} MiB out\n",
        job.output.display(),
        seconds(wall),
        mib(input),
        mib(size(&job.output)),
    );
    for (what, time) in [
        ("look ahead", costs.scan),
        ("read", costs.read),
        ("filter", costs.filter),
        ("compress and write", costs.write),
        ("complete the file", costs.close),
    ] {
        if time > Duration::ZERO {
            text.push_str(&format!("  {what:<20} {:.2} s\n", seconds(time)));
        }
    }
    if let Some(peak) = memory::peak_bytes() {
        text.push_str(&format!("  {:<20} {:.0} MiB\n", "peak memory", mib(peak)));
    }
    reporter.say(Severity::Message, &Location::default(), text);
}

/// Makes one texture. Returns true when it succeeds.
fn run_job(
    job: &Job,
    args: &Args,
    options: &MakeOptions,
    registry: &FormatRegistry,
    bar: &Bar,
    reporter: &Reporter,
) -> bool {
    let state = Mutex::new((bar.clone(), false));
    let progress = |done: u64, total: u64| {
        let mut state = state.lock();
        if !state.1 {
            state.0.begin(&job.output.display().to_string(), total);
            state.1 = true;
        }
        state.0.done(done);
    };
    let start = Instant::now();
    let result = make_measured(&job.inputs, &job.output, options, registry, &progress);
    state.lock().0.end();
    let output = job.output.display();
    match result {
        Ok((Made::UpToDate, _)) => {
            reporter.info(format!("{output} is up to date"));
            true
        }
        Ok((Made::Written { width, height, levels, notes }, costs)) => {
            notes.into_iter().for_each(|note| reporter.warning(note));
            reporter.info(format!("wrote {output}: {width} x {height} texels, {levels} levels"));
            if args.stats {
                say_costs(job, &costs, start.elapsed(), reporter);
            }
            true
        }
        Err(error) => {
            reporter.error(error.to_string());
            false
        }
    }
}

/// Returns the format that the extension of a texture names, if it names one that stores textures.
///
/// # Errors
/// Returns a message when the extension names a format that does not store textures. A TIFF file is then written.
fn format_of(output: &Path, registry: &FormatRegistry) -> Result<Option<String>, String> {
    let extension = output.extension().map(|e| e.to_string_lossy().into_owned());
    // The extension `tx` does not name a format.
    let Some(name) = extension.filter(|e| !e.eq_ignore_ascii_case("tx")) else { return Ok(None) };
    let Some(format) = registry.by_name(&name) else { return Ok(None) };
    // Shadow maps are TIFF files as well. maketx writes them with more information.
    if format.name() == "shadow" {
        return Ok(None);
    }
    if ["write", "tiles", "levels"].iter().all(|feature| format.supports(feature)) {
        return Ok(Some(format.name().to_owned()));
    }
    Err(format!(
        "{} becomes a TIFF file: format \"{}\" does not store textures, which need tiles and MIP levels",
        output.display(),
        format.name()
    ))
}

fn run(args: &Args, bar: &Bar, reporter: &Reporter) -> Status {
    let files = match args.safe {
        true => args.readable(),
        false => Files::default(),
    };
    let registry = granita_plugin::formats_with_plugins(
        Limits { files: files.clone(), ..Limits::default() },
        &granita_cli::environment(),
        reporter,
        PluginRules { none: args.safe, named: args.plugins.clone(), current_folder: false },
        args.debugdso,
    );
    if args.debugdso {
        say_formats(&registry, reporter);
    }
    let mut options = match args.options(memory::installed_bytes()) {
        Ok(options) => options,
        Err(what) => {
            reporter.error(what);
            return Status::Failed;
        }
    };
    let Some(inputs) = args.find_inputs(reporter) else { return Status::Failed };
    let jobs = match jobs::jobs(inputs, args.output.as_deref(), options.mode) {
        Ok(jobs) => jobs,
        Err(what) => {
            reporter.error(what);
            return Status::Failed;
        }
    };
    if let (None, [job]) = (&args.format, &jobs[..]) {
        match format_of(&job.output, &registry) {
            Ok(Some(name)) => options.format = name,
            Ok(None) => {}
            // An output that is an input is refused below.
            Err(_) if job.inputs.iter().any(|input| is_same_file(input, &job.output)) => {}
            Err(warning) => reporter.warning(warning),
        }
    }
    if let Some(folder) = args.output.as_deref().filter(|path| jobs::is_folder(path))
        && let Err(error) = std::fs::create_dir_all(folder)
    {
        reporter.error(format!("-o {}: the folder cannot be made: {error}", folder.display()));
        return Status::Failed;
    }
    if args.safe && !args.nofence {
        jobs.iter().for_each(|job| files.grant_output(&job.output));
        if let Err(what) = fence(&files) {
            reporter.error(format!("-safe: {what}"));
            return Status::Failed;
        }
    }
    let made = || jobs.iter().filter(|job| run_job(job, args, &options, &registry, bar, reporter)).count();
    let made = match args.threads {
        Some(threads) => match rayon::ThreadPoolBuilder::new().num_threads(threads).build() {
            Ok(pool) => pool.install(made),
            Err(error) => {
                reporter.error(format!("cannot start {threads} threads: {error}"));
                return Status::Failed;
            }
        },
        None => made(),
    };
    match jobs.len() - made {
        0 => Status::Done,
        _ if made == 0 => Status::Failed,
        _ => Status::WithErrors,
    }
}

/// Returns the table of the options.
pub fn command() -> clap::Command {
    granita_cli::command::<Args>()
}

/// Runs the tool. `words` begins with the name by which it was called.
pub fn main(words: Vec<OsString>) -> Status {
    let args: Args = parse(words);
    let verbosity = args.verbosity();
    let bar = Bar::new(verbosity > 0);
    let reporter = console_reporter("maketx", &bar);
    reporter.set_verbosity(verbosity);
    if let Err(error) = before_signals(|| ()) {
        reporter.warning(format!("signals cannot be handled: {error}"));
    }
    run(&args, &bar, &reporter)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_extension_of_the_output_chooses_the_format() {
        let registry = granita_plugin::bundled_formats(Limits::default());
        let of = |name: &str| format_of(Path::new(name), &registry);
        assert_eq!(of("a/b.exr"), Ok(Some("exr".to_owned())));
        assert_eq!(of("b.EXR"), Ok(Some("exr".to_owned())));
        assert_eq!(of("b.tif"), Ok(Some("tiff".to_owned())));
        for none in ["b", "b.tx", "b.TX", "b.sm", "b.vsm", "b.unknown", "exr", ".exr"] {
            assert_eq!(of(none), Ok(None), "{none}");
        }
        assert!(of("b.png").unwrap_err().contains("b.png becomes a TIFF file"));
    }
}
