//! An interrupted run goes on as if nothing had been.
#![allow(clippy::unwrap_used, reason = "a failure here is a failed test")]

mod common;

use common::{run, small};
use impasto_field::{EncodingConfig, HierarchicalConfig, SamplingConfig, Shading, VolumeConfig};
use impasto_kernels::Density;
use impasto_model::{Budget, CHECKPOINT_FILE, MODEL_FILE, Stages, Stop, TrainConfig};
use impasto_train::{Event, Recovery, TrainError, TrainOptions, TrainSummary, Unfinished, train};
use std::fs;
use std::path::Path;
use std::time::Duration;

/// A run that keeps a checkpoint after each step.
fn careful(dir: &Path, config: TrainConfig) -> TrainOptions {
    TrainOptions {
        config,
        // Or the paintings would be measured after each interruption.
        cache: Some(dir.join("cache")),
        recovery: Recovery {
            every: Duration::ZERO,
            ..Recovery::default()
        },
        ..run(dir)
    }
}

fn resumed(options: &TrainOptions) -> TrainOptions {
    TrainOptions {
        recovery: Recovery {
            unfinished: Unfinished::Resume,
            stop: Stop::default(),
            ..options.recovery
        },
        ..options.clone()
    }
}

/// Ends the run once it has written so many checkpoints.
fn stopped_after(options: &TrainOptions, checkpoints: usize) -> Result<TrainSummary, TrainError> {
    let mut written = 0;
    train(options, &mut |event| {
        if matches!(event, Event::Checkpoint { path } if path.ends_with(CHECKPOINT_FILE)) {
            written += 1;
            if written == checkpoints {
                options.recovery.stop.request();
            }
        }
    })
}

fn model(options: &TrainOptions) -> Vec<u8> {
    fs::read(options.output.join(MODEL_FILE)).unwrap()
}

/// The parts of the paper's system that the fast preset has not.
fn like_the_papers() -> TrainConfig {
    let mut config = small();
    for volume in [&mut config.field.inner, &mut config.field.outer] {
        *volume = VolumeConfig {
            encoding: EncodingConfig::Frequency { bands: 4 },
            base: vec![24; 5],
            geo: vec![16],
            density: Density::Abs,
        };
    }
    config.field.latent = Some(8);
    config.field.sampling = SamplingConfig::Hierarchical(HierarchicalConfig {
        first: 6,
        more: 8,
        near: 0.05,
    });
    config.style.shading = Shading::Samples;
    config.style.hyper_width = 16;
    config
}

#[test]
fn a_run_stopped_after_each_step_makes_the_same_model() {
    for mut config in [small(), like_the_papers()] {
        // Patches are replaced and the grids looked at between interruptions.
        config.style.pool = 2;
        config.style.patch_uses = 2;
        config.geometry.grid_every = 3;
        let dir = tempfile::tempdir().unwrap();
        let options = TrainOptions {
            budget: Budget::Steps(13),
            ..careful(dir.path(), config)
        };
        let whole = train(&options, &mut |_| ()).unwrap();
        let wanted = model(&options);
        fs::remove_dir_all(&options.output).unwrap();

        let mut interruptions = 0;
        let end = loop {
            match stopped_after(&resumed(&options), 1) {
                Ok(summary) => break summary,
                Err(TrainError::Stopped { .. }) => interruptions += 1,
                Err(other) => panic!("{other}"),
            }
        };
        assert!(interruptions >= 11, "{interruptions}");
        assert!(model(&options) == wanted, "another model");
        assert_eq!(
            (
                end.quality.psnr,
                end.geometry_steps,
                end.style_steps,
                end.paintings
            ),
            (
                whole.quality.psnr,
                whole.geometry_steps,
                whole.style_steps,
                whole.paintings
            )
        );
        assert!(!options.output.join(CHECKPOINT_FILE).exists());
    }
}

#[test]
fn a_finished_run_is_not_repeated() {
    let dir = tempfile::tempdir().unwrap();
    let options = careful(dir.path(), small());
    let first = train(&options, &mut |_| ()).unwrap();
    let wanted = model(&options);
    let mut events = 0;
    let again = train(&resumed(&options), &mut |_| events += 1).unwrap();
    assert!(again.finished_before && !first.finished_before);
    assert_eq!(
        (events, again.quality.psnr, again.style_steps),
        (0, first.quality.psnr, first.style_steps)
    );
    assert!(model(&options) == wanted);

    let other = TrainOptions {
        seed: 7,
        ..resumed(&options)
    };
    let error = train(&other, &mut |_| ()).unwrap_err().to_string();
    assert!(error.contains("has --seed 1, not 7"), "{error}");
    assert!(model(&options) == wanted);

    // A longer run is another model; without a checkpoint it begins anew.
    let longer = TrainOptions {
        budget: Budget::Steps(12),
        ..resumed(&options)
    };
    let summary = train(&longer, &mut |_| ()).unwrap();
    assert_eq!(summary.geometry_steps + summary.style_steps, 12);
}

