//! The primitives of meshes, which become shapes with their parameters.

use super::accessor::Reader;
use super::document::Primitive;
use super::material::Look;
use super::scene::Matrix;
use super::skin;
use crate::emit::{floats, lines, points, positions};
use crate::faults::Faults;
use granita_base::{BaseType, Interp, Param, Params, ShapeDesc, Vec3};

/// A shape and the index of its material.
#[derive(Clone, Debug)]
pub(super) struct Built {
    pub(super) shape: ShapeDesc,
    pub(super) params: Params,
    pub(super) material: Option<usize>,
}

/// A primitive, and its description in messages (`what`).
pub(super) struct Source<'a> {
    pub(super) primitive: &'a Primitive,
    pub(super) look: Look,
    /// The matrices of the joints, for a mesh with a skin.
    pub(super) joints: Option<&'a [Matrix]>,
    /// The weights of the morph targets at rest.
    pub(super) weights: &'a [f32],
    pub(super) what: String,
}

impl Source<'_> {
    /// Returns the shape; `None` when there is nothing to draw. Elements with errors are left out.
    ///
    /// # Errors
    /// Returns a text when the primitive cannot be read at all.
    pub(super) fn build(
        &self,
        reader: &mut Reader<'_>,
        faults: &mut Faults<'_>,
    ) -> Result<Option<Built>, String> {
        let primitive = self.primitive;
        let position = *primitive.attributes.get("POSITION").ok_or("it has no POSITION")?;
        reader.begin(primitive)?;
        let count = reader.count(position)?;
        let (indices, mode) = match (reader.decoded_indices(), primitive.indices) {
            // Strips are decoded as triangles.
            (Some(indices), _) => (Some(indices), 4),
            (None, Some(index)) => (Some(reader.indices(index)?), primitive.mode.unwrap_or(4)),
            (None, None) => (None, primitive.mode.unwrap_or(4)),
        };
        // Only the vertices between the first and the last used one are read, because many primitives may share one
        // array.
        if count > u64::from(u32::MAX) {
            return Err(format!("{count} vertices are more than indices can name"));
        }
        let range = match &indices {
            None => 0..count,
            Some(indices) => {
                let good = || indices.iter().map(|i| u64::from(*i)).filter(|i| *i < count);
                match (good().min(), good().max()) {
                    (Some(min), Some(max)) => min..max + 1,
                    _ => {
                        if !indices.is_empty() {
                            self.bad_index(count, faults);
                        }
                        return Ok(None);
                    }
                }
            }
        };
        let (mut p, _) = reader.floats(position, &[3], range.clone())?;
        self.morph("POSITION", &mut p, reader, &range)?;
        let blend = match self.joints {
            Some(joints) => Some(skin::blend(primitive, joints, &range, reader)?),
            None => None,
        };
        for (p, matrix) in p.chunks_exact_mut(3).zip(blend.iter().flatten()) {
            matrix.iter().for_each(|m| skin::point(m, p));
        }
        let usable = |i: u64| {
            let at = (i - range.start) as usize * 3;
            p[at..at + 3].iter().all(|x| x.is_finite())
        };
        let good = |i: &u32| range.contains(&u64::from(*i)) && usable(u64::from(*i));
        let sequence = indices.unwrap_or_else(|| (0..count as u32).collect());
        let elements = elements(mode, sequence)?;
        let (verts, dropped) = elements.keep(good);
        if dropped {
            self.bad_index(count, faults);
        }
        if verts.is_empty() {
            return Ok(None);
        }
        let (used, local) = renumber(&verts, &range);
        let mut columns = self.columns(reader, &range, &used, faults);
        if let (Some(blend), Some(("N", _, _, n))) = (&blend, columns.first_mut()) {
            for (n, vertex) in n.chunks_exact_mut(3).zip(&used) {
                blend[*vertex as usize].iter().for_each(|m| skin::normal(m, n));
            }
        }
        let p = pick(&p, 3, &used);
        let (shape, mut params) = match elements.kind {
            ElementKind::Triangles => {
                if self.look.has_normals {
                    columns.extend(tangents(&p, &columns, &local).into_iter().flatten());
                }
                let nverts = vec![3; local.len() / 3];
                let verts: Vec<i32> = local.iter().map(|i| *i as i32).collect();
                let shape = ShapeDesc::Mesh { subdivide: false, nverts: nverts.into(), verts: verts.into() };
                (shape, Params(vec![positions(p)]))
            }
            ElementKind::Lines(nverts) => {
                let (shape, params) = lines(pick(&p, 3, &local), nverts);
                let columns = columns.into_iter().map(|(name, base, width, values)| {
                    floats(name, base, Interp::Vertex, pick(&values, width, &local))
                });
                // Normals would turn the lines into ribbons.
                let params = params.0.into_iter().chain(columns.filter(|p| &*p.name != "N")).collect();
                return Ok(Some(Built { shape, params, material: primitive.material }));
            }
            ElementKind::Points => points(p),
        };
        params.0.extend(columns.into_iter().map(column));
        Ok(Some(Built { shape, params, material: primitive.material }))
    }

    /// Adds the morph targets at their weights to the values of an attribute, three for each vertex of `range`.
    /// Returns true when there was anything to add.
    fn morph(
        &self,
        name: &str,
        values: &mut [f32],
        reader: &mut Reader<'_>,
        range: &std::ops::Range<u64>,
    ) -> Result<bool, String> {
        let mut added = false;
        for (i, (target, weight)) in self.primitive.targets.iter().zip(self.weights).enumerate() {
            let Some(accessor) = target.get(name).filter(|_| *weight != 0.0 && weight.is_finite()) else {
                continue;
            };
            let read = reader.floats(*accessor, &[3], range.clone());
            let (differences, _) = read.map_err(|why| format!("morph target {i}: {name}: {why}"))?;
            values.iter_mut().zip(&differences).for_each(|(v, d)| *v += weight * d);
            added = true;
        }
        Ok(added)
    }

    fn bad_index(&self, count: u64, faults: &mut Faults<'_>) {
        faults.error("index", 0, || {
            format!("{}: elements that refer to vertices that do not exist (of {count}), or are not finite: left out", self.what)
        });
    }

    /// Returns all parameters except positions, with their name, type, number of values per vertex, and values of the
    /// used vertices.
    fn columns(
        &self,
        reader: &mut Reader<'_>,
        range: &std::ops::Range<u64>,
        used: &[u32],
        faults: &mut Faults<'_>,
    ) -> Vec<Column> {
        let mut columns = Vec::new();
        let mut read = |name: &str, widths: &[usize]| {
            let index = *self.primitive.attributes.get(name)?;
            let values = reader.floats(index, widths, range.clone()).and_then(|(mut values, n)| {
                if name == "NORMAL" && self.morph(name, &mut values, reader, range)? {
                    values.chunks_exact_mut(3).for_each(normalize);
                }
                Ok((values, n))
            });
            match values {
                Ok((values, n)) => Some((pick(&values, n, used), n)),
                Err(why) => {
                    faults.error("attribute", 0, || format!("{}: {name}: {why}: left out", self.what));
                    None
                }
            }
        };
        if let Some((n, _)) = read("NORMAL", &[3]) {
            let usable = |n: &[f32]| n.iter().all(|x| x.is_finite()) && n.iter().any(|x| *x != 0.0);
            if n.chunks_exact(3).all(usable) {
                columns.push(("N", BaseType::Normal, 3, n));
            }
        }
        let texcoord = self.look.texcoord.and_then(|set| read(&format!("TEXCOORD_{set}"), &[2]));
        if let Some((uv, _)) = texcoord {
            let st = uv.chunks_exact(2).map(|uv| self.look.transform.apply([uv[0], uv[1]]));
            let st = st.map(|st| st.map(|x| if x.is_finite() { x } else { 0.0 }));
            let (s, t) = st.map(|[s, t]| (s, t)).unzip();
            columns.push(("s", BaseType::Float, 1, s));
            columns.push(("t", BaseType::Float, 1, t));
        }
        if let Some((c, n)) = read("COLOR_0", &[3, 4]) {
            let scaled =
                |x: f32, k: usize| if x.is_finite() { x * self.look.base[k] } else { self.look.base[k] };
            let rgb =
                c.chunks_exact(n).flat_map(|c| [scaled(c[0], 0), scaled(c[1], 1), scaled(c[2], 2)]).collect();
            columns.push(("C", BaseType::Color, 3, rgb));
            if n == 4 && self.look.blends {
                let alpha = c.chunks_exact(4).flat_map(|c| [scaled(c[3], 3); 3]).collect();
                columns.push(("opacity", BaseType::Color, 3, alpha));
            }
        }
        columns
    }
}

