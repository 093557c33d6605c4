//! The paper's third pipeline (PAPER §11): stylise the photos, then reconstruct the place from them.

use crate::bench::Bench;
use crate::evaluate::{EvalError, EvalOptions, MethodResult};
use crate::methods::Stylizer;
use crate::walk::views;
use image::RgbImage;
use impasto_scene::{Camera, Split};
use impasto_train::{Budget, Model};
use rayon::prelude::*;

/// How to reconstruct a place from stylised pictures of it.
#[derive(Debug, Clone, Copy)]
pub struct Reconstruct {
    /// Training for every method and painting.
    pub budget: Budget,
    /// Paintings that it is done with, the first ones.
    pub paintings: usize,
}

/// What was reconstructed from what, for reports.
pub(crate) const HOW: &str = "stylised renders of the training views (a model keeps no photos), \
                              learned from the model's own field on";

/// What the name of a method ends with whose pictures the place was learned from.
pub(crate) const RECONSTRUCTED: &str = "_reconstructed";

/// Unstylised renders of a model's training views, which stand for the photos that it does not
/// keep.
pub(crate) fn photos((model, side): (&Model, u32)) -> Vec<RgbImage> {
    let cameras = model.file.scene.cameras(Split::Train);
    views((model, side), &cameras, &[&model.photo_look()], &mut || {}).remove(0)
}

/// A method's results when it paints `photos` (see [`photos`]) and the place is learned from those:
/// views and walk are renders of what came out. With them the name that they go by. `tick` hears of
/// every picture rendered.
pub(crate) fn reconstructed(
    bench: &mut Bench<'_>,
    (model, photos): (&Model, &[RgbImage]),
    (stylizer, how): (&dyn Stylizer, Reconstruct),
    (cameras, options): (&[Camera], &EvalOptions<'_>),
    tick: &mut dyn FnMut(),
) -> Result<(String, MethodResult), EvalError> {
    let name = format!("{}{RECONSTRUCTED}", stylizer.name());
    let paintings = options.paintings.iter().take(how.paintings);
    let results = paintings.enumerate().map(|(i, (_, painting))| {
        let brush = stylizer.brush(painting);
        let painted = photos.par_iter().map(&brush).collect();
        let place = model.refitted(painted, how.budget);
        let place = place.ok_or(EvalError::NoTrainingViews)?;
        let (rendering, look) = ((&place, options.supersampling), [&place.photo_look()]);
        let painted = views(rendering, cameras, &look, tick).remove(0);
        let walked = views(rendering, options.path, &look, tick).remove(0);
        Ok(bench.judged((&name, i), &painted, &walked)?)
    });
    let results = results.collect::<Result<_, EvalError>>()?;
    let found = bench.result(results);
    Ok((name, found))
}
