//! What ffmpeg says of a video.

/// A video's length and speed.
#[derive(Debug, PartialEq)]
pub(super) struct Facts {
    /// Length, where the file tells it.
    pub(super) seconds: Option<f64>,
    /// Frames per second.
    pub(super) rate: f64,
    /// Whether there is anything to see.
    pub(super) has_pictures: bool,
}

impl Default for Facts {
    fn default() -> Self {
        Self {
            seconds: None,
            // What most videos have, for those that do not tell.
            rate: 25.0,
            has_pictures: false,
        }
    }
}

impl Facts {
    /// Takes from a line of ffmpeg's what it tells.
    pub(super) fn read(&mut self, line: &str) {
        if let Some((_, rest)) = line.split_once("Duration: ") {
            self.seconds = self.seconds.or_else(|| clock(rest.split(',').next()?));
        }
        // The first stream of pictures is the one that ffmpeg takes, covers of albums aside.
        if line.contains("Video: ") && !line.contains("attached pic") && !self.has_pictures {
            self.has_pictures = true;
            let rate = line
                .split(", ")
                .find_map(|part| part.split_once(" fps")?.0.parse::<f64>().ok());
            self.rate = rate.filter(|r| *r > 0.0).unwrap_or(self.rate);
        }
    }
}

/// Seconds of `01:02:03.45`, if there are any.
fn clock(text: &str) -> Option<f64> {
    let seconds = text.trim().split(':').try_fold(0.0, |sum, part| {
        Some(60.0 * sum + part.parse::<f64>().ok()?)
    })?;
    (seconds > 0.0).then_some(seconds)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn length_and_speed_are_read() {
        let mut facts = Facts::default();
        for line in [
            "Input #0, mov,mp4,m4a,3gp,3g2,mj2, from 'a.mp4':",
            "Duration: 00:01:02.50, start: 0.000000, bitrate: 1205 kb/s",
            "Stream #0:0[0x1](und): Video: h264 (High), yuv420p(progressive), 1920x1080, 17 kb/s, \
             29.97 fps, 29.97 tbr, 30k tbn (default)",
            "Stream #0:1: Audio: aac (LC), 48000 Hz, stereo",
        ] {
            facts.read(line);
        }
        let expected = Facts {
            seconds: Some(62.5),
            rate: 29.97,
            has_pictures: true,
        };
        assert_eq!(facts, expected);
    }

    #[test]
    fn what_is_not_told_is_not_guessed() {
        let mut facts = Facts::default();
        facts.read("Duration: N/A, start: 0.000000, bitrate: N/A");
        facts.read("Stream #0:0: Video: mjpeg, 600x600, 90k tbr (attached pic)");
        assert_eq!(facts, Facts::default());
    }
}
