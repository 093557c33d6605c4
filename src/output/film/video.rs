//! Films that the installed ffmpeg encodes.

use std::ffi::OsString;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, ChildStdin, Stdio};
use std::thread::JoinHandle;

use image::RgbImage;

use super::encoder::{Encoder, FfmpegProgram};
use crate::cli::CliError;
use crate::output::staging::{Staging, file_name, parent};

/// RGB to the colours of high-definition video, with tags that say so: players that have to guess
/// show other reds.
const COLOURS: [&str; 10] = [
    "-vf",
    "scale=out_color_matrix=bt709:out_range=tv:flags=accurate_rnd+full_chroma_int,format=yuv420p",
    "-colorspace",
    "bt709",
    "-color_primaries",
    "bt709",
    "-color_trc",
    "bt709",
    "-color_range",
    "tv",
];

/// A film in the making. Dropped unfinished, it leaves no trace.
pub struct Video {
    path: PathBuf,
    fps: f64,
    ffmpeg: FfmpegProgram,
    encoder: Encoder,
    // Ends before the folder goes that it writes to: fields are dropped in this order.
    running: Option<Running>,
    staging: Staging,
}

impl Video {
    /// Begins a film that will be written to `path`; ffmpeg starts with the first frame.
    ///
    /// # Errors
    /// When its folder cannot be made or written to.
    pub fn new(
        path: &Path,
        fps: f64,
        ffmpeg: FfmpegProgram,
        encoder: Encoder,
    ) -> Result<Self, CliError> {
        Ok(Self {
            path: path.to_owned(),
            fps,
            ffmpeg,
            encoder,
            running: None,
            staging: Staging::new(&parent(path))?,
        })
    }

    /// Adds a frame of the first one's size.
    ///
    /// # Errors
    /// When ffmpeg fails.
    pub fn add(&mut self, picture: &RgbImage) -> Result<(), CliError> {
        let picture = even(picture);
        let running = match &mut self.running {
            Some(running) => running,
            None => {
                let running = self.start(picture.width(), picture.height())?;
                self.running.insert(running)
            }
        };
        if running.write(picture.as_raw()) {
            return Ok(());
        }
        // It closed its end: why, it tells as it ends.
        self.ended()
            .and_then(|()| Err(self.failed("it stopped reading")))
    }

    /// Writes the film and tells its path.
    pub fn finish(mut self) -> Result<PathBuf, CliError> {
        self.ended()?;
        self.staging.commit()?;
        Ok(self.path)
    }

    fn start(&mut self, width: u32, height: u32) -> Result<Running, CliError> {
        // An option may not look like another protocol's address.
        let mut output = OsString::from("file:");
        output.push(self.staging.file(&file_name(&self.path))?);
        let mut command = self.ffmpeg.command();
        command
            .args(["-f", "rawvideo", "-pixel_format", "rgb24"])
            .args(["-video_size", &format!("{width}x{height}")])
            .args(["-framerate", &self.fps.to_string()])
            .args(["-i", "pipe:0", "-an"])
            .args(COLOURS)
            .args(self.encoder.words())
            .arg(output)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped());
        let spawned = command.spawn();
        let child = spawned.map_err(|source| self.ffmpeg.missing(&self.path, source))?;
        Ok(Running::new(child))
    }

    /// Waits for ffmpeg, which has got all.
    fn ended(&mut self) -> Result<(), CliError> {
        match self.running.take().map(Running::end) {
            None => Err(CliError::Refused(format!(
                "{}: a film needs at least one frame",
                self.path.display()
            ))),
            Some((true, _)) => Ok(()),
            Some((false, said)) => Err(self.failed(&said)),
        }
    }

    fn failed(&self, said: &str) -> CliError {
        CliError::Ffmpeg {
            path: self.path.clone(),
            said: said.to_owned(),
        }
    }
}

/// A started ffmpeg. Dropped, it is ended.
struct Running {
    child: Child,
    /// Taken when all is written.
    frames: Option<ChildStdin>,
    /// Reads what it says, of which the last line is kept.
    says: Option<JoinHandle<String>>,
}

impl Running {
    fn new(mut child: Child) -> Self {
        let frames = child.stdin.take();
        let says = child.stderr.take();
        Self {
            child,
            frames,
            says: says.map(|says| std::thread::spawn(|| last_line(says))),
        }
    }

    /// Whether it took the bytes.
    fn write(&mut self, bytes: &[u8]) -> bool {
        let frames = self.frames.as_mut();
        frames.is_some_and(|frames| frames.write_all(bytes).is_ok())
    }

    /// Lets it finish: whether it did, and what it said last.
    fn end(mut self) -> (bool, String) {
        drop(self.frames.take());
        let said = self.says.take().and_then(|says| says.join().ok());
        let said = said.filter(|line| !line.is_empty());
        match self.child.wait() {
            Ok(status) => (status.success(), said.unwrap_or_else(|| status.to_string())),
            Err(error) => (false, error.to_string()),
        }
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // Fails, as it should, where it has ended already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

fn last_line(says: ChildStderr) -> String {
    let mut last = String::new();
    let mut bytes = Vec::new();
    let mut says = BufReader::new(says);
    while says.read_until(b'\n', &mut bytes).is_ok_and(|n| n > 0) {
        let line = String::from_utf8_lossy(&bytes);
        if !line.trim().is_empty() {
            line.trim().clone_into(&mut last);
        }
        bytes.clear();
    }
    last
}

/// The picture with its last column and row doubled where their number is odd: these formats keep
/// one colour for four pixels.
fn even(picture: &RgbImage) -> RgbImage {
    let (width, height) = picture.dimensions();
    RgbImage::from_fn(
        width.next_multiple_of(2),
        height.next_multiple_of(2),
        |x, y| *picture.get_pixel(x.min(width - 1), y.min(height - 1)),
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgb;

    #[test]
    fn odd_pictures_get_their_last_pixels_twice() {
        let odd = RgbImage::from_fn(3, 5, |x, y| Rgb([x as u8, y as u8, 0]));
        let made = even(&odd);
        assert_eq!(made.dimensions(), (4, 6));
        assert_eq!(made.get_pixel(3, 5).0, [2, 4, 0]);
        assert_eq!(made.get_pixel(1, 2), odd.get_pixel(1, 2));
        assert_eq!(even(&made), made);
    }
}
