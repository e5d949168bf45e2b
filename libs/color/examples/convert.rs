//! Converts colours from standard input, for comparisons with other programs:
//! `cargo run -p granita-color --example convert -- CONFIG`, where CONFIG is a file or `ocio://default`.
//!
//! A line of input has a colour space, a tab, another colour space or `DISPLAY|VIEW`, a tab, and numbers, three for
//! each colour. A line of output has the converted numbers, or `error` and a message.

use granita_base::Environment;
use granita_color::{ColorError, Config};
use std::io::{BufRead, Write};
use std::process::ExitCode;

fn line(config: &Config, line: &str) -> Result<String, ColorError> {
    let mut parts = line.split('\t');
    let (from, to) = (parts.next().unwrap_or_default(), parts.next().unwrap_or_default());
    let numbers = parts.next().unwrap_or_default().split_whitespace();
    let mut values: Vec<f32> = numbers.map(|word| word.parse().unwrap_or(f32::NAN)).collect();
    let processor = match to.split_once('|') {
        Some((display, view)) => config.display_processor(from, display, view)?,
        None => config.processor(from, to)?,
    };
    processor.apply(&mut values, 3);
    Ok(values.iter().map(|v| format!("{v:e}")).collect::<Vec<_>>().join(" "))
}

fn main() -> ExitCode {
    let name = std::env::args().nth(1).unwrap_or_else(|| "ocio://default".to_owned());
    let environment: Environment = std::env::vars_os().collect();
    let mut out = std::io::stdout().lock();
    let config = match Config::open(&name, &environment) {
        Ok(config) => config,
        Err(error) => {
            let _ = writeln!(std::io::stderr().lock(), "error: {error}");
            return ExitCode::FAILURE;
        }
    };
    for text in std::io::stdin().lock().lines().map_while(Result::ok) {
        let answer = line(&config, &text).unwrap_or_else(|error| format!("error {error}"));
        if writeln!(out, "{answer}").is_err() {
            break;
        }
    }
    ExitCode::SUCCESS
}
