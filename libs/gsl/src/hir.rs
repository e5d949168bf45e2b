//! The checked tree. Names are resolved, overloads are chosen, and every expression is typed. Functions are not inlined
//! yet.

use crate::builtins::Signature;
use crate::ir::{ConstValue, Global, OpCode, SymbolType, ValueType};
use crate::source::Pos;
use std::sync::Arc;

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct VarId(pub(crate) usize);

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct FuncId(pub(crate) usize);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum VarKind {
    Global(Global),
    /// A parameter of the shader.
    Param {
        index: usize,
        output: bool,
    },
    Local,
    /// A parameter of a function.
    Formal {
        output: bool,
    },
}

/// A variable and its use.
#[derive(Debug)]
pub(crate) struct Var {
    pub(crate) name: Arc<str>,
    pub(crate) ty: SymbolType,
    pub(crate) kind: VarKind,
    pub(crate) pos: Pos,
    pub(crate) read: bool,
    pub(crate) written: bool,
    /// True when a warning was already reported.
    pub(crate) warned: bool,
    /// The numbers of functions and loops around the declaration.
    pub(crate) level: (usize, usize),
}

#[derive(Debug)]
pub(crate) struct Func {
    pub(crate) name: Arc<str>,
    pub(crate) ret: ValueType,
    pub(crate) formals: Vec<VarId>,
    pub(crate) body: Vec<Stmt>,
    /// True when its body is checked. Before that, a call is a recursion.
    pub(crate) complete: bool,
    pub(crate) returns: bool,
    /// The external function that is called instead of the body.
    pub(crate) shadeop: Option<Arc<str>>,
}

/// A part of a variable.
#[derive(Debug)]
pub(crate) struct Place {
    pub(crate) var: VarId,
    /// The element of an array.
    pub(crate) element: Option<Box<Expr>>,
    pub(crate) component: Component,
    pub(crate) pos: Pos,
}

#[derive(Debug)]
pub(crate) enum Component {
    All,
    /// A component of a triple.
    One(Box<Expr>),
    /// The row and the column of a matrix.
    Cell(Box<Expr>, Box<Expr>),
}

impl Place {
    pub(crate) fn is_whole(&self) -> bool {
        self.element.is_none() && matches!(self.component, Component::All)
    }
}

#[derive(Debug)]
pub(crate) struct Expr {
    pub(crate) ty: SymbolType,
    pub(crate) kind: ExprKind,
    pub(crate) pos: Pos,
}

/// An operator and its right operand.
#[derive(Debug)]
pub(crate) struct Link {
    /// An operation on the left operand before the operator. It is a conversion to this type, or (`Truth`) a test
    /// whether it is true.
    pub(crate) left: Option<(OpCode, ValueType)>,
    pub(crate) operator: Operator,
    pub(crate) right: Expr,
    /// The type of the result.
    pub(crate) ty: ValueType,
    pub(crate) pos: Pos,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Operator {
    Op(OpCode),
    And,
    Or,
}

#[derive(Debug)]
pub(crate) enum ExprKind {
    Const(ConstValue),
    Read(Place),
    Unary(OpCode, Box<Expr>),
    /// A value, and the operations on it from left to right. There is at least one.
    Chain(Box<Expr>, Vec<Link>),
    /// The conditions with their values, and the value where none holds.
    Select(Vec<(Expr, Expr)>, Box<Expr>),
    /// A conversion to the type of this expression.
    Convert(Box<Expr>),
    Construct {
        space: Option<Box<Expr>>,
        parts: Vec<Expr>,
    },
    /// A call of a built-in function. Output arguments are `Read` expressions.
    Builtin {
        signature: &'static Signature,
        args: Vec<Expr>,
        outputs: Vec<bool>,
    },
    Call {
        func: FuncId,
        args: Vec<Expr>,
    },
    Exit,
    Assign {
        place: Place,
        op: Option<OpCode>,
        value: Box<Expr>,
    },
    Step {
        place: Place,
        up: bool,
        postfix: bool,
    },
    /// An error that has been reported.
    Bad,
}

#[derive(Debug)]
pub(crate) struct Stmt {
    pub(crate) kind: StmtKind,
    pub(crate) pos: Pos,
}

#[derive(Debug)]
pub(crate) enum Init {
    None,
    One(Expr),
    /// One value for each element.
    List(Vec<Expr>),
}

/// A condition and the code that it controls.
#[derive(Debug)]
pub(crate) struct Arm {
    pub(crate) condition: Expr,
    pub(crate) body: Vec<Stmt>,
}

#[derive(Debug)]
pub(crate) enum StmtKind {
    Expr(Expr),
    Declare(VarId, Init),
    Block(Vec<Stmt>),
    /// A conditional statement, in the form of [`crate::ast::StmtKind::If`].
    If(Vec<Arm>, Vec<Stmt>),
    Loop {
        body_first: bool,
        test: Option<Expr>,
        body: Vec<Stmt>,
        step: Option<Expr>,
    },
    Break,
    Continue,
    Return(Option<Expr>),
    Emit(Vec<Expr>, Vec<Stmt>),
    Lights {
        category: Option<Expr>,
        position: Expr,
        cone: Option<(Expr, Expr)>,
        body: Vec<Stmt>,
    },
    Trace {
        /// The set, position, axis, angle and number of samples.
        args: Vec<Expr>,
        options: Vec<(Expr, Expr)>,
        body: Vec<Stmt>,
    },
}

#[derive(Debug)]
pub(crate) struct Param {
    pub(crate) var: VarId,
    pub(crate) output: bool,
    pub(crate) init: Init,
    pub(crate) metadata: Vec<crate::ir::Metadatum>,
}

/// A checked shader.
#[derive(Debug)]
pub(crate) struct Shader {
    pub(crate) kind: crate::ir::ShaderKind,
    pub(crate) name: Arc<str>,
    pub(crate) metadata: Vec<crate::ir::Metadatum>,
    pub(crate) params: Vec<Param>,
    pub(crate) body: Vec<Stmt>,
    pub(crate) vars: Vec<Var>,
    pub(crate) funcs: Vec<Func>,
}
