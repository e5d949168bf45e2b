//! `maketx`: turns pictures into textures, environment maps and shadow maps (reference 9.1).

#![forbid(unsafe_code)]

use clap::Parser;
use granita_base::{Filter, Reporter, SearchPath, Severity};
use granita_cli::{Bar, Status, console_reporter, environment, parse};
use granita_image::{FormatRegistry, Limits};
use granita_texture::Wrap;
use granita_texture::make::{Made, MakeOptions, Mode, make};
use std::ffi::OsString;
use std::path::PathBuf;
use std::sync::{Mutex, PoisonError};

/// Turns pictures into tiled, MIP-mapped textures, environment maps and shadow maps.
///
/// Without a mode option, one picture becomes a plain texture.
#[derive(Parser, Debug)]
#[command(name = "maketx")]
struct Args {
    /// Input files: one; six (px nx py ny pz nz) for -envcube and -shadcube
    #[arg(required = true, value_name = "FILE")]
    inputs: Vec<String>,

    /// The texture to write
    #[arg(short = 'o', value_name = "FILE", allow_hyphen_values = true)]
    output: PathBuf,

    #[command(flatten)]
    mode: ModeArgs,

    /// Format of the texture; it must store tiles and MIP levels
    #[arg(long, default_value = "tiff", value_name = "NAME")]
    format: String,

    /// Keep the resolution of the input, do not round it up to powers of two
    #[arg(long)]
    noresize: bool,

    /// Update: do nothing when the output has the time stamp of the newest input, else give it that stamp
    #[arg(short = 'u')]
    update: bool,

    /// Folders to look for inputs in, separated by colons
    #[arg(short = 'p', value_name = "SEARCHPATH", allow_hyphen_values = true)]
    path: Option<String>,

    /// Store channels one after the other instead of interleaved
    #[arg(long)]
    separate: bool,

    /// Width and height of tiles in texels
    #[arg(long, default_value_t = 64, value_name = "T", value_parser = clap::value_parser!(u32).range(1..=8192))]
    tilesize: u32,

    /// The inputs are gamma corrected: raised to the power 1/G
    #[arg(long, default_value_t = 1.0, value_name = "G")]
    ingamma: f32,

    /// Gamma correct the texture: raise it to the power 1/G
    #[arg(long, default_value_t = 1.0, value_name = "G")]
    outgamma: f32,

    /// World-to-camera matrix, 16 numbers row by row
    #[arg(long = "Mcamera", num_args = 16, value_name = "M", allow_negative_numbers = true)]
    mcamera: Option<Vec<f32>>,

    /// World-to-screen matrix, 16 numbers row by row
    #[arg(long = "Mscreen", num_args = 16, value_name = "M", allow_negative_numbers = true)]
    mscreen: Option<Vec<f32>>,

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

    /// Filter that makes MIP levels: gaussian, box, triangle, catmull-rom, sinc, blackman-harris, mitchell
    /// or b-spline
    #[arg(long, value_parser = filter, default_value = "box", value_name = "NAME")]
    filter: Filter,

    /// Compression, by the format's name for it
    #[arg(long, value_name = "NAME")]
    compression: Option<String>,

    /// Say which image formats are there and where they come from
    #[arg(long)]
    debugdso: bool,

    /// 0: errors only, 1: also warnings, 2: also what was done
    #[arg(long, default_value_t = 1, value_name = "N")]
    verbosity: u8,
}

/// What to make; at most one.
#[derive(clap::Args, Debug)]
#[group(multiple = false)]
struct ModeArgs {
    /// Cube-face environment map of six pictures
    #[arg(long)]
    envcube: bool,

    /// Latitude-longitude environment map
    #[arg(long)]
    envlatl: bool,

    /// Cube-face environment map of a light probe (angular map)
    #[arg(long)]
    lightprobe: bool,

    /// Cube-face environment map of a vertical cross
    #[arg(long)]
    vertcross: bool,

    /// Shadow map of a depth map
    #[arg(long)]
    shadow: bool,

    /// Cube-face shadow map of six depth maps; - is an empty one
    #[arg(long)]
    shadcube: bool,

    /// Volume shadow map of a volume depth map
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

fn wrap(text: &str) -> Result<Wrap, String> {
    Wrap::from_word(text).ok_or_else(|| "a wrap mode is periodic, black, clamp or mirror".to_owned())
}

fn filter(text: &str) -> Result<Filter, String> {
    Filter::from_word(text)
        .ok_or_else(|| format!("a filter is one of {}", Filter::ALL.map(Filter::word).join(", ")))
}

impl Args {
    fn options(&self) -> MakeOptions {
        let matrix = |m: &Option<Vec<f32>>| m.as_deref().and_then(|m| m.try_into().ok());
        let black = self.both.unwrap_or_default();
        MakeOptions {
            mode: self.mode.mode(),
            format: self.format.clone(),
            resize: !self.noresize,
            update: self.update,
            separate: self.separate,
            tile_size: (self.tilesize, self.tilesize),
            ingamma: self.ingamma,
            outgamma: self.outgamma,
            mcamera: matrix(&self.mcamera),
            mscreen: matrix(&self.mscreen),
            swrap: self.smode.unwrap_or(black),
            twrap: self.tmode.unwrap_or(black),
            fov_deg: self.fov,
            opaque_width: self.opaquewidth,
            filter: self.filter,
            compression: self.compression.clone(),
            pixel_type: None,
        }
    }

