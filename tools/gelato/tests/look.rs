//! Tests of objects that are shown without a scene around them.

#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test, with a line number")]

mod folder;

use folder::Folder;

const SMALL: &str =
    "Attribute (\"int[2] resolution\", (48, 36))\nAttribute (\"int[2] spatialquality\", (2, 2))\n";

/// A box of 2 x 1 x 1 that stands on y = 3.
const BOX: &str = "v -1 3 -1\nv 1 3 -1\nv 1 3 0\nv -1 3 0\nv -1 4 -1\nv 1 4 -1\nv 1 4 0\nv -1 4 0\n\
    f 1 2 3 4\nf 5 8 7 6\nf 1 5 6 2\nf 2 6 7 3\nf 3 7 8 4\nf 4 8 5 1\n";

struct Place(Folder);

impl std::ops::Deref for Place {
    type Target = Folder;

    fn deref(&self) -> &Folder {
        &self.0
    }
}

/// An image of floats.
struct Pixels {
    width: usize,
    values: Vec<f32>,
}

impl Pixels {
    /// Returns a pixel, x to the right and y down.
    fn at(&self, x: usize, y: usize) -> [f32; 3] {
        self.values[(y * self.width + x) * 3..][..3].try_into().unwrap()
    }
}

impl Place {
    fn new() -> Self {
        Self(Folder::with(&[("small.pyg", SMALL), ("box.obj", BOX)]))
    }

    /// Returns the names of the images in the folder, sorted.
    fn images(&self) -> Vec<String> {
        let image = |n: &String| [".png", ".pfm", ".tif", ".exr"].iter().any(|ending| n.ends_with(ending));
        self.names().into_iter().filter(image).collect()
    }

    /// Reads an image in the format PFM, whose rows go up.
    fn pixels(&self, name: &str) -> Pixels {
        let bytes = self.bytes(name);
        let mut lines = bytes.splitn(4, |b| *b == b'\n');
        let mut line = || String::from_utf8(lines.next().unwrap().to_vec()).unwrap();
        let (kind, size, scale) = (line(), line(), line());
        assert!(kind == "PF" && scale.starts_with('-'), "{kind} {scale}");
        let width: usize = size.split(' ').next().unwrap().parse().unwrap();
        let data = lines.next().unwrap().as_chunks::<4>().0;
        let rows: Vec<f32> = data.iter().map(|b| f32::from_le_bytes(*b)).collect();
        let values = rows.chunks(width * 3).rev().flatten().copied().collect();
        Pixels { width, values }
    }
}

#[test]
fn a_model_is_shown_in_a_studio() {
    let place = Place::new();
    let ran = place.run(&["small.pyg", "box.obj"]);
    let want = "box.obj: without Render (), shown in a studio: box-look.png\n";
    assert_eq!((ran.status, ran.said.as_str()), (0, want));
    assert_eq!(place.images(), ["box-look.png"]);
    assert!(place.bytes("box-look.png").starts_with(b"\x89PNG"));

    // In linear light: nothing is white, the floor is darker beside the object, and the floor has no border.
    assert_eq!(place.run(&["-silent", "small.pyg", "box.obj", "-data", "rgb", "-o", "a.pfm"]).said, "");
    assert_eq!(place.images(), ["a.pfm", "box-look.png"]);
    let image = place.pixels("a.pfm");
    assert!(image.values.iter().all(|x| (0.02..0.98).contains(x)), "{:?}", image.values);
    let row = |y: usize| (0..48).map(|x| image.at(x, y)[1]).collect::<Vec<_>>();
    let darkest = (22..34).flat_map(row).fold(1.0, f32::min);
    assert!(darkest < 0.7 * image.at(2, 30)[1], "{darkest} {:?}", image.at(2, 30));
    for y in 0..35 {
        let step = (image.at(1, y + 1)[1] - image.at(1, y)[1]).abs();
        assert!(step < 0.03, "{y}: {:?}", row(y));
    }
    // The same for any number of threads.
    assert_eq!(
        place.run(&["-threads", "1", "small.pyg", "box.obj", "-data", "rgb", "-o", "b.pfm"]).status,
        0
    );
    assert_eq!(place.bytes("b.pfm"), place.bytes("a.pfm"));
}

