//! Converts values to screen colours by exposure, gamma, choice of channels, false colours and marks.

use crate::colors::{Colors, Managed};
use crate::layers::{Layer, Meaning};
use crate::maps::ColorMap;
use crate::tile::Pick;
use granita_base::hash;
use granita_color::{Processor, srgb_decode, srgb_encode};
use std::sync::Arc;

/// The colour of the screen beside an image.
pub const BESIDE: [u8; 4] = [34, 34, 36, 255];

/// The visible channels of a layer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Channels {
    /// Red, green and blue as a colour.
    #[default]
    Color,
    /// The first channel of the colour, in grey.
    Red,
    /// The second channel of the colour, in grey.
    Green,
    /// The third channel of the colour, in grey.
    Blue,
    /// Alpha, in grey.
    Alpha,
    /// The Rec. 709 luminance of the colour, in grey.
    Luminance,
    /// A channel of the image by its index, in grey.
    One(usize),
}

/// The background of an image with alpha.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Background {
    /// No background. Alpha is ignored.
    #[default]
    Ignored,
    /// Black.
    Black,
    /// Mid grey.
    Grey,
    /// White.
    White,
    /// Two greys, in squares of 16 pixels of the screen.
    Checker,
}

/// The marks over pixels with special values.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Marks {
    /// No marks.
    Off,
    /// Marks NaN (magenta), infinity (yellow) and negative infinity (green).
    #[default]
    Broken,
    /// Also marks negative values (blue).
    Negative,
}

/// The false colours of one value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FalseColor {
    /// The colours.
    pub map: ColorMap,
    /// The value at the lower end of the map.
    pub low: f32,
    /// The value at the upper end.
    pub high: f32,
    /// True for a logarithmic scale.
    pub log: bool,
}

/// The conversion of values to screen colours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Display {
    /// The exposure in stops. Values are multiplied by 2 to this power.
    pub exposure: f32,
    /// The gamma. Exposed values are raised to its inverse.
    pub gamma: f32,
    /// True when the result is encoded for an sRGB screen. Otherwise it is shown linearly.
    pub srgb: bool,
    /// The visible channels.
    pub channels: Channels,
    /// The false colours of one value, which replace the colours themselves.
    pub false_color: Option<FalseColor>,
    /// The values of black and white, instead of 0 and 1, without encoding. The first may be the larger.
    pub range: Option<(f32, f32)>,
    /// The marked values.
    pub marks: Marks,
    /// The background.
    pub background: Background,
}

impl Default for Display {
    fn default() -> Self {
        Self {
            exposure: 0.0,
            gamma: 1.0,
            srgb: true,
            channels: Channels::default(),
            false_color: None,
            range: None,
            marks: Marks::default(),
            background: Background::default(),
        }
    }
}

/// Returns the Rec. 709 luminance.
pub fn luminance([r, g, b]: [f32; 3]) -> f32 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

impl Display {
    /// Returns the sources of the four values of a pixel, for a layer.
    pub fn pick(&self, layer: &Layer) -> [Pick; 4] {
        let alpha = layer.alpha.map_or(Pick::Value(1.0), Pick::Channel);
        let one = |pick: Pick| [pick, pick, pick, Pick::Value(1.0)];
        match self.channels {
            Channels::Color | Channels::Luminance => [layer.color[0], layer.color[1], layer.color[2], alpha],
            Channels::Red => one(layer.color[0]),
            Channels::Green => one(layer.color[1]),
            Channels::Blue => one(layer.color[2]),
            Channels::Alpha => one(alpha),
            Channels::One(c) => one(Pick::Channel(c)),
        }
    }
}

/// The number of low bits of a float that are dropped to find its cell.
const SHIFT: u32 = 12;
/// The smallest and the largest value with a cell of its own, 2^-24 and 2^24.
const LEAST: f32 = 1.0 / 16_777_216.0;
const MOST: f32 = 16_777_216.0;

