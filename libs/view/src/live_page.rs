//! A live image as a page.

use crate::image::Page;
use crate::source::{Access, Source};
use crate::store::TileStore;
use crate::tile::{TILE, Tile, tile_size};
use crate::{Live, LiveInfo, Result};
use granita_image::{ImageSpec, PixelRect, PixelType, Pixels};
use std::sync::Arc;

struct LiveSource {
    live: Live,
    info: LiveInfo,
}

impl Source for LiveSource {
    fn levels(&self) -> usize {
        1
    }

    fn size(&self, _level: usize) -> (u32, u32) {
        (self.info.width, self.info.height)
    }

    fn channels(&self) -> usize {
        self.info.channels.len()
    }

    fn pixel_type(&self) -> PixelType {
        PixelType::Float
    }

    fn access(&self) -> Access {
        Access::Tiles
    }

    fn read(&self, _level: usize, tx: u32, ty: u32) -> Result<Vec<((u32, u32), Tile)>> {
        let (width, height) = tile_size((self.info.width, self.info.height), tx, ty);
        let channels: Vec<usize> = (0..self.channels()).collect();
        let rect = PixelRect::at((tx * TILE) as i32, (ty * TILE) as i32, width, height);
        let values = self.live.read(&self.info.name, rect, &channels)?;
        let pixels = Pixels::Float(values);
        Ok(vec![((tx, ty), Tile { width, height, channels: channels.len(), pixels, missing: false })])
    }
}

/// A page that shows a live image, and the last state that it read.
#[derive(Debug)]
pub struct LivePage {
    /// The page.
    pub page: Arc<Page>,
    live: Live,
    info: LiveInfo,
    seen: u64,
}

impl LivePage {
    /// Returns the page of the live image of this name; `None` when there is none, or it has no pixels.
    pub fn new(live: &Live, name: &str, store: &TileStore) -> Option<Self> {
        let info = live.info(name).filter(|i| i.width > 0 && i.height > 0 && !i.channels.is_empty())?;
        let mut spec = ImageSpec::new(info.width, info.height, info.channels.len(), PixelType::Float);
        spec.channels = info.channels.clone();
        let source = Arc::new(LiveSource { live: live.clone(), info: info.clone() });
        let page = Arc::new(Page::from_source(name, spec, source, store));
        Some(Self { page, live: live.clone(), seen: info.generation, info })
    }

    /// Returns its properties without its pixels, as of the last [`LivePage::refresh`].
    pub fn info(&self) -> &LiveInfo {
        &self.info
    }

    /// Reads the changes. Returns true when there were any; `None` when the image was removed or replaced.
    pub fn refresh(&mut self) -> Option<bool> {
        let info = self.live.info(&self.info.name).filter(|i| i.id == self.info.id)?;
        if info.generation == self.seen {
            return Some(false);
        }
        for rect in self.live.changes_since(&info.name, self.seen) {
            let side = |v: i32| u32::try_from(v).unwrap_or(0);
            self.page.pyramid.forget((side(rect.x0), side(rect.y0), side(rect.x1), side(rect.y1)));
        }
        self.seen = info.generation;
        self.info = info;
        Some(true)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Display, LiveLimits, Mix, Shown, View, draw};

    #[test]
    fn updates_of_a_live_image_are_shown() {
        let live = Live::new(LiveLimits::default());
        let channels = ["R", "G", "B"].map(str::to_owned);
        live.create("a", 300, 200, &channels).unwrap();
        let store = TileStore::default();
        let mut page = LivePage::new(&live, "a", &store).unwrap();
        let display = Display::default();
        let look = |page: &Page| {
            let sheet = page.sheet(page.arrangement(), 0);
            let view = View::fit(300, 200, sheet.bounds);
            let shown = Shown { page, sheet: &sheet, layer: 0, display: &display };
            shown.load(&view).unwrap();
            draw(shown, None, Mix::First, &view).unwrap()
        };
        assert_eq!(look(&page.page).at(150, 100), [0, 0, 0]);
        let rect = PixelRect::at(140, 90, 20, 20);
        let planes = [(0, 0, 3), (1, 1, 3), (2, 2, 3)];
        live.update("a", &planes, rect, &vec![1.0; 20 * 20 * 3]).unwrap();
        assert_eq!(page.refresh(), Some(true));
        let canvas = look(&page.page);
        assert_eq!((canvas.at(150, 100), canvas.at(0, 0)), ([255; 3], [0; 3]));
        assert_eq!(page.refresh(), Some(false));
        live.close("a");
        assert_eq!(page.refresh(), None);
        assert!(LivePage::new(&live, "a", &store).is_none());
    }
}
