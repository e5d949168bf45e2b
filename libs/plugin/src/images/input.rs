//! Files that a plugin reads.

use super::{Made, Object, PluginFormat, failure};
use crate::ffi::{self, InputCalls, Spec, Text};
use crate::interface::c_string;
use granita_base::{BaseType, Param, ParamData, ParamType};
use granita_image::{ImageError, ImageInput, ImageSpec, Limits, PixelType, Pixels, Result};
use parking_lot::Mutex;
use std::ffi::{CStr, CString, c_int, c_void};
use std::path::{Path, PathBuf};

/// The largest number of values in scanlines that are read only to bring a reader to its end.
const MAX_DRAINED: u64 = 1 << 26;

/// An open file.
struct Reader {
    object: Object<InputCalls>,
    /// The image that it is at.
    image: usize,
    /// The row that it reads next.
    row: u32,
    /// True when `close` must be called.
    open: bool,
}

struct PluginInput {
    format: &'static str,
    title: String,
    path: PathBuf,
    name: CString,
    made: Made<InputCalls>,
    limits: Limits,
    /// For each image or level: its description, and true when it is read as floats.
    specs: Vec<(ImageSpec, bool)>,
    /// True when the images are levels of one image.
    levels: bool,
    reader: Mutex<Reader>,
    size: u64,
}

/// Opens a file.
pub(super) fn open(format: &PluginFormat, path: &Path, limits: &Limits) -> Result<Box<dyn ImageInput>> {
    let Some(made) = format.reader else {
        return Err(format.fault(path, "it does not read images"));
    };
    let name = c_string(&path.to_string_lossy());
    let (reader, first) = start(format, made, path, &name, limits)?;
    let mut input = PluginInput {
        format: format.name,
        title: format.title.clone(),
        path: path.to_owned(),
        name,
        made,
        limits: limits.clone(),
        specs: vec![first],
        levels: false,
        reader: Mutex::new(reader),
        size: std::fs::metadata(path).map_or(0, |m| m.len()),
    };
    input.find_images(format)?;
    Ok(Box::new(input))
}

/// Returns a reader at the first image of a file, and the description of that image.
fn start(
    format: &PluginFormat,
    made: Made<InputCalls>,
    path: &Path,
    name: &CStr,
    limits: &Limits,
) -> Result<(Reader, (ImageSpec, bool))> {
    let mut why = Text::new();
    // SAFETY: it is the plugin's factory, of the form that its version declares.
    let this = unsafe { (made.calls.create)(made.factory, why.room()) };
    if this.is_null() {
        let why =
            why.get().map_or("gave no ImageInput (NULL)".to_owned(), |t| format!("threw an exception: {t}"));
        return Err(format.fault(path, format!("its create function {why}")));
    }
    let object = Object { calls: made.calls, this, destroy: Some(made.calls.destroy) };
    let mut spec = empty();
    // SAFETY: the object is live, the name ends with 0, and there is room for the description.
    let status = unsafe { (made.calls.open)(this, name.as_ptr(), &raw mut spec, why.room()) };
    if status != ffi::OK {
        return Err(format.fault(path, failure("open", status, &why)));
    }
    let mut reader = Reader { object, image: 0, row: 0, open: true };
    match description(format, path, &spec, limits, &mut reader) {
        Ok(found) => Ok((reader, found)),
        Err(error) => {
            reader.end(None);
            Err(error)
        }
    }
}

fn empty() -> Spec {
    Spec {
        x: 0,
        y: 0,
        z: 0,
        width: 0,
        height: 0,
        depth: 0,
        full_width: 0,
        full_height: 0,
        full_depth: 0,
        tile_width: 0,
        tile_height: 0,
        tile_depth: 0,
        nchannels: 0,
        format: 0,
        channelnames: std::ptr::null(),
    }
}

