//! The intermediate representation, which the compiler makes, `.gso` files store and the executor runs.
//!
//! A [`Module`] is one shader. All functions have been inlined (recursion is not permitted, arguments are passed by
//! reference), so its code is one tree of structured statements over typed **symbols**. There are no pointers and no
//! jumps. The tree can be interpreted over masked lanes or printed as WGSL. Every symbol is either the same for all
//! points (uniform) or not (varying). The executor tracks this at run time. It is not part of the IR.
//!
//! Semantics:
//! - A statement affects **active lanes** only. `If` and `Loop` narrow them. `Break`, `Continue`, [`Stmt::Leave`] and
//!   `Exit` remove lanes from the innermost loop, the rest of its iteration, a named scope and the shader,
//!   respectively.
//! - `&&`, `||` and `?:` have been lowered to `If`, so operands with side effects run only as in C.
//! - Conversions happen in [`OpCode::Assign`] and on operands. A float is replicated to a triple, or fills the diagonal
//!   of a matrix. Triples are copied to each other.
//! - The type of an operation is the type of its `dst` symbol. Operands convert to it, except where the opcode defines
//!   otherwise.

use granita_base::{BaseType, Location};
use std::sync::Arc;

/// The kind of a shader (reference 5.1.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[allow(missing_docs, reason = "the words are the language's")]
pub enum ShaderKind {
    Surface,
    Displacement,
    Volume,
    Light,
    /// A `shader` of any usage, which is checked when it is attached.
    Generic,
}

impl ShaderKind {
    /// Returns the keyword that declares it.
    pub fn word(self) -> &'static str {
        match self {
            Self::Surface => "surface",
            Self::Displacement => "displacement",
            Self::Volume => "volume",
            Self::Light => "light",
            Self::Generic => "shader",
        }
    }
}

/// The type of one value (reference 5.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[allow(missing_docs, reason = "the words are the language's")]
pub enum ValueType {
    Void,
    Float,
    Color,
    Point,
    Vector,
    Normal,
    Matrix,
    String,
}

impl ValueType {
    /// Returns the number of floats of one value; 1 for a string, 0 for void.
    pub fn components(self) -> usize {
        match self {
            Self::Void => 0,
            Self::Float | Self::String => 1,
            Self::Color | Self::Point | Self::Vector | Self::Normal => 3,
            Self::Matrix => 16,
        }
    }

    /// Returns the scene's type of such values; `None` for void.
    pub fn base_type(self) -> Option<BaseType> {
        Some(match self {
            Self::Void => return None,
            Self::Float => BaseType::Float,
            Self::Color => BaseType::Color,
            Self::Point => BaseType::Point,
            Self::Vector => BaseType::Vector,
            Self::Normal => BaseType::Normal,
            Self::Matrix => BaseType::Matrix,
            Self::String => BaseType::String,
        })
    }

    /// True when it is a colour, point, vector or normal.
    pub fn is_triple(self) -> bool {
        self.components() == 3
    }

    /// True when it is a point, vector or normal.
    pub fn is_point_like(self) -> bool {
        matches!(self, Self::Point | Self::Vector | Self::Normal)
    }

    /// Returns the keyword.
    pub fn word(self) -> &'static str {
        match self {
            Self::Void => "void",
            Self::Float => "float",
            Self::Color => "color",
            Self::Point => "point",
            Self::Vector => "vector",
            Self::Normal => "normal",
            Self::Matrix => "matrix",
            Self::String => "string",
        }
    }
}

/// The type of a symbol: a value or an array of values.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SymbolType {
    /// The type of one element.
    pub value: ValueType,
    /// The array length. For a variable-length parameter, it is the number of its initialisers.
    pub array: Option<u32>,
    /// True when it is declared with `[]`, so that the instance may have another length.
    pub open: bool,
}

impl SymbolType {
    /// Returns the type of a value that is not an array.
    pub const fn of(value: ValueType) -> Self {
        Self { value, array: None, open: false }
    }

    /// Returns the number of elements; 1 when not an array.
    pub fn elements(&self) -> usize {
        self.array.unwrap_or(1) as usize
    }
}

