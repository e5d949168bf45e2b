// tidy: tests
//! Tests of the colours of pages.

use super::*;
use granita_base::{Environment, Param};
use std::path::Path;

fn spec(pixel_type: PixelType) -> ImageSpec {
    ImageSpec::new(1, 1, 3, pixel_type)
}

fn with(mut spec: ImageSpec, declared: &str, values: &[f32]) -> ImageSpec {
    spec.attributes.set(Param::declared(declared, values).unwrap());
    spec
}

fn named(mut spec: ImageSpec, name: &str, text: &str) -> ImageSpec {
    spec.attributes.set(Param::declared(&format!("string {name}"), text).unwrap());
    spec
}

fn ints(mut spec: ImageSpec, declared: &str, values: &[i32]) -> ImageSpec {
    spec.attributes.set(Param::declared(declared, values).unwrap());
    spec
}

/// Returns the text, and the linear light of a colour.
fn of(spec: &ImageSpec, rgb: [f32; 3]) -> (String, Option<[f32; 3]>) {
    let colors = Colors::of(spec);
    (colors.text, colors.managed.map(|managed| managed.to_linear.map(rgb)))
}

fn near(a: Option<[f32; 3]>, b: [f32; 3]) -> bool {
    a.is_some_and(|a| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 2e-3))
}

#[test]
fn files_that_say_nothing_are_assumed_to_be_srgb_or_linear() {
    assert_eq!(of(&spec(PixelType::U8), [0.5; 3]), ("sRGB (assumed of integers)".to_owned(), None));
    assert_eq!(of(&spec(PixelType::Half), [0.5; 3]), ("linear, Rec. 709 (assumed)".to_owned(), None));
}

#[test]
fn chunks_of_png_are_respected() {
    let (text, found) = of(&ints(spec(PixelType::U8), "int png:sRGB", &[0]), [0.5; 3]);
    assert_eq!((text.as_str(), found), ("sRGB (PNG chunk sRGB)", None));
    let (text, found) = of(&with(spec(PixelType::U8), "float png:gAMA", &[1.0]), [0.5; 3]);
    assert_eq!(text, "Rec. 709, linear (PNG chunk gAMA)");
    assert!(near(found, [0.5; 3]));
    let (text, found) = of(&with(spec(PixelType::U8), "float png:gAMA", &[0.5]), [0.5; 3]);
    assert!(text.starts_with("Rec. 709, gamma 2.000") && near(found, [0.25; 3]));
    let p3 = [0.3127, 0.3290, 0.68, 0.32, 0.265, 0.69, 0.15, 0.06];
    let wide = with(with(spec(PixelType::U16), "float[8] png:cHRM", &p3), "float png:gAMA", &[0.45455]);
    let (text, found) = of(&wide, [0.0, 1.0, 0.0]);
    assert_eq!(text, "P3 (D65), the curve of sRGB (PNG chunks gAMA and cHRM)");
    assert!(near(found, [-0.2249, 1.0421, -0.0786]), "{found:?}");
    // Nonsense is ignored.
    let flat = with(spec(PixelType::U8), "float[8] png:cHRM", &[0.3; 8]);
    assert_eq!(of(&flat, [0.5; 3]).0, "sRGB (assumed of integers)");
}

#[test]
fn numbers_of_video_come_first() {
    let hdr = ints(ints(spec(PixelType::U16), "int png:sRGB", &[0]), "int[4] CICP", &[9, 16, 0, 1]);
    let (text, found) = of(&hdr, [0.580_688_9; 3]);
    assert!(
        text.starts_with("Rec. 2020, PQ, 203 cd/m2 shown as 1") && near(found, [1.0; 3]),
        "{text} {found:?}"
    );
    let unknown = ints(spec(PixelType::U16), "int[4] CICP", &[2, 2, 0, 1]);
    assert_eq!(of(&unknown, [0.5; 3]), ("sRGB (assumed of integers); CICP is not known".to_owned(), None));
}

#[test]
fn chromaticities_of_openexr_are_respected() {
    let ap1 = [0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.32168, 0.33767];
    let (text, found) = of(&with(spec(PixelType::Half), "float[8] chromaticities", &ap1), [1.0, 0.0, 0.0]);
    assert_eq!(text, "linear, ACES AP1 (chromaticities)");
    assert!(near(found, [1.7051, -0.1303, -0.0240]), "{found:?}");
    let rec709 = [0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.3290];
    let (text, found) = of(&with(spec(PixelType::Half), "float[8] chromaticities", &rec709), [0.5; 3]);
    assert!(text == "linear, Rec. 709 (chromaticities)" && found.is_none(), "{found:?}");
}

