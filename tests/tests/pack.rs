//! Tests of everything that a scene reads in one folder (`gelato -pack`).

#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "a test that cannot go on fails")]

use granita_tests::{Image, Ran, Tools};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Two folders: that of the scene, "show/shot", and that of its textures and shaders.
struct Place {
    tools: Tools,
    folder: tempfile::TempDir,
}

/// A scene of a sphere for each way of naming a file. Frame 2 has another map.
const SCENE: &str = "Attribute (\"int[2] resolution\", (64, 32))\n\
    Attribute (\"string path:texture\", \".:SHOW/tex:$SHOW_MAPS:&\")\n\
    Attribute (\"string path:shader\", \".:../shaders:&\")\n\
    Output (\"out/a.$frame2.tif\", \"tiff\", \"rgb\", \"camera\")\n\
    Output (\"SHOW/render/b.$frame2.tif\", \"tiff\", \"rgb\", \"camera\")\n\
    Translate (0, 0, 4)\nWorld ()\n\
    Shader (\"surface\", \"wall\", \"string map\", \"same.tx\")\nSphere (1, -1, 1, 360)\n\
    Translate (1.2, 0, 0)\nShader (\"surface\", \"wall\", \"string map\", \"SHOW/other/same.tx\")\nSphere (1, -1, 1, 360)\n\
    Translate (-2.4, 0, 0)\nShader (\"surface\", \"wall\", \"string map\", \"../other/tile.<UDIM>.tx\")\n\
    Sphere (1, -1, 1, 360)\n\
    Translate (0, 0.6, 0)\nShader (\"surface\", \"wall\", \"string map\", \"frame.$frame2.tx\")\nSphere (1, -1, 1, 360)\n\
    Input (\"SHOW/parts/part.pyg\")\nRender ()\n";

const SHADER: &str = "#include \"SHOW/shaders/more.h\"\n\
    surface wall (string map = \"\") { C = (color) texture (map, u, v) * more; }\n";

impl Place {
    fn new() -> Self {
        let (tools, folder) = (Tools::build().unwrap(), tempfile::tempdir().unwrap());
        // The name without links, so that all ways lead to the same folders.
        let place = Self { tools, folder };
        for name in ["shot/out", "tex", "maps", "other", "shaders", "parts", "render", "home"] {
            std::fs::create_dir_all(place.show().join(name)).unwrap();
        }
        place.write("shot/shot.0001.pyg", SCENE);
        place.write("shot/shot.0002.pyg", SCENE);
        place.write("shaders/wall.gsl", SHADER);
        place.write("shaders/more.h", "#define more 0.8\n");
        place.write("parts/part.pyg", "Translate (1, -1.4, 0)\nSphere (0.5, -0.5, 0.5, 360)\n");
        place.write("home/.gelato.pyg", "Attribute (\"int[2] spatialquality\", (2, 2))\n");
        for (at, name) in
            ["tex/same", "other/same", "other/tile.1001", "other/tile.1002", "maps/frame.01", "maps/frame.02"]
                .into_iter()
                .enumerate()
        {
            place.texture(&format!("{name}.tx"), at);
        }
        place
    }

    fn show(&self) -> PathBuf {
        std::fs::canonicalize(self.folder.path()).unwrap().join("show")
    }

    fn shot(&self) -> PathBuf {
        self.show().join("shot")
    }

    fn write(&self, name: &str, text: &str) {
        let show = self.show().display().to_string();
        std::fs::write(self.show().join(name), text.replace("SHOW/", &format!("{show}/"))).unwrap();
    }