/// Returns a plugin's description of an image after checks, and true when it must be read as floats.
fn description(
    format: &PluginFormat,
    path: &Path,
    spec: &Spec,
    limits: &Limits,
    reader: &mut Reader,
) -> Result<(ImageSpec, bool)> {
    let side = |what: &str, n: c_int| {
        u32::try_from(n).map_err(|_| format.fault(path, format!("it reports {n} as the {what}")))
    };
    if spec.depth > 1 {
        return Err(ImageError::Unsupported {
            path: path.to_owned(),
            what: format!("a volume of {} slices", spec.depth),
        });
    }
    let (width, height) = (side("width", spec.width)?, side("height", spec.height)?);
    let n = side("number of channels", spec.nchannels)?;
    limits.within(path, "number of channels", u64::from(n), u64::from(limits.channels))?;
    let native = match spec.format {
        3 => Some(PixelType::Float),
        4 => Some(PixelType::Half),
        13 => Some(PixelType::U8),
        15 => Some(PixelType::U16),
        5 | 12 | 14 | 16 | 17 => None,
        other => {
            return Err(format.fault(path, format!("it reports number {other} as the format of channels")));
        }
    };
    let own = reader.converts(format);
    let mut image =
        ImageSpec::new(width, height, n as usize, native.filter(|_| !own).unwrap_or(PixelType::Float));
    (image.x, image.y) = (spec.x, spec.y);
    let full = |n: c_int, own: u32| u32::try_from(n).ok().filter(|n| *n > 0).unwrap_or(own);
    (image.full_width, image.full_height) = (full(spec.full_width, width), full(spec.full_height, height));
    let (tile_width, tile_height) =
        (side("tile width", spec.tile_width)?, side("tile height", spec.tile_height)?);
    if tile_width > 0 && tile_height > 0 {
        (image.tile_width, image.tile_height) = (tile_width, tile_height);
    }
    if !spec.channelnames.is_null() {
        let mut names = Vec::new();
        for c in 0..n as usize {
            // SAFETY: the shim and tables of C pass as many names as channels, or NULL.
            let name = unsafe { ffi::text(*spec.channelnames.add(c)) };
            names.push(name.map_or_else(|| format!("channel{c}"), std::borrow::Cow::into_owned));
        }
        image.channels = usual_names(names);
    }
    limits.check(path, format.name, &image)?;
    reader.attributes(&mut image);
    Ok((image, native.is_none() || own))
}

/// Returns the usual names of channels, such as "R" for "r". A single channel "a" is luminance.
fn usual_names(names: Vec<String>) -> Vec<String> {
    let known = ["R", "G", "B", "A", "Y", "Z"];
    if names.len() == 1 && names[0].eq_ignore_ascii_case("a") {
        return vec!["Y".to_owned()];
    }
    names
        .into_iter()
        .map(|name| match known.iter().find(|k| k.eq_ignore_ascii_case(&name)) {
            Some(known) => (*known).to_owned(),
            None => name,
        })
        .collect()
}

impl Reader {
    /// True when it has conversions of its own.
    fn converts(&self, format: &PluginFormat) -> bool {
        let Some(made) = format.reader else { return false };
        if made.factory.is_null() {
            return made.calls.read_scanline.is_some();
        }
        let base = |name: &str| format.dso.and_then(|d| d.symbol(name)).unwrap_or(std::ptr::null_mut());
        // SAFETY: it is an object of the shim.
        unsafe {
            ffi::gelato_shim_converts(
                self.object.this,
                base("_ZN6Gelato10ImageInput13read_scanlineEiiPfi"),
                base("_ZN6Gelato10ImageInput9read_tileEiiiPfiii"),
            ) != 0
        }
    }

