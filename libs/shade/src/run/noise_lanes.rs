//! Noise over lanes. The lattice has no branches, so that the loops vectorise. `noise` of [`crate::ops`] describes
//! the kinds of noise.

use crate::Lane;
use granita_base::hash::mix32;

/// The noise to compute, and its arguments.
#[derive(Clone, Copy, Debug)]
pub(crate) struct NoiseTask<'v> {
    /// The coordinates, one per dimension, then `None`.
    pub(crate) x: [Option<Lane<'v>>; 4],
    /// Their whole periods, 0 for none; `None` for noise without periods.
    pub(crate) periods: Option<[Lane<'v>; 4]>,
    /// The kind of result.
    pub(crate) kind: NoiseKind,
}

/// The range and kind of a noise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum NoiseKind {
    /// Smooth, within [-1, 1].
    Signed,
    /// Smooth, within [0, 1].
    Unsigned,
    /// One number in (0, 1) per cell.
    Cell,
}

/// The number of lanes that are computed together.
const CHUNK: usize = 32;

/// Computes component `component` of the noise for the lanes of `out`.
#[inline(always)]
pub(super) fn noise(task: &NoiseTask<'_>, component: u32, out: &mut [f32]) {
    match task.x.iter().flatten().count() {
        1 => chunks::<1>(task, component, out),
        2 => chunks::<2>(task, component, out),
        3 => chunks::<3>(task, component, out),
        _ => chunks::<4>(task, component, out),
    }
}

#[inline(always)]
fn chunks<const D: usize>(task: &NoiseTask<'_>, component: u32, out: &mut [f32]) {
    let periodic = task.periods.is_some();
    for (number, out) in out.chunks_mut(CHUNK).enumerate() {
        let from = number * CHUNK;
        if out.len() < 4 {
            for (l, o) in out.iter_mut().enumerate() {
                let x = std::array::from_fn(|k| task.x[k].map_or(0.0, |lane| lane.get(from + l)));
                let periods =
                    task.periods.map_or([0; D], |p| std::array::from_fn(|k| period(p[k].get(from + l))));
                *o = one::<D>(x, periods, periodic, task.kind, component);
            }
            continue;
        }
        let mut x = [[0.0; CHUNK]; D];
        for (to, lane) in x.iter_mut().zip(task.x.iter().flatten()) {
            if lane.stride == 0 {
                to.fill(lane.values[0]);
            } else {
                to[..out.len()].copy_from_slice(&lane.values[from..from + out.len()]);
            }
        }
        let mut result = [0.0; CHUNK];
        if let Some(lanes) = &task.periods {
            let mut periods = [[1_u32; CHUNK]; D];
            for (to, lane) in periods.iter_mut().zip(lanes) {
                if lane.stride == 0 {
                    to.fill(period(lane.values[0]));
                } else {
                    for (to, v) in to.iter_mut().zip(&lane.values[from..from + out.len()]) {
                        *to = period(*v);
                    }
                }
            }
            if D == 4 {
                smooth_passes::<D>(&x, Some(&periods), component, &mut result);
            } else {
                for l in 0..CHUNK {
                    let periods = std::array::from_fn(|k| periods[k][l]);
                    result[l] = smooth::<D>(std::array::from_fn(|k| x[k][l]), periods, true, component);
                }
            }
            if task.kind == NoiseKind::Unsigned {
                result.iter_mut().for_each(|v| *v = 0.5 + 0.5 * *v);
            }
            out.copy_from_slice(&result[..out.len()]);
            continue;
        }
        match task.kind {
            NoiseKind::Signed | NoiseKind::Unsigned if D == 4 => {
                smooth_passes::<D>(&x, None, component, &mut result);
                if task.kind == NoiseKind::Unsigned {
                    result.iter_mut().for_each(|v| *v = 0.5 + 0.5 * *v);
                }
            }
            NoiseKind::Signed => {
                for l in 0..CHUNK {
                    result[l] = smooth::<D>(std::array::from_fn(|k| x[k][l]), [0; D], false, component);
                }
            }
            NoiseKind::Unsigned => {
                for l in 0..CHUNK {
                    let v = smooth::<D>(std::array::from_fn(|k| x[k][l]), [0; D], false, component);
                    result[l] = 0.5 + 0.5 * v;
                }
            }
            NoiseKind::Cell => {
                for l in 0..CHUNK {
                    result[l] = cellular::<D>(std::array::from_fn(|k| x[k][l]), component);
                }
            }
        }
        out.copy_from_slice(&result[..out.len()]);
    }
}

