//! Progress on stderr: a bar where a person watches, a line now and then where a log is kept.

use std::io::{IsTerminal, stderr};
use std::time::{Duration, Instant};

use impasto::prepare::{Phase, PrepareEvent};
use impasto::{Event, Stage};
use indicatif::{ProgressBar, ProgressStyle};

use super::console::note;
use super::values::clock;

/// Least time between two lines of progress in a log.
const QUIET: Duration = Duration::from_secs(10);
/// Ticks of a full bar.
const FULL: u64 = 1000;

/// A bar, or its lines.
pub struct Bar {
    title: String,
    drawn: Option<ProgressBar>,
    spoke: Option<Instant>,
}

impl Bar {
    /// Begins.
    pub fn new(title: &str) -> Self {
        let drawn = stderr().is_terminal().then(|| {
            let bar = ProgressBar::new(FULL).with_prefix(title.to_owned());
            // A mistake in the template costs its looks, not the run.
            let style = ProgressStyle::with_template("{prefix:>8} {bar:24} {percent:>3} %  {msg}")
                .unwrap_or_else(|_| ProgressStyle::default_bar());
            bar.set_style(style);
            bar
        });
        Self {
            title: title.to_owned(),
            drawn,
            spoke: None,
        }
    }

    /// Shows the part that is done, from 0 to 1, and more about it.
    pub fn show(&mut self, progress: f64, message: String) {
        if let Some(bar) = &self.drawn {
            bar.set_position((progress * FULL as f64) as u64);
            bar.set_message(message);
        } else if self.spoke.is_none_or(|at| at.elapsed() >= QUIET) {
            self.spoke = Some(Instant::now());
            note(format_args!(
                "{:>8} {:>3.0} %  {message}",
                self.title,
                100.0 * progress
            ));
        }
    }

    /// A line that stays above the bar.
    fn say(&self, text: &str) {
        match &self.drawn {
            Some(bar) => bar.suspend(|| note(text)),
            None => note(text),
        }
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        if let Some(bar) = &self.drawn {
            bar.finish_and_clear();
        }
    }
}

/// Shows training by its events alone.
#[derive(Default)]
pub struct TrainingProgress {
    bar: Option<Bar>,
    /// Statistics are being measured, or an encoder is being trained.
    preparation: Option<Bar>,
    psnr: Option<f64>,
}

impl TrainingProgress {
    /// Shows one event.
    pub fn show(&mut self, event: &Event) {
        match event {
            Event::StageStarted { stage, .. } => {
                self.bar = Some(Bar::new(match stage {
                    Stage::Geometry => "geometry",
                    Stage::Style => "style",
                }));
            }
            Event::Measured {
                pictures,
                fresh,
                planned,
            } => {
                let message = format!("{pictures} pictures, {fresh} of them looked at now");
                self.prepare("styles", *pictures, *planned, message);
            }
            Event::EncoderStep { step, steps, error } => {
                let message = format!("step {step}  error {error:.4}");
                self.prepare("encoder", *step as usize, *steps as usize, message);
            }
            Event::Step {
                progress,
                loss,
                rate,
                rays_per_second,
                eta,
                ..
            } => {
                self.preparation = None;
                let message = self.measures(*loss, *rate, *rays_per_second, *eta);
                if let Some(bar) = &mut self.bar {
                    bar.show(*progress, message);
                }
            }
            Event::Validation { psnr, .. } => {
                self.psnr = Some(*psnr);
                self.say(event);
            }
            Event::Done { .. } => {
                self.bar = None;
                self.preparation = None;
                self.say(event);
            }
            _ => self.say(event),
        }
    }

    fn prepare(&mut self, title: &str, done: usize, planned: usize, message: String) {
        let bar = self.preparation.take().filter(|bar| bar.title == title);
        let bar = self
            .preparation
            .insert(bar.unwrap_or_else(|| Bar::new(title)));
        bar.show(done as f64 / planned.max(1) as f64, message);
    }

    fn measures(&self, loss: f64, rate: f64, rays_per_second: f64, eta: f64) -> String {
        let psnr = self.psnr;
        let psnr = psnr.map_or_else(String::new, |psnr| format!("  PSNR {psnr:.2} dB"));
        let rays = rays_per_second / 1e3;
        format!(
            "{rate:.1} it/s  {rays:.0}k rays/s  loss {loss:.4}{psnr}  ETA {}",
            clock(eta)
        )
    }

    fn say(&self, event: &Event) {
        if let Some(sentence) = sentence(event) {
            say(self.preparation.as_ref().or(self.bar.as_ref()), &sentence);
        }
    }
}

