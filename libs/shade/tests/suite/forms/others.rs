//! Functions of the grid, of strings, and of the renderer's data (reference 5.8.7 to 5.8.15).

use super::*;
use granita_base::Vec3;

const DERIVATIVES: &str = include_str!("../derivatives.rs");
const LIGHTS: &str = include_str!("../lights.rs");
const LOOKUPS: &str = include_str!("../lookups.rs");
const MESSAGES: &str = include_str!("../messages.rs");

/// Returns a grid on which u is from 0.25 to 1.5 and v from -1 to 1.
fn sheet() -> Grid {
    let mut grid = square(6, 5);
    for i in 0..30 {
        grid.u[i] = 0.25 + 0.25 * (i % 6) as f32;
        grid.v[i] = -1.0 + 0.5 * (i / 6) as f32;
        grid.p.set(i, Vec3::new(grid.u[i], grid.v[i], grid.u[i] * grid.v[i]));
    }
    grid
}

/// Returns every lane of an output over the sheet, with the components of triples one after the other.
fn over_sheet(body: &str, ty: ValueType) -> Vec<Vec<f32>> {
    let source = format!("surface t (output {} r = 0) {{ {body} }}", ty.word());
    let run = |optimize: bool| {
        let group = group(&source, &Params::new(), optimize);
        output(&group, &mut sheet(), &mut Double::default(), "r", ty)
    };
    let (r, plain) = (run(true), run(false));
    assert_eq!(bits(&r), bits(&plain), "{body}");
    (0..30).map(|i| (0..ty.components()).map(|c| r[c * 30 + i]).collect()).collect()
}

fn expect(body: &str, ty: ValueType, wanted: impl Fn(f64, f64) -> Vec<f64>) {
    for (i, got) in over_sheet(body, ty).iter().enumerate() {
        let (u, v) = (0.25 + 0.25 * (i % 6) as f64, -1.0 + 0.5 * (i / 6) as f64);
        let wanted = wanted(u, v);
        assert_eq!(got.len(), wanted.len());
        for (got, wanted) in got.iter().zip(wanted) {
            let near = (f64::from(*got) - wanted).abs() <= 2e-6 * wanted.abs().max(1.0);
            assert!(near, "{body} at {u} {v}: {got}, not {wanted}");
        }
    }
}

/// Quadratic functions have exact differences everywhere, borders included. They are slopes times the step.
fn differences(function: &str) {
    let along_u = function == "deltau";
    let d = move |du: f64, dv: f64| if along_u { 0.25 * du } else { 0.5 * dv };
    expect(&format!("r = {function} (3 * u * u - u * v + v * v + 2);"), ValueType::Float, |u, v| {
        vec![d(6.0 * u - v, 2.0 * v - u)]
    });
    let triple = |u: f64, v: f64| vec![d(2.0 * u, 0.0), d(v, u), d(0.0, 2.0 * v)];
    expect(&format!("r = {function} (point (u * u, u * v, v * v));"), ValueType::Vector, triple);
    expect(&format!("r = {function} (vector (u * u, u * v, v * v));"), ValueType::Vector, triple);
    expect(&format!("r = {function} (normal (u * u, u * v, v * v));"), ValueType::Vector, triple);
    expect(&format!("r = {function} (color (u * u, u * v, v * v));"), ValueType::Color, triple);
    // Constant values have zero differences, however large they are.
    expect(&format!("r = {function} (1 / 0) + {function} (3e38);"), ValueType::Float, |_, _| vec![0.0]);
}

fn filterwidths() {
    let root = |a: f64, b: f64| vec![(a * a + b * b).sqrt()];
    expect("r = filterwidth (u * u + v);", ValueType::Float, |u, _| root(0.25 * 2.0 * u, 0.5));
    for word in ["point", "vector", "normal", "color"] {
        expect(&format!("r = filterwidth ({word} (u * u, 3 * v, u - v));"), ValueType::Float, |u, _| {
            root((0.0625 * (4.0 * u * u + 1.0)).sqrt(), (0.25 * (9.0 + 1.0_f64)).sqrt())
        });
    }
}