/// An index into [`Module::symbols`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct SymbolId(pub u32);

/// The predefined variables (reference 5.7).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
#[allow(missing_docs, reason = "the names are the language's")]
#[allow(non_camel_case_types, reason = "the names are the language's")]
pub enum Global {
    P,
    I,
    N,
    Ng,
    dPdu,
    dPdv,
    u,
    v,
    L,
    Cl,
    Ps,
    Ns,
    Pl,
    Nl,
    C,
    opacity,
    time,
    dtime,
    dPdtime,
}

impl Global {
    /// All globals, in declaration order.
    pub const ALL: [Self; 19] = [
        Self::P,
        Self::I,
        Self::N,
        Self::Ng,
        Self::dPdu,
        Self::dPdv,
        Self::u,
        Self::v,
        Self::L,
        Self::Cl,
        Self::Ps,
        Self::Ns,
        Self::Pl,
        Self::Nl,
        Self::C,
        Self::opacity,
        Self::time,
        Self::dtime,
        Self::dPdtime,
    ];

    /// Returns its name.
    pub fn word(self) -> &'static str {
        match self {
            Self::P => "P",
            Self::I => "I",
            Self::N => "N",
            Self::Ng => "Ng",
            Self::dPdu => "dPdu",
            Self::dPdv => "dPdv",
            Self::u => "u",
            Self::v => "v",
            Self::L => "L",
            Self::Cl => "Cl",
            Self::Ps => "Ps",
            Self::Ns => "Ns",
            Self::Pl => "Pl",
            Self::Nl => "Nl",
            Self::C => "C",
            Self::opacity => "opacity",
            Self::time => "time",
            Self::dtime => "dtime",
            Self::dPdtime => "dPdtime",
        }
    }

    /// Returns its type.
    pub fn value_type(self) -> ValueType {
        match self {
            Self::P | Self::Ps | Self::Pl => ValueType::Point,
            Self::I | Self::L | Self::dPdu | Self::dPdv | Self::dPdtime => ValueType::Vector,
            Self::N | Self::Ng | Self::Ns | Self::Nl => ValueType::Normal,
            Self::Cl | Self::C | Self::opacity => ValueType::Color,
            Self::u | Self::v | Self::time | Self::dtime => ValueType::Float,
        }
    }
}

/// The meaning of a symbol.
#[derive(Clone, Debug, PartialEq)]
pub enum SymbolKind {
    /// A predefined variable.
    Global(Global),
    /// A shader parameter, by its index in [`Module::params`].
    Param(u32),
    /// A variable of the source or of an inlined function.
    Local,
    /// A temporary of the compiler. It is written before it is read.
    Temp,
    /// A constant, with its values element by element.
    Const(ConstValue),
}

/// A constant.
#[derive(Clone, Debug, PartialEq)]
pub enum ConstValue {
    /// The components of all elements.
    Floats(Arc<[f32]>),
    /// The strings of all elements.
    Strings(Arc<[Arc<str>]>),
}

/// A variable, parameter, temporary or constant.
#[derive(Clone, Debug, PartialEq)]
pub struct Symbol {
    /// The name in the source; empty for temporaries and constants.
    pub name: Arc<str>,
    /// Its type.
    pub ty: SymbolType,
    /// Its meaning.
    pub kind: SymbolKind,
}

/// A list of statements, in order.
pub type Block = Vec<Stmt>;

/// Identifies a [`Stmt::Scope`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ScopeId(pub u32);

