//! The table of images.

/// An image that pages show.
pub(super) struct Image {
    /// The stored file, relative to the root. Of an image for two eyes, the name without `-left` and `-right`.
    pub(super) file: &'static str,
    /// The scene whose commands make what the frame needs, or the page of the manual with such commands.
    pub(super) recipe: &'static str,
    /// The scene that is rendered, without its commands. Of a page, `PAGE.md#FILE.pyg`.
    pub(super) frame: &'static str,
    /// Texts of the frame and what replaces them.
    pub(super) changes: &'static [(&'static str, &'static str)],
    /// Calls before the frame.
    pub(super) settings: &'static [&'static str],
    /// The data of the image, and the parameters of its `Output`.
    pub(super) data: &'static str,
    /// Options of `gelato`.
    pub(super) options: &'static [&'static str],
    /// The pixel at the upper left corner of the part that is checked.
    pub(super) corner: (u32, u32),
}

impl Image {
    /// Returns the stored files.
    pub(super) fn files(&self) -> Vec<String> {
        self.files_of(self.file)
    }

    /// Returns the files that an `Output` of this name writes.
    pub(super) fn files_of(&self, output: &str) -> Vec<String> {
        match output.rsplit_once('.') {
            Some((name, extension)) if self.settings.iter().any(|call| call.contains("stereo:")) => {
                ["left", "right"].map(|eye| format!("{name}-{eye}.{extension}")).to_vec()
            }
            _ => vec![output.to_owned()],
        }
    }
}

const FIRST: &str = "examples/first/first.pyg";
const ENVLIGHT: &str = "examples/envlight/envlight.pyg";
const OCCLUSION: &str = "examples/occlusion/occlusion.pyg";
const INDIRECT: &str = "examples/indirect/indirect.pyg";
const CAUSTICS: &str = "examples/caustics/caustics.pyg";
const SUBSURFACE: &str = "examples/subsurface/subsurface.pyg";
const SHADOWS: &str = "examples/shadows/shadows.pyg";
const RELIGHT: &str = "examples/relight/relight.pyg";

/// Colours for screens. Noise in the last bit would double the size of the file.
const COLOR: &str = "\"rgb\", \"camera\", \"float gamma\", 2.2, \"float dither\", 0";

/// The first example at half of its size.
const HALF: &[(&str, &str)] = &[("(1280, 800)", "(640, 400)")];

const fn whole(file: &'static str, scene: &'static str, corner: (u32, u32)) -> Image {
    Image {
        file,
        recipe: scene,
        frame: scene,
        changes: &[],
        settings: &[],
        data: COLOR,
        options: &[],
        corner,
    }
}

const fn part(file: &'static str, recipe: &'static str, frame: &'static str, corner: (u32, u32)) -> Image {
    Image { recipe, ..whole(file, frame, corner) }
}

