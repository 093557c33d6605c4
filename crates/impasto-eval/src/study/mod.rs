//! A study with people: two clips of the same path in the style of the same painting, Impasto's and
//! a compared method's, and two questions: which matches the painting better, and which flickers
//! less (PAPER §10).
//!
//! [`StudyPlan`] decides which pairs are shown and makes a [`Study`]: one page that holds everything, and
//! a [`StudyKey`] that says which clip is whose. The page knows pairs by number and their clips as A and
//! B, nothing else. Every participant sees all pairs, in an order of their own, and sends back the
//! file of answers that the page makes. [`summarise`] reads those files with the key.
//!
//! A file of answers is
//! `{"schema": 1, "study": NAME, "participant": NAME, "answers": [{"question": "q03",
//! "match": {"choice": "a", "seconds": 4.2}, "flicker": {"choice": "neither", "seconds": 6.1}}, …]}`,
//! in the order in which the pairs were seen, with seconds since the pair appeared.
//!
//! An answer is A, B, or neither ("cannot tell"), which counts as half for each. A *catch trial* is a
//! pair with a known answer: a compared method's clip beside the unstylised render, which nobody who
//! looks finds nearer to the painting. Who does is left out of the results. Impasto is in no catch
//! trial, so that leaving people out cannot favour it.

mod answers;
mod clips;
mod key;
mod page;
mod plan;
mod statistics;
mod summary;
mod trials;

pub use key::{Asked, Question, SCHEMA, Side, StudyKey};
pub use plan::{StudyOptions, StudyPlan};
pub use statistics::{sign_test, wilson};
pub use summary::{MeanPreference, PerQuestion, Preference, SetAside, StudySummary, summarise};

use crate::EvalError;
use impasto_scene::paths::PathError;

/// What a study consists of.
#[derive(Debug, Clone)]
pub struct Study {
    /// For participants: HTML, complete in itself.
    pub page: String,
    /// For whoever asks.
    pub key: StudyKey,
}

/// Why a study cannot be made or read.
#[derive(Debug, thiserror::Error)]
pub enum StudyError {
    /// There is nothing to ask.
    #[error(
        "there is nothing to ask: a study needs a painting, a method to compare with, a question, \
         two frames, and a model that was trained on photos"
    )]
    Nothing,
    /// The model cannot be painted.
    #[error(transparent)]
    Eval(#[from] EvalError),
    /// The path cannot be fitted to the cameras.
    #[error("the camera path cannot be made: {0}")]
    Path(#[from] PathError),
    /// A frame cannot be encoded.
    #[error("a clip's frame cannot be written as JPEG: {0}")]
    Picture(#[from] image::ImageError),
    /// The page's data cannot be written.
    #[error("the page's data cannot be written as JSON: {0}")]
    Data(#[from] serde_json::Error),
    /// The key is none.
    #[error("this is no key of a study ({0}); take the key.json that was made with the page")]
    Key(String),
    /// No answers are left.
    #[error("none of the {files} files of answers can be used{first}")]
    NoAnswers {
        /// How many were given.
        files: usize,
        /// The first of them, and what is wrong with it.
        first: String,
    },
}
