//! Files, and images in memory, that a plugin writes.

use super::{Object, PluginFormat, Writer, failure};
use crate::ffi::{self, ImageParameter, OutputCalls, Spec, Text};
use crate::interface::c_string;
use granita_base::{BaseType, Param, ParamData, ParamType, Params};
use granita_image::{
    CreateOptions, ImageError, ImageOutput, ImageSpec, PixelRect, PixelType, Pixels, Result,
};
use std::ffi::{CString, c_char, c_int, c_void};
use std::path::{Path, PathBuf};

struct PluginOutput {
    object: Object<OutputCalls>,
    title: String,
    path: PathBuf,
    spec: ImageSpec,
    row: u32,
    multiimage: bool,
    /// True when the file did not exist before, so that an incomplete one is removed.
    fresh: bool,
    done: bool,
}

/// Returns the object of a writer.
fn object(format: &PluginFormat, path: &Path) -> Result<Object<OutputCalls>> {
    match format.writer {
        Writer::None => Err(format.fault(path, "it does not write images")),
        Writer::Program(address) => {
            // SAFETY: the shim's table is static.
            let calls = unsafe { &*ffi::gelato_shim_output() };
            Ok(Object { calls, this: address as *mut c_void, destroy: None })
        }
        Writer::Made(made) => {
            let mut why = Text::new();
            // SAFETY: it is the plugin's factory, of the form that its version declares.
            let this = unsafe { (made.calls.create)(made.factory, why.room()) };
            if this.is_null() {
                let why = why
                    .get()
                    .map_or("gave no ImageOutput (NULL)".to_owned(), |t| format!("threw an exception: {t}"));
                return Err(format.fault(path, format!("its create function {why}")));
            }
            Ok(Object { calls: made.calls, this, destroy: Some(made.calls.destroy) })
        }
    }
}

/// Returns the bits of the features of a format.
pub(super) fn features(format: &PluginFormat) -> c_int {
    // SAFETY: the object is live.
    object(format, Path::new("")).map_or(0, |o| unsafe { (o.calls.supports)(o.this) })
}

/// Creates a file.
pub(super) fn create(
    format: &PluginFormat,
    path: &Path,
    options: &CreateOptions<'_>,
) -> Result<Box<dyn ImageOutput>> {
    let object = object(format, path)?;
    // SAFETY: the object is live.
    let features = unsafe { (object.calls.supports)(object.this) };
    let fresh = format.dso.is_some() && !path.exists();
    let mut output = PluginOutput {
        object,
        title: format.title.clone(),
        path: path.to_owned(),
        spec: options.spec.clone(),
        row: 0,
        multiimage: features & ffi::MULTIIMAGE != 0,
        fresh,
        done: false,
    };
    if options.spec.is_tiled() && features & ffi::TILES == 0 {
        return Err(output.fault("it does not write tiles".to_owned()));
    }
    if options.levels > 1 && !output.multiimage {
        return Err(output.fault("it does not write several images into one file".to_owned()));
    }
    output.open(options.spec, false)?;
    Ok(Box::new(output))
}

/// Parameters in the form of C, with the data that they point to.
#[derive(Default)]
struct List {
    params: Vec<ImageParameter>,
    names: Vec<CString>,
    strings: Vec<CString>,
    pointers: Vec<Vec<*const c_char>>,
    kept: Vec<Param>,
}

impl List {
    fn add(&mut self, param: &Param) {
        let count = |n: usize| c_int::try_from(n).unwrap_or(c_int::MAX);
        self.names.push(c_string(&param.name));
        self.kept.push(param.clone());
        let name = self.names[self.names.len() - 1].as_ptr();
        // The data is behind an `Arc` and the strings are on the heap, so that their addresses stay the same.
        let (ty, nvalues, value): (c_int, c_int, *const c_void) = match &param.data {
            ParamData::Int(v) => (16, count(v.len()), v.as_ptr().cast()),
            ParamData::Float(v) => {
                // Only triples are passed with their type. A matrix is passed as 16 floats (reference 13.3.2).
                let base = match param.ty.base.components() {
                    3 => param.ty.base,
                    _ => BaseType::Float,
                };
                let number = c_int::try_from(base.number()).expect("numbers of types are small");
                (number, count(v.len() / base.components()), v.as_ptr().cast())
            }
            ParamData::String(v) => {
                let mut pointers = Vec::new();
                for text in v.iter() {
                    self.strings.push(c_string(text));
                    pointers.push(self.strings[self.strings.len() - 1].as_ptr());
                }
                self.pointers.push(pointers);
                (2, count(v.len()), self.pointers[self.pointers.len() - 1].as_ptr().cast())
            }
        };
        self.params.push(ImageParameter { name, ty, nvalues, value });
    }
}

