//! Films that every browser shows, made without any other program.

use std::cell::RefCell;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::rc::Rc;

use image::codecs::gif::{GifEncoder, Repeat};
use image::{Delay, DynamicImage, RgbImage};

use crate::cli::CliError;
use crate::output::staging::write_file;

/// A GIF counts time in hundredths of a second.
const TICKS: f64 = 100.0;
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
pub struct Gif {
    path: PathBuf,
    fps: f64,
    frames: u32,
    bytes: Bytes,
    encoder: GifEncoder<Bytes>,
}

impl Gif {
    /// Begins a film that will be written to `path`, of 0.1 to 50 frames a second.
    pub fn new(path: &Path, fps: f64) -> Self {
        let bytes = Bytes::default();
        Self {
            path: path.to_owned(),
            fps,
            frames: 0,
            encoder: GifEncoder::new_with_speed(bytes.clone(), QUANTISER_SPEED),
            bytes,
        }
    }

    /// Adds a frame of the first one's size.
    pub fn add(&mut self, picture: RgbImage) -> Result<(), CliError> {
        let encode = CliError::encode(&self.path);
        if self.frames == 0
            && let Err(error) = self.encoder.set_repeat(Repeat::Infinite)
        {
            return Err(encode(error));
        }
        let pixels = DynamicImage::ImageRgb8(picture).into_rgba8();
        let delay = Delay::from_numer_denom_ms(self.milliseconds(), 1);
        let frame = image::Frame::from_parts(pixels, 0, 0, delay);
        self.frames += 1;
        self.encoder.encode_frame(frame).map_err(encode)
    }

    /// How long the next frame stays. What one is rounded by, the next make up for.
    fn milliseconds(&self) -> u32 {
        let at = |frames: u32| (f64::from(frames) * TICKS / self.fps).round();
        let ticks = at(self.frames + 1) - at(self.frames);
        10 * ticks as u32
    }

    /// Writes the film and tells its path.
    pub fn finish(self) -> Result<PathBuf, CliError> {
        drop(self.encoder);
        write_file(&self.path, self.bytes.0.take())?;
        Ok(self.path)
    }
}

#[cfg(test)]
mod tests {
    use std::fs;

    use image::AnimationDecoder;
    use image::codecs::gif::GifDecoder;

    use super::*;

    #[test]
    fn a_film_has_its_frames_and_their_colours() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("clip.gif");
        let mut film = Gif::new(&path, 12.5);
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
        assert_eq!(frames[0].delay().numer_denom_ms(), (80, 1));
    }

    #[test]
    fn times_are_rounded_without_drifting() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("clip.gif");
        let mut film = Gif::new(&path, 24.0);
        for _ in 0..24 {
            film.add(RgbImage::new(2, 2)).unwrap();
        }
        film.finish().unwrap();
        let decoder = GifDecoder::new(io::Cursor::new(fs::read(&path).unwrap())).unwrap();
        let frames = decoder.into_frames().collect_frames().unwrap();
        let times = frames.iter().map(|frame| frame.delay().numer_denom_ms());
        let times: Vec<u32> = times.map(|(time, part)| time / part).collect();
        assert_eq!(times.iter().sum::<u32>(), 1000);
        assert!(
            times.iter().all(|time| [40, 50].contains(time)),
            "{times:?}"
        );
    }
}
