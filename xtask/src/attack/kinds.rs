// tidy: table
//! The kinds of files that the tools read, and how each is read.

/// A kind of files.
pub(crate) struct Kind {
    /// The name of the kind, which is also that of its folder in `fuzz/corpus`.
    pub(crate) name: &'static str,
    /// The extension of the changed file, which is called `x.EXTENSION`. "{}" stands for this name in texts and
    /// commands.
    pub(crate) extension: &'static str,
    /// The files beside it, each with its name and text.
    pub(crate) beside: &'static [(&'static str, &'static str)],
    /// The commands that read it: a tool and its arguments, separated by spaces. "< FILE" at the end gives the standard
    /// input.
    pub(crate) commands: &'static [&'static str],
}

const TEXTURED: (&str, &str) = (
    "texture.pyg",
    r#"Attribute ("int[2] resolution", (24, 16))
Output ("out.png", "png", "rgb", "camera")
Light ("fill", "ambientlight")
World ()
Translate (0, 0, 2)
Shader ("surface", "texmap", "string texturename", "{}")
Patch ("linear", 2, 2, "vertex point P", (-1, -1, 0, 1, -1, 0, -1, 1, 0, 1, 1, 0))
Render ()
"#,
);

const SURROUNDED: (&str, &str) = (
    "environment.pyg",
    r#"Attribute ("int[2] resolution", (24, 16))
Output ("out.png", "png", "rgb", "camera")
World ()
Light ("sky", "envlight", "string envname", "{}", "float samples", 4)
Shader ("surface", "envsurf", "string envname", "{}")
Sphere (5, -5, 5, 360)
Shader ("surface", "matte")
Translate (0, 0, 3)
Sphere (1, -1, 1, 360)
Render ()
"#,
);

const SHADOWED: (&str, &str) = (
    "shadow.pyg",
    r#"Attribute ("int[2] resolution", (24, 16))
Output ("out.png", "png", "rgb", "camera")
Translate (0, 0, 5)
World ()
Light ("sun", "distantlight", "point from", (0, 0, -1), "point to", (0, 0, 0), "string shadowname", "{}", "float shadowsamples", 4)
Shader ("surface", "matte")
Patch ("linear", 2, 2, "vertex point P", (-3, -3, 2, 3, -3, 2, -3, 3, 2, 3, 3, 2))
Render ()
"#,
);

const SURFACE: (&str, &str) = (
    "shader.pyg",
    r#"Attribute ("int[2] resolution", (24, 16))
Output ("out.png", "png", "rgb", "camera")
World ()
Light ("key", "distantlight")
Translate (0, 0, 3)
Shader ("surface", "x")
Sphere (1, -1, 1, 360)
Render ()
"#,
);

const PHOTONS: (&str, &str) = (
    "photons.pyg",
    r#"Attribute ("int[2] resolution", (24, 16))
Output ("out.png", "png", "rgb", "camera")
World ()
Light ("caustics", "causticlight", "string photonfile", "{}", "float maxpixeldist", 4, "float minphotons", 3)
Translate (0, 0, 3)
Shader ("surface", "matte")
Sphere (1, -1, 1, 360)
Render ()
"#,
);

const INSIDE: (&str, &str) = (
    "input.pyg",
    r#"Attribute ("int[2] resolution", (24, 16))
Output ("out.png", "png", "rgb", "camera")
World ()
Light ("key", "distantlight")
Translate (0, 0, 5)
Shader ("surface", "plastic")
Input ("{}")
Render ()
"#,
);

/// The commands for every image.
const IMAGE: &[&str] = &[
    "maketx {} -o out.tx -threads 1",
    "iv -info {}",
    "iv -thumbnail out.png {}",
    "gelato texture.pyg",
    "iv -stats {}",
    "maketx -envlatl {} -o out.env -threads 1",
];

const fn image(name: &'static str, extension: &'static str) -> Kind {
    Kind { name, extension, beside: &[TEXTURED], commands: IMAGE }
}

