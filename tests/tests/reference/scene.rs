//! Tests attributes of whole scenes (reference 4.3).

use crate::support::{CAMERA, Place, SHADERS, SQUARE, asks, scene};
use granita_base::Reporter;
use granita_scene::SceneSink as _;
use granita_session::{Session, SessionOptions};

#[test]
fn shaders_read_the_pass_attribute() {
    let place = Place::new();
    let square = asks(
        &place,
        "",
        "string p = \"none\"; float known = getattribute (\"pass\", p); C = color (known, p == \"beauty\", p == \"\");",
    );
    let with = |line: &str| place.seen(&format!("{SHADERS}{line}"), &square).pixel(3, 3).unwrap().to_vec();
    assert_eq!(with("")[..3], [1.0, 0.0, 1.0]);
    assert_eq!(with("Attribute (\"string pass\", \"beauty\")")[..3], [1.0, 1.0, 0.0]);
}

#[test]
fn depths_skip_surfaces_below_the_opacity_threshold() {
    let place = Place::new();
    let depth = |line: &str, opacity: &str| {
        let out = "Output (\"@/z.tif\", \"tiff\", \"z\", \"camera\", \"int[4] quantize\", (0, 0, 0, 0), \"float dither\", 0)\n";
        let veil = format!(
            "PushAttributes ()\nAttribute (\"color opacity\", {opacity})\n{SQUARE}PopAttributes ()\n"
        );
        let wall = format!("Translate (0, 0, 2)\n{SQUARE}");
        place.quiet(&scene(&format!("{out}{line}"), &format!("{veil}{wall}")));
        place.image("z.tif").pixel(5, 5).unwrap()[0]
    };
    let threshold = "Attribute (\"color shadow:opacitythreshold\", (0.5, 0.5, 0.5))\n";
    assert_eq!(depth("", "(0.99, 0.99, 0.99)"), 7.0);
    assert_eq!(depth("", "(1, 1, 1)"), 5.0);
    assert_eq!(depth(threshold, "(0.6, 0.6, 0.6)"), 5.0);
    assert_eq!(depth(threshold, "(0.4, 0.4, 0.4)"), 7.0);
    // One channel above the threshold is enough.
    assert_eq!(depth(threshold, "(0.1, 0.6, 0.1)"), 5.0);
}

#[test]
fn the_attribute_sets_the_number_of_threads() {
    let small = "Attribute (\"int[2] limits:bucketsize\", (4, 4))\n";
    let rendered = |line: &str, threads: usize, default_threads: usize| {
        let options = SessionOptions { threads, default_threads, ..SessionOptions::default() };
        Place::new().render_with(&scene(&format!("{small}{line}"), SQUARE), options).counts().threads
    };
    let set = |n: i32| format!("Attribute (\"int limits:threads\", {n})");
    assert_eq!([rendered("", 0, 0), rendered(&set(3), 0, 0)], [1, 3]);
    // The default of the program applies to scenes that do not set the number, and an option to all.
    assert_eq!([rendered("", 0, 4), rendered(&set(1), 0, 4), rendered(&set(3), 2, 4)], [4, 1, 2]);
}

/// Writes an image of one colour that is not a MIP map.
fn image(place: &Place, name: &str, rgb: [u8; 3]) {
    let bytes = [b"P6 8 8 255\n".to_vec(), rgb.repeat(64)].concat();
    std::fs::write(place.path(name), bytes).unwrap();
}

/// Makes a texture of an image.
fn made(place: &Place, from: &str, to: &str, options: granita_texture::make::MakeOptions) {
    let formats = granita_plugin::bundled_formats(granita_image::Limits::default());
    granita_texture::make::make(&[place.path(from)], &place.path(to), &options, &formats, &|_, _| ())
        .unwrap();
}

const TEXTURED: &str = "C = (color) texture (\"t.ppm\", u, v, \"fill\", 0.25);";

#[test]
fn textures_are_found_along_their_path() {
    let place = Place::new();
    for (folder, rgb) in [("a", [255, 0, 0]), ("b", [0, 255, 0])] {
        std::fs::create_dir(place.path(folder)).unwrap();
        image(&place, &format!("{folder}/t.ppm"), rgb);
    }
    let square = asks(&place, "", TEXTURED);
    for (path, wanted) in
        [("@/a:@/b", [1.0, 0.0, 0.0]), ("@/none:@/b:@/a", [0.0, 1.0, 0.0]), ("@/none", [0.25; 3])]
    {
        let line = format!("{SHADERS}Attribute (\"string path:texture\", \"{path}\")");
        place.render(&scene(&line, &square));
        assert_eq!(place.image("out.tif").pixel(4, 4).unwrap()[..3], wanted, "{path}");
    }
}