/// Returns the directions in which the texture coordinates "s" and "t" grow at each vertex. They are the means of its
/// triangles, weighted by their areas. Zero where the coordinates do not change. Returns `None` without texture
/// coordinates.
fn tangents(p: &[f32], columns: &[Column], triangles: &[u32]) -> Option<[Column; 2]> {
    let of = |name: &str| columns.iter().find(|c| c.0 == name).map(|c| &c.3[..]);
    let (s, t) = (of("s")?, of("t")?);
    let p = p.as_chunks::<3>().0;
    let mut sums = [vec![Vec3::ZERO; p.len()], vec![Vec3::ZERO; p.len()]];
    for triangle in triangles.as_chunks::<3>().0 {
        let [a, b, c] = triangle.map(|v| v as usize);
        let side = |v: usize| (Vec3::from(p[v]) - Vec3::from(p[a]), s[v] - s[a], t[v] - t[a]);
        let ((e1, s1, t1), (e2, s2, t2)) = (side(b), side(c));
        let turn = (s1 * t2 - s2 * t1).signum();
        let area = e1.cross(e2).length();
        let along = [(e1 * t2 - e2 * t1) * turn, (e2 * s1 - e1 * s2) * turn];
        for (sum, along) in sums.iter_mut().zip(along) {
            let along = along.normalize_or_zero() * area;
            [a, b, c].into_iter().for_each(|v| sum[v] += along);
        }
    }
    let column = |name, sums: Vec<Vec3>| {
        let values = sums.into_iter().flat_map(|v| v.normalize_or_zero().to_array()).collect();
        (name, BaseType::Vector, 3, values)
    };
    let [along, down] = sums;
    Some([column("tangent", along), column("bitangent", down)])
}

