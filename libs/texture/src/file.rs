//! One texture file: its attributes, and access to its texels.

use crate::block::Block;
use crate::cube::{CubeLayout, cube_level, is_openexr};
use crate::image::{Image, half, level_count};
use crate::level::{Level, plain_level};
use crate::made::MadeShadow;
use crate::pyramid::Levels;
use crate::squares::Squares;
use crate::tile_cache::Cell;
use crate::tiles::{Layout, Tile, from_raw};
use crate::{TextureKind, Up, Wrap};
use granita_base::{Filter, Transform, Vec3};
use granita_image::{ImageInput, Limits, PixelType, Pixels};
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

/// The source of the texels.
pub(crate) enum Source {
    /// The tiles of the file, read one by one.
    Tiles,
    /// The levels are in memory. They are made from the whole file when they are first used, with one block per level.
    Memory(Lack, OnceLock<Vec<Arc<Cell>>>),
    /// The tiles are made on demand, without a file.
    Made,
}

impl std::fmt::Debug for Source {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Tiles => "Tiles",
            Self::Memory(..) => "Memory",
            Self::Made => "Made",
        })
    }
}

/// One texture file.
#[derive(Debug)]
pub(crate) struct TextureFile {
    pub(crate) index: u32,
    pub(crate) path: PathBuf,
    pub(crate) kind: TextureKind,
    /// True when it does not declare its kind and has several images of one size. These are slices when it is
    /// looked up in three dimensions.
    is_stack: bool,
    /// The levels, at least one.
    pub(crate) levels: Vec<Level>,
    pub(crate) channels: usize,
    pub(crate) swrap: Wrap,
    pub(crate) twrap: Wrap,
    /// The orientation of a latitude-longitude map.
    pub(crate) up: Up,
    pub(crate) layout: CubeLayout,
    pub(crate) world_to_camera: Option<Transform>,
    pub(crate) world_to_screen: Option<Transform>,
    pub(crate) source: Source,
    /// The bytes of one texel.
    pub(crate) texel_bytes: u64,
    /// The pixel type of all its tiles.
    pub(crate) pixel_type: PixelType,
    /// Its images as slices of one block, when that was requested.
    pub(crate) slices: OnceLock<Vec<Block>>,
    /// The textures of the set whose first one this file is, when a name of a set was requested.
    pub(crate) set: Option<Squares>,
    /// True when its levels could not be made. All of it is then black and needs no filtering.
    pub(crate) broken: AtomicBool,
}

/// The reason why a file cannot be used directly.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Lack {
    Tiles,
    Levels,
}

impl Lack {
    /// Returns the description for a message about the file.
    pub(crate) fn words(self) -> &'static str {
        match self {
            Self::Tiles => "is not tiled",
            Self::Levels => "has no MIP levels",
        }
    }
}

impl TextureFile {
    /// Reads the attributes of the file, and finds what it lacks for direct use. Its source is then memory.
    pub(crate) fn open(
        index: u32,
        path: PathBuf,
        input: &dyn ImageInput,
    ) -> Result<(Self, Option<Lack>), String> {
        let Some(spec) = input.spec(0, 0).filter(|s| s.width > 0 && s.height > 0 && s.nchannels() > 0) else {
            return Err("it has no pixels".to_owned());
        };
        let mut kind = TextureKind::of(spec);
        let openexr = is_openexr(input.format_name());
        let layout = if openexr { CubeLayout::Column } else { CubeLayout::Mosaic };
        let mut levels = Vec::new();
        for level in 0..input.levels(0) {
            let Some(s) = input.spec(0, level) else { break };
            // The pyramid ends before the first image that is not a smaller level of the first image.
            let follows = levels.last().is_none_or(|l: &Level| s.width <= l.width && s.height <= l.height);
            let same = s.nchannels() == spec.nchannels() && s.is_tiled() == spec.is_tiled();
            if !follows || !same || s.width == 0 || s.height == 0 {
                break;
            }
            if kind.is_cube() {
                match cube_level(layout, s, (s.width, s.height)) {
                    Some(level) => levels.push(level),
                    None if levels.is_empty() => {
                        return Err(format!(
                            "an image of {} x {} pixels cannot hold six square faces",
                            s.width, s.height
                        ));
                    }
                    None => break,
                }
            } else {
                levels.push(plain_level(s.width, s.height, (s.tile_width, s.tile_height)));
            }
        }
        let complete =
            !kind.is_mipmapped() || levels.len() > 1 || levels[0].face_width.max(levels[0].face_height) == 1;
        let same_size = |other: &granita_image::ImageSpec| {
            (other.width, other.height, other.nchannels()) == (spec.width, spec.height, spec.nchannels())
        };
        let is_stack = kind == TextureKind::Plain && input.spec(1, 0).is_some_and(same_size);
        let lack = match (spec.is_tiled(), complete) {
            (true, true) => None,
            (true, false) => Some(Lack::Levels),
            (false, _) => Some(Lack::Tiles),
        };
        if spec.nchannels() < 4 {
            kind = match kind {
                TextureKind::VolumeShadow => TextureKind::Shadow,
                TextureKind::CubeFaceVolumeShadow => TextureKind::CubeFaceShadow,
                other => other,
            };
        }
        if lack.is_some() {
            levels = Self::memory_levels(kind, levels[0]);
        }
        if !kind.is_mipmapped() {
            levels.truncate(1);
        }
        let matrix = |name| spec.matrix(name).map(|m| Transform::from_rows(&m)).filter(|m| m.is_finite());
        let wraps = spec.string("wrapmodes").and_then(Wrap::parse_pair).unwrap_or_default();
        let file = Self {
            index,
            kind,
            is_stack,
            levels,
            channels: spec.nchannels(),
            swrap: wraps.0,
            twrap: wraps.1,
            up: Up::of(spec, openexr),
            layout,
            world_to_camera: matrix("worldtocamera"),
            world_to_screen: matrix("worldtoscreen"),
            texel_bytes: (spec.nchannels() * spec.pixel_type.bytes()) as u64,
            pixel_type: spec.pixel_type,
            slices: OnceLock::new(),
            set: None,
            broken: AtomicBool::new(false),
            path,
            source: match lack {
                Some(lack) => Source::Memory(lack, OnceLock::new()),
                None => Source::Tiles,
            },
        };
        Ok((file, lack))
    }

