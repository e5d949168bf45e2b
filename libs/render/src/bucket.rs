//! Buckets, the rectangles of pixels that are rendered one at a time, and their order (reference 4.1).

use crate::PixelRect;

/// The largest number of samples of one bucket. A larger "limits:bucketsize" is divided, which changes no pixel.
const MAX_SAMPLES: usize = 1 << 21;

/// The order in which buckets are started.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct BucketOrder<'a> {
    /// The order: "horizontal", "vertical" or "spiral". Any other word counts as "horizontal".
    pub(crate) word: &'a str,
    /// "limits:bucketblocksize", the number of buckets along each side of the clusters that are rendered one after
    /// the other. A spiral has no clusters.
    pub(crate) block: u32,
}

impl<'a> BucketOrder<'a> {
    /// Returns an order without clusters.
    pub(crate) fn plain(word: &'a str) -> Self {
        Self { word, block: 1 }
    }
}

/// The buckets of an image, in the order in which they are started.
#[derive(Clone, Debug)]
pub(crate) struct Buckets {
    /// The buckets in order.
    pub(crate) order: Vec<PixelRect>,
    /// The cut lines, for finding the buckets that a rectangle touches.
    xs: Vec<i32>,
    ys: Vec<i32>,
    /// The position in `order` of bucket (column, row), row by row.
    position: Vec<u32>,
}

impl Buckets {
    /// Cuts `crop` along multiples of `size` of the whole image.
    pub(crate) fn new(
        crop: &PixelRect,
        size: [u32; 2],
        order: BucketOrder<'_>,
        samples_per_pixel: usize,
    ) -> Self {
        let mut size = size.map(|s| s.max(1) as usize);
        while size[0] * size[1] * samples_per_pixel > MAX_SAMPLES && size != [1, 1] {
            let longer = usize::from(size[1] > size[0]);
            size[longer] = size[longer].div_ceil(2);
        }
        let cuts = |from: i32, to: i32, step: usize| {
            let mut cuts = vec![from];
            let step = i32::try_from(step).unwrap_or(i32::MAX);
            while let Some(last) = cuts.last().copied().filter(|last| *last < to) {
                cuts.push(((last / step + 1).saturating_mul(step)).min(to));
            }
            cuts
        };
        let (xs, ys) = (cuts(crop.x0, crop.x1, size[0]), cuts(crop.y0, crop.y1, size[1]));
        let (nx, ny) = (xs.len() - 1, ys.len() - 1);
        let mut cells: Vec<(usize, usize)> = (0..ny).flat_map(|j| (0..nx).map(move |i| (i, j))).collect();
        let block = order.block.max(1) as usize;
        match order.word {
            "vertical" => cells.sort_by_key(|(i, j)| (i / block, j / block, *i, *j)),
            "spiral" => cells.sort_by_key(|(i, j)| spiral_key(*i, *j, nx, ny)),
            _ => cells.sort_by_key(|(i, j)| (j / block, i / block, *j, *i)),
        }
        let mut position = vec![0; nx * ny];
        for (at, (i, j)) in cells.iter().enumerate() {
            position[j * nx + i] = u32::try_from(at).unwrap_or(u32::MAX);
        }
        let rect =
            |&(i, j): &(usize, usize)| PixelRect { x0: xs[i], x1: xs[i + 1], y0: ys[j], y1: ys[j + 1] };
        Self { order: cells.iter().map(rect).collect(), xs, ys, position }
    }

    /// Returns the ring of bucket `index` in a spiral around a pixel, and its position in the ring. The pixel may be
    /// outside of the image.
    pub(crate) fn turn_around(&self, index: usize, [x, y]: [i32; 2]) -> (usize, usize) {
        let cell = |cuts: &[i32], at: i32| {
            cuts.partition_point(|c| *c <= at).saturating_sub(1).min(cuts.len().saturating_sub(2))
        };
        let (middle, own) = ([cell(&self.xs, x), cell(&self.ys, y)], &self.order[index]);
        let [dx, dy] = [cell(&self.xs, own.x0), cell(&self.ys, own.y0)];
        turn(dx as isize - middle[0] as isize, dy as isize - middle[1] as isize)
    }

    /// Returns the first pixel rows of the rows of buckets, the end of the last one, and the number of buckets in a
    /// row.
    pub(crate) fn rows(&self) -> (&[i32], usize) {
        (&self.ys, self.xs.len() - 1)
    }

    /// Returns the columns and rows of buckets that share a pixel with `rect`.
    pub(crate) fn cells(&self, rect: &PixelRect) -> [std::ops::Range<usize>; 2] {
        let span = |cuts: &[i32], from: i32, to: i32| {
            let last = cuts.len() - 1;
            let a = cuts.partition_point(|c| *c <= from).saturating_sub(1);
            let b = cuts.partition_point(|c| *c < to).min(last);
            if from >= to || to <= cuts[0] || from >= cuts[last] { 0..0 } else { a..b }
        };
        [span(&self.xs, rect.x0, rect.x1), span(&self.ys, rect.y0, rect.y1)]
    }

    /// Returns the bucket in a column and a row.
    pub(crate) fn at(&self, column: usize, row: usize) -> usize {
        self.position[row * (self.xs.len() - 1) + column] as usize
    }

