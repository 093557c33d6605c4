//! `impasto prepare`.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use impasto::prepare::{
    Cameras, LensGroup, Matching, PrepareOptions, PrepareSummary, Seconds, prepare,
};

use super::ffmpeg::FfmpegArgs;
use super::progress::PrepareProgress;
use super::values::clock;
use super::{CliError, CommandOutput, to_json};

/// Compute camera poses for raw photos or a video, with the installed COLMAP
///
/// SCENE gets the photos (images), the cameras and points (sparse), a picture of them
/// (capture.png) and every command line with its output (colmap.log). Photos are taken over as they
/// are, by hard links where possible, except those that EXIF says are turned: they are turned
/// upright. Nothing is undistorted.
#[derive(Debug, Args)]
#[command(verbatim_doc_comment)]
pub struct PrepareArgs {
    /// Folder of photos, sub-folders included, or a video (mp4, mov, mkv, avi, webm, m4v; needs
    /// ffmpeg)
    #[arg(value_name = "PHOTOS|VIDEO")]
    input: PathBuf,
    /// Folder to make the capture in: a new or an empty one
    #[arg(short, long, value_name = "SCENE")]
    output: PathBuf,
    /// How many frames to choose from a video, the sharpest of as many equal parts of its time
    #[arg(long, value_name = "N", default_value_t = 100,
          value_parser = clap::value_parser!(u16).range(3..=2000))]
    frames: u16,
    /// Which photos to compare
    #[arg(long, value_enum, default_value = "auto")]
    matching: MatchingArg,
    /// Whether photos share a camera
    #[arg(long, value_enum, default_value = "auto")]
    cameras: CamerasArg,
    /// COLMAP's program
    #[arg(
        long,
        value_name = "PROGRAM",
        env = "IMPASTO_COLMAP",
        default_value = "colmap"
    )]
    colmap: PathBuf,
    #[command(flatten)]
    ffmpeg: FfmpegArgs,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum MatchingArg {
    /// Exhaustive for up to 80 photos and for more whose names show no order, else sequential
    Auto,
    /// Every photo with every other
    Exhaustive,
    /// Every photo with its neighbours by name; faster, but misses that a walk comes back
    Sequential,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum CamerasArg {
    /// Photos of one size, and of one lens where EXIF names it, share a camera
    Auto,
    /// All photos share one camera
    One,
    /// Every photo has its own camera
    Many,
}

/// Runs the command.
pub fn run(args: &PrepareArgs) -> Result<CommandOutput, CliError> {
    let options = PrepareOptions {
        input: args.input.clone(),
        scene: args.output.clone(),
        frames: args.frames.into(),
        matching: match args.matching {
            MatchingArg::Auto => Matching::Auto,
            MatchingArg::Exhaustive => Matching::Exhaustive,
            MatchingArg::Sequential => Matching::Sequential,
        },
        cameras: match args.cameras {
            CamerasArg::Auto => Cameras::Auto,
            CamerasArg::One => Cameras::One,
            CamerasArg::Many => Cameras::Many,
        },
        colmap: args.colmap.clone(),
        ffmpeg: args.ffmpeg.program.clone(),
    };
    let mut progress = PrepareProgress::default();
    let summary = prepare(&options, &mut |event| progress.show(event))?;
    drop(progress);
    Ok(CommandOutput {
        text: describe(&summary),
        json: to_json(&summary),
    })
}

/// A summary in words.
fn describe(summary: &PrepareSummary) -> String {
    let mut lines = Vec::new();
    if let Some(video) = summary.video {
        lines.push(format!(
            "{} of {} frames chosen",
            video.chosen, video.extracted
        ));
    }
    let photos = summary.photos;
    lines.push(format!(
        "{} of {} photos registered, reprojection error {:.2} pixels",
        photos.registered, photos.used, summary.reprojection_error
    ));
    if !summary.not_registered.is_empty() {
        lines.push(format!(
            "not registered: {}",
            summary.not_registered.join(", ")
        ));
    }
    if !summary.left_out.is_empty() {
        let files: Vec<&str> = summary.left_out.iter().map(|f| f.file.as_str()).collect();
        lines.push(format!("left out: {}", files.join(", ")));
    }
    lines.push(format!(
        "{} points, each seen in {:.1} photos on average",
        summary.points, summary.track_length
    ));
    lines.extend(summary.lenses.iter().map(lens));
    lines.push(times(&summary.seconds));
    lines.push(format!("picture: {}", summary.picture.display()));
    lines.push(format!("log: {}", summary.log.display()));
    lines.push(format!(
        "next: impasto train {} -o MODEL",
        summary.scene.display()
    ));
    lines.join("\n")
}

fn lens(lens: &LensGroup) -> String {
    format!(
        "{} photos of {}×{}: {} lens, focal length {:.0} pixels, field of view {:.0}°",
        lens.photos, lens.w, lens.h, lens.model, lens.fl_x, lens.field_of_view
    )
}

fn times(seconds: &Seconds) -> String {
    let parts = [
        ("frames", seconds.frames),
        ("photos", seconds.photos),
        ("features", seconds.features),
        ("matching", seconds.matching),
        ("mapping", seconds.mapping),
    ];
    let measured: Vec<String> = parts
        .into_iter()
        .filter(|(_, seconds)| *seconds > 0.0)
        .map(|(name, seconds)| format!("{name} {}", clock(seconds)))
        .collect();
    format!("{} in all: {}", clock(seconds.all), measured.join(", "))
}
