//! Tests that other programs read the files of this suite, and the reverse. They are OpenImageIO's Python module and
//! the tools of libtiff and OpenEXR, where these are installed.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use granita_base::Param;
use granita_image::{CreateOptions, ImageSpec, Limits, PixelType, Pixels};
use granita_plugin::bundled_formats;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

/// Returns the output of a program; `None`, with a notice, when it is not installed.
fn run(program: &str, args: &[&std::ffi::OsStr]) -> Option<Output> {
    granita_needs::has(program).then(|| Command::new(program).args(args).output().unwrap())
}

/// Runs the script beside this file. Returns `None`, with a notice, without Python or its OpenImageIO.
fn script(verb: &str, path: &Path) -> Option<String> {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/interop.py");
    let probe = run("python3", &["-c".as_ref(), "import OpenImageIO, numpy".as_ref()])?;
    if !probe.status.success() {
        granita_needs::skip("OpenImageIO of Python");
        return None;
    }
    let output = run("python3", &[script.as_ref(), verb.as_ref(), path.as_ref()])?;
    let complaints = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{complaints}");
    Some(String::from_utf8(output.stdout).unwrap())
}

fn floats(path: &Path, values: &[f32]) {
    std::fs::write(path, values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>()).unwrap();
}

/// Returns pixels that are smooth in some squares and rough in others.
fn image(spec: &ImageSpec, seed: u32) -> Pixels {
    let (w, n) = (spec.width as usize, spec.nchannels());
    let value = |i: usize| {
        let (x, y, c) = (i / n % w, i / n / w, i % n);
        if (x / 16 + y / 16) % 2 == 0 {
            0.5 + 0.45 * (0.1 * x as f32 + c as f32).sin() * (0.07 * y as f32).cos()
        } else {
            granita_base::hash::words(&[seed, i as u32]) as f32 / u32::MAX as f32
        }
    };
    let values: Vec<f32> = (0..w * spec.height as usize * n).map(value).collect();
    Pixels::from_floats(spec.pixel_type, &values)
}

/// Writes levels with a format, and beside each level the floats that are expected. Adds a line for each level to the
/// list.
fn write(folder: &Path, name: &str, format: &str, levels: &[ImageSpec], tolerance: f32, list: &mut String) {
    let path = folder.join(name);
    let registry = bundled_formats(Limits::default());
    let options = CreateOptions::new(&levels[0], levels.len());
    let mut out = registry.create(&path, format, &options).unwrap();
    for (i, spec) in levels.iter().enumerate() {
        if i > 0 {
            out.next_level(spec).unwrap();
        }
        let pixels = image(spec, i as u32);
        out.write_rows(&pixels).unwrap();
        let raw = folder.join(format!("{name}.{i}.f32"));
        floats(&raw, &pixels.to_floats());
        let (w, h, n) = (spec.width, spec.height, spec.nchannels());
        let (path, raw) = (path.display(), raw.display());
        writeln!(list, "{path}\t{i}\t{w}\t{h}\t{n}\t{raw}\t{tolerance}").unwrap();
    }
    out.close().unwrap();
}

fn with(mut spec: ImageSpec, attributes: &[(&str, &str)]) -> ImageSpec {
    for (name, value) in attributes {
        spec.attributes.set(Param::declared(&format!("string {name}"), *value).unwrap());
    }
    spec.attributes.set(Param::declared("int unassociatedalpha", 1).unwrap());
    spec
}

const INTEGERS: [PixelType; 2] = [PixelType::U8, PixelType::U16];
const FLOATS: [PixelType; 2] = [PixelType::Half, PixelType::Float];

fn write_tiffs(folder: &Path, list: &mut String) {
    for pixel_type in INTEGERS.into_iter().chain(FLOATS) {
        for compression in ["none", "lzw", "zip", "zip:1", "packbits"] {
            for (tile, planes, n) in
                [(0, "contig", 3), (32, "contig", 4), (0, "separate", 1), (32, "separate", 5)]
            {
                let mut spec = ImageSpec::new(85, 61, n, pixel_type);
                (spec.tile_width, spec.tile_height) = (tile, tile);
                let spec = with(spec, &[("compression", compression), ("planarconfig", planes)]);
                let name = format!("{pixel_type:?}_{}_{tile}_{n}.tif", compression.replace(':', "_"));
                write(folder, &name, "tiff", &[spec], 1e-6, list);
            }
        }
    }
    let mut big = ImageSpec::new(85, 61, 3, PixelType::U16);
    big.attributes.set(Param::declared("int bigtiff", 1).unwrap());
    write(folder, "big.tif", "tiff", &[big], 1e-6, list);
    let levels: Vec<ImageSpec> = [(100, 60), (50, 30), (25, 15), (12, 7), (6, 3), (3, 1), (1, 1)]
        .map(|(w, h)| {
            let spec = ImageSpec::new(w, h, 3, PixelType::U8).tiled(16, 16);
            with(spec, &[("textureformat", "Plain Texture"), ("wrapmodes", "periodic")])
        })
        .to_vec();
    write(folder, "levels.tx", "tiff", &levels, 1e-6, list);
}

