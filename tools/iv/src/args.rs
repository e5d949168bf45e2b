//! The command line options.

use clap::Parser;
use granita_view::{Background, Channels, ColorMap, CompareOptions, Display, FalseColor};
use std::path::PathBuf;

/// Shows images of all formats of the suite, in a window or as text.
///
/// FILE#2 is the third image of a file.
#[derive(Parser, Debug)]
#[command(name = "iv")]
pub(crate) struct Args {
    /// Images, or folders of images
    #[arg(value_name = "FILE")]
    pub(crate) files: Vec<PathBuf>,

    /// A folder of image plugins, or a library, which is used before bundled ones; may be repeated
    #[arg(long, value_name = "PATH")]
    pub(crate) plugins: Vec<PathBuf>,

    /// Print every library that is tried
    #[arg(long)]
    pub(crate) debugdso: bool,

    /// Print the contents of the files
    #[arg(long, help_heading = "Without a window", group = "still")]
    pub(crate) info: bool,

    /// Print the statistics of each channel: minimum, maximum, mean, deviation, number of values that are not numbers
    #[arg(long, help_heading = "Without a window", group = "still")]
    pub(crate) stats: bool,

    /// Print the difference of two files; exit status 0: within the given limits (without limits: equal), 1: beyond
    /// them, 2: they cannot be compared
    #[arg(long, help_heading = "Without a window", group = "still")]
    pub(crate) compare: bool,

    /// Print the image formats of this build: names, extensions, and what is read and written
    #[arg(long, help_heading = "Without a window", group = "still")]
    pub(crate) formats: bool,

    /// Print the output of -info, -stats, -compare or -formats as JSON
    #[arg(long, help_heading = "Without a window", requires = "still", conflicts_with_all = ["thumbnail", "ascii"])]
    pub(crate) json: bool,

    /// Write a small image, in the format of its extension; for several files, into the folder of that name
    #[arg(long, value_name = "FILE", help_heading = "Without a window", group = "still")]
    pub(crate) thumbnail: Option<PathBuf>,

    /// Print the image as characters
    #[arg(long, help_heading = "Without a window", group = "still")]
    pub(crate) ascii: bool,

    /// Longest side of -thumbnail in pixels
    #[arg(long, default_value_t = 256, value_name = "N", help_heading = "Without a window",
          value_parser = clap::value_parser!(u32).range(1..=16384))]
    pub(crate) size: u32,

    /// Width of -ascii in characters [default: COLUMNS, or 80]
    #[arg(long, value_name = "N", help_heading = "Without a window",
          value_parser = clap::value_parser!(u32).range(1..=4096))]
    pub(crate) width: Option<u32>,

    /// Print -ascii in colours
    #[arg(long, help_heading = "Without a window")]
    pub(crate) color: bool,

    #[command(flatten)]
    pub(crate) limits: CompareArgs,

    #[command(flatten)]
    pub(crate) look: LookArgs,

    #[command(flatten)]
    pub(crate) window: WindowArgs,

    #[command(flatten)]
    pub(crate) net: crate::listen::NetArgs,
}

/// The limits within which two images are equal.
#[derive(clap::Args, Debug)]
pub(crate) struct CompareArgs {
    /// Largest difference of values
    #[arg(long, value_name = "D", help_heading = "Comparing", allow_negative_numbers = true)]
    pub(crate) fail: Option<f32>,

    /// Largest share of pixels that differ by more than -fail, in percent
    #[arg(long, value_name = "P", help_heading = "Comparing")]
    pub(crate) failpercent: Option<f64>,

    /// Largest root mean square of the differences
    #[arg(long, value_name = "R", help_heading = "Comparing")]
    pub(crate) maxrms: Option<f64>,

    /// Least signal-to-noise ratio, in decibels
    #[arg(long, value_name = "DB", help_heading = "Comparing", allow_negative_numbers = true)]
    pub(crate) minpsnr: Option<f64>,

    /// Largest mean of the perceived difference (FLIP), 0 to 1
    #[arg(long, value_name = "F", help_heading = "Comparing")]
    pub(crate) maxflip: Option<f64>,

    /// Write the differences of the values, |a - b| of each channel, to this image
    #[arg(long, value_name = "FILE", help_heading = "Comparing", requires = "compare")]
    pub(crate) diff: Option<PathBuf>,

    /// Multiply the differences of -diff
    #[arg(long, default_value_t = 1.0, value_name = "S", help_heading = "Comparing", requires = "diff")]
    pub(crate) diffscale: f32,

    /// Write the perceived difference (FLIP) of each pixel to this image
    #[arg(long, value_name = "FILE", help_heading = "Comparing", requires = "compare")]
    pub(crate) flipmap: Option<PathBuf>,

    /// Peak signal of -minpsnr
    #[arg(long, default_value_t = 1.0, value_name = "V", help_heading = "Comparing")]
    pub(crate) peak: f32,
}

