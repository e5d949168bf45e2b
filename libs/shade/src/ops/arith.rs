//! Assignment, operators, indexing and construction.

use super::{binary, component, compute, compute_as, matrix, part_lane, spaces, unary};
use crate::program::{At, Op};
use crate::run::kernel::{blend, blend_one, fold2, map1};
use crate::run::lanes::{Binary, Ternary, Unary};
use crate::run::machine::{Machine, promote};
use crate::run::simd;
use crate::run::store::Out;
use crate::run::strings::StringId;
use granita_gsl::ir::{OpCode, SymbolId, ValueType};

/// Runs all operations that are not functions.
pub(super) fn run(m: &mut Machine<'_>, code: OpCode, op: &Op) {
    let Some(dst) = op.dst else { return };
    let matrices = m.type_of(dst) == ValueType::Matrix;
    match code {
        OpCode::Assign => assign(m, dst, op.args[0]),
        OpCode::Neg => unary(m, op, Unary::Neg),
        OpCode::Add => binary(m, op, Binary::Add),
        OpCode::Sub => binary(m, op, Binary::Sub),
        OpCode::Mul if matrices => matrix::product(m, op, false),
        OpCode::Div if matrices => matrix::product(m, op, true),
        OpCode::Mul => binary(m, op, Binary::Mul),
        OpCode::Div => binary(m, op, Binary::Div),
        OpCode::Eq => equal(m, op, 1.0),
        OpCode::Ne => equal(m, op, 0.0),
        OpCode::Lt => binary(m, op, Binary::Lt),
        OpCode::Le => binary(m, op, Binary::Le),
        OpCode::Gt => binary(m, op, Binary::Gt),
        OpCode::Ge => binary(m, op, Binary::Ge),
        OpCode::Truth => truth(m, op, 1.0),
        OpCode::Not => truth(m, op, 0.0),
        OpCode::Index => index(m, op),
        OpCode::IndexSet => index_set(m, op, dst),
        OpCode::Component => component_get(m, op, 3),
        OpCode::MatrixComponent => component_get(m, op, 16),
        OpCode::ComponentSet => component_set(m, op, dst, 3),
        OpCode::MatrixComponentSet => component_set(m, op, dst, 16),
        OpCode::Construct => construct(m, op, dst),
        OpCode::Call(_) => {}
    }
}

/// Selects one of two values by a condition.
pub(super) fn select(m: &mut Machine<'_>, op: &Op) {
    let Some(dst) = op.dst else { return };
    let [cond, a, b] = [op.args[0], op.args[1], op.args[2]];
    let test = m.view(cond);
    if !test.varying {
        let chosen = if test.get(0) != 0.0 { a } else { b };
        if chosen != dst {
            assign(m, dst, chosen);
        }
        return;
    }
    let done =
        super::pass3(m, dst, cond, a, b, |out, c, x, y, _| simd::ternary(Ternary::Select, out, c, x, y));
    if !done {
        let ty = m.type_of(dst);
        compute(m, op, ty.components(), |m, out, _| {
            let (t, x, y) = (m.view(cond), m.view(a), m.view(b));
            for c in 0..ty.components() {
                simd::ternary(Ternary::Select, out.part(c), t.lane(0), x.lane(c), y.lane(c));
            }
        });
    }
}

/// Copies with conversion; arrays element by element up to the shorter length.
pub(crate) fn assign(m: &mut Machine<'_>, dst: SymbolId, from: SymbolId) {
    let ty = m.type_of(dst);
    let size = ty.components();
    let elements = m.place(dst).elements as usize;
    if super::pass1(m, dst, from, |out, a, _| simd::unary(Unary::Copy, out, a)) {
        return;
    }
    let varying = m.view(from).varying;
    let mut out = m.out(varying, size * elements);
    let v = m.view(from);
    if v.data.len() == out.data.len() && v.components == size {
        out.data.copy_from_slice(v.data);
    } else if elements == 1 {
        for c in 0..size {
            map1(out.part(c), component(&v, c, ty), |x| x);
        }
    } else {
        // The arrays have different lengths. Elements that the source lacks stay unchanged.
        let old = m.view(dst);
        let (old_varying, lanes) = (old.varying, m.n);
        if old_varying && !varying {
            m.discard(out);
            out = m.out(true, size * elements);
        }
        let wide = out.varying;
        let (v, old) = (m.view(from), m.view(dst));
        for e in 0..elements {
            for c in 0..size {
                let lane = if e < v.elements { v.lane_at(e, c) } else { old.lane_at(e, c) };
                let k = e * size + c;
                if wide {
                    (0..lanes).for_each(|i| out.set(k, i, lane.get(i)));
                } else {
                    out.set(k, 0, lane.get(0));
                }
            }
        }
    }
    m.commit(dst, out);
}

