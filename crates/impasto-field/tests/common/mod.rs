//! A small field, its looks and rays.
#![allow(dead_code, reason = "every test file takes what it needs")]

use impasto_field::{
    AppearanceConfig, DensityActivation, EncodingConfig, FieldConfig, RayBatch, SamplingConfig,
    Shading, VolumeConfig,
};

pub fn config(encoding: &EncodingConfig) -> FieldConfig {
    let volume = VolumeConfig {
        encoding: encoding.clone(),
        base: vec![16, 8],
        geo: vec![],
        latent: None,
        density: DensityActivation::Exp,
    };
    FieldConfig {
        inner: volume.clone(),
        outer: volume,
        sampling: SamplingConfig {
            samples: 40,
            explore: 0.1,
            inner_step: 0.05,
            outer_steps: 64,
            inner_grid: 16,
            outer_grid: 64,
            near: 0.05,
        },
        cascade: None,
    }
}

pub fn hash_grid() -> EncodingConfig {
    EncodingConfig::HashGrid {
        levels: 4,
        features: 2,
        log2_entries: 10,
        coarsest: 4.0,
        finest: 32.0,
    }
}

pub fn rays() -> RayBatch {
    let mut rays = RayBatch::default();
    rays.push([0.2, 0.1, -0.5], [0.1, -0.2, 1.0]);
    rays.push([0.0, 0.0, -0.5], [0.0, 0.0, 1.0]);
    rays.push([0.0, 0.0, 0.0], [0.3, 0.3, 1.0]);
    rays
}

pub fn app() -> AppearanceConfig {
    AppearanceConfig {
        hidden: vec![16],
        layer_norm: true,
        shading: Shading::Samples,
        remap: false,
        latent: None,
        view_bands: Some(2),
        canvas: Some(hash_grid()),
    }
}

/// Rays of several groups.
pub fn many_rays() -> RayBatch {
    let mut rays = RayBatch::default();
    for i in 0..300 {
        let at = |k: f32| (i as f32 * k).sin();
        rays.push(
            [0.3 * at(0.7), 0.3 * at(1.3), -0.4],
            [0.4 * at(2.1), 0.4 * at(0.9), 1.0],
        );
    }
    rays
}
