"""Compares imgtool with OpenImageIO's oiiotool, option by option.

    python3 benches/peers/imgtool.py [--granita PATH] [--only WORD] [--table FILE]

It needs the package OpenImageIO, which has the other program (`pip install OpenImageIO numpy`). Without it the script
prints a line and ends.

Each case runs both programs with the same command line in a folder with the same images, and compares the images that
they write: size, windows, channels, type and pixels. Pixels may differ by one code value of 8 bits, and those of halves
and floats by 2^-9 of the larger one or by 1/255. A case with a reason is expected to differ in what the reason says.
"""

import argparse
import os
import pathlib
import shlex
import shutil
import subprocess
import sys
import tempfile

try:
    import numpy as np
    import OpenImageIO as oiio
except ImportError:
    print("imgtool.py: the package OpenImageIO is not installed: pip install OpenImageIO numpy")
    sys.exit(0)

CODE, RELATIVE = 1 / 255, 2**-9
DEPTH = "floats become 16 bits, where 3.2.2 writes 8"
RADIAL = "3.2.2 reads wrong texels for radial filters where the two sides shrink by different factors"
FILTERS = (
    "box triangle gaussian sharp-gaussian catmull-rom blackman-harris sinc lanczos3 radial-lanczos3 nuke-lanczos6 "
    "mitchell bspline disk cubic keys simon rifman"
).split()