/// Computes `yes` where all components are equal, else its opposite.
fn equal(m: &mut Machine<'_>, op: &Op, yes: f32) {
    let strings = m.type_of(op.args[0]) == ValueType::String;
    compute(m, op, 1, |m, out, _| {
        let (a, b) = (m.view(op.args[0]), m.view(op.args[1]));
        let ty = if a.components.max(b.components) == 16 { ValueType::Matrix } else { ValueType::Color };
        let part = out.part(0);
        part.fill(1.0);
        if strings {
            fold2(part, a.lane(0), b.lane(0), |o, x, y| if x.to_bits() == y.to_bits() { o } else { 0.0 });
        } else {
            for c in 0..a.components.max(b.components) {
                fold2(
                    part,
                    component(&a, c, ty),
                    component(&b, c, ty),
                    |o, x, y| if x == y { o } else { 0.0 },
                );
            }
        }
        if yes == 0.0 {
            part.iter_mut().for_each(|x| *x = 1.0 - *x);
        }
    });
}

/// Computes `yes` where some component is not 0, else its opposite. NaN is true.
fn truth(m: &mut Machine<'_>, op: &Op, yes: f32) {
    let strings = m.type_of(op.args[0]) == ValueType::String;
    compute(m, op, 1, |m, out, _| {
        let a = m.view(op.args[0]);
        let part = out.part(0);
        part.fill(1.0 - yes);
        if strings {
            let empty = StringId::EMPTY.0;
            return crate::run::kernel::fold1(
                part,
                a.lane(0),
                |o, x| if x.to_bits() == empty { o } else { yes },
            );
        }
        for c in 0..a.components {
            crate::run::kernel::fold1(part, a.lane(c), |o, x| if x == 0.0 { o } else { yes });
        }
    });
}

/// Returns the element or component of an index, and true when it was inside of the range.
fn clamp_index(index: f32, count: usize) -> (usize, bool) {
    let k = index.floor();
    if k >= 0.0 && k < count as f32 {
        (k as usize, true)
    } else if k >= count as f32 {
        (count - 1, false)
    } else {
        (0, false)
    }
}

/// Reports the first index that is outside of the range, in active lanes.
fn check_index(m: &mut Machine<'_>, op: &Op, index: SymbolId, count: usize) {
    let bad = {
        let v = m.view(index);
        if v.varying {
            m.mask.active.iter().map(|&i| v.get(i as usize)).find(|&x| !clamp_index(x, count).1)
        } else {
            Some(v.get(0)).filter(|&x| !clamp_index(x, count).1)
        }
    };
    if let Some(bad) = bad {
        m.complain(op.at, &format!("index {bad} is outside of 0 to {}", count - 1));
    }
}

/// Reads an element of an array.
fn index(m: &mut Machine<'_>, op: &Op) {
    let [array, index] = [op.args[0], op.args[1]];
    let count = m.view(array).elements;
    check_index(m, op, index, count);
    let Some(ty) = super::result_type(m, op) else { return };
    compute(m, op, ty.components(), |m, out, work| {
        let (a, k) = (m.view(array), m.view(index));
        for c in 0..ty.components() {
            if k.varying {
                work.each(|i| out.set(c, i, a.lane_at(clamp_index(k.get(i), count).0, c).get(i)));
            } else {
                let e = clamp_index(k.get(0), count).0;
                map1(out.part(c), a.lane_at(e, c), |x| x);
            }
        }
    });
}

/// Reads a component of a triple or matrix.
fn component_get(m: &mut Machine<'_>, op: &Op, count: usize) {
    let side = if count == 16 { 4 } else { 3 };
    for &index in &op.args[1..] {
        check_index(m, op, index, side);
    }
    compute(m, op, 1, |m, out, work| {
        let a = m.view(op.args[0]);
        if op.args[1..].iter().any(|&s| m.view(s).varying) {
            work.each(|i| out.set(0, i, a.lane(flat_index(m, &op.args[1..], i)).get(i)));
        } else {
            map1(out.part(0), a.lane(flat_index(m, &op.args[1..], 0)), |x| x);
        }
    });
}

/// Returns the component's index from one index, or from row and column.
fn flat_index(m: &Machine<'_>, indexes: &[SymbolId], i: usize) -> usize {
    let at = |s: SymbolId, count| clamp_index(m.view(s).get(i), count).0;
    match indexes {
        [row, column, ..] => at(*row, 4) * 4 + at(*column, 4),
        [k] => at(*k, 3),
        [] => 0,
    }
}

