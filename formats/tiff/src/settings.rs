//! How an image is stored: compression, planes and strips.

use crate::codec::Compression;
use granita_image::{DeflateLevel, ImageError, ImageSpec, Result};
use std::path::Path;

/// How an image is stored.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Settings {
    pub(crate) compression: Compression,
    /// The level of deflate.
    pub(crate) level: DeflateLevel,
    pub(crate) separate: bool,
    pub(crate) rows_per_strip: u32,
}

impl Settings {
    /// Returns the settings of an image. What it does not set is that of the level before it.
    ///
    /// # Errors
    /// Returns an error for words that name no compression or order of planes.
    pub(crate) fn of(path: &Path, spec: &ImageSpec, inherited: Option<Self>) -> Result<Self> {
        let unsupported = |what: String| ImageError::Unsupported { path: path.to_owned(), what };
        let (compression, level) = match spec.string("compression") {
            Some(word) => Compression::from_word(word).map_err(unsupported)?,
            None => inherited
                .map_or((Compression::Deflate, DeflateLevel::default()), |s| (s.compression, s.level)),
        };
        let separate = match spec.string("planarconfig") {
            Some("separate") => true,
            Some("contig") => false,
            Some(word) => return Err(unsupported(format!("\"{word}\" is not a planar configuration"))),
            None => inherited.is_some_and(|s| s.separate),
        };
        let rows = spec.attributes.int("rowsperstrip").filter(|n| *n > 0);
        let rows = rows.map_or(inherited.map_or(32, |s| s.rows_per_strip), |n| n as u32);
        Ok(Self { compression, level, separate: separate && spec.nchannels() > 1, rows_per_strip: rows })
    }
}
