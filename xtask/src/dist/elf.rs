//! What programs and libraries need of a system, as `readelf` prints it.

use super::old_glibc;
use crate::files::answer;
use std::collections::BTreeSet;
use std::path::Path;
use std::process::Command;

/// A version, such as 2.28 or 3.4.21.
type Version = Vec<u32>;

/// The newest symbols of libstdc++ (3.4.N) by the glibc of the platforms of wheels (manylinux) that have them.
const LIBSTDCXX: [(u32, (u32, u32)); 4] = [(25, (2, 28)), (29, (2, 34)), (30, (2, 35)), (33, (2, 39))];

/// The libraries that a program needs, and the newest versions of their functions.
#[derive(Debug, Default, PartialEq, Eq)]
pub(super) struct Needs {
    pub(super) libraries: BTreeSet<String>,
    /// The version of glibc.
    pub(super) glibc: Version,
    /// The version of libstdc++, as its symbols name it.
    pub(super) glibcxx: Version,
}

impl Needs {
    /// Adds what another program needs.
    pub(super) fn merge(&mut self, other: Self) {
        self.libraries.extend(other.libraries);
        self.glibc = std::mem::take(&mut self.glibc).max(other.glibc);
        self.glibcxx = std::mem::take(&mut self.glibcxx).max(other.glibcxx);
    }

    /// Returns the glibc of the oldest systems that have all of this: what is needed, that of the systems with the
    /// needed libstdc++, or the version that is linked for, whichever is newest.
    pub(super) fn promised(&self) -> (u32, u32) {
        let at = |i: usize| self.glibc.get(i).copied().unwrap_or(0);
        let symbols = self.glibcxx.get(2).copied().unwrap_or(0);
        let row = LIBSTDCXX.iter().find(|(newest, _)| *newest >= symbols);
        (at(0), at(1)).max(row.map_or((u32::MAX, 0), |row| row.1)).max(old_glibc::VERSION)
    }
}

impl std::fmt::Display for Needs {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let text = |version: &Version| version.iter().map(u32::to_string).collect::<Vec<_>>().join(".");
        let libraries: Vec<&str> = self.libraries.iter().map(String::as_str).collect();
        let (glibc, glibcxx) = (text(&self.glibc), text(&self.glibcxx));
        write!(f, "needs glibc {glibc}, GLIBCXX_{glibcxx}; {}", libraries.join(" "))
    }
}

/// Returns what a program or library needs.
pub(super) fn needs(path: &Path) -> Result<Needs, String> {
    let text = answer(Command::new("readelf").env("LC_ALL", "C").args(["-W", "-d", "-V"]).arg(path))?;
    Ok(parsed(&text))
}

fn parsed(text: &str) -> Needs {
    let mut needs = Needs::default();
    for line in text.lines() {
        if let Some((_, rest)) = line.split_once("Shared library: [") {
            needs.libraries.extend(rest.split(']').next().map(str::to_owned));
        }
        let Some((_, rest)) = line.split_once(" Name: ") else { continue };
        let name = rest.split_whitespace().next().unwrap_or_default();
        let Some((library, version)) = name.split_once('_') else { continue };
        let version: Version = version.split('.').filter_map(|part| part.parse().ok()).collect();
        match library {
            "GLIBC" => needs.glibc = std::mem::take(&mut needs.glibc).max(version),
            "GLIBCXX" => needs.glibcxx = std::mem::take(&mut needs.glibcxx).max(version),
            _ => (),
        }
    }
    needs
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "\
 0x0000000000000001 (NEEDED)             Shared library: [libm.so.6]
 0x0000000000000001 (NEEDED)             Shared library: [libc.so.6]
Version needs section '.gnu.version_r' contains 2 entries:
 000000: Version: 1  File: libc.so.6  Cnt: 3
  0x0010:   Name: GLIBC_2.2.5  Flags: none  Version: 5
  0x0020:   Name: GLIBC_2.18  Flags: none  Version: 4
  0x0030:   Name: GLIBCXX_3.4.21  Flags: none  Version: 3
";

    #[test]
    fn the_newest_version_counts() {
        let mut needs = parsed(TEXT);
        assert_eq!((&needs.glibc[..], &needs.glibcxx[..]), (&[2, 18][..], &[3, 4, 21][..]));
        assert_eq!(needs.to_string(), "needs glibc 2.18, GLIBCXX_3.4.21; libc.so.6 libm.so.6");
        assert_eq!(needs.promised(), (2, 28));
        assert_eq!(parsed(&TEXT.replace("3.4.21", "3.4.29")).promised(), (2, 34));
        needs.merge(parsed(&TEXT.replace("2.18", "2.34").replace("libm.so.6", "libz.so.1")));
        assert_eq!((needs.promised(), needs.libraries.len()), ((2, 34), 3));
    }
}
