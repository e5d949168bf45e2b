//! Draws a view of one page, or of two compared with each other, as bytes for a screen.

use crate::display::{BESIDE, Display, Prepared, Tables};
use crate::grid::{Eye, Grid, Needs, Scratch, needs};
use crate::image::Page;
use crate::sheet::Sheet;
use crate::view::View;
use crate::{Result, ViewError};
use granita_base::parallel_map;
use rayon::prelude::*;

/// A page with its layout and its display.
#[derive(Clone, Copy, Debug)]
pub struct Shown<'a> {
    /// The page.
    pub page: &'a Page,
    /// Its layout.
    pub sheet: &'a Sheet,
    /// The index of its layer.
    pub layer: usize,
    /// The conversion of values to colours.
    pub display: &'a Display,
}

/// The combination of two pages.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Mix {
    /// The first page only.
    #[default]
    First,
    /// The second page only.
    Second,
    /// The first page up to an edge on the screen, then the second page.
    Wipe {
        /// The position of the edge, from 0 (left or upper side) to 1.
        at: f32,
        /// True for a horizontal edge, false for a vertical one.
        down: bool,
    },
    /// The magnitude of the difference, multiplied by a factor.
    Difference {
        /// The factor.
        gain: f32,
    },
    /// The first over the second, by the alpha of the first.
    Over,
    /// A map of the perceived difference, which is drawn as the first page (see [`crate::flip_page`]).
    Flip,
}

/// An image for a screen. It has rows from the top with 4 bytes per pixel, which are red, green, blue and alpha. Alpha
/// is 255.
#[derive(Clone, Debug, Default)]
pub struct Canvas {
    /// The width in pixels.
    pub width: u32,
    /// The height in pixels.
    pub height: u32,
    /// The pixels, `4 * width * height` bytes.
    pub bytes: Vec<u8>,
    /// True when all tiles were in memory.
    pub complete: bool,
    /// True when all of it is covered, if only by coarser tiles.
    pub covered: bool,
    /// The tables that were computed for drawing. They are reused when it is drawn again.
    tables: Tables,
}

/// Two canvases are equal when they look the same. Their tables are not compared.
impl PartialEq for Canvas {
    fn eq(&self, other: &Self) -> bool {
        let seen = |c: &Self| (c.width, c.height, c.complete, c.covered);
        seen(self) == seen(other) && self.bytes == other.bytes
    }
}

impl Eq for Canvas {}

impl Canvas {
    /// Returns a complete canvas with these `4 * width * height` bytes.
    pub fn new(width: u32, height: u32, bytes: Vec<u8>) -> Self {
        Self { width, height, bytes, complete: true, covered: true, tables: Tables::default() }
    }

    /// Clears it to the colour beside an image.
    pub fn clear(&mut self, width: u32, height: u32) {
        (self.width, self.height, self.complete, self.covered) = (width, height, true, true);
        self.bytes.resize(4 * width as usize * height as usize, 0);
        self.bytes.as_chunks_mut::<4>().0.fill(BESIDE);
    }

    /// Returns red, green and blue of a pixel.
    pub fn at(&self, x: u32, y: u32) -> [u8; 3] {
        let at = 4 * (y as usize * self.width as usize + x as usize);
        [self.bytes[at], self.bytes[at + 1], self.bytes[at + 2]]
    }
}

/// The number of screen rows that one thread draws at a time.
const ROWS: usize = 16;

impl Shown<'_> {
    /// Returns the tiles that a view needs.
    pub fn needs(&self, view: &View) -> Needs {
        needs(self.page, self.sheet, view)
    }

    /// Reads the tiles that a view needs, with several threads.
    ///
    /// # Errors
    /// Returns the first error when none of it can be read.
    pub fn load(&self, view: &View) -> Result<()> {
        load_tiles(self.page, &self.needs(view))
    }

    fn prepared(&self, tables: &mut Tables) -> Prepared {
        let spec = self.page.spec();
        let unassociated = spec.attributes.int("unassociatedalpha") == Some(1);
        let layer = &self.page.layers[self.layer.min(self.page.layers.len() - 1)];
        Prepared::new(self.display, layer.meaning, self.page.encoded, unassociated, tables)
            .with_colors(&self.page.colors)
    }
}

