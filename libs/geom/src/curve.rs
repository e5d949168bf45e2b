//! The curves of a primitive, which are evaluated one at a time.

use crate::bezier::{MAX_DEGREE, bernstein, bernstein_derivative, symmetric_sum, symmetric_sums};
use crate::net::hull;
use crate::range::{Place, Range};
use crate::spline::Spline;
use crate::vars::{Control, Vars};
use crate::width::Widths;
use granita_base::{Bound, Vec3};

/// All curves of a primitive.
pub(crate) struct Curves {
    pub(crate) times: Vec<f32>,
    pub(crate) spline: Spline,
    /// The number of control vertices of a curve.
    pub(crate) nverts: usize,
    pub(crate) control: Control,
    pub(crate) vars: Vars,
    /// The widths for each key.
    pub(crate) widths: Vec<Widths>,
    /// The indices of the curves that can be drawn, ordered so that neighbours are together.
    pub(crate) order: Vec<u32>,
    /// For each motion key: the boxes around the whole curves, in that order.
    pub(crate) bounds: Vec<Vec<Bound>>,
}

/// The evaluated values at places of a curve.
#[derive(Default)]
pub(crate) struct Points {
    /// For each place: the control channels, divided by weights, and the vertex widths. Variables are 0 unless they
    /// were requested.
    pub(crate) values: Vec<f64>,
    /// For each place: the derivative along v at each of the keys.
    pub(crate) tangents: Vec<Vec3>,
    /// For each place: the width at each of the keys.
    pub(crate) widths: Vec<f32>,
    /// For each place: the parameter along the curve.
    pub(crate) v: Vec<f64>,
}

/// Evaluates places of a curve.
pub(crate) struct Evaluator<'a> {
    all: &'a Curves,
    curve: usize,
    /// The motion keys for which tangents and widths are evaluated.
    keys: std::ops::Range<usize>,
    /// The number of control channels that are evaluated.
    channels: usize,
    /// The Bezier vertices of a segment with an even and one with an odd index. Neighbours are in different ones.
    nets: [(Option<u32>, Vec<f64>); 2],
    out: Points,
}

impl Curves {
    /// Gathers the Bezier vertices of a segment: the control channels, then the vertex widths of each key.
    fn gather(&self, curve: usize, segment: u32, out: &mut Vec<f64>) {
        let s = &self.spline.segments[segment as usize];
        let (m, c, stride) = (self.spline.degree + 1, self.control.channels, self.stride());
        out.clear();
        out.resize(m * stride, 0.0);
        let own_widths = self.widths.iter().any(|widths| matches!(widths, Widths::Vertex(_)));
        if s.matrix.is_none() && !own_widths {
            for (j, at) in out.chunks_exact_mut(stride).enumerate() {
                let vertex = self.control.vertex(curve * self.nverts + s.first + j);
                // A sum of zero and a negative zero is zero, as below.
                at.iter_mut().zip(vertex).for_each(|(o, x)| *o = 0.0 + x);
            }
            return;
        }
        for j in 0..m {
            for k in 0..m {
                let w = s.matrix.as_ref().map_or(f64::from(u8::from(j == k)), |w| w[j * m + k]);
                if w == 0.0 {
                    continue;
                }
                let index = curve * self.nverts + s.first + k;
                let vertex = self.control.vertex(index);
                let at = &mut out[j * stride..][..stride];
                for (o, x) in at.iter_mut().zip(vertex) {
                    *o += w * x;
                }
                let weight = if self.control.dim == 4 { vertex[3] } else { 1.0 };
                for (o, widths) in at[c..].iter_mut().zip(&self.widths) {
                    if let Widths::Vertex(list) = widths {
                        *o += w * f64::from(list[index]) * weight;
                    }
                }
            }
        }
    }

    pub(crate) fn stride(&self) -> usize {
        self.control.channels + self.times.len()
    }

