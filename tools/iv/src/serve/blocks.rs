//! The parts of an image that are sent to pages, which are rectangles and blocks.

use granita_image::PixelRect;
use granita_view::LiveInfo;

/// The largest number of pixels across or down that is sent to a page.
pub(super) const MOST_SIDE: u32 = 4096;

/// The side of the largest rectangle that is sent at once, in pixels of the page.
pub(super) const BLOCK: usize = 256;

/// The largest number of rectangles that are sent one by one. With more rectangles, the blocks that they touch are sent
/// as a whole.
pub(super) const RECTS: usize = 64;

/// Returns the number of pixels across and down that become one pixel of a page.
pub(super) fn reduction(info: &LiveInfo) -> u32 {
    info.width.max(info.height).div_ceil(MOST_SIDE)
}

/// Returns the blocks of `side` pixels that some rectangles touch, each once, row by row.
pub(super) fn blocks(rects: &[PixelRect], info: &LiveInfo, side: usize) -> Vec<PixelRect> {
    let across = (info.width as usize).div_ceil(side);
    let mut touched = vec![false; across * (info.height as usize).div_ceil(side)];
    for rect in rects {
        let [x0, y0, x1, y1] = [rect.x0, rect.y0, rect.x1 - 1, rect.y1 - 1].map(|v| v.max(0) as usize / side);
        for by in y0..=y1 {
            for bx in x0..=x1 {
                if let Some(block) = touched.get_mut(by * across + bx) {
                    *block = true;
                }
            }
        }
    }
    let window = PixelRect::at(0, 0, info.width, info.height);
    let at = |k: usize| {
        let (x, y) = ((k % across * side) as i32, (k / across * side) as i32);
        PixelRect::at(x, y, side as u32, side as u32).intersection(&window)
    };
    touched.iter().enumerate().filter(|(_, t)| **t).map(|(k, _)| at(k)).collect()
}

/// Returns the parts of a rectangle that are sent at once. The rectangle is extended to whole pixels of the reduced
/// image.
pub(super) fn parts(rect: &PixelRect, scale: u32, info: &LiveInfo) -> Vec<PixelRect> {
    let scale = scale as i32;
    let window = PixelRect::at(0, 0, info.width, info.height);
    let grown = PixelRect {
        x0: rect.x0 / scale * scale,
        y0: rect.y0 / scale * scale,
        x1: rect.x1.div_euclid(scale).saturating_add(i32::from(rect.x1 % scale != 0)).saturating_mul(scale),
        y1: rect.y1.div_euclid(scale).saturating_add(i32::from(rect.y1 % scale != 0)).saturating_mul(scale),
    };
    let grown = grown.intersection(&window);
    if grown.is_empty() {
        return Vec::new();
    }
    let step = BLOCK as i32 * scale;
    let starts = |from: i32, to: i32| (from..to).step_by(step as usize);
    starts(grown.y0, grown.y1)
        .flat_map(|y| starts(grown.x0, grown.x1).map(move |x| (x, y)))
        .map(|(x, y)| {
            PixelRect { x0: x, y0: y, x1: x.saturating_add(step), y1: y.saturating_add(step) }
                .intersection(&grown)
        })
        .collect()
}
