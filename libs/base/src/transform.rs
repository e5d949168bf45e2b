//! 4x4 matrices that act on row vectors, and transformations that move over time.

use glam::{DMat4, DVec4, Mat4, Vec3, Vec4};
use std::sync::Arc;

/// A 4x4 matrix acting on row vectors: `p' = p * M`, with the translation in the last row.
///
/// It is stored as a `glam::Mat4` of the same memory order (row-major for row vectors is column-major for column
/// vectors), so that conversion is free. The rounding error of the translation of a product or an inverse is stored
/// too, and only [`Transform::as_dmat4`] includes it. Far from the origin that error is more than a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transform {
    rounded: Mat4,
    /// The rounding error of the translation.
    rest: Vec3,
}

impl Default for Transform {
    fn default() -> Self {
        Self::IDENTITY
    }
}

impl Transform {
    /// The identity transformation.
    pub const IDENTITY: Self = Self::exact(Mat4::IDENTITY);

    const fn exact(rounded: Mat4) -> Self {
        Self { rounded, rest: Vec3::ZERO }
    }

    /// Returns a transform of the rounded matrix and its difference to the exact one.
    fn of(rounded: Mat4, exact: &DMat4) -> Self {
        let rest = exact.w_axis.truncate() - rounded.w_axis.truncate().as_dvec3();
        let rest = if rest.is_finite() { rest.as_vec3() } else { Vec3::ZERO };
        Self { rounded, rest }
    }

    /// True when it never divides points.
    pub fn is_affine(&self) -> bool {
        self.rounded.row(3) == Vec4::W
    }

    /// Returns the matrix of 16 numbers, row by row (`m[12..15]` is the translation).
    pub fn from_rows(m: &[f32; 16]) -> Self {
        Self::exact(Mat4::from_cols_array(m))
    }

    /// Returns the 16 numbers, row by row.
    pub fn to_rows(&self) -> [f32; 16] {
        self.rounded.to_cols_array()
    }

    /// Returns a translation by `t`.
    pub fn translate(t: Vec3) -> Self {
        Self::exact(Mat4::from_translation(t))
    }

    /// Returns a scale about the origin.
    pub fn scale(s: Vec3) -> Self {
        Self::exact(Mat4::from_scale(s))
    }

    /// Returns a rotation by `angle_rad` (radians) about `axis` (any length; a zero axis gives the identity).
    ///
    /// Positive angles turn x towards y when the axis is +z.
    pub fn rotate(angle_rad: f32, axis: Vec3) -> Self {
        match axis.try_normalize() {
            Some(axis) => Self::exact(about(axis, angle_rad)),
            None => Self::IDENTITY,
        }
    }

    /// Returns the transform that applies `self` first, then `next`.
    pub fn then(&self, next: &Self) -> Self {
        let product = next.rounded * self.rounded;
        // Most transforms have no translation that could be rounded.
        if self.rounded.w_axis == Vec4::W && self.rest == Vec3::ZERO {
            return Self { rounded: product, rest: next.rest };
        }
        if !self.is_affine() || !next.is_affine() {
            return Self::exact(product);
        }
        Self::of(product, &(next.as_dmat4() * self.as_dmat4()))
    }

    /// Does the same as [`Transform::then`], rounded once. When large translations of both cancel, the result is as
    /// exact as a single number.
    pub fn then_rounded_once(&self, next: &Self) -> Self {
        let exact = next.as_dmat4() * self.as_dmat4();
        let rounded = exact.as_mat4();
        if self.is_affine() && next.is_affine() { Self::of(rounded, &exact) } else { Self::exact(rounded) }
    }

    /// Returns the inverse, computed in double precision; `None` for a singular matrix.
    pub fn try_inverse(&self) -> Option<Self> {
        let m: DMat4 = self.rounded.as_dmat4();
        let det = m.determinant();
        if !det.is_finite() || det == 0.0 {
            return None;
        }
        let rounded = m.inverse().as_mat4();
        // The inverse maps the image of the origin exactly to the origin, also when the axes are rounded.
        let mut exact = rounded.as_dmat4();
        exact.w_axis = DVec4::W - exact * self.as_dmat4().w_axis.truncate().extend(0.0);
        rounded
            .is_finite()
            .then(|| if self.is_affine() { Self::of(rounded, &exact) } else { Self::exact(rounded) })
    }

    /// Returns the inverse; the identity for a singular matrix.
    pub fn inverse(&self) -> Self {
        self.try_inverse().unwrap_or(Self::IDENTITY)
    }

