//! Moving pictures.

mod encoder;
mod format;
mod gif;
mod video;

pub use encoder::FfmpegProgram;
pub use format::FilmFormat;
pub use gif::Gif;

use std::path::{Path, PathBuf};

use self::format::LEAST_FPS;
use self::video::Video;
use super::frame::{RenderedFrame, Sink};
use crate::cli::CliError;

/// How films are made.
#[derive(Debug, Clone)]
pub struct FilmOptions {
    /// As what.
    pub format: FilmFormat,
    /// Frames a second.
    pub fps: f64,
    /// By which ffmpeg, where the format needs one.
    pub ffmpeg: FfmpegProgram,
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
pub struct Films {
    films: Vec<Film>,
    /// Of the first frame.
    size: Option<(u32, u32)>,
}

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
        let films = if variants.len() < 2 {
            vec![film(path)?]
        } else {
            let stem = path.file_stem().unwrap_or_default().to_string_lossy();
            let ending = options.format.ending();
            let file = |name| path.with_file_name(format!("{stem}.{name}.{ending}"));
            let films = variants.iter().map(|name| film(&file(name)));
            films.collect::<Result<_, _>>()?
        };
        Ok(Self { films, size: None })
    }
}

impl Sink for Films {
    fn add(&mut self, frame: RenderedFrame<'_>) -> Result<(), CliError> {
        for (film, picture) in self.films.iter_mut().zip(frame.pictures) {
            if *self.size.get_or_insert(picture.dimensions()) != picture.dimensions() {
                let problem = "the views differ in size; give --size to make a film of them";
                return Err(CliError::Refused(problem.into()));
            }
            match film {
                Film::Gif(gif) => gif.add(picture)?,
                Film::Video(video) => video.add(&picture)?,
            }
        }
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<Vec<PathBuf>, CliError> {
        let films = self.films.into_iter();
        films
            .map(|film| match film {
                Film::Gif(gif) => gif.finish(),
                Film::Video(video) => video.finish(),
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use image::RgbImage;
    use impasto::scene::Camera;

    use super::*;
    use crate::output::Viewpoint;

    #[test]
    fn frames_of_two_sizes_are_refused() {
        let options = FilmOptions {
            format: FilmFormat::Gif,
            fps: 12.5,
            ffmpeg: FfmpegProgram::new("ffmpeg".as_ref()),
        };
        let mut films = Films::new(Path::new("never-written.gif"), &[], &options).unwrap();
        let pose = std::array::from_fn(|i| if i % 5 == 0 { 1.0 } else { 0.0 });
        let view = Viewpoint {
            camera: Camera::viewpoint(&pose, 50.0, (4, 4)).unwrap(),
            photo: None,
        };
        let mut add = |height| {
            films.add(RenderedFrame {
                view: &view,
                pictures: vec![RgbImage::new(4, height)],
                depth: &[],
            })
        };
        add(4).unwrap();
        assert!(matches!(add(5), Err(CliError::Refused(_))));
    }
}