fn areas_and_normals() {
    // P = (u, v, u v): dP/du = (1, 0, v), dP/dv = (0, 1, u).
    let n = |u: f64, v: f64| [-v, -u, 1.0];
    expect("r = surfacenormal (P);", ValueType::Normal, move |u, v| n(u, v).map(|x| -0.125 * x).to_vec());
    // The true differences of a bilinear sheet are its tangents.
    expect("r = samplearea (P);", ValueType::Float, |u, v| vec![0.125 * (1.0 + u * u + v * v).sqrt()]);
    expect("r = samplearea (point (3 * u, 2 * v, 0));", ValueType::Float, |_, _| vec![0.75]);
}

fn grid_sizes() {
    expect("r = gridn () + 1000 * gridnu () + 100000 * gridnv ();", ValueType::Float, |_, _| vec![506_030.0]);
    expect("r = gridindex ();", ValueType::Float, |u, v| vec![(v + 1.0) * 12.0 + (u - 0.25) * 4.0]);
    let mut grid = Grid::new(Topology::Triplets { n: 5 });
    let group = link(&[("surface t (output float r = 0) { r = gridn (); }", Params::new())], &[]);
    assert_eq!(output(&group, &mut grid, &mut Double::default(), "r", ValueType::Float), [15.0; 15]);
}

fn any() {
    for (condition, expected) in [
        ("u > 1.4", 1.0),
        ("u > 2", 0.0),
        ("u - u", 0.0),
        ("color (0, 0, u > 1.4)", 1.0),
        ("color (0)", 0.0),
        ("point (0, v, 0)", 1.0),
        ("vector (0)", 0.0),
        ("normal (0, 0, 1)", 1.0),
        ("matrix (0)", 0.0),
        ("matrix (u)", 1.0),
        ("\"\"", 0.0),
        ("\"x\"", 1.0),
        ("u > 1.4 ? \"x\" : \"\"", 1.0),
        ("u > 2 ? \"x\" : \"\"", 0.0),
        ("1 / (u - u)", 1.0),
    ] {
        expect(&format!("r = gridany ({condition});"), ValueType::Float, |_, _| vec![expected]);
    }
    // Only points that are shaded together count.
    expect("r = -1; if (u < 0.6) r = gridany (u > 1.4);", ValueType::Float, |u, _| {
        vec![if u < 0.6 { 0.0 } else { -1.0 }]
    });
}

fn reductions(function: &str) {
    let (u, v) = if function == "gridmin" { (0.25, -1.0) } else { (1.5, 1.0) };
    expect(&format!("r = {function} (u);"), ValueType::Float, |_, _| vec![u]);
    for ty in [ValueType::Color, ValueType::Point, ValueType::Vector, ValueType::Normal] {
        let body = format!("r = {function} ({} (u, v, 7));", ty.word());
        expect(&body, ty, |_, _| vec![u, v, 7.0]);
    }
    // NaNs are ignored.
    expect(&format!("r = {function} (sqrt (v) * 0 + u);"), ValueType::Float, |_, _| vec![u]);
    expect(&format!("r = 0; if (u > 0.3 && u < 1.3) r = {function} (u);"), ValueType::Float, |at, _| {
        let inside = at > 0.3 && at < 1.3;
        vec![if !inside {
            0.0
        } else if function == "gridmin" {
            0.5
        } else {
            1.25
        }]
    });
}

/// Checks the strings of expressions, with constants that fold and with values that vary.
fn texts(table: &[(&str, &str)]) {
    for (expression, wanted) in table {
        for (zero, one) in [("0", "1"), ("(u - u)", "(1 + v - v)")] {
            let expression = expression.replace("ZERO", zero).replace("ONE", one);
            let body = format!("string s = {expression}; r = s == \"{wanted}\"; if (!r) printf (\"%s\", s);");
            let mut services = Double::default();
            let r = floats_with(&body, &mut services);
            assert_eq!(r, [1.0; 6], "{expression}: {:?}, not {wanted:?}", services.printed());
        }
    }
}

