//! Makes textures, which is the work of `maketx` (reference 9.1).

mod banded;
mod bump;
mod color;
mod convert;
mod directions;
mod distribution;
mod environment;
mod flat;
mod input;
mod kernel;
mod options;
mod output;
mod picture;
mod reduction;
mod scan;
mod shadow;
mod source;
mod sphere;
mod stream;
mod surround;
mod whole;
mod writer;

pub use color::ColorConvert;
pub use directions::{Directions, Panorama};
pub use flat::{
    Bump, BumpFormat, Conventions, Distribution, FlatOptions, Frame, Neighbour, NormalRange, SlopeFilter,
};
pub use kernel::{Kernel, LevelFilter};
pub use options::{BrokenValues, Costs, Made, MakeOptions, Mode};

use crate::TextureKind;
use crate::Wrap;
use crate::error::{Result, TextureError};
use environment::Cubes;
use granita_base::Filter;
use granita_base::files::is_same_file;
use granita_image::{FormatRegistry, Limits};
use input::Input;
use output::Texture;
use source::Source;
use std::path::{Path, PathBuf};
use std::time::{Instant, SystemTime};

/// Receives the number of steps done and of all steps, in order.
pub type Progress<'a> = &'a (dyn Fn(u64, u64) + Sync);

/// Makes the texture `output` from `inputs`. Their number is [`Mode::inputs`] or [`Mode::other_inputs`]. For
/// [`Mode::ShadCube`] an input called "-" is an empty face.
///
/// Plain textures, and latitude-longitude maps of one image with the box filter, are made while their rows are read,
/// with some hundred rows in memory. For plain ones that repeat in t, with another filter than the box, all rows are
/// kept until the last. Plain textures by the conventions of OpenImageIO are made from rows that are read twice, with
/// two levels after the first in memory, unless an option needs the whole image. Others are made in memory as a whole
/// (see [`MakeOptions::memory_bytes`]).
///
/// The result does not depend on the number of threads. The file appears complete or not at all.
///
/// # Errors
/// Returns an error when an input cannot be read or is not suitable for the mode, when options contradict each
/// other, when the format cannot store tiles and MIP levels, when the output cannot be written, or when more memory
/// is needed than is permitted.
pub fn make(
    inputs: &[PathBuf],
    output: &Path,
    options: &MakeOptions,
    registry: &FormatRegistry,
    progress: Progress<'_>,
) -> Result<Made> {
    make_measured(inputs, output, options, registry, progress).map(|(made, _)| made)
}

/// Does the same as [`make`], and returns its costs.
///
/// # Errors
/// The errors are those of [`make`].
pub fn make_measured(
    inputs: &[PathBuf],
    output: &Path,
    options: &MakeOptions,
    registry: &FormatRegistry,
    progress: Progress<'_>,
) -> Result<(Made, Costs)> {
    check(inputs, options)?;
    if inputs.iter().chain(&options.flat.level_files).any(|input| is_same_file(input, output)) {
        let what = format!("{} is an input, and is not overwritten", output.display());
        return Err(TextureError::Misuse { what });
    }
    let stamp = if options.update { Some(newest(inputs, options)?) } else { None };
    if let Some(stamp) = stamp
        && has_time(output, stamp)
        && options.flat.signature.as_ref().is_none_or(|own| has_signature(output, own, registry))
    {
        return Ok((Made::UpToDate, Costs::default()));
    }
    // The file appears with its time stamp. A run that is killed later leaves no file that looks newer than its
    // inputs.
    let stamped = stamp.map(|stamp| registry.with_files(registry.files().clone().with_modified(stamp)));
    let registry = stamped.as_ref().unwrap_or(registry);
    let made = match streamed(inputs, options, registry, progress)? {
        Some(stream) => stream.make(output)?,
        None => {
            check_memory(inputs, options, registry)?;
            let start = Instant::now();
            let texture = read(inputs, options, registry)?;
            let read = start.elapsed();
            let (made, costs) = output::write(texture, output, options, registry, progress)?;
            (made, Costs { read, ..costs })
        }
    };
    // Plugins write their files themselves.
    if let Some(stamp) = stamp
        && !has_time(output, stamp)
    {
        std::fs::File::options()
            .append(true)
            .open(output)
            .and_then(|file| file.set_modified(stamp))
            .map_err(|source| TextureError::Io { path: output.to_owned(), source })?;
    }
    Ok(made)
}

