//! Files in which any row can be found, which are read by position, a few rows at a time.

use granita_image::{FileSource, ImageInput, ImageSpec, Limits, Pixels, Result};

/// The access to the rows of a format.
pub(crate) trait Rows: Send + Sync {
    /// Returns rows `y0..y1` of a level, which exist and which the limits permit.
    fn rows(
        &self,
        source: &FileSource,
        spec: &ImageSpec,
        at: (usize, usize),
        y0: u32,
        y1: u32,
    ) -> Result<Pixels>;

    /// Returns the bytes of memory that reading rows takes beside the rows.
    fn working_bytes(&self, spec: &ImageSpec) -> u64 {
        let _ = spec;
        0
    }
}

/// An open file of such a format. Only requested rows are read, from any thread.
pub(crate) struct RowsInput<R> {
    name: &'static str,
    source: FileSource,
    limits: Limits,
    images: Vec<Vec<ImageSpec>>,
    rows: R,
}

impl<R: Rows> RowsInput<R> {
    /// Returns an open file. `images` are the images of the file with their levels, at least one of each. All are
    /// checked.
    pub(crate) fn new(
        name: &'static str,
        format: &'static str,
        source: FileSource,
        limits: &Limits,
        images: Vec<Vec<ImageSpec>>,
        rows: R,
    ) -> Result<Self> {
        let path = source.path();
        limits.within(path, "number of images", images.len() as u64, u64::from(limits.images))?;
        for spec in images.iter().flatten() {
            limits.check(path, format, spec)?;
        }
        Ok(Self { name, source, limits: limits.clone(), images, rows })
    }
}

impl<R: Rows> ImageInput for RowsInput<R> {
    fn format_name(&self) -> &'static str {
        self.name
    }

    fn images(&self) -> usize {
        self.images.len()
    }

    fn levels(&self, image: usize) -> usize {
        self.images.get(image).map_or(0, Vec::len)
    }

    fn spec(&self, image: usize, level: usize) -> Option<&ImageSpec> {
        self.images.get(image)?.get(level)
    }

    fn read_rows(&self, image: usize, level: usize, y0: u32, y1: u32) -> Result<Pixels> {
        let Some(spec) = self.spec(image, level) else {
            return Err(self.source.misuse(format!("there is no level {level} of image {image}")));
        };
        if y0 > y1 || y1 > spec.height {
            return Err(self.source.misuse(format!("rows {y0} to {y1} of an image with {}", spec.height)));
        }
        self.limits.check_read(self.source.path(), spec, spec.width, y1 - y0)?;
        if y0 == y1 {
            return Ok(Pixels::zeros(spec.pixel_type, 0));
        }
        self.rows.rows(&self.source, spec, (image, level), y0, y1)
    }

    fn read_tile(&self, _image: usize, _level: usize, _tx: u32, _ty: u32) -> Result<Pixels> {
        Err(self.source.misuse("a tile of an image stored in rows"))
    }

    fn bytes_read(&self) -> u64 {
        self.source.bytes_read()
    }

    fn working_bytes(&self, image: usize, level: usize) -> u64 {
        self.spec(image, level).map_or(0, |spec| self.rows.working_bytes(spec))
    }
}

/// Checks a file that ends before its last row. It is opened when its first row is available. Missing rows are then
/// separate errors. `at` is the offset of the first stored row.
///
/// # Errors
/// Returns an error when not even one row is available.
pub(crate) fn ends_early(source: &FileSource, spec: &ImageSpec, at: u64) -> Result<()> {
    let row = u64::from(spec.width) * spec.nchannels() as u64 * spec.pixel_type.bytes() as u64;
    let there = source.len().saturating_sub(at);
    if row > 0 && there >= row {
        return Ok(());
    }
    let wanted = row.saturating_mul(u64::from(spec.height));
    Err(source.malformed(format!("{wanted} bytes of pixels, of which the file has {there}")))
}

/// Rows of equal length one after the other, which is the simplest kind of file.
pub(crate) struct PlainRows {
    /// The offset of the first stored row.
    pub(crate) at: u64,
    pub(crate) big_endian: bool,
    /// True when the first stored row is the lowest of the image.
    pub(crate) upward: bool,
}

impl Rows for PlainRows {
    fn rows(
        &self,
        source: &FileSource,
        spec: &ImageSpec,
        _at: (usize, usize),
        y0: u32,
        y1: u32,
    ) -> Result<Pixels> {
        let values = spec.width as usize * spec.nchannels();
        let row = (values * spec.pixel_type.bytes()) as u64;
        let first = if self.upward { spec.height - y1 } else { y0 };
        let (from, count) = (self.at + u64::from(first) * row, u64::from(y1 - y0));
        if from.saturating_add(count * row) > source.len() {
            let there = (source.len().saturating_sub(self.at) / row).min(u64::from(spec.height));
            let what = format!("the file ends early: {there} of {} rows are there", spec.height);
            return Err(source.malformed(what));
        }
        let bytes = source.read_vec(from, row * count, "the pixels")?;
        let stored = Pixels::from_bytes(spec.pixel_type, bytes, self.big_endian);
        if !self.upward {
            return Ok(stored);
        }
        let mut pixels = Pixels::zeros(spec.pixel_type, stored.len());
        let count = (y1 - y0) as usize;
        for y in 0..count {
            pixels.copy_from(y * values, &stored, (count - 1 - y) * values, values);
        }
        Ok(pixels)
    }
}
