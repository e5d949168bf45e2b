//! Cryptomatte: the objects or materials of each pixel with their coverages, as images (Friedman and Jones,
//! "Cryptomatte Specification", version 1.2.0, Psyop 2018).
//!
//! An id is the hash of a name. It is stored as a float of 32 bits. The coverages are computed by
//! [`granita_hider::mattes`].

use granita_base::{BaseType, Param, ParamType, Params};
use granita_dicing::PixelRect;
use granita_hider::SampleGrid;
use granita_hider::film::Support;
use granita_hider::mattes::{self, Coverage};
use granita_scene::{Primitive, Scene};
use std::collections::BTreeMap;
use std::collections::HashMap;
use std::fmt::Write;
use std::sync::Arc;

/// The things that a Cryptomatte separates.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum MatteKind {
    /// The objects, by the attribute "name".
    Object,
    /// The surface shaders.
    Material,
}

/// The data of outputs that request a Cryptomatte begins with this word.
const WORD: &str = "cryptomatte";

/// The smallest and largest "cryptomatte:ranks".
pub(crate) const RANKS: (i32, i32) = (2, 64);

impl MatteKind {
    const ALL: [Self; 2] = [Self::Object, Self::Material];

    /// Returns the kind that this data of an output requests; `None` for other data.
    ///
    /// # Errors
    /// Returns a message for a kind that does not exist.
    pub(crate) fn parse(data: &str) -> Option<Result<Self, String>> {
        let mut words = data.split_whitespace();
        if words.next() != Some(WORD) {
            return None;
        }
        let kind = Self::ALL.into_iter().find(|kind| words.clone().eq([kind.word()]));
        Some(kind.ok_or_else(|| format!("data \"{data}\" is not \"{WORD} object\" or \"{WORD} material\"")))
    }

    /// Returns the word of the kind, by which parameters select the layer.
    pub(crate) fn word(self) -> &'static str {
        match self {
            Self::Object => "object",
            Self::Material => "material",
        }
    }

    /// Returns the name of the Cryptomatte, with which its channels begin.
    fn name(self) -> &'static str {
        match self {
            Self::Object => "CryptoObject",
            Self::Material => "CryptoMaterial",
        }
    }

    /// Returns the names of the channels of an even number of ranks.
    pub(crate) fn channel_names(self, ranks: usize) -> Vec<String> {
        let name = self.name();
        (0..ranks / 2).flat_map(|k| ["R", "G", "B", "A"].map(|c| format!("{name}{k:02}.{c}"))).collect()
    }

    /// Returns the name of a primitive among those of its kind.
    fn name_of(self, primitive: &Primitive) -> Arc<str> {
        let attributes = &primitive.attributes;
        match self {
            Self::Object => match attributes.name() {
                name if name.is_empty() => "unnamed".into(),
                name => name,
            },
            Self::Material => match attributes.surface.as_ref().and_then(|group| group.layers.last()) {
                None => "defaultsurface".into(),
                Some(shader) => shader.layer.clone().unwrap_or_else(|| {
                    let name = &*shader.shader;
                    name.rsplit_once('/').map_or(name, |(_, name)| name).into()
                }),
            },
        }
    }
}

/// A Cryptomatte as a layer of an image.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct MatteLayer {
    kind: MatteKind,
    /// An even number.
    ranks: usize,
    /// The bits of the id of each matte of the scene.
    ids: Arc<[u32]>,
    /// The names with their hashes, as JSON.
    manifest: Arc<str>,
}

impl MatteLayer {
    /// Returns the layer of a scene without objects.
    pub(crate) fn new(kind: MatteKind, ranks: usize) -> Self {
        Self { kind, ranks, ids: [].into(), manifest: "{}".into() }
    }

    /// Sets the mattes of a scene.
    pub(crate) fn set(&mut self, mattes: &Mattes) {
        let names = mattes.names.iter().map(|names| match self.kind {
            MatteKind::Object => &*names[0],
            MatteKind::Material => &*names[1],
        });
        self.ids = names.clone().map(|name| id_bits(hash(name.as_bytes()))).collect();
        self.manifest = manifest(names).into();
    }

    /// Returns the pixels of a rectangle. `support` is that of the filter of the layer.
    pub(crate) fn pixels(
        &self,
        support: &Support,
        samples: &SampleGrid,
        coverage: &Coverage,
        rect: &PixelRect,
    ) -> Vec<f32> {
        mattes::ranks(support, samples, coverage, (&self.ids, self.ranks), rect)
    }

    /// Returns the attributes by which programs find the Cryptomatte in a file.
    pub(crate) fn metadata(&self) -> Params {
        let name = self.kind.name();
        let key = format!("{:08x}", hash(name.as_bytes()));
        let entry = |word: &str, value: &str| Param {
            name: format!("cryptomatte/{}/{word}", &key[..7]).into(),
            ty: ParamType::of(BaseType::String),
            data: value.into(),
        };
        Params(vec![
            entry("name", name),
            entry("hash", "MurmurHash3_32"),
            entry("conversion", "uint32_to_float32"),
            entry("manifest", &self.manifest),
        ])
    }
}

/// The mattes of a scene: each pair of the names of an object and of a material.
pub(crate) struct Mattes {
    /// The matte of each primitive.
    pub(crate) of_primitives: Arc<[u32]>,
    names: Vec<[Arc<str>; 2]>,
}

