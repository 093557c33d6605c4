//! Everything a run can be told, as data. A preset is a value of [`TrainConfig`].

use crate::TrainError;
use impasto_field::{
    AppearanceConfig, CascadeConfig, DensityActivation, EncodingConfig, FieldConfig,
    SamplingConfig, Shading, VolumeConfig,
};
use impasto_style::PatchStrides;
use serde::{Deserialize, Serialize};

/// Geometry stage (PAPER §4).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GeometryConfig {
    /// Samples a step aims for; the number of rays follows from it.
    pub samples: usize,
    /// Fewest and most rays a step.
    pub rays: [usize; 2],
    /// Rays whose gradients are computed together. A step of more takes several turns: the same
    /// gradients, in less memory.
    #[serde(default = "rays_at_once")]
    pub rays_at_once: usize,
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

fn rays_at_once() -> usize {
    8192
}

/// Style stage (PAPER §6–8).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StyleConfig {
    /// λ of the style loss, for a painting at a typical distance from the photos; nearer and
    /// farther ones are weighed so that all count alike.
    pub style_weight: f32,
    /// Weight of the content loss.
    pub content_weight: f32,
    /// Weight of the squared difference to the unstylised render.
    pub photo_weight: f32,
    /// Share of the stage that first learns the unstylised render in the painting's colours, by
    /// squared difference: cheaper than the perceptual network and less noisy, and what follows
    /// departs from the place in the right palette.
    pub palette_share: f32,
    /// Learning rate of the hypernetworks in that share; a squared difference to the photo's own
    /// colours needs no warm-up.
    pub palette_rate: f32,
    /// Learning rate of the hypernetworks.
    pub rate: f32,
    /// Learning rate of the canvas encoding.
    pub canvas_rate: f32,
    /// Updates over which the rates rise to their full size. One number of a hypernetwork's hidden
    /// layer moves thousands of predicted weights: full steps while Adam's moments are young drive
    /// all colours into the sigmoid's flat ends, where no gradient brings them back.
    pub warm_up: u64,
    /// Rates end at this part of their start.
    pub final_rate: f32,
    /// Height and width of a patch.
    pub patch: [usize; 2],
    /// How far apart a patch's pixels lie.
    pub strides: PatchStrides,
    /// Rays per pixel of a patch along each axis: paint that is finer than a pixel must not count.
    pub supersampling: usize,
    /// Updates per patch that is marched through the field.
    pub patch_uses: u64,
    /// Patches kept for further updates, about 10 MB each when shaded by surface.
    pub pool: usize,
    /// Samples with less weight are left out.
    pub least_weight: f32,
    /// Share of patches that are seen from between two photos instead of from one.
    pub novel_views: f32,
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
            latent: None,
            density: DensityActivation::Exp,
        };
        Self {
            field: FieldConfig {
                inner: volume(grid(16, 1024.0)),
                outer: volume(grid(16, 1024.0)),
                sampling: SamplingConfig {
                    samples: 32,
                    explore: 0.8,
                    inner_step: 0.02,
                    outer_steps: 96,
                    inner_grid: 96,
                    outer_grid: 96,
                    near: 0.05,
                },
                cascade: None,
            },
            photo_app: AppearanceConfig {
                hidden: vec![32, 32],
                layer_norm: false,
                view_bands: Some(2),
                canvas: None,
                shading: Shading::Samples,
                remap: false,
                latent: None,
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
                shading: Shading::Surface,
                remap: false,
                latent: None,
            },
            geometry: GeometryConfig {
                samples: 30_000,
                rays: [512, 8192],
                rays_at_once: rays_at_once(),
                grid_rate: 3e-2,
                network_rate: 1.2e-2,
                final_rate: 0.1,
                distortion: 3e-3,
                surface: 0.1,
                surface_share: 0.1,
                grid_every: 16,
            },
            style: StyleConfig {
                style_weight: 60.0,
                content_weight: 1.0,
                photo_weight: 0.0,
                palette_share: 0.12,
                palette_rate: 1e-3,
                rate: 1e-3,
                canvas_rate: 1e-2,
                warm_up: 200,
                final_rate: 0.1,
                patch: [67, 81],
                strides: PatchStrides::Scale([0.8, 1.4]),
                supersampling: 2,
                patch_uses: 32,
                pool: 64,
                least_weight: 5e-3,
                novel_views: 0.5,
                hyper_width: 64,
                virtual_share: 0.5,
                generated: 300,
            },
            geometry_share: 0.2,
        }
    }
}

