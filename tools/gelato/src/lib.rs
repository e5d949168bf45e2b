// tidy: long: the table of all options, from which parser, help and the options of workers come
//! The renderer. It reads scene files and writes their images (reference 6.1).

#![forbid(unsafe_code)]

mod again;
mod frames;
mod gpu;
mod joining;
mod listing;
mod manual;
mod pack;
mod packed;
mod passes;
mod progress;
mod relight;
mod statistics;
mod submit;
mod trade;
mod viewer;

use clap::Parser;
use granita_base::{Environment, Reporter, Severity, Supervisor};
use granita_cli::{
    Bar, Ending, Fence, Given, Status, console_reporter, environment, fence, parse_with_given, reporter_with,
    seconds,
};
use granita_farm::FrameRange;
use granita_inputs::{OwnTools, RunOptions};
use granita_session::{
    Connection, Desk, ExtraOutput, LookOptions, Outcome, Session, SessionError, SessionOptions,
    SharedProgress, Told, Up, Viewer, archive_calls,
};
use joining::Streams;
use progress::{Lines, ShownProgress};
use relight::Relight;
use std::ffi::OsString;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use viewer::Display;

/// Renders scenes.
///
/// Several files are read as one scene. "-" reads standard input.
#[derive(Parser, Debug)]
#[command(name = "gelato", after_help = AFTER_HELP)]
struct Options {
    /// Scene files, or generators with their arguments ("pyg < program"), in the order of reading
    #[arg(value_name = "FILE")]
    files: Vec<String>,

    /// Print statistics after rendering
    #[arg(long)]
    statistics: bool,

    /// Write the statistics to this file as JSON
    #[arg(long, value_name = "FILE")]
    statistics_json: Option<PathBuf>,

    /// Number of threads that render; by default that of the scene, or one per core
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    threads: usize,

    /// Machines that render the frame together, reached by ssh; "local" is this one. Several are separated by blanks,
    /// or given by several -net. listen[:[HOST:]PORT]: wait for workers that join; slurm:N, mpi:N, hosts:FILE,
    /// "cmd:COMMAND": start workers
    #[arg(long, value_name = "SERVER")]
    net: Vec<String>,

    /// Render buckets for another gelato: the one that started this one, or that of -join
    #[arg(long, conflicts_with_all = ["stream", "net", "relight"])]
    worker: bool,

    /// With -worker: connect to the gelato that listens there (-net listen), and render what it renders; the port is
    /// 14159 by default
    #[arg(long, value_name = "HOST[:PORT]", requires = "worker", conflicts_with = "files")]
    join: Option<String>,

    /// A file with the secret that a listening gelato and its workers share, instead of $GRANITA_NET_SECRET. A
    /// listening gelato makes one where there is none
    #[arg(long, value_name = "FILE")]
    secret: Option<PathBuf>,

