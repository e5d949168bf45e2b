// tidy: long: directives and macros take turns in reading one stream of tokens
//! The preprocessor, which processes `#include`, macros, conditions and line markers (reference 5.1.5, 8.2.2).
//!
//! It processes tokens and not text, so that every token has its source position. A token from a macro has the
//! position where the macro was used. Expansion follows D. Prosser's algorithm with sets of hidden names (the one
//! that the C standard describes in words).

use crate::CompileOptions;
use crate::condition;
use crate::diagnostic::{Diagnostics, suggestion};
use crate::source::Pos;
use crate::token::{Raw, RawKind, Token, TokenKind, mark, number, scan, unescape};
use std::collections::BTreeMap;
use std::sync::Arc;

/// The largest depth of included files.
const MAX_INCLUDES: usize = 64;
/// The largest depth of macro calls within arguments of macro calls.
const MAX_CALLS: usize = 100;
/// The largest number of tokens that are processed in all. It stops macros that grow without bound.
const MAX_TOKENS: usize = 1_000_000;

#[derive(Clone, Debug)]
struct Macro {
    /// The names of the arguments; `None` when it is not function-like.
    params: Option<Vec<Arc<str>>>,
    /// True when the last parameter takes all further arguments.
    variadic: bool,
    body: Vec<Raw>,
}

/// Converts a source file to tokens. The last one is [`TokenKind::End`]. Errors go to `diags`. Returns `None` after an
/// error in a directive or a macro, without which the rest of the source cannot be understood.
pub(crate) fn preprocess(
    source: &str,
    file: &str,
    options: &CompileOptions<'_>,
    diags: &mut Diagnostics,
) -> Option<Vec<Token>> {
    let mut pre =
        Preprocessor { options, diags, macros: BTreeMap::new(), out: Vec::new(), budget: MAX_TOKENS };
    pre.predefine();
    let end = pre.file(source, file, 0, Pos::default());
    let raw = std::mem::take(&mut pre.out);
    let is_sound = !pre.diags.has_errors();
    let tokens = finish(raw, end, pre.diags);
    is_sound.then_some(tokens)
}

struct Preprocessor<'a> {
    options: &'a CompileOptions<'a>,
    diags: &'a mut Diagnostics,
    macros: BTreeMap<Arc<str>, Macro>,
    out: Vec<Raw>,
    budget: usize,
}

/// An open `#if`.
struct Condition {
    pos: Pos,
    /// True when this branch and all around it are compiled.
    active: bool,
    /// True when a branch was compiled, or when the whole is in skipped text.
    done: bool,
    seen_else: bool,
}