const fn quick(file: &'static str, options: &'static [&'static str]) -> Image {
    Image { changes: HALF, options, ..whole(file, FIRST, (350, 210)) }
}

/// Normals from -1 to 1 as colours from 0 to 255.
const NORMALS: &str =
    "\"normal facing\", \"camera\", \"int[4] quantize\", (128, 255, 0, 255), \"float dither\", 0";

/// Depths from 6.5, white, to 13, black.
const DEPTH: &str = "\"z\", \"camera\", \"int[4] quantize\", (510, 471, 0, 255), \"float dither\", 0";

const fn layer(file: &'static str, data: &'static str) -> Image {
    let (page, frame) = ("docs/tutorials/outputs.md", "docs/tutorials/outputs.md#layers.pyg");
    Image { data, ..part(file, page, frame, (120, 60)) }
}

/// All images that the suite's own tools render.
pub(super) const IMAGES: &[Image] = &[
    whole("docs/pictures/first.jpg", FIRST, (740, 490)),
    quick("docs/pictures/preview-full.jpg", &[]),
    quick("docs/pictures/preview-preview.jpg", &["-preview", "0.1"]),
    quick("docs/pictures/preview-plain.jpg", &["-shade", "defaultsurface", "-preview", "0.25"]),
    quick("docs/pictures/preview-rim.jpg", &["-shade", "keyfillrim", "-preview", "0.5"]),
    Image {
        settings: &[
            "Attribute (\"float stereo:separation\", 0.6)",
            "Attribute (\"float stereo:convergence\", 15)",
        ],
        ..quick("docs/pictures/stereo.jpg", &[])
    },
    Image {
        changes: &[("\"float shadowbias\", 0.05", "\"float shadowbias\", 0")],
        ..part("docs/pictures/shadow-first.jpg", SHADOWS, "examples/shadows/plain.pyg", (180, 200))
    },
    Image {
        changes: &[
            ("\"float shadowblur\", 0.01", "\"float shadowblur\", 0.04"),
            ("shadowsamples\", 16", "shadowsamples\", 64"),
        ],
        ..part("docs/pictures/shadow-blur.jpg", SHADOWS, "examples/shadows/plain.pyg", (300, 220))
    },
    part("docs/pictures/shadow-woo.jpg", SHADOWS, "examples/shadows/woo.pyg", (300, 220)),
    part("docs/pictures/shadow-rays.jpg", SHADOWS, "examples/shadows/rays.pyg", (300, 220)),
    part("examples/shadows/plain.png", SHADOWS, "examples/shadows/plain.pyg", (300, 220)),
    part("examples/shadows/soft.png", SHADOWS, "examples/shadows/soft.pyg", (300, 220)),
    whole("docs/pictures/relight.jpg", RELIGHT, (560, 200)),
    whole("examples/occlusion/occlusion.png", OCCLUSION, (330, 180)),
    whole("examples/envlight/light.png", ENVLIGHT, (330, 200)),
    part("examples/envlight/sphere.png", ENVLIGHT, "examples/envlight/sphere.pyg", (330, 200)),
    whole("examples/indirect/indirect.png", INDIRECT, (180, 400)),
    whole("examples/caustics/caustics.png", CAUSTICS, (240, 130)),
    whole("examples/subsurface/subsurface.png", SUBSURFACE, (300, 60)),
    part(
        "docs/pictures/tutorial-first.jpg",
        "docs/tutorials/first-scene.md",
        "docs/tutorials/first-scene.md#still.pyg",
        (80, 60),
    ),
    part(
        "docs/pictures/tutorial-textures.jpg",
        "docs/tutorials/textures.md",
        "docs/tutorials/textures.md#tiled.pyg",
        (60, 70),
    ),
    part(
        "docs/pictures/tutorial-panorama.jpg",
        "docs/tutorials/panoramas.md",
        "docs/tutorials/panoramas.md#room.pyg",
        (60, 100),
    ),
    part(
        "docs/pictures/tutorial-lights.jpg",
        "docs/tutorials/lights.md",
        "docs/tutorials/lights.md#lamps.pyg",
        (240, 110),
    ),
    part(
        "docs/pictures/tutorial-hard.jpg",
        "docs/tutorials/shadows.md",
        "docs/tutorials/shadows.md#shade.pyg",
        (300, 100),
    ),
    part(
        "docs/pictures/tutorial-glass.jpg",
        "docs/tutorials/mirrors-and-glass.md",
        "docs/tutorials/mirrors-and-glass.md#mirrors.pyg",
        (180, 110),
    ),
    part(
        "docs/pictures/tutorial-hair.jpg",
        "docs/tutorials/hair.md",
        "docs/tutorials/hair.md#fur.pyg",
        (180, 50),
    ),
    part(
        "docs/pictures/tutorial-displacement.jpg",
        "docs/tutorials/displacement.md",
        "docs/tutorials/displacement.md#displaced.pyg",
        (330, 80),
    ),
    part(
        "docs/pictures/tutorial-subsurface.jpg",
        "docs/tutorials/subsurface.md",
        "docs/tutorials/subsurface.md#wax.pyg",
        (120, 100),
    ),
    part(
        "docs/pictures/tutorial-caustics.jpg",
        "docs/tutorials/caustics.md",
        "docs/tutorials/caustics.md#caustics.pyg",
        (170, 110),
    ),
    part(
        "docs/pictures/tutorial-rgba.jpg",
        "docs/tutorials/outputs.md",
        "docs/tutorials/outputs.md#layers.pyg",
        (120, 60),
    ),
    Image {
        changes: &[(
            "\"float shadowblur\", 0, \"float shadowsamples\", 1",
            "\"float shadowblur\", 0.15, \"float shadowsamples\", 64",
        )],
        ..part(
            "docs/pictures/tutorial-soft.jpg",
            "docs/tutorials/shadows.md",
            "docs/tutorials/shadows.md#shade.pyg",
            (300, 100),
        )
    },
    layer("docs/pictures/tutorial-normals.jpg", NORMALS),
    layer("docs/pictures/tutorial-depth.jpg", DEPTH),
];
