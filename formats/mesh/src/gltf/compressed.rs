//! Compressed geometry: primitives of the extension `KHR_draco_mesh_compression`, and buffer views of the extensions
//! `EXT_meshopt_compression` and `KHR_meshopt_compression`.

use super::buffers::Buffers;
use super::document::{BufferView, Document, Primitive, item};
use serde_json::Value;
use std::collections::BTreeMap;

/// The extension of primitives.
pub(super) const DRACO: &str = "KHR_draco_mesh_compression";
/// The names of the extension of buffer views. The second one allows more than the first.
#[cfg(feature = "meshopt")]
const MESHOPT: [&str; 2] = ["EXT_meshopt_compression", "KHR_meshopt_compression"];
/// The largest number of bytes of a decoded buffer view.
#[cfg(feature = "meshopt")]
const MOST_BYTES: usize = 1 << 30;

/// The decoded data of a primitive.
#[derive(Debug, Default)]
pub(super) struct Decoded {
    /// The indices of its triangles.
    pub(super) indices: Vec<u32>,
    /// The number of its vertices.
    pub(super) count: u64,
    /// The values of accessors, and the number of values for each vertex. Integers are not normalised.
    pub(super) attributes: BTreeMap<usize, (Vec<f32>, usize)>,
}

/// Returns a number of an object in JSON.
fn number(object: &Value, name: &str) -> Option<u64> {
    object.get(name)?.as_u64()
}

/// Decodes a primitive of the extension [`DRACO`]. Returns `None` when it is not compressed.
///
/// # Errors
/// Returns a text when the data are damaged or missing.
pub(super) fn draco(
    document: &Document,
    buffers: &mut Buffers,
    primitive: &Primitive,
) -> Result<Option<Decoded>, String> {
    let Some(extension) = primitive.extensions.get(DRACO) else { return Ok(None) };
    if !matches!(primitive.mode.unwrap_or(4), 4 | 5) {
        return Err(format!(
            "{DRACO} with mode {}, which is not one of triangles",
            primitive.mode.unwrap_or(4)
        ));
    }
    let view = number(extension, "bufferView").and_then(|view| usize::try_from(view).ok());
    let view = view.and_then(|view| item(&document.buffer_views, view));
    let view = view.ok_or_else(|| format!("{DRACO} without a buffer view"))?;
    let length = usize::try_from(view.byte_length).map_err(|e| e.to_string())?;
    let bytes = buffers.read(document, view.buffer, view.byte_offset, length)?;
    let ids = extension.get("attributes").and_then(Value::as_object);
    let ids = ids.ok_or_else(|| format!("{DRACO} without attributes"))?;
    let wanted = primitive.attributes.iter().filter_map(|(name, accessor)| {
        let id = ids.get(name)?.as_u64()?;
        Some((u32::try_from(id).ok()?, *accessor))
    });
    decode(&bytes, wanted).map(Some).map_err(|what| format!("{DRACO}: {what}"))
}

#[cfg(not(feature = "draco"))]
fn decode(_: &[u8], _: impl Iterator<Item = (u32, usize)>) -> Result<Decoded, String> {
    Err("its geometry is compressed, and this build has no decoder; `gltf-transform copy` or Blender save the file \
         without compression"
        .into())
}

/// Decodes a Draco mesh. `wanted` holds the unique ids of attributes and the accessors that they replace.
#[cfg(feature = "draco")]
fn decode(bytes: &[u8], wanted: impl Iterator<Item = (u32, usize)>) -> Result<Decoded, String> {
    use draco_core::{DecoderBuffer, Mesh, MeshDecoder};
    let mut mesh = Mesh::new();
    MeshDecoder::new().decode(&mut DecoderBuffer::new(bytes), &mut mesh).map_err(|e| e.to_string())?;
    let count = mesh.num_points();
    let indices: Vec<u32> = mesh.faces().iter().flatten().map(|point| point.0).collect();
    let mut attributes = BTreeMap::new();
    for (id, accessor) in wanted {
        let attribute =
            mesh.attribute_by_unique_id(id).ok_or_else(|| format!("there is no attribute {id}"))?;
        let width = usize::from(attribute.num_components());
        attributes.insert(accessor, (attribute.read_f32s(count, width), width));
    }
    Ok(Decoded { indices, count: count as u64, attributes })
}

