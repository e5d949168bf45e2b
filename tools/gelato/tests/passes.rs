//! Tests images that are the sum of passes: their options, their ends and what they say about themselves.

#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test, with a line number")]

mod folder;

use folder::Folder;
use granita_image::{FormatRegistry, Limits};
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

/// A scene with all kinds of random numbers: edges, motion, depth of field, an area light, occlusion, indirect light
/// and a shader's own.
const SCENE: &str = r#"
Attribute ("int[2] resolution", (72, 56))
Attribute ("int[2] spatialquality", (2, 2))
Attribute ("float fov", 50)
Attribute ("float[2] shutter", (0, 1))
Attribute ("float fstop", 4)
Attribute ("float focallength", 0.3)
Attribute ("float focaldistance", 5)
Output ("a.exr", "exr", "rgba", "main")
Camera ("main")
World ()
Attribute ("string geometryset", "+indirect,+occlude")
Light ("lamp", "pointlight", "float intensity", 20)
Shader ("surface", "noisy")
PushTransform ()
Translate (0, 0.4, 5)
Motion (0, 1)
Translate (-0.5, 0, 0)
Translate (0.5, 0.2, 0)
Sphere (1, -1, 1, 360)
PopTransform ()
PushTransform ()
Translate (0, -1, 5)
Scale (5, 5, 5)
Patch ("linear", 2, 2, "vertex point P", (-1, 0, 1, 1, 0, 1, -1, 0, -1, 1, 0, -1))
PopTransform ()
Render ()
"#;

const SHADER: &str = r#"
surface noisy () {
    vector n = normalize (N);
    float seen = 1 - occlusion ("occlude", P, n, PI / 2, "samples", 16);
    C = color (0.6, 0.5, 0.3) * (seen + indirect ("indirect", P, n, "samples", 8)) * (0.7 + 0.3 * random ());
}
"#;

struct Place(Folder);

impl std::ops::Deref for Place {
    type Target = Folder;

    fn deref(&self) -> &Folder {
        &self.0
    }
}

impl Place {
    fn new() -> Self {
        Self(Folder::with(&[("scene.pyg", SCENE), ("noisy.gsl", SHADER)]))
    }

    /// Renders the scene with these options, and returns what it said and its image.
    fn image(&self, words: &[&str]) -> (String, Shown) {
        let ran = self.run(&[words, &["scene.pyg"]].concat());
        assert_eq!(ran.status, 0, "{words:?}: {}", ran.said);
        (ran.said, self.shown("a.exr"))
    }

    fn shown(&self, name: &str) -> Shown {
        let registry: FormatRegistry = granita_plugin::bundled_formats(Limits::default());
        let file = registry.open(&self.path().join(name)).unwrap();
        let spec = file.spec(0, 0).unwrap();
        let text = |name: &str| spec.string(&format!("granita/{name}")).map(str::to_owned);
        let number = |name: &str| text(name).map(|text| text.parse().unwrap());
        Shown {
            passes: text("passes"),
            errors: ["error", "error95", "blocks99"].map(number),
            bias: number("bias"),
            finer: text("finer"),
            larger: text("larger").map(|both| both.replace(' ', ",")),
            pixels: file.read_level(0, 0).unwrap().to_floats(),
        }
    }
}

/// An image and what it says about itself.
#[derive(Debug, PartialEq)]
struct Shown {
    passes: Option<String>,
    errors: [Option<f64>; 3],
    bias: Option<f64>,
    finer: Option<String>,
    larger: Option<String>,
    pixels: Vec<f32>,
}

impl Shown {
    fn passes(&self) -> u32 {
        self.passes.as_ref().unwrap().parse().unwrap()
    }
}

/// Returns the error of an image against another one over red, green and blue.
fn distance(a: &Shown, b: &Shown) -> f64 {
    let colors = |shown: &Shown| -> Vec<f64> {
        shown.pixels.chunks(4).flat_map(|pixel| pixel[..3].to_vec()).map(f64::from).collect()
    };
    let (a, b) = (colors(a), colors(b));
    let squares: f64 = a.iter().zip(&b).map(|(a, b)| (a - b).powi(2)).sum();
    (squares / a.len() as f64).sqrt() / (b.iter().sum::<f64>() / b.len() as f64)
}

