"""Tests images in Python: those of a frame, those of files, and PNG."""

import os
import struct
import sys
import unittest
import zlib

from support import Scratch, ball, needs_numpy, numpy  # isort: skip

import gelato
from gelato import _images


def floats(image):
    """Returns the values of an image."""
    return memoryview(image._data).cast("f").tolist()


def decoded(data):
    """Returns the width, the height and the rows of a PNG without filters."""
    assert data.startswith(b"\x89PNG\r\n\x1a\n")
    chunks, at = {}, 8
    while at < len(data):
        size, name = struct.unpack(">I4s", data[at : at + 8])
        content = data[at + 8 : at + 8 + size]
        assert zlib.crc32(name + content) == struct.unpack(">I", data[at + 8 + size : at + 12 + size])[0]
        chunks[name] = content
        at += 12 + size
    width, height, bits, kind = struct.unpack(">IIBB", chunks[b"IHDR"][:10])
    count = {0: 1, 2: 3, 4: 2, 6: 4}[kind]
    rows, lines = zlib.decompress(chunks[b"IDAT"]), []
    assert bits == 8 and len(rows) == height * (1 + width * count)
    for row in range(height):
        line = rows[row * (1 + width * count) : (row + 1) * (1 + width * count)]
        assert line[0] == 0
        lines.append([tuple(line[1 + k * count : 1 + (k + 1) * count]) for k in range(width)])
    return width, height, lines


def image_of(channels, values, width=1):
    """Returns an image of such values."""
    spec = _images.ImageSpec.__new__(_images.ImageSpec)
    spec.width, spec.height, spec.channels = width, len(values) // len(channels) // width, tuple(channels)
    return gelato.Image("test", spec, bytearray(struct.pack("<%df" % len(values), *values)))


class Frames(Scratch):
    def test_images_of_a_frame(self):
        with gelato.Renderer("-threads", 1) as r:
            r.Attribute("int[2] resolution", (32, 24))
            r.Output("file.exr", "OpenEXR", "rgba", "camera", "string pixeltype", "float")
            ball(r)
            color, depth, normal = r.render("rgba", "z", "normal N")
            self.assertEqual(r.errors, 0)
        self.assertEqual((color.name, color.shape, color.channels), ("rgba", (24, 32, 4), ("R", "G", "B", "A")))
        self.assertEqual((depth.shape, depth.channels), ((24, 32, 1), ("Z",)))
        self.assertEqual(len(normal.channels), 3)
        self.assertEqual(color.spec.full, (0, 0, 32, 24))
        middle = (12 * 32 + 16) * 4
        self.assertEqual(floats(color)[middle : middle + 4], [0.25, 0.5, 1.0, 1.0])
        self.assertEqual(floats(color)[:4], [0.0] * 4)
        self.assertAlmostEqual(floats(depth)[12 * 32 + 16], 2.0, places=1)
        # The image of Output was written, too, and has the same pixels.
        self.assertEqual(floats(gelato.read_image("file.exr")), floats(color))
        self.assertEqual(os.listdir("."), ["file.exr"])

    def test_pixels_have_a_shape(self):
        image = image_of("ABC", range(12), 2)
        self.assertEqual(image.pixels.shape, (2, 2, 3))
        self.assertEqual(image.pixels.tolist(), [[[0, 1, 2], [3, 4, 5]], [[6, 7, 8], [9, 10, 11]]])
        self.assertEqual((image["B"].shape, image["B"].tolist()), ((2, 2), [[1, 4], [7, 10]]))
        with self.assertRaisesRegex(KeyError, "no channel 'D' \\(known: A, B, C\\)"):
            image["D"]
        if numpy is None:
            self.assertIsInstance(image.pixels, memoryview)
        else:
            self.assertEqual(image.pixels.dtype, numpy.float32)
            self.assertEqual(numpy.asarray(image).shape, (2, 2, 3))
            self.assertEqual(numpy.asarray(image, dtype="f8").sum(), 66)
            image.pixels[0, 0, 0] = 5
            self.assertEqual(floats(image)[0], 5)
            before, sys.modules["numpy"] = sys.modules["numpy"], None
            try:
                plain = image_of("ABC", range(12), 2)
                self.assertEqual((plain.pixels.shape, plain["C"].tolist()), ((2, 2, 3), [[2, 5], [8, 11]]))
                self.assertIsInstance(plain.pixels, memoryview)
            finally:
                sys.modules["numpy"] = before

    def test_a_frame_without_outputs_leaves_no_file(self):
        with gelato.Renderer() as r:
            r.Attribute("int[2] resolution", (8, 6))
            with r.world():
                r.Sphere(1, -1, 1, 360)
            image = r.render()
        self.assertEqual((image.name, image.shape, os.listdir(".")), ("rgba", (6, 8, 4), []))

    def test_cameras_are_chosen(self):
        with gelato.Renderer() as r:
            for name, size in (("wide", (16, 4)), ("high", (4, 16))):
                r.Camera(name, "int[2] resolution", size)
            r.Attribute("int rerender", 1)
            r.World()
            r.Sphere(1, -1, 1, 360)
            self.assertEqual([r.render(camera="high").shape[:2], r.render(camera="wide").shape[:2]], [(16, 4), (4, 16)])
            self.assertEqual(r.render().shape[:2], (4, 16))

    def test_crops_tell_their_place(self):
        with gelato.Renderer("-crop", 0.25, 0.75, 0.5, 1) as r:
            ball(r, (32, 24))
            image = r.render()
        self.assertEqual((image.shape[:2], image.spec.origin, image.spec.full), ((12, 16), (8, 12), (0, 0, 32, 24)))

    def test_data_that_are_not_there(self):
        with gelato.Renderer() as r:
            ball(r)
            with self.assertRaises(gelato.GelatoError) as caught:
                r.render("rgba", "no such data")
            self.assertIn("no such data", str(caught.exception))
        with gelato.Renderer() as r, self.assertRaisesRegex(gelato.GelatoError, "Render before World"):
            r.render()
        with gelato.Renderer("a.pyg") as r, self.assertRaisesRegex(gelato.GelatoError, "renders nothing"):
            r.render()
        with gelato.Renderer() as r, self.assertRaises(TypeError):
            r.render(3)

    def test_scenes_cannot_write_into_other_images(self):
        """Addresses that a scene names are images that were not requested."""
        with gelato.Renderer(on_error="warn") as r:
            r.Output("x", "0x7", "rgba", "camera")
            r.Output("y", "0x0", "rgba", "camera")
            ball(r)
            with self.assertWarnsRegex(gelato.GelatoWarning, "is not an ImageOutput"):
                self.assertEqual(r.render("z").channels, ("Z",))


