//! Ways to colour a scene.

use crate::color::ColorTransfer;
use impasto_field::Appearance;

/// One way to colour the scene: W^app, and a map of all colours after it.
#[derive(Debug, Clone)]
pub struct StyledAppearance {
    pub(crate) appearance: Appearance,
    /// Applied to every rendered colour.
    pub(crate) transfer: Option<ColorTransfer>,
}

impl StyledAppearance {
    /// An appearance as it is.
    pub fn new(appearance: Appearance) -> Self {
        Self {
            appearance,
            transfer: None,
        }
    }

    /// Colours as `app` gives them, `rays × 3`, after what is applied to all of them.
    pub(crate) fn transferred(&self, colours: Vec<f32>) -> Vec<f32> {
        match &self.transfer {
            Some(transfer) => transfer.apply(&colours),
            None => colours,
        }
    }
}
