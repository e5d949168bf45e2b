//! The command line options.

use crate::colors::ColorArgs;
use crate::request::{Manner, Request};
use crate::shared::{ImageArgs, RunArgs, pixel_type, threads, wrap};
use clap::Parser;
use granita_base::{Environment, Filter};
use granita_image::PixelType;
use granita_texture::Wrap;
use granita_texture::make::{BrokenValues, Kernel, LevelFilter, MakeOptions, Mode};
use std::path::PathBuf;

/// Converts images to tiled, MIP-mapped textures, environment maps and shadow maps.
///
/// Without a mode option, one image becomes a plain texture.
#[derive(Parser, Debug)]
#[command(name = "maketx")]
pub(crate) struct Args {
    /// Input files: one, or six (px nx py ny pz nz) for -envcube and -shadcube. Or any number, each of which becomes a
    /// texture: -o is then a folder, or absent
    #[arg(required = true, value_name = "FILE")]
    pub(crate) inputs: Vec<String>,

    /// The texture, or the folder of textures [default: the input's name with .tx]
    #[arg(short = 'o', value_name = "FILE", allow_hyphen_values = true)]
    pub(crate) output: Option<PathBuf>,

    #[command(flatten)]
    mode: ModeArgs,

    /// Keep the resolution of the input instead of rounding it up to powers of two
    #[arg(long)]
    noresize: bool,

    /// Search path of the inputs: folders, separated by colons
    #[arg(short = 'p', value_name = "SEARCHPATH", allow_hyphen_values = true)]
    pub(crate) path: Option<String>,

    /// Width and height of tiles in texels
    #[arg(long, default_value_t = 64, value_name = "T", value_parser = clap::value_parser!(u32).range(1..=8192))]
    tilesize: u32,

    /// Gamma of the inputs, which were raised to the power 1/G
    #[arg(long, default_value_t = 1.0, value_name = "G")]
    ingamma: f32,

    /// Gamma of the texture, which is raised to the power 1/G
    #[arg(long, default_value_t = 1.0, value_name = "G")]
    outgamma: f32,

    /// Default wrap mode in s: periodic, black, clamp or mirror
    #[arg(long, value_parser = wrap, value_name = "WRAPMODE")]
    smode: Option<Wrap>,

    /// Default wrap mode in t
    #[arg(long, value_parser = wrap, value_name = "WRAPMODE")]
    tmode: Option<Wrap>,

    /// Default wrap mode in both directions [default: black]
    #[arg(long = "mode", value_parser = wrap, value_name = "WRAPMODE")]
    both: Option<Wrap>,

    /// Field of view of the faces of -envcube, in degrees
    #[arg(long, default_value_t = 90.0, value_name = "ANGLE")]
    fov: f32,

    /// Depth range within which opaque depths of -volshad are one surface
    #[arg(long, default_value_t = 0.05, value_name = "F")]
    opaquewidth: f32,

    /// Filter of MIP levels: gaussian, box, triangle, catmull-rom, sinc, blackman-harris, mitchell, b-spline, or one of
    /// OpenImageIO's other filters, such as lanczos3
    #[arg(long, value_parser = filter, default_value = "box", value_name = "NAME")]
    filter: LevelChoice,

    /// Type of the texels: uint8, uint16, half or float [default: that of the input]
    #[arg(short = 'd', value_name = "TYPE", value_parser = pixel_type)]
    pixel_type: Option<PixelType>,

    #[command(flatten)]
    colors: ColorArgs,

    /// Refuse inputs with values that are not finite numbers
    #[arg(long, conflicts_with = "fixnan")]
    checknan: bool,

    /// Replace values that are not finite numbers by the mean of their neighbours
    #[arg(long)]
    fixnan: bool,

    /// For the images of a set (name.<UDIM>.exr): filters of levels use texels of the neighbouring images
    #[arg(long)]
    seams: bool,

    /// Store a hash of the pixels and their mean in the metadata
    #[arg(long)]
    hash: bool,

    /// Number of threads [default: one per core]
    #[arg(long, value_name = "N", value_parser = threads)]
    pub(crate) threads: Option<usize>,

    /// Print the time and the memory of each texture
    #[arg(long)]
    pub(crate) stats: bool,

