//! Tests plugins for conversions of colours.

use crate::support::*;
use granita_tests::repository;
use std::path::Path;

/// A configuration with a transform that only a plugin can do, and a view through it.
const CONFIG: &str = "\
ocio_profile_version: 2
roles: {scene_linear: ACES, aces_interchange: ACES, default: ACES}
displays:
  screen:
    - !<View> {name: film, view_transform: film, display_colorspace: screen}
view_transforms:
  - !<ViewTransform>
    name: film
    from_scene_reference: !<BuiltinTransform> {style: ACES-OUTPUT - ACES2065-1_to_CIE-XYZ-D65 - HDR-VIDEO-1000nit-15nit-REC2020lim_1.1}
display_colorspaces:
  - !<ColorSpace>
    name: screen
    from_display_reference: !<BuiltinTransform> {style: DISPLAY - CIE-XYZ-D65_to_REC.1886-REC.709}
colorspaces:
  - !<ColorSpace> {name: ACES, encoding: scene-linear}
";

/// Writes the configuration and an image of grey 0.18.
fn prepare(folder: &Path) {
    std::fs::write(folder.join("a.ocio"), CONFIG).unwrap();
    let words =
        ["-pattern", "constant:color=0.18,0.18,0.18,0.5", "40x8", "4", "-d", "float", "-o", "grey.exr"];
    assert_eq!(tool("imgtool", folder, &words), (0, String::new(), String::new()));
}

/// Returns the output of a conversion to the view, as values.
fn seen(folder: &Path) -> (i32, String, String) {
    let words = ["-colorconfig", "a.ocio", "grey.exr", "-ociodisplay:from=ACES", "screen", "film", "-stats"];
    tool("imgtool", folder, &words)
}

#[test]
fn a_plugin_makes_the_conversions_that_are_not_supported() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    prepare(at);
    let (status, _, err) = seen(at);
    assert_eq!(status, 2);
    assert!(
        err.contains("ACES-OUTPUT") && err.contains("opencolorio.color.so does it where it is installed"),
        "{err}"
    );
    let source = own(at, "color.cpp");
    for compiler in compilers() {
        plugin(compiler, &source, "opencolorio.color.so", &[]);
        let (status, text, err) = seen(at);
        assert!(status == 0 && err.is_empty() && text.contains(" 0.36 "), "{compiler} {status} {text} {err}");
    }
    let words =
        ["-colorconfig", "a.ocio", "grey.exr", "-ociodisplay:from=ACES", "screen", "film", "-safe", "-stats"];
    let (status, _, err) = tool("imgtool", at, &words);
    assert!(status == 2 && err.contains("where it is installed"), "{err}");
}

#[test]
fn the_plugin_of_opencolorio_has_the_output_transforms_of_aces() {
    if !Path::new("/usr/include/OpenColorIO/OpenColorIO.h").exists() {
        granita_needs::skip("OpenColorIO (libopencolorio-dev)");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    prepare(at);
    let source = at.join("opencolorio.cpp");
    std::fs::copy(repository().join("bindings/cpp/color/opencolorio.cpp"), &source).unwrap();
    plugin("g++", &source, "opencolorio.color.so", &["-O1", "-lOpenColorIO"]);
    let (status, text, err) = seen(at);
    assert!(status == 0 && err.is_empty(), "{status} {text} {err}");
    // Grey 0.18 has 15 of 100 cd/m2, whose signal is 0.15 ^ (1 / 2.4).
    assert!(text.contains("0.45"), "{text}");
    let words = ["-colorconfig", "none.ocio", "grey.exr", "-ociodisplay", "screen", "film", "-stats"];
    let (status, _, err) = tool("imgtool", at, &words);
    assert!(status == 2 && err.contains("-colorconfig: none.ocio"), "{err}");
    let broken = CONFIG.replace("DISPLAY - CIE-XYZ-D65_to_REC.1886-REC.709", "DISPLAY - nonsense");
    std::fs::write(at.join("a.ocio"), broken).unwrap();
    let (status, _, err) = seen(at);
    assert!(status == 2 && err.contains("OpenColorIO 2") && err.contains("nonsense"), "{err}");
}
