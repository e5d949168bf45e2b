"""Compares what the suite reads with what other programs read, for files of other programs.

    python3 benches/peers/read_matrix.py [--pixels PROGRAM] [--only WORD] [--keep FOLDER] [--table FILE]

Files are written by OpenImageIO, ImageMagick (`convert`), Pillow, libtiff's `tiffcp`, OpenEXR's `exrmaketiled`,
`exrmultiview` and `exrmakepreview`, OpenJPEG's `opj_compress` and libjxl's `cjxl`, in every type and compression that
these write, and read by the same program (those of the programs of formats by the packages or by their counterparts).
The suite reads them by the example `pixels` of `granita-plugin` (`cargo build -p granita-plugin --example pixels`).
Programs and packages that are missing are named, and left out.

A file is *equal* when all values are the same as fractions of the largest value, *near* when they differ by at most one
code value of 8 bits (decoders of data with loss may round differently), and otherwise it has a reason. Reasons that are
known are in the table `KNOWN`. The exit status is 1 when there is another one.
"""

import argparse
import pathlib
import shutil
import subprocess
import sys
import tempfile

try:
    import numpy as np
except ImportError:
    print("read_matrix.py: the package numpy is not installed: pip install numpy")
    sys.exit(0)
try:
    import OpenImageIO as oiio
except ImportError:
    oiio = None
try:
    from PIL import Image, features
except ImportError:
    Image = None

WIDTH, HEIGHT = 37, 23
CODE = 1 / 255

# Reasons of differences by writer, format and a word of the variant. The words may be empty.
JPEG = "JPEG decoders round differently, by up to 3 of 255"
KNOWN = [
    ("", "jpeg", "", JPEG),
    ("", "jpg", "", JPEG),
    ("", "tif", "YCbCr compression=jpeg", JPEG),
    ("", "tif", "CMYK compression=jpeg", JPEG),
    ("OpenImageIO", "tiff", "double", "3.2.2 reads its own tiles of doubles as zeros"),
    ("OpenImageIO", "bmp", "4 channels", "32 bits without masks have no alpha by the definition of the format"),
    ("OpenImageIO", "dpx", "BitsPerSample=10", "3.2.2 does not read the last word of a row with one value"),
    ("OpenImageIO", "ico", "", "the mask makes pixels transparent"),
    ("OpenImageIO", "rla", "float", "it writes floats in the byte order of the machine"),
    ("Pillow", "dds", "L", "the masks of the header name bits that pixels do not have"),
    ("Pillow", "tga", "1", "1 bit a pixel is not defined by the format"),
    ("Pillow", "tif", "LA compression=jpeg", "JPEG of two components is refused"),
    ("Pillow", "tif", "LAB", "Pillow returns L*a*b*, the suite sRGB"),
    ("ImageMagick", "dpx", "rgba -depth 12", "6.9 reads its own files wrongly (OpenImageIO reads what the suite does)"),
    ("ImageMagick", "fits", "-depth 32", "the suite returns the numbers, not fractions"),
    ("ImageMagick", "fits", "rgb", "6.9 reads the first of the three planes"),
    ("ImageMagick", "psd", "rgba", "6.9 stores no white background, which the suite removes as Photoshop does"),
    ("ImageMagick", "psb", "rgba", "6.9 stores no white background, which the suite removes as Photoshop does"),
    ("ImageMagick", "sgi", "gray -depth 16", "6.9 reads one white as black (OpenImageIO reads what the suite does)"),
    ("ImageMagick", "tga", "", "6.9 reads its own files upside down (OpenImageIO and Pillow read what the suite does)"),
    ("ImageMagick", "tif", "lab", "the suite returns sRGB by another formula"),
    ("ImageMagick", "tif", "rgba -depth 8 -compress jpeg", "libtiff's interface for RGBA multiplies colours by alpha"),
    ("ImageMagick", "tif", "rgba -colorspace cmyk", "its raw inks are returned without alpha"),
    ("libtiff (tiffcp)", "tif", "uint8 4 channels -c jpeg", "libtiff's interface for RGBA multiplies colours by alpha"),
    ("libtiff (tiffcp)", "tif", "sgilog", "OpenImageIO reads bytes in screen encoding, the suite floats"),
]


