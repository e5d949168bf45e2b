"""Tests arrays as values of parameters: their types, their shapes, and that large ones are not copied in a loop."""

import array
import ctypes
import struct
import unittest

from support import Scratch, Unseen, needs_numpy, numpy  # isort: skip

import gelato
from gelato import _stream


def values(value):
    """Returns the code and the numbers of an encoded value."""
    data = _stream.encode(value)
    return data[:1], list(struct.unpack("<%d%s" % ((len(data) - 5) // 4, "i" if data[:1] == b"I" else "f"), data[5:]))


class Buffers(unittest.TestCase):
    def check_buffers(self):
        floats, ints = [0.5, -2.0, 3.0], [1, -2, 3]
        for code in "fd":
            self.assertEqual(values(array.array(code, floats)), (b"F", floats), code)
        for code in "bhilq":
            self.assertEqual(values(array.array(code, ints)), (b"I", ints), code)
        for code in "BHILQ":
            self.assertEqual(values(array.array(code, [1, 2, 200])), (b"I", [1, 2, 200]), code)
        # Integers beyond 32 bits become floats.
        for code, wide in (("q", -(1 << 40)), ("Q", 1 << 63), ("I", 0xFFFFFFFF)):
            self.assertEqual(values(array.array(code, [wide, 1])), (b"F", [float(wide) if wide >> 32 else 2.0**32, 1]))
        for kind in (ctypes.c_float, ctypes.c_double, ctypes.c_int, ctypes.c_int64, ctypes.c_uint16):
            code = b"F" if kind in (ctypes.c_float, ctypes.c_double) else b"I"
            self.assertEqual(values((kind * 3)(1, 2, 3)), (code, [1, 2, 3]), kind)
        nested = ((ctypes.c_float * 3) * 2)((1, 2, 3), (4, 5, 6))
        self.assertEqual(values(nested), (b"F", [1, 2, 3, 4, 5, 6]))
        self.assertEqual(_stream.pieces_of(nested)[1], (2, 3))
        self.assertEqual(values((ctypes.c_float.__ctype_be__ * 2)(1, 2)), (b"F", [1, 2]))
        # Every other number, and no number.
        self.assertEqual(values(memoryview(array.array("f", floats))[::2]), (b"F", [0.5, 3.0]))
        self.assertEqual(values(array.array("f")), (b"F", []))

    @needs_numpy
    def test_buffers_with_numpy(self):
        self.check_buffers()

    def test_buffers_without_numpy(self):
        with Unseen():
            self.check_buffers()

    def test_large_arrays_are_passed_on_as_they_are(self):
        data = array.array("f", [1.0]) * 99_999
        sent = _stream.call(1, "Parameter", ("vertex point P", data))[-1]
        self.assertIsInstance(sent, memoryview)
        data[0] = 2.0
        self.assertEqual(bytes(sent[:4]), struct.pack("<f", 2.0), "the array was copied")
        if numpy is not None:
            whole = numpy.ones((1000, 3), "f4")
            sent = _stream.call(1, "Parameter", ("vertex point P", whole))[-1]
            self.assertTrue(numpy.shares_memory(numpy.frombuffer(sent, "f4"), whole), "the array was copied")

    @needs_numpy
    def test_types_of_numpy(self):
        kinds = ("float32", "float64", "float16", ">f4", "longdouble", "int8", "uint16", "int32", ">i4", "int64", "bool")
        for kind in kinds:
            whole = numpy.arange(12).astype(kind)
            code = b"F" if whole.dtype.kind == "f" else b"I"
            expected = [1 if k and kind == "bool" else k for k in range(12)]
            self.assertEqual(values(whole), (code, expected), kind)
            turned = whole.reshape(3, 4).T[::-1]
            self.assertEqual(values(turned), (code, [int(k) for k in turned.flatten()]), kind)
        self.assertEqual(values(numpy.array([1 << 40, 1])), (b"F", [float(1 << 40), 1]))
        self.assertEqual(values(numpy.array([0xFFFFFFFF], "u4")), (b"F", [2.0**32]))
        self.assertEqual(values(numpy.array([1e300, -1e300])), (b"F", [float("inf"), float("-inf")]))
        # An array without sides is a number. Texts and objects pass, too.
        self.assertEqual(_stream.encode(numpy.array(0.5)), _stream.encode(0.5))
        self.assertEqual(_stream.encode(numpy.array(["a", "bc"])), _stream.encode(["a", "bc"]))
        self.assertEqual(values(numpy.array([1, 2.5], object)), (b"F", [1, 2.5]))
        self.assertRaises(TypeError, _stream.encode, numpy.array([1j]))


class Shapes(Scratch):
    def refused(self, value, declaration):
        with self.assertRaises(gelato.GelatoArgumentError) as caught:
            _stream.call(1, "Mesh", ("linear", [3], [0, 1, 2], declaration, value))
        self.assertEqual((caught.exception.call, caught.exception.parameter), ("Mesh", declaration.split()[-1]))
        return str(caught.exception)

    def test_flat_sequences(self):
        self.assertEqual(
            self.refused([1, 2, 3, 4], "vertex point P"),
            'Mesh: "vertex point P" takes the shape (n, 3), not 4 numbers',
        )
        self.assertEqual(self.refused([1, 2], "color C"), 'Mesh: "color C" takes the shape (3,), not 2 numbers')
        self.assertEqual(
            self.refused((1, 2, 3), "linear float[2] st"),
            'Mesh: "linear float[2] st" takes the shape (n, 2), not 3 numbers',
        )
        self.assertEqual(
            self.refused([1] * 12, "constant matrix m"),
            'Mesh: "constant matrix m" takes the shape (16,), not 12 numbers',
        )
        self.assertEqual(
            self.refused([1] * 9, "vertex point[2] x"),
            'Mesh: "vertex point[2] x" takes the shape (n, 2, 3), not 9 numbers',
        )

    def test_shapes_of_buffers(self):
        def shaped(*shape):
            count = 1
            for side in shape:
                count *= side
            return memoryview(array.array("f", [0.0] * count)).cast("B").cast("f", shape)

        for declaration, shape in (
            ("vertex point P", (5, 3)), ("vertex point P", (2, 5, 3)), ("vertex hpoint Pw", (5, 4)),
            ("vertex matrix m", (5, 4, 4)), ("vertex matrix m", (5, 16)), ("matrix m", (4, 4)), ("color C", (3, 1)),
            ("vertex point[4] x", (5, 4, 3)), ("vertex point[4] x", (5, 12)), ("vertex float f", (5, 7)),
            ("linear float[2] st", (5, 2)), ("P", (3, 5)), ("vertex unknown P", (3, 5)),
        ):  # fmt: skip
            _stream.call(1, "Mesh", ("linear", [3], [0, 1, 2], declaration, shaped(*shape)))
        for declaration, shape, text in (
            ("vertex point P", (3, 5), "takes the shape (n, 3), not (3, 5)"),
            ("vertex hpoint Pw", (4, 3), "takes the shape (n, 4), not (4, 3)"),
            ("vertex matrix m", (4, 4, 2), "takes the shape (n, 16), not (4, 4, 2)"),
            ("vertex point[4] x", (5, 6), "takes the shape (n, 4, 3), not (5, 6)"),
        ):
            self.assertIn(text, self.refused(shaped(*shape), declaration))

    def test_calls_with_wrong_shapes_are_not_made(self):
        with gelato.Renderer("a.pyg") as r:
            with self.assertRaises(ValueError):
                r.Points(1, "vertex point P", (0, 0))
            with self.assertRaises(TypeError):
                r.Parameter("vertex point P", (0, 0))
            with self.assertRaises(gelato.GelatoArgumentError) as caught:
                r.Attribute("color C", (0, 0))
            self.assertEqual(caught.exception.attribute, "C")
            r.Points(1, "vertex point P", (0, 0, 0))
        with open("a.pyg", encoding="ascii") as f:
            self.assertEqual(f.read(), 'Points (1, "vertex point P", (0, 0, 0))\n')

    @needs_numpy
    def test_a_mesh_of_arrays_is_that_of_lists(self):
        side = 30
        x, y = numpy.meshgrid(numpy.linspace(-1, 1, side), numpy.linspace(-1, 1, side))
        points = numpy.stack([x, y, 0.1 * numpy.sin(9 * x)], axis=-1).reshape(-1, 3)
        corner = (numpy.arange(side - 1)[:, None] * side + numpy.arange(side - 1)).reshape(-1, 1)
        verts = corner + [0, 1, side + 1, side]
        nverts = numpy.full(len(verts), 4)

        def listed(a):
            return a.astype("f4" if a.dtype.kind == "f" else "i4").tolist()

        for name, cast in (("arrays.pyg", lambda a: a), ("lists.pyg", listed)):
            with gelato.Renderer(name) as r:
                r.Mesh("linear", cast(nverts), cast(verts), "vertex point P", cast(points))
        with open("arrays.pyg", encoding="ascii") as a, open("lists.pyg", encoding="ascii") as b:
            self.assertEqual(a.read(), b.read())


if __name__ == "__main__":
    unittest.main()
