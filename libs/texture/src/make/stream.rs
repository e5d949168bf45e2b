//! Makes textures of one image while its rows are read. The image is never in memory as a whole.

use super::output::Plan;
use super::scan::Scan;
use super::source::{Band, Reader, Source, Units, pixels};
use super::writer::{Shelf, Writer};
use super::{Costs, Made, MakeOptions, Progress, power_of_two};
use crate::cube::is_openexr;
use crate::error::Result;
use crate::pyramid::level_sizes;
use crate::stage::{Forecast, Measure, Resample, Stage};
use crate::{TextureKind, Up, Wrap};
use granita_base::Filter;
use granita_image::{FormatRegistry, ImageSpec};
use std::path::Path;
use std::time::Instant;

/// A flat texture of one image.
pub(crate) struct Stream<'a> {
    pub(crate) source: Source,
    pub(crate) kind: TextureKind,
    pub(crate) wrap: (Wrap, Wrap),
    pub(crate) options: &'a MakeOptions,
    pub(crate) registry: &'a FormatRegistry,
    pub(crate) progress: Progress<'a>,
}

impl Stream<'_> {
    /// Returns the size of level 0.
    fn size(&self) -> (usize, usize) {
        let (w, h) = (self.source.width, self.source.height);
        if self.options.resize { (power_of_two(w), power_of_two(h)) } else { (w, h) }
    }

    /// Returns the number of rows of the input that are processed at once. All steps depend on the image and the
    /// options alone, so that the file does, too.
    fn rows_at_once(tile_height: u32) -> usize {
        if (16..=128).contains(&tile_height) { tile_height as usize } else { 64 }
    }

    fn reader<'a>(&'a self, plan: &Plan, size: (usize, usize)) -> Reader<'a> {
        let s = &self.source;
        let resize = (size != (s.width, s.height)).then(|| {
            Stage::new(Resample {
                from: (s.width, s.height),
                to: size,
                channels: s.channels,
                filter: Filter::CatmullRom,
                wrap: self.wrap,
                measure: Measure::Plane,
            })
        });
        Reader::new(s, s.conversion(self.options), plan.pixel_type, resize)
    }

    /// Makes the texture.
    pub(crate) fn make(self, path: &Path) -> Result<(Made, Costs)> {
        let up = (self.kind == TextureKind::LatLongEnvironment)
            .then(|| Up::of(&self.source.spec, is_openexr(self.source.format_name())));
        let mut plan = Plan::new(self.kind, up, &self.source.spec, self.options, self.registry)?;
        let mut size = self.size();
        let rows = Self::rows_at_once(plan.tile.1);
        let mut constant = false;
        if self.options.hash || self.options.constant_color {
            let start = Instant::now();
            let mut reader = self.reader(&plan, size);
            self.check_memory(&mut reader, &[], rows)?;
            let mut scan = Scan::new(size, self.source.channels, plan.pixel_type, self.options.hash);
            while let Some(band) = reader.next(rows)? {
                if !scan.push(&band.stored) {
                    break;
                }
            }
            plan.costs.scan = start.elapsed();
            if self.options.constant_color && scan.constant {
                constant = true;
                let tile = plan.tile(size.0, size.1);
                size = (size.0.min(tile.0 as usize), size.1.min(tile.1 as usize));
            }
            plan.describe_content(&scan, self.options);
        }
        let sizes = level_sizes(size.0, size.1);
        let specs: Vec<ImageSpec> =
            sizes.iter().map(|&(w, h)| plan.spec((w, h), (w as u32, h as u32), plan.tile(w, h))).collect();
        let writer = Writer::create(path, specs.clone(), self.options, self.registry, self.progress)?;
        let costs = if constant {
            self.constant(&plan, &specs, writer)?
        } else {
            self.levels(&plan, &sizes, &specs, writer)?
        };
        let mut notes: Vec<String> = self.source.notes().into_iter().collect();
        notes.append(&mut plan.notes);
        let made = Made::Written {
            width: specs[0].width,
            height: specs[0].height,
            levels: specs.len() as u32,
            notes,
        };
        let scan = plan.costs.scan;
        Ok((made, Costs { scan, ..costs }))
    }

    /// Writes all levels of an image whose pixels are all equal to the first.
    fn constant(&self, plan: &Plan, specs: &[ImageSpec], mut writer: Writer<'_>) -> Result<Costs> {
        let n = self.source.channels;
        let mut reader = self.reader(plan, (self.source.width, self.source.height));
        let first = reader.next(1)?.map(|band| band.stored);
        for (level, spec) in specs.iter().enumerate() {
            let count = spec.width as usize * spec.height as usize;
            let mut all = granita_image::Pixels::zeros(spec.pixel_type, count * n);
            if let Some(first) = &first {
                (0..count).for_each(|i| all.copy_from(i * n, first, 0, n));
            }
            writer.write(level, Shelf::new(spec).push(&all))?;
        }
        writer.finish()
    }

    /// Writes all levels in portions of rows. While rows are filtered, compressed and written, the next ones are read.
    fn levels(
        &self,
        plan: &Plan,
        sizes: &[(usize, usize)],
        specs: &[ImageSpec],
        mut writer: Writer<'_>,
    ) -> Result<Costs> {
        let rows = Self::rows_at_once(plan.tile.1);
        let mut reader = self.reader(plan, sizes[0]);
        let mut pyramid = self.pyramid(sizes, specs);
        self.check_memory(&mut reader, &pyramid.stages, rows)?;
        pyramid.units = reader.units;
        let mut read = |costs: &mut std::time::Duration| {
            let start = Instant::now();
            let band = reader.next(rows);
            *costs += start.elapsed();
            band
        };
        let mut reading = std::time::Duration::ZERO;
        let mut band = read(&mut reading)?;
        while let Some(current) = band {
            let (next, written) = rayon::join(|| read(&mut reading), || pyramid.push(current, &mut writer));
            written?;
            band = next?;
        }
        writer.costs.read = reading;
        writer.finish()
    }

    fn pyramid(&self, sizes: &[(usize, usize)], specs: &[ImageSpec]) -> Pyramid {
        let n = self.source.channels;
        let measure = Measure::of(self.kind);
        let stage = |pair: &[(usize, usize)]| {
            Stage::new(Resample {
                from: pair[0],
                to: pair[1],
                channels: n,
                filter: self.options.filter,
                wrap: self.wrap,
                measure,
            })
        };
        Pyramid {
            stages: sizes.windows(2).map(stage).collect(),
            shelves: specs.iter().map(Shelf::new).collect(),
            channels: n,
            units: Units::Fractions,
            conversion: self.source.conversion(self.options),
        }
    }

    /// Checks that the memory that grows with the height of the image is permitted by the options. It holds the rows
    /// that stages keep until the last one arrives, and what reading takes.
    fn check_memory(&self, reader: &mut Reader<'_>, stages: &[Stage], rows: usize) -> Result<()> {
        // This is checked before anything is read, even the rows that are read ahead.
        super::allow_memory(&self.source.path, self.source.working_bytes(), self.options)?;
        let mut first = reader.resize()?.map(Forecast::new);
        let mut others: Vec<Forecast<'_>> = stages.iter().map(Forecast::new).collect();
        for y in (0..self.source.height).step_by(rows) {
            let rows = rows.min(self.source.height - y);
            let mut count = first.as_mut().map_or(rows, |first| first.push(rows));
            for stage in &mut others {
                count = stage.push(count);
            }
        }
        let held: u64 = first.iter().chain(&others).map(Forecast::growing_bytes).sum();
        let bytes = held.saturating_add(self.source.working_bytes());
        super::allow_memory(&self.source.path, bytes, self.options)
    }
}

/// The levels of an image whose rows arrive in portions.
struct Pyramid {
    /// The stages from each level to the next.
    stages: Vec<Stage>,
    /// The shelves, one per level.
    shelves: Vec<Shelf>,
    channels: usize,
    units: Units,
    conversion: super::color::Conversion,
}

impl Pyramid {
    fn push(&mut self, band: Band, writer: &mut Writer<'_>) -> Result<()> {
        let tiles = self.shelves[0].push(&band.stored);
        drop(band.stored);
        writer.write(0, tiles)?;
        let mut floats = band.floats;
        for level in 1..self.shelves.len() {
            let start = Instant::now();
            floats = self.stages[level - 1].push(&floats);
            if floats.is_empty() {
                break;
            }
            let shelf = &mut self.shelves[level];
            let stored =
                pixels(floats.clone(), self.channels, shelf.pixel_type(), self.units, Some(&self.conversion));
            let tiles = shelf.push(&stored);
            writer.costs.filter += start.elapsed();
            writer.write(level, tiles)?;
        }
        Ok(())
    }
}
