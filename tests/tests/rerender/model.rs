//! A scene as the edits know it: cameras, outputs, lights and files that change, and the text of all the rest.

use std::fmt::Write;

/// A value of a parameter or an attribute.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Value {
    /// One number or several.
    Numbers(Vec<f32>),
    /// A text.
    Text(&'static str),
}

impl<const N: usize> From<[f32; N]> for Value {
    fn from(numbers: [f32; N]) -> Self {
        Self::Numbers(numbers.to_vec())
    }
}

impl From<&'static str> for Value {
    fn from(text: &'static str) -> Self {
        Self::Text(text)
    }
}

impl std::fmt::Display for Value {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Text(text) => write!(f, "\"{text}\""),
            Self::Numbers(numbers) => {
                let list: Vec<String> = numbers.iter().map(f32::to_string).collect();
                if list.len() == 1 { f.write_str(&list[0]) } else { write!(f, "({})", list.join(", ")) }
            }
        }
    }
}

/// Parameters in the order of their calls, each a declaration and its value.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Values(pub(crate) Vec<(&'static str, Value)>);

impl Values {
    /// Sets a value, and adds the parameter if it is not set yet.
    pub(crate) fn set(&mut self, declaration: &'static str, value: Value) {
        match self.0.iter_mut().find(|(name, _)| *name == declaration) {
            Some((_, old)) => *old = value,
            None => self.0.push((declaration, value)),
        }
    }

    /// Returns the values as further arguments of a call.
    fn arguments(&self) -> String {
        self.0.iter().map(|(name, value)| format!(", \"{name}\", {value}")).collect()
    }

    /// Returns the values as calls of `Attribute`.
    fn attributes(&self) -> String {
        self.0.iter().map(|(name, value)| format!("Attribute (\"{name}\", {value})\n")).collect()
    }
}

/// A light.
#[derive(Clone, Debug)]
pub(crate) struct Light {
    pub(crate) id: &'static str,
    pub(crate) shader: &'static str,
    pub(crate) params: Values,
    /// The attributes that are set for the light alone.
    pub(crate) attributes: Values,
    /// The position in the world.
    pub(crate) position: [f32; 3],
    /// Rotations around the y and the x axis, in degrees.
    pub(crate) turn_deg: [f32; 2],
    /// The values that edits give to parameters, beside those that all lights of the shader take.
    pub(crate) choices: Vec<(&'static str, Vec<Value>)>,
    /// A layer before the light: its shader, and the outputs and parameters that are connected.
    pub(crate) layer: Option<(&'static str, [&'static str; 2])>,
    /// True when it is in the scene.
    pub(crate) exists: bool,
}

impl Light {
    /// Returns a light in the scene, at a position, with rotations around the y and the x axis in degrees.
    pub(crate) fn new(
        id: &'static str,
        shader: &'static str,
        position: [f32; 3],
        turn_deg: [f32; 2],
        intensity: f32,
    ) -> Self {
        let mut params = Values::default();
        params.set("float intensity", [intensity].into());
        Self {
            id,
            shader,
            params,
            attributes: Values::default(),
            position,
            turn_deg,
            choices: Vec::new(),
            layer: None,
            exists: true,
        }
    }

    /// Sets a parameter.
    pub(crate) fn with(mut self, declaration: &'static str, value: impl Into<Value>) -> Self {
        self.params.set(declaration, value.into());
        self
    }

    /// Sets an attribute.
    pub(crate) fn attribute(mut self, declaration: &'static str, value: impl Into<Value>) -> Self {
        self.attributes.set(declaration, value.into());
        self
    }

    /// Adds values that edits give to a parameter.
    pub(crate) fn choice(
        mut self,
        declaration: &'static str,
        values: impl IntoIterator<Item = Value>,
    ) -> Self {
        self.choices.push((declaration, values.into_iter().collect()));
        self
    }

    /// Leaves the light out of the scene, for an edit that adds it.
    pub(crate) fn spare(mut self) -> Self {
        self.exists = false;
        self
    }

    /// Returns the calls that add the light or replace it.
    pub(crate) fn pyg(&self) -> String {
        let [x, y, z] = self.position;
        let [around_y, around_x] = self.turn_deg;
        let (id, shader, params) = (self.id, self.shader, self.params.arguments());
        let light = match self.layer {
            None => format!("Light (\"{id}\", \"{shader}\"{params})\n"),
            Some((layer, [from, to])) => format!(
                "ShaderGroupBegin ()\nLight (\"{id}\", \"{layer}\", \"before\")\n\
                 Light (\"{id}\", \"{shader}\", \"lamp\"{params})\n\
                 ConnectShaders (\"before\", \"{from}\", \"lamp\", \"{to}\")\nShaderGroupEnd ()\n"
            ),
        };
        format!(
            "PushAttributes ()\n{}Translate ({x}, {y}, {z})\nRotate ({around_y}, 0, 1, 0)\n\
             Rotate ({around_x}, 1, 0, 0)\n{light}PopAttributes ()\n",
            self.attributes.attributes()
        )
    }
}