impl Preprocessor<'_> {
    fn predefine(&mut self) {
        let one = |pre: &mut Self, name: &str, value: &str| {
            let Some(file) = pre.diags.sources.add("<command line>", value) else { return };
            let body = scan(value, file);
            pre.macros.insert(name.into(), Macro { params: None, variadic: false, body });
        };
        one(self, "GELATO", "1");
        for (name, value) in self.options.defines {
            one(self, name, value.as_deref().unwrap_or("1"));
        }
        for name in self.options.undefines {
            self.macros.remove(name.as_str());
        }
    }

    /// Processes a file. Returns the position of its end. `from` is the directive that included it.
    fn file(&mut self, text: &str, name: &str, depth: usize, from: Pos) -> Pos {
        let Some(index) = self.diags.sources.add(name, text) else {
            self.diags.error(from, "too many files are included");
            return from;
        };
        let tokens = scan(text, index);
        let lines = text.lines().count().max(1);
        let column = text.lines().last().map_or(0, |l| l.chars().count());
        let end = Pos { file: index, line: lines as u32, column: column as u32 + 1 };
        let mut conditions: Vec<Condition> = Vec::new();
        let mut at = 0;
        while at < tokens.len() && self.budget > 0 {
            let active = conditions.last().is_none_or(|c| c.active);
            if tokens[at].first && tokens[at].is("#") {
                let stop = line_end(&tokens, at + 1);
                self.directive(&tokens[at], &tokens[at + 1..stop], &mut conditions, depth);
                at = stop;
                continue;
            }
            let stop = (at + 1..tokens.len())
                .find(|&i| tokens[i].first && tokens[i].is("#"))
                .unwrap_or(tokens.len());
            if active {
                let expanded = self.expand(tokens[at..stop].to_vec(), 0);
                self.out.extend(expanded);
            }
            at = stop;
        }
        if let Some(open) = conditions.last() {
            self.diags.error(open.pos, "this condition has no `#endif`");
        }
        end
    }

    fn directive(&mut self, hash: &Raw, line: &[Raw], conditions: &mut Vec<Condition>, depth: usize) {
        let active = conditions.last().is_none_or(|c| c.active);
        let Some((name, rest)) = line.split_first() else { return };
        let pos = name.pos;
        if name.kind == RawKind::Number {
            // This is `# 12 "file"`, as preprocessors write it.
            if active {
                self.line_marker(name, rest);
            }
            return;
        }
        match &*name.text {
            "if" | "ifdef" | "ifndef" => {
                let value = active && self.condition(name, rest);
                conditions.push(Condition { pos, active: value, done: value || !active, seen_else: false });
            }
            "elif" | "else" => {
                let Some(last) = conditions.last_mut() else {
                    self.diags.error(pos, format!("`#{}` without `#if`", name.text));
                    return;
                };
                if last.seen_else {
                    self.diags.error(pos, format!("`#{}` after `#else`", name.text));
                    return;
                }
                let taken = last.done;
                last.seen_else = &*name.text == "else";
                last.active = false;
                if !taken {
                    let value = &*name.text == "else" || self.condition(name, rest);
                    if let Some(last) = conditions.last_mut() {
                        (last.active, last.done) = (value, value);
                    }
                }
            }
            "endif" => {
                if conditions.pop().is_none() {
                    self.diags.error(pos, "`#endif` without `#if`");
                }
            }
            _ if !active => {}
            "include" => self.include(name, rest, depth),
            "define" => self.define(name, rest),
            "undef" => match rest {
                [word] if word.kind == RawKind::Word => {
                    self.macros.remove(&word.text);
                }
                _ => self.diags.error(pos, "`#undef` needs one name"),
            },
            "line" => {
                let rest = self.expand(rest.to_vec(), 0);
                match rest.split_first() {
                    Some((first, rest)) if first.kind == RawKind::Number => self.line_marker(first, rest),
                    _ => self.diags.error(pos, "`#line` needs a line number"),
                }
            }
            "error" => self.diags.error(pos, spell(rest)),
            "warning" => self.diags.warning(pos, spell(rest)),
            "pragma" | "ident" => {}
            other => {
                let known = [
                    "if", "ifdef", "ifndef", "elif", "else", "endif", "include", "define", "undef", "line",
                    "error", "warning", "pragma",
                ];
                let help = suggestion(other, known.into_iter());
                self.diags.error_help(hash.pos, format!("unknown directive `#{other}`"), help);
            }
        }
    }

    fn line_marker(&mut self, line: &Raw, rest: &[Raw]) {
        let Ok(n) = line.text.parse::<u32>() else {
            self.diags.error(line.pos, format!("`{}` is not a line number", line.text));
            return;
        };
        let name = rest.first().filter(|t| t.kind == RawKind::Text).map(|t| unescape(inside(&t.text)).0);
        self.diags.sources.mark(line.pos, n, name.as_deref());
    }

    fn condition(&mut self, name: &Raw, rest: &[Raw]) -> bool {
        if &*name.text == "ifdef" || &*name.text == "ifndef" {
            let Some(word) = rest.first().filter(|w| w.kind == RawKind::Word) else {
                self.diags.error(name.pos, format!("`#{}` needs a name", name.text));
                return false;
            };
            return self.macros.contains_key(&word.text) == (&*name.text == "ifdef");
        }
        // `defined` takes names before they are replaced.
        let mut plain = Vec::with_capacity(rest.len());
        let mut i = 0;
        while i < rest.len() {
            let word = |j: usize| rest.get(j).filter(|w| w.kind == RawKind::Word);
            let found = match &*rest[i].text {
                "defined" if rest.get(i + 1).is_some_and(|t| t.is("(")) => {
                    word(i + 2).filter(|_| rest.get(i + 3).is_some_and(|t| t.is(")"))).map(|w| (w, 4))
                }
                "defined" => word(i + 1).map(|w| (w, 2)),
                _ => {
                    plain.push(rest[i].clone());
                    i += 1;
                    continue;
                }
            };
            let Some((word, used)) = found else {
                self.diags.error(rest[i].pos, "`defined` needs a name");
                return false;
            };
            let value = if self.macros.contains_key(&word.text) { "1" } else { "0" };
            plain.push(Raw { kind: RawKind::Number, text: value.into(), ..rest[i].clone() });
            i += used;
        }
        let expanded = self.expand(plain, 0);
        match condition::evaluate(&expanded) {
            Ok(value) => value != 0,
            Err((at, what)) => {
                self.diags.error(at.unwrap_or(name.pos), format!("in `#{}`: {what}", name.text));
                false
            }
        }
    }

    fn include(&mut self, directive: &Raw, rest: &[Raw], depth: usize) {
        let rest = if rest.first().is_some_and(|t| t.kind == RawKind::Word) {
            self.expand(rest.to_vec(), 0)
        } else {
            rest.to_vec()
        };
        let quoted = rest.first().is_some_and(|t| t.kind == RawKind::Text);
        let name = match rest.as_slice() {
            [text, ..] if quoted => inside(&text.text).to_owned(),
            [open, path @ .., close] if open.is("<") && close.is(">") => spell(path).replace(' ', ""),
            _ => {
                self.diags.error(directive.pos, "`#include` needs \"file\" or <file>");
                return;
            }
        };
        if depth + 1 >= MAX_INCLUDES {
            self.diags.error(directive.pos, format!("files are included more than {MAX_INCLUDES} deep"));
            return;
        }
        let Some(load) = self.options.loader else {
            self.diags
                .error(directive.pos, format!("cannot include \"{name}\": this program does not read files"));
            return;
        };
        for path in self.places(&name, quoted, directive.pos) {
            match load(&path) {
                Ok(Some(text)) => {
                    self.file(&text, &path, depth + 1, directive.pos);
                    return;
                }
                Ok(None) => {}
                Err(error) => {
                    self.diags.error(directive.pos, format!("cannot read \"{path}\": {error}"));
                    return;
                }
            }
        }
        let mut folders = self.options.include_paths.to_vec();
        folders.push("the current folder".to_owned());
        let help = Some(format!("looked in {}", folders.join(", ")));
        self.diags.error_help(directive.pos, format!("cannot find \"{name}\""), help);
    }

    /// Returns the possible paths of an included file, in order. These are beside the including file (`"..."` only), in
    /// the current folder (`"..."` only), in the include paths, and in the current folder.
    fn places(&self, name: &str, quoted: bool, pos: Pos) -> Vec<String> {
        if name.starts_with('/') {
            return vec![name.to_owned()];
        }
        let mut places = Vec::new();
        if quoted {
            if let Some((folder, _)) = self.diags.sources.opened(pos.file).rsplit_once('/') {
                places.push(format!("{folder}/{name}"));
            }
            places.push(name.to_owned());
        }
        places
            .extend(self.options.include_paths.iter().map(|p| format!("{}/{name}", p.trim_end_matches('/'))));
        places.push(name.to_owned());
        places
    }

    fn define(&mut self, directive: &Raw, rest: &[Raw]) {
        let Some((name, mut rest)) = rest.split_first().filter(|(n, _)| n.kind == RawKind::Word) else {
            self.diags.error(directive.pos, "`#define` needs a name");
            return;
        };
        if &*name.text == "defined" {
            self.diags.error(name.pos, "`defined` cannot be a macro");
            return;
        }
        let mut params = None;
        let mut variadic = false;
        if rest.first().is_some_and(|t| t.is("(") && !t.spaced) {
            let Some(close) = rest.iter().position(|t| t.is(")")) else {
                self.diags.error(name.pos, format!("the parameters of macro `{}` have no `)`", name.text));
                return;
            };
            let mut list: Vec<Arc<str>> = Vec::new();
            let inner = &rest[1..close];
            for (i, part) in inner.split(|t| t.is(",")).enumerate() {
                match part {
                    [] if inner.is_empty() && i == 0 => {}
                    [word] if word.kind == RawKind::Word && !list.contains(&word.text) => {
                        list.push(word.text.clone());
                    }
                    [dots] if dots.is("...") && !variadic => {
                        variadic = true;
                        list.push("__VA_ARGS__".into());
                    }
                    _ => {
                        let what = format!("the parameters of macro `{}` are not names", name.text);
                        self.diags.error(name.pos, what);
                        return;
                    }
                }
            }
            params = Some(list);
            rest = &rest[close + 1..];
        }
        let lone = |t: Option<&Raw>| t.is_some_and(|t| t.is("##"));
        if lone(rest.first()) || lone(rest.last()) {
            self.diags.error(name.pos, "`##` needs a token on both sides");
            return;
        }
        let new = Macro { params, variadic, body: rest.to_vec() };
        let differs = self.macros.get(&name.text).is_some_and(|old| {
            old.params != new.params || !old.body.iter().map(|t| &t.text).eq(new.body.iter().map(|t| &t.text))
        });
        if differs {
            self.diags.warning(name.pos, format!("macro `{}` is defined again, differently", name.text));
        }
        self.macros.insert(name.text.clone(), new);
    }

    /// Replaces macros in `tokens`.
    fn expand(&mut self, tokens: Vec<Raw>, depth: usize) -> Vec<Raw> {
        let mut stack = tokens;
        stack.reverse();
        let mut out = Vec::new();
        while let Some(token) = stack.pop() {
            if self.budget == 0 {
                return out;
            }
            self.budget -= 1;
            if self.budget == 0 {
                self.diags.error(token.pos, "the text grows too large when macros are replaced");
                return out;
            }
            let hidden = token.hidden.as_ref().is_some_and(|h| h.contains(&token.text));
            if token.kind != RawKind::Word || hidden {
                out.push(token);
                continue;
            }
            if &*token.text == "__LINE__" {
                let line = self.diags.sources.presumed(token.pos).line;
                out.push(Raw { kind: RawKind::Number, text: line.to_string().into(), ..token });
                continue;
            }
            if &*token.text == "__FILE__" {
                let text = format!("\"{}\"", self.diags.sources.location(token.pos).file);
                out.push(Raw { kind: RawKind::Text, text: text.into(), ..token });
                continue;
            }
            let Some(found) = self.macros.get(&token.text) else {
                out.push(token);
                continue;
            };
            let called = found.params.is_none() || stack.last().is_some_and(|t| t.is("("));
            if !called {
                out.push(token);
                continue;
            }
            let found = found.clone();
            let mut hide: Vec<Arc<str>> = token.hidden.as_ref().map_or_else(Vec::new, |h| h.to_vec());
            let arguments = match &found.params {
                None => Vec::new(),
                Some(params) => match self.arguments(&token, params, found.variadic, &mut stack) {
                    Some((arguments, close)) => {
                        hide.retain(|n| close.hidden.as_ref().is_some_and(|h| h.contains(n)));
                        arguments
                    }
                    None => return out,
                },
            };
            hide.push(token.text.clone());
            // Long sets of hidden names have a cost, too.
            self.budget = self.budget.saturating_sub(hide.len()).max(1);
            let body = self.substitute(&found, &arguments, &token, &Arc::new(hide), depth);
            stack.extend(body.into_iter().rev());
        }
        out
    }

    /// Takes `( a, b )` off the stack. Also returns the closing parenthesis.
    fn arguments(
        &mut self,
        name: &Raw,
        params: &[Arc<str>],
        variadic: bool,
        stack: &mut Vec<Raw>,
    ) -> Option<(Vec<Vec<Raw>>, Raw)> {
        stack.pop();
        let mut arguments = vec![Vec::new()];
        let mut open = 0usize;
        let close = loop {
            let Some(token) = stack.pop() else {
                self.diags.error(name.pos, format!("the call of macro `{}` has no `)`", name.text));
                return None;
            };
            match &*token.text {
                ")" if open == 0 && token.kind == RawKind::Mark => break token,
                "," if open == 0
                    && token.kind == RawKind::Mark
                    && !(variadic && arguments.len() == params.len()) =>
                {
                    arguments.push(Vec::new());
                    continue;
                }
                "(" if token.kind == RawKind::Mark => open += 1,
                ")" if token.kind == RawKind::Mark => open -= 1,
                _ => {}
            }
            if let Some(last) = arguments.last_mut() {
                last.push(token);
            }
            // Arguments within arguments are processed once for each call around them.
            self.budget = self.budget.saturating_sub(1).max(1);
        };
        if params.is_empty() && arguments.len() == 1 && arguments[0].is_empty() {
            arguments.clear();
        }
        if variadic && arguments.len() + 1 == params.len() {
            arguments.push(Vec::new());
        }
        if arguments.len() != params.len() {
            let (n, m) = (params.len(), arguments.len());
            let plural = if n == 1 { "" } else { "s" };
            self.diags
                .error(name.pos, format!("macro `{}` takes {n} argument{plural}, {m} given", name.text));
            return None;
        }
        Some((arguments, close))
    }

    /// Returns the body of a macro with its arguments inserted.
    fn substitute(
        &mut self,
        found: &Macro,
        arguments: &[Vec<Raw>],
        call: &Raw,
        hide: &Arc<Vec<Arc<str>>>,
        depth: usize,
    ) -> Vec<Raw> {
        let none = Vec::new();
        let params = found.params.as_ref().unwrap_or(&none);
        let argument = |t: &Raw| {
            let i = params.iter().position(|p| t.kind == RawKind::Word && *p == t.text)?;
            arguments.get(i)
        };
        let mut out: Vec<Raw> = Vec::new();
        let body = &found.body;
        let mut i = 0;
        while i < body.len() {
            let token = &body[i];
            let here = |t: &Raw| Raw { pos: call.pos, ..t.clone() };
            let text = body.get(i + 1).filter(|_| token.is("#") && found.params.is_some()).and_then(argument);
            if let Some(text) = text {
                out.push(Raw { kind: RawKind::Text, text: stringify(text).into(), ..here(token) });
                i += 2;
                continue;
            }
            if token.is("##") && i > 0 {
                let right = &body[i + 1];
                let mut pieces = argument(right).cloned().unwrap_or_else(|| vec![here(right)]);
                if let (Some(left), false) = (out.last().cloned(), pieces.is_empty()) {
                    out.pop();
                    pieces[0] = self.paste(&left, &pieces[0]);
                }
                out.extend(pieces);
                i += 2;
                continue;
            }
            let pasted = body.get(i + 1).is_some_and(|t| t.is("##"));
            match argument(token) {
                Some(tokens) if pasted && tokens.is_empty() => {
                    // An empty argument is not pasted. `##` is skipped with it, and the right side is taken unchanged.
                    let right = &body[i + 2];
                    out.extend(argument(right).cloned().unwrap_or_else(|| vec![here(right)]));
                    i += 3;
                    continue;
                }
                Some(tokens) if pasted => out.extend(tokens.iter().cloned()),
                Some(tokens) => {
                    if depth >= MAX_CALLS {
                        self.diags
                            .error(call.pos, format!("macro calls are nested more than {MAX_CALLS} deep"));
                        // Expansion ends, because further messages would mislead.
                        self.budget = 0;
                        return out;
                    }
                    out.extend(self.expand(tokens.clone(), depth + 1));
                }
                None => out.push(here(token)),
            }
            i += 1;
        }
        for token in &mut out {
            let mut all = hide.clone();
            if let Some(old) = token.hidden.as_ref().filter(|old| old.iter().any(|n| !hide.contains(n))) {
                let list = Arc::make_mut(&mut all);
                list.extend(old.iter().filter(|n| !hide.contains(n)).cloned());
            }
            token.hidden = Some(all);
            token.first = false;
        }
        out
    }

    fn paste(&mut self, left: &Raw, right: &Raw) -> Raw {
        let text = format!("{}{}", left.text, right.text);
        let mut made = scan(&text, left.pos.file);
        match made.len() {
            1 => Raw { pos: left.pos, spaced: left.spaced, first: false, hidden: None, ..made.remove(0) },
            _ => {
                self.diags.error(left.pos, format!("`##` makes `{text}`, which is not one token"));
                left.clone()
            }
        }
    }
}

