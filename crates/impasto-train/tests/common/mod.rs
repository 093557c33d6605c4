//! A capture, paintings and settings so small that a run takes seconds.

#![allow(
    clippy::unwrap_used,
    dead_code,
    reason = "a test may panic, and none uses all of this"
)]

use impasto_field::EncodingConfig;
use impasto_kernels::HashGridSpec;
use impasto_kernels::device::tested;
use impasto_model::{Budget, Stages, TrainConfig};
use impasto_paintings::{Recipe, paint};
use impasto_scene::builtin::{BuiltinOptions, write_capture};
use impasto_train::{Recovery, TrainOptions};
use std::path::Path;

/// The fast preset with small hash grids.
pub fn with_grids(levels: usize, log2_entries: u32, finest: f32) -> TrainConfig {
    let mut config = TrainConfig::fast();
    for volume in [&mut config.field.inner, &mut config.field.outer] {
        volume.encoding = EncodingConfig::HashGrid(HashGridSpec {
            levels,
            features: 4,
            log2_entries,
            coarsest: 8.0,
            finest,
        });
    }
    config
}

/// Sizes that train in no time.
pub fn small() -> TrainConfig {
    let mut config = with_grids(4, 10, 64.0);
    let spec = config.field.occupancy_mut().unwrap();
    (spec.inner_grid, spec.outer_grid) = (16, 16);
    config.geometry.samples = 5000;
    config.geometry.rays = [128, 512];
    config.style.patch = [32, 40];
    config.style.generated = 3;
    config
}

/// Writes paintings into a folder that may hold others.
pub fn hang(dir: &Path, names: &[&str]) {
    for (seed, name) in names.iter().enumerate() {
        let path = dir.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        paint(&Recipe::random(seed as u64), 48, 40)
            .save(path)
            .unwrap();
    }
}

/// A run of both stages on a capture and four paintings below `dir`, to `dir/model`.
pub fn run(dir: &Path) -> TrainOptions {
    let capture = BuiltinOptions {
        photos: 4,
        width: 64,
        height: 48,
        ..BuiltinOptions::default()
    };
    write_capture(&dir.join("scene"), &capture).unwrap();
    hang(
        &dir.join("styles"),
        &["a.png", "b/one.png", "b/two.png", "c.png"],
    );
    TrainOptions {
        scene: dir.join("scene"),
        output: dir.join("model"),
        styles: Some(dir.join("styles")),
        encoder: None,
        cache: None,
        stages: Stages::All,
        config: small(),
        budget: Budget::Steps(10),
        load: impasto_scene::LoadOptions::default(),
        seed: 1,
        device: tested(),
        recovery: Recovery::default(),
    }
}
