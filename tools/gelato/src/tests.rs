//! Tests that workers get every option that affects the image.

#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test, with a line number")]

use super::*;
use clap::CommandFactory;
use granita_cli::try_parse;

/// Values that at least one option accepts.
const VALUES: [&str; 7] = ["0.5", "3", "A=B", "localhost:14158", "defaultsurface", "z", "fov=30"];

fn parsed(words: &[String]) -> Result<(Options, Vec<Given>), granita_cli::Refusal> {
    try_parse([&["gelato".to_owned()], words].concat().into_iter().map(OsString::from).collect())
}

/// Parses a command line with this option and its required value, the first of [`VALUES`] that it accepts.
fn example(arg: &clap::Arg) -> (Options, Vec<Given>) {
    let name = match (arg.get_long(), arg.get_short()) {
        (Some(long), _) => format!("-{long}"),
        (None, short) => format!("-{}", short.unwrap()),
    };
    let count = match arg.get_action().takes_values() {
        true => arg.get_num_args().map_or(1, |n| n.min_values()),
        false => 0,
    };
    for value in VALUES {
        let option = [vec![name.clone()], vec![value.to_owned(); count]].concat();
        for others in
            [vec!["a.pyg"], vec![], vec!["-stream"], vec!["-safe", "a.pyg"], vec!["-o", "a.tif", "a.pyg"]]
        {
            let others: Vec<String> = others.into_iter().map(str::to_owned).collect();
            if let Ok(parsed) = parsed(&[option.clone(), others].concat()) {
                return parsed;
            }
        }
    }
    panic!("{name} takes none of {VALUES:?}: add a value that it takes");
}

#[test]
fn each_option_is_passed_to_workers_or_the_table_says_why_not() {
    let command = Options::command();
    let mut passed = Vec::new();
    for arg in command.get_arguments().filter(|arg| !arg.is_positional()) {
        let id = arg.get_id().as_str();
        if NOT_FOR_WORKERS.iter().any(|(other, _)| *other == id) {
            continue;
        }
        let (options, given) = example(arg);
        let words = options.for_worker(&given).unwrap_or_else(|| panic!("{id}: the scene is a file"));
        let (worker, again) = parsed(&words).unwrap();
        // The worker got the same option, and would pass on the same words.
        let [first, second] = [&given, &again].map(|all| all.iter().find(|g| g.id == id).cloned());
        assert!(first.is_some() && first == second, "{id}: {words:?}");
        assert_eq!(worker.for_worker(&again).unwrap(), words);
        passed.push(id.to_owned());
    }
    // The options that affect the image.
    let needed = [
        "threads",
        "number",
        "denoise",
        "only",
        "set",
        "env",
        "preview",
        "shade",
        "output",
        "data",
        "crop",
        "turntable",
        "up",
        "plugins",
        "native",
        "safe",
        "safeout",
    ];
    assert_eq!(passed, needed);
    for (id, reason) in NOT_FOR_WORKERS {
        assert!(command.get_arguments().any(|arg| arg.get_id() == id), "there is no option {id}");
        assert!(!reason.is_empty());
    }
}

#[test]
fn workers_make_the_image_of_a_viewer_without_showing_it() {
    let words = |line: &str| {
        let (options, given) = parsed(&line.split(' ').map(str::to_owned).collect::<Vec<_>>()).unwrap();
        options.for_worker(&given).map(|words| words.join(" "))
    };
    let shown = Some("-silent -data=first -crop 0 0.5 0 1 -iv -- a.pyg b.pyg".to_owned());
    assert_eq!(words("-iv -crop 0 0.5 0 1 -data first a.pyg b.pyg"), shown);
    assert_eq!(words("-display localhost -crop 0 0.5 0 1 -data first a.pyg b.pyg"), shown);
    // A screen alone shows nothing.
    assert_eq!(words("-display :1 -o x.tif a.pyg").unwrap(), "-silent -o x.tif -- a.pyg");
    assert_eq!(words("-threads 2 -"), None);
}