    /// Returns the determinant of the whole matrix.
    pub fn determinant(&self) -> f32 {
        self.rounded.as_dmat4().determinant() as f32
    }

    /// True when the transformation exchanges left and right handed coordinates.
    pub fn flips_handedness(&self) -> bool {
        let (x, y, z) =
            (self.rounded.x_axis.truncate(), self.rounded.y_axis.truncate(), self.rounded.z_axis.truncate());
        x.cross(y).dot(z) < 0.0
    }

    /// Transforms a position, and divides by the homogeneous coordinate when it is not one.
    pub fn point(&self, p: Vec3) -> Vec3 {
        let h = self.rounded * p.extend(1.0);
        if h.w == 1.0 { h.truncate() } else { h.truncate() / h.w }
    }

    /// Transforms a homogeneous point without dividing.
    pub fn hpoint(&self, p: Vec4) -> Vec4 {
        self.rounded * p
    }

    /// Transforms a direction. The translation is ignored.
    pub fn vector(&self, v: Vec3) -> Vec3 {
        self.rounded.transform_vector3(v)
    }

    /// Transforms a normal by the inverse transpose. It inverts the matrix. For many normals call
    /// [`Transform::normal_matrix`] once.
    pub fn normal(&self, n: Vec3) -> Vec3 {
        self.normal_matrix().vector(n)
    }

    /// Returns the matrix that transforms normals as [`Transform::vector`] transforms directions.
    pub fn normal_matrix(&self) -> Self {
        let mut linear = self.rounded.as_dmat4();
        linear.w_axis = DVec4::W;
        linear.x_axis.w = 0.0;
        linear.y_axis.w = 0.0;
        linear.z_axis.w = 0.0;
        if linear.determinant() == 0.0 {
            return Self::exact(linear.as_mat4());
        }
        Self::exact(linear.inverse().transpose().as_mat4())
    }

    /// Returns the matrix with rows and columns exchanged.
    pub fn transpose(&self) -> Self {
        Self::exact(self.rounded.transpose())
    }

    /// Returns the component-wise linear interpolation: `self` at `alpha` 0, `other` at 1.
    pub fn lerp(&self, other: &Self, alpha: f32) -> Self {
        if alpha <= 0.0 {
            return *self;
        }
        if alpha >= 1.0 {
            return *other;
        }
        let rounded = self.rounded * (1.0 - alpha) + other.rounded * alpha;
        Self::exact(rounded)
    }

    /// True when all 16 numbers are finite.
    pub fn is_finite(&self) -> bool {
        self.rounded.is_finite()
    }

    /// Returns the matrix in double precision, for column vectors.
    pub fn as_dmat4(&self) -> DMat4 {
        let mut m = self.rounded.as_dmat4();
        m.w_axis += self.rest.as_dvec3().extend(0.0);
        m
    }

    /// Returns the underlying matrix, for column vectors.
    pub fn as_mat4(&self) -> &Mat4 {
        &self.rounded
    }
}

/// Returns the rotation by an angle about an axis of length 1, by Rodrigues' formula. `glam` has it with the system's
/// sine and cosine, whose last bits differ between systems.
fn about(axis: Vec3, angle_rad: f32) -> Mat4 {
    let (sin, cos) = libm::sincosf(angle_rad);
    let turned = |v: Vec3| v * cos + axis.cross(v) * sin + axis * (axis.dot(v) * (1.0 - cos));
    let [x, y, z] = Vec3::AXES.map(|v| turned(v).extend(0.0));
    Mat4::from_cols(x, y, z, Vec4::W)
}

impl From<Mat4> for Transform {
    fn from(m: Mat4) -> Self {
        Self::exact(m)
    }
}

/// A transformation with one or more keys in time.
///
/// Between keys the matrices are interpolated linearly. Before the first and after the last key the transformation is
/// constant. There is always at least one key, and times increase strictly.
#[derive(Clone, Debug, PartialEq)]
pub struct MotionTransform {
    keys: Keys,
}

/// A single key is stored here, because most transformations do not move, and a scene makes very many.
#[derive(Clone, Debug, PartialEq)]
enum Keys {
    One([(f32, Transform); 1]),
    Many(Arc<[(f32, Transform)]>),
}

impl From<Vec<(f32, Transform)>> for Keys {
    fn from(keys: Vec<(f32, Transform)>) -> Self {
        match keys.as_slice() {
            [one] => Self::One([*one]),
            _ => Self::Many(keys.into()),
        }
    }
}

