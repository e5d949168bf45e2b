"""What the tests share. ``cargo test -p granita-tests --test python`` runs them. ``GELATO`` must name the program."""

import os
import sys
import tempfile
import unittest

FOLDER = os.path.dirname(os.path.abspath(__file__))
PACKAGE = os.path.dirname(FOLDER)

sys.path.insert(0, PACKAGE)

try:
    import numpy
except ImportError:
    numpy = None

needs_numpy = unittest.skipIf(numpy is None, "numpy is not installed")


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
