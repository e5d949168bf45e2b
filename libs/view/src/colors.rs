//! The colours of a page: what its file says of them, their conversion to linear light, and the view of a display.

use crate::screen_table::ScreenTable;
use granita_base::Params;
use granita_color::{ColorError, Config, Encoding, Primaries, Processor, Transfer};
use granita_image::{ImageSpec, PixelType};

/// The conversion of the colours of a page. Exposure and gamma lie between its two parts.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Managed {
    /// From stored values to linear light.
    pub(crate) to_linear: Processor,
    /// From linear light to the values of a screen; `None` for the encoding of sRGB.
    pub(crate) to_screen: Option<Processor>,
}

/// The colours of a page.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Colors {
    /// What is assumed of the stored values, and why, such as "ICC profile \"Display P3\""; empty where they are no
    /// colours.
    pub text: String,
    /// `None` where integers are those of sRGB, and other values linear with its primaries.
    pub(crate) managed: Option<Managed>,
}

/// What a file says of its colours.
struct Described {
    /// `None` where the file says nothing that is understood.
    encoding: Option<Encoding>,
    /// What could not be used.
    note: Option<String>,
}

/// Well-known primaries.
const GAMUTS: [(Primaries, &str); 7] = [
    (Primaries::REC709, "Rec. 709"),
    (Primaries::AP0, "ACES AP0"),
    (Primaries::AP1, "ACES AP1"),
    (Primaries::REC2020, "Rec. 2020"),
    (Primaries::P3_D65, "P3 (D65)"),
    (Primaries::P3_DCI, "P3 (DCI)"),
    (Primaries::ADOBE_RGB, "Adobe RGB"),
];

/// Returns the primaries of eight chromaticities: those of white at `white`, and of red, green and blue at `red`. Those
/// of well-known primaries, which a file rounds, are exact.
fn primaries(values: &[f32], white: usize, red: usize) -> Option<Primaries> {
    if values.len() != 8 || values.iter().any(|v| !v.is_finite()) {
        return None;
    }
    let at = |i: usize| [f64::from(values[i]), f64::from(values[i + 1])];
    let stored = Primaries { red: at(red), green: at(red + 2), blue: at(red + 4), white: at(white) };
    let known = GAMUTS.iter().find(|(known, _)| known.is_near(&stored, 1e-6));
    Some(known.map_or(stored, |(known, _)| *known))
}

/// Returns the name of well-known primaries.
fn gamut(primaries: &Primaries) -> &'static str {
    let found = GAMUTS.iter().find(|(known, _)| known.is_near(primaries, 1e-3));
    found.map_or("other primaries", |(_, name)| name)
}

/// Returns what the attributes of an image say of its colours. The order is that of the standard of PNG: numbers of
/// ITU-T H.273, ICC profile, sRGB, gamma and chromaticities.
fn described(spec: &ImageSpec) -> Described {
    let attributes = &spec.attributes;
    let mut note = None;
    for name in ["CICP", "png:cICP"] {
        let Some(values) = attributes.floats(name) else { continue };
        let found = <[f32; 4]>::try_from(&*values).ok();
        let encoding = found.and_then(|n| Encoding::cicp(n.map(|v| v as i32), name));
        if encoding.is_some() {
            return Described { encoding, note };
        }
        note = Some(format!("{name} is not known"));
    }
    if let Some(profile) = &spec.icc_profile {
        let name = spec.string("ICCProfile").unwrap_or_default();
        match Encoding::icc(profile, name) {
            Ok(encoding) => return Described { encoding: Some(encoding), note },
            Err(error) => note = Some(format!("\"{name}\" is not applied: {error}")),
        }
    }
    let encoding = by_chunks(attributes)
        .or_else(|| by_chromaticities(attributes))
        .or_else(|| by_interop_id(attributes))
        .or_else(|| by_film(attributes))
        .or_else(|| by_exif(attributes));
    Described { encoding, note }
}

/// Uses chunks of PNG.
fn by_chunks(attributes: &Params) -> Option<Encoding> {
    if attributes.int("png:sRGB").is_some() {
        return Encoding::new(&Primaries::REC709, Transfer::Srgb, "sRGB (PNG chunk sRGB)");
    }
    let gamma = attributes.float("png:gAMA").filter(|gamma| gamma.is_finite() && *gamma > 0.0);
    let points = attributes.floats("png:cHRM").and_then(|values| primaries(&values, 0, 2));
    if gamma.is_none() && points.is_none() {
        return None;
    }
    // The usual 45455 means the curve of sRGB (PNG specification, 11.3.2.5).
    let (transfer, curve) = match gamma {
        None => (Transfer::Srgb, "the curve of sRGB".to_owned()),
        Some(gamma) if (gamma - 0.45455).abs() < 2e-4 => (Transfer::Srgb, "the curve of sRGB".to_owned()),
        Some(gamma) if (gamma - 1.0).abs() < 1e-4 => (Transfer::Linear, "linear".to_owned()),
        Some(gamma) => (Transfer::Gamma(1.0 / f64::from(gamma)), format!("gamma {:.3}", 1.0 / gamma)),
    };
    let primaries = points.unwrap_or(Primaries::REC709);
    let chunks = match (gamma, points) {
        (Some(_), Some(_)) => "PNG chunks gAMA and cHRM",
        (Some(_), None) => "PNG chunk gAMA",
        _ => "PNG chunk cHRM",
    };
    Encoding::new(&primaries, transfer, format!("{}, {curve} ({chunks})", gamut(&primaries)))
}

