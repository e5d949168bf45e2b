// tidy: table
//! Tests `-safe` with untrusted scenes. Each route is a scene that tries to read, write or start a file outside of its
//! folder. The kernel reports every file that is opened, made, moved or removed there. Most routes also run without
//! `-safe` and must then reach the file, so that a route that is broken by itself does not count.

#![cfg(target_os = "linux")]
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use granita_tests::Tools;
use rustix::fs::inotify::{self, CreateFlags, WatchFlags};
use std::os::fd::OwnedFd;
use std::os::unix::fs::{PermissionsExt, symlink};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// The calls before the world of a small image.
const HEAD: &str = "Camera (\"c\", \"int[2] resolution\", (8, 8), \"string projection\", \"orthographic\", \"float[4] screen\", (-1, 1, -1, 1))\n\
    Output (\"o.tif\", \"tiff\", \"rgb\", \"c\")\n";
/// A square, and the call that renders.
const BODY: &str = "Patch (\"linear\", 2, 2, \"vertex point P\", (-1, 1, 1,  1, 1, 1,  -1, -1, 1,  1, -1, 1), \"vertex float[2] st\", (0, 0, 1, 0, 0, 1, 1, 1))\nRender ()\n";

/// The files outside. Everything in their folder is watched.
const OUTSIDE: [(&str, &str); 12] = [
    ("a.ppm", "P3\n1 1\n255\n255 0 0\n"),
    ("s.gsl", "surface s () { C = color (1, 0, 0); }\n"),
    ("h.h", "#define RED color (1, 0, 0)\n"),
    ("a.pyg", "Sphere (1, -1, 1, 360)\n"),
    ("a.obj", "v 0 0 1\nv 1 0 1\nv 0 1 1\nf 1 2 3\n"),
    ("a.mtl", "newmtl m\nKd 1 0 0\n"),
    ("a.rib", "Sphere 1 -1 1 360\n"),
    ("a.ply", "ply\nformat ascii 1.0\nelement vertex 0\nend_header\n"),
    ("a.bin", "000000000000000000000000000000000000"),
    ("a.sdb", "no database"),
    ("run", "#!/bin/sh\n: > \"$(dirname \"$0\")/started\"\n"),
    ("notes.txt", "of a person"),
];

/// A way to a file outside.
struct Route {
    name: &'static str,
    /// The files beside the scene: name and text. `@` before a name makes a link to the text.
    files: &'static [(&'static str, &'static str)],
    /// The calls before the world and in it. `{out}` stands for the folder outside, and `{rel}` for the relative path
    /// to it.
    before: &'static str,
    within: &'static str,
    /// True when the route reaches the file without `-safe`.
    arrives: bool,
}

const fn read(name: &'static str, within: &'static str) -> Route {
    Route { name, files: &[], before: "", within, arrives: true }
}

const fn begin(name: &'static str, before: &'static str) -> Route {
    Route { name, files: &[], before, within: "", arrives: true }
}

const fn with(
    name: &'static str,
    files: &'static [(&'static str, &'static str)],
    before: &'static str,
    within: &'static str,
) -> Route {
    Route { name, files, before, within, arrives: true }
}

/// Marks a route that does not reach the file without `-safe` either.
const fn vain(route: Route) -> Route {
    Route { arrives: false, ..route }
}

