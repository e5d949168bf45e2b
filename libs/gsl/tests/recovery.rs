//! Tests that all errors of a source are reported in one run, and that parts which cannot be parsed cause no further
//! messages.

mod common;
use common::said;
use granita_base::Severity;
use granita_gsl::{CompileOptions, Diagnostic, compile};

/// Declarations and loops in the style of other languages, between errors of types and names.
const DECLARATIONS: &str = r#"// A missing type, unknown names, a wrong conversion.
float wave (float x, amount) { return sin (x) * amount; }
color tint (color c; float k) {
    colour d = c * k;
    d += unknownthing;
    return d;
}
surface several (float Kd = 0.5, Ks = 1, string name = "a") {
    int i = 0;
    for (int j = 0; j < 4; ++j) {
        C += tint (C, j) * nosuch;
        i += 1;
    }
    float a = wave (u, 2);
    float b = ;
    float c = b + P;
    normal n = C
    if (Kd > ) {
        C = missing1;
    } else {
        C = missing2;
    }
    opacity = "x";
    while (a {
        a -= 1;
    }
    C = a % 2;
    C *= diffuse (N) + badfunction (3;
    C = Nn;
}
"#;

/// A `}` too many.
const BRACES: &str = r#"surface extra () {
    float x = 1;
    if (x > 0) { C = 1; } }
    float y = 2;
    C = y * x;
    lights (P) { C += Cl; }
    opacity = 1;
}
float after (float z) { return zz; }
"#;