/// Computes one lane.
#[inline(always)]
pub(crate) fn one<const D: usize>(
    x: [f32; D],
    periods: [u32; D],
    periodic: bool,
    kind: NoiseKind,
    component: u32,
) -> f32 {
    match kind {
        NoiseKind::Cell => cellular::<D>(x, component),
        NoiseKind::Signed => smooth::<D>(x, periods, periodic, component),
        NoiseKind::Unsigned => 0.5 + 0.5 * smooth::<D>(x, periods, periodic, component),
    }
}

/// Returns the period of a float argument: rounded down, at least 1.
#[inline(always)]
pub(crate) fn period(x: f32) -> u32 {
    let p = x.floor();
    if p >= 1.0 { p as u32 } else { 1 }
}

/// Hashes one lattice coordinate into a running hash.
#[inline(always)]
fn step(h: u32, i: i32) -> u32 {
    mix32(h ^ i as u32).wrapping_add(0x9e37_79b9)
}

/// Returns the lattice cell and the position in it. NaN lies at 0.
#[inline(always)]
fn cell(x: f32) -> (i32, f32) {
    // `as` saturates. Beyond 2^24 floats are whole numbers, so the position in the cell is 0.
    let toward_zero = x as i32;
    let whole = toward_zero as f32;
    let down = whole > x && x > -2_147_483_648.0;
    let i = toward_zero.wrapping_sub(i32::from(down));
    let t = x - (whole - if down { 1.0 } else { 0.0 });
    (i, if (0.0..=1.0).contains(&t) { t } else { 0.0 })
}

/// Repeats a lattice coordinate: the non-negative remainder of a division by a period of at least 1.
#[inline(always)]
fn wrap(i: i32, period: u32) -> i32 {
    let period = period.min(i32::MAX as u32) as i32;
    // Double precision holds quotients of 32 bits exactly enough, and its division vectorises.
    let quotient = (f64::from(i) / f64::from(period)) as i32;
    let rest = i.wrapping_sub(quotient.wrapping_mul(period));
    if rest < 0 { rest.wrapping_add(period) } else { rest }
}

#[inline(always)]
fn fade(t: f32) -> f32 {
    t * t * t * (t * (t * 6.0 - 15.0) + 10.0)
}

#[inline(always)]
fn lerp(t: f32, a: f32, b: f32) -> f32 {
    a + t * (b - a)
}

/// Returns `x` or `-x` by a bit of a hash.
#[inline(always)]
fn signed(h: u32, bit: u32, x: f32) -> f32 {
    f32::from_bits(x.to_bits() ^ (h >> bit & 1) << 31)
}

/// Returns the dot product of a hashed gradient and the offset from its corner.
#[inline(always)]
fn gradient<const D: usize>(h: u32, d: [f32; D]) -> f32 {
    match D {
        // Slopes from -1 to 1.
        1 => ((h >> 8) as i32 as f32 * (1.0 / 16_777_216.0) * 2.0 - 1.0) * d[0],
        // Eight directions of length one.
        2 => {
            const R: f32 = std::f32::consts::FRAC_1_SQRT_2;
            let (x, y) = (signed(h, 0, d[0]), signed(h, 1, d[1]));
            let across = signed(h, 0, d[1]);
            let slanted = R * (x + y);
            let straight = if h >> 30 == 0 { x } else { across };
            if h >> 30 < 2 { straight } else { slanted }
        }
        // Directions to the centres of the edges of a cube, or of a hypercube.
        _ => {
            let skip = ((h >> 16) * D as u32) >> 16;
            let mut sum = 0.0;
            for (k, x) in d.into_iter().enumerate() {
                let term = signed(h, k as u32, x);
                sum += if k as u32 == skip { 0.0 } else { term };
            }
            sum
        }
    }
}

