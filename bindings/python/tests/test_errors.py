"""Tests errors, warnings, blocks, and renderers that end early."""

import os
import subprocess
import sys
import time
import unittest
import warnings

from support import FOLDER, PACKAGE, Scratch, ball  # isort: skip

import gelato
from gelato import _errors

HERE = os.path.abspath(__file__)


def fake(text):
    """Writes a program of Python that takes the place of the renderer."""
    with open("fake", "w", encoding="utf-8") as f:
        f.write("#!%s\nimport os, struct, sys, time\n%s" % (sys.executable, text))
    os.chmod("fake", 0o755)
    return os.path.abspath("fake")


class Messages(Scratch):
    def test_errors_are_raised_where_the_program_waits(self):
        with gelato.Renderer() as r:
            r.Attribute("int[2] resolution", (8, 6))
            r.World()
            r.Attribute("string name", "the ball")
            r.Sphere("many", -1, 1, 360); line = sys._getframe().f_lineno  # fmt: skip
            r.Mesh("squared", [3], [0, 1, 2])
            r.Sphere(1, -1, 1, 360)
            with self.assertRaises(gelato.GelatoError) as caught:
                r.render()
            error = caught.exception
            self.assertEqual((error.severity, error.code), ("error", 2048))
            self.assertEqual((os.path.abspath(error.file), error.line, error.object), (HERE, line, "the ball"))
            self.assertRegex(str(error), r"test_errors\.py:%d: error: Sphere wants .* \(and 1 more errors\)" % line)
            self.assertEqual([m.line for m in error.messages], [line, line + 1])
            # The frame was rendered without these calls, and the errors are raised once.
            self.assertEqual(error.result.shape, (6, 8, 4))
            self.assertEqual((r.errors, r.finish()), (2, 1))

    def test_errors_at_the_end_and_before_other_exceptions(self):
        with self.assertRaisesRegex(gelato.GelatoError, "Sphere wants"):
            with gelato.Renderer() as r:
                r.World()
                r.Sphere("many", -1, 1, 360)
        with self.assertRaises(KeyError):
            with gelato.Renderer() as r:
                r.World()
                r.Sphere("many", -1, 1, 360)
                raise KeyError
        self.assertEqual(r.finish(), 2 if not r.messages else 1)

    def test_names_of_attributes_and_parameters(self):
        with gelato.Renderer() as r:
            r.World()
            r.Attribute("int rerender", 1)
            with self.assertRaises(gelato.GelatoError) as caught:
                r.GetAttribute("string name")
            self.assertEqual((caught.exception.attribute, caught.exception.parameter), ("rerender", None))
            r.Sphere(1, -1, 1, 360, "float x")
            with self.assertRaises(gelato.GelatoError) as caught:
                r.finish()
            self.assertEqual((caught.exception.attribute, caught.exception.parameter), (None, "x"))
        message = _errors.Message(1024, 'Light: "float Kd" is odd (object "a")', "a.py", 3)
        self.assertEqual((message.parameter, message.object, str(message)[:17]), ("Kd", "a", "a.py:3: warning: "))

    def test_warnings(self):
        with gelato.Renderer() as r:
            ball(r, (8, 6))
            r.PushAttributes()
            with self.assertWarns(gelato.GelatoWarning) as caught:
                r.render()
            warning = caught.warnings[0]
            self.assertEqual(os.path.abspath(caught.filename), HERE)
            self.assertIn("PushAttributes without PopAttributes", str(warning.message))
            self.assertEqual(warning.message.message.line, warning.lineno)
        with gelato.Renderer() as r, warnings.catch_warnings():
            warnings.simplefilter("error")
            ball(r, (8, 6))
            r.PushAttributes()
            with self.assertRaises(gelato.GelatoWarning):
                r.render()
            # The answer was taken.
            self.assertIsNone(r.GetAttribute("float user:x"))
        with gelato.Renderer(on_error="warn") as r, self.assertWarnsRegex(gelato.GelatoWarning, "Sphere wants"):
            r.World()
            r.Sphere("many", -1, 1, 360)
            r.GetAttribute("string name")

    def test_callbacks(self):
        got = []
        with gelato.Renderer(on_error="warn", on_message=got.append) as r, warnings.catch_warnings():
            warnings.simplefilter("error")
            ball(r, (8, 6))
            r.PushAttributes()
            r.Sphere("many", -1, 1, 360)
            r.Render()
            self.assertEqual([m.severity for m in got], ["error", "warning"])
            self.assertEqual(list(r.messages), got)

        def refuse(message):
            raise LookupError(message.text)

        with gelato.Renderer(on_error="warn", on_message=refuse) as r:
            r.World()
            r.Sphere("many", -1, 1, 360)
            with self.assertRaisesRegex(LookupError, "Sphere wants"):
                r.GetAttribute("string name")
            self.assertEqual(r.errors, 1)
        self.assertRaises(ValueError, gelato.Renderer, on_error="ignore")

    def test_many_messages_do_not_block(self):
        """Messages are read while calls are sent. The pipes hold less than these."""
        lines = ["r.Sphere('many', -1, 1, 360)\n"] * 1500
        with gelato.Renderer(on_error="warn", on_message=lambda m: None) as r:
            r.World()
            r.Attribute("string name", "x" * 1000)
            exec("".join(lines), {"r": r})
            self.assertEqual(r.errors, 1500)

    def test_errors_at_the_end_of_the_program(self):
        program = "import gelato\na, b = gelato.Renderer(), gelato.Renderer()\nfor r in (a, b):\n    r.World()\n"
        program += "    r.Sphere('many', -1, 1, 360)\n"
        environment = dict(os.environ, PYTHONPATH=PACKAGE)
        ran = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True)
        self.assertEqual(ran.stderr.count("gelato: <string>:5: error: Sphere wants a number"), 2, ran.stderr)
        self.assertNotIn("Traceback", ran.stderr)

    def test_printed_messages(self):
        """Renderers of the module print to standard error, also where that is an object of the program."""
        program = (
            "import io, sys, gelato\n"
            "if sys.argv[1:]: sys.stderr = io.StringIO()\n"
            "gelato.World()\n"
            "gelato.Sphere('many', -1, 1, 360)\n"
            "gelato.GetAttribute('string name')\n"
            "if sys.argv[1:]: print(sys.stderr.getvalue())\n"
        )
        environment = dict(os.environ, PYTHONPATH=PACKAGE)
        for arguments, stream in (([], "stderr"), (["object"], "stdout")):
            command = [sys.executable, "-c", program, *arguments]
            ran = subprocess.run(command, env=environment, capture_output=True, text=True)
            self.assertIn("gelato: <string>:4: error: Sphere wants a number", getattr(ran, stream))


