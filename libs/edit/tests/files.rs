// tidy: tests
//! Files that are read and written.
#![allow(clippy::unwrap_used, reason = "tests")]

mod support;

use granita_edit::{Binary, EditError, File, Image, Tiling, Turn, WriteOptions, write};
use granita_image::{CreateOptions, ImageSpec, PixelType, Pixels};
use std::path::Path;
use support::{all, apart, constant, formats, noise, stored, window};

fn written(image: &Image, path: &Path, options: &WriteOptions) -> Vec<String> {
    write(image, path, &formats(), options).unwrap()
}

#[test]
fn values_survive_files_of_every_type() {
    let folder = tempfile::tempdir().unwrap();
    let image = noise(window(0, 0, 37, 21), 3, 1);
    for (name, pixel_type, error) in [
        ("a.png", PixelType::U8, 0.5 / 255.0),
        ("b.png", PixelType::U16, 0.5 / 65535.0),
        ("c.exr", PixelType::Half, 1.0 / 2048.0),
        ("d.exr", PixelType::Float, 0.0),
        ("e.tif", PixelType::U8, 0.5 / 255.0),
        ("f.tif", PixelType::Float, 0.0),
        ("g.pfm", PixelType::Float, 0.0),
    ] {
        let read = stored(&image, &folder.path().join(name), Some(pixel_type));
        assert_eq!(read.spec().pixel_type, pixel_type, "{name}");
        assert!(apart(&all(&read), &all(&image)) <= error * 1.0001, "{name}");
    }
}

#[test]
fn types_and_channels_that_a_format_lacks_are_noted() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let image = noise(window(0, 0, 8, 8), 6, 1);
    let notes = written(&image, &path("a.png"), &WriteOptions::default());
    assert!(
        notes.len() == 1 && notes[0].contains("channel4, channel5") && notes[0].contains("a.png"),
        "{notes:?}"
    );
    let read = File::open(&path("a.png"), &formats()).unwrap().image(0, 0).unwrap();
    assert_eq!((read.spec().nchannels(), read.spec().pixel_type), (4, PixelType::U16));
    let half = WriteOptions { pixel_type: Some(PixelType::Half), ..WriteOptions::default() };
    let notes = written(&noise(window(0, 0, 8, 8), 3, 1), &path("b.png"), &half);
    assert!(notes.len() == 1 && notes[0].contains("does not store half"), "{notes:?}");
    // Alpha is left out of a JPEG.
    let notes = written(&noise(window(0, 0, 8, 8), 4, 1), &path("c.jpg"), &WriteOptions::default());
    assert!(notes.len() == 1 && notes[0].contains("channels A"), "{notes:?}");
    for (name, expected) in [("d.nothing", "no format is known"), ("d", "has no extension"), ("d.psd", "psd")]
    {
        let error = write(&image, &path(name), &formats(), &WriteOptions::default()).unwrap_err().to_string();
        assert!(error.contains(expected) && error.contains(name), "{error}");
        assert!(!path(name).exists());
    }
}

#[test]
fn windows_are_cropped_where_a_format_has_none() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let image = constant(window(2, 1, 4, 4), &[1.0]).with_full(window(0, 0, 8, 8)).unwrap();
    let read = stored(&image, &path("a.exr"), None);
    assert_eq!((read.data(), read.full()), (window(2, 1, 4, 4), window(0, 0, 8, 8)));
    let read = stored(&image, &path("a.png"), Some(PixelType::U8));
    assert_eq!((read.data(), all(&read)[0], all(&read)[10]), (window(0, 0, 8, 8), 0.0, 1.0));
    written(&image, &path("b.png"), &WriteOptions { keep_data: true, ..WriteOptions::default() });
    let read = File::open(&path("b.png"), &formats()).unwrap().image(0, 0).unwrap();
    assert_eq!(read.data(), window(0, 0, 4, 4));
}

#[test]
fn tiles_and_compression_are_written() {
    let folder = tempfile::tempdir().unwrap();
    let image = noise(window(0, 0, 150, 90), 3, 1);
    for name in ["a.tif", "a.exr"] {
        let path = folder.path().join(name);
        let tiles = WriteOptions {
            tiling: Tiling::Tiles(64, 32),
            compression: Some("zip".to_owned()),
            ..WriteOptions::default()
        };
        written(&image, &path, &tiles);
        let read = File::open(&path, &formats()).unwrap().image(0, 0).unwrap();
        assert_eq!((read.spec().tile_width, read.spec().tile_height), (64, 32));
        assert_eq!(read.spec().string("compression"), Some("zip"), "{name}");
        assert_eq!(all(&read), all(&image), "{name}");
        // The tiles of a file are kept, and removed on request.
        let copy = folder.path().join(format!("copy.{name}"));
        assert_eq!(stored(&read, &copy, None).spec().tile_width, 64);
        written(&read, &copy, &WriteOptions { tiling: Tiling::Scanlines, ..WriteOptions::default() });
        assert_eq!(File::open(&copy, &formats()).unwrap().image(0, 0).unwrap().spec().tile_width, 0);
    }
}

