//! Axis-aligned boxes.

use crate::Transform;
use glam::Vec3;

/// An axis-aligned box; empty when `min > max` in any axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bound {
    /// The lower corner.
    pub min: Vec3,
    /// The upper corner.
    pub max: Vec3,
}

impl Default for Bound {
    fn default() -> Self {
        Self::EMPTY
    }
}

impl Bound {
    /// The empty box, which is the neutral element of [`Bound::union`].
    pub const EMPTY: Self = Self { min: Vec3::INFINITY, max: Vec3::NEG_INFINITY };

    /// Returns the smallest box around `points`. Points that are not finite make the box not finite.
    pub fn around(points: impl IntoIterator<Item = Vec3>) -> Self {
        points.into_iter().fold(Self::EMPTY, |b, p| b.with(p))
    }

    /// Returns the box of `xmin xmax ymin ymax zmin zmax`, the order of the scene interface.
    pub fn from_extents(b: &[f32; 6]) -> Self {
        Self { min: Vec3::new(b[0], b[2], b[4]), max: Vec3::new(b[1], b[3], b[5]) }
    }

    /// Returns the box enlarged to contain `p`.
    pub fn with(self, p: Vec3) -> Self {
        Self { min: self.min.min(p), max: self.max.max(p) }
    }

    /// Returns the smallest box around both.
    pub fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// True when the box contains nothing.
    pub fn is_empty(&self) -> bool {
        !(self.min.cmple(self.max).all())
    }

    /// True when the box is not empty and all its corners are finite.
    pub fn is_finite(&self) -> bool {
        self.min.is_finite() && self.max.is_finite()
    }

    /// Returns the box grown by `r` on every side. An empty box stays empty.
    pub fn padded(self, r: f32) -> Self {
        if self.is_empty() { self } else { Self { min: self.min - r, max: self.max + r } }
    }

    /// Returns the eight corners, x fastest.
    pub fn corners(&self) -> [Vec3; 8] {
        std::array::from_fn(|i| {
            let pick = |axis: usize| if i >> axis & 1 == 0 { self.min[axis] } else { self.max[axis] };
            Vec3::new(pick(0), pick(1), pick(2))
        })
    }

    /// Returns the box around the transformed corners. An empty box stays empty.
    pub fn transformed(&self, m: &Transform) -> Self {
        if self.is_empty() { *self } else { Self::around(self.corners().map(|c| m.point(c))) }
    }

    /// Returns the middle of the box.
    pub fn center(&self) -> Vec3 {
        (self.min + self.max) * 0.5
    }

    /// Returns the lengths of the edges.
    pub fn size(&self) -> Vec3 {
        self.max - self.min
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_empty_bound_stays_empty_until_a_point_is_added() {
        assert!(Bound::EMPTY.is_empty());
        assert!(Bound::EMPTY.padded(3.0).is_empty());
        assert!(Bound::EMPTY.transformed(&Transform::IDENTITY).is_empty());
        let b = Bound::EMPTY.with(Vec3::ONE);
        assert!(!b.is_empty() && b.size() == Vec3::ZERO);
    }

    #[test]
    fn a_transformed_bound_contains_all_corners() {
        let b = Bound::around([Vec3::ZERO, Vec3::ONE]);
        let m = Transform::rotate(0.5, Vec3::Z);
        let t = b.transformed(&m);
        for c in b.corners() {
            let p = m.point(c);
            assert!(p.cmpge(t.min - 1e-6).all() && p.cmple(t.max + 1e-6).all());
        }
    }
}
