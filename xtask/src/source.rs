//! Reads Rust files for the checks, as the tokens of their code, without comments, documentation and tests.

use crate::workspace::Workspace;
use proc_macro2::{Delimiter, Group, TokenStream, TokenTree};
use std::path::{Path, PathBuf};

/// A token of code.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Token {
    /// The line, counted from 1.
    pub(crate) line: usize,
    pub(crate) kind: Kind,
}

/// The kind of a token. A sign of several characters is several tokens.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    /// An identifier or a keyword.
    Word(String),
    /// A character, including brackets.
    Sign(char),
    /// The value of a text literal.
    Text(String),
    /// Another literal.
    Number,
}

/// A Rust file.
#[derive(Debug)]
pub(crate) struct Source {
    /// The path relative to the root of the workspace.
    pub(crate) file: PathBuf,
    pub(crate) text: String,
    /// True when all of its code is for tests, benches or examples.
    pub(crate) is_test: bool,
    /// Its code without the parts that are compiled for tests only. Empty for a file of tests.
    pub(crate) code: Vec<Token>,
    /// Its code including tests.
    pub(crate) all: Vec<Token>,
}

impl Source {
    /// Reads a file.
    ///
    /// # Errors
    /// Returns an error when the text is not Rust.
    pub(crate) fn new(file: PathBuf, text: String) -> Result<Self, String> {
        let stream: TokenStream = text.parse().map_err(|e| format!("{}: {e}", file.display()))?;
        let is_test = is_test(&file);
        let (mut code, mut all) = (Vec::new(), Vec::new());
        if !is_test {
            flatten(stream.clone(), false, &mut code);
        }
        flatten(stream, true, &mut all);
        Ok(Self { file, text, is_test, code, all })
    }

    /// True when the line, or a comment directly above it, contains this mark. The mark gives the reason why a check
    /// does not apply.
    pub(crate) fn is_marked(&self, line: usize, mark: &str) -> bool {
        let lines: Vec<&str> = self.text.lines().take(line).collect();
        let above = lines.iter().rev().skip(1).take_while(|l| l.trim_start().starts_with("//"));
        lines.last().into_iter().chain(above).any(|l| l.contains(mark))
    }
}

/// Returns all Rust files of the workspace.
///
/// # Errors
/// Returns an error when git fails, or when a file is not Rust.
pub(crate) fn load(workspace: &Workspace) -> Result<Vec<Source>, String> {
    let files = workspace.files()?.into_iter().filter(|file| file.extension().is_some_and(|e| e == "rs"));
    let sources = files.filter_map(|file| workspace.text(&file).map(|text| Source::new(file, text)));
    let mut sources = sources.collect::<Result<Vec<Source>, String>>()?;
    let of_tests: Vec<PathBuf> = sources.iter().flat_map(modules_of_tests).collect();
    for source in sources.iter_mut().filter(|source| of_tests.contains(&source.file)) {
        source.is_test = true;
        source.code.clear();
    }
    Ok(sources)
}

/// Returns the files of modules that a file declares for tests only, whether they exist or not.
fn modules_of_tests(source: &Source) -> Vec<PathBuf> {
    let folder = match source.file.file_stem().and_then(|stem| stem.to_str()) {
        Some("lib" | "main" | "mod") => source.file.parent().map(Path::to_owned).unwrap_or_default(),
        _ => source.file.with_extension(""),
    };
    let mut lines = source.text.lines();
    let mut files = Vec::new();
    while let Some(line) = lines.next() {
        if line.trim() != "#[cfg(test)]" {
            continue;
        }
        let item = lines.next().unwrap_or_default().trim();
        if let Some((_, name)) = item.strip_suffix(';').and_then(|item| item.rsplit_once("mod ")) {
            files.extend([folder.join(name).with_extension("rs"), folder.join(name).join("mod.rs")]);
        }
    }
    files
}

/// True for files that belong only to tests, benches or examples, and for build scripts.
pub(crate) fn is_test(file: &Path) -> bool {
    const FOLDERS: [&str; 4] = ["tests", "benches", "examples", "fuzz"];
    let stem = file.file_stem().unwrap_or_default().to_string_lossy();
    stem == "tests"
        || stem.ends_with("_tests")
        || stem == "build" && file.components().all(|part| part.as_os_str() != "src")
        || file.components().any(|part| FOLDERS.iter().any(|folder| part.as_os_str() == *folder))
}

