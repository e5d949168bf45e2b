//! Writes the levels of a texture.

use super::banded::Bands;
use super::color::Conversion;
use super::picture::Window;
use super::scan::Scan;
use super::source::{Units, pixels};
use super::writer::{Shelf, Writer};
use super::{Costs, Made, MakeOptions, Progress};
use crate::cube::{self, CubeLayout};
use crate::error::{Result, TextureError};
use crate::image::{Image, half};
use crate::{TextureKind, Up};
use granita_base::{BaseType, Param, ParamData, ParamType, Params};
use granita_image::{Format, FormatRegistry, ImageSpec, PixelType, Pixels, is_about_colors};
use std::path::Path;
use std::sync::Arc;

/// A texture that is ready to be written.
pub(crate) struct Texture {
    pub(crate) kind: TextureKind,
    pub(crate) body: Body,
    /// The orientation of a latitude-longitude map; `None` for others.
    pub(crate) up: Option<Up>,
    pub(crate) channels: Vec<String>,
    /// The pixel type of the inputs.
    pub(crate) pixel_type: PixelType,
    pub(crate) attributes: Params,
    /// The profile of the colours of the input.
    pub(crate) icc_profile: Option<Arc<[u8]>>,
    /// The conversion of the colours, which are linear here.
    pub(crate) conversion: Option<Conversion>,
    pub(crate) notes: Vec<String>,
    pub(crate) extras: Extras,
}

