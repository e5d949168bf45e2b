//! The sums of `diffuse` and `specular`, over strips of lanes.

use super::approx;
use crate::{Lane, LightSample};
use granita_base::Vec3;

/// The number of lanes of a strip.
const STRIP: usize = 16;

/// The numbers of a strip.
type Numbers = [f32; STRIP];

/// The surface that gathers light. Normals and view vectors are of unit length.
pub(crate) struct Gather<'a> {
    pub(crate) normal: [Lane<'a>; 3],
    /// The view vector and the roughness, for the sum of `specular`; `None` for that of `diffuse`.
    pub(crate) highlight: Option<([Lane<'a>; 3], Lane<'a>)>,
    /// True for the lanes that need a sum.
    pub(crate) on: &'a [bool],
}

/// Returns max (0, N.H) ^ (8 / roughness), with H halfway between light and viewer. All vectors have unit length.
///
/// The reference names no formula. This is the lobe of Blinn, "Models of Light Reflection for Computer Synthesized
/// Images", SIGGRAPH 1977, with the exponent 8 / roughness that BMRT and Aqsis use for `specular ()`.
pub(crate) fn brdf(l: Vec3, n: Vec3, v: Vec3, roughness: f32) -> f32 {
    let h = (l + v).normalize_or_zero();
    let cos = n.dot(h).max(0.0);
    if cos == 0.0 { 0.0 } else { super::lanes::pow(cos, 8.0 / roughness.max(1e-6)) }
}

/// Adds the light of a sample to the sums of the lanes that it reaches from the front: Cl max (0, N.L) (1 - without),
/// or for highlights Cl [`brdf`] (L, N, V, roughness) (1 - without). An absent number of `without` is 0.
#[inline(always)]
pub(super) fn gather(gather: &Gather<'_>, sample: &LightSample, without: &[f32], sums: &mut [&mut [f32]; 3]) {
    let n = sums[0].len();
    let lit = |i: usize| gather.on.get(i) == Some(&true) && sample.lit.get(i) == Some(&true);
    for from in (0..n).step_by(STRIP) {
        let lit: [bool; STRIP] = std::array::from_fn(|k| lit(from + k));
        if lit == [false; STRIP] {
            continue;
        }
        let mut l = sample.l.xyz.each_ref().map(|values| numbers(values, from));
        normalize(&mut l);
        let normal = gather.normal.map(|lane| spread(lane, from));
        let cos = dot(&l, &normal);
        let shines: [bool; STRIP] = std::array::from_fn(|k| lit[k] & (cos[k] > 0.0));
        if shines == [false; STRIP] {
            continue;
        }
        let factor = match &gather.highlight {
            None => cos,
            Some((view, roughness)) => {
                let view = view.map(|lane| spread(lane, from));
                lobe(&l, &normal, &view, &spread(*roughness, from), &shines)
            }
        };
        let without = numbers(without, from);
        let scale: Numbers = std::array::from_fn(|k| factor[k] * (1.0 - without[k]));
        for (sum, cl) in sums.iter_mut().zip(&sample.cl.xyz) {
            let cl = numbers(cl, from);
            let end = n.min(from + STRIP);
            let before = numbers(sum, from);
            let after: Numbers =
                std::array::from_fn(|k| if shines[k] { before[k] + cl[k] * scale[k] } else { before[k] });
            sum[from..end].copy_from_slice(&after[..end - from]);
        }
    }
}

/// Does the same as [`brdf`] for the lanes of `shines`.
#[inline(always)]
fn lobe(
    l: &[Numbers; 3],
    n: &[Numbers; 3],
    v: &[Numbers; 3],
    roughness: &Numbers,
    shines: &[bool; STRIP],
) -> Numbers {
    let mut h: [Numbers; 3] = std::array::from_fn(|c| std::array::from_fn(|k| l[c][k] + v[c][k]));
    normalize(&mut h);
    let cos = dot(n, &h);
    let exponent: Numbers =
        std::array::from_fn(|k| 8.0 / if roughness[k] > 1e-6 { roughness[k] } else { 1e-6 });
    let power: Numbers = std::array::from_fn(|k| approx::pow_ordinary(cos[k], exponent[k]));
    let mut out: Numbers = std::array::from_fn(|k| if cos[k] > 0.0 { power[k] } else { 0.0 });
    let known: [bool; STRIP] =
        std::array::from_fn(|k| !(shines[k] & (cos[k] > 0.0)) | approx::pow_is_ordinary(cos[k], exponent[k]));
    if known != [true; STRIP] {
        for k in (0..STRIP).filter(|k| !known[*k]) {
            out[k] = libm::powf(cos[k], exponent[k]);
        }
    }
    out
}

/// Gives vectors unit length, and makes those zero that have none, as [`Vec3::normalize_or_zero`].
#[inline(always)]
fn normalize(v: &mut [Numbers; 3]) {
    let scale: Numbers =
        std::array::from_fn(|k| 1.0 / (v[0][k] * v[0][k] + v[1][k] * v[1][k] + v[2][k] * v[2][k]).sqrt());
    let is_usable: [bool; STRIP] = std::array::from_fn(|k| scale[k] > 0.0 && scale[k] < f32::INFINITY);
    for component in v {
        for k in 0..STRIP {
            component[k] = if is_usable[k] { component[k] * scale[k] } else { 0.0 };
        }
    }
}

#[inline(always)]
fn dot(a: &[Numbers; 3], b: &[Numbers; 3]) -> Numbers {
    std::array::from_fn(|k| a[0][k] * b[0][k] + a[1][k] * b[1][k] + a[2][k] * b[2][k])
}

/// Returns the numbers of the strip that begins at `from`, 0 beyond their end.
#[inline(always)]
fn numbers(values: &[f32], from: usize) -> Numbers {
    if let Some(strip) = values.get(from..from + STRIP).and_then(|strip| strip.try_into().ok()) {
        return strip;
    }
    let rest = values.get(from..).unwrap_or_default();
    let mut strip = [0.0; STRIP];
    strip[..rest.len()].copy_from_slice(rest);
    strip
}

#[inline(always)]
fn spread(lane: Lane<'_>, from: usize) -> Numbers {
    match lane.stride {
        0 => [lane.values[0]; STRIP],
        _ => numbers(lane.values, from),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Lanes3;
    use granita_base::hash;

    #[test]
    fn highlights_have_the_values_of_the_formula() {
        let n = Vec3::Z;
        assert_eq!(brdf(n, n, n, 0.1), 1.0);
        // H at 45 degrees: cos^16 is 1/256 at roughness 0.5, cos^8 is 1/16 at 1.
        let (l, v) = (Vec3::X, Vec3::Z);
        assert!((brdf(l, n, v, 0.5) - 1.0 / 256.0).abs() < 1e-7);
        assert!((brdf(l, n, v, 1.0) - 1.0 / 16.0).abs() < 1e-6);
        // Light and viewer are opposite, so there is no halfway direction.
        assert_eq!(brdf(Vec3::X, n, -Vec3::X, 0.1), 0.0);
        assert!(brdf(l, n, v, 0.0).is_finite() && brdf(n, n, n, 0.0) == 1.0);
    }

    /// Adds the light of a sample lane by lane.
    fn one_by_one(to: &Gather<'_>, sample: &LightSample, without: &[f32], sums: &mut Lanes3) {
        for i in 0..sums.len() {
            let get = |lanes: &[Lane<'_>; 3]| Vec3::from(lanes.map(|lane| lane.get(i)));
            let (l, n) = (sample.l.get(i).normalize_or_zero(), get(&to.normal));
            let cos = n.dot(l);
            if !to.on[i] || !sample.lit.get(i).copied().unwrap_or(false) || cos.is_nan() || cos <= 0.0 {
                continue;
            }
            let factor = to.highlight.as_ref().map_or(cos, |(v, r)| brdf(l, n, get(v), r.get(i)));
            let scale = factor * (1.0 - without.get(i).copied().unwrap_or(0.0));
            sums.set(i, sums.get(i) + sample.cl.get(i) * scale);
        }
    }

    #[test]
    fn strips_have_the_sums_of_single_lanes_to_the_bit() {
        for count in [1_usize, 15, 16, 17, 100, 403] {
            let unusual = [0.0, -0.0, f32::NAN, f32::INFINITY, 1e-30, 1e30, f32::MIN_POSITIVE, -1e38];
            let random = |salt: u32, i: usize| {
                let word = hash::words(&[salt, i as u32]);
                if word.is_multiple_of(37) {
                    unusual[word as usize / 37 % 8]
                } else {
                    2.0 * hash::unit(word) - 1.0
                }
            };
            let lanes = |salt: u32| {
                let mut own = Lanes3::zeros(count);
                for (c, part) in (0..).zip(own.xyz.iter_mut()) {
                    part.iter_mut().enumerate().for_each(|(i, x)| *x = random(salt + c, i));
                }
                own
            };
            let unit = |salt: u32| {
                let mut own = lanes(salt);
                (0..count).for_each(|i| own.set(i, own.get(i).normalize_or_zero()));
                own
            };
            let (n, v) = (unit(10), unit(20));
            let flags = |salt: u32| (0..count).map(|i| random(salt, i) > -0.6).collect::<Vec<_>>();
            let sample =
                LightSample { l: lanes(30), cl: lanes(40), lit: flags(50), ..LightSample::default() };
            let roughness: Vec<f32> = (0..count).map(|i| random(60, i) * random(61, i)).collect();
            let on = flags(70);
            for (highlight, without) in
                [(false, lanes(80).xyz[0].clone()), (true, Vec::new()), (true, vec![0.25])]
            {
                let highlight =
                    highlight.then(|| (crate::Lane3::over(&v).xyz, Lane { values: &roughness, stride: 1 }));
                let to = Gather { normal: crate::Lane3::over(&n).xyz, highlight, on: &on };
                let (mut strips, mut wide, mut single) = (lanes(90), lanes(90), lanes(90));
                let [x, y, z] = &mut strips.xyz;
                gather(&to, &sample, &without, &mut [x, y, z]);
                let [x, y, z] = &mut wide.xyz;
                crate::run::simd::gather(&to, &sample, &without, &mut [x, y, z]);
                one_by_one(&to, &sample, &without, &mut single);
                let bits = |lanes: &Lanes3| {
                    let of = |x: &f32| if x.is_nan() { u32::MAX } else { x.to_bits() };
                    lanes.xyz.iter().flatten().map(of).collect::<Vec<_>>()
                };
                assert_eq!(bits(&strips), bits(&single), "{count}");
                assert_eq!(bits(&wide), bits(&single), "{count}");
                assert!(count < 100 || bits(&single) != bits(&lanes(90)));
            }
        }
    }
}
