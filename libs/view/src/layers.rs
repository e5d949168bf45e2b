//! Groups channels to layers.

use crate::tile::{Pick, Reduce};
use granita_image::{ImageSpec, PixelType};
use granita_texture::TextureKind;

/// The meaning of the values of a layer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Meaning {
    /// Colours, or other values that are shown as colours.
    Color,
    /// Distances from a camera. They are shown within their range, near ones bright.
    Depth,
    /// Numbers of objects.
    Number,
}

/// Channels that belong together, because their names have a common prefix.
#[derive(Clone, Debug, PartialEq)]
pub struct Layer {
    /// The common prefix of the names, "" for plain ones. For depths it is the name of the channel.
    pub name: String,
    /// Its channels, by their index in the image.
    pub channels: Vec<usize>,
    /// The channels of red, green and blue. A single channel is used three times.
    pub color: [Pick; 3],
    /// Its alpha channel.
    pub alpha: Option<usize>,
    /// The meaning of its values.
    pub meaning: Meaning,
}

/// Returns the last part of a channel's name.
fn last_part(name: &str) -> &str {
    name.rsplit_once('.').map_or(name, |(_, last)| last)
}

fn is_depth(name: &str) -> bool {
    matches!(last_part(name).to_ascii_lowercase().as_str(), "z" | "zback" | "depth" | "zmin" | "zmax")
}

/// True for the name of two ranks of a Cryptomatte, such as "CryptoObject00". Its first channel has the id of the
/// object that covers most of a pixel.
fn is_cryptomatte(name: &str) -> bool {
    last_part(name)
        .strip_prefix("Crypto")
        .is_some_and(|rest| rest.len() > 2 && rest.bytes().rev().take(2).all(|b| b.is_ascii_digit()))
}

impl Layer {
    fn new(name: &str, channels: Vec<usize>, names: &[String], pixel_type: PixelType) -> Self {
        let find = |words: [&str; 2]| {
            channels
                .iter()
                .copied()
                .find(|c| words.contains(&last_part(&names[*c]).to_ascii_lowercase().as_str()))
        };
        if let Some(id) = find(["r", "red"]).filter(|_| is_cryptomatte(name)) {
            let color = [Pick::Channel(id); 3];
            return Self { name: name.to_owned(), channels, color, alpha: None, meaning: Meaning::Number };
        }
        let alpha = find(["a", "alpha"]).filter(|_| channels.len() > 1);
        let rest: Vec<usize> = channels.iter().copied().filter(|c| Some(*c) != alpha).collect();
        let rgb = [find(["r", "red"]), find(["g", "green"]), find(["b", "blue"])];
        let color = match (rgb, &rest[..]) {
            ([Some(r), Some(g), Some(b)], _) => [r, g, b].map(Pick::Channel),
            (_, []) => [Pick::Value(0.0); 3],
            (_, [one]) => [Pick::Channel(*one); 3],
            (_, [a, b]) => [Pick::Channel(*a), Pick::Channel(*b), Pick::Value(0.0)],
            (_, [a, b, c, ..]) => [*a, *b, *c].map(Pick::Channel),
        };
        let depth = channels.iter().all(|c| is_depth(&names[*c])) && channels.len() == 1;
        let meaning = match pixel_type {
            PixelType::U32 => Meaning::Number,
            _ if depth => Meaning::Depth,
            _ => Meaning::Color,
        };
        Self { name: name.to_owned(), channels, color, alpha, meaning }
    }

    /// Returns the layers of an image, the plain one first.
    ///
    /// Names up to the last dot group channels. A depth among plain channels is a layer of its own, and so are channels
    /// of other names beside red, green and blue, and every channel of a volume shadow map.
    pub fn of(spec: &ImageSpec, kind: TextureKind) -> Vec<Self> {
        let names = &spec.channels;
        let volume = matches!(kind, TextureKind::VolumeShadow | TextureKind::CubeFaceVolumeShadow);
        if volume && names.len() >= 4 {
            return Self::of_volume_shadow(names);
        }
        let has_colors = ["R", "G", "B"].iter().all(|color| names.iter().any(|name| name == color));
        let is_color = |name: &str| matches!(name, "R" | "G" | "B" | "A" | "alpha");
        let mut groups: Vec<(String, Vec<usize>)> = Vec::new();
        for (c, name) in names.iter().enumerate() {
            let group = match name.rsplit_once('.') {
                Some((group, _)) => group,
                None if is_depth(name) && names.len() > 1 => name,
                None if has_colors && !is_color(name) => name,
                None => "",
            };
            match groups.iter_mut().find(|g| g.0 == group) {
                Some((_, list)) => list.push(c),
                None => groups.push((group.to_owned(), vec![c])),
            }
        }
        // Plain channels come first, then groups in the order of their first channels.
        groups.sort_by_key(|(name, list)| (!name.is_empty(), list[0]));
        let mut layers: Vec<Self> =
            groups.into_iter().map(|(name, list)| Self::new(&name, list, names, spec.pixel_type)).collect();
        if kind.is_shadow() {
            layers.iter_mut().for_each(|l| l.meaning = Meaning::Depth);
        }
        layers
    }

    /// Returns the layers of a volume shadow map. Channel 0 is the opaque depth and channel 1 the opacity before it.
    /// The others are the depths at which fractions of that opacity are reached (reference 9.2.4).
    fn of_volume_shadow(names: &[String]) -> Vec<Self> {
        let steps = names.len() - 3;
        let one = |c: usize, name: String, meaning| Self {
            name,
            channels: vec![c],
            color: [Pick::Channel(c); 3],
            alpha: None,
            meaning,
        };
        let mut layers = vec![
            one(1, "opacity".to_owned(), Meaning::Color),
            one(0, "opaque depth".to_owned(), Meaning::Depth),
        ];
        for i in 0..=steps {
            let name = format!("depth at {:.0} % of the opacity", 100.0 * i as f64 / steps as f64);
            layers.push(one(2 + i, name, Meaning::Depth));
        }
        layers
    }

