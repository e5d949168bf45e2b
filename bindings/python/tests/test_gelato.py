"""Tests calls and processes."""

import array
import io
import os
import subprocess
import sys
import time
import unittest

from support import PACKAGE, Scratch, needs_numpy, numpy  # isort: skip

import gelato
from gelato import _stream


def values(data):
    """Returns the code and the numbers of an encoded sequence."""
    code = data[:1]
    numbers = array.array("i" if code == b"I" else "f")
    numbers.frombytes(data[5:])
    return code, list(numbers)


class Encoding(unittest.TestCase):
    def test_sequences(self):
        self.assertEqual(values(_stream.encode([1, 2])), (b"I", [1, 2]))
        self.assertEqual(values(_stream.encode((1, 2.5))), (b"F", [1, 2.5]))
        self.assertEqual(values(_stream.encode(range(3))), (b"I", [0, 1, 2]))
        self.assertEqual(values(_stream.encode([[1, 2], (3, 4.5)])), (b"F", [1, 2, 3, 4.5]))
        self.assertEqual(values(_stream.encode(k for k in (1, 2))), (b"I", [1, 2]))
        self.assertEqual(values(_stream.encode(array.array("d", [0.5]))), (b"F", [0.5]))
        self.assertEqual(values(_stream.encode([1 << 40])), (b"F", [float(1 << 40)]))
        self.assertEqual(_stream.encode(True), _stream.encode(1))
        self.assertRaises(TypeError, _stream.encode, ["a", 1])
        self.assertRaises(TypeError, _stream.encode, object())
        deep = [1]
        for _ in range(100):
            deep = [deep]
        self.assertRaises(TypeError, _stream.encode, deep)

    def test_answers_come_back(self):
        for value in (None, 3, -1.5, "words \u00e9", (1, 2, 3), (0.5, 2.0), ("a", "", "b")):
            self.assertEqual(_stream.decode(_stream.encode(value)), value)

    @needs_numpy
    def test_numpy(self):
        for kind in ("float32", "float64", "float16", ">f4", "int8", "uint16", "int32", "int64"):
            whole = numpy.arange(12, dtype=kind)
            code = b"F" if "f" in kind else b"I"
            expected = (code, [float(k) for k in range(12)] if code == b"F" else list(range(12)))
            self.assertEqual(values(_stream.encode(whole)), expected, kind)
            self.assertEqual(values(_stream.encode(whole.reshape(2, 2, 3))), expected, kind)
            # The arrays are every other number, and columns before rows.
            self.assertEqual(values(_stream.encode(whole[::2]))[1], expected[1][::2], kind)
            turned = whole.reshape(3, 4).T
            self.assertEqual(values(_stream.encode(turned))[1], [float(k) for k in turned.flatten()], kind)
        self.assertEqual(_stream.encode(numpy.float32(0.5)), _stream.encode(0.5))
        self.assertEqual(_stream.encode(numpy.int64(7)), _stream.encode(7))
        self.assertEqual(values(_stream.encode(numpy.array([True, False])))[1], [1, 0])


