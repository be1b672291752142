//! Exact count of a process's live allocations. Resident memory also depends on the system's allocator, which
//! returns little memory and fragments it.
//!
//! A test binary that uses the counts makes [`Counted`] its global allocator.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicIsize, Ordering};

/// The system's allocator with counters of blocks and bytes.
pub struct Counted;

static BLOCKS: AtomicIsize = AtomicIsize::new(0);
static BYTES: AtomicIsize = AtomicIsize::new(0);

/// Number of live blocks.
pub fn blocks() -> isize {
    BLOCKS.load(Ordering::Relaxed)
}

/// Bytes in live blocks.
pub fn bytes() -> isize {
    BYTES.load(Ordering::Relaxed)
}

// SAFETY: every call is forwarded to the system's allocator unchanged; counting does not allocate.
#[allow(unsafe_code)] // only a global allocator sees every allocation
unsafe impl GlobalAlloc for Counted {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        BLOCKS.fetch_add(1, Ordering::Relaxed);
        BYTES.fetch_add(layout.size() as isize, Ordering::Relaxed);
        unsafe { System.alloc(layout) }
    }

    unsafe fn realloc(&self, old: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        BYTES.fetch_add(size as isize - layout.size() as isize, Ordering::Relaxed);
        unsafe { System.realloc(old, layout, size) }
    }

    unsafe fn dealloc(&self, memory: *mut u8, layout: Layout) {
        BLOCKS.fetch_sub(1, Ordering::Relaxed);
        BYTES.fetch_sub(layout.size() as isize, Ordering::Relaxed);
        unsafe { System.dealloc(memory, layout) }
    }
}
