//! The profile `txmake`: the names of the options of RenderMan's `txmake`.

use crate::request::{Manner, Request};
use crate::shared::{RunArgs, threads};
use clap::Parser;
use granita_base::Filter;
use granita_image::PixelType;
use granita_texture::Wrap;
use granita_texture::make::{FlatOptions, LevelFilter, MakeOptions, Mode};
use std::ffi::OsString;
use std::path::PathBuf;

/// Converts images to textures, with the names of the options of RenderMan's txmake. The last file is the texture.
#[derive(Parser, Debug)]
#[command(name = "txmake")]
pub(crate) struct TxmakeArgs {
    /// The input, or six (px nx py ny pz nz) for -envcube, and the texture
    #[arg(required = true, num_args = 2.., value_name = "FILE")]
    files: Vec<String>,

    /// Default wrap mode in both directions: black, clamp or periodic
    #[arg(long, value_parser = wrap, default_value = "black", value_name = "MODE")]
    mode: Wrap,

    /// Default wrap mode in s
    #[arg(long, value_parser = wrap, value_name = "MODE")]
    smode: Option<Wrap>,

    /// Default wrap mode in t
    #[arg(long, value_parser = wrap, value_name = "MODE")]
    tmode: Option<Wrap>,

    /// Size of the texture: up to powers of two (up, up-), or that of the image (none)
    #[arg(long, value_parser = resize, default_value = "up-", value_name = "NAME")]
    resize: Resize,

    /// Filter of MIP levels
    #[arg(long, default_value = "box", value_name = "NAME")]
    filter: String,

    /// Width of the filter as a multiple of its own; only 1 is supported
    #[arg(long, default_value_t = 1.0, value_name = "F")]
    blur: f32,

    /// Latitude-longitude environment map
    #[arg(long, conflicts_with_all = ["envcube", "shadow"])]
    envlatl: bool,

    /// Cube-face environment map from six images
    #[arg(long, conflicts_with = "shadow")]
    envcube: bool,

    /// Shadow map from a depth map
    #[arg(long)]
    shadow: bool,

    /// Field of view of the faces of -envcube, in degrees
    #[arg(long, default_value_t = 90.0, value_name = "ANGLE")]
    fov: f32,

    /// Format of the texture: openexr, tiff or pixar, which is TIFF
    #[arg(long, default_value = "tiff", value_name = "NAME", value_parser = ["openexr", "tiff", "pixar"])]
    format: String,

    /// Compression: none, or lossless, or a name of the format
    #[arg(long, value_name = "NAME")]
    compression: Option<String>,

    /// Texels of 8 bits
    #[arg(long, conflicts_with_all = ["short", "half", "float"])]
    byte: bool,

    /// Texels of 16 bits
    #[arg(long, conflicts_with_all = ["half", "float"])]
    short: bool,

    /// Texels of 16-bit floats
    #[arg(long, conflicts_with = "float")]
    half: bool,

    /// Texels of 32-bit floats
    #[arg(long)]
    float: bool,

    /// Skip a texture that is newer than its inputs
    #[arg(long)]
    newer: bool,

    /// Number of threads, also written -t:N [default: one per core]
    #[arg(long, value_name = "N", value_parser = threads)]
    threads: Option<usize>,

    /// Print what is done
    #[arg(long)]
    verbose: bool,

    #[command(flatten)]
    run: RunArgs,
}

/// The size of a texture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Resize {
    Up,
    None,
}

fn wrap(text: &str) -> Result<Wrap, String> {
    match Wrap::from_word(text) {
        Some(mode) if mode != Wrap::Mirror => Ok(mode),
        _ => Err("a wrap mode is black, clamp or periodic".to_owned()),
    }
}

fn resize(text: &str) -> Result<Resize, String> {
    match text {
        "up" | "up-" => Ok(Resize::Up),
        "none" => Ok(Resize::None),
        "down" | "round" | "down-" | "round-" => {
            Err("not supported: sizes other than up, up- and none".to_owned())
        }
        _ => Err("a size is up, up- or none".to_owned()),
    }
}

