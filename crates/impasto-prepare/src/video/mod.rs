//! Frames of a video.

mod facts;
mod sharpness;

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

use rayon::prelude::*;

use crate::child::Program;
use crate::error::PrepareError;
use crate::event::{Phase, Sink, progress, warning};
use crate::log::Log;
use crate::photos::Source;
use crate::summary::VideoFrames;
use facts::Facts;

/// Endings of videos.
pub(crate) const ENDINGS: [&str; 6] = ["mp4", "mov", "mkv", "avi", "webm", "m4v"];
/// Frames taken out for each that is chosen.
const CANDIDATES: usize = 4;
/// Frames per second of a video that does not tell its length.
const BLIND_RATE: f64 = 2.0;

/// Whether this is a video, by its ending.
pub(crate) fn is_video(path: &Path) -> bool {
    path.extension()
        .is_some_and(|e| ENDINGS.iter().any(|known| e.eq_ignore_ascii_case(known)))
}

/// An installed ffmpeg.
pub(crate) struct Ffmpeg<'a>(Program<'a>);

impl<'a> Ffmpeg<'a> {
    /// Makes sure that it is there.
    pub(crate) fn new(path: &'a Path, log: &mut Log) -> Result<Self, PrepareError> {
        let program = Program {
            name: "ffmpeg",
            path,
            package: "ffmpeg",
            variable: "IMPASTO_FFMPEG",
        };
        program.succeed(&["-version".into()], log, &mut |_| ())?;
        Ok(Self(program))
    }

    /// Takes frames of the video to the folder `to`, evenly in time, and tells them in order.
    fn extract(
        &self,
        video: &Path,
        facts: &Facts,
        most: usize,
        to: &Path,
        log: &mut Log,
        events: Sink<'_>,
    ) -> Result<Vec<PathBuf>, PrepareError> {
        fs::create_dir_all(to).map_err(PrepareError::write(to))?;
        let mut arguments = quiet(video);
        let rate = match facts.seconds {
            Some(seconds) => (most as f64 / seconds).min(facts.rate),
            None => BLIND_RATE.min(facts.rate),
        };
        arguments.extend(["-an", "-sn", "-dn", "-vf"].map(OsString::from));
        arguments.push(format!("fps={rate:.6}").into());
        arguments.push("-frames:v".into());
        arguments.push(most.to_string().into());
        // JPEGs of the highest useful quality.
        arguments.extend(["-q:v", "2", "-nostats", "-progress", "pipe:1"].map(OsString::from));
        arguments.push(to.join("%06d.jpg").into());
        let expected = facts
            .seconds
            .map_or(most, |seconds| (seconds * rate).ceil() as usize);
        progress(events, Phase::Frames, 0, expected);
        let run = self.0.run(&arguments, log, &mut |line| {
            if let Some(done) = line
                .strip_prefix("frame=")
                .and_then(|n| n.trim().parse().ok())
            {
                progress(events, Phase::Frames, done, expected);
            }
        })?;
        if run.was_killed() {
            run.succeeded("ffmpeg", log)?;
        } else if !run.is_success() {
            return Err(unusable(video, run.said, log));
        }
        let mut frames = Vec::new();
        for entry in fs::read_dir(to).map_err(PrepareError::read(to))? {
            frames.push(entry.map_err(PrepareError::read(to))?.path());
        }
        frames.sort();
        Ok(frames)
    }

    fn facts(&self, video: &Path, log: &mut Log) -> Result<Facts, PrepareError> {
        let mut facts = Facts::default();
        let arguments: Vec<OsString> = quiet(video)
            .into_iter()
            // What is to be read are notes.
            .filter(|word| word != "-loglevel" && word != "warning")
            .collect();
        // ffmpeg fails here, because it is told no output.
        let run = self.0.run(&arguments, log, &mut |line| facts.read(line))?;
        if facts.has_pictures {
            Ok(facts)
        } else {
            Err(unusable(video, run.said, log))
        }
    }
}