const ROUTES: &[Route] = &[
    // These routes read textures and maps.
    read(
        "texture, absolute",
        "Shader (\"surface\", \"paintedplastic\", \"string texturename\", \"{out}/a.ppm\")\n",
    ),
    read(
        "texture, relative",
        "Shader (\"surface\", \"paintedplastic\", \"string texturename\", \"{rel}/a.ppm\")\n",
    ),
    read(
        "texture, one of several images",
        "Shader (\"surface\", \"paintedplastic\", \"string texturename\", \"{out}/a.ppm#0\")\n",
    ),
    with(
        "texture, path of the scene",
        &[],
        "Attribute (\"string path:texture\", \"{out}\")\n",
        "Shader (\"surface\", \"paintedplastic\", \"string texturename\", \"a.ppm\")\n",
    ),
    with(
        "texture, path by a variable",
        &[],
        "Attribute (\"string path:texture\", \"$OUTSIDE\")\n",
        "Shader (\"surface\", \"paintedplastic\", \"string texturename\", \"a.ppm\")\n",
    ),
    with(
        "texture, link to a file",
        &[("@t.ppm", "{out}/a.ppm")],
        "",
        "Shader (\"surface\", \"paintedplastic\", \"string texturename\", \"t.ppm\")\n",
    ),
    with(
        "texture, link to a folder",
        &[("@t", "{out}")],
        "",
        "Shader (\"surface\", \"paintedplastic\", \"string texturename\", \"t/a.ppm\")\n",
    ),
    with(
        "texture, link to a link",
        &[("@u", "{out}"), ("@t.ppm", "u/a.ppm")],
        "",
        "Shader (\"surface\", \"paintedplastic\", \"string texturename\", \"t.ppm\")\n",
    ),
    with(
        "texture, down and up",
        &[("sub/x", "")],
        "",
        "Shader (\"surface\", \"paintedplastic\", \"string texturename\", \"sub/../{rel}/a.ppm\")\n",
    ),
    with(
        "environment",
        &[("e.gsl", "surface e (string n = \"\") { C = environment (n, I); }\n")],
        "",
        "Shader (\"surface\", \"e\", \"string n\", \"{out}/a.ppm\")\n",
    ),
    with(
        "shadow",
        &[("e.gsl", "surface e (string n = \"\") { C = shadow (n, P); }\n")],
        "",
        "Shader (\"surface\", \"e\", \"string n\", \"{out}/a.ppm\")\n",
    ),
    with(
        "texture3d",
        &[("e.gsl", "surface e (string n = \"\") { C = (float) texture3d (n, P); }\n")],
        "",
        "Shader (\"surface\", \"e\", \"string n\", \"{out}/a.ppm\")\n",
    ),
    with(
        "gettextureinfo",
        &[(
            "e.gsl",
            "surface e (string n = \"\") { float r[2]; gettextureinfo (n, \"resolution\", r); C = r[0]; }\n",
        )],
        "",
        "Shader (\"surface\", \"e\", \"string n\", \"{out}/a.ppm\")\n",
    ),
    read(
        "light with a map",
        "Light (\"l\", \"envlight\", \"string envname\", \"{out}/a.ppm\")\nShader (\"surface\", \"matte\")\n",
    ),
    read(
        "image in a glTF file",
        "Shader (\"surface\", \"paintedplastic\", \"string texturename\", \"{out}/a.bin#1\")\n",
    ),
    vain(read(
        "the process's own environment",
        "Shader (\"surface\", \"paintedplastic\", \"string texturename\", \"/proc/self/environ\")\n",
    )),
    vain(read(
        "a device",
        "Shader (\"surface\", \"paintedplastic\", \"string texturename\", \"/dev/zero\")\n",
    )),
    // These routes read shaders.
    read("shader, absolute", "Shader (\"surface\", \"{out}/s\")\n"),
    read("shader, relative", "Shader (\"surface\", \"{rel}/s\")\n"),
    with(
        "shader, path of the scene",
        &[],
        "Attribute (\"string path:shader\", \"{out}\")\n",
        "Shader (\"surface\", \"s\")\n",
    ),
    with("shader, link", &[("@l.gsl", "{out}/s.gsl")], "", "Shader (\"surface\", \"l\")\n"),
    with(
        "shader, include absolute",
        &[("e.gsl", "#include \"{out}/h.h\"\nsurface e () { C = RED; }\n")],
        "",
        "Shader (\"surface\", \"e\")\n",
    ),
    with(
        "shader, include relative",
        &[("e.gsl", "#include \"{rel}/h.h\"\nsurface e () { C = RED; }\n")],
        "",
        "Shader (\"surface\", \"e\")\n",
    ),
    with(
        "shader, include of a link",
        &[("@i.h", "{out}/h.h"), ("e.gsl", "#include \"i.h\"\nsurface e () { C = RED; }\n")],
        "",
        "Shader (\"surface\", \"e\")\n",
    ),
    read("light shader", "Light (\"l\", \"{out}/s\")\nShader (\"surface\", \"matte\")\n"),
    read("displacement shader", "Shader (\"displacement\", \"{out}/s\")\n"),
    // These routes read scenes and geometry.
    read("Input, absolute", "Input (\"{out}/a.pyg\")\n"),
    read("Input, relative", "Input (\"{rel}/a.pyg\")\n"),
    with(
        "Input, path of the scene",
        &[],
        "Attribute (\"string path:input\", \"{out}\")\n",
        "Input (\"a.pyg\")\n",
    ),
    with("Input, link", &[("@i.pyg", "{out}/a.pyg")], "", "Input (\"i.pyg\")\n"),
    read("Input with a bound", "Input (\"{out}/a.pyg\", (-1, 1, -1, 1, 0, 2))\n"),
    read("Input by name of the reader", "Input (\"pyg {out}/a.pyg\")\n"),
    read("OBJ", "Input (\"{out}/a.obj\")\n"),
    read("OBJ by name of the reader", "Input (\"obj {out}/a.obj\")\n"),
    read("PLY", "Input (\"{out}/a.ply\")\n"),
    read("RIB", "Input (\"{out}/a.rib\")\n"),
    with(
        "library of an OBJ file",
        &[("m.obj", "mtllib {rel}/a.mtl\nv 0 0 1\nv 1 0 1\nv 0 1 1\nusemtl m\nf 1 2 3\n")],
        "",
        "Input (\"m.obj\")\n",
    ),
    with(
        "map of an MTL file",
        &[
            (
                "m.obj",
                "mtllib m.mtl\nv -1 -1 1\nv 1 -1 1\nv 0 1 1\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl m\nf 1/1 2/2 3/3\n",
            ),
            ("m.mtl", "newmtl m\nmap_Kd {out}/a.ppm\n"),
        ],
        "",
        "Input (\"m.obj\")\n",
    ),
    with("buffer of a glTF file", &[("g.gltf", GLTF)], "", "Input (\"g.gltf\")\n"),
    with(
        "link to the buffer of a glTF file",
        &[("@b.bin", "{out}/a.bin"), ("g.gltf", GLTF_LINK)],
        "",
        "Input (\"g.gltf\")\n",
    ),
    with(
        "archive of a RIB file, absolute",
        &[("r.rib", "ReadArchive \"{out}/a.rib\"\n")],
        "",
        "Input (\"r.rib\")\n",
    ),
    with(
        "archive of a RIB file, relative",
        &[("r.rib", "ReadArchive \"{rel}/a.rib\"\n")],
        "",
        "Input (\"r.rib\")\n",
    ),
    with(
        "archive of a RIB file, link",
        &[("@x.rib", "{out}/a.rib"), ("r.rib", "ReadArchive \"x.rib\"\n")],
        "",
        "Input (\"r.rib\")\n",
    ),
    with("database", &[("e.gsl", ASK)], "", "Shader (\"surface\", \"e\", \"string n\", \"{out}/a.sdb\")\n"),
    with(
        "database, link",
        &[("@l.sdb", "{out}/a.sdb"), ("e.gsl", ASK)],
        "",
        "Shader (\"surface\", \"e\", \"string n\", \"l.sdb\")\n",
    ),
    // These routes write files.
    begin("Output, absolute", "Output (\"{out}/new.tif\", \"tiff\", \"rgb\", \"c\")\n"),
    begin("Output, relative", "Output (\"{rel}/new.tif\", \"tiff\", \"rgb\", \"c\")\n"),
    begin("Output over a file", "Output (\"{out}/notes.txt\", \"tiff\", \"rgb\", \"c\")\n"),
    begin("Output, hidden", "Output (\"{out}/.profile\", \"ppm\", \"rgb\", \"c\")\n"),
    begin("Output, EXR", "Output (\"{rel}/new.exr\", \"exr\", \"rgb\", \"c\")\n"),
    with(
        "Output through a link to a folder",
        &[("@sub", "{out}")],
        "Output (\"sub/new.tif\", \"tiff\", \"rgb\", \"c\")\n",
        "",
    ),
    with(
        "Output through a link to a file",
        &[("@new.tif", "{out}/notes.txt")],
        "Output (\"new.tif\", \"tiff\", \"rgb\", \"c\")\n",
        "",
    ),
    vain(with(
        "Output into a planted folder",
        &[("@s.out", "{out}")],
        "Output (\"new.tif\", \"tiff\", \"rgb\", \"c\")\n",
        "",
    )),
    vain(with(
        "Output over a planted link",
        &[("@s.out/new.tif", "{out}/notes.txt"), ("s.out/.granita-made", "{scene}\tnew.tif\n")],
        "Output (\"new.tif\", \"tiff\", \"rgb\", \"c\")\n",
        "",
    )),
    vain(with(
        "Output below a planted link",
        &[("@s.out/sub", "{out}")],
        "Output (\"sub/new.tif\", \"tiff\", \"rgb\", \"c\")\n",
        "",
    )),
    begin("error log", "Attribute (\"string error:filename\", \"{out}/errors.log\")\nNoSuchCall ()\n"),
    begin(
        "error log, relative",
        "Attribute (\"string error:filename\", \"{rel}/errors.log\")\nNoSuchCall ()\n",
    ),
    begin(
        "error log over a startup file",
        "Attribute (\"string error:filename\", \"{out}/.gelato.pyg\")\nNoSuchCall ()\n",
    ),
    begin(
        "statistics",
        "Attribute (\"int statistics:level\", 1)\nAttribute (\"string statistics:filename\", \"{out}/s.txt\")\n",
    ),
    begin(
        "list of files read",
        "Command (\"fileread\", \"string name\", \"# \\ntouch x\")\nAttribute (\"string debug:filesread\", \"{out}/.bashrc\")\n",
    ),
    begin("grid dump", "Attribute (\"string griddump:filename\", \"{out}/g.pyg\")\n"),
    with(
        "database written",
        &[("e.gsl", SAVE)],
        "",
        "Shader (\"surface\", \"e\", \"string n\", \"{out}/new.sdb\")\n",
    ),
    with(
        "database as an image",
        &[("e.gsl", SAVE_IMAGE)],
        "",
        "Shader (\"surface\", \"e\", \"string n\", \"{out}/new.tif\")\n",
    ),
    with(
        "fprintf",
        &[("e.gsl", "surface e (string n = \"\") { fprintf (n, \"x\"); }\n")],
        "",
        "Shader (\"surface\", \"e\", \"string n\", \"{out}/new.log\")\n",
    ),
    begin("mkdir", "Command (\"mkdir\", \"string name\", \"{out}/new\")\n"),
    begin("unlink", "Command (\"unlink\", \"string name\", \"{out}/notes.txt\")\n"),
    // These routes start programs.
    begin("system, a line", "Command (\"system {out}/run\")\n"),
    begin("system, words", "Command (\"system\", \"string[1] command\", (\"{out}/run\",))\n"),
    begin(
        "system, not waited for",
        "Command (\"system\", \"string[1] argv\", (\"{out}/run\",), \"int wait\", 0)\n",
    ),
    read("Input of a program", "Input (\"pyg < {out}/run\")\n"),
    read("Input of a program for another reader", "Input (\"rib < {out}/run\")\n"),
    with(
        "Input of an executable",
        &[],
        "Attribute (\"string path:generator\", \"{out}\")\n",
        "Input (\"run 1 2\")\n",
    ),
    read("Input of an executable by its name", "Input (\"{out}/run\")\n"),
    with("Input of a linked executable", &[("@prog", "{out}/run")], "", "Input (\"prog\")\n"),
    begin("Python", "import os\nos.system (\"{out}/run\")\n"),
    read("Python in a string", "Input (\"pyg << import os; os.system ('{out}/run')\")\n"),
    with("Python in a file", &[("p.py", "import os\nos.system (\"{out}/run\")\n")], "", "Input (\"p.py\")\n"),
    begin(
        "worker",
        "Attribute (\"string net:workercmd\", \"{out}/run\")\nAttribute (\"string net:workers\", \"local\")\n",
    ),
    begin("generator library", "Attribute (\"string path:generator\", \"{out}\")\nInput (\"wave 1\")\n"),
    begin(
        "format library",
        "Attribute (\"string path:imageio\", \"{out}\")\nOutput (\"n.wave\", \"wave\", \"rgb\", \"c\")\n",
    ),
    with(
        "library of shader functions",
        &[("e.gsl", "surface e () { C = wave (1); }\n")],
        "Attribute (\"string path:shader\", \".:{out}\")\n",
        "Shader (\"surface\", \"e\")\n",
    ),
];