    /// Reads the attributes of the file that the suite uses.
    fn attributes(&mut self, image: &mut ImageSpec) {
        let Some(get) = self.object.calls.get_parameter else { return };
        let this = self.object.this;
        let ask = |name: &str, ty: ParamType, value: *mut c_void| {
            let (name, mut why) = (c_string(name), Text::new());
            // SAFETY: the object is live, and there is room for a value of the requested type.
            unsafe { get(this, name.as_ptr(), ty.to_bits(), value, why.room()) == ffi::OK }
        };
        let mut set = |name: &str, ty: ParamType, data: ParamData| {
            image.attributes.set(Param { name: name.into(), ty, data });
        };
        for name in ["worldtocamera", "worldtoscreen"] {
            let mut m = [0.0f32; 16];
            let room: *mut c_void = m.as_mut_ptr().cast();
            let (matrix, floats) = (ParamType::of(BaseType::Matrix), ParamType::array(BaseType::Float, 16));
            if ask(name, matrix, room) || ask(name, floats, room) {
                set(name, matrix, m[..].into());
            }
        }
        let mut fovcot = 0.0f32;
        let float = ParamType::of(BaseType::Float);
        if ask("fovcot", float, (&raw mut fovcot).cast()) {
            set("fovcot", float, fovcot.into());
        }
        let mut unassociated: c_int = 0;
        let int = ParamType::of(BaseType::Int);
        if ask("unassociatedalpha", int, (&raw mut unassociated).cast()) {
            set("unassociatedalpha", int, unassociated.into());
        }
        let string = ParamType::of(BaseType::String);
        for name in [
            "textureformat",
            "wrapmodes",
            "ImageDescription",
            "DocumentName",
            "Artist",
            "copyright",
            "software",
        ] {
            let mut value: *const std::ffi::c_char = std::ptr::null();
            if ask(name, string, (&raw mut value).cast())
                // SAFETY: it is a string of the plugin, valid until the next call.
                && let Some(text) = unsafe { ffi::text(value) }
            {
                set(name, string, (&*text).into());
            }
        }
    }

    /// Closes it. A reader in the middle of its scanlines may not support that. With `rest`, the remaining scanlines
    /// are read first. When they are too many, the reader is not closed.
    fn end(&mut self, rest: Option<(&ImageSpec, u32)>) {
        if !std::mem::take(&mut self.open) {
            return;
        }
        let mut why = Text::new();
        if let Some((spec, row)) = rest.filter(|(spec, _)| !spec.is_tiled()) {
            let left =
                u64::from(spec.height.saturating_sub(row)) * u64::from(spec.width) * spec.nchannels() as u64;
            if left > MAX_DRAINED {
                return;
            }
            // Doubles are the widest values.
            let mut line = vec![0u64; spec.width as usize * spec.nchannels()];
            for y in row..spec.height {
                // SAFETY: the object is live, and there is room for a line of any format.
                let status = unsafe {
                    (self.object.calls.read_native_scanline)(
                        self.object.this,
                        spec.y.wrapping_add(y as i32),
                        0,
                        line.as_mut_ptr().cast(),
                        why.room(),
                    )
                };
                if status != ffi::OK {
                    break;
                }
            }
        }
        // SAFETY: the object is live and open. An error at the end of reading changes nothing.
        let _ = unsafe { (self.object.calls.close)(self.object.this, why.room()) };
    }
}

impl PluginInput {
    fn fault(&self, what: String) -> ImageError {
        ImageError::Plugin { path: self.path.clone(), plugin: self.title.clone(), what }
    }

    /// Finds the images after the first one.
    fn find_images(&mut self, format: &PluginFormat) -> Result<()> {
        let reader = self.reader.get_mut();
        while self.specs.len() < self.limits.images as usize {
            let (mut spec, mut why) = (empty(), Text::new());
            // SAFETY: the object is live, and there is room for the description.
            let status = unsafe {
                let index = c_int::try_from(self.specs.len()).unwrap_or(c_int::MAX);
                (self.made.calls.seek_subimage)(reader.object.this, index, &raw mut spec, why.room())
            };
            if status != ffi::OK {
                break;
            }
            (reader.image, reader.row) = (self.specs.len(), 0);
            self.specs.push(description(format, &self.path, &spec, &self.limits, reader)?);
        }
        let halves = |a: &ImageSpec, b: &ImageSpec| {
            b.is_tiled() && b.width == (a.width / 2).max(1) && b.height == (a.height / 2).max(1)
        };
        self.levels = self.specs.len() > 1 && self.specs.windows(2).all(|w| halves(&w[0].0, &w[1].0));
        Ok(())
    }

