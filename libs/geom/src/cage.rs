//! Control cages of Catmull-Clark surfaces: topology and refinement.
//!
//! The rules are those of Catmull and Clark, "Recursively generated B-spline surfaces on arbitrary topological
//! meshes", Computer-Aided Design 10(6), 1978. Along borders the surface follows the cubic B-spline curve of the
//! border's vertices. Creases follow the same curve for as many steps as their sharpness (DeRose, Kass and Truong,
//! "Subdivision Surfaces in Character Animation", SIGGRAPH 1998).

/// An edge with the faces on its sides.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Edge {
    /// The number of steps of subdivision for which it stays sharp; infinite at borders and at edges with more than
    /// two faces.
    pub(crate) sharpness: f32,
    /// The indices of its ends, the smaller one first.
    pub(crate) ends: [u32; 2],
    /// The indices of up to two faces.
    pub(crate) faces: [u32; 2],
    /// The number of faces. Edges with a number other than two, which are borders and edges with more faces, are
    /// always sharp.
    pub(crate) count: u32,
}

impl Edge {
    /// True when the surface does not pass smoothly.
    pub(crate) fn is_sharp(&self) -> bool {
        self.sharpness > 0.0
    }

    /// Returns which of its ends a vertex is.
    pub(crate) fn end(&self, vertex: u32) -> usize {
        usize::from(vertex != self.ends[0])
    }
}

/// Sharp edges and vertices where the surface would be smooth by the rules.
#[derive(Clone, Debug, Default)]
pub(crate) struct Creases {
    /// The ends of edges, and their sharpness.
    pub(crate) edges: Vec<([u32; 2], f32)>,
    /// The vertices, and their sharpness.
    pub(crate) vertices: Vec<(u32, f32)>,
}

/// The behaviour of the surface at a vertex.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Corner {
    /// The surface is smooth all around.
    Smooth,
    /// The vertex is on a border curve or a crease with these two neighbours.
    Crease([u32; 2]),
    /// The surface goes through the vertex.
    Sharp,
}

/// Faces over vertices with their adjacency.
#[derive(Debug)]
pub(crate) struct Cage {
    /// The number of channels per vertex.
    pub(crate) channels: usize,
    /// The channels of the vertices.
    pub(crate) points: Vec<f64>,
    /// The indices at which the corners of each face start, and one more.
    pub(crate) starts: Vec<u32>,
    /// The vertex at each corner.
    pub(crate) corners: Vec<u32>,
    /// The edge from each corner to the next of its face.
    pub(crate) corner_edges: Vec<u32>,
    /// All edges.
    pub(crate) edges: Vec<Edge>,
    /// The indices at which the faces of each vertex start, and one more.
    vertex_starts: Vec<u32>,
    /// The corners at each vertex, in order.
    vertex_corners: Vec<u32>,
    /// The edges at each vertex, in the same form.
    edge_starts: Vec<u32>,
    vertex_edges: Vec<u32>,
    /// True when vertices with one face are sharp ("border" 1).
    sharp_corners: bool,
    /// The sharpness of each vertex by itself; empty when there is none.
    vertex_sharpness: Vec<f32>,
    /// True when any edge of two faces is sharp.
    creased: bool,
}

/// Returns lists by vertex: the start of each, and all entries in order.
fn by_vertex(n: usize, entries: impl Iterator<Item = (u32, u32)> + Clone) -> (Vec<u32>, Vec<u32>) {
    let mut starts = vec![0_u32; n + 1];
    for (v, _) in entries.clone() {
        starts[v as usize + 1] += 1;
    }
    for v in 0..n {
        starts[v + 1] += starts[v];
    }
    let mut next = starts.clone();
    let mut list = vec![0; starts[n] as usize];
    for (v, x) in entries {
        let at = &mut next[v as usize];
        list[*at as usize] = x;
        *at += 1;
    }
    (starts, list)
}

