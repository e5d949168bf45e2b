//! The command `topyg`. Its code is in the library of this package, so that `gelato` can contain it.

#![forbid(unsafe_code)]

fn main() -> std::process::ExitCode {
    topyg::main(std::env::args_os().collect()).into()
}