    fn index(&self, image: usize, level: usize) -> Option<usize> {
        let index = match self.levels {
            true if image == 0 => level,
            false if level == 0 => image,
            _ => return None,
        };
        (index < self.specs.len()).then_some(index)
    }

    fn known(&self, image: usize, level: usize) -> Result<(usize, &ImageSpec, bool)> {
        let index = self.index(image, level).ok_or_else(|| ImageError::Misuse {
            path: self.path.clone(),
            what: format!("there is no level {level} of image {image}"),
        })?;
        let (spec, floats) = &self.specs[index];
        Ok((index, spec, *floats))
    }

    /// Brings a reader to an image. When `row` is before the row that the reader reads next, it starts at the first row
    /// again.
    fn seek(&self, reader: &mut Reader, index: usize, row: u32) -> Result<()> {
        let mut why = Text::new();
        if reader.open && reader.image == index && reader.row <= row {
            return Ok(());
        }
        if reader.open && reader.image == index {
            // Readers only go forward, so the file is opened again.
            reader.end(Some((&self.specs[index].0, reader.row)));
        }
        if !reader.open {
            // SAFETY: the plugin's factory, as in `start`.
            let this = unsafe { (self.made.calls.create)(self.made.factory, why.room()) };
            if this.is_null() {
                return Err(self.fault("its create function gave no ImageInput (NULL)".to_owned()));
            }
            let destroy = Some(self.made.calls.destroy);
            *reader = Reader {
                object: Object { calls: self.made.calls, this, destroy },
                image: 0,
                row: 0,
                open: false,
            };
            let mut spec = empty();
            // SAFETY: as in `start`.
            let status =
                unsafe { (self.made.calls.open)(this, self.name.as_ptr(), &raw mut spec, why.room()) };
            if status != ffi::OK {
                return Err(self.fault(failure("open", status, &why)));
            }
            reader.open = true;
            self.unchanged(0, &spec)?;
        }
        if reader.image != index {
            let mut spec = empty();
            let at = c_int::try_from(index).unwrap_or(c_int::MAX);
            // SAFETY: the object is live and open.
            let status =
                unsafe { (self.made.calls.seek_subimage)(reader.object.this, at, &raw mut spec, why.room()) };
            if status != ffi::OK {
                return Err(self.fault(failure("seek_subimage", status, &why)));
            }
            (reader.image, reader.row) = (index, 0);
            self.unchanged(index, &spec)?;
        }
        Ok(())
    }

    /// Checks that the size of an image is still that of its first description, which the buffers have.
    fn unchanged(&self, index: usize, spec: &Spec) -> Result<()> {
        let known = &self.specs[index].0;
        let same = i64::from(spec.width) == i64::from(known.width)
            && i64::from(spec.height) == i64::from(known.height)
            && spec.nchannels as usize == known.nchannels();
        if same { Ok(()) } else { Err(self.fault("the image changed while it was read".to_owned())) }
    }

    fn lock(&self) -> parking_lot::MutexGuard<'_, Reader> {
        self.reader.lock()
    }
}

