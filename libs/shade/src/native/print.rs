//! Prints plans as C.

use super::NativeSource;
use crate::run::lanes::{Binary as B, Ternary as T, Unary as U};
use crate::tape::{Code, Part, Plan};
use std::fmt::Write;

/// The functions that printed code calls.
const PRELUDE: &str = include_str!("prelude.c");

/// The value of a step: an expression, and the condition under which it is right.
struct Value {
    expression: String,
    condition: Option<String>,
}

impl From<String> for Value {
    fn from(expression: String) -> Self {
        Self { expression, condition: None }
    }
}

/// Returns the function of a plan; `None` when a step has no native form.
pub(crate) fn print(plan: &Plan) -> Option<NativeSource> {
    let outputs: Vec<u32> = plan
        .results
        .iter()
        .flat_map(|result| &result.parts)
        .filter_map(|part| if let Part::Row(row) = part { Some(*row) } else { None })
        .collect();
    let mut body = String::new();
    for step in &plan.steps {
        let args = step.args.map(|row| name(plan, row));
        let value = value(step.code, &args)?;
        let out = name(plan, step.out);
        writeln!(body, "    const float {out} = {};", value.expression).ok()?;
        if let Some(condition) = value.condition {
            writeln!(body, "    bad |= !{condition};").ok()?;
        }
    }
    // Only for parameters do compilers trust `restrict`, without which they do not use vectors for many arrays.
    let count = plan.loads.len();
    let read = (0..count).map(|k| format!("const float *restrict in{k}, "));
    let written = (0..outputs.len()).map(|k| format!("float *restrict out{k}, "));
    let mut text = format!(
        "{PRELUDE}\nstatic __attribute__ ((noinline)) int lanes ({}const float *scalars, long from, long to)\n{{\n",
        read.chain(written).collect::<String>()
    );
    for k in &plan.splats {
        writeln!(text, "  const float s{k} = scalars[{k}];").ok()?;
    }
    text.push_str("  int bad = 0;\n  for (long i = from; i < to; ++i) {\n");
    for k in 0..count {
        writeln!(text, "    const float a{k} = in{k}[i];").ok()?;
    }
    text.push_str(&body);
    for (k, row) in outputs.iter().enumerate() {
        writeln!(text, "    out{k}[i] = {};", name(plan, *row)).ok()?;
    }
    let read = (0..count).map(|k| format!("in[{k}], "));
    let written = (0..outputs.len()).map(|k| format!("out[{k}], "));
    write!(
        text,
        "  }}\n  return bad;\n}}\n\nint granita (const float *const *in, const float *scalars, float *const *out, \
         long from, long to)\n{{\n  return lanes ({}scalars, from, to);\n}}\n",
        read.chain(written).collect::<String>()
    )
    .ok()?;
    let scalars = plan.constants.len() + plan.uniform.len() + plan.scalars.len();
    Some(NativeSource { text, inputs: count, scalars, outputs: outputs.len() })
}

/// Returns the name of a row.
fn name(plan: &Plan, row: u32) -> String {
    let (k, loads) = (row as usize, plan.loads.len());
    match plan.splats.get(k.wrapping_sub(loads)) {
        _ if k < loads => format!("a{k}"),
        Some(scalar) => format!("s{scalar}"),
        None => format!("v{k}"),
    }
}

/// Returns a number with all of its bits.
fn number(value: f32) -> String {
    format!("of_bits ({:#x}u)", value.to_bits())
}

/// Returns the value of a step.
fn value(code: Code, [a, b, c]: &[String; 3]) -> Option<Value> {
    match code {
        Code::One(f) => unary(f, a),
        Code::Two(f) => binary(f, a, b),
        Code::Three(f) => ternary(f, a, b, c).map(Value::from),
    }
}

/// Returns 1 or 0.
fn truth(condition: String) -> Value {
    format!("{condition} ? 1.0f : 0.0f").into()
}

