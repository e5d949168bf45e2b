//! The objects or materials that samples see, with their shares, and the pixels of a Cryptomatte from them.
//!
//! A sample has a list of mattes, each with the share of the sample that it covers. The shares are those of alpha: the
//! mean opacity of each layer, multiplied by what passes the layers before it. Motion blur, depth of field and
//! transparency thus count as they do in the image, and the shares of all mattes of a pixel add up to its alpha.

use crate::SampleGrid;
use crate::film::{PixelFilter, Support};
use granita_dicing::PixelRect;

const NONE: u32 = u32::MAX;

/// The shares of mattes in the samples of a rectangle of pixels. Empty when none are requested.
#[derive(Clone, Debug, Default)]
pub struct Coverage {
    /// For each sample: the index of the first of its shares.
    first: Vec<u32>,
    shares: Vec<Share>,
}

#[derive(Clone, Copy, Debug)]
struct Share {
    /// The index of the matte.
    matte: u32,
    /// 0 to 1.
    share: f32,
    /// The index of the next share of the sample, or [`NONE`].
    next: u32,
}

impl Coverage {
    /// Returns the state in which `samples` samples see nothing.
    pub(crate) fn new(samples: usize) -> Self {
        Self { first: vec![NONE; samples], shares: Vec::new() }
    }

    /// Adds a share of a matte to a sample. A matte that the sample has seen before gets one share in all, so that
    /// memory grows with the number of mattes and not with that of layers.
    pub(crate) fn add(&mut self, sample: usize, matte: u32, share: f32) {
        if share.is_nan() || share <= 0.0 {
            return;
        }
        let Ok(new) = u32::try_from(self.shares.len()) else { return };
        let (mut last, mut next) = (NONE, self.first[sample]);
        while let Some(seen) = self.shares.get_mut(next as usize) {
            if seen.matte == matte {
                seen.share += share;
                return;
            }
            (last, next) = (next, seen.next);
        }
        self.shares.push(Share { matte, share, next: NONE });
        match self.shares.get_mut(last as usize) {
            Some(last) => last.next = new,
            None => self.first[sample] = new,
        }
    }

    /// Returns the mattes of a sample with their shares, in the order in which it sees them.
    pub fn of_sample(&self, sample: usize) -> impl Iterator<Item = (u32, f32)> + '_ {
        let mut next = self.first.get(sample).copied().unwrap_or(NONE);
        std::iter::from_fn(move || {
            let Share { matte, share, next: following } = *self.shares.get(next as usize)?;
            next = following;
            Some((matte, share))
        })
    }
}