def values(channels, seed=0):
    """Returns an image of values from 0 to 1, in part smooth and in part noise, with both ends."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    rng = np.random.default_rng(seed)
    planes = []
    for c in range(channels):
        smooth = (x * (c + 1) + y * 2) / (WIDTH * (c + 1) + HEIGHT * 2)
        noise = rng.random((HEIGHT, WIDTH))
        planes.append(np.where((x // 8 + y // 8) % 2 == 0, smooth, noise))
    out = np.stack(planes, axis=2).astype(np.float32)
    out[0, 0], out[0, 1] = 0, 1
    return out


class File:
    """A file of another program, and what that program reads in it: an array of floats, or None."""

    def __init__(self, writer, format, variant, path, expected):
        self.writer, self.format, self.variant, self.path, self.expected = writer, format, variant, path, expected


# --- OpenImageIO ---------------------------------------------------------------------------------------------------

# Format: extension, types, numbers of channels, attributes of variants.
OIIO = {
    "openexr": ("exr", "half float uint", (1, 2, 3, 4, 5), [
        {"compression": c} for c in "none rle zip zips piz pxr24 b44 b44a dwaa dwab".split()]),
    "tiff": ("tif", "uint8 int8 uint16 int16 uint int half float double", (1, 2, 3, 4, 5), [
        {"compression": c} for c in "none lzw zip packbits".split()] + [
        {"planarconfig": "separate"}, {"tile": 16}, {"tiff:bigtiff": 1}, {"oiio:BitsPerSample": 1},
        {"oiio:BitsPerSample": 2}, {"oiio:BitsPerSample": 4}, {"oiio:BitsPerSample": 10},
        {"oiio:BitsPerSample": 12}, {"tiff:half": 1}]),
    "jpeg": ("jpg", "uint8", (1, 3), [{"jpeg:subsampling": s} for s in ("4:4:4", "4:2:2", "4:2:0")]
             + [{"jpeg:progressive": 1}]),
    "bmp": ("bmp", "uint8", (1, 3, 4), [{}]),
    "dpx": ("dpx", "uint8 uint16", (1, 3, 4), [{}, {"oiio:BitsPerSample": 10}, {"oiio:BitsPerSample": 12},
            {"dpx:Packing": "Packed", "oiio:BitsPerSample": 10},
            {"dpx:Packing": "Filled, method B", "oiio:BitsPerSample": 10}, {"oiio:Endian": "little"}]),
    "fits": ("fits", "uint8 uint16 uint float double", (1,), [{}]),
    "gif": ("gif", "uint8", (1, 3, 4), [{}]),
    "hdr": ("hdr", "float", (3,), [{}]),
    "ico": ("ico", "uint8", (1, 2, 3, 4), [{}]),
    "iff": ("iff", "uint8 uint16", (3, 4), [{"compression": "none"}, {"compression": "rle"}]),
    "jpeg2000": ("jp2", "uint8 uint16", (1, 2, 3, 4), [{}]),
    "jpegxl": ("jxl", "uint8 uint16 half float", (1, 2, 3, 4), [{"compression": "jpegxl:100"}]),
    "png": ("png", "uint8 uint16", (1, 2, 3, 4), [{}]),
    "pnm": ("ppm", "uint8 uint16", (1, 3), [{}, {"pnm:binary": 0}]),
    "pfm": ("pfm", "float", (1, 3), [{}]),
    "rla": ("rla", "uint8 uint16 uint float", (1, 3, 4), [{}]),
    "sgi": ("sgi", "uint8 uint16", (1, 2, 3, 4), [{}]),
    "targa": ("tga", "uint8", (1, 2, 3, 4), [{"compression": "none"}, {"compression": "rle"}]),
    "webp": ("webp", "uint8", (3, 4), [{"compression": "lossless"}]),
}


def of_oiio(folder):
    for name, (extension, types, channels, variants) in OIIO.items():
        for kind in types.split():
            for n in channels:
                for i, attributes in enumerate(variants):
                    path = folder / f"oiio-{name}-{kind}-{n}-{i}.{extension}"
                    spec = oiio.ImageSpec(WIDTH, HEIGHT, n, kind)
                    attributes = dict(attributes)
                    if "tile" in attributes:
                        spec.tile_width = spec.tile_height = attributes["tile"]
                    # Values are stored as they are.
                    spec.attribute("oiio:UnassociatedAlpha", 1)
                    for key, value in attributes.items():
                        spec.attribute(key, value)
                    out = oiio.ImageOutput.create(str(path))
                    if out is None or not out.open(str(path), spec):
                        continue
                    data = values(n, i)
                    if kind == "uint":
                        data = (data * 4e9).astype(np.uint32)
                    ok = out.write_image(data)
                    ok = out.close() and ok
                    oiio.geterror()
                    if not ok:
                        continue
                    words = [kind, f"{n} channels"] + [f"{k}={v}" for k, v in attributes.items()]
                    expected = by_oiio(path)
                    if expected is None and name == "iff":
                        # Some files that it writes it does not read. Their values are those that were given.
                        most = np.float32({"uint8": 255, "uint16": 65535}[kind])
                        expected = np.floor(data * most + np.float32(0.5)) / most
                    yield File("OpenImageIO", name, " ".join(words), path, expected)


def by_oiio(path):
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    config.attribute("oiio:RawColor", 0)
    image = oiio.ImageInput.open(str(path), config)
    if image is None:
        oiio.geterror()
        return None
    kind = image.spec().format
    if str(kind) in ("uint", "int", "uint32", "int32", "int8", "int16"):
        # The suite returns their numbers.
        data = image.read_image(image.spec().format)
    else:
        data = image.read_image("float")
    image.close()
    if data is None:
        oiio.geterror()
        return None
    return np.asarray(data).astype(np.float32).reshape(image.spec().height, image.spec().width, -1)


# --- ImageMagick ---------------------------------------------------------------------------------------------------

# Format of the name: options of variants.
MAGICK = {
    "bmp": ["", "-compress rle", "-type palette", "-type bilevel"], "bmp2": ["", "-type palette"], "bmp3": ["", "-type palette"],
    "cin": ["-depth 10"], "dpx": ["-depth 8", "-depth 10", "-depth 12", "-depth 16", "-depth 10 -endian lsb"],
    "dds": ["-define dds:compression=none", "-define dds:compression=dxt1", "-define dds:compression=dxt5"],
    "fits": ["-depth 8", "-depth 16", "-depth 32"], "gif": ["", "-interlace line"], "hdr": [""],
    "ico": ["", "-type palette", "-type bilevel"],
    "jp2": ["-depth 8 -quality 100", "-depth 16 -quality 100"], "j2k": ["-depth 8 -quality 100"],
    "jpg": ["-quality 95", "-quality 95 -interlace plane", "-sampling-factor 4:4:4", "-sampling-factor 2x1"],
    "pam": ["-depth 8", "-depth 16"], "pbm": [""], "pgm": ["-depth 8", "-depth 16", "-depth 8 -compress none"],
    "ppm": ["-depth 8", "-depth 16", "-depth 8 -compress none", "-depth 10"], "pfm": [""],
    "png": ["-depth 8", "-depth 16", "-type palette", "-type bilevel", "-depth 8 -interlace plane",
            "-depth 16 -interlace plane", "-colors 4 -type palette"],
    "psd": ["-depth 8", "-depth 16", "-depth 8 -compress rle"], "psb": ["-depth 8"],
    "sgi": ["-depth 8", "-depth 16", "-depth 8 -compress rle"],
    "tga": ["", "-compress rle", "-type palette"],
    "tif": [f"-depth {d} -compress {c}" for d in (8, 16) for c in "none lzw zip rle".split()]
    + ["-depth 8 -compress jpeg", "-depth 32 -define quantum:format=floating-point",
       "-depth 16 -define quantum:format=floating-point", "-depth 64 -define quantum:format=floating-point",
       "-depth 8 -compress lzma", "-depth 8 -compress zstd", "-depth 8 -compress webp", "-depth 8 -endian msb",
       "-depth 16 -endian msb", "-depth 8 -interlace plane", "-type bilevel -compress group4",
       "-type bilevel -compress fax", "-type bilevel", "-type palette", "-depth 4", "-depth 8 -define tiff:fill-order=lsb",
       "-depth 8 -define tiff:tile-geometry=16x16", "-colorspace cmyk -depth 8", "-colorspace lab -depth 8"],
    "webp": ["-define webp:lossless=true"],
}


def of_magick(folder, program):
    sources = {}
    for name, n in (("gray", 1), ("rgb", 3), ("rgba", 4)):
        path = folder / f"magick-source-{name}.pam"
        kind = {1: "GRAYSCALE", 3: "RGB", 4: "RGB_ALPHA"}[n]
        head = f"P7\nWIDTH {WIDTH}\nHEIGHT {HEIGHT}\nDEPTH {n}\nMAXVAL 65535\nTUPLTYPE {kind}\nENDHDR\n"
        data = np.round(values(n, 7) * 65535).astype(">u2")
        path.write_bytes(head.encode() + data.tobytes())
        sources[name] = path
    for extension, variants in MAGICK.items():
        for source, path in sources.items():
            for i, options in enumerate(variants):
                target = folder / f"magick-{extension}-{source}-{i}.{extension.rstrip('23') if extension.startswith('bmp') else extension}"
                prefix = f"{extension}:" if extension.startswith("bmp") and extension != "bmp" else ""
                done = subprocess.run([program, path, *options.split(), f"{prefix}{target}"], capture_output=True)
                if done.returncode or not target.exists():
                    continue
                yield File("ImageMagick", extension, f"{source} {options}".strip(), target, by_magick(program, target))


def by_magick(program, path):
    """Returns the values as red, green, blue and alpha of 16 bits, which the program has for all files."""
    about = subprocess.run([program, f"{path}[0]", "-format", "%w %h %[colorspace]", "info:"], capture_output=True, text=True)
    if about.returncode:
        return None
    width, height, space = about.stdout.split()[:3]
    # The stored values, whatever the program takes their colours for.
    inks = space == "CMYK"
    words = ["cmyk:-"] if inks else ["-set", "colorspace", "sRGB", "rgba:-"]
    done = subprocess.run([program, f"{path}[0]", "-depth", "16", "-endian", "lsb", *words], capture_output=True)
    if done.returncode:
        return None
    data = np.frombuffer(done.stdout, "<u2").reshape(int(height), int(width), 4) / np.float32(65535)
    # Without a profile, as the suite does.
    data = (1 - data[..., :3]) * (1 - data[..., 3:4]) if inks else data
    return data.astype(np.float32)


# --- Pillow --------------------------------------------------------------------------------------------------------

PILLOW = {
    "bmp": ("1 L P RGB RGBA", [{}]),
    "dds": ("L LA RGB RGBA", [{}]),
    "gif": ("1 L P RGB", [{}]),
    "ico": ("L RGB RGBA", [{}, {"bitmap_format": "bmp"}]),
    "jp2": ("L LA RGB RGBA I;16", [{"irreversible": False}, {"irreversible": False, "tile_size": (16, 16)}]),
    "j2k": ("L RGB RGBA", [{"irreversible": False}]),
    "jpg": ("L RGB CMYK", [{"quality": 95}, {"quality": 95, "progressive": True}, {"subsampling": 0}, {"subsampling": 2}]),
    "png": ("1 L LA P RGB RGBA I;16", [{}]),
    "ppm": ("1 L RGB I;16", [{}]),
    "qoi": ("RGB RGBA", [{}]),
    "sgi": ("L RGB RGBA", [{}]),
    "tga": ("1 L LA P RGB RGBA", [{}, {"compression": "tga_rle"}]),
    "tif": ("1 L LA P RGB RGBA CMYK YCbCr LAB I;16 I F", [{"compression": c} for c in (
        None, "tiff_lzw", "tiff_adobe_deflate", "packbits", "jpeg", "group3", "group4", "tiff_ccitt", "lzma", "zstd", "webp")]),
    "webp": ("RGB RGBA", [{"lossless": True, "exact": True}]),
}


def of_pillow(folder):
    for extension, (modes, variants) in PILLOW.items():
        for mode in modes.split():
            for i, options in enumerate(variants):
                path = folder / f"pillow-{extension}-{mode.replace(';', '')}-{i}.{extension}"
                try:
                    image = pillow_image(mode)
                    image.save(path, **{k: v for k, v in options.items() if v is not None})
                    expected = by_pillow(path)
                except (OSError, ValueError, KeyError, RuntimeError, TypeError):
                    continue
                words = [mode] + [f"{k}={v}" for k, v in options.items() if v is not None]
                yield File("Pillow", extension, " ".join(words), path, expected)


def pillow_image(mode):
    n = {"1": 1, "L": 1, "P": 3, "LA": 2, "RGB": 3, "RGBA": 4, "CMYK": 4, "YCbCr": 3, "LAB": 3}.get(mode, 1)
    data = values(n, 3)
    if mode == "I;16":
        return Image.fromarray(np.round(data[..., 0] * 65535).astype(np.uint16))
    if mode == "I":
        return Image.fromarray((data[..., 0] * 2e9 - 1e9).astype(np.int32))
    if mode == "F":
        return Image.fromarray(data[..., 0])
    bytes8 = np.round(data * 255).astype(np.uint8)
    if mode == "1":
        return Image.fromarray(bytes8[..., 0]).convert("1")
    if mode == "P":
        return Image.fromarray(bytes8).convert("P")
    if mode in ("YCbCr",):
        return Image.fromarray(bytes8).convert("YCbCr")
    if mode in ("CMYK", "LAB"):
        return Image.frombytes(mode, (WIDTH, HEIGHT), bytes8.tobytes())
    return Image.fromarray(bytes8[..., 0] if n == 1 else bytes8)


def by_pillow(path):
    image = Image.open(path)
    image.load()
    mode = image.mode
    if mode == "P":
        image = image.convert("RGBA" if "transparency" in image.info else "RGB")
    elif mode == "1":
        image = image.convert("L")
    elif mode == "CMYK":
        # Without a profile, as the suite does.
        inks = np.asarray(image).astype(np.float32) / 255
        return ((1 - inks[..., :3]) * (1 - inks[..., 3:])).astype(np.float32)
    elif mode == "YCbCr":
        image = image.convert("RGB")
    data = np.asarray(image)
    if data.dtype == np.uint8:
        data = data.astype(np.float32) / 255
    elif data.dtype == np.uint16 or path.suffix == ".ppm":
        data = data.astype(np.float32) / 65535
    data = data.astype(np.float32)
    return data.reshape(data.shape[0], data.shape[1], -1)


# --- Programs of formats -------------------------------------------------------------------------------------------

def of_tiffcp(folder, program):
    """Files of `tiffcp`, which changes the storage and no value."""
    if oiio is None:
        return
    sources = []
    for kind in "uint8 uint16 half float".split():
        for n in (1, 3, 4):
            path = folder / f"tiffcp-source-{kind}-{n}.tif"
            spec = oiio.ImageSpec(WIDTH, HEIGHT, n, kind)
            spec.attribute("oiio:UnassociatedAlpha", 1)
            spec.attribute("compression", "none")
            out = oiio.ImageOutput.create(str(path))
            out.open(str(path), spec)
            out.write_image(values(n, 5))
            out.close()
            sources.append((f"{kind} {n} channels", path))
    options = ["-c none", "-c lzw", "-c lzw:2", "-c zip", "-c zip:2", "-c zip:3", "-c packbits", "-c lzma", "-c lzma:2",
               "-c zstd", "-c zstd:2", "-c jpeg:r", "-c webp", "-B -c lzw", "-L", "-p separate -c lzw:2", "-t -w 16 -l 16 -c zip",
               "-8 -c zip", "-f lsb2msb -c none", "-f lsb2msb -c lzw", "-r 5 -c lzw", "-p separate -t -w 16 -l 16 -c lzma",
               "-c sgilog"]
    for name, source in sources:
        for i, words in enumerate(options):
            path = folder / f"tiffcp-{source.stem}-{i}.tif"
            done = subprocess.run([program, *words.split(), source, path], capture_output=True)
            if done.returncode or not path.exists():
                continue
            # Without loss the values are those of the source, whose compression every library knows.
            has_loss = any(word in words for word in ("jpeg", "webp", "sgilog"))
            yield File("libtiff (tiffcp)", "tif", f"{name} {words}", path, by_oiio(path if has_loss else source))


def of_openexr(folder, tiled, multiview, preview):
    """Files of OpenEXR's programs: tiles, levels of both kinds, views, previews, in all compressions."""
    if oiio is None:
        return
    for kind in "half float uint".split():
        for n in (1, 3, 4):
            source = folder / f"openexr-source-{kind}-{n}.exr"
            out = oiio.ImageOutput.create(str(source))
            out.open(str(source), oiio.ImageSpec(WIDTH, HEIGHT, n, kind))
            out.write_image(values(n, 6))
            out.close()
            runs = [(f"-z {c} {levels} -t {size}", [tiled, "-z", c, *levels.split(), "-t", *size.split(), source])
                    for c in "none rle zip piz pxr24 b44 b44a dwaa dwab".split()
                    for levels in ("-o", "-m -d", "-m -u", "-r -d", "-r -u") for size in ("16 16", "13 7", "64 64")]
            runs += [("of two views", [multiview, "left", source, "right", source]), ("with a preview", [preview, source])]
            for i, (words, command) in enumerate(runs):
                path = folder / f"{source.stem}-{i}.exr"
                done = subprocess.run([*command, path], capture_output=True)
                if done.returncode == 0 and path.exists():
                    yield File("OpenEXR", "exr", f"{kind} {n} channels {words}", path, by_oiio(path))