#[test]
fn passes_make_the_same_bits_with_any_threads_and_buckets() {
    let place = Place::new();
    // In passes, all rays are traced.
    place.write("noisy.gsl", &SHADER.replace("\"samples\", 16", "\"samples\", 16, \"adaptive\", 0"));
    let (said, frame) = place.image(&[]);
    assert!(frame.passes.is_none() && !said.contains("pass"), "{said}");
    let (said, one) = place.image(&["-passes", "1"]);
    assert!(
        one.pixels == frame.pixels && one.passes() == 1 && said.contains("camera \"main\": 1 pass"),
        "{said}"
    );
    assert_eq!(one.errors, [None; 3]);
    for options in [["-passes", "4"], ["-error", "6%"]] {
        let (said, first) = place.image(&[&options[..], &["-threads", "1"]].concat());
        assert!(said.contains("passes") && said.contains("at 95 % confidence"), "{said}");
        for front in [
            "Attribute (\"int[2] limits:bucketsize\", (11, 23))\nAttribute (\"string bucketorder\", \"spiral\")\n",
            "Attribute (\"int[2] limits:bucketsize\", (64, 8))\nAttribute (\"string bucketorder\", \"vertical\")\n",
        ] {
            place.write("front.pyg", front);
            let (_, again) = place.image(&[&options[..], &["-threads", "2", "front.pyg"]].concat());
            assert!(first == again, "{options:?} {front}");
        }
    }
}

#[test]
fn passes_converge_and_know_their_error() {
    let place = Place::new();
    // More rays a point show that their number has no bias.
    let (_, converged) = place.image(&["-passes", "60", "-set", "render:samples=4"]);
    let of = |n: &str| place.image(&["-passes", n]).1;
    let (one, sixteen) = (distance(&of("1"), &converged), of("16"));
    let reached = distance(&sixteen, &converged);
    assert!(reached < 0.4 * one, "{one} {reached}");
    let estimate = sixteen.errors[0].unwrap();
    assert!((0.75..1.3).contains(&(reached / estimate)), "{reached} {estimate}");
    // The attribute requests the same as the option.
    place.write("front.pyg", "Attribute (\"float render:error\", 0.03)\n");
    let (_, by_attribute) = place.image(&["front.pyg"]);
    let (_, by_option) = place.image(&["-error", "3%"]);
    assert!(by_attribute == by_option);
    let error = distance(&by_option, &converged);
    assert!(error < 0.036 && by_option.errors[1].unwrap() < 0.0315, "{error} {:?}", by_option.errors);
    let (_, by_name) = place.image(&["-review"]);
    assert!(by_name == by_option);
}

#[test]
fn time_ends_the_passes_and_the_number_makes_them_again() {
    let place = Place::new();
    let begin = Instant::now();
    let (said, timed) = place.image(&["-seconds", "3"]);
    let took = begin.elapsed();
    assert!(took < Duration::from_secs(5), "{took:?} {said}");
    // One finer or larger pass may be better than several.
    assert!(timed.passes() > 1 || timed.finer.is_some() || timed.larger.is_some(), "{said}");
    let repeat = |shown: &Shown| {
        let passes = shown.passes().to_string();
        let [finer, larger] = [&shown.finer, &shown.larger].map(|word| word.as_deref().unwrap_or("1"));
        place.image(&["-passes", &passes, "-finer", finer, "-larger", larger]).1
    };
    let again = repeat(&timed);
    // A number of passes measures no bias, which is a part of the error.
    let is_measured = timed.bias.is_some();
    let shown = |shown: &Shown| [&shown.passes, &shown.finer, &shown.larger].map(Clone::clone);
    assert_eq!(shown(&again), shown(&timed), "{said}");
    assert!(again.pixels == timed.pixels && (is_measured || again == timed), "{said}");
    // Stripes without noise need finer surfaces more than passes.
    place.write("noisy.gsl", "surface noisy () { C = mod (9 * u, 1) < 0.5 ? 0.8 : 0.2; }");
    let (said, timed) = place.image(&["-seconds", "8", "-statistics-json", "s.json"]);
    let finer = timed.finer.as_deref().expect(&said);
    assert!(said.contains(&format!(", with points {finer} times as close")), "{said}");
    assert_eq!(place.json("s.json")["frames"][0]["cameras"][0]["passes"]["finer"].to_string(), finer);
    assert!(repeat(&timed).pixels == timed.pixels, "{said}");
    // The attribute requests the same as the option.
    let larger = timed.larger.as_deref().unwrap_or("1,1").replace(',', ", ");
    let attributes = [format!("int render:finer\", {finer}"), format!("int[2] render:larger\", ({larger})")];
    place.write("front.pyg", &attributes.map(|text| format!("Attribute (\"{text})\n")).concat());
    let (_, by_attribute) = place.image(&["front.pyg", "-passes", &timed.passes().to_string()]);
    assert!(by_attribute.pixels == timed.pixels);
}

