//! Folds constants through the code, and resolves constant conditions.

use super::effects::{Effect, effect, first_written, is_partial, written};
use super::{Constants, Known, blocks_mut, operands_mut};
use crate::program::{Block, Op, Operation, Program, Stmt};
use crate::{
    Databases, EnvironmentQuery, Executor, Grid, Group, Host, IlluminateQuery, Lanes3, LayerSource,
    LightInfo, LightResult, Lights, LinkOptions, LookupResult, Messages, Rays, Recall, ShadowQuery, Spaces,
    TextureQuery, Textures, Topology,
};
use granita_base::{Param, Params, Severity, Transform};
use granita_gsl::ValidModule;
use granita_gsl::ir::{
    self, ConstValue, DefaultValue, Module, OpCode, ParamDecl, ShaderKind, SourcePos, Symbol, SymbolId,
    SymbolKind, SymbolType, ValueType,
};
use std::sync::Arc;

/// Returns the body with constants folded, and the parameters that it relies on.
pub(super) fn fold(
    module: &Module,
    program: &Program,
    known: &[Known],
    pool: &mut Constants,
) -> (Block, Vec<usize>) {
    let mut folder =
        Folder { values: vec![None; module.symbols.len()], pool, evaluator: Evaluator::default() };
    let mut assumed = Vec::new();
    for (k, param) in module.params.iter().enumerate() {
        let ty = module.symbol(param.symbol).ty;
        match &known[k] {
            Known::Given(value) if ty.array.is_none() => {
                let id = folder.pool.add(ty, value.clone());
                folder.values[param.symbol.0 as usize] = Some(id);
            }
            Known::Default => {
                folder.block(program.inits[k].clone());
            }
            _ => {}
        }
        if matches!(known[k], Known::Unknown) {
            folder.values[param.symbol.0 as usize] = None;
        }
    }
    for (k, param) in module.params.iter().enumerate() {
        if folder.values[param.symbol.0 as usize].is_some() {
            assumed.push(k);
        }
    }
    (folder.block(program.body.clone()), assumed)
}

struct Folder<'p> {
    /// By symbol, the constant that it equals in all active lanes.
    values: Vec<Option<SymbolId>>,
    pool: &'p mut Constants,
    evaluator: Evaluator,
}

impl Folder<'_> {
    fn block(&mut self, block: Block) -> Block {
        let mut out = Vec::with_capacity(block.len());
        for stmt in block {
            self.stmt(stmt, &mut out);
        }
        out
    }

    fn stmt(&mut self, mut stmt: Stmt, out: &mut Block) {
        operands_mut(&mut stmt, |s| *s = self.resolved(*s));
        match stmt {
            Stmt::Op(op) => self.op(op, out),
            Stmt::If { cond, then, otherwise } => {
                if let Some(ConstValue::Floats(v)) = self.pool.value(cond) {
                    let taken = if v[0] != 0.0 { then } else { otherwise };
                    out.extend(self.block(taken));
                    return;
                }
                let before = self.values.clone();
                let then = self.block(then);
                let after = std::mem::replace(&mut self.values, before);
                let otherwise = self.block(otherwise);
                for (value, other) in self.values.iter_mut().zip(after) {
                    if *value != other {
                        *value = None;
                    }
                }
                out.push(Stmt::If { cond, then, otherwise });
            }
            mut other => {
                // Values that change inside are unknown at the start of a round and afterwards.
                self.forget(&other);
                let before = self.values.clone();
                for block in blocks_mut(&mut other) {
                    *block = self.block(std::mem::take(block));
                    self.values.clone_from(&before);
                }
                out.push(other);
            }
        }
    }

    fn op(&mut self, mut op: Op, out: &mut Block) {
        let outputs = first_written(&op);
        for arg in op.args.iter_mut().take(outputs) {
            *arg = self.resolved(*arg);
        }
        let result = op.dst.and_then(|dst| self.evaluate(&op, dst));
        self.forget(&Stmt::Op(op.clone()));
        if let (Some(dst), Some(value)) = (op.dst, result) {
            self.values[dst.0 as usize] = Some(value);
            op = Op::assign(dst, value, op.at);
        }
        out.push(Stmt::Op(op));
    }

    /// Returns the constant result of an operation, if it has one.
    fn evaluate(&mut self, op: &Op, dst: SymbolId) -> Option<SymbolId> {
        let symbol = &self.pool.symbols[dst.0 as usize];
        let ty = symbol.ty;
        let own = matches!(symbol.kind, SymbolKind::Local | SymbolKind::Temp | SymbolKind::Param(_));
        if !own || ty.array.is_some() || ty.value == ValueType::Void {
            return None;
        }
        let constants: Option<Vec<&Symbol>> = op
            .args
            .iter()
            .map(|s| {
                Some(&self.pool.symbols[s.0 as usize]).filter(|s| matches!(s.kind, SymbolKind::Const(_)))
            })
            .collect();
        let constants = constants?;
        if op.is(OpCode::Assign) && constants[0].ty == ty {
            return Some(op.args[0]);
        }
        if effect(op, &self.pool.symbols) != Effect::Pure
            || ty.value == ValueType::String
            || is_partial(op, &self.pool.symbols)
        {
            return None;
        }
        let value = self.evaluator.value(op, ty, &constants)?;
        Some(self.pool.add(ty, ConstValue::Floats(value.into())))
    }

    /// Returns the constant that a symbol equals, else the symbol.
    fn resolved(&self, symbol: SymbolId) -> SymbolId {
        self.values.get(symbol.0 as usize).copied().flatten().unwrap_or(symbol)
    }

    /// Forgets the values of symbols that a statement may write.
    fn forget(&mut self, stmt: &Stmt) {
        let values = &mut self.values;
        written(stmt, &self.pool.symbols, &mut |s| {
            if let Some(value) = values.get_mut(s.0 as usize) {
                *value = None;
            }
        });
    }
}

