//! Operations on windows: crop, cut, paste, mosaic.

use crate::image::{Image, Shape, Source, Window, float_rows};
use crate::{EditError, Result};
use granita_image::{BlockCopy, Pixels};
use std::sync::Arc;

/// A rectangle of a source. Pixels outside of the source are 0.
struct Windowed {
    from: Arc<dyn Source>,
    /// The rectangle, counted from the first pixel of the source.
    window: Window,
}

impl Source for Windowed {
    fn shape(&self) -> Shape {
        Shape { width: self.window.width, height: self.window.height, ..self.from.shape() }
    }

    fn rows(&self, y0: u32, y1: u32) -> Result<Pixels> {
        let (shape, own) = (self.from.shape(), self.shape());
        let mut out = Pixels::zeros(shape.pixel_type, (y1 - y0) as usize * own.row());
        let wanted = Window { y: self.window.y + i64::from(y0), height: y1 - y0, ..self.window };
        let all = Window { x: 0, y: 0, width: shape.width, height: shape.height };
        let Some(part) = wanted.common(&all) else { return Ok(out) };
        let rows = self.from.rows(part.y as u32, part.bottom() as u32)?;
        if rows.len() == out.len() && part.width == own.width && part.width == shape.width {
            return Ok(rows);
        }
        BlockCopy {
            from_width: shape.width as usize,
            from: (part.x as usize, 0),
            to_width: own.width as usize,
            to: ((part.x - wanted.x) as usize, (part.y - wanted.y) as usize),
            size: (part.width as usize, part.height as usize),
            nchannels: shape.channels,
        }
        .run(&rows, &mut out);
        Ok(out)
    }

    fn any_order(&self) -> bool {
        self.from.any_order()
    }
}

impl Image {
    /// Returns the image with another data window. Pixels that it did not have are 0. The display window stays.
    ///
    /// # Errors
    /// [`EditError::Misuse`] when the position exceeds 32 bits.
    pub fn crop(&self, window: &Window) -> Result<Self> {
        let data = self.data();
        if *window == data {
            return Ok(self.clone());
        }
        let part = Window { x: window.x - data.x, y: window.y - data.y, ..*window };
        let source = Arc::new(Windowed { from: self.source.clone(), window: part });
        self.with_source(source).placed(window.x, window.y)
    }

    /// Returns the pixels of a window as an image of their own, whose windows begin at (0, 0).
    ///
    /// # Errors
    /// The errors of [`Image::crop`].
    pub fn cut(&self, window: &Window) -> Result<Self> {
        let origin = Window { x: 0, y: 0, ..*window };
        self.crop(window)?.placed(0, 0)?.with_full(origin)
    }

    /// Returns the image with the pixels of its display window, no more and no less.
    ///
    /// # Errors
    /// The errors of [`Image::crop`].
    pub fn crop_to_full(&self) -> Result<Self> {
        self.crop(&self.full())
    }

    /// Returns the image with its first pixel at (x, y). The display window stays.
    ///
    /// # Errors
    /// [`EditError::Misuse`] when the position exceeds 32 bits.
    pub fn at(&self, x: i64, y: i64) -> Result<Self> {
        self.clone().placed(x, y)
    }

    /// Returns the image with its data window as the display window.
    ///
    /// # Errors
    /// [`EditError::Misuse`] when the image has no pixels.
    pub fn full_is_data(&self) -> Result<Self> {
        self.clone().with_full(self.data())
    }

    /// Returns the image without the rows and columns at its borders in which all values are 0. An image of zeros
    /// becomes one pixel. The image is read once.
    ///
    /// # Errors
    /// The error of reading it.
    pub fn trim(&self) -> Result<Self> {
        let shape = self.source.shape();
        let mut found: Option<(u32, u32, u32, u32)> = None;
        let step = band(&shape);
        for y0 in (0..shape.height).step_by(step as usize) {
            let y1 = (y0 + step).min(shape.height);
            let values = float_rows(&*self.source, y0, y1)?;
            for (y, row) in (y0..).zip(values.chunks_exact(shape.row())) {
                let is_set = |pixel: &[f32]| pixel.iter().any(|v| *v != 0.0);
                let mut pixels = row.chunks_exact(shape.channels);
                let Some(first) = pixels.position(is_set) else { continue };
                let last = row.chunks_exact(shape.channels).rposition(is_set).unwrap_or(first);
                let (first, last) = (first as u32, last as u32);
                found = Some(match found {
                    None => (first, y, last, y),
                    Some((left, top, right, _)) => (left.min(first), top, right.max(last), y),
                });
            }
        }
        let (left, top, right, bottom) = found.unwrap_or((0, 0, 0, 0));
        let data = self.data();
        self.crop(&Window {
            x: data.x + i64::from(left),
            y: data.y + i64::from(top),
            width: right - left + 1,
            height: bottom - top + 1,
        })
    }
}

/// The number of rows that are requested at once: about 4 MiB, in multiples of 64 rows where rows are short.
pub(crate) fn band(shape: &Shape) -> u32 {
    const BYTES: u64 = 4 << 20;
    let rows = (BYTES / shape.row_bytes().max(1)).clamp(1, 4096) as u32;
    let rows = if rows >= 64 { rows / 64 * 64 } else { rows };
    rows.min(shape.height.max(1))
}