class Files(Scratch):
    def setUp(self):
        super().setUp()
        with gelato.Renderer() as r:
            r.Output("a.tif", "tiff", "rgba", "camera")
            r.Output("b.exr", "OpenEXR", "rgb", "camera", "string pixeltype", "float")
            ball(r, (20, 12))
            r.Render()
            r.Command("system", "string[4] command", ("maketx", "-o", "c.tx", "a.tif"))

    def test_descriptions(self):
        info = gelato.image_info("a.tif")
        self.assertEqual((info.format, info.width, info.height, info.type), ("tiff", 20, 12, "uint8"))
        self.assertEqual((info.channels, len(info.subimages), len(info.subimages[0])), (("R", "G", "B", "A"), 1, 1))
        self.assertIn("Granita", info.attributes["software"])
        self.assertIn("a.tif tiff, 20 x 12 R,G,B,A uint8", repr(info))
        self.assertEqual(gelato.image_info("b.exr").type, "float")
        levels = gelato.image_info("c.tx").subimages[0]
        self.assertGreater(len(levels), 3)
        self.assertEqual([levels[-1].width, levels[-1].height], [1, 1])
        self.assertTrue(levels[0].tile)

    def test_pixels(self):
        image = gelato.read_image("a.tif")
        self.assertEqual((image.name, image.shape, image.spec.type), ("a.tif", (12, 20, 4), "uint8"))
        middle = (6 * 20 + 10) * 4
        for got, expected in zip(floats(image)[middle : middle + 4], (0.25, 0.5, 1.0, 1.0)):
            self.assertAlmostEqual(got, expected, delta=1 / 255)
        self.assertEqual(gelato.read_image("b.exr").channels, ("R", "G", "B"))
        with gelato.Renderer() as r:
            levels = r.image_info("c.tx").subimages[0]
            for number, level in enumerate(levels):
                self.assertEqual(r.read_image("c.tx", level=number).shape, level.shape)

    def test_files_that_cannot_be_read(self):
        with open("text.tif", "w", encoding="ascii") as f:
            f.write("this is no image")
        with gelato.Renderer() as r:
            for path, text in (("text.tif", "text.tif"), ("absent.exr", "absent.exr"), (".", "")):
                for read in (r.read_image, r.image_info, gelato.image_info):
                    with self.assertRaisesRegex(gelato.GelatoError, text):
                        read(path)
            with self.assertRaisesRegex(gelato.GelatoError, "there is no image 1"):
                r.read_image("a.tif", subimage=1)
            with self.assertRaisesRegex(gelato.GelatoError, "no level 9"):
                r.read_image("a.tif", level=9)
            with self.assertRaises(ValueError):
                r.read_image("a.tif", level=-1)
            # The renderer goes on.
            self.assertEqual(r.image_info("a.tif").width, 20)


