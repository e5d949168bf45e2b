//! Tests Cryptomattes, and files of several parts.

use crate::support::{Place, SHADERS};
use granita_image::{ImageInput, Limits};
use granita_session::SessionOptions;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::Path;

/// A shader whose colour is its opacity when `on` is 1, so that an image of it is the coverage of the object.
const SHADER: &str = "surface show (float on = 0, float veil = 1) { opacity = veil; C = on * veil; }\n";

const OBJECTS: [&str; 4] = ["set/left", "moving", "glass", "floor"];

/// Returns a scene of overlapping, moving and half transparent objects out of focus. The object `shown` is white. The
/// others are black.
fn scene(shown: usize, camera: &str, outputs: &str) -> String {
    let mut world = String::new();
    for (k, (name, veil, motion, place)) in [
        (OBJECTS[0], 1.0, false, "Translate (-0.4, 0.3, 5)"),
        (OBJECTS[1], 0.6, true, "Translate (0.1, -0.2, 4.5)"),
        (OBJECTS[2], 0.3, false, "Translate (0.2, 0.2, 3.5)"),
        (OBJECTS[3], 1.0, false, "Translate (0, 0, 7)\nScale (0.9, 1.4, 1)"),
    ]
    .into_iter()
    .enumerate()
    {
        let on = f32::from(u8::from(k == shown));
        let motion =
            if motion { "Motion (0, 1)\nTranslate (0, 0, 0)\nTranslate (0.3, 0.1, 0)\n" } else { "" };
        let layer = ["red", "red", "window", ""][k];
        let layer = if layer.is_empty() { String::new() } else { format!(", \"{layer}\"") };
        let _ = write!(
            world,
            "PushAttributes ()\nAttribute (\"string name\", \"{name}\")\n{place}\n{motion}\
             Parameter (\"float on\", {on})\nParameter (\"float veil\", {veil})\nShader (\"surface\", \"show\"{layer})\n\
             Patch (\"linear\", 2, 2, \"vertex point P\", (-0.5, -0.5, 0, 0.5, -0.5, 0.2, -0.5, 0.5, 0, 0.5, 0.5, 0))\n\
             PopAttributes ()\n"
        );
    }
    format!(
        "{SHADERS}Attribute (\"int[2] resolution\", (40, 30))\nAttribute (\"float fov\", 30)\n\
         Attribute (\"float[2] shutter\", (0, 1))\nAttribute (\"float fstop\", 1)\nAttribute (\"float focallength\", 0.1)\n\
         Attribute (\"float focaldistance\", 4.5)\nAttribute (\"color limits:opacitythreshold\", (1, 1, 1))\n{camera}\
         Camera (\"c\")\n{outputs}World ()\n{world}Render ()\n"
    )
}

const MATTES: &str = "Output (\"@/m.exr\", \"exr\", \"rgba, cryptomatte object, cryptomatte material\", \"c\", \
                      \"string pixeltype\", \"float\")\n";

fn open(path: &Path) -> Box<dyn ImageInput> {
    granita_plugin::bundled_formats(Limits::default()).open(path).unwrap()
}

/// The channels of an image by their names.
fn channels(input: &dyn ImageInput, image: usize) -> BTreeMap<String, Vec<f32>> {
    let names = &input.spec(image, 0).unwrap().channels;
    let values = input.read_level(image, 0).unwrap().to_floats();
    let of = |k: usize| values.iter().skip(k).step_by(names.len()).copied().collect();
    names.iter().enumerate().map(|(k, name)| (name.clone(), of(k))).collect()
}

/// Returns the id of each name of a manifest, as programs compute it.
fn ids(input: &dyn ImageInput, image: usize, of: &str) -> BTreeMap<String, f32> {
    let attributes = &input.spec(image, 0).unwrap().attributes;
    let name = attributes.iter().find(|p| {
        p.name.starts_with("cryptomatte/")
            && p.name.ends_with("/name")
            && attributes.string(&p.name).is_some_and(|name| **name == *of)
    });
    let key = name.unwrap().name.strip_suffix("/name").unwrap().to_owned();
    let text = |word: &str| attributes.string(&format!("{key}/{word}")).unwrap().to_string();
    assert_eq!((&*text("hash"), &*text("conversion")), ("MurmurHash3_32", "uint32_to_float32"));
    let manifest: BTreeMap<String, String> = serde_json::from_str(&text("manifest")).unwrap();
    let id = |hash: String| {
        let mut bits = u32::from_str_radix(&hash, 16).unwrap();
        if [0, 255].contains(&((bits >> 23) & 255)) {
            bits ^= 1 << 23;
        }
        f32::from_bits(bits)
    };
    manifest.into_iter().map(|(name, hash)| (name, id(hash))).collect()
}

/// Returns the matte of an id in each pixel.
fn matte(channels: &BTreeMap<String, Vec<f32>>, of: &str, id: f32) -> Vec<f32> {
    let pixels = channels.values().next().unwrap().len();
    let mut matte = vec![0.0; pixels];
    for rank in 0..3 {
        for [of_id, of_share] in [["R", "G"], ["B", "A"]] {
            let ids = &channels[&format!("{of}{rank:02}.{of_id}")];
            let shares = &channels[&format!("{of}{rank:02}.{of_share}")];
            for (k, (i, share)) in ids.iter().zip(shares).enumerate() {
                if i.to_bits() == id.to_bits() {
                    matte[k] += share;
                }
            }
        }
    }
    matte
}

