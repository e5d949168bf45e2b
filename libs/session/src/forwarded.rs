//! Images that are sent to a program: the format behind their outputs.

use crate::connection::Connection;
use granita_image::{
    CreateOptions, Format, ImageError, ImageInput, ImageOutput, ImageSpec, Limits, PixelType, Pixels, Result,
};
use granita_pyg::frames::{put_text, put_value};
use std::path::{Path, PathBuf};

/// The storage types of channels, in the order of their numbers in frames.
pub(crate) const TYPES: [PixelType; 5] =
    [PixelType::U8, PixelType::U16, PixelType::U32, PixelType::Half, PixelType::Float];

/// The format of an image at an address of the program.
pub(crate) struct Forwarded {
    to: Connection,
    address: usize,
}

impl Forwarded {
    pub(crate) fn new(to: &Connection, address: usize) -> Self {
        Self { to: to.clone(), address }
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
        let number = self.to.image_number().to_le_bytes();
        let mut out = Vec::new();
        put_text(&format!("{:#x}", self.address), &mut out);
        put_text(&path.to_string_lossy(), &mut out);
        put_spec(options.spec, &mut out);
        self.to.say(b'O', &[&number, &out]);
        Ok(Box::new(Sent { to: self.to.clone(), number, path: path.to_owned() }))
    }
}

/// An image that is being sent.
struct Sent {
    to: Connection,
    number: [u8; 4],
    path: PathBuf,
}

impl ImageOutput for Sent {
    fn write_rows(&mut self, pixels: &Pixels) -> Result<()> {
        let mut out = Vec::new();
        pixels.to_floats().iter().for_each(|v| out.extend(v.to_le_bytes()));
        self.to.say(b'S', &[&self.number, &out]);
        Ok(())
    }

    fn write_tile(&mut self, _: u32, _: u32, _: &Pixels) -> Result<()> {
        Forwarded::misuse(&self.path)
    }

    fn next_level(&mut self, _: &ImageSpec) -> Result<()> {
        Forwarded::misuse(&self.path)
    }

    fn close(self: Box<Self>) -> Result<()> {
        self.to.say(b'L', &[&self.number]);
        Ok(())
    }
}

/// Appends the description of an image.
pub(crate) fn put_spec(spec: &ImageSpec, out: &mut Vec<u8>) {
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
