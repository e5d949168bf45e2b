//! Options that make images, or change windows, sizes and orientations.

use crate::parse::Given;
use crate::stack::{Done, Fault, Machine};
use crate::table::Action;
use granita_edit::{
    FillMode, Geometry, Image, Noise, Pattern, Resampling, Turn, Window, mosaic, numbers, paste, pattern,
};
use granita_texture::Up;
use granita_texture::make::{Directions, Kernel};

/// Reads the name of a filter.
pub(crate) fn kernel(word: &str) -> Result<Kernel, String> {
    Kernel::from_word(word).ok_or_else(|| {
        let names: Vec<&str> = Kernel::NAMES.iter().map(|(name, _)| *name).collect();
        format!("\"{word}\" is not a filter; filters are {}", names.join(", "))
    })
}

/// Reads a modifier that is a list of numbers.
fn list(given: &Given, name: &str) -> Done<Option<Vec<f32>>> {
    Ok(given.text(name).map(numbers).transpose()?)
}

/// Reads the distribution of noise, by default normal numbers with a standard deviation of 0.1.
pub(crate) fn noise(given: &Given) -> Done<(Noise, bool, u32)> {
    let number = |name: &str, default: f32| given.number(name).map(|v| v.unwrap_or(default));
    let noise = match given.text("type").unwrap_or("gaussian") {
        "gaussian" => Noise::Gaussian { mean: number("mean", 0.0)?, deviation: number("stddev", 0.1)? },
        "uniform" | "white" => Noise::Uniform { min: number("min", 0.0)?, max: number("max", 0.1)? },
        "salt" => Noise::Salt { value: number("value", 0.0)?, portion: number("portion", 0.01)? },
        other => return Err(format!("type={other}, gaussian, uniform and salt are possible").into()),
    };
    Ok((noise, given.flag("mono", false)?, given.number("seed")?.unwrap_or(0)))
}

/// Returns the window of a new image.
fn new_window(text: &str) -> Done<Window> {
    let geometry = Geometry::parse(text)?;
    if geometry.size.is_none() {
        return Err(format!("\"{text}\" has no size").into());
    }
    Ok(geometry.window(&Window { x: 0, y: 0, width: 1, height: 1 })?)
}

/// Returns the pattern that an option names.
fn named_pattern(given: &Given) -> Done<Pattern> {
    let color = |names: &[&str], default: f32| -> Done<Vec<f32>> {
        for name in names {
            if let Some(list) = list(given, name)? {
                return Ok(list);
            }
        }
        Ok(vec![default])
    };
    Ok(match &*given.values[0] {
        "black" => Pattern::Constant(vec![0.0]),
        "constant" => Pattern::Constant(color(&["color"], 1.0)?),
        "checker" => {
            let side = |name: &str, default: u32| given.number(name).map(|n| n.unwrap_or(default));
            let width = side("width", 8)?;
            Pattern::Checker {
                size: (width, side("height", width)?),
                colors: [color(&["color1"], 0.0)?, color(&["color2"], 1.0)?],
                offset: (given.number("xoffset")?.unwrap_or(0), given.number("yoffset")?.unwrap_or(0)),
            }
        }
        "fill" => Pattern::Fill([
            color(&["topleft", "top", "left", "color"], 1.0)?,
            color(&["topright", "top", "right", "color"], 1.0)?,
            color(&["bottomleft", "bottom", "left", "color"], 1.0)?,
            color(&["bottomright", "bottom", "right", "color"], 1.0)?,
        ]),
        "noise" => {
            let (noise, mono, seed) = noise(given)?;
            Pattern::Noise { noise, mono, seed }
        }
        other => {
            return Err(format!(
                "\"{other}\" is not a pattern; patterns are black, constant, checker, fill and noise"
            )
            .into());
        }
    })
}

/// Returns a position like `+10-20`.
fn position(text: &str) -> Done<(i64, i64)> {
    let geometry = Geometry::parse(text)?;
    match (geometry.size, geometry.at) {
        (None, Some(at)) => Ok(at),
        _ => Err(format!("\"{text}\" is not a position like +10-20").into()),
    }
}

