//! Numbers of the TIFF 6.0 specification, its supplements and the texture tags of reference 9.2.

pub(crate) const NEW_SUBFILE_TYPE: u16 = 254;
pub(crate) const IMAGE_WIDTH: u16 = 256;
pub(crate) const IMAGE_LENGTH: u16 = 257;
pub(crate) const BITS_PER_SAMPLE: u16 = 258;
pub(crate) const COMPRESSION: u16 = 259;
pub(crate) const PHOTOMETRIC: u16 = 262;
pub(crate) const FILL_ORDER: u16 = 266;
pub(crate) const DOCUMENT_NAME: u16 = 269;
pub(crate) const IMAGE_DESCRIPTION: u16 = 270;
pub(crate) const MAKE: u16 = 271;
pub(crate) const MODEL: u16 = 272;
pub(crate) const STRIP_OFFSETS: u16 = 273;
pub(crate) const ORIENTATION: u16 = 274;
pub(crate) const SAMPLES_PER_PIXEL: u16 = 277;
pub(crate) const ROWS_PER_STRIP: u16 = 278;
pub(crate) const STRIP_BYTE_COUNTS: u16 = 279;
pub(crate) const X_RESOLUTION: u16 = 282;
pub(crate) const Y_RESOLUTION: u16 = 283;
pub(crate) const PLANAR_CONFIG: u16 = 284;
pub(crate) const X_POSITION: u16 = 286;
pub(crate) const Y_POSITION: u16 = 287;
pub(crate) const RESOLUTION_UNIT: u16 = 296;
pub(crate) const SOFTWARE: u16 = 305;
pub(crate) const DATE_TIME: u16 = 306;
pub(crate) const ARTIST: u16 = 315;
pub(crate) const HOST_COMPUTER: u16 = 316;
pub(crate) const PREDICTOR: u16 = 317;
pub(crate) const COLOR_MAP: u16 = 320;
pub(crate) const TILE_WIDTH: u16 = 322;
pub(crate) const TILE_LENGTH: u16 = 323;
pub(crate) const TILE_OFFSETS: u16 = 324;
pub(crate) const TILE_BYTE_COUNTS: u16 = 325;
pub(crate) const INK_SET: u16 = 332;
pub(crate) const EXTRA_SAMPLES: u16 = 338;
pub(crate) const SAMPLE_FORMAT: u16 = 339;
pub(crate) const JPEG_TABLES: u16 = 347;
pub(crate) const YCBCR_COEFFICIENTS: u16 = 529;
pub(crate) const YCBCR_SUBSAMPLING: u16 = 530;
pub(crate) const REFERENCE_BLACK_WHITE: u16 = 532;
pub(crate) const XMP: u16 = 700;
pub(crate) const FULL_WIDTH: u16 = 33300;
pub(crate) const FULL_LENGTH: u16 = 33301;
pub(crate) const TEXTURE_FORMAT: u16 = 33302;
pub(crate) const WRAP_MODES: u16 = 33303;
pub(crate) const FOV_COT: u16 = 33304;
pub(crate) const WORLD_TO_SCREEN: u16 = 33305;
pub(crate) const WORLD_TO_CAMERA: u16 = 33306;
pub(crate) const COPYRIGHT: u16 = 33432;

/// The metadata strings, as tag and name of the attribute.
pub(crate) const STRINGS: [(u16, &str); 12] = [
    (DOCUMENT_NAME, "DocumentName"),
    (IMAGE_DESCRIPTION, "ImageDescription"),
    (MAKE, "Make"),
    (MODEL, "Model"),
    (SOFTWARE, "software"),
    (DATE_TIME, "DateTime"),
    (ARTIST, "Artist"),
    (HOST_COMPUTER, "HostComputer"),
    (XMP, "XMP"),
    (TEXTURE_FORMAT, "textureformat"),
    (WRAP_MODES, "wrapmodes"),
    (COPYRIGHT, "copyright"),
];

/// The matrices, as tag and name of the attribute.
pub(crate) const MATRICES: [(u16, &str); 2] =
    [(WORLD_TO_SCREEN, "worldtoscreen"), (WORLD_TO_CAMERA, "worldtocamera")];

pub(crate) const T4_OPTIONS: u16 = 292;
pub(crate) const EXIF_IFD: u16 = 34665;
pub(crate) const GPS_IFD: u16 = 34853;
pub(crate) const ICC_PROFILE: u16 = 34675;
pub(crate) const IPTC: u16 = 33723;
