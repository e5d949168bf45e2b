"""Tests granita.texture. ``cargo test -p granita-tests --test cpp texture`` runs them. ``GELATO`` must name the program, and
``GRANITA_TEXTURE_LIB`` the library. Without it they are skipped. Most of them run with and without numpy.
"""

import array
import ctypes
import os
import subprocess
import sys
import threading
import unittest
import warnings

from support import PACKAGE, Scratch, Unseen, needs_numpy, numpy, run_examples  # isort: skip

from granita import texture
from granita.texture import TextureArgumentError, TextureError, TextureFileError, TextureSystem, TextureWarning

WIDTH, HEIGHT = 64, 32

ROOT = os.path.normpath(os.path.join(PACKAGE, "..", ".."))
EXAMPLE = os.path.join(ROOT, "examples", "texture-python", "render.py")


def maketx(*words):
    """Runs maketx."""
    program = os.environ.get("GELATO", "gelato")
    ran = subprocess.run([program, "-as", "maketx", *words], capture_output=True, text=True)
    if ran.returncode:
        raise AssertionError(ran.stderr)


def write_pfm(name, width, height, channels, value):
    """Writes an image of floats. ``value`` returns the channels of a pixel for its centre, in fractions."""
    numbers = array.array("f")
    for y in reversed(range(height)):
        for x in range(width):
            numbers.extend(value((x + 0.5) / width, (y + 0.5) / height))
    if sys.byteorder != "little":
        numbers.byteswap()
    with open(name, "wb") as f:
        f.write(b"P%c\n%d %d\n-1\n" % (b"F"[0] if channels == 3 else b"f"[0], width, height) + numbers.tobytes())


def ramp(s, t):
    return s, t, 0.25


@unittest.skipUnless(os.environ.get("GRANITA_TEXTURE_LIB"), "GRANITA_TEXTURE_LIB is not set")
class Case(Scratch):
    """Has a texture that is s in its first channel, and t in its second one."""

    def setUp(self):
        super().setUp()
        write_pfm("ramp.pfm", WIDTH, HEIGHT, 3, ramp)
        maketx("-mode", "clamp", "-tilesize", "16", "ramp.pfm", "-o", "ramp.tx")

    def near(self, got, expected, tolerance=1e-5):
        got = list(got)
        self.assertEqual(len(got), len(expected), got)
        for a, b in zip(got, expected):
            self.assertAlmostEqual(a, b, delta=tolerance, msg=str(got))

    def system(self, **options):
        system = TextureSystem(**options)
        self.addCleanup(system.close)
        return system


