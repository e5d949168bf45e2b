//! Images in the memory of the program. The renderer sends them, and the program's side passes them to their owner.

use crate::forwarded::TYPES;
use granita_base::{Param, Params};
use granita_image::{CreateOptions, Format, ImageOutput, ImageSpec, Pixels};
use granita_pyg::frames::Frame;
use std::collections::BTreeMap;
use std::path::Path;

fn spec(frame: &mut Frame<'_>) -> Option<ImageSpec> {
    let [width, height, x, y] = [frame.word()?, frame.word()?, frame.word()?, frame.word()?];
    let [full_x, full_y, full_width, full_height] =
        [frame.word()?, frame.word()?, frame.word()?, frame.word()?];
    let pixel_type = *TYPES.get(frame.word()? as usize)?;
    let channels = (0..frame.word()?).map(|_| frame.text()).collect::<Option<Vec<_>>>()?;
    let mut attributes = Params::new();
    while !frame.0.is_empty() {
        let (declaration, data) = (frame.text()?, frame.data()??);
        attributes.set(Param::declared(&declaration, data).ok()?);
    }
    let mut spec = ImageSpec::new(width, height, channels.len(), pixel_type);
    (spec.x, spec.y, spec.full_x, spec.full_y) = (x as i32, y as i32, full_x as i32, full_y as i32);
    (spec.full_width, spec.full_height, spec.channels, spec.attributes) =
        (full_width, full_height, channels, attributes);
    Some(spec)
}

/// Images that arrive at the program's side.
#[derive(Default)]
pub(super) struct Arriving(BTreeMap<u32, Box<dyn ImageOutput>>);

impl Arriving {
    /// Processes an `O`, `S` or `L`. Returns an error to report.
    pub(super) fn take(
        &mut self,
        kind: u8,
        payload: &[u8],
        find: impl FnOnce(&str) -> Option<std::sync::Arc<dyn Format>>,
    ) -> std::result::Result<(), String> {
        let mut frame = Frame(payload);
        let unreadable = || "the renderer sent something unreadable".to_owned();
        let number = frame.word().ok_or_else(unreadable)?;
        let done = match kind {
            b'O' => {
                let address = frame.text().ok_or_else(unreadable)?;
                let (name, spec) = frame.text().zip(spec(&mut frame)).ok_or_else(unreadable)?;
                let format =
                    find(&address).ok_or_else(|| format!("{address} is no ImageOutput of the program"))?;
                let made = format.create(Path::new(&name), &CreateOptions::new(&spec, 1));
                made.map(|image| drop(self.0.insert(number, image)))
            }
            b'S' => match self.0.get_mut(&number) {
                Some(image) => {
                    let values =
                        frame.0.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]));
                    image.write_rows(&Pixels::Float(values.collect()))
                }
                None => Ok(()),
            },
            _ => self.0.remove(&number).map_or(Ok(()), ImageOutput::close),
        };
        if done.is_err() {
            // One message per image is enough.
            self.0.remove(&number);
        }
        done.map_err(|error| error.to_string())
    }
}
