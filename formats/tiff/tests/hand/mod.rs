//! TIFF files of kinds that the writer does not support, built byte by byte.

use std::io::Write;

/// The kinds of values in a directory.
pub(crate) const SHORT: u16 = 3;
pub(crate) const RATIONAL: u16 = 5;

/// A file of one image.
#[derive(Clone, Debug)]
pub(crate) struct File {
    pub(crate) big_endian: bool,
    pub(crate) size: (usize, usize),
    pub(crate) samples: usize,
    pub(crate) bits: usize,
    /// The size of tiles. `None` is strips of three rows.
    pub(crate) tile: Option<(usize, usize)>,
    pub(crate) separate: bool,
    /// The number of the compression: 1 none, 5 LZW, 8 deflate, 50000 Zstandard.
    pub(crate) compression: u64,
    /// The number of the predictor: 1 or 2 for integers, 1 or 3 for floats.
    pub(crate) predictor: u64,
    /// Further entries, as tag, kind and values. A fraction is two values.
    pub(crate) tags: Vec<(u16, u16, Vec<u64>)>,
}

impl File {
    pub(crate) fn new(size: (usize, usize), samples: usize, bits: usize) -> Self {
        Self {
            big_endian: false,
            size,
            samples,
            bits,
            tile: None,
            separate: false,
            compression: 1,
            predictor: 1,
            tags: Vec::new(),
        }
    }

    pub(crate) fn with(mut self, tag: u16, values: &[u64]) -> Self {
        self.tags.push((tag, SHORT, values.to_vec()));
        self
    }

    fn number(&self, n: u64, bytes: usize) -> Vec<u8> {
        if self.big_endian {
            n.to_be_bytes()[8 - bytes..].to_vec()
        } else {
            n.to_le_bytes()[..bytes].to_vec()
        }
    }

    pub(crate) fn chunk(&self) -> (usize, usize) {
        self.tile.unwrap_or((self.size.0, 3))
    }

    /// Returns one strip or tile from rows of numbers, which are the bits of whole bytes.
    fn pack(&self, rows: &[Vec<u64>], samples: usize) -> Vec<u8> {
        let bytes = self.bits / 8;
        let mut out = Vec::new();
        for row in rows {
            let mut row = row.clone();
            if self.predictor == 2 {
                for i in (samples..row.len()).rev() {
                    row[i] = row[i].wrapping_sub(row[i - samples]);
                }
            }
            if self.predictor == 3 {
                let mut planes: Vec<u8> =
                    (0..bytes).rev().flat_map(|k| row.iter().map(move |n| (n >> (8 * k)) as u8)).collect();
                for i in (samples..planes.len()).rev() {
                    planes[i] = planes[i].wrapping_sub(planes[i - samples]);
                }
                out.extend(planes);
            } else {
                out.extend(row.iter().flat_map(|n| self.number(*n, bytes)));
            }
        }
        out
    }

    /// Returns the file of these numbers, with all channels of a pixel together. They are unsigned, or the bits of
    /// other types.
    pub(crate) fn of_numbers(&self, values: &[u64]) -> Vec<u8> {
        let (w, h) = self.chunk();
        let planes: Vec<Vec<usize>> = if self.separate {
            (0..self.samples).map(|c| vec![c]).collect()
        } else {
            vec![(0..self.samples).collect()]
        };
        let mut chunks = Vec::new();
        for plane in planes {
            for top in (0..self.size.1).step_by(h) {
                for left in (0..self.size.0).step_by(w) {
                    let rows = if self.tile.is_some() { h } else { h.min(self.size.1 - top) };
                    let at = |x: usize, y: usize, c: usize| {
                        let (x, y) = ((left + x).min(self.size.0 - 1), (top + y).min(self.size.1 - 1));
                        values[(y * self.size.0 + x) * self.samples + c]
                    };
                    let rows: Vec<Vec<u64>> = (0..rows)
                        .map(|y| {
                            (0..w)
                                .flat_map(|x| plane.iter().map(move |c| (x, *c)))
                                .map(|(x, c)| at(x, y, c))
                                .collect()
                        })
                        .collect();
                    chunks.push(self.pack(&rows, plane.len()));
                }
            }
        }
        self.of_chunks(&chunks)
    }

    fn compressed(&self, data: &[u8]) -> Vec<u8> {
        match self.compression {
            5 => weezl::encode::Encoder::with_tiff_size_switch(weezl::BitOrder::Msb, 8).encode(data).unwrap(),
            8 => {
                let mut deflate = flate2::write::ZlibEncoder::new(Vec::new(), Default::default());
                deflate.write_all(data).unwrap();
                deflate.finish().unwrap()
            }
            50000 => ruzstd::encoding::compress_to_vec(data, ruzstd::encoding::CompressionLevel::Fastest),
            _ => data.to_vec(),
        }
    }

    /// Returns the file of these strips or tiles, after compressing them.
    pub(crate) fn of_chunks(&self, chunks: &[Vec<u8>]) -> Vec<u8> {
        let mut file = if self.big_endian { b"MM\0\x2a".to_vec() } else { b"II\x2a\0".to_vec() };
        file.extend([0; 4]);
        let (mut offsets, mut counts) = (Vec::new(), Vec::new());
        for chunk in chunks {
            let data = self.compressed(chunk);
            offsets.push(file.len() as u64);
            counts.push(data.len() as u64);
            file.extend(data);
        }
        let mut tags = vec![
            (256, SHORT, vec![self.size.0 as u64]),
            (257, SHORT, vec![self.size.1 as u64]),
            (258, SHORT, vec![self.bits as u64; self.samples]),
            (259, SHORT, vec![self.compression]),
            (277, SHORT, vec![self.samples as u64]),
            (284, SHORT, vec![if self.separate { 2 } else { 1 }]),
            (317, SHORT, vec![self.predictor]),
        ];
        let (w, h) = self.chunk();
        match self.tile {
            Some(_) => tags.extend([
                (322, SHORT, vec![w as u64]),
                (323, SHORT, vec![h as u64]),
                (324, 4, offsets),
                (325, 4, counts),
            ]),
            None => tags.extend([(273, 4, offsets), (278, SHORT, vec![h as u64]), (279, 4, counts)]),
        }
        tags.extend(self.tags.iter().cloned());
        tags.sort();
        self.finish(file, &tags)
    }

    /// Appends the directory.
    fn finish(&self, mut file: Vec<u8>, tags: &[(u16, u16, Vec<u64>)]) -> Vec<u8> {
        let mut directory = self.number(tags.len() as u64, 2);
        for (tag, kind, values) in tags {
            let (size, count) = match *kind {
                SHORT => (2, values.len()),
                RATIONAL => (4, values.len() / 2),
                _ => (4, values.len()),
            };
            let mut bytes: Vec<u8> = values.iter().flat_map(|v| self.number(*v, size)).collect();
            if bytes.len() > 4 {
                let offset = self.number(file.len() as u64, 4);
                file.extend(std::mem::replace(&mut bytes, offset));
            }
            bytes.resize(4, 0);
            directory.extend(self.number(u64::from(*tag), 2));
            directory.extend(self.number(u64::from(*kind), 2));
            directory.extend(self.number(count as u64, 4));
            directory.extend(bytes);
        }
        directory.extend([0; 4]);
        let offset = self.number(file.len() as u64, 4);
        file[4..8].copy_from_slice(&offset);
        file.extend(directory);
        file
    }
}