/// One statement.
#[derive(Clone, Debug, PartialEq)]
pub enum Stmt {
    /// One operation.
    Op(Op),
    /// A condition. It is false when `cond` is 0.
    If {
        /// A float symbol.
        cond: SymbolId,
        /// The code for the lanes where it is not 0.
        then: Block,
        /// The code for the other lanes.
        otherwise: Block,
    },
    /// A loop of any kind.
    Loop {
        /// True for `do ... while`, whose first iteration runs without a test.
        body_first: bool,
        /// The code that computes `cond`, before each test.
        test: Block,
        /// A float symbol; `None` for a loop without a test.
        cond: Option<SymbolId>,
        /// The body.
        body: Block,
        /// The code after the body and after `Continue`, before the next test.
        step: Block,
    },
    /// Code that [`Stmt::Leave`] can leave, such as an inlined function.
    Scope {
        /// Its id.
        id: ScopeId,
        /// Its code.
        body: Block,
    },
    /// Makes active lanes skip the rest of the scope.
    Leave(ScopeId),
    /// Leaves the innermost loop (of `Loop` only).
    Break,
    /// Continues with the next iteration of the innermost loop.
    Continue,
    /// Ends the shader. It is `exit ()`, or `return` in the shader's own body.
    Exit,
    /// A `lights` statement. The body runs once per light sample with `L`, `Cl`, `Pl`, `Nl` set.
    Lights {
        /// A string symbol; `None` takes all non-ambient lights.
        category: Option<SymbolId>,
        /// A point symbol.
        position: SymbolId,
        /// A vector symbol (axis) and a float symbol (half angle in radians).
        cone: Option<(SymbolId, SymbolId)>,
        /// The body.
        body: Block,
        /// The position in the source.
        at: SourcePos,
    },
    /// An `emit` statement, in a light shader.
    Emit {
        /// The form of the statement.
        form: EmitForm,
        /// The body, which sets `Cl`.
        body: Block,
        /// The position in the source.
        at: SourcePos,
    },
    /// A `trace` statement. The body runs once per ray.
    Trace {
        /// A string symbol, the geometry set.
        set: SymbolId,
        /// A point symbol.
        position: SymbolId,
        /// A vector symbol.
        axis: SymbolId,
        /// A float symbol, the half angle in radians.
        angle: SymbolId,
        /// A float symbol, the number of samples.
        samples: SymbolId,
        /// The names (strings) and the values, in pairs.
        options: Vec<(SymbolId, SymbolId)>,
        /// The body.
        body: Block,
        /// The position in the source.
        at: SourcePos,
    },
}

/// The forms of `emit` (reference 5.5.5).
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum EmitForm {
    /// The form `emit (point from)`.
    Point(SymbolId),
    /// The form `emit (point from, vector axis, float angle)`.
    Cone {
        /// A point symbol.
        from: SymbolId,
        /// A vector symbol.
        axis: SymbolId,
        /// A float symbol, the half angle in radians.
        angle: SymbolId,
    },
    /// The form `emit (vector axis, float spreadangle)`.
    Distant {
        /// A vector symbol. Light travels along it.
        axis: SymbolId,
        /// A float symbol, in radians.
        spread: SymbolId,
    },
    /// The form `emit ()`, along the reflection direction.
    Reflection,
}

/// A position in the source.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SourcePos {
    /// An index into [`Module::files`].
    pub file: u16,
    /// The line, counted from 1; 0 when unknown.
    pub line: u32,
}

/// One operation.
#[derive(Clone, Debug, PartialEq)]
pub struct Op {
    /// The operation code.
    pub code: OpCode,
    /// The result; `None` for functions without one.
    pub dst: Option<SymbolId>,
    /// The operands.
    pub args: Vec<SymbolId>,
    /// The position in the source.
    pub at: SourcePos,
}