    /// Render these frames one after the other: 7, 1-240, 240-1, 1-240x4, or several with commas. #### and %04d in the
    /// names of files, and $frame and $frame4 in these names and in the scene, are replaced by the number
    #[arg(long, value_name = "FRAMES", conflicts_with_all = ["stream", "worker", "relight", "turntable"],
          allow_negative_numbers = true, allow_hyphen_values = true)]
    frames: Option<FrameRange>,

    /// The number of frames of a task, for -task and -submit
    #[arg(long, value_name = "N", requires = "frames", value_parser = clap::value_parser!(u32).range(1..))]
    chunk: Option<u32>,

    /// Render only the frames of this task, counted from 0
    #[arg(long, value_name = "N", requires = "frames")]
    task: Option<u32>,

    /// Write the job of -frames, or of a job file, for this engine, and submit it
    #[arg(long, value_name = "ENGINE", value_parser = ["slurm", "openjd"], conflicts_with_all = ["stream", "worker", "relight"])]
    submit: Option<String>,

    /// Print the files that the scene needs and those that it writes as JSON, with hashes, and render nothing
    #[arg(long, conflicts_with_all = ["stream", "worker", "relight", "frames", "submit"])]
    assets: bool,

    /// Copy everything that the scene reads, with -frames for all frames, to this new folder, and render nothing. The
    /// scene renders to the same images there
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["stream", "worker", "relight", "assets", "submit", "task",
          "chunk", "up_to_date"])]
    pack: Option<PathBuf>,

    /// Render only what is not up to date: a frame whose images are newer than everything that it reads is left out. A
    /// scene that runs commands is always rendered
    #[arg(short = 'u', conflicts_with_all = ["stream", "worker", "relight", "assets"])]
    up_to_date: bool,

    /// Print the progress as lines for an engine: percent ("progress: 45 %") or openjd
    #[arg(long, value_name = "STYLE", value_parser = ["percent", "openjd"])]
    progress: Option<String>,

    /// Another frame is going to be rendered by the same workers
    #[arg(long, hide = true)]
    more: bool,

    /// With -join: this worker has worked before, so that no more work is not an error
    #[arg(long, hide = true, requires = "join")]
    again: bool,

    /// The number of the frame
    #[arg(long, hide = true, allow_negative_numbers = true)]
    number: Option<i32>,

    /// The share of this process in the progress, in percent: the part that was done before, and its own part
    #[arg(long, hide = true, num_args = 2)]
    share: Vec<f64>,

    /// Show the image while it is rendered in a viewer that listens there: iv, tev, or another program with tev's
    /// protocol;
    /// the port is 14158 by default. Or the screen for the iv of -iv, in the place of $DISPLAY: [HOST]:NUMBER[.SCREEN],
    /// with a number below 100
    #[arg(long, value_name = "HOST[:PORT]")]
    display: Option<Display>,

    /// Make the image of this number of passes: frames whose random numbers differ, and whose mean the image is
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    passes: Option<u32>,

    /// Let the passes of -passes have points this many times as close on surfaces: 1, 2, 4, 8, 16 or 32. It makes again
    /// what -seconds made with as fine surfaces
    #[arg(long, value_name = "F", value_parser = passes::finer, requires = "passes",
          conflicts_with_all = ["error", "draft", "review", "final_"])]
    finer: Option<u32>,

    /// Let the passes of -passes have P times the samples of pixels, and S times those of lights and rays: 1, 4 or 16
    /// (without S 1). It makes again what -seconds made with as many
    #[arg(long, value_name = "P,S", value_parser = passes::larger, requires = "passes",
          conflicts_with_all = ["error", "draft", "review", "final_"])]
    larger: Option<[u32; 2]>,

    /// Make the best image in this number of seconds: as many passes as end in time, at least one, with finer surfaces
    /// and more samples in each where these pay more than passes
    #[arg(long, value_name = "T", value_parser = passes::duration, allow_negative_numbers = true)]
    seconds: Option<f64>,

    /// Make the best image until this time of the day, on the clock of this machine
    #[arg(long, value_name = "HH:MM", value_parser = passes::time_of_day, conflicts_with = "seconds")]
    until: Option<passes::TimeOfDay>,

    /// Make passes until the error of the image is below this percentage of its mean, with more of them where they pay
    /// most
    #[arg(long, value_name = "E%", value_parser = passes::error, allow_negative_numbers = true)]
    error: Option<f32>,

    /// The same as -error 8%
    #[arg(long, conflicts_with_all = ["error", "review", "final_"])]
    draft: bool,

    /// The same as -error 3%
    #[arg(long, conflicts_with_all = ["error", "final_"])]
    review: bool,

    /// The same as -error 1%
    #[arg(long = "final", conflicts_with = "error")]
    final_: bool,

    /// Measure what the noise of an image of passes comes from (edges, motion, lens, lights, ...), with one more pass
    /// for each
    #[arg(long)]
    causes: bool,

    /// Remove the noise that is left in images with colours, with Intel's library Open Image Denoise
    #[arg(long, conflicts_with = "safe")]
    denoise: bool,

    /// Measure which settings reach an error (that of -error, by default 2%) or use a time (-seconds) best, on crops of
    /// the image, and write them to SCENE.trade.pyg and SCENE.trade.svg
    #[arg(long, conflicts_with_all = ["stream", "worker", "relight", "frames", "submit", "assets", "pack", "up_to_date",
          "turntable", "safe"])]
    trade: bool,

    /// Make only the images of -o, and none of the scene
    #[arg(long, requires = "output")]
    only: bool,

    /// Set an attribute of the scene, and ignore what the scene sets it to; may be given several times:
    /// -set spatialquality=8,8
    #[arg(long, value_name = "NAME=VALUE", value_parser = granita_session::attribute_from_text)]
    set: Vec<granita_base::Param>,

    /// Change to this folder before anything else
    #[arg(long, value_name = "PATH")]
    cwd: Option<PathBuf>,

    /// Set an environment variable first
    #[arg(long, value_name = "VAR=VALUE")]
    env: Vec<String>,

    /// Print nothing but errors
    #[arg(long)]
    silent: bool,

    /// 0: errors only; 1: also warnings and progress; 2: also information
    #[arg(long, value_name = "N")]
    verbosity: Option<u8>,

    /// Preview mode, unless 0: renders fast and coarsely, with this shading quality
    #[arg(long, value_name = "P", default_value_t = 0.0, hide_default_value = true, value_parser = quality)]
    preview: f32,

    /// gsl: the shaders of the scene; the others: simple shading without lights
    #[arg(long, value_name = "NAME", value_parser = ["gsl", "defaultsurface", "keyfillrim"])]
    shade: Option<String>,

    /// Show the image in a window of iv while it is rendered
    #[arg(long)]
    iv: bool,

    /// Edit the lights while the image is shown, in a page of the browser; with -iv, in a window. The edits are saved
    /// as Pyg, which is rendered after the scene: gelato SCENE.pyg SCENE.lights.pyg
    #[arg(long, conflicts_with_all = ["stream", "net", "turntable"])]
    relight: bool,

    /// Write the image also to this file, in the format of its extension
    #[arg(short = 'o', value_name = "IMAGE")]
    output: Vec<String>,

    /// Data that -o and -iv show: "rgba", "first", "all", "z", "normal N" ...
    #[arg(long, value_name = "CHANNEL", default_value = "rgba")]
    data: String,

    /// Render only this part of the image, as fractions of it: xmin xmax ymin ymax
    #[arg(long, num_args = 4, value_names = ["XMIN", "XMAX", "YMIN", "YMAX"], allow_negative_numbers = true)]
    crop: Vec<f32>,

    /// Of a file of objects: write this number of images, for one turn of the objects
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=9999))]
    turntable: Option<u32>,

    /// Of a file of objects: the axis that points up
    #[arg(long, value_name = "AXIS", value_parser = ["y", "z"])]
    up: Option<String>,

    /// Receive calls from the program that started this one: binary frames on standard input, answers on standard
    /// output
    #[arg(long, conflicts_with = "files")]
    stream: bool,

    /// With -stream: write the calls as Pyg to this file ("-": into the answers), and render nothing
    #[arg(long, hide = true, value_name = "FILE", requires = "stream")]
    archive: Option<PathBuf>,

    /// With -stream: send messages as frames instead of writing them to standard error
    #[arg(long, hide = true, requires = "stream")]
    messages: bool,

    /// Print where the manual is, and open it in a browser
    #[arg(long)]
    manual: bool,

    /// Work for the program that started this one, which goes on meanwhile
    #[arg(long, hide = true, conflicts_with_all = ["files", "stream", "worker", "net", "relight"])]
    remote: bool,

    /// End the run after this number of seconds, with all programs that it started, and exit with status 1
    #[arg(long, value_name = "SECONDS", value_parser = seconds)]
    timeout: Option<f64>,

    /// Keep the images of a frame that Ctrl-C, a signal or -timeout ends early, as partial images: NAME.partial.EXT for
    /// NAME.EXT
    #[arg(long)]
    keeppartial: bool,

    /// A folder of plugins, or a library, which is used before bundled ones; may be repeated
    #[arg(long, value_name = "PATH")]
    plugins: Vec<PathBuf>,

    /// Compile what shaders compute at many points with the system's C compiler ($CC, or cc), in the background. The
    /// pixels are the same
    #[arg(long, conflicts_with = "safe")]
    native: bool,

    /// The device that traces large batches of rays: auto, off, or its number. Pixels are the same. Or list: print the
    /// adapters of this machine; selftest[:N]: compare the arithmetic of an adapter with that of the CPU
    #[arg(long, value_name = "WHICH", conflicts_with = "safe", value_parser = gpu::word)]
    gpu: Option<String>,

    /// For untrusted scenes: run no scripts, plugins and programs, read below the scene's folder only, write below one
    /// folder only
    #[arg(long)]
    safe: bool,

    /// The folder that -safe lets scenes write to; by default one beside the scene, a.out for a.pyg
    #[arg(long, value_name = "DIR", requires = "safe")]
    safeout: Option<PathBuf>,

    /// Do not have the kernel enforce -safe as well
    #[arg(long, hide = true, requires = "safe")]
    nofence: bool,
}

