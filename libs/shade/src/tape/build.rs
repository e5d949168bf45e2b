//! Builds tapes from operations.

use super::{Code, Input, Output, Ref, Step, Symbols, Tape};
use crate::Lane;
use crate::link::{blocks_mut, occurrences};
use crate::program::{At, Block, Op, Operation, Place, Stmt};
use crate::run::lanes::{Binary as B, LUMINANCE, Ternary as T, Unary as U};
use crate::run::simd;
use granita_gsl::Func;
use granita_gsl::ir::{OpCode, Symbol, SymbolId, SymbolKind, ValueType};
use std::collections::HashMap;
use std::sync::Arc;

/// The smallest number of steps of a tape. Fewer are faster one by one.
const LEAST_STEPS: usize = 3;
/// The largest number of registers that a tape reads, which is the number of bits of the word that marks the
/// varying ones.
const MAX_INPUTS: usize = 64;
/// The largest number of steps. The values of a strip should stay in the nearest cache.
const MAX_STEPS: usize = 128;

/// The properties of a layer's symbols.
pub(crate) struct Surroundings<'a> {
    /// By symbol.
    pub(crate) symbols: &'a [Symbol],
    /// By symbol.
    pub(crate) places: &'a [Place],
    /// Constants of the group.
    pub(crate) constants: &'a [Arc<[f32]>],
}

/// Puts an [`Operation::Fused`] in front of every run of plain operations in `body`, and returns the tapes.
/// `elsewhere` is code besides `body` that uses the same symbols.
pub(crate) fn fuse(
    body: &mut Block,
    elsewhere: &[Block],
    symbols: &[Symbol],
    places: &[Place],
    constants: &[Arc<[f32]>],
) -> Vec<Tape> {
    let mut uses = vec![0_u32; symbols.len()];
    for block in elsewhere.iter().chain([&*body]) {
        occurrences(block, symbols, &mut |s| uses[s.0 as usize] += 1);
    }
    let around = Surroundings { symbols, places, constants };
    let mut tapes = Vec::new();
    fuse_in(body, &around, &uses, &mut tapes);
    tapes
}

fn fuse_in(block: &mut Block, around: &Surroundings<'_>, uses: &[u32], tapes: &mut Vec<Tape>) {
    let mut out = Block::with_capacity(block.len());
    let mut run: Vec<Op> = Vec::new();
    for mut stmt in std::mem::take(block) {
        if let Stmt::Op(op) = &stmt
            && is_plain(op, around)
        {
            run.push(op.clone());
            continue;
        }
        close(&mut run, &mut out, around, uses, tapes);
        blocks_mut(&mut stmt).into_iter().for_each(|b| fuse_in(b, around, uses, tapes));
        out.push(stmt);
    }
    close(&mut run, &mut out, around, uses, tapes);
    *block = out;
}

/// Ends a run.
fn close(run: &mut Vec<Op>, out: &mut Block, around: &Surroundings<'_>, uses: &[u32], tapes: &mut Vec<Tape>) {
    let mut ops = run.as_slice();
    while !ops.is_empty() {
        let (tape, taken) = build(ops, around, uses);
        if let Some(tape) = tape {
            let at = ops[0].at;
            out.push(Stmt::Op(Op {
                code: Operation::Fused(tapes.len() as u32),
                dst: None,
                args: vec![],
                at,
                call: None,
            }));
            tapes.push(tape);
        }
        out.extend(ops[..taken].iter().cloned().map(Stmt::Op));
        ops = &ops[taken..];
    }
    run.clear();
}

