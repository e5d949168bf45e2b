//! Full detail of the visible part of an image that was sent to a page in reduced form.
//!
//! The page sends `{"detail": ID, "scale": s, "rect": [x, y, width, height]}`, in pixels of the image. The part outside
//! of the image is ignored. The page receives the blocks of 256 x 256 pixels that the rectangle touches, and their
//! changes, until its next message. Each of these pixels is the mean of `s x s` pixels of the image. The next message
//! drops all blocks that are not sent yet. Blocks that both rectangles touch at the same scale are sent once. A scale
//! that is not less than the image's, an empty rectangle and one of more than [`BLOCKS`] blocks request nothing.

use super::blocks::{BLOCK, MOST_SIDE, RECTS, blocks, parts, reduction};
use granita_image::PixelRect;
use granita_view::LiveInfo;
use serde_json::Value;

/// The largest number of blocks of one answer. It is enough for as many pixels as are sent of a whole image, at any
/// position.
const BLOCKS: usize = (MOST_SIDE as usize / BLOCK + 1).pow(2);

/// The state of the visible part of a page.
#[derive(Debug, PartialEq)]
pub(super) struct Detail {
    scale: u32,
    /// The rectangle of the requested blocks, in pixels of the image. It consists of whole blocks except at the edges
    /// of the image.
    range: PixelRect,
    /// The rectangles that must be sent to the page. None is larger than a block.
    pending: Vec<PixelRect>,
}

impl Detail {
    /// Returns the state after a request of the page that follows the state `before`; `None` when the request is empty
    /// or more than is allowed.
    pub(super) fn asked(value: &Value, info: &LiveInfo, before: Option<Self>) -> Option<Self> {
        let scale = value["scale"].as_u64().and_then(|s| u32::try_from(s).ok())?;
        if scale == 0 || scale >= reduction(info) {
            return None;
        }
        let number = |k: usize| value["rect"][k].as_i64();
        let [x, y] = [number(0)?, number(1)?].map(|v| i32::try_from(v).ok());
        let [width, height] = [number(2)?, number(3)?].map(|v| u32::try_from(v).ok());
        let seen = PixelRect::at(x?, y?, width?, height?).intersection(&PixelRect::at(
            0,
            0,
            info.width,
            info.height,
        ));
        if seen.is_empty() {
            return None;
        }
        let mut pending = blocks(&[seen], info, BLOCK * scale as usize);
        if pending.len() > BLOCKS {
            return None;
        }
        let (first, last) = (pending.first()?, pending.last()?);
        let range = PixelRect { x0: first.x0, y0: first.y0, x1: last.x1, y1: last.y1 };
        if let Some(before) = before.filter(|before| before.scale == scale) {
            let lacks = |block: &PixelRect| before.pending.iter().any(|p| !p.intersection(block).is_empty());
            pending.retain(|block| !before.range.contains(block) || lacks(block));
        }
        Some(Self { scale, range, pending })
    }

    /// Adds changed rectangles to those that must be sent.
    pub(super) fn change(&mut self, rects: &[PixelRect], info: &LiveInfo) {
        let seen = rects.iter().map(|rect| rect.intersection(&self.range)).filter(|rect| !rect.is_empty());
        self.pending.extend(seen.flat_map(|rect| parts(&rect, self.scale, info)));
        if self.pending.len() > BLOCKS + RECTS {
            self.pending = blocks(&self.pending, info, BLOCK * self.scale as usize);
        }
    }

    /// True when more can be sent at once.
    pub(super) fn is_behind(&self) -> bool {
        !self.pending.is_empty()
    }

