//! Folders of paintings: walked, measured once, and the same with a cache or without.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod common;

use impasto_model::{MODEL_FILE, TrainConfig};
use impasto_style::{Perceptual, StyleVae};
use impasto_train::{CROPS, Event, StyleSet, StyleSources, painting_folder, train};
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// A folder of three paintings, one of them in a sub-folder, and a cache.
struct Place {
    dir: tempfile::TempDir,
    vgg: Perceptual,
}

impl Place {
    fn new() -> Self {
        let dir = tempfile::tempdir().unwrap();
        common::hang(&dir.path().join("styles"), &["a.png", "b.png", "sub/c.png"]);
        Self {
            dir,
            vgg: Perceptual::vgg16().unwrap(),
        }
    }

    fn cache(&self) -> PathBuf {
        self.dir.path().join("cache")
    }

    fn styles(&self) -> PathBuf {
        self.dir.path().join("styles")
    }

    /// The styles, and the warnings on the way.
    fn gather(&self, deadline: Option<Instant>) -> (StyleSet, Vec<String>) {
        let folder = painting_folder(&self.styles()).unwrap();
        let cache = self.cache();
        let sources = StyleSources {
            crops: CROPS,
            folder: Some(&folder),
            generated: 2,
            patch: [67, 81],
            pictures: TrainConfig::fast().style.pictures,
            exemplars: true,
            cache: Some(&cache),
            deadline,
        };
        let mut warnings = Vec::new();
        let styles = StyleSet::gather(&self.vgg, &sources, &mut |event| {
            if let Event::Warning { message } = event {
                warnings.push(message.clone());
            }
        });
        (styles.unwrap(), warnings)
    }
}

/// What is learned of every style, and some of its picture's detail.
fn targets(styles: &StyleSet) -> Vec<Vec<f32>> {
    let vae = StyleVae::shipped().unwrap();
    let all = (0..styles.len()).map(|i| styles.style(&vae, i, None));
    all.map(|style| {
        let detail: Vec<f32> = style.exemplar.iter().copied().step_by(997).collect();
        assert!(detail.iter().any(|x| *x != 0.0));
        [style.target.0, detail].concat()
    })
    .collect()
}

#[test]
fn a_second_run_looks_at_nothing() {
    let place = Place::new();
    let (cold, warnings) = place.gather(None);
    assert_eq!(
        (cold.len(), cold.fresh),
        (3 * 9 + 2, 3 * 9 + 2),
        "{warnings:?}"
    );
    let (warm, warnings) = place.gather(Some(Instant::now()));
    assert_eq!((warm.len(), warm.fresh), (3 * 9 + 2, 0), "{warnings:?}");
    assert_eq!(targets(&cold), targets(&warm));
}

#[test]
fn a_changed_file_is_measured_again() {
    let place = Place::new();
    let (before, _) = place.gather(None);
    impasto_paintings::paint(&impasto_paintings::Recipe::random(77), 50, 70)
        .save(place.styles().join("b.png"))
        .unwrap();
    let (after, _) = place.gather(None);
    assert_eq!(after.fresh, 9);
    assert_ne!(targets(&before), targets(&after));
    fs::remove_file(place.styles().join("b.png")).unwrap();
    let (fewer, _) = place.gather(None);
    assert_eq!(fewer.len(), 2 * 9 + 2);
    assert_eq!(
        fewer.fresh, 3,
        "windows, of those that moved up to the first 24"
    );
}

#[test]
fn a_damaged_or_unusable_cache_is_told_and_done_without() {
    let place = Place::new();
    let (cold, _) = place.gather(None);
    for file in fs::read_dir(place.cache()).unwrap() {
        let path = file.unwrap().path();
        let bytes = fs::read(&path).unwrap();
        fs::write(path, &bytes[..bytes.len() - 9]).unwrap();
    }
    let (again, warnings) = place.gather(None);
    assert_eq!(targets(&cold), targets(&again));
    assert_eq!((again.fresh, warnings.len()), (2, 2), "{warnings:?}");
    assert_eq!(place.gather(None).0.fresh, 0, "it is whole again");

    fs::remove_dir_all(place.cache()).unwrap();
    fs::write(place.cache(), "in the way").unwrap();
    let (without, warnings) = place.gather(None);
    assert_eq!(targets(&cold), targets(&without));
    assert_eq!(warnings.len(), 2, "one for each file: {warnings:?}");
}

#[test]
fn unreadable_files_are_named_and_counted() {
    let place = Place::new();
    for number in 0..23 {
        fs::write(place.styles().join(format!("{number:02}.txt")), "no").unwrap();
    }
    let whole = fs::read(place.styles().join("a.png")).unwrap();
    fs::write(
        place.styles().join("sub/cut.png"),
        &whole[..whole.len() / 2],
    )
    .unwrap();
    let (styles, warnings) = place.gather(None);
    assert_eq!((styles.len(), styles.unreadable.len()), (3 * 9 + 2, 24));
    assert!(
        styles
            .unreadable
            .iter()
            .any(|(path, _)| path.ends_with("cut.png"))
    );
    assert_eq!(warnings.len(), 21, "{warnings:?}");
    assert!(warnings[20].contains("4 more files"), "{}", warnings[20]);
}

/// All of the model's file.
fn model(output: &Path) -> Vec<u8> {
    fs::read(output.join(MODEL_FILE)).unwrap()
}

#[test]
fn a_model_does_not_depend_on_the_cache() {
    let dir = tempfile::tempdir().unwrap();
    let mut options = common::run(dir.path());
    let without = train(&options, &mut |_| ()).unwrap();
    assert_eq!((without.paintings, without.unreadable_paintings), (4, 0));
    let first = model(&options.output);
    options.cache = Some(dir.path().join("cache"));
    for run in ["cold", "warm"] {
        let mut looked_at = None;
        train(&options, &mut |event| {
            if let Event::Measured { fresh, .. } = event {
                looked_at = Some(*fresh);
            }
        })
        .unwrap();
        let expected = if run == "cold" { 4 * 9 + 3 } else { 0 };
        assert_eq!(looked_at, Some(expected), "{run}");
        assert!(
            model(&options.output) == first,
            "{run}: another model than without a cache"
        );
    }
}
