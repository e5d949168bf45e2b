//! Reads numbers from accessors of all component types. They may be normalised, interleaved and sparse.

use super::buffers::Buffers;
use super::compressed::{self, Decoded};
use super::document::{Accessor, Document, Primitive, item};
use std::collections::BTreeMap;
use std::ops::Range;

/// The largest number of zeros of an accessor without data. Real files have fewer of them.
const MOST_ZEROS: u64 = 1 << 20;
/// The size of the pieces in which data are read, in bytes.
const PIECE: u64 = 1 << 20;
/// The number of bytes of decompressed views above which those of earlier primitives are dropped.
const MOST_DECODED: usize = 64 << 20;

/// A component type. The file stores its number in OpenGL.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    fn of(code: u32) -> Result<Self, String> {
        Ok(match code {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            _ => return Err(format!("unknown component type {code}")),
        })
    }

    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }

    /// Returns the value at the beginning of `b`, normalised as the format requires.
    #[inline]
    fn value(self, b: &[u8], normalized: bool) -> f32 {
        let value = match self {
            Self::I8 => f32::from(b[0] as i8),
            Self::U8 => f32::from(b[0]),
            Self::I16 => f32::from(i16::from_le_bytes([b[0], b[1]])),
            Self::U16 => f32::from(u16::from_le_bytes([b[0], b[1]])),
            Self::U32 => u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as f32,
            Self::F32 => f32::from_le_bytes([b[0], b[1], b[2], b[3]]),
        };
        self.scaled(value, normalized)
    }

    /// Returns a value that is stored as a number, normalised as the format requires.
    fn scaled(self, value: f32, normalized: bool) -> f32 {
        let one = match self {
            Self::I8 => 127.0,
            Self::U8 => 255.0,
            Self::I16 => 32767.0,
            Self::U16 => 65535.0,
            Self::U32 => 4_294_967_295.0,
            Self::F32 => return value,
        };
        if normalized { (value / one).max(-1.0) } else { value }
    }

    #[inline]
    fn index(self, b: &[u8]) -> u32 {
        match self {
            Self::U8 => u32::from(b[0]),
            Self::U16 => u32::from(u16::from_le_bytes([b[0], b[1]])),
            _ => u32::from_le_bytes([b[0], b[1], b[2], b[3]]),
        }
    }
}

/// Returns the number of numbers per element of an accessor's type.
fn width(kind: &str) -> Result<usize, String> {
    Ok(match kind {
        "SCALAR" => 1,
        "VEC2" => 2,
        "VEC3" => 3,
        "VEC4" => 4,
        "MAT4" => 16,
        _ => {
            return Err(format!(
                "type \"{}\" where numbers or vectors belong",
                &kind[..kind.floor_char_boundary(20)]
            ));
        }
    })
}

/// Data that is read from an accessor.
enum Data<'a> {
    /// The expected number of elements.
    Room(usize),
    /// All elements are zero.
    Zeros(usize),
    /// The bytes of one element.
    Element(&'a [u8]),
}

/// Reads the elements of accessors.
pub(super) struct Reader<'a> {
    document: &'a Document,
    buffers: Buffers,
    /// The views that were compressed; `None` for other views.
    views: BTreeMap<usize, Option<Vec<u8>>>,
    /// The data of the current primitive, when it was compressed as a whole.
    decoded: Option<Decoded>,
}

impl<'a> Reader<'a> {
    pub(super) fn new(document: &'a Document, buffers: Buffers) -> Self {
        Self { document, buffers, views: BTreeMap::new(), decoded: None }
    }

    /// Begins a primitive. When it is compressed as a whole, its accessors have the decoded values from now on.
    ///
    /// # Errors
    /// Returns a text when its data are damaged, missing, or of an unknown kind.
    pub(super) fn begin(&mut self, primitive: &Primitive) -> Result<(), String> {
        self.decoded = None;
        if self.views.values().flatten().map(Vec::len).sum::<usize>() > MOST_DECODED {
            self.views.clear();
        }
        // Files may also contain the uncompressed data.
        let position = primitive.attributes.get("POSITION").and_then(|p| item(&self.document.accessors, *p));
        if position.is_some_and(|accessor| accessor.buffer_view.is_some()) {
            return Ok(());
        }
        self.decoded = compressed::draco(self.document, &mut self.buffers, primitive)?;
        let other = primitive.extensions.keys().find(|name| name.contains("compression"));
        match other.filter(|_| self.decoded.is_none()) {
            Some(name) => Err(format!(
                "its geometry is compressed with {name}, which is not supported; save the file without compression"
            )),
            None => Ok(()),
        }
    }

    /// Returns the indices of the current primitive when it was compressed as a whole.
    pub(super) fn decoded_indices(&mut self) -> Option<Vec<u32>> {
        self.decoded.as_mut().map(|decoded| std::mem::take(&mut decoded.indices))
    }