impl TrainConfig {
    /// The paper's architecture and schedule (PAPER §2–8), with what its published implementation
    /// adds. Two levels of the cascade, each with its own networks.
    pub fn paper() -> Self {
        let fast = Self::fast();
        let volume = VolumeConfig {
            encoding: EncodingConfig::Frequency { bands: 10 },
            base: vec![128; 5],
            latent: Some(64),
            geo: vec![64],
            density: DensityActivation::Abs,
        };
        let app = AppearanceConfig {
            hidden: vec![128, 128, 64],
            layer_norm: false,
            view_bands: Some(4),
            canvas: None,
            shading: Shading::Samples,
            remap: true,
            latent: Some(64),
        };
        let patch = [67, 81];
        Self {
            field: FieldConfig {
                inner: volume.clone(),
                outer: volume,
                sampling: SamplingConfig {
                    near: 1e-4,
                    ..fast.field.sampling
                },
                cascade: Some(CascadeConfig {
                    first: 64,
                    more: 128,
                }),
            },
            style_app: AppearanceConfig {
                layer_norm: true,
                latent: None,
                ..app.clone()
            },
            photo_app: app,
            geometry: GeometryConfig {
                rays: [patch[0] * patch[1]; 2],
                rays_at_once: 256,
                grid_rate: 5e-4,
                network_rate: 5e-4,
                final_rate: 1.0,
                distortion: 0.0,
                surface: 0.0,
                surface_share: 0.0,
                ..fast.geometry
            },
            style: StyleConfig {
                style_weight: 15.0,
                photo_weight: 1.0,
                palette_share: 0.0,
                rate: 1e-3,
                warm_up: 0,
                final_rate: 1.0,
                patch,
                strides: PatchStrides::Paper,
                supersampling: 1,
                patch_uses: 1,
                pool: 1,
                least_weight: 0.0,
                novel_views: 0.0,
                hyper_width: 64,
                virtual_share: 0.0,
                generated: 0,
                ..fast.style
            },
            // 250,000 of 350,000 steps.
            geometry_share: 5.0 / 7.0,
        }
    }
}

/// Rays of a patch are painted in one graph.
const MOST_PATCH_RAYS: usize = 1 << 18;
/// Largest density grid: 256³ cells are 84 MB.
const LARGEST_GRID: usize = 256;

