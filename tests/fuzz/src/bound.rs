//! Memory, of which nothing from outside may ask for much at once.

use std::alloc::{GlobalAlloc, Layout, System};
use std::io::Write;

/// More than any answer to a good input takes in one piece, bytes.
const MOST: usize = 512 << 20;

struct Bounded;

#[global_allocator]
static MEMORY: Bounded = Bounded;

fn check(bytes: usize) {
    if bytes > MOST {
        // Whoever asks for so much has believed an input.
        let _ = std::io::stderr().write_all(b"an allocation is larger than 512 MiB\n");
        std::process::abort();
    }
}

// SAFETY: the system's allocator does all of the work.
unsafe impl GlobalAlloc for Bounded {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        check(layout.size());
        // SAFETY: as our caller promises.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        check(layout.size());
        // SAFETY: as our caller promises.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        check(size);
        // SAFETY: as our caller promises.
        unsafe { System.realloc(pointer, layout, size) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as our caller promises.
        unsafe { System.dealloc(pointer, layout) }
    }
}
