//! Reading what a texture is made of.

use super::MakeOptions;
use crate::error::{Result, TextureError};
use crate::picture::Picture;
use granita_base::Params;
use granita_image::{FormatRegistry, ImageSpec, PixelType};
use std::path::{Path, PathBuf};

/// One input, ready for work: the whole display window, linear.
pub(crate) struct Input {
    pub(crate) path: PathBuf,
    pub(crate) picture: Picture,
    pub(crate) pixel_type: PixelType,
    pub(crate) channels: Vec<String>,
    pub(crate) attributes: Params,
    /// Values that were not numbers.
    pub(crate) nans: u64,
}

/// Attributes that describe how the input is stored, not what it shows.
const STORAGE: [&str; 8] = [
    "compression",
    "planarconfig",
    "rowsperstrip",
    "textureformat",
    "wrapmodes",
    "envmap",
    "orientation",
    "software",
];

impl Input {
    /// Reads the first image of a file.
    pub(crate) fn read(path: &Path, options: &MakeOptions, registry: &FormatRegistry) -> Result<Self> {
        let mut input = Self::read_raw(path, registry)?;
        gamma(&mut input.picture, options.ingamma);
        Ok(input)
    }

    /// The same without gamma: depths.
    pub(crate) fn read_raw(path: &Path, registry: &FormatRegistry) -> Result<Self> {
        let file = registry.open(path)?;
        let malformed = |what: &str| TextureError::Malformed { path: path.to_owned(), what: what.to_owned() };
        let spec = file.spec(0, 0).ok_or_else(|| malformed("there is no image in it"))?;
        if spec.width == 0 || spec.height == 0 || spec.nchannels() == 0 {
            return Err(malformed("there are no pixels in it"));
        }
        let (picture, nans) = Picture::read(&*file, 0)?;
        let picture = to_display_window(picture, spec, path)?;
        let mut attributes = spec.attributes.clone();
        attributes.0.retain(|p| !STORAGE.iter().any(|s| p.name.eq_ignore_ascii_case(s)));
        Ok(Self {
            path: path.to_owned(),
            picture,
            pixel_type: spec.pixel_type,
            channels: spec.channels.clone(),
            attributes,
            nans,
        })
    }

    /// A matrix that the file carries.
    pub(crate) fn matrix(&self, name: &str) -> Option<[f32; 16]> {
        self.attributes.floats(name)?.get(..16)?.try_into().ok()
    }

    /// Keeps one channel: the one named "z" or "Z", or the first.
    pub(crate) fn only_depth(&mut self) {
        let n = self.picture.channels;
        let depth = self.channels.iter().position(|c| c.eq_ignore_ascii_case("z")).unwrap_or(0);
        if n > 1 {
            self.picture.data = self.picture.data.chunks_exact(n).map(|texel| texel[depth]).collect();
            self.picture.channels = 1;
        }
        self.channels = vec!["Z".to_owned()];
    }
}

/// The picture as its display window shows it: cut where it is larger, black where there is no data.
fn to_display_window(picture: Picture, spec: &ImageSpec, path: &Path) -> Result<Picture> {
    let whole = (spec.x, spec.y, spec.width, spec.height)
        == (spec.full_x, spec.full_y, spec.full_width, spec.full_height);
    if whole || spec.full_width == 0 || spec.full_height == 0 {
        return Ok(picture);
    }
    let texels = u64::from(spec.full_width) * u64::from(spec.full_height);
    let max = 1 << 31;
    if texels > max {
        let what = "number of pixels of the display window";
        return Err(TextureError::Limit { path: path.to_owned(), what, asked: texels, max });
    }
    let mut out = Picture::new(spec.full_width as usize, spec.full_height as usize, picture.channels);
    let (dx, dy) = (i64::from(spec.x) - i64::from(spec.full_x), i64::from(spec.y) - i64::from(spec.full_y));
    for y in 0..picture.height {
        let to_y = y as i64 + dy;
        if !(0..out.height as i64).contains(&to_y) {
            continue;
        }
        for x in 0..picture.width {
            let to_x = x as i64 + dx;
            if (0..out.width as i64).contains(&to_x) {
                out.texel_mut(to_x as usize, to_y as usize).copy_from_slice(picture.texel(x, y));
            }
        }
    }
    Ok(out)
}

/// Raises the first three channels to the power `g`; negative values keep their sign.
pub(crate) fn gamma(picture: &mut Picture, g: f32) {
    if g == 1.0 {
        return;
    }
    let n = picture.channels;
    for texel in picture.data.chunks_exact_mut(n) {
        for v in &mut texel[..n.min(3)] {
            *v = v.signum() * v.abs().powf(g).min(1e30);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn display_windows() {
        let mut spec = ImageSpec::new(2, 2, 1, PixelType::Float);
        (spec.x, spec.y, spec.full_width, spec.full_height) = (1, -1, 4, 3);
        let mut p = Picture::new(2, 2, 1);
        p.data = vec![1.0, 2.0, 3.0, 4.0];
        let q = to_display_window(p, &spec, Path::new("x")).unwrap();
        assert_eq!((q.width, q.height), (4, 3));
        assert_eq!(q.data, [0.0, 3.0, 4.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn gamma_spares_alpha_and_signs() {
        let mut p = Picture::new(1, 1, 4);
        p.data = vec![0.5, -0.5, 1.0, 0.5];
        gamma(&mut p, 2.0);
        assert_eq!(p.data, [0.25, -0.25, 1.0, 0.5]);
    }
}
