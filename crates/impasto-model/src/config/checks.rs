//! What settings may be.

use super::{ContentTarget, TrainConfig};
use crate::TrainError;
use impasto_field::{EncodingConfig, Shading, VolumeConfig};
use impasto_style::{Network, PatchStrides};

/// More rays than this are no patch.
pub(super) const MOST_PATCH_RAYS: usize = 1 << 18;
/// Largest density grid: 256³ cells are 84 MB.
const LARGEST_GRID: usize = 256;

/// A setting, whether it holds, and what it may be.
type Check = (&'static str, bool, &'static str);

fn share(v: f32) -> bool {
    (0.0..=1.0).contains(&v)
}

impl TrainConfig {
    /// Checks every setting that code relies on.
    ///
    /// # Errors
    /// The first setting that is out of range, by its dotted path.
    pub fn validate(&self) -> Result<(), TrainError> {
        let numbers = [
            self.stage_checks(),
            self.style_checks(),
            self.sampling_checks(),
        ];
        if let Some((key, _, allowed)) = numbers.iter().flatten().find(|(_, holds, _)| !holds) {
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

    /// What concerns both stages, and the geometry stage.
    fn stage_checks(&self) -> Vec<Check> {
        let (g, s) = (&self.geometry, &self.style);
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
            s.roughness_weight,
        ];
        let usable = |v: &f32| v.is_finite() && *v >= 0.0;
        let latent = self.field.inner.latent;
        let same = "the same as field.inner.latent";
        vec![
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
            ("*_rate", rates.iter().all(usable), "finite, not negative"),
            (
                "*_weight",
                weights.iter().all(usable),
                "finite, not negative",
            ),
            (
                "photo_app.shading",
                self.photo_app.shading == Shading::Samples,
                "samples: only styles are shaded by surface",
            ),
            (
                "photo_app.canvas",
                self.photo_app.canvas.is_none(),
                "null: only styles have a canvas",
            ),
            (
                "field.outer.latent",
                self.field.outer.latent == latent,
                same,
            ),
            ("photo_app.latent", self.photo_app.latent == latent, same),
        ]
    }

    fn style_checks(&self) -> Vec<Check> {
        let s = &self.style;
        let side = |i: usize| s.patch[i].checked_mul(s.supersampling);
        let rays = side(0)
            .zip(side(1))
            .and_then(|(rows, columns)| rows.checked_mul(columns));
        let bands = [self.photo_app.view_bands, self.style_app.view_bands];
        let strides = match s.strides {
            PatchStrides::Paper(parts) => parts.iter().all(|part| *part >= 1),
            PatchStrides::Scale([least, most]) => least > 0.0 && least <= most && most.is_finite(),
        };
        // What is left of a smaller one cannot be convolved.
        let least_side = match s.perceptual {
            Network::Vgg16 => 8,
            Network::Vgg19 => 9,
        };
        let seen = s.content_target == ContentTarget::Render || s.novel_views == 0.0;
        vec![
            (
                "style.patch",
                s.patch.iter().all(|p| (least_side..=1024).contains(p)),
                "8 to 1024 a side, with VGG-19 9 to 1024",
            ),
            (
                "style.strides",
                strides,
                "paper: both at least 1; scale: [least, greatest], above 0",
            ),
            (
                "style.pictures.side",
                (16..=1024).contains(&s.pictures.side),
                "16 to 1024",
            ),
            (
                "style.pictures.least_crop",
                s.pictures.least_crop > 0.0 && s.pictures.least_crop < 1.0,
                "above 0, below 1",
            ),
            (
                "style.pictures.recoloured",
                (0.0..=1.0).contains(&s.pictures.recoloured),
                "0 to 1",
            ),
            ("style.virtual_share", share(s.virtual_share), "0 to 1"),
            (
                "style.supersampling",
                s.supersampling >= 1 && rays.is_some_and(|r| r <= MOST_PATCH_RAYS),
                "at least 1, and at most 262144 rays a patch",
            ),
            ("style.rays_at_once", s.rays_at_once >= 1, "at least 1"),
            ("style.pool", (1..=1024).contains(&s.pool), "1 to 1024"),
            ("style.patch_uses", s.patch_uses >= 1, "at least 1"),
            ("style.generated", s.generated <= 100_000, "at most 100000"),
            ("style.palette_share", share(s.palette_share), "0 to 1"),
            ("style.palette_trust", share(s.palette_trust), "0 to 1"),
            (
                "style.emphasis",
                (0.0..=100.0).contains(&s.emphasis),
                "0 to 100",
            ),
            ("style.novel_views", share(s.novel_views), "0 to 1"),
            (
                "style.novel_views",
                seen,
                "0 where style.content_target is photo: there are no photos between photos",
            ),
            ("style.least_weight", share(s.least_weight), "0 to 1"),
            (
                "style.hyper_width",
                (1..=4096).contains(&s.hyper_width),
                "1 to 4096",
            ),
            (
                "style.predicted_layers",
                s.predicted_layers >= 1,
                "at least 1",
            ),
            (
                "*.view_bands",
                bands.iter().all(|b| b.is_none_or(|b| b <= 24)),
                "at most 24",
            ),
            (
                "style_app.latent",
                self.style_app.latent.is_none(),
                "null: styles come from their codes",
            ),
        ]
    }

    fn sampling_checks(&self) -> Vec<Check> {
        let sampling = &self.field.sampling;
        let grid = |v: usize| (1..=LARGEST_GRID).contains(&v);
        let cascade = self.field.cascade.as_ref();
        vec![
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
                cascade
                    .is_none_or(|c| (3..=4096).contains(&c.first) && (1..=4096).contains(&c.more)),
                "first 3 to 4096, more 1 to 4096, or null",
            ),
        ]
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
        let broken: [(&str, Change); 11] = [
            ("style.patch", |c| {
                (c.style.perceptual, c.style.patch) = (Network::Vgg19, [8, 20]);
            }),
            ("style.novel_views", |c| {
                c.style.content_target = ContentTarget::Photo;
            }),
            ("style.strides", |c| {
                c.style.strides = PatchStrides::Paper([2, 0]);
            }),
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
