//! Everything a run can be told, as data. A preset is a value of [`TrainConfig`].

mod checks;
mod presets;

use impasto_field::{AppearanceConfig, FieldConfig};
use impasto_style::{Network, PatchStrides, StyleError, StyleReduction, StyleVae};
use serde::{Deserialize, Serialize};

/// Geometry stage (PAPER §4).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GeometryConfig {
    /// Samples a step aims for; the number of rays follows from it. A GPU that trains on its own takes
    /// eight times as many, within the bounds of `rays`.
    pub samples: usize,
    /// Fewest and most rays a step.
    pub rays: [usize; 2],
    /// Rays whose gradients are computed together. A step of more takes several turns: the same
    /// gradients, in less memory.
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

/// Style stage (PAPER §6–8).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StyleConfig {
    /// The network that paintings and patches are measured with.
    pub perceptual: Network,
    /// λ of the style loss.
    pub style_weight: f32,
    /// Whether the style loss of a painting is divided by its distance to the photos, so that all
    /// count alike; λ is then that of a painting at a typical distance.
    pub weigh_paintings: bool,
    /// How the style loss sums up the statistics of all layers.
    pub style_reduction: StyleReduction,
    /// Updates before the style loss joins.
    pub style_warmup: u64,
    /// Weight of the content loss.
    pub content_weight: f32,
    /// What content loss and photo term compare with.
    pub content_target: ContentTarget,
    /// Weight of the squared difference of colours to that.
    pub photo_weight: f32,
    /// Weight of the squared second differences of colours along rows and columns of a patch's rays,
    /// which may be finer than its pixels: what no camera between two others could interpolate.
    /// Stylised views agree with each other as far as they have little of it.
    #[serde(default)]
    pub roughness_weight: f32,
    /// Whether stylised colours may depend on the direction that they are seen from, in
    /// `style_app.view_bands` octaves. A built-in source of disagreement between views.
    pub view_dependent_style: bool,
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
    /// Rays painted in one graph, rounded to groups of 128. A patch of more takes several turns:
    /// the same gradients, in less memory.
    pub rays_at_once: usize,
    /// Hidden width of the hypernetworks.
    pub hyper_width: usize,
    /// How many of `app`'s layers, counted from the last, hypernetworks predict; the ones before
    /// are learned and the same for all styles. More than there are means all.
    pub predicted_layers: usize,
    /// Whether each number of a style code is weighed by what it changes about the decoded
    /// statistics; else it is the style-VAE's plain μ.
    pub weigh_codes: bool,
    /// How much farther from the average painting a look is made than its code says. A
    /// hypernetwork that is unsure predicts something average, so looks come out tamer than their
    /// paintings.
    pub emphasis: f32,
    /// Share of the way that a finished look's colours are moved to the painting's own mean and
    /// contrast.
    pub palette_trust: f32,
    /// What paintings are measured on.
    pub pictures: PictureConfig,
    /// Share of steps that train on a mix of two paintings' statistics.
    pub virtual_share: f32,
    /// Number of generated paintings beside the user's.
    pub generated: usize,
}

/// The square pictures that paintings become.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PictureConfig {
    /// Pixels a side.
    pub side: u32,
    /// Smallest share of the side that a random crop keeps: smaller crops have larger strokes.
    pub least_crop: f32,
    /// Share of random crops whose colours are changed: palettes vary more than 100 paintings do.
    pub recoloured: f64,
    /// Whether patches are compared with windows of their own size, which have less variety than
    /// the whole and more border for their pixels.
    pub windowed: bool,
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
    /// `app` of the style stage, without the view direction unless styles may depend on it.
    pub fn style_appearance(&self) -> AppearanceConfig {
        let app = self.style_app.clone();
        let view_bands = app.view_bands.filter(|_| self.style.view_dependent_style);
        AppearanceConfig { view_bands, ..app }
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