/// True when a file of this name was changed last at this time.
fn has_time(path: &Path, time: SystemTime) -> bool {
    std::fs::metadata(path).and_then(|m| m.modified()).is_ok_and(|own| own == time)
}

/// True when a texture was made with the same words, apart from the folders of files.
fn has_signature(path: &Path, signature: &str, registry: &FormatRegistry) -> bool {
    let Ok(file) = registry.open(path) else { return false };
    let old = file.spec(0, 0).and_then(|spec| spec.attributes.string("software").map(|s| s.to_string()));
    old.is_some_and(|old| without_folders(&old) == without_folders(signature))
}

/// Returns words without the folders of files. Values of metadata are not files.
fn without_folders(text: &str) -> Vec<&str> {
    let mut values = 0;
    text.split(' ')
        .map(|word| {
            let name = word.trim_start_matches('-');
            if name.len() < word.len() {
                values = if matches!(name, "attrib" | "sattrib") { 2 } else { 0 };
                return name;
            }
            if values > 0 {
                values -= 1;
                return word;
            }
            word.rsplit('/').next().unwrap_or(word)
        })
        .collect()
}

/// Returns a stream for a texture that can be made row by row.
fn streamed<'a>(
    inputs: &[PathBuf],
    options: &'a MakeOptions,
    registry: &'a FormatRegistry,
    progress: Progress<'a>,
) -> Result<Option<stream::Stream<'a>>> {
    if options.flat.needs_whole() {
        return Ok(None);
    }
    let (kind, wrap) = match options.mode {
        Mode::Plain => (TextureKind::Plain, (options.swrap, options.twrap)),
        Mode::EnvLatLong if inputs.len() == 1 && options.filter == Filter::Box => {
            (TextureKind::LatLongEnvironment, (Wrap::Periodic, Wrap::Clamp))
        }
        _ => return Ok(None),
    };
    let source = Source::open(&inputs[0], options, registry)?;
    if kind == TextureKind::LatLongEnvironment && environment::is_cube(&source.spec) {
        return Ok(None);
    }
    Ok(Some(stream::Stream { source, kind, wrap, options, registry, progress }))
}

/// Checks that a texture that is made as a whole fits into the permitted memory. The memory holds the inputs in floats,
/// and all levels of the texture, for a short time twice. Less is needed for a texture whose levels are made while they
/// are written.
fn check_memory(inputs: &[PathBuf], options: &MakeOptions, registry: &FormatRegistry) -> Result<()> {
    let exr = makes_exr(options, registry);
    let (mut bytes, mut working) = (0_u64, 0);
    let files = inputs.iter().filter(|p| !is_empty_face(p)).count();
    for path in inputs.iter().filter(|p| !is_empty_face(p)) {
        let source = Source::open(path, options, registry)?;
        let of_one = match files == 1 && banded::Rows::suit(&source, options) {
            true => banded::Rows::bytes(&source, options),
            false => whole_bytes(&source, options, exr, files),
        };
        bytes = bytes.saturating_add(of_one);
        working = source.working_bytes().max(working);
    }
    allow_memory(&inputs[0], bytes.saturating_add(working), options)
}

/// Returns the bytes of memory that one of `files` inputs takes in a texture that is made as a whole.
fn whole_bytes(source: &Source, options: &MakeOptions, exr: bool, files: usize) -> u64 {
    let (w, h) = (source.width as u64, source.height as u64);
    let side = |n: u64| match options.mode {
        Mode::Shadow | Mode::ShadCube | Mode::VolShad => n,
        _ if options.resize || exr => n.next_power_of_two(),
        _ => n,
    };
    let texture = match options.mode {
        // The texture has six faces.
        Mode::EnvCube if files == 1 && environment::is_cube(&source.spec) => side(w / 3) * side(h / 2) * 6,
        Mode::EnvCube if files == 1 => side(w / 4) * side(w / 4) * 6,
        Mode::LightProbe => side(w / 3) * side(w / 3) * 6,
        Mode::VertCross => side(w / 3) * side(h / 4) * 6,
        // The map is four faces wide and two high. Each of the six inputs counts a sixth of it.
        Mode::EnvLatLong if files > 1 => side(4 * w) * side(2 * h) / 6,
        _ => side(w) * side(h),
    };
    // All levels together have a third more texels than the first. A mosaic of them is made beside the faces, and one
    // level is stored beside that.
    let halves = match (options.flat.needs_whole(), options.hash) {
        // The first level is the image itself, and only changes of a level are beside the levels.
        (true, false) => 3,
        (_, false) => 7,
        (_, true) => 9,
    };
    let texels = (w * h).saturating_add(texture.saturating_mul(halves) / 2);
    let channels = if options.flat.bump.is_some() { 6 } else { 0 };
    let channels = source.channels.max(channels).max(options.flat.channels.unwrap_or(0));
    texels.saturating_mul(4 * channels as u64)
}