#[test]
fn copies_keep_every_bit_and_colours_are_multiplied_before_computing() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let spec = ImageSpec::new(2, 1, 4, PixelType::U8);
    let mut spec = spec;
    spec.attributes.set(granita_base::Param::declared("int unassociatedalpha", 1).unwrap());
    let bytes = vec![200, 100, 50, 0, 200, 100, 50, 128];
    let mut file = formats().create(&path("a.png"), "png", &CreateOptions::new(&spec, 1)).unwrap();
    file.write_rows(&Pixels::U8(bytes.clone())).unwrap();
    file.close().unwrap();
    let image = File::open(&path("a.png"), &formats()).unwrap().image(0, 0).unwrap();
    let copy = stored(&image.turned(Turn::FLIP, 1 << 20).unwrap(), &path("b.png"), None);
    assert_eq!(copy.source().rows(0, 1).unwrap(), Pixels::U8(bytes));
    let linear = stored(&image, &path("c.exr"), Some(PixelType::Float));
    assert!(apart(&all(&linear)[..4], &[0.0; 4]) == 0.0);
    assert!((all(&linear)[4] - 200.0 * 128.0 / 255.0 / 255.0).abs() < 1e-6);
    // Colours are divided by alpha before they are rounded.
    let sum = image.with_constant(Binary::Mul, &[1.0]).unwrap();
    let Pixels::U8(back) = stored(&sum, &path("d.png"), None).source().rows(0, 1).unwrap() else { panic!() };
    assert_eq!(back[4..], [200, 100, 50, 128]);
}

#[test]
fn an_image_replaces_its_own_file() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.exr", "a.png", "a.tif"] {
        let path = folder.path().join(name);
        let image = stored(&noise(window(0, 0, 20, 300), 3, 1), &path, Some(PixelType::U8));
        let expected = all(&image.turned(Turn::HALF, 1 << 20).unwrap());
        let again = File::open(&path, &formats()).unwrap().image(0, 0).unwrap();
        let turned = stored(&again.turned(Turn::HALF, 1 << 20).unwrap(), &path, None);
        assert_eq!(all(&turned), expected, "{name}");
    }
}

#[test]
fn a_damaged_input_leaves_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let (path, out) = (folder.path().join("a.exr"), folder.path().join("b.exr"));
    written(&noise(window(0, 0, 200, 400), 3, 1), &path, &WriteOptions::default());
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    let result = File::open(&path, &formats())
        .and_then(|file| file.image(0, 0))
        .and_then(|image| write(&image, &out, &formats(), &WriteOptions::default()));
    let error = result.unwrap_err().to_string();
    assert!(error.contains("a.exr"), "{error}");
    assert!(!out.exists());
    assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
}

#[test]
fn images_and_levels_of_files_are_selected() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.tx");
    let (first, second) = (
        ImageSpec::new(4, 4, 1, PixelType::U8).tiled(16, 16),
        ImageSpec::new(2, 2, 1, PixelType::U8).tiled(16, 16),
    );
    let mut file = formats().create(&path, "tiff", &CreateOptions::new(&first, 2)).unwrap();
    file.write_tile(0, 0, &Pixels::U8(vec![255; 256])).unwrap();
    file.next_level(&second).unwrap();
    file.write_tile(0, 0, &Pixels::U8(vec![51; 256])).unwrap();
    file.close().unwrap();
    let file = File::open(&path, &formats()).unwrap();
    assert_eq!((file.images(), file.levels(0)), (1, 2));
    assert_eq!(all(&file.image(0, 1).unwrap()), [0.2; 4]);
    for (image, level, expected) in [(0, 2, "no level 2"), (1, 0, "no image 1")] {
        match file.image(image, level) {
            Err(error @ EditError::Unsupported { .. }) => {
                assert!(error.to_string().contains(expected), "{error}")
            }
            other => panic!("{other:?}"),
        }
    }
}

#[test]
fn small_images_are_held() {
    let image = noise(window(0, 0, 10, 10), 3, 1).with_constant(Binary::Mul, &[2.0]).unwrap();
    let held = image.held(1 << 20).unwrap();
    assert_eq!(all(&held), all(&image));
    assert!(std::sync::Arc::ptr_eq(image.source(), image.held(10).unwrap().source()));
}
