//! The profile `oiio`: the options and the defaults of OpenImageIO's `maketx`.

use crate::colors::ColorArgs;
use crate::request::{Manner, Request};
use crate::shared::{ImageArgs, RunArgs, pixel_type, value, wrap};
use clap::Parser;
use granita_base::{BaseType, Environment};
use granita_image::PixelType;
use granita_texture::Wrap;
use granita_texture::make::{
    BrokenValues, Conventions, FlatOptions, Frame, Kernel, LevelFilter, MakeOptions, Mode,
};
use sha1::{Digest, Sha1};
use std::ffi::OsString;
use std::path::PathBuf;

/// Converts images to tiled, MIP-mapped textures, with the options and the defaults of OpenImageIO's maketx.
#[derive(Parser, Debug)]
#[command(name = "oiio-maketx")]
pub(crate) struct OiioArgs {
    /// Input files, each of which becomes a texture
    #[arg(value_name = "FILE")]
    pub(crate) inputs: Vec<String>,

    /// The texture, or the folder of textures [default: the input's name with .tx]
    #[arg(short = 'o', value_name = "FILE", allow_hyphen_values = true)]
    output: Option<PathBuf>,

    /// Print what is done
    #[arg(short = 'v')]
    verbose: bool,

    /// Number of threads; 0: one per core
    #[arg(long, default_value_t = 0, value_name = "N", value_parser = clap::value_parser!(u16).range(0..=1024))]
    threads: u16,

    /// Type of the texels: uint8, uint16, half or float [default: that of the input]
    #[arg(short = 'd', value_name = "TYPE")]
    pixel_type: Option<String>,

    /// Width and height of tiles in texels
    #[arg(long, num_args = 2, value_names = ["W", "H"], default_values_t = [64, 64], value_parser = clap::value_parser!(u32).range(1..=8192))]
    tile: Vec<u32>,

    /// Default wrap mode: black, clamp, periodic or mirror
    #[arg(long, value_parser = wrap, default_value = "black", value_name = "MODE")]
    wrap: Wrap,

    /// Default wrap mode in s
    #[arg(long, value_parser = wrap, value_name = "MODE")]
    swrap: Option<Wrap>,

    /// Default wrap mode in t
    #[arg(long, value_parser = wrap, value_name = "MODE")]
    twrap: Option<Wrap>,

    /// Enlarge to powers of two
    #[arg(long)]
    resize: bool,

    /// Store the pixel aspect ratio that the image has before -resize
    #[arg(long)]
    keepaspect: bool,

    /// Filter of MIP levels; the manual lists the names
    #[arg(long, default_value = "box", value_parser = level_filter, value_name = "NAME")]
    filter: LevelFilter,

    /// Refuse inputs with values that are not finite numbers
    #[arg(long)]
    checknan: bool,

    /// Replacement of values that are not finite numbers: none, black, or box3 for the mean of their neighbours
    #[arg(long, default_value = "none", value_name = "NAME", value_parser = ["none", "black", "box3", ""])]
    fixnan: String,

    /// Store the metadata that RenderMan reads
    #[arg(long = "prman-metadata")]
    prman_metadata: bool,

    /// Leave -attrib and -sattrib out of the command line that is stored
    #[arg(long)]
    sansattrib: bool,

    /// Store the command line in the metadata instead of a hash of it
    #[arg(long, overrides_with = "no_history")]
    history: bool,

    /// Store a hash of the command line
    #[arg(long = "no-history", overrides_with = "history")]
    no_history: bool,

    /// Do not store the mean of the pixels
    #[arg(long = "no-compute-average")]
    no_average: bool,

    /// Print the time and the memory of each texture
    #[arg(long)]
    runstats: bool,

    /// Shadow map of an image with one channel
    #[arg(long)]
    shadow: bool,

    /// Latitude-longitude environment map
    #[arg(long)]
    envlatl: bool,

    /// Latitude-longitude environment map from a light probe
    #[arg(long)]
    lightprobe: bool,

    #[command(flatten)]
    colors: ColorArgs,

    /// Tiles, separate channels and metadata as RenderMan expects them
    #[arg(long)]
    prman: bool,

    /// Tiles of 64 x 64 texels and interleaved channels
    #[arg(long)]
    oiio: bool,

    #[command(flatten)]
    image: ImageArgs,

    #[command(flatten)]
    run: RunArgs,
}

