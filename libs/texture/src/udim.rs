//! Sets of images that continue each other: one for each unit square of texture coordinates (UDIM). The names of their
//! files differ in a number.

use granita_base::{Files, SearchPath};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The number of columns of squares in the numbering of `<UDIM>`.
const COLUMNS: u32 = 10;

/// The number of the first square.
const FIRST: u32 = 1001;

/// The largest number. All numbers have four digits.
const LAST: u32 = 9999;

/// One unit square of texture coordinates. They are ordered by rows.
///
/// Column c has `s` between c and c + 1. Row 0 has `t` between 0 and 1. Rows are counted upward, against the direction
/// of `t`, because models have their second coordinate upward: row r has `t` between -r and 1 - r.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Square {
    /// The row, from 0.
    pub row: u32,
    /// The column, from 0.
    pub column: u32,
}

/// The mark in a name that stands for the number of a square.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Mark {
    /// `<UDIM>`: 1001 + column + 10 row, with ten columns.
    Udim,
    /// `<UVTILE>`: `u1_v1` for the first square.
    UvTile,
}

impl Mark {
    const ALL: [(&str, Self); 4] = [
        ("<UDIM>", Self::Udim),
        ("<udim>", Self::Udim),
        ("<UVTILE>", Self::UvTile),
        ("<uvtile>", Self::UvTile),
    ];

    fn write(self, square: Square) -> Option<String> {
        let Square { row, column } = square;
        match self {
            Self::Udim => {
                let number = row.checked_mul(COLUMNS)?.checked_add(FIRST + column)?;
                (column < COLUMNS && number <= LAST).then(|| number.to_string())
            }
            Self::UvTile => Some(format!("u{}_v{}", column.checked_add(1)?, row.checked_add(1)?)),
        }
    }

    fn read(self, text: &str) -> Option<Square> {
        let square = match self {
            Self::Udim => {
                let at = text.parse::<u32>().ok()?.checked_sub(FIRST)?;
                Square { row: at / COLUMNS, column: at % COLUMNS }
            }
            Self::UvTile => {
                let (column, row) = text.strip_prefix('u')?.split_once("_v")?;
                let number = |text: &str| text.parse::<u32>().ok()?.checked_sub(1);
                Square { row: number(row)?, column: number(column)? }
            }
        };
        // Other spellings of a number, such as "+1001", are not names of the set.
        (self.write(square)? == text).then_some(square)
    }
}

/// The name of a set of images, such as `wall.<UDIM>.tx`. `<UDIM>` stands for the numbers 1001 to 1010 of the squares
/// of row 0, 1011 to 1020 of row 1, and so on. `<UVTILE>` stands for `u1_v1`, `u2_v1` and so on. Both may also have
/// small letters.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UdimName {
    /// The name up to the mark, with the folder.
    before: String,
    mark: Mark,
    after: String,
}

impl UdimName {
    /// Reads a name. Returns `None` when its last part, after the folders, has no mark.
    pub fn parse(name: &str) -> Option<Self> {
        let (at, word, mark) =
            Mark::ALL.iter().find_map(|(word, mark)| Some((name.rfind(word)?, *word, *mark)))?;
        let after = &name[at + word.len()..];
        (!after.contains('/')).then(|| Self { before: name[..at].to_owned(), mark, after: after.to_owned() })
    }

    /// Returns the name of the image of a square; `None` when the numbering does not reach it.
    pub fn of(&self, square: Square) -> Option<String> {
        Some(format!("{}{}{}", self.before, self.mark.write(square)?, self.after))
    }

    /// Returns the files of the set by their squares, for a name that is a path.
    pub fn files(&self) -> BTreeMap<Square, PathBuf> {
        self.names_in(Path::new(""), &Files::default())
            .into_iter()
            .map(|(square, name)| (square, name.into()))
            .collect()
    }

