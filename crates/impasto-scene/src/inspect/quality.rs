//! How bright and how sharp a photo is, as a whole and around a point.

use std::collections::HashMap;

use glam::DVec2;
use image::RgbImage;

use super::neighbours::Seen;
use crate::statistics::quantile;

/// Brightness of a photo's pixels.
pub(super) struct Luma {
    width: usize,
    height: usize,
    /// Rec. 709 luma of the stored values, 0 to 255, row by row.
    values: Vec<f32>,
}

/// Brightness and detail of a photo, or of a part of one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct RegionQuality {
    /// Mean luma, 0 to 255.
    pub(super) brightness: f64,
    /// Logarithm of the Laplacian's mean square over the squared brightness: of fine detail, in
    /// which exposure does not count.
    pub(super) detail: f64,
}

/// Brightness, detail and contrast of a whole photo.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct PhotoQuality {
    /// Its brightness, and the detail of its sharper parts: a blurred background is no fault.
    pub(super) whole: RegionQuality,
    /// Logarithm of fine detail over coarse: blur takes the fine first, whatever the photo shows.
    pub(super) slope: f64,
    /// Difference between the brightest and the darkest luma, but for 2 % of the pixels each.
    pub(super) contrast: f64,
    /// Brightness and detail around the sparse points that the photo sees, by their indices.
    pub(super) at_points: HashMap<usize, RegionQuality>,
}

/// Half the side of the window around a sparse point, in pixels.
const WINDOW: usize = 6;
/// Blocks along a photo's longer side, of which the sharper ones count.
const BLOCKS: usize = 30;
/// Smallest side of a block, in pixels.
const LEAST_BLOCK: usize = 8;
/// The block that counts has more detail than this share of all.
const SHARPER: f64 = 0.9;
/// Mean square of the Laplacian that rounding to bytes may cause by itself.
const ROUNDING: f64 = 0.5;
/// Added to brightness, so that black is not infinitely detailed.
const DARK: f64 = 4.0;

fn detail(square: f64, brightness: f64) -> f64 {
    ((square + ROUNDING) / (brightness + DARK).powi(2)).ln()
}

impl Luma {
    pub(super) fn of(photo: &RgbImage) -> Self {
        let luma = |p: &[u8]| {
            0.2126 * f32::from(p[0]) + 0.7152 * f32::from(p[1]) + 0.0722 * f32::from(p[2])
        };
        Self {
            width: photo.width() as usize,
            height: photo.height() as usize,
            values: photo.as_raw().chunks_exact(3).map(luma).collect(),
        }
    }

    /// Of the whole photo, and around the points that it sees.
    pub(super) fn quality(&self, seen: &Seen) -> PhotoQuality {
        let brightness = f64::from(mean(&self.values));
        let side = (self.width.max(self.height) / BLOCKS).max(LEAST_BLOCK);
        let mut squares = Vec::new();
        for top in (0..self.height).step_by(side) {
            for left in (0..self.width).step_by(side) {
                squares.push(self.square([left, left + side], [top, top + side]));
            }
        }
        let sharp = quantile(squares, SHARPER);
        let all = |of: &Self| of.square([0, of.width], [0, of.height]) + ROUNDING;
        PhotoQuality {
            whole: RegionQuality {
                brightness,
                detail: detail(sharp.unwrap_or(0.0), brightness),
            },
            slope: (all(self) / all(&self.halved().halved())).ln(),
            contrast: self.contrast(),
            at_points: seen
                .iter()
                .filter_map(|(point, pixel)| Some((*point, self.around(*pixel)?)))
                .collect(),
        }
    }

    /// Around a pixel; `None` where the window leaves the photo.
    fn around(&self, pixel: DVec2) -> Option<RegionQuality> {
        let range = |at: f64, size: usize| {
            // The cast of a negative or NaN position saturates to 0, which is too near the border.
            let at = at as usize;
            (at >= WINDOW && at + WINDOW < size).then(|| [at - WINDOW, at + WINDOW + 1])
        };
        let (columns, rows) = (range(pixel.x, self.width)?, range(pixel.y, self.height)?);
        let parts = (rows[0]..rows[1]).map(|y| mean(&self.row(y)[columns[0]..columns[1]]));
        let brightness = f64::from(parts.sum::<f32>()) / (rows[1] - rows[0]) as f64;
        Some(RegionQuality {
            brightness,
            detail: detail(self.square(columns, rows), brightness),
        })
    }

    fn row(&self, y: usize) -> &[f32] {
        &self.values[y * self.width..][..self.width]
    }

    /// Mean square of the Laplacian over a part of the photo, without its border.
    fn square(&self, columns: [usize; 2], rows: [usize; 2]) -> f64 {
        let (mut sum, mut count) = (0.0, 0);
        for y in rows[0].max(1)..rows[1].min(self.height.saturating_sub(1)) {
            let (above, row, below) = (self.row(y - 1), self.row(y), self.row(y + 1));
            let mut line = 0.0;
            for x in columns[0].max(1)..columns[1].min(self.width.saturating_sub(1)) {
                let laplacian = above[x] + below[x] + row[x - 1] + row[x + 1] - 4.0 * row[x];
                line += laplacian * laplacian;
                count += 1;
            }
            sum += f64::from(line);
        }
        sum / f64::from(count.max(1))
    }

    /// Half as wide and high, each pixel the mean of four.
    fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let pixel = |i: usize| {
            let (x, y) = (2 * (i % width), 2 * (i / width));
            let (upper, lower) = (self.row(y), self.row(y + 1));
            0.25 * (upper[x] + upper[x + 1] + lower[x] + lower[x + 1])
        };
        Self {
            width,
            height,
            values: (0..width * height).map(pixel).collect(),
        }
    }

    fn contrast(&self) -> f64 {
        let mut counts = [0usize; 256];
        for value in &self.values {
            counts[*value as usize & 255] += 1;
        }
        let few = self.values.len() / 50;
        let darkest = (0..256).find(|v| counts[..=*v].iter().sum::<usize>() > few);
        let brightest = (0..256).rfind(|v| counts[*v..].iter().sum::<usize>() > few);
        brightest.unwrap_or(0) as f64 - darkest.unwrap_or(0) as f64
    }
}

fn mean(values: &[f32]) -> f32 {
    // Lines are summed apart: one sum of millions of pixels loses digits.
    let sums = values
        .chunks(1024)
        .map(|line| f64::from(line.iter().sum::<f32>()));
    (sums.sum::<f64>() / values.len().max(1) as f64) as f32
}
