// tidy: long: the grammar is one type, with a method for each of its rules
//! The parser, which converts tokens to the syntax tree by recursive descent (reference 5.9).
//!
//! After an error it continues behind the part that it cannot parse, so that one run reports all errors (`recover`).
//! Nesting is bounded. Input that is nested too deeply is an error, not a stack overflow.

use crate::ast::*;
use crate::diagnostic::{Diagnostics, suggestion};
use crate::ir::{ShaderKind, ValueType};
use crate::lost::Lost;
use crate::source::Pos;
use crate::token::{KEYWORDS, RESERVED, Token, TokenKind};
use std::sync::Arc;

mod recover;

/// The largest depth of nested statements, and of nodes above a leaf of an expression.
const MAX_NESTING: u16 = 200;

const KINDS: &[(&str, ShaderKind)] = &[
    ("surface", ShaderKind::Surface),
    ("displacement", ShaderKind::Displacement),
    ("light", ShaderKind::Light),
    ("volume", ShaderKind::Volume),
    ("shader", ShaderKind::Generic),
];

fn type_named(word: &str) -> Option<ValueType> {
    Some(match word {
        "float" => ValueType::Float,
        "color" => ValueType::Color,
        "point" => ValueType::Point,
        "vector" => ValueType::Vector,
        "normal" => ValueType::Normal,
        "matrix" => ValueType::Matrix,
        "string" => ValueType::String,
        "void" => ValueType::Void,
        _ => return None,
    })
}

/// An error that was reported.
struct Failed;
type Parsed<T> = Result<T, Failed>;

/// A file, as far as it could be parsed.
pub(crate) struct File {
    /// `None` when there is none, or when it could not be parsed.
    pub(crate) shader: Option<Shader>,
    /// The functions outside of the shader.
    pub(crate) functions: Vec<Function>,
    /// The names in the parts that could not be parsed.
    pub(crate) lost: Lost,
}

/// Parses a file. Errors go to `diags`.
pub(crate) fn parse(tokens: &[Token], diags: &mut Diagnostics) -> File {
    let mut parser = Parser { tokens, at: 0, depth: 0, unclosed: false, lost: Lost::default(), diags };
    let (shader, functions) = parser.file();
    File { shader, functions, lost: parser.lost }
}

struct Parser<'a> {
    tokens: &'a [Token],
    at: usize,
    depth: u16,
    /// True when a block without its end was reported.
    unclosed: bool,
    lost: Lost,
    diags: &'a mut Diagnostics,
}

