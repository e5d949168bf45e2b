//! Chains of steps that convert pixels.

use crate::curve::Curve;
use crate::engine::Converter;
use crate::fixed;
use crate::primaries::{self, IDENTITY, Matrix3};
use crate::table::{Interpolation, Lut3d};
use crate::transform::{Cdl, Fixed, Negatives, Transform};
use granita_machine::widest;
use std::sync::Arc;

/// The number of pixels that go through all steps together.
const BATCH: usize = 256;

/// The weights of luminance of ASC CDL 1.2, which are those of Rec. 709.
const LUMA: [f64; 3] = [0.2126, 0.7152, 0.0722];

#[derive(Clone, Debug)]
enum Step {
    Matrix(Matrix3, [f64; 3]),
    Curves(Arc<[Curve; 3]>),
    Lut3d(Arc<Lut3d>, Interpolation),
    Fixed(Fixed, bool),
    Other(Arc<dyn Converter>),
}

impl PartialEq for Step {
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Matrix(a, b), Self::Matrix(c, d)) => (a, b) == (c, d),
            (Self::Curves(a), Self::Curves(b)) => a == b,
            (Self::Lut3d(a, b), Self::Lut3d(c, d)) => (a, b) == (c, d),
            (Self::Fixed(a, b), Self::Fixed(c, d)) => (a, b) == (c, d),
            (Self::Other(a), Self::Other(b)) => Arc::ptr_eq(a, b),
            _ => false,
        }
    }
}

/// Steps from one colour space to another, ready for pixels. A processor can be used by many threads at once. Its
/// results have the same bits on every machine, and depend neither on threads nor on the size of slices.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Processor {
    steps: Vec<Step>,
}

/// The reason why a transform has no step, without its place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Refused(pub(crate) String);

fn refused<T>(what: impl Into<String>) -> Result<T, Refused> {
    Err(Refused(what.into()))
}

impl Processor {
    /// Returns the processor that changes nothing.
    pub fn identity() -> Self {
        Self::default()
    }

    /// Returns the processor of a matrix between linear colours.
    pub fn matrix(matrix: Matrix3) -> Self {
        let mut processor = Self::default();
        processor.push_matrix(matrix, [0.0; 3]);
        processor
    }

    /// Returns the processor of a conversion of another library. Its results are those of that library, also where they
    /// differ between machines.
    pub(crate) fn of(converter: Arc<dyn Converter>) -> Self {
        Self { steps: vec![Step::Other(converter)] }
    }

    /// Returns the processor of a power; negative values keep their sign. A power that is not positive and finite is
    /// ignored.
    pub fn power(power: f64) -> Self {
        let mut processor = Self::default();
        let curve = Curve::power(power, Negatives::Mirror, false).unwrap_or(Curve::Same);
        processor.push_curves([curve.clone(), curve.clone(), curve]);
        processor
    }

    /// True when nothing changes.
    pub fn is_identity(&self) -> bool {
        self.steps.is_empty()
    }

    /// True when each channel is converted by itself, so that a table can replace the processor for integers.
    pub fn is_separable(&self) -> bool {
        self.steps.iter().all(|step| matches!(step, Step::Curves(_)))
    }

    /// Returns the processor without the matrix and the offset with which it ends, and these. The matrix changes
    /// nothing where the processor ends with another step.
    pub fn split_matrix(&self) -> (Self, Matrix3, [f64; 3]) {
        match self.steps.split_last() {
            Some((Step::Matrix(matrix, offset), rest)) => (Self { steps: rest.to_vec() }, *matrix, *offset),
            _ => (self.clone(), IDENTITY, [0.0; 3]),
        }
    }

    /// Returns the product of the matrices before the first curves and tables, which is the space in which these work.
    /// Limits of values and other steps between these matrices are left out.
    pub fn first_matrices(&self) -> Matrix3 {
        let is_limit = |curve: &Curve| match curve {
            Curve::Range { scale, offset, .. } => (*scale, *offset) == (1.0, 0.0),
            other => *other == Curve::Same,
        };
        let mut product = IDENTITY;
        for step in &self.steps {
            match step {
                Step::Matrix(matrix, _) => product = primaries::multiply(matrix, &product),
                Step::Fixed(..) => (),
                Step::Curves(curves) if curves.iter().all(is_limit) => (),
                _ => break,
            }
        }
        product
    }

    /// Returns the processor without the curves of channels with which it ends, and these curves.
    pub fn split_curves(&self) -> (Self, Self) {
        let curves = self.steps.iter().rev().take_while(|step| matches!(step, Step::Curves(_))).count();
        let (first, last) = self.steps.split_at(self.steps.len() - curves);
        (Self { steps: first.to_vec() }, Self { steps: last.to_vec() })
    }