/// The options that are not passed to workers, each with the reason. Workers render the same image without them.
const NOT_FOR_WORKERS: [(&str, &str); 43] = [
    ("statistics", "the coordinator prints them"),
    ("statistics_json", "the coordinator writes them"),
    ("net", "a worker has no workers"),
    ("worker", "the session says it first"),
    ("assets", "nothing is rendered"),
    ("pack", "nothing is rendered"),
    ("up_to_date", "the coordinator decides it"),
    ("frames", "each frame has its own workers"),
    ("chunk", "each frame has its own workers"),
    ("task", "each frame has its own workers"),
    ("submit", "nothing is rendered"),
    ("progress", "the coordinator prints it"),
    ("share", "the coordinator prints it"),
    ("more", "the coordinator says it at the end"),
    ("again", "it is for workers that connect by themselves"),
    ("join", "it is for workers that connect by themselves"),
    ("secret", "only its coordinator knows the worker"),
    ("display", "a worker shows nothing; -iv stands for the image that is shown"),
    ("iv", "passed once, where the image is shown by -display as well"),
    ("relight", "the edits of a desk do not reach workers"),
    ("cwd", "a worker is started in the folder that the coordinator changed to"),
    ("silent", "passed always"),
    ("verbosity", "messages about the frame are the coordinator's"),
    ("stream", "a scene that is no file has no workers"),
    ("archive", "nothing is rendered"),
    ("messages", "a scene that is no file has no workers"),
    ("manual", "nothing is rendered"),
    ("remote", "a scene that is no file has no workers"),
    ("timeout", "workers end with the coordinator"),
    ("keeppartial", "the coordinator writes the images"),
    ("passes", "the coordinator renders them"),
    ("finer", "the coordinator renders the passes"),
    ("larger", "the coordinator renders the passes"),
    ("seconds", "the coordinator renders the passes"),
    ("until", "the coordinator renders the passes"),
    ("error", "the coordinator renders the passes"),
    ("draft", "the coordinator renders the passes"),
    ("review", "the coordinator renders the passes"),
    ("final_", "the coordinator renders the passes"),
    ("causes", "the coordinator renders the passes"),
    ("trade", "nothing is rendered for others"),
    ("nofence", "a safe run has no workers"),
    ("gpu", "another machine has other devices, and the pixels are the same"),
];

