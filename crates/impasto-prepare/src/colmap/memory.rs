//! How many photos can be looked at at once.

use crate::photos::Taken;

/// COLMAP shrinks longer sides to this before it looks for features.
const LONGEST: f64 = 3200.0;
/// Bytes that the search for features takes per pixel of a photo: a pyramid of floats whose lowest
/// level is twice as wide and high. (Measured with COLMAP 3.8: 1.97 GB for 3200×2134.)
const BYTES_PER_PIXEL: f64 = 290.0;
/// Share of the free memory that may be used.
const SHARE: f64 = 0.7;

/// How many threads of `cores` may look for features at once without running out of memory.
pub(crate) fn extraction_threads(photos: &[Taken], cores: usize) -> usize {
    let largest = photos
        .iter()
        .map(|photo| {
            let (w, h) = (f64::from(photo.size.0), f64::from(photo.size.1));
            w * h * (LONGEST / w.max(h)).min(1.0).powi(2)
        })
        .fold(1.0, f64::max);
    let fit = |bytes: f64| (SHARE * bytes / (BYTES_PER_PIXEL * largest)) as usize;
    free().map_or(cores, |bytes| fit(bytes).clamp(1, cores))
}

/// Bytes of memory that can be had without swapping, where the system tells.
fn free() -> Option<f64> {
    let text = std::fs::read_to_string("/proc/meminfo").ok()?;
    let mut lines = text.lines();
    let line = lines.find_map(|line| line.strip_prefix("MemAvailable:"))?;
    let kibibytes: f64 = line.split_whitespace().next()?.parse().ok()?;
    Some(1024.0 * kibibytes)
}
