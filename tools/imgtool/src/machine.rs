//! The steps of a command line, carried out one after the other.

use crate::parse::{Given, Step};
use crate::stack::{Done, Fault, Machine};
use crate::table::Action;
use crate::{colors, files, pixels, print, shapes};

/// Carries out all steps.
///
/// # Errors
/// The first error, with the option that it is about.
pub(crate) fn run(machine: &mut Machine<'_>, steps: &[Step]) -> Done {
    for step in steps {
        match step {
            Step::Image(name) => {
                files::read(machine, name, None)?;
                after_image(machine)?;
            }
            Step::Option(given) => option(machine, given)?,
        }
    }
    match &machine.pending {
        Some(given) => {
            let (needs, has) = (given.row.images, machine.stack.len());
            Err(format!(
                "{} needs {needs} images, there {} {has}",
                given.typed,
                if has == 1 { "is" } else { "are" }
            )
            .into())
        }
        None => Ok(()),
    }
}

/// Carries out an option that waits, when its images are there.
fn after_image(machine: &mut Machine<'_>) -> Done {
    match machine.pending.take_if(|given| given.row.images <= machine.stack.len()) {
        Some(given) => option(machine, &given),
        None => Ok(()),
    }
}

fn option(machine: &mut Machine<'_>, given: &Given) -> Done {
    if machine.stack.len() < given.row.images {
        if let Some(other) = &machine.pending {
            let what = format!("{} waits for images, and {} does too", other.typed, given.typed);
            return Err(what.into());
        }
        machine.pending = Some(given.clone());
        return Ok(());
    }
    let images = machine.stack.len();
    act(machine, given).map_err(|fault| {
        let what = match fault.what.starts_with(&given.typed) {
            true => fault.what,
            false => format!("{}: {}", given.typed, fault.what),
        };
        Fault { what, ..fault }
    })?;
    if machine.stack.len() > images { after_image(machine) } else { Ok(()) }
}

fn act(machine: &mut Machine<'_>, given: &Given) -> Done {
    use Action as A;
    match given.row.action {
        A::Input | A::SelectLevel | A::DropLevels | A::SelectImage | A::Output => files::act(machine, given)?,
        A::Type | A::Compression | A::Tile | A::Scanline | A::Planar | A::KeepData => {
            files::set(&mut machine.write, given)?;
        }
        A::Info | A::Stats | A::Difference | A::Echo => print::act(machine, given)?,
        A::Fail => machine.limits.fail = given.value(0)?,
        A::FailPercent => machine.limits.fail_percent = given.value(0)?,
        A::HardFail => machine.limits.hard_fail = given.value(0)?,
        A::Warn => machine.limits.warn = given.value(0)?,
        A::WarnPercent => machine.limits.warn_percent = given.value(0)?,
        A::HardWarn => machine.limits.hard_warn = given.value(0)?,
        A::Duplicate => {
            // A computed image would be computed once for each of its copies.
            machine.hold_top()?;
            let top = machine.stack[machine.stack.len() - 1].clone();
            machine.stack.push(top);
        }
        A::Swap => {
            let n = machine.stack.len();
            machine.stack.swap(n - 1, n - 2);
        }
        A::Pop => {
            machine.stack.pop();
        }
        A::Frames
        | A::SkipBadFrames
        | A::DryRun
        | A::Update
        | A::NoClobber
        | A::CreateFolder
        | A::Memory
        | A::Threads
        | A::ColorConfig
        | A::Plugins
        | A::Safe
        | A::NoFence
        | A::Verbose
        | A::Quiet => (),
        A::ColorConvert | A::ToColorSpace | A::IsColorSpace | A::DisplayView | A::Look | A::FileTransform => {
            colors::act(machine, given)?
        }
        A::Create
        | A::Pattern
        | A::Resize
        | A::Resample
        | A::Fit
        | A::Crop
        | A::CropToFull
        | A::Cut
        | A::Trim
        | A::Origin
        | A::OriginOffset
        | A::FullSize
        | A::FullPixels
        | A::Paste
        | A::Mosaic
        | A::Flip
        | A::Flop
        | A::Rotate90
        | A::Rotate180
        | A::Rotate270
        | A::Transpose
        | A::Shift
        | A::Reorient
        | A::Orientation
        | A::Environment => shapes::act(machine, given)?,
        _ => pixels::act(machine, given)?,
    }
    Ok(())
}
