"""Runs each example of the manual."""

import os
import re
import subprocess
import sys
import unittest

from support import PACKAGE, Scratch, numpy

DOCS = os.path.join(PACKAGE, "..", "..", "docs")


class Manual(Scratch):
    def test_every_example_runs(self):
        self.assertGreater(self.run_examples("python.md"), 6)
        for name in ("ball.png", "ball.tif", "ball.tx", "blocks.pyg"):
            self.assertTrue(os.path.exists(name), name)
        self.assertEqual(self.run_examples("howto.md"), 1)

    def test_the_example_of_rerendering_runs(self):
        self.assertEqual(self.run_examples("rerender.md"), 1)

    def run_examples(self, page):
        """Runs the blocks of Python of a page and returns their number."""
        with open(os.path.join(DOCS, page), encoding="utf-8") as f:
            text = f.read()
        blocks = list(re.finditer(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL))
        environment = dict(os.environ, PYTHONPATH=PACKAGE, PYTHONWARNINGS="error")
        for block in blocks:
            if "import numpy" in block.group(1) and numpy is None:
                continue
            with self.subTest(page=page, line=text.count("\n", 0, block.start()) + 2):
                ran = subprocess.run(
                    [sys.executable, "-c", block.group(1)], env=environment, capture_output=True, text=True
                )
                self.assertEqual((ran.returncode, ran.stderr), (0, ""))
                # What an example prints stands behind it.
                for shown in re.findall(r"print\(.*?\)  # (.*)$", block.group(1), re.MULTILINE):
                    self.assertIn(shown, ran.stdout)
        return len(blocks)


if __name__ == "__main__":
    unittest.main()
