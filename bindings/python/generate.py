"""Writes the calls of the package from one table: ``gelato/_calls.py`` and ``gelato/_functions.py``.

    python3 bindings/python/generate.py [--check]

``--check`` writes nothing, and ends with status 1 when a file is not up to date. The tests run it.
"""

import os
import sys
import textwrap

FOLDER = os.path.join(os.path.dirname(os.path.abspath(__file__)), "gelato")

# The kinds of arguments: what stands in the signature. "?" marks an argument that may be left out.
KINDS = {
    "str": "str",
    "int": "int",
    "float": "float",
    "bool": "bool",
    "numbers": "Numbers",
    "value": "Value",
    "float|numbers": "Union[float, Numbers]",
    "str|float|numbers": "Union[str, float, Numbers]",
    "bool|int": "Union[bool, int]",
}

PARAMS = "Parameters follow as names with their types, and values, in turn."

# Each call: its forms, its description, and an example that the tests make. A form is a list of arguments
# (name:kind), of which the last may be "*params" (names and values in turn), "*times", or "*more" (a sequence may be
# written as its numbers). Calls of several forms have the signature (*args), and one for each form for editors, whose
# arguments have no names.
CALLS = {
    "AppendTransform": (["m:float|numbers *more"],
        "Appends a matrix of 16 numbers, row by row, to the current transformation.",
        "([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 3, 0, 0, 1],)"),
    "Attribute": (["name:str value:value *more"], "Sets an attribute. The name may begin with its type.",
        "('float fov', 30)"),
    "Camera": (["name:str *params"], "Creates or replaces a camera. " + PARAMS, "('main', 'float fov', 30)"),
    "Command": (["name:str *params"], "Runs a command of the renderer and waits for its end. " + PARAMS,
        "('system', 'string[2] command', ('echo', 'a'))"),
    "Comment": (["text:str"], "Writes a comment where calls are written to a file.", "('text',)"),
    "ConnectShaders": (["srclayer:str srcparam:str dstlayer:str dstparam:str"],
        "Connects the parameters of two shader layers, inside of a shader group.", "('a', 'out', 'b', 'Ks')"),
    "Curves": (["interp:str ncurves:int nvertspercurve:int *params",
            "ncurves:int nvertspercurve:int order:int knot:numbers vmin:float vmax:float *params"],
        'Makes curves. The interpolation is "linear", "bezier", "bspline" or "catmull-rom". Curves with knots are '
        "NURBS. " + PARAMS, "('linear', 1, 2, 'vertex point P', [(0, 0, 0), (1, 0, 0)], 'constant float width', 0.1)"),
    "Input": (["name:str boundingbox:float|numbers? *more"],
        "Reads a scene file, or runs a generator, and waits for its end. With a bounding box (xmin, xmax, ymin, ymax, "
        "zmin, zmax) it is read when the renderer needs it.", "('objects.pyg', (-1, 1, -1, 1, -1, 1))"),
    "Light": (["lightid:str shadername:str? *params"],
        "Creates or replaces a light source, which lights what follows. A name of a layer may come before the "
        "parameters. " + PARAMS, "('key', 'pointlight', 'float intensity', 20)"),
    "LightSwitch": (["lightid:str onoff:bool|int"], "Turns a light on or off for what follows.", "('key', False)"),
    "Mesh": (["interp:str nverts:numbers verts:numbers *params"],
        'Makes a mesh of polygons ("linear") or a subdivision surface ("catmull-clark"): the number of vertices of '
        "each face, and the indices of all vertices. " + PARAMS,
        "('linear', [3], [0, 1, 2], 'vertex point P', [(0, 0, 0), (1, 0, 0), (0, 1, 0)])"),
    "Modify": (["namepattern:str?"],
        "Lets later calls modify the attributes of all objects whose name matches the regular expression.",
        "('ball.*',)"),
    "Motion": (["*times"], "Begins a motion block. A transformation or an object for each of the times follows.",
        "(0.0, 1.0)"),
    "Output": (["name:str format:str? data:str camera:str *params"],
        'Adds an image: its file, its format (None removes the image), its data such as "rgba" or "z", and the camera. '
        + PARAMS, "('a.tif', 'tiff', 'rgba', 'camera', 'float gain', 2)"),
    "Parameter": (["name:str value:value *more"],
        "Gives a parameter to the next Camera, Output, Command, Shader, Light or object. The name may begin with its "
        "type.",
        "('vertex point P', [(0, 0, 0)])"),
    "Patch": (["interp:str nu:int nv:int *params",
            "nu:int uorder:int uknot:numbers umin:float umax:float "
            "nv:int vorder:int vknot:numbers vmin:float vmax:float *params"],
        'Makes a patch of nu x nv control vertices. The interpolation is "linear", "bezier", "bspline" or '
        '"catmull-rom", or two of them. Patches with knots are NURBS. ' + PARAMS,
        "(2, 2, (0, 0, 1, 1), 0, 1, 2, 2, (0, 0, 1, 1), 0, 1, 'vertex hpoint Pw', [0, 0, 0, 1] * 4)"),
    "Points": (["npoints:int *params"], "Makes points. " + PARAMS, "(1, 'vertex point P', (0, 0, 0))"),
    "PopAttributes": ([""], "Restores the attributes of the last PushAttributes.", "()"),
    "PopTransform": ([""], "Restores the transformation of the last PushTransform.", "()"),
    "PushAttributes": ([""], "Saves the attributes and the transformation.", "()"),
    "PushTransform": ([""], "Saves the transformation.", "()"),
    "Render": (["camera:str?"],
        "Renders the images of a camera, or of all, and waits for the end. (``render`` returns images.)", "()"),
    "RestoreAttributes": (["name:str attrs:str?"], "Sets the attributes that SaveAttributes saved, or some of them.",
        "('red', 'C')"),
    "Rotate": (["angle:float x:float|numbers y:float? z:float?"],
        "Rotates by an angle in degrees about an axis, which is three numbers or a sequence of them.",
        "(30, (0, 1, 0))"),
    "SaveAttributes": (["name:str attrs:str?"], "Saves the attributes, or some of them, under a name.", "('red', 'C')"),
    "Scale": (["x:float|numbers y:float? z:float?"], "Scales by three numbers, or by a sequence of them.", "(1, 2, 3)"),
    "SetTransform": (["m:str|float|numbers *more"],
        "Replaces the transformation by a matrix of 16 numbers, or by the space of a name.", "('world',)"),
    "Shader": (["shaderusage:str shadername:str? *params"],
        'Sets the shader for a usage: "surface", "displacement" or "volume". Without a name, there is none. A name of '
        "a layer may come before the parameters. " + PARAMS, "('surface', 'plastic', 'float Ks', 0.5)"),
    "ShaderGroupBegin": ([""], "Begins a group of shader layers.", "()"),
    "ShaderGroupEnd": ([""], "Ends a group of shader layers.", "()"),
    "Sphere": (["radius:float zmin:float zmax:float thetamax:float *params"],
        "Makes a sphere about the z axis, from zmin to zmax, swept by an angle in degrees. " + PARAMS,
        "(1, -1, 1, 360)"),
    "Translate": (["x:float|numbers y:float? z:float?"], "Translates by three numbers, or by a sequence of them.",
        "((1, 2, 3),)"),
    "TrimCurve": (["ncurves:numbers n:numbers order:numbers knot:numbers min:numbers max:numbers uvw:numbers"],
        "Sets the curves that trim the next NURBS patch: curves in each loop, vertices, orders, knots, limits, and "
        "vertices (u, v, w).",
        "([1], [2], [2], [0, 0, 1, 1], [0], [1], [0, 0, 1, 1, 1, 1])"),
    "World": ([""], "Ends the description of cameras and images. Objects and lights follow.", "()"),
}  # fmt: skip

