//! Images whose rows are computed when they are needed.

use crate::{EditError, Result};
use granita_image::{ImageSpec, PixelType, Pixels};
use std::sync::Arc;

/// The size and the type of the pixels of a source.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Shape {
    /// The width in pixels.
    pub width: u32,
    /// The height in pixels.
    pub height: u32,
    /// The number of channels.
    pub channels: usize,
    /// The type of the values.
    pub pixel_type: PixelType,
}

impl Shape {
    /// The number of values of one row.
    pub fn row(&self) -> usize {
        self.width as usize * self.channels
    }

    /// The number of bytes of one row.
    pub fn row_bytes(&self) -> u64 {
        self.row() as u64 * self.pixel_type.bytes() as u64
    }
}

/// Pixels that are read or computed on demand.
///
/// Rows are the same, to the bit, in any order of requests and for any number of threads. Requests of increasing rows
/// are the fastest. A source uses the threads of the caller's pool. It is not called from several threads of one pool
/// at once.
pub trait Source: Send + Sync {
    /// Returns the size and the type.
    fn shape(&self) -> Shape;

    /// Returns rows `y0..y1` from the top, pixels from the left, channels interleaved. The rows exist.
    ///
    /// # Errors
    /// The error of reading a file.
    fn rows(&self, y0: u32, y1: u32) -> Result<Pixels>;

    /// True when earlier rows cost as much as later ones. False for files that are decoded from their beginning.
    fn any_order(&self) -> bool {
        true
    }
}

/// A rectangle of pixels, with any position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Window {
    /// The left edge.
    pub x: i64,
    /// The upper edge.
    pub y: i64,
    /// The width in pixels.
    pub width: u32,
    /// The height in pixels.
    pub height: u32,
}

impl Window {
    /// Returns the first column to the right of the window.
    pub fn right(&self) -> i64 {
        self.x + i64::from(self.width)
    }

    /// Returns the first row below the window.
    pub fn bottom(&self) -> i64 {
        self.y + i64::from(self.height)
    }

    /// Returns the smallest window that contains both.
    ///
    /// # Errors
    /// [`EditError::Misuse`] when a side exceeds 32 bits.
    pub fn union(&self, other: &Self) -> Result<Self> {
        let (x, y) = (self.x.min(other.x), self.y.min(other.y));
        let side = |low: i64, high: i64| {
            u32::try_from(high - low).map_err(|_| EditError::misuse(format!("{} pixels a side", high - low)))
        };
        Ok(Self {
            x,
            y,
            width: side(x, self.right().max(other.right()))?,
            height: side(y, self.bottom().max(other.bottom()))?,
        })
    }

    /// Returns the common part of both; `None` when there is none.
    pub fn common(&self, other: &Self) -> Option<Self> {
        let (x, y) = (self.x.max(other.x), self.y.max(other.y));
        let side = |low: i64, high: i64| u32::try_from(high - low).ok().filter(|n| *n > 0);
        Some(Self {
            x,
            y,
            width: side(x, self.right().min(other.right()))?,
            height: side(y, self.bottom().min(other.bottom()))?,
        })
    }
}

/// An image: its description, and a source of its pixels. Copies share the source.
#[derive(Clone)]
pub struct Image {
    /// The windows, the channels and the metadata. Width, height, number of channels and type are those of the source.
    pub(crate) spec: ImageSpec,
    /// The type that a file gets unless another one is requested: that of the file from which the image came.
    pub(crate) stored: PixelType,
    /// The format of the file from which the image came; empty for others.
    pub(crate) format: &'static str,
    /// True when the pixels are those of a file, or already in memory.
    pub(crate) ready: bool,
    pub(crate) source: Arc<dyn Source>,
}

impl std::fmt::Debug for Image {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Image")
            .field("spec", &self.spec)
            .field("stored", &self.stored)
            .finish_non_exhaustive()
    }
}

impl Image {
    /// Returns an image of a description. Its size, number of channels and type become those of the source.
    pub fn new(spec: ImageSpec, source: Arc<dyn Source>) -> Self {
        let stored = source.shape().pixel_type;
        Self { spec, stored, format: "", ready: false, source: source.clone() }.with_source(source)
    }

