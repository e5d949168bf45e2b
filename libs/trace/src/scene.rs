//! The trees of all meshes of a tracer.

use crate::Hit;
use crate::layout::Box3;
use crate::moving::MovingTree;
use crate::probe::{Met, Probe, Scale};
use crate::single::Best;
use crate::still::StillTree;

/// The trees that rays traverse.
#[derive(Debug)]
pub(crate) struct Scene {
    pub(crate) still: StillTree,
    pub(crate) moving: MovingTree,
    /// The number of the first triangle of each mesh.
    pub(crate) first: Vec<u32>,
    pub(crate) scale: Scale,
    /// The box around everything, in the coordinates of the trees.
    pub(crate) bounds: Box3,
}

impl Scene {
    /// Returns the best hit of a ray in world space.
    pub(crate) fn best_hit(&self, probe: &Probe, best: &Best) -> Hit {
        if best.id == u32::MAX { Hit::MISS } else { self.hit(probe, &best.met, best.id) }
    }

    /// Converts a hit in the coordinates of the trees to one in world space.
    pub(crate) fn hit(&self, probe: &Probe, met: &Met, id: u32) -> Hit {
        let mesh = self.first.partition_point(|first| *first <= id) - 1;
        Hit {
            t: probe.distance(met.t),
            mesh: mesh as u32,
            triangle: id - self.first[mesh],
            b1: met.b1,
            b2: met.b2,
        }
    }
}
