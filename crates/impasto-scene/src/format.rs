//! The formats that captures are in.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// A capture format.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Format {
    /// A COLMAP sparse model with its photos.
    Colmap,
    /// `transforms.json` of instant-ngp or nerfstudio, or Blender's `transforms_*.json`.
    Transforms,
    /// NeRF++ folders: `{train,test}/{intrinsics,pose,rgb}`.
    #[serde(rename = "nerf++")]
    NerfPlusPlus,
    /// LLFF's `poses_bounds.npy` with its photos.
    Llff,
}

impl fmt::Display for Format {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Colmap => "colmap",
            Self::Transforms => "transforms",
            Self::NerfPlusPlus => "nerf++",
            Self::Llff => "llff",
        })
    }
}

impl FromStr for Format {
    type Err = String;

    /// Reads a format's name, as it is displayed.
    fn from_str(name: &str) -> Result<Self, String> {
        let all = [
            Self::Colmap,
            Self::Transforms,
            Self::NerfPlusPlus,
            Self::Llff,
        ];
        let named = all.into_iter().find(|format| format.to_string() == name);
        named.ok_or_else(|| {
            format!("unknown capture format \"{name}\"; use colmap, transforms, nerf++ or llff")
        })
    }
}