fn greatest_difference(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
}

#[test]
fn mattes_equal_images_of_their_objects() {
    let place = Place::new();
    place.write("show.gsl", SHADER);
    let mut sum = Vec::new();
    let mut alpha = Vec::new();
    let mut of_red = Vec::new();
    for (k, name) in OBJECTS.iter().enumerate() {
        place.quiet(&scene(k, "", MATTES));
        let input = open(&place.path("m.exr"));
        let channels = channels(&*input, 0);
        let ids = ids(&*input, 0, "CryptoObject");
        assert_eq!(ids.len(), 4);
        let matte = matte(&channels, "CryptoObject", ids[*name]);
        let rendered = &channels["R"];
        assert!(
            rendered.iter().any(|v| *v > 0.25) && rendered.iter().any(|v| (0.01..0.2).contains(v)),
            "{name}"
        );
        let difference = greatest_difference(&matte, rendered);
        assert!(difference < 1e-5, "{name}: {difference}");
        sum.resize(matte.len(), 0.0);
        sum.iter_mut().zip(&matte).for_each(|(sum, matte)| *sum += matte);
        alpha.clone_from(&channels["A"]);
        if k < 2 {
            of_red.resize(matte.len(), 0.0);
            of_red.iter_mut().zip(&matte).for_each(|(sum, matte)| *sum += matte);
        }
    }
    let difference = greatest_difference(&sum, &alpha);
    assert!(difference < 1e-5, "the coverages add up to alpha: {difference}");
    let input = open(&place.path("m.exr"));
    let materials = ids(&*input, 0, "CryptoMaterial");
    assert_eq!(materials.keys().collect::<Vec<_>>(), ["red", "show", "window"]);
    let red = matte(&channels(&*input, 0), "CryptoMaterial", materials["red"]);
    assert!(greatest_difference(&red, &of_red) < 1e-5, "two objects of one material");
}

#[test]
fn mattes_do_not_depend_on_threads_buckets_and_crops() {
    let place = Place::new();
    place.write("show.gsl", SHADER);
    let mattes = MATTES.replace("rgba, ", "");
    let read = |camera: &str, threads: usize| {
        let options = SessionOptions { threads, ..SessionOptions::default() };
        let rendered = place.render_with(&scene(0, camera, &mattes), options);
        assert!(rendered.said.is_empty() && rendered.outcome.complete, "{:?}", rendered.said);
        place.image("m.exr")
    };
    let whole = read("", 1);
    let bits = |values: &[f32]| values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
    let small = read(
        "Attribute (\"int[2] limits:bucketsize\", (7, 5))\nAttribute (\"int limits:transparentgrids\", 1)\n",
        3,
    );
    assert!(bits(&small.values) == bits(&whole.values));
    let part = read("Attribute (\"float[4] crop\", (0.25, 0.75, 0.2, 0.8))\n", 2);
    assert_eq!((part.width, part.height), (20, 18));
    for y in 0..part.height {
        let row = |image: &granita_tests::Image, x: usize, y: usize| {
            let from = (y * image.width + x) * image.channels;
            bits(&image.values[from..from + 20 * image.channels])
        };
        assert!(row(&part, 0, y) == row(&whole, 10, y + 6), "row {y}");
    }
}

#[test]
fn mattes_of_a_later_frame_equal_those_of_the_first() {
    let place = Place::new();
    place.write("show.gsl", SHADER);
    // The samples of the second frame see what they saw in the first one, which has no mattes.
    let beauty = "Output (\"@/a.exr\", \"exr\", \"rgba\", \"c\")\n";
    let later = MATTES.replace("m.exr", "later.exr") + "World ()\nRender ()\n";
    place.quiet(&(scene(0, "Attribute (\"int rerender\", 1)\n", beauty) + &later));
    place.quiet(&scene(0, "", MATTES));
    let bits = |name: &str| place.image(name).values.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
    assert!(bits("later.exr") == bits("m.exr"));
}

