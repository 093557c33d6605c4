//! What preparing tells the world while it goes on.

use serde::Serialize;

/// One part of the work.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Phase {
    /// Frames are taken out of a video.
    Frames,
    /// The sharpest of them are chosen.
    Choosing,
    /// Photos are checked.
    Photos,
    /// They are taken over, upright.
    Taking,
    /// COLMAP looks for features.
    Features,
    /// COLMAP compares photos.
    Matching,
    /// COLMAP places the cameras.
    Mapping,
    /// COLMAP adjusts the cameras once more.
    Refining,
    /// The capture is read as training will read it.
    Checking,
}

impl Phase {
    /// Its name, one word in lower case.
    pub fn name(self) -> &'static str {
        match self {
            Self::Frames => "frames",
            Self::Choosing => "choosing",
            Self::Photos => "photos",
            Self::Taking => "taking",
            Self::Features => "features",
            Self::Matching => "matching",
            Self::Mapping => "mapping",
            Self::Refining => "refining",
            Self::Checking => "checking",
        }
    }
}

/// One thing that happened.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "snake_case", tag = "event")]
pub enum PrepareEvent {
    /// A phase has got so far; `done` 0 begins it.
    Progress {
        /// Which.
        phase: Phase,
        /// Parts done.
        done: usize,
        /// Parts in all, at least 1.
        total: usize,
    },
    /// Something that the user should know, in a sentence.
    Note {
        /// The sentence, without a full stop.
        message: String,
    },
    /// Something that is not as it should be, in a sentence.
    Warning {
        /// The sentence, without a full stop.
        message: String,
    },
}

/// Takes events.
pub(crate) type Sink<'a> = &'a mut dyn FnMut(&PrepareEvent);

/// Tells that `done` parts of `total` are done.
pub(crate) fn progress(events: Sink<'_>, phase: Phase, done: usize, total: usize) {
    let total = total.max(1);
    events(&PrepareEvent::Progress {
        phase,
        done: done.min(total),
        total,
    });
}

/// Tells a sentence.
pub(crate) fn note(events: Sink<'_>, message: String) {
    events(&PrepareEvent::Note { message });
}

/// Warns by a sentence.
pub(crate) fn warning(events: Sink<'_>, message: String) {
    events(&PrepareEvent::Warning { message });
}
