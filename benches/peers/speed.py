"""Compares the time and the memory of imgtool and of options of maketx with those of OpenImageIO.

    cargo build --release -p granita
    python3 benches/peers/speed.py [--granita PATH] [--threads 2] [--runs 3] [--only WORD] [--small]

It needs the package OpenImageIO, which has the other programs (`pip install OpenImageIO`). Without it the script prints a
line and ends.

Each case runs both programs on the same image. They alternate, and the fastest of all runs counts. Times are those of the
clock, in seconds; memory is the largest resident size. The last column is the ratio of processor times, which depends less
on other work of the machine. `--small` makes the images a quarter as wide, to try the script.
"""

import argparse
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
SET = 20


def cases():
    """Returns groups of a description, the program, our words and theirs. None stands for the same words."""
    large = [
        ("convert to OpenEXR, zip", "large.tif -d half --compression zip -o OUT.exr"),
        ("convert to TIFF, 8 bits, lzw", "large.tif -d uint8 --compression lzw -o OUT.tif"),
        ("crop to a quarter, TIFF", "large.tif --crop 50%x50%+0+0 -d half --compression zip -o OUT.tif"),
        ("resize to an eighth, lanczos3", "large.tif --resize:filter=lanczos3 12.5% -d half --compression zip -o OUT.exr"),
        ("crop, resize, convert", "large.tif --cut CUT --resize:filter=lanczos3 12.5% -d uint8 -o OUT.png"),
        ("rotate90, half of the values", "large.tif --rotate90 --mulc 0.5 -d half --compression zip -o OUT.tif"),
        ("colorconvert to sRGB", "large.tif --colorconvert lin_rec709 sRGB -d half --compression zip -o OUT.exr"),
    ]
    for about, words in large:
        yield about, "imgtool", words, words
    for about, words in [
        ("maketx, filter lanczos3", "--filter lanczos3 medium.tif -o OUT.tx"),
        ("maketx, bumpslopes", "--bumpslopes bump.tif -o OUT.exr"),
        ("maketx, colorconvert of halves", "--colorconvert lin_rec709 sRGB medium.exr -o OUT.exr"),
    ]:
        yield about, "maketx", words, words
    yield "maketx, UDIM set of %d" % SET, "maketx", "set.<UDIM>.tif -o OUT.<UDIM>.tx", None


def measured(lines, folder):
    """Runs command lines one after the other. Returns the seconds, the largest resident size in MiB, and the seconds of
    processor time."""
    start, peak, busy = time.perf_counter(), 0.0, 0.0
    for words in lines:
        child = subprocess.Popen(words, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        said = child.stderr.read()
        _, status, usage = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        if child.returncode:
            sys.exit("speed.py: %s: %s" % (" ".join(map(str, words)), said.decode(errors="replace").strip()))
        peak = max(peak, usage.ru_maxrss / 1024)
        busy += usage.ru_utime + usage.ru_stime
    return time.perf_counter() - start, peak, busy


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--granita", default=str(ROOT / "target/release/granita"))
    parser.add_argument("--threads", default="2")
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--only", default="")
    parser.add_argument("--small", action="store_true")
    options = parser.parse_args()
    try:
        import OpenImageIO

        programs = pathlib.Path(OpenImageIO.__file__).parent / "bin"
    except ImportError:
        print("speed.py: the package OpenImageIO is not installed: pip install OpenImageIO")
        return 0
    ours = os.path.abspath(options.granita)
    theirs = {
        "imgtool": str(programs / "oiiotool") if (programs / "oiiotool").exists() else shutil.which("oiiotool"),
        "maketx": str(programs / "maketx") if (programs / "maketx").exists() else shutil.which("maketx"),
    }
    if not os.path.exists(ours) or not all(theirs.values()):
        print("speed.py: %s" % ("OpenImageIO's programs are not here" if os.path.exists(ours) else ours + " is not built"))
        return 0
    side = 2048 if options.small else 8192
    with tempfile.TemporaryDirectory() as name:
        folder = pathlib.Path(name)
        brick = str(ROOT / "examples/first/brick.png")

        def image(side, channels, kind, out):
            noise = "noise:type=uniform:max=0.1:seed=4"
            size = "%dx%d" % (side, side)
            words = [brick, "-ch", ",".join("0" * channels), "-resize", size, "-pattern", noise, size, str(channels), "-add"]
            measured([[ours, "imgtool"] + words + ["-clamp", "-d", kind, "-compression", "zip", "-o", out]], folder)

        image(side, 3, "half", "large.tif")
        image(side // 2, 3, "uint8", "medium.tif")
        image(side // 2, 3, "half", "medium.exr")
        image(side // 2, 1, "uint16", "bump.tif")
        image(side // 4, 3, "uint8", "set.1001.tif")
        squares = [1001 + 10 * (i // 5) + i % 5 for i in range(SET)]
        for square in squares[1:]:
            shutil.copyfile(folder / "set.1001.tif", folder / ("set.%d.tif" % square))
        head = ("%d x %d" % (side, side), "ours", "theirs", "ratio", "MiB", "theirs", "ratio", "processor time")
        print("| %s, threads: %s | %s | %s | %s | %s | %s | %s | %s |" % (head[0], options.threads, *head[1:]))
        print("|---|---|---|---|---|---|---|---|")
        for about, tool, mine, other in cases():
            if options.only not in about:
                continue
            cut = "%dx%d+%d+%d" % (side * 3 // 4, side * 3 // 4, side // 8, side // 8)

            def line(words, out):
                return words.replace("OUT", out).replace("CUT", cut).replace("50%x50%", "%dx%d" % (side // 2, side // 2)).split()

            profile = ["-profile", "oiio"] if tool == "maketx" else []
            own = [[ours, tool] + profile + ["--threads", options.threads] + line(mine, "ours")]
            if other is None:
                each = [line(mine, "theirs") for _ in squares]
                foreign = [[w.replace("<UDIM>", str(n)) for w in words] for words, n in zip(each, squares)]
            else:
                foreign = [line(other, "theirs")]
            foreign = [[theirs[tool], "--threads", options.threads] + words for words in foreign]
            best = [None, None]
            for _ in range(options.runs):
                for i, lines in enumerate((own, foreign)):
                    cost = measured(lines, folder)
                    best[i] = min(best[i] or cost, cost)
            (a, b, e), (c, d, f) = best
            row = (about, a, c, a / c, b, d, b / d, e / f)
            print("| %s | %.2f | %.2f | %.2f | %.0f | %.0f | %.2f | %.2f |" % row, flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
