"""Compares the error over time of depth of field and of a glossy floor with Mitsuba 3 and Cycles.

    python3 benches/peers/effects.py --gelato target/release/gelato [--threads N] [--side PIXELS] [--quick]
        [--only WORD] [--limit SECONDS] [--denoise LIBRARY]

Run it from the root of the checkout. The packages are those of light.py. The scenes are thirty balls with small
highlights, most of them out of focus, and five balls on a blurred mirror. Both have hard shadows of the sun.

The models of highlights and of blurred reflections differ between the programs, so each image is compared with a
converged image of its own program. The error is the root of the mean of the squared differences over the mean, over all
channels. Of the blurred mirror, only its own pixels count, without edges: on other surfaces Mitsuba also has light that
the mirror casts on them. All programs filter with a box of one pixel. Times are those of light.py: of the whole program
for gelato, and of an image of a loaded scene for the others.

`--denoise` names the library of Open Image Denoise. It adds curves of all programs with it (Cycles has its own copy). The
time of the library is part of the time, and the error is that beside the converged image, which is not denoised.
"""

import argparse
import os
import sys
import tempfile

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))
from light_others import light_cycles, light_mitsuba
import numpy as np

import light_denoise
import light_gelato
import light_scenes
import light_table

# The errors that are requested of gelato, in percent.
REQUESTED = (8, 5, 3, 2, 1.5, 1)
# The samples per pixel of the other programs.
SAMPLES = (4, 16, 64, 256, 1024, 4096)


def error(image, reference, mask):
    """Returns the error of the pixels of a mask, of all channels."""
    return light_table.error(image[mask], [half[mask] for half in reference])


def settings(scene):
    """Returns lists of settings of gelato, from the fastest to the slowest: a name, attributes, and parameters of the
    mirror."""
    has_mirror = any(shape.mirror for shape in scene.shapes)
    for finer in (1, 2, 4) if has_mirror else (1, 2, 4, 8):
        for pixel in (4, 8) if has_mirror else (4,):
            name = f"shadingquality {finer}"
            words = lambda pixel: ("-set", f"shadingquality={finer}", "-set", f"spatialquality={pixel},{pixel}")
            if has_mirror:
                yield [(f"{name}, {pixel} x {pixel} samples, {rays} rays", words(pixel), f'"float samples", {rays}')
                       for rays in (4, 16, 64, 256)]
            else:
                yield [(f"{name}, {n} x {n} samples", words(n), "") for n in (4, 8, 16, 32)]


def measure(words, ours, mitsuba, cycles, scene, place):
    side = words.side
    files = light_scenes.prepare(scene, place)
    denoise = ("-denoise", "-set", f"render:denoiselibrary={words.denoise}")
    has_mirror = any(shape.mirror for shape in scene.shapes)
    mitsuba.load(scene, files, side, "whole")
    mask = np.ones((side, side), bool)
    if has_mirror:
        # The mirror is at the bottom of the image. Mitsuba may number the shapes in another order than the scene.
        where = mitsuba.shapes()
        mask = where == where[-3, side // 2]
    best, finest, pixel = ('"float samples", 16', 4, 8) if has_mirror else ("", 8, 16)
    passes = 8 if words.quick else 32
    converged = ours.render(scene, files, side, "whole", best,
                            ("-set", f"shadingquality={finest}", "-set", f"spatialquality={pixel},{pixel}", "-passes", str(passes)))[0]
    reference = (converged, converged)
    rows, clean = [], []
    for some in settings(scene):
        for name, more, options in some:
            image, seconds = ours.render(scene, files, side, "whole", options, more)
            rows.append((name, seconds, error(image, reference, mask)))
            if seconds > words.limit:
                break
            if words.denoise:
                image, seconds = ours.render(scene, files, side, "whole", options, (*more, *denoise))
                clean.append((name, seconds, error(image, reference, mask)))
    tables = [("gelato", rows)]
    kinds = [("gelato -error", (), [])]
    if words.denoise:
        tables.append(("gelato, denoised", clean))
        # What the library leaves may be more than the requested error, whatever the number of passes.
        kinds.append(("gelato -error, denoised", (*denoise, "-seconds", str(words.limit)), []))
    for name, more, rows in kinds:
        for requested in REQUESTED:
            options = '"float samples", 4' if has_mirror else ""
            image, seconds = ours.render(scene, files, side, "whole", options, (*more, "-error", f"{requested}%"))
            rows.append((f"-error {requested}%", seconds, error(image, reference, mask)))
            if seconds > words.limit:
                break
        tables.append((name, rows))
    many = 1024 if words.quick else 4096
    cleaner = light_denoise.Denoiser(words.denoise, words.threads) if words.denoise else None
    others = [(f"Mitsuba, {mitsuba.variant}", lambda spp, seed: mitsuba.render("whole", spp, seed),
               lambda spp, seed: mitsuba.clean(cleaner, spp, seed))]
    if cycles:
        cycles.load(scene, side, "whole")
        others.append(("Cycles", cycles.render, lambda spp, seed: cycles.render(spp, seed, True)))
    for program, render, clean in others:
        render(4, 1)
        reference = [render(many, 100 + k)[0] for k in range(2)]
        for name, render in [(program, render)] + [(f"{program}, denoised", clean)] * bool(words.denoise):
            rows = []
            for spp in SAMPLES:
                image, seconds = render(spp, 7)
                rows.append((f"{spp} a pixel", seconds, error(image, reference, mask)))
                if seconds > words.limit:
                    break
            tables.append((name, rows))
        if words.keep:
            np.save(f"{words.keep}/{scene.name} {program}.npy".replace(" ", "_").replace(",", ""), 0.5 * (reference[0] + reference[1]))
    if words.keep:
        np.save(f"{words.keep}/{scene.name} gelato.npy".replace(" ", "_"), converged)
    light_table.show(scene.name, tables)


def main():
    words = argparse.ArgumentParser()
    words.add_argument("--gelato", default="target/release/gelato")
    words.add_argument("--threads", type=int, default=os.cpu_count())
    words.add_argument("--side", type=int, default=256)
    words.add_argument("--quick", action="store_true", help="coarser references")
    words.add_argument("--only", default="", help="only scenes whose name has this word")
    words.add_argument("--limit", type=float, default=20, help="seconds; a picture that takes longer is the last of its table")
    words.add_argument("--denoise", default="", help="the file of the library Open Image Denoise")
    words.add_argument("--keep", default="", help="a folder for the converged images, as NumPy arrays")
    words = words.parse_args()
    mitsuba = light_mitsuba.Mitsuba("", False)
    with tempfile.TemporaryDirectory() as place:
        ours = light_gelato.Gelato(words.gelato, words.threads, place, mitsuba.read, False)
        cycles = light_cycles and light_cycles.Cycles(words.threads, place, mitsuba.read, False)
        for scene in (light_scenes.out_of_focus(), light_scenes.glossy_floor()):
            if words.only in scene.name:
                measure(words, ours, mitsuba, cycles, scene, place)


main()
