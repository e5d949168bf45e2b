//! The options that several profiles have, and the values of options.

use clap::ArgAction;
use granita_base::{BaseType, Param, ParamData, ParamType, Params};
use granita_image::PixelType;
use granita_plugin::PluginRules;
use granita_texture::Wrap;
use granita_texture::make::{
    Bump, BumpFormat, Distribution, FlatOptions, Frame, MakeOptions, NormalRange, SlopeFilter,
};
use std::path::PathBuf;

/// The options of images and textures that the profiles `granita` and `oiio` share.
#[derive(clap::Args, Debug)]
pub(crate) struct ImageArgs {
    /// Format of the texture; it must store tiles and MIP levels [default: that of the extension of -o if it does, else
    /// tiff]
    #[arg(long, value_name = "NAME")]
    pub(crate) format: Option<String>,

    /// Compression, by its name in the format; zip:LEVEL from 1 (fast) to 12 (small files) [default: zip]
    #[arg(long, value_name = "NAME")]
    compression: Option<String>,

    /// Update: skip an output that has the time stamp of its newest input; others get that time stamp
    #[arg(short = 'u')]
    update: bool,

    /// Store channels one after the other instead of interleaved
    #[arg(long)]
    separate: bool,

    /// World-to-camera matrix, 16 numbers row by row
    #[arg(long = "Mcamera", num_args = 16, value_name = "M", allow_hyphen_values = true)]
    mcamera: Option<Vec<f32>>,

    /// World-to-screen matrix, 16 numbers row by row
    #[arg(long = "Mscreen", num_args = 16, value_name = "M", allow_hyphen_values = true)]
    mscreen: Option<Vec<f32>>,

    /// World-to-NDC matrix, 16 numbers row by row
    #[arg(long = "MNDC", num_args = 16, value_name = "M", allow_hyphen_values = true)]
    mndc: Option<Vec<f32>>,

    /// Cotangent of the field of view to store
    #[arg(long, value_name = "F", allow_negative_numbers = true)]
    fovcot: Option<f32>,

    /// Number of channels; missing ones are 0 [default: that of the input]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1024))]
    nchannels: Option<u32>,

    /// Names of the channels, separated by commas; an empty name keeps that of the input
    #[arg(long, value_name = "NAMES")]
    chnames: Option<String>,

    /// Make the first level only
    #[arg(long)]
    nomipmap: bool,

    /// A file that is the next level instead of one that is computed; may be repeated
    #[arg(long, value_name = "FILE")]
    mipimage: Vec<PathBuf>,

    /// Make a texture of all pixels of the file, not of its display window
    #[arg(long)]
    fullpixels: bool,

    /// Sharpen each level by an unsharp mask of this strength
    #[arg(long, default_value_t = 0.0, value_name = "F")]
    sharpen: f32,

    /// Compress highlights while levels are filtered
    #[arg(long)]
    hicomp: bool,

    /// Store an image of one colour as one tile
    #[arg(long = "constant-color-detect", visible_alias = "constant")]
    constant: bool,

    /// Store an image of three equal channels as one channel
    #[arg(long = "monochrome-detect")]
    monochrome: bool,

    /// Leave out an alpha channel that is 1 everywhere
    #[arg(long = "opaque-detect")]
    opaque: bool,

    /// Do not multiply colours by alpha where the input says that they are not
    #[arg(long = "ignore-unassoc")]
    ignore_unassociated: bool,

    /// Metadata to store; a whole number becomes an int, another number a float; may be repeated
    #[arg(long, num_args = 2, value_names = ["NAME", "VALUE"], action = ArgAction::Append, allow_hyphen_values = true)]
    attrib: Vec<String>,

    /// Text to store in the metadata; may be repeated
    #[arg(long, num_args = 2, value_names = ["NAME", "TEXT"], action = ArgAction::Append, allow_hyphen_values = true)]
    sattrib: Vec<String>,

    /// Texture of height, slopes and products of slopes, from heights or from a normal map
    #[arg(long)]
    pub(crate) bumpslopes: bool,

