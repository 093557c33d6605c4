//! The studio's films and exports.

use std::sync::{Arc, Mutex, PoisonError};

use impasto::export::{ViewSelection, Views, Watch, export_points, export_splats};
use impasto::view::{ExportOrder, FilmOrder, Formats, Made, PaintOrder, Progress, Workshop};
use impasto::{Model, Stop, StyleLayer};

use crate::cli::CliError;
use crate::cli::render::{FilmJob, coats_of, film, film_formats};
use crate::output::FfmpegProgram;

/// The model that the studio shows, once there is one.
pub type Shown = Arc<Mutex<Option<Arc<Model>>>>;

/// Makes films and exports of the model that is shown.
pub struct ModelWorkshop {
    model: Shown,
    ffmpeg: FfmpegProgram,
}

impl ModelWorkshop {
    /// One that makes films with an ffmpeg.
    pub fn new(model: Shown, ffmpeg: FfmpegProgram) -> Self {
        Self { model, ffmpeg }
    }

    fn model(&self) -> Result<Arc<Model>, String> {
        let shown = self.model.lock().unwrap_or_else(PoisonError::into_inner);
        let model = shown.clone();
        model.ok_or_else(|| "there is no model yet; wait until its training has written one".into())
    }
}

/// Coats of paint for a model, of an order's paintings.
fn coats(model: &Model, paint: &PaintOrder) -> Result<Vec<StyleLayer>, CliError> {
    let picture = |id: &str| {
        let found = paint.paintings.iter().find(|(known, _)| known == id);
        let missing = || CliError::Refused(format!("the painting {id} is not there any more"));
        found.map(|(_, picture)| picture).ok_or_else(missing)
    };
    let specs = paint.coats.coats.iter().map(|spec| {
        let pictures = spec.paintings.iter().map(|one| picture(&one.painting));
        Ok((spec, pictures.collect::<Result<Vec<_>, _>>()?))
    });
    coats_of(model, specs.collect::<Result<Vec<_>, CliError>>()?)
}

impl Workshop for ModelWorkshop {
    fn formats(&self) -> Formats {
        let films = film_formats(&self.ffmpeg).into_iter();
        Formats {
            films: films.map(|(format, _)| format.to_owned()).collect(),
            exports: ["points", "splats"].map(str::to_owned).to_vec(),
        }
    }

    fn film(&mut self, order: &FilmOrder, progress: Progress<'_>, stop: &Stop) -> Made {
        let model = self.model()?;
        let say = |error: CliError| error.to_string();
        let coats = coats(&model, &order.paint).map_err(say)?;
        let formats = film_formats(&self.ffmpeg);
        let ending = formats.iter().find(|(format, _)| *format == order.format);
        let (_, ending) = ending.ok_or("this machine cannot make such films any more")?;
        let output = order.folder.join(format!("{}.{ending}", file_name(&model)));
        let job = FilmJob {
            cameras: &order.cameras,
            fps: order.fps,
            coats: &coats,
            side_by_side: order.side_by_side,
            output: &output,
            ffmpeg: self.ffmpeg.clone(),
        };
        film(&model, &job, progress, stop).map_err(say)
    }

    fn export(&mut self, order: &ExportOrder, progress: Progress<'_>, stop: &Stop) -> Made {
        let model = self.model()?;
        let coats = coats(&model, &order.paint).map_err(|error| error.to_string())?;
        let name = format!("{}-{}.ply", file_name(&model), order.kind);
        let output = order.folder.join(name);
        let mut progress = |_: &'static str, part: f64| progress(part);
        let mut watch = Watch {
            progress: &mut progress,
            stop,
        };
        let made = Views::of_model(&model, &coats, &ViewSelection::default(), &mut watch).and_then(
            |views| match order.kind.as_str() {
                "points" => export_points(&views, &output, &mut watch),
                _ => export_splats(&views, &output, &mut watch),
            },
        );
        made.map_err(|error| error.to_string())?;
        Ok(output)
    }
}

fn file_name(model: &Model) -> String {
    let unusual = |c: char| !c.is_ascii_alphanumeric() && c != '-';
    let name: String = model.file.scene.name.chars().take(40).collect();
    match name.as_str() {
        "" => "scene".into(),
        name => name.replace(unusual, "_"),
    }
}