class Png(Scratch):
    def test_colours_are_srgb(self):
        nan = float("nan")
        image = image_of("RGB", [0, 0.5, 1, -1, 2, nan, 0.0031308, 0.18, 0.001], 3)
        self.assertEqual(decoded(image.png()), (3, 1, [[(0, 188, 255), (0, 255, 0), (10, 118, 3)]]))
        self.assertEqual(image._repr_png_(), image.png())
        image.save_png("x.png")
        back = gelato.read_image("x.png")
        self.assertEqual((back.channels, back.shape), (("R", "G", "B"), (1, 3, 3)))

    @needs_numpy
    def test_numpy_makes_no_difference(self):
        values = numpy.random.default_rng(7).normal(0.4, 0.6, 3000)
        values[:6] = [float("nan"), float("inf"), -float("inf"), 1e38, 0, 1]
        for channels in ("RGB", "RGBA", "Y", "YA", "ABC"):
            image = image_of(channels, values[: 3000 // len(channels) * len(channels)].tolist())
            with_numpy = image.png()
            before, sys.modules["numpy"] = sys.modules["numpy"], None
            try:
                self.assertEqual(image.png(), with_numpy, channels)
            finally:
                sys.modules["numpy"] = before

    def test_alpha_is_not_multiplied(self):
        image = image_of("RGBA", [0.25, 0.5, 0, 0.5, 0, 0, 0, 0, 0.5, 0.5, 0.5, 1], 3)
        self.assertEqual(decoded(image.png())[2], [[(188, 255, 0, 128), (0, 0, 0, 0), (188, 188, 188, 255)]])

    def test_other_channels(self):
        self.assertEqual(decoded(image_of(["Y"], [0, 0.5, 1], 3).png())[2], [[(0,), (188,), (255,)]])
        self.assertEqual(decoded(image_of(["Z"], [2, 4, 1e38], 3).png())[2], [[(0,), (255,), (255,)]])
        self.assertEqual(decoded(image_of("YA", [0.5, 1], 1).png())[2], [[(188, 255)]])
        self.assertEqual(decoded(image_of(["x", "y", "z", "w"], [0, 1, 0.5, 9]).png())[2], [[(0, 255, 188)]])


class Arrivals(unittest.TestCase):
    """What the renderer sends is checked."""

    def opened(self, number, width, height, channels):
        words = struct.pack("<10I", width, height, 0, 0, 0, 0, width, height, 4, len(channels))
        names = b"".join(struct.pack("<I", len(c)) + c.encode() for c in channels)
        return struct.pack("<I", number) + b"\3\0\0\0" b"0x1" + b"\1\0\0\0" b"n" + words + names

    def test_whole_images(self):
        arriving = _images.Arriving()
        arriving.take(b"O", self.opened(5, 2, 1, "RG"))
        arriving.take(b"S", struct.pack("<I4f", 5, 1, 2, 3, 4))
        self.assertEqual(arriving.done, {})
        arriving.take(b"L", struct.pack("<I", 5))
        self.assertEqual(floats(arriving.done[1]), [1, 2, 3, 4])

    def test_damaged_images(self):
        whole = self.opened(5, 2, 1, "RG")
        for size in range(len(whole)):
            with self.assertRaises(gelato.GelatoError):
                _images.Arriving().take(b"O", whole[:size])
        with self.assertRaisesRegex(gelato.GelatoError, "cannot be received"):
            _images.Arriving().take(b"O", self.opened(5, 0xFFFFFFFF, 0xFFFFFFFF, "RG"))
        arriving = _images.Arriving()
        arriving.take(b"O", whole)
        with self.assertRaises(gelato.GelatoError):
            arriving.take(b"S", struct.pack("<I5f", 5, 1, 2, 3, 4, 5))
        with self.assertRaisesRegex(gelato.GelatoError, "in part"):
            arriving.take(b"L", struct.pack("<I", 5))
        # Frames of images that were not opened are dropped.
        arriving.take(b"S", struct.pack("<I", 9))
        arriving.take(b"L", struct.pack("<I", 9))
        self.assertEqual(arriving.done, {})


if __name__ == "__main__":
    unittest.main()
