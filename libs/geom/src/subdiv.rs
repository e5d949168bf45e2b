//! Catmull-Clark surfaces (reference 2.8.2, interpolation "catmull-clark").
//!
//! The cage is refined, then every quadrilateral becomes a bicubic Bezier patch. The patch is exactly the surface
//! where each vertex has four faces. Beside other vertices it is an approximation that passes through the limit
//! positions of all vertices (Loop and Schaefer, "Approximating Catmull-Clark Subdivision Surfaces with Bicubic
//! Patches", ACM Transactions on Graphics 27(1), 2008). The Bezier vertices of common edges are computed once, so
//! that adjacent patches agree to the bit. A face of the cage is one part with all its patches as segments.

use crate::GeomError;
use crate::cage::{Cage, Corner, Creases};
use crate::key::ShapeKey;
use crate::mesh::{CALL, Face, Faces, LATTICE, check};
use crate::net::{Net, Seam, cross, net_bound, pieces};
use crate::order::spatial_order;
use crate::range::{Place, Range};
use crate::surface::Piece;
use crate::vars::{Report, Vars};
use granita_base::{Bound, Params, Severity, Vec3};
use std::sync::Arc;

/// The largest number of refined faces.
const MOST_FACES: u64 = 1 << 26;

/// The sharpness from which on edges and vertices are sharp at every step.
const ALWAYS_SHARP: f32 = 10.0;

/// A quadrilateral of the cage, or one of the quadrilaterals into which another face is divided.
#[derive(Clone, Debug)]
struct Root {
    /// The index of the face as declared.
    face: u32,
    /// The first corner of the face in the declared list.
    first: u32,
    /// The number of corners of the face.
    n: u32,
    /// The index of the corner, for faces that are not quadrilaterals.
    corner: u32,
    /// The index of the first of its refined faces.
    refined: u32,
    /// The number of times that it was halved.
    levels: u32,
    /// For each side: true when the face beside it is not a quadrilateral, so that parts of that face have a corner
    /// in the middle of the side.
    halved: [bool; 4],
}

struct Subdivision {
    times: Vec<f32>,
    channels: usize,
    vars: Vars,
    roots: Vec<Root>,
    /// The Bezier vertices at refined vertices, along edges (two each, at each end), and at corners of faces.
    at_vertices: Vec<f32>,
    at_edges: Vec<f32>,
    at_corners: Vec<f32>,
    cage: Cage,
    /// True when all patches join smoothly.
    regular: bool,
    /// The bounds for each root and key.
    bounds: Vec<Bound>,
}