const GLTF: &str = r#"{"asset":{"version":"2.0"},"buffers":[{"uri":"{rel}/a.bin","byteLength":36}],
 "bufferViews":[{"buffer":0,"byteLength":36}],
 "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,1]}],
 "meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],"nodes":[{"mesh":0}],"scenes":[{"nodes":[0]}],"scene":0}"#;
const GLTF_LINK: &str = r#"{"asset":{"version":"2.0"},"buffers":[{"uri":"b.bin","byteLength":36}],
 "bufferViews":[{"buffer":0,"byteLength":36}],
 "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3","min":[0,0,0],"max":[1,1,1]}],
 "meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],"nodes":[{"mesh":0}],"scenes":[{"nodes":[0]}],"scene":0}"#;
const ASK: &str = "surface e (string n = \"\") { color c = 0; spatialdbquery (n, P, normalize (N), c, \"filemode\", \"r\"); C = c; }\n";
const SAVE: &str =
    "surface e (string n = \"\") { spatialdbsave (n, P, normalize (N), C, \"filemode\", \"w\"); }\n";
const SAVE_IMAGE: &str = "surface e (string n = \"\") { float r[2] = {8, 8}; spatialdbsave (n, u, v, C, \"filemode\", \"wo\", \"resolution\", r); }\n";

