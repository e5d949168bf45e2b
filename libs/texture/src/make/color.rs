//! Gamma and the conversion of colours. Colours become linear light before MIP levels are made, and are encoded after.

use granita_base::math;
use granita_color::Processor;
use half::f16;
use rayon::prelude::*;
use std::sync::Arc;

/// The conversion of colours from the inputs to the texture, in two parts.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ColorConvert {
    /// From the colour space of the inputs to the one in which MIP levels are made.
    pub inputs: Processor,
    /// From that space to the one of the texture.
    pub outputs: Processor,
    /// True when both spaces are the same, so that what the file says of its colours stays true.
    pub same: bool,
    /// True when colours that are multiplied by alpha are divided by it around each conversion.
    pub unassociate: bool,
    /// True when colours that the input declares as not multiplied by alpha are multiplied before the conversion, as
    /// OpenImageIO does. They are multiplied after it otherwise.
    pub multiply_first: bool,
}

/// Raises the magnitude to a power, and keeps the sign.
fn power(v: f32, g: f32) -> f32 {
    if g == 1.0 { v } else { math::pow(v.abs(), f64::from(g)).min(1e30).copysign(v) }
}

/// The conversion of the colours of the inputs, and of those of the texture.
#[derive(Clone, Debug)]
pub(crate) struct Conversion {
    pub(super) ingamma: f32,
    pub(super) outgamma: f32,
    pub(super) colors: Option<Arc<ColorConvert>>,
    /// The index of the alpha channel, which is not converted.
    pub(super) alpha: Option<usize>,
    /// True when colours have to be multiplied by alpha.
    pub(super) multiply: bool,
}

/// What a conversion makes of each half.
#[derive(Clone, Debug)]
pub(crate) struct HalfTable {
    /// The results of the three colours, or of all of them where they are the same.
    planes: Vec<Vec<f32>>,
    /// The halves as floats.
    plain: Vec<f32>,
}

impl Conversion {
    /// True when inputs stay as they are.
    pub(crate) fn keeps_inputs(&self) -> bool {
        self.ingamma == 1.0 && !self.multiply && self.keeps_colors()
    }

    /// True when the colours of inputs are not converted, but may be multiplied by alpha.
    pub(crate) fn keeps_colors(&self) -> bool {
        self.colors.as_ref().is_none_or(|colors| colors.inputs.is_identity())
    }

    /// True when colours are multiplied by alpha.
    pub(crate) fn multiplies(&self) -> bool {
        self.multiply
    }

    /// True when the texture stores the values in which MIP levels are computed.
    pub(crate) fn keeps_outputs(&self) -> bool {
        self.outgamma == 1.0 && self.colors.as_ref().is_none_or(|colors| colors.outputs.is_identity())
    }

    /// True when channel `c` is a colour, which is one of the first three and not alpha.
    fn is_color(&self, c: usize) -> bool {
        c < 3 && self.alpha != Some(c)
    }

    /// True when colours are converted as the input stores them, before they are multiplied by alpha.
    fn converts_stored(&self) -> bool {
        let Some(colors) = &self.colors else { return true };
        if self.multiply { !colors.multiply_first } else { !colors.unassociate }
    }

    /// Converts whole pixels of `n` channels of an input to linear light.
    pub(crate) fn to_linear(&self, values: &mut [f32], n: usize) {
        if self.keeps_inputs() {
            return;
        }
        if self.ingamma != 1.0 {
            self.each(values, n, |v| power(v, self.ingamma));
        }
        if self.converts_stored() {
            self.convert_colors(values, n);
            self.associate(values, n);
        } else {
            self.associate(values, n);
            self.convert_colors(values, n);
        }
    }

    /// Does the same for 8-bit pixels. Where each channel is converted by itself, colours are looked up in a table.
    pub(crate) fn bytes_to_linear(&self, bytes: &[u8], n: usize, out: &mut [f32]) {
        let plain: [f32; 256] = std::array::from_fn(|i| i as f32 / 255.0);
        let separable = self.colors.as_ref().is_none_or(|colors| colors.inputs.is_separable());
        if !separable || !self.converts_stored() || n == 2 {
            out.iter_mut().zip(bytes).for_each(|(v, byte)| *v = plain[usize::from(*byte)]);
            return self.to_linear(out, n);
        }
        let mut table: Vec<f32> = plain.iter().flat_map(|v| [power(*v, self.ingamma); 3]).collect();
        if let Some(colors) = &self.colors {
            colors.inputs.apply(&mut table, 3);
        }
        for (texel, bytes) in out.chunks_exact_mut(n).zip(bytes.chunks_exact(n)) {
            for (c, (v, byte)) in texel.iter_mut().zip(bytes).enumerate() {
                let byte = usize::from(*byte);
                *v = if self.is_color(c) { table[3 * byte + c] } else { plain[byte] };
            }
        }
        self.associate(out, n);
    }