    fn accessor(&self, index: usize) -> Result<&'a Accessor, String> {
        item(&self.document.accessors, index).ok_or_else(|| format!("there is no accessor {index}"))
    }

    /// Returns the number of elements of accessor `index`.
    pub(super) fn count(&self, index: usize) -> Result<u64, String> {
        if let Some(decoded) = self.decoded.as_ref().filter(|d| d.attributes.contains_key(&index)) {
            return Ok(decoded.count);
        }
        self.accessor(index).map(|a| a.count)
    }

    /// Returns the numbers of elements `range` of accessor `index`, and the number of numbers per element. It must be
    /// one of `widths`.
    ///
    /// # Errors
    /// Returns a text with the index of the accessor.
    pub(super) fn floats(
        &mut self,
        index: usize,
        widths: &[usize],
        range: Range<u64>,
    ) -> Result<(Vec<f32>, usize), String> {
        let accessor = self.accessor(index)?;
        let n = width(&accessor.kind).map_err(|e| format!("accessor {index}: {e}"))?;
        if !widths.contains(&n) {
            return Err(format!(
                "accessor {index} is of type \"{}\", which does not fit its use",
                accessor.kind
            ));
        }
        let component =
            Component::of(accessor.component_type).map_err(|e| format!("accessor {index}: {e}"))?;
        let decoded = self.decoded.as_ref().and_then(|d| d.attributes.get(&index));
        if let Some((values, width)) = decoded {
            let all = range.start.checked_mul(n as u64).zip(range.end.checked_mul(n as u64));
            let own = all.and_then(|(a, b)| values.get(usize::try_from(a).ok()?..usize::try_from(b).ok()?));
            let own = own.filter(|_| *width == n);
            let own = own.ok_or_else(|| format!("accessor {index} has {n} values, and its data {width}"))?;
            let scaled = own.iter().map(|x| component.scaled(*x, accessor.normalized));
            return Ok((scaled.collect(), n));
        }
        let mut out: Vec<f32> = Vec::new();
        let take = |data: Data<'_>| match data {
            Data::Room(count) => out.reserve(count * n),
            Data::Zeros(count) => out.resize(count * n, 0.0),
            Data::Element(bytes) => {
                let parts = bytes.chunks_exact(component.size());
                out.extend(parts.map(|b| component.value(b, accessor.normalized)));
            }
        };
        self.elements(accessor, component.size() * n, range.clone(), take)
            .map_err(|e| format!("accessor {index}: {e}"))?;
        if let Some(sparse) = &accessor.sparse {
            let begin = range.start;
            let replace = |at: u64, element: &[u8]| {
                let at = (at - begin) as usize * n;
                for (to, b) in out[at..at + n].iter_mut().zip(element.chunks_exact(component.size())) {
                    *to = component.value(b, accessor.normalized);
                }
            };
            self.sparse(sparse, accessor.count, range, component.size() * n, replace)
                .map_err(|e| format!("accessor {index}: {e}"))?;
        }
        Ok((out, n))
    }

    /// Returns the indices in accessor `index`.
    ///
    /// # Errors
    /// Returns a text with the index of the accessor.
    pub(super) fn indices(&mut self, index: usize) -> Result<Vec<u32>, String> {
        let accessor = self.accessor(index)?;
        let component =
            Component::of(accessor.component_type).map_err(|e| format!("accessor {index}: {e}"))?;
        if accessor.kind != "SCALAR" || !matches!(component, Component::U8 | Component::U16 | Component::U32)
        {
            return Err(format!("accessor {index} holds no indices"));
        }
        let mut out: Vec<u32> = Vec::new();
        let take = |data: Data<'_>| match data {
            Data::Room(count) => out.reserve(count),
            Data::Zeros(count) => out.resize(count, 0),
            Data::Element(bytes) => out.push(component.index(bytes)),
        };
        self.elements(accessor, component.size(), 0..accessor.count, take)
            .map_err(|e| format!("accessor {index}: {e}"))?;
        if let Some(sparse) = &accessor.sparse {
            let replace = |at: u64, element: &[u8]| out[at as usize] = component.index(element);
            self.sparse(sparse, accessor.count, 0..accessor.count, component.size(), replace)
                .map_err(|e| format!("accessor {index}: {e}"))?;
        }
        Ok(out)
    }

    /// Passes elements `range`, of `size` bytes each, to `take`.
    fn elements(
        &mut self,
        accessor: &Accessor,
        size: usize,
        range: Range<u64>,
        mut take: impl FnMut(Data<'_>),
    ) -> Result<(), String> {
        if range.end > accessor.count || range.start > range.end {
            return Err(format!("element {} of {}", range.end.saturating_sub(1), accessor.count));
        }
        let Some(view) = accessor.buffer_view else {
            let count = range.end - range.start;
            if count > MOST_ZEROS {
                return Err(format!("{count} elements without data; at most {MOST_ZEROS} are read"));
            }
            take(Data::Zeros(count as usize));
            return Ok(());
        };
        let Some(view_desc) = item(&self.document.buffer_views, view) else {
            return Err(format!("there is no buffer view {view}"));
        };
        let stride = view_desc.byte_stride.unwrap_or(size as u64);
        if stride < size as u64 {
            return Err(format!("elements of {size} bytes in steps of {stride}"));
        }
        if accessor.count == 0 || range.is_empty() {
            return Ok(());
        }
        let last = stride.checked_mul(accessor.count - 1);
        let end = last.and_then(|l| l.checked_add(accessor.byte_offset)?.checked_add(size as u64));
        let end = end.ok_or("sizes beyond all memory")?;
        self.check_view(view, end)?;
        // The first piece of data is read before memory for all elements is reserved.
        let per_piece = (PIECE / stride).max(1);
        let mut at = range.start;
        while at < range.end {
            let count = per_piece.min(range.end - at);
            let length = stride * (count - 1) + size as u64;
            let offset = accessor.byte_offset + stride * at;
            let bytes = self.view_bytes(view, offset, length as usize)?;
            if at == range.start {
                take(Data::Room((range.end - range.start) as usize));
            }
            for i in 0..count as usize {
                let from = i * stride as usize;
                take(Data::Element(&bytes[from..from + size]));
            }
            at += count;
        }
        Ok(())
    }

    /// Returns an error unless the first `end` bytes lie in a view, and the view in its buffer.
    fn check_view(&mut self, view: usize, end: u64) -> Result<(), String> {
        let Some(desc) = item(&self.document.buffer_views, view) else {
            return Err(format!("there is no buffer view {view}"));
        };
        if end > desc.byte_length {
            return Err(format!(
                "buffer view {view} has {} bytes of the {end} that are needed",
                desc.byte_length
            ));
        }
        if let Some(bytes) = self.decompressed(view)? {
            let all = bytes.len() as u64;
            return if end <= all {
                Ok(())
            } else {
                Err(format!("buffer view {view} has {all} bytes of {end}"))
            };
        }
        // Reading one byte at the end shows whether the buffer is complete.
        let last = desc.byte_offset.checked_add(end).and_then(|e| e.checked_sub(1));
        let last = last.ok_or("sizes beyond all memory")?;
        self.buffers.read(self.document, desc.buffer, last, 1).map(drop)
    }

    /// Returns the bytes of a view that is compressed; `None` for another one.
    fn decompressed(&mut self, view: usize) -> Result<Option<&[u8]>, String> {
        if !self.views.contains_key(&view) {
            let bytes = match item(&self.document.buffer_views, view) {
                Some(desc) => compressed::meshopt(self.document, &mut self.buffers, desc)
                    .map_err(|what| format!("buffer view {view}: {what}"))?,
                None => None,
            };
            self.views.insert(view, bytes);
        }
        Ok(self.views.get(&view).and_then(Option::as_deref))
    }

    fn view_bytes(&mut self, view: usize, offset: u64, length: usize) -> Result<Vec<u8>, String> {
        if let Some(bytes) = self.decompressed(view)? {
            let from = usize::try_from(offset).ok();
            let range = from.and_then(|from| bytes.get(from..from.checked_add(length)?));
            return range
                .map(<[u8]>::to_vec)
                .ok_or_else(|| format!("buffer view {view} ends before {offset}"));
        }
        let Some(desc) = item(&self.document.buffer_views, view) else {
            return Err(format!("there is no buffer view {view}"));
        };
        let at = desc.byte_offset.checked_add(offset).ok_or("sizes beyond all memory")?;
        self.buffers.read(self.document, desc.buffer, at, length)
    }

    /// Passes the sparse elements inside of `range`, which replace others, to `replace`.
    fn sparse(
        &mut self,
        sparse: &super::document::Sparse,
        count: u64,
        range: Range<u64>,
        size: usize,
        mut replace: impl FnMut(u64, &[u8]),
    ) -> Result<(), String> {
        let component = Component::of(sparse.indices.component_type)?;
        if !matches!(component, Component::U8 | Component::U16 | Component::U32) {
            return Err("sparse indices that are none".into());
        }
        if sparse.count > count {
            return Err(format!("{} sparse elements of {count}", sparse.count));
        }
        if sparse.count == 0 {
            return Ok(());
        }
        let length = |size: usize, offset: u64| {
            let bytes = sparse.count.checked_mul(size as u64)?;
            Some((bytes, bytes.checked_add(offset)?))
        };
        let (index_bytes, index_end) =
            length(component.size(), sparse.indices.byte_offset).ok_or("sizes beyond all memory")?;
        let (value_bytes, value_end) =
            length(size, sparse.values.byte_offset).ok_or("sizes beyond all memory")?;
        self.check_view(sparse.indices.buffer_view, index_end)?;
        self.check_view(sparse.values.buffer_view, value_end)?;
        let indices =
            self.view_bytes(sparse.indices.buffer_view, sparse.indices.byte_offset, index_bytes as usize)?;
        let values =
            self.view_bytes(sparse.values.buffer_view, sparse.values.byte_offset, value_bytes as usize)?;
        for (index, value) in indices.chunks_exact(component.size()).zip(values.chunks_exact(size)) {
            let index = u64::from(component.index(index));
            if index >= count {
                return Err(format!("sparse index {index} of {count}"));
            }
            if range.contains(&index) {
                replace(index, value);
            }
        }
        Ok(())
    }
}