/// The conversion of values to colours.
#[derive(clap::Args, Debug)]
pub(crate) struct LookArgs {
    /// Exposure in stops
    #[arg(
        long,
        default_value_t = 0.0,
        value_name = "E",
        help_heading = "Looks",
        allow_negative_numbers = true
    )]
    pub(crate) exposure: f32,

    /// Gamma; exposed values are raised to the power 1/G
    #[arg(long, default_value_t = 1.0, value_name = "G", help_heading = "Looks")]
    pub(crate) gamma: f32,

    /// Show linear values, not encoded for an sRGB screen
    #[arg(long, help_heading = "Looks")]
    pub(crate) linear: bool,

    /// Colour space of the images: a name, an alias or a role of the configuration [default: what each file says]
    #[arg(long, value_name = "NAME", help_heading = "Looks")]
    pub(crate) colorspace: Option<String>,

    /// Configuration of OpenColorIO, a file or ocio://NAME [default: that of $OCIO, else none]
    #[arg(long, value_name = "FILE", help_heading = "Looks")]
    pub(crate) colorconfig: Option<PathBuf>,

    /// Display of the configuration [default: its first one]
    #[arg(long, value_name = "NAME", help_heading = "Looks")]
    pub(crate) display: Option<String>,

    /// View of the display [default: its first one]
    #[arg(long, value_name = "NAME", help_heading = "Looks")]
    pub(crate) view: Option<String>,

    /// Channels: color, r, g, b, a, luminance, or the name of a channel
    #[arg(long, default_value = "color", value_name = "NAME", help_heading = "Looks")]
    pub(crate) channel: String,

    /// Index of the image in the file, from 0
    #[arg(long, default_value_t = 0, value_name = "N", help_heading = "Looks")]
    pub(crate) page: usize,

    /// Layer: its name, or its index from 0
    #[arg(long, value_name = "NAME", help_heading = "Looks")]
    pub(crate) layer: Option<String>,

    /// Show one channel in false colours: helix, spectrum, heat, signed, magma or grey
    #[arg(long, value_name = "MAP", value_parser = map, help_heading = "Looks")]
    pub(crate) falsecolor: Option<ColorMap>,

    /// Values at the ends of -falsecolor, or of black and white
    #[arg(long, num_args = 2, value_names = ["LOW", "HIGH"], help_heading = "Looks", allow_negative_numbers = true)]
    pub(crate) range: Vec<f32>,

    /// Background of images with alpha: none, black, grey, white or checker
    #[arg(long, default_value = "none", value_name = "NAME", value_parser = background, help_heading = "Looks")]
    pub(crate) background: Background,
}

/// Options of the window.
#[derive(clap::Args, Debug)]
pub(crate) struct WindowArgs {
    /// Fill the screen
    #[arg(long, help_heading = "Window")]
    pub(crate) fullscreen: bool,

    /// Size of the window
    #[arg(long, num_args = 2, value_names = ["W", "H"], help_heading = "Window",
          value_parser = clap::value_parser!(u32).range(64..=16384))]
    pub(crate) window: Vec<u32>,

    /// Memory for tiles of images that are not visible, in MiB
    #[arg(long, default_value_t = 256, value_name = "MB", help_heading = "Window")]
    pub(crate) memory: u64,

    /// Graphics interface of the window: auto, vulkan, gl
    #[arg(long, default_value = "auto", value_name = "NAME", help_heading = "Window",
          value_parser = ["auto", "vulkan", "gl"])]
    pub(crate) renderer: String,

    /// Do what a file says, line by line, and tell on standard output
    #[arg(long, value_name = "FILE", hide = true)]
    pub(crate) script: Option<PathBuf>,
}

fn map(text: &str) -> Result<ColorMap, String> {
    ColorMap::from_word(text)
        .ok_or_else(|| format!("a map is one of {}", ColorMap::ALL.map(ColorMap::word).join(", ")))
}

fn background(text: &str) -> Result<Background, String> {
    Ok(match text.to_ascii_lowercase().as_str() {
        "none" => Background::Ignored,
        "black" => Background::Black,
        "grey" | "gray" => Background::Grey,
        "white" => Background::White,
        "checker" => Background::Checker,
        _ => return Err("a background is none, black, grey, white or checker".to_owned()),
    })
}

impl LookArgs {
    /// Returns the options as a display for an image with channels of these names.
    ///
    /// # Errors
    /// Returns an error when a number is invalid or there is no such channel.
    pub(crate) fn display(&self, names: &[String]) -> Result<Display, String> {
        if !(self.gamma.is_finite() && self.gamma > 0.0) {
            return Err(format!("-gamma is {}, it must be above 0", self.gamma));
        }
        if !self.exposure.is_finite() {
            return Err(format!("-exposure is {}", self.exposure));
        }
        let channels = match self.channel.to_ascii_lowercase().as_str() {
            "color" | "colour" => Channels::Color,
            "luminance" => Channels::Luminance,
            lower => match names.iter().position(|n| *n == self.channel) {
                Some(c) => Channels::One(c),
                None => match lower {
                    "r" => Channels::Red,
                    "g" => Channels::Green,
                    "b" => Channels::Blue,
                    "a" => Channels::Alpha,
                    _ => {
                        return Err(format!(
                            "there is no channel \"{}\", only {}",
                            self.channel,
                            names.join(" ")
                        ));
                    }
                },
            },
        };
        let range = match self.range[..] {
            [low, high] if low == high || !low.is_finite() || !high.is_finite() => {
                return Err(format!("-range {low} {high} is none"));
            }
            [low, high] => Some((low, high)),
            _ => None,
        };
        let (low, high) = range.unwrap_or((0.0, 1.0));
        let false_color = self.falsecolor.map(|map| FalseColor { map, low, high, log: false });
        Ok(Display {
            exposure: self.exposure,
            gamma: self.gamma,
            srgb: !self.linear,
            channels,
            false_color,
            range: range.filter(|_| false_color.is_none()),
            background: self.background,
            ..Display::default()
        })
    }
}

impl CompareArgs {
    /// Returns the limits as options of the library. `exposure` is in stops.
    pub(crate) fn options(&self, exposure: f32) -> CompareOptions {
        CompareOptions {
            tolerance: self.fail.unwrap_or(0.0),
            peak: self.peak,
            exposure,
            ..CompareOptions::default()
        }
    }
}
