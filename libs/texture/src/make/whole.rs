//! Makes textures of one flat image that is in memory as a whole, for the options of [`FlatOptions`].

use super::banded::{Bands, Rows, Scanned, hash_of_parts, limit_to_halves};
use super::bump::{self, Slopes};
use super::distribution;
use super::environment::is_cube;
use super::flat::{FlatOptions, Frame};
use super::kernel::{Kernel, compress_highlights, expand_highlights, sharpened};
use super::options::BrokenValues;
use super::output::{Body, Extras, Texture};
use super::picture::{ChannelStatistics, Picture, Window, is_alpha};
use super::reduction::{interpolated, resampled};
use super::scan::{HASHED_ROWS, update};
use super::source::{Source, Texels};
use super::sphere::{latlong_mean, latlong_next};
use super::surround::{Parts, Surrounded};
use super::{MakeOptions, Mode, color::Conversion, makes_exr, power_of_two};
use crate::error::{Result, TextureError};
use crate::image::{Image, half};
use crate::{TextureKind, Up, Wrap};
use granita_base::{Filter, Params};
use granita_image::{FormatRegistry, PixelType};
use rayon::prelude::*;
use sha1::{Digest, Sha1};
use std::path::Path;

/// What is known while a texture is made.
struct Work<'a> {
    path: &'a Path,
    options: &'a MakeOptions,
    flat: &'a FlatOptions,
    registry: &'a FormatRegistry,
    kind: TextureKind,
    /// True when the texture will be an OpenEXR file.
    exr: bool,
    /// True when the texture will hold halves.
    halves: bool,
    /// True when the image extends beyond its display window.
    overscan: bool,
}

