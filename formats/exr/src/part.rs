//! The parts of a file, as their headers describe them.

use crate::attributes::{self, channel_order};
use crate::deep::DeepChannels;
use crate::{CompressionName, Order};
use exr::compression::Compression;
use exr::meta::attribute::{EnvironmentMap, LevelMode, SampleType};
use exr::meta::header::Header;
use exr::meta::{BlockDescription, MetaData, compute_level_count, compute_level_size};
use exr::prelude::Vec2;
use granita_base::{BaseType, Param, ParamType};
use granita_image::{FileSource, ImageSpec, Limits, PixelType, Result, contained};
use std::io::Read;
use std::sync::OnceLock;

/// A part of the file that can be read.
#[derive(Debug)]
pub(crate) struct Part {
    /// The index of the header.
    pub(crate) header: usize,
    pub(crate) levels: Vec<Level>,
    pub(crate) order: Order,
    /// The channels of a deep part, which is flattened.
    pub(crate) deep: Option<DeepChannels>,
    /// The number of rows of one block of scanlines.
    pub(crate) block_rows: u32,
    table_at: u64,
    chunks: u64,
    table: OnceLock<Vec<u64>>,
}

#[derive(Debug)]
pub(crate) struct Level {
    pub(crate) spec: ImageSpec,
    /// The index of this level in both directions.
    pub(crate) index: usize,
    /// The index of its first chunk in the table of the part.
    pub(crate) first_chunk: usize,
}

/// Reads a file from its beginning and counts the bytes read.
struct Front<'a> {
    source: &'a FileSource,
    position: u64,
    buffer: Vec<u8>,
    /// The number of bytes of `buffer` that were consumed.
    used: usize,
    /// The error that ended reading, which the crate does not pass on.
    fault: Option<granita_image::ImageError>,
}

impl Read for Front<'_> {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        if self.used == self.buffer.len() {
            let n = 4096.min(self.source.len() - self.position);
            self.buffer.resize(n as usize, 0);
            self.used = 0;
            if let Err(fault) = self.source.read_at(self.position, &mut self.buffer, "the header") {
                self.buffer.clear();
                self.fault = Some(fault);
            }
            self.position += self.buffer.len() as u64;
        }
        let n = out.len().min(self.buffer.len() - self.used);
        out[..n].copy_from_slice(&self.buffer[self.used..self.used + n]);
        self.used += n;
        Ok(n)
    }
}

impl Front<'_> {
    /// Returns the number of bytes that were consumed so far.
    fn consumed(&self) -> u64 {
        self.position - (self.buffer.len() - self.used) as u64
    }
}

/// Returns the headers, and the offset of the tables of chunks.
pub(crate) fn read_headers(source: &FileSource) -> Result<(MetaData, u64)> {
    let mut front = Front { source, position: 0, buffer: Vec::new(), used: 0, fault: None };
    let read = contained(|| MetaData::read_from_buffered(&mut front, false))
        .map_err(|fault| source.malformed(format!("the header: {fault}")))?;
    if let Some(fault) = front.fault.take() {
        return Err(fault);
    }
    let meta = read.map_err(|e| exr_fault(source, e, "the header"))?;
    let end = front.consumed();
    // The crate does not read deep pixels. Their headers are otherwise like those of flat ones.
    let flat: Vec<Header> = meta.headers.iter().map(|h| Header { deep: false, ..h.clone() }).collect();
    contained(|| MetaData::validate(&flat, false))
        .map_err(|fault| source.malformed(format!("the header: {fault}")))?
        .map_err(|e| exr_fault(source, e, "the header"))?;
    Ok((meta, end))
}

/// Converts an error of the crate `exr`.
pub(crate) fn exr_fault(
    source: &FileSource,
    error: exr::error::Error,
    at: &str,
) -> granita_image::ImageError {
    match error {
        exr::error::Error::NotSupported(what) => {
            source.unsupported(format!("OpenEXR: {what} is not supported"))
        }
        exr::error::Error::Invalid(what) => source.malformed(format!("{at}: {what}")),
        exr::error::Error::Aborted => source.malformed(format!("{at}: cancelled")),
        exr::error::Error::Io(e) => {
            granita_image::ImageError::Io { path: source.path().to_owned(), source: e }
        }
    }
}

