//! The command `gslc`; all of it is in this package's library, so that `gelato` can carry it along.

#![forbid(unsafe_code)]

fn main() -> std::process::ExitCode {
    gslc::main(std::env::args_os().collect()).into()
}
