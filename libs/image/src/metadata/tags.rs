// tidy: table
//! The tags of Exif (JEITA CP-3451E, "Exchangeable image file format for digital still cameras: Exif Version 2.31")
//! with the names of their attributes, which are those of OpenImageIO where the suite has none of its own.

/// How the value of a tag is written. It is read from what the file declares.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// A text that ends with a NUL.
    Text,
    /// Numbers of 8 bits.
    Byte,
    /// Numbers of 16 bits.
    Short,
    /// Numbers of 32 bits.
    Long,
    /// Unsigned fractions.
    Fraction,
    /// Signed fractions.
    SignedFraction,
    /// A text of four characters without a NUL.
    Version,
    /// One byte without a type.
    Opaque,
    /// A text after eight bytes with the name of its encoding.
    Comment,
    /// The unit of resolutions, as a word.
    Unit,
}

/// A tag: its number, the name of its attribute, and its kind.
pub(super) type Tag = (u16, &'static str, Kind);

use Kind::{Byte, Comment, Fraction, Long, Opaque, Short, SignedFraction, Text, Unit, Version};

/// The tags of the image itself, which TIFF files have in their own directories.
#[rustfmt::skip]
pub(super) const IMAGE: [Tag; 13] = [
    (269, "DocumentName", Text),
    (270, "ImageDescription", Text),
    (271, "Make", Text),
    (272, "Model", Text),
    (274, "orientation", Short),
    (282, "XResolution", Fraction),
    (283, "YResolution", Fraction),
    (296, "ResolutionUnit", Unit),
    (305, "software", Text),
    (306, "DateTime", Text),
    (315, "Artist", Text),
    (316, "HostComputer", Text),
    (33432, "copyright", Text),
];

/// The tags of the camera and the shot. The size of the image and notes of the maker are left out, because they
/// describe one file.
#[rustfmt::skip]
pub(super) const CAMERA: [Tag; 60] = [
    (33434, "ExposureTime", Fraction),
    (33437, "FNumber", Fraction),
    (34850, "Exif:ExposureProgram", Short),
    (34852, "Exif:SpectralSensitivity", Text),
    (34855, "Exif:PhotographicSensitivity", Short),
    (34864, "Exif:SensitivityType", Short),
    (34865, "Exif:StandardOutputSensitivity", Long),
    (34866, "Exif:RecommendedExposureIndex", Long),
    (34867, "Exif:ISOSpeed", Long),
    (36864, "Exif:ExifVersion", Version),
    (36867, "Exif:DateTimeOriginal", Text),
    (36868, "Exif:DateTimeDigitized", Text),
    (36880, "Exif:OffsetTime", Text),
    (36881, "Exif:OffsetTimeOriginal", Text),
    (36882, "Exif:OffsetTimeDigitized", Text),
    (37122, "Exif:CompressedBitsPerPixel", Fraction),
    (37377, "Exif:ShutterSpeedValue", SignedFraction),
    (37378, "Exif:ApertureValue", Fraction),
    (37379, "Exif:BrightnessValue", SignedFraction),
    (37380, "Exif:ExposureBiasValue", SignedFraction),
    (37381, "Exif:MaxApertureValue", Fraction),
    (37382, "Exif:SubjectDistance", Fraction),
    (37383, "Exif:MeteringMode", Short),
    (37384, "Exif:LightSource", Short),
    (37385, "Exif:Flash", Short),
    (37386, "Exif:FocalLength", Fraction),
    (37396, "Exif:SubjectArea", Short),
    (37510, "Exif:UserComment", Comment),
    (37520, "Exif:SubsecTime", Text),
    (37521, "Exif:SubsecTimeOriginal", Text),
    (37522, "Exif:SubsecTimeDigitized", Text),
    (40960, "Exif:FlashPixVersion", Version),
    (40961, "Exif:ColorSpace", Short),
    (41483, "Exif:FlashEnergy", Fraction),
    (41486, "Exif:FocalPlaneXResolution", Fraction),
    (41487, "Exif:FocalPlaneYResolution", Fraction),
    (41488, "Exif:FocalPlaneResolutionUnit", Short),
    (41492, "Exif:SubjectLocation", Short),
    (41493, "Exif:ExposureIndex", Fraction),
    (41495, "Exif:SensingMethod", Short),
    (41728, "Exif:FileSource", Opaque),
    (41729, "Exif:SceneType", Opaque),
    (41985, "Exif:CustomRendered", Short),
    (41986, "Exif:ExposureMode", Short),
    (41987, "Exif:WhiteBalance", Short),
    (41988, "Exif:DigitalZoomRatio", Fraction),
    (41989, "Exif:FocalLengthIn35mmFilm", Short),
    (41990, "Exif:SceneCaptureType", Short),
    (41991, "Exif:GainControl", Short),
    (41992, "Exif:Contrast", Short),
    (41993, "Exif:Saturation", Short),
    (41994, "Exif:Sharpness", Short),
    (41996, "Exif:SubjectDistanceRange", Short),
    (42016, "Exif:ImageUniqueID", Text),
    (42032, "Exif:CameraOwnerName", Text),
    (42033, "Exif:BodySerialNumber", Text),
    (42034, "Exif:LensSpecification", Fraction),
    (42035, "Exif:LensMake", Text),
    (42036, "Exif:LensModel", Text),
    (42037, "Exif:LensSerialNumber", Text),
];

/// The tags of the position.
#[rustfmt::skip]
pub(super) const POSITION: [Tag; 30] = [
    (0, "GPS:VersionID", Byte),
    (1, "GPS:LatitudeRef", Text),
    (2, "GPS:Latitude", Fraction),
    (3, "GPS:LongitudeRef", Text),
    (4, "GPS:Longitude", Fraction),
    (5, "GPS:AltitudeRef", Byte),
    (6, "GPS:Altitude", Fraction),
    (7, "GPS:TimeStamp", Fraction),
    (8, "GPS:Satellites", Text),
    (9, "GPS:Status", Text),
    (10, "GPS:MeasureMode", Text),
    (11, "GPS:DOP", Fraction),
    (12, "GPS:SpeedRef", Text),
    (13, "GPS:Speed", Fraction),
    (14, "GPS:TrackRef", Text),
    (15, "GPS:Track", Fraction),
    (16, "GPS:ImgDirectionRef", Text),
    (17, "GPS:ImgDirection", Fraction),
    (18, "GPS:MapDatum", Text),
    (19, "GPS:DestLatitudeRef", Text),
    (20, "GPS:DestLatitude", Fraction),
    (21, "GPS:DestLongitudeRef", Text),
    (22, "GPS:DestLongitude", Fraction),
    (23, "GPS:DestBearingRef", Text),
    (24, "GPS:DestBearing", Fraction),
    (25, "GPS:DestDistanceRef", Text),
    (26, "GPS:DestDistance", Fraction),
    (29, "GPS:DateStamp", Text),
    (30, "GPS:Differential", Short),
    (31, "GPS:HPositioningError", Fraction),
];
