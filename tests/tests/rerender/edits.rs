//! Random edits that are allowed between two frames (reference 11.1).

use crate::model::{Stage, Value};
use granita_base::hash;

/// A sequence of random numbers. The same seed gives the same numbers.
#[derive(Clone, Debug)]
pub(crate) struct Random {
    seed: u32,
    count: u32,
}

impl Random {
    /// Returns the sequence of a seed.
    pub(crate) fn new(seed: u32) -> Self {
        Self { seed, count: 0 }
    }

    fn word(&mut self) -> u32 {
        self.count += 1;
        hash::words(&[self.seed, self.count])
    }

    /// Returns a number below `n`, which is at least 1.
    pub(crate) fn below(&mut self, n: usize) -> usize {
        self.word() as usize % n.max(1)
    }

    /// Returns a number between `from` and `to`, of two decimals.
    fn between(&mut self, from: f32, to: f32) -> f32 {
        ((from + (to - from) * hash::unit(self.word())) * 100.0).round() / 100.0
    }

    /// Returns an element of a list; `None` when the list is empty.
    fn of<T: Clone>(&mut self, list: &[T]) -> Option<T> {
        if list.is_empty() { None } else { Some(list[self.below(list.len())].clone()) }
    }
}

/// The changes before one `Render`.
#[derive(Clone, Debug, Default)]
pub(crate) struct Frame {
    /// The calls before `World`: attributes, cameras and outputs.
    pub(crate) before_world: String,
    /// The calls after `World`: lights and their switches.
    pub(crate) after_world: String,
    /// The files that get another version, with its number.
    pub(crate) files: Vec<(&'static str, usize)>,
    /// The camera of `Render`; "" for all of them.
    pub(crate) camera: &'static str,
    /// The names of the edits.
    pub(crate) names: Vec<&'static str>,
}

impl Frame {
    /// Returns the calls, with `Render`. A frame without changes may leave out `World`.
    pub(crate) fn pyg(&self) -> String {
        let files: String = self
            .files
            .iter()
            .map(|(name, version)| format!("# {name} is now its version {version}.\n"))
            .collect();
        let world = if self.names.last() == Some(&"only Render") && self.before_world.is_empty() {
            ""
        } else {
            "World ()\n"
        };
        format!("{files}{}{world}{}{}", self.before_world, self.after_world, self.render())
    }

    /// Returns the call of `Render`.
    pub(crate) fn render(&self) -> String {
        if self.camera.is_empty() {
            "Render ()\n".to_owned()
        } else {
            format!("Render (\"{}\")\n", self.camera)
        }
    }
}

/// A kind of edit. It returns false, without a change, when the scene has nothing that it applies to.
type Edit = fn(&mut Stage, &mut Random, &mut Frame) -> bool;

/// The kinds of edits by name. Those that are listed twice are made twice as often.
const EDITS: [(&str, Edit); 22] = [
    ("parameter of a light", parameter),
    ("parameter of a light", parameter),
    ("parameter of a light", parameter),
    ("intensity", intensity),
    ("intensity", intensity),
    ("colour", color),
    ("move a light", move_light),
    ("move a light", move_light),
    ("turn a light", turn_light),
    ("shader of a light", shader),
    ("add a light", add_light),
    ("delete a light", delete_light),
    ("LightSwitch", light_switch),
    ("LightSwitch", light_switch),
    ("look of an output", look),
    ("add an output", add_output),
    ("delete an output", delete_output),
    ("camera", camera),
    ("camera", camera),
    ("memory, paths, patterns", limits),
    ("file", file),
    ("rerender:cachelights", cache_lights),
];

/// Makes one edit. One of twelve changes nothing.
pub(crate) fn edit(stage: &mut Stage, random: &mut Random, frame: &mut Frame) {
    if random.below(12) == 0 {
        return frame.names.push(if random.below(2) == 0 { "nothing" } else { "only Render" });
    }
    loop {
        let (name, make) = EDITS[random.below(EDITS.len())];
        if make(stage, random, frame) {
            return frame.names.push(name);
        }
    }
}

/// Returns the index of one of the lights in the scene.
fn any_light(stage: &Stage, random: &mut Random) -> Option<usize> {
    let all: Vec<usize> = (0..stage.lights.len()).filter(|i| stage.lights[*i].exists).collect();
    random.of(&all)
}

/// Values that every light of a shader takes, beside intensity and colour.
fn knobs(shader: &str) -> &'static [(&'static str, &'static [f32])] {
    match shader {
        "pointlight" => &[("float falloff", &[0.0, 1.0, 2.0]), ("float __nonspecular", &[0.0, 1.0])],
        "spotlight" | "shadowspot" => &[
            ("float falloff", &[0.0, 1.0, 2.0]),
            ("float coneangle", &[0.3, 0.5, 0.8]),
            ("float conedeltaangle", &[0.05, 0.2]),
            ("float beamdistribution", &[0.0, 2.0, 8.0]),
        ],
        "uberlight" => &[
            ("float falloff", &[0.0, 1.0, 2.0]),
            ("float coneangle", &[0.0, 0.5, 0.9]),
            ("float cutfar", &[0.0, 6.0]),
            ("float __nondiffuse", &[0.0, 1.0]),
        ],
        "distantlight" => &[("float __nonspecular", &[0.0, 1.0])],
        _ => &[],
    }
}

