//! Runs the lines of a case that compare.

use crate::{Image, Ran};
use std::path::{Path, PathBuf};

/// The path of the references, and whether to replace them.
pub(crate) struct Kept {
    /// The path `tests/ref/AREA/NAME`, without extension.
    pub(crate) stem: PathBuf,
    /// True when references are replaced and not compared.
    pub(crate) bless: bool,
}

impl Kept {
    fn path(&self, what: &str, extension: &str) -> PathBuf {
        let name = self.stem.file_name().unwrap_or_default().to_string_lossy();
        let what = what.replace(['/', '.'], "-");
        self.stem.with_file_name(format!("{name}.{what}.{extension}"))
    }
}

/// The largest width and height of a reference image, in pixels.
const GOLDEN_SIDE: usize = 128;
/// The largest size of the file of a reference image, in bytes.
const GOLDEN_BYTES: u64 = 20 << 10;

/// Runs one comparison.
pub(crate) fn check(
    words: &[&str],
    place: &Path,
    last: &Ran,
    kept: &Kept,
    images: &mut Vec<(String, PathBuf, PathBuf)>,
) -> Result<(), String> {
    let read = |name: &str| Image::read(&place.join(name));
    match words {
        ["says", text @ ..] => {
            let text = text.join(" ");
            let said = format!("{}{}", last.stdout, last.stderr);
            if said.contains(&text) { Ok(()) } else { Err(format!("it said:\n{said}")) }
        }
        ["silent"] => match last.stderr.is_empty() {
            true => Ok(()),
            false => Err(last.stderr.clone()),
        },
        ["move", from, to] => std::fs::rename(place.join(from), place.join(to)).map_err(|e| e.to_string()),
        ["absent", file] => match place.join(file).exists() {
            true => Err("it is there".to_owned()),
            false => Ok(()),
        },
        ["bytes", a, b] => {
            let bytes = |name: &str| std::fs::read(place.join(name)).map_err(|e| format!("{name}: {e}"));
            if bytes(a)? == bytes(b)? { Ok(()) } else { Err("their bytes differ".to_owned()) }
        }
        ["same", a, b] => read(a)?.identical(&read(b)?),
        ["assembled", whole, parts @ ..] => {
            let parts = parts.iter().map(|p| read(p)).collect::<Result<Vec<_>, String>>()?;
            read(whole)?.is_assembled_of(&parts)
        }
        ["differ", a, b] => match read(a)?.identical(&read(b)?) {
            Ok(()) => Err("they are the same".to_owned()),
            Err(_) => Ok(()),
        },
        ["close", a, b, tolerance] => within(&read(a)?, &read(b)?, number(tolerance)?),
        ["close", a, b, tolerance, "but", count] => {
            let most = count.parse().map_err(|_| format!("{count} is no count"))?;
            read(a)?.close_but(&read(b)?, number(tolerance)?, most)
        }
        ["varied", file] => match read(file)?.is_varied() {
            true => Ok(()),
            false => Err("all pixels are equal".to_owned()),
        },
        ["finite", file] => match read(file)?.is_finite() {
            true => Ok(()),
            false => Err("a value is no finite number".to_owned()),
        },
        ["pixel", file, x, y, "=", values @ .., tolerance] => {
            let image = read(file)?;
            let found = image.pixel(index(x)?, index(y)?).ok_or("outside the image")?;
            near(found, values, number(tolerance)?)
        }
        ["mean", file, x0, y0, x1, y1, "=", values @ .., tolerance] => {
            let image = read(file)?;
            let found = image
                .mean([index(x0)?, index(y0)?, index(x1)?, index(y1)?])
                .ok_or("the box is empty or outside the image")?;
            near(&found, values, number(tolerance)?)
        }
        ["text", what, label @ ..] => {
            let text = match *what {
                "stdout" => last.stdout.clone(),
                "stderr" => last.stderr.clone(),
                file => std::fs::read_to_string(place.join(file)).map_err(|e| format!("{file}: {e}"))?,
            };
            golden_text(
                &text.replace("\r\n", "\n"),
                &kept.path(label.first().unwrap_or(what), "txt"),
                kept.bless,
            )
        }
        ["golden", file, tolerance] => {
            golden_image(file, &read(file)?, number(tolerance)?, place, kept, images)
        }
        _ => Err("not a line of a case".to_owned()),
    }
}

fn within(a: &Image, b: &Image, tolerance: f32) -> Result<(), String> {
    let (worst, [x, y, channel]) = a.difference(b)?;
    if worst <= tolerance {
        return Ok(());
    }
    Err(format!("they differ by {worst} in pixel {x} {y} channel {channel}, more than {tolerance}"))
}

fn near(found: &[f32], wanted: &[&str], tolerance: f32) -> Result<(), String> {
    let wanted = wanted.iter().map(|w| number(w)).collect::<Result<Vec<f32>, String>>()?;
    let good = !wanted.is_empty()
        && wanted.len() <= found.len()
        && wanted.iter().zip(found).all(|(w, f)| (w - f).abs() <= tolerance);
    if good { Ok(()) } else { Err(format!("found {found:?}")) }
}

fn golden_text(text: &str, reference: &Path, bless: bool) -> Result<(), String> {
    if bless {
        return write(reference, text.as_bytes());
    }
    let wanted = std::fs::read_to_string(reference).map_err(|e| format!("{}: {e}", reference.display()))?;
    if wanted == text {
        return Ok(());
    }
    let line = wanted.lines().zip(text.lines()).take_while(|(a, b)| a == b).count();
    Err(format!(
        "line {} differs from {}\n  kept: {}\n  now:  {}",
        line + 1,
        reference.display(),
        wanted.lines().nth(line).unwrap_or("(ends)"),
        text.lines().nth(line).unwrap_or("(ends)")
    ))
}

fn golden_image(
    file: &str,
    made: &Image,
    tolerance: f32,
    place: &Path,
    kept: &Kept,
    images: &mut Vec<(String, PathBuf, PathBuf)>,
) -> Result<(), String> {
    let reference = kept.path(file, "png");
    if made.width > GOLDEN_SIDE || made.height > GOLDEN_SIDE {
        return Err(format!("{} x {} pixels: at most {GOLDEN_SIDE}", made.width, made.height));
    }
    if kept.bless {
        write(&reference, &[])?;
        made.write_png(&reference)?;
        let bytes = std::fs::metadata(&reference).map_or(0, |m| m.len());
        return match bytes <= GOLDEN_BYTES {
            true => Ok(()),
            false => Err(format!("{bytes} bytes: at most {GOLDEN_BYTES}")),
        };
    }
    let png = place.join(format!("{}.result.png", file.replace('/', "-")));
    made.write_png(&png)?;
    images.push((file.to_owned(), reference.clone(), png.clone()));
    within(&Image::read(&reference)?, &Image::read(&png)?, tolerance)
}

fn write(path: &Path, bytes: &[u8]) -> Result<(), String> {
    let folder = path.parent().unwrap_or(Path::new("."));
    std::fs::create_dir_all(folder)
        .and_then(|()| std::fs::write(path, bytes))
        .map_err(|e| format!("{}: {e}", path.display()))
}

fn number(word: &str) -> Result<f32, String> {
    word.parse().map_err(|_| format!("{word} is not a number"))
}

fn index(word: &str) -> Result<usize, String> {
    word.parse().map_err(|_| format!("{word} is not a whole number"))
}
