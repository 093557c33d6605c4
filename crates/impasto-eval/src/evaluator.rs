//! Measures all methods alike.

use crate::error::EvalError;
use crate::fidelity::FidelityMetric;
use crate::methods::{Stylizer, Transfer, temporal};
use crate::names::PHOTO;
use crate::record::ImageRecord;
use crate::render::{GROUP, views};
use crate::results::{MethodResult, NamedResult, PaintingMetrics};
use crate::strokes::{StrokeMetric, Strokes};
use crate::trajectory::{Trajectory, TrajectoryMetrics};
use image::RgbImage;
use impasto_model::{Model, StyledAppearance};
use impasto_scene::Camera;
use impasto_style::StyleError;
use rayon::prelude::*;

/// What all methods are measured with.
pub(crate) struct Evaluator<'a> {
    pub(crate) model: &'a Model,
    pub(crate) fidelity: FidelityMetric<'a>,
    pub(crate) strokes: StrokeMetric,
    pub(crate) trajectory: Trajectory,
    pub(crate) paintings: &'a [(String, RgbImage)],
    /// Of the held-out views.
    pub(crate) cameras: &'a [Camera],
    /// The held-out views, unstylised.
    pub(crate) views: &'a [RgbImage],
    /// Of the trajectory.
    pub(crate) path: &'a [Camera],
    /// Rays along each side of a rendered pixel.
    pub(crate) supersampling: u32,
    /// Pictures, where they are wanted.
    pub(crate) record: Option<ImageRecord>,
    /// Hears of every picture rendered or stylised.
    pub(crate) tick: &'a mut dyn FnMut(),
}

impl Evaluator<'_> {
    /// Held-out views and frames of the path with every look, look by look.
    pub(crate) fn render(
        &mut self,
        model: &Model,
        looks: &[&StyledAppearance],
    ) -> [Vec<Vec<RgbImage>>; 2] {
        let side = self.supersampling;
        [self.cameras, self.path].map(|cameras| views(model, side, cameras, looks, self.tick))
    }

    /// Measures views and frames of one method and painting; kept, too, where pictures are wanted.
    pub(crate) fn measure(
        &mut self,
        method: &str,
        painting: usize,
        views: &[RgbImage],
        frames: &[RgbImage],
    ) -> Result<PaintingMetrics, StyleError> {
        Ok(PaintingMetrics {
            fidelity: self.fidelity.of_views(painting, views)?,
            trajectory: self.measure_frames(method, painting, views, frames)?,
        })
    }

    /// The frames' part of [`Self::measure`].
    fn measure_frames(
        &mut self,
        method: &str,
        painting: usize,
        views: &[RgbImage],
        frames: &[RgbImage],
    ) -> Result<Option<TrajectoryMetrics>, StyleError> {
        if let Some(record) = &mut self.record {
            let worst = self.trajectory.worst(frames);
            record.add(method, Some(painting), views, frames, worst);
        }
        self.trajectory.measure(frames, self.fidelity.vgg)
    }

    /// A method's result, from those of its paintings and what was seen of their strokes.
    pub(crate) fn result(
        &self,
        name: &str,
        results: Vec<PaintingMetrics>,
        strokes: &[Vec<Strokes>],
    ) -> NamedResult {
        let result = MethodResult::of(results, self.views.len());
        let result = result.with_strokes(&self.strokes.measure(strokes));
        (name.to_owned(), result)
    }

    /// The unstylised views and frames, as if they were every painting's.
    pub(crate) fn photo(&mut self) -> Result<NamedResult, EvalError> {
        let frames = &self.trajectory.frames;
        let trajectory = self.trajectory.measure(frames, self.fidelity.vgg)?;
        if let Some(record) = &mut self.record {
            let worst = self.trajectory.worst(frames);
            record.add(PHOTO, None, self.views, frames, worst);
        }
        let paintings = 0..self.paintings.len();
        let results = paintings.map(|i| PaintingMetrics {
            fidelity: self.fidelity.of_unstylised(i),
            trajectory,
        });
        let result = MethodResult::of(results.collect(), self.views.len());
        Ok((PHOTO.to_owned(), result))
    }

    /// Looks of the model, one for each painting, under this name.
    pub(crate) fn looks(
        &mut self,
        name: &str,
        look: &mut dyn FnMut(&RgbImage) -> Result<StyledAppearance, EvalError>,
    ) -> Result<NamedResult, EvalError> {
        let mut results = Vec::with_capacity(self.paintings.len());
        let mut strokes = Vec::with_capacity(self.paintings.len());
        for group in self.paintings.chunks(GROUP) {
            let looks = group.iter().map(|(_, painting)| look(painting));
            let looks: Vec<StyledAppearance> = looks.collect::<Result<_, _>>()?;
            let [views, frames] = self.render(self.model, &looks.iter().collect::<Vec<_>>());
            for (views, frames) in views.iter().zip(&frames) {
                results.push(self.measure(name, results.len(), views, frames)?);
                strokes.push(self.strokes.strokes(views)?);
            }
        }
        Ok(self.result(name, results, &strokes))
    }

    /// Another method, frame by frame and as a video, with their names.
    pub(crate) fn stylizer(
        &mut self,
        stylizer: &dyn Stylizer,
    ) -> Result<[NamedResult; 2], EvalError> {
        let (name, video_name) = (stylizer.name(), stylizer.video_name());
        let (mut by_frame, mut as_video, mut strokes) = (Vec::new(), Vec::new(), Vec::new());
        for (i, (_, painting)) in self.paintings.iter().enumerate() {
            let transfer = stylizer.transfer(painting);
            let views = stylised(self.views, &transfer, self.tick);
            let frames = stylised(&self.trajectory.frames, &transfer, self.tick);
            let found = self.measure(name, i, &views, &frames)?;
            strokes.push(self.strokes.strokes(&views)?);
            // By estimated flow, because a method of pictures knows no geometry.
            let video = temporal(&frames, &self.trajectory.estimated[0]);
            // A first frame is a single picture: as a video, the views are the same.
            as_video.push(PaintingMetrics {
                fidelity: found.fidelity.clone(),
                trajectory: self.measure_frames(&video_name, i, &views, &video)?,
            });
            by_frame.push(found);
        }
        let as_video = self.result(&video_name, as_video, &strokes);
        Ok([self.result(name, by_frame, &strokes), as_video])
    }
}

/// Pictures repainted in batches that keep all threads busy. `tick` hears of every picture when its
/// batch is done.
fn stylised(
    pictures: &[RgbImage],
    transfer: &Transfer<'_>,
    tick: &mut dyn FnMut(),
) -> Vec<RgbImage> {
    let mut repainted = Vec::with_capacity(pictures.len());
    for batch in pictures.chunks(2 * rayon::current_num_threads()) {
        repainted.par_extend(batch.par_iter().map(transfer));
        batch.iter().for_each(|_| tick());
    }
    repainted
}
