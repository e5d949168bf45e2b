"""Arrays of callers as addresses, shapes and strides, and calls with many points.

Arrays of numpy with elements of the type float32 are used where they are. So are writable buffers of floats that lie
together, such as ``array.array ("f")``. Everything else is converted to such an array. numpy itself is not imported.
"""

import array
import ctypes
import itertools
import sys
from typing import Any, Callable, List, NamedTuple, Optional, Sequence, Tuple

from ._errors import TextureArgumentError

Shape = Tuple[int, ...]

_SIZE = 4
"""The bytes of a float."""


class Array(NamedTuple):
    """Floats of a caller."""

    address: int
    shape: Shape
    strides: Shape
    keep: Any
    """What owns the memory."""


def _numpy() -> Any:
    """Returns numpy, if the program has imported it."""
    return sys.modules.get("numpy")


def _together(shape: Shape) -> Shape:
    """Returns the strides in bytes of floats that lie together."""
    strides, step = [], _SIZE
    for side in reversed(shape):
        strides.append(step)
        step *= side
    return tuple(reversed(strides))


def _of_numpy(value: Any) -> Array:
    data = value.__array_interface__["data"][0]
    return Array(data, value.shape, value.strides, value)


def _is_floats(view: memoryview) -> bool:
    return view.format in ("f", "@f", "=f", "<f" if sys.byteorder == "little" else ">f") and view.itemsize == _SIZE


def _of_buffer(view: memoryview) -> Optional[Array]:
    """Returns a buffer that is used where it is; None for one that must be copied."""
    if not _is_floats(view) or view.readonly or not view.c_contiguous or not view.nbytes:
        return None
    address = ctypes.addressof(ctypes.c_char.from_buffer(view.cast("B")))
    return Array(address, view.shape, view.strides, view)


def _nested(value: Any, name: str, flat: "array.array[float]") -> Shape:
    """Appends the numbers of nested sequences, and returns their shape."""
    if isinstance(value, memoryview):
        value = value.tolist()
    if not isinstance(value, (list, tuple, range, array.array)):
        try:
            flat.append(float(value))
        except (TypeError, ValueError):
            raise TextureArgumentError("%s takes numbers, not %r" % (name, value)) from None
        return ()
    shapes = {_nested(item, name, flat) for item in value}
    if len(shapes) > 1:
        raise TextureArgumentError("%s has rows of different lengths" % name)
    return (len(value), *(shapes.pop() if shapes else ()))


def floats(value: Any, name: str) -> Array:
    """Returns the floats of a value: a number, an array, a buffer or nested sequences."""
    if isinstance(value, (int, float)):
        one = ctypes.c_float(value)
        return Array(ctypes.addressof(one), (), (), one)
    numpy = _numpy()
    if numpy is not None:
        try:
            return _of_numpy(numpy.asarray(value, dtype=numpy.float32))
        except (TypeError, ValueError) as error:
            raise TextureArgumentError("%s takes numbers: %s" % (name, error)) from None
    try:
        view = memoryview(value)
    except TypeError:
        view = None
    found = None if view is None else _of_buffer(view)
    if found is not None:
        return found
    flat = array.array("f")
    shape = _nested(value if view is None else view, name, flat)
    if not flat:
        return Array(0, shape, _together(shape), flat)
    return Array(flat.buffer_info()[0], shape, _together(shape), flat)


def vectors(value: Any, name: str) -> Array:
    """Returns the vectors of a value, whose last axis has three numbers."""
    found = floats(value, name)
    if not found.shape or found.shape[-1] != 3:
        raise TextureArgumentError("%s takes the shape (..., 3), not %s" % (name, found.shape))
    return found


