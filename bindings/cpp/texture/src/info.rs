//! The data of textures in the types of `granita_texture.h`, and as JSON.

use crate::failure::c_string;
use granita_base::{Param, ParamData, ParamType, Transform};
use granita_image::ImageSpec;
use granita_texture::{TextureCache, TextureId, TextureInfo};
use serde_json::{Map, Value, json};
use std::ffi::{CString, c_char, c_int};
use std::ptr::null;

/// The type `granita_texture_info`.
#[repr(C)]
#[derive(Clone, Copy)]
pub(crate) struct Info {
    path: *const c_char,
    kind: *const c_char,
    ty: *const c_char,
    format: *const c_char,
    swrap: *const c_char,
    twrap: *const c_char,
    width: c_int,
    height: c_int,
    face_width: c_int,
    face_height: c_int,
    tile_width: c_int,
    tile_height: c_int,
    channels: c_int,
    levels: c_int,
    squares: c_int,
    level_sizes: *const c_int,
    average: *const f32,
    channel_names: *const *const c_char,
}

/// The type `granita_texture_metadatum`.
#[repr(C)]
#[derive(Clone, Copy)]
pub(crate) struct Metadatum {
    name: *const c_char,
    ty: *const c_char,
    count: usize,
    floats: *const f32,
    ints: *const c_int,
    strings: *const *const c_char,
}

/// Data of a texture, and the memory that they point to.
pub(crate) struct Described {
    pub(crate) info: Info,
    /// All metadata, in the order of the file. The words "NAME=VALUE" of a description follow.
    metadata: Vec<(String, Metadatum)>,
    pub(crate) json: String,
    _memory: Memory,
}

// SAFETY: the pointers lead to memory that the same value owns, and nothing of it changes.
unsafe impl Send for Described {}
// SAFETY: as above.
unsafe impl Sync for Described {}

/// Texts and arrays that pointers lead to.
#[derive(Default)]
struct Memory {
    texts: Vec<CString>,
    lists: Vec<Vec<*const c_char>>,
    floats: Vec<Vec<f32>>,
    ints: Vec<Vec<c_int>>,
}

impl Memory {
    /// Stores a text. The pointer is valid while `self` lives, because the text is on the heap.
    fn text(&mut self, text: &str) -> *const c_char {
        self.texts.push(c_string(text));
        self.texts[self.texts.len() - 1].as_ptr()
    }

    fn list<'a>(&mut self, texts: impl IntoIterator<Item = &'a str>) -> *const *const c_char {
        let list = texts.into_iter().map(|text| self.text(text)).collect();
        self.lists.push(list);
        self.lists[self.lists.len() - 1].as_ptr()
    }

    fn floats(&mut self, values: &[f32]) -> *const f32 {
        self.floats.push(values.to_vec());
        self.floats[self.floats.len() - 1].as_ptr()
    }

    fn ints(&mut self, values: Vec<c_int>) -> *const c_int {
        self.ints.push(values);
        self.ints[self.ints.len() - 1].as_ptr()
    }

    fn metadatum(&mut self, param: &Param) -> Metadatum {
        let mut datum = Metadatum {
            name: self.text(&param.name),
            ty: self.text(&param.ty.to_string()),
            count: param.data.len(),
            floats: null(),
            ints: null(),
            strings: null(),
        };
        match &param.data {
            ParamData::Float(v) => datum.floats = self.floats(v),
            ParamData::Int(v) => datum.ints = self.ints(v.to_vec()),
            ParamData::String(v) => datum.strings = self.list(v.iter().map(|s| &**s)),
        }
        datum
    }
}

fn int(n: impl TryInto<c_int>) -> c_int {
    n.try_into().unwrap_or(c_int::MAX)
}

/// Returns a number with the digits that identify it in single precision. Numbers that are not finite become null.
fn number(x: f32) -> Value {
    x.to_string().parse::<f64>().map_or(Value::Null, Value::from)
}

fn numbers(values: &[f32]) -> Value {
    values.iter().copied().map(number).collect()
}

/// Returns the data as JSON. A single value is not in a list.
fn data(param: &Param) -> Value {
    let mut all: Vec<Value> = match &param.data {
        ParamData::Float(v) => v.iter().copied().map(number).collect(),
        ParamData::Int(v) => v.iter().copied().map(Value::from).collect(),
        ParamData::String(v) => v.iter().map(|s| Value::from(&**s)).collect(),
    };
    if all.len() == 1 { all.remove(0) } else { Value::Array(all) }
}