/// The beginning of a command line. Nothing but files is opened, whatever a video refers to.
fn quiet(video: &Path) -> Vec<OsString> {
    let words = ["-hide_banner", "-nostdin", "-loglevel", "warning"];
    let mut words: Vec<OsString> = words.map(OsString::from).into();
    words.extend(["-protocol_whitelist", "file", "-i"].map(OsString::from));
    let mut file = OsString::from("file:");
    file.push(video);
    words.push(file);
    words
}

fn unusable(video: &Path, said: String, log: &Log) -> PrepareError {
    PrepareError::Video {
        path: video.to_owned(),
        problem: if said.is_empty() {
            "it has no pictures".into()
        } else {
            said
        },
        log: log.destination().to_owned(),
    }
}

/// Chooses `wanted` frames of the video: of as many equal parts of its time, the sharpest each.
/// The frames lie in the folder `to`.
pub(crate) fn frames(
    ffmpeg: &Ffmpeg<'_>,
    video: &Path,
    wanted: usize,
    to: &Path,
    log: &mut Log,
    events: Sink<'_>,
) -> Result<(Vec<Source>, VideoFrames), PrepareError> {
    let facts = ffmpeg.facts(video, log)?;
    let most = CANDIDATES * wanted;
    let candidates = ffmpeg.extract(video, &facts, most, to, log, events)?;
    if facts.seconds.is_none() && candidates.len() == most {
        let seconds = most as f64 / BLIND_RATE;
        let message = format!(
            "{} does not tell its length: only its first {seconds:.0} s are used",
            video.display()
        );
        warning(events, message);
    }
    let sharpness = measure(&candidates, events)?;
    let chosen = sharpest(&sharpness, wanted);
    let sources: Vec<Source> = chosen
        .iter()
        .enumerate()
        .map(|(number, &index)| Source {
            name: format!("{number:04}.jpg"),
            path: candidates[index].clone(),
        })
        .collect();
    let told = VideoFrames {
        extracted: candidates.len(),
        chosen: sources.len(),
        seconds: facts.seconds,
    };
    Ok((sources, told))
}

fn measure(candidates: &[PathBuf], events: Sink<'_>) -> Result<Vec<f64>, PrepareError> {
    let mut sharpness = Vec::with_capacity(candidates.len());
    progress(events, Phase::Choosing, 0, candidates.len());
    for batch in candidates.chunks(rayon::current_num_threads().max(1)) {
        let measured: Vec<f64> = batch
            .par_iter()
            // A frame that cannot be read is chosen last, and then left out by name.
            .map(|path| impasto_scene::read_rgb(path).map_or(-1.0, |p| sharpness::of(&p)))
            .collect();
        sharpness.extend(measured);
        progress(events, Phase::Choosing, sharpness.len(), candidates.len());
    }
    Ok(sharpness)
}

/// Index of the sharpest in each of `parts` equal parts; parts without any give none.
fn sharpest(sharpness: &[f64], parts: usize) -> Vec<usize> {
    let end = |part: usize| part * sharpness.len() / parts;
    (0..parts)
        .filter_map(|part| {
            (end(part)..end(part + 1)).max_by(|&a, &b| {
                // The earlier one of two equals.
                sharpness[a].total_cmp(&sharpness[b]).then(b.cmp(&a))
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_part_gives_its_sharpest() {
        assert_eq!(sharpest(&[1.0, 3.0, 2.0, 0.5, 0.5, 0.1], 3), [1, 2, 4]);
        assert_eq!(sharpest(&[0.5, 0.5], 1), [0]);
        assert_eq!(sharpest(&[1.0, 2.0], 5).len(), 2);
        assert!(sharpest(&[], 4).is_empty());
    }

    #[test]
    fn endings_tell_videos() {
        assert!(is_video(Path::new("a/Walk.MP4")) && is_video(Path::new("a.webm")));
        assert!(!is_video(Path::new("a.jpg")) && !is_video(Path::new("mp4")));
    }
}
