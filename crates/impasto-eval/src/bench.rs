//! The bench on which all methods are measured alike.

use crate::evaluate::{EvalError, EvalOptions, MethodResult, PHOTO};
use crate::fidelity::{Judge, PaintingResult};
use crate::gallery::Gallery;
use crate::methods::Stylizer;
use crate::walk::{Walk, Walked, views};
use image::RgbImage;
use impasto_scene::Camera;
use impasto_style::{Perceptual, StyleError};
use impasto_train::{Look, Model};
use rayon::prelude::*;

/// Paintings rendered together: geometry is computed once for them, and their frames are all in
/// memory.
pub(crate) const GROUP: usize = 8;

/// The look that a model has for a painting.
pub(crate) type LookOf<'a> = dyn FnMut(&RgbImage) -> Result<Look, EvalError> + 'a;

/// What all methods are measured with.
pub(crate) struct Bench<'a> {
    pub(crate) judge: Judge<'a>,
    pub(crate) walk: Walk,
    pub(crate) vgg: &'a Perceptual,
    /// The held-out views, unstylised.
    pub(crate) plain: &'a [RgbImage],
    /// Pictures, where they are wanted.
    pub(crate) gallery: Option<Gallery>,
}

impl Bench<'_> {
    /// Views and walk of one method and painting; kept, too, where pictures are wanted.
    pub(crate) fn judged(
        &mut self,
        (method, painting): (&str, usize),
        views: &[RgbImage],
        walked: &[RgbImage],
    ) -> Result<(PaintingResult, Option<Walked>), StyleError> {
        let fidelity = self.judge.painting(painting, views)?;
        Ok((fidelity, self.walked((method, painting), views, walked)?))
    }

    /// The walk's part of [`Self::judged`].
    fn walked(
        &mut self,
        (method, painting): (&str, usize),
        views: &[RgbImage],
        walked: &[RgbImage],
    ) -> Result<Option<Walked>, StyleError> {
        if let Some(gallery) = &mut self.gallery {
            let shown = (method, Some(painting));
            gallery.hang(shown, (views, walked), self.walk.worst(walked));
        }
        self.walk.measure(walked, self.vgg)
    }

    /// A method's result, from those of its paintings.
    pub(crate) fn result(&self, results: Vec<(PaintingResult, Option<Walked>)>) -> MethodResult {
        MethodResult::of(results, self.plain)
    }

    /// The unstylised views and walk, as if they were every painting's.
    pub(crate) fn photo(&mut self, paintings: usize) -> Result<MethodResult, EvalError> {
        let walked = self.walk.measure(&self.walk.frames, self.vgg)?;
        if let Some(gallery) = &mut self.gallery {
            let walked = &self.walk.frames;
            gallery.hang((PHOTO, None), (self.plain, walked), self.walk.worst(walked));
        }
        let results = (0..paintings).map(|i| (self.judge.unstyled(i), walked));
        Ok(self.result(results.collect()))
    }

    /// The model's own looks, under this name. `tick` hears of every render.
    pub(crate) fn ours(
        &mut self,
        model: &Model,
        (name, look): (&str, &mut LookOf<'_>),
        (cameras, options): (&[Camera], &EvalOptions<'_>),
        tick: &mut dyn FnMut(),
    ) -> Result<MethodResult, EvalError> {
        let rendering = (model, options.supersampling);
        let mut results = Vec::with_capacity(options.paintings.len());
        for group in options.paintings.chunks(GROUP) {
            let looks = group.iter().map(|(_, painting)| look(painting));
            let looks: Vec<Look> = looks.collect::<Result<_, _>>()?;
            let looks: Vec<&Look> = looks.iter().collect();
            let painted = views(rendering, cameras, &looks, tick);
            let walked = views(rendering, options.path, &looks, tick);
            for (painted, walked) in painted.iter().zip(&walked) {
                results.push(self.judged((name, results.len()), painted, walked)?);
            }
        }
        Ok(self.result(results))
    }

    /// Another method, frame by frame and as a video, under their names. `tick` hears of every
    /// picture painted.
    pub(crate) fn other(
        &mut self,
        stylizer: &dyn Stylizer,
        names: [&String; 2],
        (paintings, tick): (&[(String, RgbImage)], &mut dyn FnMut()),
    ) -> Result<[MethodResult; 2], EvalError> {
        let (mut pictures, mut videos) = (Vec::new(), Vec::new());
        for (i, (_, painting)) in paintings.iter().enumerate() {
            let brush = stylizer.brush(painting);
            let views = painted(self.plain, &brush, tick);
            let frames = painted(&self.walk.frames, &brush, tick);
            let (fidelity, walked) = self.judged((names[0], i), &views, &frames)?;
            // A first frame is a single picture: as a video, the views are painted alike.
            let video = self.walk.video(&frames);
            let as_video = self.walked((names[1], i), &views, &video)?;
            pictures.push((fidelity.clone(), walked));
            videos.push((fidelity, as_video));
        }
        Ok([pictures, videos].map(|results| self.result(results)))
    }
}

/// A brush's pictures of frames, in batches that keep all threads busy. `tick` hears of every
/// picture when its batch is done.
fn painted(
    frames: &[RgbImage],
    brush: &(dyn Fn(&RgbImage) -> RgbImage + Sync),
    tick: &mut dyn FnMut(),
) -> Vec<RgbImage> {
    let mut pictures = Vec::with_capacity(frames.len());
    for batch in frames.chunks(2 * rayon::current_num_threads()) {
        pictures.par_extend(batch.par_iter().map(brush));
        batch.iter().for_each(|_| tick());
    }
    pictures
}
