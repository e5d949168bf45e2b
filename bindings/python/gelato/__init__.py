"""Runs the renderer from any Python program.

    import gelato

    gelato.Attribute("int[2] resolution", (320, 240))
    gelato.Output("ball.tif", "tiff", "rgba", "camera")
    gelato.Translate(0, 0, 5)
    gelato.World()
    gelato.Light("key", "pointlight", "float intensity", 20, "point from", (2, 3, -4))
    gelato.Shader("surface", "plastic")
    gelato.Sphere(1, -1, 1, 360)
    gelato.Render()

Every call of the scene interface is a function of this module. The first call starts the program ``gelato``. It is the
program that the environment variable ``GELATO`` names, or else the one in ``$GELATOHOME/bin``, or else the one on the
search path. Sequences may be tuples, lists, ranges, nested ones, numpy arrays and all other iterable objects.
``GetAttribute`` returns a number, a string, a tuple, or None.

Messages of the renderer go to standard error. The output of shaders goes to ``sys.stdout``. ``Render``, ``Command`` and
``Input`` return when they are done.

``CreateRenderer (type, *options)`` starts another renderer, whose methods are the same calls. Without a type it makes
images, and takes command line options such as ``"-threads", "4"``. The types ``"pyg FILE"`` and ``"FILE.pyg"`` write
the calls to a scene file, and ``"pyg"`` writes them to ``sys.stdout``. ``finish ()`` ends a renderer and returns its
exit status: 0 for success, 1 after errors, 2 when nothing could be rendered. It is called automatically when the
program ends, and at the end of a ``with`` block. A renderer without references is ended. A renderer is also ended when
the wait for its answer was interrupted (by Ctrl-C, for example), and the image that it renders is dropped.
"""

from ._calls import CALLS
from ._renderer import GelatoAPI, GelatoError

__version__ = "0.1.0"

__all__ = list(CALLS) + ["CreateRenderer", "GelatoAPI", "GelatoError", "GelatoRenderer", "finish"]


def _function(name):
    def function(*args):
        GelatoRenderer._call(name, args)

    function.__name__ = function.__qualname__ = name
    function.__doc__ = CALLS[name]
    return function


for _name in CALLS:
    if _name != "GetAttribute":
        globals()[_name] = _function(_name)

GelatoRenderer = GelatoAPI()
CreateRenderer = GelatoAPI.CreateRenderer
GetAttribute = GelatoRenderer.GetAttribute
finish = GelatoRenderer.finish
