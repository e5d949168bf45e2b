//! Flips, rotations by quarters and transposition.

use crate::channels::flopped;
use crate::hold::Slabs;
use crate::image::{Image, Shape, Source, Window, same_type};
use crate::window::band;
use crate::{EditError, Result};
use granita_base::{BaseType, Param, ParamType};
use granita_image::Pixels;
use std::sync::Arc;

/// A source with its rows from the bottom, its pixels from the right, or both.
struct Turned {
    from: Arc<dyn Source>,
    flip: bool,
    flop: bool,
}

impl Source for Turned {
    fn shape(&self) -> Shape {
        self.from.shape()
    }

    fn rows(&self, y0: u32, y1: u32) -> Result<Pixels> {
        let shape = self.shape();
        let rows = match self.flip {
            true => {
                let rows = self.from.rows(shape.height - y1, shape.height - y0)?;
                let width = shape.row();
                same_type!(&rows, v => v.chunks_exact(width).rev().flatten().copied().collect())
            }
            false => self.from.rows(y0, y1)?,
        };
        Ok(if self.flop { flopped(&rows, shape.width as usize, shape.channels) } else { rows })
    }

    fn any_order(&self) -> bool {
        self.from.any_order()
    }
}

/// A source whose rows are the columns of another one. Each request reads all of it, so that requests are made through
/// [`Slabs`].
struct Transposed {
    from: Arc<dyn Source>,
}

impl Source for Transposed {
    fn shape(&self) -> Shape {
        let shape = self.from.shape();
        Shape { width: shape.height, height: shape.width, ..shape }
    }

    fn rows(&self, y0: u32, y1: u32) -> Result<Pixels> {
        let (from, own) = (self.from.shape(), self.shape());
        let mut out = Pixels::zeros(own.pixel_type, (y1 - y0) as usize * own.row());
        let step = band(&from);
        for top in (0..from.height).step_by(step as usize) {
            let end = (top + step).min(from.height);
            let rows = self.from.rows(top, end)?;
            match (&mut out, &rows) {
                (Pixels::U8(to), Pixels::U8(v)) => transpose(v, to, &from, (y0, y1), top),
                (Pixels::U16(to), Pixels::U16(v)) => transpose(v, to, &from, (y0, y1), top),
                (Pixels::U32(to), Pixels::U32(v)) => transpose(v, to, &from, (y0, y1), top),
                (Pixels::Half(to), Pixels::Half(v)) => transpose(v, to, &from, (y0, y1), top),
                (Pixels::Float(to), Pixels::Float(v)) => transpose(v, to, &from, (y0, y1), top),
                _ => return Err(EditError::misuse("a source with rows of two types")),
            }
        }
        Ok(out)
    }

    fn any_order(&self) -> bool {
        self.from.any_order()
    }
}

/// Copies columns `y0..y1` of some rows of a source, of which the first is row `top`, to the rows of the result.
fn transpose<T: Copy + Send + Sync>(rows: &[T], out: &mut [T], from: &Shape, (y0, y1): (u32, u32), top: u32) {
    use rayon::prelude::*;
    let n = from.channels;
    let width = from.height as usize * n;
    let columns = y0 as usize..y1 as usize;
    out.par_chunks_mut(width).zip(columns).for_each(|(to, x)| {
        let to = to[top as usize * n..].chunks_exact_mut(n);
        for (to, row) in to.zip(rows.chunks_exact(from.row())) {
            to.copy_from_slice(&row[x * n..][..n]);
        }
    });
}

/// One of the eight orientations of an image, which are a transposition followed by flips.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Turn {
    /// True when columns become rows, before the rest.
    pub transpose: bool,
    /// True when top and bottom are exchanged.
    pub flip: bool,
    /// True when left and right are exchanged.
    pub flop: bool,
}

impl Turn {
    const fn new(transpose: bool, flip: bool, flop: bool) -> Self {
        Self { transpose, flip, flop }
    }

    /// Top and bottom are exchanged.
    pub const FLIP: Self = Self::new(false, true, false);
    /// Left and right are exchanged.
    pub const FLOP: Self = Self::new(false, false, true);
    /// A rotation by 90 degrees clockwise.
    pub const CLOCKWISE: Self = Self::new(true, false, true);
    /// A rotation by 180 degrees.
    pub const HALF: Self = Self::new(false, true, true);
    /// A rotation by 90 degrees counter-clockwise.
    pub const COUNTERCLOCKWISE: Self = Self::new(true, true, false);
    /// Rows become columns.
    pub const TRANSPOSE: Self = Self::new(true, false, false);

