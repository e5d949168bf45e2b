"""The renderer, from any Python program.

    import gelato

    gelato.Attribute("int[2] resolution", (320, 240))
    gelato.Output("ball.tif", "tiff", "rgba", "camera")
    gelato.Translate(0, 0, 5)
    gelato.World()
    gelato.Light("key", "pointlight", "float intensity", 20, "point from", (2, 3, -4))
    gelato.Shader("surface", "plastic")
    gelato.Sphere(1, -1, 1, 360)
    gelato.Render()

Every call of the scene interface is a function of this module. The first one starts the program ``gelato``: the one
that the environment variable ``GELATO`` names, else the one in ``$GELATOHOME/bin``, else the one on the search path.
Sequences may be tuples, lists, ranges, nested ones, numpy arrays and whatever else can be iterated. ``GetAttribute``
returns a number, a string, a tuple, or None.

Messages of the renderer go to standard error; what shaders print goes to ``sys.stdout``. ``Render``, ``Command`` and
``Input`` return when they are done.

``CreateRenderer (type, *options)`` starts one more renderer; its methods are the same calls. Without a type it makes
images, and takes command line options as ``"-threads", "4"``; ``"pyg FILE"`` or ``"FILE.pyg"`` writes the calls to a scene
file, ``"pyg"`` to ``sys.stdout``. ``finish ()`` ends a renderer and returns its exit status: 0 all went well, 1 with errors, 2 nothing
could be rendered. It happens by itself when the program ends, and at the end of a ``with`` block. A renderer that is no
longer referred to is ended, and so is one whose answer was interrupted (by Ctrl-C, for example): what it renders then is dropped.
"""

from ._renderer import CALLS, GelatoAPI, GelatoError

__version__ = "0.1.0"

__all__ = list(CALLS) + ["CreateRenderer", "GelatoAPI", "GelatoError", "GelatoRenderer", "finish"]


def _function(name):
    def function(*args):
        GelatoRenderer._call(name, args)

    function.__name__ = function.__qualname__ = name
    function.__doc__ = "The call %s of the scene interface." % name
    return function


for _name in CALLS:
    if _name != "GetAttribute":
        globals()[_name] = _function(_name)

GelatoRenderer = GelatoAPI()
CreateRenderer = GelatoAPI.CreateRenderer
GetAttribute = GelatoRenderer.GetAttribute
finish = GelatoRenderer.finish
