//! Memory that stays with the process.

use libmimalloc_sys::{mi_option_set, mi_option_t, mi_option_use_numa_nodes};

/// Training allocates and frees the same large buffers at every step. The system's allocator
/// returns such buffers to the kernel at once, and each new one then faults in page by page.
#[global_allocator]
static ALLOCATOR: mimalloc::MiMalloc = mimalloc::MiMalloc;

/// `mi_option_purge_delay`, which the bindings do not name, stands directly before this one in
/// mimalloc.h.
const PURGE_DELAY: mi_option_t = mi_option_use_numa_nodes - 1;

/// Never gives freed memory back to the kernel while the process runs. To be called first.
pub fn keep() {
    // SAFETY: sets one entry of mimalloc's table of options; the index is within the table, and
    // no other thread is running yet.
    unsafe { mi_option_set(PURGE_DELAY, -1) };
}
