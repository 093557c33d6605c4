//! Which files are videos.

use std::path::Path;

/// Endings of videos.
pub(crate) const ENDINGS: [&str; 6] = ["mp4", "mov", "mkv", "avi", "webm", "m4v"];

/// Whether this is a video, by its ending.
pub(crate) fn is_video(path: &Path) -> bool {
    path.extension()
        .is_some_and(|e| ENDINGS.iter().any(|known| e.eq_ignore_ascii_case(known)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn endings_tell_videos() {
        assert!(is_video(Path::new("a/Walk.MP4")) && is_video(Path::new("a.webm")));
        assert!(!is_video(Path::new("a.jpg")) && !is_video(Path::new("mp4")));
    }
}
