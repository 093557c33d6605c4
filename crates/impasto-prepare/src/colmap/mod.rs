//! The runs of COLMAP.

mod matching;
mod memory;
mod models;
mod program;
mod progress;

pub(crate) use matching::{MatchingPlan, plan};
pub(crate) use memory::extraction_threads;
pub(crate) use models::SparseModel;
pub(crate) use program::Colmap;

use std::fs;
use std::path::Path;

use crate::error::PrepareError;
use crate::event::{self, Phase, Sink};
use crate::log::CommandLog;
use crate::photos::CameraGroup;
use program::Arguments;
use progress::{ProgressLine, parse};

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

/// What every run of COLMAP for a capture needs.
pub(crate) struct Reconstruction<'a> {
    pub(crate) colmap: &'a Colmap<'a>,
    /// Folder of the database and the models.
    pub(crate) work: &'a Path,
    /// Folder of the photos.
    pub(crate) images: &'a Path,
    pub(crate) log: &'a mut CommandLog,
    pub(crate) events: Sink<'a>,
}

impl<'a> Reconstruction<'a> {
    /// The command line of a command that works on the database.
    fn arguments(&self, command: &'static str) -> Arguments<'a> {
        let mut run = Arguments::new(self.colmap, command);
        run.set("database_path", self.work.join("database.db"));
        run
    }

    /// Finds the features of all photos; returns how many a photo has on average.
    pub(crate) fn extract(
        &mut self,
        groups: &[CameraGroup],
        threads: usize,
    ) -> Result<f64, PrepareError> {
        let photos: usize = groups.iter().map(|group| group.photos.len()).sum();
        let list = self.work.join("photos.txt");
        let (mut done, mut features) = (0, 0);
        event::progress(self.events, Phase::Features, 0, photos);
        for group in groups {
            let names = group.photos.join("\n") + "\n";
            fs::write(&list, names).map_err(PrepareError::write(&list))?;
            let sharing = if group.shared {
                "ImageReader.single_camera"
            } else {
                "ImageReader.single_camera_per_image"
            };
            let mut run = self.arguments("feature_extractor");
            run.set("image_path", self.images)
                .set("image_list_path", &list)
                .set("ImageReader.camera_model", group.model())
                .set(sharing, "1")
                .set_one_of(&EXTRACT_GPU, "0", self.log)?
                .set_if_known(&EXTRACT_THREADS, threads.to_string());
            for option in SURFACES {
                run.set_if_known(&[option], "1".into());
            }
            run.succeed(self.log, &mut |line| match parse(line) {
                Some(ProgressLine::Photo) => {
                    done += 1;
                    event::progress(self.events, Phase::Features, done, photos);
                }
                Some(ProgressLine::Features(count)) => features += count,
                _ => {}
            })?;
        }
        Ok(features as f64 / photos.max(1) as f64)
    }

    /// Compares photos.
    pub(crate) fn compare(
        &mut self,
        plan: MatchingPlan,
        threads: usize,
    ) -> Result<(), PrepareError> {
        let mut run = self.arguments(plan.command());
        run.set_one_of(&MATCH_GPU, "0", self.log)?
            .set_if_known(&MATCH_THREADS, threads.to_string());
        if plan == MatchingPlan::Exhaustive {
            run.set_if_known(&["ExhaustiveMatching.block_size"], BLOCK.to_string());
        }
        event::progress(self.events, Phase::Matching, 0, 1);
        run.succeed(self.log, &mut |line| {
            if let Some(ProgressLine::Matched(done, total)) = parse(line) {
                event::progress(self.events, Phase::Matching, done, total);
            }
        })
    }

    /// Places the cameras; returns the models, the one with the most photos first, or none.
    pub(crate) fn map(&mut self, photos: usize) -> Result<Vec<SparseModel>, PrepareError> {
        let folder = self.work.join("models");
        fs::create_dir_all(&folder).map_err(PrepareError::write(&folder))?;
        let mut run = self.arguments("mapper");
        run.set("image_path", self.images)
            .set("output_path", &folder)
            .set_if_known(&["Mapper.filter_max_reproj_error"], FARTHEST.into());
        event::progress(self.events, Phase::Mapping, 0, photos);
        let outcome = run.run(self.log, &mut |line| {
            if let Some(ProgressLine::Registered(count)) = parse(line) {
                event::progress(self.events, Phase::Mapping, count, photos);
            }
        })?;
        // Placing none is a failure to COLMAP.
        let none = !outcome.is_success() && !outcome.was_killed() && models::is_empty(&folder);
        if !(none && progress::nothing_placed(&outcome.said)) {
            outcome.succeeded(&run.name(), self.log)?;
        }
        models::models(&folder, self.log)
    }
}

/// Adjusts the whole model once more, now with the principal points free: with all cameras placed
/// they are told well enough. False when COLMAP could not.
pub(crate) fn refine(
    colmap: &Colmap<'_>,
    model: &Path,
    to: &Path,
    log: &mut CommandLog,
) -> Result<bool, PrepareError> {
    fs::create_dir_all(to).map_err(PrepareError::write(to))?;
    let mut run = Arguments::new(colmap, "bundle_adjuster");
    run.set("input_path", model)
        .set("output_path", to)
        .set("BundleAdjustment.refine_principal_point", "1");
    Ok(run.run(log, &mut |_| ())?.is_success())
}
