//! Textures of images that are processed as a whole, and the conventions of OpenImageIO.
#![allow(clippy::unwrap_used, reason = "tests")]

mod support;

use granita_base::{BaseType, Param, ParamType};
use granita_image::{ImageSpec, PixelType};
use granita_texture::make::{
    BrokenValues, Bump, Conventions, Distribution, FlatOptions, Frame, LevelFilter, Made, MakeOptions, Mode,
    make,
};
use std::path::Path;
use support::{Folder, random};

/// Returns the options of OpenImageIO's program without arguments.
fn peer() -> MakeOptions {
    let flat = FlatOptions {
        conventions: Conventions::OpenImageIo,
        frame: Frame::Both,
        filter: Some(LevelFilter::default()),
        ..FlatOptions::default()
    };
    MakeOptions { resize: false, broken_values: BrokenValues::Keep, flat, ..MakeOptions::default() }
}

fn exr(options: MakeOptions) -> MakeOptions {
    MakeOptions { format: "OpenEXR".to_owned(), ..options }
}

fn with(change: impl FnOnce(&mut FlatOptions)) -> MakeOptions {
    let mut options = MakeOptions { resize: false, ..MakeOptions::default() };
    change(&mut options.flat);
    options
}

/// Returns the description of a level and its values.
fn level(folder: &Folder, name: &str, level: usize) -> (ImageSpec, Vec<f32>) {
    let file = folder.registry.open(&folder.path(name)).unwrap();
    let spec = file.spec(0, level).unwrap().clone();
    (spec, file.read_level(0, level).unwrap().to_floats())
}

/// The hash and the mean of this image in OpenImageIO 3.2.2 are known.
#[test]
fn hash_and_mean_are_those_of_openimageio() {
    let folder = Folder::new();
    let image = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/first/brick.png");
    for (name, format) in [("a.tx", "tiff"), ("a.exr", "OpenEXR")] {
        let options = MakeOptions { format: format.to_owned(), ..peer() };
        make(std::slice::from_ref(&image), &folder.path(name), &options, &folder.registry, &|_, _| ())
            .unwrap();
        let (spec, _) = level(&folder, name, 0);
        let text = match format {
            "tiff" => spec.string("ImageDescription").unwrap().to_owned(),
            _ => format!(
                "oiio:SHA-1={} oiio:AverageColor={}",
                spec.string("oiio:SHA-1").unwrap(),
                spec.string("oiio:AverageColor").unwrap()
            ),
        };
        assert!(text.contains("oiio:SHA-1=90EADDF43147D0CDF8957C17629624B994D1ABFA"), "{text}");
        let mean: f32 = text.split("oiio:AverageColor=").nth(1).unwrap().parse().unwrap();
        assert!((mean - 0.43708).abs() < 1e-6, "{text}");
        assert_eq!(spec.string("wrapmodes"), Some("black,black"));
        assert_eq!(
            (spec.width, spec.tile_width, spec.pixel_type == PixelType::Half),
            (512, 64, format != "tiff")
        );
        assert_eq!(level(&folder, name, 6).0.tile_width, 64);
    }
}

#[test]
fn channels_are_detected_dropped_added_and_named() {
    let folder = Folder::new();
    folder.image("rgba.exr", (8, 8), 4, |x, _, c| if c == 3 { 1.0 } else { x as f32 });
    folder.image("grey.tif", (8, 8), 3, |x, y, _| (x * y) as f32);
    let channels = |input: &str, options: MakeOptions| {
        folder.make(&[input], "o.exr", &exr(options)).unwrap();
        level(&folder, "o.exr", 0).0.channels.join(",")
    };
    assert_eq!(channels("rgba.exr", with(|f| f.drop_opaque = true)), "R,G,B");
    assert_eq!(channels("grey.tif", with(|f| f.drop_equal = true)), "Y");
    let both = |f: &mut FlatOptions| (f.drop_opaque, f.channels) = (true, Some(5));
    assert_eq!(channels("rgba.exr", with(both)), "R,G,B,A,channel4");
    let named = |f: &mut FlatOptions| f.channel_names = vec!["U".to_owned(), String::new(), "W".to_owned()];
    assert_eq!(channels("grey.tif", with(named)), "U,G,W");
}

#[test]
fn levels_are_left_out_replaced_and_filtered() {
    let folder = Folder::new();
    folder.image("a.tif", (8, 8), 1, |x, y, _| random(x + 8 * y, 1));
    folder.image("half.tif", (4, 4), 1, |_, _, _| 0.25);
    let made = folder.make(&["a.tif"], "a.tx", &with(|f| f.levels = false)).unwrap();
    assert!(matches!(made, Made::Written { levels: 1, .. }));
    let files = vec![folder.path("half.tif")];
    folder.make(&["a.tif"], "a.tx", &with(|f| f.level_files = files)).unwrap();
    assert_eq!(level(&folder, "a.tx", 1).1, [0.25; 16]);
    assert_eq!(level(&folder, "a.tx", 2).1, [0.25; 4]);
    // A sharper level has a larger range.
    let range = |options: MakeOptions| {
        folder.make(&["a.tif"], "a.tx", &options).unwrap();
        let values = level(&folder, "a.tx", 1).1;
        values.iter().copied().fold(f32::MIN, f32::max) - values.iter().copied().fold(f32::MAX, f32::min)
    };
    assert!(range(with(|f| f.sharpen = 1.0)) > range(with(|_| ())));
    let lanczos = with(|f| f.filter = LevelFilter::from_word("lanczos3"));
    assert_ne!(range(lanczos), range(with(|_| ())));
}

