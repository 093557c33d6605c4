//! Everything a run can be told, as data. A preset is a value of [`TrainConfig`].

use impasto_field::{
    AppearanceConfig, DensityActivation, EncodingConfig, FieldConfig, SamplingConfig, VolumeConfig,
};
use serde::{Deserialize, Serialize};

/// Geometry stage (PAPER §4).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GeometryConfig {
    /// Samples a step aims for; the number of rays follows from it.
    pub samples: usize,
    /// Fewest and most rays a step.
    pub rays: [usize; 2],
    /// Learning rate of hash tables at the start.
    pub grid_rate: f32,
    /// Learning rate of networks at the start.
    pub network_rate: f32,
    /// Rates end at this part of their start.
    pub final_rate: f32,
    /// Weight of the distortion measure (Barron et al. 2022), against floaters.
    pub distortion: f32,
    /// Weight of the distance to known sparse points, at the start; fades with the rates.
    pub surface: f32,
    /// Share of a step's rays that go through sparse points.
    pub surface_share: f32,
    /// Steps between two looks at the density grids.
    pub grid_every: u64,
}

/// Style stage (PAPER §6–8).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StyleConfig {
    /// λ of the style loss.
    pub style_weight: f32,
    /// Weight of the content loss.
    pub content_weight: f32,
    /// Weight of the squared difference to the photo.
    pub photo_weight: f32,
    /// Learning rate of the hypernetworks.
    pub rate: f32,
    /// Learning rate of the canvas encoding.
    pub canvas_rate: f32,
    /// Rates end at this part of their start.
    pub final_rate: f32,
    /// Height and width of a patch.
    pub patch: [usize; 2],
    /// Styles trained per geometry pass of a patch.
    pub styles_per_patch: usize,
    /// Samples with less weight are left out.
    pub least_weight: f32,
    /// Hidden width of the hypernetworks.
    pub hyper_width: usize,
    /// Share of steps that train on a mix of two paintings' statistics.
    pub virtual_share: f32,
    /// Number of generated paintings beside the user's.
    pub generated: usize,
}

/// A whole run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TrainConfig {
    /// Sizes of the field.
    pub field: FieldConfig,
    /// `app` of the geometry stage: the photo's own look.
    pub photo_app: AppearanceConfig,
    /// `app` of the style stage.
    pub style_app: AppearanceConfig,
    /// Geometry stage.
    pub geometry: GeometryConfig,
    /// Style stage.
    pub style: StyleConfig,
    /// Share of the budget for the geometry stage.
    pub geometry_share: f64,
}

impl TrainConfig {
    /// The default preset: hash grids, 64-wide networks, a canvas for strokes.
    pub fn fast() -> Self {
        let grid = |log2_entries, finest| EncodingConfig::HashGrid {
            levels: 8,
            features: 4,
            log2_entries,
            coarsest: 16.0,
            finest,
        };
        let volume = |encoding| VolumeConfig {
            encoding,
            base: vec![64, 32],
            geo: vec![],
            density: DensityActivation::Exp,
        };
        Self {
            field: FieldConfig {
                inner: volume(grid(16, 1024.0)),
                outer: volume(grid(16, 1024.0)),
                sampling: SamplingConfig {
                    inner_step: 0.01,
                    outer_steps: 128,
                    inner_grid: 96,
                    outer_grid: 96,
                    near: 0.05,
                },
            },
            photo_app: AppearanceConfig {
                hidden: vec![64, 64],
                layer_norm: false,
                view_bands: Some(2),
                canvas: None,
            },
            style_app: AppearanceConfig {
                hidden: vec![64, 64],
                layer_norm: true,
                view_bands: None,
                canvas: Some(EncodingConfig::HashGrid {
                    levels: 4,
                    features: 4,
                    log2_entries: 16,
                    coarsest: 24.0,
                    finest: 256.0,
                }),
            },
            geometry: GeometryConfig {
                samples: 60_000,
                rays: [512, 8192],
                grid_rate: 1e-2,
                network_rate: 3e-3,
                final_rate: 0.05,
                distortion: 3e-3,
                surface: 0.1,
                surface_share: 0.1,
                grid_every: 16,
            },
            style: StyleConfig {
                style_weight: 15.0,
                content_weight: 1.0,
                photo_weight: 0.0,
                rate: 1e-3,
                canvas_rate: 1e-2,
                final_rate: 0.1,
                patch: [67, 81],
                styles_per_patch: 2,
                least_weight: 5e-3,
                hyper_width: 64,
                virtual_share: 0.3,
                generated: 200,
            },
            geometry_share: 0.3,
        }
    }
}
