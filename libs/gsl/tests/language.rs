//! Tests the rules of the language (reference 5.1 to 5.7, 5.9) that the other tests do not cover, one after the other.

mod common;
use common::{module, said};
use granita_gsl::ir::{Global, ShaderKind};

/// Returns the messages about a body of a surface shader with a parameter `k`.
fn about(body: &str) -> String {
    said(&format!("surface t (float k = 1) {{ {body} }}"))
}

#[test]
fn functions_are_declared_before_their_calls() {
    assert_eq!(
        said("float f () { return g (); } float g () { return 1; } surface t () { C = f (); }"),
        "1:21: error: unknown function `g`"
    );
    // A function that calls its caller is therefore not known yet.
    assert!(
        about("float f () { float g () { return f (); } return g (); } C = f ();").contains("calls itself")
    );
    module("float f () { return 1; } float g () { return f (); } surface t () { C = g (); }");
}

#[test]
fn names_are_case_sensitive() {
    module(
        "surface t () { float variable = 1, Variable = 2, VariAble = 3; C = variable + Variable + VariAble; }",
    );
    module("surface _t9 () { float hey19 = 1, __x = 2, spec_color = 3; C = hey19 + __x + spec_color; }");
    assert!(about("float 9x = 1;").contains("error"));
}

#[test]
fn keywords_and_reserved_words_are_refused_as_names() {
    let keywords = "break color continue do else emit float for if lights matrix normal point output return string trace \
                    vector void while";
    let reserved = "bool case char class const default double enum extern false friend inline int long private protected \
                    public short signed sizeof static struct switch template this true typedef uniform union unsigned \
                    varying virtual";
    for (list, what) in [(keywords, "is a keyword"), (reserved, "is reserved for future use")] {
        for word in list.split_whitespace() {
            for source in [
                format!("surface t () {{ float {word} = 1; }}"),
                format!("surface t (float {word} = 1) {{ }}"),
                format!("float {word} () {{ return 1; }} surface t () {{ }}"),
                format!("float f (float {word}) {{ return 1; }} surface t () {{ }}"),
            ] {
                let found = said(&source);
                assert!(found.contains(&format!("`{word}` {what}")), "{source}: {found}");
            }
        }
    }
    // These words are not in the list, and are names like any other.
    for word in ["surface", "displacement", "light", "volume", "shader", "exit", "noise"] {
        module(&format!("surface t () {{ float {word} = 1; C = {word}; }}"));
    }
}

#[test]
fn arrays_have_one_dimension_and_functions_return_no_arrays() {
    for body in [
        "float a[2][3]; C = a[0][0];",
        "float[2] f () { return 1; } C = f ();",
        "float f[2] () { return 1; } C = 1;",
        "float a[-1]; C = a[0];",
        "string s[2] = { 1, 2 }; printf (s[0]);",
        "float a[2] = { 1, \"x\" }; C = a[0];",
    ] {
        assert!(about(body).contains("error"), "{body}");
    }
    // Arrays of all types have a constant length, and are set as a whole or by element.
    for ty in ["float", "color", "point", "vector", "normal", "matrix"] {
        module(&format!(
            "surface t () {{ {ty} a[3] = {{ 1, 2 }}, b[3]; b = a; b[1] = a[2]; if (b[1] == a[0]) C = 1; }}"
        ));
    }
    module("#define N 2\nsurface t () { float a[N * 2 + 1] = { 1 }; C = a[4]; }");
}

#[test]
fn variables_end_with_their_scope() {
    for body in [
        "for (float i = 0; i < 3; ++i) C = i; opacity = i;",
        "{ float f () { return 1; } C = f (); } opacity = f ();",
        "if (k > 0) float x = 1; C = x;",
        "while (k > 0) { float x = 1; C = x; } C = x;",
        "float f (float a) { return a; } C = f (1) + a;",
    ] {
        let found = about(body);
        assert!(found.contains("unknown"), "{body}: {found}");
    }
    module("surface t () { float x = 1; { float x = 2; { float x = 3; C = x; } C += x; } C += x; }");
    // A parameter hides a global, and a local hides a parameter.
    module("surface t (float u = 3) { float v = u; { float u = 4; v += u; } C = v; }");
}

#[test]
fn relations_and_conditions_accept_the_types_of_the_reference() {
    for ty in ["color", "point", "vector", "normal", "matrix"] {
        for relation in ["<", "<=", ">", ">="] {
            assert!(
                about(&format!("{ty} a = 1; C = a {relation} a;")).contains("does not apply"),
                "{ty} {relation}"
            );
        }
        module(&format!(
            "surface t () {{ {ty} a = 1; C = (a == a) + (a != a) + (a == 1); if (a) C = 1; while (!a) C = 2; }}"
        ));
    }
    assert!(about("C = \"a\" < \"b\";").contains("does not apply"));
    // The truth of a relation is a number.
    module(
        "surface t () { float x = u < v; color c = u < v; matrix m = u == v; C = x + c[0] + m[0][0] + (1 < 2) * 3; }",
    );
}