/// Reads tiles with several threads of its own. These wait for each other where a file is decoded as a whole. They must
/// not be threads that the decoding itself uses.
pub(crate) fn load_tiles(page: &Page, needs: &Needs) -> Result<()> {
    let missing: Vec<(u32, u32)> =
        needs.tiles.iter().copied().filter(|t| !page.pyramid.has(needs.level, t.0, t.1)).collect();
    if missing.is_empty() {
        return Ok(());
    }
    let count = missing.len();
    let read = |(): &mut (), (tx, ty)| page.pyramid.tile(needs.level, tx, ty).err();
    let mut errors = parallel_map(missing, rayon::current_num_threads(), || (), read).into_iter().flatten();
    let error = errors.next();
    let failed = errors.count() + usize::from(error.is_some());
    match error {
        Some(error) if failed == count => Err(error),
        _ => Ok(()),
    }
}

/// A page while it is drawn.
struct Side<'a> {
    shown: Shown<'a>,
    grid: Grid<'a>,
    eye: Option<Eye<'a>>,
    ready: Prepared,
}

/// A row of the screen, and the parts of it that an image covers.
#[derive(Default)]
struct Row {
    pixels: Vec<[f32; 4]>,
    covered: Vec<bool>,
    scratch: Scratch,
    upper: Vec<[f32; 4]>,
    lower: Vec<[f32; 4]>,
}

impl<'a> Side<'a> {
    fn new(shown: Shown<'a>, view: &View, tables: &mut Tables) -> Self {
        let needs = shown.needs(view);
        let layer = &shown.page.layers[shown.layer.min(shown.page.layers.len() - 1)];
        let grid = Grid::collect(&shown.page.pyramid, &needs, shown.display.pick(layer));
        let around = view.around.filter(|_| shown.page.is_panorama());
        let eye = around.map(|a| Eye::new(shown.page, shown.sheet, view, &a));
        Self { shown, grid, eye, ready: shown.prepared(tables) }
    }

    /// Samples one row of the screen.
    fn row(&self, view: &View, y: u32, row: &mut Row) {
        let width = view.width as usize;
        row.pixels.clear();
        row.pixels.resize(width, [0.0; 4]);
        row.covered.clear();
        row.covered.resize(width, false);
        if let Some(eye) = &self.eye {
            self.row_around(eye, y, row);
            return;
        }
        let level = self.grid.level;
        let scale = self.shown.page.pyramid.levels()[level].scale;
        // Pixels of the finest level are drawn as squares where they are at least as large as those of the screen.
        let squares = level == self.shown.sheet.level && scale.0.min(scale.1) * view.zoom > 0.999;
        for patch in &self.shown.sheet.patches {
            let (_, sy) = view.to_sheet(0.0, f64::from(y) + 0.5);
            let [left, top, w, h] = patch.place;
            if sy < top || sy >= top + h {
                continue;
            }
            // These are the columns whose middle is on the patch.
            let column = |x: f64| (view.to_screen(x, 0.0).0 - 0.5).ceil().clamp(0.0, width as f64) as usize;
            let (first, last) = (column(left), column(left + w));
            if first >= last {
                continue;
            }
            let sheet_x = |x: usize| view.to_sheet(x as f64 + 0.5, 0.0).0;
            let (u0, v) = patch.source_at(sheet_x(first), sy, level);
            let step = (patch.source_at(sheet_x(first) + 1.0, sy, level).0 - u0) / view.zoom;
            let [x, y, w, h] = patch.source[level];
            let source = (bounds(x, w), bounds(y, h));
            let place = Place { first, last, u0, v, step, source };
            if squares { self.squares(&place, row) } else { self.between(&place, row) }
        }
    }

    /// Draws the image pixel under each screen pixel.
    fn squares(&self, place: &Place, row: &mut Row) {
        let ((x0, x1), (y0, y1)) = place.source;
        let v = (place.v.floor() as i64).clamp(y0, y1) as u32;
        let at = |i: usize| floor(place.u0 + place.step * i as f64).clamp(x0, x1) as u32;
        let n = place.last - place.first;
        let (a, b) = (at(0).min(at(n - 1)), at(0).max(at(n - 1)));
        self.grid.row(v, a, b + 1, &mut row.scratch, &mut row.upper);
        for i in 0..n {
            row.pixels[place.first + i] = row.upper[(at(i) - a) as usize];
            row.covered[place.first + i] = true;
        }
    }

