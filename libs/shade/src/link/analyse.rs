//! Analyses the code of a module in one pass.

use super::optimize::{first_written, is_partial, written};
use crate::program::{Block, Op, Program, Stmt};
use granita_gsl::ir::{
    ConstValue, EmitForm, Global, OpCode, ShaderKind, Symbol, SymbolId, SymbolKind, ValueType,
};
use granita_gsl::{Func, ShadeopCall};

/// The result of the analysis.
#[derive(Debug, Default)]
pub(crate) struct Analysis {
    /// Per symbol, true when it is written as a whole and read only where every reader's lanes have written it.
    /// Such a symbol need not keep the values of inactive lanes.
    pub(crate) scratch: Vec<bool>,
    /// The globals that operations or functions write.
    pub(crate) writes: [bool; Global::ALL.len()],
    /// True when the code writes a value other than 1 to `opacity`.
    pub(crate) clears: bool,
    /// The globals that functions and statements read implicitly.
    pub(crate) implied: [bool; Global::ALL.len()],
    /// True when there is an `emit` statement.
    pub(crate) emits: bool,
    /// True when there is a `lights` loop or an illumination function.
    pub(crate) gathers: bool,
    /// True when the code reads neighbouring points.
    pub(crate) derivatives: bool,
    /// True when the code computes or reports something once for all points of a grid. The result then depends on
    /// which points are shaded together.
    pub(crate) gridwise: bool,
    /// The conditions under which `spatialdbsave`, `indirect` and `occlusion` save.
    pub(crate) saves: Vec<Saves>,
    /// The usages that some `getmessage` may query. It is all of them when the source is not constant.
    pub(crate) listens: Vec<ShaderKind>,
    /// True when some `getmessage` may query the light that a `lights` loop examines.
    pub(crate) asks_light: bool,
    /// True when some `getmessage` may query a variable of the primitive.
    pub(crate) asks_primitive: bool,
    /// True when some `getmessage` may query the shader whose ray sees the point.
    pub(crate) queries_parent: bool,
}

/// The condition under which data may be saved to a spatial database.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Saves {
    /// The parameter with this index is not empty.
    Param(u32),
    /// Data may always be saved.
    Any,
}

/// True when a function reads a grid as a whole, or writes once for it.
fn is_gridwise(func: Func) -> bool {
    matches!(
        func,
        Func::GridN
            | Func::GridNU
            | Func::GridNV
            | Func::GridIndex
            | Func::GridAny
            | Func::GridMin
            | Func::GridMax
            | Func::RandomGrid
            | Func::Printf
            | Func::Fprintf
            | Func::Error
            | Func::Shadeop
    )
}

/// Analyses the code of a layer.
pub(crate) fn analyse(program: &Program) -> Analysis {
    let n = program.symbols.len();
    let mut walk = Walk {
        symbols: &program.symbols,
        facts: Analysis { scratch: vec![false; n], ..Analysis::default() },
        usage: vec![Usage::Unused; n],
        open: Vec::new(),
        blocks: 0,
    };
    program.inits.iter().chain([&program.body]).for_each(|block| walk.block(block));
    for (k, usage) in walk.usage.iter().enumerate() {
        let own = matches!(program.symbols[k].kind, SymbolKind::Local | SymbolKind::Temp);
        walk.facts.scratch[k] = own && matches!(usage, Usage::Written(_));
    }
    walk.facts
}

/// The use of a symbol so far.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Usage {
    Unused,
    /// Written as a whole, last in this block. All reads so far were inside the block of the write before them.
    Written(u32),
    /// Anything else.
    Kept,
}

struct Walk<'p> {
    symbols: &'p [Symbol],
    facts: Analysis,
    /// By symbol.
    usage: Vec<Usage>,
    /// The blocks around the current statement. Lanes never return inside one block. Those that leave return after
    /// the statement around it.
    open: Vec<u32>,
    blocks: u32,
}

impl<'p> Walk<'p> {
    fn block(&mut self, block: &Block) {
        self.open.push(self.blocks);
        self.blocks += 1;
        for stmt in block {
            self.stmt(stmt);
        }
        self.open.pop();
    }