const AFTER_HELP: &str = "\
Options may stand anywhere and begin with one dash or two. $GELATOHOME/.gelato.pyg and $HOME/.gelato.pyg are read first.
Exit status: 0 without errors; 1 an image was rendered, with errors; 2 nothing was rendered.";

/// Returns the table of the options.
pub fn command() -> clap::Command {
    granita_cli::command::<Options>()
}

/// Runs the tool. `words` begins with the name by which it was called. `tools` holds the names of the tools that this
/// program runs as `--as NAME`.
pub fn main(words: Vec<OsString>, tools: &[&str]) -> Status {
    let (options, given): (Options, Vec<Given>) = parse_with_given(words);
    let is_again = options.again;
    let (options, given, streams) = match joining::streams(options, given) {
        Ok(all) => all,
        Err(_) if is_again => return Status::Done,
        Err(what) => {
            console_reporter("gelato -worker", &Bar::new(false)).error(what);
            return Status::Failed;
        }
    };
    let quiet = options.silent || options.verbosity == Some(0);
    let bar = Bar::new(!quiet);
    let answers = Connection::new(Box::new(std::io::stdout()));
    let told = options.remote.then(|| Told::new(Box::new(std::io::stdout())));
    let reporter = if let Some(told) = &told {
        told.reporter()
    } else if options.messages {
        answers.reporter()
    } else if options.stream {
        let answers = answers.clone();
        reporter_with("gelato", &bar, move |text| answers.print(text))
    } else if options.worker {
        // Standard output carries the data for the coordinator. Messages go to standard error.
        reporter_with("gelato -worker", &bar, |text| {
            let _ = std::io::stderr().write_all(text.as_bytes());
        })
    } else {
        console_reporter("gelato", &bar)
    };
    if options.silent {
        reporter.set_verbosity(0);
    }
    if options.manual {
        return manual::show(&reporter);
    }
    if let Some(status) = options.gpu.as_deref().and_then(|word| gpu::instead(word, &reporter)) {
        return status;
    }
    let ending = Ending::new(bar.clone());
    ending.watch(options.stream || options.worker && streams.is_none() || options.remote, &reporter);
    // A frame of "-frames" ends with its task, also where an engine kills only that.
    if options.number.is_some() && !options.worker {
        ending.watch_parent(&reporter);
    }
    if let Some(seconds) = options.timeout {
        ending.limit(seconds, &reporter);
    }
    let status = if options.submit.is_some() {
        submit::run(&options, &given, &reporter)
    } else if options.trade {
        trade::run(&options, &given, ending.supervisor(), &reporter)
    } else if options.frames.is_some() && options.pack.is_none() {
        frames::run(&options, &given, ending.supervisor(), &reporter)
    } else {
        run(&options, &given, tools, Voices { reporter, bar, answers, told, streams }, &ending)
    };
    if ending.supervisor().has_ended() && !ending.is_late() {
        granita_cli::wait_for_end();
    }
    if ending.is_late() {
        ending.supervisor().end();
    }
    ending.supervisor().release();
    if ending.is_late() { Status::WithErrors } else { status }
}

