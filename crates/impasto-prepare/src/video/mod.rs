//! Frames of a video.

pub(crate) mod endings;
mod facts;
mod sharpness;

use std::ffi::OsString;
use std::fs;
use std::path::{Path, PathBuf};

use crate::batches::in_batches;
use crate::child::Program;
use crate::error::PrepareError;
use crate::event::{Phase, Sink, progress, warning};
use crate::listing::paths_in;
use crate::log::CommandLog;
use crate::photos::PhotoSource;
use crate::summary::VideoFrames;
use facts::Facts;

/// Frames taken out for each that is chosen.
const CANDIDATES: usize = 4;
/// Frames per second of a video that does not tell its length.
const BLIND_RATE: f64 = 2.0;

/// An installed ffmpeg.
pub(crate) struct Ffmpeg<'a>(Program<'a>);

impl<'a> Ffmpeg<'a> {
    /// Makes sure that it is there.
    pub(crate) fn new(path: &'a Path, log: &mut CommandLog) -> Result<Self, PrepareError> {
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
        log: &mut CommandLog,
        events: Sink<'_>,
    ) -> Result<Vec<PathBuf>, PrepareError> {
        fs::create_dir_all(to).map_err(PrepareError::write(to))?;
        let mut arguments = reading(video, &["-loglevel", "warning"]);
        let rate = match facts.seconds {
            Some(seconds) => (most as f64 / seconds).min(facts.rate),
            None => BLIND_RATE.min(facts.rate),
        };
        let (filter, most_frames) = (format!("fps={rate:.6}"), most.to_string());
        let streams = [
            "-an",
            "-sn",
            "-dn",
            "-vf",
            &filter,
            "-frames:v",
            &most_frames,
        ];
        // JPEGs of the highest useful quality.
        let files = ["-q:v", "2", "-nostats", "-progress", "pipe:1"];
        arguments.extend(streams.iter().chain(&files).map(OsString::from));
        arguments.push(to.join("%06d.jpg").into());
        let expected = |seconds: f64| (seconds * rate).ceil() as usize;
        let expected = facts.seconds.map_or(most, expected);
        progress(events, Phase::Frames, 0, expected);
        let run = self.0.run(&arguments, log, &mut |line| {
            let frames = line.strip_prefix("frame=");
            if let Some(done) = frames.and_then(|n| n.trim().parse().ok()) {
                progress(events, Phase::Frames, done, expected);
            }
        })?;
        if run.was_killed() {
            run.succeeded("ffmpeg", log)?;
        } else if !run.is_success() {
            return Err(unusable(video, run.said, log));
        }
        paths_in(to)
    }

    fn facts(&self, video: &Path, log: &mut CommandLog) -> Result<Facts, PrepareError> {
        let mut facts = Facts::default();
        // What is to be read are notes, which no log level hides.
        let arguments = reading(video, &[]);
        // ffmpeg fails here, because it is told no output.
        let run = self.0.run(&arguments, log, &mut |line| facts.read(line))?;
        if facts.has_pictures {
            Ok(facts)
        } else {
            Err(unusable(video, run.said, log))
        }
    }
}

/// The beginning of a command line that reads a video. Nothing but files is opened, whatever the
/// video refers to.
fn reading(video: &Path, options: &[&str]) -> Vec<OsString> {
    let mut words: Vec<OsString> = ["-hide_banner", "-nostdin"].map(OsString::from).into();
    words.extend(options.iter().map(OsString::from));
    words.extend(["-protocol_whitelist", "file", "-i"].map(OsString::from));
    let mut file = OsString::from("file:");
    file.push(video);
    words.push(file);
    words
}

fn unusable(video: &Path, said: String, log: &CommandLog) -> PrepareError {
    PrepareError::Video {
        path: video.to_owned(),
        problem: Some(said)
            .filter(|said| !said.is_empty())
            .unwrap_or("it has no pictures".into()),
        log: log.destination(),
    }
}

/// Chooses `wanted` frames of the video: of as many equal parts of its time, the sharpest each.
/// The frames lie in the folder `to`.
pub(crate) fn frames(
    ffmpeg: &Ffmpeg<'_>,
    video: &Path,
    wanted: usize,
    to: &Path,
    log: &mut CommandLog,
    events: Sink<'_>,
) -> Result<(Vec<PhotoSource>, VideoFrames), PrepareError> {
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
    let source = |(number, &index): (usize, &usize)| PhotoSource {
        name: format!("{number:04}.jpg"),
        path: candidates[index].clone(),
    };
    let summary = VideoFrames {
        extracted: candidates.len(),
        chosen: chosen.len(),
        seconds: facts.seconds,
    };
    Ok((chosen.iter().enumerate().map(source).collect(), summary))
}

fn measure(candidates: &[PathBuf], events: Sink<'_>) -> Result<Vec<f64>, PrepareError> {
    let total = candidates.len();
    progress(events, Phase::Choosing, 0, total);
    let mut tick = |done| progress(events, Phase::Choosing, done, total);
    in_batches(candidates, &mut tick, |path| {
        // A frame that cannot be read is chosen last, and then left out by name.
        Ok(impasto_scene::read_rgb(path).map_or(-1.0, |p| sharpness::of(&p)))
    })
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
}
