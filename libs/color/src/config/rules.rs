//! Rules that find the colour space of a file by its name.

use super::Config;
use crate::model::RuleKind;

impl Config {
    /// Returns the name of the colour space that the rules of the configuration find for a file, by its name. Without
    /// rules it is that of the role "default". `None` where there is neither.
    pub fn space_of_file(&self, path: &str) -> Option<&str> {
        for rule in &self.model.file_rules {
            match &rule.kind {
                RuleKind::Glob { pattern, extension } => {
                    let path = path.replace('\\', "/");
                    let (stem, ending) = path.rsplit_once('.').unwrap_or((&path, ""));
                    if matches_glob(pattern.as_bytes(), stem.as_bytes())
                        && matches_glob(
                            extension.to_ascii_lowercase().as_bytes(),
                            ending.to_ascii_lowercase().as_bytes(),
                        )
                    {
                        return Some(&rule.space);
                    }
                }
                RuleKind::Regex(regex) if regex.is_match(path) => return Some(&rule.space),
                RuleKind::Regex(_) => {}
                RuleKind::NameInPath => {
                    if let Some(space) = self.space_in_path(path) {
                        return Some(space);
                    }
                }
                RuleKind::Default => return Some(&rule.space),
            }
        }
        self.role("default")
    }

    /// Returns the name of the colour space whose name or alias is in a path, the last one and of these the longest.
    pub fn space_in_path(&self, path: &str) -> Option<&str> {
        let path = path.to_ascii_lowercase();
        let mut best: Option<(usize, usize, &str)> = None;
        for space in &self.model.spaces {
            for name in std::iter::once(&space.name).chain(&space.aliases) {
                let Some(at) = path.rfind(&name.to_ascii_lowercase()) else { continue };
                let place = (at + name.len(), name.len());
                if best.is_none_or(|(end, length, _)| place > (end, length)) {
                    best = Some((place.0, place.1, &space.name));
                }
            }
        }
        best.map(|(_, _, name)| name)
    }
}

/// True when a text matches a pattern of `*`, `?`, `[abc]`, `[a-z]` and `[!abc]`.
fn matches_glob(pattern: &[u8], text: &[u8]) -> bool {
    // The last `*` that was passed, and where it began to match.
    let (mut p, mut t, mut star) = (0, 0, None);
    while t < text.len() {
        match one(&pattern[p..], text[t]) {
            Some(used) => {
                p += used;
                t += 1;
            }
            None if pattern.get(p) == Some(&b'*') => {
                star = Some((p, t));
                p += 1;
            }
            None => match star {
                Some((at, begun)) => {
                    star = Some((at, begun + 1));
                    p = at + 1;
                    t = begun + 1;
                }
                None => return false,
            },
        }
    }
    pattern[p..].iter().all(|c| *c == b'*')
}

/// Returns the length of the beginning of a pattern that matches one character; `None` if it does not.
fn one(pattern: &[u8], c: u8) -> Option<usize> {
    match pattern {
        [] | [b'*', ..] => None,
        [b'?', ..] => Some(1),
        [b'[', rest @ ..] => {
            let end = 1 + rest.iter().skip(1).position(|c| *c == b']')?;
            let (negated, set) = match &rest[..end] {
                [b'!' | b'^', set @ ..] => (true, set),
                set => (false, set),
            };
            let mut found = false;
            let mut i = 0;
            while i < set.len() {
                if i + 2 < set.len() && set[i + 1] == b'-' {
                    found |= (set[i]..=set[i + 2]).contains(&c);
                    i += 3;
                } else {
                    found |= set[i] == c;
                    i += 1;
                }
            }
            (found != negated).then_some(end + 2)
        }
        [first, ..] => (*first == c).then_some(1),
    }
}

#[cfg(test)]
mod tests {
    use super::matches_glob;

    #[test]
    fn patterns_match() {
        for (pattern, text, expected) in [
            ("*", "", true),
            ("*", "a/b", true),
            ("*/tex/*", "/x/tex/y", true),
            ("*/tex/*", "/x/te/y", false),
            ("a?c", "abc", true),
            ("a?c", "ac", false),
            ("[a-c]x", "bx", true),
            ("[!a-c]x", "bx", false),
            ("[ab]", "b", true),
            ("[", "[", false),
            ("a*b*c", "axxbxxbc", true),
            ("", "a", false),
        ] {
            assert_eq!(matches_glob(pattern.as_bytes(), text.as_bytes()), expected, "{pattern} {text}");
        }
    }
}
