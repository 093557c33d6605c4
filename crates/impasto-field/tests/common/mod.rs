//! A small field, its looks and rays.
#![allow(dead_code, reason = "every test file takes what it needs")]
#![allow(clippy::unwrap_used, reason = "a test may panic")]

use impasto_field::{
    AppConfig, Appearance, AppearanceConfig, DistilledFeatures, EncodingConfig, Field, FieldConfig,
    Ground, OccupancyGrids, PaintSpec, RayBatch, SamplingConfig, Shading, VolumeConfig,
};
use impasto_kernels::{Density, HashGridSpec, OccupancySpec};
use rand_pcg::Pcg64;

pub fn config(encoding: &EncodingConfig) -> FieldConfig {
    let volume = VolumeConfig {
        encoding: encoding.clone(),
        base: vec![16, 8],
        geo: vec![],
        density: Density::Exp,
    };
    FieldConfig {
        inner: volume.clone(),
        outer: volume,
        latent: None,
        sampling: SamplingConfig::Occupancy(OccupancySpec {
            samples: 40,
            uniform_fraction: 0.1,
            inner_step: 0.05,
            outer_steps: 64,
            inner_grid: 16,
            outer_grid: 64,
            near: 0.05,
        }),
    }
}

/// Grids of one density.
pub fn grids(field: &Field, density: f32) -> OccupancyGrids {
    OccupancyGrids::uniform(field.config.occupancy().unwrap(), density)
}

pub fn hash_grid_spec() -> HashGridSpec {
    HashGridSpec {
        levels: 4,
        features: 2,
        log2_entries: 10,
        coarsest: 4.0,
        finest: 32.0,
    }
}

pub fn hash_grid() -> EncodingConfig {
    EncodingConfig::HashGrid(hash_grid_spec())
}

pub fn rays() -> RayBatch {
    let mut rays = RayBatch::default();
    rays.push([0.2, 0.1, -0.5], [0.1, -0.2, 1.0]);
    rays.push([0.0, 0.0, -0.5], [0.0, 0.0, 1.0]);
    rays.push([0.0, 0.0, 0.0], [0.3, 0.3, 1.0]);
    rays
}

/// As photographed: shaded at samples.
pub fn app() -> AppearanceConfig {
    AppearanceConfig {
        app: AppConfig {
            hidden: vec![16],
            layer_norm: true,
            remap: false,
            view_bands: Some(2),
        },
        shading: Shading::Samples,
        latent: None,
    }
}

/// Paint: shaded once a ray and volume.
pub fn paint() -> AppearanceConfig {
    AppearanceConfig {
        shading: Shading::Painted(PaintSpec {
            distilled: HashGridSpec {
                levels: 2,
                features: 2,
                log2_entries: 10,
                coarsest: 4.0,
                finest: 9.0,
            },
        }),
        ..app()
    }
}

/// What is known of a place after random learning.
pub fn ground(photo: Appearance, rng: &mut Pcg64) -> Ground {
    let paint = paint();
    let known = paint.shading.paint();
    let device = photo.inner.device();
    let features = known.map(|paint| DistilledFeatures::init(paint.distilled, rng, &device));
    // Entries begin small.
    let features = features.map(|known| DistilledFeatures {
        encoding: known.encoding.clone() * 1e3,
        ..known
    });
    Ground { photo, features }
}

/// Rays of several groups.
pub fn many_rays() -> RayBatch {
    let mut rays = RayBatch::default();
    for i in 0..300 {
        let at = |k: f32| (i as f32 * k).sin();
        rays.push_painted(
            [0.3 * at(0.7), 0.3 * at(1.3), -0.4],
            [0.4 * at(2.1), 0.4 * at(0.9), 1.0],
            0.01,
        );
    }
    rays
}
