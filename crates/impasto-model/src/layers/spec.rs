//! What layers of paint are made from, as JSON.

use crate::layers::mask::MaskSpec;
use impasto_field::StrokeSettings;
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;

/// Most layers of a scene, and most paintings of a layer: each is rendered.
const MOST: usize = 16;
/// How large strokes can be, as many times as large as they were learned.
pub const STROKE_SIZES: RangeInclusive<f32> = 0.5..=2.0;

/// Whose colours a layer has.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ColorPreservation {
    /// The painting's.
    #[default]
    None,
    /// The scene's; only how light they are is the painting's.
    Luminance,
    /// The paint's, moved by one linear map to the mean and covariance of the scene's over the
    /// training views.
    Palette,
}

/// A painting that a layer is made from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PaintingSpec {
    /// What whoever resolves it knows it by: a file, `random:SEED`, an upload.
    pub painting: String,
    /// Its share in the mix, relative to the others'.
    #[serde(default = "one")]
    pub weight: f32,
}

/// One layer of paint; files and messages call it a coat.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StyleLayerSpec {
    /// Mixed by weight in the space of style codes; at least one.
    pub paintings: Vec<PaintingSpec>,
    /// From what is below (0) to the paint (1).
    #[serde(default = "one")]
    pub strength: f32,
    /// How large strokes are, 0.5 to 2; 1 is as the painting asks for.
    #[serde(default = "one")]
    pub stroke_size: f32,
    /// From the scene in the painting's colours (0) to all strokes (1).
    #[serde(default = "one")]
    pub stroke_strength: f32,
    /// Whose colours it has.
    #[serde(default)]
    pub keep: ColorPreservation,
    /// Where it goes; everywhere without.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub mask: Option<MaskSpec>,
}

/// How and where an appearance goes on.
#[derive(Debug, Clone, PartialEq)]
pub struct LayerSettings {
    /// From what is below (0) to the paint (1).
    pub strength: f32,
    /// How large and how strong strokes are.
    pub strokes: StrokeSettings,
    /// Whose colours it has.
    pub keep: ColorPreservation,
    /// Where it goes; everywhere without.
    pub mask: Option<MaskSpec>,
}

impl Default for LayerSettings {
    fn default() -> Self {
        Self {
            strength: 1.0,
            strokes: StrokeSettings::default(),
            keep: ColorPreservation::None,
            mask: None,
        }
    }
}

/// A whole painted scene: the first layer is undermost.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StyleLayers {
    /// None: the scene as photographed.
    pub coats: Vec<StyleLayerSpec>,
}

fn one() -> f32 {
    1.0
}

/// Why layers cannot be painted.
#[derive(Debug, thiserror::Error)]
pub enum LayerError {
    /// A value that makes no sense.
    #[error("coat {number}: {problem}")]
    Value {
        /// Its number, the undermost is 1.
        number: usize,
        /// What is wrong and what would be right.
        problem: String,
    },
    /// More than anybody paints.
    #[error("{0} coats are too many; the most is {MOST}")]
    TooMany(usize),
    /// The model knows no paint.
    #[error(
        "this model has no style stage yet: it can only be shown as photographed; train it with --styles"
    )]
    Unstyled,
    /// StrokeSettings were to change that are none.
    #[error(
        "this model paints without strokes of a size of their own; stroke size and strength need one of the default preset"
    )]
    NoStrokes,
    /// A surface was asked for where there is none.
    #[error("there is no surface at ({}, {}, {}); choose a point on one, in scene units", .0[0], .0[1], .0[2])]
    NoSurface([f32; 3]),
}

impl StyleLayers {
    /// Whether all values make sense.
    ///
    /// # Errors
    /// [`LayerError::Value`] of the first one that does not.
    pub fn check(&self) -> Result<(), LayerError> {
        if self.coats.len() > MOST {
            return Err(LayerError::TooMany(self.coats.len()));
        }
        self.coats.iter().enumerate().try_for_each(|(i, coat)| {
            coat.check().map_err(|problem| LayerError::Value {
                number: i + 1,
                problem,
            })
        })
    }
}

impl StyleLayerSpec {
    /// All but its paintings.
    pub fn settings(&self) -> LayerSettings {
        LayerSettings {
            strength: self.strength,
            strokes: StrokeSettings {
                size: self.stroke_size,
                strength: self.stroke_strength,
            },
            keep: self.keep,
            mask: self.mask.clone(),
        }
    }

