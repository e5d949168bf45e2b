"""Compares the error over time of indirect light and occlusion with Mitsuba 3 and Cycles.

    python3 benches/peers/light.py --gelato target/release/gelato [--threads N] [--side PIXELS] [--quick]
        [--mesh FILE.ply] [--panorama FILE.exr] [--only WORD] [--limit SECONDS] [--processor]

Run it from the root of the checkout. Mitsuba is the Python package `mitsuba` (3.5 or later). It also makes the
references. Without it the script prints a line and ends. Its variant `llvm_ad_rgb` is used where its LLVM library is
found (DRJIT_LIBLLVM_PATH), and `scalar_rgb` elsewhere. Cycles is the package `bpy` (4.2 or later). Without it the
tables have no rows for Cycles.

There are three scenes: the Cornell box under a point light, a room with the sun in its window, and a mesh (by default a
rabbit) on a floor under a panorama. The light of one bounce is compared in the first two, and the light of the panorama
in the third. Occlusion under a uniform sky is compared in all of them.

Pixels on edges of shapes and of direct light do not count, because the programs filter edges differently. `--walls`
first compares means by shape. Errors are root mean squares, divided by the mean of the reference, without the noise of
the reference. The times of gelato are those of the whole program. Those of the others are the times of an image of a
scene that is loaded (Mitsuba) or was rendered before (Cycles). The last line of a table gives the additional time of a
program that starts, loads the scene and renders one image.

Two curves are those of gelato: one of many settings, and one of requested errors (`gelato -error`) with the scene's own
settings. The error that is requested is that of the whole image, with direct light and edges.
"""

import argparse
import os
import pickle
import subprocess
import sys
import tempfile
import time

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from light_others import light_cycles, light_mitsuba
import numpy as np

import light_gelato
import light_scenes
import light_table

# The errors that are requested of gelato, in percent.
REQUESTED = (8, 5, 3, 2, 1.5, 1, 0.7, 0.5)
# The samples per pixel of the other programs.
SAMPLES = (4, 16, 64, 256, 1024)


def luminance_edges(image):
    """Returns true for pixels that differ much from their neighbours."""
    grey = image.mean(2)
    all = np.stack([np.roll(grey, (y, x), (0, 1)) for y in (-1, 0, 1) for x in (-1, 0, 1)])
    return np.ptp(all, 0) > 0.2 * all.max(0)


def error(image, reference, mask):
    """Returns the error of the pixels of a mask, of the means of their channels."""
    return light_table.error(image[mask].mean(1), [half[mask].mean(1) for half in reference])


def walls(scene, image, reference, where):
    print(f"\n{scene.name}: means by shape\n\n| shape | gelato | Mitsuba | difference, % |\n|---|---|---|---|")
    for number, shape in enumerate(scene.shapes, 1):
        mask = where == number
        if mask.any():
            a, b = image[mask].mean(), (0.5 * (reference[0] + reference[1]))[mask].mean()
            print(f"| {shape.name} | {a:.4f} | {b:.4f} | {100 * (a / b - 1):+.2f} |")


def start(module, words, place):
    """Returns the seconds of a program that renders one small image, from its start."""
    path = f"{place}/start.pickle"
    with open(path, "wb") as file:
        pickle.dump(words, file)
    begin = time.time()
    subprocess.run([sys.executable, module.__file__, path], check=True, stdout=subprocess.DEVNULL)
    return time.time() - begin