class Rendering(Scratch):
    def scene(self, r, file):
        r.Attribute("int[2] resolution", (32, 24))
        r.Output(file, "ppm", "rgb", "camera")
        r.Translate(0, 0, 5)
        r.World()
        r.Light("key", "pointlight", "float intensity", 20, "point from", [2, 3, -4])
        r.Attribute("color C", (1, 0.5, 0.25))
        r.Shader("surface", "plastic")
        r.Sphere(1, -1, 1, 360)

    def test_archives(self):
        """Renderers that write scene files work in programs and in scene files that are scripts."""
        lines = ['Attribute ("float fov", 30)', "World ()", 'Points (1, "vertex point P", (0, 0, 0))', "Render ()"]
        calls = (
            "r.Attribute('float fov', 30)\nassert r.GetAttribute('float near') > 0\nr.World()\n"
            "r.Parameter('vertex point P', (0, 0, 0))\nr.Points(1)\nr.Render()\n"
        )
        for name, kind in (("a.pyg", "a.pyg"), ("b", "pyg b"), ("c d", "pyg \t c d ")):
            with gelato.CreateRenderer(kind) as r:
                exec(calls, {"r": r})
            with open(name, encoding="ascii") as f:
                self.assertEqual(f.read().splitlines(), lines)
        printed, before = io.StringIO(), sys.stdout
        try:
            sys.stdout = printed
            with gelato.CreateRenderer("pyg") as r:
                exec(calls, {"r": r})
        finally:
            sys.stdout = before
        self.assertEqual(printed.getvalue().splitlines(), lines)
        for unknown in ("remote", "pygmy", "x.tif"):
            with self.assertRaisesRegex(gelato.GelatoError, "no renderer of the type"):
                gelato.CreateRenderer(unknown)
        with gelato.CreateRenderer("no/such/folder/a.pyg") as r:
            r.World()
            self.assertEqual(r.finish(), 2)
        with gelato.CreateRenderer(None, "-threads", 1) as r:
            self.scene(r, "none.ppm")
            r.Render()
        # A scene file may make renderers, too. Its own calls still go to the main renderer.
        with open("script.pyg", "w", encoding="utf-8") as f:
            f.write("r = CreateRenderer ('pyg inner.pyg')\n" + calls)
            f.write("q = GelatoRenderer.CreateRenderer ('pyg')\nq.World ()\n")
            f.write("import gelato\np = gelato.CreateRenderer ()\n")
            f.write("p.Output ('inner.ppm', 'ppm', 'rgb', 'camera')\np.World ()\np.Render ()\n")
            f.write("for call in ['World']: globals ()[call] ()\n")
        ran = subprocess.run(
            [os.environ["GELATO"], "script.pyg"],
            env={k: v for k, v in os.environ.items() if k != "GELATO"},
            capture_output=True,
            text=True,
        )
        self.assertEqual((ran.stdout, ran.stderr), ("World ()\n", ""))
        with open("inner.pyg", encoding="ascii") as f:
            self.assertEqual(f.read().splitlines(), lines)
        self.assertTrue(os.path.exists("inner.ppm") and os.path.exists("none.ppm"))

    def test_a_image_is_the_scene_file_s(self):
        with gelato.CreateRenderer("-threads", 1) as r:
            self.scene(r, "python.ppm")
            self.assertEqual(r.GetAttribute("int[2] resolution"), (32, 24))
            self.assertEqual(r.GetAttribute("color C"), (1, 0.5, 0.25))
            self.assertEqual(r.GetAttribute("string geometryset") is None, False)
            self.assertIsNone(r.GetAttribute("float user:nothing"))
            r.Render()
            self.assertTrue(os.path.exists("python.ppm"), "Render returned before it was done")
            self.assertEqual(r.errors, 0)
            self.assertEqual(r.finish(), 0)
        lines = io.StringIO()

        class Printer:
            def __getattr__(self, name):
                return lambda *args: lines.write("%s %r\n" % (name, args))

        self.scene(Printer(), "file.ppm")
        with open("scene.pyg", "w", encoding="utf-8") as f:
            f.write(lines.getvalue() + "Render ()\n")
        subprocess.run([os.environ["GELATO"], "scene.pyg"], check=True)
        with open("python.ppm", "rb") as a, open("file.ppm", "rb") as b:
            self.assertEqual(a.read(), b.read())

    def test_functions_of_the_module_and_what_shaders_print(self):
        script = (
            "import gelato\n"
            "from gelato import *\n"
            "with open('say.gsl', 'w') as f: f.write('surface say () { if (gridindex () == 0) printf (\"said\\\\n\"); }')\n"
            "gelato.Attribute('int[2] resolution', (8, 8))\n"
            "Output('m.tif', 'tiff', 'rgba', 'camera')\n"
            "Translate(0, 0, 5)\n"
            "World()\n"
            "Shader('surface', 'say')\n"
            "Sphere(1, -1, 1, 360)\n"
            "Render()\n"
            "Command('system', 'string[3] command', ('sh', '-c', 'echo from a program'))\n"
            "Sphere('many', -1, 1, 360)\n"
            "print('errors', gelato.GelatoRenderer.errors)\n"
            "print('status', gelato.finish())\n"
        )
        with open("script.py", "w", encoding="utf-8") as f:
            f.write(script)
        environment = dict(os.environ, PYTHONPATH=PACKAGE)
        ran = subprocess.run([sys.executable, "script.py"], env=environment, capture_output=True, text=True)
        self.assertEqual(ran.returncode, 0, ran.stderr)
        self.assertIn("said", ran.stdout)
        self.assertIn("errors 1\nstatus 1\n", ran.stdout)
        self.assertIn("from a program", ran.stderr)
        # The location is that of the script.
        self.assertIn("script.py:12: error: Sphere wants", ran.stderr)

    def heavy(self, r):
        r.Attribute("int[2] resolution", (4000, 3000))
        r.Attribute("float[2] spatialquality", (16, 16))
        r.Output("never.ppm", "ppm", "rgb", "camera")
        r.Translate(0, 0, 3)
        r.World()
        r.Shader("surface", "defaultsurface")
        r.Sphere(1, -1, 1, 360)

    def assert_ends(self, pid):
        """Checks that a process ends soon. A process that is not waited for may stay in the table."""
        for _ in range(500):
            try:
                with open("/proc/%d/stat" % pid, encoding="utf-8") as f:
                    if f.read().rpartition(")")[2].split()[0] == "Z":
                        return
            except OSError:
                return
            time.sleep(0.01)
        self.fail("process %d goes on" % pid)

    @unittest.skipIf(not os.path.exists("/proc/self/stat"), "processes cannot be looked at here")
    def test_renderers_end_with_their_object(self):
        r = gelato.CreateRenderer()
        r.World()
        child = r._process.child
        del r
        self.assertIsNotNone(child.poll(), "a renderer without an object goes on")

    @unittest.skipIf(not os.path.exists("/proc/self/stat"), "processes cannot be looked at here")
    def test_renderers_end_with_the_program(self):
        """The program ends in the middle of a frame, by an exception, a signal that it handles, or one that it does
        not handle."""
        environment = dict(os.environ, PYTHONPATH=PACKAGE)
        head = "import os, sys, gelato, signal, threading\nsys.path.insert(0, %r)\n" % os.path.dirname(
            os.path.abspath(__file__)
        )
        head += "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        head += "import test_gelato\nr = gelato.CreateRenderer()\ntest_gelato.Rendering.heavy(None, r)\n"
        head += "print(r._process.child.pid, flush=True)\n"
        later = "threading.Timer(0.3, lambda: os.kill(os.getpid(), signal.%s)).start()\nr.Render()\n"
        for tail, status in (
            ("raise ValueError\n", 1),
            (later % "SIGINT", -2),
            (later % "SIGTERM", -15),
            (later % "SIGKILL", -9),
            ("os._exit(3)\n", 3),
        ):
            begin = time.monotonic()
            ran = subprocess.run(
                [sys.executable, "-c", head + tail], env=environment, capture_output=True, text=True
            )
            self.assertEqual(ran.returncode, status, tail + ran.stderr)
            self.assert_ends(int(ran.stdout.split()[0]))
            self.assertLess(time.monotonic() - begin, 10, tail)
            self.assertFalse(os.path.exists("never.ppm"))

    def test_what_cannot_be(self):
        before = os.environ["GELATO"]
        os.environ["GELATO"] = os.path.join(self.folder.name, "absent")
        try:
            with self.assertRaisesRegex(gelato.GelatoError, "cannot run .*absent"):
                gelato.CreateRenderer().World()
        finally:
            os.environ["GELATO"] = before
        with gelato.CreateRenderer() as r:
            r.World()
            with self.assertRaises(TypeError):
                r.Sphere(object())
            # A call that could not be sent has no effect.
            self.assertEqual(r.errors, 0)
            r.Command("exit")
        with self.assertRaises(gelato.GelatoError):
            r.World()


if __name__ == "__main__":
    unittest.main()
