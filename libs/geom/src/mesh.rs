//! Meshes of flat faces (reference 2.8.2). Each face is one bilinear piece or several triangles.

use crate::GeomError;
use crate::key::ShapeKey;
use crate::net::{Net, pieces};
use crate::order::spatial_order;
use crate::polygon::{is_concave, triangulate};
use crate::range::Place;
use crate::surface::Piece;
use crate::vars::{Control, Counts, Report, Vars, control, vertex_count};
use granita_base::{Bound, Params, Severity, Vec3};
use std::sync::Arc;

pub(crate) const CALL: &str = "Mesh";

/// A checked face: indices into the vertices, and their position in the list of corners.
#[derive(Clone, Debug)]
pub(crate) struct Face {
    /// The index of the face as declared.
    pub(crate) index: u32,
    /// The positions of its corners in `verts`.
    pub(crate) corners: std::ops::Range<usize>,
}

/// The faces of a mesh that can be drawn, with the vertices.
pub(crate) struct Faces {
    /// The valid faces.
    pub(crate) faces: Vec<Face>,
    /// The vertex indices of all corners, as declared. Those of faces in `faces` are in range.
    pub(crate) verts: Arc<[i32]>,
    /// The vertices and the variables that are interpolated like them, never rational.
    pub(crate) control: Control,
    /// The primitive variables.
    pub(crate) vars: Vars,
    /// The indices of faces that are holes, sorted.
    pub(crate) holes: Vec<u32>,
}

