//! The command `topyg`; all of it is in this package's library, so that `gelato` can carry it along.

#![forbid(unsafe_code)]

fn main() -> std::process::ExitCode {
    topyg::main(std::env::args_os().collect()).into()
}