def cases():
    """Returns groups of command lines, each line with a reason why it may differ, or none."""
    yield "files and types", [
        ("photo.png -o o.exr", ""),
        ("photo.png -d half -o o.exr", ""),
        ("photo.png -d float --compression piz -o o.exr", ""),
        ("photo.png -d uint16 -o o.tif", ""),
        ("hdr.exr -d uint8 -o o.png", ""),
        ("hdr.exr -d half --tile 64 64 -o o.tif", "TIFF of halves"),
        ("hdr.exr -d float --tile 32 32 --compression none -o o.exr", ""),
        ("shorts.tif -o o.png", ""),
        ("win.exr -o o.png", DEPTH),
        ("win.exr --noautocrop -o o.png", DEPTH),
        ("alpha.exr -o o.png", "colours are divided by alpha before they are rounded"),
    ]
    yield "`--resize`", [
        ("hdr.exr --resize %s -d float -o o.exr" % size, "")
        for size in ("50%", "200%", "100x0", "0x40", "33%x71%", "97x53", "300x20")
    ] + [("win.exr --resize %s -d float -o o.exr" % size, "") for size in ("50%", "64x48", "40x30+3+4", "200x0")]
    yield "`--resize`, filters", [
        ("hdr.exr --resize:filter=%s %s -d float -o o.exr" % (name, size), RADIAL if name in ("disk", "radial-lanczos3") else "")
        for name in FILTERS
        for size in ("50%", "150%", "40x71")
    ]
    yield "`--resample`, `--fit`", [
        ("hdr.exr --resample 50% -d float -o o.exr", ""),
        ("hdr.exr --resample 170x90 -d float -o o.exr", ""),
        ("hdr.exr --resample:interp=0 170x90 -d float -o o.exr", ""),
        ("win.exr --resample 50% -d float -o o.exr", ""),
        ("hdr.exr --fit 70x70 -d float -o o.exr", ""),
        ("hdr.exr --fit:pad=1 70x70 -d float -o o.exr", ""),
        ("hdr.exr --fit 300x300 -d float -o o.exr", ""),
        ("hdr.exr --fit:fillmode=width 70x70 -d float -o o.exr", ""),
        ("hdr.exr --fit:fillmode=height 70x70 -d float -o o.exr", ""),
        ("win.exr --fit 50x50 -d float -o o.exr", ""),
    ]
    yield "windows", [
        ("win.exr --crop 20x20+10+10 -o o.exr", ""),
        ("win.exr --crop 0,0,9,9 -o o.exr", ""),
        ("win.exr --crop 300x20-10-10 -o o.exr", ""),
        ("win.exr --cut 20x20+10+10 -o o.exr", ""),
        ("win.exr --cut 0,0,79,79 -o o.exr", ""),
        ("win.exr --croptofull -o o.exr", ""),
        ("win.exr --trim -o o.exr", ""),
        ("win.exr --fullpixels -o o.exr", ""),
        ("win.exr --origin +1+2 -o o.exr", ""),
        ("win.exr --originoffset +1-2 -o o.exr", ""),
        ("win.exr --fullsize 90x90 -o o.exr", ""),
        ("win.exr --fullsize +3+4 -o o.exr", ""),
        ("alpha.exr win.exr --paste +20+20 -o o.exr", ""),
        ("alpha.exr win.exr --paste:mergeroi=1 +20+20 -o o.exr", ""),
        ("hdr.exr photo.png --mosaic 2x1 -o o.exr", "3.2.2 writes halves of an image of floats"),
        ("hdr.exr win.exr alpha.exr --mosaic:pad=5 2x2 -o o.exr", ""),
    ]
    yield "orientation", [
        ("win.exr --%s -o o.exr" % name, "")
        for name in ("flip", "flop", "rotate90", "rotate180", "rotate270", "transpose", "cshift +10-5")
    ] + [("win.exr --orientation %d --reorient -o o.exr" % n, "") for n in range(1, 9)]
    yield "channels", [
        ("alpha.exr --ch %s -o o.exr" % text, "")
        for text in ("R,G", "B,1,R", "G=R,B,A=0.5", "A,A,A", "R,G,B,A=1.0")
    ] + [
        ("alpha.exr --nchannels 2 -o o.exr", ""),
        ("alpha.exr --nchannels 6 -o o.exr", "3.2.2 calls the fifth channel Z"),
        ("alpha.exr --chnames x,y,z,w -o o.exr", ""),
        ("alpha.exr hdr.exr --chappend -o o.exr", ""),
        ("hdr.exr --chsum:weight=.2,.7,.1 -o o.exr", ""),
        ("hdr.exr --chsum -o o.exr", ""),
        ("hdr.exr --maxchan -o o.exr", ""),
        ("hdr.exr --minchan -o o.exr", ""),
    ]
    yield "colour spaces", [
        ("hdr.exr --colorconvert %s -d float -o o.exr" % spaces, "")
        for spaces in ("lin_rec709 sRGB", "lin_rec709 ACEScg", "ACEScg ACEScct", "lin_rec709 g22_rec709", "ACES2065-1 lin_rec2020")
    ] + [
        ("alpha.exr --colorconvert%s lin_rec709 sRGB -d float -o o.exr" % option, "") for option in ("", ":unpremult=1")
    ] + [
        ("hdr.exr --iscolorspace ACEScg --tocolorspace lin_rec709 -d float -o o.exr", ""),
        ("photo.png --tocolorspace lin_rec709 -d float -o o.exr", ""),
        ("hdr.exr --ociodisplay:from=lin_rec709 default Un-tone-mapped -d float -o o.exr", ""),
        ("hdr.exr --iscolorspace ACEScg --ociodisplay 'sRGB - Display' Un-tone-mapped -d float -o o.exr", ""),
    ]
    yield "arithmetic", [
        ("hdr.exr photo.exr --%s -d float -o o.exr" % name, "")
        for name in ("add", "sub", "mul", "div", "absdiff", "min", "max")
    ] + [
        ("win.exr hdr.exr --add -d float -o o.exr", ""),
        ("win.exr hdr.exr --mul -d float -o o.exr", ""),
        ("hdr.exr photo.exr hdr.exr --mad -d float -o o.exr", ""),
    ] + [
        ("hdr.exr --%sc %s -d float -o o.exr" % (name, value), "")
        for name in ("add", "sub", "mul", "div", "absdiff", "min", "max", "pow")
        for value in ("0.5", "0.1,0.2,0.3")
    ] + [
        ("alpha.exr --%s -d float -o o.exr" % name, "")
        for name in ("invert", "invert:chbegin=1:chend=4", "abs", "premult", "unpremult", "clamp:min=0.2:max=0.7",
                     "clamp:clampalpha=1", "saturate 0.3", "saturate 1.5")
    ] + [
        ("alpha.exr hdr4.exr --over -d float -o o.exr", ""),
        ("win.exr hdr4.exr --over -d float -o o.exr", ""),
        ("photo.png --mulc 0.5 -o o.png", ""),
    ]
    yield "filters", [
        ("hdr.exr --blur %s -d float -o o.exr" % size, "") for size in ("3x3", "5x5", "9x5", "15x15", "5.5x5.5")
    ] + [
        ("hdr.exr --blur:kernel=%s 5x5 -d float -o o.exr" % name, "") for name in FILTERS
        if name not in ("nuke-lanczos6",)
    ] + [
        ("win.exr --blur 5x5 -d float -o o.exr", ""),
        ("hdr.exr --unsharp -d float -o o.exr", ""),
        ("hdr.exr --unsharp:width=5:contrast=1.5:threshold=0.05 -d float -o o.exr", ""),
        ("broken.exr --fixnan black -d float -o o.exr", ""),
        ("broken.exr --fixnan box3 -d float -o o.exr", "3.2.2 also averages values that it has just replaced"),
        ("hdr.exr --fill:color=.1,.2,.3 20x20+10+10 -d float -o o.exr", ""),
    ]
    yield "patterns", [
        ("--create 64x48+3+4 3 -o o.exr", ""),
        ("--pattern constant:color=.1,.2,.3 64x48 3 -d float -o o.exr", ""),
        ("--pattern checker:width=5:height=7 64x48 3 -d float -o o.exr", ""),
        ("--pattern checker:width=5:color1=.1,.2,.3:color2=.5,.6,.7:xoffset=2:yoffset=3 64x48 3 -d float -o o.exr", "3.2.2 has larger squares around the offset"),
        ("--pattern fill:top=0,0,0:bottom=1,.5,1 64x48 3 -d float -o o.exr", ""),
        ("--pattern fill:left=0,0,0:right=1,.5,1 64x48 3 -d float -o o.exr", ""),
        ("--pattern fill:topleft=0,0,0:topright=1,0,1:bottomleft=.1,.2,.3:bottomright=1,1,1 64x48 3 -d float -o o.exr", ""),
    ]
    yield "several options", [
        ("photo.png --resize 50% --flop --mulc 0.8 -o o.exr", ""),
        ("photo.png --dup --blur 9x9 --sub --abs --cut 50x50+20+20 -d float -o o.exr", ""),
        ("hdr.exr photo.exr --swap --sub --dup --add -d float -o o.exr", ""),
    ]
    yield "exit codes of `--diff`", [
        ("--diff hdr.exr hdr.exr", ""),
        ("--diff hdr.exr photo.exr", ""),
        ("--fail 100 --warn 0.0001 --diff hdr.exr photo.exr", "idiff of 3.2.2 does not warn"),
        ("--fail 100 --warn 100 --diff hdr.exr photo.exr", ""),
        ("--diff hdr.exr win.exr", "other sizes have the status 3, as the manual of idiff says"),
        ("--diff hdr.exr none.exr", ""),
    ]


