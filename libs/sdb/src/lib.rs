//! Spatial databases, whose records are found by their positions (reference 4.3.9, 5.8.13).
//!
//! A shader saves numbers at a place, which is (s, t) on a surface, a point, or a point and a normal. Later frames
//! query the values near a place, or the density of records there. Photon maps, baked light and occlusion caches are
//! such databases.
//!
//! - [`Packed`] is a set of records that can be searched: [`Packed::between`] for values, [`Packed::density`] for
//!   densities. The numbers are the same in memory and in a file. Files are mapped and not copied.
//! - [`Databases`] are all databases of a session by name, with their file modes.
//! - [`Clusters`] combine distant records.
//! - [`image`] turns a database over surfaces into rows of pixels.
//!
//! Invariants:
//! - a query sees only records from before the frame, so that threads and buckets do not affect it;
//! - the order of records, in memory and in files, follows from the records alone;
//! - files appear complete or not at all, and files that are altered, truncated or not databases are refused by name;
//! - while a frame runs, records that will be written use a limited amount of memory.
//!
//! Units and spaces (the caller's), records of more than a key and a value, and removal of records are deliberately
//! absent.
//!
//! ```
//! use granita_sdb::{Between, Key, Packed, Probe, Schema, Value};
//! let schema = Schema { key: Key::Point, value: Value::Float };
//! // Two records: x, y, z, value.
//! let packed = Packed::new(schema, &[0.0, 0.0, 0.0, 10.0, 1.0, 0.0, 0.0, 20.0]);
//! let how = Between { minsamples: 2, maxdist: 1.0, maxerror: 0.25, always: false };
//! let value = packed.between(&Probe { p: [0.5, 0.0, 0.0], n: None }, &how);
//! assert_eq!(value.map(|v| v[0]), Some(15.0));
//! ```

#![forbid(unsafe_code)]

mod clusters;
mod databases;
mod error;
mod file;
mod image;
mod order;
mod packed;
mod query;
mod schema;

pub use clusters::{Cluster, Clusters, Lanes};
pub use databases::{Attributes, Databases, Finished, Mode};
pub use error::{Result, SdbError};
pub use file::{read, with_checksums};
pub use image::{ImageOptions, image};
pub use order::along_curve;
pub use packed::Packed;
pub use query::{Between, Density, Probe};
pub use schema::{Key, Schema, Value};
