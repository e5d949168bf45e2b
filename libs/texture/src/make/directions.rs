//! Maps of all directions, from one layout to another.
//!
//! Every layout shows the surroundings as they are seen from their centre, and a conversion does not mirror them. The
//! directions here are left handed: +x to the right, +y up, +z ahead. The files of [`super::make`] also keep the axes
//! of their formats, some of which are right handed.

use super::convert::{between, cube_at, latlong_at, points, supersampled};
use super::environment::angular;
use crate::Up;
use crate::cube::{self, CubeLayout};
use crate::error::{Result, TextureError};
use crate::image::Image;
use granita_base::Vec3;
use std::f32::consts::{FRAC_PI_2, PI, TAU};

/// The layout of all directions in one image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Directions {
    /// Longitude across, latitude down, twice as wide as high (reference 9.2.4).
    LatLong,
    /// Six faces of a cube, three across and two down: px py pz over nx ny nz (reference 9.2.5).
    Cube,
    /// Six faces of a cube in a column, as OpenEXR stores them.
    Column,
    /// A cross of 4 x 3 faces: nx pz px nz in the second row, py above and ny below pz.
    Cross,
    /// A cross of 3 x 4 faces: nx pz px in the second row, py above pz, ny below it, and nz upside down at the bottom.
    VerticalCross,
    /// An angular map: a circle in a square, the angle growing evenly from the centre.
    Probe,
}

/// The columns and rows of the faces px nx py ny pz nz in a cross.
const CROSS: [(usize, usize); 6] = [(2, 1), (0, 1), (1, 0), (1, 2), (1, 1), (3, 1)];

