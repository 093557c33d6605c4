//! What is kept of an evaluation to be looked at. An evaluation that nobody asks for pictures keeps
//! none.

use crate::consistency::{RANGES, Worst};
use image::RgbImage;
use image::imageops::{FilterType, resize};
use std::collections::BTreeMap;

/// How much to keep.
#[derive(Debug, Clone, Copy)]
pub struct GalleryPlan {
    /// Paintings, from the first, of which one view and one frame of the walk are kept.
    pub sheets: usize,
    /// Side in pixels of a square as large as such a picture; none is enlarged.
    pub sheet_side: u32,
    /// Paintings, from the first, of which all frames of the walk are kept, at most `sheets`.
    pub films: usize,
    /// Side in pixels of a square as large as such a frame.
    pub film_side: u32,
}

impl Default for GalleryPlan {
    /// Pictures that a page of 15 MB can hold of four methods and a walk of 60 frames.
    fn default() -> Self {
        Self {
            sheets: 20,
            sheet_side: 280,
            films: 3,
            film_side: 250,
        }
    }
}

/// What one method makes of the scene in one style.
#[derive(Debug, Clone)]
pub struct Exhibit {
    /// The held-out view [`Gallery::view`].
    pub view: RgbImage,
    /// The walk's frame [`Gallery::frame`]; `None` without a walk.
    pub frame: Option<RgbImage>,
    /// The walk's frames; empty where they are not kept.
    pub film: Vec<RgbImage>,
}

/// The pair of frames that agree least, of all of a method's paintings.
#[derive(Debug, Clone)]
pub struct WorstPair {
    /// The painting's place among all; `None` for frames without one.
    pub painting: Option<usize>,
    /// First and second frame, counted from 0.
    pub frames: [usize; 2],
    /// E (PAPER §10), not times 100.
    pub square: f64,
    /// Share of pixels compared.
    pub coverage: f64,
    /// The first frame.
    pub first: RgbImage,
    /// The second, warped onto the first; black where it has nothing to show.
    pub warped: RgbImage,
    /// Row by row, squared difference of the two, mean over channels; `None` where a pixel does
    /// not count. The mean of what counts is `square`.
    pub squares: Vec<Option<f32>>,
}

/// Pictures of an evaluation.
#[derive(Debug, Clone)]
pub struct Gallery {
    /// The first paintings, small.
    pub paintings: Vec<RgbImage>,
    /// By method, one for each of `paintings`; the unstylised render, which no painting changes,
    /// has one.
    pub exhibits: BTreeMap<String, Vec<Exhibit>>,
    /// By method, at short and at long range; `None` where no pair counts.
    pub worst: BTreeMap<String, [Option<WorstPair>; RANGES.len()]>,
    /// Which of the held-out views is shown, counted from 0.
    pub view: usize,
    /// Which of the walk's frames is shown, counted from 0.
    pub frame: usize,
    plan: GalleryPlan,
}

impl Gallery {
    pub(crate) fn new(plan: GalleryPlan, paintings: &[(String, RgbImage)]) -> Self {
        let paintings = paintings.iter().take(plan.sheets);
        Self {
            paintings: paintings
                .map(|(_, painting)| fitted(painting, plan.sheet_side))
                .collect(),
            exhibits: BTreeMap::new(),
            worst: BTreeMap::new(),
            view: 0,
            frame: 0,
            plan,
        }
    }

    /// A method's pictures in the style of a painting.
    pub fn of(&self, method: &str, painting: usize) -> Option<&Exhibit> {
        let exhibits = self.exhibits.get(method)?;
        match exhibits.as_slice() {
            [unstyled] if method == crate::evaluate::PHOTO => Some(unstyled),
            several => several.get(painting),
        }
    }

