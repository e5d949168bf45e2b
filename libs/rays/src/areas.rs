//! Selection of triangles of a set in proportion to their areas.

use granita_base::Vec3;

/// The triangles of a set with the running sum of their areas.
#[derive(Debug, Default)]
pub(crate) struct AreaTable {
    /// The sum of the areas up to and including each triangle, in square world units; increasing.
    sums: Vec<f64>,
    /// The part of the set and the triangle in it.
    places: Vec<(u32, u32)>,
}

impl AreaTable {
    /// Adds a triangle of a part. A triangle without an area is left out.
    pub(crate) fn push(&mut self, part: u32, triangle: u32, area: f32) {
        if area.is_finite() && area > 0.0 {
            self.sums.push(self.sums.last().unwrap_or(&0.0) + f64::from(area));
            self.places.push((part, triangle));
        }
    }

    /// Returns the part and the triangle at a fraction (0 to 1) of the whole area, and the fraction of the triangle's
    /// own area there; `None` when there is no area.
    pub(crate) fn at(&self, fraction: f32) -> Option<(u32, u32, f32)> {
        let whole = *self.sums.last()?;
        let wanted = f64::from(fraction) * whole;
        let k = self.sums.partition_point(|s| *s <= wanted).min(self.places.len() - 1);
        let before = if k > 0 { self.sums[k - 1] } else { 0.0 };
        let within = ((wanted - before) / (self.sums[k] - before)).clamp(0.0, 1.0);
        let (part, triangle) = self.places[k];
        Some((part, triangle, within as f32))
    }
}

/// Returns the area of a triangle.
pub(crate) fn area(a: Vec3, b: Vec3, c: Vec3) -> f32 {
    0.5 * (b - a).cross(c - a).length()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn triangles_are_chosen_by_area() {
        let mut table = AreaTable::default();
        for (part, triangle, area) in [(0, 0, 1.0), (0, 1, 0.0), (1, 0, 3.0), (2, 5, f32::NAN)] {
            table.push(part, triangle, area);
        }
        assert_eq!(table.at(0.0), Some((0, 0, 0.0)));
        assert_eq!(table.at(0.125), Some((0, 0, 0.5)));
        assert_eq!(table.at(0.25), Some((1, 0, 0.0)));
        assert_eq!(table.at(0.625), Some((1, 0, 0.5)));
        assert_eq!(table.at(1.0), Some((1, 0, 1.0)));
        assert_eq!(AreaTable::default().at(0.5), None);
        assert_eq!(area(Vec3::ZERO, Vec3::X * 2.0, Vec3::Y), 1.0);
    }
}