    /// Input of -bumpslopes: height, normal or auto, which takes three different channels for a normal
    #[arg(long, default_value = "auto", value_name = "NAME", value_parser = bump_format)]
    bumpformat: BumpFormat,

    /// Factor of the slopes
    #[arg(long, default_value_t = 1.0, value_name = "F", allow_negative_numbers = true)]
    bumpscale: f32,

    /// Negate the slopes in s
    #[arg(long)]
    bumpinverts: bool,

    /// Negate the slopes in t
    #[arg(long)]
    bumpinvertt: bool,

    /// Range of a normal map: centered (-1 to 1), positive (0 to 1) or auto, by the presence of negative values
    #[arg(long, default_value = "auto", value_name = "NAME", value_parser = normal_range)]
    bumprange: NormalRange,

    /// Filter of slopes of heights: sobel or centraldiff
    #[arg(long, default_value = "sobel", value_name = "NAME", value_parser = slope_filter)]
    slopefilter: SlopeFilter,

    /// Slopes of heights per unit of texture coordinates, divided by F; 0: per texel
    #[arg(long = "uvslopes_scale", default_value_t = 0.0, value_name = "F")]
    uv_scale: f32,

    /// Handedness of a map of vectors to store: left or right
    #[arg(long, value_name = "NAME", value_parser = ["left", "right", ""])]
    handed: Option<String>,

    /// Store tables of the distribution of the values (OpenEXR only)
    #[arg(long)]
    cdf: bool,

    /// Standard deviation of the Gaussian of -cdf
    #[arg(long, default_value_t = 1.0 / 6.0, value_name = "F")]
    cdfsigma: f32,

    /// The tables of -cdf have 2^N entries
    #[arg(long, default_value_t = 8, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=20))]
    cdfbits: u32,
}

/// The options of the program, which do not change a texture.
#[derive(clap::Args, Debug)]
pub(crate) struct RunArgs {
    /// Memory limit of one texture in MiB, where its memory grows with the image [default: a quarter of the installed
    /// memory]
    #[arg(long, value_name = "MB", value_parser = clap::value_parser!(u64).range(1..))]
    memory: Option<u64>,

    /// A folder of image plugins, or a library, which is used before bundled ones; may be repeated
    #[arg(long, value_name = "PATH")]
    pub(crate) plugins: Vec<PathBuf>,

    /// For untrusted images: load no plugins, read below the folders of the inputs only
    #[arg(long)]
    pub(crate) safe: bool,

    /// Do not have the kernel enforce -safe as well
    #[arg(long, hide = true, requires = "safe")]
    pub(crate) nofence: bool,

    /// Print the available image formats and their sources
    #[arg(long)]
    pub(crate) debugdso: bool,
}

impl RunArgs {
    /// Returns the rules for plugins.
    pub(crate) fn rules(&self) -> PluginRules {
        PluginRules { none: self.safe, named: self.plugins.clone(), ..PluginRules::default() }
    }

    /// Returns the memory limit of one texture in bytes, on a machine with so much memory.
    pub(crate) fn memory_bytes(&self, installed_bytes: Option<u64>) -> u64 {
        match (self.memory, installed_bytes) {
            (Some(mib), _) => mib.saturating_mul(1 << 20),
            (None, Some(installed)) => installed / 4,
            (None, None) => MakeOptions::default().memory_bytes,
        }
    }
}

/// Returns 16 numbers as a matrix.
fn matrix(numbers: &Option<Vec<f32>>) -> Option<[f32; 16]> {
    numbers.as_deref().and_then(|m| m.try_into().ok())
}

/// Returns metadata of one value.
pub(crate) fn value(name: &str, base: BaseType, data: ParamData) -> Param {
    Param { name: name.into(), ty: ParamType::of(base), data }
}

