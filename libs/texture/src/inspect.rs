//! Data about textures without lookups: sizes, kind, metadata, mean and single texels.

use crate::file::{Source, TextureFile};
use crate::plain::by_channels;
use crate::reader::TextureReader;
use crate::udim::Square;
use crate::{Lookup, TextureCache, TextureId, TextureKind, Up, Wrap};
use granita_base::Transform;
use granita_image::{ImageSpec, PixelType};
use std::path::PathBuf;

/// The largest number of texels of a level of which [`TextureCache::mean`] computes the mean.
const MOST_AVERAGED: u64 = 1 << 16;

/// Data about a texture, as [`TextureCache::describe`] returns them. For a set they are those of its first square.
#[derive(Clone, Debug, PartialEq)]
pub struct TextureInfo {
    /// The file that was found.
    pub path: PathBuf,
    /// The kind. A file whose images are slices of one size is a volume.
    pub kind: TextureKind,
    /// The type of its stored values.
    pub pixel_type: PixelType,
    /// The number of channels.
    pub channels: usize,
    /// The width and height in texels of each level, the largest first. Those of cubes are of the whole image with its
    /// six faces.
    pub levels: Vec<[u32; 2]>,
    /// The width and height in texels of one face of the largest level. For images that are not cubes they are those of
    /// the level.
    pub face: [u32; 2],
    /// The width and height in texels of the tiles of the largest level; `None` when the levels are held in memory,
    /// because the file has no tiles or no levels.
    pub tile: Option<[u32; 2]>,
    /// The wrap mode of the file in s.
    pub swrap: Wrap,
    /// The wrap mode of the file in t.
    pub twrap: Wrap,
    /// The orientation of a latitude-longitude map.
    pub up: Up,
    /// The squares of a set, in order. They are empty for a texture that is not a set.
    pub squares: Vec<Square>,
    /// The transformation of a shadow map from "common" space to the camera of its light, where z is the depth.
    pub world_to_camera: Option<Transform>,
    /// The transformation of a shadow map from "common" space to the map, which spans -1 to 1 in x and y, with y
    /// upward.
    pub world_to_screen: Option<Transform>,
}

impl TextureCache {
    /// Returns the texture of this name, without substitutes, or the reason why it cannot be used. No message is
    /// reported, so that the caller can pass the reason on.
    ///
    /// # Errors
    /// The text names the texture, and the folders that were searched or the error of its file.
    pub fn try_find(&self, name: &str) -> Result<TextureId, String> {
        let shared = self.shared();
        shared.look_for(name).map(TextureId).ok_or_else(|| shared.reason(name))
    }

    /// Returns the data of a texture that lookups need.
    pub fn describe(&self, id: TextureId) -> TextureInfo {
        let file = self.file(id);
        let base = &file.levels[0];
        TextureInfo {
            path: file.path.clone(),
            kind: file.told_kind(),
            pixel_type: file.pixel_type,
            channels: file.channels,
            levels: file.levels.iter().map(|l| [l.width, l.height]).collect(),
            face: [base.face_width, base.face_height],
            tile: (!matches!(file.source, Source::Memory(..))).then_some([base.tile_width, base.tile_height]),
            swrap: file.swrap,
            twrap: file.twrap,
            up: file.up,
            squares: file.set.as_ref().map(|set| set.squares().collect()).unwrap_or_default(),
            world_to_camera: file.world_to_camera,
            world_to_screen: file.world_to_screen,
        }
    }

    /// Opens the file of a texture once more, and returns the description of its largest level with all metadata.
    ///
    /// # Errors
    /// The error of the file, or a text when there is no file because the map is made on demand.
    pub fn spec(&self, id: TextureId) -> Result<ImageSpec, String> {
        let input = self.shared().open_whole(self.file(id))?;
        input.spec(0, 0).cloned().ok_or_else(|| format!("{}: it has no pixels", self.file(id).path.display()))
    }

