//! `iv`, the image viewer.
//!
//! The code for images is in [`granita_view`]. Here options become values and values become text. The window (with the
//! feature `window`, which is a default feature) shows the result on the screen.

#![forbid(unsafe_code)]

mod args;
mod colors;
mod formats;
mod info;
mod json;
mod listen;
mod serve;
mod still;
#[cfg(feature = "window")]
mod window;

use args::Args;
use granita_base::{Files, Reporter};
use granita_cli::{Bar, Status, before_signals, console_reporter, parse};
use granita_image::Limits;
use granita_plugin::PluginRules;
use std::ffi::OsString;
use std::path::PathBuf;

fn run(args: &Args, reporter: &Reporter) -> Status {
    // A file may name other files, as glTF does. Only files beneath the folders of the named files are read.
    let files = Files::reading(args.files.iter().map(PathBuf::as_path));
    let rules = PluginRules { named: args.plugins.clone(), ..PluginRules::default() };
    let formats = granita_plugin::formats_with_plugins(
        Limits { files, ..Limits::default() },
        &granita_cli::environment(),
        reporter,
        rules.clone(),
        args.debugdso,
    );
    let viewing = match colors::viewing(&args.look, &granita_cli::environment(), rules, reporter) {
        Ok(viewing) => viewing,
        Err(what) => {
            reporter.error(what);
            return Status::Failed;
        }
    };
    if args.net.serve.is_some() {
        return serve::run(&args.net, &args.files, viewing, &formats, reporter);
    }
    let still = still::Still { args, formats: &formats, viewing: viewing.as_ref(), reporter };
    if let Some(status) = still.run() {
        return status;
    }
    #[cfg(feature = "window")]
    {
        watch(args, viewing, &formats, reporter)
    }
    #[cfg(not(feature = "window"))]
    {
        reporter.error("this build has no window: use an option that needs none (-help lists them)");
        Status::Failed
    }
}

/// Opens the window, which also shows the images that renderers send to it.
#[cfg(feature = "window")]
fn watch(
    args: &Args,
    viewing: Option<granita_view::Viewing>,
    formats: &granita_image::FormatRegistry,
    reporter: &Reporter,
) -> Status {
    let live = granita_view::Live::default();
    let (sender, wanted) = std::sync::mpsc::channel();
    let open: Option<Box<listen::OpenFile>> = args.net.allowopen.then(|| -> Box<listen::OpenFile> {
        Box::new(move |wanted| sender.send(wanted).map_err(|_| "the window is closed".to_owned()))
    });
    // With files and without `-listen`, the port stays free for other processes. The listener lives as long as the
    // window.
    match listen::begin(&args.net, args.files.is_empty(), &live, reporter, open) {
        Ok(_listener) => window::run(args, viewing, &live, wanted, formats, reporter),
        Err(error) => {
            reporter.error(error.to_string());
            Status::Failed
        }
    }
}

/// Returns the table of the options.
pub fn command() -> clap::Command {
    granita_cli::command::<Args>()
}

/// Runs the tool. `words` begins with the name by which it was called.
pub fn main(words: Vec<OsString>) -> Status {
    let args: Args = parse(words);
    let reporter = console_reporter("iv", &Bar::new(false));
    if let Err(error) = before_signals(|| ()) {
        reporter.warning(format!("signals cannot be handled: {error}"));
    }
    run(&args, &reporter)
}