def of_openjpeg(folder, program, decoder):
    for n, bits in ((1, 8), (3, 8), (1, 12), (3, 10), (3, 16), (1, 16)):
        source = folder / f"opj-{n}-{bits}.{'pgm' if n == 1 else 'ppm'}"
        most = (1 << bits) - 1
        data = np.round(values(n, 4) * most).astype(">u2" if bits > 8 else np.uint8)
        source.write_bytes(f"P{5 if n == 1 else 6}\n{WIDTH} {HEIGHT}\n{most}\n".encode() + data.tobytes())
        for i, words in enumerate(["-n 3", "-n 1", "-t 16,16 -n 2", "-p RLCP -n 3", "-p RPCL -n 3", "-p PCRL -n 3",
                                   "-p CPRL -n 3", "-M 63 -n 3", "-I -r 1 -n 3", "-c [32,32] -n 2", "-b 16,16 -n 3",
                                   "-SOP -EPH -n 3", "-TP R -n 3", "-r 8,2,1 -n 3"]):
            for extension in ("jp2", "j2k"):
                path = folder / f"opj-{n}-{bits}-{i}.{extension}"
                done = subprocess.run([program, "-i", source, "-o", path, *words.split()], capture_output=True)
                if done.returncode or not path.exists():
                    continue
                back = folder / f"opj-{n}-{bits}-{i}-{extension}.{'pgm' if n == 1 else 'ppm'}"
                subprocess.run([decoder, "-i", path, "-o", back], capture_output=True)
                yield File("OpenJPEG", extension, f"{n} channels {bits} bits {words}", path, by_pnm(back))
    # Signed values are stored without loss, and read as numbers.
    for n, bits in ((1, 8), (3, 8), (1, 12), (3, 16)):
        source = folder / f"opj-signed-{n}-{bits}.raw"
        data = np.round(values(n, 4) * ((1 << bits) - 1)).astype(np.int64) - (1 << (bits - 1))
        source.write_bytes(data.transpose(2, 0, 1).astype(">i2" if bits > 8 else np.int8).tobytes())
        for extension in ("jp2", "j2k"):
            path = folder / f"opj-signed-{n}-{bits}.{extension}"
            words = f"-F {WIDTH},{HEIGHT},{n},{bits},s -n 3"
            done = subprocess.run([program, "-i", source, "-o", path, *words.split()], capture_output=True)
            if done.returncode == 0:
                yield File("OpenJPEG", extension, f"{n} channels {bits} bits {words}", path, data.astype(np.float32))


