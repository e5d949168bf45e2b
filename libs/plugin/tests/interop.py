"""The other side of interop.rs: OpenImageIO compares what we wrote, and writes what we shall read.

check LIST: every line of LIST is an image, its level, width, height, channels, a file of the floats expected, and
by how much they may differ. Prints a line for every image that is not as expected.

make FOLDER: writes images, and beside each level a file of its floats; prints lines as LIST has them.
"""
import sys
import numpy as np
import OpenImageIO as oiio


def read(path, level):
    config = oiio.ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    image = oiio.ImageInput.open(path, config)
    if image is None:
        return None, oiio.geterror()
    if not image.seek_subimage(0, level):
        return None, "no level %d" % level
    pixels = image.read_image(0, level, 0, 10000, "float")
    error = image.geterror()
    image.close()
    return pixels, error


def check(listing):
    for line in open(listing):
        path, level, width, height, channels, raw, tolerance = line.rstrip("\n").split("\t")
        width, height, channels = int(width), int(height), int(channels)
        got, error = read(path, int(level))
        if got is None:
            print(path, "level", level, "is not read:", error)
            continue
        if got.shape != (height, width, channels):
            print(path, "level", level, "is", got.shape, "not", (height, width, channels))
            continue
        expected = np.fromfile(raw, "<f4").reshape(height, width, channels)
        difference = np.abs(got - expected)
        if not (difference <= float(tolerance)).all():
            where = np.argwhere(~(difference <= float(tolerance)))[0]
            print(path, "level", level, "differs by", np.nanmax(difference), "first at", where)


def dump(path, levels, tolerance):
    """Lines for the levels of an image, with its pixels as OpenImageIO sees them."""
    for level in range(levels):
        pixels, error = read(path, level)
        if pixels is None:
            print("failed", path, error)
            return
        raw = "%s.%d.f32" % (path, level)
        pixels.astype("<f4").tofile(raw)
        height, width, channels = pixels.shape
        print(path, level, width, height, channels, raw, tolerance, sep="\t")


