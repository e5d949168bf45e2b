//! Converts attributes of OpenEXR files to attributes of the suite and back, and names and orders channels.

use exr::meta::attribute::{AttributeValue, Chromaticities, EnvironmentMap, Preview, Text};
use exr::meta::header::{ImageAttributes, LayerAttributes, standard_names};
use exr::prelude::{SmallVec, Vec2};
use granita_base::{BaseType, Param, ParamData, ParamType, Params};
use granita_image::ImageSpec;

/// The custom attribute with the order of the channels, which the format sorts by name.
pub(crate) const CHANNEL_ORDER: &str = "channelOrder";

/// The attribute with an ICC profile, in bytes. The suite's attribute of this name is its description, which is not
/// written.
const PROFILE: &str = "ICCProfile";

/// The attribute with the primaries and the white of linear colours: x and y of red, green, blue and white.
const CHROMATICITIES: &str = "chromaticities";
/// The attribute with the preview: its width and height, and the bytes of red, green, blue and alpha of each pixel as
/// one integer, red being the lowest byte.
const PREVIEW: &str = "preview";

/// The largest number of pixels of a preview that is kept.
const MOST_PREVIEW: usize = 1 << 18;

/// The kind of the attributes with any number of floats.
const FLOATS: &str = "floatvector";

/// The attributes that are options of writers, or have their own place in the header.
const NOT_CUSTOM: [&str; 24] = [
    PROFILE,
    CHROMATICITIES,
    "compression",
    "planarconfig",
    "rowsperstrip",
    "predictor",
    "quality",
    "quantize",
    "dither",
    "gain",
    "gamma",
    "unassociatedalpha",
    "wrapmodes",
    "worldtocamera",
    "worldtondc",
    "owner",
    "copyright",
    "software",
    "ImageDescription",
    "filter",
    "filterwidth",
    "pixelaspect",
    "name",
    "view",
];

/// Returns the attribute of the chromaticities of a file; `None` where it has none.
pub(crate) fn chromaticities(shared: &ImageAttributes) -> Option<Param> {
    let Chromaticities { red, green, blue, white } = shared.chromaticities?;
    let values: Vec<f32> = [red, green, blue, white].iter().flat_map(|v| [v.0, v.1]).collect();
    let ty = ParamType::array(BaseType::Float, 8);
    Some(Param { name: CHROMATICITIES.into(), ty, data: values[..].into() })
}

/// Returns the chromaticities of an image; `None` where it has none, or none that a file can hold.
pub(crate) fn to_chromaticities(spec: &ImageSpec) -> Option<Chromaticities> {
    let values = spec.attributes.floats(CHROMATICITIES)?;
    let [rx, ry, gx, gy, bx, by, wx, wy] = values[..] else { return None };
    let pair = |x, y| Vec2(x, y);
    let found =
        Chromaticities { red: pair(rx, ry), green: pair(gx, gy), blue: pair(bx, by), white: pair(wx, wy) };
    values.iter().all(|v| v.is_finite()).then_some(found)
}

/// Converts any string to a text of the format, which current programs read as UTF-8.
fn text(s: &str) -> Text {
    let bytes: String = s.bytes().filter(|b| *b != 0).map(char::from).collect();
    // Every byte is a character below 256, so it always fits.
    Text::new_or_none(bytes).unwrap_or_default()
}

/// Returns the string in a text of the format.
pub(crate) fn string(t: &Text) -> String {
    String::from_utf8_lossy(t.as_slice()).into_owned()
}

/// Returns a channel name; `None` when the format cannot store it.
pub(crate) fn channel_name(name: &str) -> Option<Text> {
    (!name.is_empty() && name.len() < 256 && !name.contains('\0')).then(|| text(name))
}

