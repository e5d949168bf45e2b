//! Images for programs (`MakeImageOutput`, `MakeImageInput`). They are a plugin's own objects, or bundled formats
//! behind the tables of `gelato_c.h`.

use super::{PluginFormat, Writer};
use crate::ffi::{self, ABI, ImageParameter, InputCalls, Message, OutputCalls, Spec, Text};
use crate::interface::c_string;
use crate::plugins::Plugins;
use granita_base::{BaseType, Param, ParamData, ParamType, Params};
use granita_image::{
    CreateOptions, Format, FormatRegistry, ImageInput, ImageOutput, ImageSpec, Limits, PixelType, Placement,
    Quantize,
};
use std::ffi::{CString, c_char, c_int, c_uint, c_void};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Arc;

unsafe extern "C" {
    fn gelato_shim_table_output(calls: *const OutputCalls, this: *mut c_void) -> *mut c_void;
    fn gelato_shim_table_input(calls: *const InputCalls, this: *mut c_void) -> *mut c_void;
}

impl PluginFormat {
    /// Makes a C++ object of the plugin; `None` when it is not a plugin in C++.
    fn cpp_writer(&self) -> Option<Result<*mut c_void, String>> {
        let Writer::Made(made) = self.writer else { return None };
        let (calls, factory) = (made.calls, made.factory);
        (!factory.is_null()).then(|| {
            let mut why = Text::new();
            // SAFETY: it is the plugin's factory, of the form that its version declares.
            let object = unsafe { (calls.create)(factory, why.room()) };
            self.object(object, &why)
        })
    }

    fn object(&self, object: *mut c_void, why: &Text) -> Result<*mut c_void, String> {
        if object.is_null() {
            let why = why.get().unwrap_or_else(|| "NULL".to_owned());
            return Err(format!("{}: its create function gave no object: {why}", self.title));
        }
        Ok(object)
    }
}

impl Plugins {
    /// Makes a C++ `ImageOutput *`, which the caller deletes, for `format` or for the extension of the file.
    ///
    /// # Errors
    /// Returns the reason why there is none.
    pub fn make_image_output(&self, file: &str, format: Option<&str>) -> Result<*mut c_void, String> {
        let extension = Path::new(file).extension().map(|e| e.to_string_lossy().into_owned());
        let name = format.filter(|f| !f.is_empty()).map(str::to_owned).or(extension);
        let name = name
            .ok_or_else(|| format!("{file}: neither the format nor the extension names an image format"))?;
        if let Some(made) = self.image_named(&name).and_then(|plugin| plugin.cpp_writer()) {
            return made;
        }
        let mut registry = crate::bundled_formats(Limits::default());
        if registry.by_name(&name).is_none() {
            if let Some(made) = self.image_listed(&name, true).and_then(|plugin| plugin.cpp_writer()) {
                return made;
            }
            // Plugins in C are found through the registry.
            registry.find_with(Arc::new(self.clone()));
        }
        let format = registry.by_name(&name).filter(|f| f.supports("write"));
        let format =
            format.ok_or_else(|| format!("{file}: there is no image format \"{name}\" that writes"))?;
        let this = Box::into_raw(Box::new(Out {
            format,
            file: None,
            quantize: Quantize::FLOAT,
            spec: None,
            row: 0,
        }));
        // SAFETY: the table fits the object, which it destroys.
        let object = unsafe { gelato_shim_table_output(&raw const OUTPUT, this.cast()) };
        if object.is_null() {
            // SAFETY: it was not passed on.
            drop(unsafe { Box::from_raw(this) });
            return Err("there is not enough memory".to_owned());
        }
        Ok(object)
    }

    /// Makes a C++ `ImageInput *` that reads the file. The caller opens and deletes it.
    ///
    /// # Errors
    /// Returns the reason why there is none.
    pub fn make_image_input(&self, file: &str) -> Result<*mut c_void, String> {
        let mut registry = crate::bundled_formats(Limits::default());
        registry.find_with(Arc::new(self.clone()));
        // This checks that a format can open the file.
        drop(registry.open(Path::new(file)).map_err(|e| e.to_string())?);
        let this = Box::into_raw(Box::new(In {
            registry,
            file: None,
            text: Vec::new(),
            names: Vec::new(),
            at: (0, 0),
        }));
        // SAFETY: the table fits the object, which it destroys.
        let object = unsafe { gelato_shim_table_input(&raw const INPUT, this.cast()) };
        if object.is_null() {
            // SAFETY: it was not passed on.
            drop(unsafe { Box::from_raw(this) });
            return Err("there is not enough memory".to_owned());
        }
        Ok(object)
    }
}

