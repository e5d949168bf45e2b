// tidy: table
//! All options, in the order of the help. The parser, the help, the man page and the completions are made of it.

/// The action of an option.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Action {
    // Images
    Input,
    SelectLevel,
    DropLevels,
    SelectImage,
    Create,
    Pattern,
    // Files
    Output,
    Type,
    Compression,
    Tile,
    Scanline,
    Planar,
    KeepData,
    // Windows and sizes
    Resize,
    Resample,
    Fit,
    Crop,
    CropToFull,
    Cut,
    Trim,
    Origin,
    OriginOffset,
    FullSize,
    FullPixels,
    Paste,
    Mosaic,
    // Orientation
    Flip,
    Flop,
    Rotate90,
    Rotate180,
    Rotate270,
    Transpose,
    Shift,
    Reorient,
    Orientation,
    Environment,
    // Channels
    Channels,
    AppendChannels,
    ChannelNames,
    ChannelCount,
    ChannelSum,
    ChannelMaximum,
    ChannelMinimum,
    // Arithmetic
    Add,
    AddConstant,
    Subtract,
    SubtractConstant,
    Multiply,
    MultiplyConstant,
    Divide,
    DivideConstant,
    MultiplyAdd,
    AbsoluteDifference,
    AbsoluteDifferenceConstant,
    Minimum,
    MinimumConstant,
    Maximum,
    MaximumConstant,
    Power,
    PowerConstant,
    Absolute,
    Invert,
    Clamp,
    Over,
    Premultiply,
    Unpremultiply,
    Saturate,
    // Colour spaces
    ColorConvert,
    ToColorSpace,
    IsColorSpace,
    DisplayView,
    Look,
    FileTransform,
    // Filters
    Blur,
    Unsharp,
    FixNan,
    Fill,
    Noise,
    // Metadata
    Attribute,
    TextAttribute,
    EraseAttribute,
    Caption,
    Keyword,
    ClearKeywords,
    // The stack
    Duplicate,
    Swap,
    Pop,
    // What is printed
    Info,
    Stats,
    Difference,
    Fail,
    FailPercent,
    HardFail,
    Warn,
    WarnPercent,
    HardWarn,
    Echo,
    // The run
    Frames,
    SkipBadFrames,
    DryRun,
    Update,
    NoClobber,
    CreateFolder,
    Memory,
    Threads,
    ColorConfig,
    Plugins,
    Safe,
    NoFence,
    Verbose,
    Quiet,
}

/// One option.
pub(crate) struct Row {
    pub(crate) action: Action,
    /// The name, without dashes.
    pub(crate) name: &'static str,
    /// Further names.
    pub(crate) aliases: &'static [&'static str],
    /// The names of its values, each a word of the command line.
    pub(crate) values: &'static [&'static str],
    /// The names of its modifiers, written `-name:modifier=value`.
    pub(crate) modifiers: &'static [&'static str],
    /// The number of images that it takes from the stack.
    pub(crate) images: usize,
    pub(crate) about: &'static str,
}

const NONE: &[&str] = &[];

const fn row(
    action: Action,
    name: &'static str,
    values: &'static [&'static str],
    images: usize,
    about: &'static str,
) -> Row {
    Row { action, name, aliases: NONE, values, modifiers: NONE, images, about }
}

impl Row {
    const fn with(self, modifiers: &'static [&'static str]) -> Self {
        Self { modifiers, ..self }
    }

    const fn also(self, aliases: &'static [&'static str]) -> Self {
        Self { aliases, ..self }
    }
}

use Action as A;