/// Returns a tape of the first operations, as many as fit, and their number. Returns no tape where it would not be
/// faster.
pub(super) fn build(ops: &[Op], around: &Surroundings<'_>, uses: &[u32]) -> (Option<Tape>, usize) {
    let mut builder = Builder { around, steps: Vec::new(), inputs: Vec::new(), known: HashMap::new() };
    let mut now = Symbols::new();
    // By symbol, the number of uses so far, and true when the first was a write of the whole.
    let mut seen: HashMap<SymbolId, (u32, bool)> = HashMap::new();
    let mut written: Vec<SymbolId> = Vec::new();
    let mut taken = 0;
    for op in ops {
        // An operation may need about a dozen steps.
        if builder.steps.len() > MAX_STEPS || builder.inputs.len() + 12 > MAX_INPUTS {
            break;
        }
        let Some(dst) = op.dst else { break };
        for &arg in &op.args {
            seen.entry(arg).or_insert((0, false)).0 += 1;
        }
        let partial = op.is(OpCode::ComponentSet);
        let parts = builder.operation(op, &now);
        now.insert(dst, parts);
        seen.entry(dst).or_insert((0, !partial)).0 += 1;
        if !written.contains(&dst) {
            written.push(dst);
        }
        taken += 1;
    }
    let mut outputs = Vec::new();
    for dst in written {
        let k = dst.0 as usize;
        let own = matches!(around.symbols[k].kind, SymbolKind::Local | SymbolKind::Temp);
        let (count, whole) = seen[&dst];
        if own && whole && uses[k] == count {
            continue;
        }
        let place = &around.places[k];
        let At::Slot(slot) = place.at else { continue };
        outputs.push(Output { slot, scratch: place.scratch, parts: now[&dst].clone() });
    }
    let tape = builder.finish(outputs, taken);
    ((tape.steps.len() >= LEAST_STEPS).then_some(tape), taken)
}

/// True when a symbol is a single value and not an array.
fn is_single(s: SymbolId, around: &Surroundings<'_>) -> bool {
    let place = &around.places[s.0 as usize];
    !place.array && matches!(place.value.components(), 1 | 3) && place.value != ValueType::String
}

/// Returns the constant number of a symbol.
fn number(s: SymbolId, around: &Surroundings<'_>) -> Option<f32> {
    match around.places[s.0 as usize].at {
        At::Const(k) => around.constants[k as usize].first().copied(),
        At::Slot(_) => None,
    }
}

/// Returns the constant component of a triple for an index, if it is one.
fn constant_component(s: SymbolId, around: &Surroundings<'_>) -> Option<usize> {
    number(s, around).map(f32::floor).filter(|k| (0.0..3.0).contains(k)).map(|k| k as usize)
}

/// True when an operation can be part of a tape.
fn is_plain(op: &Op, around: &Surroundings<'_>) -> bool {
    let Some(dst) = op.dst else { return false };
    if !is_single(dst, around) || !op.args.iter().all(|&s| is_single(s, around)) {
        return false;
    }
    let code = match op.code {
        Operation::Stored(code) => code,
        Operation::Select => return true,
        Operation::Fused(_) => return false,
    };
    match code {
        OpCode::Assign | OpCode::Neg | OpCode::Add | OpCode::Sub | OpCode::Mul | OpCode::Div => true,
        OpCode::Eq | OpCode::Ne | OpCode::Lt | OpCode::Le | OpCode::Gt | OpCode::Ge => true,
        OpCode::Not | OpCode::Truth | OpCode::Construct => true,
        OpCode::Component => constant_component(op.args[1], around).is_some(),
        OpCode::ComponentSet => constant_component(op.args[0], around).is_some(),
        OpCode::Call(func) => match func {
            Func::Dot | Func::Cross | Func::Length | Func::Normalize | Func::Reflect | Func::Luminance => {
                true
            }
            Func::Distance => op.args.len() == 2,
            Func::FaceForward => op.args.len() == 3,
            func => simple(func, op.args.len()).is_some(),
        },
        _ => false,
    }
}