    /// Renders a texture of its own colours.
    fn texture(&self, name: &str, at: usize) {
        let scene = format!(
            "Attribute (\"int[2] resolution\", (8, 8))\nOutput (\"make.tif\", \"tiff\", \"rgb\", \"camera\")\n\
             Translate (0, 0, 1)\nWorld ()\nAttribute (\"color C\", (0.{at}, 0.5, 0.9))\n\
             Shader (\"surface\", \"constant\")\nSphere (9, -9, 9, 360)\nRender ()\n"
        );
        std::fs::write(self.show().join("make.pyg"), scene).unwrap();
        for (tool, words) in [("gelato", &["make.pyg"][..]), ("maketx", &["make.tif", "-o", name])] {
            let ran = self.tools.run(&self.show(), tool, words).unwrap();
            assert_eq!(ran.status, 0, "{}", ran.stderr);
        }
    }

    /// Runs gelato. The variable of the scene is set where `is_set`.
    fn run(&self, folder: &Path, words: &[&str], is_set: bool) -> Ran {
        let mut command = Command::new(self.tools.program("gelato"));
        command.current_dir(folder).args(words).env_remove("GELATOHOME").stdin(Stdio::null());
        command.env("HOME", if is_set { self.show().join("home") } else { self.show().join("nowhere") });
        if is_set {
            command.env("SHOW_MAPS", self.show().join("maps"));
        }
        let ran = command.output().unwrap();
        Ran {
            status: ran.status.code().unwrap(),
            stdout: String::from_utf8_lossy(&ran.stdout).into_owned(),
            stderr: String::from_utf8_lossy(&ran.stderr).into_owned(),
        }
    }
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
        .collect();
    names.sort_unstable();
    names
}

#[test]
fn packed_scenes_render_the_same_pixels_elsewhere() {
    let place = Place::new();
    let frames = ["-frames", "1-2", "shot.####.pyg"];
    let ran = place.run(&place.shot(), &frames, true);
    assert!(ran.status == 0 && ran.stderr.is_empty(), "{}", ran.stderr);
    let packed = place.folder.path().join("packed");
    let ran = place.run(&place.shot(), &[&["-pack", packed.to_str().unwrap()], &frames[..]].concat(), true);
    assert!(ran.status == 0 && ran.stderr.is_empty(), "{}", ran.stderr);
    assert!(ran.stdout.contains("gelato -cwd") && ran.stdout.contains("shot.####.pyg"), "{}", ran.stdout);
    assert_eq!(names(&packed), ["files", "gelato.pack.json", "out", "shot.0001.pyg", "shot.0002.pyg"]);
    let list: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(packed.join("gelato.pack.json")).unwrap()).unwrap();
    assert_eq!(list["files"].as_array().unwrap().len(), 12, "{list:#}");
    assert_eq!(list["variables"]["SHOW_MAPS"], place.show().join("maps").to_str().unwrap());
    let images = ["shot/out/a.01.tif", "shot/out/a.02.tif", "render/b.01.tif", "render/b.02.tif"];
    let read = |path: PathBuf| Image::read(&path).unwrap();
    let before = images.map(|name| read(place.show().join(name)));
    assert!(before[0] != before[1] && before[0] == before[2]);
    // Another machine has nothing of the show.
    let elsewhere = place.folder.path().join("elsewhere");
    std::fs::rename(&packed, &elsewhere).unwrap();
    std::fs::rename(place.show(), place.folder.path().join("gone")).unwrap();
    std::fs::create_dir(place.folder.path().join("show")).unwrap();
    let render = |words: &[&str]| {
        let ran = place.run(place.folder.path(), &[&["-cwd", "elsewhere"], words].concat(), false);
        assert!(ran.status == 0 && ran.stderr.is_empty(), "{}", ran.stderr);
    };
    let inside = elsewhere.join("files").join(place.show().strip_prefix("/").unwrap());
    let after = || {
        let files = ["a.01.tif", "a.02.tif"].map(|name| elsewhere.join("out").join(name));
        let others = ["b.01.tif", "b.02.tif"].map(|name| inside.join("render").join(name));
        files.into_iter().chain(others).map(|path| {
            let image = Image::read(&path).unwrap();
            std::fs::remove_file(path).unwrap();
            image
        })
    };
    render(&frames);
    assert!(after().eq(before.iter().cloned()));
    // With other processes as well.
    render(&[&["-net", "local local"], &frames[..]].concat());
    assert!(after().eq(before.iter().cloned()));
    assert_eq!(names(&place.show()), [""; 0]);
}