/// Returns a command line in which `-t:N` is `-threads=N`.
pub(crate) fn with_threads(words: Vec<OsString>) -> Vec<OsString> {
    let changed = |word: OsString| match word.to_str().and_then(|word| word.strip_prefix("-t:")) {
        Some(count) => format!("-threads={count}").into(),
        None => word,
    };
    words.into_iter().map(changed).collect()
}

impl TxmakeArgs {
    /// Returns the request.
    ///
    /// # Errors
    /// Returns a message when an option is not supported.
    pub(crate) fn request(mut self, installed_bytes: Option<u64>) -> Result<Request, String> {
        if self.blur != 1.0 {
            return Err(format!("not supported: -blur {}; only 1 is", self.blur));
        }
        let own = Filter::from_word(&self.filter);
        let other = match own {
            Some(_) => None,
            None => match LevelFilter::from_word(&self.filter) {
                Some(filter) => Some(filter),
                None => return Err(format!("not supported: -filter {}", self.filter)),
            },
        };
        let types = [
            (self.byte, PixelType::U8),
            (self.short, PixelType::U16),
            (self.half, PixelType::Half),
            (self.float, PixelType::Float),
        ];
        let options = MakeOptions {
            mode: match (self.envlatl, self.envcube, self.shadow) {
                (true, ..) => Mode::EnvLatLong,
                (_, true, _) => Mode::EnvCube,
                (.., true) => Mode::Shadow,
                _ => Mode::Plain,
            },
            format: if self.format == "openexr" { "OpenEXR" } else { "tiff" }.to_owned(),
            resize: self.resize == Resize::Up,
            swrap: self.smode.unwrap_or(self.mode),
            twrap: self.tmode.unwrap_or(self.mode),
            fov_deg: self.fov,
            filter: own.unwrap_or(Filter::Box),
            compression: self
                .compression
                .map(|name| if name == "lossless" { "zip".to_owned() } else { name }),
            pixel_type: types.into_iter().find(|(given, _)| *given).map(|(_, kind)| kind),
            memory_bytes: self.run.memory_bytes(installed_bytes),
            flat: FlatOptions { filter: other, ..FlatOptions::default() },
            ..MakeOptions::default()
        };
        let output = self.files.pop().map(PathBuf::from);
        Ok(Request {
            manner: Manner::Suite,
            inputs: self.files,
            output,
            format_given: true,
            path: None,
            newer: self.newer,
            seams: false,
            threads: self.threads,
            stats: false,
            verbosity: if self.verbose { 2 } else { 1 },
            run: self.run,
            options,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn request(line: &str) -> Result<Request, String> {
        let words = with_threads(line.split(' ').map(OsString::from).collect());
        let (args, _) = granita_cli::try_parse::<TxmakeArgs>(words).map_err(|e| e.to_string())?;
        args.request(None)
    }

    #[test]
    fn names_of_txmake_fill_the_job() {
        let r = request(
            "txmake -mode periodic -tmode clamp -resize none -half -format openexr -t:3 -newer a b.tex",
        );
        let r = r.unwrap();
        let o = &r.options;
        assert_eq!((o.swrap, o.twrap, o.resize), (Wrap::Periodic, Wrap::Clamp, false));
        assert_eq!((&*o.format, o.pixel_type, r.threads), ("OpenEXR", Some(PixelType::Half), Some(3)));
        assert_eq!((r.inputs, r.output, r.newer), (vec!["a".to_owned()], Some("b.tex".into()), true));
        let r = request("txmake -envcube -fov 95 -filter lanczos3 px nx py ny pz nz env.tex").unwrap();
        assert_eq!((r.options.mode, r.inputs.len(), r.options.fov_deg), (Mode::EnvCube, 6, 95.0));
        assert!(r.options.flat.filter.is_some() && r.options.resize);
    }

    #[test]
    fn what_is_not_supported_is_named() {
        for (line, expected) in [
            ("txmake -blur 2 a b", "-blur 2"),
            ("txmake -filter bessel a b", "-filter bessel"),
            ("txmake -resize down a b", "not supported: sizes"),
            ("txmake -byte -half a b", "cannot be used"),
            ("txmake a", "2"),
        ] {
            let Err(what) = request(line) else { panic!("{line}") };
            assert!(what.contains(expected), "{what}");
        }
    }
}