    /// Returns the processor that applies this one and then another.
    #[must_use]
    pub fn then(&self, next: &Self) -> Self {
        let mut all = self.clone();
        for step in &next.steps {
            match step {
                Step::Matrix(matrix, offset) => all.push_matrix(*matrix, *offset),
                other => all.steps.push(other.clone()),
            }
        }
        all
    }

    /// Converts pixels of interleaved channels in place. The first three channels are red, green and blue. Others are
    /// not changed. With one or two channels the first one is grey. Values behind the last whole pixel are not changed.
    ///
    /// ```
    /// use granita_color::Config;
    /// let to_linear = Config::built_in().processor("sRGB - Texture", "lin_rec709")?;
    /// let mut pixels = [0.5, 0.5, 0.5, 0.25];
    /// to_linear.apply(&mut pixels, 4);
    /// assert!((pixels[0] - 0.214_041).abs() < 1e-5 && pixels[3] == 0.25);
    /// # Ok::<(), granita_color::ColorError>(())
    /// ```
    pub fn apply(&self, pixels: &mut [f32], channels: usize) {
        if self.steps.is_empty() || channels == 0 {
            return;
        }
        let mut planes = [[0.0; BATCH]; 3];
        for batch in pixels.chunks_mut(BATCH * channels) {
            let n = batch.len() / channels;
            split(batch, channels, &mut planes);
            self.steps.iter().for_each(|step| step.apply(&mut planes, n));
            join(&planes, batch, channels);
        }
    }

    /// Does the same for colours that are multiplied by alpha, which is channel `alpha`: they are divided by it before
    /// the conversion, and multiplied after it. Pixels whose alpha is 0 are converted as they are.
    pub fn apply_associated(&self, pixels: &mut [f32], channels: usize, alpha: usize) {
        if self.steps.is_empty() || channels == 0 {
            return;
        }
        let colors = if channels < 3 { 1 } else { 3 };
        if alpha < colors || alpha >= channels {
            return self.apply(pixels, channels);
        }
        let scale = |pixels: &mut [f32], by: fn(f32, f32) -> f32| {
            for pixel in pixels.chunks_exact_mut(channels) {
                let a = pixel[alpha];
                if a != 0.0 {
                    pixel[..colors].iter_mut().for_each(|v| *v = by(*v, a));
                }
            }
        };
        scale(pixels, |v, a| v / a);
        self.apply(pixels, channels);
        scale(pixels, |v, a| v * a);
    }

    /// Returns one colour converted.
    pub fn map(&self, rgb: [f32; 3]) -> [f32; 3] {
        let mut planes = rgb.map(|v| [v]);
        self.steps.iter().for_each(|step| step.apply(&mut planes, 1));
        planes.map(|[v]| v)
    }

    /// Adds the steps of a transform that needs no configuration.
    pub(crate) fn push(&mut self, transform: &Transform, inverse: bool) -> Result<(), Refused> {
        match transform {
            Transform::Matrix(matrix, offset) => self.push_4x4(matrix, offset, inverse),
            Transform::Exponent(value, negatives) => {
                if value[3] != 1.0 {
                    return refused("an exponent of alpha");
                }
                // Where one channel is clamped, all are.
                let clamps = *negatives == Negatives::Clamp && value[..3].iter().any(|v| *v != 1.0);
                let limited = Curve::Range { scale: 1.0, offset: 0.0, low: 0.0, high: f32::INFINITY };
                self.push_each(inverse, |c| match value[c] {
                    1.0 if clamps => Some(limited.clone()),
                    power => Curve::power(power, *negatives, inverse),
                })
            }
            Transform::ExponentWithLinear(gamma, offset, negatives) => {
                if (gamma[3], offset[3]) != (1.0, 0.0) {
                    return refused("an exponent of alpha");
                }
                let mirror = *negatives == Negatives::Mirror;
                self.push_each(inverse, |c| Some(Curve::moncurve(gamma[c], offset[c], mirror, inverse)))
            }
            Transform::Log(params) => self.push_each(inverse, |c| Curve::log(params, c, inverse)),
            Transform::Cdl(cdl) => self.push_cdl(cdl, inverse),
            Transform::Range(values, clamp) => {
                self.push_each(inverse, |_| Curve::range(*values, *clamp, inverse))
            }
            Transform::ExposureContrast(params) => {
                self.push_each(inverse, |_| Some(Curve::exposure_contrast(params, inverse)))
            }
            Transform::Named(name) => self.push_each(inverse, |_| Some(Curve::Named(*name, inverse))),
            Transform::Fixed(fixed) => {
                self.steps.push(Step::Fixed(*fixed, inverse));
                Ok(())
            }
            Transform::Lut1d(lut) => self.push_each(inverse, |c| {
                Some(match inverse {
                    true => Curve::TableInverse(Arc::new(lut.inverse(c))),
                    false => Curve::Table(lut.clone(), c),
                })
            }),
            Transform::Lut3d(_) if inverse => refused("the inverse of a table of three dimensions"),
            Transform::Lut3d(lut) => {
                self.steps.push(Step::Lut3d(lut.clone(), lut.interpolation));
                Ok(())
            }
            Transform::Unsupported(name) => refused(format!("the transform {name}")),
            _ => refused("a transform that needs a configuration"),
        }
    }

