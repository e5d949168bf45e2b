//! Connects the parts of a renderer, as one entry point for the tools and the bindings.
//!
//! A [`Session`] connects the graphics state machine (`scene::State`), the scene reader (`pyg`), the renderer, and
//! the bundled image formats, shaders and inputs. All data of the process (variables, folders, threads) is passed
//! in [`SessionOptions`]. This crate does not read the environment, print or exit. Two sessions in one process
//! share nothing.
//!
//! Search order:
//! - shaders: `name.gso`, then `name.gsl`, in the folders of "path:shader"; then the bundled ones
//! - scene files: as named, then in the folders of "path:input"; then the bundled ones
//! - generators: see [`granita_inputs`]
//! - image formats: those of [`granita_inputs::RunOptions::plugins`]; the bundled ones; then plugins in the absolute
//!   folders of
//!   "path:imageio"
//! - textures: in the folders of "path:texture"
//!
//! The default paths name `$GELATOHOME`, so that an installation's own files have precedence over the bundled ones.
//!
//! This crate does not write scenes.
//!
//! ```no_run
//! use granita_base::Reporter;
//! use granita_session::{Session, SessionOptions};
//! let mut session = Session::new(SessionOptions::default(), Reporter::silent(), Default::default());
//! session.read_file("scene.pyg").unwrap();
//! assert!(session.finish().rendered);
//! ```

#![forbid(unsafe_code)]

mod archive;
mod assets;
mod commands;
mod connection;
mod denoisers;
mod desk;
mod error;
mod forwarded;
mod look;
mod looking;
mod net;
mod options;
mod outputs;
mod passes;
mod patches;
mod patient;
mod programs;
mod records;
mod remote;
mod renderer;
mod running;
mod safe;
mod secret;
mod session;
mod shaders;

pub use archive::archive_calls;
pub use assets::{AssetKind, Assets, is_up_to_date};
pub use connection::Connection;
pub use desk::{Desk, DeskOptions};
pub use error::SessionError;
pub use granita_scene::attribute_from_text;
pub use looking::{LookOptions, Up};
pub use net::{Joined, NEXT as NET_NEXT, PORT as NET_PORT, join};
pub use options::{ExtraOutput, FindViewer, SessionOptions, Viewer};
pub use passes::PassOptions;
pub use records::FrameRecord;
pub use remote::{Remote, RemoteEnds, Told};
pub use secret::{NetSecret, Secret};
pub use session::{Outcome, Session, SharedProgress};
