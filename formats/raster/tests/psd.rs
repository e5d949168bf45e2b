//! Photoshop documents that are made by hand, section by section.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use granita_base::Param;
use granita_image::metadata::{exif, iptc};
use granita_image::{Format, ImageInput, ImageSpec, Limits, PixelType, Pixels};
use granita_raster::PsdFormat;
use std::io::Write;

fn open(bytes: &[u8]) -> granita_image::Result<(tempfile::TempDir, Box<dyn ImageInput>)> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.psd");
    std::fs::write(&path, bytes).unwrap();
    let input = PsdFormat.open(&path, &Limits::default())?;
    Ok((folder, input))
}

fn merged(bytes: &[u8]) -> Pixels {
    open(bytes).unwrap().1.read_level(0, 0).unwrap()
}

fn error(bytes: &[u8]) -> String {
    open(bytes).and_then(|(_folder, input)| input.read_level(0, 0)).unwrap_err().to_string()
}

/// Returns a length of the document's kind.
fn length(wide: bool, n: usize) -> Vec<u8> {
    if wide { (n as u64).to_be_bytes().to_vec() } else { (n as u32).to_be_bytes().to_vec() }
}

#[derive(Clone, Default)]
struct Psd {
    wide: bool,
    channels: u16,
    size: [u32; 2],
    depth: u16,
    mode: u16,
    palette: Vec<u8>,
    resources: Vec<u8>,
    /// The section of layers, without its length.
    layers: Vec<u8>,
    /// The compression of the merged image, and its data.
    data: Vec<u8>,
}

impl Psd {
    fn new(mode: u16, depth: u16, channels: u16, size: [u32; 2], data: &[u8]) -> Self {
        let data = [&[0, 0], data].concat();
        Self { mode, depth, channels, size, data, ..Self::default() }
    }

    fn bytes(&self) -> Vec<u8> {
        let [width, height] = self.size;
        [
            b"8BPS".to_vec(),
            vec![0, 1 + u8::from(self.wide), 0, 0, 0, 0, 0, 0],
            self.channels.to_be_bytes().to_vec(),
            height.to_be_bytes().to_vec(),
            width.to_be_bytes().to_vec(),
            self.depth.to_be_bytes().to_vec(),
            self.mode.to_be_bytes().to_vec(),
            length(false, self.palette.len()),
            self.palette.clone(),
            length(false, self.resources.len()),
            self.resources.clone(),
            length(self.wide, self.layers.len()),
            self.layers.clone(),
            self.data.clone(),
        ]
        .concat()
    }
}

fn resource(id: u16, content: &[u8]) -> Vec<u8> {
    let pad = vec![0; content.len() % 2];
    [b"8BIM", &id.to_be_bytes()[..], &[0, 0], &length(false, content.len()), content, &pad].concat()
}

/// A layer: its name, edges (top, left, bottom, right), and the data of its channels with their compression.
struct Layer<'a> {
    name: &'a str,
    edges: [i32; 4],
    channels: Vec<(i16, Vec<u8>)>,
}

