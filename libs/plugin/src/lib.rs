//! The bundled image formats and generators, and plugins.
//!
//! This is the only library that depends on format crates. All others receive a [`FormatRegistry`].
//!
//! ```
//! let formats = granita_plugin::bundled_formats(granita_image::Limits::default());
//! assert!(formats.by_name("tiff").is_some());
//! ```
//!
//! [`Plugins`] finds shared libraries on search paths (reference 12 to 14), such as `FORMAT.imageio.so` and
//! `NAME.generator.so`. They are written in C++ with the headers in `bindings/cpp/include`, or in any language with
//! `gelato_c.h`, the C interface below those. Only `cpp/shim.cpp` connects the C++ classes to its tables. [`Interface`]
//! receives the scene calls that programs and generators make.
//!
//! # Invariants
//!
//! No C++ exception and no panic crosses the language boundary. A plugin of another version is refused and never
//! called. An error of a plugin is one message with its name. Loaded libraries are never unloaded.

#![allow(unsafe_code, reason = "plugins are called through pointers; every block says why it is sound")]

mod color;
mod denoise;
mod dso;
mod errors;
mod ffi;
mod generator;
mod images;
mod interface;
mod native;
mod plugins;
mod rules;
mod shadeop;

pub use denoise::OpenImageDenoise;
pub use errors::{ErrorManager, Messages};
pub use ffi::Errors;
pub use interface::{Archiving, GeneratorObject, Interface, InterfaceHost, InterfaceObject, Meanwhile};
pub use native::NativeShaders;
pub use plugins::{Plugins, ProgramImages};
pub use rules::PluginRules;
pub use shadeop::noise;

use granita_base::{Environment, Reporter, SearchPath};
use granita_color::Engine;
use granita_image::{FormatRegistry, Limits};
use granita_scene::GeneratorRegistry;
use std::sync::Arc;

/// Returns all bundled formats. They are "tiff", "shadow", "exr" ("OpenEXR"), those of `granita-raster`, "gltf" for the
/// images in such files, and "iv", which writes to a viewer.
///
/// `limits` bound the input of their readers.
pub fn bundled_formats(limits: Limits) -> FormatRegistry {
    let mut registry = FormatRegistry::new(limits);
    registry.register(Arc::new(granita_tiff::TiffFormat));
    registry.register(Arc::new(granita_tiff::ShadowFormat));
    registry.register(Arc::new(granita_exr::ExrFormat));
    for format in granita_raster::formats() {
        registry.register(format);
    }
    registry.register_name(Arc::new(granita_raster::DevilFormat));
    // Its images are in the formats above.
    registry.register(Arc::new(granita_mesh::GltfImages::new(registry.clone())));
    registry.register(Arc::new(granita_display::IvFormat::default()));
    registry
}

/// Returns the plugins of a tool without scenes.
fn tool_plugins(environment: &Environment, reporter: &Reporter, rules: PluginRules) -> Plugins {
    let plugins = Plugins::new(reporter.clone(), rules);
    let parts = [environment.get("GELATO_IMAGEIO_PATH"), Some("$GELATOHOME/lib")];
    let path = parts.into_iter().flatten().collect::<Vec<_>>().join(":");
    plugins.set_image_path(SearchPath::parse(&path, &SearchPath::default(), environment));
    plugins
}

/// Returns the conversions of colours by the plugin `opencolorio.color.so` (`granita_color.h`), which is looked for as
/// image formats are ([`formats_with_plugins`]), when the first conversion needs it.
pub fn color_engine(environment: &Environment, rules: PluginRules) -> Arc<dyn Engine> {
    Arc::new(color::PluginEngine::new(tool_plugins(environment, &Reporter::silent(), rules)))
}

/// Returns the bundled formats, and those of plugins that `rules` permit in the folders of `$GELATO_IMAGEIO_PATH`
/// and in `$GELATOHOME/lib`. `debug` reports every file that is tried.
pub fn formats_with_plugins(
    limits: Limits,
    environment: &Environment,
    reporter: &Reporter,
    rules: PluginRules,
    debug: bool,
) -> FormatRegistry {
    let plugins = tool_plugins(environment, reporter, rules);
    plugins.set_debug(debug);
    let mut registry = bundled_formats(limits);
    registry.find_with(Arc::new(plugins));
    registry
}

/// Returns all bundled generators except "pyg", which the session itself runs, because it may start programs.
pub fn bundled_generators() -> GeneratorRegistry {
    let mut registry = GeneratorRegistry::default();
    for generator in granita_mesh::generators().into_iter().chain(granita_rib::generators()) {
        registry.add(generator);
    }
    registry
}

/// Returns the text of a panic.
pub(crate) fn panic_text(panic: &(dyn std::any::Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(|s| (*s).to_owned());
    text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "a panic".to_owned())
}

/// The examples in the manual of `granita-image`, which does not contain any format.
#[cfg(doctest)]
#[doc = include_str!("../../image/README.md")]
struct ReadmeOfImage;
