//! Files and viewers that receive the pixels of images.

use crate::{PixelRect, RenderError};
use granita_image::{ImageOutput, PixelType, Pixels, Placement, Quantize, Request};
use parking_lot::Mutex;

/// The viewer of an image, if there is one. A copy of the image has no viewer.
#[derive(Default)]
pub(crate) struct Shown(pub(crate) Mutex<Option<ImageWriter>>);

impl Clone for Shown {
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl std::fmt::Debug for Shown {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Shown")
    }
}

/// A file that takes its rows from the top downward, or a viewer that takes any rectangles.
pub(crate) struct ImageWriter {
    pub(super) file: Box<dyn ImageOutput>,
    pub(super) quantize: Quantize,
    /// The channels to which gain and gamma apply.
    pub(super) colors: Vec<bool>,
    pub(super) stored: PixelType,
    /// The position of the next row.
    pub(super) at: Placement,
}

impl ImageWriter {
    /// Reports to the viewer that these pixels of the image are started.
    pub(crate) fn begin(&mut self, rect: &PixelRect) {
        self.file.begin_rectangle(&self.in_file(rect));
    }

    /// Writes pixels of the image, anywhere.
    pub(crate) fn write_rectangle(&mut self, rect: &PixelRect, values: &[f32]) -> Result<(), RenderError> {
        let at = Placement { x: rect.x0, y: rect.y0, width: rect.width(), ..self.at };
        let pixels = self.stored(values, &at);
        self.file.write_rectangle(&self.in_file(rect), &pixels)?;
        Ok(())
    }

    /// Returns values of the image as the file stores them.
    fn stored(&self, values: &[f32], at: &Placement) -> Pixels {
        let Quantize { gain, gamma, .. } = self.quantize;
        let is_right = |(c, is_color): (usize, &bool)| *is_color || at.alpha == Some(c);
        if (gain, gamma) == (1.0, 1.0) || self.colors.iter().enumerate().all(is_right) {
            return self.quantize.apply(values, at, self.stored);
        }
        let exposed: Vec<f32> = values
            .iter()
            .zip(self.colors.iter().cycle())
            .map(|(v, is_color)| if *is_color { self.quantize.expose(*v) } else { *v })
            .collect();
        Quantize { gain: 1.0, gamma: 1.0, ..self.quantize }.apply(&exposed, at, self.stored)
    }

    /// Returns the requests of its viewer.
    pub(crate) fn requests(&mut self) -> Vec<Request> {
        self.file.requests()
    }

    /// Returns the coordinates of pixels of the image in the file.
    fn in_file(&self, rect: &PixelRect) -> PixelRect {
        rect.moved(-self.at.x, -self.at.y)
    }

    /// Writes the next whole rows, with interleaved channels.
    pub(crate) fn write(&mut self, values: &[f32]) -> Result<(), RenderError> {
        self.file.write_rows(&self.stored(values, &self.at))?;
        self.at.y += (values.len() / (self.at.width * self.at.nchannels).max(1)) as i32;
        Ok(())
    }

    /// Closes the file after the last row. It then appears under its name.
    pub(crate) fn close(self) -> Result<(), RenderError> {
        self.file.close()?;
        Ok(())
    }
}
