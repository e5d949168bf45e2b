"""Calls as frames between the renderer and Python.

A frame has one byte for its kind, four bytes for the length, and the payload. Numbers are little endian. Both sides use
frames: the package, which starts a renderer, and the renderer, which starts Python for scene files that are scripts.
"""

import array
import numbers
import re
import struct
import sys
from typing import Any, Iterator, List, Optional, Tuple

try:
    from ._errors import GelatoArgumentError
except ImportError:
    # The class is part of the same program.
    pass

_SWAP = sys.byteorder == "big"

# The largest payload of a frame in bytes.
LONGEST = (1 << 32) - 1

# The pieces of an encoded value, which are objects of bytes, and the shape of a sequence.
Pieces = List[Any]
Shape = Tuple[int, ...]


def text(s: str) -> bytes:
    """Returns the bytes of a string, after its length."""
    data = s.encode("utf-8", "surrogateescape")
    return struct.pack("<I", len(data)) + data


def send(sink: Any, kind: bytes, payload: Any = b"") -> None:
    """Writes one frame. The payload is an object of bytes, or a list of them."""
    parts = payload if isinstance(payload, list) else [payload]
    sink.write(kind + struct.pack("<I", sum(map(len, parts))))
    for part in parts:
        sink.write(part)


def receive(source: Any) -> Optional[Tuple[bytes, bytes]]:
    """Reads one frame. Returns its kind and payload, or None at the end."""
    head = source.read(5)
    if len(head) < 5:
        return None
    kind, length = head[:1], struct.unpack("<I", head[1:])[0]
    payload = source.read(length)
    return None if len(payload) < length else (kind, payload)


def _packed(code: bytes, data: Any) -> Pieces:
    """Returns the pieces of an array of 32 bits."""
    if _SWAP:
        data = data[:]
        data.byteswap()
    return [code + struct.pack("<I", len(data)), memoryview(data).cast("B")]


def _numbers(values: Any) -> Pieces:
    """Encodes a flat sequence of numbers, as integers if all of them are, else as floats."""
    try:
        return _packed(b"I", array.array("i", values))
    except (TypeError, OverflowError):
        return _packed(b"F", array.array("f", values))


def _numpy(numpy: Any, value: Any) -> Optional[Pieces]:
    """Encodes an array of numpy. Returns its pieces, or None for an array that does not hold numbers."""
    kind = value.dtype.kind
    if kind not in "fiub":
        return None
    floats = kind == "f"
    if kind in "iu" and value.dtype.itemsize >= 4 and value.dtype != numpy.int32 and value.size:
        # Integers beyond 32 bits become floats.
        floats = int(value.max()) > 0x7FFFFFFF or int(value.min()) < -0x80000000
    with numpy.errstate(over="ignore"):
        data = numpy.ascontiguousarray(value, dtype="<f4" if floats else "<i4")
    head = (b"F" if floats else b"I") + struct.pack("<I", data.size)
    return [head, memoryview(data.reshape(-1).view("u1"))]