/// Text that is not a token, calls without their ends, and a block without its end.
const CUT_OFF: &str = r#"helper (float a) { return a; }
float good (float a) { return q; }
surface c (float a = 1 float b = 2) {
    C = helper (a) * b;
    printf ("unclosed %f\n, a);
    C = good (1, 2);
    float s = 1 @ 2;
    C *= s;
    lights (P, 1 {
        C += Cl * L;
    }
    lights (P; 3) {
        C += Cl * wrong;
    }
    return 1;
"#;

/// Wrong parameters and conditions.
const PARAMETERS: &str = r#"surface d (float a[2] = { 1, 2 }, color = 3) {
    float f (float v) { v = ; }
    float sum = a[0] + a[5];
    float unused = 3;
    float only = 3 4;
    sum += only;
    if (u > 0.5 C = 1;
    else C = 0;
    do { sum += 1; } while (sum < 3)
    C = f (sum);
    vector w = noise (P) * N;
    C = w;
}
"#;

#[test]
fn all_errors_of_a_source_are_reported_in_order_without_others() {
    let sources = [
        (
            DECLARATIONS,
            &[
                "2:22: error: expected a type, found `amount`",
                "3:20: error: parameters are separated by `,`",
                "4:5: error: expected a type, found `colour` [did you mean `color`?]",
                "5:10: error: unknown variable `unknownthing`",
                "8:34: error: expected a type, found `Ks`",
                "9:5: error: expected a type, found `int` [all numbers are `float`]",
                "10:10: error: expected a type, found `int` [all numbers are `float`]",
                "11:28: error: unknown variable `nosuch`",
                "15:15: error: expected an expression, found `;`",
                "16:17: error: cannot convert a `point` to `float`",
                "17:12: warning: variable `n` is set but never used",
                "17:16: error: cannot convert a `color` to `normal` [write `(normal)` in front to mean that]",
                "18:5: error: expected `;`, found `if`",
                "18:14: error: expected an expression, found `)`",
                "19:13: error: unknown variable `missing1`",
                "21:13: error: unknown variable `missing2`",
                "23:15: error: cannot convert a `string` to `color`",
                "24:14: error: expected `)`, found `{`",
                "27:11: error: there is no operator `%` [use `mod (a, b)`]",
                "28:38: error: expected `,` or `)`, found `;`",
                "29:9: error: unknown variable `Nn` [did you mean `Ng`?]",
            ][..],
        ),
        (
            BRACES,
            &[
                "4:5: error: expected the end of the file, found `float` [a `}` before it may be one too many]",
                "9:32: error: unknown variable `zz`",
            ][..],
        ),
        (
            CUT_OFF,
            &[
                "1:1: error: expected a shader type or a function declaration, found `helper`",
                "2:31: error: unknown variable `q`",
                "3:24: error: expected `,` or `)`, found `float`",
                "3:37: error: this `{` is never closed",
                r#"5:13: error: a string that is never closed: `"unclosed %f\n, a);`"#,
                "6:9: error: function `good` takes 1 argument, 2 given",
                "7:17: error: an unexpected character: `@`",
                "9:18: error: expected `,` or `)`, found `{`",
                "12:14: error: expected `,` or `)`, found `;`",
                "13:19: error: unknown variable `wrong`",
            ][..],
        ),
        (
            PARAMETERS,
            &[
                "1:41: error: expected the name of a parameter, found `=`",
                "2:29: error: expected an expression, found `;`",
                "3:26: error: subscript 5 of an array is outside [0..1]",
                "4:11: warning: variable `unused` is set but never used",
                "5:20: error: expected `;`, found `4`",
                "7:17: error: expected `)`, found `C`",
                "10:5: error: expected `;`, found `C`",
                "12:9: error: cannot convert a `vector` to `color` [write `(color)` in front to mean that]",
            ][..],
        ),
    ];
    for (source, expected) in sources {
        assert_eq!(said(source).lines().collect::<Vec<_>>(), expected, "{source}");
    }
}

/// Returns the errors and warnings about a source.
fn messages(source: &str) -> Vec<Diagnostic> {
    match compile(source, "t.gsl", &CompileOptions::default()) {
        Ok(compiled) => compiled.warnings,
        Err(list) => list,
    }
}

/// Returns the begin and the end of each token in which a typing error is made: punctuation and types, outside of
/// comments.
fn tokens(source: &str) -> Vec<(usize, usize)> {
    let mut list = Vec::new();
    let mut at = 0;
    while let Some(first) = source[at..].chars().next() {
        let rest = &source[at..];
        if rest.starts_with("//") || rest.starts_with("/*") {
            let end = if rest.starts_with("//") { "\n" } else { "*/" };
            at += rest[2..].find(end).map_or(rest.len(), |n| n + 2 + end.len());
            continue;
        }
        let is_word = |c: char| c.is_alphanumeric() || c == '_';
        let length = match is_word(first) {
            true => rest.find(|c| !is_word(c)).unwrap_or(rest.len()),
            false => first.len_utf8(),
        };
        let types = ["float", "color", "vector", "point", "normal", "string"];
        if types.contains(&&rest[..length]) || "(){};,=\"".contains(first) {
            list.push((at, at + length));
        }
        at += length;
    }
    list
}

/// Whatever mark or type is left out of a shader, and whatever type is misspelt, causes one or two errors.
#[test]
fn one_typing_error_causes_few_messages() {
    let (mut tries, mut single) = (0, 0);
    for name in granita_bundled::shader_names() {
        let source = granita_bundled::shader(name).unwrap();
        for (begin, end) in tokens(source) {
            let is_type = end > begin + 1;
            for new in
                [String::new(), format!("{}e", &source[begin..end])].iter().take(1 + usize::from(is_type))
            {
                let changed = format!("{}{new}{}", &source[..begin], &source[end..]);
                let list = messages(&changed);
                let errors = list.iter().filter(|d| d.severity == Severity::Error).count();
                if errors == 0 {
                    continue;
                }
                (tries, single) = (tries + 1, single + usize::from(list.len() == 1));
                let line = source[..begin].lines().count();
                let shown: Vec<String> = list.iter().map(ToString::to_string).collect();
                assert!(list.len() <= 4, "{name}:{line}: {new:?}\n{}", shown.join("\n"));
            }
        }
    }
    // Without its type, a declaration is an assignment to a name of the language or of another scope.
    assert!(tries > 8000 && single * 100 > tries * 85, "{single} of {tries}");
}

#[test]
fn errors_of_both_kinds_are_bounded_and_in_order() {
    let lines: Vec<String> = (0..30).map(|i| format!("C = x{i};\nC = ;\n")).collect();
    let found = said(&format!("surface t () {{\n{}}}", lines.concat()));
    let found: Vec<&str> = found.lines().collect();
    assert_eq!(found.len(), 26);
    assert_eq!(found[0], "2:5: error: unknown variable `x0`");
    assert_eq!(found[1], "3:5: error: expected an expression, found `;`");
    assert_eq!(found[24], "26:5: error: unknown variable `x12`");
    assert!(found[25].starts_with("0:0: error: too many errors: "), "{}", found[25]);
}

#[test]
fn an_unknown_name_is_reported_once_in_a_function() {
    let source = "float f () { return missing + missing; } surface t () { C = missing * missing; opacity = missing; C *= f (); }";
    assert_eq!(
        said(source),
        "1:21: error: unknown variable `missing`\n1:61: error: unknown variable `missing`"
    );
}
