//! Runs every case of `tests/suite`.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]
#![allow(clippy::print_stdout, reason = "a test speaks to the person who runs it")]

use granita_tests::{Outcome, Tools, cases, repository, run, write_report};
use parking_lot::Mutex;
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};

#[test]
fn every_case_of_the_suite_gives_its_reference() {
    let tests = repository().join("tests");
    let all = cases(&tests.join("suite")).unwrap();
    let bless = std::env::var("GRANITA_BLESS").ok();
    let blessed = |name: &str| bless.as_deref().is_some_and(|b| b == "all" || name.starts_with(b));
    let chosen: Vec<_> = all.iter().filter(|c| bless.is_none() || blessed(&c.name)).collect();
    assert!(!chosen.is_empty(), "no case of that name");

    let tools = Tools::build().unwrap();
    let scratch = tempfile::tempdir().unwrap();
    let reference = tests.join("ref");
    let next = AtomicUsize::new(0);
    let outcomes = Mutex::new(Vec::<Outcome>::new());
    // Tools use several threads themselves. Two cases run at a time, so that small cases do not wait for long.
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(|| {
                while let Some(case) = chosen.get(next.fetch_add(1, Ordering::Relaxed)) {
                    let outcome = run(case, &tools, &reference, scratch.path(), blessed(&case.name));
                    outcomes.lock().push(outcome);
                }
            });
        }
    });
    let mut outcomes = outcomes.into_inner();
    outcomes.sort_by(|a, b| a.name.cmp(&b.name));
    if let Ok(folder) = std::env::var("GRANITA_REPORT") {
        write_report(Path::new(&folder), &outcomes).unwrap();
    }
    let failed: Vec<_> = outcomes.iter().filter(|o| !o.faults.is_empty()).collect();
    for outcome in &failed {
        println!("--- {}", outcome.name);
        outcome.faults.iter().for_each(|fault| println!("    {fault}"));
    }
    assert!(failed.is_empty(), "{} of {} cases failed", failed.len(), outcomes.len());
}
