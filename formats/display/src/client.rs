//! The image format "iv" (reference 7.4.3).

use crate::link::{Link, Patience};
use crate::packet::{Channel, Update};
use crate::{Packet, server_address};
use granita_image::{
    CreateOptions, Format, ImageError, ImageInput, ImageOutput, ImageSpec, Limits, PixelRect, Pixels,
    Request, Result, Wishes,
};
use parking_lot::Mutex;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Weak};

/// The largest number of values of one packet, which a viewer shows at once.
const PACKET_VALUES: usize = 1 << 20;

/// The image format "iv", which sends images to a viewer instead of a file.
///
/// The viewer is at the address in the attribute `display` of the image, `HOST[:PORT]`, by default port 14158 of this
/// machine. Images for one address that are sent at the same time share a connection. The attributes `fullscreen`,
/// `zoom` (ints), `foreground` and `background` (strings) are passed on to a viewer that supports them.
///
/// All values are sent as floats, in the given order. Only the type is converted. A rectangle whose pixels are all
/// equal is sent as one pixel (its channels have a stride of 0). Writing fails as soon as the connection is lost, and
/// never blocks. `close` waits as long as the viewer keeps reading the data.
pub struct IvFormat {
    patience: Patience,
    /// The connections by address.
    links: Mutex<Vec<(String, Weak<Link>)>>,
}

impl Default for IvFormat {
    fn default() -> Self {
        Self::new(Patience::default())
    }
}

impl IvFormat {
    /// Returns the format with these limits.
    pub fn new(patience: Patience) -> Self {
        Self { patience, links: Mutex::default() }
    }

    fn link(&self, address: &str) -> std::result::Result<Arc<Link>, std::io::Error> {
        let parts = server_address(address).map_err(|e| std::io::Error::other(e.to_string()))?;
        let mut links = self.links.lock();
        links.retain(|(_, link)| link.strong_count() > 0);
        let same = links.iter().find(|(a, _)| a == address);
        if let Some(link) = same.and_then(|(_, link)| link.upgrade()) {
            return Ok(link);
        }
        let link =
            Arc::new(Link::new(parts, self.patience).map_err(|e| std::io::Error::other(e.to_string()))?);
        links.push((address.to_owned(), Arc::downgrade(&link)));
        Ok(link)
    }
}

impl Format for IvFormat {
    fn name(&self) -> &'static str {
        "iv"
    }

    fn extensions(&self) -> &'static [&'static str] {
        &[]
    }

    fn recognizes(&self, _: &[u8]) -> bool {
        false
    }

    fn open(&self, path: &Path, _: &Limits) -> Result<Box<dyn ImageInput>> {
        let what = "images in a viewer cannot be read".to_owned();
        Err(ImageError::Unsupported { path: path.to_owned(), what })
    }

    fn supports(&self, feature: &str) -> bool {
        matches!(
            feature,
            "write" | "rectangles" | "tiles" | "float" | "half" | "u16" | "channels" | "layers" | "alpha"
        )
    }

    fn create(&self, path: &Path, options: &CreateOptions<'_>) -> Result<Box<dyn ImageOutput>> {
        let spec = options.spec;
        let attributes = &spec.attributes;
        let address = attributes.string("display").map_or("localhost", |a| &**a);
        let address = if address.is_empty() { "localhost" } else { address };
        let link = self.link(address).map_err(|source| ImageError::Io { path: address.into(), source })?;
        let (name, focus) = link.name(&path.to_string_lossy().replace('\0', "?"));
        let stride = spec.nchannels() as u64;
        let channel = |(i, name): (usize, &String)| Channel { name: name.clone(), offset: i as u64, stride };
        let channels = spec.channels.iter().enumerate().map(channel).collect();
        let mut output = IvOutput {
            link,
            address: address.into(),
            name,
            spec: spec.clone(),
            channels,
            row: 0,
            closed: false,
        };
        output.push(&Packet::CreateImage {
            name: output.name.clone(),
            focus,
            width: spec.width,
            height: spec.height,
            channels: spec.channels.clone(),
        })?;
        let text = |name: &str| attributes.string(name).map(|t| t.replace('\0', "?")).unwrap_or_default();
        let wishes = Wishes {
            fullscreen: attributes.int("fullscreen").is_some_and(|f| f != 0),
            zoom: u32::try_from(attributes.int("zoom").unwrap_or(0)).unwrap_or(0),
            foreground: text("foreground"),
            background: text("background"),
        };
        if wishes != Wishes::default() {
            output.push(&Packet::Wish { name: output.name.clone(), wishes })?;
        }
        Ok(Box::new(output))
    }
}

/// An image that is being sent to a viewer.
struct IvOutput {
    link: Arc<Link>,
    /// The address, which replaces the file in messages.
    address: PathBuf,
    name: String,
    spec: ImageSpec,
    /// The positions of the values of each channel in a packet.
    channels: Vec<Channel>,
    /// The next row, for rows in order.
    row: u32,
    closed: bool,
}

impl IvOutput {
    fn push(&mut self, packet: &Packet) -> Result<()> {
        let result = self.link.push(packet);
        self.failed(result)
    }

