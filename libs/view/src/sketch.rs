//! A rough image of a page from a few of its rows, which is shown until the page itself has been read.

use crate::tile::{Tile, cut};
use granita_image::{ImageInput, ImageSpec, Pixels};
use rayon::prelude::*;

/// One of this number of blocks of rows is read.
const EVERY: u32 = 8;

/// The largest number of rows in one block. With more, the rough image would cost too much.
const MOST_TOGETHER: u32 = 64;

/// The smallest number of pixels of an image for which a rough image is made. Smaller ones are read at once.
const LEAST_PIXELS: u64 = 1 << 21;

/// A rough image.
#[derive(Debug)]
pub struct Sketch {
    /// The number of halvings from the page to the rough image.
    pub halvings: u32,
    /// All of its tiles, by column and row.
    pub tiles: Vec<((u32, u32), Tile)>,
}

/// A block of rows of an image, reduced to one. It has the position of the middle of the block in pixels, and means
/// over spans of columns.
struct Line {
    middle: f32,
    values: Vec<f32>,
}

/// Makes a rough image of a file whose rows are stored in independent blocks of `together` rows. Returns `None`
/// when it would not be faster, or a part cannot be read.
pub(crate) fn of_rows(
    input: &dyn ImageInput,
    image: usize,
    spec: &ImageSpec,
    together: u32,
) -> Option<Sketch> {
    let (n, blocks) = (spec.nchannels(), spec.height.div_ceil(together.max(1)));
    let pixels = u64::from(spec.width) * u64::from(spec.height);
    if together > MOST_TOGETHER || blocks < 4 * EVERY || pixels < LEAST_PIXELS || n == 0 {
        return None;
    }
    let halvings = together.clamp(8, MOST_TOGETHER).next_power_of_two().ilog2();
    let scale = 1_u32 << halvings;
    let (width, height) = (spec.width.div_ceil(scale), spec.height.div_ceil(scale));
    let chosen: Vec<u32> = (EVERY / 2..blocks).step_by(EVERY as usize).collect();
    let lines: Option<Vec<Line>> = (chosen.into_par_iter())
        .map(|block| {
            let (y0, y1) = (block * together, (block * together).saturating_add(together).min(spec.height));
            let pixels = input.read_rows(image, 0, y0, y1).ok()?;
            let values = means(&pixels, spec.width as usize, n, scale as usize);
            Some(Line { middle: (y0 + y1) as f32 / 2.0, values })
        })
        .collect();
    let lines = lines?;
    let mut values = Vec::with_capacity(width as usize * height as usize * n);
    for y in 0..height {
        let middle = (y as f32 + 0.5) * scale as f32;
        let below = lines.partition_point(|line| line.middle <= middle);
        let (a, b) = (&lines[below.saturating_sub(1)], &lines[below.min(lines.len() - 1)]);
        let t = if b.middle > a.middle {
            ((middle - a.middle) / (b.middle - a.middle)).clamp(0.0, 1.0)
        } else {
            0.0
        };
        values.extend(a.values.iter().zip(&b.values).map(|(a, b)| a + (b - a) * t));
    }
    let pixels = Pixels::from_floats(spec.pixel_type, &values);
    Some(Sketch { halvings, tiles: cut((width, height), n, 0, &pixels) })
}

/// Returns means over spans of `scale` columns and over a few of the rows.
fn means(pixels: &Pixels, width: usize, n: usize, scale: usize) -> Vec<f32> {
    const ROWS: usize = 4;
    let rows = pixels.len() / (width * n);
    let step = rows.div_ceil(ROWS).max(1);
    let mut sums = vec![0.0_f32; width.div_ceil(scale) * n];
    let (mut room, mut count) = (Vec::new(), 0.0_f32);
    for y in (0..rows).step_by(step) {
        let row = pixels.floats_of(y * width * n..(y + 1) * width * n, &mut room);
        for (sum, span) in sums.chunks_exact_mut(n).zip(row.chunks(scale * n)) {
            let share = 1.0 / (span.len() / n) as f32;
            for pixel in span.chunks_exact(n) {
                sum.iter_mut().zip(pixel).for_each(|(sum, v)| *sum += share * v);
            }
        }
        count += 1.0;
    }
    sums.iter_mut().for_each(|sum| *sum /= count.max(1.0));
    sums
}
