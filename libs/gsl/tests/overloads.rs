//! Tests which form of a function is called, among built-in forms and those of the source, by arguments and by the
//! expected type.

mod common;
use common::{module, said};
use granita_gsl::Func;
use granita_gsl::ir::{Module, OpCode, Stmt};

/// Returns the types of the results of all calls of a built-in function, in the order of the code.
fn results(module: &Module, func: Func) -> Vec<&'static str> {
    fn walk(module: &Module, block: &[Stmt], func: Func, out: &mut Vec<&'static str>) {
        for stmt in block {
            match stmt {
                Stmt::Op(op) if op.code == OpCode::Call(func) => {
                    out.push(op.dst.map_or("void", |dst| module.symbol(dst).ty.value.word()));
                }
                Stmt::If { then, otherwise, .. } => {
                    walk(module, then, func, out);
                    walk(module, otherwise, func, out);
                }
                Stmt::Scope { body, .. } | Stmt::Lights { body, .. } => walk(module, body, func, out),
                _ => {}
            }
        }
    }
    let mut out = Vec::new();
    walk(module, &module.body, func, &mut out);
    out
}

/// Returns the results of a function in the body of a displacement shader with parameters of several types.
fn of_body(body: &str, func: Func) -> Vec<&'static str> {
    let source = format!(
        "displacement t (string name = \"a.tx\", float Km = 1, float x = 2, output color c = 1, output vector w = 0, \
         output float f = 0, output matrix m = 1) {{ {body} }}"
    );
    results(&module(&source), func)
}

