//! Arithmetic of images and constants.
//!
//! Images are combined pixel by pixel. The result covers the data windows of all of them. Where an image has no pixel
//! its values are 0, and so are those of channels that only others have. Integers of 8 and 16 bits are fractions of
//! their range, and results are floats.

use crate::image::Image;
use crate::pointwise::{Combine, Map};
use crate::{EditError, Result};
use granita_base::Param;
use std::sync::Arc;

/// An operation on two values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Binary {
    /// `a + b`
    Add,
    /// `a - b`
    Sub,
    /// `a * b`
    Mul,
    /// `a / b`; 0 where `b` is 0.
    Div,
    /// `|a - b|`
    AbsDiff,
    /// The lesser value.
    Min,
    /// The greater value.
    Max,
    /// `a` to the power of `b`; values of `a` below 0 count as 0 unless `b` is a whole number.
    Pow,
}

impl Binary {
    /// Returns the result of two values.
    fn of(self, a: f32, b: f32) -> f32 {
        match self {
            Self::Add => a + b,
            Self::Sub => a - b,
            Self::Mul => a * b,
            Self::Div if b == 0.0 => 0.0,
            Self::Div => a / b,
            Self::AbsDiff => (a - b).abs(),
            Self::Min => a.min(b),
            Self::Max => a.max(b),
            Self::Pow if a < 0.0 && b.fract() != 0.0 => 0.0,
            Self::Pow => libm::powf(a, b),
        }
    }
}

/// Returns images with the same windows, channels and floats, in one window that contains all.
fn aligned(images: &[&Image]) -> Result<Vec<Image>> {
    let images: Vec<Image> = images.iter().map(|image| image.associated()).collect();
    let Some(first) = images.first() else { return Err(EditError::misuse("there is no image")) };
    let channels = images.iter().map(|i| i.spec.nchannels()).max().unwrap_or(1);
    let mut data = first.data();
    let mut full = first.full();
    for image in &images[1..] {
        data = data.union(&image.data())?;
        full = full.union(&image.full())?;
    }
    images
        .iter()
        .map(|image| {
            let mut one = image.crop(&data)?.with_channels(channels).with_full(full)?;
            if image.spec.nchannels() < channels {
                // The names are those of the image that has most.
                let most = images.iter().find(|i| i.spec.nchannels() == channels).unwrap_or(image);
                one.spec.channels.clone_from(&most.spec.channels);
            }
            Ok(one)
        })
        .collect()
}

/// Returns an image of the values of several images. `change` receives the rows of all.
fn combined(
    images: &[&Image],
    change: impl Fn(&mut [f32], &[&[f32]]) + Send + Sync + 'static,
) -> Result<Image> {
    let all = aligned(images)?;
    let source = Combine::new(all.iter().map(|i| i.source.clone()).collect(), change);
    Ok(all[0].with_source(Arc::new(source)))
}

/// Returns the result of an operation on two images.
///
/// # Errors
/// [`EditError::Misuse`] when the windows are too large.
pub fn binary(operation: Binary, a: &Image, b: &Image) -> Result<Image> {
    combined(&[a, b], move |row, others| {
        for (v, w) in row.iter_mut().zip(others[0]) {
            *v = operation.of(*v, *w);
        }
    })
}

/// Returns `a * b + c` of three images.
///
/// # Errors
/// [`EditError::Misuse`] when the windows are too large.
pub fn multiply_add(a: &Image, b: &Image, c: &Image) -> Result<Image> {
    combined(&[a, b, c], |row, others| {
        for ((v, b), c) in row.iter_mut().zip(others[0]).zip(others[1]) {
            *v = *v * b + c;
        }
    })
}

/// Returns an image over another one: `a + (1 - alpha of a) * b` (T. Porter, T. Duff, Compositing Digital Images,
/// SIGGRAPH 1984). An image without alpha is opaque where it has pixels.
///
/// # Errors
/// [`EditError::Misuse`] when the windows are too large.
pub fn over(a: &Image, b: &Image) -> Result<Image> {
    let (a, b) = (a.with_alpha(), b.with_alpha());
    let (a, b) = match (a.spec.alpha_channel(), b.spec.alpha_channel()) {
        // The alphas of images with different channels are at one index.
        (Some(i), Some(j)) if i != j => {
            let names = if a.spec.nchannels() >= b.spec.nchannels() { &a.spec } else { &b.spec };
            let list = names.channels.join(",");
            (a.channels(&list)?.0, b.channels(&list)?.0)
        }
        _ => (a, b),
    };
    let n = a.spec.nchannels().max(b.spec.nchannels());
    let alpha = a.spec.alpha_channel().unwrap_or(n - 1);
    combined(&[&a, &b], move |row, others| {
        for (pixel, below) in row.chunks_exact_mut(n).zip(others[0].chunks_exact(n)) {
            let rest = 1.0 - pixel[alpha];
            pixel.iter_mut().zip(below).for_each(|(v, b)| *v += rest * b);
        }
    })
}

