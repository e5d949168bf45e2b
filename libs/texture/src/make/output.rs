//! Writing the levels of a texture.

use super::input::gamma;
use super::{Made, MakeOptions, Progress};
use crate::TextureKind;
use crate::cube::{self, CubeLayout};
use crate::error::{Result, TextureError};
use crate::picture::{Picture, half};
use granita_base::{BaseType, Param, ParamData, ParamType, Params};
use granita_image::{CreateOptions, Format, FormatRegistry, ImageSpec, PixelType, Pixels};
use rayon::prelude::*;
use std::path::Path;
use std::sync::Arc;

/// A texture that is ready to be written.
pub(crate) struct Texture {
    pub(crate) kind: TextureKind,
    pub(crate) body: Body,
    pub(crate) channels: Vec<String>,
    /// Storage of the inputs.
    pub(crate) pixel_type: PixelType,
    pub(crate) attributes: Params,
    pub(crate) notes: Vec<String>,
}

/// Levels, largest first.
pub(crate) enum Body {
    /// Of one picture.
    Flat(Vec<Picture>),
    /// Of six faces px nx py ny pz nz, left handed; inner lists are levels.
    Cube(Vec<[Picture; 6]>),
}

/// How the chosen format stores things.
struct Target {
    format: Arc<dyn Format>,
    /// OpenEXR: all levels have the same tiles, and cubes are columns.
    exr: bool,
    tile: (u32, u32),
}

/// One level as it is stored.
struct Stored {
    picture: Picture,
    /// Size of the display window; of a face for cubes.
    full: (u32, u32),
    tile: (u32, u32),
}

/// A string attribute.
fn word(name: &str, value: &str) -> Param {
    Param { name: name.into(), ty: ParamType::of(BaseType::String), data: value.into() }
}

impl Target {
    fn new(texture: &mut Texture, options: &MakeOptions, registry: &FormatRegistry) -> Result<Self> {
        let unsupported = |what: String| TextureError::Unsupported { what };
        let format = registry
            .by_name(&options.format)
            .ok_or_else(|| {
                let known = registry.names().join(", ");
                unsupported(format!("unknown image format \"{}\" (known: {known})", options.format))
            })?
            .clone();
        for feature in ["write", "tiles", "levels"] {
            if !format.supports(feature) {
                let able: Vec<&str> = (registry.names().into_iter())
                    .filter(|n| {
                        registry.by_name(n).is_some_and(|f| f.supports("tiles") && f.supports("levels"))
                    })
                    .collect();
                return Err(unsupported(format!(
                    "format \"{}\" cannot store textures, which need tiles and MIP levels (able: {})",
                    format.name(),
                    able.join(", ")
                )));
            }
        }
        let exr = matches!(format.name(), "exr" | "OpenEXR");
        let (mut w, mut h) = (options.tile_size.0.max(1), options.tile_size.1.max(1));
        if !exr && (w % 16 != 0 || h % 16 != 0) {
            (w, h) = (w.next_multiple_of(16), h.next_multiple_of(16));
            texture.notes.push(format!(
                "tiles of {} x {} texels became {w} x {h}: the format needs multiples of 16",
                options.tile_size.0, options.tile_size.1
            ));
        }
        Ok(Self { format, exr, tile: (w, h) })
    }

    /// The nearest storage that the format has.
    fn pixel_type(&self, wanted: PixelType) -> PixelType {
        let has = |feature| self.format.supports(feature);
        // TIFF textures hold bytes, shorts and floats (reference 9.2.1); half floats are OpenEXR's.
        let half = has("half") && self.exr;
        let integers = !self.exr;
        match wanted {
            PixelType::U8 if integers => PixelType::U8,
            PixelType::U16 if integers && has("u16") => PixelType::U16,
            PixelType::U8 | PixelType::Half if half => PixelType::Half,
            _ => PixelType::Float,
        }
    }