#[test]
fn casts_convert_the_types_of_the_reference() {
    let triples = ["color", "point", "vector", "normal"];
    for a in triples {
        for b in triples {
            module(&format!("surface t () {{ {a} x = 1; {b} y = ({b}) x; C = y[0]; }}"));
        }
        module(&format!("surface t () {{ {a} y = ({a}) u; C = y[0]; }}"));
        for (to, from) in [("float", a), ("matrix", a), ("string", a)] {
            assert!(
                about(&format!("{from} x = 1; {to} y = ({to}) x;")).contains("cannot cast"),
                "{from} {to}"
            );
        }
        assert!(about(&format!("matrix x = 1; {a} y = ({a}) x;")).contains("cannot cast"));
        assert!(about(&format!("{a} y = ({a}) \"x\";")).contains("cannot cast"));
    }
    module("surface t () { matrix m = (matrix) u; C = m[1][1]; }");
    assert!(about("float y = (float) \"1\";").contains("cannot cast"));
}

/// Table 5.4, with R where a kind may read, W where it may write, and r where it may read within `lights` only.
const ACCESS: &[(Global, [&str; 4])] = &[
    // The columns are surface, displacement, volume and light.
    (Global::P, ["R", "RW", "R", "R"]),
    (Global::I, ["R", "", "R", "R"]),
    (Global::N, ["RW", "RW", "R", "R"]),
    (Global::Ng, ["R", "R", "R", "R"]),
    (Global::dPdu, ["R", "R", "R", "R"]),
    (Global::dPdv, ["R", "R", "R", "R"]),
    (Global::u, ["R", "R", "R", "R"]),
    (Global::v, ["R", "R", "R", "R"]),
    (Global::L, ["r", "", "r", "RW"]),
    (Global::Cl, ["r", "", "r", "RW"]),
    (Global::Ps, ["", "", "", "R"]),
    (Global::Ns, ["", "", "", "R"]),
    (Global::Pl, ["r", "", "r", "R"]),
    (Global::Nl, ["r", "", "r", "R"]),
    (Global::C, ["RW", "", "RW", ""]),
    (Global::opacity, ["RW", "", "RW", ""]),
    (Global::time, ["R", "R", "R", "R"]),
    (Global::dtime, ["R", "R", "R", "R"]),
    (Global::dPdtime, ["R", "R", "R", "R"]),
];

#[test]
fn globals_are_read_and_written_as_the_table_says() {
    assert_eq!(ACCESS.len(), Global::ALL.len());
    let kinds = [ShaderKind::Surface, ShaderKind::Displacement, ShaderKind::Volume, ShaderKind::Light];
    for (global, rules) in ACCESS {
        for (kind, rule) in kinds.iter().zip(rules) {
            let (word, ty) = (global.word(), global.value_type().word());
            let accepts = |body: &str| {
                let found = said(&format!("{} t (output {ty} r = 0) {{ {body} }}", kind.word()));
                assert!(found.is_empty() || found.contains(&format!("`{word}`")), "{body}: {found}");
                found.is_empty()
            };
            let read = format!("r = {word};");
            assert_eq!(accepts(&read), rule.contains('R'), "{} reads {word}", kind.word());
            for write in [format!("{word} = r;"), format!("void f (output {ty} x) {{ x = r; }} f ({word});")]
            {
                assert_eq!(accepts(&write), rule.contains('W'), "{}: {write}", kind.word());
            }
            if matches!(kind, ShaderKind::Surface | ShaderKind::Volume) {
                let inside = format!("lights (P) {{ r = {word}; }}");
                assert_eq!(accepts(&inside), !rule.is_empty(), "{}: {inside}", kind.word());
                let write = format!("lights (P) {{ {word} = r; }}");
                assert_eq!(accepts(&write), rule.contains('W'), "{}: {write}", kind.word());
            }
        }
    }
}

#[test]
fn parameters_are_read_only_without_output() {
    for body in [
        "k = 2;",
        "k += 1;",
        "k++;",
        "void f (output float x) { x = 1; } f (k);",
        "float x = getattribute (\"a\", k); C = x;",
    ] {
        assert!(about(body).contains("read-only"), "{body}");
    }
    assert!(said("surface t (color c = 0) { c[1] = 2; }").contains("read-only"));
    assert!(said("surface t (float a[2] = { 1, 2 }) { a[1] = 2; }").contains("read-only"));
    module(
        "surface t (output float k = 0, output color c = 0, output float a[2] = { 1, 2 }) { k++; c[1] = k; a[0] = 3; }",
    );
}

#[test]
fn defaults_and_metadata_are_compiled() {
    // Defaults are expressions of globals, functions and the parameters before them.
    module(
        "float f (float x) { return 2 * x; } surface t (float a = u, float b = f (a) + noise (P), point p = P, \
            float list[2] = { a, b }, color c = color (\"hsv\", a, 1, 1)) { C = a + b + p[0] + list[1] + c; }",
    );
    assert!(said("surface t (float a = b, float b = 1) { C = a + b; }").contains("unknown variable `b`"));
    // Metadata are constants of any type with any name.
    module(
        "surface t [[ string help = \"x\", float v = 1.5, color c = color (1, 2, 3), point p = 0, matrix m = 1 ]] \
            (float a[2] = { 1, 2 } [[ string Uitype = \"slider\" ]]) { C = a[0]; }",
    );
    for wrong in ["float v = u", "float v = noise (1)", "float v = \"x\"", "float v"] {
        let found = said(&format!("surface t [[ {wrong} ]] () {{ }}"));
        assert!(found.contains("error"), "{wrong}: {found}");
    }
}

