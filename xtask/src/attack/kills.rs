//! Ends tools at random moments: by TERM and INT, like users and systems, and by KILL, which a process cannot handle.
//!
//! Two seconds later no process of the run may be left. A file under the final name must be complete. No temporary file
//! may be left. After KILL, which leaves no time to remove them, temporary files must be gone once the same command has
//! run again.

use super::mutate::Random;
use super::run::{Bounds, MEMORY_KIB, Place, end, marked};
use super::{Attack, Failure, Tally, first_line, images, scenes};
use std::fs;
use std::io;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// The time for processes to end after the one that started them.
const GRACE: Duration = Duration::from_secs(2);

/// The fraction of the total time for kills.
const SHARE: u32 = 3;

/// A command that is killed.
struct Victim {
    name: &'static str,
    make: fn(&Path) -> io::Result<()>,
    /// The tool and its arguments.
    command: &'static str,
    /// The files that it writes, each with a command line that reads all of it.
    outputs: &'static [(&'static str, &'static str)],
    /// True when it needs `python3`.
    needs_python: bool,
    /// True when it does not end by itself.
    is_endless: bool,
}

const VICTIMS: [Victim; 9] = [
    Victim {
        name: "gelato",
        make: |folder| fs::write(folder.join("x.pyg"), slow("")),
        command: "gelato -threads 2 x.pyg",
        outputs: &[("out.exr", "iv -stats out.exr")],
        needs_python: false,
        is_endless: false,
    },
    Victim {
        name: "net",
        make: |folder| fs::write(folder.join("x.pyg"), slow("")),
        command: "gelato -net local -net local x.pyg",
        outputs: &[("out.exr", "iv -stats out.exr")],
        needs_python: false,
        is_endless: false,
    },
    Victim {
        name: "command",
        make: |folder| fs::write(folder.join("x.pyg"), "Command (\"system sleep 1000 & sleep 1000\")\n"),
        command: "gelato x.pyg",
        outputs: &[],
        needs_python: false,
        is_endless: true,
    },
    Victim {
        name: "maketx",
        make: |folder| fs::write(folder.join("large.ppm"), images::large_ppm(1500)),
        command: "maketx large.ppm -o out.tx -threads 2",
        outputs: &[("out.tx", "iv -stats out.tx")],
        needs_python: false,
        is_endless: false,
    },
    Victim {
        name: "script",
        make: |folder| {
            let text = "import time\nwhile True:\n    time.sleep (0.01)\n";
            fs::write(folder.join("x.pyg"), text)
        },
        command: "gelato x.pyg",
        outputs: &[],
        needs_python: true,
        is_endless: true,
    },
    Victim {
        name: "topyg",
        make: |folder| fs::write(folder.join("x.obj"), scenes::star(60_000).replace("\nf ", "\n# ")),
        command: "topyg -o out.pyg x.obj",
        outputs: &[("out.pyg", "topyg -o checked.txt out.pyg")],
        needs_python: false,
        is_endless: false,
    },
    Victim {
        name: "gslc",
        make: |folder| fs::write(folder.join("x.gsl"), scenes::sum(150)),
        command: "gslc -o out.gso x.gsl",
        outputs: &[("out.gso", "gsoinfo out.gso")],
        needs_python: false,
        is_endless: false,
    },
    Victim {
        name: "thumbnail",
        make: |folder| fs::write(folder.join("large.ppm"), images::large_ppm(2000)),
        command: "iv -thumbnail out.png -size 2000 large.ppm",
        outputs: &[("out.png", "iv -stats out.png")],
        needs_python: false,
        is_endless: false,
    },
    Victim {
        name: "stream",
        make: |folder| fs::write(folder.join("x.pyg"), slow("")),
        command: "gelato -stream",
        outputs: &[],
        needs_python: false,
        is_endless: true,
    },
];

/// Returns a scene that takes about a second.
fn slow(settings: &str) -> String {
    let settings = format!("{settings}Attribute (\"int[2] spatialquality\", (12, 12))\n");
    scenes::frame(&settings, scenes::BALL).replace("(64, 48)", "(640, 480)")
}

/// True when a process with this status in /proc ignores SIGINT. The programs that it starts do the same.
fn ignores_interrupts(status: &str) -> bool {
    const SIGINT: u32 = 2;
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    mask.and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok())
        .is_some_and(|mask| mask >> (SIGINT - 1) & 1 != 0)
}

