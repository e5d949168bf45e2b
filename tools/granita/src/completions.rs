//! Completions of shells, from the tables of options.
//!
//! `clap_complete` knows long options with two dashes only. The scripts are changed here so that they complete `-name`
//! and `--name`.

use clap::builder::Str;
use clap::{Arg, Command};
use clap_complete::{Shell, generate};
use granita_cli::SUITE_VERSION;

/// Returns the script that completes the words of a command.
pub(crate) fn script(shell: Shell, command: &Command) -> String {
    let mut bytes = Vec::new();
    generate(shell, &mut visible(command), command.get_name(), &mut bytes);
    let text = String::from_utf8_lossy(&bytes);
    let changed: Vec<String> = text
        .lines()
        .map(|line| {
            let changed = match shell {
                Shell::Bash => bash(line),
                Shell::Zsh => zsh(line),
                Shell::Fish => fish(line),
                _ => None,
            };
            changed.unwrap_or_else(|| line.to_owned())
        })
        .collect();
    changed.join("\n") + "\n"
}

/// Returns a command without hidden options, which `clap_complete` would show. The names of values end before a bracket
/// or a colon, which zsh reads as the end of a name.
fn visible(command: &Command) -> Command {
    let mut copy =
        Command::new(command.get_name().to_owned()).version(SUITE_VERSION).disable_help_subcommand(true);
    if let Some(about) = command.get_about() {
        copy = copy.about(about.clone());
    }
    let plain = |arg: &Arg| {
        let names = arg.get_value_names().unwrap_or_default();
        let short = |name: &Str| name.split(['[', ':']).next().unwrap_or_default().to_owned();
        if names.iter().any(|name| name.contains(':')) {
            arg.clone().value_names(names.iter().map(short).collect::<Vec<_>>())
        } else {
            arg.clone()
        }
    };
    copy.args(command.get_arguments().filter(|arg| !arg.is_hide_set()).map(plain))
        .subcommands(command.get_subcommands().map(visible))
}

/// Returns a line for bash that completes both forms, where it is about options.
fn bash(line: &str) -> Option<String> {
    let trimmed = line.trim_start();
    let indent = &line[..line.len() - trimmed.len()];
    if let Some(name) = trimmed.strip_prefix("--").and_then(|rest| rest.strip_suffix(')')) {
        return Some(format!("{indent}-{name}|--{name})"));
    }
    let words = trimmed.strip_prefix("opts=\"")?.strip_suffix('"')?;
    let words: Vec<&str> = words.split_whitespace().collect();
    let long = |word: &&str| word.starts_with("--");
    let one_dash: Vec<&str> = words.iter().map(|word| if long(word) { &word[1..] } else { word }).collect();
    let two_dashes: Vec<&str> = words.iter().copied().filter(long).collect();
    if two_dashes.is_empty() {
        return None;
    }
    let (one_dash, two_dashes) = (one_dash.join(" "), two_dashes.join(" "));
    Some(format!(
        "{indent}opts=\"{one_dash}\"\n{indent}if [[ ${{cur}} == --* ]] ; then opts=\"{two_dashes}\" ; fi"
    ))
}

/// Returns a line for zsh that completes both forms, where it is about options.
fn zsh(line: &str) -> Option<String> {
    // "-s" takes -name for the options n, a, m and e.
    if line.trim_start().starts_with("_arguments_options=(-s ") {
        return Some(line.replace("(-s ", "("));
    }
    let rest = line.strip_prefix('\'')?;
    let (excluded, rest) = match rest.strip_prefix('(') {
        Some(rest) => rest.split_once(')')?,
        None => ("", rest),
    };
    let (many, rest) = rest.strip_prefix('*').map_or(("", rest), |rest| ("*", rest));
    let both = |word: &str| match word.strip_prefix("--") {
        Some(name) => vec![format!("-{name}"), format!("--{name}")],
        None => vec![word.to_owned()],
    };
    let mut excluded: Vec<String> = excluded.split_whitespace().flat_map(both).collect();
    let end = rest.find(['=', '[', '+'])?;
    let (option, rest) = rest.split_at(end);
    if !option.starts_with('-') {
        return None;
    }
    if many.is_empty() {
        excluded.extend(both(option));
    }
    let excluded = if excluded.is_empty() { String::new() } else { format!("({})", excluded.join(" ")) };
    let Some(name) = option.strip_prefix("--") else {
        return Some(format!("'{excluded}{many}{option}{rest}"));
    };
    let (sign, rest) = rest.strip_prefix('=').map_or(("", rest), |rest| ("=", rest));
    Some(format!("'{excluded}{many}'{{-{name}{sign},--{name}{sign}}}'{rest}"))
}