def measure(words, place, ours, mitsuba, cycles, scene, kind, title):
    side = words.side
    files = light_scenes.prepare(scene, place)
    mitsuba.load(scene, files, side, kind)
    where = mitsuba.shapes()
    many = 576 if words.quick else 2304
    direct = 0
    # The direct light of the lamp is subtracted. It is noisy only at edges.
    if kind == "bounce":
        direct = mitsuba.render("direct", 256, 99)[0]
        where[luminance_edges(direct)] = -1
    reference = [mitsuba.render(kind, many, 100 + k)[0] - direct for k in range(2)]
    mask = where > 0
    own = ours.render(scene, files, side, "direct", "")[0] if kind == "bounce" else 0
    # Light is gathered with cones at few points, and interpolated between them. A panorama is also sampled at every
    # point, in directions distributed by its light. A list of settings ends at its first image that takes too long.
    numbers = (16, 32, 48, 64, 128, 256, 512, 1024, 2048, 4096)
    lists = [[(f"samples {n}, maxerror {e}, maxpixeldist {d}", kind,
               f'"float samples", {n}, "float adaptive", 0, "float maxerror", {e}, "float maxpixeldist", {d}') for n in numbers]
             for e, d in ((0.1, 20), (0.25, 20), (0.5, 20), (1.0, 20), (1.0, 12), (1.0, 8))]
    if kind == "panorama":
        lists.append([(f"envsamples {n}", "drawn", f'"float envsamples", {n}') for n in (4, 8, 16, 32, 64, 128, 256, 1024)])
    rows = []
    for settings in lists:
        for setting, how, options in settings:
            image, seconds = ours.render(scene, files, side, how, options)
            rows.append((setting, seconds, error(image - own, reference, mask)))
            if words.keep:
                np.save(f"{words.keep}/{title} {setting}.npy".replace(" ", "_").replace(",", ""),
                        np.stack([image - own, 0.5 * (reference[0] + reference[1]), np.repeat(mask[..., None], 3, 2)]))
            if seconds > words.limit:
                break
    tables = [("gelato", rows)]
    rows, how = [], "drawn" if kind == "panorama" else kind
    for requested in REQUESTED:
        options = '"float envsamples", 16' if how == "drawn" else ""
        image, seconds = ours.render(scene, files, side, how, options, ("-error", f"{requested}%"))
        rows.append((f"-error {requested}%", seconds, error(image - own, reference, mask)))
        # The first of these has passes that only show what is needed.
        if seconds > 5 * words.limit:
            break
    tables.append(("gelato -error", rows))
    if words.walls and kind == "bounce":
        image, _ = ours.render(scene, files, side, kind, '"float samples", 2048, "float maxerror", 0.1')
        walls(scene, image - own, reference, where)
    rows = []
    mitsuba.render(kind, 4)
    for spp in SAMPLES:
        image, seconds = mitsuba.render(kind, spp, 7)
        rows.append((f"{spp} a pixel", seconds, error(image - direct, reference, mask)))
        if seconds > words.limit:
            break
    tables.append((f"Mitsuba, {mitsuba.variant}", rows))
    if cycles:
        cycles.load(scene, side, kind)
        cycles.render(4)
        rows = []
        for spp in SAMPLES:
            image, seconds = cycles.render(spp, 7)
            rows.append((f"{spp} a pixel", seconds, error(image, reference, mask)))
            if seconds > words.limit:
                break
            if words.keep:
                np.save(f"{words.keep}/{title.replace(' ', '_').replace(',', '')}_cycles.npy", image)
        tables.append(("Cycles", rows))
    light_table.show(title, tables)
    more = start(light_mitsuba, (words.variant, scene, files, side, kind), place) - mitsuba.render(kind, 4)[1]
    print(f"\nFrom the start of the program Mitsuba takes {more:.2f} s more", end="")
    if cycles:
        more = start(light_cycles, (words.threads, place, scene, side, kind), place) - cycles.render(4)[1]
        print(f", Cycles {more:.2f} s", end="")
    print(".")


def main():
    words = argparse.ArgumentParser()
    words.add_argument("--gelato", default="target/release/gelato")
    words.add_argument("--threads", type=int, default=os.cpu_count())
    words.add_argument("--side", type=int, default=256)
    words.add_argument("--quick", action="store_true", help="a coarser reference")
    words.add_argument("--processor", action="store_true", help="processor time, not the clock: for a busy machine")
    words.add_argument("--walls", action="store_true", help="means over walls, of many samples")
    words.add_argument("--mesh", default="examples/data/bunny.obj")
    words.add_argument("--panorama", default="examples/first/studio.exr")
    words.add_argument("--only", default="", help="only tables whose title has this word")
    words.add_argument("--limit", type=float, default=60, help="seconds; a picture that takes longer is the last of its table")
    words.add_argument("--variant", default="", help="of Mitsuba")
    words.add_argument("--keep", default="", help="a folder for pictures, as NumPy arrays")
    words = words.parse_args()
    mitsuba = light_mitsuba.Mitsuba(words.variant, words.processor)
    mesh = light_scenes.on_a_floor(words.mesh, light_scenes.read_mesh(words.mesh)[0], words.panorama)
    with tempfile.TemporaryDirectory() as place:
        ours = light_gelato.Gelato(words.gelato, words.threads, place, mitsuba.read, words.processor)
        cycles = light_cycles and light_cycles.Cycles(words.threads, place, mitsuba.layer, words.processor)
        ours.panorama(words.panorama)
        for scene, kind, what in (
            (light_scenes.cornell(), "bounce", "light of one bounce"), (light_scenes.cornell(), "sky", "occlusion"),
            (light_scenes.room(), "bounce", "light of one bounce"), (light_scenes.room(), "sky", "occlusion"),
            (mesh, "panorama", "light of a panorama"), (mesh, "sky", "occlusion"),
        ):
            title = f"{scene.name}, {what}"
            if words.only in title:
                measure(words, place, ours, mitsuba, cycles, scene, kind, title)


main()
