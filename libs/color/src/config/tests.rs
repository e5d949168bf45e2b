// tidy: tests
//! Tests of configurations.

use super::*;
use std::f32::consts::{FRAC_1_SQRT_2, SQRT_2};
use values::VALUES;

#[path = "values.rs"]
mod values;

fn config(text: &str) -> Config {
    Config::from_text(text, Path::new("show.ocio"), &Environment::default()).unwrap()
}

fn near(got: [f32; 3], expected: [f32; 3], tolerance: f32) -> bool {
    got.iter().zip(expected).all(|(a, b)| (a - b).abs() <= tolerance * b.abs().max(1e-2))
}

const SHOW: &str = "
ocio_profile_version: 2
search_path: luts
roles: {scene_linear: lin, default: raw}
displays:
  screen:
    - !<View> {name: Plain, colorspace: enc}
    - !<View> {name: Graded, colorspace: enc, looks: grade}
    - !<View> {name: Data, colorspace: raw}
active_views: [Graded, Plain]
inactive_colorspaces: [hidden]
looks:
  - !<Look> {name: grade, process_space: lin, transform: !<MatrixTransform> {matrix: [2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 1]}}
colorspaces:
  - !<ColorSpace> {name: lin, aliases: [linear], encoding: scene-linear}
  - !<ColorSpace> {name: enc, to_scene_reference: !<ExponentTransform> {value: 2}}
  - !<ColorSpace> {name: raw, isdata: true}
  - !<ColorSpace> {name: hidden, equalitygroup: g}
  - !<ColorSpace> {name: double, equalitygroup: g, from_scene_reference: !<MatrixTransform> {matrix: [2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 1]}}
  - !<ColorSpace>
    name: grading
    from_scene_reference: !<GroupTransform>
      children:
        - !<GradingToneTransform> {style: log}
        - !<FixedFunctionTransform> {style: ACES_RedMod03}
  - !<ColorSpace> {name: file, from_scene_reference: !<FileTransform> {src: a.spimtx}}
  - !<ColorSpace> {name: circle, from_scene_reference: !<ColorSpaceTransform> {src: lin, dst: circle}}
  - !<ColorSpace> {name: lost, from_scene_reference: !<ColorSpaceTransform> {src: lin, dst: nowhere}}
named_transforms:
  - !<NamedTransform> {name: half, transform: !<MatrixTransform> {matrix: [0.5, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, 0.5, 0, 0, 0, 0, 1]}}
";

#[test]
fn built_in_spaces_have_published_values() {
    // The values were computed by OpenColorIO 2.6 with its configuration studio-config-v5.0.0_aces-v2.1_ocio-v2.6.
    let config = Config::built_in();
    assert!(config.color_spaces().count() > 50);
    for (from, to, input, expected) in VALUES {
        let got = config.processor(from, to).unwrap().map(*input);
        assert!(near(got, *expected, 2e-5), "{from} to {to}: {got:?}, expected {expected:?}");
        let back = config.processor(to, from).unwrap().map(got);
        assert!(near(back, *input, 1e-4), "{to} to {from}: {back:?}, expected {input:?}");
    }
}

#[test]
fn all_built_in_conversions_compile() {
    let config = Config::built_in();
    let names: Vec<&str> = config.color_spaces().map(|space| &*space.name).collect();
    for from in &names {
        let there = config.processor(from, "ACES2065-1").unwrap();
        let back = config.processor("ACES2065-1", from).unwrap();
        let got = back.map(there.map([0.3, 0.4, 0.5]));
        assert!(near(got, [0.3, 0.4, 0.5], 1e-3), "{from}: {got:?}");
    }
    for display in config.displays() {
        let views = config.views(display);
        assert!(
            views.len() >= 3 && (views[0], views[views.len() - 1]) == ("Un-tone-mapped", "Raw"),
            "{views:?}"
        );
        for view in config.views(display) {
            let processor = config.display_processor("ACEScg", display, view).unwrap();
            assert_eq!(processor.is_identity(), view == "Raw", "{display} {view}");
        }
    }
    let error = config.display_processor("ACEScg", "sRGB - Display", "ACES 2.0 - SDR 100 nits (Rec.709)");
    let error = error.unwrap_err().to_string();
    assert!(
        error.ends_with(
            "; output transforms of ACES for high dynamic range and of version 2 are not built in"
        ),
        "{error}"
    );
}