/// Returns the metadata of a file. Formats without arbitrary attributes hold some of them as words "NAME=VALUE" of the
/// description. These follow, unless the file has an attribute of the name.
fn metadata(spec: &ImageSpec) -> Vec<Param> {
    let mut all: Vec<Param> = spec.attributes.iter().cloned().collect();
    for word in spec.string("ImageDescription").unwrap_or_default().split_whitespace() {
        if let Some((name, value)) = word.split_once('=')
            && !name.is_empty()
            && all.iter().all(|param| *param.name != *name)
        {
            let ty = ParamType::of(granita_base::BaseType::String);
            all.push(Param { name: name.into(), ty, data: value.into() });
        }
    }
    all
}

/// Returns the mean of each channel as `maketx` stored it in a file.
fn stored_mean(metadata: &[Param], channels: usize) -> Option<Vec<f32>> {
    let param = metadata.iter().find(|param| &*param.name == "oiio:AverageColor")?;
    let mean: Vec<f32> = match &param.data {
        ParamData::String(text) => {
            text.first()?.split([',', ' ']).map(|word| word.trim().parse().ok()).collect::<Option<_>>()?
        }
        other => other.to_floats()?.to_vec(),
    };
    (mean.len() == channels && mean.iter().all(|v| v.is_finite())).then_some(mean)
}

impl Described {
    /// Reads the data of a texture.
    pub(crate) fn read(cache: &TextureCache, id: TextureId) -> Result<Self, String> {
        let about = cache.describe(id);
        let spec = cache.spec(id)?;
        let metadata = metadata(&spec);
        let mean = cache.mean(id).map(|mean| stored_mean(&metadata, about.channels).unwrap_or(mean));
        let mut memory = Memory::default();
        let names: Vec<&str> = (0..about.channels).map(|c| spec.channels.get(c).map_or("", |s| s)).collect();
        let path = about.path.to_string_lossy();
        let [width, height] = about.levels[0];
        let tile = about.tile.unwrap_or_default();
        let sizes = about.levels.iter().flatten().map(|n| int(*n)).collect();
        let info = Info {
            path: memory.text(&path),
            kind: memory.text(about.kind.word()),
            ty: memory.text(about.kind.type_word()),
            format: memory.text(about.pixel_type.word()),
            swrap: memory.text(about.swrap.word()),
            twrap: memory.text(about.twrap.word()),
            width: int(width),
            height: int(height),
            face_width: int(about.face[0]),
            face_height: int(about.face[1]),
            tile_width: int(tile[0]),
            tile_height: int(tile[1]),
            channels: int(about.channels),
            levels: int(about.levels.len()),
            squares: int(about.squares.len()),
            level_sizes: memory.ints(sizes),
            average: mean.as_deref().map_or(null(), |mean| memory.floats(mean)),
            channel_names: memory.list(names.iter().copied()),
        };
        let json = to_json(&about, &names, mean.as_deref(), &metadata);
        let metadata =
            metadata.iter().map(|param| (param.name.to_string(), memory.metadatum(param))).collect();
        Ok(Self { info, metadata, json, _memory: memory })
    }

    /// Returns the metadatum of a name, or of an index.
    pub(crate) fn metadatum(&self, name: Option<&str>, index: usize) -> Option<Metadatum> {
        match name {
            Some(name) => self.metadata.iter().find(|(own, _)| own == name),
            None => self.metadata.get(index),
        }
        .map(|(_, datum)| *datum)
    }
}

fn to_json(about: &TextureInfo, names: &[&str], mean: Option<&[f32]>, metadata: &[Param]) -> String {
    let matrix = |m: &Option<Transform>| m.as_ref().map(|m| numbers(&m.to_rows()));
    let metadata: Map<String, Value> =
        metadata.iter().map(|param| (param.name.to_string(), data(param))).collect();
    let squares: Vec<[u32; 2]> = about.squares.iter().map(|square| [square.column, square.row]).collect();
    json!({
        "path": about.path.to_string_lossy(),
        "kind": about.kind.word(),
        "type": about.kind.type_word(),
        "format": about.pixel_type.word(),
        "width": about.levels[0][0],
        "height": about.levels[0][1],
        "face": about.face,
        "tile": about.tile,
        "channels": about.channels,
        "channel_names": names,
        "levels": about.levels,
        "wrap": [about.swrap.word(), about.twrap.word()],
        "up": about.up.word(),
        "squares": squares,
        "average": mean.map(numbers),
        "world_to_camera": matrix(&about.world_to_camera),
        "world_to_screen": matrix(&about.world_to_screen),
        "metadata": metadata,
    })
    .to_string()
}
