//! The options of textures of one flat image that is processed as a whole.

use super::kernel::LevelFilter;
use granita_base::Params;
use std::path::PathBuf;

/// The rules by which a texture is made where options do not decide.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum Conventions {
    /// Those of the reference.
    #[default]
    Suite,
    /// Those of OpenImageIO: its filters and its storage of types, tiles of one size for all levels, two words for the
    /// wrap modes, panoramas of OpenEXR whose first and last columns are the same place, and its metadata.
    OpenImageIo,
}

/// The part of the input that a texture shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum Frame {
    /// The display window. Pixels outside of it are left out.
    #[default]
    Display,
    /// The display window, and all pixels around it (overscan).
    Both,
    /// The data window, which becomes the display window.
    Data,
}

/// The interpretation of an input of [`FlatOptions::bump`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum BumpFormat {
    /// A normal map where there are three channels that differ, and otherwise heights.
    #[default]
    Auto,
    /// The first channel is the height, in texels.
    Height,
    /// The first three channels are a normal in the space of the texture.
    Normal,
}

/// The range of the values of a normal map.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum NormalRange {
    /// From -1 to 1 where a value is negative, and otherwise from 0 to 1.
    #[default]
    Auto,
    /// From -1 to 1.
    Centered,
    /// From 0 to 1.
    Positive,
}

/// The filter that computes slopes of heights.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Default)]
pub enum SlopeFilter {
    /// The operator of Sobel over 3 x 3 texels.
    #[default]
    Sobel,
    /// The difference of the two neighbours.
    CentralDifference,
}

/// The options of a texture of slopes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bump {
    /// The interpretation of the input.
    pub format: BumpFormat,
    /// The range of a normal map.
    pub range: NormalRange,
    /// The filter of slopes of heights.
    pub filter: SlopeFilter,
    /// The factor of the slopes.
    pub scale: f32,
    /// Negates the slopes in s.
    pub invert_s: bool,
    /// Negates the slopes in t.
    pub invert_t: bool,
    /// Slopes of heights are per unit of texture coordinates, divided by this number; 0: they are per texel.
    pub uv_scale: f32,
}

impl Default for Bump {
    fn default() -> Self {
        Self {
            format: BumpFormat::Auto,
            range: NormalRange::Auto,
            filter: SlopeFilter::Sobel,
            scale: 1.0,
            invert_s: false,
            invert_t: false,
            uv_scale: 0.0,
        }
    }
}

/// The tables of the distribution of the values, for blending by histograms (B. Burley, On Histogram-Preserving
/// Blending for Randomized Texture Tiling, JCGT 8(4), 2019).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Distribution {
    /// The standard deviation of the Gaussian.
    pub sigma: f32,
    /// The tables have 2^bits entries; 1 to 20.
    pub bits: u32,
}

/// An image that continues another one, as the images of a set do ([`UdimName`](crate::UdimName)).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Neighbour {
    /// -1 for an image to the left, 1 for one to the right, 0 for one above or below.
    pub across: i8,
    /// -1 for an image above, 1 for one below, 0 for one beside.
    pub down: i8,
    /// The image.
    pub path: PathBuf,
}

/// Options of plain textures, panoramas of one image, and shadow maps by the conventions of OpenImageIO. When one of
/// them is not the default, the image is processed as a whole.
#[derive(Clone, Debug, PartialEq)]
pub struct FlatOptions {
    /// The rules where options do not decide.
    pub conventions: Conventions,
    /// The part of the input that the texture shows.
    pub frame: Frame,
    /// Keeps colours that are not multiplied by alpha as they are.
    pub ignore_unassociated: bool,
    /// The number of channels. Missing ones are 0.
    pub channels: Option<usize>,
    /// The names of the first channels. An empty name keeps that of the input.
    pub channel_names: Vec<String>,
    /// Leaves out an alpha channel whose values are all 1.
    pub drop_opaque: bool,
    /// Keeps one of three channels that are equal.
    pub drop_equal: bool,
    /// Makes MIP levels.
    pub levels: bool,
    /// Files that replace the levels after the first, in their order.
    pub level_files: Vec<PathBuf>,
    /// The images around a plain texture. The filters of its levels use up to 256 texels of each, as far as these
    /// have the same size. The sides of the image must not be changed by resizing.
    pub neighbours: Vec<Neighbour>,
    /// A filter by the definition of OpenImageIO, which replaces [`MakeOptions::filter`](super::MakeOptions::filter).
    pub filter: Option<LevelFilter>,
    /// The strength of the unsharp mask that is applied at each level; 0: none.
    pub sharpen: f32,
    /// Replaces highlights by a logarithm while a level is made.
    pub compress_highlights: bool,
    /// The input of a panorama is a light probe (an angular map).
    pub probe: bool,
    /// The texture has six channels: height, slopes, and products of slopes.
    pub bump: Option<Bump>,
    /// Stores tables of the distribution of each channel in the metadata.
    pub distribution: Option<Distribution>,
    /// Stores the mean in the metadata. It applies to the conventions of OpenImageIO, which store a hash always.
    pub average: bool,
    /// Uses the sizes of tiles, and separate channels, that RenderMan expects.
    pub prman: bool,
    /// Stores the pixel aspect ratio of the input before resizing.
    pub keep_aspect: bool,
    /// "left" or "right": the handedness of a map of vectors.
    pub handed: Option<String>,
    /// Replaces the world-to-NDC matrix, row by row.
    pub mndc: Option<[f32; 16]>,
    /// Replaces the cotangent of the field of view.
    pub fovcot: Option<f32>,
    /// Metadata to store.
    pub attributes: Params,
    /// With [`MakeOptions::update`](super::MakeOptions::update), a texture whose `software` differs is made again.
    pub signature: Option<String>,
}

impl Default for FlatOptions {
    fn default() -> Self {
        Self {
            conventions: Conventions::Suite,
            frame: Frame::Display,
            ignore_unassociated: false,
            channels: None,
            channel_names: Vec::new(),
            drop_opaque: false,
            drop_equal: false,
            levels: true,
            level_files: Vec::new(),
            neighbours: Vec::new(),
            filter: None,
            sharpen: 0.0,
            compress_highlights: false,
            probe: false,
            bump: None,
            distribution: None,
            average: true,
            prman: false,
            keep_aspect: false,
            handed: None,
            mndc: None,
            fovcot: None,
            attributes: Params::new(),
            signature: None,
        }
    }
}

impl FlatOptions {
    /// True by the conventions of OpenImageIO.
    pub(crate) fn is_peer(&self) -> bool {
        self.conventions == Conventions::OpenImageIo
    }

    /// True when the image has to be processed as a whole. Metadata alone can be stored with any texture.
    pub(crate) fn needs_whole(&self) -> bool {
        let metadata = Self {
            average: self.average,
            handed: self.handed.clone(),
            mndc: self.mndc,
            fovcot: self.fovcot,
            attributes: self.attributes.clone(),
            signature: self.signature.clone(),
            ..Self::default()
        };
        *self != metadata
    }
}
