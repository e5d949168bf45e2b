//! The operations and the functions of the standard library (reference 5.8).
//!
//! Operations without side effects compute into a new buffer and then store it under the mask
//! ([`Machine::commit`]), so an operand may be the result. Uniform operands give a uniform result, computed once.
//! Cheap operations compute all lanes, whatever the mask. Expensive ones compute the active lanes only. Values of
//! inactive lanes never reach an active one, because functions of neighbours read active ones only.

mod arith;
mod color;
mod database;
mod derive;
mod displace;
mod format;
mod geometry;
mod gridwise;
pub(crate) mod lookup;
mod math;
mod matrix;
mod message;
mod noise;
mod pattern;
pub(crate) mod shadeop;
mod shading;
mod spaces;
mod spline;
mod text;

pub use pattern::{NoiseForm, noise_at};

use crate::Group;
use crate::Lane;
use crate::program::{At, Op, Operation, Place};
use crate::run::lanes::{Binary, Ternary, Unary};
use crate::run::machine::Machine;
use crate::run::simd;
use crate::run::store::{Out, Slot, View, Work};
use granita_gsl::Func;
use granita_gsl::ir::{OpCode, SymbolId, ValueType};

/// Runs one operation in the active lanes.
pub(crate) fn run(m: &mut Machine<'_>, op: &Op) {
    match op.code {
        Operation::Stored(OpCode::Call(func)) => call(m, func, op),
        Operation::Stored(code) => arith::run(m, code, op),
        Operation::Select => arith::select(m, op),
        // Blocks run tapes themselves.
        Operation::Fused(_) => {}
    }
}

/// Runs a library function.
fn call(m: &mut Machine<'_>, func: Func, op: &Op) {
    use Func as F;
    match func {
        F::Dot | F::Cross | F::Length | F::Distance | F::Normalize | F::FaceForward | F::Reflect => {
            geometry::run(m, func, op);
        }
        F::Refract | F::Fresnel => geometry::run(m, func, op),
        F::Rotate if result_type(m, op) == Some(ValueType::Matrix) => matrix::run(m, func, op),
        F::Rotate => geometry::run(m, func, op),
        F::Transform | F::TransformV | F::TransformN => {
            for_each_text(m, op, &op.args, &mut |m| spaces::transform(m, func, op));
        }
        F::TransformU => for_each_text(m, op, &op.args, &mut |m| spaces::transformu(m, op)),
        F::Luminance | F::TransformC => for_each_text(m, op, &op.args, &mut |m| color::run(m, func, op)),
        F::Determinant | F::Transpose | F::Translate | F::Scale => matrix::run(m, func, op),
        F::Noise | F::SNoise | F::CNoise | F::PNoise | F::PNNoise | F::PSNoise => pattern::noise(m, func, op),
        F::Random | F::RandomGrid => pattern::random(m, func, op),
        F::Spline => for_each_text(m, op, &op.args, &mut |m| spline::run(m, op)),
        F::DeltaU | F::DeltaV | F::FilterWidth | F::SurfaceNormal | F::SampleArea => derive::run(m, func, op),
        F::AaStep => pattern::aastep(m, op),
        F::GridN | F::GridNU | F::GridNV | F::GridIndex | F::GridAny | F::GridMin | F::GridMax => {
            gridwise::run(m, func, op);
        }
        F::RayLevel | F::IsShadowRay | F::IsIndirectRay | F::ArrayLength => gridwise::run(m, func, op),
        F::Format | F::Printf | F::Error | F::Fprintf | F::Concat | F::Match | F::Substr => {
            text::run(m, func, op);
        }
        F::Texture | F::Texture3d | F::Environment | F::Shadow => lookup::run(m, func, op),
        F::Indirect | F::Occlusion => lookup::probe(m, func, op),
        F::Ambient | F::Diffuse | F::Specular | F::SpecularBrdf => shading::run(m, func, op),
        F::Displace | F::Bump => displace::run(m, func, op),
        F::GetMessage | F::GetAttribute | F::GetTextureInfo => {
            let names = op.args.len().saturating_sub(1);
            for_each_text(m, op, &op.args[..names], &mut |m| message::run(m, func, op));
        }
        F::SetMessage => message::run(m, func, op),
        F::Shadeop => shadeop::run(m, op),
        F::Subsurface | F::SpatialDbSave | F::SpatialDbQuery => database::run(m, op),
        _ => math::run(m, func, op),
    }
}