/// A writer of a bundled format.
struct Out {
    format: Arc<dyn Format>,
    file: Option<Box<dyn ImageOutput>>,
    quantize: Quantize,
    spec: Option<ImageSpec>,
    row: u32,
}

/// A reader of a bundled format, or of plugins in C.
struct In {
    registry: FormatRegistry,
    file: Option<Box<dyn ImageInput>>,
    /// The strings that were passed out.
    text: Vec<CString>,
    names: Vec<*const c_char>,
    /// The current image and level.
    at: (usize, usize),
}

/// Runs `f` on the object of a table. An error or a panic becomes the message.
fn on<T>(this: *mut c_void, message: Message, f: impl FnOnce(&mut T) -> Result<(), String>) -> c_int {
    // SAFETY: the table is called with its own object, by one thread at a time.
    let Some(object) = (unsafe { this.cast::<T>().as_mut() }) else { return 1 };
    match catch_unwind(AssertUnwindSafe(|| f(object))) {
        Ok(Ok(())) => ffi::OK,
        Ok(Err(what)) => {
            tell(message, &what);
            1
        }
        Err(panic) => {
            tell(message, &crate::panic_text(&*panic));
            1
        }
    }
}

fn tell(message: Message, what: &str) {
    if message.text.is_null() || message.size == 0 {
        return;
    }
    let text = c_string(what);
    let bytes = &text.as_bytes()[..text.as_bytes().len().min(message.size - 1)];
    // SAFETY: there is room for this number of bytes and the end.
    unsafe {
        std::ptr::copy_nonoverlapping(bytes.as_ptr(), message.text.cast(), bytes.len());
        *message.text.add(bytes.len()) = 0;
    }
}

unsafe extern "C" fn nothing(_: *mut c_void, _: Message) -> *mut c_void {
    std::ptr::null_mut()
}

unsafe extern "C" fn end<T>(this: *mut c_void) {
    // SAFETY: the class over the table calls this once, with the object that it got.
    let object = unsafe { Box::from_raw(this.cast::<T>()) };
    let _ = catch_unwind(AssertUnwindSafe(|| drop(object)));
}

static OUTPUT: OutputCalls = OutputCalls {
    abi: ABI,
    create: nothing,
    supports: out_supports,
    open: out_open,
    write_scanline: out_scanline,
    write_tile: out_tile,
    write_rectangle: None,
    close: out_close,
    destroy: end::<Out>,
};

unsafe extern "C" fn out_supports(this: *mut c_void) -> c_int {
    let mut bits = 0;
    on(this, Message { text: std::ptr::null_mut(), size: 0 }, |out: &mut Out| {
        bits |= if out.format.supports("tiles") { ffi::TILES } else { 0 };
        bits |= if out.format.supports("levels") { ffi::MULTIIMAGE } else { 0 };
        Ok(())
    });
    bits
}

/// Converts parameters from C.
///
/// # Safety
/// `list` has `n` parameters with as much data as they declare.
unsafe fn params(n: c_int, list: *const ImageParameter) -> Params {
    let mut all = Params::new();
    let n = if list.is_null() { 0 } else { usize::try_from(n).unwrap_or(0) };
    for k in 0..n {
        // SAFETY: the list has this number of parameters, each with its data.
        unsafe {
            let p = &*list.add(k);
            let (Some(name), Ok(count)) = (ffi::text(p.name), usize::try_from(p.nvalues)) else { continue };
            if p.value.is_null() || count == 0 {
                continue;
            }
            let base = match u32::try_from(p.ty).ok().and_then(BaseType::from_number) {
                Some(BaseType::Point | BaseType::Vector | BaseType::Normal | BaseType::HPoint) | None => {
                    continue;
                }
                Some(base) => base,
            };
            let data = match base {
                BaseType::String => ParamData::String(
                    std::slice::from_raw_parts(p.value.cast::<*const c_char>(), count)
                        .iter()
                        .map(|t| Arc::from(&*ffi::text(*t).unwrap_or_default()))
                        .collect(),
                ),
                BaseType::Int => std::slice::from_raw_parts(p.value.cast::<i32>(), count).into(),
                _ => std::slice::from_raw_parts(p.value.cast::<f32>(), count * base.components()).into(),
            };
            let is_matrix =
                base == BaseType::Float && count == 16 && matches!(&*name, "worldtocamera" | "worldtoscreen");
            let ty = match count {
                _ if is_matrix => ParamType::of(BaseType::Matrix),
                1 => ParamType::of(base),
                n => ParamType::array(base, u32::try_from(n).unwrap_or(u32::MAX)),
            };
            all.set(Param { name: (&*name).into(), ty, data });
        }
    }
    all
}