impl Part {
    /// Returns the part of a header.
    ///
    /// # Errors
    /// Returns an error for a damaged header, and for pixels of an unsupported kind.
    pub(crate) fn understand(
        source: &FileSource,
        index: usize,
        header: &Header,
        limits: &Limits,
        table_at: u64,
    ) -> Result<Self> {
        let is_packed_deep = matches!(
            header.compression,
            Compression::Uncompressed | Compression::RLE | Compression::ZIP1 | Compression::ZIP16
        );
        if header.deep && !(is_packed_deep && header.deep_data_version == Some(1)) {
            let name = CompressionName::of(header.compression);
            let version = header.deep_data_version.unwrap_or(0);
            return Err(source.unsupported(format!(
                "OpenEXR with deep pixels of version {version} and compression {name} is not supported"
            )));
        }
        if matches!(header.compression, Compression::HTJ2K32 | Compression::HTJ2K256) {
            let name = CompressionName::of(header.compression);
            return Err(source.unsupported(format!("OpenEXR compression {name} is not supported")));
        }
        let list = &header.channels.list;
        // The number is checked before any work for each pair of channels.
        limits.within(source.path(), "number of channels", list.len() as u64, u64::from(limits.channels))?;
        if let Some(c) = list.iter().find(|c| c.sampling != Vec2(1, 1)) {
            let name = attributes::string(&c.name);
            return Err(
                source.unsupported(format!("OpenEXR with subsampled channel \"{name}\" is not supported"))
            );
        }
        let names: Vec<String> = list.iter().map(|c| attributes::string(&c.name)).collect();
        let types: Vec<SampleType> = list.iter().map(|c| c.sample_type).collect();
        let deep = header.deep.then(|| DeepChannels::new(header, &names));
        let is_shown = |channel: &usize| deep.as_ref().is_none_or(|deep| deep.is_shown(*channel));
        let mut shown_types = (0..types.len()).filter(is_shown).map(|channel| types[channel]);
        let first_type = shown_types.next();
        let pixel_type = match first_type.filter(|first| shown_types.all(|ty| ty == *first)) {
            Some(SampleType::U32) => PixelType::U32,
            Some(SampleType::F16) => PixelType::Half,
            // For different types, floats hold the most values.
            Some(SampleType::F32) | None => PixelType::Float,
        };
        let own = &header.own_attributes;
        let wanted = own.other.get(attributes::CHANNEL_ORDER.as_bytes()).and_then(|v| match v {
            exr::meta::attribute::AttributeValue::Text(t) => Some(attributes::string(t)),
            _ => None,
        });
        let mut order = channel_order(&names, wanted.as_deref());
        order.retain(is_shown);
        if order.is_empty() {
            return Err(source.malformed("deep pixels without a channel but \"ZBack\""));
        }

        let side = |n: usize| u32::try_from(n).map_err(|_| source.malformed(format!("a side of {n} pixels")));
        let mut spec = ImageSpec::new(side(header.layer_size.0)?, side(header.layer_size.1)?, 1, pixel_type);
        spec.channels = order.iter().map(|i| names[*i].clone()).collect();
        (spec.x, spec.y) = (own.layer_position.0, own.layer_position.1);
        let display = header.shared_attributes.display_window;
        (spec.full_x, spec.full_y) = (display.position.0, display.position.1);
        (spec.full_width, spec.full_height) = (side(display.size.0)?, side(display.size.1)?);
        spec.attributes = attributes::from_header(own);
        attributes::chromaticities(&header.shared_attributes)
            .into_iter()
            .for_each(|p| spec.attributes.set(p));
        attributes::profile(own).into_iter().for_each(|profile| spec.set_icc_profile(profile));
        let compression = CompressionName::of(header.compression).to_string();
        let ty = ParamType::of(BaseType::String);
        spec.attributes.set(Param { name: "compression".into(), ty, data: compression.as_str().into() });
        if deep.is_some() {
            spec.attributes.set(Param { name: "deep".into(), ty, data: "flattened".into() });
        }
        let block_rows = header.compression.scan_lines_per_block() as u32;
        let levels = match header.blocks {
            BlockDescription::ScanLines => {
                limits.check_read(source.path(), &spec, spec.width, block_rows.min(spec.height.max(1)))?;
                vec![Level { spec, index: 0, first_chunk: 0 }]
            }
            BlockDescription::Tiles(tiles) => {
                (spec.tile_width, spec.tile_height) = (side(tiles.tile_size.0)?, side(tiles.tile_size.1)?);
                tile_levels(source, &spec, tiles.level_mode, tiles.rounding_mode)?
            }
        };
        let levels = levels
            .into_iter()
            .map(|mut level| {
                if own.environment_map == Some(EnvironmentMap::Cube) {
                    // There are six faces, one above the other (reference 9.2.8).
                    level.spec.full_width = level.spec.width;
                    level.spec.full_height = level.spec.height.div_ceil(6);
                }
                limits.check(source.path(), "OpenEXR", &level.spec)?;
                Ok(level)
            })
            .collect::<Result<_>>()?;
        let chunks = header.chunk_count as u64;
        let order = Order { types, order, pixel_type };
        Ok(Self { header: index, levels, order, deep, block_rows, table_at, chunks, table: OnceLock::new() })
    }

