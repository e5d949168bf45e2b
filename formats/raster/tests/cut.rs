//! Files that end early. The available rows can be read, and the error of the others describes the cause.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use granita_image::{CreateOptions, Format, ImageInput, ImageSpec, Limits, PixelType, Pixels};
use granita_raster::formats;
use std::path::Path;
use std::sync::Arc;

fn format(name: &str) -> Arc<dyn Format> {
    formats().into_iter().find(|f| f.name() == name).unwrap()
}

fn open(name: &str, bytes: &[u8]) -> granita_image::Result<Box<dyn ImageInput>> {
    format(name).open_bytes(Path::new("cut"), bytes.into(), &Limits::default())
}

/// The images have 96 x 64 pixels each, in one pass, the same with a restart after every row of blocks, and in several
/// passes.
const SEQUENTIAL: &[u8] = include_bytes!("data/sequential.jpg");
const RESTARTS: &[u8] = include_bytes!("data/restarts.jpg");
const PROGRESSIVE: &[u8] = include_bytes!("data/progressive.jpg");

/// Returns the number of rows from the top that can be read.
fn rows(input: &dyn ImageInput) -> u32 {
    let height = input.spec(0, 0).unwrap().height;
    (0..height).take_while(|y| input.read_rows(0, 0, *y, y + 1).is_ok()).count() as u32
}

/// Checks that the file cut at `cut` bytes results in rows of the whole or an error. Returns the number of rows.
fn check(name: &str, whole: &[u8], cut: usize, same: bool) -> u32 {
    let Ok(input) = open(name, &whole[..cut]) else { return 0 };
    let all = open(name, whole).unwrap().read_rows(0, 0, 0, 64).unwrap();
    let there = rows(&*input);
    if there < 64 {
        let text = input.read_rows(0, 0, 0, 64).unwrap_err().to_string();
        assert!(text.contains("the file ends") || there == 0, "{name} {cut}: {text}");
        assert!(input.read_rows(0, 0, there, there + 1).is_err());
    }
    let got = input.read_rows(0, 0, 0, there).unwrap();
    if same {
        let mut expected = all;
        expected.truncate(got.len());
        assert!(got == expected, "{name} cut at {cut}: {there} rows");
    }
    there
}

#[test]
fn truncated_sequential_jpegs_give_their_first_rows() {
    for file in [SEQUENTIAL, RESTARTS] {
        assert_eq!(check("jpeg", file, file.len(), true), 64);
        // Without the end mark all rows are still available.
        assert_eq!(check("jpeg", file, file.len() - 2, true), 64);
        assert_eq!(check("jpeg", file, file.len() - 1, true), 64);
        let mut before = 0;
        for cut in (0..file.len() - 40).step_by(7) {
            let there = check("jpeg", file, cut, true);
            // A few rows may appear to be available by chance, with the correct pixels.
            assert!(there <= 64 && there + 16 >= before, "{cut}: {there} rows, {before} of a shorter file");
            before = there;
        }
        assert!((24..64).contains(&before), "{before}");
    }
}

#[test]
fn truncated_progressive_jpegs_always_miss_a_row() {
    let file = PROGRESSIVE;
    assert_eq!(check("jpeg", file, file.len(), true), 64);
    // The later passes of the available rows may still be missing. Some row is always reported as missing.
    for cut in (0..file.len()).step_by(9) {
        assert!(check("jpeg", file, cut, false) < 64, "{cut}");
    }
    let input = open("jpeg", &file[..file.len() * 3 / 4]).unwrap();
    assert_eq!(rows(&*input), 63);
    assert!(input.read_rows(0, 0, 0, 64).unwrap_err().to_string().contains("passes"));
}

#[test]
fn truncated_radiance_files_give_their_first_rows() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.hdr");
    let mut spec = ImageSpec::new(96, 64, 3, PixelType::Float);
    spec.channels = vec!["R".into(), "G".into(), "B".into()];
    let mut file = format("hdr").create(&path, &CreateOptions::new(&spec, 1)).unwrap();
    // Some rows are black. They are available as well.
    let values = (0..96 * 64 * 3).map(|i| if i / 288 % 5 == 0 { 0.0 } else { (i % 251) as f32 * 0.37 });
    file.write_rows(&Pixels::Float(values.collect())).unwrap();
    file.close().unwrap();
    let bytes = std::fs::read(&path).unwrap();
    assert_eq!(check("hdr", &bytes, bytes.len(), true), 64);
    let mut before = 0;
    for cut in (0..bytes.len()).step_by(97) {
        let there = check("hdr", &bytes, cut, true);
        assert!((before..64).contains(&there), "{cut}: {there} rows, {before} of a shorter file");
        before = there;
    }
    assert!(before > 60);
    let text = open("hdr", &bytes[..bytes.len() / 2]).unwrap().read_rows(0, 0, 0, 64).unwrap_err();
    assert!(text.to_string().contains("of 64 rows are there"), "{text}");
}