/// Adds the parameters of the conversion from floats to integers that are not given. They are those of the stored type.
fn quantization(spec: &ImageSpec, list: &mut List) {
    let mut given = Params::new();
    let levels: [i32; 4] = match spec.pixel_type {
        PixelType::U8 => [0, 255, 0, 255],
        PixelType::U16 => [0, 65535, 0, 65535],
        PixelType::U32 | PixelType::Half | PixelType::Float => [0; 4],
    };
    let float = ParamType::of(BaseType::Float);
    given.set(Param {
        name: "quantize".into(),
        ty: ParamType::array(BaseType::Int, 4),
        data: levels[..].into(),
    });
    for (name, value) in [("gain", 1.0), ("gamma", 1.0), ("dither", 0.0)] {
        given.set(Param { name: name.into(), ty: float, data: value.into() });
    }
    given.iter().filter(|p| spec.attributes.get(&p.name).is_none()).for_each(|p| list.add(p));
}

/// Returns the number of a pixel type, such as `PT_UINT8`.
pub(super) fn base_type(pixels: PixelType) -> c_int {
    match pixels {
        PixelType::U8 => 13,
        PixelType::U16 => 15,
        PixelType::U32 => 17,
        PixelType::Half => 4,
        PixelType::Float => 3,
    }
}

impl PluginOutput {
    fn fault(&self, what: String) -> ImageError {
        ImageError::Plugin { path: self.path.clone(), plugin: self.title.clone(), what }
    }

    fn open(&mut self, image: &ImageSpec, append: bool) -> Result<()> {
        let int = |n: u32| c_int::try_from(n).unwrap_or(c_int::MAX);
        let names: Vec<CString> = image.channels.iter().map(|c| c_string(c)).collect();
        let names: Vec<*const c_char> = names.iter().map(|c| c.as_ptr()).collect::<Vec<_>>();
        let mut list = List::default();
        image.attributes.iter().for_each(|param| list.add(param));
        quantization(image, &mut list);
        let asked = image.attributes.get(granita_scene::attr::QUANTIZE.name()).and_then(|p| p.data.to_ints());
        let format = match asked.as_deref() {
            Some([0, 0, 0, 0]) => PixelType::Float,
            Some([.., max]) if *max > 255 => PixelType::U16,
            Some(_) => PixelType::U8,
            None => image.pixel_type,
        };
        let spec = Spec {
            x: image.x,
            y: image.y,
            z: 0,
            width: int(image.width),
            height: int(image.height),
            depth: 1,
            full_width: int(image.full_width),
            full_height: int(image.full_height),
            full_depth: 1,
            tile_width: int(image.tile_width),
            tile_height: int(image.tile_height),
            tile_depth: c_int::from(image.is_tiled()),
            nchannels: int(image.nchannels() as u32),
            format: base_type(format),
            channelnames: names.as_ptr(),
        };
        let (name, mut why) = (c_string(&self.path.to_string_lossy()), Text::new());
        // SAFETY: the object is live, and all passed data lives until the call is done.
        let status = unsafe {
            (self.object.calls.open)(
                self.object.this,
                name.as_ptr(),
                &raw const spec,
                c_int::try_from(list.params.len()).unwrap_or(0),
                list.params.as_ptr(),
                c_int::from(append),
                why.room(),
            )
        };
        if status != ffi::OK {
            return Err(self.fault(failure("open", status, &why)));
        }
        self.spec = image.clone();
        self.row = 0;
        Ok(())
    }
}