#[test]
fn windows_are_padded_kept_or_replaced() {
    let folder = Folder::new();
    let spec =
        ImageSpec { x: -2, y: -2, full_width: 4, full_height: 4, ..ImageSpec::new(8, 8, 1, PixelType::Half) };
    folder.image_of("over.exr", spec.clone(), |x, y, _| (x + 8 * y) as f32);
    let (x, y) = (1, 1);
    folder.image_of(
        "crop.exr",
        ImageSpec { x, y, ..ImageSpec { width: 2, height: 2, ..spec } },
        |_, _, _| 1.0,
    );
    let windows = |name: &str| {
        let s = level(&folder, name, 0).0;
        (s.x, s.y, s.width, s.height, s.full_width, s.full_height)
    };
    folder.make(&["over.exr"], "o.exr", &exr(peer())).unwrap();
    assert_eq!(windows("o.exr"), (-2, -2, 8, 8, 4, 4));
    folder.make(&["crop.exr"], "o.exr", &exr(peer())).unwrap();
    assert_eq!((windows("o.exr"), level(&folder, "o.exr", 0).1[0]), ((0, 0, 4, 4, 4, 4), 0.0));
    folder.make(&["over.exr"], "o.tx", &with(|f| f.frame = Frame::Data)).unwrap();
    assert_eq!(windows("o.tx"), (0, 0, 8, 8, 8, 8));
    let refused = folder.make(&["over.exr"], "o.tx", &peer()).unwrap_err().to_string();
    assert!(refused.contains("beyond its display window"), "{refused}");
}

#[test]
fn broken_values_stay_or_are_replaced() {
    let folder = Folder::new();
    folder.image("a.exr", (4, 4), 1, |x, y, _| if (x, y) == (1, 1) { f32::NAN } else { 2.0 });
    let value = |broken_values| {
        folder.make(&["a.exr"], "o.tx", &MakeOptions { broken_values, ..peer() }).unwrap();
        level(&folder, "o.tx", 0).1[5]
    };
    assert!(value(BrokenValues::Keep).is_nan());
    assert_eq!((value(BrokenValues::Black), value(BrokenValues::Fix)), (0.0, 2.0));
    let refuse = MakeOptions { broken_values: BrokenValues::Refuse, ..peer() };
    assert!(folder.make(&["a.exr"], "o.tx", &refuse).unwrap_err().to_string().contains("1 pixels"));
}

#[test]
fn slopes_and_distributions_are_stored() {
    let folder = Folder::new();
    folder.image("a.tif", (16, 16), 1, |x, _, _| x as f32 / 16.0);
    let options = with(|f| {
        f.bump = Some(Bump { uv_scale: 16.0, ..Bump::default() });
        f.distribution = Some(Distribution { sigma: 1.0 / 6.0, bits: 4 });
        f.handed = Some("left".to_owned());
    });
    folder
        .make(&["a.tif"], "o.exr", &exr(MakeOptions { pixel_type: Some(PixelType::Float), ..options }))
        .unwrap();
    let (spec, values) = level(&folder, "o.exr", 0);
    assert_eq!((spec.nchannels(), &*spec.channels[1]), (6, "b1_dhds"));
    let texel = &values[6 * (5 * 16 + 7)..][..6];
    assert!((texel[1] - 1.0 / 16.0).abs() < 1e-6 && texel[2] == 0.0, "{texel:?}");
    assert_eq!(spec.attributes.floats("CDF_5").unwrap().len(), 16);
    assert_eq!(
        (spec.attributes.int("CDF_bits"), spec.attributes.float("uvslopes_scale")),
        (Some(4), Some(16.0))
    );
}

#[test]
fn panoramas_of_probes_and_presets_are_made() {
    let folder = Folder::new();
    folder.image("probe.exr", (32, 32), 3, |x, y, c| if c == 0 { x as f32 } else { y as f32 });
    let mut options = exr(MakeOptions { mode: Mode::EnvLatLong, ..peer() });
    options.flat.probe = true;
    folder.make(&["probe.exr"], "o.exr", &options).unwrap();
    let (spec, values) = level(&folder, "o.exr", 0);
    assert_eq!((spec.width, spec.height, spec.string("wrapmodes")), (32, 16, Some("periodic,clamp")));
    assert_eq!(values[..3], values[93..96], "the ends of a row are one place");
    let mut prman = peer();
    prman.flat.prman = true;
    prman.flat.attributes.set(Param {
        name: "Artist".into(),
        ty: ParamType::of(BaseType::String),
        data: "me".into(),
    });
    folder.make(&["probe.exr"], "o.tx", &prman).unwrap();
    let spec = level(&folder, "o.tx", 0).0;
    assert_eq!(
        (spec.tile_width, spec.string("planarconfig"), spec.string("Artist")),
        (32, Some("separate"), Some("me"))
    );
    let wrong = MakeOptions { mode: Mode::VertCross, ..with(|f| f.sharpen = 1.0) };
    assert!(folder.make(&["probe.exr"], "o.tx", &wrong).is_err());
}

#[test]
fn updates_compare_the_words_of_the_command() {
    let folder = Folder::new();
    folder.image("a.tif", (4, 4), 1, |x, _, _| x as f32);
    let signed = |text: &str| {
        let mut options = MakeOptions { update: true, ..peer() };
        options.flat.signature = Some(text.to_owned());
        folder.make(&["a.tif"], "o.tx", &options).unwrap()
    };
    assert!(matches!(signed("Granita : maketx -u x/a.tif"), Made::Written { .. }));
    assert_eq!(signed("Granita : maketx --u y/a.tif"), Made::UpToDate);
    assert!(matches!(signed("Granita : maketx -u --hicomp a.tif"), Made::Written { .. }));
}
