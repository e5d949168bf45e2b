"""Texture systems and their lookups."""

import json
import os
import sys
import warnings
from ctypes import byref
from types import TracebackType
from typing import Any, Callable, Dict, List, Optional, Sequence, Tuple, Type, Union

from . import _arrays
from ._arrays import Part
from ._errors import TextureArgumentError, TextureError, TextureWarning
from ._info import TextureInfo
from ._library import ABI, Environment, Library, Lookup2d, Lookup3d, Points, Settings, Shadow, library

_FILTERS = {"gaussian": 0, "bilinear": 1, "nearest": 2}

_FOLDER = os.path.dirname(__file__)

Path = Union[str, "os.PathLike[str]"]


def _encode(text: Optional[str]) -> Optional[bytes]:
    return None if text is None else text.encode("utf-8")


def _joined(path: Union[Path, Sequence[Path]]) -> bytes:
    """Returns folders as one text: a text of folders with colons, a folder, or a sequence of them."""
    folders = [path] if isinstance(path, (str, os.PathLike)) else path
    return ":".join(os.fspath(folder) for folder in folders).encode("utf-8")


def _level() -> int:
    """Returns the level of the caller of the package, for warnings of the function that calls this."""
    level, frame = 1, sys._getframe(1)
    while frame.f_back is not None and os.path.dirname(frame.f_code.co_filename) == _FOLDER:
        level, frame = level + 1, frame.f_back
    return level


class _Native:
    """A system of the library. It ends when neither the ``TextureSystem`` nor a call uses it any more."""

    def __init__(self, own: Library, settings: Settings) -> None:
        self.library = own
        self.pointer = own.create(byref(settings))
        if not self.pointer:
            raise own.failure(1)

    def __del__(self) -> None:
        pointer = getattr(self, "pointer", None)
        if pointer:
            self.library.destroy(pointer)


class Texture:
    """A texture of a ``TextureSystem``, by its name. ``TextureSystem.open`` returns it."""

    __slots__ = ("_handle", "_info", "_system", "name")

    def __init__(self, system: "TextureSystem", name: str, handle: int) -> None:
        self._system, self._handle = system, handle
        self._info: Optional[TextureInfo] = None
        self.name = name

    @property
    def info(self) -> TextureInfo:
        """Data about the texture."""
        if self._info is None:
            native = self._system._running()
            text = native.library.text(native.library.info_json(native.pointer, self._handle))
            self._system._tell(native)
            if text is None:
                raise native.library.failure()
            self._info = TextureInfo.of_json(text)
        return self._info

    def __repr__(self) -> str:
        return "<granita.texture.Texture %r>" % self.name