#[test]
fn film_exif_and_names_are_respected() {
    let (text, found) =
        of(&named(spec(PixelType::U16), "dpx:Transfer", "Printing density"), [685.0 / 1023.0; 3]);
    assert!(text.contains("film densities") && near(found, [1.0; 3]), "{text}");
    let (text, _) = of(&named(spec(PixelType::U16), "dpx:Transfer", "ITU-R 709-4"), [0.5; 3]);
    assert_eq!(text, "Rec. 709, the curve of BT.709 (DPX: ITU-R 709-4)");
    assert_eq!(
        of(&ints(spec(PixelType::U8), "int Exif:ColorSpace", &[1]), [0.5; 3]),
        ("sRGB (Exif)".to_owned(), None)
    );
    let (text, found) = of(&ints(spec(PixelType::U8), "int Exif:ColorSpace", &[2]), [1.0; 3]);
    assert!(text == "Adobe RGB (Exif)" && near(found, [1.0; 3]));
    let (text, found) = of(&named(spec(PixelType::Half), "colorInteropID", "lin_ap1_scene"), [0.5; 3]);
    assert!(text == "lin_ap1_scene (colorInteropID)" && near(found, [0.5; 3]));
}

#[test]
fn profiles_that_cannot_be_used_are_named() {
    let mut broken = spec(PixelType::U8);
    broken.set_icc_profile(vec![1; 200]);
    let (text, found) = of(&broken, [0.5; 3]);
    assert!(
        text.starts_with("sRGB (assumed of integers); \"200 bytes\" is not applied: ") && found.is_none(),
        "{text}"
    );
}

#[test]
fn views_of_the_built_in_configuration_show_srgb_as_it_is() {
    let viewing = Viewing::new(Config::built_in(), None, None, None).unwrap();
    assert_eq!((viewing.display(), viewing.view()), ("sRGB - Display", "Un-tone-mapped"));
    let colors = viewing.colors(&spec(PixelType::U8), "a.png");
    assert_eq!(colors.text, "sRGB (assumed of integers); seen through sRGB - Display, Un-tone-mapped");
    let managed = colors.managed.unwrap();
    let shown = managed.to_screen.unwrap().map(managed.to_linear.map([0.2, 0.5, 0.8]));
    assert!(near(Some(shown), [0.2, 0.5, 0.8]), "{shown:?}");
    let aces = Viewing::new(Config::built_in(), Some("ACEScg"), None, None).unwrap();
    let colors = aces.colors(&spec(PixelType::Half), "a.exr");
    assert!(
        colors.text.starts_with("ACEScg (-colorspace); ") && colors.managed.unwrap().to_linear.is_identity()
    );
    let raw = viewing.with_view("sRGB - Display", Some("Raw")).unwrap().colors(&spec(PixelType::U8), "a.png");
    let raw = raw.managed.unwrap();
    assert!(raw.to_linear.is_identity() && raw.to_screen.unwrap().is_identity());
    assert!(Viewing::new(Config::built_in(), Some("no"), None, None).is_err());
    assert!(Viewing::new(Config::built_in(), None, Some("no"), None).is_err());
}

#[test]
fn rules_of_a_configuration_apply_to_files_that_say_nothing() {
    let text = "ocio_profile_version: 2\nroles: {scene_linear: lin}\nfile_rules:\n  - !<Rule> {name: Default, colorspace: half}\ndisplays:\n  d:\n    - !<View> {name: v, colorspace: lin}\ncolorspaces:\n  - !<ColorSpace> {name: lin, aliases: [lin_srgb]}\n  - !<ColorSpace> {name: half, to_scene_reference: !<MatrixTransform> {matrix: [2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 1]}}\n";
    let config = Config::from_text(text, Path::new("c.ocio"), &Environment::default()).unwrap();
    let viewing = Viewing::new(config, None, None, None).unwrap();
    let colors = viewing.colors(&spec(PixelType::U8), "a.png");
    assert_eq!(colors.text, "half (rule of the configuration); seen through d, v");
    assert_eq!(colors.managed.unwrap().to_linear.map([0.5; 3]), [1.0; 3]);
    let own = viewing.colors(&ints(spec(PixelType::U8), "int png:sRGB", &[0]), "a.png");
    assert!(
        own.text.starts_with("sRGB (PNG chunk sRGB); ")
            && near(Some(own.managed.unwrap().to_linear.map([0.5; 3])), [0.214; 3])
    );
}