unsafe extern "C" fn out_open(
    this: *mut c_void,
    name: *const c_char,
    spec: *const Spec,
    nparams: c_int,
    list: *const ImageParameter,
    append: c_int,
    message: Message,
) -> c_int {
    on(this, message, |out: &mut Out| {
        // SAFETY: the class over the table passes a string, a description and its parameters.
        let (name, spec, params) =
            unsafe { (ffi::text(name).unwrap_or_default(), &*spec, params(nparams, list)) };
        let side = |n: c_int| u32::try_from(n).map_err(|_| format!("{n} is not a valid size"));
        let (quantize, stored) = if params.get(granita_scene::attr::QUANTIZE.name()).is_some() {
            Quantize::for_output(&*out.format, &params)
        } else {
            let wanted = match spec.format {
                13 => PixelType::U8,
                15 => PixelType::U16,
                4 => PixelType::Half,
                _ => PixelType::Float,
            };
            let stored = out.format.output_type(wanted);
            let levels = match stored {
                PixelType::U8 => Quantize { one: 255, max: 255, ..Quantize::FLOAT },
                PixelType::U16 => Quantize { one: 65535, max: 65535, ..Quantize::FLOAT },
                _ => Quantize::FLOAT,
            };
            (levels, stored)
        };
        let mut image =
            ImageSpec::new(side(spec.width)?, side(spec.height)?, side(spec.nchannels)? as usize, stored);
        (image.x, image.y) = (spec.x, spec.y);
        if spec.full_width > 0 && spec.full_height > 0 {
            (image.full_width, image.full_height) = (side(spec.full_width)?, side(spec.full_height)?);
        }
        (image.tile_width, image.tile_height) = (side(spec.tile_width)?, side(spec.tile_height)?);
        if !spec.channelnames.is_null() {
            for c in 0..image.nchannels() {
                // SAFETY: there are as many names as channels.
                if let Some(name) = unsafe { ffi::text(*spec.channelnames.add(c)) } {
                    image.channels[c] = name.into_owned();
                }
            }
        }
        let own = ["quantize", "gain", "gamma", "dither"];
        image.attributes = params.iter().filter(|p| !own.contains(&&*p.name)).cloned().collect();
        let path = PathBuf::from(&*name);
        Limits::default().check(&path, "image", &image).map_err(|e| e.to_string())?;
        match (&mut out.file, append) {
            (Some(file), 1) => file.next_level(&image).map_err(|e| e.to_string())?,
            _ => {
                // The number of levels is not known. Formats that need it report an error.
                let made = out.format.create(&path, &CreateOptions::new(&image, 1));
                out.file = Some(made.map_err(|e| e.to_string())?);
            }
        }
        (out.quantize, out.spec, out.row) = (quantize, Some(image), 0);
        Ok(())
    })
}

/// Returns the pixels of a rectangle behind a pointer, side by side.
///
/// # Safety
/// The pixels exist at these strides.
unsafe fn gathered(
    data: *const f32,
    size: [usize; 2],
    n: usize,
    strides: [c_int; 2],
) -> Result<Vec<f32>, String> {
    if data.is_null() {
        return Err("the pixels are NULL".to_owned());
    }
    let mut values = Vec::with_capacity(size[0] * size[1] * n);
    for y in 0..size[1] {
        for x in 0..size[0] {
            let at = y as isize * strides[1] as isize + x as isize * strides[0] as isize;
            // SAFETY: the pixels exist by the contract.
            values.extend_from_slice(unsafe { std::slice::from_raw_parts(data.offset(at), n) });
        }
    }
    Ok(values)
}

unsafe extern "C" fn out_scanline(
    this: *mut c_void,
    y: c_int,
    _z: c_int,
    data: *const f32,
    xstride: c_int,
    message: Message,
) -> c_int {
    on(this, message, |out: &mut Out| {
        let (Some(file), Some(spec)) = (&mut out.file, &out.spec) else {
            return Err("the file is not open".to_owned());
        };
        if i64::from(y) != i64::from(spec.y) + i64::from(out.row) {
            return Err(format!("scanline {y} comes after {}: they have to come in order", out.row));
        }
        // SAFETY: the pixels exist by the interface.
        let values = unsafe { gathered(data, [spec.width as usize, 1], spec.nchannels(), [xstride, 0])? };
        let at = Placement {
            x: spec.x,
            y,
            width: spec.width as usize,
            nchannels: spec.nchannels(),
            alpha: spec.alpha_channel(),
        };
        out.row += 1;
        file.write_rows(&out.quantize.apply(&values, &at, spec.pixel_type)).map_err(|e| e.to_string())
    })
}