impl ImageInput for PluginInput {
    fn format_name(&self) -> &'static str {
        self.format
    }

    fn images(&self) -> usize {
        if self.levels { 1 } else { self.specs.len() }
    }

    fn levels(&self, image: usize) -> usize {
        match self.levels {
            true if image == 0 => self.specs.len(),
            false if image < self.specs.len() => 1,
            _ => 0,
        }
    }

    fn spec(&self, image: usize, level: usize) -> Option<&ImageSpec> {
        self.index(image, level).map(|index| &self.specs[index].0)
    }

    fn read_rows(&self, image: usize, level: usize, y0: u32, y1: u32) -> Result<Pixels> {
        let (index, spec, floats) = self.known(image, level)?;
        if y0 > y1 || y1 > spec.height {
            let what = format!("rows {y0} to {y1} of {}", spec.height);
            return Err(ImageError::Misuse { path: self.path.clone(), what });
        }
        self.limits.check_read(&self.path, spec, spec.width, y1 - y0)?;
        if spec.is_tiled() {
            return granita_image::rows_from_tiles(spec, y0, y1, |tx, ty| {
                self.read_tile(image, level, tx, ty)
            });
        }
        let row_values = spec.width as usize * spec.nchannels();
        let row_bytes = row_values * spec.pixel_type.bytes();
        let mut rows = Vec::with_capacity(row_bytes * (y1 - y0) as usize);
        let mut reader = self.lock();
        self.seek(&mut reader, index, y0)?;
        let mut line = vec![0u64; row_values.max(1)];
        let (first, mut why) = (reader.row, Text::new());
        for y in first..y1 {
            let at = spec.y.wrapping_add(y as i32);
            let (this, calls) = (reader.object.this, self.made.calls);
            let room = line.as_mut_ptr();
            // SAFETY: the object is live and open, and there is room for a line of the widest format.
            let status = unsafe {
                match calls.read_scanline.filter(|_| floats) {
                    Some(read) => read(this, at, 0, room.cast(), spec.nchannels() as c_int, why.room()),
                    None => (calls.read_native_scanline)(this, at, 0, room.cast(), why.room()),
                }
            };
            if status != ffi::OK {
                return Err(self.fault(format!("{} (row {y})", failure("read_scanline", status, &why))));
            }
            reader.row = y + 1;
            if y >= y0 {
                rows.extend_from_slice(bytes(&line, row_bytes));
            }
        }
        Ok(pixels(spec, rows))
    }

    fn read_tile(&self, image: usize, level: usize, tx: u32, ty: u32) -> Result<Pixels> {
        let (index, spec, floats) = self.known(image, level)?;
        let (across, down) = spec.tiles();
        if tx >= across || ty >= down {
            let what = format!("there is no tile ({tx}, {ty}) among {across} x {down}");
            return Err(ImageError::Misuse { path: self.path.clone(), what });
        }
        self.limits.check_read(&self.path, spec, spec.tile_width, spec.tile_height)?;
        let n = spec.nchannels();
        let values = spec.tile_width as usize * spec.tile_height as usize * n;
        let mut room = vec![0u64; values.max(1)];
        let mut reader = self.lock();
        self.seek(&mut reader, index, u32::MAX)?;
        let x = spec.x.wrapping_add((tx * spec.tile_width) as i32);
        let y = spec.y.wrapping_add((ty * spec.tile_height) as i32);
        let (this, calls, mut why) = (reader.object.this, self.made.calls, Text::new());
        let stride = |k: u32| (n * k as usize) as c_int;
        // SAFETY: the object is live and open, and there is room for a tile of the widest format.
        let status = unsafe {
            match calls.read_tile.filter(|_| floats) {
                Some(read) => read(
                    this,
                    x,
                    y,
                    0,
                    room.as_mut_ptr().cast(),
                    n as c_int,
                    stride(spec.tile_width),
                    stride(spec.tile_width * spec.tile_height),
                    why.room(),
                ),
                None => (calls.read_native_tile)(this, x, y, 0, room.as_mut_ptr().cast(), why.room()),
            }
        };
        if status != ffi::OK {
            return Err(self.fault(format!("{} (tile {tx}, {ty})", failure("read_tile", status, &why))));
        }
        Ok(pixels(spec, bytes(&room, values * spec.pixel_type.bytes()).to_vec()))
    }

    fn bytes_read(&self) -> u64 {
        self.size
    }
}

/// Returns the first `n` bytes of a buffer.
fn bytes(buffer: &[u64], n: usize) -> &[u8] {
    // SAFETY: the buffer has this number of bytes, and any bits are bytes.
    unsafe { std::slice::from_raw_parts(buffer.as_ptr().cast::<u8>(), n.min(buffer.len() * 8)) }
}

/// Converts bytes in this machine's byte order to values.
fn pixels(spec: &ImageSpec, bytes: Vec<u8>) -> Pixels {
    Pixels::from_bytes(spec.pixel_type, bytes, cfg!(target_endian = "big"))
}

impl Drop for PluginInput {
    fn drop(&mut self) {
        let reader = self.reader.get_mut();
        let rest = self.specs.get(reader.image).map(|(spec, _)| (spec, reader.row));
        reader.end(rest);
    }
}