impl Cage {
    /// Returns the cage of some faces. `corners` must be in range of the points.
    pub(crate) fn new(
        channels: usize,
        points: Vec<f64>,
        starts: Vec<u32>,
        corners: Vec<u32>,
        sharp_corners: bool,
    ) -> Self {
        let n = points.len() / channels;
        let mut sides: Vec<(u32, u32, u32, u32)> = Vec::with_capacity(corners.len());
        for face in 0..starts.len() - 1 {
            let (first, end) = (starts[face], starts[face + 1]);
            for c in first..end {
                let next = if c + 1 == end { first } else { c + 1 };
                let (a, b) = (corners[c as usize], corners[next as usize]);
                sides.push((a.min(b), a.max(b), face as u32, c));
            }
        }
        sides.sort_unstable();
        let mut edges: Vec<Edge> = Vec::with_capacity(sides.len() / 2 + 1);
        let mut corner_edges = vec![0; corners.len()];
        for &(a, b, face, corner) in &sides {
            match edges.last_mut() {
                Some(edge) if edge.ends == [a, b] => {
                    if edge.count < 2 {
                        edge.faces[edge.count as usize] = face;
                    }
                    edge.count += 1;
                    edge.sharpness = if edge.count == 2 { 0.0 } else { f32::INFINITY };
                }
                _ => {
                    edges.push(Edge { sharpness: f32::INFINITY, ends: [a, b], faces: [face, face], count: 1 })
                }
            }
            corner_edges[corner as usize] = edges.len() as u32 - 1;
        }
        let at_corners = corners.iter().enumerate().map(|(c, &v)| (v, c as u32));
        let (vertex_starts, vertex_corners) = by_vertex(n, at_corners);
        let at_edges = edges.iter().enumerate().flat_map(|(e, edge)| edge.ends.map(|v| (v, e as u32)));
        let (edge_starts, vertex_edges) = by_vertex(n, at_edges);
        Self {
            channels,
            points,
            starts,
            corners,
            corner_edges,
            edges,
            vertex_starts,
            vertex_corners,
            edge_starts,
            vertex_edges,
            sharp_corners,
            vertex_sharpness: Vec::new(),
            creased: false,
        }
    }

    /// Makes edges and vertices sharp. Returns the numbers of those that do not exist.
    pub(crate) fn crease(&mut self, creases: &Creases) -> [usize; 2] {
        let mut missing = [0; 2];
        for &([a, b], sharpness) in &creases.edges {
            match self.edges.binary_search_by_key(&[a.min(b), a.max(b)], |e| e.ends) {
                Ok(found) => {
                    let edge = &mut self.edges[found];
                    edge.sharpness = edge.sharpness.max(sharpness);
                    self.creased |= sharpness > 0.0;
                }
                Err(_) => missing[0] += 1,
            }
        }
        for &(v, sharpness) in &creases.vertices {
            if v as usize >= self.vertices() {
                missing[1] += 1;
                continue;
            }
            if sharpness > 0.0 {
                self.vertex_sharpness.resize(self.vertices(), 0.0);
                self.vertex_sharpness[v as usize] = sharpness.max(self.vertex_sharpness[v as usize]);
            }
        }
        missing
    }

    /// Returns the largest sharpness of an edge of two faces or of a vertex, without infinite ones.
    pub(crate) fn passing_sharpness(&self) -> f32 {
        let edges = self.edges.iter().map(|e| e.sharpness);
        let all = edges.chain(self.vertex_sharpness.iter().copied());
        all.filter(|s| s.is_finite()).fold(0.0, f32::max)
    }

    /// The number of vertices.
    pub(crate) fn vertices(&self) -> usize {
        self.vertex_starts.len() - 1
    }

    /// The number of faces.
    pub(crate) fn faces(&self) -> usize {
        self.starts.len() - 1
    }

    /// Returns the channels of a vertex.
    pub(crate) fn point(&self, vertex: u32) -> &[f64] {
        &self.points[vertex as usize * self.channels..][..self.channels]
    }

    /// Returns the corners at a vertex.
    pub(crate) fn corners_at(&self, vertex: u32) -> &[u32] {
        let v = vertex as usize;
        &self.vertex_corners[self.vertex_starts[v] as usize..self.vertex_starts[v + 1] as usize]
    }

    fn edges_at(&self, vertex: u32) -> &[u32] {
        let v = vertex as usize;
        &self.vertex_edges[self.edge_starts[v] as usize..self.edge_starts[v + 1] as usize]
    }

    /// Returns the range of corners of a face.
    pub(crate) fn face(&self, face: usize) -> std::ops::Range<usize> {
        self.starts[face] as usize..self.starts[face + 1] as usize
    }

    /// Returns the behaviour of the surface at a vertex.
    pub(crate) fn corner(&self, vertex: u32) -> Corner {
        self.corner_after(vertex, 0.0)
    }

