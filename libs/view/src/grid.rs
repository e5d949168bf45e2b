//! The tiles of one level that a view needs, collected before it is drawn.

use crate::image::Page;
use crate::pyramid::Pyramid;
use crate::sheet::Sheet;
use crate::tile::{Pick, TILE, Tile};
use crate::view::{Around, View};
use granita_base::Vec3;
use std::ops::Range;
use std::sync::Arc;

/// The tiles that a view needs, those in the centre first.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Needs {
    /// The level.
    pub level: usize,
    /// The columns and rows of the tiles.
    pub tiles: Vec<(u32, u32)>,
}

/// Returns the level whose pixels are nearest in size to those of the screen.
pub(crate) fn level_for(pyramid: &Pyramid, sheet: &Sheet, zoom: f64) -> usize {
    let levels = pyramid.levels();
    let badness = |l: usize| (levels[l].scale.0.max(levels[l].scale.1) * zoom).log2().abs();
    (sheet.level..levels.len()).min_by(|a, b| badness(*a).total_cmp(&badness(*b))).unwrap_or(sheet.level)
}

/// Returns the tiles with the columns or rows of pixels `from..to` of `size`.
fn tiles_of(from: f64, to: f64, size: u32) -> Range<u32> {
    let first = from.floor().clamp(0.0, f64::from(size)) as u32 / TILE;
    let last = (to.ceil().clamp(0.0, f64::from(size)) as u32).div_ceil(TILE);
    first..last.max(first)
}

/// Returns the tiles that a view of a sheet needs.
pub fn needs(page: &Page, sheet: &Sheet, view: &View) -> Needs {
    if let Some(around) = view.around.filter(|_| page.is_panorama()) {
        return needs_around(page, sheet, view, &around);
    }
    let pyramid = &page.pyramid;
    let level = level_for(pyramid, sheet, view.zoom);
    let l = pyramid.levels()[level];
    let (x0, y0) = view.to_sheet(0.0, 0.0);
    let (x1, y1) = view.to_sheet(f64::from(view.width), f64::from(view.height));
    let mut tiles: Vec<(u64, (u32, u32))> = Vec::new();
    for patch in &sheet.patches {
        let [left, top, w, h] = patch.place;
        let (a, b) = (x0.max(left), x1.min(left + w));
        let (c, d) = (y0.max(top), y1.min(top + h));
        if a >= b || c >= d {
            continue;
        }
        let ((u0, v0), (u1, v1)) = (patch.source_at(a, c, level), patch.source_at(b, d, level));
        // One more pixel on each side is needed for interpolation.
        let across = tiles_of(u0.min(u1) - 1.0, u0.max(u1) + 1.0, l.width);
        let down = tiles_of(v0.min(v1) - 1.0, v0.max(v1) + 1.0, l.height);
        let (cu, cv) = patch.source_at((a + b) / 2.0, (c + d) / 2.0, level);
        for (tx, ty) in down.flat_map(|ty| across.clone().map(move |tx| (tx, ty))) {
            let middle = |t: u32| f64::from(t * TILE + TILE / 2);
            let far = (middle(tx) - cu).powi(2) + (middle(ty) - cv).powi(2);
            tiles.push((far as u64, (tx, ty)));
        }
    }
    tiles.sort_unstable();
    let mut list: Vec<(u32, u32)> = Vec::with_capacity(tiles.len());
    let mut seen = std::collections::BTreeSet::new();
    list.extend(tiles.into_iter().map(|t| t.1).filter(|t| seen.insert(*t)));
    Needs { level, tiles: list }
}

fn needs_around(page: &Page, sheet: &Sheet, view: &View, around: &Around) -> Needs {
    let eye = Eye::new(page, sheet, view, around);
    let l = page.pyramid.levels()[eye.level];
    let mut seen = std::collections::BTreeSet::new();
    for y in (0..view.height + 8).step_by(8) {
        for x in (0..view.width + 8).step_by(8) {
            let (u, v) = eye.at(f64::from(x), f64::from(y));
            // The steps are smaller than a tile. Pixels between two points are therefore in the tile of one of them or
            // beside it.
            for (i, j) in [(-12.0, -12.0), (12.0, -12.0), (-12.0, 12.0), (12.0, 12.0)] {
                let tile = |v: f64, size: u32| v.clamp(0.0, f64::from(size - 1)) as u32 / TILE;
                seen.insert((tile(u + i, l.width), tile(v + j, l.height)));
            }
        }
    }
    Needs { level: eye.level, tiles: seen.into_iter().collect() }
}

/// Returns the pixel that is drawn at a point of the screen: its level, column and row; `None` beside the image.
pub fn pixel_under(page: &Page, sheet: &Sheet, view: &View, x: f64, y: f64) -> Option<(usize, u32, u32)> {
    if let Some(around) = view.around.filter(|_| page.is_panorama()) {
        let eye = Eye::new(page, sheet, view, &around);
        let (u, v) = eye.at(x, y);
        return Some((eye.level, u as u32, v as u32));
    }
    let level = level_for(&page.pyramid, sheet, view.zoom);
    let (x, y) = view.to_sheet(x, y);
    let (u, v) = sheet.pixel_at(x, y, level)?;
    Some((level, u, v))
}

