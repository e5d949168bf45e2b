//! The readers of files of tables and of other transforms.

mod cdl;
mod clf;
mod csp;
mod cube;
mod lines;
mod spi;
mod threedl;

use crate::error::ColorError;
use crate::transform::Directed;
use std::path::Path;

/// Reads the transforms of a file.
///
/// # Errors
/// Returns an error with the name and the line.
pub(crate) fn read(
    bytes: &[u8],
    path: &Path,
    id: Option<&str>,
    clamp: bool,
) -> Result<Vec<Directed>, ColorError> {
    let text = std::str::from_utf8(bytes).map(str::to_owned).unwrap_or_else(|_| {
        // Names of authors in old encodings do not matter.
        bytes.iter().map(|b| char::from(*b)).collect()
    });
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    match &*extension {
        "cube" => cube::read(&text, path),
        "spi1d" => spi::read_1d(&text, path),
        "spi3d" => spi::read_3d(&text, path),
        "spimtx" => spi::read_matrix(&text, path),
        "csp" => csp::read(&text, path),
        "3dl" => threedl::read(&text, path),
        "cc" | "ccc" | "cdl" => cdl::read(&text, path, id, clamp),
        "clf" | "ctf" => clf::read(&text, path),
        _ => Err(ColorError::Unsupported {
            place: path.display().to_string(),
            what: format!("a transform file with the extension \"{extension}\""),
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_unknown_kinds_are_named() {
        let error = read(b"", Path::new("a/b.vf"), None, false).unwrap_err().to_string();
        assert_eq!(error, "a/b.vf: a transform file with the extension \"vf\" is not supported");
    }
}
