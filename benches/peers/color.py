"""Compares conversions of colours with OpenColorIO, for all pairs of spaces of configurations.

    python3 benches/peers/color.py [--convert PATH] [--config FILE ...] [--all]

It needs the package opencolorio, which has the other library (`pip install opencolorio`). Without it the script prints
a line and ends. The program of `--convert` is the example of granita-color: `cargo build -p granita-color --example
convert`.

Without `--config` these configurations are compared: the built-in one, with OpenColorIO's configurations cg-config and
studio-config (its newest that the library has), and configurations of versions 1 and 2 that the script writes, with
every transform and every format of files that both read. Colours are those of a cube from 0.03 to 1, greys up to 4, and some
saturated ones. Black is left out, because powers magnify the rounding of a channel that is nearly 0. Values may differ by 1e-5 of the larger one, or by 1e-6. Where a space has a table of OpenColorIO and a
function here, the table is the coarser one, and values may differ by 2e-3 of the mean (`LOOSE`). Processors of OpenColorIO run without
optimisation, whose fast powers have errors of 1e-5.
"""

import argparse
import itertools
import pathlib
import subprocess
import sys
import tempfile

try:
    import PyOpenColorIO as ocio
except ImportError:
    print("color.py: the package opencolorio is not installed: pip install opencolorio")
    sys.exit(0)

RELATIVE, ABSOLUTE = 1e-5, 1e-6
# OpenColorIO has these functions as tables of 4096 entries, or of all halves.
LOOSE = ("ACEScc", "Canon", "C-Log", "Apple Log", "ADX", "HLG", "PQ", "ST2084", "ST-2084", "Apple Wide")
LOOSE_RELATIVE = 2e-3


def colors():
    """Returns colours: a cube of values, greys, and extreme ones."""
    cube = list(itertools.product((0.03, 0.18, 0.5, 0.9, 1.0), repeat=3))
    greys = [(v, v, v) for v in (0.001, 0.004, 0.03, 0.1, 0.25, 0.4, 0.6, 0.8, 1.5, 4.0)]
    return cube + greys + [(4.0, 0.2, 0.01), (0.01, 2.0, 0.3)]


def ours(program, config, jobs, values):
    """Returns the values or the message of each job."""
    numbers = " ".join("%.9g" % v for color in values for v in color)
    text = "".join("%s\t%s\t%s\n" % (source, target, numbers) for source, target in jobs)
    run = subprocess.run([program, config], input=text, capture_output=True, text=True, check=False)
    if run.returncode:
        sys.exit("color.py: %s: %s" % (config, run.stderr.strip()))
    lines = run.stdout.splitlines()
    return [line if line.startswith("error") else [float(w) for w in line.split()] for line in lines]


def theirs(config, source, target, values):
    """Returns the values of OpenColorIO, or its message."""
    try:
        if "|" in target:
            display, view = target.split("|")
            processor = config.getProcessor(source, display, view, ocio.TRANSFORM_DIR_FORWARD)
        else:
            processor = config.getProcessor(source, target)
        cpu = processor.getOptimizedCPUProcessor(ocio.OPTIMIZATION_NONE)
    except ocio.Exception as error:
        return "error " + str(error).splitlines()[0]
    return [v for color in values for v in cpu.applyRGB(list(color))]


def worst(a, b):
    """Returns the largest difference, as a part of what is allowed, and where it is."""
    found, place = 0.0, 0
    for i, (x, y) in enumerate(zip(a, b)):
        if x != x or y != y:
            bad = (x != x) != (y != y)
            part = float("inf") if bad else 0.0
        elif abs(x) > 1e30 or abs(y) > 1e30:
            part = 0.0
        else:
            # A matrix mixes channels, so that a small result has the error of the largest of its colour.
            color = b[i - i % 3 : i - i % 3 + 3]
            size = max(abs(v) for v in color if v == v)
            part = abs(x - y) / (ABSOLUTE + RELATIVE * size)
        if part > found:
            found, place = part, i
    return found, place


