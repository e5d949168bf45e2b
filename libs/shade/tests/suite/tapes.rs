//! Runs of plain operations that are computed strip by strip have the same results as one by one.

use crate::fixture::*;
use granita_base::{BaseType, ParamType, Params};
use granita_gsl::ir::ValueType;
use granita_shade::{Executor, Grid, Group, LayerSource, LinkOptions, Primvar, PrimvarData};

/// Every operation that can be part of a tape, with numbers that include NaN, infinite and tiny ones.
const BODY: &str = "
    float a = x * 1.5 - y, b = y / x, c = x * y + a, d = a - x * y, e = x * y - b, f = x * y * a;
    a = radians (b) + degrees (c); b += sin (d) * cos (e) + tan (f);
    c = asin (x) - acos (y) + atan (a) + atan (a, b); d = exp (x) + log (y) * log2 (x) - log10 (y);
    e = sqrt (x) + inversesqrt (y) + abs (a) + fabs (b) + sign (c) + floor (d) - ceil (x) + round (y) + trunc (a);
    f = isnan (x) + isinf (y) + finite (b) + pow (x, y) + mod (a, b) + min (c, d) - max (e, x) + step (x, y);
    f += clamp (a, b, c) + mix (a, b, x) + smoothstep (a, b, y) + (a < b) + (a <= b) * (a > c) - (a >= c);
    f -= (a == b) + (x != y) + !a + (a && b) + (x || y);
    vector v = vector (a, x, c), w = P - point (y, y, b), z = v;
    vector q = cross (v, w) + reflect (v, w) * dot (v, w) + normalize (z) + faceforward (w, v, z);
    z[1] = length (v) + distance (point (v), point (w)); q -= vector (luminance (color (q)), z[1], 2);
    q = (z == w) ? q : q * 0.5; if (v != z) q += 1;
    float either = a > 0 ? b : -c; color k = color (q[0], q[2], e); k = k * k + either;
    rf = f; rs = either; rq = q; rk = k; rv = z;
";

fn source(around: &str) -> String {
    let body = around.replace("BODY", BODY);
    format!(
        "surface t (float first = 0.3, float second = 7, output float rf = 0, output float rs = 0, \
         output vector rq = 0, output color rk = 0, output vector rv = 0) {{ {body} C = rk; }}"
    )
}

const WANTED: [(&str, ValueType); 5] = [
    ("rf", ValueType::Float),
    ("rs", ValueType::Float),
    ("rq", ValueType::Vector),
    ("rk", ValueType::Color),
    ("rv", ValueType::Vector),
];

/// Returns results to the bit. The payload of a NaN does not matter.
fn results(group: &Group, mut grid: Grid) -> Vec<Vec<u32>> {
    let mut services = Double { grid: Some(grid.clone()), ..Double::default() };
    let mut executor = Executor::new();
    let mut found = Vec::new();
    // In the second run the registers hold old values.
    for _ in 0..2 {
        found = executor.run(group, &mut grid, &mut services, &WANTED);
    }
    let bits = |x: f32| if x.is_nan() { u32::MAX } else { x.to_bits() };
    found.into_iter().map(|r| r.expect("a result").into_iter().map(bits).collect()).collect()
}

#[test]
fn fused_kernels_equal_the_generic_interpreter() {
    // The numbers are of all kinds and vary along the grid.
    let kinds = "float x = u * 3 - 1, y = v * second - first;
        if (u > 0.9) x = 0; if (v > 0.95) y = x / (u - u); if (u < 0.02) x = y * 1e-38; if (v < 0.03) y = 1e30 * x;";
    let arounds = [
        format!("{kinds} BODY"),
        "float x = first, y = second; BODY".to_owned(),
        "float x = first, y = v; BODY".to_owned(),
        format!("{kinds} if (u > first) {{ BODY }}"),
        format!("{kinds} if (u > 0.8 && v > 0.8) {{ BODY }} else {{ rf = x; rq = vector (y, x, rf); }}"),
        format!("{kinds} for (float i = 0; i < 3; ++i) {{ if (x > i) break; BODY x += rf; }}"),
        format!(
            "{kinds} void g (output float x, float y) {{ if (y > x) return; BODY x += 1; }} g (x, y); rs += x;"
        ),
    ];
    for around in arounds {
        let source = source(&around);
        let params = Params::new();
        let [plain, better] = [false, true].map(|optimize| {
            let layer = LayerSource { module: module(&source), params: &params, name: None };
            let say = &mut |_, text: String| panic!("{text}");
            Group::link_with(&[layer], &[], LinkOptions { optimize }, say).expect("a group")
        });
        // The sizes are less than a strip, whole strips, and strips with a remainder.
        for (nu, nv) in [(1, 1), (3, 2), (4, 4), (7, 9), (8, 8), (13, 17), (16, 16), (33, 31)] {
            let grid = square(nu, nv);
            assert_eq!(
                results(&plain, grid.clone()),
                results(&better, grid.clone()),
                "{nu} x {nv}: {around}"
            );
            // A value that was known to be the same everywhere now varies.
            let mut grid = grid;
            grid.primvars.push(Primvar {
                name: "first".into(),
                ty: ParamType::of(BaseType::Float),
                data: PrimvarData::Floats { values: grid.u.iter().map(|u| 0.7 - u).collect(), varying: true },
            });
            assert_eq!(
                results(&plain, grid.clone()),
                results(&better, grid),
                "{nu} x {nv}, varying: {around}"
            );
        }
    }
}