fn formats() {
    texts(&[
        ("format (\"plain\")", "plain"),
        ("format (\"%f\", ONE)", "1.000000"),
        ("format (\"%f|%d|%i\", ONE / 2, 7.9 * ONE, -7.9 * ONE)", "0.500000|7|-7"),
        ("format (\"%c\", color (ONE, 2, ZERO))", "1.000000 2.000000 0.000000"),
        ("format (\"%p %p %p\", point (ONE), vector (2), normal (3))", {
            "1.000000 1.000000 1.000000 2.000000 2.000000 2.000000 3.000000 3.000000 3.000000"
        }),
        ("format (\"%.0m\", matrix (ONE))", "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1"),
        ("format (\"%s.%04d.%s\", \"a\", ONE * 12, ONE > 0 ? \"tx\" : \"\")", "a.0012.tx"),
        ("format (\"%g %g %g\", ONE / 4, 1e10 * ONE, ZERO)", "0.25 1e+10 0"),
        ("format (\"%f %f\", 1 / (ZERO + 0), -ONE / 0)", "inf -inf"),
        ("format (\"100%%\")", "100%"),
        ("format (ONE > 0 ? \"%f\" : \"\", ONE)", "1.000000"),
    ]);
}

fn concatenations() {
    texts(&[
        ("concat (\"a\")", "a"),
        ("concat (\"a\", \"\", \"b\")", "ab"),
        ("concat (\"a\", ONE > 0 ? \"x\" : \"y\", \"c\", \"d\", \"e\")", "axcde"),
    ]);
}

fn substrings() {
    texts(&[
        ("substr (\"hello\", ONE, 3)", "ell"),
        ("substr (\"hello\", ZERO)", "hello"),
        ("substr (\"hello\", -ONE)", "o"),
        ("substr (\"hello\", -2 * ONE, 1)", "l"),
        ("substr (\"hello\", 9 * ONE)", ""),
        ("substr (\"hello\", ONE, 99)", "ello"),
        ("substr (\"hello\", ONE, ZERO)", ""),
        ("substr (\"hello\", 1.7 * ONE, 1.9)", "e"),
        ("substr (\"\", ONE)", ""),
    ]);
}

fn matching() {
    for (pattern, subject, wanted) in [
        ("foo", "a food", 1.0),
        ("^foo", "a food", 0.0),
        ("[0-9]+$", "tile12", 1.0),
        ("a|b", "xbx", 1.0),
        ("(ab){2}", "abab", 1.0),
        ("", "x", 1.0),
        ("x", "", 0.0),
        ("FOO", "foo", 0.0),
        ("[[:upper:]]", "aB", 1.0),
        ("\\\\.", "a.b", 1.0),
    ] {
        for subject in [format!("\"{subject}\""), format!("u > 5 ? \"\" : \"{subject}\"")] {
            expect(&format!("r = match (\"{pattern}\", {subject});"), ValueType::Float, |_, _| vec![wanted]);
        }
    }
}

fn ray_kinds() {
    for (level, shadow, indirect) in [(0, false, false), (2, false, true), (1, true, false)] {
        let source = "surface t (output float r = 0) { r = raylevel () + 10 * isshadowray () + 100 * isindirectray (); }";
        let group = link(&[(source, Params::new())], &[]);
        let mut grid = square(2, 1);
        grid.ray = RayKind { level, shadow, indirect, bounces: u32::from(indirect) };
        let wanted =
            level as f32 + f32::from(u8::from(shadow)) * 10.0 + f32::from(u8::from(indirect)) * 100.0;
        assert_eq!(output(&group, &mut grid, &mut Double::default(), "r", ValueType::Float), [wanted; 2]);
    }
}

fn array_lengths() {
    for ty in ["float", "color", "point", "vector", "normal", "matrix", "string"] {
        assert_eq!(floats(&format!("{ty} list[4]; r = arraylength (list);")), [4.0; 6], "{ty}");
    }
    assert_eq!(
        floats("float f (color list[]) { return arraylength (list); } color k[9]; r = f (k);"),
        [9.0; 6]
    );
}