/// Maps points of the screen to pixels of a panorama.
pub(crate) struct Eye<'a> {
    page: &'a Page,
    rects: Vec<Vec<[f64; 4]>>,
    pub(crate) level: usize,
    forward: Vec3,
    right: Vec3,
    up: Vec3,
    /// The focal length in screen pixels.
    focal: f64,
    middle: (f64, f64),
    /// The approximate number of screen pixels per pixel of the panorama.
    pub(crate) enlarged: f64,
}

impl<'a> Eye<'a> {
    pub(crate) fn new(page: &'a Page, sheet: &Sheet, view: &View, around: &Around) -> Self {
        let focal = f64::from(view.height) / 2.0 / (around.fov_deg.to_radians() / 2.0).tan();
        let rects = page.face_rects();
        // The number of pixels of level 0 per radian in the middle.
        let density = match page.layout {
            Some(_) => rects[0][0][2] / 2.0,
            None => rects[0][0][3] / std::f64::consts::PI,
        };
        let zoom = focal / density.max(1e-3);
        let level = level_for(&page.pyramid, sheet, zoom);
        // Cubes have y up, the others z. "ahead" is the middle of the image.
        let (ahead, side, top) = match page.layout {
            Some(granita_texture::CubeLayout::Mosaic) => (Vec3::Z, Vec3::X, Vec3::Y),
            Some(granita_texture::CubeLayout::Column) => (Vec3::Z, Vec3::NEG_X, Vec3::Y),
            None => (Vec3::X, Vec3::Y, Vec3::Z),
        };
        let (ys, yc) = (around.yaw_deg.to_radians() as f32).sin_cos();
        let (ps, pc) = (around.pitch_deg.to_radians() as f32).sin_cos();
        let level_ahead = ahead * yc + side * ys;
        let enlarged = zoom * page.pyramid.levels()[level].scale.1;
        Self {
            page,
            rects,
            level,
            forward: level_ahead * pc + top * ps,
            right: side * yc - ahead * ys,
            up: top * pc - level_ahead * ps,
            focal,
            middle: (f64::from(view.width) / 2.0, f64::from(view.height) / 2.0),
            enlarged,
        }
    }

    /// Returns coordinates in pixels of the level at a point of the screen.
    pub(crate) fn at(&self, x: f64, y: f64) -> (f64, f64) {
        let (dx, dy) = (((x - self.middle.0) / self.focal) as f32, ((self.middle.1 - y) / self.focal) as f32);
        let d = self.forward + self.right * dx + self.up * dy;
        let (face, s, t) = match self.page.layout {
            Some(layout) => {
                let p = layout.point(d);
                (p.face, f64::from(p.s), f64::from(p.t))
            }
            None => {
                let s = f64::from(d.y).atan2(f64::from(d.x)) / std::f64::consts::TAU + 0.5;
                let t = f64::from(d.x.hypot(d.y)).atan2(f64::from(d.z)) / std::f64::consts::PI;
                (0, s, t)
            }
        };
        let [left, top, w, h] = self.rects[face][self.level];
        // The position stays inside of the face, so that no value comes from its neighbours in the file.
        let inside = |v: f64, size: f64| (v * size).clamp(0.0, (size - 1e-3).max(0.0));
        (left + inside(s, w), top + inside(t, h))
    }
}

/// The form in which a tile is available.
#[derive(Clone, Debug)]
enum Cell {
    Here(Arc<Tile>),
    /// A coarser tile, and its level.
    Coarser(Arc<Tile>, usize),
    Nothing,
}

/// The tiles of one level in a rectangle.
#[derive(Debug)]
pub(crate) struct Grid<'a> {
    pyramid: &'a Pyramid,
    pub(crate) level: usize,
    /// The first column and row, and the number of columns and rows.
    corner: (u32, u32),
    size: (u32, u32),
    cells: Vec<Cell>,
    pick: [Pick; 4],
    /// True when all needed tiles are in memory.
    pub(crate) complete: bool,
    /// True when all of it is covered, if only by coarser tiles.
    pub(crate) covered: bool,
}

/// The scratch memory of one thread.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    values: Vec<f32>,
}

