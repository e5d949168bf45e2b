//! The shaders and scene inputs that every binary contains, so that the tools need no installation.
//!
//! These are sources only, which the caller compiles. `$GELATOHOME` and search paths are searched first, and this
//! crate last.

#![forbid(unsafe_code)]

/// The file `name.gsl` of every bundled shader, by name.
const SHADERS: &[(&str, &str)] = &[
    ("ambientlight", include_str!("../../../shaders/ambientlight.gsl")),
    ("ambocclude", include_str!("../../../shaders/ambocclude.gsl")),
    ("arealight", include_str!("../../../shaders/arealight.gsl")),
    ("bakediffuse", include_str!("../../../shaders/bakediffuse.gsl")),
    ("bumpy", include_str!("../../../shaders/bumpy.gsl")),
    ("causticlight", include_str!("../../../shaders/causticlight.gsl")),
    ("clay", include_str!("../../../shaders/clay.gsl")),
    ("constant", include_str!("../../../shaders/constant.gsl")),
    ("defaultsurface", include_str!("../../../shaders/defaultsurface.gsl")),
    ("dented", include_str!("../../../shaders/dented.gsl")),
    ("dispmap", include_str!("../../../shaders/dispmap.gsl")),
    ("distantlight", include_str!("../../../shaders/distantlight.gsl")),
    ("envlight", include_str!("../../../shaders/envlight.gsl")),
    ("envsurf", include_str!("../../../shaders/envsurf.gsl")),
    ("fog", include_str!("../../../shaders/fog.gsl")),
    ("glass", include_str!("../../../shaders/glass.gsl")),
    ("gltfsurface", include_str!("../../../shaders/gltfsurface.gsl")),
    ("greenmarble", include_str!("../../../shaders/greenmarble.gsl")),
    ("indirectlight", include_str!("../../../shaders/indirectlight.gsl")),
    ("keyfillrim", include_str!("../../../shaders/keyfillrim.gsl")),
    ("matte", include_str!("../../../shaders/matte.gsl")),
    ("metal", include_str!("../../../shaders/metal.gsl")),
    ("movephotons", include_str!("../../../shaders/movephotons.gsl")),
    ("mtlsurface", include_str!("../../../shaders/mtlsurface.gsl")),
    ("nullsurface", include_str!("../../../shaders/nullsurface.gsl")),
    ("oak", include_str!("../../../shaders/oak.gsl")),
    ("paintedplastic", include_str!("../../../shaders/paintedplastic.gsl")),
    ("plastic", include_str!("../../../shaders/plastic.gsl")),
    ("plasticss", include_str!("../../../shaders/plasticss.gsl")),
    ("pointlight", include_str!("../../../shaders/pointlight.gsl")),
    ("pretexture", include_str!("../../../shaders/pretexture.gsl")),
    ("raygoggles", include_str!("../../../shaders/raygoggles.gsl")),
    ("screen", include_str!("../../../shaders/screen.gsl")),
    ("shadowspot", include_str!("../../../shaders/shadowspot.gsl")),
    ("shiny", include_str!("../../../shaders/shiny.gsl")),
    ("shinymetal", include_str!("../../../shaders/shinymetal.gsl")),
    ("shinyplastic", include_str!("../../../shaders/shinyplastic.gsl")),
    ("shootphotons", include_str!("../../../shaders/shootphotons.gsl")),
    ("showN", include_str!("../../../shaders/showN.gsl")),
    ("showdudv", include_str!("../../../shaders/showdudv.gsl")),
    ("showfacing", include_str!("../../../shaders/showfacing.gsl")),
    ("showgrids", include_str!("../../../shaders/showgrids.gsl")),
    ("shownormals", include_str!("../../../shaders/shownormals.gsl")),
    ("showst", include_str!("../../../shaders/showst.gsl")),
    ("showuv", include_str!("../../../shaders/showuv.gsl")),
    ("skylight", include_str!("../../../shaders/skylight.gsl")),
    ("softlight", include_str!("../../../shaders/softlight.gsl")),
    ("spotlight", include_str!("../../../shaders/spotlight.gsl")),
    ("studioback", include_str!("../../../shaders/studioback.gsl")),
    ("studiofloor", include_str!("../../../shaders/studiofloor.gsl")),
    ("subsurflayer", include_str!("../../../shaders/subsurflayer.gsl")),
    ("texmap", include_str!("../../../shaders/texmap.gsl")),
    ("uberlight", include_str!("../../../shaders/uberlight.gsl")),
];

/// Every bundled input, by file name.
const INPUTS: &[(&str, &[u8])] = &[
    ("backplane.pyg", include_bytes!("../../../inputs/backplane.pyg")),
    ("cameralights.pyg", include_bytes!("../../../inputs/cameralights.pyg")),
    ("frontplane.pyg", include_bytes!("../../../inputs/frontplane.pyg")),
    ("studio.pyg", include_bytes!("../../../inputs/studio.pyg")),
    ("studiolights.pyg", include_bytes!("../../../inputs/studiolights.pyg")),
    ("teapot.pyg", include_bytes!("../../../inputs/teapot.pyg")),
];

/// Returns the source text of the bundled shader `name` (without extension).
pub fn shader(name: &str) -> Option<&'static str> {
    SHADERS.iter().find(|(n, _)| *n == name).map(|(_, text)| *text)
}

/// Returns the names of all bundled shaders, sorted.
pub fn shader_names() -> impl Iterator<Item = &'static str> {
    SHADERS.iter().map(|(n, _)| *n)
}

/// Returns the content of the bundled input `file_name`, such as `teapot.pyg`.
pub fn input(file_name: &str) -> Option<&'static [u8]> {
    INPUTS.iter().find(|(n, _)| *n == file_name).map(|(_, bytes)| *bytes)
}

/// Returns the names of all bundled inputs, sorted.
pub fn input_names() -> impl Iterator<Item = &'static str> {
    INPUTS.iter().map(|(n, _)| *n)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_files_are_bundled_and_their_names_sorted() {
        assert!(shader_names().is_sorted() && input_names().is_sorted());
        for (folder, extension, bundled) in [
            ("../../shaders", ".gsl", shader_names().map(str::to_owned).collect::<Vec<_>>()),
            ("../../inputs", "", input_names().map(str::to_owned).collect()),
        ] {
            let mut files: Vec<String> = std::fs::read_dir(folder)
                .unwrap()
                .map(|f| f.unwrap().file_name().into_string().unwrap())
                .filter_map(|f| f.strip_suffix(extension).map(str::to_owned))
                .collect();
            files.sort();
            assert_eq!(files, bundled);
        }
    }

    #[test]
    fn bundled_files_are_found_by_name() {
        assert!(shader("plastic").is_some_and(|s| s.contains("surface plastic")));
        assert!(shader("no such shader").is_none());
        assert!(input("teapot.pyg").is_some_and(|i| !i.is_empty()));
        assert!(input("no such input").is_none());
    }
}
