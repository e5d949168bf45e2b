//! Skins at rest, in which joints determine the positions of the vertices of a mesh.

use super::accessor::Reader;
use super::document::{Document, Primitive, item};
use super::scene::{Matrix, times};
use std::ops::Range;

/// The largest number of sets of four joints per vertex that is read.
const MOST_SETS: usize = 4;

/// Returns the matrices from the space of the mesh, through each joint, to that of the file. `places` holds the
/// transformation of each node in the scene.
///
/// # Errors
/// Returns a text with the index of the skin.
pub(super) fn joints(
    document: &Document,
    skin: usize,
    places: &[Option<Matrix>],
    reader: &mut Reader<'_>,
) -> Result<Vec<Matrix>, String> {
    let Some(desc) = item(&document.skins, skin) else { return Err(format!("there is no skin {skin}")) };
    let count = desc.joints.len() as u64;
    let inverse = match desc.inverse_bind_matrices {
        Some(accessor) => {
            let read = reader.floats(accessor, &[16], 0..count);
            Some(read.map_err(|e| format!("skin {skin}: {e}"))?.0)
        }
        None => None,
    };
    let joint = |(i, node): (usize, &usize)| {
        let Some(place) = places.get(*node).copied().flatten() else {
            return Err(format!("skin {skin}: joint {node} is no node of the scene"));
        };
        Ok(match &inverse {
            Some(m) => {
                let bind = std::array::from_fn(|r| std::array::from_fn(|c| f64::from(m[16 * i + 4 * r + c])));
                times(&bind, &place)
            }
            None => place,
        })
    };
    desc.joints.iter().enumerate().map(joint).collect()
}

/// Returns the weighted mean of the matrices of its joints for each vertex of `range`; `None` where no joint has a
/// weight.
///
/// # Errors
/// Returns a text when joints or weights cannot be read.
pub(super) fn blend(
    primitive: &Primitive,
    joints: &[Matrix],
    range: &Range<u64>,
    reader: &mut Reader<'_>,
) -> Result<Vec<Option<Matrix>>, String> {
    let n = (range.end - range.start) as usize;
    let mut sums = vec![([[0.0; 4]; 4], 0.0); n];
    for set in 0..MOST_SETS {
        let attribute = |name: &str| primitive.attributes.get(&format!("{name}_{set}")).copied();
        let (Some(which), Some(weights)) = (attribute("JOINTS"), attribute("WEIGHTS")) else { break };
        let (which, _) = reader.floats(which, &[4], range.clone())?;
        let (weights, _) = reader.floats(weights, &[4], range.clone())?;
        for (i, (joint, weight)) in which.iter().zip(&weights).enumerate() {
            let weight = f64::from(*weight);
            // Joint indices are integers that are not negative, for any type.
            let Some(matrix) = joints.get(*joint as usize).filter(|_| weight > 0.0 && weight.is_finite())
            else {
                continue;
            };
            let (sum, total) = &mut sums[i / 4];
            for (to, from) in sum.iter_mut().flatten().zip(matrix.iter().flatten()) {
                *to += from * weight;
            }
            *total += weight;
        }
    }
    let mean =
        |(sum, total): ([[f64; 4]; 4], f64)| (total > 0.0).then(|| sum.map(|row| row.map(|x| x / total)));
    Ok(sums.into_iter().map(mean).collect())
}

/// Transforms a position.
pub(super) fn point(m: &Matrix, p: &mut [f32]) {
    let [x, y, z] = [f64::from(p[0]), f64::from(p[1]), f64::from(p[2])];
    for (j, to) in p.iter_mut().enumerate().take(3) {
        *to = (x * m[0][j] + y * m[1][j] + z * m[2][j] + m[3][j]) as f32;
    }
}

/// Transforms a normal by the cofactors of the matrix, which keep it perpendicular to the surface.
pub(super) fn normal(m: &Matrix, n: &mut [f32]) {
    let v = [f64::from(n[0]), f64::from(n[1]), f64::from(n[2])];
    let cofactor = |i: usize, j: usize| {
        let (a, b, c, d) = ((i + 1) % 3, (i + 2) % 3, (j + 1) % 3, (j + 2) % 3);
        m[a][c] * m[b][d] - m[a][d] * m[b][c]
    };
    let turned: [f64; 3] = std::array::from_fn(|j| (0..3).map(|i| v[i] * cofactor(i, j)).sum());
    let length = turned.iter().map(|x| x * x).sum::<f64>().sqrt();
    if length > 0.0 && length.is_finite() {
        for (to, x) in n.iter_mut().zip(turned) {
            *to = (x / length) as f32;
        }
    }
}
