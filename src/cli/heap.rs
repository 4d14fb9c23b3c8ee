//! What the allocator does with memory that the server is done with.

/// Frames, batches and replies beyond this are mapped, bytes: they come from the system and go back
/// to it. Pages of the map and whatever else stays are smaller.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const MAPPED_BYTES: i32 = 128 << 10;
/// Heaps that all threads share. By default glibc gives eight for each core, and pages that one thread
/// makes and another one frees leave holes in all of them.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const HEAPS: i32 = 2;

/// Keeps the memory of a server where it is while its map does not grow. By default glibc stops to map
/// large buffers once it has seen one freed, and a server's heaps then grow by what happened to be in
/// use at the same time: a room in a loop took 5 % more within six minutes. Other allocators are left
/// as they are. To be called while the process has one thread.
pub(super) fn bound() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    for (what, value) in [(libc::M_MMAP_THRESHOLD, MAPPED_BYTES), (libc::M_ARENA_MAX, HEAPS)] {
        // SAFETY: sets a number of the allocator; the caller is the only thread.
        if unsafe { libc::mallopt(what, value) } == 0 {
            tracing::debug!(what, value, "the allocator refused a setting");
        }
    }
}
