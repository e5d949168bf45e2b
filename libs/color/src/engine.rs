//! Conversions by another library, for transforms that this crate does not have.

use std::sync::Arc;

/// A conversion of a configuration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Conversion<'a> {
    /// From one colour space to another.
    Spaces {
        /// The source space.
        from: &'a str,
        /// The target space.
        to: &'a str,
    },
    /// From a colour space to a view of a display.
    View {
        /// The source space.
        from: &'a str,
        /// The display.
        display: &'a str,
        /// The view.
        view: &'a str,
    },
    /// From one colour space to another, through looks.
    Looks {
        /// The source space.
        from: &'a str,
        /// The target space.
        to: &'a str,
        /// The looks, such as `grade, -neutral`.
        looks: &'a str,
    },
    /// Through the transform of a file.
    File {
        /// The file, found on the search path of the configuration.
        path: &'a str,
        /// True for the inverse.
        inverse: bool,
    },
}

/// A library that reads configurations by itself. A configuration asks it for conversions with transforms that this
/// crate does not have ([`crate::Config::with_engine`]).
pub trait Engine: Send + Sync + std::fmt::Debug {
    /// Returns a conversion of a configuration, which is the name of a file.
    ///
    /// # Errors
    /// The message of the library.
    fn conversion(&self, config: &str, conversion: &Conversion<'_>) -> Result<Arc<dyn Converter>, String>;
}

/// A conversion of another library. It is used by several threads at once.
pub trait Converter: Send + Sync + std::fmt::Debug {
    /// Converts pixels of three channels, red, green and blue, in place.
    fn apply(&self, rgb: &mut [f32]);
}