    /// Returns the width at a key and a fraction along the curve, when it is not interpolated like the vertices.
    fn width(&self, key: usize, curve: usize, fraction: f64) -> Option<f64> {
        match &self.widths[key] {
            Widths::Constant(w) => Some(f64::from(*w)),
            Widths::PerPiece(list) => Some(f64::from(list[curve])),
            Widths::Linear(list) => {
                let [a, b] = [list[2 * curve], list[2 * curve + 1]].map(f64::from);
                Some(a * (1.0 - fraction) + b * fraction)
            }
            Widths::Vertex(_) => None,
        }
    }

    /// Returns the same place as the end of the neighbouring segment, if there is one.
    fn beside(&self, place: Place) -> Option<Place> {
        if place.b == 0.0 && place.segment > 0 {
            Some(Place { segment: place.segment - 1, a: 0.0, b: 1.0 })
        } else if place.a == 0.0 && place.segment + 1 < self.spline.count() {
            Some(Place { segment: place.segment + 1, a: 1.0, b: 0.0 })
        } else {
            None
        }
    }

    /// Returns the derivative within the segment at a key, from its weights and the channels of the place. Where it
    /// vanishes, the derivative slightly further inside is returned.
    fn tangent(&self, net: &[f64], key: usize, place: Place, (d, values): (&[f64], &[f64])) -> Vec3 {
        let (stride, dim, degree) = (self.stride(), self.control.dim, self.spline.degree);
        let at = |d: &[f64], c: usize| symmetric_sum(&d[..=degree], |k| net[k * stride + key * dim + c]);
        let x = &values[key * dim..];
        let direct = |d: &[f64], x: &dyn Fn(usize) -> f64| -> [f64; 3] {
            if dim == 3 {
                return std::array::from_fn(|c| at(d, c));
            }
            let w = if x(3) == 0.0 { 1.0 } else { x(3) };
            std::array::from_fn(|c| (at(d, c) - x(c) / w * at(d, 3)) / w)
        };
        let t = direct(d, &|c| x[c]);
        let size = (1..=degree)
            .flat_map(|k| (0..3).map(move |c| (k, c)))
            .map(|(k, c)| (net[k * stride + key * dim + c] - net[(k - 1) * stride + key * dim + c]).abs())
            .fold(0.0, f64::max);
        let largest = |t: [f64; 3]| t.iter().fold(0.0_f64, |m, x| m.max(x.abs()));
        if largest(t) > 1e-6 * size {
            return Vec3::from(t.map(|x| x as f32));
        }
        let (a, b) = (place.a + (0.5 - place.a) * 1e-3, place.b + (0.5 - place.b) * 1e-3);
        let (mut w, mut d) = ([0.0; MAX_DEGREE + 1], [0.0; MAX_DEGREE + 1]);
        bernstein(degree, a, b, &mut w);
        bernstein_derivative(degree, a, b, &mut d);
        Vec3::from(direct(&d, &|c| at(&w, c)).map(|x| x as f32))
    }

    /// Returns a box around a part of a curve at a motion key, including its width.
    pub(crate) fn bound(&self, curve: usize, range: Range, key: usize, net: &mut Vec<f64>) -> Bound {
        let (stride, dim) = (self.stride(), self.control.dim);
        let mut widest = 0.0_f64;
        let mut centre = Bound::EMPTY;
        let mut of_key = Vec::with_capacity((self.spline.degree + 1) * dim);
        for segment in range.segments() {
            self.gather(curve, segment, net);
            of_key.clear();
            for vertex in net.chunks_exact(stride) {
                of_key.extend_from_slice(&vertex[key * dim..(key + 1) * dim]);
                let weight = if dim == 4 && vertex[3] > 0.0 { vertex[3] } else { 1.0 };
                widest = widest.max(vertex[self.control.channels + key] / weight);
            }
            let range = [Range::whole(1), range];
            centre = centre.union(hull(&mut of_key, [0, self.spline.degree], dim, range, 6));
        }
        for end in [0.0, 1.0] {
            widest = widest.max(self.width(key, curve, end).unwrap_or(0.0));
        }
        centre.padded(widest as f32 * 0.5)
    }
}

