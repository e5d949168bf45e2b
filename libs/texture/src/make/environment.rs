//! Makes environment maps from images.

use super::input::Input;
use super::output::{Body, Extras, Texture};
use super::sphere::{cube_pyramid, latlong_pyramid};
use super::{MakeOptions, convert, notes_of, power_of_two};
use crate::cube::{self, CubeLayout, FACE_NAMES};
use crate::error::{Result, TextureError};
use crate::image::Image;
use crate::{TextureKind, Up, Wrap};
use granita_base::{Filter, Vec3};
use rayon::prelude::*;

const CLAMP: (Wrap, Wrap) = (Wrap::Clamp, Wrap::Clamp);

fn malformed(input: &Input, what: String) -> TextureError {
    TextureError::Malformed { path: input.path.clone(), what }
}

/// Checks that the faces are square, of one size and with the same channels. Returns their side in pixels. `places` are
/// their indices in [`FACE_NAMES`].
pub(crate) fn check_faces(inputs: &[Input], places: &[usize]) -> Result<usize> {
    let first = &inputs[0];
    let first_name = FACE_NAMES[places[0]];
    for (input, name) in inputs.iter().zip(places.iter().map(|p| FACE_NAMES[*p])) {
        let (p, q) = (&input.image, &first.image);
        if p.width != p.height {
            return Err(malformed(input, format!("face {name} is not square: {} x {}", p.width, p.height)));
        }
        if (p.width, p.channels) != (q.width, q.channels) {
            return Err(malformed(
                input,
                format!(
                    "face {name} has {} x {} pixels of {} channels, face {first_name} {} x {} of {}",
                    p.width, p.height, p.channels, q.width, q.height, q.channels
                ),
            ));
        }
    }
    Ok(first.image.width)
}

/// Returns a square image with the field of view `fov_deg` as one with 90 degrees and `n` pixels a side. It is cropped,
/// or extended by its border.
fn refit(face: &Image, fov_deg: f32, n: usize) -> Image {
    let scale = 1.0 / libm::tanf(fov_deg.to_radians() * 0.5);
    if (scale - 1.0).abs() < 1e-6 {
        return face.resized(n, n, Filter::CatmullRom, CLAMP);
    }
    let size = face.width as f32;
    let mut out = Image::new(n, n, face.channels);
    out.data.par_chunks_mut(n * face.channels).enumerate().for_each(|(y, row)| {
        for (x, texel) in row.chunks_exact_mut(face.channels).enumerate() {
            let place = |i: usize| {
                let ndc = 2.0 * (i as f32 + 0.5) / n as f32 - 1.0;
                (ndc * scale * 0.5 + 0.5) * size
            };
            face.bilinear(place(x), place(y), texel);
        }
    });
    out
}

/// Returns a texture with the properties that all environments share.
fn texture(mut inputs: Vec<Input>, kind: TextureKind, body: Body) -> Texture {
    let notes = notes_of(&inputs);
    let pixel_type = inputs.iter().map(|i| i.pixel_type).max().unwrap_or(granita_image::PixelType::Float);
    let main = inputs.swap_remove(if inputs.len() == 6 { 4 } else { 0 });
    let (channels, attributes) = (main.channels, main.attributes);
    Texture {
        kind,
        body,
        up: None,
        channels,
        pixel_type,
        attributes,
        icc_profile: main.spec.icc_profile,
        conversion: Some(main.conversion),
        notes,
        extras: Extras::default(),
    }
}

/// Makes cubes according to the options and the format of the texture.
#[derive(Clone, Copy)]
pub(crate) struct Cubes<'a> {
    pub(crate) options: &'a MakeOptions,
    /// True when the texture will be an OpenEXR file. All six faces are one image there, and each level of that image
    /// is half of the one before. Only faces whose side is a power of two are then halves of faces.
    pub(crate) exr: bool,
}

impl Cubes<'_> {
    /// Returns the side of the faces of a texture, for inputs with faces of `n` pixels.
    fn side(self, n: usize) -> usize {
        if self.options.resize || self.exr { power_of_two(n) } else { n }
    }

    /// Returns the texture of six faces. `n` is the side in pixels that they would have without resizing.
    fn finish(self, inputs: Vec<Input>, faces: [Image; 6], n: usize) -> Texture {
        let side = faces[0].width;
        let body = Body::Cube(cube_pyramid(faces, self.options.filter));
        let mut texture = texture(inputs, TextureKind::CubeFaceEnvironment, body);
        if !self.options.resize && side != n {
            let what = format!("faces have {side} pixels a side, not {n}: OpenEXR needs a power of two");
            texture.notes.push(what);
        }
        texture
    }
}

fn finish_latlong(inputs: Vec<Input>, mut image: Image, up: Up, options: &MakeOptions) -> Texture {
    let side = |n: usize| if options.resize { power_of_two(n) } else { n };
    let size = (side(image.width), side(image.height));
    if size != (image.width, image.height) {
        image = image.resized(size.0, size.1, Filter::CatmullRom, (Wrap::Periodic, Wrap::Clamp));
    }
    let body = Body::Flat(latlong_pyramid(image, options.filter));
    Texture { up: Some(up), ..texture(inputs, TextureKind::LatLongEnvironment, body) }
}

