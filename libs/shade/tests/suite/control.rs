//! Tests of masks, which select the lanes that run.

use crate::fixture::*;

/// In these tests u is 0, 0.5, 1 in both rows.
#[test]
fn nested_conditions_choose_per_lane() {
    assert_eq!(floats("if (u < 0.7) { if (u > 0.2) r = 1; else r = 2; } else r = 3;")[..3], [2.0, 1.0, 3.0]);
    assert_eq!(floats("r = 0; if (u > 5) r = 1;"), [0.0; 6]);
    assert_eq!(floats("float a = 4; if (u > 0.2) a = 5; if (u > 0.7) a += 1; r = a;")[..3], [4.0, 5.0, 6.0]);
}

#[test]
fn uniform_values_written_in_some_lanes_are_promoted() {
    let body = "float a = 1; color c = 2; string s = \"x\"; \
                if (u > 0.2) { a = 10; c = 20; s = \"yy\"; } \
                r = a + c[1] + (s == \"yy\" ? 100 : 0);";
    assert_eq!(floats(body)[..3], [3.0, 130.0, 130.0]);
    // ... and become uniform again when written everywhere.
    assert_eq!(floats("float a = 1; if (u > 0.2) a = 10; a = 3; r = a;"), [3.0; 6]);
}

#[test]
fn both_branches_of_a_choice_keep_their_values() {
    assert_eq!(floats("r = u < 0.2 ? 1 : u < 0.7 ? 2 : 3;")[..3], [1.0, 2.0, 3.0]);
    assert_eq!(floats("float k = 0; r = (u > 0.2 && ++k > 0) + 10 * k;")[..3], [0.0, 11.0, 11.0]);
}

#[test]
fn loops_run_until_each_lane_is_done() {
    assert_eq!(floats("r = 0; while (r < u * 4) r += 1;")[..3], [0.0, 2.0, 4.0]);
    assert_eq!(floats("r = 0; do r += 1; while (r < u * 4);")[..3], [1.0, 2.0, 4.0]);
    assert_eq!(
        floats("r = 0; for (float k = 0; k < 4; ++k) { if (k > u * 4) break; r += 1; }")[..3],
        [1.0, 3.0, 4.0]
    );
    assert_eq!(
        floats("r = 0; for (float k = 0; k < 4; ++k) { if (k == u * 4) continue; r += 1; }")[..3],
        [3.0, 3.0, 4.0]
    );
    let nested = "r = 0; for (float i = 0; i < 3; ++i) { \
                    for (float j = 0; j < 3; ++j) { if (j > u * 2) break; if (i == 1) continue; r += 1; } \
                    if (u > 0.7 && i == 1) break; r += 10; }";
    assert_eq!(floats(nested)[..3], [32.0, 34.0, 13.0]);
}

#[test]
fn functions_return_values_per_lane() {
    let f = |body: &str, call: &str| {
        let source =
            format!("float f (float x) {{ {body} }} surface t (output float r = -1) {{ r = {call}; }}");
        let group = link(&[(&source, granita_base::Params::new())], &[]);
        output(&group, &mut square(3, 2), &mut Double::default(), "r", granita_gsl::ir::ValueType::Float)
    };
    assert_eq!(
        f("if (x < 0.2) return 1; if (x < 0.7) return 2; return 3;", "f (u) * 10")[..3],
        [10.0, 20.0, 30.0]
    );
    // Lanes return at different iterations, with values that were uniform at that time.
    assert_eq!(
        f("for (float k = 0; k < 9; ++k) { if (k >= x * 4) return k; } return -1;", "f (u) + f (1 - u) * 10")
            [..3],
        [40.0, 22.0, 4.0]
    );
    assert_eq!(f("while (1 < 2) { if (x < 0.7) break; return 7; } return 8;", "f (u)")[..3], [8.0, 8.0, 7.0]);
}

#[test]
fn exit_ends_the_shader_for_its_lanes() {
    assert_eq!(floats("r = 1; if (u > 0.7) exit (); r = 2;")[..3], [2.0, 2.0, 1.0]);
    assert_eq!(
        floats("r = 1; for (float k = 0; k < 3; ++k) { if (k == u * 2) exit (); r += 1; } r = 9;"),
        [1.0, 2.0, 3.0, 1.0, 2.0, 3.0]
    );
    assert_eq!(floats("r = 1; if (u > 0.2) return; r = 2;")[..3], [2.0, 1.0, 1.0]);
    assert_eq!(floats("r = 4; exit (); r = 5;"), [4.0; 6]);
}

