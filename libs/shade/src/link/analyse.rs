//! What a module does, found by walking its code once.

use super::optimize::written;
use crate::ShadeError;
use granita_gsl::ir::{
    Block, ConstValue, EmitForm, Global, Module, Op, OpCode, ShaderKind, Stmt, SymbolId, SymbolKind,
    ValueType,
};
use granita_gsl::{Func, ShadeopCall};

/// What the walk finds.
#[derive(Debug, Default)]
pub(crate) struct Facts {
    /// Per symbol: written as a whole, and read only where every reader's lanes have written it. Such a symbol
    /// need not keep the values of inactive lanes.
    pub(crate) scratch: Vec<bool>,
    /// Globals that operations or functions write.
    pub(crate) writes: [bool; Global::ALL.len()],
    /// Writes `opacity`, and something else than 1.
    pub(crate) clears: bool,
    /// Globals that functions and statements read without naming them.
    pub(crate) implied: [bool; Global::ALL.len()],
    /// Has an `emit` statement.
    pub(crate) emits: bool,
    /// Has a `lights` loop or an illumination function.
    pub(crate) gathers: bool,
    /// Looks at neighbouring points.
    pub(crate) derivatives: bool,
    /// Asks for, or does, something once for all points of a grid: what it finds depends on which points are shaded together.
    pub(crate) gridwise: bool,
    /// What may make `spatialdbsave`, `indirect` and `occlusion` save.
    pub(crate) saves: Vec<Saves>,
    /// Usages that some `getmessage` may ask: all where the source is not constant.
    pub(crate) listens: Vec<ShaderKind>,
    /// Some `getmessage` may ask the light that a `lights` loop examines.
    pub(crate) asks_light: bool,
    /// Some `getmessage` may ask for a variable of the primitive.
    pub(crate) asks_primitive: bool,
    /// Some `getmessage` may ask the shader whose ray sees the point.
    pub(crate) asks_parent: bool,
}

/// When something may be saved to a spatial database.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Saves {
    /// When the parameter of this number is not empty.
    Param(u32),
    /// Always.
    Any,
}

/// Whether a function sees a grid as a whole, or is written to once for it.
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

/// Walks a module and checks that it holds together.
///
/// Errors: [`ShadeError::Malformed`] for symbols out of range, operands that are missing, operations that
/// write constants.
pub(crate) fn analyse(module: &Module) -> Result<Facts, ShadeError> {
    let n = module.symbols.len();
    for symbol in &module.symbols {
        let want = symbol.ty.elements() * symbol.ty.value.components();
        let have = match &symbol.kind {
            SymbolKind::Const(ConstValue::Floats(v)) => v.len(),
            SymbolKind::Const(ConstValue::Strings(v)) => v.len(),
            SymbolKind::Param(k) if *k as usize >= module.params.len() => {
                return Err(malformed(module, format!("parameter {k} of {}", module.params.len())));
            }
            _ => want,
        };
        if have != want || want == 0 {
            return Err(malformed(module, format!("symbol \"{}\" has {have} of {want} values", symbol.name)));
        }
    }
    let mut walk = Walk {
        module,
        facts: Facts { scratch: vec![false; n], ..Facts::default() },
        symbols: vec![Usage::Unused; n],
        open: Vec::new(),
        blocks: 0,
        error: None,
    };
    for param in &module.params {
        walk.touch(param.symbol, true);
        walk.block(&param.init);
    }
    walk.block(&module.body);
    if let Some(what) = walk.error {
        return Err(malformed(module, what));
    }
    for (k, usage) in walk.symbols.iter().enumerate() {
        let own = matches!(module.symbols[k].kind, SymbolKind::Local | SymbolKind::Temp);
        walk.facts.scratch[k] = own && matches!(usage, Usage::Written(_));
    }
    Ok(walk.facts)
}

fn malformed(module: &Module, what: String) -> ShadeError {
    ShadeError::Malformed { shader: module.name.clone(), what }
}

/// How a symbol has been used so far.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Usage {
    Unused,
    /// Written as a whole, last in this block; all reads came later inside the block of the write before them.
    Written(u32),
    /// Anything else.
    Kept,
}

struct Walk<'m> {
    module: &'m Module,
    facts: Facts,
    symbols: Vec<Usage>,
    /// Blocks around the current statement. Lanes never come back inside one block: those that leave
    /// come back after the statement around it.
    open: Vec<u32>,
    blocks: u32,
    error: Option<String>,
}

