//! Moving pictures.

mod encoder;
mod gif;
mod video;

pub use encoder::Ffmpeg;
pub use gif::Gif;

use std::path::{Path, PathBuf};

use image::RgbImage;

use self::video::Video;
use super::{Frame, Sink};
use crate::cli::CliError;

/// Least frames a second of any film.
const LEAST_FPS: f64 = 0.1;

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
    fn most_fps(self) -> f64 {
        match self {
            Self::Gif => 50.0,
            Self::Mp4 | Self::WebM => 240.0,
        }
    }
}

/// How films are made.
#[derive(Debug, Clone)]
pub struct FilmOptions {
    /// As what.
    pub format: FilmFormat,
    /// Frames a second.
    pub fps: f64,
    /// By which ffmpeg, where the format needs one.
    pub ffmpeg: Ffmpeg,
}

impl FilmOptions {
    /// Fails early where films of this kind cannot be made.
    pub fn check(&self, path: &Path) -> Result<(), CliError> {
        if self.format.nearest_fps(self.fps) != self.fps {
            return Err(CliError::Usage(format!(
                "a .{} film shows {LEAST_FPS} to {} frames a second, not {}; give another --fps",
                self.format.ending(),
                self.format.most_fps(),
                self.fps
            )));
        }
        self.ffmpeg.encoder(self.format, path).map(drop)
    }
}

enum Film {
    Gif(Gif),
    Video(Video),
}

/// One film per variant.
pub struct Films(Vec<Film>);

impl Films {
    /// Begins films at `path`, or at `path` with the variants' names before its ending where
    /// there are several.
    pub fn new(path: &Path, variants: &[String], options: &FilmOptions) -> Result<Self, CliError> {
        let encoder = options.ffmpeg.encoder(options.format, path)?;
        let film = |path: &Path| match encoder {
            None => Ok(Film::Gif(Gif::new(path, options.fps))),
            Some(encoder) => {
                let video = Video::new(path, options.fps, options.ffmpeg.clone(), encoder);
                video.map(Film::Video)
            }
        };
        if variants.len() < 2 {
            return Ok(Self(vec![film(path)?]));
        }
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        let ending = options.format.ending();
        let named = |name: &String| film(&path.with_file_name(format!("{stem}.{name}.{ending}")));
        variants
            .iter()
            .map(named)
            .collect::<Result<_, _>>()
            .map(Self)
    }
}

impl Sink for Films {
    fn add(&mut self, frame: Frame<'_>) -> Result<(), CliError> {
        self.0
            .iter_mut()
            .zip(frame.pictures)
            .try_for_each(|(film, picture)| match film {
                Film::Gif(gif) => gif.add(picture),
                Film::Video(video) => video.add(&picture),
            })
    }

    fn finish(self: Box<Self>) -> Result<Vec<PathBuf>, CliError> {
        let films = self.0.into_iter();
        films
            .map(|film| match film {
                Film::Gif(gif) => gif.finish(),
                Film::Video(video) => video.finish(),
            })
            .collect()
    }
}

/// Refuses a picture of another size than the first one's.
fn same_size(first: &mut Option<(u32, u32)>, picture: &RgbImage) -> Result<(), CliError> {
    if *first.get_or_insert(picture.dimensions()) == picture.dimensions() {
        return Ok(());
    }
    let problem = "the views differ in size; give --size to make a film of them";
    Err(CliError::Refused(problem.into()))
}
