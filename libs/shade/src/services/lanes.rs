//! Values of the lanes of a batch.

use crate::Lanes3;
use granita_base::Vec3;

/// A float per lane, or one for all.
#[derive(Clone, Copy, Debug)]
pub struct Lane<'a> {
    /// The values; a single one when uniform.
    pub values: &'a [f32],
    /// 1 when there is a value per lane, 0 when uniform.
    pub stride: usize,
}

impl Lane<'_> {
    /// Returns the value of lane `i`.
    pub fn get(&self, i: usize) -> f32 {
        self.values[i * self.stride]
    }
}

/// A triple per lane, or one for all.
#[derive(Clone, Copy, Debug)]
pub struct Lane3<'a> {
    /// The lanes of x, y and z.
    pub xyz: [Lane<'a>; 3],
}

impl<'a> Lane3<'a> {
    /// Returns the value of lane `i`.
    pub fn get(&self, i: usize) -> Vec3 {
        Vec3::new(self.xyz[0].get(i), self.xyz[1].get(i), self.xyz[2].get(i))
    }

    /// Returns lanes over varying arrays.
    pub fn over(lanes: &'a Lanes3) -> Self {
        Self { xyz: std::array::from_fn(|c| Lane { values: &lanes.xyz[c], stride: 1 }) }
    }
}

/// The data that every batch call carries.
#[derive(Clone, Copy, Debug)]
pub struct Batch<'a> {
    /// The number of lanes of the grid.
    pub lanes: usize,
    /// The active lanes, increasing. Results go to these; others stay unchanged.
    pub active: &'a [u32],
    /// The layer of the running group, for "shader" space.
    pub layer: usize,
}
