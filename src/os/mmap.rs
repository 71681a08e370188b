//! The only module that creates memory maps, and so the only one with `unsafe`.
//!
//! Maps only files that this program wrote and closed, never the input: an input that shrinks while mapped would end
//! the process with SIGBUS. The files lie in the work folder, which is locked by the job.
#![allow(unsafe_code, reason = "the fence: a memory map cannot be made in safe Rust")]

use std::fs::File;
use std::marker::PhantomData;
use std::ops::Deref;

use bytemuck::Pod;
use memmap2::{Mmap, MmapOptions};

/// A read-only mapped range of a file, as a slice of records.
#[derive(Debug)]
pub struct MappedRecords<T> {
    map: Option<Mmap>,
    record: PhantomData<T>,
}

/// Maps `count` records from `offset_bytes` on; the range must lie within the file.
///
/// The pages are released when the value is dropped.
///
/// # Errors
/// The error of the system call, or `InvalidInput` if the range exceeds the file or is not aligned for `T`.
pub fn map_records<T: Pod>(file: &File, offset_bytes: u64, count: usize) -> std::io::Result<MappedRecords<T>> {
    let passes_end = || std::io::Error::new(std::io::ErrorKind::InvalidInput, "range passes the end of the file");
    let bytes = count.checked_mul(size_of::<T>()).ok_or_else(passes_end)?;
    if bytes == 0 {
        return Ok(MappedRecords { map: None, record: PhantomData });
    }
    let end = offset_bytes.checked_add(bytes as u64).ok_or_else(passes_end)?;
    if file.metadata()?.len() < end {
        return Err(passes_end());
    }
    // SAFETY: the map is read-only and private to this value. What stays possible: another process truncates a file
    // of the locked work folder while it is mapped, which ends this process with SIGBUS; no memory is corrupted,
    // since a `Pod` type is valid for any bytes.
    let map = unsafe { MmapOptions::new().offset(offset_bytes).len(bytes).map(file)? };
    if bytemuck::try_cast_slice::<u8, T>(&map).is_err() {
        return Err(std::io::Error::new(std::io::ErrorKind::InvalidInput, "range is not aligned"));
    }
    Ok(MappedRecords { map: Some(map), record: PhantomData })
}

/// Allocations of at least this many bytes get a mapping of their own.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const LARGE_ALLOCATION_BYTES: libc::c_int = 4 << 20;

/// Makes large allocations return to the system when they are freed; call once, before threads start.
///
/// By default, glibc adapts to freed mappings and keeps allocations of up to 32 MiB in the heap of each thread, where
/// the holes between them stay resident: c4m at 256 MiB peaked at 172 MiB, and at 101 MiB with this. mimalloc 2 peaked
/// at 208 MiB and was slower. No effect on other systems.
pub fn map_large_allocations() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    // SAFETY: `mallopt` takes plain numbers; it is called before any other thread could allocate. What stays possible:
    // an allocator put in its place at load time ignores the call, and memory is as it would be without.
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, LARGE_ALLOCATION_BYTES);
        libc::mallopt(libc::M_TRIM_THRESHOLD, LARGE_ALLOCATION_BYTES);
    }
}

/// Returns freed memory to the system; call after many small allocations were freed.
///
/// The buffers of many cells are small, and later allocations keep their pages resident: 43 MiB for 56 million
/// triangles at 512 MiB. No effect on other systems.
pub fn release_freed_memory() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    // SAFETY: `malloc_trim` takes a plain number and touches free memory only; it is safe in any thread.
    unsafe {
        libc::malloc_trim(0);
    }
}

impl<T: Pod> Deref for MappedRecords<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        self.map.as_ref().map_or(&[], |map| bytemuck::cast_slice(map))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_are_those_of_the_range() {
        let mut file = tempfile::tempfile().unwrap();
        std::io::Write::write_all(&mut file, bytemuck::cast_slice(&[1u32, 2, 3, 4])).unwrap();
        assert_eq!(*map_records::<u32>(&file, 4, 2).unwrap(), [2, 3]);
        assert_eq!(*map_records::<u32>(&file, 0, 4).unwrap(), [1, 2, 3, 4]);
        assert!(map_records::<u32>(&file, 16, 0).unwrap().is_empty());
    }

    #[test]
    fn a_range_that_the_file_does_not_hold_is_refused() {
        let file = tempfile::tempfile().unwrap();
        file.set_len(16).unwrap();
        let past = [(0, 5), (4, 4), (16, 1), (u64::MAX, 1), (0, usize::MAX), (8, usize::MAX / 4 + 2), (2, 1 << 62)];
        for (offset, count) in past {
            assert!(map_records::<u32>(&file, offset, count).is_err(), "{count} records at {offset}");
        }
        assert!(map_records::<u32>(&file, 2, 1).is_err(), "not aligned");
    }
}
