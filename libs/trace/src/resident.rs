//! The triangles of a tracer, for a copy of its tree on another processor.

use crate::{Hit, Tracer};

/// The triangles of a tracer whose meshes do not move, in the coordinates of its tree.
///
/// A copy that tests rays as [`Tracer`] does, with these numbers, finds the same hits to the bit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Resident {
    /// The power of two by which the coordinates of the tree are those of the scene.
    pub factor: f32,
    /// The lower and the upper corner of the box of everything, which decides how boxes are enlarged.
    pub bounds: [[f32; 3]; 2],
    /// The vertices of the triangles.
    pub triangles: Vec<[[f32; 3]; 3]>,
    /// The numbers of the triangles among all triangles of the tracer. Of hits at one distance, that with the smallest
    /// number is the closest.
    pub numbers: Vec<u32>,
}

impl Tracer {
    /// Returns the triangles that can be hit; `None` when some of them move.
    pub fn resident(&self) -> Option<Resident> {
        let scene = &self.scene;
        if !scene.moving.is_empty() {
            return None;
        }
        let mut out = Resident {
            factor: scene.scale.factor(),
            bounds: [scene.bounds.lo, scene.bounds.hi],
            ..Resident::default()
        };
        for block in scene.still.blocks() {
            for (lane, number) in block.id.iter().enumerate().filter(|(_, number)| **number != u32::MAX) {
                out.triangles.push(block.vertices(lane));
                out.numbers.push(*number);
            }
        }
        Some(out)
    }

    /// Returns a hit on the triangle of this number, with its distance and its weights of the second and the third
    /// vertex; [`Hit::MISS`] when there is no such triangle.
    pub fn hit_of(&self, number: u32, t: f32, [b1, b2]: [f32; 2]) -> Hit {
        let Some(mesh) = self.scene.first.partition_point(|first| *first <= number).checked_sub(1) else {
            return Hit::MISS;
        };
        if number == u32::MAX {
            return Hit::MISS;
        }
        Hit { t, mesh: mesh as u32, triangle: number - self.scene.first[mesh], b1, b2 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{TracerBuilder, TriangleMesh};
    use granita_base::Vec3;

    fn mesh(times: &[f32]) -> TriangleMesh {
        let positions = vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::splat(f32::NAN)];
        TriangleMesh {
            times: times.to_vec(),
            positions: vec![positions; times.len()],
            triangles: vec![[0, 1, 3], [0, 1, 2]],
        }
    }

    #[test]
    fn resident_triangles_are_those_that_can_be_hit() {
        let mut builder = TracerBuilder::new();
        builder.add(mesh(&[0.0]));
        builder.add(mesh(&[0.0]));
        let tracer = builder.build(1);
        let resident = tracer.resident().unwrap();
        let mut numbers = resident.numbers.clone();
        numbers.sort_unstable();
        assert_eq!(numbers, [1, 3]);
        assert_eq!(
            resident.triangles[0],
            [[0.0; 3], [resident.factor, 0.0, 0.0], [0.0, resident.factor, 0.0]]
        );
        let hit = tracer.hit_of(3, 2.0, [0.25, 0.5]);
        assert_eq!((hit.mesh, hit.triangle, hit.t), (1, 1, 2.0));
        assert_eq!(tracer.hit_of(u32::MAX, 2.0, [0.0; 2]), Hit::MISS);
    }

    #[test]
    fn moving_triangles_are_not_resident() {
        let mut builder = TracerBuilder::new();
        builder.add(mesh(&[0.0, 1.0]));
        assert_eq!(builder.build(1).resident(), None);
        assert!(TracerBuilder::new().build(1).resident().unwrap().triangles.is_empty());
    }
}
