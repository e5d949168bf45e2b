//! The kinds of texture file.

use granita_image::ImageSpec;

/// What a texture file is for: its `textureformat` attribute (reference 9.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum TextureKind {
    /// An ordinary 2D texture; also any file that does not say what it is.
    Plain,
    /// A depth map seen from a light, ordinary or Woo.
    Shadow,
    /// Six depth maps around a light.
    CubeFaceShadow,
    /// Opacity against depth.
    VolumeShadow,
    /// The same in six views around a light.
    CubeFaceVolumeShadow,
    /// Six views around a point.
    CubeFaceEnvironment,
    /// All directions by latitude and longitude.
    LatLongEnvironment,
    /// A picture that has depth: the images of the file are its slices.
    Volume,
}

impl TextureKind {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::Plain,
        Self::Shadow,
        Self::CubeFaceShadow,
        Self::VolumeShadow,
        Self::CubeFaceVolumeShadow,
        Self::CubeFaceEnvironment,
        Self::LatLongEnvironment,
        Self::Volume,
    ];

    /// The value of the `textureformat` attribute.
    pub fn word(self) -> &'static str {
        match self {
            Self::Plain => "Plain Texture",
            Self::Shadow => "Shadow",
            Self::CubeFaceShadow => "CubeFace Shadow",
            Self::VolumeShadow => "Volume Shadow",
            Self::CubeFaceVolumeShadow => "CubeFace Volume Shadow",
            Self::CubeFaceEnvironment => "CubeFace Environment",
            Self::LatLongEnvironment => "LatLong Environment",
            Self::Volume => "Volume Texture",
        }
    }

    /// By the value of the attribute, upper and lower case alike.
    pub fn from_word(word: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|k| k.word().eq_ignore_ascii_case(word.trim()))
    }

    /// The kind a file says it is; a single-channel float picture with both matrices is a depth map even if
    /// it does not say so.
    pub fn of(spec: &ImageSpec) -> Self {
        if let Some(kind) = spec.string("textureformat").and_then(Self::from_word) {
            return kind;
        }
        match spec.string("envmap").map(str::to_ascii_lowercase).as_deref() {
            Some("latlong" | "latitude-longitude" | "latitude-longitude map") => {
                return Self::LatLongEnvironment;
            }
            Some("cube" | "cube-face" | "cube-face map") => return Self::CubeFaceEnvironment,
            _ => {}
        }
        let matrices = spec.matrix("worldtocamera").is_some() && spec.matrix("worldtoscreen").is_some();
        if matrices && spec.nchannels() == 1 { Self::Shadow } else { Self::Plain }
    }

    /// The coarser name that `gettextureinfo` gives for "type" (reference table 5.5).
    pub fn type_word(self) -> &'static str {
        match self {
            Self::Plain => "texture",
            Self::Shadow | Self::CubeFaceShadow | Self::VolumeShadow | Self::CubeFaceVolumeShadow => "shadow",
            Self::CubeFaceEnvironment | Self::LatLongEnvironment => "environment",
            Self::Volume => "volume",
        }
    }

    /// Whether six faces share the picture.
    pub fn is_cube(self) -> bool {
        matches!(self, Self::CubeFaceShadow | Self::CubeFaceVolumeShadow | Self::CubeFaceEnvironment)
    }

    /// Whether texels hold opacity against depth.
    pub fn is_volume_shadow(self) -> bool {
        matches!(self, Self::VolumeShadow | Self::CubeFaceVolumeShadow)
    }

    /// Whether depths are compared, not colours filtered.
    pub fn is_shadow(self) -> bool {
        self.type_word() == "shadow"
    }

    /// Whether the file is expected to have MIP levels (ordinary and cube-face shadow maps have one).
    pub fn is_mipmapped(self) -> bool {
        !matches!(self, Self::Shadow | Self::CubeFaceShadow)
    }
}
