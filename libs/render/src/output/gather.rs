//! Gathers the images of a camera that become parts of one file.

use super::parts::{Part, PartFile};
use super::plan::OutputSet;
use crate::{CameraView, RenderError};
use granita_image::FormatRegistry;
use std::path::PathBuf;
use std::sync::Arc;

/// The name of the part of an output that names none, in a file that has other parts.
const UNNAMED: &str = "main";

/// Gathers the images with parts. `outputs` holds the images of one eye after those of the other. Both eyes of a stereo
/// camera may have one file.
///
/// # Errors
/// Returns an error for a format that is not known.
pub(crate) fn gather_parts(
    outputs: &mut [OutputSet],
    eyes: &[CameraView],
    registry: &FormatRegistry,
) -> Result<(), RenderError> {
    let count = outputs.first().map_or(0, |set| set.images.len());
    let places: Vec<(usize, usize)> =
        (0..count).flat_map(|image| (0..outputs.len()).map(move |eye| (eye, image))).collect();
    let mut paths: Vec<PathBuf> = Vec::new();
    for (eye, image) in &places {
        let image = &outputs[*eye].images[*image];
        if image.part.is_some() && !paths.contains(&image.path) {
            paths.push(image.path.clone());
        }
    }
    for path in paths {
        let members: Vec<(usize, usize)> = places
            .iter()
            .copied()
            .filter(|(eye, image)| {
                let image = &outputs[*eye].images[*image];
                // A "./" makes another name.
                !image.is_shown && image.path.as_os_str() == path.as_os_str()
            })
            .collect();
        let mut specs = Vec::with_capacity(members.len());
        for (eye, image) in &members {
            let twin = (0..outputs.len()).any(|other| other != *eye && members.contains(&(other, *image)));
            let image = &mut outputs[*eye].images[*image];
            let part = image.part.get_or_insert_with(|| Part::new(UNNAMED.into()));
            if let Some(view) = part.view.filter(|_| twin) {
                part.name = format!("{}.{view}", part.name).into();
            }
            specs.push(image.stored_spec(&eyes[*eye], registry)?);
        }
        let file = Arc::new(PartFile::new(path, specs));
        for (index, (eye, image)) in members.iter().enumerate() {
            if let Some(part) = &mut outputs[*eye].images[*image].part {
                part.place = Some((file.clone(), index));
            }
        }
    }
    Ok(())
}
