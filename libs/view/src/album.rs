//! Lists of images: the content of folders, in natural order, and sequences.

use granita_image::FormatRegistry;
use granita_texture::UdimName;
use std::cmp::Ordering;
use std::path::{Path, PathBuf};

/// The largest number of files that are taken from one folder.
const MOST: usize = 1 << 20;

/// Returns the files that `names` stand for. Files are unchanged. A folder is replaced by the files directly in it that
/// have an extension of a known format, in order. A set of images such as `wall.<UDIM>.tx` is replaced by its files, by
/// rows of squares. A missing file stays in the list, and opening it reports the error.
pub fn expand(names: &[PathBuf], formats: &FormatRegistry) -> Vec<PathBuf> {
    let mut out = Vec::new();
    for name in names {
        formats.files().add_named(name);
        if !name.is_dir() {
            let set = UdimName::parse(&name.to_string_lossy()).filter(|_| !name.exists());
            let files: Vec<PathBuf> = set.map(|set| set.files().into_values().collect()).unwrap_or_default();
            files.iter().for_each(|file| formats.files().grant(file));
            out.extend(if files.is_empty() { vec![name.clone()] } else { files });
            continue;
        }
        let known = |path: &Path| {
            let extension = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
            let is_known = |e: String| formats.formats().iter().any(|f| f.extensions().contains(&&*e));
            extension.is_some_and(|e| matches!(&*e, "tx" | "env" | "sm" | "shd") || is_known(e))
        };
        let mut found: Vec<PathBuf> = std::fs::read_dir(name)
            .into_iter()
            .flatten()
            .flatten()
            .map(|entry| entry.path())
            .filter(|path| known(path) && path.is_file())
            .take(MOST)
            .collect();
        found.sort_by(|a, b| in_order(&a.to_string_lossy(), &b.to_string_lossy()));
        // They may be links that lead elsewhere. Naming the folder permits them.
        found.iter().for_each(|file| formats.files().grant(file));
        out.extend(found);
    }
    out
}

/// Compares names in natural order, with numbers by their value.
pub fn in_order(a: &str, b: &str) -> Ordering {
    let (mut p, mut q) = (a, b);
    loop {
        let (x, y) = match (p.chars().next(), q.chars().next()) {
            (None, None) => return a.cmp(b),
            (None, _) => return Ordering::Less,
            (_, None) => return Ordering::Greater,
            (Some(x), Some(y)) => (x, y),
        };
        if x.is_ascii_digit() && y.is_ascii_digit() {
            let split = |s: &str| s.find(|c: char| !c.is_ascii_digit()).unwrap_or(s.len());
            let ((m, rest_p), (n, rest_q)) = (p.split_at(split(p)), q.split_at(split(q)));
            let (m, n) = (m.trim_start_matches('0'), n.trim_start_matches('0'));
            match m.len().cmp(&n.len()).then_with(|| m.cmp(n)) {
                Ordering::Equal => (p, q) = (rest_p, rest_q),
                other => return other,
            }
            continue;
        }
        match x.to_ascii_lowercase().cmp(&y.to_ascii_lowercase()) {
            Ordering::Equal => (p, q) = (&p[x.len_utf8()..], &q[y.len_utf8()..]),
            other => return other,
        }
    }
}

/// Consecutive entries of a list that belong together.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Group {
    /// The common title: `folder/name.#.exr` for frames of a sequence, else the folder.
    pub title: String,
    /// The index of the first entry.
    pub first: usize,
    /// The number of entries.
    pub count: usize,
}

/// Returns the name with its last number replaced by "#". Frames of one sequence have the same result.
fn pattern(path: &Path) -> Option<String> {
    let name = path.file_name()?.to_str()?;
    let end = name.rfind(|c: char| c.is_ascii_digit())? + 1;
    let start = name[..end].rfind(|c: char| !c.is_ascii_digit()).map_or(0, |i| i + 1);
    // A number in an extension ("a.jp2") is not that of a frame.
    let extension = name.rfind('.').unwrap_or(name.len());
    (start < extension).then(|| format!("{}#{}", &name[..start], &name[end..]))
}

/// Groups a list into runs of three or more frames of a sequence, and otherwise into the files of one folder.
pub fn groups(list: &[PathBuf]) -> Vec<Group> {
    let folder = |path: &Path| path.parent().map(|p| p.display().to_string()).unwrap_or_default();
    let key = |i: usize| (folder(&list[i]), pattern(&list[i]));
    let mut out: Vec<Group> = Vec::new();
    let mut i = 0;
    while i < list.len() {
        let (place, sequence) = key(i);
        let run = sequence.as_ref().map_or(1, |_| {
            (i..list.len()).take_while(|j| key(*j) == (place.clone(), sequence.clone())).count()
        });
        if let Some(sequence) = sequence.filter(|_| run >= 3) {
            let title = Path::new(&place).join(sequence).display().to_string();
            out.push(Group { title, first: i, count: run });
            i += run;
            continue;
        }
        match out.last_mut().filter(|g| g.title == place && g.first + g.count == i) {
            Some(group) => group.count += 1,
            None => out.push(Group { title: place, first: i, count: 1 }),
        }
        i += 1;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_sorted_with_numbers_by_value() {
        let mut names = ["b10", "b9", "B1", "a", "b09x", "b", "b9"];
        names.sort_by(|a, b| in_order(a, b));
        assert_eq!(names, ["a", "b", "B1", "b9", "b9", "b09x", "b10"]);
        assert_eq!(in_order("a01", "a1"), Ordering::Less, "never equal unless they are");
    }

    #[test]
    fn sets_of_images_stand_for_their_files() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["wall.1011.tx", "wall.1002.tx", "wall.1001.tx", "wall.12.tx", "other.1001.tx"] {
            std::fs::write(folder.path().join(name), b"").unwrap();
        }
        let formats = granita_plugin::bundled_formats(granita_image::Limits::default());
        let of = |name: &str| expand(&[folder.path().join(name)], &formats);
        let files = ["wall.1001.tx", "wall.1002.tx", "wall.1011.tx"].map(|name| folder.path().join(name));
        assert_eq!(of("wall.<UDIM>.tx"), files);
        assert_eq!(of("none.<UDIM>.tx"), [folder.path().join("none.<UDIM>.tx")]);
        let mark = folder.path().join("wall.<UDIM>.tx");
        std::fs::write(&mark, b"").unwrap();
        assert_eq!(of("wall.<UDIM>.tx"), [mark]);
    }

    #[test]
    fn image_sequences_are_grouped() {
        let names = ["d/x.1.exr", "d/x.2.exr", "d/x.3.exr", "d/a.png", "d/b2.png", "e/c.png"];
        let list: Vec<PathBuf> = names.iter().map(PathBuf::from).collect();
        let g = groups(&list);
        let titles: Vec<(&str, usize)> = g.iter().map(|g| (&*g.title, g.count)).collect();
        assert_eq!(titles, [("d/x.#.exr", 3), ("d", 2), ("e", 1)]);
        assert_eq!(pattern(Path::new("a.jp2")), None);
        assert!(groups(&[]).is_empty());
    }
}