/// What only textures of one flat image have.
#[derive(Default)]
pub(crate) struct Extras {
    /// The data window and the display window of the first level, where they differ or do not begin at (0, 0).
    pub(crate) frame: Option<(Window, Window)>,
    /// Strings of the metadata, at the places where other texture systems find them. `None` removes one.
    pub(crate) marks: Vec<(&'static str, Option<String>)>,
}

/// The levels of a texture, largest first.
pub(crate) enum Body {
    /// The levels of one image.
    Flat(Vec<Image>),
    /// The levels of one image, which are made while they are written.
    Bands(Box<Bands>),
    /// The levels of six faces px nx py ny pz nz, left handed. Each entry holds the six faces of one level.
    Cube(Vec<[Image; 6]>),
}

/// The attributes that describe how the input is stored, not what it shows.
const STORAGE: [&str; 9] = [
    "compression",
    "planarconfig",
    "rowsperstrip",
    "textureformat",
    "wrapmodes",
    "envmap",
    "orientation",
    "software",
    "unassociatedalpha",
];

/// The storage of a texture, as far as all its levels share it.
pub(crate) struct Plan {
    /// True for OpenEXR, where all levels have the same tiles, and cubes are columns.
    exr: bool,
    /// True when the tiles of all levels have the same size.
    same_tiles: bool,
    /// The size of the tiles of the largest level, in texels.
    pub(crate) tile: (u32, u32),
    pub(crate) pixel_type: PixelType,
    channels: Vec<String>,
    attributes: Params,
    icc_profile: Option<Arc<[u8]>>,
    /// Notes for the user.
    pub(crate) notes: Vec<String>,
    pub(crate) costs: Costs,
}

/// One level as it is stored.
struct Stored {
    image: Image,
    /// The size of the display window. For cubes it is that of a face.
    full: (u32, u32),
    tile: (u32, u32),
}

/// Returns a string attribute.
pub(crate) fn word(name: &str, value: &str) -> Param {
    Param { name: name.into(), ty: ParamType::of(BaseType::String), data: value.into() }
}

/// Returns a numeric attribute.
pub(crate) fn number(name: &str, value: f32) -> Param {
    Param { name: name.into(), ty: ParamType::of(BaseType::Float), data: value.into() }
}

/// Returns the format, which must support textures.
fn texture_format(registry: &FormatRegistry, name: &str) -> Result<Arc<dyn Format>> {
    let unsupported = |what: String| TextureError::Unsupported { what };
    let Some(format) = registry.by_name(name) else {
        let known = registry.names().join(", ");
        return Err(unsupported(format!("unknown image format \"{name}\" (known: {known})")));
    };
    for feature in ["write", "tiles", "levels"] {
        if !format.supports(feature) {
            let able: Vec<&str> = (registry.names().into_iter())
                .filter(|n| registry.by_name(n).is_some_and(|f| f.supports("tiles") && f.supports("levels")))
                .collect();
            return Err(unsupported(format!(
                "format \"{}\" cannot store textures, which need tiles and MIP levels (able: {})",
                format.name(),
                able.join(", ")
            )));
        }
    }
    Ok(format.clone())
}

/// Returns the nearest pixel type that the format supports. A type that was requested is used wherever the format
/// supports it. Otherwise TIFF textures hold bytes, shorts and floats (reference 9.2.1), and OpenEXR textures halves
/// and floats.
fn nearest_type(
    format: &dyn Format,
    exr: bool,
    input: PixelType,
    asked: Option<PixelType>,
    peer: bool,
) -> PixelType {
    let has = |feature| format.supports(feature);
    if peer {
        // OpenImageIO stores all but floats as halves in OpenEXR, and halves as floats in TIFF.
        return match asked.unwrap_or(input) {
            PixelType::Float => PixelType::Float,
            _ if exr => PixelType::Half,
            PixelType::Half => PixelType::Float,
            other => nearest_type(format, exr, other, None, false),
        };
    }
    if asked == Some(PixelType::Half) && has("half") {
        return PixelType::Half;
    }
    match asked.unwrap_or(input) {
        PixelType::U8 if !exr => PixelType::U8,
        PixelType::U16 if !exr && has("u16") => PixelType::U16,
        PixelType::U8 | PixelType::Half if exr && has("half") => PixelType::Half,
        _ => PixelType::Float,
    }
}

/// Returns the type of the texels of a texture.
pub(crate) fn stored_type(
    options: &MakeOptions,
    kind: TextureKind,
    input: PixelType,
    registry: &FormatRegistry,
) -> Result<PixelType> {
    let format = texture_format(registry, &options.format)?;
    let exr = matches!(format.name(), "exr" | "OpenEXR");
    let (asked, peer) = (options.pixel_type, options.flat.is_peer());
    Ok(match kind.is_shadow() {
        true if peer && exr && asked.unwrap_or(input) == PixelType::Half => PixelType::Half,
        true => PixelType::Float,
        false => nearest_type(&*format, exr, input, asked, peer),
    })
}

impl Plan {
    /// Makes the plan for a texture of this kind, from the description of the input. `up` is the orientation of a
    /// latitude-longitude map.
    pub(crate) fn new(
        kind: TextureKind,
        up: Option<Up>,
        input: &ImageSpec,
        options: &MakeOptions,
        registry: &FormatRegistry,
    ) -> Result<Self> {
        let format = texture_format(registry, &options.format)?;
        let exr = matches!(format.name(), "exr" | "OpenEXR");
        let mut notes = Vec::new();
        let (mut w, mut h) = (options.tile_size.0.max(1), options.tile_size.1.max(1));
        let peer = options.flat.is_peer();
        let pixel_type = stored_type(options, kind, input.pixel_type, registry)?;
        if options.flat.prman {
            (w, h) = match options.pixel_type.unwrap_or(input.pixel_type) {
                PixelType::U8 => (64, 64),
                PixelType::U16 => (64, 32),
                _ => (32, 32),
            };
        }
        if peer && !exr && (w % 16 != 0 || h % 16 != 0) {
            let what = format!("tiles of {w} x {h} texels: sides in TIFF are multiples of 16");
            return Err(TextureError::Unsupported { what });
        }
        if !exr && (w % 16 != 0 || h % 16 != 0) {
            (w, h) = (w.next_multiple_of(16), h.next_multiple_of(16));
            notes.push(format!(
                "tiles of {} x {} texels became {w} x {h}: the format needs multiples of 16",
                options.tile_size.0, options.tile_size.1
            ));
        }
        if let Some(asked) = options.pixel_type.filter(|asked| *asked != pixel_type && !peer) {
            let reason = if kind.is_shadow() { "depths need it" } else { "the format has no other" };
            let (asked, got) = (asked.word(), pixel_type.word());
            notes.push(format!("texels are {got}, not {asked}: {reason}"));
        }
        let mut attributes = input.attributes.clone();
        let signed = options.flat.signature.is_some();
        attributes.0.retain(|p| {
            let is_stale = STORAGE.iter().any(|s| p.name.eq_ignore_ascii_case(s));
            let is_lost = !options.keeps_colors() && is_about_colors(&p.name);
            !is_lost && (!is_stale || (signed && &*p.name == "software"))
        });
        attributes.set(word("textureformat", kind.word()));
        match kind {
            TextureKind::Plain | TextureKind::Shadow if peer => {
                attributes
                    .set(word("wrapmodes", &format!("{},{}", options.swrap.word(), options.twrap.word())));
            }
            TextureKind::Plain => {
                let (s, t) = (options.swrap.word(), options.twrap.word());
                attributes.set(word("wrapmodes", &if s == t { s.to_owned() } else { format!("{s},{t}") }));
            }
            TextureKind::LatLongEnvironment => attributes.set(word("wrapmodes", "periodic,clamp")),
            _ => {}
        }
        if options.separate || options.flat.prman {
            attributes.set(word("planarconfig", "separate"));
        }
        if let Some(compression) = &options.compression {
            // OpenImageIO does the same, because DWA of one channel is not reliable in all versions of OpenEXR.
            let dwa = peer && exr && input.nchannels() == 1 && compression.starts_with("dwa");
            attributes.set(word("compression", if dwa { "zip" } else { compression }));
        }
        for (name, matrix) in [
            ("worldtocamera", options.mcamera),
            ("worldtoscreen", options.mscreen),
            ("worldtoNDC", options.flat.mndc),
        ] {
            if let Some(m) = matrix {
                let ty = ParamType::of(BaseType::Matrix);
                attributes.set(Param { name: name.into(), ty, data: ParamData::from(&m[..]) });
            }
        }
        if let Some(cot) = options.flat.fovcot {
            attributes.set(number("fovcot", cot));
        }
        attributes.extend(options.flat.attributes.0.clone());
        let channels = input.channels.clone();
        let mut plan = Self {
            same_tiles: peer,
            exr,
            tile: (w, h),
            pixel_type,
            channels,
            attributes,
            icc_profile: input.icc_profile.clone().filter(|_| options.keeps_colors()),
            notes,
            costs: Costs::default(),
        };
        // The orientation is stored only where it differs from the default of the format.
        if let Some(handed) = &options.flat.handed {
            // A word of the description has another name than an attribute.
            plan.mark(if exr { "handed" } else { "oiio:handed" }, Some(handed));
        }
        plan.mark(Up::ATTRIBUTE, up.filter(|up| *up != Up::of_format(exr)).map(Up::word));
        Ok(plan)
    }

