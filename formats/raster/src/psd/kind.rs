//! What all images of a document share.

/// The kind of the colours of a document.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Mode {
    Bitmap,
    Grey,
    Indexed,
    Rgb,
    Cmyk,
    Multichannel,
    Lab,
}

impl Mode {
    /// The number of stored channels that define the colour; those of the document for its inks.
    pub(super) fn inks(self, channels: usize) -> usize {
        match self {
            Self::Bitmap | Self::Grey | Self::Indexed => 1,
            Self::Rgb | Self::Lab => 3,
            Self::Cmyk => 4,
            Self::Multichannel => channels,
        }
    }
}

/// What all images of a document share.
pub(super) struct Document {
    pub(super) mode: Mode,
    pub(super) depth: u16,
    /// True for large documents (PSB), whose lengths have more bytes.
    pub(super) wide: bool,
    pub(super) size: (u32, u32),
    /// The reds of all indices, their greens and their blues.
    pub(super) palette: Vec<u8>,
    /// The index of the palette that is transparent.
    pub(super) transparent: Option<u16>,
    /// True when the first channel behind the colour is the alpha of the merged image.
    pub(super) merged_alpha: bool,
}
