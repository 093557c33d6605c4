//! How views are rendered.

use clap::Args;
use impasto::{
    ColorPreservation, LayerSettings, MaskSpec, Model, StrokeSettings, StyleLayer, StyledAppearance,
};

use crate::cli::CliError;
use crate::cli::values::{keep, mask, share, stroke_size};

/// How views are rendered.
#[derive(Debug, Clone, Args)]
pub struct RenderSettings {
    /// From the photos' colours (0) to the style's (1)
    #[arg(long, value_name = "0..1", default_value = "1", value_parser = share, requires = "paint")]
    pub strength: f32,
    /// How large strokes are: 1 is as the painting asks for
    #[arg(long, value_name = "0.5..2", default_value = "1", value_parser = stroke_size, requires = "paint")]
    pub stroke_size: f32,
    /// From the scene in the painting's colours (0) to all strokes (1)
    #[arg(long, value_name = "0..1", default_value = "1", value_parser = share, requires = "paint")]
    pub stroke_strength: f32,
    /// Keep the scene's colours: only lightness is the painting's (luminance, if nothing else is
    /// said), or the paint is moved to the mean and contrast of the scene's own colours (palette)
    #[arg(long = "keep-color", alias = "keep-colour", value_name = "luminance|palette", value_parser = keep,
          num_args = 0..=1, default_missing_value = "luminance", default_value = "none", hide_default_value = true, requires = "paint")]
    pub keep: ColorPreservation,
    /// Paint only there: near, far, depth:FROM..TO, box:X,Y,Z,X,Y,Z, sphere:X,Y,Z,RADIUS or
    /// surface:X,Y,Z[,TOLERANCE], in scene units; not:SHAPE is everywhere else
    #[arg(long, value_name = "SHAPE", value_parser = mask, requires = "paint", allow_hyphen_values = true)]
    pub mask: Option<MaskSpec>,
    /// Rays along each side of a pixel: 2 takes four times as long and flickers less
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..=4))]
    pub supersampling: u32,
}

impl RenderSettings {
    /// A look, put on as they say.
    pub fn coat(&self, model: &Model, look: StyledAppearance) -> Result<StyleLayer, CliError> {
        let settings = LayerSettings {
            strength: self.strength,
            strokes: StrokeSettings {
                size: self.stroke_size,
                strength: self.stroke_strength,
            },
            keep: self.keep,
            mask: self.mask.clone(),
        };
        Ok(model.layer_of(look, &settings)?)
    }
}
