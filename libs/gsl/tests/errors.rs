//! Tests the messages about errors, word by word.

mod common;
use common::{said, said_with};
use granita_gsl::{CompileOptions, compile};

/// The bodies of a surface shader (after line 1), and all messages about them.
const BODIES: &[(&str, &str)] = &[
    // Lexical.
    ("C = 1 @ 2;", "2:7: error: an unexpected character: `@`"),
    ("printf (\"abc);", "2:9: error: a string that is never closed: `\"abc);}`"),
    ("C = 1x;", "2:5: error: `1x` is not a number"),
    ("/* open", "2:1: error: a comment that is never closed: `/*`"),
    ("printf (\"\\q\");", "2:9: warning: unknown escape `\\q` in a string is kept as it is"),
    // Syntax.
    ("C = 1", "2:6: error: expected `;`, found `}`"),
    ("C = ;", "2:5: error: expected an expression, found `;`"),
    ("C = (1;", "2:7: error: expected `)`, found `;`"),
    ("if (1 C = 1;", "2:7: error: expected `)`, found `C`"),
    ("else C = 1;", "2:1: error: `else` without `if`"),
    ("do C = 1; until (1);", "2:11: error: expected `while`, found `until`"),
    ("for (C = 1, 2; 1; ) ;", "2:11: error: expected `;`, found `,`"),
    ("float if = 1;", "2:7: error: `if` is a keyword and cannot be a name"),
    ("float bool = 1;", "2:7: error: `bool` is reserved for future use and cannot be a name"),
    ("int i = 1;", "2:1: error: expected a type, found `int` [all numbers are `float`]"),
    (
        "uniform float i = 1;",
        "2:1: error: expected a type, found `uniform` [variables need no storage class; leave it out]",
    ),
    ("colour x = 1;", "2:1: error: expected a type, found `colour` [did you mean `color`?]"),
    ("void x;", "2:1: error: a variable cannot be `void`"),
    ("C = 5 % 2;", "2:7: error: there is no operator `%` [use `mod (a, b)`]"),
    (
        "C = color noise (P);",
        "2:5: error: expected an expression, found the type `color` [to cast, write `(color)`]",
    ),
    ("1 = 2;", "2:1: error: only a variable can be assigned to"),
    ("noise (1)++;", "2:10: error: `++` needs a variable"),
    ("C = normalize (N)[0];", "2:18: error: only a variable can have a subscript"),
    ("C = trace (1);", "2:5: error: `trace` is a statement, not an expression"),
    (
        "float f (float a = 1) { return a; } C = f (1);",
        "2:18: error: parameters of functions have no default",
    ),
    (
        "float f (float a; float b) { return a + b; } C = f (1, 2);",
        "2:17: error: parameters are separated by `,`",
    ),
    (
        "C = 1; } C = 2;",
        "2:10: error: expected the end of the file, found `C` [a `}` before it may be one too many]",
    ),
    (
        "C = ; opacity = ;",
        "2:5: error: expected an expression, found `;`\n2:17: error: expected an expression, found `;`",
    ),
    // Names.
    ("C = colr;", "2:5: error: unknown variable `colr`"),
    ("C = opacty;", "2:5: error: unknown variable `opacty` [did you mean `opacity`?]"),
    ("C = nose (P);", "2:5: error: unknown function `nose` [did you mean `noise`?]"),
    ("C = noise;", "2:5: error: `noise` is a function [write `noise (...)` to call it]"),
    ("PI = 3;", "2:1: error: `PI` is a constant"),
    (
        "float x = 1; C = x; float x = 2; C = x;",
        "2:27: error: `x` is declared twice in the same scope [it is declared at t.gsl:2:7 already]",
    ),
    (
        "float f () { return 1; } float f () { return 2; } C = f ();",
        "2:32: error: function `f` is declared twice in the same scope [functions of one name differ in their parameters or their result]",
    ),
    ("{ float x = 1; C = x; } opacity = x;", "2:35: error: unknown variable `x`"),
    // Types.
    ("C = \"x\";", "2:5: error: cannot convert a `string` to `color`"),
    ("C = N;", "2:5: error: cannot convert a `normal` to `color` [write `(color)` in front to mean that]"),
    ("float f = C; C = f;", "2:11: error: cannot convert a `color` to `float`"),
    ("C = C + N;", "2:7: error: `+` does not mix a `color` and a `normal` [cast one of them, as `(color)`]"),
    ("C = \"a\" + \"b\";", "2:9: error: `+` does not apply to a `string` and a `string`"),
    ("float f = C < 1; C = f;", "2:13: error: `<` does not apply to a `color` and a `float`"),
    ("float f = C == \"x\"; C = f;", "2:13: error: `==` does not apply to a `color` and a `string`"),
    ("matrix m = 1; m = m + m; C = m[0][0];", "2:21: error: `+` does not apply to a `matrix` and a `matrix`"),
    ("float f = (float) P; C = f;", "2:11: error: cannot cast a `point` to `float`"),
    ("C = (color) \"x\";", "2:5: error: cannot cast a `string` to `color`"),
    ("float f = 1; f *= C; C = f;", "2:16: error: `*=` does not apply to a `float` and a `color`"),
    ("C++;", "2:2: error: `++` and `--` need a `float` variable, not a `color`"),
    ("float a[2] = {1}; C = a;", "2:21: error: cannot assign an array `float[2]` to a `color`"),
    (
        "float a[2]; float b[3]; a = b; C = a[0] + b[0];",
        "2:27: error: cannot assign an array `float[3]` to an array `float[2]`",
    ),
    (
        "if (1) { float a[2] = { 1 }; if (a) C = 1; }",
        "2:34: error: an array `float[2]` cannot be a condition",
    ),
    ("C = color (1, 2);", "2:5: error: `color` takes 1 or 3 numbers, 2 given"),
    ("matrix m = matrix (1, 2); C = m[0][0];", "2:12: error: `matrix` takes 1 or 16 numbers, 2 given"),
    ("C = printf (\"x\");", "2:5: error: function `printf` returns no value"),
    // Arrays and subscripts.
    ("float a[0]; C = a[0];", "2:9: error: an array cannot have 0 elements\n2:"),
    ("float a[1.5]; C = a[0];", "2:9: error: an array cannot have 1.5 elements\n2:"),
    ("float a[99999]; C = a[0];", "2:9: error: an array of 99999 elements is too long: 65536 at most\n2:"),
    ("float a[u]; C = a[0];", "2:9: error: the length of an array must be a constant\n2:"),
    (
        "float a[] = { 1 }; C = a[0];",
        "2:8: error: an array variable needs a length [only parameters may be declared with `[]`]",
    ),
    (
        "float a[2] = 1; C = a[0];",
        "2:14: error: array `a` needs a list of values [write `= { value, value, ... }`]\n2:",
    ),
    ("float a[2] = { 1, 2, 3 }; C = a[0];", "2:14: error: 3 values for array `a` of 2 elements\n2:"),
    ("float a = { 1 }; C = a;", "2:11: error: `a` is not an array; it takes one value\n2:"),
    ("C = C[3];", "2:7: error: subscript 3 of a color is outside [0..2]"),
    ("float a[2]; a[0] = 1; C = a[2];", "2:29: error: subscript 2 of an array is outside [0..1]"),
    ("C = C[0][1];", "2:5: error: `C` is a `color` and has no such subscript"),
    ("float f = u[0]; C = f;", "2:11: error: `u` is a `float` and has no such subscript"),
    ("matrix m = 1; C = m[0][0]; C = m[0];", "2:32: error: a component of a matrix needs a row and a column"),
    // Calls.
    ("C = sin ();", "2:5: error: no form of `sin` takes () [it is one of sin (float)]"),
    ("C = sin (P);", "2:5: error: no form of `sin` takes (point) [it is one of sin (float)]"),
    (
        "C = distance (P, \"x\");",
        "2:5: error: no form of `distance` takes (point, string) [it is one of distance (point, point); distance (point, point, point)]",
    ),
    (
        "C = texture (\"x\", u, v, \"blr\", 1);",
        "2:25: warning: `texture` has no option \"blr\" [did you mean `blur`?]",
    ),
    ("C = texture (\"x\", u, v, \"blur\", \"1\");", "2:33: error: cannot convert a `string` to `float`"),
    ("C = texture (\"x\", u, v, \"blur\");", "2:5: error: an optional argument of `texture` has no value"),
    (
        "C = texture (\"x\", u, v, \"alpha\", 1);",
        "2:34: error: the function writes this argument, so it must be a variable",
    ),
    ("C = texture (\"x\", u, v, \"alpha\", u);", "2:34: error: a surface shader cannot change `u`"),
    (
        "float f; fresnel (I, N, 1, f, f, N, C);",
        "2:37: error: the function writes a `vector` here, which a `color` cannot hold",
    ),
    ("printf (\"%f %f\\n\", u);", "2:9: warning: the template prints 2 values, 1 given"),
    ("printf (\"%y\\n\", u);", "2:9: warning: the template has the unknown conversion `%y`"),
    ("exit (1);", "2:1: error: `exit` takes no arguments"),
    ("lights (1, 2) ;", "2:9: error: cannot convert a `float` to `string`"),
    (
        "lights () ;",
        "2:1: error: `lights` has no form with 0 arguments [it is one of lights (point), lights (point, vector, float), lights (string, point), lights (string, point, vector, float)]",
    ),
    (
        "trace (\"x\", P) ;",
        "2:1: error: `trace` has no form with 2 arguments [it is one of trace (string, point, vector, float, float)]",
    ),
    // Functions.
    (
        "float f (float x) { return f (x); } C = f (1);",
        "2:28: error: function `f` calls itself; recursion is not allowed",
    ),
    ("float f (float x) { return x; } C = f ();", "2:37: error: function `f` takes 1 argument, 0 given"),
    ("float f (float x) { return \"a\"; } C = f (1);", "2:28: error: cannot convert a `string` to `float`"),
    ("float f () { return; } C = f ();", "2:14: error: function `f` must return a value of type `float`"),
    ("void f () { return 1; } f ();", "2:20: error: function `f` is `void` and returns no value"),
    ("float f () { } C = f ();", "2:7: warning: function `f` never returns a value"),
    (
        "void f (output float x) { x = 1; } f (2);",
        "2:39: error: the function writes this argument, so it must be a variable",
    ),
    (
        "void f (output color x) { x = 1; } float y; f (y); C = y;",
        "2:48: error: the function writes a `color` here, which a `float` cannot hold",
    ),
    (
        "void f (float x[2]) { x[0] = 1; } float y[3]; f (y); C = y[0];",
        "2:50: error: parameter `x` of `f` is an array `float[2]`, an array `float[3]` given",
    ),
    (
        "void f (float x) { x = 1; } f (k);",
        "2:32: error: parameter `k` is read-only [declare it `output float k` to change it]",
    ),
    ("return 1;", "2:8: error: a shader returns no value"),
    // The permissions of a surface shader.
    ("k = 2;", "2:1: error: parameter `k` is read-only [declare it `output float k` to change it]"),
    ("P = 0;", "2:1: error: a surface shader cannot change `P`"),
    ("C = Cl;", "2:5: error: `Cl` can be read in a `lights` loop only"),
    ("C = Ps[0];", "2:5: error: there is no `Ps` in a surface shader"),
    ("displace (1);", "2:1: error: a surface shader cannot change `P`"),
    ("emit () C = 1;", "2:1: error: `emit` is for light shaders"),
    ("break;", "2:1: error: `break` is not in a loop"),
    (
        "while (u) { lights (P) { break; } }",
        "2:26: error: `break` is not in a loop [`lights`, `emit` and `trace` cannot be left early]",
    ),
    // Warnings.
    ("float x; C = 1;", "2:7: warning: variable `x` is never used"),
    ("float x = 1; C = 1;", "2:7: warning: variable `x` is set but never used"),
    ("float x; C = x;", "2:14: warning: variable `x` is used before it is given a value"),
    ("float x; while (u) { C = x; }", "2:7: warning: variable `x` is never given a value"),
    ("float x; while (u) { C = x; x = 1; }", ""),
    ("float x; if (u) x = 1; C = x;", ""),
    ("u + 1;", "2:3: warning: this statement does nothing"),
];