/// Reads an image, and makes the texture with all its levels.
///
/// # Errors
/// Returns an error when the input cannot be read, or when it is not suitable for the options.
pub(crate) fn read(path: &Path, options: &MakeOptions, registry: &FormatRegistry) -> Result<Texture> {
    let flat = &options.flat;
    let kind = match options.mode {
        Mode::Plain => TextureKind::Plain,
        Mode::EnvLatLong => TextureKind::LatLongEnvironment,
        Mode::Shadow => TextureKind::Shadow,
        _ => {
            let what = "options for single images apply to plain textures and -envlatl only".to_owned();
            return Err(TextureError::Misuse { what });
        }
    };
    let mut source = Source::open(path, options, registry)?;
    if is_cube(&source.spec) && kind == TextureKind::LatLongEnvironment {
        let what = "the options do not apply to a file that holds a cube".to_owned();
        return Err(TextureError::Malformed { path: path.to_owned(), what });
    }
    let mut work = Work {
        path,
        options,
        flat,
        registry,
        kind,
        exr: makes_exr(options, registry),
        halves: false,
        overscan: false,
    };
    let conversion = source.conversion(options);
    let pixel_type = source.spec.pixel_type;
    work.halves = super::output::stored_type(options, kind, pixel_type, registry)? == PixelType::Half;
    let mut notes = Vec::new();
    let mut attributes = source.spec.attributes.clone();
    let icc_profile = source.spec.icc_profile.clone();
    if let Some(bump) = flat.bump.as_ref().filter(|bump| flat.is_peer() || bump.uv_scale != 0.0) {
        attributes.set(super::output::number("uvslopes_scale", bump.uv_scale));
    }
    if Rows::suit(&source, options) {
        let texels = Texels::new(&source, &conversion, flat.is_peer());
        let rows = Rows::new(source, texels, flat.bump.as_ref())?;
        let scanned = rows.scan(&work.hashed_options())?;
        let constant = scanned.statistics.iter().all(|c| c.low == c.high);
        let repairs = scanned.is_broken && options.broken_values != BrokenValues::Keep;
        if !constant && !repairs {
            let texture = Texture {
                kind,
                body: Body::Flat(Vec::new()),
                up: None,
                channels: Vec::new(),
                pixel_type,
                attributes,
                icc_profile,
                conversion: Some(conversion),
                notes,
                extras: Extras::default(),
            };
            return Ok(work.banded(rows, scanned, texture));
        }
        source = rows.into_source();
        let bytes = super::whole_bytes(&source, options, work.exr, 1);
        super::allow_memory(path, bytes.saturating_add(source.working_bytes()), options)?;
    }
    let mut picture = read_picture(&source, &conversion, flat.is_peer())?;
    if flat.probe {
        picture = panorama_of_probe(&picture);
    }
    if let Some(bump) = &flat.bump {
        picture = bump::slopes(&picture, bump).map_err(|what| work.malformed(what))?;
    }
    if let Some(distribution) = &flat.distribution {
        let channels = if flat.bump.is_some() { 6 } else { 4 };
        attributes.extend(distribution::metadata(&picture.image, channels, distribution).0);
    }
    let statistics = picture.statistics();
    let constant = picture.data == picture.full
        && (picture.full.x, picture.full.y) == (0, 0)
        && statistics.iter().all(|c| c.low == c.high)
        && picture.image.data.iter().all(|v| v.is_finite());
    if constant && options.constant_color && flat.neighbours.is_empty() {
        let (width, height) = (picture.data.width, picture.data.height);
        let tile = (options.tile_size.0 as usize, options.tile_size.1 as usize);
        picture.data = Window { width: width.min(tile.0), height: height.min(tile.1), ..picture.data };
        picture.full = picture.data;
        picture.image = picture.image.cropped(0, 0, picture.data.width, picture.data.height);
    }
    work.choose_channels(&mut picture, &statistics);
    if kind == TextureKind::Shadow && picture.image.channels != 1 {
        let what = format!("shadow maps have one channel, this has {}", picture.image.channels);
        return Err(work.malformed(what));
    }
    work.frame(&mut picture)?;
    let aspect = picture.full.width as f32 / picture.full.height as f32;
    let broken = picture.repair(options.broken_values);
    match options.broken_values {
        BrokenValues::Refuse if broken > 0 => {
            return Err(work.malformed(format!("{broken} pixels hold values that are not finite")));
        }
        BrokenValues::Black | BrokenValues::Fix | BrokenValues::Replace if broken > 0 => {
            notes.push(format!(
                "{}: {broken} pixels with values that are not finite were replaced",
                path.display()
            ));
        }
        _ => {}
    }
    let channels = picture.channels.clone();
    let alpha = picture.alpha();
    let framed = picture.data != picture.full || (picture.full.x, picture.full.y) != (0, 0);
    let (data, full) = (picture.data, picture.full);
    let up = match kind {
        TextureKind::LatLongEnvironment if flat.probe => Some(Up::Y),
        TextureKind::LatLongEnvironment => {
            Some(Up::of(&source.spec, crate::cube::is_openexr(source.format_name())))
        }
        _ => None,
    };
    let surrounded = work.surrounded(&picture.image, &mut notes)?;
    let top = work.first_level(picture.image);
    // An image that was enlarged begins at (0, 0).
    let frame = (framed && (top.width, top.height) == (data.width, data.height)).then_some((data, full));
    let mut marks = Vec::new();
    if flat.is_peer() {
        let hash = work.hash(&top);
        let found = Found { statistics: &statistics, channels: channels.len(), constant, hash, aspect };
        marks = work.describe(found, &mut attributes);
    }
    let levels = work.levels(top, alpha, surrounded)?;
    Ok(Texture {
        kind,
        body: Body::Flat(levels),
        up,
        channels,
        pixel_type,
        attributes,
        icc_profile,
        conversion: Some(conversion),
        notes,
        extras: Extras { frame, marks },
    })
}

/// What the metadata say of the first level.
struct Found<'a> {
    statistics: &'a [ChannelStatistics],
    channels: usize,
    constant: bool,
    hash: String,
    /// The width of the display window divided by its height.
    aspect: f32,
}

/// The number of texels that are changed together.
const CONVERTED: usize = 4096;