/// The folder of an untrusted scene beside one that it must not use.
struct Place {
    dir: tempfile::TempDir,
    watch: OwnedFd,
}

impl Place {
    fn new(route: &Route) -> Self {
        let dir = tempfile::tempdir().unwrap();
        for folder in ["scene", "outside", "user"] {
            std::fs::create_dir(dir.path().join(folder)).unwrap();
        }
        let outside = dir.path().join("outside");
        for (name, text) in OUTSIDE {
            std::fs::write(outside.join(name), text).unwrap();
        }
        for library in ["wave.generator.so", "wave.imageio.so", "wave.so"] {
            std::fs::write(outside.join(library), "no library").unwrap();
        }
        std::fs::set_permissions(outside.join("run"), std::fs::Permissions::from_mode(0o755)).unwrap();
        let place = Self { dir, watch: inotify::init(CreateFlags::NONBLOCK | CreateFlags::CLOEXEC).unwrap() };
        for (name, text) in route.files {
            let path = place.scene(name.trim_start_matches('@'));
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            let text = place.filled(text);
            if name.starts_with('@') {
                symlink(text, path).unwrap();
            } else {
                std::fs::write(path, text).unwrap();
            }
        }
        let scene =
            format!("{}{HEAD}World ()\n{}{BODY}", place.filled(route.before), place.filled(route.within));
        // The outputs of a route belong to the camera.
        let scene = match route.before.contains("Output") {
            true => format!("{HEAD}{}World ()\n{BODY}", place.filled(route.before)),
            false => scene,
        };
        std::fs::write(place.scene("s.pyg"), scene).unwrap();
        let flags = WatchFlags::OPEN
            | WatchFlags::CREATE
            | WatchFlags::MODIFY
            | WatchFlags::MOVED_FROM
            | WatchFlags::MOVED_TO
            | WatchFlags::DELETE;
        inotify::add_watch(&place.watch, &outside, flags).unwrap();
        place
    }

