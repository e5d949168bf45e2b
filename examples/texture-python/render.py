"""Renders a floor of bricks and a mirror ball under a panorama, with numpy and granita.texture.

    python3 examples/texture-python/render.py

writes examples/texture-python/out/ball.png. Every ray has its differences to the rays of the next pixels, which are
traced through the reflection (H. Igehy, Tracing Ray Differentials, SIGGRAPH 1999). Textures are filtered under them.
`--filter nearest` shows the same image without filtering, and `--filter split` both beside each other.
"""

import argparse
import os
import struct
import zlib

import numpy as np

from granita.texture import TextureSystem

HERE = os.path.dirname(os.path.abspath(__file__))

BALL, RADIUS = np.array([0.0, 1.0, 0.0], "f4"), 1.0
"""The centre and the radius of the ball. The floor is the plane y = 0."""

BRICKS = 0.35
"""The repetitions of the texture in one unit of the floor."""


def dot(a, b):
    return (a * b).sum(-1, keepdims=True)


class Rays:
    """Rays from `o` along `d`, and the differences of both to the rays of the next pixel in x and in y."""

    def __init__(self, o, d, do, dd):
        self.o, self.d, self.do, self.dd = o, d, do, dd

    def __getitem__(self, mask):
        one = [a[mask] for a in (self.o, self.d)]
        return Rays(*one, [a[mask] for a in self.do], [a[mask] for a in self.dd])


def camera(width, height):
    """Returns a ray for each pixel."""
    eye, to, fov = np.array([2.2, 1.9, -5.2], "f4"), np.array([0.2, 0.75, 0.0], "f4"), np.radians(40)
    forward = (to - eye) / np.linalg.norm(to - eye)
    right = np.cross([0, 1, 0], forward)
    right /= np.linalg.norm(right)
    up = np.cross(forward, right)
    scale = 2 * np.tan(fov / 2) / height
    x, y = np.meshgrid(np.arange(width) + 0.5 - width / 2, height / 2 - np.arange(height) - 0.5)
    long = forward + scale * (x[..., None] * right + y[..., None] * up)
    length = np.linalg.norm(long, axis=-1, keepdims=True)
    d = long / length

    def change(step):
        return (step - d * dot(d, step)) / length

    o = np.broadcast_to(eye, d.shape)
    none = np.zeros_like(d)
    dd = [change(scale * right), change(-scale * up)]
    return Rays(*(a.astype("f4") for a in (o, d)), [none.astype("f4")] * 2, [a.astype("f4") for a in dd])


def moved(rays, t, n):
    """Returns the points at the distances `t`, where surfaces have the normals `n`, and the differences of the points."""
    p = rays.o + t * rays.d
    dp = [do + t * dd for do, dd in zip(rays.do, rays.dd)]
    return p, [v - rays.d * (dot(v, n) / dot(rays.d, n)) for v in dp]


