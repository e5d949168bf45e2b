//! Colour spaces.

use crate::image::Image;
use granita_color::Processor;

/// The name of the metadata that holds the name of a colour space, as OpenImageIO stores it.
const SPACE: &str = "oiio:ColorSpace";

impl Image {
    /// Returns the image whose colours are in the named space. The values stay as they are. Other metadata about
    /// colours, such as an ICC profile, is removed.
    #[must_use]
    pub fn in_space(&self, space: &str) -> Self {
        let mut image = self.clone();
        image.spec.remove_colors();
        image.with_text(SPACE, space)
    }

    /// Returns the image with converted colours: those of the first three channels, or of the first one of less than
    /// three. With `unassociate` they are divided by alpha before the conversion and multiplied after it. `space` is
    /// the space of the result; without one nothing is known of its colours.
    #[must_use]
    pub fn with_colors(&self, processor: Processor, unassociate: bool, space: Option<&str>) -> Self {
        let image = self.associated();
        let alpha = image.spec.alpha_channel().filter(|_| unassociate);
        let mut image = match (processor.is_identity(), alpha) {
            (true, _) => image,
            (false, None) => image.changed(move |row, n| processor.apply(row, n)),
            (false, Some(alpha)) => image.changed(move |row, n| processor.apply_associated(row, n, alpha)),
        };
        image.spec.remove_colors();
        match space {
            Some(space) => image.in_space(space),
            None => image,
        }
    }
}

#[cfg(test)]
mod tests {
    use crate::{Pattern, Window, float_rows, pattern};
    use granita_color::Config;

    #[test]
    fn colors_are_converted_as_they_are_or_apart_from_alpha() {
        let window = Window { x: 0, y: 0, width: 2, height: 1 };
        let image = pattern(Pattern::Constant(vec![0.25, 0.25, 0.25, 0.5]), &window, 4).unwrap();
        let to_srgb = || Config::built_in().processor("lin_rec709", "sRGB - Texture").unwrap();
        let first = |image: &crate::Image| float_rows(&**image.source(), 0, 1).unwrap()[..4].to_vec();
        let near = |a: Vec<f32>, b: [f32; 4]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5);
        let plain = image.with_colors(to_srgb(), false, Some("sRGB - Texture"));
        assert!(near(first(&plain), [0.537_099, 0.537_099, 0.537_099, 0.5]));
        assert_eq!(plain.spec().string("oiio:ColorSpace"), Some("sRGB - Texture"));
        let apart = image.with_colors(to_srgb(), true, None);
        assert!(near(first(&apart), [0.367_678, 0.367_678, 0.367_678, 0.5]));
        assert_eq!(apart.spec().string("oiio:ColorSpace"), None);
    }

    #[test]
    fn a_named_space_replaces_what_the_file_says() {
        let window = Window { x: 0, y: 0, width: 1, height: 1 };
        let image = pattern(Pattern::Constant(vec![0.5]), &window, 3).unwrap();
        let image = image.with_attribute(crate::attribute("png:gAMA", "0.45455", None).unwrap());
        let image = image.in_space("ACEScg");
        assert_eq!(image.spec().string("oiio:ColorSpace"), Some("ACEScg"));
        assert!(image.spec().attributes.get("png:gAMA").is_none());
    }
}
