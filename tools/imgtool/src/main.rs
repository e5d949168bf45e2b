//! The command `imgtool`. Its code is in the library of this package, so that `granita` can contain it.

#![forbid(unsafe_code)]

fn main() -> std::process::ExitCode {
    imgtool::main(std::env::args_os().collect()).into()
}