/// Returns the index after the last token of the line that `from` is in.
fn line_end(tokens: &[Raw], from: usize) -> usize {
    (from..tokens.len()).find(|&i| tokens[i].first).unwrap_or(tokens.len())
}

/// Returns a string without its quotes.
fn inside(text: &str) -> &str {
    text.strip_prefix('"').and_then(|t| t.strip_suffix('"')).unwrap_or(text)
}

/// Returns tokens as text.
fn spell(tokens: &[Raw]) -> String {
    let mut out = String::new();
    for (i, token) in tokens.iter().enumerate() {
        if i > 0 && (token.spaced || token.first) {
            out.push(' ');
        }
        out.push_str(&token.text);
    }
    out
}

/// Returns the string that `#` makes of an argument.
fn stringify(tokens: &[Raw]) -> String {
    let mut out = String::from("\"");
    for (i, token) in tokens.iter().enumerate() {
        if i > 0 && (token.spaced || token.first) {
            out.push(' ');
        }
        let quote = token.kind == RawKind::Text;
        for c in token.text.chars() {
            if quote && matches!(c, '"' | '\\') {
                out.push('\\');
            }
            out.push(c);
        }
    }
    out.push('"');
    out
}

/// Converts raw tokens to those of the parser.
fn finish(raw: Vec<Raw>, end: Pos, diags: &mut Diagnostics) -> Vec<Token> {
    let mut out: Vec<Token> = Vec::with_capacity(raw.len() + 1);
    let mut bad = Vec::new();
    for token in raw {
        let pos = token.pos;
        let kind = match token.kind {
            RawKind::Word => TokenKind::Word(token.text),
            RawKind::Number => match number(&token.text) {
                Some(value) => TokenKind::Number(value),
                None => {
                    diags.error(pos, format!("`{}` is not a number", token.text));
                    TokenKind::Number(1.0)
                }
            },
            RawKind::Text => {
                let (text, unknown) = unescape(inside(&token.text));
                if let Some(c) = unknown {
                    diags.warning(pos, format!("unknown escape `\\{c}` in a string is kept as it is"));
                }
                // Strings side by side are one string, as in C.
                if let Some(Token { kind: TokenKind::Text(before), .. }) = out.last_mut() {
                    *before = format!("{before}{text}").into();
                    continue;
                }
                TokenKind::Text(text.into())
            }
            RawKind::Mark => match mark(&token.text) {
                Some(text) => TokenKind::Mark(text),
                None => continue,
            },
            RawKind::Bad(what) => {
                let shown: String = token.text.chars().take(20).collect();
                diags.error(pos, format!("{what}: `{shown}`"));
                bad.push(pos);
                TokenKind::Bad
            }
        };
        out.push(Token { kind, pos });
    }
    bad.into_iter().for_each(|pos| diags.doubt(pos));
    out.push(Token { kind: TokenKind::End, pos: end });
    out
}