/// The parameters that stay when a light gets another of the shaders that [`shader`] exchanges.
const COMMON: [&str; 6] = [
    "float intensity",
    "color lightcolor",
    "string shadowname",
    "float shadowsamples",
    "float shadowblur",
    "float shadowbias",
];

fn parameter(stage: &mut Stage, random: &mut Random, frame: &mut Frame) -> bool {
    let Some(i) = any_light(stage, random) else { return false };
    let light = &mut stage.lights[i];
    let known = knobs(light.shader);
    let own = light.choices.len();
    if own + known.len() == 0 {
        return false;
    }
    let which = random.below(own + known.len());
    let (name, values) = match light.choices.get(which) {
        Some(choice) => choice.clone(),
        None => {
            let (name, values) = known[which - own];
            (name, values.iter().map(|value| [*value].into()).collect())
        }
    };
    let Some(value) = random.of(&values) else { return false };
    light.params.set(name, value);
    frame.after_world += &light.pyg();
    true
}

fn intensity(stage: &mut Stage, random: &mut Random, frame: &mut Frame) -> bool {
    let Some(i) = any_light(stage, random) else { return false };
    let light = &mut stage.lights[i];
    let factor = [0.0, 0.5, 0.9, 1.25, 2.0][random.below(5)];
    let old = light.params.0.iter().find_map(|(name, value)| match value {
        Value::Numbers(numbers) if *name == "float intensity" => numbers.first().copied(),
        _ => None,
    });
    let old = old.filter(|old| *old > 0.0).unwrap_or(1.0);
    light.params.set("float intensity", [old * factor].into());
    frame.after_world += &light.pyg();
    true
}

fn color(stage: &mut Stage, random: &mut Random, frame: &mut Frame) -> bool {
    let Some(i) = any_light(stage, random) else { return false };
    let light = &mut stage.lights[i];
    let color = [0; 3].map(|_: i32| random.between(0.1, 1.0));
    light.params.set("color lightcolor", color.into());
    frame.after_world += &light.pyg();
    true
}

fn move_light(stage: &mut Stage, random: &mut Random, frame: &mut Frame) -> bool {
    let Some(i) = any_light(stage, random) else { return false };
    let light = &mut stage.lights[i];
    light.position = light.position.map(|x| x + random.between(-0.8, 0.8));
    frame.after_world += &light.pyg();
    true
}

fn turn_light(stage: &mut Stage, random: &mut Random, frame: &mut Frame) -> bool {
    let Some(i) = any_light(stage, random) else { return false };
    let light = &mut stage.lights[i];
    light.turn_deg = light.turn_deg.map(|x| x + random.between(-15.0, 15.0));
    frame.after_world += &light.pyg();
    true
}