    fn push_each(&mut self, inverse: bool, curve: impl Fn(usize) -> Option<Curve>) -> Result<(), Refused> {
        let (Some(r), Some(g), Some(b)) = (curve(0), curve(1), curve(2)) else {
            return refused(if inverse {
                "a transform without an inverse"
            } else {
                "a transform with these parameters"
            });
        };
        self.push_curves([r, g, b]);
        Ok(())
    }

    pub(crate) fn push_curves(&mut self, curves: [Curve; 3]) {
        if curves.iter().all(Curve::is_same) {
            return;
        }
        if let [Some(r), Some(g), Some(b)] = [0, 1, 2].map(|c| curves[c].as_line()) {
            let mut matrix = IDENTITY;
            for (c, (scale, _)) in [r, g, b].into_iter().enumerate() {
                matrix[c][c] = scale;
            }
            return self.push_matrix(matrix, [r.1, g.1, b.1]);
        }
        self.steps.push(Step::Curves(Arc::new(curves)));
    }

    pub(crate) fn push_fixed(&mut self, fixed: Fixed) {
        self.steps.push(Step::Fixed(fixed, false));
    }

    fn push_4x4(&mut self, m: &[f64; 16], offset: &[f64; 4], inverse: bool) -> Result<(), Refused> {
        let alpha = [m[3], m[7], m[11], m[12], m[13], m[14], m[15] - 1.0, offset[3]];
        if alpha.iter().any(|v| *v != 0.0) {
            return refused("a matrix that mixes alpha with colours");
        }
        let matrix = [0, 1, 2].map(|i| [m[4 * i], m[4 * i + 1], m[4 * i + 2]]);
        let offset = [offset[0], offset[1], offset[2]];
        if !inverse {
            self.push_matrix(matrix, offset);
            return Ok(());
        }
        let Some(back) = primaries::inverse(&matrix) else {
            return refused("the inverse of a singular matrix");
        };
        let moved = primaries::apply(&back, offset).map(|v| -v);
        self.push_matrix(back, moved);
        Ok(())
    }

    fn push_matrix(&mut self, mut matrix: Matrix3, mut offset: [f64; 3]) {
        if let Some(Step::Matrix(first, first_offset)) = self.steps.last() {
            let moved = primaries::apply(&matrix, *first_offset);
            offset = [0, 1, 2].map(|c| offset[c] + moved[c]);
            matrix = primaries::multiply(&matrix, first);
            self.steps.pop();
        }
        let is_near = |a: f64, b: f64| (a - b).abs() <= 1e-9;
        let same = matrix.iter().flatten().zip(IDENTITY.iter().flatten()).all(|(a, b)| is_near(*a, *b));
        if !same || !offset.iter().all(|v| is_near(*v, 0.0)) {
            self.steps.push(Step::Matrix(matrix, offset));
        }
    }

    fn push_cdl(&mut self, cdl: &Cdl, inverse: bool) -> Result<(), Refused> {
        let lists = [0, 1, 2].map(|c| Curve::cdl(cdl, c, inverse));
        let [Some(r), Some(g), Some(b)] = lists else {
            return refused(if inverse { "the inverse of this decision list" } else { "this decision list" });
        };
        let saturation = if inverse { 1.0 / cdl.saturation } else { cdl.saturation };
        if !saturation.is_finite() {
            return refused("the inverse of the saturation 0");
        }
        let mut matrix = [[0.0; 3]; 3];
        for (i, row) in matrix.iter_mut().enumerate() {
            for (j, v) in row.iter_mut().enumerate() {
                *v = LUMA[j] * (1.0 - saturation) + if i == j { saturation } else { 0.0 };
            }
        }
        let clamp = Curve::Range { scale: 1.0, offset: 0.0, low: 0.0, high: 1.0 };
        let clamp = || [clamp.clone(), clamp.clone(), clamp.clone()];
        if inverse && cdl.clamp {
            self.push_curves(clamp());
        }
        if inverse {
            self.push_matrix(matrix, [0.0; 3]);
            if cdl.clamp {
                self.push_curves(clamp());
            }
        }
        for ((r, g), b) in r.into_iter().zip(g).zip(b) {
            self.push_curves([r, g, b]);
        }
        if !inverse {
            self.push_matrix(matrix, [0.0; 3]);
            if cdl.clamp {
                self.push_curves(clamp());
            }
        }
        Ok(())
    }
}

