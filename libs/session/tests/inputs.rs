//! Tests that deferred inputs give the same pixels, and that none is read without need.

#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use granita_base::{Location, Reporter};
use granita_scene::SceneSink;
use granita_session::{Outcome, Session, SessionOptions};
use std::path::Path;

/// Renders `world`, the calls between `World` and `Render`, in `folder`. Returns the bytes of the image, the messages
/// and the outcome.
fn render(folder: &Path, before: &str, world: &str) -> (Vec<u8>, Vec<String>, Outcome) {
    let image = folder.join("image.tif");
    let _ = std::fs::remove_file(&image);
    let text = format!(
        "Attribute (\"string path:input\", \"{}\")\nAttribute (\"string path:generator\", \"{0}\")\n\
         Output (\"{}\", \"tiff\", \"rgba\", \"main\", \"float dither\", 0)\n\
         Attribute (\"int[2] resolution\", (48, 32))\nAttribute (\"int[2] spatialquality\", (2, 2))\n\
         {before}\nTranslate (0, 0, -4)\nCamera (\"main\")\nWorld ()\n{world}\nRender ()\n",
        folder.display(),
        image.display()
    );
    let (reporter, kept) = Reporter::collecting();
    let options = SessionOptions { no_startup_files: true, statistics: 1, ..SessionOptions::default() };
    let mut session = Session::new(options, reporter, Default::default());
    session.read_stream("<test>", Box::new(std::io::Cursor::new(text.into_bytes()))).unwrap();
    let outcome = session.finish();
    let said = kept.lock().iter().map(ToString::to_string).collect();
    (std::fs::read(&image).unwrap_or_default(), said, outcome)
}

/// Returns the number of inputs with a bound, and the number of those that were never read.
fn counts(said: &[String]) -> (usize, usize) {
    let number = |what: &str| {
        let text = said.iter().flat_map(|s| s.lines()).find(|l| l.trim_start().starts_with(what));
        text.map_or(0, |l| l.split_whitespace().last().unwrap().parse().unwrap())
    };
    (number("inputs with a bound"), number("never read"))
}

const LIGHT: &str = "Light (\"key\", \"pointlight\", \"float intensity\", 12, \"point from\", (2, 3, -4))\n";

/// Content with all kinds of calls that change the graphics state, and noise that depends on the seed of a primitive.
const FILE: &str = r#"
Attribute ("color C", (1, 0.5, 0.25))
Light ("inner", "pointlight", "float intensity", 4, "point from", (-2, 1, -2))
Shader ("surface", "speckle")
PushTransform ()
Translate (0.2, 0, 0)
Sphere (1, -1, 1, 360)
PopTransform ()
SaveAttributes ("inner space")
"#;

const SPECKLE: &str = "surface speckle () { C *= diffuse (normalize (N)) * random (); }";

#[test]
fn inline_and_deferred_inputs_give_the_same_pixels() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    file("speckle.gsl", SPECKLE);
    file("ball.pyg", FILE);
    file("nested.pyg", "Translate (0, 0.5, 0)\nInput (\"ball.pyg\", (-2, 2, -2, 2, -2, 2))\n");
    let before = format!("Attribute (\"string path:shader\", \"{}\")", folder.path().display());
    let around = |middle: &str| {
        format!(
            "{LIGHT}Shader (\"surface\", \"speckle\")\nPushAttributes ()\nTranslate (-1, 0, 0)\n{middle}\n\
             PopAttributes ()\nLight (\"late\", \"ambientlight\", \"float intensity\", 0.1)\n\
             Translate (1.2, 0, 0)\nSphere (0.8, -0.8, 0.8, 360)"
        )
    };
    let image = |middle: &str, expected: (usize, usize)| {
        let (bytes, said, outcome) = render(folder.path(), &before, &around(middle));
        assert!(outcome.complete && outcome.errors == 0, "{said:?}");
        assert_eq!(counts(&said), expected, "{middle}: {said:?}");
        bytes
    };
    let inline = image(FILE, (0, 0));
    assert!(image("Input (\"ball.pyg\")", (0, 0)) == inline);
    assert!(image("Input (\"ball.pyg\", (-2, 2, -2, 2, -2, 2))", (1, 0)) == inline);
    // An input that is never read, in front of all others, changes nothing.
    let unseen = "Input (\"absent of scene.pyg\", (50, 51, 0, 1, 0, 1))\n";
    file("absent of scene.pyg", "Sphere (1, -1, 1, 360)\nSphere (1, -1, 1, 360)\nno pyg at all");
    let both = image(&format!("{unseen}Input (\"ball.pyg\", (-2, 2, -2, 2, -2, 2))"), (2, 1));
    assert!(both == inline);
    let nested = image("Input (\"nested.pyg\", (-2, 2, -2, 2, -2, 2))", (2, 0));
    let written = image(&format!("PushAttributes ()\nTranslate (0, 0.5, 0)\n{FILE}PopAttributes ()"), (0, 0));
    assert!(nested == written && nested != inline);
}