/// Returns the factor that scales the sum of the blended gradients to at most 1. With one and two dimensions the
/// largest value is at a cell's centre. With three it is 1.0363538 near the centre. With four a search finds
/// 1.5354. Values at the bound are clamped against rounding.
pub(crate) fn scale(d: usize) -> f32 {
    match d {
        1 => 2.0,
        2 => std::f32::consts::SQRT_2,
        3 => 1.0 / 1.036_354,
        _ => 1.0 / 1.5355,
    }
}

/// Returns signed noise within [-1, 1], with mean 0.
#[inline(always)]
fn smooth<const D: usize>(x: [f32; D], periods: [u32; D], periodic: bool, component: u32) -> f32 {
    let mut lattice = [[0; 2]; D];
    let mut t = [0.0; D];
    for k in 0..D {
        let (i, f) = cell(x[k]);
        let next = i.wrapping_add(1);
        lattice[k] = if periodic { [wrap(i, periods[k]), wrap(next, periods[k])] } else { [i, next] };
        t[k] = f;
    }
    // Hashes and gradients of all corners, bit k of the corner's number is its side along axis k.
    let mut hashes = [0; 16];
    hashes[0] = step(0x736e_6f69, component as i32 ^ ((D as i32) << 8));
    for (k, sides) in lattice.iter().enumerate() {
        for corner in 0..1 << k {
            let h = hashes[corner];
            hashes[corner] = step(h, sides[0]);
            hashes[corner | 1 << k] = step(h, sides[1]);
        }
    }
    let mut values = [0.0; 16];
    for corner in 0..1 << D {
        let offset = std::array::from_fn(|k| t[k] - (corner >> k & 1) as f32);
        values[corner] = gradient::<D>(mix32(hashes[corner]), offset);
    }
    // Blending starts with the last axis, which halves the list.
    for k in (0..D).rev() {
        let w = fade(t[k]);
        for corner in 0..1 << k {
            values[corner] = lerp(w, values[corner], values[corner | 1 << k]);
        }
    }
    (values[0] * scale(D)).clamp(-1.0, 1.0)
}

/// Does the same as [`smooth`] for all lanes at once, with a pass over the lanes for each corner. Sixteen corners
/// are too many for one loop over lanes.
#[inline(always)]
fn smooth_passes<const D: usize>(
    x: &[[f32; CHUNK]; D],
    periods: Option<&[[u32; CHUNK]; D]>,
    component: u32,
    out: &mut [f32; CHUNK],
) {
    let mut lattice = [[[0_i32; CHUNK]; 2]; D];
    let mut t = [[0.0_f32; CHUNK]; D];
    for k in 0..D {
        let [low, high] = &mut lattice[k];
        for l in 0..CHUNK {
            (low[l], t[k][l]) = cell(x[k][l]);
            high[l] = low[l].wrapping_add(1);
        }
        if let Some(periods) = periods {
            for side in [low, high] {
                for (i, p) in side.iter_mut().zip(&periods[k]) {
                    *i = wrap(*i, *p);
                }
            }
        }
    }
    // Bit k of a corner's number is its side along axis k.
    let mut hashes = [[0_u32; CHUNK]; 16];
    hashes[0].fill(step(0x736e_6f69, component as i32 ^ ((D as i32) << 8)));
    for (k, [low, high]) in lattice.iter().enumerate() {
        let (known, next) = hashes.split_at_mut(1 << k);
        for (a, b) in known.iter_mut().zip(next) {
            for l in 0..CHUNK {
                b[l] = step(a[l], high[l]);
                a[l] = step(a[l], low[l]);
            }
        }
    }
    let mut values = [[0.0_f32; CHUNK]; 16];
    for (corner, (values, hashes)) in values.iter_mut().zip(&hashes).take(1 << D).enumerate() {
        let sides: [f32; D] = std::array::from_fn(|k| (corner >> k & 1) as f32);
        for l in 0..CHUNK {
            values[l] = gradient::<D>(mix32(hashes[l]), std::array::from_fn(|k| t[k][l] - sides[k]));
        }
    }
    for k in (0..D).rev() {
        let mut w = t[k];
        w.iter_mut().for_each(|t| *t = fade(*t));
        let (near, far) = values.split_at_mut(1 << k);
        for (a, b) in near.iter_mut().zip(far) {
            for l in 0..CHUNK {
                a[l] = lerp(w[l], a[l], b[l]);
            }
        }
    }
    for (o, v) in out.iter_mut().zip(&values[0]) {
        *o = (v * scale(D)).clamp(-1.0, 1.0);
    }
}