impl Step {
    /// Applies the step to `n` colours.
    fn apply<const N: usize>(&self, planes: &mut [[f32; N]; 3], n: usize) {
        match self {
            Self::Matrix(matrix, offset) => widest!(multiply(matrix, offset, planes, n)),
            Self::Curves(curves) => {
                for (curve, plane) in curves.iter().zip(planes) {
                    curve.apply(&mut plane[..n]);
                }
            }
            Self::Lut3d(lut, interpolation) => each(planes, n, |rgb| lut.lookup(rgb, *interpolation)),
            Self::Fixed(fixed, inverse) => each(planes, n, |rgb| fixed::apply(*fixed, *inverse, rgb)),
            Self::Other(converter) => {
                let mut rgb = [0.0; 3 * BATCH];
                let rgb = &mut rgb[..3 * n];
                for (i, pixel) in rgb.chunks_exact_mut(3).enumerate() {
                    pixel.copy_from_slice(&[planes[0][i], planes[1][i], planes[2][i]]);
                }
                converter.apply(rgb);
                for (i, pixel) in rgb.chunks_exact(3).enumerate() {
                    (planes[0][i], planes[1][i], planes[2][i]) = (pixel[0], pixel[1], pixel[2]);
                }
            }
        }
    }
}

/// Copies the colours of pixels into planes. One grey channel becomes three.
fn split(pixels: &[f32], channels: usize, planes: &mut [[f32; BATCH]; 3]) {
    let [r, g, b] = planes;
    let places = r.iter_mut().zip(g.iter_mut()).zip(b.iter_mut());
    // With a constant number of channels, the compiler makes vectors of the loop.
    match channels {
        0 => {}
        1 | 2 => {
            for (((r, g), b), pixel) in places.zip(pixels.chunks_exact(channels)) {
                (*r, *g, *b) = (pixel[0], pixel[0], pixel[0]);
            }
        }
        3 => {
            for (((r, g), b), pixel) in places.zip(pixels.as_chunks::<3>().0) {
                (*r, *g, *b) = (pixel[0], pixel[1], pixel[2]);
            }
        }
        _ => {
            for (((r, g), b), pixel) in places.zip(pixels.chunks_exact(channels)) {
                (*r, *g, *b) = (pixel[0], pixel[1], pixel[2]);
            }
        }
    }
}

/// Does the inverse of [`split`].
fn join(planes: &[[f32; BATCH]; 3], pixels: &mut [f32], channels: usize) {
    let [r, g, b] = planes;
    let places = r.iter().zip(g).zip(b);
    match channels {
        0 => {}
        1 | 2 => {
            for (r, pixel) in r.iter().zip(pixels.chunks_exact_mut(channels)) {
                pixel[0] = *r;
            }
        }
        3 => {
            for (((r, g), b), pixel) in places.zip(pixels.as_chunks_mut::<3>().0) {
                *pixel = [*r, *g, *b];
            }
        }
        _ => {
            for (((r, g), b), pixel) in places.zip(pixels.chunks_exact_mut(channels)) {
                (pixel[0], pixel[1], pixel[2]) = (*r, *g, *b);
            }
        }
    }
}

/// Applies a matrix and an offset to `n` colours.
#[inline(always)]
fn multiply<const N: usize>(matrix: &Matrix3, offset: &[f64; 3], planes: &mut [[f32; N]; 3], n: usize) {
    let m = matrix.map(|row| row.map(|v| v as f32));
    let o = offset.map(|v| v as f32);
    let [r, g, b] = planes;
    for ((r, g), b) in r.iter_mut().zip(g.iter_mut()).zip(b.iter_mut()).take(n) {
        let v = [*r, *g, *b];
        let row = |c: usize| m[c][0] * v[0] + m[c][1] * v[1] + m[c][2] * v[2] + o[c];
        (*r, *g, *b) = (row(0), row(1), row(2));
    }
}

fn each<const N: usize>(planes: &mut [[f32; N]; 3], n: usize, f: impl Fn([f32; 3]) -> [f32; 3]) {
    let [r, g, b] = planes;
    for ((r, g), b) in r.iter_mut().zip(g.iter_mut()).zip(b.iter_mut()).take(n) {
        [*r, *g, *b] = f([*r, *g, *b]);
    }
}

#[cfg(test)]
mod tests;
