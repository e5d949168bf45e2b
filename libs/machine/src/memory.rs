//! Mapped files and large pages.

#![allow(
    unsafe_code,
    reason = "mapping a file is unsafe: another process might shorten it while it is looked at"
)]

use std::fs::File;
use std::io;

/// A mapped file, with access to its numbers.
#[derive(Debug)]
pub struct Map {
    map: memmap2::Mmap,
    /// The offset of the first byte of the numbers, a multiple of four.
    from: usize,
}

impl Map {
    /// Maps a whole file.
    ///
    /// # Errors
    /// The error of the system call.
    pub fn open(file: &File) -> io::Result<Self> {
        // SAFETY: the map is only read. Files that are mapped are replaced as a whole, by renaming, and never changed
        // in place by this suite; what a foreign program does to a file in use is outside of what can be guarded
        // against.
        let map = unsafe { memmap2::Mmap::map(file)? };
        Ok(Self { map, from: 0 })
    }

    /// Returns all bytes of the file.
    pub fn bytes(&self) -> &[u8] {
        &self.map
    }

    /// Returns the map with its numbers beginning at byte `from`; `None` when the rest of the file is not a whole
    /// number of aligned floats.
    #[must_use]
    pub fn at(self, from: usize) -> Option<Self> {
        bytemuck::try_cast_slice::<u8, f32>(self.map.get(from..)?).ok()?;
        Some(Self { from, ..self })
    }

    /// Returns the numbers.
    #[inline]
    pub fn numbers(&self) -> &[f32] {
        bytemuck::try_cast_slice(&self.map[self.from..]).unwrap_or_default()
    }
}

/// Returns an empty list with a capacity of `n`, in large pages where the system provides them on request. Structures
/// that are accessed at random, such as the nodes of a tree, need more small pages than the processor's page table
/// cache holds. Large pages give a third more incoherent rays per second.
pub fn with_large_pages<T>(n: usize) -> Vec<T> {
    let list: Vec<T> = Vec::with_capacity(n);
    #[cfg(target_os = "linux")]
    {
        const PAGE: usize = 4096;
        let bytes = n * size_of::<T>();
        let first = list.as_ptr().cast::<u8>();
        let skip = first.align_offset(PAGE);
        let start = first.wrapping_add(skip);
        if let Some(length) = bytes.checked_sub(skip).map(|b| b / PAGE * PAGE).filter(|b| *b >= LARGE) {
            // SAFETY: the whole pages of memory that the list owns; the advice changes nothing of what is there, and
            // whether it is taken does not matter.
            unsafe { libc::madvise(start.cast_mut().cast(), length, libc::MADV_HUGEPAGE) };
        }
    }
    list
}

/// The size in bytes from which on large pages are requested.
#[cfg(target_os = "linux")]
const LARGE: usize = 4 << 20;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_in_large_pages_keep_their_values() {
        for n in [0, 10, 5 << 20] {
            let mut list: Vec<u32> = with_large_pages(n);
            list.extend(0..n as u32);
            assert!(list.iter().enumerate().all(|(i, v)| i == *v as usize));
        }
    }
}
