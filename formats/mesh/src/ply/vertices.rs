//! The vertices of a PLY file, and the parameters that their properties become.

use super::header::{Element, Encoding, Kind};
use super::values::{Fault, Values};
use crate::emit::{float, floats};
use granita_base::{BaseType, Interp, Param};

/// The names of the supported properties of a vertex. The index in the list is the slot of the value.
const SLOTS: [&[&str]; 14] = [
    &["x"],
    &["y"],
    &["z"],
    &["nx", "normal_x"],
    &["ny", "normal_y"],
    &["nz", "normal_z"],
    &["s", "u", "texture_u", "texture_s"],
    &["t", "v", "texture_v", "texture_t"],
    &["red", "r", "diffuse_red"],
    &["green", "g", "diffuse_green"],
    &["blue", "b", "diffuse_blue"],
    &["alpha", "a", "diffuse_alpha"],
    &["radius"],
    &["width"],
];
const NORMAL: usize = 3;
const TEXTURE: usize = 6;
const RED: usize = 8;
const ALPHA: usize = 11;
const RADIUS: usize = 12;
const WIDTH: usize = 13;

/// The columns of the vertices, with the values that were read.
#[derive(Debug, Default)]
pub(super) struct Vertices {
    /// The slot of each property, and the divisor of its value.
    plan: Vec<Option<(usize, f32)>>,
    has: [bool; 14],
    /// `P`, with three numbers each. They are NaN where a vertex is faulty.
    pub(super) p: Vec<f32>,
    n: Vec<f32>,
    s: Vec<f32>,
    t: Vec<f32>,
    c: Vec<f32>,
    opacity: Vec<f32>,
    width: Vec<f32>,
    /// True when some vertices are faulty.
    pub(super) faulty: bool,
}

impl Vertices {
    /// Returns the columns for an element of vertices; `None` when it has no positions.
    pub(super) fn new(element: &Element, encoding: Encoding, bytes: u64) -> Option<Self> {
        let mut vertices = Self { plan: vec![None; element.properties.len()], ..Self::default() };
        for (slot, names) in SLOTS.iter().enumerate() {
            let Some(i) = element.property(names) else { continue };
            let Kind::Scalar(ty) = element.properties[i].kind else { continue };
            let one = if (RED..=ALPHA).contains(&slot) { ty.one() } else { 1.0 };
            if vertices.plan[i].is_none() {
                vertices.plan[i] = Some((slot, one));
                vertices.has[slot] = true;
            }
        }
        if !vertices.all(0, 3) {
            return None;
        }
        // The reserved memory is limited to the vertices that the file can hold, for any header.
        let most = bytes / element.least_bytes(encoding).max(1);
        vertices.p.reserve(element.count.min(most) as usize * 3);
        Some(vertices)
    }

    fn all(&self, first: usize, n: usize) -> bool {
        self.has[first..first + n].iter().all(|x| *x)
    }

    pub(super) fn len(&self) -> usize {
        self.p.len() / 3
    }

    /// Reads the next vertex. A line that is too short makes a faulty vertex, and is not an error.
    pub(super) fn read(&mut self, element: &Element, values: &mut impl Values) -> Result<bool, Fault> {
        let mut slots = [0.0_f32; 14];
        values.begin()?;
        let mut good = true;
        for (property, plan) in element.properties.iter().zip(&self.plan) {
            let read = match property.kind {
                Kind::Scalar(ty) => values.value(ty).map(|value| {
                    if let Some((slot, one)) = plan {
                        slots[*slot] = value as f32 / one;
                    }
                }),
                Kind::List { count, item } => super::skip_list(values, count, item),
            };
            match read {
                Ok(()) => {}
                Err(Fault::Short) => {
                    good = false;
                    break;
                }
                Err(other) => return Err(other),
            }
        }
        good &= slots[..3].iter().all(|x| x.is_finite());
        if !good {
            slots[..3].fill(f32::NAN);
            self.faulty = true;
        }
        self.push(&slots);
        Ok(good)
    }

    fn push(&mut self, slots: &[f32; 14]) {
        let finite = |x: f32, instead: f32| if x.is_finite() { x } else { instead };
        self.p.extend_from_slice(&slots[..3]);
        if self.all(NORMAL, 3) {
            let n = &slots[NORMAL..NORMAL + 3];
            let usable = n.iter().all(|x| x.is_finite()) && n.iter().any(|x| *x != 0.0);
            self.n.extend_from_slice(if usable { n } else { &[0.0, 0.0, 1.0] });
        }
        if self.all(TEXTURE, 2) {
            self.s.push(finite(slots[TEXTURE], 0.0));
            self.t.push(1.0 - finite(slots[TEXTURE + 1], 0.0));
        }
        if self.all(RED, 3) {
            self.c.extend(slots[RED..RED + 3].iter().map(|x| finite(*x, 1.0)));
        }
        if self.has[ALPHA] {
            self.opacity.extend([finite(slots[ALPHA], 1.0); 3]);
        }
        if self.has[WIDTH] {
            self.width.push(finite(slots[WIDTH], 0.0));
        } else if self.has[RADIUS] {
            self.width.push(finite(slots[RADIUS], 0.0) * 2.0);
        }
    }

    /// Leaves out the faulty vertices, for particles.
    pub(super) fn drop_faulty(&mut self) {
        if !self.faulty {
            return;
        }
        let good: Vec<bool> = self.p.chunks_exact(3).map(|p| !p[0].is_nan()).collect();
        let columns = [
            (&mut self.p, 3),
            (&mut self.n, 3),
            (&mut self.s, 1),
            (&mut self.t, 1),
            (&mut self.c, 3),
            (&mut self.opacity, 3),
            (&mut self.width, 1),
        ];
        for (column, width) in columns {
            let mut at = 0;
            column.retain(|_| {
                at += 1;
                good[(at - 1) / width]
            });
        }
    }

    /// Moves faulty vertices, to which no face refers any more, to the origin.
    pub(super) fn bury_faulty(&mut self) {
        if self.faulty {
            self.p.iter_mut().filter(|x| x.is_nan()).for_each(|x| *x = 0.0);
        }
    }

    /// Returns the width of each particle; `None` when the file does not give it.
    pub(super) fn take_width(&mut self) -> Option<Param> {
        let width = std::mem::take(&mut self.width);
        (!width.is_empty()).then(|| floats("width", BaseType::Float, Interp::Vertex, width))
    }

    /// Returns all parameters except positions and widths. Texture coordinates are left out when the corners of faces
    /// have their own (`wedges`).
    pub(super) fn params(self, wedges: bool) -> impl Iterator<Item = Param> {
        let (s, t) = if wedges { (Vec::new(), Vec::new()) } else { (self.s, self.t) };
        // Without opacity, everything is opaque.
        let opacity = if self.opacity.iter().all(|x| *x == 1.0) { Vec::new() } else { self.opacity };
        let columns = [
            ("N", BaseType::Normal, self.n),
            ("s", BaseType::Float, s),
            ("t", BaseType::Float, t),
            ("C", BaseType::Color, self.c),
            ("opacity", BaseType::Color, opacity),
        ];
        let given = columns.into_iter().filter(|(_, _, values)| !values.is_empty());
        given.map(|(name, base, values)| floats(name, base, Interp::Vertex, values))
    }
}

/// Returns one width for all particles, in pixels, for a file that does not give it.
pub(super) fn default_width() -> Param {
    float("rasterwidth", crate::emit::POINT_PIXELS)
}
