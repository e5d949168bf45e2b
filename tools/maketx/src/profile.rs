//! Profiles: the programs whose options a command line has.

use granita_base::Environment;
use std::ffi::{OsStr, OsString};
use std::path::Path;

/// The variable that names a profile.
const VARIABLE: &str = "GRANITA_MAKETX_PROFILE";

/// The options and defaults that apply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Profile {
    /// Those of the reference.
    Granita,
    /// Those of OpenImageIO's `maketx`.
    Oiio,
    /// The names of RenderMan's `txmake`.
    Txmake,
}

impl Profile {
    fn from_word(word: &OsStr) -> Result<Self, String> {
        Ok(match word.to_str() {
            Some("granita") => Self::Granita,
            Some("oiio") => Self::Oiio,
            Some("txmake") => Self::Txmake,
            _ => {
                return Err(format!(
                    "there is no profile {}; profiles are granita, oiio and txmake",
                    word.display()
                ));
            }
        })
    }

    /// Returns the profile of a command line, and removes the option that names it. The option decides, then the name
    /// of the program, then the variable, and then the presence of `--oiio`, which is an option of one program only.
    ///
    /// # Errors
    /// Returns a message when a name is not that of a profile.
    pub(crate) fn choose(words: &mut Vec<OsString>, environment: &Environment) -> Result<Self, String> {
        // A profile is named before the values of other options could be mistaken for it.
        let is_option = |word: &OsString| {
            let word = word.to_str()?;
            let name = word.strip_prefix("--").or_else(|| word.strip_prefix('-'))?;
            let value = name.strip_prefix("profile")?;
            value
                .is_empty()
                .then_some(None)
                .or_else(|| value.strip_prefix('=').map(|v| Some(OsString::from(v))))
        };
        if let Some((at, value)) =
            words.iter().enumerate().skip(1).find_map(|(i, w)| Some((i, is_option(w)?)))
        {
            words.remove(at);
            let name = match value {
                Some(name) => name,
                None if at < words.len() => words.remove(at),
                None => return Err("-profile needs a name: granita, oiio or txmake".to_owned()),
            };
            return Self::from_word(&name);
        }
        let called = words.first().map(Path::new).and_then(Path::file_stem).and_then(OsStr::to_str);
        match called {
            Some("oiio-maketx") => return Ok(Self::Oiio),
            Some("txmake") => return Ok(Self::Txmake),
            _ => {}
        }
        if let Some(name) = environment.get(VARIABLE).filter(|name| !name.is_empty()) {
            return Self::from_word(OsStr::new(name)).map_err(|what| format!("{VARIABLE}: {what}"));
        }
        let oiio = words.iter().skip(1).any(|word| word == "--oiio" || word == "-oiio");
        Ok(if oiio { Self::Oiio } else { Self::Granita })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_option_the_name_or_the_variable_choose_the_profile() {
        let none = Environment::empty();
        let mut oiio = Environment::empty();
        oiio.set(VARIABLE, "oiio");
        for (line, environment, expected, rest) in [
            ("maketx a.png", &none, Profile::Granita, 2),
            ("maketx -profile oiio a.png", &none, Profile::Oiio, 2),
            ("maketx a.png --profile=txmake b", &none, Profile::Txmake, 3),
            ("bin/oiio-maketx a.png", &none, Profile::Oiio, 2),
            ("oiio-maketx.exe a.png", &none, Profile::Oiio, 2),
            ("maketx a.png", &oiio, Profile::Oiio, 2),
            ("maketx -profile granita a.png", &oiio, Profile::Granita, 2),
            ("maketx --oiio a.png", &none, Profile::Oiio, 3),
        ] {
            let mut words: Vec<OsString> = line.split(' ').map(OsString::from).collect();
            assert_eq!(Profile::choose(&mut words, environment), Ok(expected), "{line}");
            assert_eq!(words.len(), rest, "{line}");
        }
        let choose = |line: &str| Profile::choose(&mut line.split(' ').map(OsString::from).collect(), &none);
        assert!(choose("maketx -profile pink a").unwrap_err().contains("no profile pink"));
        assert!(choose("maketx a -profile").unwrap_err().contains("needs a name"));
    }
}