/// Returns the pixels of a Cryptomatte, row by row, with `2 * ranks` numbers each: the id and the coverage of the matte
/// that covers most of the pixel, those of the next one, and so on. Missing ranks are 0.
///
/// `ids[m]` has the bits of the id of matte `m`. Mattes of one id are one. Of two ids with the same coverage, the one
/// with the lesser bits comes first. The coverage is the mean of the shares of the samples in the support of the
/// filter, with its weights. Negative weights count as 0. With [`PixelFilter::Closest`] only the nearest sample counts.
///
/// `samples` must reach the margin of the filter beyond `pixels`.
pub fn ranks(
    support: &Support,
    samples: &SampleGrid,
    coverage: &Coverage,
    (ids, ranks): (&[u32], usize),
    pixels: &PixelRect,
) -> Vec<f32> {
    let mut out = vec![0.0; pixels.width() * pixels.height() * 2 * ranks];
    let mut seen: Vec<(u32, f32)> = Vec::new();
    let mut covered: Vec<(u32, f32)> = Vec::new();
    let places = (pixels.y0..pixels.y1).flat_map(|y| (pixels.x0..pixels.x1).map(move |x| [x, y]));
    for (pixel, out) in places.zip(out.chunks_exact_mut((2 * ranks).max(1))) {
        seen.clear();
        let mut total = 0.0;
        let mut add = |sample: usize, weight: f32| {
            // This is false for NaN.
            if weight > 0.0 {
                total += weight;
                let id = |matte: u32| ids.get(matte as usize).copied().unwrap_or(0);
                seen.extend(coverage.of_sample(sample).map(|(matte, share)| (id(matte), share * weight)));
            }
        };
        match support.filter() {
            PixelFilter::Closest => add(support.closest(samples, pixel), 1.0),
            _ => support.around(samples, pixel, |first, counts, wx, wy| {
                for (s, (a, b)) in wx.iter().zip(wy).enumerate() {
                    add(first + s, a * b * counts);
                }
            }),
        }
        // The sort is stable, so that the sums are formed in the order of the samples.
        seen.sort_by_key(|(id, _)| *id);
        covered.clear();
        for same in seen.chunk_by(|a, b| a.0 == b.0) {
            covered.push((same[0].0, same.iter().map(|(_, share)| share).sum::<f32>() / total));
        }
        covered.sort_by(|a, b| b.1.total_cmp(&a.1));
        for (pair, (id, share)) in out.as_chunks_mut::<2>().0.iter_mut().zip(&covered) {
            *pair = [f32::from_bits(*id), *share];
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::film::FilterSpec;
    use crate::{CompositeSettings, SamplePattern, Shade, ShadedGrid, Surfaces, ViewedGrid, Wanted, film};
    use granita_base::{Color, Filter, Params, Reporter, Vec3};
    use granita_dicing::CameraView;
    use std::sync::Arc;

    const PIXELS: PixelRect = PixelRect { x0: 314, y0: 236, x1: 328, y1: 244 };

    fn camera() -> CameraView {
        let camera = granita_scene::Camera {
            name: "main".into(),
            world_to_camera: Default::default(),
            params: Params::new(),
        };
        CameraView::new(&camera, &Reporter::silent())
    }

    /// Returns grids of four primitives, three of which are half transparent and overlap.
    fn grids(camera: &CameraView) -> Vec<Arc<ShadedGrid>> {
        let grid = |number: u32, x: f32, z: f32, opacity: f32| {
            let corners =
                [(x, -2.0), (x + 0.05, -2.0), (x, 2.0), (x + 0.05, 2.0)].map(|(x, y)| Vec3::new(x, y, z));
            let view = ViewedGrid::new(camera, 2, vec![0.0], vec![corners.to_vec()], false);
            let color = Color::splat(opacity);
            let shade = Shade { color: vec![color; 4], opacity: vec![color; 4], ..Shade::default() };
            let opaque = opacity >= 1.0;
            let grid =
                ShadedGrid { shades: vec![shade], opaque, primitive: number, ..ShadedGrid::new(2, 2, view) };
            Arc::new(ShadedGrid { number, ..grid })
        };
        vec![
            grid(0, -0.02, 3.0, 0.5),
            grid(1, -0.01, 3.2, 0.25),
            grid(2, -0.03, 3.4, 0.5),
            grid(3, 0.005, 3.6, 1.0),
        ]
    }

    fn spec(shape: Filter) -> FilterSpec {
        FilterSpec { filter: PixelFilter::Weighted(shape), width: [3.0, 2.0] }
    }

    /// Returns alpha and the ranks of the pixels. Primitive `k` has the matte `mattes[k]`.
    fn rendered(mattes: [u32; 4], ids: &[f32], filter: FilterSpec, layers: usize) -> (Vec<f32>, Vec<f32>) {
        let camera = camera();
        let samples = SampleGrid::new(PIXELS.grown(2), &SamplePattern::new(&camera, false), &camera, &[]);
        let settings = CompositeSettings { opacity_threshold: Color::ONE, ..CompositeSettings::default() };
        let wanted = Wanted { mattes: Some(mattes.into()), ..Wanted::default() };
        let mut surfaces = Surfaces::new(&samples, settings).with_layers(layers);
        for grid in &grids(&camera) {
            if surfaces.is_full() {
                surfaces.settle(grid.views[0].z_min, &wanted);
            }
            surfaces.add(grid, 0);
        }
        let resolved = surfaces.resolve_all(&wanted);
        let support = Support::new(&filter, &samples.tables);
        let alpha = film::filter(&support, &samples, &resolved.values, &[3], &PIXELS);
        let ids: Vec<u32> = ids.iter().map(|id| id.to_bits()).collect();
        (alpha, ranks(&support, &samples, &resolved.coverage, (&ids, 4), &PIXELS))
    }

    #[test]
    fn coverages_add_up_to_alpha_and_are_sorted() {
        let (alpha, ranks) =
            rendered([0, 1, 2, 3], &[1.0, 2.0, 3.0, 4.0], spec(Filter::Gaussian), usize::MAX);
        let mut most = 0;
        for (alpha, pixel) in alpha.iter().zip(ranks.chunks_exact(8)) {
            let pairs: Vec<[f32; 2]> = pixel.as_chunks().0.to_vec();
            let sum: f32 = pairs.iter().map(|[_, share]| share).sum();
            assert!((sum - alpha).abs() < 1e-5, "{pairs:?} {alpha}");
            assert!(pairs.is_sorted_by(|a, b| a[1] >= b[1]), "{pairs:?}");
            assert!(pairs.iter().all(|[id, share]| (*id == 0.0) == (*share == 0.0)), "{pairs:?}");
            most = most.max(pairs.iter().filter(|[id, _]| *id > 0.0).count());
        }
        assert_eq!(most, 4, "some pixel sees all");
    }

    #[test]
    fn layers_that_are_composited_early_have_the_same_coverage() {
        let at_once = rendered([0, 1, 2, 3], &[1.0, 2.0, 3.0, 4.0], spec(Filter::Gaussian), usize::MAX);
        let early = rendered([0, 1, 2, 3], &[1.0, 2.0, 3.0, 4.0], spec(Filter::Gaussian), 1);
        assert!(at_once == early);
    }

    #[test]
    fn mattes_of_one_id_are_one() {
        let together = rendered([0, 1, 0, 3], &[1.0, 2.0, 0.0, 1.0], spec(Filter::Box), usize::MAX).1;
        let shares = |pixel: &[f32], id: f32| -> f32 {
            pixel.as_chunks().0.iter().filter(|[i, _]| *i == id).map(|[_, share]| share).sum()
        };
        let apart = rendered([0, 1, 2, 3], &[1.0, 2.0, 3.0, 4.0], spec(Filter::Box), usize::MAX).1;
        for (one, four) in together.chunks_exact(8).zip(apart.chunks_exact(8)) {
            let sum = shares(four, 1.0) + shares(four, 3.0) + shares(four, 4.0);
            assert!((shares(one, 1.0) - sum).abs() < 1e-6);
            assert!((shares(one, 2.0) - shares(four, 2.0)).abs() < 1e-6);
        }
    }

    #[test]
    fn negative_lobes_count_as_zero() {
        let (_, ranks) = rendered([0; 4], &[1.0], spec(Filter::CatmullRom), usize::MAX);
        for pixel in ranks.chunks_exact(8) {
            assert!((0.0..=1.000_01).contains(&pixel[1]), "{pixel:?}");
        }
        assert!(ranks.chunks_exact(8).any(|pixel| pixel[1] > 0.9));
    }

    #[test]
    fn the_nearest_sample_alone_counts_on_request() {
        let filter = FilterSpec { filter: PixelFilter::Closest, width: [1.0; 2] };
        let (_, ranks) = rendered([0, 1, 2, 3], &[1.0, 2.0, 3.0, 4.0], filter, usize::MAX);
        for share in ranks.as_chunks::<2>().0.iter().map(|[_, share]| *share) {
            // Each layer has an opacity of 1/4, 1/2 or 1.
            assert_eq!(share * 16.0, (share * 16.0).round());
        }
    }

    #[test]
    fn samples_that_see_nothing_have_no_matte() {
        let coverage = Coverage::new(3);
        assert_eq!(coverage.of_sample(1).count(), 0);
        assert_eq!(Coverage::default().of_sample(7).count(), 0);
        let mut coverage = coverage;
        coverage.add(1, 5, 0.25);
        coverage.add(1, 6, 0.0);
        coverage.add(1, 7, f32::NAN);
        coverage.add(1, 8, 0.5);
        coverage.add(1, 5, 0.125);
        assert_eq!(coverage.of_sample(1).collect::<Vec<_>>(), [(5, 0.375), (8, 0.5)]);
    }
}