    /// Returns the offsets of the chunks, which are read from the file at the first use.
    pub(crate) fn table(&self, source: &FileSource) -> Result<&[u64]> {
        if let Some(table) = self.table.get() {
            return Ok(table);
        }
        let bytes = source.read_vec(self.table_at, self.chunks * 8, "the table of chunks")?;
        let table = bytes.as_chunks::<8>().0.iter().map(|b| u64::from_le_bytes(*b)).collect();
        Ok(self.table.get_or_init(|| table))
    }
}

/// Returns the levels of a tiled part. These are all levels of a MIP map. For a map that is reduced in each direction
/// separately (a "RIP map"), they are the levels reduced equally in both.
fn tile_levels(
    source: &FileSource,
    first: &ImageSpec,
    mode: LevelMode,
    round: exr::math::RoundingMode,
) -> Result<Vec<Level>> {
    if first.width == 0 || first.height == 0 || first.tile_width == 0 || first.tile_height == 0 {
        return Err(source.malformed("an empty window or tile"));
    }
    let (w, h) = (first.width as usize, first.height as usize);
    let size = |n: usize, level: usize| compute_level_size(round, n, level) as u32;
    let tiles = |x: usize, y: usize| {
        size(w, x).div_ceil(first.tile_width) as usize * size(h, y).div_ceil(first.tile_height) as usize
    };
    let (count_x, count_y) = (compute_level_count(round, w), compute_level_count(round, h));
    let count = match mode {
        LevelMode::Singular => 1,
        LevelMode::MipMap => count_x.max(count_y),
        LevelMode::RipMap => count_x.min(count_y),
    };
    let mut levels = Vec::with_capacity(count);
    let mut first_chunk = 0;
    for index in 0..count {
        let mut spec = first.clone();
        (spec.width, spec.height) = (size(w, index), size(h, index));
        let whole = first.full_width == first.width && first.full_height == first.height;
        (spec.full_width, spec.full_height) = if whole {
            (spec.width, spec.height)
        } else {
            (size(first.full_width as usize, index), size(first.full_height as usize, index))
        };
        let number = match mode {
            // Levels of a RIP map are in rows of equal height.
            LevelMode::RipMap => {
                let above: usize = (0..index).map(|y| (0..count_x).map(|x| tiles(x, y)).sum::<usize>()).sum();
                above + (0..index).map(|x| tiles(x, index)).sum::<usize>()
            }
            _ => first_chunk,
        };
        first_chunk += tiles(index, index);
        levels.push(Level { spec, index, first_chunk: number });
    }
    Ok(levels)
}