/// Returns the width and height of a text like `3x2`.
fn pair<T: std::str::FromStr>(text: &str) -> Result<(T, T), String> {
    let parts = text.split_once('x').and_then(|(w, h)| Some((w.parse().ok()?, h.parse().ok()?)));
    parts.ok_or_else(|| format!("\"{text}\" is not a width and a height like 3x2"))
}

/// Reads the size of a blur.
pub(crate) fn blur_size(text: &str) -> Result<(f32, f32), String> {
    pair(text)
}

/// Returns the way to resize that an option names.
fn resampling(given: &Given) -> Result<Resampling, String> {
    Ok(Resampling::Filter(given.text("filter").map(kernel).transpose()?))
}

/// Carries out an option.
pub(crate) fn act(machine: &mut Machine<'_>, given: &Given) -> Done {
    use Action as A;
    match given.row.action {
        A::Create | A::Pattern => return create(machine, given),
        A::Mosaic => return sheet(machine, given),
        A::Environment => return environment(machine, given),
        A::Paste => {
            let at = match &*given.values[0] {
                "auto" | "-" => None,
                text => Some(position(text)?),
            };
            let [.., upper, lower] = &*machine.stack else { return Err("there are no two images".into()) };
            let image = paste(&upper.image, &lower.image, at, given.flag("mergeroi", false)?)?;
            machine.replace(2, image);
            return Ok(());
        }
        _ => {}
    }
    let memory = machine.settings.memory_bytes;
    let image = changed(machine.top()?, given, memory)?;
    machine.replace(1, image);
    Ok(())
}

/// Returns the result of an option on one image.
fn changed(image: &Image, given: &Given, memory: u64) -> Done<Image> {
    use Action as A;
    let window = |like: &Window| Geometry::parse(&given.values[0]).and_then(|g| g.window(like));
    Ok(match given.row.action {
        A::Resize => image.resized(&window(&image.full())?, resampling(given)?)?,
        A::Resample => {
            image.resized(&window(&image.full())?, Resampling::Sample(given.flag("interp", true)?))?
        }
        A::Fit => {
            let mode = match given.text("fillmode").unwrap_or("letterbox") {
                "letterbox" => FillMode::Letterbox,
                "width" => FillMode::Width,
                "height" => FillMode::Height,
                other => {
                    return Err(format!("fillmode={other}, letterbox, width and height are possible").into());
                }
            };
            let at = new_window(&given.values[0])?;
            image.fitted(&at, mode, given.flag("pad", false)?, resampling(given)?)?
        }
        A::Crop => image.crop(&window(&image.data())?)?,
        A::CropToFull => image.crop_to_full()?,
        A::Cut => image.cut(&window(&image.data())?)?,
        A::Trim => image.trim()?,
        A::Origin => {
            let (x, y) = position(&given.values[0])?;
            image.at(x, y)?
        }
        A::OriginOffset => {
            let (x, y) = position(&given.values[0])?;
            image.at(image.data().x + x, image.data().y + y)?
        }
        A::FullSize => image.clone().with_full(window(&image.full())?)?,
        A::FullPixels => image.full_is_data()?,
        A::Flip => image.turned(Turn::FLIP, memory)?,
        A::Flop => image.turned(Turn::FLOP, memory)?,
        A::Rotate90 => image.turned(Turn::CLOCKWISE, memory)?,
        A::Rotate180 => image.turned(Turn::HALF, memory)?,
        A::Rotate270 => image.turned(Turn::COUNTERCLOCKWISE, memory)?,
        A::Transpose => image.turned(Turn::TRANSPOSE, memory)?,
        A::Shift => image.shifted(position(&given.values[0])?)?,
        A::Reorient => image.upright(memory)?,
        A::Orientation => image.with_orientation(given.value(0)?)?,
        other => return Err(format!("{other:?} is not an operation on one image").into()),
    })
}

fn create(machine: &mut Machine<'_>, given: &Given) -> Done {
    let is_blank = given.row.action == Action::Create;
    let (kind, first) = if is_blank { (Pattern::Constant(vec![0.0]), 0) } else { (named_pattern(given)?, 1) };
    let window = new_window(&given.values[first])?;
    let image = pattern(kind, &window, given.value(first + 1)?)?;
    machine.replace(0, image);
    if let Some(top) = machine.stack.last_mut() {
        given.row.name.clone_into(&mut top.name);
    }
    Ok(())
}

