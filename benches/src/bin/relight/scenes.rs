//! The scenes, and one edit of each kind for each of them.

use granita_benches::{Fur, copy_files, repository};
use std::path::Path;
use std::process::Command;

/// The kinds of edits: the name, and the least ratio of a frame rendered anew over a re-rendered one.
pub(crate) const KINDS: [(&str, f64); 7] = [
    ("intensity of a light", 20.0),
    ("colour of a light", 20.0),
    ("move a light without shadows", 10.0),
    ("move a light, traced shadows", 4.0),
    ("switch a light off", 20.0),
    ("gain of the output", 50.0),
    ("nothing", 100.0),
];

/// The output of all scenes, an image in memory.
const OUTPUT: &str = "Output (\"image\", \"0x1\", \"rgba\", \"camera\")\n";

/// A scene. Each edit begins with the state that the edits before it left.
pub(crate) struct Scene {
    pub(crate) name: &'static str,
    /// Its file in the checkout; `None` for the scene of fur, which is made here.
    file: Option<&'static str>,
    /// The calls of each kind of edit, without `World` and `Render`; `None` where the scene has no such light.
    lights: [Option<&'static str>; 5],
}

/// All scenes.
pub(crate) const SCENES: [Scene; 4] = [
    Scene {
        name: "first",
        file: Some("examples/first/first.pyg"),
        lights: [
            Some(concat!(
                "Light (\"lamp\", \"spotlight\", \"float intensity\", 180, \"color lightcolor\", (1, 0.72, 0.45), ",
                "\"point from\", (8, 7, 6.5), \"point to\", (0.5, 1, 0), \"float coneangle\", 0.6, ",
                "\"float conedeltaangle\", 0.3, \"string shadowname\", \"lamp.vsm\", \"float shadowblur\", 0.01, ",
                "\"float shadowsamples\", 16, \"float shadowbias\", 0.03)\n"
            )),
            Some(concat!(
                "Light (\"lamp\", \"spotlight\", \"float intensity\", 180, \"color lightcolor\", (0.6, 0.8, 1), ",
                "\"point from\", (8, 7, 6.5), \"point to\", (0.5, 1, 0), \"float coneangle\", 0.6, ",
                "\"float conedeltaangle\", 0.3, \"string shadowname\", \"lamp.vsm\", \"float shadowblur\", 0.01, ",
                "\"float shadowsamples\", 16, \"float shadowbias\", 0.03)\n"
            )),
            Some(concat!(
                "Light (\"wash\", \"spotlight\", \"float intensity\", 34, \"color lightcolor\", (1, 0.8, 0.6), ",
                "\"point from\", (-2, 9, 2), \"point to\", (-0.5, 4, 8.5), \"float coneangle\", 0.8, ",
                "\"float conedeltaangle\", 0.7)\n"
            )),
            // The light of the soft box comes from geometry, which cannot move.
            None,
            Some("Modify (\"\")\nLightSwitch (\"lamp\", 0)\n"),
        ],
    },
    Scene {
        name: "relight",
        file: Some("examples/relight/relight.pyg"),
        lights: [
            Some(concat!(
                "Light (\"fill\", \"spotlight\", \"float intensity\", 24, \"color lightcolor\", (0.55, 0.7, 1), ",
                "\"point from\", (8, 6, -8), \"point to\", (0.8, 1.2, 0.3), \"float coneangle\", 0.42, ",
                "\"float conedeltaangle\", 0.25, \"string shadowname\", \"fill.sm\", \"float shadowblur\", 0.01, ",
                "\"float shadowsamples\", 16)\n"
            )),
            Some(concat!(
                "Light (\"fill\", \"spotlight\", \"float intensity\", 24, \"color lightcolor\", (0.8, 1, 0.7), ",
                "\"point from\", (8, 6, -8), \"point to\", (0.8, 1.2, 0.3), \"float coneangle\", 0.42, ",
                "\"float conedeltaangle\", 0.25, \"string shadowname\", \"fill.sm\", \"float shadowblur\", 0.01, ",
                "\"float shadowsamples\", 16)\n"
            )),
            Some(concat!(
                "Light (\"foot-2\", \"pointlight\", \"float intensity\", 2.2, \"color lightcolor\", (1, 0.7, 0.4), ",
                "\"point from\", (-2.2, 0.5, -3.8))\n"
            )),
            Some(concat!(
                "Light (\"rim-left\", \"spotlight\", \"float intensity\", 70, \"color lightcolor\", (1, 0.8, 0.6), ",
                "\"point from\", (-6, 7, 3), \"point to\", (0, 1.5, 0), \"float coneangle\", 0.6, ",
                "\"float conedeltaangle\", 0.3, \"string shadowname\", \"solid\")\n"
            )),
            Some("Modify (\"\")\nLightSwitch (\"blue\", 0)\n"),
        ],
    },
    Scene {
        name: "fur",
        file: None,
        lights: [
            Some(concat!(
                "Light (\"rim\", \"distantlight\", \"float intensity\", 0.5, \"point from\", (2, 1, 1.5), ",
                "\"point to\", (0, 0, 0))\n"
            )),
            Some(concat!(
                "Light (\"rim\", \"distantlight\", \"float intensity\", 0.5, \"color lightcolor\", (1, 0.8, 0.6), ",
                "\"point from\", (2, 1, 1.5), \"point to\", (0, 0, 0))\n"
            )),
            Some(concat!(
                "Light (\"key\", \"distantlight\", \"float intensity\", 0.9, \"point from\", (-1.5, 2, -1), ",
                "\"point to\", (0, 0, 0))\n"
            )),
            None,
            Some("Modify (\"\")\nLightSwitch (\"rim\", 0)\n"),
        ],
    },
    Scene {
        name: "pot",
        file: Some("benches/frames/pot.pyg"),
        lights: [
            Some("Light (\"sky\", \"ambientlight\", \"float intensity\", 0.15)\n"),
            Some(concat!(
                "Light (\"key\", \"spotlight\", \"float intensity\", 150, \"color lightcolor\", (1, 0.8, 0.6), ",
                "\"point from\", (-6, -6.5, 9.5), \"point to\", (0, 0, 0.8), \"float coneangle\", 0.6, ",
                "\"string shadowname\", \"shadow\", \"float shadowblur\", 0.02, \"float shadowsamples\", 4)\n"
            )),
            None,
            Some(concat!(
                "Light (\"key\", \"spotlight\", \"float intensity\", 150, \"color lightcolor\", (1, 0.8, 0.6), ",
                "\"point from\", (-5, -7, 9.5), \"point to\", (0, 0, 0.8), \"float coneangle\", 0.6, ",
                "\"string shadowname\", \"shadow\", \"float shadowblur\", 0.02, \"float shadowsamples\", 4)\n"
            )),
            Some("Modify (\"\")\nLightSwitch (\"sky\", 0)\n"),
        ],
    },
];

impl Scene {
    /// Returns the calls of a kind of edit, with `Render`; `None` where the scene has no such light.
    pub(crate) fn edit(&self, kind: usize) -> Option<String> {
        match kind {
            0..5 => Some(format!("World ()\n{}Render ()\n", self.lights[kind]?)),
            5 => Some(format!("{}World ()\nRender ()\n", OUTPUT.replace(")\n", ", \"float gain\", 1.25)\n"))),
            _ => Some("World ()\nRender ()\n".to_owned()),
        }
    }