/// Computes constants by running the operation, so that the results equal those of the executor to the bit.
#[derive(Debug, Default)]
struct Evaluator {
    executor: Executor,
}

impl Evaluator {
    /// Returns the result; `None` when it needs services or reports a message.
    fn value(&mut self, op: &Op, ty: SymbolType, constants: &[&Symbol]) -> Option<Vec<f32>> {
        let mut symbols: Vec<Symbol> = constants.iter().map(|s| (*s).clone()).collect();
        let result = SymbolId(symbols.len() as u32);
        symbols.push(Symbol { name: "r".into(), ty, kind: SymbolKind::Param(0) });
        let args = (0..result.0).map(SymbolId).collect();
        let Operation::Stored(code) = op.code else { return None };
        let op = ir::Op { code, dst: Some(result), args, at: SourcePos::default() };
        let module = Module {
            kind: ShaderKind::Surface,
            name: "".into(),
            metadata: vec![],
            params: vec![ParamDecl {
                symbol: result,
                output: true,
                default: DefaultValue::Unknown,
                init: vec![],
                metadata: vec![],
            }],
            symbols,
            body: vec![ir::Stmt::Op(op)],
            files: vec![],
            reads: vec![],
            writes: vec![],
            needs_derivatives: false,
        };
        let params = Params::new();
        let layer = LayerSource { module: ValidModule::check(module, "").ok()?, params: &params, name: None };
        let group = Group::link_with(&[layer], &[], LinkOptions { optimize: false }, &mut |_, _| {}).ok()?;
        let mut nothing = Nothing { said: false };
        let mut grid = Grid::new(Topology::Scattered { n: 1 });
        let result = self.executor.run(&group, &mut grid, &mut nothing, &[("r", ty.value)]).pop()??;
        (!nothing.said).then_some(result)
    }
}

/// Services without any data. An operation that uses them is not constant.
struct Nothing {
    said: bool,
}

impl Spaces for Nothing {
    fn to_common(&mut self, _: &str, _: usize) -> Option<Transform> {
        self.said = true;
        None
    }

    fn unit_scale(&mut self, _: &str, _: &str) -> Option<f32> {
        self.said = true;
        None
    }
}

impl Textures for Nothing {
    fn texture(&mut self, _: &TextureQuery<'_>, _: &mut LookupResult) {
        self.said = true;
    }

    fn environment(&mut self, _: &EnvironmentQuery<'_>, _: &mut LookupResult) {
        self.said = true;
    }

    fn shadow(&mut self, _: &ShadowQuery<'_>, _: &mut Lanes3) {
        self.said = true;
    }

    fn texture_info(&mut self, _: &str, _: &str) -> Option<Param> {
        self.said = true;
        None
    }
}

impl Lights for Nothing {
    fn light_count(&mut self) -> usize {
        0
    }

    fn light_info(&mut self, _: usize) -> LightInfo {
        LightInfo::default()
    }

    fn illuminate(&mut self, _: usize, _: &IlluminateQuery<'_>) -> Arc<LightResult> {
        self.said = true;
        Arc::default()
    }
}

impl Rays for Nothing {}

impl Databases for Nothing {}

impl Messages for Nothing {
    fn say(&mut self, _: Severity, _: &str) {
        self.said = true;
    }
}

impl Recall for Nothing {}

impl Host for Nothing {
    fn attribute(&mut self, _: &str) -> Option<Param> {
        self.said = true;
        None
    }
}
