//! The nodes of a scene and their transformations.

use super::document::{Document, Node, item};
use crate::faults::Faults;
use granita_base::{Bound, Transform, Vec3};

/// A matrix for row vectors, as everywhere in the suite. It has double precision because hierarchies may be deep.
pub(super) type Matrix = [[f64; 4]; 4];

pub(super) const IDENTITY: Matrix =
    [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];

/// A node, and the matrix from its space to that of the file.
pub(super) struct Placed<'a> {
    pub(super) index: usize,
    pub(super) node: &'a Node,
    pub(super) matrix: Matrix,
}

impl Placed<'_> {
    /// Returns the matrix row by row; `None` when it is not finite.
    pub(super) fn rows(&self) -> Option<[f32; 16]> {
        let mut rows = [0.0; 16];
        for (to, from) in rows.iter_mut().zip(self.matrix.iter().flatten()) {
            *to = *from as f32;
        }
        rows.iter().all(|x| x.is_finite()).then_some(rows)
    }

    /// Returns the matrix of a camera or a light, without scale. They look along -z in glTF and along z in the suite,
    /// so z is reversed. "x" stays on the right. Returns `None` when the matrix is not finite.
    pub(super) fn looking(&self) -> Option<[f32; 16]> {
        let mut rows = self.matrix;
        for (i, row) in rows.iter_mut().enumerate().take(3) {
            let length = row[..3].iter().map(|x| x * x).sum::<f64>().sqrt();
            let sign = if i == 2 { -1.0 } else { 1.0 };
            // Adding zero turns a negative zero into a positive one.
            row[..3].iter_mut().for_each(|x| *x = *x * sign / length + 0.0);
        }
        let turned = Placed { index: self.index, node: self.node, matrix: rows };
        turned.rows()
    }
}

/// Returns the nodes of the scene that is shown, parents before children.
pub(super) fn nodes<'a>(document: &'a Document, faults: &mut Faults<'_>) -> Vec<Placed<'a>> {
    let roots = match document.scene.or((!document.scenes.is_empty()).then_some(0)) {
        Some(scene) => match item(&document.scenes, scene) {
            Some(scene) => scene.nodes.clone(),
            None => {
                faults.error("scene", 0, || format!("there is no scene {scene}: all nodes are taken"));
                roots(document)
            }
        },
        None => roots(document),
    };
    let mut seen = vec![false; document.nodes.len()];
    let mut waiting: Vec<(usize, Matrix)> = roots.into_iter().rev().map(|n| (n, IDENTITY)).collect();
    let mut all = Vec::new();
    while let Some((index, parent)) = waiting.pop() {
        let Some(node) = item(&document.nodes, index) else {
            faults.error("node", 0, || format!("there is no node {index}: left out"));
            continue;
        };
        if std::mem::replace(&mut seen[index], true) {
            faults.error("node twice", 0, || format!("node {index} hangs on more than one node: taken once"));
            continue;
        }
        let matrix = times(&local(node), &parent);
        waiting.extend(node.children.iter().rev().map(|child| (*child, matrix)));
        all.push(Placed { index, node, matrix });
    }
    all
}

/// Returns the indices of the nodes without a parent.
fn roots(document: &Document) -> Vec<usize> {
    let mut child = vec![false; document.nodes.len()];
    for node in document.nodes.iter().flatten() {
        for c in &node.children {
            if let Some(slot) = child.get_mut(*c) {
                *slot = true;
            }
        }
    }
    (0..child.len()).filter(|i| !child[*i]).collect()
}

/// Returns the matrix from the space of a node to that of its parent.
fn local(node: &Node) -> Matrix {
    if let Some(m) = node.matrix {
        // The columns of a matrix for column vectors are the rows of one for row vectors.
        return std::array::from_fn(|i| std::array::from_fn(|j| m[4 * i + j]));
    }
    let t = node.translation.unwrap_or([0.0; 3]);
    let s = node.scale.unwrap_or([1.0; 3]);
    let [x, y, z, w] = node.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]);
    let length = (x * x + y * y + z * z + w * w).sqrt();
    let [x, y, z, w] = if length > 0.0 { [x, y, z, w].map(|q| q / length) } else { [0.0, 0.0, 0.0, 1.0] };
    let axes = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + z * w), 2.0 * (x * z - y * w)],
        [2.0 * (x * y - z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + x * w)],
        [2.0 * (x * z + y * w), 2.0 * (y * z - x * w), 1.0 - 2.0 * (x * x + y * y)],
    ];
    let mut m = IDENTITY;
    for i in 0..3 {
        for j in 0..3 {
            m[i][j] = axes[i][j] * s[i];
        }
    }
    m[3] = [t[0], t[1], t[2], 1.0];
    m
}

/// Returns the product of two matrices, which applies `a` first and then `b`.
pub(super) fn times(a: &Matrix, b: &Matrix) -> Matrix {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..4).map(|k| a[i][k] * b[k][j]).sum()))
}

/// Returns the bounding box of all meshes, from the ranges of their accessors. Returns `None` when a range is missing,
/// or when the file contains more than meshes of triangles, because lights must be made at once, and lines and points
/// have widths.
pub(super) fn bound(document: &Document, nodes: &[Placed<'_>]) -> Option<[f32; 6]> {
    let mut all = Bound::EMPTY;
    for placed in nodes {
        let node = placed.node;
        if node.light().is_some() || node.camera.is_some() || node.skin.is_some() || !node.weights.is_empty()
        {
            return None;
        }
        let Some(mesh) = node.mesh.and_then(|m| item(&document.meshes, m)) else { continue };
        if !mesh.weights.is_empty() {
            return None;
        }
        let matrix = Transform::from_rows(&placed.rows()?);
        for primitive in &mesh.primitives {
            if !matches!(primitive.mode.unwrap_or(4), 4..=6) {
                return None;
            }
            let accessor = item(&document.accessors, *primitive.attributes.get("POSITION")?)?;
            let corner = |v: &[f64]| match v {
                [x, y, z] => Some(Vec3::new(*x as f32, *y as f32, *z as f32)).filter(|p| p.is_finite()),
                _ => None,
            };
            // The ranges of normalised integers are those of the stored values.
            if accessor.normalized {
                return None;
            }
            let own = Bound::around([corner(&accessor.min)?, corner(&accessor.max)?]);
            all = all.union(own.transformed(&matrix));
        }
    }
    // The points themselves will be transformed in another order, with other rounding.
    let all = all.padded(all.size().max_element() * 1.0e-5);
    let (min, max) = (all.min, all.max);
    all.is_finite().then_some([min.x, max.x, min.y, max.y, min.z, max.z])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scale_then_rotation_then_translation() {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let node = Node {
            translation: Some([10.0, 0.0, 0.0]),
            rotation: Some([0.0, 0.0, half, half]),
            scale: Some([2.0, 3.0, 4.0]),
            ..Node::default()
        };
        let m = local(&node);
        // A quarter turn about z maps x to y.
        let near = |a: [f64; 4], b: [f64; 4]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12);
        assert!(near(m[0], [0.0, 2.0, 0.0, 0.0]) && near(m[1], [-3.0, 0.0, 0.0, 0.0]), "{m:?}");
        assert!(near(m[2], [0.0, 0.0, 4.0, 0.0]) && near(m[3], [10.0, 0.0, 0.0, 1.0]));
        let placed = Placed { index: 0, node: &node, matrix: m };
        let looking = placed.looking().unwrap();
        assert!((looking[1] - 1.0).abs() < 1e-6 && (looking[10] + 1.0).abs() < 1e-6, "{looking:?}");
    }
}
