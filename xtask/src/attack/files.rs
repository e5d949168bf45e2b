//! Runs the tools on changed files of every kind that they read.

use super::kinds::{KINDS, Kind};
use super::mutate::{Random, mutated};
use super::run::{Bounds, MEMORY_KIB, Outcome, Place};
use super::{Attack, Failure, Tally};
use parking_lot::Mutex;
use std::fs;
use std::io;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};

/// The largest number of runs that make a finding smaller.
const SHRINKS: usize = 60;

/// A kind of files with its seeds.
struct Seeds {
    kind: &'static Kind,
    files: Vec<(String, Vec<u8>)>,
}

/// Runs every unchanged seed, then changed ones: `per_kind` of each kind, or as many as the time allows. With
/// `per_kind`, only changed ones are run.
pub(crate) fn run(attack: &Attack, per_kind: Option<u64>) -> Result<Tally, String> {
    let all = seeds(attack)?;
    let unchanged: Vec<(usize, usize, usize)> = all
        .iter()
        .enumerate()
        .flat_map(|(k, seeds)| (0..seeds.files.len()).map(move |file| (k, file)))
        .flat_map(|(k, file)| (0..all[k].kind.commands.len()).map(move |command| (k, file, command)))
        .collect();
    // A fixed count is for a quick run, in which the unchanged seeds alone would take all of the time.
    let unchanged = if per_kind.is_some() { Vec::new() } else { unchanged };
    let (next, tally) = (AtomicU64::new(0), Mutex::new(Tally::new("files")));
    let work = |worker: usize| -> io::Result<()> {
        let place = Place::new(attack.scratch.join(format!("files-{worker}")))?;
        while !attack.is_over() {
            let number = next.fetch_add(1, Ordering::Relaxed) as usize;
            let (seeds, command, bytes, name) = if let Some((k, file, command)) = unchanged.get(number) {
                let (name, bytes) = &all[*k].files[*file];
                (&all[*k], *command, bytes.clone(), name.clone())
            } else {
                let number = number - unchanged.len();
                let (k, number) = (number % all.len(), number / all.len());
                if per_kind.is_some_and(|count| number as u64 >= count) {
                    break;
                }
                let seeds = &all[k];
                let mut random = Random::new(attack.seed, (number * KINDS.len() + k) as u64);
                let pick = |random: &mut Random| &seeds.files[random.below(seeds.files.len())];
                let (name, seed) = pick(&mut random);
                let (_, other) = pick(&mut random);
                let bytes = mutated(seed, other, &mut random);
                (seeds, number % seeds.kind.commands.len(), bytes, format!("{name}-{number}"))
            };
            let case = Case { attack, kind: seeds.kind, command: seeds.kind.commands[command] };
            let what = case.fault(&place, &bytes)?;
            let mut failure = None;
            if let Some((what, is_quick)) = what {
                let is_known = tally.lock().has_kind(case.kind.name, &what);
                // Repeated findings are only counted. Slow cases are not run repeatedly.
                let smallest = if is_quick && !is_known && per_kind.is_none() {
                    case.shrunk(&place, &bytes)?
                } else {
                    bytes
                };
                place.clear()?;
                case.lay_out(&place, &smallest)?;
                let name = format!("{}-{name}", case.kind.name);
                let command = case.command.replace("{}", &case.file());
                let kept =
                    if is_known { None } else { Some(attack.keep("files", &name, &place, &[command])?) };
                failure = Some(Failure { name, what, kept });
            }
            tally.lock().add(failure);
        }
        fs::remove_dir_all(attack.scratch.join(format!("files-{worker}")))
    };
    attack.on_all_processors("files", work)?;
    Ok(tally.into_inner())
}

