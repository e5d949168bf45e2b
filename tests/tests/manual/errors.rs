//! The tables of errors of the manual. Each row has a statement that causes the message.

use crate::pages::pages;
use crate::scenes::messages;
use granita_base::Severity;

/// The first line of a table of errors.
const HEAD: &str = "| statement | severity | message | effect |";

#[test]
fn errors_are_reported_as_described() {
    let (mut faults, mut n) = (String::new(), 0);
    for page in pages() {
        let mut inside = false;
        for (line, row) in page.prose() {
            inside = row == HEAD || inside && row.starts_with('|');
            if !inside || row == HEAD || row.starts_with("|---") {
                continue;
            }
            n += 1;
            let place = format!("{}:{line}", page.name);
            let cells: Vec<&str> = row.trim_matches('|').split(" | ").map(str::trim).collect();
            let [statement, severity, message, effect] = cells[..] else {
                faults += &format!("{place}: {} cells\n", cells.len());
                continue;
            };
            let [statement, message] = [statement, message].map(|cell| cell.trim_matches('`'));
            let severity = match severity {
                "error" => Severity::Error,
                "warning" => Severity::Warning,
                other => panic!("{place}: severity {other}"),
            };
            assert!(!effect.is_empty() && !message.is_empty(), "{place}");
            let said = messages(statement);
            // Two messages are separated by a word between their marks.
            let described: Vec<&str> = message.split("` and `").collect();
            let as_described = said.len() == described.len()
                && said.iter().zip(&described).all(|(s, d)| s.severity == severity && s.text.contains(d));
            if !as_described {
                let said: Vec<String> = said.iter().map(ToString::to_string).collect();
                faults +=
                    &format!("{place}: {statement}\n    described: {message}\n    reported: {said:#?}\n");
            }
        }
    }
    assert!(faults.is_empty() && n > 90, "{n} errors\n{faults}");
}