impl Walk<'_> {
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
            // A round may begin with what the last one left: only what it writes first is its own.
            let symbols = &mut self.symbols;
            written(stmt, &self.module.symbols, &mut |s| {
                if let Some(usage) = symbols.get_mut(s.0 as usize).filter(|u| **u != Usage::Kept) {
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
            Stmt::Trace { set, position, axis, angle, samples, options, body, at: _ } => {
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
        if op.args.len() < least_args(op.code) {
            self.fail(format!("{:?} has {} operands", op.code, op.args.len()));
        }
        if op.dst.is_none() && needs_result(op.code) {
            self.fail(format!("{:?} has no result", op.code));
        }
        for &arg in &op.args {
            self.read(arg);
        }
        if let OpCode::Call(func) = op.code {
            self.call(func, op);
        }
        if let Some(dst) = op.dst {
            let partial =
                matches!(op.code, OpCode::IndexSet | OpCode::ComponentSet | OpCode::MatrixComponentSet)
                    || op.code == OpCode::Assign && self.elements(dst) != self.elements(op.args[0]);
            let was = self.facts.clears;
            self.write(dst, partial);
            if op.code == OpCode::Assign && self.is_one(op.args[0]) {
                self.facts.clears = was;
            }
        }
    }

    /// Whether a symbol is the constant 1, or a triple of them.
    fn is_one(&self, sym: SymbolId) -> bool {
        match self.module.symbols.get(sym.0 as usize).map(|s| &s.kind) {
            Some(SymbolKind::Const(ConstValue::Floats(values))) => values.iter().all(|v| *v == 1.0),
            _ => false,
        }
    }

    fn elements(&self, sym: SymbolId) -> usize {
        self.module.symbols.get(sym.0 as usize).map_or(0, |s| s.ty.elements())
    }

    /// Globals that are read without being named.
    fn imply(&mut self, globals: &[Global]) {
        globals.iter().for_each(|&g| self.facts.implied[g as usize] = true);
    }

    /// What a function does beside returning a value.
    fn call(&mut self, func: Func, op: &Op) {
        // Plain functions of their operands read nothing else; of the others each may read any.
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
                self.facts.asks_parent |= parent;
                self.facts.asks_light |= light;
                self.facts.asks_primitive |= primitive;
                self.facts.listens.extend(usages);
            }
            _ => {}
        }
        if func == Func::Shadeop {
            let Some(call) = ShadeopCall::of(self.module, op.args.first()) else {
                return self.fail("a shadeop without a name".to_owned());
            };
            if call.outputs.len() + 1 != op.args.len() {
                return self.fail(format!("shadeop `{}` has {} operands", call.name, op.args.len() - 1));
            }
            op.args[1..]
                .iter()
                .zip(&call.outputs)
                .filter(|(_, o)| **o)
                .for_each(|(&s, _)| self.write(s, true));
            return;
        }
        // Functions that may store into their arguments, or leave them as they are.
        let from = match func {
            Func::Fresnel => 3,
            Func::Texture | Func::Texture3d | Func::Environment | Func::Shadow => 3,
            Func::Occlusion => 4,
            Func::SpatialDbQuery | Func::GetMessage | Func::GetTextureInfo => 2,
            Func::GetAttribute => 1,
            _ => return,
        };
        for &arg in op.args.iter().skip(from) {
            let constant = matches!(
                self.module.symbols.get(arg.0 as usize).map(|s| &s.kind),
                Some(SymbolKind::Const(_))
            );
            if !constant {
                self.write(arg, true);
            }
        }
    }

    /// The text of a constant string.
    /// Notes the options of a call that name a database or what is done with it.
    fn database(&mut self, op: &Op) {
        let is_text = |sym: &SymbolId| {
            self.module.symbols.get(sym.0 as usize).is_some_and(|s| s.ty.value == ValueType::String)
        };
        // Behind the geometry set no string is asked for: options begin with the first.
        let options = op.args.iter().skip(1).position(is_text).map_or(&[][..], |first| &op.args[first + 1..]);
        for pair in options.chunks_exact(2) {
            let named = self.constant(pair[0]).is_none_or(|name| matches!(name, "filename" | "filemode"));
            if !named || self.constant(pair[1]) == Some("") {
                continue;
            }
            let kind = self.module.symbols.get(pair[1].0 as usize).map(|s| &s.kind);
            self.facts.saves.push(match kind {
                Some(SymbolKind::Param(k)) => Saves::Param(*k),
                _ => Saves::Any,
            });
        }
    }

    fn constant(&self, sym: SymbolId) -> Option<&str> {
        match &self.module.symbols.get(sym.0 as usize)?.kind {
            SymbolKind::Const(ConstValue::Strings(v)) => v.first().map(|s| &**s),
            _ => None,
        }
    }

    fn read(&mut self, sym: SymbolId) {
        self.touch(sym, false);
        if let Some(usage) = self.symbols.get_mut(sym.0 as usize) {
            match *usage {
                Usage::Written(block) if self.open.contains(&block) => {}
                _ => *usage = Usage::Kept,
            }
        }
    }

    fn write(&mut self, sym: SymbolId, partial: bool) {
        self.touch(sym, true);
        let block = self.open.last().copied().unwrap_or(0);
        if let Some(usage) = self.symbols.get_mut(sym.0 as usize) {
            *usage = if *usage == Usage::Kept || partial { Usage::Kept } else { Usage::Written(block) };
        }
        if let Some(SymbolKind::Global(g)) = self.module.symbols.get(sym.0 as usize).map(|s| &s.kind) {
            self.facts.writes[*g as usize] = true;
            self.facts.clears |= *g == Global::opacity;
        }
    }

    /// Checks a symbol.
    fn touch(&mut self, sym: SymbolId, writing: bool) {
        match self.module.symbols.get(sym.0 as usize) {
            None => self.fail(format!("symbol {} of {}", sym.0, self.module.symbols.len())),
            Some(s) if writing && matches!(s.kind, SymbolKind::Const(_)) => {
                self.fail("a constant is written".to_owned());
            }
            Some(s) if s.ty.value == ValueType::Void => self.fail("a void value is used".to_owned()),
            _ => {}
        }
    }

    fn fail(&mut self, what: String) {
        self.error.get_or_insert(what);
    }
}

