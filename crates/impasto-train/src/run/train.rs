//! A whole run: capture and paintings in, model folder out.

use crate::TrainError;
use crate::event::Event;
use crate::paintings::painting_folder;
use crate::run::checkpoint::Checkpoint;
use crate::run::identity::identity_of;
use crate::run::lock::FolderLock;
use crate::run::log::Log;
use crate::run::options::{TrainOptions, TrainSummary};
use crate::run::recovery::Unfinished;
use crate::run::stages::{Earlier, Run};
use crate::style::read_encoder;
use impasto_model::{MODEL_FILE, ModelFile, RunIdentity, Stages, Stopwatch, StyleModel};
use impasto_scene::Scene;
use impasto_style::StyleVae;
use std::path::Path;
use std::time::{Duration, Instant};

/// Trains and writes a model folder.
///
/// While it runs, the folder holds a checkpoint from which [`Unfinished::Resume`] goes on; on one
/// device with a budget in steps, to the same model as without an interruption.
///
/// # Errors
/// If the capture, the paintings or the output folder cannot be used, with nothing half-written
/// left behind; if the folder's unfinished run is in the way; [`TrainError::Stopped`] if that was
/// asked for.
pub fn train(
    options: &TrainOptions,
    sink: &mut dyn FnMut(&Event),
) -> Result<TrainSummary, TrainError> {
    let start = Instant::now();
    options.config.validate()?;
    let scene = impasto_scene::load(&options.scene, &options.load)?;
    let paintings = options.styles.as_deref();
    let paintings = paintings.map(painting_folder).transpose()?;
    let encoder = options.encoder.as_deref().map(read_encoder).transpose()?;
    let painter = match encoder {
        // Its codes are others.
        Some(_) => None,
        None => StyleModel::shipped(&options.config, &options.device)?,
    };
    let learns_style = learns_style(options, painter.is_some());
    if learns_style {
        check_sizes(&scene, options)?;
    }
    let identity = identity_of(options, &scene, paintings.as_ref(), encoder.as_ref())?;
    // Before anything is written.
    let trained = continued(options, &scene, encoder.clone())?;
    let _lock = FolderLock::take(&options.output)?;
    let earlier = unfinished(options, &identity)?;
    if let (None, Unfinished::Resume) = (&earlier, options.recovery.unfinished)
        && let Some(file) = finished(options, &identity)?
    {
        return Ok(TrainSummary {
            finished_before: true,
            ..summary(options, &file, &scene, start.elapsed())
        });
    }
    let ran = earlier.as_ref().map_or(start.elapsed(), |e| e.position.ran);
    let watch = Stopwatch::after(ran);
    let mut log = Log::create(&options.output, watch, sink)?;
    let found = paintings.as_ref().map_or(0, |folder| folder.files.len());
    log.event(&loaded(&scene, found));
    let warnings = scene.warnings.iter().cloned();
    let changes = earlier.iter().flat_map(|e| changes(options, &identity, e));
    for message in warnings.chain(changes) {
        log.event(&Event::Warning { message });
    }
    let mut run = Run {
        options,
        identity,
        scene,
        watch,
        saved: Instant::now(),
        log,
        paintings,
        encoder,
        painter,
        learns_style,
        unreadable: 0,
        earlier: earlier.map(Earlier::new),
    };
    let (file, seconds) = run.all(trained)?;
    Ok(summary(options, &file, &run.scene, seconds))
}

/// Whether there is a style stage: where it was asked for, by its paintings or by name, and where no shipped
/// painter knows the codes and sizes of the run.
fn learns_style(options: &TrainOptions, painted: bool) -> bool {
    match options.stages {
        Stages::Geometry => false,
        Stages::Style => true,
        Stages::All => options.styles.is_some() || !painted,
    }
}

/// The folder's checkpoint, if it is there and to be continued.
fn unfinished(
    options: &TrainOptions,
    identity: &RunIdentity,
) -> Result<Option<Checkpoint>, TrainError> {
    let folder = &options.output;
    if options.recovery.unfinished == Unfinished::Discard {
        Checkpoint::remove(folder)?;
        return Ok(None);
    }
    let Some(found) = Checkpoint::load(folder)? else {
        return Ok(None);
    };
    let position = &found.position;
    if options.recovery.unfinished == Unfinished::Keep {
        return Err(TrainError::Unfinished {
            folder: folder.clone(),
            stage: position.stage.stage(),
            steps: position.steps,
        });
    }
    check_same_run(folder, &position.identity, identity)?;
    Ok(Some(found))
}

