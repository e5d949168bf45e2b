"""Compares gelato with Aqsis 1.8 on the same RIB files.

    python3 benches/peers/aqsis.py --aqsis PREFIX [--gelato PATH] [--runs N] [--only WORD] [--samples N] [--keep FOLDER]

PREFIX is the folder into which Aqsis was installed, so that its programs are `PREFIX/bin/aqsis` and `PREFIX/bin/aqsl`.
Without them the script prints a line and ends. It needs Python 3.9 only.

Each file is rendered by both programs with 640 x 480 pixels, 4 x 4 samples per pixel (`--samples` changes the number
along a side), a shading rate of 1, the same filter, and one thread. The standard shaders of both programs are the same.
The script writes the one shader that is not among them for both. The programs alternate, and the fastest of `--runs`
runs counts. Times are those of whole programs from start to exit.

The last columns compare the images, which have floats in linear light. The difference is the root mean square of all
differences of colours, divided by the root mean square of the colours of Aqsis. Both programs take random samples,
so that the images differ by noise where edges are blurred. "smoothed" is the difference after each image was averaged
over blocks of 8 x 8 pixels, which removes most of the noise.

`--keep` writes the RIB files and the images to a folder.
"""

import argparse
import math
import operator
import os
import pathlib
import random
import resource
import struct
import subprocess
import sys
import tempfile
import time
from array import array

WIDTH, HEIGHT = 640, 480
# The largest difference of the images.
EQUAL = 0.02
# How many times as fast as Aqsis gelato should be.
STATIC, BLURRED = 3, 8

# A displacement in both shading languages.
RIPPLES_SL = """displacement ripples (float Km = 0.03; float waves = 20;)
{
    P += Km * sin (2 * PI * waves * u) * sin (PI * waves * v) * normalize (N);
    N = calculatenormal (P);
}
"""
RIPPLES_GSL = """displacement ripples (float Km = 0.03, float waves = 20)
{
    P += Km * sin (2 * PI * waves * u) * sin (PI * waves * v) * normalize (N);
    N = surfacenormal (P);
}
"""


def numbers(values):
    """Returns numbers in brackets, as RIB writes an array."""
    return "[" + " ".join(f"{v:.6g}" for v in values) + "]"


def colour(chance):
    return "Color " + numbers(chance.uniform(0.2, 1) for _ in range(3))


def spheres(count, moving=False):
    """Returns spheres at random places in front of the camera. Those that move do so by about their diameter."""
    chance, lines = random.Random(count), []
    for _ in range(count):
        z = chance.uniform(6, 30)
        place = [chance.uniform(-0.48, 0.48) * z, chance.uniform(-0.36, 0.36) * z, z]
        lines += ["AttributeBegin", colour(chance)]
        start = "Translate " + " ".join(f"{v:.6g}" for v in place)
        if moving:
            end = "Translate " + " ".join(f"{v + chance.uniform(-0.4, 0.4):.6g}" for v in place)
            lines += ["MotionBegin [0 1]", start, end, "MotionEnd"]
        else:
            lines += [start]
        lines += ["Sphere 0.3 -0.3 0.3 360", "AttributeEnd"]
    return lines


def ball(*before):
    """Returns one sphere that fills most of the image."""
    return ["AttributeBegin", "Color [0.8 0.5 0.3]", *before, "Translate 0 0 4", "Rotate -70 1 0 0", "Sphere 1.2 -1.2 1.2 360", "AttributeEnd"]