#[test]
fn invisible_inputs_are_read_only_if_rays_may_hit_them() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    file("far.pyg", "Sphere (1, -1, 1, 360)\n");
    let world = |before: &str, x: f32| {
        format!("{LIGHT}{before}\nTranslate ({x}, 0, 0)\nInput (\"far.pyg\", (-1, 1, -1, 1, -1, 1))\n")
    };
    let read = |before: &str, x: f32| counts(&render(folder.path(), "", &world(before, x)).1);
    assert_eq!(read("", 0.0), (1, 0));
    assert_eq!(read("", 50.0), (1, 1));
    assert_eq!(read("Translate (0, 0, -20)", 0.0), (1, 1), "behind the camera");
    // It moves through the image while the shutter is open.
    let shutter = "Attribute (\"float[2] shutter\", (0, 1))\nAttribute (\"int temporalquality\", 4)";
    let moving = "Motion (0, 1)\nTranslate (0, 0, 0)\nTranslate (-100, 0, 0)";
    assert_eq!(counts(&render(folder.path(), shutter, &world(moving, 50.0)).1), (1, 0));
    // A displacement brings it into view.
    let displaced = "Attribute (\"float displace:maxradius\", 60)";
    assert_eq!(read(displaced, 50.0), (1, 0));
    // Shaders that name a set may trace rays. Those that name a map do not.
    let set = "Light (\"ray\", \"pointlight\", \"string shadowname\", \"NAME\")";
    assert_eq!(read(&set.replace("NAME", "shadows"), 50.0), (1, 0));
    assert_eq!(read(&set.replace("NAME", "nosuch.sm"), 50.0), (1, 1));
    assert_eq!(read("Shader (\"surface\", \"ambocclude\", \"string occlusionname\", \"x\")", 50.0), (1, 0));
    // An invalid bound is reported, and the file is read at once.
    let odd = "Input (\"far.pyg\", (1, -1, -1, 1, -1, 1))";
    let (_, said, _) = render(folder.path(), "", odd);
    assert!(said.iter().any(|s| s.contains("the bound (1, -1, -1, 1, -1, 1) is empty")), "{said:?}");
}

#[test]
fn programs_as_inputs_are_deferred() {
    let folder = tempfile::tempdir().unwrap();
    let ran = folder.path().join("ran");
    let command = format!("pyg < touch '{}'; echo 'Sphere (1, -1, 1, 360)'", ran.display());
    let world = |x: f32| format!("Translate ({x}, 0, 0)\nInput (\"{command}\", (-1, 1, -1, 1, -1, 1))");
    let (_, said, _) = render(folder.path(), "", &world(50.0));
    assert!(!ran.exists(), "{said:?}");
    let (_, said, outcome) = render(folder.path(), "", &world(0.0));
    assert!(ran.exists() && outcome.errors == 0, "{said:?}");
}

#[test]
fn errors_inside_of_an_input_stay_inside() {
    let folder = tempfile::tempdir().unwrap();
    let text = "Attribute (\"string name\", \"inner\")\nPushAttributes ()\nTranslate (1, 2, 3)\nPopAttributes ()\n\
                PopAttributes ()\nRender ()\nPushTransform ()\n";
    std::fs::write(folder.path().join("a.pyg"), text).unwrap();
    let (_, said, outcome) = render(
        folder.path(),
        "",
        "PushAttributes ()\nInput (\"a.pyg\", (-1, 1, -1, 1, -1, 1))\nPopAttributes ()",
    );
    assert!(outcome.rendered);
    let errors: Vec<&String> = said.iter().filter(|s| s.contains("a.pyg")).collect();
    assert_eq!(errors.len(), 3, "{said:?}");
    assert!(errors[0].contains(":5: error: PopAttributes without PushAttributes"), "{errors:?}");
    assert!(errors[1].contains(":6: error: Render inside an Input with a bound"), "{errors:?}");
    assert!(errors[2].contains(":7: warning: PushTransform without PopTransform"), "{errors:?}");
}

#[test]
fn a_file_that_reads_itself_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    file("a.pyg", "Input (\"b.pyg\")\n");
    file("b.pyg", "Sphere (0.1, -0.1, 0.1, 360)\nInput (\"./a.pyg\")\nInput (\"a.pyg\")\n");
    let (_, said, outcome) = render(folder.path(), "", "Input (\"a.pyg\")");
    assert!(outcome.complete);
    let told: Vec<&String> = said.iter().filter(|s| s.contains("would read itself")).collect();
    assert_eq!(told.len(), 1, "{said:?}");
    assert!(told[0].ends_with("Input \"a.pyg\" would read itself: a.pyg -> b.pyg -> a.pyg"), "{told:?}");
    // Each level of a deferred input is read at Render.
    file("c.pyg", "Sphere (0.1, -0.1, 0.1, 360)\nInput (\"c.pyg\", (-1, 1, -1, 1, -1, 1))\n");
    let (_, said, _) = render(folder.path(), "", "Input (\"c.pyg\", (-1, 1, -1, 1, -1, 1))");
    assert!(said.iter().any(|s| s.contains("would read itself: c.pyg -> c.pyg")), "{said:?}");
    // The scene reads itself.
    let scene = folder.path().join("scene.pyg");
    std::fs::write(&scene, format!("Input (\"{}\")\n", scene.display())).unwrap();
    let (reporter, kept) = Reporter::collecting();
    let options = SessionOptions { no_startup_files: true, ..SessionOptions::default() };
    let mut session = Session::new(options, reporter, Default::default());
    session.read_file(scene.to_str().unwrap()).unwrap();
    assert!(kept.lock()[0].to_string().contains("would read itself"));
    session.state().call(granita_scene::Call::World, &Location::default()).unwrap();
}