    /// Returns the results of [`Conversion::to_linear`] for all halves, before colours are multiplied by alpha; `None`
    /// where they are more than functions of one channel each, and where nothing is converted.
    pub(crate) fn table_of_halves(&self, n: usize) -> Option<HalfTable> {
        let separable = self.colors.as_ref().is_none_or(|colors| colors.inputs.is_separable());
        let converts = self.ingamma != 1.0 || !self.keeps_colors();
        if !separable || !converts || !self.converts_stored() || n == 2 {
            return None;
        }
        let plain: Vec<f32> = (0..=u16::MAX).map(|bits| f16::from_bits(bits).to_f32()).collect();
        let mut all: Vec<f32> = plain.iter().flat_map(|v| [power(*v, self.ingamma); 3]).collect();
        if let Some(colors) = &self.colors {
            all.par_chunks_mut(3 * 4096).for_each(|values| colors.inputs.apply(values, 3));
        }
        let plane = |c: usize| -> Vec<f32> { all.iter().skip(c).step_by(3).copied().collect() };
        let bits = |plane: &Vec<f32>| plane.iter().map(|v| v.to_bits()).collect::<Vec<u32>>();
        let mut planes = vec![plane(0), plane(1), plane(2)];
        if bits(&planes[0]) == bits(&planes[1]) && bits(&planes[0]) == bits(&planes[2]) {
            planes.truncate(1);
        }
        Some(HalfTable { planes, plain })
    }

    /// Does the same as [`Conversion::to_linear`] for halves of `n` channels, by their table.
    pub(crate) fn halves_to_linear(&self, table: &HalfTable, halves: &[f16], n: usize, out: &mut [f32]) {
        let same = table.planes.len() == 1;
        if same && self.alpha.is_none() && n <= 3 {
            let plane = &table.planes[0];
            out.iter_mut().zip(halves).for_each(|(v, half)| *v = plane[usize::from(half.to_bits())]);
            return;
        }
        for (texel, halves) in out.chunks_exact_mut(n).zip(halves.chunks_exact(n)) {
            for (c, (v, half)) in texel.iter_mut().zip(halves).enumerate() {
                let plane = match self.is_color(c) {
                    true => &table.planes[if same { 0 } else { c }],
                    false => &table.plain,
                };
                *v = plane[usize::from(half.to_bits())];
            }
        }
        self.associate(out, n);
    }

    /// Multiplies colours by alpha where needed.
    pub(crate) fn associate(&self, values: &mut [f32], n: usize) {
        let Some(alpha) = self.alpha.filter(|_| self.multiply) else { return };
        for texel in values.chunks_exact_mut(n) {
            let a = texel[alpha];
            for (c, v) in texel.iter_mut().enumerate() {
                if self.is_color(c) {
                    *v *= a;
                }
            }
        }
    }

    /// Converts the colours of inputs.
    pub(crate) fn convert_colors(&self, values: &mut [f32], n: usize) {
        if let Some(colors) = &self.colors {
            // Colours that are multiplied later are not divided.
            let divide = colors.unassociate && (!self.multiply || colors.multiply_first);
            self.process(&colors.inputs, values, n, divide);
        }
    }

    /// Converts whole pixels of linear light to the values that the texture stores.
    pub(crate) fn to_stored(&self, values: &mut [f32], n: usize) {
        if let Some(colors) = &self.colors {
            self.process(&colors.outputs, values, n, colors.unassociate);
        }
        if self.outgamma != 1.0 {
            self.each(values, n, |v| power(v, 1.0 / self.outgamma));
        }
    }

    /// Applies a processor to the colours. Grey channels before alpha are one colour.
    fn process(&self, processor: &Processor, values: &mut [f32], n: usize, divide: bool) {
        match self.alpha.filter(|alpha| *alpha < n) {
            Some(alpha) if alpha < n.min(3) && n >= 3 => {
                let kept: Vec<f32> = values.iter().skip(alpha).step_by(n).copied().collect();
                processor.apply(values, n);
                values.iter_mut().skip(alpha).step_by(n).zip(kept).for_each(|(v, kept)| *v = kept);
            }
            Some(alpha) if divide => processor.apply_associated(values, n, alpha),
            _ => processor.apply(values, n),
        }
    }