# The call that answers is written by hand, in _renderer.py.
ANSWERS = ("GetAttribute",)

HEAD = '"""The calls of the scene interface%s. ``generate.py`` writes this file."""\n\n'


def arguments(form):
    """Returns the arguments of a form, as names, kinds, and True for those that may be left out."""
    split = [word.partition(":") for word in form.split()]
    return [(name, kind.rstrip("?"), kind.endswith("?")) for name, _, kind in split]


def method(name, form, body, positional=False):
    """Returns the first lines of a method, whose arguments may be without names."""
    words = signature(form)
    if positional:
        words.insert(len(words) - 1, "/")
    line = "    def %s(%s) -> None:%s\n" % (name, ", ".join(words), body)
    if len(line) <= 101:
        return line
    return "    def %s(\n%s    ) -> None:%s\n" % (name, "".join("        %s,\n" % word for word in words), body)


def signature(form):
    """Returns the parameters of a method."""
    words, left_out = ["self"], False
    for position, (name, kind, optional) in enumerate(arguments(form)):
        if name == "*params":
            words.append("*params: Value")
        elif name == "*times":
            words.append("*times: Union[float, Numbers]")
        elif name == "*more":
            words.append("*more: float")
        else:
            later = arguments(form)[position + 1 :]
            left_out = optional and not any(not o and not n.startswith("*") for n, _, o in later)
            words.append(
                "%s: Optional[%s]%s" % (name, KINDS[kind], " = None" if left_out else "")
                if optional
                else "%s: %s" % (name, KINDS[kind])
            )
    return words


