"""The scenes of benches/peers/light.py and effects.py: shapes, cameras and lights as numbers, the same for every program.

World space is right handed, with y up. Angles are in degrees. The field of view is that of a side of the image, which
is square.
"""

from dataclasses import dataclass, field

import numpy as np

WHITE = (0.73,) * 3


@dataclass
class Shape:
    """Quads or spheres of one matte colour, or a file of triangles with normals at the vertices."""
    name: str
    color: tuple
    quads: list = field(default_factory=list)
    file: str = ""
    # The centres and radii (x, y, z, r).
    spheres: list = field(default_factory=list)
    # How much brighter than white the middle of a highlight is, of a surface that has one. Its size is fixed.
    highlight: float = 0.0
    # The angle in radians of the cone of rays that a blurred mirror reflects; 0 for matte surfaces.
    mirror: float = 0.0


@dataclass
class Scene:
    name: str
    shapes: list
    origin: tuple
    target: tuple
    fov: float
    # The position of a point light with the radiant intensity pi * `strength`, per steradian and channel.
    lamp: tuple = None
    # The direction in which sunlight of the irradiance pi * `strength` travels. It is used when there is no lamp.
    sun: tuple = None
    strength: float = 1.0
    # The file of the panorama whose light is compared.
    panorama: str = ""
    # The radius of the lens and the distance that is in focus; `None` for a pinhole.
    lens: tuple = None


def block(top):
    down = [(x, 0, z) for x, _, z in top]
    return [top] + [[down[i], top[i], top[(i + 1) % 4], down[(i + 1) % 4]] for i in range(4)]


def cornell():
    """Returns the Cornell box, with the measurements that Cornell University published, under a point light."""
    floor = [(0, 0, 0), (0, 0, 559.2), (556, 0, 559.2), (556, 0, 0)]
    ceiling = [(0, 548.8, 0), (556, 548.8, 0), (556, 548.8, 559.2), (0, 548.8, 559.2)]
    back = [(0, 0, 559.2), (0, 548.8, 559.2), (556, 548.8, 559.2), (556, 0, 559.2)]
    right = [(0, 0, 0), (0, 548.8, 0), (0, 548.8, 559.2), (0, 0, 559.2)]
    left = [(556, 0, 0), (556, 0, 559.2), (556, 548.8, 559.2), (556, 548.8, 0)]
    short = [(130, 165, 65), (82, 165, 225), (240, 165, 272), (290, 165, 114)]
    tall = [(423, 330, 247), (265, 330, 296), (314, 330, 456), (472, 330, 406)]
    shapes = [
        Shape("floor", WHITE, [floor]), Shape("ceiling", WHITE, [ceiling]), Shape("back", WHITE, [back]),
        Shape("right", (0.12, 0.45, 0.15), [right]), Shape("left", (0.65, 0.05, 0.05), [left]),
        Shape("short", WHITE, block(short)), Shape("tall", WHITE, block(tall)),
    ]
    return Scene("Cornell box", shapes, (278, 273, -800), (278, 273, 0), 39.3, lamp=(278, 450, 279.5), strength=40000.0)