/// A camera.
#[derive(Clone, Debug)]
pub(crate) struct Camera {
    pub(crate) name: &'static str,
    /// The transformations before its call.
    pub(crate) place: &'static str,
    /// The parameters that edits leave as they are.
    pub(crate) fixed: &'static str,
    /// The parameters that edits change.
    pub(crate) params: Values,
}

impl Camera {
    /// Returns the calls that add the camera or replace it.
    pub(crate) fn pyg(&self) -> String {
        format!(
            "PushTransform ()\n{}Camera (\"{}\", {}{})\nPopTransform ()\n",
            self.place,
            self.name,
            self.fixed,
            self.params.arguments()
        )
    }
}

/// An output.
#[derive(Clone, Debug)]
pub(crate) struct Output {
    /// The name of the file in the folder of results.
    pub(crate) name: &'static str,
    pub(crate) format: &'static str,
    pub(crate) data: &'static str,
    pub(crate) camera: &'static str,
    /// The parameters that edits leave as they are, each after a comma.
    pub(crate) fixed: &'static str,
    /// The parameters that edits change.
    pub(crate) params: Values,
    /// True when it is in the scene.
    pub(crate) exists: bool,
}

impl Output {
    /// Returns an output in the scene.
    pub(crate) fn new(name: &'static str, data: &'static str, camera: &'static str) -> Self {
        let (format, fixed) = match name.rsplit_once('.') {
            Some((_, "exr")) => ("OpenEXR", ", \"string pixeltype\", \"float\""),
            Some((_, "sm")) => ("shadow", ", \"int dynamic\", 1"),
            _ => ("tiff", ""),
        };
        Self { name, format, data, camera, fixed, params: Values::default(), exists: true }
    }

    /// Sets a parameter.
    pub(crate) fn with(mut self, declaration: &'static str, value: impl Into<Value>) -> Self {
        self.params.set(declaration, value.into());
        self
    }

    /// Leaves the output out of the scene, for an edit that adds it.
    pub(crate) fn spare(mut self) -> Self {
        self.exists = false;
        self
    }

    /// True for a shadow map that is rendered on demand.
    pub(crate) fn is_dynamic(&self) -> bool {
        self.format == "shadow"
    }

    /// Returns the name that the scene uses.
    fn path(&self) -> String {
        if self.is_dynamic() { self.name.to_owned() } else { format!("@/out/{}", self.name) }
    }

    /// Returns the call that adds the output or replaces it.
    pub(crate) fn pyg(&self) -> String {
        let (format, data, camera) = (self.format, self.data, self.camera);
        let arguments = self.params.arguments();
        format!(
            "Output (\"{}\", \"{format}\", \"{data}\", \"{camera}\"{}{arguments})\n",
            self.path(),
            self.fixed
        )
    }

    /// Returns the call that removes the output.
    pub(crate) fn removal(&self) -> String {
        format!("Output (\"{}\", \"null\", \"{}\", \"{}\")\n", self.path(), self.data, self.camera)
    }
}

/// A file that shaders read, in two versions.
#[derive(Clone, Copy, Debug)]
pub(crate) struct File {
    pub(crate) name: &'static str,
    /// The version that is in the folder, 0 or 1.
    pub(crate) version: usize,
}

/// A small scene. "@" in its texts is the folder of the sequence.
#[derive(Clone, Debug)]
pub(crate) struct Stage {
    pub(crate) name: &'static str,
    /// The calls before cameras and outputs, beside those of [`Stage::pyg`].
    pub(crate) globals: &'static str,
    pub(crate) cameras: Vec<Camera>,
    pub(crate) outputs: Vec<Output>,
    pub(crate) lights: Vec<Light>,
    /// The objects.
    pub(crate) objects: String,
    /// The patterns of `Modify`, beside "" for all objects.
    pub(crate) patterns: Vec<&'static str>,
    pub(crate) files: Vec<File>,
    /// Files of the scene with their texts: shaders and inputs.
    pub(crate) texts: Vec<(&'static str, &'static str)>,
    /// The expression of "rerender:filepattern".
    pub(crate) pattern: &'static str,
}

impl Stage {
    /// Returns the scene up to its objects, without `Render`.
    pub(crate) fn pyg(&self) -> String {
        let mut text = format!(
            "Attribute (\"int rerender\", 1)\nAttribute (\"string path:texture\", \"@\")\n\
             Attribute (\"string path:shader\", \"@\")\nAttribute (\"string path:input\", \"@\")\n{}",
            self.globals
        );
        self.cameras.iter().for_each(|camera| text += &camera.pyg());
        self.outputs.iter().filter(|output| output.exists).for_each(|output| text += &output.pyg());
        text += "World ()\n";
        for light in self.lights.iter().filter(|light| light.exists) {
            // `PopAttributes` switches it off for the objects that follow.
            text += &format!("{}LightSwitch (\"{}\", 1)\n", light.pyg(), light.id);
        }
        _ = write!(text, "{}", self.objects);
        text
    }
}