/// Checks faces, vertices and variables. Invalid faces are reported, counted and left out.
pub(crate) fn check(
    keys: &[ShapeKey<'_>],
    nverts: &[i32],
    verts: &Arc<[i32]>,
    report: Report<'_>,
) -> Result<Faces, GeomError> {
    let params = keys[0].params;
    let n = vertex_count(CALL, keys, report)?;
    let mut mistakes = Mistakes::default();
    let mut faces = Vec::with_capacity(nverts.len().min(verts.len() / 3 + 1));
    let (mut start, mut used) = (0_usize, 0_usize);
    for (index, &count) in nverts.iter().enumerate() {
        let count = usize::try_from(count).unwrap_or(0);
        let Some(end) = start.checked_add(count).filter(|&end| end <= verts.len()) else {
            mistakes.note(index, || {
                format!("it has {count} corners, and there are {} vertex indices left", verts.len() - start)
            });
            break;
        };
        let corners = start..end;
        start = end;
        if count < 3 {
            mistakes.note(index, || format!("it has {} corners, at least 3 are needed", nverts[index]));
            continue;
        }
        let in_range = |v: i32| usize::try_from(v).is_ok_and(|v| v < n);
        if let Some(bad) = verts[corners.clone()].iter().find(|v| !in_range(**v)) {
            mistakes.note(index, || format!("vertex index {bad} is out of range, there are {n} vertices"));
            continue;
        }
        let most = verts[corners.clone()].iter().max().map_or(0, |v| *v as usize);
        used = used.max(most + 1);
        faces.push(Face { index: index as u32, corners });
    }
    if start < verts.len() && mistakes.count == 0 {
        let text = format!("{CALL}: {} vertex indices, but the faces have {start} corners", verts.len());
        report(Severity::Warning, text);
    }
    let counts = Counts { vertex: Some(used), linear: Some(verts.len()), perpiece: Some(nverts.len()) };
    let vars = Vars::collect(CALL, params, counts, report);
    let control = control(CALL, keys, used, &vars, &mut |_, _| {})?.divided();
    let finite: Vec<bool> = (0..control.len()).map(|i| control.is_finite(i)).collect();
    faces.retain(|face| {
        let good = verts[face.corners.clone()].iter().all(|&v| finite[v as usize]);
        if !good {
            mistakes.note(face.index as usize, || "a vertex of it is not finite".to_owned());
        }
        good
    });
    mistakes.tell(nverts.len(), report);
    Ok(Faces { faces, verts: verts.clone(), control, vars, holes: holes(params, nverts.len(), report) })
}

/// Returns the parameter "holes", sorted.
fn holes(params: &Params, nfaces: usize, report: Report<'_>) -> Vec<u32> {
    let Some(list) = params.get("holes").and_then(|p| p.data.to_ints()) else { return Vec::new() };
    let mut holes: Vec<u32> = list.iter().filter_map(|&h| u32::try_from(h).ok()).collect();
    holes.retain(|&h| (h as usize) < nfaces);
    if holes.len() < list.len() {
        report(Severity::Warning, format!("{CALL}: \"holes\" names faces that do not exist"));
    }
    holes.sort_unstable();
    holes.dedup();
    holes
}

/// Collects the errors of faces into one message.
#[derive(Default)]
struct Mistakes {
    count: usize,
    first: Option<(usize, String)>,
}

impl Mistakes {
    fn note(&mut self, face: usize, what: impl FnOnce() -> String) {
        self.count += 1;
        self.first.get_or_insert_with(|| (face, what()));
    }

    fn tell(&self, nfaces: usize, report: Report<'_>) {
        if let Some((face, what)) = &self.first {
            let text = match self.count {
                1 => format!("{CALL}: face {face} of {nfaces} left out: {what}"),
                n => format!("{CALL}: {n} of {nfaces} faces left out, the first is face {face}: {what}"),
            };
            report(Severity::Warning, text);
        }
    }
}

/// A quadrilateral, or a triangle with its last corner repeated.
#[derive(Clone, Copy, Debug)]
struct Facet {
    face: u32,
    /// The corners in winding order, as positions in `verts`.
    corners: [u32; 4],
}

/// A mesh of flat faces.
struct Mesh {
    times: Vec<f32>,
    facets: Vec<Facet>,
    verts: Arc<[i32]>,
    control: Control,
    vars: Vars,
}

/// Builds the pieces of a mesh of flat faces.
pub(crate) fn build(
    keys: &[ShapeKey<'_>],
    nverts: &[i32],
    verts: &Arc<[i32]>,
    report: Report<'_>,
) -> Result<Vec<Piece>, GeomError> {
    let Faces { faces, verts, control, vars, holes } = check(keys, nverts, verts, report)?;
    if u32::try_from(verts.len()).is_err() {
        let (asked, max) = (verts.len() as u64, u64::from(u32::MAX));
        return Err(GeomError::Limit { call: CALL, what: "vertex indices", asked, max });
    }
    let at = |corner: usize| -> [f64; 3] {
        let v = control.vertex(verts[corner] as usize);
        [v[0], v[1], v[2]]
    };
    let mut facets = Vec::with_capacity(faces.len());
    let mut polygon = Vec::new();
    for face in faces.iter().filter(|f| holes.binary_search(&f.index).is_err()) {
        let first = face.corners.start;
        let corner = |i: usize| (first + i) as u32;
        polygon.clear();
        polygon.extend(face.corners.clone().map(at));
        let whole = match polygon[..] {
            [a, b, c] => Some(lattice_of([a, b, c])),
            [a, b, c, d] => (!is_concave(&[a, b, c, d])).then_some([0, 1, 2, 3]),
            _ => None,
        };
        match whole {
            Some(list) => facets.push(Facet { face: face.index, corners: list.map(corner) }),
            None => facets.extend(
                triangulate(&polygon)
                    .into_iter()
                    .map(|t| (t, lattice_of(t.map(|i| polygon[i]))))
                    .map(|(t, order)| Facet { face: face.index, corners: order.map(|i| corner(t[i])) }),
            ),
        }
    }
    let centre = |f: &Facet| {
        let sum: Vec3 =
            f.corners.iter().map(|&c| control.position(verts[c as usize] as usize, 0) * 0.25).sum();
        sum
    };
    let centres: Vec<Vec3> = facets.iter().map(centre).collect();
    let facets: Vec<Facet> = spatial_order(&centres).into_iter().map(|i| facets[i as usize]).collect();
    let n = facets.len();
    let times = keys.iter().map(|k| k.time).collect();
    Ok(pieces(Box::new(Mesh { times, facets, verts, control, vars }), n))
}

/// Maps the corners of a facet to those of a triangle. The last corner, at which a side of the lattice collapses, is
/// the sharp corner of a sliver. The sliver is then diced along its length only, and not twice along both long sides.
fn lattice_of(corners: [[f64; 3]; 3]) -> [usize; 4] {
    const SLIVER: f64 = 0.25;
    let side = |i: usize| {
        let (p, q) = (corners[i], corners[(i + 1) % 3]);
        (0..3).map(|x| (q[x] - p[x]).powi(2)).sum::<f64>()
    };
    let sides = [side(0), side(1), side(2)];
    let longest = sides.into_iter().fold(0.0, f64::max);
    // The shortest side runs along u. The first side is used unless it is much longer than the shortest.
    let first = (0..3).find(|&i| sides[i] < longest * (SLIVER * SLIVER)).unwrap_or(0);
    [first, (first + 1) % 3, (first + 2) % 3, (first + 2) % 3]
}

/// Converts winding order to lattice order (u fastest): the corners at (0,0), (1,0), (0,1), (1,1).
pub(crate) const LATTICE: [usize; 4] = [0, 1, 3, 2];

impl Net for Mesh {
    fn times(&self) -> &[f32] {
        &self.times
    }
    fn dim(&self) -> usize {
        3
    }
    fn channels(&self) -> usize {
        self.control.channels
    }
    fn vars(&self) -> &Vars {
        &self.vars
    }
    fn degrees(&self) -> [usize; 2] {
        [1, 1]
    }
    fn segments(&self, _part: usize) -> [u32; 2] {
        [1, 1]
    }
    fn parameter(&self, _part: usize, _axis: usize, place: Place) -> (f64, f64) {
        (place.b, 1.0)
    }
    fn extent(&self, _part: usize, _axis: usize) -> (f64, f64) {
        (0.0, 1.0)
    }
    fn gather(&self, part: usize, _segment: [u32; 2], out: &mut Vec<f64>) {
        let facet = &self.facets[part];
        out.clear();
        for i in LATTICE {
            let vertex = self.verts[facet.corners[i] as usize] as usize;
            out.extend_from_slice(self.control.vertex(vertex));
        }
    }
    fn corners(&self, part: usize, out: &mut Vec<f64>) {
        let facet = &self.facets[part];
        out.clear();
        LATTICE.into_iter().for_each(|i| self.vars.push_linear(facet.corners[i] as usize, out));
    }
    fn face(&self, part: usize) -> u32 {
        self.facets[part].face
    }
    fn part_bound(&self, part: usize, key: usize) -> Option<Bound> {
        let vertices = self.facets[part].corners.iter().map(|&c| self.verts[c as usize] as usize);
        Some(Bound::around(vertices.map(|v| self.control.position(v, key))))
    }
    fn facet(&self, part: usize, key: usize) -> Option<[Vec3; 4]> {
        let corners = self.facets.get(part)?.corners;
        Some(LATTICE.map(|i| self.control.position(self.verts[corners[i] as usize] as usize, key)))
    }
    fn dices_over(&self) -> bool {
        false
    }
}