fn level_filter(text: &str) -> Result<LevelFilter, String> {
    LevelFilter::from_word(text).ok_or_else(|| {
        let names = Kernel::NAMES.map(|(name, _)| name).join(", ");
        format!("a filter is one of {names}, or unsharp- before one of them, or post- before all")
    })
}

/// Returns the words of a command line as one text. Words with spaces are quoted.
fn command_line(words: &[OsString], without_attributes: bool) -> String {
    let mut out: Vec<String> = Vec::new();
    let mut words = words.iter().map(|word| word.to_string_lossy());
    while let Some(word) = words.next() {
        let option = word.strip_prefix('-').map(|rest| rest.trim_start_matches('-'));
        match option {
            Some("attrib" | "sattrib") if without_attributes => {
                words.nth(1);
            }
            Some("sansattrib") if without_attributes => {}
            _ => {
                let text: String = word.chars().flat_map(char::escape_default).collect();
                out.push(if text.contains(' ') { format!("\"{text}\"") } else { text });
            }
        }
    }
    out.join(" ")
}

impl OiioArgs {
    /// Returns the text that the metadata contain about the program and its command line.
    fn signature(&self, words: &[OsString], environment: &Environment) -> String {
        let line = command_line(words, self.sansattrib);
        let variable = environment.get("OPENIMAGEIO_METADATA_HISTORY");
        let set = variable.is_some_and(|text| text.trim().parse::<i32>().is_ok_and(|n| n != 0));
        let text = if self.history || (set && !self.no_history) {
            line
        } else {
            Sha1::digest(line).iter().map(|byte| format!("{byte:02X}")).collect()
        };
        // OpenImageIO ignores the hash of the pixels where the program has another name.
        format!("maketx (Granita {}) : {text}", granita_cli::SUITE_VERSION)
    }

    /// Returns the mode.
    fn mode(&self) -> Result<Mode, String> {
        let given = [self.shadow, self.envlatl, self.lightprobe, self.image.bumpslopes];
        if given.iter().filter(|set| **set).count() > 1 {
            return Err(
                "at most one of --shadow, --envlatl, --lightprobe and --bumpslopes is possible".to_owned()
            );
        }
        Ok(match (self.shadow, self.envlatl || self.lightprobe) {
            (true, _) => Mode::Shadow,
            (_, true) => Mode::EnvLatLong,
            _ => Mode::Plain,
        })
    }

    /// Returns the request. `words` are the command line.
    ///
    /// # Errors
    /// Returns a message when options do not go together, or are not supported.
    pub(crate) fn request(
        self,
        words: &[OsString],
        environment: &Environment,
        installed_bytes: Option<u64>,
    ) -> Result<Request, String> {
        if self.prman && self.oiio {
            return Err("--prman and --oiio exclude each other; --prman is readable for both".to_owned());
        }
        let pixel_type = self.pixel_type.as_deref().map(texel_type).transpose()?;
        let preset_tile = (64, 64);
        let prman = self.prman || self.prman_metadata;
        let mut options = MakeOptions {
            mode: self.mode()?,
            resize: self.resize,
            tile_size: if self.oiio { preset_tile } else { (self.tile[0], self.tile[1]) },
            swrap: self.swrap.unwrap_or(self.wrap),
            twrap: self.twrap.unwrap_or(self.wrap),
            pixel_type,
            broken_values: match (&*self.fixnan, self.checknan) {
                ("black", _) => BrokenValues::Black,
                ("box3", _) => BrokenValues::Fix,
                (_, true) => BrokenValues::Refuse,
                _ => BrokenValues::Keep,
            },
            memory_bytes: self.run.memory_bytes(installed_bytes),
            flat: FlatOptions {
                conventions: Conventions::OpenImageIo,
                frame: Frame::Both,
                filter: Some(self.filter.clone()),
                probe: self.lightprobe,
                average: !self.no_average,
                prman: self.prman,
                keep_aspect: self.keepaspect,
                signature: Some(self.signature(words, environment)),
                ..FlatOptions::default()
            },
            ..MakeOptions::default()
        };
        options.color_convert = self.colors.convert(environment, self.run.rules(), true)?;
        self.image.fill(&mut options);
        if self.oiio {
            options.separate = false;
        }
        if prman {
            let kind = match options.mode {
                Mode::Shadow => "Shadow",
                Mode::EnvLatLong => "LatLong Environment",
                _ => "Plain Texture",
            };
            options.flat.attributes.set(value("PixarTextureFormat", BaseType::String, kind.into()));
        }
        Ok(Request {
            manner: Manner::OpenImageIo,
            inputs: self.inputs,
            output: self.output,
            format_given: self.image.format.is_some(),
            path: None,
            newer: false,
            seams: false,
            threads: (self.threads > 0).then_some(self.threads.into()),
            stats: self.runstats,
            verbosity: if self.verbose { 2 } else { 1 },
            run: self.run,
            options,
        })
    }
}