/// Calls `run` for each combination of the strings of `names` among the active lanes, with the mask narrowed to its
/// lanes. Nearly always they are the same for all lanes, and `run` is called once. The result of the operation is
/// merged, because a register that is written before it is read is stored as a whole.
fn for_each_text(m: &mut Machine<'_>, op: &Op, names: &[SymbolId], run: &mut dyn FnMut(&mut Machine<'_>)) {
    let differs = |s: &SymbolId| m.type_of(*s) == ValueType::String && m.view(*s).varying;
    let Some(k) = names.iter().position(differs) else { return run(m) };
    let Some(dst) = op.dst else { return };
    let components = m.type_of(dst).components();
    let mut merged = m.out(true, components);
    lookup::for_each_name(m, names[k], |m, _| {
        for_each_text(m, op, &names[k + 1..], run);
        let part = m.view(dst);
        for &i in &m.mask.active {
            (0..components).for_each(|c| merged.set(c, i as usize, part.lane(c).get(i as usize)));
        }
    });
    m.commit(dst, merged);
}

/// Returns the type of an operation's result.
fn result_type(m: &Machine<'_>, op: &Op) -> Option<ValueType> {
    op.dst.map(|dst| m.type_of(dst))
}

/// Stores a result of zeros.
fn zero(m: &mut Machine<'_>, op: &Op) {
    if let Some(dst) = op.dst {
        let mut out = m.out(false, m.type_of(dst).components());
        out.data.fill(0.0);
        m.commit(dst, out);
    }
}

/// Stores a uniform float result.
fn constant(m: &mut Machine<'_>, op: &Op, value: f32) {
    if let Some(dst) = op.dst {
        let mut out = m.out(false, m.type_of(dst).components());
        out.data.fill(value);
        m.commit(dst, out);
    }
}

/// Computes a result of `components` numbers into the operation's symbol. The result is varying when an operand is.
/// `f` receives the lanes to compute.
fn compute(
    m: &mut Machine<'_>,
    op: &Op,
    components: usize,
    f: impl FnOnce(&Machine<'_>, &mut Out, Work<'_>),
) {
    let Some(dst) = op.dst else { return };
    let varying = m.varies(&op.args);
    compute_as(m, dst, varying, components, f);
}

/// Does the same as [`compute`] for any symbol, with an explicit `varying`.
fn compute_as(
    m: &mut Machine<'_>,
    dst: SymbolId,
    varying: bool,
    components: usize,
    f: impl FnOnce(&Machine<'_>, &mut Out, Work<'_>),
) {
    let mut out = m.out(varying, components);
    f(m, &mut out, m.work(varying));
    widen(m, dst, &mut out, components);
    m.commit(dst, out);
}

/// Copies a float result to all components when the symbol is a triple.
fn widen(m: &Machine<'_>, dst: SymbolId, out: &mut Out, components: usize) {
    let want = m.type_of(dst).components();
    if components == want {
        return;
    }
    if components == 1 {
        for _ in 1..want {
            out.data.extend_from_within(..out.width);
        }
    } else {
        let len = out.data.len().min(want * out.width);
        out.data.truncate(len);
        out.data.resize(want * out.width, 0.0);
    }
}

/// Returns component `c` of an operand as a value of type `ty`. A float is the diagonal of a matrix.
fn component<'v>(view: &View<'v>, c: usize, ty: ValueType) -> Lane<'v> {
    const ZERO: &[f32] = &[0.0];
    if ty == ValueType::Matrix && view.components == 1 && !c.is_multiple_of(5) {
        return Lane { values: ZERO, stride: 0 };
    }
    view.lane(c)
}

/// Returns component `c` of a value that is written as one or all of its components.
fn part_lane<'v>(m: &'v Machine<'_>, parts: &[SymbolId], c: usize, ty: ValueType) -> Lane<'v> {
    if parts.len() == 1 {
        component(&m.view(parts[0]), c, ty)
    } else {
        m.view(parts[c.min(parts.len() - 1)]).lane(0)
    }
}

/// True when so few lanes are active that computing them one by one is faster.
fn sparse(m: &Machine<'_>, varying: bool) -> bool {
    varying && m.mask.count() * 4 < m.n
}

/// An operand of a plain operation, in its simplest form.
#[derive(Clone, Copy)]
struct Operand<'v> {
    data: &'v [f32],
    /// The step from one component to the next; 0 when one stands for all.
    step: usize,
    /// The number of lanes.
    width: usize,
    stride: usize,
}

impl<'v> Operand<'v> {
    #[inline(always)]
    fn of(place: &Place, group: &'v Group, slots: &'v [Slot], n: usize) -> Self {
        let (data, varying) = match place.at {
            At::Slot(k) => (slots[k as usize].data.as_slice(), slots[k as usize].varying),
            At::Const(k) => (&*group.constants[k as usize], false),
        };
        let width = if varying { n } else { 1 };
        let step = if place.value.components() == 1 { 0 } else { width };
        Self { data, step, width, stride: usize::from(varying) }
    }

    #[inline(always)]
    fn lane(&self, c: usize) -> Lane<'v> {
        let from = c * self.step;
        Lane { values: &self.data[from..from + self.width], stride: self.stride }
    }
}

