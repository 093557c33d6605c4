//! Which photos share a camera.

use std::collections::BTreeMap;

use super::Taken;
use crate::error::PrepareError;
use crate::options::Cameras;

/// From so many photos of one camera on, a lens with two focal lengths, two radial and two
/// tangential coefficients can be told from its noise. (Twelve photos of the castle gave a better
/// camera with one coefficient than with four, thirty a good one with four.)
const RICH: usize = 20;

/// Photos for one run of feature extraction.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct CameraGroup {
    /// Names of the photos, sorted.
    pub(crate) photos: Vec<String>,
    /// Whether they share one camera; else each has its own.
    pub(crate) shared: bool,
}

impl CameraGroup {
    /// COLMAP's name of the lens model that suits the number of photos.
    pub(crate) fn model(&self) -> &'static str {
        if self.shared && self.photos.len() >= RICH {
            "OPENCV"
        } else {
            "SIMPLE_RADIAL"
        }
    }
}

/// Divides photos among cameras. Photos that share theirs with no other are one group.
pub(crate) fn groups(photos: &[Taken], cameras: Cameras) -> Result<Vec<CameraGroup>, PrepareError> {
    let mut by_camera: BTreeMap<((u32, u32), &str), Vec<String>> = BTreeMap::new();
    let mut alone = Vec::new();
    for photo in photos {
        let first = &photos[0];
        if cameras == Cameras::One && photo.size != first.size {
            return Err(PrepareError::TwoSizes {
                first: first.name.clone(),
                other: photo.name.clone(),
                sizes: [first.size, photo.size],
            });
        }
        let camera = match cameras {
            Cameras::Many => None,
            Cameras::One => Some((photo.size, "")),
            Cameras::Auto => Some((photo.size, photo.lens.as_str())),
        };
        let group = camera.map_or(&mut alone, |camera| by_camera.entry(camera).or_default());
        group.push(photo.name.clone());
    }
    let group = |mut photos: Vec<String>, shared| {
        photos.sort();
        CameraGroup { photos, shared }
    };
    let mut groups = Vec::new();
    for photos in by_camera.into_values() {
        if photos.len() == 1 {
            alone.extend(photos);
        } else {
            groups.push(group(photos, true));
        }
    }
    if !alone.is_empty() {
        groups.push(group(alone, false));
    }
    Ok(groups)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn photo(name: &str, size: (u32, u32), lens: &str) -> Taken {
        Taken {
            name: name.into(),
            size,
            lens: lens.into(),
            turned: false,
        }
    }

    fn mixed() -> Vec<Taken> {
        vec![
            photo("a", (40, 30), "zoom 24 mm"),
            photo("b", (40, 30), "zoom 70 mm"),
            photo("c", (40, 30), "zoom 24 mm"),
            photo("d", (30, 40), ""),
            photo("e", (40, 30), "zoom 70 mm"),
        ]
    }

    #[test]
    fn size_and_lens_make_a_camera() {
        let found = groups(&mixed(), Cameras::Auto).unwrap();
        let names: Vec<(String, bool)> = found
            .iter()
            .map(|group| (group.photos.concat(), group.shared))
            .collect();
        let expected = [("ac", true), ("be", true), ("d", false)];
        assert_eq!(
            names,
            expected.map(|(names, shared)| (names.into(), shared))
        );
    }

    #[test]
    fn the_user_decides() {
        let many = groups(&mixed(), Cameras::Many).unwrap();
        assert_eq!((many.len(), many[0].shared), (1, false));
        let error = groups(&mixed(), Cameras::One).unwrap_err().to_string();
        assert!(error.contains("d is 30×40"), "{error}");
        let one = groups(&mixed()[..3], Cameras::One).unwrap();
        assert_eq!((one.len(), one[0].shared), (1, true));
    }

    #[test]
    fn many_photos_afford_a_richer_lens() {
        let group = |count, shared| CameraGroup {
            photos: vec![String::new(); count],
            shared,
        };
        assert_eq!(group(30, true).model(), "OPENCV");
        assert_eq!(group(12, true).model(), "SIMPLE_RADIAL");
        assert_eq!(group(30, false).model(), "SIMPLE_RADIAL");
    }
}
