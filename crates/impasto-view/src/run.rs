//! A training that goes on while the studio is open, as its log tells it.

use std::collections::VecDeque;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime};

use serde_json::{Value, json};

/// Points of the curve of losses; beyond, every other one is left out.
const POINTS: usize = 600;
/// A log without an end that is older than this belongs to a run that was killed.
const ALIVE: Duration = Duration::from_secs(60);
/// Most that is read of a log at a time, in bytes.
const AT_A_TIME: u64 = 4 << 20;
/// Longest line of a log.
const LINE: usize = 1 << 16;

/// What is known of a run.
#[derive(Debug, Default)]
pub(crate) struct TrainingRun {
    /// Whether it goes on.
    is_training: bool,
    stage: Option<String>,
    step: u64,
    progress: f64,
    loss: Option<f64>,
    psnr: Option<f64>,
    preview: Option<PathBuf>,
    previews: u64,
    losses: VecDeque<(f64, f64)>,
    /// Only every so-manieth loss is kept.
    stride: u64,
    seen: u64,
    is_over: bool,
}

impl TrainingRun {
    /// The answer of `GET /api/run`.
    pub(crate) fn json(&self) -> Value {
        if !self.is_training {
            return json!({"training": false});
        }
        let losses: Vec<_> = self
            .losses
            .iter()
            .map(|(t, loss)| json!([t, loss]))
            .collect();
        let preview = self.preview.as_ref();
        json!({
            "training": true,
            "stage": self.stage,
            "step": self.step,
            "progress": self.progress,
            "loss": self.loss,
            "psnr": self.psnr,
            "preview": preview.map(|_| format!("/api/preview?number={}", self.previews)),
            "losses": losses,
        })
    }

    /// File of the newest preview.
    pub(crate) fn preview(&self) -> Option<&Path> {
        self.preview.as_deref()
    }

    fn apply(&mut self, event: &Value, folder: &Path) {
        let number = |key: &str| event[key].as_f64();
        match event["event"].as_str() {
            Some("loaded") => *self = Self::default(),
            Some("stage_started") => {
                self.stage = event["stage"].as_str().map(str::to_owned);
                (self.step, self.progress) = (0, 0.0);
                self.losses.clear();
                (self.stride, self.seen) = (1, 0);
                self.is_over = false;
            }
            Some("step") => {
                self.is_over = false;
                self.stage = event["stage"].as_str().map(str::to_owned);
                self.step = event["step"].as_u64().unwrap_or(self.step);
                self.progress = number("progress").unwrap_or(self.progress);
                self.loss = number("loss");
                let time = number("seconds_since_start");
                if let Some(point) = time.zip(self.loss) {
                    self.add(point);
                }
            }
            Some("validation") => self.psnr = number("psnr"),
            Some("preview") => {
                let path = event["path"].as_str().map(PathBuf::from);
                let name = path.as_ref().and_then(|path| path.file_name());
                // Only what lies where previews lie is shown, whatever the log says.
                let path = name.map(|name| folder.join("previews").join(name));
                self.preview = path.filter(|path| path.is_file());
                self.previews += 1;
            }
            Some("done") => self.is_over = true,
            _ => {}
        }
    }

    fn add(&mut self, point: (f64, f64)) {
        self.stride = self.stride.max(1);
        self.seen += 1;
        if !self.seen.is_multiple_of(self.stride) {
            return;
        }
        self.losses.push_back(point);
        if self.losses.len() > POINTS {
            let halved = self.losses.iter().copied().step_by(2);
            self.losses = halved.collect();
            self.stride *= 2;
        }
    }
}

/// Follows the log of a model's folder.
pub(crate) struct LogTail {
    folder: PathBuf,
    offset: u64,
    torn: Vec<u8>,
}

impl LogTail {
    pub(crate) fn new(folder: PathBuf) -> Self {
        Self {
            folder,
            offset: 0,
            torn: Vec::new(),
        }
    }

    /// Reads what is new; whether the run has changed.
    pub(crate) fn follow(&mut self, run: &mut TrainingRun) -> bool {
        let before = run.is_training;
        let (heard, is_training) = self.read(run);
        run.is_training = is_training;
        heard || before != is_training
    }