/// Returns the seeds of the corpus.
fn seeds(attack: &Attack) -> Result<Vec<Seeds>, String> {
    let corpus = attack.root.join("fuzz").join("corpus");
    let chosen = KINDS.iter().filter(|kind| attack.is_wanted("files", kind.name));
    chosen
        .map(|kind| {
            let folder = corpus.join(kind.name);
            let told = |e: io::Error| format!("{}: {e}", folder.display());
            let entries =
                fs::read_dir(&folder).map_err(told)?.collect::<Result<Vec<_>, _>>().map_err(told)?;
            let mut paths: Vec<PathBuf> = entries.iter().map(fs::DirEntry::path).collect();
            paths.sort();
            let file = |path: &PathBuf| {
                let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
                Ok((name, fs::read(path).map_err(told)?))
            };
            let files = paths.iter().map(file).collect::<Result<Vec<_>, String>>()?;
            if files.is_empty() {
                Err(format!("{}: no seeds", folder.display()))
            } else {
                Ok(Seeds { kind, files })
            }
        })
        .collect()
}

/// A way of reading a kind of file.
struct Case<'a> {
    attack: &'a Attack,
    kind: &'static Kind,
    command: &'static str,
}

impl Case<'_> {
    fn file(&self) -> String {
        format!("x.{}", self.kind.extension)
    }

    fn lay_out(&self, place: &Place, bytes: &[u8]) -> io::Result<()> {
        let work = place.work();
        fs::write(work.join(self.file()), bytes)?;
        let beside = self.kind.beside.iter();
        beside
            .into_iter()
            .try_for_each(|(name, text)| fs::write(work.join(name), text.replace("{}", &self.file())))
    }

    fn read(&self, place: &Place, bytes: &[u8]) -> io::Result<Outcome> {
        place.clear()?;
        self.lay_out(place, bytes)?;
        let bounds = Bounds { seconds: self.attack.seconds(20.0), memory_kib: MEMORY_KIB, files: None };
        let mut command = self.command.replace("{}", &self.file());
        if self.attack.has_timeout && command.starts_with("gelato ") {
            // A large frame is not an error as long as it can be ended.
            command = command.replacen("gelato", &format!("gelato -timeout {:.0}", bounds.seconds / 2.0), 1);
        }
        self.attack.run(place, &command, &bounds)
    }

    /// Returns the error after reading these bytes. The flag is true when the run was short.
    fn fault(&self, place: &Place, bytes: &[u8]) -> io::Result<Option<(String, bool)>> {
        let outcome = self.read(place, bytes)?;
        let tool = self.command.split(' ').next().unwrap_or_default();
        let with_tool = |what: String| (format!("{tool}: {what}"), outcome.wall.as_secs_f64() < 2.0);
        if let Some(what) = outcome.fault() {
            return Ok(Some(with_tool(what)));
        }
        if outcome.code() != Some(0) && outcome.stderr.trim().is_empty() && outcome.stdout.trim().is_empty() {
            let code = outcome.code().unwrap_or(-1);
            return Ok(Some(with_tool(format!("exit status {code} without a message"))));
        }
        let left = place.leftovers();
        Ok((!left.is_empty()).then(|| with_tool(format!("left {}", left.join(" ")))))
    }

    /// Removes pieces of the bytes while the error stays the same.
    fn shrunk(&self, place: &Place, bytes: &[u8]) -> io::Result<Vec<u8>> {
        let Some((wrong, _)) = self.fault(place, bytes)? else { return Ok(bytes.to_vec()) };
        let (mut best, mut size, mut runs) = (bytes.to_vec(), bytes.len() / 2, 0);
        while size > 0 && runs < SHRINKS {
            let mut at = 0;
            while at < best.len() && runs < SHRINKS {
                let mut less = best.clone();
                less.drain(at..(at + size).min(best.len()));
                runs += 1;
                match self.fault(place, &less)? {
                    Some((what, _)) if super::alike(&what, &wrong) => best = less,
                    _ => at += size,
                }
            }
            size /= 2;
        }
        Ok(best)
    }
}
