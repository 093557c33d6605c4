//! Where a layer of paint goes.

use crate::layers::region::Region;
use glam::Vec3;
use serde::{Deserialize, Serialize};

/// A part of the scene, in scene space.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum MaskShape {
    /// The inner volume: inside the unit sphere.
    Near,
    /// The outer one.
    Far,
    /// From one depth along the camera's axis to another, or on for ever: moves with the camera.
    Depth {
        /// Least depth.
        from: f32,
        /// Largest depth, if any.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        to: Option<f32>,
    },
    /// A box along the scene's axes.
    Box {
        /// The corner with the least coordinates.
        min: [f32; 3],
        /// The one opposite.
        max: [f32; 3],
    },
    /// A sphere.
    Sphere {
        /// Its centre.
        centre: [f32; 3],
        /// Its radius.
        radius: f32,
    },
    /// What is connected with the surface at a point and has about its colour.
    Surface {
        /// A point on or near a surface.
        point: [f32; 3],
        /// How far colours may be from the one there, from 0 (the same) to 1 (black and white).
        tolerance: f32,
    },
}

/// A shape or all but a shape.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MaskSpec {
    /// The part.
    pub shape: MaskShape,
    /// Whether everything else is meant.
    #[serde(default)]
    pub inverted: bool,
}

impl MaskSpec {
    /// Whether its numbers make sense.
    ///
    /// # Errors
    /// What is wrong with them, and what would be right.
    pub fn check(&self) -> Result<(), String> {
        let finite = |numbers: &[f32]| numbers.iter().all(|x| x.is_finite());
        match &self.shape {
            MaskShape::Near | MaskShape::Far => Ok(()),
            MaskShape::Depth { from, to } => {
                let to = to.unwrap_or(f32::MAX);
                match *from >= 0.0 && from.is_finite() && to > *from {
                    true => Ok(()),
                    false => Err(format!(
                        "a depth from {from} to {to} is nothing; use 0 ≤ from < to, in scene units"
                    )),
                }
            }
            MaskShape::Box { min, max } => {
                let extends = min.iter().zip(max).all(|(low, high)| low < high);
                match extends && finite(min) && finite(max) {
                    true => Ok(()),
                    false => {
                        Err("its box is empty; every number of min must be below max's".into())
                    }
                }
            }
            MaskShape::Sphere { centre, radius } => {
                match finite(centre) && *radius > 0.0 && radius.is_finite() {
                    true => Ok(()),
                    false => Err(format!(
                        "a sphere with a radius of {radius} is nothing; use more than 0"
                    )),
                }
            }
            MaskShape::Surface { point, tolerance } => {
                match finite(point) && (0.0..=1.0).contains(tolerance) {
                    true => Ok(()),
                    false => Err(format!(
                        "a tolerance of {tolerance} is not possible; use 0 to 1"
                    )),
                }
            }
        }
    }
}

/// A part of the scene, ready to be asked.
#[derive(Debug, Clone)]
pub(crate) struct LayerMask {
    pub(crate) shape: MaskShape,
    /// The grown region of a surface.
    pub(crate) region: Option<Region>,
    pub(crate) inverted: bool,
}

/// Part of a shape's size over which its edge is feathered, inwards: edges of one ray a pixel are
/// ragged otherwise, and what is outside stays untouched.
const FEATHER: f32 = 0.04;

impl LayerMask {
    /// How much of the layer goes where a ray ends, from 0 to 1. A depth that is not finite is beyond
    /// everything.
    pub(crate) fn share(&self, origin: [f32; 3], direction: [f32; 3], depth: f32) -> f32 {
        let share = match depth.is_finite() {
            true => self.inside(Vec3::from(origin) + Vec3::from(direction) * depth, depth),
            false => {
                let endless = matches!(
                    self.shape,
                    MaskShape::Far | MaskShape::Depth { to: None, .. }
                );
                f32::from(u8::from(endless))
            }
        };
        if self.inverted { 1.0 - share } else { share }
    }