    /// Converts the matrices of the file from world space to "common" space, which begins at `origin`.
    pub(crate) fn nearby(mut self, origin: Vec3) -> Self {
        if origin != Vec3::ZERO {
            let to_world = Transform::translate(origin);
            for matrix in [&mut self.world_to_camera, &mut self.world_to_screen].into_iter().flatten() {
                *matrix = to_world.then_rounded_once(matrix);
            }
        }
        self
    }

    /// Returns the kind that is reported to shaders. A file whose images are slices of one size is a volume.
    pub(crate) fn told_kind(&self) -> TextureKind {
        if self.is_stack { TextureKind::Volume } else { self.kind }
    }

    /// Returns a depth map whose tiles are made on demand.
    pub(crate) fn made(index: u32, name: &str, map: &MadeShadow) -> Self {
        let [width, height] = map.resolution.map(|n| n.max(1));
        Self {
            index,
            path: name.into(),
            kind: TextureKind::Shadow,
            is_stack: false,
            levels: vec![plain_level(width, height, (map.tile.max(1), map.tile.max(1)))],
            channels: 1,
            swrap: Wrap::default(),
            twrap: Wrap::default(),
            up: Up::Z,
            layout: CubeLayout::Mosaic,
            world_to_camera: Some(map.world_to_camera),
            world_to_screen: Some(map.world_to_screen),
            texel_bytes: 4,
            pixel_type: PixelType::Float,
            slices: OnceLock::new(),
            set: None,
            broken: AtomicBool::new(false),
            source: Source::Made,
        }
    }

    /// Returns the levels that [`TextureFile::make_levels`] will make.
    fn memory_levels(kind: TextureKind, first: Level) -> Vec<Level> {
        let whole = |l: Level| Level { tile_width: l.width, tile_height: l.height, ..l };
        let mut levels = vec![whole(first)];
        if !kind.is_mipmapped() || kind.is_volume_shadow() {
            return levels;
        }
        let (columns, rows) =
            if kind.is_cube() { (first.width / first.step_x, first.height / first.step_y) } else { (1, 1) };
        let (mut w, mut h) = (first.face_width, first.face_height);
        for _ in 1..level_count(w as usize, h as usize) {
            (w, h) = (half(w as usize) as u32, half(h as usize) as u32);
            let (width, height) = (w * columns, h * rows);
            levels.push(Level {
                face_width: w,
                face_height: h,
                step_x: w,
                step_y: h,
                ..plain_level(width, height, (width, height))
            });
        }
        levels
    }

    /// Makes all levels of a file that lacks tiles or levels.
    pub(crate) fn make_levels(&self, input: &dyn ImageInput) -> granita_image::Result<Vec<Arc<Cell>>> {
        let pixel_type = self.pixel_type;
        let n = self.channels;
        let tile = |pixels: Pixels, width: u32| {
            Arc::new(Cell::of(Tile::new(pixels, width as usize, n, self.layout_in_memory())))
        };
        Limits::check_memory(&self.path, self.bytes_to_make(input))?;
        if self.levels.len() == 1 {
            return Ok(vec![tile(input.read_level(0, 0)?, self.levels[0].width)]);
        }
        if !self.kind.is_cube() {
            let made = self.levels_of_rows(input)?;
            return Ok(made.into_iter().zip(&self.levels).map(|(p, level)| tile(p, level.width)).collect());
        }
        let (first, _) = Image::read(input, 0)?;
        let level = |p: &Image| tile(Pixels::from_floats(pixel_type, &p.data), p.width as u32);
        let faces: Vec<Vec<Image>> = (0..6)
            .map(|face| {
                let (x, y) = self.face_origin(&self.levels[0], face);
                let l = &self.levels[0];
                let (x, y, w, h) = (x as usize, y as usize, l.face_width as usize, l.face_height as usize);
                first.cropped(x, y, w, h).pyramid(Filter::Box, (Wrap::Clamp, Wrap::Clamp))
            })
            .collect();
        let mut out = vec![level(&first)];
        for (i, l) in self.levels.iter().enumerate().skip(1) {
            let mut whole = Image::new(l.width as usize, l.height as usize, n);
            for (face, pyramid) in faces.iter().enumerate() {
                let (x, y) = self.face_origin(l, face);
                whole.paste(&pyramid[i], x as usize, y as usize);
            }
            out.push(level(&whole));
        }
        Ok(out)
    }

