//! The image formats and the generators that come with the suite, in one registry each.
//!
//! This is the only library that names format crates; everything else receives a [`FormatRegistry`].
//!
//! ```
//! let formats = granita_plugin::bundled_formats(granita_image::Limits::default());
//! assert!(formats.by_name("tiff").is_some());
//! ```
//!
//! Deliberately absent so far: plugins loaded from shared libraries (reference 13).

use granita_image::{FormatRegistry, Limits};
use granita_scene::GeneratorRegistry;
use std::sync::Arc;

/// All bundled formats: "tiff", "shadow", "exr" ("OpenEXR") and those of `granita-raster`; "gltf" for the
/// pictures in such files; "iv", which writes to a viewer.
///
/// `limits` bound what their readers take in.
pub fn bundled_formats(limits: Limits) -> FormatRegistry {
    let mut registry = FormatRegistry::new(limits);
    registry.register(Arc::new(granita_tiff::TiffFormat));
    registry.register(Arc::new(granita_tiff::ShadowFormat));
    registry.register(Arc::new(granita_exr::ExrFormat));
    for format in granita_raster::formats() {
        registry.register(format);
    }
    // Its pictures are in the formats above.
    registry.register(Arc::new(granita_mesh::GltfPictures::new(registry.clone())));
    registry.register(Arc::new(granita_display::IvFormat::default()));
    registry
}

/// All bundled generators but "pyg", which the session itself runs: it may start programs.
pub fn bundled_generators() -> GeneratorRegistry {
    let mut registry = GeneratorRegistry::default();
    for generator in granita_mesh::generators().into_iter().chain(granita_rib::generators()) {
        registry.add(generator);
    }
    registry
}

/// The examples in the manual of `granita-image`, which does not know a format itself.
#[cfg(doctest)]
#[doc = include_str!("../../image/README.md")]
struct ReadmeOfImage;