/// Kills each victim by each signal `rounds` times, or as often as the time allows.
pub(crate) fn run(attack: &Attack, rounds: Option<u64>) -> Result<Tally, String> {
    let told = |e: io::Error| format!("kills: {e}");
    let place = Place::new(attack.scratch.join("kills")).map_err(told)?;
    let mut tally = Tally::new("kills");
    let has_python = Command::new("python3")
        .arg("--version")
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status()
        .is_ok_and(|s| s.success());
    let left = attack.end.saturating_duration_since(Instant::now());
    let end_of_part = Instant::now() + left / SHARE;
    let mut durations = [Duration::ZERO; VICTIMS.len()];
    let ignores_interrupts = ignores_interrupts(&fs::read_to_string("/proc/self/status").map_err(told)?);
    if ignores_interrupts {
        println!(
            "attack: kills: INT is ignored here, as in the background of a script; TERM stands in for it"
        );
    }
    for round in 0..rounds.unwrap_or(u64::MAX) {
        for (number, victim) in VICTIMS.iter().enumerate() {
            if !attack.is_wanted("kills", victim.name) {
                continue;
            }
            if victim.needs_python && !has_python {
                if round == 0 {
                    println!("attack: kills: {} is skipped, there is no python3", victim.name);
                }
                continue;
            }
            if durations[number].is_zero() {
                durations[number] = victim.duration(attack, &place).map_err(told)?;
            }
            let signal = match ["TERM", "INT", "KILL"][(round as usize + number) % 3] {
                "INT" if ignores_interrupts => "TERM",
                signal => signal,
            };
            let mut random = Random::new(attack.seed, round * VICTIMS.len() as u64 + number as u64);
            let moment = durations[number].mul_f64(random.share());
            let case = format!("{}-{signal}-{:.0}ms", victim.name, moment.as_secs_f64() * 1e3);
            let mark = format!("{}-{round}-{number}", std::process::id());
            let failure = match victim.fault(attack, &place, signal, moment, &mark).map_err(told)? {
                None => None,
                Some(what) => {
                    let lines = [victim.command.to_owned()];
                    let kept = attack.keep("kills", &case, &place, &lines).map_err(told)?;
                    Some(Failure { name: case, what, kept: Some(kept) })
                }
            };
            tally.add(failure);
        }
        if rounds.is_none() && Instant::now() >= end_of_part {
            break;
        }
    }
    place.clear().map_err(told)?;
    Ok(tally)
}

impl Victim {
    /// Returns the duration without a kill, and checks that the command succeeds. An endless victim has a fixed
    /// duration.
    fn duration(&self, attack: &Attack, place: &Place) -> io::Result<Duration> {
        if self.is_endless {
            return Ok(Duration::from_millis(800));
        }
        place.clear()?;
        (self.make)(&place.work())?;
        let bounds = Bounds { seconds: attack.seconds(60.0), memory_kib: MEMORY_KIB, files: None };
        let outcome = attack.run(place, self.command, &bounds)?;
        match outcome.code() {
            Some(0) => Ok(outcome.wall),
            _ => Err(io::Error::other(format!("{}: {}", self.command, first_line(&outcome.stderr)))),
        }
    }

    /// Returns the error after this signal at this moment.
    fn fault(
        &self,
        attack: &Attack,
        place: &Place,
        signal: &str,
        moment: Duration,
        mark: &str,
    ) -> io::Result<Option<String>> {
        place.clear()?;
        (self.make)(&place.work())?;
        let bounds = Bounds { seconds: attack.seconds(60.0), memory_kib: MEMORY_KIB, files: None };
        let mut words = self.command.split(' ').map(str::to_owned);
        let program = attack.program(&words.next().unwrap_or_default());
        // The pipe of the standard input stays open, because a program that reads it would end with it.
        let mut started =
            place.start(&program, &words.collect::<Vec<_>>(), &bounds, Stdio::piped(), Some(mark))?;
        std::thread::sleep(moment);
        // A program that has already ended must not leave anything either.
        let was_over = started.is_over();
        started.signal(signal);
        let killed = Instant::now();
        let outcome = started.wait(moment + GRACE)?;
        let mut wrong = Vec::new();
        if !was_over && outcome.ending == super::run::Ending::TimeOut {
            wrong.push(format!("still runs {} s after {signal}", GRACE.as_secs()));
        }
        if outcome.stderr.contains("panicked at") {
            wrong.push(first_line(&outcome.stderr));
        }
        let mut alive = marked(mark);
        while !alive.is_empty() && killed.elapsed() < GRACE {
            std::thread::sleep(Duration::from_millis(20));
            alive = marked(mark);
        }
        if !alive.is_empty() {
            let names: Vec<String> = alive.iter().map(|(id, name)| format!("{name} ({id})")).collect();
            wrong.push(format!("left running: {}", names.join(" ")));
            end(&alive);
        }
        for (file, check) in self.outputs {
            if place.work().join(file).exists() {
                let read = attack.run(place, check, &bounds)?;
                if read.code() != Some(0) {
                    wrong.push(format!("{file} is not whole: {}", first_line(&read.stderr)));
                }
            }
        }
        if signal == "KILL" && !self.is_endless {
            let again = attack.run(place, self.command, &bounds)?;
            if again.code() != Some(0) {
                wrong.push(format!("fails when run again: {}", first_line(&again.stderr)));
            }
        }
        let left = place.leftovers();
        if !left.is_empty() && (signal != "KILL" || !self.is_endless) {
            let when = if signal == "KILL" { " even after another run" } else { "" };
            wrong.push(format!("left {}{when}", left.join(" ")));
        }
        Ok((!wrong.is_empty()).then(|| format!("{signal}: {}", wrong.join("; "))))
    }
}

#[cfg(test)]
mod tests {
    use super::ignores_interrupts;

    #[test]
    fn ignored_interrupts_are_found() {
        let status = |mask: &str| format!("Name:\tx\nSigBlk:\t0000000000000002\nSigIgn:\t{mask}\n");
        let found = ["0000000000000000", "0000000000001002", "0000000000001000"]
            .map(|mask| ignores_interrupts(&status(mask)));
        assert_eq!(found, [false, true, false]);
        assert!(!ignores_interrupts(""));
    }
}