/// Declares plain operations with these operands.
macro_rules! passes {
    ($($(#[$doc:meta])* $name:ident ($($arg:ident),*);)*) => {$(
        $(#[$doc])*
        #[inline(always)]
        #[allow(clippy::too_many_arguments, reason = "as many operands as operations have")]
        fn $name(
            m: &mut Machine<'_>,
            dst: SymbolId,
            $($arg: SymbolId,)*
            f: impl Fn(&mut [f32], $(passes!(@lane $arg),)* usize),
        ) -> bool {
            let code = m.code();
            let place = &code.places[dst.0 as usize];
            let At::Slot(slot) = place.at else { return false };
            let size = place.value.components();
            if place.array || size > 3 || !(place.scratch || m.whole()) {
                return false;
            }
            $(let $arg = &code.places[$arg.0 as usize];)*
            if $($arg.at == place.at || $arg.array || $arg.value == ValueType::Matrix ||)* false {
                return false;
            }
            let slots = &mut m.st.slots;
            let mut data = std::mem::take(&mut slots[slot as usize].data);
            let (slots, n) = (&m.st.slots, m.n);
            $(let $arg = Operand::of($arg, m.group, slots, n);)*
            let varying = $($arg.stride == 1 ||)* false;
            let width = if varying { n } else { 1 };
            if data.len() != size * width {
                data.clear();
                data.resize(size * width, 0.0);
            }
            for c in 0..size {
                f(&mut data[c * width..(c + 1) * width], $($arg.lane(c),)* c);
            }
            let slot = &mut m.st.slots[slot as usize];
            slot.data = data;
            slot.varying = varying;
            true
        }
    )*};
    (@lane $arg:ident) => { Lane<'_> };
}

passes! {
    /// Runs a plain operation, component by component, directly into the register of its result. This is possible
    /// when all lanes may be written, operands are single values and none of them is the result. `f` computes the
    /// component with the given index. Returns true when it was done.
    pass1 (a);
    /// Does the same as [`pass1`] for two operands.
    pass2 (a, b);
    /// Does the same as [`pass1`] for three operands.
    pass3 (a, b, c);
}

/// Computes component by component from one operand.
fn unary(m: &mut Machine<'_>, op: &Op, f: Unary) {
    let Some(dst) = op.dst else { return };
    if pass1(m, dst, op.args[0], |out, a, _| simd::unary(f, out, a)) {
        return;
    }
    let ty = m.type_of(dst);
    compute(m, op, ty.components(), |m, out, work| {
        let a = m.view(op.args[0]);
        for c in 0..ty.components() {
            let a = component(&a, c, ty);
            if sparse(m, out.varying) {
                work.each(|i| out.set(c, i, alone(|o| simd::unary(f, o, single(&[a.get(i)])))));
            } else {
                simd::unary(f, out.part(c), a);
            }
        }
    });
}

/// Computes component by component from two operands.
fn binary(m: &mut Machine<'_>, op: &Op, f: Binary) {
    let Some(dst) = op.dst else { return };
    if pass2(m, dst, op.args[0], op.args[1], |out, a, b, _| simd::binary(f, out, a, b)) {
        return;
    }
    let ty = m.type_of(dst);
    compute(m, op, ty.components(), |m, out, work| {
        let (a, b) = (m.view(op.args[0]), m.view(op.args[1]));
        for c in 0..ty.components() {
            let (a, b) = (component(&a, c, ty), component(&b, c, ty));
            if sparse(m, out.varying) {
                work.each(|i| {
                    let v = alone(|o| simd::binary(f, o, single(&[a.get(i)]), single(&[b.get(i)])));
                    out.set(c, i, v);
                });
            } else {
                simd::binary(f, out.part(c), a, b);
            }
        }
    });
}

/// Computes component by component from three operands. A float as the third stands for all components.
fn ternary(m: &mut Machine<'_>, op: &Op, f: Ternary) {
    let Some(dst) = op.dst else { return };
    if pass3(m, dst, op.args[0], op.args[1], op.args[2], |out, a, b, c, _| simd::ternary(f, out, a, b, c)) {
        return;
    }
    let ty = m.type_of(dst);
    compute(m, op, ty.components(), |m, out, _| {
        let (a, b, t) = (m.view(op.args[0]), m.view(op.args[1]), m.view(op.args[2]));
        for c in 0..ty.components() {
            simd::ternary(f, out.part(c), component(&a, c, ty), component(&b, c, ty), t.lane(c));
        }
    });
}

/// Returns a single number as a lane.
fn single(value: &[f32; 1]) -> Lane<'_> {
    Lane { values: value, stride: 0 }
}

/// Returns the only number of a result.
fn alone(f: impl FnOnce(&mut [f32])) -> f32 {
    let mut value = [0.0];
    f(&mut value);
    value[0]
}