/// Images at places of one window. Later ones cover earlier ones, and the rest is 0. All have the same number of
/// channels and the same type.
pub(crate) struct Placed {
    pub(crate) shape: Shape,
    /// The sources, with the positions of their first pixels.
    pub(crate) parts: Vec<(Arc<dyn Source>, i64, i64)>,
}

impl Source for Placed {
    fn shape(&self) -> Shape {
        self.shape
    }

    fn rows(&self, y0: u32, y1: u32) -> Result<Pixels> {
        let mut out = Pixels::zeros(self.shape.pixel_type, (y1 - y0) as usize * self.shape.row());
        let wanted = Window { x: 0, y: y0.into(), width: self.shape.width, height: y1 - y0 };
        for (source, x, y) in &self.parts {
            let shape = source.shape();
            let all = Window { x: *x, y: *y, width: shape.width, height: shape.height };
            let Some(part) = wanted.common(&all) else { continue };
            let rows = source.rows((part.y - y) as u32, (part.bottom() - y) as u32)?;
            BlockCopy {
                from_width: shape.width as usize,
                from: ((part.x - x) as usize, 0),
                to_width: self.shape.width as usize,
                to: (part.x as usize, (part.y - wanted.y) as usize),
                size: (part.width as usize, part.height as usize),
                nchannels: shape.channels,
            }
            .run(&rows, &mut out);
        }
        Ok(out)
    }

    fn any_order(&self) -> bool {
        self.parts.iter().all(|(source, ..)| source.any_order())
    }
}

/// Returns an image over another one, with its first pixel at (x, y), or at its own position. The data window is that
/// of the lower one, or with `extend` the smallest one that also contains the upper one.
///
/// # Errors
/// [`EditError::Misuse`] when the windows are too large.
pub fn paste(upper: &Image, lower: &Image, at: Option<(i64, i64)>, extend: bool) -> Result<Image> {
    let (x, y) = at.unwrap_or((upper.data().x, upper.data().y));
    let upper = upper.at(x, y)?;
    let window = lower.data().union(&upper.data())?;
    let (upper, lower) = (upper.associated(), lower.associated());
    let channels = upper.spec.nchannels().max(lower.spec.nchannels());
    let pixel_type = lower.spec.pixel_type.max(upper.spec.pixel_type);
    let parts = [&lower, &upper].map(|image| {
        let data = image.data();
        (image.with_channels(channels).converted(pixel_type).source, data.x - window.x, data.y - window.y)
    });
    let shape = Shape { width: window.width, height: window.height, channels, pixel_type };
    let names = lower.with_channels(channels);
    let whole =
        names.with_source(Arc::new(Placed { shape, parts: parts.into() })).placed(window.x, window.y)?;
    if extend { Ok(whole) } else { whole.crop(&lower.data()) }
}

/// Returns a contact sheet of images in rows of `columns` cells, with `pad` pixels between them. A cell has the largest
/// width and height of the display windows, and missing images leave black cells.
///
/// # Errors
/// [`EditError::Misuse`] when there are no images or cells, or too many of them.
pub fn mosaic(images: &[Image], (columns, rows): (u32, u32), pad: u32) -> Result<Image> {
    let Some(first) = images.first() else {
        return Err(EditError::misuse("there are no images for a mosaic"));
    };
    if columns == 0 || rows == 0 {
        return Err(EditError::misuse(format!("a mosaic of {columns} x {rows} images")));
    }
    if images.len() as u64 > u64::from(columns) * u64::from(rows) {
        let what = format!("a mosaic of {columns} x {rows} images for {}", images.len());
        return Err(EditError::misuse(what));
    }
    let images: Vec<Image> = images.iter().map(Image::associated).collect();
    let largest = |side: fn(&Image) -> u32| images.iter().map(side).max().unwrap_or(1);
    let cell = (largest(|i| i.full().width), largest(|i| i.full().height));
    let side = |n: u32, cell: u32| {
        let side = u64::from(n) * (u64::from(cell) + u64::from(pad)) - u64::from(pad);
        u32::try_from(side).map_err(|_| EditError::misuse(format!("a mosaic of {side} pixels a side")))
    };
    let (width, height) = (side(columns, cell.0)?, side(rows, cell.1)?);
    let channels = images.iter().map(|i| i.spec.nchannels()).max().unwrap_or(1);
    let pixel_type = images.iter().map(|i| i.spec.pixel_type).max().unwrap_or(first.spec.pixel_type);
    let mut parts = Vec::with_capacity(images.len());
    for (n, image) in (0_u32..).zip(&images) {
        let whole = image.crop_to_full()?.with_channels(channels).converted(pixel_type);
        let place = |i: u32, cell: u32| i64::from(i) * (i64::from(cell) + i64::from(pad));
        parts.push((whole.source, place(n % columns, cell.0), place(n / columns, cell.1)));
    }
    let shape = Shape { width, height, channels, pixel_type };
    let names = images.iter().find(|i| i.spec.nchannels() == channels).unwrap_or(first);
    let mut image = first.with_source(Arc::new(Placed { shape, parts })).placed(0, 0)?;
    image.spec.channels.clone_from(&names.spec.channels);
    image.with_full(Window { x: 0, y: 0, width, height })
}
