//! Everything a run can be told, as data. A preset is a value of [`TrainConfig`].

mod presets;

use crate::error::ModelError;
use impasto_field::{AppConfig, AppearanceConfig, FieldConfig, Shading};
use impasto_kernels::settings;
use impasto_kernels::settings::{OutOfRange, share, usable};
use impasto_style::{Network, PatchStrides, StyleError, StyleReduction, StyleVae};
use serde::{Deserialize, Serialize};

/// Side of the square pictures that style is judged on.
pub const STYLE_SIDE: u32 = 160;
/// More rays than this are no patch.
const MOST_PATCH_RAYS: usize = 1 << 18;

settings! {
    /// Geometry stage (PAPER §4).
    #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct GeometryConfig {
        /// Samples a step aims for; the number of rays follows from it. A GPU that trains on its own takes
        /// eight times as many, within the bounds of `rays`.
        pub samples: usize where |v| *v >= 1 => "at least 1",
        /// Fewest and most rays a step.
        pub rays: [usize; 2] where |v| 1 <= v[0] && v[0] <= v[1] => "[fewest, most], both at least 1",
        /// Rays whose gradients are computed together. A step of more takes several turns: the same
        /// gradients, in less memory.
        pub rays_at_once: usize where |v| *v >= 1 => "at least 1",
        /// Learning rate of hash tables at the start.
        pub grid_rate: f32 where |v| usable(*v) => "finite, not negative",
        /// How strongly entries of hash tables are drawn to zero at each step that reaches them, at the
        /// start: that many times the entry, over the number of photos, is added to its gradient
        /// (after Barron et al. 2023, "Zip-NeRF"). What few rays say something of stays calm. The more
        /// photos there are, the less has to be guessed; and the end is for detail, so that it fades.
        pub grid_decay: f32 where |v| usable(*v) => "finite, not negative",
        /// Learning rate of networks at the start.
        pub network_rate: f32 where |v| usable(*v) => "finite, not negative",
        /// Rates end at this part of their start.
        pub final_rate: f32 where |v| usable(*v) => "finite, not negative",
        /// Weight of the distortion measure (Barron et al. 2022), against floaters.
        pub distortion: f32 where |v| usable(*v) => "finite, not negative",
        /// Distance from a camera, as a share of the typical depth of surfaces, from which on its rays
        /// teach the field all that they see; nearer, less (Philip & Deschaintre 2023), against specks
        /// before the lens. 0: everywhere.
        pub learned_from: f32 where |v| share(v) => "0 to 1",
        /// Weight of the distance to known sparse points, at the start; fades with the rates.
        pub surface: f32 where |v| usable(*v) => "finite, not negative",
        /// Share of a step's rays that go through sparse points.
        pub surface_share: f32 where |v| share(v) => "0 to 1",
        /// Steps between two looks at the density grids.
        pub grid_every: u64 where |v| *v >= 1 => "at least 1",
        /// What is learned of the photos beside the field.
        pub calibration: Option<CalibrationConfig>,
    }
}

settings! {
    /// What is learned of the photos themselves.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct CalibrationConfig {
        /// Steps between two comparisons of a photo with the field, photo by photo in turn.
        pub every: u64 where |v| *v >= 1 => "at least 1",
        /// Whether each photo has its own exposure and white balance: an affine map of colours.
        pub exposures: bool,
        /// Share of the stage from which on poses are refined; none: they are as they came.
        pub poses_from: Option<f32> where |v| v.is_none_or(|v| share(&v)) => "0 to 1",
    }
}

/// What a painted patch must stay like.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ContentTarget {
    /// The unstylised render: also known between photos, and without what the field has not
    /// learned of them.
    Render,
    /// The photo (the paper's).
    Photo,
}

