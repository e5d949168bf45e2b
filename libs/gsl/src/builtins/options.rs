// tidy: table
//! The optional arguments of functions and statements, with one row per name.

use super::Choice;
use crate::ir::ValueType::{self, Color as C, Float as F, Point as P, String as S, Vector as V};

const fn o(name: &'static str, ty: ValueType, default: &'static str, help: &'static str) -> Choice {
    Choice { name, ty, array: None, output: false, default, help }
}
const fn out(name: &'static str, ty: ValueType, help: &'static str) -> Choice {
    Choice { name, ty, array: None, output: true, default: "", help }
}

/// The options of `texture` and `texture3d`.
pub(super) const TEXTURE: &[Choice] = &[
    o(
        "blur",
        F,
        "0",
        "The full width of a blur in both directions, as a fraction of the map: 0.5 is half of it.",
    ),
    o("sblur", F, "0", "The blur along s alone (`texture3d`: to the right)."),
    o("tblur", F, "0", "The blur along t alone (`texture3d`: downward and to the back)."),
    o(
        "width",
        F,
        "1",
        "Scales the filtered area that follows from the differences between points. 0 is a lookup without it.",
    ),
    o("swidth", F, "1", "Scales the area along s alone."),
    o("twidth", F, "1", "Scales the area along t alone."),
    o(
        "wrap",
        S,
        "\"default\"",
        "The content beyond the map: \"black\", \"periodic\", \"clamp\" or \"mirror\". \"default\" and an empty string \
         stand for the mode in the file. So does any other word, with a warning.",
    ),
    o("swrap", S, "\"default\"", "The same along s alone."),
    o("twrap", S, "\"default\"", "The same along t alone."),
    o(
        "firstchannel",
        F,
        "0",
        "The index of the first channel that is looked up, rounded down. A negative number stands for 0.",
    ),
    o("fill", F, "0", "The value of channels that the file does not have."),
    out("alpha", F, "Receives the channel after those of the result; 0 where the file cannot be read."),
];

/// The options of `environment`. "sample" and "direction" are not in the reference.
pub(super) const ENVIRONMENT: &[Choice] = &[
    o(
        "angle",
        F,
        "",
        "The half angle in radians of the cone of directions that are averaged. It replaces \"blur\". Without both, \
         reflections are sharp.",
    ),
    o("blur", F, "0", "The full angle of that cone in quarters of a turn: 1 is 90 degrees."),
    o(
        "sblur",
        F,
        "0",
        "The same around the axis of a map alone. Rays take the mean of \"sblur\" and \"tblur\".",
    ),
    o("tblur", F, "0", "The same towards the poles of a map alone."),
    o(
        "width",
        F,
        "1",
        "Scales the filtered solid angle (or the spread of rays) that follows from the differences between points.",
    ),
    o(
        "swidth",
        F,
        "1",
        "Scales it around the axis of a map alone. Rays take the mean of \"swidth\" and \"twidth\".",
    ),
    o("twidth", F, "1", "Scales it towards the poles of a map alone."),
    o("firstchannel", F, "0", "Maps only: the index of the first channel that is looked up, rounded down."),
    o("fill", F, "0", "Maps only: the value of channels that the file does not have."),
    o(
        "Kr",
        F,
        "1",
        "Rays only: the factor that the shader multiplies the result by. Where it is 0, no ray is traced. Where it is \
         little (`ray:minweight`), some rays are. It does not scale the result.",
    ),
    o(
        "space",
        S,
        "\"common\"",
        "Maps only: the coordinate system of the map, usually \"world\". The position and the direction are \
         transformed to it.",
    ),
    o(
        "radius",
        F,
        "0",
        "Maps only: the radius of the sphere that the map is seen on, around the origin of \"space\", in its units. \
         Positions then matter (parallax). 0 is an infinite radius.",
    ),
    o(
        "up",
        S,
        "\"\"",
        "Maps by latitude and longitude only: the axis to the upper edge, \"y\" or \"z\". Without it, the file decides.",
    ),
    o(
        "samples",
        F,
        "1",
        "Rays only, and with \"sample\": the number of rays or directions for each point, from 1 to 65536.",
    ),
    o(
        "sample",
        F,
        "",
        "Maps only: the index (from 0) of one of \"samples\" directions that are drawn by the brightness of the map. \
         The result is its share of the light of the whole map: radiance over pdf (1/sr) over \"samples\".",
    ),
    o(
        "bias",
        F,
        "-1",
        "Rays only: hits nearer than this distance do not count. Below 0 it is the attribute `shadow:bias`.",
    ),
    o(
        "maxhitdist",
        F,
        "0",
        "Rays only: hits farther than this distance in \"common\" units do not count. At most 0 is no limit.",
    ),
    o(
        "shade",
        F,
        "1",
        "Rays only: 0 does not run the shaders of the objects that are hit, and gives no colour.",
    ),
    out("direction", V, "With \"sample\": receives the unit direction that the light comes from."),
    out(
        "alpha",
        F,
        "Receives the channel after those of the result; for rays, the mean opacity of the hits (0: nothing is hit).",
    ),
    out("hitdist", F, "Receives the mean distance of the hits; 1e38 for maps and where nothing is hit."),
    out("Phit", P, "Rays only: receives the mean position of the hits, (0, 0, 0) where nothing is hit."),
    out("Nhit", V, "Rays only: receives the mean normal of the hits, (0, 0, 0) where nothing is hit."),
];