def _view(view: Any) -> Optional[Pieces]:
    """Encodes a buffer. Returns its pieces, or None for a buffer that does not hold numbers."""
    order, code = (view.format[0], view.format[1:]) if view.format[0] in "@=<>!" else ("@", view.format)
    if code not in ("b", "B", "h", "H", "i", "I", "l", "L", "q", "Q", "f", "d"):
        return None
    if code not in "fd":
        sizes = {array.array(c).itemsize: c for c in ("bhilq" if code.islower() else "BHILQ")}
        code = sizes[view.itemsize]
    swapped = order in ">!" if not _SWAP else order == "<"
    if view.itemsize == 4 and code not in "IL" and not swapped and not _SWAP and view.c_contiguous:
        data = view if order == "@" else memoryview(view.tobytes())
        head = (b"F" if code == "f" else b"I") + struct.pack("<I", view.nbytes // 4)
        return [head, data.cast("B")]
    data = array.array(code)
    data.frombytes(view.tobytes())
    if swapped:
        data.byteswap()
    if code in "fd":
        return _packed(b"F", data if code == "f" else array.array("f", data))
    return _numbers(data)


def _array(value: Any) -> Optional[Tuple[Pieces, Shape]]:
    """Encodes an array: one of numpy, or an object with a buffer. Returns its pieces and its shape, or None."""
    numpy: Any = sys.modules.get("numpy")
    if numpy is None and hasattr(value, "__array__"):
        try:
            import numpy
        except ImportError:
            pass
    try:
        if numpy is None:
            view: Any = memoryview(value)
            shape, pieces = view.shape, _view(view)
        else:
            if not hasattr(value, "__array__"):
                value = memoryview(value)
            whole = numpy.asarray(value)
            shape, pieces = whole.shape, _numpy(numpy, whole)
    except (TypeError, ValueError, BufferError, NotImplementedError):
        return None
    return None if pieces is None else (pieces, shape)


def _leaves(value: Any, depth: int = 0) -> Iterator[Any]:
    if depth > 64:
        raise TypeError("sequences nested too deep")
    for item in value:
        if isinstance(item, (str, bytes)) or not hasattr(item, "__iter__"):
            yield item
        else:
            yield from _leaves(item, depth + 1)


def _sequence(value: Any) -> Tuple[Pieces, Shape]:
    """Encodes any other sequence. Returns its pieces and its shape."""
    flat = value if isinstance(value, (list, tuple, range)) else list(value)
    try:
        pieces = _numbers(flat)
    except TypeError:
        flat = list(_leaves(flat))
        if any(isinstance(item, (str, bytes)) for item in flat):
            words = [w.decode("utf-8", "replace") if isinstance(w, bytes) else w for w in flat]
            if not all(isinstance(w, str) for w in words):
                raise TypeError("a sequence mixes strings and numbers") from None
            pieces = [b"S" + struct.pack("<I", len(words)) + b"".join(map(text, words))]
        else:
            pieces = _numbers(flat)
    return pieces, (len(flat),)


def pieces_of(value: Any) -> Tuple[Pieces, Optional[Shape]]:
    """Encodes one argument of a call. Returns its pieces, and the shape of a sequence or None for a single value."""
    if value is None:
        return [b"N"], None
    if isinstance(value, str):
        return [b"s" + text(value)], None
    if isinstance(value, bytes):
        return [b"s" + text(value.decode("utf-8", "surrogateescape"))], None
    if isinstance(value, numbers.Integral):
        value = int(value)
        if -(1 << 63) <= value < 1 << 63:
            return [b"i" + struct.pack("<q", value)], None
        return [b"f" + struct.pack("<d", float(value))], None
    if isinstance(value, numbers.Real):
        return [b"f" + struct.pack("<d", float(value))], None
    if not isinstance(value, (list, tuple, range)):
        packed = _array(value)
        if packed is not None and packed[1] == () and hasattr(value, "item"):
            return pieces_of(value.item())
        if packed is not None:
            return packed[0], packed[1]
    if hasattr(value, "tolist"):
        value = value.tolist()
    if hasattr(value, "__iter__") or hasattr(value, "__getitem__"):
        return _sequence(value)
    if hasattr(value, "__index__"):
        return pieces_of(value.__index__())
    if hasattr(value, "__float__"):
        return pieces_of(float(value))
    raise TypeError("cannot pass a value of type %s to the renderer" % type(value).__name__)


def encode(value: Any) -> bytes:
    """Encodes one argument of a call."""
    return b"".join(pieces_of(value)[0])


def decode(data: bytes) -> Any:
    """Returns the value of an attribute. Sequences become tuples."""
    kind, rest = data[:1], data[1:]
    if kind == b"i":
        return struct.unpack("<q", rest)[0]
    if kind == b"f":
        return struct.unpack("<d", rest)[0]
    if kind == b"s":
        return rest[4:].decode("utf-8")
    if kind in (b"I", b"F"):
        values = array.array("i" if kind == b"I" else "f", rest[4:])
        if _SWAP:
            values.byteswap()
        return tuple(values)
    if kind == b"S":
        words: List[str] = []
        at = 4
        while at < len(rest):
            length = struct.unpack_from("<I", rest, at)[0]
            words.append(rest[at + 4 : at + 4 + length].decode("utf-8"))
            at += 4 + length
        return tuple(words)
    return None


# The number of components of each type.
_COMPONENTS = {
    "float": 1, "int": 1, "string": 1, "color": 3, "point": 3, "vector": 3, "normal": 3, "hpoint": 4, "matrix": 16,
}  # fmt: skip

_DECLARATION = re.compile(
    r"\s*(?:(constant|perpiece|linear|vertex)\s+)?(%s)\s*(?:\[\s*(\d+)\s*\])?\s+(\S+)\s*$" % "|".join(_COMPONENTS)
)


def _shown(sides: List[Any]) -> str:
    """Describes a shape as Python does."""
    return "(%s)" % (", ".join(map(str, sides)) + ("," if len(sides) == 1 else ""))


def _check(name: str, declaration: str, shape: Shape) -> None:
    """Raises an error when an array of this shape cannot be the value of a declared parameter."""
    match = _DECLARATION.match(declaration)
    total = 1
    for side in shape:
        total *= side
    if match is None or total == 1:
        return
    components, length = _COMPONENTS[match.group(2)], int(match.group(3) or 0)
    parts = components * max(length, 1)
    # The last sides of an array are those of one value: (n, 3), (n, 4, 4), (height, width, 3).
    inner, at = 1, len(shape)
    while at > 0 and inner < components:
        at -= 1
        inner *= shape[at]
    if total % parts == 0 and (len(shape) < 2 or components == 1 or inner in (components, parts)):
        return
    expected: List[Any] = [length] if length else []
    expected += [components] if components > 1 else []
    if match.group(1) not in (None, "constant"):
        expected.insert(0, "n")
    given = "%d numbers" % total if len(shape) < 2 else _shown(list(shape))
    raise GelatoArgumentError(
        '%s: "%s" takes the shape %s, not %s' % (name, declaration.strip(), _shown(expected), given),
        name,
        match.group(4),
    )


def call(line: int, name: str, args: Tuple[Any, ...]) -> Pieces:
    """Returns the payload of a call, as a list of pieces."""
    parts = [struct.pack("<I", line) + text(name) + struct.pack("<I", len(args))]
    for index, value in enumerate(args):
        pieces, shape = pieces_of(value)
        if shape is not None and index > 0 and isinstance(args[index - 1], str):
            _check(name, args[index - 1], shape)
        parts.extend(pieces)
    if sum(map(len, parts)) > LONGEST:
        raise GelatoArgumentError("%s: the call has more than 4 GiB of data" % name, name)
    return parts
