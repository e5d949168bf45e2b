//! Files as live images.

use super::{OpenFile, Wanted};
use granita_base::Reporter;
use granita_image::{FormatRegistry, PixelRect};
use granita_view::Live;
use std::path::Path;

/// Returns a function that reads the files which clients name.
pub(crate) fn opener(live: &Live, formats: &FormatRegistry, reporter: &Reporter) -> Box<OpenFile> {
    let (live, formats, reporter) = (live.clone(), formats.clone(), reporter.clone());
    Box::new(move |wanted| {
        let (path, focus) = match wanted {
            Wanted::Open { path, focus, .. } => (path, focus),
            Wanted::Reload { name, focus } => (file_of(&name).to_owned(), focus),
        };
        read(&live, &formats, Path::new(&path))?;
        reporter.info(format!("{path} is read for a client"));
        if focus {
            live.show(&path);
        }
        Ok(())
    })
}

/// Returns the name of the file that an image was read from by [`read`].
fn file_of(image: &str) -> &str {
    match image.rsplit_once('#') {
        Some((file, number)) if number.parse::<usize>().is_ok() && !Path::new(image).exists() => file,
        _ => image,
    }
}

/// Shows the images of a file under the name of the file. Those after the first are called `name#1` and so on.
pub(crate) fn read(live: &Live, formats: &FormatRegistry, path: &Path) -> Result<(), String> {
    const ROWS: u32 = 64;
    // -allowopen allows clients to name any file.
    formats.files().grant(path);
    let input = formats.open(path).map_err(|e| e.to_string())?;
    for image in 0..input.images() {
        let Some(spec) = input.spec(image, 0) else { continue };
        let name = match image {
            0 => path.display().to_string(),
            _ => format!("{}#{image}", path.display()),
        };
        live.create(&name, spec.width, spec.height, &spec.channels).map_err(|e| format!("{name}: {e}"))?;
        live.describe(&name, spec);
        let n = spec.nchannels();
        let places: Vec<(usize, usize, usize)> = (0..n).map(|c| (c, c, n)).collect();
        for y in (0..spec.height).step_by(ROWS as usize) {
            let end = (y + ROWS).min(spec.height);
            let pixels = input.read_rows(image, 0, y, end).map_err(|e| e.to_string())?;
            let rect = PixelRect::at(0, y as i32, spec.width, end - y);
            live.update(&name, &places, rect, &pixels.floats()).map_err(|e| format!("{name}: {e}"))?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_opened_and_reloaded_as_live_images() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.pfm");
        std::fs::write(&path, [&b"PF\n2 1\n-1.0\n"[..], &[0, 0, 128, 63].repeat(6)].concat()).unwrap();
        let live = Live::default();
        let formats = granita_plugin::bundled_formats(granita_image::Limits::default());
        read(&live, &formats, &path).unwrap();
        let (info, values) = live.snapshot(&path.display().to_string()).unwrap();
        assert_eq!((info.width, info.height, values), (2, 1, vec![1.0; 6]));
        assert!(read(&live, &formats, &folder.path().join("nosuch")).is_err());
        let open = opener(&live, &formats, &Reporter::silent());
        assert!(
            open(Wanted::Open { path: "nosuch.exr".to_owned(), selector: String::new(), focus: true })
                .is_err()
        );
        let name = path.display().to_string();
        open(Wanted::Reload { name: name.clone(), focus: true }).unwrap();
        assert_eq!(live.shown(), live.info(&name).unwrap().id);
        // Later images of a file are reloaded with the file.
        open(Wanted::Reload { name: format!("{name}#1"), focus: false }).unwrap();
        assert_eq!((file_of("a.tif#12"), file_of("a#b.tif")), ("a.tif", "a#b.tif"));
    }
}
