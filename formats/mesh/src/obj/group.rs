//! The faces, lines and points between two changes of object, group or material, and the calls that they become.

use super::mtl::Material;
use super::table::{Corner, NONE, Table};
use crate::emit::{Emit, floats, lines, points, positions};
use crate::faults::{Faults, of_object};
use granita_base::{BaseType, Interp, Params, ShapeDesc, Vec3};
use granita_scene::Stop;
use std::collections::{BTreeMap, HashMap};

/// The elements that are collected for the next calls.
#[derive(Default)]
pub(super) struct Group {
    nverts: Vec<i32>,
    corners: Vec<Corner>,
    /// The line and the smoothing group of each face. Group 0 is no smoothing.
    faces: Vec<(u32, u32)>,
    /// Maps a number of points to the vertices of the lines with that number of points.
    lines: BTreeMap<usize, Vec<u32>>,
    points: Vec<u32>,
    /// The line of the first element.
    line: u32,
}

/// The state that a group belongs to.
#[derive(Clone, Copy)]
pub(super) struct Place<'a> {
    pub(super) table: &'a Table,
    pub(super) material: Option<&'a Material>,
    /// The name for messages, which may be empty.
    pub(super) object: &'a str,
}

/// Memory for the renumbering of vertices, which is reused from group to group.
#[derive(Default)]
pub(super) struct Scratch {
    /// The index in the mesh of each vertex of the file; [`NONE`] if it is not used.
    local: Vec<u32>,
    /// The vertices of the mesh.
    used: Vec<u32>,
}

impl Group {
    pub(super) fn is_empty(&self) -> bool {
        self.nverts.is_empty() && self.lines.is_empty() && self.points.is_empty()
    }

    /// Returns the line of the first element.
    pub(super) fn line(&self) -> u32 {
        self.line
    }

    pub(super) fn corner_count(&self) -> usize {
        self.corners.len()
    }

    fn began(&mut self, line: u32) {
        if self.is_empty() {
            self.line = line;
        }
    }

    pub(super) fn face(&mut self, corners: &[Corner], line: u32, smoothing: u32) {
        self.began(line);
        self.nverts.push(corners.len() as i32);
        self.corners.extend_from_slice(corners);
        self.faces.push((line, smoothing));
    }

    pub(super) fn polyline(&mut self, corners: &[Corner], line: u32) {
        self.began(line);
        self.lines.entry(corners.len()).or_default().extend(corners.iter().map(|c| c.v));
    }

    pub(super) fn points(&mut self, corners: &[Corner], line: u32) {
        self.began(line);
        self.points.extend(corners.iter().map(|c| c.v));
    }

    /// Makes the calls, and removes all elements.
    pub(super) fn flush(
        &mut self,
        place: Place<'_>,
        scratch: &mut Scratch,
        faults: &mut Faults<'_>,
        emit: &mut Emit<'_>,
    ) -> Result<(), Stop> {
        let group = std::mem::take(self);
        let Place { table, object, .. } = place;
        let line = group.line;
        let polylines = group.lines;
        let single = group.points;
        let mesh = MeshMaker { place, nverts: group.nverts, corners: group.corners, faces: group.faces };
        if let Some((shape, params)) = mesh.make(scratch, faults) {
            emit.shape(shape, params, line)?;
        }
        for (nverts, vertices) in polylines {
            let mut p = Vec::with_capacity(vertices.len() * 3);
            for one in vertices.chunks_exact(nverts) {
                if one.iter().all(|v| table.has_position(*v)) {
                    p.extend(one.iter().flat_map(|v| table.positions[*v as usize]));
                } else {
                    faults.error("line vertex", line, || {
                        format!(
                            "a line refers to a vertex that does not exist{}: left out",
                            of_object(object)
                        )
                    });
                }
            }
            if !p.is_empty() {
                let (shape, params) = lines(p, nverts);
                emit.shape(shape, params, line)?;
            }
        }
        if !single.is_empty() {
            let good = single.iter().filter(|v| table.has_position(**v));
            let p: Vec<f32> = good.flat_map(|v| table.positions[*v as usize]).collect();
            if p.len() < single.len() * 3 {
                faults.error("point vertex", line, || {
                    format!("a point refers to a vertex that does not exist{}: left out", of_object(object))
                });
            }
            if !p.is_empty() {
                let (shape, params) = points(p);
                emit.shape(shape, params, line)?;
            }
        }
        Ok(())
    }
}