#[test]
fn statistics_hold_the_error() {
    let place = Place::new();
    let (said, shown) =
        place.image(&["-error", "1%", "-passes", "3", "-statistics", "-statistics-json", "s.json"]);
    assert!(said.contains("the error of 1.000 % was not reached"), "{said}");
    assert!(said.lines().any(|line| line.starts_with("  passes  ")), "{said}");
    let json = place.json("s.json");
    let passes = &json["frames"][0]["cameras"][0]["passes"];
    assert_eq!((&passes["passes"], &passes["is_reached"]), (&3.into(), &false.into()));
    assert!((passes["error"].as_f64().unwrap() - shown.errors[0].unwrap()).abs() < 1e-6, "{passes}");
}

#[test]
fn wrong_values_have_messages_that_say_what_is_expected() {
    let place = Place::new();
    for (words, expected) in [
        (["-error", "0"], "such as 2%"),
        (["-error", "0%"], "such as 2%"),
        (["-error", "2"], "such as 2%"),
        (["-seconds", "-1"], "more than 0"),
        (["-seconds", "0"], "more than 0"),
        (["-passes", "0"], "1.."),
        (["-until", "25:00"], "18:30"),
        (["-finer", "2"], "-passes"),
        (["-passes=2", "-finer=3"], "1, 2, 4, 8, 16 or 32"),
        (["-larger", "4"], "-passes"),
        (["-passes=2", "-larger=4,2"], "1, 4 and 16"),
        (["-error=1%", "-final"], "cannot be used with"),
        (["-draft", "-review"], "cannot be used with"),
    ] {
        let ran = place.run(&[&words[..], &["scene.pyg"]].concat());
        assert!(ran.status == 2 && ran.said.contains(expected), "{words:?}: {}", ran.said);
    }
    for (name, value) in
        [("float render:error", "-0.5"), ("float render:seconds", "-1"), ("int render:passes", "-2")]
    {
        place.write("front.pyg", &format!("Attribute (\"{name}\", {value})\n"));
        let ran = place.run(&["front.pyg", "scene.pyg"]);
        assert!(ran.status == 0 && ran.said.contains("is below 0 or not a number"), "{}", ran.said);
    }
    for (attribute, value, said) in [
        ("int render:finer", "3", "\"render:finer\" 3 is none of"),
        ("int[2] render:larger", "(4, 64)", "\"render:larger\" 4 64 is none of"),
    ] {
        place.write("front.pyg", &format!("Attribute (\"{attribute}\", {value})\n"));
        let ran = place.run(&["front.pyg", "-passes", "1", "scene.pyg"]);
        assert!(ran.status == 0 && ran.said.contains(said), "{}", ran.said);
    }
}