/// Returns the description of layers and their pixels, without the length of both.
fn layer_info(wide: bool, count: i16, layers: &[Layer<'_>]) -> Vec<u8> {
    let mut out = count.to_be_bytes().to_vec();
    for layer in layers {
        layer.edges.iter().for_each(|edge| out.extend(edge.to_be_bytes()));
        out.extend((layer.channels.len() as u16).to_be_bytes());
        for (id, data) in &layer.channels {
            out.extend(id.to_be_bytes());
            out.extend(length(wide, data.len()));
        }
        out.extend(b"8BIMmul \x80\0\x02\0");
        let mut name = vec![5];
        name.extend(b"short");
        name.resize(8, 0);
        let units: Vec<u8> = layer.name.encode_utf16().flat_map(u16::to_be_bytes).collect();
        let luni = [&length(false, units.len() / 2)[..], &units].concat();
        let block = [b"8BIMluni", &length(false, luni.len())[..], &luni].concat();
        let extra = [vec![0; 8], name, block].concat();
        out.extend(length(false, extra.len()));
        out.extend(extra);
    }
    layers.iter().for_each(|layer| layer.channels.iter().for_each(|(_, data)| out.extend(data)));
    out
}

/// Returns the section of layers of a document of 8 bits.
fn layer_section(wide: bool, info: &[u8]) -> Vec<u8> {
    [&length(wide, info.len())[..], info, &[0, 0, 0, 0]].concat()
}

#[test]
fn psd_modes_become_grey_and_rgb() {
    let of = |mode, depth, channels, size, data: &[u8]| {
        let (_folder, input) = open(&Psd::new(mode, depth, channels, size, data).bytes()).unwrap();
        (input.spec(0, 0).unwrap().channels.join(" "), input.read_level(0, 0).unwrap())
    };
    let bitmap = of(0, 1, 1, [9, 2], &[0b0100_0000, 0x80, 0, 0]);
    assert_eq!(bitmap.0, "Y");
    let white = |x: usize| if x == 1 || x == 8 { 0 } else { 255 };
    assert_eq!(bitmap.1, Pixels::U8((0..18).map(white).collect()));
    assert_eq!(of(1, 8, 1, [2, 1], &[7, 9]), ("Y".to_owned(), Pixels::U8(vec![7, 9])));
    assert_eq!(of(8, 8, 1, [2, 1], &[7, 9]).0, "Y");
    let rgb = of(3, 8, 4, [2, 1], &[1, 2, 3, 4, 5, 6, 7, 8]);
    // A fourth channel is not the alpha of the image unless the layers say so.
    assert_eq!(rgb, ("R G B channel3".to_owned(), Pixels::U8(vec![1, 3, 5, 7, 2, 4, 6, 8])));
    let rgb = of(3, 16, 3, [1, 1], &[1, 2, 3, 4, 5, 6]);
    assert_eq!(rgb.1, Pixels::U16(vec![0x102, 0x304, 0x506]));
    let floats: Vec<u8> = [0.5_f32, -1.0, 7.0].iter().flat_map(|v| v.to_be_bytes()).collect();
    assert_eq!(of(3, 32, 3, [1, 1], &floats).1, Pixels::Float(vec![0.5, -1.0, 7.0]));
    // Inks are stored inverted: no ink is 255.
    let cmyk = of(4, 8, 4, [2, 1], &[255, 0, 255, 255, 255, 255, 255, 102]);
    assert_eq!(cmyk, ("R G B".to_owned(), Pixels::U8(vec![255, 255, 255, 0, 102, 102])));
    let lab = of(9, 8, 3, [2, 1], &[255, 138, 128, 209, 128, 198]);
    let Pixels::U8(lab) = lab.1 else { panic!() };
    // The second colour is the red of sRGB.
    assert!(lab[..3] == [255; 3] && lab[3] >= 253 && lab[4] <= 4 && lab[5] <= 4, "{lab:?}");
    assert_eq!(of(7, 8, 2, [1, 1], &[1, 2]), ("channel0 channel1".to_owned(), Pixels::U8(vec![1, 2])));
}

#[test]
fn psd_palettes_become_rgb_and_alpha() {
    let mut file = Psd::new(2, 8, 1, [2, 1], &[3, 200]);
    file.palette = (0..768).map(|i| (i / 256 * 60 + i % 256 / 4) as u8).collect();
    assert_eq!(merged(&file.bytes()), Pixels::U8(vec![0, 60, 120, 50, 110, 170]));
    file.resources = [resource(1033, b"odd"), resource(1047, &[0, 200])].concat();
    let (_folder, input) = open(&file.bytes()).unwrap();
    assert_eq!(input.read_level(0, 0).unwrap(), Pixels::U8(vec![0, 60, 120, 255, 50, 110, 170, 0]));
    assert_eq!(input.spec(0, 0).unwrap().attributes.int("unassociatedalpha"), Some(1));
    file.palette.truncate(700);
    assert!(error(&file.bytes()).contains("the palette ends"));
}

/// The rows of all channels are run-length encoded, and a table before them has their lengths.
#[test]
fn psd_runs_are_unpacked_row_by_row() {
    for wide in [false, true] {
        let mut file = Psd::new(3, 8, 3, [4, 2], &[]);
        file.wide = wide;
        let rows: [&[u8]; 6] =
            [&[253, 1], &[3, 1, 2, 3, 4], &[253, 5], &[255, 6, 255, 7], &[128, 253, 8], &[253, 9]];
        file.data = vec![0, 1];
        for row in rows {
            file.data.extend(&length(wide, row.len())[if wide { 4 } else { 2 }..]);
        }
        file.data.extend(rows.concat());
        let expected = [1, 5, 8, 1, 5, 8, 1, 5, 8, 1, 5, 8, 1, 6, 9, 2, 6, 9, 3, 7, 9, 4, 7, 9];
        let (_folder, input) = open(&file.bytes()).unwrap();
        assert_eq!(input.read_level(0, 0).unwrap(), Pixels::U8(expected.to_vec()));
        assert_eq!(input.read_rows(0, 0, 1, 2).unwrap(), Pixels::U8(expected[12..].to_vec()));
        // The last row is cut off. The first one can still be read.
        let cut = &file.bytes()[..file.bytes().len() - 1];
        let (_folder, input) = open(cut).unwrap();
        assert_eq!(input.read_rows(0, 0, 0, 1).unwrap(), Pixels::U8(expected[..12].to_vec()));
        assert!(input.read_rows(0, 0, 1, 2).is_err());
    }
}

fn zip(bytes: &[u8]) -> Vec<u8> {
    let mut out = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::default());
    out.write_all(bytes).unwrap();
    out.finish().unwrap()
}