/// A table of a function of positive floats, with 2048 cells for each factor of two.
#[derive(Clone, Debug)]
struct Table<T>(Vec<T>);

/// The bits of the value at which the cell before the first one begins. Smaller values count as 0.
const BELOW: u32 = LEAST.to_bits() - (1 << SHIFT);

impl<T: Copy> Table<T> {
    fn new(f: impl Fn(f32) -> T) -> Self {
        let (first, last) = (LEAST.to_bits() >> SHIFT, MOST.to_bits() >> SHIFT);
        let mut cells = Vec::with_capacity((last - first) as usize + 2);
        cells.push(f(0.0));
        cells.extend((first..last).map(|cell| f(f32::from_bits((cell << SHIFT) + (1 << (SHIFT - 1))))));
        cells.push(f(f32::INFINITY));
        Self(cells)
    }

    /// Returns the value of the function. Values below all cells, negative values and NaN count as 0. Values above all
    /// cells count as infinity.
    #[inline]
    fn get(&self, v: f32) -> T {
        if v >= MOST {
            self.0[self.0.len() - 1]
        } else if v >= LEAST {
            self.0[((v.to_bits() - LEAST.to_bits()) >> SHIFT) as usize + 1]
        } else {
            self.0[0]
        }
    }

    /// Returns the same for a value that is neither negative nor NaN.
    #[inline]
    fn get_positive(&self, v: f32) -> T {
        self.0[((v.to_bits().clamp(BELOW, MOST.to_bits()) - BELOW) >> SHIFT) as usize]
    }
}

/// The parameters of a table: the bits of the exposure and of gamma, true when the screen is encoded, and true when the
/// stored values are.
type TableKey = (u32, u32, bool, bool);

/// The tables that were made last. Consecutive frames use the same ones.
#[derive(Clone, Debug, Default)]
pub struct Tables(Vec<(TableKey, Arc<Table<u8>>)>);

impl Tables {
    /// The number of tables that are kept.
    const KEPT: usize = 4;

    /// Returns the table for `key`. Makes it when it does not exist.
    fn get(&mut self, key: TableKey, make: impl FnOnce() -> Table<u8>) -> Arc<Table<u8>> {
        if let Some((_, table)) = self.0.iter().find(|(k, _)| *k == key) {
            return table.clone();
        }
        let table = Arc::new(make());
        self.0.truncate(Self::KEPT - 1);
        self.0.insert(0, (key, table.clone()));
        table
    }
}

/// A [`Display`] prepared for many pixels of one kind.
#[derive(Clone, Debug)]
pub struct Prepared {
    display: Display,
    /// Maps a stored value to the byte on the screen.
    shown: Arc<Table<u8>>,
    /// True when colours are converted by the table alone, except where alpha is used.
    plain: bool,
    /// True when stored values are encoded.
    encoded: bool,
    /// True when colours are not yet multiplied by alpha.
    unassociated: bool,
    /// True for depths, whose infinite values are not marked.
    depth: bool,
    /// True for numbers of objects, each of which has a colour of its own.
    number: bool,
    gain: f32,
    /// The colours of the page, where tables do not convert them.
    colors: Option<Arc<Colors>>,
}

const NAN: [u8; 4] = [255, 0, 255, 255];
const INFINITE: [u8; 4] = [255, 255, 0, 255];
const MINUS_INFINITE: [u8; 4] = [0, 255, 0, 255];
const NEGATIVE: [u8; 4] = [0, 96, 255, 255];

/// Converts a number from 0 to 1 to a byte.
fn byte(v: f32) -> u8 {
    (v * 255.0 + 0.5) as u8
}

