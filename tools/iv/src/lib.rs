//! `iv`: the image viewer.
//!
//! All that is known about pictures is in [`granita_view`]; here options become values, values become text, and the window
//! (with the feature `window`, as by default) puts on the screen what that library draws.

#![forbid(unsafe_code)]

mod args;
mod info;
mod listen;
mod serve;
mod still;
#[cfg(feature = "window")]
mod window;

use args::Args;
use granita_base::Reporter;
use granita_cli::{Bar, Status, console_reporter, parse};
use granita_image::Limits;
use std::ffi::OsString;

fn run(args: &Args, reporter: &Reporter) -> Status {
    let formats = granita_plugin::bundled_formats(Limits::default());
    if args.net.serve.is_some() {
        return serve::run(&args.net, &args.files, &formats, reporter);
    }
    let still = still::Still { args, formats: &formats, reporter };
    if let Some(status) = still.run() {
        return status;
    }
    #[cfg(feature = "window")]
    {
        let live = granita_view::Live::default();
        window::run(args, &live, &formats, reporter)
    }
    #[cfg(not(feature = "window"))]
    {
        reporter.error("there is no window in this build: choose what to do without one (-help lists it)");
        Status::Failed
    }
}

/// Runs the tool; `words` begins with the name it was called by.
pub fn main(words: Vec<OsString>) -> Status {
    let args: Args = parse(words);
    let reporter = console_reporter("iv", &Bar::new(false));
    run(&args, &reporter)
}