#[test]
fn a_turntable_is_an_image_for_each_angle() {
    let place = Place::new();
    place.write(
        "red.pyg",
        &format!("{SMALL}Attribute (\"color C\", (1, 0, 0))\nShader (\"surface\", \"constant\")\n"),
    );
    let ran = place.run(&["red.pyg", "box.obj", "-turntable", "4", "-data", "rgb", "-o", "spin.pfm"]);
    let want = "box.obj: without Render (), shown in a studio: spin-001.pfm to spin-004.pfm\n";
    assert_eq!((ran.status, ran.said.as_str()), (0, want));
    let names = ["spin-001.pfm", "spin-002.pfm", "spin-003.pfm", "spin-004.pfm"];
    assert_eq!(place.images(), names);
    // Half a turn leaves the outline of a box as it is, except for the perspective. A quarter does not.
    let covered = |name: &str| {
        let image = place.pixels(name);
        (0..48).filter(|x| image.at(*x, 18)[0] > 0.5 + image.at(*x, 18)[1]).count()
    };
    let widths: Vec<usize> = names.iter().map(|name| covered(name)).collect();
    assert!(widths[0].abs_diff(widths[2]) <= 3 && widths[0].abs_diff(widths[1]) > 3, "{widths:?}");
    let first = place.pixels(names[0]).values;
    assert_ne!(first, place.pixels(names[2]).values);
    // The background stays where it is.
    assert!((place.pixels(names[3]).at(2, 2)[1] - first[(2 * 48 + 2) * 3 + 1]).abs() < 0.01);

    place.write(
        "whole.pyg",
        &format!("{SMALL}World ()\nTranslate (0, 0, 5)\nSphere (1, -1, 1, 360)\nRender ()\n"),
    );
    let ran = place.run(&["whole.pyg", "-turntable", "4", "-o", "whole.png"]);
    assert!(
        ran.said.contains("-turntable has no effect: the scene has a Render () of its own"),
        "{}",
        ran.said
    );
    assert_eq!(ran.status, 1);
}

#[test]
fn what_the_files_say_is_obeyed() {
    let place = Place::new();
    // A camera, an image and a light.
    let own = "Output (\"own.pfm\", \"pfm\", \"rgb\", \"eye\")\nTranslate (0, 3.5, 30)\nScale (1, 1, -1)\nCamera (\"eye\")\n\
        SetTransform (\"world\")\nLight (\"l\", \"ambientlight\", \"float intensity\", 0.5)\nAttribute (\"color C\", (1, 0, 0))\n";
    place.write(
        "own.pyg",
        &format!("{SMALL}Attribute (\"float fov\", 6)\nShader (\"surface\", \"constant\")\n{own}"),
    );
    let ran = place.run(&["own.pyg", "box.obj"]);
    assert_eq!((ran.status, place.images()), (0, vec!["own.pfm".to_owned()]), "{}", ran.said);
    let image = place.pixels("own.pfm");
    assert_eq!(image.at(24, 18), [1.0, 0.0, 0.0]);
    // Objects of Pyg, as they are and after a World.
    for (name, text) in [
        ("ball.pyg", "Sphere (1, -1, 1, 360)"),
        ("world.pyg", "World ()\nSphere (1, -1, 1, 360)\n"),
        (
            "box.stl",
            "solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 1\nendloop\nendfacet\nendsolid\n",
        ),
    ] {
        place.write(name, text);
        let ran = place.run(&["small.pyg", name, "-up", "z"]);
        assert_eq!(ran.status, 0, "{name}: {}", ran.said);
        assert!(ran.said.contains(&format!("{name}: without Render ()")), "{}", ran.said);
        assert!(place.images().contains(&name.replace(".pyg", "-look.png").replace(".stl", "-look.png")));
    }
    let ran = place.run(&["small.pyg", "pyg << Sphere (1, -1, 1, 360)"]);
    assert!(ran.status == 0 && place.images().contains(&"scene-look.png".to_owned()), "{}", ran.said);
}

#[test]
fn files_that_cannot_be_shown_leave_no_image() {
    let place = Place::new();
    for (name, bytes, status, says) in [
        ("none.glb", &b"glTF\x02\0\0\0"[..], 2, "none.glb: the file ends in its header"),
        ("empty.obj", b"# nothing\n", 2, "nothing was rendered: empty.obj"),
        ("far.obj", b"v 0 0 nan\nv 0 0 1\nv 0 1 0\nf 1 2 3\n", 2, "far.obj:4: error"),
        ("late.pyg", b"Sphere (1, -1, 1, 360)\nWorld ()\nRender ()\n", 1, "Sphere before World"),
    ] {
        place.write(name, bytes);
        let ran = place.run(&["small.pyg", name]);
        assert!(ran.said.contains(says), "{name}: {}", ran.said);
        assert_eq!(ran.status, status, "{name}: {}", ran.said);
        let left: Vec<String> = place.images().into_iter().filter(|n| n.contains("look")).collect();
        assert!(left.is_empty(), "{left:?}");
    }
    assert_eq!(place.run(&["box.obj", "-turntable", "0"]).status, 2);
    assert_eq!(place.run(&["box.obj", "-up", "x"]).status, 2);
}
