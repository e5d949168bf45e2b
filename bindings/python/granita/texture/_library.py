"""The library ``libgranita_texture``: where it is, and the types of ``granita_texture.h``."""

import ctypes
import os
import sys
import threading
from ctypes import POINTER, c_char_p, c_int, c_size_t, c_ssize_t, c_uint32, c_uint64, c_void_p
from typing import Any, Iterator, List, Optional

from ._errors import TextureArgumentError, TextureError, TextureFileError

ABI = 1
"""The version of the interface."""

_OK, _MISUSE, _UNUSABLE = 0, 1, 2

_FOLDER = os.path.dirname(os.path.abspath(__file__))


class Settings(ctypes.Structure):
    """granita_texture_settings"""

    _fields_ = [
        ("abi", c_int),
        ("threads", c_int),
        ("memory", c_uint64),
        ("files", c_int),
        ("no_automipmap", c_int),
        ("search_path", c_char_p),
        ("plugin_path", c_char_p),
    ]


class Floats(ctypes.Structure):
    """granita_texture_floats"""

    _fields_ = [("data", c_void_p), ("step", c_ssize_t), ("row_step", c_ssize_t)]


class Vectors(ctypes.Structure):
    """granita_texture_vectors"""

    _fields_ = [("data", c_void_p), ("step", c_ssize_t), ("row_step", c_ssize_t), ("component_step", c_ssize_t)]


class Points(ctypes.Structure):
    """granita_texture_points"""

    _fields_ = [
        ("columns", c_size_t),
        ("rows", c_size_t),
        ("data", c_void_p),
        ("step", c_ssize_t),
        ("row_step", c_ssize_t),
        ("component_step", c_ssize_t),
        ("channels", c_int),
        ("first_channel", c_int),
        ("fill", Floats),
    ]


def _of(*names: str) -> List[Any]:
    return [(name, Floats) for name in names]


class Lookup2d(ctypes.Structure):
    """granita_texture_lookup2d"""

    _fields_ = [
        *_of("s", "t", "dsdx", "dtdx", "dsdy", "dtdy", "sblur", "tblur", "swidth", "twidth"),
        ("swrap", c_char_p),
        ("twrap", c_char_p),
        ("filter", c_int),
    ]


class Lookup3d(ctypes.Structure):
    """granita_texture_lookup3d"""

    _fields_ = [
        ("p", Vectors),
        ("dpdx", Vectors),
        ("dpdy", Vectors),
        *_of("sblur", "tblur", "swidth", "twidth"),
        ("swrap", c_char_p),
        ("twrap", c_char_p),
    ]


class Environment(ctypes.Structure):
    """granita_texture_environment"""

    _fields_ = [
        ("r", Vectors),
        ("drdx", Vectors),
        ("drdy", Vectors),
        *_of("sblur", "tblur", "swidth", "twidth", "angle"),
        ("up", c_char_p),
    ]


class Shadow(ctypes.Structure):
    """granita_texture_shadow"""

    _fields_ = [
        ("p", Vectors),
        ("dpdx", Vectors),
        ("dpdy", Vectors),
        *_of("sblur", "tblur", "swidth", "twidth", "bias"),
        ("samples", c_int),
        ("seed", c_uint32),
    ]


# The result and the arguments of each function. Texts that are freed are addresses.
_FUNCTIONS = {
    "version": (c_char_p,),
    "abi": (c_int,),
    "create": (c_void_p, POINTER(Settings)),
    "destroy": (None, c_void_p),
    "error": (c_char_p,),
    "messages": (c_void_p, c_void_p),
    "free": (None, c_void_p),
    "set_threads": (c_int, c_void_p, c_int),
    "invalidate": (c_int, c_void_p, c_char_p),
    "open": (c_uint32, c_void_p, c_char_p),
    "info_json": (c_void_p, c_void_p, c_uint32),
    "lookup_2d": (c_int, c_void_p, c_uint32, POINTER(Points), POINTER(Lookup2d)),
    "lookup_3d": (c_int, c_void_p, c_uint32, POINTER(Points), POINTER(Lookup3d)),
    "lookup_environment": (c_int, c_void_p, c_uint32, POINTER(Points), POINTER(Environment)),
    "lookup_shadow": (c_int, c_void_p, c_uint32, POINTER(Points), POINTER(Shadow)),
    "texels": (c_int, c_void_p, c_uint32, c_int, c_int, c_int, POINTER(Points)),
    "get_statistic": (c_int, c_void_p, c_char_p, POINTER(c_uint64)),
    "statistics_text": (c_void_p, c_void_p),
    "statistics_json": (c_void_p, c_void_p),
}


class Library:
    """The functions of the library, without the prefix of their names."""

    def __init__(self, path: str) -> None:
        self.path = path
        try:
            loaded = ctypes.CDLL(path)
            for name, (result, *arguments) in _FUNCTIONS.items():
                function = getattr(loaded, "granita_texture_" + name)
                function.restype, function.argtypes = result, arguments
                setattr(self, name, function)
        except (OSError, AttributeError) as error:
            raise TextureError("%s cannot be used: %s" % (path, error)) from error
        if self.abi() != ABI:
            raise TextureError("%s has the interface %d, and this module takes %d" % (path, self.abi(), ABI))

    def __getattr__(self, name: str) -> Any:
        # The functions are set above. This is for tools that check types.
        raise AttributeError(name)

    def failure(self, status: int = _UNUSABLE) -> TextureError:
        """Returns the exception for the last failure in this thread."""
        text = (self.error() or b"").decode("utf-8", "replace")
        kinds = {_MISUSE: TextureArgumentError, _UNUSABLE: TextureFileError}
        return kinds.get(status, TextureError)(text)

    def check(self, status: int) -> None:
        """Raises the exception for a status."""
        if status != _OK:
            raise self.failure(status)

    def text(self, address: Optional[int]) -> Optional[str]:
        """Returns a text and frees it; None for NULL."""
        if not address:
            return None
        try:
            return ctypes.string_at(address).decode("utf-8", "replace")
        finally:
            self.free(address)


def _file_name() -> str:
    if sys.platform == "win32":
        return "granita_texture.dll"
    return "libgranita_texture.dylib" if sys.platform == "darwin" else "libgranita_texture.so"


def _places() -> Iterator[str]:
    """Yields the places where the library may be, in order."""
    name = _file_name()
    yield os.path.join(_FOLDER, name)
    # The folder of the wheel.
    yield os.path.join(_FOLDER, "..", "..", "gelato", "suite", "lib", name)
    home = os.environ.get("GELATOHOME")
    if home:
        yield os.path.join(home, "lib", name)


def library_path() -> str:
    """Returns the file of the library that a new ``TextureSystem`` uses, or its name where the system shall find it."""
    named = os.environ.get("GRANITA_TEXTURE_LIB")
    if named:
        return named
    found = next((place for place in _places() if os.path.isfile(place)), None)
    return os.path.normpath(found) if found else _file_name()


_lock = threading.Lock()
_loaded: "dict[str, Library]" = {}


def library() -> Library:
    """Returns the library, which is loaded once."""
    path = library_path()
    with _lock:
        if path not in _loaded:
            _loaded[path] = Library(path)
        return _loaded[path]
