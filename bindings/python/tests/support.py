"""What the tests share. ``cargo test -p granita-tests --test python`` runs them. ``GELATO`` must name the program."""

import os
import re
import subprocess
import sys
import tempfile
import unittest

FOLDER = os.path.dirname(os.path.abspath(__file__))
PACKAGE = os.path.dirname(FOLDER)
DOCS = os.path.join(PACKAGE, "..", "..", "docs")

sys.path.insert(0, PACKAGE)

try:
    import numpy
except ImportError:
    numpy = None

needs_numpy = unittest.skipIf(numpy is None, "numpy is not installed")


class Unseen:
    """Hides numpy from the package."""

    def __enter__(self):
        self.before = {name: module for name, module in sys.modules.items() if name.split(".")[0] == "numpy"}
        for name in self.before:
            del sys.modules[name]

    def __exit__(self, *_):
        sys.modules.update(self.before)


class Scratch(unittest.TestCase):
    """Runs each test in an empty folder."""

    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        before = os.getcwd()
        os.chdir(self.folder.name)
        self.addCleanup(os.chdir, before)


def ball(r, resolution=(32, 24)):
    """Describes a flat ball of one colour in front of the camera."""
    r.Attribute("int[2] resolution", resolution)
    r.Translate(0, 0, 3)
    r.World()
    r.Shader("surface", "constant")
    r.Attribute("color C", (0.25, 0.5, 1))
    r.Sphere(1, -1, 1, 360)


def run_examples(case, page):
    """Runs the blocks of Python of a page and returns their number."""
    with open(os.path.join(DOCS, page), encoding="utf-8") as f:
        text = f.read()
    blocks = list(re.finditer(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL))
    path = os.pathsep.join(filter(None, [PACKAGE, os.environ.get("PYTHONPATH")]))
    environment = dict(os.environ, PYTHONPATH=path, PYTHONWARNINGS="error")
    for block in blocks:
        if "import numpy" in block.group(1) and numpy is None:
            continue
        with case.subTest(page=page, line=text.count("\n", 0, block.start()) + 2):
            ran = subprocess.run(
                [sys.executable, "-c", block.group(1)], env=environment, capture_output=True, text=True
            )
            case.assertEqual((ran.returncode, ran.stderr), (0, ""))
            # What an example prints stands behind it.
            for shown in re.findall(r"print\(.*?\)  # (.*)$", block.group(1), re.MULTILINE):
                case.assertIn(shown, ran.stdout)
    return len(blocks)