def fur(count, moving=False):
    """Returns curves that stand on a hidden ball. Tips of those that move sway."""
    chance, roots, tips, colours = random.Random(count), [], [], []
    for _ in range(count):
        y, turn = chance.uniform(-1, 1), chance.uniform(0, 2 * math.pi)
        across = math.sqrt(1 - y * y)
        normal = [across * math.cos(turn), y, across * math.sin(turn)]
        lean = [chance.uniform(-0.15, 0.15) for _ in range(3)]
        lean[1] -= 0.12
        roots.append((normal, lean))
        colours += [chance.uniform(0.3, 1), chance.uniform(0.2, 0.6), chance.uniform(0.1, 0.3)]

    def curves(sway):
        points = []
        for normal, lean in roots:
            for k in range(4):
                bend = (k / 3) ** 2
                points += [n * (0.9 + 0.12 * k) + bend * l + (bend * sway if axis == 0 else 0) for axis, (n, l) in enumerate(zip(normal, lean))]
        return (f'Curves "cubic" {numbers([4] * count)} "nonperiodic" "P" {numbers(points)} '
                f'"uniform color Cs" {numbers(colours)} "constantwidth" [0.012]')

    shapes = ["MotionBegin [0 1]", curves(0), curves(0.2), "MotionEnd"] if moving else [curves(0)]
    return ["AttributeBegin", "Translate 0 0 96", 'Basis "bezier" 3 "bezier" 3', *shapes, "Color [0.3 0.15 0.1]",
            "Sphere 0.92 -0.92 0.92 360", "AttributeEnd"]


def torus(rows, columns, bump):
    """Returns the faces, vertices and normals of a torus of quadrilaterals whose thickness varies."""

    def vertex(a, b):
        r = 0.45 + bump * math.sin(5 * b) * math.cos(3 * a)
        return ((1.1 + r * math.cos(a)) * math.cos(b), (1.1 + r * math.cos(a)) * math.sin(b), r * math.sin(a))

    faces, points, normals, step = [], [], [], 1e-4
    for j in range(rows):
        for i in range(columns):
            a, b = 2 * math.pi * j / rows, 2 * math.pi * i / columns
            points += vertex(a, b)
            (x, y, z), (u, v, w) = ([(p - q) / step for p, q in zip(end, vertex(a, b))] for end in (vertex(a, b + step), vertex(a + step, b)))
            normals += [y * w - z * v, z * u - x * w, x * v - y * u]
            n, e = (j + 1) % rows, (i + 1) % columns
            faces += [j * columns + i, j * columns + e, n * columns + e, n * columns + i]
    return numbers([4] * (rows * columns)), numbers(faces), numbers(points), numbers(normals)


def turned(*lines):
    return ["AttributeBegin", "Color [0.4 0.7 0.5]", "Translate 0 0 4.5", "Rotate -50 1 0 0", *lines, "AttributeEnd"]


def polygons():
    sizes, faces, points, normals = torus(120, 240, 0.08)
    return turned(f'PointsPolygons {sizes} {faces} "P" {points} "N" {normals}')


def subdivision():
    sizes, faces, points, _ = torus(12, 24, 0.12)
    return turned(f'SubdivisionMesh "catmull-clark" {sizes} {faces} ["interpolateboundary"] [0 0] [] [] "P" {points}')


def layers(count):
    """Returns transparent squares behind each other. Each covers a large part of the image."""
    chance, lines = random.Random(count), []
    for k in range(count):
        x, y, z = chance.uniform(-1, 1), chance.uniform(-0.7, 0.7), 3 + 6 * k / count
        opacity = chance.uniform(0.05, 0.3)
        lines += ["AttributeBegin", colour(chance), f"Opacity {numbers([opacity] * 3)}", f"Translate {x:.6g} {y:.6g} {z:.6g}",
                  f"Rotate {chance.uniform(0, 90):.6g} 0 0 1", f"Rotate {chance.uniform(-20, 20):.6g} 1 0 0",
                  'Polygon "P" [-1.2 -1.2 0 -1.2 1.2 0 1.2 1.2 0 1.2 -1.2 0]', "AttributeEnd"]
    return lines


RIPPLED = ('Displacement "ripples"', 'Attribute "displacementbound" "float sphere" [0.04]')
# Aqsis turns curves to face the axis of the camera, not the eye. From far away both are the same.
FAR = ('Projection "perspective" "float fov" [2]',)
# Everything is behind the plane of focus. Aqsis blurs what is before it and what is behind it with the same sign, so that
# what a blurred edge shows of farther objects would differ.
LENS = ("DepthOfField 1.4 0.5 5",)
MOTION = ("Shutter 0 1",)
# Each scene: its name, how many times as fast gelato should be, requests before the world, and its objects.
SCENES = [
    ("5000 spheres", STATIC, (), lambda: spheres(5000)),
    ("2000 moving spheres", BLURRED, MOTION, lambda: spheres(2000, True)),
    ("2000 spheres, depth of field", BLURRED, LENS, lambda: spheres(2000)),
    ("one large sphere", STATIC, (), ball),
    ("displaced sphere", STATIC, (), lambda: ball(*RIPPLED)),
    ("20,000 curves", STATIC, FAR, lambda: fur(20000)),
    ("20,000 moving curves", BLURRED, FAR + MOTION, lambda: fur(20000, True)),
    ("28,800 polygons", STATIC, (), polygons),
    ("subdivision mesh", STATIC, (), subdivision),
    ("40 transparent layers", STATIC, (), lambda: layers(40)),
]


