//! How much is rendered at a time, from how fast rendering is.

use std::time::Duration;

/// Time that a coarse picture may take.
const COARSE: f64 = 0.08;
/// Time between two checks of what is wanted now.
const BAND: f64 = 0.12;
/// Coarsest picture, as a part of the view's width.
const COARSEST: f64 = 1.0 / 16.0;
/// Bands begin and end between blocks of JPEG.
const BLOCK: u32 = 8;
/// Rays a second that are believed in before any were measured.
const BEGINNING: f64 = 100_000.0;
/// Pieces with fewer rays say more of what surrounds rendering than of rendering.
const TELLING: usize = 256;

/// Measured speed.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pace {
    rate: f64,
}

impl Default for Pace {
    fn default() -> Self {
        Self { rate: BEGINNING }
    }
}

impl Pace {
    /// Takes note of rendered rays.
    pub(crate) fn note(&mut self, rays: usize, time: Duration) {
        let rate = rays as f64 / time.as_secs_f64().max(1e-6);
        if rays >= TELLING && rate.is_finite() {
            // The last few pieces count; a busy machine slows down and comes back within them.
            self.rate += 0.4 * (rate - self.rate);
        }
    }

    /// Width and height of a coarse picture; the view's own where that is fast enough.
    pub(crate) fn coarse(&self, width: u32, height: u32) -> (u32, u32) {
        let pixels = f64::from(width) * f64::from(height);
        let scale = (self.rate * COARSE / pixels).sqrt().clamp(COARSEST, 1.0);
        // Hardly coarser is not worth a second picture.
        let scale = if scale > 0.85 { 1.0 } else { scale };
        let side = |side: u32| ((f64::from(side) * scale).round() as u32).clamp(1, side);
        (side(width), side(height))
    }

    /// Rows of a band of a sharp picture.
    pub(crate) fn rows(&self, width: u32, height: u32) -> u32 {
        // Saturates.
        let rows = (self.rate * BAND / f64::from(width)) as u32;
        (rows / BLOCK * BLOCK).clamp(BLOCK, height.max(BLOCK))
    }
}

/// First row and number of rows of bands, the middle ones first.
pub(crate) fn bands(height: u32, rows: u32) -> Vec<(u32, u32)> {
    let mut bands: Vec<(u32, u32)> = (0..height)
        .step_by(rows.max(1) as usize)
        .map(|from| (from, rows.min(height - from)))
        .collect();
    bands.sort_by_key(|(from, count)| (2 * from + count).abs_diff(height));
    bands
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bands_cover_a_view_once_from_the_middle() {
        for (height, rows) in [(360, 48), (7, 8), (8, 8), (1, 8), (100, 1)] {
            let mut covered = bands(height, rows);
            assert!(covered[0].0 <= height / 2 && height / 2 <= covered[0].0 + covered[0].1);
            covered.sort_unstable();
            let end = covered.iter().fold(0, |end, (from, count)| {
                assert_eq!(*from, end);
                from + count
            });
            assert_eq!(end, height);
        }
    }

    #[test]
    fn pictures_are_as_coarse_as_the_machine_is_slow() {
        let mut pace = Pace::default();
        for _ in 0..20 {
            pace.note(10_000, Duration::from_millis(100));
        }
        let (width, height) = pace.coarse(640, 360);
        assert!((7000..9000).contains(&(width * height)), "{width}×{height}");
        assert_eq!(pace.rows(640, 360), 16);
        for _ in 0..40 {
            pace.note(10_000, Duration::from_nanos(1));
        }
        assert_eq!(pace.coarse(640, 360), (640, 360));
        assert_eq!(pace.rows(640, 360), 360);
        for _ in 0..60 {
            pace.note(300, Duration::from_secs(100));
        }
        assert_eq!(pace.coarse(640, 360), (40, 23));
        assert_eq!(pace.rows(640, 360), 8);
    }
}
