//! Tests defaults and calls that programs of the reference's time relied on beyond its text.

use crate::support::{Place, SQUARE, assert_near, at, middle};
use granita_base::Reporter;
use granita_scene::SceneSink as _;
use granita_session::{Session, SessionOptions};

#[test]
fn lights_have_the_defaults_of_the_reference() {
    let place = Place::new();
    let lit = |world: &str| place.seen("", &format!("{world}\nShader (\"surface\", \"matte\")\n{SQUARE}"));
    // A point light falls off with the square of the distance.
    let fine = "Attribute (\"float shadingquality\", 4)\n";
    let point = lit(&format!("{fine}Light (\"p\", \"pointlight\", \"point from\", (0, 0, -2))"));
    for i in [0, 5, 8] {
        let (x, y) = (middle(i), middle(9));
        let r2 = x * x + y * y + 4.0;
        assert_near(at(&point, x, y), &[2.0 / r2.powf(1.5); 3], 1e-3, "a point light");
    }
    // Indirect light comes from the set "indirect" when no set is named.
    let sky = "PushAttributes ()\nAttribute (\"string geometryset\", \"indirect\")\nAttribute (\"color C\", (0.2, 0.4, 0.8))\n\
               Shader (\"surface\", \"constant\")\nSphere (50, -50, 50, 360)\nPopAttributes ()\n";
    let indirect = lit(&format!("{sky}Light (\"i\", \"indirectlight\")"));
    assert_near(at(&indirect, 0.1, 0.1), &[0.2, 0.4, 0.8], 1e-4, "indirect light");
}

#[test]
fn the_version_attribute_has_four_numbers() {
    let options = SessionOptions { no_startup_files: true, ..SessionOptions::default() };
    let session = Session::new(options, Reporter::silent(), Default::default());
    let attribute = |name: &str| session.state_ref().attribute(name).unwrap().data;
    let numbers = attribute("int[4] renderer:version").to_ints().unwrap();
    let text = numbers.iter().map(ToString::to_string).collect::<Vec<_>>().join(".");
    assert_eq!(numbers.len(), 4);
    assert_eq!(attribute("string renderer:versionstring"), text.as_str().into());
}

#[test]
fn render_with_a_camera_name_renders_it_alone() {
    let place = Place::new();
    let render = |call: &str| {
        for name in ["a.tif", "b.tif"] {
            let _ = std::fs::remove_file(place.path(name));
        }
        place.quiet(&format!(
            "Attribute (\"int[2] resolution\", (8, 8))\nCamera (\"a\")\nCamera (\"b\")\n\
             Output (\"@/a.tif\", \"tiff\", \"rgb\", \"a\")\nOutput (\"@/b.tif\", \"tiff\", \"rgb\", \"b\")\nWorld ()\n{SQUARE}{call}\n"
        ));
        (place.path("a.tif").exists(), place.path("b.tif").exists())
    };
    assert_eq!(render("Render ()"), (true, true));
    assert_eq!(render("Render (\"b\")"), (false, true));
    assert_eq!(render("Render (\"a\")"), (true, false));
}
