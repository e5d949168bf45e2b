"""Images as arrays: the results of frames and of files, and PNG for notebooks."""

import array
import struct
import sys
import zlib
from typing import Any, Dict, List, Optional, Tuple

try:
    from ._errors import GelatoError
    from ._stream import decode
except ImportError:
    # The names are part of the same program.
    pass

# The storage types of pixels, in the order of their numbers in frames.
_TYPES = ("uint8", "uint16", "uint32", "half", "float")

# The steps of the table from linear values to sRGB.
_STEPS = 1 << 14


class Reader:
    """Takes numbers and texts from the front of a payload. Raises GelatoError when it is too short."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self.at = 0

    def take(self, size: int) -> bytes:
        end = self.at + size
        if size < 0 or end > len(self.data):
            raise GelatoError("the renderer sent something unreadable")
        piece, self.at = self.data[self.at : end], end
        return piece

    def words(self, count: int, code: str = "I") -> Tuple[int, ...]:
        return struct.unpack("<%d%s" % (count, code), self.take(4 * count))

    def word(self) -> int:
        return self.words(1)[0]

    def text(self) -> str:
        return self.take(self.word()).decode("utf-8", "replace")

    def value(self) -> Any:
        """Takes a value as it stands in frames."""
        begin, kind = self.at, self.take(1)
        if kind in (b"i", b"f"):
            self.take(8)
        elif kind == b"s":
            self.text()
        elif kind in (b"I", b"F"):
            self.take(4 * self.word())
        elif kind == b"S":
            for _ in range(self.word()):
                self.text()
        elif kind != b"N":
            raise GelatoError("the renderer sent something unreadable")
        return decode(self.data[begin : self.at])


class ImageSpec:
    """The description of an image without its pixels.

    ``width`` and ``height`` are the size in pixels, ``channels`` the names of the channels, and ``type`` the type in
    the file: "uint8", "uint16", "uint32", "half" or "float". ``origin`` is the place (x, y) of the first pixel in the
    whole image, whose rectangle is ``full`` (x, y, width, height). ``tile`` is the size of the tiles, or None.
    ``attributes`` maps further names to their values.
    """

    def __init__(self, reader: Reader, tile: Tuple[int, ...] = (0, 0)) -> None:
        self.width, self.height = reader.words(2)
        x, y, full_x, full_y = reader.words(4, "i")
        full_width, full_height, kind, count = reader.words(4)
        self.origin = (x, y)
        self.full = (full_x, full_y, full_width, full_height)
        self.tile: Optional[Tuple[int, ...]] = tuple(tile) if any(tile) else None
        if kind >= len(_TYPES) or count > len(reader.data):
            raise GelatoError("the renderer sent something unreadable")
        self.type = _TYPES[kind]
        self.channels = tuple(reader.text() for _ in range(count))
        self.attributes: Dict[str, Any] = {}
        while reader.at < len(reader.data):
            name = reader.text().split()[-1]
            self.attributes[name] = reader.value()

    @property
    def shape(self) -> Tuple[int, int, int]:
        """The height, the width and the number of channels."""
        return (self.height, self.width, len(self.channels))

    def __repr__(self) -> str:
        return "<gelato.%s %d x %d %s %s>" % (
            type(self).__name__, self.width, self.height, ",".join(self.channels), self.type,
        )  # fmt: skip


class _Described:
    """Has the size and the channels of its ``spec``."""

    spec: ImageSpec

    @property
    def width(self) -> int:
        return self.spec.width

    @property
    def height(self) -> int:
        return self.spec.height

    @property
    def channels(self) -> Tuple[str, ...]:
        return self.spec.channels


class ImageInfo(_Described):
    """The description of an image file.

    ``format`` is the name of its format. ``subimages`` holds a list for each image of the file, with an ``ImageSpec``
    for each of its levels. ``spec`` is the first level of the first image, whose fields the object has, too.
    """

    def __init__(self, path: str, reader: Reader) -> None:
        self.path = path
        self.format = reader.text()
        self.subimages: List[List[ImageSpec]] = []
        for _ in range(reader.word()):
            levels = []
            for _ in range(reader.word()):
                level = Reader(reader.take(reader.word()))
                levels.append(ImageSpec(level, level.words(2)[:2]))
            self.subimages.append(levels)
        if not self.subimages or not self.subimages[0]:
            raise GelatoError("%s holds no image" % path)
        self.spec = self.subimages[0][0]

    @property
    def type(self) -> str:
        return self.spec.type

    @property
    def attributes(self) -> Dict[str, Any]:
        return self.spec.attributes

    def __repr__(self) -> str:
        levels = [len(levels) for levels in self.subimages]
        return "<gelato.ImageInfo %s %s, %d x %d %s %s, levels %s>" % (
            self.path, self.format, self.width, self.height, ",".join(self.channels), self.type, levels,
        )  # fmt: skip


class Image(_Described):
    """An image in memory.

    ``pixels`` has the shape height x width x channels and the type float32. It is an array of numpy when numpy is
    installed, else a memoryview. ``channels`` holds the names of the channels, ``name`` the data or the file that the
    image shows, and ``spec`` everything else. ``image["Z"]`` is one channel. Notebooks show the image.
    """

    def __init__(self, name: str, spec: ImageSpec, data: bytearray) -> None:
        self.name = name
        self.spec = spec
        self._data = data
        self._pixels: Any = None

    @property
    def shape(self) -> Tuple[int, int, int]:
        """The height, the width and the number of channels."""
        return self.spec.shape

    @property
    def pixels(self) -> Any:
        """The pixels, height x width x channels, float32."""
        if self._pixels is None:
            try:
                import numpy
            except ImportError:
                self._pixels = memoryview(self._data).cast("f", self.shape)
            else:
                self._pixels = numpy.frombuffer(self._data, dtype="f4").reshape(self.shape)
        return self._pixels

    def __array__(self, dtype: Any = None, copy: Optional[bool] = None) -> Any:
        import numpy

        whole = numpy.frombuffer(self._data, dtype="f4").reshape(self.shape)
        if dtype is not None and whole.dtype != dtype:
            if copy is False:
                raise ValueError("an image of float32 has no other type without a copy")
            return whole.astype(dtype)
        return whole.copy() if copy else whole

    def __getitem__(self, channel: str) -> Any:
        """Returns one channel by its name, height x width."""
        if channel not in self.channels:
            raise KeyError("there is no channel %r (known: %s)" % (channel, ", ".join(self.channels)))
        index = self.channels.index(channel)
        if not isinstance(self.pixels, memoryview):
            return self.pixels[:, :, index]
        plane = array.array("f", memoryview(self._data).cast("f")[index :: len(self.channels)])
        return memoryview(plane).cast("B").cast("f", self.shape[:2])

    def __repr__(self) -> str:
        return "<gelato.Image %s, %d x %d %s>" % (self.name, self.width, self.height, ",".join(self.channels))

    def png(self) -> bytes:
        """Returns the image as PNG, 8 bits in sRGB.

        Colours are the channels R, G and B, or the first three. Alpha is the channel A. An image of one or two
        channels shows the first as grey. Depths and other values beyond 0 to 1 in it are stretched from the lowest to
        the highest one.
        """
        flat: Any = memoryview(self._data).cast("f")
        count = len(self.channels)
        upper = [name.upper() for name in self.channels]
        alpha = upper.index("A") if "A" in upper else None
        if all(name in upper for name in "RGB"):
            shown = [upper.index(name) for name in "RGB"]
        else:
            others = [index for index in range(count) if index != alpha] or [0]
            shown = others[:3] if len(others) >= 3 else others[:1]
        try:
            import numpy
        except ImportError:
            planes = [flat[index::count].tolist() for index in shown]
            cover = None if alpha is None else flat[alpha::count].tolist()
            return _png(self.width, self.height, _codes(planes, cover))
        whole = numpy.frombuffer(self._data, dtype="f4").reshape(-1, count).astype("f8")
        covers = None if alpha is None else whole[:, alpha]
        return _png(self.width, self.height, _numpy_codes(numpy, [whole[:, index] for index in shown], covers))

    def save_png(self, path: str) -> None:
        """Writes the image as PNG (see ``png``). Other formats are written by the renderer (``Output``)."""
        data = self.png()
        with open(path, "wb") as file:
            file.write(data)

    def _repr_png_(self) -> bytes:
        return self.png()


def _codes(planes: "List[List[float]]", alpha: "Optional[List[float]]") -> "List[bytes]":
    """Returns planes of bytes for those of colours and alpha."""
    table = _srgb()
    if alpha is None:
        planes = [_stretched(planes[0])] if len(planes) == 1 else planes
        return [bytes(_code(table, value) for value in plane) for plane in planes]
    cover = [0.0 if not value > 0.0 else min(value, 1.0) for value in alpha]
    # The colours of the renderer are multiplied by alpha, and those of PNG are not.
    rows = [bytes(_code(table, v / a if a else v) for v, a in zip(plane, cover)) for plane in planes]
    return rows + [bytes(int(a * 255.0 + 0.5) for a in cover)]


def _numpy_codes(numpy: Any, planes: "List[Any]", alpha: Any) -> "List[bytes]":
    """Does the same as ``_codes`` with arrays."""
    with numpy.errstate(all="ignore"):
        last: List[bytes] = []
        if alpha is None:
            planes = [numpy.array(_stretched(planes[0].tolist()))] if len(planes) == 1 else planes
        else:
            cover = numpy.where(alpha > 0.0, numpy.minimum(alpha, 1.0), 0.0)
            planes = [numpy.where(cover > 0.0, plane / cover, plane) for plane in planes]
            last = [(cover * 255.0 + 0.5).astype("u1").tobytes()]
        table = numpy.frombuffer(_srgb(), dtype="u1")
        steps = [numpy.where(plane > 0.0, numpy.minimum(plane, 1.0), 0.0) * (_STEPS - 1) + 0.5 for plane in planes]
        return [table[step.astype("i4")].tobytes() for step in steps] + last


def _stretched(plane: "List[float]") -> "List[float]":
    """Returns values from 0 to 1. Values that are not finite, and those of empty depths, become 1."""
    finite = [value for value in plane if abs(value) < 1e30]
    low, high = min(finite, default=0.0), max(finite, default=1.0)
    if low >= 0.0 and high <= 1.0 and len(finite) == len(plane):
        return plane
    scale = 1.0 / (high - low) if high > low else 0.0
    return [(value - low) * scale if abs(value) < 1e30 else 1.0 for value in plane]


_tables: "Dict[str, bytes]" = {}


def _srgb() -> bytes:
    """Returns the codes of sRGB for linear values from 0 to 1."""
    if "srgb" not in _tables:
        values = (step / (_STEPS - 1) for step in range(_STEPS))
        codes = (12.92 * v if v <= 0.0031308 else 1.055 * v ** (1.0 / 2.4) - 0.055 for v in values)
        _tables["srgb"] = bytes(int(255.0 * code + 0.5) for code in codes)
    return _tables["srgb"]


def _code(table: bytes, value: float) -> int:
    if not value > 0.0:
        return 0
    return table[int(value * (_STEPS - 1) + 0.5)] if value < 1.0 else 255


def _png(width: int, height: int, planes: "List[bytes]") -> bytes:
    """Returns a PNG of planes of bytes: grey, or red, green and blue, and then alpha."""
    count = len(planes)
    mixed = bytearray(width * height * count)
    for index, plane in enumerate(planes):
        mixed[index::count] = plane
    # Each row begins with its filter, 0 for none.
    lines = b"".join(
        b"\0" + mixed[row * width * count : (row + 1) * width * count] for row in range(height)
    )
    kind = {1: 0, 2: 4, 3: 2, 4: 6}[count]

    def chunk(name: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))

    head = struct.pack(">IIBBBBB", width, height, 8, kind, 0, 0, 0)
    pieces = [b"\x89PNG\r\n\x1a\n", chunk(b"IHDR", head), chunk(b"sRGB", b"\0")]
    return b"".join(pieces + [chunk(b"IDAT", zlib.compress(lines, 6)), chunk(b"IEND", b"")])


class Arriving:
    """Collects the images that a renderer sends."""

    def __init__(self) -> None:
        self._open: Dict[int, Tuple[int, str, ImageSpec, bytearray, int]] = {}
        # The finished images by their address.
        self.done: Dict[int, Image] = {}

    def take(self, kind: bytes, payload: bytes) -> None:
        """Takes a frame: O opens an image, S holds its next rows, L closes it."""
        reader = Reader(payload)
        number = reader.word()
        if kind == b"O":
            address, name = reader.text(), reader.text()
            spec = ImageSpec(reader)
            size = 4 * spec.width * spec.height * len(spec.channels)
            try:
                self._open[number] = (int(address, 16), name, spec, bytearray(size), 0)
            except (ValueError, MemoryError, OverflowError) as error:
                raise GelatoError("an image cannot be received: %s" % error) from None
        elif number in self._open:
            address_, name, spec, data, filled = self._open[number]
            if kind == b"S":
                end = filled + len(payload) - 4
                if end > len(data):
                    raise GelatoError("the renderer sent something unreadable")
                data[filled:end] = memoryview(payload)[4:]
                self._open[number] = (address_, name, spec, data, end)
            else:
                del self._open[number]
                if filled != len(data):
                    raise GelatoError("an image was sent in part")
                if sys.byteorder == "big":
                    swapped = array.array("f", bytes(data))
                    swapped.byteswap()
                    data = bytearray(swapped.tobytes())
                self.done.setdefault(address_, Image(name, spec, data))