/// The options of `shadow`. "angle" is not in the reference.
pub(super) const SHADOW: &[Choice] = &[
    o(
        "blur",
        F,
        "0",
        "Maps: the full width of a blur as a fraction of the map. Rays: the full angle of the cone towards the light in \
         quarters of a turn (1 is 90 degrees).",
    ),
    o("sblur", F, "0", "The blur along s of a map alone. Rays take the mean of \"sblur\" and \"tblur\"."),
    o("tblur", F, "0", "The blur along t of a map alone."),
    o("width", F, "1", "Scales the area that follows from the differences between points."),
    o(
        "swidth",
        F,
        "1",
        "Scales the area along s of a map alone. Rays take the mean of \"swidth\" and \"twidth\".",
    ),
    o("twidth", F, "1", "Scales the area along t of a map alone."),
    o(
        "samples",
        F,
        "1",
        "The number of rays for each point, or of samples of a map, at most 65536. A map takes 16 to 4096 samples.",
    ),
    o(
        "bias",
        F,
        "-1",
        "Maps: the distance in \"common\" units that is added to depths. Rays: hits nearer than this do not count. Below \
         0 it is the attribute `shadow:bias`.",
    ),
    o(
        "angle",
        F,
        "",
        "Rays only: the half angle in radians of the cone towards the light. It replaces \"blur\". Without both, it is \
         half of the spread of an `emit` with an axis and a spread.",
    ),
];

/// The options of `occlusion`. "filename" is in the listings of 10.4 only. "distribution" is that of `trace` and
/// determines which portion is computed.
pub(super) const OCCLUSION: &[Choice] = &[
    o(
        "samples",
        F,
        "1",
        "The largest number of rays for each sampled point, from 1 to 65536. Useful numbers begin at 16.",
    ),
    o(
        "adaptive",
        F,
        "1",
        "Above 0 and with 16 samples or more, a quarter of the rays is traced first, and the rest only where they \
         disagree. Larger numbers save more rays. 0 traces all.",
    ),
    o(
        "maxerror",
        F,
        "-1",
        "The error that values are interpolated within. 0 samples every point. Below 0 it is the attribute \
         `FUNCTION:maxerror`.",
    ),
    o(
        "maxpixeldist",
        F,
        "-1",
        "The largest distance in pixels of interpolated points. 0 samples every point. Below 0 it is the attribute \
         `FUNCTION:maxpixeldist`.",
    ),
    o(
        "bias",
        F,
        "-1",
        "Hits nearer than this distance do not count. Below 0 it is the attribute `shadow:bias`.",
    ),
    o(
        "maxhitdist",
        F,
        "0",
        "Hits farther than this distance in \"common\" units do not count. At most 0 is no limit.",
    ),
    o("falloff", F, "0", "The decrease of the influence of hits with their distance; at most 0 is none."),
    o(
        "falloffmode",
        F,
        "0",
        "The kind of decrease: 0 is `exp (-falloff * distance)`, 1 is `pow (1 - distance / maxhitdist, falloff)`.",
    ),
    o(
        "filename",
        S,
        "\"\"",
        "The spatial database of the records. Without it, it is the attribute `FUNCTION:spatialdb`.",
    ),
    o(
        "filemode",
        S,
        "\"\"",
        "The mode of the database: \"r\", \"w\", \"rw\", \"ro\", \"wo\", or the empty string for that of the attributes \
         `spatialdb:*`.",
    ),
    o(
        "distribution",
        S,
        "\"cosine\"",
        "\"cosine\" weights directions by the cosine with the axis, \"uniform\" by their solid angle. Any other word \
         stands for \"cosine\".",
    ),
];

