//! Entries of directories to be written, and those of metadata.

use crate::tags;
use granita_image::ImageSpec;
use granita_image::metadata::exif;

/// An entry of a directory to be written.
#[derive(Debug, Default)]
pub(crate) struct Field {
    pub(crate) tag: u16,
    pub(crate) kind: u16,
    pub(crate) count: u64,
    pub(crate) bytes: Vec<u8>,
    /// The entries of a directory, whose offset is the value; empty for other values.
    pub(crate) directory: Vec<Self>,
}

impl Field {
    pub(crate) fn shorts(tag: u16, values: &[u16]) -> Self {
        let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        Self { tag, kind: 3, count: values.len() as u64, bytes, ..Self::default() }
    }

    pub(crate) fn long(tag: u16, value: u32) -> Self {
        Self { tag, kind: 4, count: 1, bytes: value.to_le_bytes().to_vec(), ..Self::default() }
    }

    /// Returns an entry of offsets and lengths in the file, with 64 bits only where the file has them.
    pub(crate) fn places(tag: u16, values: impl ExactSizeIterator<Item = u64>, big_tiff: bool) -> Self {
        let count = values.len() as u64;
        let bytes = if big_tiff {
            values.flat_map(u64::to_le_bytes).collect()
        } else {
            values.flat_map(|v| (v as u32).to_le_bytes()).collect()
        };
        Self { tag, kind: if big_tiff { 16 } else { 4 }, count, bytes, ..Self::default() }
    }

    pub(crate) fn text(tag: u16, text: &str) -> Self {
        // The format ends strings at a NUL.
        let mut bytes = text.split('\0').next().unwrap_or_default().as_bytes().to_vec();
        bytes.push(0);
        Self { tag, kind: 2, count: bytes.len() as u64, bytes, ..Self::default() }
    }

    pub(crate) fn floats(tag: u16, values: &[f32]) -> Self {
        let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        Self { tag, kind: 11, count: values.len() as u64, bytes, ..Self::default() }
    }

    /// Returns bytes of any content.
    pub(crate) fn bytes(tag: u16, kind: u16, bytes: &[u8]) -> Self {
        Self { tag, kind, count: bytes.len() as u64, bytes: bytes.to_vec(), ..Self::default() }
    }

    /// Returns an entry of Exif data.
    pub(crate) fn of_exif(entry: exif::Entry) -> Self {
        let count = u64::from(entry.count);
        Self { tag: entry.tag, kind: entry.kind, count, bytes: entry.bytes, ..Self::default() }
    }

    /// Returns an entry with an integer as a fraction. It is a signed one only where the value is negative, because the
    /// specification requires unsigned ones.
    pub(crate) fn rational(tag: u16, value: i32) -> Self {
        let kind = if value < 0 { 10 } else { 5 };
        let bytes = [value.to_le_bytes(), 1_i32.to_le_bytes()].concat();
        Self { tag, kind, count: 1, bytes, ..Self::default() }
    }
}

/// Returns the entries of the directories of the camera and the position, as far as these are not empty.
pub(crate) fn metadata_directories(spec: &ImageSpec) -> Vec<Field> {
    let mut camera = exif::entries(&spec.attributes, exif::Part::Camera, &[]);
    exif::complete(&mut camera);
    let position = exif::entries(&spec.attributes, exif::Part::Position, &[]);
    let entry = |(tag, entries): (u16, Vec<exif::Entry>)| {
        let directory: Vec<Field> = entries.into_iter().map(Field::of_exif).collect();
        (!directory.is_empty()).then(|| Field { tag, directory, ..Field::default() })
    };
    [(tags::EXIF_IFD, camera), (tags::GPS_IFD, position)].into_iter().filter_map(entry).collect()
}

/// Returns the resolution of the image, of entries of Exif data, and its orientation. A position is measured in the
/// unit of the resolution, which is then one pixel.
pub(crate) fn resolution(shown: impl Iterator<Item = Field>, has_windows: bool) -> Vec<Field> {
    let all = [tags::X_RESOLUTION, tags::Y_RESOLUTION, tags::RESOLUTION_UNIT];
    let (mut given, other): (Vec<Field>, Vec<Field>) = shown.partition(|f| all.contains(&f.tag));
    let nothing = |field: &Field| field.kind == 5 && field.bytes[..4] == [0; 4];
    if has_windows || given.len() < all.len() || given.iter().any(nothing) {
        given = vec![
            Field::rational(tags::X_RESOLUTION, 1),
            Field::rational(tags::Y_RESOLUTION, 1),
            Field::shorts(tags::RESOLUTION_UNIT, &[1]),
        ];
    }
    given.extend(other.into_iter().filter(|f| f.tag == tags::ORIENTATION));
    given
}