/// Returns the header's attributes from those of a spec.
pub(crate) fn to_header(spec: &ImageSpec) -> LayerAttributes {
    let mut own = LayerAttributes::default();
    let named = |name: &str| {
        let p = spec.attributes.iter().rev().find(|p| p.name.eq_ignore_ascii_case(name))?;
        spec.string(&p.name).map(text)
    };
    own.owner = named("owner").or_else(|| named("copyright"));
    own.comments = named("ImageDescription");
    own.software_name =
        Some(named("software").unwrap_or_else(|| text(&format!("Granita {}", granita_base::VERSION))));
    own.wrap_mode_name = named("wrapmodes");
    own.layer_name = named("name");
    own.view_name = named("view");
    own.preview = match spec.attributes.get(PREVIEW).map(|param| &param.data) {
        Some(ParamData::Int(ints)) => preview(ints),
        _ => None,
    };
    own.world_to_camera = spec.matrix("worldtocamera");
    own.world_to_normalized_device =
        ["worldtoNDC", "worldtondc"].into_iter().find_map(|name| spec.matrix(name));
    own.environment_map = match spec.string("textureformat") {
        Some("LatLong Environment") => Some(EnvironmentMap::LatitudeLongitude),
        Some("CubeFace Environment") => Some(EnvironmentMap::Cube),
        _ => None,
    };
    if let Some(profile) = &spec.icc_profile {
        let bytes = SmallVec::from_slice(profile);
        own.other.insert(text(PROFILE), AttributeValue::Bytes { type_hint: text("icc"), bytes });
    }
    for p in &spec.attributes {
        let reserved = standard_names::ALL.contains(&p.name.as_bytes());
        let special = NOT_CUSTOM.iter().any(|n| p.name.eq_ignore_ascii_case(n));
        if reserved || special || p.name.is_empty() || p.name.len() > 255 {
            continue;
        }
        if let Some(value) = value_of(&p.data) {
            own.other.insert(text(&p.name), value);
        }
    }
    own
}

/// Returns the ICC profile of a header.
pub(crate) fn profile(own: &LayerAttributes) -> Option<Vec<u8>> {
    match own.other.get(&text(PROFILE))? {
        AttributeValue::Bytes { bytes, .. } => Some(bytes.to_vec()),
        _ => None,
    }
}

/// Returns the preview of the integers of [`PREVIEW`]; `None` when their number does not fit.
fn preview(ints: &[i32]) -> Option<Preview> {
    let (&[width, height], pixels) = ints.split_first_chunk::<2>()?;
    let size = Vec2(usize::try_from(width).ok()?, usize::try_from(height).ok()?);
    (size.0.checked_mul(size.1)? == pixels.len()).then(|| Preview {
        size,
        pixel_data: pixels.iter().flat_map(|pixel| pixel.to_le_bytes().map(u8::cast_signed)).collect(),
    })
}

/// Returns the integers of [`PREVIEW`]; `None` for a preview that is too large or damaged.
fn preview_param(preview: &Preview) -> Option<(ParamType, ParamData)> {
    let Vec2(width, height) = preview.size;
    let pixels = width.checked_mul(height).filter(|n| (1..=MOST_PREVIEW).contains(n))?;
    let (bytes, _) = preview.pixel_data.as_chunks::<4>();
    if bytes.len() != pixels {
        return None;
    }
    let size = [width, height].map(|n| i32::try_from(n).unwrap_or(0));
    let pixels = bytes.iter().map(|bytes| i32::from_le_bytes(bytes.map(i8::cast_unsigned)));
    let all: Vec<i32> = size.into_iter().chain(pixels).collect();
    Some((ParamType::array(BaseType::Int, all.len() as u32), all[..].into()))
}

/// Returns a value of the format; `None` when it has no type for it.
fn value_of(data: &ParamData) -> Option<AttributeValue> {
    Some(match data {
        ParamData::Float(v) => match v[..] {
            [a] => AttributeValue::F32(a),
            [a, b] => AttributeValue::FloatVec2(Vec2(a, b)),
            [a, b, c] => AttributeValue::FloatVec3((a, b, c)),
            _ => match v.len() {
                9 => AttributeValue::Matrix3x3(v[..].try_into().ok()?),
                16 => AttributeValue::Matrix4x4(v[..].try_into().ok()?),
                _ => {
                    let kind = text(FLOATS);
                    let bytes = v.iter().flat_map(|v| v.to_le_bytes()).collect();
                    AttributeValue::Custom { kind, bytes }
                }
            },
        },
        ParamData::Int(v) => match v[..] {
            [a] => AttributeValue::I32(a),
            [a, b] => AttributeValue::IntVec2(Vec2(a, b)),
            [a, b, c] => AttributeValue::IntVec3((a, b, c)),
            _ => return None,
        },
        ParamData::String(v) => match &v[..] {
            [one] => AttributeValue::Text(text(one)),
            many => AttributeValue::TextVector(many.iter().map(|s| text(s)).collect()),
        },
    })
}

