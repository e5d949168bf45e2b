//! The order in which the rays of a batch are traced.
//!
//! Rays that follow each other through the same nodes find them near. A large batch whose rays do not follow each
//! other is sorted by where they come in and which way they go, along a space-filling curve in those five
//! dimensions; what is found does not depend on the order. A batch that is in order is left as it is: sorting
//! costs about as much as tracing coherent rays.

use crate::Ray;
use crate::layout::Box3;
use granita_base::Vec3;

/// Smaller batches are not worth sorting.
const FEW: usize = 256;
/// Rays sorted together, at most: what the sorting itself touches stays near.
pub(crate) const MANY: usize = 1 << 18;
/// Levels of the curve.
const LEVELS: u32 = 6;
/// Pairs of neighbours that are looked at.
const PAIRS: usize = 64;

/// Makes keys of rays.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sorter {
    lo: Vec3,
    hi: Vec3,
    /// Steps per unit.
    scale: Vec3,
}

impl Sorter {
    /// For a scene within these bounds, in its own coordinates.
    pub(crate) fn new(bounds: &Box3) -> Self {
        let (lo, hi) = (Vec3::from_array(bounds.lo), Vec3::from_array(bounds.hi));
        let size = hi - lo;
        let steps = (1 << LEVELS) as f32;
        let step = |s: f32| if s > f32::MIN_POSITIVE { steps / s } else { 0.0 };
        Self { lo, hi, scale: Vec3::new(step(size.x), step(size.y), step(size.z)) }
    }

    /// Indices of the rays in the order in which to trace them; `None` for that in which they are.
    pub(crate) fn order(&self, rays: &[Ray]) -> Option<Vec<u32>> {
        if rays.len() < FEW || self.is_coherent(rays) {
            return None;
        }
        let keyed: Vec<(u32, u32)> = rays.iter().enumerate().map(|(i, r)| (self.key(r), i as u32)).collect();
        Some(sorted(keyed))
    }

    /// Whether most rays are like the one before.
    fn is_coherent(&self, rays: &[Ray]) -> bool {
        let step = ((rays.len() - 1) / PAIRS).max(1);
        // Within a cell of the middle levels, or across the border of one.
        let near = |a: u32, b: u32| {
            (0..5).all(|d| {
                let at = |key: u32| (0..3).fold(0_i32, |v, l| v << 1 | (key >> (29 - d - 5 * l) & 1) as i32);
                (at(a) - at(b)).abs() <= 1
            })
        };
        let pairs = (0..rays.len() - 1).step_by(step);
        let count = pairs.len();
        pairs.filter(|&i| near(self.key(&rays[i]), self.key(&rays[i + 1]))).count() * 4 > count * 3
    }

    /// Place on the curve. Any number for rays that are not finite.
    #[inline]
    fn key(&self, ray: &Ray) -> u32 {
        let inverse = 1.0 / ray.dir;
        let (a, b) = ((self.lo - ray.origin) * inverse, (self.hi - ray.origin) * inverse);
        let enters = a.min(b).max_element().max(ray.tmin);
        let enters = if enters.is_finite() { enters } else { 0.0 };
        let at = (ray.origin + ray.dir * enters - self.lo) * self.scale;
        // The octahedron's two coordinates.
        let length = ray.dir.abs().dot(Vec3::ONE);
        let d = ray.dir / length;
        let (mut u, mut v) = (d.x, d.y);
        if d.z < 0.0 {
            (u, v) = ((1.0 - d.y.abs()).copysign(d.x), (1.0 - d.x.abs()).copysign(d.y));
        }
        let most = (1 << LEVELS) - 1;
        // Casts saturate, and make 0 of NaN.
        let whole = |x: f32| (x as i32).clamp(0, most) as u32;
        let half = (1 << (LEVELS - 1)) as f32;
        [whole(at.x), whole(at.y), whole(at.z), whole((u + 1.0) * half), whole((v + 1.0) * half)]
            .into_iter()
            .enumerate()
            .fold(0, |key, (d, x)| key | SPREAD[x as usize] << (4 - d))
    }
}

/// The bits of each number up to 63, five places apart.
const SPREAD: [u32; 1 << LEVELS] = {
    let mut table = [0; 1 << LEVELS];
    let mut x = 0;
    while x < table.len() {
        let mut bit = 0;
        while bit < LEVELS {
            table[x] |= (x as u32 >> bit & 1) << (5 * bit);
            bit += 1;
        }
        x += 1;
    }
    table
};

/// Second values in the order of the first, of 30 bits.
fn sorted(mut keyed: Vec<(u32, u32)>) -> Vec<u32> {
    const DIGIT: u32 = 10;
    let mut other = vec![(0, 0); keyed.len()];
    for shift in [0, DIGIT, 2 * DIGIT] {
        let digit = |key: u32| (key >> shift & ((1 << DIGIT) - 1)) as usize;
        let mut next = [0_u32; 1 << DIGIT];
        for &(key, _) in &keyed {
            next[digit(key)] += 1;
        }
        let mut sum = 0;
        for n in &mut next {
            (sum, *n) = (sum + *n, sum);
        }
        for &pair in &keyed {
            let at = &mut next[digit(pair.0)];
            other[*at as usize] = pair;
            *at += 1;
        }
        std::mem::swap(&mut keyed, &mut other);
    }
    keyed.into_iter().map(|(_, index)| index).collect()
}