class Plain(Case):
    """The results are those of numbers, buffers and lists."""

    def test_numbers(self):
        system = self.system()
        value = system.texture("ramp.tx", 0.5, 0.25)
        self.assertIsInstance(value, tuple)
        self.near(value, (0.5, 0.25, 0.25))
        self.near(system.texture("ramp.tx", 0.3, 0.7, first_channel=1, channels=1), (0.7,))
        self.near(system.texture("ramp.tx", 0.3, 0.7, first_channel=2, channels=3, fill=5), (0.25, 5, 5))
        # All texels of the map under a wide footprint.
        self.near(system.texture("ramp.tx", 0.5, 0.5, dsdx=0.2, dtdy=0.2), (0.5, 0.5, 0.25), 1e-3)
        self.near(system.texture("ramp.tx", 0.5, 0.5, blur=0.2), (0.5, 0.5, 0.25), 1e-3)

    def test_options(self):
        system = self.system()
        # The widths scale the derivatives, and the footprint at the border reaches fewer dark texels.
        wide = system.texture("ramp.tx", 0.0, 0.5, dsdx=0.4, dtdy=0.1)
        narrow = system.texture("ramp.tx", 0.0, 0.5, dsdx=0.4, dtdy=0.1, swidth=0.25)
        none = system.texture("ramp.tx", 0.0, 0.5, dsdx=0.4, dtdy=0.1, width=0)
        self.assertGreater(wide[0], 2 * narrow[0])
        self.assertGreater(narrow[0], none[0])
        self.near(system.texture("ramp.tx", 1.25, 0.5, wrap="black"), (0, 0, 0))
        self.near(system.texture("ramp.tx", 1.25, 0.5), ((WIDTH - 0.5) / WIDTH, 0.5, 0.25))
        self.near(system.texture("ramp.tx", 1.25, 0.5, wrap="periodic"), (0.25, 0.5, 0.25))
        self.near(system.texture("ramp.tx", 1.25, -0.25, swrap="mirror", twrap="periodic"), (0.75, 0.75, 0.25))
        s, t = 10.9 / WIDTH, 20.1 / HEIGHT
        nearest = system.texture("ramp.tx", s, t, 0.5, 0, 0, 0.5, filter="nearest")
        self.near(nearest, (10.5 / WIDTH, 20.5 / HEIGHT, 0.25), 0)
        self.near(system.texture("ramp.tx", s, t, 0.5, 0, 0, 0.5, filter="bilinear"), (s, t, 0.25))
        self.near(system.texture("ramp.tx", 2.5, 0.5, wrap="black", filter="nearest"), (0, 0, 0), 0)
        self.near(system.texture("ramp.tx", float("nan"), 0.5), (0, 0, 0), 0)

    def check_buffers(self):
        system = self.system()
        s, t = array.array("f", [0.1, 0.5, 0.9]), array.array("f", [0.5, 0.25, 0.75])
        value = system.texture("ramp.tx", s, t)
        rows = [[*pair, 0.25] for pair in zip(s, t)]
        self.assertEqual(tuple(value.shape), (3, 3))
        for got, expected in zip(value.tolist(), rows):
            self.near(got, expected)
        # Lists, doubles, another shape, and one number for all points.
        value = system.texture("ramp.tx", [[0.1, 0.5, 0.9]] * 2, array.array("d", [0.25, 0.5, 0.75]))
        self.assertEqual(tuple(value.shape), (2, 3, 3))
        self.near(value.tolist()[1][2], (0.9, 0.75, 0.25))
        value = system.texture("ramp.tx", s, 0.5, channels=1)
        self.near([row[0] for row in value.tolist()], s)
        # Results go where the caller wants them.
        out = array.array("f", [-1.0]) * 6
        self.assertIs(system.texture("ramp.tx", s, t, channels=2, out=out), out)
        self.near(out, [0.1, 0.5, 0.5, 0.25, 0.9, 0.75])
        # A C struct, with steps.
        class Pixel(ctypes.Structure):
            _fields_ = [("s", ctypes.c_float), ("t", ctypes.c_float)]

        pixels = (Pixel * 3)(*zip(s, t))
        both = memoryview(pixels).cast("B").cast("f")
        value = system.texture("ramp.tx", both[::2], both[1::2])
        self.near(value.tolist()[1], (0.5, 0.25, 0.25))
        # No points.
        self.assertEqual(len(system.texture("ramp.tx", [], [])), 0)

    @needs_numpy
    def test_buffers_with_numpy(self):
        self.check_buffers()

    def test_buffers_without_numpy(self):
        with Unseen():
            self.check_buffers()

    def test_texels(self):
        system = self.system()
        with Unseen():
            value = system.texels("ramp.tx", x=3, y=5, width=2, height=4).tolist()
            last = system.texels("ramp.tx", level=6, channels=1).tolist()
        self.assertEqual(len(value), 4)
        self.near(value[2][1], (4.5 / WIDTH, 7.5 / HEIGHT, 0.25), 0)
        self.near(last[0][0], (0.5,))
        for wrong in ({"level": 7}, {"level": -1}, {"x": 60, "width": 5}, {"y": -1}):
            with self.assertRaises(TextureArgumentError):
                system.texels("ramp.tx", **wrong)

    def test_info(self):
        system = self.system()
        info = system.info("ramp.tx")
        self.assertEqual((info.width, info.height, info.channels, info.format), (WIDTH, HEIGHT, 3, "float"))
        self.assertEqual((info.kind, info.type), ("Plain Texture", "texture"))
        self.assertEqual((info.levels[0], info.levels[-1], len(info.levels)), ((64, 32), (1, 1), 7))
        self.assertEqual((info.tile, info.wrap, info.squares), ((16, 16), ("clamp", "clamp"), ()))
        self.near(info.average, (0.5, 0.5, 0.25))
        self.assertEqual(info.metadata["wrapmodes"], "clamp")
        self.assertEqual(info.channel_names, ("R", "G", "B"))
        maketx("-hash", "ramp.pfm", "-o", "hashed.tx")
        hashed = system.open("hashed.tx").info
        self.near(map(float, hashed.metadata["oiio:AverageColor"].split(",")), (0.5, 0.5, 0.25), 1e-4)

    def test_environment(self):
        # The map of a TIFF texture has +z up, and +x in its centre.
        write_pfm("sky.pfm", 128, 64, 3, lambda s, t: (1.0 if t < 0.5 else 0.0, s, 0.5))
        maketx("-envlatl", "sky.pfm", "-o", "sky.env")
        system = self.system()
        self.assertEqual(system.info("sky.env").type, "environment")
        self.near(system.environment("sky.env", (0, 0, 1)), (1, 0.5, 0.5), 0.02)
        self.near(system.environment("sky.env", (0, 0, -7)), (0, 0.5, 0.5), 0.02)
        self.near(system.environment("sky.env", (0, 1, 0), up="y", channels=1), (1,))
        self.near(system.environment("sky.env", (1, 0, 0), channels=1, angle=0.5), (0.5,), 0.01)
        self.near(system.environment("sky.env", (1, 0, 0), channels=1, blur=0.5), (0.5,), 0.01)
        blurred = system.environment("sky.env", (1, 0, 0.3), (0, 0, 0.3), (0, 0.3, 0), channels=1)[0]
        self.assertTrue(0.5 < blurred < 1, blurred)
        value = system.environment("sky.env", [[0, 0, 1], [0, 0, -1]], channels=1)
        self.near([row[0] for row in value.tolist()], (1, 0))
        with self.assertRaises(TextureArgumentError):
            system.environment("sky.env", (0, 0, 1), up="x")

    def test_shadow(self):
        # The light looks along +z. There is an object at depth 2 on its left.
        write_pfm("depth.pfm", 64, 64, 1, lambda s, t: (2.0 if s < 0.5 else 1e30,))
        one = ("1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1").split()
        maketx("-shadow", "-Mcamera", *one, "-Mscreen", *one, "depth.pfm", "-o", "depth.sm")
        system = self.system()
        self.assertEqual(system.info("depth.sm").world_to_camera, tuple(map(float, one)))
        self.assertIsNone(system.info("depth.sm").average)
        self.assertEqual(system.shadow("depth.sm", (-0.5, 0, 5)), 1)
        points = [(-0.5, 0, 5), (0.5, 0, 5), (-0.5, 0, 1), (-0.5, 0, 2.005)]
        value = system.shadow("depth.sm", points)
        self.assertEqual(value.tolist(), [1, 0, 0, 0])
        self.assertEqual(system.shadow("depth.sm", points, bias=0).tolist(), [1, 0, 0, 1])
        soft = system.shadow("depth.sm", [(0, 0, 5)] * 2, blur=0.25, samples=256)
        self.near(soft.tolist(), (0.5, 0.5), 0.05)
        with self.assertRaises(TextureFileError):
            system.shadow("ramp.tx", (0, 0, 0))

    def test_volumes(self):
        write_pfm("flat.pfm", 32, 32, 3, lambda s, t: (0.25, 0.25, 0.25))
        system = self.system()
        maketx("flat.pfm", "-o", "flat.tx")
        self.near(system.texture3d("flat.tx", (0.5, 0.5, 0.5), wrap="clamp"), (0.25, 0.25, 0.25))

    def test_sets(self):
        for number, value in ((1001, 0.25), (1002, 0.5), (1011, 0.75)):
            write_pfm("%d.pfm" % number, 32, 32, 3, lambda s, t, value=value: (value,) * 3)
            maketx("%d.pfm" % number, "-o", "wall.%d.tx" % number)
        system = self.system()
        self.assertEqual(system.info("wall.<UDIM>.tx").squares, ((0, 0), (1, 0), (0, 1)))
        for filter in ("gaussian", "bilinear", "nearest"):
            value = system.texture(
                "wall.<UDIM>.tx", [0.5, 1.5, 0.5], [0.5, 0.5, -0.5], channels=1, filter=filter
            )
            self.near([row[0] for row in value.tolist()], (0.25, 0.5, 0.75))