#[test]
fn the_style_stage_alone_goes_on_too() {
    let dir = tempfile::tempdir().unwrap();
    let geometry = TrainOptions {
        stages: Stages::Geometry,
        ..careful(dir.path(), small())
    };
    train(&geometry, &mut |_| ()).unwrap();
    let base = model(&geometry);
    let style = TrainOptions {
        stages: Stages::Style,
        ..geometry.clone()
    };
    train(&style, &mut |_| ()).unwrap();
    let wanted = model(&style);
    fs::write(style.output.join(MODEL_FILE), base).unwrap();
    let stopped = stopped_after(&style, 4).unwrap_err();
    assert!(matches!(stopped, TrainError::Stopped { steps: 4, .. }));
    train(&resumed(&style), &mut |_| ()).unwrap();
    assert!(model(&style) == wanted);
}

#[test]
fn an_unfinished_run_is_not_lost_by_mistake() {
    let dir = tempfile::tempdir().unwrap();
    let options = careful(dir.path(), small());
    stopped_after(&options, 1).unwrap_err();
    let fresh = careful(dir.path(), small());
    let refusal = |options: &TrainOptions| train(options, &mut |_| ()).unwrap_err().to_string();
    let said = refusal(&fresh);
    for part in ["after 1 steps", "geometry", "--resume", CHECKPOINT_FILE] {
        assert!(said.contains(part), "{said}");
    }
    let mut other = resumed(&fresh);
    other.config.geometry.grid_rate = 0.5;
    let said = refusal(&other);
    assert!(
        said.contains("geometry.grid_rate") && said.contains("0.5"),
        "{said}"
    );

    let photo = dir.path().join("scene/images/0002.png");
    let bytes = fs::read(&photo).unwrap();
    let mut changed = image::open(&photo).unwrap().to_rgb8();
    changed.get_pixel_mut(3, 4)[1] ^= 1;
    changed.save(&photo).unwrap();
    let said = refusal(&resumed(&fresh));
    assert!(said.contains("0002.png of other pixels"), "{said}");
    fs::remove_file(&photo).unwrap();
    let said = refusal(&resumed(&fresh));
    assert!(
        said.contains("0002.png") && said.contains("missing"),
        "{said}"
    );
    fs::write(&photo, bytes).unwrap();

    let discarding = TrainOptions {
        recovery: Recovery {
            unfinished: Unfinished::Discard,
            ..Recovery::default()
        },
        ..fresh.clone()
    };
    train(&discarding, &mut |_| ()).unwrap();
    assert!(!fresh.output.join(CHECKPOINT_FILE).exists());
}

#[test]
fn a_damaged_checkpoint_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let options = careful(dir.path(), small());
    stopped_after(&options, 2).unwrap_err();
    let path = options.output.join(CHECKPOINT_FILE);
    let bytes = fs::read(&path).unwrap();
    let flipped = |at: usize| {
        let mut bytes = bytes.clone();
        bytes[at] ^= 4;
        bytes
    };
    let cut = |length: usize| bytes[..length].to_vec();
    let length = bytes.len();
    for damaged in [
        cut(0),
        cut(100),
        cut(length - 1),
        flipped(40),
        flipped(length / 2),
        flipped(length - 1),
    ] {
        fs::write(&path, damaged).unwrap();
        let error = train(&resumed(&options), &mut |_| ()).unwrap_err();
        assert!(matches!(&error, TrainError::Checkpoint { .. }), "{error}");
        assert!(error.to_string().contains("remove it to start over"));
    }
}

#[test]
fn a_run_in_seconds_is_not_longer_for_an_interruption() {
    let dir = tempfile::tempdir().unwrap();
    let options = TrainOptions {
        budget: Budget::Time(Duration::from_secs(10)),
        ..careful(dir.path(), small())
    };
    stopped_after(&options, 5).unwrap_err();
    let mut at = None;
    let summary = train(&resumed(&options), &mut |event| {
        if let Event::Resumed { step, seconds, .. } = event {
            at = Some((*step, *seconds));
        }
    });
    let (step, seconds) = at.unwrap();
    assert_eq!(step, 5);
    let whole = summary.unwrap().seconds;
    assert!(seconds > 0.0 && whole > seconds, "{seconds} {whole}");
}