#[test]
fn overloaded_functions_are_chosen_by_arguments_and_result() {
    // The function is chosen by the number, type and shape of arguments, and by the expected result.
    let functions = "float f (float x) { return 1; } float f (float x, float y) { return 2; } \
                     float f (color x) { return 3; } float f (string x) { return 4; } float f (float x[]) { return 5; } \
                     float g () { return 6; } color g () { return color (7, 8, 9); } point g () { return 10; }";
    module(&format!(
        "{functions} surface t () {{ C = f (1) + f (1, 2) + f (C) + f (\"x\") + g (); float a[2] = {{ 1, 2 }}; C += f (a); }}"
    ));
    for (call, expected) in [
        ("C = f (1, 2, 3);", "no form of `f` takes (float, float, float)"),
        ("matrix m = 1; C = f (m);", "no form of `f` takes (matrix)"),
        ("string s = g (); printf (s);", "cannot convert a `float` to `string`"),
    ] {
        let found = said(&format!("{functions} surface t () {{ {call} }}"));
        assert!(found.contains(expected), "{call}: {found}");
    }
    for (source, expected) in [
        ("float f (float a) { return 1; } float f (float b) { return 2; }", "declared twice"),
        ("float f (float a) { return 1; } float f (output float b) { return 2; }", "declared twice"),
        ("float f (float a) { return 1; } color f (float a) { return 2; }", ""),
        ("float f (vector a) { return 1; } float f (point a) { return 2; }", ""),
        ("float f (float a[2]) { return 1; } float f (float a[3]) { return 2; }", ""),
    ] {
        let found = said(&format!("{source} surface t () {{ C = 1; }}"));
        assert!(found.contains(expected) && found.is_empty() == expected.is_empty(), "{source}: {found}");
    }
    // An overload may call another one, but not itself.
    module(
        "float f (float x) { return x; } float f (color c) { return f (c[0]); } surface t () { C = f (C); }",
    );
    assert!(
        said(
            "float f (float x) { return x; } float f (color c) { return f (c); } surface t () { C = f (C); }"
        )
        .contains("calls itself")
    );
    // Functions of an inner scope hide those outside, as variables do.
    assert!(said("float f (float x) { return x; } surface t () { float f (string s) { return s == \"a\"; } C = f (1); }")
        .contains("cannot convert a `float` to `string`"));
    // A function with a built-in function's name is a further form of it.
    module("float noise (string x) { return x == \"a\"; } surface t () { C = noise (\"b\"); }");
}

#[test]
fn lighting_statements_are_allowed_in_their_shader_types_only() {
    for (source, ok) in [
        ("surface t () { lights (P) C = Cl; }", true),
        ("volume t () { lights (P) C = Cl; }", true),
        ("displacement t () { lights (P) P = 0; }", false),
        ("light t () { lights (P) Cl = 1; }", false),
        ("surface t () { emit (P) C = 1; }", false),
        ("volume t () { emit () C = 1; }", false),
        ("displacement t () { emit () P = 0; }", false),
        ("surface t () { trace (\"s\", P, N, 1, 1) C = 1; }", true),
        ("displacement t () { trace (\"s\", P, N, 1, 1) P += N; }", true),
        ("volume t () { trace (\"s\", P, I, 1, 1) C = 1; }", true),
        ("light t () { trace (\"s\", P, N, 1, 1) Cl = 1; }", true),
        (
            "surface t () { trace (\"s\", P, N, 1, 1) { trace (\"s\", P, N, 1, 1) C = 1; lights (P) C += Cl; } }",
            true,
        ),
        ("displacement t () { P += ambient ()[0]; }", false),
    ] {
        assert_eq!(said(source).is_empty(), ok, "{source}: {}", said(source));
    }
}

#[test]
fn templates_take_all_conversions_that_the_executor_prints() {
    // Every letter is accepted without a warning, and an array counts as its elements.
    let letters: String = granita_gsl::CONVERSIONS.chars().map(|c| format!("%{c} ")).collect();
    let values = ", 1".repeat(granita_gsl::CONVERSIONS.len());
    module(&format!(
        "surface t (float list[3] = {{ 1, 2, 3 }}, float open[] = {{ 1 }}) {{ printf (\"{letters}\"{values}); \
        printf (\"%f %f %f %s\", list, \"a\"); printf (\"%f %f\", open); }}"
    ));
}

#[test]
fn shadows_take_an_angle() {
    module(
        "light t () { emit (point (0, 0, 0)) { Cl = 1 - (color) shadow (\"set\", Ps, \"angle\", 0.1); } }",
    );
}