#[test]
fn functions_of_the_source_add_forms_to_built_in_functions() {
    // The library defines `max` of three numbers by that of two, and `fresnel` of five arguments by that of seven.
    let library = "float max (float x, float y, float z) { return max (x, max (y, z)); }
        void fresnel (vector I, normal N, float eta, output float Kr, output float Kt) \
        { vector R, T; fresnel (I, N, eta, Kr, Kt, R, T); }
        color mix (color a, color b, color t) { return a * (1 - t) + b * t; }
        float noise (string s) { return s == \"a\"; }";
    let m = module(&format!(
        "{library} surface t () {{ float kr, kt; fresnel (normalize (I), normalize (N), 1.5, kr, kt); \
         C = mix (color (kr), color (kt), C) + mix (C, color (1), 0.5) + max (u, v, kr) + max (C, color (kt)) \
         + noise (\"a\") + noise (P); }}"
    ));
    assert_eq!(results(&m, Func::Max), ["float", "float", "color"]);
    assert_eq!((results(&m, Func::Fresnel).len(), results(&m, Func::Mix)), (1, vec!["color"]));
    assert_eq!(results(&m, Func::Noise), ["color"]);
    // With the exact arguments of a built-in form, the form of the source is called. Within it, the built-in form is
    // called.
    let m = module("float sqrt (float x) { return sqrt (abs (x)) + 1; } surface t () { C = sqrt (u); }");
    assert_eq!((results(&m, Func::Abs).len(), results(&m, Func::Sqrt).len()), (1, 1));
    let m = module("float sqrt (float x) { return 2 * x; } surface t () { C = sqrt (u); }");
    assert!(results(&m, Func::Sqrt).is_empty());
    // An argument that may be a float is one. The form of the source does not change it.
    let m =
        module("float abs (vector v) { return length (v); } surface t () { C = abs (noise (P)) + abs (N); }");
    assert_eq!((results(&m, Func::Noise), results(&m, Func::Abs).len()), (vec!["float"], 1));
    // Both kinds of forms are listed when none fits.
    let found = said("float sqrt (string s) { return s == \"\"; } surface t () { C = sqrt (P); }");
    assert_eq!(
        found,
        "1:62: error: no form of `sqrt` takes (point) [it is one of float sqrt (string); sqrt (float)]"
    );
    // Without a built-in form, a function may not call itself.
    assert!(said("float g (float x) { return g (x); } surface t () { C = g (u); }").contains("calls itself"));
}

#[test]
fn forms_that_make_an_expression_invalid_are_not_chosen() {
    // A color times a vector is invalid, so the texture is a float.
    for body in [
        "P -= Km * texture (name, u, v) * normalize (N);",
        "P += texture (name, u, v) * N;",
        "P = P - normalize (N) * (Km * texture (name, u, v));",
        "P += N * (texture (name, u, v) + 1);",
        "w = texture (name, u, v) * vector (1, 2, 3) / Km;",
        "P += transformv (\"shader\", Km * texture (name, u, v) * N);",
        "m *= texture (name, u, v);",
    ] {
        assert_eq!(of_body(body, Func::Texture), ["float"], "{body}");
    }
    assert_eq!(of_body("P += texture (name, u, v) * noise (P) * N;", Func::Texture), ["float"]);
    assert_eq!(of_body("f = max (0.1, texture (name, u, v)) * dot (N, N);", Func::Texture), ["float"]);
    // Where nothing else fits, the one number is used for all components, which is rarely intended.
    let warned = said("displacement t () { vector w = texture (\"a\", u, v); P += w; }");
    assert_eq!(
        warned,
        "1:32: warning: `texture` gives one number here, for all components \
         [write `(vector)` in front to take three channels]"
    );
    assert_eq!(of_body("w = (vector) texture (name, u, v);", Func::Texture), ["color"]);
    assert_eq!(of_body("N = (normal) (2 * texture (name, u, v) - 1);", Func::Texture), ["color"]);
}

#[test]
fn overloads_are_floats_as_factors_and_colors_otherwise() {
    for (body, expected) in [
        ("c *= 0.2 + 0.8 * noise (x);", "float"),
        ("c *= noise (P);", "float"),
        ("c /= 1 + noise (P, x);", "float"),
        ("c *= max (noise (P), 0.1);", "float"),
        ("c *= u > 0.5 ? noise (P) : 1;", "float"),
        ("c *= -noise (P);", "float"),
        ("w *= 1 + noise (P);", "float"),
        ("c *= (color) noise (P);", "color"),
        ("c *= luminance (noise (P));", "color"),
        ("c = 0.2 + 0.8 * noise (P);", "color"),
        ("c += noise (P);", "color"),
        ("c = c * noise (P);", "color"),
        ("f = noise (P) * x;", "float"),
        ("w = noise (P);", "vector"),
        ("w = N + noise (P);", "vector"),
        ("P += vector (noise (x), 0, 0);", "float"),
    ] {
        assert_eq!(of_body(body, Func::Noise), [expected], "{body}");
    }
    assert_eq!(of_body("c *= random ();", Func::Random), ["float"]);
    for (body, expected) in [
        ("c *= texture (name, u, v);", "color"),
        ("c *= 0.5 + texture (name, u, v) * noise (P);", "color"),
        ("c += Km * texture (name, u, v);", "color"),
        ("c = Km * texture (name, u, v) * x;", "color"),
        ("f = texture (name, u, v);", "float"),
        ("f *= texture (name, u, v);", "float"),
        ("if (texture (name, u, v) > 0.5) f = 1;", "float"),
        ("c = mix (texture (name, u, v), c, 0.5);", "color"),
    ] {
        assert_eq!(of_body(body, Func::Texture), [expected], "{body}");
    }
    let m = module(
        "surface t (float Kr = 1, string env = \"\") { color shine = 0; \
         shine += Kr * environment (env, reflect (I, N)); C = shine; }",
    );
    assert_eq!(results(&m, Func::Environment), ["color"]);
    // Both functions leave the type open.
    let body = "c *= texture (name, u, v) * noise (P);";
    assert_eq!((of_body(body, Func::Texture), of_body(body, Func::Noise)), (vec!["color"], vec!["float"]));
}
