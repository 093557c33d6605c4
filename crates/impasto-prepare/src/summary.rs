//! What was made, told in the end.

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use impasto_scene::{Intrinsics, Scene};
use serde::Serialize;

use crate::colmap::SparseModel;
use crate::photos::{CameraGroup, LeftOut, Taken};

/// Photos by what became of them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct PhotoCounts {
    /// Files of the folder that could be photos, or frames chosen from the video.
    pub given: usize,
    /// Photos that the capture's folder has.
    pub used: usize,
    /// Photos with a pose.
    pub registered: usize,
    /// Photos that were turned upright and encoded anew.
    pub turned: usize,
}

/// Frames of a video.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct VideoFrames {
    /// Frames taken out, evenly in time.
    pub extracted: usize,
    /// The sharpest of them in as many equal parts of the time.
    pub chosen: usize,
    /// The video's length, where ffmpeg knows it.
    pub seconds: Option<f64>,
}

/// Photos that share what a camera looks like.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LensGroup {
    /// COLMAP's lens model.
    pub model: &'static str,
    /// Registered photos.
    pub photos: usize,
    /// Width of the photos in pixels.
    pub w: u32,
    /// Height of the photos in pixels.
    pub h: u32,
    /// Horizontal focal length in pixels, the mean over the photos.
    pub fl_x: f64,
    /// Vertical focal length in pixels, likewise.
    pub fl_y: f64,
    /// Horizontal field of view in degrees, of a lens without distortion.
    pub field_of_view: f64,
}

/// Wall time of the phases.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Seconds {
    /// Taking frames out of a video and choosing among them.
    pub frames: f64,
    /// Checking photos and taking them over.
    pub photos: f64,
    /// Features.
    pub features: f64,
    /// Matching.
    pub matching: f64,
    /// Mapping, and adjusting once more.
    pub mapping: f64,
    /// Everything, reading the result included.
    pub all: f64,
}

/// What was made.
#[derive(Debug, Clone, PartialEq, Default, Serialize)]
pub struct PrepareSummary {
    /// The capture's folder.
    pub scene: PathBuf,
    /// Version of COLMAP, as it calls itself.
    pub colmap: String,
    /// Counts of photos.
    pub photos: PhotoCounts,
    /// What was taken from the video, if it was one.
    pub video: Option<VideoFrames>,
    /// Files that are no usable photos, or copies of others.
    pub left_out: Vec<LeftOut>,
    /// Photos without a pose, in the capture's folder all the same.
    pub not_registered: Vec<String>,
    /// Photos in each model that COLMAP made, the largest first, which is the capture.
    pub models: Vec<usize>,
    /// Photos that only smaller models have.
    pub in_other_models: Vec<String>,
    /// How photos were compared: `exhaustive` or `sequential`.
    pub matching: &'static str,
    /// Mean distance between where a point is seen and where its camera puts it, in pixels.
    pub reprojection_error: f64,
    /// Sparse points.
    pub points: usize,
    /// Photos in which a point is seen, on average.
    pub track_length: f64,
    /// Lenses, the most used first.
    pub lenses: Vec<LensGroup>,
    /// Wall time.
    pub seconds: Seconds,
    /// Picture of cameras and points.
    pub picture: PathBuf,
    /// Every command line and its output.
    pub log: PathBuf,
}

/// Measures a capture. What is not seen in it stays empty.
pub(crate) fn summarise(
    scene: &Scene,
    taken: &[Taken],
    groups: &[CameraGroup],
    models: &[SparseModel],
) -> PrepareSummary {
    let kept = &models[0].photos;
    let missing = |name: &&String| kept.binary_search(name).is_err();
    let not_registered = taken.iter().map(|p| &p.name).filter(missing);
    let not_registered: BTreeSet<&String> = not_registered.collect();
    let others = models[1..].iter().flat_map(|model| &model.photos);
    let in_others: BTreeSet<&String> = others.filter(missing).collect();
    let (observations, distance) = reprojection(scene);
    PrepareSummary {
        photos: PhotoCounts {
            given: taken.len(),
            used: taken.len(),
            registered: kept.len(),
            turned: taken.iter().filter(|photo| photo.turned).count(),
        },
        not_registered: not_registered.into_iter().cloned().collect(),
        models: models.iter().map(|model| model.photos.len()).collect(),
        in_other_models: in_others.into_iter().cloned().collect(),
        reprojection_error: distance / observations.max(1) as f64,
        points: scene.points.len(),
        track_length: observations as f64 / scene.points.len().max(1) as f64,
        lenses: lenses(scene, groups),
        ..PrepareSummary::default()
    }
}

/// Observations in front of their cameras, and the sum of their distances from where the camera
/// puts the point, in pixels.
fn reprojection(scene: &Scene) -> (usize, f64) {
    let (mut count, mut sum) = (0, 0.0);
    for point in &scene.points {
        for seen in &point.seen_by {
            let camera = &scene.photos[seen.photo].camera;
            if let Some((pixel, _)) = camera.project(point.position) {
                count += 1;
                sum += pixel.distance(seen.pixel);
            }
        }
    }
    (count, sum)
}

/// The lenses, by group of photos and size.
fn lenses(scene: &Scene, groups: &[CameraGroup]) -> Vec<LensGroup> {
    let mut lenses: Vec<LensGroup> = Vec::new();
    for group in groups {
        let mut sizes: BTreeMap<(u32, u32), Vec<Intrinsics>> = BTreeMap::new();
        for photo in &scene.photos {
            if group.photos.binary_search(&photo.name).is_ok() {
                let k = photo.camera.intrinsics;
                sizes.entry((k.width, k.height)).or_default().push(k);
            }
        }
        for ((w, h), all) in sizes {
            let count = all.len() as f64;
            let mean = |of: fn(&Intrinsics) -> f64| all.iter().map(of).sum::<f64>() / count;
            let fl_x = mean(|k| k.fl_x);
            lenses.push(LensGroup {
                model: group.model(),
                photos: all.len(),
                w,
                h,
                fl_x,
                fl_y: mean(|k| k.fl_y),
                field_of_view: 2.0 * (0.5 * f64::from(w) / fl_x).atan().to_degrees(),
            });
        }
    }
    lenses.sort_by_key(|lens| Reverse(lens.photos));
    lenses
}