#[cfg(unix)]
#[test]
fn a_signal_ends_with_the_passes_so_far() {
    use rustix::process::{Pid, Signal, kill_process};
    let place = Place::new();
    let end = |mut child: Child| {
        // Some passes take place before.
        std::thread::sleep(Duration::from_secs(3));
        kill_process(Pid::from_child(&child), Signal::TERM).unwrap();
        let status = child.wait().unwrap();
        assert_eq!(std::os::unix::process::ExitStatusExt::signal(&status), Some(Signal::TERM.as_raw()));
    };
    let before = place.names();
    end(place.command(&["-passes", "100000", "scene.pyg"]).stdout(Stdio::null()).spawn().unwrap());
    let shown = place.shown("a.exr");
    assert!(shown.passes() > 1 && shown.errors[0].is_some(), "{:?}", shown.passes);
    let mut after = place.names();
    after.retain(|name| !before.contains(name));
    assert_eq!(after, ["a.exr"]);
    let (_, again) = place.image(&["-passes", &shown.passes().to_string()]);
    assert!(again == shown);
}

#[test]
fn the_noise_of_each_source_is_measured() {
    let place = Place::new();
    let (_, plain) = place.image(&["-passes", "4"]);
    let (said, shown) = place.image(&["-passes", "4", "-causes", "-statistics-json", "s.json"]);
    assert!(said.contains("; from ") && said.contains("occlusion "), "{said}");
    assert!(plain.pixels == shown.pixels && plain.errors == shown.errors);
    let record = place.json("s.json");
    let passes = &record["frames"][0]["cameras"][0]["passes"];
    let parts = passes["causes"].as_object().unwrap();
    let names: Vec<&str> = parts.keys().map(String::as_str).collect();
    assert_eq!(names, ["edges", "indirect", "lens", "motion", "occlusion"]);
    let error = passes["error"].as_f64().unwrap();
    assert!(parts.values().all(|part| (1e-4..1.2).contains(&(part.as_f64().unwrap() / error))), "{passes}");
    assert!(passes["worst_block"]["error"].as_f64().unwrap() >= passes["blocks99"].as_f64().unwrap());
    assert_eq!(passes["images"][0]["name"], "a.exr");
    // Fewer samples make more noise.
    let few = SHADER.replace("\"samples\", 16", "\"samples\", 2");
    place.write("noisy.gsl", &few);
    place.image(&["-passes", "4", "-causes", "-statistics-json", "s.json"]);
    let record = place.json("s.json");
    let more = record["frames"][0]["cameras"][0]["passes"]["causes"]["occlusion"].as_f64().unwrap();
    assert!(more > 1.5 * parts["occlusion"].as_f64().unwrap(), "{more} {parts:?}");
    // Alone it makes the two passes that differences need.
    let (_, alone) = place.image(&["-causes"]);
    assert_eq!(alone.passes(), 2);
}

#[test]
fn the_noise_of_each_pixel_is_an_image() {
    let place = Place::new();
    let noise = "Output (\"noise.exr\", \"exr\", \"error\", \"main\", \"string pixeltype\", \"float\")\n";
    place.write("scene.pyg", &SCENE.replace("Camera (\"main\")", &format!("{noise}Camera (\"main\")")));
    let (_, shown) = place.image(&["-passes", "4"]);
    let of_pixels = place.shown("noise.exr").pixels;
    assert_eq!(of_pixels.len(), 72 * 56 * 3);
    let squares = of_pixels.iter().map(|v| f64::from(*v).powi(2)).sum::<f64>() / of_pixels.len() as f64;
    let error = shown.errors[0].unwrap();
    assert!((squares.sqrt() / error - 1.0).abs() < 1e-3, "{} {error}", squares.sqrt());
    // A frame without passes has no noise to show.
    std::fs::remove_file(place.path().join("noise.exr")).unwrap();
    let ran = place.run(&["scene.pyg"]);
    assert!(ran.status == 1 && ran.said.contains("noise.exr\": it is left out"), "{}", ran.said);
    assert!(place.has("a.exr") && !place.has("noise.exr"));
}

