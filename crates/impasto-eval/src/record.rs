//! Pictures that an evaluation keeps for its report, if they are asked for.

use crate::consistency::{RANGES, Worst};
use crate::names::PHOTO;
use crate::resize::reduced;
use image::RgbImage;
use image::imageops::FilterType;
use std::collections::BTreeMap;

/// How much to keep.
#[derive(Debug, Clone, Copy)]
pub struct RecordPlan {
    /// Paintings, from the first, of which one view and one frame of the path are kept.
    pub sheets: usize,
    /// Side in pixels of a square as large as such a picture; none is enlarged.
    pub sheet_side: u32,
    /// Paintings, from the first, of which all frames of the path are kept, at most `sheets`.
    pub films: usize,
    /// Side in pixels of a square as large as such a frame.
    pub film_side: u32,
}

impl Default for RecordPlan {
    /// Pictures that a page of 15 MB can hold of four methods and a path of 60 frames.
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
pub struct SampleImages {
    /// The held-out view [`ImageRecord::view`].
    pub view: RgbImage,
    /// The frame [`ImageRecord::frame`] of the path; `None` without a path.
    pub frame: Option<RgbImage>,
    /// All frames of the path; empty where they are not kept.
    pub film: Vec<RgbImage>,
}

/// The pair of frames that agree least, of all of a method's paintings.
#[derive(Debug, Clone)]
pub struct WorstPair {
    /// The painting's index; `None` for frames without one.
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
pub struct ImageRecord {
    /// The first paintings, small.
    pub paintings: Vec<RgbImage>,
    /// By method, one for each of `paintings`; the unstylised render, which no painting changes,
    /// has one.
    pub samples: BTreeMap<String, Vec<SampleImages>>,
    /// By method, at short and at long range; `None` where no pair counts.
    pub worst: BTreeMap<String, [Option<WorstPair>; RANGES.len()]>,
    /// Which of the held-out views is shown, counted from 0.
    pub view: usize,
    /// Which of the path's frames is shown, counted from 0.
    pub frame: usize,
    plan: RecordPlan,
}

impl ImageRecord {
    pub(crate) fn new(plan: RecordPlan, paintings: &[(String, RgbImage)]) -> Self {
        let paintings = paintings.iter().take(plan.sheets);
        Self {
            paintings: paintings
                .map(|(_, painting)| fitted(painting, plan.sheet_side))
                .collect(),
            samples: BTreeMap::new(),
            worst: BTreeMap::new(),
            view: 0,
            frame: 0,
            plan,
        }
    }

    /// A method's pictures in the style of a painting.
    pub fn of(&self, method: &str, painting: usize) -> Option<&SampleImages> {
        let samples = self.samples.get(method)?;
        match samples.as_slice() {
            [unstylised] if method == PHOTO => Some(unstylised),
            several => several.get(painting),
        }
    }

    /// Keeps what the plan wants of a method's held-out views and frames in the style of a
    /// painting, given by its index, and the worst pairs of frames at both ranges if they are worse
    /// than those before. Paintings come in their order.
    pub(crate) fn add(
        &mut self,
        method: &str,
        painting: Option<usize>,
        views: &[RgbImage],
        frames: &[RgbImage],
        worst: [Option<Worst<'_>>; RANGES.len()],
    ) {
        let plan = self.plan;
        (self.view, self.frame) = (views.len() / 2, frames.len() / 2);
        let index = painting.unwrap_or(0);
        if let Some(view) = views.get(self.view).filter(|_| index < plan.sheets) {
            let frame = frames.get(self.frame);
            let film = frames.iter().filter(|_| index < plan.films);
            let sample = SampleImages {
                view: fitted(view, plan.sheet_side),
                frame: frame.map(|frame| fitted(frame, plan.sheet_side)),
                film: film.map(|frame| fitted(frame, plan.film_side)).collect(),
            };
            let samples = self.samples.entry(method.to_owned()).or_default();
            samples.push(sample);
        }
        let before = self.worst.entry(method.to_owned()).or_default();
        for (before, found) in before.iter_mut().zip(worst) {
            let least = before.as_ref().map(|pair| pair.square);
            let least = least.unwrap_or(f64::NEG_INFINITY);
            if let Some(found) = found.filter(|found| found.error.square > least) {
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
    reduced(picture, scale, FilterType::CatmullRom)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may panic")]

    use super::*;
    use crate::consistency::tests::{frames, pairs};

    const PLAN: RecordPlan = RecordPlan {
        sheets: 2,
        sheet_side: 20,
        films: 1,
        film_side: 10,
    };

    /// A record of one method and three paintings, with frames of that much noise, and as many
    /// held-out views as there are frames.
    fn record(noise: [u8; 3]) -> ImageRecord {
        let paintings = ["a", "b", "c"].map(|name| (name.to_owned(), RgbImage::new(60, 50)));
        let mut record = ImageRecord::new(PLAN, &paintings);
        let pairs = pairs(5, 1, 0.05);
        for (i, noise) in noise.into_iter().enumerate() {
            let frames = frames(5, 0.05, noise);
            let worst = [pairs.worst(&frames), None];
            record.add("method", Some(i), &frames, &frames, worst);
        }
        record
    }

    #[test]
    fn as_much_is_kept_as_was_planned() {
        let record = record([0, 0, 0]);
        let kept: Vec<usize> = record.samples["method"]
            .iter()
            .map(|e| e.film.len())
            .collect();
        assert_eq!(kept, [5, 0]);
        assert_eq!(
            (record.view, record.frame, record.paintings.len()),
            (2, 2, 2)
        );
        let first = record.of("method", 0).unwrap();
        assert_eq!(first.view.dimensions(), (23, 17));
        assert_eq!(first.film[0].dimensions(), (12, 9));
        assert!(record.of("method", 2).is_none() && record.of("other", 0).is_none());
    }

    #[test]
    fn the_unstylised_render_is_that_of_every_painting() {
        let mut record = record([0, 0, 0]);
        record.add(PHOTO, None, &frames(3, 0.05, 0), &[], [None, None]);
        assert!(record.of(PHOTO, 1).is_some_and(|e| e.frame.is_none()));
    }

    #[test]
    fn the_worst_pair_is_that_of_the_noisiest_painting() {
        for (noise, worst) in [([20, 60, 40], 1), ([90, 60, 0], 0), ([5, 10, 30], 2)] {
            let record = record(noise);
            let [Some(pair), None] = &record.worst["method"] else {
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
