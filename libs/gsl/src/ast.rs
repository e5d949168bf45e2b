//! The syntax tree, as written (reference 5.9).

use crate::ir::{ShaderKind, ValueType};
use crate::source::Pos;
use std::sync::Arc;

#[derive(Clone, Debug)]
pub(crate) struct Name {
    pub(crate) text: Arc<str>,
    pub(crate) pos: Pos,
}

#[derive(Debug)]
pub(crate) struct Shader {
    pub(crate) kind: ShaderKind,
    pub(crate) name: Name,
    pub(crate) metadata: Vec<Datum>,
    pub(crate) params: Vec<Param>,
    pub(crate) body: Vec<Stmt>,
}

#[derive(Debug)]
pub(crate) struct Datum {
    pub(crate) ty: ValueType,
    pub(crate) name: Name,
    pub(crate) value: Expr,
}

#[derive(Debug)]
pub(crate) struct Param {
    pub(crate) output: bool,
    pub(crate) ty: ValueType,
    pub(crate) name: Name,
    pub(crate) array: Option<Length>,
    pub(crate) init: Option<Init>,
    pub(crate) metadata: Vec<Datum>,
}

#[derive(Debug)]
pub(crate) enum Length {
    Fixed(Expr),
    /// The length `[]`.
    Open(Pos),
}

#[derive(Debug)]
pub(crate) enum Init {
    One(Expr),
    List(Vec<Expr>, Pos),
}

#[derive(Debug)]
pub(crate) struct Function {
    pub(crate) ty: ValueType,
    pub(crate) name: Name,
    pub(crate) params: Vec<Formal>,
    pub(crate) body: Vec<Stmt>,
}

#[derive(Debug)]
pub(crate) struct Formal {
    pub(crate) output: bool,
    pub(crate) ty: ValueType,
    pub(crate) name: Name,
    pub(crate) array: Option<Length>,
}

#[derive(Debug)]
pub(crate) struct Definition {
    pub(crate) name: Name,
    pub(crate) array: Option<Length>,
    pub(crate) init: Option<Init>,
}

#[derive(Debug)]
pub(crate) struct Stmt {
    pub(crate) kind: StmtKind,
    pub(crate) pos: Pos,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Lighting {
    Emit,
    Lights,
    Trace,
}

impl Lighting {
    pub(crate) fn word(self) -> &'static str {
        match self {
            Self::Emit => "emit",
            Self::Lights => "lights",
            Self::Trace => "trace",
        }
    }
}

#[derive(Debug)]
pub(crate) enum StmtKind {
    Empty,
    /// A statement that could not be parsed.
    Missing,
    Expr(Expr),
    Block(Vec<Stmt>),
    Variables(ValueType, Vec<Definition>),
    Function(Function),
    /// The conditions with their statements, from `if` through all `else if`, and the last `else`.
    If(Vec<(Expr, Stmt)>, Option<Box<Stmt>>),
    While(Expr, Box<Stmt>),
    DoWhile(Box<Stmt>, Expr),
    For(Box<Stmt>, Option<Expr>, Option<Expr>, Box<Stmt>),
    Break,
    Continue,
    Lighting(Lighting, Vec<Expr>, Box<Stmt>),
    Return(Option<Expr>),
}

#[derive(Debug)]
pub(crate) struct Expr {
    pub(crate) kind: ExprKind,
    pub(crate) pos: Pos,
    /// The number of nodes from here to the deepest leaf. The parser bounds it, so that traversals may recurse. A
    /// sequence of any number of operators is one node.
    pub(crate) height: u16,
}

/// An operator and its right operand. The left operand is all that comes before it.
#[derive(Debug)]
pub(crate) struct Link {
    pub(crate) operator: Binary,
    /// The position of the operator.
    pub(crate) pos: Pos,
    pub(crate) right: Expr,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Binary {
    Mul,
    Div,
    Add,
    Sub,
    Eq,
    Ne,
    Lt,
    Le,
    Gt,
    Ge,
    And,
    Or,
}

impl Binary {
    pub(crate) fn word(self) -> &'static str {
        match self {
            Self::Mul => "*",
            Self::Div => "/",
            Self::Add => "+",
            Self::Sub => "-",
            Self::Eq => "==",
            Self::Ne => "!=",
            Self::Lt => "<",
            Self::Le => "<=",
            Self::Gt => ">",
            Self::Ge => ">=",
            Self::And => "&&",
            Self::Or => "||",
        }
    }
}

#[derive(Debug)]
pub(crate) enum ExprKind {
    /// An expression that could not be parsed.
    Missing,
    Number(f32),
    Text(Arc<str>),
    /// A variable with up to three subscripts, which are the element, then the component or the row and the column.
    Variable(Name, Vec<Expr>),
    Call(Name, Vec<Expr>),
    Construct(ValueType, Vec<Expr>),
    Cast(ValueType, Box<Expr>),
    Negate(Box<Expr>),
    Not(Box<Expr>),
    /// An operand, and the operations on it from left to right.
    Chain(Box<Expr>, Vec<Link>),
    /// The conditions with their values along `c ? a : d ? b : ...`, and the value where none holds.
    Select(Vec<(Expr, Expr)>, Box<Expr>),
    /// An assignment with `=`, or with the operator of `+=` and so on. The left side is a `Variable`.
    Assign(Option<Binary>, Box<Expr>, Box<Expr>),
    /// The operator `++` or `--` on a `Variable`.
    Step {
        target: Box<Expr>,
        up: bool,
        /// True when the value is the one before the step.
        postfix: bool,
    },
}