/// The code of an operation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum OpCode {
    /// Sets `dst = args[0]`, converted. Whole arrays are copied when their lengths agree.
    Assign,
    /// Computes `-args[0]`.
    Neg,
    /// Adds component by component.
    Add,
    /// Subtracts component by component.
    Sub,
    /// Multiplies component by component. For matrices, it is the matrix product (of row vectors, so the left one
    /// applies first).
    Mul,
    /// Divides component by component. For matrices, it is the product with the inverse.
    Div,
    /// Computes float 1 when all components, or the strings, are equal. The operands have equal types after promotion.
    Eq,
    /// Computes the opposite of `Eq`.
    Ne,
    /// Compares floats. The result is a float.
    Lt,
    /// Compares floats. The result is a float.
    Le,
    /// Compares floats. The result is a float.
    Gt,
    /// Compares floats. The result is a float.
    Ge,
    /// Computes float 1 when `args[0]` is zero in all components, or an empty string.
    Not,
    /// Computes float 1 when `args[0]` is not zero in some component, or not an empty string.
    Truth,
    /// Sets `dst = args[0][floor (args[1])]` of an array. An index outside of the array is reported once, and takes the
    /// nearest element.
    Index,
    /// Sets `dst[floor (args[0])] = args[1]` of an array.
    IndexSet,
    /// Sets the float `dst` to component `floor (args[1])` of the triple `args[0]`.
    Component,
    /// Sets component `floor (args[0])` of the triple `dst` to `args[1]`.
    ComponentSet,
    /// Sets the float `dst` to `args[0][args[1]][args[2]]` of a matrix, row then column.
    MatrixComponent,
    /// Sets `dst[args[0]][args[1]] = args[2]` of a matrix.
    MatrixComponentSet,
    /// Makes a triple from 1 or 3 floats, or a matrix from 1 or 16, by the type of `dst`. A string in front names the
    /// space (or colour space) of the floats, and the result is in "common" (or "rgb").
    Construct,
    /// Calls a function of the standard library.
    Call(crate::Func),
}

/// A default that is available without running the shader.
#[derive(Clone, Debug, PartialEq)]
pub enum DefaultValue {
    /// A constant, in named spaces where these were given.
    Known {
        /// The spaces as written in `point ("shader", ...)` or `color ("hsv", ...)`. The list is empty when none was
        /// given. One space holds for all elements. Several are one for each element of an array, with empty texts
        /// where none was given.
        spaces: Vec<Arc<str>>,
        /// The values of all elements.
        value: ConstValue,
    },
    /// The default is computed. It is printed as "Unknown default value".
    Unknown,
}

/// A metadatum (reference 5.4).
#[derive(Clone, Debug, PartialEq)]
pub struct Metadatum {
    /// The declared type.
    pub ty: ValueType,
    /// The name.
    pub name: Arc<str>,
    /// The constant value.
    pub value: ConstValue,
}

/// A shader parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct ParamDecl {
    /// Its symbol, which has the name and type.
    pub symbol: SymbolId,
    /// True when it is declared `output`.
    pub output: bool,
    /// The default, for queries.
    pub default: DefaultValue,
    /// Computes the default into the symbol, when the parameter has no other value. Parameters are initialised in
    /// order, so it may read globals and earlier parameters.
    pub init: Block,
    /// The metadata of the parameter.
    pub metadata: Vec<Metadatum>,
}

/// One compiled shader.
#[derive(Clone, Debug, PartialEq)]
pub struct Module {
    /// The kind of shader.
    pub kind: ShaderKind,
    /// The name in the source.
    pub name: Arc<str>,
    /// The metadata of the shader.
    pub metadata: Vec<Metadatum>,
    /// The parameters in order of declaration.
    pub params: Vec<ParamDecl>,
    /// All symbols. Each global and constant appears at most once.
    pub symbols: Vec<Symbol>,
    /// The body.
    pub body: Block,
    /// The source files, for messages.
    pub files: Vec<Arc<str>>,
    /// The globals that are read anywhere, including initialisers.
    pub reads: Vec<Global>,
    /// The globals that are written anywhere.
    pub writes: Vec<Global>,
    /// True when a function reads neighbouring points.
    pub needs_derivatives: bool,
}

impl Module {
    /// Returns a symbol.
    pub fn symbol(&self, id: SymbolId) -> &Symbol {
        &self.symbols[id.0 as usize]
    }

    /// Returns the parameter called `name`.
    pub fn param(&self, name: &str) -> Option<&ParamDecl> {
        self.params.iter().find(|p| &*self.symbol(p.symbol).name == name)
    }

    /// Returns a source position for messages.
    pub fn location(&self, at: SourcePos) -> Location {
        match self.files.get(at.file as usize) {
            Some(file) => Location::line(file, at.line),
            None => Location::default(),
        }
    }
}
