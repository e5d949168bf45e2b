"""Indirect light and occlusion beside Mitsuba 3: how long each takes to come how near.

    python3 benches/peers/light.py --gelato target/release/gelato [--threads N] [--side PIXELS] [--quick]

Mitsuba is the package `mitsuba` of Python (3.5 or later); without it the script says so and ends. From the root of the checkout.

Two pictures: the Cornell box under a point light, of which only the light of one bounce is compared, and a rabbit on a floor under
an even sky, which is ambient occlusion. The reference is Mitsuba's with many samples. Pixels on edges of shapes do
not count (the programs filter edges differently). Errors are root mean squares over the mean of the reference. Times are of
rendering alone for Mitsuba, once it is warm, and of the whole program for gelato. Before that, the means over the walls are
compared. The noise of the reference is taken off the errors.
"""

import argparse
import os
import subprocess
import sys
import tempfile
import time

import numpy as np

try:
    import mitsuba as mi
except ImportError:
    print("light.py: there is no package mitsuba: nothing to compare with")
    sys.exit(0)

WALLS = {
    "floor": ([(0, 0, 0), (0, 0, 559.2), (556, 0, 559.2), (556, 0, 0)], (0.73, 0.73, 0.73)),
    "ceiling": ([(0, 548.8, 0), (556, 548.8, 0), (556, 548.8, 559.2), (0, 548.8, 559.2)], (0.73, 0.73, 0.73)),
    "back": ([(0, 0, 559.2), (0, 548.8, 559.2), (556, 548.8, 559.2), (556, 0, 559.2)], (0.73, 0.73, 0.73)),
    "right": ([(0, 0, 0), (0, 548.8, 0), (0, 548.8, 559.2), (0, 0, 559.2)], (0.12, 0.45, 0.15)),
    "left": ([(556, 0, 0), (556, 0, 559.2), (556, 548.8, 559.2), (556, 548.8, 0)], (0.65, 0.05, 0.05)),
}
BLOCKS = {
    "short": [(130, 165, 65), (82, 165, 225), (240, 165, 272), (290, 165, 114)],
    "tall": [(423, 330, 247), (265, 330, 296), (314, 330, 456), (472, 330, 406)],
}
LAMP = (278, 450, 279.5)
INTENSITY = 40000.0


def obj(path, faces):
    with open(path, "w") as f:
        n = 1
        for face in faces:
            for p in face:
                f.write("v %g %g %g\n" % p)
            f.write("f %d %d %d\nf %d %d %d\n" % (n, n + 1, n + 2, n, n + 2, n + 3))
            n += 4


def block(top):
    down = [(x, 0, z) for x, _, z in top]
    return [top] + [[down[i], top[i], top[(i + 1) % 4], down[(i + 1) % 4]] for i in range(4)]


def matte(color):
    return {"type": "twosided", "bsdf": {"type": "diffuse", "reflectance": {"type": "rgb", "value": list(color)}}}


def camera(side, origin, target, fov):
    t = mi.ScalarTransform4f()
    return {
        "type": "perspective", "fov": fov, "near_clip": 0.1, "far_clip": 1e5,
        "to_world": t.look_at(origin=origin, target=target, up=[0, 1, 0]),
        "film": {"type": "hdrfilm", "width": side, "height": side, "rfilter": {"type": "box"}, "pixel_format": "rgb"},
        "sampler": {"type": "independent"},
    }


def cornell(place, side):
    scene = {"type": "scene", "sensor": camera(side, [278, 273, -800], [278, 273, 0], 39.3)}
    scene["lamp"] = {"type": "point", "position": list(LAMP), "intensity": {"type": "rgb", "value": [np.pi * INTENSITY] * 3}}
    for name, (face, color) in WALLS.items():
        obj(f"{place}/{name}.obj", [face])
        scene[name] = {"type": "obj", "filename": f"{place}/{name}.obj", "face_normals": True, "bsdf": matte(color)}
    for name, top in BLOCKS.items():
        obj(f"{place}/{name}.obj", block(top))
        scene[name] = {"type": "obj", "filename": f"{place}/{name}.obj", "face_normals": True, "bsdf": matte((0.73,) * 3)}
    return mi.load_dict(scene, optimize=False)


