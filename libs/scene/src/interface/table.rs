// tidy: table
//! The rows of the table of calls, in the order of the manual, and the tables of commands and of pre-declared
//! parameters.

use super::Kind::{
    Count, Declaration, Integers, Layer, Number, Numbers, OptionalRow, OptionalText, Rest, Row, Switch, Text,
    Value,
};
use super::{Arg, CallRow, CommandRow, Form, Kind, Page, VariableRow};
use granita_base::{BaseType, Interp, ParamType};

/// Makes a constant for each row, and the table of all rows.
macro_rules! calls {
    ($($(#[$doc:meta])* $key:ident = $row:expr;)*) => {
        $($(#[$doc])* pub const $key: &CallRow = &$row;)*

        /// All calls, in the order of the manual.
        pub const TABLE: &[&CallRow] = &[$($key),*];
    };
}

const fn call(name: &'static str, page: Page, forms: &'static [Form], help: &'static str) -> CallRow {
    CallRow { name, page, help, forms, returns: "" }
}

/// A form without parameters.
const fn form(args: &'static [Arg]) -> Form {
    Form { args, params: false }
}

/// A form that parameters may follow.
const fn with_params(args: &'static [Arg]) -> Form {
    Form { args, params: true }
}

const fn arg(name: &'static str, kind: Kind, range: &'static str, help: &'static str) -> Arg {
    Arg { name, kind, shape: "", default: "", range, words: &[], help }
}

impl Arg {
    /// Sets the number of values of a sequence, or the names of the numbers of a row.
    const fn shape(self, shape: &'static str) -> Self {
        Self { shape, ..self }
    }

    const fn default(self, default: &'static str) -> Self {
        Self { default, ..self }
    }

    const fn words(self, words: &'static [&'static str]) -> Self {
        Self { words, ..self }
    }
}

/// The form without arguments.
const NOTHING: &[Form] = &[form(&[])];

/// The interpolations of curves and of the two directions of patches.
const BASES: &[&str] = &["linear", "bezier", "bspline", "catmull-rom"];

/// The attributes in an argument of `SaveAttributes` and `RestoreAttributes`.
const PARTS: &str = "attributes of objects and parts, separated by commas";

/// The layer of `Shader` and `Light`.
const LAYER: Arg =
    arg("layer", Layer, "any name", "The name of the layer, for `ConnectShaders`.").default("none");

const NEEDED_FOR_NURBS: &str = "at least the order";

calls! {
    /// `Camera`.
    CAMERA = call("Camera", Page::Frames, &[with_params(&[
        arg("name", Text, "any name", "The name of the camera, and of its geometry set."),
    ])], "Adds a camera at the origin of the current transformation, which looks along +z, with x to the \
        right and y up.");

    /// `Output`.
    OUTPUT = call("Output", Page::Frames, &[with_params(&[
        arg("name", Text, "file name", "The file of the image, or the name of an image in a viewer. A \
            second output of the same name replaces the first."),
        arg("format", OptionalText, "name of a format", "The format of the file. `\"null\"` and nothing \
            remove the output of that name.").default("\"null\""),
        arg("data", Text, "rgb, rgba, z, avgz, volz, or a type and a name; several with commas", "The values of each pixel."),
        arg("camera", Text, "name of a camera", "The camera that makes the image. An empty name means the \
            first camera."),
    ])], "Adds an image of a camera.");

    /// `World`.
    WORLD = call("World", Page::Frames, NOTHING,
        "Ends the description of the cameras, images and options of a frame, and begins its objects.");

    /// `Render`.
    RENDER = call("Render", Page::Frames, &[form(&[
        arg("camera", OptionalText, "name of a camera", "The camera whose images are made.").default("all \
            cameras"),
    ])], "Renders the frame and writes its images.");

    /// `Input`.
    INPUT = call("Input", Page::Frames, &[form(&[
        arg("name", Text, "see [Input and generators](../scenes.md#input-and-generators)", "The file, the \
            generator with its arguments, or the text to be read."),
        arg("bound", OptionalRow(6), "object units, each least value not above its largest", "A box that \
            contains everything in the input. With it, the input is read when a camera or a ray may see the \
            box.")
            .shape("xmin, xmax, ymin, ymax, zmin, zmax").default("none, or the box that a generator \
                computes"),
    ])], "Reads calls from a file, a generator, a program or a text.");

    /// `Command`.
    COMMAND = call("Command", Page::Frames, &[with_params(&[
        arg("name", Text, "name of a command", "The command. `\"system\"` may be followed by a line for the shell."),
    ])], "Executes a command at once.");

    /// `Comment`.
    COMMENT = call("Comment", Page::Frames, &[form(&[
        arg("text", Text, "any text", "The text, whose lines become lines of a comment."),
    ])], "Writes a comment where calls are written to a file, and does nothing elsewhere.");

    /// `Parameter`.
    PARAMETER = call("Parameter", Page::Attributes, &[form(&[
        arg("declaration", Declaration, "class, type and name, see [Declarations](../calls.md#declarations)", "The name of the \
            parameter, with its type."),
        arg("value", Value, "as declared", "The value: one number or string, a sequence, or several numbers \
            in a row."),
    ])], "Keeps a parameter for the next call that takes parameters.");

    /// `Attribute`.
    ATTRIBUTE = call("Attribute", Page::Attributes, &[form(&[
        arg("declaration", Declaration, "class, type and name, see [Declarations](../calls.md#declarations)", "The name of the \
            attribute. The type may be left out for attributes of the [table](../attributes.md)."),
        arg("value", Value, "that of the attribute", "The value: one number or string, a sequence, or \
            several numbers in a row."),
    ])], "Sets an attribute.");

    /// `GetAttribute`, which is a query.
    GET_ATTRIBUTE = CallRow {
        returns: "a number, a string or a tuple; nothing when there is no such attribute",
        ..call("GetAttribute", Page::Attributes, &[form(&[
            arg("name", Declaration, "name of an attribute", "The name of the attribute. With a type, the \
                attribute must be of that type."),
        ])], "Returns the current value of an attribute.")
    };

    /// `PushAttributes`.
    PUSH_ATTRIBUTES = call("PushAttributes", Page::Attributes, NOTHING,
        "Keeps the attribute state, which the matching `PopAttributes` restores.");

    /// `PopAttributes`.
    POP_ATTRIBUTES = call("PopAttributes", Page::Attributes, NOTHING,
        "Restores the attribute state of the matching `PushAttributes`.");

    /// `SaveAttributes`.
    SAVE_ATTRIBUTES = call("SaveAttributes", Page::Attributes, &[form(&[
        arg("name", Text, "any name", "The name of the saved state. An earlier state of that name is \
            replaced."),
        arg("attributes", OptionalText, PARTS, "The part of the state that is saved.").default("everything"),
    ])], "Saves the attribute state, or a part of it, under a name.");

    /// `RestoreAttributes`.
    RESTORE_ATTRIBUTES = call("RestoreAttributes", Page::Attributes, &[form(&[
        arg("name", Text, "name of a saved state", "The name that `SaveAttributes` was given."),
        arg("attributes", OptionalText, PARTS, "The part of the saved state that is \
            restored.").default("everything that was saved"),
    ])], "Copies a saved attribute state, or a part of it, into the current one.");

    /// `Modify`.
    MODIFY = call("Modify", Page::Attributes, &[form(&[
        arg("pattern", OptionalText, "a basic regular expression of POSIX, of which back references are not \
            supported", "The states whose attribute \"name\" contains a match are \
            modified.").default("`\"\"`, which every name matches"),
    ])], "Begins modify mode, in which changes of attributes also change objects, lights and saved states \
        that exist already.");

    /// `PushTransform`.
    PUSH_TRANSFORM = call("PushTransform", Page::Transformations, NOTHING,
        "Keeps the current transformation, which the matching `PopTransform` restores.");

    /// `PopTransform`.
    POP_TRANSFORM = call("PopTransform", Page::Transformations, NOTHING,
        "Restores the transformation of the matching `PushTransform`.");

    /// `SetTransform`.
    SET_TRANSFORM = call("SetTransform", Page::Transformations, &[
        form(&[
            arg("matrix", Row(16), "finite numbers", "The transformation from object space to camera space \
                (before `World`) or world space (after it).")
                .shape("4 x 4, row by row"),
        ]),
        form(&[
            arg("space", Text, "a predefined or saved space", "The space that becomes object space.")
                .words(&["world", "camera", "screen", "raster", "NDC", "common"]),
        ]),
    ], "Replaces the current transformation by a matrix or by a named space.");

    /// `AppendTransform`.
    APPEND_TRANSFORM = call("AppendTransform", Page::Transformations, &[form(&[
        arg("matrix", Row(16), "finite numbers", "The transformation from the new object space to the old \
            one.")
            .shape("4 x 4, row by row"),
    ])], "Puts a matrix in front of the current transformation.");

    /// `Translate`.
    TRANSLATE = call("Translate", Page::Transformations, &[form(&[
        arg("translation", Row(3), "object units", "The place of the new origin.").shape("x, y, z"),
    ])], "Moves the object space of the calls that follow.");

    /// `Rotate`.
    ROTATE = call("Rotate", Page::Transformations, &[form(&[
        arg("angle", Number, "degrees", "The angle. A positive one turns x towards y about the axis z."),
        arg("axis", Row(3), "any length above 0", "The axis, which goes through the origin.").shape("x, y, \
            z"),
    ])], "Turns the object space of the calls that follow about an axis.");

    /// `Scale`.
    SCALE = call("Scale", Page::Transformations, &[form(&[
        arg("scale", Row(3), "factors, not 0", "The factors along the axes. A negative factor \
            mirrors.").shape("x, y, z"),
    ])], "Scales the object space of the calls that follow.");

    /// `Motion`.
    MOTION = call("Motion", Page::Transformations, &[form(&[
        arg("times", Rest, "units of \"shutter\", increasing", "The times, at least one.").shape("t0, t1, \
            ..."),
    ])], "Gives the times of the transformations or primitives that follow, one for each time.");

    /// `Shader`.
    SHADER = call("Shader", Page::Shaders, &[with_params(&[
        arg("usage", Text, "", "The task of the shader. `\"atmosphere\"` is accepted for \
            `\"volume\"`.")
            .words(&["surface", "displacement", "volume"]),
        arg("name", OptionalText, "name of a shader", "The shader. Without it the usage is \
            cleared.").default("none"),
        LAYER,
    ])], "Sets the surface, displacement or volume shader of the objects that follow.");

    /// `ShaderGroupBegin`.
    SHADER_GROUP_BEGIN = call("ShaderGroupBegin", Page::Shaders, NOTHING,
        "Begins a group, whose shaders or lights become the layers of one shader or light.");

    /// `ShaderGroupEnd`.
    SHADER_GROUP_END = call("ShaderGroupEnd", Page::Shaders, NOTHING,
        "Ends a group, and sets the shaders or the light that it made.");

    /// `ConnectShaders`.
    CONNECT_SHADERS = call("ConnectShaders", Page::Shaders, &[form(&[
        arg("source_layer", Text, "name of a layer", "The layer that computes the value."),
        arg("source", Text, "parameter or global variable", "Its parameter, or a global variable. An index \
            in brackets selects an element or a component."),
        arg("target_layer", Text, "name of a later layer", "The layer that gets the value."),
        arg("target", Text, "parameter or global variable", "Its parameter, or a global variable. An index \
            in brackets selects an element or a component."),
    ])], "Passes a value from one layer of a group to a later one.");

    /// `Light`.
    LIGHT = call("Light", Page::Shaders, &[with_params(&[
        arg("id", Text, "any name", "The name of the light. A light of the same name is replaced."),
        arg("shader", OptionalText, "name of a light shader", "The shader. `\"null\"` and nothing remove \
            the light.").default("`\"null\"`"),
        LAYER,
    ])], "Adds a light, which shines on the objects that follow.");

    /// `LightSwitch`.
    LIGHT_SWITCH = call("LightSwitch", Page::Shaders, &[form(&[
        arg("id", Text, "name of a light", "The name of the light."),
        arg("on", Switch, "0 is off, all other numbers are on", "Whether it shines on the objects that \
            follow."),
    ])], "Switches a light on or off for the objects that follow.");

    /// `Patch`.
    PATCH = call("Patch", Page::Shapes, &[
        with_params(&[
            arg("interp", Text, "one word, or two for u and v as in `\"bspline,linear\"`", "The \
                interpolation of the vertices.").words(BASES),
            arg("nu", Count, "linear: 2 and more; bezier: 4, 7, 10 and so on; others: 4 and more", "The \
                number of vertices along u."),
            arg("nv", Count, "as `nu`", "The number of vertices along v."),
        ]),
        with_params(&[
            arg("nu", Count, NEEDED_FOR_NURBS, "The number of vertices along u."),
            arg("uorder", Count, "2 to 24", "The degree along u plus one."),
            arg("uknot", Numbers, "not decreasing", "The knots along u.").shape("nu + uorder"),
            arg("umin", Number, "units of the knots", "The lower end of the range of u. Values outside of \
                the knots are moved to them."),
            arg("umax", Number, "above `umin`", "The upper end of the range of u."),
            arg("nv", Count, NEEDED_FOR_NURBS, "The number of vertices along v."),
            arg("vorder", Count, "2 to 24", "The degree along v plus one."),
            arg("vknot", Numbers, "not decreasing", "The knots along v.").shape("nv + vorder"),
            arg("vmin", Number, "units of the knots", "The lower end of the range of v."),
            arg("vmax", Number, "above `vmin`", "The upper end of the range of v."),
        ]),
    ], "Adds a patch, which is a rectangle of vertices that are interpolated linearly or smoothly.");

    /// `TrimCurve`.
    TRIM_CURVE = call("TrimCurve", Page::Shapes, &[
        form(&[
            arg("ncurves", Integers, "1 and more each", "The number of curves of each loop.").shape("number \
                of loops"),
            arg("n", Integers, "at least the order", "The number of control points of each \
                curve.").shape("number of curves"),
            arg("order", Integers, "2 to 24", "The degree of each curve plus one.").shape("number of curves"),
            arg("knot", Numbers, "not decreasing in a curve", "The knots of all curves, one curve after the \
                other.").shape("sum of n + order"),
            arg("min", Numbers, "units of the knots", "The lower end of the parameter of each \
                curve.").shape("number of curves"),
            arg("max", Numbers, "above `min`", "The upper end of the parameter of each \
                curve.").shape("number of curves"),
            arg("uvw", Numbers, "w not 0", "The control points of all curves, as u w, v w, w.").shape("3 x \
                sum of n"),
        ]),
        form(&[]),
    ], "Sets the loops that trim the patches that follow, or turns trimming off.");

    /// `Mesh`.
    MESH = call("Mesh", Page::Shapes, &[with_params(&[
        arg("interp", Text, "", "Flat faces, or a smooth surface by Catmull-Clark \
            subdivision.").words(&["linear", "catmull-clark"]),
        arg("nverts", Integers, "3 and more each", "The number of corners of each face.").shape("number of \
            faces"),
        arg("verts", Integers, "0 to the number of vertices less one", "The vertices at the corners of all \
            faces, one face after the other.").shape("sum of nverts"),
    ])], "Adds a mesh of polygons, or a subdivision surface.");

    /// `Points`.
    POINTS = call("Points", Page::Shapes, &[with_params(&[
        arg("n", Count, "0 and more", "The number of points."),
    ])], "Adds particles, which are disks that face the viewer.");

    /// `Curves`.
    CURVES = call("Curves", Page::Shapes, &[
        with_params(&[
            arg("interp", Text, "", "The interpolation of the vertices along a \
                curve.").words(BASES),
            arg("ncurves", Count, "0 and more", "The number of curves."),
            arg("nverts", Count, "linear: 2 and more; bezier: 4, 7, 10 and so on; others: 4 and more", "The \
                number of vertices of each curve."),
        ]),
        with_params(&[
            arg("ncurves", Count, "0 and more", "The number of curves."),
            arg("nverts", Count, NEEDED_FOR_NURBS, "The number of vertices of each curve."),
            arg("order", Count, "2 to 24", "The degree plus one."),
            arg("knot", Numbers, "not decreasing", "The knots, which all curves share.").shape("nverts + \
                order"),
            arg("vmin", Number, "units of the knots", "The lower end of the range. Values outside of the \
                knots are moved to them."),
            arg("vmax", Number, "above `vmin`", "The upper end of the range."),
        ]),
    ], "Adds curves with a width, such as hair or grass.");

    /// `Sphere`.
    SPHERE = call("Sphere", Page::Shapes, &[with_params(&[
        arg("radius", Number, "object units, up to 1e18, not 0", "The radius. A negative one turns the \
            surface inside out."),
        arg("zmin", Number, "object units", "The lower cut. The sphere has a pole there when this is not \
            above -|radius|."),
        arg("zmax", Number, "object units", "The upper cut. The sphere has a pole there when this is not \
            below |radius|. A value below `zmin` turns the surface inside out."),
        arg("thetamax", Number, "degrees, not 0", "The sweep about z, from x towards y. A negative one \
            turns the surface inside out."),
    ])], "Adds a sphere around the origin, or the part of one between two heights and within a sweep.");
}

/// The commands.
pub const COMMANDS: &[CommandRow] = &[
    CommandRow {
        name: "exit",
        params: &[],
        help: "Ends the reading of the scene and the program. A frame that was not rendered is dropped.",
    },
    CommandRow {
        name: "return",
        params: &[],
        help: "Ends the frame that is being rendered. The pixels that exist are written. It has an effect \
            from another thread or process only.",
    },
    CommandRow {
        name: "wait",
        params: &[("float time", "the longest time to wait, in seconds (default: any)")],
        help: "Waits until the frame is done. `Render` returns only then anyway, except in a \"remote\" \
            renderer.",
    },
    CommandRow {
        name: "system",
        params: &[
            ("string[n] command", "a program and its arguments, without a shell; \"argv\" means the same"),
            ("int wait", "1 waits until the program ends (the default), 0 does not"),
            ("int echo", "1 prints the program and its arguments (default: 0)"),
        ],
        help: "Runs a line of the shell, as in `Command (\"system maketx a.png a.tx\")`, or a program with \
            its arguments. See [Running programs](../scenes.md#running-programs).",
    },
    CommandRow {
        name: "mkdir",
        params: &[("string name", "the folder")],
        help: "Makes a folder. A folder that exists is no error.",
    },
    CommandRow { name: "unlink", params: &[("string name", "the file")], help: "Deletes a file." },
    CommandRow {
        name: "bucketpriority",
        params: &[
            ("int[2] center", "the pixel x, y around which the frame goes on"),
            ("int[4] rectangle", "the pixels xmin, ymin, xmax, ymax that are rendered first"),
        ],
        help: "Changes the order of the parts of the frame that wait. It needs exactly one of the two \
            parameters.",
    },
    CommandRow {
        name: "fileread",
        params: &[("string name", "the file")],
        help: "Adds a file to the list of files read (\"debug:filesread\").",
    },
];

const fn variable(name: &'static str, ty: ParamType, of: &'static str) -> VariableRow {
    VariableRow { name, ty, of, default: "", range: "", help: "" }
}

impl VariableRow {
    const fn range(self, default: &'static str, range: &'static str) -> Self {
        Self { default, range, ..self }
    }

    const fn help(self, help: &'static str) -> Self {
        Self { help, ..self }
    }
}

const CATMULL_CLARK: &str = "`Mesh`, \"catmull-clark\"";
const INTEGERS: ParamType = ParamType::array(BaseType::Int, 0);
const SHARPNESSES: ParamType = ParamType::array(BaseType::Float, 0);

/// The parameters of primitives whose types are known by their names.
pub const VARIABLES: &[VariableRow] = &[
    variable("P", ParamType::of(BaseType::Point).with_interp(Interp::Vertex), "all but `Sphere`")
        .range("", "object units, up to 1e20")
        .help("The positions of the vertices. It is \"vertex\" whatever is declared."),
    variable("Pw", ParamType::of(BaseType::HPoint).with_interp(Interp::Vertex), "all but `Sphere`")
        .range("", "weights above 0")
        .help("The positions of rational vertices instead of \"P\", as x w, y w, z w, w."),
    variable("N", ParamType::of(BaseType::Normal), "all")
        .range("the normals of the surface", "any length")
        .help("The normals for shading. Curves with it are ribbons across the normals."),
    variable("C", ParamType::of(BaseType::Color), "all")
        .range("the attribute \"C\"", "0 to 1 as a rule")
        .help("The surface colour."),
    variable("opacity", ParamType::of(BaseType::Color), "all")
        .range("the attribute \"opacity\"", "0 to 1")
        .help("The surface opacity."),
    variable("width", ParamType::of(BaseType::Float), "`Points`, `Curves`")
        .range("1", "object units, 0 to 1e12")
        .help("The diameter of points or curves."),
    variable("rasterwidth", ParamType::of(BaseType::Float), "`Points`")
        .range("", "pixels, 0 to 1e12")
        .help("The diameter of points instead of \"width\"."),
    variable("border", ParamType::of(BaseType::Int), CATMULL_CLARK).range("0", "0, 1, 2").help(
        "Faces at the border of the mesh: 0 leaves them out, 1 draws them with sharp corners, 2 with \
            round corners.",
    ),
    variable("holes", INTEGERS, "`Mesh`")
        .range("none", "numbers of faces, from 0")
        .help("The faces that are not drawn."),
    variable("creaselengths", INTEGERS, CATMULL_CLARK)
        .range("none", "numbers of vertices")
        .help("The lengths of chains of sharp edges. See [Creases](../scenes.md#creases)."),
    variable("creaseindices", INTEGERS, CATMULL_CLARK)
        .range("none", "indices of vertices")
        .help("The vertices of all chains."),
    variable("creasesharpnesses", SHARPNESSES, CATMULL_CLARK)
        .range("none", "0 smooth, 10 and more sharp")
        .help("The sharpness of each chain or of each edge."),
    variable("cornerindices", INTEGERS, CATMULL_CLARK)
        .range("none", "indices of vertices")
        .help("The vertices that are sharp."),
    variable("cornersharpnesses", SHARPNESSES, CATMULL_CLARK)
        .range("none", "0 smooth, 10 and more sharp")
        .help("The sharpness of each of these vertices."),
    variable("__attributes", ParamType::of(BaseType::String).with_interp(Interp::PerPiece), "`Mesh`")
        .range("none", "names of saved states")
        .help(
            "The attribute state of each face, by its name in `SaveAttributes`; with \
            \"__attributesindex\" a list of names.",
        ),
    variable("__attributesindex", ParamType::of(BaseType::Int).with_interp(Interp::PerPiece), "`Mesh`")
        .range("none", "0 to the number of names less one")
        .help("For each face, its place in the list \"string[n] __attributes\"."),
];