/// Sets an element of an array.
fn index_set(m: &mut Machine<'_>, op: &Op, dst: SymbolId) {
    let [index, value] = [op.args[0], op.args[1]];
    let count = m.place(dst).elements as usize;
    check_index(m, op, index, count);
    let ty = m.type_of(dst);
    let size = ty.components();
    let varying = m.varies(&[index, value]);
    let mut out = m.out(varying, size);
    let v = m.view(value);
    for c in 0..size {
        map1(out.part(c), component(&v, c, ty), |x| x);
    }
    let k = m.view(index);
    let uniform = (!k.varying).then(|| clamp_index(k.get(0), count).0 * size);
    let index = index_list(m, uniform, |m, i| clamp_index(m.view(index).get(i), count).0 * size);
    store_part(m, dst, index, out);
}

/// Sets a component of a triple or matrix.
fn component_set(m: &mut Machine<'_>, op: &Op, dst: SymbolId, count: usize) {
    let side = if count == 16 { 4 } else { 3 };
    let (value, indexes) = op.args.split_last().expect("invariant: linking checked the operands");
    for &index in indexes {
        check_index(m, op, index, side);
    }
    let varying = m.varies(&op.args);
    let mut out = m.out(varying, 1);
    map1(out.part(0), m.view(*value).lane(0), |x| x);
    let uniform = (!m.varies(indexes)).then(|| flat_index(m, indexes, 0));
    let index = index_list(m, uniform, |m, i| flat_index(m, indexes, i));
    store_part(m, dst, index, out);
}

/// The start of a partial store: the same for all lanes, or per lane.
enum Start {
    Uniform(usize),
    Varying(Vec<f32>),
}

fn index_list(
    m: &mut Machine<'_>,
    uniform: Option<usize>,
    f: impl Fn(&Machine<'_>, usize) -> usize,
) -> Start {
    match uniform {
        Some(k) => Start::Uniform(k),
        None => {
            let mut list = m.st.pool.take(m.n);
            for &i in &m.mask.active {
                list[i as usize] = f(m, i as usize) as f32;
            }
            Start::Varying(list)
        }
    }
}

/// Stores some components of a register, in active lanes.
fn store_part(m: &mut Machine<'_>, dst: SymbolId, start: Start, out: Out) {
    let At::Slot(slot) = m.place(dst).at else { return m.discard(out) };
    let (n, whole) = (m.n, m.whole());
    let count = out.data.len() / out.width;
    let slot = &mut m.st.slots[slot as usize];
    match start {
        Start::Uniform(k) if !out.varying && !slot.varying && whole => {
            slot.data[k..k + count].copy_from_slice(&out.data);
        }
        Start::Uniform(k) => {
            promote(slot, n, &mut m.st.pool);
            for c in 0..count {
                let to = &mut slot.data[(k + c) * n..(k + c + 1) * n];
                if out.varying {
                    blend(to, &out.data[c * n..(c + 1) * n], &m.mask.on);
                } else {
                    blend_one(to, out.data[c], &m.mask.on);
                }
            }
        }
        Start::Varying(list) => {
            promote(slot, n, &mut m.st.pool);
            for &i in &m.mask.active {
                let i = i as usize;
                for c in 0..count {
                    let from = if out.varying { c * n + i } else { c };
                    slot.data[(list[i] as usize + c) * n + i] = out.data[from];
                }
            }
            m.st.pool.give(list);
        }
    }
    m.discard(out);
}

/// Makes a triple or matrix from its components, in a named space when a string comes first.
fn construct(m: &mut Machine<'_>, op: &Op, dst: SymbolId) {
    let ty = m.type_of(dst);
    let named = m.type_of(op.args[0]) == ValueType::String;
    let parts = &op.args[usize::from(named)..];
    if parts.is_empty() {
        return;
    }
    let size = ty.components();
    if named && ty != ValueType::Float {
        return super::for_each_text(m, op, &op.args[..1], &mut |m| spaces::construct(m, op, dst, parts));
    }
    let done = match *parts {
        [x] if size < 16 => super::pass1(m, dst, x, |out, x, _| simd::unary(Unary::Copy, out, x)),
        [x, y, z] if size == 3 => super::pass3(m, dst, x, y, z, |out, x, y, z, c| {
            simd::unary(
                Unary::Copy,
                out,
                if c == 0 {
                    x
                } else if c == 1 {
                    y
                } else {
                    z
                },
            );
        }),
        _ => false,
    };
    if done {
        return;
    }
    let varying = m.varies(parts);
    compute_as(m, dst, varying, size, |m, out, _| {
        for c in 0..size {
            let lane = part_lane(m, parts, c, ty);
            map1(out.part(c), lane, |x| x);
        }
    });
}
