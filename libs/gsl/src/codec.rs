// tidy: long: the encoder and the decoder of each part are in one file, so that they change together
//! Encodes modules as bytes. Lengths and ids are variable-length numbers (7 bits per byte, low bits first). Floats are
//! stored as their bits, enums as their index in the tables here, and functions by name.

use crate::Func;
use crate::ir::*;
use std::sync::Arc;

/// The largest depth of nested blocks in a file, which is more than lowering makes.
const MAX_BLOCKS: usize = 600;

const KINDS: [ShaderKind; 5] = [
    ShaderKind::Surface,
    ShaderKind::Displacement,
    ShaderKind::Volume,
    ShaderKind::Light,
    ShaderKind::Generic,
];

const TYPES: [ValueType; 8] = [
    ValueType::Void,
    ValueType::Float,
    ValueType::Color,
    ValueType::Point,
    ValueType::Vector,
    ValueType::Normal,
    ValueType::Matrix,
    ValueType::String,
];

/// All opcodes except calls. The order is part of the file format.
const CODES: [OpCode; 21] = [
    OpCode::Assign,
    OpCode::Neg,
    OpCode::Add,
    OpCode::Sub,
    OpCode::Mul,
    OpCode::Div,
    OpCode::Eq,
    OpCode::Ne,
    OpCode::Lt,
    OpCode::Le,
    OpCode::Gt,
    OpCode::Ge,
    OpCode::Not,
    OpCode::Truth,
    OpCode::Index,
    OpCode::IndexSet,
    OpCode::Component,
    OpCode::ComponentSet,
    OpCode::MatrixComponent,
    OpCode::MatrixComponentSet,
    OpCode::Construct,
];

/// The functions that a module calls, in order of first use.
#[derive(Default)]
pub(crate) struct FuncTable(Vec<Func>);

impl FuncTable {
    fn of(module: &Module) -> Self {
        let mut table = Self::default();
        module.params.iter().for_each(|p| table.collect(&p.init));
        table.collect(&module.body);
        table
    }

    fn collect(&mut self, block: &Block) {
        for statement in block {
            match statement {
                Stmt::Op(Op { code: OpCode::Call(func), .. }) if !self.0.contains(func) => self.0.push(*func),
                _ => statement.blocks().into_iter().for_each(|b| self.collect(b)),
            }
        }
    }

    pub(crate) fn read(decoder: &mut Decoder<'_>) -> Result<Self, String> {
        let list = decoder.list(|d| {
            let name = d.text()?;
            let found = Func::ALL.iter().find(|f| f.word() == &*name);
            found.copied().ok_or_else(|| format!("the function `{name}` is unknown"))
        })?;
        Ok(Self(list))
    }
}

impl Stmt {
    /// Returns the blocks directly inside.
    pub(crate) fn blocks(&self) -> Vec<&Block> {
        match self {
            Self::If { then, otherwise, .. } => vec![then, otherwise],
            Self::Loop { test, body, step, .. } => vec![test, body, step],
            Self::Scope { body, .. }
            | Self::Lights { body, .. }
            | Self::Emit { body, .. }
            | Self::Trace { body, .. } => vec![body],
            Self::Op(_) | Self::Leave(_) | Self::Break | Self::Continue | Self::Exit => Vec::new(),
        }
    }
}

#[derive(Default)]
pub(crate) struct Encoder {
    pub(crate) bytes: Vec<u8>,
}

impl Encoder {
    fn byte(&mut self, b: u8) {
        self.bytes.push(b);
    }

    fn number(&mut self, n: u32) {
        let mut n = n;
        while n >= 0x80 {
            self.byte(n as u8 | 0x80);
            n >>= 7;
        }
        self.byte(n as u8);
    }

    fn text(&mut self, text: &str) {
        self.number(text.len() as u32);
        self.bytes.extend_from_slice(text.as_bytes());
    }

    fn id(&mut self, id: SymbolId) {
        self.number(id.0);
    }

    /// Writes 0 for `None`, else the id plus 1.
    fn maybe(&mut self, id: Option<SymbolId>) {
        self.number(id.map_or(0, |id| id.0 + 1));
    }

    fn list<T>(&mut self, list: &[T], mut put: impl FnMut(&mut Self, &T)) {
        self.number(list.len() as u32);
        list.iter().for_each(|item| put(self, item));
    }

    fn place<T: PartialEq>(&mut self, table: &[T], item: &T) {
        self.byte(place_in(table, item) as u8);
    }