/// Appends the tokens of a stream, in order.
fn flatten(stream: TokenStream, tests: bool, out: &mut Vec<Token>) {
    let mut trees = stream.into_iter().peekable();
    while let Some(tree) = trees.next() {
        let line = tree.span().start().line;
        let mut put = |kind| out.push(Token { line, kind });
        match tree {
            TokenTree::Punct(sign) if sign.as_char() == '#' => {
                let inner = matches!(trees.peek(), Some(TokenTree::Punct(p)) if p.as_char() == '!');
                if inner {
                    trees.next();
                }
                let attribute = match trees.peek() {
                    Some(TokenTree::Group(group)) if group.delimiter() == Delimiter::Bracket => group.clone(),
                    _ => {
                        put(Kind::Sign('#'));
                        continue;
                    }
                };
                trees.next();
                match attribute_kind(&attribute) {
                    Attribute::Doc => {}
                    Attribute::Test if !tests && inner => return,
                    Attribute::Test if !tests => skip_item(&mut trees),
                    _ => flatten(attribute.stream(), tests, out),
                }
            }
            TokenTree::Group(group) => {
                let (open, close) = match group.delimiter() {
                    Delimiter::Parenthesis => ('(', ')'),
                    Delimiter::Brace => ('{', '}'),
                    Delimiter::Bracket => ('[', ']'),
                    Delimiter::None => (' ', ' '),
                };
                put(Kind::Sign(open));
                flatten(group.stream(), tests, out);
                out.push(Token { line: group.span_close().end().line, kind: Kind::Sign(close) });
            }
            TokenTree::Ident(word) => put(Kind::Word(word.to_string())),
            TokenTree::Punct(sign) => put(Kind::Sign(sign.as_char())),
            TokenTree::Literal(literal) => match syn::Lit::new(literal) {
                syn::Lit::Str(text) => put(Kind::Text(text.value())),
                _ => put(Kind::Number),
            },
        }
    }
}

/// The meaning of an attribute, as far as the checks need it.
enum Attribute {
    Doc,
    /// `cfg (test)`, or `cfg (all (test, ...))`.
    Test,
    Other,
}

fn attribute_kind(attribute: &Group) -> Attribute {
    let trees: Vec<TokenTree> = attribute.stream().into_iter().collect();
    let word = |tree: &TokenTree, name: &str| matches!(tree, TokenTree::Ident(word) if word == name);
    match trees.as_slice() {
        [first, ..] if word(first, "doc") => Attribute::Doc,
        [first, TokenTree::Group(group)] if word(first, "cfg") => {
            let inside: Vec<TokenTree> = group.stream().into_iter().collect();
            let is_test = match inside.as_slice() {
                [only] => word(only, "test"),
                [all, TokenTree::Group(list)] if word(all, "all") => {
                    list.stream().into_iter().any(|tree| word(&tree, "test"))
                }
                _ => false,
            };
            if is_test { Attribute::Test } else { Attribute::Other }
        }
        _ => Attribute::Other,
    }
}

/// Skips an item, a statement, a field or an arm, with its further attributes.
fn skip_item(trees: &mut std::iter::Peekable<proc_macro2::token_stream::IntoIter>) {
    let mut depth = 0_i32;
    let mut last = ' ';
    for tree in trees.by_ref() {
        let own = match &tree {
            TokenTree::Group(group) if group.delimiter() == Delimiter::Brace => return,
            TokenTree::Punct(sign) => sign.as_char(),
            _ => ' ',
        };
        match own {
            ';' => return,
            ',' if depth <= 0 => return,
            '<' => depth += 1,
            '>' if !matches!(last, '-' | '=') => depth -= 1,
            _ => {}
        }
        last = own;
    }
}

/// Returns the words of tokens, each with its line. A path such as `std::env::var` is a list of its segments.
pub(crate) fn paths(tokens: &[Token]) -> Vec<(usize, Vec<&str>)> {
    let mut paths = Vec::new();
    path_of(tokens, 0, &[], &mut paths);
    paths
}