#[test]
fn names_aliases_and_roles_are_found() {
    let config = Config::built_in();
    for (name, expected) in [
        ("lin_srgb", "Linear Rec.709 (sRGB)"),
        ("SRGB - texture", "sRGB Encoded Rec.709 (sRGB)"),
        ("scene_linear", "ACEScg"),
        ("Utility - Raw", "Raw"),
        ("CIE-XYZ-D65", "CIE XYZ-D65 - Display-referred"),
        ("rec709_camera", "Camera Rec.709"),
    ] {
        assert_eq!(config.color_space(name).unwrap().name, expected);
    }
    let error = config.processor("ACEScgg", "raw").unwrap_err().to_string();
    assert_eq!(error, "the built-in configuration has no colour space \"ACEScgg\"; did you mean \"ACEScg\"?");
    assert_eq!(config.scene_linear(), Some("ACEScg"));
    assert_eq!(config.looks().count(), 1);
    for name in BUILT_IN {
        assert!(Config::open(&format!("ocio://{name}"), &Environment::default()).is_ok());
    }
    assert!(Config::open("ocio://other", &Environment::default()).is_err());
}

#[test]
fn levels_are_made_in_the_linear_space_of_the_same_primaries() {
    let config = Config::built_in();
    for (space, expected) in [
        ("srgb", Some("Linear Rec.709 (sRGB)")),
        ("ACEScct", Some("ACEScg")),
        ("lin_p3d65", Some("Linear P3-D65")),
        ("srgb_p3d65", Some("Linear P3-D65")),
        ("Raw", None),
        ("nothing", None),
    ] {
        assert_eq!(config.linear_for(space), expected, "{space}");
    }
    assert_eq!(super::tests::config(SHOW).linear_for("enc"), Some("lin"));
}

#[test]
fn conversions_follow_the_configuration() {
    let c = config(SHOW);
    let of = |from, to| c.processor(from, to).unwrap().map([0.25, 0.5, 1.0]);
    assert_eq!(of("enc", "LIN"), [0.0625, 0.25, 1.0]);
    assert!(near(of("linear", "enc"), [0.5, FRAC_1_SQRT_2, 1.0], 1e-6));
    assert_eq!(of("enc", "raw"), [0.25, 0.5, 1.0]);
    assert_eq!(of("hidden", "double"), [0.25, 0.5, 1.0], "one group");
    assert_eq!(of("lin", "double"), [0.5, 1.0, 2.0]);
    assert_eq!(of("half", "lin"), [0.125, 0.25, 0.5]);
    assert_eq!(of("lin", "half"), [0.5, 1.0, 2.0]);
    assert_eq!(c.color_spaces().filter(|space| space.name == "hidden").count(), 0);
    assert!(c.processor("lin", "lin").unwrap().is_identity());
}

#[test]
fn views_have_looks_and_an_order() {
    let c = config(SHOW);
    assert_eq!((c.default_display(), c.default_view("screen")), ("screen", "Graded"));
    assert_eq!(c.views("screen"), ["Graded", "Plain"]);
    let of = |view| c.display_processor("scene_linear", "screen", view).map(|p| p.map([0.125, 0.5, 2.0]));
    assert_eq!(of("Graded").unwrap(), [0.5, 1.0, 2.0]);
    assert!(near(of("plain").unwrap(), [0.353_553_4, FRAC_1_SQRT_2, SQRT_2], 1e-6));
    assert_eq!(of("Data").unwrap(), [0.125, 0.5, 2.0]);
    assert_eq!(
        of("None").unwrap_err().to_string(),
        "show.ocio: display \"screen\" has no view \"None\"; it has Graded, Plain"
    );
    let error = c.display_processor("lin", "wall", "Plain").unwrap_err().to_string();
    assert_eq!(error, "show.ocio has no display \"wall\"; it has screen");
    let looks = |looks| c.look_processor("lin", "lin", looks).map(|p| p.map([1.0; 3])[0]);
    assert_eq!(
        (looks("grade").unwrap(), looks("-grade").unwrap(), looks("grade, +grade").unwrap()),
        (2.0, 0.5, 4.0)
    );
    assert_eq!(looks("none | grade").unwrap(), 2.0);
    assert_eq!(looks("none").unwrap_err().to_string(), "show.ocio has no look \"none\"");
}