def by_pnm(path):
    if not path.exists():
        return None
    head, rest = path.read_bytes(), None
    words, at = [], 0
    while len(words) < 4:
        end = at
        while head[end:end + 1] not in (b" ", b"\n", b"\t"):
            end += 1
        if head[at:at + 1] == b"#":
            at = head.index(b"\n", at) + 1
            continue
        words.append(head[at:end])
        at = end + 1
    rest = head[at:]
    n, width, height, most = (1 if words[0] == b"P5" else 3), int(words[1]), int(words[2]), int(words[3])
    data = np.frombuffer(rest, ">u2" if most > 255 else np.uint8).reshape(height, width, n).astype(np.int64)
    bits = most.bit_length()
    if bits not in (8, 16):
        data, most = (data << (16 - bits)) | (data >> (2 * bits - 16)), 65535
    return (data / np.float32(most)).astype(np.float32)


def of_cjxl(folder, program, decoder):
    for n, bits in ((1, 8), (3, 8), (3, 16), (4, 8), (4, 16)):
        most = (1 << bits) - 1
        source = folder / f"jxl-{n}-{bits}.pam"
        kind = {1: "GRAYSCALE", 3: "RGB", 4: "RGB_ALPHA"}[n]
        data = np.round(values(n, 6) * most).astype(">u2" if bits > 8 else np.uint8)
        head = f"P7\nWIDTH {WIDTH}\nHEIGHT {HEIGHT}\nDEPTH {n}\nMAXVAL {most}\nTUPLTYPE {kind}\nENDHDR\n"
        source.write_bytes(head.encode() + data.tobytes())
        expected = (np.round(values(n, 6) * most) / np.float32(most)).astype(np.float32)
        for i, words in enumerate(["-d 0", "-d 0 -e 3", "-d 0 -e 9", "-d 0 --container=1", "-d 0 -p"]):
            path = folder / f"jxl-{n}-{bits}-{i}.jxl"
            done = subprocess.run([program, source, path, *words.split()], capture_output=True)
            if done.returncode or not path.exists():
                continue
            # The program stores alpha in 8 bits.
            stored = by_oiio(path) if oiio is not None else expected
            yield File("libjxl (cjxl)", "jxl", f"{n} channels {bits} bits {words}", path, stored)