impl Prepared {
    /// Prepares a display for a layer whose integers are `encoded`. With `unassociated`, colours are not yet
    /// multiplied by alpha. Existing `tables` are reused, and new ones are added.
    pub fn new(
        display: &Display,
        meaning: Meaning,
        encoded: bool,
        unassociated: bool,
        tables: &mut Tables,
    ) -> Self {
        let mut ready = Self {
            display: *display,
            shown: Arc::new(Table(Vec::new())),
            plain: meaning != Meaning::Number
                && display.channels != Channels::Luminance
                && display.false_color.is_none()
                && display.range.is_none(),
            encoded,
            unassociated,
            depth: meaning == Meaning::Depth,
            number: meaning == Meaning::Number,
            gain: display.exposure.exp2(),
            colors: None,
        };
        let key = (display.exposure.to_bits(), display.gamma.to_bits(), display.srgb, encoded);
        ready.shown = tables.get(key, || Table::new(|v| ready.screen(ready.exposed(v))));
        ready
    }

    /// Uses the colours of a page. Depths and numbers are no colours.
    #[must_use]
    pub fn with_colors(mut self, colors: &Arc<Colors>) -> Self {
        if colors.managed.is_some() && !self.depth && !self.number {
            self.colors = Some(colors.clone());
            self.plain = false;
        }
        self
    }

    fn managed(&self) -> Option<&Managed> {
        self.colors.as_ref().and_then(|colors| colors.managed.as_ref())
    }

    /// Computes a row of the screen as [`Prepared::show`] does, where `covered` is true.
    pub(crate) fn show_row(&self, pixels: &[[f32; 4]], covered: &[bool], y: u32, out: &mut [u8]) {
        if let Some(managed) = self.managed().filter(|_| self.shows_colors()) {
            return self.show_managed(managed, pixels, covered, (0, y), out);
        }
        const INFINITY: u32 = f32::INFINITY.to_bits();
        let ignored = self.display.background == Background::Ignored;
        let pixels = pixels.iter().zip(covered);
        for ((x, out), (pixel, covered)) in (0..).zip(out.as_chunks_mut::<4>().0).zip(pixels) {
            let [r, g, b, a] = *pixel;
            // The colours are neither negative, infinite nor NaN, so they have no marks.
            let usual = r.to_bits().max(g.to_bits()).max(b.to_bits()) < INFINITY;
            *out = if !covered {
                BESIDE
            } else if usual && self.plain && (ignored || a == 1.0 && !self.unassociated) {
                let [r, g, b] = [r, g, b].map(|v| self.shown.get_positive(v));
                [r, g, b, 255]
            } else {
                self.show(*pixel, x, y)
            };
        }
    }

    /// True when three values become a colour, without ranges and false colours.
    fn shows_colors(&self) -> bool {
        let d = &self.display;
        d.channels != Channels::Luminance && d.false_color.is_none() && d.range.is_none()
    }

    /// Computes a row of the screen by the colours of the page. The pixels of a row are converted together.
    fn show_managed(
        &self,
        managed: &Managed,
        pixels: &[[f32; 4]],
        covered: &[bool],
        (left, y): (u32, u32),
        out: &mut [u8],
    ) {
        let mut colors = pixels.to_vec();
        managed.to_linear.apply(colors.as_flattened_mut(), 4);
        let ignored = self.display.background == Background::Ignored;
        for (x, pixel) in (left..).zip(&mut colors) {
            let [r, g, b, a] = *pixel;
            let exposed = [r, g, b].map(|v| v * self.gain);
            let [r, g, b] =
                if ignored || a == 1.0 && !self.unassociated { exposed } else { self.over(exposed, a, x, y) };
            let [r, g, b] = self.with_gamma([r, g, b]);
            *pixel = [r, g, b, a];
        }
        if let Some(to_screen) = managed.to_screen.as_ref().filter(|_| self.display.srgb) {
            to_screen.apply(colors.as_flattened_mut(), 4);
        }
        let encoded = managed.to_screen.is_some() || !self.display.srgb;
        let out = out.as_chunks_mut::<4>().0.iter_mut();
        for (((out, color), pixel), covered) in out.zip(&colors).zip(pixels).zip(covered) {
            *out = match (covered, self.mark(&pixel[..3])) {
                (false, _) => BESIDE,
                (true, Some(mark)) => mark,
                (true, None) => {
                    let [r, g, b] = [color[0], color[1], color[2]].map(|v| {
                        let v = v.clamp(0.0, 1.0);
                        byte(if encoded { v } else { srgb_encode(v) })
                    });
                    [r, g, b, 255]
                }
            };
        }
    }

