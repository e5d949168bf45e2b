//! Tests of `iv` without a window: its output, the files that it writes and its exit status.

#![allow(clippy::unwrap_used, reason = "what fails here fails the test")]

use granita_base::Param;
use granita_image::{CreateOptions, FormatRegistry, ImageSpec, Limits, PixelType, Pixels};
use std::path::Path;
use std::process::{Command, Output};

fn formats() -> FormatRegistry {
    granita_plugin::bundled_formats(Limits::default())
}

fn write(path: &Path, spec: &ImageSpec, values: &[f32]) {
    let format = path.extension().unwrap().to_str().unwrap();
    let mut file = formats().create(path, format, &CreateOptions::new(spec, 1)).unwrap();
    file.write_rows(&Pixels::from_floats(spec.pixel_type, values)).unwrap();
    file.close().unwrap();
}

/// Runs iv in `folder`. Returns the exit status, standard output and standard error.
fn iv(folder: &Path, arguments: &[&str]) -> (i32, String, String) {
    let program = env!("CARGO_BIN_EXE_iv");
    let Output { status, stdout, stderr } = Command::new(program)
        .current_dir(folder)
        .env_remove("COLUMNS")
        .env_remove("OCIO")
        .args(arguments)
        .output()
        .unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (status.code().unwrap_or(-1), text(stdout), text(stderr))
}

fn images() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let spec = ImageSpec::new(4, 2, 3, PixelType::U8);
    let grey: Vec<f32> = (0..24).map(|i| (i / 3) as f32 / 8.0).collect();
    write(&folder.path().join("a.png"), &spec, &grey);
    let mut other = grey.clone();
    other[5 * 3] += 0.2;
    write(&folder.path().join("b.png"), &spec, &other);
    let mut layered = ImageSpec::new(2, 2, 5, PixelType::Float).tiled(16, 16);
    layered.channels = ["R", "G", "B", "Z", "N.x"].map(str::to_owned).to_vec();
    let mut values = vec![0.5; 20];
    (values[3], values[8], values[13]) = (7.0, f32::NAN, f32::INFINITY);
    values[0] = -1.0;
    write(&folder.path().join("c.exr"), &layered, &values);
    folder
}

#[test]
fn formats_of_the_build_are_listed() {
    let folder = tempfile::tempdir().unwrap();
    let (status, text, _) = iv(folder.path(), &["-formats"]);
    assert_eq!(status, 0);
    let line = |name: &str| {
        let found = text.lines().find(|line| line.split_whitespace().next() == Some(name));
        found.unwrap_or_else(|| panic!("no {name} in {text}")).split_whitespace().collect::<Vec<_>>()
    };
    assert_eq!(line("exr")[1..4], ["yes", "yes", "exr"]);
    assert_eq!(line("gif")[1..4], ["yes", "-", "gif"]);
    assert_eq!(line("iv")[1..3], ["-", "yes"]);
    // A heading comes first, and a line about the missing plugin for HEIF last.
    assert_eq!(text.lines().count(), formats().formats().len() + 2);
    assert!(text.lines().last().unwrap().starts_with("HEIF and AVIF need a plugin"), "{text}");
    let (status, text, _) = iv(folder.path(), &["-formats", "-json"]);
    assert_eq!(status, 0);
    let value: serde_json::Value = serde_json::from_str(&text).unwrap();
    let all = value.as_array().unwrap();
    let dpx = all.iter().find(|format| format["name"] == "dpx").unwrap();
    assert_eq!(
        (&dpx["reads"], &dpx["writes"], &dpx["types"][0]),
        (&true.into(), &true.into(), &"u16".into())
    );
}

/// Tests a format of a shared library in the folder where tools look for plugins by default.
#[cfg(unix)]
#[test]
fn info_reads_images_of_plugin_formats() {
    let folder = tempfile::tempdir().unwrap();
    let library = folder.path().join("lib");
    std::fs::create_dir(&library).unwrap();
    let repository = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let built = Command::new("cc")
        .args(["-w", "-shared", "-fPIC", "-o"])
        .arg(library.join("plain.imageio.so"))
        .arg("-I")
        .arg(repository.join("bindings/cpp/include"))
        .arg(repository.join("tests/cpp/plain.c"))
        .status();
    assert!(built.unwrap().success(), "a C compiler is needed to build the suite as well");
    let values: Vec<u8> = (0..3 * 2 * 2).flat_map(|i| (i as f32).to_le_bytes()).collect();
    let file = [b"PLAIN 3 2 2 Y A\n", &*values, b"pieces 0\n"].concat();
    std::fs::write(folder.path().join("a.pln"), &file).unwrap();
    std::fs::write(folder.path().join("cut.pln"), &file[..40]).unwrap();
    let run = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_iv"));
        let out =
            command.current_dir(folder.path()).env("GELATOHOME", folder.path()).args(arguments).output();
        let Output { status, stdout, stderr } = out.unwrap();
        let text = |bytes| String::from_utf8(bytes).unwrap();
        (status.code(), text(stdout), text(stderr))
    };
    let (status, out, error) = run(&["-info", "a.pln"]);
    assert_eq!((status, &*error), (Some(0), ""));
    assert!(out.starts_with("a.pln: plain\n  3 x 2, 2 channels (Y A) of float\n"), "{out}");
    let (status, out, error) = run(&["-stats", "a.pln"]);
    assert_eq!((status, &*error), (Some(0), ""));
    assert!(out.contains("10") && out.contains("11"), "{out}");
    let (status, _, error) = run(&["-stats", "cut.pln"]);
    assert!(status == Some(2) && error.contains("it is cut short"), "{status:?} {error}");
}

