//! Batches small grids into one, so that work that is done once per grid is done once for all of them.

use crate::{Grid, Lanes3, Primvar, PrimvarData, Rect, Topology, Uneven};
use granita_base::hash;
use std::sync::Arc;

impl Grid {
    /// True when this grid and another can be [batched](Self::batched). Both must be rectangles of points of one
    /// object, seen in the same way, with the same primitive variables, of which strings are equal.
    pub fn may_batch(&self, other: &Self) -> bool {
        let alike = |a: &Primvar, b: &Primvar| {
            a.name == b.name
                && a.ty == b.ty
                && match (&a.data, &b.data) {
                    (PrimvarData::Strings(a), PrimvarData::Strings(b)) => a == b,
                    (PrimvarData::Floats { .. }, PrimvarData::Floats { .. }) => true,
                    _ => false,
                }
        };
        let times = |g: &Self| [g.time, g.dtime].map(f32::to_bits);
        let is_fresh = |g: &Self| {
            matches!(g.topology, Topology::Rect { .. })
                && g.names.is_empty()
                && g.messages.is_empty()
                && g.parent.is_empty()
        };
        [self, other].into_iter().all(is_fresh)
            && times(self) == times(other)
            && (self.ray, self.flip_normals) == (other.ray, other.flip_normals)
            && self.object == other.object
            && self.primvars.len() == other.primvars.len()
            && self.primvars.iter().zip(&other.primvars).all(|(a, b)| alike(a, b))
    }

    /// Batches grids that [match](Self::may_batch) the first of them. The points follow each other, rectangle by
    /// rectangle.
    ///
    /// The results do not depend on which grids are batched, as long as no shader [reads grids as a
    /// whole](crate::Group::is_gridwise). Random numbers follow from [names](Self::names) that come from the seed
    /// of each grid. Primitive variables have one value for each point, also where a grid had one for all.
    ///
    /// # Panics
    ///
    /// Panics without any grid.
    pub fn batched(grids: &[Self]) -> Self {
        let first = &grids[0];
        let mut rects = Vec::with_capacity(grids.len());
        let mut n = 0;
        for rect in grids.iter().flat_map(|g| g.topology.rects()) {
            rects.push(Rect { first: n, ..rect });
            n += rect.lanes().len();
        }
        let floats = |of: &dyn Fn(&Self) -> &Vec<f32>| -> Vec<f32> {
            let mut all = Vec::with_capacity(n);
            grids.iter().for_each(|g| all.extend_from_slice(of(g)));
            all
        };
        let lanes = |of: &dyn Fn(&Self) -> &Lanes3| Lanes3 {
            xyz: std::array::from_fn(|c| floats(&|g: &Self| &of(g).xyz[c])),
        };
        let starts = || grids.iter().zip(&rects);
        let uneven = starts()
            .flat_map(|(g, rect)| g.uneven.iter().map(|u| Uneven { lane: u.lane + rect.first as u32, ..*u }));
        let name = |g: &Self, lane: usize| hash::words(&[g.seed, lane as u32]);
        Self {
            topology: match rects[..] {
                [Rect { nu, nv, .. }] => Topology::Rect { nu, nv },
                _ => Topology::Rects(Arc::from(&rects[..])),
            },
            uneven: uneven.collect(),
            p: lanes(&|g| &g.p),
            n: lanes(&|g| &g.n),
            ng: lanes(&|g| &g.ng),
            i: lanes(&|g| &g.i),
            dpdu: lanes(&|g| &g.dpdu),
            dpdv: lanes(&|g| &g.dpdv),
            dpdtime: lanes(&|g| &g.dpdtime),
            seams: grids.iter().map(|g| g.seams.first().copied().unwrap_or_default()).collect(),
            lift: grids.iter().any(|g| g.lift.is_some()).then(|| Arc::new(joined_lift(grids, n))),
            u: floats(&|g| &g.u),
            v: floats(&|g| &g.v),
            time: first.time,
            dtime: first.dtime,
            c: lanes(&|g| &g.c),
            opacity: lanes(&|g| &g.opacity),
            primvars: (0..first.primvars.len()).map(|k| joined_primvar(grids, k, n)).collect(),
            flip_normals: first.flip_normals,
            seed: first.seed,
            names: grids.iter().flat_map(|g| (0..g.len()).map(move |lane| name(g, lane))).collect(),
            primitives: grids.iter().flat_map(|g| g.primitives.iter().copied()).collect(),
            ray: first.ray,
            paths: Arc::default(),
            object: first.object.clone(),
            messages: Vec::new(),
            parent: Vec::new(),
        }
    }
}

/// Returns [`Grid::lift`] of all grids for their `n` points, zero for grids without it.
fn joined_lift(grids: &[Grid], n: usize) -> [Lanes3; 2] {
    std::array::from_fn(|side| Lanes3 {
        xyz: std::array::from_fn(|c| {
            let mut all = Vec::with_capacity(n);
            for grid in grids {
                match &grid.lift {
                    Some(lift) => all.extend_from_slice(&lift[side].xyz[c]),
                    None => all.resize(all.len() + grid.len(), 0.0),
                }
            }
            all
        }),
    })
}

/// Returns a primitive variable of all grids, with one value for each of their `n` points.
fn joined_primvar(grids: &[Grid], k: usize, n: usize) -> Primvar {
    let first = &grids[0].primvars[k];
    let data = match &first.data {
        PrimvarData::Strings(list) => PrimvarData::Strings(list.clone()),
        PrimvarData::Floats { .. } => {
            let width = first.ty.width();
            let mut all = Vec::with_capacity(width * n);
            for c in 0..width {
                for grid in grids {
                    let PrimvarData::Floats { values, varying } = &grid.primvars[k].data else { continue };
                    let points = grid.len();
                    match varying {
                        true => all.extend_from_slice(&values[c * points..][..points]),
                        false => all.extend(std::iter::repeat_n(values[c], points)),
                    }
                }
            }
            PrimvarData::Floats { values: all, varying: true }
        }
    };
    Primvar { name: first.name.clone(), ty: first.ty, data }
}