    fn scene(&self, name: &str) -> PathBuf {
        self.dir.path().join("scene").join(name)
    }

    fn filled(&self, text: &str) -> String {
        text.replace("{out}", &self.dir.path().join("outside").to_string_lossy())
            .replace("{rel}", "../outside")
            .replace("{scene}", &self.scene("s.pyg").to_string_lossy())
    }

    /// Returns the files outside that were used since the last call.
    fn touched(&self) -> Vec<String> {
        let mut space = [std::mem::MaybeUninit::uninit(); 1 << 16];
        let mut reader = inotify::Reader::new(&self.watch, &mut space);
        let mut names = Vec::new();
        while let Ok(event) = reader.next() {
            // An event without a name is for the folder itself, in which searches may look.
            if let Some(name) = event.file_name() {
                names.push(name.to_string_lossy().into_owned());
            }
        }
        names.sort();
        names.dedup();
        names
    }

    fn run(&self, tools: &Tools, name: &str, arguments: &[&str]) -> (i32, String) {
        let ran = Command::new(tools.program(name))
            .args(arguments)
            .current_dir(self.dir.path().join("scene"))
            .env_remove("GELATOHOME")
            .env("HOME", self.dir.path().join("user"))
            .env("OUTSIDE", self.dir.path().join("outside"))
            .stdin(Stdio::null())
            .output()
            .unwrap();
        (ran.status.code().unwrap_or(-1), String::from_utf8_lossy(&ran.stderr).into_owned())
    }
}