/// A scene of programs and scripts. "outside" stands for lines of Python that read a file elsewhere.
const PROGRAMS: &str = "import shapes\n\
    Attribute (\"int[2] resolution\", (64, 32))\nAttribute (\"string path:generator\", \"../programs:&\")\n\
    Output (\"a.tif\", \"tiff\", \"rgb\", \"camera\")\nTranslate (0, 0, 4)\nWorld ()\n\
    for line in open (\"list.txt\"):\n    Input (\"grass \" + line)\n\
    Input (\"pyg < sh make.sh < data.txt\")\nshapes.ball (0.3)\n\
    Input (\"far.pyg\", (900, 901, 900, 901, 900, 901))\nOUTSIDERender ()\n";

#[test]
fn programs_scripts_and_unneeded_inputs_are_packed() {
    if !granita_needs::has("python3") {
        return;
    }
    let place = Place::new();
    std::fs::create_dir(place.show().join("programs")).unwrap();
    let ball = "for x in \"$@\"; do echo \"Translate ($x, 0, 0)\"; echo 'Sphere (0.2, -0.2, 0.2, 360)'; done";
    granita_needs::write_script(&place.show().join("programs/grass"), ball);
    place.write(
        "shot/make.sh",
        "while read -r x; do echo \"Translate (0, $x, 0)\"; done\necho 'Sphere (0.4, -0.4, 0.4, 360)'\n",
    );
    place.write("shot/data.txt", "0.5\n");
    place.write("shot/list.txt", "1 0.2\n-2\n");
    place.write("shot/far.pyg", "Sphere (1, -1, 1, 360)\n");
    place.write("shot/shapes.py", "from gelato import *\ndef ball (r):\n    Sphere (r, -r, r, 360)\n");
    place.write("other/more.txt", "");
    place.write("shot/shot.pyg", &PROGRAMS.replace("OUTSIDE", ""));
    place
        .write("shot/outside.pyg", &PROGRAMS.replace("OUTSIDE", "open (\"SHOW/other/more.txt\").close ()\n"));
    let render = |folder: &Path, words: &[&str]| {
        let ran = place.run(folder, words, false);
        assert!(ran.status == 0 && ran.stderr.is_empty(), "{}", ran.stderr);
    };
    render(&place.shot(), &["shot.pyg"]);
    // Python keeps the compiled module, and the module is listed nevertheless.
    render(&place.shot(), &["shot.pyg"]);
    let before = Image::read(&place.shot().join("a.tif")).unwrap();
    let ran = place.run(&place.shot(), &["-assets", "shot.pyg"], false);
    let list: serde_json::Value = serde_json::from_str(&ran.stdout).unwrap();
    let mut kinds: Vec<String> = list["files"]
        .as_array()
        .unwrap()
        .iter()
        .map(|file| {
            let name = Path::new(file["name"].as_str().unwrap()).file_name().unwrap().to_string_lossy();
            format!("{} {name}", file["kind"].as_str().unwrap())
        })
        .collect();
    kinds.sort_unstable();
    let expected = [
        "program data.txt",
        "program make.sh",
        "scene far.pyg",
        "scene grass",
        "scene shot.pyg",
        "script list.txt",
        "script shapes.py",
    ];
    assert_eq!(kinds, expected, "{list:#}");
    let commands = ["Input grass 1 0.2", "Input grass -2", "Input pyg < sh make.sh < data.txt"];
    assert_eq!(list["commands"], serde_json::json!(commands));
    let ran = place.run(&place.shot(), &["-pack", "../../packed", "shot.pyg"], false);
    assert_eq!(ran.status, 0, "{}", ran.stderr);
    let said: Vec<&str> =
        ran.stderr.lines().filter(|line| !line.contains("the scene runs \"Input ")).collect();
    assert!(said.is_empty() && ran.stderr.lines().count() == 3, "{}", ran.stderr);
    // A file that a script opens by a name that leads out of the folder.
    let ran = place.run(&place.shot(), &["-pack", "../../other", "outside.pyg"], false);
    let part = "more.txt is packed, but scripts look for it at its old place";
    assert!(ran.status == 0 && ran.stderr.contains(part), "{}", ran.stderr);
    let packed = place.folder.path().join("packed");
    std::fs::rename(place.show(), place.folder.path().join("gone")).unwrap();
    render(place.folder.path(), &["-cwd", "packed", "shot.pyg"]);
    assert!(Image::read(&packed.join("a.tif")).unwrap() == before, "other pixels");
}

