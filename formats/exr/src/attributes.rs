//! Converts attributes of OpenEXR files to attributes of the suite and back, and names and orders channels.

use exr::meta::attribute::{AttributeValue, EnvironmentMap, Text};
use exr::meta::header::{LayerAttributes, standard_names};
use exr::prelude::Vec2;
use granita_base::{BaseType, Param, ParamData, ParamType, Params};
use granita_image::ImageSpec;

/// The custom attribute with the order of the channels, which the format sorts by name.
pub(crate) const CHANNEL_ORDER: &str = "channelOrder";

/// The kind of the attributes with any number of floats.
const FLOATS: &str = "floatvector";

/// The attributes that are options of writers, or have their own place in the header.
const NOT_CUSTOM: [&str; 20] = [
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
];

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
    own.world_to_camera = spec.matrix("worldtocamera");
    own.world_to_normalized_device =
        ["worldtoNDC", "worldtondc"].into_iter().find_map(|name| spec.matrix(name));
    own.environment_map = match spec.string("textureformat") {
        Some("LatLong Environment") => Some(EnvironmentMap::LatitudeLongitude),
        Some("CubeFace Environment") => Some(EnvironmentMap::Cube),
        _ => None,
    };
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
