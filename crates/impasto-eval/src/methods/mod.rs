//! Two-dimensional style transfer to compare with, applied to unstylised renders frame by frame,
//! and with the frame before it as a video.

pub(crate) mod adain;
mod pictures;
mod wct;

pub use adain::AdaIn;
pub use wct::Wct;

use crate::consistency::Pairs;
use crate::names::TEMPORAL;
use image::RgbImage;
use impasto_style::StyleError;
use std::collections::BTreeMap;
use std::path::Path;

/// Repaints a picture, which keeps its size, in the style of one painting.
pub type Transfer<'a> = Box<dyn Fn(&RgbImage) -> RgbImage + Sync + 'a>;

/// A method that stylises pictures one by one.
pub trait Stylizer: Sync {
    /// Its name in reports.
    fn name(&self) -> &'static str;

    /// The name of its variant for videos, whose frames are blended with those before them.
    fn video_name(&self) -> String {
        format!("{}{TEMPORAL}", self.name())
    }

    /// What repaints pictures in the style of `painting`, which is encoded once.
    fn transfer<'a>(&'a self, painting: &RgbImage) -> Transfer<'a>;
}

fn bytes_of(path: &Path) -> Result<Vec<u8>, StyleError> {
    impasto_scene::file::read_whole(path, impasto_scene::file::LARGEST_FILE).map_err(|source| {
        StyleError::Read {
            path: path.to_owned(),
            source,
        }
    })
}

/// Methods of the paper's tables that cannot be compared yet, and why.
pub const UNAVAILABLE: [(&str, &str); 4] = [
    ("lst", NO_WEIGHTS),
    ("tpfr", NO_WEIGHTS),
    ("rerevst", NO_WEIGHTS),
    ("mccnet", NO_WEIGHTS),
];
const NO_WEIGHTS: &str = "this program has no weights for it";

/// Share of the frame before, where it is visible, in a temporal variant's frame.
const KEPT: f32 = 0.5;

/// The video variant of frames that were stylised one by one: each is blended with the finished
/// frame before it, warped, wherever the two correspond.
///
/// # Panics
/// If sizes differ.
pub(crate) fn temporal(frames: &[RgbImage], neighbours: &Pairs) -> Vec<RgbImage> {
    let links: BTreeMap<usize, _> = neighbours.links().collect();
    let mut finished: Vec<RgbImage> = Vec::with_capacity(frames.len());
    for (t, frame) in frames.iter().enumerate() {
        let (Some(before), Some(link)) = (finished.last(), links.get(&t)) else {
            finished.push(frame.clone());
            continue;
        };
        let warped = link.warped(&impasto_style::picture(before));
        let mut blended = frame.clone();
        let pixels = blended.pixels_mut().zip(warped.chunks_exact(3));
        for ((pixel, before), _) in pixels.zip(&link.mask).filter(|(_, mask)| **mask) {
            for (to, from) in pixel.0.iter_mut().zip(before) {
                let mixed = f32::from(*to) * (1.0 - KEPT) + from * 255.0 * KEPT;
                // A float's cast to a byte saturates.
                *to = mixed.round() as u8;
            }
        }
        finished.push(blended);
    }
    finished
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::flow::{Correspondence, Flow};
    use image::Rgb;

    #[test]
    fn a_video_keeps_half_of_what_it_has_seen() {
        let grey = |v: u8| RgbImage::from_pixel(6, 4, Rgb([v; 3]));
        let link = Correspondence {
            flow: Flow {
                width: 6,
                height: 4,
                vectors: vec![Some([0.0; 2]); 24],
            },
            mask: (0..24).map(|i| i % 6 < 3).collect(),
        };
        let neighbours = |frames| Pairs::new(frames, 1, |_, _| link.clone());
        let video = temporal(&[grey(100), grey(200), grey(0)], &neighbours(3));
        let at = |t: usize, x: u32| video[t].get_pixel(x, 2).0[0];
        assert_eq!([at(0, 0), at(1, 0), at(2, 0)], [100, 150, 75]);
        assert_eq!([at(0, 5), at(1, 5), at(2, 5)], [100, 200, 0]);
        assert!(temporal(&[], &neighbours(0)).is_empty());
    }
}