/// The faces that become a mesh.
struct MeshMaker<'a> {
    place: Place<'a>,
    nverts: Vec<i32>,
    corners: Vec<Corner>,
    faces: Vec<(u32, u32)>,
}

impl MeshMaker<'_> {
    fn make(mut self, scratch: &mut Scratch, faults: &mut Faults<'_>) -> Option<(ShapeDesc, Params)> {
        self.drop_faulty(faults);
        if self.nverts.is_empty() {
            return None;
        }
        let verts = self.renumber(scratch);
        let used = std::mem::take(&mut scratch.used);
        let p: Vec<f32> = used.iter().flat_map(|v| self.place.table.positions[*v as usize]).collect();
        let mut params = Params(vec![positions(p)]);
        self.normals(&verts, used.len(), &mut params);
        self.texture_coordinates(&verts, used.len(), &mut params);
        if !self.place.table.colors.is_empty() {
            let c: Vec<f32> = used.iter().flat_map(|v| self.place.table.color(*v)).collect();
            params.0.push(floats("C", BaseType::Color, Interp::Vertex, c));
        }
        for v in &used {
            scratch.local[*v as usize] = NONE;
        }
        scratch.used = used;
        scratch.used.clear();
        let shape = ShapeDesc::Mesh { subdivide: false, nverts: self.nverts.into(), verts: verts.into() };
        Some((shape, params))
    }

    /// Leaves out faces with vertices that do not exist, and references to normals and texture coordinates that do not
    /// exist.
    fn drop_faulty(&mut self, faults: &mut Faults<'_>) {
        let (normals, texcoords) = (self.place.table.normals.len(), self.place.table.texcoords.len());
        let (mut read, mut write, mut kept) = (0, 0, 0);
        for face in 0..self.nverts.len() {
            let n = self.nverts[face] as usize;
            let line = self.faces[face].0;
            let corners = &mut self.corners[read..read + n];
            let mut bad = None;
            for c in &mut *corners {
                if !self.place.table.has_position(c.v) {
                    bad = bad.or(Some(c.v));
                }
                if c.n != NONE && c.n as usize >= normals {
                    let (object, index) = (self.place.object, u64::from(c.n) + 1);
                    c.n = NONE;
                    faults.error("face normal", line, || {
                        let of = of_object(object);
                        format!("face refers to normal {index} of {normals}{of}: taken without normals")
                    });
                }
                if c.t != NONE && c.t as usize >= texcoords {
                    let (object, index) = (self.place.object, u64::from(c.t) + 1);
                    c.t = NONE;
                    faults.error("face texture", line, || {
                        let of = of_object(object);
                        format!(
                            "face refers to texture coordinate {index} of {texcoords}{of}: taken without them"
                        )
                    });
                }
            }
            if let Some(v) = bad {
                let (object, all) = (of_object(self.place.object), self.place.table.positions.len());
                let index = u64::from(v) + 1;
                if (v as usize) < all {
                    faults.error("face position", line, || {
                        format!("face refers to vertex {index}, which is not finite{object}: left out")
                    });
                } else {
                    faults.error("face vertex", line, || {
                        format!("face refers to vertex {index} of {all}{object}: left out")
                    });
                }
            } else {
                self.corners.copy_within(read..read + n, write);
                self.nverts[kept] = n as i32;
                self.faces[kept] = self.faces[face];
                write += n;
                kept += 1;
            }
            read += n;
        }
        self.corners.truncate(write);
        self.nverts.truncate(kept);
        self.faces.truncate(kept);
    }

    /// Numbers the used vertices in the order of their first use. Returns the number of each corner's vertex.
    fn renumber(&self, scratch: &mut Scratch) -> Vec<i32> {
        scratch.local.resize(self.place.table.positions.len(), NONE);
        let mut verts = Vec::with_capacity(self.corners.len());
        for c in &self.corners {
            let local = &mut scratch.local[c.v as usize];
            if *local == NONE {
                *local = scratch.used.len() as u32;
                scratch.used.push(c.v);
            }
            verts.push(*local as i32);
        }
        verts
    }

    /// Returns for each vertex of the mesh the one item that all its corners share; `None` unless every vertex has one.
    fn per_vertex(&self, verts: &[i32], n: usize, item: impl Fn(&Corner) -> u32) -> Option<Vec<u32>> {
        let mut of = vec![NONE; n];
        for (c, v) in self.corners.iter().zip(verts) {
            let (slot, this) = (&mut of[*v as usize], item(c));
            if this == NONE || (*slot != NONE && *slot != this) {
                return None;
            }
            *slot = this;
        }
        Some(of)
    }

    fn normals(&self, verts: &[i32], n: usize, params: &mut Params) {
        let table = &self.place.table.normals;
        let given = self.corners.iter().any(|c| c.n != NONE);
        let smooth = self.faces.iter().any(|(_, s)| *s != 0);
        if !given && !smooth {
            return;
        }
        let usable = |i: u32| {
            table[i as usize].iter().any(|x| *x != 0.0) && table[i as usize].iter().all(|x| x.is_finite())
        };
        if given
            && let Some(of) = self.per_vertex(verts, n, |c| c.n)
            && of.iter().all(|i| usable(*i))
        {
            let values: Vec<f32> = of.iter().flat_map(|i| table[*i as usize]).collect();
            params.0.push(floats("N", BaseType::Normal, Interp::Vertex, values));
            return;
        }
        // A corner without a normal gets the normal of its face, or that of the faces of its smoothing group at the
        // vertex.
        let flat = self.face_normals();
        let mut slots: HashMap<(i32, u32), Vec3> = HashMap::new();
        let mut start = 0;
        for (face, (_, group)) in self.faces.iter().enumerate() {
            let end = start + self.nverts[face] as usize;
            if *group != 0 {
                for v in &verts[start..end] {
                    *slots.entry((*v, *group)).or_default() += flat[face];
                }
            }
            start = end;
        }
        let mut values = Vec::with_capacity(self.corners.len() * 3);
        let mut corner = 0;
        for (face, (_, group)) in self.faces.iter().enumerate() {
            for _ in 0..self.nverts[face] {
                let c = self.corners[corner];
                let normal = if c.n != NONE && usable(c.n) {
                    Vec3::from(table[c.n as usize])
                } else {
                    let around = slots.get(&(verts[corner], *group)).copied();
                    around.unwrap_or(flat[face]).normalize_or(Vec3::Z)
                };
                values.extend(normal.to_array());
                corner += 1;
            }
        }
        params.0.push(floats("N", BaseType::Normal, Interp::Linear, values));
    }

    /// Returns the normals of the faces. Their length is twice the area (Newell's sum, which also exists for polygons
    /// that are not flat).
    fn face_normals(&self) -> Vec<Vec3> {
        let mut start = 0;
        let normal = |n: &i32| {
            let corners = &self.corners[start..start + *n as usize];
            start += *n as usize;
            let at = |i: usize| Vec3::from(self.place.table.positions[corners[i].v as usize]);
            let origin = at(0);
            (1..corners.len() - 1).map(|i| (at(i) - origin).cross(at(i + 1) - origin)).sum()
        };
        self.nverts.iter().map(normal).collect()
    }

    fn texture_coordinates(&self, verts: &[i32], n: usize, params: &mut Params) {
        if self.corners.iter().all(|c| c.t == NONE) {
            return;
        }
        let st = |i: u32| {
            let uv = if i == NONE { [0.0; 2] } else { self.place.table.texcoords[i as usize] };
            let st = self.place.material.map_or([uv[0], 1.0 - uv[1]], |m| m.st(uv));
            st.map(|x| if x.is_finite() { x } else { 0.0 })
        };
        let (interp, items) = match self.per_vertex(verts, n, |c| c.t) {
            Some(of) => (Interp::Vertex, of),
            None => (Interp::Linear, self.corners.iter().map(|c| c.t).collect()),
        };
        let s: Vec<f32> = items.iter().map(|i| st(*i)[0]).collect();
        let t: Vec<f32> = items.iter().map(|i| st(*i)[1]).collect();
        params.0.push(floats("s", BaseType::Float, interp, s));
        params.0.push(floats("t", BaseType::Float, interp, t));
    }
}
