//! The options.

use clap::Parser;
use std::path::PathBuf;

/// Shows pictures of every format of the suite.
#[derive(Parser, Debug)]
#[command(name = "iv")]
pub(crate) struct Args {
    /// Pictures; of a folder all that are in it
    #[arg(value_name = "FILE")]
    pub(crate) files: Vec<PathBuf>,

    /// Say what is in the files, without a window
    #[arg(long)]
    pub(crate) info: bool,
}