/// Returns the bytes of a buffer view that is compressed; `None` for another one.
///
/// # Errors
/// Returns a text when the data are damaged or missing.
#[cfg(feature = "meshopt")]
pub(super) fn meshopt(
    document: &Document,
    buffers: &mut Buffers,
    view: &BufferView,
) -> Result<Option<Vec<u8>>, String> {
    use meshoptimizer_rs::codec;
    use meshoptimizer_rs::{Limits, Workspace};
    let found = MESHOPT.into_iter().find_map(|name| Some((name, view.extensions.get(name)?)));
    let Some((name, extension)) = found else { return Ok(None) };
    let need = |key: &str| {
        let value = number(extension, key).and_then(|value| usize::try_from(value).ok());
        value.ok_or_else(|| format!("{name} without {key}"))
    };
    let (buffer, length) = (need("buffer")?, need("byteLength")?);
    let (count, stride) = (need("count")?, need("byteStride")?);
    let offset = number(extension, "byteOffset").unwrap_or(0);
    let word = |key: &str| extension.get(key).and_then(Value::as_str);
    let (mode, filter) = (word("mode").unwrap_or(""), word("filter").unwrap_or("NONE"));
    let size = count.checked_mul(stride).filter(|size| *size <= MOST_BYTES);
    let size = size.ok_or_else(|| {
        format!("{name}: {count} elements of {stride} bytes, of at most {MOST_BYTES} bytes")
    })?;
    if size as u64 != view.byte_length {
        return Err(format!("{name}: {size} bytes in a view of {}", view.byte_length));
    }
    let source = buffers.read(document, buffer, offset, length)?;
    // The codec needs a byte for each block of 16 bytes at least.
    if size / 4096 > source.len() {
        return Err(format!("{name}: {size} bytes from {}", source.len()));
    }
    let mut workspace = Workspace::new(Limits { max_bytes: 2 * MOST_BYTES, ..Limits::default() });
    let bytes = match mode {
        "ATTRIBUTES" => codec::decode_vertex_buffer(count, stride, &source, &mut workspace),
        "TRIANGLES" => codec::decode_index_buffer(count, stride, &source, &mut workspace),
        "INDICES" => codec::decode_index_sequence(count, stride, &source, &mut workspace),
        other => {
            return Err(format!(
                "{name}: the mode \"{}\" is not known",
                other.chars().take(40).collect::<String>()
            ));
        }
    };
    let mut bytes = bytes.map_err(|error| format!("{name}: {error}"))?;
    let filtered = match filter {
        "NONE" => Ok(()),
        "OCTAHEDRAL" => codec::decode_filter_oct(&mut bytes, count, stride, &mut workspace),
        "QUATERNION" => codec::decode_filter_quat(&mut bytes, count, stride, &mut workspace),
        "EXPONENTIAL" => codec::decode_filter_exp(&mut bytes, count, stride, &mut workspace),
        "COLOR" => codec::decode_filter_color(&mut bytes, count, stride, &mut workspace),
        other => {
            return Err(format!(
                "{name}: the filter \"{}\" is not known",
                other.chars().take(40).collect::<String>()
            ));
        }
    };
    filtered.map_err(|error| format!("{name}, filter {filter}: {error}"))?;
    Ok(Some(bytes))
}

#[cfg(not(feature = "meshopt"))]
pub(super) fn meshopt(_: &Document, _: &mut Buffers, view: &BufferView) -> Result<Option<Vec<u8>>, String> {
    match view.extensions.keys().find(|name| name.contains("meshopt_compression")) {
        None => Ok(None),
        Some(name) => Err(format!(
            "compressed with {name}, and this build has no decoder; `gltf-transform copy` or `gltfpack -noq` save the \
             file without compression"
        )),
    }
}
