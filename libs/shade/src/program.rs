//! Linked code, which the executor runs.
//!
//! A [`Program`] is made from a module when it is linked. Its statements are those of the stored code. Its
//! operations are those of the stored code and the ones that linking adds ([`Operation::Select`],
//! [`Operation::Fused`]), which no file holds.

use granita_gsl::Func;
use granita_gsl::ir::{self, EmitForm, Module, OpCode, ScopeId, SourcePos, Symbol, SymbolId, ValueType};

/// The storage of a symbol.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum At {
    /// A register.
    Slot(u32),
    /// A constant of the group.
    Const(u32),
}

/// The place and shape of a symbol for the executor.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    pub(crate) at: At,
    pub(crate) value: ValueType,
    /// The number of elements, with the actual length of variable-length parameters; 1 when not an array.
    pub(crate) elements: u32,
    pub(crate) array: bool,
    /// True when values of inactive lanes need not be kept.
    pub(crate) scratch: bool,
}

/// The code of an operation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) enum Operation {
    /// An operation that the compiler stored.
    Stored(OpCode),
    /// Returns `args[1]` where float `args[0]` is not 0, else `args[2]`. All of them are computed.
    Select,
    /// Replaces the plain operations after it by the tape with this index. It has no operands and no result.
    Fused(u32),
}

/// The index of a call with options of a layer.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct CallId(pub(crate) u32);

/// One operation.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Op {
    pub(crate) code: Operation,
    /// Result; `None` for functions without one.
    pub(crate) dst: Option<SymbolId>,
    /// Operands.
    pub(crate) args: Vec<SymbolId>,
    /// The place in the source.
    pub(crate) at: SourcePos,
    /// The options of a function that has them, once the code is complete.
    pub(crate) call: Option<CallId>,
}

impl Op {
    /// Returns the operation `dst = from`.
    pub(crate) fn assign(dst: SymbolId, from: SymbolId, at: SourcePos) -> Self {
        Self { code: Operation::Stored(OpCode::Assign), dst: Some(dst), args: vec![from], at, call: None }
    }

    /// Returns the library function that it calls.
    pub(crate) fn func(&self) -> Option<Func> {
        match self.code {
            Operation::Stored(OpCode::Call(func)) => Some(func),
            _ => None,
        }
    }

    /// True when it is a stored operation of this code.
    pub(crate) fn is(&self, code: OpCode) -> bool {
        self.code == Operation::Stored(code)
    }
}

/// Statements in order.
pub(crate) type Block = Vec<Stmt>;

/// One statement. [`ir::Stmt`] describes each kind.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Stmt {
    Op(Op),
    If {
        cond: SymbolId,
        then: Block,
        otherwise: Block,
    },
    Loop {
        body_first: bool,
        test: Block,
        cond: Option<SymbolId>,
        body: Block,
        step: Block,
    },
    Scope {
        id: ScopeId,
        body: Block,
    },
    Leave(ScopeId),
    Break,
    Continue,
    Exit,
    Lights {
        category: Option<SymbolId>,
        position: SymbolId,
        cone: Option<(SymbolId, SymbolId)>,
        body: Block,
        at: SourcePos,
    },
    Emit {
        form: EmitForm,
        body: Block,
        at: SourcePos,
    },
    Trace {
        set: SymbolId,
        position: SymbolId,
        axis: SymbolId,
        angle: SymbolId,
        samples: SymbolId,
        options: Vec<(SymbolId, SymbolId)>,
        body: Block,
        at: SourcePos,
        /// The options, as [`Op::call`].
        call: Option<CallId>,
    },
}

/// The code of a layer.
#[derive(Clone, Debug)]
pub(crate) struct Program {
    /// All symbols: those of the module, and those that linking adds after them.
    pub(crate) symbols: Vec<Symbol>,
    /// By parameter, the code that computes its default.
    pub(crate) inits: Vec<Block>,
    /// The body.
    pub(crate) body: Block,
}

impl Program {
    /// Returns the code as it was compiled.
    pub(crate) fn of(module: &Module) -> Self {
        Self {
            symbols: module.symbols.clone(),
            inits: module.params.iter().map(|param| block(&param.init)).collect(),
            body: block(&module.body),
        }
    }
}

fn block(stored: &ir::Block) -> Block {
    stored.iter().map(stmt).collect()
}

fn stmt(stored: &ir::Stmt) -> Stmt {
    match stored {
        ir::Stmt::Op(op) => Stmt::Op(Op {
            code: Operation::Stored(op.code),
            dst: op.dst,
            args: op.args.clone(),
            at: op.at,
            call: None,
        }),
        ir::Stmt::If { cond, then, otherwise } => {
            Stmt::If { cond: *cond, then: block(then), otherwise: block(otherwise) }
        }
        ir::Stmt::Loop { body_first, test, cond, body, step } => Stmt::Loop {
            body_first: *body_first,
            test: block(test),
            cond: *cond,
            body: block(body),
            step: block(step),
        },
        ir::Stmt::Scope { id, body } => Stmt::Scope { id: *id, body: block(body) },
        ir::Stmt::Leave(id) => Stmt::Leave(*id),
        ir::Stmt::Break => Stmt::Break,
        ir::Stmt::Continue => Stmt::Continue,
        ir::Stmt::Exit => Stmt::Exit,
        ir::Stmt::Lights { category, position, cone, body, at } => {
            Stmt::Lights { category: *category, position: *position, cone: *cone, body: block(body), at: *at }
        }
        ir::Stmt::Emit { form, body, at } => Stmt::Emit { form: *form, body: block(body), at: *at },
        ir::Stmt::Trace { set, position, axis, angle, samples, options, body, at } => Stmt::Trace {
            set: *set,
            position: *position,
            axis: *axis,
            angle: *angle,
            samples: *samples,
            options: options.clone(),
            body: block(body),
            at: *at,
            call: None,
        },
    }
}