    /// Tiles of a level whose picture, or face, is `width x height`: smaller levels may have smaller tiles.
    fn tile(&self, width: usize, height: usize) -> (u32, u32) {
        if self.exr {
            return self.tile;
        }
        let fit = |n: usize, tile: u32| (n as u32).next_power_of_two().clamp(16, tile.max(16)).min(tile);
        (fit(width, self.tile.0), fit(height, self.tile.1))
    }

    /// The levels as they are stored: picture, display window, tiles.
    fn levels(&self, body: Body, path: &Path) -> Result<Vec<Stored>> {
        let flat = |p: Picture| {
            let (full, tile) = ((p.width as u32, p.height as u32), self.tile(p.width, p.height));
            Stored { picture: p, full, tile }
        };
        match body {
            Body::Flat(levels) => Ok(levels.into_iter().map(flat).collect()),
            Body::Cube(levels) if self.exr => {
                let n = levels[0][0].width;
                if levels.len() > 1 && !n.is_power_of_two() {
                    return Err(TextureError::Malformed {
                        path: path.to_owned(),
                        what: format!(
                            "faces of {n} pixels: OpenEXR needs a power of two, as without -noresize"
                        ),
                    });
                }
                let mipmapped = levels.len() > 1;
                let mut out: Vec<_> = levels.iter().map(|faces| flat(column(faces))).collect();
                // A column is six times as high as wide: its own pyramid has more levels than its faces.
                while let Some(last) = out.last().map(|l| &l.picture).filter(|p| mipmapped && p.height > 1) {
                    let wrap = (crate::Wrap::Clamp, crate::Wrap::Clamp);
                    let next = last.resized(1, half(last.height), granita_base::Filter::Box, wrap);
                    out.push(flat(next));
                }
                Ok(out)
            }
            Body::Cube(levels) => Ok(levels
                .iter()
                .map(|faces| {
                    let tile = self.tile(faces[0].width, faces[0].height);
                    let full = (faces[0].width as u32, faces[0].height as u32);
                    Stored { picture: mosaic(faces, tile), full, tile }
                })
                .collect()),
        }
    }
}

/// The 3 x 2 mosaic, each face on a tile boundary (reference 9.2.7).
fn mosaic(faces: &[Picture; 6], tile: (u32, u32)) -> Picture {
    let first = &faces[0];
    let step_x = first.width.next_multiple_of(tile.0 as usize);
    let step_y = first.height.next_multiple_of(tile.1 as usize);
    let mut out = Picture::new(3 * step_x, 2 * step_y, first.channels);
    for (i, face) in faces.iter().enumerate() {
        let (column, row) = CubeLayout::Mosaic.cell(i);
        out.paste(face, column as usize * step_x, row as usize * step_y);
    }
    out
}

/// The column of OpenEXR: the same directions, faces seen right handed.
fn column(faces: &[Picture; 6]) -> Picture {
    let n = faces[0].width;
    let mut out = Picture::new(n, 6 * n, faces[0].channels);
    for face in 0..6 {
        for y in 0..n {
            for x in 0..n {
                let centre = |v: usize| (v as f32 + 0.5) / n as f32;
                let d = cube::direction(CubeLayout::Column, face, centre(x), centre(y));
                let p = cube::project(CubeLayout::Mosaic, d);
                let index = |v: f32| ((v * n as f32) as usize).min(n - 1);
                out.texel_mut(x, face * n + y).copy_from_slice(faces[p.face].texel(index(p.s), index(p.t)));
            }
        }
    }
    out
}