    fn stmt(&mut self, stmt: &Stmt) {
        if matches!(stmt, Stmt::Loop { .. } | Stmt::Lights { .. } | Stmt::Emit { .. } | Stmt::Trace { .. }) {
            // A round may begin with the values of the last one. Only the values that it writes first are its own.
            let usage = &mut self.usage;
            written(stmt, self.symbols, &mut |s| {
                let usage = &mut usage[s.0 as usize];
                if *usage != Usage::Kept {
                    *usage = Usage::Unused;
                }
            });
        }
        match stmt {
            Stmt::Op(op) => self.op(op),
            Stmt::If { cond, then, otherwise } => {
                self.read(*cond);
                self.block(then);
                self.block(otherwise);
            }
            Stmt::Loop { body_first: _, test, cond, body, step } => {
                // The condition is read inside the block of the test.
                self.open.push(self.blocks);
                self.blocks += 1;
                for stmt in test {
                    self.stmt(stmt);
                }
                if let Some(cond) = cond {
                    self.read(*cond);
                }
                self.open.pop();
                self.block(body);
                self.block(step);
            }
            Stmt::Scope { id: _, body } => self.block(body),
            Stmt::Leave(_) | Stmt::Break | Stmt::Continue | Stmt::Exit => {}
            Stmt::Lights { category, position, cone, body, at: _ } => {
                self.facts.gathers = true;
                self.imply(&SURROUNDINGS);
                for &sym in category.iter().chain([position]).chain(cone.iter().flat_map(|(a, b)| [a, b])) {
                    self.read(sym);
                }
                self.block(body);
            }
            Stmt::Emit { form, body, at: _ } => {
                self.facts.emits = true;
                self.imply(&SURROUNDINGS);
                match form {
                    EmitForm::Point(from) => self.read(*from),
                    EmitForm::Cone { from, axis, angle } => {
                        [from, axis, angle].into_iter().for_each(|&s| self.read(s));
                    }
                    EmitForm::Distant { axis, spread } => {
                        [axis, spread].into_iter().for_each(|&s| self.read(s));
                    }
                    EmitForm::Reflection => {}
                }
                for global in [Global::L, Global::Cl] {
                    self.facts.writes[global as usize] = true;
                }
                self.block(body);
            }
            Stmt::Trace { set, position, axis, angle, samples, options, body, at: _, call: _ } => {
                self.imply(&SURROUNDINGS);
                for &sym in [set, position, axis, angle, samples]
                    .into_iter()
                    .chain(options.iter().flat_map(|(name, value)| [name, value]))
                {
                    self.read(sym);
                }
                self.block(body);
            }
        }
    }

    fn op(&mut self, op: &Op) {
        for &arg in &op.args {
            self.read(arg);
        }
        if let Some(func) = op.func() {
            self.call(func, op);
        }
        if let Some(dst) = op.dst {
            let partial = is_partial(op, self.symbols);
            let was = self.facts.clears;
            self.write(dst, partial);
            if op.is(OpCode::Assign) && self.is_one(op.args[0]) {
                self.facts.clears = was;
            }
        }
    }

    /// True when a symbol is the constant 1, or a triple of ones.
    fn is_one(&self, sym: SymbolId) -> bool {
        match &self.symbol(sym).kind {
            SymbolKind::Const(ConstValue::Floats(values)) => values.iter().all(|v| *v == 1.0),
            _ => false,
        }
    }

    /// Notes globals that are read implicitly.
    fn imply(&mut self, globals: &[Global]) {
        globals.iter().for_each(|&g| self.facts.implied[g as usize] = true);
    }

    /// Notes the side effects of a function.
    fn call(&mut self, func: Func, op: &Op) {
        // Plain functions read only their operands. The others may read any of the globals.
        if !is_plain(func) {
            self.imply(&SURROUNDINGS);
        }
        self.facts.gridwise |= is_gridwise(func);
        match func {
            Func::DeltaU | Func::DeltaV | Func::FilterWidth | Func::SurfaceNormal | Func::SampleArea => {
                self.facts.derivatives = true;
            }
            Func::AaStep | Func::Texture | Func::Texture3d | Func::Environment | Func::Shadow => {
                self.facts.derivatives = true;
            }
            Func::Ambient | Func::Diffuse | Func::Specular => self.facts.gathers = true,
            Func::Displace => {
                self.facts.derivatives = true;
                self.facts.writes[Global::P as usize] = true;
                self.facts.writes[Global::N as usize] = true;
            }
            Func::Bump => {
                self.facts.derivatives = true;
                self.facts.writes[Global::N as usize] = true;
            }
            Func::SpatialDbSave => self.facts.saves.push(Saves::Any),
            Func::Indirect | Func::Occlusion => self.database(op),
            Func::GetMessage => {
                let source = op.args.first().and_then(|&s| self.constant(s));
                let may_be = |word: &str| source.is_none_or(|s| s == word);
                let [parent, light, primitive] = ["parent", "light", "primitive"].map(may_be);
                let usages: Vec<ShaderKind> = USAGES.into_iter().filter(|k| may_be(k.word())).collect();
                self.facts.queries_parent |= parent;
                self.facts.asks_light |= light;
                self.facts.asks_primitive |= primitive;
                self.facts.listens.extend(usages);
            }
            _ => {}
        }
        let written = op.args.iter().skip(first_written(op));
        if func == Func::Shadeop {
            // Its validated text describes which operands are written.
            let call = op.args.first().and_then(|&s| self.constant(s)).and_then(ShadeopCall::parse);
            let outputs = call.map(|call| call.outputs);
            let outputs = outputs.unwrap_or_default();
            written.zip(&outputs).filter(|(_, o)| **o).for_each(|(&s, _)| self.write(s, true));
            return;
        }
        for &arg in written {
            // Options are among these operands. Their names, and most of their values, are constants.
            if !matches!(self.symbol(arg).kind, SymbolKind::Const(_)) {
                self.write(arg, true);
            }
        }
    }

