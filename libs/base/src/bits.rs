//! The numbers of types in the C++ interface: `ParamType` of `paramtype.h` (reference appendix A).

use crate::{BaseType, Interp, ParamType};

/// The types that have a number, with the number. Other numbers exist, which no parameter uses.
const NUMBERS: [(BaseType, u32); 9] = [
    (BaseType::String, 2),
    (BaseType::Float, 3),
    (BaseType::Point, 6),
    (BaseType::Vector, 7),
    (BaseType::Normal, 8),
    (BaseType::Color, 9),
    (BaseType::HPoint, 10),
    (BaseType::Matrix, 11),
    (BaseType::Int, 16),
];

/// The interpolations in the order of their numbers.
const INTERPS: [Interp; 4] = [Interp::Constant, Interp::PerPiece, Interp::Linear, Interp::Vertex];

impl BaseType {
    /// Returns its number as a `ParamBaseType`; 0 for [`BaseType::Unknown`].
    pub fn number(self) -> u32 {
        NUMBERS.iter().find(|(base, _)| *base == self).map_or(0, |(_, number)| *number)
    }

    /// Returns the type of a number; `None` for types that do not occur in scenes.
    pub fn from_number(number: u32) -> Option<Self> {
        NUMBERS.iter().find(|(_, n)| *n == number).map(|(base, _)| *base)
    }
}

impl ParamType {
    /// Returns the bits of a `ParamType`, whose fields begin at the low bits: 5 of the base type, 18 of the length,
    /// one for an array, 3 of the interpolation. Longer arrays lose the higher bits of their length.
    pub fn to_bits(self) -> u32 {
        let interp = INTERPS.iter().position(|i| *i == self.interp).unwrap_or(0) as u32;
        let length = self.array.unwrap_or(1) & 0x3_ffff;
        self.base.number() | length << 5 | u32::from(self.array.is_some()) << 23 | interp << 24
    }

    /// Returns the type of the bits of a `ParamType`.
    ///
    /// # Errors
    /// Returns a message when the base type or the interpolation does not occur in scenes.
    pub fn from_bits(bits: u32) -> Result<Self, String> {
        let base = BaseType::from_number(bits & 31)
            .ok_or_else(|| format!("type number {} is not a type of scene values", bits & 31))?;
        let number = bits >> 24 & 7;
        let interp = *INTERPS
            .get(number as usize)
            .ok_or_else(|| format!("there is no interpolation of number {number}"))?;
        let array = (bits >> 23 & 1 == 1).then_some(bits >> 5 & 0x3_ffff);
        Ok(Self { base, array, interp })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameter_types_have_the_bits_of_the_header() {
        // The types are a point for each vertex, and four floats.
        let point = ParamType::of(BaseType::Point).with_interp(Interp::Vertex);
        assert_eq!(ParamType::from_bits(6 | 1 << 5 | 3 << 24).unwrap(), point);
        let array = ParamType::array(BaseType::Float, 4);
        assert_eq!(ParamType::from_bits(3 | 4 << 5 | 1 << 23).unwrap(), array);
        for (base, number) in NUMBERS {
            for interp in INTERPS {
                for ty in [ParamType::of(base), ParamType::array(base, 77)] {
                    let ty = ty.with_interp(interp);
                    assert_eq!(ParamType::from_bits(ty.to_bits()), Ok(ty));
                }
            }
            assert_eq!(BaseType::from_number(number), Some(base));
        }
        assert!(ParamType::from_bits(1 | 1 << 5).is_err());
        assert!(ParamType::from_bits(3 | 1 << 5 | 5 << 24).is_err());
        assert_eq!(BaseType::Unknown.number(), 0);
    }
}