impl Mattes {
    pub(crate) fn new(scene: &Scene) -> Self {
        let mut numbers: HashMap<[Arc<str>; 2], u32> = HashMap::new();
        let mut names = Vec::new();
        let of = |primitive: &Arc<Primitive>| {
            let pair = MatteKind::ALL.map(|kind| kind.name_of(primitive));
            *numbers.entry(pair).or_insert_with_key(|pair| {
                names.push(pair.clone());
                u32::try_from(names.len() - 1).unwrap_or(u32::MAX)
            })
        };
        let of_primitives = scene.primitives.iter().map(of).collect();
        Self { of_primitives, names }
    }
}

/// Returns the names and their hashes as a JSON object, sorted by name.
fn manifest<'a>(names: impl Iterator<Item = &'a str>) -> String {
    let sorted: BTreeMap<&str, u32> = names.map(|name| (name, hash(name.as_bytes()))).collect();
    let mut text = "{".to_owned();
    for (name, hash) in sorted {
        if text.len() > 1 {
            text.push(',');
        }
        text.push('"');
        for c in name.chars() {
            match c {
                '"' => text.push_str("\\\""),
                '\\' => text.push_str("\\\\"),
                c if (c as u32) < 0x20 => {
                    // Writing to a text cannot fail.
                    let _ = write!(text, "\\u{:04x}", c as u32);
                }
                c => text.push(c),
            }
        }
        let _ = write!(text, "\":\"{hash:08x}\"");
    }
    text.push('}');
    text
}

/// Returns the bits of the float that represents a hash. A number whose exponent is that of zeros and denormal numbers,
/// or of infinities and NaN, gets another one.
fn id_bits(hash: u32) -> u32 {
    match (hash >> 23) & 255 {
        0 | 255 => hash ^ (1 << 23),
        _ => hash,
    }
}

/// Computes MurmurHash3_x86_32 with the seed 0 (Austin Appleby, public domain).
fn hash(bytes: &[u8]) -> u32 {
    let scrambled = |block: u32| block.wrapping_mul(0xcc9e_2d51).rotate_left(15).wrapping_mul(0x1b87_3593);
    let (blocks, rest) = bytes.as_chunks::<4>();
    let mut h = 0_u32;
    for block in blocks {
        h ^= scrambled(u32::from_le_bytes(*block));
        h = h.rotate_left(13).wrapping_mul(5).wrapping_add(0xe654_6b64);
    }
    if !rest.is_empty() {
        let mut last = [0; 4];
        last[..rest.len()].copy_from_slice(rest);
        h ^= scrambled(u32::from_le_bytes(last));
    }
    h ^= bytes.len() as u32;
    h = (h ^ (h >> 16)).wrapping_mul(0x85eb_ca6b);
    h = (h ^ (h >> 13)).wrapping_mul(0xc2b2_ae35);
    h ^ (h >> 16)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hashes_are_those_of_murmurhash3() {
        // Values of the reference implementation with the seed 0.
        assert_eq!(hash(b""), 0);
        assert_eq!(hash(b"test"), 0xba6b_d213);
        assert_eq!(hash(b"Hello, world!"), 0xc036_3e43);
        assert_eq!(hash(b"The quick brown fox jumps over the lazy dog"), 0x2e4f_f723);
    }

    #[test]
    fn ids_are_normal_floats() {
        for hash in [0, 1, 0x007f_ffff, 0x7f80_0000, 0xffff_ffff, 0x8000_0000, 0xff80_0001] {
            assert!(f32::from_bits(id_bits(hash)).is_normal(), "{hash:x}");
        }
        assert_eq!(id_bits(0x3f80_0000), 0x3f80_0000);
    }

    #[test]
    fn manifests_are_sorted_json() {
        let text = manifest(["test", "a\"\\\n", "test"].into_iter());
        let expected = format!("{{\"a\\\"\\\\\\u000a\":\"{:08x}\",\"test\":\"ba6bd213\"}}", hash(b"a\"\\\n"));
        assert_eq!(text, expected);
        assert_eq!(manifest([].into_iter()), "{}");
    }

    #[test]
    fn channels_and_metadata_have_the_names_of_the_specification() {
        let layer = MatteLayer::new(MatteKind::Object, 4);
        let names = MatteKind::Object.channel_names(4);
        assert_eq!(names[..2], ["CryptoObject00.R", "CryptoObject00.G"]);
        assert_eq!(names[7], "CryptoObject01.A");
        let metadata = layer.metadata();
        let key = &format!("{:08x}", hash(b"CryptoObject"))[..7];
        let text = |word: &str| metadata.string(&format!("cryptomatte/{key}/{word}")).map(|s| s.to_string());
        assert_eq!(text("name").as_deref(), Some("CryptoObject"));
        assert_eq!(text("conversion").as_deref(), Some("uint32_to_float32"));
        assert_eq!(text("manifest").as_deref(), Some("{}"));
    }

    #[test]
    fn data_names_the_kind() {
        assert_eq!(MatteKind::parse("cryptomatte object"), Some(Ok(MatteKind::Object)));
        assert_eq!(MatteKind::parse("cryptomatte  material"), Some(Ok(MatteKind::Material)));
        assert!(matches!(MatteKind::parse("cryptomatte"), Some(Err(_))));
        assert!(matches!(MatteKind::parse("cryptomatte asset"), Some(Err(_))));
        assert_eq!(MatteKind::parse("color cryptomatte"), None);
    }
}
