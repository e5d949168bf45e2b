//! The command `gsoinfo`. Its code is in the library of this package, so that `gelato` can contain it.

#![forbid(unsafe_code)]

fn main() -> std::process::ExitCode {
    gsoinfo::main(std::env::args_os().collect()).into()
}