    /// Inputs along the search path; `None`, after an error for each, when some are missing.
    fn find_inputs(&self, reporter: &Reporter) -> Option<Vec<PathBuf>> {
        let Some(text) = &self.path else { return Some(self.inputs.iter().map(PathBuf::from).collect()) };
        let path = SearchPath::parse(text, &SearchPath::default(), &environment());
        let find = |name: &String| {
            if name == "-" {
                return Some(PathBuf::from(name));
            }
            let found = path.find(name);
            if found.is_none() {
                reporter.error(format!("{name}: not found along {text}"));
            }
            found
        };
        let found: Vec<Option<PathBuf>> = self.inputs.iter().map(find).collect();
        found.into_iter().collect()
    }
}

/// `-debugdso`: what there is to load.
fn say_formats(registry: &FormatRegistry, reporter: &Reporter) {
    for name in registry.names() {
        let Some(format) = registry.by_name(name) else { continue };
        let able: Vec<&str> = ["write", "tiles", "levels", "half", "float", "u16"]
            .into_iter()
            .filter(|feature| format.supports(feature))
            .collect();
        let text = format!(
            "image format \"{name}\": built in, extensions {}, {}\n",
            format.extensions().join(" "),
            if able.is_empty() { "reads only".to_owned() } else { able.join(" ") }
        );
        reporter.say(Severity::Message, &granita_base::Location::default(), text);
    }
}

fn run(args: &Args, bar: &Bar, reporter: &Reporter) -> Status {
    let registry = granita_plugin::bundled_formats(Limits::default());
    if args.debugdso {
        say_formats(&registry, reporter);
    }
    let Some(inputs) = args.find_inputs(reporter) else { return Status::Failed };
    let bar = Mutex::new((bar.clone(), false));
    let progress = |done: u64, total: u64| {
        let mut bar = bar.lock().unwrap_or_else(PoisonError::into_inner);
        if !bar.1 {
            bar.0.begin(&args.output.display().to_string(), total);
            bar.1 = true;
        }
        bar.0.done(done);
    };
    let result = make(&inputs, &args.output, &args.options(), &registry, &progress);
    bar.lock().unwrap_or_else(PoisonError::into_inner).0.end();
    let output = args.output.display();
    match result {
        Ok(Made::UpToDate) => {
            reporter.info(format!("{output} is up to date"));
            Status::Done
        }
        Ok(Made::Written { width, height, levels, notes }) => {
            notes.into_iter().for_each(|note| reporter.warning(note));
            reporter.info(format!("wrote {output}: {width} x {height} texels, {levels} levels"));
            Status::Done
        }
        Err(error) => {
            reporter.error(error.to_string());
            Status::Failed
        }
    }
}

/// Runs the tool; `words` begins with the name it was called by.
pub fn main(words: Vec<OsString>) -> Status {
    let args: Args = parse(words);
    let bar = Bar::new(args.verbosity > 0);
    let reporter = console_reporter("maketx", &bar);
    reporter.set_verbosity(args.verbosity);
    run(&args, &bar, &reporter)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn args(line: &str) -> Args {
        Args::try_parse_from(line.split(' ')).unwrap()
    }

    #[test]
    fn options_of_the_reference() {
        let a = args("maketx --envcube --fov 100 a b c d e f -o x --mode clamp --tmode mirror --tilesize 32");
        let o = a.options();
        assert_eq!((o.mode, o.fov_deg, a.inputs.len()), (Mode::EnvCube, 100.0, 6));
        assert_eq!((o.swrap, o.twrap, o.tile_size), (Wrap::Clamp, Wrap::Mirror, (32, 32)));
        assert!(o.resize && !o.update && !o.separate);
        let a = args(
            "maketx --shadcube - - b - e - -o x -u --separate --noresize --Mcamera 1 0 0 0 0 1 0 0 0 0 1 0 0 0 -5 1",
        );
        let o = a.options();
        assert_eq!(a.inputs, ["-", "-", "b", "-", "e", "-"]);
        assert_eq!(o.mcamera.unwrap()[14], -5.0);
        assert!(!o.resize && o.update && o.separate && o.mscreen.is_none());
        assert_eq!(args("maketx a.tif -o a.tx").options(), MakeOptions::default());
    }

    #[test]
    fn two_modes_are_a_mistake() {
        assert!(Args::try_parse_from("maketx --shadow --envlatl a -o b".split(' ')).is_err());
        assert!(Args::try_parse_from("maketx --mode round a -o b".split(' ')).is_err());
        assert!(Args::try_parse_from("maketx a".split(' ')).is_err());
    }
}
