//! What films are written as.

/// Least frames a second of any film.
pub const LEAST_FPS: f64 = 0.1;

/// What a film is written as.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FilmFormat {
    /// Without any other program; 256 colours a frame.
    Gif,
    /// H.264, by ffmpeg.
    Mp4,
    /// VP9, or else AV1, by ffmpeg.
    WebM,
}

impl FilmFormat {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Gif, Self::Mp4, Self::WebM];

    /// The ending of its files.
    pub fn ending(self) -> &'static str {
        match self {
            Self::Gif => "gif",
            Self::Mp4 => "mp4",
            Self::WebM => "webm",
        }
    }

    /// The format of files with an ending, in small letters.
    pub fn of_ending(ending: &str) -> Option<Self> {
        Self::ALL
            .into_iter()
            .find(|format| format.ending() == ending)
    }

    /// Frames a second where nobody says how many.
    pub fn usual_fps(self) -> f64 {
        match self {
            Self::Gif => 12.5,
            Self::Mp4 | Self::WebM => 24.0,
        }
    }

    /// The number of frames a second nearest to one that can be had.
    pub fn nearest_fps(self, fps: f64) -> f64 {
        fps.clamp(LEAST_FPS, self.most_fps())
    }

    /// Viewers show a GIF of more frames a second slowly instead.
    pub fn most_fps(self) -> f64 {
        match self {
            Self::Gif => 50.0,
            Self::Mp4 | Self::WebM => 240.0,
        }
    }
}