    fn constant(&mut self, value: &ConstValue) {
        match value {
            ConstValue::Floats(v) => {
                self.byte(0);
                self.list(v, |e, x| e.bytes.extend_from_slice(&x.to_bits().to_le_bytes()));
            }
            ConstValue::Strings(v) => {
                self.byte(1);
                self.list(v, |e, s| e.text(s));
            }
        }
    }

    fn metadata(&mut self, list: &[Metadatum]) {
        self.list(list, |e, m| {
            e.place(&TYPES, &m.ty);
            e.text(&m.name);
            e.constant(&m.value);
        });
    }

    fn symbol_type(&mut self, ty: &SymbolType) {
        self.place(&TYPES, &ty.value);
        self.byte(u8::from(ty.array.is_some()) | u8::from(ty.open) << 1);
        if let Some(n) = ty.array {
            self.number(n);
        }
    }

    pub(crate) fn header(&mut self, module: &Module) {
        self.place(&KINDS, &module.kind);
        self.text(&module.name);
        self.metadata(&module.metadata);
        self.list(&module.params, |e, p| {
            let symbol = module.symbol(p.symbol);
            e.text(&symbol.name);
            e.symbol_type(&symbol.ty);
            e.byte(u8::from(p.output));
            match &p.default {
                DefaultValue::Unknown => e.byte(0),
                DefaultValue::Known { spaces, value } => {
                    match spaces.as_slice() {
                        [] => e.byte(1),
                        [space] => {
                            e.byte(2);
                            e.text(space);
                        }
                        several => {
                            e.byte(3);
                            e.list(several, |e, space| e.text(space));
                        }
                    }
                    e.constant(value);
                }
            }
            e.metadata(&p.metadata);
        });
    }

    pub(crate) fn body(&mut self, module: &Module) {
        let functions = FuncTable::of(module);
        self.list(&functions.0, |e, f| e.text(f.word()));
        self.list(&module.symbols, |e, s| {
            e.text(&s.name);
            e.symbol_type(&s.ty);
            match &s.kind {
                SymbolKind::Global(g) => {
                    e.byte(0);
                    e.place(&Global::ALL, g);
                }
                SymbolKind::Param(i) => {
                    e.byte(1);
                    e.number(*i);
                }
                SymbolKind::Local => e.byte(2),
                SymbolKind::Temp => e.byte(3),
                SymbolKind::Const(value) => {
                    e.byte(4);
                    e.constant(value);
                }
            }
        });
        for param in &module.params {
            self.id(param.symbol);
            self.block(&param.init, &functions);
        }
        self.block(&module.body, &functions);
        self.list(&module.files, |e, f| e.text(f));
        self.list(&module.reads, |e, g| e.place(&Global::ALL, g));
        self.list(&module.writes, |e, g| e.place(&Global::ALL, g));
        self.byte(u8::from(module.needs_derivatives));
    }

    fn at(&mut self, at: SourcePos) {
        self.number(u32::from(at.file));
        self.number(at.line);
    }

    fn block(&mut self, block: &Block, functions: &FuncTable) {
        self.list(block, |e, s| e.statement(s, functions));
    }

    fn statement(&mut self, statement: &Stmt, functions: &FuncTable) {
        match statement {
            Stmt::Op(op) => {
                self.byte(0);
                match op.code {
                    OpCode::Call(func) => self.number((CODES.len() + place_in(&functions.0, &func)) as u32),
                    code => self.number(place_in(&CODES, &code) as u32),
                }
                self.maybe(op.dst);
                self.list(&op.args, |e, a| e.id(*a));
                self.at(op.at);
            }
            Stmt::If { cond, then, otherwise } => {
                self.byte(1);
                self.id(*cond);
                self.block(then, functions);
                self.block(otherwise, functions);
            }
            Stmt::Loop { body_first, test, cond, body, step } => {
                self.byte(2);
                self.byte(u8::from(*body_first));
                self.maybe(*cond);
                self.block(test, functions);
                self.block(body, functions);
                self.block(step, functions);
            }
            Stmt::Scope { id, body } => {
                self.byte(3);
                self.number(id.0);
                self.block(body, functions);
            }
            Stmt::Leave(id) => {
                self.byte(4);
                self.number(id.0);
            }
            Stmt::Break => self.byte(5),
            Stmt::Continue => self.byte(6),
            Stmt::Exit => self.byte(7),
            Stmt::Lights { category, position, cone, body, at } => {
                self.byte(8);
                self.maybe(*category);
                self.id(*position);
                self.maybe(cone.map(|c| c.0));
                if let Some((_, angle)) = cone {
                    self.id(*angle);
                }
                self.block(body, functions);
                self.at(*at);
            }
            Stmt::Emit { form, body, at } => {
                self.byte(9);
                match *form {
                    EmitForm::Reflection => self.byte(0),
                    EmitForm::Point(from) => {
                        self.byte(1);
                        self.id(from);
                    }
                    EmitForm::Distant { axis, spread } => {
                        self.byte(2);
                        [axis, spread].into_iter().for_each(|s| self.id(s));
                    }
                    EmitForm::Cone { from, axis, angle } => {
                        self.byte(3);
                        [from, axis, angle].into_iter().for_each(|s| self.id(s));
                    }
                }
                self.block(body, functions);
                self.at(*at);
            }
            Stmt::Trace { set, position, axis, angle, samples, options, body, at } => {
                self.byte(10);
                [set, position, axis, angle, samples].into_iter().for_each(|s| self.id(*s));
                self.list(options, |e, (name, value)| {
                    e.id(*name);
                    e.id(*value);
                });
                self.block(body, functions);
                self.at(*at);
            }
        }
    }
}

