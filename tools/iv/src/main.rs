//! The command `iv`; all of it is in this package's library.

#![forbid(unsafe_code)]

fn main() -> std::process::ExitCode {
    iv::main(std::env::args_os().collect()).into()
}