class Systems(Case):
    """The errors, messages, threads and memory of systems."""

    def test_errors(self):
        system = self.system()
        with self.assertRaisesRegex(TextureFileError, 'texture "none.tx" not found'):
            system.texture("none.tx", 0.5, 0.5)
        # The same error again.
        with self.assertRaisesRegex(TextureFileError, 'texture "none.tx" not found'):
            system.open("none.tx")
        for text, call in (
            ('the wrap mode "round" is not', lambda: system.texture("ramp.tx", 0, 0, wrap="round")),
            ("filter is", lambda: system.texture("ramp.tx", 0, 0, filter="box")),
            ("s is not given", lambda: system.texture("ramp.tx", None, 0)),
            ("s takes numbers", lambda: system.texture("ramp.tx", "a", 0)),
            ("do not fit", lambda: system.texture("ramp.tx", [0, 1], [0, 1, 2])),
            ("r takes the shape", lambda: system.environment("ramp.tx", (0, 1))),
            ("channels is 1 to 4096", lambda: system.texture("ramp.tx", 0, 0, channels=0)),
            ("first_channel is 0 or more", lambda: system.texture("ramp.tx", 0, 0, first_channel=-1)),
            ("out ", lambda: system.texture("ramp.tx", [0, 1], 0, channels=3, out=array.array("f", [0] * 5))),
            ("out ", lambda: system.texture("ramp.tx", [0, 1], 0, channels=3, out=array.array("d", [0] * 6))),
            ("out ", lambda: system.texture("ramp.tx", [0, 1], 0, channels=3, out=b"0" * 24)),
            ("of another system", lambda: self.system().texture(system.open("ramp.tx"), 0, 0)),
            ("memory and files", lambda: TextureSystem(memory=0)),
            ("threads", lambda: TextureSystem(threads=-1)),
        ):
            with self.subTest(text=text), self.assertRaisesRegex(TextureArgumentError, text):
                call()
        with open("text.tx", "w", encoding="ascii") as f:
            f.write("not an image")
        with self.assertRaisesRegex(TextureFileError, "text.tx: malformed TIFF"):
            system.open("text.tx")

    def test_messages(self):
        with open("ramp.tx", "r+b") as f:
            f.truncate(os.path.getsize("ramp.tx") * 2 // 3)
        told = []
        system = self.system(on_message=lambda severity, text: told.append((severity, text)))
        try:
            system.texels("ramp.tx")
        except TextureFileError as error:
            # The list of its levels is at its end.
            self.assertIn("ramp.tx", str(error))
        else:
            self.assertEqual(told[0][0], "error")
            self.assertIn("texels that cannot be read are black", told[0][1])
        plain = self.system()
        with self.assertWarnsRegex(TextureWarning, "its levels are made in memory") as caught:
            plain.texture("ramp.pfm", 0.5, 0.5)
        self.assertEqual(caught.filename, __file__)
        with self.assertRaisesRegex(TextureFileError, "is not tiled"):
            self.system(automipmap=False).open("ramp.pfm")

    def test_changed_files(self):
        system = self.system()
        before = system.open("ramp.tx")
        self.near(system.texture(before, 0.5, 0.25), (0.5, 0.25, 0.25))
        with self.assertRaises(TextureFileError):
            system.open("later.tx")
        write_pfm("ramp.pfm", 16, 16, 3, lambda s, t: (0.125, 0.25, 0.5))
        maketx("ramp.pfm", "-o", "ramp.tx")
        maketx("ramp.pfm", "-o", "later.tx")
        self.near(system.texture(before, 0.5, 0.25), (0.5, 0.25, 0.25))
        system.invalidate("ramp.tx")
        self.near(system.texture(before, 0.5, 0.5), (0.125, 0.25, 0.5))
        self.assertEqual((before.info.width, system.info("ramp.tx").width), (16, 16))
        with self.assertRaises(TextureFileError):
            system.open("later.tx")
        system.invalidate()
        self.near(system.texture("later.tx", 0.5, 0.5), (0.125, 0.25, 0.5))
        os.remove("later.tx")
        system.invalidate()
        with self.assertRaisesRegex(TextureFileError, "not found"):
            system.texture("later.tx", 0.5, 0.5)
        # Levels in memory are made again.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            self.near(system.texture("ramp.pfm", 0.5, 0.5), (0.125, 0.25, 0.5))
            write_pfm("ramp.pfm", 40, 20, 3, ramp)
            system.invalidate("ramp.pfm")
            self.near(system.texture("ramp.pfm", 0.5, 0.5), (0.5, 0.5, 0.25))

    def test_statistics_and_memory(self):
        memory = 2 * 16 * 16 * 12
        system = self.system(memory=memory)
        for _ in range(3):
            system.texels("ramp.tx")
        counts = system.statistics()
        self.assertEqual((counts["files"], counts["missing"]), (1, 0))
        self.assertGreaterEqual(counts["lookups"], 3 * WIDTH * HEIGHT)
        self.assertTrue(0 < counts["peak_bytes"] <= memory, counts)
        self.assertGreaterEqual(counts["tiles_read"], 3 * 8 - 2)
        self.assertIn("tiles read: %d" % counts["tiles_read"], system.statistics_text())

    def test_search_path(self):
        os.mkdir("maps")
        os.rename("ramp.tx", "maps/ramp.tx")
        with self.assertRaisesRegex(TextureFileError, "not found"):
            self.system().open("ramp.tx")
        for path in ("nowhere:maps", ["nowhere", "maps"]):
            self.assertEqual(self.system(path=path).info("ramp.tx").path, os.path.join("maps", "ramp.tx"))

    def test_threads(self):
        count = 20000
        s = array.array("f", (i % 173 / 173 for i in range(count)))
        t = array.array("f", (i % 97 / 97 for i in range(count)))
        with Unseen():
            expected = self.system().texture("ramp.tx", s, t, 0.05, 0.01, 0.01, 0.03).tobytes()
            shared = self.system(threads=3)
            self.assertEqual(shared.texture("ramp.tx", s, t, 0.05, 0.01, 0.01, 0.03).tobytes(), expected)
            shared.threads = 1
            small = self.system(memory=20000)
            got = []

            def look(system):
                got.append(system.texture("ramp.tx", s, t, 0.05, 0.01, 0.01, 0.03).tobytes())

            threads = [threading.Thread(target=look, args=(system,)) for system in (shared, small) * 3]
            for thread in threads:
                thread.start()
            for _ in range(10):
                shared.invalidate()
            for thread in threads:
                thread.join()
        self.assertEqual(len(got), 6)
        self.assertTrue(all(value == expected for value in got))

    def test_systems_that_are_closed(self):
        system = TextureSystem()
        found = system.open("ramp.tx")
        system.close()
        calls = (system.statistics, lambda: found.info, lambda: system.texture(found, 0, 0), lambda: system.open("x"))
        for call in calls:
            with self.assertRaisesRegex(TextureError, "the texture system is closed"):
                call()
        system.close()

    def test_the_library_of_another_version_is_refused(self):
        with self.assertRaisesRegex(TextureError, "cannot be used"):
            texture._library.Library("no-such-library.so")


@needs_numpy
class Arrays(Case):
    """Arrays of numpy are used where they are."""

    def setUp(self):
        super().setUp()
        generator = numpy.random.default_rng(1)
        self.s, self.t = generator.random((2, 4, 5, 6), "f4")
        self.own = self.system()
        flat = [self.own.texture("ramp.tx", float(a), float(b)) for a, b in zip(self.s.flat, self.t.flat)]
        self.expected = numpy.array(flat, "f4").reshape(4, 5, 6, 3)

    def same(self, got, expected):
        self.assertEqual(got.dtype, numpy.float32)
        numpy.testing.assert_array_equal(got, expected)

    def test_layouts(self):
        look = self.own.texture
        self.same(look("ramp.tx", self.s, self.t), self.expected)
        self.same(look("ramp.tx", self.s.T, self.t.T), self.expected.transpose(2, 1, 0, 3))
        cut = (slice(None, None, -1), slice(1, 4), slice(None, None, 2))
        self.same(look("ramp.tx", self.s[cut], self.t[cut]), self.expected[cut])
        both = numpy.stack([self.s, self.t], axis=-1)
        self.same(look("ramp.tx", both[..., 0], both[..., 1]), self.expected)
        fortran = numpy.asfortranarray(self.s)
        self.same(look("ramp.tx", fortran, self.t), self.expected)
        record = numpy.zeros(self.s.shape, [("a", "u1"), ("s", "f4"), ("t", "f4")])
        record["s"], record["t"] = self.s, self.t
        self.same(look("ramp.tx", record["s"], record["t"]), self.expected)
        self.same(look("ramp.tx", self.s.astype("f8"), self.t.astype(">f4")), self.expected)
        self.assertEqual(look("ramp.tx", self.s[:0], self.t[:0]).shape, (0, 5, 6, 3))

    def test_broadcasting(self):
        look = self.own.texture
        s, t = self.s[:, :1, :], self.t[0, :, :1]
        self.same(look("ramp.tx", s, t), look("ramp.tx", *numpy.broadcast_arrays(s, t)))
        self.assertEqual(look("ramp.tx", s, t).shape, (4, 5, 6, 3))
        blur = numpy.linspace(0, 0.5, 6, dtype="f4")
        value = look("ramp.tx", 0, 0.5, dtdy=0.1, blur=blur, channels=1)
        self.assertTrue((numpy.diff(value[:, 0]) > 0).all(), value)
        self.assertEqual(look("ramp.tx", numpy.float32(0.5), 0.5).shape, (3,))

    def test_results_go_into_out(self):
        look = self.own.texture
        out = numpy.full((5, 4, 6, 8), -1, "f4")
        place = out.transpose(1, 0, 2, 3)[..., 6:0:-2]
        self.assertIs(look("ramp.tx", self.s, self.t, out=place), place)
        self.same(place, self.expected)
        self.assertTrue((out[..., 1::2] == -1).all() and (out[..., 0] == -1).all())
        for wrong in (out, place.astype("f8"), numpy.broadcast_to(place[:1], place.shape)):
            with self.assertRaises(TextureArgumentError):
                look("ramp.tx", self.s, self.t, out=wrong)
        depths = numpy.zeros((4, 5), "f4")
        write_pfm("depth.pfm", 8, 8, 1, lambda s, t: (2.0,))
        one = ("1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1").split()
        maketx("-shadow", "-Mcamera", *one, "-Mscreen", *one, "depth.pfm", "-o", "depth.sm")
        places = numpy.zeros((4, 5, 3), "f4")
        places[2:, :, 2] = 5
        self.same(self.own.shadow("depth.sm", places, out=depths), [[0] * 5] * 2 + [[1] * 5] * 2)

    def test_texels(self):
        whole = self.own.texels("ramp.tx")
        self.assertEqual(whole.shape, (HEIGHT, WIDTH, 3))
        x, y = (numpy.arange(WIDTH) + 0.5) / WIDTH, (numpy.arange(HEIGHT) + 0.5) / HEIGHT
        numpy.testing.assert_allclose(whole[..., 0], numpy.tile(x, (HEIGHT, 1)), atol=1e-7)
        numpy.testing.assert_allclose(whole[..., 1].T, numpy.tile(y, (WIDTH, 1)), atol=1e-7)
        out = numpy.zeros((3, WIDTH, HEIGHT), "f4").transpose(2, 1, 0)
        self.own.texels("ramp.tx", out=out)
        self.same(out, whole)

    def test_the_examples_of_the_manual_run(self):
        maketx(os.path.join(ROOT, "examples", "first", "brick.png"), "-o", "brick.tx")
        os.symlink(os.path.join(ROOT, "examples"), "examples")
        self.assertEqual(run_examples(self, "texture-api.md"), 2)

    def test_the_example_renders(self):
        environment = dict(os.environ, PYTHONPATH=os.pathsep.join([PACKAGE, *sys.path]))
        sizes = []
        for filter in ("gaussian", "nearest"):
            name = filter + ".png"
            words = [EXAMPLE, "--size", "96", "60", "--filter", filter, "--output", name]
            ran = subprocess.run([sys.executable, *words], env=environment, capture_output=True, text=True)
            self.assertEqual((ran.returncode, ran.stderr), (0, ""))
            self.assertIn("96 x 60 pixels", ran.stdout)
            sizes.append(os.path.getsize(name))
        # Without filtering there is noise, which takes more bytes.
        self.assertGreater(sizes[1], sizes[0])


if __name__ == "__main__":
    unittest.main()
