//! Tests images inside of glTF files through the registry.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test, with a line number")]

use granita_image::{FormatRegistry, Limits, PixelType};
use granita_plugin::bundled_formats;
use std::path::{Path, PathBuf};

fn cards() -> Vec<u8> {
    std::fs::read(
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/suite/render/gltf-embedded/cards.glb"),
    )
    .unwrap()
}

fn error(registry: &FormatRegistry, path: &Path) -> String {
    match registry.open(path) {
        Ok(_) => String::new(),
        Err(error) => error.to_string(),
    }
}

#[test]
fn embedded_images_are_opened_by_their_number() {
    let registry = bundled_formats(Limits::default());
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("cards.glb");
    std::fs::write(&file, cards()).unwrap();
    let name = |n: &str| PathBuf::from(format!("{}#{n}", file.display()));
    for (n, side) in [("0", 32), ("1", 64)] {
        let input = registry.open(&name(n)).unwrap();
        let spec = input.spec(0, 0).unwrap().clone();
        assert_eq!(
            (spec.width, spec.height, spec.nchannels(), spec.pixel_type),
            (side, side, 3, PixelType::U8)
        );
        assert_eq!((input.images(), input.levels(0), input.levels(1)), (1, 1, 0));
        assert_eq!(input.read_level(0, 0).unwrap().len(), (side * side * 3) as usize);
        assert!(input.read_rows(1, 0, 0, 1).is_err() && input.bytes_read() > 0);
    }
    let all = registry.open(&file).unwrap();
    assert_eq!((all.images(), all.spec(1, 0).unwrap().width), (2, 64));
    assert!(error(&registry, &name("2")).contains("there is no image 2, the file has 2"));
    assert!(error(&registry, &name("x")).contains("No such file") || cfg!(windows));
    // A file with exactly this name has precedence.
    std::fs::write(name("1"), b"P6 1 1 255\n\x01\x02\x03").unwrap();
    assert_eq!(registry.open(&name("1")).unwrap().spec(0, 0).unwrap().width, 1);
}

#[test]
fn errors_of_embedded_images_name_their_cause() {
    let registry = bundled_formats(Limits { bytes: 1 << 20, ..Limits::default() });
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("a.gltf");
    for (images, expected) in [
        ("[]", "it holds no images"),
        ("[{}]", "image 0 has neither a URI nor a buffer view"),
        ("[{\"bufferView\": 7}]", "there is no buffer view 7"),
        ("[{\"bufferView\": 0}]", "bytes, of at most"),
        ("[{\"bufferView\": 1}]", "buffer 0 has no data"),
        ("[{\"uri\": \"data:image/png;base64,AAAA\"}]", "not an image of a known format"),
        ("[{\"uri\": \"data:image/png,AAAA\"}]", "not base64"),
        ("[{\"uri\": \"http://x/y.png\"}]", "is no file beside this one"),
        ("[{\"uri\": \"a.gltf\"}]", "not an image of a known format"),
        ("[3]", "image 0 is no image"),
    ] {
        let text = format!(
            "{{\"asset\": {{\"version\": \"2.0\"}}, \"images\": {images}, \"buffers\": [{{\"byteLength\": 9}}], \"bufferViews\": \
             [{{\"buffer\": 0, \"byteLength\": 9999999999}}, {{\"buffer\": 0, \"byteLength\": 9}}]}}"
        );
        std::fs::write(&file, text).unwrap();
        let said = error(&registry, &PathBuf::from(format!("{}#0", file.display())));
        assert!(said.contains(expected), "{images}: {said}");
    }
}

#[test]
fn damaged_glb_files_do_not_panic() {
    let registry = bundled_formats(Limits { bytes: 1 << 22, ..Limits::default() });
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("cards.glb");
    let whole = cards();
    let look = |bytes: &[u8]| {
        std::fs::write(&file, bytes).unwrap();
        let Ok(input) = registry.open(&file) else { return };
        for image in 0..input.images().min(4) {
            if input.spec(image, 0).is_some() {
                let _ = input.read_level(image, 0);
            }
        }
    };
    for n in (0..whole.len()).step_by(37) {
        look(&whole[..n]);
        let mut bytes = whole.clone();
        bytes[n] ^= 0x5a;
        look(&bytes);
    }
}