# --- Comparison ----------------------------------------------------------------------------------------------------

def read(program, files):
    """Returns what the suite reads: an array, or the text of an error."""
    results = []
    for i in range(0, len(files), 200):
        batch = files[i:i + 200]
        out = subprocess.run([program, *[str(f.path) for f in batch]], capture_output=True, check=True).stdout
        at = 0
        for _ in batch:
            end = out.index(b"\n", at)
            line, at = out[at:end].decode(), end + 1
            if line.startswith("error: "):
                results.append((line[7:], ""))
                continue
            width, height, n, kind, names = line.split(" ", 4)
            count = int(width) * int(height) * int(n)
            data = np.frombuffer(out, "<f4", count, at).reshape(int(height), int(width), int(n))
            at += 4 * count
            results.append((data, names))
    return results


def reduced(data):
    """Returns an image without an alpha of 1, and in one channel where it is grey. Programs return these differently."""
    if data.shape[2] in (2, 4) and (data[..., -1] == 1).all():
        data = data[..., :-1]
    if data.shape[2] in (3, 4) and (data[..., 0] == data[..., 1]).all() and (data[..., 0] == data[..., 2]).all():
        data = np.concatenate([data[..., :1], data[..., 3:]], axis=2)
    return data


def judged(file, result):
    """Returns "equal", "near", "rounded" or another word, and a description."""
    got, _ = result
    if file.expected is None:
        return ("both refuse", "") if isinstance(got, str) else ("only here", "")
    if isinstance(got, str):
        return "refused", got.split(": ", 1)[-1]
    expected = file.expected
    if got.shape != expected.shape:
        got, expected = reduced(got), reduced(expected)
    if got.shape != expected.shape:
        return "shape", f"{got.shape} here, {expected.shape} there"
    both = np.isnan(got) & np.isnan(expected)
    difference = np.where(both, 0, np.abs(got - expected))
    scale = np.maximum(1, np.abs(expected))
    # ImageMagick has 16 bits.
    exact = 1.01 / 65535 if file.writer == "ImageMagick" else 1e-6
    worst = float(np.nanmax(difference / scale)) if difference.size else 0.0
    if not np.isfinite(difference).all() or worst > CODE * 1.01:
        word = "rounded" if worst < 3.5 * CODE else "different"
        return word, f"by {worst:.4f}, {int((difference > exact * scale).sum())} of {difference.size} values"
    return ("equal", "") if worst <= exact else ("near", f"by {worst:.5f}")


