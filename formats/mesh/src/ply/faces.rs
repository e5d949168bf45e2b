//! The faces of a PLY file.

use super::header::{Element, Kind};
use super::values::{Fault, Values};
use crate::emit::floats;
use granita_base::{BaseType, Interp, Param};

/// The indices of the properties of faces; `None` where a property is missing.
#[derive(Debug, Default)]
pub(super) struct FacePlan {
    indices: Option<usize>,
    texcoord: Option<usize>,
    color: Option<([usize; 3], f32)>,
}

impl FacePlan {
    /// Returns `None` when the element has no lists of vertices.
    pub(super) fn new(element: &Element) -> Option<Self> {
        let list = |names: &[&str]| {
            element.property(names).filter(|i| matches!(element.properties[*i].kind, Kind::List { .. }))
        };
        let scalar = |names: &[&str]| {
            let i = element.property(names)?;
            let Kind::Scalar(ty) = element.properties[i].kind else { return None };
            Some((i, ty.one()))
        };
        let color = match (scalar(&["red", "r"]), scalar(&["green", "g"]), scalar(&["blue", "b"])) {
            (Some((r, one)), Some((g, _)), Some((b, _))) => Some(([r, g, b], one)),
            _ => None,
        };
        let indices = Some(list(&["vertex_indices", "vertex_index"])?);
        Some(Self { indices, texcoord: list(&["texcoord"]), color })
    }
}

/// An error in one face. The others are not affected.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Wrong {
    /// The line does not have enough numbers.
    Short,
    /// The face has this number of corners, which is less than three.
    Few(usize),
    /// The face refers to this vertex, which does not exist.
    Vertex(f64),
    /// A list has this length, which is invalid.
    Length(f64),
}

/// All faces of the file.
#[derive(Debug, Default)]
pub(super) struct Faces {
    pub(super) nverts: Vec<i32>,
    pub(super) verts: Vec<i32>,
    /// Two numbers for each corner, or none at all.
    texcoords: Vec<f32>,
    /// Three numbers for each face, or none at all.
    colors: Vec<f32>,
    /// The line of the first face.
    pub(super) line: u32,
    wedge: Vec<f32>,
}

impl Faces {
    /// Reads the next face, of an element `face`. `vertices` is the number of vertices. Returns `Ok (Err)` when the
    /// face is left out.
    pub(super) fn read(
        &mut self,
        plan: &FacePlan,
        element: &Element,
        vertices: u64,
        values: &mut impl Values,
    ) -> Result<Result<(), Wrong>, Fault> {
        values.begin()?;
        let start = self.verts.len();
        self.wedge.clear();
        let mut color = [0.0; 3];
        let mut wrong = None;
        for (i, property) in element.properties.iter().enumerate() {
            let read = match property.kind {
                Kind::Scalar(ty) => values.value(ty).map(|value| {
                    if let Some((at, one)) = plan.color
                        && let Some(k) = at.iter().position(|c| *c == i)
                    {
                        color[k] = value as f32 / one;
                    }
                }),
                Kind::List { count, item } => {
                    let length = match values.value(count) {
                        Ok(length) if length >= 0.0 && length.fract() == 0.0 => length as u64,
                        Ok(length) => {
                            // The positions of the following values on this line, or in a binary file, are unknown.
                            self.verts.truncate(start);
                            return Ok(Err(Wrong::Length(length)));
                        }
                        Err(Fault::Short) => {
                            wrong = Some(Wrong::Short);
                            break;
                        }
                        Err(other) => return self.forget(start, other),
                    };
                    let mut read = Ok(());
                    for _ in 0..length {
                        match values.value(item) {
                            Ok(value) if Some(i) == plan.indices => {
                                if value >= 0.0 && value < vertices as f64 && value <= f64::from(i32::MAX) {
                                    self.verts.push(value as i32);
                                } else {
                                    wrong = wrong.or(Some(Wrong::Vertex(value)));
                                }
                            }
                            Ok(value) if Some(i) == plan.texcoord => self.wedge.push(value as f32),
                            Ok(_) => {}
                            Err(fault) => {
                                read = Err(fault);
                                break;
                            }
                        }
                    }
                    read
                }
            };
            match read {
                Ok(()) => {}
                Err(Fault::Short) => {
                    wrong = Some(Wrong::Short);
                    break;
                }
                Err(other) => return self.forget(start, other),
            }
        }
        let n = self.verts.len() - start;
        if wrong.is_none() && n < 3 {
            wrong = Some(Wrong::Few(n));
        }
        if let Some(wrong) = wrong {
            self.verts.truncate(start);
            return Ok(Err(wrong));
        }
        if self.nverts.is_empty() {
            self.line = values.line();
        }
        self.nverts.push(n as i32);
        if plan.texcoord.is_some() {
            let full = self.wedge.len() >= 2 * n;
            let corner = |i: usize| if full && self.wedge[i].is_finite() { self.wedge[i] } else { 0.0 };
            self.texcoords.extend((0..2 * n).map(corner));
        }
        if plan.color.is_some() {
            self.colors.extend(color.map(|x: f32| if x.is_finite() { x } else { 1.0 }));
        }
        Ok(Ok(()))
    }

