//! The view of a display of a configuration, from options and the environment.

use crate::args::LookArgs;
use granita_base::{Environment, Reporter};
use granita_color::Config;
use granita_plugin::PluginRules;
use granita_view::Viewing;

/// Returns the view that the options and `$OCIO` name; `None` for the encoding of sRGB.
///
/// A configuration of `$OCIO` that cannot be used is a warning, because the user did not ask for it in this call.
///
/// # Errors
/// Returns an error for a configuration of the options that cannot be read, and for names that it does not have.
pub(crate) fn viewing(
    look: &LookArgs,
    environment: &Environment,
    rules: PluginRules,
    reporter: &Reporter,
) -> Result<Option<Viewing>, String> {
    let named = look.colorspace.is_some() || look.display.is_some() || look.view.is_some();
    let variable = environment.get("OCIO").filter(|name| !name.is_empty());
    let (name, option) = match (&look.colorconfig, variable) {
        (Some(path), _) => (path.to_string_lossy().into_owned(), "-colorconfig"),
        (None, Some(name)) => (name.to_owned(), "$OCIO"),
        (None, None) if named => ("ocio://default".to_owned(), "-colorspace"),
        (None, None) => return Ok(None),
    };
    let found = Config::open(&name, environment).and_then(|config| {
        let config = config.with_engine(granita_plugin::color_engine(environment, rules.clone()));
        Viewing::new(config, look.colorspace.as_deref(), look.display.as_deref(), look.view.as_deref())
    });
    match found {
        Ok(viewing) => Ok(Some(viewing)),
        Err(error) if option == "$OCIO" && !named => {
            reporter.warning(format!("$OCIO is not used: {error}"));
            Ok(None)
        }
        Err(error) => Err(format!("{option}: {error}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::args::Args;
    use clap::Parser;

    fn of(line: &str, ocio: &str) -> Result<Option<(String, String)>, String> {
        let args = Args::try_parse_from(line.split(' ')).unwrap();
        let mut environment = Environment::default();
        if !ocio.is_empty() {
            environment.set("OCIO", ocio);
        }
        let (reporter, _) = Reporter::collecting();
        let found = viewing(&args.look, &environment, PluginRules::default(), &reporter)?;
        Ok(found.map(|viewing| (viewing.display().to_owned(), viewing.view().to_owned())))
    }

    #[test]
    fn options_come_before_the_environment() {
        let srgb = || Some(("sRGB - Display".to_owned(), "Un-tone-mapped".to_owned()));
        assert_eq!(of("iv a", ""), Ok(None));
        assert_eq!(of("iv a", "ocio://default"), Ok(srgb()));
        assert_eq!(of("iv --colorspace ACEScg a", ""), Ok(srgb()));
        assert_eq!(of("iv --colorconfig ocio://default a", "/none"), Ok(srgb()));
        let p3 = of("iv --display displayp3_display --view Raw a", "");
        assert!(p3.is_err(), "an alias of a colour space is no display");
        let p3 = of("iv --display p3-d60 --view raw a", "").unwrap_err();
        assert!(
            p3.starts_with("-colorspace: the built-in configuration has no display \"p3-d60\"; it has "),
            "{p3}"
        );
        assert_eq!(of("iv a", "/none"), Ok(None));
        assert!(of("iv --view Raw a", "/none").unwrap_err().starts_with("$OCIO: /none: "));
    }
}
