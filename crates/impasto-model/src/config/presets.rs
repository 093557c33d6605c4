//! The presets.

use crate::config::{
    CalibrationConfig, ContentTarget, GeometryConfig, MOST_PATCH_RAYS, PictureConfig, StyleConfig,
    TrainConfig,
};
use impasto_field::{
    AppConfig, EncodingConfig, FieldConfig, HierarchicalConfig, PaintSpec, SamplingConfig, Shading,
    VolumeConfig,
};
use impasto_kernels::{Density, HashGridSpec, OccupancySpec};
use impasto_style::{Network, PatchStrides, StyleReduction};

impl TrainConfig {
    /// The default preset: hash grids, small networks, and paint that two views agree on.
    #[allow(clippy::too_many_lines, reason = "one table")]
    pub fn fast() -> Self {
        let grid = |log2_entries, finest| {
            EncodingConfig::HashGrid(HashGridSpec {
                levels: 8,
                features: 4,
                log2_entries,
                coarsest: 16.0,
                finest,
            })
        };
        let volume = |encoding| VolumeConfig {
            encoding,
            base: vec![64, 32],
            geo: vec![],
            density: Density::Exp,
        };
        Self {
            field: FieldConfig {
                inner: volume(grid(16, 1024.0)),
                outer: volume(grid(16, 1024.0)),
                latent: None,
                sampling: SamplingConfig::Occupancy(OccupancySpec {
                    samples: 32,
                    uniform_fraction: 0.8,
                    inner_step: 0.02,
                    outer_steps: 96,
                    inner_grid: 96,
                    outer_grid: 96,
                    near: 0.05,
                }),
            },
            photo_app: AppConfig {
                hidden: vec![32, 32],
                layer_norm: false,
                view_bands: Some(2),
                remap: false,
            },
            style_app: AppConfig {
                hidden: vec![64, 64],
                layer_norm: true,
                view_bands: None,
                remap: false,
            },
            geometry: GeometryConfig {
                samples: 30_000,
                rays: [512, 8192],
                rays_at_once: 8192,
                grid_rate: 3e-2,
                grid_decay: 2.4e-5,
                network_rate: 1.2e-2,
                final_rate: 0.02,
                distortion: 3e-3,
                learned_from: 0.5,
                surface: 0.1,
                surface_share: 0.1,
                grid_every: 16,
                calibration: Some(CalibrationConfig {
                    every: 16,
                    exposures: true,
                    poses_from: Some(0.2),
                }),
            },
            style: StyleConfig {
                shading: Shading::Painted(PaintSpec {
                    // What the network sees is a few pixels wide: nothing finer to keep.
                    distilled: HashGridSpec {
                        levels: 5,
                        features: 4,
                        log2_entries: 16,
                        coarsest: 16.0,
                        finest: 256.0,
                    },
                }),
                perceptual: Network::Vgg16,
                style_weight: 1.0,
                normalize_style_loss: true,
                style_reduction: StyleReduction::Layers,
                style_loss_start: 0,
                content_weight: 2.0,
                content_target: ContentTarget::Render,
                photo_weight: 0.0,
                smoothness_weight: 0.0,
                rate: 1e-3,
                lr_warmup_steps: 200,
                final_rate: 0.1,
                patch: [72, 88],
                strides: PatchStrides::Scale([0.9, 1.3]),
                supersampling: 1,
                patch_uses: 32,
                pool: 64,
                least_weight: 5e-3,
                novel_views: 0.5,
                rays_at_once: MOST_PATCH_RAYS,
                hyper_width: 64,
                predicted_layers: 16,
                weigh_codes: true,
                pictures: PictureConfig {
                    // At 160 pixels most strokes are one to three pixels wide and look like grain.
                    side: 256,
                    least_crop: 0.5,
                    recoloured: 0.0,
                    windowed: true,
                    canonical: true,
                },
                virtual_share: 0.5,
                generated: 0,
            },
            geometry_share: 0.2,
        }
    }
}

impl TrainConfig {
    /// The paper's architecture and schedule (PAPER §2–8), with what its published implementation
    /// adds. Two levels of the cascade, each with its own networks.
    #[allow(clippy::too_many_lines, reason = "one table")]
    pub fn paper() -> Self {
        let fast = Self::fast();
        let volume = VolumeConfig {
            encoding: EncodingConfig::Frequency { bands: 10 },
            base: vec![128; 5],
            geo: vec![64],
            density: Density::Abs,
        };
        let app = AppConfig {
            hidden: vec![128, 128, 64],
            layer_norm: false,
            view_bands: Some(4),
            remap: true,
        };
        let patch = [67, 81];
        Self {
            field: FieldConfig {
                inner: volume.clone(),
                outer: volume,
                latent: Some(64),
                sampling: SamplingConfig::Hierarchical(HierarchicalConfig {
                    first: 64,
                    more: 128,
                    near: 1e-4,
                }),
            },
            style_app: AppConfig {
                layer_norm: true,
                ..app.clone()
            },
            photo_app: app,
            geometry: GeometryConfig {
                rays: [patch[0] * patch[1]; 2],
                rays_at_once: 256,
                grid_rate: 5e-4,
                grid_decay: 0.0,
                network_rate: 5e-4,
                final_rate: 1.0,
                distortion: 0.0,
                learned_from: 0.0,
                calibration: None,
                surface: 0.0,
                surface_share: 0.0,
                ..fast.geometry
            },
            style: StyleConfig {
                shading: Shading::Samples,
                style_weight: 15.0,
                normalize_style_loss: false,
                style_reduction: StyleReduction::Concatenated,
                style_loss_start: 2000,
                content_weight: 1.0,
                content_target: ContentTarget::Photo,
                photo_weight: 1.0,
                smoothness_weight: 0.0,
                rate: 1e-3,
                lr_warmup_steps: 0,
                final_rate: 1.0,
                patch,
                strides: PatchStrides::Paper([2, 3]),
                supersampling: 1,
                patch_uses: 1,
                pool: 1,
                least_weight: 0.0,
                novel_views: 0.0,
                rays_at_once: 256,
                hyper_width: 64,
                weigh_codes: false,
                pictures: PictureConfig {
                    side: 256,
                    // 53 % of the area.
                    least_crop: 0.728,
                    recoloured: 0.0,
                    windowed: false,
                    canonical: false,
                },
                virtual_share: 0.0,
                generated: 0,
                ..fast.style
            },
            // 250,000 of 350,000 steps.
            geometry_share: 5.0 / 7.0,
        }
    }
}