/// Returns the attributes of a spec from a header's, in the order of their names.
pub(crate) fn from_header(own: &LayerAttributes) -> Params {
    let mut params = Params::new();
    let mut set = |name: &str, value: Option<(ParamType, ParamData)>| {
        if let Some((ty, data)) = value {
            params.set(Param { name: name.into(), ty, data });
        }
    };
    let words = |t: &Option<Text>| t.as_ref().map(|t| text_param(&string(t)));
    set("owner", words(&own.owner));
    set("copyright", words(&own.owner));
    set("software", words(&own.software_name));
    set("ImageDescription", words(&own.comments));
    set("wrapmodes", words(&own.wrap_mode_name));
    set("name", words(&own.layer_name));
    set("view", words(&own.view_name));
    set(PREVIEW, own.preview.as_ref().and_then(preview_param));
    let matrix = |m: &[f32; 16]| (ParamType::of(BaseType::Matrix), m[..].into());
    set("worldtocamera", own.world_to_camera.as_ref().map(matrix));
    set("worldtondc", own.world_to_normalized_device.as_ref().map(matrix));
    set(
        "textureformat",
        own.environment_map.map(|map| match map {
            EnvironmentMap::LatitudeLongitude => text_param("LatLong Environment"),
            EnvironmentMap::Cube => text_param("CubeFace Environment"),
        }),
    );
    // A hash map has no order of its own.
    let mut other: Vec<(String, &AttributeValue)> = own.other.iter().map(|(k, v)| (string(k), v)).collect();
    other.sort_by(|a, b| a.0.cmp(&b.0));
    for (name, value) in other {
        if name != CHANNEL_ORDER {
            set(&name, param_of(value));
        }
    }
    params
}

fn text_param(s: &str) -> (ParamType, ParamData) {
    (ParamType::of(BaseType::String), s.into())
}

/// Returns a parameter from a custom attribute; `None` for kinds that the suite does not use.
fn param_of(value: &AttributeValue) -> Option<(ParamType, ParamData)> {
    let floats = |v: &[f32]| (ParamType::array(BaseType::Float, v.len() as u32), v.into());
    let ints = |v: &[i32]| (ParamType::array(BaseType::Int, v.len() as u32), v.into());
    Some(match value {
        AttributeValue::Text(t) => text_param(&string(t)),
        AttributeValue::TextVector(list) => {
            let strings = list.iter().map(|t| string(t).into()).collect();
            (ParamType::array(BaseType::String, list.len() as u32), ParamData::String(strings))
        }
        AttributeValue::F32(v) => (ParamType::of(BaseType::Float), (*v).into()),
        AttributeValue::F64(v) => (ParamType::of(BaseType::Float), (*v as f32).into()),
        AttributeValue::I32(v) => (ParamType::of(BaseType::Int), (*v).into()),
        AttributeValue::Matrix4x4(m) => (ParamType::of(BaseType::Matrix), m[..].into()),
        AttributeValue::Matrix3x3(m) => floats(m),
        AttributeValue::FloatVec2(v) => floats(&[v.0, v.1]),
        AttributeValue::FloatVec3(v) => floats(&[v.0, v.1, v.2]),
        AttributeValue::Custom { kind, bytes } if string(kind) == FLOATS => {
            let all: Vec<f32> = bytes.as_chunks().0.iter().map(|bytes| f32::from_le_bytes(*bytes)).collect();
            floats(&all)
        }
        AttributeValue::IntVec2(v) => ints(&[v.0, v.1]),
        AttributeValue::IntVec3(v) => ints(&[v.0, v.1, v.2]),
        _ => return None,
    })
}

