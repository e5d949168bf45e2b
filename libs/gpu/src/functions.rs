//! The functions of devices that have the results of the CPU: their text in WGSL, and the same function here.

use granita_shade::approx;

/// The text of all functions in single precision.
pub const SINGLE: &str = include_str!("wgsl/single.wgsl");

/// The text of all functions in double precision. It uses those of [`SINGLE`].
pub const DOUBLE: &str = include_str!("wgsl/double.wgsl");

/// The words of an input: the bits of `x`, `y` and `z`, and one more. As numbers of 64 bits they are `a` and `b`, with
/// the high words first.
pub(crate) type Input = [u32; 4];

/// The result of the CPU: the bits of a number, the high word of 64 bits first. `None` where the function does not
/// support the input.
pub(crate) type OnCpu = fn(Input) -> Option<[u32; 2]>;

/// A function of devices.
#[derive(Clone, Copy)]
pub(crate) struct Function {
    /// The name in reports.
    pub(crate) name: &'static str,
    /// The expression over `x`, `y`, `z`, `a`, `b` and `words` that gives a `vec2<u32>`.
    pub(crate) text: &'static str,
    /// True when numbers of 64 bits are used.
    pub(crate) wide: bool,
    /// The same function.
    pub(crate) cpu: OnCpu,
}

fn x(i: Input) -> f32 {
    f32::from_bits(i[0])
}

fn y(i: Input) -> f32 {
    f32::from_bits(i[1])
}

fn z(i: Input) -> f32 {
    f32::from_bits(i[2])
}

fn a(i: Input) -> f64 {
    f64::from_bits(u64::from(i[0]) << 32 | u64::from(i[1]))
}

fn b(i: Input) -> f64 {
    f64::from_bits(u64::from(i[2]) << 32 | u64::from(i[3]))
}

fn bits(x: f32) -> Option<[u32; 2]> {
    Some([x.to_bits(), 0])
}

fn wide_bits(x: f64) -> Option<[u32; 2]> {
    let bits = x.to_bits();
    Some([(bits >> 32) as u32, bits as u32])
}

/// Returns the bits when the condition holds.
fn when(condition: bool, x: f32) -> Option<[u32; 2]> {
    bits(x).filter(|_| condition)
}

/// True when a number or its result is denormal, so that devices may flush it to zero.
fn is_tiny(numbers: &[f32]) -> bool {
    numbers.iter().any(|x| x.is_subnormal())
}

/// Returns the result of a basic operation where no number is denormal.
fn normal(numbers: &[f32], result: f32) -> Option<[u32; 2]> {
    when(!is_tiny(numbers) && !result.is_subnormal(), result)
}

/// Returns the result of a basic operation where some number is denormal.
fn denormal(numbers: &[f32], result: f32) -> Option<[u32; 2]> {
    when(is_tiny(numbers) || result.is_subnormal(), result)
}

/// Returns the result of a function whose intermediate results are normal for arguments that are.
fn regular(condition: bool, argument: f32, result: f32) -> Option<[u32; 2]> {
    // A square of such an argument is normal.
    let sound = argument == 0.0 || argument.abs() > 1e-15;
    when(condition && sound, result)
}

/// A function in single precision.
const fn single(name: &'static str, text: &'static str, cpu: OnCpu) -> Function {
    Function { name, text, wide: false, cpu }
}

/// A function that uses double precision.
const fn double(name: &'static str, text: &'static str, cpu: OnCpu) -> Function {
    Function { name, text, wide: true, cpu }
}

