//! Operations on channels, and on the type of values.

use crate::image::{Image, Shape, Source, same_type};
use crate::pointwise::Map;
use crate::{EditError, Result};
use granita_image::{ImageSpec, PixelType, Pixels};
use rayon::prelude::*;
use std::sync::Arc;

/// The origin of one channel.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Origin {
    /// A channel of a source: the number of the source, and its channel.
    Channel(usize, usize),
    /// The same value everywhere.
    Value(f32),
}

/// Channels of one or more sources of one size and type.
struct Chosen {
    shape: Shape,
    from: Vec<Arc<dyn Source>>,
    channels: Vec<Origin>,
}

impl Source for Chosen {
    fn shape(&self) -> Shape {
        self.shape
    }

    fn rows(&self, y0: u32, y1: u32) -> Result<Pixels> {
        let blocks = self.from.iter().map(|s| s.rows(y0, y1)).collect::<Result<Vec<_>>>()?;
        let widths: Vec<usize> = self.from.iter().map(|s| s.shape().channels).collect();
        let values: Vec<Pixels> = (self.channels.iter())
            .map(|origin| match origin {
                Origin::Value(v) => Pixels::from_floats(self.shape.pixel_type, &[*v]),
                Origin::Channel(..) => Pixels::zeros(self.shape.pixel_type, 1),
            })
            .collect();
        let pixels = (y1 - y0) as usize * self.shape.width as usize;
        let mut out = Pixels::zeros(self.shape.pixel_type, pixels * self.channels.len());
        let (n, channels) = (self.channels.len(), &self.channels);
        /// Fills rows of pixels. `value` returns the constant of a channel.
        macro_rules! fill {
            ($out:expr, $kind:path) => {{
                let blocks: Vec<&[_]> = (blocks.iter())
                    .filter_map(|block| if let $kind(v) = block { Some(&v[..]) } else { None })
                    .collect();
                let constants: Vec<_> = (values.iter())
                    .filter_map(|block| if let $kind(v) = block { Some(v[0]) } else { None })
                    .collect();
                const PART: usize = 1 << 13;
                $out.par_chunks_mut(PART * n).enumerate().for_each(|(i, part)| {
                    for (c, origin) in channels.iter().enumerate() {
                        let to = part.iter_mut().skip(c).step_by(n);
                        match *origin {
                            Origin::Value(_) => to.for_each(|v| *v = constants[c]),
                            Origin::Channel(source, channel) => {
                                let from = &blocks[source][i * PART * widths[source]..];
                                let from = from.iter().skip(channel).step_by(widths[source]);
                                to.zip(from).for_each(|(to, from)| *to = *from);
                            }
                        }
                    }
                });
            }};
        }
        match &mut out {
            Pixels::U8(v) => fill!(v, Pixels::U8),
            Pixels::U16(v) => fill!(v, Pixels::U16),
            Pixels::U32(v) => fill!(v, Pixels::U32),
            Pixels::Half(v) => fill!(v, Pixels::Half),
            Pixels::Float(v) => fill!(v, Pixels::Float),
        }
        Ok(out)
    }

    fn any_order(&self) -> bool {
        self.from.iter().all(|s| s.any_order())
    }
}

/// The same values in another type.
struct Converted {
    from: Arc<dyn Source>,
    pixel_type: PixelType,
}

impl Source for Converted {
    fn shape(&self) -> Shape {
        Shape { pixel_type: self.pixel_type, ..self.from.shape() }
    }

    fn rows(&self, y0: u32, y1: u32) -> Result<Pixels> {
        Ok(converted(self.from.rows(y0, y1)?, self.pixel_type))
    }

    fn any_order(&self) -> bool {
        self.from.any_order()
    }
}

/// Converts values in threads. Between integers the values are exact.
pub(crate) fn converted(pixels: Pixels, pixel_type: PixelType) -> Pixels {
    const PART: usize = 1 << 16;
    if pixels.pixel_type() == pixel_type {
        return pixels;
    }
    let parts: Vec<Pixels> = (0..pixels.len().div_ceil(PART))
        .into_par_iter()
        .map_init(Vec::new, |room, i| {
            let range = i * PART..((i + 1) * PART).min(pixels.len());
            Pixels::from_floats(pixel_type, pixels.floats_of(range, room))
        })
        .collect();
    let mut out = Pixels::zeros(pixel_type, pixels.len());
    for (i, part) in parts.iter().enumerate() {
        out.copy_from(i * PART, part, 0, part.len());
    }
    out
}