    fn own_sharpness(&self, vertex: u32) -> f32 {
        self.vertex_sharpness.get(vertex as usize).copied().unwrap_or(0.0)
    }

    /// Returns the behaviour of the surface at a vertex when every sharpness is reduced by `less`.
    fn corner_after(&self, vertex: u32, less: f32) -> Corner {
        if self.own_sharpness(vertex) > less {
            return Corner::Sharp;
        }
        let mut neighbours = [0; 2];
        let mut sharp = 0;
        for &e in self.edges_at(vertex) {
            let edge = &self.edges[e as usize];
            if edge.sharpness > less {
                if sharp < 2 {
                    neighbours[sharp] = edge.ends[1 - edge.end(vertex)];
                }
                sharp += 1;
            }
        }
        match sharp {
            0 | 1 => Corner::Smooth,
            2 if !(self.sharp_corners && self.corners_at(vertex).len() == 1) => Corner::Crease(neighbours),
            _ => Corner::Sharp,
        }
    }

    /// Returns the number of faces around a vertex between two sharp edges, including that of corner `k`. All faces
    /// are quadrilaterals. Without creases these are all faces around the vertex.
    pub(crate) fn sector(&self, k: u32) -> usize {
        /// With more faces than this, their division is not visible.
        const MOST: usize = 64;
        let vertex = self.corners[k as usize];
        let corners = self.corners_at(vertex);
        if !self.creased || corners.len() > MOST {
            return corners.len();
        }
        let before = |k: u32| if k.is_multiple_of(4) { k + 3 } else { k - 1 };
        // The search crosses the edge behind each corner, then the edge before it.
        let (mut n, mut ends) = (1, 0);
        for forward in [true, false] {
            let mut here = k;
            while n <= corners.len() {
                let over = self.corner_edges[(if forward { here } else { before(here) }) as usize];
                if self.edges[over as usize].is_sharp() {
                    ends += 1;
                    break;
                }
                let across = corners.iter().copied().find(|&c| {
                    let edge = self.corner_edges[(if forward { before(c) } else { c }) as usize];
                    edge == over && c != here
                });
                match across {
                    Some(next) if next != k => {
                        here = next;
                        n += 1;
                    }
                    _ => break,
                }
            }
            if ends == 0 {
                break;
            }
        }
        n.min(corners.len())
    }

    /// Replaces `out` by the quadrilaterals around a vertex in winding order: for each the edge to the next vertex,
    /// that vertex, and the opposite one. Returns false when they do not form one closed fan.
    pub(crate) fn fan(&self, vertex: u32, out: &mut Vec<[u32; 3]>) -> bool {
        out.clear();
        let around = |k: u32, by: u32| self.corners[(k / 4 * 4 + (k + by) % 4) as usize];
        let corners = self.corners_at(vertex);
        let mut by_next: Vec<(u32, u32)> = corners.iter().map(|&k| (around(k, 1), k)).collect();
        by_next.sort_unstable();
        let mut k = corners[0];
        for _ in corners {
            out.push([self.corner_edges[k as usize], around(k, 1), around(k, 2)]);
            match by_next.binary_search_by_key(&around(k, 3), |x| x.0) {
                Ok(found) => k = by_next[found].1,
                Err(_) => return false,
            }
        }
        k == corners[0] && by_next.windows(2).all(|w| w[0].0 != w[1].0)
    }

    /// Returns the edges at a vertex from a sharp one to the next sharp one. `corner` is the corner of the first face
    /// there. `by_out` holds the vertex's corners, each with the edge that starts from it, sorted. `None` where the
    /// windings are inconsistent.
    pub(crate) fn sector_edges(
        &self,
        corner: u32,
        by_out: &[(u32, u32)],
        between: &mut Vec<u32>,
    ) -> Option<u32> {
        between.clear();
        let mut here = corner;
        loop {
            let before = if here.is_multiple_of(4) { here + 3 } else { here - 1 };
            let over = self.corner_edges[before as usize];
            if self.edges[over as usize].is_sharp() {
                return Some(over);
            }
            between.push(over);
            let next = by_out.binary_search_by_key(&over, |x| x.0).ok()?;
            here = by_out[next].1;
            if between.len() > by_out.len() {
                return None;
            }
        }
    }