    fn failed(&self, result: std::result::Result<(), String>) -> Result<()> {
        result.map_err(|what| ImageError::Io {
            path: self.address.clone(),
            source: std::io::Error::other(what),
        })
    }

    fn misuse(&self, what: String) -> ImageError {
        ImageError::Misuse { path: self.name.clone().into(), what }
    }

    fn window(&self) -> PixelRect {
        PixelRect::at(0, 0, self.spec.width, self.spec.height)
    }

    /// Sends `rect`, with as many of its rows per packet as fit. When all its pixels are equal, one pixel is sent.
    fn send(&mut self, rect: &PixelRect, values: &[f32]) -> Result<()> {
        let n = self.spec.nchannels();
        let line = rect.width() * n;
        let (first, same) = match values.split_at_checked(n) {
            Some((first, rest)) => (first, rest.chunks_exact(n).all(|pixel| is_same(pixel, first))),
            None => (values, false),
        };
        let (values, rows) = match same {
            true => (first, rect.height()),
            false => (values, (PACKET_VALUES / line).max(1)),
        };
        let stride = if same { 0 } else { n as u64 };
        self.channels.iter_mut().for_each(|channel| channel.stride = stride);
        let chunk = if same { n } else { rows * line };
        for (values, y0) in values.chunks(chunk).zip((rect.y0..rect.y1).step_by(rows)) {
            let rect = PixelRect { y0, y1: rect.y1.min(y0 + rows as i32), ..*rect };
            let (name, channels) = (&*self.name, &*self.channels);
            let result = self.link.push_update(&Update { name, focus: false, channels, rect, values });
            self.failed(result)?;
        }
        Ok(())
    }
}

/// True when all values are equal to the bit.
fn is_same(a: &[f32], b: &[f32]) -> bool {
    a.iter().zip(b).all(|(a, b)| a.to_bits() == b.to_bits())
}

impl ImageOutput for IvOutput {
    fn write_rows(&mut self, pixels: &Pixels) -> Result<()> {
        let line = self.spec.width as usize * self.spec.nchannels();
        let height = u32::try_from(pixels.len() / line.max(1)).unwrap_or(u32::MAX);
        let row = i32::try_from(self.row).unwrap_or(i32::MAX);
        self.write_rectangle(&PixelRect::at(0, row, self.spec.width, height), pixels)?;
        self.row += height;
        Ok(())
    }

    fn write_tile(&mut self, tx: u32, ty: u32, pixels: &Pixels) -> Result<()> {
        let (width, height) = (self.spec.tile_width, self.spec.tile_height);
        let (across, down) = self.spec.tiles();
        let n = self.spec.nchannels();
        if tx >= across || ty >= down || pixels.len() != width as usize * height as usize * n {
            return Err(self.misuse(format!("tile ({tx}, {ty}) of {across} x {down}")));
        }
        let whole = PixelRect::at((tx * width) as i32, (ty * height) as i32, width, height);
        let inside = whole.intersection(&self.window());
        let values = pixels.floats();
        let lines = values.chunks_exact(width as usize * n).take(inside.height());
        let values: Vec<f32> = lines.flat_map(|line| &line[..inside.width() * n]).copied().collect();
        self.send(&inside, &values)
    }

    fn write_rectangle(&mut self, rect: &PixelRect, pixels: &Pixels) -> Result<()> {
        let inside = rect.is_empty() || self.window().contains(rect);
        let values = rect.pixels().saturating_mul(self.spec.nchannels() as u64);
        if !inside || values != pixels.len() as u64 {
            return Err(self.misuse(format!(
                "{} values for {rect:?} of {} x {} pixels",
                pixels.len(),
                self.spec.width,
                self.spec.height
            )));
        }
        if values == 0 {
            return Ok(());
        }
        self.send(rect, &pixels.floats())
    }

    fn begin_rectangle(&mut self, rect: &PixelRect) {
        if !rect.is_empty() {
            // A failure here is reported when pixels are sent.
            let _ = self.link.push(&Packet::Mark { name: self.name.clone(), rect: *rect });
        }
    }

    fn requests(&mut self) -> Vec<Request> {
        self.link.requests(&self.name)
    }

    fn show_panel(&mut self, part: &str, text: &str) -> Result<()> {
        self.push(&Packet::Panel { name: self.name.clone(), part: part.to_owned(), text: text.to_owned() })
    }

    fn edits(&mut self) -> Vec<String> {
        self.link.edits(&self.name)
    }

    fn next_level(&mut self, _: &ImageSpec) -> Result<()> {
        Err(self.misuse("a viewer shows one level only".to_owned()))
    }

    fn close(mut self: Box<Self>) -> Result<()> {
        self.closed = true;
        self.push(&Packet::Finished { name: self.name.clone(), complete: true })?;
        let result = self.link.flush();
        self.failed(result)
    }
}

impl Drop for IvOutput {
    fn drop(&mut self) {
        if !self.closed {
            let _ = self.link.push(&Packet::Finished { name: self.name.clone(), complete: false });
        }
        self.link.forget(&self.name);
    }
}