#[test]
fn mip_maps_are_made_unless_switched_off() {
    let place = Place::new();
    image(&place, "t.ppm", [0, 0, 255]);
    let square = asks(&place, "", TEXTURED);
    let path = format!("{SHADERS}Attribute (\"string path:texture\", \"@\")\n");
    let made = place.render(&scene(&path, &square));
    assert_eq!(place.image("out.tif").pixel(4, 4).unwrap()[..3], [0.0, 0.0, 1.0]);
    assert_eq!((made.shading().texture_automipmaps, made.outcome.errors), (1, 0));
    let not = place.render(&scene(&format!("{path}Attribute (\"int texture:automipmap\", 0)"), &square));
    assert_eq!(place.image("out.tif").pixel(4, 4).unwrap()[..3], [0.25; 3]);
    assert_eq!(not.shading().texture_automipmaps, 0);
    assert!(not.said.iter().any(|s| s.contains("texture:automipmap is 0")), "{:?}", not.said);
}

#[test]
fn the_texture_memory_limit_is_kept() {
    let place = Place::new();
    let noise = |i: u32| (i.wrapping_mul(2_654_435_761) >> 24) as u8;
    let bytes = [b"P6 512 512 255\n".to_vec(), (0..512 * 512 * 3).map(noise).collect()].concat();
    std::fs::write(place.path("n.ppm"), bytes).unwrap();
    made(&place, "n.ppm", "n.tx", granita_texture::make::MakeOptions::default());
    let square = asks(
        &place,
        "",
        "C = (color) texture (\"@/n.tx\", u, v, \"width\", 0) + (color) texture (\"@/n.tx\", v, u, \"width\", 0);",
    );
    let with = |kilobytes: u32| {
        let memory = format!("{SHADERS}Attribute (\"int limits:texturememory\", {kilobytes})");
        let rendered = place.quiet(&scene(&memory, &square));
        let counts = rendered.shading();
        (place.image("out.tif"), counts.texture_bytes_peak, counts.texture_tiles_read)
    };
    let (all, few) = (with(20480), with(64));
    assert!(all.0 == few.0, "the pixels are the same");
    assert!(all.1 > 300_000 && few.1 < 150_000, "{} {}", all.1, few.1);
    assert!(few.2 > all.2, "{} {}", few.2, all.2);
}

#[test]
fn substitutes_replace_all_textures_and_environments() {
    let place = Place::new();
    image(&place, "t.ppm", [255, 0, 0]);
    image(&place, "grey.ppm", [128, 128, 128]);
    let mode = granita_texture::make::Mode::EnvLatLong;
    made(&place, "grey.ppm", "grey.env", granita_texture::make::MakeOptions { mode, ..Default::default() });
    let square = asks(
        &place,
        "",
        "color t = texture (\"@/t.ppm\", u, v), e = environment (\"@/none.env\", N); \
         C = color (t[0], t[1], e[0]);",
    );
    let with = |lines: &str| {
        let rendered = place.render(&scene(&format!("{SHADERS}{lines}"), &square));
        let missing = rendered.said.iter().any(|s| s.contains("none.env"));
        (place.image("out.tif").pixel(4, 4).unwrap()[..3].to_vec(), missing)
    };
    let half = 128.0 / 255.0;
    let texture = "Attribute (\"string texture:substtexture\", \"@/grey.ppm\")\n";
    let environment = "Attribute (\"string texture:substenv\", \"@/grey.env\")\n";
    assert_eq!(with(""), (vec![1.0, 0.0, 0.0], true));
    for (lines, wanted, missing) in [
        (texture.to_owned(), [half, half, 0.0], true),
        (environment.to_owned(), [1.0, 0.0, half], false),
        (format!("{texture}{environment}"), [half, half, half], false),
    ] {
        let (color, told) = with(&lines);
        crate::support::assert_near(&color, &wanted, 1e-5, &lines);
        assert_eq!(told, missing, "{lines}");
    }
}

#[test]
fn grid_dumps_are_text_or_binary() {
    let place = Place::new();
    let dumped = |line: &str| {
        let dump = format!("Attribute (\"string griddump:filename\", \"@/grids.pyg\")\n{line}");
        place.quiet(&scene(&dump, SQUARE));
        std::fs::read(place.path("grids.pyg")).unwrap()
    };
    let (text, binary) = (dumped(""), dumped("Attribute (\"int griddump:binary\", 1)"));
    assert!(text.is_ascii() && !binary.is_ascii());
    assert!(binary.len() < text.len(), "{} {}", binary.len(), text.len());
}

#[test]
fn programs_are_echoed_on_request() {
    let place = Place::new();
    let said = |more: &str| {
        place
            .render(&format!("Command (\"system\", \"string[2] command\", (\"true\", \"word\"){more})\n"))
            .said
    };
    assert_eq!(said(""), Vec::<String>::new());
    assert_eq!(said(", \"int echo\", 0"), Vec::<String>::new());
    assert_eq!(said(", \"int echo\", 1"), ["true word\n"]);
}

