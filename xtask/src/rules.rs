//! Reads the limits and lists of `CONTRIBUTING.md` that the checks use. They are written only there.

use std::path::{Path, PathBuf};

/// The page.
pub(crate) const PAGE: &str = "CONTRIBUTING.md";

/// The content of the page.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Rules {
    /// The largest number of lines of a file.
    pub(crate) lines: usize,
    /// The largest number of lines of a file that does not give a reason for more.
    pub(crate) lines_without_reason: usize,
    /// The least and the largest median of the lines of all files.
    pub(crate) median: [usize; 2],
    /// The largest number of characters of a line of a comment.
    pub(crate) comment_width: usize,
    /// The crates, folders of crates and files that may contain unsafe code.
    pub(crate) unsafe_places: Vec<PathBuf>,
}

impl Rules {
    /// Reads the page.
    ///
    /// # Errors
    /// Returns the missing part.
    pub(crate) fn read(page: &str) -> Result<Self, String> {
        let number = |name: &str| {
            let row = rows(page, "limit").find(|row| row[0] == name);
            let row = row.ok_or_else(|| format!("{PAGE}: no limit \"{name}\""))?;
            row[1].replace(' ', "").parse().map_err(|_| format!("{PAGE}: \"{name}\" is no number"))
        };
        let places = rows(page, "unsafe code in").map(|row| PathBuf::from(row[0].trim_matches('`')));
        let unsafe_places: Vec<PathBuf> = places.collect();
        if unsafe_places.is_empty() {
            return Err(format!("{PAGE}: no list of unsafe code"));
        }
        Ok(Self {
            lines: number("lines of a file")?,
            lines_without_reason: number("lines of a file without a reason")?,
            median: [
                number("lines of half of the files, at least")?,
                number("lines of half of the files, at most")?,
            ],
            comment_width: number("characters of a line of a comment")?,
            unsafe_places,
        })
    }

    /// True when a file, or a file of a crate, lies where unsafe code is allowed.
    pub(crate) fn allows_unsafe(&self, path: &Path) -> bool {
        self.unsafe_places.iter().any(|place| path.starts_with(place))
    }
}

/// Returns the rows of the tables of a page whose first column has this title.
pub(crate) fn rows<'a>(page: &'a str, title: &str) -> impl Iterator<Item = Vec<&'a str>> {
    let mut is_inside = false;
    let mut rows = Vec::new();
    for line in page.lines() {
        let Some(row) = line.trim().strip_prefix('|') else {
            is_inside = false;
            continue;
        };
        let cells: Vec<&str> = row.trim_end_matches('|').split('|').map(str::trim).collect();
        if cells[0] == title {
            is_inside = true;
        } else if is_inside && !cells[0].starts_with("--") {
            rows.push(cells);
        }
    }
    rows.into_iter()
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "| limit | number |\n|---|---|\n| lines of a file | 1000 |\n| lines of a file without a reason | 600 |\n\
                        | lines of half of the files, at least | 120 |\n| lines of half of the files, at most | 250 |\n\
                        | characters of a line of a comment | 120 |\n\n| unsafe code in | because |\n|---|---|\n\
                        | `libs/a` | x |\n| `libs/b/src/simd.rs` | y |\n\n| other | z |\n|---|---|\n| `libs/c` | x |\n";

    #[test]
    fn rules_are_read_from_the_page() {
        let rules = Rules::read(TEXT).unwrap();
        assert_eq!((rules.lines, rules.lines_without_reason), (1000, 600));
        assert_eq!((rules.median, rules.comment_width), ([120, 250], 120));
        for (path, allowed) in [
            ("libs/a/src/x.rs", true),
            ("libs/b/src/simd.rs", true),
            ("libs/b/src/x.rs", false),
            ("libs/c/src/x.rs", false),
        ] {
            assert_eq!(rules.allows_unsafe(Path::new(path)), allowed, "{path}");
        }
        assert!(Rules::read(&TEXT.replace("1000", "many")).unwrap_err().contains("lines of a file"));
        assert!(Rules::read("").is_err());
    }
}
