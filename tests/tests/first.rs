//! Tests the first example of the README at a quarter of its size. The image must be the same to the bit for all
//! numbers of threads, orders and sizes of buckets, and crops.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use granita_tests::{Image, Tools, copy_first};

#[test]
fn the_first_image_of_the_manual_is_the_same_to_the_bit() {
    let tools = Tools::build().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path();
    copy_first(place).unwrap();
    let gelato = |arguments: &[&str]| {
        let ran = tools.run(place, "gelato", arguments).unwrap();
        assert!(ran.status == 0 && ran.stderr.is_empty(), "{arguments:?}: {}\n{}", ran.status, ran.stderr);
    };
    let scene = "examples/first/first.pyg";
    gelato(&[scene, "-o", "whole.exr"]);
    assert!(Image::read(&place.join("examples/first/out/first.png")).unwrap().is_varied());
    let whole = Image::read(&place.join("whole.exr")).unwrap();

    // The frame is rendered again without its commands, with settings before it.
    let text = std::fs::read_to_string(place.join(scene)).unwrap();
    let frame: String =
        text.lines().filter(|l| !l.starts_with("Command")).map(|l| format!("{l}\n")).collect();
    std::fs::write(place.join("frame.pyg"), frame).unwrap();
    let render = |name: &str, settings: &str, threads: &str| {
        let before = format!("{name}.pyg");
        std::fs::write(place.join(&before), settings).unwrap();
        let image = format!("{name}.exr");
        gelato(&["-threads", threads, &before, "frame.pyg", "-o", &image]);
        Image::read(&place.join(image)).unwrap()
    };
    let variants = [
        ("two-threads", "", "2"),
        ("horizontal", "Attribute (\"string bucketorder\", \"horizontal\")\n", "2"),
        ("vertical", "Attribute (\"string bucketorder\", \"vertical\")\n", "1"),
        ("spiral", "Attribute (\"string bucketorder\", \"spiral\")\n", "2"),
        ("small-buckets", "Attribute (\"int[2] limits:bucketsize\", (16, 16))\n", "1"),
        ("large-buckets", "Attribute (\"int[2] limits:bucketsize\", (64, 64))\n", "2"),
    ];
    for (name, settings, threads) in variants {
        let same = whole.identical(&render(name, settings, threads));
        assert_eq!(same, Ok(()), "{name}");
    }
    let crops = ["0, 0.37, 0, 0.41", "0.37, 1, 0, 0.41", "0, 0.37, 0.41, 1", "0.37, 1, 0.41, 1"];
    let parts: Vec<Image> = crops
        .iter()
        .enumerate()
        .map(|(i, crop)| {
            render(&format!("crop{i}"), &format!("Attribute (\"float[4] crop\", ({crop}))\n"), "1")
        })
        .collect();
    assert_eq!(whole.is_assembled_of(&parts), Ok(()));
}
