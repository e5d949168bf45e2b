//! The tools, the job and the folders of `cargo xtask farm`.

use crate::workspace::{Workspace, cargo};
use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// The frames of the job.
pub(super) const FRAMES: u32 = 24;

/// The frames of a task of the job.
pub(super) const CHUNK: u32 = 4;

/// The name of the large frame, which workers render together.
pub(super) const LARGE: &str = "large.pyg";

/// The longest wait for anything.
const LONGEST: Duration = Duration::from_secs(240);

/// The images of a run by their names, as bytes.
pub(super) type Images = BTreeMap<String, Vec<u8>>;

/// The tools, and a folder that is deleted at the end.
pub(super) struct Place {
    /// The folder of the tools.
    pub(super) bins: PathBuf,
    /// The folder of everything that is written.
    pub(super) scratch: PathBuf,
}

impl Place {
    /// Builds the tools, and makes the folder.
    pub(super) fn new(debug: bool, fixed: bool) -> Result<Self, String> {
        let root = Workspace::load()?.root;
        println!("farm: building the tools");
        let mut command = Command::new(cargo());
        command.current_dir(&root).args(["build", "--quiet", "--bins"]);
        if fixed {
            // The tests of the whole workspace were built before, with these features of dependencies.
            command.args(["--workspace", "--lib", "--tests"]);
        } else {
            command.args(["--package", "gelato", "--package", "maketx"]);
        }
        if !debug {
            command.arg("--release");
        }
        if !command.status().map_err(|error| format!("cargo: {error}"))?.success() {
            return Err("the tools cannot be built".to_owned());
        }
        let target = std::env::var_os("CARGO_TARGET_DIR").map_or_else(|| root.join("target"), PathBuf::from);
        let bins = target.join(if debug { "debug" } else { "release" });
        let scratch = std::env::temp_dir().join(format!("granita-farm-{}", std::process::id()));
        fs::create_dir_all(&scratch).map_err(|error| format!("{}: {error}", scratch.display()))?;
        Ok(Self { bins, scratch })
    }

    /// Returns a command with the tools on its path.
    pub(super) fn command(&self, program: &str, folder: &Path) -> Command {
        let own = self.bins.join(program);
        let mut command = if own.is_file() { Command::new(own) } else { Command::new(program) };
        let path = std::env::var("PATH").unwrap_or_default();
        command.current_dir(folder).stdin(Stdio::null()).env_remove("GELATOHOME");
        command.env("PATH", format!("{}:{path}", self.bins.display()));
        command
    }

    /// Makes a folder with the job: a step that makes a texture, one that makes the depth maps of a lamp, and one that
    /// renders the frames.
    pub(super) fn job(&self, name: &str) -> Result<PathBuf, String> {
        let folder = self.scratch.join(name);
        let told = |error: io::Error| format!("{}: {error}", folder.display());
        fs::create_dir_all(folder.join("out")).map_err(told)?;
        let write = |name: &str, text: String| fs::write(folder.join(name), text).map_err(told);
        for frame in 1..=FRAMES {
            write(&format!("map.{frame:04}.pyg"), map(frame))?;
            write(&format!("shot.{frame:04}.pyg"), shot(frame, &format!("shot.{frame:04}"), (160, 120), 4))?;
        }
        write(LARGE, shot(1, "large", (480, 360), 10))?;
        write("wood.pyg", WOOD.to_owned())?;
        let steps = format!(
            "{{\"name\": \"shot\", \"steps\": [\n\
             {{\"name\": \"wood\", \"commands\": [[\"sh\", \"-ec\", \"gelato -silent wood.pyg; maketx out/wood.tif -o out/wood.tx\"]]}},\n\
             {{\"name\": \"maps\", \"frames\": \"1-{FRAMES}\", \"chunk\": 8, \"scene\": [\"map.####.pyg\"], \"options\": [\"-threads\", \"1\"]}},\n\
             {{\"name\": \"frames\", \"after\": [\"wood\", \"maps\"], \"frames\": \"1-{FRAMES}\", \"chunk\": {CHUNK},\n\
             \"scene\": [\"shot.####.pyg\"], \"options\": [\"-u\", \"-threads\", \"1\"]}}]}}\n"
        );
        write("job.json", steps)?;
        Ok(folder)
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.scratch);
    }
}

/// The texture of the ground.
const WOOD: &str = "Attribute (\"int[2] resolution\", (64, 64))\nOutput (\"out/wood.tif\", \"tiff\", \"rgb\", \"camera\")\n\
    Translate (0, 0, 1)\nWorld ()\nShader (\"surface\", \"oak\", \"float Ka\", 1)\nLight (\"sky\", \"ambientlight\")\n\
    Sphere (9, -9, 9, 360)\nRender ()\n";

/// Returns the objects of a frame: balls that move.
fn balls(frame: u32) -> String {
    let mut text = String::new();
    for ball in 0..24_u32 {
        let angle = f64::from(ball) * 2.4 + f64::from(frame) * 0.1;
        let radius = 0.25 * f64::from(ball).sqrt();
        let (x, z, y) = (angle.cos() * radius, angle.sin() * radius, 0.3 * (angle * 3.0).sin());
        let red = 0.2 + 0.03 * f64::from(ball);
        text += &format!(
            "PushAttributes ()\nPushTransform ()\nAttribute (\"color C\", ({red:.3}, 0.5, 0.3))\n\
             Translate ({x:.4}, {y:.4}, {z:.4})\nSphere (0.2, -0.2, 0.2, 360)\nPopTransform ()\nPopAttributes ()\n"
        );
    }
    text
}