/// Uses the chromaticities of OpenEXR: red, green, blue and white. Values are linear.
fn by_chromaticities(attributes: &Params) -> Option<Encoding> {
    let primaries = primaries(&attributes.floats("chromaticities")?, 6, 0)?;
    Encoding::new(&primaries, Transfer::Linear, format!("linear, {} (chromaticities)", gamut(&primaries)))
}

/// Uses the names of the Color Interop Forum, which OpenEXR files and OpenImageIO store.
fn by_interop_id(attributes: &Params) -> Option<Encoding> {
    for name in ["colorInteropID", "oiio:ColorSpace"] {
        let Some(id) = attributes.string(name) else { continue };
        let (primaries, transfer) = match &*id.to_ascii_lowercase() {
            "lin_rec709_scene" | "lin_rec709" | "lin_srgb" => (Primaries::REC709, Transfer::Linear),
            "lin_ap0_scene" | "lin_ap0" | "aces2065-1" => (Primaries::AP0, Transfer::Linear),
            "lin_ap1_scene" | "lin_ap1" | "acescg" => (Primaries::AP1, Transfer::Linear),
            "lin_rec2020_scene" | "lin_rec2020" => (Primaries::REC2020, Transfer::Linear),
            "lin_p3d65_scene" | "lin_p3d65" => (Primaries::P3_D65, Transfer::Linear),
            "lin_adobergb_scene" | "lin_adobergb" => (Primaries::ADOBE_RGB, Transfer::Linear),
            "srgb_rec709_scene" | "srgb_rec709_display" | "srgb" | "srgb_texture" => {
                (Primaries::REC709, Transfer::Srgb)
            }
            "srgb_p3d65_scene" | "srgb_p3d65_display" => (Primaries::P3_D65, Transfer::Srgb),
            "srgb_ap1_scene" => (Primaries::AP1, Transfer::Srgb),
            "g18_rec709_scene" => (Primaries::REC709, Transfer::Gamma(1.8)),
            "g22_rec709_scene" | "g22_rec709_display" => (Primaries::REC709, Transfer::Gamma(2.2)),
            "g24_rec709_scene" | "g24_rec709_display" => (Primaries::REC709, Transfer::Gamma(2.4)),
            "g22_ap1_scene" => (Primaries::AP1, Transfer::Gamma(2.2)),
            "g22_adobergb_scene" => (Primaries::ADOBE_RGB, Transfer::Gamma(563.0 / 256.0)),
            "g26_p3d65_display" => (Primaries::P3_D65, Transfer::Gamma(2.6)),
            "pq_rec2020_display" => (Primaries::REC2020, Transfer::Pq),
            "pq_p3d65_display" => (Primaries::P3_D65, Transfer::Pq),
            "hlg_rec2020_display" => (Primaries::REC2020, Transfer::Hlg),
            _ => continue,
        };
        return Encoding::new(&primaries, transfer, format!("{id} ({name})"));
    }
    None
}

/// Uses the transfer characteristic of DPX, and the densities of Cineon.
fn by_film(attributes: &Params) -> Option<Encoding> {
    let word = attributes.string("dpx:Transfer");
    let (transfer, text) = match word.map(|word| &**word) {
        Some("Printing density" | "Logarithmic" | "ADX") => {
            (Transfer::Film, "film densities, white 685, black 95")
        }
        Some("Linear") => (Transfer::Linear, "linear"),
        Some("SMPTE 274M" | "ITU-R 709-4" | "ITU-R 601-5 system B or G" | "ITU-R 601-5 system M") => {
            (Transfer::Rec709, "the curve of BT.709")
        }
        _ if attributes.iter().any(|param| param.name.starts_with("cineon:")) => {
            (Transfer::Film, "film densities, white 685, black 95")
        }
        _ => return None,
    };
    let source = word.map_or_else(|| "Cineon".to_owned(), |word| format!("DPX: {word}"));
    Encoding::new(&Primaries::REC709, transfer, format!("Rec. 709, {text} ({source})"))
}