/// The folder's model, if it is what a finished run of the same kind and length has made.
fn finished(
    options: &TrainOptions,
    identity: &RunIdentity,
) -> Result<Option<ModelFile>, TrainError> {
    let path = options.output.join(MODEL_FILE);
    if !path.is_file() {
        return Ok(None);
    }
    let file = ModelFile::load(&path, &options.device)?;
    let Some(made) = &file.finished else {
        return Ok(None);
    };
    // A style stage may be repeated on the geometry of another run.
    if options.stages != Stages::Style {
        check_same_run(&options.output, &made.identity, identity)?;
    }
    let same = made.identity.difference(identity).is_none();
    let same = same && made.identity.same_paintings(identity) && made.budget == options.budget;
    Ok(same.then_some(file))
}

fn check_same_run(
    folder: &Path,
    ours: &RunIdentity,
    theirs: &RunIdentity,
) -> Result<(), TrainError> {
    match ours.difference(theirs) {
        Some(difference) => Err(TrainError::Resume {
            folder: folder.to_owned(),
            difference,
        }),
        None => Ok(()),
    }
}

/// What makes the end of a resumed run another than that of the run that it continues.
fn changes(options: &TrainOptions, identity: &RunIdentity, earlier: &Checkpoint) -> Vec<String> {
    let position = &earlier.position;
    let mut changes = Vec::new();
    if position.budget != options.budget {
        changes
            .push("the budget is another than when the run began; its rates now follow this one");
    }
    if !position.identity.same_paintings(identity) {
        changes
            .push("the paintings have changed since the run began; it goes on with those of now");
    }
    changes.into_iter().map(str::to_owned).collect()
}

fn summary(
    options: &TrainOptions,
    file: &ModelFile,
    scene: &Scene,
    seconds: Duration,
) -> TrainSummary {
    let made = file.finished.as_ref();
    TrainSummary {
        model: options.output.clone(),
        quality: file.quality,
        seconds: seconds.as_secs_f64(),
        geometry_steps: made.map_or(0, |m| m.geometry_steps),
        style_steps: made.map_or(0, |m| m.style_steps),
        train_photos: scene.train().count(),
        paintings: made.map_or(0, |m| m.paintings),
        unreadable_paintings: made.map_or(0, |m| m.unreadable_paintings),
        synthetic: scene.synthetic,
        finished_before: false,
    }
}

/// The model whose style stage is to run, if that is all; that a style stage can have its networks
/// is checked.
fn continued(
    options: &TrainOptions,
    scene: &Scene,
    encoder: Option<StyleVae>,
) -> Result<Option<ModelFile>, TrainError> {
    if options.stages == Stages::Geometry {
        return Ok(None);
    }
    options.config.style.perceptual.load()?;
    options.config.encoder(encoder)?;
    if options.stages == Stages::All {
        return Ok(None);
    }
    let file = ModelFile::load(&options.output.join(MODEL_FILE), &options.device)?;
    check_same_scene(&file, scene)?;
    Ok(Some(file))
}

fn loaded(scene: &Scene, paintings: usize) -> Event {
    let size = scene
        .photos
        .first()
        .map_or((0, 0), |p| p.pixels.dimensions());
    Event::Loaded {
        train_photos: scene.train().count(),
        test_photos: scene.test().count(),
        size: [size.0, size.1],
        paintings,
        synthetic: scene.synthetic,
    }
}

fn check_sizes(scene: &Scene, options: &TrainOptions) -> Result<(), TrainError> {
    let [least_height, least_width] = options.config.style.patch;
    // Patches are cut from training photos only.
    let small = scene.train().map(|(_, p)| p).find(|p| {
        let (w, h) = p.pixels.dimensions();
        (w as usize) < least_width || (h as usize) < least_height
    });
    match small {
        Some(photo) => Err(TrainError::SmallPhotos {
            photo: photo.name.clone(),
            width: photo.pixels.width() as usize,
            height: photo.pixels.height() as usize,
            least_width,
            least_height,
        }),
        None => Ok(()),
    }
}

/// A frozen field fits only the capture that it was made from: the same photos, split and poses.
fn check_same_scene(file: &ModelFile, scene: &Scene) -> Result<(), TrainError> {
    let differs = |what: String| TrainError::OtherScene { what };
    let (ours, theirs) = (&file.scene.photos, &scene.photos);
    if ours.len() != theirs.len() {
        return Err(differs(format!(
            "{} photos instead of {}",
            theirs.len(),
            ours.len()
        )));
    }
    for (ours, theirs) in ours.iter().zip(theirs) {
        let moved = ours.camera.centre().distance(theirs.camera.centre());
        if ours.name != theirs.name || ours.split != theirs.split || moved > SAME_PLACE {
            return Err(differs(format!(
                "photo {} where the model knows {}, or another pose or split of it",
                theirs.name, ours.name
            )));
        }
    }
    Ok(())
}

/// How far a camera of the same capture may seem to have moved, scene units.
const SAME_PLACE: f64 = 1e-4;