    /// Returns exposed colours raised to the inverse of gamma.
    fn with_gamma(&self, rgb: [f32; 3]) -> [f32; 3] {
        match self.display.gamma {
            1.0 => rgb,
            gamma => rgb.map(|v| v.max(0.0).powf(1.0 / gamma)),
        }
    }

    /// Returns a stored colour in linear light, before exposure.
    pub(crate) fn linear_color(&self, rgb: [f32; 3]) -> [f32; 3] {
        match self.managed() {
            Some(managed) => managed.to_linear.map(rgb),
            None => rgb.map(|v| self.linear(v)),
        }
    }

    /// Returns a stored value in linear light, exposed.
    fn exposed(&self, v: f32) -> f32 {
        if self.encoded { srgb_decode(v) * self.gain } else { v * self.gain }
    }

    /// Returns the screen byte of an exposed value.
    fn screen(&self, v: f32) -> u8 {
        let v = if self.display.gamma == 1.0 { v } else { v.max(0.0).powf(1.0 / self.display.gamma) };
        let v = v.clamp(0.0, 1.0);
        byte(if self.display.srgb { srgb_encode(v) } else { v })
    }

    /// Returns a stored value in linear light, before exposure.
    pub fn linear(&self, v: f32) -> f32 {
        if self.encoded { srgb_decode(v) } else { v }
    }

    /// Returns the mark of a pixel, if it has one.
    fn mark(&self, values: &[f32]) -> Option<[u8; 4]> {
        if self.display.marks == Marks::Off {
            return None;
        }
        let mut sum = 0.0;
        let mut negative = false;
        for v in values {
            // The product is 0 for finite values.
            sum += v * 0.0;
            negative |= *v < 0.0;
        }
        if sum == 0.0 && !negative {
            return None;
        }
        if values.iter().any(|v| v.is_nan()) {
            return Some(NAN);
        }
        if !self.depth {
            if values.contains(&f32::INFINITY) {
                return Some(INFINITE);
            }
            if values.contains(&f32::NEG_INFINITY) {
                return Some(MINUS_INFINITE);
            }
        }
        (negative && self.display.marks == Marks::Negative && !self.depth).then_some(NEGATIVE)
    }

    /// Returns the position of a value in the visible range, from 0 to 1.
    fn in_range(v: f32, (low, high): (f32, f32)) -> f32 {
        let t = (v - low) / (high - low);
        if t.is_nan() { 0.0 } else { t.clamp(0.0, 1.0) }
    }

    /// Returns the screen colour of a pixel. `pixel` is red, green, blue and alpha as stored. (x, y) is its position on
    /// the screen.
    #[inline]
    pub fn show(&self, pixel: [f32; 4], x: u32, y: u32) -> [u8; 4] {
        let [r, g, b, a] = pixel;
        if let Some(mark) = self.mark(&pixel[..3]) {
            return mark;
        }
        if self.display.channels == Channels::Luminance || self.display.false_color.is_some() {
            return self.show_one([r, g, b]);
        }
        if self.number {
            let [r, g, b, _] = hash::words(&[r.to_bits()]).to_le_bytes();
            return [r, g, b, 255];
        }
        if let Some(range) = self.display.range {
            let [r, g, b] = [r, g, b].map(|v| {
                // A depth as large as this means that there is no surface.
                if self.depth && v >= 1e29 { 0 } else { byte(Self::in_range(v, range)) }
            });
            return [r, g, b, 255];
        }
        if let Some(managed) = self.managed() {
            let mut out = [0; 4];
            self.show_managed(managed, &[pixel], &[true], (x, y), &mut out);
            return out;
        }
        if self.display.background == Background::Ignored || a == 1.0 && !self.unassociated {
            return [self.shown.get(r), self.shown.get(g), self.shown.get(b), 255];
        }
        self.show_over([r, g, b], a, x, y)
    }

