//! The place of a model with other pictures of its training views: what comes of stylising photos
//! one by one and reconstructing the place from them.

use crate::geometry::stage::{GeometryStage, TrainedGeometry};
use image::RgbImage;
use impasto_model::{Budget, Clock, Model, ModelFile, Quality};
use impasto_scene::{Photo, Split};
use std::path::PathBuf;

/// A model without styles whose photo appearance is that of `pictures`, one for each training view
/// of `model` in order, of any size.
///
/// The geometry stage goes on from the model's field, density and colours, at the model's own sizes
/// and rates: geometry that was learned from photos which agree is the best start that pictures
/// which do not can have. `None` if there are no training views, or not as many pictures, or one
/// without pixels.
pub fn refit(model: &Model, pictures: Vec<RgbImage>, budget: Budget) -> Option<Model> {
    let views = model.file.scene.photos.iter();
    let views: Vec<_> = views.filter(|view| view.split == Split::Train).collect();
    let empty = |picture: &RgbImage| picture.width() == 0 || picture.height() == 0;
    if views.is_empty() || views.len() != pictures.len() || pictures.iter().any(empty) {
        return None;
    }
    let photos = views.into_iter().zip(pictures).map(|(view, pixels)| Photo {
        name: view.name.clone(),
        path: PathBuf::new(),
        camera: view.camera.resized(pixels.width(), pixels.height()),
        split: view.split,
        pixels,
        mask: None,
    });
    let photos: Vec<Photo> = photos.collect();
    let photos: Vec<&Photo> = photos.iter().collect();
    let device = model.renderer().device();
    let mut stage = GeometryStage::continued(&model.file, &photos, &device);
    let mut clock = Clock::start(budget);
    while !clock.is_over() {
        stage.step(&clock);
        clock.steps += 1;
    }
    let TrainedGeometry {
        radiance, grids, ..
    } = stage.snapshot();
    Some(Model::from_file(ModelFile {
        radiance,
        grids,
        quality: Quality::default(),
        style: None,
        finished: None,
        ..model.file.clone()
    }))
}
