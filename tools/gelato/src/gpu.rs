//! The option `-gpu`: lists and tests of adapters, and the device that traces rays.
//!
//! A program that was built without the feature `gpu` knows the option, and says that it lacks the rest.

use granita_base::Reporter;
use granita_cli::Status;
use granita_trace::Accelerator;
use std::sync::Arc;

/// Parses the word of `-gpu`.
pub(crate) fn word(word: &str) -> Result<String, String> {
    let number = |word: &str| word.parse::<usize>().is_ok();
    let is_known = match word.split_once(':') {
        Some(("selftest", which)) => number(which),
        Some(_) => false,
        None => matches!(word, "auto" | "off" | "list" | "selftest") || number(word),
    };
    match is_known {
        true => Ok(word.to_owned()),
        false => Err("expected auto, off, the number of an adapter, list, selftest or selftest:N".to_owned()),
    }
}

/// Runs what `-gpu` requests in place of rendering; `None` when the frame is rendered.
pub(crate) fn instead(word: &str, reporter: &Reporter) -> Option<Status> {
    match word.split_once(':').unwrap_or((word, "auto")) {
        ("list", _) => Some(device::list(reporter)),
        ("selftest", which) => Some(device::test(which, reporter)),
        _ => None,
    }
}

/// Returns the device that `-gpu` chooses; `None` when the CPU traces all rays.
///
/// # Errors
/// Returns a message when there is no such device, or the word is not valid.
pub(crate) fn accelerator(word: &str, reporter: &Reporter) -> Result<Option<Arc<dyn Accelerator>>, String> {
    if word == "off" { Ok(None) } else { device::open(word, reporter) }
}

#[cfg(not(feature = "gpu"))]
mod device {
    use super::{Accelerator, Arc, Reporter, Status};

    const WITHOUT: &str = "this gelato was built without it (cargo build --release -p gelato --features gpu)";

    pub(super) fn list(reporter: &Reporter) -> Status {
        reporter.error(format!("-gpu: {WITHOUT}"));
        Status::Failed
    }

    pub(super) fn test(_: &str, reporter: &Reporter) -> Status {
        list(reporter)
    }

    pub(super) fn open(word: &str, reporter: &Reporter) -> Result<Option<Arc<dyn Accelerator>>, String> {
        if word == "auto" {
            reporter.info(format!("-gpu auto: {WITHOUT}; the CPU traces all rays"));
            return Ok(None);
        }
        Err(WITHOUT.to_owned())
    }
}

#[cfg(feature = "gpu")]
mod device {
    use super::{Accelerator, Arc, Reporter, Status};
    use granita_gpu::{Choice, Device, GpuAccelerator, INPUTS, Limits, adapters, rays_agree, selftest};
    use std::io::Write;

    /// Prints a line. A reader that is gone needs none.
    fn print(text: &str) {
        let _ = writeln!(std::io::stdout(), "{text}");
    }

    pub(super) fn list(_: &Reporter) -> Status {
        let all = adapters();
        all.iter().for_each(|adapter| print(&adapter.to_string()));
        if all.is_empty() {
            print("no driver of Vulkan reports an adapter");
        }
        Status::Done
    }

    /// Tests an adapter: that of a number, the one that `auto` takes, or without one the first.
    pub(super) fn test(which: &str, reporter: &Reporter) -> Status {
        let failed = |error: String| {
            reporter.error(format!("-gpu selftest: {error}"));
            Status::Failed
        };
        let choice: Choice = match which.parse() {
            Ok(choice) => choice,
            Err(error) => return failed(error),
        };
        let opened = Device::open(choice, Limits::default()).and_then(|device| match device {
            None => Device::open(Choice::Index(0), Limits::default()),
            some => Ok(some),
        });
        let device = match opened {
            Ok(Some(device)) => device,
            Ok(None) => return failed("expected the number of an adapter".to_owned()),
            Err(error) => return failed(error.to_string()),
        };
        print(&device.adapter().to_string());
        let result = selftest(&device, INPUTS, &mut |agreement| print(&agreement.to_string()));
        match result {
            Ok(true) => {
                print("all hold: this adapter computes the bits of the CPU");
                Status::Done
            }
            Ok(false) => {
                reporter.error("-gpu selftest: this adapter computes other bits than the CPU");
                Status::WithErrors
            }
            Err(error) => failed(error.to_string()),
        }
    }

    pub(super) fn open(word: &str, reporter: &Reporter) -> Result<Option<Arc<dyn Accelerator>>, String> {
        let choice: Choice = word.parse()?;
        let opened = Device::open(choice, Limits::default()).map_err(|error| error.to_string())?;
        let Some(device) = opened else {
            reporter.info("-gpu auto: no adapter traces rays: the CPU does");
            return Ok(None);
        };
        let name = &device.adapter().name;
        match rays_agree(&device) {
            Ok(true) => {
                reporter.info(format!("-gpu: {name} traces rays"));
                Ok(Some(Arc::new(GpuAccelerator::new(device, reporter.clone()))))
            }
            Ok(false) => {
                reporter
                    .warning(format!("-gpu: {name} computes other bits than the CPU, which traces all rays"));
                Ok(None)
            }
            Err(error) => {
                reporter.warning(format!("-gpu: {name}: {error}; the CPU traces all rays"));
                Ok(None)
            }
        }
    }
}
