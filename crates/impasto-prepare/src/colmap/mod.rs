//! The runs of COLMAP.

mod memory;
mod models;
mod planned;
mod program;
mod told;

pub(crate) use memory::extraction_threads;
pub(crate) use models::{Model, models};
pub(crate) use planned::{Plan, plan};
pub(crate) use program::Colmap;

use std::ffi::OsString;
use std::fs;
use std::path::Path;

use crate::error::PrepareError;
use crate::event::{Phase, Sink, progress};
use crate::log::Log;
use crate::photos::Group;
use program::Arguments;
use told::{Told, told};

/// Blocks of the exhaustive matcher, in photos: small enough for a bar that moves.
const BLOCK: usize = 10;
/// Options of the same meaning, of which each version knows one.
const EXTRACT_GPU: [&str; 2] = ["SiftExtraction.use_gpu", "FeatureExtraction.use_gpu"];
const EXTRACT_THREADS: [&str; 2] = [
    "SiftExtraction.num_threads",
    "FeatureExtraction.num_threads",
];
/// Pixels by which a point may miss its feature and still count, half of COLMAP's default. On
/// castle_p30 both choices together take the median error of poses from 0.42 to 0.14 % of the
/// extent, and the worst from 3.0 to 0.4 %.
const FARTHEST: &str = "2";
/// Features of a surface's own shape, described at several sizes of it (Dong & Soatto 2015): façades
/// seen aslant are matched better, for no time that shows beside the matching.
const SURFACES: [&str; 2] = [
    "SiftExtraction.estimate_affine_shape",
    "SiftExtraction.domain_size_pooling",
];
const MATCH_GPU: [&str; 2] = ["SiftMatching.use_gpu", "FeatureMatching.use_gpu"];
const MATCH_THREADS: [&str; 2] = ["SiftMatching.num_threads", "FeatureMatching.num_threads"];

/// Finds the features of all photos in `images`; tells how many a photo has on average.
pub(crate) fn extract(
    colmap: &Colmap<'_>,
    work: &Path,
    images: &Path,
    groups: &[Group],
    threads: usize,
    log: &mut Log,
    events: Sink<'_>,
) -> Result<f64, PrepareError> {
    let photos: usize = groups.iter().map(|group| group.photos.len()).sum();
    let list = work.join("photos.txt");
    let (mut done, mut features) = (0, 0);
    progress(events, Phase::Features, 0, photos);
    for group in groups {
        let names = group.photos.join("\n") + "\n";
        fs::write(&list, names).map_err(PrepareError::write(&list))?;
        let sharing = if group.shared {
            "ImageReader.single_camera"
        } else {
            "ImageReader.single_camera_per_image"
        };
        let mut run = Arguments::new(colmap, "feature_extractor");
        run.set("database_path", work.join("database.db"))
            .set("image_path", images)
            .set("image_list_path", &list)
            .set("ImageReader.camera_model", group.model())
            .set(sharing, "1")
            .set_one_of(&EXTRACT_GPU, "0", log)?
            .set_if_known(&EXTRACT_THREADS, threads.to_string());
        for option in SURFACES {
            run.set_if_known(&[option], "1".into());
        }
        colmap.succeed(&run, log, &mut |line| match told(line) {
            Some(Told::Photo) => {
                done += 1;
                progress(events, Phase::Features, done, photos);
            }
            Some(Told::Features(count)) => features += count,
            _ => {}
        })?;
    }
    Ok(features as f64 / photos.max(1) as f64)
}

/// Compares photos.
pub(crate) fn compare(
    colmap: &Colmap<'_>,
    work: &Path,
    plan: &Plan,
    threads: usize,
    log: &mut Log,
    events: Sink<'_>,
) -> Result<(), PrepareError> {
    let mut run = Arguments::new(colmap, plan.command());
    run.set("database_path", work.join("database.db"))
        .set_one_of(&MATCH_GPU, "0", log)?
        .set_if_known(&MATCH_THREADS, threads.to_string());
    if let Plan::Exhaustive = plan {
        run.set_if_known(&["ExhaustiveMatching.block_size"], BLOCK.to_string());
    }
    progress(events, Phase::Matching, 0, 1);
    colmap.succeed(&run, log, &mut |line| {
        if let Some(Told::Matched(done, total)) = told(line) {
            progress(events, Phase::Matching, done, total);
        }
    })
}

/// Places the cameras: models `0`, `1` … in the folder `models`, or none.
pub(crate) fn map(
    colmap: &Colmap<'_>,
    work: &Path,
    images: &Path,
    photos: usize,
    log: &mut Log,
    events: Sink<'_>,
) -> Result<(), PrepareError> {
    let models = work.join("models");
    fs::create_dir_all(&models).map_err(PrepareError::write(&models))?;
    let mut run = Arguments::new(colmap, "mapper");
    run.set("database_path", work.join("database.db"))
        .set("image_path", images)
        .set("output_path", &models)
        .set_if_known(&["Mapper.filter_max_reproj_error"], FARTHEST.into());
    progress(events, Phase::Mapping, 0, photos);
    let (command, run) = colmap.run(&run, log, &mut |line| {
        if let Some(Told::Registered(count)) = told(line) {
            progress(events, Phase::Mapping, count, photos);
        }
    })?;
    // Placing none is a failure to COLMAP; the caller will find no model.
    let none = !run.is_success() && !run.was_killed() && models::is_empty(&models);
    if none && told::nothing_placed(&run.said) {
        return Ok(());
    }
    run.succeeded(&command, log)
}

/// Adjusts the whole model once more, now with the principal points free: with all cameras placed
/// they are told well enough. False when COLMAP could not.
pub(crate) fn refine(
    colmap: &Colmap<'_>,
    model: &Path,
    to: &Path,
    log: &mut Log,
) -> Result<bool, PrepareError> {
    fs::create_dir_all(to).map_err(PrepareError::write(to))?;
    let mut run = Arguments::new(colmap, "bundle_adjuster");
    run.set("input_path", model)
        .set("output_path", to)
        .set("BundleAdjustment.refine_principal_point", "1");
    let (_, run) = colmap.run(&run, log, &mut |_| ())?;
    Ok(run.is_success())
}

/// Words of a command line.
type Words = Vec<OsString>;