impl TrainConfig {
    /// Checks every setting that code relies on.
    ///
    /// # Errors
    /// The first setting that is out of range, by its dotted path.
    pub fn validate(&self) -> Result<(), TrainError> {
        let (g, s, sampling) = (&self.geometry, &self.style, &self.field.sampling);
        let rates = [
            g.grid_rate,
            g.network_rate,
            g.final_rate,
            s.rate,
            s.palette_rate,
            s.canvas_rate,
            s.final_rate,
        ];
        let weights = [
            g.distortion,
            g.surface,
            s.style_weight,
            s.content_weight,
            s.photo_weight,
        ];
        let bands = [self.photo_app.view_bands, self.style_app.view_bands];
        let side = |i: usize| s.patch[i].checked_mul(s.supersampling);
        let rays = side(0)
            .zip(side(1))
            .and_then(|(rows, columns)| rows.checked_mul(columns));
        let share = |v: f32| (0.0..=1.0).contains(&v);
        let grid = |v: usize| (1..=LARGEST_GRID).contains(&v);
        let checks = [
            (
                "geometry_share",
                (0.0..=1.0).contains(&self.geometry_share),
                "0 to 1",
            ),
            (
                "geometry.rays",
                1 <= g.rays[0] && g.rays[0] <= g.rays[1],
                "[fewest, most], both at least 1",
            ),
            ("geometry.samples", g.samples >= 1, "at least 1"),
            ("geometry.rays_at_once", g.rays_at_once >= 1, "at least 1"),
            ("geometry.surface_share", share(g.surface_share), "0 to 1"),
            ("geometry.grid_every", g.grid_every >= 1, "at least 1"),
            (
                "*_rate",
                rates.iter().all(|r| r.is_finite() && *r >= 0.0),
                "finite, not negative",
            ),
            (
                "*_weight",
                weights.iter().all(|w| w.is_finite() && *w >= 0.0),
                "finite, not negative",
            ),
            (
                "style.patch",
                s.patch.iter().all(|p| (8..=1024).contains(p)),
                "8 to 1024 a side",
            ),
            ("style.virtual_share", share(s.virtual_share), "0 to 1"),
            (
                "style.supersampling",
                s.supersampling >= 1 && rays.is_some_and(|r| r <= MOST_PATCH_RAYS),
                "at least 1, and at most 262144 rays a patch",
            ),
            ("style.pool", (1..=1024).contains(&s.pool), "1 to 1024"),
            ("style.patch_uses", s.patch_uses >= 1, "at least 1"),
            ("style.generated", s.generated <= 100_000, "at most 100000"),
            (
                "photo_app.shading",
                self.photo_app.shading == Shading::Samples,
                "samples: only styles are shaded by surface",
            ),
            (
                "*.view_bands",
                bands.iter().all(|b| b.is_none_or(|b| b <= 24)),
                "at most 24",
            ),
            ("style.palette_share", share(s.palette_share), "0 to 1"),
            ("style.novel_views", share(s.novel_views), "0 to 1"),
            ("style.least_weight", share(s.least_weight), "0 to 1"),
            (
                "style.hyper_width",
                (1..=4096).contains(&s.hyper_width),
                "1 to 4096",
            ),
            (
                "field.sampling.samples",
                (2..=4096).contains(&sampling.samples),
                "2 to 4096: both volumes need one",
            ),
            ("field.sampling.explore", share(sampling.explore), "0 to 1"),
            (
                "field.sampling.inner_step",
                sampling.inner_step >= 1e-4 && sampling.inner_step <= 1.0,
                "0.0001 to 1",
            ),
            (
                "field.sampling.outer_steps",
                (1..=4096).contains(&sampling.outer_steps),
                "1 to 4096",
            ),
            (
                "field.sampling.inner_grid",
                grid(sampling.inner_grid),
                "1 to 256",
            ),
            (
                "field.sampling.outer_grid",
                grid(sampling.outer_grid),
                "1 to 256",
            ),
            (
                "field.sampling.near",
                sampling.near >= 0.0 && sampling.near.is_finite(),
                "finite, not negative",
            ),
            (
                "field.cascade",
                self.field
                    .cascade
                    .as_ref()
                    .is_none_or(|c| (3..=4096).contains(&c.first) && (1..=4096).contains(&c.more)),
                "first 3 to 4096, more 1 to 4096, or null",
            ),
            (
                "photo_app.canvas",
                self.photo_app.canvas.is_none(),
                "null: only styles have a canvas",
            ),
        ];
        if let Some((key, _, allowed)) = checks.iter().find(|(_, holds, _)| !holds) {
            return Err(setting(key, allowed));
        }
        for (key, volume) in [
            ("field.inner", &self.field.inner),
            ("field.outer", &self.field.outer),
        ] {
            encoding(&format!("{key}.encoding"), &volume.encoding)?;
            widths(&format!("{key}.base"), &volume.base, 1)?;
            trunk(key, volume)?;
            widths(&format!("{key}.geo"), &volume.geo, 0)?;
        }
        let latents = [
            ("field.outer.latent", self.field.outer.latent),
            ("photo_app.latent", self.photo_app.latent),
        ];
        for (key, latent) in latents {
            if latent != self.field.inner.latent {
                return Err(setting(key, "the same as field.inner.latent"));
            }
        }
        if self.style_app.latent.is_some() {
            return Err(setting(
                "style_app.latent",
                "null: styles come from their codes",
            ));
        }
        widths("photo_app.hidden", &self.photo_app.hidden, 0)?;
        widths("style_app.hidden", &self.style_app.hidden, 0)?;
        match &self.style_app.canvas {
            Some(EncodingConfig::Frequency { .. }) => {
                Err(setting("style_app.canvas", "a hash grid, or null"))
            }
            Some(canvas) => encoding("style_app.canvas", canvas),
            None => Ok(()),
        }
    }
}

