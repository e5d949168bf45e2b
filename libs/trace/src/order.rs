//! The order in which the rays of a batch are traced.
//!
//! Rays that traverse the same nodes one after the other find the nodes in the processor's cache. A large batch whose
//! rays are not coherent is therefore sorted by where the rays enter the scene and by their directions, along a
//! space-filling curve in these five dimensions. The hits do not depend on the order. A coherent batch is not sorted,
//! because sorting costs about as much as tracing coherent rays.

use crate::Ray;
use crate::layout::Box3;
use granita_base::Vec3;

/// Batches with fewer rays than this are not sorted.
const FEW: usize = 256;
/// The largest number of rays that are sorted together. It keeps the data of the sort in the processor's cache.
pub(crate) const MANY: usize = 1 << 18;
/// The number of levels of the curve.
const LEVELS: u32 = 6;
/// The number of pairs of neighbouring rays that are compared.
const PAIRS: usize = 64;

/// Computes the sort keys of rays.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sorter {
    lo: Vec3,
    hi: Vec3,
    /// The number of steps per unit of the coordinates.
    scale: Vec3,
}

impl Sorter {
    /// Returns a sorter for a scene within these bounds, in the coordinates of the tree.
    pub(crate) fn new(bounds: &Box3) -> Self {
        let (lo, hi) = (Vec3::from_array(bounds.lo), Vec3::from_array(bounds.hi));
        let size = hi - lo;
        let steps = (1 << LEVELS) as f32;
        let step = |s: f32| if s > f32::MIN_POSITIVE { steps / s } else { 0.0 };
        Self { lo, hi, scale: Vec3::new(step(size.x), step(size.y), step(size.z)) }
    }

    /// Returns the indices of the rays in the order in which to trace them; `None` when the order is not changed.
    pub(crate) fn order(&self, rays: &[Ray]) -> Option<Vec<u32>> {
        if rays.len() < FEW || self.is_coherent(rays) {
            return None;
        }
        let keyed: Vec<(u32, u32)> = rays.iter().enumerate().map(|(i, r)| (self.key(r), i as u32)).collect();
        Some(sorted(keyed))
    }

    /// True when most rays are similar to the ray before.
    fn is_coherent(&self, rays: &[Ray]) -> bool {
        let step = ((rays.len() - 1) / PAIRS).max(1);
        // Two places are near when they are within a cell of the middle levels, or in neighbouring cells.
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

    /// Returns the position on the curve. It is undefined for rays that are not finite.
    #[inline]
    fn key(&self, ray: &Ray) -> u32 {
        let inverse = 1.0 / ray.dir;
        let (a, b) = ((self.lo - ray.origin) * inverse, (self.hi - ray.origin) * inverse);
        let enters = a.min(b).max_element().max(ray.tmin);
        let enters = if enters.is_finite() { enters } else { 0.0 };
        let at = (ray.origin + ray.dir * enters - self.lo) * self.scale;
        // The direction is mapped to the two coordinates of an octahedron.
        let length = ray.dir.abs().dot(Vec3::ONE);
        let d = ray.dir / length;
        let (mut u, mut v) = (d.x, d.y);
        if d.z < 0.0 {
            (u, v) = ((1.0 - d.y.abs()).copysign(d.x), (1.0 - d.x.abs()).copysign(d.y));
        }
        let most = (1 << LEVELS) - 1;
        // Casts saturate and convert NaN to 0.
        let whole = |x: f32| (x as i32).clamp(0, most) as u32;
        let half = (1 << (LEVELS - 1)) as f32;
        [whole(at.x), whole(at.y), whole(at.z), whole((u + 1.0) * half), whole((v + 1.0) * half)]
            .into_iter()
            .enumerate()
            .fold(0, |key, (d, x)| key | SPREAD[x as usize] << (4 - d))
    }
}

/// The bits of each number up to 63, spread five places apart.
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

/// Returns the second values in the order of the first values, which have 30 bits.
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