/// All functions that [`crate::selftest`] runs.
pub(crate) const FUNCTIONS: &[Function] = &[
    single("add", "single(x + y)", |i| normal(&[x(i), y(i)], x(i) + y(i))),
    single("subtract", "single(x - y)", |i| normal(&[x(i), y(i)], x(i) - y(i))),
    single("multiply", "single(x * y)", |i| normal(&[x(i), y(i)], x(i) * y(i))),
    single("multiply and add", "single(x * y + z)", |i| {
        let p = x(i) * y(i);
        normal(&[x(i), y(i), z(i), p], p + z(i))
    }),
    single("add and subtract again", "single((x + 12582912.0f) - 12582912.0f)", |i| {
        normal(&[x(i)], (x(i) + 12_582_912.0) - 12_582_912.0)
    }),
    single("add (denormal)", "single(x + y)", |i| denormal(&[x(i), y(i)], x(i) + y(i))),
    single("multiply (denormal)", "single(x * y)", |i| denormal(&[x(i), y(i)], x(i) * y(i))),
    single("divide", "single(div(x, y))", |i| bits(x(i) / y(i))),
    single("square root", "single(root(x))", |i| bits(x(i).sqrt())),
    single("inverse square root", "single(div(1.0f, root(x)))", |i| bits(1.0 / x(i).sqrt())),
    single("floor", "single(floor_of(x))", |i| bits(approx::floor(x(i)))),
    single("ceil", "single(ceil_of(x))", |i| bits(-approx::floor(-x(i)))),
    single("trunc", "single(trunc_of(x))", |i| bits(approx::floor(x(i).abs()).copysign(x(i)))),
    single("round", "single(round_of(x))", |i| bits(x(i).round())),
    single("minimum", "single(min_of(x, y))", |i| bits(if y(i) < x(i) { y(i) } else { x(i) })),
    single("maximum", "single(max_of(x, y))", |i| bits(if y(i) > x(i) { y(i) } else { x(i) })),
    single("modulo", "single(modulo(x, y))", |i| {
        let q = x(i) / y(i);
        let p = y(i) * approx::floor(q);
        normal(&[x(i), y(i), q, p], x(i) - p)
    }),
    single("clamp", "single(clamp_to(x, y, z))", |i| {
        let above = if y(i) > x(i) { y(i) } else { x(i) };
        bits(if z(i) < above { z(i) } else { above })
    }),
    single("mix", "single(mix_of(x, y, z))", |i| {
        let (p, q) = (x(i) * (1.0 - z(i)), y(i) * z(i));
        normal(&[x(i), y(i), z(i), 1.0 - z(i), p, q], p + q)
    }),
    single("smoothstep", "single(smoothstep_of(x, y, z))", |i| {
        let (e0, e1, v) = (x(i), y(i), z(i));
        let t = (v - e0) / (e1 - e0);
        let middle = t * t * (3.0 - 2.0 * t);
        let below = if v >= e1 { 1.0 } else { middle };
        normal(&[e0, e1, v, v - e0, e1 - e0, t * t, t, middle], if v <= e0 { 0.0 } else { below })
    }),
    single("sine", "single(sin_near(x))", |i| {
        regular(approx::turns_are_few(x(i)), x(i), approx::sin_near(x(i)))
    }),
    single("cosine", "single(cos_near(x))", |i| {
        regular(approx::turns_are_few(x(i)), x(i), approx::cos_near(x(i)))
    }),
    single("tangent", "single(tan_near(x))", |i| {
        regular(approx::turns_are_few(x(i)), x(i), approx::tan_near(x(i)))
    }),
    single("arcsine", "single(asin_inside(x))", |i| {
        regular(x(i).abs() <= 1.0, x(i), approx::asin_inside(x(i)))
    }),
    single("arccosine", "single(acos_inside(x))", |i| {
        regular(x(i).abs() <= 1.0, x(i), approx::acos_inside(x(i)))
    }),
    single("arctangent", "single(atan_of(x))", |i| regular(x(i).abs() < 1e15, x(i), approx::atan(x(i)))),
    single("arctangent of two", "single(atan2_plain(x, y))", |i| {
        let q = x(i).abs() / y(i).abs();
        let sound = approx::is_plain(x(i), y(i)) && q < 1e15;
        regular(sound, q, approx::atan2_plain(x(i), y(i)))
    }),
    single("hyperbolic sine", "single(sinh_near(x))", |i| {
        regular(approx::exp_is_near(x(i)), x(i), approx::sinh_near(x(i)))
    }),
    single("hyperbolic cosine", "single(cosh_near(x))", |i| {
        regular(approx::exp_is_near(x(i)), x(i), approx::cosh_near(x(i)))
    }),
    single("hyperbolic tangent", "single(tanh_of(x))", |i| {
        regular(x(i).abs() < 1e15, x(i), approx::tanh(x(i)))
    }),
    single("exponential", "single(exp_near(x))", |i| {
        regular(approx::exp_is_near(x(i)), x(i), approx::exp_near(x(i)))
    }),
    single("logarithm", "single(ln_ordinary(x))", |i| {
        when(approx::is_ordinary(x(i)), approx::ln_ordinary(x(i)))
    }),
    double("multiply and add (double)", "double(a * b + a)", |i| {
        let p = a(i) * b(i);
        wide_bits(p + a(i)).filter(|_| !p.is_subnormal() && !(p + a(i)).is_subnormal())
    }),
    double("divide (double)", "double(wide_div(a, b))", |i| {
        wide_bits(a(i) / b(i)).filter(|_| a(i).is_normal() && b(i).is_normal() && (a(i) / b(i)).is_normal())
    }),
    double("double to single", "single(f32(a))", |i| normal(&[], a(i) as f32)),
    double("double to single (denormal)", "single(f32(a))", |i| denormal(&[], a(i) as f32)),
    double("logarithm to base 2", "single(log2_ordinary(x))", |i| {
        when(approx::is_ordinary(x(i)), approx::log2_ordinary(x(i)))
    }),
    double("logarithm to base 10", "single(log10_ordinary(x))", |i| {
        when(approx::is_ordinary(x(i)), approx::log10_ordinary(x(i)))
    }),
    double("power", "single(pow_ordinary(x, y))", |i| {
        when(approx::pow_is_ordinary(x(i), y(i)), approx::pow_ordinary(x(i), y(i)))
    }),
    double("error function", "single(erf_of(x))", |i| regular(true, x(i), approx::erf(x(i)))),
    double("complement of the error function", "single(erfc_of(x))", |i| normal(&[x(i)], approx::erfc(x(i)))),
];

