//! The viewer's model, which covers the content of an image, its display, its values, and the difference of two.
//!
//! This crate has no windows, sockets or formats. Files are opened through the registry of the caller, and a
//! display is an array of bytes that the caller shows on a screen or in a terminal, or writes to a file.
//!
//! A [`Image`] is an open file. It has pages with layers of channels. Each page has a [`Pyramid`] of levels, which
//! are those of the file and computed ones. They are divided into tiles, which are read on request and kept in a
//! [`TileStore`] of bounded size. A [`Sheet`] is the layout of a page (as stored, as a cross, one face), a [`View`] is
//! the part of it on screen, a [`Display`] converts values to colours, and [`draw`] makes the bytes.
//!
//! # Invariants
//!
//! - The drawing of complete tiles depends on files, view and display only, to the bit, for any number of threads.
//! - Statistics and read-outs use unchanged values. NaN stays NaN.
//! - The readable part of a damaged or unfinished file is shown.

#![forbid(unsafe_code)]

mod album;
mod colors;
mod compare;
mod display;
mod draw;
mod drawing;
mod error;
mod flip;
mod grid;
mod image;
mod layers;
mod live;
mod live_page;
mod loader;
mod maps;
mod plane;
mod pyramid;
pub mod screen_table;
mod sheet;
mod sketch;
mod source;
mod statistics;
mod still;
mod store;
mod tile;
mod view;

pub use album::{Group, expand, groups, in_order};
pub use colors::{Colors, InputColors, Viewing};
pub use compare::{ChannelDifference, CompareOptions, Comparison, compare, difference_page, flip_page};
pub use display::{BESIDE, Background, Channels, Display, FalseColor, Marks, Prepared, Tables, luminance};
pub use draw::{Canvas, Mix, Shown, draw, draw_into};
pub use drawing::paint;
pub use error::{Result, ViewError};
pub use flip::PIXELS_PER_DEGREE;
pub use grid::{Needs, needs, pixel_under};
pub use image::{Image, Page, Stamp};
pub use layers::{Layer, Meaning};
pub use live::{EditSender, Live, LiveInfo, LiveLimits, Panel, RequestSender};
pub use live_page::LivePage;
pub use loader::Loader;
pub use maps::ColorMap;
pub use pyramid::{Level, Pyramid};
pub use screen_table::ScreenTable;
pub use sheet::{Arrangement, Patch, Sheet};
pub use sketch::Sketch;
pub use source::{Access, Source};
pub use statistics::{Histogram, Statistics, depth_range, statistics, value_range};
pub use still::{ascii, save_canvas, save_pixels, suited, thumbnail};
pub use store::{StoreLimits, TileKey, TileStore};
pub use tile::{Pick, Reduce, TILE, Tile};
pub use view::{Around, View};