    /// Notes the options of a call that name a database or its mode.
    fn database(&mut self, op: &Op) {
        let is_text = |sym: &SymbolId| self.symbol(*sym).ty.value == ValueType::String;
        // No operand after the geometry set is a string, so the options begin with the first string.
        let options = op.args.iter().skip(1).position(is_text).map_or(&[][..], |first| &op.args[first + 1..]);
        for pair in options.chunks_exact(2) {
            let named = self.constant(pair[0]).is_none_or(|name| matches!(name, "filename" | "filemode"));
            if !named || self.constant(pair[1]) == Some("") {
                continue;
            }
            let saves = match self.symbol(pair[1]).kind {
                SymbolKind::Param(k) => Saves::Param(k),
                _ => Saves::Any,
            };
            self.facts.saves.push(saves);
        }
    }

    fn symbol(&self, sym: SymbolId) -> &'p Symbol {
        &self.symbols[sym.0 as usize]
    }

    /// Returns the text of a constant string.
    fn constant(&self, sym: SymbolId) -> Option<&'p str> {
        match &self.symbol(sym).kind {
            SymbolKind::Const(ConstValue::Strings(v)) => v.first().map(|s| &**s),
            _ => None,
        }
    }

    fn read(&mut self, sym: SymbolId) {
        let usage = &mut self.usage[sym.0 as usize];
        match *usage {
            Usage::Written(block) if self.open.contains(&block) => {}
            _ => *usage = Usage::Kept,
        }
    }

    fn write(&mut self, sym: SymbolId, partial: bool) {
        let block = self.open.last().copied().unwrap_or(0);
        let usage = &mut self.usage[sym.0 as usize];
        *usage = if *usage == Usage::Kept || partial { Usage::Kept } else { Usage::Written(block) };
        if let SymbolKind::Global(g) = self.symbol(sym).kind {
            self.facts.writes[g as usize] = true;
            self.facts.clears |= g == Global::opacity;
        }
    }
}

/// Globals that functions and statements of light may read.
pub(super) const SURROUNDINGS: [Global; 9] = [
    Global::P,
    Global::N,
    Global::Ng,
    Global::I,
    Global::Ps,
    Global::Pl,
    Global::Nl,
    Global::dPdu,
    Global::dPdv,
];

/// True when a function reads only its operands.
pub(super) fn is_plain(func: Func) -> bool {
    use Func as F;
    matches!(
        func,
        F::Radians
            | F::Degrees
            | F::Sin
            | F::Cos
            | F::Tan
            | F::Asin
            | F::Acos
            | F::Atan
            | F::Sinh
            | F::Cosh
            | F::Tanh
            | F::Pow
            | F::Exp
            | F::Log
            | F::Log2
            | F::Log10
            | F::Sqrt
            | F::InverseSqrt
            | F::Hypot
            | F::Abs
            | F::Fabs
            | F::Sign
            | F::Floor
            | F::Ceil
            | F::Round
            | F::Trunc
            | F::Mod
            | F::Min
            | F::Max
            | F::Clamp
            | F::Mix
            | F::IsNan
            | F::IsInf
            | F::Finite
            | F::Erf
            | F::Erfc
            | F::Dot
            | F::Cross
            | F::Length
            | F::Distance
            | F::Normalize
            | F::Reflect
            | F::Refract
            | F::Luminance
            | F::Step
            | F::SmoothStep
            | F::Noise
            | F::SNoise
            | F::CNoise
            | F::PNoise
            | F::PSNoise
            | F::PNNoise
            | F::Random
            | F::RandomGrid
            | F::Spline
    )
}

/// Returns the usage for a source name of `getmessage`.
pub(crate) fn usage_word(word: &str) -> Option<ShaderKind> {
    USAGES.into_iter().find(|k| k.word() == word)
}

/// The usages of the shaders of an object.
const USAGES: [ShaderKind; 3] = [ShaderKind::Surface, ShaderKind::Displacement, ShaderKind::Volume];