/// The channels for the messages and the output of a run.
struct Voices {
    reporter: Reporter,
    bar: Bar,
    answers: Connection,
    told: Option<Told>,
    /// The connection to the coordinator that a worker joined.
    streams: Option<Streams>,
}

/// Runs the tool with the options.
fn run(options: &Options, given: &[Given], tools: &[&str], voices: Voices, ending: &Ending) -> Status {
    let Voices { reporter, bar, answers, told, streams } = voices;
    let mut surroundings = match Surroundings::new(options) {
        Ok(surroundings) => surroundings,
        Err(error) => {
            reporter.error(error);
            return Status::Failed;
        }
    };
    if let Some(file) = &options.archive {
        return archive(file, &surroundings.variables, &answers, &reporter);
    }
    let supervisor = ending.supervisor().clone();
    let relight = match options.relight.then(|| prepare(options, &surroundings.variables, tools)).transpose()
    {
        Ok(relight) => relight,
        Err(what) => {
            reporter.error(what);
            return Status::Failed;
        }
    };
    let secret = match joining::secret(options, &surroundings.variables) {
        Ok(secret) => secret,
        Err(what) => {
            reporter.error(what);
            return Status::Failed;
        }
    };
    let startup = surroundings.startup.take();
    let mut session_options = session_options(options, given, tools, surroundings, supervisor.clone());
    (session_options.net_secret, session_options.startup_files) = (secret, startup);
    match gpu::accelerator(options.gpu.as_deref().unwrap_or("off"), &reporter) {
        Ok(accelerator) => session_options.accelerator = accelerator,
        Err(what) => {
            reporter.error(format!("-gpu: {what}"));
            return Status::Failed;
        }
    }
    if let Some(folder) = &options.pack {
        let frames = options.frames.as_ref();
        return pack::run(session_options, &options.files, frames, folder, (&supervisor, &reporter));
    }
    if options.assets {
        return listing::print(session_options, &options.files, &reporter);
    }
    if options.up_to_date && listing::needs_nothing(session_options.clone(), &options.files) {
        reporter.info(format!("{}: up to date", options.files.join(" ")));
        return Status::Done;
    }
    if let Some(told) = told {
        let session = Session::new(session_options, reporter, told.progress());
        ending.stops(session.stop());
        return status(&session.obey(Box::new(std::io::stdin()), &told), false);
    }
    let session = if options.worker {
        let Streams { input, output, ended } = streams.unwrap_or_else(Streams::standard);
        Session::worker(session_options, reporter.clone(), input, output, ended(supervisor))
    } else {
        let lines = Lines::new(options.progress.as_deref(), &options.share);
        let progress = SharedProgress(Arc::new(ShownProgress::new(bar, reporter.clone(), lines)));
        Session::new(session_options, reporter.clone(), progress)
    };
    if let Some(path) = &options.statistics_json {
        session.files().grant_output(path);
    }
    if options.safe
        && !options.nofence
        && let Err(what) = enforce(&session, &reporter)
    {
        reporter.error(format!("-safe: {what}"));
        return Status::Failed;
    }
    ending.stops(session.stop());
    ending.keeps(session.busy());
    render(options, session, &answers, &reporter, relight.as_ref())
}

