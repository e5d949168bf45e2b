//! Textures: a tile cache with filtered lookups, and a maker of texture files (reference 9, 5.8.10).
//!
//! A renderer makes one [`TextureCache`] per frame, and any number of threads use it. [`TextureCache::texture`] looks
//! up images, [`TextureCache::environment`] environment maps, and [`TextureCache::shadow`] depth maps of lights.
//! `maketx` calls [`make::make`], which converts images of any format to tiled, MIP-mapped files. `libgranita_texture`
//! and the Python module `granita.texture` pass the lookups of other programs to a cache.
//!
//! | type | is |
//! |---|---|
//! | [`TextureCache`], [`CacheOptions`] | the files, the tiles and the bound of their memory |
//! | [`TextureReader`] | the access of one thread, which keeps the tiles that it used last |
//! | [`Lookup`], [`Lookup3d`], [`EnvLookup`], [`ShadowLookup`] | the parameters of one point |
//! | [`TextureId`], [`TextureHandle`] | a texture of a cache |
//! | [`TextureInfo`], [`TextureKind`], [`CacheStatistics`] | data about a texture, and counts |
//! | [`make::MakeOptions`] | the options of `maketx` |
//!
//! # Invariants
//!
//! - A result depends on the file and the query only, to the bit. It does not depend on memory, open files, threads or
//!   earlier queries.
//! - Only tiles that a lookup touches are read, and the memory of the cache stays within its bound.
//! - A constant image is exactly constant everywhere. Without a footprint a texel's centre gives the texel. NaN at any
//!   place has a defined result.
//! - Rows run downward, (0, 0) is the outer corner of the first texel, and texel centres are at half numbers.
//!
//! Each module describes its filters: `gaussian` (images: all texels under an ellipse of up to 64 : 1), `footprint`
//! (ellipses and probes), `solid` (environment maps: all texels under an ellipse on the sphere), `environment`
//! (footprints below a texel there), `shadow` (percentage-closer filtering), `volume` (opacity against depth). Threads
//! with many lookups use a [`TextureReader`].
//!
//! Shadow maps that are rendered on demand (reference 10.1.5) are declared, and a [`TileMaker`] makes their tiles.
//! Volume textures ([`TextureCache::texture3d`]) are files with several images (`slices`). Sets of textures that
//! continue each other are looked up under one name ([`UdimName`]).
//!
//! Colour profiles are deliberately absent. So are names of geometry sets, which the renderer resolves before a lookup.
//!
//! ```
//! use granita_base::{Environment, Reporter, SearchPath};
//! use granita_image::{CreateOptions, ImageSpec, Limits, PixelType, Pixels};
//! use granita_texture::make::{MakeOptions, make};
//! use granita_texture::{CacheOptions, Lookup, TextureCache, Wrap};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let folder = tempfile::tempdir()?;
//! let formats = granita_plugin::bundled_formats(Limits::default());
//! // An image of 2 x 1 pixels, made into a texture that repeats ...
//! let (image, texture) = (folder.path().join("a.tif"), folder.path().join("a.tx"));
//! let spec = ImageSpec::new(2, 1, 1, PixelType::Float);
//! let mut file = formats.create(&image, "tiff", &CreateOptions::new(&spec, 1))?;
//! file.write_rows(&Pixels::Float(vec![1.0, 3.0]))?;
//! file.close()?;
//! let options = MakeOptions { swrap: Wrap::Periodic, twrap: Wrap::Periodic, ..MakeOptions::default() };
//! make(&[image], &texture, &options, &formats, &|_, _| ())?;
//! // ... looked up at the centre of its second texel, and of the first one's next copy.
//! let path = SearchPath::parse(&folder.path().to_string_lossy(), &SearchPath::default(), &Environment::empty());
//! let cache = TextureCache::new(formats, path, CacheOptions::default(), Reporter::silent());
//! let id = cache.find("a.tx").ok_or("no such texture")?;
//! let mut value = [0.0];
//! cache.texture(id, &Lookup { s: 0.75, t: 0.5, ..Lookup::default() }, &mut value);
//! assert_eq!(value, [3.0]);
//! cache.texture(id, &Lookup { s: 1.25, t: 0.5, ..Lookup::default() }, &mut value);
//! assert_eq!(value, [1.0]);
//! # Ok(())
//! # }
//! ```

#![forbid(unsafe_code)]
#![warn(unnameable_types)]

/// The example in the README is compiled and run with the tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

/// The example in the manual is compiled and run with the tests.
#[cfg(doctest)]
#[doc = include_str!("../../../docs/texture-api.md")]
struct Manual;

mod block;
mod cache;
mod cube;
mod environment;
mod error;
mod ewa;
mod file;
mod files;
mod footprint;
mod gaussian;
mod id;
mod image;
mod inspect;
mod kind;
mod level;
mod lookup;
mod made;
pub mod make;
mod opacity;
mod options;
mod plain;
mod pyramid;
mod reader;
mod renewal;
mod sampler;
mod set_lookup;
mod shadow;
mod shared;
mod simd;
mod slices;
mod solid;
mod squares;
mod stage;
mod statistics;
mod tile_cache;
mod tiles;
mod udim;
mod volume;
mod wrap;

pub use cache::{TextureCache, Use};
pub use cube::{CubeLayout, CubePoint, FACE_NAMES, Face};
pub use error::{Result, TextureError};
pub use id::{TextureHandle, TextureId};
pub use inspect::TextureInfo;
pub use kind::TextureKind;
pub use lookup::{EnvLookup, Lookup, Lookup3d, ShadowLookup, Up};
pub use made::{MadeShadow, TileMaker};
pub use options::CacheOptions;
pub use reader::TextureReader;
pub use statistics::CacheStatistics;
pub use udim::{Square, UdimName};
pub use volume::VolumePixel;
pub use wrap::Wrap;