    /// Returns the bytes of memory that [`TextureFile::make_levels`] takes. They are the levels as stored, the largest
    /// once more, the memory of reading, and for cubes also the levels in floats and once more by faces.
    fn bytes_to_make(&self, input: &dyn ImageInput) -> u64 {
        let texels = |l: &Level| u64::from(l.width) * u64::from(l.height);
        let largest = texels(&self.levels[0]);
        let all: u64 = self.levels.iter().map(texels).sum();
        let stored = (all + largest).saturating_mul(self.texel_bytes);
        let floats =
            if self.kind.is_cube() { (all + largest).saturating_mul(4 * self.channels as u64) } else { 0 };
        stored.saturating_add(floats).saturating_add(input.working_bytes(0, 0))
    }

    /// Makes all levels of an image that is not a cube, as stored. Only some rows at a time are in floats.
    fn levels_of_rows(&self, input: &dyn ImageInput) -> granita_image::Result<Vec<Pixels>> {
        /// The number of rows that are read at once.
        const ROWS: usize = 256;
        let first = self.levels[0];
        let values = |l: &Level| l.width as usize * l.height as usize * self.channels;
        let mut levels: Vec<(Pixels, usize)> =
            self.levels.iter().map(|l| (Pixels::zeros(self.pixel_type, values(l)), 0)).collect();
        let size = (first.width as usize, first.height as usize);
        let mut smaller = Levels::new(self.kind, size, self.channels, (self.swrap, self.twrap));
        let mut put = |level: usize, rows: &[f32]| {
            if let Some((pixels, filled)) = levels.get_mut(level) {
                pixels.copy_from(*filled, &Pixels::from_floats(self.pixel_type, rows), 0, rows.len());
                *filled += rows.len();
            }
        };
        for y in (0..size.1).step_by(ROWS) {
            let rows = input.read_rows(0, 0, y as u32, (y + ROWS).min(size.1) as u32)?;
            let mut rows = match rows {
                Pixels::Float(v) => v,
                other => other.to_floats(),
            };
            crate::image::make_finite(&mut rows);
            put(0, &rows);
            smaller.push(&rows, &mut put);
        }
        Ok(levels.into_iter().map(|(pixels, _)| pixels).collect())
    }

    /// Returns the upper left corner of a face of a level.
    pub(crate) fn face_origin(&self, level: &Level, face: usize) -> (u32, u32) {
        if !self.kind.is_cube() {
            return (0, 0);
        }
        let (column, row) = self.layout.cell(face);
        (column * level.step_x, row * level.step_y)
    }

    /// Returns the memory layout. Depths are read texel by texel, all others are filtered.
    pub(crate) fn layout_in_memory(&self) -> Layout {
        if self.kind.is_shadow() { Layout::Texels } else { Layout::Planes }
    }

    /// Returns the bytes of a tile of a level.
    pub(crate) fn tile_bytes(&self, level: usize) -> u64 {
        let level = &self.levels[level];
        u64::from(level.tile_width) * u64::from(level.tile_height) * self.texel_bytes
    }

    /// Returns the bytes of a tile of a level that count for the bound of the cache. It is 0 where levels are kept in
    /// any case.
    pub(crate) fn counted_bytes(&self, level: usize) -> u64 {
        if matches!(self.source, Source::Memory(..)) { 0 } else { self.tile_bytes(level) }
    }

    /// Releases the memory of its levels. All of it is black from now on.
    pub(crate) fn release(&mut self) {
        *self.broken.get_mut() = true;
        self.slices.take();
        if let Source::Memory(_, made) = &mut self.source {
            made.take();
        }
    }

    /// True when all of it is black because it cannot be read.
    #[inline]
    pub(crate) fn is_broken(&self) -> bool {
        self.broken.load(Ordering::Relaxed)
    }

    /// Returns black texels in place of a tile that cannot be read.
    pub(crate) fn black_tile(&self, level: &Level) -> Tile {
        Tile::black(self.pixel_type, level.tile_width as usize, self.channels)
    }

    /// Converts a stored number to the value of lookups.
    #[inline]
    pub(crate) fn number(&self, raw: f32) -> f32 {
        from_raw(self.pixel_type, raw)
    }
}