/// Makes a contact sheet of the last images.
fn sheet(machine: &mut Machine<'_>, given: &Given) -> Done {
    let (columns, rows): (u32, u32) = pair(&given.values[0])?;
    if columns == 0 || rows == 0 {
        return Err(format!("a mosaic of {columns} x {rows} images").into());
    }
    let cells = u64::from(columns) * u64::from(rows);
    let count = machine.stack.len().min(usize::try_from(cells).unwrap_or(usize::MAX));
    let mut images: Vec<Image> =
        machine.stack[machine.stack.len() - count..].iter().map(|entry| entry.image.clone()).collect();
    if let Some(size) = given.text("fit") {
        let at = new_window(size)?;
        let fit = |image: &Image| image.fitted(&at, FillMode::Letterbox, true, Resampling::Filter(None));
        images = images.iter().map(fit).collect::<Result<_, _>>()?;
    }
    let image = mosaic(&images, (columns, rows), given.number("pad")?.unwrap_or(0))?;
    machine.replace(count, image);
    Ok(())
}

/// The places of the faces px nx py ny pz nz in the layout of a cube.
const CELLS: [(u32, u32); 6] = [(0, 0), (0, 1), (1, 0), (1, 1), (2, 0), (2, 1)];
/// The word for six images in place of a layout.
const FACES: &str = "faces";

/// Returns a layout of a name. Six images are first joined to a cube, or are cut from one.
fn layout(word: &str) -> Done<Directions> {
    if word == FACES {
        return Ok(Directions::Cube);
    }
    Directions::from_word(word).ok_or_else(|| {
        let names: Vec<&str> = Directions::NAMES.iter().map(|(name, _)| *name).collect();
        Fault::from(format!(
            "\"{word}\" is not a layout of directions; layouts are {}, {FACES}",
            names.join(", ")
        ))
    })
}

/// Converts a map of all directions.
fn environment(machine: &mut Machine<'_>, given: &Given) -> Done {
    let text = &given.values[0];
    let Some((from, to)) = text.split_once(':') else {
        return Err(format!("\"{text}\" is not a pair of layouts like latlong:cube").into());
    };
    let up = match given.text("up").unwrap_or("y") {
        "y" => Up::Y,
        "z" => Up::Z,
        other => return Err(format!("up={other}, y and z are possible").into()),
    };
    let size: Option<u32> = given.number("size")?;
    if size.is_some_and(|n| !(1..=65_536).contains(&n)) {
        return Err("the size is from 1 to 65536 pixels".into());
    }
    let layouts = (layout(from)?, layout(to)?);
    let (image, count) = match from {
        FACES => (joined(machine)?, CELLS.len()),
        _ => (machine.top()?.clone(), 1),
    };
    let image = match from == to {
        true => image,
        false => image.directions(layouts, up, size, machine.settings.memory_bytes)?,
    };
    if to != FACES {
        machine.replace(count, image);
        return Ok(());
    }
    let n = image.spec().width / 3;
    let cut = |(column, row): (u32, u32)| {
        image.cut(&Window { x: (column * n).into(), y: (row * n).into(), width: n, height: n })
    };
    let faces = CELLS.into_iter().map(cut).collect::<Result<Vec<_>, _>>()?;
    let mut faces = faces.into_iter();
    if let Some(first) = faces.next() {
        machine.replace(count, first);
    }
    faces.for_each(|face| machine.replace(0, face));
    Ok(())
}

/// Returns the last six images as one cube.
fn joined(machine: &Machine<'_>) -> Done<Image> {
    let count = machine.stack.len();
    if count < CELLS.len() {
        return Err(format!("{FACES} are six images, px nx py ny pz nz, there are {count}").into());
    }
    let faces = &machine.stack[count - CELLS.len()..];
    let full = faces[0].image.full();
    if let Some(other) = faces.iter().find(|face| face.image.full() != full || full.width != full.height) {
        let size = other.image.full();
        let what =
            format!("{}: {} x {} pixels, faces are squares of one size", other.name, size.width, size.height);
        return Err(what.into());
    }
    // A mosaic goes row by row.
    let images: Vec<Image> = [0, 2, 4, 1, 3, 5].iter().map(|i| faces[*i].image.clone()).collect();
    Ok(mosaic(&images, (3, 2), 0)?)
}