    fn each(&self, values: &mut [f32], n: usize, change: impl Fn(f32) -> f32) {
        for texel in values.chunks_exact_mut(n) {
            for (c, v) in texel.iter_mut().enumerate() {
                if self.is_color(c) {
                    *v = change(*v);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::MakeOptions;
    use super::*;
    use granita_color::Config;

    fn convert(from: &str, to: &str) -> ColorConvert {
        let inputs = Config::built_in().processor(from, to).unwrap();
        ColorConvert { inputs, ..ColorConvert::default() }
    }

    fn options(colors: ColorConvert) -> MakeOptions {
        MakeOptions { color_convert: Some(Arc::new(colors)), ..MakeOptions::default() }
    }

    #[test]
    fn conversion_keeps_alpha_and_signs() {
        let options = MakeOptions { ingamma: 2.0, outgamma: 2.0, ..MakeOptions::default() };
        let c = options.conversion(Some(3), false);
        let mut v = [0.5, -0.5, 1.0, 0.5];
        c.to_linear(&mut v, 4);
        assert_eq!(v, [0.25, -0.25, 1.0, 0.5]);
        c.to_stored(&mut v, 4);
        assert_eq!(v, [0.5, -0.5, 1.0, 0.5]);
        // Grey with alpha has a second channel that is not a colour.
        let mut v = [0.5, 0.5];
        options.conversion(Some(1), true).to_linear(&mut v, 2);
        assert_eq!(v, [0.125, 0.5]);
    }

    #[test]
    fn conversions_of_bytes_and_floats_agree() {
        for (to, unassociate, multiply_first) in
            [("ACEScg", false, false), ("lin_rec709", false, false), ("lin_rec709", true, true)]
        {
            let colors = ColorConvert { unassociate, multiply_first, ..convert("srgb_texture", to) };
            let options = options(colors);
            for (n, alpha) in [(4, Some(3)), (2, None), (2, Some(1)), (1, None)] {
                let c = options.conversion(alpha, alpha.is_some());
                let bytes: Vec<u8> = (0..=255).collect();
                let mut a = vec![0.0; 256];
                c.bytes_to_linear(&bytes, n, &mut a);
                let mut b: Vec<f32> = bytes.iter().map(|v| f32::from(*v) / 255.0).collect();
                c.to_linear(&mut b, n);
                assert_eq!(a, b, "{to} {n} {alpha:?}");
            }
        }
    }

    #[test]
    fn conversions_of_halves_and_floats_agree() {
        let bits = |v: &[f32]| v.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        let halves: Vec<f16> = (0..=u16::MAX).map(f16::from_bits).collect();
        for (n, alpha, multiply, ingamma) in
            [(4, Some(3), true, 1.0), (4, Some(1), false, 1.0), (1, None, false, 2.0), (4, None, false, 1.0)]
        {
            let options = MakeOptions { ingamma, ..options(convert("lin_rec709", "srgb_texture")) };
            let c = options.conversion(alpha, multiply);
            let table = c.table_of_halves(n).unwrap();
            let mut a = vec![0.0; halves.len()];
            c.halves_to_linear(&table, &halves, n, &mut a);
            let mut b: Vec<f32> = halves.iter().map(|v| v.to_f32()).collect();
            c.to_linear(&mut b, n);
            assert_eq!(bits(&a), bits(&b), "{n} {alpha:?}");
        }
        // Matrices mix channels, and colours that are divided by alpha are not functions of one channel.
        let mixed = options(convert("lin_rec709", "ACEScg")).conversion(None, false);
        assert!(mixed.table_of_halves(3).is_none());
        let divided = ColorConvert { unassociate: true, ..convert("lin_rec709", "srgb_texture") };
        assert!(options(divided).conversion(Some(3), false).table_of_halves(4).is_none());
        assert!(MakeOptions::default().conversion(None, false).table_of_halves(3).is_none());
    }

    #[test]
    fn the_order_of_alpha_and_conversion_is_that_of_the_options() {
        let square = || ColorConvert { inputs: Processor::power(2.0), ..ColorConvert::default() };
        let of = |colors: ColorConvert, straight| {
            let mut v = [0.5, 0.5, 0.5, 0.5];
            options(colors).conversion(Some(3), straight).to_linear(&mut v, 4);
            assert_eq!(v[3], 0.5);
            v[0]
        };
        assert_eq!(of(square(), false), 0.25);
        assert_eq!(of(square(), true), 0.125);
        let first = || ColorConvert { multiply_first: true, ..square() };
        assert_eq!(of(first(), true), 0.0625);
        assert_eq!(of(ColorConvert { unassociate: true, ..first() }, true), 0.125);
        assert_eq!(of(ColorConvert { unassociate: true, ..square() }, false), 0.5);
        assert_eq!(of(ColorConvert { unassociate: true, ..square() }, true), 0.125);
    }

    #[test]
    fn alpha_among_the_first_channels_stays() {
        let c = options(ColorConvert { inputs: Processor::power(2.0), ..ColorConvert::default() });
        let mut v = [0.5, 0.25, 0.5];
        c.conversion(Some(1), false).to_linear(&mut v, 3);
        assert_eq!(v, [0.25, 0.25, 0.25]);
    }
}
