//! Making textures: everything that `maketx` does (reference 9.1).

mod environment;
mod input;
mod options;
mod output;
mod shadow;

pub use options::{Made, MakeOptions, Mode};

use crate::TextureKind;
use crate::Wrap;
use crate::error::{Result, TextureError};
use granita_base::Filter;
use granita_image::FormatRegistry;
use input::Input;
use output::{Body, Texture};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Told how many steps of how many are done, in order.
pub type Progress<'a> = &'a (dyn Fn(u64, u64) + Sync);

/// Makes the texture `output` of `inputs`: as many as [`Mode::inputs`] says. For [`Mode::ShadCube`] an
/// input called "-" is an empty face.
///
/// The result does not depend on the number of threads. The file appears complete or not at all.
///
/// # Errors
/// When an input cannot be read or does not fit the mode, when options contradict each other, when the
/// format cannot store tiles and MIP levels, when the output cannot be written.
pub fn make(
    inputs: &[PathBuf],
    output: &Path,
    options: &MakeOptions,
    registry: &FormatRegistry,
    progress: Progress<'_>,
) -> Result<Made> {
    check(inputs, options)?;
    let stamp = if options.update { Some(newest(inputs)?) } else { None };
    if let Some(stamp) = stamp
        && std::fs::metadata(output).and_then(|m| m.modified()).is_ok_and(|time| time == stamp)
    {
        return Ok(Made::UpToDate);
    }
    let texture = read(inputs, options, registry)?;
    let made = output::write(texture, output, options, registry, progress)?;
    if let Some(stamp) = stamp {
        std::fs::File::options()
            .append(true)
            .open(output)
            .and_then(|file| file.set_modified(stamp))
            .map_err(|source| TextureError::Io { path: output.to_owned(), source })?;
    }
    Ok(made)
}

/// Whether the options make sense, before anything is read.
fn check(inputs: &[PathBuf], options: &MakeOptions) -> Result<()> {
    let misuse = |what: String| Err(TextureError::Misuse { what });
    let (needed, given) = (options.mode.inputs(), inputs.len());
    if needed != given {
        return misuse(format!(
            "{needed} input {} needed, {given} given",
            if needed == 1 { "file is" } else { "files are" }
        ));
    }
    for (name, g) in [("ingamma", options.ingamma), ("outgamma", options.outgamma)] {
        if !(g.is_finite() && g > 0.0) {
            return misuse(format!("{name} is {g}, it must be greater than 0"));
        }
    }
    if !(options.fov_deg > 0.0 && options.fov_deg < 180.0) {
        return misuse(format!(
            "the field of view is {} degrees, it must be between 0 and 180",
            options.fov_deg
        ));
    }
    if options.opaque_width.is_nan() || options.opaque_width < 0.0 {
        return misuse(format!("opaquewidth is {}, it must not be negative", options.opaque_width));
    }
    let (w, h) = options.tile_size;
    if !(1..=8192).contains(&w) || !(1..=8192).contains(&h) {
        return misuse(format!("tiles of {w} x {h} texels, 1 to 8192 are possible"));
    }
    Ok(())
}

/// Time of the newest input.
fn newest(inputs: &[PathBuf]) -> Result<SystemTime> {
    let mut newest = SystemTime::UNIX_EPOCH;
    for path in inputs.iter().filter(|p| !is_empty_face(p)) {
        let time = std::fs::metadata(path)
            .and_then(|m| m.modified())
            .map_err(|source| TextureError::Io { path: path.clone(), source })?;
        newest = newest.max(time);
    }
    Ok(newest)
}

fn is_empty_face(path: &Path) -> bool {
    path.as_os_str() == "-"
}

/// Reads the inputs and makes all levels.
fn read(inputs: &[PathBuf], options: &MakeOptions, registry: &FormatRegistry) -> Result<Texture> {
    let picture = |path: &PathBuf| Input::read(path, options, registry);
    let depth = |path: &PathBuf| Input::read_raw(path, registry);
    match options.mode {
        Mode::Plain => {
            let wrap = (options.swrap, options.twrap);
            Ok(flat(TextureKind::Plain, picture(&inputs[0])?, wrap, options))
        }
        Mode::EnvLatLong => {
            let wrap = (Wrap::Periodic, Wrap::Clamp);
            Ok(flat(TextureKind::LatLongEnvironment, picture(&inputs[0])?, wrap, options))
        }
        Mode::EnvCube => environment::cube(inputs.iter().map(picture).collect::<Result<_>>()?, options),
        Mode::LightProbe => environment::light_probe(picture(&inputs[0])?, options),
        Mode::VertCross => environment::vertical_cross(picture(&inputs[0])?, options),
        Mode::Shadow => shadow::shadow(depth(&inputs[0])?, options),
        Mode::ShadCube => {
            let faces = inputs.iter().map(|p| if is_empty_face(p) { Ok(None) } else { depth(p).map(Some) });
            shadow::cube(faces.collect::<Result<_>>()?, options)
        }
        Mode::VolShad => shadow::volume(depth(&inputs[0])?, options),
    }
}

/// A texture, or a latitude-longitude map, of one picture.
fn flat(kind: TextureKind, input: Input, wrap: (Wrap, Wrap), options: &MakeOptions) -> Texture {
    let notes = notes_of(std::slice::from_ref(&input));
    let mut picture = input.picture;
    if options.resize {
        let (w, h) = (power_of_two(picture.width), power_of_two(picture.height));
        if (w, h) != (picture.width, picture.height) {
            picture = picture.resized(w, h, Filter::CatmullRom, wrap);
        }
    }
    Texture {
        kind,
        body: Body::Flat(picture.pyramid(options.filter, wrap)),
        channels: input.channels,
        pixel_type: input.pixel_type,
        attributes: input.attributes,
        notes,
    }
}

/// The next power of two, itself included.
fn power_of_two(n: usize) -> usize {
    n.next_power_of_two()
}

/// What the user should know about the inputs.
fn notes_of(inputs: &[Input]) -> Vec<String> {
    let line = |i: &Input| format!("{}: {} values are not numbers and count as 0", i.path.display(), i.nans);
    inputs.iter().filter(|i| i.nans > 0).map(line).collect()
}
