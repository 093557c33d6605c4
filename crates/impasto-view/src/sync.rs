//! Locks that survive a thread's panic: the studio closes then, and says why.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Waits to be notified, or for so long.
pub(crate) fn wait<'a, T>(
    work: &Condvar,
    guard: MutexGuard<'a, T>,
    most: Duration,
) -> MutexGuard<'a, T> {
    let waited = work.wait_timeout(guard, most);
    waited.unwrap_or_else(PoisonError::into_inner).0
}