#[test]
fn components_and_elements_are_set_per_lane() {
    assert_eq!(
        floats("color c = 0; c[u * 2] = 5; r = c[0] + 10 * c[1] + 100 * c[2];")[..3],
        [5.0, 50.0, 500.0]
    );
    assert_eq!(floats("color c = 0; if (u > 0.2) c[1] = 5; r = c[1];")[..3], [0.0, 5.0, 5.0]);
    assert_eq!(
        floats("matrix m = 1; m[3][u * 2] = 7; r = m[3][0] + 10 * m[3][1] + 100 * m[3][2];")[..3],
        [7.0, 70.0, 700.0]
    );
    assert_eq!(
        floats("float a[3] = {1, 2, 3}; a[u * 2] = 5; r = a[0] + 10 * a[1] + 100 * a[2];")[..3],
        [325.0, 351.0, 521.0]
    );
    assert_eq!(
        floats("color a[2] = {1, 2}; a[1][2] = u; r = a[1][2] + 10 * a[1][0] + 100 * a[0][0];")[..3],
        [120.0, 120.5, 121.0]
    );
    assert_eq!(
        floats("float a[3] = {1, 2, 3}; if (u > 0.2) a[0] = 9; r = a[2 - u * 2];")[..3],
        [3.0, 2.0, 9.0]
    );
}

#[test]
fn variables_are_not_shared_by_lanes_across_loops() {
    // The variable is written once in the source, and read in the same block. Lanes that have left the loop neither
    // keep nor need its value.
    let body = "r = 0; for (float k = 0; k < 3; ++k) { float t = k * 10; if (k > u * 2) break; r = t; }";
    assert_eq!(floats(body)[..3], [0.0, 10.0, 20.0]);
}

#[test]
fn an_empty_grid_is_shaded_without_effect() {
    let group = link(&[("surface t () { C = P[0]; }", granita_base::Params::new())], &[]);
    let mut grid = granita_shade::Grid::new(granita_shade::Topology::Scattered { n: 0 });
    let out = granita_shade::Executor::new().run(&group, &mut grid, &mut Double::default(), &[]);
    assert!(out.is_empty());
}

/// Long chains are flat. Neither linking nor running them needs stack or much time.
#[test]
fn long_chains_of_conditions_choose_correctly() {
    let n = 2000;
    let arms: Vec<String> = (0..n).map(|k| format!("if (u * {n} <= {k}) r = {k};")).collect();
    let half = (n / 2) as f32;
    assert_eq!(floats(&format!("{} else r = -1;", arms.join(" else ")))[..3], [0.0, half, -1.0]);
    let choice: Vec<String> = (0..n).map(|k| format!("u * {n} <= {k} ? {k} : ")).collect();
    assert_eq!(floats(&format!("r = {}-1;", choice.concat()))[..3], [0.0, half, -1.0]);
    // The arms are in a loop that they leave or continue, and in a function from which they return.
    let arms: Vec<String> = (0..20).map(|k| format!("if (i + u * 4 == {k}) r += {k};")).collect();
    let body = format!(
        "r = 0; for (float i = 0; i < 9; ++i) {{ if (i == 2) continue; else if (i > 4 + u) break; else {} }}",
        arms.join(" else ")
    );
    assert_eq!(floats(&body)[..3], [8.0, 0.0 + 2.0 + 3.0 + 5.0 + 6.0, 4.0 + 5.0 + 7.0 + 8.0 + 9.0]);
    let arms: Vec<String> = (0..20).map(|k| format!("if (x * 4 == {k}) return {k} + 1;")).collect();
    let source = format!(
        "float f (float x) {{ {} return -1; }} surface t (output float r = 0) {{ r = f (u); }}",
        arms.join(" else ")
    );
    let group = link(&[(&source, granita_base::Params::new())], &[]);
    let mut services = Double::default();
    let out = output(&group, &mut square(3, 2), &mut services, "r", granita_gsl::ir::ValueType::Float);
    assert_eq!(out[..3], [1.0, 3.0, 5.0]);
}

#[test]
fn long_sums_are_computed_correctly() {
    let n = 5000;
    assert_eq!(floats(&format!("r = u{};", " + u".repeat(n)))[..3], [0.0, 2500.5, 5001.0]);
    assert_eq!(floats(&format!("r = 1{};", " && u < 0.7".repeat(n)))[..3], [1.0, 1.0, 0.0]);
    assert_eq!(floats(&format!("r = 0{};", " || u > 0.7".repeat(n)))[..3], [0.0, 0.0, 1.0]);
    // The evaluation is from left to right, including types, conversions and the truth of a triple.
    assert_eq!(floats("color c = 2; r = u + 1 + c == c + 1 == 1 && c;")[..3], [1.0, 0.0, 0.0]);
    assert_eq!(floats("point p = 1; r = length (p - p + p - point (u));")[0], 3.0_f32.sqrt());
    assert_eq!(floats("r = 8 / 4 / 2 - 1 - 1 + 2 * 3 * u;")[..3], [-1.0, 2.0, 5.0]);
}

#[test]
fn long_unused_code_is_removed_quickly() {
    // Each value is read by the next one alone, and the last is not read.
    let n = 20_000;
    let body = format!("float a = u; {} r = 1;", "a = a * 2 + v; ".repeat(n));
    assert_eq!(floats(&body)[0], 1.0);
    let body: String = (0..n).map(|k| format!("float a{} = a{k} + 1; ", k + 1)).collect();
    assert_eq!(floats(&format!("float a0 = u; {body} r = 1;"))[0], 1.0);
}
