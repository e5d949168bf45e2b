//! Checks that the values that shaders compute are finite and of a usable size.
//!
//! A colour that is not a number spoils every pixel that its filter reaches, and rays carry it from one object to
//! others. Colours are therefore checked where they leave shaders (surfaces of the camera's grids, hits of rays,
//! lights), replaced, and reported once with the name of the object or the light.

use granita_base::Color;
use granita_scene::{AttributeSet, attr};
use granita_shade::Lanes3;

/// The largest size of a component. Sums of as many values as a pixel has samples stay finite.
pub const LARGEST: f32 = 1.0e30;

/// Returns a colour in place of one that has a component that is not a number or is larger than [`LARGEST`]. That
/// component becomes 0. Returns `None` for all other colours.
pub fn mended(color: Color) -> Option<Color> {
    // The comparison is false for NaN too.
    if color.abs().cmple(Color::splat(LARGEST)).all() {
        return None;
    }
    Some(Color::from_array(color.to_array().map(|v| if v.abs() <= LARGEST { v } else { 0.0 })))
}

/// True when all values are numbers, and none is larger than [`LARGEST`].
pub fn all_usable(values: &[f32]) -> bool {
    // Without the sign, floats have the order of their bits, with NaN at the end. Compilers vectorise an integer
    // maximum.
    let largest = values.iter().fold(0_u32, |most, v| most.max(v.to_bits() & 0x7fff_ffff));
    largest <= LARGEST.to_bits()
}

/// Returns the description of an unusable value of this kind, for messages.
pub fn reason(what: &str) -> String {
    format!("a {what} that is not a number or is larger than {LARGEST:e}; 0 is used")
}

/// Returns the attribute "opacity", clamped to 0 to 1, with 1 in place of a component that is not a number.
pub fn opacity(attributes: &AttributeSet) -> Color {
    let given = given_opacity(attributes);
    Color::from_array(given.to_array().map(|v| if v.is_nan() { 1.0 } else { v.clamp(0.0, 1.0) }))
}

/// Clamps the opacities of a primitive variable to 0 to 1. Values that are not numbers stay, so that they are
/// reported.
pub fn clamp_opacity(lanes: &mut Lanes3) {
    lanes.xyz.iter_mut().flatten().for_each(|v| *v = v.clamp(0.0, 1.0));
}

/// Returns the attribute "opacity" as it was given.
pub fn given_opacity(attributes: &AttributeSet) -> Color {
    attributes.get(attr::OPACITY)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_that_are_not_finite_are_found_and_replaced() {
        assert_eq!(mended(Color::new(-LARGEST, 0.0, LARGEST)), None);
        let found = mended(Color::new(f32::NAN, 0.5, 2.0 * LARGEST));
        assert_eq!(found, Some(Color::new(0.0, 0.5, 0.0)));
        for bad in [f32::NAN, -f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1.1e30, -1.1e30] {
            let mut values = vec![0.25; 37];
            assert!(all_usable(&values));
            values[29] = bad;
            assert!(!all_usable(&values), "{bad}");
        }
        assert!(all_usable(&[]) && all_usable(&[LARGEST, -LARGEST, -0.0, 1e-40]));
    }
}
