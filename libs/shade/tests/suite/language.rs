//! Tests of the language's statements and of functions of the source (reference 5.5, 5.6).

use crate::fixture::*;
use granita_base::Params;
use granita_gsl::ir::ValueType;

fn first(body: &str) -> f32 {
    floats(body)[0]
}

/// Runs a body with functions before the shader.
fn calling(functions: &str, body: &str) -> f32 {
    let source = format!("{functions} surface t (output float r = -1) {{ {body} }}");
    let group = link(&[(&source, Params::new())], &[]);
    output(&group, &mut square(3, 2), &mut Double::default(), "r", ValueType::Float)[5]
}

#[test]
fn operators_bind_as_in_c() {
    for (expression, wanted) in [
        ("1 - 2 - 3", -4.0),
        ("16 / 4 / 2", 2.0),
        ("16 / 4 * 2", 8.0),
        ("1 + 2 * 3 - 4 / 8", 6.5),
        ("-2 * -3 - -1", 7.0),
        ("2 - -u", 2.0),
        ("1 < 2 == 1", 1.0),
        ("1 + 1 < 3 && 2 > 1 || 0", 1.0),
        ("0 && 0 || 1", 1.0),
        ("1 || 0 && 0", 1.0),
        ("!0 + 1", 2.0),
        ("!(1 + 1)", 0.0),
        ("0 ? 1 : 0 ? 2 : 3", 3.0),
        ("1 ? 0 ? 4 : 5 : 6", 5.0),
        ("(1 + 2) * 3", 9.0),
        ("length ((vector) point (3, 4, 0) * 2)", 10.0),
        ("(u < v) * 3 + (u == u) * 2", 2.0),
    ] {
        assert_eq!(first(&format!("r = {expression};")), wanted, "{expression}");
    }
    assert_eq!(first("float a = 1, b = 2; a = b = 5; r = a * 10 + b;"), 55.0);
    assert_eq!(first("float a = 1; a += a *= 3; r = a;"), 6.0);
    assert_eq!(first("float a = 3; r = a++ * 10 + a; "), 34.0);
    assert_eq!(first("float a = 3; r = ++a * 10 + a--; r += a * 100;"), 344.0);
    assert_eq!(first("float a[2] = { 5, 6 }; float k = 0; r = a[k++] * 10 + k;"), 51.0);
}

#[test]
fn logical_operators_evaluate_no_more_than_needed() {
    assert_eq!(first("float k = 0; r = 0 && ++k; r = 1 || ++k; r = k;"), 0.0);
    assert_eq!(first("float k = 0; r = 1 && ++k; r = 0 || ++k; r = k;"), 2.0);
    assert_eq!(first("float k = 0; r = 1 ? 7 : ++k; r += k;"), 7.0);
}

#[test]
fn values_of_every_type_are_conditions() {
    for (condition, wanted) in [
        ("0", 0.0),
        ("-0.5", 1.0),
        ("color (0)", 0.0),
        ("color (0, 0, 1)", 1.0),
        ("point (0, 1, 0)", 1.0),
        ("vector (0)", 0.0),
        ("normal (1, 0, 0)", 1.0),
        ("matrix (0)", 0.0),
        ("matrix (0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1)", 1.0),
        ("\"\"", 0.0),
        ("\"0\"", 1.0),
    ] {
        assert_eq!(first(&format!("r = 0; if ({condition}) r = 1;")), wanted, "{condition}");
        assert_eq!(first(&format!("r = 0; while ({condition}) {{ r = 1; break; }}")), wanted, "{condition}");
        assert_eq!(first(&format!("r = ({condition}) ? 1 : 0;")), wanted, "{condition}");
        assert_eq!(first(&format!("r = !({condition});")), 1.0 - wanted, "{condition}");
        assert_eq!(
            first(&format!("r = 0; for (float k = 0; k < 2 && ({condition}); ++k) r += 0.5;")),
            wanted
        );
        assert_eq!(first(&format!("r = 0; do r += 1; while (r < 2 && ({condition}));")), 1.0 + wanted);
    }
}

#[test]
fn relations_give_the_number_zero_or_one() {
    assert_eq!(
        first("float x = 1 < 2; color c = 1 < 2; matrix m = 2 < 1; r = x + c[1] * 10 + m[0][0] * 100;"),
        11.0
    );
}

