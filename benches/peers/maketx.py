"""Compares the profile oiio of maketx with OpenImageIO's maketx, option by option.

    python3 benches/peers/maketx.py [--granita PATH] [--only WORD] [--keep FOLDER] [--table FILE]

It needs the package OpenImageIO, which has the other program (`pip install OpenImageIO numpy`). Without it the script
prints a line and ends.

Each case runs both programs with the same options on the same image, and compares the textures: size, type, channels,
number of levels, display window, tiles, and the metadata `textureformat`, `wrapmodes`, `oiio:AverageColor`,
`oiio:ConstantColor`, `oiio:SHA-1`, `fovcot`, matrices and those that the case names. Pixels of all levels may differ by
one code value of 8 bits, and those of halves and floats by 2^-9 of the larger one, or of the mean of the level where
that is larger. A case with a reason is expected to differ in what the reason says.
"""

import argparse
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

try:
    import numpy as np
    import OpenImageIO as oiio
except ImportError:
    print("maketx.py: the package OpenImageIO is not installed: pip install OpenImageIO numpy")
    sys.exit(0)

# One code value of 8 bits, and the relative error of a half.
CODE, RELATIVE = 1 / 255, 2**-9
# Reasons, and parts that may differ.
RADIAL = "3.2.2 reads wrong texels for radial filters where the two sides shrink by different factors"
HASH = ("oiio:SHA-1",)
SINES = "sines of the filter differ in their last digits"
POWERS = "powers differ in their last digits"
SUMS = "means of halves are summed in floats, not in halves"
MATRIX = "1 0 0 0 0 1 0 0 0 0 1 0 1 2 3 1"
NAMES = ("textureformat", "wrapmodes", "oiio:SHA-1", "fovcot", "worldtocamera", "worldtoscreen")
FILTERS = (
    "box triangle gaussian sharp-gaussian catmull-rom blackman-harris sinc lanczos3 radial-lanczos3 nuke-lanczos6 "
    "mitchell bspline disk cubic keys simon rifman unsharp-gaussian unsharp-mitchell"
).split()


class Case:
    """The options of both programs, the input, and what is compared."""

    def __init__(self, options, source="photo.png", output="o.tx", names=(), reason="", status=0, parts=()):
        self.options, self.source, self.output, self.names = options, source, output, names
        # The reason for a difference, and the parts that may differ: "pixels", "tile" or a name of the metadata.
        self.reason, self.parts, self.status = reason, parts, status