    /// 0: errors only; 1: also warnings; 2: also progress
    #[arg(long, default_value_t = 1, value_name = "N")]
    verbosity: u8,

    /// Print progress, as -verbosity 2
    #[arg(short = 'v')]
    verbose: bool,

    /// Options of another program: oiio for OpenImageIO's maketx, txmake for RenderMan's; the manual lists them
    #[arg(long, default_value = "granita", value_name = "NAME", value_parser = ["granita", "oiio", "txmake"])]
    profile: String,

    #[command(flatten)]
    pub(crate) image: ImageArgs,

    #[command(flatten)]
    run: RunArgs,
}

/// What to make; at most one.
#[derive(clap::Args, Debug)]
#[group(multiple = false)]
struct ModeArgs {
    /// Cube-face environment map from six images, or from one latitude-longitude map
    #[arg(long)]
    envcube: bool,

    /// Latitude-longitude environment map from one, from six faces, or from a cube-face environment map
    #[arg(long)]
    envlatl: bool,

    /// Cube-face environment map from a light probe (angular map)
    #[arg(long)]
    lightprobe: bool,

    /// Cube-face environment map from a vertical cross
    #[arg(long)]
    vertcross: bool,

    /// Shadow map from a depth map
    #[arg(long)]
    shadow: bool,

    /// Cube-face shadow map from six depth maps; - is an empty one
    #[arg(long)]
    shadcube: bool,

    /// Volume shadow map from a volume depth map
    #[arg(long)]
    volshad: bool,
}

impl ModeArgs {
    fn mode(&self) -> Mode {
        let given = [
            (self.envcube, Mode::EnvCube),
            (self.envlatl, Mode::EnvLatLong),
            (self.lightprobe, Mode::LightProbe),
            (self.vertcross, Mode::VertCross),
            (self.shadow, Mode::Shadow),
            (self.shadcube, Mode::ShadCube),
            (self.volshad, Mode::VolShad),
        ];
        given.into_iter().find(|(set, _)| *set).map_or(Mode::Plain, |(_, mode)| mode)
    }
}

/// A filter of levels.
#[derive(Clone, Debug, PartialEq)]
enum LevelChoice {
    /// A filter of the suite.
    Own(Filter),
    /// One by the definition of OpenImageIO.
    Other(LevelFilter),
}

fn filter(text: &str) -> Result<LevelChoice, String> {
    if let Some(filter) = Filter::from_word(text) {
        return Ok(LevelChoice::Own(filter));
    }
    LevelFilter::from_word(text).map(LevelChoice::Other).ok_or_else(|| {
        let own = Filter::ALL.map(Filter::word);
        let names = Kernel::NAMES.iter().map(|(name, _)| *name).filter(|name| !own.contains(name));
        format!("a filter is one of {}", own.into_iter().chain(names).collect::<Vec<_>>().join(", "))
    })
}

impl Args {
    /// Returns the verbosity. `-v` means `-verbosity 2`.
    pub(crate) fn verbosity(&self) -> u8 {
        if self.verbose { self.verbosity.max(2) } else { self.verbosity }
    }

    /// Returns the request.
    ///
    /// # Errors
    /// Returns an error when options do not go together.
    pub(crate) fn request(
        self,
        environment: &Environment,
        installed_bytes: Option<u64>,
    ) -> Result<Request, String> {
        let mut options = self.options(installed_bytes)?;
        options.color_convert = self.colors.convert(environment, self.run.rules(), false)?;
        Ok(Request {
            manner: Manner::Suite,
            format_given: self.image.format.is_some(),
            newer: false,
            seams: self.seams,
            threads: self.threads,
            stats: self.stats,
            verbosity: self.verbosity(),
            inputs: self.inputs,
            output: self.output,
            path: self.path,
            run: self.run,
            options,
        })
    }