#[test]
fn errors_in_bodies_have_their_message_and_place() {
    let mut wrong = String::new();
    for (body, expected) in BODIES {
        let found = said(&format!("surface t (float k = 1) {{\n{body}}}"));
        // An expectation that ends in a colon and a blank (or a line number) is the beginning of the messages.
        let fits = found == *expected || (!expected.is_empty() && found.starts_with(expected));
        if !fits {
            wrong += &format!("{body}\n  found    {found}\n  expected {expected}\n");
        }
    }
    assert!(wrong.is_empty(), "{wrong}");
}

#[test]
fn errors_in_files_have_their_message_and_place() {
    for (source, expected) in [
        ("", "1:1: error: there is no shader in this file"),
        ("float f () { return 1; }", "1:25: error: there is no shader in this file"),
        (
            "surfce t () { }",
            "1:1: error: expected a shader type or a function declaration, found `surfce` [did you mean `surface`?]",
        ),
        ("surface t () { } surface q () { }", "1:18: error: a file holds one shader"),
        ("surface t () { } void f () { }", "1:18: error: functions are declared before the shader"),
        ("surface t () {", "1:14: error: this `{` is never closed"),
        ("surface t (float a) { }", "1:18: error: parameter `a` needs a default value"),
        ("surface t (a = 1) { }", "1:12: error: expected a type, found `a`"),
        ("surface t (float a = 1; float b = 2) { }", "1:23: error: parameters are separated by `,`"),
        (
            "surface t (float a = 1, float a = 2) { }",
            "1:31: error: `a` is declared twice in the same scope [it is declared at t.gsl:1:18 already]",
        ),
        ("surface t (float a[2] = { \"x\" }) { }", "1:27: error: cannot convert a `string` to `float`"),
        (
            "surface t (float a = 1 [[ float b = u ]]) { }",
            "1:37: error: the value of a metadatum must be a constant",
        ),
        ("surface t [[ float b = 1, float b = 2 ]] () { }", "1:33: error: metadatum `b` is given twice"),
        ("surface t [[ float b 1 ]] () { }", "1:22: error: expected `=`, found `1`"),
        ("surface t (color c = Cl) { }", "1:22: error: `Cl` can be read in a `lights` loop only"),
        ("light t () { C = 1; }", "1:14: error: a light shader cannot change `C`"),
        ("light t () { Cl = opacity; }", "1:19: error: there is no `opacity` in a light shader"),
        ("light t () { lights (P) Cl = 1; }", "1:14: error: there can be no `lights` in a light shader"),
        (
            "light t () { Cl = diffuse (N); }",
            "1:19: error: `diffuse` gathers light, which a light shader cannot",
        ),
        ("light t () { P = 1; }", "1:14: error: a light shader cannot change `P`"),
        ("light t () { emit (P) { emit (P) Cl = 1; } }", "1:25: error: `emit` is inside of `emit`"),
        ("displacement t () { P += N * Cl[0]; }", "1:30: error: there is no `Cl` in a displacement shader"),
        ("displacement t () { C = 1; }", "1:21: error: a displacement shader cannot change `C`"),
        (
            "displacement t () { opacity *= 2; }",
            "1:21: error: a displacement shader cannot change `opacity`\n1:21: error: there is no `opacity` in a displacement shader",
        ),
        ("volume t () { N = 1; }", "1:15: error: a volume shader cannot change `N`"),
        ("shader t () { u = 1; }", "1:15: error: a generic shader cannot change `u`"),
        // The call makes the function invalid, and the error is reported once.
        (
            "void f () { P = 1; } surface t () { f (); f (); }",
            "1:13: error: a surface shader cannot change `P`",
        ),
        ("void f () { P = 1; } surface t () { }", ""),
        ("color f () { return Cl; } surface t () { lights (P) C += f (); }", ""),
    ] {
        assert_eq!(said(source), expected, "{source}");
    }
}

