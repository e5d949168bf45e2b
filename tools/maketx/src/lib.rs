//! `maketx` turns images into textures, environment maps and shadow maps (reference 9.1).
//!
//! The textures are made by [`granita_texture::make`]. Here options become values, several inputs become several
//! textures, and results become messages.

#![forbid(unsafe_code)]

mod args;
mod colors;
mod jobs;
mod memory;
mod oiio;
mod profile;
mod request;
mod shared;
mod txmake;

use args::Args;
use granita_base::files::is_same_file;
use granita_base::{Environment, Files, Location, Reporter, Severity};
use granita_cli::{Bar, Status, before_signals, console_reporter, environment, fence, parse, parse_or};
use granita_image::{FormatRegistry, Limits};
use granita_texture::TextureError;
use granita_texture::make::{Costs, Made, Progress, make_measured};
use jobs::Job;
use oiio::OiioArgs;
use parking_lot::Mutex;
use profile::Profile;
use rayon::prelude::*;
use request::{Manner, Request};
use std::borrow::Cow;
use std::ffi::OsString;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};
use txmake::TxmakeArgs;

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

/// The result of making one texture, which is reported later.
enum Outcome {
    /// It is newer than its inputs.
    Newer,
    /// The result of the library, and the wall time.
    Tried(Result<(Made, Costs), TextureError>, Duration),
}

/// Makes one texture.
fn make_job(job: &Job, request: &Request, registry: &FormatRegistry, progress: Progress<'_>) -> Outcome {
    if request.newer && is_newer(job) {
        return Outcome::Newer;
    }
    let start = Instant::now();
    let mut options = Cow::Borrowed(&request.options);
    if request.seams && !job.neighbours.is_empty() {
        options.to_mut().flat.neighbours.clone_from(&job.neighbours);
    }
    let result = make_measured(&job.inputs, &job.output, &options, registry, progress);
    Outcome::Tried(result, start.elapsed())
}

/// The number of textures that are made at once. Each may take a quarter of the memory where its format is decoded as a
/// whole.
const AT_ONCE: usize = 4;

/// Makes all textures, and reports each. Returns the number of those that succeeded.
///
/// Several textures that are made in rows are made [`AT_ONCE`], because one alone does not keep all threads busy.
fn make_jobs(
    jobs: &[Job],
    request: &Request,
    registry: &FormatRegistry,
    bar: &Bar,
    reporter: &Reporter,
) -> usize {
    let title = |job: &Job| job.output.display().to_string();
    if jobs.len() > 1 && request.options.is_streamed() && !request.seams {
        let mut bar = bar.clone();
        bar.begin(&format!("{} textures", jobs.len()), jobs.len() as u64);
        let done = AtomicU64::new(0);
        let one = |job| {
            let outcome = make_job(job, request, registry, &|_, _| ());
            bar.done(done.fetch_add(1, Ordering::Relaxed) + 1);
            outcome
        };
        let outcomes: Vec<Outcome> =
            jobs.chunks(AT_ONCE).flat_map(|some| some.par_iter().map(one).collect::<Vec<_>>()).collect();
        bar.end();
        return jobs
            .iter()
            .zip(outcomes)
            .filter(|(job, outcome)| report(job, outcome, request, reporter))
            .count();
    }
    let one = |job: &&Job| {
        let state = Mutex::new((bar.clone(), false));
        let progress = |done: u64, total: u64| {
            let mut state = state.lock();
            if !state.1 {
                state.0.begin(&title(job), total);
                state.1 = true;
            }
            state.0.done(done);
        };
        let outcome = make_job(job, request, registry, &progress);
        state.lock().0.end();
        report(job, &outcome, request, reporter)
    };
    jobs.iter().filter(one).count()
}

/// Reports the result of one texture. Returns true when it succeeded.
fn report(job: &Job, outcome: &Outcome, request: &Request, reporter: &Reporter) -> bool {
    let output = job.output.display();
    let (result, wall) = match outcome {
        Outcome::Newer => {
            reporter.info(format!("{output} is newer than its inputs"));
            return true;
        }
        Outcome::Tried(result, wall) => (result, *wall),
    };
    match result {
        Ok((Made::UpToDate, _)) => {
            match request.manner {
                Manner::Suite => reporter.info(format!("{output} is up to date")),
                Manner::OpenImageIo => {
                    say(format!("maketx: no update required for \"{output}\"\n"), reporter);
                }
            }
            true
        }
        Ok((Made::Written { width, height, levels, notes }, costs)) => {
            let wrote = format!("wrote {output}: {width} x {height} texels, {levels} levels");
            match request.manner {
                Manner::Suite => {
                    notes.iter().for_each(|note| reporter.warning(note.clone()));
                    reporter.info(wrote);
                }
                Manner::OpenImageIo => {
                    notes.iter().for_each(|note| say(format!("WARNING: {note}\n"), reporter));
                    if request.verbosity > 1 {
                        say(format!("  {wrote}\n"), reporter);
                    }
                }
            }
            if request.stats {
                say_costs(job, costs, wall, reporter);
            }
            true
        }
        Err(error) => {
            request.manner.error(error.to_string(), reporter);
            false
        }
    }
}