    /// Returns the turn that shows an image upright whose metadata `Orientation` has this value (from 1 to 8, as in
    /// TIFF). Other values are upright.
    pub fn upright(orientation: i32) -> Self {
        match orientation {
            2 => Self::FLOP,
            3 => Self::HALF,
            4 => Self::FLIP,
            5 => Self::TRANSPOSE,
            6 => Self::CLOCKWISE,
            7 => Self::new(true, true, true),
            8 => Self::COUNTERCLOCKWISE,
            _ => Self::new(false, false, false),
        }
    }

    /// Returns a window of a display window after the turn.
    fn window(self, window: &Window, full: &Window) -> Window {
        let transposed = |w: &Window| Window { x: w.y, y: w.x, width: w.height, height: w.width };
        let (mut w, full) =
            if self.transpose { (transposed(window), transposed(full)) } else { (*window, *full) };
        if self.flop {
            w.x = full.x + full.right() - w.right();
        }
        if self.flip {
            w.y = full.y + full.bottom() - w.bottom();
        }
        w
    }
}

impl Image {
    /// Returns the image turned within its display window. Rotations by a quarter, transpositions and flips of files
    /// that are decoded from their beginning hold at most `memory_bytes` of rows; where these are less than the image,
    /// it is read several times.
    ///
    /// # Errors
    /// [`EditError::Misuse`] when a position exceeds 32 bits.
    pub fn turned(&self, turn: Turn, memory_bytes: u64) -> Result<Self> {
        let mut image = self.clone();
        if turn.transpose {
            let whole = Transposed { from: image.source.clone() };
            image = image.with_source(Arc::new(Slabs::new(Arc::new(whole), memory_bytes)));
        }
        if turn.flip || turn.flop {
            if turn.flip {
                image = image.in_any_order(memory_bytes);
            }
            let turned = Turned { from: image.source.clone(), flip: turn.flip, flop: turn.flop };
            image = image.with_source(Arc::new(turned));
        }
        let (data, full) = (self.data(), self.full());
        let data = turn.window(&data, &full);
        let full = turn.window(&full, &full);
        image.placed(data.x, data.y)?.with_full(full)
    }

    /// Returns the value of the metadata `Orientation`, from 1 to 8; 1 without it.
    pub fn orientation(&self) -> i32 {
        self.spec.attributes.int("Orientation").unwrap_or(1)
    }

    /// Returns the image with another value of the metadata `Orientation`.
    ///
    /// # Errors
    /// [`EditError::Misuse`] for values other than 1 to 8.
    pub fn with_orientation(&self, value: i32) -> Result<Self> {
        if !(1..=8).contains(&value) {
            return Err(EditError::misuse(format!("the orientation {value}, 1 to 8 are possible")));
        }
        let mut image = self.clone();
        let ty = ParamType::of(BaseType::Int);
        image.spec.attributes.set(Param { name: "Orientation".into(), ty, data: value.into() });
        Ok(image)
    }

    /// Returns the image turned as its metadata `Orientation` requests, which becomes 1.
    ///
    /// # Errors
    /// The errors of [`Image::turned`].
    pub fn upright(&self, memory_bytes: u64) -> Result<Self> {
        match self.orientation() {
            1 => Ok(self.clone()),
            value => self.turned(Turn::upright(value), memory_bytes)?.with_orientation(1),
        }
    }

    /// Returns the image shifted by (x, y) pixels within its data window. Pixels that leave it at one side enter at the
    /// other.
    ///
    /// # Errors
    /// [`EditError::Misuse`] when a position exceeds 32 bits.
    pub fn shifted(&self, (x, y): (i64, i64)) -> Result<Self> {
        let shape = self.source.shape();
        let (w, h) = (i64::from(shape.width), i64::from(shape.height));
        let (x, y) = (x.rem_euclid(w), y.rem_euclid(h));
        let places = [(x, y), (x - w, y), (x, y - h), (x - w, y - h)];
        let parts = places.map(|(x, y)| (self.source.clone(), x, y)).into();
        Ok(self.with_source(Arc::new(crate::window::Placed { shape, parts })))
    }
}