#[test]
fn errors_are_printed_with_the_source_line_and_a_suggestion() {
    let source = "surface t ()\n{\n\tC = opacty * 2;\n}\n";
    let list = compile(source, "dir/t.gsl", &CompileOptions::default()).unwrap_err();
    assert_eq!(
        list[0].to_string(),
        "dir/t.gsl:3:6: error: unknown variable `opacty`\n    \tC = opacty * 2;\n    \t    ^\n    did you mean `opacity`?"
    );
}

#[test]
fn errors_beyond_the_limit_are_counted() {
    let body: String = (0..40).map(|i| format!("C = x{i};\n")).collect();
    let found = said(&format!("surface t () {{\n{body}}}"));
    assert_eq!(found.lines().count(), 26);
    assert!(found.ends_with("0:0: error: too many errors: 15 more are not shown"), "{found}");
}

fn with_files(source: &str, files: &[(&str, &str)]) -> String {
    let load = |path: &str| Ok(files.iter().find(|(n, _)| *n == path).map(|(_, t)| (*t).to_owned()));
    let paths = ["inc".to_owned()];
    let defines = [("ONE".to_owned(), None), ("TWO".to_owned(), Some("2".to_owned()))];
    let options = CompileOptions {
        loader: Some(&load),
        include_paths: &paths,
        defines: &defines,
        ..CompileOptions::default()
    };
    said_with(source, &options)
}

