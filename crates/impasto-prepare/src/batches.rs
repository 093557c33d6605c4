//! Work on many pictures at once.

use rayon::prelude::*;

use crate::error::PrepareError;

/// What `work` makes of each item, in order. As many are worked on at once as there are threads: so
/// many decoded pictures are in memory at most. `tick` hears how many are done.
pub(crate) fn in_batches<T: Sync, R: Send>(
    items: &[T],
    tick: &mut dyn FnMut(usize),
    work: impl Fn(&T) -> Result<R, PrepareError> + Sync,
) -> Result<Vec<R>, PrepareError> {
    let mut made = Vec::with_capacity(items.len());
    for batch in items.chunks(rayon::current_num_threads().max(1)) {
        let batch: Result<Vec<R>, _> = batch.par_iter().map(&work).collect();
        made.extend(batch?);
        tick(made.len());
    }
    Ok(made)
}