def passed(form):
    """Returns the expression of the arguments that are sent."""
    names = [name for name, _, _ in arguments(form)]
    rest = names.pop()[1:] if names and names[-1].startswith("*") else None
    fixed = "(%s%s)" % (", ".join(names), "," if len(names) == 1 else "") if names else "()"
    whole = fixed if rest is None else rest if not names else "%s + %s" % (fixed, rest)
    return "_given(%s)" % whole if any(optional for _, _, optional in arguments(form)) else whole


def doc(name, forms, text):
    """Returns the lines of a docstring."""
    lines = textwrap.wrap(text, 100)
    if len(forms) > 1:
        lines += [""]
        for form in forms:
            shown = ", ".join(n if n.startswith("*") else n for n, _, _ in arguments(form))
            lines += textwrap.wrap("%s (%s)" % (name, shown), 100, subsequent_indent="    ")
    if len(lines) == 1:
        return ['        """%s"""' % lines[0]]
    return ['        """' + lines[0]] + [("        " + line).rstrip() for line in lines[1:]] + ['        """']


def calls_file():
    """Returns the text of ``_calls.py``."""
    out = [HEAD % ", as methods of a renderer"]
    out.append("from typing import Any, Iterable, Optional, Tuple, Union, overload\n\n")
    out.append("# Sequences of numbers, nested ones, and arrays of any shape.\nNumbers = Iterable[Any]\n")
    out.append("# Anything that a parameter takes.\nValue = Union[None, str, bytes, float, Numbers]\n\n")
    names = sorted(list(CALLS) + list(ANSWERS))
    out.append("CALLS = (\n%s)\n\n\n" % "".join('    "%s",\n' % name for name in names))
    out.append("def _given(args: Tuple[Any, ...]) -> Tuple[Any, ...]:\n")
    out.append('    """Returns the arguments without those at the end that were left out."""\n')
    out.append("    while args and args[-1] is None:\n        args = args[:-1]\n    return args\n\n\n")
    out.append("class Calls:\n")
    out.append('    """Has a method for each call that has no answer."""\n\n')
    out.append("    def _call(self, name: str, args: Tuple[Any, ...]) -> None:\n")
    out.append("        raise NotImplementedError\n")
    for name in sorted(CALLS):
        forms, text, _ = CALLS[name]
        if len(forms) > 1:
            for form in forms:
                out.append("\n    @overload\n" + method(name, form, " ...", True))
            out.append("\n    def %s(self, *args: Value) -> None:\n" % name)
        else:
            out.append("\n" + method(name, forms[0], ""))
        out.append("\n".join(doc(name, forms, text)) + "\n")
        out.append('        self._call("%s", %s)\n' % (name, "args" if len(forms) > 1 else passed(forms[0])))
    return "".join(out)


def functions_file():
    """Returns the text of ``_functions.py``."""
    names = sorted(list(CALLS) + list(ANSWERS))
    out = [HEAD % ", as functions for the renderer of the module"]
    out.append("from ._renderer import GelatoAPI\n\n")
    out.append("GelatoRenderer = GelatoAPI.CreateRenderer()\n\n")
    out += ["%s = GelatoRenderer.%s\n" % (name, name) for name in names]
    out.append("\n__all__ = [\n%s]\n" % "".join('    "%s",\n' % name for name in names))
    return "".join(out)


def main():
    check = sys.argv[1:] == ["--check"]
    old = []
    for name, text in (("_calls.py", calls_file()), ("_functions.py", functions_file())):
        path = os.path.join(FOLDER, name)
        before = None
        if os.path.exists(path):
            with open(path, encoding="utf-8") as file:
                before = file.read()
        if before == text:
            continue
        old.append(name)
        if not check:
            with open(path, "w", encoding="utf-8", newline="\n") as file:
                file.write(text)
    if check and old:
        sys.exit("%s: not up to date; run bindings/python/generate.py" % ", ".join(old))


if __name__ == "__main__":
    main()