    /// Interpolates between the four nearest pixels.
    fn between(&self, place: &Place, row: &mut Row) {
        let ((x0, x1), (y0, y1)) = place.source;
        let (v, fv) = cell(place.v);
        let (v0, v1) = (v.clamp(y0, y1) as u32, (v + 1).clamp(y0, y1) as u32);
        let at = |i: usize| {
            let (u, f) = cell(place.u0 + place.step * i as f64);
            (u.clamp(x0, x1) as u32, (u + 1).clamp(x0, x1) as u32, f)
        };
        let n = place.last - place.first;
        let (p, q) = (at(0), at(n - 1));
        let (a, b) = (p.0.min(q.0), p.1.max(q.1));
        self.grid.row(v0, a, b + 1, &mut row.scratch, &mut row.upper);
        if fv > 0.0 && v1 != v0 {
            self.grid.row(v1, a, b + 1, &mut row.scratch, &mut row.lower);
            for (upper, lower) in row.upper.iter_mut().zip(&row.lower) {
                *upper = mix(*upper, *lower, fv);
            }
        }
        for i in 0..n {
            let (left, right, f) = at(i);
            let (l, r) = (row.upper[(left - a) as usize], row.upper[(right - a) as usize]);
            row.pixels[place.first + i] = mix(l, r, f);
            row.covered[place.first + i] = true;
        }
    }

    fn row_around(&self, eye: &Eye<'_>, y: u32, row: &mut Row) {
        for x in 0..row.pixels.len() {
            let (u, v) = eye.at(x as f64 + 0.5, f64::from(y) + 0.5);
            let near = self.grid.pixel(u as u32, v as u32);
            let Some(near) = near else { continue };
            row.covered[x] = true;
            row.pixels[x] = near;
            if eye.enlarged >= 2.0 {
                continue;
            }
            let ((x0, fx), (y0, fy)) = (cell(u), cell(v));
            let get = |i: i64, j: i64| {
                let place = |v: i64| u32::try_from(v).ok();
                place(x0 + i).zip(place(y0 + j)).and_then(|(x, y)| self.grid.pixel(x, y)).unwrap_or(near)
            };
            row.pixels[x] = mix(mix(get(0, 0), get(1, 0), fx), mix(get(0, 1), get(1, 1), fx), fy);
        }
    }
}

/// A run of screen pixels on one patch.
struct Place {
    first: usize,
    last: usize,
    /// The coordinates of the first pixel in the level, and the step in `u0` to the next pixel.
    u0: f64,
    v: f64,
    step: f64,
    /// The first and the last column and row of the level that belong to the patch.
    source: ((i64, i64), (i64, i64)),
}

/// Returns the first and the last pixel of a span.
fn bounds(from: f64, size: f64) -> (i64, i64) {
    let first = from.floor() as i64;
    (first, ((from + size).ceil() as i64 - 1).max(first))
}

/// Returns the pixel whose centre is at or before a coordinate, and the fraction of the way to the next one.
fn cell(v: f64) -> (i64, f32) {
    let v = v - 0.5;
    let below = floor(v);
    (below, (v - below as f64) as f32)
}

/// Returns the largest integer that is not above `v`, for coordinates of pixels.
#[inline]
fn floor(v: f64) -> i64 {
    let near = v as i64;
    near.saturating_sub(i64::from(near as f64 > v))
}

/// Interpolates by the fraction `f`. The result is exactly `a` at 0 and for equal values.
fn mix(a: [f32; 4], b: [f32; 4], f: f32) -> [f32; 4] {
    if f < 1e-4 || a == b {
        return a;
    }
    [0, 1, 2, 3].map(|c| a[c] + (b[c] - a[c]) * f)
}

/// Draws the tiles in memory. Missing ones are drawn coarser, or black. With [`Mix::First`], `second` is not used.
///
/// # Errors
/// Returns an error when the screen has too many pixels.
pub fn draw(first: Shown<'_>, second: Option<Shown<'_>>, how: Mix, view: &View) -> Result<Canvas> {
    let mut canvas = Canvas::default();
    draw_into(first, second, how, view, &mut canvas)?;
    Ok(canvas)
}