    /// Returns the names of the set's files in the folders of a search path, by their squares. [`SearchPath::find`]
    /// finds each of them.
    pub fn names(&self, search: &SearchPath) -> BTreeMap<Square, String> {
        let name = &self.before;
        if Path::new(name).is_absolute() || name.starts_with("./") || name.starts_with("../") {
            return self.names_in(Path::new(""), search.files());
        }
        search.folders().iter().flat_map(|folder| self.names_in(folder, search.files())).collect()
    }

    fn names_in(&self, folder: &Path, files: &Files) -> BTreeMap<Square, String> {
        let (parents, begin) = match self.before.rsplit_once('/') {
            Some((parents, begin)) => (&self.before[..=parents.len()], begin),
            None => ("", &self.before[..]),
        };
        let folder = folder.join(parents);
        let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { &folder };
        // A folder that cannot be listed has no files that could be read.
        let Ok(entries) = std::fs::read_dir(files.place(folder)) else { return BTreeMap::new() };
        entries
            .filter_map(|entry| {
                let entry = entry.ok()?;
                let name = entry.file_name();
                let number = name.to_str()?.strip_prefix(begin)?.strip_suffix(&self.after)?;
                let square = self.mark.read(number)?;
                // A folder is not an image. The target of a link counts.
                if !entry.path().is_file() {
                    return None;
                }
                Some((square, self.of(square)?))
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_stand_for_squares() {
        let udim = UdimName::parse("a/wall.<UDIM>.tx").unwrap();
        let square = |column, row| Square { row, column };
        for (place, name) in [
            (square(0, 0), Some("a/wall.1001.tx")),
            (square(9, 0), Some("a/wall.1010.tx")),
            (square(2, 3), Some("a/wall.1033.tx")),
            (square(8, 899), Some("a/wall.9999.tx")),
            (square(9, 899), None),
            (square(10, 0), None),
            (square(0, u32::MAX), None),
        ] {
            assert_eq!(udim.of(place).as_deref(), name, "{place:?}");
        }
        let tile = UdimName::parse("<uvtile>.exr").unwrap();
        assert_eq!(tile.of(square(2, 10)).as_deref(), Some("u3_v11.exr"));
        for text in ["+1001", "01001", "1000", "10000", "100x", ""] {
            assert_eq!(Mark::Udim.read(text), None, "{text}");
        }
        for text in ["u0_v1", "u1_v01", "u1", "u1_v1_v1"] {
            assert_eq!(Mark::UvTile.read(text), None, "{text}");
        }
        assert_eq!(Mark::UvTile.read("u3_v11"), Some(square(2, 10)));
        for name in ["wall.1001.tx", "<UDIM>/wall.tx", "<Udim>.tx"] {
            assert_eq!(UdimName::parse(name), None, "{name}");
        }
    }

    #[test]
    fn sets_are_found_in_folders() {
        let folder = tempfile::tempdir().unwrap();
        let here = |name: &str| folder.path().join(name).to_string_lossy().into_owned();
        std::fs::create_dir_all(here("b")).unwrap();
        std::fs::create_dir_all(here("w.1003.tx")).unwrap();
        for name in ["w.1001.tx", "w.1012.tx", "w.12.tx", "w.1001.tif", "b/w.1002.tx"] {
            std::fs::write(here(name), "").unwrap();
        }
        let search = SearchPath::parse(&format!("{}:{}", here(""), here("b")), &SearchPath::default(), &{
            granita_base::Environment::empty()
        });
        let names = |name: &str| -> Vec<String> {
            UdimName::parse(name).unwrap().names(&search).into_values().collect()
        };
        assert_eq!(names("w.<UDIM>.tx"), ["w.1001.tx", "w.1002.tx", "w.1012.tx"]);
        assert_eq!(names("b/w.<UDIM>.tx"), ["b/w.1002.tx"]);
        assert_eq!(names(&here("w.<UDIM>.tif")), [here("w.1001.tif")]);
        assert!(names("v.<UDIM>.tx").is_empty());
        let files = UdimName::parse(&here("w.<UDIM>.tx")).unwrap().files();
        assert_eq!(
            files.into_values().collect::<Vec<_>>(),
            [here("w.1001.tx"), here("w.1012.tx")].map(PathBuf::from)
        );
    }
}
