//! What training tells the world. Bars, the JSON log and the studio only consume this.

use serde::Serialize;
use std::fmt;
use std::path::PathBuf;

/// Which of the two trainings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Stage {
    /// Photos → field (PAPER §4).
    Geometry,
    /// Paintings → hypernetwork (PAPER §8).
    Style,
}

impl fmt::Display for Stage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Geometry => "geometry",
            Self::Style => "style",
        })
    }
}

/// One thing that happened.
#[derive(Debug, Clone, Serialize)]
#[serde(rename_all = "snake_case", tag = "event")]
pub enum Event {
    /// The capture is read.
    Loaded {
        /// Training photos.
        train_photos: usize,
        /// Held-out photos.
        test_photos: usize,
        /// Width and height of the first photo as trained.
        size: [u32; 2],
        /// Files of the style folder, not looked at yet.
        paintings: usize,
        /// Whether the photos were made by a program.
        synthetic: bool,
    },
    /// Statistics of pictures were measured or found in the cache (reported a few times a second
    /// at most).
    Measured {
        /// Pictures so far.
        pictures: usize,
        /// Those of them that had to be looked at; the others were cached.
        fresh: usize,
        /// Pictures in the end, unless time runs out or files are unreadable.
        planned: usize,
    },
    /// An encoder of styles is being trained.
    EncoderStep {
        /// Steps so far.
        step: u64,
        /// Steps in the end.
        steps: u64,
        /// Smoothed mean squared error of the rebuilt statistics, in units of their variance.
        error: f64,
    },
    /// An interrupted run goes on, in a stage that has already begun.
    Resumed {
        /// Which.
        stage: Stage,
        /// Its steps so far.
        step: u64,
        /// Seconds that the run has taken so far.
        seconds: f64,
    },
    /// A stage begins.
    StageStarted {
        /// Which.
        stage: Stage,
        /// Planned length in seconds, if the budget is a time.
        seconds: Option<f64>,
        /// Planned steps, if the budget is a count.
        steps: Option<u64>,
    },
    /// Some steps are done (reported a few times a second at most).
    Step {
        /// Which.
        stage: Stage,
        /// Steps so far.
        step: u64,
        /// Part of the stage that is done, in `[0, 1]`.
        progress: f64,
        /// Smoothed loss.
        loss: f64,
        /// Its smoothed content loss, once the style stage has one.
        content: Option<f64>,
        /// Its smoothed style loss, likewise.
        style: Option<f64>,
        /// Steps a second.
        rate: f64,
        /// Rays a second.
        rays_per_second: f64,
        /// Seconds left.
        eta: f64,
    },
    /// Held-out views were rendered and compared with their photos.
    Validation {
        /// Steps so far.
        step: u64,
        /// Mean peak signal-to-noise ratio, dB.
        psnr: f64,
        /// Mean structural similarity.
        ssim: f64,
        /// Number of views.
        views: usize,
    },
    /// A picture of the current state was written.
    Preview {
        /// File.
        path: PathBuf,
    },
    /// The model was written, or what an interrupted run would go on from.
    Checkpoint {
        /// File.
        path: PathBuf,
    },
    /// Something deserves attention; training goes on.
    Warning {
        /// One sentence.
        message: String,
    },
    /// All done.
    Done {
        /// Seconds since the start.
        seconds: f64,
    },
}
