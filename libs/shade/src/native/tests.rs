//! Tests of printed plans, and of when they are compiled.

use super::*;
use crate::run::lanes::{Binary, Ternary, Unary};
use crate::tape::{Code, Part, Plan, StripStep};
use parking_lot::Mutex;

/// A compiler that keeps what it gets.
#[derive(Debug, Default)]
struct Keeping(Mutex<Vec<NativeSource>>);

#[derive(Debug)]
struct Nothing;

impl NativeCode for Nothing {
    fn run(&self, _: &mut NativeStrip<'_, '_>) -> bool {
        false
    }
}

impl NativeCompiler for Keeping {
    fn compile(&self, source: NativeSource, done: NativeDone) {
        self.0.lock().push(source);
        done(Arc::new(Nothing));
    }
}

fn source() -> NativeSource {
    NativeSource { text: String::new(), inputs: 0, scalars: 0, outputs: 0 }
}

#[test]
fn code_is_requested_once_after_many_points() {
    let (native, compiler) = (Arc::new(Native::default()), Keeping::default());
    for _ in 0..HOT_POINTS / 1024 - 1 {
        native.count(1024, &compiler, || Some(source()));
    }
    assert!(native.code().is_none() && compiler.0.lock().is_empty());
    for _ in 0..10 {
        native.count(1024, &compiler, || Some(source()));
    }
    assert!(native.code().is_some());
    assert_eq!(compiler.0.lock().len(), 1);
}

/// Returns a plan that computes one step of a varying register, a scalar and a varying register.
fn plan(code: Code) -> Plan {
    let input = |slot| crate::tape::Input { slot, component: 0 };
    Plan {
        constants: vec![2.0],
        loads: vec![input(0), input(1)],
        splats: vec![0],
        steps: vec![StripStep { code, out: 3, args: [0, 2, 1] }],
        results: vec![crate::tape::PlanResult { varying: true, parts: vec![Part::Row(3), Part::Scalar(0)] }],
        ..Plan::default()
    }
}

#[test]
fn a_plan_is_a_loop_over_its_steps() {
    let source = print(&plan(Code::Three(Ternary::MulAdd))).unwrap();
    assert_eq!((source.inputs, source.scalars, source.outputs), (2, 1, 1));
    let (_, own) = source.text.split_once("((noinline)) ").unwrap();
    let expected = "int lanes (const float *restrict in0, const float *restrict in1, float *restrict out0, \
const float *scalars, long from, long to)
{
  const float s0 = scalars[0];
  int bad = 0;
  for (long i = from; i < to; ++i) {
    const float a0 = in0[i];
    const float a1 = in1[i];
    const float v3 = a0 * s0 + a1;
    out0[i] = v3;
  }
  return bad;
}

int granita (const float *const *in, const float *scalars, float *const *out, long from, long to)
{
  return lanes (in[0], in[1], out[0], scalars, from, to);
}
";
    assert_eq!(own, expected);
}

#[test]
fn lanes_outside_of_a_range_are_counted_as_bad() {
    let source = print(&plan(Code::Two(Binary::Pow))).unwrap();
    assert!(
        source.text.contains("    const float v3 = pow_near (a0, s0);\n    bad |= !pow_is_near (a0, s0);\n")
    );
}

#[test]
fn functions_without_a_native_form_are_left_to_tapes() {
    for code in [Code::One(Unary::Erf), Code::Two(Binary::LogBase), Code::Three(Ternary::Hypot)] {
        assert_eq!(print(&plan(code)), None, "{code:?}");
    }
}