#[test]
fn psd_layers_are_images_with_all_compressions() {
    for wide in [false, true] {
        let table = length(wide, 2)[if wide { 4 } else { 2 }..].to_vec();
        let layers = [
            Layer {
                name: "plain \u{3b1}",
                edges: [-1, 2, 0, 4],
                channels: vec![
                    (-1, vec![0, 0, 128, 255]),
                    (0, vec![0, 0, 1, 2]),
                    (1, [vec![0, 1], table, vec![255, 3]].concat()),
                    (2, [vec![0, 2], zip(&[5, 6])].concat()),
                    (-2, vec![0, 0, 9]),
                ],
            },
            // A group has no pixels.
            Layer {
                name: "group",
                edges: [0; 4],
                channels: vec![(0, vec![0, 0]), (1, vec![0, 0]), (2, vec![0, 0])],
            },
            Layer {
                name: "differences",
                edges: [0, 0, 2, 2],
                channels: vec![
                    (0, [vec![0, 3], zip(&[1, 1, 5, 255])].concat()),
                    (1, vec![0, 0, 1, 2, 3, 4]),
                    (2, vec![0, 0, 5, 6, 7, 8]),
                ],
            },
        ];
        let mut file = Psd::new(3, 8, 3, [4, 4], &[200; 48]);
        file.wide = wide;
        file.layers = layer_section(wide, &layer_info(wide, 3, &layers));
        let (_folder, input) = open(&file.bytes()).unwrap();
        assert_eq!(input.images(), 3);
        let spec = input.spec(1, 0).unwrap();
        assert_eq!((spec.x, spec.y, spec.width, spec.height), (2, -1, 2, 1));
        assert_eq!((spec.full_width, spec.full_height), (4, 4));
        assert_eq!((spec.string("name"), spec.string("psd:BlendMode")), (Some("plain \u{3b1}"), Some("mul")));
        assert_eq!(spec.attributes.int("psd:Hidden"), Some(1));
        assert_eq!(spec.attributes.int("unassociatedalpha"), Some(1));
        assert_eq!(input.read_level(1, 0).unwrap(), Pixels::U8(vec![1, 3, 5, 128, 2, 3, 6, 255]));
        let spec = input.spec(2, 0).unwrap();
        assert_eq!((spec.string("name"), spec.nchannels()), (Some("differences"), 3));
        assert_eq!(input.read_level(2, 0).unwrap(), Pixels::U8(vec![1, 1, 5, 2, 2, 6, 5, 3, 7, 4, 4, 8]));
        assert_eq!(input.read_level(0, 0).unwrap(), Pixels::U8(vec![200; 48]));
    }
}

/// Layers of 16 bits are in a block behind the masks. The number of layers is negative: the merged image has alpha.
#[test]
fn psd_layers_of_sixteen_bits_and_merged_alpha_are_found() {
    let channel = |v: u16| [vec![0, 0], v.to_be_bytes().to_vec()].concat();
    let channels = vec![(-1, channel(65535)), (0, channel(1)), (1, channel(2)), (2, channel(3))];
    let info = layer_info(false, -1, &[Layer { name: "one", edges: [0, 0, 1, 1], channels }]);
    let mut file = Psd::new(3, 16, 4, [1, 1], &[]);
    // Half of a red in front of white.
    file.data = [0_u16, 65535, 32767, 32767, 32768].iter().flat_map(|v| v.to_be_bytes()).collect();
    let padding = vec![0; info.len().next_multiple_of(4) - info.len()];
    let block = [b"8BIMLr16", &length(false, info.len())[..], &info, &padding].concat();
    let other = [b"8BIMPatt", &length(false, 1)[..], &[1, 0, 0, 0]].concat();
    file.layers = [vec![0; 4], vec![0; 4], other, block].concat();
    let (_folder, input) = open(&file.bytes()).unwrap();
    assert_eq!(input.images(), 2);
    assert_eq!(input.read_level(1, 0).unwrap(), Pixels::U16(vec![1, 2, 3, 65535]));
    let spec = input.spec(0, 0).unwrap();
    assert_eq!(
        (spec.channels.join(" "), spec.attributes.int("unassociatedalpha")),
        ("R G B A".to_owned(), Some(1))
    );
    assert_eq!(input.read_level(0, 0).unwrap(), Pixels::U16(vec![65535, 0, 0, 32768]));
}

