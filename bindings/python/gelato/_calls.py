"""The calls of the scene interface and their descriptions. ``cargo xtask bless manual`` makes this file."""

CALLS = {
    "AppendTransform": """AppendTransform(*matrix: Numbers) -> None

Puts a matrix in front of the current transformation.

matrix: 16 floats: 4 x 4, row by row; finite numbers. The transformation from the new object space
    to the old one.""",
    "Attribute": """Attribute(declaration: str, *value: Value) -> None

Sets an attribute.

declaration: string; class, type and name, see Declarations. The name of the attribute. The type may
    be left out for attributes of the table.
value: as declared; that of the attribute. The value: one number or string, a sequence, or several
    numbers in a row.""",
    "Camera": """Camera(name: str, *params: Value) -> None

Adds a camera at the origin of the current transformation, which looks along +z, with x to the right
and y up.

name: string; any name. The name of the camera, and of its geometry set.""",
    "Command": """Command(name: str, *params: Value) -> None

Executes a command at once.

name: string; name of a command. The command. "system" may be followed by a line for the shell.""",
    "Comment": """Comment(text: str) -> None

Writes a comment where calls are written to a file, and does nothing elsewhere.

text: string; any text. The text, whose lines become lines of a comment.""",
    "ConnectShaders": """ConnectShaders(source_layer: str, source: str, target_layer: str, target: str) -> None

Passes a value from one layer of a group to a later one.

source_layer: string; name of a layer. The layer that computes the value.
source: string; parameter or global variable. Its parameter, or a global variable. An index in
    brackets selects an element or a component.
target_layer: string; name of a later layer. The layer that gets the value.
target: string; parameter or global variable. Its parameter, or a global variable. An index in
    brackets selects an element or a component.""",
    "Curves": """Curves(interp: str, ncurves: int, nverts: int, *params: Value) -> None
Curves(ncurves: int, nverts: int, order: int, knot: Numbers, vmin: float, vmax: float, *params: Value) -> None

Adds curves with a width, such as hair or grass.

interp: string; "linear", "bezier", "bspline", "catmull-rom". The interpolation of the vertices
    along a curve.
ncurves: int; 0 and more. The number of curves.
nverts: int; linear: 2 and more; bezier: 4, 7, 10 and so on; others: 4 and more. The number of
    vertices of each curve.

ncurves: int; 0 and more. The number of curves.
nverts: int; at least the order. The number of vertices of each curve.
order: int; 2 to 24. The degree plus one.
knot: float[nverts + order]; not decreasing. The knots, which all curves share.
vmin: float; units of the knots. The lower end of the range. Values outside of the knots are moved
    to them.
vmax: float; above vmin. The upper end of the range.""",
    "GetAttribute": """GetAttribute(name: str) -> Value

Returns the current value of an attribute.

name: string; name of an attribute. The name of the attribute. With a type, the attribute must be of
    that type.

Returns a number, a string or a tuple; None when there is no such attribute.""",
    "Input": """Input(name: str, *bound: Numbers | None) -> None

Reads calls from a file, a generator, a program or a text.

name: string; see Input and generators. The file, the generator with its arguments, or the text to
    be read.
bound: 6 floats: xmin, xmax, ymin, ymax, zmin, zmax; object units, each least value not above its
    largest. A box that contains everything in the input. With it, the input is read when a camera
    or a ray may see the box. Default: none, or the box that a generator computes.""",
    "Light": """Light(id: str, shader: str | None = None, *params: Value) -> None

Adds a light, which shines on the objects that follow.

id: string; any name. The name of the light. A light of the same name is replaced.
shader: string; name of a light shader. The shader. "null" and nothing remove the light. Default:
    "null".
layer: string; any name. The name of the layer, for ConnectShaders. Default: none.""",
    "LightSwitch": """LightSwitch(id: str, on: float) -> None

Switches a light on or off for the objects that follow.

id: string; name of a light. The name of the light.
on: int; 0 is off, all other numbers are on. Whether it shines on the objects that follow.""",
    "Mesh": """Mesh(interp: str, nverts: Numbers, verts: Numbers, *params: Value) -> None

Adds a mesh of polygons, or a subdivision surface.

interp: string; "linear", "catmull-clark". Flat faces, or a smooth surface by Catmull-Clark
    subdivision.
nverts: int[number of faces]; 3 and more each. The number of corners of each face.
verts: int[sum of nverts]; 0 to the number of vertices less one. The vertices at the corners of all
    faces, one face after the other.""",
    "Modify": """Modify(pattern: str | None = None) -> None

Begins modify mode, in which changes of attributes also change objects, lights and saved states that
exist already.

pattern: string; a basic regular expression of POSIX, of which back references are not supported.
    The states whose attribute "name" contains a match are modified. Default: "", which every name
    matches.""",
    "Motion": """Motion(*times: Numbers) -> None

Gives the times of the transformations or primitives that follow, one for each time.

times: floats: t0, t1, ...; units of "shutter", increasing. The times, at least one.""",
    "Output": """Output(name: str, format: str | None, data: str, camera: str, *params: Value) -> None

Adds an image of a camera.

name: string; file name. The file of the image, or the name of an image in a viewer. A second output
    of the same name replaces the first.
format: string; name of a format. The format of the file. "null" and nothing remove the output of
    that name. Default: "null".
data: string; rgb, rgba, z, avgz, volz, or a type and a name. The values of each pixel.
camera: string; name of a camera. The camera that makes the image. An empty name means the first
    camera.""",
    "Parameter": """Parameter(declaration: str, *value: Value) -> None

Keeps a parameter for the next call that takes parameters.

declaration: string; class, type and name, see Declarations. The name of the parameter, with its
    type.
value: as declared; as declared. The value: one number or string, a sequence, or several numbers in
    a row.""",
    "Patch": """Patch(interp: str, nu: int, nv: int, *params: Value) -> None
Patch(nu: int, uorder: int, uknot: Numbers, umin: float, umax: float, nv: int, vorder: int, vknot: Numbers, vmin: float, vmax: float, *params: Value) -> None

Adds a patch, which is a rectangle of vertices that are interpolated linearly or smoothly.

interp: string; "linear", "bezier", "bspline", "catmull-rom"; one word, or two for u and v as in
    "bspline,linear". The interpolation of the vertices.
nu: int; linear: 2 and more; bezier: 4, 7, 10 and so on; others: 4 and more. The number of vertices
    along u.
nv: int; as nu. The number of vertices along v.

nu: int; at least the order. The number of vertices along u.
uorder: int; 2 to 24. The degree along u plus one.
uknot: float[nu + uorder]; not decreasing. The knots along u.
umin: float; units of the knots. The lower end of the range of u. Values outside of the knots are
    moved to them.
umax: float; above umin. The upper end of the range of u.
nv: int; at least the order. The number of vertices along v.
vorder: int; 2 to 24. The degree along v plus one.
vknot: float[nv + vorder]; not decreasing. The knots along v.
vmin: float; units of the knots. The lower end of the range of v.
vmax: float; above vmin. The upper end of the range of v.""",
    "Points": """Points(n: int, *params: Value) -> None

Adds particles, which are disks that face the viewer.

n: int; 0 and more. The number of points.""",
    "PopAttributes": """PopAttributes() -> None

Restores the attribute state of the matching PushAttributes.""",
    "PopTransform": """PopTransform() -> None

Restores the transformation of the matching PushTransform.""",
    "PushAttributes": """PushAttributes() -> None

Keeps the attribute state, which the matching PopAttributes restores.""",
    "PushTransform": """PushTransform() -> None

Keeps the current transformation, which the matching PopTransform restores.""",
    "Render": """Render(camera: str | None = None) -> None

Renders the frame and writes its images.

camera: string; name of a camera. The camera whose images are made. Default: all cameras.""",
    "RestoreAttributes": """RestoreAttributes(name: str, attributes: str | None = None) -> None

Copies a saved attribute state, or a part of it, into the current one.

name: string; name of a saved state. The name that SaveAttributes was given.
attributes: string; attributes of objects and parts, separated by commas. The part of the saved
    state that is restored. Default: everything that was saved.""",
    "Rotate": """Rotate(angle: float, *axis: Numbers) -> None

Turns the object space of the calls that follow about an axis.

angle: float; degrees. The angle. A positive one turns x towards y about the axis z.
axis: 3 floats: x, y, z; any length above 0. The axis, which goes through the origin.""",
    "SaveAttributes": """SaveAttributes(name: str, attributes: str | None = None) -> None

Saves the attribute state, or a part of it, under a name.

name: string; any name. The name of the saved state. An earlier state of that name is replaced.
attributes: string; attributes of objects and parts, separated by commas. The part of the state that
    is saved. Default: everything.""",
    "Scale": """Scale(*scale: Numbers) -> None

Scales the object space of the calls that follow.

scale: 3 floats: x, y, z; factors, not 0. The factors along the axes. A negative factor mirrors.""",
    "SetTransform": """SetTransform(*matrix: Numbers) -> None
SetTransform(space: str) -> None

Replaces the current transformation by a matrix or by a named space.

matrix: 16 floats: 4 x 4, row by row; finite numbers. The transformation from object space to camera
    space (before World) or world space (after it).

space: string; "world", "camera", "screen", "raster", "NDC", "common"; a predefined or saved space.
    The space that becomes object space.""",
    "Shader": """Shader(usage: str, name: str | None = None, *params: Value) -> None

Sets the surface, displacement or volume shader of the objects that follow.

usage: string; "surface", "displacement", "volume". The task of the shader. "atmosphere" is accepted
    for "volume".
name: string; name of a shader. The shader. Without it the usage is cleared. Default: none.
layer: string; any name. The name of the layer, for ConnectShaders. Default: none.""",
    "ShaderGroupBegin": """ShaderGroupBegin() -> None

Begins a group, whose shaders or lights become the layers of one shader or light.""",
    "ShaderGroupEnd": """ShaderGroupEnd() -> None

Ends a group, and sets the shaders or the light that it made.""",
    "Sphere": """Sphere(radius: float, zmin: float, zmax: float, thetamax: float, *params: Value) -> None

Adds a sphere around the origin, or the part of one between two heights and within a sweep.

radius: float; object units, up to 1e18, not 0. The radius. A negative one turns the surface inside
    out.
zmin: float; object units. The lower cut. The sphere has a pole there when this is not above
    -|radius|.
zmax: float; object units. The upper cut. The sphere has a pole there when this is not below
    |radius|. A value below zmin turns the surface inside out.
thetamax: float; degrees, not 0. The sweep about z, from x towards y. A negative one turns the
    surface inside out.""",
    "Translate": """Translate(*translation: Numbers) -> None

Moves the object space of the calls that follow.

translation: 3 floats: x, y, z; object units. The place of the new origin.""",
    "TrimCurve": """TrimCurve(ncurves: Numbers, n: Numbers, order: Numbers, knot: Numbers, min: Numbers, max: Numbers, uvw: Numbers) -> None
TrimCurve() -> None

Sets the loops that trim the patches that follow, or turns trimming off.

ncurves: int[number of loops]; 1 and more each. The number of curves of each loop.
n: int[number of curves]; at least the order. The number of control points of each curve.
order: int[number of curves]; 2 to 24. The degree of each curve plus one.
knot: float[sum of n + order]; not decreasing in a curve. The knots of all curves, one curve after
    the other.
min: float[number of curves]; units of the knots. The lower end of the parameter of each curve.
max: float[number of curves]; above min. The upper end of the parameter of each curve.
uvw: float[3 x sum of n]; w not 0. The control points of all curves, as u w, v w, w.""",
    "World": """World() -> None

Ends the description of the cameras, images and options of a frame, and begins its objects.""",
}