    /// Returns the screen colour of a single value or of the luminance, in grey or in false colours.
    fn show_one(&self, [r, g, b]: [f32; 3]) -> [u8; 4] {
        let v = match self.managed() {
            None if r == g && g == b => self.linear(r),
            _ => luminance(self.linear_color([r, g, b])),
        };
        let Some(f) = self.display.false_color else {
            let v = match self.display.range {
                Some(range) => byte(Self::in_range(v, range)),
                None => self.screen(v * self.gain),
            };
            return [v, v, v, 255];
        };
        if self.depth && v >= 1e29 {
            return [0, 0, 0, 255];
        }
        let t = if f.log && f.low > 0.0 {
            Self::in_range((v * self.gain).max(0.0).log2(), (f.low.log2(), f.high.log2()))
        } else {
            Self::in_range(v * self.gain, (f.low, f.high))
        };
        let [r, g, b] = f.map.at(t);
        [r, g, b, 255]
    }

    fn show_over(&self, rgb: [f32; 3], a: f32, x: u32, y: u32) -> [u8; 4] {
        let exposed = rgb.map(|v| self.exposed(v));
        let [r, g, b] = self.over(exposed, a, x, y).map(|v| self.screen(v));
        [r, g, b, 255]
    }

    /// Returns an exposed colour over the background.
    fn over(&self, exposed: [f32; 3], a: f32, x: u32, y: u32) -> [f32; 3] {
        let a = if a.is_finite() { a.clamp(0.0, 1.0) } else { 1.0 };
        let behind = match self.display.background {
            Background::Ignored | Background::Black => 0.0,
            Background::Grey => 0.2,
            Background::White => 1.0,
            Background::Checker => [0.1, 0.25][((x / 16 + y / 16) % 2) as usize],
        };
        let own = if self.unassociated { a } else { 1.0 };
        exposed.map(|v| v * own + (1.0 - a) * behind)
    }

    /// Returns linear, unexposed, premultiplied colours, for compositing one image over another.
    pub(crate) fn premultiplied(&self, [r, g, b, a]: [f32; 4]) -> [f32; 4] {
        let own = if self.unassociated { a } else { 1.0 };
        let [r, g, b] = self.linear_color([r, g, b]);
        [r * own, g * own, b * own, a]
    }

    /// Returns the same display for values that are linear and premultiplied.
    pub(crate) fn for_linear(&self, tables: &mut Tables) -> Self {
        let meaning = if self.depth { Meaning::Depth } else { Meaning::Color };
        let linear = Self::new(&self.display, meaning, false, false, tables);
        match self.managed().and_then(|managed| managed.to_screen.clone()) {
            Some(to_screen) => {
                let managed = Managed { to_linear: Processor::identity(), to_screen: Some(to_screen) };
                linear.with_colors(&Arc::new(Colors { text: String::new(), managed: Some(managed) }))
            }
            None => linear,
        }
    }

    /// Returns the same display for differences of encoded values, which are shown linearly.
    pub(crate) fn for_differences(&self, tables: &mut Tables) -> Self {
        Self::new(&Display { srgb: false, ..self.display }, Meaning::Color, false, false, tables)
    }

    /// True when stored values are encoded integers of sRGB.
    pub(crate) fn is_encoded(&self) -> bool {
        self.encoded && self.colors.is_none()
    }

    /// True when stored values of both mean the same.
    pub(crate) fn is_alike(&self, other: &Self) -> bool {
        self.encoded == other.encoded
            && self.managed().map(|managed| &managed.to_linear)
                == other.managed().map(|managed| &managed.to_linear)
    }

    /// True when colours are converted by those of the page.
    pub(crate) fn is_managed(&self) -> bool {
        self.colors.is_some()
    }
}

#[cfg(test)]
mod tests;
