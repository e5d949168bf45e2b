//! Man pages, from the tables of options.

use clap::Command;
use clap_mangen::Man;
use granita_cli::{BUILD_DATE, SUITE_VERSION};

/// Returns the man page of a tool. It shows options with one dash, as the manual does.
pub(crate) fn page(command: &Command) -> std::io::Result<String> {
    let mut bytes = Vec::new();
    Man::new(command.clone())
        .title(command.get_name().to_uppercase())
        .date(BUILD_DATE)
        .source(format!("Granita {SUITE_VERSION}"))
        .manual("Granita")
        .render(&mut bytes)?;
    // The synopsis has a blank after an option of one letter.
    Ok(with_one_dash(&String::from_utf8_lossy(&bytes)).replace(r" \fR]", r"\fR]"))
}

/// Replaces two dashes before a name by one. Dashes are escaped in the language of man pages.
fn with_one_dash(text: &str) -> String {
    let mut parts = text.split(r"\-\-");
    let mut out = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let is_name = part.starts_with(|c: char| c.is_ascii_alphabetic());
        out.push_str(if is_name { r"\-" } else { r"\-\-" });
        out.push_str(part);
    }
    out
}

/// Returns a page that shows another page of section 1 instead.
pub(crate) fn alias(page: &str) -> String {
    format!(".so man1/{page}.1\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_dashes_before_a_name_become_one() {
        assert_eq!(
            with_one_dash(r"\fB\-\-statistics\-json\fR a \-\- b \-o"),
            r"\fB\-statistics\-json\fR a \-\- b \-o"
        );
    }

    #[test]
    fn each_visible_option_of_each_tool_is_in_its_page() {
        for tool in &crate::TOOLS {
            let (command, name) = ((tool.options)(), tool.name);
            let page = page(&command).unwrap();
            assert!(page.contains(&format!(".TH {} 1", name.to_uppercase())), "{page}");
            for arg in command.get_arguments() {
                let Some(long) = arg.get_long() else { continue };
                let shown = format!(r"\fB\-{}\fR", long.replace('-', r"\-"));
                assert_eq!(page.contains(&shown), !arg.is_hide_set(), "{name} -{long}");
            }
        }
    }
}