#[test]
fn parts_have_their_own_types_and_names() {
    let place = Place::new();
    place.write("show.gsl", SHADER);
    let part = |data: &str, part: &str, more: &str| {
        format!("Output (\"@/p.exr\", \"exr\", \"{data}\", \"c\", \"string part\", \"{part}\"{more})\n")
    };
    let outputs = part("rgba", "beauty", ", \"string compression\", \"piz\"")
        + &part("z", "depth", "")
        + &part(
            "cryptomatte object",
            "objects",
            ", \"string compression\", \"zips\", \"int cryptomatte:ranks\", 3",
        )
        + &part("point P", "position", "")
        + "Output (\"@/alone.exr\", \"exr\", \"rgba\", \"c\")\n"
        + "Output (\"@/alone.tif\", \"tiff\", \"rgba\", \"c\")\n";
    let rendered = place.quiet(&scene(1, "", &outputs));
    let written = &rendered.outcome.images;
    assert_eq!(written.len(), 3, "{written:?}");
    let input = open(&place.path("p.exr"));
    let of = |k: usize| {
        let spec = input.spec(k, 0).unwrap();
        (spec.string("name").unwrap().to_owned(), spec.nchannels(), spec.pixel_type.word())
    };
    let all: Vec<_> = (0..input.images()).map(of).collect();
    let expected =
        [("beauty", 4, "half"), ("depth", 1, "float"), ("objects", 8, "float"), ("position", 3, "float")];
    assert_eq!(all, expected.map(|(name, n, ty)| (name.to_owned(), n, ty)));
    let text = |k: usize, name: &str| input.spec(k, 0).unwrap().string(name).map(str::to_owned);
    assert_eq!((text(0, "compression"), text(2, "compression")), (Some("piz".into()), Some("zips".into())));
    assert_eq!(text(3, "granita/filter").as_deref(), Some("closest"));
    assert_eq!(text(0, "granita/samples").as_deref(), Some("4 4"));
    let alone = open(&place.path("alone.exr"));
    assert_eq!(input.read_level(0, 0).unwrap(), alone.read_level(0, 0).unwrap());
    // TIFF has the same settings, in its packet of XMP.
    let tiff = open(&place.path("alone.tif"));
    let settings = |input: &dyn granita_image::ImageInput| -> Vec<(String, String)> {
        let spec = input.spec(0, 0).unwrap();
        let own = spec.attributes.iter().filter(|p| p.name.starts_with("granita/"));
        let mut all: Vec<(String, String)> =
            own.map(|p| (p.name.to_string(), spec.string(&p.name).unwrap().to_owned())).collect();
        all.sort();
        all
    };
    assert_eq!((settings(&*tiff), settings(&*tiff).len()), (settings(&*alone), 6));
    if granita_needs::has("exrinfo") {
        let said = std::process::Command::new("exrinfo").arg(place.path("p.exr")).output().unwrap();
        let said = String::from_utf8_lossy(&said.stdout).into_owned();
        assert!(said.contains("part 4: position") && said.contains("part 3: objects"), "{said}");
    }
}

#[test]
fn both_views_of_a_stereo_camera_are_parts_of_one_file() {
    let place = Place::new();
    place.write("show.gsl", SHADER);
    let stereo =
        "Attribute (\"float stereo:separation\", 0.2)\nAttribute (\"float stereo:convergence\", 5)\n";
    let outputs = "Output (\"@/s.exr\", \"exr\", \"rgba\", \"c\", \"string part\", \"beauty\")\n\
                   Output (\"@/s.exr\", \"exr\", \"z\", \"c\", \"string part\", \"depth\")\n\
                   Output (\"@/t.exr\", \"exr\", \"rgba\", \"c\")\n";
    place.quiet(&scene(0, stereo, outputs));
    let input = open(&place.path("s.exr"));
    let text = |k: usize, name: &str| input.spec(k, 0).unwrap().string(name).unwrap().to_owned();
    let all: Vec<(String, String)> =
        (0..input.images()).map(|k| (text(k, "name"), text(k, "view"))).collect();
    let expected = [
        ("beauty.left", "left"),
        ("beauty.right", "right"),
        ("depth.left", "left"),
        ("depth.right", "right"),
    ];
    assert_eq!(all, expected.map(|(name, view)| (name.to_owned(), view.to_owned())));
    for (part, file) in [(0, "t-left.exr"), (1, "t-right.exr")] {
        assert_eq!(input.read_level(part, 0).unwrap(), open(&place.path(file)).read_level(0, 0).unwrap());
    }
    assert!(!place.path("s-left.exr").exists());
}

#[test]
fn wrong_parts_and_mattes_are_reported() {
    let place = Place::new();
    place.write("show.gsl", SHADER);
    let good = "Output (\"@/good.exr\", \"exr\", \"rgb\", \"c\")\n";
    for (outputs, expected) in [
        (
            "Output (\"@/a.tif\", \"tiff\", \"rgb\", \"c\", \"string part\", \"x\")\n",
            "does not store the part \"x\"",
        ),
        ("Output (\"@/a.tif\", \"tiff\", \"cryptomatte object\", \"c\")\n", "does not store a Cryptomatte"),
        ("Output (\"@/a.exr\", \"exr\", \"cryptomatte asset\", \"c\")\n", "\"cryptomatte object\""),
        (
            "Output (\"@/a.exr\", \"exr\", \"cryptomatte object\", \"c\", \"string compression\", \"dwaa:10\")\n",
            "would change the ids",
        ),
        (
            "Output (\"@/a.exr\", \"exr\", \"cryptomatte object\", \"c\", \"int cryptomatte:ranks\", 1)\n",
            "outside 2 to 64",
        ),
    ] {
        let rendered = place.render(&scene(0, "", &format!("{outputs}{good}")));
        assert_eq!(rendered.said.len(), 1, "{:?}", rendered.said);
        assert!(rendered.said[0].contains(expected), "{:?}", rendered.said);
        assert!(place.path("good.exr").exists());
    }
}