/// Passes continue the sequences of those before. Numbers that stayed the same would leave noise that no number of
/// passes removes.
#[test]
fn the_noise_of_every_source_falls_with_the_number_of_passes() {
    let place = Place::new();
    let still = SCENE
        .lines()
        .filter(|line| !["shutter", "fstop", "Motion", "Light"].iter().any(|w| line.contains(w)));
    let still = still
        .collect::<Vec<_>>()
        .join("\n")
        .replace("(72, 56)", "(36, 28)")
        .replace("+indirect,+occlude", "+all");
    let lit = "C = color (0.6, 0.5, 0.3) * diffuse (normalize (N));";
    let glossy =
        "C = u + (color) environment (\"all\", reflect (I, normalize (N)), \"samples\", 2, \"blur\", 0.5);";
    let blocked =
        "C = 1 - occlusion (\"all\", P, normalize (N), PI / 2, \"samples\", 16, \"maxerror\", MAXERROR);";
    let bounced = "C = u + indirect (\"all\", P, normalize (N), \"samples\", 8, \"maxerror\", MAXERROR);";
    let gathered = "float hit = 0; C = 0; trace (\"all\", P, normalize (N), PI / 3, 4) { \
                    getmessage (\"trace\", \"hit\", hit); C += 0.25 * (1 - hit); }";
    let lamp = "PushAttributes ()\nAttribute (\"string geometryset\", \"lamp\")\nShader (\"surface\", \"constant\")\n\
                Patch (\"linear\", 2, 2, \"vertex point P\", (-1, 3, 4, 1, 3, 4, -1, 3, 6, 1, 3, 6))\nPopAttributes ()\n\
                Light (\"area\", \"arealight\", \"string geometry\", \"lamp\", \"float twosided\", 1, \"string shadowname\", \"all\")";
    let several = format!("Attribute (\"int light:nsamples\", 2)\n{lamp}");
    let sun = "Attribute (\"int light:nsamples\", 2)\nLight (\"sun\", \"broad\")";
    let soft = "Light (\"soft\", \"softlight\", \"point from\", (2, 4, 3), \"float shadowsamples\", 2, \
                \"string shadowname\", \"all\", \"float falloff\", 0)";
    place.write(
        "broad.gsl",
        "light broad () { emit (vector (0.4, -1, 0.3), 0.8) { Cl = 1 - (color) shadow (\"all\", Ps); } }",
    );
    let moves = ("Sphere (1,", "Motion (0, 1)\nTranslate (0, 0, 0)\nTranslate (0.6, 0.2, 0)\nSphere (1,");
    let of_camera = |line: &str| ("Camera (", format!("{line}\nCamera ("));
    let open = of_camera("Attribute (\"float[2] shutter\", (0, 1))");
    let own = |from: &'static str, to: &str| (from, to.to_owned());
    let cases = [
        ("edges", "C = mod (7 * u, 1) < 0.5;", "", vec![]),
        ("random", "C = random ();", "", vec![]),
        (
            "random of hits",
            "C = raylevel () > 0 ? random () : (color) environment (\"all\", vector (0, 1, 0.1));",
            "",
            vec![],
        ),
        ("motion", "C = u;", "", vec![open.clone(), own(moves.0, moves.1)]),
        (
            "lens",
            "C = mod (7 * u, 1) < 0.5;",
            "",
            vec![of_camera(
                "Attribute (\"float fstop\", 1)\nAttribute (\"float focallength\", 0.5)\nAttribute (\"float focaldistance\", 9)",
            )],
        ),
        ("area", lit, lamp, vec![]),
        ("areas", lit, &several, vec![]),
        ("broad", lit, sun, vec![]),
        ("soft", lit, soft, vec![]),
        ("glossy", glossy, "", vec![]),
        ("deep", glossy, "", vec![of_camera("Attribute (\"int ray:maxdepth\", 3)")]),
        ("gather", gathered, "", vec![]),
        ("occlusion", blocked, "", vec![own("MAXERROR", "0.25")]),
        ("occlusion of points", blocked, "", vec![own("MAXERROR", "0")]),
        (
            "occlusion of what moves",
            blocked,
            "Attribute (\"int ray:motion\", 1)",
            vec![own("MAXERROR", "0"), open, own(moves.0, moves.1)],
        ),
        ("indirect", bounced, "", vec![own("MAXERROR", "0.25")]),
        ("indirect of points", bounced, "", vec![own("MAXERROR", "0")]),
        (
            "bounces",
            bounced,
            "",
            vec![own("MAXERROR", "0"), of_camera("Attribute (\"int indirect:maxdepth\", 3)")],
        ),
    ];
    let mut slow = Vec::new();
    for (name, body, lights, changes) in cases {
        let mut scene = still.replace("Shader (\"surface\"", &format!("{lights}\nShader (\"surface\""));
        let mut body = body.to_owned();
        for (from, to) in changes {
            scene = scene.replace(from, &to);
            body = body.replace(from, &to);
        }
        place.write("scene.pyg", &scene);
        place.write("noisy.gsl", &format!("surface noisy () {{ {body} }}"));
        let [few, many] = ["2", "32"].map(|passes| place.image(&["-passes", passes]).1.errors[0].unwrap());
        if few < 1e-3 || many > 0.32 * few {
            slow.push((name, few, many));
        }
    }
    // Independent passes would have a quarter, which is measured to a tenth.
    assert!(slow.is_empty(), "{slow:?}");
}