/// Parses a type of texels. The types that the suite does not have are named.
fn texel_type(text: &str) -> Result<PixelType, String> {
    match text {
        "int8" | "sint8" | "int16" | "sint16" | "double" => Err(format!("not supported: -d {text}")),
        "uint8" | "uint16" | "half" | "float" => pixel_type(text),
        _ => Err(format!("unknown data format \"{text}\"")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request(line: &str) -> Result<Request, String> {
        let words: Vec<OsString> = line.split(' ').map(OsString::from).collect();
        let args = OiioArgs::try_parse_from(&words).map_err(|error| error.to_string())?;
        args.request(&words, &Environment::default(), None)
    }

    #[test]
    fn defaults_are_those_of_openimageio() {
        let r = request("oiio-maketx a.png -o a.tx").unwrap();
        let o = &r.options;
        assert!(!o.resize && o.flat.average && o.flat.levels && o.tile_size == (64, 64));
        assert_eq!((o.mode, o.swrap, o.broken_values), (Mode::Plain, Wrap::Black, BrokenValues::Keep));
        assert_eq!(o.flat.filter, Some(LevelFilter::default()));
        assert_eq!((r.threads, r.manner.failed().code()), (None, 1));
        assert!(o.flat.signature.as_ref().is_some_and(|s| s.starts_with("maketx (Granita ") && s.len() > 48));
    }

    #[test]
    fn options_fill_the_job() {
        let r = request(
            "m --tile 32 16 --wrap clamp --twrap periodic --resize --nchannels 2 --chnames U,V --nomipmap \
             --sharpen 0.5 --hicomp --filter post-unsharp-mitchell --fixnan box3 --attrib n 3 --attrib f 0.5 \
             --sattrib s 3 --bumpslopes --bumpscale -2 --cdf --cdfbits 4 --history --threads 2 a b",
        )
        .unwrap();
        let o = &r.options;
        assert_eq!((o.tile_size, o.swrap, o.twrap), ((32, 16), Wrap::Clamp, Wrap::Periodic));
        assert_eq!((o.flat.channels, o.flat.channel_names.join("+")), (Some(2), "U+V".to_owned()));
        assert_eq!((o.flat.bump.unwrap().scale, o.flat.distribution.unwrap().bits), (-2.0, 4));
        assert_eq!((o.flat.attributes.int("n"), o.flat.attributes.float("f")), (Some(3), Some(0.5)));
        assert_eq!(o.flat.attributes.string("s").map(|s| s.to_string()), Some("3".to_owned()));
        assert!(o.flat.signature.as_ref().is_some_and(|s| s.contains(": m --tile 32 16")));
        assert_eq!((r.inputs.len(), r.threads), (2, Some(2)));
    }

    #[test]
    fn what_is_not_supported_is_named_in_one_message() {
        for (line, expected) in [
            ("m --colorconfig c --colorconvert a b x", "-colorconfig: c: "),
            ("m --colorconvert srgb pink x", "has no colour space \"pink\""),
            ("m -d sint16 x", "not supported: -d sint16"),
            ("m --prman --oiio x", "exclude each other"),
            ("m --shadow --envlatl x", "at most one"),
            ("m --filter round x", "a filter is one of box, triangle"),
        ] {
            let Err(what) = request(line) else { panic!("{line}") };
            assert!(what.contains(expected), "{what}");
        }
    }

    #[test]
    fn command_lines_are_stored_without_attributes() {
        let words: Vec<OsString> =
            ["m", "--sattrib", "a", "b c", "-sansattrib", "x y.png"].map(OsString::from).to_vec();
        assert_eq!(command_line(&words, true), "m \"x y.png\"");
        assert_eq!(command_line(&words, false), "m --sattrib a \"b c\" -sansattrib \"x y.png\"");
    }
}