#[test]
fn scenes_with_safe_touch_no_file_outside() {
    let tools = Tools::build().unwrap();
    assert!(ROUTES.len() >= 60, "{} routes", ROUTES.len());
    let mut wrong = Vec::new();
    for route in ROUTES {
        let open = Place::new(route);
        open.run(&tools, "gelato", &["s.pyg"]);
        let touched = open.touched();
        if touched.is_empty() == route.arrives {
            wrong.push(format!("{}: without -safe it touches {touched:?}", route.name));
        }
        for arguments in [&["-safe", "s.pyg"][..], &["-safe", "-nofence", "s.pyg"]] {
            let place = Place::new(route);
            let (status, messages) = place.run(&tools, "gelato", arguments);
            let touched = place.touched();
            if !touched.is_empty() {
                wrong.push(format!("{} {arguments:?}: touches {touched:?}", route.name));
            }
            if !(0..=2).contains(&status) {
                wrong.push(format!("{} {arguments:?}: status {status}", route.name));
            }
            // A refused file is reported, and the rest of the frame is rendered.
            let refused = route.arrives && !route.name.starts_with("Output through");
            if refused && !messages.contains("error") && !messages.contains("warning") {
                wrong.push(format!("{} {arguments:?}: nothing is said: {messages}", route.name));
            }
            if status != 2
                && !place.scene("s.out/o.tif").is_file()
                && !route.files.iter().any(|f| f.0 == "@s.out")
            {
                wrong.push(format!("{} {arguments:?}: no image: {messages}", route.name));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

#[test]
fn scenes_with_safe_read_the_files_that_they_made() {
    let tools = Tools::build().unwrap();
    let route = with("", &[("sub/t.ppm", "P3\n1 1\n255\n0 255 0\n")], "", "");
    let place = Place::new(&route);
    // In the first scene, one camera makes an image that the next camera needs. In the second one, a texture lies
    // beside the scene and is named absolutely.
    let scene = format!(
        "{}Output (\"deep/p.tif\", \"tiff\", \"rgb\", \"d\")\n{HEAD}World ()\nShader (\"surface\", \"paintedplastic\", \"string texturename\", \"deep/p.tif\")\n{BODY}",
        HEAD.lines().next().unwrap().replace("\"c\"", "\"d\"") + "\n"
    );
    let absolute = place.scene("sub/t.ppm");
    let second = format!(
        "{HEAD}Output (\"q.tif\", \"tiff\", \"rgb\", \"c\")\nWorld ()\nShader (\"surface\", \"paintedplastic\", \"string texturename\", \"{}\")\n{BODY}",
        absolute.display()
    );
    for (text, made) in [(scene.as_str(), "deep/p.tif"), (second.as_str(), "q.tif")] {
        std::fs::write(place.scene("s.pyg"), text).unwrap();
        // The scene is rendered twice. The second run may replace the files of the first one.
        for _ in 0..2 {
            let (_, messages) = place.run(&tools, "gelato", &["-safe", "s.pyg"]);
            assert!(!messages.contains("-safe)"), "{messages}");
            assert!(place.scene("s.out").join(made).is_file(), "{made}: {messages}");
        }
    }
    // The command line may write anywhere, and may choose another folder.
    let elsewhere = place.dir.path().join("user/x.png");
    let (status, messages) = place.run(
        &tools,
        "gelato",
        &["-safe", "-o", elsewhere.to_str().unwrap(), "-safeout", "results", "s.pyg"],
    );
    assert!(status == 0 && !messages.contains("-safe"), "{messages}");
    assert!(elsewhere.is_file() && place.scene("results").is_dir());
    assert!(place.touched().is_empty());
}

#[test]
fn links_changed_during_a_safe_run_open_no_file_outside() {
    let tools = Tools::build().unwrap();
    let route = with("", &[("t.ppm", "P3\n1 1\n255\n0 255 0\n")], "", "");
    let place = Place::new(&route);
    let mut scene = format!("{HEAD}World ()\n");
    for i in 0..200 {
        let patch = BODY.lines().next().unwrap();
        scene += &format!(
            "Shader (\"surface\", \"paintedplastic\", \"string texturename\", \"l.ppm#{i}\")\n{patch}\n"
        );
        symlink("l.ppm", place.scene(&format!("l{i}.ppm"))).unwrap();
        scene += &format!(
            "Shader (\"surface\", \"paintedplastic\", \"string texturename\", \"l{i}.ppm\")\n{patch}\n"
        );
    }
    std::fs::write(place.scene("s.pyg"), scene + "Render ()\n").unwrap();
    let running = std::sync::atomic::AtomicBool::new(true);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            let (link, new) = (place.scene("l.ppm"), place.scene("new"));
            while running.load(std::sync::atomic::Ordering::Relaxed) {
                for target in ["t.ppm", "../outside/a.ppm"] {
                    symlink(target, &new).unwrap();
                    std::fs::rename(&new, &link).unwrap();
                }
            }
        });
        for _ in 0..3 {
            place.run(&tools, "gelato", &["-safe", "-nofence", "s.pyg"]);
        }
        running.store(false, std::sync::atomic::Ordering::Relaxed);
    });
    assert_eq!(place.touched(), Vec::<String>::new());
}