/// Checks lobes and amounts of reflected light in double precision.
fn lobes() {
    let unit = |a: f64, b: f64| [a.cos() * b.cos(), a.sin() * b.cos(), b.sin()];
    let word = |v: [f64; 3]| format!("vector ({}, {}, {})", v[0] as f32, v[1] as f32, v[2] as f32);
    for k in 0..40 {
        let t = f64::from(k);
        let (l, n, v) = (unit(t * 0.7, 0.3), unit(t * 0.7 + 0.4, 0.5 - 0.02 * t), unit(t * 0.7 - 0.5, 0.1));
        for roughness in [0.02, 0.1, 0.5, 1.0] {
            let sum = [0, 1, 2].map(|c| l[c] + v[c]);
            let length = sum.iter().map(|x| x * x).sum::<f64>().sqrt();
            let cos = (0..3).map(|c| n[c] * sum[c] / length).sum::<f64>().max(0.0);
            let wanted = cos.powf(8.0 / roughness);
            let call = format!("specularbrdf ({}, {}, {}, {roughness})", word(l), word(n), word(v));
            let r = floats(&format!("color c = {call}; r = c[1];"))[0];
            // The error of `pow` is a few rounding errors for each unit of the exponent.
            assert!((f64::from(r) - wanted).abs() < 2e-6 * (8.0 / roughness), "{call}: {r}, not {wanted}");
        }
    }
}

/// Checks spatial databases as the test services store them. Data that is saved under a key is found under it, in
/// active lanes.
fn databases() {
    let run = |body: &str| {
        let mut services = Double::default();
        let values = floats_with(body, &mut services);
        assert!(services.errors().is_empty(), "{body}: {:?}", services.errors());
        (values, services)
    };
    // There are keys of every kind and data of every type. The variable becomes the saved data.
    for key in ["u, v", "P", "P, N"] {
        for ty in ["float", "color", "point", "vector", "normal"] {
            let body = format!(
                "{ty} x = {ty} (u * 2 + 1), y = {ty} (7); spatialdbsave (\"a\", {key}, x); \
                 float found = spatialdbquery (\"a\", {key}, y); r = found == 1 && x == y;"
            );
            assert!(run(&body).0.iter().all(|r| *r == 1.0), "{body}");
        }
    }
    // Data is only saved where lanes are active. Elsewhere, and where no data is found, the variable does not change.
    let body = "float x = 5; if (u > 0.5) spatialdbsave (\"a\", u, v, u); \
                r = spatialdbquery (\"a\", u, v, x); r = r * 100 + x + 1000 * spatialdbquery (\"b\", u, v, x);";
    let (values, services) = run(body);
    let us = run("r = u;").0;
    assert_eq!(services.records.len(), us.iter().filter(|u| **u > 0.5).count());
    for (r, u) in values.iter().zip(&us) {
        assert_eq!(*r, if *u > 0.5 { 100.0 + u } else { 5.0 });
    }
    // The record is the middle of each facet.
    let (_, services) = run("spatialdbsave (\"a\", u, v, color (u, v, 1), \"interpolate\", 1);");
    let (nu, nv) = (distinct(&us), distinct(&run("r = v;").0));
    assert_eq!(services.records.len(), (nu - 1) * (nv - 1));
    for (_, key, data) in &services.records {
        assert_eq!(data[..], [key[0], key[1], 1.0]);
        assert!(us.iter().all(|u| (u - key[0]).abs() > 1e-3), "{key:?} is in the middle");
    }
    // The options are passed to the services.
    let options = |call: &str| run(&format!("float size[2] = {{64, 32}}; float x = 0; {call}")).1.options;
    assert_eq!(options("spatialdbsave (\"a\", P, x);"), " None  2");
    let all =
        "\"filemode\", \"wo\", \"resolution\", size, \"filedataformat\", \"half\", \"writefilterwidth\", 6";
    assert_eq!(options(&format!("spatialdbsave (\"a\", u, v, x, {all});")), "wo Some([64.0, 32.0]) half 6");
    assert_eq!(options("x = spatialdbquery (\"a\", P, x);"), "value  [0.25, 1.0, 3.0]");
    let all = "\"maxerror\", 2, \"maxdist\", 3, \"minsamples\", 4, \"filter\", \"areadensity\", \"filemode\", \"ro\"";
    assert_eq!(
        options(&format!("x = spatialdbquery (\"a\", P, x, {all});")),
        "areadensity ro [2.0, 3.0, 4.0]"
    );
    // The default is marble.
    for (options, wanted) in [
        ("", [2.19, 0.0041, 2.5]),
        (", \"scattering\", color (1, 2, 3), \"absorption\", color (4, 5, 6), \"eta\", 1.3", [1.0, 5.0, 2.3]),
        (", \"maxsolidangle\", 0.5", [2.19, 0.0041, 2.0]),
        (", \"model\", \"beam\"", [2.19, 0.0041, 12.5]),
    ] {
        for (c, wanted) in wanted.into_iter().enumerate() {
            let call = format!("subsurface (\"a\", point (1, 2, 3), normal (1, 2, 3){options})");
            let r = run(&format!("color c = {call}; r = c[{c}];")).0[0];
            assert!((r - wanted).abs() < 1e-6, "{call} {c}: {r}");
        }
    }
}

