"""The programs that benches/peers/light.py and effects.py compare with, as far as their packages are there."""

import os
import sys

try:
    import light_mitsuba
except ImportError:
    print(f"{os.path.basename(sys.argv[0])}: there is no package mitsuba: nothing to compare with")
    sys.exit(0)
try:
    import light_cycles
except ImportError:
    light_cycles = None
    print(f"{os.path.basename(sys.argv[0])}: there is no package bpy: no rows of Cycles")
