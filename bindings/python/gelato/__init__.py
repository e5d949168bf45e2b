"""Runs the renderer from any Python program.

    import gelato

    with gelato.Renderer() as r:
        r.Attribute("int[2] resolution", (320, 240))
        r.Translate(0, 0, 5)
        with r.world():
            r.Light("key", "pointlight", "float intensity", 20, "point from", (2, 3, -4))
            r.Shader("surface", "plastic")
            r.Sphere(1, -1, 1, 360)
        image = r.render()
    image.save_png("ball.png")

``Renderer`` has a method for each call of the scene interface. It starts the program ``gelato``. That is the program
that the environment variable ``GELATO`` names, or else the one in ``$GELATOHOME/bin``, or else the one on the search
path. Sequences may be tuples, lists, ranges, nested ones, numpy arrays and all other iterable objects.

Every call is also a function of this module, for one renderer that the first call starts. Its errors are printed, as
for scene files, and not raised. ``CreateRenderer (type, *options)`` starts another renderer of this kind.
"""

from . import _functions
from ._errors import GelatoArgumentError, GelatoError, GelatoWarning, Message
from ._files import image_info, read_image
from ._functions import *  # noqa: F403
from ._functions import GelatoRenderer
from ._images import Image, ImageInfo, ImageSpec
from ._renderer import GelatoAPI, Renderer

__version__ = "0.1.0"

CreateRenderer = GelatoAPI.CreateRenderer
finish = GelatoRenderer.finish
render = GelatoRenderer.render
world = GelatoRenderer.world
attributes = GelatoRenderer.attributes
transform = GelatoRenderer.transform
shader_group = GelatoRenderer.shader_group

__all__ = [
    "CreateRenderer",
    "GelatoAPI",
    "GelatoArgumentError",
    "GelatoError",
    "GelatoRenderer",
    "GelatoWarning",
    "Image",
    "ImageInfo",
    "ImageSpec",
    "Message",
    "Renderer",
    "finish",
    "image_info",
    "read_image",
]
__all__ += _functions.__all__