/// Uses the colour space of Exif (CIPA DC-008), and that of the design rule for camera files.
fn by_exif(attributes: &Params) -> Option<Encoding> {
    let adobe = attributes.string("Exif:InteroperabilityIndex").is_some_and(|index| index.starts_with("R03"));
    match attributes.int("Exif:ColorSpace") {
        Some(1) => Encoding::new(&Primaries::REC709, Transfer::Srgb, "sRGB (Exif)"),
        Some(2) => Encoding::new(&Primaries::ADOBE_RGB, Transfer::Gamma(563.0 / 256.0), "Adobe RGB (Exif)"),
        _ if adobe => {
            Encoding::new(&Primaries::ADOBE_RGB, Transfer::Gamma(563.0 / 256.0), "Adobe RGB (Exif)")
        }
        _ => None,
    }
}

/// True when the values of an image are encoded integers, if its file says nothing.
fn are_integers(spec: &ImageSpec) -> bool {
    matches!(spec.pixel_type, PixelType::U8 | PixelType::U16)
}

/// Returns the encoding that is assumed of a file that says nothing.
fn assumed(spec: &ImageSpec) -> Option<Encoding> {
    match are_integers(spec) {
        true => Encoding::new(&Primaries::REC709, Transfer::Srgb, "sRGB (assumed of integers)"),
        false => Encoding::new(&Primaries::REC709, Transfer::Linear, "linear, Rec. 709 (assumed)"),
    }
}

impl Colors {
    /// Returns the colours of an image, to be shown on an sRGB screen.
    pub(crate) fn of(spec: &ImageSpec) -> Self {
        let found = described(spec);
        let is_plain = |encoding: &Encoding| match are_integers(spec) {
            true => encoding.is_srgb(),
            false => encoding.to_linear(&Primaries::REC709).is_identity(),
        };
        let managed = found
            .encoding
            .as_ref()
            .filter(|encoding| !is_plain(encoding))
            .map(|encoding| Managed { to_linear: encoding.to_linear(&Primaries::REC709), to_screen: None });
        let encoding = found.encoding.or_else(|| assumed(spec));
        let text = encoding.map_or_else(String::new, |encoding| encoding.text);
        Self { text: noted(text, found.note), managed }
    }

    /// Returns what is assumed of the colours of an image in a file of this name, and the conversion of its values to
    /// linear light: to that of the view's configuration, or with the primaries of Rec. 709 without a view. Integers
    /// are fractions of the largest one.
    pub fn to_linear(spec: &ImageSpec, viewing: Option<&Viewing>, file: &str) -> (String, Processor) {
        if let Some(viewing) = viewing {
            let colors = viewing.colors(spec, file);
            return (
                colors.text,
                colors.managed.map_or_else(Processor::identity, |managed| managed.to_linear),
            );
        }
        let found = described(spec);
        let Some(encoding) = found.encoding.or_else(|| assumed(spec)) else {
            return (String::new(), Processor::identity());
        };
        let processor = encoding.to_linear(&Primaries::REC709);
        (noted(encoding.text, found.note), processor)
    }

    /// Returns the colours of values that the user declares as sRGB, or as linear.
    pub(crate) fn chosen(encoded: bool) -> Self {
        let text = if encoded { "sRGB (chosen)" } else { "linear, Rec. 709 (chosen)" };
        Self { text: text.to_owned(), managed: None }
    }
}

fn noted(text: String, note: Option<String>) -> String {
    match note {
        Some(note) => format!("{text}; {note}"),
        None => text,
    }
}

/// The conversion of images, as their files describe their colours, to one space of a configuration.
#[derive(Clone, Debug)]
pub struct InputColors {
    config: Config,
    /// The space to which images are converted.
    to: String,
    /// The primaries of a space of the configuration, and its conversion to `to`.
    interchange: Option<(Primaries, Processor)>,
}

impl InputColors {
    /// Returns the conversion to a space.
    ///
    /// # Errors
    /// Returns an error for a space that the configuration does not have, and for transforms that are not supported.
    pub fn new(config: Config, to: &str) -> Result<Self, ColorError> {
        config.processor(to, to)?;
        let candidates = [
            ("aces_interchange", Primaries::AP0),
            ("lin_ap0_scene", Primaries::AP0),
            ("ACES2065-1", Primaries::AP0),
            ("lin_rec709_scene", Primaries::REC709),
            ("lin_rec709", Primaries::REC709),
            ("lin_srgb", Primaries::REC709),
        ];
        let interchange = candidates.iter().find_map(|(name, primaries)| {
            let processor = config.processor(name, to).ok()?;
            Some((*primaries, processor))
        });
        Ok(Self { config, to: to.to_owned(), interchange })
    }

