//! Two-dimensional style transfer to compare with, applied to unstylised renders frame by frame,
//! and with the frame before it as a video.

mod adain;
mod pictures;
mod wct;

pub use adain::{AdaIn, AdaInReport, AdaInTraining, train_adain};
pub use wct::Wct;

use crate::flow::Correspondence;
use image::RgbImage;
use impasto_style::StyleError;
use std::path::Path;

/// What the name of a method's video variant ends with.
pub(crate) const TEMPORAL: &str = "_temporal";

/// A method that stylises pictures one by one.
pub trait Stylizer: Sync {
    /// Its name in reports.
    fn name(&self) -> &'static str;

    /// The name of its [`temporal`] variant.
    fn video_name(&self) -> String {
        format!("{}{TEMPORAL}", self.name())
    }

    /// What repaints pictures in the style of `painting`; the painting is looked at once. Pictures
    /// keep their size.
    fn brush<'a>(&'a self, painting: &RgbImage) -> Box<dyn Fn(&RgbImage) -> RgbImage + Sync + 'a>;
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

/// Share of the frame before, where it can be seen, in a temporal variant's frame.
const KEPT: f32 = 0.5;

/// The video variant of frames that were stylised one by one: each is blended with the finished
/// frame before it, warped, wherever `links[t]`, from frame `t` to frame `t − 1`, says what
/// corresponds; without a link nothing does.
///
/// # Panics
/// If there are fewer links than frames, or sizes differ.
pub fn temporal(frames: &[RgbImage], links: &[Option<&Correspondence>]) -> Vec<RgbImage> {
    let mut finished: Vec<RgbImage> = Vec::with_capacity(frames.len());
    for (t, frame) in frames.iter().enumerate() {
        let (Some(before), Some(link)) = (finished.last(), links[t]) else {
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
    use crate::flow::Flow;
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
        let video = temporal(
            &[grey(100), grey(200), grey(0)],
            &[None, Some(&link), Some(&link)],
        );
        let at = |t: usize, x: u32| video[t].get_pixel(x, 2).0[0];
        assert_eq!([at(0, 0), at(1, 0), at(2, 0)], [100, 150, 75]);
        assert_eq!([at(0, 5), at(1, 5), at(2, 5)], [100, 200, 0]);
        assert!(temporal(&[], &[]).is_empty());
    }
}
