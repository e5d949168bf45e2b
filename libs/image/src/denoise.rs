//! What a library that removes noise gets and gives.

/// An image with noise, and what is known of its surfaces. All rows are of the same width, from the top downward, and
/// each pixel has three values.
#[derive(Clone, Copy, Debug)]
pub struct NoisyImage<'a> {
    /// The number of pixels per row, at least 1.
    pub width: usize,
    /// The number of rows, at least 1.
    pub height: usize,
    /// Linear colours, without a limit above.
    pub color: &'a [f32],
    /// The colours of surfaces without light, from 0 to 1. It has the same pixels as `color`.
    pub albedo: &'a [f32],
    /// The normals of surfaces, from -1 to 1, in any space that is the same for all pixels; 0 where nothing is.
    pub normal: &'a [f32],
    /// True when albedo and normals have noise as well, of motion blur or of depth of field.
    pub has_noisy_features: bool,
    /// The number of threads to compute with, at least 1.
    pub threads: usize,
}

/// Removes the noise of rendered images.
pub trait Denoiser: Send + Sync {
    /// Returns the name and the version, for people.
    fn name(&self) -> &str;

    /// Returns the colours of an image without its noise.
    ///
    /// # Errors
    /// Returns the message of the library.
    fn denoise(&self, image: &NoisyImage<'_>) -> Result<Vec<f32>, String>;
}