impl Default for MotionTransform {
    fn default() -> Self {
        Transform::IDENTITY.into()
    }
}

impl From<Transform> for MotionTransform {
    fn from(t: Transform) -> Self {
        Self { keys: Keys::One([(0.0, t)]) }
    }
}

impl MotionTransform {
    /// Returns the transformation of keys in any order. Of two keys with one time the later in the list is used.
    /// `None` when there is no key or a time is not finite.
    pub fn from_keys(mut keys: Vec<(f32, Transform)>) -> Option<Self> {
        if keys.is_empty() || keys.iter().any(|(t, _)| !t.is_finite()) {
            return None;
        }
        keys.sort_by(|a, b| a.0.total_cmp(&b.0));
        keys.dedup_by(|later, earlier| {
            let same = later.0 == earlier.0;
            if same {
                earlier.1 = later.1;
            }
            same
        });
        Some(Self { keys: keys.into() })
    }

    /// Returns the keys in order of time.
    pub fn keys(&self) -> &[(f32, Transform)] {
        match &self.keys {
            Keys::One(one) => one,
            Keys::Many(all) => all,
        }
    }

    /// True when there is more than one key.
    pub fn is_moving(&self) -> bool {
        matches!(self.keys, Keys::Many(_))
    }

    /// Returns the transformation at the first key.
    pub fn first(&self) -> &Transform {
        &self.keys()[0].1
    }

    /// Returns the transformation at `time`.
    pub fn at(&self, time: f32) -> Transform {
        let keys = self.keys();
        let next = keys.partition_point(|(t, _)| *t <= time);
        if next == 0 {
            return keys[0].1;
        }
        let (t0, a) = &keys[next - 1];
        match keys.get(next) {
            None => *a,
            Some((t1, b)) => a.lerp(b, (time - t0) / (t1 - t0)),
        }
    }

    /// Does the same as [`MotionTransform::at`], interpolated in double precision, for column vectors.
    pub fn precise_at(&self, time: f32) -> DMat4 {
        let keys = self.keys();
        let next = keys.partition_point(|(t, _)| *t <= time);
        if next == 0 {
            return keys[0].1.as_dmat4();
        }
        let (t0, a) = &keys[next - 1];
        match keys.get(next) {
            None => a.as_dmat4(),
            Some((t1, b)) => {
                let alpha = f64::from(time - t0) / f64::from(t1 - t0);
                a.as_dmat4() * (1.0 - alpha) + b.as_dmat4() * alpha
            }
        }
    }

    /// Returns the transformation that applies `self` first, then `next`, at the union of both key times.
    pub fn then(&self, next: &Self) -> Self {
        self.combine(next, |a, b| a.then(b))
    }

    /// Does the same as [`MotionTransform::then`] with [`Transform::then_rounded_once`].
    pub fn then_rounded_once(&self, next: &Self) -> Self {
        self.combine(next, Transform::then_rounded_once)
    }

    /// Applies `first` before it, like `MotionTransform::from (first).then (self)`.
    pub fn prepend(&mut self, first: &Transform) {
        match &mut self.keys {
            Keys::One([(time, m)]) => (*time, *m) = (0.0, first.then(m)),
            Keys::Many(keys) => Arc::make_mut(keys).iter_mut().for_each(|(_, m)| *m = first.then(m)),
        }
    }

    /// Combines two moving transformations key by key, at the union of their times.
    fn combine(&self, other: &Self, f: impl Fn(&Transform, &Transform) -> Transform) -> Self {
        if let (Keys::One([(t, a)]), Keys::One([(_, b)])) = (&self.keys, &other.keys) {
            return Self { keys: Keys::One([(*t, f(a, b))]) };
        }
        let times: Vec<f32> = match (self.is_moving(), other.is_moving()) {
            (_, false) => self.keys().iter().map(|k| k.0).collect(),
            (false, true) => other.keys().iter().map(|k| k.0).collect(),
            (true, true) => {
                let mut all: Vec<f32> = self.keys().iter().chain(other.keys()).map(|k| k.0).collect();
                all.sort_by(f32::total_cmp);
                all.dedup();
                all
            }
        };
        Self { keys: times.iter().map(|&t| (t, f(&self.at(t), &other.at(t)))).collect::<Vec<_>>().into() }
    }

