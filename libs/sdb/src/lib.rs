//! Spatial databases: records that are found by where they lie (reference 4.3.9, 5.8.13).
//!
//! A shader saves numbers under a place, which is (s, t) on a surface, a point, or a point and a normal; later frames ask
//! what stands near a place, or how dense it stands there. Photon maps, baked light and caches of occlusion are such
//! databases.
//!
//! - [`Packed`] is a set of records that can be searched: [`Packed::between`] for values, [`Packed::density`] for densities.
//!   In memory or in a file, the numbers are the same; files are mapped and not copied.
//! - [`Databases`] are all databases of a session by name, with their file modes.
//! - [`Clusters`] take far records together.
//! - [`picture`] turns a database over surfaces into rows of pixels.
//!
//! Invariants:
//! - what a query sees was there before the frame, so that threads and buckets change nothing;
//! - the order of records, in memory and in files, follows from the records alone;
//! - files appear whole or not at all, and what was altered, cut off or is no database is refused by name;
//! - while a frame runs, what is to be written takes bounded memory.
//!
//! Deliberately absent: units and spaces (the caller's), records of more than a key and a value, removal of records.
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

#![deny(unsafe_code)]

mod clusters;
mod databases;
mod error;
mod file;
mod map;
mod order;
mod packed;
mod picture;
mod query;
mod schema;

pub use clusters::{Cluster, Clusters};
pub use databases::{Attributes, Databases, Finished, Mode};
pub use error::{Result, SdbError};
pub use file::{read, with_checksums};
pub use packed::Packed;
pub use picture::{PictureOptions, picture};
pub use query::{Between, Density, Probe};
pub use schema::{Key, Schema, Value};