    fn check(&self) -> Result<(), String> {
        let count = self.paintings.len();
        if count == 0 || count > MOST {
            return Err(format!("it has {count} paintings; use 1 to {MOST}"));
        }
        let weights = || self.paintings.iter().map(|painting| painting.weight);
        if let Some(wrong) = weights().find(|weight| !(0.0..=1e6).contains(weight)) {
            return Err(format!(
                "a weight of {wrong} is not possible; use 0 or more"
            ));
        }
        if weights().all(|weight| weight == 0.0) {
            return Err("all its paintings have weight 0; give at least one more".into());
        }
        if !(0.0..=1.0).contains(&self.strength) {
            return Err(format!(
                "a strength of {} is not possible; use 0 to 1",
                self.strength
            ));
        }
        if !STROKE_SIZES.contains(&self.stroke_size) {
            return Err(format!(
                "a stroke size of {} is not possible; use 0.5 to 2",
                self.stroke_size
            ));
        }
        if !(0.0..=1.0).contains(&self.stroke_strength) {
            return Err(format!(
                "a stroke strength of {} is not possible; use 0 to 1",
                self.stroke_strength
            ));
        }
        self.mask.as_ref().map_or(Ok(()), MaskSpec::check)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layers::mask::MaskShape;

    fn read(json: &str) -> Result<StyleLayers, String> {
        let coats: StyleLayers = serde_json::from_str(json).map_err(|error| error.to_string())?;
        coats.check().map_err(|error| error.to_string())?;
        Ok(coats)
    }

    #[test]
    fn the_documented_form_is_read_and_written() {
        let documented = r#"{"coats": [{
            "paintings": [{"painting": "a.jpg", "weight": 0.5}, {"painting": "random:42"}],
            "strength": 0.8, "stroke_size": 1.5, "stroke_strength": 0.5, "keep": "luminance",
            "mask": {"shape": {"sphere": {"centre": [0, 0, 0.2], "radius": 0.4}}, "inverted": true}},
            {"paintings": [{"painting": "b"}], "mask": {"shape": "near"}},
            {"paintings": [{"painting": "b"}], "mask": {"shape": {"depth": {"from": 0.2}}}}]}"#;
        let coats = read(documented).unwrap();
        assert_eq!(coats.coats[0].paintings[1].weight, 1.0);
        assert_eq!(
            (coats.coats[0].keep, coats.coats[1].keep),
            (ColorPreservation::Luminance, ColorPreservation::None)
        );
        let shape = |i: usize| coats.coats[i].mask.as_ref().map(|mask| mask.shape.clone());
        assert_eq!(shape(1), Some(MaskShape::Near));
        assert_eq!(
            shape(2),
            Some(MaskShape::Depth {
                from: 0.2,
                to: None
            })
        );
        let written = serde_json::to_string(&coats).unwrap();
        assert_eq!(read(&written).unwrap(), coats);
    }

    #[test]
    fn values_without_sense_are_refused_with_their_coat() {
        let painting = r#""paintings": [{"painting": "a"}]"#;
        for (coat, said) in [
            (r#""paintings": []"#.to_owned(), "0 paintings"),
            (
                r#""paintings": [{"painting": "a", "weight": -1}]"#.into(),
                "weight of -1",
            ),
            (
                r#""paintings": [{"painting": "a", "weight": 0}]"#.into(),
                "weight 0",
            ),
            (format!(r#"{painting}, "strength": 1.5"#), "strength of 1.5"),
            (
                format!(r#"{painting}, "stroke_size": 3"#),
                "stroke size of 3",
            ),
            (
                format!(r#"{painting}, "stroke_strength": -1"#),
                "stroke strength of -1",
            ),
            (format!(r#"{painting}, "colour": 1"#), "unknown field"),
            (
                format!(r#"{painting}, "mask": {{"shape": "sky"}}"#),
                "unknown variant",
            ),
            (
                format!(
                    r#"{painting}, "mask": {{"shape": {{"sphere": {{"centre": [0,0,0], "radius": 0}}}}}}"#
                ),
                "radius of 0",
            ),
            (
                format!(
                    r#"{painting}, "mask": {{"shape": {{"box": {{"min": [0,0,0], "max": [1,0,1]}}}}}}"#
                ),
                "box",
            ),
            (
                format!(r#"{painting}, "mask": {{"shape": {{"depth": {{"from": 2, "to": 1}}}}}}"#),
                "depth",
            ),
        ] {
            let error = read(&format!(r#"{{"coats": [{{{coat}}}]}}"#)).unwrap_err();
            assert!(error.contains(said), "{error} / {said}");
        }
        let many = vec![format!("{{{painting}}}"); MOST + 1].join(",");
        assert!(read(&format!(r#"{{"coats": [{many}]}}"#)).is_err());
    }
}