/// Prepares a desk, with the viewer of the options.
fn prepare(options: &Options, variables: &Environment, tools: &[&str]) -> Result<Relight, String> {
    let (screen, own) = (variables.get("DISPLAY"), tools.contains(&"iv"));
    let find = || viewer::find(options.display.as_ref(), screen, !options.safe, own);
    relight::begin(options, variables, &find, own)
}

/// The environment variables of a run.
struct Surroundings {
    variables: Environment,
    /// The variables that are also set for the programs which the scene starts.
    of_programs: Vec<(String, String)>,
    /// The startup files of a packed scene.
    startup: Option<Vec<PathBuf>>,
    /// The plugins of a packed scene.
    plugins: Vec<PathBuf>,
}

impl Surroundings {
    /// Changes the folder, sets the variables and checks the options that can be checked before rendering. All paths
    /// are resolved after the change of folder.
    ///
    /// # Errors
    /// Returns a message when an option is invalid.
    fn new(options: &Options) -> Result<Self, String> {
        if let Some(folder) = &options.cwd {
            std::env::set_current_dir(folder)
                .map_err(|error| format!("-cwd {}: {error}", folder.display()))?;
        }
        let mut variables = environment();
        // An unknown current folder is reported by what needs it.
        let here = std::env::current_dir().unwrap_or_default();
        let list = packed::PackList::read(&here)?;
        let startup = list.as_ref().map(|list| list.enter(&here, &mut variables));
        let plugins = list.as_ref().map(|list| list.plugins.clone()).unwrap_or_default();
        let of_pack = list.into_iter().flat_map(|list| list.variables);
        if let Some(number) = options.number {
            variables.set("frame", number.to_string());
        }
        let number = options.number.iter().map(|number| ("frame".to_owned(), number.to_string()));
        let mut of_programs: Vec<(String, String)> = of_pack.chain(number).collect();
        for assignment in &options.env {
            let Some((name, value)) = assignment.split_once('=').filter(|(name, _)| !name.is_empty()) else {
                return Err(format!("-env {assignment}: expected VAR=VALUE"));
            };
            variables.set(name, value);
            of_programs.push((name.to_owned(), value.to_owned()));
        }
        // A missing folder is reported before hours of rendering, not after.
        if let Some(folder) = options.statistics_json.as_deref().and_then(Path::parent)
            && !folder.as_os_str().is_empty()
            && !folder.is_dir()
        {
            return Err(format!("-statistics-json: there is no folder {}", folder.display()));
        }
        if options.files.is_empty() && !options.stream && !options.remote {
            return Err("no scene file was given (try -help)".to_owned());
        }
        Ok(Self { variables, of_programs, startup, plugins })
    }
}