def rabbit(place, side):
    scene = {"type": "scene", "sensor": camera(side, [0, 9, -24], [0, 4, 0], 34)}
    obj(f"{place}/ground.obj", [[(-30, 0, -30), (30, 0, -30), (30, 0, 30), (-30, 0, 30)]])
    scene["sky"] = {"type": "constant", "radiance": {"type": "rgb", "value": [1, 1, 1]}}
    for name, file in (("ground", f"{place}/ground.obj"), ("rabbit", "examples/data/bunny.obj")):
        scene[name] = {"type": "obj", "filename": file, "face_normals": True, "bsdf": matte((1, 1, 1))}
    return mi.load_dict(scene, optimize=False)


def shapes(scene, side):
    """Which shape each pixel shows, -1 for none and for pixels on edges."""
    integrator = mi.load_dict({"type": "aov", "aovs": "s:shape_index,t:depth"})
    image = np.array(mi.render(scene, integrator=integrator, spp=16))
    index, depth = image[..., -2], image[..., -1]
    whole = np.where(depth > 0, np.round(index), -1)
    out = whole.copy()
    mixed = np.abs(index - np.round(index)) > 1e-3
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            other = np.roll(np.roll(whole, dy, 0), dx, 1)
            mixed |= (other != whole) | np.roll(np.roll(np.abs(index - np.round(index)) > 1e-3, dy, 0), dx, 1)
    out[mixed] = -1
    return out.astype(int)


def gelato(program, text, place, threads):
    path = f"{place}/out.exr"
    begin = time.time()
    subprocess.run([program, "-silent", "-threads", str(threads), "-o", path, "-data", "rgb", "-"],
                   input=text.encode(), check=True)
    seconds = time.time() - begin
    return np.array(mi.Bitmap(path).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, False)), seconds


HEAD = """Attribute ("int[2] resolution", (%d, %d))
Attribute ("string projection", "perspective")
Attribute ("int[2] spatialquality", (4, 4))
"""


def our_box(side, bounce):
    # Filters are the program's own choice for -o; pixels on edges do not count.
    light = f'Light ("bounce", "indirectlight", "string indirectname", "box", {bounce})\n' if bounce else ""
    return (HEAD % (side, side)) + f"""Attribute ("float fov", 39.3)
Attribute ("string path:input", "examples/indirect:&")
Scale (-1, 1, 1)
Translate (-278, -273, 800)
World ()
Light ("lamp", "pointlight", "float intensity", {INTENSITY}, "float falloff", 2, "point from", {LAMP}, "string shadowname", "box")
{light}Attribute ("string geometryset", "+box")
Input ("box.pyg")
Render ()
"""


def our_rabbit(side, options):
    angle = np.degrees(np.arctan2(5, 24))
    return (HEAD % (side, side)) + f"""Attribute ("float fov", 34)
Attribute ("string path:input", "examples/data:&")
Scale (-1, 1, 1)
Rotate ({-angle}, 1, 0, 0)
Translate (0, -9, 24)
World ()
Attribute ("string geometryset", "+all")
Shader ("surface", "ambocclude", "string occlusionname", "all", "float twosided", 1, {options})
Mesh ("linear", (4,), (0, 1, 2, 3), "vertex point P", (-30, 0, -30, -30, 0, 30, 30, 0, 30, 30, 0, -30))
Input ("bunny.obj")
Render ()
"""


def error(image, reference, mask):
    """Root mean square over the mean; the noise of the reference, known from its halves, is taken away."""
    (a, b), image = (r[mask].mean(1) for r in reference), image[mask].mean(1)
    whole = 0.5 * (a + b)
    square = ((image - whole) ** 2).mean() - 0.25 * ((a - b) ** 2).mean()
    return np.sqrt(max(square, 0)) / whole.mean()


def at(curve, bar):
    """Time at which a curve of (seconds, error) passes a bar, by powers; none when it does not."""
    curve = sorted(curve)
    for (t0, e0), (t1, e1) in zip(curve, curve[1:]):
        if e0 > bar >= e1:
            f = np.log(e0 / bar) / np.log(e0 / e1)
            return t0 * (t1 / t0) ** f
    return min((t for t, e in curve if e <= bar), default=None)