    /// Sets a string of the metadata, or removes it. It is an attribute where the format supports arbitrary ones, and
    /// otherwise a word of the description.
    fn mark(&mut self, name: &str, value: Option<&str>) {
        let description = "ImageDescription";
        let old = self.attributes.iter().rev().find(|p| p.name.eq_ignore_ascii_case(description));
        let old = old.and_then(|p| self.attributes.string(&p.name)).map(|s| s.to_string());
        let old = old.unwrap_or_default();
        // A word that an earlier run wrote there is no longer valid.
        let is_stale = |word: &str| word.split_once('=').is_some_and(|(own, _)| own == name);
        let stale = old.split_whitespace().any(is_stale);
        self.attributes.0.retain(|p| !p.name.eq_ignore_ascii_case(name));
        let in_words = value.filter(|_| !self.exr);
        if stale || in_words.is_some() {
            let kept = old.split(' ').filter(|word| !word.is_empty() && !is_stale(word)).map(str::to_owned);
            let text: Vec<String> = kept.chain(in_words.map(|value| format!("{name}={value}"))).collect();
            self.attributes.0.retain(|p| !p.name.eq_ignore_ascii_case(description));
            if !text.is_empty() {
                self.attributes.set(word(description, &text.join(" ")));
            }
        }
        if let Some(value) = value.filter(|_| self.exr) {
            self.attributes.set(word(name, value));
        }
    }