    /// Whether anything is new, and whether a training goes on.
    fn read(&mut self, run: &mut TrainingRun) -> (bool, bool) {
        let path = self.folder.join("log.jsonl");
        let Ok(facts) = std::fs::metadata(&path) else {
            return (false, false);
        };
        let age = facts
            .modified()
            .ok()
            .and_then(|time| SystemTime::now().duration_since(time).ok());
        let alive = age.is_none_or(|age| age < ALIVE);
        if facts.len() < self.offset {
            // Another run began anew.
            *run = TrainingRun::default();
            self.offset = 0;
            self.torn.clear();
        }
        let heard = facts.len() > self.offset && self.read_on(&path, run).is_some();
        (heard, alive && !run.is_over && run.stage.is_some())
    }

    fn read_on(&mut self, path: &Path, run: &mut TrainingRun) -> Option<()> {
        let mut file = File::open(path).ok()?;
        file.seek(SeekFrom::Start(self.offset)).ok()?;
        let read = file.take(AT_A_TIME).read_to_end(&mut self.torn).ok()?;
        self.offset += read as u64;
        let whole = self.torn.iter().rposition(|byte| *byte == b'\n');
        let rest = self.torn.split_off(whole.map_or(0, |end| end + 1));
        let lines = std::mem::replace(&mut self.torn, rest);
        if self.torn.len() > LINE {
            self.torn.clear();
        }
        for line in lines.split(|byte| *byte == b'\n') {
            if let Ok(event) = serde_json::from_slice::<Value>(line) {
                run.apply(&event, &self.folder);
            }
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may panic")]

    use super::*;
    use std::io::Write;

    #[test]
    fn a_log_is_followed_line_by_line() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("log.jsonl");
        let mut tail = LogTail::new(dir.path().to_owned());
        let mut run = TrainingRun::default();
        assert_eq!(tail.read(&mut run), (false, false));
        let mut log = File::create(&path).unwrap();
        let answer = |run: &mut TrainingRun| {
            run.is_training = true;
            run.json()
        };
        let mut say = |text: &str| log.write_all(text.as_bytes()).unwrap();
        say("{\"event\":\"stage_started\",\"stage\":\"geometry\"}\nnonsense\n{\"event\":\"step\",");
        assert_eq!(tail.read(&mut run), (true, true));
        assert_eq!(answer(&mut run)["step"], 0);
        say("\"stage\":\"geometry\",\"step\":7,\"progress\":0.5,\"loss\":0.25,");
        say("\"seconds_since_start\":3.5}\n{\"event\":\"validation\",\"psnr\":21.5}\n");
        assert_eq!(tail.read(&mut run), (true, true));
        let said = answer(&mut run);
        assert_eq!((&said["step"], &said["psnr"]), (&7.into(), &21.5.into()));
        assert_eq!(said["losses"], json!([[3.5, 0.25]]));
        assert_eq!(tail.read(&mut run), (false, true));
        say("{\"event\":\"done\",\"seconds\":9}\n");
        assert_eq!(tail.read(&mut run), (true, false));
    }

    #[test]
    fn previews_come_from_their_folder_only() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::create_dir(dir.path().join("previews")).unwrap();
        std::fs::write(dir.path().join("previews/1.png"), "").unwrap();
        std::fs::write(dir.path().join("secret.png"), "").unwrap();
        let mut run = TrainingRun::default();
        for (path, shown) in [
            ("x/previews/1.png", true),
            ("../secret.png", false),
            ("..", false),
        ] {
            run.apply(&json!({"event": "preview", "path": path}), dir.path());
            assert_eq!(run.preview().is_some(), shown, "{path}");
        }
    }

    #[test]
    fn curves_stay_short() {
        let mut run = TrainingRun::default();
        for i in 0..100_000 {
            run.add((f64::from(i), 1.0));
        }
        assert!((POINTS / 2..=POINTS).contains(&run.losses.len()));
        let last = run.losses.back().unwrap().0;
        assert!(last > 99_000.0, "{last}");
    }
}
