//! Loops over lanes. They use contiguous slices without index arithmetic, so that they vectorise. A uniform operand
//! is a constant of the loop.

use crate::Lane;

/// `out = f (a)`.
#[inline(always)]
pub(crate) fn map1(out: &mut [f32], a: Lane<'_>, f: impl Fn(f32) -> f32) {
    if a.stride == 0 {
        out.fill(f(a.values[0]));
    } else {
        for (o, &x) in out.iter_mut().zip(a.values) {
            *o = f(x);
        }
    }
}

/// `out = f (a, b)`.
#[inline(always)]
pub(crate) fn map2(out: &mut [f32], a: Lane<'_>, b: Lane<'_>, f: impl Fn(f32, f32) -> f32) {
    match (a.stride, b.stride) {
        (0, 0) => out.fill(f(a.values[0], b.values[0])),
        (0, _) => {
            let x = a.values[0];
            for (o, &y) in out.iter_mut().zip(b.values) {
                *o = f(x, y);
            }
        }
        (_, 0) => {
            let y = b.values[0];
            for (o, &x) in out.iter_mut().zip(a.values) {
                *o = f(x, y);
            }
        }
        _ => {
            for ((o, &x), &y) in out.iter_mut().zip(a.values).zip(b.values) {
                *o = f(x, y);
            }
        }
    }
}

/// `out = f (a, b, c)`.
#[inline(always)]
pub(crate) fn map3(out: &mut [f32], a: Lane<'_>, b: Lane<'_>, c: Lane<'_>, f: impl Fn(f32, f32, f32) -> f32) {
    match (a.stride, b.stride, c.stride) {
        (0, 0, _) => {
            let (x, y) = (a.values[0], b.values[0]);
            map1(out, c, |z| f(x, y, z));
        }
        (0, _, 0) => {
            let (x, z) = (a.values[0], c.values[0]);
            map1(out, b, |y| f(x, y, z));
        }
        (_, 0, 0) => {
            let (y, z) = (b.values[0], c.values[0]);
            map1(out, a, |x| f(x, y, z));
        }
        (0, _, _) => {
            let x = a.values[0];
            map2(out, b, c, |y, z| f(x, y, z));
        }
        (_, 0, _) => {
            let y = b.values[0];
            map2(out, a, c, |x, z| f(x, y, z));
        }
        (_, _, 0) => {
            let z = c.values[0];
            map2(out, a, b, |x, y| f(x, y, z));
        }
        _ => {
            for (((o, &x), &y), &z) in out.iter_mut().zip(a.values).zip(b.values).zip(c.values) {
                *o = f(x, y, z);
            }
        }
    }
}

/// `out = f (out, a)`.
#[inline(always)]
pub(crate) fn fold1(out: &mut [f32], a: Lane<'_>, f: impl Fn(f32, f32) -> f32) {
    if a.stride == 0 {
        let x = a.values[0];
        for o in out.iter_mut() {
            *o = f(*o, x);
        }
    } else {
        for (o, &x) in out.iter_mut().zip(a.values) {
            *o = f(*o, x);
        }
    }
}

/// `out = f (out, a, b)`.
#[inline(always)]
pub(crate) fn fold2(out: &mut [f32], a: Lane<'_>, b: Lane<'_>, f: impl Fn(f32, f32, f32) -> f32) {
    match (a.stride, b.stride) {
        (0, _) => {
            let x = a.values[0];
            fold1(out, b, |o, y| f(o, x, y));
        }
        (_, 0) => {
            let y = b.values[0];
            fold1(out, a, |o, x| f(o, x, y));
        }
        _ => {
            for ((o, &x), &y) in out.iter_mut().zip(a.values).zip(b.values) {
                *o = f(*o, x, y);
            }
        }
    }
}

/// `to = from` where the mask is on.
#[inline]
pub(crate) fn blend(to: &mut [f32], from: &[f32], on: &[bool]) {
    for ((t, &f), &m) in to.iter_mut().zip(from).zip(on) {
        *t = if m { f } else { *t };
    }
}

/// `to = value` where the mask is on.
#[inline]
pub(crate) fn blend_one(to: &mut [f32], value: f32, on: &[bool]) {
    for (t, &m) in to.iter_mut().zip(on) {
        *t = if m { value } else { *t };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kernels_agree_for_every_mixture_of_strides() {
        let data: [Vec<f32>; 3] = [vec![2.0; 5], vec![3.0; 5], vec![5.0; 5]];
        for k in 0..8 {
            let lane = |j: usize| {
                if k >> j & 1 == 1 {
                    Lane { values: &data[j], stride: 1 }
                } else {
                    Lane { values: &data[j][..1], stride: 0 }
                }
            };
            let mut out = vec![0.0; 5];
            map3(&mut out, lane(0), lane(1), lane(2), |x, y, z| x * 100.0 + y * 10.0 + z);
            assert_eq!(out, [235.0; 5], "{k}");
            let mut out = vec![1.0; 5];
            fold2(&mut out, lane(0), lane(1), |o, x, y| o + x * 10.0 + y);
            assert_eq!(out, [24.0; 5]);
        }
    }
}