def images(folder):
    """Writes the images of the cases."""
    rng = np.random.default_rng(3)
    height, width = 96, 128
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    base = np.stack([x / width, y / height, 0.5 + 0.5 * np.sin(x * y / 400)], axis=2)
    photo = np.clip(base * 0.8 + 0.1 * rng.random(base.shape, dtype=np.float32), 0, 1).astype(np.float32)
    hdr = (photo**2 * 4 + 0.01).astype(np.float32)
    alpha = np.clip(0.1 + x / width, 0, 1)[..., None].astype(np.float32)
    rgba = np.concatenate([photo * alpha, alpha], axis=2)

    def write(name, values, kind, window=None):
        spec = oiio.ImageSpec(values.shape[1], values.shape[0], values.shape[2], kind)
        if window:
            spec.x, spec.y, spec.full_width, spec.full_height = window
        spec.full_x = spec.full_y = 0
        out = oiio.ImageOutput.create(str(folder / name))
        out.open(str(folder / name), spec)
        out.write_image(values)
        out.close()

    write("photo.png", photo, "uint8")
    write("photo.exr", photo, "float")
    write("hdr.exr", hdr, "float")
    write("hdr4.exr", np.concatenate([hdr, np.ones_like(alpha)], axis=2), "float")
    write("alpha.exr", rgba, "float")
    write("shorts.tif", photo, "uint16")
    write("win.exr", rgba[:48, :64], "float", (5, 7, 100, 80))
    broken = hdr.copy()
    broken[10, 10] = np.nan
    broken[40:42, 50:52, 1] = np.inf
    write("broken.exr", broken, "float")