/// Builds the pieces of a subdivided mesh.
pub(crate) fn build(
    keys: &[ShapeKey<'_>],
    nverts: &[i32],
    verts: &Arc<[i32]>,
    report: Report<'_>,
) -> Result<Vec<Piece>, GeomError> {
    let Faces { faces, verts, control, vars, holes } = check(keys, nverts, verts, report)?;
    let border = keys[0].params.int("border").unwrap_or(0);
    if !(0..=2).contains(&border) {
        report(Severity::Warning, format!("{CALL}: \"border\" is {border}, it can be 0, 1 or 2; 0 is used"));
    }
    let (starts, corners) = corners_of(&faces, &verts)?;
    if corners.is_empty() {
        return Ok(Vec::new());
    }
    let mut cage = Cage::new(control.channels, control.values, starts, corners, border == 1);
    tell_of_folds(&cage, report);
    let borders = cage.kinds();
    let creases = creases(keys[0].params, report);
    let [edges, vertices] = cage.crease(&creases);
    if edges + vertices > 0 {
        let text =
            format!("{CALL}: {edges} creased edges and {vertices} corners that the mesh does not have");
        report(Severity::Warning, text);
    }
    let kinds = cage.kinds();
    // The usual rules do not define faces at a border.
    let all_borders = border == 1 || border == 2;
    let is_drawn = |index: &usize| {
        let inside =
            || cage.corners[cage.face(*index)].iter().all(|&v| borders[v as usize] == Corner::Smooth);
        holes.binary_search(&faces[*index].index).is_err() && (all_borders || inside())
    };
    let drawn: Vec<usize> = (0..faces.len()).filter(is_drawn).collect();
    let passing = cage.passing_sharpness() > 0.0;
    let levels = match cage.corners.len() {
        _ if !passing && cage.is_regular(&kinds, drawn.iter().copied()) => 0,
        0..=16_000 => 3,
        16_001..=200_000 => 2,
        _ => 1,
    };
    let mut roots = Vec::new();
    drawn.iter().for_each(|&index| add_roots(&faces[index], index, &cage, levels, &mut roots));
    for _ in 0..levels {
        cage = cage.refined();
    }
    let times = keys.iter().map(|k| k.time).collect();
    let mut surface = Subdivision {
        times,
        channels: cage.channels,
        vars,
        roots,
        at_vertices: Vec::new(),
        at_edges: Vec::new(),
        at_corners: Vec::new(),
        cage,
        regular: levels == 0,
        bounds: Vec::new(),
    };
    surface.find_bezier_vertices();
    surface.find_bounds();
    let n = surface.roots.len();
    Ok(pieces(Box::new(surface), n))
}

/// Returns the indices at which the corners of each face start, and one more, and the vertex at each corner.
///
/// # Errors
/// Returns an error when there are too many corners.
fn corners_of(faces: &[Face], verts: &[i32]) -> Result<(Vec<u32>, Vec<u32>), GeomError> {
    let mut starts = vec![0_u32];
    let mut corners = Vec::new();
    for face in faces {
        corners.extend(verts[face.corners.clone()].iter().map(|&v| v as u32));
        // Refined vertices and faces are also counted by 32 bits.
        if corners.len() as u64 * 4 > MOST_FACES {
            let asked = verts.len() as u64;
            return Err(GeomError::Limit { call: CALL, what: "corners", asked, max: MOST_FACES / 4 });
        }
        starts.push(corners.len() as u32);
    }
    Ok((starts, corners))
}

/// Appends the quadrilaterals of a face of the cage, which is refined `levels` times. `index` is the index of the face
/// in the cage.
fn add_roots(face: &Face, index: usize, cage: &Cage, levels: u32, roots: &mut Vec<Root>) {
    let (n, start) = (face.corners.len() as u32, cage.starts[index]);
    let halved = |k: usize| {
        let edge = &cage.edges[cage.corner_edges[start as usize + k] as usize];
        edge.faces.iter().any(|&f| cage.face(f as usize).len() != 4)
    };
    let root = |corner: u32, refined: u32, levels: u32| Root {
        face: face.index,
        first: face.corners.start as u32,
        n,
        corner,
        refined,
        levels,
        // The sides are those at the start and end of v, then of u. The corners are in winding order.
        halved: if n == 4 { [0, 2, 3, 1].map(halved) } else { [false; 4] },
    };
    match (n, levels) {
        (4, 0) => roots.push(root(0, index as u32, 0)),
        (4, _) => roots.push(root(0, start << (2 * (levels - 1)), levels)),
        _ => roots.extend((0..n).map(|i| root(i, (start + i) << (2 * (levels - 1)), levels - 1))),
    }
}

/// Returns the sharp edges and vertices of the parameters "creaselengths", "creaseindices" and "creasesharpnesses"
/// (chains of vertices with one sharpness for each chain or each edge), and "cornerindices" and "cornersharpnesses".
fn creases(params: &Params, report: Report<'_>) -> Creases {
    let ints = |name: &str| params.get(name).and_then(|p| p.data.to_ints()).unwrap_or_default();
    let floats = |name: &str| params.get(name).and_then(|p| p.data.to_floats()).unwrap_or_default();
    let (lengths, indices, sharp) =
        (ints("creaselengths"), ints("creaseindices"), floats("creasesharpnesses"));
    let usable = |s: f32| match s {
        s if s >= ALWAYS_SHARP => f32::INFINITY,
        s if s > 0.0 => s,
        _ => 0.0,
    };
    let vertex = |v: i32| u32::try_from(v).unwrap_or(u32::MAX);
    let mut creases = Creases::default();
    let total: i64 = lengths.iter().map(|n| i64::from((*n).max(0))).sum();
    let edges: i64 = lengths.iter().map(|n| (i64::from(*n) - 1).max(0)).sum();
    let each = sharp.len() == lengths.len();
    if total != indices.len() as i64 || !(each || sharp.len() as i64 == edges) {
        let text = format!(
            "{CALL}: {} creases of {total} vertices, but {} indices and {} sharpnesses: they are ignored",
            lengths.len(),
            indices.len(),
            sharp.len()
        );
        report(Severity::Warning, text);
    } else {
        let (mut rest, mut next) = (&indices[..], 0);
        for (k, n) in lengths.iter().enumerate() {
            let (chain, behind) = rest.split_at((*n).max(0) as usize);
            rest = behind;
            for pair in chain.windows(2) {
                let s = sharp[if each { k } else { next }];
                creases.edges.push(([vertex(pair[0]), vertex(pair[1])], usable(s)));
                next += 1;
            }
        }
    }
    let (corners, sharp) = (ints("cornerindices"), floats("cornersharpnesses"));
    if corners.len() == sharp.len() {
        creases.vertices = corners.iter().zip(sharp.iter()).map(|(v, s)| (vertex(*v), usable(*s))).collect();
    } else {
        let text =
            format!("{CALL}: {} corners, but {} sharpnesses: they are ignored", corners.len(), sharp.len());
        report(Severity::Warning, text);
    }
    creases
}

/// Reports edges of a cage with more than two faces. The surface is creased there.
fn tell_of_folds(cage: &Cage, report: Report<'_>) {
    let mut folds = cage.edges.iter().filter(|edge| edge.count > 2);
    if let Some(first) = folds.next() {
        let (count, [a, b]) = (folds.count() + 1, first.ends);
        let text = format!(
            "{CALL}: {count} edges with more than two faces are sharp, the first is between vertices {a} and {b} with {}",
            first.count
        );
        report(Severity::Warning, text);
    }
}

impl Subdivision {
    /// Computes the Bezier vertices of all patches.
    fn find_bezier_vertices(&mut self) {
        let (cage, c) = (&self.cage, self.channels);
        let kinds = cage.kinds();
        let mut at_corners = vec![0.0_f32; cage.corners.len() * c];
        for (k, out) in at_corners.chunks_exact_mut(c).enumerate() {
            let (first, i) = (k / 4 * 4, k % 4);
            let [v, next, opposite, before] = [0, 1, 2, 3].map(|step| cage.corners[first + (i + step) % 4]);
            let faces = cage.corners_at(v).len() as f64;
            // On borders and creases the surface is treated as if it continued beyond them.
            let n = match kinds[v as usize] {
                Corner::Smooth => faces,
                Corner::Crease(_) => (2.0 * cage.sector(k as u32) as f64).max(4.0),
                Corner::Sharp => 4.0,
            };
            let [v, next, opposite, before] = [v, next, opposite, before].map(|v| cage.point(v));
            for (x, out) in out.iter_mut().enumerate() {
                let sum = n * v[x] + 2.0 * (next[x] + before[x]) + opposite[x];
                *out = (sum / (n + 5.0)) as f32;
            }
        }
        let corner_of = |face: u32, vertex: u32| {
            let first = face as usize * 4;
            (first..first + 4).find(|&k| cage.corners[k] == vertex).unwrap_or(first)
        };
        let mut at_edges = vec![0.0_f32; cage.edges.len() * 2 * c];
        for (k, out) in at_edges.chunks_exact_mut(c).enumerate() {
            let edge = &cage.edges[k / 2];
            let (v, other) = (edge.ends[k % 2], edge.ends[1 - k % 2]);
            if edge.is_sharp() {
                let (v, other) = (cage.point(v), cage.point(other));
                (0..c).for_each(|x| out[x] = ((2.0 * v[x] + other[x]) / 3.0) as f32);
            } else {
                let [a, b] = edge.faces.map(|f| &at_corners[corner_of(f, v) * c..][..c]);
                (0..c).for_each(|x| out[x] = 0.5 * (a[x] + b[x]));
            }
        }
        self.flatten_edges(&kinds, &mut at_edges);
        self.flatten_sectors(&kinds, &mut at_edges);
        let (cage, c) = (&self.cage, self.channels);
        let mut at_vertices = vec![0.0_f32; cage.vertices() * c];
        for (v, out) in at_vertices.chunks_exact_mut(c).enumerate() {
            let (p, corners) = (cage.point(v as u32), cage.corners_at(v as u32));
            match kinds[v] {
                Corner::Smooth if !corners.is_empty() => {
                    for (x, out) in out.iter_mut().enumerate() {
                        let sum: f64 =
                            corners.iter().map(|&k| f64::from(at_corners[k as usize * c + x])).sum();
                        *out = (sum / corners.len() as f64) as f32;
                    }
                }
                Corner::Crease([a, b]) => {
                    let (a, b) = (cage.point(a), cage.point(b));
                    (0..c).for_each(|x| out[x] = (((a[x] + b[x]) + 4.0 * p[x]) / 6.0) as f32);
                }
                _ => (0..c).for_each(|x| out[x] = p[x] as f32),
            }
        }
        (self.at_corners, self.at_edges, self.at_vertices) = (at_corners, at_edges, at_vertices);
        // The refined positions are now in the Bezier vertices.
        self.cage.points = Vec::new();
    }

    /// Moves the Bezier vertices along the edges of each smooth vertex with a number of edges other than four into
    /// the tangent plane of the limit there, so that all patches around it have the same normal. Only positions are
    /// moved.
    fn flatten_edges(&self, kinds: &[Corner], at_edges: &mut [f32]) {
        let (cage, c) = (&self.cage, self.channels);
        let mut fan = Vec::new();
        for v in 0..cage.vertices() as u32 {
            let n = cage.corners_at(v).len();
            if n == 4 || n < 3 || kinds[v as usize] != Corner::Smooth || !cage.fan(v, &mut fan) {
                continue;
            }
            // The limit tangents are those of Halstead, Kass and DeRose, "Efficient, Fair Interpolation using
            // Catmull-Clark Surfaces", 1993.
            let step = std::f64::consts::TAU / n as f64;
            let a = 1.0 + libm::cos(step) + libm::cos(step * 0.5) * (2.0 * (9.0 + libm::cos(step))).sqrt();
            for key in 0..self.times.len() {
                let at = |vertex: u32, x: usize| cage.point(vertex)[key * 3 + x];
                let (mut tangents, mut limit) = ([[0.0; 3]; 2], [0.0; 3]);
                for x in 0..3 {
                    limit[x] = at(v, x) * (n * n) as f64;
                    for (k, &[_, next, opposite]) in fan.iter().enumerate() {
                        let (e, f) = (at(next, x), at(opposite, x));
                        let (here, there) = (k as f64 * step, (k + 1) as f64 * step);
                        tangents[0][x] +=
                            e * (a * libm::cos(here)) + f * (libm::cos(here) + libm::cos(there));
                        tangents[1][x] +=
                            e * (a * libm::sin(here)) + f * (libm::sin(here) + libm::sin(there));
                        limit[x] += e * 4.0 + f;
                    }
                    limit[x] /= (n * (n + 5)) as f64;
                }
                let normal = cross(tangents[0], tangents[1]);
                for &[edge, ..] in &fan {
                    let end = edge as usize * 2 + cage.edges[edge as usize].end(v);
                    flatten(&mut at_edges[end * c + key * 3..][..3], limit, normal);
                }
            }
        }
    }

    /// Does the same as [`Subdivision::flatten_edges`] for the faces between two sharp edges of an irregular vertex,
    /// which is one of a border or a crease with more than two faces, or a sharp one with more than one. The Bezier
    /// vertices are moved into the plane of the sharp edges, or, when these are collinear, into the plane of them and
    /// the edges in between.
    fn flatten_sectors(&self, kinds: &[Corner], at_edges: &mut [f32]) {
        let (cage, c) = (&self.cage, self.channels);
        let (mut between, mut by_out) = (Vec::new(), Vec::new());
        for v in 0..cage.vertices() as u32 {
            let corners = cage.corners_at(v);
            let regular = match kinds[v as usize] {
                Corner::Smooth => true,
                Corner::Crease(_) => corners.len() <= 2,
                Corner::Sharp => corners.len() <= 1,
            };
            if regular {
                continue;
            }
            by_out.clear();
            by_out.extend(corners.iter().map(|&k| (cage.corner_edges[k as usize], k)));
            by_out.sort_unstable();
            for &k in corners {
                let first = cage.corner_edges[k as usize];
                if !cage.edges[first as usize].is_sharp() {
                    continue;
                }
                let Some(last) = cage.sector_edges(k, &by_out, &mut between) else { continue };
                for key in 0..self.times.len() {
                    let place = |edge: u32| -> [f64; 3] {
                        let end = edge as usize * 2 + cage.edges[edge as usize].end(v);
                        std::array::from_fn(|x| f64::from(at_edges[end * c + key * 3 + x]))
                    };
                    let p: [f64; 3] = std::array::from_fn(|x| cage.point(v)[key * 3 + x]);
                    let limit = match kinds[v as usize] {
                        Corner::Crease([a, b]) => {
                            let [a, b] = [a, b].map(|v| &cage.point(v)[key * 3..key * 3 + 3]);
                            std::array::from_fn(|x| (a[x] + b[x] + 4.0 * p[x]) / 6.0)
                        }
                        _ => p,
                    };
                    let from = |q: [f64; 3]| -> [f64; 3] { std::array::from_fn(|x| q[x] - limit[x]) };
                    let [one, other] = [first, last].map(|edge| from(place(edge)));
                    let mut middle = [0.0; 3];
                    for &edge in &between {
                        let step = from(place(edge));
                        middle = std::array::from_fn(|x| middle[x] + step[x]);
                    }
                    let square = |t: [f64; 3]| t.iter().map(|x| x * x).sum::<f64>();
                    let mut normal = cross(one, other);
                    if square(normal) <= 1e-6 * square(one) * square(other) {
                        normal = cross(one, middle);
                    }
                    for &edge in &between {
                        let end = edge as usize * 2 + cage.edges[edge as usize].end(v);
                        flatten(&mut at_edges[end * c + key * 3..][..3], limit, normal);
                    }
                }
            }
        }
    }

    /// Orders the roots and computes their bounds.
    fn find_bounds(&mut self) {
        let bound =
            |part: usize, key: usize| net_bound(self, part, self.segments(part).map(Range::whole), key);
        let first: Vec<Bound> = (0..self.roots.len()).map(|part| bound(part, 0)).collect();
        let centres: Vec<Vec3> = first.iter().map(Bound::center).collect();
        let order = spatial_order(&centres);
        let keys = self.times.len();
        let bounds = order
            .iter()
            .flat_map(|&i| (0..keys).map(move |key| (i as usize, key)))
            .map(|(i, key)| if key == 0 { first[i] } else { bound(i, key) })
            .collect();
        self.roots = order.iter().map(|&i| self.roots[i as usize].clone()).collect();
        self.bounds = bounds;
    }

    /// Collects the Bezier vertices of a refined face.
    fn bezier_vertices(&self, face: usize, out: &mut Vec<f64>) {
        let c = self.channels;
        out.clear();
        out.resize(16 * c, 0.0);
        let mut put = |i: usize, j: usize, from: &[f32], index: usize| {
            let to = &mut out[(j * 4 + i) * c..][..c];
            to.iter_mut().zip(&from[index * c..]).for_each(|(o, &x)| *o = f64::from(x));
        };
        // The corners in winding order, and the steps from each to the next.
        const AT: [[usize; 2]; 4] = [[0, 0], [3, 0], [3, 3], [0, 3]];
        const INNER: [[usize; 2]; 4] = [[1, 1], [2, 1], [2, 2], [1, 2]];
        for k in 0..4 {
            let corner = face * 4 + k;
            let (v, next) = (self.cage.corners[corner], self.cage.corners[face * 4 + (k + 1) % 4]);
            let ([i, j], [ni, nj]) = (AT[k], AT[(k + 1) % 4]);
            put(i, j, &self.at_vertices, v as usize);
            put(INNER[k][0], INNER[k][1], &self.at_corners, corner);
            let edge = self.cage.corner_edges[corner] as usize;
            let end = |v: u32| edge * 2 + self.cage.edges[edge].end(v);
            put((2 * i + ni) / 3, (2 * j + nj) / 3, &self.at_edges, end(v));
            put((i + 2 * ni) / 3, (j + 2 * nj) / 3, &self.at_edges, end(next));
        }
    }

    /// Returns the refined face at a segment of a root.
    fn refined(&self, root: &Root, [su, sv]: [u32; 2]) -> usize {
        const CHILD: [u32; 4] = [0, 1, 3, 2];
        let path = (0..root.levels)
            .rev()
            .fold(0, |path, bit| path << 2 | CHILD[((su >> bit & 1) | (sv >> bit & 1) << 1) as usize]);
        (root.refined + path) as usize
    }
}

/// Moves a point into the plane through `on`, if `normal` is not zero.
fn flatten(point: &mut [f32], on: [f64; 3], normal: [f64; 3]) {
    let square: f64 = normal.iter().map(|x| x * x).sum();
    let above: f64 = (0..3).map(|x| (f64::from(point[x]) - on[x]) * normal[x]).sum::<f64>() / square;
    if square > 0.0 && above.is_finite() {
        (0..3).for_each(|x| point[x] = (f64::from(point[x]) - above * normal[x]) as f32);
    }
}

impl Net for Subdivision {
    fn times(&self) -> &[f32] {
        &self.times
    }
    fn dim(&self) -> usize {
        3
    }
    fn channels(&self) -> usize {
        self.channels
    }
    fn vars(&self) -> &Vars {
        &self.vars
    }
    fn degrees(&self) -> [usize; 2] {
        [3, 3]
    }
    fn segments(&self, part: usize) -> [u32; 2] {
        [1 << self.roots[part].levels; 2]
    }
    fn parameter(&self, part: usize, _axis: usize, place: Place) -> (f64, f64) {
        let n = f64::from(1_u32 << self.roots[part].levels);
        ((f64::from(place.segment) + place.b) / n, 1.0 / n)
    }
    fn extent(&self, _part: usize, _axis: usize) -> (f64, f64) {
        (0.0, 1.0)
    }
    fn gather(&self, part: usize, segment: [u32; 2], out: &mut Vec<f64>) {
        self.bezier_vertices(self.refined(&self.roots[part], segment), out);
    }
    fn has_seams(&self) -> bool {
        !self.regular
    }
    fn seam(&self, part: usize, segment: [u32; 2], side: usize, out: &mut Vec<f64>) -> Option<Seam> {
        let cage = &self.cage;
        let face = self.refined(&self.roots[part], segment);
        // The corner from which the side starts, in winding order.
        let corner = face * 4 + [0, 2, 3, 1][side];
        let index = cage.corner_edges[corner];
        let edge = &cage.edges[index as usize];
        let usual = |v: &u32| match cage.corner(*v) {
            Corner::Smooth => cage.corners_at(*v).len() == 4,
            Corner::Crease(_) => cage.corners_at(*v).len() == 2,
            Corner::Sharp => false,
        };
        if edge.is_sharp() || edge.ends.iter().all(usual) {
            return None;
        }
        let other = edge.faces[usize::from(edge.faces[0] as usize == face)] as usize;
        let beyond = (0..4).find(|k| cage.corner_edges[other * 4 + k] == index)?;
        self.bezier_vertices(other, out);
        // In both faces the place runs with the winding: in one direction here and in the other direction there.
        let with_winding = side == 0 || side == 3;
        let opposite = cage.corners[corner] != cage.corners[other * 4 + beyond];
        let beyond: fn(Place) -> [Place; 2] = match beyond {
            0 => |p| [p, Place { segment: 0, a: 1.0, b: 0.0 }],
            1 => |p| [Place { segment: 0, a: 0.0, b: 1.0 }, p],
            2 => |p| [Place { a: p.b, b: p.a, ..p }, Place { segment: 0, a: 0.0, b: 1.0 }],
            _ => |p| [Place { segment: 0, a: 1.0, b: 0.0 }, Place { a: p.b, b: p.a, ..p }],
        };
        Some(Seam { beyond, reversed: with_winding == opposite, along: side / 2 })
    }
    fn corners(&self, part: usize, out: &mut Vec<f64>) {
        let Root { first, n, corner, .. } = self.roots[part];
        out.clear();
        if n == 4 {
            LATTICE.into_iter().for_each(|i| self.vars.push_linear(first as usize + i, out));
            return;
        }
        let channels = self.vars.linear_channels();
        let mut all = Vec::with_capacity(n as usize * channels);
        (0..n).for_each(|i| self.vars.push_linear((first + i) as usize, &mut all));
        let at = |i: u32, x: usize| all[(i % n) as usize * channels + x];
        let middle = |i: u32, x: usize| 0.5 * (at(i, x) + at(i + 1, x));
        let centre = |x: usize| (0..n).map(|i| at(i, x)).sum::<f64>() / f64::from(n);
        out.extend((0..channels).map(|x| at(corner, x)));
        out.extend((0..channels).map(|x| middle(corner, x)));
        out.extend((0..channels).map(|x| middle(corner + n - 1, x)));
        out.extend((0..channels).map(centre));
    }
    fn face(&self, part: usize) -> u32 {
        self.roots[part].face
    }
    fn part_bound(&self, part: usize, key: usize) -> Option<Bound> {
        self.bounds.get(part * self.times.len() + key).copied()
    }
    fn dices_over(&self) -> bool {
        true
    }
    fn most_on_side(&self, part: usize, side: Option<usize>) -> u32 {
        let root = &self.roots[part];
        if side.is_some_and(|side| root.halved[side]) { (1 << root.levels) / 2 } else { u32::MAX }
    }
}