impl Image {
    /// Returns an image of changed values. `change` receives the index of a row and its values.
    pub(crate) fn mapped(&self, change: impl Fn(u32, &mut [f32]) + Send + Sync + 'static) -> Self {
        self.with_source(Arc::new(Map::new(&*self.source, self.source.clone(), change)))
    }

    /// Returns an image of changed values, for operations of the caller. `change` receives the values of one row, and
    /// the number of channels. It gives the same result for the same pixel.
    #[must_use]
    pub fn changed(&self, change: impl Fn(&mut [f32], usize) + Send + Sync + 'static) -> Self {
        let image = self.associated();
        let n = image.spec.nchannels();
        image.mapped(move |_, row| change(row, n))
    }

    /// Returns the result of an operation on each value and a constant: one for all channels, or one for each. Missing
    /// ones are the last.
    ///
    /// # Errors
    /// [`EditError::Misuse`] when there is no constant.
    pub fn with_constant(&self, operation: Binary, constants: &[f32]) -> Result<Self> {
        let image = self.associated();
        let constants = per_channel(constants, image.spec.nchannels())?;
        Ok(image.mapped(move |_, row| {
            for pixel in row.chunks_exact_mut(constants.len()) {
                pixel.iter_mut().zip(&constants).for_each(|(v, c)| *v = operation.of(*v, *c));
            }
        }))
    }

    /// Returns `1 - value` for the channels of a range that are not alpha. Without a range these are the first three.
    #[must_use]
    pub fn inverted(&self, range: Option<(usize, usize)>) -> Self {
        let image = self.associated();
        let n = image.spec.nchannels();
        let alpha = image.spec.alpha_channel();
        let (begin, end) = range.unwrap_or((0, 3));
        let is_given = range.is_some();
        image.mapped(move |_, row| {
            for pixel in row.chunks_exact_mut(n) {
                for (c, v) in pixel.iter_mut().enumerate().take(end).skip(begin) {
                    if is_given || Some(c) != alpha {
                        *v = 1.0 - *v;
                    }
                }
            }
        })
    }

    /// Returns the image with the differences of the first three channels from their luminance (Rec. ITU-R BT.709)
    /// times `scale`. An image with fewer channels stays as it is.
    #[must_use]
    pub fn saturated(&self, scale: f32) -> Self {
        let image = self.associated();
        let n = image.spec.nchannels();
        if n < 3 {
            return image;
        }
        image.mapped(move |_, row| {
            for pixel in row.chunks_exact_mut(n) {
                let luminance = 0.2126 * pixel[0] + 0.7152 * pixel[1] + 0.0722 * pixel[2];
                pixel[..3].iter_mut().for_each(|v| *v = luminance + scale * (*v - luminance));
            }
        })
    }

    /// Returns the magnitudes.
    #[must_use]
    pub fn abs(&self) -> Self {
        self.associated().mapped(|_, row| row.iter_mut().for_each(|v| *v = v.abs()))
    }

    /// Returns values of at least `low` and at most `high`, one for all channels or one for each. With `clamp_alpha`
    /// alpha is also limited to 0 to 1. NaN stays NaN.
    ///
    /// # Errors
    /// [`EditError::Misuse`] when a list is empty.
    pub fn clamped(&self, low: Option<&[f32]>, high: Option<&[f32]>, clamp_alpha: bool) -> Result<Self> {
        let image = self.associated();
        let n = image.spec.nchannels();
        let mut low = per_channel(low.unwrap_or(&[f32::NEG_INFINITY]), n)?;
        let mut high = per_channel(high.unwrap_or(&[f32::INFINITY]), n)?;
        if let Some(alpha) = image.spec.alpha_channel().filter(|_| clamp_alpha) {
            low[alpha] = low[alpha].max(0.0);
            high[alpha] = high[alpha].min(1.0);
        }
        Ok(image.mapped(move |_, row| {
            for pixel in row.chunks_exact_mut(n) {
                for ((v, low), high) in pixel.iter_mut().zip(&low).zip(&high) {
                    if *v < *low {
                        *v = *low;
                    }
                    if *v > *high {
                        *v = *high;
                    }
                }
            }
        }))
    }