    fn forget<T>(&mut self, start: usize, fault: Fault) -> Result<T, Fault> {
        self.verts.truncate(start);
        Err(fault)
    }

    /// Reads the next strips, of an element `tristrips`. -1 ends a strip.
    pub(super) fn read_strips(
        &mut self,
        plan: &FacePlan,
        element: &Element,
        vertices: u64,
        values: &mut impl Values,
    ) -> Result<Result<(), Wrong>, Fault> {
        values.begin()?;
        if self.nverts.is_empty() {
            self.line = values.line();
        }
        let mut wrong = None;
        for (i, property) in element.properties.iter().enumerate() {
            let (count, item) = match property.kind {
                Kind::List { count, item } if Some(i) == plan.indices => (count, item),
                Kind::List { count, item } => {
                    super::skip_list(values, count, item)?;
                    continue;
                }
                Kind::Scalar(ty) => {
                    values.value(ty)?;
                    continue;
                }
            };
            let length = values.value(count)?;
            if !(length >= 0.0 && length.fract() == 0.0) {
                return Ok(Err(Wrong::Length(length)));
            }
            let (mut last, mut odd) = ([None; 2], false);
            for _ in 0..length as u64 {
                let value = values.value(item)?;
                if value < 0.0 {
                    (last, odd) = ([None; 2], false);
                    continue;
                }
                if value.is_nan() || value >= vertices as f64 || value > f64::from(i32::MAX) {
                    wrong = wrong.or(Some(Wrong::Vertex(value)));
                    (last, odd) = ([None; 2], false);
                    continue;
                }
                let v = value as i32;
                if let [Some(a), Some(b)] = last {
                    // Repeated vertices join strips. They do not form triangles.
                    if a != b && b != v && a != v {
                        self.nverts.push(3);
                        self.verts.extend(if odd { [b, a, v] } else { [a, b, v] });
                    }
                    odd = !odd;
                }
                last = [last[1], Some(v)];
            }
        }
        Ok(wrong.map_or(Ok(()), Err))
    }

    /// Leaves out faces with a vertex for which `good` returns false. Returns their number.
    pub(super) fn retain(&mut self, good: impl Fn(i32) -> bool) -> usize {
        let (mut read, mut write, mut kept) = (0, 0, 0);
        let all = self.nverts.len();
        for face in 0..all {
            let n = self.nverts[face] as usize;
            if self.verts[read..read + n].iter().all(|v| good(*v)) {
                self.verts.copy_within(read..read + n, write);
                if !self.texcoords.is_empty() {
                    self.texcoords.copy_within(2 * read..2 * (read + n), 2 * write);
                }
                if !self.colors.is_empty() {
                    self.colors.copy_within(3 * face..3 * face + 3, 3 * kept);
                }
                self.nverts[kept] = n as i32;
                (write, kept) = (write + n, kept + 1);
            }
            read += n;
        }
        self.verts.truncate(write);
        self.nverts.truncate(kept);
        self.texcoords.truncate(2 * write);
        self.colors.truncate(3 * kept);
        all - kept
    }

    /// Removes texture coordinates and colours unless all faces have them. A file may have several elements of faces.
    pub(super) fn check_columns(&mut self) {
        if self.texcoords.len() != 2 * self.verts.len() {
            self.texcoords.clear();
        }
        if self.colors.len() != 3 * self.nverts.len() {
            self.colors.clear();
        }
    }

    /// True when corners have texture coordinates of their own.
    pub(super) fn has_texcoords(&self) -> bool {
        !self.texcoords.is_empty()
    }

    /// True when faces have colours.
    pub(super) fn has_colors(&self) -> bool {
        !self.colors.is_empty()
    }

    /// Returns the texture coordinates and the colours.
    pub(super) fn params(&mut self) -> Vec<Param> {
        let mut all = Vec::new();
        if self.has_texcoords() {
            let s: Vec<f32> = self.texcoords.iter().step_by(2).copied().collect();
            let t: Vec<f32> = self.texcoords.iter().skip(1).step_by(2).map(|t| 1.0 - t).collect();
            all.push(floats("s", BaseType::Float, Interp::Linear, s));
            all.push(floats("t", BaseType::Float, Interp::Linear, t));
        }
        if self.has_colors() {
            let colors = std::mem::take(&mut self.colors);
            all.push(floats("C", BaseType::Color, Interp::PerPiece, colors));
        }
        all
    }
}
