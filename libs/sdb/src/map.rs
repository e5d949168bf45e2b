//! Files in memory.
#![allow(
    unsafe_code,
    reason = "mapping a file is unsafe: another process might shorten it while it is looked at"
)]

use std::fs::File;
use std::io;

/// The numbers of a mapped file.
#[derive(Debug)]
pub(crate) struct Map {
    map: memmap2::Mmap,
    /// First byte of the numbers, a multiple of four.
    from: usize,
}

impl Map {
    /// Maps a whole file.
    pub(crate) fn open(file: &File) -> io::Result<Self> {
        // SAFETY: the map is only read. Files of databases are replaced as a whole, by renaming, and never changed in
        // place by this suite; what a foreign program does to a file in use is outside of what can be guarded against.
        let map = unsafe { memmap2::Mmap::map(file)? };
        Ok(Self { map, from: 0 })
    }

    pub(crate) fn bytes(&self) -> &[u8] {
        &self.map
    }

    /// The same with its numbers beginning at byte `from`; `None` when what follows is no row of numbers.
    pub(crate) fn at(self, from: usize) -> Option<Self> {
        bytemuck::try_cast_slice::<u8, f32>(self.map.get(from..)?).ok()?;
        Some(Self { from, ..self })
    }

    #[inline]
    pub(crate) fn numbers(&self) -> &[f32] {
        bytemuck::try_cast_slice(&self.map[self.from..]).unwrap_or_default()
    }
}