    /// Returns the transformation with each key inverted (singular keys become the identity).
    pub fn inverse(&self) -> Self {
        Self { keys: self.keys().iter().map(|(t, m)| (*t, m.inverse())).collect::<Vec<_>>().into() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transforms_apply_to_row_vectors_in_order() {
        let m = Transform::translate(Vec3::X).then(&Transform::scale(Vec3::splat(3.0)));
        assert_eq!(m.point(Vec3::ZERO), Vec3::new(3.0, 0.0, 0.0));
        assert_eq!(m.to_rows()[12], 3.0);
        let r = Transform::rotate(std::f32::consts::FRAC_PI_2, Vec3::Z);
        assert!((r.vector(Vec3::X) - Vec3::Y).length() < 1e-6);
    }

    #[test]
    fn large_translations_keep_their_precision() {
        let eye = Vec3::new(1e7, 3e6, -2e7);
        let turned = Transform::rotate(0.3, Vec3::new(0.2, 1.0, 0.1));
        let to_camera = Transform::translate(-eye).then(&turned);
        let to_world = turned.inverse().then(&Transform::translate(eye));
        let (around, back) = (Transform::translate(Vec3::X).then(&to_world), to_world.inverse());
        for (m, p) in [(to_camera, eye), (back, eye), (around.then(&to_camera), -Vec3::X)] {
            let place = m.as_dmat4() * p.as_dvec3().extend(1.0);
            assert!(place.truncate().length() < 1e-6, "{place}");
        }
        // The offset that moves a scene near the origin is exact, whatever the rotations before it.
        let near = to_world.then_rounded_once(&Transform::translate(-eye));
        assert_eq!(near.point(Vec3::ZERO), Vec3::ZERO);
        let seen = Transform::translate(eye).then_rounded_once(&to_camera);
        assert!(seen.point(Vec3::ZERO).length() < 1e-6, "{seen:?}");
        // The matrix is the same to the bit as without the stored error.
        assert_eq!(*to_camera.as_mat4(), *turned.as_mat4() * Mat4::from_translation(-eye));
        assert_eq!(to_camera.then(&Transform::IDENTITY), to_camera);
    }

    #[test]
    fn singular_matrices_have_no_inverse() {
        assert!(Transform::scale(Vec3::new(1.0, 0.0, 1.0)).try_inverse().is_none());
        assert_eq!(Transform::scale(Vec3::ZERO).inverse(), Transform::IDENTITY);
    }

    #[test]
    fn normals_stay_perpendicular() {
        let m = Transform::scale(Vec3::new(1.0, 4.0, 1.0)).then(&Transform::rotate(0.7, Vec3::X));
        let (tangent, normal) = (Vec3::new(1.0, 1.0, 0.0), Vec3::new(1.0, -1.0, 0.0));
        assert!(m.vector(tangent).dot(m.normal(normal)).abs() < 1e-5);
    }

    #[test]
    fn motion_is_blended_between_keys_and_constant_outside() {
        let m = MotionTransform::from_keys(vec![
            (1.0, Transform::translate(Vec3::X)),
            (0.0, Transform::IDENTITY),
        ])
        .unwrap();
        assert_eq!(m.at(-1.0).point(Vec3::ZERO), Vec3::ZERO);
        assert_eq!(m.at(0.25).point(Vec3::ZERO), Vec3::new(0.25, 0.0, 0.0));
        for time in [-1.0, 0.0, 0.25, 1.0, 9.0] {
            assert_eq!(m.precise_at(time).as_mat4(), *m.at(time).as_mat4());
        }
        assert_eq!(m.at(9.0).point(Vec3::ZERO), Vec3::X);
        assert!(MotionTransform::from_keys(vec![]).is_none());
        assert!(MotionTransform::from_keys(vec![(f32::NAN, Transform::IDENTITY)]).is_none());
    }

    #[test]
    fn prepending_equals_composing() {
        let first = Transform::scale(Vec3::new(1.0, 2.0, 3.0));
        for keys in [
            vec![(0.5, Transform::translate(Vec3::X))],
            vec![(0.0, Transform::IDENTITY), (1.0, Transform::translate(Vec3::X))],
        ] {
            let all = MotionTransform::from_keys(keys).unwrap();
            let mut changed = all.clone();
            changed.prepend(&first);
            assert_eq!(changed, MotionTransform::from(first).then(&all));
        }
    }

    #[test]
    fn mirroring_flips_handedness_and_rotation_does_not() {
        assert!(Transform::scale(Vec3::new(-1.0, 1.0, 1.0)).flips_handedness());
        assert!(!Transform::rotate(2.0, Vec3::ONE).flips_handedness());
    }
}