#[test]
fn info_prints_size_channels_and_layers() {
    let folder = images();
    let (status, out, error) = iv(folder.path(), &["-info", "a.png", "c.exr"]);
    assert_eq!((status, &*error), (0, ""));
    let wanted = "a.png: png
  4 x 2, 3 channels (R G B) of uint8
    colours          sRGB (assumed of integers)
c.exr: exr
  2 x 2, 5 channels (R G B Z N.x) of float
    tiles            16 x 16
    colours          linear, Rec. 709 (assumed)
    layers           RGB, Z, N
";
    assert!(out.starts_with(wanted), "{out}");
    assert!(out.contains("    compression      \"zip\"\n"), "{out}");
}

#[test]
fn colours_are_those_that_the_file_names() {
    let folder = tempfile::tempdir().unwrap();
    let mut spec = ImageSpec::new(1, 1, 3, PixelType::U8);
    spec.attributes.set(Param::declared("float png:gAMA", 1.0).unwrap());
    write(&folder.path().join("linear.png"), &spec, &[0.5; 3]);
    let mut spec = ImageSpec::new(1, 1, 3, PixelType::Half);
    let ap1 = [0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.321_68, 0.337_67];
    spec.attributes.set(Param::declared("float[8] chromaticities", &ap1[..]).unwrap());
    write(&folder.path().join("aces.exr"), &spec, &[0.5, 0.25, 0.25]);
    let (status, out, error) = iv(folder.path(), &["-info", "linear.png", "aces.exr"]);
    assert_eq!((status, &*error), (0, ""));
    assert!(out.contains("colours          Rec. 709, linear (PNG chunk gAMA)\n"), "{out}");
    assert!(out.contains("colours          linear, ACES AP1 (chromaticities)\n"), "{out}");
    let shown = |options: &[&str], file: &str| {
        let (status, _, error) = iv(folder.path(), &[options, &["-thumbnail", "t.png", file]].concat());
        assert_eq!(status, 0, "{error}");
        let image = formats().open(&folder.path().join("t.png")).unwrap();
        let Pixels::U8(bytes) = image.read_level(0, 0).unwrap() else { panic!() };
        [bytes[0], bytes[1], bytes[2]]
    };
    // Half of the light is 188 of sRGB. ACEScg 0.5 0.25 0.25 is 0.6762 0.2174 0.2439 in Rec. 709.
    assert_eq!(shown(&[], "linear.png"), [188; 3]);
    assert_eq!(shown(&["-colorspace", "Raw", "-view", "Raw"], "linear.png"), [128; 3]);
    assert_eq!(shown(&[], "aces.exr"), [215, 128, 135]);
    assert_eq!(shown(&["-view", "Un-tone-mapped"], "aces.exr"), [215, 128, 135]);
    assert_eq!(shown(&["-colorspace", "lin_rec709"], "aces.exr"), [188, 137, 137]);
    assert_eq!(shown(&["-colorspace", "lin_rec709", "-exposure", "1"], "aces.exr"), [255, 188, 188]);
    let (status, _, error) = iv(folder.path(), &["-colorspace", "pink", "-info", "aces.exr"]);
    assert!(status == 2 && error.contains("has no colour space \"pink\""), "{error}");
    let (status, _, error) = iv(folder.path(), &["-colorconfig", "no.ocio", "-info", "aces.exr"]);
    assert!(status == 2 && error.contains("-colorconfig: no.ocio: "), "{error}");
}

#[test]
fn stats_prints_a_table_of_channels() {
    let folder = images();
    let (status, out, _) = iv(folder.path(), &["--stats", "c.exr"]);
    assert_eq!(status, 0);
    assert_eq!(
        out,
        "c.exr: 2 x 2, 5 channels (R G B Z N.x) of float
  channel  min  max   mean  deviation  negative  NaN  inf
  R         -1  0.5  0.125  0.6495191         1    0    0
  G        0.5  0.5    0.5          0         0    0    0
  B        0.5  0.5    0.5          0         0    0    0
  Z        0.5    7   3.75       3.25         0    1    1
  N.x      0.5  0.5    0.5          0         0    0    0
"
    );
}