def upright(low, high):
    """Returns the quads of an axis-aligned box without its lower side."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    return [
        [(x0, y1, z0), (x0, y1, z1), (x1, y1, z1), (x1, y1, z0)],
        [(x0, y0, z0), (x0, y1, z0), (x1, y1, z0), (x1, y0, z0)],
        [(x0, y0, z1), (x1, y0, z1), (x1, y1, z1), (x0, y1, z1)],
        [(x0, y0, z0), (x0, y0, z1), (x0, y1, z1), (x0, y1, z0)],
        [(x1, y0, z0), (x1, y1, z0), (x1, y1, z1), (x1, y0, z1)],
    ]


def room():
    """Returns a room of 6 x 3 x 8 metres (in centimetres) with one window, through which the sun shines on the floor
    and a table."""
    x, y, z = 600, 300, 800
    low, high, near, far = 90, 240, 300, 560
    wall = [
        [(x, 0, 0), (x, 0, z), (x, low, z), (x, low, 0)], [(x, high, 0), (x, high, z), (x, y, z), (x, y, 0)],
        [(x, low, 0), (x, low, near), (x, high, near), (x, high, 0)], [(x, low, far), (x, low, z), (x, high, z), (x, high, far)],
    ]
    legs = [q for a in (200, 350) for b in (330, 510) for q in upright((a, 0, b), (a + 10, 70, b + 10))]
    top = upright((190, 70, 320), (370, 76, 530)) + [[(190, 70, 320), (370, 70, 320), (370, 70, 530), (190, 70, 530)]]
    shapes = [
        Shape("floor", (0.5, 0.4, 0.3), [[(0, 0, 0), (0, 0, z), (x, 0, z), (x, 0, 0)]]),
        Shape("ceiling", (0.8, 0.8, 0.8), [[(0, y, 0), (x, y, 0), (x, y, z), (0, y, z)]]),
        Shape("back", (0.75, 0.7, 0.6), [[(0, 0, z), (0, y, z), (x, y, z), (x, 0, z)]]),
        Shape("front", (0.75, 0.7, 0.6), [[(0, 0, 0), (x, 0, 0), (x, y, 0), (0, y, 0)]]),
        Shape("left", (0.6, 0.65, 0.75), [[(0, 0, 0), (0, y, 0), (0, y, z), (0, 0, z)]]),
        Shape("window", (0.75, 0.7, 0.6), wall),
        Shape("table", (0.55, 0.35, 0.2), legs + top),
        Shape("cupboard", (0.7, 0.7, 0.7), upright((0, 0, 600), (60, 200, 780))),
    ]
    return Scene("Room with a window", shapes, (300, 150, 20), (300, 120, 800), 70, sun=(-0.75, -0.6, 0.12), strength=4.0)


def on_a_floor(mesh, vertices, panorama):
    """Returns a scene with a mesh of `vertices` on a floor, under a panorama."""
    low, high = vertices.min(0), vertices.max(0)
    size = float((high - low).max())
    middle = [float(v) for v in 0.5 * (low + high)]
    ground, far = float(low[1]), 3 * size
    floor = [(middle[0] - far, ground, middle[2] - far), (middle[0] - far, ground, middle[2] + far),
             (middle[0] + far, ground, middle[2] + far), (middle[0] + far, ground, middle[2] - far)]
    eye = (middle[0] + 0.3 * size, middle[1] + 0.6 * size, middle[2] + 2.0 * size)
    shapes = [Shape("floor", (0.5, 0.5, 0.5), [floor]), Shape("mesh", (0.7, 0.7, 0.7), file=mesh)]
    return Scene("Mesh on a floor", shapes, eye, tuple(middle), 34, panorama=panorama)


def out_of_focus():
    """Returns thirty balls with small highlights, most of them out of focus."""
    at = [(k % 5, k // 5) for k in range(30)]
    balls = [Shape(f"ball{k}", (0.1 * (2 + k % 7), 0.3, 0.1 * (1 + k % 8)), spheres=[(1.2 * i - 2.4, -0.6 + 0.2 * j, 3 + 1.8 * j, 0.4)],
                   highlight=8.0) for k, (i, j) in enumerate(at)]
    floor = Shape("floor", (0.5, 0.5, 0.5), [[(-8, -1, -2), (-8, -1, 16), (8, -1, 16), (8, -1, -2)]])
    sun = tuple(float(v) for v in np.array((1, -2, 1.5)) / np.linalg.norm((1, -2, 1.5)))
    return Scene("Balls out of focus", balls + [floor], (0, 0, 0), (0, 0, 1), 40, sun=sun, lens=(0.143, 6.0))


def glossy_floor():
    """Returns five balls on a blurred mirror."""
    balls = [Shape(f"ball{k}", (0.1 * (9 - k), 0.4, 0.1 * (1 + k)), spheres=[(1.3 * k - 2.6, -0.5, 6 + 0.5 * (k % 2), 0.5)])
             for k in range(5)]
    floor = Shape("floor", (0.7, 0.7, 0.75), [[(-8, -1, -2), (-8, -1, 12), (8, -1, 12), (8, -1, -2)]], mirror=0.15)
    wall = Shape("wall", (0.5, 0.5, 0.5), [[(-12, -1, 12), (-12, 8, 12), (12, 8, 12), (12, -1, 12)]])
    sun = tuple(float(v) for v in np.array((1, -2, 1.5)) / np.linalg.norm((1, -2, 1.5)))
    return Scene("Glossy floor", balls + [floor, wall], (0, 0.7, 0), (0, -0.14, 6), 45, sun=sun)


def read_mesh(path):
    """Returns the vertices and triangles of an OBJ or a PLY file (text, or little or big endian)."""
    if path.endswith(".obj"):
        vertices, triangles = [], []
        for words in (line.split() for line in open(path)):
            if words[:1] == ["v"]:
                vertices.append([float(w) for w in words[1:4]])
            elif words[:1] == ["f"]:
                ids = [int(w.split("/")[0]) for w in words[1:]]
                ids = [i - 1 if i > 0 else len(vertices) + i for i in ids]
                triangles += [(ids[0], ids[k], ids[k + 1]) for k in range(1, len(ids) - 1)]
        return np.array(vertices, np.float32), np.array(triangles)
    data = open(path, "rb").read()
    head, body = data.split(b"end_header\n", 1)
    lines = [line.split() for line in head.decode().splitlines()]
    kind = next(w[1] for w in lines if w[0] == "format")
    counts = {w[1]: int(w[2]) for w in lines if w[0] == "element"}
    columns, inside = 0, False
    for words in lines:
        inside = words[1] == "vertex" if words[0] == "element" else inside
        columns += inside and words[0] == "property"
    if kind == "ascii":
        rows = body.decode().splitlines()
        vertices = [[float(v) for v in r.split()[:3]] for r in rows[:counts["vertex"]]]
        triangles = [[int(v) for v in r.split()[1:4]] for r in rows[counts["vertex"]:counts["vertex"] + counts["face"]]]
        return np.array(vertices, np.float32), np.array(triangles)
    end = ">" if "big" in kind else "<"
    n = counts["vertex"] * columns * 4
    vertices = np.frombuffer(body[:n], end + "f4").reshape(-1, columns)[:, :3].astype(np.float32)
    faces = np.frombuffer(body[n:], np.dtype([("n", "u1"), ("v", end + "i4", 3)]), counts["face"])
    return vertices, faces["v"].astype(int)


def normals(vertices, triangles):
    """Returns the normals at vertices, which are the means of the normals of the faces, weighted by area."""
    a, b, c = (vertices[triangles[:, k]].astype(float) for k in range(3))
    flat = np.cross(b - a, c - a)
    out = np.zeros((len(vertices), 3))
    for k in range(3):
        np.add.at(out, triangles[:, k], flat)
    length = np.linalg.norm(out, axis=1, keepdims=True)
    return np.where(length > 0, out / np.maximum(length, 1e-30), [0, 1, 0])


def prepare(scene, place):
    """Writes each shape but spheres as an OBJ file. Returns the names of the files by shape. Meshes have normals at their
    vertices."""
    out = {}
    for shape in scene.shapes:
        if shape.spheres:
            continue
        path = out[shape.name] = f"{place}/{shape.name}.obj"
        with open(path, "w") as f:
            if shape.file:
                vertices, triangles = read_mesh(shape.file)
                for word, rows in (("v", vertices), ("vn", normals(vertices, triangles))):
                    f.writelines("%s %.9g %.9g %.9g\n" % (word, *row) for row in rows)
                f.writelines("f %d//%d %d//%d %d//%d\n" % tuple(i for v in t for i in (v + 1, v + 1)) for t in triangles)
                continue
            n = 1
            for quad in shape.quads:
                f.writelines("v %g %g %g\n" % tuple(p) for p in quad)
                f.write("f %d %d %d\nf %d %d %d\n" % (n, n + 1, n + 2, n, n + 2, n + 3))
                n += 4
    return out