    /// Returns colours that are multiplied by alpha. An image without alpha stays as it is.
    #[must_use]
    pub fn premultiplied(&self) -> Self {
        let Some(alpha) = self.spec.alpha_channel() else { return self.clone() };
        let n = self.spec.nchannels();
        let depth = depth_channel(self);
        self.mapped(move |_, row| {
            for pixel in row.chunks_exact_mut(n) {
                let a = pixel[alpha];
                for (c, v) in pixel.iter_mut().enumerate() {
                    if c != alpha && Some(c) != depth {
                        *v *= a;
                    }
                }
            }
        })
    }

    /// Returns colours that are divided by alpha. Where alpha is 0 or 1, and without alpha, they stay as they are.
    #[must_use]
    pub fn unpremultiplied(&self) -> Self {
        let image = self.associated();
        let Some(alpha) = image.spec.alpha_channel() else { return image };
        let n = image.spec.nchannels();
        let depth = depth_channel(&image);
        image.mapped(move |_, row| {
            for pixel in row.chunks_exact_mut(n) {
                let a = pixel[alpha];
                if a == 0.0 || a == 1.0 {
                    continue;
                }
                for (c, v) in pixel.iter_mut().enumerate() {
                    if c != alpha && Some(c) != depth {
                        *v /= a;
                    }
                }
            }
        })
    }

    /// Returns the image as computations need it: colours of files that store them apart from alpha, as PNG does, are
    /// multiplied by alpha.
    #[must_use]
    pub fn associated(&self) -> Self {
        if self.spec.attributes.int("unassociatedalpha").unwrap_or(0) == 0 {
            return self.clone();
        }
        let mut image = self.premultiplied();
        image.spec.attributes.0.retain(|param: &Param| &*param.name != "unassociatedalpha");
        image
    }

    /// Returns the image as files store it whose colours are not multiplied by alpha.
    pub(crate) fn straight(&self) -> Self {
        if self.spec.alpha_channel().is_none() {
            return self.clone();
        }
        let ty = granita_base::ParamType::of(granita_base::BaseType::Int);
        let param = Param { name: "unassociatedalpha".into(), ty, data: 1.into() };
        self.unpremultiplied().with_attribute(param)
    }

    /// Returns an image with alpha. A missing one is 1.
    fn with_alpha(&self) -> Self {
        if self.spec.alpha_channel().is_some() {
            return self.associated();
        }
        let n = self.spec.nchannels();
        let mut image = self.with_channels(n + 1).mapped(move |_, row| {
            row.chunks_exact_mut(n + 1).for_each(|pixel| pixel[n] = 1.0);
        });
        image.spec.channels[n] = "A".to_owned();
        image
    }

    /// Returns the image with a rectangle of one colour. `window` is in the coordinates of the data window.
    ///
    /// # Errors
    /// [`EditError::Misuse`] when there is no colour.
    pub fn filled(&self, window: &crate::Window, color: &[f32]) -> Result<Self> {
        let image = self.associated();
        let n = image.spec.nchannels();
        let color = per_channel(color, n)?;
        let data = image.data();
        let Some(part) = window.common(&data) else { return Ok(image) };
        let columns = (part.x - data.x) as usize * n..(part.right() - data.x) as usize * n;
        let rows = (part.y - data.y) as u32..(part.bottom() - data.y) as u32;
        Ok(image.mapped(move |y, row| {
            if rows.contains(&y) {
                row[columns.clone()].chunks_exact_mut(n).for_each(|pixel| pixel.copy_from_slice(&color));
            }
        }))
    }
}

/// Returns the index of the channel of depths, which alpha does not multiply.
fn depth_channel(image: &Image) -> Option<usize> {
    image.spec.channels.iter().position(|name| name == "Z")
}

/// Returns one constant for each of `n` channels. The last one is repeated.
fn per_channel(constants: &[f32], n: usize) -> Result<Vec<f32>> {
    let Some(last) = constants.last() else { return Err(EditError::misuse("there is no number")) };
    Ok((0..n).map(|c| *constants.get(c).unwrap_or(last)).collect())
}