    /// Returns the reduction to a computed level, for each channel of the image.
    pub(crate) fn reductions(layers: &[Self], channels: usize) -> Vec<Reduce> {
        (0..channels)
            .map(|c| match layers.iter().find(|l| l.channels.contains(&c)).map(|l| l.meaning) {
                Some(Meaning::Depth) => Reduce::Least,
                Some(Meaning::Number) => Reduce::First,
                Some(Meaning::Color) | None => Reduce::Mean,
            })
            .collect()
    }

    /// Returns a readable name. The plain layer is named by its channels.
    pub fn title(&self, names: &[String]) -> String {
        if !self.name.is_empty() {
            return self.name.clone();
        }
        let all: Vec<&str> = self.channels.iter().filter_map(|c| names.get(*c)).map(String::as_str).collect();
        match all[..] {
            _ if all.iter().all(|n| n.chars().count() == 1) => all.concat(),
            [first, second, third, .., last] if all.len() > 8 => {
                format!("{first} {second} {third} ... {last}")
            }
            _ => all.join(" "),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layers(names: &[&str], kind: TextureKind) -> Vec<Layer> {
        let mut spec = ImageSpec::new(1, 1, names.len(), PixelType::Half);
        spec.channels = names.iter().map(|n| (*n).to_owned()).collect();
        Layer::of(&spec, kind)
    }

    #[test]
    fn titles_of_many_channels_are_abbreviated() {
        let title = |n: usize| {
            let names: Vec<String> = (0..n).map(|i| format!("z{i}")).collect();
            layers(&names.iter().map(|n| &**n).collect::<Vec<_>>(), TextureKind::Plain)[0].title(&names)
        };
        assert_eq!(title(3), "z0 z1 z2");
        assert_eq!(title(67), "z0 z1 z2 ... z66");
    }

    #[test]
    fn channels_are_grouped_by_their_names() {
        let l = layers(
            &["R", "G", "B", "A", "Z", "N.x", "N.y", "N.z", "diffuse.R", "diffuse.G", "diffuse.B"],
            TextureKind::Plain,
        );
        let names: Vec<&str> = l.iter().map(|l| &*l.name).collect();
        assert_eq!(names, ["", "Z", "N", "diffuse"]);
        assert_eq!((l[0].alpha, l[0].channels.len(), l[1].meaning), (Some(3), 4, Meaning::Depth));
        assert_eq!(l[2].color, [5, 6, 7].map(Pick::Channel));
        assert_eq!(Layer::reductions(&l, 11)[4], Reduce::Least);
        assert_eq!(l[0].title(&["R", "G", "B", "A"].map(str::to_owned)), "RGBA");
    }

    #[test]
    fn numbers_beside_colours_are_layers() {
        let l = layers(&["R", "G", "B", "A", "u", "id", "P.X", "P.Y", "P.Z"], TextureKind::Plain);
        let names: Vec<&str> = l.iter().map(|l| &*l.name).collect();
        assert_eq!(names, ["", "u", "id", "P"]);
        assert_eq!((l[0].channels.len(), l[2].color), (4, [Pick::Channel(5); 3]));
    }

    #[test]
    fn cryptomattes_show_the_foremost_ids() {
        let names =
            ["R", "G", "B", "CryptoObject00.R", "CryptoObject00.G", "CryptoObject00.B", "CryptoObject00.A"];
        let l = layers(&names, TextureKind::Plain);
        assert_eq!((&*l[1].name, l[1].meaning, l[1].alpha), ("CryptoObject00", Meaning::Number, None));
        assert_eq!(l[1].color, [Pick::Channel(3); 3]);
        assert!(
            is_cryptomatte("left.CryptoMaterial01")
                && !is_cryptomatte("Crypto")
                && !is_cryptomatte("Crypto01")
        );
    }

    #[test]
    fn order_of_channels_does_not_matter() {
        let l = layers(&["a.B", "a.G", "a.R", "a.A"], TextureKind::Plain);
        assert_eq!(l[0].color, [2, 1, 0].map(Pick::Channel));
        assert_eq!(l[0].alpha, Some(3));
    }

    #[test]
    fn few_channels_are_shown_as_grey_or_colour() {
        assert_eq!(layers(&["Y"], TextureKind::Plain)[0].color, [Pick::Channel(0); 3]);
        assert_eq!(layers(&["A"], TextureKind::Plain)[0].color, [Pick::Channel(0); 3]);
        assert_eq!(layers(&["u", "v"], TextureKind::Plain)[0].color[2], Pick::Value(0.0));
        assert_eq!(layers(&["Z"], TextureKind::Plain)[0].meaning, Meaning::Depth);
        assert_eq!(layers(&["Y"], TextureKind::Shadow)[0].meaning, Meaning::Depth);
    }

    #[test]
    fn volume_shadow_maps_have_named_layers() {
        let l = layers(&["R", "G", "B", "A", "channel4"], TextureKind::VolumeShadow);
        assert_eq!(l.len(), 5);
        assert_eq!((l[0].channels[0], l[1].meaning), (1, Meaning::Depth));
        assert_eq!(l[3].name, "depth at 50 % of the opacity");
    }
}