fn say(text: String, reporter: &Reporter) {
    reporter.say(Severity::Message, &Location::default(), text);
}

/// True when a texture exists that is newer than all its inputs.
fn is_newer(job: &Job) -> bool {
    let time = |path: &Path| std::fs::metadata(path).and_then(|m| m.modified()).ok();
    let Some(own) = time(&job.output) else { return false };
    job.inputs.iter().all(|input| time(input).is_some_and(|time| time <= own))
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

/// Returns the format that OpenImageIO's program chooses by the extension of a texture.
///
/// # Errors
/// Returns a message when the extension does not belong to a format that stores textures.
fn peer_format_of(output: &Path, registry: &FormatRegistry) -> Result<Option<String>, String> {
    let extension = output.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    if ["tx", "env", "sm", "vsm"].contains(&&*extension) {
        return Ok(None);
    }
    let output = output.display();
    let Some(format) = registry.by_name(&extension) else {
        return Err(format!("\"{output}\": no format is known for this name"));
    };
    if ["write", "tiles", "levels"].iter().all(|feature| format.supports(feature)) {
        return Ok(Some(format.name().to_owned()));
    }
    Err(format!("\"{output}\" format does not support tiled images with MIP levels"))
}

fn run(mut request: Request, bar: &Bar, reporter: &Reporter) -> Status {
    let manner = request.manner;
    let failed = |what: String| {
        manner.error(what, reporter);
        manner.failed()
    };
    let files = match request.run.safe {
        true => request.readable(),
        false => Files::default(),
    };
    let registry = granita_plugin::formats_with_plugins(
        Limits { files: files.clone(), ..Limits::default() },
        &granita_cli::environment(),
        reporter,
        request.run.rules(),
        request.run.debugdso,
    );
    if request.run.debugdso {
        say_formats(&registry, reporter);
    }
    let Some(inputs) = request.find_inputs(reporter) else { return manner.failed() };
    let jobs = match jobs::jobs(inputs, request.output.as_deref(), request.options.mode) {
        Ok(jobs) => jobs,
        Err(what) => return failed(what),
    };
    let is_set = request.output.as_deref().is_some_and(|path| jobs::set_of(path).is_some());
    if !request.format_given
        && let Some(job) = jobs.first().filter(|_| jobs.len() == 1 || is_set)
    {
        let format = match manner {
            Manner::Suite => format_of(&job.output, &registry),
            Manner::OpenImageIo => match peer_format_of(&job.output, &registry) {
                Ok(format) => Ok(format),
                Err(what) => return failed(what),
            },
        };
        match format {
            Ok(Some(name)) => request.options.format = name,
            Ok(None) => {}
            // An output that is an input is refused below.
            Err(_) if job.inputs.iter().any(|input| is_same_file(input, &job.output)) => {}
            Err(warning) => reporter.warning(warning),
        }
    }
    if let Some(folder) = request.output.as_deref().filter(|path| jobs::is_folder(path))
        && let Err(error) = std::fs::create_dir_all(folder)
    {
        return failed(format!("-o {}: the folder cannot be made: {error}", folder.display()));
    }
    if request.run.safe && !request.run.nofence {
        jobs.iter().for_each(|job| files.grant_output(&job.output));
        if let Err(what) = fence(&files) {
            return failed(format!("-safe: {what}"));
        }
    }
    let made = || make_jobs(&jobs, &request, &registry, bar, reporter);
    let made = match request.threads {
        Some(threads) => match rayon::ThreadPoolBuilder::new().num_threads(threads).build() {
            Ok(pool) => pool.install(made),
            Err(error) => return failed(format!("cannot start {threads} threads: {error}")),
        },
        None => made(),
    };
    match jobs.len() - made {
        0 => Status::Done,
        _ if made == 0 => manner.failed(),
        _ => Status::WithErrors,
    }
}

/// Returns the table of the options.
pub fn command() -> clap::Command {
    granita_cli::command::<Args>()
}

/// Returns the table of the options of the profile `oiio`.
pub fn oiio_command() -> clap::Command {
    granita_cli::command::<OiioArgs>()
}

/// Returns the request of a command line. An error and its status were printed.
fn request(words: Vec<OsString>, profile: Profile, environment: &Environment) -> Result<Request, Status> {
    let installed = memory::installed_bytes();
    // Without a standard error the status still counts.
    let refused = |name: &str, what: String, status: Status| {
        let _ = writeln!(std::io::stderr().lock(), "{name}{what}");
        status
    };
    match profile {
        Profile::Granita => {
            let args: Args = parse(words);
            args.request(environment, installed)
                .map_err(|what| refused("maketx: error: ", what, Status::Failed))
        }
        Profile::Txmake => {
            let args: TxmakeArgs = parse(txmake::with_threads(words));
            args.request(installed).map_err(|what| refused("txmake: error: ", what, Status::Failed))
        }
        Profile::Oiio => {
            let args: OiioArgs = parse_or(words.clone(), Status::WithErrors);
            if args.inputs.is_empty() {
                let usage = oiio_command().render_usage();
                granita_cli::print(&format!("{usage}\n\nFor detailed help: oiio-maketx --help\n"));
                return Err(Status::Done);
            }
            args.request(&words, environment, installed)
                .map_err(|what| refused("maketx ERROR: ", what, Status::WithErrors))
        }
    }
}

/// Runs the tool. `words` begins with the name by which it was called.
pub fn main(mut words: Vec<OsString>) -> Status {
    let environment = environment();
    let profile = match Profile::choose(&mut words, &environment) {
        Ok(profile) => profile,
        Err(what) => {
            let _ = writeln!(std::io::stderr().lock(), "maketx: error: {what}");
            return Status::Failed;
        }
    };
    let request = match request(words, profile, &environment) {
        Ok(request) => request,
        Err(status) => return status,
    };
    let bar = Bar::new(request.verbosity > 0);
    let reporter = console_reporter("maketx", &bar);
    reporter.set_verbosity(request.verbosity);
    if let Err(error) = before_signals(|| ()) {
        reporter.warning(format!("signals cannot be handled: {error}"));
    }
    run(request, &bar, &reporter)
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

    /// Runs a command line in a folder with an image. Returns the status, and all messages.
    fn run_line(folder: &Path, line: &str) -> (u8, String) {
        let words: Vec<OsString> = line
            .split(' ')
            .map(|word| if word.starts_with("./") { folder.join(word).into() } else { word.into() })
            .collect();
        let mut words = words;
        let environment = Environment::empty();
        let profile = Profile::choose(&mut words, &environment).unwrap();
        let request = match request(words, profile, &environment) {
            Ok(request) => request,
            Err(status) => return (status.code(), String::new()),
        };
        let (reporter, messages) = Reporter::collecting();
        reporter.set_verbosity(request.verbosity);
        let status = run(request, &Bar::new(false), &reporter);
        let text = messages.lock().iter().map(|m| format!("{:?}: {}", m.severity, m.text)).collect();
        (status.code(), text)
    }

    /// The statuses are 0 and 1 by the profile oiio, and errors of making a texture go to standard output.
    #[test]
    fn statuses_and_streams_are_those_of_the_profile() {
        let folder = tempfile::tempdir().unwrap();
        let brick = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/first/brick.png");
        std::fs::copy(brick, folder.path().join("a.png")).unwrap();
        let run = |line: &str| run_line(folder.path(), line);
        for (line, status, expected) in [
            ("oiio-maketx ./a.png", 0, ""),
            ("maketx -profile oiio -v ./a.png -o ./b.exr", 0, "Message:   wrote"),
            ("oiio-maketx -u ./a.png -o ./u.tx", 0, ""),
            ("oiio-maketx -u ./a.png -o ./u.tx", 0, "Message: maketx: no update required for"),
            ("oiio-maketx ./none.png", 1, "Message: make_texture ERROR: "),
            ("oiio-maketx ./a.png -o ./c.png", 1, "does not support tiled images"),
            ("oiio-maketx ./a.png -o ./c.foo", 1, "no format is known"),
            ("oiio-maketx --shadow --prman ./a.png -o ./s.tx", 0, ""),
            ("oiio-maketx --colorconvert a b ./a.png", 1, ""),
            ("oiio-maketx --colorconvert sRGB ACEScg --unpremult ./a.png -o ./e.tx", 0, ""),
            ("maketx -colorconvert srgb ACEScct ./a.png -o ./f.tx", 0, ""),
            ("maketx -colorconfig ./none.ocio -colorconvert srgb linear ./a.png", 2, ""),
            ("oiio-maketx", 0, ""),
            ("maketx ./none.png", 2, "Error: "),
            ("maketx -profile txmake -newer ./a.png ./t.tex", 0, ""),
            ("maketx -profile txmake -newer -verbose ./a.png ./t.tex", 0, "is newer than its inputs"),
            ("maketx -profile txmake -blur 3 ./a.png ./t.tex", 2, ""),
            ("maketx -nchannels 2 -filter lanczos3 ./a.png -o ./d.tx", 0, ""),
        ] {
            let (got, text) = run(line);
            assert!(got == status && text.contains(expected), "{line}: {got} {text}");
        }
        for name in ["a.tx", "b.exr", "u.tx", "s.tx", "t.tex", "d.tx", "e.tx", "f.tx"] {
            assert!(folder.path().join(name).exists(), "{name}");
        }
    }
}