fn unary(f: U, a: &str) -> Option<Value> {
    let call = |name: &str| Some(Value::from(format!("{name} ({a})")));
    let near = |name: &str, condition: &str| {
        Some(Value {
            expression: format!("{name}_near ({a})"),
            condition: Some(format!("{condition} ({a})")),
        })
    };
    let infinity = "__builtin_inff ()";
    match f {
        U::Copy => Some(a.to_owned().into()),
        U::Neg => Some(format!("-{a}").into()),
        U::Radians => Some(format!("{a} * {}", number(1.0_f32.to_radians())).into()),
        U::Degrees => Some(format!("{a} * {}", number(1.0_f32.to_degrees())).into()),
        U::Sin => near("sin", "turns_are_few"),
        U::Cos => near("cos", "turns_are_few"),
        U::Tan => near("tan", "turns_are_few"),
        U::Asin => call("asin_"),
        U::Acos => call("acos_"),
        U::Atan => call("atan_"),
        U::Sinh => near("sinh", "exp_is_near"),
        U::Cosh => near("cosh", "exp_is_near"),
        U::Tanh => call("tanh_"),
        U::Exp => near("exp", "exp_is_near"),
        U::Log => near("log", "is_ordinary"),
        U::Log2 => near("log2", "is_ordinary"),
        U::Log10 => near("log10", "is_ordinary"),
        U::Sqrt => call("SQRT"),
        U::InverseSqrt => Some(format!("1.0f / SQRT ({a})").into()),
        U::Reciprocal => Some(format!("{a} > 0.0f ? 1.0f / {a} : 0.0f").into()),
        U::Abs => call("ABS"),
        U::Sign => Some(format!("(float)(({a} > 0.0f) - ({a} < 0.0f))").into()),
        U::Floor => call("__builtin_floorf"),
        U::Ceil => call("__builtin_ceilf"),
        U::Round => call("round_"),
        U::Trunc => call("__builtin_truncf"),
        U::IsNan => Some(truth(format!("{a} != {a}"))),
        U::IsInf => Some(format!("(float)(({a} == {infinity}) - ({a} == -{infinity}))").into()),
        U::Finite => Some(truth(format!("ABS ({a}) < {infinity}"))),
        U::Erf | U::Erfc => None,
    }
}

fn binary(f: B, a: &str, b: &str) -> Option<Value> {
    let near = |name: &str, condition: &str| {
        Some(Value {
            expression: format!("{name}_near ({a}, {b})"),
            condition: Some(format!("{condition} ({a}, {b})")),
        })
    };
    match f {
        B::Add => Some(format!("{a} + {b}").into()),
        B::Sub => Some(format!("{a} - {b}").into()),
        B::Mul => Some(format!("{a} * {b}").into()),
        B::Div => Some(format!("{a} / {b}").into()),
        B::Lt => Some(truth(format!("{a} < {b}"))),
        B::Le => Some(truth(format!("{a} <= {b}"))),
        B::Gt => Some(truth(format!("{a} > {b}"))),
        B::Ge => Some(truth(format!("{a} >= {b}"))),
        B::Eq => Some(truth(format!("{a} == {b}"))),
        B::Atan2 => near("atan2", "is_plain"),
        B::Pow => near("pow", "pow_is_near"),
        B::LogBase | B::Hypot => None,
        B::Mod => Some(format!("{a} - {b} * __builtin_floorf ({a} / {b})").into()),
        B::Min => Some(format!("{b} < {a} ? {b} : {a}").into()),
        B::Max => Some(format!("{b} > {a} ? {b} : {a}").into()),
        B::Step => Some(truth(format!("{b} >= {a}"))),
    }
}

fn ternary(f: T, a: &str, b: &str, c: &str) -> Option<String> {
    Some(match f {
        T::Hypot => return None,
        T::Clamp => format!("clamp ({a}, {b}, {c})"),
        T::Mix => format!("{a} * (1.0f - {c}) + {b} * {c}"),
        T::SmoothStep => format!("smoothstep ({a}, {b}, {c})"),
        T::Select => format!("{a} != 0.0f ? {b} : {c}"),
        T::MulAdd => format!("{a} * {b} + {c}"),
        T::MulSub => format!("{a} * {b} - {c}"),
        T::SubMul => format!("{c} - {a} * {b}"),
        T::MulMul => format!("{a} * {b} * {c}"),
    })
}
