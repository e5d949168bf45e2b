//! The command `iv`. Its code is in the library of this package.

#![forbid(unsafe_code)]

fn main() -> std::process::ExitCode {
    iv::main(std::env::args_os().collect()).into()
}