    /// Returns the mean of each channel of a texture, which is that of its smallest level. Returns `None` for shadow
    /// maps, whose texels are depths, for volumes, and for textures whose smallest level has more than 65536 texels.
    pub fn mean(&self, id: TextureId) -> Option<Vec<f32>> {
        let file = self.file(id);
        let last = file.levels.len() - 1;
        let [width, height] = [file.levels[last].width, file.levels[last].height];
        let count = u64::from(width) * u64::from(height);
        let kind = file.told_kind();
        if kind.is_shadow() || kind == TextureKind::Volume || count > MOST_AVERAGED {
            return None;
        }
        let mut reader = self.reader();
        let mut sums = vec![0.0_f64; file.channels];
        let mut texel = vec![0.0; file.channels];
        for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
            reader.texel(id, (last, x, y), 0, 0.0, &mut texel);
            sums.iter_mut().zip(&texel).for_each(|(sum, v)| *sum += f64::from(*v));
        }
        Some(sums.iter().map(|sum| (sum / count as f64) as f32).collect())
    }
}

impl TextureReader<'_> {
    /// Reads one texel of a level (0 is the largest): column `x` from the left and row `y` from the top of the whole
    /// image. The result is channels `first_channel` and following. Those that the file lacks become `fill`. Values of
    /// 8 and 16 bits are fractions. Returns false, and stores `fill`, when the level or the texel does not exist.
    pub fn texel(
        &mut self,
        id: TextureId,
        (level, x, y): (usize, u32, u32),
        first_channel: u32,
        fill: f32,
        out: &mut [f32],
    ) -> bool {
        let file = self.look_up(id);
        if !file.levels.get(level).is_some_and(|l| x < l.width && y < l.height) {
            out.fill(fill);
            return false;
        }
        by_channels(file, first_channel, fill, out, |first, n| {
            self.sampler(file, first, n).texel(level, x, y)
        });
        true
    }

    /// Looks up the texel of the largest level that contains a point, without any filter. Blur, widths and derivatives
    /// have no effect. Wrap modes, channels and `fill` are as in [`TextureReader::texture`], and so are sets.
    pub fn nearest(&mut self, id: TextureId, lookup: &Lookup, out: &mut [f32]) {
        let file = self.look_up(id);
        match &file.set {
            None => self.nearest_in(file, lookup, out),
            Some(squares) => {
                let shared = self.shared();
                let place = squares.home(lookup.s, lookup.t);
                let home = place.and_then(|at| {
                    let index = squares.index(at, |name| shared.find(name));
                    Some((at, shared.files.get(index?)?))
                });
                match home {
                    Some((at, file)) => {
                        let clamp = Some(Wrap::Clamp);
                        let here = Lookup { s: at.s, t: at.t, swrap: clamp, twrap: clamp, ..*lookup };
                        self.nearest_in(file, &here, out);
                    }
                    None => {
                        if let Some(what) = place.and_then(|at| squares.complaint(at)) {
                            shared.warn(what);
                        }
                        by_channels(file, lookup.first_channel, lookup.fill, out, |_, _| [0.0; 4]);
                    }
                }
            }
        }
    }

    fn nearest_in(&mut self, file: &TextureFile, q: &Lookup, out: &mut [f32]) {
        let base = file.levels[0];
        let place = |x: f32, n: u32, wrap: Wrap| {
            let x = (x.is_finite()).then(|| wrap.reduce(x))?;
            wrap.index((x * n as f32).floor() as i32, n as i32).map(|i| i as u32)
        };
        let x = place(q.s, base.width, q.swrap.unwrap_or(file.swrap));
        let y = place(q.t, base.height, q.twrap.unwrap_or(file.twrap));
        let texel = x.zip(y).filter(|_| !file.is_broken());
        by_channels(file, q.first_channel, q.fill, out, |first, n| match texel {
            Some((x, y)) => self.sampler(file, first, n).texel(0, x, y),
            None => [0.0; 4],
        });
        self.probes += 1;
    }
}