/// Returns the code of functions that work component by component.
fn simple(func: Func, args: usize) -> Option<Code> {
    use Func as F;
    Some(match (func, args) {
        (F::Radians, 1) => Code::One(U::Radians),
        (F::Degrees, 1) => Code::One(U::Degrees),
        (F::Sin, 1) => Code::One(U::Sin),
        (F::Cos, 1) => Code::One(U::Cos),
        (F::Tan, 1) => Code::One(U::Tan),
        (F::Asin, 1) => Code::One(U::Asin),
        (F::Acos, 1) => Code::One(U::Acos),
        (F::Atan, 1) => Code::One(U::Atan),
        (F::Exp, 1) => Code::One(U::Exp),
        (F::Log, 1) => Code::One(U::Log),
        (F::Log2, 1) => Code::One(U::Log2),
        (F::Log10, 1) => Code::One(U::Log10),
        (F::Sqrt, 1) => Code::One(U::Sqrt),
        (F::InverseSqrt, 1) => Code::One(U::InverseSqrt),
        (F::Abs | F::Fabs, 1) => Code::One(U::Abs),
        (F::Sign, 1) => Code::One(U::Sign),
        (F::Floor, 1) => Code::One(U::Floor),
        (F::Ceil, 1) => Code::One(U::Ceil),
        (F::Round, 1) => Code::One(U::Round),
        (F::Trunc, 1) => Code::One(U::Trunc),
        (F::IsNan, 1) => Code::One(U::IsNan),
        (F::IsInf, 1) => Code::One(U::IsInf),
        (F::Finite, 1) => Code::One(U::Finite),
        (F::Atan, 2) => Code::Two(B::Atan2),
        (F::Pow, 2) => Code::Two(B::Pow),
        (F::Mod, 2) => Code::Two(B::Mod),
        (F::Min, 2) => Code::Two(B::Min),
        (F::Max, 2) => Code::Two(B::Max),
        (F::Step, 2) => Code::Two(B::Step),
        (F::Clamp, 3) => Code::Three(T::Clamp),
        (F::Mix, 3) => Code::Three(T::Mix),
        (F::SmoothStep, 3) => Code::Three(T::SmoothStep),
        _ => return None,
    })
}

struct Builder<'a> {
    around: &'a Surroundings<'a>,
    steps: Vec<Step>,
    inputs: Vec<Input>,
    /// The steps by their computation.
    known: HashMap<Step, u32>,
}

const ZERO: Ref = Ref::Const(0);

