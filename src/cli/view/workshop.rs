//! The studio's films and exports.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

use image::RgbImage;
use impasto::view::{ExportOrder, FilmOrder, Formats, Made, PaintOrder, Progress, Workshop};
use impasto::{Coat, Model, Stop};

use crate::cli::CliError;
use crate::cli::render::{FilmOrder as Film, film};
use crate::output::{Ffmpeg, FilmFormat};

/// The model that the studio shows, once there is one.
pub type Shown = Arc<Mutex<Option<Arc<Model>>>>;

/// Makes films and exports of the model that is shown.
pub struct Bench {
    model: Shown,
    ffmpeg: Ffmpeg,
}

impl Bench {
    /// One that makes films with an ffmpeg.
    pub fn new(model: Shown, ffmpeg: Ffmpeg) -> Self {
        Self { model, ffmpeg }
    }

    fn model(&self) -> Result<Arc<Model>, String> {
        let shown = self.model.lock().unwrap_or_else(PoisonError::into_inner);
        let model = shown.clone();
        model.ok_or_else(|| "there is no model yet; wait until its training has written one".into())
    }
}

/// Coats of paint for a model, of an order's paintings.
fn coats(model: &Model, paint: &PaintOrder) -> Result<Vec<Coat>, CliError> {
    let picture = |id: &str| -> Option<&RgbImage> {
        let found = paint.paintings.iter().find(|(known, _)| known == id);
        found.map(|(_, picture)| picture)
    };
    let coats = paint.coats.coats.iter().map(|spec| {
        let named = spec.paintings.iter();
        let known = named.filter_map(|one| Some((picture(&one.painting)?, one.weight)));
        let inspirations = known
            .map(|(picture, weight)| Ok((model.inspiration(picture)?, weight)))
            .collect::<Result<Vec<_>, CliError>>()?;
        Ok(model.coat(spec, &inspirations)?)
    });
    coats.collect()
}

impl Workshop for Bench {
    fn formats(&self) -> Formats {
        let films = FilmFormat::ALL.into_iter();
        let films = films.filter(|format| self.ffmpeg.can_write(*format));
        Formats {
            films: films
                .map(|format| format.ending().to_owned())
                .chain(["png".to_owned()])
                .collect(),
            exports: ["splats", "points"].map(str::to_owned).to_vec(),
        }
    }

    fn film(&mut self, order: &FilmOrder, progress: Progress<'_>, stop: &Stop) -> Made {
        let model = self.model()?;
        let say = |error: CliError| error.to_string();
        let coats = coats(&model, &order.paint).map_err(say)?;
        // A series of pictures leaves as one file.
        let ending = match order.format.as_str() {
            "png" => "zip",
            ending => ending,
        };
        let output = order.folder.join(format!("{}.{ending}", file_name(&model)));
        let film_order = Film {
            cameras: &order.cameras,
            fps: order.fps,
            coats: &coats,
            side_by_side: order.side_by_side,
            output: &output,
            ffmpeg: self.ffmpeg.clone(),
        };
        film(&model, &film_order, progress, stop).map_err(say)
    }

    fn export(&mut self, order: &ExportOrder, progress: Progress<'_>, stop: &Stop) -> Made {
        let model = self.model()?;
        let coats = coats(&model, &order.paint).map_err(|error| error.to_string())?;
        let output = order
            .folder
            .join(format!("{}-{}.ply", file_name(&model), order.kind));
        export(&model, &coats, (&order.kind, &output), progress, stop)
    }
}

fn file_name(model: &Model) -> String {
    let name = model.file.scene.name.chars();
    let plain = name.map(|c| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' });
    let name: String = plain.take(40).collect();
    if name.is_empty() { "scene".into() } else { name }
}
