//! Images in the memory of the program. The renderer sends them, and the program's side passes them to their owner.

use super::told::Told;
use granita_base::{Param, Params};
use granita_image::{
    CreateOptions, Format, ImageError, ImageInput, ImageOutput, ImageSpec, Limits, PixelType, Pixels, Result,
};
use granita_pyg::frames::{Frame, put_text, put_value};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

const TYPES: [PixelType; 5] =
    [PixelType::U8, PixelType::U16, PixelType::U32, PixelType::Half, PixelType::Float];

/// The format of an image at an address of the program.
pub(super) struct Forwarded {
    told: Told,
    address: usize,
}

impl Forwarded {
    pub(super) fn new(told: &Told, address: usize) -> Self {
        Self { told: told.clone(), address }
    }

    fn misuse<T>(path: &Path) -> Result<T> {
        let what = "an image in the memory of the program takes rows".to_owned();
        Err(ImageError::Misuse { path: path.to_owned(), what })
    }
}

impl Format for Forwarded {
    fn name(&self) -> &'static str {
        "ImageOutput"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &[]
    }

    fn recognizes(&self, _: &[u8]) -> bool {
        false
    }

    fn open(&self, path: &Path, _: &Limits) -> Result<Box<dyn ImageInput>> {
        Self::misuse(path)
    }

    fn supports(&self, feature: &str) -> bool {
        matches!(feature, "write" | "half" | "float" | "u16" | "channels" | "alpha")
    }

    fn output_type(&self, quantized: PixelType) -> PixelType {
        quantized
    }

    fn quantizes(&self) -> bool {
        true
    }

    fn create(&self, path: &Path, options: &CreateOptions<'_>) -> Result<Box<dyn ImageOutput>> {
        let number = self.told.image_number().to_le_bytes();
        let mut out = Vec::new();
        put_text(&format!("{:#x}", self.address), &mut out);
        put_text(&path.to_string_lossy(), &mut out);
        put_spec(options.spec, &mut out);
        self.told.say(b'O', &[&number, &out]);
        Ok(Box::new(Sent { told: self.told.clone(), number, path: path.to_owned() }))
    }
}

/// An image that is being sent.
struct Sent {
    told: Told,
    number: [u8; 4],
    path: PathBuf,
}

impl ImageOutput for Sent {
    fn write_rows(&mut self, pixels: &Pixels) -> Result<()> {
        let mut out = Vec::new();
        pixels.to_floats().iter().for_each(|v| out.extend(v.to_le_bytes()));
        self.told.say(b'S', &[&self.number, &out]);
        Ok(())
    }

    fn write_tile(&mut self, _: u32, _: u32, _: &Pixels) -> Result<()> {
        Forwarded::misuse(&self.path)
    }

    fn next_level(&mut self, _: &ImageSpec) -> Result<()> {
        Forwarded::misuse(&self.path)
    }

    fn close(self: Box<Self>) -> Result<()> {
        self.told.say(b'L', &[&self.number]);
        Ok(())
    }
}

fn put_spec(spec: &ImageSpec, out: &mut Vec<u8>) {
    let kind = TYPES.iter().position(|t| *t == spec.pixel_type).unwrap_or(0) as u32;
    let numbers = [
        [spec.width, spec.height, spec.x as u32, spec.y as u32],
        [spec.full_x as u32, spec.full_y as u32, spec.full_width, spec.full_height],
    ];
    let all = numbers.iter().flatten().copied().chain([kind, spec.channels.len() as u32]);
    all.for_each(|n| out.extend(n.to_le_bytes()));
    spec.channels.iter().for_each(|channel| put_text(channel, out));
    for param in &spec.attributes {
        put_text(&param.declaration(), out);
        put_value(Some(param), out);
    }
}

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
