//! Numbers that a picture can be made of: what shaders give is looked at here before it spreads.
//!
//! A colour that is no number spoils every pixel that its filter reaches, and a ray carries it from one object to others. So
//! colours are looked at where they leave shaders (surfaces of the camera's grids, hits of rays, lights), replaced, and
//! reported once with the name of the object or the light.

use granita_base::Color;
use granita_scene::{AttributeSet, attr};
use granita_shade::Lanes3;

/// The largest size of a component. Sums of so many as a pixel has stay finite.
pub(crate) const LARGEST: f32 = 1.0e30;

/// A colour in place of one that has a component that is no number or is larger than [`LARGEST`]: 0 in place of that
/// component. `None` for all others.
pub(crate) fn mended(color: Color) -> Option<Color> {
    // Not true of NaN either.
    if color.abs().cmple(Color::splat(LARGEST)).all() {
        return None;
    }
    Some(Color::from_array(color.to_array().map(|v| if v.abs() <= LARGEST { v } else { 0.0 })))
}

/// Whether all values are numbers, and none is larger than [`LARGEST`].
pub(crate) fn all_usable(values: &[f32]) -> bool {
    // Of floats without their sign the order is that of their bits, with NaN at the end. An integer maximum is made by wide
    // instructions.
    let largest = values.iter().fold(0_u32, |most, v| most.max(v.to_bits() & 0x7fff_ffff));
    largest <= LARGEST.to_bits()
}

/// What is wrong with a value of this kind, for messages.
pub(crate) fn reason(what: &str) -> String {
    format!("a {what} that is no number or is larger than {LARGEST:e}; 0 is used")
}

/// The attribute "opacity": from 0 to 1, and 1 in place of what is no number.
pub(crate) fn opacity(attributes: &AttributeSet) -> Color {
    let given = given_opacity(attributes);
    Color::from_array(given.to_array().map(|v| if v.is_nan() { 1.0 } else { v.clamp(0.0, 1.0) }))
}

/// Opacities of a primitive's own; what is no number stays to be reported.
pub(crate) fn clamp_opacity(lanes: &mut Lanes3) {
    lanes.xyz.iter_mut().flatten().for_each(|v| *v = v.clamp(0.0, 1.0));
}

/// The attribute "opacity" as it was given.
pub(crate) fn given_opacity(attributes: &AttributeSet) -> Color {
    attributes.get(attr::OPACITY)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_number_is_found_and_replaced() {
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