class Blocks(Scratch):
    def calls(self, use):
        with gelato.Renderer("a.pyg") as r:
            use(r)
        with open("a.pyg", encoding="ascii") as f:
            return [line.split()[0] for line in f]

    def test_pairs(self):
        def use(r):
            with r.world() as same:
                self.assertIs(same, r)
                with r.attributes(), r.transform():
                    r.Scale(1, 1, 1)
                with r.shader_group():
                    r.Shader("surface", "plastic")
                with self.assertRaises(KeyError), r.attributes():
                    raise KeyError

        expected = "World PushAttributes PushAttributes PushTransform Scale PopTransform PopAttributes "
        expected += "ShaderGroupBegin Shader ShaderGroupEnd PushAttributes PopAttributes PopAttributes"
        self.assertEqual(self.calls(use), expected.split())

    def test_a_frame_ends_all_blocks(self):
        def use(r):
            with r.world(), r.transform():
                r.Sphere(1, -1, 1, 360)
                r.Render()

        expected = "World PushAttributes PushTransform Sphere PopTransform PopAttributes Render"
        self.assertEqual(self.calls(use), expected.split())
        with gelato.Renderer() as r:
            r.Attribute("int[2] resolution", (8, 6))
            with warnings.catch_warnings(), r.world(), r.attributes():
                warnings.simplefilter("error")
                r.Sphere(1, -1, 1, 360)
                self.assertEqual(r.render().shape, (6, 8, 4))