/// Tile (tx, ty) of a picture in the type of the file; black outside.
fn tile_of(picture: &Picture, tile: (u32, u32), tx: u32, ty: u32, pixel_type: PixelType) -> Pixels {
    let (w, h, n) = (tile.0 as usize, tile.1 as usize, picture.channels);
    let (x, y) = (tx as usize * w, ty as usize * h);
    let mut values = vec![0.0; w * h * n];
    let across = w.min(picture.width - x) * n;
    for row in 0..h.min(picture.height - y) {
        let from = ((y + row) * picture.width + x) * n;
        values[row * w * n..][..across].copy_from_slice(&picture.data[from..][..across]);
    }
    match pixel_type {
        PixelType::Float => Pixels::Float(values),
        // Large values stay large: infinity would spread through every filter.
        PixelType::Half => {
            values.iter_mut().for_each(|v| *v = v.clamp(-65504.0, 65504.0));
            Pixels::from_floats(pixel_type, &values)
        }
        _ => Pixels::from_floats(pixel_type, &values),
    }
}

/// Writes a texture under its final name, complete or not at all.
pub(crate) fn write(
    mut texture: Texture,
    path: &Path,
    options: &MakeOptions,
    registry: &FormatRegistry,
    progress: Progress<'_>,
) -> Result<Made> {
    let target = Target::new(&mut texture, options, registry)?;
    let pixel_type = if texture.kind.is_shadow() {
        PixelType::Float
    } else {
        target.pixel_type(options.pixel_type.unwrap_or(texture.pixel_type))
    };
    let mut attributes = texture.attributes;
    attributes.set(word("textureformat", texture.kind.word()));
    match texture.kind {
        TextureKind::Plain => {
            let (s, t) = (options.swrap.word(), options.twrap.word());
            attributes.set(word("wrapmodes", &if s == t { s.to_owned() } else { format!("{s},{t}") }));
        }
        TextureKind::LatLongEnvironment => attributes.set(word("wrapmodes", "periodic,clamp")),
        _ => {}
    }
    if options.separate {
        attributes.set(word("planarconfig", "separate"));
    }
    if let Some(compression) = &options.compression {
        attributes.set(word("compression", compression));
    }
    for (name, matrix) in [("worldtocamera", options.mcamera), ("worldtoscreen", options.mscreen)] {
        if let Some(m) = matrix {
            let ty = ParamType::of(BaseType::Matrix);
            attributes.set(Param { name: name.into(), ty, data: ParamData::from(&m[..]) });
        }
    }
    let levels = target.levels(texture.body, path)?;
    let spec = |Stored { picture, full, tile }: &Stored| {
        let size = (picture.width as u32, picture.height as u32);
        let mut spec = ImageSpec::new(size.0, size.1, picture.channels, pixel_type).tiled(tile.0, tile.1);
        spec.channels.clone_from(&texture.channels);
        if !target.exr {
            (spec.full_width, spec.full_height) = *full;
        }
        spec.attributes.clone_from(&attributes);
        spec
    };
    let specs: Vec<ImageSpec> = levels.iter().map(spec).collect();
    let total: u64 = specs.iter().map(|s| u64::from(s.tiles().0) * u64::from(s.tiles().1)).sum();
    let mut done = 0;
    progress(done, total);
    let create = CreateOptions { spec: &specs[0], levels: levels.len() };
    let mut output = registry.create(path, &options.format, &create)?;
    for (i, (level, spec)) in levels.into_iter().zip(&specs).enumerate() {
        if i > 0 {
            output.next_level(spec)?;
        }
        let (mut picture, tile) = (level.picture, level.tile);
        if !texture.kind.is_shadow() {
            gamma(&mut picture, 1.0 / options.outgamma);
        }
        let (across, down) = spec.tiles();
        for ty in 0..down {
            let row: Vec<Pixels> =
                (0..across).into_par_iter().map(|tx| tile_of(&picture, tile, tx, ty, pixel_type)).collect();
            for (tx, pixels) in row.iter().enumerate() {
                output.write_tile(tx as u32, ty, pixels)?;
            }
            done += u64::from(across);
            progress(done, total);
        }
    }
    output.close()?;
    Ok(Made::Written {
        width: specs[0].width,
        height: specs[0].height,
        levels: specs.len() as u32,
        notes: texture.notes,
    })
}
