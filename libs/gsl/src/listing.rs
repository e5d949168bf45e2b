//! Prints the IR as text, for people and for tests.

use crate::ir::*;
use std::fmt::Write;

impl Module {
    /// Returns the parameters' initialisers and the body, one statement per line, with indented blocks.
    ///
    /// Variables are printed by their names (with the symbol's index when another has the same name), temporaries as
    /// `%n`, unnamed locals as `$n`, and constants as their values.
    pub fn listing(&self) -> String {
        let mut lister = Lister { module: self, out: String::new(), indent: 0 };
        for param in &self.params {
            lister.line(&format!("param {}:", lister.name(param.symbol)));
            lister.block(&param.init);
        }
        lister.line(&format!("{} {}:", self.kind.word(), self.name));
        lister.block(&self.body);
        lister.out
    }
}

struct Lister<'a> {
    module: &'a Module,
    out: String,
    indent: usize,
}

impl Lister<'_> {
    fn line(&mut self, text: &str) {
        // Writing to a string does not fail.
        let _ = writeln!(self.out, "{:width$}{text}", "", width = 2 * self.indent);
    }

    fn block(&mut self, block: &Block) {
        self.indent += 1;
        block.iter().for_each(|s| self.statement(s));
        self.indent -= 1;
    }

    fn name(&self, id: SymbolId) -> String {
        let Some(symbol) = self.module.symbols.get(id.0 as usize) else { return format!("?{}", id.0) };
        match &symbol.kind {
            SymbolKind::Temp => format!("%{}", id.0),
            SymbolKind::Const(value) => constant(value, symbol.ty.elements()),
            _ if symbol.name.is_empty() => format!("${}", id.0),
            _ => {
                let twin =
                    self.module.symbols.iter().any(|s| s.name == symbol.name && !std::ptr::eq(s, symbol));
                if twin { format!("{}.{}", symbol.name, id.0) } else { symbol.name.to_string() }
            }
        }
    }

    fn names(&self, list: &[SymbolId]) -> String {
        let words: Vec<String> = list.iter().map(|s| self.name(*s)).collect();
        words.join(", ")
    }

    fn statement(&mut self, statement: &Stmt) {
        match statement {
            Stmt::Op(op) => {
                let code = match op.code {
                    OpCode::Call(func) => func.word().to_owned(),
                    code => format!("{code:?}"),
                };
                let dst = op.dst.map_or(String::new(), |d| format!("{} = ", self.name(d)));
                let line = format!("{dst}{code} {}", self.names(&op.args));
                self.line(line.trim_end());
            }
            Stmt::If { cond, then, otherwise } => {
                self.line(&format!("if {}", self.name(*cond)));
                self.block(then);
                if !otherwise.is_empty() {
                    self.line("else");
                    self.block(otherwise);
                }
            }
            Stmt::Loop { body_first, test, cond, body, step } => {
                let kind = if *body_first { "loop, body first" } else { "loop" };
                let cond = cond.map_or(String::new(), |c| format!(" while {}", self.name(c)));
                self.line(&format!("{kind}{cond}"));
                for (name, block) in [("test", test), ("body", body), ("step", step)] {
                    if !block.is_empty() {
                        self.line(name);
                        self.block(block);
                    }
                }
            }
            Stmt::Scope { id, body } => {
                self.line(&format!("scope {}", id.0));
                self.block(body);
            }
            Stmt::Leave(id) => self.line(&format!("leave {}", id.0)),
            Stmt::Break => self.line("break"),
            Stmt::Continue => self.line("continue"),
            Stmt::Exit => self.line("exit"),
            Stmt::Lights { category, position, cone, body, .. } => {
                let mut args: Vec<SymbolId> = category.iter().copied().collect();
                args.push(*position);
                args.extend(cone.iter().flat_map(|(a, b)| [*a, *b]));
                self.line(&format!("lights {}", self.names(&args)));
                self.block(body);
            }
            Stmt::Emit { form, body, .. } => {
                let form = match *form {
                    EmitForm::Point(from) => format!("point {}", self.name(from)),
                    EmitForm::Cone { from, axis, angle } => {
                        format!("cone {}", self.names(&[from, axis, angle]))
                    }
                    EmitForm::Distant { axis, spread } => format!("distant {}", self.names(&[axis, spread])),
                    EmitForm::Reflection => "reflection".to_owned(),
                };
                self.line(&format!("emit {form}"));
                self.block(body);
            }
            Stmt::Trace { set, position, axis, angle, samples, options, body, .. } => {
                let mut args = vec![*set, *position, *axis, *angle, *samples];
                args.extend(options.iter().flat_map(|(a, b)| [*a, *b]));
                self.line(&format!("trace {}", self.names(&args)));
                self.block(body);
            }
        }
    }
}

fn constant(value: &ConstValue, elements: usize) -> String {
    let words: Vec<String> = match value {
        ConstValue::Floats(v) => v.iter().map(f32::to_string).collect(),
        ConstValue::Strings(v) => v.iter().map(|s| format!("{s:?}")).collect(),
    };
    match words.as_slice() {
        [one] => one.clone(),
        many if many.iter().all(|w| *w == many[0]) && elements == 1 => format!("({})", many[0]),
        many => format!("({})", many.join(" ")),
    }
}
