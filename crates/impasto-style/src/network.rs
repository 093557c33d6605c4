//! Which perceptual network is meant.

use serde::{Deserialize, Serialize};
use std::fmt;

/// Which perceptual network: what styles and contents are measured with.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Network {
    /// VGG-16, shipped.
    #[default]
    Vgg16,
    /// VGG-19 (the paper's), which users install.
    Vgg19,
}

impl Network {
    /// The number in its name.
    pub(crate) fn number(self) -> f32 {
        match self {
            Self::Vgg16 => 16.0,
            Self::Vgg19 => 19.0,
        }
    }
}

impl fmt::Display for Network {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "vgg{}", self.number())
    }
}