/// Reads the window of a source, with the values that are not finite.
fn read_picture(source: &Source, conversion: &Conversion, peer: bool) -> Result<Picture> {
    let spec = &source.spec;
    let image = source.converted(&Texels::new(source, conversion, peer))?;
    let (x, y) = (i64::from(spec.full_x), i64::from(spec.full_y));
    let (data, full) = match source.is_data() {
        true => {
            let full = match spec.full_width > 0 && spec.full_height > 0 {
                true => (spec.full_width as usize, spec.full_height as usize),
                false => (image.width, image.height),
            };
            let origin = (i64::from(spec.x), i64::from(spec.y));
            let window = |(x, y), (width, height)| Window { x, y, width, height };
            (window(origin, (image.width, image.height)), window((x, y), full))
        }
        false => {
            let all = Window { x: 0, y: 0, width: image.width, height: image.height };
            (all, all)
        }
    };
    Ok(Picture { image, data, full, channels: spec.channels.clone() })
}

/// Returns the panorama of a light probe, as wide as it and half as high, with +y up.
fn panorama_of_probe(probe: &Picture) -> Picture {
    use std::f32::consts::{PI, TAU};
    let from = &probe.image;
    let (width, height) = (from.width, (from.height / 2).max(1));
    let mut image = Image::new(width, height, from.channels);
    image.data.par_chunks_mut(width * from.channels).enumerate().for_each(|(y, row)| {
        let polar = ((height - 1 - y) as f32 + 0.5) / height as f32 * PI;
        for (x, texel) in row.chunks_exact_mut(from.channels).enumerate() {
            let around = (x as f32 + 0.5) / width as f32 * TAU;
            let d = (
                libm::sinf(polar) * libm::sinf(around),
                libm::cosf(polar),
                -libm::sinf(polar) * libm::cosf(around),
            );
            let r = libm::acosf(d.2.clamp(-1.0, 1.0)) / PI / libm::hypotf(d.0, d.1);
            let place = |v: f32, n: usize| (v * r + 1.0) * 0.5 * n as f32;
            from.bilinear(place(d.0, from.width), place(d.1, from.height), texel);
        }
    });
    let all = Window { x: 0, y: 0, width, height };
    Picture { image, data: all, full: all, channels: probe.channels.clone() }
}