/// Draws as [`draw`] does, into a canvas that was drawn before.
///
/// # Errors
/// Returns the errors of [`draw`].
pub fn draw_into(
    first: Shown<'_>,
    second: Option<Shown<'_>>,
    how: Mix,
    view: &View,
    canvas: &mut Canvas,
) -> Result<()> {
    let pixels = u64::from(view.width) * u64::from(view.height);
    if pixels > 1 << 28 {
        return Err(ViewError::Limit { what: "number of pixels on the screen", asked: pixels, max: 1 << 28 });
    }
    let how = if second.is_some() { how } else { Mix::First };
    let (first, second) = match (how, second) {
        (Mix::First | Mix::Flip, _) => (first, None),
        (Mix::Second, Some(second)) => (second, None),
        (_, second) => (first, second),
    };
    let tables = &mut canvas.tables;
    let a = Side::new(first, view, tables);
    let b = second.map(|shown| Side::new(shown, view, tables));
    let alike = b.as_ref().is_none_or(|b| a.ready.is_alike(&b.ready));
    let mixed = match how {
        Mix::Difference { .. } if alike && a.ready.is_encoded() => Some(a.ready.for_differences(tables)),
        Mix::Difference { .. } if a.ready.is_managed() => Some(a.ready.for_linear(tables)),
        _ if !alike || how == Mix::Over => Some(a.ready.for_linear(tables)),
        _ => None,
    };
    canvas.complete = a.grid.complete && b.as_ref().is_none_or(|b| b.grid.complete);
    canvas.covered = a.grid.covered && b.as_ref().is_none_or(|b| b.grid.covered);
    (canvas.width, canvas.height) = (view.width, view.height);
    canvas.bytes.resize(4 * pixels as usize, 0);
    let row_bytes = 4 * view.width as usize;
    if row_bytes == 0 {
        return Ok(());
    }
    canvas.bytes.par_chunks_mut(ROWS * row_bytes).enumerate().for_each(|(chunk, bytes)| {
        let (mut one, mut two) = (Row::default(), Row::default());
        for (y, out) in (chunk * ROWS..).zip(bytes.chunks_exact_mut(row_bytes)) {
            let y = y as u32;
            a.row(view, y, &mut one);
            let Some(b) = &b else {
                a.ready.show_row(&one.pixels, &one.covered, y, out);
                continue;
            };
            b.row(view, y, &mut two);
            for (x, out) in (0..).zip(out.chunks_exact_mut(4)) {
                let i = x as usize;
                let (p, q) = (one.pixels[i], two.pixels[i]);
                let covered = (one.covered[i], two.covered[i]);
                let shown = blend(how, (&a.ready, p), (&b.ready, q), covered, mixed.as_ref(), view, x, y);
                out.copy_from_slice(&shown);
            }
        }
    });
    Ok(())
}

/// Returns one screen pixel of two images.
#[expect(clippy::too_many_arguments, reason = "the innermost step of one loop")]
fn blend(
    how: Mix,
    (a, p): (&Prepared, [f32; 4]),
    (b, q): (&Prepared, [f32; 4]),
    (covered_a, covered_b): (bool, bool),
    mixed: Option<&Prepared>,
    view: &View,
    x: u32,
    y: u32,
) -> [u8; 4] {
    let one = || if covered_a { a.show(p, x, y) } else { BESIDE };
    let two = || if covered_b { b.show(q, x, y) } else { BESIDE };
    match how {
        Mix::First | Mix::Flip => one(),
        Mix::Second => two(),
        Mix::Wipe { at, down } => {
            let (place, side) = if down { (y, view.height) } else { (x, view.width) };
            if (place as f32) < at * side as f32 { one() } else { two() }
        }
        Mix::Difference { .. } if !covered_a || !covered_b => BESIDE,
        Mix::Difference { gain } => {
            // Stored values are compared where both images are encoded alike, else linear values.
            let alike = a.is_alike(b);
            let value = |side: &Prepared, v: [f32; 4]| match alike {
                true => [v[0], v[1], v[2]],
                false => side.linear_color([v[0], v[1], v[2]]),
            };
            let (p, q) = (value(a, p), value(b, q));
            let d = [0, 1, 2].map(|c| (p[c] - q[c]).abs() * gain);
            mixed.unwrap_or(a).show([d[0], d[1], d[2], 1.0], x, y)
        }
        Mix::Over => {
            let Some(linear) = mixed.filter(|_| covered_a) else { return two() };
            let p = a.premultiplied(p);
            let q = if covered_b { b.premultiplied(q) } else { [0.0; 4] };
            let behind = 1.0 - p[3].clamp(0.0, 1.0);
            linear.show([0, 1, 2, 3].map(|c| p[c] + behind * q[c]), x, y)
        }
    }
}