class TextureSystem:
    """Textures, and a cache of their tiles. Many threads may use one system at once.

    memory: the largest number of bytes of tiles that are held at once.
    files: the largest number of files that are open at once.
    path: the folders that are searched: a text with colons, or a sequence of folders.
    plugins: folders and files of image format plugins, like ``path``.
    threads: the number of threads that share the points of one call; 0 is one for each processor.
    automipmap: False refuses files without tiles or MIP levels, instead of making them in memory.
    on_message: is called with a severity ("warning" or "error") and a text. By default messages become a
        ``TextureWarning``. The thread that makes a call receives the messages that have come until its end.
    """

    def __init__(
        self,
        memory: int = 256 << 20,
        *,
        files: int = 1000,
        path: Union[Path, Sequence[Path]] = ".",
        plugins: Union[Path, Sequence[Path]] = "",
        threads: int = 1,
        automipmap: bool = True,
        on_message: Optional[Callable[[str, str], None]] = None,
    ) -> None:
        if memory < 1 or files < 1:
            raise TextureArgumentError("memory and files are at least 1, not %d and %d" % (memory, files))
        settings = Settings(
            abi=ABI,
            threads=self._thread_number(threads),
            memory=min(memory, 2**64 - 1),
            files=min(files, 2**31 - 1),
            no_automipmap=0 if automipmap else 1,
            search_path=_joined(path),
            plugin_path=_joined(plugins),
        )
        self._native: Optional[_Native] = _Native(library(), settings)
        self._textures: Dict[str, Texture] = {}
        self._on_message = on_message
        self._threads = threads

    @staticmethod
    def _thread_number(threads: int) -> int:
        if threads < 0 or threads >= 2**31:
            raise TextureArgumentError("threads is 0 (all processors) or more, not %d" % threads)
        return threads or -1

    def _running(self) -> _Native:
        native = self._native
        if native is None:
            raise TextureError("the texture system is closed")
        return native

    def _tell(self, native: _Native) -> None:
        """Passes on the messages since the last call."""
        lines = native.library.text(native.library.messages(native.pointer))
        for line in (lines or "").splitlines():
            severity, _, text = line.partition(": ")
            if self._on_message is not None:
                self._on_message(severity, text)
            else:
                warnings.warn(text, TextureWarning, stacklevel=_level())

    @property
    def threads(self) -> int:
        """The number of threads that share the points of one call; 0 is one for each processor."""
        return self._threads

    @threads.setter
    def threads(self, threads: int) -> None:
        native = self._running()
        native.library.check(native.library.set_threads(native.pointer, self._thread_number(threads)))
        self._threads = threads

    def open(self, name: Union[Path, Texture]) -> Texture:
        """Returns a texture: a file, an image of a file ("parts.exr#2") or a set ("wall.<UDIM>.tx").

        Raises ``TextureFileError`` when it does not exist or cannot be used.
        """
        if isinstance(name, Texture):
            if name._system is not self:
                raise TextureArgumentError("%r is a texture of another system" % name.name)
            return name
        text = os.fspath(name)
        known = self._textures.get(text)
        if known is not None:
            return known
        native = self._running()
        handle = native.library.open(native.pointer, text.encode("utf-8"))
        self._tell(native)
        if not handle:
            raise native.library.failure()
        return self._textures.setdefault(text, Texture(self, text, handle))

    def info(self, texture: Union[Path, Texture]) -> TextureInfo:
        """Returns data about a texture: size, channels, kind, levels, wrap modes, mean and metadata."""
        return self.open(texture).info

    def texture(
        self,
        texture: Union[Path, Texture],
        s: Any,
        t: Any,
        dsdx: Any = None,
        dtdx: Any = None,
        dsdy: Any = None,
        dtdy: Any = None,
        *,
        blur: Any = None,
        sblur: Any = None,
        tblur: Any = None,
        width: Any = None,
        swidth: Any = None,
        twidth: Any = None,
        wrap: Optional[str] = None,
        swrap: Optional[str] = None,
        twrap: Optional[str] = None,
        filter: str = "gaussian",
        fill: Any = None,
        first_channel: int = 0,
        channels: Optional[int] = None,
        out: Any = None,
    ) -> Any:
        """Looks up the filtered values of a texture at many points.

        s, t: coordinates, as fractions of the image. (0, 0) is the outer corner of the upper left texel.
        dsdx, dtdx, dsdy, dtdy: the changes from each point to the next one in x and y; 0 by default.
        blur (or sblur, tblur): full widths of additional blur, as fractions of the image; 0 by default.
        width (or swidth, twidth): factors of the changes; 1 by default.
        wrap (or swrap, twrap): "black", "clamp", "periodic" or "mirror"; by default that of the file.
        filter: "gaussian" takes the mean of all texels under the ellipse that the changes, width and blur span.
            "bilinear" takes four texels of the largest level, "nearest" one.
        fill: the value of channels that the file lacks; 0 by default.
        channels: the number of channels from ``first_channel`` on; by default all of the file.
        out: an array of float32 that receives the results.

        All numbers may be arrays, which are broadcast to the shape S of the points. Returns an array of the shape
        (*S, channels), or a tuple when all arguments are numbers.
        """
        lookup = Lookup2d()
        if filter not in _FILTERS:
            raise TextureArgumentError('filter is "gaussian", "bilinear" or "nearest", not %r' % (filter,))
        lookup.filter = _FILTERS[filter]
        lookup.swrap, lookup.twrap = _encode(swrap or wrap), _encode(twrap or wrap)
        numbers = [("s", s), ("t", t), ("dsdx", dsdx), ("dtdx", dtdx), ("dsdy", dsdy), ("dtdy", dtdy)]
        numbers += _widths(blur, sblur, tblur, width, swidth, twidth)
        return self._look("lookup_2d", texture, lookup, numbers, [], (fill, first_channel, channels, out))

    def texture3d(
        self,
        texture: Union[Path, Texture],
        p: Any,
        dpdx: Any = None,
        dpdy: Any = None,
        *,
        blur: Any = None,
        sblur: Any = None,
        tblur: Any = None,
        width: Any = None,
        swidth: Any = None,
        twidth: Any = None,
        wrap: Optional[str] = None,
        swrap: Optional[str] = None,
        twrap: Optional[str] = None,
        fill: Any = None,
        first_channel: int = 0,
        channels: Optional[int] = None,
        out: Any = None,
    ) -> Any:
        """Looks up the filtered values of a volume texture, whose images are slices.

        p, dpdx, dpdy: positions and their changes, of the shape (*S, 3), as fractions of the volume: right, down, to
        the back. The other arguments and the result are as in ``texture``.
        """
        lookup = Lookup3d()
        lookup.swrap, lookup.twrap = _encode(swrap or wrap), _encode(twrap or wrap)
        numbers = _widths(blur, sblur, tblur, width, swidth, twidth)
        places = [("p", p), ("dpdx", dpdx), ("dpdy", dpdy)]
        return self._look("lookup_3d", texture, lookup, numbers, places, (fill, first_channel, channels, out))

    def environment(
        self,
        texture: Union[Path, Texture],
        r: Any,
        drdx: Any = None,
        drdy: Any = None,
        *,
        angle: Any = None,
        blur: Any = None,
        sblur: Any = None,
        tblur: Any = None,
        width: Any = None,
        swidth: Any = None,
        twidth: Any = None,
        up: Optional[str] = None,
        fill: Any = None,
        first_channel: int = 0,
        channels: Optional[int] = None,
        out: Any = None,
    ) -> Any:
        """Looks up the filtered values of an environment map in many directions.

        r, drdx, drdy: directions of any length and their changes, of the shape (*S, 3).
        angle: the half angle of an additional cone, in radians, instead of the blurs.
        blur (or sblur, tblur): additional blur; 1 is 90 degrees.
        up: "y" or "z", the axis that points to the upper edge of the map; by default that of the file.

        The other arguments and the result are as in ``texture``.
        """
        lookup = Environment(up=_encode(up))
        numbers = [("angle", angle), *_widths(blur, sblur, tblur, width, swidth, twidth)]
        places = [("r", r), ("drdx", drdx), ("drdy", drdy)]
        return self._look(
            "lookup_environment", texture, lookup, numbers, places, (fill, first_channel, channels, out)
        )

    def shadow(
        self,
        texture: Union[Path, Texture],
        p: Any,
        dpdx: Any = None,
        dpdy: Any = None,
        *,
        blur: Any = None,
        sblur: Any = None,
        tblur: Any = None,
        width: Any = None,
        swidth: Any = None,
        twidth: Any = None,
        samples: int = 16,
        bias: Any = None,
        seed: int = 0,
        out: Any = None,
    ) -> Any:
        """Looks up the shadowed part of many points, from 0 (lit) to 1, in a shadow map.

        p, dpdx, dpdy: positions in world space and their changes, of the shape (*S, 3).
        blur (or sblur, tblur): additional blur, as a fraction of the map.
        samples: the number of samples of each point, 16 to 4096.
        bias: the distance that is added to the depths of the map; 0.01 by default.
        seed: of the random positions of the samples.

        Returns an array of the shape S, or a number for one position.
        """
        lookup = Shadow(samples=samples, seed=seed & 0xFFFFFFFF)
        numbers = [("bias", bias), *_widths(blur, sblur, tblur, width, swidth, twidth)]
        places = [("p", p), ("dpdx", dpdx), ("dpdy", dpdy)]
        return self._look("lookup_shadow", texture, lookup, numbers, places, (None, 0, None, out))

    def texels(
        self,
        texture: Union[Path, Texture],
        level: int = 0,
        x: int = 0,
        y: int = 0,
        width: Optional[int] = None,
        height: Optional[int] = None,
        *,
        fill: float = 0.0,
        first_channel: int = 0,
        channels: Optional[int] = None,
        out: Any = None,
    ) -> Any:
        """Reads a rectangle of texels of a level (0 is the largest), by default all of it.

        Values of 8 and 16 bits are fractions. Returns an array of the shape (height, width, channels).
        """
        found = self.open(texture)
        sizes = found.info.levels
        if not 0 <= level < len(sizes):
            raise TextureArgumentError("level %d, where the texture has 0 to %d" % (level, len(sizes) - 1))
        width = sizes[level][0] - x if width is None else width
        height = sizes[level][1] - y if height is None else height
        if min(x, y, width, height) < 0:
            raise TextureArgumentError("%d x %d texels at (%d, %d) are not inside" % (width, height, x, y))
        native = self._running()
        count = self._channels(found, first_channel, channels)
        memory, value = _arrays.result(out, (height, width, count))
        points = Points(columns=width, rows=height, channels=count, first_channel=first_channel)
        points.data = memory.address
        points.row_step, points.step, points.component_step = memory.strides
        one = _arrays.floats(float(fill), "fill")
        points.fill.data = one.address
        own = native.library
        if width and height:
            arguments = (native.pointer, found._handle, level, x, y, byref(points))
            self._made(native, lambda: own.check(own.texels(*arguments)))
        return value

    def statistics(self) -> Dict[str, int]:
        """Returns the counts of the system by name: "lookups", "tiles_read", "peak_bytes", "files" and others."""
        native = self._running()
        return dict(json.loads(native.library.text(native.library.statistics_json(native.pointer)) or "{}"))

    def statistics_text(self) -> str:
        """Returns the counts of the system as lines of text."""
        native = self._running()
        return native.library.text(native.library.statistics_text(native.pointer)) or ""

    def invalidate(self, name: Union[Path, Texture, None] = None) -> None:
        """Reads a texture, by default every one, again when it is used next, because its file has changed. Waits until
        lookups that run in other threads are done.
        """
        native = self._running()
        text = name.name if isinstance(name, Texture) else None if name is None else os.fspath(name)
        native.library.check(native.library.invalidate(native.pointer, _encode(text)))
        for texture in [self._textures.get(text)] if text is not None else list(self._textures.values()):
            if texture is not None:
                texture._info = None

    def close(self) -> None:
        """Releases the memory, once calls that run in other threads are done. Later calls raise ``TextureError``."""
        self._native = None

    def __enter__(self) -> "TextureSystem":
        return self

    def __exit__(
        self,
        kind: Optional[Type[BaseException]],
        error: Optional[BaseException],
        trace: Optional[TracebackType],
    ) -> None:
        self.close()

    @staticmethod
    def _channels(texture: Texture, first: int, channels: Optional[int]) -> int:
        """Returns the number of channels of a call."""
        if first < 0 or first >= 2**31:
            raise TextureArgumentError("first_channel is 0 or more, not %d" % first)
        count = max(1, texture.info.channels - first) if channels is None else channels
        if not 1 <= count <= 4096:
            raise TextureArgumentError("channels is 1 to 4096, not %d" % count)
        return count

    def _made(self, native: _Native, run: Callable[[], None]) -> None:
        """Makes calls of the library, and passes on their messages."""
        try:
            run()
        finally:
            self._tell(native)

    def _look(
        self,
        function: str,
        texture: Union[Path, Texture],
        lookup: Any,
        numbers: List[Tuple[str, Any]],
        places: List[Tuple[str, Any]],
        options: Tuple[Any, int, Optional[int], Any],
    ) -> Any:
        """Looks up points. ``numbers`` and ``places`` are the arguments for the fields of ``lookup``."""
        fill, first_channel, channels, out = options
        native, found = self._running(), self.open(texture)
        points = Points(first_channel=first_channel)
        given = [("fill", fill, points.fill, False)]
        given += [(name, value, getattr(lookup, name), False) for name, value in numbers]
        given += [(name, value, getattr(lookup, name), True) for name, value in places]
        parts, shapes, is_plain = [], [], True
        for name, value, field, axis in given:
            if value is None:
                if name in ("s", "t", "p", "r"):
                    raise TextureArgumentError("%s is not given" % name)
                continue
            own = _arrays.vectors(value, name) if axis else _arrays.floats(value, name)
            is_plain = is_plain and (isinstance(value, (int, float)) or (axis and isinstance(value, (list, tuple))))
            parts.append(Part(field, own, axis))
            shapes.append((name, own.shape[:-1] if axis else own.shape))
        shape = _arrays.common_shape(shapes)
        is_shadow = function == "lookup_shadow"
        points.channels = 1 if is_shadow else self._channels(found, first_channel, channels)
        memory, value = _arrays.result(out, shape if is_shadow else (*shape, points.channels))
        parts.append(Part(points, memory, not is_shadow))
        run = getattr(native.library, function)

        def call() -> None:
            native.library.check(run(native.pointer, found._handle, byref(points), byref(lookup)))

        self._made(native, lambda: _arrays.run(points, parts, shape, call))
        if shape == () and is_plain and out is None:
            return float(value[0] if hasattr(value, "format") else value) if is_shadow else tuple(map(float, value))
        return value


def _widths(blur: Any, sblur: Any, tblur: Any, width: Any, swidth: Any, twidth: Any) -> List[Tuple[str, Any]]:
    """Returns the arguments of blurs and widths. "blur" and "width" stand for both directions."""
    return [
        ("sblur", blur if sblur is None else sblur),
        ("tblur", blur if tblur is None else tblur),
        ("swidth", width if swidth is None else swidth),
        ("twidth", width if twidth is None else twidth),
    ]