unsafe extern "C" fn out_tile(
    this: *mut c_void,
    x: c_int,
    y: c_int,
    _z: c_int,
    data: *const f32,
    xstride: c_int,
    ystride: c_int,
    _zstride: c_int,
    message: Message,
) -> c_int {
    on(this, message, |out: &mut Out| {
        let (Some(file), Some(spec)) = (&mut out.file, &out.spec) else {
            return Err("the file is not open".to_owned());
        };
        let tile = |at: c_int, begin: i32, size: u32| {
            let from = u32::try_from(i64::from(at) - i64::from(begin)).ok()?;
            (size > 0).then(|| from / size)
        };
        let (tx, ty) = (tile(x, spec.x, spec.tile_width), tile(y, spec.y, spec.tile_height));
        let (Some(tx), Some(ty)) = (tx, ty) else { return Err(format!("there is no tile at {x}, {y}")) };
        let size = [spec.tile_width as usize, spec.tile_height as usize];
        // SAFETY: the pixels exist by the interface.
        let values = unsafe { gathered(data, size, spec.nchannels(), [xstride, ystride])? };
        let at = Placement { x, y, width: size[0], nchannels: spec.nchannels(), alpha: spec.alpha_channel() };
        file.write_tile(tx, ty, &out.quantize.apply(&values, &at, spec.pixel_type)).map_err(|e| e.to_string())
    })
}

unsafe extern "C" fn out_close(this: *mut c_void, message: Message) -> c_int {
    on(this, message, |out: &mut Out| match out.file.take() {
        Some(file) => file.close().map_err(|e| e.to_string()),
        None => Err("the file is not open".to_owned()),
    })
}

static INPUT: InputCalls = InputCalls {
    abi: ABI,
    create: nothing,
    open: in_open,
    seek_subimage: in_seek,
    read_native_scanline: in_scanline,
    read_native_tile: in_tile,
    read_scanline: None,
    read_tile: None,
    get_parameter: Some(in_parameter),
    close: in_close,
    destroy: end::<In>,
};

impl In {
    /// Returns the image and the level of an index, which counts the levels of all images in order.
    fn place(&self, index: usize) -> Option<(usize, usize)> {
        let file = self.file.as_ref()?;
        let mut left = index;
        for image in 0..file.images() {
            let levels = file.levels(image);
            if left < levels {
                return Some((image, left));
            }
            left -= levels;
        }
        None
    }

    fn spec(&self) -> Result<&ImageSpec, String> {
        let file = self.file.as_ref().ok_or("the file is not open")?;
        file.spec(self.at.0, self.at.1).ok_or_else(|| "there is no such image".to_owned())
    }

    fn describe(&mut self, into: *mut Spec) -> Result<(), String> {
        let spec = self.spec()?.clone();
        let int = |n: u32| c_int::try_from(n).unwrap_or(c_int::MAX);
        self.text = spec.channels.iter().map(|c| c_string(c)).collect();
        self.names = self.text.iter().map(|c| c.as_ptr()).collect();
        let described = Spec {
            x: spec.x,
            y: spec.y,
            z: 0,
            width: int(spec.width),
            height: int(spec.height),
            depth: 1,
            full_width: int(spec.full_width),
            full_height: int(spec.full_height),
            full_depth: 1,
            tile_width: int(spec.tile_width),
            tile_height: int(spec.tile_height),
            tile_depth: c_int::from(spec.is_tiled()),
            nchannels: int(spec.nchannels() as u32),
            format: super::output::base_type(spec.pixel_type),
            channelnames: self.names.as_ptr(),
        };
        // SAFETY: the class over the table passes room for a description.
        unsafe { into.write(described) };
        Ok(())
    }

    fn give(pixels: &granita_image::Pixels, data: *mut c_void) -> Result<(), String> {
        if data.is_null() {
            return Err("the buffer is NULL".to_owned());
        }
        let mut bytes = Vec::new();
        pixels.append_le_bytes(&mut bytes);
        if cfg!(target_endian = "big") {
            bytes.chunks_exact_mut(pixels.pixel_type().bytes()).for_each(<[u8]>::reverse);
        }
        // SAFETY: by the interface there is room for a scanline or tile of the image's format.
        unsafe { std::ptr::copy_nonoverlapping(bytes.as_ptr(), data.cast(), bytes.len()) };
        Ok(())
    }
}

