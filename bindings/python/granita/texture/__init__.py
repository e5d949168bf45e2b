"""Filtered lookups of textures, environment maps and shadow maps, many points in one call.

    import numpy
    from granita.texture import TextureSystem

    system = TextureSystem(memory=1 << 30, threads=2)
    s, t = numpy.meshgrid(numpy.linspace(0, 1, 640, dtype="f4"), numpy.linspace(0, 1, 480, dtype="f4"))
    rgb = system.texture("wall.tx", s, t, dsdx=1 / 640, dtdy=1 / 480, channels=3)

Results have the shape of the points and an axis of channels: here (480, 640, 3). Arrays of numpy of the type float32 are
passed with their strides and are not copied. Other arrays, sequences and numbers are converted. Without numpy, buffers
such as ``array.array ("f")`` are used, and results are buffers. Shapes are broadcast as numpy does it.

One system may be used from many threads at once. Calls release the lock of the interpreter. The module is pure Python
over the library ``libgranita_texture``: the file that the environment variable ``GRANITA_TEXTURE_LIB`` names, or else the
one beside the module, in the wheel, in ``$GELATOHOME/lib``, or where the system finds libraries.
"""

from ._errors import TextureArgumentError, TextureError, TextureFileError, TextureWarning
from ._info import TextureInfo
from ._library import library_path
from ._system import Texture, TextureSystem

__all__ = [
    "Texture",
    "TextureArgumentError",
    "TextureError",
    "TextureFileError",
    "TextureInfo",
    "TextureSystem",
    "TextureWarning",
    "library_path",
]