const fn geometry(name: &'static str, extension: &'static str) -> Kind {
    Kind {
        name,
        extension,
        beside: &[INSIDE],
        commands: &["gelato -safe input.pyg", "topyg -r 1 -o out.pyg {}"],
    }
}

/// All kinds, with those of untrusted files first.
pub(crate) const KINDS: &[Kind] = &[
    image("tiff", "tif"),
    image("exr", "exr"),
    image("png", "png"),
    image("jpeg", "jpg"),
    Kind {
        name: "pyg",
        extension: "pyg",
        beside: &[],
        commands: &["topyg -r 1 -o out.txt {}", "gelato -safe {}"],
    },
    Kind { name: "gsl", extension: "gsl", beside: &[], commands: &["gslc -o out.gso {}", "gsoinfo -v {}"] },
    Kind {
        name: "gso",
        extension: "gso",
        beside: &[SURFACE],
        commands: &["gsoinfo -v {}", "gelato shader.pyg", "gslc -run -grid 16x16 -o out.png {}"],
    },
    geometry("obj", "obj"),
    geometry("gltf", "gltf"),
    geometry("ply", "ply"),
    geometry("stl", "stl"),
    geometry("rib", "rib"),
    Kind {
        name: "mtl",
        extension: "mtl",
        beside: &[INSIDE_MTL, TEXTURED_MESH],
        commands: &["gelato -safe input.pyg"],
    },
    Kind {
        name: "texture",
        extension: "tx",
        beside: &[TEXTURED, SURROUNDED, SHADOWED],
        commands: &[
            "gelato texture.pyg",
            "gelato environment.pyg",
            "gelato shadow.pyg",
            "iv -info {}",
            "iv -stats {}",
        ],
    },
    Kind {
        name: "volz",
        extension: "vz",
        beside: &[SHADOWED],
        commands: &[
            "maketx -volshad {} -opaquewidth 0.05 -o out.vsm -threads 1",
            "iv -info {}",
            "gelato shadow.pyg",
        ],
    },
    Kind {
        name: "sdb",
        extension: "sdb",
        beside: &[PHOTONS],
        commands: &["gsoinfo -v {}", "gelato photons.pyg"],
    },
    Kind { name: "calls", extension: "calls", beside: &[], commands: &["gelato -safe -stream < {}"] },
    Kind { name: "remote", extension: "calls", beside: &[], commands: &["gelato -safe -remote < {}"] },
    Kind {
        name: "worker",
        extension: "lines",
        beside: &[SURFACE],
        commands: &["gelato -safe -worker shader.pyg < {}"],
    },
    image("dds", "dds"),
    image("dpx", "dpx"),
    image("cineon", "cin"),
    image("psd", "psd"),
    image("fits", "fits"),
    image("rla", "rla"),
    image("softimage", "pic"),
    image("ico", "ico"),
    image("jpegxl", "jxl"),
    image("jpeg2000", "jp2"),
    image("hdr", "hdr"),
    image("iff", "iff"),
    image("sgi", "sgi"),
    image("tga", "tga"),
    image("gif", "gif"),
    image("bmp", "bmp"),
    image("pnm", "ppm"),
    image("pfm", "pfm"),
    image("qoi", "qoi"),
    image("webp", "webp"),
];

/// A mesh whose file of materials is changed.
const TEXTURED_MESH: (&str, &str) = (
    "mesh.obj",
    "mtllib {}\nv -1 -1 0\nv 1 -1 0\nv 1 1 0\nv -1 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nusemtl red\nf 1/1 2/2 3/3\nusemtl wood\nf 1/1 3/3 4/4\n",
);

const INSIDE_MTL: (&str, &str) = (
    "input.pyg",
    r#"Attribute ("int[2] resolution", (24, 16))
Output ("out.png", "png", "rgb", "camera")
World ()
Light ("key", "distantlight")
Translate (0, 0, 5)
Input ("mesh.obj")
Render ()
"#,
);