#[test]
fn output_transforms_of_aces_have_published_values() {
    // Of OpenColorIO 2.6, to CIE XYZ under D65.
    for (style, rgb, xyz) in [
        ("VIDEO_1.0", [0.18; 3], [0.098_906_76, 0.104_062_48, 0.113_329_99]),
        ("VIDEO_1.0", [1.0; 3], [0.593_389_15, 0.624_320_5, 0.679_921_15]),
        ("VIDEO_1.0", [0.5, 0.1, 0.05], [0.280_863_08, 0.139_805_36, 0.027_029_56]),
        ("VIDEO_1.0", [0.05, 0.3, 0.9], [0.125_415_74, 0.152_162_1, 0.617_437_9]),
        ("VIDEO_1.0", [16.0; 3], [0.949_894_3, 0.999_409_1, 1.088_414_3]),
    ] {
        let style = format!("ACES-OUTPUT - ACES2065-1_to_CIE-XYZ-D65 - SDR-{style}");
        let text = format!(
            "ocio_profile_version: 2\nroles: {{scene_linear: a}}\ncolorspaces:\n  - !<ColorSpace> {{name: a}}\n  - !<ColorSpace> {{name: xyz, from_scene_reference: !<BuiltinTransform> {{style: {style}}}}}\n"
        );
        let found = config(&text).processor("a", "xyz").unwrap().map(rgb);
        assert!(near(found, xyz, 2e-5), "{style} {rgb:?}: {found:?}");
    }
}

#[test]
fn what_is_not_supported_is_one_message_when_it_is_needed() {
    let c = config(SHOW);
    assert_eq!(
        c.processor("lin", "grading").unwrap_err().to_string(),
        "show.ocio:24: the transform GradingToneTransform; show.ocio:25: the transform FixedFunctionTransform of the style ACES_RedMod03 is not supported"
    );
    assert_eq!(
        c.processor("lin", "file").unwrap_err().to_string(),
        "show.ocio:26: the file \"a.spimtx\" is not found in luts"
    );
    let circle = c.processor("lin", "circle").unwrap_err().to_string();
    assert_eq!(circle, "show.ocio:27: transforms name each other in a circle");
    assert_eq!(
        c.processor("lin", "lost").unwrap_err().to_string(),
        "show.ocio:28: show.ocio has no colour space \"nowhere\""
    );
}

