//! The files that shaders read, and whether they changed since the last frame (reference 4.3.3).

use granita_base::{FileStamp, Location, Reporter, SearchPath, Severity, parallel_map};
use granita_texture::UdimName;
use parking_lot::Mutex;
use regex::Regex;
use std::collections::{BTreeSet, HashMap};

/// The names of the files that shaders asked for, with a number each, and the state in which they were found.
#[derive(Debug, Default)]
pub(crate) struct FilesUsed {
    path: SearchPath,
    known: Mutex<Known>,
}

#[derive(Debug, Default)]
struct Known {
    numbers: HashMap<String, u32>,
    /// By number: the name, and the stamps when it was looked at last: one for a file, one for each file of a set, none
    /// when there was no file.
    stamps: Vec<(String, Vec<FileStamp>)>,
    /// The numbers of the files that displacements read.
    of_shapes: BTreeSet<u32>,
}

impl FilesUsed {
    /// Returns an empty list. Files are found along `path`.
    pub(crate) fn new(path: SearchPath) -> Self {
        Self { path, known: Mutex::default() }
    }

    /// Returns the number of a name. The file is looked at when the name is new.
    pub(crate) fn number(&self, name: &str) -> u32 {
        let mut known = self.known.lock();
        if let Some(number) = known.numbers.get(name) {
            return *number;
        }
        let number = known.stamps.len() as u32;
        known.numbers.insert(name.to_owned(), number);
        let stamps = self.stamps(name);
        known.stamps.push((name.to_owned(), stamps));
        number
    }

    /// Notes that a displacement shader reads a file.
    pub(crate) fn shapes(&self, number: u32) {
        self.known.lock().of_shapes.insert(number);
    }

    /// True when displacement shaders read one of these files.
    pub(crate) fn changes_shapes(&self, numbers: &[u32]) -> bool {
        let known = self.known.lock();
        numbers.iter().any(|number| known.of_shapes.contains(number))
    }

    /// Returns the numbers of all names.
    pub(crate) fn all(&self) -> std::ops::Range<u32> {
        0..self.known.lock().stamps.len() as u32
    }

    /// Sets the path along which files are found.
    pub(crate) fn set_path(&mut self, path: SearchPath) {
        self.path = path;
    }

    fn stamps(&self, name: &str) -> Vec<FileStamp> {
        let stamp = |name: &str| self.path.files().stamp(&self.path.find(name)?);
        match (stamp(name), UdimName::parse(name)) {
            (None, Some(set)) => set.names(&self.path).values().filter_map(|name| stamp(name)).collect(),
            (stamp, _) => stamp.into_iter().collect(),
        }
    }

    /// Looks again at the files whose names match a regular expression. Returns the numbers of those that changed. A
    /// file that is not there any more is reported, and what was read from it stays.
    pub(crate) fn changed(&self, pattern: &str, threads: usize, reporter: &Reporter) -> Vec<u32> {
        let regex = Regex::new(pattern)
            .inspect_err(|_| {
                let text = format!(
                    "\"rerender:filepattern\": cannot read the regular expression \"{pattern}\"; all files are checked"
                );
                reporter.once(&text, Severity::Warning, &Location::default(), text.clone());
            })
            .ok();
        let mut known = self.known.lock();
        let asked: Vec<(usize, String)> = known
            .stamps
            .iter()
            .enumerate()
            .filter(|(_, (name, _))| regex.as_ref().is_none_or(|regex| regex.is_match(name)))
            .map(|(number, (name, _))| (number, name.clone()))
            .collect();
        let stamps = parallel_map(asked, threads, || (), |(), (number, name)| (number, self.stamps(&name)));
        let mut changed = Vec::new();
        for (number, stamp) in stamps {
            let (name, before) = &mut known.stamps[number];
            match (&before[..], &stamp[..]) {
                ([_, ..], []) => {
                    let text = format!("\"{name}\" is not there any more; what was read from it is used");
                    reporter.say(Severity::Warning, &Location::default(), text);
                }
                _ if *before != stamp => {
                    *before = stamp;
                    changed.push(number as u32);
                }
                _ => {}
            }
        }
        changed
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_base::Environment;

    #[test]
    fn files_that_changed_and_match_the_pattern_are_found() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
        write("a.sm", "1");
        write("b.tx", "1");
        let path =
            SearchPath::parse(folder.path().to_str().unwrap(), &SearchPath::default(), &Environment::empty());
        let (reporter, files) = (Reporter::silent(), FilesUsed::new(path));
        assert_eq!(["a.sm", "b.tx", "a.sm", "none.tx"].map(|name| files.number(name)), [0, 1, 0, 2]);
        assert_eq!(files.changed(".*", 1, &reporter), [0_u32; 0]);
        write("a.sm", "12");
        write("b.tx", "12");
        assert_eq!(files.changed(r".*\.(sm)|(env)", 2, &reporter), [0]);
        assert_eq!(files.changed(".*", 2, &reporter), [1]);
        // A file that is gone is reported. One that appears counts as changed.
        std::fs::remove_file(folder.path().join("a.sm")).unwrap();
        write("none.tx", "1");
        assert_eq!(files.changed("", 2, &reporter), [2]);
        assert!(files.changed(".*", 1, &reporter).is_empty());
    }

    #[test]
    fn sets_change_with_each_of_their_files() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
        write("w.1001.tx", "1");
        write("w.1002.tx", "1");
        let path =
            SearchPath::parse(folder.path().to_str().unwrap(), &SearchPath::default(), &Environment::empty());
        let (reporter, files) = (Reporter::silent(), FilesUsed::new(path));
        assert_eq!(files.number("w.<UDIM>.tx"), 0);
        assert!(files.changed(".*", 1, &reporter).is_empty());
        write("w.1002.tx", "12");
        assert_eq!(files.changed(".*", 1, &reporter), [0]);
        write("w.1011.tx", "1");
        assert_eq!(files.changed(".*", 1, &reporter), [0], "a new file");
        write("w.tx", "1");
        assert!(files.changed(".*", 1, &reporter).is_empty(), "not a file of the set");
    }
}
