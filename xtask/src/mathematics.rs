//! Checks law 11: pixels do not depend on the mathematics library of a system.

use crate::source::{Kind, Source, paths};

/// The methods of numbers, and of the vectors and rotations of `glam`, that call the system's library. Their last bits
/// differ between systems, and between versions of one system. Square roots and fused multiplications are exact
/// everywhere.
const METHODS: [&str; 34] = [
    "acos",
    "acosh",
    "asin",
    "asinh",
    "atan",
    "atan2",
    "atanh",
    "cbrt",
    "cos",
    "cosh",
    "exp",
    "exp2",
    "exp_m1",
    "hypot",
    "ln",
    "ln_1p",
    "log",
    "log10",
    "log2",
    "powf",
    "rotate_axis",
    "rotate_x",
    "rotate_y",
    "rotate_z",
    "sin",
    "sin_cos",
    "sinh",
    "slerp",
    "tan",
    "tanh",
    "to_angle",
    "to_axis_angle",
    "to_euler",
    "to_scaled_axis",
];

/// The types that have them.
const TYPES: [&str; 11] =
    ["DQuat", "DVec2", "DVec3", "DVec4", "Quat", "Vec2", "Vec3", "Vec3A", "Vec4", "f32", "f64"];

/// The functions of `glam` that call it, by the beginnings of their names.
const MAKERS: [&str; 6] =
    ["from_angle", "from_axis_angle", "from_euler", "from_rotation_", "from_scaled_axis", "perspective_"];

/// The crates below the tools whose results only people see.
const EXCEPTIONS: [&str; 2] = ["libs/cli", "libs/view"];

/// Returns all breaches, one line each.
pub(crate) fn check(sources: &[Source]) -> Vec<String> {
    let checked = |source: &&Source| {
        (source.file.starts_with("libs") || source.file.starts_with("formats"))
            && !EXCEPTIONS.iter().any(|place| source.file.starts_with(place))
    };
    let faults = sources.iter().filter(checked).flat_map(|source| {
        let file = source.file.display();
        breaches(source).into_iter().map(move |(line, name)| {
            format!("{file}:{line}: {name}: has other bits on other systems, unlike those of libm (law 11)")
        })
    });
    faults.collect()
}

/// Returns the lines with such functions, and their names.
fn breaches(source: &Source) -> Vec<(usize, String)> {
    let mut found: Vec<(usize, String)> = Vec::new();
    for triple in source.code.windows(3) {
        if let [Kind::Sign('.'), Kind::Word(name), Kind::Sign('(')] =
            [0, 1, 2].map(|i| triple[i].kind.clone())
            && METHODS.contains(&name.as_str())
        {
            found.push((triple[1].line, name));
        }
    }
    for (line, path) in paths(&source.code) {
        let is_method = |pair: &&[&str]| TYPES.contains(&pair[0]) && METHODS.contains(&pair[1]);
        let is_maker = |pair: &&[&str]| MAKERS.iter().any(|maker| pair[1].starts_with(maker));
        let pair = path.windows(2).find(|pair| is_method(pair) || is_maker(pair));
        found.extend(pair.map(|pair| (line, pair[1].to_owned())));
    }
    found.sort();
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::PathBuf;

    #[test]
    fn functions_of_the_system_are_found_in_what_makes_pixels() {
        let text = "fn f(x: f32) -> f32 { x.sin() + libm::sinf(x) + x.sqrt() }\nfn g(x: &[f64]) { x.iter().map(f64::exp2); }\n\
                    fn h(a: Vec3) { Mat4::from_rotation_x(1.0); a.sin; a.slerp(a, 1.0); }\n#[cfg(test)]\nmod tests { fn f() { 1.0.cos() } }";
        let in_place = |file: &str| Source::new(PathBuf::from(file), text.to_owned()).unwrap();
        let found = breaches(&in_place("libs/x/src/a.rs"));
        let names: Vec<(usize, &str)> = found.iter().map(|(line, name)| (*line, name.as_str())).collect();
        assert_eq!(names, [(1, "sin"), (2, "exp2"), (3, "from_rotation_x"), (3, "slerp")]);
        assert_eq!(check(&[in_place("libs/x/src/a.rs"), in_place("formats/x/src/a.rs")]).len(), 8);
        assert!(check(&[in_place("libs/view/src/a.rs"), in_place("tools/x/src/a.rs")]).is_empty());
    }
}
