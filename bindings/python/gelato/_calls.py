"""The calls of the scene interface, as methods of a renderer. ``generate.py`` writes this file."""

from typing import Any, Iterable, Optional, Tuple, Union, overload

# Sequences of numbers, nested ones, and arrays of any shape.
Numbers = Iterable[Any]
# Anything that a parameter takes.
Value = Union[None, str, bytes, float, Numbers]

CALLS = (
    "AppendTransform",
    "Attribute",
    "Camera",
    "Command",
    "Comment",
    "ConnectShaders",
    "Curves",
    "GetAttribute",
    "Input",
    "Light",
    "LightSwitch",
    "Mesh",
    "Modify",
    "Motion",
    "Output",
    "Parameter",
    "Patch",
    "Points",
    "PopAttributes",
    "PopTransform",
    "PushAttributes",
    "PushTransform",
    "Render",
    "RestoreAttributes",
    "Rotate",
    "SaveAttributes",
    "Scale",
    "SetTransform",
    "Shader",
    "ShaderGroupBegin",
    "ShaderGroupEnd",
    "Sphere",
    "Translate",
    "TrimCurve",
    "World",
)


def _given(args: Tuple[Any, ...]) -> Tuple[Any, ...]:
    """Returns the arguments without those at the end that were left out."""
    while args and args[-1] is None:
        args = args[:-1]
    return args


