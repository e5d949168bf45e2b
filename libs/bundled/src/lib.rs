//! The shaders and scene inputs that every binary carries, so that the tools need no installation.
//!
//! Sources only: whoever wants a shader compiles it. `$GELATOHOME` and search paths come first; this
//! is where a search ends.

/// `name.gsl` of every bundled shader, by name.
const SHADERS: &[(&str, &str)] = &[];

/// Every bundled input, by file name.
const INPUTS: &[(&str, &[u8])] = &[];

/// Source text of the bundled shader `name` (without extension).
pub fn shader(name: &str) -> Option<&'static str> {
    SHADERS.iter().find(|(n, _)| *n == name).map(|(_, text)| *text)
}

/// Names of all bundled shaders, sorted.
pub fn shader_names() -> impl Iterator<Item = &'static str> {
    SHADERS.iter().map(|(n, _)| *n)
}

/// Content of the bundled input `file_name`, as `teapot.pyg`.
pub fn input(file_name: &str) -> Option<&'static [u8]> {
    INPUTS.iter().find(|(n, _)| *n == file_name).map(|(_, bytes)| *bytes)
}