def compare(program, name, path, config, jobs, verbose):
    """Compares jobs. Returns the number of those that differ."""
    values = colors()
    results = ours(program, path, jobs, values)
    bad = loose = refused = 0
    largest = 0.0
    for (source, target), got in zip(jobs, results):
        expected = theirs(config, source, target, values)
        label = "%s -> %s" % (source, target)
        if isinstance(got, str) or isinstance(expected, str):
            if isinstance(got, str) != isinstance(expected, str):
                refused += 1
                print("  %s: %s" % (label, got if isinstance(got, str) else expected))
            continue
        part, place = worst(got, expected)
        if part > 1 and any(word in label for word in LOOSE) and part <= LOOSE_RELATIVE / RELATIVE:
            loose += 1
            continue
        if part > 1:
            bad += 1
            if verbose or bad < 20:
                color = values[place // 3]
                print("  %s: %g and %g of %s" % (label, got[place], expected[place], color))
        largest = max(largest, part)
    print("%s: %d conversions, %d differ, %d within the error of a table, %d refused by one; largest error %.2g of 1e-5" % (
        name, len(jobs), bad, loose, refused, largest))
    return bad


def pairs(config, sort=None):
    """Returns all pairs of colour spaces and all views from the linear one."""
    kinds = ocio.SEARCH_REFERENCE_SPACE_ALL, ocio.COLORSPACE_ALL
    names = [space.getName() for space in config.getColorSpaces(*kinds)]
    jobs = [(a, b) for a in names for b in names if a != b]
    linear = config.getColorSpace("scene_linear") or config.getColorSpace(names[0])
    for display in config.getDisplays():
        for view in config.getViews(display):
            if not view.startswith("ACES"):
                jobs.append((linear.getName(), "%s|%s" % (display, view)))
    return jobs


VERSION_2 = """ocio_profile_version: 2.1
search_path: luts
strictparsing: true
environment: {SHOT: a}
roles: {scene_linear: lin, default: lin, aces_interchange: lin, cie_xyz_d65_interchange: xyz}
displays:
  screen:
    - !<View> {name: plain, colorspace: power}
    - !<View> {name: graded, colorspace: power, looks: "+warm, -cool"}
    - !<View> {name: toned, view_transform: tone, display_colorspace: shown}
looks:
  - !<Look> {name: warm, process_space: log, transform: !<CDLTransform> {slope: [1.1, 1, 0.9], offset: [0.02, 0, 0]}}
  - !<Look> {name: cool, process_space: lin, transform: !<MatrixTransform> {matrix: [0.9, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1.1, 0, 0, 0, 0, 1]}}
default_view_transform: tone
view_transforms:
  - !<ViewTransform> {name: tone, from_scene_reference: !<CDLTransform> {power: [0.8, 0.8, 0.8], saturation: 0.9}}
display_colorspaces:
  - !<ColorSpace> {name: xyz}
  - !<ColorSpace> {name: shown, from_display_reference: !<BuiltinTransform> {style: DISPLAY - CIE-XYZ-D65_to_sRGB}}
colorspaces:
  - !<ColorSpace> {name: lin, encoding: scene-linear}
  - !<ColorSpace> {name: data, isdata: true}
"""

TRANSFORMS = {
    "power": "ExponentTransform> {value: 2.2}",
    "power3": "ExponentTransform> {value: [2.2, 2.0, 1.8, 1], style: mirror, direction: inverse}",
    "passing": "ExponentTransform> {value: 0.5, style: pass_thru}",
    "curve": "ExponentWithLinearTransform> {gamma: 2.4, offset: 0.055}",
    "curve3": "ExponentWithLinearTransform> {gamma: [2.4, 2.2, 2.6, 1], offset: [0.055, 0.1, 0.04, 0], style: mirror, direction: inverse}",
    "matrix": "MatrixTransform> {matrix: [0.6, 0.3, 0.1, 0, 0.1, 0.8, 0.1, 0, 0, 0.1, 0.9, 0, 0, 0, 0, 1], offset: [0.01, 0.02, -0.03, 0]}",
    "back": "MatrixTransform> {matrix: [0.6, 0.3, 0.1, 0, 0.1, 0.8, 0.1, 0, 0, 0.1, 0.9, 0, 0, 0, 0, 1], offset: [0.01, 0.02, -0.03, 0], direction: inverse}",
    "log": "LogAffineTransform> {base: 10, log_side_slope: 0.25, log_side_offset: 0.4, lin_side_slope: 1.2, lin_side_offset: 0.2}",
    "log3": "LogAffineTransform> {base: 2, log_side_slope: [0.2, 0.21, 0.22], log_side_offset: 0.4, lin_side_slope: [1, 1.1, 1.2], lin_side_offset: 0.3, direction: inverse}",
    "purelog": "LogTransform> {base: 10}",
    "antilog": "LogTransform> {base: 2, direction: inverse}",
    "camera": "LogCameraTransform> {base: 10, log_side_slope: 0.24719, log_side_offset: 0.385537, lin_side_slope: 5.555556, lin_side_offset: 0.052272, lin_side_break: 0.010591}",
    "camera3": "LogCameraTransform> {base: 2, log_side_slope: 0.0570776, log_side_offset: 0.554795, lin_side_slope: 1, lin_side_offset: 0, lin_side_break: [0.0078125, 0.01, 0.02], linear_slope: [10, 11, 12], direction: inverse}",
    "cdl": "CDLTransform> {slope: [1.2, 0.9, 1], offset: [0.02, -0.01, 0], power: [1.1, 0.9, 1.2], saturation: 0.8}",
    "cdlasc": "CDLTransform> {slope: [1.2, 0.9, 1], offset: [0.02, -0.01, 0], power: [1.1, 0.9, 1.2], saturation: 1.3, style: asc}",
    "cdlback": "CDLTransform> {slope: [1.2, 0.9, 1], offset: [0.02, -0.01, 0], power: [1.1, 0.9, 1.2], saturation: 0.8, direction: inverse}",
    "range": "RangeTransform> {min_in_value: 0, max_in_value: 1, min_out_value: 0.1, max_out_value: 0.9}",
    "openrange": "RangeTransform> {min_in_value: 0, max_in_value: 1, min_out_value: 0.1, max_out_value: 0.9, style: noClamp}",
    "low": "RangeTransform> {min_in_value: 0.1, min_out_value: 0.1}",
    "exposure": "ExposureContrastTransform> {style: linear, exposure: 0.5, contrast: 1.2, gamma: 1, pivot: 0.18}",
    "exposurevideo": "ExposureContrastTransform> {style: video, exposure: 0.5, contrast: 1.2, gamma: 1, pivot: 0.18}",
    "exposurelog": "ExposureContrastTransform> {style: log, exposure: -0.5, contrast: 1.2, gamma: 1, pivot: 0.18}",
    "surround": "FixedFunctionTransform> {style: Rec2100_Surround, params: [0.9]}",
    "xyy": "FixedFunctionTransform> {style: XYZ_TO_xyY}",
    "uvy": "FixedFunctionTransform> {style: XYZ_TO_uvY}",
    "gamut": "FixedFunctionTransform> {style: ACES_GamutComp13, params: [1.147, 1.264, 1.312, 0.815, 0.803, 0.88, 1.2]}",
    "group": "GroupTransform>\n      direction: inverse\n      children:\n        - !<ExponentTransform> {value: 2.2}\n        - !<MatrixTransform> {offset: [0.1, 0, 0, 0]}",
    "cube1": "FileTransform> {src: one.cube}",
    "cube1back": "FileTransform> {src: one.cube, direction: inverse}",
    "cube3": "FileTransform> {src: three.cube}",
    "cube3t": "FileTransform> {src: three.cube, interpolation: tetrahedral}",
    "cube3n": "FileTransform> {src: three.cube, interpolation: nearest}",
    "resolve": "FileTransform> {src: resolve.cube}",
    "spi1d": "FileTransform> {src: a.spi1d, interpolation: linear}",
    "spi1dback": "FileTransform> {src: a.spi1d, interpolation: linear, direction: inverse}",
    "spi3d": "FileTransform> {src: a.spi3d, interpolation: linear}",
    "spimtx": "FileTransform> {src: $SHOT.spimtx}",
    "csp1": "FileTransform> {src: one.csp}",
    "csp3": "FileTransform> {src: three.csp}",
    "three3dl": "FileTransform> {src: a.3dl, interpolation: linear}",
    "cc": "FileTransform> {src: a.cc}",
    "ccc": "FileTransform> {src: a.ccc, cccid: second}",
    "clf": "FileTransform> {src: a.clf}",
}


def write_files(folder):
    """Writes configurations of both versions, and the files that they name."""
    luts = folder / "luts"
    luts.mkdir()

    def curve(v):
        return v**0.7 * 0.9 + 0.05

    def mix(r, g, b):
        return (0.8 * r + 0.2 * g * g, 0.9 * g + 0.1 * b * r, 0.7 * b + 0.3 * r)

    one = "\n".join("%.7f %.7f %.7f" % (curve(i / 32), curve(i / 32) ** 2, i / 32) for i in range(33))
    (luts / "one.cube").write_text("TITLE \"one\"\nLUT_1D_SIZE 33\nDOMAIN_MIN 0 0 0\nDOMAIN_MAX 2 2 1\n" + one + "\n")
    grid = [(r / 8, g / 8, b / 8) for b in range(9) for g in range(9) for r in range(9)]
    three = "\n".join("%.7f %.7f %.7f" % mix(*c) for c in grid)
    (luts / "three.cube").write_text("LUT_3D_SIZE 9\n" + three + "\n")
    (luts / "resolve.cube").write_text("LUT_1D_SIZE 33\nLUT_1D_INPUT_RANGE 0 2\nLUT_3D_SIZE 9\n" + one + "\n" + three + "\n")
    rows = "\n".join("%.7f" % curve(i / 64) for i in range(65))
    (luts / "a.spi1d").write_text("Version 1\nFrom -0.1 1.5\nLength 65\nComponents 1\n{\n" + rows + "\n}\n")
    body = "\n".join(
        "%d %d %d %.7f %.7f %.7f" % ((r, g, b) + mix(r / 4, g / 4, b / 4)) for r in range(5) for g in range(5) for b in range(5)
    )
    (luts / "a.spi3d").write_text("SPILUT 1.0\n3 3\n5 5 5\n" + body + "\n")
    (luts / "a.spimtx").write_text("0.9 0.1 0 655.35\n0 1 0 0\n0.05 0.05 0.9 -65.535\n")
    head = "CSPLUTV100\n%s\n\nBEGIN METADATA\nEND METADATA\n\n" + "2\n0.0 2.0\n0.0 1.0\n" * 3 + "\n"
    (luts / "one.csp").write_text(head % "1D" + "33\n" + one + "\n")
    (luts / "three.csp").write_text(head % "3D" + "9 9 9\n" + three + "\n")
    codes = "\n".join(
        "%d %d %d" % tuple(round(4095 * v) for v in mix(r / 8, g / 8, b / 8)) for r in range(9) for g in range(9) for b in range(9)
    )
    (luts / "a.3dl").write_text("0 128 256 384 512 640 768 896 1023\n" + codes + "\n")
    sop = "<SOPNode><Slope>1.1 1 0.9</Slope><Offset>0.01 0 0.02</Offset><Power>0.9 1 1.1</Power></SOPNode><SatNode><Saturation>0.9</Saturation></SatNode>"
    (luts / "a.cc").write_text("<ColorCorrection id=\"first\">" + sop + "</ColorCorrection>")
    (luts / "a.ccc").write_text(
        "<ColorCorrectionCollection xmlns=\"urn:ASC:CDL:v1.2\"><ColorCorrection id=\"first\">%s</ColorCorrection>"
        "<ColorCorrection id=\"second\">%s</ColorCorrection></ColorCorrectionCollection>" % (sop, sop.replace("1.1 1 0.9", "0.8 1 1"))
    )
    (luts / "a.clf").write_text(
        "<?xml version=\"1.0\"?>\n<ProcessList id=\"x\" compCLFversion=\"3\">\n"
        "<Matrix inBitDepth=\"32f\" outBitDepth=\"32f\"><Array dim=\"3 4\">0.9 0.1 0 0.01 0 1 0 0 0 0.2 0.8 0</Array></Matrix>\n"
        "<Exponent inBitDepth=\"32f\" outBitDepth=\"32f\" style=\"monCurveRev\"><ExponentParams exponent=\"2.4\" offset=\"0.055\"/></Exponent>\n"
        "<LUT1D inBitDepth=\"32f\" outBitDepth=\"10i\"><Array dim=\"3 1\">0 400 1023</Array></LUT1D>\n"
        "<ASC_CDL inBitDepth=\"10i\" outBitDepth=\"32f\" style=\"FwdNoClamp\">" + sop + "</ASC_CDL>\n"
        "<Log inBitDepth=\"32f\" outBitDepth=\"32f\" style=\"linToLog\"><LogParams base=\"10\" logSideSlope=\"0.2\" logSideOffset=\"0.6\" linSideSlope=\"1.1\" linSideOffset=\"0.3\"/></Log>\n"
        "<Range inBitDepth=\"32f\" outBitDepth=\"32f\"><minInValue>0</minInValue><maxInValue>1</maxInValue><minOutValue>0</minOutValue><maxOutValue>1</maxOutValue></Range>\n"
        "</ProcessList>\n"
    )
    text = VERSION_2
    for name, transform in TRANSFORMS.items():
        text += "  - !<ColorSpace>\n    name: %s\n    from_scene_reference: !<%s\n" % (name, transform)
    (folder / "two.ocio").write_text(text)
    old = {
        "power": "ExponentTransform> {value: [2.2, 2.2, 2.2, 1]}",
        "cdl": "CDLTransform> {slope: [1.2, 0.9, 1], offset: [0.02, -0.01, 0], power: [1.1, 0.9, 1.2], sat: 0.8}",
        "log": "LogTransform> {base: 10}",
        "allocation": "AllocationTransform> {allocation: lg2, vars: [-8, 5, 0.00390625]}",
        "uniform": "AllocationTransform> {allocation: uniform, vars: [-0.5, 1.5]}",
        "cc": "FileTransform> {src: a.cc}",
        "spi1d": "FileTransform> {src: a.spi1d, interpolation: nearest}",
    }
    text = "ocio_profile_version: 1\nsearch_path: luts:other\nstrictparsing: true\nroles: {scene_linear: lin, default: lin}\ndisplays:\n  d:\n    - !<View> {name: v, colorspace: power}\ncolorspaces:\n  - !<ColorSpace> {name: lin}\n"
    for name, transform in old.items():
        text += "  - !<ColorSpace>\n    name: %s\n    from_reference: !<%s\n" % (name, transform)
    (folder / "one.ocio").write_text(text)


def main():
    root = pathlib.Path(__file__).resolve().parents[2]
    parser = argparse.ArgumentParser()
    parser.add_argument("--convert", default=str(root / "target/debug/examples/convert"))
    parser.add_argument("--config", action="append", default=[])
    parser.add_argument("--all", action="store_true", help="print every conversion that differs")
    args = parser.parse_args()
    if not pathlib.Path(args.convert).exists():
        sys.exit("color.py: %s is not built: cargo build -p granita-color --example convert" % args.convert)
    bad = 0
    for path in args.config:
        config = ocio.Config.CreateFromFile(path)
        bad += compare(args.convert, path, path, config, pairs(config), args.all)
    if not args.config:
        for name in ("cg-config-latest", "studio-config-latest"):
            config = ocio.Config.CreateFromFile("ocio://" + name)
            bad += compare(args.convert, name, "ocio://default", config, pairs(config), args.all)
        with tempfile.TemporaryDirectory() as folder:
            folder = pathlib.Path(folder)
            write_files(folder)
            for name in ("one.ocio", "two.ocio"):
                path = str(folder / name)
                config = ocio.Config.CreateFromFile(path)
                # From and to the reference, and the views.
                jobs = [job for job in pairs(config) if "lin" in job or "|" in job[1]]
                bad += compare(args.convert, name, path, config, jobs, args.all)
    sys.exit(1 if bad else 0)


if __name__ == "__main__":
    main()