def cases():
    """Returns all cases, the plain ones first, each group after its name."""
    yield "plain textures"
    yield Case("")
    yield Case("", "odd.png")
    yield Case("", "hdr.exr", "o.exr")
    yield Case("", "hdr.exr")
    yield Case("", "shorts.tif")
    yield Case("", "shorts.tif", "o.exr")
    yield Case("", "alpha.png")
    yield Case("--ignore-unassoc", "alpha.png", parts=("pixels", "oiio:SHA-1", "oiio:AverageColor"), reason="3.2.2 multiplies by alpha all the same")
    yield Case("", "grey.png")
    yield "windows, `--fullpixels`"
    yield Case("", "crop.exr", "o.exr", parts=HASH, reason="3.2.2 interpolates where it adds black, which rounds")
    yield Case("", "overscan.exr", "o.exr")
    yield Case("", "overscan.exr", status=1)
    yield Case("--fullpixels", "overscan.exr")
    yield Case("--fullpixels", "crop.exr", "o.exr")
    yield "`--compression`, `--format`"
    for name in ("none", "lzw", "zip", "packbits"):
        yield Case("--compression " + name)
    for name in ("none", "rle", "zip", "zips", "piz", "pxr24"):
        yield Case("--compression " + name, "hdr.exr", "o.exr")
    for name in ("b44", "b44a", "dwaa", "dwab"):
        lossy = "this compression loses precision, and the encoders differ"
        yield Case("--compression " + name, "hdr.exr", "o.exr", parts=("pixels",), reason=lossy)
    yield Case("--format openexr", output="o.tx")
    yield Case("--format tiff", output="o.env")
    yield "`-d`"
    for kind in ("uint8", "uint16", "half", "float"):
        yield Case("-d " + kind, "hdr.exr", parts=())
        yield Case("-d " + kind, "hdr.exr", "o.exr")
    yield Case("-d sint16", status=1, reason="signed types are not supported, and the status is 1", parts=("status",))
    yield "`--tile`, `--separate`"
    yield Case("--tile 32 16")
    yield Case("--tile 20 20", status=1)
    yield Case("--separate")
    yield "`--wrap`, `--swrap`, `--twrap`"
    for mode in ("clamp", "periodic", "mirror", "black"):
        yield Case("--wrap " + mode)
    yield Case("--wrap clamp --swrap periodic --twrap mirror")
    yield "`--nomipmap`, `--resize`, `--keepaspect`"
    yield Case("--nomipmap")
    yield Case("--nomipmap", "hdr.exr", "o.exr")
    yield Case("--resize", "odd.png")
    yield Case("--resize --keepaspect", "odd.exr", "o.exr", names=("PixelAspectRatio",))
    yield Case("--resize --filter lanczos3", "odd.png", parts=HASH, reason=SINES)
    yield "`--filter`"
    for name in FILTERS:
        radial = ("pixels",) if name in ("radial-lanczos3", "disk") else ()
        for source, output in (("photo.png", "o.tx"), ("odd.exr", "o.exr")):
            yield Case("--filter " + name, source, output, parts=radial, reason=RADIAL)
        yield Case("--filter " + name, "square.exr", "o.exr")
    yield Case("--filter round", status=1)
    yield "`--sharpen`, `--hicomp`"
    yield Case("--sharpen 0.5")
    yield Case("--sharpen 0.5 --filter lanczos3", "odd.exr", "o.exr")
    yield Case("--sharpen 0.5 --filter unsharp-lanczos3")
    yield Case("--sharpen 0.5 --filter post-gaussian", "odd.exr", "o.exr")
    yield Case("--hicomp --filter lanczos3", "hdr.exr", "o.exr")
    yield Case("--hicomp", "hdr.exr", "o.exr")
    yield "`--nchannels`, `--chnames`, `--opaque-detect`, `--monochrome-detect`"
    yield Case("--nchannels 1")
    yield Case("--nchannels 4")
    yield Case("--chnames U,V,W", "hdr.exr", "o.exr")
    yield Case("--opaque-detect", "opaque.png")
    yield Case("--opaque-detect", "alpha.png")
    yield Case("--monochrome-detect", "mono.png")
    yield Case("--monochrome-detect")
    yield "`--constant-color-detect`, `--no-compute-average`"
    yield Case("--constant-color-detect", "flat.png", names=("oiio:ConstantColor",))
    yield Case("", "flat.png", names=("oiio:ConstantColor",))
    yield Case("", "flat.exr", "o.exr", names=("oiio:ConstantColor",))
    yield Case("--no-compute-average")
    yield "`--fixnan`, `--checknan`"
    for name in ("none", "black", "box3"):
        parts = HASH if name == "box3" else ()
        yield Case("--fixnan " + name, "broken.exr", "o.exr", parts=parts, reason=SUMS)
    yield Case("--checknan", "broken.exr", "o.exr", status=1)
    yield Case("--checknan --fixnan box3", "broken.exr", "o.exr", parts=HASH, reason=SUMS)
    yield Case("--checknan", "hdr.exr", "o.exr")
    yield "`--mipimage`"
    yield Case("--mipimage half.png")
    yield Case("--mipimage half.png --mipimage quarter.png", parts=())
    yield "matrices, `--fovcot`, `--attrib`, `--sattrib`, `--history`"
    yield Case("--Mcamera %s --Mscreen %s" % (MATRIX, MATRIX))
    yield Case("--Mcamera %s --Mscreen %s --MNDC %s" % (MATRIX, MATRIX, MATRIX), "hdr.exr", "o.exr", names=("worldtoNDC",))
    yield Case("--fovcot 2.5")
    yield Case("--attrib a 3 --attrib b 0.5 --attrib c x --sattrib d 7", "hdr.exr", "o.exr", names=("a", "b", "c", "d"))
    yield Case("--sattrib Artist me", names=("Artist",))
    yield Case("--history --sansattrib --sattrib Artist me")
    yield Case("--no-history")
    yield "`--prman`, `--prman-metadata`, `--oiio`, `--handed`"
    yield Case("--prman")
    yield Case("--prman", "hdr.exr")
    yield Case("--prman", "hdr.exr", "o.exr", names=("PixarTextureFormat",))
    yield Case("--prman", "shorts.tif", parts=("type", "pixels"), reason="16 bits are unsigned here")
    yield Case("--prman-metadata", "hdr.exr", "o.exr", names=("PixarTextureFormat",))
    yield Case("--oiio")
    yield Case("--handed left", names=("handed",))
    yield Case("--handed right", "hdr.exr", "o.exr", names=("handed",))
    yield "`--shadow`"
    yield Case("--shadow", "depth.exr")
    yield Case("--shadow", "depth.exr", "o.exr")
    yield Case("--shadow", status=1)
    yield "`--envlatl`, `--lightprobe`"
    for source in ("pano.exr", "pano.png"):
        yield Case("--envlatl", source)
        yield Case("--envlatl", source, "o.exr")
    yield Case("--envlatl --filter lanczos3", "pano.exr", "o.exr", parts=HASH, reason=SINES)
    angles = "angles of the probe differ in their last digits"
    for output in ("o.exr", "o.tx"):
        yield Case("--lightprobe", "probe.exr", output, parts=HASH, reason=angles)
    yield "`--bumpslopes` and its options"
    bump = ("uvslopes_scale",)
    yield Case("--bumpslopes", "grey.png", "o.exr", names=bump)
    yield Case("--bumpslopes -d float", "grey.png")
    yield Case("--bumpslopes", "normals.png", "o.exr")
    yield Case("--bumpslopes --bumpformat height", "normals.png", "o.exr")
    yield Case("--bumpslopes --bumpformat normal --bumprange centered", "normals.exr", "o.exr")
    yield Case("--bumpslopes --bumprange auto", "normals.exr", "o.exr")
    yield Case("--bumpslopes --slopefilter centraldiff --bumpscale 3 --bumpinverts", "grey.png", "o.exr")
    yield Case("--bumpslopes --bumpinvertt --uvslopes_scale 64", "grey.png", "o.exr", names=bump)
    yield "`--cdf`, `--cdfsigma`, `--cdfbits`"
    tables = tuple("%s_%d" % (kind, c) for kind in ("CDF", "invCDF") for c in range(3)) + ("CDF_bits",)
    yield Case("--cdf", output="o.exr", names=tables)
    yield Case("--cdf --cdfsigma 0.2 --cdfbits 6", output="o.exr", names=tables)
    yield "`--colorconvert`, `--unpremult`, `--runstats`, `--threads`, errors"
    yield Case("--colorconvert linear sRGB")
    yield Case("--colorconvert sRGB linear", "odd.png")
    yield Case("--colorconvert sRGB ACEScg -d half")
    yield Case("--colorconvert lin_rec709 ACEScg", "hdr.exr", "o.exr")
    yield Case("--colorconvert ACEScg sRGB --filter lanczos3 --resize", "hdr.exr", "o.exr", parts=HASH, reason=POWERS)
    yield Case("--colorconvert sRGB lin_rec709", "alpha.png")
    yield Case("--colorconvert sRGB lin_rec709 --unpremult", "alpha.png")
    yield Case("--colorconfig ocio://studio-config-latest --colorconvert srgb_texture arri_logc4 -d float")
    yield Case("--colorconvert nowhere linear", status=1)
    yield Case("--unpremult", "alpha.png")
    yield Case("--runstats --threads 2")
    yield Case("--prman --oiio", status=1)
    yield Case("--shadow --envlatl", status=1)
    yield Case("--nosuchoption", status=1)