/// Gives a light another shader.
fn shader(stage: &mut Stage, random: &mut Random, frame: &mut Frame) -> bool {
    const EXCHANGED: [&str; 5] = ["pointlight", "spotlight", "distantlight", "uberlight", "shadowspot"];
    let Some(i) = any_light(stage, random) else { return false };
    let light = &mut stage.lights[i];
    if !EXCHANGED.contains(&light.shader) || light.layer.is_some() {
        return false;
    }
    light.shader = EXCHANGED[random.below(EXCHANGED.len())];
    light.params.0.retain(|(name, _)| COMMON.contains(name));
    light.choices.retain(|(name, _)| COMMON.contains(name));
    frame.after_world += &light.pyg();
    true
}

/// Adds a light, or one that was deleted, and switches it on for some objects.
fn add_light(stage: &mut Stage, random: &mut Random, frame: &mut Frame) -> bool {
    let spare: Vec<usize> = (0..stage.lights.len()).filter(|i| !stage.lights[*i].exists).collect();
    let Some(i) = random.of(&spare) else { return false };
    stage.lights[i].exists = true;
    frame.after_world += &stage.lights[i].pyg();
    // A deleted light may still be in the lists of objects or not, until it is switched for all of them.
    frame.after_world += &switch("", stage.lights[i].id, true);
    if random.below(2) == 0
        && let Some(pattern) = random.of(&stage.patterns)
    {
        frame.after_world += &switch(pattern, stage.lights[i].id, false);
    }
    true
}

fn delete_light(stage: &mut Stage, random: &mut Random, frame: &mut Frame) -> bool {
    let Some(i) = any_light(stage, random) else { return false };
    let light = &mut stage.lights[i];
    light.exists = false;
    frame.after_world += &format!("Light (\"{}\", \"null\")\n", light.id);
    true
}

fn light_switch(stage: &mut Stage, random: &mut Random, frame: &mut Frame) -> bool {
    let Some(i) = any_light(stage, random) else { return false };
    let patterns: Vec<&str> = stage.patterns.iter().copied().chain([""]).collect();
    let Some(pattern) = random.of(&patterns) else { return false };
    frame.after_world += &switch(pattern, stage.lights[i].id, random.below(2) == 0);
    true
}

/// Returns the calls that switch a light for the objects whose names match a pattern.
fn switch(pattern: &str, light: &str, on: bool) -> String {
    format!(
        "PushAttributes ()\nModify (\"{pattern}\")\nLightSwitch (\"{light}\", {})\nPopAttributes ()\n",
        i32::from(on)
    )
}

fn look(stage: &mut Stage, random: &mut Random, frame: &mut Frame) -> bool {
    let all: Vec<usize> = (0..stage.outputs.len())
        .filter(|i| stage.outputs[*i].exists && !stage.outputs[*i].is_dynamic())
        .collect();
    let Some(i) = random.of(&all) else { return false };
    let output = &mut stage.outputs[i];
    let (name, value) = match random.below(4) {
        0 => ("float gain", [random.between(0.3, 2.0)].into()),
        1 => ("float gamma", [random.between(0.8, 2.4)].into()),
        2 => ("float dither", [[0.0, 0.25, 0.5][random.below(3)]].into()),
        _ => {
            let values = [[0.0, 255.0, 0.0, 255.0], [0.0, 65535.0, 0.0, 65535.0], [0.0; 4]];
            ("int[4] quantize", values[random.below(3)].into())
        }
    };
    output.params.set(name, value);
    frame.before_world += &output.pyg();
    true
}

fn add_output(stage: &mut Stage, random: &mut Random, frame: &mut Frame) -> bool {
    let spare: Vec<usize> = (0..stage.outputs.len()).filter(|i| !stage.outputs[*i].exists).collect();
    let Some(i) = random.of(&spare) else { return false };
    stage.outputs[i].exists = true;
    frame.before_world += &stage.outputs[i].pyg();
    true
}

/// Deletes an output. Each camera keeps one.
fn delete_output(stage: &mut Stage, random: &mut Random, frame: &mut Frame) -> bool {
    let of = |camera: &str| stage.outputs.iter().filter(|o| o.exists && o.camera == camera).count();
    let many = |i: &usize| stage.outputs[*i].exists && of(stage.outputs[*i].camera) > 1;
    let all: Vec<usize> = (0..stage.outputs.len()).filter(many).collect();
    let Some(i) = random.of(&all) else { return false };
    stage.outputs[i].exists = false;
    frame.before_world += &stage.outputs[i].removal();
    true
}

