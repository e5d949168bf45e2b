"""Compares lookups of granita.texture, from Python, with those of OpenImageIO's TextureSystem, from C++.

    cargo build --release -p libgranita-texture -p maketx
    python3 benches/peers/texture_python.py [--points 1000000] [--runs 5] [--target target/release]

Both look up the same texture at the same points with the same derivatives: three channels of bytes, 4096 x 4096 texels.
Python makes one call for all points, and the C++ program (oiio_texture.cpp, which is compiled here) calls `texture` for
each point, with the default options of that library. The numbers are millions of lookups a second by the wall clock, the
best of all runs, with one thread and with two. The error is the largest difference of the means of 64 x 64 blocks of
points, in code values of 255: both look up the same. Needs numpy, and for the other side c++ and libopenimageio-dev
(`OIIO_BUILD` replaces the arguments of the compiler).
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
sys.path.insert(0, os.path.join(ROOT, "bindings", "python"))

import numpy as np  # noqa: E402

SIDE = 4096
BUILD = "-I/usr/include/Imath -lOpenImageIO -lOpenImageIO_Util -lpthread"
DEFAULT = "anisotropic32"


def image(path):
    """Writes an image with detail of all sizes."""
    generator = np.random.default_rng(7)
    total = np.zeros((SIDE, SIDE, 3), "f4")
    side, weight = 16, 0.5
    while side <= SIDE:
        noise = generator.random((side, side, 3), "f4")
        total += weight * noise.repeat(SIDE // side, 0).repeat(SIDE // side, 1)
        side, weight = side * 4, weight * 0.55
    total *= 255 / total.max()
    with open(path, "wb") as f:
        f.write(b"P6\n%d %d\n255\n" % (SIDE, SIDE) + total.astype("u1").tobytes())


def footprints(count):
    """Yields sets of points: a name, and the six numbers of each point."""
    side = int(count**0.5)
    y, x = np.mgrid[:side, :side].astype("f4")
    zero = np.zeros_like(x)

    def camera(across, down, angle):
        """Points of the pixels of an image. A step in x is `across` texels, and one in y is `down` texels."""
        c, s = np.cos(angle), np.sin(angle)
        dx, dy = (across * c / SIDE, across * s / SIDE), (-down * s / SIDE, down * c / SIDE)
        return [0.1 + x * dx[0] + y * dy[0], 0.1 + x * dx[1] + y * dy[1], *(zero + d for d in (*dx, *dy))]

    yield "pixels of 1.5 x 1.5 texels", camera(1.5, 1.5, 0.3)
    yield "pixels of 2 x 8 texels", camera(2, 8, 0.3)
    yield "enlarged, 0.2 x 0.2 texels", camera(0.2, 0.2, 0.3)
    yield "no derivatives", [*camera(1.5, 1.5, 0.3)[:2], zero, zero, zero, zero]
    # A floor that is seen to the horizon: from enlarged texels to footprints of 40 : 1.
    depth = 1 / (0.02 + y / side)
    across = depth / side * 0.5
    down = -(depth**2) / side * 0.5
    centred = x / side - 0.5
    yield "a floor to the horizon", [centred * depth * 0.5, depth * 0.5, across, zero, centred * down, down]


def theirs(program, texture, points, place, runs):
    """Returns the values and the seconds with one thread and two."""
    asked, answered = os.path.join(place, "points.bin"), os.path.join(place, "values.bin")
    np.stack([p.ravel() for p in points], axis=-1).astype("f4").tofile(asked)
    words = [program, texture, asked, answered, "3", str(runs), DEFAULT]
    ran = subprocess.run(words, capture_output=True, text=True, check=True)
    walls = [float(line.split()[3]) for line in ran.stdout.splitlines()]
    return np.fromfile(answered, "f4").reshape(-1, 3), walls


def ours(texture, points, runs):
    from granita.texture import TextureSystem

    points = [np.ascontiguousarray(p.ravel(), "f4") for p in points]
    out = np.empty((points[0].size, 3), "f4")
    walls = []
    for threads in (1, 2):
        best = float("inf")
        with TextureSystem(memory=1 << 30, threads=threads) as system:
            found = system.open(texture)
            for _ in range(runs):
                start = time.perf_counter()
                system.texture(found, *points, wrap="periodic", channels=3, out=out)
                best = min(best, time.perf_counter() - start)
        walls.append(best)
    return out, walls


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--points", type=int, default=1_000_000)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--target", default=os.path.join(ROOT, "target", "release"))
    options = parser.parse_args()
    os.environ.setdefault("GRANITA_TEXTURE_LIB", os.path.join(options.target, "libgranita_texture.so"))
    with tempfile.TemporaryDirectory() as place:
        picture, texture = os.path.join(place, "noise.ppm"), os.path.join(place, "noise.tx")
        image(picture)
        maketx = os.path.join(options.target, "maketx")
        subprocess.run([maketx, "-mode", "periodic", picture, "-o", texture], check=True)
        program = os.path.join(place, "oiio_texture")
        source = os.path.join(ROOT, "benches", "peers", "oiio_texture.cpp")
        compiler = ["c++", "-O2", "-std=c++17", source, "-o", program]
        compiler += os.environ.get("OIIO_BUILD", BUILD).split()
        built = subprocess.run(compiler, capture_output=True).returncode == 0
        if not built:
            print("no program against OpenImageIO could be built (c++, OIIO_BUILD): our lookups alone")
        print("%-28s %19s %19s %13s %6s" % ("millions of lookups a second", "Python, 1 and 2", "C++, 1 and 2", "ratios", "error"))
        for name, points in footprints(options.points):
            count = points[0].size
            value, first = ours(texture, points, options.runs)
            line = "%-28s" % name
            if not built:
                print(line, "%9.3f %9.3f" % tuple(count / wall / 1e6 for wall in first))
                continue
            other, walls = theirs(program, texture, points, place, options.runs)
            # Ours are measured before and after the others, because other work on the machine affects both.
            _, again = ours(texture, points, options.runs)
            own = [min(pair) for pair in zip(first, again)]
            whole = count // 4096 * 4096
            error = np.abs((value - other)[:whole].reshape(-1, 4096, 3).mean(1)).max() * 255
            rates = [count / wall / 1e6 for wall in (*own, *walls)]
            ratios = (walls[0] / own[0], walls[0] / own[1])
            print(line, "%9.3f %9.3f %9.3f %9.3f %6.2f %6.2f %6.2f" % (*rates, *ratios, error), flush=True)


if __name__ == "__main__":
    main()