/// Returns a number in (0, 1) for the cell of `x`.
#[inline(always)]
fn cellular<const D: usize>(x: [f32; D], component: u32) -> f32 {
    let mut h = step(0x636e_6f69, component as i32 ^ ((D as i32) << 8));
    for x in x {
        h = step(h, cell(x).0);
    }
    open_unit(mix32(h))
}

/// Returns a number from a hash, never 0 and never 1.
#[inline(always)]
pub(crate) fn open_unit(h: u32) -> f32 {
    ((h >> 9) as i32 as f32 + 0.5) * (1.0 / 8_388_608.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Wide, narrow and one by one: the same to the bit.
    #[test]
    fn noise_is_the_same_in_wide_narrow_and_single_lanes() {
        let mut values: Vec<f32> = (0..75).map(|k| (k as f32 - 37.0) * 1.37).collect();
        values.extend([0.0, -0.0, 1.0, -1.0, 1e-30, 3e9, -3e9, 1e30, f32::MAX]);
        values.extend([f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 16_777_217.0, -2_147_483_648.0]);
        let lists: [Vec<f32>; 4] = std::array::from_fn(|k| {
            let mut list = values.clone();
            list.rotate_left(k * 7);
            list
        });
        let periods: [Vec<f32>; 4] = std::array::from_fn(|k| {
            (0..values.len()).map(|i| [3.0, 1.0, 0.5, 70_000.0, -2.0, 7.9][(i + k) % 6]).collect()
        });
        let lane = |v| Lane { values: v, stride: 1 };
        let n = values.len();
        for d in 1..=4 {
            for kind in [NoiseKind::Signed, NoiseKind::Unsigned, NoiseKind::Cell] {
                for periodic in [false, true] {
                    if periodic && kind == NoiseKind::Cell {
                        continue;
                    }
                    // Sometimes a coordinate is the same for all.
                    for uniform in [5, d - 1] {
                        let coordinate = |k: usize| {
                            if k == uniform {
                                Lane { values: &lists[k][..1], stride: 0 }
                            } else {
                                lane(&lists[k])
                            }
                        };
                        let task = NoiseTask {
                            x: std::array::from_fn(|k| (k < d).then(|| coordinate(k))),
                            periods: periodic.then(|| std::array::from_fn(|k| lane(&periods[k]))),
                            kind,
                        };
                        let (mut wide, mut narrow) = (vec![9.0; n], vec![9.0; n]);
                        super::super::simd::noise(&task, 2, &mut wide);
                        noise(&task, 2, &mut narrow);
                        let bits = |v: &[f32]| v.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
                        assert_eq!(bits(&wide), bits(&narrow), "{d} {task:?}");
                        for (i, together) in wide.iter().enumerate() {
                            let x = std::array::from_fn::<_, 4, _>(|k| task.x[k].map(|x| [x.get(i)]));
                            let p = task.periods.map(|p| p.map(|p| [p.get(i)]));
                            let one = |v| Lane { values: v, stride: 0 };
                            let alone = NoiseTask {
                                x: std::array::from_fn(|k| x[k].as_ref().map(|v| one(&v[..]))),
                                periods: p.as_ref().map(|p| std::array::from_fn(|k| one(&p[k][..]))),
                                kind,
                            };
                            let mut value = [9.0];
                            noise(&alone, 2, &mut value);
                            assert_eq!(value[0].to_bits(), together.to_bits(), "{d} {kind:?} {i}");
                        }
                    }
                }
            }
        }
    }

    #[test]
    fn wrapping_equals_the_euclidean_remainder() {
        for i in [0, 1, -1, 5, -5, 17, 1_000_003, -1_000_003, i32::MAX, i32::MIN, i32::MIN + 1] {
            for p in [1, 2, 3, 7, 100, 65_536, 1_000_000_007, i32::MAX] {
                assert_eq!(wrap(i, p as u32), i.rem_euclid(p), "{i} {p}");
            }
        }
    }
}