#[test]
fn safe_confines_topyg_and_maketx_too() {
    let tools = Tools::build().unwrap();
    let route = with(
        "",
        &[
            ("g.gltf", GLTF_IMAGE),
            ("c.pyg", "Attribute (\"int limits:inputlevels\", 9)\nInput (\"{out}/a.pyg\")\n"),
        ],
        "",
        "",
    );
    let cases: [(&str, &[&str]); 3] =
        [("topyg", &["-r", "3", "c.pyg"]), ("topyg", &["c.pyg"]), ("maketx", &["-o", "o.tx", "g.gltf"])];
    for (tool, arguments) in cases {
        let open = Place::new(&route);
        open.run(&tools, tool, arguments);
        assert!(!open.touched().is_empty(), "{tool} {arguments:?}");
        for safe in [&["-safe"][..], &["-safe", "-nofence"]] {
            let place = Place::new(&route);
            place.run(&tools, tool, &[safe, arguments].concat());
            assert_eq!(place.touched(), Vec::<String>::new(), "{tool} {safe:?} {arguments:?}");
        }
    }
    // A script runs without -safe, and not with it.
    let script = with("", &[("p.pyg", "import os\nos.system (\"{out}/run\")\n")], "", "");
    for safe in [&["-safe"][..], &["-safe", "-nofence"]] {
        let place = Place::new(&script);
        let (status, messages) = place.run(&tools, "topyg", &[safe, &["p.pyg"]].concat());
        assert!(status != 0 && !messages.is_empty() && place.touched().is_empty(), "{messages}");
    }
    // A file that the user names is written.
    let place = Place::new(&with("", &[("t.ppm", "P3\n1 1\n255\n0 255 0\n")], "", ""));
    let (status, messages) = place.run(&tools, "maketx", &["-safe", "-o", "../user/o.tx", "t.ppm"]);
    assert!(status == 0 && Path::new(&place.dir.path().join("user/o.tx")).is_file(), "{messages}");
}

const GLTF_IMAGE: &str = r#"{"asset":{"version":"2.0"},"images":[{"uri":"{rel}/a.ppm"}]}"#;
