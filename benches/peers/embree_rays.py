"""Measures Embree through embreex: embree_rays.py FOLDER. With --library it prints the path of Embree's library.

It reads the same files as embree_rays.c and prints the same lines.
"""

import pathlib
import sys
import time

import embreex
import numpy as np
from embreex import rtcore_scene
from embreex.mesh_construction import TriangleMesh

if sys.argv[1] == "--library":
    libraries = pathlib.Path(embreex.__file__).parent.parent / "embreex.libs"
    print(next(libraries.glob("libembree4*")))
    sys.exit()

folder = pathlib.Path(sys.argv[1])
v = np.fromfile(folder / "mesh.v", "<f4").reshape(-1, 3)
f = np.fromfile(folder / "mesh.f", "<i4").reshape(-1, 3)
scene = rtcore_scene.EmbreeScene()
mesh = TriangleMesh(scene, v, f)
for name in ["camera", "random", "bounce", "tiles", "shadow"]:
    rays = np.fromfile(folder / f"{name}.rays", "<f4").reshape(-1, 8)
    origins, dirs = (np.ascontiguousarray(rays[:, k : k + 3]) for k in (0, 4))
    scene.run(origins[:16], dirs[:16])
    for about, query in [("closest", "INTERSECT"), ("any", "OCCLUDED")]:
        start = time.thread_time()
        hits = scene.run(origins, dirs, query=query)
        print(name, about, time.thread_time() - start, int((np.asarray(hits) >= 0).sum()))