/// Returns the order of the channels in the output. `result[i]` is the index in `sorted` (the file's order) of channel
/// `i`. It follows `wanted` if that names the same channels. Otherwise it goes layer by layer, in each R G B, Y, A, Z
/// and then the others by name.
pub(crate) fn channel_order(sorted: &[String], wanted: Option<&str>) -> Vec<usize> {
    if let Some(wanted) = wanted {
        let mut order = Vec::new();
        for name in wanted.split(',') {
            order.extend(sorted.iter().position(|s| s == name).filter(|i| !order.contains(i)));
        }
        if order.len() == sorted.len() {
            return order;
        }
    }
    fn split(name: &str) -> (&str, &str) {
        name.rsplit_once('.').unwrap_or(("", name))
    }
    let rank = |name: &str| {
        let (layer, base) = split(name);
        // Y and Z beside an X are coordinates or CIE XYZ, and stay where the alphabet puts them.
        let vector = sorted.iter().any(|s| split(s) == (layer, "X") || split(s) == (layer, "x"));
        match base {
            "R" | "r" | "red" => 0,
            "G" | "g" | "green" => 1,
            "B" | "b" | "blue" => 2,
            "Y" | "y" if !vector => 3,
            "A" | "a" | "alpha" => 4,
            "Z" | "z" if !vector => 5,
            _ => 6,
        }
    };
    let mut order: Vec<usize> = (0..sorted.len()).collect();
    order.sort_by_key(|i| (split(&sorted[*i]).0, rank(&sorted[*i]), &sorted[*i]));
    order
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ordered(names: &[&str], wanted: Option<&str>) -> Vec<String> {
        let mut sorted: Vec<String> = names.iter().map(|s| (*s).to_owned()).collect();
        sorted.sort();
        channel_order(&sorted, wanted).into_iter().map(|i| sorted[i].clone()).collect()
    }

    #[test]
    fn channels_are_ordered_by_convention_or_by_attribute() {
        assert_eq!(ordered(&["A", "B", "G", "R", "Z"], None), ["R", "G", "B", "A", "Z"]);
        assert_eq!(ordered(&["A", "Y"], None), ["Y", "A"]);
        assert_eq!(
            ordered(&["N.X", "N.Y", "N.Z", "R", "G", "B"], None),
            ["R", "G", "B", "N.X", "N.Y", "N.Z"]
        );
        assert_eq!(ordered(&["b", "a", "c"], Some("c,a,b")), ["c", "a", "b"]);
        assert_eq!(ordered(&["b", "c"], Some("c,c")), ["b", "c"]);
        assert_eq!(ordered(&["b", "c"], Some("c,d")), ["b", "c"]);
    }

    #[test]
    fn chromaticities_survive_write_and_read() {
        let mut spec = ImageSpec::new(1, 1, 3, granita_image::PixelType::Half);
        assert_eq!(to_chromaticities(&spec), None);
        let values = [0.713, 0.293, 0.165, 0.83, 0.128, 0.044, 0.321_68, 0.337_67];
        spec.attributes.set(Param::declared("float[8] chromaticities", &values[..]).unwrap());
        let display = exr::meta::attribute::IntegerBounds::new(Vec2(0, 0), Vec2(1, 1));
        let mut shared = ImageAttributes::new(display);
        assert_eq!(chromaticities(&shared), None);
        shared.chromaticities = to_chromaticities(&spec);
        assert_eq!(chromaticities(&shared).as_ref(), spec.attributes.get("chromaticities"));
        assert!(!to_header(&spec).other.contains_key(CHROMATICITIES.as_bytes()));
        spec.attributes.set(Param::declared("float[2] chromaticities", &values[..2]).unwrap());
        assert_eq!(to_chromaticities(&spec), None);
    }

    #[test]
    fn previews_survive_write_and_read() {
        let mut spec = ImageSpec::new(1, 1, 1, granita_image::PixelType::Half);
        let with = |spec: &mut ImageSpec, ints: &[i32]| {
            let declared = format!("int[{}] preview", ints.len());
            spec.attributes.set(Param::declared(&declared, ints).unwrap());
            from_header(&to_header(spec)).get("preview").cloned()
        };
        let ints = [2, 1, 0x0403_0201, -1];
        assert_eq!(with(&mut spec, &ints).map(|p| p.data), Some(ints[..].into()));
        let own = to_header(&spec).preview.unwrap();
        assert_eq!((own.size, &own.pixel_data[..4]), (Vec2(2, 1), &[1, 2, 3, 4][..]));
        for wrong in [&[2, 2, 1][..], &[-1, 1, 1], &[0, 0], &[1]] {
            assert_eq!(with(&mut spec, wrong), None, "{wrong:?}");
        }
    }

    #[test]
    fn custom_attributes_survive_write_and_read() {
        let mut spec = ImageSpec::new(1, 1, 1, granita_image::PixelType::Half);
        let m: Vec<f32> = (0..16).map(|i| i as f32).collect();
        for p in [
            Param::declared("string Artist", "\u{3b1}").unwrap(),
            Param::declared("float fovcot", 1.5).unwrap(),
            Param::declared("int[3] three", &[1, 2, 3][..]).unwrap(),
            Param::declared("matrix worldtoscreen", &m[..]).unwrap(),
            Param::declared("float[5] CDF_0", &m[..5]).unwrap(),
        ] {
            spec.attributes.set(p);
        }
        let got = from_header(&to_header(&spec));
        for p in &spec.attributes {
            assert_eq!(got.get(&p.name), Some(p));
        }
        // Names that the format reserves are omitted, not refused.
        spec.attributes.set(Param::declared("int tiles", 3).unwrap());
        assert_eq!(from_header(&to_header(&spec)).get("tiles"), None);
    }
}
