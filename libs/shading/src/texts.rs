//! Texts that shaders write to files with `fprintf` (reference 5.8.9).
//!
//! Threads shade grids in no fixed order. The texts of a frame are therefore kept until its end and written sorted
//! by object, ray level and grid, and within one run of a shader in the order of its calls. A file then holds the
//! same lines in the same order for any number of threads. When the texts exceed [`MAX_BYTES`], they are written at
//! once.

use granita_base::{Files, Reporter};
use parking_lot::Mutex;
use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;
use std::sync::Arc;

/// The largest number of bytes of text that is kept until the end of the frame.
const MAX_BYTES: usize = 64 << 20;

/// The sort key of a text within its file.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Key {
    /// The name of the object or light.
    pub(crate) owner: Arc<str>,
    /// The ray level of the grid.
    pub(crate) level: u32,
    /// The seed of the grid, which identifies its place.
    pub(crate) seed: u32,
    /// The number of texts that this run of the shader wrote before.
    pub(crate) index: u32,
}

/// The texts of a frame by file name.
#[derive(Debug, Default)]
pub(crate) struct Texts(Mutex<Kept>);

#[derive(Debug, Default)]
struct Kept {
    files: BTreeMap<String, Vec<(Key, String)>>,
    bytes: usize,
}

impl Texts {
    /// Keeps a text for the file `name`.
    pub(crate) fn add(&self, name: &str, key: Key, text: &str, files: &Files, reporter: &Reporter) {
        let mut kept = self.0.lock();
        kept.bytes += text.len() + size_of::<(Key, String)>();
        kept.files.entry(name.to_owned()).or_default().push((key, text.to_owned()));
        if kept.bytes > MAX_BYTES {
            write(&mut kept, files, reporter);
        }
    }

    /// Appends all texts to their files. Returns false when one could not be written, which is reported.
    pub(crate) fn finish(&self, files: &Files, reporter: &Reporter) -> bool {
        write(&mut self.0.lock(), files, reporter)
    }
}

fn write(kept: &mut Kept, files: &Files, reporter: &Reporter) -> bool {
    let mut all = true;
    for (name, mut list) in std::mem::take(&mut kept.files) {
        list.sort();
        let text: String = list.into_iter().map(|(_, text)| text).collect();
        let written = files
            .append(Path::new(&name))
            .map_err(|e| e.to_string())
            .and_then(|mut file| file.write_all(text.as_bytes()).map_err(|e| format!("{name}: {e}")));
        if let Err(error) = written {
            reporter.error(format!("fprintf: {error}"));
            all = false;
        }
    }
    kept.bytes = 0;
    all
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_files_do_not_depend_on_the_order_of_arrival() {
        let folder = tempfile::tempdir().unwrap();
        let name = folder.path().join("log.txt");
        let name = name.to_str().unwrap();
        std::fs::write(name, "before\n").unwrap();
        let key = |owner: &str, seed, index| Key { owner: owner.into(), level: 0, seed, index };
        let (files, reporter) = (Files::default(), Reporter::silent());
        let lines = [("b", 1, 0, "4\n"), ("a", 2, 0, "3\n"), ("a", 1, 1, "2\n"), ("a", 1, 0, "1\n")];
        for turn in 0..2 {
            let texts = Texts::default();
            let mut order: Vec<_> = lines.to_vec();
            order.rotate_left(turn);
            for (owner, seed, index, text) in order {
                texts.add(name, key(owner, seed, index), text, &files, &reporter);
            }
            assert!(texts.finish(&files, &reporter));
        }
        assert_eq!(std::fs::read_to_string(name).unwrap(), "before\n1\n2\n3\n4\n1\n2\n3\n4\n");
        let (reporter, kept) = Reporter::collecting();
        let texts = Texts::default();
        texts.add(folder.path().to_str().unwrap(), key("a", 0, 0), "x", &files, &reporter);
        assert!(!texts.finish(&files, &reporter) && kept.lock().len() == 1);
    }
}