/// Returns the text of a kernel that evaluates a function for each input.
pub(crate) fn kernel(function: &Function) -> String {
    let double = if function.wide { DOUBLE } else { "" };
    let wide = if function.wide {
        "    let a = wide(words.x, words.y);\n    let b = wide(words.z, words.w);\n"
    } else {
        ""
    };
    let result = if function.wide {
        "\nfn double(x: f64) -> vec2<u32> {\n    let bits = bitcast<u64>(x);\n    \
         return vec2<u32>(u32(bits >> 32u), u32(bits & 0xfffffffflu));\n}\n"
    } else {
        ""
    };
    format!(
        "{SINGLE}{double}{result}
fn single(x: f32) -> vec2<u32> {{
    return vec2<u32>(bitcast<u32>(x), 0u);
}}

@group(0) @binding(0) var<storage, read> inputs: array<vec4<u32>>;
@group(0) @binding(1) var<storage, read_write> outputs: array<vec2<u32>>;

@compute @workgroup_size({group})
fn main(@builtin(global_invocation_id) id: vec3<u32>) {{
    let i = id.x + id.y * {row}u;
    if (i >= arrayLength(&outputs)) {{
        return;
    }}
    let words = inputs[i];
    let x = bitcast<f32>(words.x);
    let y = bitcast<f32>(words.y);
    let z = bitcast<f32>(words.z);
{wide}    outputs[i] = {text};
}}
",
        group = crate::Kernel::GROUP,
        row = crate::Kernel::GROUP * crate::Kernel::ROW,
        text = function.text
    )
}