/// True when a file declares that it is a cube-face environment.
pub(crate) fn is_cube(spec: &granita_image::ImageSpec) -> bool {
    let says = |name: &str| spec.string(name).unwrap_or_default().to_ascii_lowercase();
    says("textureformat") == "cubeface environment" || says("envmap").starts_with("cube")
}

/// Returns the six faces of a file that holds a cube.
fn faces_of(input: &Input) -> Result<[Image; 6]> {
    let (p, spec) = (&input.image, &input.spec);
    let layout = if input.exr { CubeLayout::Column } else { CubeLayout::Mosaic };
    let (columns, rows) = layout.cells();
    let (step_x, step_y) = (p.width / columns as usize, p.height / rows as usize);
    let n = match layout {
        CubeLayout::Mosaic if (1..=step_x).contains(&(spec.full_width as usize)) => spec.full_width as usize,
        _ => step_x,
    };
    if n == 0 || n > step_y || (input.exr && step_y != n) {
        return Err(malformed(
            input,
            format!("an image of {} x {} pixels cannot hold six square faces", p.width, p.height),
        ));
    }
    let cell = |face: usize| {
        let (column, row) = layout.cell(face);
        p.cropped(column as usize * step_x, row as usize * step_y, n, n)
    };
    let stored: [Image; 6] = std::array::from_fn(cell);
    if !input.exr {
        return Ok(stored);
    }
    // Right handed faces show the same directions mirrored.
    Ok(std::array::from_fn(|face| {
        let mut out = Image::new(n, n, p.channels);
        let place = |i: usize| (i as f32 + 0.5) / n as f32;
        let index = |v: f32| ((v * n as f32) as usize).min(n - 1);
        for y in 0..n {
            for x in 0..n {
                let d = cube::direction(CubeLayout::Mosaic, face, place(x), place(y));
                let at = cube::project(CubeLayout::Column, d);
                out.texel_mut(x, y).copy_from_slice(stored[at.face].texel(index(at.s), index(at.t)));
            }
        }
        out
    }))
}

/// Makes the texture of `-envcube` from one image, which is a latitude-longitude map or a cube.
pub(crate) fn cube_of_one(input: Input, cubes: Cubes<'_>) -> Result<Texture> {
    if is_cube(&input.spec) {
        let faces = faces_of(&input)?;
        let n = faces[0].width;
        let side = cubes.side(n);
        let faces = faces.map(|f| f.resized(side, side, Filter::CatmullRom, CLAMP));
        return Ok(cubes.finish(vec![input], faces, n));
    }
    let p = &input.image;
    if p.width != 2 * p.height {
        let what = format!(
            "one input of a cube is a latitude-longitude map, twice as wide as high; this has {} x {} pixels",
            p.width, p.height
        );
        return Err(malformed(&input, what));
    }
    let n = (p.width / 4).max(1);
    let faces = convert::to_cube(p, Up::of(&input.spec, input.exr), cubes.side(n));
    Ok(cubes.finish(vec![input], faces, n))
}

/// Makes the texture of `-envlatl` from six faces, or from one file that holds them. `exr` is true when the map will be
/// an OpenEXR file.
pub(crate) fn latlong_of_faces(inputs: Vec<Input>, exr: bool, options: &MakeOptions) -> Result<Texture> {
    let faces = match &inputs[..] {
        [one] => faces_of(one)?,
        _ => {
            let n = check_faces(&inputs, &[0, 1, 2, 3, 4, 5])?;
            six(&inputs, |i| refit(&i.image, options.fov_deg, n))
        }
    };
    let n = faces[0].width;
    let up = Up::of_format(exr);
    let image = convert::to_latlong(&faces, up, (4 * n, 2 * n));
    Ok(finish_latlong(inputs, image, up, options))
}

/// Makes the texture of `-envlatl` from one image that is needed as a whole. Its pixels stay where they are.
pub(crate) fn latlong(mut input: Input, options: &MakeOptions) -> Texture {
    let image = std::mem::replace(&mut input.image, Image::new(0, 0, 1));
    let up = Up::of(&input.spec, input.exr);
    finish_latlong(vec![input], image, up, options)
}

/// Returns one image for each of six inputs.
fn six(inputs: &[Input], f: impl Fn(&Input) -> Image) -> [Image; 6] {
    std::array::from_fn(|i| f(&inputs[i]))
}

/// Makes the texture of `-envcube`.
pub(crate) fn cube(inputs: Vec<Input>, cubes: Cubes<'_>) -> Result<Texture> {
    let n = check_faces(&inputs, &[0, 1, 2, 3, 4, 5])?;
    let faces = six(&inputs, |i| refit(&i.image, cubes.options.fov_deg, cubes.side(n)));
    Ok(cubes.finish(inputs, faces, n))
}