#[test]
fn bias_is_a_part_of_the_error() {
    let place = Place::new();
    place.write("striped.gsl", "surface striped () { C = mod (12 * u + 7 * v, 1) < 0.5 ? 0.1 : 1; }");
    let still = SCENE.lines().filter(|line| !line.contains("shutter") && !line.contains("fstop"));
    let still = still.collect::<Vec<_>>().join("\n").replace("\"noisy\"", "\"striped\"");
    place.write("scene.pyg", &still);
    let (_, converged) = place.image(&["-passes", "12", "-set", "shadingquality=6"]);
    // No number of passes of the scene as it is has this error.
    let (_, coarse) = place.image(&["-passes", "12"]);
    assert!(distance(&coarse, &converged) > 0.05, "{}", distance(&coarse, &converged));
    // Where the requested error permits the bias of the scene as it is, that is what is measured.
    let (said, _) = place.image(&["-error", "40%"]);
    let bias = said.split("; bias ").nth(1).and_then(|rest| rest.split(" %").next()?.parse::<f64>().ok());
    let of_true = bias.unwrap_or_default() / 100.0 / distance(&coarse, &converged);
    assert!((0.75..1.3).contains(&of_true), "{of_true} {said}");
    let (said, shown) = place.image(&["-error", "5%", "-threads", "1"]);
    let reached = distance(&shown, &converged);
    assert!((0.4 * 0.05..1.2 * 0.05).contains(&reached), "{reached} {said}");
    // Points are so much closer that their bias was measured once more, and little of it is left.
    assert!(shown.bias.is_some_and(|bias| bias < 0.5 * reached), "{:?} {said}", shown.bias);
    // Neither threads nor buckets nor the part that is shown change a bit.
    let (_, again) = place.image(&["-error", "5%", "-threads", "2", "-set", "limits:bucketsize=16,16"]);
    assert!(again == shown);
    let (_, part) = place.image(&["-error", "5%", "-crop", "0.25", "0.5", "0.25", "0.75"]);
    let of_part: Vec<f32> =
        (14..42).flat_map(|y| shown.pixels[(y * 72 + 18) * 4..][..18 * 4].to_vec()).collect();
    assert!(part.pixels == of_part);
    // The number of passes makes the image again that was made in a time. Finer passes count from the second on.
    let (_, timed) = place.image(&["-error", "5%", "-seconds", "1000"]);
    let some = [2, 3, timed.passes()].map(|n| place.image(&["-error", "5%", "-passes", &n.to_string()]).1);
    assert!(some[0].pixels == some[1].pixels && some[0].pixels != timed.pixels && some[2] == timed);
    assert!(some.iter().all(|some| some.errors[0].is_some()));
    // Finer surfaces have more points than the limit on those of the scene.
    let (_, again) = place.image(&["-error", "5%", "-set", "limits:primitivepoints=20000"]);
    assert!(again == shown);
    // A scene with less detail has fewer points than it says.
    place.write("scene.pyg", &still.replace("\"striped\"", "\"plastic\""));
    let (_, plain) = place.image(&["-passes", "2", "-set", "shadingquality=0.5"]);
    let (said, shown) = place.image(&["-error", "5%"]);
    assert!(said.contains("2 passes, coarse: points are 2 times as far apart;"), "{said}");
    assert!(shown.pixels == plain.pixels);
}