settings! {
    /// Style stage (PAPER §6–8).
    #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct StyleConfig {
        /// Where `app` is evaluated.
        pub shading: Shading,

        /// The network that paintings and patches are measured with.
        pub perceptual: Network,

        /// λ of the style loss.
        pub style_weight: f32 where |v| usable(*v) => "finite, not negative",
        /// Whether the style loss of a painting is divided by its distance to the patch before anything is
        /// painted, so that all count alike; λ is then that of a painting at a typical distance.
        pub normalize_style_loss: bool,

        /// How the style loss sums up the statistics of all layers.
        pub style_reduction: StyleReduction,

        /// Updates before the style loss joins.
        pub style_loss_start: u64,

        /// Weight of the content loss.
        pub content_weight: f32 where |v| usable(*v) => "finite, not negative",
        /// What content loss and photo term compare with.
        pub content_target: ContentTarget,

        /// Weight of the squared difference of colours to that.
        pub photo_weight: f32 where |v| usable(*v) => "finite, not negative",
        /// Weight of the squared second differences of colours along rows and columns of a patch's rays,
        /// which may be finer than its pixels: what no camera between two others could interpolate.
        /// Stylised views agree with each other as far as they have little of it.
        pub smoothness_weight: f32 where |v| usable(*v) => "finite, not negative",
        /// Learning rate of the hypernetworks.
        pub rate: f32 where |v| usable(*v) => "finite, not negative",
        /// Updates over which the rates rise to their full size. One number of a hypernetwork's hidden
        /// layer moves thousands of predicted weights: full steps while Adam's moments are young drive
        /// all colours into the sigmoid's flat ends, where no gradient brings them back.
        pub lr_warmup_steps: u64,

        /// Rates end at this part of their start.
        pub final_rate: f32 where |v| usable(*v) => "finite, not negative",
        /// Height and width of a patch.
        pub patch: [usize; 2],

        /// How far apart a patch's pixels lie.
        pub strides: PatchStrides where |v| strides_hold(*v) => "paper: both at least 1; scale: [least, greatest], above 0",
        /// Rays per pixel of a patch along each axis: paint that is finer than a pixel must not count.
        pub supersampling: usize where |v| *v >= 1 => "at least 1, and at most 262144 rays a patch",
        /// Updates per patch that is marched through the field.
        pub patch_uses: u64 where |v| *v >= 1 => "at least 1",
        /// Patches kept for further updates, about a megabyte each when painted.
        pub pool: usize where |v| (1..=1024).contains(v) => "1 to 1024",
        /// Samples with less weight are left out.
        pub least_weight: f32 where |v| share(v) => "0 to 1",
        /// Share of patches that are seen from between two photos instead of from one.
        pub novel_views: f32 where |v| share(v) => "0 to 1",
        /// Rays painted in one graph, rounded to groups of 128. A patch of more takes several turns:
        /// the same gradients, in less memory.
        pub rays_at_once: usize where |v| *v >= 1 => "at least 1",
        /// Hidden width of the hypernetworks.
        pub hyper_width: usize where |v| (1..=4096).contains(v) => "1 to 4096",
        /// How many of `app`'s layers, counted from the last, hypernetworks predict; the ones before
        /// are learned and the same for all styles. More than there are means all.
        pub predicted_layers: usize where |v| *v >= 1 => "at least 1",
        /// Whether each number of a style code is weighed by what it changes about the decoded
        /// statistics; else it is the style-VAE's plain μ.
        pub weigh_codes: bool,

        /// What paintings are measured on.
        pub pictures: PictureConfig,

        /// Share of steps that train on a mix of two paintings' statistics.
        pub virtual_share: f32 where |v| share(v) => "0 to 1",
        /// Number of generated paintings beside the user's.
        pub generated: usize where |v| *v <= 100_000 => "at most 100000",
    }
}

settings! {
    /// The square pictures that paintings become.
    #[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct PictureConfig {
        /// Pixels a side.
        pub side: u32 where |v| (16..=1024).contains(v) => "16 to 1024",
        /// Smallest share of the side that a random crop keeps: smaller crops have larger strokes.
        pub least_crop: f32 where |v| *v > 0.0 && *v < 1.0 => "above 0, below 1",
        /// Share of random crops whose colours are changed: palettes vary more than 100 paintings do.
        pub recoloured: f64 where |v| share(v) => "0 to 1",
        /// Whether patches are compared with windows of their own size, which have less variety than
        /// the whole and more border for their pixels.
        pub windowed: bool,
        /// Whether codes are made of pictures with their palette taken out: of structure alone.
        pub canonical: bool,
    }
}

settings! {
    /// A whole run.
    #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
    #[serde(deny_unknown_fields)]
    pub struct TrainConfig {
        /// Sizes of the field.
        pub field: FieldConfig,

        /// `app` of the geometry stage: the photo's own look.
        pub photo_app: AppConfig,

        /// `app` of the style stage.
        pub style_app: AppConfig,

        /// Geometry stage.
        pub geometry: GeometryConfig,

        /// Style stage.
        pub style: StyleConfig,

        /// Share of the budget for the geometry stage.
        pub geometry_share: f64 where |v| share(v) => "0 to 1",
    }
}

fn strides_hold(strides: PatchStrides) -> bool {
    match strides {
        PatchStrides::Paper(parts) => parts.iter().all(|part| *part >= 1),
        PatchStrides::Scale([least, most]) => least > 0.0 && least <= most && most.is_finite(),
    }
}

