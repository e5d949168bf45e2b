//! Files that are read and written.

use crate::parse::Given;
use crate::print;
use crate::stack::{Done, Entry, Fault, Machine};
use crate::table::Action;
use granita_edit::{File, Tiling, WriteOptions, write};
use granita_image::{PixelType, split_image_name};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Reads an image onto the stack.
pub(crate) fn read(machine: &mut Machine<'_>, name: &str, channels: Option<&str>) -> Done {
    let path = PathBuf::from(name);
    // The file of `name#2` stays open for its other images.
    let (path, index) = match split_image_name(name) {
        Some((file, index)) if !machine.formats.files().is_file(&path) => (PathBuf::from(file), index),
        _ => (path, 0),
    };
    let file = File::open(&path, machine.formats)?;
    let mut image = file.image(index, 0)?;
    machine.inputs.push(path);
    let mut from = Some((file, index, 0));
    if let Some(list) = channels {
        let (chosen, notes) = image.channels(list)?;
        notes.into_iter().for_each(|note| machine.reporter.warning(format!("{name}: {note}")));
        (image, from) = (chosen, None);
    }
    machine.stack.push(Entry { image, name: name.to_owned(), file: from });
    if let Some(verbose) = machine.info {
        print::info(machine, verbose)?;
    }
    if machine.stats {
        print::stats(machine)?;
    }
    Ok(())
}

/// Carries out an option about files.
pub(crate) fn act(machine: &mut Machine<'_>, given: &Given) -> Done {
    match given.row.action {
        Action::Input => read(machine, &given.values[0], given.text("ch")),
        Action::SelectLevel => select(machine, |_, image| Ok((image, given.value(0)?))),
        Action::SelectImage => select(machine, |_, _| Ok((given.value(0)?, 0))),
        Action::DropLevels => Ok(()),
        _ => output(machine, given),
    }
}

/// Replaces the last image by another one of its file. `choose` receives the image and returns the image and the level.
fn select(
    machine: &mut Machine<'_>,
    choose: impl Fn(&File, usize) -> Result<(usize, usize), String>,
) -> Done {
    let Some(top) = machine.stack.last_mut() else { return Err("there is no image".into()) };
    let Some((file, image, _)) = &top.file else {
        return Err(
            format!("{}: was changed since it was read, so that its file is not known", top.name).into()
        );
    };
    let (image, level) = choose(file, *image)?;
    top.image = file.image(image, level)?;
    top.file = Some((file.clone(), image, level));
    Ok(())
}

/// Reads a type of values.
fn pixel_type(word: &str) -> Result<PixelType, String> {
    Ok(match word.to_ascii_lowercase().as_str() {
        "uint8" | "byte" | "u8" => PixelType::U8,
        "uint16" | "short" | "u16" => PixelType::U16,
        "uint32" | "uint" | "u32" => PixelType::U32,
        "half" => PixelType::Half,
        "float" => PixelType::Float,
        _ => {
            return Err(format!("\"{word}\" is not a type; types are uint8, uint16, uint32, half and float"));
        }
    })
}

fn side(text: &str) -> Result<u32, String> {
    match text.parse() {
        Ok(n @ 1..=65_536) => Ok(n),
        _ => Err(format!("\"{text}\" is not the side of a tile, 1 to 65536 are possible")),
    }
}

/// Sets an option of files that follow.
pub(crate) fn set(options: &mut WriteOptions, given: &Given) -> Done {
    match given.row.action {
        Action::Type => options.pixel_type = Some(pixel_type(&given.values[0])?),
        Action::Compression => options.compression = Some(given.values[0].clone()),
        Action::Tile => options.tiling = Tiling::Tiles(side(&given.values[0])?, side(&given.values[1])?),
        Action::Scanline => options.tiling = Tiling::Scanlines,
        Action::Planar => {
            options.separate = match &*given.values[0] {
                "contig" => Some(false),
                "separate" => Some(true),
                "default" => None,
                other => return Err(format!("\"{other}\", contig, separate and default are possible").into()),
            };
        }
        _ => options.keep_data = true,
    }
    Ok(())
}

/// Returns the options of one file.
fn options(machine: &Machine<'_>, given: &Given) -> Result<WriteOptions, String> {
    let mut options = machine.write.clone();
    if let Some(word) = given.text("type").or_else(|| given.text("datatype")) {
        options.pixel_type = Some(pixel_type(word)?);
    }
    if let Some(name) = given.text("compression") {
        options.compression = Some(name.to_owned());
    }
    if let Some(size) = given.text("tile") {
        let (w, h) = size.split_once('x').ok_or_else(|| format!("tile={size} is not a size like 64x64"))?;
        options.tiling = Tiling::Tiles(side(w)?, side(h)?);
    }
    if given.flag("scanline", false)? {
        options.tiling = Tiling::Scanlines;
    }
    if given.text("separate").is_some() {
        options.separate = Some(given.flag("separate", true)?);
    }
    if let Some(name) = given.text("format").or_else(|| given.text("fileformatname")) {
        options.format = Some(name.to_owned());
    }
    Ok(options)
}

fn modified(path: &Path) -> Option<SystemTime> {
    std::fs::metadata(path).and_then(|m| m.modified()).ok()
}

/// Writes the last image.
fn output(machine: &mut Machine<'_>, given: &Given) -> Done {
    let path = PathBuf::from(&given.values[0]);
    let options = options(machine, given)?;
    let settings = machine.settings;
    let skipped = if settings.dry_run {
        Some("is not written, by -n")
    } else if settings.no_clobber && path.exists() {
        Some("exists, and is kept by -no-clobber")
    } else if settings.update && is_newer(&path, &machine.inputs) {
        Some("is newer than all inputs")
    } else {
        None
    };
    if let Some(why) = skipped {
        machine.outputs += 1;
        machine.reporter.info(format!("{} {why}", path.display()));
        return Ok(());
    }
    if settings.create_folder
        && let Some(folder) = path.parent().filter(|folder| !folder.as_os_str().is_empty())
    {
        std::fs::create_dir_all(folder)
            .map_err(|e| Fault::from(format!("{}: the folder cannot be made: {e}", folder.display())))?;
    }
    let image = machine.top()?;
    let notes = write(image, &path, machine.formats, &options)?;
    machine.outputs += 1;
    notes.into_iter().for_each(|note| machine.reporter.warning(note));
    let spec = machine.top()?.spec();
    machine.reporter.info(format!("wrote {}: {} x {}", path.display(), spec.width, spec.height));
    Ok(())
}

/// True when a file exists that is newer than all inputs.
fn is_newer(path: &Path, inputs: &[PathBuf]) -> bool {
    let Some(own) = modified(path) else { return false };
    !inputs.is_empty() && inputs.iter().all(|input| modified(input).is_some_and(|time| time <= own))
}