    /// Returns the behaviour of the surface at each vertex.
    pub(crate) fn kinds(&self) -> Vec<Corner> {
        (0..self.vertices() as u32).map(|v| self.corner(v)).collect()
    }

    /// True when one bicubic patch is exactly the surface at each of these faces. `kinds` is the result of
    /// [`Cage::kinds`].
    pub(crate) fn is_regular(&self, kinds: &[Corner], mut drawn: impl Iterator<Item = usize>) -> bool {
        let regular = |&v: &u32| {
            let faces = self.corners_at(v).len();
            match kinds[v as usize] {
                Corner::Smooth => faces == 4,
                Corner::Crease(_) => faces == 2,
                Corner::Sharp => faces == 1,
            }
        };
        (0..self.faces()).all(|f| self.face(f).len() == 4)
            && drawn.all(|f| self.corners[self.face(f)].iter().all(regular))
    }

    /// Does one step of subdivision. The quadrilateral at corner `c` has index `c` in the result. Where the face was
    /// a quadrilateral too, corner `i` of the child at its corner `i` is that corner, so that parameters keep their
    /// directions. Children of other faces start with the face's corner.
    pub(crate) fn refined(&self) -> Self {
        let (c, nv, ne, nf) = (self.channels, self.vertices(), self.edges.len(), self.faces());
        let mut points = vec![0.0; (nv + ne + nf) * c];
        let (of_vertices, rest) = points.split_at_mut(nv * c);
        let (of_edges, of_faces) = rest.split_at_mut(ne * c);
        for (f, out) in of_faces.chunks_exact_mut(c).enumerate() {
            let corners = &self.corners[self.face(f)];
            average(out, corners.iter().map(|&v| self.point(v)));
        }
        self.find_edge_points(of_faces, of_edges);
        self.find_vertex_points(of_faces, of_vertices);
        let starts = (0..=self.corners.len() as u32).map(|k| k * 4).collect();
        let mut refined = Self::new(c, points, starts, self.refined_corners(), self.sharp_corners);
        refined.crease(&self.refined_creases());
        refined
    }

    /// Computes the channels of the new vertices on edges from the new vertices on faces.
    fn find_edge_points(&self, of_faces: &[f64], of_edges: &mut [f64]) {
        let c = self.channels;
        let face_point = |f: u32| &of_faces[f as usize * c..][..c];
        for (edge, out) in self.edges.iter().zip(of_edges.chunks_exact_mut(c)) {
            let [a, b] = edge.ends.map(|v| self.point(v));
            if edge.is_sharp() {
                average(out, [a, b].into_iter());
            } else {
                average(out, [a, b, face_point(edge.faces[0]), face_point(edge.faces[1])].into_iter());
            }
            if edge.sharpness > 0.0 && edge.sharpness < 1.0 {
                let smooth = [a, b, face_point(edge.faces[0]), face_point(edge.faces[1])];
                let part = f64::from(edge.sharpness);
                for (k, out) in out.iter_mut().enumerate() {
                    *out = *out * part + smooth.iter().map(|p| p[k]).sum::<f64>() * 0.25 * (1.0 - part);
                }
            }
        }
    }

    /// Computes the channels of the moved vertices from the new vertices on faces.
    fn find_vertex_points(&self, of_faces: &[f64], of_vertices: &mut [f64]) {
        let c = self.channels;
        let mut rule = VertexRule::new(self, of_faces);
        let mut later = vec![0.0; c];
        for (v, out) in of_vertices.chunks_exact_mut(c).enumerate() {
            let v = v as u32;
            let (now, next) = (self.corner(v), self.corner_after(v, 1.0));
            rule.place(v, now, out);
            if now != next {
                // A sharpness that ends within this step has a partial effect.
                let part = self.passing(v);
                rule.place(v, next, &mut later);
                out.iter_mut().zip(&later).for_each(|(o, l)| *o = *o * part + l * (1.0 - part));
            }
        }
    }

    /// Returns the vertices of the refined faces. The vertices of the cage come first, then those on edges, then those
    /// on faces.
    fn refined_corners(&self) -> Vec<u32> {
        let (nv, ne) = (self.vertices(), self.edges.len());
        let mut corners = Vec::with_capacity(self.corners.len() * 4);
        for f in 0..self.faces() {
            let range = self.face(f);
            let n = range.len();
            for i in 0..n {
                let at = |i: usize| range.start + i % n;
                let quad = [
                    self.corners[at(i)],
                    nv as u32 + self.corner_edges[at(i)],
                    (nv + ne + f) as u32,
                    nv as u32 + self.corner_edges[at(i + n - 1)],
                ];
                let turn = if n == 4 { i } else { 0 };
                corners.extend((0..4).map(|k| quad[(k + 4 - turn) % 4]));
            }
        }
        corners
    }