/// Makes the texture of `-vertcross`. The input has three columns and four rows of faces, and the lowest face is upside
/// down.
pub(crate) fn vertical_cross(input: Input, cubes: Cubes<'_>) -> Result<Texture> {
    let p = &input.image;
    let n = p.width / 3;
    if n == 0 || p.width != 3 * n || p.height != 4 * n {
        let what =
            format!("a vertical cross is 3 by 4 square faces, this has {} x {} pixels", p.width, p.height);
        return Err(malformed(&input, what));
    }
    let cell = |column: usize, row: usize| p.cropped(column * n, row * n, n, n);
    let faces = [cell(2, 1), cell(0, 1), cell(1, 0), cell(1, 2), cell(1, 1), cell(1, 3).turned()];
    let side = cubes.side(n);
    let faces = faces.map(|f| f.resized(side, side, Filter::CatmullRom, CLAMP));
    Ok(cubes.finish(vec![input], faces, n))
}

/// Returns the position of a direction (+z ahead, +x right, +y up) in an angular map, in [-1, 1] to the right and up.
/// The distance from the centre is the angle from +z over pi (P. Debevec, Light Probe Image Gallery).
pub(crate) fn angular(d: Vec3) -> (f32, f32) {
    let across = libm::hypotf(d.x, d.y);
    if across == 0.0 {
        // The direction ahead is the centre. The direction behind is the whole rim, which the right end represents.
        return if d.z >= 0.0 { (0.0, 0.0) } else { (1.0, 0.0) };
    }
    let r = libm::atan2f(across, d.z) / std::f32::consts::PI / across;
    (d.x * r, d.y * r)
}

/// Makes the texture of `-lightprobe`. The input is a square image whose inscribed circle shows all directions.
pub(crate) fn light_probe(input: Input, cubes: Cubes<'_>) -> Result<Texture> {
    let p = &input.image;
    if p.width != p.height {
        let what = format!("a light probe is square, this has {} x {} pixels", p.width, p.height);
        return Err(malformed(&input, what));
    }
    // The centre of a face has as many pixels per degree as the centre of the probe.
    let n = ((p.width as f32 / std::f32::consts::PI).round() as usize).max(1);
    let side = cubes.side(n);
    let faces = std::array::from_fn(|face| probe_face(p, face, side));
    Ok(cubes.finish(vec![input], faces, n))
}

/// Returns one face, in which each texel is the mean of 3 x 3 points.
fn probe_face(probe: &Image, face: usize, n: usize) -> Image {
    const SUB: usize = 3;
    let channels = probe.channels;
    let radius = probe.width as f32 * 0.5;
    let mut out = Image::new(n, n, channels);
    out.data.par_chunks_mut(n * channels).enumerate().for_each(|(y, row)| {
        let mut value = vec![0.0; channels];
        for (x, texel) in row.chunks_exact_mut(channels).enumerate() {
            for i in 0..SUB * SUB {
                let place = |v: usize, sub: usize| (v as f32 + (sub as f32 + 0.5) / SUB as f32) / n as f32;
                let d = cube::direction(CubeLayout::Mosaic, face, place(x, i % SUB), place(y, i / SUB));
                let (u, v) = angular(d.normalize());
                probe.bilinear((1.0 + u) * radius, (1.0 - v) * radius, &mut value);
                let share = 1.0 / (i + 1) as f32;
                for (t, v) in texel.iter_mut().zip(&value) {
                    *t += (v - *t) * share;
                }
            }
        }
    });
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angular_maps_place_known_directions() {
        let close = |d: Vec3, u: f32, v: f32| {
            let (a, b) = angular(d);
            assert!((a - u).abs() < 1e-6 && (b - v).abs() < 1e-6, "{d}: {a} {b}");
        };
        close(Vec3::Z, 0.0, 0.0);
        close(Vec3::X, 0.5, 0.0);
        close(Vec3::Y, 0.0, 0.5);
        close(-Vec3::X, -0.5, 0.0);
        close(-Vec3::Z, 1.0, 0.0);
        close(Vec3::new(1.0, 0.0, 1.0).normalize(), 0.25, 0.0);
    }

    #[test]
    fn environment_faces_are_extended_or_cropped_to_90_degrees() {
        let mut p = Image::new(64, 64, 1);
        for (i, v) in p.data.iter_mut().enumerate() {
            *v = ((i % 64) as f32 + 0.5) / 64.0;
        }
        let wide = 2.0 * 2.0_f32.atan().to_degrees();
        // The middle half remains of a view that is twice as wide (in tangents).
        let q = refit(&p, wide, 32);
        for x in 0..32 {
            assert!((q.data[x] - (0.25 + (x as f32 + 0.5) / 64.0)).abs() < 1e-4);
        }
        let q = refit(&p, 2.0 * 0.5_f32.atan().to_degrees(), 64);
        assert_eq!((q.data[0], q.data[63]), (p.data[0], p.data[63]));
        assert_eq!(refit(&p, 90.0, 64), p);
    }
}