impl Parser<'_> {
    // The current token.

    fn peek(&self) -> &TokenKind {
        self.tokens.get(self.at).map_or(&TokenKind::End, |t| &t.kind)
    }

    fn peek_at(&self, ahead: usize) -> &TokenKind {
        self.tokens.get(self.at + ahead).map_or(&TokenKind::End, |t| &t.kind)
    }

    fn pos(&self) -> Pos {
        self.tokens.get(self.at).or(self.tokens.last()).map_or(Pos::default(), |t| t.pos)
    }

    fn next(&mut self) {
        self.at += usize::from(self.at < self.tokens.len());
    }

    fn is(&self, mark: &str) -> bool {
        matches!(self.peek(), TokenKind::Mark(m) if *m == mark)
    }

    fn is_at(&self, ahead: usize, mark: &str) -> bool {
        matches!(self.peek_at(ahead), TokenKind::Mark(m) if *m == mark)
    }

    fn eat(&mut self, mark: &str) -> bool {
        let found = self.is(mark);
        self.at += usize::from(found);
        found
    }

    fn word(&self) -> Option<&Arc<str>> {
        match self.peek() {
            TokenKind::Word(w) => Some(w),
            _ => None,
        }
    }

    fn is_word(&self, word: &str) -> bool {
        self.word().is_some_and(|w| **w == *word)
    }

    fn eat_word(&mut self, word: &str) -> bool {
        let found = self.is_word(word);
        self.at += usize::from(found);
        found
    }

    /// Returns the current token, for messages.
    fn found(&self) -> String {
        match self.peek() {
            TokenKind::Word(w) => format!("`{w}`"),
            TokenKind::Number(n) => format!("`{n}`"),
            TokenKind::Text(t) => {
                let short: String = t.chars().take(20).collect();
                format!("\"{short}\"")
            }
            TokenKind::Mark(m) => format!("`{m}`"),
            TokenKind::Bad => "text that is not a token".to_owned(),
            TokenKind::End => "the end of the file".to_owned(),
        }
    }

    fn expected<T>(&mut self, what: &str) -> Parsed<T> {
        let (pos, found) = (self.pos(), self.found());
        // Text that is not a token was reported.
        if *self.peek() != TokenKind::Bad {
            self.diags.error(pos, format!("expected {what}, found {found}"));
        }
        Err(Failed)
    }

    fn expect(&mut self, mark: &str) -> Parsed<()> {
        if self.eat(mark) { Ok(()) } else { self.expected(&format!("`{mark}`")) }
    }

    /// Expects a `;`. A missing one is reported at the token that follows. Where that is on another line or a `}`, the
    /// statement counts as complete.
    fn expect_end(&mut self) -> Parsed<()> {
        if self.eat(";") {
            return Ok(());
        }
        let failed = self.expected("`;`");
        let is_over = self.is("}") || self.is_on_new_line() && *self.peek() != TokenKind::Bad;
        if is_over { Ok(()) } else { failed }
    }

    fn deeper(&mut self) -> Parsed<()> {
        self.depth += 1;
        if self.depth > MAX_NESTING {
            let pos = self.pos();
            self.diags.error(pos, format!("the source is nested more than {MAX_NESTING} deep"));
            // Parsing ends, because further messages would mislead.
            self.at = self.tokens.len();
            return Err(Failed);
        }
        Ok(())
    }

    fn name(&mut self, what: &str) -> Parsed<Name> {
        let pos = self.pos();
        let Some(word) = self.word().cloned() else { return self.expected(what) };
        if KEYWORDS.contains(&&*word) || RESERVED.contains(&&*word) {
            let kind = if KEYWORDS.contains(&&*word) { "a keyword" } else { "reserved for future use" };
            self.diags.error(pos, format!("`{word}` is {kind} and cannot be a name"));
            self.next();
            return Err(Failed);
        }
        self.next();
        Ok(Name { text: word, pos })
    }

    fn type_here(&self) -> Option<ValueType> {
        type_named(self.word()?)
    }

    fn type_name(&mut self) -> Parsed<ValueType> {
        let pos = self.pos();
        let Some(word) = self.word().cloned() else { return self.expected("a type") };
        if let Some(ty) = type_named(&word) {
            self.next();
            return Ok(ty);
        }
        let types = ["float", "color", "point", "vector", "normal", "matrix", "string", "void"];
        let help = match &*word {
            "double" | "int" | "long" | "short" | "bool" => Some("all numbers are `float`".to_owned()),
            "uniform" | "varying" => Some("variables need no storage class; leave it out".to_owned()),
            other => suggestion(other, types.into_iter()),
        };
        self.diags.error_help(pos, format!("expected a type, found `{word}`"), help);
        Err(Failed)
    }

    /// Parses a type that is not `void`.
    fn value_type(&mut self, of: &str) -> Parsed<ValueType> {
        let pos = self.pos();
        let ty = self.type_name()?;
        if ty == ValueType::Void {
            self.diags.error(pos, format!("{of} cannot be `void`"));
            return Err(Failed);
        }
        Ok(ty)
    }

    // Overall structure (5.9.2).

    fn file(&mut self) -> (Option<Shader>, Vec<Function>) {
        let mut functions = Vec::new();
        let mut shader: Option<Shader> = None;
        let mut spoiled = false;
        while *self.peek() != TokenKind::End && !self.diags.is_full() {
            let kind = self.word().and_then(|w| KINDS.iter().find(|(k, _)| **w == **k));
            let start = self.at;
            let parsed = if let Some(&(_, kind)) = kind {
                let pos = self.pos();
                self.next();
                self.shader(kind).map(|new| {
                    if shader.is_some() {
                        self.diags.error(pos, "a file holds one shader");
                    } else {
                        shader = Some(new);
                    }
                })
            } else if shader.is_some() && !self.begins_declaration() && *self.peek() != TokenKind::Bad {
                let (pos, found) = (self.pos(), self.found());
                let help = "a `}` before it may be one too many".to_owned();
                self.lost.lose_braces();
                self.diags.error_help(
                    pos,
                    format!("expected the end of the file, found {found}"),
                    Some(help),
                );
                Err(Failed)
            } else if self.type_here().is_some() {
                let pos = self.pos();
                if shader.is_some() && !spoiled {
                    self.diags.error(pos, "functions are declared before the shader");
                }
                self.function().map(|f| functions.push(f))
            } else if *self.peek() == TokenKind::Bad {
                Err(Failed)
            } else {
                let (pos, found) = (self.pos(), self.found());
                let kinds = ["surface", "displacement", "light", "volume", "shader"];
                let help = self.word().and_then(|w| suggestion(w, kinds.into_iter()));
                let what = "expected a shader type or a function declaration";
                self.diags.error_help(pos, format!("{what}, found {found}"), help);
                Err(Failed)
            };
            if parsed.is_err() {
                spoiled = true;
                self.depth = 0;
                self.skip_to_declaration(start);
            }
        }
        if shader.is_none() && !spoiled {
            let pos = self.pos();
            self.diags.error(pos, "there is no shader in this file");
        }
        (shader, functions)
    }

    fn shader(&mut self, kind: ShaderKind) -> Parsed<Shader> {
        let pos = self.pos();
        let name = match self.name("the name of the shader") {
            Ok(name) => name,
            Err(Failed) if self.is("(") || self.is("[") => Name { text: "".into(), pos },
            Err(Failed) => return Err(Failed),
        };
        let metadata = self.metadata()?;
        self.expect("(")?;
        let (params, whole) = self.parameters(Self::param)?;
        self.find_body(whole);
        if !self.is("{") {
            return self.expected("`{`");
        }
        let body = self.block()?;
        Ok(Shader { kind, name, metadata, params, body })
    }

    fn param(&mut self) -> Parsed<Param> {
        let output = self.eat_word("output");
        let ty = self.value_type("a parameter")?;
        let name = self.name("the name of a parameter")?;
        let array = self.length()?;
        let init = self.initializer()?;
        let metadata = self.metadata()?;
        Ok(Param { output, ty, name, array, init, metadata })
    }

    /// Parses `[[ type name = value, ... ]]`, if there is one.
    fn metadata(&mut self) -> Parsed<Vec<Datum>> {
        if !(self.is("[") && self.is_at(1, "[")) {
            return Ok(Vec::new());
        }
        let (start, depth) = (self.at, self.depth);
        self.data().or_else(|Failed| {
            self.depth = depth;
            self.skip_metadata(start).map(|()| Vec::new())
        })
    }

    fn data(&mut self) -> Parsed<Vec<Datum>> {
        let mut list = Vec::new();
        self.next();
        self.next();
        if self.is("]") && self.is_at(1, "]") {
            self.next();
            self.next();
            return Ok(list);
        }
        loop {
            let ty = self.value_type("a metadatum")?;
            let name = self.name("the name of a metadatum")?;
            self.expect("=")?;
            let value = self.expr()?;
            list.push(Datum { ty, name, value });
            if self.is("]") && self.is_at(1, "]") {
                self.next();
                self.next();
                return Ok(list);
            }
            if !self.eat(",") {
                return self.expected("`,` or `]]`");
            }
        }
    }

    /// Parses `[n]` or `[]`, if there is one. `[[` is metadata.
    fn length(&mut self) -> Parsed<Option<Length>> {
        if !self.is("[") || self.is_at(1, "[") {
            return Ok(None);
        }
        let pos = self.pos();
        self.next();
        if self.eat("]") {
            return Ok(Some(Length::Open(pos)));
        }
        let length = self.expr()?;
        self.expect("]")?;
        Ok(Some(Length::Fixed(length)))
    }

    /// Parses `= value` or `= { values }`, if there is one.
    fn initializer(&mut self) -> Parsed<Option<Init>> {
        if !self.eat("=") {
            return Ok(None);
        }
        let pos = self.pos();
        if !self.eat("{") {
            return Ok(Some(Init::One(self.expr()?)));
        }
        let mut list = Vec::new();
        while !self.eat("}") {
            list.push(self.expr()?);
            if !self.eat(",") && !self.is("}") {
                return self.expected("`,` or `}`");
            }
        }
        Ok(Some(Init::List(list, pos)))
    }

    fn function(&mut self) -> Parsed<Function> {
        let ty = self.type_name()?;
        let name = self.name("the name of a function")?;
        self.function_rest(ty, name)
    }

    fn function_rest(&mut self, ty: ValueType, name: Name) -> Parsed<Function> {
        if !self.is("(") {
            return self.expected("`(` and the parameters of a function");
        }
        self.next();
        let (params, whole) = self.parameters(Self::formal)?;
        if !whole {
            self.lost.declare(&name.text);
        }
        self.find_body(whole);
        if !self.is("{") {
            return self.expected("`{` and the body of the function");
        }
        let body = self.block()?;
        Ok(Function { ty, name, params, body })
    }

    fn formal(&mut self) -> Parsed<Formal> {
        let output = self.eat_word("output");
        let ty = self.value_type("a parameter")?;
        let name = self.name("the name of a parameter")?;
        let array = self.length()?;
        if self.is("=") {
            let pos = self.pos();
            self.diags.error(pos, "parameters of functions have no default");
            self.next();
            self.expr()?;
        }
        Ok(Formal { output, ty, name, array })
    }

    // Statements (5.9.4).

    /// Parses `{ statements }`. An error inside is reported and skipped.
    fn block(&mut self) -> Parsed<Vec<Stmt>> {
        let open = self.pos();
        self.expect("{")?;
        let mut list = Vec::new();
        loop {
            if self.eat("}") {
                return Ok(list);
            }
            if *self.peek() == TokenKind::End || self.begins_shader() {
                // The innermost block is reported. After text that is cut off, nothing is.
                let before = self.at.checked_sub(1).map(|at| &self.tokens[at].kind);
                if !self.unclosed && before != Some(&TokenKind::Bad) {
                    self.diags.error(open, "this `{` is never closed");
                }
                self.unclosed = true;
                self.lost.lose_braces();
                return Ok(list);
            }
            let (start, depth, pos) = (self.at, self.depth, self.pos());
            match self.statement() {
                Ok(statement) => list.push(statement),
                Err(Failed) => {
                    if self.at >= self.tokens.len() {
                        return Err(Failed);
                    }
                    self.depth = depth;
                    self.skip_statement(start);
                    list.push(Stmt { kind: StmtKind::Missing, pos });
                }
            }
        }
    }

    fn statement(&mut self) -> Parsed<Stmt> {
        self.deeper()?;
        let pos = self.pos();
        let kind = self.statement_kind()?;
        self.depth -= 1;
        Ok(Stmt { kind, pos })
    }

    fn statement_kind(&mut self) -> Parsed<StmtKind> {
        if self.is("{") {
            return Ok(StmtKind::Block(self.block()?));
        }
        if self.eat(";") {
            return Ok(StmtKind::Empty);
        }
        let Some(word) = self.word().cloned() else { return self.expression_statement() };
        if type_named(&word).is_some() && !self.is_at(1, "(") {
            return self.declaration();
        }
        match &*word {
            "if" => self.if_statement(),
            "else" => {
                let pos = self.pos();
                self.diags.error(pos, "`else` without `if`");
                self.next();
                Ok(StmtKind::Block(vec![self.statement()?]))
            }
            "while" => {
                self.next();
                let condition = self.parenthesized()?;
                Ok(StmtKind::While(condition, Box::new(self.inner_statement()?)))
            }
            "do" => self.do_loop(),
            "for" => self.for_loop(),
            "break" | "continue" => {
                self.next();
                self.expect_end()?;
                Ok(if &*word == "break" { StmtKind::Break } else { StmtKind::Continue })
            }
            "emit" => self.lighting(Lighting::Emit),
            "lights" => self.lighting(Lighting::Lights),
            "trace" => self.lighting(Lighting::Trace),
            "return" => {
                self.next();
                let value = if self.is(";") { None } else { Some(self.expr()?) };
                self.expect_end()?;
                Ok(StmtKind::Return(value))
            }
            "uniform" | "varying" | "int" | "double" | "bool" | "const" => {
                self.type_name()?;
                Err(Failed)
            }
            _ if matches!(self.peek_at(1), TokenKind::Word(_)) => {
                // In `colour x = 1;`, two names in a row are a misspelled type.
                self.type_name()?;
                Err(Failed)
            }
            _ => self.expression_statement(),
        }
    }

    fn if_statement(&mut self) -> Parsed<StmtKind> {
        let mut arms = Vec::new();
        loop {
            self.next();
            let condition = self.parenthesized()?;
            arms.push((condition, self.inner_statement()?));
            if !self.eat_word("else") {
                return Ok(StmtKind::If(arms, None));
            }
            if !self.is_word("if") {
                return Ok(StmtKind::If(arms, Some(Box::new(self.inner_statement()?))));
            }
        }
    }

    fn do_loop(&mut self) -> Parsed<StmtKind> {
        self.next();
        let body = Box::new(self.inner_statement()?);
        if !self.eat_word("while") {
            return self.expected("`while`");
        }
        let condition = self.parenthesized()?;
        self.expect_end()?;
        Ok(StmtKind::DoWhile(body, condition))
    }

    /// Parses an `emit`, `lights` or `trace` statement.
    fn lighting(&mut self, kind: Lighting) -> Parsed<StmtKind> {
        self.next();
        if !self.is("(") {
            return self.expected("`(`");
        }
        let (open, depth, pos) = (self.at, self.depth, self.pos());
        let arguments = match self.arguments() {
            Ok(arguments) => arguments,
            Err(Failed) => {
                self.depth = depth;
                self.skip_parentheses(open)?;
                vec![Self::missing(pos)]
            }
        };
        Ok(StmtKind::Lighting(kind, arguments, Box::new(self.inner_statement()?)))
    }

    fn expression_statement(&mut self) -> Parsed<StmtKind> {
        let expr = self.expr()?;
        self.expect_end()?;
        Ok(StmtKind::Expr(expr))
    }

    fn parenthesized(&mut self) -> Parsed<Expr> {
        let (open, depth, pos) = (self.at, self.depth, self.pos());
        self.expect("(")?;
        let condition = self.expr().and_then(|expr| self.expect(")").map(|()| expr));
        condition.or_else(|Failed| {
            self.depth = depth;
            self.skip_parentheses(open).map(|()| Self::missing(pos))
        })
    }

    fn for_loop(&mut self) -> Parsed<StmtKind> {
        self.next();
        let (open, depth, pos) = (self.at, self.depth, self.pos());
        self.expect("(")?;
        let (init, test, step) = match self.for_header() {
            Ok(header) => header,
            Err(Failed) => {
                self.depth = depth;
                self.skip_parentheses(open)?;
                (Stmt { kind: StmtKind::Missing, pos }, None, None)
            }
        };
        Ok(StmtKind::For(Box::new(init), test, step, Box::new(self.inner_statement()?)))
    }

    /// Parses the header of a `for` loop, after the `(`, and the `)`.
    fn for_header(&mut self) -> Parsed<(Stmt, Option<Expr>, Option<Expr>)> {
        let pos = self.pos();
        let kind = if self.eat(";") {
            StmtKind::Empty
        } else if self.type_here().is_some() && !self.is_at(1, "(") {
            match self.declaration()? {
                StmtKind::Function(f) => {
                    self.diags.error(f.name.pos, "a `for` loop cannot declare a function");
                    return Err(Failed);
                }
                other => other,
            }
        } else if matches!((self.peek(), self.peek_at(1)), (TokenKind::Word(_), TokenKind::Word(_))) {
            // The first of two names in a row is a misspelled type.
            self.type_name()?;
            return Err(Failed);
        } else {
            self.expression_statement()?
        };
        let init = Stmt { kind, pos };
        let test = if self.is(";") { None } else { Some(self.expr()?) };
        self.expect(";")?;
        let step = if self.is(")") { None } else { Some(self.expr()?) };
        self.expect(")")?;
        Ok((init, test, step))
    }

    /// Parses variables or a nested function.
    fn declaration(&mut self) -> Parsed<StmtKind> {
        let pos = self.pos();
        let ty = self.type_name()?;
        let name = self.name("a name")?;
        if self.is("(") {
            return Ok(StmtKind::Function(self.function_rest(ty, name)?));
        }
        if ty == ValueType::Void {
            self.diags.error(pos, "a variable cannot be `void`");
            return Err(Failed);
        }
        let mut list = Vec::new();
        let mut name = name;
        loop {
            let array = self.length()?;
            let init = self.initializer()?;
            list.push(Definition { name, array, init });
            if !self.eat(",") {
                break;
            }
            name = self.name("a name")?;
        }
        self.expect_end()?;
        Ok(StmtKind::Variables(ty, list))
    }

    // Expressions (5.9.5), loosest first: assignment, ternary, binary operators, unary, primary.

    fn node(&mut self, kind: ExprKind, pos: Pos, below: u16) -> Parsed<Expr> {
        if below >= MAX_NESTING {
            self.diags.error(pos, format!("the expression is nested more than {MAX_NESTING} deep"));
            self.at = self.tokens.len();
            return Err(Failed);
        }
        Ok(Expr { kind, pos, height: below + 1 })
    }

    fn expr(&mut self) -> Parsed<Expr> {
        self.deeper()?;
        let left = self.ternary()?;
        let operator = match self.peek() {
            TokenKind::Mark("=") => Some(None),
            TokenKind::Mark("*=") => Some(Some(Binary::Mul)),
            TokenKind::Mark("/=") => Some(Some(Binary::Div)),
            TokenKind::Mark("+=") => Some(Some(Binary::Add)),
            TokenKind::Mark("-=") => Some(Some(Binary::Sub)),
            _ => None,
        };
        let expr = match operator {
            Some(operator) => {
                let pos = self.pos();
                if !matches!(left.kind, ExprKind::Variable(..)) {
                    self.diags.error(left.pos, "only a variable can be assigned to");
                }
                self.next();
                let right = self.expr()?;
                let below = left.height.max(right.height);
                self.node(ExprKind::Assign(operator, Box::new(left), Box::new(right)), pos, below)?
            }
            None => left,
        };
        self.depth -= 1;
        Ok(expr)
    }

    fn ternary(&mut self) -> Parsed<Expr> {
        let first = self.binary(0)?;
        if !self.is("?") {
            return Ok(first);
        }
        let pos = self.pos();
        let mut below = 0;
        let mut arms = Vec::new();
        let mut rest = first;
        while self.eat("?") {
            let yes = self.expr()?;
            self.expect(":")?;
            below = below.max(rest.height).max(yes.height);
            arms.push((rest, yes));
            rest = self.binary(0)?;
        }
        below = below.max(rest.height);
        self.node(ExprKind::Select(arms, Box::new(rest)), pos, below)
    }

    /// Parses operators that bind at least as tightly as `least`. All of them group from the left.
    fn binary(&mut self, least: u8) -> Parsed<Expr> {
        let first = self.unary()?;
        let mut links: Vec<Link> = Vec::new();
        while let TokenKind::Mark(mark) = self.peek() {
            let (operator, strength) = match *mark {
                "||" => (Binary::Or, 1),
                "&&" => (Binary::And, 2),
                "==" => (Binary::Eq, 3),
                "!=" => (Binary::Ne, 3),
                "<" => (Binary::Lt, 4),
                "<=" => (Binary::Le, 4),
                ">" => (Binary::Gt, 4),
                ">=" => (Binary::Ge, 4),
                "+" => (Binary::Add, 5),
                "-" => (Binary::Sub, 5),
                "*" => (Binary::Mul, 6),
                "/" => (Binary::Div, 6),
                other @ ("%" | "^" | "&" | "|" | "<<" | ">>") => {
                    let pos = self.pos();
                    let help = match other {
                        "%" => Some("use `mod (a, b)`".to_owned()),
                        "^" => Some("use `cross (a, b)` or `pow (a, b)`".to_owned()),
                        _ => None,
                    };
                    self.diags.error_help(pos, format!("there is no operator `{other}`"), help);
                    return Err(Failed);
                }
                _ => break,
            };
            if strength < least {
                break;
            }
            let pos = self.pos();
            self.next();
            links.push(Link { operator, pos, right: self.binary(strength + 1)? });
        }
        let Some(last) = links.last() else { return Ok(first) };
        let pos = last.pos;
        let below = links.iter().map(|l| l.right.height).fold(first.height, u16::max);
        self.node(ExprKind::Chain(Box::new(first), links), pos, below)
    }

    fn unary(&mut self) -> Parsed<Expr> {
        self.deeper()?;
        let pos = self.pos();
        let expr = match self.peek() {
            TokenKind::Mark(mark @ ("-" | "!" | "+")) => {
                let mark = *mark;
                self.next();
                let inner = self.unary()?;
                let below = inner.height;
                match mark {
                    "-" => self.node(ExprKind::Negate(Box::new(inner)), pos, below)?,
                    "!" => self.node(ExprKind::Not(Box::new(inner)), pos, below)?,
                    _ => inner,
                }
            }
            TokenKind::Mark(mark @ ("++" | "--")) => {
                let up = *mark == "++";
                self.next();
                let target = self.unary()?;
                self.step(target, up, false, pos)?
            }
            TokenKind::Mark("(")
                if matches!(self.peek_at(1), TokenKind::Word(w) if type_named(w).is_some())
                    && self.is_at(2, ")") =>
            {
                self.next();
                let ty = self.value_type("the type of a cast")?;
                self.next();
                let inner = self.unary()?;
                let below = inner.height;
                self.node(ExprKind::Cast(ty, Box::new(inner)), pos, below)?
            }
            _ => {
                let mut expr = self.primary()?;
                while let TokenKind::Mark(mark @ ("++" | "--")) = self.peek() {
                    let (up, at) = (*mark == "++", self.pos());
                    self.next();
                    expr = self.step(expr, up, true, at)?;
                }
                expr
            }
        };
        self.depth -= 1;
        Ok(expr)
    }

    fn step(&mut self, target: Expr, up: bool, postfix: bool, pos: Pos) -> Parsed<Expr> {
        if !matches!(target.kind, ExprKind::Variable(..)) {
            let mark = if up { "++" } else { "--" };
            self.diags.error(pos, format!("`{mark}` needs a variable"));
            return Err(Failed);
        }
        let below = target.height;
        self.node(ExprKind::Step { target: Box::new(target), up, postfix }, pos, below)
    }

    fn primary(&mut self) -> Parsed<Expr> {
        let pos = self.pos();
        match self.peek().clone() {
            TokenKind::Number(value) => {
                self.next();
                self.node(ExprKind::Number(value), pos, 0)
            }
            TokenKind::Text(text) => {
                self.next();
                self.node(ExprKind::Text(text), pos, 0)
            }
            TokenKind::Mark("(") => {
                self.next();
                let inner = self.expr()?;
                self.expect(")")?;
                if self.is("[") && !self.is_at(1, "[") {
                    let at = self.pos();
                    self.diags.error(at, "only a variable can have a subscript");
                    return Err(Failed);
                }
                Ok(inner)
            }
            TokenKind::Word(word) => {
                if let Some(ty) = type_named(&word) {
                    self.next();
                    if ty == ValueType::Void || ty == ValueType::String || !self.is("(") {
                        let cast =
                            (!matches!(self.peek(), TokenKind::Mark(_) | TokenKind::End)).then_some(());
                        let help = cast.map(|()| format!("to cast, write `({word})`"));
                        let what = format!("expected an expression, found the type `{word}`");
                        self.diags.error_help(pos, what, help);
                        return Err(Failed);
                    }
                    let arguments = self.arguments()?;
                    let below = tallest(&arguments);
                    return self.node(ExprKind::Construct(ty, arguments), pos, below);
                }
                if matches!(&*word, "trace" | "lights" | "emit") {
                    self.diags.error(pos, format!("`{word}` is a statement, not an expression"));
                    return Err(Failed);
                }
                let name = self.name("an expression")?;
                if self.is("(") {
                    let arguments = self.arguments()?;
                    if self.is("[") && !self.is_at(1, "[") {
                        let at = self.pos();
                        self.diags.error(at, "only a variable can have a subscript");
                        return Err(Failed);
                    }
                    let below = tallest(&arguments);
                    return self.node(ExprKind::Call(name, arguments), pos, below);
                }
                let mut subscripts = Vec::new();
                while self.is("[") && !self.is_at(1, "[") {
                    self.next();
                    subscripts.push(self.expr()?);
                    self.expect("]")?;
                }
                let below = tallest(&subscripts);
                self.node(ExprKind::Variable(name, subscripts), pos, below)
            }
            _ => self.expected("an expression"),
        }
    }

    /// Parses `( expressions )`.
    fn arguments(&mut self) -> Parsed<Vec<Expr>> {
        self.expect("(")?;
        let mut list = Vec::new();
        if self.eat(")") {
            return Ok(list);
        }
        loop {
            list.push(self.expr()?);
            if self.eat(")") {
                return Ok(list);
            }
            if !self.eat(",") {
                return self.expected("`,` or `)`");
            }
        }
    }
}

fn tallest(list: &[Expr]) -> u16 {
    list.iter().map(|e| e.height).max().unwrap_or(0)
}
