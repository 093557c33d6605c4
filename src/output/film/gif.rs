//! Moving pictures.

use std::cell::RefCell;
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::rc::Rc;

use image::codecs::gif::{GifEncoder, Repeat};
use image::{Delay, DynamicImage, RgbImage};

use super::{Frame, Sink, write_file};
use crate::cli::CliError;

/// Milliseconds per frame.
const FRAME_TIME: u32 = 80;
/// NeuQuant looks at every tenth pixel for a palette: ten times faster, hardly worse.
const QUANTISER_SPEED: i32 = 10;

/// Bytes that the encoder writes and that outlive it: its last ones are written as it drops.
#[derive(Clone, Default)]
struct Bytes(Rc<RefCell<Vec<u8>>>);

impl Write for Bytes {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.borrow_mut().extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// A GIF that repeats for ever; every frame has its own 256 colours.
pub struct Film {
    path: PathBuf,
    size: Option<(u32, u32)>,
    bytes: Bytes,
    encoder: GifEncoder<Bytes>,
}

impl Film {
    /// Begins a film that will be written to `path`.
    pub fn new(path: &Path) -> Self {
        let bytes = Bytes::default();
        Self {
            path: path.to_owned(),
            size: None,
            encoder: GifEncoder::new_with_speed(bytes.clone(), QUANTISER_SPEED),
            bytes,
        }
    }

    /// Adds a frame.
    ///
    /// # Errors
    /// When its size is not the first one's.
    pub fn add(&mut self, picture: RgbImage) -> Result<(), CliError> {
        let size = picture.dimensions();
        let encode = CliError::encode(&self.path);
        if self.size.is_none() {
            if let Err(error) = self.encoder.set_repeat(Repeat::Infinite) {
                return Err(encode(error));
            }
        } else if self.size != Some(size) {
            let problem = "the views differ in size; give --size to make a film of them";
            return Err(CliError::Refused(problem.into()));
        }
        self.size = Some(size);
        let pixels = DynamicImage::ImageRgb8(picture).into_rgba8();
        let delay = Delay::from_numer_denom_ms(FRAME_TIME, 1);
        let frame = image::Frame::from_parts(pixels, 0, 0, delay);
        self.encoder.encode_frame(frame).map_err(encode)
    }

    /// Writes the film and tells its path.
    pub fn finish(self) -> Result<PathBuf, CliError> {
        drop(self.encoder);
        let bytes = self.bytes.0.take();
        write_file(&self.path, |path| {
            fs::write(path, &bytes).map_err(CliError::write(path))
        })?;
        Ok(self.path)
    }
}

/// One film per variant.
pub struct Films(Vec<Film>);

impl Films {
    /// Begins films at `path`, or at `path` with the variants' names before its ending where
    /// there are several.
    pub fn new(path: &Path, variants: &[String]) -> Self {
        if variants.len() < 2 {
            return Self(vec![Film::new(path)]);
        }
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        let film = |name: &String| Film::new(&path.with_file_name(format!("{stem}.{name}.gif")));
        Self(variants.iter().map(film).collect())
    }
}

impl Sink for Films {
    fn add(&mut self, frame: Frame<'_>) -> Result<(), CliError> {
        self.0
            .iter_mut()
            .zip(frame.pictures)
            .try_for_each(|(film, picture)| film.add(picture))
    }

    fn finish(self: Box<Self>) -> Result<Vec<PathBuf>, CliError> {
        self.0.into_iter().map(Film::finish).collect()
    }
}

#[cfg(test)]
mod tests {
    use image::AnimationDecoder;
    use image::codecs::gif::GifDecoder;

    use super::*;

    #[test]
    fn a_film_has_its_frames_and_their_colours() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("clip.gif");
        let mut film = Film::new(&path);
        for shade in [10, 200] {
            film.add(RgbImage::from_pixel(8, 6, image::Rgb([shade, 90, 60])))
                .unwrap();
        }
        film.finish().unwrap();
        let decoder = GifDecoder::new(io::Cursor::new(fs::read(&path).unwrap())).unwrap();
        let frames = decoder.into_frames().collect_frames().unwrap();
        let shades: Vec<u8> = frames
            .iter()
            .map(|f| f.buffer().get_pixel(3, 3).0[0])
            .collect();
        assert_eq!(shades.len(), 2);
        assert!(
            shades[0].abs_diff(10) < 4 && shades[1].abs_diff(200) < 4,
            "{shades:?}"
        );
        assert_eq!(frames[0].delay().numer_denom_ms(), (FRAME_TIME, 1));
    }

    #[test]
    fn frames_of_two_sizes_are_refused() {
        let mut film = Film::new(Path::new("never-written.gif"));
        film.add(RgbImage::new(4, 4)).unwrap();
        assert!(matches!(
            film.add(RgbImage::new(4, 5)),
            Err(CliError::Refused(_))
        ));
    }
}