    /// Returns the options of the library, on a machine with so much memory.
    ///
    /// # Errors
    /// Returns an error when options do not go together.
    pub(crate) fn options(&self, installed_bytes: Option<u64>) -> Result<MakeOptions, String> {
        let black = self.both.unwrap_or_default();
        let mut options = MakeOptions {
            mode: self.mode.mode(),
            resize: !self.noresize,
            tile_size: (self.tilesize, self.tilesize),
            ingamma: self.ingamma,
            outgamma: self.outgamma,
            swrap: self.smode.unwrap_or(black),
            twrap: self.tmode.unwrap_or(black),
            fov_deg: self.fov,
            opaque_width: self.opaquewidth,
            pixel_type: self.pixel_type,
            broken_values: match (self.checknan, self.fixnan) {
                (true, _) => BrokenValues::Refuse,
                (_, true) => BrokenValues::Fix,
                _ => BrokenValues::Replace,
            },
            hash: self.hash,
            memory_bytes: self.run.memory_bytes(installed_bytes),
            ..MakeOptions::default()
        };
        match &self.filter {
            LevelChoice::Own(filter) => options.filter = *filter,
            LevelChoice::Other(filter) => options.flat.filter = Some(filter.clone()),
        }
        self.image.fill(&mut options);
        Ok(options)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn args(line: &str) -> Args {
        Args::try_parse_from(line.split(' ')).unwrap()
    }

    #[test]
    fn options_of_the_reference_are_parsed() {
        let a = args("maketx --envcube --fov 100 a b c d e f -o x --mode clamp --tmode mirror --tilesize 32");
        let o = a.options(None).unwrap();
        assert_eq!((o.mode, o.fov_deg, a.inputs.len()), (Mode::EnvCube, 100.0, 6));
        assert_eq!((o.swrap, o.twrap, o.tile_size), (Wrap::Clamp, Wrap::Mirror, (32, 32)));
        assert!(o.resize && !o.update && !o.separate);
        let a = args(
            "maketx --shadcube - - b - e - -o x -u --separate --noresize --Mcamera 1 0 0 0 0 1 0 0 0 0 1 0 0 0 -5 1",
        );
        let o = a.options(None).unwrap();
        assert_eq!(a.inputs, ["-", "-", "b", "-", "e", "-"]);
        assert_eq!(o.mcamera.unwrap()[14], -5.0);
        assert!(!o.resize && o.update && o.separate && o.mscreen.is_none());
        let a = args(
            "maketx --shadow a -o x --Mscreen -1 -4.37114e-08 -.5 +2 0 1 0 0 0 0 -1E+1 0 -0 0 -5e-1 1 --Mcamera 1 0 0 0 0 1 0 0 0 0 1 0 0 0 -5 1",
        );
        let o = a.options(None).unwrap();
        assert_eq!(o.mscreen.unwrap()[..4], [-1.0, -4.37114e-8, -0.5, 2.0]);
        assert_eq!(
            (o.mscreen.unwrap()[10], o.mscreen.unwrap()[14], o.mcamera.unwrap()[14]),
            (-10.0, -0.5, -5.0)
        );
        let few = Args::try_parse_from("maketx a -o x --Mscreen 1 2 3".split(' '));
        assert!(few.unwrap_err().to_string().contains("16 values"));
        assert_eq!(args("maketx a.tif -o a.tx").options(None).unwrap(), MakeOptions::default());
    }

    #[test]
    fn conflicting_options_are_refused() {
        assert!(Args::try_parse_from("maketx --shadow --envlatl a -o b".split(' ')).is_err());
        assert!(Args::try_parse_from("maketx --mode round a -o b".split(' ')).is_err());
        assert!(Args::try_parse_from("maketx --checknan --fixnan a -o b".split(' ')).is_err());
        assert!(Args::try_parse_from("maketx".split(' ')).is_err());
    }

    #[test]
    fn further_options_are_parsed() {
        let a = args(
            "maketx -d half --colorconvert sRGB acescg --fixnan --hash --threads 3 --memory 100 -v --stats a -o b",
        );
        assert_eq!((a.threads, a.verbosity(), a.stats), (Some(3), 2, true));
        let o = a.options(Some(1 << 40)).unwrap();
        assert_eq!((o.pixel_type, o.memory_bytes), (Some(PixelType::Half), 100 << 20));
        assert!(o.hash && o.broken_values == BrokenValues::Fix && !o.constant_color);
        assert_eq!(args("maketx a -o b").options(Some(8 << 30)).unwrap().memory_bytes, 2 << 30);
        for wrong in ["-d int8", "--threads 0", "--memory 0"] {
            assert!(Args::try_parse_from(format!("maketx {wrong} a -o b").split(' ')).is_err(), "{wrong}");
        }
    }
}