/// Returns the index of an item. The tables contain all items, because a missing one could not be decoded.
fn place_in<T: PartialEq>(table: &[T], item: &T) -> usize {
    table.iter().position(|t| t == item).expect("invariant: the tables of the format are complete")
}

pub(crate) struct Decoder<'a> {
    rest: &'a [u8],
    depth: usize,
}

type Decoded<T> = Result<T, String>;

fn early<T>() -> Decoded<T> {
    Err("it ends too early".to_owned())
}

impl<'a> Decoder<'a> {
    pub(crate) fn new(bytes: &'a [u8]) -> Self {
        Self { rest: bytes, depth: 0 }
    }

    pub(crate) fn end(&self) -> Decoded<()> {
        if self.rest.is_empty() { Ok(()) } else { Err(format!("{} bytes are left over", self.rest.len())) }
    }

    fn bytes(&mut self, n: usize) -> Decoded<&'a [u8]> {
        let Some((taken, rest)) = self.rest.split_at_checked(n) else { return early() };
        self.rest = rest;
        Ok(taken)
    }

    fn byte(&mut self) -> Decoded<u8> {
        Ok(self.bytes(1)?[0])
    }

    fn flag(&mut self) -> Decoded<bool> {
        match self.byte()? {
            0 => Ok(false),
            1 => Ok(true),
            other => Err(format!("{other} is not a boolean")),
        }
    }

    fn number(&mut self) -> Decoded<u32> {
        let mut value = 0u64;
        for shift in (0..35).step_by(7) {
            let byte = self.byte()?;
            value |= u64::from(byte & 0x7f) << shift;
            if byte < 0x80 {
                return u32::try_from(value).map_err(|_| format!("{value} is too large"));
            }
        }
        Err("a number is too long".to_owned())
    }

    fn text(&mut self) -> Decoded<Arc<str>> {
        let n = self.number()? as usize;
        let text = std::str::from_utf8(self.bytes(n)?).map_err(|_| "a name is not UTF-8".to_owned())?;
        Ok(text.into())
    }

    fn id(&mut self) -> Decoded<SymbolId> {
        Ok(SymbolId(self.number()?))
    }

    fn maybe(&mut self) -> Decoded<Option<SymbolId>> {
        Ok(self.number()?.checked_sub(1).map(SymbolId))
    }

    /// Reads a list. An item has at least one byte, so a length beyond the rest is refused before memory is allocated.
    fn list<T>(&mut self, mut item: impl FnMut(&mut Self) -> Decoded<T>) -> Decoded<Vec<T>> {
        let n = self.number()? as usize;
        if n > self.rest.len() {
            return early();
        }
        let mut out = Vec::new();
        for _ in 0..n {
            out.push(item(self)?);
        }
        Ok(out)
    }

    fn place<T: Copy>(&mut self, table: &[T], what: &str) -> Decoded<T> {
        let i = self.byte()?;
        table.get(i as usize).copied().ok_or_else(|| format!("{i} is not a {what}"))
    }

    fn constant(&mut self) -> Decoded<ConstValue> {
        Ok(match self.byte()? {
            0 => {
                let list = self.list(|d| {
                    let bits = d.bytes(4)?.try_into().map(u32::from_le_bytes);
                    bits.map(f32::from_bits).map_err(|_| String::new())
                })?;
                ConstValue::Floats(list.into())
            }
            1 => ConstValue::Strings(self.list(Self::text)?.into()),
            other => return Err(format!("{other} is not a kind of constant")),
        })
    }

    fn metadata(&mut self) -> Decoded<Vec<Metadatum>> {
        self.list(|d| {
            let ty = d.value_type()?;
            let name = d.text()?;
            let value = d.constant()?;
            check_value(&SymbolType::of(ty), &value)?;
            Ok(Metadatum { ty, name, value })
        })
    }

    fn value_type(&mut self) -> Decoded<ValueType> {
        match self.place(&TYPES, "type")? {
            ValueType::Void => Err("a symbol cannot be `void`".to_owned()),
            other => Ok(other),
        }
    }

    fn symbol_type(&mut self) -> Decoded<SymbolType> {
        let value = self.value_type()?;
        let flags = self.byte()?;
        let array = match flags {
            0 => None,
            1 | 3 => Some(self.number()?),
            other => return Err(format!("{other} is not a kind of array")),
        };
        let open = flags == 3;
        if array.is_some_and(|n| n > crate::check::MAX_ARRAY || (n == 0 && !open)) {
            return Err("an array has an invalid length".to_owned());
        }
        Ok(SymbolType { value, array, open })
    }

    /// Decodes a module with parameters only. Their symbols are present, in order, and everything else is empty.
    pub(crate) fn header(&mut self) -> Decoded<Module> {
        let kind = self.place(&KINDS, "kind of shader")?;
        let name = self.text()?;
        let metadata = self.metadata()?;
        let mut symbols = Vec::new();
        let params = self.list(|d| {
            let name = d.text()?;
            let ty = d.symbol_type()?;
            let output = d.flag()?;
            let default = match d.byte()? {
                0 => DefaultValue::Unknown,
                known @ 1..=3 => {
                    let spaces = match known {
                        1 => Vec::new(),
                        2 => vec![d.text()?],
                        _ => d.list(|d| d.text())?,
                    };
                    if known == 3 && (spaces.len() < 2 || spaces.len() != ty.elements()) {
                        return Err(format!("{} spaces for {} elements", spaces.len(), ty.elements()));
                    }
                    let value = d.constant()?;
                    check_value(&ty, &value)?;
                    DefaultValue::Known { spaces, value }
                }
                other => return Err(format!("{other} is not a kind of default")),
            };
            let metadata = d.metadata()?;
            let symbol = SymbolId(symbols.len() as u32);
            symbols.push(Symbol { name, ty, kind: SymbolKind::Param(symbol.0) });
            Ok(ParamDecl { symbol, output, default, init: Vec::new(), metadata })
        })?;
        Ok(Module {
            kind,
            name,
            metadata,
            params,
            symbols,
            body: Vec::new(),
            files: Vec::new(),
            reads: Vec::new(),
            writes: Vec::new(),
            needs_derivatives: false,
        })
    }

    pub(crate) fn body(&mut self, module: &mut Module, functions: &FuncTable) -> Decoded<()> {
        let header = std::mem::take(&mut module.symbols);
        module.symbols = self.list(|d| {
            let name = d.text()?;
            let ty = d.symbol_type()?;
            let kind = match d.byte()? {
                0 => SymbolKind::Global(d.place(&Global::ALL, "global")?),
                1 => SymbolKind::Param(d.number()?),
                2 => SymbolKind::Local,
                3 => SymbolKind::Temp,
                4 => SymbolKind::Const(d.constant()?),
                other => return Err(format!("{other} is not a kind of symbol")),
            };
            Ok(Symbol { name, ty, kind })
        })?;
        for i in 0..module.params.len() {
            let symbol = self.id()?;
            let found = module.symbols.get(symbol.0 as usize);
            if found != header.get(i) {
                return Err(format!("parameter {i} differs from the header"));
            }
            module.params[i].symbol = symbol;
            module.params[i].init = self.block(functions)?;
        }
        module.body = self.block(functions)?;
        module.files = self.list(Self::text)?;
        module.reads = self.list(|d| d.place(&Global::ALL, "global"))?;
        module.writes = self.list(|d| d.place(&Global::ALL, "global"))?;
        module.needs_derivatives = self.flag()?;
        Ok(())
    }

    fn at(&mut self) -> Decoded<SourcePos> {
        let file = u16::try_from(self.number()?).map_err(|_| "a file number is too large".to_owned())?;
        Ok(SourcePos { file, line: self.number()? })
    }

    fn block(&mut self, functions: &FuncTable) -> Decoded<Block> {
        self.depth += 1;
        if self.depth > MAX_BLOCKS {
            return Err(format!("blocks are nested more than {MAX_BLOCKS} deep"));
        }
        let block = self.list(|d| d.statement(functions))?;
        self.depth -= 1;
        Ok(block)
    }

    fn statement(&mut self, functions: &FuncTable) -> Decoded<Stmt> {
        Ok(match self.byte()? {
            0 => {
                let code = self.number()? as usize;
                let code = match CODES.get(code) {
                    Some(code) => *code,
                    None => match functions.0.get(code - CODES.len()) {
                        Some(func) => OpCode::Call(*func),
                        None => return Err(format!("{code} is not an operation")),
                    },
                };
                let dst = self.maybe()?;
                let args = self.list(Self::id)?;
                Stmt::Op(Op { code, dst, args, at: self.at()? })
            }
            1 => {
                let cond = self.id()?;
                let then = self.block(functions)?;
                Stmt::If { cond, then, otherwise: self.block(functions)? }
            }
            2 => {
                let body_first = self.flag()?;
                let cond = self.maybe()?;
                let test = self.block(functions)?;
                let body = self.block(functions)?;
                Stmt::Loop { body_first, test, cond, body, step: self.block(functions)? }
            }
            3 => Stmt::Scope { id: ScopeId(self.number()?), body: self.block(functions)? },
            4 => Stmt::Leave(ScopeId(self.number()?)),
            5 => Stmt::Break,
            6 => Stmt::Continue,
            7 => Stmt::Exit,
            8 => {
                let category = self.maybe()?;
                let position = self.id()?;
                let cone = match self.maybe()? {
                    Some(axis) => Some((axis, self.id()?)),
                    None => None,
                };
                let body = self.block(functions)?;
                Stmt::Lights { category, position, cone, body, at: self.at()? }
            }
            9 => {
                let form = match self.byte()? {
                    0 => EmitForm::Reflection,
                    1 => EmitForm::Point(self.id()?),
                    2 => EmitForm::Distant { axis: self.id()?, spread: self.id()? },
                    3 => EmitForm::Cone { from: self.id()?, axis: self.id()?, angle: self.id()? },
                    other => return Err(format!("{other} is not a form of emit")),
                };
                let body = self.block(functions)?;
                Stmt::Emit { form, body, at: self.at()? }
            }
            10 => {
                let (set, position, axis) = (self.id()?, self.id()?, self.id()?);
                let (angle, samples) = (self.id()?, self.id()?);
                let options = self.list(|d| Ok((d.id()?, d.id()?)))?;
                let body = self.block(functions)?;
                Stmt::Trace { set, position, axis, angle, samples, options, body, at: self.at()? }
            }
            other => return Err(format!("{other} is not a statement")),
        })
    }
}