/// Globals that functions and statements of light may read.
const SURROUNDINGS: [Global; 9] = [
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

/// Whether a function knows its operands only.
fn is_plain(func: Func) -> bool {
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

/// The usage a source name of `getmessage` stands for.
pub(crate) fn usage_word(word: &str) -> Option<ShaderKind> {
    USAGES.into_iter().find(|k| k.word() == word)
}

/// Usages of shaders of an object.
const USAGES: [ShaderKind; 3] = [ShaderKind::Surface, ShaderKind::Displacement, ShaderKind::Volume];

/// How many operands an operation needs at least.
fn least_args(code: OpCode) -> usize {
    use Func as F;
    match code {
        OpCode::Assign | OpCode::Neg | OpCode::Not | OpCode::Truth | OpCode::Construct => 1,
        OpCode::MatrixComponent | OpCode::MatrixComponentSet | OpCode::Select => 3,
        OpCode::Call(func) => match func {
            F::Random | F::RandomGrid | F::GridN | F::GridNU | F::GridNV | F::GridIndex | F::Ambient => 0,
            F::RayLevel | F::IsShadowRay | F::IsIndirectRay => 0,
            F::Pow | F::Hypot | F::Mod | F::Min | F::Max | F::Dot | F::Cross | F::Distance => 2,
            F::FaceForward | F::Reflect | F::Transform | F::TransformV | F::TransformN | F::TransformU => 2,
            F::TransformC | F::Translate | F::Scale | F::Step | F::Fprintf | F::Match | F::Substr => 2,
            F::Environment | F::Shadow | F::Texture3d | F::AaStep | F::GetAttribute | F::SetMessage => 2,
            F::PNoise | F::PSNoise | F::PNNoise | F::Spline => 2,
            F::Clamp | F::Mix | F::Refract | F::Rotate | F::SmoothStep | F::Texture | F::Specular => 3,
            F::Indirect | F::Subsurface | F::GetMessage | F::GetTextureInfo => 3,
            F::SpatialDbSave | F::SpatialDbQuery => 3,
            F::SpecularBrdf | F::Occlusion => 4,
            F::Fresnel => 7,
            _ => 1,
        },
        _ => 2,
    }
}

/// Whether an operation is nothing without a result.
fn needs_result(code: OpCode) -> bool {
    !matches!(code, OpCode::Call(_))
}