impl Builder<'_> {
    fn constant(value: f32) -> Ref {
        Ref::Const(value.to_bits())
    }

    /// Adds a step, or returns an equal one.
    fn step(&mut self, code: Code, args: &[Ref]) -> Ref {
        let mut all = [ZERO; 3];
        all[..args.len()].copy_from_slice(args);
        if code == Code::One(U::Copy) {
            return all[0];
        }
        // A step of constants is computed here.
        let numbers = all.map(|r| if let Ref::Const(bits) = r { Some([f32::from_bits(bits)]) } else { None });
        if let [Some(a), Some(b), Some(c)] = numbers {
            return Self::constant(alone(code, [&a, &b, &c]));
        }
        let step = Step { code, args: all };
        let next = self.steps.len() as u32;
        let k = *self.known.entry(step).or_insert(next);
        if k == next {
            self.steps.push(step);
        }
        Ref::Value(k)
    }

    fn one(&mut self, f: U, a: Ref) -> Ref {
        self.step(Code::One(f), &[a])
    }

    fn two(&mut self, f: B, a: Ref, b: Ref) -> Ref {
        self.step(Code::Two(f), &[a, b])
    }

    /// Returns the current components of a symbol.
    fn parts(&mut self, s: SymbolId, now: &Symbols) -> Vec<Ref> {
        if let Some(parts) = now.get(&s) {
            return parts.clone();
        }
        let place = &self.around.places[s.0 as usize];
        let constants = self.around.constants;
        (0..place.value.components())
            .map(|c| match source(place.at, c, constants) {
                Err(number) => Self::constant(number),
                Ok(input) => {
                    let known = self.inputs.iter().position(|i| *i == input);
                    Ref::Input(known.unwrap_or_else(|| {
                        self.inputs.push(input);
                        self.inputs.len() - 1
                    }) as u32)
                }
            })
            .collect()
    }

    /// Returns the components of the operation's result.
    fn operation(&mut self, op: &Op, now: &Symbols) -> Vec<Ref> {
        let dst = op.dst.expect("invariant: plain operations have a result");
        let size = self.around.places[dst.0 as usize].value.components();
        let args: Vec<Vec<Ref>> = op.args.iter().map(|&s| self.parts(s, now)).collect();
        // A float stands for all components.
        let part =
            |k: usize, c: usize| args[k][if args[k].len() == 1 { 0 } else { c.min(args[k].len() - 1) }];
        let triple = |k: usize| [0, 1, 2].map(|c| part(k, c));
        use Operation::Stored as S;
        let mut parts: Vec<Ref> = match op.code {
            S(OpCode::Assign) => (0..size).map(|c| part(0, c)).collect(),
            S(OpCode::Neg) => (0..size).map(|c| self.one(U::Neg, part(0, c))).collect(),
            S(OpCode::Add) => (0..size).map(|c| self.two(B::Add, part(0, c), part(1, c))).collect(),
            S(OpCode::Sub) => (0..size).map(|c| self.two(B::Sub, part(0, c), part(1, c))).collect(),
            S(OpCode::Mul) => (0..size).map(|c| self.two(B::Mul, part(0, c), part(1, c))).collect(),
            S(OpCode::Div) => (0..size).map(|c| self.two(B::Div, part(0, c), part(1, c))).collect(),
            S(OpCode::Lt) => (0..size).map(|c| self.two(B::Lt, part(0, c), part(1, c))).collect(),
            S(OpCode::Le) => (0..size).map(|c| self.two(B::Le, part(0, c), part(1, c))).collect(),
            S(OpCode::Gt) => (0..size).map(|c| self.two(B::Gt, part(0, c), part(1, c))).collect(),
            S(OpCode::Ge) => (0..size).map(|c| self.two(B::Ge, part(0, c), part(1, c))).collect(),
            S(OpCode::Eq | OpCode::Ne) => {
                let count = args[0].len().max(args[1].len());
                let each: Vec<Ref> = (0..count).map(|c| self.two(B::Eq, part(0, c), part(1, c))).collect();
                let all = self.fold(B::Min, &each);
                vec![if op.is(OpCode::Eq) { all } else { self.two(B::Sub, Self::constant(1.0), all) }]
            }
            S(OpCode::Not | OpCode::Truth) => {
                let each: Vec<Ref> = args[0].iter().map(|&a| self.two(B::Eq, a, ZERO)).collect();
                let none = self.fold(B::Min, &each);
                vec![if op.is(OpCode::Not) { none } else { self.two(B::Sub, Self::constant(1.0), none) }]
            }
            Operation::Select => (0..size)
                .map(|c| self.step(Code::Three(T::Select), &[part(0, 0), part(1, c), part(2, c)]))
                .collect(),
            S(OpCode::Construct) if args.len() == 1 => (0..size).map(|c| part(0, c)).collect(),
            S(OpCode::Construct) => (0..size).map(|c| part(c.min(args.len() - 1), 0)).collect(),
            S(OpCode::Component) => {
                let k = constant_component(op.args[1], self.around).expect("invariant: plain");
                vec![part(0, k)]
            }
            S(OpCode::ComponentSet) => {
                let k = constant_component(op.args[0], self.around).expect("invariant: plain");
                let mut parts = self.parts(dst, now);
                let k = k.min(parts.len() - 1);
                parts[k] = part(1, 0);
                parts
            }
            S(OpCode::Call(func)) => self.function(func, op.args.len(), size, &part, &triple),
            _ => vec![],
        };
        // A float result fills a triple. A float takes the first component of a triple.
        match parts.len() {
            1 => parts.resize(size, parts[0]),
            _ => parts.resize(size, ZERO),
        }
        parts
    }

    fn function(
        &mut self,
        func: Func,
        count: usize,
        size: usize,
        part: &dyn Fn(usize, usize) -> Ref,
        triple: &dyn Fn(usize) -> [Ref; 3],
    ) -> Vec<Ref> {
        match func {
            Func::Dot => vec![self.dot(triple(0), triple(1))],
            Func::Length => {
                let square = self.dot(triple(0), triple(0));
                vec![self.one(U::Sqrt, square)]
            }
            Func::Distance => {
                let (a, b) = (triple(0), triple(1));
                let way = [0, 1, 2].map(|c| self.two(B::Sub, a[c], b[c]));
                let square = self.dot(way, way);
                vec![self.one(U::Sqrt, square)]
            }
            Func::Normalize => {
                let a = triple(0);
                let square = self.dot(a, a);
                let length = self.one(U::Sqrt, square);
                let scale = self.one(U::Reciprocal, length);
                a.map(|x| self.two(B::Mul, x, scale)).to_vec()
            }
            Func::Cross => {
                let (a, b) = (triple(0), triple(1));
                let of = |c: usize| ((c + 1) % 3, (c + 2) % 3);
                (0..3)
                    .map(|c| {
                        let (j, k) = of(c);
                        let (plus, minus) = (self.two(B::Mul, a[j], b[k]), self.two(B::Mul, a[k], b[j]));
                        self.two(B::Sub, plus, minus)
                    })
                    .collect()
            }
            Func::Reflect => {
                // I - 2 (N.I) N
                let (i, n) = (triple(0), triple(1));
                let cos = self.dot(n, i);
                let twice = self.two(B::Mul, Self::constant(2.0), cos);
                (0..3)
                    .map(|c| {
                        let way = self.two(B::Mul, twice, n[c]);
                        self.two(B::Sub, i[c], way)
                    })
                    .collect()
            }
            Func::FaceForward => {
                let (n, cos) = (triple(0), self.dot(triple(1), triple(2)));
                let away = self.two(B::Gt, cos, ZERO);
                n.map(|x| {
                    let back = self.one(U::Neg, x);
                    self.step(Code::Three(T::Select), &[away, back, x])
                })
                .to_vec()
            }
            Func::Luminance => {
                let weights = LUMINANCE.map(Self::constant);
                vec![self.dot(weights, triple(0))]
            }
            func => {
                let code = simple(func, count).expect("invariant: plain");
                (0..size)
                    .map(|c| {
                        let args: Vec<Ref> = (0..code.arity()).map(|k| part(k, c)).collect();
                        self.step(code, &args)
                    })
                    .collect()
            }
        }
    }

    /// Adds in the order of the loops: x, y, z.
    fn dot(&mut self, a: [Ref; 3], b: [Ref; 3]) -> Ref {
        let [x, y, z] = [0, 1, 2].map(|c| self.two(B::Mul, a[c], b[c]));
        let sum = self.two(B::Add, x, y);
        self.two(B::Add, sum, z)
    }

    fn fold(&mut self, f: B, list: &[Ref]) -> Ref {
        list[1..].iter().fold(list[0], |all, &x| self.two(f, all, x))
    }

    /// Keeps the steps that the outputs need, with new indices.
    fn finish(self, mut outputs: Vec<Output>, len: usize) -> Tape {
        let mut needed = vec![false; self.steps.len()];
        let mut read = vec![false; self.inputs.len()];
        let mut mark = |r: &Ref, needed: &mut [bool]| match *r {
            Ref::Value(k) => needed[k as usize] = true,
            Ref::Input(k) => read[k as usize] = true,
            Ref::Const(_) => {}
        };
        outputs.iter().flat_map(|o| &o.parts).for_each(|r| mark(r, &mut needed));
        for k in (0..self.steps.len()).rev() {
            if needed[k] {
                self.steps[k].args.iter().for_each(|r| mark(r, &mut needed));
            }
        }
        let renumber = |keep: &[bool]| -> Vec<u32> {
            let mut next = 0;
            let number = |&k: &bool| {
                next += u32::from(k);
                next.wrapping_sub(1)
            };
            keep.iter().map(number).collect()
        };
        let (values, inputs) = (renumber(&needed), renumber(&read));
        let new = |r: Ref| match r {
            Ref::Value(k) => Ref::Value(values[k as usize]),
            Ref::Input(k) => Ref::Input(inputs[k as usize]),
            number => number,
        };
        let kept = |keep: &[bool], k: usize| keep[k];
        let steps = self.steps.iter().enumerate().filter(|(k, _)| kept(&needed, *k));
        let steps = steps.map(|(_, s)| Step { code: s.code, args: s.args.map(new) }).collect();
        let own = self.inputs.iter().enumerate().filter(|(k, _)| kept(&read, *k)).map(|(_, i)| *i).collect();
        outputs.iter_mut().flat_map(|o| &mut o.parts).for_each(|r| *r = new(*r));
        Tape { len, inputs: own, steps, outputs, plans: super::Plans::default() }
    }
}

/// Computes one step for single numbers.
pub(super) fn alone(code: Code, args: [&[f32; 1]; 3]) -> f32 {
    let mut out = [0.0];
    let [a, b, c] = args.map(|values| Lane { values, stride: 0 });
    match code {
        Code::One(f) => simd::unary(f, &mut out, a),
        Code::Two(f) => simd::binary(f, &mut out, a, b),
        Code::Three(f) => simd::ternary(f, &mut out, a, b, c),
    }
    out[0]
}

/// Returns the register and component of a value, or its constant value.
fn source(at: At, component: usize, constants: &[Arc<[f32]>]) -> Result<Input, f32> {
    match at {
        At::Slot(slot) => Ok(Input { slot, component: component as u32 }),
        At::Const(k) => Err(constants[k as usize][component]),
    }
}