/// The options in groups, each with its heading.
pub(crate) const GROUPS: &[(&str, &[Row])] = &[
    ("Images", &[
        row(A::Input, "i", &["FILE"], 0, "Read an image, as a name without an option does; FILE#N is image N of a file").with(&["ch"]),
        row(A::SelectLevel, "selectmip", &["LEVEL"], 1, "Take a MIP level of the file that was read, 0 is the largest"),
        row(A::DropLevels, "unmip", &[], 1, "Take the largest MIP level, which is what is read in any case"),
        row(A::SelectImage, "subimage", &["N"], 1, "Take image N of the file that was read, counted from 0"),
        row(A::Create, "create", &["SIZE", "CHANNELS"], 0, "Make a black image"),
        row(A::Pattern, "pattern", &["NAME", "SIZE", "CHANNELS"], 0, "Make an image: constant, checker, fill or noise").with(&[
            "color", "color1", "color2", "width", "height", "xoffset", "yoffset", "top", "bottom", "left", "right", "topleft",
            "topright", "bottomleft", "bottomright", "type", "mean", "stddev", "min", "max", "value", "portion", "mono", "seed",
        ]),
    ]),
    ("Files that are written", &[
        row(A::Output, "o", &["FILE"], 1, "Write the image; the extension chooses the format")
            .with(&["type", "datatype", "compression", "tile", "scanline", "separate", "format", "fileformatname"]),
        row(A::Type, "d", &["TYPE"], 0, "Type of the values of files that follow: uint8, uint16, uint32, half or float [default: that of the image]"),
        row(A::Compression, "compression", &["NAME"], 0, "Compression of files that follow, by its name in the format; NAME:LEVEL"),
        row(A::Tile, "tile", &["WIDTH", "HEIGHT"], 0, "Store files that follow in tiles of this size"),
        row(A::Scanline, "scanline", &[], 0, "Store files that follow in rows"),
        row(A::Planar, "planarconfig", &["NAME"], 0, "Store channels interleaved (contig), one after the other (separate), or as the format does (default)"),
        row(A::KeepData, "noautocrop", &[], 0, "Write the data window to formats without windows, not the display window"),
    ]),
    ("Windows and sizes", &[
        row(A::Resize, "resize", &["SIZE"], 1, "Give the display window another size: 640x480, 640x0, 50%").with(&["filter"]),
        row(A::Resample, "resample", &["SIZE"], 1, "The same by interpolation between pixels, or by the nearest one with interp=0").with(&["interp"]),
        row(A::Fit, "fit", &["SIZE"], 1, "Resize to the largest size that fits into a window, in its middle").with(&["filter", "pad", "fillmode"]),
        row(A::Crop, "crop", &["WINDOW"], 1, "Set the data window: WxH+X+Y or xmin,ymin,xmax,ymax; new pixels are black"),
        row(A::CropToFull, "croptofull", &[], 1, "Set the data window to the display window"),
        row(A::Cut, "cut", &["WINDOW"], 1, "Take the pixels of a window as an image of their own"),
        row(A::Trim, "trim", &[], 1, "Set the data window to the pixels that are not 0"),
        row(A::Origin, "origin", &["+X+Y"], 1, "Move the data window to a position"),
        row(A::OriginOffset, "originoffset", &["+X+Y"], 1, "Move the data window by a distance"),
        row(A::FullSize, "fullsize", &["WINDOW"], 1, "Set the display window"),
        row(A::FullPixels, "fullpixels", &[], 1, "Set the display window to the data window"),
        row(A::Paste, "paste", &["+X+Y"], 2, "Place the first image over the second one at a position; auto is its own. mergeroi=1 extends the data window").with(&["mergeroi"]),
        row(A::Mosaic, "mosaic", &["WxH"], 0, "Make a contact sheet of the last W x H images").with(&["pad", "fit"]).also(&["contactsheet"]),
    ]),
    ("Orientation and maps of directions", &[
        row(A::Flip, "flip", &[], 1, "Exchange top and bottom"),
        row(A::Flop, "flop", &[], 1, "Exchange left and right"),
        row(A::Rotate90, "rotate90", &[], 1, "Rotate by 90 degrees clockwise"),
        row(A::Rotate180, "rotate180", &[], 1, "Rotate by 180 degrees"),
        row(A::Rotate270, "rotate270", &[], 1, "Rotate by 270 degrees clockwise"),
        row(A::Transpose, "transpose", &[], 1, "Exchange rows and columns"),
        row(A::Shift, "cshift", &["+X+Y"], 1, "Shift pixels; those that leave at one side enter at the other"),
        row(A::Reorient, "reorient", &[], 1, "Turn the image as its metadata Orientation requests"),
        row(A::Orientation, "orientation", &["N"], 1, "Set the metadata Orientation, 1 to 8").also(&["orient"]),
        row(A::Environment, "env", &["FROM:TO"], 1, "Convert a map of all directions: latlong, cube, column, cross, vcross, probe, or faces, six images").with(&["size", "up"]),
    ]),
    ("Channels", &[
        row(A::Channels, "ch", &["LIST"], 1, "Select and order channels: R,G,B or 2,1,0; NAME=R names one, A=1.0 is a constant"),
        row(A::AppendChannels, "chappend", &[], 2, "Append the channels of the second image to those of the first"),
        row(A::ChannelNames, "chnames", &["LIST"], 1, "Name the channels; an empty name keeps the old one"),
        row(A::ChannelCount, "nchannels", &["N"], 1, "Drop channels, or add channels of 0"),
        row(A::ChannelSum, "chsum", &[], 1, "Add the channels to one").with(&["weight"]),
        row(A::ChannelMaximum, "maxchan", &[], 1, "Take the greatest value of all channels as the only channel"),
        row(A::ChannelMinimum, "minchan", &[], 1, "Take the least value of all channels as the only channel"),
    ]),
    ("Arithmetic", &[
        row(A::Add, "add", &[], 2, "Add two images"),
        row(A::AddConstant, "addc", &["VALUES"], 1, "Add a constant, or one for each channel: 0.5 or 0.1,0.2,0.3"),
        row(A::Subtract, "sub", &[], 2, "Subtract the second image from the first"),
        row(A::SubtractConstant, "subc", &["VALUES"], 1, "Subtract constants"),
        row(A::Multiply, "mul", &[], 2, "Multiply two images"),
        row(A::MultiplyConstant, "mulc", &["VALUES"], 1, "Multiply by constants"),
        row(A::Divide, "div", &[], 2, "Divide the first image by the second; the result is 0 where that is 0"),
        row(A::DivideConstant, "divc", &["VALUES"], 1, "Divide by constants"),
        row(A::MultiplyAdd, "mad", &[], 3, "Multiply two images and add a third"),
        row(A::AbsoluteDifference, "absdiff", &[], 2, "Magnitude of the difference of two images"),
        row(A::AbsoluteDifferenceConstant, "absdiffc", &["VALUES"], 1, "Magnitude of the difference from constants"),
        row(A::Minimum, "min", &[], 2, "Lesser value of two images"),
        row(A::MinimumConstant, "minc", &["VALUES"], 1, "Lesser of the value and constants"),
        row(A::Maximum, "max", &[], 2, "Greater value of two images"),
        row(A::MaximumConstant, "maxc", &["VALUES"], 1, "Greater of the value and constants"),
        row(A::Power, "pow", &[], 2, "First image to the power of the second"),
        row(A::PowerConstant, "powc", &["VALUES"], 1, "Power with constant exponents"),
        row(A::Absolute, "abs", &[], 1, "Magnitude"),
        row(A::Invert, "invert", &[], 1, "1 - value, for the first three channels").with(&["chbegin", "chend"]),
        row(A::Clamp, "clamp", &[], 1, "Limit the values [default: to at least 0 and at most 1]").with(&["min", "max", "clampalpha"]),
        row(A::Over, "over", &[], 2, "Composite the first image over the second"),
        row(A::Premultiply, "premult", &[], 1, "Multiply colours by alpha"),
        row(A::Unpremultiply, "unpremult", &[], 1, "Divide colours by alpha"),
        row(A::Saturate, "saturate", &["SCALE"], 1, "Scale the difference of the first three channels from their luminance (Rec. 709)"),
    ]),
    ("Colour spaces", &[
        row(A::ColorConvert, "colorconvert", &["FROM", "TO"], 1, "Convert colours from one space to another: names, aliases or roles of the configuration").with(&["unpremult", "strict"]),
        row(A::ToColorSpace, "tocolorspace", &["SPACE"], 1, "Convert colours to a space from that which the file describes").with(&["unpremult"]),
        row(A::IsColorSpace, "iscolorspace", &["SPACE"], 1, "Set the space of the colours; the values stay as they are"),
        row(A::DisplayView, "ociodisplay", &["DISPLAY", "VIEW"], 1, "Convert colours to a view of a display, as it is stored in files; default is the first one").with(&["from", "unpremult"]),
        row(A::Look, "ociolook", &["LOOKS"], 1, "Apply looks, such as grade,-neutral").with(&["from", "to", "unpremult"]),
        row(A::FileTransform, "ociofiletransform", &["FILE"], 1, "Apply a file of tables or of another transform").with(&["inverse", "unpremult"]),
    ]),
    ("Filters", &[
        row(A::Blur, "blur", &["WxH"], 1, "Blur by a filter of this size in pixels").with(&["kernel"]),
        row(A::Unsharp, "unsharp", &[], 1, "Sharpen by the difference from a blurred image").with(&["kernel", "width", "contrast", "threshold"]),
        row(A::FixNan, "fixnan", &["NAME"], 1, "Replace NaN and infinite values: by 0 (black), or by the mean around them (box3)"),
        row(A::Fill, "fill", &["WINDOW"], 1, "Fill a window with a colour").with(&["color"]),
        row(A::Noise, "noise", &[], 1, "Add noise").with(&["type", "mean", "stddev", "min", "max", "value", "portion", "mono", "seed"]),
    ]),
    ("Metadata", &[
        row(A::Attribute, "attrib", &["NAME", "VALUE"], 1, "Set metadata; a whole number is an int, another number a float").with(&["type"]),
        row(A::TextAttribute, "sattrib", &["NAME", "TEXT"], 1, "Set metadata to a text"),
        row(A::EraseAttribute, "eraseattrib", &["REGEX"], 1, "Erase the metadata whose names match a regular expression"),
        row(A::Caption, "caption", &["TEXT"], 1, "Set the caption (ImageDescription)"),
        row(A::Keyword, "keyword", &["WORD"], 1, "Add a keyword").also(&["keywords"]),
        row(A::ClearKeywords, "clear-keywords", &[], 1, "Erase all keywords"),
    ]),
    ("The stack of images", &[
        row(A::Duplicate, "dup", &[], 1, "Push a copy of the last image"),
        row(A::Swap, "swap", &[], 2, "Exchange the last two images"),
        row(A::Pop, "pop", &[], 1, "Drop the last image"),
    ]),
    ("What is printed", &[
        row(A::Info, "info", &[], 0, "Print the description of the last image, or before any image that of each file").with(&["verbose"]),
        row(A::Stats, "stats", &[], 0, "Print the statistics of the last image, or before any image those of each file"),
        row(A::Difference, "diff", &[], 2, "Compare two images; the exit code is that of idiff"),
        row(A::Fail, "fail", &["D"], 0, "A pixel fails when a value differs by more [default: 0.000001]"),
        row(A::FailPercent, "failpercent", &["P"], 0, "Percentage of pixels that may fail [default: 0]"),
        row(A::HardFail, "hardfail", &["D"], 0, "Fail when any value differs by more"),
        row(A::Warn, "warn", &["D"], 0, "A pixel is warned about when a value differs by more [default: 0.000001]"),
        row(A::WarnPercent, "warnpercent", &["P"], 0, "Percentage of pixels that may be warned about [default: 0]"),
        row(A::HardWarn, "hardwarn", &["D"], 0, "Warn when any value differs by more"),
        row(A::Echo, "echo", &["TEXT"], 0, "Print a text"),
    ]),
    ("The run", &[
        row(A::Frames, "frames", &["LIST"], 0, "Frames of names with # or %04d: 1-24, 1-24x2, 1,5,9 [default: the files that exist]"),
        row(A::SkipBadFrames, "skip-bad-frames", &[], 0, "Go on with the next frame after an error"),
        row(A::DryRun, "n", &[], 0, "Write no files"),
        row(A::Update, "u", &[], 0, "Skip files that are newer than all inputs"),
        row(A::NoClobber, "no-clobber", &[], 0, "Skip files that exist"),
        row(A::CreateFolder, "create-dir", &[], 0, "Make missing folders of files"),
        row(A::Memory, "memory", &["MB"], 0, "Memory limit of operations that hold images, in MiB [default: a quarter of the installed memory]"),
        row(A::Threads, "threads", &["N"], 0, "Number of threads [default: one per core]"),
        row(A::ColorConfig, "colorconfig", &["FILE"], 0, "Configuration of OpenColorIO, a file or ocio://NAME [default: that of $OCIO, else the built-in one]"),
        row(A::Plugins, "plugins", &["PATH"], 0, "A folder of image plugins, or a library, which is used before bundled ones; may be repeated"),
        row(A::Safe, "safe", &[], 0, "For untrusted images: load no plugins, read below the folders of the inputs only"),
        row(A::NoFence, "nofence", &[], 0, ""),
        row(A::Verbose, "v", &[], 0, "Print what is done"),
        row(A::Quiet, "q", &[], 0, "Print only errors and what is requested"),
    ]),
];

/// Returns all rows.
pub(crate) fn rows() -> impl Iterator<Item = &'static Row> {
    GROUPS.iter().flat_map(|(_, rows)| rows.iter())
}

/// Returns the row of a name.
pub(crate) fn find(name: &str) -> Option<&'static Row> {
    rows().find(|row| row.name == name || row.aliases.contains(&name))
}