/// Returns pixels from right to left in each row of `width` pixels.
pub(crate) fn flopped(pixels: &Pixels, width: usize, channels: usize) -> Pixels {
    fn turn<T: Copy + Default + Send + Sync>(v: &[T], width: usize, n: usize) -> Vec<T> {
        let mut out = vec![T::default(); v.len()];
        let row = (width * n).max(1);
        out.par_chunks_mut(row).zip(v.par_chunks(row)).for_each(|(to, from)| {
            let pixels = to.chunks_exact_mut(n).zip(from.chunks_exact(n).rev());
            pixels.for_each(|(to, from)| to.copy_from_slice(from));
        });
        out
    }
    same_type!(pixels, v => turn(v, width, channels))
}

/// A message about something that does not stop the work.
pub type Note = String;

impl Image {
    /// Returns the image with values of another type, which is also that of its files.
    #[must_use]
    pub fn converted(&self, pixel_type: PixelType) -> Self {
        if pixel_type == self.spec.pixel_type {
            return Self { stored: pixel_type, ..self.clone() };
        }
        let mut image = self.with_source(Arc::new(Converted { from: self.source.clone(), pixel_type }));
        image.stored = pixel_type;
        image
    }

    /// Returns the image with its first `count` channels, or with further channels of 0.
    #[must_use]
    pub fn with_channels(&self, count: usize) -> Self {
        let own = self.spec.nchannels();
        if count == own {
            return self.clone();
        }
        let origin = |c| if c < own { Origin::Channel(0, c) } else { Origin::Value(0.0) };
        let mut image = self.choose((0..count).map(origin).collect());
        for (c, name) in ImageSpec::default_channels(count).into_iter().enumerate().skip(own) {
            let used = image.spec.channels[..c].contains(&name);
            image.spec.channels[c] = if used { format!("channel{c}") } else { name };
        }
        image
    }

    fn choose(&self, channels: Vec<Origin>) -> Self {
        let shape = Shape { channels: channels.len(), ..self.source.shape() };
        self.with_source(Arc::new(Chosen { shape, from: vec![self.source.clone()], channels }))
    }

    /// Returns channels of the image in another order. `list` has the form `R,G,B`, where a channel is given by its
    /// name or by its index from 0. `NAME=R` names the channel, `A=1.0` is a channel of one value, and `=0.5` is one
    /// without a name. A channel that does not exist is 0; the second result names it.
    ///
    /// # Errors
    /// [`EditError::Misuse`] for an empty list, and for more than 1024 channels.
    pub fn channels(&self, list: &str) -> Result<(Self, Vec<Note>)> {
        let image = self.associated();
        let names = &image.spec.channels;
        let find = |word: &str| {
            let number = || word.parse::<usize>().ok().filter(|c| *c < names.len());
            let same = |other: &String| other.eq_ignore_ascii_case(word);
            names.iter().position(|n| n == word).or_else(|| names.iter().position(same)).or_else(number)
        };
        let (mut origins, mut named, mut notes) = (Vec::new(), Vec::new(), Vec::new());
        for word in list.split(',').map(str::trim) {
            let (name, from) = match word.split_once('=') {
                Some((name, from)) => (Some(name.trim()).filter(|n| !n.is_empty()), from.trim()),
                None => (None, word),
            };
            let given = word.contains('=');
            let value = || from.parse::<f32>().ok().filter(|_| given);
            // A number after "=" is a value. A number alone is an index.
            let origin = match value() {
                Some(v) => Origin::Value(v),
                None => match find(from) {
                    Some(c) => Origin::Channel(0, c),
                    None => {
                        let has = names.join(", ");
                        notes.push(format!("there is no channel \"{from}\", it is 0 (the image has {has})"));
                        Origin::Value(0.0)
                    }
                },
            };
            named.push(match (name, origin) {
                (Some(name), _) => name.to_owned(),
                (None, Origin::Channel(_, c)) => names[c].clone(),
                (None, Origin::Value(_)) if given || from.is_empty() => format!("channel{}", named.len()),
                (None, Origin::Value(_)) => from.to_owned(),
            });
            origins.push(origin);
        }
        if origins.is_empty() || origins.len() > 1024 {
            return Err(EditError::misuse(format!("{} channels, 1 to 1024 are possible", origins.len())));
        }
        let mut out = image.choose(origins);
        out.spec.channels = distinct(named);
        Ok((out, notes))
    }

