//! The layout of the pixels of a page, which is as stored, six faces as a cross, or one face.

use crate::pyramid::Pyramid;
use granita_image::ImageSpec;
use granita_texture::CubeLayout;

/// The visible part of a page.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Arrangement {
    /// All of it, as it is stored.
    #[default]
    Stored,
    /// The unfolded faces of a cube, with py above and ny below the row of the four others.
    Cross,
    /// One face of a cube, by its index in the order px, nx, py, ny, pz, nz.
    Face(usize),
}

/// A rectangle of the page, and its position on the sheet.
#[derive(Clone, Debug, PartialEq)]
pub struct Patch {
    /// Left, top, width and height in the coordinates of the sheet, which are pixels of level 0.
    pub place: [f64; 4],
    /// Left, top, width and height in pixels of each level.
    pub source: Vec<[f64; 4]>,
    /// True when it is rotated by 180 degrees.
    pub turned: bool,
}

/// The layout of a page.
#[derive(Clone, Debug, PartialEq)]
pub struct Sheet {
    /// Rectangles that do not overlap.
    pub patches: Vec<Patch>,
    /// The left, top, right and bottom of all patches.
    pub bounds: [f64; 4],
    /// The finest level that is shown.
    pub level: usize,
}

/// Returns the column and the row of each face in a cross of 4 x 3, and true when it is rotated by 180 degrees.
fn cross(layout: CubeLayout) -> [(f64, f64, bool); 6] {
    match layout {
        // The layout is left-handed, with the row nx, pz, px, nz.
        CubeLayout::Mosaic => [
            (2., 1., false),
            (0., 1., false),
            (1., 0., false),
            (1., 2., false),
            (1., 1., false),
            (3., 1., false),
        ],
        // The layout is right-handed, so the order of the row is reversed, and py and ny are upside down.
        CubeLayout::Column => [
            (0., 1., false),
            (2., 1., false),
            (1., 0., true),
            (1., 2., true),
            (1., 1., false),
            (3., 1., false),
        ],
    }
}

impl Sheet {
    /// Lays out a page whose stored levels are `specs`. `layout` is that of its faces, if it has any. An arrangement
    /// that the page does not support counts as [`Arrangement::Stored`].
    pub(crate) fn new(
        arrangement: Arrangement,
        level: usize,
        specs: &[ImageSpec],
        layout: Option<CubeLayout>,
        pyramid: &Pyramid,
    ) -> Self {
        let spec = &specs[0];
        let faces = layout.and_then(|l| Some((l, l.face_size(spec)?.0)));
        let (x, y) = (f64::from(spec.x), f64::from(spec.y));
        let patches = match (arrangement, faces) {
            (Arrangement::Stored, _) | (_, None) => {
                let (w, h) = (f64::from(spec.width), f64::from(spec.height));
                let source =
                    pyramid.levels().iter().map(|l| [0.0, 0.0, f64::from(l.width), f64::from(l.height)]);
                vec![Patch { place: [x, y, w, h], source: source.collect(), turned: false }]
            }
            (Arrangement::Cross, Some((layout, size))) => {
                let n = f64::from(size);
                (cross(layout).into_iter().enumerate())
                    .map(|(face, (column, row, turned))| Patch {
                        place: [column * n, row * n, n, n],
                        source: face_rects(layout, face, specs, pyramid),
                        turned,
                    })
                    .collect()
            }
            (Arrangement::Face(face), Some((layout, size))) => {
                let n = f64::from(size);
                let source = face_rects(layout, face.min(5), specs, pyramid);
                vec![Patch { place: [0.0, 0.0, n, n], source, turned: false }]
            }
        };
        let mut bounds = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
        for Patch { place: [x, y, w, h], .. } in &patches {
            bounds = [bounds[0].min(*x), bounds[1].min(*y), bounds[2].max(x + w), bounds[3].max(y + h)];
        }
        Self { patches, bounds, level: level.min(pyramid.levels().len() - 1) }
    }

    /// Returns the pixel of level `level` at a point of the sheet; `None` beside the image.
    pub fn pixel_at(&self, x: f64, y: f64, level: usize) -> Option<(u32, u32)> {
        let patch = self.patches.iter().find(|p| p.contains(x, y))?;
        let (u, v) = patch.source_at(x, y, level);
        let [left, top, w, h] = patch.source[level];
        let last = |from: f64, size: f64| (from + size).ceil() - 1.0;
        Some((u.floor().clamp(left, last(left, w)) as u32, v.floor().clamp(top, last(top, h)) as u32))
    }
}

impl Patch {
    /// True when the patch contains a point of the sheet.
    pub fn contains(&self, x: f64, y: f64) -> bool {
        let [left, top, w, h] = self.place;
        x >= left && x < left + w && y >= top && y < top + h
    }

    /// Returns the coordinates in pixels of a level at a point of the sheet.
    pub fn source_at(&self, x: f64, y: f64, level: usize) -> (f64, f64) {
        let [px, py, pw, ph] = self.place;
        let [left, top, w, h] = self.source[level];
        let (mut u, mut v) = ((x - px) / pw, (y - py) / ph);
        if self.turned {
            (u, v) = (1.0 - u, 1.0 - v);
        }
        (left + u * w, top + v * h)
    }
}

/// Returns the position of a face in every level.
pub(crate) fn face_rects(
    layout: CubeLayout,
    face: usize,
    specs: &[ImageSpec],
    pyramid: &Pyramid,
) -> Vec<[f64; 4]> {
    let mut rects: Vec<[f64; 4]> = Vec::new();
    let cell = layout.cell(face);
    for (level, l) in pyramid.levels().iter().enumerate() {
        let stored = specs.get(level).and_then(|spec| layout.face_size(spec));
        let rect = match (stored, rects.last()) {
            (Some((size, (step_x, step_y))), _) => {
                let (x, y) = (cell.0 * step_x, cell.1 * step_y);
                [f64::from(x), f64::from(y), f64::from(size), f64::from(size)]
            }
            // The level is computed from the one before, or too small for six faces. The face is the same part of it.
            (None, Some(before)) => {
                let finer = &pyramid.levels()[level - 1];
                let (sx, sy) = (finer.scale.0 / l.scale.0, finer.scale.1 / l.scale.1);
                [before[0] * sx, before[1] * sy, before[2] * sx, before[3] * sy]
            }
            (None, None) => [0.0, 0.0, f64::from(l.width), f64::from(l.height)],
        };
        rects.push(rect);
    }
    rects
}