/// The options of `indirect`, which are those of `occlusion` except the last one.
pub(super) const GATHER: &[Choice] = OCCLUSION.split_at(10).0;

/// The options of `subsurface`. "model" is not in the reference.
pub(super) const SUBSURFACE: &[Choice] = &[
    o(
        "scattering",
        C,
        "(2.19, 2.62, 3)",
        "The reduced scattering coefficient per unit of length of the database; the default is that of marble per \
         millimetre.",
    ),
    o("absorption", C, "(0.0021, 0.0041, 0.0071)", "The absorption coefficient in the same unit."),
    o("eta", F, "1.5", "The index of refraction of the material, 1 or more."),
    o(
        "maxsolidangle",
        F,
        "1",
        "The largest solid angle in steradians at which a group of records counts as one. Smaller is slower and more \
         accurate.",
    ),
    o(
        "model",
        S,
        "\"dipole\"",
        "The diffusion profile: \"dipole\" or \"beam\" (sharper, and truer where light is absorbed).",
    ),
];

/// The options of `spatialdbsave`.
pub(super) const SAVE: &[Choice] = &[
    o(
        "interpolate",
        F,
        "0",
        "Not 0: one record in the centre of each facet between four points, the mean of these, instead of one at each \
         point. Facets with a point where the call does not run are left out.",
    ),
    o(
        "filemode",
        S,
        "\"\"",
        "The mode of the database: \"w\", \"rw\", \"wo\", or the empty string for an earlier mode of the shader, else that \
         of the attributes `spatialdb:*`.",
    ),
    Choice {
        name: "resolution",
        ty: F,
        array: Some(2),
        output: false,
        default: "",
        help: "For a database over (s, t) whose name has the extension of an image format: the width and height of that \
               image in pixels.",
    },
    o(
        "filedataformat",
        S,
        "\"\"",
        "The numbers of that image: \"8\", \"16\", \"half\" or \"float\"; empty for the format's own.",
    ),
    o(
        "writefilterwidth",
        F,
        "2",
        "The largest width in pixels of the filter that fills gaps between records; at least 2.",
    ),
];

/// The options of `spatialdbquery`.
pub(super) const QUERY: &[Choice] = &[
    o(
        "maxerror",
        F,
        "0.25",
        "Records with a larger error do not count (\"areadensity\": `1 / maxerror^2` records are taken).",
    ),
    o("maxdist", F, "1", "Records farther than this distance do not count, in the units of the key."),
    o("minsamples", F, "3", "The smallest number of records that gives a result; at least 1."),
    o(
        "filter",
        S,
        "\"value\"",
        "\"value\" interpolates the values, \"areadensity\" returns their sum per area.",
    ),
    o(
        "filemode",
        S,
        "\"\"",
        "The mode of the database: \"r\", \"rw\", \"ro\", or the empty string for an earlier mode of the shader, else that \
         of the attributes `spatialdb:*`.",
    ),
];

/// The options of `aastep`.
pub(super) const STEP: &[Choice] = &[
    o("width", F, "1", "Scales the width of the filter."),
    o("filter", S, "\"catmull-rom\"", "The filter: \"catmull-rom\", \"box\", \"triangle\" or \"gaussian\"."),
];

/// The options of the `trace` statement.
pub(crate) const TRACE: &[Choice] = &[
    o(
        "bias",
        F,
        "-1",
        "Hits nearer than this distance do not count. Below 0 it is the attribute `shadow:bias`.",
    ),
    o(
        "maxhitdist",
        F,
        "0",
        "Hits farther than this distance in \"common\" units do not count. At most 0 is no limit.",
    ),
    o(
        "distribution",
        S,
        "\"cosine\"",
        "\"cosine\" distributes rays by the cosine with the axis, \"uniform\" evenly over the solid angle. Any other word \
         stands for \"cosine\".",
    ),
    o(
        "shade",
        F,
        "1",
        "0 does not run the shaders of the objects that are hit. \"Cl\" is then black, and \"Ol\" is 1 at hits.",
    ),
];
