//! From values to what a screen shows: exposure, gamma, choice of channels, false colour, marks.

use crate::layers::{Layer, Meaning};
use crate::maps::ColorMap;
use crate::tile::Pick;
use granita_base::hash;
use granita_texture::make::ColorSpace;
use std::sync::Arc;

/// What is beside a picture.
pub const BESIDE: [u8; 4] = [34, 34, 36, 255];

/// Which channels of a layer are seen.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Channels {
    /// Red, green and blue as a colour.
    #[default]
    Color,
    /// The first of the three, in grey.
    Red,
    /// The second.
    Green,
    /// The third.
    Blue,
    /// Alpha, in grey.
    Alpha,
    /// Rec. 709 luminance of the three, in grey.
    Luminance,
    /// A channel of the picture by its number, in grey.
    One(usize),
}

/// What is seen through a picture with alpha.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Background {
    /// Alpha is not looked at.
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

/// What is drawn over pixels whose values are no ordinary numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Marks {
    /// Nothing.
    Off,
    /// NaN (magenta) and infinite values (yellow, negative ones green).
    #[default]
    Broken,
    /// Also negative values (blue).
    Negative,
}

/// One value in colours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FalseColor {
    /// The colours.
    pub map: ColorMap,
    /// The value at the lower end of the map.
    pub low: f32,
    /// The value at the upper end.
    pub high: f32,
    /// Equal ratios, rather than equal differences, are equally far apart.
    pub log: bool,
}

/// How values become colours of a screen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Display {
    /// In stops: values are multiplied by 2 to this power.
    pub exposure: f32,
    /// Exposed values are raised to the inverse of this.
    pub gamma: f32,
    /// Whether the result is encoded for an sRGB screen; otherwise it is shown in proportion.
    pub srgb: bool,
    /// Which channels are seen.
    pub channels: Channels,
    /// One value in colours, instead of the colours themselves.
    pub false_color: Option<FalseColor>,
    /// These values are black and white, instead of 0 and 1; not encoded. The first may be the larger.
    pub range: Option<(f32, f32)>,
    /// What is marked.
    pub marks: Marks,
    /// What is behind.
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

/// Rec. 709 luminance.
pub fn luminance([r, g, b]: [f32; 3]) -> f32 {
    0.2126 * r + 0.7152 * g + 0.0722 * b
}

impl Display {
    /// Where the four values of a pixel come from, for a layer.
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

/// Bits of a float that are dropped to find its cell.
const SHIFT: u32 = 12;
/// Smallest and largest value with a cell of its own: 2^-24 and 2^24.
const LEAST: f32 = 1.0 / 16_777_216.0;
const MOST: f32 = 16_777_216.0;

/// A function of positive floats as a table: 2048 cells for each factor of two.
#[derive(Clone, Debug)]
struct Table<T>(Vec<T>);

/// Bits of the value that the cell before the first begins at: everything below is like 0.
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

    /// Values below all cells, negative ones and NaN are like 0, those above like infinity.
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

    /// The same for a value that is neither negative nor NaN.
    #[inline]
    fn get_positive(&self, v: f32) -> T {
        self.0[((v.to_bits().clamp(BELOW, MOST.to_bits()) - BELOW) >> SHIFT) as usize]
    }
}

/// Everything that bytes on the screen depend on: bits of the exposure and of gamma, whether the screen is encoded, whether
/// values are.
type TableKey = (u32, u32, bool, bool);

/// Tables that were made last: frames that follow each other use the same.
#[derive(Clone, Debug, Default)]
pub struct Tables(Vec<(TableKey, Arc<Table<u8>>)>);

impl Tables {
    /// Tables that are kept.
    const KEPT: usize = 4;