def rib(shaders, samples, options, objects):
    """Returns the text of a RIB file that renders out.tif, an image of floats without compression."""
    return "\n".join([
        "##RenderMan RIB-Structure 1.0", "version 3.03",
        f'Option "searchpath" "string shader" ["{shaders}:&"]',
        'Display "out.tif" "file" "rgba" "string compression" ["none"]', "Quantize \"rgba\" 0 0 0 0",
        f"Format {WIDTH} {HEIGHT} 1", f"PixelSamples {samples} {samples}", 'PixelFilter "gaussian" 2 2',
        'Projection "perspective" "float fov" [40]', "Clipping 0.1 1000", *options, "WorldBegin",
        'LightSource "ambientlight" 1 "float intensity" [0.1]',
        'LightSource "distantlight" 2 "float intensity" [0.9] "point from" [-1 1 -1.5] "point to" [0 0 0]',
        'ShadingRate 1', 'ShadingInterpolation "smooth"', 'Surface "plastic"',
        *objects, "WorldEnd", ""])


def read(path):
    """Returns the red, green and blue values of an uncompressed TIFF of floats, as three arrays."""
    data = pathlib.Path(path).read_bytes()
    order = "<" if data[:2] == b"II" else ">"
    place, = struct.unpack_from(order + "I", data, 4)
    count, = struct.unpack_from(order + "H", data, place)
    tags = {}
    for k in range(count):
        tag, kind, number = struct.unpack_from(order + "HHI", data, place + 2 + 12 * k)
        letter, size = {1: ("B", 1), 3: ("H", 2), 4: ("I", 4)}.get(kind, (None, 0))
        if letter:
            at = place + 10 + 12 * k
            if number * size > 4:
                at, = struct.unpack_from(order + "I", data, at)
            tags[tag] = struct.unpack_from(f"{order}{number}{letter}", data, at)
    width, height, channels = tags[256][0], tags[257][0], tags.get(277, (1,))[0]
    compression, planar, kind = (tags.get(tag, (1,))[0] for tag in (259, 284, 339))
    if (width, height, compression, planar, kind) != (WIDTH, HEIGHT, 1, 1, 3) or tags[258][0] != 32 or 273 not in tags:
        raise ValueError(f"{path}: not an uncompressed image of {WIDTH} x {HEIGHT} floats in strips")
    values = array("f")
    for at, size in zip(tags[273], tags[279]):
        values.frombytes(data[at : at + size])
    if order != {"little": "<", "big": ">"}[sys.byteorder]:
        values.byteswap()
    return [values[c::channels] for c in range(3)]


def blocks(channel, side=8):
    """Returns the means of blocks of pixels."""
    means = []
    for y in range(0, HEIGHT, side):
        rows = [channel[WIDTH * (y + k) : WIDTH * (y + k + 1)] for k in range(side)]
        means += [sum(sum(row[x : x + side]) for row in rows) / side**2 for x in range(0, WIDTH, side)]
    return means


def difference(image, reference):
    """Returns the root mean square difference over the root mean square of the reference."""
    square = power = 0
    for a, b in zip(image, reference):
        delta = list(map(operator.sub, a, b))
        square += sum(map(operator.mul, delta, delta))
        power += sum(map(operator.mul, b, b))
    return math.sqrt(square / power) if power else math.inf


