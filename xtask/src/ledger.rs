//! Checks `tests/ledger.tsv`. It has a row for each item of the reference, with the tests that assert its effect.

use crate::workspace::Workspace;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// The file, relative to the root.
const FILE: &str = "tests/ledger.tsv";
/// The number of rows of the list. A lost row is an error.
const ROWS: usize = 495;
/// The columns of the header line.
const COLUMNS: [&str; 5] = ["area", "item", "expected", "section", "tests"];

/// The rows of the ledger and their errors.
pub(crate) struct Ledger {
    /// The number of rows.
    pub(crate) rows: usize,
    /// The rows of items that do not exist yet, as `AREA: ITEM`.
    pub(crate) planned: Vec<String>,
    /// All breaches, one line each.
    pub(crate) faults: Vec<String>,
}

/// Checks that each row names tests and that these exist. It reads sources and builds nothing.
pub(crate) fn check(workspace: &Workspace) -> Result<Ledger, String> {
    let text = workspace.text(Path::new(FILE)).ok_or_else(|| format!("{FILE} is missing"))?;
    Ok(check_text(&text, &Tests::find(workspace)?))
}

fn check_text(text: &str, tests: &Tests) -> Ledger {
    let mut ledger = Ledger { rows: 0, planned: Vec::new(), faults: Vec::new() };
    let mut seen = BTreeSet::new();
    let mut lines = text.lines().enumerate().filter(|(_, line)| !line.starts_with('#'));
    if lines.next().is_none_or(|(_, line)| line != COLUMNS.join("\t")) {
        ledger.faults.push(format!("{FILE}: the header is not {}", COLUMNS.join(", ")));
    }
    for (number, line) in lines {
        ledger.rows += 1;
        let columns: Vec<&str> = line.split('\t').collect();
        let [area, item, _, section, named] = columns[..] else {
            ledger.faults.push(format!(
                "{FILE}:{}: {} columns instead of {}",
                number + 1,
                columns.len(),
                COLUMNS.len()
            ));
            continue;
        };
        let mut fault =
            |what: String| ledger.faults.push(format!("{FILE}:{}: {area}: {item}: {what}", number + 1));
        if !seen.insert((area, item)) {
            fault("the row stands twice".to_owned());
        }
        match named.trim() {
            "" => fault("names no test".to_owned()),
            "open" => fault("is open".to_owned()),
            "planned" if is_rerendering(item, section) => ledger.planned.push(format!("{area}: {item}")),
            "planned" => fault("only re-rendering may be planned".to_owned()),
            list => {
                list.split_whitespace().filter_map(|name| tests.problem(name)).for_each(&mut fault);
            }
        }
    }
    if ledger.rows != ROWS {
        ledger.faults.push(format!("{FILE}: {} rows instead of {ROWS}", ledger.rows));
    }
    ledger
}

fn is_rerendering(item: &str, section: &str) -> bool {
    section == "2.11" || item.contains("rerender") || item.contains("re-rendering")
}

/// The tests of the workspace.
#[derive(Default)]
struct Tests {
    /// The cases of the suite, as `AREA/NAME`.
    cases: BTreeSet<String>,
    /// For each package and test function: the stems of the files that contain it.
    functions: BTreeMap<String, BTreeMap<String, Vec<String>>>,
}

impl Tests {
    fn find(workspace: &Workspace) -> Result<Self, String> {
        let mut tests = Self::default();
        for file in workspace.files()? {
            if let Ok(place) = file.strip_prefix("tests/suite")
                && place.file_name().is_some_and(|name| name == "case")
                && let Some(folder) = place.parent()
            {
                tests.cases.insert(folder.to_string_lossy().replace('\\', "/"));
            }
            let owner = workspace.crates.iter().find(|c| file.starts_with(&c.folder));
            if let Some(owner) = owner
                && file.extension().is_some_and(|e| e == "rs")
                && let Some(text) = workspace.text(&file)
            {
                let stem = file.file_stem().unwrap_or_default().to_string_lossy();
                tests.add(&owner.name, &stem, &text);
            }
        }
        Ok(tests)
    }

