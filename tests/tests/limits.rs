//! Tests the tools with few open files.

#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use granita_tests::{Image, Tools};
use std::fmt::Write;
use std::path::Path;
use std::process::Command;

/// Makes a tiled texture of one colour.
fn texture(tools: &Tools, place: &Path) {
    std::fs::write(place.join("a.ppm"), [b"P6 64 64 255\n".to_vec(), vec![128; 3 * 64 * 64]].concat())
        .unwrap();
    let made = tools.run(place, "maketx", &["a.ppm", "-o", "t.tx"]).unwrap();
    assert_eq!(made.status, 0, "{}", made.stderr);
}

/// A frame with many textures is rendered while few files may be open. All textures and the image must be complete.
#[test]
fn many_textures_are_rendered_with_few_open_files() {
    const TEXTURES: usize = 150;
    let tools = Tools::build().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path();
    texture(&tools, place);
    let mut scene = String::from(
        "Attribute (\"int[2] resolution\", (60, 10))\nAttribute (\"string projection\", \"orthographic\")\n\
         Output (\"o.tif\", \"tiff\", \"rgb\", \"camera\")\nWorld ()\nTranslate (0, 0, 5)\nLight (\"a\", \"ambientlight\")\n",
    );
    for i in 0..TEXTURES {
        std::fs::copy(place.join("t.tx"), place.join(format!("t{i}.tx"))).unwrap();
        let (x, next) = (i as f64 / 10.0 - 7.5, (i + 1) as f64 / 10.0 - 7.5);
        writeln!(
            scene,
            "Parameter (\"string texturename\", \"t{i}.tx\")\nShader (\"surface\", \"paintedplastic\", \"float Ks\", 0)\n\
             Patch (\"linear\", 2, 2, \"vertex point P\", ({x}, 9, 0, {next}, 9, 0, {x}, -9, 0, {next}, -9, 0))"
        )
        .unwrap();
    }
    scene.push_str("Render (\"camera\")\n");
    std::fs::write(place.join("s.pyg"), scene).unwrap();
    let mut images = Vec::new();
    // In the second case only the soft limit is low, and the tool raises it.
    for limits in ["ulimit -n 4096", "ulimit -Sn 16; ulimit -Hn 4096", "ulimit -n 64", "ulimit -n 40"] {
        let ran = Command::new("sh")
            .args(["-c", &format!("{limits} 2>/dev/null; exec \"$0\" \"$@\"")])
            .arg(tools.program("gelato"))
            .args(["-threads", "2", "s.pyg"])
            .current_dir(place)
            .output()
            .unwrap();
        let said = String::from_utf8_lossy(&ran.stderr);
        assert!(ran.status.success() && said.is_empty(), "{limits}: {said}");
        images.push(std::fs::read(place.join("o.tif")).unwrap());
        std::fs::remove_file(place.join("o.tif")).unwrap();
    }
    assert!(images.iter().all(|image| *image == images[0]));
    std::fs::write(place.join("o.tif"), &images[0]).unwrap();
    assert!(Image::read(&place.join("o.tif")).is_ok());
}