/// Returns the scene that makes the depth map of a frame.
fn map(frame: u32) -> String {
    format!(
        "Attribute (\"int[2] resolution\", (256, 256))\nAttribute (\"string projection\", \"perspective\")\nAttribute (\"float fov\", 40)\n\
         Output (\"out/lamp.{frame:04}.sm\", \"shadow\", \"z\", \"camera\", \"float[4] quantize\", (0, 0, 0, 0), \"float dither\", 0)\n\
         Translate (0, 0, 6)\nRotate (-90, 1, 0, 0)\nWorld ()\nShader (\"surface\", \"plastic\")\n{}Render ()\n",
        balls(frame)
    )
}

/// Returns the scene of a frame, which writes "out/NAME.tif".
fn shot(frame: u32, name: &str, (width, height): (u32, u32), quality: u32) -> String {
    format!(
        "Attribute (\"int[2] resolution\", ({width}, {height}))\nAttribute (\"int[2] spatialquality\", ({quality}, {quality}))\n\
         Attribute (\"string projection\", \"perspective\")\nAttribute (\"float fov\", 35)\nAttribute (\"string path:texture\", \"out:&\")\n\
         Output (\"out/{name}.tif\", \"tiff\", \"rgb\", \"camera\", \"int[4] quantize\", (0, 0, 0, 0))\n\
         Translate (0, 0.1, 6)\nRotate (-25, 1, 0, 0)\nWorld ()\n\
         Light (\"lamp\", \"spotlight\", \"float intensity\", 50, \"point from\", (0, 6, 0), \"point to\", (0, 0, 0), \
         \"float coneangle\", 0.35, \"string shadowname\", \"lamp.{frame:04}.sm\", \"float shadowbias\", 0.1, \"float shadowsamples\", 64)\n\
         Light (\"fill\", \"ambientlight\", \"float intensity\", 0.15)\n\
         PushAttributes ()\nShader (\"surface\", \"paintedplastic\", \"string texturename\", \"wood.tx\", \"float Ks\", 0)\n\
         Patch (\"linear\", 2, 2, \"vertex point P\", (-5, -1, -5,  5, -1, -5,  -5, -1, 5,  5, -1, 5))\nPopAttributes ()\n\
         Shader (\"surface\", \"plastic\")\n{}Render ()\n",
        balls(frame)
    )
}

/// Returns the images of a folder, and an error for any other file that a run left.
pub(super) fn images(folder: &Path) -> Result<Images, String> {
    let out = folder.join("out");
    let told = |error: io::Error| format!("{}: {error}", out.display());
    let mut images = Images::new();
    for entry in fs::read_dir(&out).map_err(told)? {
        let entry = entry.map_err(told)?;
        let name = entry.file_name().to_string_lossy().into_owned();
        images.insert(name, fs::read(entry.path()).map_err(told)?);
    }
    Ok(images)
}

/// Compares all files of two runs.
pub(super) fn compare(what: &str, got: &Images, expected: &Images) -> Result<(), String> {
    let names = |images: &Images| images.keys().cloned().collect::<Vec<_>>().join(" ");
    if !got.keys().eq(expected.keys()) {
        return Err(format!("{what}: the files are {}; expected {}", names(got), names(expected)));
    }
    // The names of depth maps and textures are equal, and so are their bytes.
    match got.iter().find(|(name, bytes)| expected[*name] != **bytes) {
        Some((name, _)) => Err(format!("{what}: {name} differs from that of one process")),
        None => {
            let number = match got.len() {
                1 => "the image equals that".to_owned(),
                n => format!("{n} files equal those"),
            };
            println!("farm: {what}: {number} of one process");
            Ok(())
        }
    }
}

/// Writes a file with a secret, and returns its name.
pub(super) fn secret(folder: &Path) -> Result<String, String> {
    let secret = folder.join("secret");
    let told = |error: io::Error| format!("{}: {error}", secret.display());
    fs::write(&secret, "a secret of this test only\n").map_err(told)?;
    fs::set_permissions(&secret, PermissionsExt::from_mode(0o600)).map_err(told)?;
    Ok(secret.to_string_lossy().into_owned())
}

/// Waits until something is true.
pub(super) fn wait(what: &str, mut is_true: impl FnMut() -> Result<bool, String>) -> Result<(), String> {
    let begin = Instant::now();
    while !is_true()? {
        if begin.elapsed() > LONGEST {
            return Err(format!("{what}: not after {} s", LONGEST.as_secs()));
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    Ok(())
}

/// Runs a command to its end, and returns its standard output.
pub(super) fn output(mut command: Command) -> Result<String, String> {
    let name = command.get_program().to_string_lossy().into_owned();
    let ran = command.output().map_err(|error| format!("{name}: {error}"))?;
    if !ran.status.success() {
        let said = [ran.stdout, ran.stderr].concat();
        return Err(format!("{name}: {}: {}", ran.status, String::from_utf8_lossy(&said).trim()));
    }
    Ok(String::from_utf8_lossy(&ran.stdout).into_owned())
}

/// Sends a signal, such as "-KILL".
pub(super) fn signal(name: &str, process: u32) {
    // A process that has ended needs none.
    let _ = Command::new("kill").args([name, &process.to_string()]).stderr(Stdio::null()).status();
}

/// A process that is killed when it is no longer needed.
pub(super) struct Running(pub(super) Child);

impl Drop for Running {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