    /// The one for `key`, made if it is not there.
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

/// A [`Display`] made ready for many pixels of one kind.
#[derive(Clone, Debug)]
pub struct Prepared {
    display: Display,
    /// From a stored value to the byte on the screen.
    shown: Arc<Table<u8>>,
    /// Colours go through the table and nothing else, but where alpha is looked at.
    plain: bool,
    /// Whether stored values are encoded.
    encoded: bool,
    /// Alpha is not yet in the colours.
    unassociated: bool,
    /// Distances: infinite ones are nothing special.
    depth: bool,
    /// Numbers of things: each has a colour of its own.
    number: bool,
    gain: f32,
}

const NAN: [u8; 4] = [255, 0, 255, 255];
const INFINITE: [u8; 4] = [255, 255, 0, 255];
const MINUS_INFINITE: [u8; 4] = [0, 255, 0, 255];
const NEGATIVE: [u8; 4] = [0, 96, 255, 255];

/// A number from 0 to 1 as a byte.
fn byte(v: f32) -> u8 {
    (v * 255.0 + 0.5) as u8
}

impl Prepared {
    /// For a layer whose integers are `encoded`; alpha is not in the colours yet if `unassociated`. Of `tables` those are
    /// used that are there, and new ones are added.
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
        };
        let key = (display.exposure.to_bits(), display.gamma.to_bits(), display.srgb, encoded);
        ready.shown = tables.get(key, || Table::new(|v| ready.screen(ready.exposed(v))));
        ready
    }

    /// What a row of the screen looks like: pixels as for [`Prepared::show`], and where there are any.
    pub(crate) fn show_row(&self, pixels: &[[f32; 4]], covered: &[bool], y: u32, out: &mut [u8]) {
        const INFINITY: u32 = f32::INFINITY.to_bits();
        let ignored = self.display.background == Background::Ignored;
        let pixels = pixels.iter().zip(covered);
        for ((x, out), (pixel, covered)) in (0..).zip(out.as_chunks_mut::<4>().0).zip(pixels) {
            let [r, g, b, a] = *pixel;
            // Neither negative, nor infinite, nor NaN: nothing of that is marked.
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

    /// A stored value in proportion to light, exposed.
    fn exposed(&self, v: f32) -> f32 {
        // Nothing happens to what is shown as it is stored.
        if self.encoded { ColorSpace::Srgb.decode(v) * self.gain } else { v * self.gain }
    }

    /// The byte for an exposed value.
    fn screen(&self, v: f32) -> u8 {
        let v = if self.display.gamma == 1.0 { v } else { v.max(0.0).powf(1.0 / self.display.gamma) };
        let v = v.clamp(0.0, 1.0);
        byte(if self.display.srgb { ColorSpace::Srgb.encode(v) } else { v })
    }

    /// A stored value in proportion to light, before exposure.
    pub fn linear(&self, v: f32) -> f32 {
        if self.encoded { ColorSpace::Srgb.decode(v) } else { v }
    }

    /// The mark of a pixel, if it gets one.
    fn mark(&self, values: &[f32]) -> Option<[u8; 4]> {
        if self.display.marks == Marks::Off {
            return None;
        }
        let mut sum = 0.0;
        let mut negative = false;
        for v in values {
            // 0 for what is finite.
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

    /// Where a value is in the range that is shown, 0 to 1.
    fn in_range(v: f32, (low, high): (f32, f32)) -> f32 {
        let t = (v - low) / (high - low);
        if t.is_nan() { 0.0 } else { t.clamp(0.0, 1.0) }
    }

    /// What a pixel looks like. `pixel` is red, green, blue and alpha as stored; (x, y) is its place on the screen.
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
                // What is as far as depths go is nothing.
                if self.depth && v >= 1e29 { 0 } else { byte(Self::in_range(v, range)) }
            });
            return [r, g, b, 255];
        }
        if self.display.background == Background::Ignored || a == 1.0 && !self.unassociated {
            return [self.shown.get(r), self.shown.get(g), self.shown.get(b), 255];
        }
        self.show_over([r, g, b], a, x, y)
    }

    /// One value for the three, in grey or in colours.
    fn show_one(&self, [r, g, b]: [f32; 3]) -> [u8; 4] {
        let v = if r == g && g == b { self.linear(r) } else { luminance([r, g, b].map(|v| self.linear(v))) };
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
        let a = if a.is_finite() { a.clamp(0.0, 1.0) } else { 1.0 };
        let behind = match self.display.background {
            Background::Ignored | Background::Black => 0.0,
            Background::Grey => 0.2,
            Background::White => 1.0,
            Background::Checker => [0.1, 0.25][((x / 16 + y / 16) % 2) as usize],
        };
        let own = if self.unassociated { a } else { 1.0 };
        let [r, g, b] = rgb.map(|v| self.screen(self.exposed(v) * own + (1.0 - a) * behind));
        [r, g, b, 255]
    }

    /// Linear, unexposed colours with alpha in them, for laying one picture over another.
    pub(crate) fn premultiplied(&self, [r, g, b, a]: [f32; 4]) -> [f32; 4] {
        let own = if self.unassociated { a } else { 1.0 };
        [self.linear(r) * own, self.linear(g) * own, self.linear(b) * own, a]
    }

    /// The same for values that are linear and have alpha in them.
    pub(crate) fn for_linear(&self, tables: &mut Tables) -> Self {
        let meaning = if self.depth { Meaning::Depth } else { Meaning::Color };
        Self::new(&self.display, meaning, false, false, tables)
    }

    /// The same for differences of encoded values, which are no colours: they are shown in proportion.
    pub(crate) fn for_differences(&self, tables: &mut Tables) -> Self {
        Self::new(&Display { srgb: false, ..self.display }, Meaning::Color, false, false, tables)
    }

    /// Whether stored values are encoded.
    pub(crate) fn is_encoded(&self) -> bool {
        self.encoded
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn ready(display: Display, encoded: bool) -> Prepared {
        Prepared::new(&display, Meaning::Color, encoded, false, &mut Tables::default())
    }

    #[test]
    fn bytes_are_shown_as_they_are_stored() {
        let p = ready(Display::default(), true);
        for i in 0..=255_u8 {
            let v = f32::from(i) / 255.0;
            assert_eq!(p.show([v, v, v, 1.0], 0, 0), [i, i, i, 255]);
        }
    }

    #[test]
    fn light_is_encoded_exactly_enough() {
        let p = ready(Display::default(), false);
        for i in 0..10_000 {
            let v = i as f32 / 8000.0;
            let exact = f64::from(ColorSpace::Srgb.encode(v.min(1.0))) * 255.0;
            let got = f64::from(p.show([v, v, v, 1.0], 0, 0)[0]);
            assert!((got - exact).abs() < 0.54, "{v}: {got} for {exact}");
        }
    }

    #[test]
    fn a_stop_doubles() {
        let one = ready(Display { exposure: 1.0, ..Display::default() }, false);
        let none = ready(Display::default(), false);
        assert_eq!(one.show([0.1, 0.2, 0.4, 1.0], 0, 0), none.show([0.2, 0.4, 0.8, 1.0], 0, 0));
        let plain = ready(Display { srgb: false, gamma: 2.0, ..Display::default() }, false);
        assert_eq!(plain.show([0.25, 1.0, 4.0, 1.0], 0, 0), [128, 255, 255, 255]);
    }

    #[test]
    fn odd_numbers_are_marked() {
        let all = ready(Display { marks: Marks::Negative, ..Display::default() }, false);
        let off = ready(Display { marks: Marks::Off, ..Display::default() }, false);
        for (v, mark) in [
            (f32::NAN, NAN),
            (f32::INFINITY, INFINITE),
            (f32::NEG_INFINITY, MINUS_INFINITE),
            (-0.5, NEGATIVE),
        ] {
            assert_eq!(all.show([0.1, v, 0.1, 1.0], 0, 0), mark);
            assert_eq!(off.show([0.1, v, 0.1, 1.0], 0, 0)[3], 255);
        }
        assert_ne!(ready(Display::default(), false).show([-1.0; 4], 0, 0), NEGATIVE);
        assert_eq!(all.show([f32::MAX, f32::MIN_POSITIVE, 0.0, 1.0], 0, 0), [255, 0, 0, 255]);
    }

    #[test]
    fn tables_are_made_once() {
        let mut tables = Tables::default();
        let mut shown = |exposure: f32| {
            let display = Display { exposure, ..Display::default() };
            Prepared::new(&display, Meaning::Color, false, false, &mut tables).shown
        };
        let first = shown(0.0);
        assert!(Arc::ptr_eq(&first, &shown(0.0)) && !Arc::ptr_eq(&first, &shown(1.0)));
        (2..9).for_each(|e| drop(shown(e as f32)));
        assert!(!Arc::ptr_eq(&first, &shown(0.0)), "the last few are kept");
        assert_eq!(tables.0.len(), Tables::KEPT);
    }

    /// Values of every kind: those that are no ordinary numbers, those at the ends of tables, any others.
    fn any_value() -> impl Strategy<Value = f32> {
        let odd = vec![
            f32::NAN,
            -f32::NAN,
            f32::INFINITY,
            f32::NEG_INFINITY,
            0.0,
            -0.0,
            f32::MIN_POSITIVE,
            -f32::MIN_POSITIVE,
            f32::from_bits(1),
            -f32::from_bits(1),
            f32::from_bits(0x007f_ffff),
            LEAST,
            LEAST.next_down(),
            f32::from_bits(BELOW),
            f32::from_bits(BELOW - 1),
            MOST,
            MOST.next_down(),
            MOST.next_up(),
            f32::MAX,
            f32::MIN,
            1.0,
            1.0_f32.next_down(),
            1e29,
            1e30,
            -0.25,
        ];
        prop_oneof![
            2 => proptest::sample::select(odd),
            3 => 0.0_f32..1.5,
            1 => -2.0_f32..0.0,
            1 => any::<u32>().prop_map(f32::from_bits),
        ]
    }

    fn any_display() -> impl Strategy<Value = Display> {
        use proptest::sample::select;
        let colors = select(ColorMap::ALL.to_vec()).prop_flat_map(|map| {
            (-2.0_f32..1.0, 0.5_f32..9.0, any::<bool>()).prop_map(move |(low, high, log)| FalseColor {
                map,
                low,
                high,
                log,
            })
        });
        let channels = select(vec![Channels::Color, Channels::Red, Channels::Luminance, Channels::One(0)]);
        let marks = select(vec![Marks::Off, Marks::Broken, Marks::Negative]);
        let background = select(vec![Background::Ignored, Background::Grey, Background::Checker]);
        (
            (select(vec![0.0_f32, 1.0, -3.5, 20.0]), select(vec![1.0_f32, 2.2]), any::<bool>()),
            (channels, marks, background),
            prop_oneof![2 => Just(None), 1 => colors.prop_map(Some)],
            prop_oneof![3 => Just(None), 1 => Just(Some((0.25, 4.0))), 1 => Just(Some((1e3, 0.0)))],
        )
            .prop_map(
                |((exposure, gamma, srgb), (channels, marks, background), false_color, range)| Display {
                    exposure,
                    gamma,
                    srgb,
                    channels,
                    false_color,
                    range,
                    marks,
                    background,
                },
            )
    }

    proptest! {
        /// The quick way through a row is the way through each of its pixels.
        #[test]
        fn rows_are_their_pixels(
            display in any_display(),
            meaning in proptest::sample::select(vec![Meaning::Color, Meaning::Depth, Meaning::Number]),
            (encoded, unassociated) in any::<(bool, bool)>(),
            alpha in prop_oneof![Just(None), Just(Some(1.0_f32)), Just(Some(0.5))],
            pixels in prop::collection::vec((prop::array::uniform4(any_value()), prop::bool::weighted(0.9)), 0..70),
            y in 0..40_u32,
        ) {
            let ready = Prepared::new(&display, meaning, encoded, unassociated, &mut Tables::default());
            let (mut pixels, covered): (Vec<[f32; 4]>, Vec<bool>) = pixels.into_iter().unzip();
            if let Some(alpha) = alpha {
                pixels.iter_mut().for_each(|p| p[3] = alpha);
            }
            let mut out = vec![7; 4 * pixels.len()];
            ready.show_row(&pixels, &covered, y, &mut out);
            for (x, ((pixel, covered), out)) in (0..).zip(pixels.iter().zip(&covered).zip(out.chunks(4))) {
                let one = if *covered { ready.show(*pixel, x, y) } else { BESIDE };
                prop_assert_eq!(out, one, "{:?} at {}", pixel, x);
            }
        }
    }

    #[test]
    fn over_backgrounds() {
        let p = |background, unassociated| {
            let d = Display { background, srgb: false, ..Display::default() };
            Prepared::new(&d, Meaning::Color, false, unassociated, &mut Tables::default())
        };
        assert_eq!(p(Background::White, false).show([0.25, 0.0, 0.0, 0.5], 0, 0)[..2], [191, 128]);
        assert_eq!(p(Background::White, true).show([0.5, 0.0, 0.0, 0.5], 0, 0)[..2], [191, 128]);
        let checker = p(Background::Checker, false);
        assert_ne!(checker.show([0.0; 4], 0, 0), checker.show([0.0; 4], 16, 0));
        assert_eq!(p(Background::Ignored, false).show([1.0, 0.0, 0.0, 0.0], 0, 0), [255, 0, 0, 255]);
    }

    #[test]
    fn depths_near_is_bright() {
        let d = Display { range: Some((10.0, 2.0)), ..Display::default() };
        let p = Prepared::new(&d, Meaning::Depth, false, false, &mut Tables::default());
        let grey = |z: f32| p.show([z, z, z, 1.0], 0, 0)[0];
        assert_eq!([grey(2.0), grey(6.0), grey(10.0), grey(1e30), grey(f32::INFINITY)], [255, 128, 0, 0, 0]);
    }

    #[test]
    fn false_colors_follow_the_value() {
        let f = FalseColor { map: ColorMap::Grey, low: 0.25, high: 4.0, log: true };
        let p = ready(Display { false_color: Some(f), ..Display::default() }, false);
        let at = |v: f32| p.show([v, v, v, 1.0], 0, 0)[0];
        assert_eq!([at(0.1), at(0.25), at(1.0), at(4.0), at(9.0)], [0, 0, 128, 255, 255]);
    }
}