fn write_exrs(folder: &Path, list: &mut String) {
    for pixel_type in FLOATS {
        for compression in ["none", "rle", "zip", "zips", "piz", "pxr24", "b44", "b44a", "dwaa", "dwab"] {
            // These compressions are lossy. They keep 24 bits of a float, blocks of halves, or coefficients.
            let tolerance = match (compression.as_bytes()[0], pixel_type) {
                (b'd', _) => 0.1,
                (b'b', PixelType::Half) => 0.15,
                (b'p', PixelType::Float) if compression == "pxr24" => 1e-4,
                _ => 0.0,
            };
            for tile in [0, 32] {
                let mut spec = ImageSpec::new(85, 61, 4, pixel_type);
                (spec.tile_width, spec.tile_height) = (tile, tile);
                let spec = with(spec, &[("compression", compression)]);
                let name = format!("{pixel_type:?}_{compression}_{tile}.exr");
                write(folder, &name, "exr", &[spec], tolerance, list);
            }
        }
    }
    let levels: Vec<ImageSpec> = [(100, 60), (50, 30), (25, 15), (12, 7), (6, 3), (3, 1), (1, 1)]
        .map(|(w, h)| ImageSpec::new(w, h, 3, PixelType::Half).tiled(32, 32))
        .to_vec();
    write(folder, "levels.exr", "exr", &levels, 0.0, list);
}

fn write_others(folder: &Path, list: &mut String) {
    let exact = 1e-6;
    for (format, extension, types, channels, tolerance) in [
        ("png", "png", &INTEGERS[..], &[1, 3, 4][..], exact),
        ("sgi", "sgi", &INTEGERS, &[1, 3, 4], exact),
        ("pnm", "ppm", &INTEGERS, &[3], exact),
        ("pnm", "pgm", &INTEGERS, &[1], exact),
        ("iff", "iff", &INTEGERS, &[3, 4], exact),
        ("pfm", "pfm", &[PixelType::Float], &[1, 3], exact),
        ("hdr", "hdr", &[PixelType::Float], &[3], 4e-3),
        ("tga", "tga", &INTEGERS[..1], &[1, 3, 4], exact),
        ("bmp", "bmp", &INTEGERS[..1], &[3, 4], exact),
        ("webp", "webp", &INTEGERS[..1], &[3], exact),
        ("jpeg", "jpg", &INTEGERS[..1], &[1, 3], 0.06),
        ("dds", "dds", &INTEGERS[..1], &[1, 3, 4], exact),
        ("dpx", "dpx", &INTEGERS, &[1, 3, 4], exact),
        ("jpegxl", "jxl", &INTEGERS, &[1, 3], exact),
        ("jpegxl", "jxl", &INTEGERS[..1], &[4], exact),
    ] {
        for pixel_type in types {
            for n in channels {
                let spec = with(ImageSpec::new(85, 61, *n, *pixel_type), &[]);
                let name = format!("{pixel_type:?}_{n}.{extension}");
                write(folder, &name, format, &[spec], tolerance, list);
            }
        }
    }
}

/// Writes DPX files of 10 and 12 bits. Values are rounded to the nearest of these.
fn write_film(folder: &Path, list: &mut String) {
    for bits in [10, 12] {
        for n in [1, 3, 4] {
            // OpenImageIO reads the last word of a row of 10 bits only where it is full.
            let mut spec = ImageSpec::new(84, 61, n, PixelType::U16);
            spec.attributes.set(Param::declared("int BitsPerSample", bits).unwrap());
            // It also leaves the lowest of 16 bits 0, for 12 bits.
            let low = if bits == 12 { 15.0 / 65535.0 } else { 0.0 };
            let tolerance = low + 0.6 / ((1 << bits) - 1) as f32;
            write(folder, &format!("{bits}_{n}.dpx"), "dpx", &[spec], tolerance, list);
        }
    }
}