    /// Adds the test functions of a source file. Ignored ones do not count.
    fn add(&mut self, package: &str, stem: &str, text: &str) {
        let known = self.functions.entry(package.to_owned()).or_default();
        let mut pending = false;
        for line in text.lines().map(str::trim) {
            if line == "#[test]" {
                pending = true;
            } else if line.starts_with("#[ignore") {
                pending = false;
            } else if pending && let Some(name) = function_name(line) {
                known.entry(name.to_owned()).or_default().push(stem.to_owned());
                pending = false;
            }
        }
    }

    /// Returns the error in the name of a test: `suite:AREA/NAME`, `PACKAGE::TEST` or `PACKAGE::FILE::TEST`.
    fn problem(&self, name: &str) -> Option<String> {
        if let Some(case) = name.strip_prefix("suite:") {
            return (!self.cases.contains(case)).then(|| format!("there is no case {case} in tests/suite"));
        }
        let parts: Vec<&str> = name.split("::").collect();
        let (package, stem, test) = match parts[..] {
            [package, test] => (package, None, test),
            [package, stem, test] => (package, Some(stem), test),
            _ => return Some(format!("{name} is not the name of a test")),
        };
        let Some(functions) = self.functions.get(package) else {
            return Some(format!("there is no package {package}"));
        };
        let files = functions.get(test).map_or(&[][..], Vec::as_slice);
        match files.iter().filter(|file| stem.is_none_or(|s| s == *file)).count() {
            1 => None,
            0 => Some(format!("there is no test {name}")),
            _ => Some(format!("{name} is in several files: {}", files.join(", "))),
        }
    }
}

/// Returns the name of the function that a line declares.
fn function_name(line: &str) -> Option<&str> {
    let (before, rest) = line.split_once("fn ")?;
    let plain = before.split_whitespace().all(|word| word.starts_with("pub") || word == "async");
    let end = rest.find(|c: char| !c.is_alphanumeric() && c != '_')?;
    plain.then(|| &rest[..end])
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOURCE: &str = "#[test]\nfn one() {}\n#[test]\n#[allow(x)]\nfn two() {}\n#[test]\n#[ignore = \"slow\"]\nfn three() {}\nfn four() {}\n";

    fn tests() -> Tests {
        let mut tests = Tests { cases: ["area/name".to_owned()].into(), ..Tests::default() };
        tests.add("p", "a", SOURCE);
        tests.add("p", "b", "#[test]\nfn two() {}\n");
        tests
    }

    #[test]
    fn unknown_test_names_are_reported() {
        let tests = tests();
        for good in ["suite:area/name", "p::one", "p::a::one", "p::a::two", "p::b::two"] {
            assert_eq!(tests.problem(good), None, "{good}");
        }
        for (bad, what) in [
            ("suite:area", "no case"),
            ("q::one", "no package"),
            ("p::two", "several files"),
            ("p::three", "no test"),
            ("p::four", "no test"),
            ("p::b::one", "no test"),
            ("one", "not the name"),
        ] {
            assert!(tests.problem(bad).is_some_and(|told| told.contains(what)), "{bad}");
        }
    }

    #[test]
    fn rows_without_tests_are_reported() {
        let row = |tests: &str| format!("area\titem{tests}\tx\t4.1\t{tests}\n");
        let text = |rows: &str| format!("# comment\n{}\n{rows}", COLUMNS.join("\t"));
        let faults = |rows: &str| check_text(&text(rows), &tests()).faults;
        // The only error is that the number of rows is not that of the list.
        assert_eq!(faults(&row("p::one suite:area/name")).len(), 1);
        for (tests, what) in [
            ("", "names no test"),
            ("open", "is open"),
            ("planned", "only re-rendering"),
            ("p::one p::none", "no test p::none"),
        ] {
            let told = faults(&row(tests));
            assert!(told.len() == 2 && told[0].contains(what), "{told:?}");
        }
        assert!(faults(&row("p::one").repeat(2))[0].contains("twice"));
        assert!(faults("a\tb\n")[0].contains("2 columns"));
        let planned = check_text(&text("attr\tint rerender\t0\t4.3\tplanned\n"), &tests());
        assert_eq!((planned.planned.len(), planned.faults.len()), (1, 1));
    }
}