    /// Returns the description of one level from its size, that of its display window, and that of its tiles.
    pub(crate) fn spec(&self, size: (usize, usize), full: (u32, u32), tile: (u32, u32)) -> ImageSpec {
        let mut spec = ImageSpec::new(size.0 as u32, size.1 as u32, self.channels.len(), self.pixel_type)
            .tiled(tile.0, tile.1);
        spec.channels.clone_from(&self.channels);
        if !self.exr {
            (spec.full_width, spec.full_height) = full;
        }
        spec.attributes.clone_from(&self.attributes);
        spec.icc_profile.clone_from(&self.icc_profile);
        spec
    }

    /// Puts hash and mean into the metadata, at the places where other texture systems find them. They are attributes
    /// where the format supports arbitrary ones, and otherwise words of the description.
    pub(crate) fn describe_content(&mut self, scan: &Scan, options: &MakeOptions) {
        let Some((hash, mean)) = scan.content().filter(|_| options.hash) else { return };
        let mean = mean.iter().map(f32::to_string).collect::<Vec<_>>().join(",");
        self.mark("oiio:SHA-1", Some(&hash));
        self.mark("oiio:AverageColor", Some(&mean));
        // OpenImageIO ignores the hash where the program has another name.
        self.attributes.set(word("software", &format!("maketx (Granita {})", granita_base::VERSION)));
    }

    /// Returns the size of the tiles of a level whose image, or face, has this width and height. Smaller levels may
    /// have smaller tiles.
    pub(crate) fn tile(&self, width: usize, height: usize) -> (u32, u32) {
        if self.exr || self.same_tiles {
            return self.tile;
        }
        let fit = |n: usize, tile: u32| (n as u32).next_power_of_two().clamp(16, tile.max(16)).min(tile);
        (fit(width, self.tile.0), fit(height, self.tile.1))
    }

    /// Returns the levels as they are stored, with display window and tiles. Bands have none yet.
    fn levels(&self, body: Body, path: &Path) -> Result<Vec<Stored>> {
        let flat = |p: Image| {
            let (full, tile) = ((p.width as u32, p.height as u32), self.tile(p.width, p.height));
            Stored { image: p, full, tile }
        };
        match body {
            Body::Flat(levels) => Ok(levels.into_iter().map(flat).collect()),
            Body::Bands(_) => Ok(Vec::new()),
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
                // A column is six times as high as wide. Its own pyramid has more levels than its faces.
                while let Some(last) = out.last().map(|l| &l.image).filter(|p| mipmapped && p.height > 1) {
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
                    Stored { image: mosaic(faces, tile), full, tile }
                })
                .collect()),
        }
    }
}

/// Returns the 3 x 2 mosaic, in which each face begins on a tile boundary (reference 9.2.7).
fn mosaic(faces: &[Image; 6], tile: (u32, u32)) -> Image {
    let first = &faces[0];
    let step_x = first.width.next_multiple_of(tile.0 as usize);
    let step_y = first.height.next_multiple_of(tile.1 as usize);
    let mut out = Image::new(3 * step_x, 2 * step_y, first.channels);
    for (i, face) in faces.iter().enumerate() {
        let (column, row) = CubeLayout::Mosaic.cell(i);
        out.paste(face, column as usize * step_x, row as usize * step_y);
    }
    out
}