impl Directions {
    /// The names on the command line.
    pub const NAMES: [(&'static str, Self); 6] = [
        ("latlong", Self::LatLong),
        ("cube", Self::Cube),
        ("column", Self::Column),
        ("cross", Self::Cross),
        ("vcross", Self::VerticalCross),
        ("probe", Self::Probe),
    ];

    /// Returns the layout of a name.
    pub fn from_word(word: &str) -> Option<Self> {
        Self::NAMES.into_iter().find(|(name, _)| *name == word).map(|(_, layout)| layout)
    }

    /// Returns the columns and rows of faces; `None` for layouts without faces.
    fn cells(self) -> Option<(usize, usize)> {
        match self {
            Self::LatLong | Self::Probe => None,
            Self::Cube => Some((3, 2)),
            Self::Column => Some((1, 6)),
            Self::Cross => Some((4, 3)),
            Self::VerticalCross => Some((3, 4)),
        }
    }

    /// Returns the column and row of a face.
    fn cell(self, face: usize) -> (usize, usize) {
        match self {
            Self::Cube => (face / 2, face % 2),
            Self::Column => (0, face),
            Self::VerticalCross if face == 5 => (1, 3),
            _ => CROSS[face],
        }
    }

    /// Returns the number of texels per radian of an image of this layout.
    ///
    /// # Errors
    /// [`TextureError::Misuse`] when the image does not have the proportions of the layout.
    pub fn density(self, (width, height): (usize, usize)) -> Result<f32> {
        let fits = match self {
            Self::LatLong => width > 0 && height > 0,
            Self::Probe => width == height && width > 0,
            _ => self.cells().is_some_and(|(w, h)| width >= w && width % w == 0 && width * h == height * w),
        };
        if !fits {
            let what = match self.cells() {
                Some((w, h)) => format!("{w} by {h} square faces, this has {width} x {height} pixels"),
                None => format!("a square, this has {width} x {height} pixels"),
            };
            return Err(TextureError::Misuse { what: format!("this layout of directions is {what}") });
        }
        Ok(match self.cells() {
            Some((columns, _)) => (width / columns) as f32 / FRAC_PI_2,
            None => width as f32 / TAU,
        })
    }

    /// Returns the size in pixels of an image of this layout. `width` is that of a face or of the whole; without it the
    /// image has `density` texels per radian.
    pub fn size(self, density: f32, width: Option<usize>) -> (usize, usize) {
        let natural = |angle: f32| ((density * angle).round() as usize).max(1);
        match self.cells() {
            Some((columns, rows)) => {
                let n = width.unwrap_or_else(|| natural(FRAC_PI_2));
                (columns * n, rows * n)
            }
            None => {
                let w = width.unwrap_or_else(|| natural(TAU));
                if self == Self::Probe { (w, w) } else { (w, (w / 2).max(1)) }
            }
        }
    }

    /// Returns the direction at a point of an image, in pixels; `None` where the layout has no direction.
    fn direction(self, up: Up, (x, y): (f32, f32), (w, h): (usize, usize)) -> Option<Vec3> {
        let (s, t) = (x / w as f32, y / h as f32);
        match self {
            Self::LatLong => {
                let (phi, theta) = ((s - 0.5) * TAU, t * PI);
                let (ahead, right, pole) = (
                    libm::sinf(theta) * libm::cosf(phi),
                    libm::sinf(theta) * libm::sinf(phi),
                    libm::cosf(theta),
                );
                Some(match up {
                    Up::Z => Vec3::new(ahead, right, pole),
                    Up::Y => Vec3::new(right, pole, ahead),
                })
            }
            Self::Probe => {
                let (u, v) = (2.0 * s - 1.0, 1.0 - 2.0 * t);
                let r = libm::hypotf(u, v);
                if r > 1.0 {
                    return None;
                }
                let across = if r > 0.0 { libm::sinf(r * PI) / r } else { PI };
                Some(Vec3::new(u * across, v * across, libm::cosf(r * PI)))
            }
            _ => {
                let (columns, rows) = self.cells()?;
                let (u, v) = (s * columns as f32, t * rows as f32);
                let cell = ((u as usize).min(columns - 1), (v as usize).min(rows - 1));
                let face = (0..6).find(|face| self.cell(*face) == cell)?;
                let (u, v) = (u - cell.0 as f32, v - cell.1 as f32);
                let layout = if self == Self::Column { CubeLayout::Column } else { CubeLayout::Mosaic };
                let is_turned = self == Self::VerticalCross && face == 5;
                let (u, v) = if is_turned { (1.0 - u, 1.0 - v) } else { (u, v) };
                let d = cube::direction(layout, face, u, v);
                Some(if self == Self::Column { flipped(d) } else { d })
            }
        }
    }
}

/// Returns a direction of the other handedness.
fn flipped(d: Vec3) -> Vec3 {
    Vec3::new(-d.x, d.y, d.z)
}

/// A map of all directions in memory.
#[derive(Clone, Debug, PartialEq)]
pub struct Panorama {
    /// The width in pixels.
    pub width: usize,
    /// The height in pixels.
    pub height: usize,
    /// The number of channels.
    pub channels: usize,
    /// The values in rows from the top, channels interleaved.
    pub values: Vec<f32>,
}

impl Panorama {
    /// Returns the map in another layout, of a size that [`Directions::size`] returns. Each pixel is the mean of up to
    /// 16 x 16 interpolated values, so that no texel of a denser map is missed. `up` is the axis of the poles of
    /// latitude-longitude maps. Pixels without a direction are 0.
    ///
    /// # Errors
    /// [`TextureError::Misuse`] when a size does not have the proportions of its layout.
    pub fn converted(
        self,
        (from, to): (Directions, Directions),
        up: Up,
        size: (usize, usize),
    ) -> Result<Self> {
        let density = from.density((self.width, self.height))?;
        let sub = points(density, to.density(size)?);
        let channels = self.channels;
        let image = Image { width: self.width, height: self.height, channels, data: self.values };
        let place = |x: f32, y: f32| to.direction(up, (x, y), size);
        let out = match from {
            Directions::LatLong => supersampled(size, channels, sub, |x, y, out| match place(x, y) {
                // With +y up, that function is right handed.
                Some(d) => latlong_at(&image, up, if up == Up::Y { flipped(d) } else { d }, out),
                None => out.fill(0.0),
            }),
            Directions::Probe => supersampled(size, channels, sub, |x, y, out| match place(x, y) {
                Some(d) => probe_at(&image, d, out),
                None => out.fill(0.0),
            }),
            cube => {
                let faces = faces(&image, cube);
                drop(image);
                supersampled(size, channels, sub, |x, y, out| match place(x, y) {
                    Some(d) => cube_at(&faces, if cube == Directions::Column { flipped(d) } else { d }, out),
                    None => out.fill(0.0),
                })
            }
        };
        Ok(Self { width: out.width, height: out.height, channels, values: out.data })
    }
}

/// Returns the six faces of a cube, with the handedness of [`CubeLayout::Mosaic`].
fn faces(image: &Image, layout: Directions) -> [Image; 6] {
    let n = image.width / layout.cells().map_or(1, |(columns, _)| columns);
    std::array::from_fn(|face| {
        let (column, row) = layout.cell(face);
        let cell = image.cropped(column * n, row * n, n, n);
        match layout {
            Directions::VerticalCross if face == 5 => cell.turned(),
            // The faces of the column are right handed.
            Directions::Column => mirrored(&cell, face),
            _ => cell,
        }
    })
}

/// Returns a face of the column as one of the mosaic. The faces of y are mirrored down, the others across.
fn mirrored(face: &Image, number: usize) -> Image {
    let n = face.width;
    let mut out = Image::new(n, n, face.channels);
    for y in 0..n {
        for x in 0..n {
            let (from_x, from_y) = if matches!(number, 2 | 3) { (x, n - 1 - y) } else { (n - 1 - x, y) };
            out.texel_mut(x, y).copy_from_slice(face.texel(from_x, from_y));
        }
    }
    out
}

/// Looks up an angular map in a direction, bilinearly, within its circle.
fn probe_at(p: &Image, d: Vec3, out: &mut [f32]) {
    let (u, v) = angular(d.normalize());
    let radius = p.width as f32 * 0.5;
    // The four texels lie within the circle when the point is a texel away from its edge.
    let inside = ((radius - 1.0) / radius).max(0.0);
    let shrink = (inside / libm::hypotf(u, v).max(f32::MIN_POSITIVE)).min(1.0);
    let (x, y) = ((1.0 + u * shrink) * radius, (1.0 - v * shrink) * radius);
    let (x, y, fx, fy) = between(x, y);
    let last = p.width as i32 - 1;
    let texel = |x: i32, y: i32| p.texel(x.clamp(0, last) as usize, y.clamp(0, last) as usize);
    super::convert::mix([texel(x, y), texel(x + 1, y), texel(x, y + 1), texel(x + 1, y + 1)], fx, fy, out);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a map whose values are its directions.
    fn map(layout: Directions, up: Up, n: usize) -> Panorama {
        let size = layout.size(1.0, Some(n));
        let (width, height) = size;
        let mut values = Vec::new();
        for y in 0..height {
            for x in 0..width {
                let d = layout.direction(up, (x as f32 + 0.5, y as f32 + 0.5), size);
                values.extend(d.map_or([0.0; 3], |d| d.normalize().to_array()));
            }
        }
        Panorama { width, height, channels: 3, values }
    }

    #[test]
    fn every_layout_keeps_its_directions_in_every_other_one() {
        for up in [Up::Y, Up::Z] {
            for (name, from) in Directions::NAMES {
                for (other, to) in Directions::NAMES {
                    let n = if from.cells().is_some() { 32 } else { 128 };
                    let m = if to.cells().is_some() { 16 } else { 64 };
                    let expected = map(to, up, m);
                    let found = map(from, up, n).converted((from, to), up, (expected.width, expected.height));
                    let found = found.unwrap();
                    for (i, (a, b)) in found.values.iter().zip(&expected.values).enumerate() {
                        // A texel at the edge of the circle is partly empty.
                        let pixel = &expected.values[i / 3 * 3..][..3];
                        let back = pixel[2] < -0.8 && (from == Directions::Probe || to == Directions::Probe);
                        // So is one whose centre is outside.
                        let empty = to == Directions::Probe && pixel.iter().all(|v| *v == 0.0);
                        assert!(
                            (a - b).abs() < 0.12 || back || empty,
                            "{name} {other} {up:?} at {i}: {a} {b}"
                        );
                    }
                }
            }
        }
    }

    /// The face ahead shows the middle of a panorama, with the same side up and the same side to the right.
    #[test]
    fn images_are_not_mirrored() {
        let (width, height) = (128, 64);
        let value = |i: usize| [(i % width) as f32 / width as f32, (i / width) as f32 / height as f32];
        let values = (0..width * height).flat_map(value).collect();
        let map = Panorama { width, height, channels: 2, values };
        for to in [Directions::Cube, Directions::Column, Directions::Cross, Directions::VerticalCross] {
            let size = to.size(1.0, Some(16));
            let cube = map.clone().converted((Directions::LatLong, to), Up::Y, size).unwrap();
            let (column, row) = to.cell(4);
            let at = |x: usize, y: usize| {
                let i = (row * 16 + y) * size.0 + column * 16 + x;
                [cube.values[2 * i], cube.values[2 * i + 1]]
            };
            let (middle, right, below) = (at(7, 7), at(14, 7), at(7, 14));
            assert!(middle.iter().all(|v| (v - 0.5).abs() < 0.03), "{to:?}: {middle:?}");
            assert!(
                right[0] > middle[0] + 0.05 && below[1] > middle[1] + 0.05,
                "{to:?}: {right:?} {below:?}"
            );
        }
    }

    #[test]
    fn sizes_follow_from_the_density() {
        let density = Directions::LatLong.density((400, 200)).unwrap();
        assert_eq!(Directions::Cube.size(density, None), (300, 200));
        assert_eq!(Directions::Column.size(density, None), (100, 600));
        assert_eq!(Directions::Cross.size(density, Some(8)), (32, 24));
        assert_eq!(Directions::Probe.size(density, None), (400, 400));
        for (layout, size) in
            [(Directions::Cube, (30, 21)), (Directions::Probe, (4, 5)), (Directions::Cross, (0, 0))]
        {
            assert!(layout.density(size).is_err(), "{layout:?}");
        }
        assert_eq!(Directions::from_word("vcross"), Some(Directions::VerticalCross));
    }

    #[test]
    fn constants_stay_exact() {
        let map = Panorama { width: 16, height: 8, channels: 1, values: vec![0.3; 128] };
        let cube = map.converted((Directions::LatLong, Directions::Cube), Up::Y, (12, 8)).unwrap();
        assert!(cube.values.iter().all(|v| *v == 0.3));
    }
}