#[test]
fn indices_are_rounded_down_and_clamped() {
    assert_eq!(first("color c = color (1, 2, 3); r = c[1.9] + 10 * c[0.5];"), 12.0);
    for (body, text, value) in [
        ("color c = color (1, 2, 3); float k = 3 + u; r = c[k];", "index 3 is outside of 0 to 2", 3.0),
        (
            "color c = color (1, 2, 3); float k = -1 - u; c[k] = 9; r = c[0];",
            "index -1 is outside of 0 to 2",
            9.0,
        ),
        ("matrix m = 1; float k = 4 + u; r = m[k][3];", "index 4 is outside of 0 to 3", 1.0),
    ] {
        let mut services = Double::default();
        assert_eq!(floats_with(body, &mut services)[0], value, "{body}");
        let errors = services.errors();
        assert!(errors.len() == 1 && errors[0].contains(text), "{body}: {errors:?}");
    }
}

#[test]
fn strings_keep_their_escapes() {
    let mut services = Double::default();
    floats_with(
        "string s = \"a\\n\\r\\t\\\\\\\"b\" \"c\"; printf (\"%s\", s); r = s == \"x\";",
        &mut services,
    );
    assert_eq!(services.printed(), ["a\n\r\t\\\"bc"]);
}

#[test]
fn arguments_are_passed_by_reference() {
    // The arguments are two names of one variable, elements and components, and arrays.
    assert_eq!(calling("void f (float a, float b) { a = 1; b += a; }", "float x = 5; f (x, x); r = x;"), 2.0);
    assert_eq!(
        calling(
            "void put (float x, float y) { y = x; }",
            "color c = 0; float a[3] = {0, 0, 0}; put (3, c[1]); put (4, a[u * 2]); r = c[1] + 10 * a[2];"
        ),
        43.0
    );
    assert_eq!(
        calling(
            "void fill (color list[], float x) { for (float k = 0; k < arraylength (list); ++k) list[k] = x + k; }",
            "color a[2], b[4]; fill (a, 1); fill (b, 10); r = a[1][0] + b[3][2];"
        ),
        15.0
    );
    // An expression that is not a variable is copied.
    assert_eq!(
        calling("float f (float a) { a += 1; return a; }", "float x = 5; r = f (x + 0) * 10 + x;"),
        65.0
    );
    // A float that is passed as a color is converted, and not written.
    assert_eq!(calling("float f (color c) { return c[0] + c[2]; }", "float x = 5; r = f (x);"), 10.0);
    // An element remains that of the index at the time of the call.
    assert_eq!(
        calling(
            "void f (float x, float k) { k = 2; x = 7; }",
            "float a[3] = {0, 0, 0}; float k = 1; f (a[k], k); r = a[1] * 10 + k;"
        ),
        72.0
    );
}

#[test]
fn scopes_are_lexical() {
    // The function reads `x` of its surroundings, not that of its caller.
    assert_eq!(first("float x = 1; float see () { return x; } { float x = 2; r = see () * 10 + x; }"), 12.0);
    assert_eq!(
        first(
            "float x = 1, y = 2; float f (float a) { float x = 10; x += y; y += 100; return x + a; } r = f (x) + y + x;"
        ),
        116.0
    );
    assert_eq!(
        first(
            "float f () { return 1; } float g () { float f () { return 2; } return f (); } r = f () * 10 + g ();"
        ),
        12.0
    );
    // A local hides a global for the functions below it, but not for those above.
    assert_eq!(
        calling(
            "float see () { return u; }",
            "float u = 7; float mine () { return u; } r = see () + mine () * 10;"
        ),
        71.0
    );
    // Each call has its own variables.
    assert_eq!(first("float f (float n) { float t = n; t += 1; return t; } r = f (f (f (1))) + f (1);"), 6.0);
}

