//! How the parser goes on after an error: the rest of the source is parsed, so that all errors are found in one run,
//! and what is skipped is recorded, so that it causes no further messages.

use super::{Failed, KINDS, Parsed, Parser, type_named};
use crate::ast::{Expr, ExprKind, Stmt, StmtKind};
use crate::source::Pos;
use crate::token::{TokenKind, is_keyword};

impl Parser<'_> {
    /// Records that the tokens from `start` to the current one are skipped.
    pub(super) fn lose(&mut self, start: usize) {
        let end = self.at.min(self.tokens.len());
        self.lost.add(&self.tokens[start.min(end)..end]);
    }

    /// Returns the expression in the place of one that could not be parsed.
    pub(super) fn missing(pos: Pos) -> Expr {
        Expr { kind: ExprKind::Missing, pos, height: 0 }
    }

    /// True when the current token is the first of its line.
    pub(super) fn is_on_new_line(&self) -> bool {
        let before = self.at.checked_sub(1).and_then(|at| self.tokens.get(at));
        before.is_some_and(|before| before.pos.line < self.pos().line || before.pos.file != self.pos().file)
    }

    /// True for a keyword at the beginning of a line, or a type in front of a name there. It begins a statement,
    /// whatever is wrong with the one before.
    fn begins_statement(&self) -> bool {
        let Some(word) = self.word().filter(|_| self.is_on_new_line()) else { return false };
        let name_follows = matches!(self.peek_at(1), TokenKind::Word(next) if !is_keyword(next));
        type_named(word).is_some() && name_follows
            || matches!(
                &**word,
                "if" | "for" | "while" | "do" | "return" | "break" | "continue" | "lights" | "emit" | "trace"
            )
    }

    /// Skips the rest of a statement that began at the token `start`. It continues after the next `;`, after the `}`
    /// that closes a block opened here, before the `}` that closes the block around, or at a line that begins another
    /// statement.
    pub(super) fn skip_statement(&mut self, start: usize) {
        let mut open = 0usize;
        let first = self.at;
        loop {
            let after_bad = self.at.checked_sub(1).is_some_and(|at| self.tokens[at].kind == TokenKind::Bad);
            let is_next = self.at > start && (self.begins_statement() || after_bad && self.is_on_new_line());
            match self.peek() {
                TokenKind::End => break,
                _ if open == 0 && is_next => break,
                TokenKind::Mark("{") => open += 1,
                TokenKind::Mark("}") if open == 0 => break,
                TokenKind::Mark("}") => {
                    open -= 1;
                    if open == 0 {
                        self.next();
                        break;
                    }
                }
                TokenKind::Mark(";") if open == 0 => {
                    self.next();
                    break;
                }
                _ => {}
            }
            self.next();
        }
        // An `else` belongs to the statement that failed.
        while self.at > first && self.is_word("else") {
            self.next();
        }
        self.lose(start);
    }

    /// Parses a statement inside of another one. Where it cannot be parsed, it is skipped.
    pub(super) fn inner_statement(&mut self) -> Parsed<Stmt> {
        let (start, depth, pos) = (self.at, self.depth, self.pos());
        self.statement().or_else(|Failed| {
            if self.at >= self.tokens.len() || *self.peek() == TokenKind::End {
                return Err(Failed);
            }
            self.depth = depth;
            // The `else` of an `if` around it is kept.
            self.skip_inner(start);
            Ok(Stmt { kind: StmtKind::Missing, pos })
        })
    }

    fn skip_inner(&mut self, start: usize) {
        self.skip_statement(start);
        let before = self.at.checked_sub(1).filter(|_| self.at > start);
        if let Some(before) = before
            && matches!(&self.tokens[before].kind, TokenKind::Word(word) if &**word == "else")
        {
            self.at = before;
        }
    }

    /// Continues after the `)` that closes the `(` at the token `open`.
    ///
    /// # Errors
    /// There is no such `)` before the next brace, or it is on another line than a `;` before it, which then ends a
    /// statement.
    pub(super) fn skip_parentheses(&mut self, open: usize) -> Parsed<()> {
        let (mut depth, mut line) = (0usize, None);
        for at in open..self.tokens.len() {
            match &self.tokens[at].kind {
                TokenKind::Mark("(") => depth += 1,
                TokenKind::Mark(")") => {
                    depth = depth.saturating_sub(1);
                    if depth == 0 && at >= self.at {
                        if line.is_some_and(|line| line != self.tokens[at].pos.line) {
                            return Err(Failed);
                        }
                        self.at = at + 1;
                        self.lose(open);
                        return Ok(());
                    }
                }
                TokenKind::Mark("{" | "}") | TokenKind::End => return Err(Failed),
                TokenKind::Mark(";") => line = line.or(Some(self.tokens[at].pos.line)),
                _ => (),
            }
            if depth == 0 {
                return Err(Failed);
            }
        }
        Err(Failed)
    }

    /// Parses parameters up to `)`, after the `(`. Those that cannot be parsed are skipped, and the result is then
    /// false.
    pub(super) fn parameters<T>(&mut self, param: impl Fn(&mut Self) -> Parsed<T>) -> Parsed<(Vec<T>, bool)> {
        let (mut list, mut whole) = (Vec::new(), true);
        if self.eat(")") {
            return Ok((list, whole));
        }
        loop {
            let (start, depth) = (self.at, self.depth);
            // What is left of a parameter that was skipped causes no further messages.
            let is_rest = !whole && !matches!(self.peek(), TokenKind::Word(_));
            match if is_rest { Err(Failed) } else { param(self) } {
                Ok(param) => list.push(param),
                Err(Failed) => {
                    whole = false;
                    self.depth = depth;
                    self.skip_parameter(start)?;
                }
            }
            if self.is(";") {
                let pos = self.pos();
                self.diags.error(pos, "parameters are separated by `,`");
                self.next();
                continue;
            }
            if !self.is(",") && !self.is(")") && !self.is("{") {
                let start = self.at;
                let Err(Failed) = self.expected::<()>("`,` or `)`") else { return Err(Failed) };
                whole = false;
                self.skip_parameter(start)?;
            } else if self.is("{") && whole {
                whole = false;
                let Err(Failed) = self.expected::<()>("`,` or `)`") else { return Err(Failed) };
            }
            if self.eat(")") || self.is("{") {
                return Ok((list, whole));
            }
            self.next();
        }
    }

    /// Skips the rest of a parameter that began at the token `start`, up to the `,`, `;` or `)` after it, or to the `{`
    /// of the body.
    fn skip_parameter(&mut self, start: usize) -> Parsed<()> {
        let is_name = |kind: &TokenKind| matches!(kind, TokenKind::Word(word) if !is_keyword(word));
        if let TokenKind::Word(word) = &self.tokens[start].kind
            && is_name(&self.tokens[start].kind)
            && !self.tokens.get(start + 1).is_some_and(|next| is_name(&next.kind))
        {
            self.lost.declare(word);
        }
        let mut open = 0usize;
        for at in start..self.tokens.len() {
            let is_list = at > start && self.tokens[at - 1].kind == TokenKind::Mark("=");
            match &self.tokens[at].kind {
                TokenKind::End => return Err(Failed),
                TokenKind::Mark("(" | "[") => open += 1,
                TokenKind::Mark("{") if is_list => open += 1,
                TokenKind::Mark(")" | "]" | "}") if open > 0 => open -= 1,
                TokenKind::Mark("{") => {
                    self.at = at;
                    self.lose(start);
                    return Ok(());
                }
                TokenKind::Mark("," | ";" | ")") if open == 0 && at >= self.at => {
                    self.at = at;
                    self.lose(start);
                    return Ok(());
                }
                TokenKind::Mark("}") => return Err(Failed),
                _ => (),
            }
        }
        Err(Failed)
    }

    /// Continues at the `{` of a body after parameters that are not `whole`, if there is one.
    pub(super) fn find_body(&mut self, whole: bool) {
        let start = self.at;
        while !whole && !matches!(self.peek(), TokenKind::End | TokenKind::Mark("{" | "}")) {
            self.next();
        }
        self.lose(start);
    }

    /// Continues after the `]]` of metadata that began at the token `start`.
    ///
    /// # Errors
    /// There is none before the next brace.
    pub(super) fn skip_metadata(&mut self, start: usize) -> Parsed<()> {
        while !matches!(self.peek(), TokenKind::End | TokenKind::Mark("{" | "}")) {
            if self.is("]") && self.is_at(1, "]") {
                self.next();
                self.next();
                self.lose(start);
                return Ok(());
            }
            self.next();
        }
        Err(Failed)
    }

    /// Continues at the next shader or function outside of braces, after an error outside of all shaders and functions
    /// at the token `start`.
    pub(super) fn skip_to_declaration(&mut self, start: usize) {
        if let (TokenKind::Word(word), TokenKind::Mark("(")) = (self.peek(), self.peek_at(1))
            && !is_keyword(word)
        {
            let word = word.clone();
            self.lost.declare(&word);
        }
        if self.at == start {
            self.next();
        }
        let mut open = 0usize;
        while *self.peek() != TokenKind::End && (open > 0 || !self.begins_declaration()) {
            match self.peek() {
                TokenKind::Mark("{") => open += 1,
                TokenKind::Mark("}") => open = open.saturating_sub(1),
                _ => (),
            }
            self.next();
        }
        self.lose(start);
    }

    /// True at the kind and the name of a shader at the beginning of a line. It cannot be inside of a block.
    pub(super) fn begins_shader(&self) -> bool {
        self.is_on_new_line() && self.begins_declaration() && self.type_here().is_none()
    }

    /// True at the kind and the name of a shader, or at the type and the name of a function.
    pub(super) fn begins_declaration(&self) -> bool {
        let Some(word) = self.word() else { return false };
        let is_first = KINDS.iter().any(|(kind, _)| **word == **kind) || type_named(word).is_some();
        let is_named = matches!(self.peek_at(1), TokenKind::Word(name) if !is_keyword(name));
        is_first && is_named && matches!(self.peek_at(2), TokenKind::Mark("(" | "["))
    }
}
