//! Normals of meshes that have none, for files whose faces approximate smooth surfaces.

use granita_base::{ParamData, Params, ShapeDesc, Vec3};

/// The number of faces at a vertex up to which each is compared with each.
const MOST_COMPARED: usize = 64;

/// Returns the normals of the corners of a mesh, three numbers each. A corner takes the mean of the faces at its vertex
/// that are turned by at most `angle_rad` from its own face, weighted by their angles at the vertex. Returns `None` for
/// shapes that are not meshes of flat faces, and for those with normals.
pub(crate) fn normals(shape: &ShapeDesc, params: &Params, angle_rad: f32) -> Option<Vec<f32>> {
    let ShapeDesc::Mesh { subdivide: false, nverts, verts } = shape else { return None };
    let p = match &params.get("P")?.data {
        ParamData::Float(values) => values.as_chunks::<3>().0,
        _ => return None,
    };
    let exists = |v: &i32| usize::try_from(*v).is_ok_and(|v| v < p.len());
    if params.get("N").is_some() || !verts.iter().all(exists) {
        return None;
    }
    let at = |v: i32| Vec3::from(p[v as usize]);
    // Each corner has the normal of its face and a weight.
    let mut corners: Vec<(Vec3, f32)> = Vec::with_capacity(verts.len());
    for n in nverts.iter() {
        let face = verts.get(corners.len()..)?.get(..usize::try_from(*n).ok()?)?;
        let origin = at(*face.first()?);
        let normal: Vec3 =
            face.windows(2).skip(1).map(|w| (at(w[0]) - origin).cross(at(w[1]) - origin)).sum();
        let normal = normal.normalize_or_zero();
        let count = face.len();
        corners.extend((0..count).map(|i| {
            let (before, here, after) =
                (at(face[(i + count - 1) % count]), at(face[i]), at(face[(i + 1) % count]));
            let angle = (before - here).normalize_or_zero().dot((after - here).normalize_or_zero());
            (normal, libm::acosf(angle.clamp(-1.0, 1.0)))
        }));
    }
    if corners.len() != verts.len() {
        return None;
    }
    // The corners at each vertex, one vertex after the other.
    let mut starts = vec![0usize; p.len() + 1];
    verts.iter().for_each(|v| starts[*v as usize + 1] += 1);
    for i in 1..starts.len() {
        starts[i] += starts[i - 1];
    }
    let mut next = starts.clone();
    let mut around = vec![0u32; verts.len()];
    for (corner, v) in verts.iter().enumerate() {
        let slot = &mut next[*v as usize];
        around[*slot] = corner as u32;
        *slot += 1;
    }
    let mut sums = vec![Vec3::ZERO; p.len()];
    for (v, (normal, weight)) in verts.iter().zip(&corners) {
        sums[*v as usize] += *normal * *weight;
    }
    let least = libm::cosf(angle_rad) - 1.0e-6;
    let mut values = Vec::with_capacity(verts.len() * 3);
    for (corner, v) in verts.iter().enumerate() {
        let own = corners[corner].0;
        let all = &around[starts[*v as usize]..starts[*v as usize + 1]];
        let near = all.iter().map(|c| corners[*c as usize]).filter(|(n, _)| n.dot(own) >= least);
        let sum: Vec3 = match all.len() {
            0..=MOST_COMPARED => near.map(|(n, weight)| n * weight).sum(),
            _ => sums[*v as usize],
        };
        let mean = sum.normalize_or(own);
        let normal = if mean.dot(own) >= least { mean } else { own };
        values.extend(if normal == Vec3::ZERO { Vec3::Z } else { normal }.to_array());
    }
    Some(values)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::emit::positions;

    /// Returns two squares that meet at the edge from (0, 0, 0) to (0, 1, 0), the second one bent by an angle.
    fn bent(angle_deg: f32) -> (ShapeDesc, Params) {
        let (sin, cos) = angle_deg.to_radians().sin_cos();
        let p = [
            [0.0, 0.0, 0.0],
            [0.0, 1.0, 0.0],
            [-1.0, 1.0, 0.0],
            [-1.0, 0.0, 0.0],
            [cos, 0.0, sin],
            [cos, 1.0, sin],
        ];
        let (nverts, verts) = (vec![4, 4], vec![0, 1, 2, 3, 0, 4, 5, 1]);
        let shape = ShapeDesc::Mesh { subdivide: false, nverts: nverts.into(), verts: verts.into() };
        (shape, Params(vec![positions(p.as_flattened().to_vec())]))
    }

    #[test]
    fn edges_up_to_the_angle_are_smooth() {
        let limit = 40f32.to_radians();
        let normal = |values: &[f32], corner: usize| Vec3::from_slice(&values[3 * corner..]);
        let (shape, params) = bent(30.0);
        let values = normals(&shape, &params, limit).unwrap();
        assert!(normal(&values, 0).distance(normal(&values, 4)) < 1.0e-6);
        let half = 15f32.to_radians();
        assert!(normal(&values, 0).distance(Vec3::new(-half.sin(), 0.0, half.cos())) < 1.0e-5);
        assert!(normal(&values, 2).distance(Vec3::Z) < 1.0e-6);
        let (shape, params) = bent(60.0);
        let values = normals(&shape, &params, limit).unwrap();
        assert!(normal(&values, 0).distance(Vec3::Z) < 1.0e-6);
        assert!((normal(&values, 0).dot(normal(&values, 4)) - 0.5).abs() < 1.0e-5);
    }

    #[test]
    fn what_has_no_area_or_no_vertices_has_a_normal() {
        let p = positions(vec![0.0; 9]);
        for verts in [vec![0, 1, 2], vec![0, 7, 2], vec![0, 0, 0]] {
            let shape =
                ShapeDesc::Mesh { subdivide: false, nverts: vec![3].into(), verts: verts.clone().into() };
            let values = normals(&shape, &Params(vec![p.clone()]), 1.0);
            assert!(values.is_none_or(|v| v == [0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0]), "{verts:?}");
        }
        let short = ShapeDesc::Mesh { subdivide: false, nverts: vec![4].into(), verts: vec![0, 1, 2].into() };
        assert!(normals(&short, &Params(vec![p]), 1.0).is_none());
    }

    #[test]
    fn a_fan_of_many_faces_takes_time_in_proportion() {
        let n = 200_000;
        let point = |i: i32| {
            let (sin, cos) = (i as f32 * 1.0e-5).sin_cos();
            [cos, sin, 0.0]
        };
        let p: Vec<f32> = [[0.0; 3]].into_iter().chain((0..=n).map(point)).flatten().collect();
        let verts: Vec<i32> = (0..n).flat_map(|i| [0, i + 1, i + 2]).collect();
        let shape =
            ShapeDesc::Mesh { subdivide: false, nverts: vec![3; n as usize].into(), verts: verts.into() };
        let values = normals(&shape, &Params(vec![positions(p)]), 0.7).unwrap();
        assert_eq!(values.len(), n as usize * 9);
        assert!(Vec3::from_slice(&values).distance(Vec3::Z) < 1.0e-6);
    }
}