class Cost:
    """The wall clock and processor time of a run in seconds, and its peak memory in MiB."""

    def __init__(self, command, folder, environment):
        before, begin, peak = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter(), 0
        child = subprocess.Popen(command, cwd=folder, stdout=subprocess.DEVNULL, env=environment)
        # The peak that wait4 returns contains the memory of this script, which the child shares before it starts its
        # program.
        while child.poll() is None:
            peak = max(peak, high_water(child.pid))
            time.sleep(0.005)
        self.wall = time.perf_counter() - begin
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        if child.returncode:
            raise subprocess.CalledProcessError(child.returncode, command)
        self.processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
        self.peak = peak / 1024


def high_water(process):
    """Returns the largest resident size of a process until now, in KiB, or 0 where the system does not say it."""
    try:
        status = pathlib.Path(f"/proc/{process}/status").read_text()
    except OSError:
        return 0
    return next((int(line.split()[1]) for line in status.splitlines() if line.startswith("VmHWM:")), 0)


def measure(programs, environment, text, runs, place):
    """Renders a RIB file with all programs in turn. Returns the fastest run of each, and the images."""
    costs, images = [], []
    for name, _ in programs:
        folder = place / name
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "scene.rib").write_text(text)
    for _ in range(runs):
        costs.append([Cost([*command, "scene.rib"], place / name, environment) for name, command in programs])
    for name, _ in programs:
        images.append(read(place / name / "out.tif"))
    return [min(of, key=lambda c: c.processor) for of in zip(*costs)], images


def main():
    words = argparse.ArgumentParser()
    words.add_argument("--aqsis", default="", help="the folder into which Aqsis was installed")
    words.add_argument("--gelato", default="target/release/gelato")
    words.add_argument("--runs", type=int, default=3)
    words.add_argument("--only", default="", help="only scenes whose name has this word")
    words.add_argument("--samples", type=int, default=4, help="the samples along a side of a pixel")
    words.add_argument("--keep", default="", help="a folder for RIB files and images")
    words = words.parse_args()
    aqsis, aqsl = (pathlib.Path(words.aqsis, "bin", name).absolute() for name in ("aqsis", "aqsl"))
    if not words.aqsis or not aqsis.is_file() or not aqsl.is_file():
        print("aqsis.py: there is no Aqsis (--aqsis PREFIX): nothing to compare with")
        return
    programs = [("gelato", [os.path.abspath(words.gelato), "-silent", "-threads", "1"]), ("aqsis", [aqsis, "-verbose=0"])]
    libraries = [os.path.abspath(pathlib.Path(words.aqsis, "lib")), os.environ.get("LD_LIBRARY_PATH", "")]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "LD_LIBRARY_PATH": ":".join(filter(None, libraries))}
    with tempfile.TemporaryDirectory() as temporary:
        place = pathlib.Path(words.keep or temporary).absolute()
        shaders = place / "shaders"
        shaders.mkdir(parents=True, exist_ok=True)
        (shaders / "ripples.sl").write_text(RIPPLES_SL)
        (shaders / "ripples.gsl").write_text(RIPPLES_GSL)
        subprocess.run([aqsl, "ripples.sl"], cwd=shaders, env=environment, check=True, stdout=subprocess.DEVNULL)
        print("| scene | gelato, s | Aqsis, s | gelato, processor s | Aqsis, processor s | ratio | target | gelato, MiB | Aqsis, MiB "
              "| difference, % | smoothed, % |")
        print("|---" * 11 + "|")
        for name, target, options, objects in SCENES:
            if words.only not in name:
                continue
            text = rib(shaders, words.samples, options, objects())
            folder = place / name.replace(" ", "_").replace(",", "")
            (ours, theirs), images = measure(programs, environment, text, words.runs, folder)
            ratio = theirs.processor / ours.processor
            off = difference(*images)
            smoothed = difference(*([blocks(c) for c in image] for image in images))
            print(f"| {name} | {ours.wall:.2f} | {theirs.wall:.2f} | {ours.processor:.2f} | {theirs.processor:.2f} | {ratio:.1f} "
                  f"| at least {target}{': missed' if ratio < target else ''} | {ours.peak:.0f} | {theirs.peak:.0f} "
                  f"| {100 * off:.2f}{': missed' if off > EQUAL else ''} | {100 * smoothed:.2f} |", flush=True)


main()