#[test]
fn images_without_colours_have_no_error_to_reach() {
    let place = Place::new();
    place.write("scene.pyg", &SCENE.replace("\"rgba\"", "\"z\""));
    let (said, shown) = place.image(&["-error", "5%"]);
    assert!(said.contains("camera \"main\": 1 pass\n"), "{said}");
    let (_, plain) = place.image(&[]);
    assert!(shown.pixels == plain.pixels);
    let (said, _) = place.image(&["-error", "5%", "-passes", "3"]);
    assert!(said.contains("camera \"main\": 1 pass\n"), "{said}");
    let (said, _) = place.image(&["-passes", "3"]);
    assert!(said.contains("camera \"main\": 3 passes\n"), "{said}");
}

#[test]
fn hard_shadows_are_no_source_of_noise() {
    let place = Place::new();
    let causes = |scene: &str| -> Vec<String> {
        place.write("scene.pyg", &scene.replace("\"noisy\"", "\"plastic\""));
        place.image(&["-causes", "-statistics-json", "s.json"]);
        let record = place.json("s.json");
        let causes = record["frames"][0]["cameras"][0]["passes"]["causes"].as_object().unwrap();
        causes.keys().cloned().collect()
    };
    let intensity = "\"float intensity\", 20";
    let lit = |more: &str| SCENE.replace(intensity, &format!("{intensity}, {more}"));
    let hard = lit("\"string shadowname\", \"occlude\"");
    assert_eq!(causes(&hard), ["edges", "lens", "motion"]);
    let soft = lit("\"string shadowname\", \"occlude\", \"float shadowblur\", 0.1");
    assert_eq!(causes(&soft), ["edges", "lens", "lights", "motion"]);
}

#[test]
fn the_best_settings_are_measured() {
    let place = Place::new();
    let scene = SCENE.replace("(72, 56)", "(32, 24)");
    place.write("scene.pyg", &scene);
    let ran = place.run(&["-trade", "-error", "4%", "-threads", "2", "scene.pyg"]);
    assert_eq!(ran.status, 0, "{}", ran.said);
    for part in ["2 x 2, 1  (as it is)", "2 x 2, 0.25", "* the least time", "-error 4% scene.pyg"] {
        assert!(ran.said.contains(part), "{part}: {}", ran.said);
    }
    assert_eq!(place.names(), ["noisy.gsl", "scene.pyg", "scene.trade.pyg", "scene.trade.svg"]);
    // The statements can be read, and are those of the command that was printed.
    let text = std::fs::read_to_string(place.path().join("scene.trade.pyg")).unwrap();
    let command = ran.said.lines().find_map(|line| line.trim().strip_prefix("gelato ")).unwrap();
    let words: Vec<&str> = command.split_whitespace().collect();
    assert!(text.contains("render:error\", 0.04") && words[0] == "-set", "{text}");
    let (_, by_words) = place.image(&words[..words.len() - 1]);
    place.write("best.pyg", &scene.replace("Camera (", &format!("{text}Camera (")));
    let ran = place.run(&["best.pyg"]);
    assert_eq!(ran.status, 0, "{}", ran.said);
    let by_text = place.shown("a.exr");
    assert!(by_words.pixels == by_text.pixels && by_words.passes == by_text.passes);
    assert!(by_text.errors[1].unwrap() < 0.042, "{by_text:?}");
    // What is wrong is said.
    assert!(place.run(&["-trade", "-"]).said.contains("must be in a file"));
    let ran = place.run(&["-trade", "missing.pyg"]);
    assert!(ran.status == 2 && ran.said.contains("missing.pyg"), "{}", ran.said);
}

#[test]
fn only_the_images_of_the_command_line_are_made() {
    let place = Place::new();
    let ran = place.run(&["-o", "b.exr", "-only", "scene.pyg"]);
    assert_eq!(
        (ran.status, place.names().join(" ")),
        (0, "b.exr noisy.gsl scene.pyg".to_owned()),
        "{}",
        ran.said
    );
}