#[test]
fn compare_applies_its_limits() {
    let folder = images();
    let run = |arguments: &[&str]| {
        let (status, out, error) = iv(folder.path(), &[&["-compare"], arguments].concat());
        (status, out + &error)
    };
    let (status, text) = run(&["a.png", "a.png"]);
    assert!(status == 0 && text.contains("PSNR infinite") && text.ends_with("alike\n"), "{text}");
    let (status, text) = run(&["a.png", "b.png"]);
    assert_eq!(status, 1);
    assert!(text.contains("  R        0.025"), "{text}");
    assert!(text.contains("1,1"), "the place of the largest difference: {text}");
    assert!(
        text.contains("12.5000 % of the pixels differ by more than 0, 0 % may")
            && text.ends_with("different\n")
    );
    for (limits, wanted) in [
        (&["-fail", "0.21"][..], 0),
        (&["-fail", "0.19"], 1),
        (&["-failpercent", "12.5"], 0),
        (&["-failpercent", "12"], 1),
        (&["-maxrms", "0.05"], 0),
        (&["-maxrms", "0.04"], 1),
        (&["-minpsnr", "27"], 0),
        (&["-minpsnr", "28"], 1),
        (&["-maxflip", "0.9"], 0),
        (&["-maxflip", "0.0001"], 1),
        (&["-maxrms", "0.05", "-minpsnr", "28"], 1),
    ] {
        let (status, text) = run(&[&["a.png", "b.png"], limits].concat());
        assert_eq!(status, wanted, "{limits:?}: {text}");
    }
    for wrong in [&["a.png"][..], &["a.png", "c.exr"], &["a.png", "none.png"], &["a.png", "a.png", "a.png"]] {
        let (status, text) = run(wrong);
        assert!(status == 2 && text.contains("iv: error: "), "{wrong:?}: {text}");
    }
}

#[test]
fn a_truncated_image_is_not_equal_to_black() {
    let folder = images();
    let spec = ImageSpec::new(64, 64, 3, PixelType::U8);
    // An image that cannot be compressed is cut in the middle.
    let noise: Vec<f32> =
        (0..64 * 64 * 3_u32).map(|i| (i.wrapping_mul(2_654_435_761) >> 24) as f32 / 255.0).collect();
    write(&folder.path().join("d.png"), &spec, &noise);
    let whole = folder.path().join("d.png");
    let bytes = std::fs::read(&whole).unwrap();
    std::fs::write(folder.path().join("e.png"), &bytes[..bytes.len() / 2]).unwrap();
    let (status, _, error) = iv(folder.path(), &["-compare", "d.png", "e.png"]);
    assert!(status == 2 && error.contains("not all of it can be read"), "{error}");
}

#[test]
fn thumbnails_and_character_images_are_made() {
    let folder = images();
    let (status, _, error) = iv(folder.path(), &["-thumbnail", "t.png", "-size", "2", "a.png"]);
    assert_eq!((status, &*error), (0, ""));
    let small = formats().open(&folder.path().join("t.png")).unwrap();
    let spec = small.spec(0, 0).unwrap();
    assert_eq!((spec.width, spec.height, spec.nchannels()), (2, 1, 3));
    std::fs::create_dir(folder.path().join("many")).unwrap();
    let (status, ..) = iv(folder.path(), &["-thumbnail", "many", "a.png", "b.png"]);
    assert!(status == 0 && folder.path().join("many/b.png.png").is_file());
    let (status, text, _) = iv(folder.path(), &["-ascii", "-width", "8", "a.png"]);
    assert_eq!((status, text.lines().count()), (0, 2));
    assert!(text.starts_with(' ') && text.ends_with("%%\n"), "{text}");
    let (_, text, _) = iv(folder.path(), &["-ascii", "-width", "8", "-color", "a.png"]);
    assert_eq!(text.matches('\u{2580}').count(), 16);
}

#[test]
fn errors_are_reported_with_their_exit_code() {
    let folder = images();
    std::fs::write(folder.path().join("text.txt"), "no image").unwrap();
    for (arguments, wanted, words) in [
        (&["-info"][..], 2, "no files are given"),
        (&["-info", "text.txt"], 2, "text.txt: not an image of a known format"),
        (&["-info", "none.exr", "a.png"], 1, "none.exr: "),
        (&["-ascii", "-layer", "nothing", "c.exr"], 2, "there is no layer \"nothing\", only RGB, Z, N"),
        (&["-ascii", "-page", "3", "a.png"], 2, "there is no image 3"),
        (&["-ascii", "-channel", "Q", "a.png"], 2, "there is no channel \"Q\", only R G B"),
        (&["-ascii", "-gamma", "0", "a.png"], 2, "-gamma is 0"),
        (&["-thumbnail", "t.nothing", "a.png"], 2, "nothing"),
        (&["-thumbnail", "no/where.png", "a.png"], 2, "where.png"),
        (&["-info", "-stats", "a.png"], 2, "cannot be used with"),
        (&["-falsecolor", "pink", "-ascii", "a.png"], 2, "a map is one of helix"),
    ] {
        let (status, _, error) = iv(folder.path(), arguments);
        assert!(status == wanted && error.contains(words), "{arguments:?}: {status}: {error}");
    }
}