impl ImageArgs {
    /// Returns the metadata that options name. The types of `-attrib` follow from the values.
    fn attributes(&self) -> Params {
        let mut all = Params::new();
        for pair in self.sattrib.chunks_exact(2) {
            all.set(value(&pair[0], BaseType::String, pair[1].as_str().into()));
        }
        for pair in self.attrib.chunks_exact(2) {
            let (name, text) = (&pair[0], pair[1].trim());
            all.set(if let Ok(int) = text.parse::<i32>() {
                value(name, BaseType::Int, int.into())
            } else if let Some(float) = text.parse::<f32>().ok().filter(|v| v.is_finite()) {
                value(name, BaseType::Float, float.into())
            } else {
                value(name, BaseType::String, pair[1].as_str().into())
            });
        }
        all
    }

    /// Sets the options of the library that these options name.
    pub(crate) fn fill(&self, options: &mut MakeOptions) {
        if let Some(format) = &self.format {
            options.format.clone_from(format);
        }
        options.compression.clone_from(&self.compression);
        options.update = self.update;
        options.separate = self.separate;
        options.mcamera = matrix(&self.mcamera);
        options.mscreen = matrix(&self.mscreen);
        options.constant_color = self.constant;
        let names = self.chnames.as_deref().map(|names| names.split(',').map(str::to_owned).collect());
        options.flat = FlatOptions {
            frame: if self.fullpixels { Frame::Data } else { options.flat.frame },
            ignore_unassociated: self.ignore_unassociated,
            channels: self.nchannels.map(|n| n as usize),
            channel_names: names.unwrap_or_default(),
            drop_opaque: self.opaque,
            drop_equal: self.monochrome,
            levels: !self.nomipmap,
            level_files: self.mipimage.clone(),
            sharpen: self.sharpen,
            compress_highlights: self.hicomp,
            bump: self.bumpslopes.then_some(Bump {
                format: self.bumpformat,
                range: self.bumprange,
                filter: self.slopefilter,
                scale: self.bumpscale,
                invert_s: self.bumpinverts,
                invert_t: self.bumpinvertt,
                uv_scale: self.uv_scale,
            }),
            distribution: self.cdf.then_some(Distribution { sigma: self.cdfsigma, bits: self.cdfbits }),
            handed: self.handed.clone().filter(|text| !text.is_empty()),
            mndc: matrix(&self.mndc),
            fovcot: self.fovcot.filter(|f| *f != 0.0),
            attributes: self.attributes(),
            ..options.flat.clone()
        };
    }
}

fn bump_format(text: &str) -> Result<BumpFormat, String> {
    Ok(match &*text.to_ascii_lowercase() {
        "auto" => BumpFormat::Auto,
        "height" => BumpFormat::Height,
        "normal" => BumpFormat::Normal,
        _ => return Err("a format is height, normal or auto".to_owned()),
    })
}

fn normal_range(text: &str) -> Result<NormalRange, String> {
    Ok(match &*text.to_ascii_lowercase() {
        "auto" => NormalRange::Auto,
        "centered" => NormalRange::Centered,
        "positive" => NormalRange::Positive,
        _ => return Err("a range is centered, positive or auto".to_owned()),
    })
}

fn slope_filter(text: &str) -> Result<SlopeFilter, String> {
    Ok(match &*text.to_ascii_lowercase() {
        "sobel" => SlopeFilter::Sobel,
        "centraldiff" => SlopeFilter::CentralDifference,
        _ => return Err("a filter of slopes is sobel or centraldiff".to_owned()),
    })
}

/// Parses a wrap mode.
pub(crate) fn wrap(text: &str) -> Result<Wrap, String> {
    Wrap::from_word(text).ok_or_else(|| "a wrap mode is periodic, black, clamp or mirror".to_owned())
}

/// Parses a type of texels.
pub(crate) fn pixel_type(text: &str) -> Result<PixelType, String> {
    Ok(match text.to_ascii_lowercase().as_str() {
        "uint8" | "byte" => PixelType::U8,
        "uint16" | "short" => PixelType::U16,
        "half" => PixelType::Half,
        "float" => PixelType::Float,
        _ => return Err("a type is uint8, uint16, half or float".to_owned()),
    })
}

/// Parses a number of threads.
pub(crate) fn threads(text: &str) -> Result<usize, String> {
    match text.parse() {
        Ok(n @ 1..=1024) => Ok(n),
        _ => Err("1 to 1024 threads are possible".to_owned()),
    }
}
