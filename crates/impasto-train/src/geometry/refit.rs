//! The place of a model with other pictures of its training views: what comes of stylising photos
//! one by one and reconstructing the place from them.

use crate::budget::{Budget, Clock};
use crate::geometry_stage::GeometryStage;
use crate::model::Model;
use crate::model_file::{ModelFile, Quality};
use image::RgbImage;
use impasto_scene::{Photo, Split};
use std::path::PathBuf;

impl Model {
    /// A model without styles whose photo look is that of `pictures`, one for each training view
    /// in order, of any size.
    ///
    /// The geometry stage goes on from this model's field, density and colours, at the model's own
    /// sizes and rates: geometry that was learned from photos which agree is the best start that
    /// pictures which do not can have. `None` if there are no training views, or not as many
    /// pictures, or one without pixels.
    pub fn refitted(&self, pictures: Vec<RgbImage>, budget: Budget) -> Option<Self> {
        let views = self.file.scene.photos.iter();
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
        let mut stage = GeometryStage::continued(&self.file, &photos, self.device());
        let mut clock = Clock::start(budget);
        while !clock.is_over() {
            stage.step(&clock);
            clock.steps += 1;
        }
        let (weights, grids, photo_app) = stage.snapshot();
        let file = ModelFile {
            weights,
            grids,
            photo_app,
            quality: Quality::default(),
            style: None,
            finished: None,
            ..self.file.clone()
        };
        Some(Self::from_file(file, self.device().clone()))
    }
}