/// Returns the number of different values.
fn distinct(values: &[f32]) -> usize {
    let mut bits: Vec<u32> = values.iter().map(|v| v.to_bits()).collect();
    bits.sort_unstable();
    bits.dedup();
    bits.len()
}

pub(super) fn rows() -> Vec<Row> {
    use How::{Elsewhere, Test};
    vec![
        ("deltau (float)", Test(|| differences("deltau"))),
        ("deltau (point)", Elsewhere(include_str!("others.rs"), "{function} (point (u * u")),
        ("deltau (vector)", Elsewhere(include_str!("others.rs"), "{function} (vector (u * u")),
        ("deltau (color)", Elsewhere(include_str!("others.rs"), "{function} (color (u * u")),
        ("deltav (float)", Test(|| differences("deltav"))),
        ("deltav (point)", Elsewhere(include_str!("others.rs"), "{function} (point (u * u")),
        ("deltav (vector)", Elsewhere(include_str!("others.rs"), "{function} (vector (u * u")),
        ("deltav (color)", Elsewhere(include_str!("others.rs"), "{function} (color (u * u")),
        ("filterwidth (float)", Test(filterwidths)),
        ("filterwidth (point)", Elsewhere(include_str!("others.rs"), "filterwidth ({word}")),
        ("filterwidth (vector)", Elsewhere(include_str!("others.rs"), "filterwidth ({word}")),
        ("filterwidth (color)", Elsewhere(include_str!("others.rs"), "filterwidth ({word}")),
        ("surfacenormal (point)", Test(areas_and_normals)),
        ("samplearea (point)", Elsewhere(include_str!("others.rs"), "samplearea (P)")),
        ("gridn ()", Test(grid_sizes)),
        ("gridnu ()", Elsewhere(include_str!("others.rs"), "gridnu ()")),
        ("gridnv ()", Elsewhere(include_str!("others.rs"), "gridnv ()")),
        ("gridindex ()", Elsewhere(include_str!("others.rs"), "gridindex ()")),
        ("gridany (any)", Test(any)),
        ("gridmin (type)", Test(|| reductions("gridmin"))),
        ("gridmax (type)", Test(|| reductions("gridmax"))),
        ("format (string, ...)", Test(formats)),
        ("printf (string, ...)", Elsewhere(MESSAGES, "printf (\\\"%s %d\\\\n\\\"")),
        ("error (string, ...)", Elsewhere(MESSAGES, "error (\\\"bad %g\\\"")),
        ("fprintf (string, string, ...)", Elsewhere(MESSAGES, "fprintf (\\\"log.txt\\\"")),
        ("concat (string, string...)", Test(concatenations)),
        ("match (string, string)", Test(matching)),
        ("substr (string, float, float)", Test(substrings)),
        ("substr (string, float)", Elsewhere(include_str!("others.rs"), "substr (\\\"hello\\\", ZERO)")),
        ("texture (string, float, float, ...)", Elsewhere(LOOKUPS, "texture (\\\"st\\\", u, v)")),
        (
            "texture (string, float, float, float, float, float, float, ...)",
            Elsewhere(LOOKUPS, "texture (\\\"d\\\", u, v, 1, 2, 3, 4)"),
        ),
        ("texture3d (string, point, ...)", Elsewhere(LOOKUPS, "texture3d (\\\"none\\\", P, ")),
        (
            "environment (string, vector, ...)",
            Elsewhere(LOOKUPS, "environment (\\\"map\\\", vector (1, 2, 3))"),
        ),
        (
            "environment (string, point, vector, ...)",
            Elsewhere(LOOKUPS, "environment (\\\"map\\\", point (2), vector (1, 2, 3))"),
        ),
        (
            "environment (string, vector, vector, vector, ...)",
            Elsewhere(LOOKUPS, "environment (\\\"map\\\", vector (1, 2, 3), vector (0), vector (0))"),
        ),
        (
            "environment (string, point, vector, vector, vector, ...)",
            Elsewhere(
                LOOKUPS,
                "environment (\\\"map\\\", point (0), vector (1, 2, 3), vector (0), vector (0), ",
            ),
        ),
        ("shadow (string, point, ...)", Elsewhere(LIGHTS, "shadow (\\\"map\\\", P)")),
        (
            "shadow (string, point, vector, vector, ...)",
            Elsewhere(LIGHTS, "shadow (\\\"map\\\", P, vector ("),
        ),
        ("ambient ()", Elsewhere(LIGHTS, "color c = ambient ();")),
        ("diffuse (vector)", Elsewhere(LIGHTS, "diffuse (N)")),
        ("specular (vector, vector, float)", Elsewhere(LIGHTS, "specular (N, V, 0.5)")),
        ("specularbrdf (vector, vector, vector, float)", Test(lobes)),
        ("indirect (string, point, vector, ...)", Elsewhere(LIGHTS, "indirect (\\\"set\\\", P, N, ")),
        (
            "occlusion (string, point, vector, float, ...)",
            Elsewhere(LIGHTS, "occlusion (\\\"set\\\", P, N, 0.5, \\\""),
        ),
        (
            "occlusion (string, point, vector, float, output vector, ...)",
            Elsewhere(LIGHTS, "occlusion (\\\"set\\\", P, N, 0.5, o, "),
        ),
        ("subsurface (string, point, normal, ...)", Test(databases)),
        ("displace (float)", Elsewhere(DERIVATIVES, "\"displace (0.5);\", -0.5")),
        ("displace (string, float)", Elsewhere(DERIVATIVES, "displace (\\\"double\\\", 0.5)")),
        ("displace (vector)", Elsewhere(DERIVATIVES, "displace (vector (0, 0, 3))")),
        ("bump (float)", Elsewhere(DERIVATIVES, "\"bump (u);\"")),
        ("bump (string, float)", Elsewhere(DERIVATIVES, "bump (\\\"double\\\", ")),
        ("bump (vector)", Elsewhere(DERIVATIVES, "bump (vector (")),
        ("spatialdbsave (string, float, float, float|color|point|vector|normal, ...)", Test(databases)),
        ("spatialdbsave (string, point, float|color|point|vector|normal, ...)", Test(databases)),
        ("spatialdbsave (string, point, normal, float|color|point|vector|normal, ...)", Test(databases)),
        (
            "spatialdbquery (string, float, float, output float|color|point|vector|normal, ...)",
            Test(databases),
        ),
        ("spatialdbquery (string, point, output float|color|point|vector|normal, ...)", Test(databases)),
        (
            "spatialdbquery (string, point, normal, output float|color|point|vector|normal, ...)",
            Test(databases),
        ),
        ("getattribute (string, output any)", Elsewhere(MESSAGES, "getattribute (\\\"limits:eye\\\", x)")),
        ("setmessage (string, any)", Elsewhere(MESSAGES, "setmessage (\\\"m\\\", u)")),
        (
            "getmessage (string, string, output any)",
            Elsewhere(MESSAGES, "getmessage (\\\"surface\\\", \\\"m\\\", x)"),
        ),
        (
            "gettextureinfo (string, string, output any)",
            Elsewhere(MESSAGES, "gettextureinfo (\\\"wood.tx\\\", \\\"resolution\\\", x)"),
        ),
        ("raylevel ()", Test(ray_kinds)),
        ("isshadowray ()", Elsewhere(include_str!("others.rs"), "isshadowray ()")),
        ("isindirectray ()", Elsewhere(include_str!("others.rs"), "isindirectray ()")),
        ("arraylength (any[])", Test(array_lengths)),
    ]
}