/// A line, above the bar if there is one.
fn say(bar: Option<&Bar>, text: &str) {
    match bar {
        Some(bar) => bar.say(text),
        None => note(text),
    }
}

/// An event in words, where it deserves some.
fn sentence(event: &Event) -> Option<String> {
    Some(match event {
        Event::Loaded {
            train_photos,
            test_photos,
            size,
            paintings,
            synthetic,
        } => {
            let kind = if *synthetic {
                "synthetic photos"
            } else {
                "photos"
            };
            format!(
                "{train_photos} {kind} of {}×{} to learn from, {test_photos} held out; {paintings} paintings",
                size[0], size[1]
            )
        }
        Event::Validation {
            step,
            psnr,
            ssim,
            views,
        } => {
            format!("step {step}: PSNR {psnr:.2} dB, SSIM {ssim:.3} on {views} held-out views")
        }
        Event::Resumed {
            stage,
            step,
            seconds,
        } => format!(
            "resumed at step {step} of the {stage} stage, {} into the run",
            clock(*seconds)
        ),
        Event::Warning { message } => format!("warning: {message}"),
        Event::Done { seconds } => format!("trained in {}", clock(*seconds)),
        _ => return None,
    })
}

/// Shows what share of something is done, and how long the rest takes.
pub struct TimedBar {
    bar: Bar,
    start: Instant,
}

impl TimedBar {
    /// Begins.
    pub fn new(title: &str) -> Self {
        Self {
            bar: Bar::new(title),
            start: Instant::now(),
        }
    }

    /// Shows that this much is done, and more about it.
    pub fn show(&mut self, progress: f64, measures: &str) {
        // Infinite at first, which reads as unknown.
        let left = self.start.elapsed().as_secs_f64() * (1.0 / progress - 1.0);
        let message = format!("{measures}  ETA {}", clock(left));
        self.bar.show(progress, message);
    }

    /// Shows that so many of a known number of steps are done, with a measure or two.
    pub fn show_step(&mut self, done: u64, steps: u64, measures: &str) {
        let progress = done as f64 / steps.max(1) as f64;
        self.show(progress, &format!("step {done}  {measures}"));
    }
}

/// Shows how captures are made.
#[derive(Default)]
pub struct PrepareProgress {
    shown: Option<(Phase, TimedBar)>,
}

impl PrepareProgress {
    /// Shows one event.
    pub fn show(&mut self, event: &PrepareEvent) {
        match event {
            PrepareEvent::Progress { phase, done, total } => {
                let shown = self.shown.take().filter(|(shown, _)| shown == phase);
                let new = || (*phase, TimedBar::new(phase.name()));
                let (_, bar) = self.shown.insert(shown.unwrap_or_else(new));
                let progress = *done as f64 / *total as f64;
                bar.show(progress, &format!("{done} of {total}"));
            }
            PrepareEvent::Note { message } => self.say(message),
            PrepareEvent::Warning { message } => self.say(&format!("warning: {message}")),
        }
    }

    fn say(&self, text: &str) {
        say(self.shown.as_ref().map(|(_, timed)| &timed.bar), text);
    }
}

/// Shows how many of a known number of frames are done.
pub struct FrameProgress {
    timed: TimedBar,
    done: usize,
    count: usize,
}

impl FrameProgress {
    /// Begins.
    pub fn new(title: &str, count: usize) -> Self {
        Self {
            timed: TimedBar::new(title),
            done: 0,
            count,
        }
    }

    /// One more is done.
    pub fn tick(&mut self) {
        self.done += 1;
        // No more than all: what was planned may be less than what is made.
        let progress = (self.done as f64 / self.count as f64).min(1.0);
        let measures = format!("{} of {} frames", self.done, self.count);
        self.timed.show(progress, &measures);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_tells_speed_loss_quality_and_time_left() {
        let training = TrainingProgress {
            psnr: Some(24.318),
            ..TrainingProgress::default()
        };
        assert_eq!(
            training.measures(0.012_34, 12.34, 45_600.0, 75.0),
            "12.3 it/s  46k rays/s  loss 0.0123  PSNR 24.32 dB  ETA 1:15"
        );
    }

    #[test]
    fn a_synthetic_scene_is_called_so() {
        let loaded = Event::Loaded {
            train_photos: 35,
            test_photos: 5,
            size: [384, 288],
            paintings: 200,
            synthetic: true,
        };
        assert!(sentence(&loaded).is_some_and(|text| text.contains("synthetic")));
    }
}