#[test]
fn psd_profiles_and_descriptions_are_reported() {
    let mut file = Psd::new(1, 8, 1, [1, 1], &[7]);
    let mut given = ImageSpec::new(1, 1, 1, PixelType::U8);
    for (declaration, text) in [("string Exif:LensModel", "long"), ("string IPTC:City", "Paris")] {
        given.attributes.set(Param::declared(declaration, text).unwrap());
    }
    file.resources = [
        resource(1028, &iptc::write(&given.attributes).unwrap()),
        resource(1039, &[0; 500]),
        resource(1058, &exif::write(&given.attributes, &[]).unwrap()),
        resource(1060, b"<x:xmpmeta/>"),
    ]
    .concat();
    let (_folder, input) = open(&file.bytes()).unwrap();
    let spec = input.spec(0, 0).unwrap();
    assert_eq!(spec.string("ICCProfile"), Some("500 bytes"));
    assert_eq!(spec.icc_profile.as_deref(), Some(&[0; 500][..]));
    assert_eq!(spec.string("Exif:LensModel"), Some("long"));
    assert_eq!(spec.string("IPTC:City"), Some("Paris"));
    assert_eq!(spec.string("XMP"), Some("<x:xmpmeta/>"));
}

#[test]
fn psd_files_that_are_damaged_or_of_other_kinds_are_refused_by_name() {
    let file = Psd::new(3, 8, 3, [2, 2], &[0; 12]);
    for (file, word) in [
        (Psd { depth: 24, ..file.clone() }, "mode 3 with 24 bits"),
        (Psd { mode: 5, ..file.clone() }, "mode 5"),
        (Psd { mode: 4, depth: 32, ..file.clone() }, "mode 4 with 32 bits"),
        (Psd { channels: 2, ..file.clone() }, "2 channels, of which colours need 3"),
        (Psd { channels: 0, ..file.clone() }, "0 channels"),
        (Psd { size: [0, 2], ..file.clone() }, "0 x 2"),
        (Psd { size: [u32::MAX, 2], ..file.clone() }, "exceeds"),
        (Psd { size: [2, 3], ..file.clone() }, "a row is"),
        (Psd { data: vec![0, 9], ..file.clone() }, "compression 9"),
        (Psd { data: vec![0, 1, 0, 1], ..file.clone() }, "the file ends"),
        (Psd { layers: vec![0, 0, 0, 9], ..file.clone() }, "the layers ends"),
        (Psd { layers: vec![0, 0, 0, 2, 0, 1], ..file.clone() }, "the description of layers ends"),
    ] {
        assert!(error(&file.bytes()).contains(word), "{word}: {}", error(&file.bytes()));
    }
    // A layer that claims far more pixels than its data can hold is refused when it is read.
    let huge = |data: Vec<u8>| {
        let channels = vec![(0, data.clone()), (1, data.clone()), (2, data)];
        let info = layer_info(false, 1, &[Layer { name: "huge", edges: [0, 0, 30_000, 30_000], channels }]);
        Psd { layers: layer_section(false, &info), ..file.clone() }.bytes()
    };
    let (_folder, input) = open(&huge([vec![0, 2], zip(&[0; 100])].concat())).unwrap();
    assert!(input.read_rows(1, 0, 0, 1).unwrap_err().to_string().contains("claims 900000000 bytes"));
    let (_folder, input) = open(&huge(vec![0, 0, 1, 2])).unwrap();
    assert!(input.read_rows(1, 0, 29_999, 30_000).is_err());
    assert!(open(&huge(vec![0, 1, 1, 2])).err().unwrap().to_string().contains("a channel of a layer ends"));
    assert!(error(&file.bytes()[..20]).contains("the file ends"));
}