#[test]
fn json_has_the_content_of_the_texts() {
    let folder = images();
    let json = |arguments: &[&str]| {
        let (status, out, error) = iv(folder.path(), arguments);
        let value: serde_json::Value =
            serde_json::from_str(&out).unwrap_or_else(|e| panic!("{e}: {out} {error}"));
        (status, value)
    };
    let (status, info) = json(&["-json", "-info", "a.png", "c.exr"]);
    assert_eq!((status, info.as_array().unwrap().len()), (0, 2));
    let page = &info[1]["images"][0];
    assert_eq!((&info[1]["file"], &info[1]["format"]), (&"c.exr".into(), &"exr".into()));
    assert_eq!(
        (page["width"].as_u64(), &page["type"], page["tile"][0].as_u64()),
        (Some(2), &"float".into(), Some(16))
    );
    assert_eq!(page["channels"].as_array().unwrap().len(), 5);
    let (status, stats) = json(&["-json", "-stats", "c.exr", "nosuch.exr"]);
    assert_eq!((status, stats.as_array().unwrap().len()), (1, 1));
    let channels = stats[0]["images"][0]["channels"].as_array().unwrap();
    let nan: u64 = channels.iter().map(|c| c["nan"].as_u64().unwrap()).sum();
    let infinite: u64 = channels.iter().map(|c| c["infinite"].as_u64().unwrap()).sum();
    assert_eq!((nan, infinite), (1, 1));
    let (status, same) = json(&["-json", "-compare", "a.png", "a.png"]);
    assert_eq!(
        (status, &same["alike"], &same["images"][0]["psnr"]),
        (0, &true.into(), &serde_json::Value::Null)
    );
    let (status, other) = json(&["-json", "-compare", "a.png", "b.png"]);
    assert_eq!((status, &other["alike"]), (1, &false.into()));
    assert_eq!(other["images"][0]["pixels_beyond"].as_u64(), Some(1));
    assert!(!other["images"][0]["beyond"].as_array().unwrap().is_empty());
    for wrong in [&["-json", "a.png"][..], &["-json", "-ascii", "a.png"]] {
        assert_eq!(iv(folder.path(), wrong).0, 2);
    }
}

#[test]
fn differences_are_written_as_images() {
    let folder = images();
    let (a, b) = ("a.png", "b.png");
    let run = |words: &[&str]| iv(folder.path(), &[&["-compare"], words, &[a, b]].concat());
    let (status, _, error) = run(&["-diff", "d.exr", "-diffscale", "2", "-flipmap", "f.exr"]);
    assert_eq!((status, &*error), (1, ""));
    let read = |name: &str| {
        let file = formats().open(&folder.path().join(name)).unwrap();
        let spec = file.spec(0, 0).unwrap();
        (spec.channels.clone(), file.read_rows(0, 0, 0, spec.height).unwrap().to_floats())
    };
    let (channels, values) = read("d.exr");
    assert_eq!(channels, ["R", "G", "B"]);
    // One value of a byte differs by 0.2, rounded to a step of 255.
    let expected = |i: usize| if i == 15 { 2.0 * 51.0 / 255.0 } else { 0.0 };
    assert!(values.iter().enumerate().all(|(i, v)| (v - expected(i)).abs() < 0.01), "{values:?}");
    let (channels, values) = read("f.exr");
    assert_eq!((channels.len(), values.len()), (1, 8));
    let mean = values.iter().map(|v| f64::from(*v)).sum::<f64>() / 8.0;
    let (_, out, _) = run(&["-json"]);
    let document: serde_json::Value = serde_json::from_str(&out).unwrap();
    let flip = document["images"][0]["flip"]["mean"].as_f64().unwrap();
    assert!(flip > 0.0 && (flip - mean).abs() < 1e-3, "{flip} {mean}");
    // In formats of bytes the map is in colours.
    assert_eq!(run(&["-flipmap", "f.png"]).0, 1);
    assert_eq!(read("f.png").0.len(), 3);
    let (status, _, error) = run(&["-diff", "a.png"]);
    assert!(status == 2 && error.contains("a.png is compared, and is not overwritten"), "{error}");
    assert_eq!(iv(folder.path(), &["-diff", "d.exr", a]).0, 2);
}