/// Returns the options of a session, from those of the command line.
fn session_options(
    options: &Options,
    given: &[Given],
    tools: &[&str],
    surroundings: Surroundings,
    supervisor: Supervisor,
) -> SessionOptions {
    let extra = |name: &String| ExtraOutput { name: name.clone(), format: None, data: options.data.clone() };
    let (display, layers) = (options.display.clone(), !options.safe);
    let screen = surroundings.variables.get("DISPLAY").map(str::to_owned);
    let own = tools.contains(&"iv");
    let find = move || viewer::find(display.as_ref(), screen.as_deref(), layers, own);
    let viewer = match options.safe {
        // The viewer starts before the fence is set up, and only when the user requests one.
        true if options.is_shown() && !options.relight => {
            let found = find();
            Viewer(Some(Arc::new(move || found.clone())))
        }
        true => Viewer(None),
        false => Viewer(Some(Arc::new(find))),
    };
    let run = RunOptions {
        environment: surroundings.variables,
        program_environment: surroundings.of_programs,
        programs_print_to_stderr: options.stream || options.worker || options.remote,
        own_tools: std::env::current_exe().ok().map(|program| OwnTools {
            program,
            names: tools.iter().map(|name| (*name).to_owned()).collect(),
        }),
        plugins: options.plugins.iter().chain(&surroundings.plugins).cloned().collect(),
        plugins_from_current_folder: true,
        safe: options.safe,
        supervisor,
    };
    SessionOptions {
        run,
        // An unknown folder has an empty path. Starting a worker there is then an error.
        current_folder: std::env::current_dir().unwrap_or_default(),
        threads: options.threads,
        default_threads: std::thread::available_parallelism().map_or(1, Into::into),
        open_files: granita_cli::open_files_limit(),
        verbosity: if options.silent { Some(0) } else { options.verbosity },
        statistics: i32::from(options.statistics),
        set: options.set.clone(),
        only_extra_outputs: options.only,
        crop: <[f32; 4]>::try_from(options.crop.as_slice()).ok(),
        preview: options.preview,
        shadertype: options.shade.clone(),
        extra_outputs: options.output.iter().map(extra).chain(options.shown()).collect(),
        keep_partial: options.keeppartial,
        passes: options.passes(),
        viewer,
        no_startup_files: false,
        startup_files: None,
        net_stays: options.more,
        safe_output: options.safeout.clone(),
        scene_files: options.files.clone(),
        look: LookOptions {
            turntable: options.turntable.unwrap_or(0),
            up: if options.up.as_deref() == Some("z") { Up::Z } else { Up::Y },
        },
        net_workers: options.net.clone(),
        net_secret: None,
        number: options.number,
        net_arguments: options.for_worker(given).filter(|_| !options.relight),
        native: options.native,
        denoise: options.denoise,
        accelerator: None,
        rerenders_anew: false,
    }
}

/// Makes the kernel enforce "-safe".
fn enforce(session: &Session, reporter: &Reporter) -> Result<(), String> {
    match fence(session.files())? {
        Fence::Whole => reporter.info("-safe: the kernel enforces it as well"),
        Fence::Partial => reporter.info("-safe: the kernel enforces a part of it as well"),
        Fence::None => reporter.info("-safe: the kernel has no way of enforcing it as well"),
    }
    Ok(())
}

/// True for a scene that can be read only once: standard input, or a pipe with a name.
fn is_stream(file: &str) -> bool {
    let is_pipe = |metadata: std::fs::Metadata| !metadata.is_file() && !metadata.is_dir();
    matches!(file, "-" | "pyg -") || std::fs::metadata(file).is_ok_and(is_pipe)
}

/// Reads the scene files and the stream, and renders the frames that they request. Then it runs the desk, if there is
/// one.
fn render(
    options: &Options,
    mut session: Session,
    answers: &Connection,
    reporter: &Reporter,
    relight: Option<&Relight>,
) -> Status {
    let begun = session.expect_files(&options.files).and_then(|()| match relight {
        Some(relight) => {
            relight.report(reporter);
            Desk::prepare(&mut session, &relight.options).map(Some)
        }
        None => Ok(None),
    });
    let (desk, mut failed) = match begun {
        Ok(desk) => (desk, false),
        Err(error) => (None, !has_exited(error, reporter)),
    };
    for file in &options.files {
        let words: Vec<&str> = file.split_whitespace().collect();
        let result = match words.as_slice() {
            ["-"] | ["pyg", "-"] => session.read_stream("<stdin>", Box::new(std::io::stdin())),
            _ if is_stream(file) => File::open(file)
                .map_err(|error| SessionError::Failed(format!("cannot open {file}: {error}")))
                .and_then(|pipe| session.read_stream(file, Box::new(pipe))),
            _ => session.read_file(file),
        };
        match result {
            Ok(()) => (),
            Err(error) => {
                failed |= !has_exited(error, reporter);
                break;
            }
        }
    }
    if options.stream {
        let result = session.serve(&mut std::io::stdin().lock(), answers);
        failed |= result.is_err_and(|error| !has_exited(error, reporter));
    }
    if !failed && !options.stream {
        failed |= session.look().is_err_and(|error| !has_exited(error, reporter));
    }
    if let Some(desk) = desk.filter(|_| !failed) {
        failed |= desk.run(&mut session).is_err_and(|error| !has_exited(error, reporter));
    }
    let outcome = session.finish();
    if !failed && !outcome.rendered && outcome.waiting > 0 {
        reporter.warning(format!("nothing was rendered: {} primitives, but no Render ()", outcome.waiting));
    }
    // Without a frame, commands are the only effect of scene files.
    let is_void = outcome.errors > 0 && !outcome.rendered && !outcome.commanded && !options.stream;
    let mut status = status(&outcome, failed || is_void);
    if let Some(path) = &options.statistics_json {
        let document = statistics::document(&outcome, &options.files, reporter, status.code());
        if let Err(error) = statistics::write(path, &document) {
            reporter.error(format!("-statistics-json: {error}"));
            status = if status == Status::Done { Status::WithErrors } else { status };
        }
    }
    reporter.tell_summary();
    status
}