impl ImageOutput for PluginOutput {
    fn write_rows(&mut self, pixels: &Pixels) -> Result<()> {
        let values = pixels.to_floats();
        let (n, mut why) = (self.spec.nchannels(), Text::new());
        for line in values.chunks_exact((self.spec.width as usize * n).max(1)) {
            let y = self.spec.y.wrapping_add(self.row as i32);
            // SAFETY: the object is live and open, and the line of floats is whole.
            let status = unsafe {
                let calls = self.object.calls;
                (calls.write_scanline)(self.object.this, y, 0, line.as_ptr(), n as c_int, why.room())
            };
            if status != ffi::OK {
                let what = format!("{} (row {})", failure("write_scanline", status, &why), self.row);
                return Err(self.fault(what));
            }
            self.row += 1;
        }
        Ok(())
    }

    fn write_tile(&mut self, tx: u32, ty: u32, pixels: &Pixels) -> Result<()> {
        let values = pixels.to_floats();
        let (n, mut why) = (self.spec.nchannels(), Text::new());
        let (w, h) = (self.spec.tile_width as usize, self.spec.tile_height as usize);
        if values.len() < w * h * n {
            let what = format!("a tile of {} values instead of {}", values.len(), w * h * n);
            return Err(ImageError::Misuse { path: self.path.clone(), what });
        }
        let x = self.spec.x.wrapping_add((tx as usize * w) as i32);
        let y = self.spec.y.wrapping_add((ty as usize * h) as i32);
        // SAFETY: the object is live and open, and the tile of floats is whole.
        let status = unsafe {
            (self.object.calls.write_tile)(
                self.object.this,
                x,
                y,
                0,
                values.as_ptr(),
                n as c_int,
                (n * w) as c_int,
                (n * w * h) as c_int,
                why.room(),
            )
        };
        if status != ffi::OK {
            return Err(self.fault(format!("{} (tile {tx}, {ty})", failure("write_tile", status, &why))));
        }
        Ok(())
    }

    fn write_rectangle(&mut self, rect: &PixelRect, pixels: &Pixels) -> Result<()> {
        let Some(write) = self.object.calls.write_rectangle else {
            return Err(self.fault("it does not take rectangles".to_owned()));
        };
        let values = pixels.to_floats();
        let (n, mut why) = (self.spec.nchannels(), Text::new());
        let (width, height) = (rect.width(), rect.height());
        if width == 0 || height == 0 {
            return Ok(());
        }
        if values.len() < width * height * n {
            let what = format!("a rectangle of {} values instead of {}", values.len(), width * height * n);
            return Err(ImageError::Misuse { path: self.path.clone(), what });
        }
        let x = self.spec.x.wrapping_add(rect.x0);
        let y = self.spec.y.wrapping_add(rect.y0);
        // SAFETY: the object is live and open, and the rectangle of floats is whole.
        let status = unsafe {
            write(
                self.object.this,
                x,
                x.wrapping_add(width as i32 - 1),
                y,
                y.wrapping_add(height as i32 - 1),
                values.as_ptr(),
                n as c_int,
                (n * width) as c_int,
                why.room(),
            )
        };
        if status != ffi::OK {
            let what = format!("{} (from {x}, {y})", failure("write_rectangle", status, &why));
            return Err(self.fault(what));
        }
        Ok(())
    }

    fn next_level(&mut self, spec: &ImageSpec) -> Result<()> {
        if !self.multiimage {
            return Err(self.fault("it does not write several images into one file".to_owned()));
        }
        self.open(&spec.clone(), true)
    }

    fn close(mut self: Box<Self>) -> Result<()> {
        self.done = true;
        let mut why = Text::new();
        // SAFETY: the object is live and open.
        let status = unsafe { (self.object.calls.close)(self.object.this, why.room()) };
        if status != ffi::OK {
            return Err(self.fault(failure("close", status, &why)));
        }
        Ok(())
    }
}

impl Drop for PluginOutput {
    fn drop(&mut self) {
        if !self.done && self.fresh {
            // The image is incomplete. Its writer may not support `close` now. Its object is destroyed after this.
            let _ = std::fs::remove_file(&self.path);
        }
    }
}