unsafe extern "C" fn in_open(
    this: *mut c_void,
    name: *const c_char,
    spec: *mut Spec,
    message: Message,
) -> c_int {
    on(this, message, |input: &mut In| {
        // SAFETY: the name is a string.
        let name = unsafe { ffi::text(name) }.unwrap_or_default();
        input.file = Some(input.registry.open(Path::new(&*name)).map_err(|e| e.to_string())?);
        input.at = (0, 0);
        input.describe(spec)
    })
}

unsafe extern "C" fn in_seek(this: *mut c_void, index: c_int, spec: *mut Spec, message: Message) -> c_int {
    on(this, message, |input: &mut In| {
        let place = usize::try_from(index).ok().and_then(|index| input.place(index));
        input.at = place.ok_or_else(|| format!("there is no image {index}"))?;
        input.describe(spec)
    })
}

unsafe extern "C" fn in_scanline(
    this: *mut c_void,
    y: c_int,
    _z: c_int,
    data: *mut c_void,
    message: Message,
) -> c_int {
    on(this, message, |input: &mut In| {
        let spec = input.spec()?;
        let row = u32::try_from(i64::from(y) - i64::from(spec.y)).ok().filter(|row| *row < spec.height);
        let (row, file) = (row.ok_or_else(|| format!("there is no scanline {y}"))?, input.file.as_ref());
        let file = file.ok_or("the file is not open")?;
        let pixels = file.read_rows(input.at.0, input.at.1, row, row + 1).map_err(|e| e.to_string())?;
        In::give(&pixels, data)
    })
}

unsafe extern "C" fn in_tile(
    this: *mut c_void,
    x: c_int,
    y: c_int,
    _z: c_int,
    data: *mut c_void,
    message: Message,
) -> c_int {
    on(this, message, |input: &mut In| {
        let spec = input.spec()?;
        let tile = |at: c_int, begin: i32, size: u32| {
            let from = u32::try_from(i64::from(at) - i64::from(begin)).ok()?;
            (size > 0).then(|| from / size)
        };
        let (tx, ty) = (tile(x, spec.x, spec.tile_width), tile(y, spec.y, spec.tile_height));
        let (Some(tx), Some(ty)) = (tx, ty) else { return Err(format!("there is no tile at {x}, {y}")) };
        let file = input.file.as_ref().ok_or("the file is not open")?;
        let pixels = file.read_tile(input.at.0, input.at.1, tx, ty).map_err(|e| e.to_string())?;
        In::give(&pixels, data)
    })
}

unsafe extern "C" fn in_parameter(
    this: *mut c_void,
    name: *const c_char,
    bits: c_uint,
    value: *mut c_void,
    message: Message,
) -> c_int {
    on(this, message, |input: &mut In| {
        // SAFETY: the name is a string.
        let name = unsafe { ffi::text(name) }.unwrap_or_default();
        let absent = || format!("the file has no \"{name}\" of that type");
        let param =
            input.spec()?.attributes.get(&name).cloned().filter(|_| !value.is_null()).ok_or_else(absent)?;
        let ty = ParamType::from_bits(bits).map_err(|_| absent())?;
        if param.data.len() != ty.width() {
            return Err(absent());
        }
        // SAFETY: by the interface there is room for a value of the requested type.
        unsafe {
            match (&param.data, ty.base) {
                (ParamData::String(v), BaseType::String) => {
                    for (k, text) in v.iter().enumerate() {
                        let text = c_string(text);
                        *value.cast::<*const c_char>().add(k) = text.as_ptr();
                        input.text.push(text);
                    }
                }
                (ParamData::Int(v), BaseType::Int) => {
                    std::ptr::copy_nonoverlapping(v.as_ptr(), value.cast(), v.len());
                }
                (ParamData::String(_) | ParamData::Int(_), _) | (_, BaseType::String | BaseType::Int) => {
                    return Err(absent());
                }
                (ParamData::Float(v), _) => {
                    std::ptr::copy_nonoverlapping(v.as_ptr(), value.cast(), v.len());
                }
            }
        }
        Ok(())
    })
}

unsafe extern "C" fn in_close(this: *mut c_void, message: Message) -> c_int {
    on(this, message, |input: &mut In| {
        input.file = None;
        Ok(())
    })
}