/// True when the scene ended the run itself. Other errors are reported.
fn has_exited(error: SessionError, reporter: &Reporter) -> bool {
    match error {
        SessionError::Exit => return true,
        SessionError::Scene { what, at } => reporter.say(Severity::Error, &at, what),
        other => reporter.error(other.to_string()),
    }
    false
}

/// Writes the calls of the program that started this one to a file, or into the answers.
fn archive(file: &Path, variables: &Environment, answers: &Connection, reporter: &Reporter) -> Status {
    let mut input = std::io::stdin().lock();
    let done = if file == Path::new("-") {
        archive_calls(&mut input, &mut answers.clone(), Printed(answers.clone()), reporter).map(|_| ())
    } else {
        let out = match variables.files().create(file) {
            Ok(out) => out,
            Err(error) => {
                reporter.error(error.to_string());
                return Status::Failed;
            }
        };
        archive_calls(&mut input, &mut answers.clone(), out, reporter)
            .and_then(|out| out.commit().map_err(|error| SessionError::Failed(error.to_string())))
    };
    match done {
        Ok(()) if reporter.errors() > 0 => Status::WithErrors,
        Ok(()) => Status::Done,
        Err(error) => {
            reporter.error(error.to_string());
            Status::Failed
        }
    }
}

/// Sends text that the other side prints.
struct Printed(Connection);

impl Write for Printed {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        self.0.print(&String::from_utf8_lossy(bytes));
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

impl Options {
    /// True when the user requests a viewer. A screen alone is not a request. It selects where -iv and the scene show
    /// images.
    fn is_shown(&self) -> bool {
        self.iv || matches!(self.display, Some(Display::Viewer(_)))
    }

    /// Returns the image that is shown in a viewer, named after the scene.
    fn shown(&self) -> Option<ExtraOutput> {
        // Files that only hold settings come before the scene.
        let file = self.files.last().map(|file| Path::new(file.trim()));
        let name = file.and_then(Path::file_name).map_or("gelato".into(), |name| name.to_string_lossy());
        (self.is_shown() && !self.relight).then(|| ExtraOutput {
            name: name.into_owned(),
            format: Some("iv".to_owned()),
            data: self.data.clone(),
        })
    }

    /// Returns the arguments with which another process renders the same image; `None` when the scene does not come
    /// from files. All options that were `given` are passed on except those of [`NOT_FOR_WORKERS`].
    fn for_worker(&self, given: &[Given]) -> Option<Vec<String>> {
        if self.stream || self.files.is_empty() || self.files.iter().any(|file| is_stream(file)) {
            return None;
        }
        let mut words = vec!["-silent".to_owned()];
        let passed = given.iter().filter(|given| !NOT_FOR_WORKERS.iter().any(|(id, _)| *id == given.id));
        words.extend(passed.flat_map(|given| &given.words).map(|word| word.to_string_lossy().into_owned()));
        // A worker shows nothing, but must make the same images.
        if self.shown().is_some() {
            words.push("-iv".to_owned());
        }
        words.push("--".to_owned());
        words.extend(self.files.iter().cloned());
        Some(words)
    }
}

/// Parses a shading quality.
fn quality(word: &str) -> Result<f32, String> {
    match word.parse::<f32>() {
        Ok(p) if p >= 0.0 && p.is_finite() => Ok(p),
        _ => Err("expected a number, 0 or more".to_owned()),
    }
}

/// Returns the result of the run.
fn status(outcome: &Outcome, failed: bool) -> Status {
    if failed && !outcome.rendered {
        Status::Failed
    } else if failed || outcome.errors > 0 || outcome.rendered && !outcome.complete {
        Status::WithErrors
    } else {
        Status::Done
    }
}

#[cfg(test)]
mod tests;