/// Changes a parameter of a camera that may change (reference 11.1), or the camera of the next frame alone.
fn camera(stage: &mut Stage, random: &mut Random, frame: &mut Frame) -> bool {
    let shown: Vec<usize> = (0..stage.cameras.len())
        .filter(|i| {
            stage.outputs.iter().any(|o| o.exists && !o.is_dynamic() && o.camera == stage.cameras[*i].name)
        })
        .collect();
    let Some(i) = random.of(&shown) else { return false };
    if shown.len() > 1 && random.below(3) == 0 {
        frame.camera = stage.cameras[i].name;
        return true;
    }
    let camera = &mut stage.cameras[i];
    let (name, value) = match random.below(6) {
        0 => {
            let (x, y) = (random.between(0.0, 0.6), random.between(0.0, 0.6));
            let (w, h) = (random.between(0.1, 0.4), random.between(0.1, 0.4));
            ("float[4] crop", [x, x + w, y, y + h].into())
        }
        1 => ("float[4] crop", [0.0, 1.0, 0.0, 1.0].into()),
        2 => ("int[2] spatialquality", [[1.0, 1.0], [2.0, 2.0], [3.0, 2.0]][random.below(3)].into()),
        3 => ("int temporalquality", [[1.0], [4.0], [6.0]][random.below(3)].into()),
        4 => ("int dofquality", [[1.0], [4.0], [6.0]][random.below(3)].into()),
        _ => ("string bucketorder", ["horizontal", "vertical", "spiral"][random.below(3)].into()),
    };
    camera.params.set(name, value);
    frame.before_world += &camera.pyg();
    true
}

/// Changes a limit of memory, a search path, or the files that are checked.
fn limits(stage: &mut Stage, random: &mut Random, frame: &mut Frame) -> bool {
    match random.below(4) {
        0 => {
            let kilobytes = [0, 1_000_000, 20_000, 2_000, 200, 1][random.below(6)];
            frame.before_world += &format!("Attribute (\"int rerender:memory\", {kilobytes})\n");
        }
        1 => {
            let kilobytes = [20_480, 1024, 64][random.below(3)];
            frame.before_world += &format!("Attribute (\"int limits:texturememory\", {kilobytes})\n");
        }
        2 => {
            let (kind, path) =
                (["texture", "shader"][random.below(2)], ["@", "@/none:@", "@:@/none"][random.below(3)]);
            frame.before_world += &format!("Attribute (\"string path:{kind}\", \"{path}\")\n");
        }
        // A file that was written for this frame must be found, so the pattern must not change now.
        _ if !frame.files.is_empty() => return false,
        _ => {
            stage.pattern = [".*", ".*\\\\.(sm|vsm)", ".*\\\\.tx", "(sm)|(env)"][random.below(4)];
            frame.before_world +=
                &format!("Attribute (\"string rerender:filepattern\", \"{}\")\n", stage.pattern);
        }
    }
    true
}

/// Replaces a file that the pattern matches by its other version.
fn file(stage: &mut Stage, random: &mut Random, frame: &mut Frame) -> bool {
    let pattern = stage.pattern;
    let matches = |name: &str| {
        let has = |words: &[&str]| words.iter().any(|word| name.contains(word));
        match pattern {
            ".*" => true,
            ".*\\\\.tx" => has(&[".tx"]),
            "(sm)|(env)" => has(&["sm", "env"]),
            _ => has(&[".sm", ".vsm"]),
        }
    };
    let all: Vec<usize> = (0..stage.files.len()).filter(|i| matches(stage.files[*i].name)).collect();
    let Some(i) = random.of(&all) else { return false };
    let file = &mut stage.files[i];
    file.version = 1 - file.version;
    frame.files.push((file.name, file.version));
    true
}

fn cache_lights(stage: &mut Stage, random: &mut Random, frame: &mut Frame) -> bool {
    let Some(i) = any_light(stage, random) else { return false };
    let light = &mut stage.lights[i];
    light.attributes.set("int rerender:cachelights", [random.below(2) as f32].into());
    frame.after_world += &light.pyg();
    true
}