    /// Returns the scene with its size in pixels and its image in memory. `attributes` come first.
    ///
    /// # Errors
    /// Returns a message when its file is not there or has another form.
    pub(crate) fn text(&self, (width, height): (u32, u32), attributes: &str) -> Result<String, String> {
        let text = match self.file {
            None => Fur::default().scene(),
            Some(file) => {
                std::fs::read_to_string(repository().join(file)).map_err(|e| format!("{file}: {e}"))?
            }
        };
        let lines = text.lines().filter(|line| {
            !["Command (", "Output (", "Attribute (\"int rerender\""]
                .iter()
                .any(|start| line.starts_with(start))
        });
        let text: String = lines.flat_map(|line| [line, "\n"]).collect();
        const SIZE: &str = "\"int[2] resolution\", (";
        let old = text.split_once(SIZE).and_then(|(_, rest)| rest.split_once(')'));
        let (old, _) = old.ok_or_else(|| format!("{} has no resolution", self.name))?;
        let sized = text.replacen(&format!("{SIZE}{old})"), &format!("{SIZE}{width}, {height})"), 1);
        Ok(format!("{attributes}{OUTPUT}{sized}"))
    }

    /// Makes the textures, maps and shaders of the scene in a copy of `examples/` below `place`.
    ///
    /// # Errors
    /// Returns the message of a failed copy or command.
    pub(crate) fn prepare(&self, gelato: &Path, place: &Path) -> Result<(), String> {
        let Some(file) = self.file.filter(|file| file.starts_with("examples/")) else { return Ok(()) };
        for folder in ["examples/first", "examples/relight", "examples/data"] {
            copy_files(&repository().join(folder), &place.join(folder))?;
        }
        let text = std::fs::read_to_string(repository().join(file)).map_err(|e| format!("{file}: {e}"))?;
        let commands = text.lines().filter(|line| line.starts_with("Command ("));
        let commands: String = commands.flat_map(|line| [line, "\n"]).collect();
        let script = place.join("prepare.pyg");
        std::fs::write(&script, commands).map_err(|e| e.to_string())?;
        let mut command = Command::new(gelato);
        // Nothing is rendered by the script itself, which gelato reports by its status.
        let done = command.current_dir(place).arg("prepare.pyg").output().map_err(|e| e.to_string())?;
        let said = String::from_utf8_lossy(&done.stderr);
        if said.contains("error") { Err(format!("{file}: {said}")) } else { Ok(()) }
    }
}