    /// Returns the next rectangle to send, and its scale.
    pub(super) fn next(&mut self) -> Option<(PixelRect, u32)> {
        (!self.pending.is_empty()).then(|| (self.pending.remove(0), self.scale))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use granita_image::Wishes;
    use serde_json::json;

    fn info(width: u32, height: u32) -> LiveInfo {
        LiveInfo {
            id: 7,
            name: "a".to_owned(),
            width,
            height,
            channels: vec!["Y".to_owned()],
            generation: 1,
            marks: Vec::new(),
            note: None,
            drawing: Default::default(),
            wishes: Wishes::default(),
            takes_requests: false,
            panel: Default::default(),
            spec: None,
        }
    }

    fn asked(info: &LiveInfo, scale: u32, rect: [i64; 4], before: Option<Detail>) -> Option<Detail> {
        Detail::asked(&json!({"detail": info.id, "scale": scale, "rect": rect}), info, before)
    }

    #[test]
    fn blocks_are_sent_once_unless_changed() {
        let info = info(9001, 40);
        let mut detail = asked(&info, 1, [300, 3, 300, 1], None).unwrap();
        assert_eq!(detail.range, PixelRect::at(256, 0, 512, 40));
        assert_eq!(detail.next(), Some((PixelRect::at(256, 0, 256, 40), 1)));
        assert!(detail.is_behind());
        // The second block was never sent. The first one is no longer visible.
        let mut detail = asked(&info, 1, [600, -10, 400, 99], Some(detail)).unwrap();
        assert_eq!(detail.pending, [PixelRect::at(512, 0, 256, 40), PixelRect::at(768, 0, 256, 40)]);
        detail.pending.clear();
        // Changed blocks are sent again, also after another rectangle became visible.
        detail.change(&[PixelRect::at(760, 30, 20, 20), PixelRect::at(0, 0, 512, 40)], &info);
        assert_eq!(detail.pending, [PixelRect::at(760, 30, 20, 10)]);
        let detail = asked(&info, 1, [767, 0, 600, 9], Some(detail)).unwrap();
        assert_eq!(detail.pending.len(), 4);
        // The means of four pixels have blocks of their own.
        let detail = asked(&info, 2, [8990, 39, 999, 999], Some(detail)).unwrap();
        assert_eq!(detail.pending, [PixelRect::at(8704, 0, 297, 40)]);
    }

    #[test]
    fn invalid_requests_for_detail_are_limited_or_ignored() {
        let large = info(20_000, 8000);
        assert_eq!(asked(&large, 1, [0, 0, 4097, 4097], None).unwrap().pending.len(), BLOCKS);
        let far = i64::from(i32::MAX);
        for (scale, rect) in [
            (0, [0, 0, 9, 9]),
            (5, [0, 0, 9, 9]),
            (u32::MAX, [0, 0, 9, 9]),
            (1, [0, 0, 20_000, 8000]),
            (1, [far, far, far, far]),
            (1, [-far, 0, far, 9]),
            (1, [0, 0, 0, 9]),
            (1, [0, 0, -1, 9]),
            (1, [i64::MIN, 0, i64::MAX, 9]),
        ] {
            assert_eq!(asked(&large, scale, rect, None), None, "{scale} {rect:?}");
        }
        for value in [
            json!({"scale": 1}),
            json!({"scale": 1, "rect": [0, 0, 9]}),
            json!({"scale": 1, "rect": {"0": 1}}),
            json!({"scale": 1.5, "rect": [0, 0, 9, 9]}),
            json!({"scale": 1, "rect": [0, 0, 9, 1e300]}),
            json!({"scale": 1, "rect": "0000"}),
        ] {
            assert_eq!(Detail::asked(&value, &large, None), None, "{value}");
        }
        // An image that is sent in full has no further detail.
        assert_eq!(asked(&info(400, 400), 1, [0, 0, 9, 9], None), None);
        // For any request, the answer is finite and lies inside the image.
        let (extremes, mut before) =
            ([i64::MIN, -far, -1, 0, 1, 4096, far, i64::from(u32::MAX), i64::MAX], None);
        for k in 0..extremes.len().pow(4) {
            let rect = [1, 9, 81, 729].map(|place| extremes[k / place % 9]);
            let detail = asked(&large, 1 + k as u32 % 5, rect, before);
            if let Some(detail) = &detail {
                assert!(detail.pending.len() <= BLOCKS, "{rect:?}");
                assert!(PixelRect::at(0, 0, 20_000, 8000).contains(&detail.range), "{rect:?}");
            }
            before = detail;
        }
        // Too many changes become blocks again.
        let mut detail = asked(&large, 2, [0, 0, 600, 600], None).unwrap();
        let changes: Vec<_> = (0..500).map(|k| PixelRect::at(k, k, 3, 3)).collect();
        detail.change(&changes, &large);
        assert_eq!(detail.pending.len(), 4);
    }
}