#[test]
fn the_arguments_and_the_result_choose_a_function() {
    let functions = "float f (float x) { return 1; } float f (float x, float y) { return 2; } float f (color x) { return 3; } \
                     float f (string x) { return 4; } float f (float x[]) { return 5; } float f (point x) { return 6; } \
                     float f (vector x) { return 7; }";
    for (call, wanted) in [
        ("f (u)", 1.0),
        ("f (u, v)", 2.0),
        ("f (C)", 3.0),
        ("f (\"x\")", 4.0),
        ("f (P)", 6.0),
        ("f (I)", 7.0),
        // A normal is as near to a point as to a vector. The first declaration is selected.
        ("f (N)", 6.0),
        ("f (color (1))", 3.0),
        ("f ((vector) C)", 7.0),
        ("f (P - P)", 7.0),
        // A call that may return any type returns a number.
        ("f (noise (P))", 1.0),
    ] {
        assert_eq!(calling(functions, &format!("r = {call};")), wanted, "{call}");
    }
    assert_eq!(calling(functions, "float a[2] = {1, 2}; r = f (a);"), 5.0);
    let results = "float g () { return 6; } color g () { return color (7, 8, 9); } point g () { return 10; } \
                   string g () { return \"s\"; } float which (color c) { return 1; } float which (string s) { return 2; }";
    for (body, wanted) in [
        ("r = g ();", 6.0),
        ("color c = g (); r = c[1];", 8.0),
        ("point p = g (); r = p[2];", 10.0),
        ("vector p = g (); r = p[2];", 10.0),
        ("r = (g () == \"s\");", 1.0),
        ("r = luminance ((color) g () * 0 + 1);", 1.0),
        ("color c = 2 * g () + 1; r = c[2];", 19.0),
    ] {
        let found = calling(results, body);
        assert!((found - wanted).abs() < 1e-5, "{body}: {found}");
    }
}

#[test]
fn return_ends_functions_and_shaders() {
    assert_eq!(calling("void f (float x) { x = 1; return; x = 2; }", "float y = 0; f (y); r = y;"), 1.0);
    assert_eq!(
        calling(
            "float f () { for (float k = 0; 1; ++k) { while (1) { if (k == 3) return k; break; } } return -1; }",
            "r = f ();"
        ),
        3.0
    );
    assert_eq!(calling("void f () { exit (); }", "r = 1; f (); r = 2;"), 1.0);
    assert_eq!(first("r = 1; for (float k = 0; k < 9; ++k) { if (k == 2) return; r += 1; } r = 100;"), 3.0);
}

#[test]
fn emit_starts_with_black_and_runs_inside_of_its_cone_only() {
    let light = "light l () { Cl = 5; emit (point (0, 0, -2)) { Cl += 0.25; } }";
    assert_eq!(floats_with("r = 0; lights (P) r += Cl[1];", &mut Double::with_lights(&[light]))[0], 0.25);
    let light = "light l () { emit (point (0, 0, -2), vector (0, 0, 1), 0.1) { Cl = 1; printf (\"lit\"); } }";
    let mut services = Double::with_lights(&[light]);
    assert_eq!(floats_with("r = 0; lights (P) r += 1;", &mut services), [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    // The message is printed once, for the point that is lit.
    assert_eq!(services.printed(), ["lit"]);
}

#[test]
fn category_expressions_are_evaluated_from_left_to_right() {
    let all = ["red", "blue", "red,blue", ""].map(|c| {
        format!("light l (string __category = \"{c}\") {{ emit (vector (0, 0, 1), 0) {{ Cl = 1; }} }}")
    });
    let all: Vec<&str> = all.iter().map(String::as_str).collect();
    for (category, wanted) in [
        ("red", 2.0),
        ("blue&!red", 1.0),
        ("blue & ! red", 1.0),
        ("red|blue", 3.0),
        ("red,blue", 3.0),
        ("red&blue", 1.0),
        ("!red", 2.0),
        ("-red", 2.0),
        ("*", 3.0),
        ("-*", 1.0),
        // The expression is (red | blue) & !red, and not red | (blue & !red).
        ("red|blue&!red", 1.0),
        ("-*|red&blue", 1.0),
        ("green", 0.0),
        ("", 4.0),
    ] {
        let mut services = Double::with_lights(&all);
        let body = format!("r = 0; lights (\"{category}\", P) r += 1;");
        assert_eq!(floats_with(&body, &mut services)[0], wanted, "{category}");
        let cone = format!("r = 0; lights (\"{category}\", P, N, 1) r += 1;");
        assert_eq!(floats_with(&cone, &mut services)[0], wanted, "{category}");
    }
}

#[test]
fn nested_trace_loops_read_messages_of_the_innermost() {
    let body = "r = 0; trace (\"a\", P, N, 1, 2) { float d = 0; getmessage (\"trace\", \"hitdist\", d); \
                trace (\"b\", P, N, 1, 3) { float e = 0; getmessage (\"trace\", \"hitdist\", e); r += 10 * e; } \
                float again = 0; getmessage (\"trace\", \"hitdist\", again); r += d == again; } \
                float after = 7; r += getmessage (\"trace\", \"hitdist\", after) * 1000;";
    assert_eq!(first(body), 122.0);
}
