//! The patterns of `Modify`: regular expressions of POSIX (reference 2.4), read with the `regex` crate.

use regex::Regex;

/// The characters that are operators of extended regular expressions and ordinary in basic ones.
const EXTENDED: [char; 6] = ['(', ')', '|', '+', '?', '{'];

/// Returns a basic regular expression; `None` when it cannot be read.
pub(super) fn basic(pattern: &str) -> Option<Regex> {
    Regex::new(&from_basic(pattern)).ok()
}

/// Checks a pattern of `Modify`.
///
/// # Errors
/// Returns a message when it cannot be read.
pub fn check_pattern(pattern: &str) -> Result<(), String> {
    let read = basic(pattern).or_else(|| extended(pattern));
    read.map(drop).ok_or_else(|| format!("cannot read the regular expression \"{pattern}\""))
}

/// Returns the pattern read as an extended regular expression; `None` when that is no different, or cannot be read.
pub(super) fn extended(pattern: &str) -> Option<Regex> {
    pattern.contains(EXTENDED).then(|| Regex::new(&from_extended(pattern)).ok()).flatten()
}

/// Converts a POSIX basic regular expression to the syntax of the `regex` crate.
///
/// In a basic expression `( ) { } + ? |` are ordinary characters and become special after a backslash, `*` is
/// ordinary at the beginning, and `^` and `$` are special at the ends only.
fn from_basic(pattern: &str) -> String {
    let mut out = String::with_capacity(pattern.len() + 8);
    let chars: Vec<char> = pattern.chars().collect();
    let mut start = true;
    let mut i = 0;
    while i < chars.len() {
        let c = chars[i];
        let mut begins = false;
        match c {
            '\\' => {
                i += 1;
                match chars.get(i) {
                    Some(&n @ ('(' | '{' | '}' | ')' | '+' | '?' | '|')) => {
                        begins = matches!(n, '(' | '|');
                        out.push(n);
                    }
                    // A back reference is passed on. The `regex` crate does not support it and reports an error.
                    Some(&n @ '1'..='9') => {
                        out.push('\\');
                        out.push(n);
                    }
                    Some(&n) => {
                        out.push_str(&regex::escape(&n.to_string()));
                    }
                    None => out.push_str("\\\\"),
                }
            }
            '(' | ')' | '{' | '}' | '+' | '?' | '|' => {
                out.push('\\');
                out.push(c);
            }
            '*' if start => out.push_str("\\*"),
            '^' if !start => out.push_str("\\^"),
            '^' => {
                out.push('^');
                begins = true;
            }
            '$' if i + 1 < chars.len()
                && !(chars[i + 1] == '\\' && matches!(chars.get(i + 2), Some(')' | '|'))) =>
            {
                out.push_str("\\$");
            }
            '[' => i = bracket(&chars, i, &mut out),
            _ => out.push(c),
        }
        start = begins;
        i += 1;
    }
    out
}

/// Converts a set in brackets that begins at an index. Returns the index of its last character.
///
/// The set ends at the closing bracket, which may also be the first character. Backslashes are ordinary inside.
fn bracket(chars: &[char], i: usize, out: &mut String) -> usize {
    // The set ends at the closing bracket, which may also be the first character. Backslashes are
    // ordinary inside.
    let mut end = i + 1;
    if chars.get(end) == Some(&'^') {
        end += 1;
    }
    if chars.get(end) == Some(&']') {
        end += 1;
    }
    while end < chars.len() && chars[end] != ']' {
        // Classes such as [:alpha:] contain a bracket.
        if chars[end] == '[' && chars.get(end + 1) == Some(&':') {
            end = (end + 2..chars.len()).find(|&k| chars[k] == ']').unwrap_or(chars.len());
        }
        end += 1;
    }
    let inside: Vec<char> = chars[i + 1..end.min(chars.len())].to_vec();
    out.push('[');
    for (k, &c) in inside.iter().enumerate() {
        let class = c == '[' && inside.get(k + 1) == Some(&':');
        let in_class = c == ']' && k > 0 && inside[k - 1] == ':';
        if (c == '\\' || c == '&' || c == '~' || c == '[' || c == ']') && !class && !in_class {
            out.push('\\');
        }
        out.push(c);
    }
    out.push(']');
    end
}

/// Converts a POSIX extended regular expression to the syntax of the `regex` crate. They differ in brackets, and in
/// backslashes before ordinary characters.
fn from_extended(pattern: &str) -> String {
    let mut out = String::with_capacity(pattern.len() + 8);
    let chars: Vec<char> = pattern.chars().collect();
    let mut i = 0;
    while i < chars.len() {
        match (chars[i], chars.get(i + 1)) {
            ('\\', Some(next)) => {
                i += 1;
                // A back reference is passed on. The `regex` crate does not support it and reports an error.
                let text = regex::escape(&next.to_string());
                out.push_str(&if next.is_ascii_digit() { format!("\\{next}") } else { text });
            }
            ('[', _) => i = bracket(&chars, i, &mut out),
            (c, _) => out.push(c),
        }
        i += 1;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn back_references_are_refused() {
        assert!(Regex::new(&from_basic("\\(a\\)\\1")).is_err());
    }

    #[test]
    fn basic_regular_expressions_are_converted() {
        let cases = [
            ("obj2", "an obj2 here", true),
            ("^obj2$", "obj21", false),
            ("a+b", "a+b", true),
            ("a+b", "aab", false),
            ("a\\+b", "aab", true),
            ("(x)", "(x)", true),
            ("\\(x\\)", "x", true),
            ("*a", "*a", true),
            ("a*$", "baaa", true),
            ("a\\{2\\}", "aa", true),
            ("a{2}", "aa", false),
            ("[]x]", "]", true),
            ("[^a-c]", "b", false),
            ("[[:digit:]]", "7", true),
            ("a.c", "abc", true),
            ("a\\.c", "abc", false),
            ("a\\|b", "b", true),
            ("", "anything", true),
            ("^*", "*", true),
        ];
        for (pattern, text, matches) in cases {
            let regex = Regex::new(&from_basic(pattern)).unwrap();
            assert_eq!(regex.is_match(text), matches, "{pattern:?} on {text:?}");
        }
    }

    #[test]
    fn extended_regular_expressions_are_converted() {
        let cases = [
            ("^truck4[0-9]/(fender)|(taillight)/.*", "truck42/fender/left", true),
            ("^truck4[0-9]/(fender)|(taillight)/.*", "truck45/door", false),
            ("a+b", "aab", true),
            ("a\\+b", "aab", false),
            ("a\\.(sm|env)$", "a.env", true),
            ("(a){2}", "aa", true),
            ("[]x]?y", "]y", true),
            ("[\\]+", "\\", true),
        ];
        for (pattern, text, matches) in cases {
            assert_eq!(extended(pattern).unwrap().is_match(text), matches, "{pattern:?} on {text:?}");
        }
        assert!(extended("^truck.*$").is_none() && extended("(").is_none() && extended("(a)\\1").is_none());
    }
}