def result(value: Any, shape: Shape) -> Tuple[Array, Any]:
    """Returns the memory of results of a shape, and the value that the caller receives. ``value`` is the argument
    ``out``.
    """
    if value is None:
        numpy = _numpy()
        if numpy is not None:
            made = numpy.empty(shape, numpy.float32)
            return _of_numpy(made), made
        count = 1
        for side in shape:
            count *= side
        flat = array.array("f", bytes(_SIZE * count))
        if not count:
            return Array(0, shape, _together(shape), flat), flat
        # A buffer without sides is a number.
        view = memoryview(flat).cast("B").cast("f", shape) if shape else memoryview(flat)
        return Array(flat.buffer_info()[0], shape, _together(shape), flat), view
    if hasattr(value, "__array_interface__"):
        if value.dtype.str[1:] != "f4" or not value.dtype.isnative:
            raise TextureArgumentError("out has elements of the type %s, not float32" % value.dtype)
        if not value.flags.writeable:
            raise TextureArgumentError("out is read-only")
        found = _of_numpy(value)
    else:
        try:
            view = memoryview(value)
        except TypeError:
            raise TextureArgumentError("out is not an array of floats") from None
        if not _is_floats(view) or view.readonly or not view.c_contiguous:
            raise TextureArgumentError("out is not a writable buffer of floats that lie together")
        # A flat buffer has room for any shape of its length.
        count = 1
        for side in shape:
            count *= side
        if view.ndim == 1 and view.shape[0] == count:
            view = view.cast("B").cast("f", shape) if shape and count else view
            address = ctypes.addressof(ctypes.c_char.from_buffer(view.cast("B"))) if count else 0
            return Array(address, shape, _together(shape), view), value
        buffer = _of_buffer(view)
        found = Array(0, view.shape, view.strides or (), view) if buffer is None else buffer
    if tuple(found.shape) != shape:
        raise TextureArgumentError("out has the shape %s, and results have %s" % (tuple(found.shape), shape))
    return found, value


def common_shape(shapes: Sequence[Tuple[str, Shape]]) -> Shape:
    """Returns the shape that all shapes are broadcast to, as numpy does it."""
    sides: List[int] = []
    for name, shape in shapes:
        for back, side in enumerate(reversed(shape)):
            if back == len(sides):
                sides.append(side)
            elif sides[back] == 1:
                sides[back] = side
            elif side not in (1, sides[back]):
                told = ", ".join("%s %s" % (name, tuple(shape)) for name, shape in shapes)
                raise TextureArgumentError("the shapes of the points do not fit: %s" % told)
    return tuple(reversed(sides))


def _broadcast(shape: Shape, own: Shape, strides: Shape) -> Shape:
    """Returns the strides with which an array has a shape. A repeated number has the stride 0."""
    more = len(shape) - len(own)
    return (0,) * more + tuple(0 if side == 1 else step for side, step in zip(own, strides))


class Part(NamedTuple):
    """An array of a call: the struct that is filled, and the array."""

    field: Any
    array: Array
    axis: bool
    """True when the last axis is that of components or channels."""


def run(points: Any, parts: Sequence[Part], shape: Shape, call: Callable[[], None]) -> None:
    """Makes one call of the library for the points of a shape, or several where two strides do not describe it."""
    if 0 in shape:
        return
    all_strides = []
    for part in parts:
        own, strides = part.array.shape, part.array.strides
        if part.axis:
            part.field.component_step = strides[-1]
            own, strides = own[:-1], strides[:-1]
        all_strides.append(_broadcast(shape, own, strides))
    # Axes that lie together are one axis.
    axes: List[Tuple[int, List[int]]] = []
    for i, side in enumerate(shape):
        steps = [strides[i] for strides in all_strides]
        if side == 1:
            continue
        if axes and all(outer == inner * side for outer, inner in zip(axes[-1][1], steps)):
            axes[-1] = (axes[-1][0] * side, steps)
        else:
            axes.append((side, steps))
    none = [0] * len(parts)
    columns, steps = axes.pop() if axes else (1, none)
    rows, row_steps = axes.pop() if axes else (1, none)
    points.columns, points.rows = columns, rows
    for part, step, row_step in zip(parts, steps, row_steps):
        part.field.step, part.field.row_step = step, row_step
    for place in itertools.product(*(range(side) for side, _ in axes)):
        for i, part in enumerate(parts):
            moved = sum(at * axis[1][i] for at, axis in zip(place, axes))
            part.field.data = part.array.address + moved
        call()