    /// Returns the edges and vertices that stay sharp for more than one step, as they are after the step.
    fn refined_creases(&self) -> Creases {
        let nv = self.vertices();
        let less = |s: f32| (s - 1.0).max(0.0);
        let halves = self.edges.iter().enumerate().filter(|(_, e)| e.count == 2 && e.sharpness > 1.0);
        let halves = halves.flat_map(|(i, e)| e.ends.map(|v| ([v, (nv + i) as u32], less(e.sharpness))));
        let vertices = self.vertex_sharpness.iter().enumerate().filter(|(_, s)| **s > 1.0);
        let vertices = vertices.map(|(v, s)| (v as u32, less(*s)));
        Creases { edges: halves.collect(), vertices: vertices.collect() }
    }

    /// Returns the mean sharpness of everything at a vertex that is sharp for less than one more step.
    fn passing(&self, vertex: u32) -> f64 {
        let own = std::iter::once(self.own_sharpness(vertex));
        let edges = self.edges_at(vertex).iter().map(|&e| self.edges[e as usize].sharpness);
        let passing = own.chain(edges).filter(|s| *s > 0.0 && *s <= 1.0);
        let (sum, n) = passing.fold((0.0, 0.0), |(sum, n), s| (sum + f64::from(s), n + 1.0));
        if n > 0.0 { sum / n } else { 1.0 }
    }
}

/// Computes where a step of subdivision moves vertices.
struct VertexRule<'a> {
    cage: &'a Cage,
    /// The channels of the new vertices on faces.
    of_faces: &'a [f64],
    /// The face of each corner.
    face_of_corner: Vec<u32>,
    /// Scratch for the means of the channels of adjacent vertices and of faces.
    ring: Vec<f64>,
    middle: Vec<f64>,
}

impl<'a> VertexRule<'a> {
    fn new(cage: &'a Cage, of_faces: &'a [f64]) -> Self {
        let mut face_of_corner = vec![0_u32; cage.corners.len()];
        for f in 0..cage.faces() {
            face_of_corner[cage.face(f)].fill(f as u32);
        }
        let c = cage.channels;
        Self { cage, of_faces, face_of_corner, ring: vec![0.0; c], middle: vec![0.0; c] }
    }

    /// Computes the channels of a vertex after the step, with the surface behaving there as `kind`.
    fn place(&mut self, v: u32, kind: Corner, out: &mut [f64]) {
        let (cage, c) = (self.cage, self.cage.channels);
        let p = cage.point(v);
        let corners = cage.corners_at(v);
        match kind {
            Corner::Smooth if !corners.is_empty() => {
                let n = cage.edges_at(v).len() as f64;
                let faces = corners.iter().map(|&k| self.face_of_corner[k as usize]);
                average(&mut self.middle, faces.map(|f| &self.of_faces[f as usize * c..][..c]));
                let others = cage.edges_at(v).iter().map(|&e| {
                    let edge = &cage.edges[e as usize];
                    cage.point(edge.ends[1 - edge.end(v)])
                });
                average(&mut self.ring, others);
                for k in 0..c {
                    // The rule is Q/n + 2R/n + (n-3)v/n with R = (v + ring)/2.
                    out[k] = (self.middle[k] + self.ring[k] + (n - 2.0) * p[k]) / n;
                }
            }
            Corner::Crease([a, b]) => {
                let (a, b) = (cage.point(a), cage.point(b));
                for k in 0..c {
                    out[k] = (6.0 * p[k] + (a[k] + b[k])) / 8.0;
                }
            }
            _ => out.copy_from_slice(p),
        }
    }
}

/// Computes the mean of points, added in order.
fn average<'a>(out: &mut [f64], points: impl Iterator<Item = &'a [f64]>) {
    out.fill(0.0);
    let mut n = 0.0;
    for p in points {
        out.iter_mut().zip(p).for_each(|(o, x)| *o += x);
        n += 1.0;
    }
    out.iter_mut().for_each(|o| *o /= n);
}
