//! Tests `-denoise` with a library for tests, and without one.

#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test, with a line number")]

mod folder;

use folder::Folder;
use granita_image::Limits;
use std::process::Command;

const SCENE: &str = r#"
Attribute ("int[2] resolution", (40, 30))
Attribute ("float fov", 50)
Output ("a.exr", "exr", "rgb, z", "main")
Output ("b.exr", "exr", "rgb", "main", "int denoise", 0)
Camera ("main")
World ()
Shader ("surface", "matte")
Light ("lamp", "distantlight", "float intensity", 4)
Translate (0, 0, 5)
Sphere (1, -1, 1, 360)
Render ()
"#;

/// Returns the pixels of an image, and texts that it says of itself.
fn image(folder: &Folder, name: &str) -> (Vec<f32>, [Option<String>; 4]) {
    let file = granita_plugin::bundled_formats(Limits::default()).open(&folder.path().join(name)).unwrap();
    let spec = file.spec(0, 0).unwrap();
    let text = |name: &str| spec.string(&format!("granita/{name}")).map(str::to_owned);
    let said = ["denoised", "filter", "filter/rgb", "render:samples"].map(text); // tidy: attribute: names of metadata
    (file.read_level(0, 0).unwrap().to_floats(), said)
}

#[test]
fn images_are_denoised_with_the_named_library() {
    if !granita_needs::has("cc") {
        return;
    }
    let folder = Folder::with(&[("scene.pyg", SCENE)]);
    let source = concat!(env!("CARGO_MANIFEST_DIR"), "/../../libs/plugin/tests/denoiser.c");
    let library = folder.path().join("libOpenImageDenoise.so");
    let mut compile = Command::new("cc");
    compile.args(["-shared", "-fPIC", "-DNEW", "-o"]).arg(&library).arg(source);
    assert!(compile.status().unwrap().success());
    let named = format!("render:denoiselibrary={}", folder.path().display()); // tidy: attribute: a command line
    let ran = folder.run(&["-denoise", "-set", &named, "-statistics", "scene.pyg"]);
    assert_eq!(ran.status, 0, "{}", ran.said);
    assert!(ran.said.contains("by Open Image Denoise 2.5.1: "), "{}", ran.said);
    let (clean, said) = image(&folder, "a.exr");
    let text = |text: &str| Some(text.to_owned());
    assert_eq!(said, [text("Open Image Denoise 2.5.1"), None, text("box 1 1"), text("0.25")]);
    let (noisy, said) = image(&folder, "b.exr");
    assert_eq!(said, [None, text("gaussian 2 2"), None, text("0.25")]);
    // The library for tests adds a quarter of the albedo, which is 1 on the sphere, and a quarter of the normal, which
    // faces the eye here.
    let (middle, plain) = (clean[4 * (15 * 40 + 20)], noisy[3 * (15 * 40 + 20)]);
    assert!(plain > 1.0 && (middle - 0.25 - 0.5 * plain).abs() < 0.03, "{middle} {plain}");
    // As it is: the filter alone changes.
    let ran = folder.run(&["-set", "render:denoise=2", "-set", &named, "scene.pyg"]); // tidy: attribute: the same
    assert_eq!(ran.status, 0, "{}", ran.said);
    assert_eq!(image(&folder, "a.exr").1, [text("Open Image Denoise 2.5.1"), None, text("box 1 1"), None]);
    // Workers render the same pixels.
    let ran = folder.run(&["-denoise", "-net", "local local", "-set", &named, "scene.pyg"]);
    assert_eq!(ran.status, 0, "{}", ran.said);
    assert!(image(&folder, "a.exr").0 == clean);
}

#[test]
fn without_a_library_images_keep_their_noise() {
    let folder = Folder::with(&[("scene.pyg", SCENE)]);
    let named = "render:denoiselibrary=nowhere/oidn.so"; // tidy: attribute: a command line
    let ran = folder.run(&["-denoise", "-set", named, "scene.pyg"]);
    assert_eq!(ran.status, 1, "{}", ran.said);
    assert!(ran.said.contains("error: images keep their noise: nowhere/oidn.so: "), "{}", ran.said);
    assert_eq!(image(&folder, "a.exr").1[0], None);
    let ran = folder.run(&["-safe", "-set", "render:denoise=1", "scene.pyg"]); // tidy: attribute: the same
    assert!(ran.said.contains("which -safe does not permit"), "{}", ran.said);
    let ran = folder.run(&["-safe", "-denoise", "scene.pyg"]);
    assert_eq!(ran.status, 2, "{}", ran.said);
}