@unittest.skipIf(os.name == "nt", "the programs are scripts")
class Ends(Scratch):
    def replaced(self, text):
        before = os.environ["GELATO"]
        os.environ["GELATO"] = fake(text)
        self.addCleanup(os.environ.__setitem__, "GELATO", before)

    def test_a_renderer_that_is_killed(self):
        r = gelato.Renderer()
        ball(r)
        r.GetAttribute("string name")
        r._process.child.kill()
        r._process.child.wait()
        begin = time.monotonic()
        with self.assertRaises(gelato.GelatoError) as caught:
            while True:
                r.Sphere(1, -1, 1, 360)
        self.assertEqual((str(caught.exception), caught.exception.status), ("the renderer ended by signal 9", -9))
        with self.assertRaisesRegex(gelato.GelatoError, "ended by signal 9"):
            r.World()
        self.assertEqual(r.finish(), -9)
        self.assertLess(time.monotonic() - begin, 10)

    def test_a_renderer_that_ends_before_its_answer(self):
        # The program tells why, and ends while the large call is sent.
        self.replaced(
            "text = b'there is no memory'\n"
            "payload = struct.pack('<4I', 2048, 0, 0, 0) + struct.pack('<I', len(text)) + text\n"
            "sys.stdout.buffer.write(b'M' + struct.pack('<I', len(payload)) + payload)\n"
            "sys.stdout.flush()\n"
            "sys.exit(3)\n"
        )
        for use in (lambda r: r.GetAttribute("float x"), lambda r: r.Parameter("vertex float x", range(10_000_000))):
            with self.assertRaises(gelato.GelatoError) as caught:
                use(gelato.Renderer())
            self.assertEqual(caught.exception.status, 3)
            self.assertEqual(str(caught.exception), "the renderer ended with status 3: error: there is no memory")

    def test_a_renderer_whose_pipe_stays_open(self):
        """A program that inherited the pipe goes on after the renderer."""
        self.replaced("import subprocess\nsubprocess.Popen(['sleep', '5'], stderr=subprocess.DEVNULL)\nos._exit(4)\n")
        begin = time.monotonic()
        with self.assertRaisesRegex(gelato.GelatoError, "ended with status 4"):
            gelato.Renderer().GetAttribute("float x")
        self.assertLess(time.monotonic() - begin, 4)

    def test_answers_that_make_no_sense(self):
        # A short message and parts of images come before the answer W. The answer I has no content.
        self.replaced(
            "def say(kind, payload):\n"
            "    sys.stdout.buffer.write(kind + struct.pack('<I', len(payload)) + payload)\n"
            "    sys.stdout.flush()\n"
            "while True:\n"
            "    head = sys.stdin.buffer.read(5)\n"
            "    if len(head) < 5: break\n"
            "    sys.stdin.buffer.read(struct.unpack('<I', head[1:])[0])\n"
            "    if head[:1] == b'W':\n"
            "        for kind in (b'M', b'O', b'S'): say(kind, b'12')\n"
            "        say(b'W', struct.pack('<I', 7))\n"
            "    if head[:1] == b'I': say(b'I', b'\\1')\n"
        )
        r = gelato.Renderer()
        with self.assertRaisesRegex(gelato.GelatoError, "something unreadable"):
            r.Render()
        with self.assertRaisesRegex(gelato.GelatoError, "something unreadable"):
            r.image_info("a.tif")
        self.assertEqual(r.finish(), 0)

    def test_an_interrupt_ends_the_renderer(self):
        program = (
            "import sys, os, signal, threading\n"
            "sys.path.insert(0, %r)\n"
            "from test_gelato import Rendering\n"
            "import gelato\n"
            "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
            "r = gelato.Renderer()\n"
            "Rendering.heavy(None, r)\n"
            "child = r._process.child\n"
            "threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()\n"
            "try:\n"
            "    r.render()\n"
            "except KeyboardInterrupt:\n"
            "    print(child.poll() is not None)\n"
            "try:\n"
            "    r.World()\n"
            "except gelato.GelatoError as error:\n"
            "    print(error)\n" % FOLDER
        )
        begin = time.monotonic()
        ran = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
        self.assertEqual((ran.stdout, ran.stderr), ("True\nthe renderer was ended by an interrupt\n", ""))
        self.assertLess(time.monotonic() - begin, 15)

    @unittest.skipIf(not hasattr(os, "fork"), "processes are not forked here")
    def test_a_forked_process_has_no_renderer(self):
        with gelato.Renderer() as r:
            r.World()
            read, write = os.pipe()
            child = os.fork()
            if child == 0:
                try:
                    r.GetAttribute("string name")
                except gelato.GelatoError as error:
                    os.write(write, str(error).encode())
                os._exit(0)
            os.close(write)
            os.waitpid(child, 0)
            with os.fdopen(read) as f:
                self.assertIn("belongs to the process", f.read())
            self.assertEqual(r.GetAttribute("string name"), "")


if __name__ == "__main__":
    unittest.main()
