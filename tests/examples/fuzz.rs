//! Runs each fuzz target for some seconds of processor time, without libFuzzer.
//!
//! `cargo run --release -p granita-tests --example fuzz -- SECONDS SALT [TARGET ...]`
//!
//! Inputs are files of the corpus after one to three mutations. The same salt gives the same inputs. An input that
//! makes a target panic, or keeps it busy for more than [`SLOW`], is written to `fuzz/artifacts`, and the exit status
//! is then 1.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a program of its own")]

use cpu_time::ProcessTime;
use granita_base::hash;
use granita_tests::fuzz::{TARGETS, mutated};
use granita_tests::repository;
use std::process::ExitCode;
use std::time::Duration;

/// The processor time after which a target counts as slow.
const SLOW: Duration = Duration::from_secs(10);

fn main() -> ExitCode {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let seconds = args.first().and_then(|a| a.parse().ok());
    let salt: Option<u32> = args.get(1).and_then(|a| a.parse().ok());
    let (Some(seconds), Some(salt)) = (seconds, salt) else {
        eprintln!("fuzz SECONDS SALT [TARGET ...]");
        return ExitCode::from(2);
    };
    let artifacts = repository().join("fuzz").join("artifacts");
    let mut found = false;
    // The messages of panics are not printed, because there may be thousands of them.
    std::panic::set_hook(Box::new(|_| {}));
    for (name, target) in TARGETS {
        if args.len() > 2 && !args[2..].iter().any(|a| a == name) {
            continue;
        }
        let folder = repository().join("fuzz").join("corpus").join(name);
        let mut files: Vec<_> =
            std::fs::read_dir(&folder).into_iter().flatten().flatten().map(|e| e.path()).collect();
        files.sort();
        let seeds: Vec<Vec<u8>> = files.iter().filter_map(|f| std::fs::read(f).ok()).collect();
        if seeds.is_empty() {
            eprintln!("{name}: no corpus in {}", folder.display());
            continue;
        }
        let (mut number, mut finds, mut slowest) = (0u32, 0, Duration::ZERO);
        let begin = ProcessTime::now();
        while begin.elapsed() < Duration::from_secs(seconds) {
            number = number.wrapping_add(1);
            let random = hash::words(&[number, salt]);
            let mut bytes = seeds[random as usize % seeds.len()].clone();
            for depth in 0..1 + hash::words(&[random, 7]) % 3 {
                bytes = mutated(&bytes, hash::words(&[random, depth, salt]));
            }
            let start = begin.elapsed();
            let survived = std::panic::catch_unwind(|| target(&bytes)).is_ok();
            let took = begin.elapsed() - start;
            slowest = slowest.max(took);
            if !survived || took > SLOW {
                finds += 1;
                let file = artifacts.join(format!("{name}_{salt}_{number}"));
                let kept = std::fs::create_dir_all(&artifacts).and_then(|()| std::fs::write(&file, &bytes));
                if let Err(error) = kept {
                    eprintln!("{}: {error}", file.display());
                }
            }
        }
        found |= finds > 0;
        println!("{name}: {number} inputs, {finds} finds, the slowest took {slowest:?}");
    }
    ExitCode::from(u8::from(found))
}