def noise(width, height, channels):
    y, x, c = np.mgrid[0:height, 0:width, 0:channels]
    smooth = 0.5 + 0.45 * np.sin(0.11 * x + 0.7 * c) * np.cos(0.07 * y)
    rough = ((x * 31 + y * 17 + c * 7) % 97) / 97.0
    return np.where((x // 16 + y // 16) % 2 == 0, smooth, rough).astype("f4")


def write(path, pixels, kind, tile=0, **attributes):
    height, width, channels = pixels.shape
    spec = oiio.ImageSpec(width, height, channels, kind)
    if tile:
        spec.tile_width = spec.tile_height = tile
    for name, value in attributes.items():
        spec.attribute(name.replace("__", ":"), value)
    spec.attribute("oiio:UnassociatedAlpha", 1)
    output = oiio.ImageOutput.create(path)
    ok = output is not None and output.open(path, spec)
    ok = ok and (output.write_tiles(0, width, 0, height, 0, 1, pixels) if tile else output.write_image(pixels))
    if output is not None:
        output.close()
    if not ok:
        print("failed", path, oiio.geterror() if output is None else output.geterror())
    return ok


def make(folder):
    exact, close = 1e-6, 2.5 / 255
    cases = []
    for kind in ["uint8", "uint16", "half", "float"]:
        for compression in ["none", "lzw", "zip", "packbits"]:
            for tile in [0, 32]:
                for planes in ["contig", "separate"]:
                    name = "%s_%s_%d_%s.tif" % (kind, compression, tile, planes)
                    cases.append((name, 3, kind, tile, exact, dict(compression=compression, planarconfig=planes)))
    for kind in ["half", "float"]:
        for compression in ["none", "rle", "zip", "zips", "piz", "pxr24", "b44", "b44a", "dwaa", "dwab"]:
            for tile in [0, 32]:
                # Lossy ones are decoded with other roundings.
                near = 2e-3 if compression[0] == "d" else exact
                name = "%s_%s_%d.exr" % (kind, compression, tile)
                cases.append((name, 4, kind, tile, near, dict(compression=compression)))
    for channels in [1, 3, 4]:
        for kind in ["uint8", "uint16"]:
            cases.append(("%s_%d.png" % (kind, channels), channels, kind, 0, exact, {}))
            for compression in ["none", "rle"]:
                name = "%s_%d_%s.sgi" % (kind, channels, compression)
                cases.append((name, channels, kind, 0, exact, dict(compression=compression)))
    for compression in ["none", "rle"]:
        cases.append(("rgb8_%s.iff" % compression, 3, "uint8", 0, exact, dict(compression=compression)))
        cases.append(("rgb16_%s.iff" % compression, 3, "uint16", 0, exact, dict(compression=compression)))
        cases.append(("rgba8_%s.iff" % compression, 4, "uint8", 0, exact, dict(compression=compression)))
        for channels in [3, 4]:
            name = "%d_%s.tga" % (channels, compression)
            cases.append((name, channels, "uint8", 0, exact, dict(compression=compression)))
    cases.append(("rgba16_none.iff", 4, "uint16", 0, exact, dict(compression="none")))
    cases.append(("rgb.bmp", 3, "uint8", 0, exact, {}))
    cases.append(("rgb.jpg", 3, "uint8", 0, close, dict(compression="jpeg:95", jpeg__subsampling="4:4:4")))
    cases.append(("grey.jpg", 1, "uint8", 0, close, dict(compression="jpeg:95")))
    cases.append(("rgb.ppm", 3, "uint8", 0, exact, {}))
    cases.append(("rgb16.ppm", 3, "uint16", 0, exact, {}))
    cases.append(("text.ppm", 3, "uint8", 0, exact, dict(pnm__binary=0)))
    cases.append(("rgb.pfm", 3, "float", 0, exact, {}))
    cases.append(("rgb.hdr", 3, "float", 0, 4e-3, {}))
    cases.append(("rgb.webp", 3, "uint8", 0, exact, dict(compression="lossless")))
    for channels in [1, 3, 4]:
        for kind, bits in [("uint8", 8), ("uint16", 10), ("uint16", 12), ("uint16", 16)]:
            for packing in ["Packed", "Filled, method A", "Filled, method B"] if bits in [10, 12] else [""]:
                for endian in ["little", "big"]:
                    # Of 10 bits of one channel, OpenImageIO does not read what it writes.
                    if bits == 10 and channels == 1 or packing == "Packed" and endian == "big":
                        continue
                    name = "%d_%d_%s_%s.dpx" % (bits, channels, packing[-1:], endian)
                    given = dict(oiio__BitsPerSample=bits, dpx__Packing=packing, oiio__Endian=endian)
                    near = 16.0 / 65535 if bits == 12 else exact
                    cases.append((name, channels, kind, 0, near, given))
    # Its floats are in the byte order of the machine. The format has one order for all values.
    for kind in ["uint8", "uint16"]:
        for channels in [1, 3, 4]:
            cases.append(("%s_%d.rla" % (kind, channels), channels, kind, 0, exact, {}))
    for kind in ["uint8", "uint16"]:
        for channels in [1, 3, 4]:
            lossless = dict(compression="jpegxl:100")
            cases.append(("%s_%d.jxl" % (kind, channels), channels, kind, 0, exact, lossless))
    cases.append(("lossy.jxl", 3, "uint8", 0, close, dict(compression="jpegxl:80")))
    for kind in ["uint8", "float", "double"]:
        cases.append(("%s.fits" % kind, 1, kind, 0, exact, {}))
    for name, channels, kind, tile, tolerance, attributes in cases:
        path = "%s/%s" % (folder, name)
        # Of chunks that are no multiple of four, and of rows of DPX that end inside of a word, OpenImageIO does not read
        # what it writes.
        size = (84, 60) if name.endswith((".iff", ".dpx")) else (85, 61)
        if write(path, noise(*size, channels), kind, tile, **attributes):
            dump(path, 1, tolerance)
    textures(folder)


def textures(folder):
    """What maketx makes, all modes."""
    modes = {
        "plain": oiio.MakeTxTexture,
        "envlatl": oiio.MakeTxEnvLatl,
        "shadow": oiio.MakeTxShadow,
        "bump": oiio.MakeTxBumpWithSlopes,
        "lightprobe": oiio.MakeTxEnvLatlFromLightProbe,
    }
    for mode, number in modes.items():
        for kind in ["uint8", "uint16", "half", "float"]:
            for suffix in ["tx", "exr"]:
                if suffix == "exr" and kind[0] == "u":
                    continue
                channels = 1 if mode in ("shadow", "bump") else 3
                size = (128, 128) if mode == "lightprobe" else (150, 75)
                source = oiio.ImageBuf(oiio.ImageSpec(size[0], size[1], channels, kind))
                roi = oiio.ROI(0, size[0], 0, size[1], 0, 1, 0, channels)
                source.set_pixels(roi, noise(size[0], size[1], channels))
                config = oiio.ImageSpec()
                config.set_format(kind)
                path = "%s/%s_%s.%s" % (folder, mode, kind, suffix)
                if not oiio.ImageBufAlgo.make_texture(number, source, path, config):
                    print("failed", path, oiio.geterror())
                    continue
                image = oiio.ImageInput.open(path)
                levels = 0
                while image.seek_subimage(0, levels):
                    levels += 1
                image.close()
                dump(path, levels, 1e-6)


if sys.argv[1] == "check":
    check(sys.argv[2])
else:
    make(sys.argv[2])