impl<'a> Evaluator<'a> {
    /// Returns the evaluator of tangents and widths at some motion keys, and of positions at all.
    pub(crate) fn new(all: &'a Curves, curve: usize, keys: std::ops::Range<usize>) -> Self {
        let channels = all.control.vars_offset();
        Self { all, curve, keys, channels, nets: Default::default(), out: Points::default() }
    }

    /// Evaluates the variables too.
    pub(crate) fn with_variables(self) -> Self {
        Self { channels: self.all.control.channels, ..self }
    }

    /// Evaluates places of the curve.
    pub(crate) fn points(mut self, places: impl ExactSizeIterator<Item = Place>) -> Points {
        let (n, keys) = (places.len(), self.keys.len());
        self.out.values.reserve(n * self.all.stride());
        self.out.tangents.reserve(n * keys);
        self.out.widths.reserve(n * keys);
        self.out.v.reserve(n);
        let mut others = Points::default();
        for place in places {
            self.point(place, &mut others);
        }
        self.out
    }

    /// Appends the values at a place. `others` is scratch.
    fn point(&mut self, place: Place, others: &mut Points) {
        let (all, dim) = (self.all, self.all.control.dim);
        let (first, first_tangent) = (self.out.values.len(), self.out.tangents.len());
        let mut out = std::mem::take(&mut self.out);
        self.raw(place, &mut out);
        if let Some(beside) = all.beside(place) {
            // Segments may have an angle between them. Their ribbons share an edge when both take the direction in
            // between.
            others.values.clear();
            others.tangents.clear();
            self.raw(beside, others);
            for (t, other) in out.tangents[first_tangent..].iter_mut().zip(&others.tangents) {
                let between = t.normalize_or_zero() + other.normalize_or_zero();
                let length = (t.length() + other.length()) * 0.5;
                *t = between.try_normalize().map_or(*t, |d| d * length);
            }
        }
        let values = &mut out.values[first..];
        if dim == 4 {
            let safe = |w: f64| if w == 0.0 { 1.0 } else { w };
            let first = safe(values[3]);
            let (positions, others) = values.split_at_mut(all.control.vars_offset());
            for p in positions.chunks_exact_mut(4) {
                let w = safe(p[3]);
                p[..3].iter_mut().for_each(|x| *x /= w);
                p[3] = 1.0;
            }
            others.iter_mut().for_each(|x| *x /= first);
        }
        let v = all.spline.parameter(place.segment, place.a, place.b);
        let (v0, v1) = all.spline.extent();
        out.widths.extend(self.keys.clone().map(|key| {
            let like_vertices = values[all.control.channels + key];
            all.width(key, self.curve, (v - v0) / (v1 - v0)).unwrap_or(like_vertices).max(0.0) as f32
        }));
        out.v.push(v);
        self.out = out;
    }

    /// Appends the channels at a place, not divided by weights, and the derivative along v at each key.
    pub(crate) fn raw(&mut self, place: Place, out: &mut Points) {
        let all = self.all;
        let (segment, net) = &mut self.nets[place.segment as usize % 2];
        if *segment != Some(place.segment) {
            all.gather(self.curve, place.segment, net);
            *segment = Some(place.segment);
        }
        let (stride, degree, first) = (all.stride(), all.spline.degree, out.values.len());
        let segment = &all.spline.segments[place.segment as usize];
        let mut w = [0.0; MAX_DEGREE + 1];
        bernstein(degree, place.a, place.b, &mut w);
        let all_channels = all.control.channels;
        symmetric_sums(&w[..=degree], net, stride, self.channels, &mut out.values);
        out.values.resize(first + all_channels, 0.0);
        symmetric_sums(&w[..=degree], &net[all_channels..], stride, stride - all_channels, &mut out.values);
        let length = (segment.t1 - segment.t0) as f32;
        bernstein_derivative(degree, place.a, place.b, &mut w);
        let values = &out.values[first..];
        let tangent = |key| all.tangent(net, key, place, (&w, values)) / length;
        out.tangents.extend(self.keys.clone().map(tangent));
    }
}
