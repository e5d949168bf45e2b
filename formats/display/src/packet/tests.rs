//! Tests packets byte by byte, and any packet that is encoded and decoded.

use super::*;
use proptest::prelude::*;

/// Returns a packet of this type and content.
fn bytes(kind: u8, content: &[&[u8]]) -> Vec<u8> {
    let content = content.concat();
    let length = u32::try_from(content.len() + 5).unwrap();
    [&length.to_le_bytes()[..], &[kind], &content].concat()
}

fn decode(bytes: &[u8]) -> Result<Packet> {
    Packet::decode(bytes, &PacketLimits::default())
}

fn ints(values: &[i32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn longs(values: &[i64]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn floats(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn channel(name: &str, offset: u64, stride: u64) -> Channel {
    Channel { name: name.to_owned(), offset, stride }
}

#[test]
fn every_packet_type_and_version_is_decoded() {
    let open = |path: &str, selector: &str| Packet::OpenImage {
        path: path.to_owned(),
        selector: selector.to_owned(),
        focus: true,
    };
    for (text, path, selector) in [
        ("a.exr", "a.exr", ""),
        ("a.exr:diffuse", "a.exr", "diffuse"),
        ("C:\\a.exr", "C:\\a.exr", ""),
        ("C:/a.exr", "C:/a.exr", ""),
        ("C:/a.exr:z", "C:/a.exr", "z"),
        ("C:x", "C", "x"),
        (":", "", ""),
    ] {
        let old = bytes(0, &[b"\x01", text.as_bytes(), b"\0"]);
        assert_eq!(decode(&old).unwrap(), open(path, selector), "{text}");
    }
    assert_eq!(decode(&bytes(7, &[b"\x01a:b\0c\0"])).unwrap(), open("a:b", "c"));
    assert_eq!(
        decode(&bytes(1, &[b"\0a\0"])).unwrap(),
        Packet::ReloadImage { name: "a".to_owned(), focus: false }
    );
    assert_eq!(decode(&bytes(2, &[b"a\0"])).unwrap(), Packet::CloseImage { name: "a".to_owned() });
    let created = bytes(4, &[b"\x01pic\0", &ints(&[30, 20, 2]), b"R\0B\0"]);
    let create = Packet::CreateImage {
        name: "pic".to_owned(),
        focus: true,
        width: 30,
        height: 20,
        channels: vec!["R".to_owned(), "B".to_owned()],
    };
    assert_eq!(decode(&created).unwrap(), create);
    let update = |channels, values: &[f32]| Packet::UpdateImage {
        name: "pic".to_owned(),
        focus: false,
        channels,
        rect: PixelRect::at(3, 4, 2, 1),
        values: values.to_vec(),
    };
    let place = ints(&[3, 4, 2, 1]);
    assert_eq!(
        decode(&bytes(3, &[b"\0pic\0G\0", &place, &floats(&[1.0, 2.0])])).unwrap(),
        update(vec![channel("G", 0, 1)], &[1.0, 2.0])
    );
    // A stride of 0 repeats one value, as in tev's own reader. The packet has only the values that are used.
    let same =
        bytes(6, &[b"\0pic\0", &ints(&[2]), b"G\0R\0", &place, &longs(&[1, 0, 0, 0]), &floats(&[1.0, 2.0])]);
    assert_eq!(decode(&same).unwrap(), update(vec![channel("G", 1, 0), channel("R", 0, 0)], &[1.0, 2.0]));
    let less =
        bytes(6, &[b"\0pic\0", &ints(&[2]), b"G\0R\0", &place, &longs(&[1, 0, 0, 0]), &floats(&[1.0])]);
    assert!(decode(&less).is_err());
    assert_eq!(
        decode(&bytes(5, &[b"\0pic\0", &ints(&[2]), b"G\0R\0", &place, &floats(&[1.0, 2.0, 3.0, 4.0])]))
            .unwrap(),
        update(vec![channel("G", 0, 1), channel("R", 2, 1)], &[1.0, 2.0, 3.0, 4.0])
    );
    let third = bytes(
        6,
        &[b"\0pic\0", &ints(&[2]), b"G\0R\0", &place, &longs(&[1, 0]), &longs(&[3, 3]), &floats(&[9.0; 5])],
    );
    let update = update(vec![channel("G", 1, 3), channel("R", 0, 3)], &[9.0; 5]);
    assert_eq!(decode(&third).unwrap(), update);
    // The encoder writes the newest form, exact to the byte.
    for (packet, expected) in
        [(create, created), (update, third), (open("a:b", "c"), bytes(7, &[b"\x01a:b\0c\0"]))]
    {
        let mut out = Vec::new();
        packet.encode(&mut out).unwrap();
        assert_eq!(out, expected);
    }
    let lines = bytes(
        8,
        &[
            b"\0pic\0\x01",
            &ints(&[9]),
            b"\x08\x04",
            &floats(&[1.0, 0.5, 0.0, 1.0]),
            b"\x05",
            &floats(&[0.0; 4]),
            b"\x02",
            &floats(&[1.0, 2.0]),
            b"\x03",
            &floats(&[3.0, 4.0]),
            b"\x06\x07\0\x01",
        ],
    );
    match decode(&lines).unwrap() {
        Packet::VectorGraphics { append: true, commands, .. } => {
            assert_eq!(commands.len(), 9);
            assert_eq!((commands[0], commands[3]), (Draw::BeginPath, Draw::MoveTo([1.0, 2.0])));
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn errors_of_malformed_packets_name_the_byte_offset() {
    let place = ints(&[0, 0, 2, 1]);
    for (packet, expected) in [
        (vec![], "malformed packet: its length is missing at byte 0"),
        (vec![9, 0, 0, 0, 2], "malformed packet: its length is 9, and 5 bytes came at byte 4"),
        (
            bytes(101, &[b"a\0", &ints(&[i32::MAX - 1, 0, 2, 1])]),
            "malformed packet: 2 x 1 pixels from 2147483646, 0 at byte 23",
        ),
        (bytes(2, &[]), "malformed packet: the name has no end at byte 5"),
        (bytes(2, &[b"abc"]), "malformed packet: the name has no end at byte 5"),
        (bytes(2, &[&[b'a'; 5000]]), "bytes of a text 5000 exceeds the limit of 4096"),
        (bytes(9, &[b"a\0"]), "unknown packet of type 9"),
        (bytes(99, &[]), "unknown packet of type 99"),
        (bytes(4, &[b"\0a\0", &ints(&[0, 1, 1]), b"R\0"]), "malformed packet: width is 0 at byte 12"),
        (bytes(4, &[b"\0a\0", &ints(&[1, -1, 1])]), "malformed packet: height is -1 at byte 16"),
        (bytes(4, &[b"\0a\0", &ints(&[65537, 1, 1])]), "width 65537 exceeds the limit of 65536"),
        (bytes(4, &[b"\0a\0", &ints(&[1, 1, 257])]), "number of channels 257 exceeds the limit of 256"),
        (
            bytes(3, &[b"\0a\0R\0", &place, &floats(&[1.0])]),
            "malformed packet: 2 values are needed, and 4 bytes came at byte 26",
        ),
        (
            bytes(6, &[b"\0a\0", &ints(&[1]), b"R\0", &place, &longs(&[-1, 1])]),
            "malformed packet: an offset is -1 at byte 38",
        ),
        (
            bytes(6, &[b"\0a\0", &ints(&[1]), b"R\0", &ints(&[0, 0, 60000, 60000]), &longs(&[1, i64::MAX])]),
            "malformed packet: an offset is beyond what numbers hold at byte 46",
        ),
        (bytes(8, &[b"\0a\0\0", &ints(&[1]), b"\x09"]), "malformed packet: a command of type 9 at byte 14"),
        (bytes(8, &[b"\0a\0\0", &ints(&[65537])]), "number of commands 65537 exceeds the limit of 65536"),
    ] {
        assert_eq!(decode(&packet).unwrap_err().to_string(), expected);
    }
    let limits = PacketLimits::default();
    assert!(rest_of([4, 0, 0, 0], &limits).is_err() && rest_of([255; 4], &limits).is_err());
    assert_eq!(rest_of([5, 0, 0, 0], &limits).unwrap(), 1);
}

#[test]
fn packets_that_the_protocol_cannot_encode_are_refused() {
    let mut out = vec![7];
    let rect = PixelRect::at(0, 0, 2, 2);
    let update = |channels: Vec<Channel>, rect, n| Packet::UpdateImage {
        name: "a".to_owned(),
        focus: false,
        channels,
        rect,
        values: vec![0.0; n],
    };
    for packet in [
        Packet::CloseImage { name: "a\0b".to_owned() },
        update(vec![channel("R", 0, 1)], rect, 3),
        update(vec![channel("R", u64::MAX, 1)], rect, 4),
        update(vec![channel("R", 0, 1)], PixelRect { x1: 0, ..rect }, 4),
        Packet::Mark { name: "a".to_owned(), rect: PixelRect::EVERYWHERE },
        Packet::Mark { name: "a".to_owned(), rect: PixelRect { x1: -1, ..rect } },
    ] {
        assert!(packet.encode(&mut out).is_err(), "{packet:?}");
        assert_eq!(out, [7]);
    }
    // Values that are not used are omitted.
    update(vec![channel("R", 0, 1)], rect, 9).encode(&mut out).unwrap();
    assert_eq!(decode(&out[1..]).unwrap(), update(vec![channel("R", 0, 1)], rect, 4));
}

fn text() -> impl Strategy<Value = String> {
    "[^\0]{0,12}"
}

fn rect() -> impl Strategy<Value = PixelRect> {
    (any::<i32>(), any::<i32>(), 1_u32..9, 1_u32..9)
        .prop_map(|(x, y, width, height)| PixelRect::at(x, y, width, height))
        .prop_filter("some pixel is left at the end of what coordinates hold", |rect| !rect.is_empty())
}

fn vector() -> impl Strategy<Value = Draw> {
    let number = -1e6_f32..1e6;
    let (point, color) = (prop::array::uniform2(number.clone()), prop::array::uniform4(number));
    prop_oneof![
        Just(Draw::Save),
        Just(Draw::Restore),
        point.clone().prop_map(Draw::MoveTo),
        point.prop_map(Draw::LineTo),
        color.clone().prop_map(Draw::FillColor),
        color.prop_map(Draw::StrokeColor),
        Just(Draw::Fill),
        Just(Draw::Stroke),
        Just(Draw::BeginPath),
    ]
}

fn update() -> impl Strategy<Value = Packet> {
    let channels = prop::collection::vec((text(), 0_u64..20, 0_u64..5), 0..4);
    (text(), any::<bool>(), channels, rect()).prop_map(|(name, focus, channels, rect)| {
        let channels: Vec<Channel> =
            channels.into_iter().map(|(name, offset, stride)| Channel { name, offset, stride }).collect();
        let count = needed_values(&channels, &rect).unwrap();
        Packet::UpdateImage {
            name,
            focus,
            channels,
            rect,
            values: (0..count).map(|v| v as f32 * 0.3).collect(),
        }
    })
}

fn packet() -> impl Strategy<Value = Packet> {
    let create = (text(), any::<bool>(), 1_u32..70_000, 1_u32..9, prop::collection::vec(text(), 0..5));
    prop_oneof![
        (text(), text(), any::<bool>()).prop_map(|(path, selector, focus)| Packet::OpenImage {
            path,
            selector,
            focus
        }),
        (text(), any::<bool>()).prop_map(|(name, focus)| Packet::ReloadImage { name, focus }),
        text().prop_map(|name| Packet::CloseImage { name }),
        create.prop_map(|(name, focus, width, height, channels)| Packet::CreateImage {
            name,
            focus,
            width,
            height,
            channels
        }),
        update(),
        (text(), any::<bool>(), any::<bool>(), prop::collection::vec(vector(), 0..9)).prop_map(
            |(name, focus, append, commands)| Packet::VectorGraphics { name, focus, append, commands }
        ),
        any::<u32>().prop_map(|version| Packet::Hello { version }),
        (text(), rect()).prop_map(|(name, rect)| Packet::Mark { name, rect }),
        (text(), any::<bool>(), any::<u32>(), text(), text()).prop_map(
            |(name, fullscreen, zoom, foreground, background)| Packet::Wish {
                name,
                wishes: Wishes { fullscreen, zoom, foreground, background }
            }
        ),
        (text(), any::<bool>()).prop_map(|(name, complete)| Packet::Finished { name, complete }),
        (text(), any::<i32>(), any::<i32>())
            .prop_map(|(name, x, y)| Packet::Request { name, request: Request::Center { x, y } }),
        (text(), rect()).prop_map(|(name, rect)| Packet::Request { name, request: Request::Priority(rect) }),
        text().prop_map(|name| Packet::Request { name, request: Request::Abort }),
        (text(), text(), text()).prop_map(|(name, part, text)| Packet::Panel { name, part, text }),
        (text(), text()).prop_map(|(name, text)| Packet::Edit { name, text }),
    ]
}

proptest! {
    #[test]
    fn encoded_packets_decode_to_the_same_and_truncated_ones_are_errors(packet in packet()) {
        let mut out = Vec::new();
        packet.encode(&mut out).unwrap();
        let wide = PacketLimits { dimension: 70_000, ..PacketLimits::default() };
        prop_assert_eq!(&Packet::decode(&out, &wide).unwrap(), &packet);
        // Every part of it is an error, not a panic.
        for end in 0..out.len() {
            prop_assert!(Packet::decode(&out[..end], &wide).is_err());
        }
    }

    #[test]
    fn decoding_random_bytes_never_panics(kind in any::<u8>(), content in prop::collection::vec(any::<u8>(), 0..200)) {
        let _ = decode(&bytes(kind, &[&content]));
        let _ = decode(&content);
    }
}