#[test]
fn files_are_found_with_variables_of_the_environment() {
    let folder = tempfile::tempdir().unwrap();
    let text = "ocio_profile_version: 1
environment: {SHOT: a}
search_path: \"luts:more/$SHOT\"
roles: {}
colorspaces:
  - !<ColorSpace> {name: lin}
  - !<ColorSpace> {name: m, from_reference: !<FileTransform> {src: \"${SHOT}.spimtx\"}}
  - !<ColorSpace> {name: cube, from_reference: !<FileTransform> {src: c.cube, interpolation: tetrahedral}}
  - !<ColorSpace> {name: curve, to_reference: !<FileTransform> {src: c.spi1d}}
  - !<ColorSpace> {name: cc, from_reference: !<FileTransform> {src: c.ccc, cccid: two}}
";
    let path = folder.path().join("config.ocio");
    std::fs::write(&path, text).unwrap();
    for name in ["a", "b"] {
        let folder = folder.path().join("more").join(name);
        std::fs::create_dir_all(&folder).unwrap();
        let v = if name == "a" { 2 } else { 3 };
        std::fs::write(folder.join(format!("{name}.spimtx")), format!("{v} 0 0 0 0 {v} 0 0 0 0 {v} 0"))
            .unwrap();
    }
    let luts = folder.path().join("luts");
    std::fs::create_dir_all(&luts).unwrap();
    std::fs::write(luts.join("c.spi1d"), "Version 1\nFrom 0 1\nLength 3\nComponents 1\n{\n0\n0.25\n1\n}\n")
        .unwrap();
    let one = |id: &str, slope: &str| {
        format!(
            "<ColorCorrection id=\"{id}\"><SOPNode><Slope>{slope}</Slope><Offset>0 0 0</Offset><Power>1 1 1</Power></SOPNode></ColorCorrection>"
        )
    };
    let list = format!(
        "<ColorCorrectionCollection>{}{}</ColorCorrectionCollection>",
        one("x", "1 1 1"),
        one("two", "2 2 2")
    );
    std::fs::write(luts.join("c.ccc"), list).unwrap();
    let c = Config::from_file(&path, &Environment::default()).unwrap();
    let of = |c: &Config, from, to| c.processor(from, to).unwrap().map([0.5, 0.25, 0.125]);
    assert_eq!(of(&c, "lin", "m"), [1.0, 0.5, 0.25]);
    assert_eq!(of(&c, "curve", "lin"), [0.25, 0.125, 0.0625]);
    assert_eq!(of(&c, "lin", "curve")[1], 0.5);
    assert_eq!(of(&c, "lin", "cc"), [1.0, 0.5, 0.25]);
    let mut environment = Environment::default();
    environment.set("SHOT", "b");
    let other = Config::from_file(&path, &environment).unwrap();
    assert_eq!(of(&other, "lin", "m"), [1.5, 0.75, 0.375]);
    let error = c.processor("lin", "cube").unwrap_err().to_string();
    assert!(error.contains("config.ocio:8: the file \"c.cube\" is not found in "), "{error}");
    std::fs::write(luts.join("c.cube"), "LUT_3D_SIZE 2\n0 0 0\n").unwrap();
    let error = c.processor("lin", "cube").unwrap_err().to_string();
    assert!(error.ends_with("c.cube:2: 1 rows, and the sizes name 8"), "{error}");
    let error = Config::from_file(Path::new("/no/such.ocio"), &environment).unwrap_err().to_string();
    assert!(error.starts_with("/no/such.ocio: "), "{error}");
}

#[test]
fn version_one_has_its_own_decision_lists() {
    let text = |version| {
        format!(
            "ocio_profile_version: {version}\ncolorspaces:\n  - !<ColorSpace> {{name: lin}}\n  - !<ColorSpace> {{name: g, from_reference: !<CDLTransform> {{slope: [1, 1, 1], offset: [-0.5, 0, 0], power: [2, 2, 2], sat: 1}}}}\n"
        )
    };
    let of = |version| config(&text(version)).processor("lin", "g").unwrap().map([0.25, 0.5, 2.0]);
    assert_eq!(of(1), [0.0, 0.25, 4.0]);
    assert_eq!(of(2), [-0.25, 0.25, 4.0]);
}

#[test]
fn rules_find_spaces_of_files() {
    let c = Config::built_in();
    assert_eq!(c.space_of_file("a/b.EXR"), Some("ACES2065-1"));
    assert_eq!(c.space_of_file("a/b.mov"), Some("Rec.1886 Rec.709 - Display"));
    assert_eq!(c.space_of_file("a/b.png"), Some("sRGB - Display"));
    assert_eq!(c.space_in_path("x/wall_ACEScg_lin_srgb.tif"), Some("Linear Rec.709 (sRGB)"));
    let c = config(
        "ocio_profile_version: 2\nroles: {default: raw}\nfile_rules:\n  - !<Rule> {name: ColorSpaceNamePathSearch}\n  - !<Rule> {name: t, colorspace: raw, pattern: \"*tex*\", extension: \"[ej]*\"}\n  - !<Rule> {name: Default, colorspace: lin}\ncolorspaces:\n  - !<ColorSpace> {name: lin}\n  - !<ColorSpace> {name: raw}\n  - !<ColorSpace> {name: enc}\n",
    );
    assert_eq!(c.space_of_file("a/x_enc.png"), Some("enc"));
    assert_eq!(c.space_of_file("tex/x.exr"), Some("raw"));
    assert_eq!(c.space_of_file("tex/x.png"), Some("lin"));
    assert_eq!(config(SHOW).space_of_file("x.png"), Some("raw"));
}

#[test]
fn damaged_configurations_name_the_line() {
    for (text, expected) in [
        ("a: b\n", "show.ocio:1: ocio_profile_version is missing"),
        ("ocio_profile_version: 3\n", "show.ocio:1: the version is neither 1 nor 2"),
        (
            "ocio_profile_version: 2\ncolorspaces:\n  - !<ColorSpace> {family: x}\n",
            "show.ocio:3: name is missing",
        ),
        (
            "ocio_profile_version: 2\ncolorspaces:\n  - !<ColorSpace>\n    name: x\n    to_reference: !<MatrixTransform> {matrix: [1, 2]}\n",
            "show.ocio:5: 2 numbers, and 16 are needed",
        ),
        (
            "ocio_profile_version: 2\ncolorspaces:\n  - !<ColorSpace> {name: x, to_reference: {a: 1}}\n",
            "show.ocio:3: a transform without its kind, such as !<MatrixTransform>",
        ),
        (
            "ocio_profile_version: 2\ncolorspaces:\n  - !<ColorSpace> {name: x, to_reference: !<LogTransform> {base: e}}\n",
            "show.ocio:3: \"e\" is not a number",
        ),
        ("ocio_profile_version: 2\nroles: [", "show.ocio:3: "),
    ] {
        let error = Config::from_text(text, Path::new("show.ocio"), &Environment::default()).unwrap_err();
        assert!(error.to_string().starts_with(expected), "{error}");
    }
}
