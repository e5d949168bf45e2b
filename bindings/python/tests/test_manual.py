"""Runs each example of the manual."""

import os
import unittest

from support import Scratch, run_examples


class Manual(Scratch):
    def test_every_example_runs(self):
        self.assertGreater(run_examples(self, "python.md"), 6)
        for name in ("ball.png", "ball.tif", "ball.tx", "blocks.pyg"):
            self.assertTrue(os.path.exists(name), name)
        self.assertEqual(run_examples(self, "howto.md"), 1)

    def test_the_example_of_rerendering_runs(self):
        self.assertEqual(run_examples(self, "rerender.md"), 1)


if __name__ == "__main__":
    unittest.main()
