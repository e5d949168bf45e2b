//! The viewer's model: what a picture holds, how it is shown, what its values are, how two differ.
//!
//! No window, no socket and no format is known here: files are opened through the registry that the caller
//! brings, and what a display shows are plain bytes that the caller puts on a screen, in a terminal or in a file.
//!
//! A [`Picture`] is an open file: pages with layers of channels. Each page has a [`Pyramid`] of levels, those of the file
//! and further ones that are made, cut into tiles that are read when they are asked for and kept in a [`TileStore`] of
//! bounded size. A [`Sheet`] lays a page out (as it is stored, as a cross, one face), a [`View`] says which part of it is
//! on screen, a [`Display`] how values become colours, and [`draw`] makes the bytes.
//!
//! Invariants:
//! - what is drawn from complete tiles depends on files, view and display alone, to the bit, for any number of threads;
//! - values are never changed on their way to statistics and read-outs: what is not a number stays so;
//! - a file that is damaged or unfinished shows what is there.

#![forbid(unsafe_code)]

mod album;
mod compare;
mod display;
mod draw;
mod drawing;
mod error;
mod flip;
mod grid;
mod layers;
mod live;
mod live_page;
mod loader;
mod maps;
mod picture;
mod pyramid;
mod sheet;
mod sketch;
mod source;
mod statistics;
mod still;
mod store;
mod tile;
mod view;

pub use album::{Group, expand, groups, in_order};
pub use compare::{ChannelDifference, CompareOptions, Comparison, compare, flip_page};
pub use display::{BESIDE, Background, Channels, Display, FalseColor, Marks, Prepared, Tables, luminance};
pub use draw::{Canvas, Mix, Shown, draw, draw_into};
pub use drawing::paint;
pub use error::{Result, ViewError};
pub use flip::PIXELS_PER_DEGREE;
pub use grid::{Needs, needs, pixel_under};
pub use layers::{Layer, Meaning};
pub use live::{Live, LiveInfo, LiveLimits, RequestSender};
pub use live_page::LivePage;
pub use loader::Loader;
pub use maps::ColorMap;
pub use picture::{Page, Picture, Stamp};
pub use pyramid::{Level, Pyramid};
pub use sheet::{Arrangement, Patch, Sheet};
pub use sketch::Sketch;
pub use source::{Access, Source};
pub use statistics::{Histogram, Statistics, depth_range, statistics, value_range};
pub use still::{ascii, save_canvas, save_pixels, suited, thumbnail};
pub use store::{StoreLimits, TileKey, TileStore};
pub use tile::{Pick, Reduce, TILE, Tile};
pub use view::{Around, View};
