//! The kinds of texture files.

use granita_image::ImageSpec;

/// The kind of a texture file, which is its `textureformat` attribute (reference 9.2).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum TextureKind {
    /// An ordinary 2D texture, or a file that does not declare its kind.
    Plain,
    /// A depth map seen from a light, ordinary or Woo.
    Shadow,
    /// Six depth maps around a light.
    CubeFaceShadow,
    /// Opacity against depth.
    VolumeShadow,
    /// Opacity against depth in six views around a light.
    CubeFaceVolumeShadow,
    /// Six views around a point.
    CubeFaceEnvironment,
    /// All directions by latitude and longitude.
    LatLongEnvironment,
    /// A volume texture. The images of the file are its slices.
    Volume,
}

impl TextureKind {
    /// All kinds.
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

    /// Returns the value of the `textureformat` attribute.
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

    /// Returns the kind for a value of the attribute. Upper and lower case do not matter.
    pub fn from_word(word: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|k| k.word().eq_ignore_ascii_case(word.trim()))
    }

    /// Returns the declared kind of a file. A single-channel float image with both matrices is a depth map even
    /// without a declaration.
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

    /// Returns the more general name that `gettextureinfo` returns for "type" (reference table 5.5).
    pub fn type_word(self) -> &'static str {
        match self {
            Self::Plain => "texture",
            Self::Shadow | Self::CubeFaceShadow | Self::VolumeShadow | Self::CubeFaceVolumeShadow => "shadow",
            Self::CubeFaceEnvironment | Self::LatLongEnvironment => "environment",
            Self::Volume => "volume",
        }
    }

    /// True when six faces share the image.
    pub fn is_cube(self) -> bool {
        matches!(self, Self::CubeFaceShadow | Self::CubeFaceVolumeShadow | Self::CubeFaceEnvironment)
    }

    /// True when texels hold opacity against depth.
    pub fn is_volume_shadow(self) -> bool {
        matches!(self, Self::VolumeShadow | Self::CubeFaceVolumeShadow)
    }

    /// True when depths are compared instead of filtering colours.
    pub fn is_shadow(self) -> bool {
        self.type_word() == "shadow"
    }

    /// True when the file should have MIP levels (ordinary and cube-face shadow maps have one).
    pub fn is_mipmapped(self) -> bool {
        !matches!(self, Self::Shadow | Self::CubeFaceShadow)
    }
}