/// Returns the column of OpenEXR, with the same directions in right handed faces.
fn column(faces: &[Image; 6]) -> Image {
    let n = faces[0].width;
    let mut out = Image::new(n, 6 * n, faces[0].channels);
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

/// Writes a texture under its final name, complete or not at all.
pub(crate) fn write(
    texture: Texture,
    path: &Path,
    options: &MakeOptions,
    registry: &FormatRegistry,
    progress: Progress<'_>,
) -> Result<(Made, Costs)> {
    let described = ImageSpec {
        channels: texture.channels,
        attributes: texture.attributes,
        icc_profile: texture.icc_profile,
        ..ImageSpec::new(1, 1, 1, texture.pixel_type)
    };
    let mut plan = Plan::new(texture.kind, texture.up, &described, options, registry)?;
    let conversion = texture.conversion.as_ref().filter(|_| !texture.kind.is_shadow());
    let target = Target { path, options, registry, progress, conversion };
    let (spec, count, costs) = match texture.body {
        Body::Bands(bands) => target.write_bands(&bands, &mut plan, &texture.extras)?,
        body => {
            let levels = plan.levels(body, path)?;
            target.write_levels(levels, &mut plan, &texture.extras)?
        }
    };
    let mut notes = texture.notes;
    notes.append(&mut plan.notes);
    Ok((Made::Written { width: spec.width, height: spec.height, levels: count as u32, notes }, costs))
}

/// The file of a texture.
struct Target<'a> {
    path: &'a Path,
    options: &'a MakeOptions,
    registry: &'a FormatRegistry,
    progress: Progress<'a>,
    conversion: Option<&'a Conversion>,
}

impl Target<'_> {
    /// Returns floats as the texture stores them.
    fn stored(&self, values: Vec<f32>, n: usize, pixel_type: PixelType) -> Pixels {
        pixels(values, n, pixel_type, Units::Fractions, self.conversion)
    }

    /// Writes levels while they are made. Returns the description of the first one and their number.
    fn write_bands(
        &self,
        bands: &Bands,
        plan: &mut Plan,
        extras: &Extras,
    ) -> Result<(ImageSpec, usize, Costs)> {
        extras.marks.iter().for_each(|(name, value)| plan.mark(name, value.as_deref()));
        let specs: Vec<ImageSpec> = (bands.sizes().into_iter())
            .map(|(w, h)| plan.spec((w, h), (w as u32, h as u32), plan.tile(w, h)))
            .collect();
        let mut shelves: Vec<Shelf> = specs.iter().map(Shelf::new).collect();
        let (first, count) = (specs[0].clone(), specs.len());
        let mut writer = Writer::create(self.path, specs, self.options, self.registry, self.progress)?;
        bands.write(first.tile_height as usize, |level, values| {
            let stored = self.stored(values, first.nchannels(), plan.pixel_type);
            writer.write(level, shelves[level].push(&stored))
        })?;
        Ok((first, count, writer.finish()?))
    }

    /// Does the same for levels that are complete.
    fn write_levels(
        &self,
        levels: Vec<Stored>,
        plan: &mut Plan,
        extras: &Extras,
    ) -> Result<(ImageSpec, usize, Costs)> {
        let size = |p: &Image| (p.width, p.height);
        if self.options.hash {
            let first = levels[0].image.clone();
            let mut scan = Scan::new(size(&first), first.channels, plan.pixel_type, true);
            scan.push(&self.stored(first.data, first.channels, plan.pixel_type));
            plan.describe_content(&scan, self.options);
        }
        extras.marks.iter().for_each(|(name, value)| plan.mark(name, value.as_deref()));
        let mut specs: Vec<ImageSpec> =
            levels.iter().map(|level| plan.spec(size(&level.image), level.full, level.tile)).collect();
        if let Some((data, full)) = extras.frame {
            let spec = &mut specs[0];
            (spec.x, spec.y, spec.full_x, spec.full_y) =
                (data.x as i32, data.y as i32, full.x as i32, full.y as i32);
            (spec.full_width, spec.full_height) = (full.width as u32, full.height as u32);
        }
        let mut writer =
            Writer::create(self.path, specs.clone(), self.options, self.registry, self.progress)?;
        for (i, (level, spec)) in levels.into_iter().zip(&specs).enumerate() {
            let n = spec.nchannels();
            let row = spec.width as usize * n * spec.tile_height as usize;
            let mut shelf = Shelf::new(spec);
            // The level is converted by rows of tiles, so that no other form of all of it is in memory beside it.
            for values in level.image.data.chunks(row.max(1)) {
                let rows = self.stored(values.to_vec(), n, plan.pixel_type);
                writer.write(i, shelf.push(&rows))?;
            }
        }
        Ok((specs[0].clone(), specs.len(), writer.finish()?))
    }
}