/// Checks that a constant has as many numbers or strings as its type requires.
pub(crate) fn check_value(ty: &SymbolType, value: &ConstValue) -> Decoded<()> {
    let fits = match value {
        ConstValue::Floats(v) => {
            ty.value != ValueType::String && v.len() == ty.value.components() * ty.elements()
        }
        ConstValue::Strings(v) => ty.value == ValueType::String && v.len() == ty.elements(),
    };
    if fits { Ok(()) } else { Err("a constant does not have its type's size".to_owned()) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the operation after another one, in an order that contains all. An operation that is added to the
    /// language and missing here does not compile.
    fn next(code: OpCode) -> Option<OpCode> {
        use OpCode as C;
        Some(match code {
            C::Assign => C::Neg,
            C::Neg => C::Add,
            C::Add => C::Sub,
            C::Sub => C::Mul,
            C::Mul => C::Div,
            C::Div => C::Eq,
            C::Eq => C::Ne,
            C::Ne => C::Lt,
            C::Lt => C::Le,
            C::Le => C::Gt,
            C::Gt => C::Ge,
            C::Ge => C::Not,
            C::Not => C::Truth,
            C::Truth => C::Index,
            C::Index => C::IndexSet,
            C::IndexSet => C::Component,
            C::Component => C::ComponentSet,
            C::ComponentSet => C::MatrixComponent,
            C::MatrixComponent => C::MatrixComponentSet,
            C::MatrixComponentSet => C::Construct,
            C::Construct => C::Call(crate::Func::Sin),
            C::Call(_) => return None,
        })
    }

    #[test]
    fn every_operation_is_in_the_table_of_the_format() {
        let all: Vec<OpCode> = std::iter::successors(Some(OpCode::Assign), |code| next(*code)).collect();
        assert_eq!(all[..all.len() - 1], CODES);
        assert!(all.iter().rev().skip(1).all(|code| CODES[place_in(&CODES, code)] == *code));
    }

    #[test]
    #[should_panic(expected = "the tables of the format are complete")]
    fn encoding_a_value_outside_of_the_table_panics() {
        Encoder::default().place(&TYPES[..3], &ValueType::Matrix);
    }
}