/// Renders with one of two shaders: "saves" saves its points and "asks" looks them up, in the database "rw.sdb".
/// Returns the number of records in it, and a value of the image.
fn database(place: &Place, attributes: &str, shader: &str) -> (Option<usize>, f32) {
    place.write(
        "saves.gsl",
        "surface saves () { C = color (u, v, 0.5); spatialdbsave (\"@/rw.sdb\", P, C); }",
    );
    place.write("asks.gsl", "surface asks () { color c = 0; C = spatialdbquery (\"@/rw.sdb\", P, c); }");
    let world = format!("Shader (\"surface\", \"{shader}\")\n{SQUARE}");
    place.quiet(&scene(&format!("{SHADERS}{attributes}"), &world));
    let file = place.path("rw.sdb");
    let records = file.exists().then(|| granita_sdb::read(&file).unwrap().len());
    (records, place.image("out.tif").pixel(8, 8).unwrap()[0])
}

#[test]
fn attributes_choose_which_databases_are_written_and_read() {
    let place = Place::new();
    let says = |word: &str| format!("Attribute (\"string spatialdb:{word}\", \"@/rw.sdb\")\n");
    assert_eq!(database(&place, "", "saves").0, None, "nothing says that it is written");
    let (once, _) = database(&place, &says("writeonly"), "saves");
    let once = once.unwrap();
    assert!(once > 100, "{once}");
    // "write" replaces the database, and adds to it when it is read as well.
    assert_eq!(database(&place, &says("write"), "saves").0, Some(once));
    assert_eq!(database(&place, &(says("read") + &says("write")), "saves").0, Some(2 * once));
    assert_eq!(database(&place, &says("writeonly"), "saves").0, Some(once));
    // Records are found when the database is read.
    for (attributes, found) in
        [(says("read"), 1.0), (says("readonly"), 1.0), (String::new(), 0.0), (says("writeonly"), 0.0)]
    {
        let kept = std::fs::read(place.path("rw.sdb")).unwrap();
        assert_eq!(database(&place, &attributes, "asks").1, found, "{attributes}");
        std::fs::write(place.path("rw.sdb"), kept).unwrap();
    }
    // A read-only database does not change.
    assert_eq!(database(&place, &says("readonly"), "saves").0, Some(once));
}

#[test]
fn the_success_of_a_frame_can_be_read() {
    let place = Place::new();
    let success = |text: &str, wanted: i32| {
        let options = SessionOptions { no_startup_files: true, ..SessionOptions::default() };
        let mut session = Session::new(options, Reporter::silent(), Default::default());
        let asked = |session: &Session| {
            session.state_ref().attribute("int render:success").unwrap().data.to_ints().unwrap()[0]
        };
        assert_eq!(asked(&session), 0, "before");
        let text = std::io::Cursor::new(place.placed(text).into_bytes());
        session.read_stream("<test>", Box::new(text)).unwrap();
        assert_eq!(asked(&session), wanted);
        session.finish();
    };
    success(&scene("", SQUARE), 1);
    success(&format!("{CAMERA}World ()\n{SQUARE}"), 0);
    let nowhere = "Output (\"@/no/such/folder.tif\", \"tiff\", \"rgb\", \"camera\")";
    success(&scene(nowhere, SQUARE), 0);
}

/// "limits:transparentgrids" and "limits:trimcurvememory" affect only the speed. They can be read back, and no pixel
/// depends on them.
#[test]
fn performance_limits_change_no_pixel() {
    let place = Place::new();
    let trim = "TrimCurve ((1,), (5,), (2,), (0, 0, 1, 2, 3, 4, 4), (0,), (4,), \
                (0.2, 0.1, 1, 0.9, 0.3, 1, 0.8, 0.9, 1, 0.1, 0.6, 1, 0.2, 0.1, 1))\n";
    let layers: String = (0..40)
        .map(|i| {
            format!(
                "Translate (0.01, 0, 0.05)\nAttribute (\"color C\", ({}, 0.5, 1))\n{SQUARE}",
                i as f32 / 40.0
            )
        })
        .collect();
    let world = format!(
        "{trim}Attribute (\"color opacity\", (0.1, 0.1, 0.1))\nShader (\"surface\", \"constant\")\n{layers}"
    );
    let usual = place.seen("", &world);
    assert!(usual.is_varied());
    for name in ["limits:transparentgrids", "limits:trimcurvememory"] {
        for value in [1, 7, 100_000] {
            assert!(
                place.seen(&format!("Attribute (\"int {name}\", {value})"), &world) == usual,
                "{name} {value}"
            );
        }
        let options = SessionOptions { no_startup_files: true, ..SessionOptions::default() };
        let mut session = Session::new(options, Reporter::silent(), Default::default());
        let text = format!("Attribute (\"int {name}\", 7)\n");
        session.read_stream("<test>", Box::new(std::io::Cursor::new(text.into_bytes()))).unwrap();
        assert_eq!(session.state_ref().attribute(name).unwrap().data, 7.into(), "{name}");
    }
}