/// Reads paths from `at` on, after `prefix`. Returns the index of the end of a tree of `use`.
fn path_of<'a>(
    tokens: &'a [Token],
    mut at: usize,
    prefix: &[&'a str],
    out: &mut Vec<(usize, Vec<&'a str>)>,
) -> usize {
    let sign = |at: usize, c: char| tokens.get(at).is_some_and(|t| t.kind == Kind::Sign(c));
    while at < tokens.len() {
        if !prefix.is_empty() && sign(at, '}') {
            return at + 1;
        }
        let Kind::Word(first) = &tokens[at].kind else {
            at += 1;
            continue;
        };
        let line = tokens[at].line;
        let mut path = [prefix, &[first.as_str()]].concat();
        at += 1;
        let mut ends = false;
        while !ends && sign(at, ':') && sign(at + 1, ':') {
            match tokens.get(at + 2).map(|t| &t.kind) {
                Some(Kind::Word(next)) => {
                    path.push(next);
                    at += 3;
                }
                Some(Kind::Sign('{')) => {
                    at = path_of(tokens, at + 3, &path, out);
                    ends = true;
                }
                _ => {
                    at += 2;
                    ends = true;
                }
            }
        }
        out.push((line, path));
    }
    at
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(code: &str) -> Vec<String> {
        let source = Source::new(PathBuf::from("src/a.rs"), code.to_owned()).unwrap();
        let text = |t: &Token| match &t.kind {
            Kind::Text(text) => Some(format!("{}{text}", t.line)),
            _ => None,
        };
        source.code.iter().filter_map(text).collect()
    }

    #[test]
    fn build_scripts_count_as_tests_beside_their_manifest() {
        assert!(is_test(Path::new("libs/plugin/build.rs")));
        assert!(!is_test(Path::new("libs/rays/src/mesh/build.rs")));
    }

    #[test]
    fn comments_and_tests_are_not_searched_for_strings() {
        let code = "//! \"no\"\n/// \"no\"\nfn a() { f(\"a\"); /* \"no\" */ }\n#[cfg(test)]\nmod tests { fn a() { f(\"no\") } }\n\
                    fn b() { f(r#\"b\"#) }\n#[cfg(test)]\n#[allow(x)]\nfn c<A, B>(a: A) -> B { f(\"no\") }\nfn d() { f(\"d\") }\n\
                    struct S { #[cfg(test)] a: Vec<(A, B)>, b: B }\n#[cfg(not(test))]\nconst E: &str = \"e\";\n\
                    #[cfg(all(test, unix))]\nuse no::no;\nconst F: &str = \"f\";";
        assert_eq!(texts(code), ["3a", "6b", "10d", "13e", "16f"]);
        assert!(texts("#![cfg(test)] const A: &str = \"no\";").is_empty());
        let test = Source::new(PathBuf::from("tests/a.rs"), "f(\"a\")".to_owned()).unwrap();
        assert!(test.code.is_empty() && test.all.len() == 4);
    }

    #[test]
    fn modules_of_tests_are_found() {
        let text = "mod a;\n#[cfg(test)]\nmod scenes;\n#[cfg(test)]\nmod b {}";
        for (file, module) in [("src/x.rs", "src/x/scenes.rs"), ("src/x/mod.rs", "src/x/scenes.rs")] {
            let source = Source::new(PathBuf::from(file), text.to_owned()).unwrap();
            assert_eq!(modules_of_tests(&source), [Path::new(module), Path::new("src/x/scenes/mod.rs")]);
        }
    }

    #[test]
    fn paths_in_braces_are_resolved() {
        let code = "use std::{env::{self, var}, io}; fn f() { std::process::exit(1); env::vars::<A>() }";
        let source = Source::new(PathBuf::from("src/a.rs"), code.to_owned()).unwrap();
        let paths: Vec<String> = paths(&source.code).into_iter().map(|(_, path)| path.join("::")).collect();
        for path in ["std::env::self", "std::env::var", "std::io", "std::process::exit", "env::vars"] {
            assert!(paths.iter().any(|p| p == path), "{path}: {paths:?}");
        }
        assert!(!paths.iter().any(|p| p == "std::fn"));
    }

    #[test]
    fn marks_apply_to_their_line_and_the_next() {
        let text = "// tidy: x: why\n// more\na();\nb();\nc(); // tidy: x: why";
        let source = Source::new(PathBuf::from("src/a.rs"), text.to_owned()).unwrap();
        let marked: Vec<bool> = (3..6).map(|line| source.is_marked(line, "tidy: x: ")).collect();
        assert_eq!(marked, [true, false, true]);
    }
}