impl StyleConfig {
    /// What fields say only together.
    fn check_together(&self) -> Result<(), OutOfRange> {
        let fault = |key, allowed| Err(OutOfRange::new("style", key, allowed));
        // What is left of a smaller one cannot be convolved.
        let least_side = match self.perceptual {
            Network::Vgg16 => 8,
            Network::Vgg19 => 9,
        };
        if !self.patch.iter().all(|p| (least_side..=1024).contains(p)) {
            return fault("patch", "8 to 1024 a side, with VGG-19 9 to 1024");
        }
        let side = |i: usize| self.patch[i].checked_mul(self.supersampling);
        let rays = side(0)
            .zip(side(1))
            .and_then(|(rows, columns)| rows.checked_mul(columns));
        if rays.is_none_or(|rays| rays > MOST_PATCH_RAYS) {
            return fault(
                "supersampling",
                "at least 1, and at most 262144 rays a patch",
            );
        }
        if self.content_target == ContentTarget::Photo && self.novel_views > 0.0 {
            let allowed =
                "0 where style.content_target is photo: there are no photos between photos";
            return fault("novel_views", allowed);
        }
        let paint = self.shading.paint();
        paint.map_or(Ok(()), |paint| paint.check("style.shading.painted"))
    }
}

impl TrainConfig {
    /// Checks every setting that code relies on.
    ///
    /// # Errors
    /// The first setting that is out of range, by its dotted path.
    pub fn validate(&self) -> Result<(), ModelError> {
        self.check("")?;
        self.geometry.check("geometry")?;
        self.style.check("style")?;
        self.style.pictures.check("style.pictures")?;
        self.style.check_together()?;
        self.field.check("field")?;
        self.photo_app.check("photo_app")?;
        self.style_app.check("style_app")?;
        self.check_painted()?;
        Ok(())
    }

    /// What paint asks of the rest.
    fn check_painted(&self) -> Result<(), OutOfRange> {
        if self.style.shading.paint().is_none() {
            return Ok(());
        }
        if self.style_app.view_bands.is_some() {
            let allowed = "null where style.shading is painted: paint sees no direction";
            return Err(OutOfRange::new("style_app", "view_bands", allowed));
        }
        if self.field.occupancy().is_none() {
            let allowed =
                "samples where field.sampling is hierarchical: a first field has no colours";
            return Err(OutOfRange::new("style", "shading", allowed));
        }
        Ok(())
    }

    /// The appearance of the geometry stage: as photographed.
    pub fn photo_appearance(&self) -> AppearanceConfig {
        AppearanceConfig {
            app: self.photo_app.clone(),
            shading: Shading::Samples,
            latent: self.field.latent,
        }
    }

    /// The appearances of the style stage.
    pub fn style_appearance(&self) -> AppearanceConfig {
        AppearanceConfig {
            app: self.style_app.clone(),
            shading: self.style.shading,
            latent: None,
        }
    }

    /// The encoder of styles: `own`, or the shipped one, with codes as
    /// [`StyleConfig::weigh_codes`] says.
    ///
    /// # Errors
    /// If the shipped asset is damaged, or the encoder is for another perceptual network.
    pub fn encoder(&self, own: Option<StyleVae>) -> Result<StyleVae, StyleError> {
        let vae = own.map_or_else(StyleVae::shipped, Ok)?;
        let (found, wanted) = (vae.network(), self.style.perceptual);
        if found != wanted {
            return Err(StyleError::OtherNetwork { found, wanted });
        }
        Ok(match self.style.weigh_codes {
            true => vae,
            false => vae.unweighed(),
        })
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test may panic")]

    use super::*;
    use impasto_field::SamplingConfig;

    #[test]
    fn presets_are_valid() {
        TrainConfig::fast().validate().unwrap();
        TrainConfig::paper().validate().unwrap();
    }

    #[test]
    fn settings_out_of_range_are_named() {
        type Change = fn(&mut TrainConfig);
        let broken: [(&str, Change); 13] = [
            ("style_app.view_bands", |c| c.style_app.view_bands = Some(2)),
            ("style.shading", |c| {
                c.field.sampling = TrainConfig::paper().field.sampling;
            }),
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
            ("style.rate", |c| c.style.rate = f32::NAN),
            ("style.style_weight", |c| c.style.style_weight = -1.0),
            ("style.supersampling", |c| {
                c.style.supersampling = usize::MAX;
            }),
            ("field.sampling.occupancy.samples", |c| {
                if let SamplingConfig::Occupancy(spec) = &mut c.field.sampling {
                    spec.samples = 1;
                }
            }),
            ("field.inner.base", |c| c.field.inner.base.clear()),
            ("style.shading.painted.distilled", |c| {
                if let Shading::Painted(paint) = &mut c.style.shading {
                    paint.distilled.levels = 0;
                }
            }),
        ];
        for (wanted, change) in broken {
            let mut config = TrainConfig::fast();
            change(&mut config);
            let Err(ModelError::Setting(OutOfRange { key, .. })) = config.validate() else {
                panic!("{wanted} passed");
            };
            assert_eq!(key, wanted);
        }
    }
}
