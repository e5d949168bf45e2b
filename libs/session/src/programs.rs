//! Requests of a program that started the renderer: images of a frame, and images in files.
//!
//! Each request is a frame, answered by a frame of the same kind. The pixels of images come before the answer, as
//! frames `O`, `S` and `L` (see [`crate::remote`]), in which the address is that of the request.
//! - `V` renders a frame: line, camera ("" for the first one), the number of images and the data of each. Image `n`
//!   has the address `n`, counted from 1. The answer is the number of errors so far.
//! - `I` reads a file: image, level, 1 to send its pixels (address 0) or 0, and the name. The answer is 0 and an error,
//!   or 1, the format, and the levels of all images. A level is its length in bytes, the size of its tiles and its
//!   description.

use crate::connection::Connection;
use crate::forwarded::{Forwarded, put_spec};
use crate::outputs::{Requested, RequestedImages};
use granita_base::{Location, Reporter};
use granita_image::{CreateOptions, Format, FormatRegistry, ImageError, ImageInput, Pixels};
use granita_pyg::Requests;
use granita_pyg::frames::{Frame, put_text};
use granita_scene::{Call, SceneSink, Stop};
use std::path::Path;
use std::sync::Arc;

/// The largest number of images of a frame that a program may request.
const MOST_IMAGES: u32 = 1024;
/// The number of bytes of pixels in one frame. At least one row is sent.
const PIECE: usize = 4 << 20;

/// Executes the requests of one program.
pub(crate) struct Programs {
    pub(crate) connection: Connection,
    pub(crate) registry: FormatRegistry,
    pub(crate) requested: RequestedImages,
    pub(crate) reporter: Reporter,
}

impl Requests for Programs {
    fn answer(
        &mut self,
        kind: u8,
        payload: &[u8],
        file: &Arc<str>,
        sink: &mut dyn SceneSink,
    ) -> Result<Option<Vec<u8>>, Stop> {
        match kind {
            b'V' => self.render(payload, file, sink),
            b'I' => Ok(self.read(payload)),
            _ => Ok(None),
        }
    }
}

impl Programs {
    /// Renders a frame whose images go to the program.
    fn render(
        &self,
        payload: &[u8],
        file: &Arc<str>,
        sink: &mut dyn SceneSink,
    ) -> Result<Option<Vec<u8>>, Stop> {
        let Some((line, requested)) = requested(payload) else { return Ok(None) };
        let camera = requested.camera.clone();
        *self.requested.lock() = requested;
        let rendered = sink.call(Call::Render { camera }, &Location::line(file, line));
        *self.requested.lock() = Requested::default();
        rendered?;
        let errors = u32::try_from(self.reporter.errors()).unwrap_or(u32::MAX);
        Ok(Some(errors.to_le_bytes().to_vec()))
    }

    /// Describes the images of a file, and sends the pixels of one of them.
    fn read(&self, payload: &[u8]) -> Option<Vec<u8>> {
        let mut frame = Frame(payload);
        let (image, level) = (frame.word()? as usize, frame.word()? as usize);
        let [pixels] = frame.array()?;
        let name = frame.text()?;
        let path = Path::new(&name);
        let answer = self.registry.open(path).and_then(|input| {
            if pixels != 0 {
                self.send(&*input, path, image, level)?;
            }
            Ok(described(&*input))
        });
        Some(answer.unwrap_or_else(|error| {
            let mut out = vec![0];
            put_text(&error.to_string(), &mut out);
            out
        }))
    }

    /// Sends the pixels of a level.
    fn send(
        &self,
        input: &dyn ImageInput,
        path: &Path,
        image: usize,
        level: usize,
    ) -> granita_image::Result<()> {
        let spec = input.spec(image, level).ok_or_else(|| missing(input, path, image, level))?;
        let pixels = input.read_level(image, level)?;
        let mut to = Forwarded::new(&self.connection, 0).create(path, &CreateOptions::new(spec, 1))?;
        let row = (spec.width as usize * spec.nchannels()).max(1);
        let (mut room, step) = (Vec::new(), row * (PIECE / (4 * row)).max(1));
        for begin in (0..pixels.len()).step_by(step) {
            let end = (begin + step).min(pixels.len());
            to.write_rows(&Pixels::Float(pixels.floats_of(begin..end, &mut room).to_vec()))?;
        }
        to.close()
    }
}

fn requested(payload: &[u8]) -> Option<(u32, Requested)> {
    let mut frame = Frame(payload);
    let line = frame.word()?;
    let camera = Some(frame.text()?).filter(|name| !name.is_empty()).map(Arc::from);
    let n = frame.word().filter(|n| *n <= MOST_IMAGES)?;
    let data = (0..n).map(|_| frame.text().map(Arc::from)).collect::<Option<Vec<Arc<str>>>>()?;
    frame.0.is_empty().then_some((line, Requested { camera, data }))
}

fn missing(input: &dyn ImageInput, path: &Path, image: usize, level: usize) -> ImageError {
    let what = match (input.images(), input.levels(image)) {
        (images, 0) => format!("there is no image {image}: it has {images}, counted from 0"),
        (_, levels) => format!("image {image} has no level {level}: it has {levels}, counted from 0"),
    };
    ImageError::Misuse { path: path.to_owned(), what }
}

/// Returns the answer that describes all images of a file.
fn described(input: &dyn ImageInput) -> Vec<u8> {
    let mut out = vec![1];
    put_text(input.format_name(), &mut out);
    out.extend((input.images() as u32).to_le_bytes());
    for image in 0..input.images() {
        let specs: Vec<_> = (0..input.levels(image)).map_while(|level| input.spec(image, level)).collect();
        out.extend((specs.len() as u32).to_le_bytes());
        for spec in specs {
            let mut level = Vec::new();
            [spec.tile_width, spec.tile_height].iter().for_each(|n| level.extend(n.to_le_bytes()));
            put_spec(spec, &mut level);
            out.extend((level.len() as u32).to_le_bytes());
            out.extend(level);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_of_any_other_length_are_refused() {
        let mut whole = 7u32.to_le_bytes().to_vec();
        put_text("main", &mut whole);
        whole.extend(2u32.to_le_bytes());
        put_text("rgba", &mut whole);
        put_text("z", &mut whole);
        let (line, images) = requested(&whole).unwrap();
        assert_eq!((line, images.camera.as_deref(), images.data.len()), (7, Some("main"), 2));
        (0..whole.len()).for_each(|n| assert!(requested(&whole[..n]).is_none(), "{n}"));
        whole.push(0);
        assert!(requested(&whole).is_none());
        let many = [&[0; 8][..], &u32::MAX.to_le_bytes()].concat();
        assert!(requested(&many).is_none());
    }
}