def smooth(width, height, channels, high=1.0):
    """Returns waves and a few edges."""
    y, x, c = np.mgrid[0:height, 0:width, 0:channels]
    waves = 0.5 + 0.3 * np.sin(0.11 * x + 0.7 * c) * np.cos(0.07 * y) + 0.15 * ((x // 13 + y // 9) % 2)
    return (waves * high).astype("f4")


def write(path, pixels, kind="uint8", windows=None, **attributes):
    """Writes an image. `windows` are x, y, full x, full y, full width and full height."""
    height, width, channels = pixels.shape
    spec = oiio.ImageSpec(width, height, channels, kind)
    if windows:
        spec.x, spec.y, spec.full_x, spec.full_y, spec.full_width, spec.full_height = windows
    for name, value in attributes.items():
        spec.attribute(name.replace("__", ":"), value)
    output = oiio.ImageOutput.create(str(path))
    if not (output and output.open(str(path), spec) and output.write_image(pixels) and output.close()):
        sys.exit("%s: %s" % (path, output.geterror() if output else oiio.geterror()))


def inputs(folder):
    """Writes the images of the cases."""
    photo = smooth(160, 96, 3)
    write(folder / "photo.png", photo)
    write(folder / "half.png", 1 - photo[::2, ::2])
    write(folder / "quarter.png", photo[::4, ::4] * 0.5)
    write(folder / "odd.png", smooth(101, 67, 3))
    write(folder / "odd.exr", smooth(101, 67, 3, 2.0), "half")
    hdr = smooth(160, 96, 3, 4.0)
    hdr[20:24, 30:33] = 800
    write(folder / "hdr.exr", hdr, "half")
    write(folder / "square.exr", smooth(128, 128, 3, 2.0), "half")
    write(folder / "shorts.tif", photo, "uint16")
    alpha = smooth(96, 64, 4)
    write(folder / "alpha.png", alpha, oiio__UnassociatedAlpha=1)
    alpha[:, :, 3] = 1
    write(folder / "opaque.png", alpha, oiio__UnassociatedAlpha=1)
    grey = smooth(96, 64, 1)
    write(folder / "grey.png", grey)
    write(folder / "mono.png", np.repeat(grey, 3, axis=2))
    flat = np.full((96, 160, 3), (0.25, 0.5, 0.75), dtype="f4")
    write(folder / "flat.png", flat)
    write(folder / "flat.exr", flat, "half")
    broken = smooth(64, 48, 3)
    broken[10, 12] = np.nan
    broken[20, 33, 1] = np.inf
    write(folder / "broken.exr", broken, "half")
    write(folder / "crop.exr", smooth(60, 40, 3), "half", (10, 8, 0, 0, 100, 64))
    write(folder / "overscan.exr", smooth(80, 60, 3), "half", (-8, -6, 0, 0, 64, 48))
    write(folder / "depth.exr", smooth(64, 64, 1, 20.0), "float")
    pano = smooth(128, 64, 3, 3.0)
    write(folder / "pano.exr", pano, "half")
    write(folder / "pano.png", pano / 3)
    write(folder / "probe.exr", smooth(100, 100, 3, 2.0), "half")
    normals = smooth(64, 64, 3)
    normals[:, :, 2] = 0.5 + 0.5 * normals[:, :, 2]
    write(folder / "normals.png", normals)
    write(folder / "normals.exr", np.dstack([normals[:, :, :2] - 0.5, normals[:, :, 2:] + 0.1]).astype("f4"), "half")


def levels(path):
    """Returns the description of each level, and its pixels."""
    image = oiio.ImageInput.open(str(path))
    if image is None:
        return []
    all_levels = []
    while image.seek_subimage(0, len(all_levels)):
        spec = image.spec()
        all_levels.append((oiio.ImageSpec(spec), image.read_image(0, len(all_levels), 0, spec.nchannels, "float")))
    image.close()
    return all_levels


def numbers(text):
    return [float(v) for v in str(text).split(",")]


def pixel_error(got, expected, kind):
    """Returns the largest difference as a multiple of what is allowed."""
    odd = ~np.isfinite(expected)
    if not np.array_equal(odd, ~np.isfinite(got)):
        return float("inf")
    got, expected = np.where(odd, 0, got).astype("f8"), np.where(odd, 0, expected).astype("f8")
    difference = np.abs(got - expected)
    if kind in ("uint8", "uint16"):
        # The last bit of a code value may be lost in its conversion to a float.
        return float(difference.max() / (CODE * 1.001))
    scale = np.maximum(np.maximum(np.abs(got), np.abs(expected)), np.abs(expected).mean() + 1e-6)
    return float((difference / (scale * RELATIVE)).max())


def differences(ours, theirs, case):
    """Returns the parts in which two textures differ, each with a description, and the largest error of pixels."""
    found, worst = {}, 0.0
    if len(ours) != len(theirs):
        found["levels"] = "%d levels, not %d" % (len(ours), len(theirs))
    for level, ((a, got), (b, expected)) in enumerate(zip(ours, theirs)):
        pairs = [
            ("size", (a.width, a.height), (b.width, b.height)),
            ("type", str(a.format), str(b.format)),
            ("channels", a.channelnames, b.channelnames),
            ("tile", (a.tile_width, a.tile_height), (b.tile_width, b.tile_height)),
        ]
        if level == 0:
            window = lambda s: (s.x, s.y, s.full_x, s.full_y, s.full_width, s.full_height)
            pairs.append(("window", window(a), window(b)))
            pairs.append(("planes", a["planarconfig"] if "planarconfig" in names_of(a) else None,
                          b["planarconfig"] if "planarconfig" in names_of(b) else None))
        for name, x, y in pairs:
            if x != y:
                found.setdefault(name, "level %d has %s, not %s" % (level, x, y))
        if got.shape == expected.shape:
            error = pixel_error(got, expected, str(b.format))
            worst = max(worst, error)
            if error > 1:
                found.setdefault("pixels", "level %d differs by %.2f times what is allowed" % (level, error))
    if ours and theirs:
        a, b = ours[0][0], theirs[0][0]
        for name in NAMES + ("oiio:AverageColor",) + tuple(case.names):
            x, y = a.getattribute(name), b.getattribute(name)
            if not same(x, y):
                found[name] = "%s, not %s" % (str(x)[:40], str(y)[:40])
    return found, worst


def names_of(spec):
    return [p.name for p in spec.extra_attribs]


def same(x, y):
    """True for equal metadata, where numbers may differ in their last digits."""
    if x is None or y is None:
        return x is y
    try:
        if isinstance(x, str):
            x, y = numbers(x), numbers(y)
        return np.shape(x) == np.shape(y) and np.allclose(np.array(x, "f8"), np.array(y, "f8"), rtol=1e-5, atol=4e-3 * (np.size(x) > 16))
    except (ValueError, TypeError):
        return x == y


def execute(program, case, folder, name):
    """Runs a program. Returns its status and the texture."""
    output = folder / (name + case.output)
    output.unlink(missing_ok=True)
    command = [str(word) for word in program] + case.options.split() + [case.source, "-o", output.name]
    result = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120)
    if result.returncode not in (0, 1):
        print(" ".join(command), result.stdout[-300:], result.stderr[-300:])
    return result.returncode, output


def main():
    parser = argparse.ArgumentParser()
    root = pathlib.Path(__file__).resolve().parents[2]
    parser.add_argument("--granita", default=root / "target/release/maketx", help="our maketx")
    parser.add_argument("--only", default="", help="cases whose options contain this word")
    parser.add_argument("--keep", help="a folder for the textures")
    parser.add_argument("--table", help="a file for the table of the groups")
    arguments = parser.parse_args()
    package = pathlib.Path(oiio.__file__).parent
    found = [p for p in (package / "bin/maketx", package.parent / "bin/maketx") if p.exists()]
    theirs = str(found[0]) if found else shutil.which("maketx")
    ours = [pathlib.Path(arguments.granita).resolve(), "-profile", "oiio"]
    if theirs is None or not ours[0].exists():
        sys.exit("maketx.py: there is no %s" % (ours[0] if theirs else "maketx of OpenImageIO"))
    os.environ["PYTHONPATH"] = os.pathsep.join(sys.path)
    temporary = tempfile.TemporaryDirectory()
    folder = pathlib.Path(arguments.keep or temporary.name)
    folder.mkdir(exist_ok=True)
    inputs(folder)
    lines = ["| options | input | texture | largest difference | result |", "|---|---|---|---|---|"]
    print("\n".join(lines))
    groups, failures = [], 0
    for case in cases():
        if isinstance(case, str):
            groups.append([case, 0, 0.0, {}])
            continue
        if arguments.only not in case.options + " " + case.source:
            continue
        status, mine = execute(ours, case, folder, "ours-")
        expected, other = execute([theirs], case, folder, "theirs-")
        faults, worst = {}, 0.0
        if status != expected:
            faults["status"] = "status %d, not %d" % (status, expected)
        elif status == 0:
            faults, worst = differences(levels(mine), levels(other), case)
        unexpected = {part: what for part, what in faults.items() if part not in case.parts}
        failures += bool(unexpected)
        result = "; ".join("%s: %s" % item for item in unexpected.items()) or (
            case.reason if faults else ("both refuse" if status else "equal"))
        options = case.options.replace(MATRIX, "M ...")
        error = "%.2f" % worst if status == 0 and expected == 0 else ""
        lines.append("| `%s` | %s | %s | %s | %s |" % (options, case.source, case.output, error, result))
        print(lines[-1], flush=True)
        group = groups[-1]
        group[1] += 1
        group[2] = max(group[2], 0 if "pixels" in faults else worst)
        if faults:
            words = group[3].setdefault(result, [])
            words.append("`%s`" % options if options else "no option (%s)" % case.source)
    print("%d cases, %d differ without a reason" % (sum(group[1] for group in groups), failures))
    if arguments.table:
        lines = ["| options | cases | largest difference | different |", "|---|---|---|---|"]
        for name, count, worst, found in groups:
            told = ["%s: %s" % (", ".join(dict.fromkeys(words)), reason) for reason, words in found.items()]
            lines.append("| %s | %d | %.2f | %s |" % (name, count, worst, "; ".join(told)))
        pathlib.Path(arguments.table).write_text("\n".join(lines) + "\n")
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    main()