def show(what, ours, theirs):
    print(f"\n{what}\n\n| program | setting | seconds | error, % |\n|---|---|---|---|")
    for name, rows in (("gelato", ours), ("Mitsuba", theirs)):
        for setting, seconds, e in rows:
            print(f"| {name} | {setting} | {seconds:.2f} | {100 * e:.2f} |")
    for bar in (0.05, 0.02, 0.01):
        a, b = at([r[1:] for r in ours], bar), at([r[1:] for r in theirs], bar)
        text = ", ".join(f"{n} {t:.2f} s" if t else f"{n} does not come there" for n, t in (("gelato", a), ("Mitsuba", b)))
        print(f"error {100 * bar:.0f}%: {text}" + (f", ratio {a / b:.2f}" if a and b else ""))


def main():
    words = argparse.ArgumentParser()
    words.add_argument("--gelato", default="target/release/gelato")
    words.add_argument("--threads", type=int, default=os.cpu_count())
    words.add_argument("--side", type=int, default=256)
    words.add_argument("--quick", action="store_true")
    words.add_argument("--variant", default="scalar_rgb", help="of Mitsuba; llvm_ad_rgb needs an LLVM that it knows")
    words = words.parse_args()
    mi.set_variant(words.variant)
    side, threads = words.side, words.threads
    many = 1024 if words.quick else 4096
    with tempfile.TemporaryDirectory() as place:
        def ours(text):
            return gelato(words.gelato, text, place, threads)

        def theirs(scene, integrator, spp, seed=0):
            begin = time.time()
            image = np.array(mi.render(scene, integrator=integrator, spp=spp, seed=seed))
            return image, time.time() - begin

        scene = cornell(place, side)
        path = [mi.load_dict({"type": "path", "max_depth": d}) for d in (2, 3)]
        where = shapes(scene, side)
        lit = theirs(scene, path[0], 256, 99)[0]
        reference = [theirs(scene, path[1], many // 2, 100 + k)[0] - lit for k in range(2)]
        direct, _ = ours(our_box(side, ""))
        best, _ = ours(our_box(side, '"float samples", 2048, "float maxerror", 0.1'))
        print("Cornell box, one bounce, means over walls\n\n| wall | gelato | Mitsuba | difference, % |\n|---|---|---|---|")
        names = list(WALLS) + list(BLOCKS)
        for shape, name in enumerate(names, 1):
            mask = where == shape
            if mask.any():
                a, b = (best - direct)[mask].mean(), (0.5 * (reference[0] + reference[1]))[mask].mean()
                print(f"| {name} | {a:.4f} | {b:.4f} | {100 * (a / b - 1):+.2f} |")
        mask = where >= 0
        rows = []
        for samples in (64, 256, 1024) if words.quick else (64, 256, 1024, 4096):
            for maxerror in (0.25, 0.5) if words.quick else (0.1, 0.25, 0.5):
                image, seconds = ours(our_box(side, f'"float samples", {samples}, "float maxerror", {maxerror}'))
                rows.append((f"samples {samples}, maxerror {maxerror}", seconds, error(image - direct, reference, mask)))
        peer = []
        theirs(scene, path[1], 4)
        for spp in (16, 64, 256, 1024):
            image, seconds = theirs(scene, path[1], spp, 7)
            peer.append((f"{spp} a pixel", seconds, error(image - theirs(scene, path[0], spp, 7)[0], reference, mask)))
        show("Cornell box, light of one bounce", rows, peer)

        scene = rabbit(place, side)
        where = shapes(scene, side)
        mask = where >= 0
        ao = mi.load_dict({"type": "direct", "emitter_samples": 0, "bsdf_samples": 1})
        reference = [theirs(scene, ao, many // 2, 200 + k)[0] for k in range(2)]
        rows = []
        for samples in (16, 64, 256, 1024):
            for maxerror in (0.1, 0.25, 0.5):
                image, seconds = ours(our_rabbit(side, f'"float samples", {samples}, "float maxerror", {maxerror}'))
                rows.append((f"samples {samples}, maxerror {maxerror}", seconds, error(image, reference, mask)))
        peer = []
        theirs(scene, ao, 4)
        for spp in (16, 64, 256, 1024):
            image, seconds = theirs(scene, ao, spp, 7)
            peer.append((f"{spp} a pixel", seconds, error(image, reference, mask)))
        show("Rabbit, occlusion", rows, peer)


main()