/// Returns a line for fish that completes both forms, where it is about options.
fn fish(line: &str) -> Option<String> {
    let (before, rest) = line.split_once(" -l ").filter(|_| line.starts_with("complete "))?;
    let name = rest.split(' ').next().unwrap_or_default();
    Some(format!("{before} -o {name} -l {rest}"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TOOLS;
    use std::process::Command as Process;

    #[test]
    fn lines_complete_both_forms() {
        assert_eq!(
            bash("    opts=\"-o --crop file\"").unwrap(),
            "    opts=\"-o -crop file\"\n    if [[ ${cur} == --* ]] ; then opts=\"--crop\" ; fi"
        );
        assert_eq!(bash("  --crop)").unwrap(), "  -crop|--crop)");
        assert_eq!(bash("    opts=\"\""), None);
        assert_eq!(zsh("'--crop=[Part]:X:' \\").unwrap(), "'(-crop --crop)'{-crop=,--crop=}'[Part]:X:' \\");
        assert_eq!(zsh("'(--a)*--net[Hosts]' \\").unwrap(), "'(-a --a)*'{-net,--net}'[Hosts]' \\");
        assert_eq!(zsh("'*-o+[Image]:IMAGE:_files' \\").unwrap(), "'*-o+[Image]:IMAGE:_files' \\");
        assert_eq!(zsh("'*::files -- Scenes:_default' \\"), None);
        assert_eq!(
            fish("complete -c x -s o -l crop -d 'P' -r").unwrap(),
            "complete -c x -s o -o crop -l crop -d 'P' -r"
        );
    }

    #[test]
    fn each_visible_option_of_each_tool_is_completed() {
        for tool in &TOOLS {
            let (command, name) = ((tool.options)(), tool.name);
            for shell in [Shell::Bash, Shell::Zsh, Shell::Fish] {
                let script = script(shell, &command);
                assert!(!script.contains(":HOST[") && !script.contains("HOST[:"), "{shell} {name}");
                for arg in command.get_arguments() {
                    let Some(long) = arg.get_long() else { continue };
                    let forms = match shell {
                        Shell::Bash => [format!(" -{long} "), format!(" --{long} ")],
                        Shell::Zsh => [format!("{{-{long}"), format!(",--{long}")],
                        _ => [format!(" -o {long} "), format!(" -l {long} ")],
                    };
                    for form in forms {
                        let is_there = script.replace('"', " ").contains(&form);
                        assert_eq!(is_there, !arg.is_hide_set(), "{shell} {name} {form}");
                    }
                }
            }
        }
    }

    /// Returns a command with all tools.
    fn all() -> Command {
        Command::new("granita").subcommands(TOOLS.iter().map(|tool| (tool.options)()))
    }

    /// Returns what bash offers for a command line whose last word is incomplete.
    fn offered(line: &[&str]) -> String {
        let script = script(Shell::Bash, &all());
        let run = "COMP_WORDS=(\"$@\"); COMP_CWORD=$(($# - 1)); _granita granita \"${COMP_WORDS[COMP_CWORD]}\" \
                   \"${COMP_WORDS[COMP_CWORD - 1]}\"; echo ${COMPREPLY[@]}";
        let out = Process::new("bash")
            .args(["--norc", "-c", &format!("{script}\n{run}"), "bash"])
            .args(line)
            .output()
            .unwrap();
        assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stderr));
        String::from_utf8_lossy(&out.stdout).trim().to_owned()
    }

    #[test]
    fn bash_offers_tools_and_options() {
        if !granita_needs::has("bash") {
            return;
        }
        assert_eq!(offered(&["granita", "gs"]), "gslc gsoinfo");
        assert_eq!(offered(&["granita", "gelato", "-statistics"]), "-statistics -statistics-json");
        assert_eq!(offered(&["granita", "gelato", "--statistics-"]), "--statistics-json");
        assert_eq!(offered(&["granita", "gelato", "-shade", "k"]), "keyfillrim");
    }

    #[test]
    fn other_shells_read_their_scripts() {
        let folder = tempfile::tempdir().unwrap();
        for (shell, program) in [(Shell::Zsh, "zsh"), (Shell::Fish, "fish")] {
            if !granita_needs::has(program) {
                continue;
            }
            let path = folder.path().join(program);
            std::fs::write(&path, script(shell, &all())).unwrap();
            let out = Process::new(program).arg("-n").arg(&path).output().unwrap();
            assert!(out.status.success(), "{program}: {}", String::from_utf8_lossy(&out.stderr));
        }
    }
}
