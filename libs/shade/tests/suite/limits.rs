//! Tests of shaders that would use all memory, or never end.

use crate::fixture::*;
use granita_base::Params;
use granita_gsl::ir::ValueType;

/// Returns the value of `r` in the first lane, and the errors that were reported.
fn limited(body: &str) -> (f32, Vec<String>) {
    let source = format!("surface t (output float r = 0) {{\n{body}\n}}");
    let group = link(&[(&source, Params::new())], &[]);
    let mut services = Double::default();
    // Each error is reported once for any number of grids.
    for _ in 0..2 {
        output(&group, &mut square(3, 2), &mut services, "r", ValueType::Float);
    }
    let r = output(&group, &mut square(3, 2), &mut services, "r", ValueType::Float);
    (r[0], services.errors().into_iter().map(str::to_owned).collect())
}

#[test]
fn strings_are_cut_at_the_limit_with_a_message() {
    let cut = "test.gsl:3: shader \"t\": a string is cut after 65536 bytes";
    for doubled in ["concat (s, s)", "format (\"%s%s\", s, s)", "format (\"%s and %50s\", s, s)"] {
        for start in ["\"seed\"", "format (\"%g\", u + 10)"] {
            let body = format!(
                "string s = {start}; for (float k = 0; k < 100; ++k)\n s = {doubled};\n r = match (\"^[1s]\", s);"
            );
            assert_eq!(limited(&body), (1.0, vec![cut.to_owned()]), "{doubled} {start}");
        }
    }
    // There is one call with many arguments.
    let body = format!(
        "string s = \"x\"; for (float k = 0; k < 16; ++k) s = concat (s, s);\n s = concat (s{});",
        ", s".repeat(20_000)
    );
    assert_eq!(limited(&body).1, [cut]);
    // A string that fits is complete.
    let body = "string s = \"12345678\"; for (float k = 0; k < 13; ++k) s = concat (s, s); \
                r = match (\"^(12345678)*$\", s) + match (\"8$\", s);";
    assert_eq!(limited(body), (2.0, vec![]));
}

#[test]
fn the_memory_for_all_strings_of_a_run_is_limited() {
    let body = "string s = \"x\"; for (float k = 0; k < 15; ++k) s = concat (s, s);
        string t = \"\"; for (float k = 0; k < 5000; ++k)
            t = format (\"%g %s\", k, s);
        r = t == \"\";";
    let full = "test.gsl:4: shader \"t\": its strings take more than 64 MiB at once; further ones are empty";
    assert_eq!(limited(body), (1.0, vec![full.to_owned()]));
}

#[test]
fn long_patterns_are_refused_and_matching_takes_linear_time() {
    let body = "string s = \"[[:\"; for (float k = 0; k < 11; ++k) s = concat (s, s);
        r = match (s, \"a\");
        s = concat (s, \"a\");
        r = match (concat (s, s), \"a\");";
    let (_, said) = limited(body);
    assert_eq!(said.len(), 2, "{said:?}");
    assert!(said.iter().all(|text| text.contains("is longer than 4096")), "{said:?}");
    // The time does not grow faster than the text.
    let body = "string s = \"aaaaaaaa\"; for (float k = 0; k < 12; ++k) s = concat (s, s);
        r = match (\"(a*)*(a|aa)*(a|a?)+b\", s);";
    assert_eq!(limited(body), (0.0, vec![]));
}

#[test]
fn endless_loops_end_when_the_frame_is_stopped() {
    let source = "surface t (output float r = 0) { while (1) { r += 1; while (1) r += 1; } }";
    let group = link(&[(source, Params::new())], &[]);
    let mut services = Double { is_stopped: true, ..Double::default() };
    let r = output(&group, &mut square(2, 1), &mut services, "r", ValueType::Float);
    // Both loops regularly check whether the frame must end.
    assert!(r[0] > 1e3 && r[0] < 1e6, "{}", r[0]);
    assert_eq!(services.errors(), Vec::<&str>::new());
}

#[test]
fn loops_beyond_the_limit_end_the_shader_for_their_lanes() {
    // Lanes outside the loop continue. Those in it end, also in the loops around it.
    let body = "r = 1; if (u < 0.2)
        while (1)
            while (u < 0.2) r += 1;
        r = 2;";
    let source = format!("surface t (output float r = 0) {{\n{body}\n}}");
    let group = link(&[(&source, Params::new())], &[]);
    let mut services = Double::default();
    let r = output(&group, &mut square(3, 1), &mut services, "r", ValueType::Float);
    assert_eq!(r, [4194306.0, 2.0, 2.0]);
    let text =
        "test.gsl:4: shader \"t\": a loop does not end after 4194304 iterations; the shader ends there";
    assert_eq!(services.errors(), [text]);
}