/// Writes DDS files with blocks of random bits. The suite does not write such files, so the expected pixels are those
/// that it decodes.
fn blocks(folder: &Path, list: &mut String) {
    for (name, dxgi, block) in
        [("bc1", 71, 8), ("bc2", 74, 16), ("bc3", 77, 16), ("bc4", 80, 8), ("bc5", 83, 16), ("bc7", 98, 16)]
    {
        let mut words = [0u32; 37];
        words[0] = u32::from_le_bytes(*b"DDS ");
        (words[1], words[2], words[3], words[4]) = (124, 0x1007, 61, 85);
        (words[19], words[20], words[21]) = (32, 4, u32::from_le_bytes(*b"DX10"));
        (words[27], words[32], words[33], words[35]) = (0x1000, dxgi, 3, 1);
        let mut bytes: Vec<u8> = words.iter().flat_map(|w| w.to_le_bytes()).collect();
        bytes.extend((0..16 * 22 * block).map(|i| granita_base::hash::words(&[dxgi, i]) as u8));
        let path = folder.join(format!("{name}.dds"));
        std::fs::write(&path, bytes).unwrap();
        let input = bundled_formats(Limits::default()).open(&path).unwrap();
        let n = input.spec(0, 0).unwrap().nchannels();
        // Decoders round values between two end points differently, except for BC7.
        let tolerance = if name == "bc7" { 1e-6 } else { 1.01 / 255.0 };
        let raw = folder.join(format!("{name}.f32"));
        floats(&raw, &input.read_level(0, 0).unwrap().to_floats());
        writeln!(list, "{}\t0\t85\t61\t{n}\t{}\t{tolerance}", path.display(), raw.display()).unwrap();
    }
}

/// Adds files of formats that the suite only reads. The expected pixels are those that it reads.
fn fixtures(folder: &Path, list: &mut String) {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/corpus");
    for (name, tolerance) in [
        ("cineon/big.cin", 1e-6),
        ("cineon/little.cin", 1e-6),
        ("psd/cmyk.psd", 1.01 / 255.0),
        // The colour of transparent pixels is not black there.
        ("psd/indexed.psd", 3.01 / 255.0),
        // Without their background, colours are rounded differently.
        ("psd/layers.psd", 1.01 / 255.0),
        ("psd/sixteen.psb", 1e-6),
        ("softimage/mixed.pic", 1e-6),
        ("softimage/plain16.pic", 1e-6),
    ] {
        let path = corpus.join(name);
        let input = bundled_formats(Limits::default()).open(&path).unwrap();
        let spec = input.spec(0, 0).unwrap();
        let raw = folder.join(name.replace('/', "_")).with_extension("f32");
        floats(&raw, &input.read_level(0, 0).unwrap().to_floats());
        let (w, h, n, path, raw) = (spec.width, spec.height, spec.nchannels(), path.display(), raw.display());
        writeln!(list, "{path}\t0\t{w}\t{h}\t{n}\t{raw}\t{tolerance}").unwrap();
    }
}

#[test]
fn openimageio_reads_our_files() {
    let dir = tempfile::tempdir().unwrap();
    let mut list = String::new();
    write_tiffs(dir.path(), &mut list);
    write_exrs(dir.path(), &mut list);
    write_others(dir.path(), &mut list);
    write_film(dir.path(), &mut list);
    fixtures(dir.path(), &mut list);
    blocks(dir.path(), &mut list);
    let listing = dir.path().join("list.tsv");
    std::fs::write(&listing, &list).unwrap();
    let Some(text) = script("check", &listing) else { return };
    assert!(text.is_empty(), "{text}");
}