impl Work<'_> {
    /// Returns a texture whose levels are made while they are written. `texture` has the attributes of the file.
    fn banded(&self, rows: Rows, scanned: Scanned, mut texture: Texture) -> Texture {
        let own = &rows.source().spec.channels;
        texture.channels = if self.flat.bump.is_some() { Slopes::channels() } else { own.clone() };
        self.name_channels(&mut texture.channels);
        let (width, height) = rows.size();
        let found = Found {
            statistics: &scanned.statistics,
            channels: texture.channels.len(),
            constant: false,
            hash: scanned.hash,
            aspect: width as f32 / height as f32,
        };
        texture.extras.marks = self.describe(found, &mut texture.attributes);
        texture.body = Body::Bands(Box::new(Bands {
            rows,
            kernel: self.kernel().unwrap_or(Kernel::Box),
            levels: self.flat.levels,
            alpha: texture.channels.iter().position(|name| is_alpha(name)),
            halves: self.halves,
        }));
        texture
    }

    /// Adds metadata to attributes, and returns those that have places of their own.
    fn describe(&self, found: Found<'_>, attributes: &mut Params) -> Vec<(&'static str, Option<String>)> {
        let flat = self.flat;
        let numbers = |value: fn(&ChannelStatistics) -> f32| {
            let of = |c| found.statistics.get(c).map_or(0.0, value).to_string();
            (0..found.channels).map(of).collect::<Vec<_>>().join(",")
        };
        let mut marks = vec![
            ("oiio:SHA-1", Some(found.hash)),
            ("oiio:ConstantColor", found.constant.then(|| numbers(|c| c.low))),
            ("oiio:AverageColor", flat.average.then(|| numbers(|c| c.mean))),
        ];
        attributes.set(super::output::number("fovcot", found.aspect));
        if self.overscan
            && !matches!(self.wrap(), (Wrap::Clamp, Wrap::Clamp | Wrap::Black) | (Wrap::Black, Wrap::Clamp))
        {
            marks.push(("wrapmodes", Some("black,black".to_owned())));
        }
        if let Some(signature) = &flat.signature {
            let history = attributes.string("Exif:ImageHistory").map(|old| format!("{}\n", old.trim_end()));
            let history = history.unwrap_or_default() + signature;
            attributes.set(super::output::word("Exif:ImageHistory", &history));
            attributes.set(super::output::word("software", signature));
        }
        if flat.keep_aspect {
            attributes.set(super::output::number("pixelaspect", found.aspect));
        }
        marks
    }

    /// Gives channels the names that were requested.
    fn name_channels(&self, channels: &mut [String]) {
        for (own, given) in channels.iter_mut().zip(&self.flat.channel_names) {
            if !given.is_empty() {
                own.clone_from(given);
            }
        }
    }

    fn malformed(&self, what: String) -> TextureError {
        TextureError::Malformed { path: self.path.to_owned(), what }
    }

    /// Leaves out, adds and names channels.
    fn choose_channels(&self, picture: &mut Picture, statistics: &[ChannelStatistics]) {
        let flat = self.flat;
        let n = picture.image.channels;
        let opaque = |c: usize| statistics[c].low == 1.0 && statistics[c].high == 1.0;
        if flat.drop_opaque
            && flat.channels.is_none()
            && n > 1
            && picture.alpha() == Some(n - 1)
            && opaque(n - 1)
        {
            picture.set_channels(n - 1);
        }
        let is_color = picture.image.channels == 3 && picture.alpha().is_none();
        if flat.drop_equal && flat.channels.is_none() && is_color && picture.is_grey() {
            picture.set_channels(1);
            picture.channels = granita_image::ImageSpec::default_channels(1);
        }
        if let Some(count) = flat.channels.filter(|count| *count != picture.image.channels) {
            picture.set_channels(count);
        }
        self.name_channels(&mut picture.channels);
    }

    /// Gives a picture the pixels of the window that the texture shows, and those around it.
    fn show(&self, picture: &mut Picture) {
        if self.flat.frame == Frame::Data {
            picture.data = Window { x: 0, y: 0, ..picture.data };
            picture.full = picture.data;
        }
        picture.pad(picture.full);
    }

    /// Makes the window of the picture the one that the texture shows.
    fn frame(&mut self, picture: &mut Picture) -> Result<()> {
        self.show(picture);
        self.overscan = picture.data != picture.full;
        if self.overscan && !self.exr {
            let what = "the image extends beyond its display window, which only textures of OpenEXR store";
            return Err(self.malformed(what.to_owned()));
        }
        if self.overscan && self.options.resize {
            let what = "an image that extends beyond its display window cannot be resized";
            return Err(self.malformed(what.to_owned()));
        }
        Ok(())
    }

    /// Returns the first level of an image.
    fn first_level(&self, image: Image) -> Image {
        let resize = self.options.resize && self.kind != TextureKind::Shadow;
        let size = (power_of_two(image.width), power_of_two(image.height));
        let size = if resize { size } else { (image.width, image.height) };
        if size == (image.width, image.height) {
            // OpenImageIO filters a panorama for OpenEXR even where its size stays.
            let closed = self.flat.is_peer() && self.exr && self.kind == TextureKind::LatLongEnvironment;
            return match self.kernel() {
                Some(kernel) if closed && !matches!(kernel, Kernel::Box | Kernel::Triangle) => {
                    resampled(&image, size, kernel)
                }
                _ => image,
            };
        }
        match self.kernel() {
            Some(Kernel::Box | Kernel::Triangle) => {
                interpolated(&image, size, self.kind == TextureKind::LatLongEnvironment)
            }
            Some(kernel) => resampled(&image, size, kernel),
            None => image.resized(size.0, size.1, Filter::CatmullRom, self.wrap()),
        }
    }

    fn wrap(&self) -> (Wrap, Wrap) {
        match self.kind {
            TextureKind::LatLongEnvironment => (Wrap::Periodic, Wrap::Clamp),
            _ => (self.options.swrap, self.options.twrap),
        }
    }

    /// Returns the filter by the definition of OpenImageIO, if that applies.
    fn kernel(&self) -> Option<Kernel> {
        match &self.flat.filter {
            Some(filter) => Some(filter.kernel),
            None => self.flat.is_peer().then_some(Kernel::Box),
        }
    }

    /// Returns the options that are part of the hash.
    fn hashed_options(&self) -> String {
        let mut options = self.flat.filter.as_ref().map_or("box", |f| &f.name).to_owned() + " ";
        if self.flat.sharpen != 0.0 {
            options += &format!("sharpen_A={} ", self.flat.sharpen);
        }
        if self.flat.compress_highlights {
            options += "highlightcomp=1 ";
        }
        if self.flat.keep_aspect {
            options += "keepaspect=1 ";
        }
        options
    }

    /// Returns the hash of the first level and of the options that change the others. It is that of OpenImageIO, so
    /// that textures of both tools with the same pixels are recognised as equal.
    fn hash(&self, top: &Image) -> String {
        let part = HASHED_ROWS * top.width * top.channels;
        let hashed = |rows: &[f32]| {
            let mut sha1 = Sha1::new();
            update(&mut sha1, rows);
            sha1
        };
        hash_of_parts(top.data.par_chunks(part).map(hashed).collect(), &self.hashed_options())
    }

    /// Makes the values of a level storable.
    fn finish(&self, image: &mut Image, alpha: Option<usize>) {
        if !self.halves || !self.flat.is_peer() {
            return;
        }
        let n = image.channels;
        image.data.par_chunks_mut(CONVERTED * n).for_each(|values| limit_to_halves(values, n, alpha));
    }

    /// Gives the first and the last column of a panorama the same texels, and its first and last row one colour. Files
    /// of OpenEXR have the texels of panoramas at the ends of the range of directions.
    fn close_panorama(&self, image: &mut Image) {
        if self.kind != TextureKind::LatLongEnvironment || !self.exr || !self.flat.is_peer() {
            return;
        }
        let (w, h, n) = (image.width, image.height, image.channels);
        for y in [0, h - 1] {
            for c in 0..n {
                let mean = (0..w).map(|x| image.texel(x, y)[c]).sum::<f32>() / w as f32;
                (0..w).for_each(|x| image.texel_mut(x, y)[c] = mean);
            }
        }
        for y in 0..h {
            for c in 0..n {
                let mean = 0.5 * image.texel(0, y)[c] + 0.5 * image.texel(w - 1, y)[c];
                image.texel_mut(0, y)[c] = mean;
                image.texel_mut(w - 1, y)[c] = mean;
            }
        }
    }

    /// Returns an image with its neighbours around it; `None` when it has none.
    fn surrounded(&self, image: &Image, notes: &mut Vec<String>) -> Result<Option<Surrounded>> {
        if self.flat.neighbours.is_empty() {
            return Ok(None);
        }
        let is_misused = self.kind != TextureKind::Plain || self.flat.bump.is_some() || self.overscan;
        if is_misused {
            let what = "filters over seams apply to plain textures that are neither slopes nor extend beyond their display windows";
            return Err(TextureError::Misuse { what: what.to_owned() });
        }
        if self.options.resize
            && (power_of_two(image.width), power_of_two(image.height)) != (image.width, image.height)
        {
            let what =
                "filters over seams need sides that are powers of two, or an image that is not resized";
            return Err(self.malformed(what.to_owned()));
        }
        let mut parts = Parts::default();
        for neighbour in &self.flat.neighbours {
            let source = Source::open(&neighbour.path, self.options, self.registry)?;
            let mut picture = read_picture(&source, &source.conversion(self.options), self.flat.is_peer())?;
            self.show(&mut picture);
            if picture.image.channels != image.channels {
                picture.set_channels(image.channels);
            }
            picture.repair(self.options.broken_values);
            if !parts.add(image, neighbour, &picture.image) {
                notes.push(format!(
                    "{}: the neighbour {} has another size, and is not used",
                    self.path.display(),
                    neighbour.path.display()
                ));
            }
        }
        Ok(parts.around(image))
    }

    /// Returns all levels.
    fn levels(
        &self,
        mut top: Image,
        alpha: Option<usize>,
        mut surrounded: Option<Surrounded>,
    ) -> Result<Vec<Image>> {
        let mean = latlong_mean(&top);
        self.close_panorama(&mut top);
        self.finish(&mut top, alpha);
        let mut levels = vec![top];
        let mut files = self.flat.level_files.iter();
        let many = self.flat.levels && self.kind != TextureKind::Shadow;
        while let Some(last) = levels.last().filter(|p| many && (p.width > 1 || p.height > 1)) {
            let mut next = match (files.next(), surrounded.take()) {
                (Some(file), _) => self.level_of_file(file, last)?,
                (None, Some(around)) => {
                    let (level, next) = around.next(|image| self.next_level(image, alpha, &mean));
                    surrounded = next;
                    level
                }
                (None, None) => self.next_level(last, alpha, &mean),
            };
            self.finish(&mut next, alpha);
            self.close_panorama(&mut next);
            levels.push(next);
        }
        Ok(levels)
    }

    /// Reads a level from a file.
    fn level_of_file(&self, path: &Path, above: &Image) -> Result<Image> {
        let source = Source::open(path, self.options, self.registry)?;
        let conversion = source.conversion(self.options);
        let mut picture = read_picture(&source, &conversion, self.flat.is_peer())?;
        if picture.image.channels != above.channels {
            picture.set_channels(above.channels);
        }
        picture.repair(self.options.broken_values);
        let (w, h) = (picture.image.width, picture.image.height);
        let size = (half(above.width), half(above.height));
        if self.exr && (w, h) != size {
            let what =
                format!("a level of {w} x {h} pixels, this level of OpenEXR has {} x {}", size.0, size.1);
            return Err(TextureError::Malformed { path: path.to_owned(), what });
        }
        Ok(picture.image)
    }

    /// Makes a level from the one above it.
    fn next_level(&self, last: &Image, alpha: Option<usize>, mean: &[f64]) -> Image {
        let flat = self.flat;
        let size = (half(last.width), half(last.height));
        let panorama = self.kind == TextureKind::LatLongEnvironment;
        let (blur, after) = match &flat.filter {
            Some(filter) => (filter.blur, filter.sharpen_after),
            None => (Kernel::Gaussian, false),
        };
        let kernel = self.kernel();
        // The box is interpolation, unless a filter is needed for another reason.
        if kernel == Some(Kernel::Box) && !self.overscan && flat.sharpen <= 0.0 {
            return interpolated(last, size, panorama);
        }
        let skip: Vec<usize> = alpha.into_iter().collect();
        let mut changed = None;
        if flat.compress_highlights {
            compress_highlights(changed.insert(last.clone()), &skip);
        }
        if flat.sharpen > 0.0 && !after {
            changed = Some(sharpened(changed.as_ref().unwrap_or(last), blur, flat.sharpen));
        }
        let from = changed.as_ref().unwrap_or(last);
        let mut next = match kernel {
            Some(kernel) => resampled(from, size, kernel),
            None if panorama => latlong_next(from, self.options.filter, mean),
            None => from.halved(self.options.filter, self.wrap()),
        };
        if flat.sharpen > 0.0 && after {
            next = sharpened(&next, blur, flat.sharpen);
        }
        if flat.compress_highlights {
            expand_highlights(&mut next, &skip);
            if let Some(alpha) = alpha {
                let n = next.channels;
                next.data.iter_mut().skip(alpha).step_by(n).for_each(|v| *v = v.min(1.0));
            }
        }
        next
    }
}