    /// Returns what is known of the colours of an image in a file of this name, and the processor of its pixels. What
    /// the file says comes first, then the rules of the configuration, then sRGB for integers and Rec. 709 for other
    /// values.
    pub fn of(&self, spec: &ImageSpec, file: &str) -> (String, Processor) {
        // A space that -iscolorspace sets, where nothing else describes the colours.
        if let Some(space) = spec.string("oiio:ColorSpace")
            && spec.attributes.iter().filter(|param| granita_image::is_about_colors(&param.name)).count() == 1
            && let Ok(processor) = self.config.processor(space, &self.to)
        {
            return (format!("{space} (oiio:ColorSpace)"), processor);
        }
        let found = described(spec);
        let own = found.encoding;
        // The rules of a configuration apply to files that say nothing.
        let by_rule = || {
            let space = self.config.space_of_file(file).filter(|_| !self.config.is_built_in())?;
            let processor = self.config.processor(space, &self.to).ok()?;
            Some((format!("{space} (rule of the configuration)"), processor))
        };
        let (text, processor) = match (own, &self.interchange) {
            (Some(encoding), Some((primaries, to_space))) => {
                (encoding.text.clone(), encoding.to_linear(primaries).then(to_space))
            }
            (own, interchange) => match (by_rule(), interchange, assumed(spec)) {
                (Some(found), ..) => found,
                (None, Some((primaries, to_space)), Some(encoding)) => {
                    (encoding.text.clone(), encoding.to_linear(primaries).then(to_space))
                }
                _ => {
                    let unused =
                        own.map_or_else(String::new, |encoding| format!("; {} is not used", encoding.text));
                    (format!("{} (assumed){unused}", self.to), Processor::identity())
                }
            },
        };
        (noted(text, found.note), processor)
    }
}

/// A view of a display of a configuration, through which images are seen.
#[derive(Clone, Debug)]
pub struct Viewing {
    /// The colour space of all images, where the user names one.
    space: Option<String>,
    display: String,
    view: String,
    to_screen: Processor,
    /// True for a view of data, which shows stored values.
    shows_data: bool,
    /// The conversion of images to the space of linear light in which exposure and gamma are applied.
    inputs: InputColors,
}

impl Viewing {
    /// Returns a view of a display; the first ones without names. `space` is the colour space of all images.
    ///
    /// # Errors
    /// Returns an error for names that the configuration does not have, for transforms that are not supported, and for
    /// a configuration without a space of linear light.
    pub fn new(
        config: Config,
        space: Option<&str>,
        display: Option<&str>,
        view: Option<&str>,
    ) -> Result<Self, ColorError> {
        let display = display.unwrap_or(config.default_display()).to_owned();
        let view = view.unwrap_or(config.default_view(&display)).to_owned();
        let working =
            config.scene_linear().or_else(|| config.color_spaces().find(|s| s.is_linear()).map(|s| &*s.name));
        let Some(working) = working.map(str::to_owned) else {
            return Err(ColorError::Misuse { what: format!("{} has no role scene_linear", config.place()) });
        };
        let to_screen = config.display_processor(&working, &display, &view)?;
        if let Some(space) = space {
            config.processor(space, &working)?;
        }
        let shows_data = config.shows_data(&display, &view);
        let inputs = InputColors::new(config, &working)?;
        let space = space.map(str::to_owned);
        Ok(Self { space, display, view, to_screen, shows_data, inputs })
    }

    /// Returns the same for another display or view.
    ///
    /// # Errors
    /// Returns the errors of [`Viewing::new`].
    pub fn with_view(&self, display: &str, view: Option<&str>) -> Result<Self, ColorError> {
        Self::new(self.inputs.config.clone(), self.space.as_deref(), Some(display), view)
    }

    /// Returns the configuration.
    pub fn config(&self) -> &Config {
        &self.inputs.config
    }

    /// Returns the display.
    pub fn display(&self) -> &str {
        &self.display
    }

    /// Returns the view.
    pub fn view(&self) -> &str {
        &self.view
    }

    /// Returns the conversion of linear light to the screen as a table.
    pub fn table(&self) -> ScreenTable {
        ScreenTable::new(&self.to_screen)
    }

    /// Returns the colours of an image in a file of this name, to be seen through the view.
    pub(crate) fn colors(&self, spec: &ImageSpec, file: &str) -> Colors {
        let through = |to_linear: Processor| {
            let to_linear = if self.shows_data { Processor::identity() } else { to_linear };
            Some(Managed { to_linear, to_screen: Some(self.to_screen.clone()) })
        };
        let seen = |text: String| format!("{text}; seen through {}, {}", self.display, self.view);
        if let Some(space) = &self.space
            && let Ok(processor) = self.inputs.config.processor(space, &self.inputs.to)
        {
            return Colors { text: seen(format!("{space} (-colorspace)")), managed: through(processor) };
        }
        let (text, processor) = self.inputs.of(spec, file);
        Colors { text: seen(text), managed: through(processor) }
    }
}

#[cfg(test)]
mod tests;