#[test]
fn files_of_openimageio_are_read() {
    let dir = tempfile::tempdir().unwrap();
    let Some(text) = script("make", dir.path()) else { return };
    let registry = bundled_formats(Limits::default());
    let mut faults = String::new();
    let mut count = 0;
    for line in text.lines() {
        let words: Vec<&str> = line.split('\t').collect();
        let [path, level, width, height, channels, raw, tolerance] = words[..] else { panic!("{text}") };
        let number = |word: &str| word.parse::<usize>().unwrap();
        let (path, level, tolerance) =
            (PathBuf::from(path), number(level), tolerance.parse::<f32>().unwrap());
        let raw = std::fs::read(raw).unwrap();
        let expected: Vec<f32> = raw.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect();
        let name = path.file_name().unwrap().display();
        let read = || -> granita_image::Result<(ImageSpec, Pixels)> {
            let input = registry.open(&path)?;
            let spec =
                input.spec(0, level).cloned().unwrap_or_else(|| ImageSpec::new(0, 0, 0, PixelType::U8));
            Ok((spec, input.read_level(0, level)?))
        };
        let fault = match read() {
            Err(error) => error.to_string(),
            Ok((spec, pixels)) => {
                let size = (spec.width as usize, spec.height as usize, spec.nchannels());
                let wanted = (number(width), number(height), number(channels));
                let got = pixels.to_floats();
                let off = got.iter().zip(&expected).position(|(a, b)| (a - b).abs() > tolerance);
                match off {
                    _ if size != wanted => format!("{size:?} instead of {wanted:?}"),
                    Some(i) => format!("value {i} is {} instead of {}", got[i], expected[i]),
                    None => continue_with(&mut count),
                }
            }
        };
        if !fault.is_empty() {
            writeln!(faults, "{name} level {level}: {fault}").unwrap();
        }
    }
    assert!(faults.is_empty(), "{faults}");
    assert!(count > 150, "{count} images compared");
}

/// Counts an image that passed.
fn continue_with(count: &mut usize) -> String {
    *count += 1;
    String::new()
}

/// The suite reads strips and tiles that libtiff's copying tool compressed from one of its images.
#[test]
fn files_compressed_by_libtiff_are_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    let registry = bundled_formats(Limits::default());
    let ramp = |i: u32| (i / 3 % 100 + i / 300 + 20 * (i % 3)) as f32 / 255.0;
    let spec = ImageSpec::new(100, 60, 3, PixelType::U8);
    let pixels = Pixels::from_floats(PixelType::U8, &(0..18_000).map(ramp).collect::<Vec<_>>());
    let mut out = registry.create(&path("in.tif"), "tiff", &CreateOptions::new(&spec, 1)).unwrap();
    out.write_rows(&pixels).unwrap();
    out.close().unwrap();
    for (scheme, tolerance) in
        [("jpeg:95", 0.03), ("jpeg:r:95", 0.02), ("zstd", 0.0), ("zstd:p2", 0.0), ("lzw:2", 0.0)]
    {
        for layout in [&["-s", "-r", "16"][..], &["-t", "-w", "48", "-l", "32"]] {
            let mut args: Vec<&std::ffi::OsStr> = vec!["-c".as_ref(), scheme.as_ref()];
            args.extend(layout.iter().map(|a| std::ffi::OsStr::new(*a)));
            let (from, to) = (path("in.tif"), path("out.tif"));
            args.extend([from.as_os_str(), to.as_os_str()]);
            let Some(done) = run("tiffcp", &args) else { return };
            if !done.status.success() {
                eprintln!("tiffcp without {scheme}: not compared");
                continue;
            }
            let got = registry.open(&to).unwrap().read_level(0, 0).unwrap();
            for i in 0..pixels.len() {
                let d = (got.get(i) - pixels.get(i)).abs();
                assert!(d <= tolerance, "{scheme} {layout:?}: value {i} is off by {d}");
            }
        }
    }
}

#[test]
fn the_tools_of_libtiff_and_openexr_read_our_files() {
    let dir = tempfile::tempdir().unwrap();
    let mut list = String::new();
    write_tiffs(dir.path(), &mut list);
    write_exrs(dir.path(), &mut list);
    for path in list.lines().filter_map(|l| l.split('\t').next()) {
        let path: &Path = path.as_ref();
        let tool = if path.extension().is_some_and(|e| e == "exr") { "exrheader" } else { "tiffinfo" };
        // `tiffinfo` also reads all data.
        let args: &[&std::ffi::OsStr] =
            if tool == "tiffinfo" { &["-D".as_ref(), path.as_ref()] } else { &[path.as_ref()] };
        let Some(output) = run(tool, args) else { return };
        let complaints = String::from_utf8_lossy(&output.stderr);
        assert!(output.status.success() && complaints.is_empty(), "{}: {complaints}", path.display());
    }
}