class Scene:
    def __init__(self, system, filter):
        # The panorama and the bricks have no MIP levels: they are made in memory.
        folder = os.path.join(HERE, "..", "first")
        self.system, self.filter = system, filter
        self.bricks = system.open(os.path.join(folder, "brick.png"))
        self.sky = system.open(os.path.join(folder, "studio.exr"))

    def look_up_sky(self, r, drdx=None, drdy=None, angle=None):
        if self.filter == "nearest":
            drdx = drdy = None
        return self.system.environment(self.sky, r, drdx, drdy, angle=angle, channels=3)

    def floor(self, rays):
        """Returns the colour of the floor, which is lit by the panorama. The ball hides a part of it."""
        n = np.array([0, 1, 0], "f4")
        p, (dpdx, dpdy) = moved(rays, -rays.o[..., 1:2] / rays.d[..., 1:2], n)
        # Texture coordinates are columns of the positions. They are passed with their strides, and not copied.
        p, dpdx, dpdy = p * BRICKS, dpdx * BRICKS, dpdy * BRICKS
        value = self.system.texture(
            self.bricks, p[..., 0], p[..., 2], dpdx[..., 0], dpdx[..., 2], dpdy[..., 0], dpdy[..., 2],
            wrap="periodic", filter=self.filter, channels=1,
        )  # fmt: skip
        brick, mortar = np.array([0.20, 0.06, 0.03], "f4"), np.array([0.35, 0.32, 0.28], "f4")
        light = np.array(self.look_up_sky([0.0, 1.0, 0.0], angle=1.2), "f4")
        to_ball = BALL - p / BRICKS
        squared = dot(to_ball, to_ball)
        hidden = to_ball[..., 1:2] / np.sqrt(squared) * np.minimum(RADIUS**2 / squared, 1)
        return (brick + (mortar - brick) * value) * light * (1 - hidden)

    def surroundings(self, rays):
        """Returns the colour of rays that do not hit the ball."""
        colour = np.empty_like(rays.d)
        down = rays.d[..., 1] < -1e-4
        colour[~down] = self.look_up_sky(*(a[~down] for a in (rays.d, *rays.dd)))
        colour[down] = self.floor(rays[down])
        return colour

    def colour(self, rays):
        """Returns the colour of each ray."""
        away = rays.o - BALL
        b = dot(away, rays.d)
        discriminant = b * b - dot(away, away) + RADIUS**2
        hit = discriminant[..., 0] > 0
        colour = np.empty_like(rays.d)
        colour[~hit] = self.surroundings(rays[~hit])
        seen, b = rays[hit], b[hit]
        t = -b - np.sqrt(discriminant[hit])
        n = (seen.o + t * seen.d - BALL) / RADIUS
        p, dp = moved(seen, t, n)
        cosine = dot(seen.d, n)
        turned = []
        for v, dd in zip(dp, seen.dd):
            dn = v / RADIUS
            turned.append(dd - 2 * ((dot(dd, n) + dot(seen.d, dn)) * n + cosine * dn))
        mirrored = Rays(p, seen.d - 2 * cosine * n, dp, turned)
        # Schlick's approximation for a metal.
        strength = 0.75 + 0.25 * (1 + cosine) ** 5
        colour[hit] = strength * self.surroundings(mirrored)
        return colour


def write_png(path, colour):
    """Writes linear colours as sRGB of 8 bits."""
    c = np.clip(colour, 0, 1)
    c = np.where(c <= 0.0031308, 12.92 * c, 1.055 * c ** (1 / 2.4) - 0.055)
    height, width, _ = c.shape
    rows = np.zeros((height, 1 + 3 * width), "u1")
    rows[:, 1:] = np.round(255 * c).astype("u1").reshape(height, -1)

    def chunk(kind, data):
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    with open(path, "wb") as f:
        f.write(b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">2I5B", width, height, 8, 2, 0, 0, 0)))
        f.write(chunk(b"IDAT", zlib.compress(rows.tobytes(), 9)) + chunk(b"IEND", b""))


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--size", nargs=2, type=int, default=(640, 400), metavar=("WIDTH", "HEIGHT"))
    parser.add_argument("--filter", choices=("gaussian", "bilinear", "nearest", "split"), default="gaussian")
    parser.add_argument("--threads", type=int, default=0, help="0 (the default) is one for each processor")
    parser.add_argument("--output", default=os.path.join(HERE, "out", "ball.png"))
    options = parser.parse_args()
    width, height = options.size
    with TextureSystem(memory=64 << 20, threads=options.threads, on_message=lambda severity, text: None) as system:
        rays = camera(width, height)
        if options.filter == "split":
            colour = Scene(system, "gaussian").colour(rays)
            colour[:, : width // 2] = Scene(system, "nearest").colour(rays)[:, : width // 2]
        else:
            colour = Scene(system, options.filter).colour(rays)
        counts = system.statistics()
    os.makedirs(os.path.dirname(os.path.abspath(options.output)), exist_ok=True)
    write_png(options.output, colour)
    print("%s: %d x %d pixels, %d lookups" % (options.output, width, height, counts["lookups"]))


if __name__ == "__main__":
    main()