def reason(file, judgement):
    for writer, format, word, text in KNOWN:
        # Decoders of JPEG differ by little.
        if text == JPEG and judgement != "rounded":
            continue
        if writer in ("", file.writer) and format in ("", file.format) and word in file.variant:
            return text
    return None


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("--pixels", default="target/debug/examples/pixels", help="the program that prints pixels")
    parser.add_argument("--only", default="", help="files whose writer, format or variant contains this word")
    parser.add_argument("--keep", help="a folder for the files")
    parser.add_argument("--table", help="a file for the table")
    parser.add_argument("--verbose", action="store_true", help="print every file that is not equal")
    args = parser.parse_args()
    if not shutil.which(args.pixels):
        print(f"read_matrix.py: there is no {args.pixels}: cargo build -p granita-plugin --example pixels")
        return 0
    with tempfile.TemporaryDirectory() as scratch:
        folder = pathlib.Path(args.keep or scratch)
        folder.mkdir(parents=True, exist_ok=True)
        writers = []
        if oiio is not None:
            writers.append(of_oiio(folder))
        if Image is not None:
            writers.append(of_pillow(folder))
        for make, *programs in ((of_magick, "convert"), (of_tiffcp, "tiffcp"),
                                (of_openexr, "exrmaketiled", "exrmultiview", "exrmakepreview"),
                                (of_openjpeg, "opj_compress", "opj_decompress"), (of_cjxl, "cjxl", "djxl")):
            found = [shutil.which(program) for program in programs]
            if all(found):
                writers.append(make(folder, *found))
            else:
                print(f"{programs[0]} is not installed and left out")
        if oiio is None or Image is None:
            print("the packages OpenImageIO and Pillow are both needed for the whole table")
        files = [f for writer in writers for f in writer]
        files = [f for f in files if args.only in f"{f.writer} {f.format} {f.variant}"]
        results = read(args.pixels, files)
        rows, unknown = {}, []
        for file, result in zip(files, results):
            word, text = judged(file, result)
            row = rows.setdefault((file.writer, file.format), {"files": 0, "equal": 0, "near": 0, "reasons": {}})
            row["files"] += 1
            if word in ("equal", "near"):
                row[word] += 1
                if args.verbose and word == "near":
                    print(f"near: {file.path.name}: {file.variant}: {text}")
                continue
            why = reason(file, word) or ("both refuse it" if word == "both refuse" else None)
            if why is None:
                unknown.append(f"{file.writer}, {file.format}, {file.variant}: {word}: {text} ({file.path.name})")
                why = "not known"
            row["reasons"][why] = row["reasons"].get(why, 0) + 1
        lines = ["| written by | format | files | equal | within one step of 255 | others |", "|---|---|---|---|---|---|"]
        for (writer, format), row in rows.items():
            others = "; ".join(f"{count}: {why}" for why, count in row["reasons"].items())
            lines.append(f"| {writer} | {format} | {row['files']} | {row['equal']} | {row['near']} | {others} |")
        print("\n".join(lines))
        if args.table:
            pathlib.Path(args.table).write_text("\n".join(lines) + "\n")
        for line in unknown:
            print("not known:", line)
        print(f"{len(files)} files, {len(unknown)} differences that are not known")
        return 1 if unknown else 0


if __name__ == "__main__":
    sys.exit(main())