fn setting(key: &str, allowed: &str) -> TrainError {
    TrainError::Setting {
        key: key.to_owned(),
        reason: format!("out of range, allowed: {allowed}"),
    }
}

fn widths(key: &str, widths: &[usize], least: usize) -> Result<(), TrainError> {
    let fits = widths.len() >= least && widths.iter().all(|w| (1..=4096).contains(w));
    if fits {
        Ok(())
    } else {
        Err(setting(
            key,
            &format!("at least {least} widths of 1 to 4096"),
        ))
    }
}

/// A residual trunk is one layer and blocks of two, all equally wide.
fn trunk(key: &str, volume: &VolumeConfig) -> Result<(), TrainError> {
    let base = &volume.base;
    let residual = base.len() % 2 == 1 && base.iter().all(|w| *w == volume.features());
    match volume.latent {
        Some(latent) if !(1..=4096).contains(&latent) => {
            Err(setting(&format!("{key}.latent"), "1 to 4096, or null"))
        }
        Some(_) if !residual => Err(setting(
            &format!("{key}.base"),
            "an odd number of equal widths where there is a latent vector",
        )),
        _ => Ok(()),
    }
}

fn encoding(key: &str, encoding: &EncodingConfig) -> Result<(), TrainError> {
    let fits = match encoding {
        EncodingConfig::Frequency { bands } => *bands <= 24,
        EncodingConfig::HashGrid {
            levels,
            features,
            log2_entries,
            coarsest,
            finest,
        } => {
            (1..=32).contains(levels)
                && [1, 2, 4, 8].contains(features)
                && (4..=24).contains(log2_entries)
                && *coarsest >= 1.0
                && coarsest <= finest
                && *finest <= 65536.0
        }
    };
    let allowed = "1 to 32 levels, 1, 2, 4 or 8 features, log2_entries 4 to 24, 1 ≤ coarsest ≤ finest ≤ 65536, at most 24 bands";
    if fits {
        Ok(())
    } else {
        Err(setting(key, allowed))
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may panic")]

    use super::*;

    #[test]
    fn presets_are_valid() {
        TrainConfig::fast().validate().unwrap();
        TrainConfig::paper().validate().unwrap();
    }

    #[test]
    fn settings_out_of_range_are_named() {
        type Change = fn(&mut TrainConfig);
        let broken: [(&str, Change); 8] = [
            ("geometry_share", |c| c.geometry_share = f64::NAN),
            ("geometry.rays", |c| c.geometry.rays = [2, 1]),
            ("*_rate", |c| c.style.rate = f32::NAN),
            ("*_weight", |c| c.style.style_weight = -1.0),
            ("style.supersampling", |c| {
                c.style.supersampling = usize::MAX;
            }),
            ("field.sampling.samples", |c| c.field.sampling.samples = 1),
            ("field.inner.base", |c| c.field.inner.base.clear()),
            ("style_app.canvas", |c| {
                c.style_app.canvas = Some(EncodingConfig::Frequency { bands: 4 });
            }),
        ];
        for (wanted, change) in broken {
            let mut config = TrainConfig::fast();
            change(&mut config);
            let Err(TrainError::Setting { key, .. }) = config.validate() else {
                panic!("{wanted} passed");
            };
            assert_eq!(key, wanted);
        }
    }
}