    /// Returns the column and the row of a bucket.
    pub(crate) fn cell(&self, index: usize) -> [usize; 2] {
        let at = |cuts: &[i32], from: i32| cuts.partition_point(|cut| *cut < from);
        self.order.get(index).map_or([0; 2], |rect| [at(&self.xs, rect.x0), at(&self.ys, rect.y0)])
    }

    /// Returns the positions of all buckets that share a pixel with `rect`, row by row.
    pub(crate) fn touching(&self, rect: &PixelRect) -> impl Iterator<Item = u32> + '_ {
        let [columns, rows] = self.cells(rect);
        let nx = self.xs.len() - 1;
        rows.flat_map(move |j| columns.clone().map(move |i| self.position[j * nx + i]))
    }
}

/// Returns the ring around the centre, and the position in the ring clockwise from its upper left corner.
fn spiral_key(i: usize, j: usize, nx: usize, ny: usize) -> (usize, usize) {
    turn(i as isize - (nx as isize - 1) / 2, j as isize - (ny as isize - 1) / 2)
}

/// Returns the ring of the bucket `dx` columns and `dy` rows from the centre, and its position in the ring.
fn turn(dx: isize, dy: isize) -> (usize, usize) {
    let ring = dx.abs().max(dy.abs());
    let along = if dy == -ring {
        dx + ring
    } else if dx == ring {
        2 * ring + dy + ring
    } else if dy == ring {
        4 * ring + ring - dx
    } else {
        6 * ring + ring - dy
    };
    (ring.unsigned_abs(), along.unsigned_abs())
}

#[cfg(test)]
mod tests {
    use super::*;

    const CROP: PixelRect = PixelRect { x0: 5, y0: 3, x1: 101, y1: 70 };

    #[test]
    fn every_pixel_is_in_one_bucket_in_every_order() {
        for order in ["horizontal", "vertical", "spiral"] {
            for size in [[32, 32], [7, 100], [4096, 4096], [1, 70]] {
                let buckets = Buckets::new(&CROP, size, BucketOrder { word: order, block: 3 }, 16);
                let mut seen = std::collections::BTreeSet::new();
                for b in &buckets.order {
                    assert!(!b.is_empty());
                    for y in b.y0..b.y1 {
                        for x in b.x0..b.x1 {
                            assert!(CROP.contains(&PixelRect::at(x, y, 1, 1)) && seen.insert((x, y)));
                        }
                    }
                }
                assert_eq!(seen.len(), CROP.width() * CROP.height(), "{order} {size:?}");
            }
        }
    }

    #[test]
    fn buckets_touching_a_rectangle_are_its_overlaps() {
        let buckets = Buckets::new(&CROP, [32, 16], BucketOrder::plain("spiral"), 16);
        let everything = PixelRect { x0: i32::MIN, y0: i32::MIN, x1: i32::MAX, y1: i32::MAX };
        for rect in [
            CROP,
            everything,
            PixelRect { x0: 0, y0: 0, x1: 5, y1: 9 },
            PixelRect { x0: 31, y0: 15, x1: 33, y1: 17 },
            PixelRect { x0: 40, y0: 40, x1: 40, y1: 50 },
            PixelRect { x0: 100, y0: 69, x1: 300, y1: 300 },
        ] {
            let mut got: Vec<u32> = buckets.touching(&rect).collect();
            got.sort_unstable();
            let expected: Vec<u32> = (0..buckets.order.len())
                .filter(|i| !buckets.order[*i].intersection(&rect).is_empty())
                .map(|i| i as u32)
                .collect();
            assert_eq!(got, expected, "{rect:?}");
            let cells = buckets.cells(&rect);
            let holds = |i: &usize| buckets.cell(*i).iter().zip(&cells).all(|(at, span)| span.contains(at));
            let of_cells: Vec<u32> = (0..buckets.order.len()).filter(holds).map(|i| i as u32).collect();
            assert_eq!(of_cells, expected, "{rect:?}");
        }
    }

    #[test]
    fn bucket_orders_begin_as_documented() {
        let crop = PixelRect { x0: 0, y0: 0, x1: 96, y1: 96 };
        let corners = |word, block| {
            let buckets = Buckets::new(&crop, [32, 32], BucketOrder { word, block }, 1);
            buckets.order.iter().map(|b| (b.x0 / 32, b.y0 / 32)).collect::<Vec<_>>()
        };
        assert_eq!(corners("horizontal", 1)[..4], [(0, 0), (1, 0), (2, 0), (0, 1)]);
        assert_eq!(corners("vertical", 1)[..4], [(0, 0), (0, 1), (0, 2), (1, 0)]);
        assert_eq!(corners("spiral", 1)[..3], [(1, 1), (0, 0), (1, 0)]);
        // Clusters of 2 x 2, and smaller ones at the border. 0 counts as 1.
        assert_eq!(corners("horizontal", 2)[..6], [(0, 0), (1, 0), (0, 1), (1, 1), (2, 0), (2, 1)]);
        assert_eq!(corners("vertical", 2)[..6], [(0, 0), (0, 1), (1, 0), (1, 1), (0, 2), (1, 2)]);
        assert_eq!(corners("spiral", 2), corners("spiral", 1));
        assert_eq!(corners("horizontal", 0), corners("horizontal", 1));
    }

    #[test]
    fn large_buckets_are_divided_between_threads() {
        let crop = PixelRect { x0: 0, y0: 0, x1: 2048, y1: 2048 };
        assert!(Buckets::new(&crop, [2048, 2048], BucketOrder::plain("horizontal"), 16).order.len() > 1);
    }
}
