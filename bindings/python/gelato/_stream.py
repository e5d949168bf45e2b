"""Calls as frames between the renderer and Python.

A frame has one byte for its kind, four bytes for the length, and the payload. Numbers are little endian. Both sides use
frames: the package, which starts a renderer, and the renderer, which starts Python for scene files that are scripts.
"""

import array
import numbers
import struct
import sys

_SWAP = sys.byteorder == "big"


def text(s):
    """Returns the bytes of a string, after its length."""
    data = s.encode("utf-8", "surrogateescape")
    return struct.pack("<I", len(data)) + data


def send(sink, kind, payload=b""):
    """Writes one frame."""
    sink.write(kind + struct.pack("<I", len(payload)))
    sink.write(payload)


def receive(source):
    """Reads one frame. Returns its kind and payload, or None at the end."""
    head = source.read(5)
    if len(head) < 5:
        return None
    kind, length = head[:1], struct.unpack("<I", head[1:])[0]
    payload = source.read(length)
    return None if len(payload) < length else (kind, payload)


def _packed(code, data):
    if _SWAP:
        data.byteswap()
    return code + struct.pack("<I", len(data)) + data.tobytes()


def _numbers(values):
    """Encodes a flat array of numbers, as integers if all of them are, else as floats."""
    try:
        return _packed(b"I", array.array("i", values))
    except (TypeError, OverflowError):
        return _packed(b"F", array.array("f", values))


def _buffer(value):
    """Encodes an array (of numpy or of the array module) of any dimensions. Returns None for other values."""
    try:
        view = memoryview(value)
    except TypeError:
        return None
    if view.format not in ("b", "B", "h", "H", "i", "I", "l", "L", "q", "Q", "f", "d"):
        return None
    data = array.array(view.format)
    data.frombytes(view.tobytes())
    if view.format in ("f", "d"):
        return _packed(b"F", data if view.format == "f" else array.array("f", data))
    return _numbers(data)


def _leaves(value, depth=0):
    if depth > 64:
        raise TypeError("sequences nested too deep")
    for item in value:
        if isinstance(item, (str, bytes)) or not hasattr(item, "__iter__"):
            yield item
        else:
            yield from _leaves(item, depth + 1)


def encode(value):
    """Encodes one argument of a call."""
    if value is None:
        return b"N"
    if isinstance(value, str):
        return b"s" + text(value)
    if isinstance(value, bytes):
        return b"s" + text(value.decode("utf-8", "surrogateescape"))
    if isinstance(value, numbers.Integral):
        value = int(value)
        if -(1 << 63) <= value < 1 << 63:
            return b"i" + struct.pack("<q", value)
        return b"f" + struct.pack("<d", float(value))
    if isinstance(value, numbers.Real):
        return b"f" + struct.pack("<d", float(value))
    packed = _buffer(value)
    if packed is not None:
        return packed
    if hasattr(value, "tolist"):
        value = value.tolist()
    if hasattr(value, "__iter__") or hasattr(value, "__getitem__"):
        flat = value if isinstance(value, (list, tuple, range)) else list(value)
        try:
            return _numbers(flat)
        except TypeError:
            flat = list(_leaves(flat))
        if any(isinstance(item, (str, bytes)) for item in flat):
            words = [w.decode("utf-8", "replace") if isinstance(w, bytes) else w for w in flat]
            if not all(isinstance(w, str) for w in words):
                raise TypeError("a sequence mixes strings and numbers")
            return b"S" + struct.pack("<I", len(words)) + b"".join(map(text, words))
        return _numbers(flat)
    if hasattr(value, "__index__"):
        return encode(value.__index__())
    if hasattr(value, "__float__"):
        return encode(float(value))
    raise TypeError("cannot pass a value of type %s to the renderer" % type(value).__name__)


def decode(data):
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
        words, at = [], 4
        while at < len(rest):
            length = struct.unpack_from("<I", rest, at)[0]
            words.append(rest[at + 4 : at + 4 + length].decode("utf-8"))
            at += 4 + length
        return tuple(words)
    return None


def call(line, name, args):
    """Returns the payload of a call."""
    parts = [struct.pack("<I", line), text(name), struct.pack("<I", len(args))]
    parts.extend(map(encode, args))
    return b"".join(parts)
