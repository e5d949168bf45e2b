//! Parts of shaders that re-renders run apart have the results of whole runs, to the bit.

use crate::fixture::{Double, KeptParts, link, square};
use granita_base::Params;
use granita_gsl::ir::ValueType;
use granita_shade::*;

/// An ambient light and two others.
fn lights(intensity: f32, ambient: f32) -> [String; 3] {
    [
        format!("light sun () {{ emit (vector (0, 0.5, 1), 0) {{ Cl = {intensity} * u; }} }}"),
        format!("light sky () {{ Cl = {ambient}; }}"),
        "light lamp () { emit (point (0, 1, -2)) { Cl = color (1, 0.5, 0.2) / dot (L, L); } }".to_owned(),
    ]
}

fn double([intensity, ambient, level]: [f32; 3]) -> Double {
    let lights = lights(intensity, ambient);
    let double = Double::with_lights(&lights.each_ref().map(|text| text.as_str()));
    Double { level, ..double }
}

type Results = (Lanes3, Lanes3, Vec<Option<Vec<f32>>>);

fn run(source: &str, double: &mut Double) -> Results {
    let group = link(&[(source, Params::new())], &[]);
    let mut grid = square(7, 5);
    double.grid = Some(grid.clone());
    let wanted = [("r", ValueType::Float), ("k", ValueType::Color)];
    let found = Executor::new().run(&group, &mut grid, double, &wanted);
    (grid.c, grid.opacity, found)
}

/// Surfaces, with the number of their parts, and of those that run again when the ambient light, the other lights, or a
/// texture changes.
const SURFACES: [(&str, usize, [usize; 3]); 8] = [
    (
        "surface plain (output float r = 0) {
            normal n = faceforward (normalize (N), I);
            color base = noise (P * 4) * color (u, v, 1);
            r = base[0];
            C = base * (ambient () + diffuse (n)) + specular (n, -normalize (I), 0.1);
        }",
        6,
        [3, 4, 2],
    ),
    (
        "surface cloth (output color k = 0) {
            float s = texture (\"level\", u, v) + noise (P * 3);
            k = s * color (1, 2, 3);
            float wave = sin (20 * u);
            C = k * diffuse (N) + wave * ambient ();
            opacity = 0.5 + 0.5 * wave;
        }",
        5,
        [2, 2, 4],
    ),
    (
        "surface looped (output float r = 0) {
            float turbulence = 0;
            float f = 1;
            while (f < 9) { turbulence += noise (P * f) / f; f *= 2; }
            color sum = 0;
            lights (P, N, 1.6) { sum += Cl * max (0, dot (normalize (L), N)) * turbulence; r += 1; }
            if (turbulence > 0.8) sum *= 2; else sum += ambient () * u;
            C = sum;
        }",
        4,
        [2, 3, 0],
    ),
    (
        "surface drawn (output float r = 0) {
            float a = random ();
            C = a * diffuse (N);
            if (C[0] > 0.1) r = random ();
            C += random () * texture (\"level\", v, u);
        }",
        6,
        [1, 5, 2],
    ),
    (
        "surface mirror (output float r = 0) {
            color seen = 0;
            trace (\"set\", P, reflect (I, N), 0, 3) {
                float far = 0;
                getmessage (\"trace\", \"hitdist\", far);
                seen += far;
            }
            r = noise (u * 10);
            C = seen * r + diffuse (N) + environment (\"set\", N);
        }",
        8,
        [3, 4, 3],
    ),
    (
        "surface named (output float r = 0) {
            string name = format (\"%s\", \"level\");
            color d = diffuse (N);
            C = d * texture (name, u, v);
            r = texture (name, v, v);
        }",
        5,
        [1, 2, 4],
    ),
    ("surface early () { if (u > 0.5) return; C = diffuse (N) * noise (P); }", 0, [0, 0, 0]),
    ("surface says () { setmessage (\"x\", u); C = diffuse (N) * noise (P); }", 0, [0, 0, 0]),
];

/// What changes: intensity of a light, intensity of the ambient light, value of the texture.
const CHANGES: [(&str, [f32; 3]); 3] =
    [("ambient", [1.0, 0.75, 0.25]), ("light", [3.0, 0.5, 0.25]), ("texture", [1.0, 0.5, -0.125])];

#[test]
fn parts_have_the_results_of_whole_runs() {
    let before = [1.0, 0.5, 0.25];
    for (source, parts, again) in SURFACES {
        let mut first = Double { kept: Some(KeptParts::default()), ..double(before) };
        assert_eq!(run(source, &mut first), run(source, &mut double(before)), "{source}");
        let kept = first.kept.unwrap();
        let count = kept.ran.len();
        let found = CHANGES.map(|(what, after)| {
            let whole = run(source, &mut double(after));
            let again = |given_up: Option<u32>| {
                let mut kept = KeptParts { ran: Vec::new(), ..kept.clone() };
                kept.values.retain(|part, (_, depends)| !depends.contains(what) && Some(*part) != given_up);
                let mut services = Double { kept: Some(kept), ..double(after) };
                assert_eq!(run(source, &mut services), whole, "{what}: {source}");
                services.kept.unwrap().ran.len()
            };
            // Other parts may be given up as well.
            (0..count as u32).for_each(|part| assert!(again(Some(part)) <= count));
            again(None)
        });
        assert_eq!((count, found), (parts, again), "{source}");
    }
}