    fn inside(&self, point: Vec3, depth: f32) -> f32 {
        match &self.shape {
            MaskShape::Near => feathered(1.0 - point.length(), FEATHER),
            MaskShape::Far => 1.0 - feathered(1.0 - point.length(), FEATHER),
            MaskShape::Depth { from, to } => {
                let size = to.unwrap_or(2.0 * from.max(0.5)) - from;
                let before = to.map_or(f32::INFINITY, |to| to - depth);
                feathered((depth - from).min(before), FEATHER * size)
            }
            MaskShape::Box { min, max } => {
                let (min, max) = (Vec3::from(*min), Vec3::from(*max));
                let deep = (point - min).min(max - point).min_element();
                feathered(deep, FEATHER * (max - min).min_element())
            }
            MaskShape::Sphere { centre, radius } => feathered(
                radius - point.distance(Vec3::from(*centre)),
                FEATHER * radius,
            ),
            MaskShape::Surface { .. } => self
                .region
                .as_ref()
                .map_or(0.0, |region| region.share(point)),
        }
    }
}

/// From 0 at the edge and outside to 1 at `width` inside.
fn feathered(deep: f32, width: f32) -> f32 {
    let t = (deep / width).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn share(shape: &MaskShape, point: [f32; 3]) -> f32 {
        // From far behind the point, along z.
        let mask = |inverted| LayerMask {
            shape: shape.clone(),
            region: None,
            inverted,
        };
        let origin = [point[0], point[1], point[2] - 3.0];
        let of = |inverted| mask(inverted).share(origin, [0.0, 0.0, 1.0], 3.0);
        assert!((of(false) + of(true) - 1.0).abs() < 1e-6);
        of(false)
    }

    #[test]
    fn shapes_hold_their_middle_and_nothing_outside() {
        let sphere = || MaskShape::Sphere {
            centre: [0.1, 0.0, 0.0],
            radius: 0.5,
        };
        assert_eq!(share(&sphere(), [0.1, 0.0, 0.0]), 1.0);
        assert_eq!(share(&sphere(), [0.61, 0.0, 0.0]), 0.0);
        assert!((0.1..0.9).contains(&share(&sphere(), [0.59, 0.0, 0.0])));
        let cube = || MaskShape::Box {
            min: [0.0; 3],
            max: [1.0, 2.0, 3.0],
        };
        assert_eq!(
            (
                share(&cube(), [0.5, 1.0, 2.9]),
                share(&cube(), [0.5, -0.01, 1.0])
            ),
            (1.0, 0.0)
        );
        assert_eq!(
            (
                share(&MaskShape::Near, [0.5, 0.5, 0.0]),
                share(&MaskShape::Far, [0.5, 0.5, 0.0])
            ),
            (1.0, 0.0)
        );
        assert_eq!(
            (
                share(&MaskShape::Near, [1.0, 0.5, 0.0]),
                share(&MaskShape::Far, [1.0, 0.5, 0.0])
            ),
            (0.0, 1.0)
        );
        let depth = |from, to| share(&MaskShape::Depth { from, to }, [0.0; 3]);
        assert_eq!(
            (
                depth(2.0, Some(4.0)),
                depth(3.1, None),
                depth(0.0, Some(2.9))
            ),
            (1.0, 0.0, 0.0)
        );
    }

    #[test]
    fn what_never_ends_is_far_and_behind_every_depth() {
        let endless = |shape| {
            let mask = LayerMask {
                shape,
                region: None,
                inverted: false,
            };
            mask.share([0.0; 3], [0.0, 0.0, 1.0], f32::INFINITY)
        };
        assert_eq!(endless(MaskShape::Far), 1.0);
        assert_eq!(endless(MaskShape::Near), 0.0);
        assert_eq!(
            endless(MaskShape::Depth {
                from: 1.0,
                to: None
            }),
            1.0
        );
        assert_eq!(
            endless(MaskShape::Depth {
                from: 1.0,
                to: Some(9.0)
            }),
            0.0
        );
    }
}
