//! The demo's film: once around the scene while one style turns into the next.

use std::path::{Path, PathBuf};

use impasto::scene::Split;
use impasto::scene::paths::orbit;
use impasto::{Model, StyleEmbedding};

use super::styles::HeldOutStyle;
use crate::cli::CliError;
use crate::cli::progress::FrameProgress;
use crate::output::{FilmFormat, Gif};

const FRAMES: usize = 48;
/// Height of a frame in pixels, unless the photos are smaller.
const HEIGHT: u32 = 240;
/// Styles that the film passes through.
const STYLES: usize = 3;
/// Part of a style's time in which it stays as it is.
const HOLD: f32 = 0.5;

/// Renders the film; it ends where it began.
pub fn film(model: &Model, styles: &[HeldOutStyle], path: &Path) -> Result<PathBuf, CliError> {
    let styles = &styles[..styles.len().min(STYLES)];
    let train = model.file.scene.cameras(Split::Train);
    let size = train.first().map_or((HEIGHT, HEIGHT), |camera| {
        let k = &camera.intrinsics;
        let height = HEIGHT.min(k.height);
        let width = f64::from(height) * f64::from(k.width) / f64::from(k.height);
        (width.round() as u32, height)
    });
    let cameras = orbit(&train, FRAMES, size)?;
    let mut film = Gif::new(path, FilmFormat::Gif.usual_fps());
    let mut progress = FrameProgress::new("render", FRAMES);
    for (frame, camera) in cameras.iter().enumerate() {
        let (from, to, share) = passage(frame as f32 / FRAMES as f32, styles.len());
        let both = [(from, 1.0 - share), (to, share)];
        let both = both.map(|(i, weight)| (styles[i].inspiration.clone(), weight));
        let look = StyleEmbedding::mix(&both)
            .and_then(|inspiration| model.appearance(&inspiration))
            .ok_or(CliError::Unstyled)?;
        film.add(model.render(camera, &[&look]).image(0))?;
        progress.tick();
    }
    film.finish()
}

/// At `time` in `[0, 1)` of a round through `count` styles: the style left, the style ahead and
/// how far the way between them is done.
fn passage(time: f32, count: usize) -> (usize, usize, f32) {
    let place = time * count as f32;
    let from = (place as usize).min(count.saturating_sub(1));
    let share = ((place.fract() - HOLD) / (1.0 - HOLD)).max(0.0);
    (from, (from + 1) % count.max(1), share)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_style_holds_then_turns_into_the_next() {
        assert_eq!(passage(0.0, 3), (0, 1, 0.0));
        assert_eq!(passage(0.5 / 3.0, 3), (0, 1, 0.0));
        let (from, to, share) = passage(2.75 / 3.0, 3);
        assert_eq!((from, to), (2, 0));
        assert!((share - 0.5).abs() < 1e-5);
    }
}
