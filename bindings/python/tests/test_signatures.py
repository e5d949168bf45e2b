"""Tests the calls that ``generate.py`` writes: their signatures, their texts, and that the renderer takes them."""

import inspect
import os
import subprocess
import sys
import unittest

from support import PACKAGE, Scratch  # isort: skip

import gelato
from gelato import _calls

sys.path.insert(0, PACKAGE)
import generate  # noqa: E402


class Signatures(Scratch):
    def test_the_files_are_up_to_date(self):
        script = os.path.join(PACKAGE, "generate.py")
        ran = subprocess.run([sys.executable, script, "--check"], capture_output=True, text=True)
        self.assertEqual((ran.returncode, ran.stderr), (0, ""))

    @unittest.skipIf("GELATO_CALLS" not in os.environ, "GELATO_CALLS does not name the renderer's calls")
    def test_every_call_of_the_renderer_is_there(self):
        self.assertEqual(sorted(_calls.CALLS), sorted(os.environ["GELATO_CALLS"].split()))

    def test_methods_and_functions_tell_their_arguments(self):
        for name in _calls.CALLS:
            for owner in (gelato.Renderer, gelato):
                function = getattr(owner, name)
                self.assertTrue(inspect.getdoc(function), name)
                for parameter in inspect.signature(function).parameters.values():
                    typed = parameter.annotation is not inspect.Parameter.empty
                    self.assertTrue(typed or parameter.name == "self", name)
            self.assertIn(name, gelato.__all__)
        words = str(inspect.signature(gelato.Sphere))
        self.assertTrue(words.startswith("(radius: float, zmin: float, zmax: float, thetamax: float, *params: "), words)
        self.assertEqual(list(inspect.signature(gelato.Translate).parameters), ["x", "y", "z"])
        self.assertTrue(os.path.exists(os.path.join(PACKAGE, "gelato", "py.typed")))

    def test_the_renderer_takes_every_call(self):
        with gelato.CreateRenderer("all.pyg") as r:
            for name, (_, _, example) in generate.CALLS.items():
                getattr(r, name)(*eval(example))
                self.assertEqual(r.errors, 0, name)
            # All arguments have names.
            r.Sphere(radius=1, zmin=-1, zmax=1, thetamax=360)
            r.Attribute(name="color C", value=(1, 0.5, 0.25))
            # A sequence may be written as its numbers.
            r.Attribute("color C", 1, 0.5, 0.25)
            r.Translate([1, 2, 3])
            r.Shader("surface")
            r.Render("main")
            self.assertEqual(r.errors, 0)
        with open("all.pyg", encoding="ascii") as f:
            lines = f.read().splitlines()
        for name in generate.CALLS:
            if name not in ("Parameter", "Comment"):
                self.assertTrue(any(line.startswith(name + " (") for line in lines), name)
        self.assertEqual(
            lines[-6:],
            [
                "Sphere (1, -1, 1, 360)",
                'Attribute ("color C", (1, 0.5, 0.25))',
                'Attribute ("color C", (1, 0.5, 0.25))',
                "Translate (1, 2, 3)",
                'Shader ("surface")',
                'Render ("main")',
            ],
        )


if __name__ == "__main__":
    unittest.main()