    /// Keeps what the plan wants of a method's held-out views and walk in the style of a painting,
    /// given by its place, and the worst pairs of the walk at both ranges if they are worse than
    /// those before. Paintings come in their order.
    pub(crate) fn hang(
        &mut self,
        (method, painting): (&str, Option<usize>),
        (views, frames): (&[RgbImage], &[RgbImage]),
        worst: [Option<Worst<'_>>; RANGES.len()],
    ) {
        (self.view, self.frame) = (views.len() / 2, frames.len() / 2);
        let place = painting.unwrap_or(0);
        if let Some(view) = views.get(self.view).filter(|_| place < self.plan.sheets) {
            let film = match place < self.plan.films {
                true => frames,
                false => &[],
            };
            let exhibit = Exhibit {
                view: fitted(view, self.plan.sheet_side),
                frame: frames
                    .get(self.frame)
                    .map(|frame| fitted(frame, self.plan.sheet_side)),
                film: film
                    .iter()
                    .map(|f| fitted(f, self.plan.film_side))
                    .collect(),
            };
            let exhibits = self.exhibits.entry(method.to_owned()).or_default();
            exhibits.push(exhibit);
        }
        let before = self.worst.entry(method.to_owned()).or_default();
        for (before, found) in before.iter_mut().zip(worst) {
            let square = before
                .as_ref()
                .map_or(f64::NEG_INFINITY, |pair| pair.square);
            if let Some(found) = found.filter(|found| found.error.square > square) {
                *before = Some(WorstPair::of(painting, &found, frames));
            }
        }
    }
}

impl WorstPair {
    fn of(painting: Option<usize>, found: &Worst<'_>, frames: &[RgbImage]) -> Self {
        let [first, second] = found.frames.map(|frame| &frames[frame]);
        let warped = found.pair.warped(&impasto_style::picture(second));
        let pixels = impasto_style::picture(first);
        let pixels = pixels.chunks_exact(3).zip(warped.chunks_exact(3));
        let squares = pixels.zip(&found.pair.mask).map(|((a, b), counts)| {
            let square: f32 = a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum();
            counts.then_some(square / 3.0)
        });
        let bytes = warped.iter().map(|v| (255.0 * v).round() as u8);
        Self {
            painting,
            frames: found.frames,
            square: found.error.square,
            coverage: found.error.coverage,
            squares: squares.collect(),
            warped: RgbImage::from_raw(first.width(), first.height(), bytes.collect())
                .unwrap_or_default(),
            first: first.clone(),
        }
    }
}

/// A picture about as large as a square of `side` pixels, or as it is if that is smaller.
fn fitted(picture: &RgbImage, side: u32) -> RgbImage {
    let (width, height) = picture.dimensions();
    let area = f64::from(width) * f64::from(height);
    let scale = f64::from(side) / area.sqrt().max(1.0);
    if scale >= 1.0 {
        return picture.clone();
    }
    let size = |length: u32| ((f64::from(length) * scale).round() as u32).max(1);
    resize(picture, size(width), size(height), FilterType::CatmullRom)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may panic")]

    use super::*;
    use crate::consistency::tests::{frames, pairs};
    use crate::evaluate::PHOTO;

    const PLAN: GalleryPlan = GalleryPlan {
        sheets: 2,
        sheet_side: 20,
        films: 1,
        film_side: 10,
    };

    /// A gallery of one method and three paintings, with frames of that much noise, and as many
    /// held-out views as there are frames.
    fn gallery(noise: [u8; 3]) -> Gallery {
        let paintings = ["a", "b", "c"].map(|name| (name.to_owned(), RgbImage::new(60, 50)));
        let mut gallery = Gallery::new(PLAN, &paintings);
        let pairs = pairs(5, 1, 0.05);
        for (i, noise) in noise.into_iter().enumerate() {
            let frames = frames(5, 0.05, noise);
            let worst = [pairs.worst(&frames), None];
            gallery.hang(("method", Some(i)), (&frames, &frames), worst);
        }
        gallery
    }

    #[test]
    fn as_much_is_kept_as_was_planned() {
        let gallery = gallery([0, 0, 0]);
        let kept: Vec<usize> = gallery.exhibits["method"]
            .iter()
            .map(|e| e.film.len())
            .collect();
        assert_eq!(kept, [5, 0]);
        assert_eq!(
            (gallery.view, gallery.frame, gallery.paintings.len()),
            (2, 2, 2)
        );
        let first = gallery.of("method", 0).unwrap();
        assert_eq!(first.view.dimensions(), (23, 17));
        assert_eq!(first.film[0].dimensions(), (12, 9));
        assert!(gallery.of("method", 2).is_none() && gallery.of("other", 0).is_none());
    }

    #[test]
    fn the_unstylised_render_hangs_beside_every_painting() {
        let mut gallery = gallery([0, 0, 0]);
        gallery.hang((PHOTO, None), (&frames(3, 0.05, 0), &[]), [None, None]);
        assert!(gallery.of(PHOTO, 1).is_some_and(|e| e.frame.is_none()));
    }

    #[test]
    fn the_worst_pair_is_that_of_the_noisiest_painting() {
        for (noise, worst) in [([20, 60, 40], 1), ([90, 60, 0], 0), ([5, 10, 30], 2)] {
            let gallery = gallery(noise);
            let [Some(pair), None] = &gallery.worst["method"] else {
                panic!("one range was measured");
            };
            assert_eq!(pair.painting, Some(worst));
            let counted: Vec<f64> = pair.squares.iter().flatten().map(|s| (*s).into()).collect();
            let mean = counted.iter().sum::<f64>() / counted.len() as f64;
            assert!(
                (mean / pair.square - 1.0).abs() < 1e-4,
                "the map is of that E"
            );
            let share = counted.len() as f64 / pair.squares.len() as f64;
            assert!((share - pair.coverage).abs() < 1e-9);
            assert_eq!(pair.warped.dimensions(), pair.first.dimensions());
        }
    }

    #[test]
    fn pictures_of_any_shape_come_out_about_as_large() {
        let size = |width, height| fitted(&RgbImage::new(width, height), 100).dimensions();
        assert_eq!(size(800, 200), (200, 50));
        assert_eq!(size(300, 300), (100, 100));
        assert_eq!(size(90, 70), (90, 70), "none is enlarged");
        assert_eq!(size(100_000, 1), (31_623, 1));
    }
}