#[test]
fn the_preprocessor_chooses_lines_and_reports_errors() {
    for (source, expected) in [
        (
            "#if GELATO && ONE == 1 && TWO == 2 && defined (ONE) && defined TWO && !defined NO\nsurface t () { }\n#else\nno\n#endif",
            "",
        ),
        ("#ifdef NO\nbad'\n#elif 0\nworse\n#elif 1\nsurface t () { }\n#elif 1\nno\n#else\nno\n#endif\n", ""),
        ("#ifndef NO\n#if 0\n#else\nsurface t () { }\n#endif\n#endif\n", ""),
        (
            "#define V 3\n#define F(a, b) (a + b * V)\nsurface t () { C = F (1, (2, 3)); }",
            "3:28: error: expected `)`, found `,`",
        ),
        ("#define V 3\n#define F(a, b) (a + b * V)\nsurface t () { C = F (1, F (2, V)); }", ""),
        (
            "#define CAT(a, b) a ## b\n#define STR(x) #x\nsurface t () { CAT (C, ) = CAT (op, acity); printf (STR (a \"b\" + c\\n)); }",
            "",
        ),
        ("#define A B\n#define B A\nsurface t () { float A = 1; C = A; }", ""),
        ("#define f(x) x\nsurface t () { float f = f (2); C = f; }", ""),
        ("#define LOG(t, ...) printf (t, __VA_ARGS__)\nsurface t () { LOG (\"%f %f\", u, v); }", ""),
        ("#define LONG 1 + \\\n  2\nsurface t () { C = LONG; }", ""),
        ("#define X 1\n#undef X\n#ifdef X\nno\n#endif\nsurface t () { }", ""),
        ("surface t () { printf (\"%s %f\", __FILE__, __LINE__); }", ""),
        ("#line 100 \"other.gsl\"\nsurface t () { C = x; }", "100:20: error: unknown variable `x`"),
        ("# 7 \"a.h\" 1\nsurface t () { C = x; }", "7:20: error: unknown variable `x`"),
        ("#include \"a.h\"\nsurface t () { C = two (); }", ""),
        ("#include <b.h>\nsurface t () { C = B; }", ""),
        ("#include \"sub/c.h\"\nsurface t () { C = D; }", ""),
        ("#define H <b.h>\n#include H\nsurface t () { C = B; }", ""),
        ("#include \"e.h\"\nsurface t () { C = 1; }", "1:25: error: unknown variable `nothing`"),
        (
            "#include \"none.h\"\nsurface t () { }",
            "1:2: error: cannot find \"none.h\" [looked in inc, the current folder]",
        ),
        ("#include \"self.h\"\nsurface t () { }", "1:2: error: files are included more than 64 deep"),
        ("#include\nsurface t () { }", "1:2: error: `#include` needs \"file\" or <file>"),
        ("#if 1\nsurface t () { }", "1:2: error: this condition has no `#endif`"),
        ("#endif\nsurface t () { }", "1:2: error: `#endif` without `#if`"),
        ("#else\nsurface t () { }", "1:2: error: `#else` without `#if`"),
        ("#if 0\n#else\n#else\n#endif\nsurface t () { }", "3:2: error: `#else` after `#else`"),
        ("#if 1 +\n#endif\nsurface t () { }", "1:2: error: in `#if`: the expression ends too early"),
        ("#if 1 / 0\n#endif\nsurface t () { }", "1:7: error: in `#if`: division by zero"),
        ("#error no more\nsurface t () { }", "1:2: error: no more"),
        ("#warning hm\nsurface t () { }", "1:2: warning: hm"),
        ("#pragma once\nsurface t () { }", ""),
        (
            "#inclde \"x\"\nsurface t () { }",
            "1:1: error: unknown directive `#inclde` [did you mean `include`?]",
        ),
        ("#define\nsurface t () { }", "1:2: error: `#define` needs a name"),
        ("#define F(1) 2\nsurface t () { }", "1:9: error: the parameters of macro `F` are not names"),
        (
            "#define F(a) a\nsurface t () { C = F (1, 2); }",
            "2:20: error: macro `F` takes 1 argument, 2 given",
        ),
        ("#define F(a) a\nsurface t () { C = F (1; }", "2:20: error: the call of macro `F` has no `)`"),
        (
            "#define X 1\n#define X 2\nsurface t () { C = X; }",
            "2:9: warning: macro `X` is defined again, differently",
        ),
        ("#define X ## 1\nsurface t () { }", "1:9: error: `##` needs a token on both sides"),
        (
            "#define C(a, b) a ## b\nsurface t () { float x = C (+, 1); }",
            "2:29: error: `##` makes `+1`, which is not one token",
        ),
        ("surface t () { // comment \\\n continues } }\n}", ""),
    ] {
        let found = with_files(
            source,
            &[
                ("a.h", "float two () { return 2; }\n"),
                ("inc/b.h", "#define B 3\n"),
                ("sub/c.h", "#include \"d.h\"\n"),
                ("sub/d.h", "#define D 4\n"),
                ("e.h", "float f () { return 1 + nothing; }\n"),
                ("self.h", "#include \"self.h\"\n"),
            ],
        );
        let fits = found == expected || (expected.ends_with(": ") && found.starts_with(expected));
        assert!(fits, "{source}\n  found    {found}\n  expected {expected}");
    }
}
