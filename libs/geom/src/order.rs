//! The order of the parts of a primitive, which keeps neighbours together.

use granita_base::Vec3;

/// Returns the indices of `centres` in an order in which every half, quarter and so on is compact. The points are
/// split repeatedly at the median along the longest side of their box. Ties are resolved by index, so that the order
/// depends on nothing else.
pub(crate) fn spatial_order(centres: &[Vec3]) -> Vec<u32> {
    let mut order: Vec<u32> = (0..centres.len() as u32).collect();
    arrange(&mut order, centres);
    order
}

fn arrange(order: &mut [u32], centres: &[Vec3]) {
    if order.len() <= 2 {
        return;
    }
    let mut lo = Vec3::INFINITY;
    let mut hi = Vec3::NEG_INFINITY;
    for &i in order.iter() {
        lo = lo.min(centres[i as usize]);
        hi = hi.max(centres[i as usize]);
    }
    let size = hi - lo;
    let axis = if size.x >= size.y && size.x >= size.z {
        0
    } else if size.y >= size.z {
        1
    } else {
        2
    };
    // Pieces are halved at the same middle.
    let middle = order.len() / 2;
    order.select_nth_unstable_by(middle, |&a, &b| {
        centres[a as usize][axis].total_cmp(&centres[b as usize][axis]).then(a.cmp(&b))
    });
    let (left, right) = order.split_at_mut(middle);
    arrange(left, centres);
    arrange(right, centres);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spatial_order_is_a_permutation_that_separates_halves() {
        let centres: Vec<Vec3> = (0..101).map(|i| Vec3::new((i * 37 % 101) as f32, 0.0, 0.0)).collect();
        let order = spatial_order(&centres);
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert!(sorted.iter().copied().eq(0..101));
        let (left, right) = order.split_at(50);
        let most = |list: &[u32]| list.iter().map(|&i| centres[i as usize].x as i32).max();
        let least = |list: &[u32]| list.iter().map(|&i| centres[i as usize].x as i32).min();
        assert!(most(left) < least(right));
    }
}
