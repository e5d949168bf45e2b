//! The conversion of colours, from options to processors.

use granita_base::Environment;
use granita_color::Config;
use granita_plugin::PluginRules;
use granita_texture::make::ColorConvert;
use std::path::PathBuf;
use std::sync::Arc;

/// The options of colours that the profiles `granita` and `oiio` share.
#[derive(clap::Args, Debug)]
pub(crate) struct ColorArgs {
    /// Convert colours from one space of the configuration to another: names, aliases or roles, such as srgb, linear,
    /// ACEScg
    #[arg(long, num_args = 2, value_names = ["FROM", "TO"])]
    colorconvert: Vec<String>,

    /// Configuration of OpenColorIO, a file or ocio://NAME [default: that of $OCIO, else the built-in one]
    #[arg(long, value_name = "FILE")]
    colorconfig: Option<PathBuf>,

    /// Divide colours by alpha while -colorconvert converts them, and multiply them afterwards
    #[arg(long)]
    unpremult: bool,
}

impl ColorArgs {
    /// Returns the conversion of -colorconvert. Levels are made in linear light, in the primaries of the texture where
    /// the configuration has such a space. As OpenImageIO does (`peer`), they are made of the converted values.
    ///
    /// # Errors
    /// Returns an error for a configuration that cannot be read, and for a space that it does not have.
    pub(crate) fn convert(
        &self,
        environment: &Environment,
        rules: PluginRules,
        peer: bool,
    ) -> Result<Option<Arc<ColorConvert>>, String> {
        let [from, to] = &self.colorconvert[..] else { return Ok(None) };
        let option = self.colorconfig.as_ref().map(|path| path.to_string_lossy());
        let engine = granita_plugin::color_engine(environment, rules);
        let config = Config::of_tool(option.as_deref(), environment, engine)?;
        let failed = |error: granita_color::ColorError| format!("-colorconvert {from} {to}: {error}");
        let direct = config.processor(from, to).map_err(failed)?;
        let mut colors =
            ColorConvert { unassociate: self.unpremult, multiply_first: peer, ..ColorConvert::default() };
        let name = |space| config.color_space(space).map(|space| &space.name);
        colors.same = name(from).is_some() && name(from) == name(to);
        let is_data = |name| config.color_space(name).is_none_or(|space| space.is_data);
        let linear = config.linear_for(to).filter(|_| !peer && !is_data(from));
        match linear {
            Some(linear) => {
                colors.inputs = config.processor(from, linear).map_err(failed)?;
                colors.outputs = config.processor(linear, to).map_err(failed)?;
            }
            None => colors.inputs = direct,
        }
        Ok(Some(Arc::new(colors)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn args(from: &str, to: &str) -> ColorArgs {
        ColorArgs { colorconvert: vec![from.to_owned(), to.to_owned()], colorconfig: None, unpremult: false }
    }

    const CONFIG: &str = "ocio_profile_version: 2\nroles: {scene_linear: lin}\ncolorspaces:\n  - !<ColorSpace> {name: lin, encoding: scene-linear}\n  - !<ColorSpace> {name: half, to_scene_reference: !<MatrixTransform> {matrix: [2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 2, 0, 0, 0, 0, 1]}}\n";

    #[test]
    fn levels_are_linear_but_for_openimageio() {
        let environment = Environment::default();
        let own = args("srgb", "srgb").convert(&environment, PluginRules::default(), false).unwrap().unwrap();
        assert!((own.inputs.map([0.5; 3])[0] - 0.214_041).abs() < 1e-5 && !own.outputs.is_identity());
        let peer = args("srgb", "srgb").convert(&environment, PluginRules::default(), true).unwrap().unwrap();
        assert!(peer.inputs.is_identity() && peer.outputs.is_identity() && peer.multiply_first);
        let linear =
            args("srgb", "linear").convert(&environment, PluginRules::default(), false).unwrap().unwrap();
        assert!(linear.inputs.is_separable() && linear.outputs.is_identity());
        let data = args("raw", "srgb").convert(&environment, PluginRules::default(), false).unwrap().unwrap();
        assert!(data.inputs.is_identity() && data.outputs.is_identity());
        let none = ColorArgs { colorconvert: Vec::new(), ..args("", "") };
        assert_eq!(none.convert(&environment, PluginRules::default(), false), Ok(None));
    }

    #[test]
    fn the_option_comes_before_the_environment() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.ocio");
        std::fs::write(&file, CONFIG).unwrap();
        let mut environment = Environment::default();
        environment.set("OCIO", file.to_string_lossy());
        let half = args("half", "lin");
        assert_eq!(
            half.convert(&environment, PluginRules::default(), false).unwrap().unwrap().inputs.map([0.5; 3]),
            [1.0; 3]
        );
        let error = half.convert(&Environment::default(), PluginRules::default(), false).unwrap_err();
        assert_eq!(error, "-colorconvert half lin: the built-in configuration has no colour space \"half\"");
        let built_in = ColorArgs { colorconfig: Some("ocio://default".into()), ..args("srgb", "linear") };
        assert!(built_in.convert(&environment, PluginRules::default(), false).is_ok());
        environment.set("OCIO", "/no/such/file");
        assert!(
            half.convert(&environment, PluginRules::default(), false)
                .unwrap_err()
                .starts_with("$OCIO: /no/such/file: ")
        );
        let option = ColorArgs { colorconfig: Some(file), ..args("half", "lin") };
        assert!(option.convert(&environment, PluginRules::default(), true).is_ok());
    }
}