class Calls:
    """Has a method for each call that has no answer."""

    def _call(self, name: str, args: Tuple[Any, ...]) -> None:
        raise NotImplementedError

    def AppendTransform(self, m: Union[float, Numbers], *more: float) -> None:
        """Appends a matrix of 16 numbers, row by row, to the current transformation."""
        self._call("AppendTransform", (m,) + more)

    def Attribute(self, name: str, value: Value, *more: float) -> None:
        """Sets an attribute. The name may begin with its type."""
        self._call("Attribute", (name, value) + more)

    def Camera(self, name: str, *params: Value) -> None:
        """Creates or replaces a camera. Parameters follow as names with their types, and values, in turn."""
        self._call("Camera", (name,) + params)

    def Command(self, name: str, *params: Value) -> None:
        """Runs a command of the renderer and waits for its end. Parameters follow as names with their types,
        and values, in turn.
        """
        self._call("Command", (name,) + params)

    def Comment(self, text: str) -> None:
        """Writes a comment where calls are written to a file."""
        self._call("Comment", (text,))

    def ConnectShaders(self, srclayer: str, srcparam: str, dstlayer: str, dstparam: str) -> None:
        """Connects the parameters of two shader layers, inside of a shader group."""
        self._call("ConnectShaders", (srclayer, srcparam, dstlayer, dstparam))

    @overload
    def Curves(self, interp: str, ncurves: int, nvertspercurve: int, /, *params: Value) -> None: ...

    @overload
    def Curves(
        self,
        ncurves: int,
        nvertspercurve: int,
        order: int,
        knot: Numbers,
        vmin: float,
        vmax: float,
        /,
        *params: Value,
    ) -> None: ...

    def Curves(self, *args: Value) -> None:
        """Makes curves. The interpolation is "linear", "bezier", "bspline" or "catmull-rom". Curves with knots
        are NURBS. Parameters follow as names with their types, and values, in turn.

        Curves (interp, ncurves, nvertspercurve, *params)
        Curves (ncurves, nvertspercurve, order, knot, vmin, vmax, *params)
        """
        self._call("Curves", args)

    def Input(
        self,
        name: str,
        boundingbox: Optional[Union[float, Numbers]] = None,
        *more: float,
    ) -> None:
        """Reads a scene file, or runs a generator, and waits for its end. With a bounding box (xmin, xmax,
        ymin, ymax, zmin, zmax) it is read when the renderer needs it.
        """
        self._call("Input", _given((name, boundingbox) + more))

    def Light(self, lightid: str, shadername: Optional[str] = None, *params: Value) -> None:
        """Creates or replaces a light source, which lights what follows. A name of a layer may come before the
        parameters. Parameters follow as names with their types, and values, in turn.
        """
        self._call("Light", _given((lightid, shadername) + params))

    def LightSwitch(self, lightid: str, onoff: Union[bool, int]) -> None:
        """Turns a light on or off for what follows."""
        self._call("LightSwitch", (lightid, onoff))

    def Mesh(self, interp: str, nverts: Numbers, verts: Numbers, *params: Value) -> None:
        """Makes a mesh of polygons ("linear") or a subdivision surface ("catmull-clark"): the number of
        vertices of each face, and the indices of all vertices. Parameters follow as names with their types,
        and values, in turn.
        """
        self._call("Mesh", (interp, nverts, verts) + params)

    def Modify(self, namepattern: Optional[str] = None) -> None:
        """Lets later calls modify the attributes of all objects whose name matches the regular expression."""
        self._call("Modify", _given((namepattern,)))

    def Motion(self, *times: Union[float, Numbers]) -> None:
        """Begins a motion block. A transformation or an object for each of the times follows."""
        self._call("Motion", times)

    def Output(
        self,
        name: str,
        format: Optional[str],
        data: str,
        camera: str,
        *params: Value,
    ) -> None:
        """Adds an image: its file, its format (None removes the image), its data such as "rgba" or "z", and
        the camera. Parameters follow as names with their types, and values, in turn.
        """
        self._call("Output", _given((name, format, data, camera) + params))

    def Parameter(self, name: str, value: Value, *more: float) -> None:
        """Gives a parameter to the next Camera, Output, Command, Shader, Light or object. The name may begin
        with its type.
        """
        self._call("Parameter", (name, value) + more)

    @overload
    def Patch(self, interp: str, nu: int, nv: int, /, *params: Value) -> None: ...

    @overload
    def Patch(
        self,
        nu: int,
        uorder: int,
        uknot: Numbers,
        umin: float,
        umax: float,
        nv: int,
        vorder: int,
        vknot: Numbers,
        vmin: float,
        vmax: float,
        /,
        *params: Value,
    ) -> None: ...

    def Patch(self, *args: Value) -> None:
        """Makes a patch of nu x nv control vertices. The interpolation is "linear", "bezier", "bspline" or
        "catmull-rom", or two of them. Patches with knots are NURBS. Parameters follow as names with their
        types, and values, in turn.

        Patch (interp, nu, nv, *params)
        Patch (nu, uorder, uknot, umin, umax, nv, vorder, vknot, vmin, vmax, *params)
        """
        self._call("Patch", args)

    def Points(self, npoints: int, *params: Value) -> None:
        """Makes points. Parameters follow as names with their types, and values, in turn."""
        self._call("Points", (npoints,) + params)

    def PopAttributes(self) -> None:
        """Restores the attributes of the last PushAttributes."""
        self._call("PopAttributes", ())

    def PopTransform(self) -> None:
        """Restores the transformation of the last PushTransform."""
        self._call("PopTransform", ())

    def PushAttributes(self) -> None:
        """Saves the attributes and the transformation."""
        self._call("PushAttributes", ())

    def PushTransform(self) -> None:
        """Saves the transformation."""
        self._call("PushTransform", ())

    def Render(self, camera: Optional[str] = None) -> None:
        """Renders the images of a camera, or of all, and waits for the end. (``render`` returns images.)"""
        self._call("Render", _given((camera,)))

    def RestoreAttributes(self, name: str, attrs: Optional[str] = None) -> None:
        """Sets the attributes that SaveAttributes saved, or some of them."""
        self._call("RestoreAttributes", _given((name, attrs)))

    def Rotate(
        self,
        angle: float,
        x: Union[float, Numbers],
        y: Optional[float] = None,
        z: Optional[float] = None,
    ) -> None:
        """Rotates by an angle in degrees about an axis, which is three numbers or a sequence of them."""
        self._call("Rotate", _given((angle, x, y, z)))

    def SaveAttributes(self, name: str, attrs: Optional[str] = None) -> None:
        """Saves the attributes, or some of them, under a name."""
        self._call("SaveAttributes", _given((name, attrs)))

    def Scale(
        self,
        x: Union[float, Numbers],
        y: Optional[float] = None,
        z: Optional[float] = None,
    ) -> None:
        """Scales by three numbers, or by a sequence of them."""
        self._call("Scale", _given((x, y, z)))

    def SetTransform(self, m: Union[str, float, Numbers], *more: float) -> None:
        """Replaces the transformation by a matrix of 16 numbers, or by the space of a name."""
        self._call("SetTransform", (m,) + more)

    def Shader(self, shaderusage: str, shadername: Optional[str] = None, *params: Value) -> None:
        """Sets the shader for a usage: "surface", "displacement" or "volume". Without a name, there is none. A
        name of a layer may come before the parameters. Parameters follow as names with their types, and
        values, in turn.
        """
        self._call("Shader", _given((shaderusage, shadername) + params))

    def ShaderGroupBegin(self) -> None:
        """Begins a group of shader layers."""
        self._call("ShaderGroupBegin", ())

    def ShaderGroupEnd(self) -> None:
        """Ends a group of shader layers."""
        self._call("ShaderGroupEnd", ())

    def Sphere(
        self,
        radius: float,
        zmin: float,
        zmax: float,
        thetamax: float,
        *params: Value,
    ) -> None:
        """Makes a sphere about the z axis, from zmin to zmax, swept by an angle in degrees. Parameters follow
        as names with their types, and values, in turn.
        """
        self._call("Sphere", (radius, zmin, zmax, thetamax) + params)

    def Translate(
        self,
        x: Union[float, Numbers],
        y: Optional[float] = None,
        z: Optional[float] = None,
    ) -> None:
        """Translates by three numbers, or by a sequence of them."""
        self._call("Translate", _given((x, y, z)))

    def TrimCurve(
        self,
        ncurves: Numbers,
        n: Numbers,
        order: Numbers,
        knot: Numbers,
        min: Numbers,
        max: Numbers,
        uvw: Numbers,
    ) -> None:
        """Sets the curves that trim the next NURBS patch: curves in each loop, vertices, orders, knots,
        limits, and vertices (u, v, w).
        """
        self._call("TrimCurve", (ncurves, n, order, knot, min, max, uvw))

    def World(self) -> None:
        """Ends the description of cameras and images. Objects and lights follow."""
        self._call("World", ())