def described(path):
    """Returns the description and the pixels of an image."""
    image = oiio.ImageInput.open(str(path))
    if not image:
        raise ValueError(oiio.geterror())
    spec = image.spec()
    facts = {
        "size": (spec.width, spec.height),
        "windows": (spec.x, spec.y, spec.full_x, spec.full_y, spec.full_width, spec.full_height),
        "channels": tuple(spec.channelnames),
        "type": str(spec.format),
    }
    return facts, np.asarray(image.read_image("float")).reshape(spec.height, spec.width, spec.nchannels)


def compare(ours, theirs):
    """Returns the differences in words, and the largest one of pixels as a multiple of what is allowed."""
    (mine, a), (other, b) = described(ours), described(theirs)
    faults = ["%s %s, not %s" % (name, mine[name], other[name]) for name in mine if mine[name] != other[name]]
    if a.shape != b.shape:
        return faults, 0.0
    if "TIFF" in str(theirs):
        faults = []
    largest = np.maximum(np.abs(a), np.abs(b))
    allowed = np.maximum(CODE, largest * RELATIVE)
    with np.errstate(invalid="ignore"):
        apart = np.where((a == b) | (np.isnan(a) & np.isnan(b)), 0, np.abs(a - b) / allowed)
    apart = np.nan_to_num(apart, nan=1e9)
    worst = float(apart.max()) if apart.size else 0.0
    if worst > 1.001:
        where = np.unravel_index(apart.argmax(), apart.shape)
        faults.append("pixels at %s: %g, not %g" % (where[:2], a[where], b[where]))
    return faults, worst


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--granita", default="target/release/granita")
    parser.add_argument("--only", default="")
    parser.add_argument("--table")
    options = parser.parse_args()
    program = pathlib.Path(oiio.__file__).parent / "bin" / "oiiotool"
    theirs = str(program) if program.exists() else shutil.which("oiiotool")
    idiff = str(program.with_name("idiff"))
    ours = [os.path.abspath(options.granita), "imgtool"]
    if not theirs or not os.path.exists(ours[0]):
        print("imgtool.py: %s" % ("oiiotool is not here" if not theirs else ours[0] + " is not built"))
        return 0
    failed, rows = 0, []
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        images(folder)
        for group, lines in cases():
            worst_of_group, count, different = 0.0, 0, []
            for line, reason in lines:
                if options.only not in group + " " + line:
                    continue
                words, count = shlex.split(line), count + 1
                out = words[words.index("-o") + 1] if "-o" in words else None
                if not out:
                    # idiff has its limits before two names, and no option for comparing.
                    other = subprocess.run([idiff] + [w for w in words if w != "--diff"], cwd=folder, capture_output=True)
                    mine = subprocess.run(ours + words, cwd=folder, capture_output=True)
                    faults = [] if mine.returncode == other.returncode else ["status %d, not %d" % (mine.returncode, other.returncode)]
                    worst = 0.0
                else:
                    results = []
                    for command in (ours, [theirs]):
                        if (folder / out).exists():
                            (folder / out).unlink()
                        ran = subprocess.run(command + words, cwd=folder, capture_output=True, text=True)
                        kept = folder / ("%d-%s" % (len(results), out))
                        if (folder / out).exists():
                            (folder / out).replace(kept)
                        results.append((ran, kept))
                    missing = [ran.stderr + ran.stdout for ran, kept in results if not kept.exists()]
                    faults, worst = (["no file: " + " ".join(missing).strip()], 0.0) if missing else compare(results[0][1], results[1][1])
                    for _, kept in results:
                        kept.unlink(missing_ok=True)
                if not faults:
                    worst_of_group = max(worst_of_group, worst)
                elif reason:
                    different.append("`%s`: %s" % (line, reason))
                else:
                    failed += 1
                    print("%s: %s" % (line, "; ".join(faults)))
            if count:
                print("%-26s %3d cases, largest difference %.2f of what is allowed" % (group, count, worst_of_group))
                rows.append("| %s | %d | %.2f | %s |" % (group, count, worst_of_group, "; ".join(different)))
    if options.table:
        pathlib.Path(options.table).write_text("\n".join(rows) + "\n")
    print("%d cases differ" % failed)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