    /// Returns the description.
    pub fn spec(&self) -> &ImageSpec {
        &self.spec
    }

    /// Returns the type that a file gets unless another one is requested.
    pub fn stored(&self) -> PixelType {
        self.stored
    }

    /// Returns the source of the pixels.
    pub fn source(&self) -> &Arc<dyn Source> {
        &self.source
    }

    /// Returns the data window.
    pub fn data(&self) -> Window {
        let s = &self.spec;
        Window { x: s.x.into(), y: s.y.into(), width: s.width, height: s.height }
    }

    /// Returns the display window.
    pub fn full(&self) -> Window {
        let s = &self.spec;
        Window { x: s.full_x.into(), y: s.full_y.into(), width: s.full_width, height: s.full_height }
    }

    /// Returns an image with the same description and other pixels. Names of channels are added or dropped to match
    /// their number.
    pub(crate) fn with_source(&self, source: Arc<dyn Source>) -> Self {
        let shape = source.shape();
        let mut spec = self.spec.clone();
        (spec.width, spec.height, spec.pixel_type) = (shape.width, shape.height, shape.pixel_type);
        spec.channels.truncate(shape.channels);
        for c in spec.channels.len()..shape.channels {
            spec.channels.push(format!("channel{c}"));
        }
        Self { spec, source, ready: false, ..self.clone() }
    }

    /// Returns the image with the data window at another place.
    ///
    /// # Errors
    /// [`EditError::Misuse`] when the position exceeds 32 bits.
    pub(crate) fn placed(mut self, x: i64, y: i64) -> Result<Self> {
        (self.spec.x, self.spec.y) = (coordinate(x)?, coordinate(y)?);
        Ok(self)
    }

    /// Returns the image with another display window.
    ///
    /// # Errors
    /// [`EditError::Misuse`] when the position exceeds 32 bits, or a side is 0.
    pub fn with_full(mut self, full: Window) -> Result<Self> {
        if full.width == 0 || full.height == 0 {
            let what = format!("a display window of {} x {} pixels", full.width, full.height);
            return Err(EditError::misuse(what));
        }
        (self.spec.full_x, self.spec.full_y) = (coordinate(full.x)?, coordinate(full.y)?);
        (self.spec.full_width, self.spec.full_height) = (full.width, full.height);
        Ok(self)
    }
}

/// Returns a coordinate in 32 bits.
fn coordinate(v: i64) -> Result<i32> {
    i32::try_from(v).map_err(|_| EditError::misuse(format!("the position {v} exceeds 32 bits")))
}

/// Applies a function to the values of any type. The result has the same type.
macro_rules! same_type {
    ($pixels:expr, $v:ident => $body:expr) => {
        match $pixels {
            granita_image::Pixels::U8($v) => granita_image::Pixels::U8($body),
            granita_image::Pixels::U16($v) => granita_image::Pixels::U16($body),
            granita_image::Pixels::U32($v) => granita_image::Pixels::U32($body),
            granita_image::Pixels::Half($v) => granita_image::Pixels::Half($body),
            granita_image::Pixels::Float($v) => granita_image::Pixels::Float($body),
        }
    };
}
pub(crate) use same_type;

/// Returns rows of a source as floats. Integers of 8 and 16 bits are fractions of their range.
///
/// # Errors
/// The errors of [`Source::rows`].
pub fn float_rows(source: &dyn Source, y0: u32, y1: u32) -> Result<Vec<f32>> {
    Ok(match source.rows(y0, y1)? {
        Pixels::Float(v) => v,
        other => to_floats(&other),
    })
}

/// Converts values in threads.
fn to_floats(pixels: &Pixels) -> Vec<f32> {
    use rayon::prelude::*;
    const PART: usize = 1 << 16;
    let mut out = vec![0.0; pixels.len()];
    out.par_chunks_mut(PART).enumerate().for_each_init(Vec::new, |room, (i, to)| {
        to.copy_from_slice(pixels.floats_of(i * PART..i * PART + to.len(), room));
    });
    out
}