    /// Returns the image with other names of channels, separated by commas. An empty name keeps the old one.
    #[must_use]
    pub fn channel_names(&self, list: &str) -> Self {
        let mut image = self.clone();
        for (to, name) in image.spec.channels.iter_mut().zip(list.split(',').map(str::trim)) {
            if !name.is_empty() {
                name.clone_into(to);
            }
        }
        image
    }

    /// Returns one channel that is the sum of all, each with its weight. Missing weights are 0, and a single one is
    /// that of all channels.
    #[must_use]
    pub fn channel_sum(&self, weights: &[f32]) -> Self {
        let image = self.associated();
        let n = image.spec.nchannels();
        let weights: Vec<f32> = match weights {
            [one] => vec![*one; n],
            all => (0..n).map(|c| all.get(c).copied().unwrap_or(0.0)).collect(),
        };
        image.one_channel(move |pixel| pixel.iter().zip(&weights).map(|(v, w)| v * w).sum())
    }

    /// Returns one channel with the greatest value of each pixel.
    #[must_use]
    pub fn channel_maximum(&self) -> Self {
        self.associated().one_channel(|pixel| pixel.iter().copied().fold(f32::NEG_INFINITY, f32::max))
    }

    /// Returns one channel with the least value of each pixel.
    #[must_use]
    pub fn channel_minimum(&self) -> Self {
        self.associated().one_channel(|pixel| pixel.iter().copied().fold(f32::INFINITY, f32::min))
    }

    /// Returns one channel that follows from the values of each pixel.
    fn one_channel(&self, value: impl Fn(&[f32]) -> f32 + Send + Sync + 'static) -> Self {
        let n = self.spec.nchannels();
        let source = Map::new(&*self.source, self.source.clone(), move |_, row| {
            row.chunks_exact_mut(n).for_each(|pixel| pixel[0] = value(pixel));
        });
        let mut out = self.with_source(Arc::new(source)).choose(vec![Origin::Channel(0, 0)]);
        out.spec.channels = ImageSpec::default_channels(1);
        out
    }
}

/// Returns names that are all different. A repeated one becomes `channelN`.
fn distinct(names: Vec<String>) -> Vec<String> {
    let mut out: Vec<String> = Vec::with_capacity(names.len());
    for (c, name) in names.into_iter().enumerate() {
        let name = if out.contains(&name) { format!("channel{c}") } else { name };
        out.push(name);
    }
    out
}

/// Returns the channels of the first image followed by those of the second one. The data window contains both.
///
/// # Errors
/// [`EditError::Misuse`] when the windows are too large.
pub fn append_channels(first: &Image, second: &Image) -> Result<Image> {
    let (first, second) = (first.associated(), second.associated());
    let window = first.data().union(&second.data())?;
    let pixel_type = first.spec.pixel_type.max(second.spec.pixel_type);
    let images = [first.crop(&window)?, second.crop(&window)?].map(|i| i.converted(pixel_type));
    let channels = (0..2).flat_map(|i| (0..images[i].spec.nchannels()).map(move |c| Origin::Channel(i, c)));
    let channels: Vec<Origin> = channels.collect();
    let shape = Shape { channels: channels.len(), ..images[0].source.shape() };
    let from = images.iter().map(|i| i.source.clone()).collect();
    let mut out = images[0].with_source(Arc::new(Chosen { shape, from, channels }));
    let names = images.iter().flat_map(|i| i.spec.channels.iter().cloned());
    out.spec.channels = distinct(names.collect());
    out.stored = first.stored;
    Ok(out)
}