/// Returns `Ok` when the options permit so many bytes of memory, and the system grants them.
fn allow_memory(path: &Path, bytes: u64, options: &MakeOptions) -> Result<()> {
    if bytes > options.memory_bytes {
        let mib = |b: u64| b.div_ceil(1 << 20);
        return Err(TextureError::Limit {
            path: path.to_owned(),
            what: "memory needed, in MiB, which the option -memory allows,",
            asked: mib(bytes),
            max: mib(options.memory_bytes),
        });
    }
    Limits::check_memory(path, bytes)?;
    Ok(())
}

/// Checks that the options are consistent, before anything is read.
fn check(inputs: &[PathBuf], options: &MakeOptions) -> Result<()> {
    let misuse = |what: String| Err(TextureError::Misuse { what });
    let (needed, given) = (options.mode.inputs(), inputs.len());
    if needed != given && options.mode.other_inputs() != Some(given) {
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

/// Returns the time stamp of the newest input.
fn newest(inputs: &[PathBuf], options: &MakeOptions) -> Result<SystemTime> {
    let mut newest = SystemTime::UNIX_EPOCH;
    let neighbours = options.flat.neighbours.iter().map(|neighbour| &neighbour.path);
    for path in inputs.iter().filter(|p| !is_empty_face(p)).chain(neighbours) {
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
    if options.flat.needs_whole() {
        let [input] = inputs else {
            let what = "options for single images do not apply to six inputs".to_owned();
            return Err(TextureError::Misuse { what });
        };
        return whole::read(input, options, registry);
    }
    let image = |path: &PathBuf| Input::read(path, options, registry);
    let depth = |path: &PathBuf| Input::read_raw(path, options, registry);
    let images = || inputs.iter().map(image).collect::<Result<Vec<_>>>();
    let exr = makes_exr(options, registry);
    let cubes = Cubes { options, exr };
    match options.mode {
        Mode::Plain => Err(TextureError::Misuse { what: "a plain texture is streamed".to_owned() }),
        Mode::EnvLatLong => {
            let mut all = images()?;
            if all.len() == 6 || environment::is_cube(&all[0].spec) {
                environment::latlong_of_faces(all, exr, options)
            } else {
                Ok(environment::latlong(all.swap_remove(0), options))
            }
        }
        Mode::EnvCube if inputs.len() == 1 => environment::cube_of_one(image(&inputs[0])?, cubes),
        Mode::EnvCube => environment::cube(images()?, cubes),
        Mode::LightProbe => environment::light_probe(image(&inputs[0])?, cubes),
        Mode::VertCross => environment::vertical_cross(image(&inputs[0])?, cubes),
        Mode::Shadow => shadow::shadow(depth(&inputs[0])?, options),
        Mode::ShadCube => {
            let faces = inputs.iter().map(|p| if is_empty_face(p) { Ok(None) } else { depth(p).map(Some) });
            shadow::cube(faces.collect::<Result<_>>()?, options)
        }
        Mode::VolShad => shadow::volume(depth(&inputs[0])?, options),
    }
}

/// True when the texture will be an OpenEXR file.
fn makes_exr(options: &MakeOptions, registry: &FormatRegistry) -> bool {
    registry.by_name(&options.format).is_some_and(|f| f.name() == "exr")
}

/// Returns the smallest power of two that is not less than `n`.
fn power_of_two(n: usize) -> usize {
    n.next_power_of_two()
}

/// Returns notes about the inputs for the user.
fn notes_of(inputs: &[Input]) -> Vec<String> {
    inputs.iter().filter_map(|i| i.note.clone()).collect()
}