#[test]
fn packs_are_whole_or_not_there() {
    let place = Place::new();
    let pack = |folder: &str, scene: &str| place.run(&place.shot(), &["-pack", folder, scene], true);
    // A file that is missing.
    place.write(
        "shot/bad.pyg",
        "Output (\"a.tif\", \"tiff\", \"rgb\", \"camera\")\nWorld ()\nInput (\"none.pyg\")\nRender ()\n",
    );
    let ran = pack("new", "bad.pyg");
    assert!(ran.status == 2 && ran.stderr.contains("none.pyg"), "{}", ran.stderr);
    assert!(
        ran.stderr.contains("-pack new: the scene has errors (1), and nothing was written"),
        "{}",
        ran.stderr
    );
    let ran = pack("new", "absent.pyg");
    assert!(ran.status == 2 && ran.stderr.contains("absent.pyg"), "{}", ran.stderr);
    // Folders that are not free.
    for (folder, part) in [("out/..", "not an empty folder"), ("no/where/new", "no/where")] {
        let ran = pack(folder, "shot.0001.pyg");
        assert!(ran.status == 2 && ran.stderr.contains(part), "{}", ran.stderr);
    }
    let hidden = |name: &String| name.starts_with(".gelato-pack") || name == "new";
    assert!(!names(&place.shot()).iter().any(hidden), "{:?}", names(&place.shot()));
    // A texture without a file is a warning, as in a frame. An empty folder gives way.
    place.write(
        "shot/few.pyg",
        "Command (\"system true\")\nOutput (\"a.tif\", \"tiff\", \"rgb\", \"camera\")\nOutput (\"out/made.sm\", \"shadow\", \"z\", \"camera\")\nWorld ()\n\
         Attribute (\"string user:a\", \"lost.tx\")\nAttribute (\"string user:b\", \"made.sm\")\nSphere (1, -1, 1, 360)\nRender ()\n",
    );
    std::fs::create_dir(place.shot().join("new")).unwrap();
    let ran = pack("new", "few.pyg");
    assert_eq!(ran.status, 0, "{}", ran.stderr);
    assert!(ran.stderr.contains("\"lost.tx\" is the name of no file"), "{}", ran.stderr);
    assert!(ran.stderr.contains("the scene runs \"system true\""), "{}", ran.stderr);
    assert!(!ran.stderr.contains("made.sm"), "{}", ran.stderr);
    // A pack is not packed again, and a wrong list is an error.
    let new = place.shot().join("new");
    let ran = place.run(&new, &["-pack", "again", "few.pyg"], true);
    assert!(ran.status == 2 && ran.stderr.contains("is a packed one already"), "{}", ran.stderr);
    std::fs::write(new.join("gelato.pack.json"), "{\"pack\": 2}").unwrap();
    let ran = place.run(&new, &["few.pyg"], true);
    assert!(ran.status == 2 && ran.stderr.contains("gelato.pack.json: "), "{}", ran.stderr);
}