impl<'a> Grid<'a> {
    /// Collects the tiles in memory.
    pub(crate) fn collect(pyramid: &'a Pyramid, needs: &Needs, pick: [Pick; 4]) -> Self {
        let level = needs.level;
        let (tx, ty) = needs.tiles.first().copied().unwrap_or_default();
        let (mut x, mut y) = (tx..tx, ty..ty);
        for (tx, ty) in &needs.tiles {
            x = x.start.min(*tx)..x.end.max(tx + 1);
            y = y.start.min(*ty)..y.end.max(ty + 1);
        }
        let size = (x.end - x.start, y.end - y.start);
        let mut cells = vec![Cell::Nothing; size.0 as usize * size.1 as usize];
        let mut complete = true;
        for (tx, ty) in &needs.tiles {
            let cell = &mut cells[((ty - y.start) * size.0 + tx - x.start) as usize];
            *cell = match pyramid.held(level, *tx, *ty) {
                Some(tile) => Cell::Here(tile),
                None => {
                    complete = false;
                    Self::coarser(pyramid, level, *tx, *ty)
                }
            };
        }
        let needed = |(tx, ty): &(u32, u32)| &cells[((ty - y.start) * size.0 + tx - x.start) as usize];
        let covered = !needs.tiles.iter().any(|t| matches!(needed(t), Cell::Nothing));
        Self { pyramid, level, corner: (x.start, y.start), size, cells, pick, complete, covered }
    }

    /// Returns the finest coarser tile in memory that covers the middle of a missing one. It may be one of the rough
    /// image.
    fn coarser(pyramid: &Pyramid, level: usize, tx: u32, ty: u32) -> Cell {
        let levels = pyramid.levels();
        let fine = &levels[level];
        for (at, coarse) in levels.iter().enumerate().skip(level + 1) {
            let place = |t: u32, fine: f64, coarse: f64, size: u32| {
                let middle = f64::from(t * TILE) + f64::from(TILE) / 2.0;
                ((middle * fine / coarse) as u32).min(size - 1) / TILE
            };
            let x = place(tx, fine.scale.0, coarse.scale.0, coarse.width);
            let y = place(ty, fine.scale.1, coarse.scale.1, coarse.height);
            if let Some(tile) = pyramid.held(at, x, y).or_else(|| pyramid.sketched(at, x, y)) {
                return Cell::Coarser(tile, at);
            }
        }
        Cell::Nothing
    }

    fn cell(&self, tx: u32, ty: u32) -> &Cell {
        let (x, y) = (tx.wrapping_sub(self.corner.0), ty.wrapping_sub(self.corner.1));
        if x < self.size.0 && y < self.size.1 {
            &self.cells[(y * self.size.0 + x) as usize]
        } else {
            &Cell::Nothing
        }
    }

    /// Returns the value of pixel (x, y) of this level in a coarser tile.
    fn of_coarser(&self, tile: &Tile, level: usize, x: u32, y: u32) -> [f32; 4] {
        let (fine, coarse) = (self.pyramid.levels()[self.level], self.pyramid.levels()[level]);
        let place = |v: u32, fine: f64, coarse: f64, size: u32| {
            ((((f64::from(v) + 0.5) * fine / coarse) as u32) % TILE).min(size - 1)
        };
        let x = place(x, fine.scale.0, coarse.scale.0, tile.width);
        let y = place(y, fine.scale.1, coarse.scale.1, tile.height);
        self.value(tile, x, y)
    }

    fn value(&self, tile: &Tile, x: u32, y: u32) -> [f32; 4] {
        let at = (y as usize * tile.width as usize + x as usize) * tile.channels;
        self.pick.map(|pick| match pick {
            Pick::Channel(c) => tile.pixels.get(at + c),
            Pick::Value(v) => v,
        })
    }

    /// Returns pixel (x, y) of the level; `None` where no tile is in memory.
    pub(crate) fn pixel(&self, x: u32, y: u32) -> Option<[f32; 4]> {
        match self.cell(x / TILE, y / TILE) {
            Cell::Here(tile) => {
                let (i, j) = (x % TILE, y % TILE);
                (i < tile.width && j < tile.height).then(|| self.value(tile, i, j))
            }
            Cell::Coarser(tile, level) => Some(self.of_coarser(tile, *level, x, y)),
            Cell::Nothing => None,
        }
    }

    /// Sets `out` to pixels `x0..x1` of row `y`, which are black where no tile is in memory.
    pub(crate) fn row(&self, y: u32, x0: u32, x1: u32, scratch: &mut Scratch, out: &mut Vec<[f32; 4]>) {
        out.clear();
        let mut x = x0;
        while x < x1 {
            let end = ((x / TILE + 1) * TILE).min(x1);
            match self.cell(x / TILE, y / TILE) {
                Cell::Here(tile) if y % TILE < tile.height => {
                    let (a, b) = (x % TILE, (end - 1) % TILE + 1);
                    let (a, b) = (a.min(tile.width), b.min(tile.width));
                    tile.append_row((a, b, y % TILE), &self.pick, &mut scratch.values, out);
                    out.resize((end - x0) as usize, [0.0; 4]);
                }
                Cell::Coarser(tile, level) => {
                    out.extend((x..end).map(|x| self.of_coarser(tile, *level, x, y)));
                }
                Cell::Here(_) | Cell::Nothing => out.resize((end - x0) as usize, [0.0; 4]),
            }
            x = end;
        }
    }
}