fn normalize(v: &mut [f32]) {
    let length = v.iter().map(|x| x * x).sum::<f32>().sqrt();
    if length > 0.0 && length.is_finite() {
        v.iter_mut().for_each(|x| *x /= length);
    }
}

type Column = (&'static str, BaseType, usize, Vec<f32>);

fn column((name, base, _, values): Column) -> Param {
    floats(name, base, Interp::Vertex, values)
}

/// Returns the items `which` of a list with `n` numbers per item.
fn pick(values: &[f32], n: usize, which: &[u32]) -> Vec<f32> {
    which.iter().flat_map(|i| &values[*i as usize * n..(*i as usize + 1) * n]).copied().collect()
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum ElementKind {
    Triangles,
    /// Lines with this number of vertices each.
    Lines(usize),
    Points,
}

/// The vertices of elements of one size, one element after the other.
struct Elements {
    kind: ElementKind,
    verts: Vec<u32>,
}

impl Elements {
    /// Returns the vertices of the elements in which all vertices are good, and true when other elements were left out.
    fn keep(&self, good: impl Fn(&u32) -> bool) -> (Vec<u32>, bool) {
        let n = match self.kind {
            ElementKind::Triangles => 3,
            ElementKind::Lines(n) => n,
            ElementKind::Points => 1,
        };
        let mut kept = Vec::with_capacity(self.verts.len());
        for element in self.verts.chunks_exact(n) {
            if element.iter().all(&good) {
                kept.extend_from_slice(element);
            }
        }
        let dropped = kept.len() < self.verts.len();
        (kept, dropped)
    }
}

/// Returns the elements that a mode of OpenGL makes of a sequence of vertices. Remaining vertices at the end are
/// ignored.
fn elements(mode: u32, mut v: Vec<u32>) -> Result<Elements, String> {
    let whole = |mut v: Vec<u32>, n: usize| {
        v.truncate(v.len() / n * n);
        v
    };
    let (kind, verts) = match mode {
        0 => (ElementKind::Points, v),
        1 => (ElementKind::Lines(2), whole(v, 2)),
        2 | 3 => {
            if mode == 2 {
                v.extend(v.first().copied());
            }
            // The line is one curve. With fewer than two vertices there is none.
            if v.len() < 2 {
                v.clear();
            }
            (ElementKind::Lines(v.len().max(2)), v)
        }
        4 => (ElementKind::Triangles, whole(v, 3)),
        5 => {
            let strip = v.windows(3).enumerate();
            let turned =
                strip.flat_map(|(i, w)| if i % 2 == 0 { [w[0], w[1], w[2]] } else { [w[0], w[2], w[1]] });
            (ElementKind::Triangles, turned.collect())
        }
        6 => {
            let first = v.first().copied().unwrap_or(0);
            let fan = v.get(1..).unwrap_or_default().windows(2).flat_map(|w| [w[0], w[1], first]);
            (ElementKind::Triangles, fan.collect())
        }
        _ => return Err(format!("unknown mode {mode}")),
    };
    Ok(Elements { kind, verts })
}

/// Returns the used vertices, counted from the beginning of the range, in the order of the file. The second list is
/// `verts` as indices into the first one.
fn renumber(verts: &[u32], range: &std::ops::Range<u64>) -> (Vec<u32>, Vec<u32>) {
    let mut local = vec![u32::MAX; (range.end - range.start) as usize];
    for v in verts {
        local[(u64::from(*v) - range.start) as usize] = 0;
    }
    let mut used = Vec::new();
    for (i, slot) in local.iter_mut().enumerate() {
        if *slot == 0 {
            *slot = used.len() as u32;
            used.push(i as u32);
        }
    }
    let verts = verts.iter().map(|v| local[(u64::from(*v) - range.start) as usize]).collect();
    (used, verts)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modes() {
        let verts = |mode, n: u32| elements(mode, (0..n).collect()).unwrap().verts;
        assert_eq!(verts(4, 7), [0, 1, 2, 3, 4, 5]);
        assert_eq!(verts(5, 5), [0, 1, 2, 1, 3, 2, 2, 3, 4]);
        assert_eq!(verts(6, 5), [1, 2, 0, 2, 3, 0, 3, 4, 0]);
        assert_eq!(verts(1, 5), [0, 1, 2, 3]);
        assert_eq!(verts(2, 3), [0, 1, 2, 0]);
        assert_eq!(elements(3, vec![0, 1, 2]).unwrap().kind, ElementKind::Lines(3));
        for mode in 0..7 {
            for n in 0..if mode == 0 { 1 } else { 2 } {
                assert!(mode == 2 && n == 1 || verts(mode, n).is_empty(), "{mode} {n}");
            }
        }
        assert!(elements(7, vec![0, 1, 2]).is_err());
    }

    #[test]
    fn vertices_that_are_not_used_are_left_out() {
        assert_eq!(renumber(&[7, 5, 9, 5, 7, 9], &(5..10)), (vec![0, 2, 4], vec![1, 0, 2, 0, 1, 2]));
    }
}
